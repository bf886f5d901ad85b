//! Many materials in one process: which of the files given make one, and where below `--out-dir` it goes.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Component, Path, PathBuf};

use preshade::passes::pass::Refusal;

use crate::Failure;
use crate::input::{ShaderArgs, is_stdin};

/// One material, or the materials of one scene.
pub struct Job {
    /// What to read.
    pub shader: ShaderArgs,
    /// Folder to write to.
    pub folder: Option<PathBuf>,
}

/// A job for each material among the files of `shader`, folders searched. A vertex and a fragment file of one name are one material. The folders below `out` are
/// those of the files as they were given, or below the folder that was given.
///
/// # Errors
/// A folder cannot be read, or there is no shader.
pub fn jobs(shader: &ShaderArgs, out: &Path) -> Result<Vec<Job>, Failure> {
    let mut materials: BTreeMap<(PathBuf, String), Vec<PathBuf>> = BTreeMap::new();
    let mut add = |folder: PathBuf, file: PathBuf| {
        let name = material(&file);
        materials.entry((folder, name)).or_default().push(file);
    };
    for file in &shader.files {
        if !file.is_dir() {
            add(below(file.parent().unwrap_or(Path::new(""))), file.clone());
            continue;
        }
        let mut found = Vec::new();
        walk(file, &mut found).map_err(|e| Failure(format!("error: {}: {e}", file.display())))?;
        for shader in found {
            let folder = shader.parent().and_then(|p| p.strip_prefix(file).ok());
            add(folder.unwrap_or(Path::new("")).to_owned(), shader);
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
    let jobs = materials.into_iter().map(|((folder, _), files)| Job {
        shader: ShaderArgs {
            files: vertex_first(files),
            ..shader.clone()
        },
        folder: Some(out.join(folder)),
    });
    Ok(jobs.collect())
}

/// What became of many materials.
#[derive(Default)]
pub struct Sum {
    rewritten: usize,
    /// Those that no pass was applied to.
    kept: usize,
    /// Jobs of which something could not be read or written.
    pub failed: usize,
    /// By code.
    refused: BTreeMap<String, usize>,
    /// Files that changed.
    pub written: usize,
    /// Files that did not.
    pub up_to_date: usize,
}

impl Sum {
    /// Counts a material that was written: whether a pass was applied, and what was refused.
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

    /// In one line.
    pub fn line(&self) -> String {
        let mut parts = vec![format!("{} rewritten", self.rewritten)];
        if self.kept > 0 {
            parts.push(format!("{} written as they are", self.kept));
        }
        if self.failed > 0 {
            parts.push(format!("{} failed", self.failed));
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

/// A message with the files that it is of, where it names none of them.
pub fn of_files(message: &str, job: &Job) -> String {
    let files = job.shader.files.iter().map(|f| f.display().to_string());
    let files: Vec<String> = files.collect();
    match files.iter().any(|f| message.contains(f.as_str())) {
        true => message.to_owned(),
        false => format!("{}\n = in {}", message.trim_end(), files.join(" and ")),
    }
}

/// The part of a path that can be made again below another folder.
fn below(path: &Path) -> PathBuf {
    let normal = path
        .components()
        .filter(|c| matches!(c, Component::Normal(_)));
    match path.is_absolute() {
        true => PathBuf::new(),
        false => normal.collect(),
    }
}

/// Endings that say a stage, before the language's where there is one.
const STAGES: [&str; 4] = ["vert", "frag", "vs", "fs"];

fn ending(path: &Path) -> &str {
    path.extension()
        .and_then(|e| e.to_str())
        .unwrap_or_default()
}

/// What files of one material have in common: the name without the stage, but with the language, so that a WGSL and a GLSL file of one name are two.
fn material(file: &Path) -> String {
    let name = |path: &Path| {
        path.file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    };
    if is_stdin(file) {
        return "-".to_owned();
    }
    let (stem, last) = (name(file), ending(file));
    let inner = ending(Path::new(&stem)).to_owned();
    match (STAGES.contains(&last), STAGES.contains(&inner.as_str())) {
        (true, _) => format!("{stem}.glsl"),
        (false, true) => format!("{}.{last}", name(Path::new(&stem))),
        (false, false) => format!("{stem}.{last}"),
    }
}

fn vertex_first(mut files: Vec<PathBuf>) -> Vec<PathBuf> {
    let is_fragment = |file: &PathBuf| {
        let name = file.to_string_lossy();
        [".frag", ".fs"].iter().any(|s| name.contains(s))
    };
    files.sort_by_key(|f| (is_fragment(f), f.clone()));
    files
}

/// The shader files below a folder, in order.
/// The scenes given, each folder standing for the scenes in it, by name.
///
/// # Errors
/// A folder cannot be read, or has no scene.
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
        found.retain(|f| ending(f) == "toml");
        if found.is_empty() {
            return Err(Failure(format!(
                "error: {}: no scene (.toml) is in it",
                path.display()
            )));
        }
        found.sort();
        all.extend(found);
    }
    Ok(all)
}

/// Refuses scenes whose folders below one `--out` would be the same.
pub fn told_apart(scenes: &[PathBuf]) -> Result<(), Failure> {
    let mut seen: BTreeMap<&OsStr, &PathBuf> = BTreeMap::new();
    for scene in scenes {
        let stem = scene.file_stem().unwrap_or_default();
        if let Some(other) = seen.insert(stem, scene) {
            return Err(Failure(format!(
                "error: {} and {} would both be written to the folder `{}` of --out; run them one after the other, each with its own --out",
                other.display(),
                scene.display(),
                stem.display()
            )));
        }
    }
    Ok(())
}

/// Where below `out` one of several scenes goes.
pub fn folder_of(out: &Path, scene: &Path) -> PathBuf {
    out.join(scene.file_stem().unwrap_or_default())
}

fn walk(folder: &Path, found: &mut Vec<PathBuf>) -> std::io::Result<()> {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder)?
        .map(|e| e.map(|e| e.path()))
        .collect::<Result<_, _>>()?;
    entries.sort();
    for path in entries {
        if path.is_dir() {
            walk(&path, found)?;
        } else if ["wgsl", "glsl"].contains(&ending(&path)) || STAGES.contains(&ending(&path)) {
            found.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_of_one_name_are_one_material() {
        let name = |file: &str| material(Path::new(file));
        assert_eq!(name("a/lit.vert"), name("a/lit.frag"));
        assert_eq!(name("lit.vert.glsl"), name("lit.frag.glsl"));
        assert_eq!(name("lit.vert.wgsl"), name("lit.frag.wgsl"));
        assert_eq!(name("lit.vs"), name("lit.fs"));
        assert_ne!(name("lit.wgsl"), name("lit.vert"));
        assert_ne!(name("a.wgsl"), name("b.wgsl"));
    }

    #[test]
    fn a_tree_stays_below_the_folder() {
        assert_eq!(below(Path::new("../shaders/./a")), Path::new("shaders/a"));
        assert_eq!(below(Path::new("/etc/shaders")), Path::new(""));
    }
}
