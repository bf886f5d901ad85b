//! GLSL's functions, but for those of textures and those that `resolve` writes out.

use naga::{
    BinaryOperator as O, DerivativeAxis as Axis, DerivativeControl as Control, MathFunction as F,
};

/// What a function is in the IR.
#[derive(Clone, Copy, Debug)]
pub(super) enum Meaning {
    Math(F),
    Derivative(Axis, Control),
    /// Of vectors, by component.
    Operator(O),
    /// Of several expressions, or one that depends on the types.
    Other,
}

use Meaning::{Derivative, Math, Operator, Other};

#[rustfmt::skip]
const FUNCTIONS: &[(&str, Meaning)] = &[
    ("abs", Math(F::Abs)), ("acos", Math(F::Acos)), ("acosh", Math(F::Acosh)), ("asin", Math(F::Asin)),
    ("asinh", Math(F::Asinh)), ("atanh", Math(F::Atanh)), ("bitCount", Math(F::CountOneBits)),
    ("bitfieldReverse", Math(F::ReverseBits)), ("ceil", Math(F::Ceil)), ("cos", Math(F::Cos)),
    ("cosh", Math(F::Cosh)), ("cross", Math(F::Cross)), ("degrees", Math(F::Degrees)),
    ("determinant", Math(F::Determinant)), ("dFdx", Derivative(Axis::X, Control::None)),
    ("dFdxCoarse", Derivative(Axis::X, Control::Coarse)), ("dFdxFine", Derivative(Axis::X, Control::Fine)),
    ("dFdy", Derivative(Axis::Y, Control::None)), ("dFdyCoarse", Derivative(Axis::Y, Control::Coarse)),
    ("dFdyFine", Derivative(Axis::Y, Control::Fine)), ("distance", Math(F::Distance)), ("dot", Math(F::Dot)),
    ("equal", Operator(O::Equal)), ("exp", Math(F::Exp)), ("exp2", Math(F::Exp2)),
    ("faceforward", Math(F::FaceForward)), ("findLSB", Math(F::FirstTrailingBit)),
    ("findMSB", Math(F::FirstLeadingBit)), ("floor", Math(F::Floor)), ("fma", Math(F::Fma)),
    ("fract", Math(F::Fract)), ("fwidth", Derivative(Axis::Width, Control::None)),
    ("fwidthCoarse", Derivative(Axis::Width, Control::Coarse)),
    ("fwidthFine", Derivative(Axis::Width, Control::Fine)), ("greaterThan", Operator(O::Greater)),
    ("greaterThanEqual", Operator(O::GreaterEqual)), ("inverse", Math(F::Inverse)),
    ("inversesqrt", Math(F::InverseSqrt)), ("ldexp", Math(F::Ldexp)), ("length", Math(F::Length)),
    ("lessThan", Operator(O::Less)), ("lessThanEqual", Operator(O::LessEqual)), ("log", Math(F::Log)),
    ("log2", Math(F::Log2)), ("normalize", Math(F::Normalize)), ("notEqual", Operator(O::NotEqual)),
    ("packHalf2x16", Math(F::Pack2x16float)), ("packSnorm2x16", Math(F::Pack2x16snorm)),
    ("packSnorm4x8", Math(F::Pack4x8snorm)), ("packUnorm2x16", Math(F::Pack2x16unorm)),
    ("packUnorm4x8", Math(F::Pack4x8unorm)), ("pow", Math(F::Pow)), ("radians", Math(F::Radians)),
    ("reflect", Math(F::Reflect)), ("refract", Math(F::Refract)), ("round", Math(F::Round)),
    ("roundEven", Math(F::Round)), ("sign", Math(F::Sign)), ("sin", Math(F::Sin)), ("sinh", Math(F::Sinh)),
    ("sqrt", Math(F::Sqrt)), ("tan", Math(F::Tan)), ("tanh", Math(F::Tanh)),
    ("transpose", Math(F::Transpose)), ("trunc", Math(F::Trunc)),
    ("unpackHalf2x16", Math(F::Unpack2x16float)), ("unpackSnorm2x16", Math(F::Unpack2x16snorm)),
    ("unpackSnorm4x8", Math(F::Unpack4x8snorm)), ("unpackUnorm2x16", Math(F::Unpack2x16unorm)),
    ("unpackUnorm4x8", Math(F::Unpack4x8unorm)),
];

const OTHERS: &[&str] = &[
    "all",
    "any",
    "atan",
    "barrier",
    "bitfieldExtract",
    "bitfieldInsert",
    "clamp",
    "floatBitsToInt",
    "floatBitsToUint",
    "imageLoad",
    "imageSize",
    "imageStore",
    "intBitsToFloat",
    "isinf",
    "isnan",
    "max",
    "min",
    "mix",
    "mod",
    "not",
    "outerProduct",
    "smoothstep",
    "step",
    "uintBitsToFloat",
];

/// What the function of that name is.
pub(super) fn meaning(name: &str) -> Option<Meaning> {
    let found = FUNCTIONS.iter().find(|(word, _)| *word == name);
    let other = || OTHERS.contains(&name).then_some(Other);
    found.map(|(_, meaning)| *meaning).or_else(other)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_function_is_in_one_table_once() {
        let all: Vec<&str> = FUNCTIONS
            .iter()
            .map(|(name, _)| *name)
            .chain(OTHERS.iter().copied())
            .collect();
        for (i, name) in all.iter().enumerate() {
            assert!(!all[..i].contains(name), "{name}");
        }
    }
}
