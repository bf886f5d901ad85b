//! One pipeline of a frame, and its bind groups.

use std::collections::BTreeMap;

use preshade_plan::frame::{ColorAttachments, FramePass};
use preshade_plan::plan::{GpuPass, Plan};
use preshade_plan::safety::Checks;
use preshade_plan::state::ColorTarget;

use super::compiled::{self, Compiled, RenderKey, VertexLayout};
use super::gpu::Gpu;
use super::inputs::{self, DrawInputs};
use super::layout::{self, Groups, RendererGeometry};
use super::shader::ShaderStageRef;
use super::targets::Targets;
use super::{Error, state};

/// Draws of one material pass share a pipeline if their vertices and bindings have the same layouts.
#[derive(Clone, PartialEq)]
pub(super) struct PipelineKey {
    pub material: usize,
    pub member: usize,
    pub vertex: Vec<VertexLayout>,
    pub bindings: Vec<wgpu::BindGroupLayoutEntry>,
    pub strip: Option<wgpu::IndexFormat>,
}

/// The inputs of one pipeline.
pub(super) struct Build<'b> {
    pub gpu: &'b Gpu,
    pub compiled: Option<&'b Compiled>,
    pub targets: &'b Targets,
    pub shaders: &'b BTreeMap<&'b str, wgpu::ShaderModule>,
    pub plan: &'b Plan,
    pub pass: &'b GpuPass,
    pub stages: &'b (ShaderStageRef, Option<ShaderStageRef>),
    pub frame: &'b FramePass,
    pub draw: &'b DrawInputs,
    /// The draw in the previous frame.
    pub previous: &'b DrawInputs,
    pub made: RendererGeometry<'b>,
}

impl Build<'_> {
    fn failed(&self, message: impl Into<String>) -> Error {
        Error::Plan {
            material: self.plan.material.clone(),
            message: message.into(),
        }
    }

    fn what(&self) -> String {
        format!(
            "the pipeline of pass `{}` of material `{}`",
            self.pass.program, self.plan.material
        )
    }

    /// Fails if the adapter lacks a requirement of the pass.
    pub fn requirements(&self) -> Result<(), Error> {
        let what = self.what();
        for feature in &self.pass.features {
            self.gpu.require(&what, feature)?;
        }
        self.gpu.require_limits(&what, &self.pass.limits)?;
        if self.pass.primitive.unclipped_depth {
            self.gpu.require(&what, "depth-clip-control")?;
        }
        Ok(())
    }

    fn shader(&self, stage: &ShaderStageRef) -> Result<&wgpu::ShaderModule, Error> {
        self.shaders
            .get(stage.shader.as_str())
            .ok_or_else(|| self.failed(format!("there is no shader `{}`", stage.shader)))
    }

    pub fn strip_format(&self) -> Option<wgpu::IndexFormat> {
        let strip = state::primitive(&self.pass.primitive).topology.is_strip();
        self.draw
            .indices
            .as_ref()
            .filter(|_| strip)
            .map(|i| i.format)
    }

    /// The buffers and attributes that the pass reads, by location, in the scene's layout.
    pub fn vertex_layout(&self) -> Result<Vec<VertexLayout>, Error> {
        let mut layouts: Vec<VertexLayout> = Vec::new();
        for wanted in &self.pass.attributes {
            let (of, first) = match wanted.previous_of {
                None => (self.draw, 0),
                Some(_) => (self.previous, self.draw.vertex_buffers.len()),
            };
            let location = wanted.previous_of.unwrap_or(wanted.location);
            let (source, buffer, attribute) = (first..)
                .zip(&of.vertex_buffers)
                .find_map(|(i, b)| {
                    let a = b.attributes.iter().find(|a| a.location == location)?;
                    Some((i, b, a))
                })
                .ok_or_else(|| {
                    self.failed(format!(
                        "its attribute `{}` at location {} is not one the author's vertex stage reads",
                        wanted.name, wanted.location
                    ))
                })?;
            if !feeds(attribute.format, &wanted.ty) {
                return Err(self.failed(format!(
                    "its attribute `{}` at location {} is a {}, which {:?} does not feed",
                    wanted.name, wanted.location, wanted.ty, attribute.format
                )));
            }
            let at = wgpu::VertexAttribute {
                format: attribute.format,
                offset: attribute.offset,
                shader_location: wanted.location,
            };
            match layouts.iter_mut().find(|l| l.source == source) {
                Some(layout) => layout.attributes.push(at),
                None => layouts.push(VertexLayout {
                    source,
                    stride: buffer.stride,
                    step: buffer.step,
                    attributes: vec![at],
                }),
            }
        }
        Ok(layouts)
    }

    /// The resources of the pass, by group.
    pub fn filled(&self) -> Result<Groups<'_>, Error> {
        layout::fill(
            &self.pass.bindings,
            [self.draw, self.previous],
            self.targets,
            self.made,
            &self.gpu.device.limits(),
        )
        .map_err(|m| self.failed(m))
    }

    /// Layout and bind group of each group.
    pub fn groups(
        &self,
        filled: &Groups<'_>,
    ) -> Result<Vec<(u32, wgpu::BindGroupLayout, wgpu::BindGroup)>, Error> {
        let what = format!("the bindings of {}", self.what());
        layout::bind(self.gpu, self.compiled, &what, filled)
    }

    fn depth_stencil(&self) -> Result<Option<wgpu::DepthStencilState>, Error> {
        let Some(depth) = &self.pass.depth else {
            return Ok(None);
        };
        let target = self
            .targets
            .depth(&depth.attachment)
            .ok_or_else(|| self.failed(format!("it has no attachment `{}`", depth.attachment)))?;
        if depth.read_only && depth.write {
            return Err(self.failed(format!(
                "pass `{}` writes `{}`, which it binds read-only",
                self.pass.program, depth.attachment
            )));
        }
        self.check_samples(&depth.attachment, target.samples)?;
        Ok(Some(state::depth_stencil(
            target.format,
            depth,
            self.pass.stencil.as_ref(),
        )))
    }

    /// Fails unless an attachment has the pass's sample count.
    fn check_samples(&self, attachment: &str, samples: u32) -> Result<(), Error> {
        match self.pass.multisample.count {
            n if n == samples => Ok(()),
            n => Err(self.failed(format!(
                "pass `{}` draws {n} samples a pixel, and `{attachment}` has {samples}",
                self.pass.program
            ))),
        }
    }

    /// The colour targets of the frame pass with this pass's blending and masks. Targets that it
    /// does not write have an empty mask.
    fn color_targets(&self) -> Result<Vec<Option<wgpu::ColorTargetState>>, Error> {
        let formats: Vec<Option<wgpu::TextureFormat>> = match &self.frame.colors {
            ColorAttachments::None => Vec::new(),
            ColorAttachments::Scene => {
                let scene = self.targets.colors.iter();
                scene.map(|slot| Some(slot.as_ref()?.format)).collect()
            }
            ColorAttachments::Named(names) => names
                .iter()
                .zip(&self.pass.targets)
                .map(|(name, own)| {
                    let Some(name) = name else { return Ok(None) };
                    let target = self.targets.named(name);
                    let target = target
                        .ok_or_else(|| self.failed(format!("it has no attachment `{name}`")))?;
                    self.check_samples(name, target.samples())?;
                    let planned = own.as_ref().map(|t| t.format.as_str());
                    let format = target.format();
                    match planned.and_then(state::color_format) {
                        Some(planned) if planned == format => Ok(Some(format)),
                        _ => Err(self.failed(format!(
                            "pass `{}` draws {} to `{name}`, which is {format:?}",
                            self.pass.program,
                            planned.unwrap_or("nothing"),
                        ))),
                    }
                })
                .collect::<Result<_, Error>>()?,
        };
        Ok(formats
            .into_iter()
            .enumerate()
            .map(|(location, format)| {
                let format = format?;
                let own = self.pass.targets.get(location).and_then(Option::as_ref);
                Some(wgpu::ColorTargetState {
                    format,
                    blend: own
                        .and_then(|t: &ColorTarget| t.blend)
                        .as_ref()
                        .map(state::blend),
                    write_mask: own.map_or(wgpu::ColorWrites::empty(), |t| {
                        wgpu::ColorWrites::from_bits_truncate(u32::from(t.write_mask))
                    }),
                })
            })
            .collect())
    }

    pub fn pipeline(
        &self,
        blank: &wgpu::ShaderModule,
        layouts: &[(u32, &wgpu::BindGroupLayout)],
        key: &PipelineKey,
    ) -> Result<wgpu::RenderPipeline, Error> {
        let what = self.what();
        let depth_stencil = self.depth_stencil()?;
        let targets = self.color_targets()?;
        // A pipeline must have the colour targets of its render pass, and only a fragment stage can
        // declare them.
        let (vertex, fragment) = self.stages;
        let vertex = (self.shader(vertex)?, vertex.entry_point.as_str());
        let fragment = match fragment {
            Some(stage) => Some((self.shader(stage)?, stage.entry_point.as_str())),
            None if !targets.is_empty() => Some((blank, BLANK)),
            None => None,
        };
        let by_group = layout::by_group(layouts);
        let immediates = inputs::immediate_size(&self.pass.limits);
        let buffers: Vec<_> = key
            .vertex
            .iter()
            .map(|v| {
                Some(wgpu::VertexBufferLayout {
                    array_stride: v.stride,
                    step_mode: v.step,
                    attributes: &v.attributes,
                })
            })
            .collect();
        let mut primitive = state::primitive(&self.pass.primitive);
        primitive.strip_index_format = key.strip;
        let multisample = state::multisample(&self.pass.multisample);
        let of_stage = |(module, entry): (&wgpu::ShaderModule, &str)| {
            let module: wgpu::ShaderModule = module.clone();
            (module, entry.to_owned())
        };
        let all = || RenderKey {
            vertex: of_stage(vertex),
            fragment: fragment.map(of_stage),
            layouts: by_group.iter().map(|l| l.cloned()).collect(),
            immediates,
            buffers: key.vertex.clone(),
            primitive,
            depth_stencil: depth_stencil.clone(),
            multisample,
            targets: targets.clone(),
        };
        let device = &self.gpu.device;
        let build = || {
            let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: None,
                bind_group_layouts: &by_group,
                immediate_size: immediates,
            });
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(&what),
                layout: Some(&layout),
                vertex: wgpu::VertexState {
                    module: vertex.0,
                    entry_point: Some(vertex.1),
                    compilation_options: compilation(),
                    buffers: &buffers,
                },
                primitive,
                depth_stencil: depth_stencil.clone(),
                multisample,
                fragment: fragment.map(|(module, entry)| wgpu::FragmentState {
                    module,
                    entry_point: Some(entry),
                    compilation_options: compilation(),
                    targets: &targets,
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        compiled::shared(self.compiled.map(|c| &c.render), all, || {
            self.gpu.checked(&what, build)
        })
    }
}

/// Whether a vertex format can feed an attribute of WGSL type `ty`: the scalar kinds must match,
/// vector sizes may differ.
fn feeds(format: wgpu::VertexFormat, ty: &str) -> bool {
    let scalar = ty
        .rsplit_once('<')
        .map_or(ty, |(_, inner)| inner.trim_end_matches('>'));
    // wgpu's variants have the names of WebGPU's formats.
    let format = format!("{format:?}");
    match scalar {
        "u32" => format.starts_with("Uint"),
        "i32" => format.starts_with("Sint"),
        "f32" | "f16" => !format.starts_with("Uint") && !format.starts_with("Sint"),
        _ => false,
    }
}

fn compilation() -> wgpu::PipelineCompilationOptions<'static> {
    wgpu::PipelineCompilationOptions::default()
}

const BLANK: &str = "blank";

pub(super) fn blank_fragment(
    gpu: &Gpu,
    compiled: Option<&Compiled>,
) -> Result<wgpu::ShaderModule, Error> {
    let blank = ("@fragment fn blank() {}", Checks::default());
    compiled::shader(gpu, compiled, BLANK, blank)
}
