//! Assigns moved values to varying slots: one location each if there is room, and else packed into
//! vectors.

use std::collections::BTreeSet;

use naga::ScalarKind;

use super::movable::Carriage;
use preshade_dataflow::graph::rate::{At, Interpolated};

/// A value that needs room in a varying.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Load {
    /// From 1 to 4 components.
    pub width: u8,
    /// Scalar kind, 32 bits wide.
    pub kind: ScalarKind,
    pub carriage: Carriage,
}

impl Load {
    /// The properties that values in one location must share.
    fn class(self) -> (Interpolated, At, u8) {
        (
            self.carriage.interpolated,
            self.carriage.at,
            self.kind as u8,
        )
    }
}

/// A varying with one or several values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct VaryingSlot {
    pub kind: ScalarKind,
    pub interpolated: Interpolated,
    /// Interpolation location in the pixel.
    pub at: At,
    /// Index of each value in it, and its first component.
    pub parts: Vec<(usize, u8)>,
    /// From 1 to 4 components.
    pub width: u8,
}

/// Slots for all values, in addition to `taken` varyings and with at most `limit` in total; `None`
/// if they do not fit even when packed. First-fit decreasing; no value is split.
pub(crate) fn pack(loads: &[Load], taken: usize, limit: usize) -> Option<Vec<VaryingSlot>> {
    let mut slots: Vec<VaryingSlot> = Vec::new();
    let mut order: Vec<usize> = (0..loads.len()).collect();
    let tight = taken + loads.len() > limit;
    if tight {
        order.sort_by_key(|i| std::cmp::Reverse(loads[*i].width));
    }
    for i in order {
        let load = loads[i];
        let room = slots.iter_mut().find(|s| {
            let class = (s.interpolated, s.at, s.kind as u8);
            tight && class == load.class() && s.width + load.width <= 4
        });
        match room {
            Some(slot) => {
                slot.parts.push((i, slot.width));
                slot.width += load.width;
            }
            None => slots.push(VaryingSlot {
                kind: load.kind,
                interpolated: load.carriage.interpolated,
                at: load.carriage.at,
                parts: vec![(i, 0)],
                width: load.width,
            }),
        }
    }
    (taken + slots.len() <= limit).then_some(slots)
}

/// The lowest free locations, one for each slot.
pub(crate) fn free_locations(slots: &[VaryingSlot], taken: &BTreeSet<u32>) -> Vec<u32> {
    (0..)
        .filter(|l| !taken.contains(l))
        .take(slots.len())
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::movable::Class;
    use super::*;

    fn load(width: u8, interpolated: Interpolated) -> Load {
        Load {
            width,
            kind: ScalarKind::Float,
            carriage: Carriage {
                class: Class::Smooth,
                interpolated,
                at: At::Center,
            },
        }
    }

    #[test]
    fn values_have_a_location_each_where_there_is_room() {
        let loads = [load(1, Interpolated::Perspective); 3];
        let slots = pack(&loads, 2, 16).unwrap();
        assert_eq!(free_locations(&slots, &BTreeSet::from([0, 2])), [1, 3, 4]);
    }

    #[test]
    fn values_of_one_class_share_a_vector_where_there_is_not() {
        let smooth = Interpolated::Perspective;
        let loads = [
            load(1, smooth),
            load(3, smooth),
            load(2, smooth),
            load(2, smooth),
            load(1, Interpolated::Flat),
        ];
        let slots = pack(&loads, 1, 4).unwrap();
        assert_eq!(slots.len(), 3);
        for slot in &slots {
            assert!(slot.width <= 4);
            for (i, _) in &slot.parts {
                assert_eq!(loads[*i].carriage.interpolated, slot.interpolated);
            }
        }
        assert_eq!(pack(&loads, 1, 3), None);
    }
}
