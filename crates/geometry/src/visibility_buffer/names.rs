//! Keeps generated names distinct from the author's. A writer would rename the later one, but hosts
//! rely on some names.

use std::collections::BTreeSet;

use naga::{Function, Module};

use super::{ids, resolve};

/// Names of generated entry points.
const ENTRY_POINTS: [&str; 5] = [
    ids::VERTEX,
    ids::FRAGMENT,
    resolve::VERTEX,
    resolve::FRAGMENT,
    resolve::COMPUTE,
];

/// A replacement for an author's name that collides with a generated entry point.
pub(crate) fn given(name: &str) -> String {
    match ENTRY_POINTS.contains(&name) {
        true => format!("{name}_given"),
        false => name.to_owned(),
    }
}

/// Renames the author's entry points, functions, types, variables and constants that collide with
/// generated entry points. Overrides keep their names, because hosts set them by name.
pub(crate) fn without_ours(module: &mut Module) {
    let rename = |name: &mut Option<String>| {
        if let Some(name) = name {
            *name = given(name);
        }
    };
    for entry in &mut module.entry_points {
        entry.name = given(&entry.name);
    }
    for (_, function) in module.functions.iter_mut() {
        rename(&mut function.name);
    }
    for (_, global) in module.global_variables.iter_mut() {
        rename(&mut global.name);
    }
    for (_, constant) in module.constants.iter_mut() {
        rename(&mut constant.name);
    }
    let is_ours =
        |name: &Option<String>| name.as_deref().is_some_and(|n| ENTRY_POINTS.contains(&n));
    let types = module.types.iter();
    let clashing: Vec<_> = types
        .filter(|(_, ty)| is_ours(&ty.name))
        .map(|(h, _)| h)
        .collect();
    for handle in clashing {
        let mut ty = module.types[handle].clone();
        rename(&mut ty.name);
        module.types.replace(handle, ty);
    }
}

/// Renames locals that collide with overrides, because hosts set overrides by name.
pub(crate) fn give_way_to_overrides(module: &mut Module) {
    let overrides = module.overrides.iter();
    let held: BTreeSet<String> = overrides.filter_map(|(_, o)| o.name.clone()).collect();
    for (_, function) in module.functions.iter_mut() {
        give_way(function, &held);
    }
    for entry in &mut module.entry_points {
        give_way(&mut entry.function, &held);
    }
}

fn give_way(function: &mut Function, held: &BTreeSet<String>) {
    let arguments = function
        .arguments
        .iter_mut()
        .filter_map(|a| a.name.as_mut());
    let locals = function.local_variables.iter_mut();
    let locals = locals.filter_map(|(_, v)| v.name.as_mut());
    let values = function.named_expressions.values_mut();
    for name in arguments.chain(locals).chain(values) {
        if held.contains(name) {
            name.push_str("_here");
        }
    }
}
