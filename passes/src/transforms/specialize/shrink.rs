//! Removes dead code after folding: unread varyings, and the attributes and bindings that only they
//! needed.

use std::collections::{BTreeMap, BTreeSet};

use naga::{Binding, Module, ShaderStage};

use crate::rebuild::place::{self, PositionInvariance};
use naga_edit::interface;
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_dataflow::slice::{self, Criterion, OutputFilter, Termination};
use preshade_plan::program::Program;
use shader_text::source::Invalid;

/// Suffixes of generated names while the author's functions still exist, by stage.
const SUFFIXES: [&str; 2] = ["read", "live"];

/// The program after dead-code elimination.
pub(crate) struct Shrunk {
    pub program: Program,
    /// Hash of the remaining slice of the last stage.
    pub hash: String,
}

/// The program with only these entry points, sliced to their outputs, discards and stores. The
/// vertex stage keeps the varyings that the fragment stage reads. A stage with stores stays whole.
///
/// # Errors
/// The result does not validate: a bug.
pub(crate) fn shrink(
    program: &Program,
    vertex: &str,
    fragment: Option<&str>,
) -> Result<Shrunk, Box<Invalid>> {
    let mut hash = String::new();
    let mut program = program.clone();
    let mut read = None;
    if let Some((fragment, _)) =
        fragment.and_then(|f| program.entry_point(ShaderStage::Fragment, f))
    {
        let observed = [Criterion::Output(OutputFilter::All), Criterion::Discard];
        if let Some((next, sliced)) = sliced(&program, fragment, &observed)? {
            program = next;
            hash = sliced;
        }
        let entry = &program.module().entry_points[fragment];
        read = Some(locations(program.module(), entry));
    }
    if let (Some((vertex, _)), Some(read)) =
        (program.entry_point(ShaderStage::Vertex, vertex), read)
    {
        let mut criteria = vec![Criterion::Output(OutputFilter::Rasterization)];
        criteria.extend(
            read.iter()
                .map(|l| Criterion::Output(OutputFilter::Location(*l))),
        );
        if let Some((next, sliced)) = sliced(&program, vertex, &criteria)? {
            program = next;
            hash.push_str(&sliced);
        }
    }
    let mut entries = vec![(ShaderStage::Vertex, vertex)];
    entries.extend(fragment.map(|f| (ShaderStage::Fragment, f)));
    let mut module = place::retain(program.module(), &entries);
    restore_names(&mut module);
    Ok(Shrunk {
        program: program.with_module(module)?,
        hash: short(&hash),
    })
}

/// Combines half of each hash.
fn short(hash: &str) -> String {
    match hash.len() {
        32 => hash[..8].to_owned() + &hash[16..24],
        _ => hash.to_owned(),
    }
}

/// The program with an entry point sliced to `criteria`, and the hash of the slice; `None` if it
/// stores.
fn sliced(
    program: &Program,
    entry: usize,
    criteria: &[Criterion],
) -> Result<Option<(Program, String)>, Box<Invalid>> {
    let graph = Graph::build(program);
    if graph.writes_memory(FunctionId::EntryPoint(entry)) {
        return Ok(None);
    }
    let slice = slice::backward_with(&graph, entry, criteria, Termination::Preserved);
    let name = program.module().entry_points[entry].name.clone();
    let mut module = place::entry_point(
        &graph,
        &slice,
        program.module(),
        "preshade_live",
        match program.module().entry_points[entry].stage {
            ShaderStage::Fragment => SUFFIXES[0],
            _ => SUFFIXES[1],
        },
        PositionInvariance::AsWritten,
    );
    if let Some(mut placed) = module.entry_points.pop() {
        placed.name.clone_from(&name);
        placed.function.name = Some(name);
        module.entry_points[entry] = placed;
    }
    Ok(Some((program.with_module(module)?, slice.hash(&graph))))
}

fn locations(module: &Module, entry: &naga::EntryPoint) -> BTreeSet<u32> {
    interface::inputs(module, &entry.function)
        .iter()
        .filter_map(|io| match io.binding {
            Some(Binding::Location { location, .. }) => Some(location),
            _ => None,
        })
        .collect()
}

/// Restores the author's names where they are free.
fn restore_names(module: &mut Module) {
    let base = |name: &str| {
        let cut = SUFFIXES.iter().find_map(|s| name.strip_suffix(s));
        let base = cut?.strip_suffix('_')?;
        (!base.is_empty()).then(|| base.to_owned())
    };
    let mut taken: BTreeMap<String, usize> = BTreeMap::new();
    let names = module
        .functions
        .iter()
        .filter_map(|(_, f)| f.name.clone())
        .chain(module.types.iter().filter_map(|(_, t)| t.name.clone()))
        .chain(
            module
                .global_variables
                .iter()
                .filter_map(|(_, g)| g.name.clone()),
        )
        .chain(module.constants.iter().filter_map(|(_, c)| c.name.clone()))
        .chain(module.entry_points.iter().map(|e| e.name.clone()));
    for name in names {
        *taken.entry(base(&name).unwrap_or(name)).or_default() += 1;
    }
    let is_free = |name: &String| taken.get(name) == Some(&1);
    for (_, function) in module.functions.iter_mut() {
        if let Some(name) = function.name.as_deref().and_then(base).filter(is_free) {
            function.name = Some(name);
        }
    }
    let renamed: Vec<_> = module
        .types
        .iter()
        .filter_map(|(handle, ty)| {
            let name = ty.name.as_deref().and_then(base).filter(is_free)?;
            Some((handle, ty.clone(), name))
        })
        .collect();
    for (handle, mut ty, name) in renamed {
        ty.name = Some(name);
        module.types.replace(handle, ty);
    }
}
