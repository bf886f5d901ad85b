//! `trim-loop`: drops the last iterations of a loop.
//!
//! Goal: octaves of noise, steps of a march, samples of a filter. Many loops add less with every
//! iteration, and their authors chose a count that is enough wherever the shader may be seen. `verify`
//! measures the contribution of the last iterations in a scene.
//!
//! ```text
//! before:  for (var i = 0; i < 4; i++) { sum += amplitude * noise(p); amplitude *= 0.5; p *= 2.0; }
//!
//! after:   for (var i = 0; i < 3; i++) { .. }
//! ```
//!
//! Every counted loop of the fragment stage and its callees ([`Counted`]) loses `turns` iterations,
//! but keeps at least one; `of=fbm+ridges` selects the functions. The sum is not corrected: a sum
//! of four octaves that is divided by its amplitudes stays right, another one gets darker.
//!
//! Later terms of a series contribute less; later items of the scene's data do not. So a loop keeps
//! all iterations if it reads a buffer, a texel or a layer by its counter (`lights[i]`), unless one of
//! its weights shrinks with each iteration. If a loop shows neither, the plan has a note about it.
//!
//! The contract is your budget. Loops that decide a discard, depth or coverage, that write memory,
//! or that the vertex stage also runs are not trimmed, because the surface would move.
//!
//! Sitthi-Amorn et al. (2011) and Pellacini (2005) search such simplifications over whole
//! expressions; loops are where most of the time is spent.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use naga::{Literal, Span, Statement};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::coverage::Decides;
use crate::analysis::refusals as shared;
use crate::analysis::simplify::{self, FragmentStage, Simplified};
use crate::rebuild::place::{Replacement, Rewrite, rewritten};
use preshade_dataflow::graph::counted::Counted;
use preshade_dataflow::graph::{FunctionId, Graph, StmtId};
use preshade_plan::budget::{Budget, Metric};
use preshade_plan::contract::Contract;
use preshade_plan::pass::{Example, Facts, Left, Outcome, Pass, PassInfo, Refusal, Refused, Use};
use preshade_plan::plan::{GpuPass, Plan, SiteCost};
use shader_text::refusals::RefusalInfo;

pub struct TrimLoop;

pub mod refusals;
mod series;

/// Parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct TrimLoopParams {
    /// Number of iterations that each loop loses; at least one remains.
    #[schemars(range(min = 1, max = 64))]
    pub turns: u32,
    /// Functions whose loops to trim, joined by `+`. Default: the fragment stage and all its
    /// callees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub of: Option<String>,
    /// Largest allowed picture error by `metric`, above 0 and at most 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub budget: Option<f64>,
    /// The metric of the budget.
    pub metric: Metric,
}

impl Default for TrimLoopParams {
    fn default() -> Self {
        Self {
            turns: 1,
            of: None,
            budget: None,
            metric: Metric::default(),
        }
    }
}

impl Pass for TrimLoop {
    type Params = TrimLoopParams;

    const INFO: PassInfo = PassInfo {
        name: "trim-loop",
        summary: "leaves out the last iterations of loops, such as octaves of noise, within a \
                  budget",
        source: "Pellacini, User-Configurable Automatic Shader Simplification (2005); \
                 Sitthi-Amorn et al., Genetic Programming for Shader Simplification (2011)",
        when: "a loop over octaves, march steps or filter samples has more iterations than the \
               scene shows",
        hurts: "where the last iterations are visible: a sum that is not divided by its weights \
                gets darker",
        reads_scene: false,
    };

    const REFUSALS: &'static [RefusalInfo] = refusals::REFUSALS;

    const EXAMPLES: &'static [Example] = &[
        Example {
            recipe: "trim-loop:budget=1",
            uses: &[Use::Compile, Use::Fuzz, Use::Ahead(1)],
        },
        Example {
            recipe: "trim-loop:budget=0.1",
            uses: &[
                Use::Validate,
                Use::Inject,
                Use::Keep,
                Use::Pictures(2),
                Use::Truth,
            ],
        },
        Example {
            recipe: "trim-loop:budget=0.05",
            uses: &[
                Use::Page("pages/leaf"),
                Use::Picture {
                    scene: "fixtures/scenes/teapot-noise.toml --camera article --size 240x220 \
                            --frames 1",
                    caption: "noise without its last octave: fine detail is missing everywhere, by \
                              four steps at most",
                    rows: 1,
                },
            ],
        },
        Example {
            recipe: "trim-loop:BUDGET",
            uses: &[Use::PlanWithin],
        },
        Example {
            recipe: "trim-loop:BUDGET,turns=1",
            uses: &[Use::Simplify],
        },
        Example {
            recipe: "trim-loop:BUDGET,turns=2",
            uses: &[Use::Simplify],
        },
        Example {
            recipe: "trim-loop:BUDGET,turns=3",
            uses: &[Use::Simplify],
        },
    ];

    fn run(plan: &Plan, _facts: &Facts, params: &TrimLoopParams) -> Result<Outcome, Refused> {
        Ok(less_turns(plan, params)?.outcome(plan, Self::INFO.name, params))
    }
}

fn refuse(
    code: &RefusalInfo,
    reason: impl Into<String>,
    remedy: impl Into<String>,
) -> Box<Refusal> {
    Box::new(Refusal::new(TrimLoop::INFO.name, code, reason, remedy))
}

/// A loop, and why it is not trimmed if so.
struct LoopCandidate {
    function: FunctionId,
    at: StmtId,
    span: Span,
    /// Whether one of its weights is known to shrink.
    ebbs: bool,
    counted: Result<Counted, Missed>,
}

/// Why a loop is not trimmed.
type Missed = Cow<'static, str>;

/// A material's main pass with fewer iterations.
fn less_turns(plan: &Plan, params: &TrimLoopParams) -> Result<Simplified, Refused> {
    let FragmentStage {
        pass,
        graph,
        entry: fragment,
        given,
    } = simplify::examine(
        plan,
        TrimLoop::INFO.name,
        "trim first, then apply the other passes",
        "there is nothing to trim",
    )?;
    let program = graph.program();
    let meant = simplify::meant(&graph, fragment, params.of.as_deref(), TrimLoop::INFO.name)?;
    let found = found(&graph, pass, fragment, &meant, params.turns);
    let left = left(&graph, &found);
    let chosen: Vec<(&LoopCandidate, &Counted)> = found
        .iter()
        .filter_map(|f| Some((f, f.counted.as_ref().ok()?)))
        .collect();
    if chosen.is_empty() {
        let reason = match found.is_empty() {
            true => "the fragment stage has no loop",
            false => "no loop of the fragment stage can lose an iteration",
        };
        let remedy = "`preshade explain` lists the loops, and why each keeps its iterations";
        return Err((refuse(&refusals::NO_LOOP, reason, remedy), left).into());
    }
    let Some(budget) = params.budget else {
        let refusal = refuse(
            &shared::NO_BUDGET,
            "fewer iterations change the picture, and there is no budget",
            "set budget=0.01 (of flip_mean, or with metric=max_abs)",
        );
        return Err((refusal, left).into());
    };
    let module = trimmed(&graph, &chosen, params.turns);
    let bug = |e| Box::new(Refusal::bug(TrimLoop::INFO.name, e));
    let after = program.with_module(module).map_err(bug)?;
    let whole = graph.entry_cost(fragment);
    let rest = Graph::build(&after).entry_cost(fragment);
    let (first, _) = chosen[0];
    let cost = SiteCost {
        slice: whole - rest,
        whole,
    };
    let what = described(&graph, &chosen, params.turns, [whole, rest]);
    let all = simplify::whole(&graph, fragment);
    Ok(Simplified {
        change: simplify::change(&graph, pass, &all, what, (first.span, cost)),
        program: after,
        of: pass.program.clone(),
        left,
        contract: Contract::Approximate {
            budget: Budget {
                metric: params.metric,
                limit: budget,
            },
            given,
        },
    })
}

/// The loops of functions, and which of them can lose `turns` iterations.
fn found(
    graph: &Graph<'_>,
    pass: &GpuPass,
    fragment: usize,
    meant: &BTreeSet<FunctionId>,
    turns: u32,
) -> Vec<LoopCandidate> {
    let program = graph.program();
    let decides = Decides::of(graph, program, fragment, pass);
    let covers = decides.anything().then(|| decides.slice(graph, fragment));
    let decides_coverage = |function: FunctionId, at: StmtId| {
        covers.as_ref().is_some_and(|slice| {
            let parts = slice.parts.iter().filter(|p| p.function == function);
            parts
                .clone()
                .any(|p| p.kept.statements.get(at.index()) == Some(&true))
        })
    };
    let others: Vec<FunctionId> = (0..program.module().entry_points.len())
        .filter(|i| *i != fragment)
        .map(FunctionId::EntryPoint)
        .collect();
    let mut all = Vec::new();
    for id in meant {
        let f = graph.function(*id);
        let uses = uses(f.function);
        let writes = graph.writes_memory(*id);
        let is_shared = others.iter().any(|entry| graph.reaches(*entry, *id));
        for (at, node) in f.statements.iter() {
            let is_loop = matches!(node.statement, Statement::Loop { .. });
            if !is_loop || !f.control.is_reachable(at) {
                continue;
            }
            let ebbs = series::ebbs(program.module(), f, at);
            let stays = |why: &'static str| Err(Cow::Borrowed(why));
            let counted = match Counted::of(program.module(), f, at) {
                _ if is_shared => {
                    stays("the vertex stage runs it too, where it decides the position")
                }
                _ if writes => stays("its function writes memory"),
                _ if decides_coverage(*id, at) => {
                    stays("it decides a discard, a depth or a coverage")
                }
                None => stays("its number of iterations is unknown: its bound is not a constant"),
                Some(c) if c.turns < 2 => stays("it has one iteration at most"),
                Some(c) if uses.get(&c.bound) != Some(&1) => {
                    stays("the bound of its counter has another use")
                }
                Some(c) if c.bound_for(less(&c, turns)).is_none() => {
                    stays("no other bound removes that many iterations")
                }
                Some(c) => match series::scene_data(graph, *id, &c).filter(|_| !ebbs) {
                    Some(read) => Err(Cow::Owned(format!(
                        "it reads `{read}` by its counter: its last iteration may be as important \
                         as its first"
                    ))),
                    None => Ok(c),
                },
            };
            all.push(LoopCandidate {
                function: *id,
                at,
                span: node.span,
                ebbs,
                counted,
            });
        }
    }
    all
}

/// Number of readers of each expression of a function.
fn uses(function: &naga::Function) -> BTreeMap<naga::Handle<naga::Expression>, usize> {
    let mut uses = BTreeMap::new();
    let mut add = |of: Vec<naga::Handle<naga::Expression>>| {
        for e in of {
            *uses.entry(e).or_insert(0) += 1;
        }
    };
    for (_, expression) in function.expressions.iter() {
        add(naga_operands::of_expression(expression));
    }
    naga_operands::visit(&function.body, &mut |s| add(naga_operands::of_statement(s)));
    uses
}

/// The module with fewer iterations: each counter is compared with another number.
fn trimmed(graph: &Graph<'_>, chosen: &[(&LoopCandidate, &Counted)], turns: u32) -> naga::Module {
    let mut module = graph.module().clone();
    let functions: BTreeSet<FunctionId> = chosen.iter().map(|(f, _)| f.function).collect();
    for id in functions {
        let of = chosen.iter().filter(|(f, _)| f.function == id);
        module = rewritten(&module, id, |build| {
            let mut rewrite = Rewrite::default();
            for (_, counted) in of {
                let left = less(counted, turns);
                // Loops without such a number were not chosen.
                let Some(bound) = counted.bound_for(left) else {
                    continue;
                };
                let literal = match counted.signed {
                    true => Literal::I32(bound as i32),
                    false => Literal::U32(bound as u32),
                };
                let value = Replacement::Value(build.literal(literal));
                rewrite.replacements.insert(counted.bound, value);
            }
            rewrite
        });
    }
    module
}

/// Iterations that remain.
fn less(counted: &Counted, turns: u32) -> u32 {
    counted.turns.saturating_sub(turns).max(1)
}

fn described(
    graph: &Graph<'_>,
    chosen: &[(&LoopCandidate, &Counted)],
    turns: u32,
    [whole, rest]: [f64; 2],
) -> String {
    let sources = graph.program().sources();
    let loops: Vec<String> = chosen
        .iter()
        .map(|(f, c)| {
            let line = sources
                .locate(f.span)
                .map(|l| format!(" in line {}", l.line));
            format!(
                "the loop of `{}`{} has {} iterations instead of {}{}",
                graph.name(f.function),
                line.unwrap_or_default(),
                less(c, turns),
                c.turns,
                match f.ebbs {
                    true => "",
                    false => " (its last iterations may add as much as its first)",
                }
            )
        })
        .collect();
    format!(
        "{}: a fragment costs {rest:.0} ops instead of {whole:.0}",
        loops.join(", ")
    )
}

/// The loops that are not trimmed, and why.
fn left(graph: &Graph<'_>, found: &[LoopCandidate]) -> Vec<Left> {
    let sources = graph.program().sources();
    let mut left: Vec<Left> = found
        .iter()
        .filter_map(|f| {
            let reason = f.counted.as_ref().err()?;
            Some(Left {
                name: format!("loop of {}", graph.name(f.function)),
                reason: reason.clone().into_owned(),
                cost: cost(graph, f),
                location: sources.locate(f.span),
            })
        })
        .collect();
    left.sort_by(|a, b| b.cost.total_cmp(&a.cost));
    left
}

/// Static cost of all iterations of a loop in one run of its function.
fn cost(graph: &Graph<'_>, found: &LoopCandidate) -> f64 {
    let f = graph.function(found.function);
    let end = f.statements.get(found.at).end;
    let is_within = |s: StmtId| (found.at..end).contains(&s);
    let calls = f.calls().filter(|(at, _)| is_within(*at));
    let called: f64 = calls
        .map(|(at, callee)| graph.cost(FunctionId::Function(callee)) * f.times[at.index()])
        .sum();
    called + f.own_cost(graph.module(), is_within, |_| true)
}
