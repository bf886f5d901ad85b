//! Functions of textures and images, by the parts of their names.

/// A function of a texture or an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TextureFunction {
    Sample(Sampling),
    Gather,
    /// `texelFetch` or `texelFetchOffset`.
    Fetch {
        has_offset: bool,
    },
    Size,
    Levels,
    /// `imageLoad`.
    Load,
    Store,
    /// A function that WebGPU lacks.
    Absent,
}

/// How a texture is sampled. Fields are in the order of the arguments after the coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Sampling {
    /// Whether the last coordinate divides the others.
    pub projects: bool,
    pub level: Level,
    pub has_offset: bool,
}

/// How the level is determined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Level {
    /// By the derivatives of the coordinates, plus a bias if there is one after all arguments.
    #[default]
    Implicit,
    Exact,
    Gradient,
}

/// Prefixes of functions in older versions.
const OLD_PREFIXES: [&str; 7] = [
    "texture2DRect",
    "texture1D",
    "texture2D",
    "texture3D",
    "textureCube",
    "shadow1D",
    "shadow2D",
];

/// The texture function with this name in any version, and whether it compares and returns a
/// vector, as `shadow2D` does.
pub(super) fn named(name: &str) -> Option<(TextureFunction, bool)> {
    let known = match name {
        "texelFetch" => Some(TextureFunction::Fetch { has_offset: false }),
        "texelFetchOffset" => Some(TextureFunction::Fetch { has_offset: true }),
        "textureSize" => Some(TextureFunction::Size),
        "textureQueryLevels" => Some(TextureFunction::Levels),
        "textureGather" | "textureGatherOffset" | "textureGatherOffsets" => {
            Some(TextureFunction::Gather)
        }
        "textureQueryLod" | "textureSamples" => Some(TextureFunction::Absent),
        _ => name
            .strip_prefix("texture")
            .and_then(sampling)
            .map(TextureFunction::Sample),
    };
    if let Some(known) = known {
        return Some((known, false));
    }
    let bare = name
        .trim_end_matches("EXT")
        .trim_end_matches("ARB")
        .trim_end_matches("OES");
    let prefix = OLD_PREFIXES.iter().find(|p| bare.starts_with(**p))?;
    let sampling = sampling(&bare[prefix.len()..]).filter(|of| !of.has_offset)?;
    // The `EXT` version of GLSL ES 1.00 returns a float.
    let is_vector = prefix.starts_with("shadow") && !name.ends_with("EXT");
    Some((TextureFunction::Sample(sampling), is_vector))
}

/// Parses the part of a name after `texture`, such as `ProjLodOffset`.
fn sampling(words: &str) -> Option<Sampling> {
    let (words, has_offset) = strip(words.strip_suffix("Offset"), words);
    let (words, projects) = strip(words.strip_prefix("Proj"), words);
    let level = match words {
        "" => Level::Implicit,
        "Lod" => Level::Exact,
        "Grad" => Level::Gradient,
        _ => return None,
    };
    Some(Sampling {
        projects,
        level,
        has_offset,
    })
}

fn strip<'a>(stripped: Option<&'a str>, whole: &'a str) -> (&'a str, bool) {
    (stripped.unwrap_or(whole), stripped.is_some())
}

impl TextureFunction {
    /// Whether it takes integer coordinates, and no sampler.
    pub(super) fn fetches(self) -> bool {
        matches!(self, Self::Fetch { .. } | Self::Size | Self::Levels)
    }

    /// The index of the offset among the arguments after the sampler.
    pub(super) fn offset(self) -> Option<usize> {
        match self {
            Self::Sample(of) => of.has_offset.then_some(match of.level {
                Level::Implicit => 1,
                Level::Exact => 2,
                Level::Gradient => 3,
            }),
            _ => None,
        }
    }

    /// Whether it derives its level from derivatives in the fragment stage.
    pub(super) fn is_implicit(self) -> bool {
        matches!(self, Self::Sample(of) if of.level == Level::Implicit)
    }

    /// The name in GLSL 4.50, for names of helpers.
    pub(super) fn name(self) -> String {
        match self {
            Self::Sample(of) => {
                let projects = if of.projects { "Proj" } else { "" };
                let level = match of.level {
                    Level::Implicit => "",
                    Level::Exact => "Lod",
                    Level::Gradient => "Grad",
                };
                let offset = if of.has_offset { "Offset" } else { "" };
                format!("texture{projects}{level}{offset}")
            }
            Self::Fetch { has_offset: false } => "texelFetch".to_owned(),
            Self::Fetch { has_offset: true } => "texelFetchOffset".to_owned(),
            Self::Size => "textureSize".to_owned(),
            Self::Levels => "textureQueryLevels".to_owned(),
            Self::Gather => "textureGather".to_owned(),
            Self::Load => "imageLoad".to_owned(),
            Self::Store => "imageStore".to_owned(),
            Self::Absent => "texture".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_parts() {
        for name in [
            "texture",
            "textureProjLodOffset",
            "textureGradOffset",
            "textureProj",
        ] {
            let (function, is_vector) = named(name).unwrap_or((TextureFunction::Absent, true));
            assert_eq!((function.name().as_str(), is_vector), (name, false));
        }
        let old = |name| named(name).map(|(function, is_vector)| (function.name(), is_vector));
        assert_eq!(old("shadow2DProj"), Some(("textureProj".to_owned(), true)));
        assert_eq!(
            old("texture2DLodEXT"),
            Some(("textureLod".to_owned(), false))
        );
        assert_eq!(old("texture2DOffset"), None);
        assert_eq!(old("textures"), None);
    }
}
