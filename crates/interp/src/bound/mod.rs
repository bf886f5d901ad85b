//! Proved bounds: the distance of a value from its interpolation, anywhere in a triangle.
//!
//! The interpreter runs once for the whole triangle, on numbers that are affine in the barycentric
//! coordinates up to a remainder: affine arithmetic (de Figueiredo and Stolfi 2004) with the two
//! coordinates as noise symbols, and one more for the rest. The affine part is stored as the
//! value's own values at the corners. So it equals the interpolation, and the remainder *is* the
//! bound.
//!
//! Each operation bounds its curvature. A smooth function of an affine one, with a second
//! derivative of at most `m`, is within `m w^2 / 8` of the line between its ends, over a range of
//! width `w`. A product is within a third of the largest product of differences. A function that
//! jumps within the triangle is only known to lie between its minimum and maximum. A branch that is
//! decided differently within the triangle ends the evaluation.
//!
//! The remainder belongs to the exact function over real numbers (evaluated in `f64`). In addition,
//! a number carries the largest distance of an adapter's result from it, from WGSL's accuracies of
//! each operation. [`Interval`] is simpler: it only bounds a value. A comparison, a jump or a
//! conversion to an integer is decided only if all results that an adapter may compute lie on one
//! side of it.

use std::collections::BTreeMap;

use naga::{Function, Module};

use crate::{Environment, Lookup, Number, Scalar, Stuck, Value};

mod affine;
mod operations;

pub use super::accuracy::Accuracy;
pub use super::interval::Interval;
pub use affine::Affine;

/// Limit on interpreter steps for one triangle.
const STEPS: u64 = 200_000;

/// The environment of an evaluation over a triangle: uniforms and buffers, and textures with
/// unknown content.
pub fn environment(resources: BTreeMap<(u32, u32), Value<Affine>>) -> Environment<'static, Affine> {
    Environment {
        resources: resources.into(),
        texture: &|_: &Lookup<'_, Affine>| [Affine::ANYTHING; 4],
        derivative: None,
        trace: None,
        steps: STEPS,
    }
}

/// Largest distance of a component from its interpolation in a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// In real numbers. Infinite if there is no bound.
    pub max: f64,
    /// How much an adapter's roundings add to it, at most.
    pub roundings: f64,
}

impl Distance {
    /// No bound is known.
    pub const UNBOUNDED: Self = Self {
        max: f64::INFINITY,
        roundings: f64::INFINITY,
    };

    /// The distance for a value and an interpolation that both lie in an interval of this width.
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

    /// The maximum of each field.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            max: self.max.max(other.max),
            roundings: self.roundings.max(other.roundings),
        }
    }
}

/// Largest error of an interpolated number, relative to its largest corner. No specification gives
/// one; this value stands for an interpolation with a few roundings in `f32`. The result is assumed
/// to lie between the corners: pixel centres outside of the triangle, which multisampling may
/// shade, are not covered.
const INTERPOLATION: f64 = 1.0 / (1 << 21) as f64;

/// The largest distance of each component of `function`'s result from its interpolation in a
/// triangle. `corners` are the arguments at the triangle's corners, in the shapes of the
/// parameters. Integers and booleans must be equal at all corners. Each float must be a single
/// number at its corner, and its error is taken into account.
///
/// The triangle is divided into `parts` squared smaller ones. In each, a value's distance from the
/// interpolation over the whole triangle is at most that at the corners of the part plus the
/// remainder there, which falls with the square of the size.
///
/// # Errors
/// [`Stuck`]: an unsupported operation, or a branch that goes several ways within a part or because
/// of roundings.
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
    // Roundings where the fragment computes the value, and where it is computed at the corners and
    // interpolated.
    let roundings = |number: Affine, corners: f64| {
        number.error() + corners + INTERPOLATION * number.magnitude()
    };
    if parts <= 1 {
        // The corners of the whole triangle are the reference.
        let whole = over([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])?;
        let distances = whole.into_iter().map(|number| {
            let Interval { low, high } = number.range();
            let width = high - low + INTERPOLATION * number.magnitude();
            Distance::new(number.remainder(), roundings(number, number.error()), width)
        });
        return Ok(distances.collect());
    }
    // Each corner separately.
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
            // Without a known value at a corner there is no interpolation.
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

/// The value with every float exactly as it is.
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

/// The rasteriser's result for a value at three corners, over a part of the triangle: floats are
/// interpolated; anything else must be equal at all corners.
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

/// Interpolates three numbers, each of which is constant.
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
