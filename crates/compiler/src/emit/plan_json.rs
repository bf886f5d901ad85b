//! `MATERIAL.plan.json`: the plan's data, and the file and entry point of each pass in each target.

use std::collections::{BTreeMap, BTreeSet};

use naga::ShaderStage;
use preshade_passes::transforms::specialize::dispatch::Versions;
use preshade_plan::plan::Plan;

use super::{TessellationStage, WrittenFiles, written_key};
use preshade_plan::plan_file::{
    Fallback, PassFiles, PlanFile, StageFile, Target, TessellationFiles,
};
use shader_text::files::File;

/// One stage's files by target.
fn stage_files(
    written: &WrittenFiles,
    program: &str,
    stage: ShaderStage,
    entry: &str,
) -> BTreeMap<Target, StageFile> {
    let entry = written_key(stage, entry);
    written
        .iter()
        .filter(|((p, e, _), _)| p == program && *e == entry)
        .map(|((_, _, target), file)| (*target, file.clone()))
        .collect()
}

/// A pass's tessellation stages by target.
fn tessellation_files(
    written: &WrittenFiles,
    program: &str,
    vertex: &str,
) -> BTreeMap<Target, TessellationFiles> {
    let of = |stage: TessellationStage, target: Target| {
        let key = (program.to_owned(), stage.key(vertex), target);
        written.get(&key).cloned()
    };
    let stages = |target| {
        Some(TessellationFiles {
            control: of(TessellationStage::Control, target)?,
            evaluation: of(TessellationStage::Evaluation, target)?,
        })
    };
    let targets = Target::ALL.into_iter();
    targets
        .filter_map(|target| Some((target, stages(target)?)))
        .collect()
}

fn pass_files(plan: &Plan, written: &WrittenFiles) -> Vec<PassFiles> {
    let of = |program: &str, stage, entry: &str| stage_files(written, program, stage, entry);
    plan.passes
        .iter()
        .map(|pass| PassFiles {
            role: pass.role.name().to_owned(),
            vertex: of(&pass.program, ShaderStage::Vertex, &pass.vertex),
            // A pass without one has an empty stage if the target needs it.
            fragment: of(
                &pass.program,
                ShaderStage::Fragment,
                pass.fragment.as_deref().unwrap_or_default(),
            ),
            tessellation: tessellation_files(written, &pass.program, &pass.vertex),
        })
        .collect()
}

/// The material as its author wrote it, in these files.
pub(super) fn fallback(plan: &Plan, written: &WrittenFiles) -> Fallback {
    Fallback {
        attachments: plan.attachments.clone(),
        passes: plan.passes.clone(),
        files: pass_files(plan, written),
    }
}

/// The note on Vulkan's GLSL as WGSL.
const UPSIDE_DOWN: &str = "the text is read as Vulkan's, whose y points down: WebGPU draws the WGSL \
                           upside down; end the vertex stage with `gl_Position.y = \
                           -gl_Position.y;`, or negate y in the projection";

fn notes(written: &WrittenFiles) -> impl Iterator<Item = String> {
    written.values().flat_map(|stage| {
        let unread = stage.unread.as_ref().map(|lacks| {
            format!(
                "`{}` was not read back: our reader lacks {lacks}; only its interface was compared",
                stage.file
            )
        });
        unread.into_iter().chain(stage.notes.iter().cloned())
    })
}

pub(super) fn file(plan: &Plan, written: &WrittenFiles, original: Option<Fallback>) -> File {
    let targets: BTreeSet<Target> = written.keys().map(|(_, _, target)| *target).collect();
    let forms = targets
        .into_iter()
        .filter_map(|target| Some((target, super::weaker_form(plan, target)?)))
        .collect();
    let compute = plan.compute.iter();
    let compute =
        compute.map(|c| stage_files(written, &c.program, ShaderStage::Compute, &c.entry_point));
    let mut plan = plan.clone();
    for note in notes(written) {
        if !plan.notes.contains(&note) {
            plan.notes.push(note);
        }
    }
    let is_wgsl = written.keys().any(|(_, _, target)| *target == Target::Wgsl);
    let is_down = plan.programs.values().any(|p| p.declared().y_down);
    if is_wgsl && is_down {
        plan.notes.push(UPSIDE_DOWN.to_owned());
    }
    let content = PlanFile {
        compute_files: compute.collect(),
        files: pass_files(&plan, written),
        original,
        forms,
        plan,
    };
    let name = format!("{}.plan.json", content.plan.material);
    // A plan is plain data with string keys, so serialising it cannot fail.
    let mut bytes = serde_json::to_vec_pretty(&content).unwrap_or_default();
    bytes.push(b'\n');
    File { name, bytes }
}

/// `MATERIAL.versions.json`: which version of a material a draw takes.
pub fn versions(versions: &Versions) -> File {
    let name = format!("{}.versions.json", versions.material);
    // Plain data with string keys, too.
    let mut bytes = serde_json::to_vec_pretty(versions).unwrap_or_default();
    bytes.push(b'\n');
    File { name, bytes }
}
