//! npm projects that drive headless Chromium.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;

/// A folder of `tests`, with its packages installed.
pub struct Project(PathBuf);

impl Project {
    /// Installs the packages of the lock file if it is newer than they are. One test at a time
    /// does it.
    pub fn installed(name: &str) -> Self {
        static ONE: Mutex<()> = Mutex::new(());
        let _one = ONE.lock();
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let project = Self(root.join("tests").join(name));
        let modified = |path: &str| fs::metadata(project.path(path)).and_then(|m| m.modified());
        let locked = modified("package-lock.json").unwrap();
        if modified("node_modules/.package-lock.json").map_or(true, |there| there < locked) {
            project.run("npm", &["ci", "--no-audit", "--no-fund", "--silent"]);
        }
        project
    }

    /// A path in it.
    pub fn path(&self, path: &str) -> PathBuf {
        self.0.join(path)
    }

    /// As [`run`], in the project's folder.
    pub fn run(&self, program: impl AsRef<Path>, arguments: &[&str]) -> String {
        run(program, arguments, &self.0)
    }
}

/// Runs a program in `folder`. Returns what it printed.
pub fn run(program: impl AsRef<Path>, arguments: &[&str], folder: &Path) -> String {
    let program = program.as_ref();
    let mut command = Command::new(program);
    let output = command.args(arguments).current_dir(folder).output();
    let output =
        output.unwrap_or_else(|e| panic!("{}: {e} (scripts/setup.sh three)", program.display()));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let complained = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}\n{said}\n{complained}");
    said
}
