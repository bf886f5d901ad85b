//! The properties that emitted code must share with its program: everything that a pipeline, a bind
//! group or a buffer layout depends on. It ignores function bodies and the names of inputs, members
//! and variables.

use naga::diagnostic_filter::DiagnosticFilterNode;
use naga::{
    AddressSpace, Arena, Binding, Expression, Handle, Literal, Module, ShaderStage, Type, TypeInner,
};
use naga_edit::interface::{self, Io};

use super::varying::Varying;

/// Sorted lines. They are equal if a host cannot distinguish the modules.
pub(crate) fn of(module: &Module) -> Vec<String> {
    let mut lines = Vec::new();
    for entry in &module.entry_points {
        let at = format!("{:?} entry point {}", entry.stage, entry.name);
        lines.push(format!("{at}: workgroup size {:?}", entry.workgroup_size));
        lines.push(format!(
            "{at}: early depth test {:?}",
            entry.early_depth_test
        ));
        // Functions that passes create have no filter of their own, so the module's apply.
        let leaf = entry.function.diagnostic_filter_leaf;
        let mut filters = filters(
            &module.diagnostic_filters,
            leaf.or(module.diagnostic_filter_leaf),
        );
        // Each is of another rule, so their order means nothing.
        filters.sort();
        lines.push(format!("{at}: diagnostics {filters:?}"));
        for input in interface::inputs(module, &entry.function) {
            let flat = entry.stage != ShaderStage::Fragment;
            lines.push(format!("{at}: input {}", io(module, &input, flat)));
        }
        for output in interface::outputs(module, &entry.function) {
            let flat = entry.stage != ShaderStage::Vertex;
            lines.push(format!("{at}: output {}", io(module, &output, flat)));
        }
    }
    for (_, global) in module.global_variables.iter() {
        let place = match (global.space, global.binding) {
            (AddressSpace::Immediate, _) => "immediate data".to_owned(),
            (_, Some(b)) => format!("group {} binding {}", b.group, b.binding),
            _ => continue,
        };
        let ty = layout(module, global.ty);
        lines.push(format!("{place}: {:?} {ty}", global.space));
    }
    for (_, o) in module.overrides.iter() {
        let ty = layout(module, o.ty);
        let value = o.init.map(|init| constant(module, init));
        lines.push(format!(
            "override {:?} {:?}: {ty} = {value:?}",
            o.name, o.id
        ));
    }
    lines.sort();
    lines
}

/// A constant expression without handles: overrides by name, constants by value.
fn constant(module: &Module, e: Handle<Expression>) -> String {
    let expressions = &module.global_expressions;
    match &expressions[e] {
        Expression::Constant(c) => return constant(module, module.constants[*c].init),
        Expression::Override(o) => return format!("override {:?}", module.overrides[*o].name),
        Expression::ZeroValue(ty) => {
            let zero = module.types[*ty].inner.scalar();
            return match zero.and_then(Literal::zero) {
                Some(zero) if matches!(module.types[*ty].inner, TypeInner::Scalar(_)) => {
                    format!("{:?}", Expression::Literal(zero))
                }
                _ => format!("zero {}", layout(module, *ty)),
            };
        }
        Expression::Compose { ty, components } => {
            let parts: Vec<String> = components.iter().map(|c| constant(module, *c)).collect();
            return format!("{}{parts:?}", layout(module, *ty));
        }
        _ => {}
    }
    let mut expression = expressions[e].clone();
    let mut operands = Vec::new();
    naga_operands::map_expression(&mut expression, &mut |operand| {
        operands.push(constant(module, *operand));
        *operand = e;
    });
    // Remove the expression's own handle.
    let stage_file = format!("{expression:?}").replace(&format!("{e:?}"), "_");
    format!("{stage_file}{operands:?}")
}

/// The first line that only one side has.
pub(crate) fn difference(wanted: &[String], found: &[String]) -> Option<String> {
    if wanted == found {
        return None;
    }
    let missing = wanted.iter().find(|l| !found.contains(l));
    let extra = found.iter().find(|l| !wanted.contains(l));
    Some(match (missing, extra) {
        (Some(m), Some(e)) => format!("`{m}` became `{e}`"),
        (Some(m), None) => format!("`{m}` is lost"),
        (None, Some(e)) => format!("`{e}` is new"),
        (None, None) => "something occurs more often than before".to_owned(),
    })
}

/// An input or output. `plain`: interpolation has no meaning here.
fn io(module: &Module, io: &Io, plain: bool) -> String {
    let ty = layout(module, io.ty);
    match (&io.binding, Varying::of(module, io)) {
        (Some(Binding::Location { blend_src, .. }), Some(varying)) => {
            let how = if plain { "" } else { &varying.interpolation };
            format!("location {} {blend_src:?} {ty} {how}", varying.location)
        }
        (binding, _) => format!("{binding:?} {ty}"),
    }
}

/// A type's layout: offsets, sizes and strides without names.
fn layout(module: &Module, ty: Handle<Type>) -> String {
    match &module.types[ty].inner {
        TypeInner::Struct { members, span } => {
            let members: Vec<String> = members
                .iter()
                .map(|m| format!("{}: {}", m.offset, layout(module, m.ty)))
                .collect();
            format!("struct {{ {} }} of {span} bytes", members.join(", "))
        }
        TypeInner::Array { base, size, stride } => {
            let size = match size {
                naga::ArraySize::Constant(n) => n.to_string(),
                naga::ArraySize::Pending(_) => "override".to_owned(),
                naga::ArraySize::Dynamic => "runtime".to_owned(),
            };
            format!("array<{}, {size}> stride {stride}", layout(module, *base))
        }
        TypeInner::BindingArray { base, size } => {
            format!("binding_array<{}, {size:?}>", layout(module, *base))
        }
        TypeInner::Scalar(_) | TypeInner::Vector { .. } | TypeInner::Matrix { .. } => {
            interface::wgsl_type(module, ty)
        }
        inner => format!("{inner:?}"),
    }
}

/// The diagnostic filters that count for `leaf`, innermost first: of each rule the innermost.
pub(crate) fn filters(
    arena: &Arena<DiagnosticFilterNode>,
    leaf: Option<Handle<DiagnosticFilterNode>>,
) -> Vec<(String, String)> {
    let mut counting: Vec<(String, String)> = Vec::new();
    for (severity, rule) in filter_chain(arena, leaf) {
        if counting.iter().all(|(_, known)| *known != rule) {
            counting.push((severity, rule));
        }
    }
    counting
}

/// The chain of diagnostic filters that ends in `leaf`, innermost first.
pub(crate) fn filter_chain(
    arena: &Arena<DiagnosticFilterNode>,
    leaf: Option<Handle<DiagnosticFilterNode>>,
) -> Vec<(String, String)> {
    use naga::diagnostic_filter::{FilterableTriggeringRule as Rule, Severity};
    let mut chain = Vec::new();
    let mut next = leaf;
    while let Some(handle) = next {
        let node = &arena[handle];
        let severity = match node.inner.new_severity {
            Severity::Off => "off",
            Severity::Info => "info",
            Severity::Warning => "warning",
            Severity::Error => "error",
        };
        let rule = match &node.inner.triggering_rule {
            Rule::Standard(
                naga::diagnostic_filter::StandardFilterableTriggeringRule::DerivativeUniformity,
            ) => "derivative_uniformity".to_owned(),
            Rule::Unknown(name) => name.to_string(),
            Rule::User(names) => names.join("."),
        };
        chain.push((severity.to_owned(), rule));
        next = node.parent;
    }
    chain
}

/// The inputs and outputs that SPIR-V keeps, as sorted lines: a location or builtin, a colon, and
/// a type.
#[cfg(feature = "spirv")]
pub(crate) fn interface(module: &Module, stage: ShaderStage, entry: &str) -> Vec<String> {
    let mut lines = Vec::new();
    let mut points = module.entry_points.iter();
    let Some(point) = points.find(|p| p.stage == stage && p.name == entry) else {
        return lines;
    };
    let io = |io: &Io| match &io.binding {
        Some(Binding::Location { location, .. }) => {
            Some(format!("location {location}: {}", layout(module, io.ty)))
        }
        // naga's reader adds the builtins that glslang always declares.
        Some(Binding::BuiltIn(naga::BuiltIn::Position { invariant })) => {
            Some(match *invariant && stage == ShaderStage::Vertex {
                true => "invariant position".to_owned(),
                false => "position".to_owned(),
            })
        }
        Some(Binding::BuiltIn(naga::BuiltIn::FragDepth)) => Some("depth".to_owned()),
        _ => None,
    };
    let inputs = interface::inputs(module, &point.function);
    let outputs = interface::outputs(module, &point.function);
    lines.extend(
        inputs
            .iter()
            .filter_map(|i| Some(format!("input {}", io(i)?))),
    );
    lines.extend(
        outputs
            .iter()
            .filter_map(|o| Some(format!("output {}", io(o)?))),
    );
    lines.sort();
    lines
}

/// The groups and bindings that an entry point uses.
#[cfg(feature = "spirv")]
pub(crate) fn bindings(
    module: &Module,
    info: &naga::valid::ModuleInfo,
    stage: ShaderStage,
    entry: &str,
) -> Vec<String> {
    let mut points = module.entry_points.iter();
    let Some(index) = points.position(|p| p.stage == stage && p.name == entry) else {
        return Vec::new();
    };
    let used = info.get_entry_point(index);
    let globals = module.global_variables.iter();
    globals
        .filter(|(handle, _)| !used[*handle].is_empty())
        .filter_map(|(_, global)| global.binding)
        .map(|b| format!("group {} binding {}", b.group, b.binding))
        .collect()
}
