//! Puts another view's resources in place of the author's.

use std::collections::BTreeMap;

use naga::ShaderStage;

use super::names::refusal;
use super::{Params, refusals};
use crate::analysis::opaque::Opaque;
use crate::core::pass::Refusal;
use crate::core::plan::{BindingSource, GpuPass, Plan, Role};
use crate::rebuild::place;
use crate::rebuild::remap::{self, Unmapped};

/// Sources of the bindings of the other view, by group and binding.
pub type Sources = BTreeMap<(u32, u32), BindingSource>;

/// Maps the program of the pass.
pub fn apply(
    plan: &mut Plan,
    author: &Opaque<'_>,
    params: &Params,
) -> Result<Sources, Box<Refusal>> {
    let mappings = params.mappings();
    let mappings = mappings.map_err(|e| refusal(&refusals::OTHER_VIEW, e.to_string()))?;
    if mappings.is_empty() {
        return Ok(Sources::new());
    }
    let key = Role::Outputs.name();
    let Some(program) = plan.programs.get(key) else {
        return Ok(Sources::new());
    };
    let module = program.module();
    let layout = params.layout.as_deref();
    let mapped = remap::remap(author.program.module(), module, &mappings, layout);
    let mapped = mapped.map_err(|why| {
        let code = match why {
            Unmapped::Lacks { .. } => &refusals::OTHER_VIEW_LACKS,
            Unmapped::Unknown(_) => &refusals::NO_SUCH_NAME,
            Unmapped::Unfit(_) => &refusals::OTHER_VIEW,
        };
        refusal(code, why.to_string())
    })?;
    let entries: Vec<(ShaderStage, &str)> = module
        .entry_points
        .iter()
        .map(|e| (e.stage, e.name.as_str()))
        .collect();
    let mapped_module = place::retain(&mapped.module, &entries);
    let program = program.with_module(mapped_module);
    let program = program.map_err(|e| Refusal::bug(super::NAME, e))?;
    plan.programs.insert(key.to_owned(), program);
    let views = mapped.views.into_iter();
    Ok(views
        .map(|(at, name)| (at, BindingSource::View { name }))
        .collect())
}

/// Marks the bindings of the other view.
pub fn mark(pass: &mut GpuPass, sources: &Sources) {
    for binding in &mut pass.bindings {
        if let Some(source) = sources.get(&(binding.group, binding.binding)) {
            binding.source = source.clone();
        }
    }
}
