//! Where what is bound beside the author's resources comes from.

use super::IDS;
use super::text::Slots;
use crate::geometry::Formats;
use crate::plan::{AttributeUse, BindingKind, BindingSource, BindingUse, GeometryPart, Visibility};
use crate::program::Program;

/// Behind all bindings of the last group that has any.
pub fn slots(program: &Program) -> Slots {
    let bindings = || {
        let globals = program.module().global_variables.iter();
        globals.filter_map(|(_, g)| g.binding)
    };
    let group = bindings().map(|b| b.group).max().unwrap_or(0);
    let in_group = bindings().filter(|b| b.group == group);
    Slots {
        group,
        first: in_group.map(|b| b.binding + 1).max().unwrap_or(0),
    }
}

/// Our own bindings, for [`reflect::fill`] to know where they come from.
pub fn parts(slots: Slots, attributes: &[AttributeUse], formats: Formats) -> Vec<BindingUse> {
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
        .map(|(at, source)| BindingUse {
            group: slots.group,
            binding: slots.first + at,
            name: String::new(),
            kind: BindingKind::StorageRead,
            visibility: Visibility::default(),
            source,
            layout: None,
        })
        .collect()
}
