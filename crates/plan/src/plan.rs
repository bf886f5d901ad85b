//! A plan: the host's instructions and the programs they use. Every transform maps a plan to a
//! plan.
//!
//! A plan is emitted as `MATERIAL.plan.json`, in one folder with the shaders ([`Plan`] without its
//! programs is that file's data), and preshade's own renderer executes exactly that data.

use std::collections::BTreeMap;
use std::sync::Arc;

use naga::ShaderStage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shader_text::source::Location;

use crate::contract::{Assumption, Contract};
use crate::geometry::{Formats, Geometry};
use crate::guard::Guard;
use crate::program::Program;
use crate::state::{
    ColorTarget, CompareFunction, DepthDirection, DepthFormat, DepthState, Multisample,
    PrimitiveState, StencilState,
};

/// Version of the JSON that [`Plan`] serialises to.
pub const SCHEMA: &str = "preshade.plan.v1";

/// The [`Plan::fallback`] to the material as its author wrote it.
pub const ORIGINAL: &str = "original";

/// The pass that moves work to the vertices. Other code finds its step in a plan by this name.
pub const HOIST: &str = "hoist";

/// Name of the depth attachment that all main passes of a frame share.
pub const SCENE_DEPTH: &str = "scene-depth";
/// Name of the first colour attachment; target `i` after it is `scene-color-i`.
pub const SCENE_COLOR: &str = "scene-color";

/// Name of the depth attachment of a [`SelfTest`].
pub(crate) const SELF_TEST_DEPTH: &str = "self-test-depth";

/// The purpose of a GPU pass. The name is part of the emitted file's name.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// Depth only, before any main pass.
    Prepass,
    /// The material's own pass.
    Main,
    /// Depth only, under a light's view.
    Shadow,
    /// Auxiliary pictures of the material: normals, velocities, ids.
    Outputs,
    /// Depth, and the id of the nearest triangle: no shading.
    Ids,
    /// Once per frame: the number of the draw that each pixel shows, as a depth to compare with.
    Classify,
    /// Shades each pixel of the material once, from the ids.
    Resolve,
    /// Once per frame: draws nothing, but clears the scene's colour for compute work.
    Clear,
    /// Values of the fragment stage, for one pixel of each 2x2.
    HalfRate,
}

impl Role {
    /// Its word in file names and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Prepass => "prepass",
            Self::Main => "main",
            Self::Shadow => "shadow",
            Self::Outputs => "outputs",
            Self::Ids => "ids",
            Self::Classify => "classify",
            Self::Resolve => "resolve",
            Self::Clear => "clear",
            Self::HalfRate => "half-rate",
        }
    }

    /// Whether it writes the material's own shading to the scene's colour.
    pub fn shades(self) -> bool {
        matches!(self, Self::Main | Self::Resolve)
    }
}

/// When in the frame a pass runs. A phase of one material never starts before the earlier phases of
/// all of them ended.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Phase {
    /// Shadow maps: the host's light view, outside the camera's frame.
    Shadow,
    /// Auxiliary pictures of the camera's view, with a depth of their own. The host draws them when
    /// it needs them, outside the plan's frame.
    Outputs,
    /// Values at a lower rate than the pixels', without depth.
    HalfRate,
    /// Opaque draws, depth or ids only.
    Depth,
    /// Finds the material of each pixel, over all materials.
    Classify,
    /// Shading from ids. Opaque draws with ordinary shading come afterwards, tested against the
    /// same depth.
    Resolve,
    /// Shaded opaque draws.
    Opaque,
    /// Blended draws, last, in the host's order.
    Blended,
}

impl Phase {
    /// Whether its passes belong to the camera's frame. The host draws the others by themselves.
    pub fn is_of_frame(self) -> bool {
        !matches!(self, Self::Shadow | Self::Outputs)
    }
}

/// Format of an attachment, in WebGPU's spelling.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum AttachmentFormat {
    /// A depth format.
    Depth(DepthFormat),
    /// A colour format, `rgba8unorm` say.
    Color(String),
}

impl AttachmentFormat {
    /// The depth format, if it is one.
    pub fn depth(&self) -> Option<DepthFormat> {
        match self {
            Self::Depth(format) => Some(*format),
            Self::Color(_) => None,
        }
    }
}

/// The clear value of an attachment.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum ClearValue {
    /// A depth in `[0, 1]`. A stencil aspect is cleared to 0.
    Depth(f32),
    /// Red, green, blue and alpha.
    Color([f64; 4]),
}

/// A texture that passes write or read. Its size and origin follow the host's colour attachment; a
/// shader indexes it by `position.xy`, mip 0, layer 0.
///
/// With a divisor above 1 it has a texel for each square of so many pixels, and stands for the first
/// of them, the one with the smallest coordinates. So a pass that draws to it has the host's viewport,
/// scaled and moved: along each axis, `v` becomes `v / n + 0.5 - 0.5 / n` for its origin, and `v / n`
/// for its size, fractions included. Then the centre of a texel is the centre of its pixel. A scissor
/// rectangle is divided, and rounded outwards.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Attachment {
    /// The name passes refer to.
    pub name: String,
    /// Format.
    pub format: AttachmentFormat,
    /// Samples a pixel.
    pub samples: u32,
    /// Whether some pass binds it as a texture.
    pub sampled: bool,
    /// The clear value for the first pass of a frame that draws to it.
    pub clear: ClearValue,
    /// Its width and height are the host's, divided by this number and rounded up.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    #[schemars(range(min = 1))]
    pub divisor: u32,
}

fn one() -> u32 {
    1
}

fn is_one(divisor: &u32) -> bool {
    *divisor == 1
}

impl Attachment {
    /// A depth attachment, cleared to the far plane.
    pub fn depth(
        name: impl Into<String>,
        format: DepthFormat,
        direction: DepthDirection,
        samples: u32,
    ) -> Self {
        let clear = ClearValue::Depth(direction.clear_depth());
        Self {
            samples,
            ..Self::new(name.into(), AttachmentFormat::Depth(format), clear)
        }
    }

    /// A colour attachment of one sample that a later pass samples.
    pub fn color(name: impl Into<String>, format: impl Into<String>, clear: [f64; 4]) -> Self {
        let format = AttachmentFormat::Color(format.into());
        Self {
            sampled: true,
            ..Self::new(name.into(), format, ClearValue::Color(clear))
        }
    }

    fn new(name: String, format: AttachmentFormat, clear: ClearValue) -> Self {
        Self {
            name,
            format,
            samples: 1,
            sampled: false,
            clear,
            divisor: 1,
        }
    }

    /// Whether two materials may share it. Each may sample it or not.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        let sampled = other.sampled;
        Self {
            sampled,
            ..self.clone()
        } == *other
    }

    /// Its properties, for messages.
    pub(crate) fn description(&self) -> String {
        let size = match self.divisor {
            1 => String::new(),
            n => format!(", of 1/{n} of the size"),
        };
        let (format, samples, clear) = (&self.format, self.samples, self.clear);
        format!("{format:?} x{samples}, cleared to {clear:?}{size}").to_lowercase()
    }

    /// Its size for a host's colour attachment of this one: width and height in pixels.
    pub fn size(&self, host: [u32; 2]) -> [u32; 2] {
        host.map(|length| length.div_ceil(self.divisor.max(1)))
    }
}

/// The source of a binding's resource.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "from")]
pub enum BindingSource {
    /// The author's own resource of that group and binding.
    Author,
    /// The whole of an attachment that an earlier pass of the plan wrote.
    Attachment {
        /// Name of the attachment.
        name: String,
    },
    /// The scene's own colour of a location, as a storage texture: it needs the usage
    /// `STORAGE_BINDING` beside `RENDER_ATTACHMENT`. Where the targets' format is an `-srgb` one,
    /// the texture has the format without it, as the layout states, and is drawn to through a view
    /// in the targets' format (`viewFormats`): stored values are already encoded.
    SceneColor {
        /// Location.
        location: u32,
    },
    /// The draw's own geometry, for a pass that subdivides it ([`crate::geometry`]) or shades
    /// it from ids ([`crate::draw_table`]).
    Geometry {
        /// The part of it.
        part: GeometryPart,
    },
    /// The content that an author's resource had when the previous frame was drawn. In the first
    /// frame, bind the current content.
    Previous {
        /// The author's variable.
        of: String,
        /// Its group; `None` for immediate data, whose bytes go into this uniform buffer.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        group: Option<u32>,
        /// Its binding.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        binding: Option<u32>,
    },
    /// A resource of another view than the author's, as the parameter `map` of `outputs` says.
    View {
        /// The variable's name in the mapping or the layout.
        name: String,
    },
    /// A uniform buffer that only the host can fill.
    Host {
        /// What to put into it.
        value: HostValue,
    },
}

/// The content of a uniform buffer that the host fills.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum HostValue {
    /// One `u32`: the number of the draw. 0 is the value of pixels without a draw, so number draws
    /// from 1.
    DrawId,
    /// Four `f32`: position of a point light in the space that the plan names, and its range.
    PointLight,
}

/// A part of a draw's geometry, as a buffer for shaders.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum GeometryPart {
    /// A uniform buffer of the draw's constants ([`crate::geometry::Constants`]).
    Constants {
        /// Locations of its attributes, in order.
        streams: Vec<u32>,
    },
    /// [`crate::geometry::Subdivision::vertices`], four bytes each.
    Pattern,
    /// The points of the draw's subdivided mesh, sixteen bytes each.
    Points,
    /// The new vertices of the draw, one of the plan's [`VertexBuffer`]s.
    Vertices {
        /// Name of the buffer.
        buffer: String,
    },
    /// The values that a compute pass made of the draw's uniforms, one of the plan's [`DrawBuffer`]s.
    Values {
        /// Name of the buffer.
        buffer: String,
    },
    /// The draw's index buffer, which needs the usage `STORAGE` beside `INDEX`; without one, any
    /// buffer. For a strip, the list of its triangles
    /// ([`crate::geometry::Subdivision::given`]).
    Indices,
    /// The vertex buffer that holds an attribute. It needs the usage `STORAGE` beside `VERTEX`.
    Attribute(AttributeUse),
    /// A uniform buffer of the draw's entry in the frame's draw table
    /// ([`crate::draw_table::Entry`]).
    Draw {
        /// Locations of its attributes, in order.
        streams: Vec<u32>,
        /// Formats that these attributes may have.
        formats: Formats,
    },
    /// A buffer of the frame, one of the plan's [`FrameBuffer`]s.
    Frame {
        /// Name of the buffer.
        buffer: String,
    },
    /// The frame's draw table: the bits of a triangle, then the first id of each draw, ascending,
    /// four bytes each ([`crate::draw_table::table`]).
    DrawTable,
}

/// The kind of a binding's resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum BindingKind {
    Uniform,
    StorageRead,
    StorageReadWrite,
    Sampler,
    ComparisonSampler,
    Texture,
    DepthTexture,
    StorageTexture,
    AccelerationStructure,
}

impl BindingKind {
    /// Whether a shader may write the resource.
    pub fn is_writable(self) -> bool {
        matches!(self, Self::StorageReadWrite | Self::StorageTexture)
    }
}

/// Stages a binding must be visible to (`GPUShaderStage`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[allow(missing_docs)]
pub struct Visibility {
    pub vertex: bool,
    pub fragment: bool,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub compute: bool,
}

/// A binding that a pass's entry points use.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct BindingUse {
    /// `@group`.
    pub group: u32,
    /// `@binding`.
    pub binding: u32,
    /// The variable's name in the emitted module. If each stage has a variable of its own here, the
    /// larger one's.
    pub name: String,
    /// The kind of its resource.
    pub kind: BindingKind,
    /// Stages that use it in this pass.
    pub visibility: Visibility,
    /// Where its resource comes from.
    pub source: BindingSource,
    /// The rest of its `GPUBindGroupLayoutEntry`. `None` where WebGPU has no entry (acceleration
    /// structures, external textures).
    #[serde(default)]
    pub layout: Option<BindingLayout>,
}

impl BindingUse {
    /// A binding at a group and a number. [`fill`](crate::reflect::fill) adds the rest.
    pub fn new([group, binding]: [u32; 2], kind: BindingKind, source: BindingSource) -> Self {
        Self {
            group,
            binding,
            name: String::new(),
            kind,
            visibility: Visibility::default(),
            source,
            layout: None,
        }
    }
}

/// The bind group layout entry of a binding, in WebGPU's words, without its visibility.
///
/// A host uses it as it is, with one relaxation, because the plan can't know the format of an
/// author's texture. If that format can't be filtered (`r32float`, say, without the feature
/// `float32-filterable`; several samples; a depth format bound as float), the host replaces `float`
/// by `unfilterable-float`, and `filtering` by `non-filtering` for every sampler that the shader
/// samples it with.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum BindingLayout {
    /// `GPUBufferBindingLayout`.
    Buffer {
        /// `uniform`, `storage` or `read-only-storage`.
        #[serde(rename = "type")]
        ty: String,
        /// `minBindingSize` in bytes: the declared size, with one element for a runtime-sized
        /// array.
        min_binding_size: u64,
    },
    /// `GPUSamplerBindingLayout`.
    Sampler {
        /// `filtering`, `non-filtering` or `comparison`. A sampler that a shader of the material
        /// samples a depth texture with, without a comparison, is `non-filtering`.
        #[serde(rename = "type")]
        ty: String,
    },
    /// `GPUTextureBindingLayout`.
    Texture {
        /// `float`, `unfilterable-float`, `depth`, `sint` or `uint`. An author's float texture of
        /// one sample is assumed to be filterable.
        sample_type: String,
        /// `1d`, `2d`, `2d-array`, `cube`, `cube-array` or `3d`.
        view_dimension: String,
        /// Whether it has several samples a texel.
        multisampled: bool,
    },
    /// `GPUStorageTextureBindingLayout`.
    StorageTexture {
        /// `write-only`, `read-only`, `read-write` or, in wgpu only, `atomic`.
        access: String,
        /// Format in WGSL's spelling.
        format: String,
        /// As for a texture.
        view_dimension: String,
    },
}

impl BindingLayout {
    /// The layout of a sampler that filters nothing.
    pub fn non_filtering() -> Self {
        let ty = "non-filtering".to_owned();
        Self::Sampler { ty }
    }
}

/// A vertex attribute that a pass reads.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct AttributeUse {
    /// `@location`.
    pub location: u32,
    /// The author's name for it.
    pub name: String,
    /// WGSL type, `vec3<f32>` say.
    #[serde(rename = "type")]
    pub ty: String,
    /// The location of the author's attribute of which this one has the previous frame's values.
    /// `None`: it is the author's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub previous_of: Option<u32>,
}

/// The material's draws that a pass includes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Draws {
    /// All of them.
    #[default]
    All,
    /// The opaque ones only.
    Opaque,
    /// None: once per frame. If several plans have an identical such pass, it runs once.
    Once,
}

impl Draws {
    /// Whether all draws are included.
    pub fn is_all(&self) -> bool {
        *self == Self::All
    }
}

/// One GPU pass of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GpuPass {
    /// Its purpose.
    pub role: Role,
    /// When it runs.
    pub phase: Phase,
    /// Key of its program in [`Plan::programs`], and the `ROLE` of the emitted file's name.
    pub program: String,
    /// Vertex entry point.
    pub vertex: String,
    /// Fragment entry point; `None` draws depth only.
    pub fragment: Option<String>,
    /// Primitive state.
    pub primitive: PrimitiveState,
    /// Depth state; `None` binds no depth attachment.
    pub depth: Option<DepthState>,
    /// Stencil state.
    pub stencil: Option<StencilState>,
    /// Multisampling.
    pub multisample: Multisample,
    /// Colour targets.
    pub targets: Vec<Option<ColorTarget>>,
    /// Bindings its entry points use.
    pub bindings: Vec<BindingUse>,
    /// Vertex attributes its vertex entry point reads.
    pub attributes: Vec<AttributeUse>,
    /// Features it needs, in WebGPU's spelling or, where WebGPU has none, in wgpu's:
    /// `wgpu-vertex-writable-storage`.
    pub features: Vec<String>,
    /// WebGPU limits it needs above their defaults, by WebGPU's name. The host's own additional
    /// bindings aren't counted.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub limits: BTreeMap<String, u64>,
    /// Draws included.
    pub draws: Draws,
    /// The geometry it draws for them.
    #[serde(default, skip_serializing_if = "Geometry::is_as_given")]
    pub geometry: Geometry,
    /// Uniforms this pass must read from another view than the camera's (the light's, for a shadow
    /// pass): variable or member names.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub view_dependent: Vec<String>,
    /// What the pass leaves out of the author's decisions about coverage: what depends on the viewer,
    /// and alpha to coverage or blending where a test of alpha takes their place.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
}

impl GpuPass {
    /// The entry points that the pass draws with.
    pub fn stages(&self) -> Vec<(ShaderStage, &str)> {
        let fragment = self.fragment.as_deref();
        let vertex = (ShaderStage::Vertex, self.vertex.as_str());
        let fragment = fragment.map(|name| (ShaderStage::Fragment, name));
        std::iter::once(vertex).chain(fragment).collect()
    }
}

/// A buffer of computed vertices, one for each draw of the material.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct VertexBuffer {
    /// The name passes refer to.
    pub name: String,
    /// Bytes per vertex. For each instance, a draw has as many as its subdivided mesh or, without
    /// subdivision, its vertex buffers.
    pub stride: u32,
}

/// A buffer of values that a compute pass makes for a draw, one for each draw of the material. It
/// needs the usages `STORAGE` and `UNIFORM`. A draw's compute and render passes bind the same one, and
/// no other draw may bind it in between.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct DrawBuffer {
    /// The name passes refer to.
    pub name: String,
    /// Bytes.
    pub size: u32,
}

/// A buffer that the compute passes of a frame fill for later passes. There is one per frame,
/// shared by all plans that name it. Its words are 0 at the start of a frame. It needs the usage
/// `STORAGE`, and `INDIRECT` if it holds arguments.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct FrameBuffer {
    /// The name passes refer to.
    pub name: String,
    /// The kind of its words.
    pub holds: FrameWords,
}

/// The kind of words in a frame's buffer. Draws, instances and their order are those of the draw
/// table ([`crate::draw_table`]); pixels are those of the scene's colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FrameWords {
    /// Eight per draw, of which the first four are arguments of an indirect call, and eight more
    /// behind them.
    Draws,
    /// One per draw and square of 8x8 pixels.
    Tiles,
    /// One per instance.
    Instances,
    /// One per pixel.
    Pixels,
}

impl FrameWords {
    /// The number of words for a frame of these draws, instances and pixels (width and height).
    pub fn count(self, draws: u64, instances: u64, [width, height]: [u32; 2]) -> u64 {
        match self {
            Self::Draws => (draws + 1) * 8,
            Self::Tiles => draws * u64::from(width.div_ceil(8)) * u64::from(height.div_ceil(8)),
            Self::Instances => instances,
            Self::Pixels => u64::from(width) * u64::from(height),
        }
    }
}

/// When a compute pass runs.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum When {
    /// Before the render passes of each frame.
    #[default]
    Frame,
    /// Once, when the variant and its meshes are loaded.
    Load {
        /// Its inputs, which may not change: uniforms, or members of them, by name. The vertex
        /// buffers may not change either. A host that changes any runs the pass again.
        fixed: Vec<String>,
    },
    /// In each frame after this phase's render passes, over all materials.
    Behind {
        /// The phase.
        phase: Phase,
    },
}

impl When {
    /// Whether it runs before each frame's render passes.
    pub fn is_frame(&self) -> bool {
        *self == Self::Frame
    }

    /// The phase that it runs after.
    pub fn phase(&self) -> Option<Phase> {
        match self {
            Self::Behind { phase } => Some(*phase),
            Self::Frame | Self::Load { .. } => None,
        }
    }
}

/// Compute work before a frame's render passes, or between them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ComputePass {
    /// Key of its program in [`Plan::programs`].
    pub program: String,
    /// Entry point.
    pub entry_point: String,
    /// Invocations of one workgroup. By default a draw needs one invocation per new vertex and
    /// instance; workgroups that don't fit into `x` continue in `y`. For `full-screen` and
    /// `indirect` geometry it is the side of a square workgroup: a draw needs one invocation per
    /// pixel of the scene's colour, or the workgroup count of its entry. For `instances` and
    /// `vertices`, a draw needs one invocation per instance, or per vertex of each instance, in
    /// rows as for new vertices. For `draw`, it needs one workgroup.
    pub workgroup: u32,
    /// Its domain: new vertices, the pixels of the screen, instances, the draw itself, or the count
    /// in a frame's buffer.
    pub geometry: Geometry,
    /// The draws that it runs for.
    #[serde(default, skip_serializing_if = "Draws::is_all")]
    pub draws: Draws,
    /// The bindings of its entry point; their stage is the compute stage.
    pub bindings: Vec<BindingUse>,
    /// When it runs.
    #[serde(default, skip_serializing_if = "When::is_frame")]
    pub when: When,
    /// WebGPU features it needs, as for a [`GpuPass`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub features: Vec<String>,
    /// WebGPU limits it needs above their defaults, as for a [`GpuPass`].
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub limits: BTreeMap<String, u64>,
}

impl ComputePass {
    /// A pass for all draws of each frame, without bindings. `program` and `entry_point` name its
    /// code.
    pub fn new(
        program: impl Into<String>,
        entry_point: impl Into<String>,
        workgroup: u32,
        geometry: Geometry,
    ) -> Self {
        Self {
            program: program.into(),
            entry_point: entry_point.into(),
            workgroup,
            geometry,
            draws: Draws::All,
            bindings: Vec::new(),
            when: When::Frame,
            features: Vec::new(),
            limits: BTreeMap::new(),
        }
    }
}

/// The code that a pass changes. The name is stable: it holds no arena handle.
#[derive(
    Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
pub struct Site {
    /// Role of the GPU pass.
    pub role: Role,
    /// Entry point.
    pub entry_point: String,
    /// Hash of the canonical slice, 16 hex digits.
    pub slice: String,
}

/// One change that a pass made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Change {
    /// The code it changed.
    pub key: Site,
    /// A description for people.
    pub what: String,
    /// Position in the author's source.
    pub location: Option<Location>,
    /// Static cost of the slice and of the stage that it was cut from.
    pub cost: SiteCost,
}

/// Static cost estimate of a change, in the units of `preshade_dataflow::graph`'s cost model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SiteCost {
    /// Cost of the slice.
    pub slice: f64,
    /// Cost of the stage it comes from.
    pub whole: f64,
}

/// An applied step of the recipe.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Step {
    /// Pass name.
    pub pass: String,
    /// Where.
    pub site: Site,
    /// Parameters in full, defaults included.
    pub params: serde_json::Value,
    /// Its promise.
    pub contract: Contract,
}

impl std::fmt::Display for Step {
    /// As on the command line: `NAME:key=value,key=value`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.pass)?;
        let params = self.params.as_object().into_iter().flatten();
        for (i, (key, value)) in params.filter(|(_, v)| !v.is_null()).enumerate() {
            let separator = if i == 0 { ':' } else { ',' };
            match value.as_str() {
                Some(word) => write!(f, "{separator}{key}={word}")?,
                None => write!(f, "{separator}{key}={value}")?,
            }
        }
        Ok(())
    }
}

/// Draws that a host makes when it loads the variant. Invariance is a promise of the driver that no
/// source can prove. If a draw has an unexpected result, the host uses [`Plan::fallback`].
///
/// A host runs it on draws of this material alone, the same ones each time, with uniforms as in a
/// frame: all of them from one camera, or one mesh.
///
/// 1. For each run, clear every depth attachment that its draws name to its clear value (stencil to
///    0). [`Self::attachment`] is made for the test.
/// 2. Draw the run's draws in order, each in a render pass and an occlusion query of its own, as
///    the pass of that role. Use the draw's attachment, comparison and depth write in place of the
///    pass's, and no stencil test. All else is the pass's: program, primitive state, bias,
///    multisampling, bindings and colour targets. The targets' contents have no meaning, but
///    without them a driver may compile another vertex stage.
/// 3. Compare each query with [`SelfTestDraw::samples`].
///
/// Queries need not count: WebGPU and WebGL promise only whether a sample passed, and we use
/// nothing else. Under MSAA that is any sample of a pixel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SelfTest {
    /// Depth attachment of the test, like the main pass's.
    pub attachment: Attachment,
    /// All of them must pass.
    pub runs: Vec<SelfTestRun>,
}

/// Draws one after the other, each in a render pass of its own.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SelfTestRun {
    /// The fault, if samples pass unexpectedly, for a message.
    pub failure: String,
    /// In order.
    pub draws: Vec<SelfTestDraw>,
}

/// One draw of a self-test.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SelfTestDraw {
    /// The pass to draw as: the plan's, or the original's if the plan has no pass of that role.
    pub role: Role,
    /// Draw as the original's pass, even if the plan has one of that role.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub original: bool,
    /// Name of the depth attachment: [`SELF_TEST_DEPTH`], or one of the plan's.
    pub attachment: String,
    /// Depth comparison.
    pub compare: CompareFunction,
    /// Whether depth is written.
    pub write: bool,
    /// The expected result of its occlusion query.
    pub samples: SamplesPassed,
}

/// Result of an occlusion query.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SamplesPassed {
    /// At least one. If there is none, nothing was in view and the run proves nothing.
    Some,
    /// None. Any sample is a failure.
    None,
}

/// The plan of one material.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Plan {
    /// Always [`SCHEMA`].
    pub schema: String,
    /// Name of the material.
    pub material: String,
    /// Programs by key. Not part of the JSON: they are emitted as text, named `MATERIAL.KEY.wgsl`
    /// and so on.
    #[serde(skip)]
    pub programs: BTreeMap<String, Program>,
    /// Attachments, the scene's depth first. The host owns the scene's colour, which isn't listed.
    pub attachments: Vec<Attachment>,
    /// Buffers of computed vertices.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub vertex_buffers: Vec<VertexBuffer>,
    /// Buffers of values, one for each draw.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub draw_buffers: Vec<DrawBuffer>,
    /// Buffers of the frame.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub frame_buffers: Vec<FrameBuffer>,
    /// Compute work, for each draw of the material.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub compute: Vec<ComputePass>,
    /// GPU passes in the order they run.
    pub passes: Vec<GpuPass>,
    /// The applied steps, in order.
    pub steps: Vec<Step>,
    /// The promise of the whole.
    pub contract: Contract,
    /// A check for the host to run at load.
    pub self_test: Option<SelfTest>,
    /// The replacement if the self-test fails: [`ORIGINAL`], whose pass and files are in
    /// `plan.json`, or a recipe.
    pub fallback: Option<String>,
    /// The values it was made for. If a draw's values differ, the host draws [`ORIGINAL`] instead.
    /// `None` if it was made for all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub guard: Option<Guard>,
    /// The plan before any transform, for the fallback to it. `None` in that plan itself, and in a
    /// plan read from JSON, which contains its passes and files.
    #[serde(skip)]
    pub original: Option<Arc<Plan>>,
    /// Things the host should know that are not requirements.
    pub notes: Vec<String>,
}

impl Plan {
    /// Adds a step of the pass `name`, with its promise and a note on its change.
    pub fn add_step(
        &mut self,
        name: &str,
        params: &impl Serialize,
        change: &Change,
        contract: Contract,
    ) {
        self.notes.push(change.what.clone());
        self.steps.push(Step {
            pass: name.to_owned(),
            site: change.key.clone(),
            params: serde_json::to_value(params).unwrap_or_default(),
            contract: contract.clone(),
        });
        self.contract = self.contract.clone().and(contract);
    }

    /// Restricts the plan to draws whose values also match a guard. Adds that to the assumptions of
    /// a step.
    pub fn assume(&mut self, guard: Option<Guard>, given: &mut Vec<Assumption>) {
        let Some(guard) = guard else { return };
        self.guard = Some(self.guard.take().unwrap_or_default().and(guard));
        given.push(Assumption::ValuesOfTheGuard);
        given.sort();
        given.dedup();
    }

    pub fn main(&self) -> Option<&GpuPass> {
        self.passes.iter().find(|p| p.role == Role::Main)
    }

    /// The program a pass draws with.
    pub fn program(&self, pass: &GpuPass) -> Option<&Program> {
        self.programs.get(&pass.program)
    }

    /// Format of the depth attachment of that name.
    pub fn depth_format(&self, name: &str) -> Option<DepthFormat> {
        self.attachment(name)?.format.depth()
    }

    pub fn attachment(&self, name: &str) -> Option<&Attachment> {
        self.attachments.iter().find(|a| a.name == name)
    }
}
