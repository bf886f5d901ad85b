//! Writes a [`Plan`] as files: its programs in each requested target, and `MATERIAL.plan.json`.
//!
//! Every program is first reduced to the entry points that its passes use. We parse the written
//! text again and compare `fingerprint`s: entry points with their attributes, inputs and outputs,
//! bindings, struct offsets. We repair known losses of naga's writers. Any other difference is an
//! [`EmitError`].
//!
//! | target | files |
//! |---|---|
//! | [`Target::Wgsl`] | `MATERIAL.ROLE.wgsl`, all entry points of a program |
//! | [`Target::Spirv`] | `MATERIAL.ROLE.vert.spv`, `MATERIAL.ROLE.frag.spv` |
//! | [`Target::Glsl450`] | `MATERIAL.ROLE.vert`, `MATERIAL.ROLE.frag` |
//! | [`Target::GlslVulkan`] | `MATERIAL.ROLE.vk.vert`, `MATERIAL.ROLE.vk.frag` |
//! | [`Target::GlslEs300`] | `MATERIAL.ROLE.es.vert`, `MATERIAL.ROLE.es.frag` |
//! | [`Target::GlslEs100`] | `MATERIAL.ROLE.es100.vert`, `MATERIAL.ROLE.es100.frag` |
//! | [`Target::GlslTess`] | `MATERIAL.ROLE.tess.vert`, `.tess.tesc`, `.tess.tese`, `.tess.frag`, of a hoisted plan |
//! | [`Target::GlslVulkanTess`] | `MATERIAL.ROLE.vulkan.vert`, `.vulkan.tesc`, `.vulkan.tese`, `.vulkan.frag`, of a hoisted plan |
//!
//! `ROLE` is the program's key in [`Plan::programs`]. If several passes draw one program with
//! different entry points, the file name includes the entry point: `MATERIAL.ROLE.ENTRY.frag`.
//! Compute stages end in `comp`. `plan.json` lists the files of each pass. A depth-only pass has an
//! empty fragment file in GLSL ES and none elsewhere. A plan with the original as its fallback also
//! has `MATERIAL.original` files, unless its main program is the original.

pub mod codes;
#[cfg(any(feature = "glsl", feature = "spirv"))]
mod combined;
mod empty_fragment;
#[cfg(test)]
mod equivalence;
#[cfg(feature = "glsl")]
mod glsl;
mod lengths;
mod meaning;
#[cfg(any(feature = "glsl", feature = "spirv"))]
mod overrides;
#[cfg(feature = "spirv")]
pub mod partial_pointers;
mod plan_json;
mod reduce;
#[cfg(feature = "spirv")]
mod spirv;
mod stale;
#[cfg(feature = "glsl")]
mod tess;
mod wgsl;

use std::cell::RefCell;
use std::collections::BTreeMap;

use naga::{ImageClass, ShaderStage, TypeInner};
use preshade_plan::plan::{BindingSource, GpuPass, ORIGINAL, Plan};
use preshade_plan::plan_file::{Fallback, StageFile, Target, WeakerPromise};
use preshade_plan::program::Program;
use preshade_plan::state::Topology;

use shader_text::files::File;
use shader_text::panics;

pub use meaning::Meaning;
pub use plan_json::versions;
pub use stale::{Stale, remove, stale};

/// The clip space of GLSL output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ClipSpace {
    /// The author's: the host's matrices decide.
    #[default]
    AsWritten,
    /// OpenGL's, for a host with WebGPU's matrices: flips y and maps z from 0..1 to -1..1.
    OpenGl,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Clip space of GLSL targets.
    pub glsl_clip_space: ClipSpace,
}

/// A plan could not be emitted. Nothing has been written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EmitError {
    /// The target cannot express the program.
    #[error("{file}: {target} cannot express this: {what}; {remedy}")]
    Inexpressible {
        file: String,
        target: Target,
        what: String,
        remedy: String,
    },
    /// naga's writer failed or panicked.
    #[error("{file}: naga's {target} writer failed: {message}")]
    Writer {
        file: String,
        target: Target,
        message: String,
    },
    /// The written text differs from its program when read back.
    #[error(
        "{file}: the emitted {target} does not read back as the program: {difference}; \
         this is a bug, please report it with the shader"
    )]
    Differs {
        file: String,
        target: Target,
        difference: String,
    },
    /// The plan names a missing program or entry point.
    #[error(
        "the plan of `{material}` is broken: {what}; this is a bug, please report it with the \
         shader"
    )]
    BrokenPlan { material: String, what: String },
    /// The Cargo feature for the target is off.
    #[error("this build cannot write {target}: build preshade with the feature `{feature}`")]
    NotBuilt {
        target: Target,
        feature: &'static str,
    },
}

impl EmitError {
    /// The error code, which is stable.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Inexpressible { .. } => codes::INEXPRESSIBLE.code,
            Self::Writer { .. } => codes::WRITER.code,
            Self::Differs { .. } => codes::DIFFERS.code,
            Self::BrokenPlan { .. } => preshade_plan::codes::BROKEN_PLAN.code,
            Self::NotBuilt { .. } => codes::NOT_BUILT.code,
        }
    }
}

/// Writes `plan` in every target: files in the order of the plan's programs and of `targets`, then
/// `MATERIAL.plan.json`. Equal plans give equal bytes.
///
/// # Errors
/// The first file that cannot be written; see [`EmitError`]. A panic in naga becomes [`EmitError::Writer`].
pub fn emit(plan: &Plan, targets: &[Target], options: &Options) -> Result<Vec<File>, EmitError> {
    let compare = &|_: meaning::Texts<'_>| Ok(());
    emit_guarded(plan, targets, Writing { options, compare })
}

/// As [`emit`], with the same bytes, and compares the meaning of each text with its program. Also
/// returns a sentence on each text that was not compared, with the reason.
///
/// # Errors
/// As [`emit`]; a text that means something else is [`EmitError::Differs`].
pub fn emit_compared(
    plan: &Plan,
    targets: &[Target],
    options: &Options,
    meaning: Meaning,
) -> Result<(Vec<File>, Vec<String>), EmitError> {
    let uncompared = RefCell::new(Vec::new());
    let compare = &|texts: meaning::Texts<'_>| {
        let more = texts.compare(options, meaning)?;
        uncompared.borrow_mut().extend(more);
        Ok(())
    };
    let files = emit_guarded(plan, targets, Writing { options, compare })?;
    Ok((files, uncompared.into_inner()))
}

/// The options, and the function that compares the texts of a program. A build that never passes a
/// comparison has no interpreter.
#[derive(Clone, Copy)]
struct Writing<'a> {
    options: &'a Options,
    compare: &'a dyn Fn(meaning::Texts<'_>) -> Result<(), EmitError>,
}

fn emit_guarded(
    plan: &Plan,
    targets: &[Target],
    writing: Writing<'_>,
) -> Result<Vec<File>, EmitError> {
    panics::run(|| emit_unguarded(plan, targets, writing)).unwrap_or_else(|panicked| {
        Err(EmitError::Writer {
            file: plan.material.clone(),
            target: targets.first().copied().unwrap_or(Target::Wgsl),
            message: format!(
                "it panicked, which is a bug; please report it with the shader ({panicked})"
            ),
        })
    })
}

/// The stage files of a program: entry points and file names without extensions.
#[derive(Clone, Debug, PartialEq, Eq)]
struct EmittedStage {
    stage: ShaderStage,
    entry: String,
    /// `MATERIAL.ROLE` or `MATERIAL.ROLE.ENTRY`.
    stem: String,
}

/// The `plan.json` entry of each (program, entry point, target).
type WrittenFiles = BTreeMap<(String, Written, Target), StageFile>;

fn emit_unguarded(
    plan: &Plan,
    targets: &[Target],
    writing: Writing<'_>,
) -> Result<Vec<File>, EmitError> {
    #[cfg(feature = "glsl")]
    tess::check(plan, targets)?;
    refuse_external_textures(plan, targets)?;
    refuse_lost_point_sizes(plan, targets)?;
    refuse_flipped_rows(plan, targets)?;
    let mut files = Vec::new();
    let lengths = lengths::fixed(plan, dedup(targets));
    let written = write_programs(plan, &lengths, writing, &mut files)?;
    let fallback = match plan.original.as_deref() {
        // A guarded plan always needs the original.
        Some(original) if plan.fallback.as_deref() == Some(ORIGINAL) || plan.guard.is_some() => {
            Some(write_original(
                plan, original, &written, &lengths, writing, &mut files,
            )?)
        }
        _ => None,
    };
    files.push(plan_json::file(plan, &written, fallback));
    Ok(files)
}

/// Rejects `texture_external`, which only WebGPU has.
fn refuse_external_textures(plan: &Plan, targets: &[Target]) -> Result<(), EmitError> {
    let Some(target) = targets.iter().find(|t| **t != Target::Wgsl) else {
        return Ok(());
    };
    let external = plan.programs.values().find_map(|program| {
        let module = program.module();
        let mut globals = module.global_variables.iter();
        globals.find_map(|(_, g)| match module.types[g.ty].inner {
            TypeInner::Image {
                class: ImageClass::External,
                ..
            } => Some(g.name.clone().unwrap_or_default()),
            _ => None,
        })
    });
    external.map_or(Ok(()), |name| {
        Err(EmitError::Inexpressible {
            file: plan.material.clone(),
            target: *target,
            what: format!("the external texture `{name}`"),
            remedy: "emit WGSL, or bind it as texture_2d<f32>".to_owned(),
        })
    })
}

/// Rejects OpenGL targets for passes that read an earlier pass's target at `gl_FragCoord` under
/// `layout(origin_upper_left)`: OpenGL's textures start at the bottom, so the row would differ.
fn refuse_flipped_rows(plan: &Plan, targets: &[Target]) -> Result<(), EmitError> {
    let is_opengl = |t: &&Target| !matches!(t, Target::Wgsl | Target::Spirv | Target::GlslVulkan);
    let Some(target) = targets.iter().find(is_opengl) else {
        return Ok(());
    };
    let drawn = |source: &BindingSource| {
        matches!(
            source,
            BindingSource::Attachment { .. } | BindingSource::SceneColor { .. }
        )
    };
    let meets = plan.passes.iter().any(|pass| {
        let program = plan.programs.get(&pass.program);
        program.is_some_and(|p| p.declared().origin_upper_left)
            && pass.bindings.iter().any(|b| drawn(&b.source))
    });
    match meets {
        false => Ok(()),
        true => Err(EmitError::Inexpressible {
            file: plan.material.clone(),
            target: *target,
            what: "`layout(origin_upper_left)` together with a texture that another pass draws"
                .to_owned(),
            remedy: "remove it and flip `gl_FragCoord.y` by the height; WGSL and SPIR-V support it"
                .to_owned(),
        }),
    }
}

/// Rejects OpenGL targets that would lose the author's `gl_PointSize`.
fn refuse_lost_point_sizes(plan: &Plan, targets: &[Target]) -> Result<(), EmitError> {
    let is_glsl = |t: &&Target| !matches!(t, Target::Wgsl | Target::Spirv);
    let Some(target) = targets.iter().find(is_glsl) else {
        return Ok(());
    };
    let lost = plan.passes.iter().any(|pass| {
        let program = plan.programs.get(&pass.program);
        pass.primitive.topology == Topology::PointList
            && program.is_some_and(|p| p.declared().point_size)
    });
    match lost {
        false => Ok(()),
        true => Err(EmitError::Inexpressible {
            file: plan.material.clone(),
            target: *target,
            what: "`gl_PointSize`, which is lost".to_owned(),
            remedy: "draw quads instead of points; WGSL and SPIR-V draw points of one pixel"
                .to_owned(),
        }),
    }
}

/// Writes the programs that the passes of `plan` use.
fn write_programs(
    plan: &Plan,
    lengths: &lengths::Fixed,
    writing: Writing<'_>,
    files: &mut Vec<File>,
) -> Result<WrittenFiles, EmitError> {
    let named = plan.passes.iter().map(|p| &p.program);
    let named = named.chain(plan.compute.iter().map(|c| &c.program));
    if let Some(missing) = named.into_iter().find(|p| !plan.programs.contains_key(*p)) {
        return Err(EmitError::BrokenPlan {
            material: plan.material.clone(),
            what: format!("it has no program `{missing}`"),
        });
    }
    let targets: Vec<Target> = lengths.iter().map(|(target, _)| *target).collect();
    let mut written = WrittenFiles::new();
    for key in plan.programs.keys() {
        let stages = stages(plan, key);
        if stages.is_empty() {
            continue;
        }
        let program = reduce::reduce(plan, key, &stages)?;
        for (target, fixed) in lengths {
            let target = *target;
            let with_defaults = match &fixed[..] {
                [] => None,
                fixed => {
                    let place = (plan.material.as_str(), target);
                    Some(lengths::with_defaults(&program, fixed, place)?)
                }
            };
            let program = with_defaults.as_ref().unwrap_or(&program);
            let emitted = write_program(plan, key, program, &stages, target, writing.options)?;
            (writing.compare)(meaning::Texts {
                plan,
                key,
                program,
                target,
                emitted: &emitted,
            })?;
            for (file, stage_file) in emitted {
                files.push(file);
                for (stage, mut stage_file) in stage_file {
                    let notes = fixed.iter().map(|length| lengths::note(length, target));
                    stage_file.notes.extend(notes);
                    written.insert((key.clone(), stage, target), stage_file);
                }
            }
        }
    }
    for empty_fragment::EmptyFragment {
        program,
        target,
        file,
        stage_file,
    } in empty_fragment::files(plan, &targets)
    {
        // The main pass and the original can share an empty fragment stage.
        if !files.contains(&file) {
            files.push(file);
        }
        written.insert((program, empty_fragment::key(), target), stage_file);
    }
    Ok(written)
}

/// Writes the fallback to the author's program: its passes, and `MATERIAL.original` files if the
/// plan's own differ.
fn write_original(
    plan: &Plan,
    original: &Plan,
    written: &WrittenFiles,
    lengths: &lengths::Fixed,
    writing: Writing<'_>,
    files: &mut Vec<File>,
) -> Result<Fallback, EmitError> {
    let is_shipped = |pass: &GpuPass| {
        let program = plan.programs.get(&pass.program);
        let fragment = pass.fragment.as_deref().unwrap_or_default();
        let has = |stage, entry: &str| {
            let entry = written_key(stage, entry);
            let mut keys = written.keys();
            keys.any(|(p, e, _)| *p == pass.program && *e == entry)
        };
        program.is_some_and(Program::is_as_written)
            && has(ShaderStage::Vertex, &pass.vertex)
            && (fragment.is_empty() || has(ShaderStage::Fragment, fragment))
    };
    if original.passes.iter().all(is_shipped) {
        return Ok(plan_json::fallback(original, written));
    }
    let mut named = original.clone();
    named.programs = named
        .programs
        .into_values()
        .map(|program| (ORIGINAL.to_owned(), program))
        .collect();
    for pass in &mut named.passes {
        pass.program = ORIGINAL.to_owned();
    }
    let written = write_programs(&named, lengths, writing, files)?;
    Ok(plan_json::fallback(&named, &written))
}

/// An entry point by stage and name, vertex first.
type Written = (u8, String);

fn written_key(stage: ShaderStage, entry: &str) -> Written {
    let order = match stage {
        ShaderStage::Vertex => 0,
        ShaderStage::Fragment => 1,
        _ => 2,
    };
    (order, entry.to_owned())
}

/// A stage, including those that naga lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TessellationStage {
    Control,
    Evaluation,
}

impl TessellationStage {
    /// The key of a tessellation stage after the vertex entry point.
    fn key(self, vertex: &str) -> Written {
        let order = match self {
            Self::Control => 3,
            Self::Evaluation => 4,
        };
        (order, vertex.to_owned())
    }
}

fn dedup(targets: &[Target]) -> Vec<Target> {
    let mut all = Vec::new();
    for target in targets {
        if !all.contains(target) {
            all.push(*target);
        }
    }
    all
}

/// The entry points of a program that passes use, vertex first and compute last.
fn stages(plan: &Plan, key: &str) -> Vec<EmittedStage> {
    let passes = || plan.passes.iter().filter(|p| p.program == key);
    let mut all: Vec<EmittedStage> = Vec::new();
    let vertex = passes().map(|p| (ShaderStage::Vertex, p.vertex.clone()));
    let fragment = passes().filter_map(|p| Some((ShaderStage::Fragment, p.fragment.clone()?)));
    let compute = plan.compute.iter().filter(|c| c.program == key);
    let compute = compute.map(|c| (ShaderStage::Compute, c.entry_point.clone()));
    for (stage, entry) in vertex.chain(fragment).chain(compute) {
        if !all.iter().any(|s| s.stage == stage && s.entry == entry) {
            all.push(EmittedStage {
                stage,
                entry,
                stem: String::new(),
            });
        }
    }
    for i in 0..all.len() {
        let alone = all.iter().filter(|s| s.stage == all[i].stage).count() == 1;
        all[i].stem = if alone {
            format!("{}.{key}", plan.material)
        } else {
            format!("{}.{key}.{}", plan.material, all[i].entry)
        };
    }
    all
}

/// The contract of a target's files, if it is weaker than the plan's.
fn weaker_form(plan: &Plan, target: Target) -> Option<WeakerPromise> {
    match target {
        #[cfg(feature = "glsl")]
        Target::GlslEs300 | Target::GlslEs100 => glsl::without_fine_derivatives(plan),
        _ => {
            let _ = plan;
            None
        }
    }
}

/// The result of reading a written file back.
#[cfg(any(feature = "glsl", feature = "spirv"))]
enum ReadBack {
    Same,
    /// The reader lacks this, so only the names or numbers of the interface were compared.
    Unread(String),
    /// The first difference, as text.
    Differs(String),
}

#[cfg(any(feature = "glsl", feature = "spirv"))]
impl ReadBack {
    /// The value of [`StageFile::unread`].
    fn unread(self, file: &str, target: Target) -> Result<Option<String>, EmitError> {
        match self {
            Self::Same => Ok(None),
            Self::Unread(what) => Ok(Some(what)),
            Self::Differs(difference) => Err(EmitError::Differs {
                file: file.to_owned(),
                target,
                difference,
            }),
        }
    }
}

type Emitted = (File, Vec<(Written, StageFile)>);

fn write_program(
    plan: &Plan,
    key: &str,
    program: &Program,
    stages: &[EmittedStage],
    target: Target,
    options: &Options,
) -> Result<Vec<Emitted>, EmitError> {
    match target {
        Target::Wgsl => {
            let name = format!("{}.{key}.wgsl", plan.material);
            let text = match wgsl::author_text(plan, key) {
                Some(text) => text,
                None => wgsl::write(program, &name, &wgsl::header(plan, program))?,
            };
            let stage_file = stages
                .iter()
                .map(|s| {
                    (
                        written_key(s.stage, &s.entry),
                        StageFile::new(&name, &s.entry),
                    )
                })
                .collect();
            let bytes = text.into_bytes();
            Ok(vec![(File { name, bytes }, stage_file)])
        }
        #[cfg(feature = "spirv")]
        Target::Spirv => {
            let ids = overrides::SpecIds::of(plan);
            let pairs = combined::CombinedSamplers::of(plan, program);
            let write = |s: &EmittedStage| {
                let name = format!("{}.{}.spv", s.stem, extension(s.stage));
                let (bytes, stage_file) =
                    spirv::write(program, s.stage, &s.entry, &name, &ids, &pairs)?;
                let stage_file = vec![(written_key(s.stage, &s.entry), stage_file)];
                Ok((File { name, bytes }, stage_file))
            };
            stages.iter().map(write).collect()
        }
        #[cfg(not(feature = "spirv"))]
        Target::Spirv => Err(EmitError::NotBuilt {
            target,
            feature: "spirv",
        }),
        #[cfg(feature = "glsl")]
        _ => {
            let mut emitted = match target {
                Target::GlslTess | Target::GlslVulkanTess => {
                    tess::write(plan, program, stages, target, options)?
                }
                _ => write_glsl(plan, program, stages, target, options)?,
            };
            for (file, stage_files) in &mut emitted {
                let text = String::from_utf8_lossy(&file.bytes);
                glsl::unsupported::refuse_long_names(&text, &file.name, target)?;
                glsl::unsupported::refuse_attribute_arrays(&text, &file.name, target)?;
                for (_, stage_file) in stage_files {
                    stage_file.extensions = glsl::extensions(&text);
                }
            }
            Ok(emitted)
        }
        #[cfg(not(feature = "glsl"))]
        _ => {
            let _ = options;
            Err(EmitError::NotBuilt {
                target,
                feature: "glsl",
            })
        }
    }
}

/// Writes each stage as GLSL, without tessellation stages.
#[cfg(feature = "glsl")]
fn write_glsl(
    plan: &Plan,
    program: &Program,
    stages: &[EmittedStage],
    target: Target,
    options: &Options,
) -> Result<Vec<Emitted>, EmitError> {
    let vulkan = (target == Target::GlslVulkan).then(|| glsl::Vulkan::of(plan, program));
    let program = vulkan.as_ref().map_or(program, |vulkan| &vulkan.program);
    let authored = glsl::author(program, &plan.material, target)?;
    let infix = match target {
        Target::GlslVulkan => "vk.",
        Target::GlslEs300 => "es.",
        Target::GlslEs100 => "es100.",
        _ => "",
    };
    let write = |s: &EmittedStage| {
        let name = format!("{}.{infix}{}", s.stem, extension(s.stage));
        let (text, stage_file) = match &vulkan {
            Some(vulkan) => glsl::write_vulkan(&authored, vulkan, s.stage, &s.entry, &name)?,
            None => glsl::write_named(&authored, s.stage, &s.entry, &name, target, options)?,
        };
        let bytes = text.into_bytes();
        let stage_file = vec![(written_key(s.stage, &s.entry), stage_file)];
        Ok((File { name, bytes }, stage_file))
    };
    stages.iter().map(write).collect()
}

#[cfg(any(feature = "glsl", feature = "spirv"))]
fn extension(stage: ShaderStage) -> &'static str {
    match stage {
        ShaderStage::Vertex => "vert",
        ShaderStage::Compute => "comp",
        _ => "frag",
    }
}
