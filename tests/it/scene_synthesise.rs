//! A bare shader gets a scene by reflection that can be drawn as it is.
#![cfg(feature = "verify")]

use std::path::{Path, PathBuf};

use preshade::unstable::front::{self, Options, Parsed, Source};
use preshade::unstable::passes::state::{DepthDirection, MaterialState};
use preshade::unstable::scene::bind::{self, DrawBindings};
use preshade::unstable::scene::{self, Scene};

fn parse(files: &[&str]) -> Parsed {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let sources: Vec<Source> = files
        .iter()
        .map(|f| Source::new(*f, std::fs::read_to_string(root.join(f)).unwrap()))
        .collect();
    front::parse(&sources, &Options::default()).unwrap_or_else(|e| panic!("{e}"))
}

fn bound(scene: &Scene) -> Vec<DrawBindings> {
    let plan = scene.materials[0].plan();
    let frame = &scene.cameras[0].frames[0];
    scene
        .draws
        .iter()
        .map(|d| {
            bind::draw(scene, &scene.materials[0], plan.main().unwrap(), d, frame)
                .unwrap_or_else(|e| panic!("{}: {e}", scene.name))
        })
        .collect()
}

fn single_files() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/shaders");
    let mut found: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "wgsl"))
        .collect();
    found.sort();
    found
}

#[test]
fn every_fixture_shader_gets_a_scene_whose_draws_bind() {
    let mut all: Vec<Parsed> = single_files()
        .iter()
        .map(|p| {
            parse(&[&format!(
                "shaders/{}",
                p.file_name().unwrap().to_string_lossy()
            )])
        })
        .collect();
    for name in ["phong", "cutout", "waves", "heat"] {
        all.push(parse(&[
            &format!("glsl/{name}.vert"),
            &format!("glsl/{name}.frag"),
        ]));
    }
    for parsed in all {
        let scene = scene::synthesise(parsed, MaterialState::default());
        let listed = scene.materials[0].plan().main().unwrap().bindings.len();
        assert_eq!(scene.orders.len(), 3);
        for b in bound(&scene) {
            assert_eq!(
                b.buffers.len() + b.textures.len() + b.samplers.len(),
                listed
            );
            assert!(b.instances > 0 && b.vertex_count > 0);
        }
    }
}

#[test]
fn shaders_that_make_their_own_vertices_get_as_many_as_they_have_in_mind() {
    let count = |file: &str| {
        let scene = scene::synthesise(parse(&[file]), MaterialState::default());
        let b = bound(&scene).remove(0);
        (b.indices.is_none(), b.vertex_count)
    };
    assert_eq!(count("shaders/fullscreen.wgsl"), (true, 3));
    assert_eq!(count("shaders/impostor.wgsl"), (true, 6));
    // It fetches the floor's 8 x 8 cells of two triangles itself.
    assert_eq!(count("shaders/vertex-pulling.wgsl"), (true, 8 * 8 * 6));
}

#[test]
fn a_buffer_of_indices_that_another_entry_point_reads_is_none_of_the_draws() {
    let text = "
struct Camera { view_proj: mat4x4<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read_write> indices: array<u32>;
@compute @workgroup_size(64) fn make(@builtin(global_invocation_id) id: vec3<u32>) { \
    indices[id.x] = id.x; }
@vertex fn vs(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> { \
    return camera.view_proj * vec4(position, 1.0); }
@fragment fn fs() -> @location(0) vec4<f32> { return vec4(1.0); }";
    let parsed = front::parse(&[Source::new("made.wgsl", text)], &Options::default()).unwrap();
    let scene = scene::synthesise(parsed, MaterialState::default());
    assert!(bound(&scene).iter().all(|b| b.indices.is_some()));
}

#[test]
fn a_scene_follows_the_state_it_is_drawn_with() {
    let state = MaterialState {
        depth_direction: DepthDirection::Reversed,
        ..MaterialState::default()
    };
    let scene = scene::synthesise(parse(&["shaders/textured.wgsl"]), state);
    assert_eq!(scene.name, "textured");
    assert_eq!(scene.depth_direction, DepthDirection::Reversed);
    let frame = &scene.cameras[0].frames[0];
    let near = frame
        .projection
        .project_point3(glam::Vec3::new(0.0, 0.0, -0.1));
    assert!((near.z - 1.0).abs() < 1e-5, "{near}");
}

#[test]
fn names_mean_what_authors_mean_by_them() {
    let scene = scene::synthesise(parse(&["shaders/textured.wgsl"]), MaterialState::default());
    let frame = &scene.cameras[0].frames[0];
    let draw = &bound(&scene)[3];
    let floats = |group: u32, binding: u32| -> Vec<f32> {
        let b = draw
            .buffers
            .iter()
            .find(|b| (b.group, b.binding) == (group, binding))
            .unwrap();
        b.data
            .bytes
            .chunks(4)
            .map(|c| f32::from_le_bytes(c.try_into().unwrap()))
            .collect()
    };
    // struct Camera { view_proj: mat4x4<f32>, position: vec3<f32> }
    let camera = floats(0, 0);
    let view_proj = frame.projection * frame.view;
    assert_eq!(camera[..16], view_proj.to_cols_array());
    assert_eq!(camera[16..19], frame.eye.to_array());
    // struct Light { direction, color, ambient }, each padded to 16 bytes.
    let light = floats(0, 1);
    assert_eq!(light[..3], scene.light.direction.to_array());
    assert_eq!(light[4..7], scene.light.color.to_array());
    let object = floats(1, 0);
    assert_eq!(object[..16], scene.draws[3].transform.to_cols_array());
}

fn written(files: &[(&str, &str)]) -> Scene {
    let sources: Vec<Source> = files.iter().map(|(n, t)| Source::new(*n, *t)).collect();
    let parsed = front::parse(&sources, &Options::default()).unwrap_or_else(|e| panic!("{e}"));
    scene::synthesise(parsed, MaterialState::default())
}

/// Two variables may have one binding, each for entry points of its own: what is bound is the one
/// that is read.
#[test]
fn variables_of_one_binding_are_told_apart() {
    let scene = written(&[(
        "two.wgsl",
        "@group(0) @binding(0) var<uniform> small: vec2<f32>;
@group(0) @binding(0) var<uniform> view_proj: mat4x4<f32>;
@fragment fn other() -> @location(0) vec4<f32> { return small.xyxy; }
@vertex fn vs(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> { \
    return view_proj * vec4(position, 1.0); }
",
    )]);
    let buffer = &bound(&scene)[0].buffers[0];
    assert_eq!(buffer.data.bytes.len(), 64);
}

/// Members of an unnamed block are called by their names alone.
#[test]
fn values_of_an_unnamed_block_are_found() {
    let mut scene = written(&[
        (
            "a.vert",
            "#version 450\nlayout(location = 0) in vec3 p;\n\
             void main() { gl_Position = vec4(p, 1.0); }\n",
        ),
        (
            "b.frag",
            "#version 450\nlayout(set = 0, binding = 0) uniform Look { vec4 tint; float steps; };\n\
             layout(location = 0) out vec4 color;\nvoid main() { color = tint * steps; }\n",
        ),
    ]);
    let steps = scene::Value::Numbers(vec![6.0]);
    scene.materials[0].values.insert("steps".to_owned(), steps);
    let bytes = &bound(&scene)[0].buffers[0].data.bytes;
    assert_eq!(bytes[16..20], 6_f32.to_le_bytes());
}
