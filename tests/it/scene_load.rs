//! Every shipped scene loads, and every draw of it binds.

use std::path::{Path, PathBuf};

use preshade_draw::scene::{self, bind};
use preshade_plan::plan::Plan;

fn scenes() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scenes");
    let mut found: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "toml"))
        .collect();
    found.sort();
    found
}

fn load(path: &Path) -> scene::Scene {
    preshade_scenes::load(path).unwrap_or_else(|e| panic!("{}", e.render()))
}

/// The scene that `docs/reference/scenes.md` shows is a shipped one, which every test of all scenes
/// draws.
#[test]
fn the_scene_of_the_documentation_is_shipped() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |path: &str| std::fs::read_to_string(root.join(path)).unwrap();
    let page = read("docs/reference/scenes.md");
    let shown = page.split("```toml\n").nth(1).unwrap();
    let shown = shown.split("```").next().unwrap();
    assert_eq!(shown, read("fixtures/scenes/first.toml"));
}

#[test]
fn what_a_frame_changes_is_what_frame_buffers_returns() {
    let scene = load(&scenes()[0]);
    let draw = &scene.draws[0];
    let material = &scene.materials[draw.material];
    let plan = Plan::original(
        &material.name,
        material.program.clone(),
        &material.vertex,
        material.fragment.as_deref(),
        &material.state,
    );
    let pass = plan.main().unwrap();
    let mut moved = scene.cameras[0].frames[0];
    let before = bind::draw(&scene, material, pass, draw, &moved).unwrap();
    moved.view.w_axis.x += 1.0;
    moved.eye.x -= 1.0;
    let after = bind::draw(&scene, material, pass, draw, &moved).unwrap();
    let changed: Vec<_> = after
        .buffers
        .iter()
        .filter(|b| !before.buffers.contains(b))
        .cloned()
        .collect();
    assert!(!changed.is_empty());
    let told = bind::frame_buffers(&scene, material, pass, draw, &moved).unwrap();
    assert!(changed.iter().all(|b| told.contains(b)));
    assert_eq!(before.vertex_buffers, after.vertex_buffers);
}

#[test]
fn an_orbit_is_an_eye_on_a_sphere_round_its_target() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scenes");
    let scene = load(&folder.join("teapot-noise.toml"));
    let camera = |name: &str| scene.cameras.iter().find(|c| c.name == name).unwrap();
    // Yaw 5.21 and pitch 0.28 radians, 2.8 from the origin: yaw turns +x towards -z.
    let frame = camera("article").frames[0];
    let (yaw, pitch) = (5.21_f32, 0.28_f32);
    let flat = 2.8 * pitch.cos();
    let wanted = glam::Vec3::new(flat * yaw.cos(), 2.8 * pitch.sin(), -flat * yaw.sin());
    assert!(frame.eye.distance(wanted) < 1e-4, "{} {wanted}", frame.eye);
    // The target is straight ahead.
    let ahead = frame.view.transform_point3(glam::Vec3::ZERO);
    assert!(ahead.distance(glam::Vec3::new(0.0, 0.0, -2.8)) < 1e-4);
    // 1 / tan(0.45): 0.9 radians of vertical view.
    assert!((frame.projection.y_axis.y - 1.0 / 0.45_f32.tan()).abs() < 1e-4);

    // A path may be of orbits, and its time runs on.
    let turn = &camera("turn").frames;
    assert!(turn.windows(2).all(|w| w[0].time < w[1].time));
    assert!((turn[0].eye.length() - 3.4).abs() < 1e-4);
}

#[test]
fn variables_are_what_the_command_line_says() {
    use preshade_draw::scene::Stream;
    use preshade_scenes::{Variable, Variables};
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scenes/grass.toml");
    let with = |pairs: &[(&str, &str)]| {
        let set: Variables = pairs
            .iter()
            .map(|(name, value)| ((*name).to_owned(), Variable::parse(value)))
            .collect();
        preshade_scenes::load_with(&path, &set)
    };
    let places = |order: &str| -> Vec<[u32; 4]> {
        let scene = with(&[("instances", "1_000"), ("order", order)]).unwrap();
        assert_eq!(scene.draws[0].instances, 1000);
        match &scene.draws[0].instance_streams["instance_place"] {
            Stream::Float {
                components: 4,
                data,
            } => {
                let all = data.as_chunks::<4>().0.iter();
                all.map(|p| p.map(f32::to_bits)).collect()
            }
            other => panic!("{other:?}"),
        }
    };
    let (rows, shuffled) = (places("ascending"), places("shuffled"));
    let mut turned = places("descending");
    turned.reverse();
    assert_eq!(rows, turned);
    assert_ne!(rows, shuffled);
    let sorted = |mut all: Vec<[u32; 4]>| {
        all.sort_unstable();
        all
    };
    assert_eq!(sorted(rows.clone()), sorted(shuffled));
    // From the camera away: a cell's jitter is less than the cell.
    let z = |p: &[u32; 4]| f32::from_bits(p[1]);
    assert!(z(&rows[0]) < -38.0 && z(&rows[999]) > 36.0);
    assert!(rows.iter().all(|p| z(p).abs() <= 41.0));
    for (pairs, told) in [
        ([("instance", "5")], "the scene has no variable `instance`"),
        (
            [("order", "by colour")],
            "`by colour` is no order of copies",
        ),
        ([("instances", "many")], "a whole number is asked for"),
        ([("instances", "0")], "a field of 0 copies"),
    ] {
        let error = with(&pairs).unwrap_err().render();
        assert!(error.contains(told), "{error}");
    }
}

/// The bytes of the one uniform of a scene's first draw.
fn uniform(root: &Path, material: &str, draw: &str) -> Vec<f32> {
    let text = format!(
        "[materials.m]\nshader = \"m.wgsl\"\nvalues = {{ {material} }}\n[meshes]\na.plane = {{}}\n\
         [[draws]]\nmesh = \"a\"\nmaterial = \"m\"\nvalues = {{ {draw} }}\n[[cameras]]\n\
         eye = [0, 2, 3]\ntarget = [0, 0, 0]\n"
    );
    let path = root.join("scene.toml");
    std::fs::write(&path, text).unwrap();
    let scene = load(&path);
    let plan = scene.materials[0].plan();
    let (_, frame) = scene.frames().next().unwrap();
    let (material, pass) = (&scene.materials[0], plan.main().unwrap());
    let bound = bind::uniform_buffers(&scene, material, pass, &scene.draws[0], frame).unwrap();
    let bytes = &bound[0].data.bytes;
    bytes
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .collect()
}

#[test]
fn a_draw_s_values_go_before_its_material_s_wholes_and_parts_alike() {
    let root = Path::new(env!("CARGO_TARGET_TMPDIR")).join("scene_load_values");
    std::fs::create_dir_all(&root).unwrap();
    std::fs::write(
        root.join("m.wgsl"),
        "struct U { lights: array<vec4f, 3> }
         @group(0) @binding(0) var<uniform> u: U;
         @vertex fn vs(@location(0) position: vec3f) -> @builtin(position) vec4f { \
             return vec4f(position, 1.0) + u.lights[0]; }
         @fragment fn fs() -> @location(0) vec4f { return u.lights[1]; }",
    )
    .unwrap();
    let each = "\"u.lights[0]\" = 1, \"u.lights[1]\" = 2, \"u.lights[2]\" = 3";
    for (material, draw, wanted) in [
        ("\"u.lights\" = 0.5", "\"u.lights[1]\" = 7", [0.5, 7.0, 0.5]),
        ("u = 0.5", "\"u.lights[2]\" = [7, 7, 7, 7]", [0.5, 0.5, 7.0]),
        (each, "\"u.lights\" = 7", [7.0, 7.0, 7.0]),
        (each, "u = 7", [7.0, 7.0, 7.0]),
        (each, "\"u.lights[1]\" = 7", [1.0, 7.0, 3.0]),
        (
            "\"u.lights\" = 2",
            "\"u.lights\" = \"$time\"",
            [0.0, 0.0, 0.0],
        ),
        (each, "", [1.0, 2.0, 3.0]),
    ] {
        let wanted: Vec<f32> = wanted.into_iter().flat_map(|w| [w; 4]).collect();
        assert_eq!(uniform(&root, material, draw), wanted, "{material}; {draw}");
    }
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    #[test]
    fn every_draw_of_every_scene_binds_what_its_pass_lists() {
        let scenes = scenes();
        assert!(!scenes.is_empty());
        for path in scenes {
            let scene = load(&path);
            let plans: Vec<Plan> = scene
                .materials
                .iter()
                .map(|m| {
                    Plan::original(
                        &m.name,
                        m.program.clone(),
                        &m.vertex,
                        m.fragment.as_deref(),
                        &m.state,
                    )
                })
                .collect();
            for draw in &scene.draws {
                let material = &scene.materials[draw.material];
                let pass = plans[draw.material].main().unwrap();
                let frame = &scene.cameras[0].frames[0];
                let bound = bind::draw(&scene, material, pass, draw, frame)
                    .unwrap_or_else(|e| panic!("{}: {}: {e}", path.display(), draw.name));
                let count = bound.buffers.len() + bound.textures.len() + bound.samplers.len();
                assert_eq!(count, pass.bindings.len(), "{}", path.display());
                let attributes: usize = bound
                    .vertex_buffers
                    .iter()
                    .map(|b| b.attributes.len())
                    .sum();
                assert_eq!(attributes, pass.attributes.len(), "{}", path.display());
                for buffer in &bound.vertex_buffers {
                    let count = match buffer.step {
                        wgpu::VertexStepMode::Vertex => scene.meshes[draw.mesh].vertex_count,
                        wgpu::VertexStepMode::Instance => bound.instances,
                    };
                    assert_eq!(
                        buffer.data.bytes.len() as u64,
                        buffer.stride * u64::from(count)
                    );
                }
                let drawn = bound
                    .indices
                    .as_ref()
                    .map_or(bound.vertex_count, |i| i.count);
                assert!(
                    drawn > 0 && bound.instances > 0,
                    "{}: {}",
                    path.display(),
                    draw.name
                );
            }
        }
    }
}
