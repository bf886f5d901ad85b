//! The subdivided triangles of a draw.

use std::collections::BTreeMap;
use std::sync::Arc;

use preshade_plan::geometry::{self, Constants, Form, Geometry, Stream, Subdivision};
use preshade_plan::plan::{BindingSource, BindingUse, GeometryPart, Plan};
use preshade_plan::state::Topology;
use serde::{Deserialize, Serialize};
use wgpu::util::{BufferInitDescriptor, DeviceExt};

use super::gpu::Gpu;
use super::inputs::{DrawInputs, VertexInput};
use super::limits::rows;
use super::subdivision::{Mesh, subdivide};
use crate::scene::bind::VertexAttribute;

/// The cost of subdivision per frame, over all draws and instances.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SubdivisionCost {
    /// New vertices computed per frame. The pulled form counts one for each vertex of each
    /// triangle's pattern, as an adapter computes if it reuses vertices within an instance.
    pub evaluations: u64,
    /// Whether some of `evaluations` are skipped at run time.
    pub surplus: Surplus,
    /// The share of `evaluations` in a compute pass; the rest is in the vertex stage.
    pub in_compute: u64,
    /// New vertices computed once, at load.
    pub at_load: u64,
    /// `evaluations` if no triangles shared vertices.
    pub unshared: u64,
    /// Bytes of vertices, their origins, and indices.
    pub bytes: u64,
    /// The subdivided draws, over all their instances.
    pub draws: Vec<DrawSubdivision>,
}

/// Whether a draw has vertices that some triangles do not need.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Surplus {
    #[default]
    None,
    /// Adaptive levels: triangles with short edges use only some vertices, depending on the view.
    /// The others run but evaluate nothing.
    Some,
}

/// The cost of subdividing one draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DrawSubdivision {
    /// Index in the scene.
    pub draw: usize,
    /// New vertices computed per frame.
    pub evaluations: u64,
    /// As [`SubdivisionCost::bytes`].
    pub bytes: u64,
}

/// The subdivided meshes of a frame. All passes of a draw share one.
pub(super) struct Meshes {
    /// Size of the targets in pixels.
    size: [u32; 2],
    known: Vec<(usize, String, Subdivision, Arc<SubdividedMesh>)>,
}

pub(super) struct SubdividedMesh {
    pattern: wgpu::Buffer,
    /// The triangles of a strip as a list.
    list: Option<wgpu::Buffer>,
    /// For `shared`: the origin of each new vertex.
    points: wgpu::Buffer,
    /// For `shared`: as [`Mesh::points`].
    made_of: Vec<[u32; 4]>,
    /// For `shared`: the computed vertices, by the buffer's name in the plan.
    vertices: BTreeMap<String, wgpu::Buffer>,
    indices: wgpu::Buffer,
    index_count: u32,
    instances: u32,
    constants: Constants,
    form: Form,
    /// Vertices of the pattern times triangles.
    unshared: u64,
}

/// The resources and geometry of a draw for a subdividing pass.
pub(super) struct Subdivided {
    pub mesh: Arc<SubdividedMesh>,
    constants: wgpu::Buffer,
}

impl Meshes {
    /// An empty set, for targets of this size.
    pub fn new(size: [u32; 2]) -> Self {
        Self {
            size,
            known: Vec::new(),
        }
    }

    /// The mesh of a draw under `geometry`, for a pass with these bindings. `None` if the geometry
    /// is not subdivided.
    ///
    /// # Errors
    /// The reason as text: the plan and the draw do not fit together.
    pub fn of(
        &mut self,
        gpu: &Gpu,
        plan: &Plan,
        geometry: &Geometry,
        bindings: &[BindingUse],
        (index, draw): (usize, &DrawInputs),
    ) -> Result<Option<Subdivided>, String> {
        let Some(subdivision) = geometry.subdivision() else {
            return Ok(None);
        };
        let material = &plan.material;
        let known = self
            .known
            .iter()
            .find(|(i, m, s, _)| *i == index && m == material && s == subdivision);
        let mesh = match known {
            Some((.., mesh)) => Arc::clone(mesh),
            None => {
                let mesh = Arc::new(SubdividedMesh::new(gpu, plan, subdivision, draw, self.size));
                let entry = (
                    index,
                    material.clone(),
                    subdivision.clone(),
                    Arc::clone(&mesh),
                );
                self.known.push(entry);
                mesh
            }
        };
        let listed = bindings.iter().find_map(|b| match &b.source {
            BindingSource::Geometry {
                part: GeometryPart::Constants { streams },
            } => Some(streams.as_slice()),
            _ => None,
        });
        let constants = Constants {
            streams: streams(listed.unwrap_or_default(), draw)?,
            ..mesh.constants.clone()
        };
        let words = constants
            .words()
            .ok_or("a vertex format is not one of WebGPU's")?;
        let constants = buffer(gpu, &words, wgpu::BufferUsages::UNIFORM);
        Ok(Some(Subdivided { mesh, constants }))
    }

    /// The buffers of computed vertices: draw, origins of one instance's vertices, and buffer.
    pub fn computed(&self) -> impl Iterator<Item = (usize, &[[u32; 4]], &wgpu::Buffer)> {
        self.known.iter().flat_map(|(draw, _, _, mesh)| {
            let buffers = mesh.vertices.values();
            buffers.map(move |b| (*draw, mesh.made_of.as_slice(), b))
        })
    }

    /// The total cost. `None` without subdivision.
    pub fn cost(&self) -> Option<SubdivisionCost> {
        if self.known.is_empty() {
            return None;
        }
        let mut all = SubdivisionCost::default();
        for (draw, .., mesh) in &self.known {
            mesh.add_cost(*draw, &mut all);
        }
        Some(all)
    }
}

impl SubdividedMesh {
    fn new(
        gpu: &Gpu,
        plan: &Plan,
        subdivision: &Subdivision,
        draw: &DrawInputs,
        size: [u32; 2],
    ) -> Self {
        let count = draw.call.count;
        let index_bytes = draw.indices.as_ref().map_or(0, |i| i.format.byte_size());
        // A strip is drawn as a list of its triangles.
        let listed = match subdivision.given {
            Topology::TriangleStrip => {
                let indices = (0..count).map(|i| strip_vertex(draw, i));
                Some(geometry::strip_triangles(indices))
            }
            _ => None,
        };
        let (triangles, index_bytes) = match &listed {
            Some(listed) => (listed.len() as u32, 4),
            None => (count / 3, index_bytes),
        };
        let list = listed.as_ref().map(|l| {
            let words = l.as_flattened();
            buffer(gpu, words, wgpu::BufferUsages::STORAGE)
        });
        let constants = Constants {
            triangles,
            batches: triangles.div_ceil(subdivision.batch),
            // The list of a strip starts at the first drawn triangle.
            first: match &listed {
                Some(_) => 0,
                None => draw.call.first,
            },
            index_bytes,
            base_vertex: draw.call.base_vertex,
            first_instance: draw.call.first_instance,
            vertices: 0,
            instances: draw.instances,
            viewport: subdivision.edge_pixels.map(|_| size),
            streams: Vec::new(),
        };
        let pattern_vertices = subdivision.vertices.len() as u32;
        let unshared =
            u64::from(triangles) * u64::from(pattern_vertices) * u64::from(draw.instances);
        let pattern = buffer(gpu, &subdivision.vertices, wgpu::BufferUsages::STORAGE);
        match subdivision.form {
            Form::Pulled => {
                let batch = 0..subdivision.batch;
                let indices: Vec<u32> = batch
                    .flat_map(|i| {
                        let one = subdivision.indices.iter();
                        one.map(move |v| v + i * pattern_vertices)
                    })
                    .collect();
                Self {
                    points: pattern.clone(),
                    pattern,
                    list,
                    made_of: Vec::new(),
                    vertices: BTreeMap::new(),
                    index_count: indices.len() as u32,
                    indices: buffer(gpu, &indices, wgpu::BufferUsages::INDEX),
                    instances: constants.batches * draw.instances,
                    constants,
                    form: Form::Pulled,
                    unshared,
                }
            }
            Form::Shared | Form::Static => {
                let all = (0..triangles).map(|t| match &listed {
                    Some(listed) => listed[t as usize],
                    None => [0, 1, 2].map(|c| vertex(draw, 3 * t + c)),
                });
                let Mesh { points, triangles } =
                    subdivide(subdivision.pattern, subdivision.level, all);
                let vertices = points.len() as u64 * u64::from(draw.instances);
                let stored = |b: &preshade_plan::plan::VertexBuffer| {
                    gpu.device.create_buffer(&wgpu::BufferDescriptor {
                        label: Some(&b.name),
                        size: (vertices * u64::from(b.stride)).max(16),
                        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
                        mapped_at_creation: false,
                    })
                };
                let buffers = plan.vertex_buffers.iter();
                Self {
                    pattern,
                    list,
                    points: buffer(gpu, points.as_flattened(), wgpu::BufferUsages::STORAGE),
                    vertices: buffers.map(|b| (b.name.clone(), stored(b))).collect(),
                    index_count: triangles.as_flattened().len() as u32,
                    indices: buffer(gpu, triangles.as_flattened(), wgpu::BufferUsages::INDEX),
                    instances: draw.instances,
                    constants: Constants {
                        vertices: points.len() as u32,
                        ..constants
                    },
                    made_of: points,
                    form: subdivision.form,
                    unshared,
                }
            }
        }
    }

    fn add_cost(&self, draw: usize, all: &mut SubdivisionCost) {
        let stored: u64 = self.vertices.values().map(wgpu::Buffer::size).sum();
        let instances = u64::from(self.constants.instances);
        let computed = u64::from(self.constants.vertices) * instances;
        let (evaluations, in_compute) = match self.form {
            Form::Pulled => (self.unshared, 0),
            Form::Shared => (computed, computed),
            Form::Static => (0, 0),
        };
        if self.form == Form::Static {
            all.at_load += computed;
        }
        let bytes = stored + self.points.size() + self.indices.size();
        if self.constants.viewport.is_some() {
            all.surplus = Surplus::Some;
        }
        all.evaluations += evaluations;
        all.in_compute += in_compute;
        all.unshared += self.unshared;
        all.bytes += bytes;
        all.draws.push(DrawSubdivision {
            draw,
            evaluations,
            bytes,
        });
    }

    /// Workgroups of a compute pass over all new vertices.
    pub fn workgroups(&self, workgroup: u32) -> [u32; 2] {
        rows(
            self.constants.vertices * self.constants.instances,
            workgroup,
        )
    }

    /// Draws the geometry. The caller has set pipeline and bind groups.
    pub fn draw(&self, render: &mut wgpu::RenderPass<'_>) {
        render.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        render.draw_indexed(0..self.index_count, 0, 0..self.instances);
    }
}

impl Subdivided {
    /// The resource of a part of the geometry.
    ///
    /// # Errors
    /// A message: the draw has no such part.
    pub fn part<'a>(
        &'a self,
        binding: &BindingUse,
        part: &GeometryPart,
        draw: &'a DrawInputs,
    ) -> Result<(&'a wgpu::Buffer, wgpu::BufferBindingType), String> {
        let mesh = &self.mesh;
        let buffer = match part {
            GeometryPart::Constants { .. } => {
                return Ok((&self.constants, wgpu::BufferBindingType::Uniform));
            }
            GeometryPart::Pattern => &mesh.pattern,
            GeometryPart::Points => &mesh.points,
            GeometryPart::Vertices { buffer } => mesh
                .vertices
                .get(buffer)
                .ok_or_else(|| format!("the plan has no buffer `{buffer}`"))?,
            GeometryPart::Indices => match (&mesh.list, &draw.indices) {
                (Some(list), _) => list,
                (None, Some(indices)) => &indices.buffer,
                (None, None) => &mesh.pattern,
            },
            GeometryPart::Attribute(a) => &attribute(draw, a.location)?.0.buffer,
            GeometryPart::Values { .. } => {
                return Err(
                    "a pass that subdivides its geometry has no values of the draw".to_owned(),
                );
            }
            GeometryPart::Draw { .. } | GeometryPart::DrawTable | GeometryPart::Frame { .. } => {
                return Err("a pass that subdivides its geometry has no draw table".to_owned());
            }
        };
        let read_only = binding.kind == preshade_plan::plan::BindingKind::StorageRead;
        Ok((buffer, wgpu::BufferBindingType::Storage { read_only }))
    }
}

/// An index of the author's strip. `None` for a restart.
fn strip_vertex(draw: &DrawInputs, at: u32) -> Option<u32> {
    let index = vertex(draw, at);
    let restart = match draw.indices.as_ref().map(|i| i.format) {
        Some(wgpu::IndexFormat::Uint16) => Some(u32::from(u16::MAX)),
        Some(wgpu::IndexFormat::Uint32) => Some(u32::MAX),
        None => None,
    };
    (Some(index) != restart).then_some(index)
}

/// An index of the author's draw, without `base_vertex`.
fn vertex(draw: &DrawInputs, at: u32) -> u32 {
    let at = draw.call.first + at;
    let Some(indices) = &draw.indices else {
        return at;
    };
    let at = at as usize;
    let word = match indices.format {
        wgpu::IndexFormat::Uint16 => {
            let bytes = indices.bytes.as_chunks::<2>().0.get(at);
            bytes.map(|b| u32::from(u16::from_le_bytes(*b)))
        }
        wgpu::IndexFormat::Uint32 => {
            let bytes = indices.bytes.as_chunks::<4>().0.get(at);
            bytes.map(|b| u32::from_le_bytes(*b))
        }
    };
    word.unwrap_or_default()
}

/// The buffer of an attribute, and the offset in it.
pub(super) fn attribute(
    draw: &DrawInputs,
    location: u32,
) -> Result<(&VertexInput, &VertexAttribute), String> {
    let mut buffers = draw.vertex_buffers.iter();
    buffers
        .find_map(|b| Some((b, b.attributes.iter().find(|a| a.location == location)?)))
        .ok_or_else(|| format!("no vertex buffer holds the attribute at location {location}"))
}

/// The layout of the attributes at these locations.
///
/// # Errors
/// A message: a location has no attribute.
pub(super) fn streams(locations: &[u32], draw: &DrawInputs) -> Result<Vec<Stream>, String> {
    locations
        .iter()
        .map(|location| {
            let (buffer, attribute) = attribute(draw, *location)?;
            Ok(Stream {
                offset: attribute.offset as u32,
                stride: buffer.stride as u32,
                format: format(attribute.format),
                by_instance: buffer.step == wgpu::VertexStepMode::Instance,
            })
        })
        .collect()
}

/// A vertex format in WebGPU's spelling, which is also wgpu's variant name.
fn format(format: wgpu::VertexFormat) -> String {
    match format {
        wgpu::VertexFormat::Unorm8x4Bgra => "unorm8x4-bgra".to_owned(),
        other => format!("{other:?}").to_lowercase().replace('_', "-"),
    }
}

pub(super) fn buffer(gpu: &Gpu, words: &[u32], usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
    // Empty bindings are not allowed, so a mesh without triangles gets a few bytes.
    let empty = [0_u8; 16];
    gpu.device.create_buffer_init(&BufferInitDescriptor {
        label: None,
        contents: if bytes.is_empty() { &empty } else { &bytes },
        usage,
    })
}
