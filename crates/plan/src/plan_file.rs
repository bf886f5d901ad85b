//! `MATERIAL.plan.json`: a plan, and the file and entry point of each pass in each target.

use std::collections::BTreeMap;

use naga_edit::declared::LengthConstant;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::contract::Contract;
use crate::plan::{Attachment, GpuPass, Plan};

/// An output language.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[non_exhaustive]
pub enum Target {
    /// WebGPU Shading Language.
    #[serde(rename = "wgsl")]
    Wgsl,
    /// SPIR-V 1.3, Vulkan semantics.
    #[serde(rename = "spirv")]
    Spirv,
    /// GLSL 4.50 for OpenGL: combined samplers, uniform blocks with explicit bindings.
    #[serde(rename = "glsl")]
    Glsl450,
    /// GLSL 4.50 for Vulkan: sets and bindings, push constants, specialisation constants, and the
    /// author's combined samplers.
    #[serde(rename = "glsl-vulkan")]
    GlslVulkan,
    /// GLSL ES 3.00 for WebGL 2: combined samplers, bindings by name.
    #[serde(rename = "glsl-es")]
    GlslEs300,
    /// GLSL ES 1.00 for WebGL 1: uniforms, samplers and attributes by name. It supports fewer
    /// programs than the other targets.
    #[serde(rename = "glsl-es-100")]
    GlslEs100,
    /// GLSL 4.00 for OpenGL with tessellation stages that evaluate hoisted values: combined
    /// samplers, bindings by name.
    #[serde(rename = "glsl-tess")]
    GlslTess,
    /// GLSL 4.50 for Vulkan with tessellation stages: combined samplers, one descriptor set.
    #[serde(rename = "glsl-vulkan-tess")]
    GlslVulkanTess,
}

impl Target {
    /// Every target, in the order of `--help`.
    pub const ALL: [Self; 8] = [
        Self::Wgsl,
        Self::Spirv,
        Self::Glsl450,
        Self::GlslVulkan,
        Self::GlslEs300,
        Self::GlslEs100,
        Self::GlslTess,
        Self::GlslVulkanTess,
    ];

    /// The targets for any plan and host: no tessellation, no GLSL ES 1.00, no Vulkan's GLSL.
    pub const GENERAL: [Self; 4] = [Self::Wgsl, Self::Spirv, Self::Glsl450, Self::GlslEs300];

    /// The name on the command line and in `plan.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Wgsl => "wgsl",
            Self::Spirv => "spirv",
            Self::Glsl450 => "glsl",
            Self::GlslVulkan => "glsl-vulkan",
            Self::GlslEs300 => "glsl-es",
            Self::GlslEs100 => "glsl-es-100",
            Self::GlslTess => "glsl-tess",
            Self::GlslVulkanTess => "glsl-vulkan-tess",
        }
    }

    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|t| t.name() == name)
    }
}

impl std::fmt::Display for Target {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// The content of `MATERIAL.plan.json`: a plan ([`crate::plan::SCHEMA`]) and its files.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct PlanFile {
    /// The plan. The files hold its programs.
    #[serde(flatten)]
    pub plan: Plan,
    /// Files by pass, in the order of the plan's passes.
    pub files: Vec<PassFiles>,
    /// Files of compute stages by target, in the order of the plan's compute passes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub compute_files: Vec<BTreeMap<Target, StageFile>>,
    /// If `fallback` is `original`: the author's material, to draw instead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub original: Option<Fallback>,
    /// The forms that promise less than the plan's `contract`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub forms: BTreeMap<Target, WeakerPromise>,
}

/// The fallback's passes and files, which replace the plan's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Fallback {
    /// Attachments.
    pub attachments: Vec<Attachment>,
    /// GPU passes in the order they run.
    pub passes: Vec<GpuPass>,
    /// Files by pass.
    pub files: Vec<PassFiles>,
}

impl PlanFile {
    /// The fallback's own file; `None` if the fallback is a recipe or absent.
    pub fn fallback(&self) -> Option<Self> {
        let original = self.original.clone()?;
        Some(Self {
            plan: Plan {
                attachments: original.attachments,
                passes: original.passes,
                vertex_buffers: Vec::new(),
                draw_buffers: Vec::new(),
                frame_buffers: Vec::new(),
                compute: Vec::new(),
                steps: Vec::new(),
                contract: Contract::exact(),
                self_test: None,
                fallback: None,
                guard: None,
                notes: Vec::new(),
                ..self.plan.clone()
            },
            files: original.files,
            compute_files: Vec::new(),
            original: None,
            forms: BTreeMap::new(),
        })
    }
}

/// The promise of an emitted form that is weaker than its plan's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WeakerPromise {
    /// The promise in this form.
    pub contract: Contract,
    /// The limitation of the language, and a remedy.
    pub why: String,
}

/// The files of a pass's stages.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PassFiles {
    /// Name of the pass's role.
    pub role: String,
    /// Vertex stage, by target.
    pub vertex: BTreeMap<Target, StageFile>,
    /// Fragment stage, by target. A pass without one has an empty stage in GLSL ES only.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub fragment: BTreeMap<Target, StageFile>,
    /// Tessellation stages, by target.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub tessellation: BTreeMap<Target, TessellationFiles>,
}

/// The tessellation stages of a pass. It draws patches of three vertices.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TessellationFiles {
    /// Control stage. It sets all levels to one `float`: in OpenGL the uniform
    /// `tessellation_level`, in Vulkan the specialisation constant 0. The default is 3.
    pub control: StageFile,
    /// Evaluation stage.
    pub evaluation: StageFile,
}

/// One stage of a pass in one target.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StageFile {
    /// File name, in the folder of `plan.json`.
    pub file: String,
    /// Entry point's name in that file.
    pub entry_point: String,
    /// The values of overrides that the file has as plain numbers: all that the stage reads in
    /// OpenGL's GLSL, and in `constants`' languages those that a type or an initialiser needs. Keys and types are those of
    /// WebGPU's pipeline constants: the id or else the name; a boolean is 0 or 1. Other values need
    /// another text.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub overrides: BTreeMap<String, f64>,
    /// SPIR-V and Vulkan's GLSL: the specialisation constants, by the key of their override.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub constants: BTreeMap<String, SpecConstant>,
    /// GLSL and SPIR-V: combined samplers, by the author's name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub textures: Vec<GlslTexture>,
    /// GLSL only: uniform and storage blocks.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub blocks: Vec<GlslBlock>,
    /// GLSL only: uniforms outside of blocks, as the author declared them. The plan has them in a
    /// buffer.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub uniforms: Vec<GlslUniform>,
    /// GLSL only: the attributes of a vertex stage.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub attributes: Vec<GlslAttribute>,
    /// The extensions that the text requires, besides those that its version contains: GLSL only.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub extensions: Vec<String>,
    /// What our reader lacks, if the file was not read back. `plan.json` has it as a note.
    #[serde(skip)]
    pub unread: Option<String>,
    /// What else a host must know about the file, a sentence each. `plan.json` has them as notes.
    #[serde(skip)]
    pub notes: Vec<String>,
}

/// An override that a host sets as a specialisation constant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SpecConstant {
    /// `SpecId` in the text: the override's id, or else the lowest free one.
    pub id: u32,
    /// The override's name.
    pub name: String,
    /// Its type, as in WGSL.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its default; a boolean is 0 or 1. Without one, the host must set it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub default: Option<f64>,
}

impl StageFile {
    pub fn new(file: &str, entry_point: &str) -> Self {
        Self {
            file: file.to_owned(),
            entry_point: entry_point.to_owned(),
            ..Self::default()
        }
    }

    /// Adds a specialisation constant that the text uses only in array lengths.
    pub fn add_length(&mut self, of: &LengthConstant, default: u32) -> SpecConstant {
        // Its key is its override's, which may have another id.
        let mut known = self.constants.values();
        if let Some(known) = known.find(|c| c.id == of.id) {
            return known.clone();
        }
        let constant = SpecConstant {
            id: of.id,
            name: of.own.clone(),
            ty: if of.is_signed { "i32" } else { "u32" }.to_owned(),
            default: Some(f64::from(default)),
        };
        self.constants.insert(of.id.to_string(), constant.clone());
        constant
    }
}

/// A GLSL sampler uniform and the plan's bindings it combines.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct GlslTexture {
    /// Uniform's name in the text.
    pub name: String,
    /// Group and binding of the texture.
    pub texture: [u32; 2],
    /// Group and binding of the sampler; none if the texture is only fetched from.
    pub sampler: Option<[u32; 2]>,
    /// `layout(binding = ..)` in the text: the author's number if there is one. An array element
    /// has the array's number plus its index, and in SPIR-V and Vulkan's GLSL the array's number.
    /// None in GLSL ES 3.00, where the host sets the uniform.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<u32>,
    /// GLSL ES 1.00 only, which has no texel fetch: the uniform `vec2` for the texture's width and
    /// height. Bind the texture unfiltered (`NEAREST`), without mip levels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<String>,
}

/// A GLSL interface block and the plan's binding it holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct GlslBlock {
    /// Name of the block (`glGetUniformBlockIndex`).
    pub block: String,
    /// Group and binding.
    pub binding: [u32; 2],
    /// `layout(binding = ..)` in the text: the author's number if there is one. None in GLSL ES
    /// 3.00, where the host sets it (`glUniformBlockBinding`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slot: Option<u32>,
}

/// A uniform outside of blocks.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct GlslUniform {
    /// Its name.
    pub name: String,
    /// Group and binding of the plan's uniform buffer that has its value.
    pub binding: [u32; 2],
    /// Offset of the value in that buffer, in bytes.
    pub offset: u32,
    /// `layout(location = ..)` in the text, if the author gave it; none in GLSL ES 3.00.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub location: Option<u32>,
    /// The author's uniform whose value of the previous frame it has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub previous_of: Option<String>,
}

/// An input of the vertex stage.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct GlslAttribute {
    /// Its name. A matrix is one attribute here, and one per column in the plan.
    pub name: String,
    /// The plan's location; for a matrix, that of its first column.
    pub location: u32,
    /// Whether the text has `layout(location = ..)`. Otherwise the linker chooses, or the host by
    /// name (`glBindAttribLocation`).
    pub explicit: bool,
}
