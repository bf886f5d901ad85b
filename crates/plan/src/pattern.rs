//! The new vertices and triangles of a subdivided triangle.
//!
//! A vertex is given by its three barycentric coordinates, as whole numbers over a common
//! denominator: `[d, 0, 0]` is the triangle's first corner. Corners and edges are thus exact, and
//! both triangles of an edge compute the same points on it.
//!
//! | pattern | vertices | triangles |
//! |---|---|---|
//! | `gl`, even `n` | `3 n (n + 2) / 4 + 1` | `3 n^2 / 2` |
//! | `gl`, odd `n` | `3 (n + 1)^2 / 4` | `(3 n^2 - 1) / 2` |
//! | `uniform` | `(n + 1) (n + 2) / 2` | `n^2` |
//!
//! New triangles have the winding of the divided one.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The highest level, as in every implementation of OpenGL 4.
pub const MAX_LEVEL: u32 = 64;

/// How a triangle is divided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Pattern {
    /// As OpenGL's tessellator with `equal_spacing` and equal levels: concentric triangles, one
    /// segment apart (OpenGL 4.6, section 11.2.2).
    #[default]
    Gl,
    /// Similar triangles, `n` along each edge.
    Uniform,
}

/// The subdivision of a triangle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Divided {
    /// The sum of each vertex's coordinates; at most 192.
    pub denominator: u32,
    /// Barycentric coordinates, times `denominator`.
    pub vertices: Vec<[u32; 3]>,
    /// Three vertex indices each.
    pub triangles: Vec<[u32; 3]>,
}

/// Divides each edge of a triangle into `level` segments, clamped to 1 to [`MAX_LEVEL`].
///
/// Vertices of `gl` come ring by ring from the outermost, each from the corner nearest to the first
/// corner, towards the second and the third. Those of `uniform` come in rows parallel to the edge
/// from the first corner to the second, starting with that edge.
pub fn divide(pattern: Pattern, level: u32) -> Divided {
    let level = level.clamp(1, MAX_LEVEL);
    match pattern {
        Pattern::Gl => concentric(level),
        Pattern::Uniform => rows(level),
    }
}

/// Ring `k` has `m = n - 2k` segments a side. Its corners are at `2k / 3n` from both sides in an
/// equilateral triangle. With denominator `3n`, every vertex is whole, and steps along a side are
/// 3.
fn concentric(n: u32) -> Divided {
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    let mut outer: Option<Ring> = None;
    for k in 0..=n / 2 {
        let segments = n - 2 * k;
        let ring = Ring {
            first: vertices.len() as u32,
            segments,
        };
        if segments == 0 {
            vertices.push([n, n, n]);
        }
        for side in 0..3 {
            for step in 0..segments {
                let mut at = [2 * k; 3];
                at[side] += 3 * (segments - step);
                at[(side + 1) % 3] += 3 * step;
                vertices.push(at);
            }
        }
        if let Some(outer) = outer {
            (0..3).for_each(|side| between(outer, ring, side, &mut triangles));
        }
        outer = Some(ring);
    }
    if n % 2 == 1 {
        let first = vertices.len() as u32 - 3;
        triangles.push([first, first + 1, first + 2]);
    }
    Divided {
        denominator: 3 * n,
        vertices,
        triangles,
    }
}

#[derive(Clone, Copy)]
struct Ring {
    first: u32,
    /// Segments per side. With 0, the ring is one point.
    segments: u32,
}

impl Ring {
    /// The vertex `step` steps along a side.
    fn at(self, side: u32, step: u32) -> u32 {
        match self.segments {
            0 => self.first,
            m => self.first + (side * m + step) % (3 * m),
        }
    }
}

/// The strip along a side between two rings. Step `s` of the inner ring is opposite step `s + 1` of
/// the outer. The two halves of the strip mirror each other; the specification leaves the diagonals
/// open.
fn between(outer: Ring, inner: Ring, side: u32, triangles: &mut Vec<[u32; 3]>) {
    let m = outer.segments;
    for step in 0..m {
        let (a, b) = (outer.at(side, step), outer.at(side, step + 1));
        // The opposite vertices of both ends, clamped to the inner side.
        let across_a = inner.at(side, step.saturating_sub(1));
        let across_b = inner.at(side, step.min(m - 2));
        if across_a == across_b {
            triangles.push([a, b, across_b]);
        } else if 2 * step < m {
            triangles.extend([[a, b, across_b], [a, across_b, across_a]]);
        } else {
            triangles.extend([[a, b, across_a], [b, across_b, across_a]]);
        }
    }
}

fn rows(n: u32) -> Divided {
    let row = |third: u32| (0..=n - third).map(move |second| [n - third - second, second, third]);
    let vertices = (0..=n).flat_map(row).collect();
    let mut triangles = Vec::new();
    let mut first = 0;
    for third in 0..n {
        let across = n - third;
        let next = first + across + 1;
        for i in 0..across {
            triangles.push([first + i, first + i + 1, next + i]);
            if i + 1 < across {
                triangles.push([first + i + 1, next + i + 1, next + i]);
            }
        }
        first = next;
    }
    Divided {
        denominator: n,
        vertices,
        triangles,
    }
}

/// A triangle in rows from its first corner: row and column of each vertex, packed in 8 bits each,
/// and the triangles. The first `n` rows are the triangle at level `n`.
pub(crate) fn from_corner(level: u32) -> (Vec<u32>, Vec<[u32; 3]>) {
    let first = |row: u32| row * (row + 1) / 2;
    let vertices = (0..=level)
        .flat_map(|row| (0..=row).map(move |column| row | column << 8))
        .collect();
    let mut triangles = Vec::new();
    for row in 0..level {
        let (above, below) = (first(row), first(row + 1));
        for i in 0..=row {
            triangles.push([above + i, below + i, below + i + 1]);
            if i < row {
                triangles.push([above + i, below + i + 1, above + i + 1]);
            }
        }
    }
    (vertices, triangles)
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use super::*;

    fn all() -> impl Iterator<Item = (Pattern, u32, Divided)> {
        [Pattern::Gl, Pattern::Uniform]
            .into_iter()
            .flat_map(|p| (1..=MAX_LEVEL).map(move |n| (p, n, divide(p, n))))
    }

    /// Twice the signed area, in units of the whole over the squared denominator.
    fn area(d: &Divided, [a, b, c]: [u32; 3]) -> i64 {
        let at = |v: u32, axis: usize| i64::from(d.vertices[v as usize][axis]);
        let edge = |v: u32| (at(v, 1) - at(a, 1), at(v, 2) - at(a, 2));
        let ((x, y), (z, w)) = (edge(b), edge(c));
        x * w - y * z
    }

    #[test]
    fn counts_are_the_specification_s() {
        for (pattern, n, d) in all() {
            let expected = match (pattern, n % 2) {
                (Pattern::Gl, 0) => (3 * n * (n + 2) / 4 + 1, 3 * n * n / 2),
                (Pattern::Gl, _) => (3 * (n + 1) * (n + 1) / 4, (3 * n * n - 1) / 2),
                (Pattern::Uniform, _) => ((n + 1) * (n + 2) / 2, n * n),
            };
            let found = (d.vertices.len() as u32, d.triangles.len() as u32);
            assert_eq!(found, expected, "{pattern:?} {n}");
        }
        // Level 2 adds four vertices and makes six triangles.
        let two = divide(Pattern::Gl, 2);
        assert_eq!((two.vertices.len(), two.triangles.len()), (3 + 4, 6));
        assert!(two.vertices.contains(&[2, 2, 2]));
    }

    #[test]
    fn triangles_turn_one_way_and_fill_the_whole_once() {
        for (pattern, n, d) in all() {
            let areas: Vec<i64> = d.triangles.iter().map(|t| area(&d, *t)).collect();
            assert!(areas.iter().all(|a| *a > 0), "{pattern:?} {n}");
            let whole = i64::from(d.denominator).pow(2);
            assert_eq!(areas.iter().sum::<i64>(), whole, "{pattern:?} {n}");
        }
    }

    #[test]
    fn vertices_are_there_once_and_used() {
        for (pattern, n, d) in all() {
            let distinct: BTreeSet<_> = d.vertices.iter().collect();
            assert_eq!(distinct.len(), d.vertices.len(), "{pattern:?} {n}");
            let sums = d.vertices.iter().map(|v| v.iter().sum::<u32>());
            assert!(
                sums.into_iter().all(|s| s == d.denominator),
                "{pattern:?} {n}"
            );
            let used: BTreeSet<u32> = d.triangles.iter().flatten().copied().collect();
            assert_eq!(used.len(), d.vertices.len(), "{pattern:?} {n}");
        }
    }

    /// Every edge belongs to two triangles or lies on the outline: no vertex is inside an edge.
    #[test]
    fn there_are_no_t_junctions() {
        for (pattern, n, d) in all() {
            let mut sides: BTreeMap<(u32, u32), u32> = BTreeMap::new();
            for [a, b, c] in &d.triangles {
                for (p, q) in [(a, b), (b, c), (c, a)] {
                    *sides.entry((*p, *q)).or_default() += 1;
                }
            }
            assert!(sides.values().all(|count| *count == 1), "{pattern:?} {n}");
            let open = sides.keys().filter(|(p, q)| !sides.contains_key(&(*q, *p)));
            let mut border = 0;
            for (p, q) in open {
                let (p, q) = (d.vertices[*p as usize], d.vertices[*q as usize]);
                assert!((0..3).any(|i| p[i] == 0 && q[i] == 0), "{pattern:?} {n}");
                border += 1;
            }
            assert_eq!(border, 3 * n, "{pattern:?} {n}");
        }
    }

    #[test]
    fn edges_are_divided_evenly_and_alike_from_both_ends() {
        for (pattern, n, d) in all() {
            for edge in 0..3 {
                let on: BTreeSet<(u32, u32)> = d
                    .vertices
                    .iter()
                    .filter(|v| v[edge] == 0)
                    .map(|v| (v[(edge + 1) % 3], v[(edge + 2) % 3]))
                    .collect();
                let step = d.denominator / n;
                let even: BTreeSet<_> = (0..=n).map(|i| (i * step, (n - i) * step)).collect();
                assert_eq!(on, even, "{pattern:?} {n}");
            }
        }
    }

    #[test]
    fn levels_beyond_the_limit_are_clamped() {
        assert_eq!(divide(Pattern::Gl, 0), divide(Pattern::Gl, 1));
        assert_eq!(divide(Pattern::Uniform, 65), divide(Pattern::Uniform, 64));
    }
}
