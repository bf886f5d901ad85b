//! Locations of varyings and attributes that are ours.

use std::collections::{BTreeMap, BTreeSet};

use naga::{Binding, Function, Module, ShaderStage};

use super::location_of;
use crate::rebuild::depth_only::Placed;
use naga_edit::interface::{self, Io};

/// New locations by the old ones.
type Renumbered = BTreeMap<u32, u32>;

/// Renumbers the varyings from `first` on.
pub(super) fn varyings(placed: &mut Placed, first: u32) {
    let module = &mut placed.module;
    let mut taken = BTreeSet::new();
    let vertex = entry(module, ShaderStage::Vertex, &placed.vertex);
    let name = placed.fragment.as_deref();
    let fragment = name.and_then(|name| entry(module, ShaderStage::Fragment, name));
    let function = |i: usize| &module.entry_points[i].function;
    let outputs_of = vertex.map(|i| interface::outputs(module, function(i)));
    let inputs_of = fragment.map(|i| interface::inputs(module, function(i)));
    for all in [outputs_of, inputs_of].into_iter().flatten() {
        taken.extend(locations(&all));
    }
    let to = renumbered(&taken, first);
    if let Some(vertex) = vertex {
        interface::edit_outputs(module, vertex, |_, _, binding| renumber(binding, &to));
    }
    if let Some(fragment) = fragment {
        inputs(&mut module.entry_points[fragment].function, &to);
    }
}

/// Renumbers the attributes from `first` on.
pub(super) fn attributes(placed: &mut Placed, first: u32) -> Renumbered {
    let module = &mut placed.module;
    let Some(vertex) = entry(module, ShaderStage::Vertex, &placed.vertex) else {
        return Renumbered::new();
    };
    let function = &module.entry_points[vertex].function;
    let taken = locations(&interface::inputs(module, function)).collect();
    let to = renumbered(&taken, first);
    inputs(&mut module.entry_points[vertex].function, &to);
    to
}

fn entry(module: &Module, stage: ShaderStage, name: &str) -> Option<usize> {
    let mut entries = module.entry_points.iter();
    entries.position(|e| e.stage == stage && e.name == name)
}

fn locations(all: &[Io]) -> impl Iterator<Item = u32> {
    all.iter().filter_map(|io| location_of(io.binding.as_ref()))
}

/// The first locations that those before `first` leave free.
fn renumbered(taken: &BTreeSet<u32>, first: u32) -> Renumbered {
    let free = (0..).filter(|location| *location >= first || !taken.contains(location));
    taken.range(first..).copied().zip(free).collect()
}

fn renumber(binding: &mut Option<Binding>, to: &Renumbered) {
    if let Some(Binding::Location { location, .. }) = binding
        && let Some(other) = to.get(location)
    {
        *location = *other;
    }
}

/// Inputs of ours are arguments of their own.
fn inputs(function: &mut Function, to: &Renumbered) {
    for argument in &mut function.arguments {
        renumber(&mut argument.binding, to);
    }
}
