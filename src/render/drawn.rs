//! The draw table of a frame: what passes that work with ids, or draw without vertex buffers, bind of a draw.

use preshade_passes::draw_table::{self, Entry};
use preshade_passes::geometry::{Formats, Stream, declared_format};
use preshade_passes::plan::{Attachment, BindingSource, BindingUse, GeometryPart};

use preshade_passes::visibility_buffer::{DRAWS, IDS, Words};

use super::gpu::Gpu;
use super::inputs::{DrawInputs, SceneInputs};
use super::subdivided::{buffer, streams};

/// The frame's draws with their ids.
pub(super) struct DrawTable {
    first_ids: Vec<u32>,
    /// Of ids of one word; `None`: they do not fit.
    triangle_bits: Option<u32>,
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
        let draws = || (0..scene.draws.len()).map(|i| inputs.draw(i));
        let instances = draws().map(|d| d.map_or(0, |d| d.instances));
        let first_ids = draw_table::first_ids(instances).map_err(|n| {
            format!(
                "its draws have {n} instances, and ids tell {} apart",
                draw_table::MOST_INSTANCES
            )
        })?;
        let [w, h] = scene.size;
        let viewport = scene.viewport.unwrap_or([0, 0, w, h]);
        let counts = draws().flatten().map(|d| (d.instances, vertices(d) / 3));
        let triangle_bits = draw_table::triangle_bits(counts);
        let words = draw_table::table(triangle_bits.unwrap_or_default(), &first_ids);
        let table = buffer(inputs.gpu(), &words, wgpu::BufferUsages::STORAGE);
        Ok(Self {
            viewport: viewport.map(|v| v as f32),
            first_ids,
            triangle_bits,
            table,
        })
    }

    /// Fails, in words, where the frame's ids are of one word and do not fit, or its draws are more than a depth tells apart.
    pub fn check(&self, attachments: &[Attachment]) -> Result<(), String> {
        let draws = self.first_ids.len();
        if draws > draw_table::MOST_DRAWS && attachments.iter().any(|a| a.name == DRAWS) {
            return Err(format!(
                "it has {draws} draws, and a depth of 16 bits tells {} apart: take select=id",
                draw_table::MOST_DRAWS
            ));
        }
        let one = Words::One.format();
        let is_one = |a: &Attachment| a.name == IDS && a.format == one;
        match (attachments.iter().any(is_one), self.triangle_bits) {
            (true, None) => Err(
                "its instances and triangles do not fit into ids of one word: take words=two"
                    .to_owned(),
            ),
            _ => Ok(()),
        }
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
        let index_bytes = draw.indices.as_ref().map_or(0, |i| i.format.byte_size());
        let entry = Entry {
            first_id: self.first_ids.get(index).copied().unwrap_or_default(),
            instances: draw.instances,
            first_instance: 0,
            number: index as u32,
            first: 0,
            index_bytes,
            base_vertex: 0,
            triangle_bits: self.triangle_bits.unwrap_or_default(),
            viewport: self.viewport,
            streams,
        };
        let words = entry
            .words()
            .ok_or("a vertex format is not one of WebGPU's")?;
        Ok(Drawn {
            entry: buffer(gpu, &words, wgpu::BufferUsages::UNIFORM),
            table: self.table.clone(),
            triangles: vertices(draw) / 3,
        })
    }
}

/// Vertices that an instance draws, each index one.
fn vertices(draw: &DrawInputs) -> u32 {
    draw.indices.as_ref().map_or(draw.vertex_count, |i| i.count)
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
