//! `hoist`: moves slowly changing work of the fragment stage to the vertices and interpolates the
//! result.
//!
//! Goal: compute a value once per vertex instead of in every fragment, if an interpolated value
//! suffices (Wang et al. 2014; He et al. 2015; Erkaman's "Making Faster Fragment Shaders by Using
//! Tessellation Shaders" does it by hand).
//!
//! ```text
//! before:  vs -> normal                     fs(normal): shade(noise(normal))
//!
//! after:   vs -> hoisted = noise(normal)    fs(hoisted): shade(hoisted)
//! ```
//!
//! A minimum cut of the fragment stage's values ([`mod@crate::analysis::cut`]) decides what moves. We sweep the
//! price of transport until the varyings fit and the total is cheapest. The contract depends on the
//! effect of interpolation:
//!
//! | value | interpolated | contract |
//! |---|---|---|
//! | constant over the draw or the primitive, and no compiler can fuse it into its reader | flat | `Exact` |
//! | the same, but a compiler can (a product that is read by a sum) | flat | `Rounding` |
//! | components of a varying | as that varying | `Exact` |
//! | affine in varyings of one interpolation class, with draw-uniform coefficients, reaching no discontinuity and no unbounded slope (`normalize`, a division) | as those | `Rounding` |
//! | any other value that a vertex stage can compute | smooth | `Approximate`, within your budget |
//!
//! Derivatives, implicit-LOD samples, fragment inputs, discontinuous values, and values that may
//! not be finite at a vertex are not hoisted, and the report gives the reason for each. The same
//! holds for values that depend on a discontinuity (a depth packed into bytes, a branch,
//! `2 * fract(x)`) and for operands of a periodic one (`fract`, `floor`, `%`, an integer). If range
//! analysis shows that the operand never crosses the discontinuity, we ignore it.
//!
//! Noise uses `floor` but is continuous across cells. We can't prove that, so we hoist noise only
//! if `verify` measured it, if you list it in `carry`, or if you pass `jumps=carried`.
//!
//! A loop may end at a number in a uniform buffer. The plan then has a [guard](../guides/specialize.md#the-guard) for it.

use naga::ShaderStage;

use crate::analysis::implicit_inputs::{ImplicitInputs, PassEffect};
use crate::analysis::{refusals as shared, rounding, transitive_cost, values};
use crate::rebuild::moved::MovedValues;
use crate::rebuild::{outline, place};
use preshade_dataflow::graph::Graph;
use preshade_plan::budget::Budget;
use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::pass::{
    Example, Expected, Facts, Left, Outcome, Pass, PassInfo, Refusal, Refused, Use,
};
use preshade_plan::plan::{Change, GpuPass, HOIST, Plan, SiteCost};
use preshade_plan::program::Program;
use preshade_plan::{reflect, self_test};
use shader_text::refusals::RefusalInfo;

mod advice;
mod candidates;
pub mod choose;
mod discontinuity;
mod form;
pub mod movable;
mod moved;
pub mod pack;
mod params;
pub mod refusals;
mod remainder;
mod single;
mod vertex;

pub use candidates::{Candidate, MOST_CANDIDATES, candidates};
pub use params::{Allow, HoistParams};
pub use rounding::{MOST as MOST_ROUNDING, STEEPEST_SRGB};
pub use single::{Candidates, Computed, HoistStages, alone, computed};

use advice::Advice;
use choose::CarriedValues;
use movable::{Class, Judged, NotHoisted, Precision};
use outline::Failed;
use values::Values;

pub struct Hoist;

impl Pass for Hoist {
    type Params = HoistParams;

    const INFO: PassInfo = PassInfo {
        name: HOIST,
        summary: "moves slowly changing work of the fragment stage to the vertices, and \
                  interpolates it",
        source: "Wang et al., Automatic Shader Simplification using Surface Signal Approximation \
                 (2014)",
        when: "fragments compute what changes slowly over a triangle (noise, fog, light of far or \
               large lamps), on meshes whose triangles cover many pixels",
        hurts: "where triangles are about as small as pixels, where varyings are the bottleneck, \
                and in the picture where a value bends within a triangle",
        reads_scene: true,
    };

    const REFUSALS: &'static [RefusalInfo] = refusals::REFUSALS;

    const EXAMPLES: &'static [Example] = &[
        Example {
            recipe: "hoist",
            uses: &[
                Use::Snapshot,
                Use::Fuzz,
                Use::Plan,
                Use::Simplify,
                Use::Growth,
                Use::Ahead(2),
            ],
        },
        Example {
            recipe: "hoist:budget=0.02,finite=assumed,jumps=carried",
            uses: &[Use::Snapshot],
        },
        Example {
            recipe: "hoist:allow=exact",
            uses: &[Use::Inject, Use::Truth],
        },
        Example {
            recipe: "hoist:allow=rounding",
            uses: &[Use::Validate, Use::Pictures(1), Use::Truth],
        },
        Example {
            recipe: "hoist:budget=0.1,finite=assumed",
            uses: &[Use::Inject],
        },
        Example {
            recipe: "hoist:budget=0.1,vertices-per-fragment=0",
            uses: &[Use::Break],
        },
        Example {
            recipe: "hoist:budget=0.01,finite=assumed,jumps=carried",
            uses: &[Use::Truth],
        },
        Example {
            recipe: "hoist:budget=1,finite=assumed,jumps=carried",
            uses: &[Use::Fuzz],
        },
        Example {
            recipe: "hoist:budget=0.05",
            uses: &[
                Use::Page("pages/leaf"),
                Use::Picture {
                    scene: "fixtures/scenes/teapot-specular.toml --camera article --size 240x220 \
                            --frames 1",
                    caption: "a highlight computed at the vertices: it is off where it bends \
                              within a triangle",
                    rows: 1,
                },
            ],
        },
        Example {
            recipe: "hoist:budget=0.02,finite=assumed,jumps=carried,depth-prepass:form=equal",
            uses: &[Use::Validate],
        },
        Example {
            recipe: "hoist:budget=0.02,finite=assumed,jumps=carried,early-discard",
            uses: &[Use::Validate],
        },
        Example {
            recipe: "hoist,depth-prepass",
            uses: &[Use::Plan],
        },
        Example {
            recipe: "hoist:BUDGET",
            uses: &[Use::PlanWithin],
        },
        Example {
            recipe: "hoist:BUDGET,depth-prepass",
            uses: &[Use::PlanWithin],
        },
    ];

    fn expected(_params: &HoistParams) -> Expected {
        Expected {
            replaces_varyings: true,
            interpolates: true,
            ..Expected::default()
        }
    }

    fn run(plan: &Plan, facts: &Facts, params: &HoistParams) -> Result<Outcome, Refused> {
        let material = HoistMaterial::examine(plan, params)?;
        let graph = Graph::build(material.program);
        let values = material.values(&graph)?;
        let hoisted = HoistedValues::new(&values, &material, params, facts)?;
        let program = hoisted
            .rebuild(&material)
            .map_err(|why| hoisted.moved.refused(refuse(why)))?;
        let effects = [
            PassEffect::EditsVertexStage,
            PassEffect::EditsFragmentStage,
            PassEffect::RemovesInputs,
        ];
        let inputs = ImplicitInputs::new(plan, material.pass, &graph).replaced_by(&program);
        let given = inputs.examine(Self::INFO.name, &effects)?;
        Ok(hoisted.outcome(plan, &material, program, params, given))
    }
}

/// The stages of a material.
struct HoistMaterial<'a> {
    name: &'a str,
    pass: &'a GpuPass,
    program: &'a Program,
    vertex: usize,
    fragment: usize,
    /// Whether an earlier step changed the interface between them.
    is_rebuilt: bool,
}

impl<'a> HoistMaterial<'a> {
    fn examine(plan: &'a Plan, params: &HoistParams) -> Result<Self, Box<Refusal>> {
        let name = Hoist::INFO.name;
        let refuse = |code: &RefusalInfo, reason: &str, remedy: &str| {
            Err(Box::new(Refusal::new(name, code, reason, remedy)))
        };
        if let Some(refusal) = params.check() {
            return Err(Box::new(refusal));
        }
        let Some((pass, program)) = plan.main().and_then(|p| Some((p, plan.program(p)?))) else {
            return refuse(
                &shared::NO_MAIN_PASS,
                "the plan has no main pass",
                "start from the original plan",
            );
        };
        if plan.passes.len() > 1 {
            return refuse(
                &shared::HAS_PREPASS,
                "another pass of the plan draws the same surface with the vertex stage that \
                 `hoist` would rebuild",
                "hoist first, then add the pre-pass",
            );
        }
        let vertex = program.entry_point(ShaderStage::Vertex, &pass.vertex);
        let fragment = pass
            .fragment
            .as_deref()
            .and_then(|f| program.entry_point(ShaderStage::Fragment, f));
        let (Some((vertex, _)), Some((fragment, _))) = (vertex, fragment) else {
            return refuse(
                &shared::NO_FRAGMENT_STAGE,
                "the material has no fragment stage",
                "there is nothing to hoist",
            );
        };
        Ok(Self {
            name: &plan.material,
            pass,
            program,
            vertex,
            fragment,
            is_rebuilt: plan.steps.iter().any(|s| s.pass == Hoist::INFO.name),
        })
    }

    /// The required precision of the targets, and the known ranges.
    fn precision(&self, facts: &Facts) -> Precision {
        Precision {
            ranges: facts.ranges_of(self.name, self.is_rebuilt),
            most: rounding::most(self.pass),
        }
    }

    fn values<'g>(&self, graph: &'g Graph<'a>) -> Result<Values<'g, 'a>, Box<Refusal>> {
        Values::examine(graph, self.fragment, Hoist::INFO.name)
    }
}

/// The refusal for a rebuild that failed.
fn refuse(why: Failed) -> Refusal {
    match why {
        Failed::NoOutput(_) => Refusal::new(
            Hoist::INFO.name,
            &refusals::INTERFACE,
            why.to_string(),
            "let the vertex stage write every input of the fragment stage",
        ),
        other => other.refusal(Hoist::INFO.name),
    }
}

/// A message about ids of an earlier choice that no value has.
fn not_here(unknown: &[String]) -> String {
    format!(
        "`carry` names values that are not in this fragment stage ({}): {}",
        unknown.len(),
        unknown.join(", ")
    )
}

fn unknown_values(unknown: &[String]) -> Refusal {
    Refusal::new(
        Hoist::INFO.name,
        &refusals::UNKNOWN_VALUES,
        not_here(unknown),
        "choose again with `verify`: the shader was edited, or the values belong to another \
         material",
    )
}

/// The values that the vertex stage computes.
struct HoistedValues<'v, 'g, 'p> {
    moved: MovedValues<'v, 'g, 'p>,
    choice: CarriedValues,
    /// Assumptions by which rounding errors stay small.
    given: Vec<Assumption>,
    /// Ids of an earlier choice that no value has.
    unknown: Vec<String>,
}

impl<'v, 'g, 'p> HoistedValues<'v, 'g, 'p> {
    fn new(
        values: &'v Values<'g, 'p>,
        material: &HoistMaterial<'p>,
        params: &HoistParams,
        facts: &Facts,
    ) -> Result<Self, (Box<Refusal>, Vec<Left>)> {
        let precision = material.precision(facts);
        let all = movable::judge(values, &precision);
        let judged = candidates::judge(values, material, params, &precision, facts, &all);
        let terms = params.terms(facts);
        let left = left(values, &judged, terms.weakest);
        match choose::choose(values, &judged, precision.most, &terms) {
            Some(choice) => Ok(Self {
                given: vec![
                    Assumption::StagesAgree,
                    Assumption::FineInterpolation,
                    match precision.ranges.is_empty() {
                        true => Assumption::OrdinaryNumbers,
                        false => Assumption::NumbersOfTheScene,
                    },
                ],
                unknown: judged.unknown,
                ..Self::of(values, choice, left)
            }),
            None if !judged.unknown.is_empty()
                && !judged.verdicts.iter().any(candidates::is_smooth) =>
            {
                Err((Box::new(unknown_values(&judged.unknown)), left))
            }
            None => {
                let given = [&all, &judged];
                let advice = Advice::on(values, material, params, &precision, facts, given);
                let mut refusal = Box::new(advice.refusal());
                let best = params.best_measured(material.name, facts);
                refusal.reason.push_str(&best);
                Err((refusal, left))
            }
        }
    }

    fn of(values: &'v Values<'g, 'p>, choice: CarriedValues, left: Vec<Left>) -> Self {
        let ids = choice.carried.iter().map(|(id, _)| *id).collect();
        Self {
            moved: MovedValues::new(values, ids, "carried", left),
            choice,
            given: Vec::new(),
            unknown: Vec::new(),
        }
    }

    fn change(&self, pass: &GpuPass) -> Change {
        let values = self.moved.values;
        let cost = SiteCost {
            slice: self.choice.before - self.choice.after,
            whole: values.graph.entry_cost(values.entry),
        };
        self.moved.change(pass, &self.describe(), cost)
    }

    /// A message: the hoisted values, their interpolation, and the change in static cost.
    fn describe(&self) -> String {
        let carried: Vec<String> = self
            .choice
            .carried
            .iter()
            .zip(&self.moved.wanted)
            .map(|((id, carriage), wanted)| {
                let width = self.moved.values.shape(*id).map_or(1, |(_, w)| w);
                let class = match carriage.class {
                    Class::Exact => "exact",
                    Class::Affine => "affine, rounding",
                    Class::Smooth => "interpolated, approximate",
                };
                format!("`{}` ({width} wide, {class})", wanted.name)
            })
            .collect();
        format!(
            "carries {}; a fragment costs {:.0} ops less, its interpolation counted, and a vertex \
             {:.0} more",
            carried.join(", "),
            self.choice.before - self.choice.after,
            self.choice.vertex
        )
    }

    fn rebuild(&self, material: &HoistMaterial<'_>) -> Result<Program, Failed> {
        let MovedValues { values, wanted, .. } = &self.moved;
        let hoisted = outline::add(material.program, values, wanted)?;
        let remainder = remainder::rebuild(&hoisted.module, &self.moved, &self.choice.slots)?;
        let outputs = vertex::Outputs {
            kept: &remainder.kept,
            wanted,
            slots: &self.choice.slots,
            locations: &remainder.locations,
        };
        let module = vertex::rebuild(
            material.program,
            remainder.module,
            material.vertex,
            &hoisted,
            &outputs,
        )?;
        let module = place::retain(&module, &material.pass.stages());
        material.program.with_module(module).map_err(Failed::from)
    }

    fn outcome(
        self,
        plan: &Plan,
        material: &HoistMaterial<'_>,
        program: Program,
        params: &HoistParams,
        given: Vec<Assumption>,
    ) -> Outcome {
        let mut next = plan.clone();
        let mut moved = None;
        for pass in &mut next.passes {
            if pass.program == material.pass.program {
                let before = pass.clone();
                reflect::fill(pass, &program);
                moved =
                    moved.or_else(|| moved::note((&before, material.program), (pass, &program)));
            }
        }
        next.programs.insert(material.pass.program.clone(), program);
        if given.contains(&Assumption::UnchangedPosition) {
            next.self_test = self_test::same_position(&next);
        }
        let (change, k) = (self.change(material.pass), self.roundings());
        let contract = |mut given: Vec<Assumption>| match self.choice.class() {
            None | Some(Class::Exact) => {
                given.push(Assumption::StagesAgree);
                given.sort();
                Contract::Exact { given }
            }
            Some(Class::Affine) => {
                given.extend(self.given);
                given.sort();
                let turned = None;
                Contract::Rounding { k, turned, given }
            }
            Some(Class::Smooth) => Contract::Approximate {
                budget: Budget {
                    metric: params.metric,
                    limit: params.budget.unwrap_or_default(),
                },
                given,
            },
        };
        let step = (Hoist::INFO.name, params);
        let mut outcome = self.moved.outcome(next, step, change, given, contract);
        let notes = &mut outcome.plan.notes;
        notes.extend(moved);
        notes.extend((!self.unknown.is_empty()).then(|| not_here(&self.unknown)));
        outcome
    }

    /// Number of operations that may round differently: those of the hoisted values, and those that
    /// stay but lose a reader.
    fn roundings(&self) -> u32 {
        let of = self.choice.carried.iter().map(|(id, _)| *id);
        transitive_cost::transitive_cost(self.moved.values, of)
            .0
            .ceil() as u32
            + self.choice.rounded_anew.len() as u32
    }
}

/// Most missed values to report.
pub(crate) const MOST_LEFT: usize = 1_000;

/// Named values and results of calls that are not hoisted, at most [`MOST_LEFT`], most expensive
/// first. Values whose users could not have taken them along are included.
fn left(values: &Values<'_, '_>, judged: &Judged, weakest: Class) -> Vec<Left> {
    transitive_cost::left(values, MOST_LEFT, |id| match &judged.verdicts[id] {
        Ok(c) if c.class <= weakest => None,
        Ok(_) if judged.affine[id] => Some(match judged.roundings.of(id) {
            error if error.is_finite() => {
                format!("hoisted, its rounding may change an output by {error:.1e}")
            }
            _ => "hoisted, its rounding may change an output without bound".to_owned(),
        }),
        Ok(_) => Some("interpolating it is an approximation, and there is no budget".to_owned()),
        Err(NotHoisted::NotCarried | NotHoisted::Varying) => None,
        Err(why) => Some(why.to_string()),
    })
}
