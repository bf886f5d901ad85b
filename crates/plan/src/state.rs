//! Pipeline state that a shader can't express. Names and values are WebGPU's, in its own spelling,
//! so a plan reads like a `GPURenderPipelineDescriptor`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// WebGPU's names of the colour formats that can be drawn to and compared.
pub const COLOR_FORMATS: [&str; 24] = [
    "r8unorm",
    "rg8unorm",
    "rgba8unorm",
    "rgba8unorm-srgb",
    "bgra8unorm",
    "bgra8unorm-srgb",
    "rgb10a2unorm",
    "rg11b10ufloat",
    "r16float",
    "rg16float",
    "rgba16float",
    "r32float",
    "rg32float",
    "rgba32float",
    "r8uint",
    "rgba8uint",
    "r16uint",
    "rg16uint",
    "rgba16uint",
    "r32uint",
    "rg32uint",
    "rgba32uint",
    "r32sint",
    "rgba32sint",
];

/// A depth comparison (`GPUCompareFunction`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum CompareFunction {
    Never,
    Less,
    Equal,
    LessEqual,
    Greater,
    NotEqual,
    GreaterEqual,
    Always,
}

/// Which way depth grows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DepthDirection {
    /// 0 at the near plane, 1 at the far plane, cleared to 1, compared with Less.
    #[default]
    Forward,
    /// 1 at the near plane, 0 at the far plane, cleared to 0, compared with Greater.
    Reversed,
}

impl CompareFunction {
    /// The direction in which this comparison lets the nearer fragment win; `None` if it orders
    /// nothing.
    pub fn direction(self) -> Option<DepthDirection> {
        match self {
            Self::Less | Self::LessEqual => Some(DepthDirection::Forward),
            Self::Greater | Self::GreaterEqual => Some(DepthDirection::Reversed),
            _ => None,
        }
    }
}

impl CompareFunction {
    /// The same comparison for the opposite depth direction.
    #[must_use]
    pub fn reversed(self) -> Self {
        match self {
            Self::Less => Self::Greater,
            Self::LessEqual => Self::GreaterEqual,
            Self::Greater => Self::Less,
            Self::GreaterEqual => Self::LessEqual,
            other => other,
        }
    }
}

impl DepthDirection {
    /// The clear value of a depth attachment: the far plane.
    pub fn clear_depth(self) -> f32 {
        match self {
            Self::Forward => 1.0,
            Self::Reversed => 0.0,
        }
    }

    /// Sign of the step that moves a depth away from the viewer.
    pub fn away(self) -> f32 {
        match self {
            Self::Forward => 1.0,
            Self::Reversed => -1.0,
        }
    }
}

/// A depth (and stencil) format (`GPUTextureFormat`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs)]
pub enum DepthFormat {
    Depth16unorm,
    Depth24plus,
    #[serde(rename = "depth24plus-stencil8")]
    Depth24plusStencil8,
    #[default]
    Depth32float,
    #[serde(rename = "depth32float-stencil8")]
    Depth32floatStencil8,
}

impl DepthFormat {
    /// The largest step between two neighbouring depths in `[0, 1]` that the format stores.
    /// `depth24plus` may be a 24-bit unorm or a 32-bit float (WebGPU section 26.1): this is the
    /// coarser step.
    pub fn step(self) -> f32 {
        match self {
            Self::Depth16unorm => 1.0 / 65_535.0,
            Self::Depth24plus | Self::Depth24plusStencil8 => 1.0 / 16_777_215.0,
            Self::Depth32float | Self::Depth32floatStencil8 => f32::EPSILON / 2.0,
        }
    }

    /// Whether the format always stores a 32-bit float, which `depth24plus` may not.
    pub fn is_float(self) -> bool {
        matches!(self, Self::Depth32float | Self::Depth32floatStencil8)
    }

    /// Whether an adapter may store it as a float, whose bias is relative to the depth.
    pub fn may_be_float(self) -> bool {
        self != Self::Depth16unorm
    }

    /// Whether the format has a stencil aspect.
    pub fn has_stencil(self) -> bool {
        matches!(self, Self::Depth24plusStencil8 | Self::Depth32floatStencil8)
    }
}

/// Depth bias (`depthBias`, `depthBiasSlopeScale`, `depthBiasClamp`). `constant` counts the
/// smallest resolvable step of the format: for a float format, of the exponent of the primitive's
/// largest depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[allow(missing_docs)]
pub struct DepthBias {
    pub constant: i32,
    pub slope_scale: f32,
    pub clamp: f32,
}

/// Load operation of an attachment in a pass (`GPULoadOp`, resolved over the frame).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LoadOp {
    /// `clear` in the first render pass of the frame that has the attachment, `load` in the others.
    #[default]
    ClearFirst,
    /// `load` in every pass, also the first: keeps the content from before the frame.
    Load,
}

/// Store operation of an attachment in a pass (`GPUStoreOp`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StoreOp {
    /// Keeps the result for later passes or the host. A host that resolves samples may keep the
    /// resolved ones only.
    #[default]
    Store,
    /// Drops the result: neither a later pass of the plan nor the host reads it.
    Discard,
}

/// Load and store operation of an attachment in a pass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AttachmentOps {
    /// Before the pass.
    pub load: LoadOp,
    /// After it.
    pub store: StoreOp,
}

/// A pass's use of a depth attachment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DepthState {
    /// Name of the attachment, one of the plan's [`crate::plan::Attachment`]s.
    pub attachment: String,
    /// Depth comparison.
    pub compare: CompareFunction,
    /// Whether passing fragments write depth.
    pub write: bool,
    /// Bias added by the rasteriser.
    #[serde(default)]
    pub bias: DepthBias,
    /// Whether the attachment is bound read-only (`depthReadOnly`), so that the same pass may
    /// sample it.
    #[serde(default)]
    pub read_only: bool,
    /// Operations of the depth aspect. A read-only one has none, as WebGPU requires.
    #[serde(default)]
    pub ops: AttachmentOps,
    /// Operations of the stencil aspect; `None` if the format has none. They don't apply if a pass
    /// binds the attachment read-only and its stencil state writes nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stencil_ops: Option<AttachmentOps>,
}

impl DepthState {
    /// The use of an attachment of this format, without bias.
    pub fn new(
        attachment: impl Into<String>,
        format: DepthFormat,
        compare: CompareFunction,
        write: bool,
    ) -> Self {
        Self {
            attachment: attachment.into(),
            compare,
            write,
            bias: DepthBias::default(),
            read_only: false,
            ops: AttachmentOps::default(),
            stencil_ops: format.has_stencil().then(AttachmentOps::default),
        }
    }
}

/// Stencil operation (`GPUStencilOperation`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum StencilOperation {
    #[default]
    Keep,
    Zero,
    Replace,
    Invert,
    IncrementClamp,
    DecrementClamp,
    IncrementWrap,
    DecrementWrap,
}

/// Stencil test of one face (`GPUStencilFaceState`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct StencilFace {
    pub compare: CompareFunction,
    #[serde(default)]
    pub fail: StencilOperation,
    #[serde(default)]
    pub depth_fail: StencilOperation,
    #[serde(default)]
    pub pass: StencilOperation,
}

/// Stencil state of a pass.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct StencilState {
    pub front: StencilFace,
    pub back: StencilFace,
    pub read_mask: u32,
    pub write_mask: u32,
    pub reference: u32,
}

impl StencilState {
    /// Whether any outcome of the test changes the stencil buffer.
    pub fn writes(&self) -> bool {
        self.write_mask != 0
            && [self.front, self.back].iter().any(|f| {
                [f.fail, f.depth_fail, f.pass]
                    .iter()
                    .any(|op| *op != StencilOperation::Keep)
            })
    }
}

/// Which faces are dropped (`GPUCullMode`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum CullMode {
    None,
    Front,
    #[default]
    Back,
}

/// Winding of front faces (`GPUFrontFace`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum FrontFace {
    #[default]
    Ccw,
    Cw,
}

/// Primitive topology (`GPUPrimitiveTopology`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum Topology {
    PointList,
    LineList,
    LineStrip,
    #[default]
    TriangleList,
    TriangleStrip,
}

impl Topology {
    /// Whether depth bias applies (not to lines and points, WebGPU section 10.3.6).
    pub fn is_triangles(self) -> bool {
        matches!(self, Self::TriangleList | Self::TriangleStrip)
    }
}

/// How primitives are assembled and rasterised (`GPUPrimitiveState`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[allow(missing_docs)]
pub struct PrimitiveState {
    pub topology: Topology,
    pub cull: CullMode,
    pub front_face: FrontFace,
    /// Depth clipping off (`unclippedDepth`, the feature `depth-clip-control`).
    pub unclipped_depth: bool,
}

/// Multisampling (`GPUMultisampleState`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Multisample {
    pub count: u32,
    pub mask: u32,
    pub alpha_to_coverage: bool,
}

impl Default for Multisample {
    fn default() -> Self {
        Self {
            count: 1,
            mask: u32::MAX,
            alpha_to_coverage: false,
        }
    }
}

/// A blend factor (`GPUBlendFactor`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum BlendFactor {
    Zero,
    One,
    Src,
    OneMinusSrc,
    SrcAlpha,
    OneMinusSrcAlpha,
    Dst,
    OneMinusDst,
    DstAlpha,
    OneMinusDstAlpha,
    SrcAlphaSaturated,
}

/// A blend operation (`GPUBlendOperation`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum BlendOperation {
    #[default]
    Add,
    Subtract,
    ReverseSubtract,
    Min,
    Max,
}

/// Blending of one component (`GPUBlendComponent`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct BlendComponent {
    pub src: BlendFactor,
    pub dst: BlendFactor,
    #[serde(default)]
    pub operation: BlendOperation,
}

/// Blending of a colour target (`GPUBlendState`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Blend {
    pub color: BlendComponent,
    pub alpha: BlendComponent,
}

impl Blend {
    /// `src * a + dst * (1 - a)`.
    pub const ALPHA: Self = Self {
        color: BlendComponent {
            src: BlendFactor::SrcAlpha,
            dst: BlendFactor::OneMinusSrcAlpha,
            operation: BlendOperation::Add,
        },
        alpha: BlendComponent {
            src: BlendFactor::One,
            dst: BlendFactor::OneMinusSrcAlpha,
            operation: BlendOperation::Add,
        },
    };
    /// `src + dst`.
    pub const ADD: Self = Self {
        color: BlendComponent {
            src: BlendFactor::One,
            dst: BlendFactor::One,
            operation: BlendOperation::Add,
        },
        alpha: BlendComponent {
            src: BlendFactor::One,
            dst: BlendFactor::One,
            operation: BlendOperation::Add,
        },
    };
    /// `src`: an opaque draw.
    pub const REPLACE: Self = Self {
        color: BlendComponent {
            src: BlendFactor::One,
            dst: BlendFactor::Zero,
            operation: BlendOperation::Add,
        },
        alpha: BlendComponent {
            src: BlendFactor::One,
            dst: BlendFactor::Zero,
            operation: BlendOperation::Add,
        },
    };
}

/// A colour target of a pass (`GPUColorTargetState`).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ColorTarget {
    /// Texture format in WebGPU's spelling, `rgba8unorm-srgb` say.
    pub format: String,
    /// The plan's attachment to draw to; `None`: the scene's own colour of this location.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attachment: Option<String>,
    /// `None` writes the colour unblended.
    #[serde(default)]
    pub blend: Option<Blend>,
    /// Bits red 1, green 2, blue 4, alpha 8.
    #[serde(default = "all_channels")]
    pub write_mask: u8,
    /// Load and store operation.
    #[serde(default)]
    pub ops: AttachmentOps,
}

fn all_channels() -> u8 {
    0b1111
}

impl ColorTarget {
    /// An unblended target that writes all channels.
    pub fn opaque(format: impl Into<String>) -> Self {
        Self {
            format: format.into(),
            attachment: None,
            blend: None,
            write_mask: all_channels(),
            ops: AttachmentOps::default(),
        }
    }

    /// Whether the previous content of the target shows through.
    pub fn is_blended(&self) -> bool {
        self.blend.is_some_and(|b| b != Blend::REPLACE)
    }
}

/// The author's pipeline state for a material. A scene or the command line provides it, because
/// shaders can't express it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MaterialState {
    /// Primitive assembly and culling.
    pub primitive: PrimitiveState,
    /// Depth comparison; `None` follows the scene's direction (Less, or Greater under reversed Z).
    pub depth_compare: Option<CompareFunction>,
    /// Whether the material writes depth.
    pub depth_write: bool,
    /// The author's own depth bias.
    pub depth_bias: DepthBias,
    /// Format of the depth attachment.
    pub depth_format: DepthFormat,
    /// Which way depth grows.
    pub depth_direction: DepthDirection,
    /// Stencil test.
    pub stencil: Option<StencilState>,
    /// Multisampling.
    pub multisample: Multisample,
    /// Colour targets by location; `None` leaves a hole. If empty: one opaque `rgba8unorm` per
    /// fragment output.
    pub targets: Vec<Option<ColorTarget>>,
}

impl Default for MaterialState {
    fn default() -> Self {
        Self {
            primitive: PrimitiveState::default(),
            depth_compare: None,
            depth_write: true,
            depth_bias: DepthBias::default(),
            depth_format: DepthFormat::default(),
            depth_direction: DepthDirection::default(),
            stencil: None,
            multisample: Multisample::default(),
            targets: Vec::new(),
        }
    }
}

impl MaterialState {
    /// The effective depth comparison.
    pub fn compare(&self) -> CompareFunction {
        self.depth_compare.unwrap_or(match self.depth_direction {
            DepthDirection::Forward => CompareFunction::Less,
            DepthDirection::Reversed => CompareFunction::Greater,
        })
    }

    /// Whether any target blends.
    pub fn is_blended(&self) -> bool {
        self.targets.iter().flatten().any(ColorTarget::is_blended)
    }
}
