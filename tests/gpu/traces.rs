//! Traces of wgpu, replayed: the picture is the one that the app read back itself.

use std::fs;
use std::path::Path;

use preshade::unstable::capture::browser::prepare;
use preshade::unstable::capture::trace::{Wanted, convert};
use preshade::unstable::capture::{self, Capture, Choice, check};
use preshade::unstable::limits::Limits;
use preshade::unstable::measure::{self, Session, Settings, Timed, TimingSettings};
use preshade::unstable::recipe::Recipe;
use preshade::unstable::render::ShaderForm;

use crate::render_support::gpu;

/// The last frames of a trace of `tests/wgpu-trace`.
fn capture(name: &str, frames: usize) -> Capture {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let trace = root.join("fixtures/wgpu-traces").join(name);
    let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("trace-{name}-{frames}"));
    prepare(&out).unwrap();
    let wanted = Wanted {
        frames,
        from: None,
        by: None,
    };
    convert(&trace, &out, &wanted, &Limits::default()).unwrap();
    Capture::open(&out, &Limits::default()).unwrap()
}

#[test]
fn a_trace_is_drawn_as_the_app_drew_it() {
    for name in ["30", "30-offscreen", "29", "29-offscreen"] {
        // From the setup alone, and with all frames before it.
        for frames in [1, 3] {
            let capture = capture(name, frames);
            let found = check(&capture, gpu()).unwrap();
            assert!(found.left_out.is_empty(), "{name}: {:?}", found.left_out);
            let root = Path::new(env!("CARGO_MANIFEST_DIR"));
            let file = root
                .join("fixtures/wgpu-traces")
                .join(name)
                .join("picture.png");
            let theirs = image::load_from_memory(&fs::read(file).unwrap()).unwrap();
            let theirs = theirs.into_rgba8().into_raw();
            let ours = found.pictures.last().unwrap().to_rgba8();
            assert_eq!(ours.len(), theirs.len());
            // Mesa's llvmpipe recorded the traces. Another driver may round otherwise, and cover other pixels at edges.
            let (steps, allowed) = match gpu().adapter().name.contains("llvmpipe") {
                true => (0, 0),
                false => (8, theirs.len() / 4 / 20),
            };
            let is_far =
                |(a, b): &(&[u8], &[u8])| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > steps);
            let pairs = ours.chunks(4).zip(theirs.chunks(4));
            let differ = pairs.filter(is_far).count();
            assert!(
                differ <= allowed,
                "{name}, {frames} frames: {differ} pixels differ"
            );
        }
    }
}

#[test]
fn a_frame_of_a_trace_takes_variants() {
    let capture = capture("29", 1);
    let scene = capture::scene(&capture, Choice::default(), Some(gpu())).unwrap();
    assert_eq!(scene.draws.len(), 2);
    let session = Session::new(gpu(), &scene, ShaderForm::Text).unwrap();
    let facts = measure::facts(&session).unwrap();
    let recipe = Recipe::parse_list("hoist").unwrap();
    let variant = measure::variant(session.originals(), &recipe, &facts);
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    };
    let outcome = measure::verify(&session, &[variant], &settings, &mut |_| ()).unwrap();
    let report = &outcome.report;
    let verdicts: Vec<String> = report
        .variants
        .iter()
        .map(|v| format!("{:?}", v.verdict))
        .collect();
    assert!(verdicts[0].starts_with("Holds"), "{verdicts:?}");
}
