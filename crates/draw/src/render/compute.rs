//! The compute passes of a frame's plans: pipelines, and one dispatch per draw.

use std::collections::BTreeMap;

use preshade_plan::geometry::Geometry;
use preshade_plan::plan::{ComputePass, Draws, Plan, When};

use super::Error;
use super::compiled::{self, Compiled, ComputeKey};
use super::frame_draw_table::{Arguments, DrawTable};
use super::gpu::Gpu;
use super::inputs::{SceneInputs, immediate_size};
use super::layout::{self, RendererGeometry};
use super::limits::rows;
use super::shader::Variant;
use super::subdivided::Meshes;
use super::targets::Targets;

/// A compute pass and the draws of its material.
pub(super) struct PreparedCompute {
    pipeline: wgpu::ComputePipeline,
    dispatches: Vec<Dispatch>,
    when: When,
}

struct Dispatch {
    groups: Vec<(u32, wgpu::BindGroup)>,
    /// Index of the draw, and the size of its immediate data in bytes.
    immediates: (usize, u32),
    workgroups: Workgroups,
}

enum Workgroups {
    Of([u32; 2]),
    Indirect(Arguments),
}

/// The compute passes of all plans, in order.
///
/// # Errors
/// As for the raster passes of a frame.
pub(super) fn prepare(
    inputs: &SceneInputs<'_>,
    variant: &Variant,
    shaders: &BTreeMap<&str, wgpu::ShaderModule>,
    targets: &Targets,
    meshes: &mut Meshes,
    table: &DrawTable,
) -> Result<Vec<PreparedCompute>, Error> {
    let (gpu, scene) = (inputs.gpu(), inputs.scene());
    let mut prepared = Vec::new();
    // Passes that all plans share.
    let mut once: Vec<&ComputePass> = Vec::new();
    for (plan, stages) in variant.compute() {
        for (pass, stage) in plan.compute.iter().zip(stages) {
            let is_once = pass.draws == Draws::Once;
            if is_once && once.contains(&pass) {
                continue;
            }
            once.extend(is_once.then_some(pass));
            let failed = |message: String| failed(plan, message);
            let what = format!("the compute pass of material `{}`", plan.material);
            for feature in &pass.features {
                gpu.require(&what, feature)?;
            }
            gpu.require_limits(&what, &pass.limits)?;
            let shader = shaders
                .get(stage.shader.as_str())
                .ok_or_else(|| failed(format!("there is no shader `{}`", stage.shader)))?;
            let immediates = immediate_size(&pass.limits);
            let mut pipeline = None;
            let mut dispatches = Vec::new();
            for (index, draw) in scene.draws.iter().enumerate() {
                let material = scene.materials.get(draw.material);
                let Some(material) = material.filter(|m| m.name == plan.material) else {
                    continue;
                };
                if pass.draws == Draws::Opaque && material.state.is_blended() {
                    continue;
                }
                let Some(bound) = inputs.draw(index) else {
                    continue;
                };
                let subdivided = meshes
                    .of(gpu, plan, &pass.geometry, &pass.bindings, (index, bound))
                    .map_err(failed)?;
                let drawn = table
                    .of(gpu, &pass.bindings, (index, bound, bound))
                    .map_err(failed)?;
                let (made, workgroups) = match (&subdivided, &pass.geometry) {
                    (Some(subdivided), _) => (
                        RendererGeometry::Subdivided(subdivided, &drawn),
                        Workgroups::Of(subdivided.mesh.workgroups(pass.workgroup)),
                    ),
                    (None, Geometry::FullScreen) => (
                        RendererGeometry::Drawn(&drawn),
                        Workgroups::Of(scene.size.map(|s| s.div_ceil(pass.workgroup.max(1)))),
                    ),
                    (None, Geometry::Instances) => (
                        RendererGeometry::Drawn(&drawn),
                        Workgroups::Of(rows(bound.instances, pass.workgroup)),
                    ),
                    (None, Geometry::Vertices) => (
                        RendererGeometry::Drawn(&drawn),
                        Workgroups::Of(rows(bound.vertex_count * bound.instances, pass.workgroup)),
                    ),
                    (None, Geometry::Draw) => {
                        (RendererGeometry::Drawn(&drawn), Workgroups::Of([1, 1]))
                    }
                    (None, Geometry::Indirect { buffer }) => (
                        RendererGeometry::Drawn(&drawn),
                        Workgroups::Indirect(table.arguments(buffer, &drawn).map_err(failed)?),
                    ),
                    (None, _) => return Err(failed("it computes no geometry".to_owned())),
                };
                let filled = layout::fill(
                    &pass.bindings,
                    [bound; 2],
                    targets,
                    made,
                    &gpu.device.limits(),
                )
                .map_err(failed)?;
                let groups = layout::bind(gpu, inputs.compiled(), &what, &filled)?;
                if pipeline.is_none() {
                    let layouts: Vec<_> = groups.iter().map(|(g, l, _)| (*g, l)).collect();
                    let module = (shader, stage.entry_point.as_str());
                    let layouts = (layouts.as_slice(), immediates);
                    pipeline = Some(build(gpu, inputs.compiled(), &what, module, layouts)?);
                }
                dispatches.push(Dispatch {
                    groups: groups.into_iter().map(|(g, _, b)| (g, b)).collect(),
                    immediates: (index, immediates),
                    workgroups,
                });
                if is_once {
                    break;
                }
            }
            prepared.extend(pipeline.map(|pipeline| PreparedCompute {
                pipeline,
                dispatches,
                when: pass.when.clone(),
            }));
        }
    }
    // Passes after one phase run before those after the next, across all materials.
    prepared.sort_by_key(|p| p.when.phase());
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
    compiled: Option<&Compiled>,
    what: &str,
    (module, entry_point): (&wgpu::ShaderModule, &str),
    (layouts, immediates): (&[(u32, &wgpu::BindGroupLayout)], u32),
) -> Result<wgpu::ComputePipeline, Error> {
    let device = &gpu.device;
    let by_group = layout::by_group(layouts);
    let key = || ComputeKey {
        stage: (module.clone(), entry_point.to_owned()),
        layouts: by_group.iter().map(|l| l.cloned()).collect(),
        immediates,
    };
    let make = || {
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &by_group,
            immediate_size: immediates,
        });
        device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(what),
            layout: Some(&layout),
            module,
            entry_point: Some(entry_point),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        })
    };
    compiled::shared(compiled.map(|c| &c.compute), key, || {
        gpu.checked(what, make)
    })
}

/// Encodes the passes that run at a point of the frame.
pub(super) fn encode(
    inputs: &SceneInputs<'_>,
    passes: &[PreparedCompute],
    then: impl Fn(&When) -> bool,
    encoder: &mut wgpu::CommandEncoder,
) {
    encode_those(inputs, passes.iter().filter(|p| then(&p.when)), encoder);
}

/// Runs the passes that run only once, at load.
///
/// # Errors
/// As reported by the adapter.
pub(crate) fn load(inputs: &SceneInputs<'_>, passes: &[PreparedCompute]) -> Result<(), Error> {
    let gpu = inputs.gpu();
    let once = || {
        let is_once = |p: &&PreparedCompute| matches!(p.when, When::Load { .. });
        passes.iter().filter(is_once)
    };
    if once().next().is_none() {
        return Ok(());
    }
    let what = "computing what is kept from load";
    let encoder = gpu.checked(what, || {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encode_those(inputs, once(), &mut encoder);
        encoder
    })?;
    gpu.submit(what, encoder)
}

fn encode_those<'p>(
    inputs: &SceneInputs<'_>,
    passes: impl Iterator<Item = &'p PreparedCompute>,
    encoder: &mut wgpu::CommandEncoder,
) {
    let mut passes = passes.peekable();
    if passes.peek().is_none() {
        return;
    }
    let mut compute = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
    for pass in passes {
        compute.set_pipeline(&pass.pipeline);
        for dispatch in &pass.dispatches {
            for (group, bindings) in &dispatch.groups {
                compute.set_bind_group(*group, bindings, &[]);
            }
            let (draw, size) = dispatch.immediates;
            if size > 0
                && let Some(draw) = inputs.draw(draw)
            {
                compute.set_immediates(0, &draw.immediates(size));
            }
            match &dispatch.workgroups {
                Workgroups::Of([x, y]) => compute.dispatch_workgroups(*x, *y, 1),
                Workgroups::Indirect(Arguments { buffer, offset }) => {
                    compute.dispatch_workgroups_indirect(buffer, *offset);
                }
            }
        }
    }
}
