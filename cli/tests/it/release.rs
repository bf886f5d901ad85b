//! What `scripts/release.sh` refuses, in a repository with our manifests and a Makefile of its own.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::agree::{git, nowhere};
use crate::hostile_support::stderr;

const VERSION: &str = env!("CARGO_PKG_VERSION");

struct Repository(PathBuf);

impl Repository {
    /// A repository that nothing keeps from a release but its tests, which fail.
    fn new(name: &str) -> Self {
        let folder = nowhere(name);
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        for file in [
            "scripts/release.sh",
            "Cargo.toml",
            "hosts/bevy/Cargo.toml",
            "hosts/web/package.json",
            "hosts/three/package.json",
        ] {
            let to = folder.join(file);
            fs::create_dir_all(to.parent().unwrap()).unwrap();
            fs::copy(root.join(file), to).unwrap();
        }
        let new = Self(folder);
        new.write("Makefile", "test:\n\tfalse\nhosts audit:\n");
        new.write(
            "CHANGELOG.md",
            &format!("# Changes\n\n## {VERSION} - today\n\n- News.\n\n## 0.0.1\n"),
        );
        new.git(&["init", "-q", "-b", "main"]);
        new.commit();
        new
    }

    fn write(&self, file: &str, text: &str) {
        fs::write(self.0.join(file), text).unwrap();
    }

    fn replace(&self, file: &str, from: &str, to: &str) {
        let text = fs::read_to_string(self.0.join(file)).unwrap();
        assert!(text.contains(from), "{file}: {from}");
        self.write(file, &text.replace(from, to));
        self.commit();
    }

    fn git(&self, args: &[&str]) {
        git(&self.0, args);
    }

    fn commit(&self) {
        self.git(&["add", "."]);
        self.git(&["commit", "-q", "-m", "a"]);
    }

    /// The last words of the script, which refuses.
    fn refusal(&self, arguments: &[&str]) -> String {
        let mut bash = Command::new("bash");
        bash.arg("scripts/release.sh").args(arguments);
        // A `make` that runs these tests hands its flags on.
        bash.env_remove("MAKEFLAGS").env_remove("MAKELEVEL");
        let run = bash.current_dir(&self.0).output().unwrap();
        assert_eq!(run.status.code(), Some(1), "{}", stderr(&run));
        assert!(!self.0.join("dist").exists());
        stderr(&run).split_once("release: ").unwrap().1.to_owned()
    }
}

#[test]
fn a_release_needs_a_clean_main_and_a_new_version() {
    let of = Repository::new("release-clean");
    assert_eq!(of.refusal(&[]), "name the version, such as 1.2.3\n");
    assert!(of.refusal(&["v1"]).starts_with("name the version"));
    of.write("new.txt", "");
    let said = of.refusal(&[VERSION]);
    assert_eq!(said, "commit these changes first:\n?? new.txt\n");
    of.commit();
    of.git(&["checkout", "-q", "-b", "other"]);
    assert_eq!(
        of.refusal(&[VERSION]),
        "this is the branch other, not main\n"
    );
    of.git(&["checkout", "-q", "main"]);
    of.git(&["tag", &format!("v{VERSION}")]);
    assert_eq!(
        of.refusal(&[VERSION]),
        format!("the tag v{VERSION} exists\n")
    );
}

#[test]
fn a_release_needs_its_changes_told_and_one_version_everywhere() {
    let of = Repository::new("release-changes");
    let silent = format!("CHANGELOG.md says nothing under '## {VERSION}'\n");
    of.replace("CHANGELOG.md", "- News.", "");
    assert_eq!(of.refusal(&[VERSION]), silent);
    // The beginning of another version is not this one.
    of.replace("CHANGELOG.md", " - today\n", "0\n- News.\n");
    assert_eq!(of.refusal(&[VERSION]), silent);
    of.replace("CHANGELOG.md", "# Changes", "## 9.9.9\n\n- News.");
    let said = of.refusal(&["9.9.9"]);
    let (head, places) = said.split_once('\n').unwrap();
    assert_eq!(head, "these are not 9.9.9:");
    assert_eq!(places.lines().count(), 7, "{said}");
    assert!(
        places.lines().all(|place| place.ends_with(VERSION)),
        "{said}"
    );
}

#[test]
fn a_release_needs_green_tests_that_change_nothing() {
    let of = Repository::new("release-tests");
    assert_eq!(of.refusal(&[VERSION]), "a test failed\n");
    of.replace(
        "Makefile",
        "false\nhosts audit:\n",
        "true\nhosts audit:\n\tfalse\n",
    );
    assert_eq!(of.refusal(&[VERSION]), "a test failed\n");
    of.replace("Makefile", "false", "touch left");
    assert_eq!(
        of.refusal(&[VERSION]),
        "the tests changed these files:\n?? left\n"
    );
}
