//! Built-in functions: names and result types.

use crate::ty::{Component, Ty};

/// The result type of a built-in function without textures.
pub(super) fn result(name: &str, arguments: &[Ty]) -> Ty {
    let first = arguments.first().cloned().unwrap_or(Ty::Unknown);
    let bools = |ty: &Ty| ty.with_kind(Component::Bool);
    match name {
        "length" | "distance" | "dot" | "determinant" => match first.kind() {
            Some(Component::Double) => Ty::Scalar(Component::Double),
            _ => Ty::FLOAT,
        },
        "all" | "any" => Ty::BOOL,
        "lessThan" | "lessThanEqual" | "greaterThan" | "greaterThanEqual" | "equal"
        | "notEqual" | "isnan" | "isinf" => bools(&first),
        "transpose" => match first {
            Ty::Matrix(k, c, r) => Ty::Matrix(k, r, c),
            other => other,
        },
        "outerProduct" => match (&first, arguments.get(1)) {
            (Ty::Vector(k, rows), Some(Ty::Vector(_, columns))) => Ty::Matrix(*k, *columns, *rows),
            _ => Ty::Unknown,
        },
        "floatBitsToInt" | "bitCount" | "findLSB" | "findMSB" => first.with_kind(Component::Int),
        "bitfieldExtract" | "bitfieldInsert" | "bitfieldReverse" | "ldexp" => first,
        "floatBitsToUint" => first.with_kind(Component::Uint),
        "intBitsToFloat" | "uintBitsToFloat" => first.with_kind(Component::Float),
        "packSnorm4x8" | "packUnorm4x8" | "packSnorm2x16" | "packUnorm2x16" | "packHalf2x16" => {
            Ty::UINT
        }
        "unpackSnorm4x8" | "unpackUnorm4x8" => Ty::Vector(Component::Float, 4),
        "unpackSnorm2x16" | "unpackUnorm2x16" | "unpackHalf2x16" => Ty::Vector(Component::Float, 2),
        "step" | "smoothstep" => match arguments.last() {
            Some(last) if last.kind() == Some(Component::Double) => last.clone(),
            Some(last) => last.with_kind(Component::Float),
            None => Ty::Unknown,
        },
        "imageLoad" => match &first {
            Ty::Opaque(image) => Ty::Vector(texel(image), 4),
            _ => Ty::Unknown,
        },
        "imageSize" => match &first {
            Ty::Opaque(image) => {
                let dimensions = match image {
                    i if i.contains("1D") => 1,
                    i if i.contains("2D") => 2,
                    _ => 3,
                };
                let layers = u8::from(image.ends_with("Array"));
                Ty::vector(Component::Int, dimensions + layers)
            }
            _ => Ty::Unknown,
        },
        "subpassLoad" => Ty::Unknown,
        "imageStore" | "barrier" | "memoryBarrier" | "groupMemoryBarrier" => Ty::Void,
        // The others are component-wise, with the widest argument's type.
        _ => {
            let kind = arguments
                .iter()
                .filter_map(Ty::kind)
                .max_by_key(|k| k.power());
            let widest = arguments
                .iter()
                .max_by_key(|t| match t {
                    Ty::Matrix(..) => 9,
                    other => other.components().unwrap_or(0),
                })
                .cloned()
                .unwrap_or(Ty::Unknown);
            match (name, kind) {
                // Float functions convert integers: `mod(x, 8)`.
                (_, Some(Component::Int | Component::Uint)) if is_of_floats(name) => {
                    widest.with_kind(Component::Float)
                }
                (_, Some(k)) if is_of_floats(name) => widest.with_kind(k),
                // `mix` with a bool selector has the type of the others.
                ("abs" | "sign" | "min" | "max" | "clamp" | "mix", Some(k)) => widest.with_kind(k),
                _ => widest,
            }
        }
    }
}

/// Whether a function takes values of these types (GLSL 4.60, 8). Conversions are made already.
pub(super) fn takes(name: &str, given: &[Ty]) -> bool {
    use Component::{Bool, Double, Float, Int, Uint};
    if given.iter().any(|ty| matches!(ty, Ty::Unknown)) {
        return true;
    }
    let of = |ty: &Ty, kinds: &[Component]| {
        ty.components().is_some() && ty.kind().is_some_and(|k| kinds.contains(&k))
    };
    let floats = &[Float, Double];
    let numbers = &[Float, Double, Int, Uint];
    // A scalar stands for a vector of it.
    let spreads =
        |ty: &Ty, over: &Ty| ty == over || matches!(ty, Ty::Scalar(k) if over.kind() == Some(*k));
    match (name, given) {
        ("abs" | "sign", [x]) => of(x, &[Float, Double, Int]),
        ("atan" | "pow", [x, y]) => of(x, &[Float]) && x == y,
        ("dot" | "distance" | "reflect", [x, y]) => of(x, floats) && x == y,
        ("ldexp", [x, y]) => of(x, floats) && *y == x.with_kind(Int),
        ("min" | "max", [x, y]) => of(x, numbers) && spreads(y, x),
        ("mod", [x, y]) => of(x, floats) && spreads(y, x),
        ("step", [edge, x]) => of(x, floats) && spreads(edge, x),
        ("clamp", [x, low, high]) => of(x, numbers) && low == high && spreads(low, x),
        ("smoothstep", [low, high, x]) => of(x, floats) && low == high && spreads(low, x),
        ("mix", [x, y, by]) => {
            x == y
                && match by.kind() {
                    Some(Bool) => *by == x.with_kind(Bool),
                    _ => of(x, floats) && spreads(by, x),
                }
        }
        ("cross", [x, y]) => of(x, floats) && x == y && x.components() == Some(3),
        ("faceforward" | "fma", [x, y, z]) => of(x, floats) && x == y && y == z,
        ("refract", [x, y, eta]) => of(x, floats) && x == y && *eta == Ty::FLOAT,
        ("transpose", [m]) => matches!(m, Ty::Matrix(..)),
        ("inverse" | "determinant", [m]) => matches!(m, Ty::Matrix(_, c, r) if c == r),
        ("lessThan" | "lessThanEqual" | "greaterThan" | "greaterThanEqual", [x, y]) => {
            of(x, numbers) && x == y && matches!(x, Ty::Vector(..))
        }
        ("equal" | "notEqual", [x, y]) => x == y && matches!(x, Ty::Vector(..)),
        ("all" | "any" | "not", [x]) => matches!(x, Ty::Vector(Bool, _)),
        ("intBitsToFloat", [x]) => of(x, &[Int]),
        ("uintBitsToFloat", [x]) => of(x, &[Uint]),
        ("bitCount" | "bitfieldReverse" | "findLSB" | "findMSB", [x]) => of(x, &[Int, Uint]),
        ("bitfieldExtract", [x, at, bits]) => {
            of(x, &[Int, Uint]) && *at == Ty::INT && *bits == Ty::INT
        }
        ("bitfieldInsert", [x, y, at, bits]) => {
            of(x, &[Int, Uint]) && x == y && *at == Ty::INT && *bits == Ty::INT
        }
        (pack, [x]) if pack.starts_with("pack") => {
            *x == Ty::Vector(Float, if pack.ends_with("4x8") { 4 } else { 2 })
        }
        (unpack, [x]) if unpack.starts_with("unpack") => *x == Ty::UINT,
        ("barrier", []) => true,
        (image, _) if image.starts_with("image") => true,
        (
            "ceil" | "floor" | "fract" | "inversesqrt" | "length" | "normalize" | "round"
            | "roundEven" | "sqrt" | "trunc",
            [x],
        ) => of(x, floats),
        (one, [x]) if !TAKES_MORE.contains(&one) => of(x, &[Float]),
        _ => false,
    }
}

/// Functions of several arguments.
const TAKES_MORE: &[&str] = &[
    "abs",
    "pow",
    "dot",
    "distance",
    "reflect",
    "ldexp",
    "min",
    "max",
    "mod",
    "step",
    "clamp",
    "smoothstep",
    "mix",
    "cross",
    "faceforward",
    "fma",
    "refract",
    "equal",
    "notEqual",
    "lessThan",
    "lessThanEqual",
    "greaterThan",
    "greaterThanEqual",
    "bitfieldExtract",
    "bitfieldInsert",
    "outerProduct",
    "matrixCompMult",
];

/// The component type of an image's texels.
fn texel(image: &str) -> Component {
    match image.as_bytes().first() {
        Some(b'i') if image.starts_with("iimage") => Component::Int,
        Some(b'u') => Component::Uint,
        _ => Component::Float,
    }
}

/// Whether the function only takes floats, so integers are converted.
pub(super) fn is_of_floats(name: &str) -> bool {
    matches!(
        name,
        "acos"
            | "acosh"
            | "asin"
            | "asinh"
            | "atan"
            | "atanh"
            | "ceil"
            | "cos"
            | "cosh"
            | "cross"
            | "degrees"
            | "distance"
            | "dot"
            | "exp"
            | "exp2"
            | "faceforward"
            | "floor"
            | "fract"
            | "inversesqrt"
            | "length"
            | "log"
            | "log2"
            | "mod"
            | "normalize"
            | "pow"
            | "radians"
            | "reflect"
            | "round"
            | "roundEven"
            | "sin"
            | "sinh"
            | "smoothstep"
            | "sqrt"
            | "step"
            | "tan"
            | "tanh"
            | "trunc"
            | "dFdx"
            | "dFdy"
            | "fwidth"
    )
}
