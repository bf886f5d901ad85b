//! Many materials in one process, and `--watch`.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

fn fixture(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../fixtures")
        .join(path)
}

/// A tree of shaders: `lit.wgsl`, and below `sub` another and a GLSL pair.
fn tree(name: &str) -> PathBuf {
    let tree = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&tree);
    fs::create_dir_all(tree.join("shaders/sub")).unwrap();
    for (from, to) in [
        ("shaders/toon.wgsl", "lit.wgsl"),
        ("shaders/grid.wgsl", "sub/grid.wgsl"),
        ("glsl/phong.vert", "sub/phong.vert"),
        ("glsl/phong.frag", "sub/phong.frag"),
    ] {
        fs::copy(fixture(from), tree.join("shaders").join(to)).unwrap();
    }
    tree
}

fn preshade(folder: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_preshade"));
    command.current_dir(folder).args(args);
    command
}

fn run(folder: &Path, args: &[&str]) -> Output {
    preshade(folder, args)
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

const REWRITE: [&str; 6] = [
    "rewrite",
    "shaders",
    "--pass",
    "depth-prepass",
    "--out-dir",
    "out",
];

#[test]
fn the_tree_is_kept_and_what_was_read_is_told() {
    let tree = tree("many-tree");
    let args = [&REWRITE[..], &["--depfile", "out/shaders.d"]].concat();
    let output = run(&tree, &args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    for file in [
        "lit.prepass.wgsl",
        "sub/grid.plan.json",
        "sub/phong.main.wgsl",
    ] {
        assert!(tree.join("out").join(file).is_file(), "{file}");
    }
    let rules = fs::read_to_string(tree.join("out/shaders.d")).unwrap();
    let rules: Vec<&str> = rules.lines().collect();
    assert_eq!(
        rules[2],
        "out/sub/phong.main.wgsl out/sub/phong.prepass.wgsl out/sub/phong.plan.json: shaders/sub/phong.vert shaders/sub/phong.frag"
    );
    assert_eq!(rules.len(), 3);
    // Again: nothing to write.
    assert_eq!(
        stderr(&run(&tree, &REWRITE)),
        "materials: 3 rewritten; files: 0 written, 9 up to date\n"
    );
    // What decides the passes decides the output.
    fs::write(
        tree.join("preshade.toml"),
        "[rewrite]\npass = [\"depth-prepass\"]\n",
    )
    .unwrap();
    let args = [
        "rewrite",
        "shaders/lit.wgsl",
        "-o",
        "one",
        "--depfile",
        "one/lit.d",
    ];
    let output = run(&tree, &args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let rule = fs::read_to_string(tree.join("one/lit.d")).unwrap();
    assert_eq!(
        rule,
        "one/lit.main.wgsl one/lit.prepass.wgsl one/lit.plan.json: shaders/lit.wgsl preshade.toml\n"
    );
}

#[test]
fn one_that_fails_does_not_hold_up_the_others() {
    let tree = tree("many-fails");
    fs::write(tree.join("shaders/broken.wgsl"), "@vertex fn").unwrap();
    let output = run(&tree, &REWRITE);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains("error[parse]"),
        "{}",
        stderr(&output)
    );
    assert!(tree.join("out/sub/grid.prepass.wgsl").is_file());
    // Two materials that would write one file.
    fs::write(tree.join("shaders/broken.wgsl"), "").unwrap();
    fs::remove_file(tree.join("shaders/broken.wgsl")).unwrap();
    fs::copy(
        fixture("glsl/phong.vert"),
        tree.join("shaders/sub/grid.vert"),
    )
    .unwrap();
    fs::copy(
        fixture("glsl/phong.frag"),
        tree.join("shaders/sub/grid.frag"),
    )
    .unwrap();
    let output = run(&tree, &REWRITE);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains("grid.main.wgsl is already written of"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn what_is_said_of_one_of_many_names_its_files() {
    let tree = tree("many-said");
    fs::write(tree.join("shaders/broken.wgsl"), "@vertex fn").unwrap();
    let output = run(&tree, &[&REWRITE[..], &["--blend", "alpha"]].concat());
    assert_eq!(output.status.code(), Some(2));
    let said = stderr(&output);
    for files in [
        "\n = in shaders/lit.wgsl\n",
        "\n = in shaders/sub/phong.vert and shaders/sub/phong.frag\n",
    ] {
        assert!(said.contains(files), "{files}: {said}");
    }
    let sum = "materials: 0 rewritten, 3 written as they are, 1 failed; files: 6 written, 0 up to date; refused: depth-prepass/blended 3\n";
    assert!(said.contains(sum), "{said}");
}

#[test]
fn a_folder_wants_out_dir() {
    let tree = tree("many-out");
    for input in [
        &["shaders"][..],
        &[
            "shaders/lit.wgsl",
            "shaders/sub/grid.wgsl",
            "shaders/lit.wgsl",
        ],
    ] {
        let output = run(&tree, &[&["rewrite", "-o", "out"], input].concat());
        assert_eq!(output.status.code(), Some(2));
        let said = stderr(&output);
        assert!(said.contains("--out-dir DIR` takes each file"), "{said}");
        assert!(!tree.join("out").exists());
    }
}

#[test]
fn the_report_is_json() {
    let tree = tree("many-json");
    let output = run(&tree, &[&REWRITE[..], &["--format", "json"]].concat());
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["schema"], "preshade.rewrite.v1");
    let materials = report["materials"].as_array().unwrap();
    let names: Vec<&str> = materials
        .iter()
        .map(|m| m["material"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["lit", "grid", "phong"]);
    assert_eq!(materials[1]["files"][0]["path"], "out/sub/grid.main.wgsl");
    assert_eq!(stderr(&output), "");
    // Without a folder the texts are in it, and a refusal is.
    let output = run(
        &tree,
        &[
            "rewrite",
            "shaders/lit.wgsl",
            "--pass",
            "depth-prepass",
            "--blend",
            "alpha",
            "--format",
            "json",
        ],
    );
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["materials"][0]["refusals"][0]["code"], "blended");
    assert!(
        report["materials"][0]["files"][0]["text"]
            .as_str()
            .unwrap()
            .contains("@fragment")
    );
}

#[test]
fn passes_are_timed_and_printed_after() {
    let tree = tree("many-after");
    let args = [
        "rewrite",
        "shaders/lit.wgsl",
        "--pass",
        "depth-prepass",
        "--time-passes",
        "--print-after",
        "all",
        "-o",
        "out",
    ];
    let said = stderr(&run(&tree, &args));
    assert!(
        said.contains("// after depth-prepass\n// lit.main.wgsl"),
        "{said}"
    );
    for line in ["ms  parse", "ms  depth-prepass", "ms  emit", "ms  in all"] {
        assert!(said.contains(line), "{said}");
    }
    let unknown = run(
        &tree,
        &[
            "rewrite",
            "shaders/lit.wgsl",
            "--print-after",
            "depth-prepas",
        ],
    );
    assert_eq!(unknown.status.code(), Some(2));
    assert!(stderr(&unknown).contains("did you mean `depth-prepass`?"));
}

/// A process that is ended with the test, and the lines of its stderr.
struct Watched(Child, Receiver<String>);

impl Watched {
    fn start(folder: &Path, args: &[&str]) -> Self {
        let mut child = preshade(folder, args)
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let (send, lines) = channel();
        let messages = BufReader::new(child.stderr.take().unwrap());
        std::thread::spawn(move || {
            for line in messages.lines().map_while(Result::ok) {
                // The test may be over.
                let _ = send.send(line);
            }
        });
        Self(child, lines)
    }

    /// The lines up to the next that says that changes are waited for.
    fn until_it_waits(&self) -> Vec<String> {
        let next = || {
            self.1
                .recv_timeout(Duration::from_secs(60))
                .expect("it does not run")
        };
        std::iter::repeat_with(next)
            .take_while(|l| !l.starts_with("watching "))
            .collect()
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn watch_writes_again_what_changed() {
    let tree = tree("many-watch");
    let watched = Watched::start(&tree, &[&REWRITE[..], &["--watch"]].concat());
    // Nine files, and their sum.
    assert_eq!(watched.until_it_waits().len(), 10);
    let path = tree.join("shaders/sub/grid.wgsl");
    let text = fs::read_to_string(&path).unwrap();
    // A mistake is told, and waited on.
    fs::write(&path, "@vertex fn").unwrap();
    let said = watched.until_it_waits().join("\n");
    assert!(said.contains("error[parse]"), "{said}");
    fs::write(&path, format!("{text}// edited\n")).unwrap();
    let said = watched.until_it_waits();
    assert_eq!(
        said,
        [
            "wrote out/sub/grid.main.wgsl",
            "materials: 3 rewritten; files: 1 written, 8 up to date"
        ]
    );

    let stdin = preshade(&tree, &["rewrite", "-", "--lang", "wgsl", "--watch"])
        .stdin(Stdio::null())
        .output()
        .unwrap();
    assert_eq!(stdin.status.code(), Some(2));
    assert!(stderr(&stdin).contains("stdin is read once"));
}

/// What `plan` decides on a scene is what a build script makes of the shader.
#[test]
fn a_decision_is_kept_for_builds() {
    let tree = tree("many-lock");
    let scene = fs::read_to_string(fixture("scenes/first.toml")).unwrap();
    fs::create_dir_all(tree.join("scenes")).unwrap();
    let scene = scene.replace(
        "[materials.stone]\n",
        "[materials.stone]\ndefines = { FOG = 1 }\n",
    );
    assert!(scene.contains("FOG"));
    fs::write(tree.join("scenes/first.toml"), scene).unwrap();
    for shader in ["textured.wgsl", "foliage.wgsl"] {
        fs::copy(
            fixture("shaders").join(shader),
            tree.join("shaders").join(shader),
        )
        .unwrap();
    }
    let args = [
        "plan",
        "scenes/first.toml",
        "--lock",
        "--one",
        "--size",
        "48x32",
        "--frames",
        "1",
        "--seconds",
        "0.05",
        "--runners",
        "1",
    ];
    let output = run(&tree, &args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let path = tree.join("shaders/preshade.lock");
    let lock = preshade::lock::Lock::read(&path).unwrap().unwrap();
    let names: Vec<&String> = lock.materials.keys().collect();
    assert_eq!(names, ["leaves", "stone"]);
    assert!(lock.materials["stone"].measured.is_some());
    let build = |builder: preshade::build_script::Builder| {
        let builder = builder.name("stone").out_dir(tree.join("out"));
        builder
            .build(&[&tree.join("shaders/textured.wgsl")])
            .unwrap()
    };
    let built = build(preshade::configure().define("FOG", "1").vertex("vs_main"));
    assert_eq!(built.warnings, [""; 0]);
    let otherwise = build(preshade::configure());
    assert!(otherwise.warnings[0].contains("other definitions (FOG)"));
    assert_eq!(built.read.last(), Some(&path));
    let predicted = run(&tree, &[&args[..], &["--time", "no"]].concat());
    assert_eq!(predicted.status.code(), Some(2));
}
