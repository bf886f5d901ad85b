//! A small scene in a folder of its own, the binary run there, and processes that are killed.
#![allow(dead_code, clippy::unwrap_used, clippy::panic)] // Each test binary uses its own part.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// The binary, run in a folder.
pub fn preshade(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_preshade"));
    command
        .current_dir(folder)
        .env("PRESHADE_PROGRESS", "no")
        .stdin(Stdio::null());
    command
}

pub fn run(folder: &Path, args: &[&str]) -> Output {
    preshade(folder).args(args).output().unwrap()
}

/// [`run`], of what must end within some time.
pub fn run_within(folder: &Path, args: &[&str], time: Duration) -> Output {
    let mut child = preshade(folder)
        .args(args)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if start.elapsed() > time {
            child.kill().unwrap();
            panic!("{args:?} did not end");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    child.wait_with_output().unwrap()
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The errors of a run, which fails.
pub fn refused(folder: &Path, args: &[&str]) -> String {
    ended(&run(folder, args), 2, args)
}

/// A run, which succeeds.
pub fn accepted(folder: &Path, args: &[&str]) {
    ended(&run(folder, args), 0, args);
}

/// What a run with this exit status printed to stderr.
pub fn ended(output: &Output, status: i32, args: &[&str]) -> String {
    let said = stderr(output);
    assert_eq!(output.status.code(), Some(status), "{args:?}: {said}");
    said
}

pub const SHADER: &str = "
struct Camera { view_proj: mat4x4<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> model: mat4x4<f32>;
@vertex fn vs(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> {
    return camera.view_proj * model * vec4(position, 1.0);
}
@fragment fn fs(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    BODY
    return vec4(0.4, 0.5, 0.6, 1.0);
}
";

pub const SCENE: &str = r#"size = [48, 32]
orders = ["as-given"]

[materials."MATERIAL"]
shader = "a.wgsl"

[meshes]
wall.plane = { size = [2, 2] }

[[draws]]
mesh = "wall"
material = "MATERIAL"
rotate = [90, 0, 0]

[[cameras]]
eye = [0, 0.3, 3]
target = [0, 0, 0]
"#;

/// Loops that end by their bounds, after longer than any test waits. A software adapter lets all loops of a shader
/// have 65,535 turns together, so that each turn takes long.
pub fn slow() -> String {
    let turn = "n += sin(n + at.x);".repeat(256);
    format!(
        "var n = 0.0;
    for (var i = 0; i < 200; i++) {{ for (var j = 0; j < 200; j++) {{ {turn} }} }}
    if n > 3.0 {{ return vec4(n); }}"
    )
}

/// A folder of its own with a scene and its shader; a folder beside it holds what the scene must
/// not reach.
pub fn folder(name: &str, scene: &str, body: &str) -> PathBuf {
    let all = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("hostile")
        .join(name);
    let _ = fs::remove_dir_all(&all);
    let root = all.join("given");
    fs::create_dir_all(root.join("scenes")).unwrap();
    fs::write(root.join("preshade.toml"), "").unwrap();
    fs::write(all.join("secret.txt"), "not to be read\n").unwrap();
    fs::write(all.join("secret.wgsl"), SHADER.replace("BODY", "")).unwrap();
    let scenes = root.join("scenes");
    fs::write(scenes.join("a.toml"), scene.replace("MATERIAL", "stone")).unwrap();
    fs::write(scenes.join("a.wgsl"), SHADER.replace("BODY", body)).unwrap();
    scenes
}

/// Waits until `found` finds something, and fails where that takes long or `child` ends first.
pub fn wait<T>(child: &mut Child, what: &str, found: impl Fn() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = found() {
            return found;
        }
        let ended = child.try_wait().unwrap();
        assert!(ended.is_none(), "it ended before {what}");
        assert!(start.elapsed() < Duration::from_secs(240), "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

pub fn kill(process: u32) {
    let killed = Command::new("kill")
        .args(["-9", &process.to_string()])
        .status();
    assert!(killed.unwrap().success());
}
