//! Operators and built-in functions, on the CPU's own f32.

use naga::{BinaryOperator, MathFunction, RelationalFunction, ScalarKind, UnaryOperator};

use super::Stuck;
use super::value::{Scalar, Value};

fn mismatch(what: &str, scalars: &[Scalar]) -> Stuck {
    Stuck::Type(format!("{what} of {scalars:?}"))
}

/// A unary operator.
pub fn unary(op: UnaryOperator, value: &Value) -> Result<Value, Stuck> {
    value.map(&mut |s| {
        Ok(match (op, s) {
            (UnaryOperator::Negate, Scalar::F32(v)) => Scalar::F32(-v),
            (UnaryOperator::Negate, Scalar::I32(v)) => Scalar::I32(v.wrapping_neg()),
            (UnaryOperator::LogicalNot, Scalar::Bool(v)) => Scalar::Bool(!v),
            (UnaryOperator::BitwiseNot, Scalar::I32(v)) => Scalar::I32(!v),
            (UnaryOperator::BitwiseNot, Scalar::U32(v)) => Scalar::U32(!v),
            _ => return Err(mismatch("negation", &[s])),
        })
    })
}

/// A binary operator; matrix products by columns.
pub fn binary(op: BinaryOperator, left: &Value, right: &Value) -> Result<Value, Stuck> {
    if op == BinaryOperator::Multiply {
        match (is_matrix(left), is_matrix(right)) {
            (true, true) => {
                let columns = right
                    .parts()?
                    .iter()
                    .map(|column| transform(left, column))
                    .collect::<Result<_, _>>()?;
                return Ok(Value::Composite(columns));
            }
            (true, false) if matches!(right, Value::Composite(_)) => return transform(left, right),
            (false, true) if matches!(left, Value::Composite(_)) => {
                let dots = right
                    .parts()?
                    .iter()
                    .map(|column| dot(left, column).map(Value::f32))
                    .collect::<Result<_, _>>()?;
                return Ok(Value::Composite(dots));
            }
            _ => {}
        }
    }
    Value::zip(&[left, right], &mut |s| scalar_binary(op, s[0], s[1]))
}

fn is_matrix(value: &Value) -> bool {
    matches!(value, Value::Composite(columns) if matches!(columns.first(), Some(Value::Composite(_))))
}

fn transform(matrix: &Value, vector: &Value) -> Result<Value, Stuck> {
    let mut sum: Option<Value> = None;
    for (column, factor) in matrix.parts()?.iter().zip(vector.parts()?) {
        let scaled = binary(BinaryOperator::Multiply, column, factor)?;
        sum = Some(match sum {
            None => scaled,
            Some(sum) => binary(BinaryOperator::Add, &sum, &scaled)?,
        });
    }
    sum.ok_or_else(|| Stuck::Type("an empty matrix".to_owned()))
}

fn dot(a: &Value, b: &Value) -> Result<f32, Stuck> {
    let mut sum = 0.0;
    for (a, b) in a.floats()?.iter().zip(b.floats()?) {
        sum += a * b;
    }
    Ok(sum)
}

fn scalar_binary(op: BinaryOperator, a: Scalar, b: Scalar) -> Result<Scalar, Stuck> {
    use BinaryOperator as B;
    use Scalar::{Bool, F32, I32, U32};
    Ok(match (op, a, b) {
        (B::Add, F32(a), F32(b)) => F32(a + b),
        (B::Subtract, F32(a), F32(b)) => F32(a - b),
        (B::Multiply, F32(a), F32(b)) => F32(a * b),
        (B::Divide, F32(a), F32(b)) => F32(a / b),
        (B::Modulo, F32(a), F32(b)) => F32(a % b),
        (B::Add, I32(a), I32(b)) => I32(a.wrapping_add(b)),
        (B::Subtract, I32(a), I32(b)) => I32(a.wrapping_sub(b)),
        (B::Multiply, I32(a), I32(b)) => I32(a.wrapping_mul(b)),
        // WGSL: by zero, the dividend; the remainder is then zero.
        (B::Divide, I32(a), I32(b)) => I32(if b == 0 { a } else { a.wrapping_div(b) }),
        (B::Modulo, I32(a), I32(b)) => I32(if b == 0 { 0 } else { a.wrapping_rem(b) }),
        (B::Add, U32(a), U32(b)) => U32(a.wrapping_add(b)),
        (B::Subtract, U32(a), U32(b)) => U32(a.wrapping_sub(b)),
        (B::Multiply, U32(a), U32(b)) => U32(a.wrapping_mul(b)),
        (B::Divide, U32(a), U32(b)) => U32(a.checked_div(b).unwrap_or(a)),
        (B::Modulo, U32(a), U32(b)) => U32(a.checked_rem(b).unwrap_or(0)),
        (B::And, I32(a), I32(b)) => I32(a & b),
        (B::And, U32(a), U32(b)) => U32(a & b),
        (B::InclusiveOr, I32(a), I32(b)) => I32(a | b),
        (B::InclusiveOr, U32(a), U32(b)) => U32(a | b),
        (B::ExclusiveOr, I32(a), I32(b)) => I32(a ^ b),
        (B::ExclusiveOr, U32(a), U32(b)) => U32(a ^ b),
        (B::ShiftLeft, I32(a), U32(b)) => I32(a.wrapping_shl(b)),
        (B::ShiftLeft, U32(a), U32(b)) => U32(a.wrapping_shl(b)),
        (B::ShiftRight, I32(a), U32(b)) => I32(a.wrapping_shr(b)),
        (B::ShiftRight, U32(a), U32(b)) => U32(a.wrapping_shr(b)),
        (B::And | B::LogicalAnd, Bool(a), Bool(b)) => Bool(a && b),
        (B::InclusiveOr | B::LogicalOr, Bool(a), Bool(b)) => Bool(a || b),
        (_, a, b) => return compare(op, a, b),
    })
}

fn compare(op: BinaryOperator, a: Scalar, b: Scalar) -> Result<Scalar, Stuck> {
    use std::cmp::Ordering::{Equal, Greater, Less};
    let order = match (a, b) {
        (Scalar::F32(a), Scalar::F32(b)) => a.partial_cmp(&b),
        (Scalar::I32(a), Scalar::I32(b)) => Some(a.cmp(&b)),
        (Scalar::U32(a), Scalar::U32(b)) => Some(a.cmp(&b)),
        (Scalar::Bool(a), Scalar::Bool(b)) => Some(a.cmp(&b)),
        _ => return Err(mismatch("comparison", &[a, b])),
    };
    Ok(Scalar::Bool(match op {
        BinaryOperator::Equal => order == Some(Equal),
        BinaryOperator::NotEqual => order != Some(Equal),
        BinaryOperator::Less => order == Some(Less),
        BinaryOperator::LessEqual => matches!(order, Some(Less | Equal)),
        BinaryOperator::Greater => order == Some(Greater),
        BinaryOperator::GreaterEqual => matches!(order, Some(Greater | Equal)),
        _ => return Err(mismatch(&format!("{op:?}"), &[a, b])),
    }))
}

/// A relational function.
pub fn relational(fun: RelationalFunction, value: &Value) -> Result<Value, Stuck> {
    let truths = || -> Result<Vec<bool>, Stuck> {
        match value {
            Value::Composite(parts) => parts.iter().map(Value::truth).collect(),
            one => Ok(vec![one.truth()?]),
        }
    };
    let test = |f: fn(f32) -> bool| {
        value.map(&mut |s| match s {
            Scalar::F32(v) => Ok(Scalar::Bool(f(v))),
            other => Err(mismatch("a float test", &[other])),
        })
    };
    match fun {
        RelationalFunction::All => Ok(Value::Scalar(Scalar::Bool(truths()?.iter().all(|b| *b)))),
        RelationalFunction::Any => Ok(Value::Scalar(Scalar::Bool(truths()?.iter().any(|b| *b)))),
        RelationalFunction::IsNan => test(f32::is_nan),
        RelationalFunction::IsInf => test(f32::is_infinite),
    }
}

/// A conversion, or a bit cast if it has no width.
pub fn cast(kind: ScalarKind, convert: Option<u8>, value: &Value) -> Result<Value, Stuck> {
    value.map(&mut |s| {
        use Scalar::{Bool, F32, I32, U32};
        Ok(match (convert, kind, s) {
            (None, ScalarKind::Float, I32(v)) => F32(f32::from_bits(v as u32)),
            (None, ScalarKind::Float, U32(v)) => F32(f32::from_bits(v)),
            (None, ScalarKind::Sint, F32(v)) => I32(v.to_bits() as i32),
            (None, ScalarKind::Uint, F32(v)) => U32(v.to_bits()),
            (_, ScalarKind::Float, F32(v)) => F32(v),
            (_, ScalarKind::Float, I32(v)) => F32(v as f32),
            (_, ScalarKind::Float, U32(v)) => F32(v as f32),
            (_, ScalarKind::Float, Bool(v)) => F32(f32::from(u8::from(v))),
            (_, ScalarKind::Sint, F32(v)) => I32(v as i32),
            (_, ScalarKind::Sint, I32(v)) => I32(v),
            (_, ScalarKind::Sint, U32(v)) => I32(v as i32),
            (_, ScalarKind::Sint, Bool(v)) => I32(i32::from(v)),
            (_, ScalarKind::Uint, F32(v)) => U32(v as u32),
            (_, ScalarKind::Uint, I32(v)) => U32(v as u32),
            (_, ScalarKind::Uint, U32(v)) => U32(v),
            (_, ScalarKind::Uint, Bool(v)) => U32(u32::from(v)),
            (_, ScalarKind::Bool, F32(v)) => Bool(v != 0.0),
            (_, ScalarKind::Bool, I32(v)) => Bool(v != 0),
            (_, ScalarKind::Bool, U32(v)) => Bool(v != 0),
            (_, ScalarKind::Bool, Bool(v)) => Bool(v),
            (_, kind, s) => return Err(mismatch(&format!("conversion to {kind:?}"), &[s])),
        })
    })
}

/// The fields of a word, `width` bits each from the lowest, each through `decode`.
fn unpack(arguments: &[&Value], width: u32, decode: &dyn Fn(u32) -> f32) -> Result<Value, Stuck> {
    let Value::Scalar(Scalar::U32(word)) = arguments[0] else {
        return Err(Stuck::Type("unpacking no u32".to_owned()));
    };
    let fields = (0..32).step_by(width as usize);
    let fields = fields.map(|shift| decode((word >> shift) & ((1 << width) - 1)));
    Ok(Value::vector(&fields.collect::<Vec<_>>()))
}

/// A 16-bit float (IEEE 754 binary16).
fn half(bits: u32) -> f32 {
    let sign = if bits & 0x8000 == 0 { 1.0 } else { -1.0 };
    let (exponent, fraction) = ((bits >> 10) & 31, (bits & 1023) as f32 / 1024.0);
    sign * match exponent {
        0 => fraction * 2.0_f32.powi(-14),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        e => (1.0 + fraction) * 2.0_f32.powi(e as i32 - 15),
    }
}

/// A built-in function.
pub fn call(fun: MathFunction, arguments: &[&Value]) -> Result<Value, Stuck> {
    use MathFunction as M;
    let float1 = |f: fn(f32) -> f32| {
        Value::zip(&arguments[..1], &mut |s| match s {
            [Scalar::F32(v)] => Ok(Scalar::F32(f(*v))),
            other => Err(mismatch(&format!("{fun:?}"), other)),
        })
    };
    let float2 = |f: fn(f32, f32) -> f32| {
        Value::zip(&arguments[..2], &mut |s| match s {
            [Scalar::F32(a), Scalar::F32(b)] => Ok(Scalar::F32(f(*a, *b))),
            other => Err(mismatch(&format!("{fun:?}"), other)),
        })
    };
    let float3 = |f: fn(f32, f32, f32) -> f32| {
        Value::zip(&arguments[..3], &mut |s| match s {
            [Scalar::F32(a), Scalar::F32(b), Scalar::F32(c)] => Ok(Scalar::F32(f(*a, *b, *c))),
            other => Err(mismatch(&format!("{fun:?}"), other)),
        })
    };
    match fun {
        M::Abs | M::Min | M::Max | M::Clamp | M::Sign => {
            Value::zip(arguments, &mut |s| order(fun, s))
        }
        M::Saturate => float1(|v| v.clamp(0.0, 1.0)),
        M::Cos => float1(f32::cos),
        M::Cosh => float1(f32::cosh),
        M::Sin => float1(f32::sin),
        M::Sinh => float1(f32::sinh),
        M::Tan => float1(f32::tan),
        M::Tanh => float1(f32::tanh),
        M::Acos => float1(f32::acos),
        M::Asin => float1(f32::asin),
        M::Atan => float1(f32::atan),
        M::Atan2 => float2(f32::atan2),
        M::Radians => float1(f32::to_radians),
        M::Degrees => float1(f32::to_degrees),
        M::Ceil => float1(f32::ceil),
        M::Floor => float1(f32::floor),
        M::Round => float1(f32::round_ties_even),
        M::Fract => float1(|v| v - v.floor()),
        M::Trunc => float1(f32::trunc),
        M::Exp => float1(f32::exp),
        M::Exp2 => float1(f32::exp2),
        M::Log => float1(f32::ln),
        M::Log2 => float1(f32::log2),
        M::Pow => float2(f32::powf),
        M::Sqrt => float1(f32::sqrt),
        M::InverseSqrt => float1(|v| 1.0 / v.sqrt()),
        M::Step => float2(|edge, v| if v < edge { 0.0 } else { 1.0 }),
        M::Mix => float3(|a, b, t| a * (1.0 - t) + b * t),
        M::Fma => float3(|a, b, c| a * b + c),
        M::SmoothStep => float3(|low, high, v| {
            let t = ((v - low) / (high - low)).clamp(0.0, 1.0);
            t * t * (3.0 - 2.0 * t)
        }),
        M::Dot => match arguments[0].parts()?.first() {
            Some(Value::Scalar(Scalar::F32(_))) => dot(arguments[0], arguments[1]).map(Value::f32),
            _ => {
                let products = binary(BinaryOperator::Multiply, arguments[0], arguments[1])?;
                let mut parts = products.parts()?.iter().cloned();
                let first = parts.next().unwrap_or(Value::i32(0));
                parts.try_fold(first, |sum, p| binary(BinaryOperator::Add, &sum, &p))
            }
        },
        M::Unpack4x8unorm => unpack(arguments, 8, &|bits| bits as f32 / 255.0),
        M::Unpack4x8snorm => unpack(arguments, 8, &|bits| (bits as i8 as f32 / 127.0).max(-1.0)),
        M::Unpack2x16unorm => unpack(arguments, 16, &|bits| bits as f32 / 65535.0),
        M::Unpack2x16snorm => unpack(arguments, 16, &|bits| {
            (bits as i16 as f32 / 32767.0).max(-1.0)
        }),
        M::Unpack2x16float => unpack(arguments, 16, &half),
        M::Length => dot(arguments[0], arguments[0]).map(|d| Value::f32(d.sqrt())),
        M::Distance => {
            let between = binary(BinaryOperator::Subtract, arguments[0], arguments[1])?;
            dot(&between, &between).map(|d| Value::f32(d.sqrt()))
        }
        M::Normalize => {
            let length = dot(arguments[0], arguments[0])?.sqrt();
            binary(BinaryOperator::Divide, arguments[0], &Value::f32(length))
        }
        M::Cross => {
            let (a, b) = (arguments[0].floats()?, arguments[1].floats()?);
            let [ax, ay, az] = a[..] else {
                return Err(Stuck::Type("cross of no vec3".to_owned()));
            };
            let [bx, by, bz] = b[..] else {
                return Err(Stuck::Type("cross of no vec3".to_owned()));
            };
            Ok(Value::vector(&[
                ay * bz - az * by,
                az * bx - ax * bz,
                ax * by - ay * bx,
            ]))
        }
        M::Reflect => {
            let twice = 2.0 * dot(arguments[1], arguments[0])?;
            let along = binary(BinaryOperator::Multiply, arguments[1], &Value::f32(twice))?;
            binary(BinaryOperator::Subtract, arguments[0], &along)
        }
        M::Transpose => {
            let columns = arguments[0].parts()?;
            let rows = columns
                .first()
                .map_or(Ok(0), |c| c.parts().map(<[_]>::len))?;
            (0..rows)
                .map(|r| {
                    columns
                        .iter()
                        .map(|c| c.parts().map(|p| p[r].clone()))
                        .collect::<Result<_, _>>()
                        .map(Value::Composite)
                })
                .collect::<Result<_, _>>()
                .map(Value::Composite)
        }
        other => Err(Stuck::Unsupported(format!("{other:?}"))),
    }
}

fn order(fun: MathFunction, s: &[Scalar]) -> Result<Scalar, Stuck> {
    use MathFunction as M;
    use Scalar::{F32, I32, U32};
    Ok(match (fun, s) {
        (M::Abs, [F32(v)]) => F32(v.abs()),
        (M::Abs, [I32(v)]) => I32(v.wrapping_abs()),
        (M::Abs, [U32(v)]) => U32(*v),
        (M::Sign, [F32(v)]) => F32(if *v == 0.0 { 0.0 } else { v.signum() }),
        (M::Sign, [I32(v)]) => I32(v.signum()),
        (M::Min, [F32(a), F32(b)]) => F32(a.min(*b)),
        (M::Min, [I32(a), I32(b)]) => I32(*a.min(b)),
        (M::Min, [U32(a), U32(b)]) => U32(*a.min(b)),
        (M::Max, [F32(a), F32(b)]) => F32(a.max(*b)),
        (M::Max, [I32(a), I32(b)]) => I32(*a.max(b)),
        (M::Max, [U32(a), U32(b)]) => U32(*a.max(b)),
        (M::Clamp, [F32(v), F32(low), F32(high)]) => F32(v.max(*low).min(*high)),
        (M::Clamp, [I32(v), I32(low), I32(high)]) => I32(*v.max(low).min(high)),
        (M::Clamp, [U32(v), U32(low), U32(high)]) => U32(*v.max(low).min(high)),
        _ => return Err(mismatch(&format!("{fun:?}"), s)),
    })
}
