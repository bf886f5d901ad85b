//! Built-in functions: names and result types.

use super::super::ty::{Component, Ty};

/// Functions that naga's front end knows. An author's function of such a name is renamed, because
/// naga would confuse them.
const KNOWN: &[&str] = &[
    "abs",
    "acos",
    "acosh",
    "all",
    "any",
    "asin",
    "asinh",
    "atan",
    "atanh",
    "barrier",
    "bitCount",
    "bitfieldExtract",
    "bitfieldInsert",
    "bitfieldReverse",
    "ceil",
    "clamp",
    "cos",
    "cosh",
    "cross",
    "dFdx",
    "dFdxCoarse",
    "dFdxFine",
    "dFdy",
    "dFdyCoarse",
    "dFdyFine",
    "degrees",
    "determinant",
    "distance",
    "dot",
    "equal",
    "exp",
    "exp2",
    "faceforward",
    "findLSB",
    "findMSB",
    "floatBitsToInt",
    "floatBitsToUint",
    "floor",
    "fma",
    "fract",
    "fwidth",
    "fwidthCoarse",
    "fwidthFine",
    "greaterThan",
    "greaterThanEqual",
    "imageLoad",
    "imageSize",
    "imageStore",
    "intBitsToFloat",
    "inverse",
    "inversesqrt",
    "isinf",
    "isnan",
    "ldexp",
    "length",
    "lessThan",
    "lessThanEqual",
    "log",
    "log2",
    "max",
    "min",
    "mix",
    "mod",
    "normalize",
    "not",
    "notEqual",
    "outerProduct",
    "pow",
    "radians",
    "reflect",
    "refract",
    "round",
    "roundEven",
    "sign",
    "sin",
    "sinh",
    "smoothstep",
    "sqrt",
    "step",
    "tan",
    "tanh",
    "texelFetch",
    "texelFetchOffset",
    "texture",
    "textureGrad",
    "textureGradOffset",
    "textureLod",
    "textureLodOffset",
    "textureOffset",
    "textureProj",
    "textureProjGrad",
    "textureProjLod",
    "textureProjOffset",
    "textureQueryLevels",
    "textureSize",
    "transpose",
    "trunc",
    "uintBitsToFloat",
];

/// Whether naga's front end has a function of that name.
pub(super) fn is_known(name: &str) -> bool {
    KNOWN.contains(&name)
        || name.starts_with("pack") && name.len() > 8
        || name.starts_with("unpack")
}

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
        "imageLoad" | "imageSize" | "subpassLoad" => Ty::Unknown,
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
