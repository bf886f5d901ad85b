//! Crossed cards for grass and distant leaves.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};
use serde::Deserialize;

use super::MeshBuilder;
use preshade_draw::scene::Mesh;

/// Upright cards that intersect in the y axis at equal angles and stand on the ground. Uvs run from
/// (0, 1) at the ground to (1, 0); normals point out of the cards.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Cards {
    pub count: u32,
    /// Width and height of each.
    pub size: [f32; 2],
    /// Cells across and up.
    pub segments: [u32; 2],
}

impl Default for Cards {
    fn default() -> Self {
        Self {
            count: 2,
            size: [1.0, 1.0],
            segments: [1, 1],
        }
    }
}

impl Cards {
    pub fn mesh(self, name: &str) -> Mesh {
        let mut builder = MeshBuilder::default();
        let [width, height] = self.size;
        for card in 0..self.count.max(1) {
            let turn = PI * card as f32 / self.count.max(1) as f32;
            let along = Vec3::new(turn.cos(), 0.0, turn.sin());
            let normal = along.cross(Vec3::Y);
            builder.patch(self.segments.map(|n| n.max(1)), |s, t| {
                let at = along * ((s - 0.5) * width) + Vec3::Y * (t * height);
                (at, normal, Vec2::new(s, 1.0 - t))
            });
        }
        builder.build(name)
    }
}
