//! Removes the parts of a program that its passes do not use.

use naga::{Module, ShaderStage, compact};
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;

use super::{EmitError, EmittedStage};

/// The plan's program `key` with only the entry points of `stages` and their dependencies.
pub(super) fn reduce(
    plan: &Plan,
    key: &str,
    stages: &[EmittedStage],
) -> Result<Program, EmitError> {
    let broken = |what: String| EmitError::BrokenPlan {
        material: plan.material.clone(),
        what,
    };
    let program = plan
        .programs
        .get(key)
        .ok_or_else(|| broken(format!("it has no program `{key}`")))?;
    for stage in stages {
        if program.entry_point(stage.stage, &stage.entry).is_none() {
            return Err(broken(format!(
                "its program `{key}` has no {:?} entry point `{}`",
                stage.stage, stage.entry
            )));
        }
    }
    let used =
        |stage: ShaderStage, name: &str| stages.iter().any(|s| s.stage == stage && s.entry == name);
    program
        .with_module(reduced(program, used))
        .map_err(|invalid| broken(format!("its program `{key}` is invalid: {invalid}")))
}

/// The program with one entry point and its dependencies.
#[cfg(any(feature = "glsl", feature = "spirv"))]
pub(super) fn to_stage(
    program: &Program,
    stage: ShaderStage,
    entry: &str,
) -> Result<Program, Box<shader_text::source::Invalid>> {
    program.with_module(reduced(program, |s, name| s == stage && name == entry))
}

fn reduced(program: &Program, used: impl Fn(ShaderStage, &str) -> bool) -> Module {
    let mut module = program.module().clone();
    module.entry_points.retain(|e| used(e.stage, &e.name));
    compact::compact(&mut module, compact::KeepUnused::No);
    module
}
