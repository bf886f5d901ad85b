//! `tessellate`: computes hoisted values at more vertices than the author's.
//!
//! Goal: follow a hoisted value that bends within a triangle more closely, for less than
//! per-fragment work (Wang et al. 2014; Erkaman's article does it by hand with a tessellation
//! stage, which WebGPU lacks).
//!
//! ```text
//! before:  vs(attributes)        -> rest(author(attributes))
//!
//! after:   vs(vertex, instance)  -> place = which triangle, and where in it
//!                                   rest(between(author(corner 0), author(corner 1), author(corner 2), place))
//! ```
//!
//! `author` is the author's vertex stage and `rest` is the code that `hoist` put behind it. The
//! clip position and varyings of a new vertex are interpolated between the corners as the
//! rasteriser would do it, so the surface stays the same. The rasteriser still snaps new vertices
//! to its subpixel grid: coverage and depth may differ in the last bits. `verify` measures this;
//! the contract does not cover it.
//!
//! There are no cracks. A corner keeps its bits. A point on an edge is computed only from the
//! edge's ends, in an order given by the bits of their positions, so both triangles agree even
//! across a seam of vertices. All edges have one level.
//!
//! Strips are drawn as lists of their triangles. The pass refuses varyings with linear
//! interpolation, where a point behind the viewer has no place. It also refuses half-precision
//! attributes and varyings, because it would decode and blend them at another precision than the
//! rasteriser.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use naga::{Handle, Module, ShaderStage};

use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_passes::rebuild::place;
use preshade_plan::contract::Contract;
use preshade_plan::geometry::{Form, Geometry, Subdivision};
use preshade_plan::pass::{
    Example, Expected, Facts, Outcome, Pass, PassInfo, Refusal, Refused, Use,
};
use preshade_plan::plan::{
    BindingKind, BindingSource, BindingUse, Change, ComputePass, GeometryPart, GpuPass, Plan, Site,
    SiteCost, Step, VertexBuffer, When,
};
use preshade_plan::program::Program;
use preshade_plan::state::Topology;
use preshade_plan::{pattern, reflect};
use shader_text::refusals::RefusalInfo;

mod adaptive;
mod build;
mod examine;
mod fixed;
pub mod native;
pub mod refusals;
mod split;
mod stored;
mod text;

use build::Functions;
use pattern::{MAX_LEVEL, Pattern};
use split::{Origin, Outputs, Split};
use stored::{Evaluation, Stored};
use text::{Order, Points, Text, VertexPlace};

pub struct Tessellate;

/// Parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct TessellateParams {
    /// Segments along each edge of a triangle, 1 to 64.
    #[schemars(range(min = 1, max = MAX_LEVEL))]
    pub level: u32,
    /// Divides each edge into segments of at most this many pixels, 1 to 256, and at most `level`
    /// segments. `form` is then `pulled`, and the pattern is `rows`. Default: every edge has
    /// `level` segments.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = MOST_EDGE_PIXELS))]
    pub edge_pixels: Option<u32>,
    /// How a triangle is divided.
    pub pattern: Pattern,
    /// Where the new vertices are computed.
    pub form: Form,
    /// `form=static`: uniforms or members (`camera.exposure`) that never change after load, joined
    /// by `+`. Default: those that follow neither the camera nor the time in the scene, if there is
    /// one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fixed: Option<String>,
}

impl Default for TessellateParams {
    fn default() -> Self {
        Self {
            level: 3,
            edge_pixels: None,
            pattern: Pattern::default(),
            form: Form::default(),
            fixed: None,
        }
    }
}

/// Longest segment in pixels: its square in half pixels times that of the highest level fits 32
/// bits.
pub(crate) const MOST_EDGE_PIXELS: u32 = 256;

/// Generated bindings from `first` on, in this order: the constants, the pattern, the indices, a
/// stream per attribute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Slots {
    group: u32,
    first: u32,
}

impl Slots {
    /// Slots after all bindings of the last used group.
    fn free(module: &Module) -> Self {
        let (group, first) = reflect::free_binding(module);
        Self { group, first }
    }

    fn stream(self, index: usize) -> u32 {
        self.first + 3 + index as u32
    }
}

impl Pass for Tessellate {
    type Params = TessellateParams;

    const INFO: PassInfo = PassInfo {
        name: "tessellate",
        summary: "divides the triangles of a hoisted material, so that hoisted values are computed \
                  at more vertices",
        source: "Wang et al., Automatic Shader Simplification using Surface Signal Approximation \
                 (2014)",
        when: "`hoist` gains much and its error is too large: triangles are large, and hoisted \
               values are not linear within them",
        hurts: "where triangles are already small: each new vertex computes the hoisted values and \
                interpolates three corners",
        reads_scene: true,
    };

    const REFUSALS: &'static [RefusalInfo] = refusals::REFUSALS;

    const EXAMPLES: &'static [Example] = &[
        Example {
            recipe: "tessellate",
            uses: &[Use::Ahead(3)],
        },
        Example {
            recipe: "hoist:budget=0.02,finite=assumed,jumps=carried,tessellate:level=3",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "hoist:budget=0.02,finite=assumed,jumps=carried,tessellate:level=2,\
                     pattern=uniform,form=shared",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "hoist:budget=0.02,finite=assumed,jumps=carried,tessellate:level=2,\
                     depth-prepass",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "hoist:budget=1,finite=assumed,jumps=carried,tessellate:level=3",
            uses: &[Use::Fuzz],
        },
        Example {
            recipe: "hoist:budget=0.3,tessellate:level=2",
            uses: &[Use::Pictures(1)],
        },
        Example {
            recipe: "hoist:budget=0.05,tessellate:level=4",
            uses: &[
                Use::Page("pages/leaf"),
                Use::Picture {
                    scene: "fixtures/scenes/teapot-specular.toml --camera article --size 240x220 \
                            --frames 1",
                    caption: "the highlight of `hoist` at sixteen times the triangles: less is off",
                    rows: 1,
                },
            ],
        },
        Example {
            recipe: "hoist:BUDGET,tessellate:form=shared,level=2",
            uses: &[Use::PlanWithin],
        },
        Example {
            recipe: "hoist:BUDGET,tessellate:form=shared,level=4",
            uses: &[Use::PlanWithin],
        },
        Example {
            recipe: "hoist:BUDGET,tessellate:form=shared,level=8",
            uses: &[Use::PlanWithin],
        },
    ];

    fn expected(_params: &TessellateParams) -> Expected {
        Expected {
            replaces_varyings: true,
            ..Expected::default()
        }
    }

    fn run(plan: &Plan, facts: &Facts, params: &TessellateParams) -> Result<Outcome, Refused> {
        let material = DividedMaterial::examine(plan, facts, params)?;
        let bug = |why| Box::new(Refusal::bug(Self::INFO.name, why));
        Ok(Outcome {
            plan: material.apply(plan, params).map_err(bug)?,
            change: material.change(params),
            left: Vec::new(),
        })
    }
}

fn refuse(code: &RefusalInfo, reason: impl Into<String>, remedy: &str) -> Box<Refusal> {
    Box::new(Refusal::new(
        Tessellate::INFO.name,
        code,
        reason.into(),
        remedy,
    ))
}

struct DividedMaterial<'a> {
    pass: &'a GpuPass,
    program: &'a Program,
    vertex: usize,
    split: Split,
    outputs: Outputs,
    contract: Contract,
    key: Site,
    /// For `form=static`: variables that it reads, which must not change after load.
    fixed: Vec<String>,
}

impl DividedMaterial<'_> {
    fn change(&self, params: &TessellateParams) -> Change {
        Change {
            key: self.key.clone(),
            what: self.describe(&subdivision(params)),
            location: None,
            cost: self.cost(),
        }
    }

    /// Cost of the hoisted work at each new vertex, and cost of the whole vertex stage.
    fn cost(&self) -> SiteCost {
        let graph = Graph::build(self.program);
        let whole = graph.entry_cost(self.vertex);
        let author = graph.cost(FunctionId::Function(self.split.author));
        SiteCost {
            slice: whole - author,
            whole,
        }
    }

    fn describe(&self, subdivision: &Subdivision) -> String {
        let form = match subdivision.form {
            Form::Pulled => "each triangle's own",
            Form::Shared | Form::Static => "each once for all triangles around it",
        };
        let when = match (subdivision.form, &self.fixed[..]) {
            (Form::Pulled | Form::Shared, _) => String::new(),
            (Form::Static, []) => " once, at load".to_owned(),
            (Form::Static, fixed) => {
                format!(
                    " once, at load, and again where any of {} changes",
                    fixed.join(", ")
                )
            }
        };
        let level = match subdivision.edge_pixels {
            None => format!("level {}", subdivision.level),
            Some(pixels) => format!(
                "segments of {pixels} pixels, at most {} an edge",
                subdivision.level
            ),
        };
        format!(
            "{level}: {} triangles in place of each, {} vertices, {form}; \
             clip position and varyings are interpolated, hoisted values are computed at \
             each{when}",
            subdivision.indices.len() / 3,
            subdivision.vertices.len(),
        )
    }

    fn apply(&self, plan: &Plan, params: &TessellateParams) -> Result<Plan, String> {
        let subdivision = Subdivision {
            given: self.pass.primitive.topology,
            ..subdivision(params)
        };
        let slots = Slots::free(self.program.module());
        let mut next = plan.clone();
        let program = match params.form {
            Form::Pulled => self.pulled(slots, &subdivision)?,
            Form::Shared => self.shared(&mut next, slots, &subdivision)?,
            Form::Static => self.fixed(&mut next, slots, &subdivision)?,
        };
        let parts = self.parts(slots, params.form);
        for pass in &mut next.passes {
            pass.bindings.extend(parts.clone());
            pass.geometry = Geometry::Subdivided(subdivision.clone());
            pass.primitive.topology = Topology::TriangleList;
            reflect::fill(pass, &program);
        }
        next.programs.insert(self.pass.program.clone(), program);
        // Divided triangles have different positions from the original's.
        next.self_test = None;
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

    /// A program with only these entry points of `module`.
    fn program(&self, module: &Module, entries: &[(ShaderStage, &str)]) -> Result<Program, String> {
        self.program
            .with_module(place::retain(module, entries))
            .map_err(|e| e.to_string())
    }

    fn pulled(&self, slots: Slots, subdivision: &Subdivision) -> Result<Program, String> {
        if let Some(edge_pixels) = subdivision.edge_pixels {
            let module = adaptive::adaptive(
                self.program.module().clone(),
                self.vertex,
                &self.split,
                &self.outputs,
                &Text {
                    attributes: &self.pass.attributes,
                    widths: &self.outputs.widths(),
                    slots,
                    place: VertexPlace::Adaptive {
                        vertices: subdivision.vertices.len() as u32,
                        batch: subdivision.batch,
                        edge_pixels,
                        most: subdivision.level,
                    },
                    points: None,
                    order: Order::ByPosition,
                },
            )?;
            return self.program(&module, &self.pass.stages());
        }
        let functions = self.functions(&Text {
            attributes: &self.pass.attributes,
            widths: &self.outputs.widths(),
            slots,
            place: VertexPlace::Pattern {
                vertices: subdivision.vertices.len() as u32,
                batch: subdivision.batch,
                denominator: subdivision.denominator,
            },
            points: None,
            order: Order::ByPosition,
        })?;
        self.program(&build::pulled(&functions, self.vertex), &self.pass.stages())
    }

    /// Adds the compute pass to `plan`. The main program reads its result.
    fn shared(
        &self,
        plan: &mut Plan,
        slots: Slots,
        subdivision: &Subdivision,
    ) -> Result<Program, String> {
        let layout = Stored::of(self.program.module(), self.result()?, |_| true)?;
        let points = (Points::Stored, layout.widths());
        let functions = self.recorded(slots, subdivision, points, Order::ByPosition)?;
        let entry = self.compute_entry();
        let compute = stored::stored(&functions, self.vertex, &entry, &layout, Evaluation::Vertex)?;
        let compute = self.program(&compute, &[(ShaderStage::Compute, &entry)])?;
        self.add_compute(plan, (compute, entry), subdivision, &layout);
        let main = stored::loaded(self.program.module().clone(), self.vertex, slots, &layout)?;
        self.program(&main, &self.pass.stages())
    }

    /// Adds the compute pass at load to `plan`. The main program reads its result.
    fn fixed(
        &self,
        plan: &mut Plan,
        slots: Slots,
        subdivision: &Subdivision,
    ) -> Result<Program, String> {
        let (compute, entry, layout) = self.at_load(slots, subdivision)?;
        self.add_compute(plan, (compute, entry), subdivision, &layout);
        let points = (Points::Loaded, layout.widths());
        let functions = self.recorded(slots, subdivision, points, Order::ByPosition)?;
        let origins = self.origins()?;
        let main = fixed::read(&functions, self.vertex, &origins, &layout)?;
        self.program(&main, &self.pass.stages())
    }

    /// The program that computes only the hoisted values, its entry point, and the storage layout.
    fn at_load(
        &self,
        slots: Slots,
        subdivision: &Subdivision,
    ) -> Result<(Program, String, Stored), String> {
        let origins = self.origins()?;
        let is_hoisted = |index: u32| origins.get(index as usize) == Some(&Origin::Hoisted);
        let layout = Stored::of(self.program.module(), self.result()?, is_hoisted)?;
        let points = (Points::Stored, layout.widths());
        let functions = self.recorded(slots, subdivision, points, Order::AsRecorded)?;
        let entry = self.compute_entry();
        let compute = fixed::kept(self.program, &functions, self.vertex, &entry, &layout)?;
        let compute = self.program(&compute, &[(ShaderStage::Compute, &entry)])?;
        Ok((compute, entry, layout))
    }

    /// The functions of a new vertex with recorded place and corners, for storing or loading.
    fn recorded(
        &self,
        slots: Slots,
        subdivision: &Subdivision,
        (points, widths): (Points, Vec<u8>),
        order: Order,
    ) -> Result<Functions, String> {
        self.functions(&Text {
            attributes: &self.pass.attributes,
            widths: &self.outputs.widths(),
            slots,
            place: VertexPlace::Record {
                denominator: subdivision.denominator,
            },
            points: Some((points, &widths)),
            order,
        })
    }

    fn compute_entry(&self) -> String {
        format!("{}_points", self.pass.vertex)
    }

    fn result(&self) -> Result<Handle<naga::Type>, String> {
        let result = self.split.rest.result.as_ref().map(|r| r.ty);
        result.ok_or_else(|| "the vertex stage gives nothing".to_owned())
    }

    fn origins(&self) -> Result<Vec<Origin>, String> {
        let origins = self.split.origins();
        origins.ok_or_else(|| "the vertex stage's result is not put together".to_owned())
    }

    fn add_compute(
        &self,
        plan: &mut Plan,
        (program, entry_point): (Program, String),
        subdivision: &Subdivision,
        layout: &Stored,
    ) {
        let form = subdivision.form;
        let mut bindings = self.parts(Slots::free(self.program.module()), form);
        bindings.extend(self.pass.bindings.iter().cloned());
        let geometry = Geometry::Subdivided(subdivision.clone());
        let pass = ComputePass {
            bindings,
            when: match form {
                Form::Static => When::Load {
                    fixed: self.fixed.clone(),
                },
                Form::Pulled | Form::Shared => When::Frame,
            },
            ..ComputePass::new(COMPUTE, entry_point, text::WORKGROUP, geometry)
        };
        plan.add_compute(pass, program);
        plan.vertex_buffers.push(VertexBuffer {
            name: VERTICES.to_owned(),
            stride: layout.words * 4,
        });
    }

    /// The generated bindings with their sources, for [`reflect::fill`].
    fn parts(&self, slots: Slots, form: Form) -> Vec<BindingUse> {
        let attributes = &self.pass.attributes;
        let constants = GeometryPart::Constants {
            streams: attributes.iter().map(|a| a.location).collect(),
        };
        let parts = match form {
            Form::Pulled => [constants, GeometryPart::Pattern, GeometryPart::Indices],
            Form::Shared | Form::Static => {
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
            .map(|(index, part)| {
                let at = [slots.group, slots.first + index as u32];
                let source = BindingSource::Geometry { part };
                BindingUse::new(at, BindingKind::StorageRead, source)
            })
            .collect()
    }
}

/// Key of the compute pass's program.
const COMPUTE: &str = "points";

/// Name of the buffer between it and the main pass.
const VERTICES: &str = "vertices";

fn subdivision(params: &TessellateParams) -> Subdivision {
    match params.edge_pixels {
        Some(edge_pixels) => Subdivision::adaptive(params.level, edge_pixels),
        None => Subdivision::new(params.pattern, params.level, params.form),
    }
}
