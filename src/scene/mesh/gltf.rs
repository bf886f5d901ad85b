//! glTF 2.0: all primitives of a file, or of one mesh of it, as one mesh with its skin and morph targets.

use std::collections::BTreeMap;

use glam::{Mat4, Vec3};
use gltf::buffer::Source;
use serde::Deserialize;

use super::{Builder, bounds, merged, positions, transformed};
use crate::scene::{Error, Mesh, Stream};

/// Which part of a glTF file.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gltf {
    /// `.gltf` or `.glb`, relative to the scene's folder.
    pub file: String,
    /// Name of one mesh; all of the default scene's meshes otherwise, at their nodes' places.
    pub mesh: Option<String>,
}

/// A mesh with what its skin and its morph targets start from.
#[derive(Clone, Debug)]
pub struct Rigged {
    /// The mesh.
    pub mesh: Mesh,
    /// Joint matrices of the file's pose, bind pose inverse applied; empty without a skin.
    pub joints: Vec<Mat4>,
    /// Default weights of the morph targets.
    pub morph_weights: Vec<f32>,
}

impl Gltf {
    /// Reads the mesh. `read` returns the bytes of a file by its name relative to the scene's folder.
    ///
    /// # Errors
    /// When the file is no glTF 2.0, has no such mesh, draws other primitives than triangles, or has two skins in what is asked for.
    pub fn load(
        &self,
        name: &str,
        read: &dyn Fn(&str) -> Result<Vec<u8>, Error>,
    ) -> Result<Rigged, Error> {
        let wrong = |what: String| Error::new(format!("`{}`: {what}", self.file));
        let bytes = read(&self.file)?;
        let gltf =
            gltf::Gltf::from_slice(&bytes).map_err(|e| wrong(format!("no glTF 2.0: {e}")))?;
        let folder = match self.file.rsplit_once('/') {
            Some((folder, _)) => format!("{folder}/"),
            None => String::new(),
        };
        let mut buffers: Vec<Vec<u8>> = Vec::new();
        for buffer in gltf.buffers() {
            let data = match buffer.source() {
                Source::Bin => gltf
                    .blob
                    .clone()
                    .ok_or_else(|| wrong("no binary chunk".into()))?,
                Source::Uri(uri) => match uri.split_once(";base64,") {
                    Some((head, data)) if head.starts_with("data:") => {
                        base64(data).ok_or_else(|| wrong("a data URI that is no base64".into()))?
                    }
                    _ => read(&format!("{folder}{uri}"))?,
                },
            };
            if data.len() < buffer.length() {
                return Err(wrong(format!(
                    "buffer {} holds {} of {} bytes",
                    buffer.index(),
                    data.len(),
                    buffer.length()
                )));
            }
            buffers.push(data);
        }
        // Nodes below their parents' transforms.
        let mut nodes = Vec::new();
        let roots: Vec<_> = match gltf.default_scene().or_else(|| gltf.scenes().next()) {
            Some(scene) => scene.nodes().collect(),
            None => gltf.nodes().collect(),
        };
        let mut stack: Vec<(gltf::Node<'_>, Mat4)> = roots
            .into_iter()
            .rev()
            .map(|n| (n, Mat4::IDENTITY))
            .collect();
        let mut world: BTreeMap<usize, Mat4> = BTreeMap::new();
        while let Some((node, parent)) = stack.pop() {
            let here = parent * Mat4::from_cols_array_2d(&node.transform().matrix());
            if world.insert(node.index(), here).is_some() {
                return Err(wrong("a node has two parents".into()));
            }
            stack.extend(
                node.children()
                    .map(|c| (c, here))
                    .collect::<Vec<_>>()
                    .into_iter()
                    .rev(),
            );
            nodes.push(node);
        }
        let (mut parts, mut joints, mut weights, mut skins) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for node in &nodes {
            let Some(mesh) = node.mesh() else { continue };
            if self.mesh.as_deref().is_some_and(|m| mesh.name() != Some(m)) {
                continue;
            }
            if let Some(skin) = node.skin()
                && !skins.contains(&skin.index())
            {
                skins.push(skin.index());
                let reader = skin.reader(|b| buffers.get(b.index()).map(Vec::as_slice));
                let inverse: Vec<Mat4> = reader
                    .read_inverse_bind_matrices()
                    .map(|m| m.map(|m| Mat4::from_cols_array_2d(&m)).collect())
                    .unwrap_or_default();
                joints.extend(skin.joints().enumerate().map(|(i, joint)| {
                    let pose = world.get(&joint.index()).copied().unwrap_or(Mat4::IDENTITY);
                    pose * inverse.get(i).copied().unwrap_or(Mat4::IDENTITY)
                }));
            }
            if weights.is_empty() {
                weights = mesh.weights().unwrap_or(&[]).to_vec();
            }
            for primitive in mesh.primitives() {
                if primitive.mode() != gltf::mesh::Mode::Triangles {
                    return Err(wrong(format!(
                        "mesh `{}` draws {:?}, and only triangles are read",
                        mesh.name().unwrap_or("?"),
                        primitive.mode()
                    )));
                }
                let part = read_primitive(&primitive, &buffers)
                    .ok_or_else(|| wrong("a primitive without positions".into()))?;
                // A skinned mesh's node places nothing (glTF 2.0, section 3.7.3.3).
                parts.push(match node.skin() {
                    Some(_) => part,
                    None => transformed(part, world[&node.index()]),
                });
            }
        }
        if skins.len() > 1 {
            return Err(wrong(format!("{} skins in one draw", skins.len()))
                .help("name one mesh with `mesh`"));
        }
        if parts.is_empty() {
            let names: Vec<&str> = gltf.meshes().filter_map(|m| m.name()).collect();
            let wanted = self.mesh.as_deref().unwrap_or("");
            return Err(wrong(format!("there is no mesh `{wanted}`")).suggest(wanted, names));
        }
        Ok(Rigged {
            mesh: merged(name, parts),
            joints,
            morph_weights: weights,
        })
    }
}

fn read_primitive(primitive: &gltf::Primitive<'_>, buffers: &[Vec<u8>]) -> Option<Mesh> {
    let reader = primitive.reader(|b| buffers.get(b.index()).map(Vec::as_slice));
    let places: Vec<Vec3> = reader.read_positions()?.map(Vec3::from).collect();
    let count = places.len();
    let indices: Vec<u32> = match reader.read_indices() {
        Some(indices) => indices.into_u32().collect(),
        None => (0..count as u32).collect(),
    };
    if indices.iter().any(|i| *i as usize >= count) {
        return None;
    }
    let normals: Vec<Vec3> = match reader.read_normals() {
        Some(n) => n.map(Vec3::from).collect(),
        None => smooth_normals(&places, &indices),
    };
    let uvs: Vec<glam::Vec2> = match reader.read_tex_coords(0) {
        Some(uv) => uv.into_f32().map(glam::Vec2::from).collect(),
        None => vec![glam::Vec2::ZERO; count],
    };
    // The builder makes tangents; the file's own take their place below.
    let mut b = Builder::default();
    for (i, place) in places.iter().enumerate() {
        b.vertex(*place, *normals.get(i)?, *uvs.get(i)?);
    }
    for t in indices.chunks_exact(3) {
        b.triangle(t[0], t[1], t[2]);
    }
    let mut mesh = b.build("");
    let mut put = |name: &str, components: u32, data: Vec<f32>| {
        if data.len() == count * components as usize {
            mesh.streams
                .insert(name.to_owned(), Stream::Float { components, data });
        }
    };
    if let Some(t) = reader.read_tangents() {
        put("tangent", 4, t.flatten().collect());
    }
    if let Some(c) = reader.read_colors(0) {
        put("color", 4, c.into_rgba_f32().flatten().collect());
    }
    if let Some(uv) = reader.read_tex_coords(1) {
        put("uv1", 2, uv.into_f32().flatten().collect());
    }
    if let Some(w) = reader.read_weights(0) {
        put("weights", 4, w.into_f32().flatten().collect());
    }
    for (i, (p, n, t)) in reader.read_morph_targets().enumerate() {
        if let Some(p) = p {
            put(&format!("morph_position_{i}"), 3, p.flatten().collect());
        }
        if let Some(n) = n {
            put(&format!("morph_normal_{i}"), 3, n.flatten().collect());
        }
        if let Some(t) = t {
            put(&format!("morph_tangent_{i}"), 3, t.flatten().collect());
        }
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
    mesh.bounds = bounds(positions(&mesh));
    Some(mesh)
}

/// Normals for a mesh without: each vertex takes the mean of its triangles', weighted by area.
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

/// RFC 4648, with or without padding.
fn base64(text: &str) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(text.len() * 3 / 4);
    let (mut bits, mut held) = (0_u32, 0);
    for c in text.bytes().filter(|c| *c != b'=') {
        let digit = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = bits << 6 | u32::from(digit);
        held += 6;
        if held >= 8 {
            held -= 8;
            out.push((bits >> held) as u8);
        }
    }
    Some(out)
}
