//! Variants made by a `build.rs`: no GPU, nothing to install, the same bytes on every machine.
//!
//! ```no_run
//! // build.rs
//! fn main() -> Result<(), preshade::build_script::Error> {
//!     preshade::configure().pass("depth-prepass").compile("shaders/lit.wgsl")
//! }
//! ```
//!
//! ```ignore
//! // src/main.rs: wgpu 30 is all that the generated code needs.
//! mod lit {
//!     preshade::include_variant!("lit");
//! }
//! let pipeline = lit::MAIN.pipeline(&device, &[lit::INTERLEAVED])?;
//! ```
//!
//! The module `lit` has `original` and the variant, each with its passes (`PASSES`, and `MAIN`, `PREPASS` and so on by role), attachments, self-test, files and whole plan; the variant's names
//! are the module's own. A [`Builder::variant`] has a module of its own.
//!
//! A specialised variant holds for some values alone. Its `GUARD` says which, `guard_holds` looks at a draw's uniforms and at what the pipelines have for constants, and `variant_for` gives it or the
//! original; its passes are had in no other way but `CHOICES`, which is all that `variant_for` may give. `CONSTANTS` are the pipeline-overridable ones that it was made for, which the original's
//! pipelines then need too. Where the material's own variant is such a one, the module's names are the original's, but for these five.
//!
//! What is made, for each material:
//!
//! 1. Where `preshade.lock` beside the shader names it, what is kept there ([`crate::lock`]): chosen on a scene, by a developer's adapter. Where the lock does not fit the shader any
//!    more the build warns and ships the original.
//! 2. Otherwise the passes asked for, as far as they need no scene: what promises no more than a budget, or rests on what only a scene shows (that no depths tie, say), is told as a warning and left out.
//! 3. Where none is asked for, `depth_prepass`, `early_discard` and `shadow`, in their forms that need no scene, each as a module beside the original.
//!
//! Names do not depend on what was refused: a variant of which every step is refused draws the original.
//!
//! Files go to `OUT_DIR` alone, and only where their bytes differ. A material whose files, options and lock are as they were at the last run is not compiled again.
//! Cargo is told of the files that were read and of no others; a `preshade.lock` that is not there yet is none of them, so touch the build script after the first.
//!
//! A dev profile compiles build scripts without optimisation, preshade and naga with them. That is well so: a material takes some 15 ms of it, and an optimised preshade far longer to compile.

mod bindings;
mod choose;
mod error;
mod generate;
#[cfg(all(test, feature = "verify"))]
#[allow(dead_code)]
mod host;
mod names;
mod stamp;
mod wgpu_words;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use preshade_passes::state::MaterialState;

use crate::emit::{self, File, Target};
use crate::front;
use crate::lock::{Left, Lock, LockError};
use crate::recipe::Recipe;

use bindings::Said;
use choose::Keeping;
use generate::Drawn;
use stamp::Trace;

pub use error::Error;

/// A build of a material with its options: see the module.
#[must_use]
pub fn configure() -> Builder {
    Builder::default()
}

/// `configure().compile(shader)`.
///
/// # Errors
/// As [`Builder::compile`].
pub fn compile(shader: impl AsRef<Path>) -> Result<(), Error> {
    configure().compile(shader)
}

/// What a material is made into.
#[derive(Clone, Debug, Default)]
pub struct Builder {
    passes: Vec<String>,
    variants: Vec<(String, Vec<String>)>,
    name: Option<String>,
    state: Option<MaterialState>,
    options: front::Options,
    targets: Vec<Target>,
    lock: Option<PathBuf>,
    types: Option<String>,
    wgpu: Option<String>,
    said: Said,
    out_dir: Option<PathBuf>,
}

/// What a build came to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Built {
    /// The module, in the folder for output.
    pub module: PathBuf,
    /// Files that the build rests on.
    pub read: Vec<PathBuf>,
    /// What was asked for and is not in the module, in a line each.
    pub warnings: Vec<String>,
    /// Files whose bytes changed.
    pub written: Vec<PathBuf>,
}

impl Builder {
    /// Adds a pass to the recipe of the material's variant, in the words of the command line: `depth-prepass`, `early-discard:texture=float`. A lock that names the material goes before it.
    #[must_use]
    pub fn pass(mut self, step: impl Into<String>) -> Self {
        self.passes.push(step.into());
        self
    }

    /// Adds a variant in a module of its own, `name`, of these passes.
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

    /// Name of the material and of its module's file; the default is the shader file's, without endings.
    #[must_use]
    pub fn name(mut self, name: impl Into<String>) -> Self {
        self.name = Some(name.into());
        self
    }

    /// The state that the material is drawn with. The default is the lock's, or [`MaterialState::default`].
    #[must_use]
    pub fn state(mut self, state: MaterialState) -> Self {
        self.state = Some(state);
        self
    }

    /// Vertex entry point, where there are several.
    #[must_use]
    pub fn vertex(mut self, entry_point: impl Into<String>) -> Self {
        self.options.vertex = Some(entry_point.into());
        self
    }

    /// Fragment entry point, where there are several.
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

    /// The clip space that GLSL positions are written for; the default goes by the dialect.
    #[must_use]
    pub fn clip_space(mut self, clip_space: front::ClipSpace) -> Self {
        self.options.clip_space = Some(clip_space);
        self
    }

    /// Writes this target beside WGSL, which is always written: the files are in `FILES`. One that cannot say what a material does is told as a warning.
    #[must_use]
    pub fn emit(mut self, target: Target) -> Self {
        self.targets.push(target);
        self
    }

    /// The lock file; the default is `preshade.lock` beside the shader, if it is there.
    #[must_use]
    pub fn lock(mut self, path: impl Into<PathBuf>) -> Self {
        self.lock = Some(path.into());
        self
    }

    /// Takes `Pass` and the other types from the generated module at this path, `crate::lit` say, in place of having its own: for a host that draws several materials by one piece of code.
    #[must_use]
    pub fn types(mut self, module: impl Into<String>) -> Self {
        self.types = Some(module.into());
        self
    }

    /// Where the generated module finds wgpu 30, if not as the crate `wgpu`: `eframe::wgpu`, `crate::gfx::wgpu`.
    #[must_use]
    pub fn wgpu(mut self, path: impl Into<String>) -> Self {
        self.wgpu = Some(path.into());
        self
    }

    /// The buffer of the author's that is bound there has a dynamic offset.
    #[must_use]
    pub fn dynamic_offset(mut self, group: u32, binding: u32) -> Self {
        self.said.dynamic.insert((group, binding));
        self
    }

    /// The texture of the author's that is bound there is of a format that cannot be filtered (`r32float`, say), or the sampler there filters nothing.
    #[must_use]
    pub fn unfilterable(mut self, group: u32, binding: u32) -> Self {
        self.said.unfilterable.insert((group, binding));
        self
    }

    /// Folder for output; the default is cargo's `OUT_DIR`, and `include_variant!` looks nowhere else.
    #[must_use]
    pub fn out_dir(mut self, path: impl Into<PathBuf>) -> Self {
        self.out_dir = Some(path.into());
        self
    }

    /// Compiles a material of one file, and tells cargo what it needs to know.
    ///
    /// # Errors
    /// The shader, the lock file or a recipe cannot be read, or the files cannot be written. That a pass does not apply is a warning.
    pub fn compile(&self, shader: impl AsRef<Path>) -> Result<(), Error> {
        self.tell(&[shader.as_ref()])
    }

    /// As [`Builder::compile`], of a vertex and a fragment file.
    ///
    /// # Errors
    /// As [`Builder::compile`].
    pub fn compile_stages(
        &self,
        vertex: impl AsRef<Path>,
        fragment: impl AsRef<Path>,
    ) -> Result<(), Error> {
        self.tell(&[vertex.as_ref(), fragment.as_ref()])
    }

    /// Refuses a second material of one name, which would take the place of the first's module in every run.
    fn claim(&self, files: &[&Path]) -> Result<(), Error> {
        /// Modules that this process compiled: of which files, and how.
        static CLAIMED: Mutex<BTreeMap<PathBuf, (String, String)>> = Mutex::new(BTreeMap::new());
        let name = self.material(files)?;
        // Not all file systems tell capitals from small letters.
        let module = self
            .output_folder()?
            .join(format!("{}.rs", name.to_lowercase()));
        let shown: Vec<String> = files.iter().map(|f| slashes(f)).collect();
        let second = shown.join(" and ");
        let mut claimed = CLAIMED.lock().unwrap_or_else(PoisonError::into_inner);
        let own = (second.clone(), format!("{self:?}"));
        match claimed.entry(module).or_insert_with(|| own.clone()) {
            one if *one == own => Ok(()),
            (first, _) => Err(Error::Taken {
                name,
                first: first.clone(),
                second,
            }),
        }
    }

    fn output_folder(&self) -> Result<PathBuf, Error> {
        match &self.out_dir {
            Some(folder) => Ok(folder.clone()),
            None => std::env::var_os("OUT_DIR")
                .map(PathBuf::from)
                .ok_or(Error::NoOutDir),
        }
    }

    fn tell(&self, files: &[&Path]) -> Result<(), Error> {
        // Also where it fails: mending a file must run the build again.
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

    /// Compiles a material of one file or two and prints nothing: for build systems other than cargo. Materials of one name in one folder take each other's place.
    ///
    /// # Errors
    /// As [`Builder::compile`].
    pub fn build(&self, files: &[&Path]) -> Result<Built, Error> {
        let out = self.output_folder()?;
        let name = self.material(files)?;
        let texts = files
            .iter()
            .map(|file| read(file))
            .collect::<Result<Vec<_>, _>>()?;
        let beside = files.first().map(|f| Lock::path_beside(f));
        let lock_path = self.lock.clone().or(beside).unwrap_or_default();
        let lock_text = match std::fs::read_to_string(&lock_path) {
            Ok(text) => Some(text),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound && self.lock.is_none() => None,
            Err(error) => {
                return Err(Error::Read {
                    path: lock_path,
                    error,
                });
            }
        };
        let mut read: Vec<PathBuf> = files.iter().map(|f| f.to_path_buf()).collect();
        read.extend(lock_text.is_some().then(|| lock_path.clone()));

        let module = out.join(format!("{name}.rs"));
        let folder = out.join(&name);
        let key = stamp::key(self, &name, files, &texts, lock_text.as_deref());
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
            Some((_, Err(error))) => return Err(Error::Lock(error)),
        };
        let made = self.make(&name, files, texts, &lock)?;
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
            let failed = |error| Error::Write {
                path: folder.clone(),
                error,
            };
            written.extend(emit::write(&folder, files).map_err(failed)?);
            let below = folder.strip_prefix(&out).unwrap_or(&folder).to_owned();
            hashes.extend(files.iter().map(|f| stamp::hashed(&below, f)));
        }
        stamp::sweep(&folder, &out, &hashes);
        // Last, so that a build that was cut off is made again.
        stamp::write(&folder, &key, &made.trace, hashes).map_err(|error| Error::Write {
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

    fn material(&self, files: &[&Path]) -> Result<String, Error> {
        let stem = files.first().and_then(|f| f.file_stem());
        let stem = stem.map(|s| s.to_string_lossy().into_owned());
        let name = self.name.clone().or_else(|| {
            let stem = stem?;
            let stages = [".vert", ".frag", ".vs", ".fs"];
            let bare = stages.iter().find_map(|s| stem.strip_suffix(s));
            Some(bare.unwrap_or(&stem).to_owned())
        });
        match name {
            Some(name) if emit::is_material_name(&name) => Ok(name),
            name => Err(Error::Name(name.unwrap_or_default())),
        }
    }

    /// The module and the files of each variant.
    fn make(
        &self,
        name: &str,
        files: &[&Path],
        texts: Vec<String>,
        lock: &Keeping,
    ) -> Result<Made, Error> {
        let sources: Vec<front::Source> = files
            .iter()
            .zip(texts)
            .map(|(file, text)| front::Source::new(slashes(file), text))
            .collect();
        let mut trace = Trace::default();
        let mut drawn = choose::choose(self, name, &sources, lock, &mut trace)?;
        let module = generate::Module {
            types: self.types.as_deref(),
            wgpu: self.wgpu.as_deref(),
            said: &self.said,
        };
        Ok(Made {
            module: worded(name, &mut drawn, &module, &sources, &mut trace.warnings)?,
            files: drawn.into_iter().map(|d| (d.name, d.files)).collect(),
            trace,
        })
    }

    fn recipes(&self) -> Result<Asked, Error> {
        if self.passes.is_empty() && self.variants.is_empty() {
            let named = choose::BY_DEFAULT.iter().map(|(name, pass)| {
                let recipe = Recipe::parse([pass])?;
                Ok(((*name).to_owned(), recipe))
            });
            return Ok(Asked {
                own: None,
                named: named.collect::<Result<_, Error>>()?,
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
                return Err(Error::Name(name.clone()));
            }
            if !taken.insert(name) {
                return Err(Error::Twice(name.clone()));
            }
            Ok((name.clone(), Recipe::parse(steps)?))
        });
        Ok(Asked {
            own,
            named: named.collect::<Result<_, Error>>()?,
            is_default: false,
        })
    }
}

/// The recipes that are asked for.
struct Asked {
    /// Of the material's own variant, if there is one.
    own: Option<Recipe>,
    /// Of variants with names.
    named: Vec<(String, Recipe)>,
    /// Nobody asked for any: they are what needs no scene.
    is_default: bool,
}

struct Made {
    module: String,
    files: Vec<(String, Vec<File>)>,
    trace: Trace,
}

/// The module's text. A variant that it has no words for is told, and the original stands in its place.
fn worded(
    name: &str,
    drawn: &mut [Drawn],
    module: &generate::Module<'_>,
    sources: &[front::Source],
    warnings: &mut Vec<String>,
) -> Result<String, Error> {
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
                return Err(Error::Module {
                    file: sources.first().map_or(String::new(), |s| s.name.clone()),
                    why: wordless.why,
                });
            }
        }
    }
}

fn read(path: &Path) -> Result<String, Error> {
    std::fs::read_to_string(path).map_err(|error| Error::Read {
        path: path.to_owned(),
        error,
    })
}

/// A path as messages and generated files say it on every machine.
fn slashes(path: &Path) -> String {
    path.display().to_string().replace('\\', "/")
}

#[cfg(all(test, feature = "verify"))]
#[allow(clippy::unwrap_used, clippy::panic)]
mod tests {
    use preshade_passes::guard;

    use preshade_passes::pass::Facts;
    use preshade_passes::plan::Plan;
    use preshade_passes::state::MaterialState;

    use super::{Error, choose, generate};
    use crate::front;
    use crate::recipe::Recipe;

    use super::host::{Assumed, Override, Place, ScalarType, Unfit, constants_with};

    /// What a generated module says of bytes is what the plan's guard says.
    #[test]
    fn a_host_checks_what_the_guard_does() {
        let types = [
            (guard::ScalarType::F32, ScalarType::F32),
            (guard::ScalarType::I32, ScalarType::I32),
            (guard::ScalarType::U32, ScalarType::U32),
        ];
        let (group, binding, offset) = (1, 2, 4);
        let words = [0.0_f32, -0.0, 0.5, 1.0, 1.5, f32::NAN, f32::INFINITY]
            .map(f32::to_bits)
            .into_iter()
            .chain([1, 2, u32::MAX]);
        for (word, (ty, hosts)) in words.flat_map(|w| types.map(|t| (w, t))) {
            let place = guard::Place::Uniform {
                group,
                binding,
                offset,
            };
            let of = guard::Guard {
                values: vec![guard::Assumed {
                    name: "u.n".to_owned(),
                    place,
                    ty,
                    bounds: guard::Bounds {
                        low: 0.0,
                        high: 1.0,
                    },
                }],
            };
            let host = Assumed {
                name: "u.n",
                place: Place::Uniform {
                    group,
                    binding,
                    offset,
                },
                ty: hosts,
                low: 0.0,
                high: 1.0,
            };
            let bytes = [[0; 4], word.to_le_bytes()].concat();
            for given in [&bytes[..], &bytes[..7]] {
                let at = |g, b| ((g, b) == (group, binding)).then_some(given);
                assert_eq!(host.holds(&[], at), of.holds(at), "{word:x} as {ty:?}");
            }
        }
    }

    /// Pipelines of a variant are made for the constants that it was made for, and for no others.
    #[test]
    fn a_host_cannot_set_what_a_variant_has_decided() {
        let of = |name, key, ty, value: f64, is_default| Assumed {
            name,
            place: Place::Override { key, is_default },
            ty,
            low: value,
            high: value,
        };
        let tenth = f64::from(0.1_f32);
        let guard = [
            of("N", "7", ScalarType::U32, 1.0, false),
            of("K", "K", ScalarType::F32, tenth, false),
            of("M", "M", ScalarType::U32, 2.0, true),
        ];
        let overrides = [Override {
            key: "K",
            is_needed: false,
        }];
        let given = |constants: &[(&str, f64)]| {
            let holds = guard.iter().all(|a| a.holds(constants, |_, _| None));
            let own = constants_with(&overrides, &["7", "M"], &guard, constants)
                .map(|own| own.iter().map(|(key, v)| ((*key).to_owned(), *v)).collect());
            assert_eq!(holds, own.is_ok(), "{constants:?}");
            own.map_err(|unfit| match unfit {
                Unfit::Guard(assumed) => assumed.name,
                Unfit::Host(why) => panic!("{why}"),
            })
        };
        let own: Vec<(String, f64)> = vec![("K".to_owned(), 0.1)];
        // As `f32` both are the same number.
        assert_eq!(given(&[("7", 1.0), ("K", 0.1)]), Ok(own.clone()));
        assert_eq!(given(&[("K", 0.1), ("M", 2.0), ("7", 1.0)]), Ok(own));
        assert_eq!(given(&[]), Err("N"));
        assert_eq!(given(&[("7", 4.0), ("K", 0.1)]), Err("N"));
        assert_eq!(given(&[("7", 1.0), ("K", 0.5)]), Err("K"));
        assert_eq!(given(&[("7", 1.0), ("K", f64::NAN)]), Err("K"));
        assert_eq!(given(&[("7", 1.0), ("K", 0.1), ("M", 3.0)]), Err("M"));
        // The last of a key counts.
        assert_eq!(given(&[("7", 1.0), ("K", 0.1), ("7", 4.0)]), Err("N"));
    }

    /// What cannot be made of a variant is told, and the original stands in its place: only its own failure ends a build.
    #[test]
    fn a_variant_that_cannot_be_made_is_the_original() {
        let text = include_str!("../../fixtures/shaders/toon.wgsl");
        let sources = [front::Source::new("toon.wgsl", text)];
        let parsed = front::parse(&sources, &front::Options::default()).unwrap();
        let state = MaterialState::default();
        let original = parsed.plan("toon", &state);
        let variant = |pass| {
            let recipe = Recipe::parse([pass]).unwrap();
            recipe.apply(&original, &Facts::default()).unwrap()
        };
        let mut unwritable = variant("shadow");
        unwritable.passes[0].program = "none".to_owned();
        let mut wordless = variant("depth-prepass");
        wordless.passes[0].features.push("telepathy".to_owned());
        let plans = |original: &Plan| {
            let all = [
                ("original", original),
                ("variant", &unwritable),
                ("b", &wordless),
            ];
            all.map(|(name, plan)| (name.to_owned(), (plan.clone(), Vec::new())))
                .to_vec()
        };
        let builder = super::configure();
        let mut warnings = Vec::new();
        let mut drawn = choose::made(&builder, plans(&original), &sources, &mut warnings).unwrap();
        let module = generate::Module {
            types: None,
            wgpu: None,
            said: &builder.said,
        };
        let text = super::worded("toon", &mut drawn, &module, &sources, &mut warnings).unwrap();
        let [emit, words] = &warnings[..] else {
            panic!("{warnings:?}");
        };
        assert!(
            emit.starts_with("toon.wgsl: `variant` cannot be made: "),
            "{emit}"
        );
        assert!(emit.ends_with("The original is shipped"), "{emit}");
        assert!(
            words.contains("`b` cannot be made: ") && words.contains("telepathy"),
            "{words}"
        );
        for (one, why) in drawn[1..].iter().zip(["`none`", "`telepathy`"]) {
            assert!(one.plan.steps.is_empty());
            assert_eq!(one.files, drawn[0].files);
            assert!(one.left_out[0].contains(why), "{:?}", one.left_out);
        }
        assert!(!text.contains("Phase::Depth,"));
        let failed = choose::made(&builder, plans(&unwritable), &sources, &mut warnings);
        assert!(matches!(failed, Err(Error::Emit(_))));
    }
}
