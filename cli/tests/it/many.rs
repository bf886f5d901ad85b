//! Many materials in one process, and `--watch`.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use crate::hostile_support::{preshade, run, stderr};
use crate::trees::{fixture, tree};

const REWRITE: [&str; 6] = [
    "rewrite",
    "shaders",
    "--pass",
    "depth-prepass",
    "--out-dir",
    "out",
];

/// What is told of `phong`, which is Vulkan's GLSL.
const UPSIDE_DOWN: &str = "note: `phong`: the text is read as Vulkan's, whose y points down: WebGPU \
                           draws the WGSL upside down; end the vertex stage with `gl_Position.y = \
                           -gl_Position.y;`, or negate y in the projection\n = in \
                           shaders/sub/phong.vert and shaders/sub/phong.frag\n";

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
        "out/sub/phong.main.wgsl out/sub/phong.prepass.wgsl out/sub/phong.plan.json: \
         shaders/sub/phong.vert shaders/sub/phong.frag"
    );
    // And an empty one for each file read, so that make goes on without it.
    assert_eq!(rules.len(), 7);
    assert_eq!(rules[3], "shaders/lit.wgsl:");
    // Again: nothing to write.
    let told = stderr(&run(&tree, &REWRITE));
    let sum = "materials: 3 rewritten; files: 0 written, 9 up to date\n";
    assert_eq!(told.strip_prefix(UPSIDE_DOWN), Some(sum), "{told}");
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
        "one/lit.main.wgsl one/lit.prepass.wgsl one/lit.plan.json: shaders/lit.wgsl preshade.toml\n\
         preshade.toml:\nshaders/lit.wgsl:\n"
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
    let sum = "materials: 0 rewritten, 3 written as they are, 1 failed; \
               files: 6 written, 0 up to date; refused: depth-prepass/blended 3\n";
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
    assert_eq!(stderr(&output), UPSIDE_DOWN);
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
        let mut child = preshade(folder)
            .args(args)
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
    // Nine files, their sum, and a note of two lines.
    assert_eq!(watched.until_it_waits().len(), 12);
    let path = tree.join("shaders/sub/grid.wgsl");
    let text = fs::read_to_string(&path).unwrap();
    // A mistake is told, and waited on.
    fs::write(&path, "@vertex fn").unwrap();
    let said = watched.until_it_waits().join("\n");
    assert!(said.contains("error[parse]"), "{said}");
    fs::write(&path, format!("{text}// edited\n")).unwrap();
    let mut said = watched.until_it_waits();
    said.retain(|line| !UPSIDE_DOWN.contains(line.as_str()));
    assert_eq!(
        said,
        [
            "wrote out/sub/grid.main.wgsl",
            "materials: 3 rewritten; files: 1 written, 8 up to date"
        ]
    );

    let stdin = preshade(&tree)
        .args(["rewrite", "-", "--lang", "wgsl", "--watch"])
        .stdin(Stdio::null())
        .output()
        .unwrap();
    assert_eq!(stdin.status.code(), Some(2));
    assert!(stderr(&stdin).contains("stdin is read once"));
}

#[test]
fn a_depfile_goes_into_a_pipe_and_has_what_is_included() {
    let tree = tree("many-pipe");
    let args = ["rewrite", "shaders/lit.wgsl", "-o", "out", "--depfile"];
    let rule = "out/lit.main.wgsl out/lit.plan.json: shaders/lit.wgsl\nshaders/lit.wgsl:\n";
    let stdout = run(&tree, &[&args[..], &["-"]].concat()).stdout;
    assert_eq!(String::from_utf8(stdout).unwrap(), rule);
    #[cfg(unix)]
    {
        // It must not wait for what it would write itself.
        let mut child = preshade(&tree)
            .args(args)
            .arg("/dev/stdout")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let end = std::time::Instant::now() + Duration::from_secs(60);
        while child.try_wait().unwrap().is_none() {
            if std::time::Instant::now() > end {
                child.kill().unwrap();
                panic!("it does not end");
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let output = child.wait_with_output().unwrap();
        assert_eq!(String::from_utf8(output.stdout).unwrap(), rule);
    }
    lamp(&tree);
    let args = [
        &LAMP[..],
        &["--include", "lib", "-o", "out", "--depfile", "lamp.d"],
    ]
    .concat();
    let output = run(&tree, &args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let rules = fs::read_to_string(tree.join("lamp.d")).unwrap();
    let first = rules.lines().next().unwrap();
    assert!(
        first.ends_with(": lamp.vert lamp.frag lib/falloff.glsl"),
        "{rules}"
    );
}

const LAMP: [&str; 5] = ["rewrite", "lamp.vert", "lamp.frag", "--define", "REACH=2"];

/// A GLSL pair, and in `lib` what it includes.
fn lamp(tree: &Path) {
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/glsl");
    fs::create_dir_all(tree.join("lib")).unwrap();
    for file in ["lamp.vert", "lamp.frag", "lib/falloff.glsl"] {
        fs::copy(from.join(file), tree.join(file)).unwrap();
    }
}

#[test]
fn a_flag_goes_before_the_environment_and_that_before_the_file() {
    let tree = tree("many-before");
    fs::write(
        tree.join("preshade.toml"),
        "[rewrite]\nout-dir = \"file\"\nno-depth-write = true\n",
    )
    .unwrap();
    let of = |args: &[&str], variables: &[(&str, &str)]| {
        let args = [&["rewrite", "shaders/lit.wgsl"], args].concat();
        let mut command = preshade(&tree);
        command.args(args);
        command.envs(variables.iter().copied()).stdin(Stdio::null());
        let output = command.output().unwrap();
        let said = String::from_utf8(output.stdout.clone()).unwrap();
        (output.status.code(), said, stderr(&output))
    };
    // Another flag than the file's, which it excludes.
    let (status, _, said) = of(&["-o", "flag"], &[]);
    assert_eq!(status, Some(0), "{said}");
    assert!(tree.join("flag/lit.main.wgsl").is_file() && !tree.join("file").exists());
    let (status, _, said) = of(&["-o", "flag"], &[("PRESHADE_OUT_DIR", "environment")]);
    assert_eq!(status, Some(0), "{said}");
    assert!(!tree.join("environment").exists());
    let config = |args: &[&str], variables: &[(&str, &str)]| {
        of(&[args, &["--print-config"]].concat(), variables).1
    };
    let said = config(&[], &[("PRESHADE_OUT", "a"), ("PRESHADE_NAME", "007")]);
    for line in [
        "out = \"a\" # PRESHADE_OUT",
        "# out-dir is not set",
        "no-depth-write = true # preshade.toml",
        "name = \"007\" # PRESHADE_NAME",
    ] {
        assert!(said.contains(line), "{line}: {said}");
    }
    let said = config(&["--no-depth-write=false"], &[]);
    assert!(said.contains("no-depth-write = false # flag"), "{said}");
    // Several values, a switch as a number, and an empty word for none.
    let said = config(
        &[],
        &[
            ("PRESHADE_PASS", "depth-prepass:form=equal; shadow"),
            ("PRESHADE_TIME_PASSES", "1"),
            ("PRESHADE_SAMPLES", ""),
        ],
    );
    for line in [
        "pass = [\"depth-prepass:form=equal\", \"shadow\"] # PRESHADE_PASS",
        "time-passes = true # PRESHADE_TIME_PASSES",
        "# samples is not set",
    ] {
        assert!(said.contains(line), "{line}: {said}");
    }
    // What is wrong names where it stands.
    let (status, _, said) = of(&[], &[("PRESHADE_SAMPLES", "four")]);
    assert_eq!(status, Some(2));
    assert!(
        said.contains("= PRESHADE_SAMPLES of the environment"),
        "{said}"
    );
    let (status, _, said) = of(&[], &[("PRESHADE_OUT", "a"), ("PRESHADE_OUT_DIR", "b")]);
    assert_eq!(status, Some(2));
    assert!(said.contains("the environment sets both"), "{said}");
}

/// The camera and the size are those of `--scene`, which these commands can do without.
#[test]
fn a_value_of_the_file_that_a_command_has_no_use_for_is_left() {
    let tree = tree("many-of-no-use");
    let file = "size = \"64x36\"\ncamera = [\"wall\"]\n";
    fs::write(tree.join("preshade.toml"), file).unwrap();
    let lit = "shaders/lit.wgsl";
    let explain = ["explain", lit];
    let agree = ["agree", lit, "--with", lit, "--as", "same"];
    for command in [&explain[..], &agree] {
        let output = run(&tree, command);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let output = run(&tree, &[command, &["--size", "32x18"]].concat());
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains("are for --scene"), "{command:?}");
    }
    let printed = |args: &[&str]| {
        let output = run(&tree, &[&explain, args, &["--print-config"]].concat());
        String::from_utf8(output.stdout).unwrap()
    };
    assert!(printed(&[]).contains("# size is not set"));
    assert!(printed(&["--scene"]).contains("size = \"64x36\" # preshade.toml"));
    // For any command, or for this one.
    for flag in ["scene = true\n", "[explain]\nscene = true\n"] {
        fs::write(tree.join("preshade.toml"), format!("{file}{flag}")).unwrap();
        assert!(printed(&[]).contains("size = \"64x36\""), "{flag}");
        assert!(printed(&["--scene=false"]).contains("# size is not set"));
    }
}

#[test]
fn help_does_not_rest_on_the_file() {
    let tree = tree("many-help");
    let file = tree.join("preshade.toml");
    fs::write(&file, "bogus = 1\n").unwrap();
    for args in [
        &["--help"][..],
        &["--version"],
        &["rewrite", "--help"],
        &["--explain", "blended"],
        &["man"],
        &["completions", "bash"],
    ] {
        let output = run(&tree, args);
        assert_eq!(output.status.code(), Some(0), "{args:?}");
        assert!(!output.stdout.is_empty(), "{args:?}");
    }
    assert_eq!(run(&tree, &["passes"]).status.code(), Some(2));
    // A command without files has nothing to watch, and runs once.
    fs::write(&file, "watch = true\n").unwrap();
    assert_eq!(run(&tree, &["passes"]).status.code(), Some(0));
    fs::write(&file, "out = [\"a\", \"b\"]\n").unwrap();
    let output = run(&tree, &["rewrite", "shaders/lit.wgsl"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("`out` is one value, not a list"));
}

#[test]
fn a_folder_is_searched_once_and_what_was_made_is_left_out() {
    let tree = tree("many-once");
    let args = ["rewrite", "shaders", "--out-dir", "shaders/out"];
    #[cfg(unix)]
    for (of, link) in [("../shaders", "loop"), ("..", "up"), ("sub", "same")] {
        std::os::unix::fs::symlink(of, tree.join("shaders").join(link)).unwrap();
    }
    let first = stderr(&run(&tree, &args));
    assert!(first.contains("files: 6 written, 0 up to date"), "{first}");
    let second = stderr(&run(&tree, &args));
    assert!(
        second.contains("files: 0 written, 6 up to date"),
        "{second}"
    );
    // What has no entry points is to be included.
    fs::write(
        tree.join("shaders/common.wgsl"),
        "fn f() -> f32 { return 1.0; }\n",
    )
    .unwrap();
    let output = run(&tree, &args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let said = stderr(&output);
    assert!(
        said.contains("note: no material: there is no entry point"),
        "{said}"
    );
    assert!(said.contains(", 1 left out; "), "{said}");
    // Given by name it is a mistake.
    let output = run(&tree, &["rewrite", "shaders/common.wgsl"]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn files_of_two_folders_are_two_materials() {
    let tree = tree("many-two");
    for folder in ["a", "b"] {
        fs::create_dir_all(tree.join(folder)).unwrap();
        fs::copy(
            tree.join("shaders/lit.wgsl"),
            tree.join(folder).join("lit.wgsl"),
        )
        .unwrap();
    }
    let output = run(&tree, &["rewrite", "a", "b", "--out-dir", "out"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    for file in ["out/a/lit.main.wgsl", "out/b/lit.main.wgsl"] {
        assert!(tree.join(file).is_file(), "{file}");
    }
    // Below one folder they would take each other's place.
    let up = tree.join("b/../a/lit.wgsl");
    let down = tree.join("b/lit.wgsl");
    let args = [
        "rewrite",
        up.to_str().unwrap(),
        down.to_str().unwrap(),
        "--out-dir",
        "flat",
    ];
    let output = run(&tree, &args);
    assert_eq!(output.status.code(), Some(2));
    let said = stderr(&output);
    assert!(
        said.contains("flat/lit.main.wgsl is already written of"),
        "{said}"
    );
}

#[test]
fn what_cannot_be_written_does_not_hold_up_the_rest() {
    let tree = tree("many-unwritten");
    fs::create_dir_all(tree.join("out")).unwrap();
    fs::write(tree.join("out/sub"), "in the way").unwrap();
    fs::create_dir_all(tree.join("shaders/z")).unwrap();
    fs::copy(
        tree.join("shaders/lit.wgsl"),
        tree.join("shaders/z/last.wgsl"),
    )
    .unwrap();
    let args = [&REWRITE[..], &["--format", "json", "--depfile", "out/d"]].concat();
    let output = run(&tree, &args);
    assert_eq!(output.status.code(), Some(2));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let error = report["errors"][0].as_str().unwrap();
    assert!(error.contains("out/sub is a file"), "{error}");
    assert!(tree.join("out/z/last.main.wgsl").is_file());
    assert!(tree.join("out/d").is_file());
}

#[test]
fn what_fails_is_json_too() {
    let tree = tree("many-failed");
    for args in [
        &["explain", "nothing.wgsl"][..],
        &["rewrite", "shaders/lit.wgsl", "--pass", "nope"],
    ] {
        let output = run(&tree, &[args, &["--format", "json"]].concat());
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(told["schema"], "preshade.error.v1");
        let error = told["errors"][0].as_str().unwrap();
        assert!(stderr(&output).contains(error), "{error}");
    }
}

#[test]
fn names_and_halves_are_told() {
    let tree = tree("many-told");
    for name in [".", "..", "a:b", "a/b", "a\nb"] {
        let output = run(&tree, &["rewrite", "shaders/lit.wgsl", "--name", name]);
        assert_eq!(output.status.code(), Some(2), "{name}");
    }
    fs::write(
        tree.join("half.wgsl"),
        "@vertex fn v() -> @builtin(position) vec4<f32> { return vec4<f32>(); }\n",
    )
    .unwrap();
    let args = [
        "rewrite",
        "half.wgsl",
        "-o",
        "out",
        "--print-after",
        "shadow",
    ];
    let said = stderr(&run(&tree, &args));
    assert!(said.contains("`half` has no fragment stage"), "{said}");
    assert!(
        said.contains("warning: --print-after shadow: no --pass is shadow"),
        "{said}"
    );
    #[cfg(target_os = "linux")]
    {
        use std::os::unix::ffi::OsStrExt;
        let name = std::ffi::OsStr::from_bytes(b"n\xff.wgsl");
        fs::copy(tree.join("shaders/lit.wgsl"), tree.join(name)).unwrap();
        let output = preshade(&tree).arg("rewrite").arg(name).output().unwrap();
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains("the name is not UTF-8"));
    }
}

#[test]
fn watch_sees_what_comes_and_what_is_made_again() {
    let tree = tree("many-comes");
    let watched = Watched::start(&tree, &[&REWRITE[..], &["--watch"]].concat());
    assert_eq!(watched.until_it_waits().len(), 12);
    // A file that was not there.
    fs::copy(
        tree.join("shaders/lit.wgsl"),
        tree.join("shaders/sub/new.wgsl"),
    )
    .unwrap();
    let until = |what: &str| {
        let mut said = Vec::new();
        // An editor's or a copy's steps may be told of one by one.
        while !said.iter().any(|l: &String| l.contains(what)) {
            said.extend(watched.until_it_waits());
        }
    };
    until("wrote out/sub/new.main.wgsl");
    // The file with values for flags.
    fs::write(tree.join("preshade.toml"), "blend = \"alpha\"\n").unwrap();
    until("depth-prepass/blended 4");
    fs::remove_file(tree.join("preshade.toml")).unwrap();
    until("materials: 4 rewritten");
    // A folder that goes and comes again.
    fs::rename(tree.join("shaders/sub"), tree.join("elsewhere")).unwrap();
    until("out/ is up to date");
    fs::rename(tree.join("elsewhere"), tree.join("shaders/sub")).unwrap();
    until("materials: 4 rewritten");
    let path = tree.join("shaders/sub/new.wgsl");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, format!("{text}// edited\n")).unwrap();
    until("wrote out/sub/new.main.wgsl");
}

#[test]
fn watch_sees_a_missing_include_come() {
    let tree = tree("many-missing");
    lamp(&tree);
    fs::rename(tree.join("lib/falloff.glsl"), tree.join("kept")).unwrap();
    let args = [&LAMP[..], &["--include", "lib", "-o", "out", "--watch"]].concat();
    let watched = Watched::start(&tree, &args);
    let said = watched.until_it_waits().join("\n");
    assert!(said.contains("there is no file"), "{said}");
    fs::rename(tree.join("kept"), tree.join("lib/falloff.glsl")).unwrap();
    let mut said = watched.until_it_waits();
    while !said.iter().any(|l| l.contains("wrote out/lamp.main.wgsl")) {
        said = watched.until_it_waits();
    }
}

/// What is told into a file beside the shaders is no change of theirs: a mistake would be told
/// without end.
#[test]
fn watch_is_not_woken_by_its_own_log() {
    let tree = tree("many-log");
    let shader = tree.join("shaders/lit.wgsl");
    let text = fs::read_to_string(&shader).unwrap();
    fs::write(&shader, "@vertex fn").unwrap();
    let log = tree.join("shaders/log");
    let file = fs::File::create(&log).unwrap();
    let args = [
        "rewrite",
        "shaders/lit.wgsl",
        "--pass",
        "depth-prepass",
        "-o",
        "out",
        "--watch",
    ];
    let (_send, none) = channel();
    let child = preshade(&tree).args(args).stderr(file).spawn().unwrap();
    let _watched = Watched(child, none);
    let until = |wanted: &str| {
        for _ in 0..600 {
            let said = fs::read_to_string(&log).unwrap();
            if said.contains(wanted) {
                return said;
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        panic!("it never says `{wanted}`");
    };
    until("watching ");
    // Many times as long as a burst of changes is gathered.
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!(until("watching ").matches("watching ").count(), 1);
    fs::write(&shader, text).unwrap();
    until("wrote out/lit.main.wgsl");
}

#[cfg(unix)]
#[test]
fn watch_sees_what_a_link_points_at() {
    let tree = tree("many-link");
    fs::create_dir_all(tree.join("far")).unwrap();
    fs::rename(tree.join("shaders/lit.wgsl"), tree.join("far/lit.wgsl")).unwrap();
    std::os::unix::fs::symlink("../far/lit.wgsl", tree.join("shaders/lit.wgsl")).unwrap();
    let args = ["rewrite", "shaders/lit.wgsl", "-o", "out", "--watch"];
    let watched = Watched::start(&tree, &args);
    watched.until_it_waits();
    let text = fs::read_to_string(tree.join("far/lit.wgsl")).unwrap();
    fs::write(tree.join("far/lit.wgsl"), format!("{text}// edited\n")).unwrap();
    watched.until_it_waits();
}
