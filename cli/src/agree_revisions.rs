//! Files and folders of `agree`, as they are or at a revision of git.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

use crate::agree_inputs::Asked;
use crate::input::ShaderArgs;
use crate::{Failure, file_names, materials};

/// A file or folder to compare.
pub struct Tree {
    /// As the user gave it.
    given: String,
    /// Its place on the disk, which is a copy for a revision.
    path: PathBuf,
    /// The folder that a revision was copied to, and the text that stands for it in messages.
    copied: Option<(PathBuf, String)>,
}

impl Drop for Tree {
    fn drop(&mut self) {
        if let Some((folder, _)) = &self.copied {
            let _ = std::fs::remove_dir_all(folder);
        }
    }
}

impl Tree {
    /// A path, or `REVISION:PATH` if there is no such path.
    pub fn open(given: &Path) -> Result<Self, Failure> {
        let text = given.display().to_string();
        match text.split_once(':') {
            Some((revision, path)) if !given.exists() && !revision.is_empty() => {
                Self::at(&text, revision, path)
            }
            _ => Ok(Self {
                path: given.to_owned(),
                given: text,
                copied: None,
            }),
        }
    }

    /// Copies the folder of a path at a revision, so that imports of other files in it are found.
    fn at(given: &str, revision: &str, path: &str) -> Result<Self, Failure> {
        let failed = |why: &str| Failure(format!("error: {given}: {}", why.trim()));
        let path = match path.strip_prefix("./") {
            Some(below) => format!(
                "{}{below}",
                git(&["rev-parse", "--show-prefix"])
                    .map_err(|e| failed(&e))?
                    .trim()
            ),
            None => path.to_owned(),
        };
        let path = path.trim_end_matches('/');
        let object = format!("{revision}:{path}");
        let kind = git(&["cat-file", "-t", &object]).map_err(|e| failed(&e))?;
        let folder = match kind.trim() {
            "tree" => path,
            _ => Path::new(path)
                .parent()
                .and_then(Path::to_str)
                .unwrap_or_default(),
        };
        static COPIES: AtomicU32 = AtomicU32::new(0);
        let copy = COPIES.fetch_add(1, Ordering::Relaxed);
        let name = format!("preshade-agree-{}-{copy}", std::process::id());
        let root = std::env::temp_dir().join(name);
        let tree = Self {
            given: given.to_owned(),
            path: root.join(path),
            copied: Some((root.clone(), format!("{revision}:"))),
        };
        let below = format!("{folder}/");
        let mut list = vec![
            "ls-tree",
            "-r",
            "-z",
            "--name-only",
            "--full-tree",
            revision,
        ];
        if !folder.is_empty() {
            list.extend(["--", &below]);
        }
        let names = git(&list).map_err(|e| failed(&e))?;
        for name in names.split('\0').filter(|n| !n.is_empty()) {
            if !file_names::is_shader(Path::new(name)) {
                continue;
            }
            let bytes = git_bytes(&["cat-file", "blob", &format!("{revision}:{name}")]);
            let bytes = bytes.map_err(|e| failed(&e))?;
            let to = root.join(name);
            let written = to.parent().map_or(Ok(()), std::fs::create_dir_all);
            written
                .and_then(|()| std::fs::write(&to, bytes))
                .map_err(|e| failed(&e.to_string()))?;
        }
        Ok(tree)
    }

    /// As the user gave it.
    pub fn name(&self) -> &str {
        &self.given
    }

    /// Its place on the disk.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether it is a folder.
    pub fn is_folder(&self) -> bool {
        self.path.is_dir()
    }

    /// A message with the revision in place of its copy.
    pub fn renamed(&self, text: &str) -> String {
        match &self.copied {
            Some((root, name)) => text.replace(&format!("{}/", root.display()), name),
            None => text.to_owned(),
        }
    }
}

fn git(args: &[&str]) -> Result<String, String> {
    let bytes = git_bytes(args)?;
    String::from_utf8(bytes).map_err(|_| "git names a file that is not UTF-8".to_owned())
}

fn git_bytes(args: &[&str]) -> Result<Vec<u8>, String> {
    let run = Command::new("git").args(args).output();
    let run = run.map_err(|e| format!("git does not run: {e}"))?;
    match run.status.success() {
        true => Ok(run.stdout),
        false => Err(String::from_utf8_lossy(&run.stderr).into_owned()),
    }
}

/// The pairs of two files, or of the materials with one path in two folders; and the materials that
/// are in one of the folders alone.
pub fn pairs(
    [before, after]: [&Tree; 2],
    [first, second]: [&ShaderArgs; 2],
    pair: &dyn Fn(ShaderArgs, ShaderArgs) -> Asked,
) -> Result<(Vec<Asked>, Vec<String>), Failure> {
    let of = |shader: &ShaderArgs, files: Vec<PathBuf>| ShaderArgs {
        files,
        ..shader.clone()
    };
    if !before.is_folder() {
        let side = |shader, tree: &Tree| of(shader, vec![tree.path.clone()]);
        let one = pair(side(first, before), side(second, after));
        return Ok((vec![one], Vec::new()));
    }
    let materials = |tree: &Tree, shader: &ShaderArgs| {
        let shader = of(shader, vec![tree.path.clone()]);
        let jobs = materials::jobs(&shader, Path::new(""))?;
        let named = jobs.into_iter().map(|job| {
            let names = job.shader.files.iter().map(|f| {
                let below = f.strip_prefix(&tree.path).unwrap_or(f);
                below.display().to_string()
            });
            (names.collect::<Vec<_>>().join(","), job.shader)
        });
        Ok::<BTreeMap<String, ShaderArgs>, Failure>(named.collect())
    };
    let (mut old, new) = (materials(before, first)?, materials(after, second)?);
    let (mut both, mut alone) = (Vec::new(), Vec::new());
    let only = |tree: &Tree, name: &str| format!("{name} is only in {}", tree.given);
    let mut added = Vec::new();
    for (name, second) in new {
        match old.remove(&name) {
            Some(first) => both.push(Asked {
                name: Some(name),
                ..pair(first, second)
            }),
            None => added.push((name, second)),
        }
    }
    let texts = |shader: &ShaderArgs| {
        let texts = shader.files.iter().map(|f| std::fs::read(f).ok());
        texts.collect::<Option<Vec<_>>>()
    };
    for (name, second) in added {
        let own = texts(&second);
        let mut gone = old.iter();
        let renamed = gone.find(|(_, first)| own.is_some() && texts(first) == own);
        match renamed.map(|(name, _)| name.clone()) {
            Some(earlier) => {
                old.remove(&earlier);
                alone.push(format!("{earlier} is {name} in {}", after.given));
            }
            None => alone.push(only(after, &name)),
        }
    }
    alone.extend(old.keys().map(|name| only(before, name)));
    match both.is_empty() {
        true => Err(Failure(format!(
            "error: {} and {} have no shader in common",
            before.given, after.given
        ))),
        false => Ok((both, alone)),
    }
}
