//! The built-in metallic-roughness material, in the version that a primitive needs.

use std::collections::BTreeSet;

use preshade_compiler::front::{self, Source};
use preshade_draw::scene::SceneError;
use shader_text::options;

/// The WGSL template. `//#if` lines mark the parts of each version.
const TEXT: &str = include_str!("material.wgsl");

/// The `//#if` words that are defined in a version.
pub(crate) type Words = BTreeSet<&'static str>;

/// Parses the version that these words define.
///
/// A texture whose word is in `second`, such as `BASE_COLOR`, uses the second set of texture
/// coordinates.
///
/// # Errors
/// A limit is exceeded.
pub(crate) fn version(
    words: &Words,
    second: &Words,
    lights: usize,
    limits: shader_text::limits::Limits,
) -> Result<front::Parsed, SceneError> {
    let text = text(words, second, lights);
    let source = Source::new("gltf-material.wgsl", text);
    let options = options::Options {
        limits,
        ..shader_text::options::Options::default()
    };
    front::parse(&[source], &options).map_err(|e| {
        SceneError::new(format!("the built-in material: {e}"))
            .detail(e.render(shader_text::error::Color::Never))
    })
}

/// The WGSL text of a version.
fn text(words: &Words, second: &Words, lights: usize) -> String {
    let mut out = String::new();
    // For each open `//#if`, whether its lines belong to the version.
    let mut open: Vec<bool> = Vec::new();
    for line in TEXT.lines() {
        if let Some(word) = line.strip_prefix("//#if ") {
            open.push(words.contains(word));
        } else if line == "//#else" {
            open.iter_mut()
                .last()
                .into_iter()
                .for_each(|is_in| *is_in = !*is_in);
        } else if line == "//#end" {
            open.pop();
        } else if open.iter().all(|is_in| *is_in) {
            out.push_str(line);
            out.push('\n');
        }
    }
    for texture in [
        "BASE_COLOR",
        "METALLIC_ROUGHNESS",
        "NORMAL",
        "OCCLUSION",
        "EMISSIVE",
    ] {
        let uv = match second.contains(texture) {
            true => "in.uv1",
            false => "in.uv",
        };
        let at = match words.contains("TRANSFORM") {
            true => format!("at({uv}, material.{}_transform)", texture.to_lowercase()),
            false => uv.to_owned(),
        };
        out = out.replace(&format!(" {texture}_AT"), &format!(" {at}"));
    }
    out.replace("LIGHTS", &lights.to_string())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn every_version_is_valid() {
        let all = [
            "TRANSFORM",
            "SKIN",
            "BASE_COLOR_TEXTURE",
            "METALLIC_ROUGHNESS_TEXTURE",
            "NORMAL_TEXTURE",
            "OCCLUSION_TEXTURE",
            "EMISSIVE_TEXTURE",
            "LIT",
            "UV",
            "UV1",
            "COLOR",
            "INSTANCES",
            "TWO_SIDED",
            "MASK",
            "BLEND",
            "ENCODE",
        ];
        let second = Words::from(["NORMAL", "BASE_COLOR"]);
        let parse = |words: &Words, lights| {
            let limits = shader_text::limits::Limits::default();
            version(words, &second, lights, limits).unwrap()
        };
        parse(&Words::from(all), 3);
        parse(&Words::new(), 0);
        parse(&Words::from(["LIT"]), 1);
        parse(&Words::from(["BASE_COLOR_TEXTURE", "UV", "UV1", "MASK"]), 0);
        assert!(
            TEXT.lines()
                .all(|l| !l.starts_with("//#if ") || all.contains(&&l[6..]))
        );
    }
}
