//! A shader's inputs whose names say nothing get what the shader does with them: in a scene file, and
//! in the scene of a bare shader.

use std::path::Path;

use glam::Mat4;
use preshade_compiler::front::{self, Source};
use preshade_draw::scene::bind::{self, DrawBindings, overlapping_draws};
use preshade_draw::scene::{self, Scene};
use preshade_plan::state::MaterialState;
use shader_text::options::Options;

/// A scene of two draws with one shader. `keys` are more of the material's and the scene's.
fn two_draws(name: &str, shader: &str, keys: &str) -> Scene {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("scene_by_use_{name}"));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("m.wgsl"), shader).unwrap();
    let path = folder.join("scene.toml");
    let text = format!(
        "[materials.m]\nshader = \"m.wgsl\"\n{keys}\n\
         [meshes]\nb.box = {{ size = [1, 1, 1] }}\nb.skin = {{ joints = 4 }}\n\
         [[draws]]\nmesh = \"b\"\nmaterial = \"m\"\ntranslate = [-1.5, 0, 0]\n\
         [[draws]]\nmesh = \"b\"\nmaterial = \"m\"\ntranslate = [1.5, 0, 0]\n\
         [[cameras]]\neye = [0, 1.5, 5]\ntarget = [0, 0, 0]\n"
    );
    std::fs::write(&path, text).unwrap();
    preshade_scenes::load(&path).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// What each draw of the first material binds in the first frame.
fn bound(scene: &Scene) -> Vec<DrawBindings> {
    let (_, frame) = scene.frames().next().unwrap();
    let material = &scene.materials[0];
    let plan = material.plan();
    let draw = |d| bind::draw(scene, material, plan.main().unwrap(), d, frame).unwrap();
    scene.draws.iter().map(draw).collect()
}

/// The matrices of the buffer at a binding of group 0.
fn matrices(bound: &DrawBindings, binding: u32) -> Vec<Mat4> {
    let at = |b: &&bind::BufferBinding| (b.group, b.binding) == (0, binding);
    let buffer = bound.buffers.iter().find(at).unwrap();
    let words = buffer.data.bytes.as_chunks::<4>().0.iter();
    let numbers: Vec<f32> = words.map(|w| f32::from_le_bytes(*w)).collect();
    let all = numbers.as_chunks::<16>().0.iter();
    all.map(Mat4::from_cols_array).collect()
}

fn guesses(scene: &Scene) -> Vec<String> {
    let all = bind::guessed(scene).into_iter();
    all.map(|g| format!("{} {}", g.name, g.guess)).collect()
}

fn lit(members: &str, position: &str) -> String {
    format!(
        "struct U {{ {members} }}
@group(0) @binding(0) var<uniform> u: U;
@vertex fn vs(@location(0) va0: vec3f) -> @builtin(position) vec4f {{ return {position}; }}
@fragment fn fs() -> @location(0) vec4f {{ return vec4f(1); }}"
    )
}

#[test]
fn a_matrix_with_an_odd_name_places_each_draw() {
    let frame = |scene: &Scene| *scene.frames().next().unwrap().1;
    for (i, (members, position, keys, guessed)) in [
        (
            "vp: mat4x4f, m: mat4x4f",
            "u.vp * u.m * vec4f(va0, 1)",
            "",
            vec!["u.m $model, by its use"],
        ),
        (
            "a: mat4x4f, b: mat4x4f",
            "u.a * (u.b * vec4f(va0, 1))",
            "",
            vec!["u.a $viewproj, by its use", "u.b $model, by its use"],
        ),
        // What the scene says of one matrix tells about the other.
        (
            "a: mat4x4f, b: mat4x4f",
            "u.a * u.b * vec4f(va0, 1)",
            "values = { \"u.a\" = \"$projection\" }",
            vec!["u.b $modelview, by its use"],
        ),
        (
            "q: mat4x4f",
            "u.q * vec4f(va0, 1)",
            "",
            vec!["u.q $mvp, by its use"],
        ),
    ]
    .into_iter()
    .enumerate()
    {
        let scene = two_draws(&format!("matrix{i}"), &lit(members, position), keys);
        let said = guesses(&scene);
        for guess in guessed {
            assert!(said.iter().any(|s| s == guess), "{position}: {said:?}");
        }
        let frame = frame(&scene);
        for (draw, bound) in scene.draws.iter().zip(bound(&scene)) {
            let product: Mat4 = matrices(&bound, 0).into_iter().product();
            let expected = frame.projection * frame.view * draw.transform;
            assert!(product.abs_diff_eq(expected, 1e-4), "{position}: {product}");
            // A guess is no fact.
            let is_whole = position.contains("u.vp");
            let last = bound.buffers[0].data.bytes.len();
            assert!(bound.buffers[0].is_invented(&(last - 64..last)));
            assert_eq!(
                !is_whole && keys.is_empty(),
                bound.buffers[0].is_invented(&(0..64))
            );
        }
        assert_eq!(overlapping_draws(&scene), []);
    }
}

#[test]
fn what_the_scene_or_the_name_says_is_no_guess() {
    let shader = lit("vp: mat4x4f, m: mat4x4f", "u.vp * u.m * vec4f(va0, 1)");
    let zeros = ["0"; 16].join(", ");
    let scene = two_draws(
        "said",
        &shader,
        &format!("values = {{ \"u.m\" = [{zeros}] }}"),
    );
    assert_eq!(matrices(&bound(&scene)[0], 0)[1], Mat4::ZERO);
    assert!(!guesses(&scene).iter().any(|s| s.starts_with("u.m")));
    let named = lit(
        "vp: mat4x4f, normal: mat4x4f",
        "u.vp * u.normal * vec4f(va0, 1)",
    );
    let scene = two_draws("named", &named, "");
    assert!(guesses(&scene).contains(&"u.normal $normalmatrix, by its name".to_owned()));
}

/// Both draws are in one place.
#[test]
fn draws_whose_transforms_nothing_reads_are_named() {
    let shader = lit("vp: mat4x4f, tint: vec4f", "u.vp * vec4f(va0, 1)");
    let scene = two_draws("unplaced", &shader, "");
    let draws = [0, 1].map(|i| scene.draws[i].name.as_str());
    assert_eq!(overlapping_draws(&scene), [("m", draws)]);
    // The second draw has a value of its own.
    let mut scene = scene.clone();
    let tint = scene::Value::Numbers(vec![0.5; 4]);
    scene.draws[1].values.insert("u.tint".to_owned(), tint);
    assert_eq!(overlapping_draws(&scene), []);
}

/// A skinned vertex stage: the declaration of the joints at binding 1, and `p`, the skinned position.
fn skinned(joints: &str, body: &str) -> String {
    format!(
        "@group(0) @binding(0) var<uniform> view_proj: mat4x4f;
struct Rig {{ m: array<mat4x4f, 4> }}
struct Bone {{ m: mat4x4f }}
@group(0) @binding(1) {joints};
@vertex fn vs(@location(0) q0: vec3f, @location(1) bw: vec4f, @location(2) bi: vec4u,
    @location(3) bf: vec4f) -> @builtin(position) vec4f {{
    {body}
    return view_proj * vec4f(p, 1);
}}
@fragment fn fs() -> @location(0) vec4f {{ return vec4f(1); }}"
    )
}

const SKINS: [(&str, &str, &str); 4] = [
    (
        "var<storage, read> skel: array<mat4x4f>",
        "let m = skel[bi.x] * bw.x + skel[bi.y] * bw.y; let p = (m * vec4f(q0, 1)).xyz;",
        "skel",
    ),
    (
        "var<storage, read> skel: array<Bone>",
        "let a = skel[bi.x].m * vec4f(q0, 1); let p = bw.x * a.xyz;",
        "skel.m",
    ),
    (
        "var<uniform> rig: Rig",
        "var p = vec3f(0); let w = bw; let at = bi; for (var k = 0; k < 4; k++) \
         { p += ((rig.m[at[k]] * w[k]) * vec4f(q0, 1)).xyz; }",
        "rig.m",
    ),
    (
        "var<uniform> rig: array<mat4x4f, 4>",
        "let m = bw.z * rig[i32(bf.z)] + bw.w * rig[u32(bf.w)]; let p = (m * vec4f(q0, 1)).xyz;",
        "rig",
    ),
];

#[test]
fn skins_are_found_by_use() {
    for (i, (joints, body, path)) in SKINS.into_iter().enumerate() {
        let shader = skinned(joints, body);
        let index = if body.contains("bf.") { "bf" } else { "bi" };
        let wanted = [
            format!("{path} $joints, by its use"),
            format!("{index} the mesh's joints, by its use"),
            "bw the mesh's weights, by its use".to_owned(),
            "q0 the mesh's position, by its use".to_owned(),
        ];
        let options = Options::default();
        let parsed = front::parse(&[Source::new("m.wgsl", &*shader)], &options).unwrap();
        let made_up = preshade_scenes::synthesise(parsed, MaterialState::default());
        let written = two_draws(&format!("skin{i}"), &shader, "");
        for scene in [&made_up, &written] {
            let said = guesses(scene);
            for guess in &wanted {
                assert!(said.contains(guess), "{body}: {guess} is not in {said:?}");
            }
            for (draw, bound) in scene.draws.iter().zip(bound(scene)) {
                let posed = matrices(&bound, 1);
                assert!(draw.joints.iter().any(|j| *j != Mat4::IDENTITY), "{body}");
                let known = posed.len().min(draw.joints.len());
                assert!(known > 1, "{body}");
                assert_eq!(posed[..known], draw.joints[..known], "{body}");
            }
        }
    }
}

/// Each instance's number chooses its matrix: nothing is weighted.
#[test]
fn a_matrix_that_an_attribute_chooses_is_no_joint_without_weights() {
    let shader = skinned(
        "var<storage, read> skel: array<mat4x4f>",
        "let p = (skel[bi.x] * vec4f(q0, 1)).xyz + bw.xyz * bf.x;",
    );
    let said = guesses(&two_draws("chosen", &shader, ""));
    assert!(
        said.iter()
            .all(|s| !s.contains("joints") && !s.contains("weights")),
        "{said:?}"
    );
}

/// A mesh without a skin is drawn by the first joint alone, and keeps its size.
#[test]
fn a_mesh_without_weights_is_weighted_by_1() {
    let (joints, body, _) = SKINS[0];
    let mut scene = two_draws("bare", &skinned(joints, body), "");
    for stream in ["joints", "weights"] {
        scene.meshes[0].streams.remove(stream);
    }
    let bound = &bound(&scene)[0];
    let buffer = &bound.vertex_buffers[0];
    let at = |location: u32| buffer.attributes.iter().find(|a| a.location == location);
    let from = at(1).unwrap().offset as usize;
    let words = buffer.data.bytes[from..from + 16].as_chunks::<4>().0.iter();
    let weights: Vec<f32> = words.map(|w| f32::from_le_bytes(*w)).collect();
    assert_eq!(weights, [1.0, 0.0, 0.0, 0.0]);
}
