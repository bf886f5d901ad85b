//! Many materials with one command: groups the given files by material, and places each below
//! `--out-dir`.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::path::{Component, Path, PathBuf};

use preshade_plan::pass::Refusal;

use crate::file_names::{self, Name, is_gltf, is_shader, is_stage, name};
use crate::input::ShaderArgs;
use crate::{Failure, config};

/// One material, or the materials of one scene.
pub struct Job {
    pub shader: ShaderArgs,
    pub folder: Option<PathBuf>,
    /// How the files were chosen.
    pub chosen: Chosen,
}

/// How the files of a job were chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chosen {
    Given,
    /// In a given folder, which may contain other files than materials.
    Found,
}

/// A job for each material among the files of `shader` and in its folders. A vertex and a fragment
/// file with the same name and folder are one material. Below `out`, files keep their given paths,
/// or their paths below the one given folder.
///
/// # Errors
/// A folder cannot be read, or there is no shader.
pub fn jobs(shader: &ShaderArgs, out: &Path) -> Result<Vec<Job>, Failure> {
    gathered(shader, out, is_shader)
}

/// A job for each material and for each scene among the files of `shader` and in its folders.
/// `None`: the files are one material, or one scene.
pub fn inputs(shader: &ShaderArgs) -> Result<Option<Vec<Job>>, Failure> {
    let files = &shader.files;
    // Two files may be the two stages of one material, whatever their names. A scene and a shader
    // together are a mistake, which the reader names.
    let is_one = match files.len() {
        0 | 1 => true,
        2 => !files.iter().all(|f| is_scene(f)),
        _ => false,
    };
    if is_one && !files.iter().any(|f| f.is_dir()) {
        return Ok(None);
    }
    let is_input = |path: &Path| is_shader(path) || is_scene_of_folder(path);
    gathered(shader, Path::new(""), is_input).map(Some)
}

/// A job for each scene and each bare shader among the files of `shader`, and for each scene in its
/// folders, in the given order. A vertex and a fragment file are one shader if they have one name
/// and folder, or if nothing else is given.
pub fn drawn(mut shader: ShaderArgs) -> Result<Vec<Job>, Failure> {
    shader.files = scenes(&shader.files)?;
    let files = shader.files.clone();
    if files.len() == 2 && files.iter().all(|f| is_stage(f)) {
        shader.files = vertex_first(files);
        return Ok(vec![Job {
            shader,
            folder: None,
            chosen: Chosen::Given,
        }]);
    }
    let mut jobs = gathered(&shader, Path::new(""), is_scene_of_folder)?;
    let place = |job: &Job| files.iter().position(|f| job.shader.files.contains(f));
    jobs.sort_by_key(place);
    Ok(jobs)
}

/// [`jobs`] of the files that `is_wanted` accepts in folders.
fn gathered(
    shader: &ShaderArgs,
    out: &Path,
    is_wanted: impl Fn(&Path) -> bool,
) -> Result<Vec<Job>, Failure> {
    // By the folder below `out`, the given folder, and the name.
    type Key = (PathBuf, PathBuf, Name);
    let mut materials: BTreeMap<Key, (Chosen, Vec<PathBuf>)> = BTreeMap::new();
    let mut add = |to: PathBuf, chosen: Chosen, file: PathBuf| {
        let from = file.parent().unwrap_or(Path::new("")).to_owned();
        let material = materials.entry((to, from, name(&file)));
        let (known, files) = material.or_insert((chosen, Vec::new()));
        if chosen == Chosen::Given {
            *known = chosen;
        }
        if !files.contains(&file) {
            files.push(file);
        }
    };
    for file in &shader.files {
        if !file.is_dir() {
            let folder = below(file.parent().unwrap_or(Path::new("")));
            add(folder, Chosen::Given, file.clone());
            continue;
        }
        let found = found(file, out, &is_wanted)
            .map_err(|e| Failure(format!("error: {}: {e}", file.display())))?;
        // Its name distinguishes it from the other given folders.
        let root = match shader.files.len() {
            1 => PathBuf::new(),
            _ => below(file),
        };
        for shader in found {
            let folder = shader.parent().and_then(|p| p.strip_prefix(file).ok());
            add(
                root.join(folder.unwrap_or(Path::new(""))),
                Chosen::Found,
                shader,
            );
        }
    }
    if materials.is_empty() {
        return Err(Failure(
            "error: no shader is in the folders given".to_owned(),
        ));
    }
    if materials.len() > 1 && shader.name.is_some() {
        return Err(Failure("error: --name is for one material".to_owned()));
    }
    let jobs = materials
        .into_iter()
        .map(|((folder, ..), (chosen, files))| Job {
            shader: ShaderArgs {
                files: vertex_first(files),
                ..shader.clone()
            },
            folder: Some(out.join(folder)),
            chosen,
        });
    Ok(jobs.collect())
}

#[derive(Default)]
pub struct Sum {
    rewritten: usize,
    /// Materials without an applied pass.
    kept: usize,
    /// Jobs that failed to read or write something.
    pub failed: usize,
    /// Files in a folder that are not materials.
    pub no_material: usize,
    /// Number of refusals by code.
    refused: BTreeMap<String, usize>,
    pub written: usize,
    /// Files that did not change.
    pub up_to_date: usize,
}

impl Sum {
    /// Counts a written material, and its refusals.
    pub fn add(&mut self, was_rewritten: bool, refusals: &[Refusal]) {
        match was_rewritten {
            true => self.rewritten += 1,
            false => self.kept += 1,
        }
        for refusal in refusals {
            let code = format!("{}/{}", refusal.pass, refusal.code);
            *self.refused.entry(code).or_default() += 1;
        }
    }

    /// A summary in one line.
    pub fn line(&self) -> String {
        let mut parts = vec![format!("{} rewritten", self.rewritten)];
        if self.kept > 0 {
            parts.push(format!("{} written as they are", self.kept));
        }
        if self.failed > 0 {
            parts.push(format!("{} failed", self.failed));
        }
        if self.no_material > 0 {
            parts.push(format!("{} left out", self.no_material));
        }
        let refused: Vec<String> = self
            .refused
            .iter()
            .map(|(code, n)| format!("{code} {n}"))
            .collect();
        let refused = match refused.is_empty() {
            true => String::new(),
            false => format!("; refused: {}", refused.join(", ")),
        };
        format!(
            "materials: {}; files: {} written, {} up to date{refused}",
            parts.join(", "),
            self.written,
            self.up_to_date
        )
    }
}

/// A message with the job's files, unless it names one of them.
pub fn of_files(message: &str, job: &Job) -> String {
    let files = job.shader.files.iter().map(|f| f.display().to_string());
    let files: Vec<String> = files.collect();
    match files.iter().any(|f| message.contains(f.as_str())) {
        true => message.to_owned(),
        false => format!("{}\n = in {}", message.trim_end(), files.join(" and ")),
    }
}

/// The part of a path that can be repeated below another folder.
fn below(path: &Path) -> PathBuf {
    let normal = path
        .components()
        .filter(|c| matches!(c, Component::Normal(_)));
    match path.is_absolute() {
        true => PathBuf::new(),
        false => normal.collect(),
    }
}

/// Endings of stages that run between the two of a material.
const BETWEEN: [&str; 3] = ["geom", "tesc", "tese"];

/// A note on further stages in the folder of a material's two files, which would run between them.
pub fn between(files: &[PathBuf]) -> Option<String> {
    let [vertex, fragment] = files else {
        return None;
    };
    if name(vertex) != name(fragment) {
        return None;
    }
    let own = vertex.file_name()?.to_str()?;
    let beside = BETWEEN.iter().filter_map(|ending| {
        let name = own.replace(".vert", &format!(".{ending}"));
        let file = vertex.with_file_name(&name);
        (name != own && file.is_file()).then(|| format!("`{}`", file.display()))
    });
    let beside: Vec<String> = beside.collect();
    (!beside.is_empty()).then(|| {
        format!(
            "note: left out: {}; a material has a vertex and a fragment stage, and what is made of \
             these two is wrong where another stage runs between them",
            beside.join(", ")
        )
    })
}

fn vertex_first(mut files: Vec<PathBuf>) -> Vec<PathBuf> {
    let is_fragment = |file: &PathBuf| {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        [".frag", ".fs"].iter().any(|s| name.contains(s))
    };
    files.sort_by_key(|f| (is_fragment(f), f.clone()));
    files
}

/// The given scenes, and the scenes in given folders, sorted by name.
pub fn scenes(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut all = Vec::new();
    for path in paths {
        if !path.is_dir() {
            all.push(path.clone());
            continue;
        }
        let told = |e: std::io::Error| Failure(format!("error: {}: {e}", path.display()));
        let entries = std::fs::read_dir(path).map_err(told)?;
        let files: Result<Vec<PathBuf>, _> = entries.map(|e| e.map(|e| e.path())).collect();
        let mut found = files.map_err(told)?;
        found.retain(|f| is_scene_of_folder(f));
        if found.is_empty() {
            return Err(Failure(format!(
                "error: {}: no scene (.toml, .glb or .gltf) is in it",
                path.display()
            )));
        }
        found.sort();
        all.extend(found);
    }
    Ok(all)
}

/// Whether a file is a scene, and not the configuration file, or a captured frame.
pub fn is_scene(path: &Path) -> bool {
    file_names::is_scene(path) && path.file_name() != Some(config::FILE.as_ref())
}

/// Whether a file of a folder is a scene. If the folder has other scenes, a glTF file is a mesh of
/// theirs.
fn is_scene_of_folder(path: &Path) -> bool {
    let has_others = || {
        let beside = path.parent().and_then(|folder| folder.read_dir().ok());
        let mut beside = beside.into_iter().flatten().flatten().map(|e| e.path());
        beside.any(|f| is_scene(&f) && !is_gltf(&f))
    };
    is_scene(path) && (!is_gltf(path) || !has_others())
}

/// Refuses scenes that would share a folder below `--out`.
pub fn told_apart(scenes: &[PathBuf]) -> Result<(), Failure> {
    let mut seen: BTreeMap<&OsStr, &PathBuf> = BTreeMap::new();
    for scene in scenes {
        let stem = scene.file_stem().unwrap_or_default();
        if let Some(other) = seen.insert(stem, scene) {
            return Err(Failure(format!(
                "error: {} and {} would both be written to the folder `{}` of --out; \
                 run them one after the other, each with its own --out",
                other.display(),
                scene.display(),
                stem.display()
            )));
        }
    }
    Ok(())
}

/// The folder of a scene below `out`.
pub fn folder_of(out: &Path, scene: &Path) -> PathBuf {
    out.join(scene.file_stem().unwrap_or_default())
}

/// The wanted files below a folder, sorted, except for those below `out`, which are our own output.
/// Links to folders outside of the tree are followed, and each folder is searched once.
fn found(
    folder: &Path,
    out: &Path,
    is_wanted: &impl Fn(&Path) -> bool,
) -> std::io::Result<Vec<PathBuf>> {
    let root = folder.canonicalize()?;
    let mut seen = BTreeSet::from([root.clone()]);
    // It does not exist before the first run.
    seen.extend(out.canonicalize().ok().filter(|out| *out != root));
    let (mut found, mut folders) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder)? {
            let path = entry?.path();
            if !path.is_dir() {
                found.extend(is_wanted(&path).then_some(path));
                continue;
            }
            let whole = path.canonicalize()?;
            let is_found_anyway =
                path.is_symlink() && (whole.starts_with(&root) || root.starts_with(&whole));
            if !is_found_anyway && seen.insert(whole) {
                folders.push(path);
            }
        }
    }
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_of_one_name_are_one_material() {
        let name = |file: &str| name(Path::new(file));
        assert_eq!(name("a/lit.vert"), name("a/lit.frag"));
        assert_eq!(name("lit.vert.glsl"), name("lit.frag.glsl"));
        assert_eq!(name("lit.vert.wgsl"), name("lit.frag.wgsl"));
        assert_eq!(name("lit.vs"), name("lit.fs"));
        assert_ne!(name("lit.wgsl"), name("lit.vert"));
        assert_ne!(name("a.wgsl"), name("b.wgsl"));
        assert_ne!(name("lit.wgsl"), name("lit.vert.wgsl"));
    }

    #[test]
    fn a_tree_stays_below_the_folder() {
        assert_eq!(below(Path::new("../shaders/./a")), Path::new("shaders/a"));
        assert_eq!(below(Path::new("/etc/shaders")), Path::new(""));
    }
}
