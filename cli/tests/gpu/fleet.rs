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
    let (dir, _) = listed("changed");
    let folder = &dir;
    let all = ["evaluate", "--jobs", "jobs.jsonl", "--out", "out"];
    accepted(folder, &[&all[..], &["--partition", "hash:1/4"]].concat());
    accepted(folder, &["merge", "out"]);
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
