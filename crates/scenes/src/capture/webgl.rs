//! Converts draws of WebGL for a scene. Resources by name become bindings, and vertex arrays of any
//! layout become two interleaved buffers.

use std::collections::BTreeMap;

use naga::ScalarKind;
use naga_edit::declared::{Declaration, Type};
use naga_edit::interface;
use preshade_plan::plan::{BindingKind, BindingLayout, BindingUse};

use super::maker::{Bound, Maker};
use super::reader::Left;
use super::{Error, draw_id, points, texels};
use preshade_draw::scene::Material;
use preshade_draw::scene::bind::{
    self, BufferBinding, Data, Indices, Rate, SamplerBinding, VertexAttribute, VertexBuffer,
};
use preshade_frames::file::{
    self, Api, AttributeFormat, BufferRange, IndexFormat, Named, Packed, RenderPipeline,
    SampledTexture, Topology,
};
use preshade_frames::folder::{Capture, get};
use preshade_frames::pass::{Call, PassDraw, TexturePart};

/// The array of a WebGL attribute, and the program's input that reads it.
struct Source<'d> {
    location: u32,
    format: AttributeFormat,
    /// The format in the new buffer.
    target: wgpu::VertexFormat,
    bytes: &'d [u8],
    stride: usize,
    offset: usize,
    /// Number of instances that share one element.
    divisor: usize,
}

/// The resource of one of the program's bindings in a draw.
pub(super) enum BoundResource<'n> {
    /// Data for the uniforms outside of blocks.
    Loose(Data),
    Block(&'n BufferRange),
    Texture(&'n SampledTexture),
    Sampler(&'n SampledTexture),
}

/// Finds the resource of a binding by its name in the author's text.
pub(super) fn given<'n>(
    material: &Material,
    used: &BindingUse,
    named: &'n Named,
) -> Result<BoundResource<'n>, Left> {
    let declared = material.program.declared();
    let is = |b: naga::ResourceBinding| (b.group, b.binding) == (used.group, used.binding);
    let texture = |path: Option<&str>| {
        let path = path.unwrap_or(&used.name);
        let found = sampled(named, path).or_else(|| unread(named, used));
        found.ok_or_else(|| missing(path))
    };
    match used.kind {
        BindingKind::Uniform if declared.loose.is_some_and(is) => {
            loose(material, used, named).map(BoundResource::Loose)
        }
        BindingKind::Uniform => {
            let block = declared.blocks.iter().find(|b| is(b.binding));
            let name = block.map_or(used.name.as_str(), |b| &b.name);
            let range = named.blocks.get(name).ok_or_else(|| missing(name))?;
            Ok(BoundResource::Block(range))
        }
        BindingKind::Texture | BindingKind::DepthTexture => {
            let pair = declared.samplers.iter().find(|s| is(s.texture));
            texture(pair.map(|p| p.path.as_str())).map(BoundResource::Texture)
        }
        BindingKind::Sampler | BindingKind::ComparisonSampler => {
            let pair = declared.samplers.iter().find(|s| is(s.sampler));
            texture(pair.map(|p| p.path.as_str())).map(BoundResource::Sampler)
        }
        _ => Err(missing(&used.name)),
    }
}

/// Any texture of the same shape. WebGL lists no texture without an effect on pixels, and its
/// compiler may find more of those than ours.
fn unread<'n>(named: &'n Named, used: &BindingUse) -> Option<&'n SampledTexture> {
    let shape = match &used.layout {
        Some(BindingLayout::Texture { view_dimension, .. }) => view_dimension.as_str(),
        _ => "2d",
    };
    let all = named.textures.values().flat_map(|t| t.all());
    let is_alike = |t: &&SampledTexture| match t.texture.view.dimension {
        Some(wgpu::TextureViewDimension::D2) | None => shape == "2d",
        Some(wgpu::TextureViewDimension::D2Array) => shape == "2d-array",
        Some(wgpu::TextureViewDimension::Cube) => shape == "cube",
        Some(wgpu::TextureViewDimension::D3) => shape == "3d",
        _ => false,
    };
    all.into_iter().find(is_alike)
}

impl Maker<'_> {
    /// The named resources that the program reads, as bindings.
    pub(super) fn named_resources(&mut self, named: usize, material: usize) -> Result<Bound, Left> {
        let named = get(&self.capture.file.named, named, "named resources", "a draw")?;
        let mut bound: Bound = Default::default();
        let uses = self.bindings(material);
        for used in uses.iter() {
            match given(&self.materials[material], used, named)? {
                BoundResource::Loose(data) => bound.0.push(buffer(used, data)),
                BoundResource::Block(range) => {
                    let data = self.part((range.buffer, range.offset, range.size))?;
                    bound.0.push(buffer(used, texels::padded(data)));
                }
                BoundResource::Texture(found) => {
                    let place = (used.group, used.binding);
                    bound.1.push(self.texture(&found.texture, place, used)?);
                }
                BoundResource::Sampler(found) => {
                    let of = sampler_of(self.capture, found, "a draw")?;
                    bound.2.push(SamplerBinding {
                        group: used.group,
                        binding: used.binding,
                        sampler: texels::sampler(&of),
                    });
                }
            }
        }
        Ok(bound)
    }
}

/// The sampler of a texture. WebGL 1 may filter depths that it reads as numbers, but WebGPU may
/// not.
pub(super) fn sampler_of(
    capture: &Capture,
    found: &SampledTexture,
    place: &str,
) -> Result<file::Sampler, Error> {
    let texture = get(
        &capture.file.textures,
        found.texture.texture,
        "texture",
        place,
    )?;
    let of = get(&capture.file.samplers, found.sampler, "sampler", place)?;
    let mut of = of.clone();
    if texture.format.has_depth_aspect() && of.compare.is_none() {
        of.mag_filter = wgpu::FilterMode::Nearest;
        of.min_filter = wgpu::FilterMode::Nearest;
        of.mipmap_filter = wgpu::MipmapFilterMode::Nearest;
    }
    Ok(of)
}

/// Reads a part of a buffer.
pub(super) type Parts<'p> = dyn FnMut(TexturePart) -> Result<Data, Left> + 'p;

/// Refuses a draw with too many instances or vertices, because they are copied.
fn within(capture: &Capture, call: Call) -> Result<(), Left> {
    let limits = capture.limits();
    let instances = u64::from(call.first_instance) + u64::from(call.instances);
    let vertices = u64::from(call.count);
    limits
        .check("copies", instances, "the instances of a draw")
        .and_then(|()| limits.check("vertices", vertices, "the vertices of a draw"))
        .map_err(|e| Left::Out(e.to_string()))
}

/// The attributes that the program reads, interleaved in two buffers: per vertex and per instance.
pub(super) fn interleaved(
    capture: &Capture,
    draw: &PassDraw,
    pipeline: &RenderPipeline,
    material: &Material,
    part: &mut Parts<'_>,
) -> Result<Vec<VertexBuffer>, Left> {
    within(capture, draw.call)?;
    let mut contents = BTreeMap::new();
    for (slot, of) in &draw.vertices {
        contents.insert(*slot, part(*of)?);
    }
    let named = draw.named.and_then(|n| capture.file.named.get(n));
    let mut steps: [Vec<Source<'_>>; 2] = Default::default();
    let constants = constants(named);
    let (mut corner, mut origin) = (None, None);
    for input in attributes(material) {
        if input.name == points::CORNER {
            corner = Some(input.location);
            continue;
        }
        if input.name == points::ORIGIN {
            origin = Some(input.location);
            continue;
        }
        let (found, step) = match placed(pipeline, &input, draw, &contents) {
            Some(found) => found,
            None => {
                let column = format!("{}[{}]", input.name, input.column);
                let of = constants
                    .get(&input.name)
                    .or_else(|| constants.get(&column));
                let of = of.unwrap_or(&DEFAULT);
                let source = Source {
                    location: input.location,
                    format: AttributeFormat::Own(wgpu::VertexFormat::Float32x4),
                    target: wgpu::VertexFormat::Float32x4,
                    bytes: of,
                    stride: 0,
                    offset: 0,
                    divisor: 1,
                };
                (source, wgpu::VertexStepMode::Instance)
            }
        };
        steps[usize::from(step == wgpu::VertexStepMode::Instance)].push(found);
    }
    let last = draw.call.first_instance.saturating_add(draw.call.instances);
    let [vertices, instances] = steps;
    let mut made = Vec::new();
    let by_vertex = interleave(&vertices, wgpu::VertexStepMode::Vertex, None);
    match (corner, draw.viewport) {
        (None, _) => made.extend(by_vertex),
        (Some(_), None) => return Err(Left::Out("points without a viewport".to_owned())),
        (Some(corner), Some([x, y, width, height, ..])) => {
            let numbers = numbers(draw, draw.call, part)?;
            let corners = points::Corners {
                corner,
                origin,
                viewport: [x, y, width, height],
            };
            made.push(points::spread(by_vertex, &numbers, &corners));
        }
    }
    let count = Some(last as usize);
    made.extend(interleave(
        &instances,
        wgpu::VertexStepMode::Instance,
        count,
    ));
    Ok(made)
}

/// Whether a program draws points as squares.
pub(super) fn is_points(material: &Material) -> bool {
    attributes(material)
        .iter()
        .any(|a| a.name == points::CORNER)
}

/// The index buffer of an indexed draw.
fn given_indices(
    draw: &PassDraw,
    call: Call,
    part: &mut Parts<'_>,
) -> Result<Option<(Data, IndexFormat)>, Left> {
    match (call.indexed, draw.indices) {
        (false, _) => Ok(None),
        (true, None) => Err(Left::Out("no index buffer is set".to_owned())),
        (true, Some((of, format))) => Ok(Some((part(of)?, format))),
    }
}

/// The vertex index of each vertex in a draw.
fn numbers(draw: &PassDraw, call: Call, part: &mut Parts<'_>) -> Result<Vec<u32>, Left> {
    let given = given_indices(draw, call, part)?;
    let all = call.first..call.first.saturating_add(call.count);
    Ok(match given {
        None => all.collect(),
        Some((data, format)) => all.map(|i| index(&data, format, i)).collect(),
    })
}

/// Converts a draw's indices and arguments for WebGPU. Bytes become 16 bits, WebGL's fans and loops
/// become lists and strips, and sized points become two triangles each. WebGL 2 restarts every
/// primitive at the highest index, WebGPU only strips.
pub(super) fn indices(
    capture: &Capture,
    draw: &PassDraw,
    pipeline: &RenderPipeline,
    material: &Material,
    call: Call,
    part: &mut Parts<'_>,
) -> Result<(Option<Indices>, Call), Left> {
    if is_points(material) {
        let call = Call {
            first: 0,
            count: call.count.saturating_mul(6),
            indexed: false,
            ..call
        };
        return Ok((None, call));
    }
    within(capture, call)?;
    let given = given_indices(draw, call, part)?;
    if let Some((data, format)) = &given
        && u64::from(call.first) + u64::from(call.count) > format.count(data.bytes.len())
    {
        let why = "it reads indices beyond their buffer: WebGL and WebGPU draw nothing of it";
        return Err(Left::Out(why.to_owned()));
    }
    let restarts = capture.file.source.api == Api::WebGl2;
    let corners = (call.first..call.first.saturating_add(call.count)).map(|i| match &given {
        None => Some(i),
        Some((data, format)) => {
            Some(index(data, *format, i)).filter(|n| !restarts || *n != format.highest())
        }
    });
    let topology = pipeline.primitive.topology;
    let is_own = match topology {
        Topology::TriangleFan | Topology::LineLoop => false,
        Topology::TriangleStrip | Topology::LineStrip => true,
        _ => corners.clone().all(|corner| corner.is_some()),
    };
    if is_own {
        let widened = given.map(|(data, format)| widened(data, format, restarts));
        return Ok((widened, call));
    }
    let corners: Vec<Option<u32>> = corners.collect();
    let runs = corners.split(Option::is_none);
    let mut numbers = Vec::new();
    for run in runs.map(|run| run.iter().copied().flatten().collect::<Vec<u32>>()) {
        let whole = |corners: usize| run[..run.len() / corners * corners].to_vec();
        numbers.extend(match topology {
            Topology::TriangleFan => {
                let triangles = run.windows(2).skip(1);
                triangles
                    .flat_map(|pair| [run[0], pair[0], pair[1]])
                    .collect()
            }
            Topology::LineLoop => {
                let separator = (!numbers.is_empty()).then_some(u32::MAX);
                let first = run.first().copied();
                separator.into_iter().chain(run).chain(first).collect()
            }
            Topology::TriangleList => whole(3),
            Topology::LineList => whole(2),
            _ => run,
        });
    }
    let call = Call {
        first: 0,
        count: numbers.len() as u32,
        indexed: true,
        ..call
    };
    let bytes = numbers.iter().flat_map(|n| n.to_le_bytes()).collect();
    let made = Indices {
        format: wgpu::IndexFormat::Uint32,
        count: call.count,
        data: Data::new(bytes),
    };
    Ok((Some(made), call))
}

fn widened(mut data: Data, format: IndexFormat, restarts: bool) -> Indices {
    let (format, size) = match format {
        IndexFormat::Uint32 => (wgpu::IndexFormat::Uint32, 4),
        IndexFormat::Uint16 => (wgpu::IndexFormat::Uint16, 2),
        IndexFormat::Uint8 => {
            let wide = data.bytes.iter().map(|b| match *b {
                u8::MAX if restarts => u16::MAX,
                b => u16::from(b),
            });
            data = Data::new(wide.flat_map(u16::to_le_bytes).collect());
            (wgpu::IndexFormat::Uint16, 2)
        }
    };
    let count = (data.bytes.len() / size) as u32;
    if !data.bytes.len().is_multiple_of(4) {
        let mut bytes = data.bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        data = Data::new(bytes);
    }
    Indices {
        format,
        count,
        data,
    }
}

/// The index at a position. 0 beyond the end.
fn index(data: &Data, format: IndexFormat, at: u32) -> u32 {
    let at = at as usize;
    let bytes = &data.bytes;
    match format {
        IndexFormat::Uint8 => bytes.get(at).map_or(0, |b| u32::from(*b)),
        IndexFormat::Uint16 => {
            let of = bytes.as_chunks::<2>().0.get(at);
            of.map_or(0, |b| u32::from(u16::from_le_bytes(*b)))
        }
        IndexFormat::Uint32 => {
            let of = bytes.as_chunks::<4>().0.get(at);
            of.map_or(0, |b| u32::from_le_bytes(*b))
        }
    }
}

/// Value of an attribute without an array: (0, 0, 0, 1).
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
    /// Column of a matrix input.
    column: u32,
    location: u32,
    kind: ScalarKind,
    components: u32,
}

impl Input {
    /// The format in the new buffer: that of the array, or 32 bits if WebGPU lacks it or converts
    /// differently.
    fn target(&self, format: AttributeFormat) -> wgpu::VertexFormat {
        use wgpu::VertexFormat as F;
        let components = match format {
            AttributeFormat::Own(own) if !self.is_converted(own) => return own,
            AttributeFormat::Own(_) => self.components,
            AttributeFormat::Other(packed) => packed.components,
        };
        let all = match self.kind {
            ScalarKind::Uint => [F::Uint32, F::Uint32x2, F::Uint32x3, F::Uint32x4],
            ScalarKind::Sint => [F::Sint32, F::Sint32x2, F::Sint32x3, F::Sint32x4],
            _ => [F::Float32, F::Float32x2, F::Float32x3, F::Float32x4],
        };
        all[(components as usize).clamp(1, 4) - 1]
    }

    /// Whether an integer array feeds a float input.
    fn is_converted(&self, format: wgpu::VertexFormat) -> bool {
        let name = format!("{format:?}");
        let is_integer = name.starts_with("Uint") || name.starts_with("Sint");
        self.kind == ScalarKind::Float && is_integer
    }
}

/// The inputs of the vertex stage, by their names in the author's text.
fn attributes(material: &Material) -> Vec<Input> {
    let module = material.program.module();
    let entry = material
        .program
        .entry_point(naga::ShaderStage::Vertex, &material.vertex);
    let Some((_, entry)) = entry else {
        return Vec::new();
    };
    let declared = &material.program.declared().attributes;
    let inputs = interface::inputs(module, &entry.function);
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

/// Finds the array of an input. `None` if no array is enabled for it.
fn placed<'d>(
    pipeline: &RenderPipeline,
    input: &Input,
    draw: &PassDraw,
    contents: &'d BTreeMap<u32, Data>,
) -> Option<(Source<'d>, wgpu::VertexStepMode)> {
    for (slot, layout) in pipeline.vertex.buffers.iter().enumerate() {
        let Some(layout) = layout else { continue };
        let is_it = |a: &&preshade_frames::file::VertexAttribute| {
            a.name.as_deref() == Some(&input.name) && a.column == input.column
        };
        let Some(attribute) = layout.attributes.iter().find(is_it) else {
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
                target: input.target(attribute.format),
                bytes: &data.bytes,
                stride: stride as usize,
                offset: attribute.offset as usize,
                divisor: layout.divisor.max(1) as usize,
            },
            layout.step_mode,
        ));
    }
    None
}

/// Interleaves arrays in one buffer. `None` without arrays. Without a count, it has as many
/// elements as the shortest array.
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
            (stride, false) => ((room - size) / stride + 1).saturating_mul(s.divisor),
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
            let from = source.offset + element / source.divisor * source.stride;
            let to = element * stride as usize + attribute.offset as usize;
            let Some(own) = source.bytes.get(from..from + size) else {
                break;
            };
            match source.format.own() == Some(source.target) {
                true => bytes[to..to + size].copy_from_slice(own),
                false => converted(source, own, &mut bytes[to..]),
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

/// Converts integers to the input's type, as WebGL does.
fn converted(source: &Source<'_>, own: &[u8], to: &mut [u8]) {
    let packed = packed(source.format);
    let width = (packed.bits / 8).max(1) as usize;
    let is_float = format!("{:?}", source.target).starts_with('F');
    let numbers = own.chunks(width).map(|bytes| {
        let mut wide = [0; 4];
        wide[..bytes.len()].copy_from_slice(bytes);
        let unsigned = u32::from_le_bytes(wide);
        let shift = 32 - packed.bits;
        let signed = (unsigned << shift) as i32 >> shift;
        if !is_float {
            return match packed.is_signed {
                true => signed.to_le_bytes(),
                false => unsigned.to_le_bytes(),
            };
        }
        let (value, most) = match packed.is_signed {
            true => (signed as f32, (1_u64 << (packed.bits - 1)) - 1),
            false => (unsigned as f32, (1_u64 << packed.bits) - 1),
        };
        let value = match packed.is_normalised {
            true => (value / most as f32).max(-1.0),
            false => value,
        };
        value.to_le_bytes()
    });
    for (to, number) in to.as_chunks_mut::<4>().0.iter_mut().zip(numbers) {
        *to = number;
    }
}

/// The component layout of an integer format.
fn packed(format: AttributeFormat) -> Packed {
    let own = match format {
        AttributeFormat::Other(packed) => return packed,
        AttributeFormat::Own(own) => format!("{own:?}"),
    };
    let size = own.trim_start_matches(|c: char| c.is_alphabetic());
    let (bits, components) = size.split_once('x').unwrap_or((size, "1"));
    Packed {
        is_signed: own.starts_with('S'),
        is_normalised: own.contains("norm"),
        bits: bits.parse().unwrap_or(32),
        components: components.parse().unwrap_or(1),
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

/// The texture at a path: `map`, or `maps[2]` from the list `maps[0]`.
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

/// The data of the uniforms outside of blocks, collected by name.
fn loose(material: &Material, used: &BindingUse, named: &Named) -> Result<Data, Left> {
    let declared = &material.program.declared().uniforms;
    bind::filled(material, used, &|path, index, count| {
        // The IR may have a vec4 in place of an array's element, or of a matrix column of two rows.
        let count = plain(declared, path).and_then(stored).unwrap_or(count);
        let path = if path == draw_id::OWN {
            draw_id::NAME
        } else {
            path
        };
        if let Some(own) = named.uniforms.get(path)
            && !path.ends_with(']')
        {
            return own.get(..count);
        }
        // Arrays are listed by their first element, with all numbers.
        let array = path.strip_suffix(']')?.rsplit_once('[')?.0;
        let first = index? * count;
        let keys = [format!("{array}[0]"), array.to_owned()];
        keys.iter()
            .find_map(|key| named.uniforms.get(key)?.get(first..first + count))
    })
    .map_err(|e| Left::Out(e.to_string()))
}

/// The GLSL type at a path.
fn plain<'d>(declared: &'d [Declaration], path: &str) -> Option<&'d str> {
    let (name, rest) = path.split_once('.').unwrap_or((path, ""));
    let name = name.split('[').next()?;
    let of = declared.iter().find(|d| d.name == name)?;
    match of.ty.innermost() {
        Type::Plain(name) => Some(name),
        Type::Struct(_, members) => plain(members, rest),
        _ => None,
    }
}

/// How many numbers of a GLSL type are contiguous in a block: all, or one column of a matrix with
/// two rows, since each column takes the space of a vec4.
fn stored(ty: &str) -> Option<usize> {
    let number = |c: char| c.to_digit(10).map(|n| n as usize);
    let mut digits = ty.chars().filter_map(number);
    match ty {
        "float" | "int" | "uint" | "bool" => Some(1),
        _ if ty.contains("vec") => digits.next(),
        _ if ty.starts_with("mat") => {
            let columns = digits.next()?;
            match digits.next().unwrap_or(columns) {
                2 => Some(2),
                rows => Some(columns * rows),
            }
        }
        _ => None,
    }
}
