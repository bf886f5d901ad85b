//! Detects surfaces on the near plane by construction: a position with a literal z of 0, as in
//! full-screen passes and sprites.
//!
//! A float depth format counts bias in steps of the depth itself (Vulkan section 28.10.3, WebGPU
//! section 23.2.12). At depth 0 the step is 0, so a bias has no effect there.

use naga::{
    Binding, BuiltIn, Expression, Function, Handle, Literal, Module, Span, Statement, TypeInner,
};

/// Where a vertex entry point writes a position with a literal z of 0, if it writes no other
/// position.
pub(crate) fn literal_zero_depth(module: &Module, function: &Function) -> Option<Span> {
    let result = function.result.as_ref()?;
    let is_position =
        |b: &Option<Binding>| matches!(b, Some(Binding::BuiltIn(BuiltIn::Position { .. })));
    let member = match &module.types[result.ty].inner {
        TypeInner::Struct { members, .. } => {
            Some(members.iter().position(|m| is_position(&m.binding))? as u32)
        }
        _ if is_position(&result.binding) => None,
        _ => return None,
    };
    let mut written = Vec::new();
    positions(function, &function.body, member, &mut written);
    let zero = |e: &Handle<Expression>| third(module, function, *e).is_some_and(|z| z == 0.0);
    (!written.is_empty() && written.iter().all(zero))
        .then(|| function.expressions.get_span(written[0]))
}

/// The values that become the position: returned, composed into the result, or stored to that
/// member of a local.
fn positions(
    function: &Function,
    block: &naga::Block,
    member: Option<u32>,
    out: &mut Vec<Handle<Expression>>,
) {
    naga_operands::visit(block, &mut |statement| {
        match statement {
            Statement::Return { value: Some(value) } => {
                match (&function.expressions[*value], member) {
                    (Expression::Compose { components, .. }, Some(m)) => {
                        out.extend(components.get(m as usize))
                    }
                    // A returned local: its stores decide.
                    (Expression::Load { .. }, Some(_)) => {}
                    _ => out.push(*value),
                }
            }
            Statement::Store { pointer, value } => {
                if let (Expression::AccessIndex { base, index }, Some(m)) =
                    (&function.expressions[*pointer], member)
                    && *index == m
                    && matches!(function.expressions[*base], Expression::LocalVariable(_))
                {
                    out.push(*value);
                }
            }
            _ => {}
        }
    });
}

/// The third scalar of a composed vector, if it is a literal.
fn third(module: &Module, function: &Function, value: Handle<Expression>) -> Option<f32> {
    let Expression::Compose { components, .. } = &function.expressions[value] else {
        return None;
    };
    // Count from the back, for `vec4(xy, z, w)` and `vec4(x, y, z, w)`.
    let [.., z, _] = components.as_slice() else {
        return None;
    };
    match function.expressions[*z] {
        Expression::Literal(Literal::F32(z)) => Some(z),
        Expression::Constant(c) => match module.global_expressions[module.constants[c].init] {
            Expression::Literal(Literal::F32(z)) => Some(z),
            _ => None,
        },
        _ => None,
    }
}
