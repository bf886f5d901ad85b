//! Names the language of a file that preshade cannot read: another language, or a part of a shader
//! that an engine completes.
//!
//! If no parser is tried, the file's ending decides. If one fails, words in the text decide. The
//! parser's error stays as a note, because such a word may also stand in a WGSL or GLSL file with a
//! mistake elsewhere.

use std::ops::Range;

use naga::Span;

use super::{Source, extension};
use shader_text::error::{Code, Error, NO_MAIN};
use shader_text::tokens::without_comments;

/// Something that is given in place of a material in WGSL or GLSL.
struct Foreign {
    /// Completes "the file is ..".
    is: &'static str,
    /// Endings of its files that no file of WGSL or GLSL has.
    endings: &'static [&'static str],
    /// Finds a word that WGSL and GLSL do not have, in text without comments. Gets the parser's
    /// message too.
    sign: fn(&str, &str) -> Option<Range<usize>>,
    remedy: &'static str,
}

/// The declarations that postprocessing adds to an effect whose `mainImage` gets these arguments.
macro_rules! effect_remedy {
    ($arguments:literal) => {
        concat!(
            "put `uniform sampler2D inputBuffer, depthBuffer; uniform vec2 resolution, texelSize; \
             uniform float cameraNear, cameraFar, aspect, time; in vec2 vUv; out vec4 color;` above \
             it and `void main() { mainImage(",
            $arguments,
            "); }` below it, and give a vertex stage that draws a triangle over the screen"
        )
    };
}

/// The first row that fits is named.
const ALL: [Foreign; 18] = [
    Foreign {
        is: "the text of a SPIR-V module, and preshade reads the module",
        endings: &["spvasm"],
        sign: |text, _| one_of(text, &["OpCapability ", "OpMemoryModel "]),
        remedy: "assemble it with `spirv-as`, and give the .spv file",
    },
    Foreign {
        is: "JavaScript, and preshade reads the shader alone",
        endings: &["js", "mjs", "cjs", "jsx", "ts", "tsx"],
        sign: |text, _| {
            text.contains('`').then_some(())?;
            let words = ["export default", "export const", "module.exports", "= `"];
            one_of(text, &words)
        },
        remedy: "give the text between the backticks, in a file that ends in .wgsl, .vert or \
                 .frag; where a library builds it, capture it: docs/guides/three-js.md",
    },
    Foreign {
        is: "Slang, which preshade does not read",
        endings: &[],
        sign: |text, _| one_of(text, &["[shader(\"", "ParameterBlock<", "__target_switch"]),
        remedy: "compile it with `slangc -target spirv`, and give the .spv files",
    },
    Foreign {
        is: "HLSL, which preshade does not read",
        endings: &["hlsl", "hlsli", "fx", "fxh"],
        sign: |text, _| {
            let words = [
                "cbuffer ",
                "SV_Position",
                "SV_POSITION",
                "SV_Target",
                "SV_TARGET",
                ": register(",
                "Texture2D<",
                "SamplerState ",
            ];
            one_of(text, &words)
        },
        remedy: "compile it to SPIR-V, with `dxc -spirv -T vs_6_0` or `slangc -target spirv`, and \
                 give the .spv files",
    },
    Foreign {
        is: "Metal's shading language, which preshade does not read",
        endings: &["metal", "msl"],
        sign: |text, _| {
            one_of(
                text,
                &["metal_stdlib", "using namespace metal", "[[stage_in]]"],
            )
        },
        remedy: "give the WGSL or GLSL that it was written from; spirv-cross and naga translate \
                 these to Metal, and nothing translates Metal back",
    },
    Foreign {
        is: "Unity's ShaderLab, which preshade does not read",
        endings: &["shader", "cginc"],
        sign: |text, _| one_of(text, &["SubShader", "CGPROGRAM", "HLSLPROGRAM"]),
        remedy: "give the GLSL that Unity compiles it to (\"Compile and show code\", GLES3)",
    },
    Foreign {
        is: "Godot's shading language, which preshade does not read",
        endings: &["gdshader", "gdshaderinc"],
        sign: |text, _| one_of(text, &["shader_type spatial", "shader_type canvas_item"]),
        remedy: "give the GLSL that Godot compiles it to",
    },
    Foreign {
        is: "Unreal's shader code, which preshade does not read",
        endings: &["usf", "ush"],
        sign: |_, _| None,
        remedy: "give WGSL or GLSL",
    },
    Foreign {
        is: "a compute, geometry, tessellation, mesh or ray tracing shader, and not a material",
        endings: &[
            "comp", "geom", "tesc", "tese", "mesh", "task", "rgen", "rchit", "rmiss",
        ],
        sign: |text, _| one_of(text, &["local_size_x"]),
        remedy: "a material has a vertex and a fragment stage: preshade moves work between these, \
                 and has nothing to move in other shaders",
    },
    Foreign {
        is: "a mesh",
        endings: &["glb", "gltf", "obj", "fbx", "stl", "usdz"],
        sign: |_, _| None,
        remedy: "write a scene file that names the mesh, the shader and a camera: \
                 docs/reference/scenes.md (meshes are glTF)",
    },
    Foreign {
        is: EFFECT,
        endings: &[],
        sign: |text, _| effect(text, 4),
        remedy: effect_remedy!(
            "texture(inputBuffer, vUv), vUv, texture(depthBuffer, vUv).r, color"
        ),
    },
    Foreign {
        is: EFFECT,
        endings: &[],
        sign: |text, _| effect(text, 3),
        remedy: effect_remedy!("texture(inputBuffer, vUv), vUv, color"),
    },
    Foreign {
        is: "a fragment shader for Shadertoy, which adds `main`, the uniforms and the vertex stage",
        endings: &[],
        sign: |text, _| one_of(text, &["void mainImage("]),
        remedy: "add `uniform vec3 iResolution; uniform float iTime; out vec4 color; void main() { \
                 mainImage(color, gl_FragCoord.xy); }`, and give a vertex stage that draws your \
                 mesh",
    },
    Foreign {
        is: "a part of three.js's GLSL: three.js adds the chunks, attributes and matrices when it \
             draws",
        endings: &[],
        sign: |text, message| {
            let of_three = |name: &&&str| message == format!("`{name}` is not declared");
            let undeclared = || THREE.iter().find(of_three);
            let matrix = ["projectionMatrix", "modelViewMatrix"];
            let mut read = matrix.iter().filter(|name| word(text, name).is_some());
            let is_three = read.any(|name| !text.contains(&format!("mat4 {name}")));
            chunk(text).or_else(|| word(text, undeclared().filter(|_| is_three)?))
        },
        remedy: "give the text that three.js compiles: `preshade.text(material)` of the package \
                 preshade-three returns it, and docs/guides/three-js.md shows how",
    },
    Foreign {
        is: "a shader of bgfx, whose compiler adds to it",
        endings: &["sc"],
        sign: |text, _| one_of(text, &["#include <bgfx_shader.sh>"]),
        remedy: "compile it with bgfx's `shaderc` for GLSL (`--platform linux -p 430`), and give the \
                 text that follows its header",
    },
    Foreign {
        is: "a material of Filament, whose compiler adds to it",
        endings: &["mat"],
        sign: |text, _| one_of(text, &["MaterialInputs material"]),
        remedy: "compile it with `matc`, and give the GLSL that `matinfo --print-glsl` prints",
    },
    Foreign {
        is: "both stages of a material in one file, told apart by a macro that is not defined",
        endings: &[],
        sign: |text, message| {
            (message == NO_MAIN).then_some(())?;
            let words = ["VERTEX", "FRAGMENT", "VERT", "FRAG", "PIXEL"];
            let tests = |line: &str| line.contains("#if") && words.iter().any(|w| line.contains(w));
            let line = text.lines().find(|line| tests(line))?;
            one_of(text, &[line])
        },
        remedy: "write a file for each stage, .vert and .frag, which defines the macro and includes \
                 this one",
    },
    Foreign {
        is: "written for push constants, and WGSL's `var<push_constant>` is now `var<immediate>`",
        endings: &[],
        sign: |text, _| one_of(text, &["var<push_constant>"]),
        remedy: "write `var<immediate>`, as naga and wgpu call it now",
    },
];

const EFFECT: &str = "an effect of the npm package postprocessing, which adds `main`, the \
                      uniforms and the vertex stage";

/// The call of `mainImage` in an effect with so many parameters.
fn effect(text: &str, parameters: usize) -> Option<Range<usize>> {
    let start = text.find("void mainImage(")?;
    let inside = &text[start..];
    let inside = &inside[..inside.find(')')?];
    let is_effect = inside.contains("vec4 inputColor") && inside.contains("out vec4");
    let count = inside.split(',').count();
    (is_effect && count == parameters).then(|| start..start + "void mainImage".len())
}

/// Names that three.js declares for a `ShaderMaterial`.
const THREE: [&str; 12] = [
    "position",
    "normal",
    "uv",
    "color",
    "tangent",
    "modelMatrix",
    "modelViewMatrix",
    "projectionMatrix",
    "viewMatrix",
    "normalMatrix",
    "cameraPosition",
    "instanceMatrix",
];

/// The first of these words in the text.
fn one_of(text: &str, words: &[&str]) -> Option<Range<usize>> {
    let places = words.iter().filter_map(|word| {
        let start = text.find(word)?;
        Some(start..start + word.trim_end().len())
    });
    places.min_by_key(|range| range.start)
}

/// The first place where `name` is a whole word.
fn word(text: &str, name: &str) -> Option<Range<usize>> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let mut all = text.match_indices(name);
    let whole = |(at, _): &(usize, &str)| {
        !text[..*at].ends_with(is_part) && !text[at + name.len()..].starts_with(is_part)
    };
    let (start, _) = all.find(whole)?;
    Some(start..start + name.len())
}

/// `#include <name>`, with a name that is no file's.
fn chunk(text: &str) -> Option<Range<usize>> {
    let mut all = text.match_indices("#include <");
    all.find_map(|(start, found)| {
        let rest = &text[start + found.len()..];
        let name = &rest[..rest.find(['>', '\n'])?];
        let is_chunk = !name.is_empty() && !name.contains(['.', '/']);
        is_chunk.then(|| start..start + found.len() + name.len() + 1)
    })
}

/// The error, or a better one if a source is recognised as something else. `bases`: where each
/// source begins in the error's source map.
pub(super) fn named(error: Error, sources: &[Source], bases: &[u32]) -> Error {
    let tried = matches!(
        error.code(),
        Code::Parse | Code::Invalid | Code::NoEntryPoint | Code::TooDeep
    );
    let untried = matches!(error.code(), Code::UnknownLanguage | Code::UnknownStage);
    let mut all = sources.iter().zip(bases);
    let found = all.find_map(|(source, base)| {
        let ending = extension(&source.name).map(str::to_ascii_lowercase);
        let ends =
            |f: &&Foreign| untried && ending.as_deref().is_some_and(|e| f.endings.contains(&e));
        if let Some(foreign) = ALL.iter().find(ends) {
            return Some((source, foreign, None));
        }
        if (!tried && !untried) || source.language() == Some(shader_text::source::Language::SpirV) {
            return None;
        }
        let text = without_comments(&source.text);
        ALL.iter().find_map(|foreign| {
            let at = (foreign.sign)(&text, error.message())?;
            let span = Span::new(base + at.start as u32, base + at.end as u32);
            Some((source, foreign, Some(span)))
        })
    });
    let Some((source, foreign, span)) = found else {
        return error;
    };
    let better = Error::new(Code::Foreign, format!("{} is {}", source.name, foreign.is))
        .label_if(span)
        .note(foreign.remedy);
    match tried {
        true => better.note(format!("read as {}: {error}", language(source))),
        false => better,
    }
}

fn language(source: &Source) -> &'static str {
    match source.language() {
        Some(shader_text::source::Language::Wgsl) => "WGSL",
        Some(shader_text::source::Language::Glsl) => "GLSL",
        Some(shader_text::source::Language::SpirV) => "SPIR-V",
        None => "text",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_is_whole() {
        assert_eq!(word("uv2 = my_uv; uv", "uv"), Some(13..15));
        assert_eq!(chunk("#include <a.glsl>\n#include <common>"), Some(18..35));
    }
}
