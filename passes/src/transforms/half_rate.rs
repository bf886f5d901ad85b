//! `half-rate`: computes slow values for one pixel of each 2x2, and interpolates them along edges.
//!
//! Goal: ambient occlusion, light of many lamps, fog and reflections change slowly from pixel to pixel,
//! except at edges of the surfaces that they light. Computed for every fourth pixel they cost a quarter
//! (Kopf et al. 2007; Sloan et al. 2007; Yang et al. 2008).
//!
//! ```text
//! before:  main       fs(at):  ao = sum of 16 taps(depth[at]);      color = albedo[at] * ao
//!
//! after:   half-rate  fs(at):  ao = sum of 16 taps(depth[at]);      texel = ao, depth[at]
//!          main       fs(at):  ao = mean of the four nearest texels, those of like depth;  color = albedo[at] * ao
//! ```
//!
//! A texel stands for the pixel at twice its coordinates, exactly. The half-rate pass has a viewport that
//! puts its fragments' centres on those of these pixels. So varyings are interpolated there, and
//! `position.xy` is replaced by the pixel's. Loads at the pixel's coordinates and noise from them are those
//! of a real pixel. Only derivatives are twice as large, because a quad spans twice as many pixels: they are
//! halved, and implicit levels are one lower.
//!
//! The same geometry is drawn at half the rate, and a texel that it does not cover has no weight. A pixel
//! that is like none of its neighbours takes their mean. With `edges=computed` it computes the values
//! itself, unless they need derivatives, which a branch must not take. On a GPU that skips a branch only
//! where none of dozens of lanes takes it, few such pixels cost much; llvmpipe skips none.
//!
//! The values of one draw fill the attachments: draw the material once a frame, over the whole screen, as one instance.
//! The viewport has fractions of a pixel, which OpenGL and WebGL do not have: there, draw the original.
//!
//! A loop may end at a number in a uniform buffer. The plan then has a [guard](../guides/specialize.md#the-guard) for it.
//!
//! The contract is your budget.

use naga::ShaderStage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::implicit_inputs::{ImplicitInputs, PassEffect};
use crate::analysis::simplify::{self, FragmentStage};
use crate::analysis::values::{ValueId, Values, refuse_writes};
use crate::analysis::{refusals as shared, transitive_cost};
use crate::rebuild::moved::MovedValues;
use crate::rebuild::outline::{self, Wanted};
use preshade_dataflow::graph::FunctionId;
use preshade_plan::budget::{Budget, Metric};
use preshade_plan::pass::{Example, Facts, Left, Outcome, Pass, PassInfo, Refusal, Refused, Use};
use preshade_plan::plan::Plan;
use preshade_plan::state::{CompareFunction, StencilState};
use shader_text::refusals::RefusalInfo;

mod build;
pub mod refusals;
mod text;
mod values;

use text::Layout;
use values::{CarriedValues, NotHalved};

pub struct HalfRate;

/// The values of a pixel that is like none of its neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Edges {
    /// It takes the mean of its neighbours.
    #[default]
    Blended,
    /// It computes the values itself, where they need no derivative.
    Computed,
}

/// Parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct HalfRateParams {
    /// Largest allowed picture error by `metric`, above 0 and at most 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub budget: Option<f64>,
    /// The metric of the budget.
    pub metric: Metric,
    /// The values of a pixel that is like none of its neighbours.
    pub edges: Edges,
    /// The values that mark edges, by the author's names for them or their textures, joined by `+`; or
    /// `none`. Default: all that are loaded at the pixel itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guide: Option<String>,
    /// Least static cost that each pixel must save, in ops.
    #[schemars(range(min = 0.0))]
    pub least: f64,
}

impl Default for HalfRateParams {
    fn default() -> Self {
        Self {
            budget: None,
            metric: Metric::default(),
            edges: Edges::default(),
            guide: None,
            least: 32.0,
        }
    }
}

impl Pass for HalfRate {
    type Params = HalfRateParams;

    const INFO: PassInfo = PassInfo {
        name: "half-rate",
        summary: "computes slow values of a full-screen draw for one pixel of each 2x2, and \
                  interpolates them along edges, within a budget",
        source: "Kopf et al., Joint Bilateral Upsampling (2007); Yang, Sander and Lawrence, \
                 Geometry-Aware Framebuffer Level of Detail (2008)",
        when: "a full-screen draw computes something slow that changes little from pixel to pixel: \
               ambient occlusion, light of many lamps, fog, reflections",
        hurts: "where neighbouring pixels have little in common (foliage, noise), because they blur; \
                where the draw leaves parts of the screen out; and on cheap draws, which read four \
                texels instead",
        reads_scene: false,
    };

    const REFUSALS: &'static [RefusalInfo] = refusals::REFUSALS;

    const EXAMPLES: &'static [Example] = &[
        Example {
            recipe: "half-rate:budget=0.01",
            uses: &[
                Use::Page("shaders/deferred"),
                Use::Picture {
                    scene: "fixtures/scenes/deferred.toml --size 640x360 --frames 1",
                    caption: "a wall lit by two dozen lamps, with the light and the occlusion of \
                              every fourth pixel",
                    rows: 1,
                },
            ],
        },
        Example {
            recipe: "half-rate:BUDGET",
            uses: &[Use::PlanWithin, Use::Simplify],
        },
        Example {
            recipe: "half-rate:BUDGET,guide=none",
            uses: &[Use::PlanWithin],
        },
        Example {
            recipe: "half-rate:BUDGET,edges=computed",
            uses: &[Use::PlanWithin],
        },
    ];

    fn run(plan: &Plan, _facts: &Facts, params: &HalfRateParams) -> Result<Outcome, Refused> {
        let stage = examine(plan)?;
        let values = Values::examine(&stage.graph, stage.entry, Self::INFO.name)?;
        let halved = HalvedValues::new(&stage, &values, params)?;
        let Some(limit) = params.budget else {
            return Err(halved.moved.refused(*refuse(
                &shared::NO_BUDGET,
                "values at half the rate change the picture, and there is no budget",
                "set budget=0.01 (of flip_mean, or with metric=max_abs)",
            )));
        };
        let built = halved
            .rebuild()
            .map_err(|why| halved.moved.refused(why.refusal(Self::INFO.name)))?;
        let inputs = ImplicitInputs::new(plan, stage.pass, &stage.graph).replaced_by(&built.main);
        inputs.examine(Self::INFO.name, &[PassEffect::RemovesInputs])?;
        let budget = Budget {
            metric: params.metric,
            limit,
        };
        Ok(halved.outcome(plan, built, params, budget))
    }
}

fn refuse(
    code: &RefusalInfo,
    reason: impl Into<String>,
    remedy: impl Into<String>,
) -> Box<Refusal> {
    Box::new(Refusal::new(HalfRate::INFO.name, code, reason, remedy))
}

/// The stage of a draw whose values may come from another pass of the same geometry.
fn examine(plan: &Plan) -> Result<FragmentStage<'_>, Refused> {
    let stage = simplify::examine(
        plan,
        HalfRate::INFO.name,
        "take `half-rate` behind the passes that change the fragment stage, and ahead of none",
        "there is nothing to compute at half the rate",
    )?;
    let pass = stage.pass;
    let mut found = Vec::new();
    let mut told = |code, reason: &str, remedy: &str| found.push(*refuse(code, reason, remedy));
    let depth = pass.depth.as_ref();
    if depth.is_some_and(|d| d.write || d.compare != CompareFunction::Always) {
        let remedy = "if it covers the screen, draw it without depth: `--depth-compare always \
                      --no-depth-write`, or `depth_compare = \"always\"` and `depth_write = false` in \
                      a scene";
        told(
            &refusals::DEPTH_TEST,
            "the material tests or writes depth",
            remedy,
        );
    }
    let is_tested = |s: &StencilState| {
        let faces = [s.front, s.back];
        s.writes() || faces.iter().any(|f| f.compare != CompareFunction::Always)
    };
    if pass.stencil.as_ref().is_some_and(is_tested) {
        let remedy = "mask by `discard`";
        told(
            &refusals::HALF_RATE_STENCIL,
            "the material tests or writes stencil",
            remedy,
        );
    }
    if !pass.primitive.topology.is_triangles() {
        let reason = "a point or a line of one pixel may lie between the texels";
        told(&shared::TOPOLOGY, reason, "draw triangles");
    }
    if pass.multisample.count > 1 {
        let reason = "the material is drawn with several samples a pixel";
        told(
            &refusals::HALF_RATE_SAMPLES,
            reason,
            "draw it with one sample",
        );
    }
    let vertex = stage
        .graph
        .program()
        .entry_point(ShaderStage::Vertex, &pass.vertex);
    found.extend(refuse_writes(
        &stage.graph,
        stage.entry,
        HalfRate::INFO.name,
    ));
    let writes = |entry| stage.graph.writes_memory(FunctionId::EntryPoint(entry));
    if vertex.is_some_and(|(entry, _)| writes(entry)) {
        let reason = "the vertex stage writes memory, and it would run twice";
        let remedy = "move the writes to a compute pass";
        found.push(*refuse(&shared::VERTEX_STORE, reason, remedy));
    }
    match found.is_empty() {
        true => Ok(stage),
        false => Err(found.into()),
    }
}

/// A value in a texel.
struct Carried {
    width: u8,
}

/// The values that are computed at half the rate.
struct HalvedValues<'v, 'g, 'p> {
    stage: &'v FragmentStage<'p>,
    moved: MovedValues<'v, 'g, 'p>,
    choice: CarriedValues,
    guides: Vec<Wanted>,
    layout: Layout,
    edges: Edges,
}

impl<'v, 'g, 'p> HalvedValues<'v, 'g, 'p> {
    fn new(
        stage: &'v FragmentStage<'p>,
        values: &'v Values<'g, 'p>,
        params: &HalfRateParams,
    ) -> Result<Self, (Box<Refusal>, Vec<Left>)> {
        let verdicts = values::judge(values);
        let named = |id: ValueId| values::guide_name(values, id);
        let asked = params.guide.as_deref();
        let is_guide =
            |id: ValueId| asked.is_none_or(|all| all.split('+').any(|one| one.trim() == named(id)));
        let choice = values::choose(values, &verdicts, params.least, &is_guide);
        let left = transitive_cost::left(values, MOST_LEFT, |id| match verdicts[id] {
            Ok(()) => Some("it saves too little".to_owned()),
            Err(NotHalved::Uniform | NotHalved::Shape | NotHalved::Cheap) => None,
            Err(stays) => Some(stays.to_string()),
        });
        let Some(choice) = choice else {
            let reason = format!(
                "no value that may be computed at half the rate saves {} ops",
                params.least
            );
            let refusal = refuse(
                &refusals::NOTHING_AT_HALF_RATE,
                reason,
                "`preshade explain` lists the values that stay, and why",
            );
            return Err((refusal, left));
        };
        if let Some(all) = asked.filter(|a| *a != "none")
            && choice.guides.len() < all.split('+').count()
        {
            let any = values::choose(values, &verdicts, params.least, &|_| true);
            let known = any.map_or_else(Vec::new, |c| c.guides);
            let known: Vec<String> = known.into_iter().map(named).collect();
            let reason = format!("`guide={all}` names a value that cannot guide");
            let remedy = match known.is_empty() {
                true => "no value can: leave it out, or give `guide=none`".to_owned(),
                false => format!("these can: {}", known.join(", ")),
            };
            return Err((refuse(&refusals::NO_GUIDE, reason, remedy), left));
        }
        let guides = outline::wanted(values, choice.guides.iter().copied(), "guide");
        let carried = |ids: &[ValueId]| -> Vec<Carried> {
            let widths = ids.iter().filter_map(|id| values::width(values, *id));
            widths.map(|width| Carried { width }).collect()
        };
        let layout = Layout::of(&carried(&choice.moved), &carried(&choice.guides));
        Ok(Self {
            stage,
            moved: MovedValues::new(values, choice.moved.clone(), "carried", left),
            choice,
            guides,
            layout,
            edges: params.edges,
        })
    }
}

/// Most values to report.
const MOST_LEFT: usize = 100;
