//! `frame.json`, as data. `docs/reference/frames.md` documents it for users. Names are WebGPU's own.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use shader_text::options::ClipSpace;

/// Schema name and version of the file.
pub(crate) const SCHEMA: &str = "preshade.frames.v1";

/// A file in `data`: the hash of its content, 32 hexadecimal digits.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize, Serialize)]
#[serde(try_from = "String", into = "String")]
pub struct DataName(String);

impl TryFrom<String> for DataName {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        match name.len() == 32 && name.bytes().all(|b| b.is_ascii_hexdigit()) {
            true => Ok(Self(name)),
            false => Err(format!(
                "`{name}` is no name of data: 32 hexadecimal digits"
            )),
        }
    }
}

impl From<DataName> for String {
    fn from(name: DataName) -> Self {
        name.0
    }
}

impl DataName {
    /// The file's name in the folder `data`.
    pub fn file(&self) -> String {
        format!("{}.bin", self.0)
    }
}

/// The content of `frame.json`.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct CaptureFile {
    pub schema: String,
    pub source: Source,
    #[serde(default)]
    pub buffers: Vec<Buffer>,
    #[serde(default)]
    pub textures: Vec<Texture>,
    #[serde(default)]
    pub samplers: Vec<Sampler>,
    #[serde(default)]
    pub shaders: Vec<Shader>,
    #[serde(default)]
    pub bind_group_layouts: Vec<BindGroupLayout>,
    #[serde(default)]
    pub pipeline_layouts: Vec<PipelineLayout>,
    #[serde(default)]
    pub bind_groups: Vec<BindGroup>,
    #[serde(default)]
    pub render_pipelines: Vec<RenderPipeline>,
    #[serde(default)]
    pub compute_pipelines: Vec<ComputePipeline>,
    #[serde(default)]
    pub named: Vec<Named>,
    #[serde(default)]
    pub start: Start,
    /// Commands before the first frame.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub setup: Vec<Command>,
    #[serde(default)]
    pub unknown: Vec<Unknown>,
    #[serde(default)]
    pub refused: Vec<Refused>,
    pub frames: Vec<CapturedFrame>,
}

impl CaptureFile {
    /// Whether the recorder left out no command that draws, copies or computes. Queries do not
    /// count.
    pub fn is_complete(&self) -> bool {
        self.refused
            .iter()
            .all(|r| r.what.to_lowercase().contains("query"))
    }
}

/// Who captured the frames, and from which page or app.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(default)]
#[allow(missing_docs)]
pub struct Source {
    pub api: Api,
    pub adapter: String,
    pub features: Vec<String>,
    pub title: String,
    pub writer: String,
}

/// The API that the page or app drew with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs)]
pub enum Api {
    #[default]
    WebGpu,
    WebGl2,
    WebGl1,
    Wgpu,
}

impl Api {
    /// The API's name in `frame.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::WebGpu => "webgpu",
            Self::WebGl2 => "webgl2",
            Self::WebGl1 => "webgl1",
            Self::Wgpu => "wgpu",
        }
    }

    /// Whether the capture follows WebGL's conventions for rows, depths and names.
    pub fn is_webgl(self) -> bool {
        matches!(self, Self::WebGl2 | Self::WebGl1)
    }
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct Buffer {
    pub size: u64,
    #[serde(default)]
    pub usage: u32,
    #[serde(default)]
    pub label: String,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct Texture {
    pub size: Extent,
    pub format: wgpu::TextureFormat,
    #[serde(default = "two")]
    pub dimension: wgpu::TextureDimension,
    #[serde(default = "one")]
    pub mip_level_count: u32,
    #[serde(default = "one")]
    pub sample_count: u32,
    #[serde(default)]
    pub usage: u32,
    #[serde(default)]
    pub view_formats: Vec<wgpu::TextureFormat>,
    #[serde(default)]
    pub label: String,
}

fn two() -> wgpu::TextureDimension {
    wgpu::TextureDimension::D2
}

fn one() -> u32 {
    1
}

/// Three sizes, as a list or by name. A size that is left out is 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(from = "Triple<1>", into = "[u32; 3]")]
pub struct Extent(pub [u32; 3]);

/// A place in a texture. A number that is left out is 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(from = "Triple<0>", into = "[u32; 3]")]
pub struct Origin(pub [u32; 3]);

#[derive(Deserialize)]
#[serde(untagged)]
enum Triple<const REST: u32> {
    List(Vec<u32>),
    #[serde(rename_all = "camelCase")]
    Names {
        #[serde(alias = "x")]
        width: Option<u32>,
        #[serde(alias = "y")]
        height: Option<u32>,
        #[serde(alias = "z")]
        depth_or_array_layers: Option<u32>,
    },
}

impl<const REST: u32> Triple<REST> {
    fn numbers(self) -> [u32; 3] {
        match self {
            Self::List(list) => [0, 1, 2].map(|i| list.get(i).copied().unwrap_or(REST)),
            Self::Names {
                width,
                height,
                depth_or_array_layers,
            } => [width, height, depth_or_array_layers].map(|n| n.unwrap_or(REST)),
        }
    }
}

impl From<Triple<1>> for Extent {
    fn from(triple: Triple<1>) -> Self {
        Self(triple.numbers())
    }
}

impl From<Triple<0>> for Origin {
    fn from(triple: Triple<0>) -> Self {
        Self(triple.numbers())
    }
}

impl From<Extent> for [u32; 3] {
    fn from(extent: Extent) -> Self {
        extent.0
    }
}

impl From<Origin> for [u32; 3] {
    fn from(origin: Origin) -> Self {
        origin.0
    }
}

impl Extent {
    /// Converts to wgpu's type.
    pub fn wgpu(self) -> wgpu::Extent3d {
        let [width, height, depth_or_array_layers] = self.0;
        wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers,
        }
    }
}

impl Origin {
    /// Converts to wgpu's type.
    pub fn wgpu(self) -> wgpu::Origin3d {
        let [x, y, z] = self.0;
        wgpu::Origin3d { x, y, z }
    }
}

/// A colour, as four numbers or by channel names.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(untagged)]
#[allow(missing_docs)]
pub enum Color {
    List([Option<f64>; 4]),
    Names { r: f64, g: f64, b: f64, a: f64 },
}

impl Color {
    /// The four channels. `null` reads as NaN, which JSON lacks.
    pub fn numbers(self) -> [f64; 4] {
        match self {
            Self::List(list) => list.map(|n| n.unwrap_or(f64::NAN)),
            Self::Names { r, g, b, a } => [r, g, b, a],
        }
    }

    /// Converts to wgpu's type.
    pub fn wgpu(self) -> wgpu::Color {
        let [r, g, b, a] = self.numbers();
        wgpu::Color { r, g, b, a }
    }
}

/// A `GPUSamplerDescriptor`.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "camelCase", default)]
#[allow(missing_docs)]
pub struct Sampler {
    pub address_mode_u: wgpu::AddressMode,
    pub address_mode_v: wgpu::AddressMode,
    pub address_mode_w: wgpu::AddressMode,
    pub mag_filter: wgpu::FilterMode,
    pub min_filter: wgpu::FilterMode,
    pub mipmap_filter: wgpu::MipmapFilterMode,
    pub lod_min_clamp: f32,
    pub lod_max_clamp: f32,
    pub compare: Option<wgpu::CompareFunction>,
    pub max_anisotropy: u16,
}

impl Default for Sampler {
    fn default() -> Self {
        let own = wgpu::SamplerDescriptor::default();
        Self {
            address_mode_u: own.address_mode_u,
            address_mode_v: own.address_mode_v,
            address_mode_w: own.address_mode_w,
            mag_filter: own.mag_filter,
            min_filter: own.min_filter,
            mipmap_filter: own.mipmap_filter,
            lod_min_clamp: own.lod_min_clamp,
            lod_max_clamp: own.lod_max_clamp,
            compare: None,
            max_anisotropy: 1,
        }
    }
}

impl Sampler {
    /// Converts to wgpu's type, with the anisotropy clamped to 1 to 16.
    pub fn wgpu(&self) -> wgpu::SamplerDescriptor<'static> {
        wgpu::SamplerDescriptor {
            label: None,
            address_mode_u: self.address_mode_u,
            address_mode_v: self.address_mode_v,
            address_mode_w: self.address_mode_w,
            mag_filter: self.mag_filter,
            min_filter: self.min_filter,
            mipmap_filter: self.mipmap_filter,
            lod_min_clamp: self.lod_min_clamp,
            lod_max_clamp: self.lod_max_clamp,
            compare: self.compare,
            anisotropy_clamp: self.max_anisotropy.clamp(1, 16),
            border_color: None,
        }
    }
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct Shader {
    pub data: DataName,
    pub language: ShaderLanguage,
    #[serde(default)]
    pub label: String,
}

/// The language of a shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[allow(missing_docs)]
pub enum ShaderLanguage {
    #[serde(rename = "wgsl")]
    Wgsl,
    #[serde(rename = "glsl-es-100")]
    GlslEs100,
    #[serde(rename = "glsl-es-300")]
    GlslEs300,
    #[serde(rename = "spirv")]
    SpirV,
}

/// A `GPUBindGroupLayoutDescriptor`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct BindGroupLayout {
    pub entries: Vec<LayoutEntry>,
}

/// A `GPUBindGroupLayoutEntry`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct LayoutEntry {
    pub binding: u32,
    pub visibility: u32,
    pub buffer: Option<BufferLayout>,
    pub sampler: Option<SamplerLayout>,
    pub texture: Option<TextureLayout>,
    pub storage_texture: Option<StorageTextureLayout>,
}

/// A `GPUBufferBindingLayout`.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(rename_all = "camelCase", default)]
#[allow(missing_docs)]
pub struct BufferLayout {
    #[serde(rename = "type")]
    pub ty: BufferType,
    pub has_dynamic_offset: bool,
    pub min_binding_size: u64,
}

/// How a buffer is bound.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum BufferType {
    #[default]
    Uniform,
    Storage,
    ReadOnlyStorage,
}

impl BufferType {
    /// Converts to wgpu's type.
    pub fn wgpu(self) -> wgpu::BufferBindingType {
        match self {
            Self::Uniform => wgpu::BufferBindingType::Uniform,
            Self::Storage => wgpu::BufferBindingType::Storage { read_only: false },
            Self::ReadOnlyStorage => wgpu::BufferBindingType::Storage { read_only: true },
        }
    }
}

/// A `GPUSamplerBindingLayout`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct SamplerLayout {
    #[serde(rename = "type", default = "filtering")]
    pub ty: wgpu::SamplerBindingType,
}

fn filtering() -> wgpu::SamplerBindingType {
    wgpu::SamplerBindingType::Filtering
}

/// A `GPUTextureBindingLayout`.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(rename_all = "camelCase", default)]
#[allow(missing_docs)]
pub struct TextureLayout {
    pub sample_type: SampleType,
    pub view_dimension: Option<wgpu::TextureViewDimension>,
    pub multisampled: bool,
}

/// A `GPUTextureSampleType`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum SampleType {
    #[default]
    Float,
    UnfilterableFloat,
    Depth,
    Sint,
    Uint,
}

impl SampleType {
    /// Converts to wgpu's type.
    pub fn wgpu(self) -> wgpu::TextureSampleType {
        match self {
            Self::Float => wgpu::TextureSampleType::Float { filterable: true },
            Self::UnfilterableFloat => wgpu::TextureSampleType::Float { filterable: false },
            Self::Depth => wgpu::TextureSampleType::Depth,
            Self::Sint => wgpu::TextureSampleType::Sint,
            Self::Uint => wgpu::TextureSampleType::Uint,
        }
    }
}

/// A `GPUStorageTextureBindingLayout`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct StorageTextureLayout {
    #[serde(default = "write_only")]
    pub access: wgpu::StorageTextureAccess,
    pub format: wgpu::TextureFormat,
    pub view_dimension: Option<wgpu::TextureViewDimension>,
}

fn write_only() -> wgpu::StorageTextureAccess {
    wgpu::StorageTextureAccess::WriteOnly
}

/// A `GPUPipelineLayoutDescriptor`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct PipelineLayout {
    pub bind_group_layouts: Vec<Option<usize>>,
}

/// A `GPUBindGroupDescriptor`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct BindGroup {
    pub layout: GroupLayout,
    pub entries: Vec<GroupEntry>,
}

/// The layout of a bind group.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(untagged, rename_all_fields = "camelCase")]
pub enum GroupLayout {
    /// An entry of the file's `bindGroupLayouts`.
    Number(usize),
    /// The layout that WebGPU derived from a render pipeline.
    Render {
        /// Number of the pipeline.
        pipeline: usize,
        /// Index of the bind group.
        group: u32,
    },
    /// The layout that WebGPU derived from a compute pipeline.
    Compute {
        /// Number of the pipeline.
        compute_pipeline: usize,
        /// Index of the bind group.
        group: u32,
    },
}

/// A `GPUBindGroupEntry`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct GroupEntry {
    pub binding: u32,
    #[serde(flatten)]
    pub resource: Resource,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(untagged)]
#[allow(missing_docs)]
pub enum Resource {
    Buffer(BufferRange),
    Texture(View),
    Sampler { sampler: usize },
}

/// A part of a buffer.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct BufferRange {
    /// Number of the buffer.
    pub buffer: usize,
    /// Offset in bytes.
    #[serde(default)]
    pub offset: u64,
    /// Size in bytes. `None`: to the buffer's end.
    #[serde(default)]
    pub size: Option<u64>,
}

/// A view of a texture.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct View {
    /// Number of the texture.
    pub texture: usize,
    /// How the view reads the texture.
    #[serde(default)]
    pub view: ViewDescriptor,
}

/// A `GPUTextureViewDescriptor`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "camelCase", default)]
#[allow(missing_docs)]
pub struct ViewDescriptor {
    pub format: Option<wgpu::TextureFormat>,
    pub dimension: Option<wgpu::TextureViewDimension>,
    pub aspect: Option<wgpu::TextureAspect>,
    pub base_mip_level: u32,
    pub mip_level_count: Option<u32>,
    pub base_array_layer: u32,
    pub array_layer_count: Option<u32>,
}

impl ViewDescriptor {
    /// Converts to wgpu's type.
    pub fn wgpu(&self) -> wgpu::TextureViewDescriptor<'static> {
        wgpu::TextureViewDescriptor {
            format: self.format,
            dimension: self.dimension,
            aspect: self.aspect.unwrap_or_default(),
            base_mip_level: self.base_mip_level,
            mip_level_count: self.mip_level_count,
            base_array_layer: self.base_array_layer,
            array_layer_count: self.array_layer_count,
            ..Default::default()
        }
    }
}

/// The layout of a pipeline.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(untagged)]
pub enum LayoutChoice {
    /// An entry of the file's `pipelineLayouts`.
    Number(usize),
    /// `"auto"`: derived from the shaders, as WebGPU does. For WebGL, derived from names.
    #[default]
    Auto,
    /// Always `auto`.
    Text(String),
}

/// A shader stage of a pipeline.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct Stage {
    pub module: usize,
    pub entry_point: Option<String>,
    #[serde(default)]
    pub constants: BTreeMap<String, f64>,
}

/// A `GPURenderPipelineDescriptor`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct RenderPipeline {
    #[serde(default)]
    pub label: String,
    #[serde(default)]
    pub layout: LayoutChoice,
    pub vertex: VertexState,
    pub fragment: Option<FragmentState>,
    #[serde(default)]
    pub primitive: Primitive,
    /// WebGL's clip space, if it differs from OpenGL's.
    pub clip_space: Option<ClipSpace>,
    pub depth_stencil: Option<DepthStencil>,
    #[serde(default)]
    pub multisample: Multisample,
}

/// A `GPUVertexState`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct VertexState {
    #[serde(flatten)]
    pub stage: Stage,
    #[serde(default)]
    pub buffers: Vec<Option<VertexBufferLayout>>,
}

/// A `GPUVertexBufferLayout`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct VertexBufferLayout {
    pub array_stride: u64,
    #[serde(default)]
    pub step_mode: wgpu::VertexStepMode,
    pub attributes: Vec<VertexAttribute>,
    /// WebGL: number of instances that share one element.
    #[serde(default = "one")]
    pub divisor: u32,
}

/// A `GPUVertexAttribute`. WebGL's attributes have names instead of locations.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct VertexAttribute {
    pub format: AttributeFormat,
    pub offset: u64,
    pub shader_location: Option<u32>,
    pub name: Option<String>,
    /// Column of a matrix attribute.
    #[serde(default)]
    pub column: u32,
}

/// A `GPUVertexFormat`, or a format that only WebGL has: integers that are read as floats
/// (`uscaled8x4`), and three components of 8 or 16 bits (`unorm8x3`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "String", into = "String")]
pub enum AttributeFormat {
    /// A format of WebGPU.
    Own(wgpu::VertexFormat),
    /// A format that only WebGL has.
    Other(Packed),
}

/// A vector of integers that a shader reads as floats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub struct Packed {
    pub is_signed: bool,
    /// Whether the largest integer reads as 1.0.
    pub is_normalised: bool,
    pub bits: u32,
    pub components: u32,
}

impl TryFrom<String> for AttributeFormat {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        let own = serde_json::from_value(serde_json::Value::String(name.clone()));
        if let Ok(own) = own {
            return Ok(Self::Own(own));
        }
        let wrong = || format!("there is no vertex format `{name}`");
        let start = name.find(|c: char| c.is_ascii_digit()).ok_or_else(wrong)?;
        let (kind, size) = name.split_at(start);
        let (bits, components) = size.split_once('x').unwrap_or((size, "1"));
        let (bits, components) = (bits.parse(), components.parse());
        let (Ok(bits @ (8 | 16 | 32)), Ok(components @ 1..=4)) = (bits, components) else {
            return Err(wrong());
        };
        let (is_signed, is_normalised) = match kind {
            "uscaled" | "uint" => (false, false),
            "sscaled" | "sint" => (true, false),
            "unorm" => (false, true),
            "snorm" => (true, true),
            _ => return Err(wrong()),
        };
        Ok(Self::Other(Packed {
            is_signed,
            is_normalised,
            bits,
            components,
        }))
    }
}

impl From<AttributeFormat> for String {
    fn from(format: AttributeFormat) -> Self {
        match format {
            AttributeFormat::Own(own) => match serde_json::to_value(own) {
                Ok(serde_json::Value::String(name)) => name,
                _ => Self::new(),
            },
            AttributeFormat::Other(packed) => {
                let kind = match (packed.is_signed, packed.is_normalised) {
                    (false, false) => "uscaled",
                    (true, false) => "sscaled",
                    (false, true) => "unorm",
                    (true, true) => "snorm",
                };
                format!("{kind}{}x{}", packed.bits, packed.components)
            }
        }
    }
}

impl AttributeFormat {
    /// The WebGPU format, if WebGPU has it.
    pub fn own(self) -> Option<wgpu::VertexFormat> {
        match self {
            Self::Own(format) => Some(format),
            Self::Other(_) => None,
        }
    }

    /// Size of all components in bytes.
    pub fn size(self) -> u64 {
        match self {
            Self::Own(format) => format.size(),
            Self::Other(packed) => u64::from(packed.bits / 8 * packed.components),
        }
    }
}

/// A `GPUFragmentState`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct FragmentState {
    #[serde(flatten)]
    pub stage: Stage,
    #[serde(default)]
    pub targets: Vec<Option<ColorTarget>>,
}

/// A `GPUColorTargetState`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct ColorTarget {
    pub format: wgpu::TextureFormat,
    pub blend: Option<Blend>,
    #[serde(default = "every_channel")]
    pub write_mask: u32,
}

fn every_channel() -> u32 {
    0xf
}

/// A `GPUBlendState`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct Blend {
    #[serde(default)]
    pub color: BlendComponent,
    #[serde(default)]
    pub alpha: BlendComponent,
}

/// A `GPUBlendComponent`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "camelCase", default)]
#[allow(missing_docs)]
pub struct BlendComponent {
    pub src_factor: wgpu::BlendFactor,
    pub dst_factor: wgpu::BlendFactor,
    pub operation: wgpu::BlendOperation,
}

impl Default for BlendComponent {
    fn default() -> Self {
        Self {
            src_factor: wgpu::BlendFactor::One,
            dst_factor: wgpu::BlendFactor::Zero,
            operation: wgpu::BlendOperation::Add,
        }
    }
}

/// A `GPUPrimitiveState`.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(rename_all = "camelCase", default)]
#[allow(missing_docs)]
pub struct Primitive {
    pub topology: Topology,
    pub strip_index_format: Option<IndexFormat>,
    pub front_face: wgpu::FrontFace,
    pub cull_mode: Cull,
    pub unclipped_depth: bool,
}

/// A `GPUPrimitiveTopology`, and WebGL's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum Topology {
    PointList,
    LineList,
    LineStrip,
    LineLoop,
    #[default]
    TriangleList,
    TriangleStrip,
    TriangleFan,
}

/// A `GPUCullMode`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum Cull {
    #[default]
    None,
    Front,
    Back,
}

/// A `GPUIndexFormat`, or WebGL's indices of 8 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs)]
pub enum IndexFormat {
    Uint8,
    Uint16,
    Uint32,
}

impl IndexFormat {
    /// How many indices fit into `bytes` bytes.
    pub fn count(self, bytes: usize) -> u64 {
        let size = match self {
            Self::Uint8 => 1,
            Self::Uint16 => 2,
            Self::Uint32 => 4,
        };
        bytes as u64 / size
    }

    /// The largest index value. WebGL restarts a strip at it.
    pub fn highest(self) -> u32 {
        match self {
            Self::Uint8 => u32::from(u8::MAX),
            Self::Uint16 => u32::from(u16::MAX),
            Self::Uint32 => u32::MAX,
        }
    }
}

/// A `GPUDepthStencilState`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct DepthStencil {
    pub format: wgpu::TextureFormat,
    pub depth_write_enabled: Option<bool>,
    pub depth_compare: Option<wgpu::CompareFunction>,
    #[serde(default)]
    pub stencil_front: StencilFace,
    #[serde(default)]
    pub stencil_back: StencilFace,
    #[serde(default = "every_bit")]
    pub stencil_read_mask: u32,
    #[serde(default = "every_bit")]
    pub stencil_write_mask: u32,
    #[serde(default)]
    pub depth_bias: i32,
    #[serde(default)]
    pub depth_bias_slope_scale: f32,
    #[serde(default)]
    pub depth_bias_clamp: f32,
}

fn every_bit() -> u32 {
    u32::MAX
}

/// A `GPUStencilFaceState`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "camelCase", default)]
#[allow(missing_docs)]
pub struct StencilFace {
    pub compare: wgpu::CompareFunction,
    pub fail_op: wgpu::StencilOperation,
    pub depth_fail_op: wgpu::StencilOperation,
    pub pass_op: wgpu::StencilOperation,
}

impl Default for StencilFace {
    fn default() -> Self {
        Self {
            compare: wgpu::CompareFunction::Always,
            fail_op: wgpu::StencilOperation::Keep,
            depth_fail_op: wgpu::StencilOperation::Keep,
            pass_op: wgpu::StencilOperation::Keep,
        }
    }
}

/// A `GPUMultisampleState`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase", default)]
#[allow(missing_docs)]
pub struct Multisample {
    pub count: u32,
    pub mask: u32,
    pub alpha_to_coverage_enabled: bool,
}

impl Default for Multisample {
    fn default() -> Self {
        Self {
            count: 1,
            mask: u32::MAX,
            alpha_to_coverage_enabled: false,
        }
    }
}

/// A `GPUComputePipelineDescriptor`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct ComputePipeline {
    #[serde(default)]
    pub label: String,
    #[serde(default)]
    pub layout: LayoutChoice,
    pub compute: Stage,
}

/// Resources of a WebGL draw, by name.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(default)]
#[allow(missing_docs)]
pub struct Named {
    #[serde(deserialize_with = "with_nan")]
    pub uniforms: BTreeMap<String, Vec<f64>>,
    pub blocks: BTreeMap<String, BufferRange>,
    pub textures: BTreeMap<String, OneOrMore>,
    #[serde(deserialize_with = "with_nan")]
    pub constants: BTreeMap<String, Vec<f64>>,
}

/// Reads `null` as NaN, which JSON lacks.
fn with_nan<'de, D: serde::Deserializer<'de>>(
    from: D,
) -> Result<BTreeMap<String, Vec<f64>>, D::Error> {
    let lists = BTreeMap::<String, Vec<Option<f64>>>::deserialize(from)?;
    let list = |list: Vec<Option<f64>>| list.into_iter().map(|n| n.unwrap_or(f64::NAN)).collect();
    Ok(lists.into_iter().map(|(name, l)| (name, list(l))).collect())
}

/// A texture of WebGL with its sampler, or an array of them.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(untagged)]
#[allow(missing_docs)]
pub enum OneOrMore {
    One(SampledTexture),
    More(Vec<SampledTexture>),
}

impl OneOrMore {
    /// One texture, or all of an array.
    pub fn all(&self) -> &[SampledTexture] {
        match self {
            Self::One(one) => std::slice::from_ref(one),
            Self::More(more) => more,
        }
    }
}

/// A texture of WebGL with its sampler.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct SampledTexture {
    #[serde(flatten)]
    pub texture: View,
    pub sampler: usize,
}

/// Content before the first frame.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(default)]
#[allow(missing_docs)]
pub struct Start {
    pub buffers: Vec<StartBuffer>,
    pub textures: Vec<StartTexture>,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct StartBuffer {
    pub buffer: usize,
    pub data: DataName,
}

/// Content of one level of a texture: all of its layers, or one.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct StartTexture {
    pub texture: usize,
    #[serde(default)]
    pub mip_level: u32,
    pub layer: Option<u32>,
    #[serde(default)]
    pub aspect: Option<wgpu::TextureAspect>,
    pub data: DataName,
}

/// Content that could not be read, or that the page computed and a replay does not compute.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct Unknown {
    pub buffer: Option<usize>,
    pub texture: Option<usize>,
    pub aspect: Option<wgpu::TextureAspect>,
    /// Whether the capture has the content that the page computed.
    #[serde(default)]
    pub as_captured: bool,
    pub why: String,
}

impl Unknown {
    /// Whether only the stencil is unknown.
    pub fn is_stencil(&self) -> bool {
        self.aspect == Some(wgpu::TextureAspect::StencilOnly)
    }
}

/// A call or feature that the recorder left out.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct Refused {
    pub what: String,
    pub why: String,
    #[serde(default = "once")]
    pub count: u64,
}

fn once() -> u64 {
    1
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct CapturedFrame {
    #[serde(default)]
    pub time: f64,
    pub size: [u32; 2],
    pub canvas: Option<usize>,
    #[serde(default, rename = "alphaMode", skip_serializing_if = "Option::is_none")]
    pub alpha_mode: Option<AlphaMode>,
    pub commands: Vec<Command>,
    pub picture: Option<Picture>,
}

/// How the alpha of a canvas affects the page's picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum AlphaMode {
    /// Alpha is ignored, as if it were 1.
    Opaque,
    /// Colours are already multiplied by alpha.
    Premultiplied,
    /// The compositor multiplies colours by alpha.
    Postmultiplied,
}

/// The picture that the page showed, top row first.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct Picture {
    pub data: DataName,
    pub format: wgpu::TextureFormat,
    pub size: [u32; 2],
}

/// One side of a copy: a texture.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct TexelPlace {
    pub texture: usize,
    #[serde(default)]
    pub mip_level: u32,
    #[serde(default)]
    pub origin: Origin,
    #[serde(default)]
    pub aspect: Option<wgpu::TextureAspect>,
}

/// The layout of texels in a buffer.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize)]
#[serde(rename_all = "camelCase", default)]
#[allow(missing_docs)]
pub struct TexelLayout {
    pub offset: u64,
    pub bytes_per_row: Option<u32>,
    pub rows_per_image: Option<u32>,
}

impl TexelLayout {
    /// Converts to wgpu's type.
    pub fn wgpu(self) -> wgpu::TexelCopyBufferLayout {
        wgpu::TexelCopyBufferLayout {
            offset: self.offset,
            bytes_per_row: self.bytes_per_row,
            rows_per_image: self.rows_per_image,
        }
    }
}

/// One side of a copy: a buffer.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct BufferPlace {
    pub buffer: usize,
    #[serde(flatten)]
    pub layout: TexelLayout,
}

/// A command of the queue.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(tag = "do", rename_all = "camelCase", rename_all_fields = "camelCase")]
#[allow(missing_docs)]
pub enum Command {
    WriteBuffer {
        buffer: usize,
        #[serde(default)]
        offset: u64,
        data: DataName,
    },
    WriteTexture {
        destination: TexelPlace,
        data: DataName,
        #[serde(default)]
        layout: TexelLayout,
        size: Extent,
    },
    CopyBufferToBuffer {
        source: usize,
        #[serde(default)]
        source_offset: u64,
        destination: usize,
        #[serde(default)]
        destination_offset: u64,
        size: Option<u64>,
    },
    CopyBufferToTexture {
        source: BufferPlace,
        destination: TexelPlace,
        size: Extent,
    },
    CopyTextureToBuffer {
        source: TexelPlace,
        destination: BufferPlace,
        size: Extent,
    },
    CopyTextureToTexture {
        source: TexelPlace,
        destination: TexelPlace,
        size: Extent,
    },
    /// WebGL's blit of depth only, or of a multisampled texture: the first sample counts. The
    /// stencil stays unchanged.
    CopyDepth {
        source: TexelPlace,
        destination: TexelPlace,
        size: Extent,
    },
    ClearBuffer {
        buffer: usize,
        #[serde(default)]
        offset: u64,
        size: Option<u64>,
    },
    RenderPass {
        descriptor: RenderPassDescriptor,
        commands: Vec<DrawCommand>,
    },
    ComputePass {
        #[serde(default)]
        label: String,
        commands: Vec<ComputeCommand>,
    },
}

/// A `GPURenderPassDescriptor`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct RenderPassDescriptor {
    #[serde(default)]
    pub label: String,
    #[serde(default)]
    pub color_attachments: Vec<Option<ColorAttachment>>,
    pub depth_stencil_attachment: Option<DepthAttachment>,
}

/// How a pass initialises an attachment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum Load {
    #[default]
    Load,
    Clear,
}

/// Whether a pass keeps an attachment's content at its end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum Store {
    #[default]
    Store,
    Discard,
}

impl Store {
    /// Converts to wgpu's type.
    pub fn wgpu(self) -> wgpu::StoreOp {
        match self {
            Self::Store => wgpu::StoreOp::Store,
            Self::Discard => wgpu::StoreOp::Discard,
        }
    }
}

/// A `GPURenderPassColorAttachment`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct ColorAttachment {
    pub view: View,
    pub depth_slice: Option<u32>,
    pub resolve_target: Option<View>,
    #[serde(default)]
    pub load_op: Load,
    #[serde(default)]
    pub store_op: Store,
    pub clear_value: Option<Color>,
}

/// A `GPURenderPassDepthStencilAttachment`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "camelCase")]
#[allow(missing_docs)]
pub struct DepthAttachment {
    pub view: View,
    pub depth_load_op: Option<Load>,
    pub depth_store_op: Option<Store>,
    pub depth_clear_value: Option<f32>,
    #[serde(default)]
    pub depth_read_only: bool,
    pub stencil_load_op: Option<Load>,
    pub stencil_store_op: Option<Store>,
    #[serde(default)]
    pub stencil_clear_value: u32,
    #[serde(default)]
    pub stencil_read_only: bool,
}

/// A command in a render pass.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(tag = "do", rename_all = "camelCase", rename_all_fields = "camelCase")]
#[allow(missing_docs)]
pub enum DrawCommand {
    SetPipeline {
        pipeline: usize,
    },
    SetBindGroup {
        index: u32,
        bind_group: Option<usize>,
        #[serde(default)]
        dynamic_offsets: Vec<u32>,
    },
    SetNamed {
        named: usize,
    },
    SetVertexBuffer {
        slot: u32,
        buffer: Option<usize>,
        #[serde(default)]
        offset: u64,
        size: Option<u64>,
    },
    SetIndexBuffer {
        buffer: usize,
        index_format: IndexFormat,
        #[serde(default)]
        offset: u64,
        size: Option<u64>,
    },
    Draw {
        vertex_count: u32,
        #[serde(default = "one")]
        instance_count: u32,
        #[serde(default)]
        first_vertex: u32,
        #[serde(default)]
        first_instance: u32,
    },
    DrawIndexed {
        index_count: u32,
        #[serde(default = "one")]
        instance_count: u32,
        #[serde(default)]
        first_index: u32,
        #[serde(default)]
        base_vertex: i32,
        #[serde(default)]
        first_instance: u32,
    },
    DrawIndirect {
        buffer: usize,
        #[serde(default)]
        offset: u64,
    },
    DrawIndexedIndirect {
        buffer: usize,
        #[serde(default)]
        offset: u64,
    },
    SetViewport {
        x: f32,
        y: f32,
        width: f32,
        height: f32,
        #[serde(default)]
        min_depth: f32,
        #[serde(default = "far")]
        max_depth: f32,
    },
    SetScissorRect {
        x: u32,
        y: u32,
        width: u32,
        height: u32,
    },
    SetBlendConstant {
        color: Color,
    },
    SetStencilReference {
        reference: u32,
    },
    Clear(Clear),
}

/// A clear of a part of the targets. It leaves out each value that is `None`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct Clear {
    pub color: Option<[f64; 4]>,
    /// Per colour target, whether it is cleared. Empty: all of them.
    #[serde(default)]
    pub colors: Vec<bool>,
    pub depth: Option<f32>,
    pub stencil: Option<u32>,
    #[serde(default)]
    pub mask: ClearMask,
    pub scissor: Option<[u32; 4]>,
}

/// The bits that a clear writes.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[allow(missing_docs)]
pub struct ClearMask {
    #[serde(default = "every_channel")]
    pub color: u32,
    #[serde(default = "every_bit")]
    pub stencil: u32,
}

impl Default for ClearMask {
    fn default() -> Self {
        Self {
            color: every_channel(),
            stencil: every_bit(),
        }
    }
}

fn far() -> f32 {
    1.0
}

/// A command in a compute pass.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(tag = "do", rename_all = "camelCase", rename_all_fields = "camelCase")]
#[allow(missing_docs)]
pub enum ComputeCommand {
    SetPipeline {
        pipeline: usize,
    },
    SetBindGroup {
        index: u32,
        bind_group: Option<usize>,
        #[serde(default)]
        dynamic_offsets: Vec<u32>,
    },
    DispatchWorkgroups {
        x: u32,
        #[serde(default = "one")]
        y: u32,
        #[serde(default = "one")]
        z: u32,
    },
    DispatchWorkgroupsIndirect {
        buffer: usize,
        #[serde(default)]
        offset: u64,
    },
}
