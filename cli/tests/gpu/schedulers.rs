//! The scripts of `fleet`: run by GNU parallel, and as Slurm and GitHub run them.
//!
//! Needed: GNU parallel, and Python's package for YAML in `tests/fleet/.venv` (`scripts/setup.sh fleet`). What is
//! missing is a failure, never a skipped test.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::SystemTime;

use serde_json::Value;

use crate::hostile_support::{SCENE, SHADER, accepted, ended, run};

/// The tests' own files.
pub fn support() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fleet")
}

pub const INSTALL: &str = "run scripts/setup.sh fleet";

/// The Python that has the package.
pub fn python() -> Command {
    let program = support().join(".venv/bin/python");
    assert!(
        program.exists(),
        "{} is not there: {INSTALL}",
        program.display()
    );
    Command::new(program)
}

/// An empty folder.
pub fn empty(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&dir);
    fs::create_dir_all(&dir).unwrap();
    dir
}

/// Writes a scene of a few pixels and its shader.
pub fn scene(dir: &Path, name: &str, body: &str) {
    let scene = SCENE.replace("[48, 32]", "[16, 12]");
    let scene = scene.replace("a.wgsl", &format!("{name}.wgsl"));
    fs::write(
        dir.join(format!("{name}.toml")),
        scene.replace("MATERIAL", "stone"),
    )
    .unwrap();
    let shader = SHADER.replace("BODY", body);
    fs::write(dir.join(format!("{name}.wgsl")), shader).unwrap();
}

/// Appends the jobs of some files to a list, and returns how many there are.
pub fn list(dir: &Path, file: &str, args: &[&str]) -> usize {
    let args = [&["jobs", "--frames", "1"], args].concat();
    let output = run(dir, &args);
    ended(&output, 0, &args);
    let path = dir.join(file);
    let mut text = fs::read_to_string(&path).unwrap_or_default();
    text.push_str(&String::from_utf8(output.stdout).unwrap());
    fs::write(&path, &text).unwrap();
    text.lines().count()
}

/// The printed script.
pub fn script(dir: &Path, args: &[&str]) -> String {
    let args = [&["fleet"], args].concat();
    let output = run(dir, &args);
    ended(&output, 0, &args);
    String::from_utf8(output.stdout).unwrap()
}

/// Writes a program into `dir/bin`, and returns a `PATH` that finds it first.
pub fn program(dir: &Path, name: &str, text: &str) -> String {
    let bin = dir.join("bin");
    fs::create_dir_all(&bin).unwrap();
    let path = bin.join(name);
    fs::write(&path, text).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    let built = Path::new(env!("CARGO_BIN_EXE_preshade")).parent().unwrap();
    let rest = std::env::var("PATH").unwrap_or_default();
    format!("{}:{}:{rest}", bin.display(), built.display())
}

/// Each result by its job's key, with the time of its last change.
pub fn results(folder: &Path) -> BTreeMap<String, SystemTime> {
    let Ok(entries) = fs::read_dir(folder) else {
        return BTreeMap::new();
    };
    let mut found = BTreeMap::new();
    for entry in entries {
        let entry = entry.unwrap();
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.ends_with(".outcome.json") && !name.starts_with('.') {
            let time = entry.metadata().unwrap().modified().unwrap();
            found.insert(name[..32].to_owned(), time);
        }
    }
    found
}

/// A list of four pictures and a time, and the pictures' results in `whole`.
const JOBS: &str = "the 'jobs'.jsonl";

fn listed(name: &str) -> PathBuf {
    let dir = empty(name);
    scene(&dir, "a", "");
    scene(&dir, "b", "if at.x < 9.0 { return vec4(0.1); }");
    let depth = ["--variant", "depth-prepass", "a.toml"];
    list(
        &dir,
        JOBS,
        &[&depth[..], &["--variant", "depth-prepass:form=equal"]].concat(),
    );
    list(
        &dir,
        JOBS,
        &["--variant", "depth-prepass:form=equal", "b.toml"],
    );
    let time = ["--time", "first-frames", "--seconds", "0.1"];
    let count = list(
        &dir,
        JOBS,
        &[&time[..], &["--variant", "depth-prepass", "b.toml"]].concat(),
    );
    assert_eq!(count, 5);
    let whole = [
        "evaluate", "--jobs", JOBS, "--kind", "picture", "--out", "whole",
    ];
    accepted(&dir, &whole);
    assert_eq!(results(&dir.join("whole")).len(), 4);
    dir
}

/// `out` has the bytes of `whole`, and a time.
fn is_whole(dir: &Path, out: &str) {
    for file in fs::read_dir(dir.join("whole")).unwrap() {
        let file = file.unwrap();
        let other = fs::read(dir.join(out).join(file.file_name())).unwrap();
        assert!(
            fs::read(file.path()).unwrap() == other,
            "{:?}",
            file.file_name()
        );
    }
    assert_eq!(results(&dir.join(out)).len(), 5);
    accepted(dir, &["merge", out]);
}

/// A shell script, which succeeds.
fn shell(dir: &Path, text: &str, flags: &[&str], path: &str) -> String {
    fs::write(dir.join("fleet.sh"), text).unwrap();
    let mut sh = Command::new("sh");
    sh.arg("fleet.sh")
        .args(flags)
        .current_dir(dir)
        .env("PATH", path);
    let output = sh.output().unwrap();
    ended(&output, 0, &["sh"])
}

#[test]
fn gnu_parallel_runs_a_list() {
    let dir = listed("parallel");
    let found = Command::new("parallel").arg("--version").output();
    let found = found.unwrap_or_else(|e| panic!("parallel: {e}: {INSTALL}"));
    assert!(
        String::from_utf8_lossy(&found.stdout).contains("GNU parallel"),
        "{INSTALL}"
    );
    let args = [
        "parallel", "--jobs", JOBS, "--out", "{} 'a'", "--shares", "3",
    ];
    let text = script(&dir, &[&args[..], &["--", "--attempts", "1"]].concat());
    assert_eq!(
        text.matches(" --attempts 1 --partition hash:3/3 --kind ")
            .count(),
        2,
        "{text}"
    );
    let path = program(&dir, "unused", "");
    let said = shell(&dir, &text, &["--jobs", "2"], &path);
    is_whole(&dir, "{} 'a'");
    assert!(said.contains("1 job: 1 measured"), "{said}");
}

/// Runs each task of an array, as `sbatch` has it run.
const SBATCH: &str = r#"#!/bin/sh
cat > "batch-$$"
last=$(sed -n 's/^#SBATCH --array=1-//p' "batch-$$")
for SLURM_ARRAY_TASK_ID in $(seq "$last"); do
    export SLURM_ARRAY_TASK_ID
    sh "batch-$$" || exit
done
"#;

#[test]
fn each_task_of_a_slurm_array_runs_its_share() {
    let dir = listed("slurm");
    let args = ["slurm", "--jobs", JOBS, "--out", "a 'b'", "--shares", "2"];
    let text = script(&dir, &[&args[..], &["--gpu", "a100:1"]].concat());
    let directives: Vec<&str> = text.lines().filter(|l| l.starts_with("#SBATCH")).collect();
    let pictures = [
        "--job-name=preshade-pictures",
        "--array=1-2",
        "--requeue",
        "--gpus=a100:1",
    ];
    let times = [
        "--job-name=preshade-times",
        "--array=1-2",
        "--requeue",
        "--exclusive",
        "--gpus=a100:1",
    ];
    let expected: Vec<String> = pictures
        .iter()
        .chain(&times)
        .map(|d| format!("#SBATCH {d}"))
        .collect();
    assert_eq!(directives, expected);
    let path = program(&dir, "sbatch", SBATCH);
    shell(&dir, &text, &[], &path);
    is_whole(&dir, "a 'b'");
    // Without times there is one array, and without a GPU none is asked for.
    list(
        &dir,
        "pictures.jsonl",
        &["--variant", "depth-prepass", "a.toml"],
    );
    let text = script(&dir, &["slurm", "--jobs", "pictures.jsonl", "--out", "c"]);
    assert!(
        text.contains("--array=1-16\n") && !text.contains("--gpus"),
        "{text}"
    );
    let said = shell(&dir, &text.replace("1-16", "1-2"), &[], &path);
    assert_eq!(said.matches("failed; 0 not run").count(), 2, "{said}");
}

#[test]
fn scripts_say_what_a_timing_job_asks_of_hyperqueue() {
    let dir = empty("asks");
    let asks = |args: &[&str], text: &str| {
        let printed = script(&dir, &[args, &["--jobs", "jobs.jsonl"]].concat());
        assert!(printed.contains(text), "{printed}");
    };
    let gpu = ["--gpu", "gpus/nvidia"];
    asks(&["hq"], "\nsubmit picture\nsubmit time --cpus all\n");
    asks(
        &[&["hq"], &gpu[..]].concat(),
        "\nsubmit time --resource gpus/nvidia=1\n",
    );
    asks(&["hyperqueue"], "ResourceRequest(cpus=\"all\") if is_time");
    let request = "ResourceRequest(resources={\"gpus/nvidia\": 1}) if is_time";
    asks(&[&["hyperqueue"], &gpu[..]].concat(), request);
    let text = script(&dir, &["hq", "--jobs", JOBS, "--out", "a 'b'"]);
    fs::write(
        dir.join(JOBS),
        "{\"kind\":\"time\"}\n{\"kind\":\"picture\",\"a\":\"'$b'\"}\n",
    )
    .unwrap();
    // In place of `hq`: runs the task of each line.
    let path = program(
        &dir,
        "hq",
        "#!/bin/sh\n\
        echo \"$@\" >> said\n\
        while [ \"$1\" != -- ]; do [ \"$1\" != --each-line ] || lines=$2; shift; done; shift\n\
        while read -r HQ_ENTRY; do export HQ_ENTRY; \"$@\"; done < \"$lines\"\n",
    );
    program(
        &dir,
        "preshade",
        "#!/bin/sh\nfor word in \"$@\"; do echo \"<$word>\"; done >> said\ncat >> said\n",
    );
    shell(&dir, &text, &[], &path);
    let said = fs::read_to_string(dir.join("said")).unwrap();
    let words = "<evaluate>\n<--jobs>\n<->\n<--out>\n<a 'b'>\n";
    let picture = format!("{words}{{\"kind\":\"picture\",\"a\":\"'$b'\"}}\n");
    assert!(
        said.contains(&picture) && said.contains(&format!("{words}{{\"kind\":\"time\"}}\n")),
        "{said}"
    );
    assert_eq!(said.matches("--crash-limit 5").count(), 2, "{said}");
}

#[test]
fn mistakes_are_found_before_a_script_is_printed() {
    let dir = empty("mistakes");
    for (args, why) in [
        (
            &["hq", "--shares", "3"][..],
            "each job is a task of HyperQueue: no --shares",
        ),
        (
            &["parallel", "--gpu", "1"],
            "--gpu goes with hq, hyperqueue and slurm",
        ),
        (
            &["github", "--shares", "257"],
            "a matrix of GitHub has at most 256 entries",
        ),
        (&["slurm", "--gpu", "1\n#SBATCH --uid=0"], "invalid value"),
        (&["slurm", "--out", "a\nb"], "control characters"),
        (
            &["slurm", "--", "--adaptor", "x"],
            "unexpected argument '--adaptor'",
        ),
        (
            &["slurm", "--", "--kind", "time"],
            "cannot be used multiple times",
        ),
    ] {
        let args = [&["fleet", "--jobs", "jobs.jsonl"], args].concat();
        let said = ended(&run(&dir, &args), 2, &args);
        assert!(said.contains(why), "{said}");
    }
}

/// A run of a workflow, with folders in place of runners and of artifacts.
struct Workflow {
    dir: PathBuf,
    path: String,
    /// Its expressions, with their values.
    values: Vec<(&'static str, String)>,
}

impl Workflow {
    /// Runs the steps of a job in an empty folder.
    fn job(&mut self, job: &Value, share: u64) {
        let (dir, temp) = (self.dir.join("workspace"), self.dir.join("temp"));
        for folder in [&dir, &temp] {
            let _ = fs::remove_dir_all(folder);
            fs::create_dir_all(folder).unwrap();
        }
        let _ = fs::remove_file(self.dir.join("path"));
        self.values = vec![
            ("${{ matrix.share }}", share.to_string()),
            ("${{ runner.temp }}", temp.display().to_string()),
        ];
        for step in job["steps"].as_array().unwrap() {
            let with = |name: &str| step["with"][name].as_str().map(|text| self.expanded(text));
            let artifacts = self.dir.join("artifacts");
            match step["uses"].as_str() {
                None => self.run(step["run"].as_str().unwrap(), &dir, &temp),
                Some("actions/checkout@v4") => copy(&self.dir.join("repository"), &dir),
                Some("actions/upload-artifact@v4") => {
                    let from = dir.join(with("path").unwrap());
                    if from.exists() || step["with"]["if-no-files-found"] != "ignore" {
                        copy(&from, &artifacts.join(with("name").unwrap()));
                    }
                }
                Some("actions/download-artifact@v4") => {
                    let to = dir.join(with("path").unwrap());
                    let prefix = with("pattern").map(|p| p.trim_end_matches('*').to_owned());
                    for entry in fs::read_dir(&artifacts).unwrap() {
                        let name = entry.unwrap().file_name().into_string().unwrap();
                        if with("name").is_some_and(|n| n == name)
                            || prefix.as_ref().is_some_and(|p| name.starts_with(p))
                        {
                            copy(&artifacts.join(name), &to);
                        }
                    }
                }
                other => panic!("{other:?}"),
            }
        }
    }

    fn expanded(&self, text: &str) -> String {
        let values = self.values.iter();
        let text = values.fold(text.to_owned(), |text, (name, value)| {
            text.replace(name, value)
        });
        assert!(!text.contains("${{"), "{text}");
        text
    }

    fn run(&self, text: &str, dir: &Path, temp: &Path) {
        let added = fs::read_to_string(self.dir.join("path")).unwrap_or_default();
        let path = added
            .lines()
            .fold(self.path.clone(), |path, line| format!("{line}:{path}"));
        let mut bash = Command::new("bash");
        bash.args(["-e", "-c", &self.expanded(text)])
            .current_dir(dir);
        bash.env("PATH", path).env("RUNNER_TEMP", temp);
        bash.env("GITHUB_PATH", self.dir.join("path"));
        ended(&bash.output().unwrap(), 0, &[text]);
    }
}

/// Copies a file, or the files of a folder, into a folder. None can be executed there: artifacts forget that.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    let files: Vec<PathBuf> = match from.is_dir() {
        true => fs::read_dir(from)
            .unwrap()
            .map(|e| e.unwrap().path())
            .collect(),
        false => vec![from.to_owned()],
    };
    for file in files {
        let copied = to.join(file.file_name().unwrap());
        fs::write(&copied, fs::read(&file).unwrap()).unwrap();
    }
}

#[test]
fn a_workflow_runs_a_list_and_merges_it() {
    let dir = listed("github");
    let text = script(
        &dir,
        &[
            "github", "--jobs", JOBS, "--out", "a \"b\"", "--shares", "3",
        ],
    );
    fs::write(dir.join("fleet.yml"), text).unwrap();
    let mut parse = python();
    parse.args([
        "-c",
        "import json, sys, yaml\nprint(json.dumps(yaml.safe_load(sys.stdin)['jobs']))",
    ]);
    parse.stdin(fs::File::open(dir.join("fleet.yml")).unwrap());
    let parsed = parse.output().unwrap();
    ended(&parsed, 0, &["yaml"]);
    let jobs: Value = serde_json::from_slice(&parsed.stdout).unwrap();
    // The repository has the list and the inputs. Nothing is compiled and nothing is installed here.
    for file in [JOBS, "a.toml", "a.wgsl", "b.toml", "b.wgsl"] {
        copy(&dir.join(file), &dir.join("repository"));
    }
    let built = "#!/bin/sh\n[ \"$*\" = 'install --locked --path cli --root built' ]\n";
    let built = format!(
        "{built}mkdir -p built/bin\ncp '{}' built/bin\n",
        env!("CARGO_BIN_EXE_preshade")
    );
    program(&dir, "cargo", &built);
    program(&dir, "sudo", "#!/bin/sh\n");
    let rest = std::env::var("PATH").unwrap();
    let path = format!("{}:{rest}", dir.join("bin").display());
    let mut workflow = Workflow {
        dir: dir.clone(),
        path,
        values: Vec::new(),
    };
    workflow.job(&jobs["build"], 0);
    let shares = jobs["evaluate"]["strategy"]["matrix"]["share"]
        .as_array()
        .unwrap();
    assert_eq!(shares.len(), 3);
    for share in shares {
        workflow.job(&jobs["evaluate"], share.as_u64().unwrap());
    }
    workflow.job(&jobs["merge"], 0);
    is_whole(&dir, "workspace/results");
    let merged = fs::read_to_string(dir.join("artifacts/merged/results.json")).unwrap();
    assert!(merged.contains("preshade.results.v1"), "{merged}");
}
