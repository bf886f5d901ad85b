//! A hoisted material for an API that has tessellation stages: OpenGL 4 and Vulkan.
//!
//! ```text
//! corner:      vs(attributes)                        -> author(attributes)
//! evaluation:  vs(position, varyings, interpolated)  -> rest(position, varyings)
//! ```
//!
//! `author` is the author's vertex stage and `rest` what `hoist` put behind it, as in [`tessellate`](super). Both are vertex stages to naga, which knows no others: who
//! writes the second one as a tessellation evaluation stage has to interpolate its inputs ([`Patch`]) between three corners.

use naga::{
    Binding, Expression, FunctionResult, Handle, Interpolation, Module, Sampling, ShaderStage,
    Span, Statement, Type, TypeInner,
};

use super::refuse;
use super::split::{self, Carried, Outputs, Split};
use crate::core::pass::{Pass, Refusal};
use crate::core::plan::{Plan, Step};
use crate::core::program::Program;
use crate::core::state::Topology;
use crate::graph::FunctionId;
use crate::rebuild::place::{self, Rewrite};
use crate::transforms::hoist::Hoist;

/// A hoisted vertex stage in two.
#[derive(Clone, Debug)]
pub struct Native {
    /// The author's stage, an entry point of the plan's name. It gives the clip position and the varyings of [`Patch::varyings`].
    pub corner: Program,
    /// What becomes of that at a new vertex, an entry point of the plan's name.
    pub evaluation: Program,
    /// What goes from the first to the second.
    pub patch: Patch,
}

/// What a patch carries from its corners to the evaluation stage, besides the clip position.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Patch {
    /// Varyings, in the order of the author's outputs.
    pub varyings: Vec<PatchVarying>,
    /// Location of the evaluation stage's input that is the interpolated clip position.
    pub position: u32,
}

/// A varying of a patch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PatchVarying {
    /// Location, of the corner's output and of the evaluation stage's input.
    pub location: u32,
    /// A scalar or vector of 32-bit numbers.
    pub ty: TypeInner,
    /// How a new vertex gets it.
    pub blend: Blend,
    /// Where the author wants it sampled. It means nothing for a corner, but older GLSL wants the stages on both sides to say the same.
    pub sampling: Option<Sampling>,
}

/// How a new vertex gets a varying.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blend {
    /// The corners' weighted sum.
    Interpolated,
    /// The first corner's.
    Flat,
}

/// The vertex stage of a hoisted plan, in two.
///
/// # Errors
/// Why the plan's main pass cannot be drawn in patches.
pub fn native(plan: &Plan) -> Result<Native, Box<Refusal>> {
    let is_hoist = |step: &Step| step.pass == Hoist::INFO.name;
    if !plan.steps.iter().any(is_hoist) {
        return Err(refuse(
            "not-hoisted",
            "nothing was moved to the vertices, so that more of them would change nothing",
            "hoist first",
        ));
    }
    if !plan.steps.last().is_some_and(is_hoist) {
        return Err(refuse(
            "not-last",
            "another pass came behind hoist, and these stages are made of the vertex stage that hoist built",
            "hoist last: the stages divide the triangles themselves, at a level of the host's choice",
        ));
    }
    let found = match (&plan.passes[..], &plan.compute[..]) {
        ([pass], []) => plan.program(pass).map(|program| (pass, program)),
        _ => None,
    };
    let Some((pass, program)) = found else {
        return Err(refuse(
            "has-passes",
            "the plan has other passes than the main one, and they would draw the surface undivided",
            "hoist alone",
        ));
    };
    if pass.primitive.topology != Topology::TriangleList {
        return Err(refuse(
            "topology",
            "a patch is three vertices of a list of triangles",
            "draw a triangle list",
        ));
    }
    let module = program.module();
    let entry = program.entry_point(ShaderStage::Vertex, &pass.vertex);
    let split = entry.and_then(|(index, _)| Some((index, split::split(module, index)?)));
    let Some((entry, split)) = split else {
        return Err(refuse(
            "not-split",
            "the vertex stage is not the one that hoist built",
            "hoist last",
        ));
    };
    let outputs = Outputs::of(module, split.given).map_err(|(name, why)| {
        refuse(
            "varying",
            format!("the varying `{name}` cannot be had at a new vertex: {why}"),
            "make it a perspective-correct f32, or flat",
        )
    })?;
    let build = || {
        let patch = patch(module, &split, &outputs)?;
        let stage = [(ShaderStage::Vertex, pass.vertex.as_str())];
        let valid = |module: &Module| {
            program
                .with_module(place::retain(module, &stage))
                .map_err(|e| e.to_string())
        };
        Ok(Native {
            corner: valid(&corner(module, entry, &split))?,
            evaluation: valid(&evaluation(module, entry, &split, &outputs, &patch))?,
            patch,
        })
    };
    build().map_err(|why: String| Box::new(Refusal::bug(super::Tessellate::INFO.name, why)))
}

/// Members of what the author's stage gives: each one's type and binding.
fn members(module: &Module, given: Handle<Type>) -> Vec<(Handle<Type>, Option<Binding>)> {
    match &module.types[given].inner {
        TypeInner::Struct { members, .. } => {
            let members = members.iter();
            members.map(|m| (m.ty, m.binding.clone())).collect()
        }
        _ => vec![(given, None)],
    }
}

fn patch(module: &Module, split: &Split, outputs: &Outputs) -> Result<Patch, String> {
    let mut varyings = Vec::new();
    for (index, (ty, binding)) in members(module, split.given).into_iter().enumerate() {
        if index == outputs.position {
            continue;
        }
        let Some(Binding::Location {
            location, sampling, ..
        }) = binding
        else {
            return Err("an output of the vertex stage has no location".to_owned());
        };
        varyings.push(PatchVarying {
            location,
            ty: module.types[ty].inner.clone(),
            blend: match outputs.carried[index] {
                Carried::Blended(_) => Blend::Interpolated,
                Carried::Flat => Blend::Flat,
            },
            sampling,
        });
    }
    let last = varyings.iter().map(|v| v.location).max();
    Ok(Patch {
        varyings,
        position: last.map_or(0, |l| l + 1),
    })
}

/// The module with the entry point of that index giving what the author's stage gives.
fn corner(module: &Module, entry: usize, split: &Split) -> Module {
    let mut module = module.clone();
    let is_struct = matches!(module.types[split.given].inner, TypeInner::Struct { .. });
    let position = Binding::BuiltIn(naga::BuiltIn::Position { invariant: false });
    let name = module.entry_points[entry].function.name.clone();
    module.entry_points[entry].function = naga::Function {
        name,
        result: Some(FunctionResult {
            ty: split.given,
            binding: (!is_struct).then_some(position),
        }),
        ..naga::Function::default()
    };
    place::rewritten(&module, FunctionId::EntryPoint(entry), |build| {
        let passed = split
            .inputs
            .iter()
            .map(|a| {
                let name = a.name.as_deref().unwrap_or("input");
                build.argument(name, a.ty, a.binding.clone())
            })
            .collect();
        let value = build.call(split.author, passed);
        build.statement(Statement::Return { value });
        Rewrite::default()
    })
}

/// The module with the entry point of that index taking what the author's stage gives as inputs.
fn evaluation(
    module: &Module,
    entry: usize,
    split: &Split,
    outputs: &Outputs,
    patch: &Patch,
) -> Module {
    let mut module = module.clone();
    let name = module.entry_points[entry].name.clone();
    let mut rest = split.rest.clone();
    rest.name = Some(place::free_name(&module, &name, "rest"));
    // The bindings of a called function's result mean nothing, and are not valid.
    let result = rest.result.clone();
    if let Some(result) = &mut rest.result {
        result.binding = None;
    }
    let rest = module.functions.append(rest, Span::UNDEFINED);
    module.entry_points[entry].function = naga::Function {
        name: Some(name),
        result,
        ..naga::Function::default()
    };
    let members = members(&module, split.given);
    place::rewritten(&module, FunctionId::EntryPoint(entry), |build| {
        let mut components = Vec::new();
        for (index, (ty, binding)) in members.iter().enumerate() {
            let location = match binding {
                Some(Binding::Location { location, .. }) if index != outputs.position => *location,
                _ => patch.position,
            };
            let name = match index == outputs.position {
                true => "position".to_owned(),
                false => format!("varying_{location}"),
            };
            let integer =
                build.module().types[*ty].inner.scalar_kind() != Some(naga::ScalarKind::Float);
            let binding = Binding::Location {
                location,
                interpolation: integer.then_some(Interpolation::Flat),
                sampling: None,
                blend_src: None,
                per_primitive: false,
            };
            components.push(build.argument(&name, *ty, Some(binding)));
        }
        let author = match (outputs.is_struct, &components[..]) {
            (false, [position]) => *position,
            _ => build.expression(Expression::Compose {
                ty: split.given,
                components,
            }),
        };
        let value = build.call(rest, vec![author]);
        build.statement(Statement::Return { value });
        Rewrite::default()
    })
}
