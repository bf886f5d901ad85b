//! glTF 2.0: the primitives of a file, or of a part of it, merged with skin and morph targets.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{Mat4, Vec3};
use gltf::buffer::Source;
use serde::Deserialize;

use super::accessors::{self, Cost};
use super::{MeshBuilder, bounds, merged, positions, transformed};
use crate::panics;
use crate::scene::{Mesh, SceneError, Stream};

/// A part of a glTF file: the triangles that all given keys select, with the transforms of their
/// nodes. Without a key, the whole default scene.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gltf {
    /// `.gltf` or `.glb`, relative to the scene's folder.
    pub file: String,
    /// Name of one mesh, at each node that has it. A mesh that no node has is read at the origin.
    pub mesh: Option<String>,
    /// Name of one node: what it and the nodes below it draw.
    pub node: Option<String>,
    /// Name of one of the file's materials: the primitives that have it.
    pub material: Option<String>,
    /// Number of one primitive in its mesh, from 0.
    pub primitive: Option<usize>,
}

/// A mesh of the file, and the node that places it, if one does.
type Placed<'g> = (gltf::Mesh<'g>, Option<gltf::Node<'g>>);

/// A mesh with its pose.
#[derive(Clone, Debug)]
pub struct Rigged {
    /// The mesh.
    pub mesh: Mesh,
    /// Joint matrices of the file's pose with the inverse bind pose applied; empty without a skin.
    pub joints: Arc<[Mat4]>,
    /// Default weights of the morph targets.
    pub morph_weights: Vec<f32>,
}

impl Gltf {
    /// Reads the mesh. `read` returns the bytes of a file by its name relative to the scene's
    /// folder.
    ///
    /// # Errors
    /// The file is no glTF 2.0, lacks the mesh, has primitives other than triangles, has accessors
    /// outside of their buffers, or has two skins in the selected part.
    pub fn load(
        &self,
        name: &str,
        read: &dyn Fn(&str) -> Result<Vec<u8>, SceneError>,
    ) -> Result<Rigged, SceneError> {
        self.load_within(name, read, &|_, _| Ok(()))
    }

    /// [`Gltf::load`] with a size check: `take` gets the number of vertices and bytes before they
    /// are allocated.
    pub(in crate::scene) fn load_within(
        &self,
        name: &str,
        read: &dyn Fn(&str) -> Result<Vec<u8>, SceneError>,
        take: &dyn Fn(u64, u64) -> Result<(), SceneError>,
    ) -> Result<Rigged, SceneError> {
        // The glTF crate may panic on errors that the checks below miss.
        panics::run(|| self.loaded(name, read, take)).unwrap_or_else(|panicked| {
            Err(SceneError::new(format!(
                "`{}`: the crate that reads glTF panicked: {panicked}",
                self.file
            )))
        })
    }

    fn wrong(&self, what: impl std::fmt::Display) -> SceneError {
        SceneError::new(format!("`{}`: {what}", self.file))
    }

    fn is_wanted(&self, mesh: &gltf::Mesh<'_>) -> bool {
        let wanted = self.mesh.as_deref();
        wanted.is_none_or(|m| mesh.name() == Some(m))
    }

    /// The selected primitives of a mesh.
    fn primitives<'g>(
        &'g self,
        mesh: &'g gltf::Mesh<'g>,
    ) -> impl Iterator<Item = gltf::Primitive<'g>> {
        let material = self.material.as_deref();
        mesh.primitives().filter(move |p| {
            self.primitive.is_none_or(|n| n == p.index())
                && material.is_none_or(|m| p.material().name() == Some(m))
        })
    }

    /// The selected meshes with their nodes.
    fn placed<'g>(&self, gltf: &'g gltf::Gltf, nodes: &[gltf::Node<'g>]) -> Vec<Placed<'g>> {
        let of_node = |n: &gltf::Node<'g>| Some((n.mesh()?, Some(n.clone())));
        let mut placed: Vec<Placed<'g>> = nodes.iter().filter_map(of_node).collect();
        placed.retain(|(mesh, _)| self.is_wanted(mesh));
        if placed.is_empty() && self.mesh.is_some() && self.node.is_none() {
            placed.extend(
                gltf.meshes()
                    .filter(|m| self.is_wanted(m))
                    .map(|m| (m, None)),
            );
        }
        placed
    }

    /// Why nothing is selected.
    fn nothing(&self, gltf: &gltf::Gltf, placed: &[Placed<'_>]) -> SceneError {
        let named = |what: &str, name: &str, all: Vec<&str>| {
            let known = all.contains(&name);
            (!known).then(|| {
                self.wrong(format!("there is no {what} `{name}`"))
                    .suggest(name, all)
            })
        };
        let of =
            |key: &Option<String>, what: &str, all: Vec<&str>| named(what, key.as_deref()?, all);
        let missing = of(
            &self.mesh,
            "mesh",
            gltf.meshes().filter_map(|m| m.name()).collect(),
        )
        .or_else(|| {
            of(
                &self.node,
                "node",
                gltf.nodes().filter_map(|n| n.name()).collect(),
            )
        })
        .or_else(|| {
            let all = gltf.materials().filter_map(|m| m.name()).collect();
            of(&self.material, "material", all)
        });
        if let Some(missing) = missing {
            return missing;
        }
        match (placed, self.node.as_deref()) {
            ([], None) => self.wrong("no node of its default scene has a mesh"),
            ([], Some(node)) => self.wrong(format!(
                "neither the node `{node}` nor one below it has {}",
                self.mesh
                    .as_ref()
                    .map_or("a mesh".to_owned(), |m| format!("the mesh `{m}`"))
            )),
            (placed, _) => {
                let all = placed.iter().flat_map(|(mesh, _)| mesh.primitives());
                let all = all.map(|p| {
                    let material = p.material();
                    format!("{} of `{}`", p.index(), material.name().unwrap_or("?"))
                });
                let all: Vec<String> = all.collect();
                self.wrong("no primitive is the one that `primitive` and `material` select")
                    .help(format!("there are: {}", all.join(", ")))
            }
        }
    }

    /// The content of all buffers.
    fn buffers<'g>(
        &self,
        gltf: &'g gltf::Gltf,
        read: &dyn Fn(&str) -> Result<Vec<u8>, SceneError>,
        take: &dyn Fn(u64, u64) -> Result<(), SceneError>,
    ) -> Result<Vec<Cow<'g, [u8]>>, SceneError> {
        let folder = match self.file.rsplit_once('/') {
            Some((folder, _)) => format!("{folder}/"),
            None => String::new(),
        };
        let mut buffers: Vec<Cow<'g, [u8]>> = Vec::new();
        let mut held = 0;
        for buffer in gltf.buffers() {
            let data = match buffer.source() {
                Source::Bin => gltf
                    .blob
                    .as_deref()
                    .map(Cow::Borrowed)
                    .ok_or_else(|| self.wrong("no binary chunk"))?,
                Source::Uri(uri) => match uri.split_once(";base64,") {
                    Some((head, data)) if head.starts_with("data:") => Cow::Owned(
                        base64(data).ok_or_else(|| self.wrong("a data URI that is no base64"))?,
                    ),
                    _ => Cow::Owned(read(&format!("{folder}{uri}"))?),
                },
            };
            // Several buffers may share a file.
            held += data.len() as u64;
            take(0, held)?;
            if data.len() < buffer.length() {
                return Err(self.wrong(format!(
                    "buffer {} holds {} of {} bytes",
                    buffer.index(),
                    data.len(),
                    buffer.length()
                )));
            }
            buffers.push(data);
        }
        Ok(buffers)
    }

    /// The nodes of the default scene in depth-first order, those at or below [`Gltf::node`] if it
    /// is given; and the world transforms of all, by index.
    fn nodes<'g>(
        &self,
        gltf: &'g gltf::Gltf,
    ) -> Result<(Vec<gltf::Node<'g>>, BTreeMap<usize, Mat4>), SceneError> {
        let mut nodes = Vec::new();
        let roots: Vec<_> = match gltf.default_scene().or_else(|| gltf.scenes().next()) {
            Some(scene) => scene.nodes().collect(),
            None => gltf.nodes().collect(),
        };
        let roots = roots.into_iter().rev();
        let mut stack: Vec<(gltf::Node<'_>, Mat4, bool)> = roots
            .map(|n| (n, Mat4::IDENTITY, self.node.is_none()))
            .collect();
        let mut world: BTreeMap<usize, Mat4> = BTreeMap::new();
        while let Some((node, parent, is_below)) = stack.pop() {
            let is_below = is_below || node.name() == self.node.as_deref();
            let here = parent * Mat4::from_cols_array_2d(&node.transform().matrix());
            if world.insert(node.index(), here).is_some() {
                return Err(self.wrong("a node has two parents"));
            }
            let children: Vec<_> = node.children().map(|c| (c, here, is_below)).collect();
            stack.extend(children.into_iter().rev());
            if is_below {
                nodes.push(node);
            }
        }
        Ok((nodes, world))
    }

    /// Checks sizes before reading: many nodes may share a mesh. `lengths` are those of the buffers.
    fn check_sizes(
        &self,
        placed: &[Placed<'_>],
        lengths: &[usize],
        take: &dyn Fn(u64, u64) -> Result<(), SceneError>,
    ) -> Result<(), SceneError> {
        let held: u64 = lengths.iter().map(|l| *l as u64).sum();
        let mut cost = Cost::default();
        let mut costs: BTreeMap<usize, Cost> = BTreeMap::new();
        for (mesh, node) in placed {
            if let Some(skin) = node.as_ref().and_then(gltf::Node::skin) {
                accessors::of_skin(&skin, lengths).map_err(|e| self.wrong(e))?;
            }
            let of_mesh = match costs.get(&mesh.index()) {
                Some(known) => *known,
                None => {
                    let mut all = Cost::default();
                    for primitive in self.primitives(mesh) {
                        let of_it = accessors::of_primitive(&primitive, lengths);
                        all = all.and(of_it.map_err(|e| self.wrong(e))?);
                    }
                    costs.insert(mesh.index(), all);
                    all
                }
            };
            cost = cost.and(of_mesh);
            take(cost.vertices, held.saturating_add(cost.bytes))?;
        }
        Ok(())
    }

    fn loaded(
        &self,
        name: &str,
        read: &dyn Fn(&str) -> Result<Vec<u8>, SceneError>,
        take: &dyn Fn(u64, u64) -> Result<(), SceneError>,
    ) -> Result<Rigged, SceneError> {
        let wrong = |what: String| self.wrong(what);
        let bytes = read(&self.file)?;
        let gltf =
            gltf::Gltf::from_slice(&bytes).map_err(|e| wrong(format!("no glTF 2.0: {e}")))?;
        let buffers = self.buffers(&gltf, read, take)?;
        let (nodes, world) = self.nodes(&gltf)?;
        let lengths: Vec<usize> = buffers.iter().map(|b| b.len()).collect();
        let placed = self.placed(&gltf, &nodes);
        self.check_sizes(&placed, &lengths, take)?;
        let (mut parts, mut joints, mut weights, mut skins) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (mesh, node) in &placed {
            let skin = node.as_ref().and_then(gltf::Node::skin);
            if let Some(skin) = &skin
                && !skins.contains(&skin.index())
            {
                skins.push(skin.index());
                let reader = skin.reader(|b| buffers.get(b.index()).map(AsRef::as_ref));
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
            for primitive in self.primitives(mesh) {
                if primitive.mode() != gltf::mesh::Mode::Triangles {
                    return Err(wrong(format!(
                        "mesh `{}` draws {:?}, and only triangles are read",
                        mesh.name().unwrap_or("?"),
                        primitive.mode()
                    )));
                }
                let part = read_primitive(&primitive, &buffers)
                    .ok_or_else(|| wrong("a primitive without positions".into()))?;
                // The node of a skinned mesh has no effect on its place (glTF 2.0, section
                // 3.7.3.3).
                parts.push(match node {
                    Some(node) if skin.is_none() => transformed(part, world[&node.index()]),
                    _ => part,
                });
            }
        }
        if skins.len() > 1 {
            return Err(wrong(format!("{} skins in one draw", skins.len()))
                .help("name one mesh with `mesh`, or one node with `node`"));
        }
        if parts.is_empty() {
            return Err(self.nothing(&gltf, &placed));
        }
        Ok(Rigged {
            mesh: merged(name, parts),
            joints: joints.into(),
            morph_weights: weights,
        })
    }
}

fn read_primitive(primitive: &gltf::Primitive<'_>, buffers: &[Cow<'_, [u8]>]) -> Option<Mesh> {
    let reader = primitive.reader(|b| buffers.get(b.index()).map(AsRef::as_ref));
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
    // The builder generates tangents; the file's own replace them below.
    let mut b = MeshBuilder::default();
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
