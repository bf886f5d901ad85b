//! Proved bounds: how far a value can be from its interpolation anywhere in a triangle.
//!
//! The interpreter runs once for the whole triangle, on numbers that are affine in the barycentric coordinates up to a remainder: affine arithmetic (de Figueiredo and
//! Stolfi 2004) with the two coordinates for noise symbols and what they do not explain in one more. The affine part is kept as its values at the corners, which are
//! the value's own there, so that the remainder *is* the bound: interpolation gives the affine part.
//!
//! Each operation says how far it bends. A smooth function of an affine one with a second derivative of at most `m` is within `m w^2 / 8` of the line between its
//! ends, over a range of width `w`; a product is within a third of the largest product of differences. What jumps within the triangle is only known to lie between its
//! least and its largest; what decides a branch differently within the triangle ends the evaluation.
//!
//! The bound is one of the exact function over real numbers (evaluated in `f64`): an adapter's roundings come on top.

use std::collections::BTreeMap;

use naga::{Function, Module};

use crate::evaluate::{self, Environment, Lookup, Scalar, Stuck, Value};

mod affine;
mod operations;

pub use affine::Affine;

/// Steps of the interpreter for one triangle.
const STEPS: u64 = 200_000;

/// What surrounds an evaluation over a triangle: uniforms and buffers, and textures of which nothing is known.
pub fn environment(resources: BTreeMap<(u32, u32), Value<Affine>>) -> Environment<'static, Affine> {
    Environment {
        resources,
        texture: &|_: &Lookup<'_, Affine>| [Affine::ANYTHING; 4],
        steps: STEPS,
    }
}

/// How far each component of what `function` returns can be from its interpolation in a triangle, at whose corners its arguments are `corners`: shapes as its arguments', floats, integers or
/// booleans. Infinite where there is no bound.
///
/// The triangle is looked at in `parts` squared smaller ones: in each a value is off the interpolation over the whole by what it is off at the corners of the part, and
/// by the remainder there, which falls with the square of the size.
///
/// # Errors
/// [`Stuck`]: an operation that is not known, or a branch that goes several ways within a part.
pub fn over_triangle(
    module: &Module,
    function: &Function,
    corners: [&[Value]; 3],
    environment: &Environment<'_, Affine>,
    parts: u32,
) -> Result<Vec<f64>, Stuck> {
    let [a, b, c] = corners;
    let over = |part: [[f64; 3]; 3]| {
        let arguments = a.iter().zip(b).zip(c);
        let arguments = arguments
            .map(|((a, b), c)| between([a, b, c], &part))
            .collect::<Result<Vec<_>, _>>()?;
        let outcome = evaluate::run(module, function, &arguments, environment)?;
        let mut numbers = Vec::new();
        if let Some(result) = &outcome.result {
            components(result, &mut numbers);
        }
        Ok(numbers)
    };
    if parts <= 1 {
        // The corners of the whole are what it is held against.
        let whole = over([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])?;
        return Ok(whole.into_iter().map(Affine::remainder).collect());
    }
    // Each corner by itself, exactly.
    let ends = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|at| over([at; 3]));
    let [Ok(first), Ok(second), Ok(third)] = ends else {
        return Err(ends
            .into_iter()
            .find_map(Result::err)
            .unwrap_or(Stuck::Steps));
    };
    let mut bounds = vec![0.0_f64; first.len()];
    for part in divided(parts) {
        for (i, number) in over(part)?.into_iter().enumerate() {
            let at = [&first, &second, &third].map(|end| end[i].corners()[0]);
            let interpolated = |weights: [f64; 3]| -> f64 {
                at.iter()
                    .zip(weights)
                    .map(|(end, weight)| end * weight)
                    .sum()
            };
            let off = number.corners().into_iter().zip(part);
            let off = off.map(|(value, weights)| (value - interpolated(weights)).abs());
            bounds[i] = bounds[i].max(off.fold(0.0, f64::max) + number.remainder());
        }
    }
    Ok(bounds)
}

/// Barycentric coordinates of the corners of `n` squared equal parts of a triangle.
fn divided(n: u32) -> impl Iterator<Item = [[f64; 3]; 3]> {
    let at = move |i: u32, j: u32| {
        let n = f64::from(n);
        let (u, v) = (f64::from(i) / n, f64::from(j) / n);
        [1.0 - u - v, u, v]
    };
    (0..n).flat_map(move |i| {
        (0..n - i).flat_map(move |j| {
            let upright = [at(i, j), at(i + 1, j), at(i, j + 1)];
            let inverted = [at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            std::iter::once(upright).chain((i + j + 1 < n).then_some(inverted))
        })
    })
}

/// What the rasteriser makes of a value at three corners, over a part of the triangle: floats between them; the rest has to be the same.
fn between(corners: [&Value; 3], part: &[[f64; 3]; 3]) -> Result<Value<Affine>, Stuck> {
    Ok(match corners {
        [
            Value::Scalar(Scalar::F32(a)),
            Value::Scalar(Scalar::F32(b)),
            Value::Scalar(Scalar::F32(c)),
        ] => {
            let ends = [*a, *b, *c].map(f64::from);
            let at = |weights: &[f64; 3]| ends.iter().zip(weights).map(|(e, w)| e * w).sum();
            Value::number(Affine::between(part.each_ref().map(at)))
        }
        [Value::Scalar(a), Value::Scalar(b), Value::Scalar(c)] => match a {
            Scalar::I32(x) if a == b && b == c => Value::i32(*x),
            Scalar::U32(x) if a == b && b == c => Value::u32(*x),
            Scalar::Bool(x) if a == b && b == c => Value::Scalar(Scalar::Bool(*x)),
            _ => {
                return Err(Stuck::Undecided(
                    "an integer differs between corners".to_owned(),
                ));
            }
        },
        [
            Value::Composite(a),
            Value::Composite(b),
            Value::Composite(c),
        ] => {
            let parts = a.iter().zip(b).zip(c);
            Value::Composite(
                parts
                    .map(|((a, b), c)| between([a, b, c], part))
                    .collect::<Result<_, _>>()?,
            )
        }
        _ => return Err(Stuck::Type("corners of several shapes".to_owned())),
    })
}

fn components(value: &Value<Affine>, out: &mut Vec<Affine>) {
    match value {
        Value::Scalar(Scalar::F32(number)) => out.push(*number),
        Value::Composite(parts) => parts.iter().for_each(|p| components(p, out)),
        _ => {}
    }
}
