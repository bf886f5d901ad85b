//! Describes a difference in words, with the lines of both authors.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use naga::Span;

use super::differences::BIASED;
use super::draws::Point;
use super::fed::Rule;
use super::quote::{digits, distinguished};
use super::traced::{Decision, Pairing, Run, beginnings, decisions, kills};
use super::trial::{Two, What};
use super::{Class, Finding, Relation, Spot};
use crate::environment::{self, PassStages, TestPoint, Texels};
use crate::levels::Reading;
use crate::proof::{self, SLICE};
use crate::stage::Stage;
use crate::trial;
use preshade_dataflow::graph::Graph;
use preshade_dataflow::slice::{self, Criterion, OutputFilter};
use preshade_plan::program::Program;

/// An input on which two programs differ.
pub(super) struct Example {
    pub(super) point: Point,
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
    /// Slices the fragment stage by the criteria, and the vertex stage by the varyings that it
    /// reads and the position. With `is_of_positions`, slices the position alone.
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

    /// Whether the expression at a place may decide the criteria.
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

/// The finding of an example.
pub(super) fn finding(
    two: &Two<'_>,
    promise: &str,
    what: What,
    class: Class,
    example: &Example,
) -> Finding {
    let read = two.read(&example.rules);
    let inputs = two.inputs(&example.point, example.reading, &example.rules, &read);
    let attached = BTreeMap::new();
    let world = environment::concrete(&inputs, &attached, Texels::Waves);
    let is_discard = example.output[0] == "the fragment";
    let criteria = match is_discard {
        true => vec![Criterion::Discard],
        false => of_components(&example.output).unwrap_or_else(|| two.criteria(what)),
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
    let decisions = match (is_discard, example.output[1] == "kept") {
        (true, true) => {
            let [second, first] = decisions(second, first);
            [first, second]
        }
        (true, false) => decisions(first, second),
        (false, _) => [None, None],
    };
    // A velocity is compared with that of other inputs.
    let spots = match what {
        What::Still(_) => [None, None],
        _ => beginnings(first, second),
    };
    // The values are the same, and the thresholds decide.
    let is_decided = match &decisions {
        [Some(a), Some(b)] => matches!(Pairing::of(a, b), Pairing::Thresholds { .. }),
        // One has a condition that the other lacks.
        [a, b] => a.is_some() || b.is_some(),
    };
    let words = Sentence {
        two,
        class,
        example,
        decisions: &decisions,
        spots: &spots,
    };
    let words = words.text();
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
        seed: Some(example.point.seed),
        inputs: trial::inputs_as_text(two.first, &inputs, example.place),
    }
}

/// The components of an output that differ, if not all do.
fn of_components([output, ours, theirs]: &[String; 3]) -> Option<Vec<Criterion>> {
    let location = output.strip_prefix("location ")?.parse().ok()?;
    let parts = |text: &str| -> Option<Vec<String>> {
        let inner = text.strip_prefix('(')?.strip_suffix(')')?;
        Some(inner.split(", ").map(str::to_owned).collect())
    };
    let pairs = (0..).zip(parts(ours)?.into_iter().zip(parts(theirs)?));
    let differing = pairs.filter(|(_, (a, b))| a != b);
    let location = OutputFilter::Location(location);
    Some(
        differing
            .map(|(i, _)| Criterion::Component(location.clone(), i))
            .collect(),
    )
}

/// The parts of a finding's sentence.
struct Sentence<'a> {
    two: &'a Two<'a>,
    class: Class,
    example: &'a Example,
    decisions: &'a [Option<Decision>; 2],
    spots: &'a [Option<Spot>; 2],
}

impl Sentence<'_> {
    fn text(&self) -> String {
        let [first, second] = self.two.relation.names();
        let [output, ours, theirs] = &self.example.output;
        let [ours, theirs] = match self.class {
            Class::Rounding => [ours.clone(), theirs.clone()],
            _ => distinguished([ours, theirs]),
        };
        let what = match output.as_str() {
            _ if self.class == Class::Undefined => {
                let text = match theirs.is_empty() {
                    true => String::new(),
                    false => format!(" (`{theirs}`)"),
                };
                format!(
                    "{second} computes {output}{text}, which GLSL leaves undefined; {first} does not"
                )
            }
            "the fragment" => self.discard(),
            "position" => format!(
                "{second} puts this vertex at {theirs}, and {first} puts it at {ours}{}",
                self.beginning()
            ),
            BIASED => {
                let end = match self.two.relation {
                    Relation::Shadow => "",
                    _ => "; their depths are never equal",
                };
                format!(
                    "{second} puts this vertex at z = {theirs}, and {first} at z = {ours}, with the same \
                     x, y and w{}{end}",
                    self.beginning()
                )
            }
            "the velocity" if ours.is_empty() => {
                format!("with nothing moving, the velocity is {theirs} at a point in view")
            }
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
                    Some(f) if kills(f.module(), &f.function().body) => "has no such condition",
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

fn compares(who: &str, decision: &Decision) -> String {
    let [(_, left), (_, right)] = &decision.operands;
    format!(
        "in {who}, `{}` compares {} with {}",
        decision.spot.text,
        digits(*left),
        digits(*right)
    )
}
