//! Places where WGSL's run-time checks may change a result: a divisor of 0, or an index beyond its
//! array. Without the checks, the behaviour there depends on the driver.

use std::collections::HashMap;

use naga::{
    ArraySize, BinaryOperator, Block, Expression, Handle, LocalVariable, MathFunction, Scalar,
    ScalarKind, Statement, TypeInner,
};

use preshade_dataflow::graph::counted::{Counted, integer};
use preshade_dataflow::graph::{FunctionGraph, Graph, StmtId};
use preshade_plan::program::Program;
use preshade_plan::safety::Checks;

/// The checks that a program needs: all but those that its text makes needless.
pub fn needed(program: &Program) -> Checks {
    let module = program.module();
    let functions = module.functions.iter().map(|(_, f)| f);
    let mut functions = functions.chain(module.entry_points.iter().map(|e| &e.function));
    let is_checked = |e: &Expression| {
        matches!(
            e,
            Expression::Access { .. }
                | Expression::AccessIndex { index: 1.., .. }
                | Expression::Binary {
                    op: BinaryOperator::Divide | BinaryOperator::Modulo,
                    ..
                }
        )
    };
    if !functions.any(|f| f.expressions.iter().any(|(_, e)| is_checked(e))) {
        return Checks::default();
    }
    let graph = Graph::build(program);
    let each = graph.functions().iter().map(|f| {
        let loops = f.statements.iter().filter_map(|(id, node)| {
            matches!(node.statement, Statement::Loop { .. })
                .then_some((std::ptr::from_ref(node.statement), id))
        });
        let mut walk = Walk {
            graph: &graph,
            f,
            loops: loops.collect(),
            counters: Vec::new(),
            found: Checks::default(),
        };
        walk.block(&f.function.body);
        walk.found
    });
    each.fold(Checks::default(), Checks::or)
}

/// A walk through a function's statements.
struct Walk<'g, 'p> {
    graph: &'g Graph<'p>,
    f: &'g FunctionGraph<'p>,
    loops: HashMap<*const Statement, StmtId>,
    /// The counters of the loops around, with the values that they have here.
    counters: Vec<(Handle<LocalVariable>, [i64; 2])>,
    found: Checks,
}

impl Walk<'_, '_> {
    fn block(&mut self, block: &Block) {
        for statement in block {
            self.statement(statement);
        }
    }

    fn statement(&mut self, statement: &Statement) {
        match statement {
            Statement::Emit(range) => {
                for expression in range.clone() {
                    self.expression(expression);
                }
            }
            Statement::Loop {
                body, continuing, ..
            } => {
                let counter = self.counter(statement, body);
                let mut is_tested = false;
                for inner in body {
                    self.statement(inner);
                    // From its test on, the counter is below its bound.
                    if matches!(inner, Statement::If { .. }) && !is_tested {
                        is_tested = true;
                        self.counters.extend(counter);
                    }
                }
                if is_tested && counter.is_some() {
                    self.counters.pop();
                }
                self.block(continuing);
            }
            other => {
                for inner in naga_operands::blocks(other) {
                    self.block(inner);
                }
            }
        }
    }

    /// The counter of a loop that steps it in `continuing` alone.
    fn counter(
        &self,
        statement: &Statement,
        body: &Block,
    ) -> Option<(Handle<LocalVariable>, [i64; 2])> {
        let id = self.loops.get(&std::ptr::from_ref(statement))?;
        let counted = Counted::of(self.graph.module(), self.f, *id)?;
        let variable = counted.counter;
        (!self.writes(body, variable)).then_some((variable, counted.range()?))
    }

    /// Whether a block may write a local: it stores to it, or gives its address away.
    fn writes(&self, block: &Block, variable: Handle<LocalVariable>) -> bool {
        let is_it = |e: Handle<Expression>| matches!(self.f.function.expressions[e], Expression::LocalVariable(v) if v == variable);
        block.iter().any(|statement| match statement {
            Statement::Store { pointer, .. } => is_it(*pointer),
            Statement::Call { arguments, .. } => arguments.iter().any(|a| is_it(*a)),
            other => naga_operands::blocks(other)
                .into_iter()
                .any(|inner| self.writes(inner, variable)),
        })
    }

    fn expression(&mut self, expression: Handle<Expression>) {
        match self.f.function.expressions[expression] {
            Expression::Binary {
                op: BinaryOperator::Divide | BinaryOperator::Modulo,
                left,
                right,
            } => {
                let is_integer = self
                    .scalar(expression)
                    .is_some_and(|s| matches!(s.kind, ScalarKind::Sint | ScalarKind::Uint));
                self.found.divisors |= is_integer && !self.divides(left, right);
            }
            Expression::Access { base, index } => {
                self.found.indices |= !self.is_within(base, index);
            }
            // A binding has one element at least.
            Expression::AccessIndex { base, index: 1.. } => {
                self.found.indices |= self.is_runtime_sized(base)
            }
            _ => {}
        }
    }

    fn scalar(&self, e: Handle<Expression>) -> Option<Scalar> {
        self.f.ty(self.graph.module(), e).scalar()
    }

    /// Whether a quotient is one without a check.
    fn divides(&self, left: Handle<Expression>, right: Handle<Expression>) -> bool {
        match &self.f.function.expressions[right] {
            Expression::Splat { value, .. } => return self.divides(left, *value),
            Expression::Compose { components, .. } => {
                return components.iter().all(|c| self.divides(left, *c));
            }
            _ => {}
        }
        let Some([low, high]) = self.range(right) else {
            return false;
        };
        let is_zero = low <= 0 && high >= 0;
        let is_signed = self
            .scalar(right)
            .is_some_and(|s| s.kind == ScalarKind::Sint);
        let overflows = is_signed
            && low <= -1
            && high >= -1
            && self
                .range(left)
                .is_none_or(|[low, _]| low <= i64::from(i32::MIN));
        !is_zero && !overflows
    }

    /// The type of a value, or of the target of a pointer.
    fn pointed(&self, e: Handle<Expression>) -> &TypeInner {
        let module = self.graph.module();
        match self.f.ty(module, e) {
            TypeInner::Pointer { base, .. } => &module.types[*base].inner,
            inner => inner,
        }
    }

    /// Whether the length of an array is that of the bound buffer.
    fn is_runtime_sized(&self, array: Handle<Expression>) -> bool {
        matches!(
            self.pointed(array),
            TypeInner::Array {
                size: ArraySize::Dynamic,
                ..
            }
        )
    }

    /// Whether an index is one of `base`.
    fn is_within(&self, base: Handle<Expression>, index: Handle<Expression>) -> bool {
        let length = match self.pointed(base) {
            TypeInner::Vector { size, .. }
            | TypeInner::ValuePointer {
                size: Some(size), ..
            } => i64::from(*size as u8),
            TypeInner::Matrix { columns, .. } => i64::from(*columns as u8),
            TypeInner::Array {
                size: ArraySize::Constant(length),
                ..
            } => i64::from(length.get()),
            _ => return false,
        };
        self.range(index)
            .is_some_and(|[low, high]| low >= 0 && high < length)
    }

    /// The smallest and the largest value of a 32-bit integer; `None`: it is none.
    fn range(&self, e: Handle<Expression>) -> Option<[i64; 2]> {
        let whole = match self.scalar(e)? {
            Scalar::U32 => [0, i64::from(u32::MAX)],
            Scalar::I32 => [i64::from(i32::MIN), i64::from(i32::MAX)],
            _ => return None,
        };
        let found = self.computed(e, whole);
        // A result outside of the type wraps around.
        let fits = |[low, high]: &[i64; 2]| whole[0] <= *low && *low <= *high && *high <= whole[1];
        Some(found.filter(fits).unwrap_or(whole))
    }

    fn computed(&self, e: Handle<Expression>, whole: [i64; 2]) -> Option<[i64; 2]> {
        let module = self.graph.module();
        if let Some(value) = integer(module, self.f, e) {
            return Some([value; 2]);
        }
        match self.f.function.expressions[e] {
            Expression::Load { pointer } => match self.f.function.expressions[pointer] {
                Expression::LocalVariable(v) => {
                    let known = self
                        .counters
                        .iter()
                        .rev()
                        .find(|(counter, _)| *counter == v);
                    known.map(|(_, range)| *range)
                }
                _ => None,
            },
            Expression::As { expr, .. } => self.range(expr),
            Expression::Select { accept, reject, .. } => {
                let ([a, b], [c, d]) = (self.range(accept)?, self.range(reject)?);
                Some([a.min(c), b.max(d)])
            }
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                ..
            } => self.math(fun, [Some(arg), arg1, arg2]),
            Expression::Binary { op, left, right } => {
                let ([a, b], [c, d]) = (self.range(left)?, self.range(right)?);
                match op {
                    BinaryOperator::Add => Some([a + c, b + d]),
                    BinaryOperator::Subtract => Some([a - d, b - c]),
                    BinaryOperator::Multiply => {
                        let all = [a, b].map(|x| [c, d].map(|y| x.checked_mul(y)));
                        let all = all.into_iter().flatten().collect::<Option<Vec<_>>>()?;
                        Some([*all.iter().min()?, *all.iter().max()?])
                    }
                    BinaryOperator::Divide if a >= 0 && c > 0 => Some([a / d, b / c]),
                    BinaryOperator::Modulo if c > 0 => match a >= 0 {
                        true => Some([0, b.min(d - 1)]),
                        false => Some([1 - d, d - 1]),
                    },
                    BinaryOperator::And if c >= 0 => Some([0, d]),
                    BinaryOperator::And if a >= 0 => Some([0, b]),
                    BinaryOperator::ShiftRight if a >= 0 && c == d && c < 32 => {
                        Some([a >> c, b >> c])
                    }
                    _ => None,
                }
            }
            _ => Some(whole),
        }
    }

    fn math(&self, fun: MathFunction, args: [Option<Handle<Expression>>; 3]) -> Option<[i64; 2]> {
        let range = |i: usize| self.range(args[i]?);
        let [a, b] = range(0)?;
        match fun {
            MathFunction::Min => range(1).map(|[c, d]| [a.min(c), b.min(d)]),
            MathFunction::Max => range(1).map(|[c, d]| [a.max(c), b.max(d)]),
            MathFunction::Clamp => {
                let ([c, _], [_, d]) = (range(1)?, range(2)?);
                let low = a.max(c).min(d);
                Some([low, b.min(d).max(low)])
            }
            _ => None,
        }
    }
}

#[cfg(test)]
#[allow(clippy::panic)]
mod tests {
    use std::sync::Arc;

    use preshade_plan::program::Program;
    use preshade_plan::safety::Checks;
    use shader_text::source::{Language, SourceMap};

    fn needed(body: &str) -> Checks {
        let text = format!(
            "struct U {{ k: i32, n: u32, v: vec4<f32>, m: mat4x4<f32> }}
             @group(0) @binding(0) var<uniform> u: U;
             @group(0) @binding(1) var<storage> s: array<f32>;
             struct Tail {{ count: u32, rest: array<vec2<f32>> }}
             @group(0) @binding(2) var<storage> tail: Tail;
             const TABLE = array<f32, 4>(1.0, 2.0, 3.0, 4.0);
             @fragment fn fs(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {{
               var t = TABLE; var x = 0.0; {body} return vec4(x); }}"
        );
        let module = naga::front::wgsl::parse_str(&text);
        let program = module.map_err(|e| e.to_string()).and_then(|module| {
            Program::new(module, Arc::new(SourceMap::new()), Language::Wgsl)
                .map_err(|e| e.to_string())
        });
        super::needed(&program.unwrap_or_else(|error| panic!("{body}: {error}")))
    }

    #[test]
    fn what_the_text_excludes_needs_no_check() {
        let (divisors, indices) = (
            Checks {
                divisors: true,
                indices: false,
            },
            Checks {
                divisors: false,
                indices: true,
            },
        );
        let none = Checks::default();
        let cases = [
            ("x = f32(7 / u.k);", divisors),
            ("x = f32(u.n % u32(u.k));", divisors),
            ("x = f32(u.k / 3);", none),
            ("x = f32(u.k / -1);", divisors),
            ("x = f32(u.n / max(u.n, 1u));", none),
            ("x = f32(u.k / max(u.k, 0));", divisors),
            ("x = f32((vec2(u.k) / vec2(2, 3)).x);", none),
            ("x = f32((vec2(u.k) / vec2(2, u.k)).x);", divisors),
            ("x = 1.0 / f32(u.k);", none),
            ("x = t[u.n];", indices),
            ("x = t[u.n & 3u];", none),
            ("x = t[u.n % 4u];", none),
            ("x = t[u.n % 5u];", indices),
            ("x = t[u.k % 4];", indices),
            ("x = t[clamp(u.k, 0, 3)];", none),
            ("x = t[min(u.n, 3u)];", none),
            ("x = t[min(u.k, 3)];", indices),
            ("x = u.v[u.n];", indices),
            ("x = u.m[u.n >> 30u].x;", none),
            ("x = s[u.n];", indices),
            ("x = s[3];", indices),
            ("x = s[0];", none),
            ("let p = &s; x = (*p)[1];", indices),
            ("x = tail.rest[1].y;", indices),
            ("x = tail.rest[0].y;", none),
            ("x = t[3];", none),
            ("for (var i = 0; i < 4; i++) { x += t[i]; }", none),
            ("for (var i = 0; i < 5; i++) { x += t[i]; }", indices),
            ("for (var i = 0; i < 4; i++) { x += t[i + 1]; }", indices),
            ("for (var i = 1; i < 4; i++) { x += t[i - 1]; }", none),
            ("for (var i = 0; i < u.k; i++) { x += t[i]; }", indices),
            (
                "var i = 0; for (; i < 4; i++) { x += 1.0; } x = t[i];",
                indices,
            ),
            ("for (var i = 3; i >= 0; i--) { x += t[i]; }", none),
        ];
        for (body, expected) in cases {
            assert_eq!(needed(body), expected, "{body}");
        }
    }
}
