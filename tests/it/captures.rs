//! Frame folders that are broken, and the programs of those that are not.

use std::fs;
use std::io::Write as _;

use preshade_draw::scene::Scene;
use preshade_frames::folder::Capture;
use preshade_frames::pass::Kind;
use preshade_plan::state::{Blend, ColorTarget, DepthDirection};
use preshade_scenes::capture::{self, Choice};
use serde_json::{Value, json};
use shader_text::limits::Limits;

use crate::capture_support::{SIZE, folder, name, point};

#[test]
fn a_broken_capture_is_an_error_that_names_the_place() {
    let cases = [
        (
            "/schema",
            json!("preshade.frames.v9"),
            "its schema is `preshade.frames.v9`, and this",
        ),
        (
            "/shaders/0/data",
            json!("../../etc/passwd"),
            "`../../etc/passwd` is no name of data",
        ),
        (
            "/shaders/0/data",
            json!(name(99)),
            "cannot read `data/00000000000000000000000000000063.bin`",
        ),
        (
            "/shaders/0/language",
            json!("hlsl"),
            "unknown variant `hlsl`",
        ),
        ("/frames", json!([]), "it has no frame"),
        (
            "/frames/0/commands/2/commands/0/pipeline",
            json!(7),
            "there is no render pipeline 7: the last is 1",
        ),
        (
            "/frames/0/commands/2/commands/0/do",
            json!("draw2"),
            "unknown variant `draw2`",
        ),
        (
            "/frames/0/commands/0/offset",
            json!(9999),
            "buffer 1: bytes 9999 to 10271 are written, and it has 272",
        ),
        (
            "/bindGroups/0/entries/0/buffer",
            json!(5),
            "there is no buffer 5: the last is 1",
        ),
        (
            "/bindGroups/0/entries/0/size",
            json!(9999),
            "bind group 0: binding 0: bytes 0 to 9999 of buffer 1, which has 272",
        ),
        (
            "/frames/0/commands/2/commands/1",
            json!({ "do": "setVertexBuffer", "slot": 0, "buffer": 0, "offset": 4096 }),
            "command 2: vertex buffer 0: byte 4096 and on of buffer 0, which has 48",
        ),
        (
            "/frames/0/commands/2/commands/1",
            json!({ "do": "setIndexBuffer", "buffer": 0, "indexFormat": "uint16", "offset": 2, "size": u64::MAX }),
            "the index buffer: bytes 2 to 18446744073709551615 of buffer 0",
        ),
        (
            "/frames/0/commands/2/commands/1",
            json!({ "do": "drawIndirect", "buffer": 0, "offset": 40 }),
            "a draw's arguments: bytes 40 to 56 of buffer 0, which has 48",
        ),
        (
            "/frames/0/commands/0",
            json!({ "do": "copyBufferToBuffer", "source": 0, "destination": 1, "destinationOffset": 240, "size": 48 }),
            "command 0: the destination: bytes 240 to 288 of buffer 1, which has 272",
        ),
        (
            "/bindGroups/1/entries/0/texture",
            json!(5),
            "there is no texture 5: the last is 2",
        ),
        (
            "/textures/1/size",
            json!([99999, 1, 1]),
            "texture 1 would be 99999; the limit `texture-size`",
        ),
        (
            "/buffers/0/size",
            json!(1_u64 << 60),
            "the limit `scene-bytes`",
        ),
        (
            "/renderPipelines/1/fragment/entryPoint",
            json!("nothing"),
            "what `quads` draws is left out: there is no fragment entry point `nothing`",
        ),
    ];
    for (index, (place, value, told)) in cases.into_iter().enumerate() {
        let mut own = folder();
        match own.file.pointer_mut(place) {
            Some(found) => *found = value,
            None => own.file["frames"][0]["commands"][0]["offset"] = value,
        }
        let path = own.write(&format!("broken-{index}"));
        let read = Capture::open(&path, &Limits::default())
            .map_err(capture::Error::from)
            .and_then(|capture| capture::scene(&capture, Choice::default(), None).map(drop));
        let error = read.unwrap_err().to_string();
        assert!(error.contains(told), "{place}: {error}");
        fs::remove_dir_all(path).unwrap();
    }
}

#[test]
fn a_compressed_frame_is_read_within_the_limit() {
    let path = folder().write("packed");
    let plain = path.join("frame.json");
    let packed = path.join("frame.json.gz");
    let pack = |text: &[u8]| {
        let file = fs::File::create(&packed).unwrap();
        let mut writer = flate2::write::GzEncoder::new(file, flate2::Compression::fast());
        writer.write_all(text).unwrap();
        writer.finish().unwrap();
    };
    pack(&fs::read(&plain).unwrap());
    fs::remove_file(&plain).unwrap();
    assert!(
        preshade_frames::folder::is_folder(&path)
            && preshade_frames::folder::file_of(&path) == packed
    );
    let limits = Limits {
        file_bytes: 1 << 20,
        ..Limits::default()
    };
    let draws = |capture: &Capture| {
        preshade_frames::pass::passes(capture, 0).unwrap()[1]
            .draws
            .len()
    };
    assert_eq!(draws(&Capture::open(&path, &limits).unwrap()), 2);
    // Small, and large when it is read.
    pack(&vec![b' '; 4 << 20]);
    assert!(packed.metadata().unwrap().len() < limits.file_bytes);
    let error = Capture::open(&path, &limits).unwrap_err().to_string();
    assert!(error.contains("the limit `file-bytes`"), "{error}");
    fs::write(&packed, b"no gzip").unwrap();
    let error = Capture::open(&path, &limits).unwrap_err().to_string();
    assert!(error.contains("cannot read `frame.json.gz`"), "{error}");
    fs::remove_dir_all(path).unwrap();
}

#[test]
fn passes_are_told_apart_by_what_reads_them() {
    let path = folder().write("passes");
    let capture = Capture::open(&path, &Limits::default()).unwrap();
    let passes = preshade_frames::pass::passes(&capture, 0).unwrap();
    let found: Vec<(Kind, usize)> = passes.iter().map(|p| (p.kind, p.draws.len())).collect();
    assert_eq!(found, [(Kind::FullScreen, 1), (Kind::Main, 2)]);
    let scene = capture::scene(&capture, Choice::default(), None).unwrap();
    let bound = scene.draws[1].captured.as_ref().unwrap();
    // The dynamic offset chose the second draw's numbers.
    let near: Vec<f32> = bound.buffers[0]
        .data
        .bytes
        .as_chunks::<4>()
        .0
        .iter()
        .map(|b| f32::from_le_bytes(*b))
        .collect();
    assert_eq!(near, [0.5, 0.5, 0.25, 0.0]);
    fs::remove_dir_all(path).unwrap();
}

/// The direction is that of the clear value, else of what writes depth, and each material has it.
#[test]
fn depth_grows_as_the_pass_clears_it_or_as_its_draws_compare() {
    let cases = [
        ("clear", json!(1.0), "less", DepthDirection::Forward),
        ("clear", json!(0.0), "greater", DepthDirection::Reversed),
        ("clear", json!(0), "greater-equal", DepthDirection::Reversed),
        // All draws win against 0, whatever they are.
        ("clear", json!(0.0), "always", DepthDirection::Reversed),
        ("clear", json!(0.5), "greater", DepthDirection::Reversed),
        ("clear", json!(0.5), "less-equal", DepthDirection::Forward),
        ("load", json!(0.0), "greater", DepthDirection::Reversed),
        ("load", json!(0.0), "less", DepthDirection::Forward),
        ("load", json!(0.0), "equal", DepthDirection::Forward),
    ];
    for (index, (load, clear, compare, direction)) in cases.into_iter().enumerate() {
        let mut own = folder();
        let depth =
            &mut own.file["frames"][0]["commands"][2]["descriptor"]["depthStencilAttachment"];
        depth["depthLoadOp"] = load.into();
        depth["depthClearValue"] = clear.clone();
        own.file["renderPipelines"][1]["depthStencil"]["depthCompare"] = compare.into();
        let path = own.write(&format!("direction-{index}"));
        let capture = Capture::open(&path, &Limits::default()).unwrap();
        let scene = capture::scene(&capture, Choice::default(), None).unwrap();
        let place = format!("{load} {clear}, {compare}");
        assert_eq!(scene.depth_direction, direction, "{place}");
        assert_eq!(
            scene.materials[0].state.depth_direction, direction,
            "{place}"
        );
        // A clear to no plane is an image.
        assert_eq!(
            scene.initial.depth.is_some(),
            clear == json!(0.5),
            "{place}"
        );
        fs::remove_dir_all(path).unwrap();
    }
}

/// A shadow map that grows forward, and a main pass that is reversed and loads what an earlier one cleared.
#[test]
fn each_pass_of_a_frame_has_its_own_direction() {
    let mut own = folder();
    let commands = own.file["frames"][0]["commands"].as_array_mut().unwrap();
    let mut later = commands[2].clone();
    let depth = &mut later["descriptor"]["depthStencilAttachment"];
    depth["depthClearValue"] = json!(0.0);
    commands.push(later.clone());
    later["descriptor"]["depthStencilAttachment"]["depthLoadOp"] = json!("load");
    commands.push(later);
    // Nothing but the clear tells.
    own.file["renderPipelines"][1]["depthStencil"]["depthCompare"] = json!("equal");
    let path = own.write("both-directions");
    let capture = Capture::open(&path, &Limits::default()).unwrap();
    let directions: Vec<DepthDirection> = (1..4)
        .map(|pass| {
            let choice = Choice {
                pass: Some(pass),
                ..Choice::default()
            };
            capture::scene(&capture, choice, None)
                .unwrap()
                .depth_direction
        })
        .collect();
    let [forward, reversed] = [DepthDirection::Forward, DepthDirection::Reversed];
    assert_eq!(directions, [forward, reversed, reversed]);
    fs::remove_dir_all(path).unwrap();
}

#[test]
fn a_draw_of_webgl_has_resources_by_name() {
    let path = point().write("webgl");
    let capture = Capture::open(&path, &Limits::default()).unwrap();
    let passes = preshade_frames::pass::passes(&capture, 0).unwrap();
    let found: Vec<_> = passes.iter().map(|p| (p.kind, p.draws[0].named)).collect();
    assert_eq!(found, [(Kind::FullScreen, Some(0))]);
    fs::remove_dir_all(path).unwrap();
}

/// Whether the material of the main pass blends, after `edit`. As the page drew it, it blends alpha alone.
fn blends(name: &str, edit: impl Fn(&mut Value)) -> bool {
    let scene = alpha_alone(name, edit);
    let mut targets = scene
        .materials
        .iter()
        .filter_map(|m| m.state.targets[0].as_ref());
    let keeps_color = |t: &&ColorTarget| t.blend.is_none_or(|b| b.color == Blend::REPLACE.color);
    let target = targets.find(keeps_color).unwrap();
    let is_written = target.write_mask == 0b1111;
    let said = scene.notes.iter().any(|n| n.contains("blends alpha alone"));
    let is_dropped = target.blend.is_none();
    assert_eq!(said, is_written && is_dropped, "{name}: {:?}", scene.notes);
    !is_dropped
}

/// The scene of the main pass, whose material blends alpha alone on an opaque canvas before `edit`.
fn alpha_alone(name: &str, edit: impl Fn(&mut Value)) -> Scene {
    let mut own = folder();
    let add = json!({ "srcFactor": "one", "dstFactor": "one" });
    own.file["renderPipelines"][1]["fragment"]["targets"][0]["blend"] =
        json!({ "color": {}, "alpha": add });
    own.file["frames"][0]["alphaMode"] = json!("opaque");
    edit(&mut own.file);
    let path = own.write(name);
    let capture = Capture::open(&path, &Limits::default()).unwrap();
    let main = Choice {
        frame: 0,
        pass: Some(1),
    };
    let scene = capture::scene(&capture, main, None).unwrap();
    fs::remove_dir_all(path).unwrap();
    scene
}

#[test]
fn alpha_that_nobody_sees_is_left_out() {
    assert!(!blends("alpha", |_| ()));
    assert!(!blends("alpha-resolved", resolved));
    let asked = |file: &mut Value| {
        file["refused"] =
            json!([{ "what": "resolveQuerySet", "why": "results of queries are not recorded" }]);
    };
    assert!(!blends("alpha-asked", asked));
}

/// The main pass draws to a texture of several samples, which is resolved to the canvas.
fn resolved(file: &mut Value) {
    let samples = json!({ "count": 4 });
    file["renderPipelines"][1]["multisample"] = samples;
    file["textures"][2]["sampleCount"] = json!(4);
    let mut drawn = file["textures"][0].clone();
    drawn["sampleCount"] = json!(4);
    file["textures"].as_array_mut().unwrap().push(drawn);
    let color = &mut file["frames"][0]["commands"][2]["descriptor"]["colorAttachments"][0];
    color["resolveTarget"] = color["view"].clone();
    color["view"] = json!({ "texture": 3 });
}

#[test]
fn alpha_of_two_frames_is_left_out() {
    // Each frame of WebGPU has a canvas of its own, and both resolve one texture.
    let two = |file: &mut Value| {
        resolved(file);
        let mut next = file["frames"][0].clone();
        let canvas = file["textures"][0].clone();
        file["textures"].as_array_mut().unwrap().push(canvas);
        next["canvas"] = json!(4);
        let color = &mut next["commands"][2]["descriptor"]["colorAttachments"][0];
        color["resolveTarget"] = json!({ "texture": 4 });
        file["frames"].as_array_mut().unwrap().push(next);
    };
    assert!(!blends("alpha-frames", two));
    let seen = |file: &mut Value| {
        two(file);
        file["frames"][1]["alphaMode"] = json!("premultiplied");
    };
    assert!(blends("alpha-frames-seen", seen));
}

/// Draws of a second pipeline, which blends colour, before or after those of the first.
fn lit(file: &mut Value, first: bool) {
    let add = json!({ "srcFactor": "one", "dstFactor": "one" });
    let mut light = file["renderPipelines"][1].clone();
    light["fragment"]["targets"][0]["blend"] = json!({ "color": add, "alpha": add });
    file["renderPipelines"].as_array_mut().unwrap().push(light);
    let draws = file["frames"][0]["commands"][2]["commands"]
        .as_array_mut()
        .unwrap();
    // Ahead of its own draws each pipeline is set: 0 sets the first one, 3 and 5 choose the numbers of a draw.
    draws.insert(5, json!({ "do": "setPipeline", "pipeline": 2 }));
    if first {
        draws[0]["pipeline"] = json!(2);
        draws[5]["pipeline"] = json!(1);
    }
}

#[test]
fn what_is_drawn_over_blended_colour_keeps_its_place() {
    assert!(!blends("alpha-first", |file| lit(file, false)));
    assert!(blends("alpha-later", |file| lit(file, true)));
}

#[test]
fn a_note_counts_opaque_draws_after_a_blended_one() {
    let opaque = |first: bool| {
        move |file: &mut Value| {
            lit(file, first);
            file["renderPipelines"][1]["fragment"]["targets"][0]["blend"] = Value::Null;
        }
    };
    let is_told = |scene: Scene| {
        scene
            .notes
            .iter()
            .any(|n| n.contains("1 opaque draw comes after"))
    };
    assert!(is_told(alpha_alone("opaque-later", opaque(true))));
    assert!(!is_told(alpha_alone("opaque-first", opaque(false))));
}

#[test]
fn alpha_that_is_not_written_does_not_blend() {
    let masked = |file: &mut Value| {
        file["frames"][0]["alphaMode"] = Value::Null;
        file["renderPipelines"][1]["fragment"]["targets"][0]["writeMask"] = json!(7);
    };
    assert!(!blends("alpha-masked", masked));
    assert!(blends("alpha-masked-float", |file| {
        masked(file);
        float(file, "rg16float");
    }));
}

/// The main pass draws to a float format, which may hold infinity.
fn float(file: &mut Value, format: &str) {
    file["textures"][0]["format"] = json!(format);
    file["renderPipelines"][1]["fragment"]["targets"][0]["format"] = json!(format);
}

#[test]
fn alpha_that_something_reads_stays() {
    let mode = |mode: Value| move |file: &mut Value| file["frames"][0]["alphaMode"] = mode.clone();
    assert!(blends("alpha-float", |file| float(file, "rgba16float")));
    assert!(blends("alpha-seen", mode(json!("premultiplied"))));
    assert!(blends("alpha-unknown", mode(Value::Null)));
    let refused = |file: &mut Value| {
        file["refused"] = json!([{ "what": "a draw", "why": "it binds a video" }]);
    };
    assert!(blends("alpha-refused", refused));
    let elsewhere = |file: &mut Value| {
        resolved(file);
        let color = &mut file["frames"][0]["commands"][2]["descriptor"]["colorAttachments"][0];
        color["resolveTarget"] = json!({ "texture": 1 });
    };
    assert!(blends("alpha-elsewhere", elsewhere));
    let copied = |file: &mut Value| {
        let copy = json!({
            "do": "copyTextureToTexture",
            "source": { "texture": 0 },
            "destination": { "texture": 1 },
            "size": [SIZE, SIZE, 1],
        });
        file["frames"][0]["commands"]
            .as_array_mut()
            .unwrap()
            .push(copy);
    };
    assert!(blends("alpha-copied", copied));
    let sampled = |file: &mut Value| {
        // A later pass draws to the other texture, and samples the canvas.
        let mut group = file["bindGroups"][1].clone();
        group["entries"][0]["texture"] = json!(0);
        file["bindGroups"].as_array_mut().unwrap().push(group);
        let commands = file["frames"][0]["commands"].as_array_mut().unwrap();
        let mut later = commands[2].clone();
        later["descriptor"]["colorAttachments"][0]["view"] = json!({ "texture": 1 });
        let draws = later["commands"].as_array_mut().unwrap();
        draws[2]["bindGroup"] = json!(2);
        draws.truncate(5);
        commands.push(later);
    };
    assert!(blends("alpha-sampled", sampled));
    let blended = |file: &mut Value| {
        let color = json!({ "srcFactor": "one-minus-dst-alpha", "dstFactor": "one" });
        file["renderPipelines"][0]["fragment"]["targets"][0]["blend"] =
            json!({ "color": color, "alpha": {} });
        let commands = file["frames"][0]["commands"].as_array_mut().unwrap();
        let mut later = commands[1].clone();
        later["descriptor"]["colorAttachments"][0] =
            json!({ "view": { "texture": 0 }, "loadOp": "load" });
        commands.push(later);
    };
    assert!(blends("alpha-blended", blended));
}

#[test]
fn a_texture_is_steady_if_no_frame_writes_it() {
    let steady = |name: &str, edit: &dyn Fn(&mut Value)| {
        let mut own = folder();
        // The pass that fills the texture, out of the frame.
        own.file["frames"][0]["commands"]
            .as_array_mut()
            .unwrap()
            .remove(1);
        edit(&mut own.file);
        let path = own.write(name);
        let capture = Capture::open(&path, &Limits::default()).unwrap();
        let scene = capture::scene(&capture, Choice::default(), None).unwrap();
        fs::remove_dir_all(path).unwrap();
        let bound = scene.draws[0].captured.as_ref().unwrap();
        bound.textures[0].is_steady
    };
    let write = json!({
        "do": "copyTextureToTexture",
        "source": { "texture": 0 },
        "destination": { "texture": 1 },
        "size": [SIZE, SIZE, 1],
    });
    assert!(steady("steady", &|_| ()));
    assert!(steady("steady-uploaded", &|file| file["setup"] = json!([write])));
    let draw = folder().file["frames"][0]["commands"][1].clone();
    assert!(!steady("steady-drawn-before", &|file| file["setup"] = json!([draw])));
    assert!(!steady("steady-drawn", &|file| {
        let commands = file["frames"][0]["commands"].as_array_mut().unwrap();
        commands.push(draw.clone());
    }));
    assert!(!steady("steady-in-the-next-frame", &|file| {
        let mut next = file["frames"][0].clone();
        next["commands"].as_array_mut().unwrap().push(write.clone());
        file["frames"].as_array_mut().unwrap().push(next);
    }));
    assert!(!steady("steady-refused", &|file| {
        file["refused"] =
            json!([{ "what": "a clear of a texture", "why": "outside a render pass" }]);
    }));
}
