//! One primitive of a glTF file as a mesh.

use glam::{Mat4, Vec2, Vec3};
use gltf::Accessor;
use gltf::accessor::{DataType, Dimensions, Iter};
use gltf::mesh::Mode;

use super::file::Asset;
use crate::mesh::{MeshBuilder, bounds, positions, unindexed};
use preshade_draw::scene::{Mesh, Stream};

/// How to compute the normals of a primitive without any.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Missing {
    /// The normals of its triangles, as the specification requires.
    Flat,
    /// Their mean at each vertex.
    Smooth,
}

/// The values of a checked accessor as floats. Normalised integers become 0..1 or -1..1.
pub(crate) fn floats(asset: &Asset, accessor: &Accessor<'_>) -> Option<Vec<f32>> {
    macro_rules! read {
        ($ty:ty, $to:expr) => {{
            let bytes = |b: gltf::Buffer<'_>| asset.buffers.get(b.index()).map(AsRef::as_ref);
            let to: fn($ty) -> f32 = $to;
            match accessor.dimensions() {
                Dimensions::Scalar => Iter::<$ty>::new(accessor.clone(), bytes)?.map(to).collect(),
                Dimensions::Vec2 => Iter::<[$ty; 2]>::new(accessor.clone(), bytes)?
                    .flatten()
                    .map(to)
                    .collect(),
                Dimensions::Vec3 => Iter::<[$ty; 3]>::new(accessor.clone(), bytes)?
                    .flatten()
                    .map(to)
                    .collect(),
                Dimensions::Vec4 => Iter::<[$ty; 4]>::new(accessor.clone(), bytes)?
                    .flatten()
                    .map(to)
                    .collect(),
                _ => return None,
            }
        }};
    }
    Some(match (accessor.data_type(), accessor.normalized()) {
        (DataType::F32, _) => read!(f32, |n| n),
        (DataType::U8, true) => read!(u8, |n| f32::from(n) / 255.0),
        (DataType::U8, false) => read!(u8, f32::from),
        (DataType::I8, true) => read!(i8, |n| (f32::from(n) / 127.0).max(-1.0)),
        (DataType::I8, false) => read!(i8, f32::from),
        (DataType::U16, true) => read!(u16, |n| f32::from(n) / 65_535.0),
        (DataType::U16, false) => read!(u16, f32::from),
        (DataType::I16, true) => read!(i16, |n| (f32::from(n) / 32_767.0).max(-1.0)),
        (DataType::I16, false) => read!(i16, f32::from),
        (DataType::U32, _) => return None,
    })
}

/// The mesh of a primitive whose accessors were checked: a list of points, lines or triangles.
///
/// # Errors
/// The primitive has no positions, an index is out of range, or another attribute has fewer
/// elements.
pub(crate) fn read(
    asset: &Asset,
    primitive: &gltf::Primitive<'_>,
    missing: Missing,
) -> Result<Mesh, String> {
    let of = |semantic| floats(asset, &primitive.get(&semantic)?);
    let data = of(gltf::Semantic::Positions).ok_or("a primitive without positions")?;
    let places: Vec<Vec3> = data
        .as_chunks::<3>()
        .0
        .iter()
        .map(|p| Vec3::from(*p))
        .collect();
    let count = places.len();
    let reader = primitive.reader(|b| asset.buffers.get(b.index()).map(AsRef::as_ref));
    let indices: Vec<u32> = match reader.read_indices() {
        Some(indices) => indices.into_u32().collect(),
        None => (0..count as u32).collect(),
    };
    if let Some(index) = indices.iter().find(|i| **i as usize >= count) {
        return Err(format!(
            "a primitive has index {index}, and {count} vertices"
        ));
    }
    let indices = listed(primitive.mode(), &indices);
    let is_triangles = is_triangles(primitive.mode());
    let normals = of(gltf::Semantic::Normals);
    let has_normals = normals.is_some();
    let normals: Vec<Vec3> = match &normals {
        Some(n) => n
            .as_chunks::<3>()
            .0
            .iter()
            .map(|n| Vec3::from(*n))
            .collect(),
        None if is_triangles => smooth_normals(&places, &indices),
        None => vec![Vec3::Y; count],
    };
    let uvs: Vec<Vec2> = match of(gltf::Semantic::TexCoords(0)) {
        Some(uv) => uv
            .as_chunks::<2>()
            .0
            .iter()
            .map(|uv| Vec2::from(*uv))
            .collect(),
        None => vec![Vec2::ZERO; count],
    };
    // The builder generates tangents. Those of the file replace them below.
    let mut b = MeshBuilder::default();
    for (i, place) in places.iter().enumerate() {
        let (Some(normal), Some(uv)) = (normals.get(i), uvs.get(i)) else {
            return Err(format!(
                "a primitive has {count} positions, {} normals and {} texture coordinates",
                normals.len(),
                uvs.len()
            ));
        };
        b.vertex(*place, *normal, *uv);
    }
    if is_triangles {
        for t in indices.as_chunks::<3>().0 {
            b.triangle(t[0], t[1], t[2]);
        }
    }
    let mut mesh = b.build("");
    mesh.indices = Some(indices);
    let tangents = of(gltf::Semantic::Tangents);
    if let (None, Some(Stream::Float { data, .. })) = (&tangents, mesh.streams.get_mut("tangent")) {
        // glTF's v grows downwards, but the second direction of a normal map points up.
        data.iter_mut()
            .skip(3)
            .step_by(4)
            .for_each(|side| *side = -*side);
    }
    let mut put = |name: &str, components: u32, data: Option<Vec<f32>>| {
        if let Some(data) = data.filter(|data| data.len() == count * components as usize) {
            let stream = Stream::Float { components, data };
            mesh.streams.insert(name.to_owned(), stream);
        }
    };
    put("tangent", 4, tangents);
    put("color", 4, colors(asset, primitive));
    put("uv1", 2, of(gltf::Semantic::TexCoords(1)));
    put("weights", 4, of(gltf::Semantic::Weights(0)));
    for (i, target) in primitive.morph_targets().enumerate() {
        let of = |accessor: Option<Accessor<'_>>| floats(asset, &accessor?);
        put(&format!("morph_position_{i}"), 3, of(target.positions()));
        put(&format!("morph_normal_{i}"), 3, of(target.normals()));
        put(&format!("morph_tangent_{i}"), 3, of(target.tangents()));
    }
    if let Some(joints) = reader.read_joints(0) {
        let data: Vec<u32> = joints.into_u16().flatten().map(u32::from).collect();
        if data.len() == count * 4 {
            let stream = Stream::Uint {
                components: 4,
                data,
            };
            mesh.streams.insert("joints".to_owned(), stream);
        }
    }
    if !has_normals && is_triangles && missing == Missing::Flat {
        mesh = flat(mesh);
    }
    mesh.bounds = bounds(positions(&mesh));
    Ok(mesh)
}

pub(crate) fn is_triangles(mode: Mode) -> bool {
    matches!(
        mode,
        Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan
    )
}

/// Converts the indices of a strip, fan or loop to those of a list.
fn listed(mode: Mode, indices: &[u32]) -> Vec<u32> {
    let pairs = || indices.windows(2).flat_map(|w| [w[0], w[1]]);
    match mode {
        Mode::Points | Mode::Lines | Mode::Triangles => indices.to_vec(),
        Mode::LineStrip => pairs().collect(),
        Mode::LineLoop => {
            let ends = [indices.last(), indices.first()];
            pairs().chain(ends.into_iter().flatten().copied()).collect()
        }
        Mode::TriangleStrip => {
            let turned = |(i, w): (usize, &[u32])| match i % 2 {
                0 => [w[0], w[1], w[2]],
                _ => [w[0], w[2], w[1]],
            };
            indices.windows(3).enumerate().flat_map(turned).collect()
        }
        Mode::TriangleFan => {
            let rest = indices.get(1..).unwrap_or_default();
            rest.windows(2)
                .flat_map(|w| [w[0], w[1], indices[0]])
                .collect()
        }
    }
}

/// Vertex colours. Without alpha in the file, it is 1.
fn colors(asset: &Asset, primitive: &gltf::Primitive<'_>) -> Option<Vec<f32>> {
    let accessor = primitive.get(&gltf::Semantic::Colors(0))?;
    let data = floats(asset, &accessor)?;
    Some(match accessor.dimensions() {
        Dimensions::Vec3 => {
            let opaque = |c: &[f32; 3]| [c[0], c[1], c[2], 1.0];
            data.as_chunks::<3>().0.iter().flat_map(opaque).collect()
        }
        _ => data,
    })
}

/// Gives each triangle its own vertices and normals.
fn flat(mesh: Mesh) -> Mesh {
    let mut mesh = unindexed(mesh);
    let places: Vec<Vec3> = positions(&mesh).collect();
    let mut normals = Vec::with_capacity(places.len() * 3);
    for [a, b, c] in places.as_chunks::<3>().0 {
        let normal = (*b - *a).cross(*c - *a).normalize_or(Vec3::Y);
        normals.extend([normal; 3].iter().flat_map(Vec3::to_array));
    }
    let stream = Stream::Float {
        components: 3,
        data: normals,
    };
    mesh.streams.insert("normal".to_owned(), stream);
    mesh
}

/// Smooth normals: the area-weighted mean of the adjacent triangles' normals.
fn smooth_normals(places: &[Vec3], indices: &[u32]) -> Vec<Vec3> {
    let mut sums = vec![Vec3::ZERO; places.len()];
    for t in indices.chunks_exact(3) {
        let [a, b, c] = [t[0] as usize, t[1] as usize, t[2] as usize];
        let n = (places[b] - places[a]).cross(places[c] - places[a]);
        for i in [a, b, c] {
            sums[i] += n;
        }
    }
    sums.into_iter().map(|n| n.normalize_or(Vec3::Y)).collect()
}

/// Applies the morph targets to a mesh's vertices, and removes them.
pub(crate) fn morphed(mesh: &mut Mesh, weights: &[f32]) {
    for (stream, count) in [("position", 3), ("normal", 3), ("tangent", 4)] {
        for (i, weight) in weights.iter().enumerate() {
            let target = mesh.streams.get(&format!("morph_{stream}_{i}"));
            let Some(Stream::Float { data: moves, .. }) = target.cloned() else {
                continue;
            };
            if let Some(Stream::Float { data, .. }) = mesh.streams.get_mut(stream) {
                for (at, by) in data.chunks_exact_mut(count).zip(moves.chunks_exact(3)) {
                    for (n, by) in at.iter_mut().zip(by) {
                        *n += weight * by;
                    }
                }
            }
        }
    }
    mesh.streams.retain(|name, _| !name.starts_with("morph_"));
    mesh.bounds = bounds(positions(mesh));
}

/// Applies the joints to a mesh's vertices, and removes them.
pub(crate) fn skinned(mesh: &mut Mesh, joints: &[Mat4]) {
    let (joint, weight) = (
        mesh.streams.remove("joints"),
        mesh.streams.remove("weights"),
    );
    let (Some(Stream::Uint { data: which, .. }), Some(Stream::Float { data: weights, .. })) =
        (joint, weight)
    else {
        return;
    };
    let which = which.as_chunks::<4>().0.iter();
    let matrices: Vec<Mat4> = which
        .zip(weights.as_chunks::<4>().0)
        .map(|(which, weights)| {
            let parts = which.iter().zip(weights);
            parts.fold(Mat4::ZERO, |sum, (joint, weight)| {
                let joint = joints.get(*joint as usize).copied();
                sum + joint.unwrap_or(Mat4::IDENTITY) * *weight
            })
        })
        .collect();
    for (stream, count, w) in [
        ("position", 3, 1.0),
        ("normal", 3, 0.0),
        ("tangent", 4, 0.0),
    ] {
        if let Some(Stream::Float { data, .. }) = mesh.streams.get_mut(stream) {
            for (at, matrix) in data.chunks_exact_mut(count).zip(&matrices) {
                let moved = *matrix * Vec3::new(at[0], at[1], at[2]).extend(w);
                let moved = match stream {
                    "position" => moved.truncate(),
                    _ => moved.truncate().normalize_or_zero(),
                };
                at[..3].copy_from_slice(&moved.to_array());
            }
        }
    }
    mesh.bounds = bounds(positions(mesh));
}
