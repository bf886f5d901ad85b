//! `preshade capture` of pages of our own, which use most of WebGPU and WebGL 2.
//!
//! Needed: Chromium (`scripts/setup.sh three`). What is missing is a failure, never a skipped test.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use preshade::unstable::capture::Capture;
use preshade::unstable::limits::Limits;

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
