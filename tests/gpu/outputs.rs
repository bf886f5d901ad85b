//! Auxiliary pictures, drawn: depths as of the whole program, velocities as the positions of two
//! frames say, normals as of a geometry pass that was written by hand, distances as the depths say.

use std::collections::{BTreeMap, BTreeSet};

use glam::{Mat4, Vec3, Vec4};
use preshade::unstable::measure::outputs::TOLERANCE;
use preshade::unstable::measure::{Session, Timed, verify};
use preshade::unstable::passes::contract::Verdict;
use preshade::unstable::passes::plan::Plan;
use preshade::unstable::render::ShaderForm;
use preshade::unstable::scene::{Draw, DrawOrder, Scene};

use crate::outputs_support::{
    Row, alone, drawn, earlier, fixtures, load, moving_scenes, normals, report, row, settings,
    variant,
};
use crate::render_support::*;

/// Large enough for `skinned` to have more than a thousand pixels.
const SIZE: [u32; 2] = [240, 135];

#[test]
fn no_auxiliary_depth_differs_from_the_whole_programs() {
    for subject in moving_scenes(SIZE) {
        for write in ["depth", "shadow", "distance", "normal+velocity+id"] {
            let row = row(gpu(), &subject, write, Timed::No);
            println!("{row:?}");
            assert_eq!(row.refused, None);
            assert_eq!((row.changed_depth, row.depth_max_ulp), (0, 0), "{row:?}");
            assert!(row.covered > 1000, "{row:?}");
            assert!(row.holds, "{row:?}");
        }
    }
}

/// What every fixture makes of a picture, in a scene made for it.
fn everywhere(write: &str) -> (Vec<Row>, Vec<Row>) {
    let rows = fixtures([64, 48]).into_iter().map(|subject| {
        let row = row(gpu(), &subject, write, Timed::No);
        println!("{row:?}");
        row
    });
    rows.partition(|row| row.refused.is_none())
}

#[test]
fn no_auxiliary_depth_of_a_fixture_differs() {
    for (write, least) in [("depth", 35), ("shadow", 35)] {
        let (applied, refused) = everywhere(write);
        let seen: Vec<&Row> = applied.iter().filter(|r| r.covered > 0).collect();
        let pixels: u64 = seen.iter().map(|r| r.covered).sum();
        println!(
            "{write}: {} fixtures compared in {pixels} pixels, {} not seen, {} refused",
            seen.len(),
            applied.len() - seen.len(),
            refused.len()
        );
        for row in &applied {
            assert_eq!((row.changed_depth, row.depth_max_ulp), (0, 0), "{row:?}");
        }
        assert!(seen.len() >= least, "{write}: {}", seen.len());
        assert!(pixels > 20_000, "{write}: {pixels}");
    }
}

#[test]
fn velocities_of_fixtures_are_those_of_the_positions_in_two_frames() {
    let (applied, refused) = everywhere("velocity");
    let compared: Vec<&Row> = applied
        .iter()
        .filter(|r| r.velocity.is_some_and(|(pixels, ..)| pixels > 0))
        .collect();
    let pixels: u64 = compared.iter().filter_map(|r| Some(r.velocity?.0)).sum();
    println!(
        "velocity: {} fixtures compared in {pixels} pixels, {} not, {} refused",
        compared.len(),
        applied.len() - compared.len(),
        refused.len()
    );
    for row in &compared {
        let (.., worst) = row.velocity.unwrap();
        assert!(worst <= TOLERANCE, "{row:?}");
    }
    // What was not compared does not hold.
    for row in applied
        .iter()
        .filter(|r| r.velocity.is_some_and(|v| v.0 == 0))
    {
        assert!(!row.holds, "{row:?}");
    }
    assert!(compared.len() >= 30, "{}", compared.len());
    assert!(pixels > 15_000, "{pixels}");
}

#[test]
fn velocities_are_those_of_the_positions_in_two_frames() {
    for subject in moving_scenes(SIZE) {
        for precision in ["full", "half"] {
            let write = format!("velocity,precision={precision}");
            let row = row(gpu(), &subject, &write, Timed::No);
            println!("{row:?}");
            let (pixels, left_out, longest, worst) = row.velocity.unwrap();
            assert!(worst <= TOLERANCE, "{row:?}");
            // Everything moved, and most of the picture was compared.
            assert!(longest > 0.5, "{row:?}");
            assert!(pixels > 1000, "{row:?}");
            // What a filtered texture moves is compared where the adapter's filter and the
            // interpreter's agree.
            if subject.name != "scene displaced" {
                assert!(left_out * 20 < pixels, "{row:?}");
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
        let scene = load(name, SIZE);
        let recipe = format!("outputs:write=velocity,precision=full,static={forgotten}");
        let variant = variant(&scene, &recipe);
        let report = report(gpu(), &scene, &earlier(&scene, true), &variant);
        let Verdict::Broken { r#where } = report.verdict(true) else {
            panic!("{name}: {:?}", report.velocity);
        };
        assert!(r#where.starts_with("a velocity is wrong by "), "{where}");
    }
}

#[test]
fn velocities_that_were_not_compared_do_not_hold() {
    let scene = load("wind", SIZE);
    let variant = variant(&scene, "outputs:write=velocity");
    let mut report = report(gpu(), &scene, &earlier(&scene, true), &variant);
    assert_eq!(report.verdict(true), Verdict::Holds);
    report.velocity.as_mut().unwrap().pixels = 0;
    report.velocity.as_mut().unwrap().not_evaluated = Some("it takes too many steps".to_owned());
    let why = "no velocity was compared: it takes too many steps".to_owned();
    assert_eq!(report.verdict(true), Verdict::NotMeasured { why });
}

#[test]
fn verify_draws_auxiliary_pictures_and_judges_them() {
    let scene = load("wind", SIZE);
    let variant = variant(&scene, "outputs:write=velocity");
    let session = Session::new(gpu(), &scene, ShaderForm::Text).unwrap();
    let timed = settings(Timed::Headline);
    let outcome = verify(&session, &[variant], &timed, &mut |_| {}).unwrap();
    let report = outcome.report.variants.into_iter().nth(1).unwrap();
    assert_eq!(report.verdict, Verdict::Holds);
    let outputs = report.outputs.unwrap();
    assert!(outputs.main_ms.is_some() && outputs.time_ms.is_some());
    assert!(outputs.velocity.unwrap().longest > 0.1);
}

#[test]
fn normals_are_those_of_a_geometry_pass_written_by_hand() {
    for normals in normals(gpu(), SIZE) {
        println!("{normals:?}");
        assert!(normals.covered > 1000, "{normals:?}");
        // Roundings of 32-bit floats alone: the two texts may be fused differently.
        assert!(normals.worst < 1e-5, "{normals:?}");
    }
}

/// The light of our pictures stands at the origin, and its range is 100.
#[test]
fn distances_are_those_of_the_points_that_the_depths_say() {
    for subject in moving_scenes(SIZE) {
        let scene = &subject.scene;
        let variant = variant(scene, "outputs:write=distance");
        let plans: Vec<Plan> = variant.plans.iter().map(alone).collect();
        let picture = drawn(gpu(), scene, &plans);
        let frame = scene.cameras[0].frames[0];
        let back = (frame.projection * frame.view).inverse();
        let color = picture.colors[0].clone().unwrap();
        let [width, height] = color.size;
        let depths = picture.depth.unwrap().values;
        let (mut covered, mut worst) = (0, 0.0_f32);
        for (pixel, depth) in depths.into_iter().enumerate() {
            // Far away, a step of the depth is long.
            if depth == 0.0 || depth > 0.995 {
                continue;
            }
            let (x, y) = (pixel as u32 % width, pixel as u32 / width);
            let at =
                [(x, width), (y, height)].map(|(i, n)| (i as f32 + 0.5) / n as f32 * 2.0 - 1.0);
            let world = back * Vec4::new(at[0], -at[1], depth, 1.0);
            let expected = (Vec3::from_slice(&world.to_array()) / world.w).length();
            let [distance, ..] = color.rgba(pixel);
            covered += 1;
            worst = worst.max((distance * 100.0 - expected).abs() / expected.max(1.0));
        }
        println!("{}: {covered} distances, {worst} apart", subject.name);
        assert!(covered > 500, "{}: {covered}", subject.name);
        assert!(worst < 1e-3, "{}: {worst}", subject.name);
    }
}

/// A leaf whose texture coordinates a viewer shifts, and that fades; and what is meant by the shadow
/// without the viewer.
const LEAF: &str = "
struct Camera { view_proj: mat4x4<f32>, eye: vec3<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
struct VertexOut { @builtin(position) clip: vec4<f32>, @location(0) uv: vec2<f32>,
    @location(1) world: vec3<f32> }
@vertex fn vs(@location(0) position: vec3<f32>) -> VertexOut {
    return VertexOut(camera.view_proj * vec4(position, 1.0), position.xy, position);
}
fn alpha_at(uv: vec2<f32>) -> f32 { return 0.5 + 0.5 * sin(uv.x * 9.0) * cos(uv.y * 7.0); }
@fragment fn fs(in: VertexOut) -> @location(0) vec4<f32> {
    SHIFT
    if CUT { discard; }
    return vec4(1.0);
}";

#[test]
fn a_shadow_without_the_viewer_is_that_of_a_shader_without_it() {
    let with = |shift: &str, cut: &str| LEAF.replace("SHIFT", shift).replace("CUT", cut);
    let far = "let far = distance(camera.eye, in.world);";
    let shader = with(far, "far > 10.03 || alpha_at(in.uv) < 0.4");
    let by_hand = with("", "alpha_at(in.uv) < 0.4");
    let [ours, theirs] = [shader, by_hand].map(|text| leaf(&text));
    let mask = |scene: &Scene, recipe: &str| {
        let variant = variant(scene, recipe);
        assert!(variant.kept.is_empty(), "{:?}", variant.kept);
        drawn(gpu(), scene, &[alone(&variant.plans[0])])
            .depth
            .unwrap()
            .values
    };
    let dropped = mask(&ours, "outputs:write=shadow,view=drop");
    let kept = mask(&ours, "outputs:write=shadow");
    let meant = mask(&theirs, "outputs:write=shadow");
    assert!(meant.iter().filter(|d| **d != 1.0).count() > 1000);
    assert_eq!(dropped, meant);
    assert_ne!(kept, meant);
}

/// A square in front of a camera that is 10 away from its middle.
fn leaf(shader: &str) -> Scene {
    let square = Draw {
        values: BTreeMap::new(),
        ..draw("leaf", Mat4::IDENTITY, [1.0; 4])
    };
    scene(SIZE, vec![material("leaf", shader)], vec![square])
}

#[test]
fn ids_are_those_of_draws_and_instances() {
    let scene = load("instanced", SIZE);
    let variant = variant(&scene, "outputs:write=id");
    let session = Session::new(gpu(), &scene, ShaderForm::Text).unwrap();
    let plans: Vec<Plan> = variant.plans.iter().map(alone).collect();
    let mut prepared = session.prepare(&plans).unwrap();
    let frame = scene.cameras[0].frames[0];
    let picture = session
        .draw(&mut prepared, &frame, DrawOrder::FrontToBack)
        .unwrap();
    let color = picture.colors[0].clone().unwrap();
    let mut seen = BTreeSet::new();
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
