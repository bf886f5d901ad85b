//! Names an expression every 32 levels before a program is written as WGSL or GLSL, because naga's
//! WGSL parser stops at 200 brackets and ours at 180. No value changes.

use naga::proc::TypeResolution;
use naga::{Expression, Function, Handle, Module, TypeInner};
use preshade_plan::program::Program;

/// Maximum levels of unnamed expressions.
const LEVELS: u32 = 32;

/// The module with added names; `None` if none are needed.
pub(crate) fn name_deep_expressions(program: &Program) -> Option<Module> {
    let module = program.module();
    let info = program.info();
    let deep = |f: &Function, info: &naga::valid::FunctionInfo| {
        let names = missing_names(module, f, info);
        (!names.is_empty()).then_some(names)
    };
    let functions: Vec<_> = module
        .functions
        .iter()
        .filter_map(|(h, f)| Some((h, deep(f, &info[h])?)))
        .collect();
    let entries: Vec<_> = module
        .entry_points
        .iter()
        .enumerate()
        .filter_map(|(i, e)| Some((i, deep(&e.function, info.get_entry_point(i))?)))
        .collect();
    if functions.is_empty() && entries.is_empty() {
        return None;
    }
    let mut module = module.clone();
    for (handle, names) in functions {
        name(&mut module.functions[handle], &names);
    }
    for (index, names) in entries {
        name(&mut module.entry_points[index].function, &names);
    }
    Some(module)
}

fn name(function: &mut Function, handles: &[Handle<Expression>]) {
    for handle in handles {
        function
            .named_expressions
            .insert(*handle, "partial".to_owned());
    }
}

/// The expressions to name so that at most [`LEVELS`] nest.
fn missing_names(
    module: &Module,
    function: &Function,
    info: &naga::valid::FunctionInfo,
) -> Vec<Handle<Expression>> {
    let mut levels: Vec<u32> = Vec::with_capacity(function.expressions.len());
    let mut names = Vec::new();
    for (handle, expression) in function.expressions.iter() {
        let mut level = 0;
        for operand in naga_operands::of_expression(expression) {
            level = level.max(levels.get(operand.index()).map_or(0, |l| l + 1));
        }
        let written_apart = function.named_expressions.contains_key(&handle)
            || matches!(
                expression,
                Expression::Load { .. }
                    | Expression::ImageSample { .. }
                    | Expression::ImageLoad { .. }
                    | Expression::ImageQuery { .. }
            );
        if written_apart {
            level = 0;
        } else if level >= LEVELS && is_value(module, &info[handle].ty) {
            names.push(handle);
            level = 0;
        }
        levels.push(level);
    }
    names
}

/// Whether a `let` may hold the type.
fn is_value(module: &Module, ty: &TypeResolution) -> bool {
    matches!(
        ty.inner_with(&module.types),
        TypeInner::Scalar(_)
            | TypeInner::Vector { .. }
            | TypeInner::Matrix { .. }
            | TypeInner::Array { .. }
            | TypeInner::Struct { .. }
    )
}
