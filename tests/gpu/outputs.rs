//! Auxiliary pictures, drawn: depths as of the whole program, velocities as the positions of two
//! frames say, normals as of a geometry pass that was written by hand.

use std::path::Path;

use glam::{Mat4, Vec3};
use preshade::unstable::measure::outputs::{OutputsReport, TOLERANCE, measure};
use preshade::unstable::measure::{
    self, Session, Settings, Timed, TimingSettings, Variant, verify,
};
use preshade::unstable::passes::contract::Verdict;
use preshade::unstable::passes::pass::Facts;
use preshade::unstable::passes::plan::{Attachment, GpuPass, Phase, Plan, Role, SCENE_DEPTH};
use preshade::unstable::passes::reflect;
use preshade::unstable::recipe::Recipe;
use preshade::unstable::render::{Rendered, ShaderForm};
use preshade::unstable::scene::{self, DrawOrder, Scene, Stream};

use crate::render_support::*;

/// The scenes, each with the attributes that move in it.
const SCENES: [(&str, &str); 6] = [
    ("skinned", ""),
    ("morphed", ""),
    ("instanced", ",moving=model_0+model_1+model_2+model_3"),
    ("wind", ""),
    ("displaced", ""),
    ("crowd", ",moving=instance_place"),
];

fn load(name: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fixtures/scenes/{name}.toml"));
    let mut scene = scene::load(&path).unwrap().resized([240, 135]);
    scene.cameras.truncate(1);
    scene.orders.truncate(1);
    scene
}

/// A variant in which every uniform counts as changing.
fn variant(scene: &Scene, recipe: &str) -> Variant {
    let recipe = Recipe::parse([recipe]).unwrap();
    let variant = measure::variant(&measure::originals(scene), &recipe, &Facts::default());
    assert!(variant.kept.is_empty(), "{:?}", variant.kept);
    variant
}

fn settings() -> Settings {
    Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    }
}

/// The draws a little earlier: elsewhere, turned, bent and blended otherwise.
fn earlier(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    let turn = Mat4::from_rotation_z(0.03);
    for draw in &mut scene.draws {
        let aside = Mat4::from_translation(Vec3::new(0.03, -0.02, 0.04));
        draw.transform = aside * draw.transform * Mat4::from_rotation_y(0.02);
        let mut bent = Mat4::IDENTITY;
        let joints = draw.joints.iter().map(|joint| {
            bent *= turn;
            *joint * bent
        });
        draw.joints = joints.collect();
        for weight in &mut draw.morph_weights {
            *weight *= 0.9;
        }
        for (name, stream) in &mut draw.instance_streams {
            let Stream::Float { components, data } = stream else {
                continue;
            };
            for instance in data.chunks_mut(*components as usize) {
                match name.as_str() {
                    "instance_transform" => instance[12] += 0.05,
                    "instance_place" => instance[2] += 0.04,
                    _ => {}
                }
            }
        }
    }
    scene
}

fn report(scene: &Scene, earlier: &Scene, variant: &Variant) -> OutputsReport {
    let session = Session::new(gpu(), scene, ShaderForm::Text).unwrap();
    measure(&session, earlier, variant, &settings()).unwrap()
}

#[test]
fn no_auxiliary_depth_differs_from_the_whole_programs() {
    for (name, _) in SCENES {
        let scene = load(name);
        let report = report(&scene, &scene, &variant(&scene, "outputs:write=depth"));
        println!(
            "{name}: {} of {} depths differ",
            report.changed_depth, report.covered
        );
        assert_eq!(
            (report.changed_depth, report.depth_max_ulp),
            (0, 0),
            "{name}"
        );
        assert!(report.covered > 1000, "{name}: {} covered", report.covered);
        assert_eq!(report.verdict(true), Verdict::Holds, "{name}");
    }
}

#[test]
fn no_depth_beside_other_pictures_differs_either() {
    for (name, moving) in SCENES {
        let scene = load(name);
        let recipe = format!("outputs:write=normal+velocity+id{moving}");
        let report = report(&scene, &earlier(&scene), &variant(&scene, &recipe));
        println!(
            "{name}: {} of {} depths differ",
            report.changed_depth, report.covered
        );
        assert_eq!(
            (report.changed_depth, report.depth_max_ulp),
            (0, 0),
            "{name}"
        );
    }
}

#[test]
fn no_depth_of_a_light_s_pictures_differs_from_the_whole_programs() {
    for (name, _) in SCENES {
        let mut scene = load(name);
        scene.light.map = 128;
        let variant = variant(&scene, "outputs:write=shadow");
        let session = Session::new(gpu(), &scene, ShaderForm::Text).unwrap();
        let outcome = verify(&session, &[variant], &settings(), &mut |_| {}).unwrap();
        let report = outcome.report.variants.into_iter().nth(1).unwrap();
        assert_eq!(report.verdict, Verdict::Holds, "{name}");
        let shadow = report.shadow.unwrap();
        println!(
            "{name}: {} of {} depths differ",
            shadow.changed_depth, shadow.covered
        );
        assert_eq!(shadow.changed_depth, 0, "{name}");
        assert!(shadow.covered > 300, "{name}: {} covered", shadow.covered);
    }
}

#[test]
fn velocities_are_those_of_the_positions_in_two_frames() {
    for (name, moving) in SCENES {
        let scene = load(name);
        for precision in ["full", "half"] {
            let recipe = format!("outputs:write=velocity,precision={precision}{moving}");
            let report = report(&scene, &earlier(&scene), &variant(&scene, &recipe));
            let velocity = report.velocity.unwrap();
            println!("{name} {precision}: {velocity:?}");
            assert!(
                velocity.worst <= TOLERANCE,
                "{name} {precision}: {velocity:?}"
            );
            // Everything moved, and most of the picture was compared.
            assert!(velocity.longest > 0.5, "{name}: {velocity:?}");
            assert!(velocity.pixels > 1000, "{name}: {velocity:?}");
            if name != "crowd" {
                assert!(
                    velocity.left_out * 20 < velocity.pixels,
                    "{name}: {velocity:?}"
                );
            }
        }
    }
}

/// A plan that says of a buffer that it does not change, when it does.
#[test]
fn a_plan_that_forgets_what_changed_is_broken() {
    for (name, forgotten) in [
        ("skinned", "joint_matrices"),
        ("morphed", "object"),
        ("wind", "globals"),
    ] {
        let scene = load(name);
        let recipe = format!("outputs:write=velocity,precision=full,static={forgotten}");
        let report = report(&scene, &earlier(&scene), &variant(&scene, &recipe));
        let Verdict::Broken { r#where } = report.verdict(true) else {
            panic!("{name}: {:?}", report.velocity);
        };
        assert!(r#where.starts_with("a velocity is wrong by "), "{where}");
    }
}

#[test]
fn verify_draws_auxiliary_pictures_and_judges_them() {
    let scene = load("wind");
    let variant = variant(&scene, "outputs:write=velocity");
    let session = Session::new(gpu(), &scene, ShaderForm::Text).unwrap();
    let timed = Settings {
        timed: Timed::Headline,
        ..settings()
    };
    let outcome = verify(&session, &[variant], &timed, &mut |_| {}).unwrap();
    let report = outcome.report.variants.into_iter().nth(1).unwrap();
    assert_eq!(report.verdict, Verdict::Holds);
    let outputs = report.outputs.unwrap();
    assert!(outputs.main_ms.is_some() && outputs.time_ms.is_some());
    assert!(outputs.velocity.unwrap().longest > 0.1);
}

/// The pass of outputs as the only one of a plan, with its pictures as the frame's colours.
fn alone(plan: &Plan) -> Plan {
    let pass = plan
        .passes
        .iter()
        .find(|p| p.role == Role::Outputs)
        .unwrap();
    let mut pass: GpuPass = pass.clone();
    let map = plan.attachment("outputs-depth").unwrap().clone();
    pass.phase = Phase::Opaque;
    pass.depth.as_mut().unwrap().attachment = SCENE_DEPTH.to_owned();
    for target in pass.targets.iter_mut().flatten() {
        target.attachment = None;
    }
    let mut alone = plan.clone();
    alone.attachments = vec![Attachment {
        name: SCENE_DEPTH.to_owned(),
        ..map
    }];
    alone.passes = vec![pass];
    alone
}

/// The same with a program that was written by hand.
fn by_hand(plan: &Plan, file: &str) -> Plan {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/handwritten");
    let program = program(&std::fs::read_to_string(path.join(file)).unwrap());
    let mut plan = alone(plan);
    let pass = &mut plan.passes[0];
    pass.vertex = "vs_geometry".to_owned();
    pass.fragment = Some("fs_geometry".to_owned());
    reflect::fill(pass, &program);
    plan.programs.insert(pass.program.clone(), program);
    plan
}

fn drawn(scene: &Scene, plan: Plan) -> Rendered {
    let session = Session::new(gpu(), scene, ShaderForm::Text).unwrap();
    let mut prepared = session.prepare(&[plan]).unwrap();
    let frame = scene.cameras[0].frames[0];
    session
        .draw(&mut prepared, &frame, DrawOrder::FrontToBack)
        .unwrap()
}

#[test]
fn normals_are_those_of_a_geometry_pass_written_by_hand() {
    for (name, material, file) in [
        ("atrium", "marble", "gbuffer-pbr.wgsl"),
        ("morphed", "clay", "gbuffer-morphed.wgsl"),
    ] {
        let mut scene = load(name);
        let index = scene
            .materials
            .iter()
            .position(|m| m.name == material)
            .unwrap();
        scene.draws.retain(|d| d.material == index);
        scene.materials = vec![scene.materials[index].clone()];
        for draw in &mut scene.draws {
            draw.material = 0;
        }
        let variant = variant(&scene, "outputs:write=normal,precision=full");
        let plan = &variant.plans[0];
        let ours = drawn(&scene, alone(plan));
        let theirs = drawn(&scene, by_hand(plan, file));
        let [ours, theirs] = [ours, theirs].map(|r| r.colors[0].clone().unwrap());
        let pixels = (ours.size[0] * ours.size[1]) as usize;
        let (mut covered, mut worst) = (0, 0.0_f32);
        for pixel in 0..pixels {
            let (a, b) = (ours.rgba(pixel), theirs.rgba(pixel));
            covered += usize::from(b[3] == 1.0);
            for (a, b) in a.into_iter().zip(b) {
                worst = worst.max((a - b).abs());
            }
        }
        println!("{name}: {covered} pixels, {worst} apart");
        assert!(covered > 1000, "{name}: {covered}");
        // Roundings of 32-bit floats alone: the two texts may be fused differently.
        assert!(worst < 1e-5, "{name}: {worst}");
    }
}

#[test]
fn ids_are_those_of_draws_and_instances() {
    let scene = load("instanced");
    let variant = variant(&scene, "outputs:write=id");
    let session = Session::new(gpu(), &scene, ShaderForm::Text).unwrap();
    let plans: Vec<Plan> = variant.plans.iter().map(alone).collect();
    let mut prepared = session.prepare(&plans).unwrap();
    let frame = scene.cameras[0].frames[0];
    let picture = session
        .draw(&mut prepared, &frame, DrawOrder::FrontToBack)
        .unwrap();
    let color = picture.colors[0].clone().unwrap();
    let mut seen = std::collections::BTreeSet::new();
    for pixel in 0..(color.size[0] * color.size[1]) as usize {
        let words = color.texel(pixel).as_chunks::<4>().0;
        let [draw, instance] = [0, 1].map(|i| u32::from_le_bytes(words[i]));
        seen.insert((draw, instance));
    }
    // The background, and many instances of both draws.
    assert!(seen.contains(&(0, 0)));
    for (draw, instances) in [(1, 180), (2, 36)] {
        let of_draw: Vec<_> = seen.iter().filter(|(d, _)| *d == draw).collect();
        assert!(of_draw.len() > 10, "draw {draw}: {}", of_draw.len());
        assert!(of_draw.iter().all(|(_, i)| *i < instances));
    }
    assert!(seen.iter().all(|(d, _)| *d <= 2));
}
