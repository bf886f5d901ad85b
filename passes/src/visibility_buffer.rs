//! `visibility-buffer`: draw which triangle each pixel shows, then shade each pixel once.
//!
//! Goal: the material's fragment stage runs once for each covered pixel, and only for what is seen, whatever the depth complexity and the order of draws
//! (Burns and Hunt, "The Visibility Buffer: A Cache-Friendly Approach to Deferred Shading", JCGT 2013; seed 3's article builds one by hand for grass).
//!
//! ```text
//! before:  main      vs + fs                 every fragment that is nearest so far is shaded
//!
//! after:   ids       each draw               position and discard, sliced; writes (draw and instance, triangle) and depth
//!          classify  once for the frame      the number of the draw that each pixel shows, as a depth
//!          resolve   full screen, each draw  the triangle's corners are fetched and run through the author's vertex stage, the varyings interpolated, and the
//!                                            author's fragment stage run on them
//! ```
//!
//! What a fragment took from the rasteriser is made again: barycentrics from homogeneous edge functions, right for triangles that reach behind the viewer; each varying by its
//! own interpolation; gradients as differences between pixels of the quad on the same triangle; facing from a bit of the id.
//!
//! It hurts where little is hidden, where vertices are dear (each pixel runs three), and where neighbouring pixels show far-apart instances, whose data no cache holds.

use std::collections::BTreeMap;

use naga::{Binding, ShaderStage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::contract::{Assumption, Contract};
use crate::depth_only::{self, DepthOnly, Invariance, VertexStage};
use crate::fetch::Linked;
use crate::geometry::{Formats, Geometry};
use crate::opaque::{self, Opaque};
use crate::pass::{Facts, Pass, PassInfo, Refusal, Site, SiteCost, SiteKey, Sites};
use crate::place;
use crate::plan::{
    Attachment, AttachmentFormat, BindingKind, BindingSource, BindingUse, ClearValue, ComputePass,
    Draws, GeometryPart, GpuPass, Phase, Plan, Role, Step, Visibility, When,
};
use crate::reflect;
use crate::self_test;
use crate::state::{
    AttachmentOps, ColorTarget, CompareFunction, CullMode, DepthBias, DepthFormat, DepthState,
    PrimitiveState, Topology,
};

mod count;
mod gradients;
mod ids;
mod jumps;
mod legal;
mod lists;
mod parts;
mod resolve;
mod stage;
mod text;

pub use count::counted;
use gradients::Failed;
use ids::Triangles;
use jumps::Reached;
use lists::Lists;
use parts::{parts, slots};
use resolve::{Built, Resolve, Runs};
use text::Slots;

/// Name of the attachment of ids.
pub const IDS: &str = "visibility-ids";

/// Name of the depth attachment of draws' numbers: `depth16unorm`, so that what a rasteriser makes of three equal depths is the number again, whatever its last bits.
/// Number `n` of [`crate::draw_table::Entry`] is `(n + 1.25) / 65535`, which any way of rounding makes the same step of.
pub const DRAWS: &str = "visibility-draws";

/// The pass.
pub struct VisibilityBuffer;

/// How the id pass knows a triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Ids {
    /// By the builtin `primitive_index`, which is a feature of the adapter.
    #[default]
    PrimitiveIndex,
    /// By vertices that no two triangles share, each fetched out of storage buffers: on any adapter.
    Unindexed,
}

/// Words of an id.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Words {
    /// `rg32uint`: as many instances and triangles as there may be.
    #[default]
    Two,
    /// `r32uint`, split by how many of each the frame has. A host refuses what does not fit.
    One,
}

impl Words {
    /// Format of the attachment of ids.
    pub fn format(self) -> AttachmentFormat {
        AttachmentFormat::Color(self.color().to_owned())
    }

    fn color(self) -> &'static str {
        match self {
            Self::Two => "rg32uint",
            Self::One => "r32uint",
        }
    }
}

/// How a draw's resolve passes over the pixels of other draws.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Select {
    /// By the depth test: a pass over the frame writes the number of each pixel's draw as a depth, and a draw's resolve compares EQUAL with its own.
    #[default]
    Depth,
    /// By looking at the id, in the fragment stage: no further pass, for frames of one draw or few.
    Id,
    /// By a list of the tiles that show the draw, which a compute pass makes; within a tile by looking at the id.
    Tiles,
}

/// Where pixels are shaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// In the fragment stage of a pass over the screen.
    #[default]
    Fragment,
    /// In a compute pass over the screen, which writes the colour as a storage texture.
    Compute,
    /// As `compute`, over pixels that compute passes have sorted by instance: neighbouring invocations fetch the same instance's data.
    Binned,
}

/// Where the corners of a triangle lie when a resolve interpolates between them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Corners {
    /// Where the vertex stage puts them: nearest to what the author means, and to rasterisers that interpolate from unsnapped positions.
    #[default]
    AsGiven,
    /// On the nearest 1/256 of a pixel, where rasterisers put them (Direct3D asks for 8 bits; Vulkan reports `subPixelPrecisionBits`), if the triangle is not clipped: for those that
    /// interpolate from there.
    Snapped,
}

/// Parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Params {
    /// Where pixels are shaded.
    pub form: Form,
    /// How the id pass knows a triangle.
    pub ids: Ids,
    /// Words of an id.
    pub words: Words,
    /// How a draw's resolve passes over the pixels of other draws; `form=compute` has no depth test, and looks at the id unless it has tiles; `form=binned` has a list of the draw's own pixels.
    pub select: Select,
    /// Formats that the attributes of vertices may be stored in.
    pub formats: Formats,
    /// Where the corners of a triangle lie when the resolve interpolates between them.
    pub corners: Corners,
    /// Vertex stage of the id pass: the author's whole one with the id beside its outputs, or its slice. Default: `sliced` where the author's position is `@invariant`, else `same`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertex: Option<VertexStage>,
    /// Whether `@invariant` is added to the id pass's position; default: `as-written` with `vertex=same`, `add` with `vertex=sliced`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub invariant: Option<Invariance>,
    /// The largest difference of a channel (`max_abs`) that is allowed, 0 to 1. Without one the promise is that of rounding: a step of 8 bits.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub budget: Option<f64>,
}

impl Params {
    fn select(&self) -> Select {
        match self.form {
            Form::Fragment => self.select,
            Form::Compute if self.select == Select::Tiles => Select::Tiles,
            Form::Compute => Select::Id,
            // Pixels of other draws are not listed.
            Form::Binned => Select::Depth,
        }
    }

    /// Two texts of one position are the same bits under `@invariant` alone: without it, the author's stage is left whole, so that as much as can be is alike.
    fn vertex(&self, opaque: &Opaque<'_>) -> VertexStage {
        self.vertex
            .unwrap_or(match opaque.has_invariant_position() {
                true => VertexStage::Sliced,
                false => VertexStage::Same,
            })
    }

    fn invariant(&self, opaque: &Opaque<'_>) -> Invariance {
        self.invariant
            .unwrap_or_else(|| Invariance::default_for(self.vertex(opaque)))
    }
}

impl Pass for VisibilityBuffer {
    type Params = Params;

    const INFO: PassInfo = PassInfo {
        name: "visibility-buffer",
        summary: "draws which triangle each pixel shows, then shades each pixel once",
        source: "Burns and Hunt, The Visibility Buffer (JCGT 2013)",
        hurts: "where little is hidden or vertices are dear: each shaded pixel fetches and runs three vertices",
    };

    fn sites(plan: &Plan, _: &Facts, params: &Params) -> Sites {
        let plan = alone(plan);
        let examined = Material::examine(&plan, params).and_then(|material| {
            // What cannot be rebuilt is found by rebuilding it.
            material.apply(&plan, params).map_err(|r| vec![*r])?;
            Ok(material)
        });
        match examined {
            Ok(material) => Sites {
                sites: vec![material.site(params)],
                ..Sites::default()
            },
            Err(refusals) => opaque::refused(refusals),
        }
    }

    fn apply(
        plan: &Plan,
        _: &Facts,
        site: &SiteKey,
        params: &Params,
    ) -> Result<Plan, Box<Refusal>> {
        let plan = alone(plan);
        let material = Material::examine(&plan, params).map_err(depth_only::first)?;
        material
            .depth
            .expect(&material.opaque, site, Self::INFO.name)?;
        material.apply(&plan, params)
    }
}

/// The plan with nothing but the main pass's entry points in its program: what else the author's file has may be called as ours are.
fn alone(plan: &Plan) -> Plan {
    let mut plan = plan.clone();
    let Some((pass, program)) = plan
        .main()
        .and_then(|p| Some((p.clone(), plan.program(p)?)))
    else {
        return plan;
    };
    let stages = [
        (ShaderStage::Vertex, Some(pass.vertex.as_str())),
        (ShaderStage::Fragment, pass.fragment.as_deref()),
    ];
    let kept: Vec<(ShaderStage, &str)> = stages
        .into_iter()
        .filter_map(|(stage, name)| Some((stage, name?)))
        .collect();
    // A program that was valid is so with less in it.
    if let Ok(program) = program.with_module(place::retain(program.module(), &kept)) {
        plan.programs.insert(pass.program, program);
    }
    plan
}

fn refuse(code: &str, reason: impl Into<String>, remedy: &str) -> Refusal {
    Refusal::new(VisibilityBuffer::INFO.name, code, reason.into(), remedy)
}

/// A material that can be split.
struct Material<'a> {
    opaque: Opaque<'a>,
    depth: DepthOnly,
    fragment: usize,
}

impl<'a> Material<'a> {
    fn examine(plan: &'a Plan, params: &Params) -> Result<Self, Vec<Refusal>> {
        let opaque = Opaque::examine(plan, VisibilityBuffer::INFO.name)?;
        let mut refusals = Vec::new();
        refusals.extend(legal::state(plan, opaque.pass));
        refusals.extend(legal::vertex(&opaque));
        let Some(fragment) = opaque.fragment else {
            refusals.push(refuse(
                "no-fragment-stage",
                "the material draws depth alone: there is nothing to shade later",
                "leave it as it is",
            ));
            return Err(refusals);
        };
        refusals.extend(legal::fragment(&opaque, fragment));
        if !refusals.is_empty() {
            return Err(refusals);
        }
        Ok(Self {
            depth: depth_only::slice(&opaque, params.vertex(&opaque)),
            opaque,
            fragment,
        })
    }

    fn site(&self, params: &Params) -> Site {
        let graph = &self.opaque.graph;
        let depth = self.depth.site(&self.opaque, self.describe(params));
        Site {
            cost: SiteCost {
                slice: 3.0 * graph.entry_cost(self.opaque.vertex) + graph.entry_cost(self.fragment),
                ..depth.cost
            },
            ..depth
        }
    }

    fn describe(&self, params: &Params) -> String {
        let triangles = match params.ids {
            Ids::PrimitiveIndex => "by primitive_index",
            Ids::Unindexed => "by vertices of their own",
        };
        let covers = match self.opaque.decides.anything() {
            true => " and what decides coverage",
            false => "",
        };
        let vertex = match params.vertex(&self.opaque) {
            VertexStage::Same => "the author's vertex stage",
            VertexStage::Sliced => "position",
        };
        let over = match Lists::of(params) {
            Lists::None => "a full-screen resolve",
            Lists::Quads | Lists::Groups => "a resolve of the tiles that show the draw",
            Lists::Bins => "a resolve of the draw's pixels, sorted by instance,",
        };
        format!(
            "an id pass of {vertex}{covers}, triangles {triangles}; {over} that runs the vertex stage for three corners and the fragment stage once a pixel"
        )
    }

    fn apply(&self, plan: &Plan, params: &Params) -> Result<Plan, Box<Refusal>> {
        let bug = |why: String| Box::new(Refusal::bug(VisibilityBuffer::INFO.name, why));
        if params.budget.is_some_and(|b| !(0.0..=1.0).contains(&b)) {
            return Err(Box::new(refuse(
                "budget",
                "the budget is the largest difference of a channel, which lies between 0 and 1",
                "give budget=0.01, say",
            )));
        }
        let slots = slots(self.opaque.program);
        let mut next = plan.clone();
        next.passes.clear();
        next.programs.clear();
        next.attachments.push(Attachment {
            name: IDS.to_owned(),
            format: params.words.format(),
            samples: 1,
            sampled: true,
            clear: ClearValue::Color([0.0; 4]),
        });
        self.ids(&mut next, params, slots).map_err(bug)?;
        if (params.form, params.select) == (Form::Fragment, Select::Depth) {
            self.classify(&mut next, params).map_err(bug)?;
        }
        let lists = Lists::of(params);
        lists
            .add(&mut next, self.opaque.program, params.words)
            .map_err(bug)?;
        match params.form {
            Form::Fragment => self.resolve(&mut next, params, slots)?,
            Form::Compute | Form::Binned => self.compute(&mut next, params, slots)?,
        }
        let k = self.site(params).cost.slice.ceil() as u32;
        let reached = self.reached(params)?;
        let given = self.assumptions(params, &reached);
        next.steps.push(Step {
            pass: VisibilityBuffer::INFO.name.to_owned(),
            site: self.depth.key(&self.opaque),
            params: serde_json::to_value(params).unwrap_or_default(),
            contract: match params.budget {
                None => Contract::Rounding { k, given },
                Some(budget) => Contract::Approximate {
                    metric: "max_abs".to_owned(),
                    budget,
                    given,
                },
            },
        });
        next.notes.push(self.describe(params));
        next.self_test = self_test::identified(&next, plan);
        depth_only::finish(&mut next, "original");
        Ok(next)
    }

    /// What the roundings of interpolated values reach; refused where it is a jump, and no budget allows for one.
    fn reached(&self, params: &Params) -> Result<Reached, Box<Refusal>> {
        let program = self.opaque.program;
        let (shaded, fragment) = resolve::shaded(program, self.fragment)
            .map_err(|why| Box::new(Refusal::bug(VisibilityBuffer::INFO.name, why)))?;
        let reached = jumps::reached(&shaded, fragment)
            .map_err(|why| refuse("too-large", why.to_string(), "leave it as it is"))?;
        match &reached.jump {
            Some((operation, span)) if params.budget.is_none() => Err(Box::new(
                refuse(
                    "discontinuous",
                    format!(
                        "what is interpolated reaches {operation}, which may make any difference of a last bit, and a resolve's last bits are not a rasteriser's"
                    ),
                    "give budget=0.02, say, and let `verify` measure it",
                )
                .at(program.sources(), *span),
            )),
            _ => Ok(reached),
        }
    }

    /// What the promise rests on: that the id pass's depths and positions are those that the author's own pass would have, which the original's picture has and which
    /// materials that are not split are tested against.
    fn assumptions(&self, params: &Params, reached: &Reached) -> Vec<Assumption> {
        let mut given = params.invariant(&self.opaque).assumptions(&self.opaque);
        given.extend(reached.samples.then_some(Assumption::FilteredTextures));
        given.extend([
            // The resolve runs the vertex stage in another stage.
            Assumption::StagesAgree,
            Assumption::SameViewport,
            Assumption::SameDrawOrder,
            Assumption::OrdinaryNeighbours,
        ]);
        given.extend(self.opaque.assumptions());
        given.sort();
        given
    }

    /// Adds the id pass.
    fn ids(&self, plan: &mut Plan, params: &Params, slots: Slots) -> Result<(), String> {
        let opaque = &self.opaque;
        let invariance = params.invariant(opaque).position();
        let placed = self.depth.place(opaque, "ids", invariance, None);
        let vertex = placed
            .module
            .entry_points
            .iter()
            .find(|e| e.stage == ShaderStage::Vertex && e.name == placed.vertex)
            .ok_or("there is no depth-only vertex stage")?;
        let inputs = reflect::inputs(&placed.module, &vertex.function);
        let attributes: Vec<_> = opaque
            .pass
            .attributes
            .iter()
            .filter(|a| {
                inputs.iter().any(|i| {
                    matches!(i.binding, Some(Binding::Location { location, .. }) if location == a.location)
                })
            })
            .cloned()
            .collect();
        let (triangles, geometry) = match params.ids {
            Ids::PrimitiveIndex => (Triangles::PrimitiveIndex, Geometry::AsGiven),
            Ids::Unindexed => (
                Triangles::Unindexed(&attributes, params.formats),
                Geometry::Unindexed,
            ),
        };
        let module = ids::add(
            placed.module.clone(),
            &placed.vertex,
            placed.fragment.as_deref(),
            &triangles,
            slots,
            (params.words, legal::facing(opaque, self.fragment)),
        )?;
        let entries = [
            (ShaderStage::Vertex, ids::VERTEX),
            (ShaderStage::Fragment, ids::FRAGMENT),
        ];
        let program = opaque
            .program
            .with_module(place::retain(&module, &entries))
            .map_err(|e| e.to_string())?;
        let streams = match params.ids {
            Ids::PrimitiveIndex => Vec::new(),
            Ids::Unindexed => attributes,
        };
        let mut bindings = parts(slots, &streams, params.formats);
        bindings.extend(opaque.pass.bindings.iter().cloned());
        let mut pass = GpuPass {
            role: Role::Ids,
            phase: Phase::Depth,
            program: Role::Ids.name().to_owned(),
            vertex: ids::VERTEX.to_owned(),
            fragment: Some(ids::FRAGMENT.to_owned()),
            targets: vec![Some(ColorTarget {
                attachment: Some(IDS.to_owned()),
                ..ColorTarget::opaque(params.words.color())
            })],
            bindings,
            attributes: Vec::new(),
            draws: Draws::Opaque,
            geometry,
            ..opaque.pass.clone()
        };
        reflect::fill(&mut pass, &program);
        plan.passes.push(pass);
        plan.programs.insert(Role::Ids.name().to_owned(), program);
        Ok(())
    }

    /// Adds the pass that tells the draws of a frame apart, the same one for every material.
    fn classify(&self, plan: &mut Plan, params: &Params) -> Result<(), String> {
        let module = Linked::new(naga::Module::default(), &text::classify(params.words))?.module;
        let program = self
            .opaque
            .program
            .with_module(module)
            .map_err(|e| e.to_string())?;
        let binding = |binding, source| BindingUse {
            group: 0,
            binding,
            name: String::new(),
            kind: BindingKind::StorageRead,
            visibility: Visibility::default(),
            source,
            layout: None,
        };
        let ids = BindingSource::Attachment {
            name: IDS.to_owned(),
        };
        let table = BindingSource::Geometry {
            part: GeometryPart::DrawTable,
        };
        let mut pass = GpuPass {
            role: Role::Classify,
            phase: Phase::Classify,
            program: Role::Classify.name().to_owned(),
            vertex: "vs_classify".to_owned(),
            fragment: Some("fs_classify".to_owned()),
            depth: Some(DepthState {
                attachment: DRAWS.to_owned(),
                compare: CompareFunction::Always,
                write: true,
                bias: DepthBias::default(),
                read_only: false,
                ops: AttachmentOps::default(),
                stencil_ops: None,
            }),
            targets: Vec::new(),
            bindings: vec![
                binding(text::CLASSIFY_IDS, ids),
                binding(text::CLASSIFY_TABLE, table),
            ],
            draws: Draws::Once,
            ..self.full_screen()
        };
        reflect::fill(&mut pass, &program);
        plan.attachments.push(Attachment {
            name: DRAWS.to_owned(),
            format: AttachmentFormat::Depth(DepthFormat::Depth16unorm),
            samples: 1,
            sampled: false,
            // No draw's number: they begin at 1.
            clear: ClearValue::Depth(0.0),
        });
        plan.passes.push(pass);
        plan.programs
            .insert(Role::Classify.name().to_owned(), program);
        Ok(())
    }

    /// A pass over the screen, its stages and bindings not filled in.
    fn full_screen(&self) -> GpuPass {
        GpuPass {
            primitive: PrimitiveState {
                topology: Topology::TriangleList,
                cull: CullMode::None,
                ..PrimitiveState::default()
            },
            depth: None,
            stencil: None,
            attributes: Vec::new(),
            geometry: Geometry::FullScreen,
            ..self.opaque.pass.clone()
        }
    }

    /// The stage that resolves.
    fn resolved(&self, params: &Params, slots: Slots, runs: Runs) -> Result<Built, Box<Refusal>> {
        let bug = |why: String| Box::new(Refusal::bug(VisibilityBuffer::INFO.name, why));
        let opaque = &self.opaque;
        let (shaded, fragment) = resolve::shaded(opaque.program, self.fragment).map_err(bug)?;
        let explicit = gradients::explicit(&shaded, fragment).map_err(|failed| match failed {
            Failed::Bug(why) => bug(why),
            Failed::Refused(code, reason, span) => Box::new(
                refuse(code, reason, "sample with gradients or a level of your own")
                    .at(opaque.program.sources(), span),
            ),
        })?;
        Resolve {
            explicit,
            fragment,
            vertex: opaque.vertex,
            attributes: &opaque.pass.attributes,
            facing: legal::facing(opaque, self.fragment),
            select: params.select(),
            runs,
            formats: params.formats,
            words: params.words,
            corners: params.corners,
            lists: Lists::of(params),
        }
        .build(slots)
        .map_err(bug)
    }

    /// Adds the compute pass that resolves, and the pass that clears what it writes to.
    fn compute(&self, plan: &mut Plan, params: &Params, slots: Slots) -> Result<(), Box<Refusal>> {
        let bug = |why: String| Box::new(Refusal::bug(VisibilityBuffer::INFO.name, why));
        let pass = self.opaque.pass;
        let targets = legal::stored(pass)?;
        let built = self.resolved(params, slots, Runs::Compute(targets.clone()))?;
        let entries = [(ShaderStage::Compute, resolve::COMPUTE)];
        let with = |module: &naga::Module, entries: &[(ShaderStage, &str)]| {
            let module = place::retain(module, entries);
            let program = self.opaque.program.with_module(module);
            program.map_err(|e| bug(e.to_string()))
        };
        let program = with(&built.module, &entries)?;
        let mut known = parts(slots, &built.attributes, params.formats);
        let first = slots.first + Slots::STREAMS + built.attributes.len() as u32;
        known.extend((first..).zip(&targets).map(|(binding, target)| BindingUse {
            group: slots.group,
            binding,
            name: String::new(),
            kind: BindingKind::StorageTexture,
            visibility: Visibility::default(),
            source: BindingSource::SceneColor {
                location: target.location,
            },
            layout: None,
        }));
        let lists = Lists::of(params);
        known.extend(lists.bindings(slots.group, first + targets.len() as u32));
        known.extend(pass.bindings.iter().cloned());
        let mut resolve = ComputePass {
            program: Role::Resolve.name().to_owned(),
            entry_point: resolve::COMPUTE.to_owned(),
            when: When::Behind {
                phase: Phase::Resolve,
            },
            workgroup: resolve::WORKGROUP,
            geometry: lists.geometry(),
            draws: Draws::Opaque,
            bindings: known,
            features: Vec::new(),
            limits: BTreeMap::new(),
        };
        reflect::fill_compute(&mut resolve, &program);
        plan.compute.push(resolve);
        plan.programs
            .insert(Role::Resolve.name().to_owned(), program);
        let locations: Vec<u32> = targets.iter().map(|t| t.location).collect();
        let cleared =
            Linked::new(naga::Module::default(), &text::clear(&locations)).map_err(bug)?;
        let entries = [
            (ShaderStage::Vertex, "vs_clear"),
            (ShaderStage::Fragment, "fs_clear"),
        ];
        let program = with(&cleared.module, &entries)?;
        let mut clear = GpuPass {
            role: Role::Clear,
            phase: Phase::Classify,
            program: Role::Clear.name().to_owned(),
            vertex: "vs_clear".to_owned(),
            fragment: Some("fs_clear".to_owned()),
            draws: Draws::Once,
            bindings: Vec::new(),
            ..self.full_screen()
        };
        for target in clear.targets.iter_mut().flatten() {
            target.write_mask = 0;
        }
        reflect::fill(&mut clear, &program);
        plan.passes.push(clear);
        plan.programs.insert(Role::Clear.name().to_owned(), program);
        Ok(())
    }

    /// Adds the resolve pass.
    fn resolve(&self, plan: &mut Plan, params: &Params, slots: Slots) -> Result<(), Box<Refusal>> {
        let bug = |why: String| Box::new(Refusal::bug(VisibilityBuffer::INFO.name, why));
        let opaque = &self.opaque;
        let built = self.resolved(params, slots, Runs::Fragment)?;
        let entries = [
            (ShaderStage::Vertex, resolve::VERTEX),
            (ShaderStage::Fragment, resolve::FRAGMENT),
        ];
        let program = opaque
            .program
            .with_module(place::retain(&built.module, &entries))
            .map_err(|e| bug(e.to_string()))?;
        let lists = Lists::of(params);
        let mut bindings = parts(slots, &built.attributes, params.formats);
        let first = slots.first + Slots::STREAMS + built.attributes.len() as u32;
        bindings.extend(lists.bindings(slots.group, first));
        bindings.extend(opaque.pass.bindings.iter().cloned());
        let mut pass = GpuPass {
            role: Role::Resolve,
            phase: Phase::Resolve,
            program: Role::Resolve.name().to_owned(),
            vertex: resolve::VERTEX.to_owned(),
            fragment: Some(resolve::FRAGMENT.to_owned()),
            depth: (params.select() == Select::Depth).then(|| DepthState {
                attachment: DRAWS.to_owned(),
                compare: CompareFunction::Equal,
                write: false,
                bias: DepthBias::default(),
                read_only: false,
                ops: AttachmentOps::default(),
                stencil_ops: None,
            }),
            bindings,
            draws: Draws::Opaque,
            geometry: lists.geometry(),
            ..self.full_screen()
        };
        for target in pass.targets.iter_mut().flatten() {
            target.ops = AttachmentOps::default();
        }
        reflect::fill(&mut pass, &program);
        plan.passes.push(pass);
        plan.programs
            .insert(Role::Resolve.name().to_owned(), program);
        Ok(())
    }
}
