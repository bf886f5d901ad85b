//! Captured frames: replayed, and as scenes.

use std::fs;

use preshade_compiler::recipe::Recipe;
use preshade_frames::folder::Capture;
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings};
use preshade_scenes::ShaderForm;
use preshade_scenes::capture::{self, Choice, check};
use shader_text::limits::Limits;

use crate::capture_support::{SIZE, folder, point};
use crate::render_support::{gpu, render};

/// The main pass. Which one takes longest depends on the machine.
const QUADS: Choice = Choice {
    frame: 0,
    pass: Some(1),
};

#[test]
fn a_captured_frame_is_drawn_as_it_was_and_takes_variants() {
    let own = folder();
    let path = own.write("drawn");
    let capture = Capture::open(&path, &Limits::default()).unwrap();
    let found = check(&capture, gpu()).unwrap();
    assert!(found.left_out.is_empty(), "{:?}", found.left_out);
    let frame = &found.frames[0];
    assert_eq!((frame.pixels, frame.differ), (u64::from(SIZE * SIZE), 0));

    let scene = capture::scene(&capture, QUADS, Some(gpu())).unwrap();
    let names: Vec<&str> = scene.materials.iter().map(|m| m.name.as_str()).collect();
    assert_eq!((names, scene.draws.len()), (vec!["quads"], 2));
    assert!(
        scene.notes.iter().any(|n| n.contains("the page's, in all")),
        "{:?}",
        scene.notes
    );
    assert!(
        scene
            .notes
            .iter()
            .any(|n| n.contains("each material's draws take: `quads`")),
        "{:?}",
        scene.notes
    );
    // The texture has what the earlier pass drew, so the scene's picture is the frame's.
    let drawn = render(gpu(), &scene);
    assert_eq!(
        drawn.colors[0].as_ref().unwrap().bytes,
        found.pictures[0].bytes
    );

    let session = Session::new(gpu(), &scene, ShaderForm::Text).unwrap();
    let facts = measure::facts(&session).unwrap();
    let recipe = Recipe::parse_list("depth-prepass").unwrap();
    let variant = measure::variant(session.originals(), &recipe, &facts);
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    };
    let outcome = measure::verify(&session, &[variant], &settings, &mut |_| ()).unwrap();
    let verdicts: Vec<String> = outcome
        .report
        .variants
        .iter()
        .map(|v| format!("{:?}", v.verdict))
        .collect();
    assert!(verdicts[1].starts_with("Holds"), "{verdicts:?}");
    fs::remove_dir_all(path).unwrap();
}

/// A scene without the blending of alpha that nobody sees has the colours of the frame, which is drawn with it.
#[test]
fn colours_are_the_same_without_the_blending_of_alpha() {
    let mut own = folder();
    let add = serde_json::json!({ "srcFactor": "one", "dstFactor": "one" });
    own.file["renderPipelines"][1]["fragment"]["targets"][0]["blend"] =
        serde_json::json!({ "color": {}, "alpha": add });
    own.file["frames"][0]["alphaMode"] = "opaque".into();
    let path = own.write("unblended");
    let capture = Capture::open(&path, &Limits::default()).unwrap();
    let found = check(&capture, gpu()).unwrap();
    let scene = capture::scene(&capture, QUADS, Some(gpu())).unwrap();
    assert!(!scene.materials[0].state.is_blended());
    let drawn = render(gpu(), &scene);
    let pixels = |bytes: &[u8]| -> Vec<[u8; 3]> {
        bytes
            .as_chunks::<4>()
            .0
            .iter()
            .map(|p| [p[0], p[1], p[2]])
            .collect()
    };
    let frame = pixels(&found.pictures[0].bytes);
    assert!(frame.contains(&[0, 0, 0]) && frame.len() == (SIZE * SIZE) as usize);
    assert_eq!(pixels(&drawn.colors[0].as_ref().unwrap().bytes), frame);
    fs::remove_dir_all(path).unwrap();
}

/// The near quad is drawn first, in a pass of its own. The far one is drawn onto that picture, behind it.
#[test]
fn a_pass_that_loads_its_attachments_starts_from_what_they_held() {
    let mut own = folder();
    let commands = &mut own.file["frames"][0]["commands"];
    let mut near = commands[2].clone();
    near["descriptor"]["depthStencilAttachment"]["depthStoreOp"] = "store".into();
    let mut far = near.clone();
    far["descriptor"]["colorAttachments"][0]["loadOp"] = "load".into();
    far["descriptor"]["depthStencilAttachment"]["depthLoadOp"] = "load".into();
    // Each has the state, and the binding and the draw of its own quad.
    near["commands"].as_array_mut().unwrap().drain(3..5);
    far["commands"].as_array_mut().unwrap().drain(5..);
    commands[2] = near;
    commands.as_array_mut().unwrap().push(far);
    let path = own.write("loaded");
    let capture = Capture::open(&path, &Limits::default()).unwrap();
    let found = check(&capture, gpu()).unwrap();
    assert_eq!(found.frames[0].differ, 0);
    let choice = Choice {
        pass: Some(2),
        ..Choice::default()
    };
    let scene = capture::scene(&capture, choice, Some(gpu())).unwrap();
    assert_eq!(scene.draws.len(), 1);
    let drawn = render(gpu(), &scene);
    assert_eq!(
        drawn.colors[0].as_ref().unwrap().bytes,
        found.pictures[0].bytes
    );
    fs::remove_dir_all(path).unwrap();
}

/// The near quad marks the stencil in a pass of its own. The far one is drawn where it is not marked.
#[test]
fn a_pass_starts_from_the_stencil_that_the_frame_has() {
    let mut own = folder();
    own.file["textures"][2]["format"] = "depth24plus-stencil8".into();
    let depth = &mut own.file["renderPipelines"][1]["depthStencil"];
    depth["format"] = "depth24plus-stencil8".into();
    let mut marks = own.file["renderPipelines"][1].clone();
    let mut tests = marks.clone();
    let face = |compare: &str, op: &str| serde_json::json!({ "compare": compare, "passOp": op });
    for side in ["stencilFront", "stencilBack"] {
        marks["depthStencil"][side] = face("equal", "increment-clamp");
        tests["depthStencil"][side] = face("equal", "keep");
    }
    own.file["renderPipelines"][1] = marks;
    let pipelines = own.file["renderPipelines"].as_array_mut().unwrap();
    pipelines.push(tests);
    let commands = &mut own.file["frames"][0]["commands"];
    let mut near = commands[2].clone();
    let stencil = &mut near["descriptor"]["depthStencilAttachment"];
    stencil["depthStoreOp"] = "store".into();
    stencil["stencilLoadOp"] = "clear".into();
    stencil["stencilClearValue"] = 5.into();
    stencil["stencilStoreOp"] = "store".into();
    let mut far = near.clone();
    far["descriptor"]["colorAttachments"][0]["loadOp"] = "load".into();
    let stencil = &mut far["descriptor"]["depthStencilAttachment"];
    stencil["stencilLoadOp"] = "load".into();
    let reference = serde_json::json!({ "do": "setStencilReference", "reference": 5 });
    for pass in [&mut near, &mut far] {
        pass["commands"]
            .as_array_mut()
            .unwrap()
            .insert(0, reference.clone());
    }
    near["commands"].as_array_mut().unwrap().drain(4..6);
    let commands_of_far = far["commands"].as_array_mut().unwrap();
    commands_of_far.drain(6..);
    commands_of_far[1]["pipeline"] = 2.into();
    commands[2] = near;
    commands.as_array_mut().unwrap().push(far);
    let path = own.write("stencil");
    let capture = Capture::open(&path, &Limits::default()).unwrap();
    let found = check(&capture, gpu()).unwrap();
    assert_eq!(found.frames[0].differ, 0, "{:?}", found.left_out);
    for (pass, is_whole) in [(1, false), (2, true)] {
        let choice = Choice {
            pass: Some(pass),
            ..Choice::default()
        };
        let scene = capture::scene(&capture, choice, Some(gpu())).unwrap();
        let drawn = render(gpu(), &scene);
        let picture = &drawn.colors[0].as_ref().unwrap().bytes;
        // The first pass draws the dark middle alone, and nothing without its clear value.
        let middle = (SIZE / 2 * SIZE + SIZE / 2) as usize * 4;
        assert_eq!(picture[middle..middle + 4], [0, 0, 0, 255], "pass {pass}");
        assert_eq!(*picture == found.pictures[0].bytes, is_whole, "pass {pass}");
    }
    fs::remove_dir_all(path).unwrap();
}

#[test]
fn a_point_of_webgl_has_its_coordinate_its_matrix_and_the_number_of_its_draw() {
    let path = point().write("point");
    let capture = Capture::open(&path, &Limits::default()).unwrap();
    let found = check(&capture, gpu()).unwrap();
    assert!(found.left_out.is_empty(), "{:?}", found.left_out);
    assert_eq!(found.frames[0].differ, 0);
    fs::remove_dir_all(path).unwrap();
}

/// A page that draws nothing but a full-screen triangle is looked at, by its only pass.
#[test]
fn a_frame_of_one_full_screen_pass_is_a_scene() {
    let mut own = folder();
    own.file["frames"][0]["commands"]
        .as_array_mut()
        .unwrap()
        .pop();
    own.file["frames"][0]["canvas"] = 1.into();
    own.file["frames"][0]
        .as_object_mut()
        .unwrap()
        .remove("picture");
    let path = own.write("full-screen");
    let capture = Capture::open(&path, &Limits::default()).unwrap();
    for gpu in [None, Some(gpu())] {
        let scene = capture::scene(&capture, Choice::default(), gpu).unwrap();
        assert_eq!((scene.draws.len(), &scene.part), (1, &None));
    }
    fs::remove_dir_all(path).unwrap();
}

/// The part of the frame that a pass takes is said with it.
#[test]
fn a_scene_says_which_part_of_the_frame_it_is() {
    let path = folder().write("part");
    let capture = Capture::open(&path, &Limits::default()).unwrap();
    let scene = capture::scene(&capture, QUADS, Some(gpu())).unwrap();
    let part = scene.part.unwrap();
    assert!(
        part.starts_with("render pass 1 (") && part.ends_with(" % of the frame)"),
        "{part}"
    );
    fs::remove_dir_all(path).unwrap();
}
