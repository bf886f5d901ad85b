//! `MATERIAL.plan.json`: the plan's data, and the file and entry point of each pass in each target.

use std::collections::{BTreeMap, BTreeSet};

use naga::ShaderStage;
#[cfg(any(feature = "glsl", feature = "spirv"))]
use naga_edit::declared::LengthConstant;
use preshade_passes::transforms::specialize::dispatch::Versions;
use preshade_plan::contract::Contract;
use preshade_plan::plan::{Attachment, GpuPass, Plan};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Target, TessellationStage, WrittenFiles, written_key};
use shader_text::files::File;

/// The content of `MATERIAL.plan.json`: a plan ([`preshade_plan::plan::SCHEMA`]) and its files.
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

impl Fallback {
    pub(super) fn new(plan: &Plan, written: &WrittenFiles) -> Self {
        Self {
            attachments: plan.attachments.clone(),
            passes: plan.passes.clone(),
            files: pass_files(plan, written),
        }
    }
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
    pub(super) fn new(file: &str, entry_point: &str) -> Self {
        Self {
            file: file.to_owned(),
            entry_point: entry_point.to_owned(),
            ..Self::default()
        }
    }

    /// Adds a specialisation constant of which the text has the array lengths alone.
    #[cfg(any(feature = "glsl", feature = "spirv"))]
    pub(super) fn add_length(&mut self, of: &LengthConstant, default: u32) -> SpecConstant {
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

/// One stage's files by target.
fn stage_files(
    written: &WrittenFiles,
    program: &str,
    stage: ShaderStage,
    entry: &str,
) -> BTreeMap<Target, StageFile> {
    let entry = written_key(stage, entry);
    written
        .iter()
        .filter(|((p, e, _), _)| p == program && *e == entry)
        .map(|((_, _, target), file)| (*target, file.clone()))
        .collect()
}

/// A pass's tessellation stages by target.
fn tessellation_files(
    written: &WrittenFiles,
    program: &str,
    vertex: &str,
) -> BTreeMap<Target, TessellationFiles> {
    let of = |stage: TessellationStage, target: Target| {
        let key = (program.to_owned(), stage.key(vertex), target);
        written.get(&key).cloned()
    };
    let stages = |target| {
        Some(TessellationFiles {
            control: of(TessellationStage::Control, target)?,
            evaluation: of(TessellationStage::Evaluation, target)?,
        })
    };
    let targets = Target::ALL.into_iter();
    targets
        .filter_map(|target| Some((target, stages(target)?)))
        .collect()
}

fn pass_files(plan: &Plan, written: &WrittenFiles) -> Vec<PassFiles> {
    let of = |program: &str, stage, entry: &str| stage_files(written, program, stage, entry);
    plan.passes
        .iter()
        .map(|pass| PassFiles {
            role: pass.role.name().to_owned(),
            vertex: of(&pass.program, ShaderStage::Vertex, &pass.vertex),
            // A pass without one has an empty stage if the target needs it.
            fragment: of(
                &pass.program,
                ShaderStage::Fragment,
                pass.fragment.as_deref().unwrap_or_default(),
            ),
            tessellation: tessellation_files(written, &pass.program, &pass.vertex),
        })
        .collect()
}

/// The note on Vulkan's GLSL as WGSL.
const UPSIDE_DOWN: &str = "the text is read as Vulkan's, whose y points down: WebGPU draws the WGSL \
                           upside down; end the vertex stage with `gl_Position.y = \
                           -gl_Position.y;`, or negate y in the projection";

fn notes(written: &WrittenFiles) -> impl Iterator<Item = String> {
    written.values().flat_map(|stage| {
        let unread = stage.unread.as_ref().map(|lacks| {
            format!(
                "`{}` was not read back: our reader lacks {lacks}; only its interface was compared",
                stage.file
            )
        });
        unread.into_iter().chain(stage.notes.iter().cloned())
    })
}

pub(super) fn file(plan: &Plan, written: &WrittenFiles, original: Option<Fallback>) -> File {
    let targets: BTreeSet<Target> = written.keys().map(|(_, _, target)| *target).collect();
    let forms = targets
        .into_iter()
        .filter_map(|target| Some((target, super::weaker_form(plan, target)?)))
        .collect();
    let compute = plan.compute.iter();
    let compute =
        compute.map(|c| stage_files(written, &c.program, ShaderStage::Compute, &c.entry_point));
    let mut plan = plan.clone();
    for note in notes(written) {
        if !plan.notes.contains(&note) {
            plan.notes.push(note);
        }
    }
    let is_wgsl = written.keys().any(|(_, _, target)| *target == Target::Wgsl);
    let is_down = plan.programs.values().any(|p| p.declared().y_down);
    if is_wgsl && is_down {
        plan.notes.push(UPSIDE_DOWN.to_owned());
    }
    let content = PlanFile {
        compute_files: compute.collect(),
        files: pass_files(&plan, written),
        original,
        forms,
        plan,
    };
    let name = format!("{}.plan.json", content.plan.material);
    // A plan is plain data with string keys, so serialising it cannot fail.
    let mut bytes = serde_json::to_vec_pretty(&content).unwrap_or_default();
    bytes.push(b'\n');
    File { name, bytes }
}

/// `MATERIAL.versions.json`: which version of a material a draw takes.
pub fn versions(versions: &Versions) -> File {
    let name = format!("{}.versions.json", versions.material);
    // As above.
    let mut bytes = serde_json::to_vec_pretty(versions).unwrap_or_default();
    bytes.push(b'\n');
    File { name, bytes }
}
