//! The kind of a file, by its name.

use std::path::{Path, PathBuf};

/// Whether a file is a scene, by its ending, or a captured frame's.
pub fn is_scene(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "toml") || is_gltf(path) || captured(path).is_some()
}

/// Whether a file is glTF, by its ending.
pub fn is_gltf(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
    ending == "glb" || ending == "gltf"
}

pub fn is_stdin(path: &Path) -> bool {
    path == Path::new("-")
}

/// The folder of a captured frame.
pub fn captured(file: &Path) -> Option<&Path> {
    preshade_frames::folder::is_file(file).then(|| file.parent().unwrap_or(Path::new(".")))
}

/// A path from the current folder, if it lies below it. Elsewhere that folder may have another name.
pub fn from_here(path: &Path) -> &Path {
    let here = std::env::current_dir().and_then(|d| d.canonicalize());
    let below = here.ok().and_then(|here| path.strip_prefix(here).ok());
    below.unwrap_or(path)
}

/// Endings for stages. The language's ending may follow.
const STAGES: [&str; 4] = ["vert", "frag", "vs", "fs"];

fn ending(path: &Path) -> &str {
    path.extension()
        .and_then(|e| e.to_str())
        .unwrap_or_default()
}

/// The name that a material's files have in common.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Name {
    /// A file with all stages.
    Whole(String),
    /// The name without the stage, but with the language: a WGSL and a GLSL file are two materials.
    Stages(String),
}

/// Whether a file is one stage by its ending, before which the language's may stand.
pub fn is_stage(file: &Path) -> bool {
    matches!(name(file), Name::Stages(_))
}

pub fn name(file: &Path) -> Name {
    let name = |path: &Path| {
        path.file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    };
    if is_stdin(file) {
        // Given twice, it is two stages, which the reader refuses.
        return Name::Stages("-".to_owned());
    }
    let (stem, last) = (name(file), ending(file));
    let inner = ending(Path::new(&stem)).to_owned();
    match (STAGES.contains(&last), STAGES.contains(&inner.as_str())) {
        (true, _) => Name::Stages(format!("{stem}.glsl")),
        (false, true) => Name::Stages(format!("{}.{last}", name(Path::new(&stem)))),
        (false, false) => Name::Whole(format!("{stem}.{last}")),
    }
}

/// The fragment file of a vertex file, if both are in one folder.
pub fn fragment_beside(vertex: &Path) -> Option<PathBuf> {
    let own = vertex.file_name()?.to_str()?;
    let pairs = [(".vert", ".frag"), (".vs", ".fs")];
    let mut names = pairs.iter().map(|(of, other)| own.replace(of, other));
    names.find_map(|name| {
        let beside = vertex.with_file_name(&name);
        (name != own && beside.is_file()).then_some(beside)
    })
}

/// Whether a file is a shader by its ending.
pub fn is_shader(path: &Path) -> bool {
    let ending = ending(path);
    ["wgsl", "glsl", "slang", "spv"].contains(&ending)
        || STAGES.contains(&ending)
        || (cfg!(feature = "wesl") && ending == "wesl")
}
