//! The static cost model: the estimated cost of a node for one invocation in weighted scalar
//! operations ("ops"). 1 is the addition of two floats.
//!
//! | node | cost |
//! |---|---|
//! | moving, composing, swizzling, bit casts, constants, arguments | 0 |
//! | add, multiply, compare, select, min, max, clamp, floor, fract, abs, conversion | 1 a component |
//! | matrix product | 1 a multiply-add |
//! | dot, length, normalize, cross, reflect, mix, smoothstep | their operations, counted |
//! | division, square root, exp, log, sin, cos | 4 a component |
//! | pow, tan, inverse trigonometry, hyperbolics | 8 a component |
//! | integer division and remainder | 8 a component |
//! | load from a local or private variable; from a uniform; workgroup; storage | 0; 1; 4; 8 |
//! | texture sample; with gradients; texel load; query | 32; 40; 16; 2 |
//! | derivative | 2 a component |
//! | store to a buffer; to a texture; atomic; subgroup operation; barrier | 8; 16; 32; 8; 8 |
//! | branch, and each iteration of a loop | 1 |
//!
//! Both arms of a branch count. A loop's body counts once per iteration: the trip count of a
//! counted loop, else [`DEFAULT_TRIPS`]. Where a scene tells more,
//! `preshade_passes::transforms::specialize::as_drawn` counts the branches and iterations that its draws take.

use naga::{
    AddressSpace, BinaryOperator, Expression, Handle, ImageQuery, MathFunction, Module,
    SampleLevel, ScalarKind, Statement, TypeInner,
};

use super::{FunctionGraph, StmtId, counted};

/// Assumed trip count of a loop whose trip count is unknown.
pub const DEFAULT_TRIPS: f64 = 8.0;

fn components(ty: &TypeInner) -> f64 {
    match ty {
        TypeInner::Vector { size, .. } => f64::from(*size as u8),
        TypeInner::Matrix { columns, rows, .. } => f64::from(*columns as u8 * *rows as u8),
        _ => 1.0,
    }
}

/// The cost of evaluating an expression once.
pub fn of_expression(module: &Module, f: &FunctionGraph<'_>, e: Handle<Expression>) -> f64 {
    let width = components(f.ty(module, e));
    match &f.function.expressions[e] {
        Expression::Load { pointer } => match f.ty(module, *pointer).pointer_space() {
            Some(AddressSpace::Function | AddressSpace::Private) => 0.0,
            Some(AddressSpace::WorkGroup) => 4.0,
            Some(AddressSpace::Storage { .. }) => 8.0,
            _ => 1.0,
        },
        Expression::ImageSample { level, .. } => match level {
            SampleLevel::Gradient { .. } => 40.0,
            _ => 32.0,
        },
        Expression::ImageLoad { .. } => 16.0,
        Expression::ImageQuery {
            query:
                ImageQuery::Size { .. }
                | ImageQuery::NumLevels
                | ImageQuery::NumLayers
                | ImageQuery::NumSamples,
            ..
        } => 2.0,
        Expression::Unary { .. } | Expression::Select { .. } | Expression::Relational { .. } => {
            width
        }
        Expression::As { convert, .. } => convert.map_or(0.0, |_| width),
        Expression::Derivative { .. } => 2.0 * width,
        Expression::Binary { op, left, right } => {
            binary(*op, f.ty(module, *left), f.ty(module, *right), width)
        }
        Expression::Math { fun, arg, .. } => math(*fun, components(f.ty(module, *arg)), width),
        Expression::ArrayLength(_) => 2.0,
        Expression::RayQueryVertexPositions { .. } | Expression::RayQueryGetIntersection { .. } => {
            16.0
        }
        Expression::CooperativeLoad { .. } | Expression::CooperativeMultiplyAdd { .. } => 64.0,
        _ => 0.0,
    }
}

fn binary(op: BinaryOperator, left: &TypeInner, right: &TypeInner, width: f64) -> f64 {
    use BinaryOperator as B;
    match (op, left, right) {
        (B::Multiply, TypeInner::Matrix { columns, .. }, TypeInner::Matrix { .. })
        | (B::Multiply, TypeInner::Matrix { columns, .. }, TypeInner::Vector { .. }) => {
            width * f64::from(*columns as u8)
        }
        (B::Multiply, TypeInner::Vector { size, .. }, TypeInner::Matrix { .. }) => {
            width * f64::from(*size as u8)
        }
        (B::Divide | B::Modulo, _, _) => match left.scalar_kind() {
            Some(ScalarKind::Float) => 4.0 * width,
            _ => 8.0 * width,
        },
        _ => width,
    }
}

fn math(fun: MathFunction, argument: f64, width: f64) -> f64 {
    use MathFunction as M;
    match fun {
        M::Sqrt | M::InverseSqrt | M::Exp | M::Exp2 | M::Log | M::Log2 | M::Sin | M::Cos => {
            4.0 * width
        }
        M::Pow
        | M::Tan
        | M::Acos
        | M::Asin
        | M::Atan
        | M::Atan2
        | M::Sinh
        | M::Cosh
        | M::Tanh
        | M::Asinh
        | M::Acosh
        | M::Atanh => 8.0 * width,
        M::Dot => 2.0 * argument - 1.0,
        M::Length => 2.0 * argument + 3.0,
        M::Distance => 3.0 * argument + 3.0,
        M::Normalize => 3.0 * argument + 3.0,
        M::Cross => 9.0,
        M::Reflect | M::FaceForward => 4.0 * argument,
        M::Refract => 6.0 * argument + 8.0,
        M::Mix => 2.0 * width,
        M::SmoothStep => 9.0 * width,
        M::Outer => width,
        M::Inverse => 8.0 * width,
        M::Determinant => 2.0 * argument,
        M::Transpose => 0.0,
        _ => width,
    }
}

/// The cost of running a statement once, without its blocks, its emitted expressions and its
/// callees.
pub(crate) fn of_statement(module: &Module, f: &FunctionGraph<'_>, id: StmtId) -> f64 {
    match f.statements.get(id).statement {
        Statement::If { .. } | Statement::Switch { .. } | Statement::Loop { .. } => 1.0,
        Statement::Store { pointer, .. } => match f.ty(module, *pointer).pointer_space() {
            Some(AddressSpace::Storage { .. } | AddressSpace::WorkGroup) => 8.0,
            _ => 0.0,
        },
        Statement::ImageStore { .. } => 16.0,
        Statement::Atomic { .. } | Statement::ImageAtomic { .. } => 32.0,
        Statement::ControlBarrier(_)
        | Statement::MemoryBarrier(_)
        | Statement::WorkGroupUniformLoad { .. }
        | Statement::SubgroupBallot { .. }
        | Statement::SubgroupGather { .. }
        | Statement::SubgroupCollectiveOperation { .. } => 8.0,
        Statement::RayQuery { .. } | Statement::RayPipelineFunction(_) => 128.0,
        Statement::CooperativeStore { .. } => 64.0,
        _ => 0.0,
    }
}

/// How often each statement runs per run of the function, by [`StmtId`].
pub(crate) fn multiplicity(module: &Module, f: &FunctionGraph<'_>) -> Vec<f64> {
    let mut times: Vec<f64> = Vec::with_capacity(f.statements.len());
    for (id, node) in f.statements.iter() {
        let outer = node.parent.map_or(1.0, |p| times[p.index()]);
        times.push(match node.statement {
            Statement::Loop { .. } => {
                outer * counted::trips(module, f, id).map_or(DEFAULT_TRIPS, f64::from)
            }
            _ => outer,
        });
    }
    times
}
