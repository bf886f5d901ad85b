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
//! let original = Plan::original("lit", parsed.program, &parsed.vertex, parsed.fragment.as_deref(), &state);
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

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use preshade_passes::contract::Verdict;
use preshade_passes::pass::{Facts, Refusal};
use preshade_passes::plan::Plan;
use preshade_passes::state::MaterialState;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::emit::{self, Target};
use crate::front;
use crate::recipe::{Recipe, Step};

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

/// What was chosen for one material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Locked {
    /// The recipe, every step with its site and all its parameters. No steps: the original is best.
    pub recipe: Recipe,
    /// What it was made of.
    pub inputs: Inputs,
    /// BLAKE3 of the WGSL that came of it, comments and blanks at the ends of lines apart, in hex.
    pub shaders: String,
    /// What the passes read of the scene, as far as it is about this material.
    #[serde(default, skip_serializing_if = "is_nothing")]
    pub facts: Facts,
    /// The figures that spoke for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured: Option<Measured>,
}

fn is_nothing(facts: &Facts) -> bool {
    *facts == Facts::default()
}

/// All that decides what a recipe makes of a material, but for the scene's evidence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Inputs {
    /// [`TOOL`].
    pub tool: String,
    /// The material's files, in order, and what they include.
    pub sources: Vec<HashedSource>,
    /// Preprocessor definitions, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub defines: BTreeMap<String, String>,
    /// Vertex entry point, be it the only one or chosen among several.
    pub vertex: String,
    /// Fragment entry point, likewise; `None` where depth alone is drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fragment: Option<String>,
    /// The state that the author draws the material with.
    pub state: MaterialState,
}

/// A source file, by name and content.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HashedSource {
    /// File name, without its folder.
    pub file: String,
    /// BLAKE3 of the text in hex: without comments, empty lines and what blanks end a line.
    pub blake3: String,
}

/// What was measured of a choice, beside the original in one process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// The scene it was measured on, by its file's name.
    pub scene: String,
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    /// Name of the adapter, and `with checked shaders` behind it where they were compiled with checks.
    pub adapter: String,
    /// Its driver, with the version.
    pub driver: String,
    /// Whether the contract held there.
    pub verdict: Verdict,
    /// Median time of a frame of the original in the first view, in milliseconds.
    pub original_ms: f64,
    /// Median time of a frame of the choice there, in milliseconds.
    pub variant_ms: f64,
    /// Speedup there: its median between the ends of its confidence interval.
    pub speedup: [f64; 3],
}

/// A lock file that cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// What the file system says.
    #[error("{}: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why not.
        #[source]
        error: io::Error,
    },
    /// It is no lock file, or one with keys that this preshade does not know.
    #[error("{}: not a lock file that {TOOL} can read: {message}", path.display())]
    Syntax {
        /// The file, or nothing where a text was read.
        path: PathBuf,
        /// Where and why.
        message: String,
    },
    /// Another preshade wrote it, with keys or a schema that this one does not know.
    #[error("{}: written by another preshade ({by}), and this is {TOOL}: {message}", path.display())]
    Foreign {
        /// The file, or nothing where a text was read.
        path: PathBuf,
        /// Its schema, or who wrote it.
        by: String,
        /// What is not known.
        message: String,
    },
}

/// A lock does not fit what is there now.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Mismatch {
    /// It says nothing of the material.
    #[error("preshade.lock says nothing of `{material}`")]
    NoMaterial {
        /// The material.
        material: String,
    },
    /// Another preshade chose.
    #[error("preshade.lock was written by {locked}, and this is {TOOL}")]
    Tool {
        /// Who wrote it.
        locked: String,
    },
    /// There are other files than there were.
    #[error("preshade.lock was written for {locked}, not for {now}")]
    Files {
        /// Names of the files then.
        locked: String,
        /// Names of the files now.
        now: String,
    },
    /// A file was edited.
    #[error("{file} was edited after preshade.lock was written")]
    Source {
        /// Name of the file.
        file: String,
    },
    /// Another value of a definition, or none.
    #[error("preshade.lock was written with other definitions ({names})")]
    Defines {
        /// Names that differ.
        names: String,
    },
    /// Another entry point.
    #[error("preshade.lock was written for other entry points")]
    EntryPoints,
    /// Another pipeline state.
    #[error("preshade.lock was written for another pipeline state: {fields}")]
    State {
        /// Fields that differ, with what each was and is.
        fields: String,
    },
    /// A step does not apply any more.
    #[error("a step of preshade.lock no longer applies: {0}")]
    Refused(Box<Refusal>),
    /// The same recipe makes something else now.
    #[error("the recipe of preshade.lock makes other shaders than were measured")]
    Shaders,
    /// What it makes cannot be written.
    #[error(transparent)]
    Emit(#[from] emit::Error),
}

impl LockError {
    /// What kind of error it is, as messages have it in brackets; stable.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Io { .. } => "lock-file",
            Self::Syntax { .. } => "lock-syntax",
            Self::Foreign { .. } => "lock-foreign",
        }
    }
}

impl Mismatch {
    /// What kind of mismatch it is, as messages have it in brackets; stable.
    pub fn code(&self) -> &'static str {
        match self {
            Self::NoMaterial { .. } => "lock-material",
            Self::Tool { .. } => "lock-tool",
            Self::Files { .. } => "lock-files",
            Self::Source { .. } => "lock-source",
            Self::Defines { .. } => "lock-defines",
            Self::EntryPoints => "lock-entry-points",
            Self::State { .. } => "lock-state",
            Self::Refused(_) => "lock-step",
            Self::Shaders => "lock-shaders",
            Self::Emit(error) => error.code(),
        }
    }
}

impl Inputs {
    /// Of a material as it is read now.
    pub fn of(parsed: &front::Parsed, defines: &[(String, String)], state: &MaterialState) -> Self {
        let files = parsed.program.sources().files();
        let mut sources: Vec<HashedSource> = Vec::new();
        for file in files {
            let hashed = HashedSource::of(&file.name, &file.text);
            // Both stages may include one file.
            if !sources.contains(&hashed) {
                sources.push(hashed);
            }
        }
        Self {
            tool: TOOL.to_owned(),
            sources,
            defines: defines.iter().cloned().collect(),
            vertex: parsed.vertex.clone(),
            fragment: parsed.fragment.clone(),
            state: state.clone(),
        }
    }

    /// Whether both are of files of the same names.
    fn is_of_files(&self, other: &Self) -> bool {
        let names = |inputs: &Self| inputs.sources.iter().map(|s| s.file.clone()).collect();
        let (own, others): (Vec<String>, Vec<String>) = (names(self), names(other));
        own == others
    }

    fn files(&self) -> String {
        let names: Vec<&str> = self.sources.iter().map(|s| s.file.as_str()).collect();
        names.join(" and ")
    }

    /// The first thing in which `now` differs.
    fn difference(&self, now: &Self) -> Option<Mismatch> {
        if self.tool != now.tool {
            return Some(Mismatch::Tool {
                locked: self.tool.clone(),
            });
        }
        if !self.is_of_files(now) {
            return Some(Mismatch::Files {
                locked: self.files(),
                now: now.files(),
            });
        }
        let mut both = self.sources.iter().zip(&now.sources);
        if let Some((_, edited)) = both.find(|(then, now)| then != now) {
            return Some(Mismatch::Source {
                file: edited.file.clone(),
            });
        }
        if self.defines != now.defines {
            let names = self.defines.keys().chain(now.defines.keys());
            let mut names: Vec<&str> = names
                .filter(|n| self.defines.get(*n) != now.defines.get(*n))
                .map(String::as_str)
                .collect();
            names.sort_unstable();
            names.dedup();
            return Some(Mismatch::Defines {
                names: names.join(", "),
            });
        }
        if (&self.vertex, &self.fragment) != (&now.vertex, &now.fragment) {
            return Some(Mismatch::EntryPoints);
        }
        (self.state != now.state).then(|| Mismatch::State {
            fields: differing(&self.state, &now.state),
        })
    }
}

/// The fields of two states that differ: `multisample.count is 4, and was 1`.
fn differing(then: &MaterialState, now: &MaterialState) -> String {
    use serde_json::Value;
    fn walk(at: &str, then: &Value, now: &Value, out: &mut Vec<String>) {
        let below = |key: &str| match at {
            "" => key.to_owned(),
            _ => format!("{at}.{key}"),
        };
        match (then, now) {
            _ if then == now => {}
            (Value::Object(a), Value::Object(b)) => {
                let mut keys: Vec<&String> = a.keys().chain(b.keys()).collect();
                keys.sort_unstable();
                keys.dedup();
                let of = |all: &serde_json::Map<String, Value>, key: &String| {
                    all.get(key).cloned().unwrap_or(Value::Null)
                };
                for key in keys {
                    walk(&below(key), &of(a, key), &of(b, key), out);
                }
            }
            (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
                for (i, (a, b)) in a.iter().zip(b).enumerate() {
                    walk(&below(&i.to_string()), a, b, out);
                }
            }
            _ => out.push(format!("{at} is {now}, and was {then}")),
        }
    }
    // Plain data: serialising it cannot fail.
    let value = |state: &MaterialState| serde_json::to_value(state).unwrap_or_default();
    let mut out = Vec::new();
    walk("", &value(then), &value(now), &mut out);
    out.join("; ")
}

impl HashedSource {
    fn of(name: &str, text: &str) -> Self {
        let path = Path::new(name);
        let file = path.file_name().unwrap_or(path.as_os_str());
        Self {
            file: file.to_string_lossy().into_owned(),
            blake3: hash(&said(text)),
        }
    }
}

/// What a text says, whoever comments on it and whatever ends its lines: comments are one blank, blanks that end a line and lines of nothing else are gone. That it is the same is a hint: what
/// is shipped is what comes of it, which has a hash of its own. (Comments nest, as WGSL's do and GLSL's do not.)
fn said(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut depth = 0_u32;
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let (opens, closes) = (rest.starts_with("/*"), rest.starts_with("*/"));
        let mut length = c.len_utf8();
        if opens {
            (depth, length) = (depth + 1, 2);
        } else if closes && depth > 0 {
            (depth, length) = (depth - 1, 2);
            plain.push(' ');
        } else if depth == 0 && rest.starts_with("//") {
            length = rest.find(['\n', '\r']).unwrap_or(rest.len());
        } else if depth == 0 || c == '\n' {
            plain.push(c);
        }
        rest = &rest[length..];
    }
    let lines = plain.split(['\r', '\n']).map(str::trim_end);
    let lines: Vec<&str> = lines.filter(|line| !line.is_empty()).collect();
    lines.join("\n")
}

fn hash(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

impl Locked {
    /// Applies `recipe` and keeps it with the sites and parameters that it came to.
    ///
    /// `facts` is what the recipe was measured under; a recipe that rests on measured thresholds has to be written out first (`measure::written_out`), since what is kept here has no
    /// frequencies.
    ///
    /// # Errors
    /// [`Mismatch::Refused`], or [`Mismatch::Emit`] where the result cannot be written as WGSL.
    pub fn resolve(
        original: &Plan,
        recipe: &Recipe,
        facts: &Facts,
        inputs: Inputs,
        measured: Option<Measured>,
    ) -> Result<Self, Mismatch> {
        let facts = about(&original.material, facts);
        let plan = recipe.apply(original, &facts).map_err(Mismatch::Refused)?;
        Ok(Self {
            recipe: resolved(&plan),
            shaders: hash_shaders(&plan)?,
            inputs,
            facts,
            measured,
        })
    }

    /// Makes the plan that was chosen.
    ///
    /// # Errors
    /// A step no longer applies, or the shaders that come of it are not those that were measured.
    pub fn apply(&self, original: &Plan) -> Result<Plan, Mismatch> {
        let plan = self.recipe.apply(original, &self.facts);
        let plan = plan.map_err(Mismatch::Refused)?;
        match hash_shaders(&plan)? == self.shaders {
            true => Ok(plan),
            false => Err(Mismatch::Shaders),
        }
    }
}

/// The steps of a plan as a recipe that finds the same sites again.
fn resolved(plan: &Plan) -> Recipe {
    let step = |step: &preshade_passes::plan::Step| {
        let params = step.params.as_object().cloned().unwrap_or_default();
        Step {
            pass: step.pass.clone(),
            params: params.into_iter().filter(|(_, v)| !v.is_null()).collect(),
            site: Some(step.site.clone()),
        }
    };
    Recipe {
        steps: plan.steps.iter().map(step).collect(),
    }
}

/// What of `facts` a lock keeps for a material: nothing of the others, and no frequencies.
fn about(material: &str, facts: &Facts) -> Facts {
    // Every field by name: what is added to the facts has to say here whose it is.
    let Facts {
        depth_ties,
        undiscarded_depth_ties,
        near_plane_pixels,
        vertices_per_fragment,
        changing,
        ranges,
        constants,
        frequencies: _,
        rasterizer,
    } = facts;
    Facts {
        depth_ties: *depth_ties,
        undiscarded_depth_ties: *undiscarded_depth_ties,
        near_plane_pixels: *near_plane_pixels,
        vertices_per_fragment: *vertices_per_fragment,
        changing: changing
            .as_ref()
            .map(|all| own(all, |c| c.material == material)),
        ranges: own(ranges, |r| r.material == material),
        constants: own(constants, |c| c.material == material),
        frequencies: Vec::new(),
        rasterizer: *rasterizer,
    }
}

fn own<T: Clone>(all: &[T], is_own: impl Fn(&T) -> bool) -> Vec<T> {
    all.iter().filter(|one| is_own(one)).cloned().collect()
}

/// Hash of the WGSL of a plan, in the order of its programs, as [`said`].
fn hash_shaders(plan: &Plan) -> Result<String, emit::Error> {
    let files = emit::emit(plan, &[Target::Wgsl], &emit::Options::default())?;
    let mut text = String::new();
    for file in files.iter().filter(|f| f.name.ends_with(".wgsl")) {
        text.push_str(&file.name);
        text.push('\n');
        text.push_str(&said(&String::from_utf8_lossy(&file.bytes)));
        text.push('\n');
    }
    Ok(hash(&text))
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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic)]

    use preshade_passes::guard::{Assumed, Bounds, Place, ScalarType};
    use preshade_passes::pass::Constant;

    use super::*;

    const TEXT: &str = "@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }\n\
        @fragment fn fs() -> @location(0) vec4<f32> { return vec4<f32>(1.0); }\n";

    fn sources(text: &str) -> [front::Source; 1] {
        [front::Source::new("shaders/lit.wgsl", text)]
    }

    fn original(text: &str) -> Plan {
        let parsed = front::parse(&sources(text), &front::Options::default()).unwrap();
        let (vertex, fragment) = (parsed.vertex, parsed.fragment);
        let state = MaterialState::default();
        Plan::original("lit", parsed.program, &vertex, fragment.as_deref(), &state)
    }

    fn inputs(text: &str) -> Inputs {
        let parsed = front::parse(&sources(text), &front::Options::default()).unwrap();
        Inputs::of(&parsed, &[], &MaterialState::default())
    }

    fn locked() -> Lock {
        let recipe = Recipe::parse(["shadow", "depth-prepass:form=equal"]).unwrap();
        let facts = Facts::without_ties();
        let locked = Locked::resolve(&original(TEXT), &recipe, &facts, inputs(TEXT), None).unwrap();
        Lock {
            materials: BTreeMap::from([("lit".to_owned(), locked)]),
            ..Lock::default()
        }
    }

    #[test]
    fn what_is_written_is_read_and_obeyed() {
        let lock = Lock::parse(&locked().to_json()).unwrap();
        assert_eq!(lock, locked());
        let chosen = lock.check("lit", &inputs(TEXT)).unwrap();
        assert!(chosen.recipe.steps.iter().all(|s| s.site.is_some()));
        let plan = chosen.apply(&original(TEXT)).unwrap();
        let roles: Vec<&str> = plan.passes.iter().map(|p| p.role.name()).collect();
        assert_eq!(roles, ["prepass", "shadow", "main"]);
    }

    #[test]
    fn comments_and_line_endings_do_not_count() {
        let lock = locked();
        for text in [
            TEXT.replace('\n', "\r\n"),
            TEXT.replace('\n', "\r\r\n"),
            format!("// what it is\n\n/* of /* whom */ */\n{TEXT}\r// c"),
            TEXT.replace(" }\n", " } // as it is  \n\n\t \n"),
        ] {
            let chosen = lock.check("lit", &inputs(&text)).unwrap();
            assert!(chosen.apply(&original(&text)).is_ok(), "{text}");
        }
        let within = TEXT.replace("1.0", "1.0 /* and 2.0 */ + 1.0");
        assert!(lock.check("lit", &inputs(&within)).is_err());
    }

    #[test]
    fn a_lock_of_another_preshade_is_told_from_garbage() {
        let text = locked().to_json();
        let later = text.replace("preshade.lock.v1", "preshade.lock.v2");
        let said = Lock::parse(&later).unwrap_err();
        assert!(matches!(said, LockError::Foreign { .. }), "{said}");
        let more = text.replace("\"shaders\"", "\"more\": 1, \"shaders\"");
        let said = Lock::parse(&more.replace(TOOL, "preshade 9.0.0")).unwrap_err();
        assert!(said.to_string().contains("preshade 9.0.0"), "{said}");
        let said = Lock::parse(&more).unwrap_err();
        assert!(matches!(said, LockError::Syntax { .. }), "{said}");
    }

    #[test]
    fn each_difference_is_told_by_name() {
        let lock = locked();
        let with = |change: &dyn Fn(&mut Inputs)| {
            let mut now = inputs(TEXT);
            change(&mut now);
            lock.check("lit", &now).unwrap_err()
        };
        assert!(matches!(
            lock.check("toon", &inputs(TEXT)).unwrap_err(),
            Mismatch::NoMaterial { .. }
        ));
        let edited = lock
            .check("lit", &inputs(&TEXT.replace("1.0", "0.5")))
            .unwrap_err();
        assert_eq!(
            edited.to_string(),
            "lit.wgsl was edited after preshade.lock was written"
        );
        let defines = with(&|now| {
            now.defines.insert("FOG".to_owned(), "1".to_owned());
        });
        assert_eq!(
            defines.to_string(),
            "preshade.lock was written with other definitions (FOG)"
        );
        let state = with(&|now| {
            now.state.depth_write = false;
            now.state.multisample.count = 4;
        });
        assert_eq!(
            state.to_string(),
            "preshade.lock was written for another pipeline state: depth_write is false, and was true; multisample.count is 4, and was 1"
        );
        assert_eq!(
            with(&|now| now.vertex = "vs_main".to_owned()),
            Mismatch::EntryPoints
        );
        let mut older = locked();
        let of_lit = older.materials.get_mut("lit").unwrap();
        of_lit.inputs.tool = "preshade 0.0.9".to_owned();
        let said = older.check("lit", &inputs(TEXT)).unwrap_err().to_string();
        assert!(said.contains("preshade 0.0.9"), "{said}");
    }

    #[test]
    fn other_shaders_than_were_measured_are_not_shipped() {
        let mut lock = locked();
        let of_lit = lock.materials.get_mut("lit").unwrap();
        of_lit.shaders = hash("another");
        assert_eq!(
            of_lit.apply(&original(TEXT)).unwrap_err(),
            Mismatch::Shaders
        );
        of_lit.facts.depth_ties = Some(1);
        let refused = of_lit.apply(&original(TEXT)).unwrap_err();
        assert!(matches!(refused, Mismatch::Refused(_)), "{refused}");
    }

    #[test]
    fn nothing_is_kept_of_other_materials() {
        let of = |material: &str| Constant {
            material: material.to_owned(),
            value: Assumed {
                name: "fog".to_owned(),
                place: Place::Override {
                    name: "fog".to_owned(),
                },
                ty: ScalarType::F32,
                bounds: Bounds::one(0.5),
            },
        };
        let facts = Facts {
            constants: vec![of("lit"), of("toon")],
            ..Facts::default()
        };
        let recipe = Recipe::default();
        let locked = Locked::resolve(&original(TEXT), &recipe, &facts, inputs(TEXT), None).unwrap();
        assert_eq!(locked.facts.constants, [of("lit")]);
    }

    #[test]
    fn a_key_that_is_not_known_is_an_error() {
        let text = locked().to_json().replace("\"shaders\"", "\"shader\"");
        let said = Lock::parse(&text).unwrap_err().to_string();
        assert!(said.contains("unknown field `shader`"), "{said}");
    }
}
