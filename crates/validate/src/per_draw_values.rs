//! Values that a compute pass makes of a draw, computed by the stages that read them: the interpreter
//! runs one stage at a time.

use std::collections::BTreeMap;

use naga::{AddressSpace, GlobalVariable, Handle, Module, ShaderStage, Span};

use super::static_frame::replace;
use naga_edit::link;
use preshade_dataflow::graph::FunctionId;
use preshade_passes::rebuild::place::{self, Rewrite};
use preshade_passes::rebuild::snippet::NOWHERE;
use preshade_plan::geometry::Geometry;
use preshade_plan::plan::{BindingSource, BindingUse, ComputePass, GeometryPart, GpuPass, Plan};
use preshade_plan::program::Program;

/// Whether a compute pass makes values of the draw, which [`computed`] follows.
pub(super) fn runs(pass: &ComputePass) -> bool {
    pass.geometry == Geometry::Draw && values(&pass.bindings).is_some()
}

/// The binding of the draw's values, and the name of their buffer.
fn values(bindings: &[BindingUse]) -> Option<((u32, u32), &str)> {
    bindings.iter().find_map(|b| match &b.source {
        BindingSource::Geometry {
            part: GeometryPart::Values { buffer },
        } => Some(((b.group, b.binding), buffer.as_str())),
        _ => None,
    })
}

/// The program of a pass that computes the draw's values itself; `None` if it reads none, or does so
/// already.
///
/// # Errors
/// A message: no compute pass makes them, or its program does not fit.
pub(super) fn computed(
    plan: &Plan,
    programs: &BTreeMap<String, Program>,
    pass: &GpuPass,
) -> Result<Option<Program>, String> {
    let Some((at, buffer)) = values(&pass.bindings) else {
        return Ok(None);
    };
    let own = programs.get(&pass.program).ok_or("it has no program")?;
    if variable(own.module(), at).is_none() {
        return Ok(None);
    }
    let is_it = |c: &&ComputePass| values(&c.bindings).is_some_and(|(_, name)| name == buffer);
    let maker = plan.compute.iter().find(is_it);
    let maker = maker.ok_or("no compute pass makes the values that it reads")?;
    let made = programs.get(&maker.program);
    let made = made.ok_or("the compute pass has no program")?;
    let (made_at, _) = values(&maker.bindings).ok_or("the compute pass stores nothing")?;
    let mut second = made.module().clone();
    let mut entry = made
        .entry_point(ShaderStage::Compute, &maker.entry_point)
        .map(|(_, entry)| entry.function.clone())
        .ok_or("the compute pass has no entry point")?;
    entry.name = Some(MAKER.to_owned());
    second.entry_points.clear();
    second.functions.append(entry, Span::UNDEFINED);
    let mut first = own.module().clone();
    make_private(&mut first, at, READ)?;
    make_private(&mut second, made_at, WRITTEN)?;
    let linked = link::link(first, &second, NOWHERE, "made").map_err(|e| e.message.clone())?;
    let maker = *linked.functions.last().ok_or("nothing was linked")?;
    let mut module = linked.module;
    let [read, written] = [READ, WRITTEN].map(|name| named(&module, name));
    let (Some(read), Some(written)) = (read, written) else {
        return Err("the values have no variable".to_owned());
    };
    replace(&mut module, read, written);
    for entry in 0..module.entry_points.len() {
        module = place::rewritten(&module, FunctionId::EntryPoint(entry), |build| {
            build.call(maker, Vec::new());
            Rewrite::default()
        });
    }
    let program = own.with_module(module).map_err(|e| e.to_string())?;
    Ok(Some(program))
}

const MAKER: &str = "preshade_make_values";
const READ: &str = "preshade_values_read";
const WRITTEN: &str = "preshade_values_written";

/// The variable of a binding.
fn variable(module: &Module, at: (u32, u32)) -> Option<Handle<GlobalVariable>> {
    let mut all = module.global_variables.iter();
    let found = all.find(|(_, g)| g.binding.is_some_and(|b| (b.group, b.binding) == at));
    found.map(|(handle, _)| handle)
}

fn named(module: &Module, name: &str) -> Option<Handle<GlobalVariable>> {
    let mut all = module.global_variables.iter();
    let found = all.find(|(_, g)| g.name.as_deref() == Some(name));
    found.map(|(handle, _)| handle)
}

/// Makes the variable of a binding private.
fn make_private(module: &mut Module, at: (u32, u32), name: &str) -> Result<(), String> {
    let handle = variable(module, at).ok_or("the values have no binding")?;
    let variable = module.global_variables.get_mut(handle);
    variable.space = AddressSpace::Private;
    variable.binding = None;
    variable.name = Some(name.to_owned());
    Ok(())
}
