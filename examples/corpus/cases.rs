//! The materials of a folder.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// One material's files.
#[derive(Clone, Debug)]
pub struct Case {
    pub name: String,
    pub paths: Vec<PathBuf>,
}

/// The materials below a folder, or of one file, in the order of their names. Unless `only` is empty,
/// it has the extensions of all files.
pub fn of(folder: &Path, only: &[String]) -> Vec<Case> {
    let mut files = Vec::new();
    walk(folder, &mut files);
    let mut by_stem: BTreeMap<PathBuf, Vec<PathBuf>> = BTreeMap::new();
    for file in files {
        let extension = file.extension().and_then(|e| e.to_str());
        let Some(extension) = extension else { continue };
        if !only.is_empty() && !only.iter().any(|o| o == extension) {
            continue;
        }
        let Some((stem, kind)) = stem_and_kind(&file) else {
            continue;
        };
        let is_pair = ["vert", "frag", "vs", "fs"].contains(&&*kind);
        let compiled = if extension == "spv" { ".spv" } else { "" };
        // A pair with a stage between its two is no pair.
        let between = ["geom", "gs", "tesc", "tcs", "tese", "tes", "mesh", "task"];
        let beside = |e| format!("{}.{e}{compiled}", stem.display());
        if is_pair && between.iter().any(|e| Path::new(&beside(e)).is_file()) {
            continue;
        }
        let key = match is_pair {
            true => format!("{}{compiled}", stem.display()).into(),
            false => file.clone(),
        };
        by_stem.entry(key).or_default().push(file);
    }
    let vertex_first = |path: &PathBuf| !is_vertex(path);
    let case = |(stem, mut paths): (PathBuf, Vec<PathBuf>)| {
        paths.sort_by_key(vertex_first);
        let name = stem.display().to_string();
        Case { name, paths }
    };
    by_stem.into_iter().map(case).collect()
}

/// What comes before the stage in a file's name, and the stage: `a` and `vert` of `a.vert` and
/// `a.vert.spv`. A module of both stages and WGSL have the name of their language.
fn stem_and_kind(path: &Path) -> Option<(PathBuf, String)> {
    let kind = path.extension()?.to_str()?.to_owned();
    let stem = path.with_extension("");
    match &*kind {
        "spv" => match stem_and_kind(&stem) {
            Some(stage) if stage.1 != "wgsl" && stage.1 != "slang" => Some(stage),
            _ => other_stage(&stem).is_none().then_some((stem, kind)),
        },
        "vert" | "frag" | "vs" | "fs" | "wgsl" | "wesl" | "slang" => Some((stem, kind)),
        _ => None,
    }
}

/// The extension of a stage that no material has.
fn other_stage(stem: &Path) -> Option<&str> {
    let extension = stem.extension()?.to_str()?;
    let stages = [
        "comp", "geom", "tesc", "tese", "mesh", "task", "rgen", "rchit", "rahit", "rmiss", "rint",
        "rcall",
    ];
    stages.contains(&extension).then_some(extension)
}

/// Whether the name is that of a vertex stage.
pub fn is_vertex(path: &Path) -> bool {
    stem_and_kind(path).is_some_and(|(_, kind)| kind == "vert" || kind == "vs")
}

fn walk(path: &Path, out: &mut Vec<PathBuf>) {
    if path.is_file() {
        out.push(path.to_owned());
        return;
    }
    let entries = std::fs::read_dir(path).into_iter().flatten();
    let mut inside: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    inside.sort();
    for path in inside {
        walk(&path, out);
    }
}
