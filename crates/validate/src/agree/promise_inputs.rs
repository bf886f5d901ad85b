//! Results of a promise's inputs.

use std::collections::BTreeMap;

use super::Class;
use super::draws::Point;
use super::normals::Encodings;
use super::wording::Example;
use crate::environment::TestPoint;
use crate::inputs::{Inputs, Profile};
use naga_interp::Value;

/// Inputs of a class that must agree where every mip level is the same.
const LEVELS: usize = 8;

/// After a class of difference was found, one in this many inputs more look for another.
const LONGER: u64 = 4;

#[derive(Default)]
pub(super) struct ClassExamples {
    pub(super) examples: BTreeMap<Class, Example>,
    pub(super) ended: u64,
    pub(super) tried: u64,
    /// The budget was spent before all inputs were tried.
    pub(super) is_cut: bool,
    pub(super) why: Option<String>,
    /// Counts on ordinary numbers.
    pub(super) seen: Seen,
    /// Places that differ, by class.
    pub(super) hits: BTreeMap<Class, u64>,
    /// The first ordinary inputs and places that differ, by class.
    pub(super) differing: BTreeMap<Class, Vec<(Point, TestPoint)>>,
    /// Inputs on which something was compared.
    pub(super) compared: u64,
    /// Inputs whose numbers were looked at.
    pub(super) traced: u64,
    /// Inputs up to the last one with a new class. Extremes and rounding do not count.
    last_new: Option<u64>,
}

/// Counts: fragments that a program kept, fragments that a program discarded, and vertices that the
/// second program moves in depth alone, nearer or farther.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen {
    pub(super) kept: u64,
    pub(super) discarded: u64,
    pub(super) nearer: u64,
    pub(super) farther: u64,
    /// Vertices of the first whose depth is in view.
    pub(super) viewed: u64,
    /// Places where normals or velocities were compared.
    pub(super) compared: u64,
}

/// Results that all inputs so far share.
#[derive(Default)]
pub(super) struct State {
    pub(super) seen: Seen,
    /// The velocity at rest.
    pub(super) rest: Option<Value>,
    /// How normals may be encoded.
    pub(super) encodings: Encodings,
}

impl ClassExamples {
    /// Whether it lacks an example of a difference. At a corner, the lines of the vertex stage are
    /// known too.
    pub(super) fn wants(&self, class: Class, inputs: &Inputs, place: TestPoint) -> bool {
        self.examples.get(&class).is_none_or(|k| {
            is_plain(inputs) && k.place == TestPoint::Inside && place != TestPoint::Inside
        })
    }

    /// Keeps an example of a difference.
    pub(super) fn keep(&mut self, class: Class, example: Example) {
        let is_new = self.examples.insert(class, example).is_none();
        if is_new && !matches!(class, Class::Extreme | Class::Rounding) {
            self.last_new = Some(self.tried);
        }
    }

    /// Whether no more of `count` inputs are needed: all classes of `until` were found. If it names
    /// none, a class was, and others were looked for a while longer.
    pub(super) fn is_enough(&self, count: u64, until: &[Class]) -> bool {
        // A tie is found at once, so it does not show how rare the others are.
        let is_long_after = |at: u64| {
            let longer = at + count.div_ceil(LONGER);
            self.tried >= longer.max(count / 2)
        };
        match until {
            [] => self.last_new.is_some_and(is_long_after),
            classes => classes
                .iter()
                .all(|class| self.examples.contains_key(class)),
        }
    }

    pub(super) fn count(
        &mut self,
        class: Class,
        (point, inputs): (&Point, &Inputs),
        place: TestPoint,
    ) {
        *self.hits.entry(class).or_default() += 1;
        let known = self.differing.entry(class).or_default();
        if known.len() < LEVELS && is_plain(inputs) {
            known.push((point.clone(), place));
        }
    }
}

pub(super) fn is_plain(inputs: &Inputs) -> bool {
    matches!(inputs.profile, Profile::Ordinary | Profile::Equal)
}
