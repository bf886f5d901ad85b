//! The interface of a placed entry point: arguments and result narrowed to the slice.

use naga::proc::Layouter;
use naga::{
    Binding, FunctionArgument, FunctionResult, Handle, Module, StructMember, Type, TypeInner,
};

use naga_edit::interface;
use preshade_dataflow::slice::Need;

/// Whether a placed entry point's position is invariant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PositionInvariance {
    #[default]
    AsWritten,
    Invariant,
}

/// Options of a placed entry point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placement<'a> {
    /// The new entry point's name.
    pub name: &'a str,
    /// Suffix of narrowed functions and types.
    pub suffix: &'a str,
    /// Whether the position is invariant.
    pub position: PositionInvariance,
}

/// A struct with some members removed.
#[derive(Clone, Debug)]
pub(crate) struct Narrowed {
    pub whole: Handle<Type>,
    pub ty: Handle<Type>,
    /// The kept members, by index in the author's type.
    pub members: Vec<u32>,
}

/// The returned part of the entry point's result.
#[derive(Clone, Debug)]
pub(crate) enum Returned {
    Nothing,
    /// The author's value.
    Whole,
    /// One member of the author's struct.
    Member(u32),
    /// These members of the author's struct, in a new one.
    Members(Vec<u32>, Handle<Type>),
}

/// A struct type with selected members of another. Offsets follow from the members' alignment.
pub(crate) fn narrow_struct(
    module: &mut Module,
    ty: Handle<Type>,
    members: &[u32],
    suffix: &str,
    position: PositionInvariance,
) -> Handle<Type> {
    let original = module.types[ty].clone();
    let TypeInner::Struct { members: all, .. } = &original.inner else {
        return ty;
    };
    let kept = members
        .iter()
        .map(|index| {
            let member = &all[*index as usize];
            StructMember {
                binding: mark(member.binding.clone(), position),
                ..member.clone()
            }
        })
        .collect();
    let name = original.name.as_ref().map(|n| format!("{n}_{suffix}"));
    io_struct(module, name, kept)
}

/// A struct type with these members. Offsets follow from their alignment.
pub fn io_struct(
    module: &mut Module,
    name: Option<String>,
    mut members: Vec<StructMember>,
) -> Handle<Type> {
    let mut layouter = Layouter::default();
    // The module is valid, so all its types have a layout.
    let laid_out = layouter.update(module.to_ctx()).is_ok();
    let (mut span, mut align) = (0, naga::proc::Alignment::ONE);
    for member in members.iter_mut().filter(|_| laid_out) {
        let layout = layouter[member.ty];
        member.offset = layout.alignment.round_up(span);
        span = member.offset + layout.size;
        align = align.max(layout.alignment);
    }
    let inner = TypeInner::Struct {
        members,
        span: align.round_up(span),
    };
    module
        .types
        .insert(Type { name, inner }, naga::Span::UNDEFINED)
}

/// The binding with the wanted invariance.
pub(crate) fn mark(binding: Option<Binding>, position: PositionInvariance) -> Option<Binding> {
    match position {
        PositionInvariance::AsWritten => binding,
        PositionInvariance::Invariant => interface::invariant(binding),
    }
}

/// An argument narrowed to a need; `None` as the second item if it keeps its type.
pub(crate) fn argument(
    module: &mut Module,
    argument: &FunctionArgument,
    need: &Need,
    suffix: &str,
) -> (FunctionArgument, Option<Narrowed>) {
    let kept: Vec<u32> = match (&module.types[argument.ty].inner, need) {
        (TypeInner::Struct { members, .. }, Need::Members(needed))
            if argument.binding.is_none() && needed.len() < members.len() =>
        {
            needed.keys().copied().collect()
        }
        _ => return (argument.clone(), None),
    };
    let ty = narrow_struct(
        module,
        argument.ty,
        &kept,
        suffix,
        PositionInvariance::AsWritten,
    );
    let narrowed = FunctionArgument {
        ty,
        ..argument.clone()
    };
    (
        narrowed,
        Some(Narrowed {
            whole: argument.ty,
            ty,
            members: kept,
        }),
    )
}

/// A function's result narrowed to a need.
pub(crate) fn callee_result(
    module: &mut Module,
    result: &FunctionResult,
    need: &Need,
    suffix: &str,
) -> (FunctionResult, Returned) {
    let members = match &module.types[result.ty].inner {
        TypeInner::Struct { members, .. } => members.clone(),
        _ => return (result.clone(), Returned::Whole),
    };
    let kept: Vec<u32> = match need {
        Need::Members(needed) if needed.len() < members.len() => needed.keys().copied().collect(),
        _ => return (result.clone(), Returned::Whole),
    };
    if let [one] = kept[..] {
        let bare = FunctionResult {
            ty: members[one as usize].ty,
            binding: None,
        };
        return (bare, Returned::Member(one));
    }
    let ty = narrow_struct(
        module,
        result.ty,
        &kept,
        suffix,
        PositionInvariance::AsWritten,
    );
    (
        FunctionResult { ty, binding: None },
        Returned::Members(kept, ty),
    )
}

/// An entry result narrowed to the outputs a slice decides.
pub(crate) fn result(
    module: &mut Module,
    result: Option<&FunctionResult>,
    outputs: &[usize],
    placement: &Placement<'_>,
) -> (Option<FunctionResult>, Returned) {
    let Some(result) = result.filter(|_| !outputs.is_empty()) else {
        return (None, Returned::Nothing);
    };
    let members = match &module.types[result.ty].inner {
        TypeInner::Struct { members, .. } if result.binding.is_none() => members.clone(),
        _ => {
            let marked = FunctionResult {
                ty: result.ty,
                binding: mark(result.binding.clone(), placement.position),
            };
            return (Some(marked), Returned::Whole);
        }
    };
    if let [one] = outputs {
        let member = &members[*one];
        let bare = FunctionResult {
            ty: member.ty,
            binding: mark(member.binding.clone(), placement.position),
        };
        return (Some(bare), Returned::Member(*one as u32));
    }
    let unmarked = members
        .iter()
        .all(|m| mark(m.binding.clone(), placement.position) == m.binding);
    if outputs.len() == members.len() && unmarked {
        return (Some(result.clone()), Returned::Whole);
    }
    let kept: Vec<u32> = outputs.iter().map(|o| *o as u32).collect();
    let ty = narrow_struct(
        module,
        result.ty,
        &kept,
        placement.suffix,
        placement.position,
    );
    (
        Some(FunctionResult { ty, binding: None }),
        Returned::Members(kept, ty),
    )
}
