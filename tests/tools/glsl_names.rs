//! GLSL out keeps the author's own names for whatever an engine sees of a program: uniforms outside
//! of blocks, blocks, samplers, attributes, outputs.

use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::{self, Target};
use preshade_plan::state::MaterialState;
use shader_text::files::File;
use shader_text::options;

use crate::accept;

fn emitted(name: &str, vertex: &str, fragment: &str) -> Vec<File> {
    emitted_for(
        name,
        vertex,
        fragment,
        &[Target::Glsl450, Target::GlslEs300],
    )
}

fn emitted_for(name: &str, vertex: &str, fragment: &str, targets: &[Target]) -> Vec<File> {
    let sources = [
        Source::new(format!("{name}.vert"), vertex),
        Source::new(format!("{name}.frag"), fragment),
    ];
    let parsed = front::parse(&sources, &options::Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
    let plan = Plan::original(
        name,
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    );
    let mut files = Vec::new();
    for target in targets {
        match emit::emit(&plan, &[*target], &emit::Options::default()) {
            Ok(emitted) => files.extend(emitted),
            // GLSL ES 3.00 has none of them.
            Err(emit::EmitError::Inexpressible { what, .. })
                if [
                    "arrays of arrays",
                    "textureGather",
                    "`layout(origin_upper_left)`",
                ]
                .contains(&what.as_str()) => {}
            Err(e) => panic!("{e}"),
        }
    }
    files
}

fn dialect(name: &str) -> Vec<File> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/glsl/dialects");
    let read = |e: &str| std::fs::read_to_string(folder.join(format!("{name}.{e}"))).unwrap();
    emitted(name, &read("vert"), &read("frag"))
}

fn text<'a>(files: &'a [File], name: &str) -> &'a str {
    let file = files.iter().find(|f| f.name == name);
    std::str::from_utf8(&file.unwrap().bytes).unwrap()
}

#[test]
fn a_struct_of_samplers_and_numbers_is_one_uniform_again() {
    let files = dialect("gl330-material");
    insta::assert_snapshot!(
        "material_es_frag",
        text(&files, "gl330-material.main.es.frag")
    );
    insta::assert_snapshot!("material_vert", text(&files, "gl330-material.main.vert"));
    accept::accept(&[("material".to_owned(), files)]);
}

#[test]
fn every_dialect_goes_out_again() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/glsl/dialects");
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .filter_map(|e| {
            e.unwrap()
                .file_name()
                .into_string()
                .unwrap()
                .strip_suffix(".vert")
                .map(str::to_owned)
        })
        .collect();
    names.sort();
    let sets: Vec<(String, Vec<File>)> = names.iter().map(|n| (n.clone(), dialect(n))).collect();
    if let Ok(dir) = std::env::var("DUMP") {
        for (_, files) in &sets {
            for f in files {
                std::fs::write(std::path::Path::new(&dir).join(&f.name), &f.bytes).unwrap();
            }
        }
    }
    let judged = accept::accept(&sets);
    // All but three in two dialects, two stages each.
    assert_eq!(judged.glsl, 4 * names.len() - 6);
}

const VERTEX: &str = "#version 300 es
precision highp float;
layout(location = 2) in vec3 position;
in vec3 normal;
in vec2 uv1;
in mat4 instanceMatrix;
uniform mat4 modelViewMatrix, projectionMatrix;
uniform mat3 normalMatrix;
uniform mat2 uvTransform;
uniform float weights[3];
uniform bool flipped;
layout(std140) uniform Wind { vec4 strength; float gusts[4]; };
layout(std140) uniform Camera { mat4 view; vec3 eye2; } camera;
out vec2 vUv;
out vec3 vNormal;
flat out ivec2 vId;
out vec4 color;
void main() {
    vUv = uvTransform * uv1 * weights[1] + vec2(weights[gl_VertexID % 3]);
    vNormal = normalMatrix * normal;
    if (flipped) vNormal = -vNormal;
    vId = ivec2(gl_VertexID, 3);
    color = strength * gusts[2] + vec4(camera.eye2, 1.0);
    gl_Position = projectionMatrix * modelViewMatrix * camera.view * instanceMatrix * \
        vec4(position, 1.0);
}
";

const FRAGMENT: &str = "#version 300 es
precision highp float;
precision highp sampler2DShadow;
struct Layer { sampler2D map; vec2 offset; };
struct Lamp { vec3 color1; float on; };
struct Probe { samplerCube sky; };
uniform sampler2D maps[3];
uniform Layer layers[2];
uniform Lamp lamp;
uniform Probe probe;
uniform highp sampler2DShadow shadowMap;
uniform highp sampler2DArray stack;
uniform vec3 light2;
uniform bvec3 channels;
layout(std140) uniform Wind { vec4 strength; float gusts[4]; };
in vec2 vUv;
in vec3 vNormal;
flat in ivec2 vId;
in vec4 color;
layout(location = 0) out vec4 outColor;
layout(location = 1) out vec3 outNormal;
vec4 read(sampler2D from, vec2 at) { return texture(from, at); }
void main() {
    vec4 sum = read(maps[1], vUv) + read(maps[2], vUv) + texture(layers[0].map, vUv + \
        layers[1].offset);
    sum *= texture(probe.sky, vNormal) + texture(shadowMap, vec3(vUv, 0.5)) + texture(stack, \
        vec3(vUv, 1.0));
    Lamp copy = lamp;
    if (channels.y && all(channels)) sum.rgb *= copy.color1 * copy.on;
    outColor = sum * color + strength + float(vId.x);
    outNormal = normalize(vNormal) * light2;
}
";

#[test]
fn what_an_engine_asks_for_by_name_is_there() {
    let files = emitted("engine", VERTEX, FRAGMENT);
    let vertex = text(&files, "engine.main.es.vert");
    for line in [
        "layout(location = 2) in vec3 position;",
        "\nin vec3 normal;",
        "\nin vec2 uv1;",
        "\nin mat4 instanceMatrix;",
        "uniform mat4x4 modelViewMatrix;",
        "uniform mat3x3 normalMatrix;",
        "uniform mat2x2 uvTransform;",
        "uniform float weights[3];",
        "uniform bool flipped;",
        "uniform Wind {\n    vec4 strength;",
        "uniform Camera {\n    mat4x4 view;\n    vec3 eye2;\n} camera;",
        "smooth out vec2 vUv;",
        "flat out ivec2 vId;",
        "out vec4 color;",
    ] {
        assert!(vertex.contains(line), "{line}\n{vertex}");
    }
    let fragment = text(&files, "engine.main.es.frag");
    for line in [
        "uniform highp sampler2D maps[3];",
        "uniform Layer_1 layers[2];",
        "    highp sampler2D map;\n",
        "uniform Lamp lamp;",
        "    vec3 color1;\n",
        "uniform Probe probe;",
        "    highp samplerCube sky;\n",
        "uniform highp sampler2DShadow shadowMap;",
        "uniform highp sampler2DArray stack;",
        "uniform vec3 light2;",
        "uniform bvec3 channels;",
        "smooth in vec2 vUv;",
        "layout(location = 0) out vec4 outColor;",
        "layout(location = 1) out vec4 outNormal;",
        "texture(probe.sky, ",
        "read(maps[2], ",
    ] {
        assert!(fragment.contains(line), "{line}\n{fragment}");
    }
    insta::assert_snapshot!("engine_es_vert", vertex);
    insta::assert_snapshot!("engine_es_frag", fragment);
    let plan: serde_json::Value = serde_json::from_str(text(&files, "engine.plan.json")).unwrap();
    insta::assert_json_snapshot!("engine_files", plan["files"]);
    accept::accept(&[("engine".to_owned(), files)]);
}

/// An author's names may be words of the language written, or of ours.
#[test]
fn names_that_cannot_stay_say_so() {
    let vertex = "attribute vec3 color;
        uniform vec3 texture, sum, location, sample_1;
        varying vec3 normal;
        vec3 pow2(vec3 gl) { vec3 sum = gl; return sum * gl; }
        void main() { vec3 color_1 = color; normal = pow2(color_1) + texture + sum + sample_1; \
            gl_Position = vec4(location, 1.0); }";
    let fragment = "precision mediump float;
        uniform sampler2D normal_1;
        uniform vec3 texture;
        varying vec3 normal;
        void main() { vec3 sum = normal; gl_FragColor = texture2D(normal_1, sum.xy) + \
            vec4(texture, 1.0); }";
    let files = emitted("words", vertex, fragment);
    insta::assert_snapshot!("words_es_vert", text(&files, "words.main.es.vert"));
    insta::assert_snapshot!("words_es_frag", text(&files, "words.main.es.frag"));
    accept::accept(&[("words".to_owned(), files)]);
}

fn of_wgsl(name: &str, text: &str) -> Vec<File> {
    let parsed = front::parse(
        &[Source::new(format!("{name}.wgsl"), text)],
        &options::Options::default(),
    );
    let parsed =
        parsed.unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
    let fragment = parsed.fragment.as_deref();
    let state = MaterialState::default();
    let plan = Plan::original(name, parsed.program, &parsed.vertex, fragment, &state);
    let targets = [Target::Glsl450, Target::GlslEs300];
    let files = targets.map(|t| emit::emit(&plan, &[t], &emit::Options::default()));
    let files = files.map(|f| f.unwrap_or_else(|e| panic!("{e}")));
    files.concat()
}

/// GLSL combines a texture with one sampler, WGSL with as many as one likes: also over stages,
/// which share a uniform by its name.
#[test]
fn a_texture_with_several_samplers_is_a_uniform_for_each() {
    let wgsl = "
@group(0) @binding(0) var map: texture_2d<f32>;
@group(0) @binding(1) var nearest: sampler;
@group(0) @binding(2) var linear: sampler;
@group(0) @binding(3) var other: texture_2d<f32>;
struct Varyings { @builtin(position) at: vec4<f32>, @location(0) uv: vec2<f32> }
fn height(uv: vec2<f32>) -> f32 { return textureSampleLevel(map, linear, uv, 0.0).x; }
@vertex fn vertex(@location(0) position: vec3<f32>) -> Varyings {
    return Varyings(vec4(position.x, position.y + height(position.xz), position.z, 1.0), \
        position.xy);
}
@fragment fn fragment(in: Varyings) -> @location(0) vec4<f32> {
    var sum = textureSample(map, nearest, in.uv) + textureSample(other, linear, in.uv);
    if sum.x > 0.5 {
        sum += textureSampleLevel(map, linear, in.uv, 1.0);
    }
    return sum;
}
";
    let files = of_wgsl("twins", wgsl);
    let fragment = text(&files, "twins.main.frag");
    insta::assert_snapshot!("twins_frag", fragment);
    insta::assert_snapshot!("twins_es_vert", text(&files, "twins.main.es.vert"));
    let plan: serde_json::Value = serde_json::from_str(text(&files, "twins.plan.json")).unwrap();
    insta::assert_json_snapshot!("twins_files", plan["files"]);
    // A function that is given both stays refused.
    let given = wgsl
        .replace(
            "fn height(uv",
            "fn height(map: texture_2d<f32>, linear: sampler, uv",
        )
        .replace("height(position", "height(map, linear, position");
    let sources = [Source::new("given.wgsl", given)];
    let parsed = front::parse(&sources, &options::Options::default()).unwrap();
    let fragment = parsed.fragment.as_deref();
    let state = MaterialState::default();
    let plan = Plan::original("given", parsed.program, &parsed.vertex, fragment, &state);
    let error = emit::emit(&plan, &[Target::Glsl450], &emit::Options::default())
        .err()
        .unwrap();
    assert!(error.to_string().contains("two samplers"), "{error}");
    accept::accept(&[("twins".to_owned(), files)]);
}

/// Each file has the functions of its own stage.
#[test]
fn a_stage_has_its_own_functions() {
    let vertex = "attribute vec3 p; uniform float t; float sway(float x) { \
                  return sin(x + t); } void main() { gl_Position = vec4(p + sway(p.x), 1.0); }";
    let fragment = "precision mediump float; uniform vec3 c; vec3 shade(vec3 x) { \
                    return x * c; } void main() { gl_FragColor = vec4(shade(vec3(0.5)), 1.0); }";
    let files = emitted("own", vertex, fragment);
    for (file, own, other) in [
        ("own.main.es.vert", "float sway(", "shade"),
        ("own.main.es.frag", "vec3 shade(", "sway"),
        ("own.main.vert", "float sway(", "shade"),
        ("own.main.frag", "vec3 shade(", "sway"),
    ] {
        let text = text(&files, file);
        assert!(text.contains(own) && !text.contains(other), "{text}");
    }
    accept::accept(&[("own".to_owned(), files)]);
}

const NUMBERED_VERTEX: &str = "#version 450
layout(location = 3) in vec3 position;
layout(location = 1) in mat2 turn;
in vec2 unnumbered;
layout(std140, binding = 2) uniform Camera { mat4 view; } camera;
layout(location = 5) out vec2 uv;
void main() { uv = turn * unnumbered; gl_Position = camera.view * vec4(position, 1.0); }
";

const NUMBERED_FRAGMENT: &str = "#version 450
layout(location = 5) in vec2 uv;
layout(binding = 2) uniform sampler2D map;
layout(binding = 4) uniform sampler2D maps[2];
uniform sampler2D first;
layout(std140, binding = 7) uniform Tints { vec4 tints[2]; };
uniform Free { vec4 free; };
layout(std430, binding = 2) readonly buffer Lights { vec4 lights[]; };
layout(location = 9) uniform vec4 tint;
layout(location = 1) out vec4 color;
void main() {
    color = texture(map, uv) + texture(maps[1], uv) + texture(first, uv) + tints[1] + free + \
        lights[2] + tint;
}
";

/// What the author numbered is bound by number.
#[test]
fn numbers_are_the_authors() {
    let (vertex, fragment) = (NUMBERED_VERTEX, NUMBERED_FRAGMENT);
    let files = emitted_for("numbered", vertex, fragment, &[Target::Glsl450]);
    let vertex = text(&files, "numbered.main.vert");
    for line in [
        "layout(location = 3) in vec3 position;",
        "layout(location = 1) in mat2 turn;",
        "\nin vec2 unnumbered;",
        "layout(std140, binding = 2) uniform Camera {",
        "layout(location = 5) smooth out vec2 uv;",
    ] {
        assert!(vertex.contains(line), "{line}\n{vertex}");
    }
    let fragment = text(&files, "numbered.main.frag");
    for line in [
        "layout(location = 5) smooth in vec2 uv;",
        "layout(binding = 2) uniform sampler2D map;",
        "layout(binding = 4) uniform sampler2D maps[2];",
        "layout(binding = 0) uniform sampler2D first;",
        "layout(std140, binding = 7) uniform Tints {",
        "layout(std140, binding = 0) uniform Free {",
        "layout(std430, binding = 2) readonly buffer Lights {",
        "layout(location = 9) uniform vec4 tint;",
        "layout(location = 1) out vec4 color;",
    ] {
        assert!(fragment.contains(line), "{line}\n{fragment}");
    }
    let plan: plan_file::PlanFile =
        serde_json::from_str(text(&files, "numbered.plan.json")).unwrap();
    let said = &plan.files[0].fragment[&Target::Glsl450];
    let units: Vec<_> = said
        .textures
        .iter()
        .map(|t| (t.name.as_str(), t.unit))
        .collect();
    let expected = [("first", Some(0)), ("map", Some(2)), ("maps[1]", Some(5))];
    assert_eq!(units, expected);
    let mut slots: Vec<_> = said
        .blocks
        .iter()
        .map(|b| (b.block.as_str(), b.slot))
        .collect();
    slots.sort_unstable();
    let expected = [("Free", Some(0)), ("Lights", Some(2)), ("Tints", Some(7))];
    assert_eq!(slots, expected);
    assert_eq!(said.uniforms[0].location, Some(9));
    accept::accept(&[("numbered".to_owned(), files)]);
}

/// Of Vulkan's GLSL, which naga reads as it is, the numbers stay too; OpenGL has no sets, so that
/// what those alone tell apart gets the next number that is free.
#[test]
fn numbers_of_what_is_read_as_it_is_stay() {
    let vertex = "#version 450
layout(location = 0) in vec3 position;
layout(set = 0, binding = 3) uniform Camera { mat4 view; } camera;
void main() { gl_Position = camera.view * vec4(position, 1.0); }
";
    let fragment = "#version 450
layout(set = 0, binding = 6) uniform texture2D map;
layout(set = 0, binding = 7) uniform sampler map_sampler;
layout(set = 1, binding = 3) uniform Tint { vec4 tint; } tinted;
layout(location = 0) out vec4 color;
void main() { color = texture(sampler2D(map, map_sampler), vec2(0.5)) * tinted.tint; }
";
    let files = emitted("sets", vertex, fragment);
    let found = text(&files, "sets.main.vert");
    assert!(found.contains("binding = 3) uniform"), "{found}");
    let found = text(&files, "sets.main.frag");
    assert!(
        found.contains("layout(binding = 6) uniform sampler2D map;"),
        "{found}"
    );
    assert!(found.contains("binding = 0) uniform"), "{found}");
    accept::accept(&[("sets".to_owned(), files)]);
}

/// Floats come back to their bits by any compiler: the largest is no infinity, the smallest no
/// zero.
#[test]
fn floats_are_written_with_all_their_digits() {
    let fragment = "#version 450
layout(location = 0) in vec2 uv;
layout(location = 0) out vec4 color;
void main() {
    float nearest = min(uv.x, 3.402823466e+38) + max(uv.y, -3.402823466e+38);
    color = vec4(nearest, uv.x * 1.401298464e-45, uv.y + 1.175494351e-38, uv.x * -0.0 + 16777217.0);
}
";
    let vertex = "#version 450
layout(location = 0) in vec3 position;
layout(location = 0) out vec2 uv;
void main() { uv = position.xy; gl_Position = vec4(position, 1.0); }
";
    let files = emitted("floats", vertex, fragment);
    for name in ["floats.main.frag", "floats.main.es.frag"] {
        let text = text(&files, name);
        assert!(!text.contains("3.4028235e38"), "{text}");
        for number in [
            "3.40282346e38",
            "1e-45",
            "1.1754944e-38",
            "-0.0",
            "16777216.0",
        ] {
            assert!(text.contains(number), "{number}\n{text}");
        }
    }
    accept::accept(&[("floats".to_owned(), files)]);
    let of = of_wgsl_text(vertex, fragment);
    assert!(
        of.contains("3.40282346e38f") && of.contains("1e-45f"),
        "{of}"
    );
    let errors = accept::tint_says(std::slice::from_ref(&of));
    assert!(errors[0].is_empty(), "{errors:?}\n{of}");
}

/// A pair as WGSL.
fn of_wgsl_text(vertex: &str, fragment: &str) -> String {
    let sources = [
        Source::new("m.vert", vertex),
        Source::new("m.frag", fragment),
    ];
    let parsed = front::parse(&sources, &options::Options::default()).unwrap();
    let state = MaterialState::default();
    let (vertex, fragment) = (&parsed.vertex, parsed.fragment.as_deref());
    let plan = Plan::original("m", parsed.program, vertex, fragment, &state);
    let files = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
    text(&files, "m.main.wgsl").to_owned()
}
