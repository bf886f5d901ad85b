//! GLSL out keeps the author's own names for whatever an engine sees of a program: uniforms outside of blocks, blocks, samplers, attributes, outputs.
#![cfg(all(feature = "glsl", feature = "spirv"))]
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

#[path = "accept/mod.rs"]
mod accept;

use preshade::emit::{self, File, Target};
use preshade::front::{self, Source};
use preshade_passes::plan::Plan;
use preshade_passes::state::MaterialState;

fn emitted(name: &str, vertex: &str, fragment: &str) -> Vec<File> {
    let sources = [
        Source::new(format!("{name}.vert"), vertex),
        Source::new(format!("{name}.frag"), fragment),
    ];
    let parsed = front::parse(&sources, &front::Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(front::Color::Never)));
    let plan = Plan::original(
        name,
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    );
    let mut files = Vec::new();
    for target in [Target::Glsl450, Target::GlslEs300] {
        match emit::emit(&plan, &[target], &emit::Options::default()) {
            Ok(emitted) => files.extend(emitted),
            // GLSL ES 3.00 has neither.
            Err(emit::Error::Inexpressible { what, .. })
                if ["arrays of arrays", "textureGather"].contains(&what.as_str()) => {}
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
    // All but two in two dialects, two stages each.
    assert_eq!(judged.glsl, 4 * names.len() - 4);
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
    gl_Position = projectionMatrix * modelViewMatrix * camera.view * instanceMatrix * vec4(position, 1.0);
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
    vec4 sum = read(maps[1], vUv) + read(maps[2], vUv) + texture(layers[0].map, vUv + layers[1].offset);
    sum *= texture(probe.sky, vNormal) + texture(shadowMap, vec3(vUv, 0.5)) + texture(stack, vec3(vUv, 1.0));
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
        void main() { vec3 color_1 = color; normal = pow2(color_1) + texture + sum + sample_1; gl_Position = vec4(location, 1.0); }";
    let fragment = "precision mediump float;
        uniform sampler2D normal_1;
        uniform vec3 texture;
        varying vec3 normal;
        void main() { vec3 sum = normal; gl_FragColor = texture2D(normal_1, sum.xy) + vec4(texture, 1.0); }";
    let files = emitted("words", vertex, fragment);
    insta::assert_snapshot!("words_es_vert", text(&files, "words.main.es.vert"));
    insta::assert_snapshot!("words_es_frag", text(&files, "words.main.es.frag"));
    accept::accept(&[("words".to_owned(), files)]);
}

fn of_wgsl(name: &str, text: &str) -> Vec<File> {
    let parsed = front::parse(
        &[Source::new(format!("{name}.wgsl"), text)],
        &front::Options::default(),
    );
    let parsed = parsed.unwrap_or_else(|e| panic!("{}", e.render(front::Color::Never)));
    let fragment = parsed.fragment.as_deref();
    let state = MaterialState::default();
    let plan = Plan::original(name, parsed.program, &parsed.vertex, fragment, &state);
    let targets = [Target::Glsl450, Target::GlslEs300];
    let files = targets.map(|t| emit::emit(&plan, &[t], &emit::Options::default()));
    let files = files.map(|f| f.unwrap_or_else(|e| panic!("{e}")));
    files.concat()
}

/// GLSL combines a texture with one sampler, WGSL with as many as one likes: also over stages, which share a uniform by its name.
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
    return Varyings(vec4(position.x, position.y + height(position.xz), position.z, 1.0), position.xy);
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
    let parsed = front::parse(&sources, &front::Options::default()).unwrap();
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
    let vertex = "attribute vec3 p; uniform float t; float sway(float x) { return sin(x + t); } void main() { gl_Position = vec4(p + sway(p.x), 1.0); }";
    let fragment = "precision mediump float; uniform vec3 c; vec3 shade(vec3 x) { return x * c; } void main() { gl_FragColor = vec4(shade(vec3(0.5)), 1.0); }";
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
