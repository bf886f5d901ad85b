//! `tessellate`: what was hoisted is computed at more vertices than the author's.
//!
//! Goal: a hoisted value that bends within a triangle is followed more closely, for less than a fragment's work (Wang et al. 2014; seed 4's article does it by hand
//! with a tessellation stage, which WebGPU has not).
//!
//! ```text
//! before:  vs(attributes)        -> rest(author(attributes))
//!
//! after:   vs(vertex, instance)  -> place = which triangle, and where in it
//!                                   rest(between(author(corner 0), author(corner 1), author(corner 2), place))
//! ```
//!
//! `author` is the author's vertex stage and `rest` what `hoist` put behind it. Clip position and varyings of a new vertex are the corners' interpolated, as the
//! rasteriser would have interpolated them there, so that surface and varyings stay what they were. The rasteriser snaps new vertices to its subpixel grid all the same:
//! coverage and depth may differ in last bits, which is measured and not promised.
//!
//! No cracks: a corner keeps its own bits; a point on an edge is computed from the edge's ends alone, in an order given by the bits of their positions, so that both
//! triangles agree even across a seam of vertices; all edges have one level.
//!
//! It hurts where triangles are small already, and where interpolating three corners costs more than what was hoisted.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use naga::valid::GlobalUse;
use naga::{AddressSpace, Binding, BuiltIn, Handle, Module, ShaderStage};

use crate::contract::Contract;
use crate::geometry::{Form, Geometry, Subdivision};
use crate::hoist::Hoist;
use crate::pass::{Facts, Pass, PassInfo, Refusal, Site, SiteCost, SiteKey, Sites};
use crate::place;
use crate::plan::{BindingKind, BindingSource, BindingUse, ComputePass, GeometryPart};
use crate::plan::{GpuPass, Plan, Role, Step, VertexBuffer, Visibility};
use crate::program::Program;
use crate::reflect;
use crate::state::Topology;

mod build;
pub mod mesh;
pub mod native;
pub mod pattern;
mod split;
mod stored;
mod text;

use build::Functions;
use pattern::{MAX_LEVEL, Pattern};
use split::{Outputs, Split};
use stored::Stored;
use text::{Place, Text};

/// The pass.
pub struct Tessellate;

/// Parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Params {
    /// Segments along each edge of a triangle, 1 to 64.
    pub level: u32,
    /// How a triangle is divided.
    pub pattern: Pattern,
    /// Where the new vertices are computed.
    pub form: Form,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            level: 3,
            pattern: Pattern::default(),
            form: Form::default(),
        }
    }
}

/// Storage buffers that every WebGPU device reads in a stage.
const STORAGE_BUFFERS: usize = 8;

/// Bindings of our own: the constants, the pattern, the indices, and a stream for each attribute, in this order from `first` on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Slots {
    group: u32,
    first: u32,
}

impl Slots {
    /// Behind all bindings of the last group that has any.
    fn free(module: &Module) -> Self {
        let bindings = || {
            let globals = module.global_variables.iter();
            globals.filter_map(|(_, g)| g.binding)
        };
        let group = bindings().map(|b| b.group).max().unwrap_or(0);
        let first = bindings()
            .filter(|b| b.group == group)
            .map(|b| b.binding + 1)
            .max()
            .unwrap_or(0);
        Self { group, first }
    }

    fn stream(self, index: usize) -> u32 {
        self.first + 3 + index as u32
    }
}

impl Pass for Tessellate {
    type Params = Params;

    const INFO: PassInfo = PassInfo {
        name: "tessellate",
        summary: "divides the triangles of a hoisted material, so that what was hoisted is computed at more vertices",
        source: "Wang et al., Automatic Shader Simplification using Surface Signal Approximation (2014)",
        hurts: "where triangles are small already: each new vertex costs what was hoisted, and three corners interpolated",
    };

    fn sites(plan: &Plan, _: &Facts, params: &Params) -> Sites {
        match Material::examine(plan, params) {
            Ok(material) => Sites {
                sites: vec![material.site(params)],
                ..Sites::default()
            },
            Err(refusal) => Sites {
                refusals: vec![*refusal],
                ..Sites::default()
            },
        }
    }

    fn apply(
        plan: &Plan,
        _: &Facts,
        site: &SiteKey,
        params: &Params,
    ) -> Result<Plan, Box<Refusal>> {
        let material = Material::examine(plan, params)?;
        if *site != material.key {
            return Err(refuse(
                "stale",
                "the site is not one of this plan's",
                "find the sites anew",
            ));
        }
        material
            .apply(plan, params)
            .map_err(|why| Box::new(Refusal::bug(Self::INFO.name, why)))
    }
}

fn refuse(code: &str, reason: impl Into<String>, remedy: &str) -> Box<Refusal> {
    Box::new(Refusal::new(
        Tessellate::INFO.name,
        code,
        reason.into(),
        remedy,
    ))
}

/// A hoisted material.
struct Material<'a> {
    pass: &'a GpuPass,
    program: &'a Program,
    vertex: usize,
    split: Split,
    outputs: Outputs,
    contract: Contract,
    key: SiteKey,
}

impl<'a> Material<'a> {
    fn examine(plan: &'a Plan, params: &Params) -> Result<Self, Box<Refusal>> {
        if !(1..=MAX_LEVEL).contains(&params.level) {
            return Err(refuse(
                "level",
                format!("{} is no level of tessellation", params.level),
                "give a level of 1 to 64",
            ));
        }
        let main = plan.main().and_then(|p| Some((p, plan.program(p)?)));
        let Some((pass, program)) = main else {
            return Err(refuse(
                "no-main-pass",
                "the plan has no main pass",
                "start from the original plan",
            ));
        };
        let hoist = plan.steps.iter().rfind(|s| s.pass == Hoist::INFO.name);
        let Some(hoist) = hoist else {
            return Err(refuse(
                "not-hoisted",
                "nothing was moved to the vertices: more of them would change nothing but the time",
                "put hoist:budget=0.01 before it in the recipe",
            ));
        };
        if !matches!(hoist.contract, Contract::Approximate { .. }) {
            return Err(refuse(
                "nothing-bends",
                "all that was hoisted interpolates to what it was: more vertices would change nothing but the time",
                "give hoist a budget, so that it moves what bends",
            ));
        }
        if plan.passes.len() > 1 {
            return Err(refuse(
                "has-prepass",
                "another pass of the plan draws the same surface, undivided",
                "tessellate first, then add the pre-pass: it is then divided alike",
            ));
        }
        if pass.primitive.topology != Topology::TriangleList {
            return Err(refuse(
                "topology",
                "only lists of triangles are divided (a strip's restarts are not followed)",
                "draw a triangle list",
            ));
        }
        let Some((vertex, _)) = program.entry_point(ShaderStage::Vertex, &pass.vertex) else {
            return Err(refuse(
                "no-vertex-stage",
                "the plan names a vertex stage that its program has not",
                "start from the original plan",
            ));
        };
        let module = program.module();
        let Some(split) = split::split(module, vertex) else {
            return Err(refuse(
                "not-split",
                "the vertex stage is not the one that hoist built",
                "tessellate straight after hoist",
            ));
        };
        Self::check_author(program, split.author)?;
        Self::check_inputs(pass, &split, module)?;
        Self::check_fragment(pass, program)?;
        let outputs = Outputs::of(module, split.given).map_err(|(name, why)| {
            refuse(
                "varying",
                format!("the varying `{name}` cannot be had at a new vertex: {why}"),
                "make it a perspective-correct f32, or flat",
            )
        })?;
        if params.form == Form::Shared && outputs.has_flat() {
            return Err(refuse(
                "flat-shared",
                "a flat varying differs between the triangles around a vertex, which would share it",
                "take form=pulled",
            ));
        }
        Self::check_buffers(pass, params)?;
        Ok(Self {
            pass,
            program,
            vertex,
            split,
            outputs,
            contract: hoist.contract.clone(),
            key: SiteKey {
                role: Role::Main,
                entry_point: pass.vertex.clone(),
                slice: hoist.site.slice.clone(),
                ordinal: 0,
            },
        })
    }

    /// The author's stage runs three times in one invocation, and again for each new vertex.
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
                    "vertex-state",
                    format!(
                        "the vertex stage keeps state in the private variable `{name}`, and it would run several times in one invocation"
                    ),
                    "make the variable local",
                ),
                _ => refuse(
                    "vertex-stores",
                    format!(
                        "the vertex stage writes `{name}`, and it would run more often than the material has vertices"
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
                "half-attribute",
                format!(
                    "the attribute `{}` is of half precision, which is not decoded here",
                    attribute.name
                ),
                "declare it f32: the vertex buffer's format may stay",
            ));
        }
        let known = [BuiltIn::VertexIndex, BuiltIn::InstanceIndex];
        for input in reflect::opened(module, &split.inputs) {
            if let Some(Binding::BuiltIn(b)) = input.binding
                && !known.contains(&b)
            {
                return Err(refuse(
                    "vertex-builtin",
                    format!("the vertex stage reads {b:?}, which a new vertex has not"),
                    "leave it out",
                ));
            }
        }
        Ok(())
    }

    /// Every WebGPU device reads eight storage buffers in a stage (`maxStorageBuffersPerShaderStage`).
    fn check_buffers(pass: &GpuPass, params: &Params) -> Result<(), Box<Refusal>> {
        let storage = [BindingKind::StorageRead, BindingKind::StorageReadWrite];
        let authors = pass.bindings.iter();
        let authors = authors.filter(|b| b.visibility.vertex && storage.contains(&b.kind));
        let count = authors.count() + pass.attributes.len() + 2;
        if count <= STORAGE_BUFFERS {
            return Ok(());
        }
        let stage = match params.form {
            Form::Pulled => "vertex",
            Form::Shared => "compute",
        };
        Err(refuse(
            "storage-buffers",
            format!(
                "its {stage} stage would read {count} storage buffers, and WebGPU promises {STORAGE_BUFFERS} (maxStorageBuffersPerShaderStage)"
            ),
            "pack attributes into fewer",
        ))
    }

    /// What the fragment stage may know of the author's triangles.
    fn check_fragment(pass: &GpuPass, program: &Program) -> Result<(), Box<Refusal>> {
        let fragment = pass.fragment.as_deref();
        let entry = fragment.and_then(|f| program.entry_point(ShaderStage::Fragment, f));
        let Some((_, entry)) = entry else {
            return Ok(());
        };
        for input in reflect::inputs(program.module(), &entry.function) {
            if let Some(Binding::BuiltIn(BuiltIn::PrimitiveIndex | BuiltIn::Barycentric { .. })) =
                input.binding
            {
                return Err(refuse(
                    "knows-triangles",
                    "the fragment stage reads the index of its triangle, or its place in it: both would be the small ones'",
                    "pass them as varyings",
                ));
            }
        }
        Ok(())
    }

    fn site(&self, params: &Params) -> Site {
        Site {
            key: self.key.clone(),
            what: self.describe(&subdivision(params)),
            location: None,
            cost: SiteCost::default(),
        }
    }

    fn describe(&self, subdivision: &Subdivision) -> String {
        let form = match subdivision.form {
            Form::Pulled => "each triangle's own",
            Form::Shared => "each once for all triangles around it",
        };
        format!(
            "level {}: {} triangles in place of each, {} vertices, {form}; clip position and varyings are interpolated, what was hoisted is computed at each",
            subdivision.level,
            subdivision.indices.len() / 3,
            subdivision.vertices.len(),
        )
    }

    fn apply(&self, plan: &Plan, params: &Params) -> Result<Plan, String> {
        let subdivision = subdivision(params);
        let slots = Slots::free(self.program.module());
        let mut next = plan.clone();
        let program = match params.form {
            Form::Pulled => self.pulled(slots, &subdivision)?,
            Form::Shared => self.shared(&mut next, slots, &subdivision)?,
        };
        let parts = self.parts(slots, params.form);
        for pass in &mut next.passes {
            pass.bindings.extend(parts.clone());
            pass.geometry = Geometry::Subdivided(subdivision.clone());
            reflect::fill(pass, &program);
        }
        next.programs.insert(self.pass.program.clone(), program);
        next.steps.push(Step {
            pass: Tessellate::INFO.name.to_owned(),
            site: self.key.clone(),
            params: serde_json::to_value(params).unwrap_or_default(),
            contract: self.contract.clone(),
        });
        next.notes.push(self.describe(&subdivision));
        Ok(next)
    }

    /// The author's vertex stage at new vertices, in the module of its program.
    fn functions(&self, text: &Text<'_>) -> Result<Functions, String> {
        build::add(
            self.program.module().clone(),
            &self.pass.vertex,
            self.split.clone(),
            &self.outputs,
            text,
        )
    }

    /// `module` with these entry points alone, as a program.
    fn program(&self, module: &Module, entries: &[(ShaderStage, &str)]) -> Result<Program, String> {
        self.program
            .with_module(place::retain(module, entries))
            .map_err(|e| e.to_string())
    }

    /// The two stages of the main pass.
    fn entries(&self) -> Vec<(ShaderStage, &str)> {
        let fragment = self.pass.fragment.as_deref();
        std::iter::once((ShaderStage::Vertex, self.pass.vertex.as_str()))
            .chain(fragment.map(|f| (ShaderStage::Fragment, f)))
            .collect()
    }

    fn pulled(&self, slots: Slots, subdivision: &Subdivision) -> Result<Program, String> {
        let functions = self.functions(&Text {
            attributes: &self.pass.attributes,
            widths: &self.outputs.widths(),
            slots,
            place: Place::Pattern {
                vertices: subdivision.vertices.len() as u32,
                batch: subdivision.batch,
                denominator: subdivision.denominator,
            },
            stores: &[],
        })?;
        self.program(&build::pulled(&functions, self.vertex), &self.entries())
    }

    /// Adds the compute pass to `plan`; the program is the main pass's, which reads what that stored.
    fn shared(
        &self,
        plan: &mut Plan,
        slots: Slots,
        subdivision: &Subdivision,
    ) -> Result<Program, String> {
        let module = self.program.module();
        let result = self.split.rest.result.as_ref().map(|r| r.ty);
        let layout = Stored::of(module, result.ok_or("the vertex stage gives nothing")?)?;
        let functions = self.functions(&Text {
            attributes: &self.pass.attributes,
            widths: &self.outputs.widths(),
            slots,
            place: Place::Record {
                denominator: subdivision.denominator,
            },
            stores: &layout.widths(),
        })?;
        let entry = format!("{}_points", self.pass.vertex);
        let compute = stored::stored(&functions, self.vertex, &entry, &layout)?;
        let entries = [(ShaderStage::Compute, entry.as_str())];
        let compute = self.program(&compute, &entries)?;
        let mut known = self.parts(slots, Form::Shared);
        known.extend(self.pass.bindings.iter().cloned());
        plan.compute.push(ComputePass {
            program: COMPUTE.to_owned(),
            bindings: reflect::bindings(&compute, &entries, &known),
            entry_point: entry,
            phase: None,
            workgroup: text::WORKGROUP,
            geometry: Geometry::Subdivided(subdivision.clone()),
        });
        plan.programs.insert(COMPUTE.to_owned(), compute);
        plan.vertex_buffers.push(VertexBuffer {
            name: VERTICES.to_owned(),
            stride: layout.words * 4,
        });
        let main = stored::loaded(module.clone(), self.vertex, slots, &layout)?;
        self.program(&main, &self.entries())
    }

    /// Our own bindings, for [`reflect::fill`] to know where they come from.
    fn parts(&self, slots: Slots, form: Form) -> Vec<BindingUse> {
        let attributes = &self.pass.attributes;
        let constants = GeometryPart::Constants {
            streams: attributes.iter().map(|a| a.location).collect(),
        };
        let parts = match form {
            Form::Pulled => [constants, GeometryPart::Pattern, GeometryPart::Indices],
            Form::Shared => {
                let buffer = VERTICES.to_owned();
                let vertices = GeometryPart::Vertices { buffer };
                [constants, GeometryPart::Points, vertices]
            }
        };
        let streams = attributes.iter().cloned().map(GeometryPart::Attribute);
        parts
            .into_iter()
            .chain(streams)
            .enumerate()
            .map(|(index, part)| BindingUse {
                group: slots.group,
                binding: slots.first + index as u32,
                name: String::new(),
                kind: BindingKind::StorageRead,
                visibility: Visibility::default(),
                source: BindingSource::Geometry { part },
                layout: None,
            })
            .collect()
    }
}

/// Key of the compute pass's program.
const COMPUTE: &str = "points";

/// Name of the buffer between it and the main pass.
const VERTICES: &str = "vertices";

fn subdivision(params: &Params) -> Subdivision {
    Subdivision::new(params.pattern, params.level, params.form)
}
