//! Auxiliary pictures, drawn: depths as of the whole program, velocities as the positions of two
//! frames say, normals as of a geometry pass that was written by hand, distances as the depths say.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec3, DVec4, Mat4, Vec3};
use preshade_draw::scene::{Draw, Scene, Value};
use preshade_lab::measure::outputs::{self, MOST_LEFT_OUT, TOLERANCE};
use preshade_lab::measure::{Session, Timed, originals, verify};
use preshade_plan::contract::Verdict;
use preshade_plan::plan::{BindingSource, Plan, Role};
use preshade_plan::reflect;
use preshade_scenes::ShaderForm;

use crate::outputs_support::{
    Row, Subject, alone, drawn, drawn_after, earlier, fixtures, limited, load, moving_scenes,
    normals, report, row, settings, variant,
};
use crate::render_support::*;

/// Large enough for `skinned` to have more than a thousand pixels.
const SIZE: [u32; 2] = [240, 135];

/// Vertices of each draw that the interpreter, which is not optimised here, evaluates in time.
const VERTICES: u32 = 40_000;

#[test]
fn no_auxiliary_depth_differs_from_the_whole_programs() {
    for subject in moving_scenes(SIZE, VERTICES) {
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
        let (pixels, left_out, _, worst) = row.velocity.unwrap();
        // Matched by chance: in the made-up scene of one fixture, the camera stands among the instances.
        if left_out > pixels {
            continue;
        }
        assert!(worst <= TOLERANCE, "{row:?}");
    }
    // Where too little was compared, nothing holds.
    for row in &applied {
        let (pixels, left_out, ..) = row.velocity.unwrap_or_default();
        let most = (pixels + left_out) as f64 * MOST_LEFT_OUT;
        let is_enough = pixels > 0 && left_out as f64 <= most;
        assert_eq!(row.holds, is_enough, "{row:?}");
    }
    let holding = applied.iter().filter(|r| r.holds).count();
    assert!(holding >= 30, "{holding}");
    assert!(pixels > 15_000, "{pixels}");
}

#[test]
fn velocities_are_those_of_the_positions_in_two_frames() {
    for subject in moving_scenes(SIZE, VERTICES) {
        for precision in ["full", "half"] {
            let write = format!("velocity,precision={precision}");
            let row = row(gpu(), &subject, &write, Timed::No);
            println!("{row:?}");
            let (pixels, left_out, longest, worst) = row.velocity.unwrap();
            assert!(worst <= TOLERANCE, "{row:?}");
            // Everything moved, and most of the picture was compared.
            assert!(longest > 0.5, "{row:?}");
            assert!(pixels > 1000, "{row:?}");
            let most = (pixels + left_out) as f64 * MOST_LEFT_OUT;
            assert!(left_out as f64 <= most, "{row:?}");
            assert!(row.holds, "{row:?}");
        }
    }
}

/// The scene's plan, drawing the interpolated clip position of `fixtures/scenes/stability/surface.wgsl`.
fn clip_positions(scene: &Scene) -> Plan {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/fixtures/scenes/stability/surface.wgsl"
    );
    let text = std::fs::read_to_string(path).unwrap();
    let (before, _) = text.split_once("@fragment").unwrap();
    let text = before
        .replace(
            "@location(1) uv: vec2<f32>,\n}",
            "@location(1) uv: vec2<f32>,\n@location(2) at: vec4<f32>,\n}",
        )
        .replace("world.xyz, uv)", "world.xyz, uv, camera.view_proj * world)");
    let fragment = "@fragment fn fs(in: VertexOut) -> @location(0) vec4<f32> { return in.at; }";
    let program = program(&format!("{text}{fragment}"));
    let mut plan = originals(scene).remove(0);
    let pass = &mut plan.passes[0];
    pass.targets[0].as_mut().unwrap().format = "rgba32float".to_owned();
    reflect::fill(pass, &program);
    plan.programs.insert(pass.program.clone(), program);
    plan
}

/// A velocity is exact as far as the adapter interpolates at the centre of a pixel. Prints both errors, in pixels: where a
/// velocity is further off than its tolerance, so is the clip position of that adapter.
#[test]
fn velocities_are_off_where_clip_positions_are() {
    let mut scene = load("stability/grazing", [160, 96]);
    let size = scene.size;
    let at = drawn(gpu(), &scene, &[clip_positions(&scene)]);
    let depths = at.depth.clone().unwrap().values;
    let clips = at.colors[0].clone().unwrap();
    let (mut covered, mut apart, mut of) = (0, 0.0_f64, [0; 2]);
    for (pixel, depth) in depths.into_iter().enumerate() {
        let [x, y, _, w] = clips.rgba(pixel).map(f64::from);
        if depth == 0.0 || depth == 1.0 {
            continue;
        }
        covered += 1;
        let place = [pixel as u32 % size[0], pixel as u32 / size[0]];
        let [column, row] = place.map(|p| f64::from(p) + 0.5);
        let [wide, high] = size.map(f64::from);
        let off = [
            (x / w * 0.5 + 0.5) * wide - column,
            (0.5 - y / w * 0.5) * high - row,
        ];
        let off = off[0].abs().max(off[1].abs());
        if off > apart {
            (apart, of) = (off, place);
        }
    }
    scene.orders.truncate(1);
    let subject = Subject {
        name: "grazing".to_owned(),
        scene,
        moving: "",
    };
    let row = row(gpu(), &subject, "velocity+id", Timed::No);
    let (_, _, _, worst) = row.velocity.unwrap();
    println!(
        "clip positions: {apart:.5} pixels off at {of:?}; velocities: {worst:.5} of {TOLERANCE:.5}"
    );
    assert!(covered > 5000, "{covered}");
    assert!(worst <= TOLERANCE || apart > TOLERANCE, "{worst}, {apart}");
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
        let moved = outputs::earlier(&scene, &|_, _| true);
        let report = report(gpu(), &scene, &moved, &variant);
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
    let mut report = report(gpu(), &scene, &earlier(&scene, &variant), &variant);
    assert_eq!(report.verdict(true), Verdict::Holds);
    let velocity = report.velocity.as_mut().unwrap();
    (velocity.pixels, velocity.left_out) = (940, 60);
    velocity.not_evaluated = Some("it takes too many steps".to_owned());
    let why = "the velocities of 6.0 % of the pixels were not compared: it takes too many steps";
    let why = why.to_owned();
    assert_eq!(report.verdict(true), Verdict::NotMeasured { why });
    report.velocity.as_mut().unwrap().pixels = 0;
    let why = "no velocity was compared: it takes too many steps".to_owned();
    assert_eq!(report.verdict(true), Verdict::NotMeasured { why });
}

/// The names of the buffers that a material's plans copy.
fn copied(plans: &[Plan]) -> BTreeSet<String> {
    let passes = plans.iter().flat_map(|plan| &plan.passes);
    let sources = passes.flat_map(|pass| &pass.bindings).map(|b| &b.source);
    let names = sources.filter_map(|source| match source {
        BindingSource::Previous { of, .. } => Some(of.clone()),
        _ => None,
    });
    names.collect()
}

/// With what a scene's own files tell: its frames move no object, and its plans must still copy
/// what moves one.
#[test]
fn what_moves_an_object_is_copied_and_verify_moves_it() {
    for (name, moving, buffers) in [
        ("morphed", "", ["object"]),
        ("skinned", "", ["joint_matrices"]),
        ("crowd", ",moving=instance_place", ["scene"]),
    ] {
        let scene = limited(load(name, SIZE), VERTICES);
        let variant = variant(&scene, &format!("outputs:write=velocity{moving}"));
        let copied = copied(&variant.plans);
        for buffer in buffers {
            assert!(copied.contains(buffer), "{name}: {copied:?}");
        }
        let before = earlier(&scene, &variant);
        for (before, now) in before.draws.iter().zip(&scene.draws) {
            assert_ne!(before.transform, now.transform, "{name}");
            assert!(
                now.joints.is_empty() || before.joints != now.joints,
                "{name}"
            );
            let weights = (&before.morph_weights, &now.morph_weights);
            assert!(
                weights.1.iter().all(|w| *w == 0.0) || weights.0 != weights.1,
                "{name}"
            );
        }
        let report = report(gpu(), &scene, &before, &variant);
        println!("{name}: {:?}", report.velocity);
        assert_eq!(report.verdict(true), Verdict::Holds, "{name}");
    }
}

/// What a recipe calls static stays where it is in `verify`.
#[test]
fn verify_believes_what_a_recipe_calls_static() {
    let scene = load("morphed", SIZE);
    let variant = variant(&scene, "outputs:write=velocity,static=object");
    let before = earlier(&scene, &variant);
    for (before, now) in before.draws.iter().zip(&scene.draws) {
        assert_eq!(before.transform, now.transform);
        assert_eq!(before.morph_weights, now.morph_weights);
    }
    let report = report(gpu(), &scene, &before, &variant);
    assert_eq!(report.verdict(true), Verdict::Holds);
}

/// A square that moves along itself, so that each of its pixels has the same velocity.
const SHIFTED: &str = "
struct Camera { view_proj: mat4x4<f32>, jitter: array<vec4<f32>, 2>, frame: u32 }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<uniform> model: mat4x4<f32>;
fn project(c: Camera, world: vec4<f32>) -> vec4<f32> {
    var clip = c.view_proj * world;
    clip += vec4(c.jitter[c.frame].xy * clip.w, 0.0, 0.0);
    return clip;
}
@vertex fn vs(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> {
    return project(camera, model * vec4(position, 1.0));
}
@fragment fn fs() -> @location(0) vec4<f32> { return vec4(1.0); }";

#[test]
fn velocities_without_jitter_are_those_of_a_jitter_of_0() {
    let velocity = |scale: f32, jitter: &str| {
        let mut scene = leaf(SHIFTED);
        let mut earlier = scene.clone();
        scene.draws[0].transform = Mat4::from_translation(Vec3::new(0.0, 0.0, 0.5));
        earlier.draws[0].transform = Mat4::from_translation(Vec3::new(0.2, 0.1, 0.5));
        for (scene, at) in [(&mut scene, [0.02, -0.03]), (&mut earlier, [-0.01, 0.04])] {
            let [x, y] = at.map(|n: f32| n * scale);
            let both = [0.7, 0.7, 0.0, 0.0, x, y, 0.0, 0.0];
            let values = &mut scene.draws[0].values;
            values.insert("camera.jitter".to_owned(), numbers(&both));
            values.insert("camera.frame".to_owned(), numbers(&[1.0]));
        }
        let recipe = format!("outputs:write=velocity,precision=full{jitter}");
        let variant = variant(&scene, &recipe);
        assert!(variant.kept.is_empty(), "{:?}", variant.kept);
        let picture = drawn_after(gpu(), &earlier, &scene, &[alone(&variant.plans[0])]);
        let color = picture.colors[0].clone().unwrap();
        let depths = picture.depth.unwrap().values.into_iter().enumerate();
        let covered = depths.filter(|(_, depth)| *depth != 0.0 && *depth != 1.0);
        let all: Vec<[f32; 4]> = covered.map(|(pixel, _)| color.rgba(pixel)).collect();
        assert!(all.len() > 1000, "{}", all.len());
        let [x, y, ..] = all[0];
        let is_same = |v: &[f32; 4]| (v[0] - x).abs() < 1e-6 && (v[1] - y).abs() < 1e-6;
        assert!(all.iter().all(is_same));
        [x, y]
    };
    let meant = velocity(0.0, "");
    let ours = velocity(1.0, ",jitter=camera.jitter");
    let jittered = velocity(1.0, "");
    println!("{meant:?} {ours:?} {jittered:?}");
    let apart = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
    assert!(apart(meant, [0.0; 2]) > 1e-3);
    assert!(apart(ours, meant) < 1e-6);
    // The two jitters are (0.03, -0.07) apart, in parts of half a picture.
    assert!(apart(jittered, [meant[0] + 0.015, meant[1] + 0.035]) < 1e-5);
}

fn numbers(all: &[f32]) -> Value {
    Value::Numbers(all.iter().copied().map(f64::from).collect())
}

#[test]
fn verify_draws_auxiliary_pictures_and_judges_them() {
    let scene = load("wind", SIZE);
    let variant = variant(&scene, "outputs:write=velocity");
    let session = Session::new(gpu(), &scene, ShaderForm::Text).unwrap();
    let timed = settings(Timed::Headline);
    let outcome = verify(&session, &[variant], &timed, &mut |_| {}).unwrap();
    // Nothing is drawn where it is black, and the longest velocity is as far from grey as can be.
    let (name, picture) = &outcome.pictures[0].outputs[0];
    assert_eq!(name, "velocity");
    let mut colors: BTreeSet<&[u8]> = picture.rgba.chunks(4).collect();
    assert!(colors.remove(&[0, 0, 0, 255][..]) && colors.len() > 20);
    assert!(
        colors
            .iter()
            .any(|c| c[..2].iter().any(|n| matches!(n, 0 | 255)))
    );
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
        assert!(normals.worst <= 4.0 * f32::EPSILON, "{normals:?}");
    }
}

/// The vector that Cigolle et al. encode as two numbers.
fn decoded([x, y]: [f32; 2]) -> Vec3 {
    let mut v = Vec3::new(x, y, 1.0 - x.abs() - y.abs());
    if v.z < 0.0 {
        let sign = |n: f32| if n >= 0.0 { 1.0 } else { -1.0 };
        (v.x, v.y) = ((1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y));
    }
    v.normalize()
}

#[test]
fn octahedral_normals_are_the_normals() {
    let (mut signs, mut worst) = (BTreeMap::new(), 0.0_f32);
    for name in ["morphed", "atrium"] {
        let scene = load(name, SIZE);
        let picture = |recipe: &str| {
            let plans = variant(&scene, recipe).plans;
            let plans = plans.iter().filter(|p| has_outputs(p)).map(alone);
            drawn(gpu(), &scene, &plans.collect::<Vec<_>>())
        };
        let plain = picture("outputs:write=normal,precision=full");
        let encoded = picture("outputs:write=normal,precision=full,octahedral=true");
        let depths = plain.depth.clone().unwrap().values;
        let [plain, encoded] = [plain, encoded].map(|picture| picture.colors[0].clone().unwrap());
        for (pixel, depth) in depths.into_iter().enumerate() {
            if depth == 0.0 || depth == 1.0 {
                continue;
            }
            let expected = Vec3::from_slice(&plain.rgba(pixel)).normalize();
            let [x, y, ..] = encoded.rgba(pixel);
            worst = worst.max((decoded([x, y]) - expected).abs().max_element());
            *signs.entry(expected.z < 0.0).or_insert(0) += 1;
        }
    }
    println!("{signs:?}, {worst} apart");
    // Vectors with a negative z are folded over the edges of the square.
    assert!(
        signs.len() == 2 && signs.values().all(|count| *count > 100),
        "{signs:?}"
    );
    assert!(worst < 1e-6, "{worst}");
}

fn has_outputs(plan: &Plan) -> bool {
    plan.passes.iter().any(|pass| pass.role == Role::Outputs)
}

/// The point of the world at a pixel's centre and a depth, in the first frame of a scene.
fn points(scene: &Scene, [width, height]: [u32; 2]) -> impl Fn(u32, u32, f64) -> DVec3 {
    let frame = scene.cameras[0].frames[0];
    let back = (frame.projection.as_dmat4() * frame.view.as_dmat4()).inverse();
    move |x, y, depth| {
        let [x, y] =
            [(x, width), (y, height)].map(|(i, n)| (f64::from(i) + 0.5) / f64::from(n) * 2.0 - 1.0);
        let world = back * DVec4::new(x, -y, depth, 1.0);
        world.truncate() / world.w
    }
}

/// The light of our pictures stands at (3, 2, -1), and its range is 7.
#[test]
fn distances_are_those_of_the_points_that_the_depths_say() {
    for subject in moving_scenes(SIZE, VERTICES) {
        let scene = &subject.scene;
        let variant = variant(scene, "outputs:write=distance");
        let plans: Vec<Plan> = variant.plans.iter().map(alone).collect();
        let picture = drawn(gpu(), scene, &plans);
        let color = picture.colors[0].clone().unwrap();
        let point = points(scene, color.size);
        let [width, _] = color.size;
        let depths = picture.depth.unwrap().values;
        let (mut covered, mut worst) = (0, 0.0_f64);
        for (pixel, depth) in depths.into_iter().enumerate() {
            if depth == 0.0 || depth == 1.0 {
                continue;
            }
            let (x, y) = (pixel as u32 % width, pixel as u32 / width);
            let distance = |depth: f64| point(x, y, depth).distance(DVec3::new(3.0, 2.0, -1.0));
            let depth = f64::from(depth);
            let expected = distance(depth);
            // Far away, a step of the depth is long.
            let steps = 8.0 * f64::from(f32::EPSILON);
            let slack = (distance(depth + steps) - distance(depth - steps)).abs();
            let [drawn, ..] = color.rgba(pixel);
            covered += 1;
            let apart = (f64::from(drawn) * 7.0 - expected).abs() - slack;
            worst = worst.max(apart / expected.max(1.0));
        }
        println!("{}: {covered} distances, {worst} apart", subject.name);
        assert!(covered > 1000, "{}: {covered}", subject.name);
        assert!(worst < 2e-5, "{}: {worst}", subject.name);
    }
}

/// The normal of the triangle is that of three neighbouring points that the depths say, and turns to the viewer.
#[test]
fn faces_are_those_of_the_points_that_the_depths_say() {
    // Large enough for triangles of several pixels.
    for subject in moving_scenes(SIZE.map(|n| 4 * n), VERTICES) {
        let scene = &subject.scene;
        let variant = variant(
            scene,
            "outputs:write=normal,faces=right-handed,precision=full",
        );
        assert!(variant.kept.is_empty(), "{:?}", variant.kept);
        let plans: Vec<Plan> = variant.plans.iter().map(alone).collect();
        let picture = drawn(gpu(), scene, &plans);
        let eye = scene.cameras[0].frames[0]
            .view
            .as_dmat4()
            .inverse()
            .w_axis
            .truncate();
        let color = picture.colors[0].clone().unwrap();
        let [width, height] = color.size;
        let depths = picture.depth.unwrap().values;
        let drawn = |x: u32, y: u32| {
            let pixel = (y * width + x) as usize;
            let depth = f64::from(depths[pixel]);
            let normal = DVec3::from_slice(&color.rgba(pixel).map(f64::from));
            (depth != 0.0 && depth != 1.0).then_some((normal, depth))
        };
        let point = points(scene, color.size);
        let (mut covered, mut compared, mut worst) = (0, 0, 0.0_f64);
        for (x, y) in (1..height - 1).flat_map(|y| (1..width - 1).map(move |x| (x, y))) {
            let Some((normal, depth)) = drawn(x, y) else {
                continue;
            };
            let here = point(x, y, depth);
            assert!((normal.length() - 1.0).abs() < 1e-5, "{normal}");
            assert!(normal.dot(eye - here) > 0.0, "{}: {normal}", subject.name);
            covered += 1;
            let beside = [(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)].map(|(x, y)| drawn(x, y));
            let [Some(right), Some(left), Some(below), Some(above)] = beside else {
                continue;
            };
            // Depth is linear in the picture where all are of one plane.
            let is_flat =
                |a: f64, b: f64| (a + b - 2.0 * depth).abs() <= 2.0 * f64::from(f32::EPSILON);
            let is_same = |other: DVec3| (other - normal).length() < 1e-3;
            if !is_flat(right.1, left.1)
                || !is_flat(below.1, above.1)
                || ![right, left, below, above].iter().all(|(n, _)| is_same(*n))
            {
                continue;
            }
            let across = point(x + 1, y, right.1) - here;
            let down = point(x, y + 1, below.1) - here;
            compared += 1;
            worst = worst.max((down.cross(across).normalize() - normal).length());
        }
        println!(
            "{}: {covered} normals, {compared} compared, {worst} apart",
            subject.name
        );
        assert!(covered > 1000, "{}: {covered}", subject.name);
        // Small triangles have no three neighbours.
        assert!(compared > 50, "{}: {compared}", subject.name);
        assert!(worst < 0.02, "{}: {worst}", subject.name);
    }
}

/// Each of the two turns the normal round.
#[test]
fn faces_follow_the_axes_and_the_y_of_the_clip_position() {
    let scene = moving_scenes(SIZE, VERTICES).swap_remove(0).scene;
    let normals = |more: &str| {
        let recipe = format!("outputs:write=normal,precision=full,faces={more}");
        let variant = variant(&scene, &recipe);
        assert!(variant.kept.is_empty(), "{:?}", variant.kept);
        let plans: Vec<Plan> = variant.plans.iter().map(alone).collect();
        let picture = drawn(gpu(), &scene, &plans);
        let color = picture.colors[0].clone().unwrap();
        let depths = picture.depth.unwrap().values.into_iter().enumerate();
        let covered = depths.filter(|(_, depth)| *depth != 0.0 && *depth != 1.0);
        let normals = covered.map(|(pixel, _)| Vec3::from_slice(&color.rgba(pixel)));
        normals.collect::<Vec<Vec3>>()
    };
    let expected = normals("right-handed,y=up");
    assert!(expected.len() > 1000, "{}", expected.len());
    for (more, sign) in [
        ("right-handed,y=down", -1.0),
        ("left-handed,y=up", -1.0),
        ("left-handed,y=down", 1.0),
    ] {
        let turned: Vec<Vec3> = normals(more).into_iter().map(|n| n * sign).collect();
        assert!(turned == expected, "{more}");
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

/// The draw and the instance of each pixel, and its depth.
fn ids(scene: &Scene) -> Vec<([u32; 2], f32)> {
    let variant = variant(scene, "outputs:write=id");
    let plans: Vec<Plan> = variant.plans.iter().map(alone).collect();
    let picture = drawn(gpu(), scene, &plans);
    let color = picture.colors[0].clone().unwrap();
    let depths = picture.depth.unwrap().values.into_iter().enumerate();
    let id = |pixel: usize| {
        let words = color.texel(pixel).as_chunks::<4>().0;
        [0, 1].map(|i| u32::from_le_bytes(words[i]))
    };
    depths.map(|(pixel, depth)| (id(pixel), depth)).collect()
}

/// A pixel has the depth of its draw alone, and of the first instances of it exactly if its
/// instance is one of them.
#[test]
fn ids_are_those_of_draws_and_instances() {
    let scene = load("instanced", SIZE);
    let all = ids(&scene);
    let background = all.iter().filter(|(id, _)| *id == [0, 0]).count();
    assert!(background > 100 && background < all.len() - 1000);
    for (index, instances) in [(0, 180), (1, 36)] {
        for first in [instances, instances / 2, 7] {
            let mut one = scene.clone();
            one.draws = vec![scene.draws[index].clone()];
            one.draws[0].instances = first;
            let (mut seen, mut hidden) = (0, 0);
            for ((id, depth), (own, own_depth)) in all.iter().zip(ids(&one)) {
                let [draw, instance] = *id;
                if draw != index as u32 + 1 {
                    continue;
                }
                if instance < first {
                    seen += 1;
                    assert_eq!((own, own_depth), ([1, instance], *depth));
                } else {
                    hidden += 1;
                    assert_ne!(own_depth, *depth);
                }
            }
            println!(
                "draw {draw}: {seen} pixels of the first {first}, {hidden} of others",
                draw = index + 1
            );
            assert!(seen > 10 && (hidden > 10) == (first < instances));
        }
    }
}
