//! Interval arithmetic on abstract values, rounded outwards.

use naga::{
    BinaryOperator, Expression, MathFunction, RelationalFunction, ScalarKind, UnaryOperator,
};

use super::known::{Known, Scalar};

/// Applies a unary operator.
pub fn unary(op: UnaryOperator, operand: &Known) -> Known {
    Known::zip(&[operand], &|s| match (op, s) {
        (UnaryOperator::LogicalNot, [Scalar::Bool(b)]) => Some(Scalar::Bool(!b)),
        (UnaryOperator::Negate, [Scalar::Float(a, b)]) => Some(Scalar::Float(-b, -a)),
        (UnaryOperator::Negate, [Scalar::Sint(a, b)]) => Scalar::integer(ScalarKind::Sint, -b, -a),
        (UnaryOperator::BitwiseNot, [Scalar::Uint(a, b)]) if a == b => Some(Scalar::Uint(
            i64::from(!(*a as u32)),
            i64::from(!(*a as u32)),
        )),
        (UnaryOperator::BitwiseNot, [Scalar::Sint(a, b)]) if a == b => Some(Scalar::Sint(!*a, !*a)),
        _ => None,
    })
}

/// Applies a binary operator to scalars, or component by component to vectors. Not for matrices.
pub fn binary(op: BinaryOperator, left: &Known, right: &Known) -> Known {
    use BinaryOperator as B;
    if let (B::LogicalAnd | B::LogicalOr, Some(known)) = (op, one_sided(op, left, right)) {
        return known;
    }
    Known::zip(&[left, right], &|s| match s {
        [Scalar::Float(a, b), Scalar::Float(c, d)] => float(op, (*a, *b), (*c, *d)),
        [Scalar::Sint(a, b), Scalar::Sint(c, d)] => {
            integer(op, ScalarKind::Sint, (*a, *b), (*c, *d))
        }
        [Scalar::Uint(a, b), Scalar::Uint(c, d)] => {
            integer(op, ScalarKind::Uint, (*a, *b), (*c, *d))
        }
        [Scalar::Sint(a, b), Scalar::Uint(c, d)] if a == b && c == d => {
            shifted(op, ScalarKind::Sint, *a, *c)
        }
        [Scalar::Bool(a), Scalar::Bool(b)] => Some(Scalar::Bool(match op {
            B::LogicalAnd | B::And => *a && *b,
            B::LogicalOr | B::InclusiveOr => *a || *b,
            B::Equal => a == b,
            B::NotEqual | B::ExclusiveOr => a != b,
            _ => return None,
        })),
        _ => None,
    })
}

/// `false && x` and `true || x`: one known operand suffices.
fn one_sided(op: BinaryOperator, left: &Known, right: &Known) -> Option<Known> {
    let decides = op == BinaryOperator::LogicalOr;
    [left, right]
        .into_iter()
        .find(|k| k.truth() == Some(decides))
        .cloned()
}

fn compared(op: BinaryOperator, (a, b): (f64, f64), (c, d): (f64, f64)) -> Option<Scalar> {
    use BinaryOperator as B;
    let decided = |yes: bool, no: bool| match (yes, no) {
        (true, _) => Some(Scalar::Bool(true)),
        (_, true) => Some(Scalar::Bool(false)),
        _ => None,
    };
    let same = a == b && c == d && a == c;
    let apart = b < c || d < a;
    match op {
        B::Less => decided(b < c, a >= d),
        B::LessEqual => decided(b <= c, a > d),
        B::Greater => decided(a > d, b <= c),
        B::GreaterEqual => decided(a >= d, b < c),
        B::Equal => decided(same, apart),
        B::NotEqual => decided(apart, same),
        _ => None,
    }
}

fn float(op: BinaryOperator, (a, b): (f64, f64), (c, d): (f64, f64)) -> Option<Scalar> {
    use BinaryOperator as B;
    match op {
        B::Add => Scalar::rounded(a + c, b + d, 1.0),
        B::Subtract => Scalar::rounded(a - d, b - c, 1.0),
        B::Multiply => {
            let (low, high) = ends(&[a * c, a * d, b * c, b * d]);
            Scalar::rounded(low, high, 1.0)
        }
        // WGSL section 15.7.4: 2.5 ULP for divisors of ordinary size.
        B::Divide if c.abs().min(d.abs()) > 2f64.powi(-120) && (c > 0.0) == (d > 0.0) => {
            let (low, high) = ends(&[a / c, a / d, b / c, b / d]);
            Scalar::rounded(low, high, 4.0)
        }
        _ => compared(op, (a, b), (c, d)),
    }
}

fn ends(numbers: &[f64]) -> (f64, f64) {
    let low = numbers.iter().copied().fold(f64::INFINITY, f64::min);
    let high = numbers.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (low, high)
}

fn integer(
    op: BinaryOperator,
    kind: ScalarKind,
    (a, b): (i64, i64),
    (c, d): (i64, i64),
) -> Option<Scalar> {
    use BinaryOperator as B;
    let exact = a == b && c == d;
    match op {
        B::Add => Scalar::integer(kind, a + c, b + d),
        B::Subtract => Scalar::integer(kind, a - d, b - c),
        B::Multiply => {
            let products = [(a, c), (a, d), (b, c), (b, d)].map(|(x, y)| x.saturating_mul(y));
            let low = products.iter().copied().min()?;
            Scalar::integer(kind, low, products.iter().copied().max()?)
        }
        B::Divide if exact && c != 0 => Scalar::integer(kind, a / c, a / c),
        B::Modulo if exact && c != 0 => Scalar::integer(kind, a % c, a % c),
        B::And if exact => Scalar::integer(kind, a & c, a & c),
        B::InclusiveOr if exact => Scalar::integer(kind, a | c, a | c),
        B::ExclusiveOr if exact => Scalar::integer(kind, a ^ c, a ^ c),
        B::ShiftLeft | B::ShiftRight if exact => shifted(op, kind, a, c),
        _ => compared(op, (a as f64, b as f64), (c as f64, d as f64)),
    }
}

fn shifted(op: BinaryOperator, kind: ScalarKind, a: i64, by: i64) -> Option<Scalar> {
    let by = u32::try_from(by).ok().filter(|b| *b < 32)?;
    let value = match op {
        BinaryOperator::ShiftLeft => a.checked_shl(by)?,
        BinaryOperator::ShiftRight => a >> by,
        _ => return None,
    };
    Scalar::integer(kind, value, value)
}

/// Applies a math function, component by component if it works so.
pub fn math(fun: MathFunction, arguments: &[&Known]) -> Known {
    use MathFunction as M;
    match (fun, arguments) {
        (M::Abs | M::Sign | M::Saturate | M::Floor | M::Ceil | M::Trunc, _)
        | (M::Min | M::Max | M::Clamp | M::Step, _) => {
            Known::zip(arguments, &|s| of_components(fun, s))
        }
        (M::Mix, [x, y, t]) => {
            let one = Known::constant(Scalar::float(1.0));
            let rest = binary(BinaryOperator::Subtract, &one, t);
            let (left, right) = (
                binary(BinaryOperator::Multiply, x, &rest),
                binary(BinaryOperator::Multiply, y, t),
            );
            let weighted = binary(BinaryOperator::Add, &left, &right);
            // Some languages compute it this way (WGSL, section 17.5, allows either).
            let step = binary(BinaryOperator::Subtract, y, x);
            let step = binary(BinaryOperator::Multiply, &step, t);
            weighted.join(&binary(BinaryOperator::Add, x, &step))
        }
        (M::Dot, [Known::Parts(x), Known::Parts(y)]) => x
            .iter()
            .zip(y)
            .map(|(x, y)| binary(BinaryOperator::Multiply, x, y))
            .reduce(|a, b| binary(BinaryOperator::Add, &a, &b))
            .unwrap_or_default(),
        _ => Known::Unknown,
    }
}

fn of_components(fun: MathFunction, s: &[Scalar]) -> Option<Scalar> {
    use MathFunction as M;
    use Scalar::{Float, Sint, Uint};
    let min = |a: &Scalar, b: &Scalar| match (a, b) {
        (Float(a, b), Float(c, d)) => Some(Float(a.min(*c), b.min(*d))),
        (Sint(a, b), Sint(c, d)) => Some(Sint(*a.min(c), *b.min(d))),
        (Uint(a, b), Uint(c, d)) => Some(Uint(*a.min(c), *b.min(d))),
        _ => None,
    };
    let max = |a: &Scalar, b: &Scalar| match (a, b) {
        (Float(a, b), Float(c, d)) => Some(Float(a.max(*c), b.max(*d))),
        (Sint(a, b), Sint(c, d)) => Some(Sint(*a.max(c), *b.max(d))),
        (Uint(a, b), Uint(c, d)) => Some(Uint(*a.max(c), *b.max(d))),
        _ => None,
    };
    match (fun, s) {
        (M::Min, [a, b]) => min(a, b),
        (M::Max, [a, b]) => max(a, b),
        (M::Clamp, [x, low, high]) => {
            // If the bounds cross, the languages leave the result open.
            let ordered = match (low, high) {
                (Float(_, l), Float(h, _)) => l <= h,
                (Sint(_, l), Sint(h, _)) | (Uint(_, l), Uint(h, _)) => l <= h,
                _ => false,
            };
            min(&max(x, low)?, high).filter(|_| ordered)
        }
        (M::Saturate, [x]) => min(&max(x, &Float(0.0, 0.0))?, &Float(1.0, 1.0)),
        (M::Abs, [Uint(a, b)]) => Some(Uint(*a, *b)),
        (M::Abs, [Float(a, b)]) => Some(match (*a >= 0.0, *b <= 0.0) {
            (true, _) => Float(*a, *b),
            (_, true) => Float(-b, -a),
            _ => Float(0.0, b.max(-a)),
        }),
        (M::Sign, [Float(a, _)]) if *a > 0.0 => Some(Float(1.0, 1.0)),
        (M::Sign, [Float(_, b)]) if *b < 0.0 => Some(Float(-1.0, -1.0)),
        (M::Floor, [Float(a, b)]) => Some(Float(a.floor(), b.floor())),
        (M::Ceil, [Float(a, b)]) => Some(Float(a.ceil(), b.ceil())),
        (M::Trunc, [Float(a, b)]) => Some(Float(a.trunc(), b.trunc())),
        (M::Step, [Float(a, b), Float(c, d)]) => match (*c >= *b, *d < *a) {
            (true, _) => Some(Float(1.0, 1.0)),
            (_, true) => Some(Float(0.0, 0.0)),
            _ => Some(Float(0.0, 1.0)),
        },
        _ => None,
    }
}

/// Converts a value to 32 bits or to `bool`.
pub fn converted(kind: ScalarKind, operand: &Known) -> Known {
    Known::zip(&[operand], &|s| {
        let [s] = s else { return None };
        match (kind, *s) {
            (ScalarKind::Bool, Scalar::Bool(_)) => Some(*s),
            (ScalarKind::Bool, Scalar::Float(a, b)) => nonzero(a, b),
            (ScalarKind::Bool, Scalar::Sint(a, b) | Scalar::Uint(a, b)) => {
                nonzero(a as f64, b as f64)
            }
            (ScalarKind::Float, Scalar::Float(..)) => Some(*s),
            (ScalarKind::Float, Scalar::Bool(b)) => Some(Scalar::float(f64::from(u8::from(b)))),
            (ScalarKind::Float, Scalar::Sint(a, b) | Scalar::Uint(a, b)) => {
                let is_exact = a.abs().max(b.abs()) <= 1 << 24;
                match is_exact {
                    true => Some(Scalar::Float(a as f64, b as f64)),
                    false => Scalar::rounded(a as f64, b as f64, 1.0),
                }
            }
            (ScalarKind::Sint | ScalarKind::Uint, Scalar::Bool(b)) => {
                Scalar::integer(kind, i64::from(b), i64::from(b))
            }
            (ScalarKind::Sint | ScalarKind::Uint, Scalar::Float(a, b)) => {
                Scalar::integer(kind, a.trunc() as i64, b.trunc() as i64)
            }
            (ScalarKind::Sint | ScalarKind::Uint, Scalar::Sint(a, b) | Scalar::Uint(a, b)) => {
                // Overflow wraps.
                Scalar::integer(kind, a, b)
            }
            _ => None,
        }
    })
}

fn nonzero(a: f64, b: f64) -> Option<Scalar> {
    match (a > 0.0 || b < 0.0, a == 0.0 && b == 0.0) {
        (true, _) => Some(Scalar::Bool(true)),
        (_, true) => Some(Scalar::Bool(false)),
        _ => None,
    }
}

/// `all` and `any`.
pub fn relational(fun: RelationalFunction, argument: &Known) -> Known {
    let op = match fun {
        RelationalFunction::All => BinaryOperator::LogicalAnd,
        RelationalFunction::Any => BinaryOperator::LogicalOr,
        RelationalFunction::IsNan | RelationalFunction::IsInf => return Known::Unknown,
    };
    match argument {
        Known::Parts(parts) => parts
            .iter()
            .cloned()
            .reduce(|a, b| binary(op, &a, &b))
            .unwrap_or_default(),
        scalar => scalar.clone(),
    }
}

/// Whether an integer literal may replace `operand` in `expression`. If the value flows into other
/// numbers we keep the read: it may become a float, and front ends fold float literals on the CPU.
pub fn takes_literal(expression: &Expression, operand: naga::Handle<Expression>) -> bool {
    use BinaryOperator as B;
    match expression {
        Expression::Binary { op, .. } => matches!(
            op,
            B::Equal | B::NotEqual | B::Less | B::LessEqual | B::Greater | B::GreaterEqual
        ),
        Expression::ImageLoad {
            array_index,
            sample,
            level,
            ..
        } => [array_index, sample, level].contains(&&Some(operand)),
        Expression::ImageSample { array_index, .. } => *array_index == Some(operand),
        _ => false,
    }
}
