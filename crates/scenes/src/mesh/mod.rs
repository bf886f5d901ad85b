//! Generated meshes.
//!
//! Right-handed, y up, counter-clockwise outward triangles, unit normals, tangents along increasing
//! u with the handedness in w (glTF's rule).

use std::collections::BTreeMap;

use glam::{Mat4, Vec2, Vec3};

use preshade_draw::scene::{Mesh, Stream};

mod architecture;
mod cards;
mod deform;
mod lines;
mod primitives;
mod teapot;

pub use architecture::{Arch, Column, Curtain, Stairs};
pub use cards::Cards;
pub use deform::{Morph, Skin};
pub use lines::{Vertices, WireSphere};
pub use primitives::{Cuboid, Plane, Sphere};
pub use teapot::Teapot;

#[derive(Clone, Debug, Default)]
pub struct MeshBuilder {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    indices: Vec<u32>,
}

impl MeshBuilder {
    /// Adds a vertex and returns its index.
    pub fn vertex(&mut self, position: Vec3, normal: Vec3, uv: Vec2) -> u32 {
        self.positions.push(position);
        self.normals.push(normal);
        self.uvs.push(uv);
        self.positions.len() as u32 - 1
    }

    /// Adds a triangle, counter-clockwise from its front.
    pub fn triangle(&mut self, a: u32, b: u32, c: u32) {
        self.indices.extend([a, b, c]);
    }

    /// Adds a grid of `segments` cells over the unit square. `at` returns position, normal and uv
    /// for `(s, t)` in `[0, 1]`. The cross product of the s and t directions points to the front.
    /// Triangles without area (at the pole of a sphere) are left out.
    pub fn patch(&mut self, segments: [u32; 2], at: impl Fn(f32, f32) -> (Vec3, Vec3, Vec2)) {
        let [n, m] = segments.map(|s| s.max(1));
        let first = self.positions.len() as u32;
        for j in 0..=m {
            for i in 0..=n {
                let (p, normal, uv) = at(i as f32 / n as f32, j as f32 / m as f32);
                self.vertex(p, normal, uv);
            }
        }
        for j in 0..m {
            for i in 0..n {
                let a = first + j * (n + 1) + i;
                let (b, c, d) = (a + 1, a + n + 2, a + n + 1);
                for [p, q, r] in [[a, b, c], [a, c, d]] {
                    let at = |k: u32| self.positions[k as usize];
                    let area = (at(q) - at(p)).cross(at(r) - at(p)).length();
                    if area > 1e-9 {
                        self.triangle(p, q, r);
                    }
                }
            }
        }
    }

    /// The mesh, with tangents from its uvs.
    pub fn build(self, name: &str) -> Mesh {
        let tangents = tangents(&self.positions, &self.normals, &self.uvs, &self.indices);
        let flat3 = |v: &[Vec3]| v.iter().flat_map(|p| p.to_array()).collect::<Vec<f32>>();
        let mut streams = BTreeMap::new();
        let mut put = |name: &str, components: u32, data: Vec<f32>| {
            streams.insert(name.to_owned(), Stream::Float { components, data });
        };
        put("position", 3, flat3(&self.positions));
        put("normal", 3, flat3(&self.normals));
        put("tangent", 4, tangents.concat());
        put(
            "uv",
            2,
            self.uvs.iter().flat_map(|v| v.to_array()).collect(),
        );
        put("color", 4, vec![1.0; self.positions.len() * 4]);
        Mesh {
            name: name.to_owned(),
            vertex_count: self.positions.len() as u32,
            streams,
            indices: Some(self.indices),
            bounds: bounds(self.positions.iter().copied()),
        }
    }
}

/// The bounding box of points; all zero without points.
pub(crate) fn bounds(points: impl IntoIterator<Item = Vec3>) -> [Vec3; 2] {
    points
        .into_iter()
        .map(|p| [p, p])
        .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
        .unwrap_or([Vec3::ZERO; 2])
}

/// Tangents: accumulates each triangle's u direction at its corners and orthogonalises it to the
/// normal (Lengyel 2001).
fn tangents(positions: &[Vec3], normals: &[Vec3], uvs: &[Vec2], indices: &[u32]) -> Vec<[f32; 4]> {
    let mut along_u = vec![Vec3::ZERO; positions.len()];
    let mut along_v = vec![Vec3::ZERO; positions.len()];
    for t in indices.chunks_exact(3) {
        let [a, b, c] = [t[0] as usize, t[1] as usize, t[2] as usize];
        let (e1, e2) = (positions[b] - positions[a], positions[c] - positions[a]);
        let (d1, d2) = (uvs[b] - uvs[a], uvs[c] - uvs[a]);
        let det = d1.x * d2.y - d2.x * d1.y;
        if det == 0.0 {
            continue;
        }
        let u = (e1 * d2.y - e2 * d1.y) / det;
        let v = (e2 * d1.x - e1 * d2.x) / det;
        for i in [a, b, c] {
            along_u[i] += u;
            along_v[i] += v;
        }
    }
    (0..positions.len())
        .map(|i| {
            let n = normals[i];
            let t = (along_u[i] - n * n.dot(along_u[i]))
                .try_normalize()
                .unwrap_or_else(|| n.any_orthonormal_vector());
            let side = if n.cross(t).dot(along_v[i]) < 0.0 {
                -1.0
            } else {
                1.0
            };
            [t.x, t.y, t.z, side]
        })
        .collect()
}

/// Transforms a mesh: positions and bounds as points, normals by the inverse transpose, tangents
/// and morph offsets as directions.
#[must_use]
pub fn transformed(mut mesh: Mesh, transform: Mat4) -> Mesh {
    let normal_matrix = transform.inverse().transpose();
    for (name, stream) in &mut mesh.streams {
        let Stream::Float { components, data } = stream else {
            continue;
        };
        let step = *components as usize;
        for v in data.chunks_exact_mut(step.max(1)) {
            if step < 3 {
                break;
            }
            let p = Vec3::new(v[0], v[1], v[2]);
            let moved = match name.as_str() {
                "position" => transform.transform_point3(p),
                "normal" => normal_matrix.transform_vector3(p).normalize_or_zero(),
                "tangent" => transform.transform_vector3(p).normalize_or_zero(),
                n if n.starts_with("morph_position") => transform.transform_vector3(p),
                n if n.starts_with("morph_normal") => normal_matrix.transform_vector3(p),
                _ => break,
            };
            v[..3].copy_from_slice(&moved.to_array());
        }
    }
    if transform.determinant() < 0.0
        && let Some(indices) = &mut mesh.indices
    {
        // A mirror reverses the winding.
        for t in indices.chunks_exact_mut(3) {
            t.swap(1, 2);
        }
    }
    mesh.bounds = bounds(positions(&mesh));
    mesh
}

/// The mesh with a vertex for every index.
#[must_use]
pub(crate) fn unindexed(mut mesh: Mesh) -> Mesh {
    let Some(indices) = mesh.indices.take() else {
        return mesh;
    };
    fn spread<T: Copy>(data: &[T], components: u32, indices: &[u32]) -> Vec<T> {
        let size = components as usize;
        let vertex = |i: &u32| data.get(*i as usize * size..(*i as usize + 1) * size);
        indices
            .iter()
            .filter_map(vertex)
            .flatten()
            .copied()
            .collect()
    }
    for stream in mesh.streams.values_mut() {
        match stream {
            Stream::Float { components, data } => *data = spread(data, *components, &indices),
            Stream::Uint { components, data } => *data = spread(data, *components, &indices),
        }
    }
    mesh.vertex_count = indices.len() as u32;
    mesh
}

/// The positions of a mesh; empty without that stream.
pub fn positions(mesh: &Mesh) -> impl Iterator<Item = Vec3> {
    let data: &[f32] = match mesh.streams.get("position") {
        Some(Stream::Float {
            components: 3,
            data,
        }) => data,
        _ => &[],
    };
    data.chunks_exact(3).map(Vec3::from_slice)
}

/// Merges meshes in order. Keeps only streams that all of them have; generates missing indices.
pub fn merged(name: &str, parts: Vec<Mesh>) -> Mesh {
    let mut parts = parts.into_iter();
    let Some(mut all) = parts.next() else {
        return MeshBuilder::default().build(name);
    };
    all.name = name.to_owned();
    let in_order = |m: &Mesh| (0..m.vertex_count).collect::<Vec<u32>>();
    let mut indices = all.indices.take().unwrap_or_else(|| in_order(&all));
    for part in parts {
        let own = part.indices.clone().unwrap_or_else(|| in_order(&part));
        indices.extend(own.iter().map(|i| i + all.vertex_count));
        all.streams.retain(|n, _| part.streams.contains_key(n));
        for (name, stream) in &mut all.streams {
            match (stream, &part.streams[name]) {
                (Stream::Float { data, .. }, Stream::Float { data: more, .. }) => {
                    data.extend(more);
                }
                (Stream::Uint { data, .. }, Stream::Uint { data: more, .. }) => data.extend(more),
                _ => {}
            }
        }
        all.vertex_count += part.vertex_count;
    }
    all.indices = Some(indices);
    all.bounds = bounds(positions(&all));
    all
}
