//! Operands of expressions and statements: the only place that matches every variant of naga's IR
//! by its operands.
#![warn(missing_docs)]

pub mod calls;

use naga::{
    Arena, AtomicFunction, CooperativeData, Expression, Function, GatherMode, Handle, ImageQuery,
    RayPipelineFunction, RayQueryFunction, SampleLevel, Statement,
};

type Operand = Handle<Expression>;

/// Calls `f` on every operand of `expression`, in the order naga declares them.
pub fn map_expression(expression: &mut Expression, f: &mut dyn FnMut(&mut Operand)) {
    use Expression as E;
    match expression {
        E::Literal(_)
        | E::Constant(_)
        | E::Override(_)
        | E::ZeroValue(_)
        | E::FunctionArgument(_)
        | E::GlobalVariable(_)
        | E::LocalVariable(_)
        | E::CallResult(_)
        | E::AtomicResult { .. }
        | E::WorkGroupUniformLoadResult { .. }
        | E::RayQueryProceedResult
        | E::SubgroupBallotResult
        | E::SubgroupOperationResult { .. } => {}
        E::Compose { components, .. } => components.iter_mut().for_each(f),
        E::Access { base, index } => {
            f(base);
            f(index);
        }
        E::AccessIndex { base, .. } => f(base),
        E::Splat { value, .. } => f(value),
        E::Swizzle { vector, .. } => f(vector),
        E::Load { pointer } => f(pointer),
        E::ImageSample {
            image,
            sampler,
            gather: _,
            coordinate,
            array_index,
            offset,
            level,
            depth_ref,
            clamp_to_edge: _,
        } => {
            f(image);
            f(sampler);
            f(coordinate);
            array_index.iter_mut().for_each(&mut *f);
            offset.iter_mut().for_each(&mut *f);
            match level {
                SampleLevel::Auto | SampleLevel::Zero => {}
                SampleLevel::Exact(e) | SampleLevel::Bias(e) => f(e),
                SampleLevel::Gradient { x, y } => {
                    f(x);
                    f(y);
                }
            }
            depth_ref.iter_mut().for_each(f);
        }
        E::ImageLoad {
            image,
            coordinate,
            array_index,
            sample,
            level,
        } => {
            f(image);
            f(coordinate);
            array_index.iter_mut().for_each(&mut *f);
            sample.iter_mut().for_each(&mut *f);
            level.iter_mut().for_each(f);
        }
        E::ImageQuery { image, query } => {
            f(image);
            if let ImageQuery::Size { level } = query {
                level.iter_mut().for_each(f);
            }
        }
        E::Unary { expr, .. } | E::Derivative { expr, .. } | E::As { expr, .. } => f(expr),
        E::Binary { left, right, .. } => {
            f(left);
            f(right);
        }
        E::Select {
            condition,
            accept,
            reject,
        } => {
            f(condition);
            f(accept);
            f(reject);
        }
        E::Relational { argument, .. } => f(argument),
        E::Math {
            fun: _,
            arg,
            arg1,
            arg2,
            arg3,
        } => {
            f(arg);
            for a in [arg1, arg2, arg3] {
                a.iter_mut().for_each(&mut *f);
            }
        }
        E::ArrayLength(e) => f(e),
        E::RayQueryVertexPositions { query, .. } | E::RayQueryGetIntersection { query, .. } => {
            f(query);
        }
        E::CooperativeLoad { data, .. } => map_cooperative(data, f),
        E::CooperativeMultiplyAdd { a, b, c } => {
            f(a);
            f(b);
            f(c);
        }
    }
}

fn map_cooperative(data: &mut CooperativeData, f: &mut dyn FnMut(&mut Operand)) {
    f(&mut data.pointer);
    f(&mut data.stride);
}

/// Calls `f` on every expression that a statement itself reads. Its result, its blocks and the
/// expressions of an `Emit` are excluded.
pub fn map_statement(statement: &mut Statement, f: &mut dyn FnMut(&mut Operand)) {
    use Statement as S;
    match statement {
        S::Emit(_)
        | S::Block(_)
        | S::Break
        | S::Continue
        | S::Kill
        | S::ControlBarrier(_)
        | S::MemoryBarrier(_) => {}
        S::If { condition, .. } => f(condition),
        S::Switch { selector, .. } => f(selector),
        S::Loop { break_if, .. } => break_if.iter_mut().for_each(f),
        S::Return { value } => value.iter_mut().for_each(f),
        S::Store { pointer, value } => {
            f(pointer);
            f(value);
        }
        S::ImageStore {
            image,
            coordinate,
            array_index,
            value,
        } => {
            f(image);
            f(coordinate);
            array_index.iter_mut().for_each(&mut *f);
            f(value);
        }
        S::Atomic {
            pointer,
            fun,
            value,
            result: _,
        } => {
            f(pointer);
            map_atomic(fun, f);
            f(value);
        }
        S::ImageAtomic {
            image,
            coordinate,
            array_index,
            fun,
            value,
        } => {
            f(image);
            f(coordinate);
            array_index.iter_mut().for_each(&mut *f);
            map_atomic(fun, f);
            f(value);
        }
        S::WorkGroupUniformLoad { pointer, result: _ } => f(pointer),
        S::Call { arguments, .. } => arguments.iter_mut().for_each(f),
        S::RayQuery { query, fun } => {
            f(query);
            match fun {
                RayQueryFunction::Initialize {
                    acceleration_structure,
                    descriptor,
                } => {
                    f(acceleration_structure);
                    f(descriptor);
                }
                RayQueryFunction::GenerateIntersection { hit_t } => f(hit_t),
                RayQueryFunction::Proceed { .. }
                | RayQueryFunction::ConfirmIntersection
                | RayQueryFunction::Terminate => {}
            }
        }
        S::RayPipelineFunction(RayPipelineFunction::TraceRay {
            acceleration_structure,
            descriptor,
            payload,
        }) => {
            f(acceleration_structure);
            f(descriptor);
            f(payload);
        }
        S::SubgroupBallot {
            result: _,
            predicate,
        } => predicate.iter_mut().for_each(f),
        S::SubgroupGather {
            mode,
            argument,
            result: _,
        } => {
            match mode {
                GatherMode::Broadcast(e)
                | GatherMode::Shuffle(e)
                | GatherMode::ShuffleDown(e)
                | GatherMode::ShuffleUp(e)
                | GatherMode::ShuffleXor(e)
                | GatherMode::QuadBroadcast(e) => f(e),
                GatherMode::BroadcastFirst | GatherMode::QuadSwap(_) => {}
            }
            f(argument);
        }
        S::SubgroupCollectiveOperation { argument, .. } => f(argument),
        S::CooperativeStore { target, data } => {
            f(target);
            map_cooperative(data, f);
        }
    }
}

fn map_atomic(fun: &mut AtomicFunction, f: &mut dyn FnMut(&mut Operand)) {
    if let AtomicFunction::Exchange { compare: Some(e) } = fun {
        f(e);
    }
}

/// The expression whose value a statement provides.
pub fn result_mut(statement: &mut Statement) -> Option<&mut Operand> {
    match statement {
        Statement::Call { result, .. } | Statement::Atomic { result, .. } => result.as_mut(),
        Statement::WorkGroupUniformLoad { result, .. }
        | Statement::RayQuery {
            fun: RayQueryFunction::Proceed { result },
            ..
        }
        | Statement::SubgroupBallot { result, .. }
        | Statement::SubgroupGather { result, .. }
        | Statement::SubgroupCollectiveOperation { result, .. } => Some(result),
        _ => None,
    }
}

/// [`map_statement`], and the result as well.
pub fn map_statement_and_result(statement: &mut Statement, f: &mut dyn FnMut(&mut Operand)) {
    map_statement(statement, f);
    result_mut(statement).into_iter().for_each(f);
}

/// The statement with empty blocks: its own operands and results only.
pub fn shell(statement: &Statement) -> Statement {
    match statement {
        Statement::Block(_) => Statement::Block(naga::Block::new()),
        Statement::If { condition, .. } => Statement::If {
            condition: *condition,
            accept: naga::Block::new(),
            reject: naga::Block::new(),
        },
        Statement::Switch { selector, .. } => Statement::Switch {
            selector: *selector,
            cases: Vec::new(),
        },
        Statement::Loop { break_if, .. } => Statement::Loop {
            body: naga::Block::new(),
            continuing: naga::Block::new(),
            break_if: *break_if,
        },
        other => other.clone(),
    }
}

/// Operands of an expression, in the order of [`map_expression`].
pub fn of_expression(expression: &Expression) -> Vec<Operand> {
    let mut out = Vec::new();
    map_expression(&mut expression.clone(), &mut |e| out.push(*e));
    out
}

/// Operands of a statement, in the order of [`map_statement`].
pub fn of_statement(statement: &Statement) -> Vec<Operand> {
    let mut out = Vec::new();
    map_statement(&mut shell(statement), &mut |e| out.push(*e));
    out
}

/// The expression whose value a statement provides.
pub fn result(statement: &Statement) -> Option<Operand> {
    result_mut(&mut shell(statement)).copied()
}

/// The blocks of a statement, in the order in which statements are numbered.
pub fn blocks(statement: &Statement) -> Vec<&naga::Block> {
    match statement {
        Statement::Block(b) => vec![b],
        Statement::If { accept, reject, .. } => vec![accept, reject],
        Statement::Switch { cases, .. } => cases.iter().map(|c| &c.body).collect(),
        Statement::Loop {
            body, continuing, ..
        } => vec![body, continuing],
        _ => Vec::new(),
    }
}

/// As [`blocks`], but mutable.
pub fn blocks_mut(statement: &mut Statement) -> Vec<&mut naga::Block> {
    match statement {
        Statement::Block(b) => vec![b],
        Statement::If { accept, reject, .. } => vec![accept, reject],
        Statement::Switch { cases, .. } => cases.iter_mut().map(|c| &mut c.body).collect(),
        Statement::Loop {
            body, continuing, ..
        } => vec![body, continuing],
        _ => Vec::new(),
    }
}

/// Calls `f` on the statements of a block and of the blocks inside, in the order in which they are
/// numbered.
pub fn visit<'b>(block: &'b naga::Block, f: &mut dyn FnMut(&'b Statement)) {
    // Not recursive: modules that are nested too deeply are refused after some of these visits.
    let mut open = vec![block.iter()];
    while let Some(innermost) = open.last_mut() {
        let Some(statement) = innermost.next() else {
            open.pop();
            continue;
        };
        f(statement);
        open.extend(blocks(statement).into_iter().rev().map(|b| b.iter()));
    }
}

/// As [`visit`], but mutable.
pub fn visit_mut(block: &mut naga::Block, f: &mut dyn FnMut(&mut Statement)) {
    for statement in block.iter_mut() {
        f(statement);
        for inner in blocks_mut(statement) {
            visit_mut(inner, f);
        }
    }
}

/// Calls `f` on each expression that the statements of a block evaluate or provide.
pub fn evaluated(block: &naga::Block, f: &mut dyn FnMut(Operand)) {
    visit(block, &mut |statement| {
        if let Statement::Emit(range) = statement {
            range.clone().for_each(&mut *f);
        }
        result(statement).into_iter().for_each(&mut *f);
    });
}

/// Puts blocks into the [`shell`] of a statement, in the order of [`blocks`].
pub fn fill(shell: &mut Statement, of: &Statement, inner: impl IntoIterator<Item = naga::Block>) {
    if let (Statement::Switch { cases, .. }, Statement::Switch { cases: old, .. }) =
        (&mut *shell, of)
    {
        *cases = old
            .iter()
            .map(|case| naga::SwitchCase {
                value: case.value,
                body: naga::Block::new(),
                fall_through: case.fall_through,
            })
            .collect();
    }
    for (slot, block) in blocks_mut(shell).into_iter().zip(inner) {
        *slot = block;
    }
}

/// The expression that a chain of accesses starts from: a pointer's variable, or the value of which
/// they take a part.
pub fn base(expressions: &Arena<Expression>, mut part: Operand) -> Operand {
    while let Expression::Access { base, .. } | Expression::AccessIndex { base, .. } =
        expressions[part]
    {
        part = base;
    }
    part
}

/// The value of a constant integer index.
pub fn constant_index(
    module: &naga::Module,
    function: &Function,
    index: Handle<Expression>,
) -> Option<u32> {
    let literal = |e: &Expression| match e {
        Expression::Literal(naga::Literal::U32(v)) => Some(*v),
        Expression::Literal(naga::Literal::I32(v)) => u32::try_from(*v).ok(),
        Expression::ZeroValue(ty)
            if matches!(module.types[*ty].inner, naga::TypeInner::Scalar(_)) =>
        {
            Some(0)
        }
        _ => None,
    };
    match &function.expressions[index] {
        Expression::Constant(c) => literal(&module.global_expressions[module.constants[*c].init]),
        e => literal(e),
    }
}
