//! Packs one draw of a scene into the bytes that a GPU pass needs.
//!
//! Reflection finds each binding and location of the pass in the author's program. Each member gets
//! its value from the first available source: the draw's values, the material's values, the name's
//! meaning by convention ([`Semantic`], mesh streams), a plausible number derived from the name.
//! `docs/reference/scene-values.md` lists the names.
//!
//! Nothing here depends on the plan. Two variants of a material get the same bytes and the same
//! [`Data::id`]s, so a renderer uploads each once.

use std::ops::Range;
use std::sync::Arc;

use naga::{ImageClass, ImageDimension, ScalarKind, ShaderStage, TypeInner};
use naga_edit::declared;
use preshade_plan::plan::{BindingKind, BindingLayout, BindingSource, BindingUse, GpuPass};
use preshade_plan::state::CompareFunction;

use super::globals::{self, Global, globals};
use super::layout::{self, Segment, VariableLeaf};
use super::semantic::{Semantic, SemanticValue, normalise};
use super::{
    Draw, Filter, Frame, Image, Material, Sampler, Scene, SceneError, Value, material, range,
    value_path,
};

pub mod buffer_numbers;
mod frozen_uniforms;
pub mod guessed;
pub mod overlapping_draws;
mod streams;

pub use buffer_numbers::numbers;
pub(super) use frozen_uniforms::uniforms;

pub use guessed::{Guess, Guessed, guessed};
pub use overlapping_draws::overlapping_draws;

use guessed::ValueOrigin;
use streams::Streams;
pub use streams::{
    is_index_buffer, is_instance_data, known_stream, stream_component, unknown_stream,
};

/// Bytes with their hash. Equal bytes have equal ids, so a renderer needs one GPU buffer for each
/// id.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Data {
    /// First 16 bytes of the BLAKE3 hash of `bytes`.
    pub id: u128,
    pub bytes: Arc<[u8]>,
}

impl Data {
    pub fn new(bytes: Vec<u8>) -> Self {
        let mut id = [0; 16];
        id.copy_from_slice(&blake3::hash(&bytes).as_bytes()[..16]);
        Self {
            id: u128::from_le_bytes(id),
            bytes: bytes.into(),
        }
    }
}

/// How often a buffer's content changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rate {
    /// The bytes are the same in every frame.
    Draw,
    /// The bytes follow the camera or the time.
    Frame,
}

/// A uniform or storage buffer.
#[derive(Clone, Debug, PartialEq)]
pub struct BufferBinding {
    pub group: u32,
    pub binding: u32,
    /// Uniform, read-only or read-write storage.
    pub kind: BindingKind,
    /// Content, a multiple of 16 bytes long.
    pub data: Data,
    pub rate: Rate,
    /// The byte ranges that preshade made up, in order.
    pub invented: Vec<Range<usize>>,
}

impl BufferBinding {
    /// Whether preshade made up any of these bytes.
    pub fn is_invented(&self, bytes: &Range<usize>) -> bool {
        let overlaps = |r: &Range<usize>| r.start < bytes.end && bytes.start < r.end;
        self.invented.iter().any(overlaps)
    }
}

/// The content of a texture binding.
#[derive(Clone, Debug, PartialEq)]
pub enum TextureContent {
    /// An image with its mips.
    Image(Arc<Image>),
    /// A depth texture filled with one value. A shadow map of this kind puts nothing in shadow.
    Depth {
        /// Width and height.
        size: [u32; 2],
        /// The depth value that fills it.
        value: f32,
    },
    /// A storage texture, zeroed.
    Storage {
        /// Width and height.
        size: [u32; 2],
        format: naga::StorageFormat,
    },
}

#[derive(Clone, Debug, PartialEq)]
pub struct TextureBinding {
    pub group: u32,
    pub binding: u32,
    pub content: TextureContent,
    pub view: wgpu::TextureViewDimension,
    /// Sample type; `Uint` and `Sint` read the image's texels as integers.
    pub sample_type: wgpu::TextureSampleType,
    pub multisampled: bool,
    /// Whether preshade made up the content.
    pub is_invented: bool,
    /// Whether no command of the frame writes it.
    pub is_steady: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SamplerBinding {
    pub group: u32,
    pub binding: u32,
    /// How it samples; `compare` is set exactly for comparison samplers.
    pub sampler: Sampler,
}

/// One vertex attribute in a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VertexAttribute {
    pub location: u32,
    pub format: wgpu::VertexFormat,
    /// In bytes.
    pub offset: u64,
    /// Whether preshade made up the values.
    pub is_invented: bool,
}

/// All attributes of one step mode, interleaved. The buffer holds every attribute of the author's
/// vertex stage and lists those that this pass reads, so all passes of a material share it.
#[derive(Clone, Debug, PartialEq)]
pub struct VertexBuffer {
    /// Bytes from one vertex or instance to the next.
    pub stride: u64,
    /// By vertex or by instance.
    pub step: wgpu::VertexStepMode,
    pub attributes: Vec<VertexAttribute>,
    pub data: Data,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Indices {
    /// 16 bits when the mesh has at most 65,535 vertices.
    pub format: wgpu::IndexFormat,
    /// Number of indices in the buffer.
    pub count: u32,
    /// Content, padded to a multiple of 4 bytes.
    pub data: Data,
}

/// Everything a draw call needs except the pipeline.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawBindings {
    /// Immediate data, from offset 0.
    pub immediates: Option<Data>,
    pub buffers: Vec<BufferBinding>,
    /// Textures, without those that the renderer takes from an attachment.
    pub textures: Vec<TextureBinding>,
    pub samplers: Vec<SamplerBinding>,
    /// At most one per vertex and one per instance.
    pub vertex_buffers: Vec<VertexBuffer>,
    /// `None` draws the vertices in order.
    pub indices: Option<Indices>,
    /// Number of vertices in the buffers.
    pub vertex_count: u32,
    pub call: Call,
    pub instances: u32,
    /// Area of the target. `None`: the scene's viewport.
    pub area: Option<Area>,
}

/// The viewport and the scissor of one draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// x, y, width, height in pixels, and the depths of the near and the far plane.
    pub viewport: [f32; 6],
    /// x, y, width and height in pixels.
    pub scissor: [u32; 4],
    /// Size in pixels of the target that they refer to.
    pub of: [u32; 2],
}

impl Area {
    /// A part of a target with all depths. `part`: x, y, width and height in pixels.
    pub(crate) fn of(part: [u32; 4], target: [u32; 2]) -> Self {
        let [x, y, w, h] = part.map(|length| length as f32);
        Self {
            viewport: [x, y, w, h, 0.0, 1.0],
            scissor: part,
            of: target,
        }
    }

    /// x, y, width and height of the viewport, in pixels.
    pub(crate) fn part(&self) -> [f32; 4] {
        let [x, y, w, h, ..] = self.viewport;
        [x, y, w, h]
    }

    /// The same part, with all depths.
    pub fn with_all_depths(self) -> Self {
        let [x, y, w, h] = self.part();
        Self {
            viewport: [x, y, w, h, 0.0, 1.0],
            ..self
        }
    }

    /// The same part of a target of another size.
    pub(crate) fn scaled(self, size: [u32; 2]) -> Self {
        if size == self.of {
            return self;
        }
        let [x, y, width, height, near, far] = self.viewport;
        let [sx, sy] = [0, 1].map(|i| size[i] as f32 / self.of[i].max(1) as f32);
        let [left, top, w, h] = self.scissor;
        let span = |axis: usize, from: u32, length: u32| {
            let of = u64::from(self.of[axis].max(1));
            let to = u64::from(size[axis]);
            let begin = u64::from(from) * to / of;
            let end = ((u64::from(from) + u64::from(length)) * to)
                .div_ceil(of)
                .min(to);
            [begin as u32, end.saturating_sub(begin) as u32]
        };
        let ([left, w], [top, h]) = (span(0, left, w), span(1, top, h));
        Self {
            viewport: [x * sx, y * sy, width * sx, height * sy, near, far],
            scissor: [left, top, w, h],
            of: size,
        }
    }
}

impl DrawBindings {
    /// The resources that a pass reads.
    fn read_by(&self, pass: &GpuPass) -> Self {
        let reads = |group: u32, binding: u32| {
            authored(pass).any(|b| (b.group, b.binding) == (group, binding))
        };
        let mut own = self.clone();
        own.buffers.retain(|b| reads(b.group, b.binding));
        own.textures.retain(|t| reads(t.group, t.binding));
        own.samplers.retain(|s| reads(s.group, s.binding));
        let is_read =
            |a: &VertexAttribute| pass.attributes.iter().any(|r| r.location == a.location);
        for buffer in &mut own.vertex_buffers {
            buffer.attributes.retain(is_read);
        }
        own
    }
}

/// The arguments of a draw call except the number of instances:
/// `drawIndexed(count, instances, first, base_vertex, first_instance)`, or
/// `draw(count, instances, first, first_instance)`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Call {
    /// First index, or first vertex without indices.
    pub first: u32,
    /// Indices, or vertices without indices.
    pub count: u32,
    /// Added to each index.
    pub base_vertex: i32,
    /// First value of `instance_index`.
    pub first_instance: u32,
}

/// Binds everything that `pass` lists, for one draw in one frame.
///
/// # Errors
/// A value does not fit its variable, a semantic is unknown, or a scene cannot fill a binding of
/// this kind (acceleration structures, binding arrays).
pub fn draw(
    scene: &Scene,
    material: &Material,
    pass: &GpuPass,
    draw: &Draw,
    frame: &Frame,
) -> Result<DrawBindings, SceneError> {
    if let Some(captured) = &draw.captured {
        return Ok(captured.read_by(pass));
    }
    if let Some(mesh) = scene.meshes.get(draw.mesh) {
        range::check(mesh, draw)?;
    }
    let streams = Streams::new(scene, material, draw)?;
    let module = material.program.module();
    let mut out = DrawBindings {
        immediates: immediates(scene, material, draw, frame)?,
        buffers: Vec::new(),
        textures: Vec::new(),
        samplers: samplers(material, pass)?,
        vertex_buffers: streams.vertex_buffers(pass)?,
        indices: streams.indices(),
        vertex_count: streams.vertex_count(),
        call: streams.call(),
        instances: draw.instances,
        area: None,
    };
    for binding in authored(pass) {
        let (name, ty) = variable(material, binding)?;
        match binding.kind {
            BindingKind::Uniform | BindingKind::StorageRead | BindingKind::StorageReadWrite => {
                out.buffers.push(buffer(
                    scene,
                    material,
                    &streams,
                    binding,
                    draw,
                    frame,
                    &mut ignore,
                )?);
            }
            BindingKind::Sampler | BindingKind::ComparisonSampler => {}
            BindingKind::Texture | BindingKind::DepthTexture | BindingKind::StorageTexture => {
                let mut bound = texture(material, binding, name, &module.types[ty].inner)?;
                bound.is_invented |= scene.is_made_up;
                out.textures.push(bound);
            }
            BindingKind::AccelerationStructure => {
                return Err(SceneError::new(format!(
                    "material `{}`: `{name}` is an acceleration structure, which a scene cannot \
                     fill",
                    material.name
                )));
            }
        }
    }
    Ok(out)
}

/// The bytes of a material's immediate data for one draw in one frame, from offset 0 of the range.
/// `None` if it has none.
///
/// Its stages may declare different parts of the range, each with padding for the others.
///
/// # Errors
/// As [`draw`], and if two variables give one byte different values.
pub(crate) fn immediates(
    scene: &Scene,
    material: &Material,
    draw: &Draw,
    frame: &Frame,
) -> Result<Option<Data>, SceneError> {
    if let Some(captured) = &draw.captured {
        return Ok(captured.immediates.clone());
    }
    let streams = Streams::new(scene, material, draw)?;
    let mut bytes: Vec<Option<(u8, &str)>> = Vec::new();
    for variable in globals::immediates(&material.program) {
        let mut gaps: Vec<Range<usize>> = Vec::new();
        let mut observe = |leaf: &VariableLeaf<'_>, _: ValueOrigin, _: &[f64; 16]| {
            gaps.extend(is_padding(leaf).then(|| leaf.bytes.clone()));
        };
        let of = (scene, material, &streams);
        let packed = packed(of, variable, draw, frame, &mut observe)?;
        let own = packed.data.bytes;
        bytes.resize(bytes.len().max(own.len()), None);
        let (name, _) = variable;
        for (at, byte) in own.iter().enumerate() {
            if gaps.iter().any(|gap| gap.contains(&at)) {
                continue;
            }
            match bytes[at] {
                Some((other, first)) if other != *byte => {
                    return Err(SceneError::new(format!(
                        "material `{}`: `{first}` and `{name}` are both immediate data, and give \
                         byte {at} different values",
                        material.name
                    )));
                }
                _ => bytes[at] = Some((*byte, name)),
            }
        }
    }
    let bytes: Vec<u8> = bytes.iter().map(|b| b.map_or(0, |(b, _)| b)).collect();
    Ok((!bytes.is_empty()).then(|| Data::new(bytes)))
}

/// The buffers of [`draw`] with [`Rate::Frame`], for another frame. A renderer rewrites only these
/// when the camera moves.
///
/// # Errors
/// As [`draw`].
pub fn frame_buffers(
    scene: &Scene,
    material: &Material,
    pass: &GpuPass,
    draw: &Draw,
    frame: &Frame,
) -> Result<Vec<BufferBinding>, SceneError> {
    let mut bound = uniform_buffers(scene, material, pass, draw, frame)?;
    bound.retain(|b| b.rate == Rate::Frame);
    Ok(bound)
}

/// The uniform buffers of [`draw`].
///
/// # Errors
/// As [`draw`].
pub fn uniform_buffers(
    scene: &Scene,
    material: &Material,
    pass: &GpuPass,
    draw: &Draw,
    frame: &Frame,
) -> Result<Vec<BufferBinding>, SceneError> {
    if let Some(captured) = &draw.captured {
        let mut buffers = captured.read_by(pass).buffers;
        buffers.retain(|b| b.kind == BindingKind::Uniform);
        return Ok(buffers);
    }
    let streams = Streams::new(scene, material, draw)?;
    authored(pass)
        .filter(|b| b.kind == BindingKind::Uniform)
        .map(|b| buffer(scene, material, &streams, b, draw, frame, &mut ignore))
        .collect()
}

/// Checks that the uniform values of one draw fit their variables.
///
/// # Errors
/// As [`draw`], for uniforms only.
pub fn check(
    scene: &Scene,
    material: &Material,
    pass: &GpuPass,
    draw: &Draw,
    frame: &Frame,
) -> Result<(), SceneError> {
    if draw.captured.is_some() {
        return Ok(());
    }
    frame_buffers(scene, material, pass, draw, frame)?;
    let streams = Streams::new(scene, material, draw)?;
    let mut storage = authored(pass).filter(|b| {
        let kinds = [BindingKind::StorageRead, BindingKind::StorageReadWrite];
        kinds.contains(&b.kind)
    });
    storage.try_for_each(|b| {
        let (name, ty) = variable(material, b)?;
        runtime_length(material, &streams, draw, name, ty).map(drop)
    })
}

/// Length of the runtime-sized array that a variable is or ends in, if it does.
///
/// # Errors
/// The scene sets an element beyond the end.
fn runtime_length(
    material: &Material,
    streams: &Streams<'_>,
    draw: &Draw,
    name: &str,
    ty: naga::Handle<naga::Type>,
) -> Result<usize, SceneError> {
    let module = material.program.module();
    let given = match draw.values.get(name).or_else(|| material.values.get(name)) {
        Some(Value::Numbers(n)) if !name.is_empty() => Some(n.len()),
        _ => None,
    };
    let length = streams.runtime_length(name, ty, given);
    let keys = draw.values.keys().chain(material.values.keys());
    value_path::check_length(module, name, ty, length, keys)
        .map_err(|e| e.within(&format!("material `{}`", material.name)))?;
    Ok(length)
}

/// Callback for each scalar, vector and matrix that the scene does not set, with origin and
/// numbers.
type Observer<'o> = &'o mut dyn FnMut(&VariableLeaf<'_>, ValueOrigin, &[f64; 16]);

fn ignore(_: &VariableLeaf<'_>, _: ValueOrigin, _: &[f64; 16]) {}

fn authored(pass: &GpuPass) -> impl Iterator<Item = &BindingUse> {
    pass.bindings
        .iter()
        .filter(|b| b.source == BindingSource::Author)
}

/// Name and type of a bound variable in the author's program.
fn variable<'a>(
    material: &'a Material,
    binding: &BindingUse,
) -> Result<(&'a str, naga::Handle<naga::Type>), SceneError> {
    let at = |g: &Global<'_>| (g.group, g.binding) == (binding.group, binding.binding);
    let all = || globals(&material.program).filter(at);
    // Several variables may share a binding if they belong to different entry points.
    let named = all().find(|g| g.name == binding.name);
    named
        .or_else(|| all().next())
        .map(|g| (g.name, g.ty))
        .ok_or_else(|| {
            SceneError::new(format!(
                "material `{}` has no variable at group {} binding {}, which a pass of its plan \
                 names as the author's",
                material.name, binding.group, binding.binding
            ))
        })
}

fn buffer(
    scene: &Scene,
    material: &Material,
    streams: &Streams<'_>,
    binding: &BindingUse,
    draw: &Draw,
    frame: &Frame,
    observe: Observer<'_>,
) -> Result<BufferBinding, SceneError> {
    let variable = variable(material, binding)?;
    let packed = packed((scene, material, streams), variable, draw, frame, observe)?;
    Ok(BufferBinding {
        group: binding.group,
        binding: binding.binding,
        kind: binding.kind,
        data: packed.data,
        rate: packed.rate,
        invented: packed.invented,
    })
}

/// Looks up numbers by path, for [`filled`].
pub(crate) type Numbers<'f, 'n> = dyn Fn(&str, Option<usize>, usize) -> Option<&'n [f64]> + 'f;

/// The bytes of a variable, filled by path. `number` gets the path of a scalar, vector or matrix
/// (with indices, without the variable's name), its index in the innermost array, and the count of
/// numbers. Where it returns `None`, they are 0.
///
/// # Errors
/// The program does not declare the binding, or its type has no layout.
pub fn filled<'n>(
    material: &Material,
    binding: &BindingUse,
    number: &Numbers<'_, 'n>,
) -> Result<Data, SceneError> {
    let (name, ty) = variable(material, binding)?;
    let nothing = std::collections::BTreeMap::new();
    let given = layout::SceneValues {
        draw: &nothing,
        material: &nothing,
    };
    let mut leaf = |leaf: &VariableLeaf<'_>| {
        let whole = leaf.indexed();
        let path = whole.strip_prefix(name).unwrap_or(&whole);
        let count = (leaf.columns * leaf.rows) as usize;
        let mut numbers = [0.0; 16];
        if let Some(own) = number(path.trim_start_matches('.'), leaf.index, count) {
            let count = own.len().min(count);
            numbers[..count].copy_from_slice(&own[..count]);
        }
        Ok(numbers)
    };
    let module = material.program.module();
    layout::pack(module, name, ty, 0, given, &mut leaf).map(Data::new)
}

/// The content of a variable, as in [`BufferBinding`].
struct Packed {
    data: Data,
    rate: Rate,
    invented: Vec<Range<usize>>,
}

/// The content of a variable, given by name and type.
fn packed(
    (scene, material, streams): (&Scene, &Material, &Streams<'_>),
    (name, ty): (&str, naga::Handle<naga::Type>),
    draw: &Draw,
    frame: &Frame,
    observe: Observer<'_>,
) -> Result<Packed, SceneError> {
    let module = material.program.module();
    let depth = material.program.declared().depth;
    let given = layout::SceneValues {
        draw: &draw.values,
        material: &material.values,
    };
    let dynamic = runtime_length(material, streams, draw, name, ty)?;
    let mut rate = Rate::Draw;
    let mut invented: Vec<Range<usize>> = Vec::new();
    let mut leaf = |leaf: &VariableLeaf<'_>| -> Result<[f64; 16], SceneError> {
        if leaf.semantic.is_none()
            && let Some(numbers) = streams.element(name, ty, leaf)
        {
            observe(leaf, ValueOrigin::Mesh, &numbers);
            return Ok(numbers);
        }
        let said = leaf.semantic.map(|s| (s, ValueOrigin::Said));
        let named = leaf.named().map(|s| (s, ValueOrigin::Convention(s)));
        let used = std::iter::once_with(|| material.value_roles.get(&leaf.text()));
        let used = used.flatten().map(|s| (*s, ValueOrigin::Use(*s)));
        for (semantic, origin) in said.into_iter().chain(named).chain(used) {
            let index = if semantic.is_list() {
                leaf.index.unwrap_or(0)
            } else {
                0
            };
            let known = semantic.evaluate(scene, draw, frame, depth, index, leaf.rows as usize);
            match fit(known, leaf) {
                Some(numbers) => {
                    if semantic.is_per_frame() {
                        rate = Rate::Frame;
                    }
                    if let ValueOrigin::Use(_) = origin {
                        invented.push(leaf.bytes.clone());
                    }
                    observe(leaf, origin, &numbers);
                    return Ok(numbers);
                }
                None if origin == ValueOrigin::Said => {
                    let path = leaf.text();
                    return Err(SceneError::new(format!(
                        "`${}` does not fit `{path}`: one is a matrix, the other is not",
                        semantic.name()
                    ))
                    .about(leaf.indexed()));
                }
                None => {}
            }
        }
        // Padding has no value.
        if !is_padding(leaf) {
            match invented.last_mut() {
                Some(last) if last.end == leaf.bytes.start => last.end = leaf.bytes.end,
                _ => invented.push(leaf.bytes.clone()),
            }
        }
        let numbers = plausible(leaf);
        observe(leaf, ValueOrigin::MadeUp, &numbers);
        Ok(numbers)
    };
    let bytes = layout::pack(module, name, ty, dynamic, given, &mut leaf)
        .map_err(|e| e.within(&format!("material `{}`", material.name)))?;
    if scene.is_made_up {
        invented = std::iter::once(0..bytes.len()).collect();
    }
    Ok(Packed {
        data: Data::new(bytes),
        rate,
        invented,
    })
}

/// A known value cut to a leaf's shape. `None` if only one of them is a matrix.
fn fit(known: SemanticValue, leaf: &VariableLeaf<'_>) -> Option<[f64; 16]> {
    let mut out = [0.0; 16];
    match known {
        SemanticValue::Matrix(m) if leaf.columns > 1 => {
            for c in 0..leaf.columns as usize {
                for r in 0..leaf.rows as usize {
                    out[c * leaf.rows as usize + r] = f64::from(m.col(c)[r]);
                }
            }
        }
        SemanticValue::Vector(v) if leaf.columns == 1 => {
            for (r, n) in out.iter_mut().enumerate().take(leaf.rows as usize) {
                *n = f64::from(v[r]);
            }
        }
        _ => return None,
    }
    Some(out)
}

/// A number in 0..1 that depends only on a name and two indices.
fn hash01(name: &str, index: usize, component: usize) -> f64 {
    let mut h: u32 = 0x811c_9dc5;
    for b in name
        .bytes()
        .chain((index as u32).to_le_bytes())
        .chain((component as u32).to_le_bytes())
    {
        h = (h ^ u32::from(b)).wrapping_mul(0x0100_0193);
    }
    h ^= h >> 15;
    h = h.wrapping_mul(0x2c1b_3c6d);
    h ^= h >> 12;
    f64::from(h) / f64::from(u32::MAX)
}

/// Prefixes of names that mean padding.
const PADDING: [&str; 5] = ["pad", "unused", "reserved", "dummy", "filler"];

/// Whether a member is padding, by its name in the author's text or from our front end.
fn is_padding(leaf: &VariableLeaf<'_>) -> bool {
    let own = leaf.name();
    let name = normalise(own);
    PADDING.iter().any(|p| name.starts_with(p))
        || own
            .split_once("_padding_")
            .is_some_and(|(block, _)| declared::is_padding(block, own))
}

/// A value for a member with an unknown name: identity matrices, unit directions, positions around
/// the origin, colours, counts of 1, and otherwise numbers in 0.25..0.75.
fn plausible(leaf: &VariableLeaf<'_>) -> [f64; 16] {
    let name = normalise(leaf.name());
    let index = leaf.index.unwrap_or(0);
    let mut out = [0.0; 16];
    if leaf.columns > 1 {
        for c in 0..leaf.columns.min(leaf.rows) as usize {
            out[c * leaf.rows as usize + c] = 1.0;
        }
        return out;
    }
    let rows = leaf.rows as usize;
    if leaf.kind != ScalarKind::Float {
        let one = name.contains("count") || name.contains("num") || name.contains("size");
        out[..rows].fill(f64::from(u8::from(one)));
        return out;
    }
    let h = |c: usize| hash01(&name, index, c);
    for (c, n) in out.iter_mut().enumerate().take(rows) {
        *n = match () {
            () if c == 3 => 1.0,
            () if name.contains("direction") || name.ends_with("dir") => h(c) - 0.5,
            () if name.contains("pos") && rows > 1 => 8.0 * h(c) - if c == 1 { 0.0 } else { 4.0 },
            () if is_padding(leaf) => 0.0,
            () if name.contains("shininess")
                || name.ends_with("exponent")
                || name.starts_with("spec") && name.ends_with("power") =>
            {
                32.0
            }
            () if name == "constant" || name.contains("attenuationconstant") => 1.0,
            () if name == "linear" => 0.09,
            () if name == "quadratic" => 0.032,
            // Made-up materials should be visible: opaque and above any alpha test.
            () if name.contains("opacity") || name == "alpha" => 1.0,
            () if name.contains("alphatest") => 0.5,
            () if name.contains("displacement") => 0.02,
            () if name.contains("range") || name.contains("radius") => 10.0,
            () if name.contains("density") => 0.05,
            () if name.contains("intensity") || name.contains("power") => 1.0 + 2.0 * h(c),
            () if name.contains("scale") || name.contains("tiling") || name.contains("freq") => 2.0,
            // These are cosines of a spot light's cones. The outer cone is wider.
            () if name.contains("cutoff") && name.contains("outer") => 0.4,
            () if name.contains("cutoff") || name.contains("threshold") => 0.5,
            () if name == "ior" => 1.5,
            () if name == "gamma" => 2.2,
            () if name == "exposure" => 1.0,
            () if name.contains("color") || name.contains("colour") => 0.3 + 0.6 * h(c),
            () => 0.25 + 0.5 * h(c),
        };
    }
    if (name.contains("direction") || name.ends_with("dir")) && rows >= 3 {
        let length = out[..3].iter().map(|n| n * n).sum::<f64>().sqrt().max(1e-6);
        out[..3].iter_mut().for_each(|n| *n /= length);
    }
    out
}

/// Made-up numbers for a value of a bare shader, by the names on its path. `None` if they have a
/// conventional meaning, or the type has no numbers.
pub fn made_up(path: &str, ty: &TypeInner) -> Option<Vec<f64>> {
    let (columns, rows, scalar) = layout::leaf_shape(ty)?;
    let leaf = VariableLeaf {
        path: &[Segment::Name(path.rsplit('.').next()?)],
        index: None,
        columns,
        rows,
        kind: scalar.kind,
        width: scalar.width,
        semantic: None,
        bytes: 0..0,
    };
    let numbers = plausible(&leaf);
    match Semantic::of_path(path.rsplit('.')) {
        Some(_) => None,
        None => Some(numbers[..(columns * rows) as usize].to_vec()),
    }
}

/// The samplers that a pass of a material reads.
///
/// # Errors
/// A binding that the program does not declare.
pub(crate) fn samplers(
    material: &Material,
    pass: &GpuPass,
) -> Result<Vec<SamplerBinding>, SceneError> {
    let is_sampler = |b: &&BindingUse| {
        use BindingKind::{ComparisonSampler, Sampler};
        matches!(b.kind, Sampler | ComparisonSampler)
    };
    let own = authored(pass).filter(is_sampler);
    own.map(|binding| {
        let (name, _) = variable(material, binding)?;
        Ok(sampler(material, binding, name))
    })
    .collect()
}

fn sampler(material: &Material, binding: &BindingUse, name: &str) -> SamplerBinding {
    let given = material.samplers.get(name).copied();
    let mut sampler = given.unwrap_or_else(|| match &binding.layout {
        Some(layout) if *layout == BindingLayout::non_filtering() => Sampler {
            filter: Filter::Nearest,
            ..Sampler::default()
        },
        _ => Sampler::default(),
    });
    sampler.compare = (binding.kind == BindingKind::ComparisonSampler)
        .then(|| sampler.compare.unwrap_or(CompareFunction::LessEqual));
    SamplerBinding {
        group: binding.group,
        binding: binding.binding,
        sampler,
    }
}

fn texture(
    material: &Material,
    binding: &BindingUse,
    name: &str,
    inner: &TypeInner,
) -> Result<TextureBinding, SceneError> {
    let TypeInner::Image {
        dim,
        arrayed,
        class,
    } = *inner
    else {
        return Err(SceneError::new(format!(
            "material `{}`: `{name}` is an array of bindings, which a scene cannot fill",
            material.name
        )));
    };
    let view = match (dim, arrayed) {
        (ImageDimension::D1, _) => wgpu::TextureViewDimension::D1,
        (ImageDimension::D2, false) => wgpu::TextureViewDimension::D2,
        (ImageDimension::D2, true) => wgpu::TextureViewDimension::D2Array,
        (ImageDimension::D3, _) => wgpu::TextureViewDimension::D3,
        (ImageDimension::Cube, false) => wgpu::TextureViewDimension::Cube,
        (ImageDimension::Cube, true) => wgpu::TextureViewDimension::CubeArray,
    };
    let image = || match material.textures.get(name) {
        Some(image) => Arc::clone(image),
        None => material::default_texture(name, dim),
    };
    let (sample_type, multisampled, content) = match class {
        ImageClass::Depth { multi } => (
            wgpu::TextureSampleType::Depth,
            multi,
            match material.textures.get(name) {
                Some(image) => TextureContent::Image(Arc::clone(image)),
                None => TextureContent::Depth {
                    size: [256, 256],
                    value: 1.0,
                },
            },
        ),
        ImageClass::Storage { format, .. } => (
            wgpu::TextureSampleType::Float { filterable: false },
            false,
            TextureContent::Storage {
                size: [256, 256],
                format,
            },
        ),
        ImageClass::Sampled { kind, multi } => (
            match kind {
                ScalarKind::Sint => wgpu::TextureSampleType::Sint,
                ScalarKind::Uint => wgpu::TextureSampleType::Uint,
                _ => wgpu::TextureSampleType::Float { filterable: !multi },
            },
            multi,
            TextureContent::Image(image()),
        ),
        ImageClass::External => {
            return Err(SceneError::new(format!(
                "material `{}`: `{name}` is an external texture, which a scene cannot fill",
                material.name
            )));
        }
    };
    Ok(TextureBinding {
        group: binding.group,
        binding: binding.binding,
        is_steady: matches!(content, TextureContent::Image(_)),
        content,
        view,
        sample_type,
        multisampled,
        is_invented: !material.textures.contains_key(name),
    })
}

/// The inputs of a material's vertex entry point, with struct arguments split into members.
fn vertex_inputs(material: &Material) -> Result<Vec<naga_edit::interface::Io>, SceneError> {
    let (_, entry) = material
        .program
        .entry_point(ShaderStage::Vertex, &material.vertex)
        .ok_or_else(|| {
            SceneError::new(format!(
                "material `{}` has no vertex entry point `{}`",
                material.name, material.vertex
            ))
        })?;
    Ok(naga_edit::interface::inputs(
        material.program.module(),
        &entry.function,
    ))
}
