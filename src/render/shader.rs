//! A plan on its way to the GPU: the plan through its own JSON, its programs through the text that users ship, or as naga IR.

use std::collections::BTreeMap;

use preshade_passes::frame::FramePlan;
use preshade_passes::plan::Plan;
use preshade_passes::program::Program;

use super::gpu::Gpu;
use super::{Error, trusted};

/// The road a shader takes to the driver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ShaderForm {
    /// The emitted WGSL: what users ship.
    #[default]
    Text,
    /// The IR itself, by wgpu's `naga-ir`: what the passes built.
    Ir,
}

#[derive(Clone, Debug)]
enum Shader {
    Wgsl(String),
    Ir(Box<naga::Module>),
}

/// The plans of all materials of a scene, as a host holds them: data from JSON, and shaders by name.
#[derive(Clone, Debug)]
pub struct Variant {
    plans: Vec<Plan>,
    frame: FramePlan,
    /// By material and program key.
    shaders: BTreeMap<(String, String), Shader>,
}

impl Variant {
    /// Sends `plans` through JSON and their programs through `form`.
    ///
    /// # Errors
    /// [`Error::Plan`] when a plan does not survive its JSON or a program cannot be written as text (bugs of preshade), [`Error::Frame`] when the
    /// plans do not fit into one frame.
    pub fn new(plans: &[Plan], form: ShaderForm) -> Result<Self, Error> {
        let mut out = Vec::new();
        let mut shaders = BTreeMap::new();
        for plan in plans {
            let failed = |message: String| Error::Plan {
                material: plan.material.clone(),
                message,
            };
            let json = serde_json::to_string(plan).map_err(|e| failed(e.to_string()))?;
            let host: Plan =
                serde_json::from_str(&json).map_err(|e| failed(format!("plan.json: {e}")))?;
            for (key, program) in &plan.programs {
                let shader = match form {
                    ShaderForm::Text => Shader::Wgsl(wgsl(program).map_err(|e| {
                        failed(format!("its program `{key}` cannot be written as WGSL: {e}"))
                    })?),
                    ShaderForm::Ir => Shader::Ir(Box::new(program.module().clone())),
                };
                shaders.insert((plan.material.clone(), key.clone()), shader);
            }
            out.push(host);
        }
        let frame = FramePlan::merge(&out)?;
        Ok(Self {
            plans: out,
            frame,
            shaders,
        })
    }

    /// The plans, without programs.
    pub fn plans(&self) -> &[Plan] {
        &self.plans
    }

    /// The plans merged into one frame.
    pub fn frame(&self) -> &FramePlan {
        &self.frame
    }

    /// Compiles every shader.
    pub(super) fn compile(
        &self,
        gpu: &Gpu,
    ) -> Result<BTreeMap<(&str, &str), wgpu::ShaderModule>, Error> {
        self.shaders
            .iter()
            .map(|((material, key), shader)| {
                let label = format!("{material}.{key}");
                let source = match shader {
                    Shader::Wgsl(text) => wgpu::ShaderSource::Wgsl(text.as_str().into()),
                    Shader::Ir(module) => {
                        wgpu::ShaderSource::Naga(std::borrow::Cow::Owned((**module).clone()))
                    }
                };
                let module = gpu.checked(&format!("the shader {label}"), || {
                    trusted::compile(
                        &gpu.device,
                        wgpu::ShaderModuleDescriptor {
                            label: Some(&label),
                            source,
                        },
                    )
                })?;
                Ok(((material.as_str(), key.as_str()), module))
            })
            .collect()
    }
}

fn wgsl(program: &Program) -> Result<String, naga::back::wgsl::Error> {
    naga::back::wgsl::write_string(
        program.module(),
        program.info(),
        naga::back::wgsl::WriterFlags::empty(),
    )
}
