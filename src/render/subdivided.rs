//! The subdivided triangles of a draw, as its plan describes them.

use preshade_passes::geometry::{Constants, Stream, Subdivision};
use preshade_passes::plan::{BindingSource, GeometryPart, GpuPass};
use wgpu::util::{BufferInitDescriptor, DeviceExt};

use super::gpu::Gpu;
use super::inputs::DrawInputs;

/// The buffers of one draw of a subdividing pass, and how many of what to draw.
pub(super) struct Subdivided {
    constants: wgpu::Buffer,
    pattern: wgpu::Buffer,
    indices: wgpu::Buffer,
    index_count: u32,
    instances: u32,
}

impl Subdivided {
    /// Of a draw; `None` for a pass that draws geometry as it is given.
    ///
    /// # Errors
    /// In words: the plan and the draw do not fit together.
    pub fn new(gpu: &Gpu, pass: &GpuPass, draw: &DrawInputs) -> Result<Option<Self>, String> {
        let Some(subdivision) = pass.geometry.subdivision() else {
            return Ok(None);
        };
        let constants = constants(pass, subdivision, draw)?;
        let instances = constants.batches * draw.instances;
        let words = constants
            .words()
            .ok_or("a vertex format is not one of WebGPU's")?;
        let vertices = subdivision.vertices.len() as u32;
        let indices: Vec<u32> = (0..subdivision.batch)
            .flat_map(|i| subdivision.indices.iter().map(move |v| v + i * vertices))
            .collect();
        Ok(Some(Self {
            constants: buffer(gpu, &words, wgpu::BufferUsages::UNIFORM),
            pattern: buffer(gpu, &subdivision.vertices, wgpu::BufferUsages::STORAGE),
            index_count: indices.len() as u32,
            indices: buffer(gpu, &indices, wgpu::BufferUsages::INDEX),
            instances,
        }))
    }

    /// What a part of the geometry is bound to.
    ///
    /// # Errors
    /// In words: the draw has no such part.
    pub fn part<'a>(
        &'a self,
        part: &GeometryPart,
        draw: &'a DrawInputs,
    ) -> Result<(&'a wgpu::Buffer, wgpu::BufferBindingType), String> {
        let storage = wgpu::BufferBindingType::Storage { read_only: true };
        Ok(match part {
            GeometryPart::Constants { .. } => (&self.constants, wgpu::BufferBindingType::Uniform),
            GeometryPart::Pattern => (&self.pattern, storage),
            GeometryPart::Indices => match &draw.indices {
                Some(indices) => (&indices.buffer, storage),
                None => (&self.pattern, storage),
            },
            GeometryPart::Attribute(a) => (&vertex_buffer(draw, a.location)?.0.buffer, storage),
        })
    }

    /// Draws it; pipeline and bind groups are set.
    pub fn draw(&self, render: &mut wgpu::RenderPass<'_>) {
        render.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        render.draw_indexed(0..self.index_count, 0, 0..self.instances);
    }
}

/// The buffer that holds an attribute, and its place there.
fn vertex_buffer(
    draw: &DrawInputs,
    location: u32,
) -> Result<
    (
        &super::inputs::VertexInput,
        &crate::scene::bind::VertexAttribute,
    ),
    String,
> {
    let mut buffers = draw.vertex_buffers.iter();
    buffers
        .find_map(|b| Some((b, b.attributes.iter().find(|a| a.location == location)?)))
        .ok_or_else(|| format!("no vertex buffer holds the attribute at location {location}"))
}

fn constants(
    pass: &GpuPass,
    subdivision: &Subdivision,
    draw: &DrawInputs,
) -> Result<Constants, String> {
    let listed = pass.bindings.iter().find_map(|b| match &b.source {
        BindingSource::Geometry {
            part: GeometryPart::Constants { streams },
        } => Some(streams.as_slice()),
        _ => None,
    });
    let streams = listed.unwrap_or_default().iter().map(|location| {
        let (buffer, attribute) = vertex_buffer(draw, *location)?;
        Ok(Stream {
            offset: attribute.offset as u32,
            stride: buffer.stride as u32,
            format: format(attribute.format),
            by_instance: buffer.step == wgpu::VertexStepMode::Instance,
        })
    });
    let streams = streams.collect::<Result<_, String>>()?;
    let (count, index_bytes) = match &draw.indices {
        Some(indices) => (indices.count, indices.format.byte_size() as u32),
        None => (draw.vertex_count, 0),
    };
    let triangles = count / 3;
    Ok(Constants {
        triangles,
        batches: triangles.div_ceil(subdivision.batch),
        first: 0,
        index_bytes,
        base_vertex: 0,
        first_instance: 0,
        vertices: 0,
        instances: draw.instances,
        streams,
    })
}

/// A vertex format in WebGPU's spelling: wgpu's variants are named after it.
fn format(format: wgpu::VertexFormat) -> String {
    match format {
        wgpu::VertexFormat::Unorm8x4Bgra => "unorm8x4-bgra".to_owned(),
        other => format!("{other:?}").to_lowercase().replace('_', "-"),
    }
}

fn buffer(gpu: &Gpu, words: &[u32], usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
    gpu.device.create_buffer_init(&BufferInitDescriptor {
        label: None,
        contents: &bytes,
        usage,
    })
}
