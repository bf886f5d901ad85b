//! Compilers that are not ours judge what we emit: Tint for WGSL, spirv-val for SPIR-V, glslang for
//! GLSL.
//!
//! Needed: Debian's `spirv-tools` and `glslang-tools`, node 18 or later, and
//! `npm ci --ignore-scripts` in `tests/accept`. A tool that is missing is a failure, never a
//! skipped check.

use std::collections::{BTreeMap, HashSet};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};

use rayon::prelude::*;
use shader_text::files::File;

/// What each judge was shown, so that a test can tell that it was shown anything.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Judged {
    /// Files given to Tint.
    pub wgsl: usize,
    /// Files given to spirv-val.
    pub spirv: usize,
    /// Files given to glslang.
    pub glsl: usize,
    /// Programs with tessellation stages that glslang linked.
    pub linked: usize,
}

/// Files with the labels of their sets.
type Labelled<'a> = Vec<&'a (&'a str, PathBuf)>;

/// Has every file of every set judged, each text once: a set is a label, for the message, and what
/// `emit::emit` returned. Panics with all rejections, each with the text that was refused. Files
/// other than shaders pass unread.
pub fn accept(sets: &[(String, Vec<File>)]) -> Judged {
    let dir = scratch();
    let mut paths = Vec::new();
    let mut seen = HashSet::new();
    for (i, (label, files)) in sets.iter().enumerate() {
        // A stage that no pass changed is that of many sets. Stages that are linked are looked at
        // together.
        let rules = |f: &File| f.name.split('.').skip(1).collect::<Vec<_>>().join(".");
        let is_linked = |f: &File| {
            let control = Path::new(&f.name).with_extension("tesc");
            files.iter().any(|f| Path::new(&f.name) == control)
        };
        let new = |f: &&File| seen.insert((rules(f), f.bytes.clone())) || is_linked(f);
        let dir = dir.join(i.to_string());
        std::fs::create_dir_all(&dir).unwrap();
        for file in files.iter().filter(new) {
            let path = dir.join(&file.name);
            std::fs::write(&path, &file.bytes).unwrap();
            paths.push((label.as_str(), path));
        }
    }
    let of = |extensions: &[&str]| -> Vec<&(&str, PathBuf)> {
        paths
            .iter()
            .filter(|(_, p)| {
                p.extension()
                    .and_then(|e| e.to_str())
                    .is_some_and(|e| extensions.contains(&e))
            })
            .collect()
    };
    let (wgsl, spirv, glsl) = (
        of(&["wgsl"]),
        of(&["spv"]),
        of(&["vert", "tesc", "tese", "frag", "comp"]),
    );
    let controls = of(&["tesc"]);
    let by_spirv_val = |(label, path): &&(&str, PathBuf)| {
        let mut command = Command::new("spirv-val");
        command.args(["--target-env", "vulkan1.1"]).arg(path);
        run(command, label, path)
    };
    let (alone, of_programs): (Labelled<'_>, Labelled<'_>) = glsl
        .iter()
        .partition(|(_, path)| !path.with_extension("tesc").exists() && !is_for_vulkan(path));
    let is_alone = |file: &&&(&str, PathBuf)| !file.1.with_extension("tesc").exists();
    let vulkan: Labelled<'_> = of_programs.iter().filter(is_alone).copied().collect();
    let by_glslang = |some: &[&(&str, PathBuf)]| -> Vec<String> {
        let mut all = Command::new("glslangValidator");
        let all = all.args(some.iter().map(|(_, path)| path)).output();
        if all.is_ok_and(|o| o.status.success()) {
            return Vec::new();
        }
        let one = |(label, path): &&(&str, PathBuf)| {
            let mut command = Command::new("glslangValidator");
            command.arg(path);
            run(command, label, path)
        };
        let refused: Vec<String> = some.iter().filter_map(one).collect();
        assert!(
            !refused.is_empty(),
            "glslang refused files together that it takes one by one"
        );
        refused
    };
    let linked = |(label, control): &&(&str, PathBuf)| {
        let mut command = glslang(control);
        command.arg("-l");
        command.args(["vert", "tesc", "tese", "frag"].map(|e| control.with_extension(e)));
        run(command, &format!("{label}, all stages"), control)
    };
    let by_vulkan = |(label, path): &&(&str, PathBuf)| {
        let mut command = glslang(path);
        command.arg(path);
        run(command, label, path)
    };
    let others = || -> Vec<String> {
        let vulkan = vulkan.par_iter().filter_map(by_vulkan);
        let spirv = spirv.par_iter().filter_map(by_spirv_val);
        // It makes its tables anew in each process, which takes it longer than a file.
        let alone = alone.par_chunks(32).flat_map_iter(by_glslang);
        let controls = controls.par_iter().filter_map(linked);
        spirv.chain(alone).chain(controls).chain(vulkan).collect()
    };
    let (mut rejections, more) = rayon::join(|| tint(&wgsl), others);
    rejections.extend(more);
    assert!(
        rejections.is_empty(),
        "{} of {} files were refused\n\n{}",
        rejections.len(),
        paths.len(),
        rejections.join("\n\n")
    );
    std::fs::remove_dir_all(&dir).unwrap();
    Judged {
        wgsl: wgsl.len(),
        spirv: spirv.len(),
        glsl: alone.len() + of_programs.len(),
        linked: controls.len(),
    }
}

/// glslang by the rules of the file's API: OpenGL's, or Vulkan's, which it knows by writing SPIR-V.
fn glslang(path: &Path) -> Command {
    let mut command = Command::new("glslangValidator");
    if is_for_vulkan(path) {
        command.arg("-V").arg("-o");
        // A name that no file has, though several are written to it in turn.
        command.arg(path.with_extension("judged"));
    }
    command
}

fn is_for_vulkan(path: &Path) -> bool {
    let stem = path.file_stem().and_then(|s| s.to_str());
    stem.is_some_and(|s| s.ends_with(".vulkan") || s.ends_with(".vk"))
}

/// A folder of its own for a check.
pub fn scratch() -> PathBuf {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let n = NEXT.fetch_add(1, Ordering::Relaxed);
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("accept-{}-{n}", std::process::id()))
}

/// Pipelines that Dawn created.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Created {
    /// How many.
    pub pipelines: usize,
    /// Passes that need what Dawn lacks, by feature or limit.
    pub lacking: BTreeMap<String, usize>,
}

/// Has Dawn create the pipeline of every pass with explicit layouts, from `plan.json` and the WGSL
/// that it names alone. Panics with all that are refused.
pub fn create(sets: &[(String, Vec<File>)]) -> Created {
    let dir = scratch();
    let mut plans = Vec::new();
    for (i, (_, files)) in sets.iter().enumerate() {
        let dir = dir.join(i.to_string());
        std::fs::create_dir_all(&dir).unwrap();
        for file in files {
            std::fs::write(dir.join(&file.name), &file.bytes).unwrap();
        }
        let json = files.iter().find(|f| f.name.ends_with(".plan.json"));
        plans.push(dir.join(&json.unwrap().name));
    }
    let paths: Vec<&Path> = plans.iter().map(PathBuf::as_path).collect();
    let mut created = Created::default();
    let mut refused = Vec::new();
    for (verdict, (label, files)) in judged_by("plan.mjs", &paths).iter().zip(sets) {
        created.pipelines += verdict["pipelines"].as_u64().unwrap() as usize;
        for name in verdict["lacking"].as_array().unwrap() {
            let name = name.as_str().unwrap().to_owned();
            *created.lacking.entry(name).or_default() += 1;
        }
        let errors = verdict["errors"].as_array().unwrap();
        if !errors.is_empty() {
            let text = |f: &File| format!("{}\n{}", f.name, String::from_utf8_lossy(&f.bytes));
            let texts: Vec<String> = files.iter().map(text).collect();
            refused.push(format!(
                "Dawn on {label}: {errors:#?}\n{}",
                texts.join("\n")
            ));
        }
    }
    let all = refused.join("\n\n");
    assert!(
        refused.is_empty(),
        "{} plans were refused\n\n{all}",
        refused.len()
    );
    std::fs::remove_dir_all(&dir).unwrap();
    created
}

/// Tint's errors of each file, all in one node process.
fn tint_errors(files: &[&Path]) -> Vec<Vec<serde_json::Value>> {
    let errors = |v: serde_json::Value| v["errors"].as_array().unwrap().clone();
    judged_by("tint.mjs", files)
        .into_iter()
        .map(errors)
        .collect()
}

/// What a script of `tests/accept` prints of each file, all in one node process.
fn judged_by(script: &str, files: &[&Path]) -> Vec<serde_json::Value> {
    judged_with(script, files, &[])
}

/// As [`judged_by`], with variables of the environment.
pub fn judged_with(
    script: &str,
    files: &[&Path],
    environment: &[(&str, &Path)],
) -> Vec<serde_json::Value> {
    if files.is_empty() {
        return Vec::new();
    }
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/accept");
    let missing = "Tint is not installed: run `npm ci --ignore-scripts` in tests/accept";
    assert!(here.join("node_modules/webgpu").is_dir(), "{missing}");
    let mut node = Command::new("node")
        .arg(here.join(script))
        .envs(environment.iter().copied())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap_or_else(|e| panic!("node does not start ({e}): install node 18 or later"));
    let list: String = files
        .iter()
        .map(|path| format!("{}\n", path.display()))
        .collect();
    node.stdin
        .take()
        .unwrap()
        .write_all(list.as_bytes())
        .unwrap();
    let output = node.wait_with_output().unwrap();
    assert!(
        output.status.success(),
        "{script} failed: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    let printed = String::from_utf8_lossy(&output.stdout);
    let verdicts: serde_json::Value =
        serde_json::from_str(printed.lines().last().unwrap()).unwrap();
    let verdicts = verdicts.as_array().unwrap().clone();
    assert_eq!(verdicts.len(), files.len(), "{script} judged every file");
    verdicts
}

/// Tint's errors of each text, the message of each.
pub fn tint_says(texts: &[String]) -> Vec<Vec<String>> {
    let dir = scratch();
    std::fs::create_dir_all(&dir).unwrap();
    let paths: Vec<PathBuf> = (0..texts.len())
        .map(|n| dir.join(format!("{n}.wgsl")))
        .collect();
    for (path, text) in paths.iter().zip(texts) {
        std::fs::write(path, text).unwrap();
    }
    let borrowed: Vec<&Path> = paths.iter().map(PathBuf::as_path).collect();
    let errors = tint_errors(&borrowed);
    std::fs::remove_dir_all(&dir).unwrap();
    let message = |e: &serde_json::Value| e["message"].as_str().unwrap_or_default().to_owned();
    errors
        .iter()
        .map(|of| of.iter().map(message).collect())
        .collect()
}

fn tint(files: &[&(&str, PathBuf)]) -> Vec<String> {
    let paths: Vec<&Path> = files.iter().map(|(_, path)| path.as_path()).collect();
    let mut rejections = Vec::new();
    for ((label, path), errors) in files.iter().zip(tint_errors(&paths)) {
        if !errors.is_empty() {
            let text = std::fs::read_to_string(path).unwrap();
            rejections.push(format!("Tint on {label}: {errors:#?}\n{}", numbered(&text)));
        }
    }
    rejections
}

fn run(mut command: Command, label: &str, path: &Path) -> Option<String> {
    let tool = command.get_program().to_string_lossy().into_owned();
    let output = command.output().unwrap_or_else(|e| {
        panic!("{tool} does not start ({e}): apt-get install spirv-tools glslang-tools")
    });
    if output.status.success() {
        return None;
    }
    let text = std::fs::read_to_string(path).unwrap_or_default();
    Some(format!(
        "{tool} on {label}: {}{}\n{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
        numbered(&text)
    ))
}

fn numbered(text: &str) -> String {
    text.lines()
        .enumerate()
        .map(|(i, line)| format!("{:4} {line}\n", i + 1))
        .collect()
}
