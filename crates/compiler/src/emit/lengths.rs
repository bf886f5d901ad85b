//! Arrays whose lengths are specialisation constants ([`LengthConstant`]), in targets that cannot
//! express them.

use naga::compact::{KeepUnused, compact};
use naga::{Expression, Module};
use naga_edit::declared::LengthConstant;
use naga_interp::overrides;
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;

use super::EmitError;
use preshade_plan::plan_file::Target;

/// The constants that have their defaults in each target. All programs of a material agree on them,
/// or a pre-pass would discard other pixels than its main pass.
pub(super) type Fixed = Vec<(Target, Vec<LengthConstant>)>;

pub(super) fn fixed(plan: &Plan, targets: Vec<Target>) -> Fixed {
    let plans = plan.original.as_deref().into_iter().chain([plan]);
    let programs: Vec<&Program> = plans.flat_map(|plan| plan.programs.values()).collect();
    let of_target = |target: Target| {
        let mut found: Vec<LengthConstant> = Vec::new();
        for program in &programs {
            for length in &program.declared().lengths {
                let is_expressible = match target {
                    Target::Spirv => !is_composed(program.module(), length),
                    #[cfg(feature = "glsl")]
                    Target::GlslVulkan => {
                        !is_composed(program.module(), length)
                            && super::glsl::lengths::is_expressible(program, length)
                    }
                    _ => false,
                };
                if !is_expressible && !found.contains(length) {
                    found.push(length.clone());
                }
            }
        }
        found
    };
    targets
        .into_iter()
        .map(|target| (target, of_target(target)))
        .collect()
}

/// The program with the defaults of these constants.
pub(super) fn with_defaults(
    program: &Program,
    lengths: &[LengthConstant],
    (file, target): (&str, Target),
) -> Result<Program, EmitError> {
    let failed = |message: String| EmitError::Writer {
        file: file.to_owned(),
        target,
        message,
    };
    let mut declared = program.declared().clone();
    declared.lengths.retain(|length| !lengths.contains(length));
    let mut module = program.module().clone();
    for length in lengths {
        if let Some(of) = length.override_in(&module) {
            module = overrides::fixed(&module, of)
                .ok_or_else(|| failed(format!("the constant `{}` has no default", length.own)))?;
        }
    }
    compact(&mut module, KeepUnused::No);
    let fixed = program.with_module(module);
    let fixed = fixed.map_err(|invalid| failed(invalid.to_string()))?;
    Ok(fixed.with_declared(declared))
}

/// The note on a constant that has its default in a target.
pub(super) fn note(length: &LengthConstant, target: Target) -> String {
    let LengthConstant { id, own, .. } = length;
    let place = match target {
        Target::Spirv | Target::GlslVulkan => {
            format!("{target} cannot express the values of such arrays here")
        }
        _ => "only SPIR-V and Vulkan's GLSL have such arrays".to_owned(),
    };
    format!(
        "the specialisation constant {id}, `{own}`, gives the length of an array: its default is \
         final, as {place}"
    )
}

/// Whether a value of such an array is made of its elements, which are as many as the default.
fn is_composed(module: &Module, length: &LengthConstant) -> bool {
    let name = length.type_name();
    let functions = module.functions.iter().map(|(_, f)| f);
    let functions = functions.chain(module.entry_points.iter().map(|e| &e.function));
    let arenas = functions.map(|f| &f.expressions);
    let mut all = arenas
        .chain([&module.global_expressions])
        .flat_map(|a| a.iter());
    all.any(|(_, e)| match e {
        Expression::Compose { ty, .. } => module.types[*ty].name.as_ref() == Some(&name),
        _ => false,
    })
}
