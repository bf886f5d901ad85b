//! Copies Bevy's examples whose materials have shaders of their own, each as a module.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-env-changed=BEVY");
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default());
    let Some(bevy) = env::var_os("BEVY").map(PathBuf::from) else {
        return Err(io::Error::other("BEVY must name a checkout of Bevy 0.19.1"));
    };
    let from = bevy.join("examples");
    println!("cargo::rerun-if-changed={}", from.display());
    let is_material = regex::Regex::new(r"impl(<.*>)? (Material|MaterialExtension) for")
        .map_err(io::Error::other)?;
    let mut found = Vec::new();
    copied(&from, &out.join("examples"), &mut |path, text| {
        if is_material.is_match(text) && text.contains("shaders/") {
            found.push(path.to_owned());
        }
    })?;
    found.sort();
    let mut modules = String::new();
    let mut table = String::from("pub const EXAMPLES: &[(&str, fn())] = &[\n");
    for path in found {
        let name = path
            .file_stem()
            .and_then(|s| s.to_str())
            .unwrap_or_default();
        let _ = writeln!(modules, "#[path = {path:?}]\nmod {name};");
        let _ = writeln!(table, "    ({name:?}, {name}::run_main),");
    }
    fs::write(out.join("examples.rs"), modules + &table + "];\n")
}

/// Copies a folder's Rust sources. Names of the copies are those of modules, and not of a crate.
fn copied(from: &Path, to: &Path, found: &mut dyn FnMut(&Path, &str)) -> io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let path = entry?.path();
        let to = to.join(path.file_name().unwrap_or_default());
        if path.is_dir() {
            copied(&path, &to, found)?;
        } else if path.extension().is_some_and(|e| e == "rs") {
            let text = fs::read_to_string(&path)?;
            found(&to, &text);
            let text = text.replace("use crate::", "use self::");
            let run = match text.contains("\nfn main()") {
                true => "\n#[allow(dead_code)]\npub fn run_main() {\n    let _ = main();\n}\n",
                false => "",
            };
            fs::write(&to, text + run)?;
        }
    }
    Ok(())
}
