//! A whole verification: rows, verdicts, JSON, table and pictures.

use std::time::Duration;

use preshade_draw::scene::{DrawOrder, Scene};
use preshade_lab::measure::{
    self, Session, Settings, Timed, TimingSettings, Variant, Verified, record, verify,
};
use preshade_lab::report::table;
use preshade_plan::budget::{Budget, Metric};
use preshade_plan::contract::{Assumption, Contract, Surface, Turned, Verdict};
use preshade_plan::plan::Plan;
use preshade_plan::state::CompareFunction;
use preshade_scenes::ShaderForm;

use crate::render_support::*;

fn settings() -> Settings {
    Settings {
        timed: Timed::Headline,
        timing: TimingSettings {
            budget: Duration::from_millis(40),
            min_samples: 4,
            ..TimingSettings::default()
        },
        frames_per_camera: usize::MAX,
        command: "preshade verify planes.toml".to_owned(),
    }
}

fn variant(name: &str, plans: Vec<Plan>) -> Variant {
    Variant {
        name: name.to_owned(),
        recipe: name.to_owned(),
        plans,
        kept: Vec::new(),
    }
}

/// The right picture, a wrong one and a shader that does not compile, on five planes.
fn three(scene: &Scene) -> Vec<Variant> {
    let originals = measure::originals(scene);
    let prepass = originals
        .iter()
        .map(|p| {
            let mut p = with_prepass(p);
            p.contract = Contract::Exact {
                given: vec![Assumption::NoDepthTies],
            };
            p
        })
        .collect();
    let mut wrong = originals.clone();
    wrong[0].passes[0].depth.as_mut().unwrap().compare = CompareFunction::Greater;
    let mut broken = originals;
    broken[0].passes[0].bindings.clear();
    vec![
        variant("prepass:form=equal", prepass),
        variant("wrong", wrong),
        variant("uncompilable", broken),
    ]
}

fn run(scene: &Scene, variants: &[Variant], settings: &Settings) -> Verified {
    let gpu = gpu();
    let mut done = 0.0;
    let outcome = verify(
        &Session::new(gpu, scene, ShaderForm::Text).unwrap(),
        variants,
        settings,
        &mut |p| {
            assert!(p.done >= done && p.done <= 1.0, "{} after {done}", p.done);
            done = p.done;
        },
    )
    .unwrap();
    assert_eq!(done, 1.0);
    outcome
}

#[test]
fn each_variant_gets_its_verdict_and_the_others_stand() {
    let mut scene = planes([64, 48], 5);
    scene.orders = vec![DrawOrder::BackToFront, DrawOrder::FrontToBack];
    let outcome = run(&scene, &three(&scene), &settings());
    let report = &outcome.report;
    let [original, prepass, wrong, uncompilable] = report.variants.as_slice() else {
        panic!("{} variants", report.variants.len());
    };
    assert!(report.is_broken());
    assert_eq!(report.depth_ties, Some(0));

    assert_eq!(original.name, record::ORIGINAL);
    assert_eq!(original.verdict, Verdict::Holds);
    assert_eq!(original.shaded_per_pixel, Some(5.0));
    assert_eq!(original.speedup.unwrap().median, 1.0);

    assert_eq!(prepass.verdict, Verdict::Holds);
    assert_eq!(prepass.shaded_per_pixel, Some(1.0));
    assert_eq!(prepass.by_view.len(), 2);
    assert_eq!(prepass.by_view[1].shaded_per_pixel, Some(1.0));
    assert!(prepass.by_view[0].time_ms.is_some() && prepass.by_view[1].time_ms.is_none());
    assert!(prepass.speedup.unwrap().median > 0.0);
    let cost = prepass.cost.clone().unwrap();
    assert_eq!((cost.pipelines, cost.draw_calls), (2, 10));
    assert_eq!(cost.target_bytes, 64 * 48 * 8);

    let Verdict::Broken { r#where } = &wrong.verdict else {
        panic!("{:?}", wrong.verdict);
    };
    // Nothing is farther than the far plane: the frame stays empty.
    assert_eq!(
        r#where,
        "camera `front` frame 0 back to front: 3072 pixels and 3072 depths differ, the first at 0, \
         0"
    );
    assert_eq!(wrong.error.as_ref().unwrap().changed_pixels, 3072);

    let Verdict::NotMeasured { why } = &uncompilable.verdict else {
        panic!("{:?}", uncompilable.verdict);
    };
    assert!(
        why.contains("the pipeline of pass `main` of material `flat`"),
        "{why}"
    );
    assert!(uncompilable.error.is_none() && uncompilable.by_view.is_empty());
}

#[test]
fn the_json_of_record_has_what_the_design_says() {
    let scene = planes([32, 32], 3);
    let outcome = run(&scene, &three(&scene)[..1], &settings());
    let json: serde_json::Value = serde_json::from_str(&outcome.report.to_json().unwrap()).unwrap();
    assert_eq!(json["schema"], "preshade.verify.v1");
    assert_eq!(json["scene"], "test");
    assert_eq!(json["resolution"], serde_json::json!([32, 32]));
    for key in ["name", "driver", "backend", "kind"] {
        assert!(json["adapter"][key].is_string(), "{key}");
    }
    assert!(["gpu-timestamps", "wall-clock"].contains(&json["clock"].as_str().unwrap()));
    let original = &json["variants"][0];
    assert_eq!(original["name"], "original");
    let v = &json["variants"][1];
    assert_eq!(v["recipe"], "prepass:form=equal");
    assert_eq!(v["contract"]["kind"], "exact");
    assert_eq!(v["contract"]["given"], serde_json::json!(["no-depth-ties"]));
    assert_eq!(v["verdict"]["kind"], "holds");
    for key in [
        "changed_pixels",
        "max_abs",
        "flip_mean",
        "flip_p99",
        "flip_tile",
        "nan_pixels",
        "depth_max_ulp",
    ] {
        assert_eq!(v["error"][key].as_f64(), Some(0.0), "{key}");
    }
    for key in ["median", "low", "high"] {
        assert!(v["time_ms"][key].as_f64().unwrap() > 0.0, "{key}");
        assert!(v["speedup"][key].as_f64().unwrap() > 0.0, "{key}");
    }
    assert!(v["time_ms"]["samples"].as_array().unwrap().len() >= 4);
    assert_eq!(v["shaded_per_pixel"], 1.0);
    let row = &v["by_view"][0];
    assert_eq!(row["camera"], "front");
    assert_eq!(row["order"], "front-to-back");
    assert_eq!(row["frame"], 0);
}

#[test]
fn the_table_is_aligned_and_names_what_broke() {
    let scene = planes([32, 32], 3);
    let mut settings = settings();
    settings.timed = Timed::No;
    let mut variants = three(&scene);
    variants[0].kept.push(record::KeptMaterial {
        material: "glass".to_owned(),
        without: None,
        why: "blended draws never enter the pre-pass".to_owned(),
    });
    let text = table::render(&run(&scene, &variants, &settings).report, false);
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(
        lines[0],
        "Nothing was timed, so nothing is known to be worth shipping. `wrong` is BROKEN: do not \
         ship it."
    );
    assert!(lines[2].starts_with("test, 32x32, on "), "{text}");
    assert_eq!(
        lines[4],
        "variant             verdict       changed px  depths  max abs     FLIP  ms  speedup  \
         shaded/px"
    );
    assert_eq!(
        lines[6],
        "original                                   0       0        0        0   -        -       \
         1.00"
    );
    assert!(
        lines[8].starts_with("wrong               BROKEN              1024    1024   "),
        "{text}"
    );
    assert!(
        lines[9].starts_with("uncompilable        not measured           -       -"),
        "{text}"
    );
    assert!(text.contains("wrong: broken at camera `front` frame 0 front to back: 1024 pixels"));
    assert!(
        text.contains("`glass` as written in `prepass:form=equal`: blended draws never"),
        "{text}"
    );
    assert!(!text.contains('\u{1b}'));
}

#[test]
fn pictures_are_pngs_of_the_right_size_under_safe_names() {
    let mut scene = planes([320, 200], 3);
    scene.orders = vec![DrawOrder::BackToFront];
    let mut settings = settings();
    settings.timed = Timed::No;
    let outcome = run(&scene, &three(&scene)[..2], &settings);
    assert_eq!(outcome.pictures.len(), 2);
    let files = outcome.pictures[0].files().unwrap();
    let names: Vec<&str> = files.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "original.png",
            "prepass-form-equal.png",
            "prepass-form-equal.difference.png",
            "original.overdraw.png",
            "prepass-form-equal.overdraw.png",
            "prepass-form-equal.sheet.png",
        ]
    );
    let decode =
        |f: &shader_text::files::File| image::load_from_memory(&f.bytes).unwrap().to_rgba8();
    for file in &files[..5] {
        assert_eq!(decode(file).dimensions(), (320, 200), "{}", file.name);
    }
    // Three panels a row, two rows.
    let sheet = decode(&files[5]);
    assert!(sheet.width() > 3 * 320 && sheet.height() > 2 * 200);
    // Nothing differs: black. Three layers against one: not the same overdraw.
    assert!(decode(&files[2]).pixels().all(|p| p.0 == [0, 0, 0, 255]));
    assert_ne!(decode(&files[3]), decode(&files[4]));
    // Everything differs, and none of it is invisible.
    let wrong = outcome.pictures[1].files().unwrap();
    assert!(decode(&wrong[2]).pixels().all(|p| p.0[0] >= 16));
    if let Some(dir) = std::env::var_os("PRESHADE_TEST_PICTURES") {
        shader_text::files::write(dir.as_ref(), &files).unwrap();
    }
}

#[test]
fn every_frame_of_a_path_is_compared_up_to_the_limit() {
    let mut scene = planes([16, 16], 2);
    let frame = scene.cameras[0].frames[0];
    scene.cameras[0].frames = (0..10)
        .map(|i| {
            let mut f = frame;
            f.time = i as f32;
            f
        })
        .collect();
    let mut settings = settings();
    settings.timed = Timed::Everything;
    settings.timing.budget = Duration::ZERO;
    settings.frames_per_camera = 5;
    let outcome = run(&scene, &[], &settings);
    let frames: Vec<usize> = outcome.report.variants[0]
        .by_view
        .iter()
        .map(|v| v.frame)
        .collect();
    assert_eq!(frames, [0, 0, 2, 2, 4, 4, 6, 6, 8, 8]);
    // Fragments are counted in each of them, and a path has its slow frames told.
    let original = &outcome.report.variants[0];
    let counted = |v: &record::ViewReport| v.shaded_per_pixel.is_some();
    assert!(original.by_view.iter().all(counted));
    let paths: Vec<(DrawOrder, usize)> = original
        .by_path
        .iter()
        .map(|p| (p.order, p.frames))
        .collect();
    assert_eq!(
        paths,
        [(DrawOrder::FrontToBack, 5), (DrawOrder::BackToFront, 5)]
    );
    assert!(original.by_path.iter().all(|p| p.p95_ms >= p.median_ms));
    let text = table::render(&outcome.report, false);
    assert!(
        text.contains("95% of 5 frames of `front`, back to front, take no longer than: original "),
        "{text}"
    );
}

/// Without a depth test the order decides: right in the headline view, and wrong in the other.
#[test]
fn the_worst_view_is_pictured_where_it_is_not_the_headline() {
    let mut scene = planes([32, 32], 3);
    scene.orders = vec![DrawOrder::BackToFront, DrawOrder::FrontToBack];
    let mut settings = settings();
    settings.timed = Timed::No;
    let mut wrong = measure::originals(&scene);
    wrong[0].passes[0].depth.as_mut().unwrap().compare = CompareFunction::Always;
    let variants = [
        variant("unsorted", wrong),
        variant("same", measure::originals(&scene)),
    ];
    let outcome = run(&scene, &variants, &settings);
    let [unsorted, same] = &outcome.pictures[..] else {
        panic!("{} variants", outcome.pictures.len());
    };
    let names = |p: &record::Pictures| -> Vec<String> {
        p.files().unwrap().into_iter().map(|f| f.name).collect()
    };
    assert_eq!(unsorted.variant, unsorted.original);
    let worst = unsorted.worst.as_ref().unwrap();
    assert!(worst.view.contains("front to back"), "{}", worst.view);
    assert_ne!(worst.variant, unsorted.original);
    assert!(names(unsorted).contains(&"unsorted.worst.difference.png".to_owned()));
    assert_eq!(same.worst, None);
    assert!(!names(same).iter().any(|n| n.contains("worst")));
}

#[test]
fn every_budget_is_told_beside_what_was_measured() {
    let scene = planes([32, 32], 3);
    let mut settings = settings();
    settings.timed = Timed::No;
    let within = |metric: Metric, limit: f64| Contract::Approximate {
        budget: Budget { metric, limit },
        given: Vec::new(),
    };
    let mut plans = measure::originals(&scene);
    plans[0].contract = within(Metric::FlipMean, 0.05).and(within(Metric::MaxAbs, 0.02));
    let outcome = run(&scene, &[variant("off", plans)], &settings);
    let text = table::render(&outcome.report, false);
    assert!(
        text.contains(
            "off: an approximation, flip_mean at most 0.05 (measured 0.00000), max_abs at most \
             0.02 (measured 0.00000)\n"
        ),
        "{text}"
    );
}

#[test]
fn contracts_are_held_to_their_own_terms() {
    let mut error = measure::ErrorLadder {
        changed_pixels: 4,
        max_abs: 1.0 / 255.0,
        max_steps: 1.0,
        flip_mean: 0.002,
        ..Default::default()
    };
    let broken = |c: &Contract, e: &measure::ErrorLadder| measure::verdict::breaks(c, e).is_some();
    let approximate = |limit: f64| Contract::Approximate {
        budget: Budget {
            metric: Metric::FlipMean,
            limit,
        },
        given: Vec::new(),
    };
    let rounding = Contract::Rounding {
        k: 4,
        turned: None,
        given: Vec::new(),
    };
    assert!(broken(&Contract::exact(), &error));
    assert!(!broken(&rounding, &error));
    assert!(!broken(&approximate(0.01), &error));
    assert!(broken(&approximate(0.001), &error));
    // Of two budgets each binds.
    let max_abs = |limit: f64| Contract::Approximate {
        budget: Budget::max_abs(limit),
        given: Vec::new(),
    };
    assert!(!broken(&approximate(0.01).and(max_abs(0.01)), &error));
    assert!(broken(&approximate(0.01).and(max_abs(0.001)), &error));
    assert!(broken(&max_abs(0.01).and(approximate(0.001)), &error));
    // Where a decision may turn on a rounding, a share of the pixels may differ by more than a
    // step; elsewhere none may.
    let turning = |surface| Contract::Rounding {
        k: 4,
        turned: Some(Turned {
            share: 0.001,
            surface,
        }),
        given: Vec::new(),
    };
    (error.pixels, error.beyond_step) = (10_000, 10);
    (error.max_abs, error.max_steps) = (0.5, 127.5);
    assert!(broken(&rounding, &error));
    assert!(!broken(&turning(Surface::Kept), &error));
    error.beyond_step = 11;
    assert!(broken(&turning(Surface::Rounded), &error));
    error.beyond_step = 0;
    (error.max_abs, error.max_steps) = (1.0 / 255.0, 1.0);
    error.changed_depth = 1;
    assert!(broken(&rounding, &error));
    assert!(broken(&turning(Surface::Kept), &error));
    assert!(!broken(&turning(Surface::Rounded), &error));
    error.nan_pixels = 1;
    assert!(broken(&turning(Surface::Rounded), &error));
    error.nan_pixels = 0;
    error.flip_mean = f64::NAN;
    assert!(broken(&approximate(1.0), &error));
}
