//! The static cost model: an estimate of what a node costs one invocation, in weighted scalar operations ("ops"): 1 is the addition of two
//! floats.
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
//! | branch, and each turn of a loop | 1 |
//!
//! Both arms of a branch count. What stands in a loop counts once for each turn: as many as a counted loop is seen to make, or else
//! [`DEFAULT_TRIPS`].

use naga::{
    AddressSpace, BinaryOperator, Expression, Handle, ImageQuery, Literal, LocalVariable,
    MathFunction, Module, SampleLevel, ScalarKind, Statement, TypeInner,
};

use super::cells::Root;
use super::memory::{Origin, VersionId};
use super::{FunctionGraph, StmtId};

/// Turns a loop is taken to make when it is not seen how many it makes.
pub const DEFAULT_TRIPS: f64 = 8.0;

/// Longest run followed to count a loop's turns.
const MOST_TRIPS: u32 = 4096;

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

/// The cost of running a statement once, its blocks, the expressions it emits and what it calls apart.
pub fn of_statement(module: &Module, f: &FunctionGraph<'_>, id: StmtId) -> f64 {
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

/// How often each statement runs for one run of the function, by [`StmtId`].
pub fn multiplicity(module: &Module, f: &FunctionGraph<'_>) -> Vec<f64> {
    let mut times: Vec<f64> = Vec::with_capacity(f.statements.len());
    for (id, node) in f.statements.iter() {
        let outer = node.parent.map_or(1.0, |p| times[p.index()]);
        times.push(match node.statement {
            Statement::Loop { .. } => outer * trips(module, f, id).map_or(DEFAULT_TRIPS, f64::from),
            _ => outer,
        });
    }
    times
}

/// The number of turns of a counted loop: a local that starts at a constant, is stepped by a constant once a turn, and is compared with a
/// constant before anything else happens. `None` for any other loop, and where the counter would leave the range of its type: there it wraps, and the loop
/// may never end.
pub fn trips(module: &Module, f: &FunctionGraph<'_>, id: StmtId) -> Option<u32> {
    let Statement::Loop { body, .. } = f.statements.get(id).statement else {
        return None;
    };
    let (condition, while_true) = body.iter().find_map(|s| match s {
        Statement::Emit(_) => None,
        Statement::If {
            condition,
            accept,
            reject,
        } => match (accept.as_ref(), reject.as_ref()) {
            ([], [Statement::Break]) => Some(Some((*condition, true))),
            ([Statement::Break], []) => Some(Some((*condition, false))),
            _ => Some(None),
        },
        _ => Some(None),
    })??;
    let (condition, while_true) = match f.function.expressions[condition] {
        Expression::Unary {
            op: naga::UnaryOperator::LogicalNot,
            expr,
        } => (expr, !while_true),
        _ => (condition, while_true),
    };
    let Expression::Binary { op, left, right } = f.function.expressions[condition] else {
        return None;
    };
    let (counter, seen) = counter_version(f, left)?;
    let bound = integer(module, f, right)?;
    let Origin::Phi {
        at: Some(at),
        operands,
    } = f.memory.origin(seen)
    else {
        return None;
    };
    let [start, latch] = operands.as_slice() else {
        return None;
    };
    if *at != id {
        return None;
    }
    let start = match f.memory.origin(*start) {
        Origin::Initial => match f.function.local_variables[counter].init {
            Some(init) => integer(module, f, init)?,
            None => 0,
        },
        Origin::Written { by, over: None } => match f.statements.get(*by).statement {
            Statement::Store { value, .. } => integer(module, f, *value)?,
            _ => return None,
        },
        _ => return None,
    };
    let Origin::Written { by, over: None } = f.memory.origin(*latch) else {
        return None;
    };
    let Statement::Store { value, .. } = f.statements.get(*by).statement else {
        return None;
    };
    let Expression::Binary {
        op: step_op,
        left: stepped,
        right: step,
    } = f.function.expressions[*value]
    else {
        return None;
    };
    if counter_version(f, stepped)? != (counter, seen) {
        return None;
    }
    let step = integer(module, f, step)?;
    let range = match module.types[f.function.local_variables[counter].ty].inner {
        TypeInner::Scalar(naga::Scalar::I32) => i64::from(i32::MIN)..=i64::from(i32::MAX),
        TypeInner::Scalar(naga::Scalar::U32) => 0..=i64::from(u32::MAX),
        _ => return None,
    };
    let mut value = start;
    for turn in 0..MOST_TRIPS {
        let holds = match op {
            BinaryOperator::Less => value < bound,
            BinaryOperator::LessEqual => value <= bound,
            BinaryOperator::Greater => value > bound,
            BinaryOperator::GreaterEqual => value >= bound,
            BinaryOperator::NotEqual => value != bound,
            BinaryOperator::Equal => value == bound,
            _ => return None,
        };
        if holds != while_true {
            return Some(turn);
        }
        value = match step_op {
            BinaryOperator::Add => value.checked_add(step)?,
            BinaryOperator::Subtract => value.checked_sub(step)?,
            BinaryOperator::Multiply => value.checked_mul(step)?,
            _ => return None,
        };
        if !range.contains(&value) {
            return None;
        }
    }
    None
}

/// The local an expression loads whole, and the version it sees.
fn counter_version(
    f: &FunctionGraph<'_>,
    e: Handle<Expression>,
) -> Option<(Handle<LocalVariable>, VersionId)> {
    let [seen] = f.memory.loads.get(&e)?.as_slice() else {
        return None;
    };
    match f.memory.cell(*seen).root {
        Root::Local(v) if f.memory.cell(*seen).path.is_empty() => Some((v, *seen)),
        _ => None,
    }
}

fn integer(module: &Module, f: &FunctionGraph<'_>, e: Handle<Expression>) -> Option<i64> {
    let literal = |e: &Expression| match e {
        Expression::Literal(Literal::I32(v)) => Some(i64::from(*v)),
        Expression::Literal(Literal::U32(v)) => Some(i64::from(*v)),
        Expression::ZeroValue(_) => Some(0),
        _ => None,
    };
    match &f.function.expressions[e] {
        Expression::Constant(c) => literal(&module.global_expressions[module.constants[*c].init]),
        e => literal(e),
    }
}
