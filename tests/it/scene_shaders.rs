//! Every fixture shader goes through the front end.

use std::path::{Path, PathBuf};

use preshade_compiler::front::{self, Source};
use shader_text::error::Color;
use shader_text::options::Options;

fn files(folder: &str, suffix: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(folder);
    let mut found: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.to_string_lossy().ends_with(suffix))
        .collect();
    found.sort();
    found
}

fn parse(paths: &[PathBuf]) {
    let sources: Vec<Source> = paths
        .iter()
        .map(|p| {
            Source::new(
                p.file_name().unwrap().to_string_lossy(),
                std::fs::read_to_string(p).unwrap(),
            )
        })
        .collect();
    let parsed = front::parse(&sources, &Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(Color::Never)));
    assert!(parsed.fragment.is_some());
}

#[test]
fn fixture_shaders_are_valid() {
    let single = files("shaders", ".wgsl");
    assert!(single.len() >= 18, "{}", single.len());
    for path in single {
        parse(&[path]);
    }
    let pairs = [("shaders/two-files", ".vert.wgsl"), ("glsl", ".vert")];
    for (folder, suffix) in pairs {
        for vertex in files(folder, suffix) {
            let fragment = vertex.to_string_lossy().replace(".vert", ".frag");
            parse(&[vertex, PathBuf::from(fragment)]);
        }
    }
}
