//! Finds unbounded slopes. There the last bits in which rasteriser and resolve differ grow: a
//! square root turns 2^-16 into 2^-8.
//!
//! The relative error of a product is as small as its factors', and a square root halves it. A
//! difference has no such bound: after cancellation only the terms' rounding remains (Higham,
//! Accuracy and Stability of Numerical Algorithms, section 1.7). So the rim of a ray-traced sphere,
//! the square root of `b b - c`, is off by steps, and so are arcus functions at 1 and -1. If the
//! code keeps the operand away (`max(.., 0.01)`), there is no finding.

use naga::{BinaryOperator, Expression, Handle, MathFunction, UnaryOperator};

use crate::analysis::operations;
use crate::analysis::range::AllRanges;
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use crate::evaluate::interval::Interval;

/// The first value with an unbounded slope among those computed from rounded values, and a
/// description.
pub fn steep(values: &Values<'_, '_>, is_rounded: &[bool]) -> Option<(ValueId, &'static str)> {
    let pole = |id: ValueId, ranges: Option<&AllRanges>| {
        let (context, e) = whole(values, id)?;
        let expression = &values.function(context).function.expressions[e];
        let Expression::Math { fun, arg, arg1, .. } = expression else {
            return None;
        };
        let of = |e| ranges.map_or(Interval::ANYTHING, |r| r.operand(values, context, e));
        let operands = [
            of(*arg),
            arg1.map_or(Interval::ANYTHING, of),
            Interval::ANYTHING,
        ];
        let pole = operations::math(*fun, operands, 1.0, f64::INFINITY).pole?;
        Some((pole, values.named(context, *arg)?))
    };
    let all = 0..values.values.len();
    let mut found = all.filter(|id| is_rounded[*id]).filter(|id| {
        pole(*id, None).is_some_and(|(pole, operand)| match pole.is_zero {
            true => is_difference(values, is_rounded, operand),
            false => is_rounded[operand],
        })
    });
    let first = found.next()?;
    // Use only ranges from the code, for any input: nothing is known about draw inputs.
    let ranges = AllRanges::new(values, values.cycles(), &[], f64::INFINITY);
    std::iter::once(first).chain(found).find_map(|id| {
        let (pole, _) = pole(id, Some(&ranges))?;
        pole.is_reached.then_some((id, pole.name))
    })
}

/// The expression of a value, if the value is the whole expression.
fn whole(values: &Values<'_, '_>, id: ValueId) -> Option<(ContextId, Handle<Expression>)> {
    match &values.values[id].node {
        Node::Expression(context, e, path) if path.is_empty() => Some((*context, *e)),
        _ => None,
    }
}

/// Whether a value may reach 0 by cancellation: a difference of rounded values, possibly scaled,
/// clamped or stored.
fn is_difference(values: &Values<'_, '_>, is_rounded: &[bool], of: ValueId) -> bool {
    let mut seen = std::collections::HashSet::from([(of, Within::Product)]);
    let mut work = vec![(of, Within::Product)];
    while let Some((id, within)) = work.pop() {
        if !is_rounded[id] {
            continue;
        }
        let next: Vec<(ValueId, Within)> = match whole(values, id) {
            None => through(values, id, within),
            Some((context, e)) => {
                let f = values.function(context).function;
                let named = |e: Handle<Expression>| values.named(context, e);
                let each = |operands: &[Handle<Expression>], within| -> Vec<_> {
                    let operands = operands.iter().filter_map(|e| named(*e));
                    operands.map(|o| (o, within)).collect()
                };
                match &f.expressions[e] {
                    Expression::Binary { op, left, right } => match (op, within) {
                        (BinaryOperator::Subtract, _) => return true,
                        (BinaryOperator::Add, _) => each(&[*left, *right], Within::Sum),
                        // A summand: if it alone is 0, the sum is not.
                        (_, Within::Sum) => Vec::new(),
                        (BinaryOperator::Multiply, _) => each(&[*left, *right], within),
                        (BinaryOperator::Divide, _) => each(&[*left], within),
                        _ => Vec::new(),
                    },
                    Expression::Unary {
                        op: UnaryOperator::Negate,
                        expr,
                    } => match within {
                        Within::Sum => return true,
                        Within::Product => each(&[*expr], within),
                    },
                    Expression::Math {
                        fun,
                        arg,
                        arg1,
                        arg2,
                        ..
                    } => match fun {
                        MathFunction::Fma => each(arg2.as_slice(), Within::Sum),
                        _ if operations::is_an_operand(*fun) => {
                            let operands = [Some(*arg), *arg1, *arg2];
                            each(&operands.into_iter().flatten().collect::<Vec<_>>(), within)
                        }
                        _ => Vec::new(),
                    },
                    Expression::Compose { .. }
                    | Expression::Splat { .. }
                    | Expression::Swizzle { .. }
                    | Expression::Access { .. }
                    | Expression::AccessIndex { .. }
                    | Expression::Select { .. }
                    | Expression::Load { .. }
                    | Expression::CallResult(_)
                    | Expression::FunctionArgument(_) => through(values, id, within),
                    _ => Vec::new(),
                }
            }
        };
        work.extend(next.into_iter().filter(|n| seen.insert(*n)));
    }
    false
}

/// The position of a value in a formula.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Within {
    /// If it is 0, the whole is 0.
    Product,
    /// Another value is added to it.
    Sum,
}

/// Operations that pass one operand on.
fn through(values: &Values<'_, '_>, id: ValueId, within: Within) -> Vec<(ValueId, Within)> {
    match values.values[id].node {
        Node::Control(..) | Node::Input(_) => Vec::new(),
        _ => {
            let operands = values.values[id].operands.iter();
            operands.map(|o| (*o, within)).collect()
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::Arc;

    use crate::core::pass::Facts;
    use crate::core::plan::Plan;
    use crate::core::program::{Language, Program, SourceMap};
    use crate::core::state::MaterialState;
    use crate::pass_named;

    /// The refusal's code of a stage with this body, or the contract after splitting it.
    fn split(body: &str, params: serde_json::Value) -> String {
        let source = format!(
            "@group(0) @binding(0) var<uniform> turn: mat4x4<f32>;
             struct Varyings {{ @builtin(position) position: vec4<f32>, \
                 @location(0) at: vec4<f32>, @location(1) @interpolate(flat) whole: f32 }}
             fn rim(b: f32, c: f32) -> f32 {{ var gap = b * b - c; if c == 0.0 {{ \
                 gap = 1.0; }} return gap; }}
             @vertex fn vs(@location(0) p: vec3<f32>) -> Varyings {{ \
                 return Varyings(turn * vec4(p, 1.0), turn * vec4(p, 2.0), p.x); }}
             @fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {{ \
                 {body} return vec4(shade); }}"
        );
        let module = naga::front::wgsl::parse_str(&source).unwrap();
        let mut sources = SourceMap::new();
        sources.add("test.wgsl", &source);
        let program = Program::new(module, Arc::new(sources), Language::Wgsl).unwrap();
        let plan = Plan::original("test", program, "vs", Some("fs"), &MaterialState::default());
        let pass = pass_named("visibility-buffer").unwrap();
        let facts = Facts::without_ties();
        match pass.run(&plan, &facts, &params) {
            Ok(split) => split.plan.contract.kind().to_owned(),
            Err(refused) => refused.refusals[0].code.clone(),
        }
    }

    #[test]
    fn a_slope_without_a_bound_wants_a_budget() {
        let steep = [
            "let shade = sqrt(max(in.at.x * in.at.x - in.at.y, 0.0));",
            "let shade = sqrt(in.at.x * in.at.x - in.at.y + in.whole);",
            "let shade = sqrt(2.0 * saturate(1.0 - dot(in.at.xy, in.at.xy)));",
            "let shade = sqrt(in.at.x + -in.at.y);",
            "let shade = inverseSqrt(abs(in.at.x - in.whole));",
            "let shade = pow(max(1.0 - in.at.x, 0.0), 1.0 / 2.2);",
            "let shade = acos(dot(in.at.xy, in.at.zw));",
            "let shade = asin(clamp(in.at.x, -1.0, 1.0));",
            "let n = vec3(in.at.xy, 0.0); let z = vec3(n.xy, sqrt(1.0 - n.x * n.x)); \
             let shade = z.z;",
            "var gap = in.at.x; gap -= in.at.y; let shade = sqrt(gap);",
        ];
        let bounded = [
            "let shade = sqrt(in.at.x);",
            "let shade = sqrt(dot(in.at, in.at));",
            "let shade = length(in.at.xy - in.at.zw);",
            // Smith's shadowing: a part of the sum is a difference beside another term.
            "let a2 = in.at.x * in.at.x; let shade = sqrt(in.at.y * in.at.y * (1.0 - a2) + a2);",
            "let shade = sqrt(max(in.at.x - in.at.y, 0.001));",
            "let shade = sqrt(in.whole - 1.0) * in.at.x;",
            "let shade = pow(max(1.0 - in.at.x, 0.0), 5.0);",
            "let shade = pow(max(in.at.x, 0.0), 1.0 / 2.2);",
            "let shade = acos(clamp(in.at.x, -0.9, 0.9));",
        ];
        for body in steep {
            assert_eq!(split(body, serde_json::json!({})), "steep", "{body}");
            let budget = serde_json::json!({ "budget": 0.02 });
            assert_eq!(split(body, budget), "approximate", "{body}");
        }
        for body in bounded {
            assert_eq!(split(body, serde_json::json!({})), "rounding", "{body}");
        }
        // A comparison is reported as a discontinuity first.
        let jumps = "let shade = sqrt(rim(in.at.x, in.at.y));";
        assert_eq!(split(jumps, serde_json::json!({})), "discontinuous");
    }
}
