//! The files that a scene may read.
//!
//! A path in a scene is relative to the scene's folder. It may go up, but not out of the scene's
//! root: the nearest folder at or above it with a `preshade.toml` or a `.git`, or else the scene's
//! folder itself.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use preshade_draw::scene::SceneError;
use shader_text::limits::Limits;
use shader_text::read_limited;

/// The files that a scene may read, and its size limits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Access {
    /// Whether files may lie outside of the scene's root folder.
    pub outside: Outside,
    pub limits: Limits,
}

/// Whether a scene's files may lie outside of its root folder (`docs/reference/scenes.md`,
/// "Paths").
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Outside {
    #[default]
    Refused,
    Allowed,
}

/// The folder of a scene's files, and the root that they must not leave.
pub(super) struct Folder {
    base: PathBuf,
    /// The scene may not leave this folder, and messages leave out this prefix.
    root: PathBuf,
    /// Folders outside of the root that a user named at the command line.
    also: Vec<PathBuf>,
    access: Access,
    /// Full paths of the files read so far.
    read: RefCell<BTreeSet<PathBuf>>,
}

impl Folder {
    pub(super) fn of(scene: &Path, access: Access) -> Result<Self, SceneError> {
        let base = match scene.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        let base = base
            .canonicalize()
            .map_err(|e| SceneError::read(base, &e))?;
        let root = base
            .ancestors()
            .find(|d| d.join("preshade.toml").exists() || d.join(".git").exists())
            .unwrap_or(&base)
            .to_owned();
        Ok(Self {
            base,
            root,
            also: Vec::new(),
            access,
            read: RefCell::default(),
        })
    }

    /// Allows the folder of a file that a user named.
    ///
    /// # Errors
    /// There is no such folder.
    pub(super) fn also(&mut self, file: &Path) -> Result<(), SceneError> {
        let own = Self::of(file, self.access)?;
        self.also.push(own.root);
        Ok(())
    }

    /// The folder that files included by `name` must not leave. `None` without such a restriction.
    pub(super) fn root_of(&self, name: &str) -> Option<PathBuf> {
        let real = self.whole(name)?;
        let mut roots = self.roots()?;
        roots
            .find(|root| real.starts_with(root))
            .map(Path::to_owned)
    }

    /// The folders that files must not leave. `None` without such a restriction.
    fn roots(&self) -> Option<impl Iterator<Item = &Path>> {
        match self.access.outside {
            Outside::Refused => {
                let also = self.also.iter().map(PathBuf::as_path);
                Some(std::iter::once(self.root.as_path()).chain(also))
            }
            Outside::Allowed => None,
        }
    }

    /// Whether the file with this full path may be read.
    fn is_inside(&self, real: &Path) -> bool {
        self.roots()
            .is_none_or(|mut roots| roots.any(|root| real.starts_with(root)))
    }

    /// The bytes of a file, and its path for messages.
    pub(super) fn read(&self, name: &str) -> Result<(String, Vec<u8>), SceneError> {
        let path = self.base.join(name);
        let real = path.canonicalize().map_err(|e| {
            SceneError::new(format!("cannot read `{name}`: {e}"))
                .help("paths are relative to the scene file's folder")
        })?;
        if !self.is_inside(&real) {
            return Err(SceneError::new(format!(
                "`{name}` lies outside of the scene's root folder"
            ))
            .help(
                "the root is the nearest folder above the scene with a `preshade.toml` or a \
                 `.git`, or else its own folder; --allow-outside lets files leave it",
            ));
        }
        let bytes = read_limited::bytes(&real, &self.access.limits, "file-bytes")
            .map_err(|e| SceneError::unread(Path::new(name), e))?;
        self.read.borrow_mut().insert(real.clone());
        let shown = real.strip_prefix(&self.root).unwrap_or(&real);
        Ok((shown.display().to_string(), bytes))
    }

    /// Full path of a file that was read.
    pub(super) fn whole(&self, name: &str) -> Option<PathBuf> {
        self.base.join(name).canonicalize().ok()
    }

    /// Full paths of the files read so far, sorted.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        self.read.borrow().iter().cloned().collect()
    }

    /// Full path of a folder that the scene names.
    pub(super) fn folder(&self, name: &Path) -> Result<PathBuf, SceneError> {
        let real = self.base.join(name).canonicalize();
        let real = real.map_err(|e| SceneError::read(name, &e))?;
        match self.is_inside(&real) {
            true => Ok(real),
            false => Err(SceneError::new(format!(
                "`{}` lies outside of the scene's root folder",
                name.display()
            ))),
        }
    }
}
