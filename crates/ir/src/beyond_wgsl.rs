//! Adapts GLSL features that WGSL does not allow: derivatives in non-uniform control flow, names
//! that WGSL reserves, and writable storage blocks in the vertex stage.

use crate::declared::{Declared, SpecConstant};
use naga::diagnostic_filter::{
    DiagnosticFilter, DiagnosticFilterNode, FilterableTriggeringRule, Severity,
    StandardFilterableTriggeringRule,
};
use naga::keywords::wgsl::RESERVED;
use naga::{AddressSpace, ResourceBinding, Statement, StorageAccess};
use naga::{Expression, Function, Handle, Module, Override, SampleLevel, Span};

/// Turns `derivative_uniformity` and `subgroup_uniformity` off (WGSL 2.3) for a GLSL module that
/// takes derivatives or exchanges values between lanes. WGSL rejects both in non-uniform control
/// flow; GLSL defines the latter and leaves the values of the former undefined.
pub fn disable_uniformity(module: &mut Module) {
    if module.diagnostic_filter_leaf.is_some() {
        return;
    }
    let any = |does: fn(&Function) -> bool| {
        let functions = module.functions.iter().map(|(_, f)| f);
        let entries = module.entry_points.iter().map(|e| &e.function);
        functions.chain(entries).any(does)
    };
    let derivatives = StandardFilterableTriggeringRule::DerivativeUniformity;
    let rules = [
        (
            any(differentiates),
            FilterableTriggeringRule::Standard(derivatives),
        ),
        (
            any(exchanges),
            // naga does not know its name.
            FilterableTriggeringRule::Unknown("subgroup_uniformity".into()),
        ),
    ];
    for (_, triggering_rule) in rules.into_iter().filter(|(needed, _)| *needed) {
        let node = DiagnosticFilterNode {
            inner: DiagnosticFilter {
                new_severity: Severity::Off,
                triggering_rule,
            },
            parent: module.diagnostic_filter_leaf,
        };
        module.diagnostic_filter_leaf =
            Some(module.diagnostic_filters.append(node, Span::UNDEFINED));
    }
}

/// Renames overrides whose names WGSL reserves. Their ids stay unchanged.
pub fn rename_constants(module: &mut Module, declared: &mut Declared) {
    let taken: Vec<String> = module
        .overrides
        .iter()
        .filter_map(|(_, o)| o.name.clone())
        .collect();
    let reserved: Vec<(Handle<Override>, String)> = module
        .overrides
        .iter()
        .filter_map(|(handle, o)| Some((handle, o.name.clone()?)))
        .filter(|(_, name)| RESERVED.contains(&name.as_str()))
        .collect();
    for (handle, own) in reserved {
        let mut name = own.clone();
        while RESERVED.contains(&name.as_str()) || taken.contains(&name) {
            name.push_str("_0");
        }
        let of = &mut module.overrides[handle];
        of.name = Some(name.clone());
        if let Some(id) = of.id.map(u32::from) {
            declared.constants.push(SpecConstant { name, own, id });
        }
    }
}

/// Makes storage blocks read-only if no stage writes them. WGSL requires this in the vertex stage
/// (WGSL 7.3), but GLSL's default is to allow writes.
pub fn narrow_storage(modules: &mut [Module]) {
    use std::collections::HashSet;

    let mut written: HashSet<ResourceBinding> = HashSet::new();
    for module in modules.iter() {
        let functions = module.functions.iter().map(|(_, f)| f);
        let entries = module.entry_points.iter().map(|e| &e.function);
        for function in functions.chain(entries) {
            naga_operands::visit(&function.body, &mut |statement| {
                // A pointer in any other statement may be written through.
                let pointers = match statement {
                    Statement::Store { pointer, .. } => vec![*pointer],
                    other => naga_operands::of_statement(other),
                };
                let of = |e| super::inline_main::global_of(&function.expressions, e);
                let globals = pointers.into_iter().filter_map(of);
                written.extend(globals.filter_map(|g| module.global_variables[g].binding));
            });
        }
    }
    for module in modules {
        for (_, global) in module.global_variables.iter_mut() {
            let is_written = global.binding.is_some_and(|b| written.contains(&b));
            if let AddressSpace::Storage { access } = &mut global.space
                && *access == StorageAccess::LOAD | StorageAccess::STORE
                && !is_written
            {
                *access = StorageAccess::LOAD;
            }
        }
    }
}

/// Whether a function takes a derivative, explicitly or to choose a mip level.
fn differentiates(function: &Function) -> bool {
    function.expressions.iter().any(|(_, e)| {
        matches!(
            e,
            Expression::Derivative { .. }
                | Expression::ImageSample {
                    level: SampleLevel::Auto | SampleLevel::Bias(_),
                    gather: None,
                    ..
                }
        )
    })
}

/// Whether a function exchanges values between the lanes of a subgroup.
fn exchanges(function: &Function) -> bool {
    let is_result = |e: &Expression| {
        matches!(
            e,
            Expression::SubgroupBallotResult | Expression::SubgroupOperationResult { .. }
        )
    };
    function.expressions.iter().any(|(_, e)| is_result(e))
}
