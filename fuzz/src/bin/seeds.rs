//! Writes the corpora's first inputs, and the dictionaries of words, of the fixtures:
//! `cargo run --bin seeds`, in `fuzz/`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use preshade_fuzz::support::root;

/// Name and bytes of an input.
type Seed = (String, Vec<u8>);

fn main() -> std::io::Result<()> {
    let (mut wgsl, mut glsl, mut scenes) = (Vec::new(), Vec::new(), Vec::new());
    for path in with("shaders", "wgsl")? {
        wgsl.push((name(&path), std::fs::read(&path)?));
    }
    for folder in ["glsl", "glsl/dialects"] {
        for path in with(folder, "vert")? {
            let fragment = std::fs::read(path.with_extension("frag")).unwrap_or_default();
            let both = [std::fs::read(&path)?, vec![0], fragment].concat();
            glsl.push((name(&path), both));
        }
    }
    for path in with("scenes", "toml")? {
        scenes.push((name(&path), std::fs::read(&path)?));
    }
    let texts = [("wgsl", wgsl), ("glsl", glsl), ("scene", scenes)];
    #[cfg(feature = "verify")]
    let texts = {
        let plan = preshade_fuzz::support::scenes::plan_seed();
        texts
            .into_iter()
            .chain([("plan", vec![("packed".to_owned(), plan)])])
    };
    for (target, seeds) in texts {
        write(
            "dictionaries",
            &format!("{target}.dict"),
            dictionary(&seeds).as_bytes(),
        )?;
        keep(target, &seeds)?;
    }
    ["recipes", "ir", "module"]
        .into_iter()
        .try_for_each(|target| keep(target, &choices()))
}

/// The files of a folder of the fixtures that have an ending.
fn with(folder: &str, ending: &str) -> std::io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(root().join("fixtures").join(folder))? {
        let path = entry?.path();
        if path.extension().is_some_and(|e| e == ending) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

fn name(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

/// Choices, by a counter and a hash of it.
fn choices() -> Vec<Seed> {
    let bytes = |n: u64| {
        (0..6_u64).flat_map(move |i| {
            let mixed = (n * 8 + i).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            mixed.rotate_left(17).to_le_bytes()
        })
    };
    (0..64)
        .map(|n| (format!("choice-{n}"), bytes(n).collect()))
        .collect()
}

/// A dictionary for libFuzzer: the words of texts, and marks that are more than a character.
fn dictionary(texts: &[Seed]) -> String {
    let marks = [
        "->", "<<", ">>", "&&", "||", "==", "<=", "//", "/*", "*/", "##",
    ];
    let mut all: BTreeSet<String> = marks.map(str::to_owned).into();
    for (_, text) in texts {
        let text = String::from_utf8_lossy(text);
        let words = text.split(|c: char| !(c.is_ascii_alphanumeric() || "_.$#@".contains(c)));
        let words = words.filter(|w| (2..=24).contains(&w.len()));
        all.extend(words.map(str::to_owned));
    }
    all.iter().map(|word| format!("\"{word}\"\n")).collect()
}

fn keep(target: &str, seeds: &[Seed]) -> std::io::Result<()> {
    seeds
        .iter()
        .try_for_each(|(name, bytes)| write(&format!("corpus/{target}"), name, bytes))
}

fn write(folder: &str, name: &str, bytes: &[u8]) -> std::io::Result<()> {
    let folder = root().join("fuzz").join(folder);
    std::fs::create_dir_all(&folder)?;
    std::fs::write(folder.join(name), bytes)
}
