//! Writes the corpora's first inputs, of the fixtures: `cargo run --bin seeds`, in `fuzz/`.

use std::path::{Path, PathBuf};

use preshade_fuzz::support::root;

fn main() -> std::io::Result<()> {
    let fixtures = root().join("fixtures");
    let with = |folder: &str, ending: &str| -> std::io::Result<Vec<PathBuf>> {
        let mut found = Vec::new();
        for entry in std::fs::read_dir(fixtures.join(folder))? {
            let path = entry?.path();
            if path.extension().is_some_and(|e| e == ending) {
                found.push(path);
            }
        }
        found.sort();
        Ok(found)
    };
    for path in with("shaders", "wgsl")? {
        keep("wgsl", &path, &std::fs::read(&path)?)?;
    }
    for folder in ["glsl", "glsl/dialects"] {
        for path in with(folder, "vert")? {
            let fragment = std::fs::read(path.with_extension("frag")).unwrap_or_default();
            let both = [std::fs::read(&path)?, vec![0], fragment].concat();
            keep("glsl", &path, &both)?;
        }
    }
    for path in with("scenes", "toml")? {
        keep("scene", &path, &std::fs::read(&path)?)?;
    }
    #[cfg(feature = "verify")]
    keep("plan", Path::new("packed"), &preshade_fuzz::support::scenes::plan_seed())?;
    // Choices, by a counter and a hash of it.
    for n in 0..64_u64 {
        let bytes = (0..6).flat_map(|i| {
            let mixed = (n * 8 + i).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            mixed.rotate_left(17).to_le_bytes()
        });
        let bytes: Vec<u8> = bytes.collect();
        for target in ["recipes", "ir", "module"] {
            keep(target, Path::new(&format!("choice-{n}")), &bytes)?;
        }
    }
    Ok(())
}

fn keep(target: &str, like: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let folder = root().join("fuzz/corpus").join(target);
    std::fs::create_dir_all(&folder)?;
    let name = like.file_stem().unwrap_or_default();
    std::fs::write(folder.join(name), bytes)
}
