//! The fixture materials and the recipes that every one of them goes through.
#![allow(dead_code)]

use std::path::{Path, PathBuf};

use preshade_compiler::front::{self, Parsed, Source};
use preshade_dataflow::graph::counted::Ends;
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_geometry::examples;
use preshade_plan::pass::Use;
use preshade_plan::plan::Plan;
use preshade_plan::state::MaterialState;
use shader_text::options::Options;

/// The recipes of the passes' examples with one of these uses.
pub fn recipes(of: &[Use]) -> Vec<&'static str> {
    let used = examples().filter(|(_, used)| of.contains(used));
    used.map(|(recipe, _)| recipe).collect()
}

/// A material of one file or two, with the default state.
pub fn original(files: &[&Path]) -> Plan {
    let sources: Vec<Source> = files
        .iter()
        .map(|path| {
            let name = path.file_name().unwrap().to_string_lossy();
            Source::from_bytes(name, std::fs::read(path).unwrap()).unwrap()
        })
        .collect();
    let parsed = front::parse(&sources, &Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
    let material = files[0].file_stem().unwrap().to_string_lossy().into_owned();
    Plan::original(
        &material,
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    )
}

/// The root of the checkout, also where this was built elsewhere: then it is the folder it runs in.
pub fn root() -> PathBuf {
    let built = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    match built.join("fixtures").is_dir() {
        true => built,
        false => PathBuf::from("."),
    }
}

/// Every material of `fixtures`: WGSL files, and GLSL pairs.
pub fn materials() -> Vec<Vec<PathBuf>> {
    let with_extension = |folder: &str, extension: &str| {
        let mut found: Vec<PathBuf> = std::fs::read_dir(root().join(folder))
            .unwrap()
            .map(|e| e.unwrap().path())
            .filter(|p| p.extension().is_some_and(|e| e == extension))
            .collect();
        found.sort();
        found
    };
    let wgsl = with_extension("fixtures/shaders", "wgsl")
        .into_iter()
        .map(|p| vec![p]);
    let glsl = with_extension("fixtures/glsl", "vert")
        .into_iter()
        .map(|p| {
            let frag = p.with_extension("frag");
            vec![p, frag]
        });
    wgsl.chain(glsl).collect()
}

/// Every WGSL file of the fixtures that are drawn with made-up inputs.
pub fn wgsl_files() -> Vec<PathBuf> {
    let folders = ["shaders", "cases", "adversarial"].map(|f| root().join("fixtures").join(f));
    let files = folders.iter().filter_map(|f| std::fs::read_dir(f).ok());
    let mut files: Vec<PathBuf> = files.flatten().map(|e| e.unwrap().path()).collect();
    files.retain(|p| p.extension().is_some_and(|e| e == "wgsl"));
    files.sort();
    files
}

/// A WGSL file of one material. An error is why it is not drawn: the front end refuses it, or a
/// driver might not come back from it.
pub fn drawable(path: &Path) -> Result<Parsed, String> {
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let source = Source::new(name, std::fs::read_to_string(path).unwrap());
    let parsed = front::parse(&[source], &Options::default())
        .map_err(|e| format!("refused: {:?}", e.code()))?;
    let graph = Graph::build(&parsed.program);
    let entries = 0..parsed.program.module().entry_points.len();
    let ends = entries.map(|i| graph.ends(FunctionId::EntryPoint(i)));
    match ends.into_iter().any(|ends| ends == Ends::Unknown) {
        true => Err("a loop that may not end".to_owned()),
        false => Ok(parsed),
    }
}
