//! The position slice as a function of the previous frame's buffers and attributes.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    AddressSpace, Expression, Function, GlobalVariable, Handle, Module, StorageAccess, Type,
    TypeInner,
};

use super::{Extending, Failed, Member, Velocity, location_of};
use crate::core::plan::BindingSource;
use crate::core::{calls, reflect};
use crate::graph::FunctionId;
use crate::rebuild::ahead::Ahead;
use crate::rebuild::place::{self, Replacement, Rewrite};
use crate::slice::{self, Criterion, OutputFilter, Slice};

/// Suffix of the copies of functions and buffers.
const PREVIOUS: &str = "previous";

/// Suffix of the functions without jitter.
const STEADY: &str = "steady";

impl Extending<'_, '_> {
    /// Functions that compute the position now and in the previous frame. The first is `None` where
    /// it is the author's own: then nothing is left out.
    pub(super) fn positions(
        &mut self,
        velocity: &Velocity,
    ) -> Result<(Option<Ahead>, Ahead), Failed> {
        let opaque = self.opaque;
        let position = [Criterion::Output(OutputFilter::Position)];
        let slice = slice::backward(&opaque.graph, opaque.vertex, &position);
        let steady = !velocity.jitter.is_empty();
        let now = steady
            .then(|| self.position(&slice, STEADY, &BTreeMap::new(), &velocity.jitter))
            .transpose()?;
        let buffers = self.previous_buffers(&slice, &velocity.still)?;
        let mut before = self.position(&slice, PREVIOUS, &buffers, &velocity.jitter)?;
        let to = self.previous_attributes(&velocity.moving);
        before.relocate(&|location| to.get(&location).copied().unwrap_or(location));
        Ok((now, before))
    }

    /// Adds a function of the vertex stage's inputs that computes the position from other buffers.
    fn position(
        &mut self,
        slice: &Slice,
        suffix: &str,
        buffers: &BTreeMap<Handle<GlobalVariable>, Handle<GlobalVariable>>,
        jitter: &[Member],
    ) -> Result<Ahead, Failed> {
        let graph = &self.opaque.graph;
        let name = format!("position_{suffix}");
        let (mut module, mut ahead) = Ahead::add(graph, slice, &self.module, &name, suffix)
            .ok_or_else(|| Failed::Built("the position is no function".to_owned()))?;
        let original = ahead.function;
        let mut called = calls::called(&module, &module.functions[original].body);
        called.insert(original);
        let reads = |function: &Function| {
            let read = |v| buffers.contains_key(v) || jitter.iter().any(|(j, _)| j == v);
            let mut all = function.expressions.iter();
            all.any(|(_, e)| matches!(e, Expression::GlobalVariable(v) if read(v)))
        };
        let copies = place::copy_called(&mut module, &called, suffix, &reads, &mut |_| {});
        for copy in copies.values() {
            module = without_jitter(&module, *copy, jitter);
            for (_, expression) in module.functions[*copy].expressions.iter_mut() {
                if let Expression::GlobalVariable(variable) = expression
                    && let Some(other) = buffers.get(variable)
                {
                    *variable = *other;
                }
            }
        }
        ahead.function = copies.get(&original).copied().unwrap_or(original);
        let own = format!("_{suffix}");
        for (original, copy) in copies {
            // A part of our own slice, which nothing else calls, leaves its name to its copy.
            let name = &mut module.functions[original].name;
            if let Some(name) = name.take_if(|name| name.ends_with(&own)) {
                module.functions[copy].name = Some(name);
            }
        }
        self.module = module;
        Ok(ahead)
    }

    /// A copy of each buffer that the slice reads and that may change.
    fn previous_buffers(
        &mut self,
        slice: &Slice,
        still: &BTreeSet<Handle<GlobalVariable>>,
    ) -> Result<BTreeMap<Handle<GlobalVariable>, Handle<GlobalVariable>>, Failed> {
        let mut copies = BTreeMap::new();
        for original in slice.globals.iter().filter(|g| !still.contains(g)) {
            let variable = self.module.global_variables[*original].clone();
            let of = variable.name.clone().unwrap_or_default();
            match variable.space {
                AddressSpace::Uniform | AddressSpace::Immediate => {}
                AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => {
                    return Err(Failed::Previous(format!(
                        "the position reads `{of}`, a buffer that shaders write"
                    )));
                }
                AddressSpace::Storage { .. } => {}
                _ => continue,
            }
            let at = self.free_binding(variable.binding.map_or(0, |b| b.group));
            let source = BindingSource::Previous {
                of,
                group: variable.binding.map(|b| b.group),
                binding: variable.binding.map(|b| b.binding),
            };
            self.bindings.insert((at.group, at.binding), source);
            let copy = GlobalVariable {
                name: variable.name.map(|name| format!("{name}_{PREVIOUS}")),
                space: match variable.space {
                    AddressSpace::Immediate => AddressSpace::Uniform,
                    space => space,
                },
                binding: Some(at),
                ..variable
            };
            let span = self.module.global_variables.get_span(*original);
            copies.insert(*original, self.module.global_variables.append(copy, span));
        }
        Ok(copies)
    }

    /// New locations for the attributes that change.
    fn previous_attributes(&mut self, moving: &BTreeSet<u32>) -> BTreeMap<u32, u32> {
        let module = &self.module;
        let function = &module.entry_points[self.opaque.vertex].function;
        let inputs = reflect::inputs(module, function);
        let taken = inputs
            .iter()
            .filter_map(|io| location_of(io.binding.as_ref()));
        let first = taken.max().map_or(0, |most| most + 1);
        let to: BTreeMap<u32, u32> = moving.iter().copied().zip(first..).collect();
        self.attributes
            .extend(to.iter().map(|(of, location)| (*location, *of)));
        to
    }
}

/// A function with 0 in place of the `jitter` that it reads.
fn without_jitter(module: &Module, function: Handle<Function>, jitter: &[Member]) -> Module {
    let original = &module.functions[function];
    let mut zeros: Vec<(Handle<Expression>, TypeInner)> = Vec::new();
    for (e, _) in original.expressions.iter() {
        let Some((variable, path)) = path_to(original, e) else {
            continue;
        };
        let is_jitter = |(of, member): &Member| {
            *of == variable && member.is_none_or(|m| path.first() == Some(&m))
        };
        if is_of_value(original, e) && jitter.iter().any(is_jitter) {
            let ty = module.global_variables[variable].ty;
            zeros.extend(type_at(module, ty, &path).map(|inner| (e, inner)));
        }
    }
    if zeros.is_empty() {
        return module.clone();
    }
    place::rewritten(module, FunctionId::Function(function), |build| {
        let replaced = zeros.into_iter().map(|(e, inner)| {
            let ty = build.ty(inner);
            let zero = build.expression(Expression::ZeroValue(ty));
            (e, Replacement::Value(zero))
        });
        Rewrite {
            replacements: replaced.collect(),
            arguments: BTreeMap::new(),
        }
    })
}

/// The buffer that an expression is a part of, and the way there.
fn path_to(
    function: &Function,
    e: Handle<Expression>,
) -> Option<(Handle<GlobalVariable>, Vec<u32>)> {
    match function.expressions[e] {
        Expression::GlobalVariable(variable) => Some((variable, Vec::new())),
        Expression::Load { pointer } => path_to(function, pointer),
        Expression::AccessIndex { base, index } => {
            let (variable, mut path) = path_to(function, base)?;
            path.push(index);
            Some((variable, path))
        }
        _ => None,
    }
}

/// Whether an access is to a value that was loaded, and not to a place in memory.
fn is_of_value(function: &Function, e: Handle<Expression>) -> bool {
    match function.expressions[e] {
        Expression::Load { .. } => true,
        Expression::AccessIndex { base, .. } => is_of_value(function, base),
        _ => false,
    }
}

/// The type at the end of a way.
fn type_at(module: &Module, ty: Handle<Type>, path: &[u32]) -> Option<TypeInner> {
    let inner = &module.types[ty].inner;
    let Some((first, rest)) = path.split_first() else {
        return Some(inner.clone());
    };
    match inner {
        TypeInner::Struct { members, .. } => {
            type_at(module, members.get(*first as usize)?.ty, rest)
        }
        TypeInner::Array { base, .. } => type_at(module, *base, rest),
        TypeInner::Vector { scalar, .. } => Some(TypeInner::Scalar(*scalar)),
        TypeInner::Matrix { rows, scalar, .. } => Some(match rest.is_empty() {
            true => TypeInner::Vector {
                size: *rows,
                scalar: *scalar,
            },
            false => TypeInner::Scalar(*scalar),
        }),
        _ => None,
    }
}
