//! Names of ours beside the author's: within one program a writer keeps names apart, and whichever comes second gets another. What hosts hold on to may not be that one.

use std::collections::BTreeSet;

use naga::{Function, Module};

use super::{ids, resolve};

/// Names of entry points of ours.
const ENTRY_POINTS: [&str; 5] = [
    ids::VERTEX,
    ids::FRAGMENT,
    resolve::VERTEX,
    resolve::FRAGMENT,
    resolve::COMPUTE,
];

/// A name of the author's, by one that no entry point of ours has.
pub fn given(name: &str) -> String {
    match ENTRY_POINTS.contains(&name) {
        true => format!("{name}_given"),
        false => name.to_owned(),
    }
}

/// The author's module without the names of our entry points: its entry points, functions, types, variables and constants are called otherwise. An override keeps its name, by which it is set.
pub fn without_ours(module: &mut Module) {
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

/// Lets names within functions give way to overrides: a host sets those by name.
pub fn give_way_to_overrides(module: &mut Module) {
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
