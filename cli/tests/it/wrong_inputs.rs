//! What is given in place of a material is named as what it is, with what to do instead.

use std::fs;
use std::path::{Path, PathBuf};

use crate::hostile_support::{accepted, ended, refused, run};

const VERTEX: &str = "@vertex fn vs(@location(0) p: vec3f) -> @builtin(position) vec4f { return \
                      vec4f(p, 1.0); }\n";

fn here(name: &str, files: &[(&str, &[u8])]) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("wrong-inputs")
        .join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    for (file, bytes) in files {
        fs::write(folder.join(file), bytes).unwrap();
    }
    folder
}

/// A file, and what is said of it.
type Case = (&'static str, &'static str, &'static [&'static str]);

const CASES: &[Case] = &[
    (
        "a.hlsl",
        "float4 main() : SV_Target { return 1; }",
        &["[foreign]", "is HLSL", "slangc"],
    ),
    (
        "a.frag",
        "cbuffer C : register(b0) { float4 c; };\nfloat4 main() : SV_Target { return c; }",
        &["is HLSL", "read as GLSL: unexpected identifier `cbuffer`"],
    ),
    (
        "a.slang",
        "cbuffer C { float4 c; };\n[shader(\"fragment\")] float4 fs() : SV_Target { return c; }",
        &["is Slang", "slangc -target spirv"],
    ),
    (
        "a.metal",
        "#include <metal_stdlib>\n",
        &["Metal's shading language"],
    ),
    (
        "a.gdshader",
        "shader_type spatial;\n",
        &["Godot's shading language"],
    ),
    ("a.obj", "{}", &["is a mesh", "docs/reference/scenes.md"]),
    (
        "a.sc",
        "$input v_uv\n#include <bgfx_shader.sh>\nvoid main() {}\n",
        &["is a shader of bgfx", "shaderc"],
    ),
    (
        "a.mat",
        "material { name : a }\nfragment { void material(inout MaterialInputs material) {} }\n",
        &["is a material of Filament", "matc"],
    ),
    (
        "both.frag",
        "#ifdef VERTEX\nvoid main() {}\n#endif\n#ifdef FRAGMENT\nvoid main() {}\n#endif\n",
        &["both stages", "defines the macro"],
    ),
    (
        "toy.frag",
        "void mainImage(out vec4 c, in vec2 p) { c = vec4(p / iResolution.xy, 0.0, 1.0); }",
        &["for Shadertoy", "void main()"],
    ),
    (
        "effect.frag",
        "void mainImage(const in vec4 inputColor, const in vec2 uv, out vec4 outputColor) { \
         outputColor = inputColor; }",
        &[
            "npm package postprocessing",
            "mainImage(texture(inputBuffer, vUv), vUv, color)",
        ],
    ),
    (
        "depth.frag",
        "void mainImage(const in vec4 inputColor, const in vec2 uv, const in float depth, out vec4 \
         outputColor) { outputColor = inputColor * depth; }",
        &[
            "npm package postprocessing",
            "texture(depthBuffer, vUv).r, color)",
        ],
    ),
    (
        "phong.glsl.js",
        "export default /* glsl */`\nvoid main() { gl_Position = vec4(0.0); }\n`;\n",
        &["is JavaScript", "between the backticks"],
    ),
    (
        "phong.vert",
        "export default /* glsl */`\nvoid main() { gl_Position = vec4(0.0); }\n`;\n",
        &["is JavaScript", "between the backticks"],
    ),
    (
        "lost.frag",
        "#include \"noise.glsl\"\nvoid main() {}",
        &["there is no file noise.glsl", "--include DIR"],
    ),
    (
        "chunk.frag",
        "void main() { gl_FragColor = vec4(1.0);\n#include <tonemapping_fragment>\n}",
        &["three.js", "docs/guides/three-js.md"],
    ),
    (
        "three.vert",
        "varying vec2 v;\nvoid main() { v = uv; gl_Position = projectionMatrix * modelViewMatrix * \
         vec4(position, 1.0); }",
        &["three.js", "read as GLSL: `uv` is not declared"],
    ),
    (
        "bevy.wgsl",
        "#import bevy_pbr::forward_io::VertexOutput\n@fragment fn fs(in: VertexOutput) -> \
         @location(0) vec4f { return in.position; }",
        &[
            "there is no module `bevy_pbr::forward_io`",
            "bevy.wgsl:1:1",
            "--include",
            "docs/reference/wgsl-dialects.md",
        ],
    ),
    (
        "group.wgsl",
        "@group(#{MATERIAL_BIND_GROUP}) @binding(0) var<uniform> tint: vec4f;\n@fragment fn fs() \
         -> @location(0) vec4f { return tint; }",
        &[
            "`MATERIAL_BIND_GROUP` is not defined",
            "--define MATERIAL_BIND_GROUP=3",
        ],
    ),
    (
        "wesl.wgsl",
        "import shared::light::lit;\n@fragment fn fs() -> @location(0) vec4f { return lit(); }",
        &["there is no module `shared::light", "--include DIR"],
    ),
    (
        "compute.wgsl",
        "@compute @workgroup_size(64) fn main() {}",
        &["compute shaders are not materials, and `main` is one"],
    ),
    (
        "a.comp",
        "#version 450\nlayout(local_size_x = 64) in;\nvoid main() {}",
        &["is a compute,", "vertex and a fragment stage"],
    ),
    (
        "push.wgsl",
        "var<push_constant> color: vec4f;\n@fragment fn fs() -> @location(0) vec4f { return color; \
         }",
        &["write `var<immediate>`"],
    ),
    (
        "types.wgsl",
        "@fragment fn fs(@builtin(position) p: vec4f) -> @location(0) vec4f { if p < 1.0 { discard; \
         } return p; }",
        &["`<` can't work with (vec4<f32>) and (f32)"],
    ),
    (
        "clash.wgsl",
        "@group(0) @binding(0) var<uniform> a: vec4f;\n@group(0) @binding(0) var<uniform> b: \
         vec4f;\n@fragment fn fs() -> @location(0) vec4f { return a + b; }",
        &["one stage uses `a` and `b`, and both have group 0 binding 0"],
    ),
];

#[test]
fn what_is_no_material_is_named() {
    let folder = here("named", &[]);
    for (file, text, said) in CASES {
        // A vertex stage, so that nothing else is amiss.
        let text = match file.ends_with(".wgsl") && !text.contains("@compute") {
            true => format!("{text}\n{VERTEX}"),
            false => (*text).to_owned(),
        };
        fs::write(folder.join(file), text).unwrap();
        let told = refused(&folder, &["explain", file]);
        for part in *said {
            assert!(told.contains(part), "{file}: {part}: {told}");
        }
    }
}

/// An effect with what the message adds is a material.
#[test]
fn the_main_for_an_effect_compiles() {
    let vertex = "#version 300 es\nin vec3 position; out vec2 vUv;\n\
                  void main() { vUv = position.xy; gl_Position = vec4(position, 1.0); }\n";
    for (file, effect, _) in CASES
        .iter()
        .filter(|(_, text, _)| text.contains("inputColor"))
    {
        let effect = effect.as_bytes();
        let folder = here("effect", &[(file, effect), ("a.vert", vertex.as_bytes())]);
        let told = refused(&folder, &["explain", file]);
        let (_, remedy) = told.split_once("put `").unwrap();
        let [above, _, below, ..] = remedy.split('`').collect::<Vec<_>>()[..] else {
            panic!("{told}");
        };
        let effect = String::from_utf8_lossy(effect);
        let text = format!("{above}\n{effect}\n{below}\n");
        fs::write(folder.join(file), text).unwrap();
        accepted(&folder, &["explain", "a.vert", file]);
    }
}

#[test]
fn a_vertex_file_alone_is_not_drawn() {
    let vertex = "#version 300 es\nin vec3 position; out vec2 v;\n\
                  void main() { v = position.xy; gl_Position = vec4(position, 1.0); }\n";
    let folder = here("alone", &[("bricks.vert", vertex.as_bytes())]);
    let said = "error: bricks.vert has no fragment stage: give ";
    for command in ["verify", "plan", "explore"] {
        let told = refused(&folder, &[command, "bricks.vert"]);
        assert_eq!(told.trim_end(), format!("{said}its .frag too"));
    }
    fs::write(folder.join("bricks.frag"), "").unwrap();
    let told = refused(&folder, &["verify", "bricks.vert"]);
    assert_eq!(told.trim_end(), format!("{said}bricks.frag too"));
    accepted(&folder, &["explain", "bricks.vert"]);
}

#[test]
fn a_comment_makes_no_file_foreign() {
    let text = "// cbuffer, SV_Target and void mainImage( of the HLSL that this was\n@fragment fn";
    let folder = here("comment", &[("a.wgsl", text.as_bytes())]);
    let told = refused(&folder, &["explain", "a.wgsl"]);
    assert!(told.starts_with("error[parse]"), "{told}");
}

#[test]
fn utf16_is_read_and_binary_files_are_named() {
    let shader =
        format!("{VERTEX}@fragment fn fs() -> @location(0) vec4f {{ return vec4f(1.0); }}");
    let units = |mark: &str| -> Vec<u8> {
        let text = format!("{mark}{shader}");
        text.encode_utf16().flat_map(u16::to_le_bytes).collect()
    };
    let files: [(&str, &[u8]); 8] = [
        (
            "elf.wgsl",
            b"\x7fELF\x02\x01\x01\0\0\0\0\0\0\0\0\0\x03\0\x3e\0",
        ),
        ("note.wgsl", b"// later\n/* much later */\n"),
        ("empty.wgsl", b"\xef\xbb\xbf\n"),
        ("marked.wgsl", &units("\u{feff}")),
        ("unmarked.wgsl", &units("")),
        ("a.glb", b"glTF\x02\0\0\0\xff\xfe"),
        ("glb.wgsl", b"glTF\x02\0\0\0\xff\xfe"),
        ("a.spv", &[0x03, 0x02, 0x23, 0x07, 0xff]),
    ];
    let folder = here("bytes", &files);
    accepted(&folder, &["explain", "marked.wgsl"]);
    for (args, said) in [
        (
            ["explain", "unmarked.wgsl"],
            "UTF-16 without a byte order mark",
        ),
        (
            ["explain", "glb.wgsl"],
            "a glTF mesh: a scene file names it",
        ),
        (["explain", "a.glb"], "no glTF 2.0"),
        (["plan", "a.glb"], "no glTF 2.0"),
        (["explain", "a.spv"], "a.spv is no valid SPIR-V"),
        (["explain", "elf.wgsl"], "it is no text"),
        (["explain", "note.wgsl"], "note.wgsl has only comments"),
        (["explain", "empty.wgsl"], "empty.wgsl is empty"),
    ] {
        let told = refused(&folder, &args);
        assert!(told.contains(said), "{args:?}: {told}");
    }
}

#[test]
fn a_mistaken_command_line_is_understood() {
    let folder = here("words", &[("a.wgsl", VERTEX.as_bytes())]);
    for (args, said) in [
        (
            &["rewrite", "a.wgsl", "--depth-prepass"][..],
            "--pass depth-prepass",
        ),
        (
            &["rewrite", "a.wgsl", "--recipe", "hoist"],
            "--pass hoist --pass depth-prepass",
        ),
        (
            &["rewrite", "a.wgsl", "--pass", "prepass"],
            "did you mean `depth-prepass`?",
        ),
        (
            &["rewrite", "a.wgsl", "--pass", "hoist, depth-prepass"],
            "--pass hoist --pass depth-prepass",
        ),
        (&["optimize", "a.wgsl"], "`preshade plan` does that"),
        (
            &["rewrite", "a.wgsl", "a.wgsl", "--pass", "hoist"],
            "--out-dir",
        ),
    ] {
        let told = ended(&run(&folder, args), 2, args);
        assert!(told.contains(said), "{args:?}: {told}");
        assert!(
            !told.contains("a similar argument exists"),
            "{args:?}: {told}"
        );
    }
}
