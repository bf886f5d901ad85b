//! A range of a parameter, drawn: its table, its plot, its pictures, and what a budget leaves of
//! it.

use std::collections::BTreeMap;

use glam::{Mat4, Vec3};
use preshade_compiler::sweep::Sweep;
use preshade_draw::scene::{Draw, Frame, Scene};
use preshade_lab::measure::record::{Choice, Chosen, SweepReport};
use preshade_lab::measure::{self, Estimate, Session, Settings, Timed, TimingSettings, Verified};
use preshade_plan::budget::Budget;
use preshade_plan::pass::Facts;
use preshade_scenes::ShaderForm;
use preshade_scenes::mesh::Sphere;

use crate::render_support::{self, gpu, material, scene};

const WAVES: &str = "
struct Camera { view_proj: mat4x4<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
struct VertexOut { @builtin(position) clip: vec4<f32>, @location(0) local: vec3<f32> }
@vertex fn vs(@location(0) position: vec3<f32>) -> VertexOut {
    return VertexOut(camera.view_proj * vec4(position, 1.0), position);
}
@fragment fn fs(in: VertexOut) -> @location(0) vec4<f32> {
    let waves = sin(in.local.x * 9.0) * cos(in.local.y * 7.0) * sin(in.local.z * 8.0) * \
        exp(sin(in.local.x * 5.0)) + sin(exp(in.local.y));
    return vec4(0.2, 0.5 + 0.2 * waves, 0.1, 1.0);
}
";

fn sphere() -> Scene {
    let mut scene = scene([120, 100], vec![material("waves", WAVES)], Vec::new());
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
    let eye = Vec3::new(0.3, 0.4, 2.6);
    scene.cameras[0].frames = vec![Frame {
        view: Mat4::look_at_rh(eye, Vec3::ZERO, Vec3::Y),
        projection: Mat4::perspective_rh(0.9, 1.2, 0.1, 10.0),
        eye,
        time: 0.0,
    }];
    scene
}

/// The recipe that the command line makes of `--pass hoist --pass tessellate:level=1..3`, drawn.
fn drawn() -> (Sweep, Vec<String>, Verified) {
    let scene = sphere();
    let steps = ["hoist", "tessellate:level=1..3"].map(str::to_owned);
    let steps = preshade_compiler::sweep::completed(&steps).unwrap();
    let sweep = Sweep::parse_steps(&steps).unwrap();
    let facts = Facts {
        changing: Some(measure::changing(&scene).unwrap()),
        ..Facts::default()
    };
    let originals = measure::originals(&scene);
    let variants: Vec<_> = sweep
        .points
        .iter()
        .map(|p| measure::variant(&originals, &p.recipe, &facts))
        .collect();
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    };
    let outcome = measure::verify(
        &Session::new(gpu(), &scene, ShaderForm::Text).unwrap(),
        &variants,
        &settings,
        &mut |_| {},
    )
    .unwrap();
    let names = variants.into_iter().map(|v| v.name).collect();
    (sweep, names, outcome)
}

fn budget(most: f64) -> Budget {
    Budget::parse(&format!("flip_mean={most}")).unwrap()
}

#[test]
fn a_range_has_a_table_a_plot_and_pictures_a_form() {
    let (
        sweep,
        names,
        Verified {
            report, pictures, ..
        },
    ) = drawn();
    let told = SweepReport::new(&sweep, &names);
    let table = told.table(&report);
    for form in ["form=pulled", "form=shared", "form=static"] {
        assert!(table.contains(&format!("\n{form}\n")), "{table}");
    }
    // Level, then dashes for time and speedup, which were not measured; three errors; evaluations.
    let rows: Vec<Vec<&str>> = table
        .lines()
        .map(|l| l.split_whitespace().collect())
        .filter(|cells: &Vec<&str>| cells.first().is_some_and(|c| c.parse::<u32>().is_ok()))
        .collect();
    assert_eq!(rows.len(), 9, "{table}");
    let column = |rows: &[Vec<&str>], i: usize| -> Vec<f64> {
        rows.iter().map(|r| r[i].parse().unwrap()).collect()
    };
    for series in rows.chunks(3) {
        assert_eq!(column(series, 0), [1.0, 2.0, 3.0]);
        let flip = column(series, 4);
        assert!(flip[0] > flip[1] && flip[1] > flip[2], "{table}");
    }
    let [pulled, shared, kept] = [0, 3, 6].map(|i| &rows[i..i + 3]);
    // Evaluations, those in compute, and those at load.
    assert!(column(pulled, 6)[2] > column(shared, 6)[2], "{table}");
    assert_eq!(column(pulled, 7), [0.0; 3]);
    assert_eq!(column(shared, 7), column(shared, 6));
    assert_eq!(column(kept, 6), [0.0; 3]);
    assert_eq!(column(kept, 8), column(shared, 7));

    // One that is refused says why, once.
    let mut refused = report.clone();
    for variant in refused
        .variants
        .iter_mut()
        .filter(|v| v.name.contains("static"))
    {
        variant.verdict = preshade_plan::contract::Verdict::NotMeasured {
            why: "every material refuses it".to_owned(),
        };
        variant.kept = vec![preshade_lab::measure::record::KeptMaterial {
            material: "waves".to_owned(),
            without: None,
            why: "it moves".to_owned(),
        }];
    }
    let table = told.table(&refused);
    assert!(
        table.contains("form=static\n  not drawn at level 1, 2, 3: it moves\n"),
        "{table}"
    );

    let files = told.files(&report, &pictures).unwrap();
    let named: Vec<&str> = files.iter().map(|f| f.name.as_str()).collect();
    let [plot, sheets @ ..] = &named[..] else {
        panic!("{named:?}")
    };
    assert!(plot.ends_with(".svg"), "{named:?}");
    assert_eq!(sheets.len(), 3, "{named:?}");
    let svg = String::from_utf8(files[0].bytes.clone()).unwrap();
    // Errors, evaluations and memory of three series; no times.
    assert_eq!(svg.matches("<polyline").count(), 3 * 5, "{svg}");
    assert_eq!(svg.matches("not measured").count(), 1);
    for sheet in &files[1..] {
        let picture = image::load_from_memory(&sheet.bytes).unwrap();
        // Three columns of 120 pixels, three rows of 100, and what is around them.
        assert!((360..400).contains(&picture.width()), "{}", sheet.name);
        assert!(
            (300..600).contains(&picture.height()),
            "{}",
            picture.height()
        );
    }
}

#[test]
fn a_budget_leaves_the_fastest_within_it() {
    let (_, names, outcome) = drawn();
    let mut report = outcome.report;
    let flip: Vec<f64> = report.variants[1..]
        .iter()
        .map(|v| v.error.as_ref().unwrap().flip_mean)
        .collect();
    let choose = |report: &_, most| {
        let report: &preshade_lab::measure::record::Report = report;
        let told = Chosen::among(&report.variants, budget(most));
        let said = told.said();
        (told.choice, said)
    };
    // Names are in the order of the text: level, then form.
    let [level_2, level_3] = [3, 6];
    let between = (flip[level_2] + flip[level_3]) / 2.0;
    let (choice, _) = choose(&report, between);
    assert!(
        matches!(&choice, Choice::Within { variant, speedup: None, .. } if *variant == names[level_3]),
        "{choice:?}"
    );
    let (choice, said) = choose(&report, flip[level_3] / 2.0);
    assert!(matches!(choice, Choice::None { .. }), "{choice:?}");
    assert!(said.contains("the best error is"), "{said}");
    assert!(said.contains(&format!("{:.5}", flip[level_3])), "{said}");

    let speed = |report: &mut preshade_lab::measure::record::Report, speeds: [f64; 3]| {
        for (i, variant) in report.variants[1..].iter_mut().enumerate() {
            let median = speeds[i / 3] + 0.01 * (i % 3) as f64;
            variant.speedup = Some(Estimate {
                median,
                low: median,
                high: median,
            });
        }
    };
    speed(&mut report, [3.0, 2.0, 1.5]);
    let (choice, said) = choose(&report, 1.0);
    let Choice::Within { variant, .. } = &choice else {
        panic!("{choice:?}")
    };
    assert_eq!(*variant, names[2], "{said}");
    let (choice, said) = choose(&report, between);
    let Choice::Within { variant, .. } = &choice else {
        panic!("{choice:?}")
    };
    assert_eq!(*variant, names[8], "{said}");
    assert!(said.contains("1.52x"), "{said}");
    // What may be noise is not the best, however large its median.
    report.variants[9].speedup.as_mut().unwrap().low = 0.98;
    let (choice, said) = choose(&report, between);
    let Choice::Within { variant, .. } = &choice else {
        panic!("{choice:?}")
    };
    assert_eq!(*variant, names[7], "{said}");
    for variant in &mut report.variants[1..] {
        variant.speedup.as_mut().unwrap().low = 0.98;
    }
    let (choice, said) = choose(&report, 1.0);
    assert!(matches!(choice, Choice::NoGain { .. }), "{choice:?}");
    assert!(
        said.contains("beyond noise") && said.contains("3.02x [0.98, 3.02]"),
        "{said}"
    );
    speed(&mut report, [3.0, 0.9, 0.5]);
    let (choice, said) = choose(&report, between);
    assert!(matches!(choice, Choice::NoGain { .. }), "{choice:?}");
    assert!(said.contains("No variant within"), "{said}");
}

#[test]
fn a_budget_is_a_metric_and_a_number() {
    assert!(Budget::parse("flip_p99=0.1").is_ok());
    for wrong in [
        "0.02",
        "flipmean=0.02",
        "flip_mean=0",
        "flip_mean=nan",
        "max_abs=2",
    ] {
        assert!(Budget::parse(wrong).is_err(), "{wrong}");
    }
}
