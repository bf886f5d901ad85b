//! Proves the promises of a relation, or tries them on inputs and sorts the differences by class.

use std::cell::{Cell, OnceCell};
use std::collections::BTreeMap;
use std::sync::Arc;

use super::budget::{Budget, Draw};
use super::causes::covered_by_alpha;
use super::differences::{self, Bias, moving};
use super::draws::{self, Point};
use super::fed::{self, Rule};
use super::matching::Matching;
use super::promise_inputs::{ClassExamples, Seen, State, is_plain};
use super::ties::Ties;
use super::wording::{self, Example, Sliced};
use super::{Class, Finding, Outcome, PromiseResult, Relation, normals, quote, reads};
use crate::compare::{Colors, Stores};
use crate::compared_numbers::Numbers;
use crate::environment::{self, PassStages, TestPoint};
use crate::inputs::Inputs;
use crate::levels::Reading;
use crate::stage::{Ran, Slot};
use crate::term::{self, Symbolic};
use crate::{Effort, proof};
use naga_interp::{Stuck, Undefined, Value};
use preshade_dataflow::graph::effect::Effect;
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_dataflow::slice::{Criterion, OutputFilter};
use preshade_plan::state::DepthDirection;
use shader_text::source::Language;

/// One in this many inputs is run on the whole programs, even where a slice is proved, because the
/// proof depends on the slicer. It is the default share of [validation](crate).
const BESIDE: u64 = 16;

/// One in this many inputs should keep a fragment, and one discard it.
const RARE: u64 = 8;

/// If fewer do, the trial takes this many times as many inputs.
const MORE: u64 = 4;

/// One in this many inputs must end.
const QUOTA: u64 = 4;

/// Of this many seeds, the first [`ORDINARY`] have ordinary numbers.
const PROFILES: u64 = 6;
const ORDINARY: u64 = 3;

/// One input more for this many is solved for.
const SOLVED: u64 = 3;

/// Inputs of a promise whose numbers are looked at.
const TRACED: u64 = 32;

/// Two programs, the second in the first one's terms.
#[derive(Clone)]
pub(super) struct Two<'a> {
    pub(super) first: PassStages<'a>,
    pub(super) second: PassStages<'a>,
    pub(super) matching: &'a Matching,
    pub(super) relation: Relation,
    pub(super) effort: Effort,
    /// The first program's alpha decides coverage.
    pub(super) covers_by_alpha: bool,
    /// Its samples in a pixel.
    pub(super) samples: u32,
    /// Which way its depth grows.
    pub(super) direction: DepthDirection,
    /// The numbers that both programs compare with.
    pub(super) numbers: Arc<Numbers>,
    /// The components of outputs by location, where an author declares fewer than four.
    pub(super) components: BTreeMap<u32, u32>,
    /// The first program as a pass that writes its normal to location 0, if it has no output of it;
    /// or why there is none.
    pub(super) normal: Option<Result<PassStages<'a>, String>>,
    pub(super) budget: &'a Budget,
    /// A result of the first program on some input that GLSL leaves undefined.
    pub(super) undefined: &'a Cell<Option<(Undefined, naga::Span)>>,
}

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
    /// An output of the second, which follows the first one's positions.
    Moving(Slot),
}

impl<'a> Two<'a> {
    /// Checks the promises of the relation.
    pub(super) fn check_promises(&self) -> (Vec<PromiseResult>, Vec<Finding>) {
        let (mut held, mut findings) = (Vec::new(), Vec::new());
        let promises = self.promises();
        let count = promises.len() as u64;
        for (promise, what) in promises {
            self.budget.share(count);
            // A velocity that varies at rest is wrong in motion, too.
            let is_moving = matches!(what, Ok(What::Moving(_)));
            if is_moving && findings.iter().any(|f: &Finding| f.class == Class::Moves) {
                continue;
            }
            let (outcome, found) = match what {
                Ok(what) => self.of_normal(what).promise(promise, what),
                Err(why) => (Outcome::NotEvaluated { why }, Vec::new()),
            };
            held.push(PromiseResult {
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

    /// The places that are compared; of the corners one, since they are alike.
    fn places(what: What, corner: usize) -> Vec<TestPoint> {
        match what {
            What::Positions => vec![TestPoint::Vertex],
            _ => vec![TestPoint::Corner(corner), TestPoint::Inside],
        }
    }

    fn colors(&self, what: What) -> Colors {
        match what {
            What::Colors | What::Outputs(..) | What::Still(_) | What::Moving(_) => Colors::Bits,
            What::Coverage if self.covers_by_alpha => Colors::Alpha,
            _ => Colors::Ignored,
        }
    }

    fn promise(&self, promise: &str, what: What) -> (Outcome, Vec<Finding>) {
        let sliced = Sliced::of_both(self, &self.criteria(what), what == What::Positions);
        let lost = self.lost(promise, &sliced[1]);
        if let Some(first) = lost.first() {
            let why = first.words.clone();
            return (Outcome::NotEvaluated { why }, lost);
        }
        if let Some(why) = self.unfilled() {
            return (Outcome::NotEvaluated { why }, Vec::new());
        }
        if let What::Moving(slot) = what {
            return self.motion(promise, slot, &sliced);
        }
        let is_comparable =
            !matches!(what, What::Outputs(..) | What::Still(_)) && !self.loses_alpha(what);
        let places = Self::places(what, 0);
        let is_same = || {
            let (colors, compared) = (self.colors(what), self.stores(what));
            proof::slices_are_same(self.first, self.second, places[0], colors, compared)
        };
        let tried = |inputs| {
            let rules = &self.matching.rules;
            self.tried((what, &sliced), inputs, Reading::Level, rules, &[])
        };
        if is_comparable && is_same() {
            let found = tried(self.effort.inputs.div_ceil(BESIDE));
            if found.examples.is_empty() {
                let outcome = Outcome::Proved {
                    slices: true,
                    inputs: found.ended,
                };
                return (outcome, self.of_view(promise, (what, &sliced)));
            }
        }
        let by_terms = || places.iter().all(|place| self.by_terms(what, *place));
        if is_comparable && by_terms() {
            let outcome = Outcome::Proved {
                slices: false,
                inputs: 0,
            };
            return (outcome, self.of_view(promise, (what, &sliced)));
        }
        let found = tried(self.effort.inputs);
        self.concluded(promise, (what, &sliced), found)
    }

    fn concluded(
        &self,
        promise: &str,
        (what, sliced): (What, &[Sliced; 2]),
        found: ClassExamples,
    ) -> (Outcome, Vec<Finding>) {
        let mut classes = found.examples.keys();
        let is_equal = classes.all(|c| matches!(c, Class::Extreme | Class::Rounding));
        // Too few inputs are no evidence about a class.
        let is_short = found.is_cut && found.ended * QUOTA < self.effort.inputs;
        if is_equal
            && !is_short
            && found.ended > 0
            && let Some(why) = self.unseen(what, found.seen)
        {
            let why = why.to_owned();
            return (Outcome::NotEvaluated { why }, Vec::new());
        }
        if found.examples.is_empty() || is_short && is_equal {
            let why = match (found.ended, found.why) {
                (few, None) if is_short => format!(
                    "{few} of {} inputs took as many steps as there are for a pair: too expensive",
                    self.effort.inputs
                ),
                (0, None) => "no input came to an end within the step limit".to_owned(),
                (0, Some(why)) => why,
                (few, why) if few * QUOTA < found.tried => format!(
                    "only {few} of {} inputs came to an end{}",
                    found.tried,
                    why.map_or(String::new(), |w| format!(": {w}"))
                ),
                (inputs, _) => {
                    let is_counted = matches!(what, What::Outputs(..) | What::Still(_));
                    let inputs = if is_counted { found.compared } else { inputs };
                    let cut_from = found.is_cut.then_some(self.effort.inputs);
                    return (
                        Outcome::Agreed { inputs, cut_from },
                        self.of_view(promise, (what, sliced)),
                    );
                }
            };
            return (Outcome::NotEvaluated { why }, Vec::new());
        }
        let is_of_fragment =
            |class: &Class| matches!(class, Class::KeepsHidden | Class::Loses | Class::Color);
        let classes = found.examples.keys().copied().filter(is_of_fragment);
        let classes: Vec<Class> = classes.collect();
        // Where a difference is rare, its absence needs more inputs.
        let rarest = found.hits.values().min().copied().unwrap_or(1);
        let enough = found.tried.max(self.effort.inputs / 2);
        let enough = enough * (8 / rarest.max(1)).clamp(1, 8);
        let without_levels = OnceCell::new();
        let mut findings = Vec::new();
        for (class, example) in found.examples {
            let differing = found.differing.get(&class).into_iter().flatten().cloned();
            let differing: Vec<_> = differing
                .chain([(example.point.clone(), example.place)])
                .collect();
            let is_level = is_of_fragment(&class)
                && !found.is_cut
                && self.agree_without_levels((what, sliced), class, &differing)
                && {
                    let again = || {
                        self.tried(
                            (what, sliced),
                            enough,
                            Reading::Ignored,
                            &self.matching.rules,
                            &classes,
                        )
                    };
                    let again = without_levels.get_or_init(again);
                    !again.is_cut && !again.examples.contains_key(&class)
                };
            let class = if is_level { Class::LevelOnly } else { class };
            findings.push(wording::finding(self, promise, what, class, &example));
        }
        // A bias goes one way.
        let is_unseen = found.seen.viewed == 0;
        for finding in findings.iter_mut().filter(|_| is_unseen) {
            if finding.class == Class::DepthBias {
                finding.class = Class::Position;
            }
        }
        if findings.iter().any(|f| f.class == Class::Position) {
            findings.retain(|f| f.class != Class::DepthBias);
        }
        // A loss at another level is no second finding.
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

    /// Whether a fragment stage has a discard.
    fn discards(&self) -> bool {
        let mut fragments = [self.first, self.second]
            .into_iter()
            .flat_map(|s| s.fragment);
        fragments.any(|stage| {
            let graph = Graph::build(stage.program);
            let effects = graph.effects(FunctionId::EntryPoint(stage.entry));
            effects.contains(&Effect::Discard)
        })
    }

    /// Why the inputs are no evidence about fragments.
    fn unseen(&self, what: What, seen: Seen) -> Option<&'static str> {
        match seen {
            _ if what == What::Positions => None,
            Seen { compared: 0, .. } if matches!(what, What::Outputs(..)) => {
                Some("no fragment that both keep has a finite normal")
            }
            Seen { compared: 0, .. } if matches!(what, What::Still(_)) => {
                Some("no fragment that is kept has a finite velocity")
            }
            Seen { kept: 0, .. } => {
                Some("both discard each fragment that was tried, so nothing was compared")
            }
            Seen { discarded: 0, .. } if what == What::Coverage && self.discards() => {
                Some("neither discards any fragment that was tried")
            }
            _ => None,
        }
    }

    /// A shadow pass that agrees if it sees the camera's view may disagree where it sees its own.
    fn of_view(&self, promise: &str, (what, sliced): (What, &[Sliced; 2])) -> Vec<Finding> {
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
        let inputs = self.effort.inputs;
        let found = self.tried((what, sliced), inputs, Reading::Level, &own, &[]);
        let mut examples = found.examples.into_iter();
        let seen = examples.find(|(class, _)| matches!(class, Class::KeepsHidden | Class::Loses));
        seen.map(|(_, example)| {
            wording::finding(self, promise, what, Class::ViewDependent, &example)
        })
        .into_iter()
        .collect()
    }

    /// Whether the contents of buffers are compared: with the outputs of each stage.
    pub(super) fn stores(&self, what: What) -> Stores {
        match (self.relation, what) {
            (Relation::Same, What::Positions | What::Colors) => Stores::Same,
            _ => Stores::Ignored,
        }
    }

    /// Parts that the second program's slice reads and the first program lacks.
    fn lost(&self, promise: &str, sliced: &Sliced) -> Vec<Finding> {
        let stages = sliced.stages(self.second);
        let all = [Some(stages.vertex), stages.fragment];
        let is_read = |at: (u32, u32), steps: &[usize]| {
            let stages = all.into_iter().flatten();
            let mut read =
                stages.flat_map(|stage| reads::parts(stage, &|span| sliced.decides(span)));
            read.any(|(place, read)| place == at && reads::overlap(&read, steps))
        };
        let [_, second] = self.relation.names();
        let finding = |words: String| Finding::general(Class::Unmatched, promise, words);
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

    /// Slicing criteria of a promise in the fragment stage.
    pub(super) fn criteria(&self, what: What) -> Vec<Criterion> {
        let output = |slot: Slot| match slot {
            Slot::Location(location, _) => Criterion::Output(OutputFilter::Location(location)),
            Slot::BuiltIn(_) => Criterion::Output(OutputFilter::FragDepth),
        };
        match what {
            What::Outputs(_, theirs) | What::Still(theirs) => {
                vec![output(theirs), Criterion::Discard]
            }
            What::Moving(theirs) => vec![output(theirs)],
            _ => proof::of_fragment(self.colors(what)),
        }
    }

    /// The seed of input `n`. Ordinary numbers come first if there is no time for others.
    fn next_seed(&self, n: u64, is_expensive: bool) -> u64 {
        let start = self.effort.seed;
        match is_expensive {
            true => start.next_multiple_of(PROFILES) + PROFILES * (n / ORDINARY) + n % ORDINARY,
            false => start + n,
        }
    }

    /// Runs both on inputs, until all classes of `until` are found, if it names any.
    fn tried(
        &self,
        (what, sliced): (What, &[Sliced; 2]),
        count: u64,
        reading: Reading,
        rules: &[Rule],
        until: &[Class],
    ) -> ClassExamples {
        let mut found = ClassExamples::default();
        let mut state = State::default();
        let allowed = self.budget.allowed(until.is_empty());
        // Most inputs are tried on slices alone: a discard does not depend on the lights.
        let slices = [sliced[0].stages(self.first), sliced[1].stages(self.second)];
        let whole = [self.first, self.second];
        let [read_by_slices, read_by_whole] = [slices, whole].map(|s| draws::read_by(s, rules));
        let discards = OnceCell::new();
        let before = self.budget.left();
        let mut is_expensive = false;
        let solved = match what {
            What::Positions | What::Coverage | What::Colors => count / SOLVED,
            _ => 0,
        };
        let mut ties = Ties::new(solved, before.saturating_sub(allowed));
        let mut seeds = 0..;
        loop {
            let solved = ties.next();
            let depth = solved.as_ref().map_or(0, |solved| solved.depth);
            let point = match &solved {
                Some(solved) => solved.point.clone(),
                None => Point::from(self.next_seed(seeds.next().unwrap_or_default(), is_expensive)),
            };
            let seed = point.seed;
            // If few fragments survive, or few are discarded, more inputs follow.
            let Seen {
                kept, discarded, ..
            } = state.seen;
            let is_rare = |n: u64| n * RARE < found.tried;
            let wants_more = || {
                what != What::Positions
                    && until.is_empty()
                    && found.tried < MORE * count
                    && (is_rare(kept)
                        || is_rare(discarded) && *discards.get_or_init(|| self.discards()))
            };
            if depth == 0 && found.tried >= count && !wants_more() {
                break;
            }
            found.is_cut = self.budget.is_below(allowed);
            if found.is_cut {
                break;
            }
            let is_whole = seed.is_multiple_of(BESIDE) || self.stores(what) == Stores::Same;
            let (stages, read) = match is_whole {
                true => (whole, &read_by_whole),
                false => (slices, &read_by_slices),
            };
            let inputs = self.inputs(&point, reading, rules, read);
            let draw = Draw::new(&inputs, stages, self.budget);
            found.tried += u64::from(depth == 0);
            let mut ended = true;
            let compared = state.seen.compared;
            for place in Self::places(what, inputs.corner()) {
                let mut tried = self.try_one(what, &draw, place, &mut state);
                if let Ok(Some((class, _))) = &tried {
                    found.count(*class, (&point, &inputs), place);
                    let may_trace = is_plain(&inputs) || found.traced < TRACED;
                    if !found.wants(*class, &inputs, place) || !may_trace {
                        continue;
                    }
                    let inputs = self.inputs(&point, reading, rules, &read_by_whole);
                    tried = self.confirmed((what, sliced), (&inputs, rules), place, &mut state);
                    found.traced += u64::from(!is_plain(&inputs));
                }
                match tried {
                    Ok(Some((class, output))) if found.wants(class, &inputs, place) => {
                        let example = Example {
                            point: point.clone(),
                            place,
                            output,
                            reading,
                            rules: rules.to_vec(),
                        };
                        found.keep(class, example);
                    }
                    Ok(_) => {}
                    Err(stuck) => {
                        ended = false;
                        if stuck != Stuck::Steps {
                            found.why.get_or_insert(stuck.to_string());
                        }
                    }
                }
            }
            drop(draw);
            if is_expensive {
                ties.save();
            }
            // In a quarter of the inputs, textures have numbers of buffers.
            let is_base = depth > 0 || !seed.is_multiple_of(4) && is_plain(&inputs);
            if ended && is_base && ties.wants(solved.as_ref()) {
                for place in Self::places(what, inputs.corner()) {
                    let data = (stages, &inputs, rules);
                    self.near_ties(&mut ties, (&point, solved.as_ref()), data, place);
                }
            }
            self.budget.keep(inputs);
            if depth > 0 {
                continue;
            }
            found.compared += u64::from(state.seen.compared > compared);
            found.ended += u64::from(ended);
            if found.tried == 1 {
                let spent = before.saturating_sub(self.budget.left());
                is_expensive = spent.saturating_mul(count) > before.saturating_sub(allowed);
            }
            if found.ended == 0 && found.tried > 24 {
                break;
            }
            if found.is_enough(count, until) {
                break;
            }
        }
        found.seen = state.seen;
        found
    }

    /// Runs both on one input.
    #[allow(clippy::type_complexity)]
    pub(super) fn try_one(
        &self,
        what: What,
        draw: &Draw<'_>,
        place: TestPoint,
        State {
            seen,
            rest,
            encodings,
        }: &mut State,
    ) -> Result<Option<(Class, [String; 3])>, Stuck> {
        let steps = self.effort.steps;
        let mut first = draw.run(0, place, steps)?;
        let mut second = draw.run(1, place, 4 * steps)?;
        if is_plain(draw.inputs) {
            let discards = [&first, &second].map(|ran| self.covered(ran) == 0);
            seen.kept += u64::from(discards.contains(&false));
            seen.discarded += u64::from(discards.contains(&true));
        }
        if let Some(found) = self.undefined([&first, &second], draw.inputs) {
            return Ok(
                found.filter(|_| matches!(what, What::Positions | What::Coverage | What::Colors))
            );
        }
        for ran in [&mut first, &mut second] {
            differences::clamp_depth(ran);
            self.narrow(ran);
        }
        if let What::Still(slot) = what {
            let value = second.outputs.get(&slot).and_then(|v| v.floats().ok());
            let is_finite = value.is_some_and(|v| v.iter().all(|x| x.is_finite()));
            let is_compared = is_plain(draw.inputs)
                && !second.discarded
                && (is_finite || draw.is_seen(place, steps));
            seen.compared += u64::from(is_compared);
            return Ok(is_compared.then(|| moving(&second, slot, rest)).flatten());
        }
        if let What::Outputs(ours, theirs) = what {
            let is_compared = is_plain(draw.inputs) && !first.discarded && !second.discarded;
            let values = (first.outputs.get(&ours), second.outputs.get(&theirs));
            return Ok(match (is_compared, values) {
                (true, (Some(a), Some(b)))
                    if a.floats().is_ok_and(|a| a.iter().all(|x| x.is_finite())) =>
                {
                    seen.compared += 1;
                    normals::difference(encodings, (a, self.normal.is_some()), b)
                }
                _ => None,
            });
        }
        seen.viewed += u64::from(what == What::Positions && differences::is_viewed(&first));
        let mut found = self.difference(what, &first, &second);
        if let Some((class @ Class::DepthBias, _)) = &mut found {
            match differences::bias(&first, &second, self.direction) {
                Bias::Nearer => seen.nearer += 1,
                Bias::Farther => seen.farther += 1,
                Bias::Unseen => {}
                Bias::None => *class = Class::Position,
            }
            if seen.nearer > 0 && seen.farther > 0 {
                *class = Class::Position;
            }
        }
        if found.is_none() && self.loses_alpha(what) {
            found = covered_by_alpha(&first, &second);
        }
        Ok(found)
    }

    /// Whether to skip an input, because GLSL leaves a result of either program undefined. `Some`
    /// with the difference, if only the second's result is undefined.
    #[allow(clippy::type_complexity)]
    fn undefined(&self, ran: [&Ran; 2], inputs: &Inputs) -> Option<Option<(Class, [String; 3])>> {
        let programs = [self.first, self.second].map(|stages| stages.vertex.program);
        let of = |i: usize| {
            let is_glsl = programs[i].language() == Language::Glsl;
            ran[i].undefined.filter(|_| is_glsl)
        };
        match (of(0), of(1)) {
            (None, None) => None,
            (None, Some((what, span))) if is_plain(inputs) => {
                let text = quote::written(programs[1], span, 0);
                let output = [what.to_string(), String::new(), text.unwrap_or_default()];
                Some(Some((Class::Undefined, output)))
            }
            (first, _) => {
                self.undefined.set(self.undefined.get().or(first));
                Some(None)
            }
        }
    }

    fn by_terms(&self, what: What, place: TestPoint) -> bool {
        let inputs = self.inputs(
            &1.into(),
            Reading::Chosen,
            &[],
            &self.read(&self.matching.rules),
        );
        let [ours, theirs] = [self.first, self.second].map(|s| s.vertex.module());
        let left = Cell::new(self.budget.of_terms());
        let steps = |most: u64| most.min(left.get());
        let spent = |ran: Ran<Symbolic>| {
            left.set(left.get().saturating_sub(ran.steps));
            ran
        };
        term::proved(self.effort.paths, || {
            let mut world = environment::symbolic(ours, &inputs);
            let mut resources: BTreeMap<(u32, u32), Value<Symbolic>> =
                environment::buffers_of_terms(theirs);
            resources.extend(Arc::unwrap_or_clone(std::mem::take(&mut world.resources)));
            fed::feed(&self.matching.rules, &mut resources);
            world.resources = Arc::new(resources);
            let limit = self.effort.steps;
            let first = world
                .run(self.first, place, steps(limit), None)
                .map(spent)?;
            let second = world.run(self.second, place, steps(4 * limit), None);
            let second = second.map(spent)?;
            if what == What::Colors && first.discarded != second.discarded {
                return Ok(false);
            }
            Ok(self.difference(what, &first, &second).is_none())
        })
        .is_some()
    }
}
