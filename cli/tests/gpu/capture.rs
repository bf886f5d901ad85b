//! `preshade capture` of pages of our own, which use most of WebGPU and WebGL 2.
//!
//! Needed: Chromium (`scripts/setup.sh three`). What is missing is a failure, never a skipped test.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};

use preshade_frames::folder::Capture;
use shader_text::limits::Limits;

/// Captures a page of `tests/capture`. Returns what was printed, and the folder.
fn captured(page: &str) -> (String, PathBuf) {
    let out = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("capture")
        .join(page);
    let html = written(page, &out);
    recorded(&html, &out.join("frame"), "js:globalThis.ready")
}

/// An HTML file with a page of `tests/capture`, in a new folder.
fn written(page: &str, out: &Path) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let script = root.join(format!("tests/capture/pages/{page}.js"));
    let _ = fs::remove_dir_all(out);
    fs::create_dir_all(out).unwrap();
    let html = out.join("a page.html");
    // A page reads what is below its own folder.
    fs::copy(script, out.join("page.js")).unwrap();
    let text = "<!doctype html><canvas id=canvas width=320 height=240></canvas><script src=page.js></script>";
    fs::write(&html, text).unwrap();
    html
}

fn recorded(html: &Path, folder: &Path, condition: &str) -> (String, PathBuf) {
    let output = Command::new(env!("CARGO_BIN_EXE_preshade"))
        .arg("capture")
        .arg(html)
        .args([
            "--frames",
            "2",
            "--after",
            "0",
            "--wait-for",
            condition,
            "-o",
        ])
        .arg(folder)
        .output()
        .unwrap();
    let complained = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{complained}");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    (said, folder.to_owned())
}

/// Every number refers to an object, and every data file is there with the content of its name.
fn is_whole(folder: &Path) {
    let capture = Capture::open(folder, &Limits::default()).unwrap();
    assert_eq!(capture.file.frames.len(), 2);
    for path in capture.files() {
        assert!(path.is_file(), "{}", path.display());
    }
}

#[test]
fn a_page_of_webgpu_is_captured_whole() {
    let (said, folder) = captured("webgpu-small");
    assert!(
        said.contains("2 frames of 320x240, 4 draws, 2 render passes, 2 pipelines"),
        "{said}"
    );
    assert!(
        !said.contains("left out") && !said.contains("unknown"),
        "{said}"
    );
    is_whole(&folder);
}

#[test]
fn a_page_of_webgl_2_is_captured_whole() {
    let (said, folder) = captured("webgl2-small");
    assert!(
        said.contains("2 frames of 320x240, 6 draws, 6 render passes, 2 pipelines"),
        "{said}"
    );
    assert!(
        !said.contains("left out") && !said.contains("unknown"),
        "{said}"
    );
    is_whole(&folder);
}

#[test]
fn a_page_in_a_frame_is_captured() {
    let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("capture/in-a-frame");
    written("webgl2-small", &out);
    let outer = out.join("outer.html");
    let text = "<!doctype html><iframe src='a page.html' width=400 height=300></iframe>";
    fs::write(&outer, text).unwrap();
    let (said, folder) = recorded(&outer, &out.join("frame"), "js:frames[0].ready");
    assert!(said.contains("2 frames of 320x240, 6 draws"), "{said}");
    is_whole(&folder);
}

fn preshade(arguments: &[&str], folder: &Path) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_preshade"))
        .args(arguments)
        .arg(folder)
        .output()
        .unwrap();
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said).into_owned();
    (output.status.code(), said)
}

/// A page of `fixtures/cases`, and an empty folder for its capture.
fn case(name: &str) -> (String, PathBuf) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let page = root.join("fixtures/cases/newcomer").join(name);
    // Several tests take one page.
    static CASES: AtomicUsize = AtomicUsize::new(0);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("capture-cases")
        .join(CASES.fetch_add(1, Ordering::Relaxed).to_string())
        .join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(folder.parent().unwrap()).unwrap();
    (page.to_str().unwrap().to_owned(), folder)
}

/// Each says in its first line what is right.
#[test]
fn cases_of_pages_are_captured_and_take_variants() {
    for (name, material, told) in [
        (
            "reversed-z.html",
            "card",
            "the replayed frame is the page's",
        ),
        (
            "reversed-z-webgl.html",
            "card",
            "the replayed frame is the page's",
        ),
        (
            "cutoff-zero.html",
            "ball",
            "cutoff-zero.html, render pass 0 (",
        ),
        (
            "sin-hash.html",
            "pipeline-0",
            "in `h`, which takes the fraction of a sine times 43758.5",
        ),
    ] {
        let (page, folder) = case(name);
        let (status, said) = preshade(&["capture", &page, "-o"], &folder);
        assert_eq!(status, Some(0), "{name}: {said}");
        let verify = [
            "verify",
            "--time",
            "no",
            "--variant",
            "depth-prepass",
            "--size",
            "160x90",
        ];
        let (status, said) = preshade(&verify, &folder);
        assert_eq!(status, Some(0), "{name}: {said}");
        let line = said.lines().find(|line| line.starts_with("depth-prepass"));
        assert!(
            line.is_some_and(|l| l.contains("same picture")),
            "{name}: {said}"
        );
        assert!(said.contains(told), "{name}: {said}");
        assert!(!said.contains("discard is untested"), "{name}: {said}");
        let out = folder.with_extension("out");
        let _ = fs::remove_dir_all(&out);
        let out = out.to_str().unwrap();
        let rewrite = [
            "rewrite",
            "--pass",
            "depth-prepass",
            "--material",
            material,
            "-o",
            out,
        ];
        let (status, said) = preshade(&rewrite, &folder);
        assert_eq!(status, Some(0), "{name}: {said}");
        assert!(said.contains("prepass"), "{name}: {said}");
    }
}

/// WebGPU copies to few formats of depth and resolves none, so the replay draws them.
#[test]
fn depths_that_webgpu_does_not_write_are_drawn() {
    let (page, folder) = case("depth-resolve.html");
    let (status, said) = preshade(&["capture", &page, "-o"], &folder);
    assert_eq!(status, Some(0), "{said}");
    assert!(!said.contains("test or read it"), "{said}");
    let text = fs::read_to_string(folder.join("frame.json")).unwrap();
    assert_eq!(text.matches("\"copyDepth\"").count(), 2, "{text}");
    let (_, said) = preshade(
        &["verify", "--time", "no", "--variant", "depth-prepass"],
        &folder,
    );
    assert!(
        said.contains("the replayed frame is the page's, in all 14400 pixels"),
        "{said}"
    );
    let (page, folder) = case("unknown-depth.html");
    let (status, said) = preshade(&["capture", &page, "-o"], &folder);
    assert_eq!(status, Some(0), "{said}");
    assert!(
        said.contains("is unknown when 1 draw of render pass 0 test or read it"),
        "{said}"
    );
}

/// What a replay measured is kept beside the frame, and no longer believed once a file that it read differs.
#[test]
fn a_frame_is_measured_once_and_again_when_a_file_changes() {
    let (page, folder) = case("reversed-z-webgl.html");
    let (status, said) = preshade(&["capture", &page, "-o"], &folder);
    assert_eq!(status, Some(0), "{said}");
    let measured = || {
        let verify = ["verify", "--time", "no", "--variant", "depth-prepass"];
        let (status, said) = preshade(&verify, &folder);
        assert_eq!(status, Some(0), "{said}");
        (said, fs::read(folder.join("replay.json")).unwrap())
    };
    let (first, kept) = measured();
    assert!(
        first.contains("the replayed frame is the page's"),
        "{first}"
    );
    // Times vary, so that a second measurement would be another file.
    assert_eq!(measured(), (first, kept.clone()));
    let file: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.join("frame.json")).unwrap()).unwrap();
    let picture = file["frames"][0]["picture"]["data"].as_str().unwrap();
    let picture = folder.join(format!("data/{picture}.bin"));
    let mut texels = fs::read(&picture).unwrap();
    texels[0] ^= 128;
    fs::write(&picture, texels).unwrap();
    let (changed, again) = measured();
    assert!(changed.contains("in 1 of 14400 pixels"), "{changed}");
    assert_ne!(again, kept);
}

/// An error, a signal: the earlier capture stays, the page's own words are told, and nothing of the browser is left.
#[test]
fn what_ends_a_capture_ends_the_browser_and_keeps_the_earlier_one() {
    let (good, folder) = case("reversed-z.html");
    let (status, said) = preshade(&["capture", &good, "-o"], &folder);
    assert_eq!(status, Some(0), "{said}");
    let before = fs::read(folder.join("frame.json")).unwrap();
    let (bad, _) = case("page-fails.html");
    let (status, said) = preshade(&["capture", &bad, "--patience", "5", "-o"], &folder);
    assert_eq!(status, Some(2), "{said}");
    assert!(
        said.contains("the page says: Uncaught my own words"),
        "{said}"
    );
    assert!(said.contains("keeps its earlier capture"), "{said}");
    let (rejecting, _) = case("page-rejects.html");
    let (status, said) = preshade(&["capture", &rejecting, "--patience", "5", "-o"], &folder);
    assert_eq!(status, Some(2), "{said}");
    assert!(
        said.contains("the page says: Uncaught {code: 7, why: \"no adapter for you\"}"),
        "{said}"
    );
    // The profile is in a folder of our own, so that we see whether it is left.
    let profiles = folder.with_extension("profiles");
    let _ = fs::remove_dir_all(&profiles);
    fs::create_dir_all(&profiles).unwrap();
    for signal in ["INT", "TERM", "HUP", "KILL"] {
        // A shell starts what it runs in the background with SIGINT ignored, and `nohup` with SIGHUP.
        let mut running = Command::new("env")
            .args([
                "--default-signal=INT,TERM,HUP",
                env!("CARGO_BIN_EXE_preshade"),
            ])
            .args(["capture", &good, "--after", "600", "-o"])
            .arg(&folder)
            .env("TMPDIR", &profiles)
            .spawn()
            .unwrap();
        let count = || fs::read_dir(&profiles).unwrap().count();
        wait_until(|| count() > 0 && is_running(&profiles));
        let kill = Command::new("kill")
            .args(["-s", signal])
            .arg(running.id().to_string())
            .status();
        assert!(kill.unwrap().success());
        running.wait().unwrap();
        wait_until(|| count() == 0 && !is_running(&profiles));
    }
    assert!(fs::read(folder.join("frame.json")).unwrap() == before);
}

/// Whether a browser has its profile below a folder.
fn is_running(profiles: &Path) -> bool {
    let own = profiles.to_str().unwrap();
    let found = Command::new("pgrep")
        .args(["-f", &format!("user-data-dir={own}")])
        .output();
    !found.unwrap().stdout.is_empty()
}

fn wait_until(mut holds: impl FnMut() -> bool) {
    for _ in 0..600 {
        if holds() {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
    panic!("not within a minute");
}

#[test]
fn a_frame_that_reads_beyond_a_buffer_is_refused_by_name() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let folder = root.join("fixtures/cases/adv/frame-offset");
    let (status, said) = preshade(
        &["verify", "--time", "no", "--variant", "depth-prepass"],
        &folder,
    );
    assert_eq!(status, Some(2));
    let told = "vertex buffer 0: byte 4294967296 and on of buffer 1, which has 120";
    assert!(said.contains(told) && !said.contains("panicked"), "{said}");
}
