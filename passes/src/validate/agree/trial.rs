//! Proves the promises of a relation, or tries them on inputs and sorts the differences by class.

use std::collections::BTreeMap;
use std::sync::Arc;

use naga::BuiltIn;

use super::fed::{self, Rule};
use super::matching::Matching;
use super::words::{self, Example};
use super::{Class, Finding, Held, Outcome, Relation, reads};
use crate::core::reflect::Io;
use crate::core::state::DepthDirection;
use crate::evaluate::{Number, Scalar, Stuck, Value};
use crate::slice::{Criterion, OutputFilter};
use crate::validate::Effort;
use crate::validate::compare::{self, Colors, Depths, Discards, Positions, Stores, text};
use crate::validate::inputs::{Inputs, Profile};
use crate::validate::levels::Reading;
use crate::validate::proof;
use crate::validate::stage::{POSITION, Ran, Slot, Stage};
use crate::validate::term::{self, Symbolic};
use crate::validate::world::{self, PassStages, TestPoint, Texels};

/// One in this many inputs is also run if a proof depends on the slicer.
const BESIDE: u64 = 8;

/// One in this many inputs must end.
const QUOTA: u64 = 4;

/// Two programs, the second in the first one's terms.
pub(super) struct Two<'a> {
    pub(super) first: PassStages<'a>,
    pub(super) second: PassStages<'a>,
    pub(super) matching: &'a Matching,
    pub(super) relation: Relation,
    pub(super) effort: Effort,
    /// The first program's alpha decides coverage.
    pub(super) covers_by_alpha: bool,
    /// Which way its depth grows.
    pub(super) direction: DepthDirection,
}

/// What a promise compares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum What {
    Positions,
    /// Discards, depths, and the alpha that decides coverage.
    Coverage,
    /// All outputs of the fragment stages.
    Colors,
    /// An output of the first and one of the second.
    Outputs(Slot, Slot),
    /// An output of the second, which does not vary.
    Still(Slot),
}

const FRAG_DEPTH: Slot = Slot::BuiltIn(BuiltIn::FragDepth);

/// Examples by class.
#[derive(Default)]
struct Found {
    examples: BTreeMap<Class, Example>,
    ended: u64,
    tried: u64,
    why: Option<String>,
}

impl<'a> Two<'a> {
    /// Checks the promises of the relation.
    pub(super) fn held(&self) -> (Vec<Held>, Vec<Finding>) {
        let (mut held, mut findings) = (Vec::new(), Vec::new());
        for (promise, what) in self.promises() {
            let (outcome, found) = match what {
                Ok(what) => self.promise(promise, what),
                Err(why) => (Outcome::NotEvaluated { why }, Vec::new()),
            };
            held.push(Held {
                promise: promise.to_owned(),
                outcome,
            });
            // Two promises may want the same partner.
            let is_known = |f: &Finding, all: &[Finding]| {
                let is_same = |k: &Finding| k.class == f.class && k.words == f.words;
                f.class == Class::Unmatched && all.iter().any(is_same)
            };
            for finding in found {
                if !is_known(&finding, &findings) {
                    findings.push(finding);
                }
            }
        }
        (held, findings)
    }

    fn promises(&self) -> Vec<(&'static str, Result<What, String>)> {
        use Relation as R;
        let positions = ("positions", Ok(What::Positions));
        let coverage = ("discards and depths", Ok(What::Coverage));
        match self.relation {
            R::Same => vec![positions, coverage, ("colours", Ok(What::Colors))],
            R::Prepass | R::Shadow => vec![positions, coverage],
            R::Position => vec![positions],
            R::Discard => vec![coverage],
            R::Velocity => vec![positions, coverage, ("velocity at rest", self.velocity())],
            R::Normal => vec![positions, coverage, ("normals", self.normal())],
        }
    }

    fn velocity(&self) -> Result<What, String> {
        let outputs = self.second.fragment.map(Stage::outputs).unwrap_or_default();
        let named = named(&outputs, &["velocity", "motion"]);
        let slots = locations(&outputs);
        match (named, &slots[..]) {
            (Some(slot), _) => Ok(What::Still(slot)),
            (None, [one]) => Ok(What::Still(*one)),
            (None, []) => Err("the velocity pass has no output".to_owned()),
            (None, _) => Err(
                "no output of the velocity pass has `velocity` or `motion` in its name".to_owned(),
            ),
        }
    }

    fn normal(&self) -> Result<What, String> {
        let [first, second] = [self.first, self.second].map(|stages| {
            let outputs = stages.fragment.map(Stage::outputs).unwrap_or_default();
            (named(&outputs, &["normal"]), locations(&outputs))
        });
        let theirs = match (second.0, &second.1[..]) {
            (Some(slot), _) => slot,
            (None, [one]) => *one,
            _ => return Err("no output of the normal pass has `normal` in its name".to_owned()),
        };
        let ours = first.0.ok_or(
            "no output of the main pass has `normal` in its name, so there is nothing to compare with",
        )?;
        Ok(What::Outputs(ours, theirs))
    }

    fn places(&self, what: What) -> Vec<TestPoint> {
        match what {
            What::Positions => vec![TestPoint::Vertex],
            What::Colors => vec![
                TestPoint::Corner(0),
                TestPoint::Corner(1),
                TestPoint::Corner(2),
                TestPoint::Inside,
            ],
            _ => vec![TestPoint::Corner(0), TestPoint::Inside],
        }
    }

    fn colors(&self, what: What) -> Colors {
        match what {
            What::Colors | What::Outputs(..) | What::Still(_) => Colors::Bits,
            What::Coverage if self.covers_by_alpha => Colors::Alpha,
            _ => Colors::Ignored,
        }
    }

    fn promise(&self, promise: &str, what: What) -> (Outcome, Vec<Finding>) {
        let lost = self.lost(promise, what);
        if let Some(first) = lost.first() {
            let why = first.words.clone();
            return (Outcome::NotEvaluated { why }, lost);
        }
        if let Some(why) = self.unfilled() {
            return (Outcome::NotEvaluated { why }, Vec::new());
        }
        let is_comparable = !matches!(what, What::Outputs(..) | What::Still(_));
        let places = self.places(what);
        let colors = self.colors(what);
        let compared = self.stores();
        let is_same = |place: &TestPoint| {
            proof::slices_are_same(self.first, self.second, *place, colors, compared)
        };
        let rules = &self.matching.rules;
        if is_comparable && places.iter().all(is_same) {
            let inputs = self.effort.inputs.div_ceil(BESIDE);
            let found = self.tried(what, inputs, Reading::Level, rules);
            if found.examples.is_empty() {
                let outcome = Outcome::Proved {
                    slices: true,
                    inputs: found.ended,
                };
                return (outcome, self.of_view(promise, what));
            }
        }
        let by_terms = || places.iter().all(|place| self.by_terms(what, *place));
        if is_comparable && by_terms() {
            let outcome = Outcome::Proved {
                slices: false,
                inputs: 0,
            };
            return (outcome, self.of_view(promise, what));
        }
        let found = self.tried(what, self.effort.inputs, Reading::Level, rules);
        self.concluded(promise, what, found)
    }

    fn concluded(&self, promise: &str, what: What, found: Found) -> (Outcome, Vec<Finding>) {
        if found.examples.is_empty() {
            let why = match (found.ended, found.why) {
                (0, None) => "no input came to an end within the step limit".to_owned(),
                (0, Some(why)) => why,
                (few, why) if few * QUOTA < found.tried => format!(
                    "only {few} of {} inputs came to an end{}",
                    found.tried,
                    why.map_or(String::new(), |w| format!(": {w}"))
                ),
                (inputs, _) => return (Outcome::Agreed { inputs }, self.of_view(promise, what)),
            };
            return (Outcome::NotEvaluated { why }, Vec::new());
        }
        let without_levels = std::cell::OnceCell::new();
        let mut findings = Vec::new();
        for (class, example) in found.examples {
            let is_of_fragment = matches!(class, Class::KeepsHidden | Class::Loses | Class::Color);
            let is_level = is_of_fragment && {
                let again = || {
                    self.tried(
                        what,
                        self.effort.inputs,
                        Reading::Ignored,
                        &self.matching.rules,
                    )
                };
                !without_levels
                    .get_or_init(again)
                    .examples
                    .contains_key(&class)
            };
            let class = if is_level { Class::LevelOnly } else { class };
            findings.push(words::finding(self, promise, what, class, &example));
        }
        // Kept or lost at another level is one finding.
        let mut seen = std::collections::BTreeSet::new();
        findings.retain(|f| seen.insert(f.class));
        // A worse difference explains those of roundings and of huge numbers.
        let has = |worse: &dyn Fn(Class) -> bool| findings.iter().any(|f| worse(f.class));
        if has(&|c| !matches!(c, Class::Extreme | Class::Rounding)) {
            findings.retain(|f| !matches!(f.class, Class::Extreme | Class::Rounding));
        } else if has(&|c| c == Class::Rounding) {
            findings.retain(|f| f.class == Class::Rounding);
        }
        (Outcome::Differs, findings)
    }

    /// A shadow pass that agrees if it sees the camera's view may disagree where it sees its own.
    fn of_view(&self, promise: &str, what: What) -> Vec<Finding> {
        if self.relation != Relation::Shadow || what != What::Coverage {
            return Vec::new();
        }
        let own: Vec<Rule> = self
            .matching
            .rules
            .iter()
            .filter(|r| !r.is_of_view)
            .cloned()
            .collect();
        if own.len() == self.matching.rules.len() {
            return Vec::new();
        }
        let found = self.tried(what, self.effort.inputs, Reading::Level, &own);
        let mut examples = found.examples.into_iter();
        let seen = examples.find(|(class, _)| matches!(class, Class::KeepsHidden | Class::Loses));
        seen.map(|(_, example)| words::finding(self, promise, what, Class::ViewDependent, &example))
            .into_iter()
            .collect()
    }

    fn stores(&self) -> Stores {
        match self.relation {
            Relation::Same => Stores::Same,
            _ => Stores::Ignored,
        }
    }

    /// What the second program's slice reads and the first does not have.
    fn lost(&self, promise: &str, what: What) -> Vec<Finding> {
        let sliced = words::Sliced::of(self.second, &self.criteria(what), what == What::Positions);
        let stages = sliced.stages(self.second);
        let all = [Some(stages.vertex), stages.fragment];
        let is_read = |at: (u32, u32), steps: &[usize]| {
            let stages = all.into_iter().flatten();
            let mut read =
                stages.flat_map(|stage| reads::parts(stage, &|span| sliced.decides(span)));
            read.any(|(place, read)| place == at && reads::overlap(&read, steps))
        };
        let [_, second] = self.relation.names();
        let finding = |words: String| Finding {
            class: Class::Unmatched,
            promise: promise.to_owned(),
            words,
            first: None,
            second: None,
            first_decides: None,
            second_decides: None,
            output: None,
            seed: None,
            inputs: Vec::new(),
        };
        let lost = self
            .matching
            .lost
            .iter()
            .filter(|l| is_read(l.at, &l.steps));
        let lost = lost.map(|l| {
            let candidates = match &l.candidates[..] {
                [] => String::new(),
                some => format!(
                    " (`--map {}=..` names it: {})",
                    l.name,
                    some.iter()
                        .map(|c| format!("`{c}`"))
                        .collect::<Vec<_>>()
                        .join(", ")
                ),
            };
            finding(format!(
                "{second} reads `{}` ({}), which has no partner{candidates}",
                l.name, l.ty
            ))
        });
        let read = stages.vertex.inputs();
        let inputs = self.matching.lost_inputs.iter().filter(|(location, _)| {
            read.iter().any(|io| {
                matches!(io.binding, Some(naga::Binding::Location { location: l, .. }) if l == **location)
            })
        });
        let inputs = inputs.map(|(_, name)| {
            finding(format!(
                "{second} reads the attribute `{name}`, which has no partner"
            ))
        });
        lost.chain(inputs).collect()
    }

    /// What decides a promise in the fragment stage.
    pub(super) fn criteria(&self, what: What) -> Vec<Criterion> {
        let output = |slot: Slot| match slot {
            Slot::Location(location, _) => Criterion::Output(OutputFilter::Location(location)),
            Slot::BuiltIn(_) => Criterion::Output(OutputFilter::FragDepth),
        };
        match what {
            What::Outputs(_, theirs) | What::Still(theirs) => {
                vec![output(theirs), Criterion::Discard]
            }
            _ => proof::of_fragment(self.colors(what)),
        }
    }

    fn tried(&self, what: What, inputs: u64, reading: Reading, rules: &[Rule]) -> Found {
        let mut found = Found::default();
        let mut rest = None;
        // Most inputs are tried on slices alone: a discard does not depend on the lights.
        let sliced =
            |stages| words::Sliced::of(stages, &self.criteria(what), what == What::Positions);
        let sliced = [sliced(self.first), sliced(self.second)];
        let slices = [sliced[0].stages(self.first), sliced[1].stages(self.second)];
        for seed in self.effort.seed..self.effort.seed + inputs {
            let inputs = self.inputs(seed, reading, rules);
            found.tried += 1;
            let mut ended = true;
            for place in self.places(what) {
                let tried = match seed.is_multiple_of(BESIDE) || self.stores() == Stores::Same {
                    true => {
                        self.try_one(what, &inputs, place, [self.first, self.second], &mut rest)
                    }
                    false => {
                        let seen = self.try_one(what, &inputs, place, slices, &mut rest);
                        // The whole programs have the last word.
                        match seen {
                            Ok(Some(_)) => {
                                let whole = [self.first, self.second];
                                self.try_one(what, &inputs, place, whole, &mut rest)
                            }
                            seen => seen,
                        }
                    }
                };
                match tried {
                    Ok(None) => {}
                    Ok(Some((class, output))) => {
                        let is_plain = matches!(inputs.profile, Profile::Ordinary | Profile::Equal);
                        let class = match class {
                            class if !is_plain => {
                                let known = found.examples.contains_key(&class);
                                if known { class } else { Class::Extreme }
                            }
                            class => class,
                        };
                        // At a corner, the lines of the vertex stage are known too.
                        let known = found.examples.get(&class);
                        let is_better = known.is_none_or(|k| {
                            is_plain && k.place == TestPoint::Inside && place != TestPoint::Inside
                        });
                        if is_better {
                            let rules = rules.to_vec();
                            let example = Example {
                                seed,
                                place,
                                output,
                                reading,
                                rules,
                            };
                            found.examples.insert(class, example);
                        }
                    }
                    Err(stuck) => {
                        ended = false;
                        if stuck != Stuck::Steps {
                            found.why.get_or_insert(stuck.to_string());
                        }
                    }
                }
            }
            found.ended += u64::from(ended);
            if found.ended == 0 && found.why.is_some() && found.tried > 24 {
                break;
            }
        }
        found
    }

    /// Runs both on one input.
    #[allow(clippy::type_complexity)]
    fn try_one(
        &self,
        what: What,
        inputs: &Inputs,
        place: TestPoint,
        [ours, theirs]: [PassStages<'_>; 2],
        rest: &mut Option<Value>,
    ) -> Result<Option<(Class, [String; 3])>, Stuck> {
        let attached = BTreeMap::new();
        let world = world::concrete(inputs, &attached, Texels::Waves);
        let steps = self.effort.steps;
        let first = world.run(ours, place, steps, None)?;
        let second = world.run(theirs, place, 4 * steps, None)?;
        if let What::Still(slot) = what {
            return Ok(moving(inputs, &second, slot, rest));
        }
        let Some((class, output)) = self.difference(what, &first, &second) else {
            return Ok(None);
        };
        let is_plain = matches!(inputs.profile, Profile::Ordinary | Profile::Equal);
        let is_rounding = is_plain && self.is_rounding(what, inputs, place);
        Ok(Some((
            if is_rounding { Class::Rounding } else { class },
            output,
        )))
    }

    /// Whether the two agree in twice the digits.
    fn is_rounding(&self, what: What, inputs: &Inputs, place: TestPoint) -> bool {
        let world = world::precise(inputs);
        let run = |stages| world.run(stages, place, 4 * self.effort.steps, None);
        let (Ok(first), Ok(second)) = (run(self.first), run(self.second)) else {
            return false;
        };
        if first.discarded != second.discarded {
            return false;
        }
        let slots: Vec<(Slot, Slot)> = match what {
            What::Positions => vec![(POSITION, POSITION)],
            What::Coverage => vec![(FRAG_DEPTH, FRAG_DEPTH)],
            What::Outputs(ours, theirs) => vec![(ours, theirs)],
            What::Colors | What::Still(_) => first.outputs.keys().map(|s| (*s, *s)).collect(),
        };
        slots.iter().all(
            |(a, b)| match (first.outputs.get(a), second.outputs.get(b)) {
                (Some(a), Some(b)) => is_close(a, b),
                (None, None) => true,
                _ => first.discarded,
            },
        )
    }

    /// The first difference that the promise forbids.
    fn difference<F: Number>(
        &self,
        what: What,
        first: &Ran<F>,
        second: &Ran<F>,
    ) -> Option<(Class, [String; 3])> {
        let told = |d: compare::Difference| [d.output, d.original, d.variant];
        let of = |slots: (Slot, Slot), same: &dyn Fn(&Value<F>, &Value<F>) -> bool| {
            let (a, b) = (first.outputs.get(&slots.0), second.outputs.get(&slots.1));
            let said = |v: Option<&Value<F>>| v.map_or("nothing".to_owned(), text);
            match (a, b) {
                (None, None) => None,
                (Some(a), Some(b)) if same(a, b) => None,
                _ => Some([slots.0.to_string(), said(a), said(b)]),
            }
        };
        if what == What::Positions {
            return match self.relation {
                Relation::Same => {
                    let rule = compare::Rule::Vertices(Positions::Bits);
                    compare::difference(rule, first, second).map(told)
                }
                _ => of((POSITION, POSITION), &compare::same_bits),
            }
            .map(|output| (Class::Position, output));
        }
        let said = |discarded: bool| if discarded { "discarded" } else { "kept" }.to_owned();
        match (first.discarded, second.discarded) {
            (true, true) => return None,
            (false, false) => {}
            (a, b) => {
                let class = if a { Class::KeepsHidden } else { Class::Loses };
                // `Colors` has been told already by the coverage.
                let is_told = what != What::Coverage;
                let output = ["the fragment".to_owned(), said(a), said(b)];
                return (!is_told).then_some((class, output));
            }
        }
        match what {
            What::Coverage => {
                let rule = compare::Rule::Fragments {
                    colors: Colors::Ignored,
                    discards: Discards::Same,
                    // It may be biased.
                    depths: match self.relation {
                        Relation::Prepass => Depths::NotNearer(self.direction),
                        _ => Depths::Same,
                    },
                    stores: Stores::Ignored,
                };
                let depth = compare::difference(rule, first, second).map(told);
                let alpha = || {
                    let of_alpha = |v: &Value<F>| v.parts().ok().and_then(|p| p.get(3).cloned());
                    let same = |a: &Value<F>, b: &Value<F>| match (of_alpha(a), of_alpha(b)) {
                        (Some(a), Some(b)) => compare::same_bits(&a, &b),
                        _ => false,
                    };
                    let slot = Slot::Location(0, None);
                    let is_asked = self.covers_by_alpha && second.outputs.contains_key(&slot);
                    is_asked.then(|| of((slot, slot), &same)).flatten()
                };
                depth.or_else(alpha).map(|output| (Class::Depth, output))
            }
            What::Outputs(ours, theirs) => {
                of((ours, theirs), &compare::same_bits).map(|output| (Class::Color, output))
            }
            _ => {
                let rule = compare::Rule::Fragments {
                    colors: Colors::Bits,
                    discards: Discards::Same,
                    depths: Depths::Same,
                    stores: self.stores(),
                };
                let found = compare::difference(rule, first, second);
                found.map(|d| (Class::Color, told(d)))
            }
        }
    }

    fn by_terms(&self, what: What, place: TestPoint) -> bool {
        let inputs = self.inputs(1, Reading::Chosen, &[]);
        let [ours, theirs] = [self.first, self.second].map(|s| s.vertex.module());
        term::proved(self.effort.paths, || {
            let mut world = world::symbolic(ours, &inputs);
            let mut resources: BTreeMap<(u32, u32), Value<Symbolic>> =
                world::buffers_of_terms(theirs);
            resources.extend(Arc::unwrap_or_clone(std::mem::take(&mut world.resources)));
            fed::feed(&self.matching.rules, &mut resources);
            world.resources = Arc::new(resources);
            let first = world.run(self.first, place, self.effort.steps, None)?;
            let second = world.run(self.second, place, 4 * self.effort.steps, None)?;
            if what == What::Colors && first.discarded != second.discarded {
                return Ok(false);
            }
            Ok(self.difference(what, &first, &second).is_none())
        })
        .is_some()
    }
}

/// The output whose name contains one of these words.
fn named(outputs: &[Io], words: &[&str]) -> Option<Slot> {
    let is_it = |io: &&Io| {
        let name = io.name.as_deref().unwrap_or_default().to_lowercase();
        words.iter().any(|w| name.contains(w))
    };
    let found = outputs.iter().find(is_it)?;
    found.binding.as_ref().map(Slot::of)
}

fn locations(outputs: &[Io]) -> Vec<Slot> {
    let slots = outputs
        .iter()
        .filter_map(|io| io.binding.as_ref().map(Slot::of));
    slots.filter(|s| matches!(s, Slot::Location(..))).collect()
}

/// What differs from the velocity at rest on other inputs.
fn moving(
    inputs: &Inputs,
    second: &Ran,
    slot: Slot,
    rest: &mut Option<Value>,
) -> Option<(Class, [String; 3])> {
    let is_plain = matches!(inputs.profile, Profile::Ordinary | Profile::Equal);
    if second.discarded || !is_plain {
        return None;
    }
    let value = second.outputs.get(&slot)?;
    let parts = value
        .parts()
        .map(|p| Value::Composite(p[..p.len().min(2)].to_vec()));
    let value = parts.unwrap_or_else(|_| value.clone());
    let known = rest.get_or_insert_with(|| value.clone());
    let numbers = |v: &Value| {
        v.floats()
            .or_else(|_| v.float().map(|x| vec![x]))
            .unwrap_or_default()
    };
    let mut pairs = numbers(known).into_iter().zip(numbers(&value));
    // A division by w and its product are rounded.
    let is_far = |(a, b): (f32, f32)| (a - b).abs() > 1e-3 * (1.0 + a.abs());
    let differs = pairs.any(is_far);
    differs.then(|| {
        (
            Class::Moves,
            ["the velocity".to_owned(), text(known), text(&value)],
        )
    })
}

/// Whether two values in twice the digits are one, but for rounding.
fn is_close(a: &Value<f64>, b: &Value<f64>) -> bool {
    fn flat(value: &Value<f64>, all: &mut Vec<f64>) -> bool {
        match value {
            Value::Scalar(Scalar::F32(x)) => all.push(*x),
            Value::Composite(parts) => return parts.iter().all(|p| flat(p, all)),
            _ => return false,
        }
        true
    }
    let (mut x, mut y) = (Vec::new(), Vec::new());
    if !(flat(a, &mut x) && flat(b, &mut y)) || x.len() != y.len() {
        return *a == *b;
    }
    let largest = x.iter().fold(1.0_f64, |most, v| most.max(v.abs()));
    x.iter()
        .zip(&y)
        .all(|(a, b)| (a - b).abs() <= largest * 1e-9)
}
