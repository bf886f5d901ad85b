//! `preshade.lock`: what was chosen for each material on a developer's adapter, kept beside the shaders so that a build without a GPU makes the same.
//!
//! The file is JSON that is meant to be committed: sorted, the same bytes for the same content, no dates. For each material it holds the *resolved* recipe (sites and cuts, never
//! budgets to be searched again), the evidence the passes read, what the choice was made of ([`Inputs`]), a hash of the shaders that came of it, and the figures that
//! spoke for it. Whoever obeys it asks [`Lock::check`] first and [`Locked::apply`] then; each tells by name what no longer fits, and the original is to be shipped.
//!
//! ```
//! use preshade::lock::{Inputs, Lock, Locked};
//! use preshade::front::{Options, Source, parse};
//! use preshade::passes::{pass::Facts, plan::Plan, state::MaterialState};
//! use preshade::recipe::Recipe;
//!
//! let text = "@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }
//!             @fragment fn fs() -> @location(0) vec4<f32> { return vec4<f32>(1.0); }";
//! let (sources, options, state) = ([Source::new("lit.wgsl", text)], Options::default(), MaterialState::default());
//! let parsed = parse(&sources, &options)?;
//! let inputs = Inputs::of(&parsed, &options.defines, &state);
//! let original = parsed.plan("lit", &state);
//!
//! let mut lock = Lock::default();
//! let recipe = Recipe::parse(["depth-prepass"])?;
//! lock.materials.insert("lit".to_owned(), Locked::resolve(&original, &recipe, &Facts::default(), inputs.clone(), None)?);
//!
//! let lock = Lock::parse(&lock.to_json())?;
//! let plan = lock.check("lit", &inputs)?.apply(&original)?;
//! assert_eq!(plan.passes.len(), 2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod choice;
mod error;
mod inputs;
#[cfg(test)]
mod tests;

pub use choice::{Locked, Measured};
pub use error::{LockError, Mismatch};
pub use inputs::{HashedSource, Inputs};

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use preshade_passes::state::MaterialState;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::emit;

/// Name of the file, which lies in the folder of the shaders that it is about.
pub const FILE_NAME: &str = "preshade.lock";

/// Version of the JSON.
pub const SCHEMA: &str = "preshade.lock.v1";

/// This preshade, as a lock names it.
pub const TOOL: &str = concat!("preshade ", env!("CARGO_PKG_VERSION"));

/// The content of a lock file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Lock {
    /// Always [`SCHEMA`].
    pub schema: String,
    /// What was chosen, by the material's name.
    pub materials: BTreeMap<String, Locked>,
}

impl Default for Lock {
    fn default() -> Self {
        Self {
            schema: SCHEMA.to_owned(),
            materials: BTreeMap::new(),
        }
    }
}

impl Lock {
    /// The lock file of a folder of shaders.
    pub fn path_beside(shader: &Path) -> PathBuf {
        shader.with_file_name(FILE_NAME)
    }

    /// Reads a file; `None` where there is none.
    ///
    /// # Errors
    /// It cannot be read, or is no lock file.
    pub fn read(path: &Path) -> Result<Option<Self>, LockError> {
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => {
                return Err(LockError::Io {
                    path: path.to_owned(),
                    error,
                });
            }
        };
        Self::parse_file(&text, path).map(Some)
    }

    /// [`Self::parse`] of what `path` holds.
    pub(crate) fn parse_file(text: &str, path: &Path) -> Result<Self, LockError> {
        match Self::parse(text) {
            Err(LockError::Syntax { message, .. }) => Err(LockError::Syntax {
                path: path.to_owned(),
                message,
            }),
            Err(LockError::Foreign { by, message, .. }) => Err(LockError::Foreign {
                path: path.to_owned(),
                by,
                message,
            }),
            read => read,
        }
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// It is no lock file, or one that another preshade wrote and this one cannot read.
    pub fn parse(text: &str) -> Result<Self, LockError> {
        let path = PathBuf::from(FILE_NAME);
        let message = match serde_json::from_str::<Self>(text) {
            Ok(lock) if lock.schema == SCHEMA => return Ok(lock),
            Ok(lock) => format!("its schema is `{}`, not `{SCHEMA}`", lock.schema),
            Err(error) => error.to_string(),
        };
        match written_by_another(text) {
            Some(by) => Err(LockError::Foreign { path, by, message }),
            None => Err(LockError::Syntax { path, message }),
        }
    }

    /// As [`Self::parse_file`], for one material: what cannot be read of others is left out.
    ///
    /// # Errors
    /// As [`Self::parse`], where it is the file or this material that cannot be read.
    pub(crate) fn parse_for(text: &str, path: &Path, material: &str) -> Result<Self, LockError> {
        let whole = Self::parse_file(text, path);
        let Err(LockError::Foreign { .. }) = whole else {
            return whole;
        };
        let file: serde_json::Value = serde_json::from_str(text).unwrap_or_default();
        let all = file.get("materials").and_then(|m| m.as_object());
        let (Some(all), Some(SCHEMA)) = (all, file.get("schema").and_then(|s| s.as_str())) else {
            return whole;
        };
        let mut lock = Self::default();
        for (name, value) in all {
            match Locked::deserialize(value) {
                Ok(locked) => drop(lock.materials.insert(name.clone(), locked)),
                Err(error) if name == material => {
                    let tool = value.pointer("/inputs/tool").and_then(|t| t.as_str());
                    let (path, message) = (path.to_owned(), error.to_string());
                    return Err(match tool {
                        Some(by) if by != TOOL => LockError::Foreign {
                            path,
                            by: by.to_owned(),
                            message,
                        },
                        _ => LockError::Syntax { path, message },
                    });
                }
                Err(_) => {}
            }
        }
        Ok(lock)
    }

    /// The text of the file.
    pub fn to_json(&self) -> String {
        // Plain data with string keys: serialising it cannot fail.
        let mut text = serde_json::to_string_pretty(self).unwrap_or_default();
        text.push('\n');
        text
    }

    /// Writes the file, whole; one that says the same is not touched. Whether it changed.
    ///
    /// # Errors
    /// What the file system says.
    pub fn write(&self, path: &Path) -> Result<bool, LockError> {
        let folder = match path.parent() {
            Some(parent) if parent != Path::new("") => parent,
            _ => Path::new("."),
        };
        let name = path.file_name().unwrap_or(FILE_NAME.as_ref());
        let file = emit::File {
            name: name.to_string_lossy().into_owned(),
            bytes: self.to_json().into_bytes(),
        };
        let changed = emit::write(folder, &[file]).map_err(|error| LockError::Io {
            path: path.to_owned(),
            error,
        })?;
        Ok(!changed.is_empty())
    }

    /// Materials of other names than `material` that were chosen for files called as those of `now`: a scene may name a material otherwise than a build script does.
    pub fn same_files(&self, material: &str, now: &Inputs) -> Vec<&str> {
        let others = self.materials.iter().filter(|(name, _)| *name != material);
        others
            .filter(|(_, locked)| locked.inputs.is_of_files(now))
            .map(|(name, _)| name.as_str())
            .collect()
    }

    /// What was chosen for a material, if that was of what is there now.
    ///
    /// # Errors
    /// The first thing that differs.
    pub fn check(&self, material: &str, now: &Inputs) -> Result<&Locked, Mismatch> {
        let Some(locked) = self.materials.get(material) else {
            return Err(Mismatch::NoMaterial {
                material: material.to_owned(),
            });
        };
        match locked.inputs.difference(now) {
            None => Ok(locked),
            Some(mismatch) => Err(mismatch),
        }
    }
}

/// Which other preshade a file says that it is of: by another schema of locks, or by the tool of a material.
fn written_by_another(text: &str) -> Option<String> {
    let file: serde_json::Value = serde_json::from_str(text).ok()?;
    let schema = file.get("schema")?.as_str()?;
    if !schema.starts_with("preshade.lock.") {
        return None;
    }
    if schema != SCHEMA {
        return Some(schema.to_owned());
    }
    let materials = file.get("materials")?.as_object()?.values();
    let tools = materials.filter_map(|m| m.pointer("/inputs/tool")?.as_str());
    let mut others = tools.filter(|tool| *tool != TOOL);
    others.next().map(str::to_owned)
}

/// How a material is drawn, as far as a file of another preshade says so in words that this one knows.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Left {
    /// Vertex entry point.
    pub vertex: Option<String>,
    /// Fragment entry point.
    pub fragment: Option<String>,
    /// The state that the author draws the material with.
    pub state: Option<MaterialState>,
}

impl Left {
    /// Of a text that is no lock of this preshade's; `None` where it has materials, and not this one.
    pub fn of(text: &str, material: &str) -> Option<Self> {
        let file: serde_json::Value = serde_json::from_str(text).unwrap_or_default();
        let Some(all) = file.get("materials").and_then(|m| m.as_object()) else {
            return Some(Self::default());
        };
        let inputs = all.get(material)?.get("inputs");
        let word = |key: &str| Some(inputs?.get(key)?.as_str()?.to_owned());
        let state = inputs.and_then(|i| i.get("state"));
        Some(Self {
            vertex: word("vertex"),
            fragment: word("fragment"),
            state: state.and_then(|s| MaterialState::deserialize(s).ok()),
        })
    }
}
