//! Puts another view's resources in place of the author's.

use std::collections::BTreeMap;

use naga::{Handle, Module, ShaderStage, Type, TypeInner};

use super::names::refusal;
use super::{Params, refusals};
use crate::analysis::opaque::Opaque;
use crate::analysis::view::{self, Said};
use crate::core::mapping::Mapping;
use crate::core::pass::Refusal;
use crate::core::plan::{BindingSource, GpuPass, Plan, Role};
use crate::core::program::Program;
use crate::rebuild::place;
use crate::rebuild::remap::{self, Unmapped};

/// Sources of the bindings of the other view, by group and binding.
pub type Sources = BTreeMap<(u32, u32), BindingSource>;

/// Maps the program of the pass.
pub fn apply(
    plan: &mut Plan,
    author: &Opaque<'_>,
    (params, said): (&Params, &Said),
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
    let layout = params.layout.as_deref();
    let of_author = author.program.module();
    let is_plain = |mapping: &Mapping| {
        let is_name = mapping.theirs.members.is_empty() && !mapping.theirs.variable.contains(':');
        layout.is_none() && is_name && loose(author.program, mapping).is_some()
    };
    let (plain, others): (Vec<_>, Vec<_>) = mappings.into_iter().partition(is_plain);
    let mut sources = Sources::new();
    let mut program = program.clone();
    if let Some(at) = author
        .program
        .declared()
        .loose
        .filter(|_| !plain.is_empty())
    {
        program = renamed(&program, author.program, &plain, said)?;
        let name = "uniforms".to_owned();
        sources.insert((at.group, at.binding), BindingSource::View { name });
    }
    let module = program.module();
    let mapped = remap::remap(of_author, module, &others, layout);
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
    sources.extend(views.map(|(at, name)| (at, BindingSource::View { name })));
    Ok(sources)
}

/// The name of the loose uniform that a mapping replaces, if it is one.
fn loose(program: &Program, mapping: &Mapping) -> Option<String> {
    let module = program.module();
    let place = mapping.ours.resolve(module).ok()?;
    let binding = module.global_variables[place.global].binding?;
    let is_loose = program.declared().loose == Some(binding) && place.steps.len() == 1;
    let of = crate::core::mapping::name_of(module, place.global, &place.steps);
    of.members.into_iter().next().filter(|_| is_loose)
}

/// The program with other names for its loose uniforms. Those that do not follow the viewer keep
/// theirs: they are the material's.
fn renamed(
    program: &Program,
    author: &Program,
    plain: &[Mapping],
    said: &Said,
) -> Result<Program, Box<Refusal>> {
    let mut declared = program.declared().clone();
    let mut module = program.module().clone();
    let of_block =
        |(_, g): &(_, &naga::GlobalVariable)| g.binding.is_some() && g.binding == declared.loose;
    let Some((handle, block)) = module.global_variables.iter().find(of_block) else {
        return Ok(program.clone());
    };
    let name = block.name.clone().unwrap_or_default();
    let ty = block.ty;
    let entries = module.entry_points.iter().map(|e| &e.function);
    let functions = entries.chain(module.functions.iter().map(|(_, f)| f));
    let read: Vec<_> = functions.flat_map(remap::parts_read).collect();
    let is_read = |member: usize| {
        let mut all = read.iter().filter(|(global, _)| *global == handle);
        all.any(|(_, steps)| steps.first().is_none_or(|first| *first == member))
    };
    let pairs: Vec<(String, &str)> = plain
        .iter()
        .filter_map(|m| Some((loose(author, m)?, m.theirs.variable.as_str())))
        .collect();
    let follows = view::view_dependent(program, said).into_iter();
    let own = follows.filter_map(|path| Some(path.strip_prefix(&format!("{name}."))?.to_owned()));
    let is_mapped = |path: &String| {
        let first = path.split('.').next();
        pairs.iter().any(|(ours, _)| Some(ours.as_str()) == first)
    };
    if let Some(lacks) = own.clone().find(|path| !is_mapped(path)) {
        let has: Vec<String> = pairs
            .iter()
            .map(|(_, theirs)| format!("`{theirs}`"))
            .collect();
        return Err(refusal(
            &refusals::OTHER_VIEW_LACKS,
            format!(
                "the slice reads `{lacks}`, which follows the viewer and which the other view lacks; \
                 it has {}",
                has.join(", ")
            ),
        ));
    }
    for (ours, theirs) in pairs.iter().filter(|(ours, theirs)| ours != theirs) {
        let at = |of: &str| {
            members(&module, ty)
                .iter()
                .position(|m| m.as_deref() == Some(of))
        };
        let other = at(theirs);
        let is_taken = match other {
            Some(other) => is_read(other),
            None => declared.uniforms.iter().any(|u| u.name == **theirs),
        };
        if is_taken {
            return Err(refusal(
                &refusals::OTHER_VIEW,
                format!("the slice reads a uniform `{theirs}` of the author's too"),
            ));
        }
        // One that nothing reads takes the free name.
        let renames = [(at(ours), *theirs), (other, ours.as_str())];
        for uniform in &mut declared.uniforms {
            if uniform.name == *ours {
                uniform.name = (*theirs).to_owned();
            } else if uniform.name == *theirs {
                uniform.name.clone_from(ours);
            }
        }
        for (member, to) in renames {
            rename(&mut module, ty, member, to);
        }
    }
    let program = program.with_module(module);
    let program = program.map_err(|e| Refusal::bug(super::NAME, e))?;
    Ok(program.with_declared(declared))
}

/// The names of a struct's members.
fn members(module: &Module, ty: Handle<Type>) -> Vec<Option<String>> {
    match &module.types[ty].inner {
        TypeInner::Struct { members, .. } => members.iter().map(|m| m.name.clone()).collect(),
        _ => Vec::new(),
    }
}

fn rename(module: &mut Module, ty: Handle<Type>, member: Option<usize>, to: &str) {
    let mut renamed = module.types[ty].clone();
    let TypeInner::Struct { members, .. } = &mut renamed.inner else {
        return;
    };
    if let Some(member) = member.and_then(|i| members.get_mut(i)) {
        member.name = Some(to.to_owned());
    }
    if module.types.get(&renamed).is_none() {
        module.types.replace(ty, renamed);
    }
}

/// Marks the bindings of the other view.
pub fn mark(pass: &mut GpuPass, sources: &Sources) {
    for binding in &mut pass.bindings {
        if let Some(source) = sources.get(&(binding.group, binding.binding)) {
            binding.source = source.clone();
        }
    }
}
