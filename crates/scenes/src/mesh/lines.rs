//! Meshes without triangles: a wireframe sphere and bare vertices.

use std::collections::BTreeMap;
use std::f32::consts::{PI, TAU};

use glam::Vec3;
use serde::Deserialize;

use super::bounds;
use preshade_draw::scene::{Mesh, Stream};

/// Meridians and parallels of a sphere as a line list. The material's topology must be `line-list`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WireSphere {
    pub radius: f32,
    /// Meridians.
    pub segments: u32,
    /// Cells from pole to pole.
    pub rings: u32,
}

impl Default for WireSphere {
    fn default() -> Self {
        Self {
            radius: 0.5,
            segments: 24,
            rings: 12,
        }
    }
}

impl WireSphere {
    pub fn mesh(self, name: &str) -> Mesh {
        let (n, m) = (self.segments.max(3), self.rings.max(2));
        let (mut positions, mut normals, mut indices) = (Vec::new(), Vec::new(), Vec::new());
        for j in 0..=m {
            for i in 0..n {
                let (turn, lift) = (TAU * i as f32 / n as f32, PI * (j as f32 / m as f32 - 0.5));
                let d = Vec3::new(lift.cos() * turn.cos(), lift.sin(), lift.cos() * turn.sin());
                positions.push(d * self.radius);
                normals.push(d);
                let at = j * n + i;
                if j < m {
                    indices.extend([at, at + n]);
                }
                if j > 0 && j < m {
                    indices.extend([at, j * n + (i + 1) % n]);
                }
            }
        }
        let stream = |v: &[Vec3]| Stream::Float {
            components: 3,
            data: v.iter().flat_map(|p| p.to_array()).collect(),
        };
        Mesh {
            name: name.to_owned(),
            vertex_count: positions.len() as u32,
            streams: BTreeMap::from([
                ("position".to_owned(), stream(&positions)),
                ("normal".to_owned(), stream(&normals)),
            ]),
            indices: Some(indices),
            bounds: bounds(positions),
        }
    }
}

/// Vertices without data, for shaders that generate them from `vertex_index`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vertices {
    pub count: u32,
}

impl Vertices {
    pub fn mesh(self, name: &str) -> Mesh {
        Mesh {
            name: name.to_owned(),
            vertex_count: self.count,
            streams: BTreeMap::new(),
            indices: None,
            bounds: [Vec3::splat(-0.5), Vec3::splat(0.5)],
        }
    }
}
