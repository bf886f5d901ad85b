//! `jobs`, `evaluate` and `merge`: the same results from one run as from several that were disturbed.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use crate::hostile_support::{accepted, ended, preshade, run, stderr};

const SCENE: &str = r#"
[materials.stone]
shader = "shaders/textured.wgsl"
textures.albedo = { pattern = "bricks", srgb = true }
[meshes]
block.box = { size = [1, 2, 1] }
[[draws]]
mesh = "block"
material = "stone"
[[cameras]]
eye = [3, 2, 4]
target = [0, 0, 0]
"#;

/// A folder with two shaders, a scene, and a list of their jobs.
fn listed(name: &str) -> (PathBuf, usize) {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&dir);
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/shaders");
    fs::create_dir_all(dir.join("shaders")).unwrap();
    for name in ["foliage.wgsl", "textured.wgsl"] {
        fs::copy(fixtures.join(name), dir.join("shaders").join(name)).unwrap();
    }
    fs::write(dir.join("scene.toml"), SCENE).unwrap();
    let variants = ["depth-prepass", "early-discard"];
    let mut args = vec![
        "jobs",
        "shaders",
        "scene.toml",
        "--size",
        "32x24",
        "--frames",
        "1",
    ];
    variants.iter().for_each(|v| args.extend(["--variant", v]));
    let output = run(&dir, &args);
    let lines = String::from_utf8(output.stdout.clone()).unwrap();
    ended(&output, 0, &args);
    let here = dir.to_string_lossy().into_owned();
    assert!(
        lines.contains("shaders/foliage.wgsl") && !lines.contains(&here),
        "{lines}"
    );
    fs::write(dir.join("jobs.jsonl"), &lines).unwrap();
    (dir, lines.lines().count())
}

/// Each result of a folder, with the time of its last change.
fn results(folder: &Path) -> BTreeMap<PathBuf, SystemTime> {
    let Ok(entries) = fs::read_dir(folder) else {
        return BTreeMap::new();
    };
    let files = entries.map(|e| e.unwrap().path());
    let whole = files.filter(|f| f.to_string_lossy().ends_with(".outcome.json"));
    whole
        .map(|f| (f.clone(), fs::metadata(&f).unwrap().modified().unwrap()))
        .collect()
}

#[test]
fn disturbed_runs_merge_to_the_bytes_of_an_undisturbed_one() {
    let (dir, count) = listed("disturbed");
    let folder = &dir;
    assert!(count >= 4, "{count}");
    let all = ["evaluate", "--jobs", "jobs.jsonl", "--workers", "2"];
    accepted(folder, &[&all[..], &["--out", "whole"]].concat());
    assert_eq!(results(&folder.join("whole")).len(), count);
    accepted(folder, &["merge", "whole", "-o", "whole.json"]);

    // The first half is killed as soon as it has a result; a second later none of its processes writes.
    let first = [&all[..3], &["--partition", "hash:1/2", "--out", "first"]].concat();
    let mut child = preshade(folder).args(&first).spawn().unwrap();
    while results(&folder.join("first")).is_empty() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let before = results(&folder.join("first"));
    assert!(before.len() < count, "it was killed at the end");
    // In the second half each job takes too long, and is tried again by the next run.
    let second = [&all[..3], &["--partition", "hash:2/2", "--out", "second"]].concat();
    let output = run(folder, &[&second[..], &["--seconds", "0"]].concat());
    let said = ended(&output, 0, &second);
    assert!(said.contains("it was stopped after 0 s"), "{said}");
    assert!(said.contains(" 0 measured"), "{said}");
    accepted(folder, &first);
    accepted(folder, &[&second[..], &["--attempts", "3"]].concat());
    let after = results(&folder.join("first"));
    for (file, time) in &before {
        assert_eq!(after.get(file), Some(time), "{} ran twice", file.display());
    }
    assert_eq!(after.len() + results(&folder.join("second")).len(), count);
    accepted(
        folder,
        &["merge", "second", "first", "second", "-o", "parts.json"],
    );
    let read = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
    assert_eq!(read("whole.json"), read("parts.json"));

    // Nothing is left to do.
    let output = run(folder, &[&all[..], &["--out", "whole"]].concat());
    let said = stderr(&output);
    assert!(
        said.contains(&format!("{count} results there already")),
        "{said}"
    );
    assert!(said.contains("0 jobs: 0 measured"), "{said}");
    let output = run(folder, &["merge", "whole"]);
    let table = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        table.contains("  depth-prepass: holds on 1 of 1"),
        "{table}"
    );
}

#[test]
fn jobs_are_of_what_verify_is_given_here_and_run_without_it_elsewhere() {
    let (dir, _) = listed("settings");
    let folder = dir.join("elsewhere");
    fs::create_dir(&folder).unwrap();
    // A file with the name of a value.
    fs::copy(dir.join("shaders/textured.wgsl"), dir.join("lit.wgsl")).unwrap();
    let settings = "size = \"32x24\"\nadapter = \"none\"\n[verify]\nframes = 1\nout = \"report\"\n";
    fs::write(dir.join("preshade.toml"), settings).unwrap();
    let args = [
        "jobs",
        "--name",
        "lit.wgsl",
        "--variant=depth-prepass",
        "--",
        "lit.wgsl",
    ];
    let listed = preshade(&dir)
        .args(args)
        .env("PRESHADE_ADAPTER", "none")
        .output()
        .unwrap();
    ended(&listed, 0, &args);
    let line = String::from_utf8(listed.stdout).unwrap();
    let job: serde_json::Value = serde_json::from_str(line.trim()).unwrap();
    let words = ["--size=32x24", "--frames=1", "--name=lit.wgsl"];
    let has = job["arguments"].as_array().unwrap();
    assert_eq!(has.len(), words.len(), "{line}");
    assert!(words.iter().all(|w| has.iter().any(|h| h == w)), "{line}");
    fs::copy(dir.join("lit.wgsl"), folder.join("lit.wgsl")).unwrap();
    fs::write(folder.join("jobs.jsonl"), line).unwrap();
    fs::write(folder.join("preshade.toml"), "size = \"8x8\"\nframes = 3\n").unwrap();
    accepted(
        &folder,
        &["evaluate", "--jobs", "jobs.jsonl", "--out", "out"],
    );
    let file = results(&folder.join("out")).into_keys().next().unwrap();
    let result: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap();
    let report = &result["result"]["report"];
    assert_eq!(
        report["resolution"],
        serde_json::json!([32, 24]),
        "{result}"
    );
}

#[test]
fn jobs_of_changed_files_and_two_pictures_of_one_job_are_errors() {
    let (dir, all_jobs) = listed("changed");
    let folder = &dir;
    let all = ["evaluate", "--jobs", "jobs.jsonl", "--out", "out"];
    accepted(folder, &[&all[..], &["--partition", "hash:1/4"]].concat());
    let part = results(&folder.join("out")).len();
    let merge = ["merge", "out", "--jobs", "jobs.jsonl"];
    let told = ended(&run(folder, &merge), 0, &merge);
    let told_of = format!("{part} of {all_jobs} jobs have results\n");
    assert!(told.contains(&told_of), "{told}");
    // Another picture of one job.
    let file = results(&folder.join("out")).into_keys().next().unwrap();
    let text = fs::read_to_string(&file).unwrap();
    let other = text.replace("\"changed_pixels\": 0", "\"changed_pixels\": 3");
    assert_ne!(text, other);
    fs::create_dir(folder.join("other")).unwrap();
    fs::write(folder.join("other").join(file.file_name().unwrap()), other).unwrap();
    for order in [["out", "other"], ["other", "out"]] {
        let output = run(folder, &["merge", order[0], order[1]]);
        let said = ended(&output, 2, &order);
        assert!(said.contains(" differ:\n"), "{said}");
        assert!(said.contains("3 pixels"), "{said}");
    }
    // A file that is not the one of the list.
    fs::write(folder.join("shaders/foliage.wgsl"), "// nothing\n").unwrap();
    let again = [&all[..4], &["changed", "--partition", "hash:1/1"]].concat();
    let said = ended(&run(folder, &again), 2, &again);
    assert!(said.contains("foliage.wgsl: it was changed"), "{said}");
    // A line that was cut off.
    fs::write(folder.join("jobs.jsonl"), "{\"schema\":\"preshade.jo").unwrap();
    let said = ended(&run(folder, &all), 2, &all);
    assert!(said.contains("jobs.jsonl: line 1: "), "{said}");
}

/// Copies results as if another adapter had measured them: each variant with a speedup of its own.
fn remade(folder: &Path, name: &str, speedups: [(&str, f64); 2]) {
    let to = folder.join(name);
    fs::create_dir(&to).unwrap();
    for file in results(&folder.join("real")).keys() {
        let mut outcome: serde_json::Value =
            serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap();
        let (_, speedup) = speedups
            .iter()
            .find(|(variant, _)| outcome["job"]["variant"] == *variant)
            .unwrap();
        outcome["adapter"]["name"] = name.into();
        let report = &mut outcome["result"]["report"];
        report["adapter"]["name"] = name.into();
        if outcome["job"]["kind"] == "time" {
            outcome["run"]["card"] = name.into();
            let report = &mut outcome["result"]["report"];
            report["variants"][1]["speedup"] = serde_json::json!({
                "median": speedup, "low": speedup - 0.05, "high": speedup + 0.05,
            });
        }
        fs::write(to.join(file.file_name().unwrap()), outcome.to_string()).unwrap();
    }
}

fn stdout(folder: &Path, args: &[&str]) -> String {
    let output = run(folder, args);
    ended(&output, 0, args);
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn plan_and_explore_decide_over_the_adapters_of_merged_results() {
    let (dir, _) = listed("decided");
    let folder = &dir;
    let read = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
    // Before any job ran, a fleet already says what it has.
    fs::write(folder.join("none.jsonl"), "").unwrap();
    accepted(
        folder,
        &["evaluate", "--jobs", "none.jsonl", "--out", "idle"],
    );
    let table = stdout(folder, &["merge", "idle", "--adapters"]);
    assert!(table.starts_with("adapter"), "{table}");
    assert!(table.lines().count() > 1, "{table}");

    let jobs = [
        "jobs",
        "scene.toml",
        "--size",
        "32x24",
        "--frames",
        "1",
        "--time",
        "headline",
        "--seconds",
        "0.05",
        "--variant",
        "depth-prepass",
        "--variant",
        "early-discard",
    ];
    fs::write(folder.join("jobs.jsonl"), stdout(folder, &jobs)).unwrap();
    accepted(
        folder,
        &["evaluate", "--jobs", "jobs.jsonl", "--out", "real"],
    );
    remade(
        folder,
        "Fast",
        [("depth-prepass", 2.0), ("early-discard", 1.0)],
    );
    remade(
        folder,
        "Even",
        [("depth-prepass", 1.5), ("early-discard", 1.0)],
    );
    remade(
        folder,
        "Slow",
        [("depth-prepass", 0.8), ("early-discard", 1.2)],
    );
    let merge = ["merge", "Fast", "Even", "Slow", "-o", "results.json"];
    accepted(folder, &[&merge[..], &["--html", "report"]].concat());
    let page = read("report/index.html");
    for text in [
        "Fast",
        "Slow",
        "holds on 3 of 3, pays on 2 of 3",
        "0.80x [0.75, 0.85]",
    ] {
        assert!(page.contains(text), "{text}: {page}");
    }
    // What machines have is no result.
    fs::rename(folder.join("idle"), folder.join("Slow/idle")).unwrap();
    let machine = fs::read_dir(folder.join("Slow/idle"))
        .unwrap()
        .next()
        .unwrap()
        .unwrap()
        .path();
    fs::rename(
        &machine,
        folder.join("Slow").join(machine.file_name().unwrap()),
    )
    .unwrap();
    let before = read("results.json");
    accepted(folder, &merge);
    assert_eq!(before, read("results.json"));
    let table = stdout(folder, &["merge", "Slow", "--adapters", "--format", "csv"]);
    assert!(
        table
            .lines()
            .any(|l| l.starts_with("\"Slow\"") && l.ends_with("\"2\",\"2\",\"0\"")),
        "{table}"
    );

    let plan = ["plan", "./scene.toml", "--results", "results.json"];
    let told = stdout(folder, &[&plan[..], &["--out", "chosen"]].concat());
    for line in [
        "  draw with depth-prepass: pays on 2 of 3, 1.34x on average",
        "  does not pay on Slow: 0.80x [0.75, 0.85], slower",
        "    early-discard: Slow 1.20x",
    ] {
        assert!(told.lines().any(|l| l == line), "{line}: {told}");
    }
    let decision: serde_json::Value = serde_json::from_str(&read("chosen/decision.json")).unwrap();
    assert_eq!(decision["schema"], "preshade.fleet-decision.v1");
    assert!(folder.join("chosen/stone.plan.json").exists());
    let explore = [
        "explore",
        "scene.toml",
        "--results",
        "results.json",
        "--format",
        "csv",
    ];
    let told = stdout(folder, &explore);
    assert!(
        told.contains("\"original\",flip_mean,0,1,1,1,3,\"beaten by depth-prepass\""),
        "{told}"
    );

    let refused = |args: &[&str]| ended(&run(folder, args), 2, args);
    let said = refused(&[&plan[..], &["--seconds", "1"]].concat());
    assert!(said.contains("--seconds"), "{said}");
    let said = refused(&["plan", "shaders/foliage.wgsl", "--results", "results.json"]);
    assert!(
        said.contains("there is no input `shaders/foliage.wgsl`"),
        "{said}"
    );
    let pictures = results(&folder.join("Fast")).into_keys();
    let pictures = pictures.map(|f| f.to_string_lossy().into_owned());
    // The names of times end in the run's.
    let pictures: Vec<String> = pictures.filter(|f| f.matches('.').count() == 3).collect();
    let mut merge = vec!["merge", "-o", "pictures.json"];
    merge.extend(pictures.iter().map(String::as_str));
    accepted(folder, &merge);
    let said = refused(&["plan", "scene.toml", "--results", "pictures.json"]);
    assert!(
        said.contains("no job has a time\nhelp: `preshade jobs scene.toml"),
        "{said}"
    );
    fs::write(folder.join("shaders/textured.wgsl"), "// nothing\n").unwrap();
    let said = refused(&plan);
    assert!(
        said.contains("shaders/textured.wgsl was changed; measure it again"),
        "{said}"
    );
}
