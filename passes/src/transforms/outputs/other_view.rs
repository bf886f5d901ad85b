//! Puts another view's resources in place of the author's.

use std::collections::BTreeMap;

use naga::{GlobalVariable, Handle, Module, ShaderStage, Type, TypeInner};

use super::names::refusal;
use super::remap::{self, Unmapped};
use super::{OutputsParams, refusals};
use crate::analysis::opaque::Opaque;
use crate::analysis::view::{self, StatedUniforms};
use crate::rebuild::place;
use preshade_plan::mapping::Mapping;
use preshade_plan::pass::Refusal;
use preshade_plan::plan::{BindingSource, GpuPass, Plan, Role};
use preshade_plan::program::Program;

/// Sources of the bindings of the other view, by group and binding.
pub(crate) type Sources = BTreeMap<(u32, u32), BindingSource>;

/// Maps the program of the pass.
pub(crate) fn apply(
    plan: &mut Plan,
    author: &Opaque<'_>,
    (params, said): (&OutputsParams, &StatedUniforms),
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
    let of = preshade_plan::mapping::name_of(module, place.global, &place.steps);
    of.members.into_iter().next().filter(|_| is_loose)
}

/// The block of a program's loose uniforms.
struct Block {
    variable: Handle<GlobalVariable>,
    name: String,
    ty: Handle<Type>,
}

impl Block {
    fn of(program: &Program) -> Option<Self> {
        let loose = program.declared().loose;
        let mut globals = program.module().global_variables.iter();
        let (variable, global) =
            globals.find(|(_, g)| g.binding.is_some() && g.binding == loose)?;
        Some(Self {
            variable,
            name: global.name.clone().unwrap_or_default(),
            ty: global.ty,
        })
    }

    /// The number of the member of a name.
    fn member(&self, module: &Module, name: &str) -> Option<usize> {
        let TypeInner::Struct { members, .. } = &module.types[self.ty].inner else {
            return None;
        };
        members.iter().position(|m| m.name.as_deref() == Some(name))
    }

    /// Whether the program reads a member.
    fn is_read(&self, module: &Module, member: usize) -> bool {
        let entries = module.entry_points.iter().map(|e| &e.function);
        let functions = entries.chain(module.functions.iter().map(|(_, f)| f));
        let mut read = functions.flat_map(remap::parts_read);
        read.any(|(global, steps)| {
            let is_part = steps.first().is_none_or(|first| *first == member);
            global == self.variable && is_part
        })
    }

    /// Gives members other names. `None`: another type has these already.
    fn rename(&self, module: &mut Module, names: &[(usize, &str)]) -> Option<()> {
        let mut renamed = module.types[self.ty].clone();
        if let TypeInner::Struct { members, .. } = &mut renamed.inner {
            for (member, name) in names {
                members[*member].name = Some((*name).to_owned());
            }
        }
        match module.types.get(&renamed) {
            None => module.types.replace(self.ty, renamed),
            // Nothing has another name.
            Some(same) if same == self.ty => {}
            Some(_) => return None,
        }
        Some(())
    }
}

/// The program with other names for its loose uniforms. Those that do not follow the viewer keep
/// theirs: they are the material's.
fn renamed(
    program: &Program,
    author: &Program,
    plain: &[Mapping],
    said: &StatedUniforms,
) -> Result<Program, Box<Refusal>> {
    let Some(block) = Block::of(program) else {
        return Ok(program.clone());
    };
    let pairs: Vec<(String, &str)> = plain
        .iter()
        .filter_map(|m| Some((loose(author, m)?, m.theirs.variable.as_str())))
        .collect();
    check_partners(program, &block, &pairs, said)?;
    let mut declared = program.declared().clone();
    let mut module = program.module().clone();
    for (ours, theirs) in pairs.iter().filter(|(ours, theirs)| ours != theirs) {
        let other = block.member(&module, theirs);
        let is_taken = match other {
            Some(other) => block.is_read(&module, other),
            None => declared.uniforms.iter().any(|u| u.name == **theirs),
        };
        if is_taken {
            return Err(refusal(
                &refusals::OTHER_VIEW,
                format!("the slice reads a uniform `{theirs}` of the author's too"),
            ));
        }
        // A uniform that nothing reads takes the free name.
        for uniform in &mut declared.uniforms {
            if uniform.name == *ours {
                uniform.name = (*theirs).to_owned();
            } else if uniform.name == *theirs {
                uniform.name.clone_from(ours);
            }
        }
        let own = block.member(&module, ours).map(|member| (member, *theirs));
        let other = other.map(|member| (member, ours.as_str()));
        let names: Vec<_> = own.into_iter().chain(other).collect();
        block
            .rename(&mut module, &names)
            .ok_or_else(|| Refusal::bug(super::NAME, "two blocks have the same uniforms"))?;
    }
    let program = program.with_module(module);
    let program = program.map_err(|e| Refusal::bug(super::NAME, e))?;
    Ok(program.with_declared(declared))
}

/// Fails if a loose uniform that follows the viewer has no partner.
fn check_partners(
    program: &Program,
    block: &Block,
    pairs: &[(String, &str)],
    said: &StatedUniforms,
) -> Result<(), Box<Refusal>> {
    let start = format!("{}.", block.name);
    let follows = view::view_dependent(program, said).into_iter();
    let mut own = follows.filter_map(|path| Some(path.strip_prefix(&start)?.to_owned()));
    let is_mapped = |path: &String| {
        let first = path.split('.').next();
        pairs.iter().any(|(ours, _)| Some(ours.as_str()) == first)
    };
    let Some(lacks) = own.find(|path| !is_mapped(path)) else {
        return Ok(());
    };
    let has: Vec<String> = pairs
        .iter()
        .map(|(_, theirs)| format!("`{theirs}`"))
        .collect();
    Err(refusal(
        &refusals::OTHER_VIEW_LACKS,
        format!(
            "the slice reads `{lacks}`, which follows the viewer and which the other view lacks; \
             it has {}",
            has.join(", ")
        ),
    ))
}

/// Marks the bindings of the other view.
pub(crate) fn mark(pass: &mut GpuPass, sources: &Sources) {
    for binding in &mut pass.bindings {
        if let Some(source) = sources.get(&(binding.group, binding.binding)) {
            binding.source = source.clone();
        }
    }
}
