//! Detects hashes of large sines, such as `fract(sin(x) * 43758.5)`. WGSL and GLSL allow sines an
//! error, which the factor amplifies beyond the remaining fraction. Each driver then draws
//! different noise.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    BinaryOperator, Expression, Function, Handle, Literal, MathFunction, Module, Statement,
};

use super::material;
use super::reader::Reader;
use preshade_frames::folder::Capture;
use preshade_frames::pass::Pass;

/// From this factor on, an error of a few units in the last place becomes visible in 8 bits.
const LARGE: f64 = 500.0;

/// A description of the frame's functions that take the fraction of a large multiple of a
/// driver-dependent function. `None` if none is found.
pub(super) fn of_frame(capture: &Capture, passes: &[Pass<'_>]) -> Option<String> {
    let used: BTreeSet<usize> = passes
        .iter()
        .flat_map(|p| &p.draws)
        .map(|d| d.pipeline)
        .collect();
    let mut found = BTreeSet::new();
    for index in used {
        let Some(of) = capture.file.render_pipelines.get(index) else {
            continue;
        };
        let name = format!("pipeline-{index}");
        if let Ok(material) = material::read(capture, of, &name, Reader::Author) {
            found.extend(of_module(material.program.module()));
        }
    }
    let found: Vec<String> = found.into_iter().take(3).collect();
    (!found.is_empty()).then(|| found.join(" and "))
}

/// Descriptions of such functions in a module.
fn of_module(module: &Module) -> BTreeSet<String> {
    let helpers = module.functions.iter().map(|(_, f)| f);
    let entries = module.entry_points.iter().map(|e| &e.function);
    let mut found = BTreeSet::new();
    for function in helpers.chain(entries) {
        let stores = stores(&function.body);
        let trace = Trace {
            module,
            function,
            stores,
        };
        for (handle, expression) in function.expressions.iter() {
            if !is_fraction(function, expression) {
                continue;
            }
            if let Some((of, factor)) = trace.amplified(handle) {
                let name = function.name.as_deref().unwrap_or("main");
                found.insert(format!(
                    "`{name}`, which takes the fraction of a {of} times {factor}"
                ));
            }
        }
    }
    found
}

/// Whether an expression is `fract(x)`, `x % y` or `x - floor(x)`.
fn is_fraction(function: &Function, of: &Expression) -> bool {
    match of {
        Expression::Math { fun, .. } => *fun == MathFunction::Fract || *fun == MathFunction::Modf,
        Expression::Binary {
            op: BinaryOperator::Modulo,
            ..
        } => true,
        Expression::Binary {
            op: BinaryOperator::Subtract,
            right,
            ..
        } => matches!(
            function.expressions[*right],
            Expression::Math {
                fun: MathFunction::Floor | MathFunction::Trunc,
                ..
            }
        ),
        _ => false,
    }
}

/// The values stored to each local variable.
fn stores(block: &naga::Block) -> BTreeMap<Handle<Expression>, Vec<Handle<Expression>>> {
    let mut found: BTreeMap<_, Vec<_>> = BTreeMap::new();
    let mut blocks = vec![block];
    while let Some(block) = blocks.pop() {
        for statement in block {
            match statement {
                Statement::Store { pointer, value } => {
                    found.entry(*pointer).or_default().push(*value)
                }
                Statement::Block(inner) => blocks.push(inner),
                Statement::If { accept, reject, .. } => blocks.extend([accept, reject]),
                Statement::Loop {
                    body, continuing, ..
                } => blocks.extend([body, continuing]),
                Statement::Switch { cases, .. } => blocks.extend(cases.iter().map(|c| &c.body)),
                _ => {}
            }
        }
    }
    found
}

/// Walks from a value to its operands.
struct Trace<'m> {
    module: &'m Module,
    function: &'m Function,
    stores: BTreeMap<Handle<Expression>, Vec<Handle<Expression>>>,
}

impl Trace<'_> {
    /// A driver-dependent function behind a value, and the factor between them, if it is at least
    /// [`LARGE`].
    fn amplified(&self, from: Handle<Expression>) -> Option<(&'static str, f64)> {
        let mut seen = BTreeSet::new();
        let mut next = vec![(from, 1.0_f64)];
        while let Some((handle, factor)) = next.pop() {
            if !seen.insert((handle, factor.to_bits())) || seen.len() > 10_000 {
                continue;
            }
            match &self.function.expressions[handle] {
                Expression::Math { fun, arg, .. } if differs(*fun).is_some() => {
                    if factor >= LARGE {
                        return differs(*fun).map(|name| (name, factor));
                    }
                    // A hash of a hash: the inner factor may be the large one.
                    next.push((*arg, 1.0));
                }
                Expression::Binary {
                    op: BinaryOperator::Multiply,
                    left,
                    right,
                } => {
                    for (value, by) in [(left, right), (right, left)] {
                        next.push((*value, factor * self.constant(*by).unwrap_or(1.0)));
                    }
                }
                Expression::Binary { left, right, .. } => {
                    next.extend([(*left, factor), (*right, factor)])
                }
                Expression::Math {
                    arg, arg1, arg2, ..
                } => {
                    next.extend(
                        [Some(*arg), *arg1, *arg2]
                            .into_iter()
                            .flatten()
                            .map(|h| (h, factor)),
                    );
                }
                Expression::Load { pointer } => {
                    let stored = self.stores.get(pointer).into_iter().flatten();
                    next.extend(stored.map(|value| (*value, factor)));
                }
                Expression::Unary { expr: value, .. }
                | Expression::As { expr: value, .. }
                | Expression::Splat { value, .. }
                | Expression::Swizzle { vector: value, .. }
                | Expression::Access { base: value, .. }
                | Expression::AccessIndex { base: value, .. } => next.push((*value, factor)),
                Expression::Compose { components, .. } => {
                    next.extend(components.iter().map(|c| (*c, factor)));
                }
                Expression::Select { accept, reject, .. } => {
                    next.extend([(*accept, factor), (*reject, factor)]);
                }
                _ => {}
            }
        }
        None
    }

    /// The magnitude of a constant, or of its largest component.
    fn constant(&self, of: Handle<Expression>) -> Option<f64> {
        constant(self.module, &self.function.expressions, of)
    }
}

fn constant(module: &Module, all: &naga::Arena<Expression>, of: Handle<Expression>) -> Option<f64> {
    match &all[of] {
        Expression::Literal(Literal::F32(f)) => Some(f64::from(f.abs())),
        Expression::Literal(Literal::F64(f) | Literal::AbstractFloat(f)) => Some(f.abs()),
        Expression::Constant(c) => constant(
            module,
            &module.global_expressions,
            module.constants[*c].init,
        ),
        Expression::Splat { value, .. } => constant(module, all, *value),
        Expression::Compose { components, .. } => {
            let sizes = components.iter().filter_map(|c| constant(module, all, *c));
            sizes.reduce(f64::max)
        }
        _ => None,
    }
}

/// The name of a function with a larger error in WGSL and GLSL than rounding.
fn differs(of: MathFunction) -> Option<&'static str> {
    Some(match of {
        MathFunction::Sin => "sine",
        MathFunction::Cos => "cosine",
        MathFunction::Tan => "tangent",
        MathFunction::Exp | MathFunction::Exp2 => "exponential",
        MathFunction::Log | MathFunction::Log2 => "logarithm",
        MathFunction::Pow => "power",
        _ => return None,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn found(body: &str) -> Vec<String> {
        let text = format!(
            "const K = 43758.5453;
             @fragment fn main(@builtin(position) at: vec4f) -> @location(0) vec4f {{ var x = at.x; {body} }}"
        );
        let module = naga::front::wgsl::parse_str(&text).unwrap();
        of_module(&module).into_iter().collect()
    }

    #[test]
    fn a_hash_of_a_large_sine_is_named() {
        for body in [
            "return vec4f(fract(sin(x) * 43758.5453));",
            "return vec4f(fract(K * sin(dot(at.xy, vec2f(12.9898, 78.233)))));",
            "x = sin(x) * 43758.5453; return vec4f(x - floor(x));",
            "x = cos(x); x *= 1e4; return vec4f((x + 3.0) % 1.0);",
            "let h = fract(sin(at.xyz) * vec3f(43758.5, 22578.1, 19642.3)); return vec4f(h, 1.0);",
            "if x > 2.0 { x = tan(x) * 100.0; } return vec4f(fract(x * 20.0));",
        ] {
            assert_eq!(found(body).len(), 1, "{body}");
        }
        let said = found("return vec4f(fract(sin(x) * 43758.5453));");
        assert_eq!(
            said,
            ["`main`, which takes the fraction of a sine times 43758.546875"]
        );
    }

    #[test]
    fn what_drivers_compute_alike_is_not() {
        for body in [
            "return vec4f(fract(sin(x) * 2.0));",
            "return vec4f(sin(x) * 43758.5453);",
            "return vec4f(fract(x * 43758.5453));",
            "return vec4f(fract(sin(fract(x * 43758.5453))));",
        ] {
            assert_eq!(found(body), [""; 0], "{body}");
        }
    }
}
