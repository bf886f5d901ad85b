//! The compute passes of a frame's plans: pipelines and one dispatch a draw.

use std::collections::BTreeMap;

use preshade_passes::plan::Plan;

use super::Error;
use super::gpu::Gpu;
use super::inputs::SceneInputs;
use super::layout::{self, Made, Stages};
use super::shader::Variant;
use super::subdivided::Meshes;
use super::targets::Targets;

/// One compute pass on all the draws of its material.
pub(super) struct PreparedCompute {
    pipeline: wgpu::ComputePipeline,
    dispatches: Vec<Dispatch>,
}

struct Dispatch {
    groups: Vec<(u32, wgpu::BindGroup)>,
    workgroups: [u32; 2],
}

/// The compute passes of all plans, in order.
///
/// # Errors
/// As of a frame's raster passes.
pub(super) fn prepare(
    inputs: &SceneInputs<'_>,
    variant: &Variant,
    shaders: &BTreeMap<&str, wgpu::ShaderModule>,
    targets: &Targets,
    meshes: &mut Meshes,
) -> Result<Vec<PreparedCompute>, Error> {
    let (gpu, scene) = (inputs.gpu(), inputs.scene());
    let mut prepared = Vec::new();
    for (plan, stages) in variant.compute() {
        for (pass, stage) in plan.compute.iter().zip(stages) {
            let failed = |message: String| failed(plan, message);
            let what = format!("the compute pass of material `{}`", plan.material);
            let shader = shaders
                .get(stage.shader.as_str())
                .ok_or_else(|| failed(format!("there is no shader `{}`", stage.shader)))?;
            let mut pipeline = None;
            let mut dispatches = Vec::new();
            for (index, draw) in scene.draws.iter().enumerate() {
                let name = scene.materials.get(draw.material).map(|m| &m.name);
                let Some(bound) = inputs.draw(index).filter(|_| name == Some(&plan.material))
                else {
                    continue;
                };
                let subdivided = meshes
                    .of(gpu, plan, &pass.geometry, &pass.bindings, (index, bound))
                    .map_err(failed)?
                    .ok_or_else(|| failed("it computes no geometry".to_owned()))?;
                let filled = layout::fill(
                    &pass.bindings,
                    bound,
                    targets,
                    Made::Subdivided(&subdivided),
                    Stages::Compute,
                )
                .map_err(failed)?;
                let groups = gpu.checked(&what, || layout::bind(&gpu.device, &filled))?;
                if pipeline.is_none() {
                    let layouts: Vec<_> = groups.iter().map(|(g, l, _)| (*g, l)).collect();
                    pipeline = Some(build(gpu, &what, shader, &stage.entry_point, &layouts)?);
                }
                dispatches.push(Dispatch {
                    groups: groups.into_iter().map(|(g, _, b)| (g, b)).collect(),
                    workgroups: subdivided.mesh.workgroups(pass.workgroup),
                });
            }
            prepared.extend(pipeline.map(|pipeline| PreparedCompute {
                pipeline,
                dispatches,
            }));
        }
    }
    Ok(prepared)
}

fn failed(plan: &Plan, message: String) -> Error {
    Error::Plan {
        material: plan.material.clone(),
        message,
    }
}

fn build(
    gpu: &Gpu,
    what: &str,
    module: &wgpu::ShaderModule,
    entry_point: &str,
    layouts: &[(u32, &wgpu::BindGroupLayout)],
) -> Result<wgpu::ComputePipeline, Error> {
    let device = &gpu.device;
    gpu.checked(what, || {
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &layout::by_group(layouts),
            immediate_size: 0,
        });
        device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(what),
            layout: Some(&layout),
            module,
            entry_point: Some(entry_point),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        })
    })
}

/// Encodes all of them.
pub(super) fn encode(passes: &[PreparedCompute], encoder: &mut wgpu::CommandEncoder) {
    if passes.is_empty() {
        return;
    }
    let mut compute = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
    for pass in passes {
        compute.set_pipeline(&pass.pipeline);
        for dispatch in &pass.dispatches {
            for (group, bindings) in &dispatch.groups {
                compute.set_bind_group(*group, bindings, &[]);
            }
            let [x, y] = dispatch.workgroups;
            compute.dispatch_workgroups(x, y, 1);
        }
    }
}
