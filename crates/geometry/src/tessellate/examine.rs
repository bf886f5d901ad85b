//! Decides whether a plan can be subdivided.

use std::collections::BTreeSet;

use naga::valid::GlobalUse;
use naga::{AddressSpace, Binding, BuiltIn, Handle, Module, ShaderStage};

use super::fixed::{self, Read};
use super::split::{self, Outputs, Split};
use super::{
    DividedMaterial, MOST_EDGE_PIXELS, Slots, Tessellate, TessellateParams, refusals, refuse,
};
use naga_edit::interface;
use preshade_dataflow::graph::Graph;
use preshade_passes::analysis::implicit_inputs::{ImplicitInputs, PassEffect};
use preshade_passes::analysis::{refusals as shared, subnormal};
use preshade_plan::contract::Contract;
use preshade_plan::geometry::{Form, Subdivision};
use preshade_plan::pass::{Facts, Pass, Refusal, Refused};
use preshade_plan::pattern::MAX_LEVEL;
use preshade_plan::plan::{BindingKind, GpuPass, HOIST, Plan, Role, Site, Step};
use preshade_plan::program::Program;
use preshade_plan::reflect;

/// The outputs of a split vertex stage.
///
/// # Errors
/// A varying that a new vertex cannot compute.
pub(super) fn outputs(module: &Module, split: &Split) -> Result<Outputs, Box<Refusal>> {
    Outputs::of(module, split.given).map_err(|(name, why)| {
        refuse(
            &refusals::VARYING,
            format!("the varying `{name}` cannot be computed at a new vertex: {why}"),
            "declare it as a perspective-correct f32, or as flat",
        )
    })
}

/// Storage buffers per stage that every WebGPU device supports.
const STORAGE_BUFFERS: usize = 8;

impl<'a> DividedMaterial<'a> {
    pub(super) fn examine(
        plan: &'a Plan,
        facts: &Facts,
        params: &TessellateParams,
    ) -> Result<Self, Box<Refusal>> {
        Self::check_params(params)?;
        let main = plan.main().and_then(|p| Some((p, plan.program(p)?)));
        let Some((pass, program)) = main else {
            return Err(refuse(
                &shared::NO_MAIN_PASS,
                "the plan has no main pass",
                "start from the original plan",
            ));
        };
        let hoist = Self::check_plan(plan, pass)?;
        let Some((vertex, _)) = program.entry_point(ShaderStage::Vertex, &pass.vertex) else {
            return Err(refuse(
                &shared::NO_VERTEX_STAGE,
                "the plan names a vertex stage that its program does not have",
                "start from the original plan",
            ));
        };
        let graph = Graph::build(program);
        if params.form != Form::Pulled {
            subnormal::check(Tessellate::INFO.name, plan, &graph, &[vertex], facts)?;
        }
        ImplicitInputs::new(plan, pass, &graph)
            .examine(Tessellate::INFO.name, &[PassEffect::RunsElsewhere])
            .map_err(|refusals| Refused::from(refusals).first())?;
        let module = program.module();
        let Some(split) = split::split(module, vertex) else {
            return Err(refuse(
                &refusals::NOT_SPLIT,
                "`hoist` did not build this vertex stage",
                "put `tessellate` directly after `hoist`",
            ));
        };
        Self::check_author(program, split.author)?;
        Self::check_inputs(pass, &split, module)?;
        Self::check_fragment(pass, program)?;
        let outputs = outputs(module, &split)?;
        if params.form.is_indexed() && outputs.has_flat() {
            return Err(refuse(
                &refusals::FLAT_SHARED,
                "a flat varying differs between the triangles that would share a vertex",
                "use form=pulled",
            ));
        }
        Self::check_buffers(pass, params)?;
        let mut material = Self {
            pass,
            program,
            vertex,
            split,
            outputs,
            fixed: Vec::new(),
            contract: hoist.contract.clone(),
            key: Site {
                role: Role::Main,
                entry_point: pass.vertex.clone(),
                slice: hoist.site.slice.clone(),
            },
        };
        if params.form == Form::Static {
            material.fixed = material.check_fixed(plan, facts, params)?;
        }
        Ok(material)
    }

    /// Checks the level and the segment length, and whether the form supports them.
    fn check_params(params: &TessellateParams) -> Result<(), Box<Refusal>> {
        if !(1..=MAX_LEVEL).contains(&params.level) {
            return Err(refuse(
                &refusals::LEVEL,
                format!("{} is not a tessellation level", params.level),
                "set a level of 1 to 64",
            ));
        }
        if params
            .edge_pixels
            .is_some_and(|p| !(1..=MOST_EDGE_PIXELS).contains(&p))
        {
            return Err(refuse(
                &refusals::EDGE_PIXELS,
                "a segment is 1 to 256 pixels long",
                "set edge-pixels=8, for example",
            ));
        }
        if params.edge_pixels.is_some() && params.form != Form::Pulled {
            return Err(refuse(
                &refusals::ADAPTIVE_FORM,
                "edge-pixels follows the camera, and this form makes the vertices once",
                "use form=pulled",
            ));
        }
        Ok(())
    }

    /// Checks that `pass` draws a hoisted surface that is not subdivided yet. Returns the step that
    /// hoisted.
    fn check_plan<'p>(plan: &'p Plan, pass: &GpuPass) -> Result<&'p Step, Box<Refusal>> {
        let hoist = plan.steps.iter().rfind(|s| s.pass == HOIST);
        let Some(hoist) = hoist else {
            return Err(refuse(
                &refusals::NOT_HOISTED,
                "`hoist` moved nothing to the vertices, so more vertices would only cost time",
                "put hoist:budget=0.01 before it in the recipe",
            ));
        };
        if !matches!(hoist.contract, Contract::Approximate { .. }) {
            return Err(refuse(
                &refusals::NOTHING_BENDS,
                "every hoisted value is linear over a triangle, so more vertices would only cost \
                 time",
                "give `hoist` a budget, so that it moves nonlinear values too",
            ));
        }
        if plan.passes.len() > 1 {
            return Err(refuse(
                &shared::HAS_PREPASS,
                "another pass of the plan draws the same surface without dividing it",
                "apply `tessellate` first, then the pre-pass, which then divides triangles the \
                 same way",
            ));
        }
        if !pass.geometry.is_as_given() || !plan.compute.is_empty() {
            return Err(refuse(
                &shared::NOT_FIRST,
                "an earlier `tessellate` already divides these triangles",
                "apply `tessellate` once, with the level that you want",
            ));
        }
        if !pass.primitive.topology.is_triangles() {
            return Err(refuse(
                &shared::TOPOLOGY,
                "only triangles are divided",
                "draw triangles",
            ));
        }
        Ok(hoist)
    }

    /// Checks that the work at load reads nothing that can change.
    fn check_fixed(
        &self,
        plan: &Plan,
        facts: &Facts,
        params: &TessellateParams,
    ) -> Result<Vec<String>, Box<Refusal>> {
        let slots = Slots::free(self.program.module());
        let built = self.at_load(slots, &Subdivision::new(params.pattern, 1, Form::Static));
        let (compute, entry, _) = built.map_err(|why| match why.as_str() {
            fixed::NO_CORNERS => refuse(
                &refusals::NO_ATTRIBUTES,
                "the hoisted values read no vertex buffer (vertices are computed from their \
                 index), which form=static does not support",
                "use form=shared",
            ),
            _ => Box::new(Refusal::bug(Tessellate::INFO.name, why)),
        })?;
        let bindings = reflect::bindings(
            &compute,
            &[(ShaderStage::Compute, &entry)],
            &self.parts(slots, Form::Static),
        );
        let reads = fixed::reads(&compute, &bindings);
        let promised: Vec<&str> = params.fixed.iter().flat_map(|f| f.split('+')).collect();
        let known = variables(self.program.module());
        if let Some(unknown) = promised.iter().find(|p| !known.contains(**p)) {
            let known: Vec<&str> = known.iter().map(String::as_str).collect();
            return Err(refuse(
                &refusals::UNKNOWN_FIXED,
                format!("`fixed` names `{unknown}`, which is not a variable of the program"),
                &format!("name some of: {}", known.join(", ")),
            ));
        }
        let is_promised = |read: &Read| {
            promised.contains(&read.to_string().as_str()) || promised.contains(&read.name.as_str())
        };
        let quoted = |reads: &[&Read]| {
            let names: Vec<String> = reads.iter().map(|r| format!("`{r}`")).collect();
            names.join(", ")
        };
        let changing: Vec<&Read> = reads
            .iter()
            .filter(|read| {
                let all = facts.changing.iter().flatten();
                all.filter(|c| c.material == plan.material)
                    .filter(|c| (c.group, c.binding) == (read.group, read.binding))
                    .any(|c| read.member.is_none() || c.member == read.member)
            })
            .collect();
        if !changing.is_empty() {
            return Err(refuse(
                &refusals::CHANGES,
                format!(
                    "the hoisted values read {}, which changes between the frames of the scene, so \
                     they cannot be computed once at load",
                    quoted(&changing)
                ),
                "use form=shared; or set its value in the scene (`values`), if the host never \
                 changes it",
            ));
        }
        let unknown: Vec<&Read> = reads.iter().filter(|r| !is_promised(r)).collect();
        if facts.changing.is_none() && !unknown.is_empty() {
            let names: Vec<String> = reads.iter().map(ToString::to_string).collect();
            return Err(refuse(
                &refusals::MAY_CHANGE,
                format!(
                    "the hoisted values read {}, and without a scene preshade cannot know whether \
                     it changes between frames",
                    quoted(&unknown)
                ),
                &format!("if none of them changes, set fixed={}", names.join("+")),
            ));
        }
        Ok(reads.iter().map(ToString::to_string).collect())
    }

    /// Checks the author's stage: it runs three times per invocation, and again for each new
    /// vertex.
    fn check_author(program: &Program, author: Handle<naga::Function>) -> Result<(), Box<Refusal>> {
        let module = program.module();
        let info = &program.info()[author];
        for (handle, global) in module.global_variables.iter() {
            if !info[handle].contains(GlobalUse::WRITE) {
                continue;
            }
            let name = global.name.as_deref().unwrap_or_default();
            return Err(match global.space {
                AddressSpace::Private => refuse(
                    &shared::VERTEX_STATE,
                    format!(
                        "the vertex stage keeps state in the private variable `{name}`, and it \
                         would run several times in one invocation"
                    ),
                    "make the variable local",
                ),
                _ => refuse(
                    &refusals::VERTEX_STORES,
                    format!(
                        "the vertex stage writes `{name}`, and it would run more often than the \
                         material has vertices"
                    ),
                    "move the writes to a pass of their own",
                ),
            });
        }
        Ok(())
    }

    fn check_inputs(pass: &GpuPass, split: &Split, module: &Module) -> Result<(), Box<Refusal>> {
        let half = pass.attributes.iter().find(|a| a.ty.contains("f16"));
        if let Some(attribute) = half {
            return Err(refuse(
                &shared::HALF_ATTRIBUTE,
                format!(
                    "the attribute `{}` is f16, which preshade does not decode from a buffer",
                    attribute.name
                ),
                "declare it f32; the vertex buffer may keep its format",
            ));
        }
        let known = [BuiltIn::VertexIndex, BuiltIn::InstanceIndex];
        for input in interface::opened(module, &split.inputs) {
            if let Some(Binding::BuiltIn(b)) = input.binding
                && !known.contains(&b)
            {
                return Err(refuse(
                    &shared::VERTEX_BUILTIN,
                    format!("the vertex stage reads {b:?}, which a new vertex does not have"),
                    "leave it out",
                ));
            }
        }
        Ok(())
    }

    /// Checks the storage buffers against WebGPU's guaranteed eight per stage
    /// (`maxStorageBuffersPerShaderStage`).
    fn check_buffers(pass: &GpuPass, params: &TessellateParams) -> Result<(), Box<Refusal>> {
        let storage = [BindingKind::StorageRead, BindingKind::StorageReadWrite];
        let authors = pass.bindings.iter();
        let authors = authors.filter(|b| b.visibility.vertex && storage.contains(&b.kind));
        let count = authors.count() + pass.attributes.len() + 2;
        if count <= STORAGE_BUFFERS {
            return Ok(());
        }
        let stage = match params.form {
            Form::Pulled | Form::Static => "vertex",
            Form::Shared => "compute",
        };
        Err(refuse(
            &refusals::STORAGE_BUFFERS,
            format!(
                "its {stage} stage would read {count} storage buffers, and WebGPU guarantees \
                 {STORAGE_BUFFERS} (maxStorageBuffersPerShaderStage)"
            ),
            "pack attributes into fewer buffers",
        ))
    }

    /// Checks that the fragment stage does not depend on the author's triangles.
    fn check_fragment(pass: &GpuPass, program: &Program) -> Result<(), Box<Refusal>> {
        let fragment = pass.fragment.as_deref();
        let entry = fragment.and_then(|f| program.entry_point(ShaderStage::Fragment, f));
        let Some((_, entry)) = entry else {
            return Ok(());
        };
        for input in interface::inputs(program.module(), &entry.function) {
            if let Some(Binding::BuiltIn(BuiltIn::PrimitiveIndex | BuiltIn::Barycentric { .. })) =
                input.binding
            {
                return Err(refuse(
                    &refusals::KNOWS_TRIANGLES,
                    "the fragment stage reads a triangle index or barycentric coordinates, which \
                     dividing the triangle changes",
                    "pass them as varyings",
                ));
            }
        }
        Ok(())
    }
}

/// Names of the host's variables and their members.
fn variables(module: &Module) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let bound = module.global_variables.iter().map(|(_, global)| global);
    for global in bound.filter(|g| g.binding.is_some()) {
        let name = global.name.as_deref().unwrap_or_default();
        if !name.is_empty() {
            names.insert(name.to_owned());
        }
        if let naga::TypeInner::Struct { members, .. } = &module.types[global.ty].inner {
            let members = members.iter().filter_map(|m| m.name.as_deref());
            names.extend(members.map(|member| match name {
                "" => member.to_owned(),
                name => format!("{name}.{member}"),
            }));
        }
    }
    names
}
