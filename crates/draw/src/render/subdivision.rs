//! Subdivides a whole mesh. Vertices on a shared edge exist once.

use std::collections::HashMap;

use preshade_plan::geometry::pack;
use preshade_plan::pattern::{self, Pattern};

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Mesh {
    /// New vertices: three of the author's vertices and packed weights
    /// ([`preshade_plan::geometry::Subdivision::vertices`]; the order in the upper bits is unused).
    pub points: Vec<[u32; 4]>,
    /// Triangles by index of new vertices.
    pub triangles: Vec<[u32; 3]>,
}

/// The origin of a new vertex: the author's vertices with weights, lower index first. Inner
/// vertices belong to one triangle.
type Key = [(u32, u32); 2];

/// Subdivides triangles of the author's vertices. Points appear in the order in which the triangles
/// need them.
pub(crate) fn subdivide(
    pattern: Pattern,
    level: u32,
    triangles: impl IntoIterator<Item = [u32; 3]>,
) -> Mesh {
    let divided = pattern::divide(pattern, level);
    let mut mesh = Mesh::default();
    let mut known: HashMap<Key, u32> = HashMap::new();
    for corners in triangles {
        let place = |weights: &[u32; 3]| {
            let mut point = |point: [u32; 4]| {
                mesh.points.push(point);
                mesh.points.len() as u32 - 1
            };
            let mut heavy: Vec<(u32, u32)> = corners
                .into_iter()
                .zip(*weights)
                .filter(|(_, weight)| *weight > 0)
                .collect();
            heavy.sort_unstable();
            match heavy[..] {
                [(a, whole)] => *known
                    .entry([(a, whole), (a, 0)])
                    .or_insert_with(|| point([a, a, a, pack([whole, 0, 0])])),
                [(a, of_a), (b, of_b)] => *known
                    .entry([(a, of_a), (b, of_b)])
                    .or_insert_with(|| point([a, b, a, pack([of_a, of_b, 0])])),
                _ => point([corners[0], corners[1], corners[2], pack(*weights)]),
            }
        };
        let places: Vec<u32> = divided.vertices.iter().map(place).collect();
        let of = |vertex: u32| places[vertex as usize];
        mesh.triangles
            .extend(divided.triangles.iter().map(|t| t.map(of)));
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles that share an edge.
    const PAIR: [[u32; 3]; 2] = [[0, 1, 2], [2, 1, 3]];

    #[test]
    fn vertices_of_a_shared_edge_are_there_once() {
        for pattern in [Pattern::Gl, Pattern::Uniform] {
            for level in [1, 2, 3, 8] {
                let one = pattern::divide(pattern, level);
                let mesh = subdivide(pattern, level, PAIR);
                let shared = level as usize + 1;
                assert_eq!(mesh.points.len(), 2 * one.vertices.len() - shared);
                assert_eq!(mesh.triangles.len(), 2 * one.triangles.len());
            }
        }
    }

    #[test]
    fn level_1_is_the_mesh_itself() {
        let mesh = subdivide(Pattern::Uniform, 1, PAIR);
        let named = |t: &[u32; 3]| t.map(|p| mesh.points[p as usize][0]);
        assert_eq!(mesh.triangles.iter().map(named).collect::<Vec<_>>(), PAIR);
    }

    /// A torus of quads: a closed mesh of `T` triangles has `T / 2` vertices and `3 T / 2` edges,
    /// so `T n^2 / 2` vertices at level `n` of the uniform pattern.
    #[test]
    fn a_closed_mesh_has_half_as_many_vertices_as_triangles() {
        let (across, along) = (7, 5);
        let at = |x: u32, y: u32| (x % across) + (y % along) * across;
        let mut triangles = Vec::new();
        for y in 0..along {
            for x in 0..across {
                let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
                triangles.extend([[a, b, c], [c, b, d]]);
            }
        }
        for level in 1..=8_usize {
            let mesh = subdivide(Pattern::Uniform, level as u32, triangles.iter().copied());
            assert_eq!(mesh.points.len(), triangles.len() * level * level / 2);
        }
    }
}
