//! Two variables of a program in one place: stages may share a binding, or the immediate data, if no
//! stage uses both. A pass that moves code from one stage to the other cannot.

use std::collections::HashSet;

use naga::{AddressSpace, GlobalVariable, Module, ResourceBinding, Span, StorageAccess};

use super::plan::Plan;
use super::reflect;

/// The plan with a binding of its own for each variable. Of several variables of immediate data, all
/// but the first become buffers.
pub(crate) fn separated(plan: &Plan) -> Plan {
    let mut plan = plan.clone();
    for program in plan.programs.values_mut() {
        let mut module = program.module().clone();
        let mut taken = HashSet::new();
        let mut has_immediates = false;
        for (_, global) in module.global_variables.iter_mut() {
            if global.space == AddressSpace::Immediate
                && std::mem::replace(&mut has_immediates, true)
            {
                let access = StorageAccess::LOAD;
                global.space = AddressSpace::Storage { access };
                global.binding = Some(ResourceBinding {
                    group: 0,
                    binding: 0,
                });
            }
            if let Some(at) = &mut global.binding {
                while !taken.insert(*at) {
                    at.binding += 1;
                }
            }
        }
        if let Ok(separate) = program.with_module(module) {
            *program = separate;
        }
    }
    for pass in &mut plan.passes {
        if let Some(program) = plan.programs.get(&pass.program) {
            reflect::fill(pass, program);
        }
    }
    plan
}

/// The second of two variables at one binding, or of immediate data, both in words, and a remedy.
pub(super) fn two_in_one_place(module: &Module) -> Option<(Span, String, &'static str)> {
    let globals = || module.global_variables.iter();
    globals().find_map(|(handle, global)| {
        let is_immediate = global.space == AddressSpace::Immediate;
        let place = match global.binding {
            Some(at) => format!("have group {} binding {}", at.group, at.binding),
            None if is_immediate => {
                "are immediate data (push constants), a block a stage".to_owned()
            }
            None => return None,
        };
        let is_same = |g: &GlobalVariable| match global.binding {
            Some(_) => g.binding == global.binding,
            None => g.space == AddressSpace::Immediate,
        };
        let (_, first) = globals().find(|(h, g)| *h < handle && is_same(g))?;
        let name = |g: &GlobalVariable| g.name.clone().unwrap_or_default();
        let reason = format!(
            "`{}` and `{}` both {place}, so no stage can use both",
            name(first),
            name(global)
        );
        let remedy = match is_immediate {
            true => {
                "declare one block of push constants in both stages, with the members of both at their \
                 offsets"
            }
            false => "give one of them another binding, or declare one variable for both stages",
        };
        Some((module.global_variables.get_span(handle), reason, remedy))
    })
}
