//! `early-alpha`: the alpha test runs before the expensive work of its stage.
//!
//! Goal: leaves, fences and hair discard most of their fragments. Where the test comes after the
//! lighting, every discarded fragment has paid for the light as well.
//!
//! ```text
//! before:  let light = forty_lamps(in.world);
//!          let color = textureSample(leaf, s, in.uv);
//!          if color.a < 0.5 { discard; }
//!
//! after:   let fails = early_alpha_test(in.uv);      // a copy of what the test needs
//!          if leaves_with_quad(fails) { discard; }   // all four lanes of the quad fail
//!          let light = forty_lamps(in.world);        // the author's stage, as it was
//!          let color = textureSample(leaf, s, in.uv);
//!          if color.a < 0.5 { discard; }
//! ```
//!
//! The test is a slice: the statements that decide the stage's discards. A copy of it runs first.
//! The author's own code follows unchanged, with its own discards, so a survivor is computed by the
//! same text as before. Depth, sample mask and alpha to coverage of a survivor are the author's too.
//!
//! A quad leaves as a whole or not at all. A survivor may sample a texture or take a derivative
//! after the test, and its neighbours must then still be there: naga writes `discard` as SPIR-V's
//! `OpKill`, which ends a lane at once. GLSL ES has only coarse derivatives, so the vote promises
//! nothing there ([`crate::rebuild::quad`]).
//!
//! The copy and the original have to agree, as two passes that share a discard do
//! (`invariant-discard`). The pass refuses a stage that stores to memory, since a discarded
//! fragment may have stored before its test. It refuses tests that cost more than they save.

use naga::{
    Expression, Function, FunctionResult, Handle, Literal, LocalVariable, Module, Scalar, Span,
    Statement, Type, TypeInner,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::implicit_inputs::{ImplicitInputs, PassEffect};
use crate::analysis::refusals as shared;
use crate::analysis::simplify::{self, FragmentStage, Simplified};
use crate::rebuild::prologue::Ahead;
use crate::rebuild::{place, quad};
use naga_edit::returns;
use preshade_dataflow::graph::effect::Effect;
use preshade_dataflow::graph::{FunctionId, Graph, StmtId};
use preshade_dataflow::slice::{self, Criterion, Slice};
use preshade_plan::contract::Contract;
use preshade_plan::pass::{Example, Facts, Outcome, Pass, PassInfo, Refusal, Refused, Use};
use preshade_plan::plan::{Plan, SiteCost};
use shader_text::refusals::{RefusalInfo, refusals};

refusals! {
    NO_DISCARD = "no-discard":
        "The fragment stage discards nothing, so there is no test to move.",
        "Leave the material as it is.";
    DISCARD_FIRST = "discard-first":
        "The discard already comes before the expensive work.",
        "Leave the material as it is.";
    TEST_COSTS_MOST = "test-costs-most":
        "The test costs more than `share` of the other work ahead of its discard. Survivors \
         compute \
         it twice, so moving it doesn't pay.",
        "Give a larger `share` if most fragments are discarded.";
    DISCARD_IN_FUNCTION = "discard-in-function":
        "A function that the fragment stage calls discards.",
        "Return the decision from the function, and discard in the entry point.";
    DISCARDED_EFFECTS = "discarded-effects":
        "The fragment stage stores to memory or talks to other fragments. A discarded fragment may \
         do so before its test.",
        "Move the effect to a pass of its own.";
    TEST_LOOP = "test-loop":
        "The test depends on a loop that may not end without the discards that leave it.",
        "Count its iterations by constants: `for i < 32`.";
}

pub struct EarlyAlpha;

/// Parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct EarlyAlphaParams {
    /// Most that the test may cost, as a share of the other work ahead of the author's discard.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub share: f64,
}

impl Default for EarlyAlphaParams {
    fn default() -> Self {
        Self { share: 0.5 }
    }
}

impl Pass for EarlyAlpha {
    type Params = EarlyAlphaParams;

    const INFO: PassInfo = PassInfo {
        name: "early-alpha",
        summary: "runs the alpha test before the expensive work of its stage",
        source: "Weiser, Program Slicing (1981), for the test; \
                 Primozic, Speeding Up Three.JS with Depth-Based Fragment Culling (2022), for the \
                 early exit",
        when: "a cut-out material (leaves, fences, hair) tests its alpha after expensive work",
        hurts: "where few fragments are discarded: the survivors compute the test twice, and each \
                quad votes",
        reads_scene: false,
    };

    const REFUSALS: &'static [RefusalInfo] = REFUSALS;

    const EXAMPLES: &'static [Example] = &[
        Example {
            recipe: "early-alpha",
            uses: &[
                Use::Snapshot,
                Use::Inject,
                Use::Fuzz,
                Use::Plan,
                Use::Simplify,
                Use::ExactWhereApplied,
                Use::Page("shaders/late-alpha"),
                Use::Picture {
                    scene: "fixtures/scenes/late-alpha.toml --size 256x144 --frames 1",
                    caption: "leaves that test their alpha after the light of their veins: no \
                              pixel differs",
                    rows: 1,
                },
            ],
        },
        Example {
            recipe: "early-alpha,depth-prepass",
            uses: &[Use::Compile],
        },
    ];

    fn run(plan: &Plan, _facts: &Facts, params: &EarlyAlphaParams) -> Result<Outcome, Refused> {
        Ok(tested_early(plan, params)?.outcome(plan, Self::INFO.name, params))
    }
}

fn refuse(code: &RefusalInfo, reason: impl Into<String>, remedy: &str) -> Box<Refusal> {
    Box::new(Refusal::new(EarlyAlpha::INFO.name, code, reason, remedy))
}

/// A material's main pass with its test first.
fn tested_early(plan: &Plan, params: &EarlyAlphaParams) -> Result<Simplified, Refused> {
    let name = EarlyAlpha::INFO.name;
    let FragmentStage {
        pass,
        graph,
        entry: fragment,
        mut given,
    } = simplify::examine(
        plan,
        name,
        "apply early-alpha first, then the other passes",
        "there is no test to move",
    )?;
    if !pass.primitive.topology.is_triangles() {
        return Err(refuse(
            &shared::VOTE_NEEDS_TRIANGLES,
            "lines and points have no 2x2 quads to vote in",
            "leave the test where it is",
        )
        .into());
    }
    if plan.steps.iter().any(|step| step.pass == name) {
        return Err(refuse(
            &DISCARD_FIRST,
            "the test already runs first",
            "apply early-alpha once",
        )
        .into());
    }
    let program = graph.program();
    let test = Test::of(&graph, fragment, params)?;
    let inputs = ImplicitInputs::new(plan, pass, &graph).sliced(Some(&test.slice), None);
    given.extend(inputs.examine(name, &[PassEffect::LeavesEarly])?);
    let bug = |why: &dyn std::fmt::Display| Box::new(Refusal::bug(name, why));
    let module = test.moved(&graph).map_err(|why| bug(&why))?;
    let after = program.with_module(module).map_err(|why| bug(&why))?;
    let what = format!(
        "the test ({:.0} ops) runs first; a quad that fails it saves {:.0} ops",
        test.slice.cost, test.saved
    );
    let cost = SiteCost {
        slice: test.slice.cost,
        whole: graph.entry_cost(fragment),
    };
    Ok(Simplified {
        change: simplify::change(&graph, pass, &test.slice, what, (test.span, cost)),
        program: after,
        of: pass.program.clone(),
        left: Vec::new(),
        contract: Contract::Exact { given },
    })
}

/// The discards of a fragment stage, and the statements that decide them.
struct Test {
    slice: Slice,
    /// The last discard.
    span: Span,
    /// Static cost of the work ahead of that discard, without the test.
    saved: f64,
}

impl Test {
    fn of(
        graph: &Graph<'_>,
        fragment: usize,
        params: &EarlyAlphaParams,
    ) -> Result<Self, Box<Refusal>> {
        let id = FunctionId::EntryPoint(fragment);
        let sources = graph.program().sources();
        if !graph.may_discard(id) {
            return Err(refuse(
                &NO_DISCARD,
                "the fragment stage discards nothing",
                "there is no test to move",
            ));
        }
        let mut shared = Effect::WRITES.into_iter().chain([Effect::Barrier]);
        if let Some(effect) = shared.find(|e| graph.effects(id).contains(e)) {
            return Err(refuse(
                &DISCARDED_EFFECTS,
                format!(
                    "the fragment stage has an effect ({}) that a discarded fragment may have \
                     before its test",
                    effect.name()
                ),
                "move the effect to a pass of its own",
            ));
        }
        let slice = slice::backward(graph, fragment, &[Criterion::Discard]);
        let Some((last, span)) = last_discard(graph, id) else {
            return Err(in_function());
        };
        if slice
            .parts
            .iter()
            .any(|part| part.function != id && last_discard(graph, part.function).is_some())
        {
            return Err(in_function());
        }
        if let Some(span) = slice.endless_loop(graph) {
            let refusal = refuse(
                &TEST_LOOP,
                "the test depends on a loop that may not end without the discards that leave it",
                "count its iterations by constants (for i < 32)",
            );
            return Err(Box::new(refusal.at(sources, span)));
        }
        let saved = cost_ahead(graph, id, last) - slice.cost;
        let pays = saved >= WORTH && slice.cost <= params.share * saved;
        if pays {
            return Ok(Self { slice, span, saved });
        }
        let is_most = 2.0 * slice.cost > graph.entry_cost(fragment);
        let (code, reason) = match saved < WORTH && !is_most {
            true => (
                &DISCARD_FIRST,
                "the discard already comes before the expensive work".to_owned(),
            ),
            false => (
                &TEST_COSTS_MOST,
                format!(
                    "the test costs {:.0} ops, and the other work ahead of its discard {saved:.0}",
                    slice.cost
                ),
            ),
        };
        let remedy = "leave the test where it is, or give a larger share";
        Err(Box::new(refuse(code, reason, remedy).at(sources, span)))
    }

    /// The module with a copy of the test first in the stage.
    fn moved(&self, graph: &Graph<'_>) -> Result<Module, String> {
        let added = Ahead::add(
            graph,
            &self.slice,
            graph.module(),
            "early_alpha_test",
            "test",
        );
        let (mut module, test) = added.ok_or("the test has no arguments")?;
        let bool = module.types.insert(
            Type {
                name: None,
                inner: TypeInner::Scalar(Scalar::BOOL),
            },
            Span::UNDEFINED,
        );
        return_discarded(module.functions.get_mut(test.function), bool);
        let (module, vote) = quad::vote(module).map_err(|e| e.to_string())?;
        Ok(place::prologue(&module, self.slice.entry, |build| {
            let Some(fails) = test.call(build, "fails") else {
                return;
            };
            if let Some(leaves) = build.call(vote, vec![fails]) {
                build.name(leaves, "leaves");
                build.if_then(leaves, |build| build.statement(Statement::Kill));
            }
        }))
    }
}

/// Below this static cost, in ops, no work is worth saving.
const WORTH: f64 = 16.0;

fn in_function() -> Box<Refusal> {
    refuse(
        &DISCARD_IN_FUNCTION,
        "a function that the fragment stage calls discards",
        "return the decision from the function, and discard in the entry point",
    )
}

/// The last discard in a function's own statements.
fn last_discard(graph: &Graph<'_>, id: FunctionId) -> Option<(StmtId, Span)> {
    let statements = graph.function(id).statements.iter();
    let discards = statements.filter(|(_, node)| matches!(node.statement, Statement::Kill));
    discards.last().map(|(at, node)| (at, node.span))
}

/// Static cost of the statements ahead of `last`, calls included.
fn cost_ahead(graph: &Graph<'_>, id: FunctionId, last: StmtId) -> f64 {
    let f = graph.function(id);
    let calls = f.calls().filter(|(at, _)| *at < last);
    let calls: f64 = calls
        .map(|(at, callee)| graph.cost(FunctionId::Function(callee)) * f.times[at.index()])
        .sum();
    calls + f.own_cost(graph.module(), |at| at < last, |_| true)
}

/// Makes a function return whether it discarded. It goes on after a discard, as WGSL does.
fn return_discarded(function: &mut Function, bool: Handle<Type>) {
    let yes = Expression::Literal(Literal::Bool(true));
    let no = Expression::Literal(Literal::Bool(false));
    let init = function.expressions.append(no, Span::UNDEFINED);
    let yes = function.expressions.append(yes, Span::UNDEFINED);
    let fails = LocalVariable {
        name: Some("fails".to_owned()),
        ty: bool,
        init: Some(init),
    };
    let fails = function.local_variables.append(fails, Span::UNDEFINED);
    let fails = Expression::LocalVariable(fails);
    let pointer = function.expressions.append(fails, Span::UNDEFINED);
    let discard = Statement::Store {
        pointer,
        value: yes,
    };
    naga_operands::visit_mut(&mut function.body, &mut |statement| {
        if matches!(statement, Statement::Kill) {
            *statement = discard.clone();
        }
    });
    function.result = Some(FunctionResult {
        ty: bool,
        binding: None,
    });
    returns::rewrite(function, &mut |writer, _| {
        Some(writer.expression(Expression::Load { pointer }))
    });
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use preshade_plan::program::Program;
    use preshade_plan::state::MaterialState;
    use preshade_validate::{Effort, validate};
    use shader_text::source::{Language, SourceMap};

    const WORK: &str = "var sum = 0.0;
    for (var i = 0; i < 8; i++) { sum += sin(in.x * f32(i)) * cos(in.y); }";

    fn plan(globals: &str, body: &str) -> Plan {
        let source = format!(
            "@group(0) @binding(0) var leaf: texture_2d<f32>;
             @group(0) @binding(1) var filtering: sampler;
             {globals}
             struct Out {{ @builtin(position) p: vec4<f32>, @location(0) uv: vec2<f32> }}
             @vertex fn vs(@location(0) p: vec4<f32>) -> Out {{ return Out(p, p.zw); }}
             @fragment fn fs(@location(0) in: vec2<f32>) -> @location(0) vec4<f32> {{ {body} }}"
        );
        let module = naga::front::wgsl::parse_str(&source).unwrap();
        let mut sources = SourceMap::new();
        sources.add("test.wgsl", &source);
        let program = Program::new(module, Arc::new(sources), Language::Wgsl).unwrap();
        Plan::original("test", program, "vs", Some("fs"), &MaterialState::default())
    }

    fn run(plan: &Plan) -> Result<Plan, String> {
        let done = EarlyAlpha::run(plan, &Facts::default(), &EarlyAlphaParams::default());
        done.map(|done| done.plan).map_err(|r| r.first().code)
    }

    #[test]
    fn the_survivors_are_the_same() {
        let bodies = [
            "if textureSample(leaf, filtering, in).a < 0.5 { discard; }",
            "if in.x < 0.2 { discard; } else if in.y < 0.3 { discard; }",
            "for (var i = 0; i < 4; i++) { if in.x * f32(i) > 2.0 { discard; } }",
            "switch i32(in.x) { case 0: { discard; } case 1: { sum = 2.0; } default: { } }",
            "if in.x > 0.9 { return vec4(1.0); } if in.y > 0.9 { discard; }",
        ];
        for body in bodies {
            let original = plan("", &format!("{WORK} {body} return vec4(sum);"));
            let variant = run(&original).unwrap();
            assert_eq!(variant.contract.kind(), "exact");
            let checks = validate(&original, &variant, &Effort::default());
            assert!(
                checks.iter().all(|c| !c.verdict.is_broken()),
                "{body}: {checks:#?}"
            );
            assert!(
                checks.iter().any(|c| c.verdict.holds()),
                "{body}: {checks:#?}"
            );
        }
    }

    /// A private variable that the test writes is as it was when the author's code starts.
    #[test]
    fn the_test_leaves_no_trace() {
        let body = format!(
            "let had = calls; {WORK} calls += 1.0; if in.x < calls * 0.3 {{ \
             discard; }} return vec4(sum, had, calls, 1.0);"
        );
        let original = plan("var<private> calls: f32;", &body);
        let variant = run(&original).unwrap();
        let checks = validate(&original, &variant, &Effort::default());
        assert!(checks.iter().all(|c| !c.verdict.is_broken()), "{checks:#?}");
    }

    #[test]
    fn each_refusal_is_named() {
        let stored = "@group(0) @binding(2) var<storage, read_write> seen: array<f32>;";
        let test = "if in.x < 0.2 { discard; }";
        let helper = "fn test(x: f32) { if x < 0.2 { discard; } }";
        let endless =
            "var x = in.x; loop { x = x * 0.5; if x < 0.1 { discard; } if x > 4.0 { break; } }";
        for (globals, body, code) in [
            ("", WORK.to_owned(), "no-discard"),
            ("", format!("{test} {WORK}"), "discard-first"),
            (
                "",
                format!("{WORK} if sum < 0.1 {{ discard; }}"),
                "test-costs-most",
            ),
            (helper, format!("{WORK} test(in.x);"), "discard-in-function"),
            (
                stored,
                format!("{WORK} seen[0] = sum; {test}"),
                "discarded-effects",
            ),
            ("", format!("{WORK} {endless}"), "test-loop"),
        ] {
            let original = plan(globals, &format!("{body} return vec4(1.0);"));
            assert_eq!(run(&original).err().as_deref(), Some(code), "{body}");
        }
        let cubes = "let test = textureSample(leaf, filtering, in) * textureSample(leaf, \
                     filtering, in.yx);";
        let body = format!("{cubes} {WORK} if test.a < 0.5 {{ discard; }} return vec4(sum);");
        let refused = run(&plan("", &body)).err();
        assert_eq!(refused.as_deref(), Some("test-costs-most"));
    }
}
