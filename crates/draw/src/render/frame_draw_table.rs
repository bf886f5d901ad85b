//! The draw table of a frame. Passes that use ids, or draw without vertex buffers, bind it.

use std::collections::BTreeMap;

use preshade_plan::draw_table::{self, DRAWS, Entry, IDS, Words};
use preshade_plan::geometry::{Formats, Geometry, Stream, declared_format};
use preshade_plan::plan::{
    Attachment, BindingKind, BindingSource, BindingUse, ComputePass, FrameBuffer, FrameWords,
    GeometryPart, HostValue, Plan,
};

use super::gpu::Gpu;
use super::inputs::{DrawInputs, SceneInputs};
use super::subdivided::{buffer, streams};

/// The frame's draws with their ids.
pub(super) struct DrawTable {
    first_ids: Vec<u32>,
    /// Bits of the triangle in a one-word id; `None` if ids do not fit into one word.
    triangle_bits: Option<u32>,
    /// Instances of all draws, and the largest number of triangles of a draw.
    counts: (u64, u32),
    /// Size of the target, and the viewport of draws without their own.
    size: [u32; 2],
    viewport: [f32; 4],
    /// First ids of all draws, for shaders.
    table: wgpu::Buffer,
    /// The frame's buffers by name.
    frame: BTreeMap<String, (FrameWords, wgpu::Buffer)>,
    /// Computed vertices of draws without subdivision, by draw and name.
    vertices: BTreeMap<(usize, String), wgpu::Buffer>,
    /// Values of each draw, by draw and name.
    values: BTreeMap<(usize, String), wgpu::Buffer>,
    amend: Amend,
}

/// Changes an entry before it is uploaded.
pub(super) type Amend = fn(&mut Entry);

/// The buffers that one pass binds for a draw.
pub(super) struct Drawn {
    entry: wgpu::Buffer,
    table: wgpu::Buffer,
    frame: BTreeMap<String, wgpu::Buffer>,
    vertices: BTreeMap<String, wgpu::Buffer>,
    values: BTreeMap<String, wgpu::Buffer>,
    number: u64,
    /// Uniform buffers that the author's program lacks, each with its source.
    host: Vec<(BindingSource, wgpu::Buffer)>,
    pub triangles: u32,
}

/// The arguments of an indirect call: buffer and offset.
#[derive(Clone, Debug)]
pub(super) struct Arguments {
    pub buffer: wgpu::Buffer,
    pub offset: u64,
}

impl DrawTable {
    /// The table of all draws of a scene, with the buffers that `plans` share.
    ///
    /// # Errors
    /// A message: the draws have more instances than ids can distinguish, a buffer exceeds the
    /// adapter's binding size, or two plans disagree about a buffer.
    pub fn new(inputs: &SceneInputs<'_>, plans: &[Plan], amend: Amend) -> Result<Self, String> {
        let scene = inputs.scene();
        let draws = || (0..scene.draws.len()).map(|i| inputs.draw(i));
        let instances = draws().map(|d| d.map_or(0, |d| d.instances));
        let first_ids = draw_table::first_ids(instances).map_err(|n| {
            format!(
                "they have {n} instances, and ids tell {} apart",
                draw_table::MOST_INSTANCES
            )
        })?;
        let [w, h] = scene.size;
        let viewport = scene.viewport.unwrap_or([0, 0, w, h]);
        let counts = draws().flatten().map(|d| (d.instances, d.call.count / 3));
        let triangle_bits = draw_table::triangle_bits(counts.clone());
        let most = counts.map(|(_, triangles)| triangles).max().unwrap_or(0);
        let words = draw_table::table(triangle_bits.unwrap_or_default(), &first_ids);
        let table = buffer(inputs.gpu(), &words, wgpu::BufferUsages::STORAGE);
        let instances = draws().flatten().map(|d| u64::from(d.instances)).sum();
        let sizes = (first_ids.len() as u64, instances, scene.size);
        let mut frame = BTreeMap::new();
        for planned in plans.iter().flat_map(|p| &p.frame_buffers) {
            match frame.get(&planned.name) {
                None => {
                    let made = frame_buffer(inputs.gpu(), planned, sizes)?;
                    frame.insert(planned.name.clone(), (planned.holds, made));
                }
                Some((holds, _)) if *holds == planned.holds => {}
                Some(_) => {
                    return Err(format!(
                        "two of its materials' plans say different things of the buffer `{}`",
                        planned.name
                    ));
                }
            }
        }
        Ok(Self {
            vertices: computed(inputs, plans)?,
            values: values(inputs, plans),
            frame,
            size: scene.size,
            viewport: viewport.map(|v| v as f32),
            first_ids,
            triangle_bits,
            counts: (instances, most),
            table,
            amend,
        })
    }

    /// Fails with a message if the frame's one-word ids do not fit, or its draws exceed what a
    /// depth attachment can distinguish.
    pub fn check(&self, attachments: &[Attachment]) -> Result<(), String> {
        if attachments.iter().any(|a| a.name == DRAWS) {
            check_draws(self.first_ids.len())?;
        }
        let one = Words::One.format();
        let is_one = |a: &Attachment| a.name == IDS && a.format == one;
        match (attachments.iter().any(is_one), self.triangle_bits) {
            (true, None) => {
                let (instances, triangles) = self.counts;
                Err(format!(
                    "{instances} instances, and {triangles} triangles with their sides, do not fit \
                     into ids of one word: take words=two"
                ))
            }
            _ => Ok(()),
        }
    }

    /// The buffers for a draw in a pass with these bindings.
    ///
    /// # Errors
    /// A message: the plan and the draw do not fit together.
    pub fn of(
        &self,
        gpu: &Gpu,
        bindings: &[BindingUse],
        (index, draw, previous): (usize, &DrawInputs, &DrawInputs),
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
        let mut entry = Entry {
            first_id: self.first_ids.get(index).copied().unwrap_or_default(),
            instances: draw.instances,
            first_instance: draw.call.first_instance,
            number: index as u32,
            first: draw.call.first,
            index_bytes,
            base_vertex: draw.call.base_vertex,
            triangle_bits: self.triangle_bits.unwrap_or_default(),
            viewport: match &draw.area {
                Some(area) => area.scaled(self.size).part(),
                None => self.viewport,
            },
            vertices: draw.vertex_count,
            streams,
        };
        (self.amend)(&mut entry);
        let words = entry
            .words()
            .ok_or("a vertex format is not one of WebGPU's")?;
        let mut frame = BTreeMap::new();
        for binding in bindings {
            if let BindingSource::Geometry {
                part: GeometryPart::Frame { buffer },
            } = &binding.source
            {
                let (_, bound) = self.frame_buffer(buffer)?;
                frame.insert(buffer.clone(), bound.clone());
            }
        }
        let mut computed = BTreeMap::new();
        for binding in bindings {
            if let BindingSource::Geometry {
                part: GeometryPart::Vertices { buffer },
            } = &binding.source
                && let Some(found) = self.vertices.get(&(index, buffer.clone()))
            {
                computed.insert(buffer.clone(), found.clone());
            }
        }
        let mut values = BTreeMap::new();
        for binding in bindings {
            if let BindingSource::Geometry {
                part: GeometryPart::Values { buffer },
            } = &binding.source
                && let Some(found) = self.values.get(&(index, buffer.clone()))
            {
                values.insert(buffer.clone(), found.clone());
            }
        }
        Ok(Drawn {
            frame,
            values,
            vertices: computed,
            number: index as u64,
            host: host(gpu, bindings, index, previous),
            entry: buffer(gpu, &words, wgpu::BufferUsages::UNIFORM),
            table: self.table.clone(),
            triangles: draw.call.count / 3,
        })
    }

    /// The arguments of an indirect call for a draw.
    ///
    /// # Errors
    /// The reason as text: the buffer is missing, or has no entries for draws.
    pub fn arguments(&self, buffer: &str, draw: &Drawn) -> Result<Arguments, String> {
        match self.frame_buffer(buffer)? {
            (FrameWords::Draws, found) => Ok(Arguments {
                buffer: found.clone(),
                offset: draw.number * 32,
            }),
            (other, _) => Err(format!(
                "the buffer `{buffer}` holds {other:?}, and no arguments"
            )),
        }
    }

    fn frame_buffer(&self, name: &str) -> Result<&(FrameWords, wgpu::Buffer), String> {
        let found = self.frame.get(name);
        found.ok_or_else(|| format!("the frame has no buffer `{name}`"))
    }

    /// A buffer of the frame. `None` if no plan has one with this name.
    pub fn words(&self, name: &str) -> Option<&wgpu::Buffer> {
        Some(&self.frame.get(name)?.1)
    }

    pub fn clear(&self, encoder: &mut wgpu::CommandEncoder) {
        for (_, buffer) in self.frame.values() {
            encoder.clear_buffer(buffer, 0, None);
        }
    }
}

/// Fails with a message if a depth attachment cannot distinguish this many draws.
fn check_draws(draws: usize) -> Result<(), String> {
    match draws {
        0..=draw_table::MOST_DRAWS => Ok(()),
        _ => Err(format!(
            "there are {draws}, and a depth of 16 bits tells {} apart: take select=id",
            draw_table::MOST_DRAWS
        )),
    }
}

/// The buffers of vertices that `plans` compute for draws without subdivision.
fn computed(
    inputs: &SceneInputs<'_>,
    plans: &[Plan],
) -> Result<BTreeMap<(usize, String), wgpu::Buffer>, String> {
    let (gpu, scene) = (inputs.gpu(), inputs.scene());
    let most = gpu.device.limits().max_storage_buffer_binding_size;
    let mut buffers = BTreeMap::new();
    for (index, draw) in scene.draws.iter().enumerate() {
        let material = scene.materials.get(draw.material).map(|m| &m.name);
        let plan = plans.iter().find(|p| {
            let computes = |c: &ComputePass| c.geometry == Geometry::Vertices;
            Some(&p.material) == material && p.compute.iter().any(computes)
        });
        let (Some(plan), Some(bound)) = (plan, inputs.draw(index)) else {
            continue;
        };
        for planned in &plan.vertex_buffers {
            let vertices = u64::from(bound.vertex_count) * u64::from(bound.instances);
            let bytes = (vertices * u64::from(planned.stride)).max(16);
            if bytes > most {
                return Err(format!(
                    "the vertices of `{}` would take {bytes} bytes, and the adapter binds {most} \
                     at most (maxStorageBufferBindingSize): take vertices=refetched",
                    draw.name
                ));
            }
            let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(&planned.name),
                size: bytes,
                usage: wgpu::BufferUsages::STORAGE,
                mapped_at_creation: false,
            });
            buffers.insert((index, planned.name.clone()), buffer);
        }
    }
    Ok(buffers)
}

/// The buffers of values that `plans` make for each draw.
fn values(inputs: &SceneInputs<'_>, plans: &[Plan]) -> BTreeMap<(usize, String), wgpu::Buffer> {
    let (gpu, scene) = (inputs.gpu(), inputs.scene());
    let mut buffers = BTreeMap::new();
    for (index, draw) in scene.draws.iter().enumerate() {
        let material = scene.materials.get(draw.material).map(|m| &m.name);
        let of_draw = plans.iter().filter(|p| Some(&p.material) == material);
        for planned in of_draw.flat_map(|p| &p.draw_buffers) {
            let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(&planned.name),
                size: u64::from(planned.size),
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::UNIFORM,
                mapped_at_creation: false,
            });
            buffers.insert((index, planned.name.clone()), buffer);
        }
    }
    buffers
}

/// A buffer of the frame for these numbers of draws, instances and pixels.
fn frame_buffer(
    gpu: &Gpu,
    planned: &FrameBuffer,
    (draws, instances, size): (u64, u64, [u32; 2]),
) -> Result<wgpu::Buffer, String> {
    let bytes = planned.holds.count(draws, instances, size).max(1) * 4;
    let most = gpu.device.limits().max_storage_buffer_binding_size;
    if bytes > most {
        return Err(format!(
            "the buffer `{}` would have {bytes} bytes, and the adapter binds {most} at most \
             (maxStorageBufferBindingSize)",
            planned.name
        ));
    }
    let usage =
        wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    let indirect = match planned.holds {
        FrameWords::Draws => wgpu::BufferUsages::INDIRECT,
        FrameWords::Tiles | FrameWords::Instances | FrameWords::Pixels => {
            wgpu::BufferUsages::empty()
        }
    };
    Ok(gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(&planned.name),
        size: bytes,
        usage: usage | indirect,
        mapped_at_creation: false,
    }))
}

/// Position and range of the point light in test pictures.
const POINT_LIGHT: [f32; 4] = [3.0, 2.0, -1.0, 7.0];

/// The uniform buffers for bindings of a draw that the author's program lacks.
fn host(
    gpu: &Gpu,
    bindings: &[BindingUse],
    index: usize,
    previous: &DrawInputs,
) -> Vec<(BindingSource, wgpu::Buffer)> {
    let words = |b: &BindingUse| match &b.source {
        BindingSource::Host {
            value: HostValue::DrawId,
        } => Some(vec![index as u32 + 1]),
        BindingSource::Host {
            value: HostValue::PointLight,
        } => Some(POINT_LIGHT.map(f32::to_bits).to_vec()),
        BindingSource::Previous { group: None, .. } => {
            let bytes = previous.immediates(u32::MAX);
            let words = bytes.as_chunks::<4>().0.iter();
            Some(words.map(|w| u32::from_le_bytes(*w)).collect())
        }
        _ => None,
    };
    let filled = bindings.iter().filter_map(|b| {
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::STORAGE;
        let made = buffer(gpu, &words(b)?, usage);
        Some((b.source.clone(), made))
    });
    filled.collect()
}

/// Fails with a message if an attribute's storage differs from its declared type.
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
                "the attribute at location {location} is stored as {}, and the plan asks for \
                 {asked}",
                stream.format
            ));
        }
    }
    Ok(())
}

impl Drawn {
    /// The resource of a part of the geometry; `None` if the draw itself provides it.
    pub fn part(
        &self,
        binding: &BindingUse,
        part: &GeometryPart,
    ) -> Option<(&wgpu::Buffer, wgpu::BufferBindingType)> {
        let read_only = binding.kind == BindingKind::StorageRead;
        match part {
            GeometryPart::Frame { buffer } => Some((
                self.frame.get(buffer)?,
                wgpu::BufferBindingType::Storage { read_only },
            )),
            GeometryPart::Vertices { buffer } => Some((
                self.vertices.get(buffer)?,
                wgpu::BufferBindingType::Storage { read_only },
            )),
            GeometryPart::Values { buffer } => Some((
                self.values.get(buffer)?,
                match binding.kind {
                    BindingKind::Uniform => wgpu::BufferBindingType::Uniform,
                    _ => wgpu::BufferBindingType::Storage { read_only },
                },
            )),
            GeometryPart::Draw { .. } => Some((&self.entry, wgpu::BufferBindingType::Uniform)),
            GeometryPart::DrawTable => Some((
                &self.table,
                wgpu::BufferBindingType::Storage { read_only: true },
            )),
            _ => None,
        }
    }

    /// The uniform buffer for a source outside of the author's program.
    pub fn host(&self, source: &BindingSource) -> Option<&wgpu::Buffer> {
        let found = self.host.iter().find(|(of, _)| of == source);
        found.map(|(_, buffer)| buffer)
    }

    /// A placeholder for draws without indices.
    pub fn filler(&self) -> &wgpu::Buffer {
        &self.table
    }
}

#[cfg(test)]
mod tests {
    use super::check_draws;

    #[test]
    fn more_draws_than_a_depth_of_16_bits_tells_apart_are_told() {
        assert_eq!(check_draws(65_534), Ok(()));
        let told = check_draws(65_535);
        let says = |told: &String| told.contains("tells 65534 apart: take select=id");
        assert!(told.as_ref().is_err_and(says), "{told:?}");
    }
}
