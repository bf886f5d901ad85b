//! One GLSL file to a naga module.

use naga::ShaderStage;
use naga::front::glsl::{Frontend, Options};
use naga::valid::{Capabilities, ValidationFlags, Validator};

use super::error::{Code, Error};
use super::{macros, promote, switch};
use preshade_passes::link::offset;

/// Parses `text` as GLSL 440 to 460 (all that naga reads). Error labels are offset by `base`; the module's own spans are not. The entry point
/// is named `vertex_main` or `fragment_main`: a module has one name space, and both stages arrive as `main`.
pub(super) fn parse(
    text: &str,
    stage: ShaderStage,
    defines: &[(String, String)],
    base: u32,
) -> Result<naga::Module, Error> {
    macros::check(text, defines)?;
    let mut options = Options::from(stage);
    options.defines.extend(defines.iter().cloned());
    let mut module = Frontend::default()
        .parse(&options, text)
        .map_err(|errors| {
            let mut all = errors.errors.iter();
            let Some(first) = all.next() else {
                return Error::new(Code::Parse, "the GLSL parser gave up without saying why");
            };
            let mut error =
                Error::new(Code::Parse, first.kind.to_string()).label(offset(first.meta, base), "");
            for other in all {
                error = error.label(offset(other.meta, base), other.kind.to_string());
            }
            if let Some(hint) = hint(text) {
                error = error.note(hint);
            }
            error
        })?;
    let name = match stage {
        ShaderStage::Vertex => "vertex_main",
        _ => "fragment_main",
    };
    for entry in &mut module.entry_points {
        entry.name = name.to_owned();
    }
    switch::write_out_fall_through(&mut module);
    // An invalid module stays as it is for the validator's message on it.
    if is_valid(&module) {
        promote::promote(&mut module);
    }
    Ok(module)
}

fn is_valid(module: &naga::Module) -> bool {
    Validator::new(ValidationFlags::all(), Capabilities::all())
        .validate(module)
        .is_ok()
}

/// Says what the text needs where it is a dialect naga does not read at all, as its own message seldom does.
fn hint(text: &str) -> Option<&'static str> {
    let has = |word: &str| text.contains(word);
    if has("#version 300 es") || has("#version 310 es") || has("#version 100") {
        return Some(
            "GLSL ES is not read: translate it to `#version 450` with explicit locations and bindings, or to WGSL",
        );
    }
    if has("#include") {
        return Some("`#include` is not read: paste the file in");
    }
    if has("uniform sampler2D") || has("uniform samplerCube") {
        return Some(
            "combined samplers are not read: declare a `texture2D` and a `sampler`, and write `texture(sampler2D(t, s), uv)`",
        );
    }
    if has("gl_FragColor") || has("varying ") || has("attribute ") {
        return Some(
            "this is GLSL of the 1.x kind: write `#version 450` with `in`, `out` and explicit locations",
        );
    }
    if has("gl_VertexID") || has("gl_InstanceID") {
        return Some("Vulkan's names are read: `gl_VertexIndex`, `gl_InstanceIndex`");
    }
    None
}
