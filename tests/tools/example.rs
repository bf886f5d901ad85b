//! The example host of `tests/app`, copied out of the workspace and built against the packaged
//! crates: what it draws is the original's picture, and cargo runs its build script when it should
//! and at no other time.

use std::collections::BTreeMap;
use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::SystemTime;

/// The packages that the workspace names with a version: all but the command line.
fn crates(root: &Path) -> Vec<String> {
    let manifest = fs::read_to_string(root.join("Cargo.toml")).unwrap();
    let own = manifest.lines().filter(|line| line.contains(", path = \""));
    own.filter_map(|line| Some(line.split_once(" = ")?.0.to_owned()))
        .collect()
}

fn cargo() -> Command {
    let mut command = Command::new(env!("CARGO"));
    // What this test was built with is not for what it builds.
    for (name, _) in std::env::vars_os() {
        let name = name.to_string_lossy().into_owned();
        let of_cargo =
            name.starts_with("CARGO_") && name != "CARGO_HOME" && name != "CARGO_INCREMENTAL";
        if of_cargo || name == "RUSTFLAGS" || name == "LD_LIBRARY_PATH" {
            command.env_remove(name);
        }
    }
    command.env("NODEVICE_SELECT", "1");
    command
}

fn run(command: &mut Command) -> Output {
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{command:?}\n{said}");
    output
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let target = to.join(entry.file_name());
        match entry.path() {
            path if path.is_dir() => copy(&path, &target),
            path => {
                fs::copy(path, target).unwrap();
            }
        }
    }
}

/// The example in a folder of its own, beside the crates as they would be published.
struct Example {
    app: PathBuf,
    target: PathBuf,
}

impl Example {
    fn new() -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let temporary = Path::new(env!("CARGO_TARGET_TMPDIR"));
        // Always the same folder for the same checkout, so that what cargo built of it is found
        // again.
        let mut hasher = DefaultHasher::new();
        root.hash(&mut hasher);
        let away = std::env::temp_dir().join(format!("preshade-example-{:x}", hasher.finish()));
        let _ = fs::remove_dir_all(&away);
        let app = away.join("app");
        copy(&root.join("tests/app"), &app);
        let packages = temporary.join("packages");
        let mut package = cargo();
        package
            .current_dir(root)
            .args(["package", "--no-verify", "--allow-dirty", "--offline"]);
        package.arg("--target-dir").arg(&packages);
        let crates = crates(root);
        run(package.args(crates.iter().flat_map(|name| ["-p", name])));
        let version = env!("CARGO_PKG_VERSION");
        let mut patch = "\n[patch.crates-io]\n".to_owned();
        for name in crates {
            let file = packages.join(format!("package/{name}-{version}.crate"));
            // All files of a package are of one day in 2006, so that cargo, which compares times,
            // takes another package in the same place for the one it has built.
            let mut hasher = DefaultHasher::new();
            fs::read(&file).unwrap().hash(&mut hasher);
            let folder = format!("{:x}", hasher.finish());
            fs::create_dir_all(away.join(&folder)).unwrap();
            run(Command::new("tar")
                .arg("xzf")
                .arg(&file)
                .arg("-C")
                .arg(away.join(&folder)));
            patch.push_str(&format!(
                "{name} = {{ path = \"../{folder}/{name}-{version}\" }}\n"
            ));
        }
        let manifest = app.join("Cargo.toml");
        let text = fs::read_to_string(&manifest).unwrap();
        fs::write(&manifest, text + &patch).unwrap();
        let target = temporary.parent().unwrap().join("example");
        Self { app, target }
    }

    fn cargo(&self) -> Command {
        let mut command = cargo();
        command.current_dir(&self.app);
        command.env("CARGO_TARGET_DIR", &self.target);
        command
    }

    /// Builds it, and says what cargo found to have changed: lines of its fingerprint log.
    fn build(&self) -> Vec<String> {
        let log = "cargo::core::compiler::fingerprint=info";
        let output = run(self.cargo().args(["build", "-v"]).env("CARGO_LOG", log));
        let said = String::from_utf8(output.stderr).unwrap();
        let changed = |line: &&str| {
            line.contains("Dirty") || line.contains("dirty:") || line.contains("stale:")
        };
        said.lines().filter(changed).map(str::to_owned).collect()
    }

    /// Files that the build script wrote, with their times.
    fn written(&self) -> BTreeMap<PathBuf, SystemTime> {
        fn walk(folder: &Path, all: &mut BTreeMap<PathBuf, SystemTime>) {
            for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
                match entry.path() {
                    path if path.is_dir() => walk(&path, all),
                    path => {
                        all.insert(path, entry.metadata().unwrap().modified().unwrap());
                    }
                }
            }
        }
        let builds = fs::read_dir(self.target.join("debug/build")).unwrap();
        let mut all = BTreeMap::new();
        for build in builds.map(|b| b.unwrap().path()) {
            let name = build.file_name().unwrap().to_string_lossy().into_owned();
            let out = build.join("out");
            if name.starts_with("preshade-example-") && out.join("leaf.rs").is_file() {
                walk(&out, &mut all);
            }
        }
        all
    }

    fn append(&self, file: &str, text: &str) {
        // Cargo compares times: of a file that was written within the same second some file systems
        // tell no difference.
        std::thread::sleep(std::time::Duration::from_millis(1100));
        let path = self.app.join(file);
        let old = fs::read_to_string(&path).unwrap_or_default();
        fs::write(&path, old + text).unwrap();
    }
}

#[test]
fn the_example_draws_the_originals_picture_and_is_built_when_it_must_be() {
    let example = Example::new();
    run(example.cargo().args(["build", "-q"]));
    let output = run(Command::new(example.target.join("debug/preshade-example"))
        .arg("--headless")
        .env("NODEVICE_SELECT", "1"));
    let said = String::from_utf8(output.stdout).unwrap();
    let lines: Vec<&str> = said.lines().skip(2).collect();
    assert_eq!(lines.len(), 4, "{said}");
    let (variants, still) = lines.split_at(2);
    assert!(
        still[0].starts_with("time 0: specialize:") && still[0].ends_with(": true"),
        "{said}"
    );
    assert_eq!(
        still[1], "time 0.7: as its author wrote it, as the original: true",
        "a guard that does not hold"
    );
    for variant in variants {
        assert!(
            variant.contains(": 2 passes, 0 pixels changed, self-test "),
            "{said}"
        );
    }
    assert!(said.contains("self-test Held"), "{said}");

    let before = example.written();
    assert!(
        before
            .keys()
            .any(|f| f.ends_with("leaf/variant/leaf.prepass.wgsl"))
    );
    assert_eq!(example.build(), [""; 0], "nothing changed");
    example.append("shaders/notes.txt", "not a shader that is read\n");
    assert_eq!(example.build(), [""; 0], "a file that is not read");

    example.append("shaders/ground.wgsl", "// edited\n");
    let dirty = example.build();
    assert!(
        dirty.iter().any(|l| l.contains("shaders/ground.wgsl")),
        "{dirty:?}"
    );
    let after = example.written();
    let changed: Vec<&PathBuf> = after
        .iter()
        .filter(|(f, t)| before.get(*f) != Some(t))
        .map(|(f, _)| f)
        .collect();
    assert!(!changed.is_empty());
    for file in changed {
        let text = file.to_string_lossy();
        assert!(
            text.contains("/ground"),
            "{text} was written though leaf.wgsl alone decides it"
        );
    }
}
