//! `preshade.lock`: the choice for each material, measured on a developer's adapter and kept beside
//! the shaders, so that a build without a GPU makes the same shaders.
//!
//! Commit the file. It is sorted JSON without dates, and the same content always has the same
//! bytes. For each material it holds the *resolved* recipe (cuts, never budgets to be searched
//! again), the facts that the passes read, the [`Inputs`], a hash of the resulting shaders, and the
//! measurements. To use an entry, call [`Lock::check`] and then [`Locked::apply`]. If either
//! reports a mismatch, ship the original.
//!
//! ```
//! use preshade_compiler::lock::{Inputs, Lock, Locked};
//! use preshade_compiler::front::{Source, parse};
//! use shader_text::options::Options;
//! use preshade_plan::{pass::Facts, plan::Plan, state::MaterialState};
//! use preshade_compiler::recipe::Recipe;
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
pub mod codes;
mod error;
mod inputs;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

pub use choice::{Locked, Measured};
pub use error::{LockError, Mismatch};
pub use inputs::{HashedSource, Inputs};
use preshade_plan::state::MaterialState;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shader_text::files;

/// Name of the file, which is in the folder of the shaders.
pub const FILE_NAME: &str = "preshade.lock";

/// Version of the JSON.
pub(crate) const SCHEMA: &str = "preshade.lock.v1";

pub(crate) const TOOL: &str = concat!("preshade ", env!("CARGO_PKG_VERSION"));

/// The content of a lock file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Lock {
    /// Always [`SCHEMA`].
    pub schema: String,
    /// Choices by material.
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

    /// Reads a file. `None`: there is none.
    ///
    /// # Errors
    /// It cannot be read, or is not a lock file.
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

    /// [`Self::parse`] of the content of `path`.
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
    /// It is not a lock file, or one of another version that this one cannot read.
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

    /// [`Self::parse_file`] for one material. Unreadable entries of other materials are ignored.
    ///
    /// # Errors
    /// As [`Self::parse`], if the file or this material cannot be read.
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

    /// Writes the file unless it is up to date. Returns whether it changed.
    ///
    /// # Errors
    /// The file system's error.
    pub fn write(&self, path: &Path) -> Result<bool, LockError> {
        let folder = match path.parent() {
            Some(parent) if parent != Path::new("") => parent,
            _ => Path::new("."),
        };
        let name = path.file_name().unwrap_or(FILE_NAME.as_ref());
        let file = files::File {
            name: name.to_string_lossy().into_owned(),
            bytes: self.to_json().into_bytes(),
        };
        let changed =
            shader_text::files::write(folder, &[file]).map_err(|error| LockError::Io {
                path: path.to_owned(),
                error,
            })?;
        Ok(!changed.is_empty())
    }

    /// Names of other materials with the same file names as `now`. A scene may name a material
    /// differently than a build script does.
    pub fn same_files(&self, material: &str, now: &Inputs) -> Vec<&str> {
        let others = self.materials.iter().filter(|(name, _)| *name != material);
        others
            .filter(|(_, locked)| locked.inputs.is_of_files(now))
            .map(|(name, _)| name.as_str())
            .collect()
    }

    /// The choice for a material, if its inputs are still the same.
    ///
    /// # Errors
    /// The first difference.
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

/// The other version of preshade that wrote a file, by its schema or by the tool of a material.
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

/// How a material is drawn, as far as a file of another version can be understood.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Left {
    pub vertex: Option<String>,
    pub fragment: Option<String>,
    pub state: Option<MaterialState>,
}

impl Left {
    /// Reads another version's text. `None`: it has materials, but not this one.
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
