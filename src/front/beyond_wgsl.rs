//! Settles two things that GLSL allows and WGSL does not: derivatives in non-uniform control flow,
//! and names that WGSL reserves.

use naga::diagnostic_filter::{
    DiagnosticFilter, DiagnosticFilterNode, FilterableTriggeringRule, Severity,
    StandardFilterableTriggeringRule,
};
use naga::keywords::wgsl::RESERVED;
use naga::{Expression, Function, Handle, Module, Override, SampleLevel, Span};

/// Turns `derivative_uniformity` off (WGSL 2.3) for a GLSL module that takes derivatives. WGSL
/// rejects derivatives in non-uniform control flow; GLSL leaves their values undefined there.
pub(super) fn disable_derivative_uniformity(module: &mut Module) {
    let functions = module.functions.iter().map(|(_, f)| f);
    let entries = module.entry_points.iter().map(|e| &e.function);
    if module.diagnostic_filter_leaf.is_some() || !functions.chain(entries).any(differentiates) {
        return;
    }
    let rule = StandardFilterableTriggeringRule::DerivativeUniformity;
    let node = DiagnosticFilterNode {
        inner: DiagnosticFilter {
            new_severity: Severity::Off,
            triggering_rule: FilterableTriggeringRule::Standard(rule),
        },
        parent: None,
    };
    module.diagnostic_filter_leaf = Some(module.diagnostic_filters.append(node, Span::UNDEFINED));
}

/// Renames overrides whose names WGSL reserves. Their ids stay.
pub(super) fn rename_constants(module: &mut Module) {
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
    for (handle, mut name) in reserved {
        while RESERVED.contains(&name.as_str()) || taken.contains(&name) {
            name.push_str("_0");
        }
        module.overrides[handle].name = Some(name);
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
