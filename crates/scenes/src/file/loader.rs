//! State that the readers of a scene file's entries share: text, folder and limits.

use std::cell::Cell;

use toml::Spanned;

use super::place::Folder;
use super::size::{self, SCENE_BYTES};
use super::variables;
use crate::file::entries::SceneFile;
use crate::file::place::Access;
use crate::file::text::SceneText;
use crate::file::variables::Variables;
use preshade_draw::scene::{Draw, SceneError};

/// Reads the entries of a scene file.
pub(super) struct Loader<'a> {
    pub source: SceneText<'a>,
    pub folder: Folder,
    pub file: SceneFile,
    pub variables: Variables,
    pub access: Access,
    /// Size of the scene so far, in bytes.
    pub held: Cell<u64>,
}

impl<'a> Loader<'a> {
    pub(super) fn new(
        source: SceneText<'a>,
        folder: Folder,
        file: SceneFile,
        variables: &Variables,
        access: Access,
    ) -> Result<Self, SceneError> {
        let variables = variables::set(&file.variables, variables)?;
        Ok(Self {
            source,
            folder,
            file,
            variables,
            access,
            held: Cell::new(0),
        })
    }
}

impl Loader<'_> {
    /// Counts bytes against the limit before they are allocated.
    pub(super) fn hold(&self, bytes: u64) -> Result<(), SceneError> {
        let all = self.held.get().saturating_add(bytes);
        self.held.set(all);
        let limits = &self.access.limits;
        Ok(limits.check("scene-bytes", all, SCENE_BYTES)?)
    }

    /// Counts `more` draws like `draw` against the limit before they are created.
    pub(super) fn hold_draws(
        &self,
        draws: &[Draw],
        more: u64,
        draw: &Draw,
    ) -> Result<(), SceneError> {
        let all = (draws.len() as u64).saturating_add(more);
        self.access
            .limits
            .check("draws", all, "the number of draws")?;
        self.hold(more.saturating_mul(size::of_draw(draw)))
    }

    /// Index of the mesh or material with this name among `names`.
    pub(super) fn find(
        &self,
        what: &str,
        wanted: &Spanned<String>,
        names: Vec<&str>,
    ) -> Result<usize, SceneError> {
        let name = wanted.get_ref();
        names.iter().position(|n| n == name).ok_or_else(|| {
            let e = SceneError::new(format!("there is no {what} `{name}`")).suggest(name, names);
            self.source.at(e, wanted.span())
        })
    }
}
