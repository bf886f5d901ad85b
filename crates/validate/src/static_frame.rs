//! Auxiliary pictures at rest: values that only a host knows, set as an input would be.

use naga::{AddressSpace, Expression, Function, GlobalVariable, Handle, Module};

use preshade_plan::plan::{BindingSource, GpuPass};
use preshade_plan::program::Program;

/// The program of a pass, with the current buffers in place of the previous frame's, and zeros in
/// buffers that only the host fills. Positions and discards depend on neither.
pub(super) fn at_rest(program: &Program, pass: &GpuPass) -> Program {
    let mut module = program.module().clone();
    for binding in &pass.bindings {
        let at = |module: &Module, group: u32, binding: u32| {
            let is_it = |g: &GlobalVariable| {
                g.binding
                    .is_some_and(|b| (b.group, b.binding) == (group, binding))
            };
            let mut all = module.global_variables.iter();
            all.find(|(_, g)| is_it(g)).map(|(handle, _)| handle)
        };
        let Some(own) = at(&module, binding.group, binding.binding) else {
            continue;
        };
        match &binding.source {
            BindingSource::Previous {
                group: Some(group),
                binding,
                ..
            } => match at(&module, *group, binding.unwrap_or_default()) {
                Some(current) => replace(&mut module, own, current),
                None => {
                    if let Some(at) = &mut module.global_variables.get_mut(own).binding {
                        (at.group, at.binding) = (*group, binding.unwrap_or_default());
                    }
                }
            },
            BindingSource::Previous { group: None, .. } => {
                let mut all = module.global_variables.iter();
                let current = all.find(|(_, g)| g.space == AddressSpace::Immediate);
                let current = current.map(|(handle, _)| handle);
                drop(all);
                if let Some(current) = current {
                    replace(&mut module, own, current);
                }
            }
            BindingSource::Host { .. } => {
                let variable = module.global_variables.get_mut(own);
                variable.space = AddressSpace::Private;
                variable.binding = None;
            }
            _ => {}
        }
    }
    // A buffer that a private variable cannot stand for stays, and its reads are not evaluated.
    let made = program.with_module(module);
    made.unwrap_or_else(|_| program.clone())
}

/// Reads one variable in place of another.
pub(super) fn replace(
    module: &mut Module,
    from: Handle<GlobalVariable>,
    to: Handle<GlobalVariable>,
) {
    let change = |function: &mut Function| {
        for (_, expression) in function.expressions.iter_mut() {
            if let Expression::GlobalVariable(variable) = expression
                && *variable == from
            {
                *variable = to;
            }
        }
    };
    module.functions.iter_mut().for_each(|(_, f)| change(f));
    let entries = module.entry_points.iter_mut();
    entries.for_each(|entry| change(&mut entry.function));
}
