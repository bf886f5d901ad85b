//! Counts a program as the draws of a scene run it.
//!
//! The static cost model counts both arms of a branch and guesses the iterations of a loop. In such
//! a comparison, a variant without code that no draw runs would look faster, and one with a loop of
//! known length slower or faster, although both run the same code as the original. So both sides of
//! a comparison are counted with the same facts.

use std::collections::BTreeMap;

use super::assume::Assumptions;
use super::decision::{DecisionKind, Noted, Record};
use super::{SpecializeParams, folded};
use preshade_dataflow::graph::cost::DEFAULT_TRIPS;
use preshade_dataflow::graph::{FunctionId, Graph, StmtId, counted};
use preshade_plan::pass::Facts;
use preshade_plan::plan::GpuPass;
use preshade_plan::program::Program;

/// The graph of a program whose costs are those of the draws of `material`: without the arms that none
/// of them takes, and with the iterations that all of them run. `pass` names the entry points.
pub fn as_drawn<'p>(
    program: &'p Program,
    pass: &GpuPass,
    material: &str,
    facts: &Facts,
) -> Graph<'p> {
    let graph = Graph::build(program);
    let assumptions = match Assumptions::new(program, material, facts, None) {
        Ok(assumptions) if !assumptions.values.is_empty() => assumptions,
        _ => return graph,
    };
    let params = SpecializeParams::default();
    let folded = folded(&graph, pass, &assumptions, (facts, material), &params);
    weighed(graph, &folded.stages, &folded.records)
}

/// A graph whose costs are those of a draw that takes the decisions of these records.
pub(super) fn weighed<'p>(
    graph: Graph<'p>,
    stages: &[(&str, Record)],
    records: &[Record],
) -> Graph<'p> {
    let records = || stages.iter().map(|(_, record)| record).chain(records);
    // Ranges of statements. A function is folded for each way in which it is called, and a body for each
    // iteration.
    let mut met: BTreeMap<(FunctionId, StmtId, StmtId), Vec<f64>> = BTreeMap::new();
    let mut add = |function, (first, end), weight: f64| {
        met.entry((function, first, end)).or_default().push(weight);
    };
    for (function, at, turns) in records().flat_map(|r| &r.turns) {
        let f = graph.function(*function);
        let guessed = counted::trips(graph.module(), f, *at).map_or(DEFAULT_TRIPS, f64::from);
        let all = (*at, f.statements.get(*at).end);
        add(*function, all, f64::from(*turns) / guessed.max(1.0));
    }
    for note in records().flat_map(|r| &r.notes) {
        let Noted::Decision(decision) = note else {
            continue;
        };
        if matches!(decision.kind, DecisionKind::Loop { .. }) {
            continue;
        }
        for (arm, ranges) in decision.arms.iter().enumerate() {
            let is_taken = decision.taken.is_none_or(|taken| taken == arm);
            for range in &ranges.statements {
                add(decision.function, *range, f64::from(u8::from(is_taken)));
            }
        }
    }
    let mut weights: BTreeMap<FunctionId, Vec<f64>> = BTreeMap::new();
    for ((function, first, end), each) in met {
        let weight = each.iter().sum::<f64>() / each.len() as f64;
        let statements = graph.function(function).statements.len();
        let of = weights.entry(function);
        let of = of.or_insert_with(|| vec![1.0; statements]);
        for at in &mut of[first.index()..end.index()] {
            *at *= weight;
        }
    }
    graph.weighed(|function, at| {
        let of = weights.get(&function);
        of.map_or(1.0, |of| of[at.index()])
    })
}
