//! Files of an earlier run that the new plan does not name any more.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::{fs, io};

use serde_json::Value;

use super::File;

const PLAN: &str = ".plan.json";

/// Finds what the plans in `dir` that `files` will replace name, and `files` lacks. Only a material's
/// own files are found, and none that another plan in the folder names.
pub fn stale(dir: &Path, files: &[File]) -> Vec<PathBuf> {
    let mut named = BTreeSet::new();
    for material in files.iter().filter_map(|f| f.name.strip_suffix(PLAN)) {
        let own = format!("{material}.");
        let before = names(&dir.join(format!("{material}{PLAN}")));
        named.extend(before.into_iter().filter(|name| name.starts_with(&own)));
    }
    let new: BTreeSet<&str> = files.iter().map(|f| f.name.as_str()).collect();
    named.retain(|name| !new.contains(name.as_str()) && dir.join(name).is_file());
    if !named.is_empty() {
        let entries = fs::read_dir(dir).into_iter().flatten().flatten();
        for entry in entries {
            let name = entry.file_name().to_string_lossy().into_owned();
            if name.ends_with(PLAN) && !new.contains(name.as_str()) {
                names(&entry.path()).iter().for_each(|n| {
                    named.remove(n);
                });
            }
        }
    }
    named.iter().map(|name| dir.join(name)).collect()
}

/// Removes a file; one that is gone is no error.
///
/// # Errors
/// The file system's error with the path.
pub fn remove(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => {
            Err(io::Error::new(e.kind(), format!("{}: {e}", path.display())))
        }
        _ => Ok(()),
    }
}

/// The texts of a `plan.json` that may be names of files beside it. Empty if it cannot be read.
fn names(plan: &Path) -> BTreeSet<String> {
    fn collect(value: Value, out: &mut BTreeSet<String>) {
        match value {
            Value::String(text) if !text.contains(['/', '\\', '\n']) => drop(out.insert(text)),
            Value::Array(all) => all.into_iter().for_each(|v| collect(v, out)),
            Value::Object(all) => all.into_iter().for_each(|(_, v)| collect(v, out)),
            _ => {}
        }
    }
    let mut out = BTreeSet::new();
    let text = fs::read(plan).unwrap_or_default();
    collect(serde_json::from_slice(&text).unwrap_or_default(), &mut out);
    out
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn only_a_materials_own_files_are_stale() {
        let dir = std::env::temp_dir().join(format!("preshade-stale-{}", std::process::id()));
        fs::create_dir_all(&dir).unwrap();
        let plan = |files: &[&str]| serde_json::json!({"files": [{"vertex": files}]}).to_string();
        let old = [
            "lit.main.wgsl",
            "lit.prepass.wgsl",
            "lit.b.main.wgsl",
            "../lit.x",
            "notes.txt",
        ];
        for (name, text) in [
            ("lit.plan.json", plan(&old)),
            ("lit.b.plan.json", plan(&["lit.b.main.wgsl"])),
            ("lit.main.wgsl", String::new()),
            ("lit.prepass.wgsl", String::new()),
            ("lit.b.main.wgsl", String::new()),
            ("lit.own.wgsl", String::new()),
            ("notes.txt", String::new()),
        ] {
            fs::write(dir.join(name), text).unwrap();
        }
        let file = |name: &str| File {
            name: name.to_owned(),
            bytes: Vec::new(),
        };
        let found = stale(&dir, &[file("lit.plan.json"), file("lit.main.wgsl")]);
        assert_eq!(found, [dir.join("lit.prepass.wgsl")]);
        remove(&found[0]).unwrap();
        remove(&found[0]).unwrap();
        fs::remove_dir_all(&dir).unwrap();
    }
}
