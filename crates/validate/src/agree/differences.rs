//! Differences between two runs, and whether they are rounding alone.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use naga::BuiltIn;

use super::fed::{self, Rule};
use super::trial::{Two, What};
use super::{Class, Relation};
use crate::compare::{self, Colors, Depths, Discards, Stores, text};
use crate::environment::{self, TestPoint};
use crate::inputs::Inputs;
use crate::stage::{POSITION, Ran, Slot};
use crate::tape::Taped;
use naga_interp::{Number, Scalar, Value};
use preshade_plan::program::Program;
use preshade_plan::state::DepthDirection;

const FRAG_DEPTH: Slot = Slot::BuiltIn(BuiltIn::FragDepth);
const SAMPLE_MASK: Slot = Slot::BuiltIn(BuiltIn::SampleMask);

pub(super) const BIASED: &str = "z of the position";

impl Two<'_> {
    /// Whether rounding alone makes the two differ. Two outcomes of a comparison of the same
    /// numbers are no rounding.
    pub(super) fn is_rounding(
        &self,
        what: What,
        (inputs, rules): (&Inputs, &[Rule]),
        place: TestPoint,
    ) -> bool {
        let [ours, theirs] =
            [self.first, self.second].map(|stages| self.on_tape(stages, inputs, rules, place));
        let ((Ok(first), ours), (Ok(second), theirs)) = (ours, theirs) else {
            return self.is_same_precisely(what, (inputs, rules), place);
        };
        let decisions = [&ours.decisions, &theirs.decisions];
        if decisions[0].iter().any(|d| d.is_opposed(decisions[1])) {
            return false;
        }
        let rounded: Vec<_> = [(0, 1), (1, 0)]
            .into_iter()
            .flat_map(|(own, other)| {
                let own = decisions[own].iter();
                own.filter(move |d| d.is_of_rounding() && !d.is_shared(decisions[other]))
            })
            .collect();
        // `f64` rounds this, too.
        if rounded.iter().any(|d| d.is_of_rounded_truths()) {
            return true;
        }
        if rounded.is_empty() && ours.lookups == theirs.lookups {
            return self.is_near(what, truths(first), truths(second));
        }
        self.is_same_precisely(what, (inputs, rules), place)
    }

    /// Whether the two agree in twice the digits.
    fn is_same_precisely(
        &self,
        what: What,
        (inputs, rules): (&Inputs, &[Rule]),
        place: TestPoint,
    ) -> bool {
        let mut world = environment::precise(inputs);
        // The rules' products round differently in `f64`.
        fed::feed(rules, Arc::make_mut(&mut world.resources));
        let run = |stages| world.run(stages, place, 4 * self.effort.steps, None);
        let (Ok(first), Ok(second)) = (run(self.first), run(self.second)) else {
            self.budget.spend(self.effort.steps);
            return false;
        };
        self.budget.spend(first.steps + second.steps);
        self.is_near(what, first, second)
    }

    /// Whether two runs agree but for the last digits.
    fn is_near(&self, what: What, mut first: Ran<f64>, mut second: Ran<f64>) -> bool {
        self.narrow(&mut first);
        self.narrow(&mut second);
        // Close values count as equal.
        let snap = |ours: Option<&Value<f64>>, theirs: Option<&mut Value<f64>>| {
            if let (Some(ours), Some(theirs)) = (ours, theirs)
                && compare::is_close(ours, theirs, 1e-9)
            {
                theirs.clone_from(ours);
            }
        };
        for (slot, ours) in &first.outputs {
            snap(Some(ours), second.outputs.get_mut(slot));
        }
        for (at, ours) in &first.stored {
            snap(Some(ours), second.stored.get_mut(at));
        }
        first.discarded == second.discarded && self.difference(what, &first, &second).is_none()
    }

    /// Leaves out the components of outputs that an author does not declare: reading GLSL fills them.
    pub(super) fn narrow<F: Number>(&self, ran: &mut Ran<F>) {
        for (location, count) in &self.components {
            let output = ran.outputs.get_mut(&Slot::Location(*location, None));
            if let Some(output @ Value::Composite(_)) = output {
                let Value::Composite(parts) = output else {
                    continue;
                };
                parts.truncate(*count as usize);
                if let [one] = &parts[..] {
                    *output = one.clone();
                }
            }
        }
    }

    /// The samples that a fragment covers, as bits.
    pub(super) fn covered<F: Number>(&self, ran: &Ran<F>) -> u32 {
        let all = match self.samples {
            // WebGPU's other sample count is four.
            0 | 1 => 0b1111,
            n => u32::MAX >> 32_u32.saturating_sub(n),
        };
        let mask = match ran.outputs.get(&SAMPLE_MASK) {
            _ if ran.discarded => 0,
            Some(Value::Scalar(Scalar::U32(mask))) => *mask,
            Some(Value::Scalar(Scalar::I32(mask))) => *mask as u32,
            _ => u32::MAX,
        };
        mask & all
    }

    /// The first buffer whose contents differ after two vertices or discarded fragments. A stage
    /// that cannot write a buffer leaves none.
    fn stored<F: Number>(
        &self,
        what: What,
        first: &Ran<F>,
        second: &Ran<F>,
    ) -> Option<(Class, [String; 3])> {
        if self.stores(what) == Stores::Ignored {
            return None;
        }
        let mut ours = first.stored.iter();
        ours.find_map(|(at, ours)| {
            let theirs = second.stored.get(at)?;
            let output = [format!("buffer {at:?}"), text(ours), text(theirs)];
            (!compare::same_bits(ours, theirs)).then_some((Class::Color, output))
        })
    }

    /// Whether a pass of another depth has the positions of the first but for z.
    fn is_biased<F: Number>(&self, first: &Ran<F>, second: &Ran<F>) -> bool {
        let position = |ran: &Ran<F>| ran.outputs.get(&POSITION)?.parts().ok().map(<[_]>::to_vec);
        let (Some(a), Some(b)) = (position(first), position(second)) else {
            return false;
        };
        let is_same = |i: usize| match (a.get(i), b.get(i)) {
            (Some(a), Some(b)) => compare::same_bits(a, b),
            _ => false,
        };
        !matches!(self.relation, Relation::Same | Relation::Position)
            && [0, 1, 3].map(is_same) == [true; 3]
    }

    /// The first difference that the promise forbids.
    pub(super) fn difference<F: Number>(
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
            let slots: BTreeSet<Slot> = first
                .outputs
                .keys()
                .chain(second.outputs.keys())
                .copied()
                .collect();
            // Only points have a size.
            let counts = |slot: &Slot| match slot {
                Slot::BuiltIn(BuiltIn::PointSize) => self.relation == Relation::Same,
                Slot::BuiltIn(_) => true,
                Slot::Location(..) => false,
            };
            // A bias of the depth counts only if nothing else differs.
            let (mut bias, mut moved) = (None, None);
            for slot in slots.into_iter().filter(counts).chain([POSITION]) {
                match of((slot, slot), &compare::same_bits) {
                    None => {}
                    Some(_) if slot == POSITION && self.is_biased(first, second) => {
                        let depth = |ran: &Ran<F>| {
                            let position = ran.outputs.get(&POSITION)?;
                            Some(text(position.parts().ok()?.get(2)?))
                        };
                        let [a, b] = [first, second].map(|ran| depth(ran).unwrap_or_default());
                        bias = Some((Class::DepthBias, [BIASED.to_owned(), a, b]));
                    }
                    Some(output) => moved = moved.or(Some((Class::Position, output))),
                }
            }
            return moved.or_else(|| self.stored(what, first, second)).or(bias);
        }
        let [ours, theirs] = [self.covered(first), self.covered(second)];
        match (ours, theirs) {
            (0, 0) => return self.stored(what, first, second),
            (a, b) if a == b => {}
            // The promise about coverage reports this difference.
            _ if what != What::Coverage => return None,
            (a, b) => {
                let class = if b & !a != 0 {
                    Class::KeepsHidden
                } else {
                    Class::Loses
                };
                let said =
                    |samples: u32| if samples == 0 { "discarded" } else { "kept" }.to_owned();
                let output = match a == 0 || b == 0 {
                    true => ["the fragment".to_owned(), said(a), said(b)],
                    false => [
                        SAMPLE_MASK.to_string(),
                        format!("{a:#b}"),
                        format!("{b:#b}"),
                    ],
                };
                return Some((class, output));
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
            _ => {
                let rule = compare::Rule::Fragments {
                    colors: Colors::Bits,
                    discards: Discards::Same,
                    depths: Depths::Same,
                    stores: self.stores(what),
                };
                let found = compare::difference(rule, first, second).map(told);
                let more = || {
                    let mut slots = second.outputs.keys();
                    let added = slots.find(|slot| !first.outputs.contains_key(*slot))?;
                    of((*added, *added), &compare::same_bits)
                };
                found.or_else(more).map(|output| (Class::Color, output))
            }
        }
    }
}

/// The references of a run.
fn truths(ran: Ran<Taped>) -> Ran<f64> {
    fn of(value: &Value<Taped>) -> Value<f64> {
        match value {
            Value::Scalar(scalar) => Value::Scalar(match scalar {
                Scalar::F32(x) => Scalar::F32(x.truth),
                Scalar::I32(x) => Scalar::I32(*x),
                Scalar::U32(x) => Scalar::U32(*x),
                Scalar::Bool(x) => Scalar::Bool(*x),
            }),
            Value::Composite(parts) => Value::Composite(parts.iter().map(of).collect()),
            Value::Pointer { address, path } => Value::Pointer {
                address: *address,
                path: path.clone(),
            },
            Value::Resource(global) => Value::Resource(*global),
        }
    }
    let outputs = ran.outputs.iter();
    let stored = ran.stored.iter();
    Ran {
        outputs: outputs.map(|(slot, value)| (*slot, of(value))).collect(),
        stored: stored.map(|(at, value)| (*at, of(value))).collect(),
        discarded: ran.discarded,
        flips: ran.flips,
        steps: ran.steps,
        undefined: ran.undefined,
    }
}

/// The components of outputs that two programs declare, by location, if one of them declares fewer
/// than four.
pub(super) fn components(programs: [&Program; 2]) -> BTreeMap<u32, u32> {
    let targets = programs.into_iter().flat_map(|p| &p.declared().targets);
    let mut all = BTreeMap::new();
    for target in targets {
        if let Some(count) = target.components().filter(|count| *count < 4) {
            let least = all.entry(target.location).or_insert(count);
            *least = count.min(*least);
        }
    }
    all
}

/// A written depth as the target stores it: within 0 and 1. A compiler may clamp it already. No API
/// defines the depth for NaN; clamping makes it 0.
pub(super) fn clamp_depth(ran: &mut Ran) {
    if let Some(Value::Scalar(Scalar::F32(depth))) = ran.outputs.get_mut(&FRAG_DEPTH) {
        *depth = match depth.is_nan() {
            true => 0.0,
            false => depth.clamp(0.0, 1.0),
        };
    }
}

/// How far a bias moves a depth at most, as a share of the range of depths.
const MOST_BIAS: f32 = 0.05;

/// How a second depth of one vertex is biased.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Bias {
    Nearer,
    Farther,
    /// The first one's vertex is out of view.
    Unseen,
    /// The second depth is no biased form of the first.
    None,
}

/// Whether the depth of a vertex is in view.
pub(super) fn is_viewed(first: &Ran) -> bool {
    let position = first.outputs.get(&POSITION).and_then(|p| p.floats().ok());
    matches!(position.as_deref(), Some([_, _, z, w]) if *w > 0.0 && (0.0..=*w).contains(z))
}

/// How the second's depth of a vertex is biased.
pub(super) fn bias(first: &Ran, second: &Ran, direction: DepthDirection) -> Bias {
    let position = |ran: &Ran| ran.outputs.get(&POSITION)?.floats().ok();
    let (Some(a), Some(b)) = (position(first), position(second)) else {
        return Bias::None;
    };
    let ([_, _, ours, w], [_, _, theirs, _]) = (&a[..], &b[..]) else {
        return Bias::None;
    };
    let is_seen = is_viewed(first);
    let is_usual = ours.is_finite() && w.is_finite();
    match (theirs - ours).abs() <= MOST_BIAS * ours.abs().max(*w) {
        _ if is_usual && !theirs.is_finite() => Bias::None,
        // It is clipped.
        _ if *w <= 0.0 || !is_usual => Bias::Unseen,
        true if is_seen && theirs != ours => {
            match (theirs < ours) == (direction == DepthDirection::Forward) {
                true => Bias::Nearer,
                false => Bias::Farther,
            }
        }
        true => Bias::Unseen,
        // Nothing is lost between the light and its near plane.
        false if *theirs == ours.clamp(0.0, *w) => Bias::Unseen,
        // Its own bias comes first.
        false if (theirs - ours.clamp(0.0, *w)).abs() <= MOST_BIAS * w => Bias::Unseen,
        false => Bias::None,
    }
}

/// The difference from the velocity at rest of earlier inputs.
pub(super) fn moving(
    second: &Ran,
    slot: Slot,
    rest: &mut Option<Value>,
) -> Option<(Class, [String; 3])> {
    let value = second.outputs.get(&slot)?;
    let parts = value
        .parts()
        .map(|p| Value::Composite(p[..p.len().min(2)].to_vec()));
    let value = parts.unwrap_or_else(|_| value.clone());
    let numbers = |v: &Value| v.floats().unwrap_or_default();
    if !numbers(&value).iter().all(|x| x.is_finite()) {
        let output = ["the velocity".to_owned(), String::new(), text(&value)];
        return Some((Class::Moves, output));
    }
    let known = rest.get_or_insert_with(|| value.clone());
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
