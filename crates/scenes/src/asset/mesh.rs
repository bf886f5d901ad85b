//! Meshes of glTF 2.0: merges the primitives of a file, or of a part of it, with skin and morph
//! targets.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Mat4;
use serde::Deserialize;

use super::accessors::{self, Cost};
use super::file::{Asset, Below, Read, Take};
use super::primitive::{self, Missing};
use crate::mesh::{merged, transformed};
use preshade_draw::scene::{Mesh, SceneError};
use shader_text::panics;

/// A part of a glTF file: the triangles that match all given keys, with the transforms of their
/// nodes. Without keys, the whole default scene.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gltf {
    /// `.gltf` or `.glb`, relative to the scene's folder.
    pub file: String,
    /// Name of a mesh. It appears once for each node that uses it, or at the origin if none does.
    pub mesh: Option<String>,
    /// Name of a node: selects its meshes and those of its descendants.
    pub node: Option<String>,
    /// Name of a material: selects its primitives.
    pub material: Option<String>,
    /// Index of a primitive in its mesh, from 0.
    pub primitive: Option<usize>,
}

/// A mesh of the file, and the node that places it, if any.
pub type Placed<'g> = (gltf::Mesh<'g>, Option<gltf::Node<'g>>);

/// A mesh with its pose.
#[derive(Clone, Debug)]
pub struct Rigged {
    pub mesh: Mesh,
    /// Joint matrices of the file's pose, with the inverse bind pose applied. Empty without a skin.
    pub joints: Arc<[Mat4]>,
    /// Default weights of the morph targets.
    pub morph_weights: Vec<f32>,
}

impl Gltf {
    /// Reads the mesh. `read` returns the bytes of a file by its name relative to the scene's
    /// folder.
    ///
    /// # Errors
    /// The file is no glTF 2.0 or lacks the mesh. A primitive has no triangles, or an accessor
    /// leaves its buffer. The selected part has two skins.
    pub fn load(
        &self,
        name: &str,
        read: &dyn Fn(&str) -> Result<Vec<u8>, SceneError>,
    ) -> Result<Rigged, SceneError> {
        self.load_within(name, read, &|_, _| Ok(()))
    }

    /// [`Gltf::load`] with a size check. `take` gets the numbers of vertices and bytes before they
    /// are allocated.
    pub(crate) fn load_within(
        &self,
        name: &str,
        read: &dyn Fn(&str) -> Result<Vec<u8>, SceneError>,
        take: &dyn Fn(u64, u64) -> Result<(), SceneError>,
    ) -> Result<Rigged, SceneError> {
        // The glTF crate may panic on errors that the checks miss.
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
    pub(crate) fn primitives<'g>(
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
    pub(crate) fn placed<'g>(
        &self,
        gltf: &'g gltf::Document,
        nodes: &[&Below<'g>],
    ) -> Vec<Placed<'g>> {
        let of_node = |n: &&Below<'g>| Some((n.node.mesh()?, Some(n.node.clone())));
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

    /// The error for a selection without a match.
    pub(crate) fn nothing(&self, gltf: &gltf::Document, placed: &[Placed<'_>]) -> SceneError {
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

    /// Checks sizes before reading, because many nodes may share a mesh. `lengths` are those of the
    /// buffers.
    pub(crate) fn check_sizes(
        &self,
        placed: &[Placed<'_>],
        asset: &Asset,
        take: Take<'_>,
    ) -> Result<(), SceneError> {
        let (lengths, is_quantized) = (&asset.lengths()[..], asset.is_quantized());
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
                        let of_it = accessors::of_primitive(&primitive, lengths, is_quantized);
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

    fn loaded(&self, name: &str, read: Read<'_>, take: Take<'_>) -> Result<Rigged, SceneError> {
        let asset = Asset::open(&self.file, read, take)?;
        let all = asset.nodes()?;
        let nodes = all.below(self.node.as_deref());
        let placed = self.placed(&asset.document, &nodes);
        self.check_sizes(&placed, &asset, take)?;
        let (mut parts, mut joints, mut weights, mut skins) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (mesh, node) in &placed {
            let skin = node.as_ref().and_then(gltf::Node::skin);
            if let Some(skin) = &skin
                && !skins.contains(&skin.index())
            {
                skins.push(skin.index());
                joints.extend(asset.joints(skin, &all.world));
            }
            if weights.is_empty() {
                weights = mesh.weights().unwrap_or(&[]).to_vec();
            }
            for primitive in self.primitives(mesh) {
                if primitive.mode() != gltf::mesh::Mode::Triangles {
                    return Err(self.wrong(format!(
                        "mesh `{}` draws {:?}, and only triangles are read",
                        mesh.name().unwrap_or("?"),
                        primitive.mode()
                    )));
                }
                let part = primitive::read(&asset, &primitive, Missing::Smooth)
                    .map_err(|e| self.wrong(e))?;
                // The node of a skinned mesh does not affect its position (glTF 2.0, section
                // 3.7.3.3).
                parts.push(match node {
                    Some(node) if skin.is_none() => transformed(part, all.world[&node.index()]),
                    _ => part,
                });
            }
        }
        if skins.len() > 1 {
            return Err(self
                .wrong(format!("{} skins in one draw", skins.len()))
                .help("name one mesh with `mesh`, or one node with `node`"));
        }
        if parts.is_empty() {
            return Err(self.nothing(&asset.document, &placed));
        }
        Ok(Rigged {
            mesh: merged(name, parts),
            joints: joints.into(),
            morph_weights: weights,
        })
    }
}
