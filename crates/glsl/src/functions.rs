//! GLSL's functions, except those of textures: parameters, results and meaning in the IR.

use naga::{
    BinaryOperator as O, DerivativeAxis as Axis, DerivativeControl as Control, MathFunction as F,
    RelationalFunction as R, ScalarKind as S,
};

use super::textures::TextureFunction;
use super::ty::Component::{self, Bool, Double, Float, Int, Uint};
use super::ty::Ty;

/// The meaning of a function in the IR.
#[derive(Clone, Copy, Debug)]
pub(super) enum Meaning {
    Math(F),
    Derivative(Axis, Control),
    /// An operator of vectors, by component.
    Operator(O),
    /// Reinterprets the bits as another kind of number.
    Bits(S),
    Relational(R),
    Not,
    Modulo,
    Barrier,
    Image(TextureFunction),
    /// Expanded by `resolve`.
    Composed,
}

use Meaning::{
    Barrier, Bits, Composed, Derivative, Image, Math, Modulo, Not, Operator, Relational,
};

/// Parameter and result types of a function.
#[derive(Clone, Copy, Debug)]
pub(super) enum Form {
    /// This many floats of one shape. The result has the same shape.
    Floats(usize),
    /// One or two floats of one shape.
    FloatOrTwo,
    /// This many floats of one shape, 64 bits included.
    Reals(usize),
    /// This many floats of one shape, to a scalar.
    Measure(usize),
    Cross,
    Signed,
    Extreme,
    Clamp,
    Mod,
    Step,
    SmoothStep,
    Mix,
    Ldexp,
    Refract,
    Transpose,
    Inverse,
    Determinant,
    Outer,
    ByComponent,
    /// Two numeric vectors, to a `bvec`.
    Order,
    Equal,
    Quantifier,
    Negation,
    Classify,
    Reinterpret(Component, Component),
    Count,
    Reverse,
    Extract,
    Insert,
    /// A vector of this size, to a `uint`; `Unpack` is the reverse.
    Pack(u8),
    Unpack(u8),
    NoValues,
    Load,
    Store,
    Size,
}

use Form::{
    ByComponent, Clamp, Classify, Count, Cross, Determinant, Equal, Extract, Extreme, FloatOrTwo,
    Floats, Insert, Inverse, Ldexp, Load, Measure, Mix, Mod, Negation, NoValues, Order, Outer,
    Pack, Quantifier, Reals, Refract, Reinterpret, Reverse, Signed, Size, SmoothStep, Step, Store,
    Transpose, Unpack,
};

#[derive(Clone, Copy, Debug)]
pub(super) struct Function {
    form: Form,
    pub meaning: Meaning,
}

#[rustfmt::skip]
const FUNCTIONS: &[(&str, Form, Meaning)] = &[
    ("abs", Signed, Math(F::Abs)), ("acos", Floats(1), Math(F::Acos)), ("acosh", Floats(1), Math(F::Acosh)),
    ("all", Quantifier, Relational(R::All)), ("any", Quantifier, Relational(R::Any)),
    ("asin", Floats(1), Math(F::Asin)), ("asinh", Floats(1), Math(F::Asinh)), ("atan", FloatOrTwo, Math(F::Atan)),
    ("atanh", Floats(1), Math(F::Atanh)), ("barrier", NoValues, Barrier), ("bitCount", Count, Math(F::CountOneBits)),
    ("bitfieldExtract", Extract, Math(F::ExtractBits)), ("bitfieldInsert", Insert, Math(F::InsertBits)),
    ("bitfieldReverse", Reverse, Math(F::ReverseBits)), ("ceil", Reals(1), Math(F::Ceil)),
    ("clamp", Clamp, Math(F::Clamp)), ("cos", Floats(1), Math(F::Cos)), ("cosh", Floats(1), Math(F::Cosh)),
    ("cross", Cross, Math(F::Cross)), ("degrees", Floats(1), Math(F::Degrees)),
    ("determinant", Determinant, Math(F::Determinant)), ("dFdx", Floats(1), Derivative(Axis::X, Control::None)),
    ("dFdxCoarse", Floats(1), Derivative(Axis::X, Control::Coarse)),
    ("dFdxFine", Floats(1), Derivative(Axis::X, Control::Fine)), ("dFdy", Floats(1), Derivative(Axis::Y, Control::None)),
    ("dFdyCoarse", Floats(1), Derivative(Axis::Y, Control::Coarse)),
    ("dFdyFine", Floats(1), Derivative(Axis::Y, Control::Fine)), ("distance", Measure(2), Math(F::Distance)),
    ("dot", Measure(2), Math(F::Dot)), ("equal", Equal, Operator(O::Equal)), ("exp", Floats(1), Math(F::Exp)),
    ("exp2", Floats(1), Math(F::Exp2)), ("faceforward", Reals(3), Math(F::FaceForward)),
    ("findLSB", Count, Math(F::FirstTrailingBit)), ("findMSB", Count, Math(F::FirstLeadingBit)),
    ("floatBitsToInt", Reinterpret(Float, Int), Bits(S::Sint)), ("floatBitsToUint", Reinterpret(Float, Uint), Bits(S::Uint)),
    ("floor", Reals(1), Math(F::Floor)), ("fma", Reals(3), Math(F::Fma)), ("fract", Reals(1), Math(F::Fract)),
    ("fwidth", Floats(1), Derivative(Axis::Width, Control::None)),
    ("fwidthCoarse", Floats(1), Derivative(Axis::Width, Control::Coarse)),
    ("fwidthFine", Floats(1), Derivative(Axis::Width, Control::Fine)), ("greaterThan", Order, Operator(O::Greater)),
    ("greaterThanEqual", Order, Operator(O::GreaterEqual)), ("imageLoad", Load, Image(TextureFunction::Load)), ("imageSize", Size, Image(TextureFunction::Size)),
    ("imageStore", Store, Image(TextureFunction::Store)), ("intBitsToFloat", Reinterpret(Int, Float), Bits(S::Float)),
    ("inverse", Inverse, Math(F::Inverse)), ("inversesqrt", Reals(1), Math(F::InverseSqrt)),
    ("isinf", Classify, Composed), ("isnan", Classify, Composed), ("ldexp", Ldexp, Math(F::Ldexp)),
    ("length", Measure(1), Math(F::Length)), ("lessThan", Order, Operator(O::Less)),
    ("lessThanEqual", Order, Operator(O::LessEqual)), ("log", Floats(1), Math(F::Log)), ("log2", Floats(1), Math(F::Log2)),
    ("matrixCompMult", ByComponent, Composed), ("max", Extreme, Math(F::Max)), ("min", Extreme, Math(F::Min)),
    ("mix", Mix, Math(F::Mix)), ("mod", Mod, Modulo), ("normalize", Reals(1), Math(F::Normalize)), ("not", Negation, Not),
    ("notEqual", Equal, Operator(O::NotEqual)), ("outerProduct", Outer, Composed),
    ("packHalf2x16", Pack(2), Math(F::Pack2x16float)), ("packSnorm2x16", Pack(2), Math(F::Pack2x16snorm)),
    ("packSnorm4x8", Pack(4), Math(F::Pack4x8snorm)), ("packUnorm2x16", Pack(2), Math(F::Pack2x16unorm)),
    ("packUnorm4x8", Pack(4), Math(F::Pack4x8unorm)), ("pow", Floats(2), Math(F::Pow)),
    ("radians", Floats(1), Math(F::Radians)), ("reflect", Reals(2), Math(F::Reflect)),
    ("refract", Refract, Math(F::Refract)), ("round", Reals(1), Math(F::Round)), ("roundEven", Reals(1), Math(F::Round)),
    ("sign", Signed, Math(F::Sign)), ("sin", Floats(1), Math(F::Sin)), ("sinh", Floats(1), Math(F::Sinh)),
    ("smoothstep", SmoothStep, Math(F::SmoothStep)), ("sqrt", Reals(1), Math(F::Sqrt)), ("step", Step, Math(F::Step)),
    ("tan", Floats(1), Math(F::Tan)), ("tanh", Floats(1), Math(F::Tanh)), ("transpose", Transpose, Math(F::Transpose)),
    ("trunc", Reals(1), Math(F::Trunc)), ("uintBitsToFloat", Reinterpret(Uint, Float), Bits(S::Float)),
    ("unpackHalf2x16", Unpack(2), Math(F::Unpack2x16float)), ("unpackSnorm2x16", Unpack(2), Math(F::Unpack2x16snorm)),
    ("unpackSnorm4x8", Unpack(4), Math(F::Unpack4x8snorm)), ("unpackUnorm2x16", Unpack(2), Math(F::Unpack2x16unorm)),
    ("unpackUnorm4x8", Unpack(4), Math(F::Unpack4x8unorm)),
];

/// The function with a GLSL name.
pub(super) fn named(name: &str) -> Option<Function> {
    let (_, form, meaning) = *FUNCTIONS.iter().find(|(word, ..)| *word == name)?;
    Some(Function { form, meaning })
}

impl Function {
    /// The component type to which arguments of these types are converted.
    pub(super) fn converts_to(self, given: &[Ty]) -> Option<Component> {
        let widest = given.iter().filter_map(Ty::kind);
        let widest = widest.max_by_key(|kind| kind.power());
        match self.form {
            Extreme | Clamp | Mix | Order | Equal => widest,
            Floats(_) | FloatOrTwo | Reals(_) | Measure(_) | Cross | Mod | Step | SmoothStep
            | Refract | Outer | Classify => widest.map(|kind| match kind {
                Int | Uint => Float,
                other => other,
            }),
            _ => None,
        }
    }

    /// The result type, or `None` if it does not accept these argument types (GLSL 4.60, 8). They
    /// have been converted already.
    pub(super) fn result(self, given: &[Ty]) -> Option<Ty> {
        let of = |ty: &Ty, kinds: &[Component]| {
            ty.components().is_some() && ty.kind().is_some_and(|k| kinds.contains(&k))
        };
        let reals = &[Float, Double];
        let numbers = &[Float, Double, Int, Uint];
        let integers = &[Int, Uint];
        let alike = given.windows(2).all(|two| two[0] == two[1]);
        // A scalar is accepted in place of a vector.
        let spreads = |ty: &Ty, over: &Ty| {
            ty == over || matches!(ty, Ty::Scalar(k) if over.kind() == Some(*k))
        };
        let (takes, result) = match (self.form, given) {
            (Floats(n), [x, ..]) => (given.len() == n && alike && of(x, &[Float]), x.clone()),
            (FloatOrTwo, [x] | [x, _]) => (alike && of(x, &[Float]), x.clone()),
            (Reals(n), [x, ..]) => (given.len() == n && alike && of(x, reals), x.clone()),
            (Measure(n), [x, ..]) => {
                let takes = given.len() == n && alike && of(x, reals);
                (takes, Ty::Scalar(x.kind()?))
            }
            (Cross, [x, _]) => (
                alike && *x == Ty::Vector(x.kind()?, 3) && of(x, reals),
                x.clone(),
            ),
            (Signed, [x]) => (of(x, &[Float, Double, Int]), x.clone()),
            (Extreme, [x, y]) => (of(x, numbers) && spreads(y, x), x.clone()),
            (Clamp, [x, low, high]) => {
                (of(x, numbers) && low == high && spreads(low, x), x.clone())
            }
            (Mod, [x, y]) => (of(x, reals) && spreads(y, x), x.clone()),
            (Step, [edge, x]) => (of(x, reals) && spreads(edge, x), x.clone()),
            (SmoothStep, [low, high, x]) => {
                (of(x, reals) && low == high && spreads(low, x), x.clone())
            }
            (Mix, [x, y, by]) if by.kind() == Some(Bool) => {
                (x == y && *by == x.with_kind(Bool), x.clone())
            }
            (Mix, [x, y, by]) => (x == y && of(x, reals) && spreads(by, x), x.clone()),
            (Ldexp, [x, y]) => (of(x, reals) && *y == x.with_kind(Int), x.clone()),
            (Refract, [x, y, eta]) => (of(x, reals) && x == y && *eta == Ty::FLOAT, x.clone()),
            (Transpose, [Ty::Matrix(k, c, r)]) => (true, Ty::Matrix(*k, *r, *c)),
            (Inverse, [x @ Ty::Matrix(_, c, r)]) => (c == r, x.clone()),
            (Determinant, [Ty::Matrix(k, c, r)]) => (c == r, Ty::Scalar(*k)),
            (Outer, [x @ Ty::Vector(k, rows), Ty::Vector(other, columns)]) => {
                let takes = k == other && of(x, reals);
                (takes, Ty::Matrix(*k, *columns, *rows))
            }
            (ByComponent, [x @ Ty::Matrix(..), _]) => (alike, x.clone()),
            (Order, [x @ Ty::Vector(..), _]) => (alike && of(x, numbers), x.with_kind(Bool)),
            (Equal, [x @ Ty::Vector(..), _]) => (alike, x.with_kind(Bool)),
            (Quantifier, [Ty::Vector(Bool, _)]) => (true, Ty::BOOL),
            (Negation, [x @ Ty::Vector(Bool, _)]) => (true, x.clone()),
            (Classify, [x]) => (of(x, &[Float]), x.with_kind(Bool)),
            (Reinterpret(from, to), [x]) => (of(x, &[from]), x.with_kind(to)),
            (Count, [x]) => (of(x, integers), x.with_kind(Int)),
            (Reverse, [x]) => (of(x, integers), x.clone()),
            (Extract, [x, at, bits]) => (
                of(x, integers) && *at == Ty::INT && *bits == Ty::INT,
                x.clone(),
            ),
            (Insert, [x, y, at, bits]) => {
                let takes = of(x, integers) && x == y && *at == Ty::INT && *bits == Ty::INT;
                (takes, x.clone())
            }
            (Pack(n), [x]) => (*x == Ty::Vector(Float, n), Ty::UINT),
            (Unpack(n), [x]) => (*x == Ty::UINT, Ty::Vector(Float, n)),
            (NoValues, []) | (Store, _) => (true, Ty::Void),
            (Load, [Ty::Opaque(image), ..]) => (true, Ty::Vector(texel(image), 4)),
            (Size, [Ty::Opaque(image)]) => {
                let dimensions = match image {
                    i if i.contains("1D") => 1,
                    i if i.contains("2D") => 2,
                    _ => 3,
                };
                let layers = u8::from(image.ends_with("Array"));
                (true, Ty::vector(Int, dimensions + layers))
            }
            _ => return None,
        };
        takes.then_some(result)
    }
}

/// The component type of an image's texels.
fn texel(image: &str) -> Component {
    match image.as_bytes().first() {
        Some(b'i') if image.starts_with("iimage") => Int,
        Some(b'u') => Uint,
        _ => Float,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_function_is_in_the_table_once() {
        let all: Vec<&str> = FUNCTIONS.iter().map(|(name, ..)| *name).collect();
        for (i, name) in all.iter().enumerate() {
            assert!(!all[..i].contains(name), "{name}");
        }
    }
}
