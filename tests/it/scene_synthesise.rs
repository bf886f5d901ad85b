//! A bare shader gets a scene by reflection that can be drawn as it is.

use std::path::{Path, PathBuf};

use preshade_compiler::front::{self, Parsed, Source};
use preshade_draw::scene::bind::{self, DrawBindings};
use preshade_draw::scene::{self, Scene};
use preshade_plan::state::{DepthDirection, MaterialState};
use shader_text::options::Options;

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
        let scene = preshade_scenes::synthesise(parsed, MaterialState::default());
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
        let scene = preshade_scenes::synthesise(parse(&[file]), MaterialState::default());
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
    let scene = preshade_scenes::synthesise(parsed, MaterialState::default());
    assert!(bound(&scene).iter().all(|b| b.indices.is_some()));
}

#[test]
fn a_scene_follows_the_state_it_is_drawn_with() {
    let state = MaterialState {
        depth_direction: DepthDirection::Reversed,
        ..MaterialState::default()
    };
    let scene = preshade_scenes::synthesise(parse(&["shaders/textured.wgsl"]), state);
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
    let scene =
        preshade_scenes::synthesise(parse(&["shaders/textured.wgsl"]), MaterialState::default());
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
    preshade_scenes::synthesise(parsed, MaterialState::default())
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

/// The floats of a buffer in one draw.
fn floats(draw: &DrawBindings, group: u32, binding: u32) -> Vec<f32> {
    let is_it = |b: &&bind::BufferBinding| (b.group, b.binding) == (group, binding);
    let buffer = draw.buffers.iter().find(is_it).unwrap();
    let words = buffer.data.bytes.as_chunks::<4>().0.iter();
    words.map(|w| f32::from_le_bytes(*w)).collect()
}

/// An alpha-tested leaf without a single telling name.
const NAMELESS: &str = "
struct A { a: mat4x4<f32>, b: vec4<f32> }
struct B { c: vec4<f32>, d: f32, e: u32 }
@group(0) @binding(0) var<uniform> f: A;
@group(0) @binding(1) var<uniform> g: B;
@group(0) @binding(2) var h: texture_2d<f32>;
@group(0) @binding(3) var i: sampler;
struct C { @builtin(position) j: vec4<f32>, @location(0) k: vec2<f32>, @location(1) l: vec3<f32> }
fn m(n: vec3<f32>) -> vec4<f32> { return f.a * vec4(n, 1.0); }
@vertex fn vs(@location(0) o: vec2<f32>, @location(1) p: vec3<f32>, \
    @location(2) q: vec3<f32>) -> C {
    var r: C;
    r.j = m(q + p * sin(f.b.x) * 0.1);
    r.k = o;
    r.l = p;
    return r;
}
@fragment fn fs(s: C) -> @location(0) vec4<f32> {
    let t = textureSample(h, i, s.k) * g.c;
    if (g.e & 4u) != 0u {
        if t.a < g.d { discard; }
    }
    return vec4(t.rgb * normalize(s.l), t.a);
}";

#[test]
fn dataflow_tells_a_leafs_inputs_whatever_their_names() {
    let scene = written(&[("nameless.wgsl", NAMELESS)]);
    let material = &scene.materials[0];
    let stream = |name: &str| material.attributes[name].as_str();
    assert_eq!(
        [stream("q"), stream("o"), stream("p")],
        ["position", "uv", "normal"]
    );
    let value = |path: &str| material.values.get(path);
    let numbers = |n: f64| Some(scene::Value::Numbers(vec![n]));
    assert_eq!(
        value("f.a"),
        Some(&scene::Value::Semantic("mvp".to_owned()))
    );
    assert_eq!(value("g.d").cloned(), numbers(0.5));
    assert_eq!(value("g.e").cloned(), numbers(4.0));
    // The discard sees both kinds of fragments.
    let alphas: Vec<u8> = material.textures["h"].levels[0]
        .iter()
        .skip(3)
        .step_by(4)
        .copied()
        .collect();
    let holes = alphas.iter().filter(|a| **a < 128).count();
    assert!(
        holes * 10 > alphas.len() && holes * 10 < alphas.len() * 9,
        "{holes}"
    );
    // The one matrix takes each object to its own place.
    let draws = bound(&scene);
    let frame = &scene.cameras[0].frames[0];
    let expected = frame.projection * frame.view * scene.draws[3].transform;
    assert_eq!(floats(&draws[3], 0, 0)[..16], expected.to_cols_array());
    assert_ne!(floats(&draws[3], 0, 0)[..16], floats(&draws[4], 0, 0)[..16]);
    let said: Vec<String> = bind::guessed(&scene)
        .iter()
        .map(|g| format!("{} {}", g.name, g.guess))
        .collect();
    assert!(said.contains(&"g.d 0.5, by its use".to_owned()), "{said:?}");
    assert!(
        said.iter()
            .any(|s| s.starts_with("f.a $") && s.ends_with("by its use")),
        "{said:?}"
    );
}

/// The uniforms of a fragment stage, each with how it was guessed.
fn guesses_for(members: &str, body: &str) -> Vec<String> {
    let scene = written(&[(
        "m.wgsl",
        &format!(
            "struct M {{ {members} }}
@group(0) @binding(0) var<uniform> view_proj: mat4x4<f32>;
@group(0) @binding(1) var<uniform> m: M;
struct V {{ @builtin(position) at: vec4<f32>, @location(0) uv: vec2<f32> }}
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> V {{ \
    return V(view_proj * vec4(position, 1.0), uv); }}
fn parts(n: i32) -> f32 {{ return f32(n); }}
@fragment fn fs(in: V) -> @location(0) vec4<f32> {{ {body} }}
"
        ),
    )]);
    bound(&scene);
    let said = bind::guessed(&scene).into_iter();
    said.filter(|g| g.name.starts_with("m."))
        .map(|g| format!("{} {}", g.name, g.guess))
        .collect()
}

#[test]
fn no_divisor_is_0() {
    let said = guesses_for(
        "bands: i32, levels: vec2<u32>, cells: i32, density: f32, detail: f32, steps: i32, \
         displacement: array<vec4<f32>, 2>, resolution: vec2<f32>, mode: i32",
        "let d = floor(in.uv.x * parts(m.bands)) / parts(m.bands);
         let l = in.uv / vec2<f32>(m.levels);
         let c = in.uv.y / (2.0 * f32(m.cells) * m.density);
         let e = in.uv / m.detail + in.at.xy / m.resolution + in.uv % m.displacement[1].xy;
         let s = i32(in.at.x) % m.steps + m.mode;
         return vec4(d + c, l + e, f32(s));",
    );
    let by_use: Vec<&str> = said
        .iter()
        .filter_map(|line| line.strip_suffix(", by its use"))
        .collect();
    assert_eq!(
        by_use,
        [
            "m.bands 4",
            "m.cells 4",
            "m.density 1",
            "m.displacement 1",
            "m.levels 4",
            "m.steps 4",
        ]
    );
    assert!(said.contains(&"m.mode made up: 0".to_owned()), "{said:?}");
    assert!(
        said.iter().any(|s| s.starts_with("m.detail made up: 0.")),
        "{said:?}"
    );
}

#[test]
fn an_opacity_that_a_dither_pattern_discards_by_is_between_0_and_1() {
    let dithered = |opacity: &str| {
        let body = format!(
            "if fract(in.at.x * 0.37 + in.at.y * 0.11) > {opacity} {{ discard; }}
             return vec4(m.tint, 1.0);"
        );
        guesses_for("tint: vec3<f32>, opacity: f32, threshold: f32", &body)
    };
    let half = "m.opacity 0.5, by its use".to_owned();
    for direct in [
        "m.opacity",
        "(1.0 - m.opacity)",
        "saturate(2.0 * m.opacity)",
    ] {
        let said = dithered(direct);
        assert!(said.contains(&half), "{direct}: {said:?}");
    }
    // Its name gives a number by which some fragments are discarded.
    let said = dithered("m.threshold");
    assert!(
        said.contains(&"m.threshold made up: 0.5".to_owned()),
        "{said:?}"
    );
    // Nothing varies: all fragments are discarded, or none.
    let said = guesses_for(
        "opacity: f32",
        "if m.opacity <= 0.0 { discard; }
         return vec4(in.uv, 0.0, m.opacity);",
    );
    assert_eq!(said, ["m.opacity made up: 1"]);
}

/// Centres of the draws' positions, as the vertex buffers hold them.
fn centres(scene: &Scene) -> Vec<[i32; 3]> {
    let centre = |d: &scene::Draw| {
        let [low, high] = scene.meshes[d.mesh].bounds;
        let centre = d.transform.transform_point3((low + high) * 0.5);
        centre.to_array().map(|c| (c * 100.0) as i32)
    };
    scene.draws.iter().map(centre).collect()
}

#[test]
fn objects_without_a_matrix_of_their_own_do_not_share_a_place() {
    let scene = written(&[(
        "world.wgsl",
        "@group(0) @binding(0) var<uniform> view_proj: mat4x4f;
@vertex fn vs(@location(0) position: vec3f) -> @builtin(position) vec4f { \
    return view_proj * vec4f(position, 1.0); }
@fragment fn fs() -> @location(0) vec4f { return vec4f(1.0, 0.5, 0.2, 1.0); }",
    )]);
    assert!(
        scene
            .draws
            .iter()
            .all(|d| d.transform == glam::Mat4::IDENTITY)
    );
    let mut all = centres(&scene);
    let count = all.len();
    assert!(count >= 9);
    all.sort_unstable();
    all.dedup();
    assert_eq!(all.len(), count);
    // With a matrix of its own, meshes are shared.
    let placed =
        preshade_scenes::synthesise(parse(&["shaders/textured.wgsl"]), MaterialState::default());
    assert_eq!(placed.meshes.len(), 3);
}

#[test]
fn three_matrices_are_projection_view_and_model() {
    let scene = written(&[(
        "three.wgsl",
        "struct M { x: mat4x4f, y: mat4x4f, z: mat4x4f }
@group(0) @binding(0) var<uniform> m: M;
@vertex fn vs(@location(0) spot: vec3f) -> @builtin(position) vec4f {
    let world = m.z * vec4f(spot, 1.0);
    return (m.y * m.x) * world;
}
@fragment fn fs() -> @location(0) vec4f { return vec4f(1.0); }",
    )]);
    let frame = &scene.cameras[0].frames[0];
    let got = floats(&bound(&scene)[2], 0, 0);
    assert_eq!(got[..16], frame.view.to_cols_array());
    assert_eq!(got[16..32], frame.projection.to_cols_array());
    assert_eq!(got[32..48], scene.draws[2].transform.to_cols_array());
}

#[test]
fn matrices_of_normals_are_normal_matrices() {
    let scene = written(&[(
        "normals.wgsl",
        "struct Model { model: mat4x4f, normal: mat4x4f }
@group(0) @binding(0) var<uniform> model: Model;
@group(0) @binding(1) var<uniform> view_proj: mat4x4f;
@group(0) @binding(2) var<uniform> turned: mat3x3f;
struct Out { @builtin(position) at: vec4f, @location(0) n: vec3f }
@vertex fn vs(@location(0) position: vec3f, @location(1) normal: vec3f) -> Out {
    let first = (model.normal * vec4f(normal, 0.0)).xyz;
    return Out(view_proj * (model.model * vec4f(position, 1.0)), first + turned * normal);
}
@fragment fn fs(o: Out) -> @location(0) vec4f { return vec4f(o.n, 1.0); }",
    )]);
    let expected = scene.draws[4].transform.inverse().transpose();
    let draw = &bound(&scene)[4];
    assert_eq!(floats(draw, 0, 0)[16..32], expected.to_cols_array());
    let three = floats(draw, 0, 2);
    assert_eq!(three[4..7], expected.y_axis.truncate().to_array());
}

#[test]
fn joints_that_are_matrices_are_the_pose() {
    let scene = written(&[(
        "skinned.wgsl",
        "@group(0) @binding(0) var<uniform> view_proj: mat4x4f;
@group(0) @binding(1) var<storage, read> joints: array<mat4x4f>;
@vertex fn vs(@location(0) position: vec3f, @location(1) skinIndex: vec4u, \
    @location(2) skinWeight: vec4f) -> @builtin(position) vec4f {
    let bent = joints[skinIndex.x] * skinWeight.x + joints[skinIndex.y] * skinWeight.y;
    return view_proj * (bent * vec4f(position, 1.0));
}
@fragment fn fs() -> @location(0) vec4f { return vec4f(1.0); }",
    )]);
    let pose = &scene.draws[1].joints;
    let expected: Vec<f32> = pose.iter().flat_map(|m| m.to_cols_array()).collect();
    assert!(pose.len() > 1);
    assert_eq!(floats(&bound(&scene)[1], 0, 1), expected);
    let guessed = bind::guessed(&scene);
    assert!(
        guessed
            .iter()
            .all(|g| g.guess != bind::Guess::AttributeSynthesised),
        "{guessed:?}"
    );
}

#[test]
fn a_buffer_of_vertices_holds_a_mesh_whatever_its_name() {
    let scene = written(&[(
        "pulled.wgsl",
        "struct Corner { tint: vec4f, spot: vec3f, st: vec2f }
@group(0) @binding(0) var<uniform> view_proj: mat4x4f;
@group(0) @binding(1) var<storage, read> corners: array<Corner>;
@vertex fn vs(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    return view_proj * vec4f(corners[i].spot, 1.0);
}
@fragment fn fs() -> @location(0) vec4f { return vec4f(1.0); }",
    )]);
    let draws = bound(&scene);
    assert!(draws.len() >= 9);
    let at = |draw: &DrawBindings| -> Vec<[i32; 3]> {
        let numbers = floats(draw, 0, 1);
        assert_eq!(numbers.len(), 12 * draw.vertex_count as usize);
        let corners = numbers.as_chunks::<12>().0.iter();
        corners
            .map(|c| [c[4], c[5], c[6]].map(|n| (n * 1e3) as i32))
            .collect()
    };
    let mut first = at(&draws[1]);
    assert_ne!(first, at(&draws[2]));
    first.sort_unstable();
    first.dedup();
    assert!(first.len() > 20, "{}", first.len());
}

/// Only what a scene file says becomes a fact: no texture, flag or colour that it leaves out.
#[test]
fn values_that_a_scene_leaves_out_are_no_facts() {
    use preshade_lab::measure;
    let folder = std::env::temp_dir().join(format!("preshade-left-out-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("leaf.wgsl"), NAMELESS).unwrap();
    let text = "[materials.leaf]
shader = \"leaf.wgsl\"
values = { \"f.a\" = \"$view_proj\", \"f.b\" = [1, 2, 3, 4], \"g.d\" = 0.25 }
attributes = { q = \"position\", p = \"normal\" }
[meshes.box.box]
[[draws]]
mesh = \"box\"
material = \"leaf\"
[[cameras]]
eye = [0, 0, 3]
target = [0, 0, 0]
";
    let scene = preshade_scenes::read(
        text,
        &folder.join("scene.toml"),
        &preshade_scenes::Variables::new(),
        preshade_scenes::Access::default(),
    );
    let scene = scene.unwrap_or_else(|e| panic!("{e}"));
    let constants = measure::constants(&scene).unwrap();
    let names: Vec<&str> = constants.iter().map(|c| c.value.name.as_str()).collect();
    assert_eq!(names, ["f.b.x", "f.b.y", "f.b.z", "f.b.w", "g.d"]);
    let facts = measure::known(&scene);
    let bounds = |wanted: &str| {
        let is_it =
            |s: &&preshade_plan::pass::SourceRange| format!("{:?}", s.source).contains(wanted);
        facts.ranges.iter().find(is_it).map(|s| [s.low, s.high])
    };
    assert_eq!(bounds("\"d\""), Some([0.25; 2]));
    // The colour and the texture coordinates are made up, the normal is the box's.
    assert_eq!(bounds("\"c\""), Some([f32::MIN, f32::MAX]));
    assert_eq!(
        bounds("Varying { location: 0 }"),
        Some([f32::MIN, f32::MAX])
    );
    assert_eq!(bounds("Varying { location: 1 }"), Some([-1.0, 1.0]));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn nothing_of_a_bare_shader_is_a_fact() {
    use preshade_lab::measure;
    use preshade_plan::pass::Facts;
    let scene = written(&[("nameless.wgsl", NAMELESS)]);
    assert_eq!(measure::known(&scene), Facts::default());
    assert!(measure::constants(&scene).unwrap().is_empty());
}

/// A variant without the discard of its original must say so, with the values that it is for.
#[test]
fn a_removed_discard_is_reported_with_its_values() {
    use preshade_compiler::command::rewrite::removed_discard;
    let plan = written(&[("nameless.wgsl", NAMELESS)]).materials[0].plan();
    let apply = |recipe: &str| {
        let recipe = preshade_compiler::recipe::Recipe::parse_list(recipe).unwrap();
        recipe.apply(&plan, &preshade_plan::pass::Facts::default())
    };
    let bare = apply("specialize");
    assert!(bare.is_err(), "nothing is given, so nothing is constant");
    let without = apply("specialize:set=g.e=0").unwrap();
    let said = removed_discard(&without).unwrap();
    assert!(
        said.contains("discards no fragment") && said.contains("g.e = 0"),
        "{said}"
    );
    let with = apply("specialize:set=g.e=4").unwrap();
    assert_eq!(removed_discard(&with), None);
}

/// An offset that a buffer of structs adds to the number of a vertex is no list of indices, and each
/// mesh begins at 0.
#[test]
fn a_storage_array_of_structs_with_offsets_is_made_up() {
    let scene = preshade_scenes::synthesise(
        parse(&["cases/made-up-storage-structs.wgsl"]),
        MaterialState::default(),
    );
    assert!(bound(&scene).len() > 1);
    let value = scene.materials[0].values.get("items.first");
    assert_eq!(value, Some(&scene::Value::Numbers(vec![0.0])));
    assert!(scene.draws.iter().all(|d| !d.values.contains_key("items")));
}
