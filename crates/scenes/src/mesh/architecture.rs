//! Stairs, arch, column and curtain for the shipped scenes.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};
use serde::Deserialize;

use super::{Cuboid, MeshBuilder};
use preshade_draw::scene::Mesh;

/// A closed flight of stairs that climbs towards -z: x is centred, y starts at 0, z runs from 0 to
/// `-steps * run`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Stairs {
    /// Number of steps, 1 to 1000.
    pub steps: u32,
    /// Width along x.
    pub width: f32,
    /// Height of a step.
    pub rise: f32,
    /// Depth of a step.
    pub run: f32,
    /// Texture repeats per unit.
    pub tiling: f32,
}

impl Default for Stairs {
    fn default() -> Self {
        Self {
            steps: 8,
            width: 2.0,
            rise: 0.2,
            run: 0.3,
            tiling: 1.0,
        }
    }
}

impl Stairs {
    pub fn mesh(self, name: &str) -> Mesh {
        let mut b = MeshBuilder::default();
        let steps = self.steps.clamp(1, 1000);
        let (w, k) = (self.width * 0.5, self.tiling);
        // Derive positions from step numbers only, so that adjacent faces share them bit for bit.
        let y = |i: u32| i as f32 * self.rise;
        let z = |i: u32| -(i as f32) * self.run;
        let mut quad = |n: Vec3, corners: [Vec3; 4]| {
            let uv = |p: Vec3| {
                let flat = match n.abs().max_position() {
                    0 => Vec2::new(p.z, p.y),
                    1 => Vec2::new(p.x, p.z),
                    _ => Vec2::new(p.x, p.y),
                };
                flat * k
            };
            let [p, q, r, s] = corners.map(|c| b.vertex(c, n, uv(c)));
            b.triangle(p, q, r);
            b.triangle(p, r, s);
        };
        for i in 0..steps {
            let (y0, y1, z0, z1) = (y(i), y(i + 1), z(i), z(i + 1));
            let p = Vec3::new;
            quad(
                Vec3::Z,
                [p(-w, y0, z0), p(w, y0, z0), p(w, y1, z0), p(-w, y1, z0)],
            );
            quad(
                Vec3::Y,
                [p(-w, y1, z0), p(w, y1, z0), p(w, y1, z1), p(-w, y1, z1)],
            );
            // One row of side quads for each step and rise avoids T-junctions.
            for j in 0..=i {
                let (ya, yb) = (y(j), y(j + 1));
                quad(
                    Vec3::X,
                    [p(w, ya, z0), p(w, ya, z1), p(w, yb, z1), p(w, yb, z0)],
                );
                quad(
                    Vec3::NEG_X,
                    [p(-w, ya, z1), p(-w, ya, z0), p(-w, yb, z0), p(-w, yb, z1)],
                );
            }
            quad(
                Vec3::NEG_Y,
                [p(-w, 0.0, z1), p(w, 0.0, z1), p(w, 0.0, z0), p(-w, 0.0, z0)],
            );
            let zb = z(steps);
            quad(
                Vec3::NEG_Z,
                [p(w, y0, zb), p(-w, y0, zb), p(-w, y1, zb), p(w, y1, zb)],
            );
        }
        b.build(name)
    }
}

/// A half-round arch on two piers, in the xy plane and centred in z. The opening is `width` wide
/// and `height + width / 2` high at the crown.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Arch {
    /// Width of the opening.
    pub width: f32,
    /// Height of the piers.
    pub height: f32,
    /// Thickness of piers and ring.
    pub thickness: f32,
    /// Extent along z.
    pub depth: f32,
    /// Segments of the half circle.
    pub segments: u32,
    /// Texture repeats per unit.
    pub tiling: f32,
}

impl Default for Arch {
    fn default() -> Self {
        Self {
            width: 2.0,
            height: 2.0,
            thickness: 0.5,
            depth: 0.6,
            segments: 32,
            tiling: 1.0,
        }
    }
}

impl Arch {
    pub fn mesh(self, name: &str) -> Mesh {
        let mut b = MeshBuilder::default();
        let n = self.segments.clamp(2, 4096);
        let (inner, outer, d) = (
            self.width * 0.5,
            self.width * 0.5 + self.thickness,
            self.depth * 0.5,
        );
        // The profile runs from the right foot over the crown to the left one: a point and an
        // outward direction per row.
        let mut profile = vec![(Vec3::new(1.0, 0.0, 0.0), 0.0)];
        for i in 0..=n {
            let a = PI * i as f32 / n as f32;
            let out = match i {
                0 => Vec3::X,
                i if i == n => Vec3::NEG_X,
                _ => Vec3::new(a.cos(), a.sin(), 0.0),
            };
            profile.push((out, self.height));
        }
        profile.push((Vec3::NEG_X, 0.0));
        let mut along = 0.0;
        for pair in profile.windows(2) {
            let [(o0, y0), (o1, y1)] = [pair[0], pair[1]];
            let at = |o: Vec3, y: f32, r: f32, z: f32| Vec3::new(o.x * r, y + o.y * r, z);
            let length = (at(o1, y1, outer, 0.0) - at(o0, y0, outer, 0.0)).length();
            let (u0, u1) = (along * self.tiling, (along + length) * self.tiling);
            along += length;
            let mut quad = |corners: [(Vec3, Vec3, Vec2); 4]| {
                let [p, q, r, s] = corners.map(|(p, n, uv)| b.vertex(p, n, uv));
                b.triangle(p, q, r);
                b.triangle(p, r, s);
            };
            let (k, t) = (self.depth * self.tiling, self.thickness * self.tiling);
            let uv = Vec2::new;
            quad([
                (at(o0, y0, outer, d), o0, uv(u0, 0.0)),
                (at(o0, y0, outer, -d), o0, uv(u0, k)),
                (at(o1, y1, outer, -d), o1, uv(u1, k)),
                (at(o1, y1, outer, d), o1, uv(u1, 0.0)),
            ]);
            quad([
                (at(o0, y0, inner, -d), -o0, uv(u0, 0.0)),
                (at(o0, y0, inner, d), -o0, uv(u0, k)),
                (at(o1, y1, inner, d), -o1, uv(u1, k)),
                (at(o1, y1, inner, -d), -o1, uv(u1, 0.0)),
            ]);
            quad([
                (at(o0, y0, inner, d), Vec3::Z, uv(u0, 0.0)),
                (at(o0, y0, outer, d), Vec3::Z, uv(u0, t)),
                (at(o1, y1, outer, d), Vec3::Z, uv(u1, t)),
                (at(o1, y1, inner, d), Vec3::Z, uv(u1, 0.0)),
            ]);
            quad([
                (at(o0, y0, outer, -d), Vec3::NEG_Z, uv(u0, t)),
                (at(o0, y0, inner, -d), Vec3::NEG_Z, uv(u0, 0.0)),
                (at(o1, y1, inner, -d), Vec3::NEG_Z, uv(u1, 0.0)),
                (at(o1, y1, outer, -d), Vec3::NEG_Z, uv(u1, t)),
            ]);
        }
        for (x0, x1) in [(inner, outer), (-outer, -inner)] {
            let corner = |x: f32, z: f32| (Vec3::new(x, 0.0, z), Vec2::new(x, z) * self.tiling);
            let [p, q, r, s] = [corner(x0, -d), corner(x1, -d), corner(x1, d), corner(x0, d)]
                .map(|(p, uv)| b.vertex(p, Vec3::NEG_Y, uv));
            b.triangle(p, q, r);
            b.triangle(p, r, s);
        }
        b.build(name)
    }
}

/// A fluted column between a square foot and a square slab, with its foot at y = 0.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Column {
    /// Radius of the shaft.
    pub radius: f32,
    /// Height including foot and slab.
    pub height: f32,
    /// Flutes around the shaft; 0 makes it smooth.
    pub flutes: u32,
    /// Cells around the shaft.
    pub segments: u32,
    /// Cells along the shaft.
    pub rings: u32,
    /// Texture repeats per unit.
    pub tiling: f32,
}

impl Default for Column {
    fn default() -> Self {
        Self {
            radius: 0.3,
            height: 3.0,
            flutes: 12,
            segments: 96,
            rings: 8,
            tiling: 1.0,
        }
    }
}

/// Gap between a column's shaft and its foot or slab. Surfaces in the shipped scenes do not touch
/// unless intended, so that depths never tie.
const GAP: f32 = 0.01;

impl Column {
    pub fn mesh(self, name: &str) -> Mesh {
        let mut b = MeshBuilder::default();
        let slab = self.radius * 0.4;
        let radius = |turn: f32| {
            let flute = (turn * self.flutes as f32 * 0.5).sin().abs();
            self.radius
                * if self.flutes == 0 {
                    1.0
                } else {
                    0.92 + 0.08 * flute
                }
        };
        let point = |s: f32, t: f32| {
            let turn = if s == 1.0 { 0.0 } else { s * TAU };
            // The shaft swells slightly (entasis), and ends just before foot and slab so that no
            // two faces coincide.
            let swell = 1.0 + 0.05 * (t * PI).sin();
            let r = radius(turn) * swell;
            let y = (slab + GAP) + t * (self.height - 2.0 * (slab + GAP));
            Vec3::new(r * turn.cos(), y, -r * turn.sin())
        };
        b.patch([self.segments.max(3), self.rings.max(1)], |s, t| {
            let p = point(s, t);
            let e = 1e-3;
            let wrap = |s: f32| s.rem_euclid(1.0);
            let (du, dv) = (
                point(wrap(s + e), t) - point(wrap(s - e), t),
                point(s, (t + e).min(1.0)) - point(s, (t - e).max(0.0)),
            );
            let n = du.cross(dv).normalize_or(Vec3::new(p.x, 0.0, p.z));
            let uv = Vec2::new(s * TAU * self.radius, (1.0 - t) * self.height);
            (p, n, uv * self.tiling)
        });
        let wide = self.radius * 2.6;
        for y in [slab * 0.5, self.height - slab * 0.5] {
            Cuboid {
                size: [wide, slab, wide],
                segments: 1,
                tiling: self.tiling,
            }
            .add(&mut b, Vec3::new(0.0, y, 0.0));
        }
        b.build(name)
    }
}

/// A hanging cloth in the xy plane with waves along z. Its upper edge is at y = 0 and both sides
/// are visible.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Curtain {
    /// Width and height.
    pub size: [f32; 2],
    /// Cells across and down.
    pub segments: [u32; 2],
    pub folds: f32,
    /// Depth of a fold.
    pub amplitude: f32,
}

impl Default for Curtain {
    fn default() -> Self {
        Self {
            size: [2.0, 3.0],
            segments: [48, 12],
            folds: 6.0,
            amplitude: 0.1,
        }
    }
}

impl Curtain {
    pub fn mesh(self, name: &str) -> Mesh {
        let mut b = MeshBuilder::default();
        let [w, h] = self.size;
        let waves = TAU * self.folds;
        b.patch(self.segments, |s, t| {
            let deep = self.amplitude * (1.2 - t);
            let p = Vec3::new((s - 0.5) * w, (t - 1.0) * h, deep * (s * waves).sin());
            let du = Vec3::new(w, 0.0, deep * waves * (s * waves).cos());
            let dv = Vec3::new(0.0, h, -self.amplitude * (s * waves).sin());
            (p, du.cross(dv).normalize(), Vec2::new(s, 1.0 - t))
        });
        b.build(name)
    }
}
