//! The effects of a material that a draw needs, the values that decide this, and the cost of each.
//!
//! An effect is the code behind a draw-uniform condition: a branch on a flag, a weight or a
//! density, or a loop with a uniform count. Its name comes from a list of common identifiers (fog,
//! shadows, ...), or else from the author's identifier.

use std::collections::BTreeSet;

use naga::{Block, Expression, Function, Handle, Module, Statement, TypeInner};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::assume::Assumptions;
use super::decision::{Decision, DecisionKind, Placed};
use super::{SpecializeParams, assumptions, examine, folded};
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_plan::guard::Assumed;
use preshade_plan::pass::{Facts, Refusal};
use preshade_plan::plan::Plan;
use shader_text::source::Location;

/// Effects by their usual identifiers, without case and underscores.
const KNOWN: &[(&str, &[&str])] = &[
    ("fog", &["fog", "mist", "haze"]),
    ("shadows", &["shadow"]),
    ("parallax", &["parallax", "relief", "heightmap"]),
    ("normal mapping", &["normalmap", "normalscale", "bump"]),
    ("clear coat", &["coat"]),
    ("emissive", &["emissive", "emission", "glow"]),
    (
        "alpha test",
        &["alphatest", "cutoff", "cutout", "alphamask", "discard"],
    ),
    ("skinning", &["skin", "joint", "bone"]),
    ("morph targets", &["morph", "blendshape"]),
];

/// The name of an effect that nothing names.
pub const UNNAMED: &str = "unnamed";

/// Whether a draw needs an effect.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum CalledFor {
    /// The condition is proved false.
    No,
    /// Unknown: a value changes between frames or draws.
    Open,
    /// The condition is proved true.
    Yes,
}

/// An effect of a material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Effect {
    /// A common name, or the author's identifier.
    pub name: String,
    /// `vertex` or `fragment`.
    pub stage: String,
    /// Whether the draw needs the effect.
    pub called_for: CalledFor,
    /// The values that decide it.
    pub evidence: Vec<Assumed>,
    /// Static cost of the code behind its conditions, in one run of the stage.
    pub cost: f64,
    /// Location of the first condition.
    pub location: Option<Location>,
}

/// The effects of a plan's main pass under the values in `facts`, most expensive first.
///
/// # Errors
/// The plan cannot be specialised.
pub fn effects(plan: &Plan, facts: &Facts) -> Result<Vec<Effect>, Box<Refusal>> {
    let (pass, program) = examine(plan)?;
    let params = SpecializeParams::default();
    let assumptions = assumptions(plan, program, facts, &params)?;
    let graph = Graph::build(program);
    let decisions =
        folded(&graph, pass, &assumptions, (facts, &plan.material), &params).decisions(&graph);
    let mut found: Vec<Effect> = Vec::new();
    let mut names: Vec<String> = Vec::new();
    for placed in &decisions {
        let decision = &placed.decision;
        let name = name(&graph, decision, &assumptions);
        names.push(name.clone());
        let mut at = placed.within;
        let mut is_part = false;
        while let Some(outer) = at {
            is_part |= names[outer] == name;
            at = decisions[outer].within;
        }
        let (called_for, cost) = called_for(placed);
        let stage = placed.stage.to_owned();
        let span = graph
            .function(decision.function)
            .statements
            .get(decision.statement)
            .span;
        let evidence: Vec<Assumed> = decision
            .sources
            .iter()
            .filter_map(|i| assumptions.values.get(*i).cloned())
            .collect();
        match found
            .iter_mut()
            .find(|e| (&e.name, &e.stage) == (&name, &stage))
        {
            Some(effect) => {
                // The enclosing effect already includes its cost.
                if !is_part {
                    effect.called_for = effect.called_for.max(called_for);
                    effect.cost += cost;
                }
                for assumed in evidence {
                    if !effect.evidence.contains(&assumed) {
                        effect.evidence.push(assumed);
                    }
                }
            }
            None => found.push(Effect {
                name,
                stage,
                called_for,
                evidence,
                cost,
                location: program.sources().locate(span),
            }),
        }
    }
    let mut effects = found;
    effects.sort_by(|a, b| b.cost.total_cmp(&a.cost).then(a.name.cmp(&b.name)));
    Ok(effects)
}

/// Whether the most expensive arm of a decision runs, and its cost.
fn called_for(placed: &Placed) -> (CalledFor, f64) {
    let costs = placed.costs.iter().copied().enumerate();
    let dearest = costs.max_by(|(_, a), (_, b)| a.total_cmp(b));
    let Some((dearest, cost)) = dearest else {
        return (CalledFor::Open, 0.0);
    };
    let decision = &placed.decision;
    let called_for = match (decision.kind, decision.taken) {
        (DecisionKind::Loop { turns: Some(0) }, _) => CalledFor::No,
        (DecisionKind::Loop { turns: Some(_) }, _) => CalledFor::Yes,
        // The count is known but too large to unroll.
        (DecisionKind::Loop { turns: None }, _) if !decision.sources.is_empty() => CalledFor::Yes,
        (_, Some(taken)) if taken == dearest => CalledFor::Yes,
        (_, Some(_)) => CalledFor::No,
        _ => CalledFor::Open,
    };
    (called_for, cost)
}

fn plain(word: &str) -> String {
    word.chars()
        .filter(|c| *c != '_')
        .flat_map(char::to_lowercase)
        .collect()
}

fn name(graph: &Graph<'_>, decision: &Decision, assumptions: &Assumptions) -> String {
    let module = graph.module();
    let f = graph.function(decision.function);
    let mut condition = Vec::new();
    words(graph, decision.function, decision.condition, &mut condition);
    if matches!(decision.kind, DecisionKind::Loop { .. }) {
        // The bound has a better name than the counter.
        let locals = || f.function.local_variables.iter();
        condition.retain(|word| !locals().any(|(_, l)| l.name.as_ref() == Some(word)));
    }
    let sources = decision.sources.iter();
    let assumed: Vec<String> = sources
        .filter_map(|i| assumptions.values.get(*i))
        .map(|a| a.name.rsplit('.').next().unwrap_or(&a.name).to_owned())
        .collect();
    let mut inside = Vec::new();
    for block in naga_operands::blocks(f.statements.get(decision.statement).statement) {
        block_words(module, f.function, block, &mut inside);
    }
    let is_light = |words: &[String]| words.iter().any(|w| plain(w).contains("light"));
    let is_loop = matches!(decision.kind, DecisionKind::Loop { .. });
    if is_loop && (is_light(&condition) || is_light(&assumed)) {
        return "light loop".to_owned();
    }
    let function: Vec<String> = f.function.name.iter().cloned().collect();
    let known = |words: &[String]| {
        words.iter().find_map(|word| {
            let word = plain(word);
            let is = |(_, keys): &&(&str, &[&str])| keys.iter().any(|k| word.contains(k));
            KNOWN.iter().find(is).map(|(name, _)| (*name).to_owned())
        })
    };
    known(&condition)
        .or_else(|| known(&assumed))
        .or_else(|| known(&inside))
        .or_else(|| known(&function))
        // A condition that leaves the function early decides all of it.
        .or_else(|| function.first().filter(|_| decision.leaves).cloned())
        .or_else(|| assumed.first().filter(|_| is_loop).cloned())
        .or_else(|| condition.last().cloned())
        .or_else(|| assumed.first().cloned())
        .unwrap_or_else(|| UNNAMED.to_owned())
}

/// Identifiers in an expression: constants, members, variables and functions, the most specific
/// last.
fn words(graph: &Graph<'_>, id: FunctionId, e: Handle<Expression>, out: &mut Vec<String>) {
    let (module, f) = (graph.module(), graph.function(id));
    let mut named = Vec::new();
    let mut work = vec![e];
    let mut seen = BTreeSet::new();
    while let Some(e) = work.pop() {
        if !seen.insert(e) {
            continue;
        }
        match &f.function.expressions[e] {
            Expression::Constant(c) => named.extend(module.constants[*c].name.clone()),
            Expression::Override(o) => named.extend(module.overrides[*o].name.clone()),
            Expression::CallResult(callee) => {
                out.extend(module.functions[*callee].name.clone());
                if let Some(at) = f.statements.evaluated_at(e)
                    && let Statement::Call { arguments, .. } = f.statements.get(at).statement
                {
                    work.extend(arguments);
                }
            }
            Expression::AccessIndex { base, index } => {
                out.extend(member(module, f.ty(module, *base), *index));
                work.push(*base);
            }
            Expression::Load { pointer } => {
                // The last value of a short-circuit operator, or of a local.
                if let Expression::LocalVariable(v) = f.function.expressions[*pointer] {
                    work.extend(stored(&f.function.body, f.function, v));
                    out.extend(f.function.local_variables[v].name.clone());
                }
                work.push(*pointer);
            }
            expression => work.extend(naga_operands::of_expression(expression)),
        }
    }
    out.append(&mut named);
}

/// Values stored to a whole variable, and the conditions of the branches that select them.
fn stored(
    block: &Block,
    function: &Function,
    variable: Handle<naga::LocalVariable>,
) -> Vec<Handle<Expression>> {
    let mut out = Vec::new();
    for statement in block {
        match statement {
            Statement::Store { pointer, value } if matches!(function.expressions[*pointer], Expression::LocalVariable(v) if v == variable) =>
            {
                out.push(*value);
            }
            Statement::If {
                condition,
                accept,
                reject,
            } => {
                let [a, b] = [accept, reject].map(|b| stored(b, function, variable));
                if !a.is_empty() && !b.is_empty() {
                    out.push(*condition);
                }
                out.extend(a);
                out.extend(b);
            }
            other => {
                for inner in naga_operands::blocks(other) {
                    out.extend(stored(inner, function, variable));
                }
            }
        }
    }
    out
}

/// Identifiers used in a block.
fn block_words(module: &Module, function: &Function, block: &Block, out: &mut Vec<String>) {
    for statement in block {
        match statement {
            Statement::Kill => out.push("discard".to_owned()),
            Statement::Call { function, .. } => {
                out.extend(module.functions[*function].name.clone());
            }
            Statement::Emit(range) => {
                for e in range.clone() {
                    for operand in naga_operands::of_expression(&function.expressions[e]) {
                        if let Expression::GlobalVariable(g) = function.expressions[operand] {
                            out.extend(module.global_variables[g].name.clone());
                        }
                    }
                }
            }
            other => {
                for inner in naga_operands::blocks(other) {
                    block_words(module, function, inner, out);
                }
            }
        }
    }
}

/// Name of a member of a struct, or of a pointer's struct.
fn member(module: &Module, base: &TypeInner, index: u32) -> Option<String> {
    match base {
        TypeInner::Struct { members, .. } => members.get(index as usize)?.name.clone(),
        TypeInner::Pointer { base, .. } => member(module, &module.types[*base].inner, index),
        _ => None,
    }
}
