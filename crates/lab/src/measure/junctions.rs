//! Finds T-junctions between draws: edges that one draw divides and its neighbour does not.
//!
//! New vertices lie on the edge in real numbers, but the rasteriser snaps them to its grid off the
//! edge. Pixels along the edge may show the background or be drawn twice. Within one draw all edges
//! are divided alike.

use std::cmp::Reverse;
use std::collections::HashSet;

use glam::Mat4;
use preshade_plan::geometry::Geometry;
use preshade_plan::plan::Plan;
use preshade_plan::state::Topology;
use serde::{Deserialize, Serialize};

use preshade_draw::scene::{Draw, DrawRange, Scene, Stream};
use preshade_scenes::mesh;

/// Edges that two draws share and divide differently.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Junction {
    /// The draw that is subdivided, the more finely one first in the scene where both are.
    pub divided: String,
    pub beside: String,
    /// Number of edges, each once.
    pub edges: u64,
}

/// An edge, as the bits of its ends in the world, the lesser first.
type Edge = [[u32; 3]; 2];

/// The T-junctions of a scene drawn with `plans`, one a material. Two edges are equal if both ends
/// have equal bits in world space, before the vertex stage moves them. An edge that is part of
/// another edge is not found.
pub fn junctions(scene: &Scene, plans: &[Plan]) -> Vec<Junction> {
    let geometry = |draw: &Draw| plans.get(draw.material)?.main().map(|p| &p.geometry);
    let draws: Vec<(&Draw, &Geometry)> = scene
        .draws
        .iter()
        .filter_map(|d| Some((d, geometry(d)?)))
        .collect();
    let first = draws.first().map(|(_, g)| fineness(g));
    if draws.iter().all(|(_, g)| Some(fineness(g)) == first) {
        return Vec::new();
    }
    let edges: Vec<HashSet<Edge>> = draws.iter().map(|(d, _)| edges(scene, d)).collect();
    let mut found = Vec::new();
    for (i, (a, of_a)) in draws.iter().enumerate() {
        for (j, (b, of_b)) in draws.iter().enumerate().skip(i + 1) {
            if fineness(of_a) == fineness(of_b) {
                continue;
            }
            let shared = edges[i].intersection(&edges[j]).count() as u64;
            let (divided, beside) = match fineness(of_a) > fineness(of_b) {
                true => (a, b),
                false => (b, a),
            };
            if shared > 0 {
                found.push(Junction {
                    divided: divided.name.clone(),
                    beside: beside.name.clone(),
                    edges: shared,
                });
            }
        }
    }
    found
}

/// How finely an edge is divided: the most segments, and the least length of a segment in pixels.
fn fineness(geometry: &Geometry) -> (u32, Reverse<u32>) {
    match geometry.subdivision() {
        Some(s) if s.level > 1 => (s.level, Reverse(s.edge_pixels.unwrap_or(0))),
        _ => (1, Reverse(0)),
    }
}

/// All edges of a draw's triangles, over its instances.
fn edges(scene: &Scene, draw: &Draw) -> HashSet<Edge> {
    let (Some(mesh), Some(material)) = (
        scene.meshes.get(draw.mesh),
        scene.materials.get(draw.material),
    ) else {
        return HashSet::new();
    };
    let positions: Vec<_> = mesh::positions(mesh).collect();
    let DrawRange {
        first,
        count,
        base_vertex,
        first_instance,
    } = draw.range;
    let indices: Vec<u32> = match &mesh.indices {
        Some(indices) => indices
            .iter()
            .map(|i| i.wrapping_add_signed(base_vertex))
            .collect(),
        None => (0..mesh.vertex_count).collect(),
    };
    let indices: Vec<u32> = indices
        .into_iter()
        .skip(first as usize)
        .take(count.map_or(usize::MAX, |c| c as usize))
        .collect();
    let step = match material.state.primitive.topology {
        Topology::TriangleList => 3,
        Topology::TriangleStrip => 1,
        Topology::PointList | Topology::LineList | Topology::LineStrip => return HashSet::new(),
    };
    let instances: Vec<Mat4> = match draw.instance_streams.get("instance_transform") {
        Some(Stream::Float { data, .. }) => data
            .as_chunks::<16>()
            .0
            .iter()
            .map(Mat4::from_cols_array)
            .skip(first_instance as usize)
            .take(draw.instances as usize)
            .collect(),
        _ => vec![Mat4::IDENTITY],
    };
    let mut found = HashSet::new();
    for instance in instances {
        let to_world = draw.transform * instance;
        let corner = |index: u32| {
            let position = positions.get(index as usize)?;
            // An addition of zero: -0 is 0.
            let world = to_world.transform_point3(*position) + glam::Vec3::ZERO;
            Some(world.to_array().map(f32::to_bits))
        };
        for triangle in indices.windows(3).step_by(step) {
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                if let (Some(a), Some(b)) = (corner(triangle[a]), corner(triangle[b])) {
                    found.insert([a.min(b), a.max(b)]);
                }
            }
        }
    }
    found
}
