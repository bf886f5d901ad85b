//! Effects: a node's side effects, and its dependences on other invocations.

use std::collections::BTreeSet;

use naga::{AddressSpace, Binding, BuiltIn, Expression, Module, SampleLevel, Statement, TypeInner};
use serde::{Deserialize, Serialize};

use super::cells::{self, Root};
use super::{FunctionGraph, StmtId};

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Effect {
    Discard,
    /// Takes a screen-space derivative: reads the neighbours in the quad.
    Derivative,
    /// Samples at an implicit level, which depends on the neighbours in the quad.
    ImplicitLod,
    /// Writes a storage buffer or workgroup memory.
    Store,
    ImageStore,
    Atomic,
    FragDepth,
    /// Waits for, or orders memory with, other invocations.
    Barrier,
    /// Exchanges values within a subgroup.
    Subgroup,
    /// Traverses or traces a ray.
    RayQuery,
}

impl Effect {
    /// The effects that write memory.
    pub const WRITES: [Self; 3] = [Self::Store, Self::ImageStore, Self::Atomic];

    /// The name in messages and JSON.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Discard => "discard",
            Self::Derivative => "derivative",
            Self::ImplicitLod => "implicit-lod",
            Self::Store => "store",
            Self::ImageStore => "image-store",
            Self::Atomic => "atomic",
            Self::FragDepth => "frag-depth",
            Self::Barrier => "barrier",
            Self::Subgroup => "subgroup",
            Self::RayQuery => "ray-query",
        }
    }
}

/// Effects of a node or, through calls, of a function.
pub type Effects = BTreeSet<Effect>;

/// The effect of evaluating an expression.
pub fn of_expression(expression: &Expression) -> Option<Effect> {
    match expression {
        Expression::Derivative { .. } => Some(Effect::Derivative),
        Expression::ImageSample {
            level: SampleLevel::Auto | SampleLevel::Bias(_),
            gather: None,
            ..
        } => Some(Effect::ImplicitLod),
        _ => None,
    }
}

/// The effect of a statement, without its blocks and callees.
pub fn of_statement(module: &Module, f: &FunctionGraph<'_>, id: StmtId) -> Option<Effect> {
    match f.statements.get(id).statement {
        Statement::Kill => Some(Effect::Discard),
        Statement::Store { pointer, .. } => {
            match cells::place(module, f.function, *pointer)?.root {
                Root::Global(g) if module.global_variables[g].space != AddressSpace::Private => {
                    Some(Effect::Store)
                }
                _ => None,
            }
        }
        Statement::ImageStore { .. } => Some(Effect::ImageStore),
        Statement::Atomic { .. } | Statement::ImageAtomic { .. } => Some(Effect::Atomic),
        Statement::ControlBarrier(_)
        | Statement::MemoryBarrier(_)
        | Statement::WorkGroupUniformLoad { .. } => Some(Effect::Barrier),
        Statement::SubgroupBallot { .. }
        | Statement::SubgroupGather { .. }
        | Statement::SubgroupCollectiveOperation { .. }
        | Statement::CooperativeStore { .. } => Some(Effect::Subgroup),
        Statement::RayQuery { .. } | Statement::RayPipelineFunction(_) => Some(Effect::RayQuery),
        Statement::Return { value: Some(_) } if writes_frag_depth(module, f) => {
            Some(Effect::FragDepth)
        }
        _ => None,
    }
}

fn writes_frag_depth(module: &Module, f: &FunctionGraph<'_>) -> bool {
    let is_depth = |b: &Option<Binding>| matches!(b, Some(Binding::BuiltIn(BuiltIn::FragDepth)));
    matches!(f.id, super::FunctionId::EntryPoint(_))
        && f.function.result.as_ref().is_some_and(|r| {
            is_depth(&r.binding)
                || matches!(&module.types[r.ty].inner, TypeInner::Struct { members, .. }
                    if members.iter().any(|m| is_depth(&m.binding)))
        })
}

/// The effects of a function's own reachable nodes.
pub(crate) fn own(module: &Module, f: &FunctionGraph<'_>) -> Effects {
    let mut effects = Effects::new();
    for (id, node) in f.statements.iter() {
        if !f.control.is_reachable(id) {
            continue;
        }
        effects.extend(of_statement(module, f, id));
        if let Statement::Emit(range) = node.statement {
            effects.extend(
                range
                    .clone()
                    .filter_map(|e| of_expression(&f.function.expressions[e])),
            );
        }
    }
    effects
}
