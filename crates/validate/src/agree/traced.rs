//! Differences between two traced runs: the values, and the comparisons that discard.

use std::collections::BTreeSet;

use naga::{Expression, Function, Handle, Module, Statement};

use super::Spot;
use super::quote::{digits, short, written};
use crate::environment::PassStages;
use crate::stage::Stage;
use naga_interp::{Scalar, Traced, Value};
use preshade_plan::program::Program;

/// One program's run of a slice.
pub(super) struct Run<'a> {
    pub(super) stages: PassStages<'a>,
    pub(super) trace: Vec<Traced>,
}

/// The comparison that decides a discard.
pub struct Decision {
    pub(super) spot: Spot,
    /// Texts and values of its operands.
    pub(super) operands: [(String, f32); 2],
}

impl Run<'_> {
    fn program(&self, traced: &Traced) -> &Program {
        let fragment = self.stages.fragment.map(|f| f.program);
        let all = [fragment, Some(self.stages.vertex.program)];
        let mut all = all.into_iter().flatten();
        all.find(|p| p.sources().file_of(traced.span).is_some())
            .unwrap_or(self.stages.vertex.program)
    }

    /// All floats that it computes.
    fn numbers(&self) -> BTreeSet<u32> {
        let mut all = BTreeSet::new();
        for traced in &self.trace {
            floats(&traced.value, &mut all);
        }
        all
    }

    /// Values that the other run never has.
    fn beyond<'r>(
        &'r self,
        others: &'r BTreeSet<u32>,
    ) -> impl DoubleEndedIterator<Item = &'r Traced> {
        self.trace.iter().filter(|traced| {
            let mut own = BTreeSet::new();
            floats(&traced.value, &mut own);
            // A composition has its parts' numbers.
            let is_computed = !matches!(traced.kind, "Compose" | "Splat" | "Swizzle");
            is_computed
                && !own.is_subset(others)
                && self.program(traced).sources().locate(traced.span).is_some()
        })
    }

    /// The first computed value that the other run never has; or else data.
    fn first_beyond(&self, others: &BTreeSet<u32>) -> Option<Spot> {
        let found = self
            .beyond(others)
            .find(|traced| self.read(traced).is_none());
        let found = found.map(|found| self.spot(found));
        found.or_else(|| self.data_beyond(others))
    }

    /// The last value that this run alone reads from a uniform or a buffer. In a path, the last
    /// access is the longest.
    fn data_beyond(&self, others: &BTreeSet<u32>) -> Option<Spot> {
        let found = self
            .beyond(others)
            .rfind(|traced| self.read(traced) == Some(true));
        found.map(|found| self.spot(found))
    }

    /// The function of a value, if it is still the one that ran.
    fn function(&self, traced: &Traced) -> Option<&Function> {
        let stages = [self.stages.fragment, Some(self.stages.vertex)];
        let functions = stages.into_iter().flatten().filter_map(|stage| {
            let module = stage.module();
            match traced.at.0 {
                Some(handle) => module.functions.try_get(handle).ok(),
                None => Some(stage.function()),
            }
        });
        // The stages of a slice may be two programs of one source.
        let is_it = |f: &&Function| {
            traced.at.1.index() < f.expressions.len()
                && f.expressions.get_span(traced.at.1) == traced.span
        };
        let mut functions = functions.filter(is_it);
        functions.next()
    }

    /// Whether a value is read as it is, from a uniform or a buffer (`true`) or an input; `None`: it
    /// is computed.
    fn read(&self, traced: &Traced) -> Option<bool> {
        let function = self.function(traced)?;
        match function.expressions[path(function, traced.at.1).0] {
            Expression::GlobalVariable(_) => Some(true),
            Expression::FunctionArgument(_) if traced.at.0.is_none() => Some(false),
            _ => None,
        }
    }

    fn spot(&self, traced: &Traced) -> Spot {
        let program = self.program(traced);
        let parts = self.function(traced).map(|f| path(f, traced.at.1).1);
        let text = written(program, traced.span, parts.unwrap_or(0));
        Spot {
            location: program.sources().locate(traced.span),
            text: text.unwrap_or_else(|| traced.kind.to_owned()),
            value: short(&traced.value),
        }
    }

    /// The comparison that discards: of the last branch with a `discard` that was taken.
    fn discards(&self) -> Option<Decision> {
        let fragment = self.stages.fragment?;
        let guards = guards(fragment);
        let is_taken = |t: &Traced| {
            let Value::Scalar(Scalar::Bool(value)) = t.value else {
                return false;
            };
            guards.contains(&(t.at, value))
        };
        let found = self.trace.iter().rposition(is_taken).and_then(|at| {
            let (function, condition) = self.trace[at].at;
            let own = match function {
                Some(handle) => &fragment.module().functions[handle],
                None => fragment.function(),
            };
            let mut of_it = BTreeSet::new();
            comparisons((function, own), vec![condition], &mut of_it);
            let before = self.trace[..=at].iter().rev();
            let mut before = before.filter(|t| t.compared.is_some());
            before.find(|t| of_it.contains(&t.at))
        });
        self.decision(found.or_else(|| self.compared().into_iter().next())?)
    }

    /// The comparisons that branches depend on, the last first; or all, if none is known.
    fn compared(&self) -> Vec<&Traced> {
        let of = |is_exit| {
            let of = |stage| conditions(stage, is_exit);
            self.stages.fragment.map(of).unwrap_or_default()
        };
        let (conditions, exits) = (of(false), of(true));
        let is_exit = |t: &Traced| exits.contains(&t.at) && !conditions.contains(&t.at);
        let all = || {
            let all = self.trace.iter().rev();
            all.filter(|t| t.compared.is_some() && !is_exit(t))
        };
        let deciding: Vec<_> = all().filter(|t| conditions.contains(&t.at)).collect();
        match deciding.is_empty() {
            true => all().collect(),
            false => deciding,
        }
    }

    fn decision(&self, found: &Traced) -> Option<Decision> {
        let fragment = self.stages.fragment?;
        let operands = found.compared.as_ref()?;
        let module = fragment.module();
        let function = match found.at.0 {
            Some(handle) => &module.functions[handle],
            None => fragment.function(),
        };
        let Expression::Binary { left, right, .. } = function.expressions[found.at.1] else {
            return None;
        };
        let program = self.program(found);
        let operand = |e: Handle<Expression>, value: &Value| {
            let number = match value {
                Value::Scalar(Scalar::F32(x)) => *x,
                Value::Scalar(Scalar::I32(x)) => *x as f32,
                Value::Scalar(Scalar::U32(x)) => *x as f32,
                _ => return None,
            };
            Some((called(program, module, function, e), number))
        };
        Some(Decision {
            spot: self.spot(found),
            operands: [operand(left, &operands[0])?, operand(right, &operands[1])?],
        })
    }
}

/// Where two runs begin to differ: in data that each reads, or else in values that either computes.
pub(super) fn beginnings(first: &Run<'_>, second: &Run<'_>) -> [Option<Spot>; 2] {
    let (ours, theirs) = (first.numbers(), second.numbers());
    let data = [first.data_beyond(&theirs), second.data_beyond(&ours)];
    match data.iter().all(Option::is_some) {
        true => data,
        false => [first.first_beyond(&theirs), second.first_beyond(&ours)],
    }
}

/// The last comparisons of a run that may decide: a loop makes very many.
const MOST_COMPARISONS: usize = 1000;

/// The deciding comparison in a program that discards, and in one that keeps the fragment.
pub(super) fn decisions(discards: &Run<'_>, keeps: &Run<'_>) -> [Option<Decision>; 2] {
    let discarding = discards.discards();
    // A comparison with the same operands in both explains nothing.
    let made = |run: &Run<'_>| -> Vec<(Decision, [u32; 2], String)> {
        let last = run.compared().into_iter().take(MOST_COMPARISONS);
        let all = last.filter_map(|traced| {
            let decision = run.decision(traced)?;
            let numbers = decision.operands.each_ref().map(|(_, n)| n.to_bits());
            Some((decision, numbers, short(&traced.value)))
        });
        all.collect()
    };
    let known = made(discards).into_iter();
    let known: BTreeSet<_> = known.map(|(_, numbers, value)| (numbers, value)).collect();
    let all = made(keeps).into_iter();
    let all = all.filter(|(_, numbers, value)| !known.contains(&(*numbers, value.clone())));
    let mut all: Vec<Decision> = all.map(|(decision, ..)| decision).collect();
    let paired = discarding.as_ref().and_then(|discarding| {
        let mut all = all.iter();
        all.position(|kept| !matches!(Pairing::of(kept, discarding), Pairing::Apart))
    });
    let keeping = match all.is_empty() {
        true => None,
        false => Some(all.swap_remove(paired.unwrap_or(0))),
    };
    [discarding, keeping]
}

/// The expression that members, elements and loads lead to, and the number of members and elements.
fn path(function: &Function, mut e: Handle<Expression>) -> (Handle<Expression>, usize) {
    let mut parts = 0;
    loop {
        match function.expressions[e] {
            Expression::AccessIndex { base, .. } | Expression::Access { base, .. } => {
                parts += 1;
                e = base;
            }
            Expression::Load { pointer } => e = pointer,
            _ => return (e, parts),
        }
    }
}

/// A function of a stage, `None` for the entry point's, and an expression.
type At = (Option<Handle<Function>>, Handle<Expression>);

/// The conditions of branches that discard, and their values then.
fn guards(stage: Stage<'_>) -> BTreeSet<(At, bool)> {
    let module = stage.module();
    let mut all = BTreeSet::new();
    let mut of = |handle: Option<Handle<Function>>, function: &Function| {
        naga_operands::visit(&function.body, &mut |statement| {
            if let Statement::If {
                condition,
                accept,
                reject,
            } = statement
            {
                let sides = [(true, accept), (false, reject)];
                let sides = sides.into_iter().filter(|(_, side)| kills(module, side));
                all.extend(sides.map(|(value, _)| ((handle, *condition), value)));
            }
        });
    };
    of(None, stage.function());
    for function in naga_operands::calls::called(module, &stage.function().body) {
        of(Some(function), &module.functions[function]);
    }
    all
}

/// Whether a block discards, itself or in a function.
pub(super) fn kills(module: &Module, block: &naga::Block) -> bool {
    let mut found = false;
    let mut look = |block| {
        naga_operands::visit(block, &mut |s| found |= matches!(s, Statement::Kill));
    };
    look(block);
    for function in naga_operands::calls::called(module, block) {
        look(&module.functions[function].body);
    }
    found
}

/// The comparisons that branches of a stage depend on, by function; or those that end loops.
fn conditions(stage: Stage<'_>, is_exit: bool) -> BTreeSet<At> {
    let module = stage.module();
    let mut all = BTreeSet::new();
    let mut of = |handle: Option<Handle<Function>>, function: &Function| {
        let mut pending = Vec::new();
        naga_operands::visit(&function.body, &mut |statement| {
            if let Statement::If {
                condition,
                accept,
                reject,
            } = statement
                && [accept, reject].iter().any(|b| is_break(b)) == is_exit
            {
                pending.push(*condition);
            }
        });
        comparisons((handle, function), pending, &mut all);
    };
    of(None, stage.function());
    for function in naga_operands::calls::called(module, &stage.function().body) {
        of(Some(function), &module.functions[function]);
    }
    all
}

fn is_break(block: &naga::Block) -> bool {
    let mut block = block.iter();
    matches!(block.next(), Some(Statement::Break)) && block.next().is_none()
}

/// Adds the operations that some conditions of a function consist of.
fn comparisons(
    (handle, function): (Option<Handle<Function>>, &Function),
    mut pending: Vec<Handle<Expression>>,
    all: &mut BTreeSet<At>,
) {
    let mut stored = Vec::new();
    naga_operands::visit(&function.body, &mut |statement| {
        if let Statement::Store { pointer, value } = statement {
            stored.push((*pointer, *value));
        }
    });
    while let Some(e) = pending.pop() {
        if !all.insert((handle, e)) {
            continue;
        }
        let operation = &function.expressions[e];
        match operation {
            Expression::Unary { .. }
            | Expression::Binary { .. }
            | Expression::Relational { .. }
            | Expression::Select { .. } => pending.extend(naga_operands::of_expression(operation)),
            // `&&` and `||` store their result.
            Expression::Load { pointer } => {
                let variable = &function.expressions[*pointer];
                let is_it = |(to, _): &&(_, _)| function.expressions[*to] == *variable;
                pending.extend(stored.iter().filter(is_it).map(|(_, value)| *value));
            }
            _ => {}
        }
    }
}

fn floats(value: &Value, all: &mut BTreeSet<u32>) {
    match value {
        Value::Scalar(Scalar::F32(x)) => {
            all.insert(x.to_bits());
        }
        Value::Composite(parts) => parts.iter().for_each(|p| floats(p, all)),
        _ => {}
    }
}

/// The name of an operand, or the author's text.
fn called(
    program: &Program,
    module: &Module,
    function: &Function,
    e: Handle<Expression>,
) -> String {
    match &function.expressions[e] {
        Expression::Literal(_) => String::new(),
        Expression::Constant(c) => module.constants[*c].name.clone().unwrap_or_default(),
        _ => match function.named_expressions.get(&e) {
            Some(name) => name.clone(),
            None => {
                let span = function.expressions.get_span(e);
                written(program, span, path(function, e).1).unwrap_or_default()
            }
        },
    }
}

/// How the operands of two comparisons correspond.
pub(super) enum Pairing {
    Thresholds {
        name: String,
        value: String,
        kept: String,
        discarded: String,
    },
    /// They share the threshold, and compare different values.
    Values {
        kept: String,
        discarded: String,
        threshold: String,
    },
    /// They share neither.
    Apart,
}

impl Pairing {
    pub(super) fn of(kept: &Decision, discarded: &Decision) -> Self {
        let named = |(name, number): &(String, f32)| match name.is_empty() {
            true => digits(*number),
            false => format!("`{name}` = {}", digits(*number)),
        };
        let number = |(_, number): &(String, f32)| digits(*number);
        let flipped = |[a, b]: &[(String, f32); 2]| [b.clone(), a.clone()];
        let is_one = |a: &(String, f32), b: &(String, f32)| a.1.to_bits() == b.1.to_bits();
        let (a, b) = (&kept.operands, &discarded.operands);
        for (a, b) in [
            (a.clone(), b.clone()),
            (a.clone(), flipped(b)),
            (flipped(a), b.clone()),
            (flipped(a), flipped(b)),
        ] {
            let ([value, threshold], [other, limit]) = (&a, &b);
            let is_fixed = value.0.is_empty();
            if is_one(value, other) && !is_one(threshold, limit) && !is_fixed {
                let name = match value.0.as_str() {
                    "" => String::new(),
                    name => format!("`{name}` = "),
                };
                let (kept, discarded) = (number(threshold), number(limit));
                if kept == discarded {
                    return Self::Apart;
                }
                return Self::Thresholds {
                    name,
                    value: digits(value.1),
                    kept,
                    discarded,
                };
            }
            if is_one(threshold, limit) && !is_one(value, other) && threshold.0 != value.0 {
                return Self::Values {
                    kept: named(value),
                    discarded: named(other),
                    threshold: digits(threshold.1),
                };
            }
        }
        Self::Apart
    }
}
