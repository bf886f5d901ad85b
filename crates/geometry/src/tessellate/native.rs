//! A hoisted material for APIs with tessellation stages: OpenGL 4 and Vulkan.
//!
//! ```text
//! corner:      vs(attributes)                        -> author(attributes)
//! evaluation:  vs(position, varyings, interpolated)  -> rest(position, varyings)
//! ```
//!
//! `author` is the author's vertex stage and `rest` is the code that `hoist` put behind it, as in
//! [`tessellate`](super). naga has no tessellation stages, so both are vertex stages. The writer of
//! the tessellation evaluation stage must interpolate its inputs ([`Patch`]) between three corners.

use naga::{
    Binding, Expression, FunctionResult, Handle, Interpolation, Module, Sampling, ShaderStage,
    Span, Statement, Type, TypeInner,
};

use super::split::{self, Carried, Outputs, Split};
use super::{examine, refusals, refuse};
use preshade_dataflow::graph::FunctionId;
use preshade_passes::analysis::refusals as shared;
use preshade_passes::rebuild::place::{self, Rewrite};
use preshade_plan::pass::{Pass, Refusal};
use preshade_plan::plan::{HOIST, Plan, Step};
use preshade_plan::program::Program;
use preshade_plan::state::Topology;

/// A hoisted vertex stage in two parts.
#[derive(Clone, Debug)]
pub struct Native {
    /// The author's stage under the plan's entry point name. It returns the clip position and
    /// [`Patch::varyings`].
    pub corner: Program,
    /// The rest of the stage at a new vertex, under the same name.
    pub evaluation: Program,
    /// The interface between the two.
    pub patch: Patch,
}

/// The interface of a patch: the data from its corners to the evaluation stage, besides the clip
/// position.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Patch {
    /// Varyings, in the order of the author's outputs.
    pub varyings: Vec<PatchVarying>,
    /// Location of the interpolated clip position in the evaluation stage.
    pub position: u32,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PatchVarying {
    /// Location in the corner's outputs and the evaluation stage's inputs.
    pub location: u32,
    /// A scalar or vector of 32-bit numbers.
    pub ty: TypeInner,
    /// How a new vertex interpolates it.
    pub blend: Blend,
    /// The author's sampling. It has no effect on corners, but older GLSL requires both stages to
    /// declare the same.
    pub sampling: Option<Sampling>,
}

/// How a new vertex interpolates a varying.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blend {
    /// The corners' weighted sum.
    Interpolated,
    /// The first corner's.
    Flat,
}

/// The vertex stage of a hoisted plan in two parts.
///
/// # Errors
/// The reason why the plan's main pass cannot be drawn in patches.
pub fn native(plan: &Plan) -> Result<Native, Box<Refusal>> {
    let is_hoist = |step: &Step| step.pass == HOIST;
    if !plan.steps.iter().any(is_hoist) {
        return Err(refuse(
            &refusals::NOT_HOISTED,
            "`hoist` moved nothing to the vertices, so more vertices would only cost time",
            "apply `hoist` first",
        ));
    }
    if !plan.steps.last().is_some_and(is_hoist) {
        return Err(refuse(
            &refusals::NOT_LAST,
            "tessellation stages are made from the vertex stage that `hoist` built, and a later \
             pass replaced it",
            "put `hoist` last: the stages divide triangles themselves, at a level that the host \
             chooses",
        ));
    }
    let found = match (&plan.passes[..], &plan.compute[..]) {
        ([pass], []) => plan.program(pass).map(|program| (pass, program)),
        _ => None,
    };
    let Some((pass, program)) = found else {
        return Err(refuse(
            &refusals::HAS_PASSES,
            "the plan has other passes than the main one, and they would not divide the surface",
            "use `hoist` alone",
        ));
    };
    if pass.primitive.topology != Topology::TriangleList {
        return Err(refuse(
            &shared::TOPOLOGY,
            "a patch consists of three vertices of a triangle list",
            "draw a triangle list",
        ));
    }
    let module = program.module();
    let entry = program.entry_point(ShaderStage::Vertex, &pass.vertex);
    let split = entry.and_then(|(index, _)| Some((index, split::split(module, index)?)));
    let Some((entry, split)) = split else {
        return Err(refuse(
            &refusals::NOT_SPLIT,
            "`hoist` did not build this vertex stage",
            "put `hoist` last",
        ));
    };
    let outputs = examine::outputs(module, &split)?;
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

/// Members of the author's result: type and binding of each.
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

/// The module with an entry point that returns the author's result.
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
        let value = build.call_with_inputs(split.author, &split.inputs);
        build.statement(Statement::Return { value });
        Rewrite::default()
    })
}

/// The module with an entry point that takes the author's result as inputs.
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
    // Bindings on the result of a called function are invalid.
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
