//! `form=static`: what reads nothing that changes is computed once, at load, and draws what the
//! other forms draw.

use std::collections::BTreeMap;

use glam::{Mat4, Vec3};
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{FrameSettings, Prepared, Rendered, SceneInputs};
use preshade_draw::scene::{Draw, DrawOrder, Frame, Scene};
use preshade_lab::measure;
use preshade_plan::pass::{Facts, Refusal};
use preshade_plan::plan::{Plan, When};
use preshade_scenes::ShaderForm;
use preshade_scenes::mesh::Sphere;

use crate::render_support::{self, gpu, material, scene};

/// Waves that stand still on the object, with a light that follows the camera's time outside what
/// is hoisted.
const STILL: &str = "
struct Camera { view_proj: mat4x4<f32>, time: f32 }
struct Waves { height: f32 }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> model: mat4x4<f32>;
struct VertexOut { @builtin(position) clip: vec4<f32>, @location(0) local: vec3<f32> }
@vertex fn vs(@location(0) position: vec3<f32>) -> VertexOut {
    return VertexOut(camera.view_proj * model * vec4(position, 1.0), position);
}
@fragment fn fs(in: VertexOut) -> @location(0) vec4<f32> {
    let waves = sin(in.local.x * 9.0) * cos(in.local.y * 7.0) * sin(in.local.z * 8.0) * \
        exp(sin(in.local.x * 5.0)) + sin(exp(in.local.y));
    return vec4(0.2, 0.5 + 0.2 * waves, 0.0, 1.0);
}
";

const HOIST: &str = "hoist:budget=0.5,finite=assumed,jumps=carried";

fn camera(angle: f32, time: f32) -> Frame {
    let eye = Mat4::from_rotation_y(angle).transform_point3(Vec3::new(0.3, 0.4, 2.6));
    Frame {
        view: Mat4::look_at_rh(eye, Vec3::ZERO, Vec3::Y),
        projection: Mat4::perspective_rh(0.9, 1.0, 0.1, 10.0),
        eye,
        time,
    }
}

fn sphere(source: &str) -> Scene {
    let mut scene = scene([160, 160], vec![material("waves", source)], Vec::new());
    scene.meshes = vec![
        Sphere {
            radius: 1.0,
            segments: 13,
            rings: 7,
        }
        .mesh("sphere"),
    ];
    scene.draws = vec![Draw {
        values: BTreeMap::new(),
        ..render_support::draw("sphere", Mat4::IDENTITY, [1.0; 4])
    }];
    scene.cameras[0].frames = vec![camera(0.0, 0.0), camera(0.7, 0.4), camera(2.0, 1.1)];
    scene
}

fn facts(scene: &Scene) -> Facts {
    Facts {
        changing: Some(measure::changing(scene).unwrap()),
        ..Facts::default()
    }
}

fn plans(scene: &Scene, tessellate: &str, facts: &Facts) -> Result<Vec<Plan>, Box<Refusal>> {
    let recipe = Recipe::parse([HOIST, tessellate]).unwrap();
    let originals = measure::originals(scene);
    originals.iter().map(|p| recipe.apply(p, facts)).collect()
}

/// All frames, drawn by one prepared variant, and what that says of its cost.
fn draw(scene: &Scene, plans: &[Plan]) -> (Vec<Rendered>, [u64; 2]) {
    let inputs = SceneInputs::new(gpu(), scene).unwrap();
    let variant = preshade_scenes::variant(plans, ShaderForm::Text).unwrap();
    let mut prepared = Prepared::new(&inputs, &variant, &FrameSettings::of(scene)).unwrap();
    let frames = scene.cameras[0].frames.iter();
    let drawn = frames
        .map(|frame| {
            inputs.set_frame(frame).unwrap();
            prepared.aim(frame, DrawOrder::AsGiven);
            prepared.render().unwrap()
        })
        .collect();
    let cost = prepared.subdivision_cost().unwrap();
    (drawn, [cost.evaluations, cost.at_load])
}

#[test]
fn what_stands_still_is_computed_once() {
    let scene = sphere(STILL);
    let facts = facts(&scene);
    for parameters in ["pattern=gl,level=4", "pattern=uniform,level=5"] {
        let of = |form: &str| {
            let step = format!("tessellate:{parameters},form={form}");
            let plans = plans(&scene, &step, &facts).unwrap_or_else(|r| panic!("{r}"));
            let drawn = draw(&scene, &plans);
            (plans, drawn)
        };
        let (_, (shared, [every_frame, _])) = of("shared");
        let (plans, (kept, [evaluations, at_load])) = of("static");
        // Not one of them in a frame; at load as many as the shared form computes in each.
        assert_eq!((evaluations, at_load), (0, every_frame), "{parameters}");
        assert!(at_load > 1000, "{at_load}");
        for (i, (a, b)) in kept.iter().zip(&shared).enumerate() {
            // The same vertices in the same places, so that depth has the same bits. The colour may
            // round apart where a seam has two vertices.
            assert_eq!(a.depth, b.depth, "{parameters}, frame {i}");
            let error = measure::compare(a, b).unwrap();
            assert!(error.max_abs <= 1.0 / 255.0, "{parameters}: {error:?}");
        }
        assert_ne!(kept[0], kept[1], "the camera moves");
        let compute = &plans[0].compute[0];
        // The camera is not among what it binds.
        let fixed = Vec::new();
        assert_eq!(compute.when, When::Load { fixed });
        assert!(compute.bindings.iter().all(|b| b.name != "camera"));
    }
}

/// The same plan with its work at load put into each frame, and work of each frame put at load: the
/// renderer obeys.
#[test]
fn work_at_load_is_not_done_again() {
    let scene = sphere(&STILL.replace("in.local.z * 8.0)", "in.local.z * 8.0 + camera.time)"));
    let shared = plans(&scene, "tessellate:level=3,form=shared", &facts(&scene)).unwrap();
    let (moving, _) = draw(&scene, &shared);
    let mut stuck = shared;
    stuck[0].compute[0].when = When::Load { fixed: Vec::new() };
    let (stuck, _) = draw(&scene, &stuck);
    // The first frame is what was loaded; the shared form keeps clip positions too, so that its
    // camera stands still.
    assert_eq!(stuck[0], moving[0]);
    assert_eq!(stuck[1], moving[0]);
    assert_ne!(moving[1], moving[0]);
}

#[test]
fn what_changes_is_refused_by_name() {
    let source = STILL.replace("in.local.z * 8.0)", "in.local.z * 8.0 + camera.time)");
    let scene = sphere(&source);
    let refusal = plans(&scene, "tessellate:form=static", &facts(&scene)).unwrap_err();
    assert_eq!(refusal.code, "changes");
    assert!(refusal.reason.contains("`camera.time`"), "{refusal}");
    assert!(!refusal.reason.contains("view_proj"), "{refusal}");
    // A still camera does not make the time stand still.
    let mut still = scene.clone();
    still.cameras[0].frames.truncate(1);
    assert_eq!(facts(&still), facts(&scene));
    // A promise does not stand against what was seen.
    let promised = "tessellate:form=static,fixed=camera.time";
    let refusal = plans(&scene, promised, &facts(&scene)).unwrap_err();
    assert_eq!(refusal.code, "changes");
}

#[test]
fn without_a_scene_a_promise_is_asked_for() {
    let source = STILL.replace("sin(exp(in.local.y))", "sin(exp(in.local.y) + camera.time)");
    let scene = sphere(&source);
    let nothing_known = Facts::default();
    let refusal = plans(&scene, "tessellate:form=static", &nothing_known).unwrap_err();
    assert_eq!(refusal.code, "may-change");
    assert_eq!(
        refusal.remedy,
        "if none of them changes, set fixed=camera.time"
    );
    let promised = "tessellate:form=static,fixed=camera.time";
    let plans = plans(&scene, promised, &nothing_known).unwrap_or_else(|r| panic!("{r}"));
    let fixed = vec!["camera.time".to_owned()];
    assert_eq!(plans[0].compute[0].when, When::Load { fixed });
    let note = plans[0].notes.last().unwrap();
    assert!(
        note.contains("again where any of camera.time changes"),
        "{note}"
    );
}
