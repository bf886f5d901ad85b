//! The expressions that an expression or a statement refers to, for remapping them.

use naga::{
    AtomicFunction, Block, Expression, GatherMode, Handle, ImageQuery, RayQueryFunction,
    SampleLevel, Statement,
};

/// Calls `f` on every operand of `expression`.
pub(crate) fn of_expression(
    expression: &mut Expression,
    mut f: impl FnMut(&mut Handle<Expression>),
) {
    match expression {
        Expression::Literal(_)
        | Expression::Constant(_)
        | Expression::Override(_)
        | Expression::ZeroValue(_)
        | Expression::FunctionArgument(_)
        | Expression::GlobalVariable(_)
        | Expression::LocalVariable(_)
        | Expression::CallResult(_)
        | Expression::AtomicResult { .. }
        | Expression::WorkGroupUniformLoadResult { .. }
        | Expression::RayQueryProceedResult
        | Expression::SubgroupBallotResult
        | Expression::SubgroupOperationResult { .. } => {}
        Expression::Compose { components, .. } => components.iter_mut().for_each(f),
        Expression::Access { base, index } => [base, index].into_iter().for_each(f),
        Expression::AccessIndex { base: e, .. }
        | Expression::Splat { value: e, .. }
        | Expression::Swizzle { vector: e, .. }
        | Expression::Load { pointer: e }
        | Expression::Unary { expr: e, .. }
        | Expression::Derivative { expr: e, .. }
        | Expression::Relational { argument: e, .. }
        | Expression::As { expr: e, .. }
        | Expression::ArrayLength(e)
        | Expression::RayQueryVertexPositions { query: e, .. }
        | Expression::RayQueryGetIntersection { query: e, .. } => f(e),
        Expression::ImageSample {
            image,
            sampler,
            coordinate,
            array_index,
            offset,
            level,
            depth_ref,
            ..
        } => {
            [image, sampler, coordinate].into_iter().for_each(&mut f);
            [array_index, offset, depth_ref]
                .into_iter()
                .flatten()
                .for_each(&mut f);
            match level {
                SampleLevel::Auto | SampleLevel::Zero => {}
                SampleLevel::Exact(e) | SampleLevel::Bias(e) => f(e),
                SampleLevel::Gradient { x, y } => [x, y].into_iter().for_each(f),
            }
        }
        Expression::ImageLoad {
            image,
            coordinate,
            array_index,
            sample,
            level,
        } => {
            [image, coordinate].into_iter().for_each(&mut f);
            [array_index, sample, level]
                .into_iter()
                .flatten()
                .for_each(f);
        }
        Expression::ImageQuery { image, query } => {
            f(image);
            if let ImageQuery::Size { level: Some(level) } = query {
                f(level);
            }
        }
        Expression::Binary { left, right, .. } => [left, right].into_iter().for_each(f),
        Expression::Select {
            condition,
            accept,
            reject,
        } => [condition, accept, reject].into_iter().for_each(f),
        Expression::Math {
            arg,
            arg1,
            arg2,
            arg3,
            ..
        } => {
            f(arg);
            [arg1, arg2, arg3].into_iter().flatten().for_each(f);
        }
        Expression::CooperativeLoad { data, .. } => {
            [&mut data.pointer, &mut data.stride]
                .into_iter()
                .for_each(f);
        }
        Expression::CooperativeMultiplyAdd { a, b, c } => [a, b, c].into_iter().for_each(f),
    }
}

/// Calls `f` on every expression that `statement` itself names, results included; not on those of `Emit`s nor of nested blocks.
#[cfg_attr(
    not(any(test, feature = "glsl")),
    allow(dead_code, reason = "only GLSL's rewrites rebuild statements")
)]
pub(crate) fn of_statement(statement: &mut Statement, mut f: impl FnMut(&mut Handle<Expression>)) {
    match statement {
        Statement::Emit(_)
        | Statement::Block(_)
        | Statement::Break
        | Statement::Continue
        | Statement::Kill
        | Statement::ControlBarrier(_)
        | Statement::MemoryBarrier(_) => {}
        Statement::If { condition, .. } => f(condition),
        Statement::Switch { selector, .. } => f(selector),
        Statement::Loop { break_if, .. } => break_if.iter_mut().for_each(f),
        Statement::Return { value } => value.iter_mut().for_each(f),
        Statement::Store { pointer, value } => [pointer, value].into_iter().for_each(f),
        Statement::ImageStore {
            image,
            coordinate,
            array_index,
            value,
        } => {
            [image, coordinate, value].into_iter().for_each(&mut f);
            array_index.iter_mut().for_each(f);
        }
        Statement::Atomic {
            pointer,
            fun,
            value,
            result,
        } => {
            [pointer, value].into_iter().for_each(&mut f);
            result.iter_mut().for_each(&mut f);
            if let AtomicFunction::Exchange {
                compare: Some(compare),
            } = fun
            {
                f(compare);
            }
        }
        Statement::ImageAtomic {
            image,
            coordinate,
            array_index,
            fun,
            value,
        } => {
            [image, coordinate, value].into_iter().for_each(&mut f);
            array_index.iter_mut().for_each(&mut f);
            if let AtomicFunction::Exchange {
                compare: Some(compare),
            } = fun
            {
                f(compare);
            }
        }
        Statement::WorkGroupUniformLoad { pointer, result } => {
            [pointer, result].into_iter().for_each(f);
        }
        Statement::Call {
            arguments, result, ..
        } => {
            arguments.iter_mut().for_each(&mut f);
            result.iter_mut().for_each(f);
        }
        Statement::RayQuery { query, fun } => {
            f(query);
            match fun {
                RayQueryFunction::Initialize {
                    acceleration_structure,
                    descriptor,
                } => [acceleration_structure, descriptor].into_iter().for_each(f),
                RayQueryFunction::Proceed { result } => f(result),
                RayQueryFunction::GenerateIntersection { hit_t } => f(hit_t),
                RayQueryFunction::ConfirmIntersection | RayQueryFunction::Terminate => {}
            }
        }
        Statement::RayPipelineFunction(naga::RayPipelineFunction::TraceRay {
            acceleration_structure,
            descriptor,
            payload,
        }) => [acceleration_structure, descriptor, payload]
            .into_iter()
            .for_each(f),
        Statement::SubgroupBallot { result, predicate } => {
            f(result);
            predicate.iter_mut().for_each(f);
        }
        Statement::SubgroupGather {
            mode,
            argument,
            result,
        } => {
            [argument, result].into_iter().for_each(&mut f);
            match mode {
                GatherMode::BroadcastFirst | GatherMode::QuadSwap(_) => {}
                GatherMode::Broadcast(e)
                | GatherMode::Shuffle(e)
                | GatherMode::ShuffleDown(e)
                | GatherMode::ShuffleUp(e)
                | GatherMode::ShuffleXor(e)
                | GatherMode::QuadBroadcast(e) => f(e),
            }
        }
        Statement::SubgroupCollectiveOperation {
            argument, result, ..
        } => [argument, result].into_iter().for_each(f),
        Statement::CooperativeStore { target, data } => {
            [target, &mut data.pointer, &mut data.stride]
                .into_iter()
                .for_each(f);
        }
    }
}

/// The blocks directly inside `statement`.
pub(crate) fn blocks(statement: &mut Statement) -> Vec<&mut Block> {
    match statement {
        Statement::Block(block) => vec![block],
        Statement::If { accept, reject, .. } => vec![accept, reject],
        Statement::Switch { cases, .. } => cases.iter_mut().map(|c| &mut c.body).collect(),
        Statement::Loop {
            body, continuing, ..
        } => vec![body, continuing],
        _ => Vec::new(),
    }
}
