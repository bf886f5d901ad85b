//! Finds the normal of a material by its role: the unit vector that meets a light, or the viewer, in
//! a dot product.

use naga::{
    AddressSpace, BinaryOperator, Expression, Handle, MathFunction, ScalarKind, Span, TypeInner,
    VectorSize,
};

use super::authored::{Authored, AuthoredPlace};
use crate::analysis::reach::with_operands;
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use preshade_dataflow::graph::Graph;

/// Every unit vector that a dot product multiplies with a vector of a buffer (a light's direction or
/// position, the camera's place) and that no such vector takes part in. A value is found once,
/// however often it meets one. If there is none, a constant vector counts as a light's.
pub(crate) fn normals(graph: &Graph<'_>, fragment: usize) -> Vec<Authored> {
    let Ok(values) = Values::new(graph, fragment) else {
        return Vec::new();
    };
    let found = meeting(&values, &|light| reads(&values, light).of_buffer);
    match found.is_empty() {
        true => meeting(&values, &|light| is_constant(&values, light)),
        false => found,
    }
}

/// The unit vectors that a dot product multiplies with a light's.
fn meeting(values: &Values<'_, '_>, is_light: &dyn Fn(ValueId) -> bool) -> Vec<Authored> {
    let mut known: Vec<ValueId> = Vec::new();
    let mut found = Vec::new();
    for context in 0..values.contexts.len() {
        let f = values.function(context);
        for (e, expression) in f.function.expressions.iter() {
            let Expression::Math {
                fun: MathFunction::Dot,
                arg,
                arg1: Some(arg1),
                ..
            } = *expression
            else {
                continue;
            };
            if !is_vec3(f.ty(values.graph.module(), arg)) || values.named(context, e).is_none() {
                continue;
            }
            for (normal, light) in [(arg, arg1), (arg1, arg)] {
                let value = |e| values.named(context, e);
                let (Some(as_read), Some(light)) = (value(normal), value(light)) else {
                    continue;
                };
                let normal = source(values, as_read);
                if !known.iter().any(|other| is_same(values, *other, normal))
                    && is_unit(values, normal, DEEPEST)
                    && is_light(light)
                    && reads(values, normal) == INTERPOLATED
                {
                    known.push(normal);
                    let at = [normal, as_read];
                    let mut taken = at.into_iter().find_map(|v| authored(values, v));
                    // A load has no place in the text.
                    if let Some(taken) = taken.as_mut().filter(|t| !t.span.is_defined()) {
                        taken.span = f.function.expressions.get_span(e);
                    }
                    found.extend(taken);
                }
            }
        }
    }
    found
}

/// Values of values that are looked at.
const DEEPEST: u32 = 8;

const INTERPOLATED: LightReads = LightReads {
    of_buffer: false,
    input: true,
};

/// An input or a whole expression, with the author's name for it or its text.
fn authored(values: &Values<'_, '_>, value: ValueId) -> Option<Authored> {
    match &values.values[value].node {
        Node::Input(i) => {
            let input = &values.inputs[*i];
            Some(Authored {
                name: input.name.clone().unwrap_or_default(),
                function: String::new(),
                place: AuthoredPlace::Input(*i),
                path: Vec::new(),
                inner: values.graph.module().types[input.ty].inner.clone(),
                span: Span::UNDEFINED,
                calls: Vec::new(),
            })
        }
        Node::Expression(context, e, path) if path.is_empty() => Authored::at(values, *context, *e),
        _ => None,
    }
}

/// Whether two values are one: the same operation, in two calls or written twice, on the same
/// operands.
fn is_same(values: &Values<'_, '_>, a: ValueId, b: ValueId) -> bool {
    let of = |value: ValueId| match &values.values[value].node {
        Node::Expression(context, e, path) if path.is_empty() => {
            Some((values.contexts[*context].function, *e))
        }
        _ => None,
    };
    let is_normalized = |value: ValueId| {
        of(value).is_some_and(|(id, e)| {
            let f = values.graph.function(id).function;
            let fun = MathFunction::Normalize;
            matches!(&f.expressions[e], Expression::Math { fun: own, .. } if *own == fun)
        })
    };
    let is_one = || (of(a).is_some() && of(a) == of(b)) || (is_normalized(a) && is_normalized(b));
    a == b || (is_one() && values.values[a].operands == values.values[b].operands)
}

/// Whether a value is computed from nothing but literals: a light of a fixed direction.
fn is_constant(values: &Values<'_, '_>, value: ValueId) -> bool {
    let held = with_operands(values, vec![value]);
    let mut held = (0..held.len()).filter(|v| held[*v]);
    held.all(|v| match &values.values[v].node {
        Node::Expression(context, e, _) => {
            let f = values.function(*context).function;
            !matches!(
                f.expressions[*e],
                Expression::ImageSample { .. } | Expression::ImageLoad { .. }
            ) && !is_from_memory(values, *context, *e)
        }
        Node::Version(..) => true,
        _ => false,
    })
}

/// Whether an expression loads from memory that the host fills.
fn is_from_memory(values: &Values<'_, '_>, context: ContextId, e: Handle<Expression>) -> bool {
    let f = values.function(context);
    matches!(f.function.expressions[e], Expression::Load { .. }) && !is_variable(values, context, e)
}

fn is_vec3(inner: &TypeInner) -> bool {
    let TypeInner::Vector { size, scalar } = inner else {
        return false;
    };
    *size == VectorSize::Tri && scalar.kind == ScalarKind::Float
}

/// The value that a variable was given, if it was given one alone.
fn source(values: &Values<'_, '_>, mut value: ValueId) -> ValueId {
    loop {
        let is_copy = match &values.values[value].node {
            Node::Version(..) => true,
            Node::Expression(context, e, path) => {
                path.is_empty() && is_variable(values, *context, *e)
            }
            _ => false,
        };
        match values.values[value].operands[..] {
            [one] if is_copy => value = one,
            _ => return value,
        }
    }
}

/// Whether an expression loads a variable of the shader's.
fn is_variable(values: &Values<'_, '_>, context: ContextId, e: Handle<Expression>) -> bool {
    let f = values.function(context);
    let Expression::Load { pointer } = f.function.expressions[e] else {
        return false;
    };
    let space = f.ty(values.graph.module(), pointer).pointer_space();
    matches!(space, Some(AddressSpace::Function | AddressSpace::Private))
}

/// Whether a value has length 1, or has the direction of such a one: normalised, interpolated, or
/// one of several of these.
fn is_unit(values: &Values<'_, '_>, value: ValueId, depth: u32) -> bool {
    let value = source(values, value);
    let (context, e) = match &values.values[value].node {
        Node::Input(_) => return true,
        Node::Version(..) => return all_unit(values, value, depth),
        Node::Expression(context, e, path) if path.is_empty() => (*context, *e),
        _ => return false,
    };
    let f = values.function(context);
    let is = |e| {
        let value = values.named(context, e);
        depth > 0 && value.is_some_and(|v| is_unit(values, v, depth - 1))
    };
    let is_vector = |e| is_vec3(f.ty(values.graph.module(), e));
    match f.function.expressions[e] {
        Expression::Math { fun, arg, .. } => match fun {
            MathFunction::Normalize => true,
            MathFunction::FaceForward => is(arg),
            _ => false,
        },
        Expression::Unary { expr, .. } => is(expr),
        Expression::Select { accept, reject, .. } => is(accept) && is(reject),
        Expression::Binary {
            op: BinaryOperator::Multiply,
            left,
            right,
        } => match (is_vector(left), is_vector(right)) {
            (true, false) => is(left),
            (false, true) => is(right),
            _ => false,
        },
        // The result of a call is one of the returned values; a load, one of the stored values.
        Expression::CallResult(_) | Expression::Load { .. } => all_unit(values, value, depth),
        _ => false,
    }
}

/// Whether all that a variable or a result may be is of length 1.
fn all_unit(values: &Values<'_, '_>, value: ValueId, depth: u32) -> bool {
    let operands = values.values[value].operands.iter();
    let mut vectors = operands
        .filter(|v| !matches!(values.values[**v].node, Node::Control(..)))
        .peekable();
    depth > 0 && vectors.peek().is_some() && vectors.all(|v| is_unit(values, *v, depth - 1))
}

/// The sources that a value is computed from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct LightReads {
    /// A vector of three or four floats in a buffer.
    of_buffer: bool,
    /// An input that is interpolated.
    input: bool,
}

fn reads(values: &Values<'_, '_>, value: ValueId) -> LightReads {
    let held = with_operands(values, vec![value]);
    let mut reads = LightReads::default();
    for (id, _) in held.iter().enumerate().filter(|(_, held)| **held) {
        match &values.values[id].node {
            Node::Input(_) => reads.input = true,
            Node::Expression(context, e, path) if path.is_empty() => {
                reads.of_buffer |= is_buffer_vector(values, *context, *e);
            }
            _ => {}
        }
    }
    reads
}

/// Whether an expression loads a vector, or a struct that may have one, from a buffer.
fn is_buffer_vector(values: &Values<'_, '_>, context: ContextId, e: Handle<Expression>) -> bool {
    let f = values.function(context);
    let module = values.graph.module();
    let Expression::Load { pointer } = f.function.expressions[e] else {
        return false;
    };
    let is_buffer = matches!(
        f.ty(module, pointer).pointer_space(),
        Some(AddressSpace::Uniform | AddressSpace::Storage { .. } | AddressSpace::Immediate)
    );
    is_buffer
        && match f.ty(module, e) {
            TypeInner::Vector { size, scalar } => {
                *size >= VectorSize::Tri && scalar.kind == ScalarKind::Float
            }
            TypeInner::Struct { .. } => true,
            _ => false,
        }
}
