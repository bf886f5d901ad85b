//! Evidence in the name and the type of a uniform that it follows the viewer.

use naga::{Module, TypeInner, VectorSize};

use super::Path;

/// Words for the viewer.
const VIEWER: &[&str] = &["camera", "cam", "view", "viewer", "eye", "observer"];

/// Words for a matrix that leads to, or from, the viewer's axes.
const MATRIX: &[&str] = &[
    "proj",
    "projection",
    "projected",
    "vp",
    "pv",
    "mvp",
    "pvm",
    "wvp",
    "mv",
    "wv",
    "clip",
    "ndc",
    "screen",
];

const PLACE: &[&str] = &[
    "pos", "position", "origin", "location", "loc", "place", "point", "from", "world", "space",
    "ws",
];

const DIRECTION: &[&str] = &[
    "dir",
    "direction",
    "forward",
    "right",
    "left",
    "up",
    "down",
    "front",
    "axis",
    "look",
    "at",
    "target",
    "vector",
    "vec",
];

/// Words for the parameters of a view's depths.
const RANGE: &[&str] = &["near", "far", "fov", "fovx", "fovy", "aspect"];

const BESIDE_RANGE: &[&str] = &[
    "plane",
    "planes",
    "clip",
    "clipping",
    "distance",
    "dist",
    "depth",
    "range",
    "ratio",
    "tan",
    "half",
    "proj",
    "projection",
];

/// The size of the picture, and offsets in it.
const PICTURE: &[&str] = &["screen", "viewport", "resolution", "jitter"];

const BESIDE_PICTURE: &[&str] = &[
    "size",
    "dim",
    "dims",
    "dimensions",
    "width",
    "height",
    "inv",
    "inverse",
    "texel",
    "frame",
    "taa",
    "offset",
    "rect",
];

/// Words for something else that has a place, an axis or a range.
const OBJECT: &[&str] = &[
    "model", "object", "obj", "local", "bone", "bones", "joint", "joints", "instance", "node",
    "mesh", "skin",
];

/// Words for other subjects with a place, an axis or a range.
const OTHER: &[&str] = &[
    "light", "lights", "lamp", "sun", "shadow", "fog", "fade", "lod", "material", "wind",
];

/// Words that names write without a border between them: `cameraposition`, `viewproj`.
const WRITTEN_TOGETHER: &[&str] = &[
    "camera",
    "cam",
    "view",
    "eye",
    "proj",
    "projection",
    "matrix",
    "mat",
    "inverse",
    "inv",
    "pos",
    "position",
    "origin",
    "near",
    "far",
    "plane",
    "dir",
    "direction",
    "screen",
    "clip",
    "world",
    "model",
    "object",
    "local",
    "space",
    "to",
    "from",
    "look",
    "at",
    "size",
];

/// The words of a name, in lower case: of `uCameraPos` they are `camera` and `pos`.
pub(super) fn words(name: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    let mut word = String::new();
    let letters: Vec<char> = name.chars().collect();
    for (i, c) in letters.iter().enumerate() {
        let after_small = i > 0 && letters[i - 1].is_lowercase();
        let before_small = letters.get(i + 1).is_some_and(|n| n.is_lowercase());
        let starts = c.is_uppercase() && (after_small || before_small);
        if !c.is_alphabetic() || starts {
            found.extend((!word.is_empty()).then(|| std::mem::take(&mut word)));
        }
        if c.is_alphabetic() {
            word.extend(c.to_lowercase());
        }
    }
    found.extend((!word.is_empty()).then_some(word));
    // `u_eye`, `m_view`, `zNear`.
    if found.len() > 1 {
        found.retain(|word| word.len() > 1);
    }
    found.iter().flat_map(|word| compounds(word)).collect()
}

/// A word, or the words that it is written together from.
fn compounds(word: &str) -> Vec<String> {
    if let Some(of_depth) = word.strip_prefix('z')
        && RANGE.contains(&of_depth)
    {
        return vec![of_depth.to_owned()];
    }
    split(word).unwrap_or_else(|| vec![word.to_owned()])
}

fn split(word: &str) -> Option<Vec<String>> {
    if word.is_empty() {
        return Some(Vec::new());
    }
    // The longest first: `projection` before `proj`.
    let mut starts: Vec<&&str> = WRITTEN_TOGETHER
        .iter()
        .filter(|start| word.starts_with(**start))
        .collect();
    starts.sort_by_key(|start| std::cmp::Reverse(start.len()));
    starts.into_iter().find_map(|start| {
        let mut all = vec![(*start).to_owned()];
        all.extend(split(&word[start.len()..])?);
        Some(all)
    })
}

fn any(words: &[String], of: &[&[&str]]) -> bool {
    words
        .iter()
        .any(|word| of.iter().any(|list| list.contains(&word.as_str())))
}

fn all(words: &[String], of: &[&[&str]]) -> bool {
    words
        .iter()
        .all(|word| of.iter().any(|list| list.contains(&word.as_str())))
}

/// Whether the path of a matrix suggests that it includes the view, and not the projection alone.
pub(super) fn says_view(path: &str) -> bool {
    let own = words(path.rsplit('.').next().unwrap_or_default());
    any(
        &own,
        &[VIEWER, &["vp", "pv", "mvp", "pvm", "wvp", "mv", "wv"]],
    )
}

/// Whether the name of a matrix suggests that it begins in an object's own space.
pub fn is_combined(name: &str) -> bool {
    let name = name.to_lowercase().replace('_', "");
    let words = ["model", "mvp", "object", "local", "worldview", "wvp"];
    words.iter().any(|word| name.contains(word))
}

/// Whether a path suggests that it belongs to an object.
pub(super) fn is_of_object(path: &str) -> bool {
    any(&words(path), &[OBJECT, &["world"]])
}

/// Whether the path of a matrix suggests that it leads from the world, or from the viewer's axes,
/// to the picture, and from no object's axes.
pub fn is_of_view_alone(path: &str) -> bool {
    let own = words(path.rsplit('.').next().unwrap_or_default());
    let of_view = any(&own, &[VIEWER, MATRIX, &["p", "v"]]);
    of_view && !any(&own, &[OBJECT, &["mvp", "pvm", "wvp", "mv", "wv"]])
}

/// Whether the path of a uniform that follows the viewer suggests that it is a direction.
pub fn is_axis(path: &str) -> bool {
    let own = words(path.rsplit('.').next().unwrap_or_default());
    any(&own, &[DIRECTION]) && !any(&own, &[&["from"], MATRIX])
}

impl Path {
    /// Whether name and type suggest that it follows the viewer.
    pub(super) fn follows(&self, module: &Module) -> bool {
        let steps = self.steps(module);
        let Some(((name, _), outer)) = steps.split_last() else {
            return false;
        };
        let own = words(name);
        let mut around = Vec::new();
        for (name, ty) in outer {
            around.extend(words(name));
            let of_type = module.types[*ty].name.as_deref();
            around.extend(words(of_type.unwrap_or_default()));
        }
        let is_others = any(&around, &[OBJECT, OTHER]);
        let of_camera = any(&around, &[VIEWER]) && !is_others;
        match shape(module, self.ty) {
            Shape::Matrix => {
                let is_transform = matches!(&own[..], [one] if one == "transform");
                is_transform
                    || any(&own, &[VIEWER, MATRIX])
                    || (of_camera && !any(&own, &[OBJECT, &["world"]]))
            }
            Shape::Floats(count) => {
                let is_place = count >= 3
                    && !own.is_empty()
                    && all(&own, &[VIEWER, PLACE, DIRECTION])
                    && (any(&own, &[VIEWER])
                        || of_camera
                        || matches!(&own[..], [a, b] if a == "look" && b == "from")
                        || (self.is_beside_view(module)
                            && all(&own, &[&["right", "up", "forward"]])));
                let is_range =
                    !is_others && any(&own, &[RANGE]) && all(&own, &[RANGE, BESIDE_RANGE, VIEWER]);
                let is_picture =
                    any(&own, &[PICTURE]) && all(&own, &[PICTURE, BESIDE_PICTURE, VIEWER]);
                is_place || is_range || is_picture
            }
            Shape::Other => false,
        }
    }

    /// Whether a matrix of the view is a member of the same struct.
    fn is_beside_view(&self, module: &Module) -> bool {
        let steps = self.steps(module);
        let Some((_, outer)) = steps.iter().rev().nth(1) else {
            return false;
        };
        let TypeInner::Struct { members, .. } = &module.types[*outer].inner else {
            return false;
        };
        members.iter().any(|member| {
            let own = words(member.name.as_deref().unwrap_or_default());
            matches!(shape(module, member.ty), Shape::Matrix) && any(&own, &[VIEWER, MATRIX])
        })
    }
}

/// The shape of a type that a view may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    Matrix,
    Floats(u32),
    Other,
}

/// The shape of a type, or of its elements.
fn shape(module: &Module, ty: naga::Handle<naga::Type>) -> Shape {
    match &module.types[ty].inner {
        TypeInner::Array { base, .. } => shape(module, *base),
        TypeInner::Matrix { columns, .. } if *columns >= VectorSize::Tri => Shape::Matrix,
        TypeInner::Vector { size, .. } => Shape::Floats(*size as u32),
        TypeInner::Scalar(_) => Shape::Floats(1),
        _ => Shape::Other,
    }
}

#[cfg(test)]
mod tests {
    use super::words;

    #[test]
    fn names_are_taken_apart_into_words() {
        for (name, expected) in [
            ("uCameraPos", "camera pos"),
            ("_WorldSpaceCameraPos", "world space camera pos"),
            ("view_proj", "view proj"),
            ("viewprojection", "view projection"),
            ("modelViewMatrix", "model view matrix"),
            ("lightVP", "light vp"),
            ("AlphaClipThreshold", "alpha clip threshold"),
            ("review", "review"),
            ("projector_alpha", "projector alpha"),
            ("zNear", "near"),
            ("znear", "near"),
            ("u_eye", "eye"),
            ("lookFrom", "look from"),
            ("eye_open", "eye open"),
        ] {
            assert_eq!(words(name).join(" "), expected, "{name}");
        }
    }
}
