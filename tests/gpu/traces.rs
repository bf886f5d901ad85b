//! Traces of wgpu, replayed: the picture is the one that the recorded app draws on the same adapter.

use std::path::Path;
use std::sync::OnceLock;

use preshade_compiler::recipe::Recipe;
use preshade_frames::browser::prepare;
use preshade_frames::folder::Capture;
use preshade_frames::trace::{FrameChoice, convert};
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings};
use preshade_scenes::ShaderForm;
use preshade_scenes::capture::{self, Choice, check};
use shader_text::limits::Limits;
use tempfile::TempDir;

use crate::render_support::gpu;

#[path = "../wgpu-trace/src/scene.rs"]
#[expect(
    unexpected_cfgs,
    reason = "the app draws with two versions of wgpu, a feature each"
)]
mod scene;

/// The last frame of the app, drawn on the tests' adapter.
fn drawn() -> &'static [u8] {
    static DRAWN: OnceLock<Vec<u8>> = OnceLock::new();
    DRAWN.get_or_init(|| {
        let wanted = gpu().adapter();
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapters = instance.enumerate_adapters(wgpu::Backends::all());
        let adapter = pollster::block_on(adapters).into_iter().find(|a| {
            let info = a.get_info();
            (info.name, info.backend.to_str()) == (wanted.name.clone(), wanted.backend.as_str())
        });
        let (device, queue) =
            pollster::block_on(adapter.unwrap().request_device(&Default::default())).unwrap();
        let format = wgpu::TextureFormat::Rgba8UnormSrgb;
        let scene = scene::Scene::new(&device, &queue, format);
        let target = scene::target(&device, format);
        for frame in 0..scene::FRAMES {
            scene.frame(&device, &queue, &target, frame);
        }
        scene::read(&device, &queue, &target)
    })
}

/// The last frames of a trace of `tests/wgpu-trace`, and the folder that has them.
fn capture(name: &str, frames: usize) -> (TempDir, Capture) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let trace = root.join("fixtures/wgpu-traces").join(name);
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let out = folder.path().join("frame");
    prepare(&out).unwrap();
    let wanted = FrameChoice {
        frames,
        from: None,
        by: None,
    };
    convert(&trace, &out, &wanted, &Limits::default()).unwrap();
    let capture = Capture::open(&out, &Limits::default()).unwrap();
    (folder, capture)
}

#[test]
fn a_trace_is_drawn_as_the_app_drew_it() {
    for name in ["30", "30-offscreen", "29", "29-offscreen"] {
        // From the setup alone, and with all frames before it.
        for frames in [1, 3] {
            let (_folder, capture) = capture(name, frames);
            let found = check(&capture, gpu()).unwrap();
            assert!(found.left_out.is_empty(), "{name}: {:?}", found.left_out);
            let ours = found.pictures.last().unwrap().to_rgba8();
            assert_eq!(ours.len(), drawn().len());
            let pairs = ours.chunks(4).zip(drawn().chunks(4));
            let differ = pairs.filter(|(a, b)| a != b).count();
            assert_eq!(differ, 0, "{name}, {frames} frames");
        }
    }
}

#[test]
fn a_frame_of_a_trace_takes_variants() {
    let (_folder, capture) = capture("29", 1);
    let passes = capture::passes(&capture, 0).unwrap();
    let choice = Choice {
        frame: 0,
        pass: passes.iter().position(|p| p.descriptor.label == "main"),
    };
    let scene = capture::scene(&capture, choice, Some(gpu())).unwrap();
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
