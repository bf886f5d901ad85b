//! Reads the directional light of a scene file.

use std::ops::Range;

use glam::Vec3;

use super::size::MAX_SIZE;
use crate::file::entries as file;
use preshade_draw::scene::{Light, SceneError};
use shader_text::limits::Limits;

/// An error and its position in the scene file.
pub(super) struct Misplaced {
    pub error: SceneError,
    pub at: Range<usize>,
}

/// Reads a scene file's `light` table, with defaults for missing keys.
///
/// # Errors
/// A key is invalid. The error has its position in the file.
pub(super) fn read(entry: &file::Light, limits: &Limits) -> Result<Light, Box<Misplaced>> {
    let default = Light::default();
    let direction = match &entry.direction {
        None => default.direction,
        Some(d) => Vec3::from(*d.get_ref())
            .try_normalize()
            .ok_or_else(|| misplaced(SceneError::new("the light's direction is zero"), d.span()))?,
    };
    let extent = match &entry.extent {
        None => None,
        Some(e) if e.get_ref().iter().all(|n| *n > 0.0 && n.is_finite()) => {
            Some(Vec3::from(*e.get_ref()))
        }
        Some(e) => {
            let error = SceneError::new("the light sees an empty box")
                .help("`extent` is its width, height and depth, each above 0");
            return Err(misplaced(error, e.span()));
        }
    };
    let map = match &entry.map {
        None => default.map,
        Some(m) if (1..=MAX_SIZE).contains(m.get_ref()) => {
            let pixels = u64::from(*m.get_ref()).pow(2);
            limits
                .check("pixels", pixels, "the pixels of the shadow map")
                .map_err(|e| misplaced(e.into(), m.span()))?;
            *m.get_ref()
        }
        Some(m) => {
            let error = SceneError::new(format!("a shadow map of {0}x{0} pixels", m.get_ref()))
                .help(format!("`map` is its width and height, 1 to {}", MAX_SIZE));
            return Err(misplaced(error, m.span()));
        }
    };
    Ok(Light {
        direction,
        color: entry.color.map_or(default.color, Vec3::from),
        center: entry.center.map(Vec3::from),
        extent,
        map,
    })
}

fn misplaced(error: SceneError, at: Range<usize>) -> Box<Misplaced> {
    Box::new(Misplaced { error, at })
}
