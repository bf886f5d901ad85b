//! Proved bounds: how far a value can be from its interpolation anywhere in a triangle.
//!
//! The interpreter runs once for the whole triangle, on numbers that are affine in the barycentric
//! coordinates up to a remainder: affine arithmetic (de Figueiredo and Stolfi 2004) with the two
//! coordinates for noise symbols and what they do not explain in one more. The affine part is kept
//! as its values at the corners, which are the value's own there, so that the remainder *is* the
//! bound: interpolation gives the affine part.
//!
//! Each operation says how far it bends. A smooth function of an affine one with a second
//! derivative of at most `m` is within `m w^2 / 8` of the line between its ends, over a range of
//! width `w`; a product is within a third of the largest product of differences. What jumps within
//! the triangle is only known to lie between its least and its largest; what decides a branch
//! differently within the triangle ends the evaluation.
//!
//! Beside the remainder, which is of the exact function over real numbers (evaluated in `f64`), a
//! number carries how far what an adapter computes may be from it: WGSL's own accuracies, from
//! operation to operation. [`Interval`] is the plain one: only between which numbers a value lies.
//! A comparison, a jump or a conversion to an integer is decided only where all that an adapter may
//! compute lies on one side of it.

use std::collections::BTreeMap;

use naga::{Function, Module};

use crate::{Environment, Lookup, Number, Scalar, Stuck, Value};

mod affine;
mod operations;

pub use super::accuracy::Accuracy;
pub use super::interval::Interval;
pub use affine::Affine;

/// Steps of the interpreter for one triangle.
const STEPS: u64 = 200_000;

/// What surrounds an evaluation over a triangle: uniforms and buffers, and textures of which
/// nothing is known.
pub fn environment(resources: BTreeMap<(u32, u32), Value<Affine>>) -> Environment<'static, Affine> {
    Environment {
        resources: resources.into(),
        texture: &|_: &Lookup<'_, Affine>| [Affine::ANYTHING; 4],
        derivative: None,
        trace: None,
        steps: STEPS,
    }
}

/// How far a component can be from its interpolation in a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// In real numbers; infinite where there is no bound.
    pub max: f64,
    /// What the roundings of an adapter make it more by, at most.
    pub roundings: f64,
}

impl Distance {
    /// There is no bound.
    pub const UNBOUNDED: Self = Self {
        max: f64::INFINITY,
        roundings: f64::INFINITY,
    };

    /// A value and its interpolation both lie in an interval of this width.
    fn new(max: f64, roundings: f64, width: f64) -> Self {
        if max.is_nan() || max.is_infinite() || roundings.is_nan() || roundings.is_infinite() {
            return Self::UNBOUNDED;
        }
        let max = max.min(width);
        Self {
            max,
            roundings: roundings.min(width - max),
        }
    }

    /// The larger of each.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            max: self.max.max(other.max),
            roundings: self.roundings.max(other.roundings),
        }
    }
}

/// How far an interpolated number may be from the exact interpolation, as a part of its largest
/// corner. No specification says; it stands for an interpolation with a few roundings in `f32`, and
/// it is taken to lie between the corners: a centre beside the triangle, as multisampling shades
/// them, is not looked at.
const INTERPOLATION: f64 = 1.0 / (1 << 21) as f64;

/// How far each component of what `function` returns can be from its interpolation in a triangle,
/// at whose corners its arguments are `corners`: shapes as its arguments', floats, integers or
/// booleans. A float has to be the same everywhere; how far it may be off is taken along.
///
/// The triangle is looked at in `parts` squared smaller ones: in each a value is off the
/// interpolation over the whole by what it is off at the corners of the part, and by the remainder
/// there, which falls with the square of the size.
///
/// # Errors
/// [`Stuck`]: an operation that is not known, or a branch that goes several ways within a part or
/// for several roundings.
pub fn over_triangle(
    module: &Module,
    function: &Function,
    corners: [&[Value<Affine>]; 3],
    environment: &Environment<'_, Affine>,
    parts: u32,
) -> Result<Vec<Distance>, Stuck> {
    let [a, b, c] = corners;
    let over = |part: [[f64; 3]; 3]| {
        let arguments = a.iter().zip(b).zip(c);
        let arguments = arguments
            .map(|((a, b), c)| between([a, b, c], &part))
            .collect::<Result<Vec<_>, _>>()?;
        let outcome = crate::run(module, function, &arguments, environment)?;
        let mut numbers = Vec::new();
        if let Some(result) = &outcome.result {
            components(result, &mut numbers);
        }
        Ok(numbers)
    };
    // Where it is computed for the fragment, and where for the corners and interpolated.
    let roundings = |number: Affine, corners: f64| {
        number.error() + corners + INTERPOLATION * number.magnitude()
    };
    if parts <= 1 {
        // The corners of the whole are what it is held against.
        let whole = over([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])?;
        let distances = whole.into_iter().map(|number| {
            let Interval { low, high } = number.range();
            let width = high - low + INTERPOLATION * number.magnitude();
            Distance::new(number.remainder(), roundings(number, number.error()), width)
        });
        return Ok(distances.collect());
    }
    // Each corner by itself.
    let ends = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|at| over([at; 3]));
    let [Ok(first), Ok(second), Ok(third)] = ends else {
        return Err(ends
            .into_iter()
            .find_map(Result::err)
            .unwrap_or(Stuck::Steps));
    };
    let none = Distance {
        max: 0.0,
        roundings: 0.0,
    };
    let mut distances = vec![none; first.len()];
    for part in divided(parts) {
        for (i, number) in over(part)?.into_iter().enumerate() {
            let ends = [&first, &second, &third].map(|end| end[i]);
            // Of a corner of which nothing is known there is no interpolation.
            if !(number.is_known() && ends.iter().all(|end| end.is_known())) {
                distances[i] = Distance::UNBOUNDED;
                continue;
            }
            let at = ends.map(|end| end.corners()[0]);
            let interpolated = |weights: [f64; 3]| -> f64 {
                at.iter()
                    .zip(weights)
                    .map(|(end, weight)| end * weight)
                    .sum()
            };
            let off = number.corners().into_iter().zip(part);
            let off = off.map(|(value, weights)| (value - interpolated(weights)).abs());
            let off = off.fold(0.0, f64::max) + number.remainder();
            let of_corners = ends.iter().map(|end| end.error()).fold(0.0, f64::max);
            let all = ends.map(Affine::range).into_iter();
            let all = all.fold(number.range(), Interval::or);
            let width = all.high - all.low + INTERPOLATION * all.magnitude();
            distances[i] =
                distances[i].or(Distance::new(off, roundings(number, of_corners), width));
        }
    }
    Ok(distances)
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

/// A value in which every float is this exactly.
pub fn exactly<F: Number>(value: &Value) -> Value<F> {
    match value {
        Value::Scalar(scalar) => Value::Scalar(match scalar {
            Scalar::F32(x) => Scalar::F32(F::of(*x)),
            Scalar::I32(x) => Scalar::I32(*x),
            Scalar::U32(x) => Scalar::U32(*x),
            Scalar::Bool(x) => Scalar::Bool(*x),
        }),
        Value::Composite(parts) => Value::Composite(parts.iter().map(exactly).collect()),
        Value::Pointer { address, path } => Value::Pointer {
            address: *address,
            path: path.clone(),
        },
        Value::Resource(global) => Value::Resource(*global),
    }
}

/// What the rasteriser makes of a value at three corners, over a part of the triangle: floats
/// between them; the rest has to be the same.
fn between(corners: [&Value<Affine>; 3], part: &[[f64; 3]; 3]) -> Result<Value<Affine>, Stuck> {
    Ok(match corners {
        [
            Value::Scalar(Scalar::F32(a)),
            Value::Scalar(Scalar::F32(b)),
            Value::Scalar(Scalar::F32(c)),
        ] => Value::number(interpolated([*a, *b, *c], part)),
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

/// Between three numbers, of which each is the same everywhere.
fn interpolated(corners: [Affine; 3], part: &[[f64; 3]; 3]) -> Affine {
    let [Some(a), Some(b), Some(c)] = corners.map(Affine::single) else {
        return Affine::ANYTHING;
    };
    let at = |weights: &[f64; 3]| [a, b, c].iter().zip(weights).map(|(e, w)| e * w).sum();
    let [first, second, third] = corners.map(Affine::range);
    let range = first.or(second).or(third);
    let off = corners.map(Affine::error).into_iter().fold(0.0, f64::max);
    let error = off + INTERPOLATION * range.magnitude();
    Affine::new(part.each_ref().map(at), 0.0, error, range)
}

fn components(value: &Value<Affine>, out: &mut Vec<Affine>) {
    match value {
        Value::Scalar(Scalar::F32(number)) => out.push(*number),
        Value::Composite(parts) => parts.iter().for_each(|p| components(p, out)),
        _ => {}
    }
}
