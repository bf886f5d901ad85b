//! Reads the range of a mesh and of a field's copies.

use crate::file::entries::RangeEntry;
use preshade_draw::scene::range::check;
use preshade_draw::scene::{Draw, DrawRange, Mesh, SceneError};
use shader_text::limits::Limits;

/// Selects the range of `mesh` and of the field's copies. Without a field (`copies` is `None`), the
/// entry sets the number of instances.
///
/// # Errors
/// As [`check`], or the range of copies starts or ends beyond the last one, or has too many
/// instances.
pub(super) fn take(
    entry: RangeEntry,
    mesh: &Mesh,
    draw: &mut Draw,
    copies: Option<u32>,
    limits: &Limits,
) -> Result<(), SceneError> {
    let RangeEntry {
        first,
        count,
        base_vertex,
        first_instance,
        instances,
    } = entry;
    draw.range = DrawRange {
        first,
        count,
        base_vertex,
        first_instance,
    };
    draw.instances = match copies {
        None => {
            let taken = instances.unwrap_or(1);
            limits.check("copies", taken.into(), "the instances of a draw")?;
            taken
        }
        Some(copies) => {
            let left = copies.saturating_sub(first_instance);
            let taken = instances.unwrap_or(left);
            if taken > left || taken == 0 {
                let last = u64::from(first_instance) + u64::from(taken);
                return Err(SceneError::new(format!(
                    "instances {first_instance} to {last} of a field of {copies} copies"
                )));
            }
            taken
        }
    };
    check(mesh, draw)
}
