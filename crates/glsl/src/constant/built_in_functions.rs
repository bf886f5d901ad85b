//! Evaluates built-in functions of constants. Results that GLSL leaves undefined are NaN (4.60, 8).

use std::f32::consts::{LN_2, LOG2_E};

use super::ConstantValue::{self, Bool, Float, Int, Uint, Vector};
use super::{B, alike, scalars};

/// The value of a built-in function. `None` for functions that are not supported here.
pub(crate) fn call(name: &str, values: &[ConstantValue]) -> Option<ConstantValue> {
    match name {
        "length" | "distance" | "dot" | "normalize" | "cross" => return geometric(name, values),
        _ => {}
    }
    let size = values.iter().find_map(|v| match v {
        Vector(parts) => Some(parts.len()),
        _ => None,
    });
    let Some(size) = size else {
        return scalar(name, values);
    };
    let component = |i: usize| {
        let part = |v: &ConstantValue| match v {
            Vector(parts) => parts.get(i).cloned(),
            scalar => Some(scalar.clone()),
        };
        let parts: Option<Vec<ConstantValue>> = values.iter().map(part).collect();
        scalar(name, &parts?)
    };
    (0..size).map(component).collect::<Option<_>>().map(Vector)
}

fn real(value: &ConstantValue) -> Option<f32> {
    match value {
        Float(x) => Some(*x),
        Int(n) => Some(*n as f32),
        Uint(n) => Some(*n as f32),
        _ => None,
    }
}

/// `x`, or NaN where the function is undefined.
fn where_defined(is_defined: bool, x: f32) -> f32 {
    if is_defined { x } else { f32::NAN }
}

fn scalar(name: &str, values: &[ConstantValue]) -> Option<ConstantValue> {
    let is_integer = |v: &ConstantValue| matches!(v, Int(_) | Uint(_));
    match (name, values) {
        ("abs", [Int(n)]) => return Some(Int(n.wrapping_abs())),
        ("sign", [Int(n)]) => return Some(Int(n.signum())),
        ("min" | "max", [a, b]) => return least(name, a, b),
        ("clamp", [x, low, high]) if values.iter().all(is_integer) => {
            let in_order = scalars(&B::Lte, low.clone(), high.clone())? == Bool(true);
            return match in_order {
                true => least("min", &least("max", x, low)?, high),
                false => None,
            };
        }
        _ => {}
    }
    let numbers: Option<Vec<f32>> = values.iter().map(real).collect();
    Some(Float(match numbers?[..] {
        [x] => of_one(name, x)?,
        [x, y] => match name {
            "pow" => where_defined(x > 0.0 || x == 0.0 && y > 0.0, x.powf(y)),
            "atan" => where_defined(x != 0.0 || y != 0.0, x.atan2(y)),
            "mod" => x - y * (x / y).floor(),
            "step" => f32::from(y >= x),
            _ => return None,
        },
        [x, y, z] => match name {
            "clamp" => where_defined(y <= z, x.max(y).min(z)),
            "mix" => x * (1.0 - z) + y * z,
            "fma" => x.mul_add(y, z),
            "smoothstep" => {
                let t = ((z - x) / (y - x)).clamp(0.0, 1.0);
                where_defined(x < y, t * t * (3.0 - 2.0 * t))
            }
            _ => return None,
        },
        _ => return None,
    }))
}

fn least(name: &str, a: &ConstantValue, b: &ConstantValue) -> Option<ConstantValue> {
    let (a, b) = alike(a.clone(), b.clone())?;
    let Bool(less) = scalars(&B::Lt, b.clone(), a.clone())? else {
        return None;
    };
    Some(if less == (name == "min") { b } else { a })
}

fn of_one(name: &str, x: f32) -> Option<f32> {
    Some(match name {
        "abs" => x.abs(),
        "sign" => f32::from(x > 0.0) - f32::from(x < 0.0),
        "floor" => x.floor(),
        "ceil" => x.ceil(),
        "trunc" => x.trunc(),
        "round" | "roundEven" => x.round_ties_even(),
        "fract" => x - x.floor(),
        "radians" => x.to_radians(),
        "degrees" => x.to_degrees(),
        "sin" => x.sin(),
        "cos" => x.cos(),
        "tan" => x.tan(),
        "asin" => x.asin(),
        "acos" => x.acos(),
        "atan" => x.atan(),
        "sinh" => x.sinh(),
        "cosh" => x.cosh(),
        "tanh" => x.tanh(),
        "asinh" => x.asinh(),
        "acosh" => x.acosh(),
        "atanh" => x.atanh(),
        "exp" => (x * LOG2_E).exp2(),
        "exp2" => x.exp2(),
        "log" => x.log2() * LN_2,
        "log2" => x.log2(),
        "sqrt" => x.sqrt(),
        "inversesqrt" => 1.0 / x.sqrt(),
        _ => return None,
    })
}

fn geometric(name: &str, values: &[ConstantValue]) -> Option<ConstantValue> {
    let parts = |v: &ConstantValue| match v {
        Vector(parts) => parts.iter().map(real).collect::<Option<Vec<f32>>>(),
        scalar => real(scalar).map(|x| vec![x]),
    };
    let vectors: Option<Vec<Vec<f32>>> = values.iter().map(parts).collect();
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    let length = |a: &[f32]| dot(a, a).sqrt();
    Some(match (name, &vectors?[..]) {
        ("length", [a]) => Float(length(a)),
        ("distance", [a, b]) if a.len() == b.len() => {
            let between: Vec<f32> = a.iter().zip(b).map(|(a, b)| a - b).collect();
            Float(length(&between))
        }
        ("dot", [a, b]) if a.len() == b.len() => Float(dot(a, b)),
        ("normalize", [a]) if a.len() > 1 => {
            let length = length(a);
            // naga divides by the length, and Tint may too, so the length must not underflow
            // either.
            let is_normal = length.is_normal();
            let part = |x: &f32| Float(where_defined(is_normal, x / length));
            Vector(a.iter().map(part).collect())
        }
        ("cross", [a, b]) => match (&a[..], &b[..]) {
            ([a, b, c], [x, y, z]) => {
                let parts = [b * z - c * y, c * x - a * z, a * y - b * x];
                Vector(parts.map(Float).to_vec())
            }
            _ => return None,
        },
        _ => return None,
    })
}
