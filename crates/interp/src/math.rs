//! Operators and built-in functions, computed with the CPU's f32.

use naga::{
    BinaryOperator, Expression, MathFunction, RelationalFunction, ScalarKind, UnaryOperator,
};

use super::number::{Number, single, truncated};
use super::value::{Scalar, Value};
use super::{Stuck, bits, matrix};

fn mismatch<F: Number>(what: &str, scalars: &[Scalar<F>]) -> Stuck {
    Stuck::Type(format!("{what} of {scalars:?}"))
}

pub(crate) fn unary<F: Number>(op: UnaryOperator, value: &Value<F>) -> Result<Value<F>, Stuck> {
    value.map(&mut |s| {
        Ok(match (op, s) {
            (UnaryOperator::Negate, Scalar::F32(v)) => Scalar::F32(v.negated()),
            (UnaryOperator::Negate, Scalar::I32(v)) => Scalar::I32(v.wrapping_neg()),
            (UnaryOperator::LogicalNot, Scalar::Bool(v)) => Scalar::Bool(!v),
            (UnaryOperator::BitwiseNot, Scalar::I32(v)) => Scalar::I32(!v),
            (UnaryOperator::BitwiseNot, Scalar::U32(v)) => Scalar::U32(!v),
            _ => return Err(mismatch("negation", &[s])),
        })
    })
}

/// A binary operator. Matrices are multiplied by columns.
pub fn binary<F: Number>(
    op: BinaryOperator,
    left: &Value<F>,
    right: &Value<F>,
) -> Result<Value<F>, Stuck> {
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
                    .map(|column| dot(left, column).map(Value::number))
                    .collect::<Result<_, _>>()?;
                return Ok(Value::Composite(dots));
            }
            _ => {}
        }
    }
    Value::zip(&[left, right], &mut |s| scalar_binary(op, s[0], s[1]))
}

fn is_matrix<F>(value: &Value<F>) -> bool {
    matches!(value, Value::Composite(columns) if matches!(columns.first(), Some(Value::Composite(_))))
}

fn transform<F: Number>(matrix: &Value<F>, vector: &Value<F>) -> Result<Value<F>, Stuck> {
    let mut sum: Option<Value<F>> = None;
    for (column, factor) in matrix.parts()?.iter().zip(vector.parts()?) {
        let scaled = binary(BinaryOperator::Multiply, column, factor)?;
        sum = Some(match sum {
            None => scaled,
            Some(sum) => binary(BinaryOperator::Add, &sum, &scaled)?,
        });
    }
    sum.ok_or_else(|| Stuck::Type("an empty matrix".to_owned()))
}

fn dot<F: Number>(a: &Value<F>, b: &Value<F>) -> Result<F, Stuck> {
    let mut sum = F::of(0.0);
    for (a, b) in a.floats()?.into_iter().zip(b.floats()?) {
        sum = plus(sum, times(a, b)?)?;
    }
    Ok(sum)
}

fn plus<F: Number>(a: F, b: F) -> Result<F, Stuck> {
    float_binary(BinaryOperator::Add, a, b)
}

fn minus<F: Number>(a: F, b: F) -> Result<F, Stuck> {
    float_binary(BinaryOperator::Subtract, a, b)
}

fn times<F: Number>(a: F, b: F) -> Result<F, Stuck> {
    float_binary(BinaryOperator::Multiply, a, b)
}

fn float_binary<F: Number>(op: BinaryOperator, a: F, b: F) -> Result<F, Stuck> {
    F::binary(op, a, b).ok_or_else(|| Stuck::Type(format!("{op:?} of floats")))
}

fn root<F: Number>(square: F) -> Result<F, Stuck> {
    F::call(MathFunction::Sqrt, &[square])
        .ok_or_else(|| Stuck::Unsupported("a square root".to_owned()))
}

fn scalar_binary<F: Number>(
    op: BinaryOperator,
    a: Scalar<F>,
    b: Scalar<F>,
) -> Result<Scalar<F>, Stuck> {
    use BinaryOperator as B;
    use Scalar::{Bool, F32, I32, U32};
    Ok(match (op, a, b) {
        (B::Add | B::Subtract | B::Multiply | B::Divide | B::Modulo, F32(a), F32(b)) => {
            F32(float_binary(op, a, b)?)
        }
        (B::Add, I32(a), I32(b)) => I32(a.wrapping_add(b)),
        (B::Subtract, I32(a), I32(b)) => I32(a.wrapping_sub(b)),
        (B::Multiply, I32(a), I32(b)) => I32(a.wrapping_mul(b)),
        // In WGSL, a division by zero returns the dividend, and its remainder is zero.
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

fn compare<F: Number>(op: BinaryOperator, a: Scalar<F>, b: Scalar<F>) -> Result<Scalar<F>, Stuck> {
    use std::cmp::Ordering::{Equal, Greater, Less};
    let order = match (a, b) {
        (Scalar::F32(a), Scalar::F32(b)) => {
            let undecided = || Stuck::Undecided(format!("{op:?} of {a:?} and {b:?}"));
            return F::holds(op, a, b).map(Scalar::Bool).ok_or_else(undecided);
        }
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

pub(crate) fn relational<F: Number>(
    fun: RelationalFunction,
    value: &Value<F>,
) -> Result<Value<F>, Stuck> {
    let truths = || -> Result<Vec<bool>, Stuck> {
        match value {
            Value::Composite(parts) => parts.iter().map(Value::truth).collect(),
            one => Ok(vec![one.truth()?]),
        }
    };
    let test = |f: fn(f32) -> bool| {
        value.map(&mut |s| match s {
            Scalar::F32(v) => Ok(Scalar::Bool(f(single(v)?))),
            other => Err(mismatch("a float test", &[other])),
        })
    };
    match fun {
        RelationalFunction::All => Ok(Value::Scalar(Scalar::Bool(truths()?.iter().all(|b| *b)))),
        RelationalFunction::Any => Ok(Value::Scalar(Scalar::Bool(truths()?.iter().any(|b| *b)))),
        RelationalFunction::IsNan => test(f32::is_nan),
        RelationalFunction::IsInf => value.map(&mut |s| match s {
            Scalar::F32(v) => v
                .is_infinity()
                .map(Scalar::Bool)
                .ok_or_else(|| Stuck::Undecided(format!("{v:?}"))),
            other => Err(mismatch("a float test", &[other])),
        }),
    }
}

/// Applies an operation to the values of its operands.
pub(crate) fn operation<F: Number>(
    operation: &Expression,
    operands: &[&Value<F>],
) -> Result<Value<F>, Stuck> {
    match (operation, operands) {
        (Expression::Unary { op, .. }, [x]) => unary(*op, x),
        (Expression::Binary { op, .. }, [a, b]) => binary(*op, a, b),
        (Expression::Relational { fun, .. }, [x]) => relational(*fun, x),
        (Expression::Math { fun, .. }, arguments) => call(*fun, arguments),
        (Expression::As { kind, convert, .. }, [x]) => cast(*kind, *convert, x),
        _ => Err(Stuck::Unsupported(format!("{operation:?}"))),
    }
}

/// A conversion, or a bit cast if it has no width.
pub(crate) fn cast<F: Number>(
    kind: ScalarKind,
    convert: Option<u8>,
    value: &Value<F>,
) -> Result<Value<F>, Stuck> {
    value.map(&mut |s| {
        use Scalar::{Bool, F32, I32, U32};
        Ok(match (convert, kind, s) {
            (None, ScalarKind::Float, I32(v)) => F32(F::of(f32::from_bits(v as u32))),
            (None, ScalarKind::Float, U32(v)) => F32(F::of(f32::from_bits(v))),
            (None, ScalarKind::Sint, F32(v)) => I32(single(v)?.to_bits() as i32),
            (None, ScalarKind::Uint, F32(v)) => U32(single(v)?.to_bits()),
            (_, ScalarKind::Float, F32(v)) => F32(v),
            (_, ScalarKind::Float, I32(v)) => F32(rounded(f32::from((v >> 16) as i16), v as u32)?),
            (_, ScalarKind::Float, U32(v)) => F32(rounded(f32::from((v >> 16) as u16), v)?),
            (_, ScalarKind::Float, Bool(v)) => F32(F::of(f32::from(u8::from(v)))),
            // The nearest number that both an integer and a float can represent (WGSL, section
            // 15.7.6).
            (_, ScalarKind::Sint, F32(v)) => {
                I32(truncated(v)?.clamp(-2_147_483_648.0, 2_147_483_520.0) as i32)
            }
            (_, ScalarKind::Sint, I32(v)) => I32(v),
            (_, ScalarKind::Sint, U32(v)) => I32(v as i32),
            (_, ScalarKind::Sint, Bool(v)) => I32(i32::from(v)),
            (_, ScalarKind::Uint, F32(v)) => U32(truncated(v)?.clamp(0.0, 4_294_967_040.0) as u32),
            (_, ScalarKind::Uint, I32(v)) => U32(v as u32),
            (_, ScalarKind::Uint, U32(v)) => U32(v),
            (_, ScalarKind::Uint, Bool(v)) => U32(u32::from(v)),
            (_, ScalarKind::Bool, F32(_)) => {
                return compare(BinaryOperator::NotEqual, s, F32(F::of(0.0)));
            }
            (_, ScalarKind::Bool, I32(v)) => Bool(v != 0),
            (_, ScalarKind::Bool, U32(v)) => Bool(v != 0),
            (_, ScalarKind::Bool, Bool(v)) => Bool(v),
            (_, kind, s) => return Err(mismatch(&format!("conversion to {kind:?}"), &[s])),
        })
    })
}

/// Converts an integer to a float. `upper` is its upper half. Both halves are exact, and their sum
/// is rounded.
fn rounded<F: Number>(upper: f32, word: u32) -> Result<F, Stuck> {
    let lower = F::of((word & 0xffff) as f32);
    plus(F::of(upper * 65536.0), lower)
}

pub(crate) fn call<F: Number>(
    fun: MathFunction,
    arguments: &[&Value<F>],
) -> Result<Value<F>, Stuck> {
    use MathFunction as M;
    if let Some(done) = bits::call(fun, arguments) {
        return done;
    }
    match fun {
        M::Dot => match arguments[0].parts()?.first() {
            Some(Value::Scalar(Scalar::F32(_))) => {
                dot(arguments[0], arguments[1]).map(Value::number)
            }
            _ => {
                let products = binary(BinaryOperator::Multiply, arguments[0], arguments[1])?;
                let mut parts = products.parts()?.iter().cloned();
                let first = parts.next().unwrap_or(Value::i32(0));
                parts.try_fold(first, |sum, p| binary(BinaryOperator::Add, &sum, &p))
            }
        },
        M::Length => match arguments[0] {
            Value::Scalar(_) => call(M::Abs, arguments),
            vector => root(dot(vector, vector)?).map(Value::number),
        },
        M::Distance => {
            let between = binary(BinaryOperator::Subtract, arguments[0], arguments[1])?;
            call(M::Length, &[&between])
        }
        M::Normalize => {
            let length = root(dot(arguments[0], arguments[0])?)?;
            let direction = binary(BinaryOperator::Divide, arguments[0], &Value::number(length))?;
            direction.map(&mut |part| match part {
                Scalar::F32(part) => Ok(Scalar::F32(part.within(-1.0, 1.0))),
                other => Err(mismatch("a direction", &[other])),
            })
        }
        M::Cross => cross(arguments),
        M::Reflect => {
            let twice = times(F::of(2.0), dot(arguments[1], arguments[0])?)?;
            let along = binary(
                BinaryOperator::Multiply,
                arguments[1],
                &Value::number(twice),
            )?;
            binary(BinaryOperator::Subtract, arguments[0], &along)
        }
        M::Refract => refract(arguments),
        M::FaceForward => {
            let [normal, incident, reference] = three(arguments)?;
            match holds(BinaryOperator::Less, dot(incident, reference)?, F::of(0.0))? {
                true => Ok(normal.clone()),
                false => unary(UnaryOperator::Negate, normal),
            }
        }
        // A structure of the fraction and the rest.
        M::Modf => {
            let whole = call(M::Trunc, arguments)?;
            let fraction = binary(BinaryOperator::Subtract, arguments[0], &whole)?;
            Ok(Value::Composite(vec![fraction, whole]))
        }
        M::Frexp => frexp(arguments),
        M::Outer => {
            let columns = arguments[1].parts()?.iter();
            let columns =
                columns.map(|factor| binary(BinaryOperator::Multiply, arguments[0], factor));
            columns.collect::<Result<_, _>>().map(Value::Composite)
        }
        M::Determinant => matrix::determinant(arguments[0]).map(Value::number),
        M::Inverse => matrix::inverse(arguments[0]),
        M::Transpose => transpose(arguments),
        _ => Value::zip(arguments, &mut |s| by_component(fun, s)),
    }
}

fn cross<F: Number>(arguments: &[&Value<F>]) -> Result<Value<F>, Stuck> {
    let (a, b) = (arguments[0].floats()?, arguments[1].floats()?);
    let [ax, ay, az] = a[..] else {
        return Err(Stuck::Type("cross of no vec3".to_owned()));
    };
    let [bx, by, bz] = b[..] else {
        return Err(Stuck::Type("cross of no vec3".to_owned()));
    };
    Ok(Value::composite(&[
        minus(times(ay, bz)?, times(az, by)?)?,
        minus(times(az, bx)?, times(ax, bz)?)?,
        minus(times(ax, by)?, times(ay, bx)?)?,
    ]))
}

fn refract<F: Number>(arguments: &[&Value<F>]) -> Result<Value<F>, Stuck> {
    let [incident, normal, ratio] = three(arguments)?;
    let ratio = ratio.float()?;
    let along = dot(normal, incident)?;
    let square = beyond_total(along, ratio)?;
    if holds(BinaryOperator::Less, square, F::of(0.0))? {
        return binary(
            BinaryOperator::Multiply,
            incident,
            &Value::number(F::of(0.0)),
        );
    }
    let back = plus(times(ratio, along)?, root(square)?)?;
    let bent = binary(BinaryOperator::Multiply, incident, &Value::number(ratio))?;
    let back = binary(BinaryOperator::Multiply, normal, &Value::number(back))?;
    binary(BinaryOperator::Subtract, &bent, &back)
}

/// `frexp`: a structure of fraction and exponent.
fn frexp<F: Number>(arguments: &[&Value<F>]) -> Result<Value<F>, Stuck> {
    let mut exponents = Vec::new();
    let fraction = arguments[0].map(&mut |s| match s {
        Scalar::F32(v) => {
            let exponent = exponent(single(v)?);
            exponents.push(Value::i32(exponent));
            Ok(Scalar::F32(shifted(v, -exponent)?))
        }
        other => Err(mismatch("a fraction", &[other])),
    })?;
    let exponents = match (&fraction, exponents.pop()) {
        (Value::Scalar(_), Some(one)) => one,
        (_, last) => {
            exponents.extend(last);
            Value::Composite(exponents)
        }
    };
    Ok(Value::Composite(vec![fraction, exponents]))
}

fn transpose<F: Number>(arguments: &[&Value<F>]) -> Result<Value<F>, Stuck> {
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

/// Squared cosine of the refracted direction. Negative for total reflection.
fn beyond_total<F: Number>(along: F, ratio: F) -> Result<F, Stuck> {
    let sine = minus(F::of(1.0), times(along, along)?)?;
    minus(F::of(1.0), times(times(ratio, ratio)?, sine)?)
}

/// A decision within a function of whole vectors, which the components of its result do not show.
/// `None` if it makes none.
pub(crate) fn turns<F: Number>(
    fun: MathFunction,
    arguments: &[&Value<F>],
) -> Result<Option<bool>, Stuck> {
    let turned_on = match fun {
        MathFunction::Refract => {
            let [incident, normal, ratio] = three(arguments)?;
            beyond_total(dot(normal, incident)?, ratio.float()?)?
        }
        MathFunction::FaceForward => {
            let [_, incident, reference] = three(arguments)?;
            dot(incident, reference)?
        }
        _ => return Ok(None),
    };
    holds(BinaryOperator::Less, turned_on, F::of(0.0)).map(Some)
}

fn three<'v, F: Number>(arguments: &[&'v Value<F>]) -> Result<[&'v Value<F>; 3], Stuck> {
    let all = <[&Value<F>; 3]>::try_from(arguments);
    all.map_err(|_| Stuck::Type(format!("{} arguments, not 3", arguments.len())))
}

fn holds<F: Number>(op: BinaryOperator, a: F, b: F) -> Result<bool, Stuck> {
    F::holds(op, a, b).ok_or_else(|| Stuck::Undecided(format!("{op:?} of {a:?} and {b:?}")))
}

/// The exponent that leaves a fraction in [0.5, 1). 0 for zero, infinity and NaN.
fn exponent(v: f32) -> i32 {
    if v == 0.0 || !v.is_finite() {
        return 0;
    }
    // First scales subnormal numbers to normal ones.
    let (v, by) = match v.is_normal() {
        true => (v, 0),
        false => (v * 2.0_f32.powi(32), 32),
    };
    ((v.to_bits() >> 23) & 0xff) as i32 - 126 - by
}

/// Multiplies by a power of two, in steps that a float can represent.
fn shifted<F: Number>(v: F, by: i32) -> Result<F, Stuck> {
    let (mut v, mut left) = (v, by.clamp(-400, 400));
    while left != 0 {
        let step = left.clamp(-126, 127);
        v = times(v, F::of(2.0_f32.powi(step)))?;
        left -= step;
    }
    Ok(v)
}

/// A function of scalars, applied to one component.
fn by_component<F: Number>(fun: MathFunction, s: &[Scalar<F>]) -> Result<Scalar<F>, Stuck> {
    use MathFunction as M;
    use Scalar::{F32, I32, U32};
    Ok(match (fun, s) {
        (M::Abs, [I32(v)]) => I32(v.wrapping_abs()),
        (M::Abs, [U32(v)]) => U32(*v),
        (M::Sign, [I32(v)]) => I32(v.signum()),
        (M::Min, [I32(a), I32(b)]) => I32(*a.min(b)),
        (M::Min, [U32(a), U32(b)]) => U32(*a.min(b)),
        (M::Max, [I32(a), I32(b)]) => I32(*a.max(b)),
        (M::Max, [U32(a), U32(b)]) => U32(*a.max(b)),
        (M::Clamp, [I32(v), I32(low), I32(high)]) => I32(*v.max(low).min(high)),
        (M::Clamp, [U32(v), U32(low), U32(high)]) => U32(*v.max(low).min(high)),
        (M::Ldexp, [F32(v), I32(by)]) => F32(shifted(*v, *by)?),
        _ => {
            if let Some(done) = bits::of_integers(fun, s) {
                return Ok(done);
            }
            let floats: Option<Vec<F>> = s
                .iter()
                .map(|s| match s {
                    F32(v) => Some(*v),
                    _ => None,
                })
                .collect();
            let floats = floats.ok_or_else(|| mismatch(&format!("{fun:?}"), s))?;
            F32(F::call(fun, &floats).ok_or_else(|| Stuck::Unsupported(format!("{fun:?}")))?)
        }
    })
}
