//! The draw table of a frame: what passes that work with ids, or draw without vertex buffers, bind of a draw.

use preshade_passes::draw_table::{self, Entry};
use preshade_passes::geometry::{Formats, Stream, declared_format};
use preshade_passes::plan::{BindingSource, BindingUse, GeometryPart};

use super::gpu::Gpu;
use super::inputs::{DrawInputs, SceneInputs};
use super::subdivided::{buffer, streams};

/// The frame's draws with their ids.
pub(super) struct DrawTable {
    first_ids: Vec<u32>,
    viewport: [f32; 4],
    /// All first ids, for shaders.
    table: wgpu::Buffer,
}

/// What one pass binds of a draw.
pub(super) struct Drawn {
    entry: wgpu::Buffer,
    table: wgpu::Buffer,
    pub triangles: u32,
}

impl DrawTable {
    /// Of all draws of a scene.
    ///
    /// # Errors
    /// In words: the draws have more instances than ids tell apart.
    pub fn new(inputs: &SceneInputs<'_>) -> Result<Self, String> {
        let scene = inputs.scene();
        let draws = (0..scene.draws.len()).map(|i| inputs.draw(i).map_or(0, |d| d.instances));
        let first_ids = draw_table::first_ids(draws).map_err(|n| {
            format!(
                "its draws have {n} instances, and ids tell {} apart",
                draw_table::MOST_INSTANCES
            )
        })?;
        let [w, h] = scene.size;
        let viewport = scene.viewport.unwrap_or([0, 0, w, h]);
        let table = buffer(inputs.gpu(), &first_ids, wgpu::BufferUsages::STORAGE);
        Ok(Self {
            viewport: viewport.map(|v| v as f32),
            first_ids,
            table,
        })
    }

    /// What a pass with these bindings binds of a draw.
    ///
    /// # Errors
    /// In words: the plan and the draw do not fit together.
    pub fn of(
        &self,
        gpu: &Gpu,
        bindings: &[BindingUse],
        (index, draw): (usize, &DrawInputs),
    ) -> Result<Drawn, String> {
        let listed = bindings.iter().find_map(|b| match &b.source {
            BindingSource::Geometry {
                part: GeometryPart::Draw { streams, formats },
            } => Some((streams.as_slice(), *formats)),
            _ => None,
        });
        let (listed, formats) = listed.unwrap_or_default();
        let streams = streams(listed, draw)?;
        if formats == Formats::Declared {
            check_formats(bindings, listed, &streams)?;
        }
        let (count, index_bytes) = match &draw.indices {
            Some(indices) => (indices.count, indices.format.byte_size()),
            None => (draw.vertex_count, 0),
        };
        let entry = Entry {
            first_id: self.first_ids.get(index).copied().unwrap_or_default(),
            instances: draw.instances,
            first_instance: 0,
            number: index as u32,
            first: 0,
            index_bytes,
            base_vertex: 0,
            triangles: count / 3,
            viewport: self.viewport,
            streams,
        };
        let words = entry
            .words()
            .ok_or("a vertex format is not one of WebGPU's")?;
        Ok(Drawn {
            entry: buffer(gpu, &words, wgpu::BufferUsages::UNIFORM),
            table: self.table.clone(),
            triangles: count / 3,
        })
    }
}

/// Fails, in words, where an attribute is not stored as its type is declared.
fn check_formats(
    bindings: &[BindingUse],
    listed: &[u32],
    streams: &[Stream],
) -> Result<(), String> {
    for binding in bindings {
        let BindingSource::Geometry {
            part: GeometryPart::Attribute(attribute),
        } = &binding.source
        else {
            continue;
        };
        let asked = declared_format(&attribute.ty);
        let stored = listed
            .iter()
            .zip(streams)
            .find(|(location, _)| **location == attribute.location);
        if let Some((location, stream)) = stored
            && stream.format != asked
        {
            return Err(format!(
                "the attribute at location {location} is stored as {}, and the plan asks for {asked}",
                stream.format
            ));
        }
    }
    Ok(())
}

impl Drawn {
    /// What a part of the geometry is bound to; `None` where it is a part of the draw itself.
    pub fn part(&self, part: &GeometryPart) -> Option<(&wgpu::Buffer, wgpu::BufferBindingType)> {
        match part {
            GeometryPart::Draw { .. } => Some((&self.entry, wgpu::BufferBindingType::Uniform)),
            GeometryPart::DrawTable => Some((
                &self.table,
                wgpu::BufferBindingType::Storage { read_only: true },
            )),
            _ => None,
        }
    }

    /// Any buffer, where a draw has no indices.
    pub fn filler(&self) -> &wgpu::Buffer {
        &self.table
    }
}
