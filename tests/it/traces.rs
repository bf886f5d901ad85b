//! Traces of wgpu as frame folders, and traces that are none. The adapter's tests replay them.

use std::fs;
use std::path::{Path, PathBuf};

use preshade_frames::browser::prepare;
use preshade_frames::folder::{Capture, file_of};
use preshade_frames::trace::{
    FrameChoice, FramesBy, TRACE, TraceError, TraceSummary, Version, convert,
};
use serde_json::Value;
use shader_text::limits::Limits;

const LAST: FrameChoice = FrameChoice {
    frames: 1,
    from: None,
    by: None,
};

/// A trace of `tests/wgpu-trace`.
fn recorded(name: &str) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    root.join("fixtures/wgpu-traces").join(name)
}

/// Copies a trace, with another text.
fn changed(name: &str, test: &str, change: impl FnOnce(String) -> Vec<u8>) -> PathBuf {
    let to = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("traces")
        .join(test);
    let _ = fs::remove_dir_all(&to);
    fs::create_dir_all(&to).unwrap();
    for entry in fs::read_dir(recorded(name)).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
    }
    let text = fs::read_to_string(to.join(TRACE)).unwrap();
    fs::write(to.join(TRACE), change(text)).unwrap();
    to
}

/// Converts a trace, and reads the folder.
fn converted(
    trace: &Path,
    test: &str,
    wanted: &FrameChoice,
) -> Result<(TraceSummary, Value), TraceError> {
    let out = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("folders")
        .join(test);
    prepare(&out).unwrap();
    let found = convert(trace, &out, wanted, &Limits::default())?;
    Capture::open(&out, &Limits::default()).unwrap();
    let json = serde_json::from_slice(&fs::read(file_of(&out)).unwrap()).unwrap();
    Ok((found, json))
}

fn kinds(commands: &Value) -> Vec<&str> {
    let commands = commands.as_array().into_iter().flatten();
    commands.map(|c| c["do"].as_str().unwrap()).collect()
}

fn labels<'j>(json: &'j Value, list: &str) -> Vec<&'j str> {
    let entries = json[list].as_array().into_iter().flatten();
    entries.map(|e| e["label"].as_str().unwrap()).collect()
}

#[test]
fn the_last_frame_has_what_it_reads_and_no_more() {
    for (name, version, by) in [
        ("30", Version::V30, FramesBy::Present),
        ("30-offscreen", Version::V30, FramesBy::Submit),
        ("29", Version::V29, FramesBy::Present),
        ("29-offscreen", Version::V29, FramesBy::Submit),
    ] {
        let (found, json) = converted(&recorded(name), &format!("last-{name}"), &LAST).unwrap();
        assert_eq!((found.version, found.by), (version, by), "{name}");
        // Without a window, the submission that fills the levels of the texture is a frame too.
        let all = if by == FramesBy::Present { 3 } else { 4 };
        assert_eq!(
            (found.frames, found.first, found.written),
            (all, all - 1, 1),
            "{name}"
        );
        assert!(!found.is_cut);
        assert_eq!(json["refused"], serde_json::json!([]), "{name}");
        assert_eq!(json["source"]["api"], "wgpu");
        // Three levels, offsets, and what two earlier frames added to the trail.
        let mut setup = kinds(&json["setup"]);
        setup.sort_unstable();
        let passes = [
            "computePass",
            "renderPass",
            "renderPass",
            "renderPass",
            "renderPass",
            "renderPass",
        ];
        assert_eq!(setup, passes, "{name}");
        let mut started: Vec<&str> = json["start"]["buffers"]
            .as_array()
            .unwrap()
            .iter()
            .map(|b| {
                json["buffers"][b["buffer"].as_u64().unwrap() as usize]["label"]
                    .as_str()
                    .unwrap()
            })
            .collect();
        started.sort_unstable();
        assert_eq!(started, ["corners", "indices", "placed"], "{name}");
        assert_eq!(
            json["start"]["textures"].as_array().unwrap().len(),
            1,
            "{name}"
        );
        let frame = &json["frames"][0];
        let mut commands = kinds(&frame["commands"]);
        // A window's picture is copied before it is shown, and a texture's in the next submission.
        assert_eq!(
            commands.pop_if(|c| *c == "copyTextureToBuffer").is_some(),
            by == FramesBy::Present
        );
        assert_eq!(
            commands,
            ["writeBuffer", "renderPass", "renderPass", "renderPass"],
            "{name}"
        );
        let main = &frame["commands"][3]["commands"];
        let draws = kinds(main)
            .into_iter()
            .filter(|c| *c == "drawIndexed")
            .count();
        // The bundle's draw, and the instances.
        assert_eq!(draws, 2, "{name}");
        assert_eq!(frame["size"], serde_json::json!([64, 48]));
        assert_eq!(frame["commands"][3]["descriptor"]["label"], "main");
        let textures = labels(&json, "textures");
        assert_eq!(textures.len(), 4, "{name}: {textures:?}");
        assert!(!json.to_string().contains("somebody"), "{name}");
    }
}

#[test]
fn any_frames_can_be_written() {
    let wanted = FrameChoice {
        frames: 2,
        from: Some(0),
        by: None,
    };
    let (found, json) = converted(&recorded("30"), "first", &wanted).unwrap();
    assert_eq!((found.first, found.written), (0, 2));
    // What came before is part of the first frame.
    assert!(json.get("setup").is_none());
    assert_eq!(json["frames"].as_array().unwrap().len(), 2);
    let canvases = [0, 1].map(|f| json["frames"][f]["canvas"].as_u64().unwrap());
    assert_ne!(canvases[0], canvases[1]);

    let beyond = FrameChoice {
        from: Some(2),
        ..wanted
    };
    let error = converted(&recorded("30"), "beyond", &beyond).unwrap_err();
    assert!(
        error.to_string().contains("holds 3 whole frames"),
        "{error}"
    );
    let presents = FrameChoice {
        by: Some(FramesBy::Present),
        ..LAST
    };
    let error = converted(&recorded("30-offscreen"), "presents", &presents).unwrap_err();
    assert!(
        error.to_string().contains("`--frames-by submit` has some"),
        "{error}"
    );
}

#[test]
fn a_trace_that_was_cut_short_is_whole_up_to_the_last_full_frame() {
    let text = fs::read_to_string(recorded("30").join(TRACE)).unwrap();
    let presents: Vec<usize> = text.match_indices("\nPresent(").map(|(at, _)| at).collect();
    assert_eq!(presents.len(), 3);
    for (frames, end) in [
        (2, presents[2] + 3),
        (2, presents[1] + 60),
        (1, presents[1] - 1),
    ] {
        let cut = changed("30", "cut", |text| text.as_bytes()[..end].to_vec());
        let (found, _) = converted(&cut, "cut", &LAST).unwrap();
        assert_eq!((found.frames, found.is_cut), (frames, true));
    }
    for end in [0, 1, 40, 4000, presents[0]] {
        let cut = changed("30", "cut-early", |text| text.as_bytes()[..end].to_vec());
        // Before the first present, the frames of an app without a window count.
        let result = converted(
            &cut,
            "cut-early",
            &FrameChoice {
                by: Some(FramesBy::Present),
                ..LAST
            },
        );
        assert!(result.is_err(), "{end}");
    }
}

/// A change of a trace's text.
type Change = fn(String) -> Vec<u8>;

#[test]
fn a_trace_that_is_none_is_an_error_that_names_the_place() {
    let cases: [(&str, Change, &str); 13] = [
        ("empty", |_| Vec::new(), "it is empty, or was cut off"),
        (
            "garbage",
            |_| b"\x7fELF\0\0".to_vec(),
            "it does not begin with `[`",
        ),
        (
            "no-init",
            |_| b"[\nPresent(PointerId(1)),\n]".to_vec(),
            "does not begin with the action `Init`",
        ),
        (
            "version",
            |t| t.replace("maxBindGroups:", "maxBindSets:").into(),
            "of another wgpu than 29 and 30, which this version reads: its device has the limit `maxBindSets`",
        ),
        (
            "action",
            |t| t.replacen("CreateSampler(", "CreateSampler2(", 1).into(),
            ": the action `CreateSampler2` is none of wgpu 29 or 30",
        ),
        (
            "field",
            |t| t.replacen("address_modes:", "address_mode:", 1).into(),
            ": the action `CreateSampler` is none of wgpu 29 or 30",
        ),
        (
            "command",
            |t| {
                t.replacen("DispatchWorkgroups(", "DispatchMaybe(", 1)
                    .into()
            },
            "`DispatchMaybe`",
        ),
        (
            "path",
            |t| t.replace("data2.bin", "../data2.bin").into(),
            "the data `../data2.bin`, which is no file of its folder",
        ),
        (
            "absolute",
            |t| t.replace("data2.bin", "/etc/hostname").into(),
            "the data `/etc/hostname`, which is no file of its folder",
        ),
        (
            "missing",
            |t| t.replace("data2.bin", "data99.bin").into(),
            "cannot read the trace's `data99.bin`",
        ),
        (
            "short",
            |t| {
                let old = "data3.bin\"),\n    offset: 0,\n    size: 32";
                t.replacen(old, "data3.bin\"),\n    offset: 0,\n    size: 99999", 1)
                    .into()
            },
            "bytes, and 99999 are written from it",
        ),
        (
            "huge-texture",
            |t| t.replacen("width: 8,", "width: 4000000000,", 1).into(),
            "texture",
        ),
        (
            "huge-buffer",
            |t| t.replacen("size: 48,", "size: 99999999999999,", 1).into(),
            "the bytes of buffers and textures",
        ),
    ];
    for (test, change, expected) in cases {
        let trace = changed("30", test, change);
        let error = converted(&trace, test, &LAST).unwrap_err().to_string();
        assert!(error.contains(expected), "{test}: {error}");
    }
    let error = converted(Path::new("nowhere"), "nowhere", &LAST).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("cannot read `nowhere/trace.ron`"),
        "{error}"
    );
}

#[test]
fn what_a_folder_has_no_words_for_is_refused_by_name() {
    let cases: [(&str, Change, &str, &str); 4] = [
        (
            "edges",
            |t| t.replace("polygonMode: fill", "polygonMode: line").into(),
            "a render pipeline",
            "it draws edges or corners of triangles alone",
        ),
        (
            "border",
            |t| {
                t.replace(
                    "address_modes: (repeat,",
                    "address_modes: (r#clamp-to-border,",
                )
                .into()
            },
            "a sampler",
            "WebGPU has no border colour",
        ),
        (
            "immediates",
            |t| t.replace("immediate_size: 0", "immediate_size: 16").into(),
            "a pipeline layout",
            "it has immediate data (push constants)",
        ),
        (
            "views",
            |t| {
                t.replace("multiview_mask: None", "multiview_mask: Some(3)")
                    .into()
            },
            "a render pass",
            "it draws several views at once",
        ),
    ];
    for (test, change, what, why) in cases {
        let trace = changed("30", test, change);
        let (_, json) = converted(&trace, test, &LAST).unwrap();
        let refused = json["refused"].as_array().unwrap();
        assert!(
            refused.iter().any(|r| r["what"] == what && r["why"] == why),
            "{test}: {refused:?}"
        );
    }
}

#[test]
fn a_buffer_that_nothing_writes_is_unknown() {
    // wgpu leaves `Queue::write_buffer_with` out.
    let without = |data: &'static str| {
        changed("30", "unwritten", move |t| {
            let start = t[..t.find(data).unwrap()].rfind("WriteBuffer(").unwrap();
            let end = start + t[start..].find("\n),\n").unwrap() + "\n),\n".len();
            format!("{}{}", &t[..start], &t[end..]).into()
        })
    };
    // Later frames write a part of the first one.
    for (data, expected) in [("data2.bin", vec![]), ("data3.bin", vec!["corners"])] {
        let (_, json) = converted(&without(data), "unwritten", &LAST).unwrap();
        let unknown = json["unknown"].as_array().unwrap();
        let buffers = unknown
            .iter()
            .map(|u| u["buffer"].as_u64().unwrap() as usize);
        let named: Vec<&str> = buffers
            .map(|b| json["buffers"][b]["label"].as_str().unwrap())
            .collect();
        assert_eq!(named, expected);
    }
}

#[test]
fn a_mutated_trace_is_an_error_or_a_folder() {
    let text = fs::read_to_string(recorded("29").join(TRACE)).unwrap();
    let to = changed("29", "mutated", |text| text.into());
    let (mut at, step) = (5, text.len() / 37);
    while at < text.len() {
        let mut bytes = text.clone().into_bytes();
        let end = (at + 3).min(bytes.len());
        bytes[at..end].fill(b"(],\"9\xff"[at % 6]);
        fs::write(to.join(TRACE), bytes).unwrap();
        // No panic is what counts.
        let _ = converted(&to, "mutated", &LAST);
        at += step + at % 7;
    }
}

/// A trace that fails, or frames that it lacks, leave the earlier capture as it was.
#[test]
fn a_failed_conversion_keeps_the_earlier_capture() {
    let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("folders/kept");
    let _ = fs::remove_dir_all(&out);
    let written = || {
        let data = fs::read_dir(out.join("data")).unwrap();
        let mut names: Vec<_> = data.map(|e| e.unwrap().file_name()).collect();
        names.sort();
        (fs::read(file_of(&out)).unwrap(), names)
    };
    converted(&recorded("30"), "kept", &LAST).unwrap();
    let before = written();
    let too_many = FrameChoice {
        from: Some(2),
        frames: 9,
        ..LAST
    };
    converted(&recorded("30"), "kept", &too_many).unwrap_err();
    let missing = changed("30", "without-data", |text| {
        text.replace("data8.bin", "data99.bin").into_bytes()
    });
    converted(&missing, "kept", &LAST).unwrap_err();
    assert!(written() == before);
    // What a killed program left is removed, and so is what the new capture does not name.
    fs::write(out.join("data/.0.bin.1-2.tmp"), "half").unwrap();
    fs::write(out.join("data").join(format!("{:032x}.bin", 7)), "old").unwrap();
    converted(&recorded("30"), "kept", &LAST).unwrap();
    assert!(written() == before);
    // Nothing that fails makes a folder.
    let new = Path::new(env!("CARGO_TARGET_TMPDIR")).join("folders/never");
    converted(&missing, "never", &LAST).unwrap_err();
    assert!(!new.exists());
    // A folder with something else is not a capture's.
    fs::write(out.join("notes.txt"), "mine").unwrap();
    assert!(prepare(&out).is_err());
}
