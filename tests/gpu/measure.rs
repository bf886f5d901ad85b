//! Measurement measures: known differences, known overdraw, known ties.

use std::time::Duration;

use glam::{Mat4, Vec3};
use preshade_draw::render::{FrameSettings, Prepared, SceneInputs};
use preshade_draw::scene::{DrawOrder, Scene, Value};
use preshade_lab::measure::error::ulps;
use preshade_lab::measure::timing::estimate;
use preshade_lab::measure::{self, CountProgram, Counter, Discarded, Session, TimingSettings};
use preshade_plan::plan::{GpuPass, Plan};
use preshade_plan::state::{ColorTarget, DepthDirection, DepthFormat};
use preshade_scenes::ShaderForm;

use crate::render_support::*;

fn constant(_: &Plan, _: &GpuPass) -> CountProgram {
    CountProgram::Constant
}

/// Shaded fragments a covered pixel of `plans`, in each order.
fn shaded(scene: &Scene, plans: &[Plan], order: DrawOrder) -> f64 {
    let gpu = gpu();
    let inputs = SceneInputs::new(gpu, scene).unwrap();
    let mut counter = Counter::shaded(&inputs, plans, ShaderForm::Text, constant).unwrap();
    let frame = &scene.cameras[0].frames[0];
    counter.count(frame, order).unwrap().summary().per_pixel
}

#[test]
fn stacked_planes_are_shaded_once_front_to_back_and_each_back_to_front() {
    for samples in [1, 4] {
        for direction in [DepthDirection::Forward, DepthDirection::Reversed] {
            let scene = with_samples(planes([64, 64], 5), samples);
            let scene = with_depth(scene, DepthFormat::Depth32float, direction);
            let plans = originals(&scene);
            assert_eq!(shaded(&scene, &plans, DrawOrder::FrontToBack), 1.0);
            assert_eq!(shaded(&scene, &plans, DrawOrder::BackToFront), 5.0);
            assert_eq!(shaded(&scene, &plans, DrawOrder::AsGiven), 1.0);
            let shuffled = shaded(&scene, &plans, DrawOrder::Shuffled);
            assert!((1.0..5.0).contains(&shuffled), "{shuffled}");
        }
    }
}

#[test]
fn counting_knows_how_much_is_covered() {
    let gpu = gpu();
    // Two squares over the left half and one over all: 3 + 1 fragments a pair of pixels.
    let half = Mat4::from_translation(Vec3::new(-0.5, 0.0, 0.2))
        * Mat4::from_scale(Vec3::new(0.5, 1.0, 1.0));
    let near = Mat4::from_translation(Vec3::new(-0.5, 0.0, 0.1))
        * Mat4::from_scale(Vec3::new(0.5, 1.0, 1.0));
    let all = Mat4::from_translation(Vec3::new(0.0, -0.5, 0.3))
        * Mat4::from_scale(Vec3::new(1.0, 0.5, 1.0));
    let white = [1.0; 4];
    let draws = vec![
        draw("half", half, white),
        draw("near", near, white),
        draw("bottom", all, white),
    ];
    let scene = scene([32, 32], vec![material("flat", FLAT)], draws);
    let inputs = SceneInputs::new(gpu, &scene).unwrap();
    let plans = originals(&scene);
    let mut counter = Counter::shaded(&inputs, &plans, ShaderForm::Ir, constant).unwrap();
    let frame = &scene.cameras[0].frames[0];
    let worst = counter.count(frame, DrawOrder::BackToFront).unwrap();
    assert_eq!(worst.fragments, 3 * 512);
    assert_eq!(worst.covered, 768);
    assert_eq!(worst.counts.at(0, 31, 0), Some(3.0));
    assert_eq!(worst.counts.at(31, 31, 0), Some(1.0));
    assert_eq!(worst.counts.at(31, 0, 0), Some(0.0));
    let best = counter.count(frame, DrawOrder::FrontToBack).unwrap();
    assert_eq!((best.fragments, best.covered), (768, 768));
}

#[test]
fn a_prepass_shades_each_pixel_once_in_any_order() {
    let scene = planes([32, 32], 6);
    let plans: Vec<Plan> = originals(&scene).iter().map(with_prepass).collect();
    for order in [DrawOrder::BackToFront, DrawOrder::Shuffled] {
        assert_eq!(shaded(&scene, &plans, order), 1.0);
    }
}

#[test]
fn a_sliced_counting_stage_keeps_the_discard() {
    let gpu = gpu();
    let holes = FLAT.replace(
        "@fragment fn fs() -> @location(0) vec4<f32> { return object.tint; }",
        "@fragment fn fs(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
             if (u32(at.x) % 2u == 0u) { discard; }
             return object.tint;
         }",
    );
    let counting = holes.replace("return object.tint;", "return vec4(1.0);");
    let mut scene = planes([16, 16], 3);
    scene.materials[0] = material("flat", &holes);
    let inputs = SceneInputs::new(gpu, &scene).unwrap();
    let plans = originals(&scene);
    let sliced = |_: &Plan, _: &GpuPass| CountProgram::Sliced {
        program: program(&counting),
        vertex: "vs".to_owned(),
        fragment: "fs".to_owned(),
    };
    let mut counter = Counter::shaded(&inputs, &plans, ShaderForm::Text, sliced).unwrap();
    let frame = &scene.cameras[0].frames[0];
    let shading = counter.count(frame, DrawOrder::BackToFront).unwrap();
    assert_eq!((shading.fragments, shading.covered), (3 * 128, 128));
}

#[test]
fn a_stage_is_counted_under_the_authors_directives() {
    let mut scene = planes([16, 16], 3);
    let directed = format!("diagnostic(off, derivative_uniformity);\n{FLAT}");
    scene.materials[0] = material("flat", &directed);
    let count = shaded(&scene, &originals(&scene), DrawOrder::BackToFront);
    assert_eq!(count, 3.0);
}

#[test]
fn coplanar_draws_are_ties_and_others_are_not() {
    let gpu = gpu();
    let mut scene = planes([32, 32], 3);
    // A fourth square in the plane of the first, over its right half.
    let z = 0.25;
    scene.draws.push(draw(
        "decal",
        Mat4::from_translation(Vec3::new(0.5, 0.0, z)) * Mat4::from_scale(Vec3::new(0.5, 1.0, 1.0)),
        [1.0; 4],
    ));
    let ties = |scene: &Scene| {
        let inputs = SceneInputs::new(gpu, scene).unwrap();
        let plans = originals(scene);
        let mut counter = Counter::ties(
            &inputs,
            &plans,
            ShaderForm::Text,
            Discarded::LeftOut,
            constant,
        )
        .unwrap();
        let frame = &scene.cameras[0].frames[0];
        counter.ties_in(frame, DrawOrder::BackToFront).unwrap()
    };
    assert_eq!(ties(&scene), 16 * 32);
    assert_eq!(ties(&with_samples(scene.clone(), 4)), 16 * 32 * 4);
    // Behind another surface a tie decides nothing.
    scene.draws[3].transform = Mat4::from_translation(Vec3::new(0.0, 0.0, 0.75));
    assert_eq!(ties(&scene), 0);
    let facts = measure::facts(&Session::new(gpu, &scene, ShaderForm::Text).unwrap()).unwrap();
    assert_eq!(facts.depth_ties, Some(0));
}

#[test]
fn the_error_ladder_tells_what_changed_and_where() {
    let gpu = gpu();
    let scene = planes([16, 8], 1);
    let original = render(gpu, &scene);
    assert!(measure::compare(&original, &original).unwrap().is_exact());

    // A different tint, one step of 8 bits in red alone.
    let mut tinted = scene.clone();
    let tint = vec![2.0 / 255.0, 1.0 / 255.0, 1.0 / 255.0, 1.0];
    tinted.draws[0]
        .values
        .insert("object.tint".to_owned(), Value::Numbers(tint));
    let error = measure::compare(&original, &render(gpu, &tinted)).unwrap();
    assert_eq!((error.changed_pixels, error.changed_alpha), (128, 0));
    assert_eq!((error.changed_depth, error.depth_max_ulp), (0, 0));
    assert!((error.max_abs - 1.0 / 255.0).abs() < 1e-7);
    assert_eq!(error.first_difference, Some([0, 0]));
    assert!(error.flip_mean > 0.0 && error.flip_mean <= error.flip_p99.max(1e-3));

    // Alpha alone.
    let mut clear = scene.clone();
    let tint = vec![1.0 / 255.0, 1.0 / 255.0, 1.0 / 255.0, 0.0];
    clear.draws[0]
        .values
        .insert("object.tint".to_owned(), Value::Numbers(tint));
    let error = measure::compare(&original, &render(gpu, &clear)).unwrap();
    assert_eq!((error.changed_pixels, error.changed_alpha), (128, 128));
    assert_eq!(error.max_abs, 1.0);

    // Depth alone, by one float, in the lower right quarter.
    let mut deeper = original.clone();
    let depth = deeper.depth.as_mut().unwrap();
    for y in 4..8 {
        for x in 8..16 {
            depth.values[y * 16 + x] = f32::from_bits(0.5_f32.to_bits() + 3);
        }
    }
    let error = measure::compare(&original, &deeper).unwrap();
    assert_eq!((error.changed_pixels, error.changed_depth), (0, 32));
    assert_eq!(error.depth_max_ulp, 3);
    assert_eq!(error.first_difference, Some([8, 4]));
    assert!(!error.is_exact());

    // Another size cannot be compared.
    let other = render(gpu, &planes([8, 8], 1));
    assert!(measure::compare(&original, &other).is_err());
}

#[test]
fn nan_and_infinity_are_counted_on_float_targets() {
    let gpu = gpu();
    let mut scene = planes([8, 8], 1);
    scene.materials[0].state.targets = vec![Some(ColorTarget::opaque("rgba16float"))];
    let original = render(gpu, &scene);
    // 1 / 0 from a uniform, so that no compiler folds it.
    let infinite = FLAT.replace(
        "return object.tint;",
        "return object.tint / (object.tint.w - 1.0);",
    );
    let mut broken = scene.clone();
    broken.materials[0] = material("flat", &infinite);
    broken.materials[0].state = scene.materials[0].state.clone();
    let error = measure::compare(&original, &render(gpu, &broken)).unwrap();
    assert_eq!((error.changed_pixels, error.nan_pixels), (64, 64));
    assert_eq!(error.max_abs, f64::INFINITY);
    let error = measure::compare(&original, &original).unwrap();
    assert_eq!(error.nan_pixels, 0);
}

#[test]
fn floats_are_counted_across_zero() {
    assert_eq!(ulps(1.0, 1.0), 0);
    assert_eq!(ulps(0.0, -0.0), 0);
    assert_eq!(ulps(1.0, f32::from_bits(1.0_f32.to_bits() + 7)), 7);
    assert_eq!(ulps(f32::from_bits(2), -f32::from_bits(3)), 5);
}

#[test]
fn timing_is_interleaved_positive_and_told_with_its_samples() {
    let gpu = gpu();
    let scene = planes([64, 64], 2);
    let inputs = SceneInputs::new(gpu, &scene).unwrap();
    let variant = preshade_scenes::variant(&originals(&scene), ShaderForm::Text).unwrap();
    let settings = FrameSettings::of(&scene);
    let a = Prepared::new(&inputs, &variant, &settings).unwrap();
    let b = Prepared::new(&inputs, &variant, &settings).unwrap();
    assert_eq!(a.creation().0, 1);
    assert_eq!(a.draw_calls(), 2);
    let timing = TimingSettings {
        budget: Duration::from_millis(50),
        min_samples: 4,
        ..TimingSettings::default()
    };
    let mut last = 0.0;
    let (_, times) = measure::time(gpu, &[&a, &b], &timing, |part| last = part).unwrap();
    assert_eq!(last, 1.0);
    assert_eq!(times.len(), 2);
    for t in &times {
        assert!(t.time.samples.len() + t.rejected as usize >= 4);
        assert!(t.time.samples.iter().all(|ms| *ms > 0.0));
        let e = t.time.estimate;
        assert!(0.0 < e.low && e.low <= e.median && e.median <= e.high);
    }
    assert_eq!(times[0].time.samples.len() % 2, 0);
    assert_eq!(times[0].speedup.median, 1.0);
}

#[test]
fn invocations_are_the_adapters_own_count() {
    let gpu = gpu();
    let scene = planes([64, 64], 3);
    let inputs = SceneInputs::new(gpu, &scene).unwrap();
    let plans: Vec<Plan> = originals(&scene).iter().map(with_prepass).collect();
    let variant = preshade_scenes::variant(&plans, ShaderForm::Text).unwrap();
    let prepared = Prepared::new(&inputs, &variant, &FrameSettings::of(&scene)).unwrap();
    let counted = measure::statistics::invocations(gpu, &prepared).unwrap();
    match counted {
        None => assert!(!gpu.has_pipeline_statistics()),
        Some(n) => {
            // Two passes of three squares: four vertices each where all reuse is found, six where
            // none is.
            assert!((24..=36).contains(&n.vertex), "{n:?}");
            // One main pass under EQUAL shades each pixel once; a quad's helper lanes are none
            // here.
            assert!(n.fragment.is_none_or(|f| f >= 64 * 64), "{n:?}");
        }
    }
}

#[test]
fn the_bootstrap_is_seeded_and_holds_the_median() {
    let values: Vec<f64> = (1..=41).map(f64::from).collect();
    let e = estimate(&values, 7);
    assert_eq!(e, estimate(&values, 7));
    assert_eq!(e.median, 21.0);
    assert!(
        e.low < 21.0 && 21.0 < e.high && e.low > 10.0 && e.high < 32.0,
        "{e:?}"
    );
    assert!(estimate(&[], 7).median.is_nan());
}

/// Two materials of one shader and one state have one pipeline, and a frame drawn again has none of
/// its own.
#[test]
fn frames_that_share_pipelines_draw_the_same() {
    let mut scene = planes([32, 32], 3);
    let mut twin = scene.materials[0].clone();
    twin.name = "twin".to_owned();
    scene.materials.push(twin);
    scene.draws[0].material = 1;
    let frames = [&scene.cameras[0].frames[0]];
    let plans: Vec<Plan> = originals(&scene).iter().map(with_prepass).collect();
    let own = Session::new(gpu(), &scene, ShaderForm::Text).unwrap();
    let shared = Session::sharing(gpu(), &scene, ShaderForm::Text).unwrap();
    for order in [DrawOrder::FrontToBack, DrawOrder::BackToFront] {
        let expected = own.pictures(&plans, &frames, order).unwrap();
        for _ in 0..2 {
            assert_eq!(shared.pictures(&plans, &frames, order).unwrap(), expected);
        }
    }
}
