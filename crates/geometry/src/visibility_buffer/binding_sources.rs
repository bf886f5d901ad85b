//! Sources of the bindings that the author's program lacks.

use super::text::Slots;
use preshade_plan::draw_table::IDS;
use preshade_plan::geometry::Formats;
use preshade_plan::plan::{AttributeUse, BindingSource, BindingUse, GeometryPart};
use preshade_plan::program::Program;

/// WebGPU's limit of bindings per group (`maxBindingsPerBindGroup`).
const BINDINGS: u32 = 1000;
/// An upper bound of generated bindings: a stream per attribute, a target per colour, and a few
/// more.
const OURS: u32 = 64;

/// Slots after all bindings of the last used group, or in its first sufficient gap if that exceeds
/// the limit.
pub(crate) fn slots(program: &Program) -> Slots {
    let bindings = || {
        let globals = program.module().global_variables.iter();
        globals.filter_map(|(_, g)| g.binding)
    };
    let group = bindings().map(|b| b.group).max().unwrap_or(0);
    let in_group = bindings().filter(|b| b.group == group);
    let mut taken: Vec<u32> = in_group.map(|b| b.binding).collect();
    taken.sort_unstable();
    let behind = taken.last().map_or(0, |last| last.saturating_add(1));
    let mut free = 0;
    let mut gap = None;
    for binding in &taken {
        if gap.is_none() && binding.saturating_sub(free) >= OURS {
            gap = Some(free);
        }
        free = binding.saturating_add(1);
    }
    let first = match behind.saturating_add(OURS) <= BINDINGS {
        true => behind,
        false => gap.unwrap_or(behind),
    };
    Slots { group, first }
}

/// The generated bindings with their sources, for [`reflect::fill`].
pub(crate) fn parts(
    slots: Slots,
    attributes: &[AttributeUse],
    formats: Formats,
) -> Vec<BindingUse> {
    let geometry = |part| BindingSource::Geometry { part };
    let streams = attributes.iter().cloned().map(GeometryPart::Attribute);
    let fixed = [
        (
            Slots::ENTRY,
            geometry(GeometryPart::Draw {
                streams: attributes.iter().map(|a| a.location).collect(),
                formats,
            }),
        ),
        (
            Slots::IDS,
            BindingSource::Attachment {
                name: IDS.to_owned(),
            },
        ),
        (Slots::INDICES, geometry(GeometryPart::Indices)),
    ];
    fixed
        .into_iter()
        .chain((Slots::STREAMS..).zip(streams.map(geometry)))
        .map(|(at, source)| super::lists::bound((slots.group, slots.first + at), source))
        .collect()
}
