//! The remaining fragment stage: it reads the moved values from varyings, without the code that
//! only they needed.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    Binding, Expression, Handle, Interpolation, Module, Sampling, Scalar, ScalarKind,
    SwizzleComponent, TypeInner, VectorSize,
};

use super::pack::{self, VaryingSlot};
use crate::analysis::named;
use crate::rebuild::moved::MovedValues;
use crate::rebuild::outline::{Failed, Wanted};
use crate::rebuild::place::CodeBuilder;
use naga_edit::interface;
use preshade_dataflow::graph::rate::{At, Interpolated};
use preshade_dataflow::slice::Termination;

/// The remaining fragment stage in its module.
#[derive(Clone, Debug)]
pub(crate) struct Remainder {
    pub module: Module,
    /// Locations of the author's varyings that it still reads.
    pub kept: BTreeSet<u32>,
    /// The location of each slot.
    pub locations: Vec<u32>,
}

/// The module with unchanged author's functions, and the fragment entry point that reads the moved
/// values from `slots`.
///
/// # Errors
/// [`Failed`].
pub(crate) fn rebuild(
    module: &Module,
    moved: &MovedValues<'_, '_, '_>,
    slots: &[VaryingSlot],
) -> Result<Remainder, Failed> {
    let entry = moved.values.entry;
    let loops = Termination::under(moved.guard.as_ref());
    let read = &mut |build: &mut CodeBuilder<'_>| from_varyings(build, &moved.wanted, slots);
    let mut module = moved.remainder(module, loops, read)?;
    let placed = &module.entry_points[entry].function;
    let kept: BTreeSet<u32> = interface::inputs(&module, placed)
        .iter()
        .filter_map(|io| match io.binding {
            Some(Binding::Location { location, .. }) if location < ASIDE => Some(location),
            _ => None,
        })
        .collect();
    let locations = pack::free_locations(slots, &kept);
    for argument in &mut module.entry_points[entry].function.arguments {
        if let Some(Binding::Location { location, .. }) = &mut argument.binding
            && *location >= ASIDE
        {
            *location = locations[(*location - ASIDE) as usize];
        }
    }
    Ok(Remainder {
        module,
        kept,
        locations,
    })
}

/// Temporary locations of new varyings, until the locations they take are free.
const ASIDE: u32 = 1 << 16;

/// Adds the varyings as arguments and returns the values in them.
fn from_varyings(
    build: &mut CodeBuilder<'_>,
    wanted: &[Wanted],
    slots: &[VaryingSlot],
) -> BTreeMap<usize, Handle<Expression>> {
    let mut carried = BTreeMap::new();
    for (index, slot) in slots.iter().enumerate() {
        let ty = build.ty(slot_type(slot));
        let binding = slot_binding(slot, ASIDE + index as u32);
        let varying = build.argument(&slot_name(index, slot, wanted), ty, Some(binding));
        for (i, first) in &slot.parts {
            let value = match (width(&wanted[*i].inner), slot.width) {
                (w, all) if w == all => varying,
                (1, _) => build.expression(Expression::AccessIndex {
                    base: varying,
                    index: u32::from(*first),
                }),
                (w, _) => build.expression(Expression::Swizzle {
                    size: vector_size(w),
                    vector: varying,
                    pattern: swizzle(*first),
                }),
            };
            carried.insert(*i, value);
        }
    }
    carried
}

const COMPONENTS: [SwizzleComponent; 4] = [
    SwizzleComponent::X,
    SwizzleComponent::Y,
    SwizzleComponent::Z,
    SwizzleComponent::W,
];

fn swizzle(first: u8) -> [SwizzleComponent; 4] {
    std::array::from_fn(|i| COMPONENTS[(usize::from(first) + i).min(3)])
}

fn vector_size(width: u8) -> VectorSize {
    match width {
        2 => VectorSize::Bi,
        3 => VectorSize::Tri,
        _ => VectorSize::Quad,
    }
}

/// Number of components of a scalar or vector type.
pub(crate) fn width(inner: &TypeInner) -> u8 {
    match inner {
        TypeInner::Vector { size, .. } => *size as u8,
        _ => 1,
    }
}

pub(crate) fn slot_type(slot: &VaryingSlot) -> TypeInner {
    let scalar = match slot.kind {
        ScalarKind::Sint => Scalar::I32,
        ScalarKind::Uint => Scalar::U32,
        _ => Scalar::F32,
    };
    match slot.width {
        1 => TypeInner::Scalar(scalar),
        width => TypeInner::Vector {
            size: vector_size(width),
            scalar,
        },
    }
}

/// Name of a varying: the value's name, or a generic one for several values.
pub(crate) fn slot_name(index: usize, slot: &VaryingSlot, wanted: &[Wanted]) -> String {
    match slot.parts[..] {
        [(one, _)] => wanted[one].name.clone(),
        _ => format!("packed_{}", named::letters(index)),
    }
}

/// Location and interpolation of a varying.
pub(crate) fn slot_binding(slot: &VaryingSlot, location: u32) -> Binding {
    let interpolation = match slot.interpolated {
        Interpolated::Flat => Interpolation::Flat,
        Interpolated::Perspective => Interpolation::Perspective,
        Interpolated::Linear => Interpolation::Linear,
    };
    let sampling = match (slot.interpolated, slot.at) {
        (Interpolated::Flat, _) => None,
        (_, At::Center) => Some(Sampling::Center),
        (_, At::Centroid) => Some(Sampling::Centroid),
        (_, At::Sample) => Some(Sampling::Sample),
    };
    Binding::Location {
        location,
        interpolation: Some(interpolation),
        sampling,
        blend_src: None,
        per_primitive: false,
    }
}
