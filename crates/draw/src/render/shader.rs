//! Reads the plans of a frame from JSON as a host does, and their programs from emitted text or as
//! naga IR.

use std::collections::BTreeMap;

use preshade_plan::frame::{FramePass, FramePlan};
use preshade_plan::plan::{GpuPass, Plan, SCHEMA};
use preshade_plan::plan_file::{PlanFile, StageFile, Target};
use preshade_plan::program::Program;
use preshade_plan::safety::{Bounded, Checks};
use preshade_plan::uniforms::UniformScalar;
use shader_text::files::File;
use shader_text::source::Invalid;

use super::Error;
use super::compiled::{self, Compiled};
use super::gpu::Gpu;

/// A material as a host receives it, with facts about its programs.
#[derive(Clone, Debug)]
pub struct PlannedMaterial<'a> {
    pub plan: &'a Plan,
    pub shaders: Shaders,
    /// The run-time checks without which the author's programs would be unsafe. Variants need the
    /// same checks, so that both compile alike.
    pub needed: Checks,
    /// Whether a program has a loop that may not end.
    pub is_open: bool,
}

/// The form in which the shaders of a material reach the driver.
#[derive(Clone, Debug)]
pub enum Shaders {
    /// The emitted files: `MATERIAL.plan.json`, and the WGSL files that its passes name.
    Emitted(Vec<File>),
    /// The IR of the plan, through wgpu's `naga-ir`.
    Ir,
}

/// Makes the bounded copy of a program. Numbers its loops from the given number, which starts at 1.
/// The closure decides whether a uniform is small enough as a loop's bound. `None` if every loop
/// ends.
pub(crate) type Bound =
    fn(&Program, u32, &dyn Fn(&UniformScalar) -> bool) -> Result<Option<Bounded>, Box<Invalid>>;

#[derive(Clone, Debug)]
enum Shader {
    Wgsl(String),
    Ir(Box<naga::Module>),
}

/// A stage of a pass: a shader's name and an entry point.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ShaderStageRef {
    pub shader: String,
    pub entry_point: String,
}

/// The plans of all materials of a scene as a host holds them: data from JSON, and shaders by name.
#[derive(Clone, Debug)]
pub struct Variant {
    plans: Vec<Plan>,
    frame: FramePlan,
    /// Shaders by the name of the emitted file, or `MATERIAL.KEY` for IR, with the checks that the
    /// material's texts need.
    shaders: BTreeMap<String, (Shader, Checks)>,
    /// The plans with their programs, and the function that bounds them. `None` if all loops end.
    looping: Option<(Vec<Plan>, Bound)>,
    /// Vertex and fragment stage of each pass of each plan.
    stages: Vec<Vec<(ShaderStageRef, Option<ShaderStageRef>)>>,
    /// Stage of each compute pass of each plan.
    compute: Vec<Vec<ShaderStageRef>>,
}

impl Variant {
    /// Reads materials as a host does. `bound` makes copies of programs whose loops may not end.
    ///
    /// # Errors
    /// As [`Self::from_files`].
    pub fn new(materials: Vec<PlannedMaterial<'_>>, bound: Bound) -> Result<Self, Error> {
        let mut out = Self::empty();
        if materials.iter().any(|m| m.is_open) {
            let plans = materials.iter().map(|m| m.plan.clone());
            out.looping = Some((plans.collect(), bound));
        }
        for material in materials {
            match material.shaders {
                Shaders::Emitted(files) => {
                    out.add_files(&material.plan.material, files, material.needed)?;
                }
                Shaders::Ir => out.add_ir(material.plan, material.needed)?,
            }
        }
        out.frame = FramePlan::merge(&out.plans)?;
        Ok(out)
    }

    /// A variant of bounded copies. The driver gets them as IR with every check.
    pub(super) fn bounded(plans: &[Plan]) -> Result<Self, Error> {
        let mut out = Self::empty();
        for plan in plans {
            out.add_ir(plan, Checks::ALL)?;
        }
        out.frame = FramePlan::merge(&out.plans)?;
        Ok(out)
    }

    /// The plans with their programs, and the function that bounds them. `None` if all loops end.
    pub(super) fn looping(&self) -> Option<&(Vec<Plan>, Bound)> {
        self.looping.as_ref()
    }

    /// Reads the emitted files of each material, with WGSL among the targets. Their texts must be
    /// in naga's dialect.
    ///
    /// # Errors
    /// [`Error::Plan`] if a `plan.json` is missing, has another version, or names missing files;
    /// [`Error::Frame`] if the plans do not fit into one frame.
    pub fn from_files(materials: Vec<Vec<File>>) -> Result<Self, Error> {
        let mut out = Self::empty();
        for files in materials {
            let json = files.iter().map(|f| f.name.as_str());
            let name = json.clone().find_map(|n| n.strip_suffix(".plan.json"));
            let name = name.unwrap_or_default().to_owned();
            out.add_files(&name, files, Checks::default())?;
        }
        out.frame = FramePlan::merge(&out.plans)?;
        Ok(out)
    }

    fn empty() -> Self {
        Self {
            plans: Vec::new(),
            frame: FramePlan {
                attachments: Vec::new(),
                passes: Vec::new(),
            },
            shaders: BTreeMap::new(),
            looping: None,
            stages: Vec::new(),
            compute: Vec::new(),
        }
    }

    /// Adds the emitted files of a material: `MATERIAL.plan.json` and the WGSL files that its
    /// passes name.
    fn add_files(&mut self, material: &str, files: Vec<File>, needed: Checks) -> Result<(), Error> {
        let failed = |message: String| Error::Plan {
            material: material.to_owned(),
            message,
        };
        let mut described = None;
        let mut shaders = BTreeMap::new();
        for file in files {
            let text = String::from_utf8(file.bytes).map_err(|e| failed(e.to_string()))?;
            if file.name.ends_with(".json") {
                let json: PlanFile = serde_json::from_str(&text)
                    .map_err(|e| failed(format!("{}: {e}", file.name)))?;
                described = Some(json);
            } else {
                shaders.insert(file.name, Shader::Wgsl(text));
            }
        }
        let described = described.ok_or_else(|| failed("there is no plan.json".to_owned()))?;
        check(&described).map_err(failed)?;
        let mut stage = |at: &BTreeMap<Target, StageFile>| {
            let Some(s) = at.get(&Target::Wgsl) else {
                return Ok(None);
            };
            if let Some(shader) = shaders.remove(&s.file) {
                self.shaders.insert(s.file.clone(), (shader, needed));
            }
            match self.shaders.contains_key(&s.file) {
                true => Ok(Some(ShaderStageRef {
                    shader: s.file.clone(),
                    entry_point: s.entry_point.clone(),
                })),
                false => Err(failed(format!("there is no file `{}`", s.file))),
            }
        };
        let stages = described
            .files
            .iter()
            .map(|f| {
                let vertex = stage(&f.vertex)?
                    .ok_or_else(|| failed(format!("pass `{}` has no vertex stage", f.role)))?;
                Ok((vertex, stage(&f.fragment)?))
            })
            .collect::<Result<Vec<_>, Error>>()?;
        let compute = described
            .compute_files
            .iter()
            .map(|f| stage(f)?.ok_or_else(|| failed("a compute pass has no file".to_owned())))
            .collect::<Result<Vec<_>, Error>>()?;
        self.stages.push(stages);
        self.compute.push(compute);
        self.plans.push(described.plan);
        Ok(())
    }

    fn add_ir(&mut self, plan: &Plan, needed: Checks) -> Result<(), Error> {
        let failed = |e: serde_json::Error| Error::Plan {
            material: plan.material.clone(),
            message: format!("plan.json: {e}"),
        };
        let name = |key: &str| format!("{}.{key}", plan.material);
        let json = serde_json::to_string(plan).map_err(failed)?;
        let host: Plan = serde_json::from_str(&json).map_err(failed)?;
        for (key, program) in &plan.programs {
            let module = Shader::Ir(Box::new(program.module().clone()));
            self.shaders.insert(name(key), (module, needed));
        }
        let compute = host.compute.iter().map(|c| ShaderStageRef {
            shader: name(&c.program),
            entry_point: c.entry_point.clone(),
        });
        self.compute.push(compute.collect());
        let stage = |pass: &GpuPass, entry_point: &str| ShaderStageRef {
            shader: name(&pass.program),
            entry_point: entry_point.to_owned(),
        };
        self.stages.push(
            host.passes
                .iter()
                .map(|p| {
                    (
                        stage(p, &p.vertex),
                        p.fragment.as_deref().map(|f| stage(p, f)),
                    )
                })
                .collect(),
        );
        self.plans.push(host);
        Ok(())
    }

    pub(super) fn in_passes(mut self, passes: Vec<FramePass>) -> Self {
        self.frame.passes = passes;
        self
    }

    /// The plans, without programs.
    pub fn plans(&self) -> &[Plan] {
        &self.plans
    }

    /// Each plan with the stages of its compute passes.
    pub(super) fn compute(&self) -> impl Iterator<Item = (&Plan, &[ShaderStageRef])> {
        let stages = self.compute.iter().map(Vec::as_slice);
        self.plans.iter().zip(stages)
    }

    /// The plans merged into one frame.
    pub fn frame(&self) -> &FramePlan {
        &self.frame
    }

    /// Plan, pass and stages of a member of the frame.
    pub(super) fn member(&self, material: &str, index: usize) -> Result<PlannedPass<'_>, Error> {
        let plan = self.plans.iter().position(|p| p.material == material);
        plan.and_then(|at| {
            let plan = &self.plans[at];
            Some(PlannedPass {
                plan,
                pass: plan.passes.get(index)?,
                stages: self.stages[at].get(index)?,
            })
        })
        .ok_or_else(|| Error::Plan {
            material: material.to_owned(),
            message: format!("the frame names its pass {index}, which it does not have"),
        })
    }

    pub(super) fn compile(
        &self,
        gpu: &Gpu,
        compiled: Option<&Compiled>,
    ) -> Result<BTreeMap<&str, wgpu::ShaderModule>, Error> {
        self.shaders
            .iter()
            .map(|(name, (shader, needed))| {
                let module = match shader {
                    Shader::Wgsl(text) => compiled::shader(gpu, compiled, name, (text, *needed))?,
                    Shader::Ir(module) => gpu.checked(&format!("the shader `{name}`"), || {
                        let module = std::borrow::Cow::Owned((**module).clone());
                        gpu.shader(
                            *needed,
                            wgpu::ShaderModuleDescriptor {
                                label: Some(name),
                                source: wgpu::ShaderSource::Naga(module),
                            },
                        )
                    })?,
                };
                Ok((name.as_str(), module))
            })
            .collect()
    }
}

/// A pass of a frame.
#[derive(Clone, Copy)]
pub(super) struct PlannedPass<'v> {
    pub plan: &'v Plan,
    pub pass: &'v GpuPass,
    pub stages: &'v (ShaderStageRef, Option<ShaderStageRef>),
}

impl PlannedPass<'_> {
    /// An error about the plan.
    pub fn failed(&self, message: String) -> Error {
        Error::Plan {
            material: self.plan.material.clone(),
            message,
        }
    }
}

/// Fails with a message unless the plan has this version and its passes' files.
fn check(described: &PlanFile) -> Result<(), String> {
    let plan = &described.plan;
    if plan.schema != SCHEMA {
        return Err(format!(
            "its schema is `{}`, and this is `{SCHEMA}`",
            plan.schema
        ));
    }
    let roles = plan.passes.iter().map(|p| p.role.name());
    if !roles.eq(described.files.iter().map(|f| f.role.as_str())) {
        return Err("its files are not those of its passes, one by one".to_owned());
    }
    for (pass, files) in plan.passes.iter().zip(&described.files) {
        // WGSL preserves the names of entry points.
        let entry =
            |at: &BTreeMap<Target, StageFile>| at.get(&Target::Wgsl).map(|s| s.entry_point.clone());
        let named = (Some(pass.vertex.clone()), pass.fragment.clone());
        if named != (entry(&files.vertex), entry(&files.fragment)) {
            return Err(format!(
                "its files have other entry points than pass `{}`",
                pass.role.name()
            ));
        }
    }
    let named = plan.compute.iter().map(|c| Some(&c.entry_point));
    let files = described.compute_files.iter();
    let files = files.map(|f| f.get(&Target::Wgsl).map(|s| &s.entry_point));
    match named.eq(files) {
        true => Ok(()),
        false => Err("its files have other entry points than its compute passes".to_owned()),
    }
}
