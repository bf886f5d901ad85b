//! Says a difference in words, with the lines of both authors.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use naga::{Expression, Function, Handle, Module, Span, Statement};

use super::fed::Rule;
use super::quote::{digits, fewer, short, written};
use super::trial::{Two, What};
use super::{Class, Finding, Spot};
use crate::core::operands;
use crate::core::program::Program;
use crate::evaluate::{Scalar, Traced, Value};
use crate::graph::Graph;
use crate::slice::{self, Criterion, OutputFilter};
use crate::validate::levels::Reading;
use crate::validate::proof::{self, SLICE};
use crate::validate::stage::Stage;
use crate::validate::trial;
use crate::validate::world::{self, PassStages, TestPoint, Texels};

/// An input on which two programs differ.
pub(super) struct Example {
    pub(super) seed: u64,
    pub(super) place: TestPoint,
    /// The differing output, the first's value and the second's.
    pub(super) output: [String; 3],
    pub(super) reading: Reading,
    pub(super) rules: Vec<Rule>,
}

/// The slices of a material as programs.
pub(super) struct Sliced {
    vertex: Option<Program>,
    fragment: Option<Program>,
    is_of_positions: bool,
    /// Places of the vertex stage that decide the position alone, which a fragment does not depend
    /// on.
    of_position: BTreeSet<SpanRange>,
}

/// Start and end of a span.
type SpanRange = (usize, usize);

impl Sliced {
    /// What decides the criteria in the fragment stage, and its inputs and the position in the vertex
    /// stage; or the position alone.
    pub(super) fn of(
        stages: PassStages<'_>,
        criteria: &[Criterion],
        is_of_positions: bool,
    ) -> Self {
        // Both stages are of one program.
        let graph = Graph::build(stages.vertex.program);
        let fragment = stages.fragment.filter(|_| !is_of_positions);
        let fragment = fragment.and_then(|f| proof::placed(&graph, f, criteria));
        let read = fragment.as_ref().and_then(|program| {
            let stage = Stage::new(program, naga::ShaderStage::Fragment, SLICE)?;
            Some(
                stage
                    .inputs()
                    .into_iter()
                    .filter_map(|io| io.binding)
                    .collect::<Vec<_>>(),
            )
        });
        let varyings = proof::locations(&read.unwrap_or_default());
        let position = Criterion::Output(OutputFilter::Rasterization);
        let of_position = match is_of_positions {
            true => BTreeSet::new(),
            false => {
                let spans = |stage, criteria: &[Criterion]| spans(&graph, stage, criteria);
                let mut own = spans(stages.vertex, std::slice::from_ref(&position));
                let mut others = spans(stages.vertex, &varyings);
                others.extend(stages.fragment.iter().flat_map(|f| spans(*f, criteria)));
                own.retain(|span| !others.contains(span));
                own
            }
        };
        let wanted = [varyings, vec![position]].concat();
        Self {
            vertex: proof::placed(&graph, stages.vertex, &wanted),
            fragment,
            is_of_positions,
            of_position,
        }
    }

    /// The slices of both programs.
    pub(super) fn of_both(
        two: &Two<'_>,
        criteria: &[Criterion],
        is_of_positions: bool,
    ) -> [Self; 2] {
        [two.first, two.second].map(|stages| Self::of(stages, criteria, is_of_positions))
    }

    /// Whether what is at a place may decide the criteria.
    pub(super) fn decides(&self, span: Span) -> bool {
        let range = span.to_range();
        range.is_none_or(|r| !self.of_position.contains(&(r.start, r.end)))
    }

    /// The slices, or the whole stages where there is none.
    pub(super) fn stages<'s>(&'s self, whole: PassStages<'s>) -> PassStages<'s> {
        use naga::ShaderStage as S;
        let stage = |program: &'s Option<Program>, kind| {
            program.as_ref().and_then(|p| Stage::new(p, kind, SLICE))
        };
        let fragment = whole.fragment.filter(|_| !self.is_of_positions);
        PassStages {
            vertex: stage(&self.vertex, S::Vertex).unwrap_or(whole.vertex),
            fragment: fragment.map(|f| stage(&self.fragment, S::Fragment).unwrap_or(f)),
        }
    }
}

/// The places that a slice keeps.
fn spans(graph: &Graph<'_>, stage: Stage<'_>, criteria: &[Criterion]) -> BTreeSet<SpanRange> {
    let slice = slice::backward(graph, stage.entry, criteria);
    let of_part = |part: &slice::Part| {
        let function = graph.function(part.function).function;
        let kept = part.kept.expressions.iter();
        let kept = function
            .expressions
            .iter()
            .zip(kept)
            .filter(|(_, need)| need.is_some());
        let spans = kept.filter_map(|((e, _), _)| function.expressions.get_span(e).to_range());
        spans.map(|r| (r.start, r.end)).collect::<Vec<_>>()
    };
    slice.parts.iter().flat_map(of_part).collect()
}

/// One program's run of a slice.
struct Run<'a> {
    stages: PassStages<'a>,
    trace: Vec<Traced>,
}

/// The comparison that decides a discard.
struct Decision {
    spot: Spot,
    /// Texts and values of its operands.
    operands: [(String, f32); 2],
}

/// The finding of an example.
pub(super) fn finding(
    two: &Two<'_>,
    promise: &str,
    what: What,
    class: Class,
    example: &Example,
) -> Finding {
    let read = two.read(&example.rules);
    let inputs = two.inputs(example.seed, example.reading, &example.rules, &read);
    let attached = BTreeMap::new();
    let world = world::concrete(&inputs, &attached, Texels::Waves);
    let is_discard = example.output[0] == "the fragment";
    let criteria = match is_discard {
        true => vec![Criterion::Discard],
        false => two.criteria(what),
    };
    let is_of_positions = what == What::Positions;
    let sliced = Sliced::of_both(two, &criteria, is_of_positions);
    let run = |sliced: &'_ Sliced, whole| {
        let stages = sliced.stages(whole);
        let trace = RefCell::new(Vec::new());
        let _ = world.run(stages, example.place, 4 * two.effort.steps, Some(&trace));
        let mut trace = trace.into_inner();
        trace.retain(|traced| sliced.decides(traced.span));
        trace
    };
    let runs = [
        Run {
            stages: sliced[0].stages(two.first),
            trace: run(&sliced[0], two.first),
        },
        Run {
            stages: sliced[1].stages(two.second),
            trace: run(&sliced[1], two.second),
        },
    ];
    let [first, second] = &runs;
    let decisions = match is_discard {
        true => [first.decision(), second.decision()],
        false => [None, None],
    };
    let spots = [
        first.first_beyond(&second.numbers()),
        second.first_beyond(&first.numbers()),
    ];
    // The values are the same, and the thresholds decide.
    let is_decided = match &decisions {
        [Some(a), Some(b)] => matches!(Pairing::of(a, b), Pairing::Thresholds { .. }),
        _ => false,
    };
    let words = Sentence {
        two,
        class,
        example,
        decisions: &decisions,
        spots: &spots,
    };
    let words = words.said();
    let [first, second] = spots.map(|spot| spot.filter(|_| !is_decided));
    let [first_decides, second_decides] = decisions.map(|d| d.map(|d| d.spot));
    Finding {
        class,
        promise: promise.to_owned(),
        words,
        first: first.or_else(|| first_decides.clone()),
        second: second.or_else(|| second_decides.clone()),
        first_decides,
        second_decides,
        output: Some(example.output.clone()),
        seed: Some(example.seed),
        inputs: trial::said(two.first, &inputs, example.place),
    }
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

    /// The first computed value that the other run never has.
    fn first_beyond(&self, others: &BTreeSet<u32>) -> Option<Spot> {
        let is_new = |traced: &&Traced| {
            let mut own = BTreeSet::new();
            floats(&traced.value, &mut own);
            // A composition has its parts' numbers.
            let is_computed = !matches!(traced.kind, "Compose" | "Splat" | "Swizzle");
            is_computed && !own.is_subset(others) && !self.is_read(traced)
        };
        let found = self.trace.iter().find(is_new)?;
        Some(self.spot(found)).filter(|spot| spot.location.is_some())
    }

    /// Whether a value is read from a uniform or a buffer as it is.
    fn is_read(&self, traced: &Traced) -> bool {
        let stages = [self.stages.fragment, Some(self.stages.vertex)];
        let mut stages = stages.into_iter().flatten();
        // The stages of a slice may be two programs of one source.
        stages.any(|stage| {
            let module = stage.module();
            let function = match traced.at.0 {
                Some(handle) => module.functions.try_get(handle).ok(),
                None => Some(stage.function()),
            };
            let is_it = |f: &&Function| {
                traced.at.1.index() < f.expressions.len()
                    && f.expressions.get_span(traced.at.1) == traced.span
            };
            let Some(function) = function.filter(is_it) else {
                return false;
            };
            let mut e = traced.at.1;
            loop {
                match function.expressions[e] {
                    Expression::AccessIndex { base, .. } => e = base,
                    Expression::Load { pointer } => e = pointer,
                    Expression::GlobalVariable(_) => return true,
                    _ => return false,
                }
            }
        })
    }

    fn spot(&self, traced: &Traced) -> Spot {
        let program = self.program(traced);
        Spot {
            location: program.sources().locate(traced.span),
            text: written(program, traced.span).unwrap_or_else(|| traced.kind.to_owned()),
            value: short(&traced.value),
        }
    }

    /// The last comparison that a branch depends on, or the last one.
    fn decision(&self) -> Option<Decision> {
        let fragment = self.stages.fragment?;
        let conditions = conditions(fragment);
        let compared = || self.trace.iter().rev().filter(|t| t.compared.is_some());
        let found = compared().find(|t| conditions.contains(&t.at));
        let found = found.or_else(|| compared().next())?;
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

/// The comparisons that branches of a stage depend on, by function.
fn conditions(stage: Stage<'_>) -> BTreeSet<(Option<Handle<Function>>, Handle<Expression>)> {
    let module = stage.module();
    let mut all = BTreeSet::new();
    let mut of = |handle: Option<Handle<Function>>, function: &Function| {
        let (mut pending, mut stored) = (Vec::new(), Vec::new());
        operands::visit(&function.body, &mut |statement| match statement {
            Statement::If { condition, .. } => pending.push(*condition),
            Statement::Store { pointer, value } => stored.push((*pointer, *value)),
            _ => {}
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
                | Expression::Select { .. } => pending.extend(operands::of_expression(operation)),
                // `&&` and `||` store their result.
                Expression::Load { pointer } => {
                    let variable = &function.expressions[*pointer];
                    let is_it = |(to, _): &&(_, _)| function.expressions[*to] == *variable;
                    pending.extend(stored.iter().filter(is_it).map(|(_, value)| *value));
                }
                _ => {}
            }
        }
    };
    of(None, stage.function());
    for function in crate::core::calls::called(module, &stage.function().body) {
        of(Some(function), &module.functions[function]);
    }
    all
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

/// What an operand is called: its name, or the author's text.
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
            None => written(program, function.expressions.get_span(e)).unwrap_or_default(),
        },
    }
}

/// What a finding says.
struct Sentence<'a> {
    two: &'a Two<'a>,
    class: Class,
    example: &'a Example,
    decisions: &'a [Option<Decision>; 2],
    spots: &'a [Option<Spot>; 2],
}

impl Sentence<'_> {
    fn said(&self) -> String {
        let [first, second] = self.two.relation.names();
        let [output, ours, theirs] = &self.example.output;
        let [ours, theirs] = [ours, theirs].map(|text| match self.class {
            Class::Rounding => text.clone(),
            _ => fewer(text),
        });
        let what = match output.as_str() {
            "the fragment" => self.discard(),
            "position" => format!(
                "{second} puts this vertex at {theirs}, and {first} puts it at {ours}{}",
                self.beginning()
            ),
            "the velocity" => {
                format!("with nothing moving, the velocity is {theirs} here and {ours} elsewhere")
            }
            _ => format!(
                "{output} is {ours} in {first} and {theirs} in {second}{}",
                self.beginning()
            ),
        };
        match self.class {
            Class::LevelOnly => format!("{what}; they agree where every mip level is the same"),
            Class::ViewDependent => format!(
                "{what}; they agree where both see the same view, but in a frame each sees its own"
            ),
            Class::Rounding => format!("{what}: they round otherwise"),
            Class::Extreme => format!("{what}, for infinite, huge or undefined numbers alone"),
            _ => what,
        }
    }

    /// Where the two begin to differ.
    fn beginning(&self) -> String {
        match self.spots {
            [Some(a), Some(b)] if self.class == Class::Rounding => {
                format!(" (`{}` against `{}`)", a.text, b.text)
            }
            [Some(a), Some(b)] => format!(
                ": `{}` is {}, and `{}` is {}",
                a.text, a.value, b.text, b.value
            ),
            [Some(a), None] => {
                let [_, second] = self.two.relation.names();
                format!(": {second} has nothing like `{}`", a.text)
            }
            [None, Some(b)] => {
                let [first, _] = self.two.relation.names();
                format!(": {first} has nothing like `{}`", b.text)
            }
            [None, None] => String::new(),
        }
    }

    fn discard(&self) -> String {
        let names = self.two.relation.names();
        let is_kept_by_first = self.example.output[1] == "kept";
        let (keeper, discarder) = if is_kept_by_first { (0, 1) } else { (1, 0) };
        let (keeps, discards) = (names[keeper], names[discarder]);
        let plain = format!("{keeps} keeps this fragment, and {discards} discards it");
        match (&self.decisions[keeper], &self.decisions[discarder]) {
            (Some(a), Some(b)) => match Pairing::of(a, b) {
                Pairing::Thresholds {
                    name,
                    value,
                    kept,
                    discarded,
                } => format!(
                    "{keeps} keeps this fragment at {name}{value}, {discards} discards it: its \
                     threshold is {discarded}, not {kept}"
                ),
                Pairing::Values {
                    kept,
                    discarded,
                    threshold,
                } => format!(
                    "{keeps} keeps this fragment at {kept}, {discards} discards it at {discarded}; \
                     the threshold is {threshold}"
                ),
                Pairing::Apart => format!(
                    "{plain}: {}, and {}",
                    compares(keeps, a),
                    compares(discards, b)
                ),
            },
            (None, Some(b)) => {
                let stages = if keeper == 0 {
                    self.two.first
                } else {
                    self.two.second
                };
                let why = match stages.fragment {
                    Some(f) if may_discard(f) => "decides otherwise",
                    _ => "never discards",
                };
                format!("{plain}: {}, and {keeps} {why}", compares(discards, b))
            }
            (Some(a), None) => format!(
                "{plain}: {}, and {discards} discards always",
                compares(keeps, a)
            ),
            (None, None) => plain,
        }
    }
}

fn may_discard(stage: Stage<'_>) -> bool {
    let module = stage.module();
    let mut found = false;
    let mut look = |function: &Function| {
        operands::visit(&function.body, &mut |s| {
            found |= matches!(s, Statement::Kill)
        });
    };
    look(stage.function());
    for function in crate::core::calls::called(module, &stage.function().body) {
        look(&module.functions[function]);
    }
    found
}

fn compares(who: &str, decision: &Decision) -> String {
    let [(_, left), (_, right)] = &decision.operands;
    format!(
        "in {who}, `{}` compares {} with {}",
        decision.spot.text,
        digits(*left),
        digits(*right)
    )
}

/// How the operands of two comparisons correspond.
enum Pairing {
    /// One value, two thresholds.
    Thresholds {
        name: String,
        value: String,
        kept: String,
        discarded: String,
    },
    /// One threshold, two values.
    Values {
        kept: String,
        discarded: String,
        threshold: String,
    },
    /// Neither.
    Apart,
}

impl Pairing {
    fn of(kept: &Decision, discarded: &Decision) -> Self {
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
