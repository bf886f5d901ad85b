//! Implements functions that naga's IR has and its GLSL front end lacks: gathers, the
//! subgroup functions and atomic functions. The rewritten text calls placeholder functions, whose
//! bodies this replaces. `atomics` replaces their calls.

use std::collections::HashMap;

use naga::{
    CollectiveOperation, Direction, Expression, Function, GatherMode, Handle, Literal, Module,
    SampleLevel, Scalar, Span, Statement, SubgroupOperation, SwizzleComponent, Type, TypeInner,
    VectorSize,
};
use preshade_ir::writer::FunctionWriter;

/// What a placeholder function does with its arguments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Placeholder {
    /// Gathers a component of a texture, at an offset in texels.
    Gather {
        component: u32,
        offset: Option<[i32; 2]>,
    },
    Subgroup(Subgroup),
    /// Changes the part of a storage block that its first argument reads.
    Atomic(Atomic),
    /// Stands for the texel that the store of its result changes by its argument.
    ImageAtomic(Atomic),
}

/// The placeholder functions by name.
pub(super) type Placeholders = HashMap<String, Placeholder>;

/// An atomic function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Atomic {
    Add,
    And,
    Or,
    Xor,
    Min,
    Max,
    Exchange,
}

/// The atomic function of that name, of storage blocks.
pub(super) fn atomic(name: &str) -> Option<Atomic> {
    operation(name.strip_prefix("atomic")?)
}

/// The atomic function of that name, of images, as far as naga has it.
pub(super) fn image_atomic(name: &str) -> Option<Atomic> {
    operation(name.strip_prefix("imageAtomic")?).filter(|a| *a != Atomic::Exchange)
}

fn operation(word: &str) -> Option<Atomic> {
    Some(match word {
        "Add" => Atomic::Add,
        "And" => Atomic::And,
        "Or" => Atomic::Or,
        "Xor" => Atomic::Xor,
        "Min" => Atomic::Min,
        "Max" => Atomic::Max,
        "Exchange" => Atomic::Exchange,
        _ => return None,
    })
}

/// A subgroup function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Subgroup {
    Collective(SubgroupOperation, CollectiveOperation),
    Ballot,
    First,
    Broadcast(u32),
    QuadBroadcast(u32),
    Shuffle,
    ShuffleDown,
    ShuffleUp,
    ShuffleXor,
    QuadSwap(Direction),
}

/// The subgroup function of that name (GL_KHR_shader_subgroup). `lane` is its second argument, if
/// that is constant.
pub(super) fn subgroup(name: &str, lane: Option<u32>) -> Option<Subgroup> {
    use CollectiveOperation::{ExclusiveScan, InclusiveScan, Reduce};
    use SubgroupOperation as S;
    let collective = |rest: &str| {
        let (rest, scan) = match rest.strip_prefix("Inclusive") {
            Some(rest) => (rest, InclusiveScan),
            None => match rest.strip_prefix("Exclusive") {
                Some(rest) => (rest, ExclusiveScan),
                None => (rest, Reduce),
            },
        };
        let operation = match rest {
            "Add" => S::Add,
            "Mul" => S::Mul,
            // WGSL scans no others.
            _ if scan != Reduce => return None,
            "Min" => S::Min,
            "Max" => S::Max,
            "And" => S::And,
            "Or" => S::Or,
            "Xor" => S::Xor,
            "All" => S::All,
            "Any" => S::Any,
            _ => return None,
        };
        Some(Subgroup::Collective(operation, scan))
    };
    Some(match name.strip_prefix("subgroup")? {
        "Ballot" => Subgroup::Ballot,
        "BroadcastFirst" => Subgroup::First,
        "Broadcast" => lane.map_or(Subgroup::Shuffle, Subgroup::Broadcast),
        "QuadBroadcast" => Subgroup::QuadBroadcast(lane?),
        "Shuffle" => Subgroup::Shuffle,
        "ShuffleDown" => Subgroup::ShuffleDown,
        "ShuffleUp" => Subgroup::ShuffleUp,
        "ShuffleXor" => Subgroup::ShuffleXor,
        "QuadSwapHorizontal" => Subgroup::QuadSwap(Direction::X),
        "QuadSwapVertical" => Subgroup::QuadSwap(Direction::Y),
        "QuadSwapDiagonal" => Subgroup::QuadSwap(Direction::Diagonal),
        rest => return collective(rest),
    })
}

/// Replaces the bodies of the placeholder functions, which are given by name.
pub(super) fn replace(module: &mut Module, placeholders: &Placeholders) {
    let handles: Vec<_> = module.functions.iter().map(|(h, _)| h).collect();
    for handle in handles {
        let span = module.functions.get_span(handle);
        let function = &mut module.functions[handle];
        let name = function.name.as_deref();
        match name.and_then(|n| placeholders.get(n)) {
            Some(Placeholder::Gather { component, offset }) => {
                let offset = offset.map(|parts| {
                    let inner = TypeInner::Vector {
                        size: VectorSize::Bi,
                        scalar: Scalar::I32,
                    };
                    let ty = Type { name: None, inner };
                    (module.types.insert(ty, Span::UNDEFINED), parts)
                });
                gather(function, *component, offset, span);
            }
            Some(Placeholder::Subgroup(of)) => exchange(function, *of, span),
            Some(Placeholder::Atomic(_) | Placeholder::ImageAtomic(_)) | None => {}
        }
    }
}

/// `offset` is an `ivec2`, whose type comes first.
fn gather(
    function: &mut Function,
    component: u32,
    offset: Option<(Handle<Type>, [i32; 2])>,
    span: Span,
) {
    let mut writer = FunctionWriter::like(function);
    writer.function.local_variables = naga::Arena::new();
    let mut argument = |i: u32| writer.append(Expression::FunctionArgument(i), span);
    let (image, sampler, coordinate) = (argument(0), argument(1), argument(2));
    let depth_ref = (function.arguments.len() > 3).then(|| argument(3));
    let component = SwizzleComponent::XYZW[component.min(3) as usize];
    let offset = offset.map(|(ty, parts)| {
        let part = |n| writer.append(Expression::Literal(Literal::I32(n)), span);
        let components = parts.map(part).to_vec();
        Expression::Compose { ty, components }
    });
    writer.begin();
    let offset = offset.map(|offset| writer.append(offset, span));
    let sample = Expression::ImageSample {
        image,
        sampler,
        gather: Some(component),
        coordinate,
        array_index: None,
        offset,
        level: SampleLevel::Zero,
        depth_ref,
        clamp_to_edge: false,
    };
    let value = Some(writer.append(sample, span));
    writer.statement(Statement::Return { value }, span);
    *function = writer.finish();
}

fn exchange(function: &mut Function, of: Subgroup, span: Span) {
    let Some(ty) = function.result.as_ref().map(|r| r.ty) else {
        return;
    };
    let mut writer = FunctionWriter::like(function);
    writer.function.local_variables = naga::Arena::new();
    let argument = writer.append(Expression::FunctionArgument(0), span);
    let mut lane = || match of {
        Subgroup::Broadcast(n) | Subgroup::QuadBroadcast(n) => {
            writer.append(Expression::Literal(Literal::U32(n)), span)
        }
        _ => writer.append(Expression::FunctionArgument(1), span),
    };
    let mode = match of {
        Subgroup::Collective(..) | Subgroup::Ballot => None,
        Subgroup::First => Some(GatherMode::BroadcastFirst),
        Subgroup::Broadcast(_) => Some(GatherMode::Broadcast(lane())),
        Subgroup::QuadBroadcast(_) => Some(GatherMode::QuadBroadcast(lane())),
        Subgroup::Shuffle => Some(GatherMode::Shuffle(lane())),
        Subgroup::ShuffleDown => Some(GatherMode::ShuffleDown(lane())),
        Subgroup::ShuffleUp => Some(GatherMode::ShuffleUp(lane())),
        Subgroup::ShuffleXor => Some(GatherMode::ShuffleXor(lane())),
        Subgroup::QuadSwap(direction) => Some(GatherMode::QuadSwap(direction)),
    };
    let result = match of {
        Subgroup::Ballot => Expression::SubgroupBallotResult,
        _ => Expression::SubgroupOperationResult { ty },
    };
    let result = writer.append(result, span);
    let statement = match (of, mode) {
        (_, Some(mode)) => Statement::SubgroupGather {
            mode,
            argument,
            result,
        },
        (Subgroup::Collective(op, collective_op), _) => Statement::SubgroupCollectiveOperation {
            op,
            collective_op,
            argument,
            result,
        },
        _ => Statement::SubgroupBallot {
            result,
            predicate: Some(argument),
        },
    };
    writer.statement(statement, span);
    writer.statement(
        Statement::Return {
            value: Some(result),
        },
        span,
    );
    *function = writer.finish();
}
