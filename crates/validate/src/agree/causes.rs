//! Whether a difference is one of levels, of huge numbers, of rounding, or of coverage by alpha.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use super::Class;
use super::budget::Draw;
use super::draws::Point;
use super::fed::Rule;
use super::promise_inputs::{State, is_plain};
use super::quote::digits;
use super::trial::{Two, What};
use super::wording::Sliced;
use crate::environment::{self, PassStages, TestPoint, Texels};
use crate::inputs::Inputs;
use crate::levels::Reading;
use crate::stage::{Ran, Slot, Stage};
use crate::tape::TextureAccess;
use naga_interp::{Scalar, Stuck, Traced, Value};

/// A larger number is huge.
const HUGE: f32 = 1e6;

/// No 32-bit integer is larger.
const WIDEST: f32 = 4_294_967_296.0;

/// The output of a fragment whose coverage follows its alpha.
const COVERS: &str = "the alpha that covers samples";

/// Below this alpha, a pixel of eight samples has none that is covered.
const COVERED: f32 = 0.125;

impl Two<'_> {
    /// The difference between the whole programs, if they differ too. Huge numbers and rounding get
    /// a class of their own.
    pub(super) fn confirmed(
        &self,
        (what, sliced): (What, &[Sliced; 2]),
        (inputs, rules): (&Inputs, &[Rule]),
        place: TestPoint,
        state: &mut State,
    ) -> Result<Option<(Class, [String; 3])>, Stuck> {
        let draw = Draw::new(inputs, [self.first, self.second], self.budget);
        let mut tried = self.try_one(what, &draw, place, state);
        if let Ok(Some((class, output))) = &mut tried
            && *class != Class::Undefined
        {
            if !is_plain(inputs) && self.is_extreme(sliced, inputs, place) {
                *class = Class::Extreme;
            } else if !matches!(what, What::Still(_) | What::Outputs(..))
                && output[0] != COVERS
                && self.is_rounding(what, (inputs, rules), place)
            {
                *class = Class::Rounding;
            }
        }
        tried
    }

    /// Whether on the very inputs that differ, both sample one place at different levels, and agree
    /// where every mip level is the same.
    pub(super) fn agree_without_levels(
        &self,
        (what, sliced): (What, &[Sliced; 2]),
        class: Class,
        differing: &[(Point, TestPoint)],
    ) -> bool {
        let rules = &self.matching.rules;
        let read = self.read(rules);
        let whole = [self.first, self.second];
        let slices = [sliced[0].stages(self.first), sliced[1].stages(self.second)];
        differing.iter().all(|(point, place)| {
            let inputs = self.inputs(point, Reading::Level, rules, &read);
            let [ours, theirs] =
                slices.map(|stages| self.on_tape(stages, &inputs, rules, *place).1.lookups);
            if !TextureAccess::differ_in_level(&ours, &theirs) {
                return false;
            }
            let inputs = self.inputs(point, Reading::Ignored, rules, &read);
            let draw = Draw::new(&inputs, whole, self.budget);
            let tried = self.try_one(what, &draw, *place, &mut State::default());
            !matches!(tried, Ok(Some((c, _))) if c == class)
        })
    }

    /// Whether the first program's alpha decides its coverage, and the second writes none.
    pub(super) fn loses_alpha(&self, what: What) -> bool {
        let writes = |stages: PassStages<'_>| {
            let outputs = stages.fragment.map(Stage::outputs).unwrap_or_default();
            let mut slots = outputs
                .iter()
                .filter_map(|io| io.binding.as_ref().map(Slot::of));
            slots.any(|slot| slot == Slot::Location(0, None))
        };
        what == What::Coverage && self.covers_by_alpha && writes(self.first) && !writes(self.second)
    }

    /// Whether an infinite, undefined or huge number is on the way to a difference. Where both compare
    /// the same ordinary numbers and only one of them is true, none is.
    fn is_extreme(&self, sliced: &[Sliced; 2], inputs: &Inputs, place: TestPoint) -> bool {
        let attached = BTreeMap::new();
        let world = environment::concrete(inputs, &attached, Texels::Waves);
        let traces =
            [(&sliced[0], self.first), (&sliced[1], self.second)].map(|(sliced, whole)| {
                let trace = RefCell::new(Vec::new());
                let ran = world.run(
                    sliced.stages(whole),
                    place,
                    4 * self.effort.steps,
                    Some(&trace),
                );
                self.budget
                    .spend(ran.map_or(self.effort.steps, |ran| ran.steps));
                let mut trace = trace.into_inner();
                trace.retain(|traced| sliced.decides(traced.span));
                trace
            });
        let is_huge = |x: &f32| !x.is_finite() || x.abs() > HUGE;
        let compared = |trace: &[Traced]| -> BTreeSet<([u32; 2], bool)> {
            let made = trace.iter().filter_map(|traced| {
                let [a, b] = traced.compared.as_ref()?;
                let numbers = [a.float().ok()?, b.float().ok()?];
                let Value::Scalar(Scalar::Bool(value)) = traced.value else {
                    return None;
                };
                let is_ordinary = !numbers.iter().any(is_huge);
                is_ordinary.then(|| (numbers.map(f32::to_bits), value))
            });
            made.collect()
        };
        let [ours, theirs] = traces.each_ref().map(|trace| compared(trace));
        let mut decided = ours.iter();
        if decided.any(|(numbers, value)| {
            !theirs.contains(&(*numbers, *value)) && theirs.contains(&(*numbers, !value))
        }) {
            return false;
        }
        fn any(value: &Value, is_it: &dyn Fn(&f32) -> bool) -> bool {
            match value {
                Value::Scalar(Scalar::F32(x)) => is_it(x),
                Value::Composite(parts) => parts.iter().any(|part| any(part, is_it)),
                _ => false,
            }
        }
        let mut all = traces.iter().flatten();
        all.any(|traced| match traced.kind {
            // An integer is exact, however large.
            "As" => any(&traced.value, &|x| x.is_nan() || x.abs() > WIDEST),
            _ => any(&traced.value, &is_huge),
        })
    }
}

/// A fragment that the first program's alpha covers hardly, and the second keeps.
pub(super) fn covered_by_alpha(first: &Ran, second: &Ran) -> Option<(Class, [String; 3])> {
    let color = first.outputs.get(&Slot::Location(0, None))?;
    let alpha = *color.floats().ok()?.get(3)?;
    let is_kept = !first.discarded && !second.discarded;
    (is_kept && (alpha.is_nan() || alpha < COVERED)).then(|| {
        let output = [COVERS.to_owned(), digits(alpha), "not there".to_owned()];
        (Class::KeepsHidden, output)
    })
}
