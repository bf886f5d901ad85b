//! Gives the second program the first one's numbers.

use std::collections::BTreeMap;

use naga::{AddressSpace, Expression, GlobalVariable, Handle, Module, StorageAccess, TypeInner};

use super::Mismatch;
use super::attributes::relocate;
use super::matching::Matcher;
use crate::environment::PassStages;

impl Matcher<'_> {
    /// Their module with our numbers.
    pub(super) fn renamed(
        &self,
        second: PassStages<'_>,
        locations: &BTreeMap<u32, u32>,
    ) -> Result<Module, Mismatch> {
        let mut module = self.theirs.clone();
        for (global, at) in &self.bindings {
            let variable = module.global_variables.get_mut(*global);
            if variable.space == AddressSpace::Immediate {
                variable.space = AddressSpace::Storage {
                    access: StorageAccess::LOAD,
                };
            }
            variable.binding = Some(*at);
        }
        join(&mut module, &self.joined());
        let function = &mut module.entry_points[second.vertex.entry].function;
        for argument in &mut function.arguments {
            if argument.binding.is_some() {
                relocate(&mut argument.binding, locations);
                continue;
            }
            let mut ty = self.theirs.types[argument.ty].clone();
            if let TypeInner::Struct { members, .. } = &mut ty.inner {
                for member in members {
                    relocate(&mut member.binding, locations);
                }
            }
            argument.ty = module.types.insert(ty, naga::Span::UNDEFINED);
        }
        Ok(module)
    }

    /// Textures and samplers with one partner are one variable: an entry point has a binding once.
    fn joined(&self) -> BTreeMap<Handle<GlobalVariable>, Handle<GlobalVariable>> {
        let mut first: BTreeMap<(u32, u32), Handle<GlobalVariable>> = BTreeMap::new();
        let resources = self.bindings.iter().filter(|(global, _)| {
            self.theirs.global_variables[**global].space == AddressSpace::Handle
        });
        let known = resources.map(|(global, at)| {
            let known = *first.entry((at.group, at.binding)).or_insert(*global);
            (*global, known)
        });
        known.collect()
    }
}

/// Reads other variables in place of some.
pub(super) fn join(
    module: &mut Module,
    same: &BTreeMap<Handle<GlobalVariable>, Handle<GlobalVariable>>,
) {
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    for function in functions.chain(entries) {
        for (_, expression) in function.expressions.iter_mut() {
            if let Expression::GlobalVariable(global) = expression
                && let Some(known) = same.get(global)
            {
                *global = *known;
            }
        }
    }
}
