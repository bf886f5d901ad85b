//! The Utah teapot (Newell 1975) as bicubic Bézier patches: the profile of its bodies of
//! revolution, and half sections of handle and spout.

use glam::{Vec2, Vec3};
use serde::Deserialize;

use super::{MeshBuilder, transformed};
use preshade_draw::scene::Mesh;

/// The teapot on y = 0 with its spout towards +x.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Teapot {
    /// Height in scene units.
    pub size: f32,
    /// Cells of each of its 32 patches, 1 to 256: around the axis of its body (a quarter turn) or
    /// tube (half a turn), and along it.
    ///
    /// It has `64 * around * along` triangles, minus `8 * around` without area at the two poles.
    /// `[13, 19]` gives the 15,704 triangles of the widely used OBJ file.
    pub segments: [u32; 2],
}

impl Default for Teapot {
    fn default() -> Self {
        Self {
            size: 1.0,
            segments: [10, 10],
        }
    }
}

/// Radius and height of the control points, patch by patch: rim, body, body, bottom, knob, lid.
const PROFILE: [[(f32, f32); 4]; 6] = [
    [(1.4, 2.4), (1.3375, 2.53125), (1.4375, 2.53125), (1.5, 2.4)],
    [(1.5, 2.4), (1.75, 1.875), (2.0, 1.35), (2.0, 0.9)],
    [(2.0, 0.9), (2.0, 0.45), (1.5, 0.225), (1.5, 0.15)],
    [(1.5, 0.15), (1.5, 0.075), (1.425, 0.0), (0.0, 0.0)],
    [(0.0, 3.15), (0.8, 3.15), (0.0, 2.85), (0.2, 2.7)],
    [(0.2, 2.7), (0.4, 2.55), (1.3, 2.55), (1.3, 2.4)],
];

/// Newell's inner control points of a quarter circle of radius 1.
const QUARTER: f32 = 0.56;

/// A section of handle or spout: (x, height) of the two ends of its half ring, and the ring's half
/// width.
type Section = ((f32, f32), (f32, f32), f32);

/// Two patches of the handle and two of the spout, four sections each.
const TUBES: [[Section; 4]; 4] = [
    [
        ((-1.6, 2.025), (-1.5, 2.25), 0.3),
        ((-2.3, 2.025), (-2.5, 2.25), 0.3),
        ((-2.7, 2.025), (-3.0, 2.25), 0.3),
        ((-2.7, 1.8), (-3.0, 1.8), 0.3),
    ],
    [
        ((-2.7, 1.8), (-3.0, 1.8), 0.3),
        ((-2.7, 1.575), (-3.0, 1.35), 0.3),
        ((-2.5, 1.125), (-2.65, 0.9375), 0.3),
        ((-2.0, 0.9), (-1.9, 0.6), 0.3),
    ],
    [
        ((1.7, 1.425), (1.7, 0.6), 0.66),
        ((2.6, 1.425), (3.1, 0.825), 0.66),
        ((2.3, 2.1), (2.4, 2.025), 0.25),
        ((2.7, 2.4), (3.3, 2.4), 0.25),
    ],
    [
        ((2.7, 2.4), (3.3, 2.4), 0.25),
        ((2.8, 2.475), (3.525, 2.49375), 0.25),
        ((2.9, 2.475), (3.45, 2.5125), 0.15),
        ((2.8, 2.4), (3.2, 2.4), 0.15),
    ],
];

/// Control points, rows along `s`.
type Patch = [[Vec3; 4]; 4];

/// The direction of a patch's rows. It decides the number of cells, so that neighbours share the
/// points of an edge.
#[derive(Clone, Copy)]
enum Rows {
    /// Along the axis of a body or tube.
    Along,
    /// Around that axis.
    Round,
}

impl Teapot {
    pub fn mesh(self, name: &str) -> Mesh {
        let mut b = MeshBuilder::default();
        let [round, along] = self.segments.map(|n| n.clamp(1, 256));
        for (patch, rows) in patches() {
            let cells = match rows {
                Rows::Along => [along, round],
                Rows::Round => [round, along],
            };
            b.patch(cells, |s, t| {
                let (p, normal) = evaluate(&patch, s, t);
                (p, normal, Vec2::new(t, s))
            });
        }
        let scale = self.size / 3.15;
        transformed(b.build(name), glam::Mat4::from_scale(Vec3::splat(scale)))
    }
}

/// All 32 patches, y up. The cross product of the s and t directions points outward.
fn patches() -> Vec<(Patch, Rows)> {
    let mut out = Vec::new();
    for profile in PROFILE {
        for quarter in 0..4 {
            let patch = profile.map(|(r, y)| {
                [(1.0, 0.0), (1.0, QUARTER), (QUARTER, 1.0), (0.0, 1.0)].map(|(c, d)| {
                    let (x, z) = match quarter {
                        0 => (c, d),
                        1 => (-d, c),
                        2 => (-c, -d),
                        _ => (d, -c),
                    };
                    Vec3::new(r * x, y, -r * z)
                })
            });
            out.push((patch, Rows::Along));
        }
    }
    for tube in TUBES {
        for side in [1.0_f32, -1.0] {
            let half = tube.map(|((x0, y0), (x1, y1), w)| {
                [
                    Vec3::new(x0, y0, 0.0),
                    Vec3::new(x0, y0, side * w),
                    Vec3::new(x1, y1, side * w),
                    Vec3::new(x1, y1, 0.0),
                ]
            });
            // From outside, the two halves run in opposite directions.
            out.push(if side > 0.0 {
                (transposed(half), Rows::Round)
            } else {
                (half, Rows::Along)
            });
        }
    }
    out
}

fn transposed(p: Patch) -> Patch {
    std::array::from_fn(|i| std::array::from_fn(|j| p[j][i]))
}

/// Point and unit normal. At a pole the normal is that of a point just beside it.
fn evaluate(patch: &Patch, s: f32, t: f32) -> (Vec3, Vec3) {
    let curve = |w: [f32; 4], v: [f32; 4]| {
        let row = |r: &[Vec3; 4]| r[0] * v[0] + r[1] * v[1] + r[2] * v[2] + r[3] * v[3];
        row(&patch[0]) * w[0]
            + row(&patch[1]) * w[1]
            + row(&patch[2]) * w[2]
            + row(&patch[3]) * w[3]
    };
    let normal = |s: f32, t: f32| {
        curve(slope(s), weights(t))
            .cross(curve(weights(s), slope(t)))
            .try_normalize()
    };
    let inward = |v: f32| v + (0.5 - v) * 1e-3;
    let n = normal(s, t)
        .or_else(|| normal(inward(s), inward(t)))
        .unwrap_or(Vec3::Y);
    // A pole is one point, bit for bit.
    let pole = [(0.0, &patch[0]), (1.0, &patch[3])]
        .into_iter()
        .find(|(end, row)| s == *end && row.iter().all(|p| *p == row[0]));
    let p = pole.map_or_else(|| curve(weights(s), weights(t)), |(_, row)| row[0]);
    (p, n)
}

/// Cubic Bernstein polynomials.
fn weights(t: f32) -> [f32; 4] {
    let u = 1.0 - t;
    [u * u * u, 3.0 * t * u * u, 3.0 * t * t * u, t * t * t]
}

/// Derivatives of [`weights`].
fn slope(t: f32) -> [f32; 4] {
    let u = 1.0 - t;
    [
        -3.0 * u * u,
        3.0 * u * u - 6.0 * t * u,
        6.0 * t * u - 3.0 * t * t,
        3.0 * t * t,
    ]
}
