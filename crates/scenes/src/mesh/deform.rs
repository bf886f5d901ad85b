//! Skins and morph targets for generated meshes.

use glam::{Mat4, Quat, Vec3};
use serde::Deserialize;

use super::positions;
use preshade_draw::scene::{Mesh, Stream};

/// A chain of joints along y. Each vertex follows the two joints nearest to its height.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Skin {
    /// Number of joints, 1 to 256.
    pub joints: u32,
    /// Bend of the whole chain around z, in degrees.
    pub bend: f32,
    /// Twist of the whole chain around y, in degrees.
    pub twist: f32,
}

impl Default for Skin {
    fn default() -> Self {
        Self {
            joints: 4,
            bend: 60.0,
            twist: 0.0,
        }
    }
}

impl Skin {
    /// Adds `joints` and `weights` to a mesh. Returns the joint matrices of the bent pose with the
    /// inverse bind pose applied.
    pub fn apply(self, mesh: &mut Mesh) -> Vec<Mat4> {
        let n = self.joints.clamp(1, 256);
        let [low, high] = [mesh.bounds[0].y, mesh.bounds[1].y];
        let span = (high - low).max(1e-6);
        let (mut joints, mut weights) = (Vec::new(), Vec::new());
        for p in positions(mesh) {
            let along = ((p.y - low) / span * n as f32 - 0.5).clamp(0.0, n as f32 - 1.0);
            let first = (along.floor() as u32).min(n - 1);
            let second = (first + 1).min(n - 1);
            let blend = along - first as f32;
            joints.extend([first, second, 0, 0]);
            weights.extend([1.0 - blend, blend, 0.0, 0.0]);
        }
        let put = |mesh: &mut Mesh, name: &str, s: Stream| mesh.streams.insert(name.to_owned(), s);
        put(
            mesh,
            "joints",
            Stream::Uint {
                components: 4,
                data: joints,
            },
        );
        put(
            mesh,
            "weights",
            Stream::Float {
                components: 4,
                data: weights,
            },
        );
        let step = span / n as f32;
        let turn = Quat::from_rotation_z((self.bend / n as f32).to_radians())
            * Quat::from_rotation_y((self.twist / n as f32).to_radians());
        let mut pose = Mat4::from_translation(Vec3::Y * low);
        (0..n)
            .map(|i| {
                if i > 0 {
                    pose = pose * Mat4::from_translation(Vec3::Y * step) * Mat4::from_quat(turn);
                }
                let bind = Mat4::from_translation(Vec3::Y * (low + step * i as f32));
                pose * bind.inverse()
            })
            .collect()
    }
}

/// Two morph targets: a bulge, and a twist around y.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Morph {
    /// Largest displacement of the first target along the normals.
    pub bulge: f32,
    /// Twist of the second target from foot to head, in degrees.
    pub twist: f32,
}

impl Default for Morph {
    fn default() -> Self {
        Self {
            bulge: 0.2,
            twist: 60.0,
        }
    }
}

impl Morph {
    /// Adds `morph_position_0`, `morph_normal_0`, `morph_position_1` and `morph_normal_1` as
    /// offsets.
    pub fn apply(self, mesh: &mut Mesh) {
        let normals: Vec<Vec3> = match mesh.streams.get("normal") {
            Some(Stream::Float { data, .. }) => {
                data.chunks_exact(3).map(Vec3::from_slice).collect()
            }
            _ => vec![Vec3::Y; mesh.vertex_count as usize],
        };
        let low = mesh.bounds[0].y;
        let span = (mesh.bounds[1].y - low).max(1e-6);
        let mut targets: [Vec<f32>; 4] = Default::default();
        for (p, n) in positions(mesh).zip(normals) {
            let up = (p.y - low) / span;
            let swell = n * self.bulge * (up * std::f32::consts::PI).sin();
            let turn = Quat::from_rotation_y((self.twist * up).to_radians());
            targets[0].extend(swell.to_array());
            targets[1].extend([0.0; 3]);
            targets[2].extend((turn * p - p).to_array());
            targets[3].extend((turn * n - n).to_array());
        }
        for (data, name) in targets.into_iter().zip([
            "morph_position_0",
            "morph_normal_0",
            "morph_position_1",
            "morph_normal_1",
        ]) {
            let stream = Stream::Float {
                components: 3,
                data,
            };
            mesh.streams.insert(name.to_owned(), stream);
        }
    }
}
