//! Atomic and subgroup functions by name.

use naga::{AtomicFunction, CollectiveOperation, Direction, SubgroupOperation};

/// The atomic function on storage blocks with a GLSL name.
pub(super) fn atomic(name: &str) -> Option<AtomicFunction> {
    operation(name.strip_prefix("atomic")?)
}

/// The atomic function on images with a GLSL name, if naga supports it.
pub(super) fn image_atomic(name: &str) -> Option<AtomicFunction> {
    operation(name.strip_prefix("imageAtomic")?)
        .filter(|a| !matches!(a, AtomicFunction::Exchange { .. }))
}

fn operation(word: &str) -> Option<AtomicFunction> {
    Some(match word {
        "Add" => AtomicFunction::Add,
        "And" => AtomicFunction::And,
        "Or" => AtomicFunction::InclusiveOr,
        "Xor" => AtomicFunction::ExclusiveOr,
        "Min" => AtomicFunction::Min,
        "Max" => AtomicFunction::Max,
        "Exchange" => AtomicFunction::Exchange { compare: None },
        _ => return None,
    })
}

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

/// The subgroup function with a GLSL name (GL_KHR_shader_subgroup). `lane`: its second argument, if
/// constant.
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
            // WGSL has no other scans.
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
