//! Sizes of a scene's parts, computed before they are allocated.

use crate::file::entries::MeshEntry;
use preshade_draw::scene::{Draw, Mesh, Stream, Value};

/// The quantity that the limit `scene-bytes` counts.
pub(super) const SCENE_BYTES: &str = "the bytes of vertex data, texels and draws";

/// Largest width and height of a target: WebGPU's default `maxTextureDimension2D`.
pub(super) const MAX_SIZE: u32 = 8192;

/// Vertices of a patch of cells.
fn patch([n, m]: [u32; 2]) -> u64 {
    let points = |cells: u32| u64::from(cells.max(3)) + 1;
    points(n).saturating_mul(points(m))
}

/// An upper bound of the vertices of an entry's shape. Files and merged meshes count as 0.
pub(super) fn vertices(entry: &MeshEntry) -> u64 {
    let square = |n: u32| patch([n, n]);
    let shapes = [
        entry.cuboid.map(|s| square(s.segments).saturating_mul(6)),
        entry.plane.map(|s| patch(s.segments)),
        entry.sphere.map(|s| patch([s.segments, s.rings])),
        entry
            .teapot
            .map(|s| patch(s.segments.map(|n| n.min(256))) * 32),
        // Each step has a row of side quads and a rise.
        entry.stairs.map(|s| {
            let steps = u64::from(s.steps.min(1000));
            steps * (steps + 9) * 4
        }),
        entry
            .arch
            .map(|s| (u64::from(s.segments.min(4096)) + 4) * 16),
        entry
            .column
            .map(|s| patch([s.segments, s.rings]).saturating_add(96)),
        entry.curtain.map(|s| patch(s.segments)),
        entry
            .cards
            .map(|s| patch(s.segments).saturating_mul(s.count.max(1).into())),
        entry.wire_sphere.map(|s| patch([s.segments, s.rings])),
        // These vertices have no data.
        entry.vertices.map(|s| u64::from(s.count) / 16),
    ];
    shapes
        .into_iter()
        .flatten()
        .fold(0, |sum: u64, n| sum.saturating_add(n))
}

/// Bytes of a stream.
pub(super) fn of_stream(stream: &Stream) -> u64 {
    4 * match stream {
        Stream::Float { data, .. } => data.len() as u64,
        Stream::Uint { data, .. } => data.len() as u64,
    }
}

/// Bytes of a mesh.
pub(super) fn of_mesh(mesh: &Mesh) -> u64 {
    let indices = mesh.indices.as_ref().map_or(0, |i| 4 * i.len() as u64);
    indices + mesh.streams.values().map(of_stream).sum::<u64>()
}

/// Bytes of a texture with its mips, which add a third.
pub(super) fn of_texels([width, height]: [u32; 2]) -> u64 {
    let bytes = (u64::from(width) * u64::from(height)).saturating_mul(4);
    bytes.saturating_add(bytes / 3)
}

/// Bytes of joint matrices.
pub(super) fn of_joints(joints: usize) -> u64 {
    (joints * size_of::<glam::Mat4>()) as u64
}

/// Bytes of a draw with its name, values and weights, without streams and joints.
pub(super) fn of_draw(draw: &Draw) -> u64 {
    let values = draw.values.iter().map(|(name, value)| {
        name.len()
            + size_of::<(String, Value)>()
            + match value {
                Value::Numbers(numbers) => size_of_val(numbers.as_slice()),
                Value::Semantic(name) => name.len(),
            }
    });
    let weights = size_of_val(draw.morph_weights.as_slice());
    (size_of::<Draw>() + draw.name.len() + weights + values.sum::<usize>()) as u64
}
