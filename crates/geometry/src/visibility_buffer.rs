//! `visibility-buffer`: draws which triangle each pixel shows, then shades each pixel once.
//!
//! Goal: run the fragment stage once for each covered pixel, independent of depth complexity and
//! draw order (Burns and Hunt, "The Visibility Buffer: A Cache-Friendly Approach to Deferred
//! Shading", JCGT 2013; Sidorkin, "A faster renderer that wasn't faster", builds one by hand for
//! grass).
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
//! The resolve reconstructs everything that the rasteriser provided:
//!
//! - barycentrics from homogeneous edge functions, which also work for triangles that reach behind
//!   the viewer;
//! - each varying by its own interpolation;
//! - gradients as differences between pixels of the quad on the same triangle;
//! - facing from a bit of the id.

use preshade_dataflow::graph::Graph;
use preshade_dataflow::slice::{self, Criterion, OutputFilter, Slice};
use preshade_passes::analysis::implicit_inputs::PassEffect;
use preshade_passes::analysis::opaque::Opaque;
use preshade_passes::analysis::{refusals as shared, subnormal};
use preshade_passes::rebuild::depth_only::{self, DepthOnly, Invariance, VertexStage};
use preshade_passes::rebuild::{depth_pass, place};
use preshade_plan::budget::Budget;
use preshade_plan::contract::{Assumption, Contract, Surface, Turned};
use preshade_plan::draw_table::IDS;
use preshade_plan::pass::{
    Example, Expected, Facts, Outcome, Pass, PassInfo, Refusal, Refused, Use,
};
use preshade_plan::plan::{Attachment, Change, GpuPass, Plan, Role, SiteCost};
use preshade_plan::rasterizer::Rasterizer;
use preshade_plan::self_test;
use shader_text::refusals::RefusalInfo;

mod binding_sources;
mod build;
mod count;
mod differences;
mod gradients;
mod ids;
mod legal;
mod lists;
mod names;
mod params;
pub mod refusals;
mod resolve;
mod stage;
mod stored_vertices;
mod text;

use binding_sources::slots;
pub use count::counted;
use differences::Reached;
use gradients::Shaded;
use lists::Lists;
pub use params::{Ids, Select, ShadingForm, Vertices, VisibilityParams};

pub(crate) struct VisibilityBuffer;

impl Pass for VisibilityBuffer {
    type Params = VisibilityParams;

    const INFO: PassInfo = PassInfo {
        name: "visibility-buffer",
        summary: "draws which triangle each pixel shows, then shades each pixel once",
        source: "Burns and Hunt, The Visibility Buffer (JCGT 2013)",
        when: "a pixel is covered many times by small triangles (grass, crowds, foliage), cut-outs \
               keep the early test from helping, and the host can bind vertices as storage \
               buffers; else a depth-prepass is simpler and mostly as fast",
        hurts: "where little is hidden or vertices are expensive: each shaded pixel fetches and \
                runs three vertices; and where neighbouring pixels show far-apart instances, whose \
                data no cache holds",
        reads_scene: true,
    };

    const REFUSALS: &'static [RefusalInfo] = refusals::REFUSALS;

    const EXAMPLES: &'static [Example] = &[
        Example {
            recipe: "visibility-buffer",
            uses: &[Use::Validate, Use::Plan],
        },
        Example {
            recipe: "visibility-buffer:budget=1",
            uses: &[Use::Cover, Use::Fuzz, Use::Growth, Use::Mutate],
        },
        Example {
            recipe: "visibility-buffer:form=compute,budget=1",
            uses: &[Use::Cover, Use::Fuzz, Use::Mutate],
        },
        Example {
            recipe: "visibility-buffer:ids=unindexed,words=one,select=id,budget=1",
            uses: &[Use::Mutate],
        },
        Example {
            recipe: "visibility-buffer:ids=unindexed,form=compute,budget=1",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "visibility-buffer:select=tiles,budget=1",
            uses: &[Use::Compile, Use::Mutate],
        },
        Example {
            recipe: "visibility-buffer:select=tiles,form=compute,budget=1",
            uses: &[Use::Mutate],
        },
        Example {
            recipe: "visibility-buffer:form=binned,budget=1",
            uses: &[Use::Mutate],
        },
        Example {
            recipe: "visibility-buffer:form=binned,words=one,corners=snapped,budget=1",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "visibility-buffer:vertices=kept,select=id,formats=any,budget=1",
            uses: &[Use::Mutate],
        },
        Example {
            recipe: "visibility-buffer:formats=any,budget=1",
            uses: &[Use::Compile],
        },
        Example {
            recipe: "visibility-buffer:budget=0.1",
            uses: &[Use::Pictures(1)],
        },
        Example {
            recipe: "visibility-buffer:budget=0.05",
            uses: &[Use::Page("pages/leaf")],
        },
        Example {
            recipe: "visibility-buffer:select=id,budget=0.05",
            uses: &[Use::Picture {
                scene: "fixtures/scenes/grass.toml --size 256x144 --frames 1 --order \
                        front-to-back --set instances=20000",
                caption: "a meadow: each pixel is shaded once, after it is known which blade it \
                          shows",
                rows: 2,
            }],
        },
        Example {
            recipe: "visibility-buffer:budget=MOST",
            uses: &[Use::PlanWithin],
        },
        Example {
            recipe: "visibility-buffer:select=id,budget=MOST",
            uses: &[Use::PlanWithin],
        },
        Example {
            recipe: "visibility-buffer:form=compute,budget=MOST",
            uses: &[Use::PlanWithin],
        },
    ];

    fn expected(_params: &VisibilityParams) -> Expected {
        Expected {
            replaces_varyings: true,
            ..Expected::default()
        }
    }

    fn run(plan: &Plan, facts: &Facts, params: &VisibilityParams) -> Result<Outcome, Refused> {
        let params = &params.resolved(facts)?;
        let plan = alone(plan);
        let material = SplitMaterial::examine(&plan, facts, params)?;
        let next = material.apply(&plan, params)?;
        Ok(Outcome {
            plan: next,
            change: material.change(params),
            left: Vec::new(),
        })
    }
}

/// A message if a plan's resolves assume a different rasteriser from the measured one. `None` if
/// they agree, or the plan has no resolve.
pub fn contradicted(plan: &Plan, seen: &Rasterizer) -> Option<String> {
    let told: Vec<String> = params_of(plan)?
        .contradicting(seen)
        .into_iter()
        .map(|[said, seen]| format!("{said}, but the adapter was measured as `{seen}`"))
        .collect();
    (!told.is_empty()).then(|| told.join("; "))
}

/// The rasteriser whose behaviour a plan's resolves reproduce. `None` if the plan has no resolve.
pub fn assumed(plan: &Plan) -> Option<Rasterizer> {
    Some(params_of(plan)?.rasterizer())
}

/// The parameters that a plan was split with.
fn params_of(plan: &Plan) -> Option<VisibilityParams> {
    let steps = plan.steps.iter();
    let mut said = steps.filter(|s| s.pass == VisibilityBuffer::INFO.name);
    serde_json::from_value(said.next_back()?.params.clone()).ok()
}

/// The plan with a program of only the main pass's entry points, renamed so that generated names
/// are free.
fn alone(plan: &Plan) -> Plan {
    let mut plan = plan.clone();
    let Some((pass, program)) = plan
        .main()
        .and_then(|p| Some((p.clone(), plan.program(p)?)))
    else {
        return plan;
    };
    let mut module = place::retain(program.module(), &pass.stages());
    names::without_ours(&mut module);
    // Removing items keeps a program valid.
    if let Ok(program) = program.with_module(module) {
        plan.programs.insert(pass.program, program);
        for pass in plan.passes.iter_mut().filter(|p| p.role == Role::Main) {
            pass.vertex = names::given(&pass.vertex);
            pass.fragment = pass.fragment.as_deref().map(names::given);
        }
    }
    plan
}

fn refuse(code: &RefusalInfo, reason: impl Into<String>, remedy: &str) -> Refusal {
    Refusal::new(VisibilityBuffer::INFO.name, code, reason.into(), remedy)
}

/// A material that can be split.
struct SplitMaterial<'a> {
    opaque: Opaque<'a>,
    depth: DepthOnly,
    /// The slice of the fragment stage's colours.
    colors: Slice,
    /// The assumptions under which the id pass discards and positions as the author's stages do.
    given: Vec<Assumption>,
}

impl<'a> SplitMaterial<'a> {
    fn examine(
        plan: &'a Plan,
        facts: &Facts,
        params: &VisibilityParams,
    ) -> Result<Self, Vec<Refusal>> {
        let opaque = Opaque::examine(plan, VisibilityBuffer::INFO.name)?;
        let mut refusals = Vec::new();
        if !plan.compute.is_empty() {
            refusals.push(refuse(
                &shared::NOT_FIRST,
                "an earlier step already computes what the stages read",
                "take `visibility-buffer` without it",
            ));
        }
        refusals.extend(legal::state(plan, opaque.pass));
        refusals.extend(legal::vertex(&opaque));
        let Some(fragment) = opaque.fragment else {
            refusals.push(refuse(
                &shared::NO_FRAGMENT_STAGE,
                "the material draws only depth, so there is nothing to shade later",
                "leave it as it is",
            ));
            return Err(refusals);
        };
        let entry = &opaque.program.module().entry_points[fragment];
        let colors = resolve::colors_of(opaque.program.module(), &entry.function);
        if colors.is_empty() {
            refusals.push(refuse(
                &refusals::NO_COLOR,
                "the fragment stage writes no colour, so there is nothing to shade later",
                "leave it as it is",
            ));
            return Err(refusals);
        }
        let colors = slice::backward(&opaque.graph, fragment, &colors);
        // The resolve runs the vertex stage, and may be a compute stage.
        let elsewhere: &[usize] = match params.form {
            ShadingForm::Fragment => &[opaque.vertex],
            ShadingForm::Compute | ShadingForm::Binned => &[opaque.vertex, fragment],
        };
        let name = VisibilityBuffer::INFO.name;
        let checked = subnormal::check(name, plan, &opaque.graph, elsewhere, facts);
        refusals.extend(checked.err().map(|refusal| *refusal));
        let depths = match facts.narrow_depths.contains(&plan.material) {
            true => legal::DepthRange::Narrow,
            false => legal::DepthRange::Whole,
        };
        refusals.extend(legal::fragment(&opaque, &colors, depths));
        if !refusals.is_empty() {
            return Err(refusals);
        }
        let depth = depth_only::slice(&opaque, params.vertex(&opaque), &[]);
        let effects = [PassEffect::RejectsEarly, PassEffect::Slices];
        let given = depth.assumptions(&opaque, plan, VisibilityBuffer::INFO.name, &effects)?;
        Ok(Self {
            depth,
            given,
            opaque,
            colors,
        })
    }

    fn change(&self, params: &VisibilityParams) -> Change {
        let graph = &self.opaque.graph;
        let depth = self.depth.change(&self.opaque, self.describe(params));
        Change {
            cost: SiteCost {
                slice: 3.0 * graph.entry_cost(self.opaque.vertex)
                    + graph.entry_cost(self.colors.entry),
                ..depth.cost
            },
            ..depth
        }
    }

    fn describe(&self, params: &VisibilityParams) -> String {
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
        let corners = match params.vertices {
            Vertices::Refetched => "runs the vertex stage for three corners and",
            Vertices::Kept => "loads what a compute pass made of three corners and runs",
        };
        let over = match Lists::of(params) {
            Lists::None => "a full-screen resolve",
            Lists::Quads | Lists::Groups => "a resolve of the tiles that show the draw",
            Lists::Bins => "a resolve of the draw's pixels, sorted by instance,",
        };
        format!(
            "an id pass of {vertex}{covers}, triangles {triangles}; \
             {over} that {corners} the fragment stage once a pixel"
        )
    }

    fn apply(&self, plan: &Plan, params: &VisibilityParams) -> Result<Plan, Box<Refusal>> {
        let bug = |why: String| Box::new(Refusal::bug(VisibilityBuffer::INFO.name, why));
        if params.budget.is_some_and(|b| !(0.0..=1.0).contains(&b)) {
            return Err(Box::new(refuse(
                &preshade_plan::refusals::BUDGET,
                "the budget is the largest difference of a channel: a number from 0 to 1",
                "set budget=0.01, for example",
            )));
        }
        let slots = slots(self.opaque.program);
        let mut next = plan.clone();
        next.passes.clear();
        next.programs.clear();
        let ids = Attachment::color(IDS, params.words.color(), [0.0; 4]);
        next.attachments.push(ids);
        self.ids(&mut next, params, slots).map_err(bug)?;
        self.check_varyings(&next, params)?;
        if (params.form, params.select()) == (ShadingForm::Fragment, Select::Depth) {
            self.classify(&mut next, params).map_err(bug)?;
        }
        let lists = Lists::of(params);
        lists
            .add(&mut next, self.opaque.program, params.words)
            .map_err(bug)?;
        let program = resolve::shaded(&self.opaque.graph, &self.colors).map_err(bug)?;
        let graph = Graph::build(&program);
        let shaded = Shaded::new(&graph, self.colors.entry);
        match params.form {
            ShadingForm::Fragment => self.resolve(&mut next, &shaded, params, slots)?,
            ShadingForm::Compute | ShadingForm::Binned => {
                self.compute(&mut next, &shaded, params, slots)?
            }
        }
        for program in next.programs.values_mut() {
            if program.module().overrides.is_empty() {
                continue;
            }
            let mut module = program.module().clone();
            names::give_way_to_overrides(&mut module);
            *program = program
                .with_module(module)
                .map_err(|e| bug(e.to_string()))?;
        }
        let k = self.change(params).cost.slice.ceil() as u32;
        let reached = self.reached(&shaded, params)?;
        let given = self.assumptions(params, &reached);
        let contract = match params.budget {
            None => Contract::Rounding {
                k,
                turned: self.turned(params),
                given,
            },
            Some(budget) => Contract::Approximate {
                budget: Budget::max_abs(budget),
                given,
            },
        };
        let taken = params.of_taken(reached.interpolated, reached.taken);
        let name = VisibilityBuffer::INFO.name;
        next.steps
            .push(self.depth.step(&self.opaque, name, &taken, contract));
        next.notes.push(self.describe(params));
        next.self_test = self_test::identified(&next, plan);
        depth_pass::finish(&mut next, "original");
        Ok(next)
    }

    /// Refuses if the id makes the varyings exceed the author's limit, unless the user chose
    /// `vertex`.
    fn check_varyings(&self, plan: &Plan, params: &VisibilityParams) -> Result<(), Box<Refusal>> {
        const LIMIT: &str = "maxInterStageShaderVariables";
        let asked = |pass: &GpuPass| pass.limits.get(LIMIT).copied().unwrap_or(0);
        let Some(ids) = plan.passes.iter().find(|p| p.role == Role::Ids) else {
            return Ok(());
        };
        if params.vertex.is_some() || asked(ids) <= asked(self.opaque.pass) {
            return Ok(());
        }
        Err(Box::new(refuse(
            &refusals::TOO_MANY_VARYINGS,
            format!(
                "the id pass has the author's varyings and the id, {} in all, which is more than \
                 the material requires of a device ({LIMIT})",
                asked(ids)
            ),
            "mark the position @invariant; or set vertex=sliced, which needs only the id; \
             or set vertex=same if your devices have the limit",
        )))
    }

    /// The values that rasteriser and resolve round differently. Refused without a budget.
    fn reached(
        &self,
        shaded: &Shaded<'_, '_>,
        params: &VisibilityParams,
    ) -> Result<Reached, Box<Refusal>> {
        let values = shaded.values.as_ref();
        let values = values
            .map_err(|why| refuse(&shared::TOO_LARGE, why.to_string(), "leave it as it is"))?;
        let reached = differences::reached(values);
        let refusal = match params.budget {
            Some(_) => None,
            None => legal::rounding(&reached, self.opaque.program.sources()),
        };
        refusal.map_or(Ok(reached), |refusal| Err(Box::new(refusal)))
    }

    /// Whether the id pass has exactly the author's positions. Adding the id changes the vertex
    /// stage, and a driver may then fuse other operations unless the author's position is
    /// `@invariant`: an H200 moved 23 depths of displaced terrain by up to 2 ulp. The self-test is
    /// stricter than this promise, because unsplit materials are tested against these depths.
    fn surface(&self, params: &VisibilityParams) -> Surface {
        let is_marked = params.invariant(&self.opaque) == Invariance::Add;
        match self.opaque.has_invariant_position() || is_marked {
            true => Surface::Kept,
            false => Surface::Rounded,
        }
    }

    /// The decisions that other positions may change.
    fn turned(&self, params: &VisibilityParams) -> Option<Turned> {
        let surface = self.surface(params);
        let (graph, vertex) = (&self.opaque.graph, self.opaque.vertex);
        let position = [Criterion::Output(OutputFilter::Rasterization)];
        (surface == Surface::Rounded).then(|| {
            let roundings = slice::backward(graph, vertex, &position).cost.ceil();
            Turned::on(roundings as u32, surface)
        })
    }

    /// The assumptions of the plan. They include that the id pass's depths and positions equal
    /// those of the author's pass: the original's picture has them, and unsplit materials are
    /// tested against them.
    fn assumptions(&self, params: &VisibilityParams, reached: &Reached) -> Vec<Assumption> {
        let mut given = match self.surface(params) {
            Surface::Kept => params.invariant(&self.opaque).assumptions(&self.opaque),
            Surface::Rounded => Vec::new(),
        };
        let chosen = reached.taken.any();
        given.extend(chosen.then_some(Assumption::DerivativeNeighbours));
        let interpolated = reached.interpolated;
        given.extend(interpolated.then_some(Assumption::InterpolatedCorners));
        given.extend([
            // The resolve runs the vertex stage in another stage.
            Assumption::StagesAgree,
            Assumption::SameViewport,
            Assumption::SameDrawOrder,
            Assumption::OrdinaryNeighbours,
        ]);
        given.extend(self.given.iter().cloned());
        given.sort();
        given
    }
}
