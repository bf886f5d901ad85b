//! Evaluates the derivatives of a fragment stage before a discard, for lanes that return on their
//! own.
//!
//! ```text
//! before:  let base = textureSample(albedo, s, in.uv);
//!
//! after:   let albedo_dx = dpdxCoarse(in.uv);
//!          let albedo_dy = dpdyCoarse(in.uv);
//!          if hidden { discard; }
//!          let base = textureSampleGrad(albedo, s, in.uv, albedo_dx, albedo_dy);
//! ```
//!
//! In WGSL a discarded lane continues as a helper, so its neighbours' derivatives would be right
//! without this. naga writes SPIR-V's `OpKill`, which ends the lane, and GLSL ES leaves derivatives
//! after a discard undefined. So we evaluate them first in every language.
//!
//! An implicit sample uses coarse derivatives, one per quad and axis. With them no pixel of the
//! fixtures changed on an NVIDIA H200. With unspecified precision, which that driver compiles as
//! fine, there were differences of 33/255 under 8x anisotropic filtering and 3/255 in ordinary
//! trilinear textures whose coordinates have large second derivatives. The author's own derivatives
//! keep their precision.
//!
//! This is still not `Exact`: no language guarantees that a level of detail from gradients rounds
//! as the implicit one does. On a software rasteriser (llvmpipe of Mesa 22.3) it differs by up to
//! 4/255 with any precision. So the user must give a budget.

use std::collections::HashMap;

use naga::{
    AddressSpace, BinaryOperator, DerivativeAxis, DerivativeControl, Expression, Function, Handle,
    ImageClass, ImageDimension, MathFunction, Module, SampleLevel, Span, Statement, TypeInner,
};

use crate::analysis::effects;
use crate::rebuild::place::{CodeBuilder, Replacement, Replacements};
use preshade_dataflow::graph::effect::{self, Effect};
use preshade_dataflow::graph::{FunctionId, Graph};

/// The expressions of an entry point that take derivatives, in arena order, if all of them can be
/// evaluated first.
///
/// # Errors
/// One cannot: its coordinate depends on a variable, a call or a texture, it is in a called
/// function, or its sample has no variant with gradients.
pub(crate) fn find(graph: &Graph<'_>, entry: usize) -> Result<Vec<Handle<Expression>>, Span> {
    let f = graph.function(FunctionId::EntryPoint(entry));
    let pure = pure(graph.module(), f.function);
    let mut found = Vec::new();
    for (_, node) in f.statements.iter() {
        match node.statement {
            Statement::Emit(range) => {
                for e in range.clone() {
                    let expression = &f.function.expressions[e];
                    let moves = match effect::of_expression(expression) {
                        Some(Effect::Derivative) => pure[e.index()],
                        Some(Effect::ImplicitLod) => {
                            has_gradient_form(graph.module(), f.function, expression)
                                && roots(expression).all(|root| pure[root.index()])
                        }
                        _ => continue,
                    };
                    if !moves {
                        return Err(f.function.expressions.get_span(e));
                    }
                    found.push(e);
                }
            }
            Statement::Call { function, .. } => {
                let callee = FunctionId::Function(*function);
                if let Some(span) = effects::derivative(graph, callee) {
                    return Err(span);
                }
            }
            _ => {}
        }
    }
    found.sort();
    Ok(found)
}

/// Whether each expression depends only on inputs, uniforms and constants, so that its value does
/// not depend on where it is evaluated.
fn pure(module: &Module, function: &Function) -> Vec<bool> {
    let mut pure = vec![false; function.expressions.len()];
    for (e, expression) in function.expressions.iter() {
        pure[e.index()] = match expression {
            Expression::Literal(_)
            | Expression::Constant(_)
            | Expression::Override(_)
            | Expression::ZeroValue(_)
            | Expression::FunctionArgument(_) => true,
            Expression::GlobalVariable(g) => matches!(
                module.global_variables[*g].space,
                AddressSpace::Uniform | AddressSpace::Handle
            ),
            Expression::Compose { .. }
            | Expression::Splat { .. }
            | Expression::Swizzle { .. }
            | Expression::AccessIndex { .. }
            | Expression::Load { .. }
            | Expression::Unary { .. }
            | Expression::Binary { .. }
            | Expression::Select { .. }
            | Expression::Math { .. }
            | Expression::Relational { .. }
            | Expression::As { .. }
            | Expression::Derivative { .. }
            | Expression::ImageQuery { .. } => naga_operands::of_expression(expression)
                .into_iter()
                .all(|o| pure[o.index()]),
            // Also `Access`: the author may have guarded its index.
            _ => false,
        };
    }
    pure
}

/// The operands for the gradients of a sample.
fn roots(expression: &Expression) -> impl Iterator<Item = Handle<Expression>> {
    let (coordinate, bias) = match expression {
        Expression::ImageSample {
            coordinate,
            level: SampleLevel::Bias(bias),
            ..
        } => (Some(*coordinate), Some(*bias)),
        Expression::ImageSample { coordinate, .. } => (Some(*coordinate), None),
        _ => (None, None),
    };
    coordinate.into_iter().chain(bias)
}

/// Whether WGSL has `textureSampleGrad` for a sample; it does not for comparisons, depth textures
/// and 1D textures.
fn has_gradient_form(module: &Module, function: &Function, sample: &Expression) -> bool {
    let Expression::ImageSample {
        image,
        depth_ref: None,
        ..
    } = sample
    else {
        return false;
    };
    let Some(global) = image_variable(function, *image) else {
        return false;
    };
    let inner = match module.types[module.global_variables[global].ty].inner {
        TypeInner::BindingArray { base, .. } => &module.types[base].inner,
        ref inner => inner,
    };
    matches!(
        inner,
        TypeInner::Image {
            dim: ImageDimension::D2 | ImageDimension::D3 | ImageDimension::Cube,
            class: ImageClass::Sampled { multi: false, .. },
            ..
        }
    )
}

fn image_variable(
    function: &Function,
    image: Handle<Expression>,
) -> Option<Handle<naga::GlobalVariable>> {
    match function.expressions[naga_operands::base(&function.expressions, image)] {
        Expression::GlobalVariable(g) => Some(g),
        _ => None,
    }
}

/// Evaluates the derivatives in `taken` (from [`find`]) in the prologue of `function`, with their
/// operands, and returns the replacements in the author's code.
pub(crate) fn take(
    build: &mut CodeBuilder<'_>,
    function: &Function,
    taken: &[Handle<Expression>],
) -> Replacements {
    let expressions = &function.expressions;
    let mut wanted = vec![false; expressions.len()];
    for e in taken {
        match &expressions[*e] {
            sample @ Expression::ImageSample { .. } => {
                roots(sample).for_each(|root| wanted[root.index()] = true);
            }
            _ => wanted[e.index()] = true,
        }
    }
    for (e, expression) in expressions.iter().rev() {
        if wanted[e.index()] {
            for operand in naga_operands::of_expression(expression) {
                wanted[operand.index()] = true;
            }
        }
    }
    let mut moved = Moved::default();
    let mut replacements = Replacements::new();
    for (e, expression) in expressions.iter().filter(|(e, _)| wanted[e.index()]) {
        let mut copy = expression.clone();
        naga_operands::map_expression(&mut copy, &mut |o| {
            if let Some(Replacement::Value(new)) = replacements.get(o) {
                *o = *new;
            }
        });
        let value = moved.append(build, copy);
        replacements.insert(e, Replacement::Value(value));
    }
    for e in taken {
        let sample @ Expression::ImageSample { image, .. } = &expressions[*e] else {
            continue;
        };
        let mut roots = roots(sample).filter_map(|root| match replacements.get(&root) {
            Some(Replacement::Value(value)) => Some((root, *value)),
            _ => None,
        });
        let Some((root, coordinate)) = roots.next() else {
            continue;
        };
        let bias = roots.next().map(|(_, bias)| bias);
        let name = function
            .named_expressions
            .get(&root)
            .cloned()
            .or_else(|| {
                let g = image_variable(function, *image)?;
                build.module().global_variables[g].name.clone()
            })
            .unwrap_or_else(|| "sample".to_owned());
        let mut along = |axis, suffix: &str| {
            let derivative = Expression::Derivative {
                axis,
                ctrl: DerivativeControl::Coarse,
                expr: coordinate,
            };
            let (value, is_new) = moved.append_once(build, derivative);
            if is_new {
                build.name(value, &format!("{name}_{suffix}"));
            }
            let Some(bias) = bias else { return value };
            // One level more is a footprint of twice the size.
            let scale = moved.append(
                build,
                Expression::Math {
                    fun: MathFunction::Exp2,
                    arg: bias,
                    arg1: None,
                    arg2: None,
                    arg3: None,
                },
            );
            moved.append(
                build,
                Expression::Binary {
                    op: BinaryOperator::Multiply,
                    left: value,
                    right: scale,
                },
            )
        };
        let x = along(DerivativeAxis::X, "dx");
        let y = along(DerivativeAxis::Y, "dy");
        replacements.insert(*e, Replacement::Gradients { x, y });
    }
    replacements
}

/// Moved values, each once: every `in.uv` of the author's is a separate expression.
#[derive(Default)]
struct Moved(HashMap<String, Handle<Expression>>);

impl Moved {
    fn append(
        &mut self,
        build: &mut CodeBuilder<'_>,
        expression: Expression,
    ) -> Handle<Expression> {
        self.append_once(build, expression).0
    }

    /// The expression, and whether it is new. naga's expressions have no equality, so we compare
    /// their debug output.
    fn append_once(
        &mut self,
        build: &mut CodeBuilder<'_>,
        expression: Expression,
    ) -> (Handle<Expression>, bool) {
        let key = format!("{expression:?}");
        if let Some(same) = self.0.get(&key) {
            return (*same, false);
        }
        let new = build.expression(expression);
        self.0.insert(key, new);
        (new, true)
    }
}
