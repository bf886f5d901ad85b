//! Draws of WebGL in a scene: resources by name become bindings of the program, and arrays of any
//! layout become two interleaved vertex buffers.

use std::collections::BTreeMap;

use naga::ScalarKind;
use preshade_passes::plan::{BindingKind, BindingUse};
use preshade_passes::reflect;

use super::file::{Named, RenderPipeline, SampledTexture};
use super::folder::get;
use super::pass::PassDraw;
use super::scene::{Bound, Left, Maker};
use super::texels;
use crate::scene::Material;
use crate::scene::bind::{
    self, BufferBinding, Data, Rate, SamplerBinding, VertexAttribute, VertexBuffer,
};

/// An attribute of WebGL: where its numbers are, and what the program reads.
struct Source<'d> {
    location: u32,
    format: wgpu::VertexFormat,
    /// The format in the new buffer.
    target: wgpu::VertexFormat,
    bytes: &'d [u8],
    stride: usize,
    offset: usize,
}

impl<'c> Maker<'c> {
    /// What the program reads of the resources by name.
    pub(super) fn named_resources(&mut self, named: usize, material: usize) -> Result<Bound, Left> {
        let named = get(&self.capture.file.named, named, "named resources", "a draw")?;
        let mut bound: Bound = Default::default();
        let plan = self.materials[material].plan();
        let uses = plan.main().map(|p| p.bindings.clone()).unwrap_or_default();
        for used in &uses {
            let declared = self.materials[material].program.declared().clone();
            let is = |b: naga::ResourceBinding| (b.group, b.binding) == (used.group, used.binding);
            match used.kind {
                BindingKind::Uniform if declared.loose.is_some_and(is) => {
                    let data = loose(&self.materials[material], used, named)?;
                    bound.0.push(buffer(used, data));
                }
                BindingKind::Uniform => {
                    let block = declared.blocks.iter().find(|b| is(b.binding));
                    let name = block.map_or(used.name.as_str(), |b| &b.name);
                    let range = named.blocks.get(name).ok_or_else(|| missing(name))?;
                    let data = self.part((range.buffer, range.offset, range.size))?;
                    bound.0.push(buffer(used, texels::padded(data)));
                }
                BindingKind::Texture | BindingKind::DepthTexture => {
                    let pair = declared.samplers.iter().find(|s| is(s.texture));
                    let path = pair.map_or(used.name.as_str(), |p| &p.path);
                    let found = sampled(named, path).ok_or_else(|| missing(path))?;
                    let made = self.texture(&found.texture, (used.group, used.binding), used)?;
                    bound.1.push(made);
                }
                BindingKind::Sampler | BindingKind::ComparisonSampler => {
                    let pair = declared.samplers.iter().find(|s| is(s.sampler));
                    let path = pair.map_or(used.name.as_str(), |p| &p.path);
                    let found = sampled(named, path).ok_or_else(|| missing(path))?;
                    let all = &self.capture.file.samplers;
                    let of = get(all, found.sampler, "sampler", "a draw")?;
                    bound.2.push(SamplerBinding {
                        group: used.group,
                        binding: used.binding,
                        sampler: texels::sampler(of),
                    });
                }
                _ => return Err(missing(&used.name)),
            }
        }
        Ok(bound)
    }

    /// The attributes that the program reads, interleaved: one buffer by vertex, and one by instance.
    pub(super) fn interleaved(
        &mut self,
        draw: &PassDraw,
        pipeline: &RenderPipeline,
        material: usize,
    ) -> Result<Vec<VertexBuffer>, Left> {
        let mut contents = BTreeMap::new();
        for (slot, part) in &draw.vertices {
            contents.insert(*slot, self.part(*part)?);
        }
        let named = draw.named.and_then(|n| self.capture.file.named.get(n));
        let mut steps: [Vec<Source<'_>>; 2] = Default::default();
        let constants = constants(named);
        for input in attributes(&self.materials[material]) {
            let (found, step) = match placed(pipeline, &input, draw, &contents) {
                Some(found) => found,
                None => {
                    let of = constants.get(&input.name).unwrap_or(&DEFAULT);
                    (
                        Source {
                            location: input.location,
                            format: wgpu::VertexFormat::Float32x4,
                            target: input.float_or(wgpu::VertexFormat::Float32x4),
                            bytes: of,
                            stride: 0,
                            offset: 0,
                        },
                        wgpu::VertexStepMode::Instance,
                    )
                }
            };
            steps[usize::from(step == wgpu::VertexStepMode::Instance)].push(found);
        }
        let last = draw.call.first_instance.saturating_add(draw.call.instances);
        let [vertices, instances] = steps;
        let mut made = Vec::new();
        made.extend(interleave(&vertices, wgpu::VertexStepMode::Vertex, None));
        let count = Some(last as usize);
        made.extend(interleave(
            &instances,
            wgpu::VertexStepMode::Instance,
            count,
        ));
        Ok(made)
    }
}

/// What an attribute without an array holds: (0, 0, 0, 1).
const DEFAULT: [u8; 16] = [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 128, 63];

fn constants(named: Option<&Named>) -> BTreeMap<String, [u8; 16]> {
    let all = named.into_iter().flat_map(|n| &n.constants);
    all.map(|(name, numbers)| {
        let mut bytes = [0; 16];
        for (to, n) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(numbers) {
            *to = (*n as f32).to_le_bytes();
        }
        (name.clone(), bytes)
    })
    .collect()
}

/// An input of the vertex stage.
struct Input {
    name: String,
    /// The column of a matrix.
    column: u32,
    location: u32,
    kind: ScalarKind,
    components: u32,
}

impl Input {
    /// Floats, if the program reads floats and the array has integers that are not normalised.
    fn float_or(&self, format: wgpu::VertexFormat) -> wgpu::VertexFormat {
        let is_integer = |f: wgpu::VertexFormat| {
            let name = format!("{f:?}");
            name.starts_with("Uint") || name.starts_with("Sint")
        };
        match self.kind {
            ScalarKind::Float if is_integer(format) => match self.components {
                1 => wgpu::VertexFormat::Float32,
                2 => wgpu::VertexFormat::Float32x2,
                3 => wgpu::VertexFormat::Float32x3,
                _ => wgpu::VertexFormat::Float32x4,
            },
            _ => format,
        }
    }
}

/// The inputs of the vertex stage, by the author's names.
fn attributes(material: &Material) -> Vec<Input> {
    let module = material.program.module();
    let entry = material
        .program
        .entry_point(naga::ShaderStage::Vertex, &material.vertex);
    let Some((_, entry)) = entry else {
        return Vec::new();
    };
    let declared = &material.program.declared().attributes;
    let inputs = reflect::inputs(module, &entry.function);
    inputs
        .into_iter()
        .filter_map(|io| {
            let Some(naga::Binding::Location { location, .. }) = io.binding else {
                return None;
            };
            let inner = &module.types[io.ty].inner;
            let own = declared.iter().rfind(|d| d.location <= location);
            let (name, first) = match own {
                Some(d) => (d.declaration.name.clone(), d.location),
                None => (io.name.clone().unwrap_or_default(), location),
            };
            let (components, kind) = match *inner {
                naga::TypeInner::Vector { size, scalar } => (size as u32, scalar.kind),
                naga::TypeInner::Scalar(scalar) => (1, scalar.kind),
                _ => return None,
            };
            Some(Input {
                name,
                column: location - first,
                location,
                kind,
                components,
            })
        })
        .collect()
}

/// Where an input's numbers are. `None`: no array is enabled for it.
fn placed<'d>(
    pipeline: &RenderPipeline,
    input: &Input,
    draw: &PassDraw,
    contents: &'d BTreeMap<u32, Data>,
) -> Option<(Source<'d>, wgpu::VertexStepMode)> {
    for (slot, layout) in pipeline.vertex.buffers.iter().enumerate() {
        let Some(layout) = layout else { continue };
        let is_it = |a: &&super::file::VertexAttribute| a.name.as_deref() == Some(&input.name);
        let own = layout.attributes.iter().filter(is_it);
        let Some(attribute) = own.clone().nth(input.column as usize) else {
            continue;
        };
        draw.vertices.get(&(slot as u32))?;
        let data = contents.get(&(slot as u32))?;
        let size = attribute.format.size();
        let stride = match layout.array_stride {
            0 => size,
            stride => stride,
        };
        return Some((
            Source {
                location: input.location,
                format: attribute.format,
                target: input.float_or(attribute.format),
                bytes: &data.bytes,
                stride: stride as usize,
                offset: attribute.offset as usize,
            },
            layout.step_mode,
        ));
    }
    None
}

/// One buffer of several arrays. `None` without arrays. Without a count it has as many elements as the
/// shortest.
fn interleave(
    sources: &[Source<'_>],
    step: wgpu::VertexStepMode,
    count: Option<usize>,
) -> Option<VertexBuffer> {
    let elements = |s: &Source<'_>| {
        let size = s.format.size() as usize;
        let room = s.bytes.len().saturating_sub(s.offset);
        match (s.stride, room < size) {
            (_, true) => 0,
            (0, false) => usize::MAX,
            (stride, false) => (room - size) / stride + 1,
        }
    };
    let shortest = sources.iter().map(elements).min()?;
    let count = count.map_or(shortest, |c| c.min(shortest)).max(1);
    let mut stride = 0;
    let attributes: Vec<VertexAttribute> = sources
        .iter()
        .map(|s| {
            let offset = stride;
            stride += s.target.size().next_multiple_of(4);
            VertexAttribute {
                location: s.location,
                format: s.target,
                offset,
                is_invented: false,
            }
        })
        .collect();
    let mut bytes = vec![0; stride as usize * count];
    for (source, attribute) in sources.iter().zip(&attributes) {
        let size = source.format.size() as usize;
        for element in 0..count {
            let from = source.offset + element * source.stride;
            let to = element * stride as usize + attribute.offset as usize;
            let Some(own) = source.bytes.get(from..from + size) else {
                break;
            };
            match source.format == source.target {
                true => bytes[to..to + size].copy_from_slice(own),
                false => as_floats(source, own, &mut bytes[to..]),
            }
        }
    }
    Some(VertexBuffer {
        stride,
        step,
        attributes,
        data: Data::new(bytes),
    })
}

/// Integers as floats, as WebGL converts them.
fn as_floats(source: &Source<'_>, own: &[u8], to: &mut [u8]) {
    let name = format!("{:?}", source.format);
    let is_signed = name.starts_with('S');
    let bits = name.trim_start_matches(|c: char| c.is_alphabetic());
    let width: usize = bits
        .split('x')
        .next()
        .and_then(|b| b.parse().ok())
        .unwrap_or(32)
        / 8;
    let numbers = own.chunks(width.max(1)).map(|bytes| {
        let mut wide = [0; 4];
        wide[..bytes.len()].copy_from_slice(bytes);
        let unsigned = u32::from_le_bytes(wide);
        let shift = 32 - 8 * width as u32;
        match is_signed {
            true => ((unsigned << shift) as i32 >> shift) as f32,
            false => unsigned as f32,
        }
    });
    let wanted = source.target.size() as usize / 4;
    let filled = numbers.chain([0.0, 0.0, 0.0]).take(wanted);
    for (to, number) in to.as_chunks_mut::<4>().0.iter_mut().zip(filled) {
        *to = number.to_le_bytes();
    }
}

fn missing(name: &str) -> Left {
    Left::Out(format!("nothing is bound to `{name}`"))
}

fn buffer(used: &BindingUse, data: Data) -> BufferBinding {
    BufferBinding {
        group: used.group,
        binding: used.binding,
        kind: used.kind,
        data,
        rate: Rate::Draw,
        invented: Vec::new(),
    }
}

/// The texture of a path: `map`, or `maps[2]` of the list `maps[0]`.
fn sampled<'n>(named: &'n Named, path: &str) -> Option<&'n SampledTexture> {
    if let Some(own) = named.textures.get(path) {
        return own.all().first();
    }
    let (array, index) = path.strip_suffix(']')?.rsplit_once('[')?;
    let index: usize = index.parse().ok()?;
    let keys = [format!("{array}[0]"), array.to_owned()];
    keys.iter()
        .find_map(|key| named.textures.get(key)?.all().get(index))
}

/// The block of uniforms outside of blocks, from their names.
fn loose(material: &Material, used: &BindingUse, named: &Named) -> Result<Data, Left> {
    bind::filled(material, used, &|path, index, count| {
        if let Some(own) = named.uniforms.get(path) {
            return own.get(..count);
        }
        // Arrays have the name of their first element, and all numbers.
        let array = path.strip_suffix(']')?.rsplit_once('[')?.0;
        let first = index? * count;
        let keys = [format!("{array}[0]"), array.to_owned()];
        keys.iter()
            .find_map(|key| named.uniforms.get(key)?.get(first..first + count))
    })
    .map_err(|e| Left::Out(e.to_string()))
}
