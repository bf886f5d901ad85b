//! Compiles materials in a `build.rs`. It needs no GPU and no installation, and writes the same
//! bytes on every machine.
//!
//! ```no_run
//! // build.rs
//! fn main() -> Result<(), preshade_compiler::build_script::BuildError> {
//!     preshade_compiler::build_script::configure().pass("depth-prepass").compile("shaders/lit.wgsl")
//! }
//! ```
//!
//! ```ignore
//! // src/main.rs: the generated code depends only on wgpu 30.
//! mod lit {
//!     preshade::include_variant!("lit");
//! }
//! let pipeline = lit::MAIN.pipeline(&device, &[lit::INTERLEAVED])?;
//! ```
//!
//! The module `lit` contains the module `original` and the variant. Each has its passes (`PASSES`,
//! and by role `MAIN`, `PREPASS` and so on), attachments, self-test, files and its whole plan. The
//! variant's names are also the module's own. A [`BuildConfig::variant`] has its own module.
//!
//! A specialised variant is only valid for some values. `GUARD` lists them, `guard_holds` checks a
//! draw's uniforms and the pipelines' constants, and `variant_for` returns the variant or the
//! original. You reach the variant's passes only through `variant_for` and `CHOICES`, which lists
//! all that it may return. `CONSTANTS` are the pipeline-overridable constants that the variant was
//! made for; give them to the original's pipelines too. If the material's own variant has a guard,
//! the module's names are the original's, except for these five.
//!
//! For each material, the build chooses in this order:
//!
//! 1. If `preshade.lock` beside the shader has an entry, the build uses it
//!    ([`crate::lock`]). If the entry does not match the shader, the
//!    build warns and ships the original.
//! 2. Otherwise it applies the passes that you request. A step that needs a scene is skipped with a
//!    warning: its contract has an error budget, say, or assumes that no depths tie.
//! 3. If you request nothing, it makes `depth_prepass`, `early_discard` and `shadow` in their forms
//!    that need no scene, each as a module beside the original.
//!
//! Names do not depend on refusals: a variant whose steps are all refused draws the original.
//!
//! Files go to `OUT_DIR`, and are only written if their bytes change. A material is not compiled
//! again if its files, options and lock did not change. Cargo only watches the files that were
//! read. A `preshade.lock` that does not exist yet is not watched, so touch the build script after
//! you create the first one.
//!
//! A dev profile compiles build scripts, and preshade with them, without optimisation. Leave it so:
//! a material takes about 15 ms, and an optimised preshade takes far longer to compile.

mod bindings;
mod choose;
mod emitted;
mod error;
mod generate;
#[cfg(test)]
#[allow(dead_code)]
mod host;
mod names;
mod passes;
mod stamp;
#[cfg(test)]
mod tests;
mod wgpu_words;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use bindings::BindingSettings;
use choose::Keeping;
use emitted::EmittedPlan;
pub use error::BuildError;
use preshade_plan::state::MaterialState;
use stamp::Trace;

use crate::front;
use crate::lock::{Left, Lock, LockError};
use crate::recipe::Recipe;
use preshade_plan::plan_file::Target;
use shader_text::files::File;
use shader_text::options;
use shader_text::read_limited::ReadError;

/// The options of a build: see the module.
#[must_use]
pub fn configure() -> BuildConfig {
    BuildConfig::default()
}

/// `configure().compile(shader)`.
///
/// # Errors
/// As [`BuildConfig::compile`].
pub fn compile(shader: impl AsRef<Path>) -> Result<(), BuildError> {
    configure().compile(shader)
}

/// The files of a material's module.
#[derive(Clone, Debug, Default)]
pub struct BuildConfig {
    passes: Vec<String>,
    variants: Vec<(String, Vec<String>)>,
    name: Option<String>,
    state: Option<MaterialState>,
    options: options::Options,
    targets: Vec<Target>,
    lock: Option<PathBuf>,
    types: Option<String>,
    wgpu: Option<String>,
    said: BindingSettings,
    out_dir: Option<PathBuf>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Built {
    /// The module's file, in the folder for output.
    pub module: PathBuf,
    /// Files that the build depends on.
    pub read: Vec<PathBuf>,
    /// Requested things that the module lacks, one a line.
    pub warnings: Vec<String>,
    /// Files whose bytes changed.
    pub written: Vec<PathBuf>,
}

impl BuildConfig {
    /// Adds a pass to the recipe of the material's variant, in the words of the command line:
    /// `depth-prepass`, `early-discard:texture=float`. A lock with an entry for the material takes
    /// precedence.
    #[must_use]
    pub fn pass(mut self, step: impl Into<String>) -> Self {
        self.passes.push(step.into());
        self
    }

    /// Adds a variant of these passes, in the module `name`.
    #[must_use]
    pub fn variant<S: Into<String>>(
        mut self,
        name: impl Into<String>,
        steps: impl IntoIterator<Item = S>,
    ) -> Self {
        let steps = steps.into_iter().map(Into::into).collect();
        self.variants.push((name.into(), steps));
        self
    }

    /// Name of the material and of its module's file. Default: the shader file's, without endings.
    #[must_use]
    pub fn name(mut self, name: impl Into<String>) -> Self {
        self.name = Some(name.into());
        self
    }

    /// Pipeline state of the material. Default: the lock's, or [`MaterialState::default`].
    #[must_use]
    pub fn state(mut self, state: MaterialState) -> Self {
        self.state = Some(state);
        self
    }

    /// Vertex entry point, if there are several.
    #[must_use]
    pub fn vertex(mut self, entry_point: impl Into<String>) -> Self {
        self.options.vertex = Some(entry_point.into());
        self
    }

    /// Fragment entry point, if there are several.
    #[must_use]
    pub fn fragment(mut self, entry_point: impl Into<String>) -> Self {
        self.options.fragment = Some(entry_point.into());
        self
    }

    /// A definition for the preprocessor of GLSL.
    #[must_use]
    pub fn define(mut self, name: impl Into<String>, value: impl Into<String>) -> Self {
        self.options.defines.push((name.into(), value.into()));
        self
    }

    /// A folder in which `#include` of GLSL is looked up, after the including file's own.
    #[must_use]
    pub fn include(mut self, folder: impl Into<PathBuf>) -> Self {
        self.options.include.push(folder.into());
        self
    }

    /// The clip space of GLSL positions. Default: the dialect's.
    #[must_use]
    pub fn clip_space(mut self, clip_space: options::ClipSpace) -> Self {
        self.options.clip_space = Some(clip_space);
        self
    }

    /// Also writes this target, in addition to WGSL, into `FILES`. If it cannot express a material,
    /// the build warns.
    #[must_use]
    pub fn emit(mut self, target: Target) -> Self {
        self.targets.push(target);
        self
    }

    /// The lock file. Default: `preshade.lock` beside the shader, if it exists.
    #[must_use]
    pub fn lock(mut self, path: impl Into<PathBuf>) -> Self {
        self.lock = Some(path.into());
        self
    }

    /// Uses `Pass` and the other types of the generated module at this path, for example
    /// `preshade::lit`, so that the same code can draw several materials.
    #[must_use]
    pub fn types(mut self, module: impl Into<String>) -> Self {
        self.types = Some(module.into());
        self
    }

    /// Path of wgpu 30, if it is not the crate `wgpu`: for example `eframe::wgpu` or
    /// `preshade::gfx::wgpu`.
    #[must_use]
    pub fn wgpu(mut self, path: impl Into<String>) -> Self {
        self.wgpu = Some(path.into());
        self
    }

    /// Gives the author's buffer at this binding a dynamic offset.
    #[must_use]
    pub fn dynamic_offset(mut self, group: u32, binding: u32) -> Self {
        self.said.dynamic.insert((group, binding));
        self
    }

    /// Marks the author's texture at this binding as unfilterable (`r32float`, for example), or the
    /// sampler as non-filtering.
    #[must_use]
    pub fn unfilterable(mut self, group: u32, binding: u32) -> Self {
        self.said.unfilterable.insert((group, binding));
        self
    }

    /// Folder for output. Default: cargo's `OUT_DIR`, the only folder that `include_variant!`
    /// reads.
    #[must_use]
    pub fn out_dir(mut self, path: impl Into<PathBuf>) -> Self {
        self.out_dir = Some(path.into());
        self
    }

    /// Compiles a material of one file, and prints instructions for cargo.
    ///
    /// # Errors
    /// The shader, the lock file or a recipe cannot be read, or the files cannot be written. A
    /// refused pass is only a warning.
    pub fn compile(&self, shader: impl AsRef<Path>) -> Result<(), BuildError> {
        self.print_watched(&[shader.as_ref()])
    }

    /// Compiles a material of a vertex and a fragment file.
    ///
    /// # Errors
    /// As [`BuildConfig::compile`].
    pub fn compile_stages(
        &self,
        vertex: impl AsRef<Path>,
        fragment: impl AsRef<Path>,
    ) -> Result<(), BuildError> {
        self.print_watched(&[vertex.as_ref(), fragment.as_ref()])
    }

    /// Refuses a second material of the same name, since its module would overwrite the first.
    fn claim(&self, files: &[&Path]) -> Result<(), BuildError> {
        /// Modules that this process compiled, with their files and options.
        static CLAIMED: Mutex<BTreeMap<PathBuf, (String, String)>> = Mutex::new(BTreeMap::new());
        let name = self.material(files)?;
        // Some file systems ignore case.
        let module = self
            .output_folder()?
            .join(format!("{}.rs", name.to_lowercase()));
        let shown: Vec<String> = files.iter().map(|f| slashes(f)).collect();
        let second = shown.join(" and ");
        let mut claimed = CLAIMED.lock().unwrap_or_else(PoisonError::into_inner);
        let own = (second.clone(), format!("{self:?}"));
        match claimed.entry(module).or_insert_with(|| own.clone()) {
            one if *one == own => Ok(()),
            (first, _) => Err(BuildError::Taken {
                name,
                first: first.clone(),
                second,
            }),
        }
    }

    fn output_folder(&self) -> Result<PathBuf, BuildError> {
        match &self.out_dir {
            Some(folder) => Ok(folder.clone()),
            None => std::env::var_os("OUT_DIR")
                .map(PathBuf::from)
                .ok_or(BuildError::NoOutDir),
        }
    }

    fn print_watched(&self, files: &[&Path]) -> Result<(), BuildError> {
        // Also on failure: an edited file must run the build again.
        for file in files {
            println!("cargo::rerun-if-changed={}", file.display());
        }
        self.claim(files)?;
        let built = self.build(files)?;
        for file in built.read.iter().filter(|f| !files.contains(&f.as_path())) {
            println!("cargo::rerun-if-changed={}", file.display());
        }
        for warning in &built.warnings {
            println!("cargo::warning={warning}");
        }
        Ok(())
    }

    /// Compiles a material of one file or two without printing, for build systems other than cargo.
    /// Materials of the same name overwrite each other.
    ///
    /// # Errors
    /// As [`BuildConfig::compile`].
    pub fn build(&self, files: &[&Path]) -> Result<Built, BuildError> {
        let out = self.output_folder()?;
        let name = self.material(files)?;
        let sources = files
            .iter()
            .map(|file| read(file))
            .collect::<Result<Vec<_>, _>>()?;
        let beside = files.first().map(|f| Lock::path_beside(f));
        let lock_path = self.lock.clone().or(beside).unwrap_or_default();
        let lock_text = match std::fs::read_to_string(&lock_path) {
            Ok(text) => Some(text),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound && self.lock.is_none() => None,
            Err(error) => {
                return Err(BuildError::Read {
                    path: lock_path,
                    error,
                });
            }
        };
        let mut read: Vec<PathBuf> = files.iter().map(|f| f.to_path_buf()).collect();
        read.extend(lock_text.is_some().then(|| lock_path.clone()));

        let module = out.join(format!("{name}.rs"));
        let folder = out.join(&name);
        let key = stamp::key(self, &name, files, &sources, lock_text.as_deref());
        if let Some(kept) = stamp::still_holds(&folder, &key, &out) {
            read.extend(kept.included);
            return Ok(Built {
                module,
                read,
                warnings: kept.warnings,
                written: Vec::new(),
            });
        }
        let lock = lock_text
            .as_deref()
            .map(|text| (text, Lock::parse_for(text, &lock_path, &name)));
        let lock = match lock {
            None => Keeping::Nothing,
            Some((_, Ok(lock))) => Keeping::Own(lock),
            Some((text, Err(error @ LockError::Foreign { .. }))) => {
                Keeping::Foreign(error, Left::of(text, &name))
            }
            Some((_, Err(error))) => return Err(BuildError::Lock(error)),
        };
        let made = self.make(&name, &sources, &lock)?;
        read.extend(made.trace.included());
        let mut written = Vec::new();
        let mut hashes = Vec::new();
        let root = [File {
            name: format!("{name}.rs"),
            bytes: made.module.into_bytes(),
        }];
        let folders = made
            .files
            .iter()
            .map(|(variant, files)| (folder.join(variant), files.as_slice()));
        for (folder, files) in folders.chain([(out.clone(), root.as_slice())]) {
            let failed = |error| BuildError::Write {
                path: folder.clone(),
                error,
            };
            written.extend(shader_text::files::write(&folder, files).map_err(failed)?);
            let below = folder.strip_prefix(&out).unwrap_or(&folder).to_owned();
            hashes.extend(files.iter().map(|f| stamp::hashed(&below, f)));
        }
        stamp::sweep(&folder, &out, &hashes);
        // Last, so that an interrupted build is repeated.
        stamp::write(&folder, &key, &made.trace, hashes).map_err(|error| BuildError::Write {
            path: folder,
            error,
        })?;
        Ok(Built {
            module,
            read,
            warnings: made.trace.warnings,
            written,
        })
    }

    fn material(&self, files: &[&Path]) -> Result<String, BuildError> {
        let stem = files.first().and_then(|f| f.file_stem());
        let stem = stem.map(|s| s.to_string_lossy().into_owned());
        let name = self.name.clone().or_else(|| {
            let stem = stem?;
            let stages = [".vert", ".frag", ".vs", ".fs"];
            let bare = stages.iter().find_map(|s| stem.strip_suffix(s));
            Some(bare.unwrap_or(&stem).to_owned())
        });
        match name {
            Some(name) if shader_text::files::is_material_name(&name) => Ok(name),
            name => Err(BuildError::Name(name.unwrap_or_default())),
        }
    }

    /// The module and the files of each variant.
    fn make(
        &self,
        name: &str,
        sources: &[front::Source],
        lock: &Keeping,
    ) -> Result<MadeModule, BuildError> {
        let mut trace = Trace::default();
        let mut drawn = choose::choose(self, name, sources, lock, &mut trace)?;
        let module = generate::Module {
            types: self.types.as_deref(),
            wgpu: self.wgpu.as_deref(),
            said: &self.said,
        };
        Ok(MadeModule {
            module: worded(name, &mut drawn, &module, sources, &mut trace.warnings)?,
            files: drawn.into_iter().map(|d| (d.name, d.files)).collect(),
            trace,
        })
    }

    fn recipes(&self) -> Result<Asked, BuildError> {
        if self.passes.is_empty() && self.variants.is_empty() {
            let named = choose::BY_DEFAULT.iter().map(|(name, pass)| {
                let recipe = Recipe::parse([pass])?;
                Ok(((*name).to_owned(), recipe))
            });
            return Ok(Asked {
                own: None,
                named: named.collect::<Result<_, BuildError>>()?,
                is_default: true,
            });
        }
        let own = match self.passes.is_empty() {
            true => None,
            false => Some(Recipe::parse(&self.passes)?),
        };
        let mut taken = BTreeSet::new();
        let named = self.variants.iter().map(|(name, steps)| {
            if !names::is_a_modules(name) {
                return Err(BuildError::Name(name.clone()));
            }
            if !taken.insert(name) {
                return Err(BuildError::Twice(name.clone()));
            }
            Ok((name.clone(), Recipe::parse(steps)?))
        });
        Ok(Asked {
            own,
            named: named.collect::<Result<_, BuildError>>()?,
            is_default: false,
        })
    }
}

struct Asked {
    /// The material's own variant, if there is one.
    own: Option<Recipe>,
    named: Vec<(String, Recipe)>,
    /// Nothing was requested: these are the defaults.
    is_default: bool,
}

struct MadeModule {
    module: String,
    files: Vec<(String, Vec<File>)>,
    trace: Trace,
}

/// The module's text. A variant that it cannot express is reported and replaced by the original.
fn worded(
    name: &str,
    drawn: &mut [EmittedPlan],
    module: &generate::Module<'_>,
    sources: &[front::Source],
    warnings: &mut Vec<String>,
) -> Result<String, BuildError> {
    loop {
        let wordless = match generate::material(name, drawn, module) {
            Ok(module) => return Ok(module),
            Err(wordless) => wordless,
        };
        let amiss = wordless.of.and_then(|of| {
            let (original, variants) = drawn.split_first_mut()?;
            Some((original, variants.get_mut(of.checked_sub(1)?)?))
        });
        match amiss {
            Some((original, variant)) if !variant.plan.steps.is_empty() => {
                choose::give_up(variant, original, &wordless.why, sources, warnings);
            }
            _ => {
                return Err(BuildError::Module {
                    file: sources.first().map_or(String::new(), |s| s.name.clone()),
                    why: wordless.why,
                });
            }
        }
    }
}

fn read(path: &Path) -> Result<front::Source, BuildError> {
    let read = std::fs::read(path).map_err(ReadError::from);
    let read = read.and_then(|bytes| front::Source::from_bytes(slashes(path), bytes));
    read.map_err(|error| BuildError::Read {
        path: path.to_owned(),
        error: error.into(),
    })
}

/// A path with `/` on every machine, for messages and generated files.
fn slashes(path: &Path) -> String {
    path.display().to_string().replace('\\', "/")
}
