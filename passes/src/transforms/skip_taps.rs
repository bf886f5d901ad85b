//! `skip-taps`: skips texture samples whose weight is close to 0.
//!
//! Goal: hex tiling blends three copies of a texture, triplanar mapping three sides, terrain its
//! layers. At most fragments one or two weights are close to 0, and the shader samples the texture
//! all the same.
//!
//! ```text
//! before:  let rough = w.x * textureSample(map, s, a).g + w.y * textureSample(map, s, b).g;
//!
//! after:   let a_dx = dpdxCoarse(a); ..
//!          var tap = 0.0;  if abs(w.x) > 0.02 { tap = textureSampleGrad(map, s, a, a_dx, a_dy).g; }
//!          var tap_1 = 0.0;  if abs(w.y) > 0.02 { tap_1 = textureSampleGrad(map, s, b, b_dx, b_dy).g; }
//!          let rough = w.x * tap + w.y * tap_1;
//! ```
//!
//! A *term* is a product with a weight in a sum: `w * x`, `mix(x, y, w)`, `fma(w, x, y)`, a
//! component of `dot(vec3(x, y, z), w)`. It can be skipped if `x` contains a sample and has no
//! other reader. Then everything that only `x` needs moves behind the branch, including calls
//! ([`find`], [`branch`]). The weights are not normalised again: a skipped term is missing, by at
//! most the threshold times its size.
//!
//! An implicit-LOD sample reads its neighbours in the quad, which may skip it. So we evaluate its
//! gradients first, at the author's place. Some adapters round the level of detail from gradients
//! differently, so the contract is a budget even with `threshold=0`. Samples with an explicit level or
//! gradients keep them. With `threshold=0` and no implicit sample, only products with 0 are skipped:
//! the same sum for finite samples, up to a compiler's rounding ([`contraction`]). A term stays if it
//! may be infinite or NaN, or if something depends on the sign of a zero that its sum has without it
//! (`1 / x`, `atan2`): [`crate::analysis::zero`].
//!
//! Samples that decide a discard, depth or coverage are not skipped, nor samples in a function that
//! the vertex stage also runs.

use std::collections::BTreeSet;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::simplify::{self, FragmentStage, Simplified};
use crate::analysis::zero::ZeroEffect;
use crate::analysis::{contraction, refusals as shared};
use preshade_dataflow::graph::Graph;
use preshade_plan::budget::{Budget, Metric};
use preshade_plan::contract::{Assumption, Contract, Turned};
use preshade_plan::pass::{Example, Facts, Outcome, Pass, PassInfo, Refusal, Refused, Use};
use preshade_plan::plan::{GpuPass, Plan, SiteCost};
use preshade_plan::program::Program;
use shader_text::refusals::RefusalInfo;

pub mod branch;
pub mod find;
pub mod refusals;

use find::{Term, Terms};

pub struct SkipTaps;

/// Parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct SkipTapsParams {
    /// Largest magnitude of a weight whose term is skipped.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub threshold: f64,
    /// Functions whose terms to skip, joined by `+`. Default: the fragment stage and all its
    /// callees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub of: Option<String>,
    /// Largest allowed picture error by `metric`, above 0 and at most 1. Not needed with
    /// `threshold=0` if no term has an implicit-LOD sample.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub budget: Option<f64>,
    /// The metric of the budget.
    pub metric: Metric,
}

impl Default for SkipTapsParams {
    fn default() -> Self {
        Self {
            threshold: 0.02,
            of: None,
            budget: None,
            metric: Metric::default(),
        }
    }
}

impl Pass for SkipTaps {
    type Params = SkipTapsParams;

    const INFO: PassInfo = PassInfo {
        name: "skip-taps",
        summary: "leaves out texture taps whose blend weight is next to nothing, within a budget",
        source: "Heitz and Neyret, High-Performance By-Example Noise (2018), and Mikkelsen, \
                 Practical Real-Time Hex-Tiling (2022), for the blends; \
                 Golus, Normal Mapping for a Triplanar Shader (2017), for the branch",
        when: "textures are blended by weights that are mostly next to 0: hex tiling, triplanar \
               mapping, layers of a terrain",
        hurts: "where weights are seldom small, or differ from pixel to pixel: lanes that sample \
                wait for nobody, but those that do not wait for them",
        reads_scene: true,
    };

    const REFUSALS: &'static [RefusalInfo] = refusals::REFUSALS;

    const EXAMPLES: &'static [Example] = &[
        Example {
            recipe: "skip-taps:budget=1",
            uses: &[Use::Snapshot],
        },
        Example {
            recipe: "skip-taps:threshold=0,budget=0.01",
            uses: &[Use::Pictures(1)],
        },
        Example {
            recipe: "skip-taps:budget=0.1,threshold=0.02",
            uses: &[Use::Truth],
        },
        Example {
            recipe: "skip-taps:budget=0.01",
            uses: &[
                Use::Page("pages/rock"),
                Use::Picture {
                    scene: "fixtures/scenes/terrain-triplanar.toml --camera slope --size 256x144 \
                            --frames 1",
                    caption: "a slope between two sides of its texture: off by two steps at most \
                              where a third one was left out",
                    rows: 1,
                },
            ],
        },
        Example {
            recipe: "skip-taps:threshold=0",
            uses: &[Use::Plan],
        },
        Example {
            recipe: "skip-taps:BUDGET",
            uses: &[Use::PlanWithin],
        },
        Example {
            recipe: "skip-taps:BUDGET,depth-prepass",
            uses: &[Use::PlanWithin],
        },
        Example {
            recipe: "skip-taps:BUDGET,threshold=0",
            uses: &[Use::Simplify],
        },
        Example {
            recipe: "skip-taps:BUDGET,threshold=0.01",
            uses: &[Use::Simplify],
        },
        Example {
            recipe: "skip-taps:BUDGET,threshold=0.05",
            uses: &[Use::Simplify],
        },
        Example {
            recipe: "skip-taps:BUDGET,threshold=0.15",
            uses: &[Use::Simplify],
        },
    ];

    fn run(plan: &Plan, facts: &Facts, params: &SkipTapsParams) -> Result<Outcome, Refused> {
        Ok(skipped(plan, facts, params)?.outcome(plan, Self::INFO.name, params))
    }
}

fn refuse(
    code: &RefusalInfo,
    reason: impl Into<String>,
    remedy: impl Into<String>,
) -> Box<Refusal> {
    Box::new(Refusal::new(SkipTaps::INFO.name, code, reason, remedy))
}

/// A material's main pass with its samples behind branches.
fn skipped(plan: &Plan, facts: &Facts, params: &SkipTapsParams) -> Result<Simplified, Refused> {
    let FragmentStage {
        pass,
        graph,
        entry: fragment,
        given,
    } = simplify::examine(
        plan,
        SkipTaps::INFO.name,
        "skip taps first, then apply the other passes",
        "there is no tap to skip",
    )?;
    let program = graph.program();
    let meant = simplify::meant(&graph, fragment, params.of.as_deref(), SkipTaps::INFO.name)?;
    let mut found = find::terms(&graph, pass, fragment, &meant);
    // A budget is measured, whatever the zeros do.
    let seen = match params.budget.is_none() && params.threshold == 0.0 {
        false => ZeroEffect::Nothing,
        true => found.only_zeros(&graph, fragment, facts, &plan.material)?,
    };
    let Terms { terms, left } = found;
    if terms.is_empty() {
        let reason = match left.is_empty() {
            true => "the fragment stage has no sum of weighted texture samples",
            false => "no weighted texture sample of the fragment stage can be left out",
        };
        let remedy = "`preshade explain` lists the weighted samples, and why none may be left out";
        return Err((refuse(&refusals::NO_TAP, reason, remedy), left).into());
    }
    let is_implicit = terms.iter().any(|t| !t.implicit.is_empty());
    if params.budget.is_none() && (params.threshold > 0.0 || is_implicit) {
        let (reason, remedy) = match (params.threshold > 0.0, is_implicit) {
            (true, false) => (
                "leaving out small terms of a sum changes the picture, and there is no budget",
                "set budget=0.01 (of flip_mean, or with metric=max_abs), or threshold=0",
            ),
            (true, true) => (
                "leaving out small terms of a sum changes the picture, and there is no budget",
                "set budget=0.01 (of flip_mean, or with metric=max_abs)",
            ),
            (false, _) => (
                "samples at an implicit level get explicit gradients, whose level some adapters \
                 round differently, and there is no budget",
                "set budget=0.01 (of flip_mean, or with metric=max_abs), or sample with gradients \
                 or a level",
            ),
        };
        return Err((refuse(&shared::NO_BUDGET, reason, remedy), left).into());
    }
    let module = branch::skipping(&graph, &terms, params.threshold as f32);
    let bug = |e| Box::new(Refusal::bug(SkipTaps::INFO.name, e));
    let after = program.with_module(module).map_err(bug)?;
    let whole = graph.entry_cost(fragment);
    let skipped: f64 = terms.iter().map(|t| t.cost).sum();
    let cost = SiteCost {
        slice: skipped,
        whole,
    };
    let what = described(&graph, &terms, params.threshold);
    let all = simplify::whole(&graph, fragment);
    Ok(Simplified {
        change: simplify::change(&graph, pass, &all, what, (terms[0].span, cost)),
        contract: promised(params, pass, [program, &after], seen, given),
        program: after,
        of: pass.program.clone(),
        left,
    })
}

/// The contract: the budget, or if only products with 0 are skipped, the rounding that a compiler
/// may change.
fn promised(
    params: &SkipTapsParams,
    pass: &GpuPass,
    [before, after]: [&Program; 2],
    seen: ZeroEffect,
    mut given: Vec<Assumption>,
) -> Contract {
    if let Some(budget) = params.budget {
        return Contract::Approximate {
            budget: Budget {
                metric: params.metric,
                limit: budget,
            },
            given,
        };
    }
    given.extend([Assumption::SameContraction, Assumption::FiniteTaps]);
    given.sort();
    let exposed = contraction::exposed(before, after, pass, &BTreeSet::new());
    // Formats of whole numbers have one zero.
    let mut targets = pass.targets.iter().flatten();
    let shows_sign = seen == ZeroEffect::SignOfZero && targets.any(|t| t.format.ends_with("float"));
    match exposed.roundings.max(u32::from(shows_sign)) {
        0 => Contract::Exact { given },
        k => Contract::Rounding {
            k,
            turned: exposed.decides.map(|surface| Turned::on(k, surface)),
            given,
        },
    }
}

fn described(graph: &Graph<'_>, terms: &[Term], threshold: f64) -> String {
    let sources = graph.program().sources();
    let mut places: Vec<String> = Vec::new();
    for term in terms {
        let line = sources
            .locate(term.span)
            .map(|l| format!(" line {}", l.line));
        let place = format!(
            "`{}`{}",
            graph.name(term.function),
            line.unwrap_or_default()
        );
        if !places.contains(&place) {
            places.push(place);
        }
    }
    let cost: f64 = terms.iter().map(|t| t.cost).sum();
    let implicit: usize = terms.iter().map(|t| t.implicit.len()).sum();
    let gradients = match implicit {
        0 => String::new(),
        1 => ", one sample gets gradients".to_owned(),
        n => format!(", {n} samples get gradients"),
    };
    let what = match threshold > 0.0 {
        true => format!("weighs no more than {threshold}"),
        false => "weighs nothing".to_owned(),
    };
    format!(
        "{} of a sum ({}) left out where it {what}: {cost:.0} ops behind branches{gradients}",
        match terms.len() {
            1 => "a term".to_owned(),
            n => format!("each of {n} terms"),
        },
        places.join(", ")
    )
}
