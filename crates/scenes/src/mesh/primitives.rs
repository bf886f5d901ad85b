//! Box, plane, sphere.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};
use serde::Deserialize;

use super::MeshBuilder;
use preshade_draw::scene::Mesh;

/// A box around the origin. Its uvs are in world units, so that a texture has the same size on
/// every face.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Cuboid {
    /// Width, height, depth.
    pub size: [f32; 3],
    /// Cells along each edge.
    pub segments: u32,
    /// Texture repeats per unit.
    pub tiling: f32,
}

impl Default for Cuboid {
    fn default() -> Self {
        Self {
            size: [1.0; 3],
            segments: 1,
            tiling: 1.0,
        }
    }
}

impl Cuboid {
    /// Adds the box to a mesh, centred at `center`.
    pub fn add(self, builder: &mut MeshBuilder, center: Vec3) {
        let half = Vec3::from(self.size) * 0.5;
        // Normal, direction of u, direction of v; u x v is the normal.
        for (n, u, v) in [
            (Vec3::X, Vec3::NEG_Z, Vec3::Y),
            (Vec3::NEG_X, Vec3::Z, Vec3::Y),
            (Vec3::Y, Vec3::X, Vec3::NEG_Z),
            (Vec3::NEG_Y, Vec3::X, Vec3::Z),
            (Vec3::Z, Vec3::X, Vec3::Y),
            (Vec3::NEG_Z, Vec3::NEG_X, Vec3::Y),
        ] {
            let extent = |axis: Vec3| (axis.abs() * half).element_sum() * 2.0;
            builder.patch([self.segments; 2], |s, t| {
                // Count whole cells, so that faces with opposite directions along an edge share its
                // points bit for bit.
                let cells = self.segments.max(1) as f32;
                let across = |s: f32| (2.0 * (s * cells).round() - cells) / cells;
                let p = half * (n + u * across(s) + v * across(t));
                let uv = Vec2::new(s * extent(u), (1.0 - t) * extent(v)) * self.tiling;
                (center + p, n, uv)
            });
        }
    }

    pub fn mesh(self, name: &str) -> Mesh {
        let mut builder = MeshBuilder::default();
        self.add(&mut builder, Vec3::ZERO);
        builder.build(name)
    }
}

/// A plane at y = 0 that faces up.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Plane {
    /// Extent along x and z.
    pub size: [f32; 2],
    /// Cells along x and z.
    pub segments: [u32; 2],
    /// Texture repeats per unit; 0 stretches the texture over the plane.
    pub tiling: f32,
}

impl Default for Plane {
    fn default() -> Self {
        Self {
            size: [1.0; 2],
            segments: [1; 2],
            tiling: 0.0,
        }
    }
}

impl Plane {
    pub fn mesh(self, name: &str) -> Mesh {
        let mut builder = MeshBuilder::default();
        let [w, d] = self.size;
        builder.patch(self.segments, |s, t| {
            let p = Vec3::new((s - 0.5) * w, 0.0, (0.5 - t) * d);
            let uv = Vec2::new(s, 1.0 - t);
            let scale = if self.tiling == 0.0 {
                Vec2::ONE
            } else {
                Vec2::new(w, d) * self.tiling
            };
            (p, Vec3::Y, uv * scale)
        });
        builder.build(name)
    }
}

/// A sphere around the origin, divided into meridians and parallels.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sphere {
    pub radius: f32,
    /// Cells around the equator.
    pub segments: u32,
    /// Cells from pole to pole.
    pub rings: u32,
}

impl Default for Sphere {
    fn default() -> Self {
        Self {
            radius: 0.5,
            segments: 32,
            rings: 16,
        }
    }
}

impl Sphere {
    pub fn mesh(self, name: &str) -> Mesh {
        let mut builder = MeshBuilder::default();
        builder.patch([self.segments.max(3), self.rings.max(2)], |s, t| {
            // The two columns of the seam and the points of each pole must be equal bit for bit.
            let turn = if s == 1.0 { 0.0 } else { s * TAU };
            let lift = (t - 0.5) * PI;
            let ring = if t == 0.0 || t == 1.0 {
                0.0
            } else {
                lift.cos()
            };
            let n = Vec3::new(ring * turn.cos(), lift.sin(), -ring * turn.sin());
            (n * self.radius, n, Vec2::new(s, 1.0 - t))
        });
        builder.build(name)
    }
}
