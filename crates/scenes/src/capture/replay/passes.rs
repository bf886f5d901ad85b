//! Replays render and compute passes: creates the objects first, then encodes the commands.

use super::Replay;
use super::objects::index_format;
use crate::capture::Error;
use preshade_frames::file::{
    ComputeCommand, DepthAttachment, DrawCommand, Load, RenderPassDescriptor,
};
use preshade_frames::pass::{self, Step};

/// A render pass command with its objects. Draws with a refused pipeline or bind group are left
/// out.
pub(super) enum Encoded {
    Pipeline(wgpu::RenderPipeline),
    Group(u32, Option<wgpu::BindGroup>, Vec<u32>),
    Vertices(u32, Option<wgpu::Buffer>, u64, Option<u64>),
    Indices(wgpu::Buffer, wgpu::IndexFormat, u64, Option<u64>),
    Draw(std::ops::Range<u32>, std::ops::Range<u32>),
    DrawIndexed(std::ops::Range<u32>, i32, std::ops::Range<u32>),
    DrawIndirect(wgpu::Buffer, u64),
    DrawIndexedIndirect(wgpu::Buffer, u64),
    Viewport([f32; 6]),
    Scissor([u32; 4]),
    BlendConstant(wgpu::Color),
    StencilReference(u32),
}

/// Reasons to skip the next draws or dispatches.
#[derive(Default)]
struct Missing {
    /// Whether [`Replay::hide`] names the pipeline.
    hidden: bool,
    pipeline: Option<(String, String)>,
    groups: std::collections::BTreeMap<u32, (String, String)>,
}

impl Missing {
    fn first(&self) -> Option<&(String, String)> {
        self.pipeline
            .as_ref()
            .or_else(|| self.groups.values().next())
    }
}

impl Replay<'_> {
    pub(super) fn render_pass(
        &mut self,
        descriptor: &RenderPassDescriptor,
        commands: &[DrawCommand],
        place: &str,
    ) -> Result<(), Error> {
        let mut colors = Vec::new();
        for attachment in &descriptor.color_attachments {
            let made = attachment.as_ref().map(|a| {
                let resolve = a.resolve_target.as_ref().map(|r| self.view(r, place));
                Ok::<_, Error>((a, self.view(&a.view, place)?, resolve.transpose()?))
            });
            colors.push(made.transpose()?);
        }
        let depth = descriptor.depth_stencil_attachment.as_ref();
        let depth = depth.map(|d| {
            let format = self.texture(d.view.texture, place)?.format();
            Ok::<_, Error>((d, self.view(&d.view, place)?, format))
        });
        let depth = depth.transpose()?;
        let mut encoded = Vec::new();
        if self.capture.file.source.api.is_webgl() {
            for step in pass::steps(commands, place)? {
                encoded.extend(match step {
                    Step::Draw(draw) if self.hidden == Some(draw.pipeline) => Vec::new(),
                    Step::Draw(draw) => self.draw_of_webgl(&draw, place)?,
                    Step::Clear(clear) => self.partial_clear(clear, descriptor, place)?,
                });
            }
        } else {
            let mut missing = Missing::default();
            for command in commands {
                self.prepare(command, place, &mut encoded, &mut missing)?;
            }
        }
        let colors: Vec<Option<wgpu::RenderPassColorAttachment<'_>>> = colors
            .iter()
            .map(|c| {
                c.as_ref()
                    .map(|(a, view, resolve)| wgpu::RenderPassColorAttachment {
                        view,
                        depth_slice: a.depth_slice,
                        resolve_target: resolve.as_ref(),
                        ops: wgpu::Operations {
                            load: match a.load_op {
                                Load::Clear => wgpu::LoadOp::Clear(
                                    a.clear_value.map_or(wgpu::Color::TRANSPARENT, |c| c.wgpu()),
                                ),
                                Load::Load => wgpu::LoadOp::Load,
                            },
                            store: a.store_op.wgpu(),
                        },
                    })
            })
            .collect();
        let depth = depth
            .as_ref()
            .map(|(d, view, format)| depth_attachment(d, view, *format));
        let gpu = self.gpu;
        // Errors of a pass must not be reported for a later command.
        let label = format!("{place} {}", descriptor.label);
        let made = gpu.checked(&label, || {
            self.encode(|e| {
                let mut pass = e.begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some(&label),
                    color_attachments: &colors,
                    depth_stencil_attachment: depth,
                    ..Default::default()
                });
                for command in &encoded {
                    command.encode(&mut pass);
                }
            });
        });
        Ok(made?)
    }

    /// Creates the objects that a command needs.
    fn prepare(
        &mut self,
        command: &DrawCommand,
        place: &str,
        encoded: &mut Vec<Encoded>,
        missing: &mut Missing,
    ) -> Result<(), Error> {
        let is_draw = matches!(
            command,
            DrawCommand::Draw { .. }
                | DrawCommand::DrawIndexed { .. }
                | DrawCommand::DrawIndirect { .. }
                | DrawCommand::DrawIndexedIndirect { .. }
        );
        if is_draw && missing.hidden {
            return Ok(());
        }
        if is_draw && let Some((what, why)) = missing.first().cloned() {
            self.leave_out(format!("a draw with {what}"), why);
            return Ok(());
        }
        encoded.push(match command {
            DrawCommand::SetPipeline { pipeline } => {
                missing.hidden = self.hidden == Some(*pipeline);
                match self.render_pipeline(*pipeline, place)? {
                    Ok(made) => {
                        missing.pipeline = None;
                        Encoded::Pipeline(made)
                    }
                    Err(why) => {
                        missing.pipeline = Some((format!("render pipeline {pipeline}"), why));
                        return Ok(());
                    }
                }
            }
            DrawCommand::SetBindGroup {
                index,
                bind_group,
                dynamic_offsets,
            } => {
                let made = bind_group.map(|g| self.group(g, place)).transpose()?;
                match made.transpose() {
                    Ok(made) => {
                        missing.groups.remove(index);
                        Encoded::Group(*index, made, dynamic_offsets.clone())
                    }
                    Err(why) => {
                        let what = format!("bind group {}", bind_group.unwrap_or(0));
                        missing.groups.insert(*index, (what, why));
                        return Ok(());
                    }
                }
            }
            DrawCommand::SetVertexBuffer {
                slot,
                buffer,
                offset,
                size,
            } => {
                let buffer = buffer.map(|b| self.buffer(b, place).cloned()).transpose()?;
                Encoded::Vertices(*slot, buffer, *offset, *size)
            }
            DrawCommand::SetIndexBuffer {
                buffer,
                index_format: format,
                offset,
                size,
            } => {
                let buffer = self.buffer(*buffer, place)?.clone();
                Encoded::Indices(buffer, index_format(*format), *offset, *size)
            }
            DrawCommand::Draw {
                vertex_count,
                instance_count,
                first_vertex,
                first_instance,
            } => Encoded::Draw(
                range(*first_vertex, *vertex_count),
                range(*first_instance, *instance_count),
            ),
            DrawCommand::DrawIndexed {
                index_count,
                instance_count,
                first_index,
                base_vertex,
                first_instance,
            } => Encoded::DrawIndexed(
                range(*first_index, *index_count),
                *base_vertex,
                range(*first_instance, *instance_count),
            ),
            DrawCommand::DrawIndirect { buffer, offset } => {
                Encoded::DrawIndirect(self.buffer(*buffer, place)?.clone(), *offset)
            }
            DrawCommand::DrawIndexedIndirect { buffer, offset } => {
                Encoded::DrawIndexedIndirect(self.buffer(*buffer, place)?.clone(), *offset)
            }
            DrawCommand::SetViewport {
                x,
                y,
                width,
                height,
                min_depth,
                max_depth,
            } => Encoded::Viewport([*x, *y, *width, *height, *min_depth, *max_depth]),
            DrawCommand::SetScissorRect {
                x,
                y,
                width,
                height,
            } => Encoded::Scissor([*x, *y, *width, *height]),
            DrawCommand::SetBlendConstant { color } => Encoded::BlendConstant(color.wgpu()),
            DrawCommand::SetStencilReference { reference } => Encoded::StencilReference(*reference),
            DrawCommand::SetNamed { .. } | DrawCommand::Clear(_) => {
                return Err(Error::broken(
                    place,
                    "it has a command of WebGL, and the capture is not WebGL's",
                ));
            }
        });
        Ok(())
    }

    pub(super) fn compute_pass(
        &mut self,
        commands: &[ComputeCommand],
        place: &str,
    ) -> Result<(), Error> {
        enum Step {
            Pipeline(wgpu::ComputePipeline),
            Group(u32, Option<wgpu::BindGroup>, Vec<u32>),
            Dispatch([u32; 3]),
            Indirect(wgpu::Buffer, u64),
        }
        let mut steps = Vec::new();
        let mut missing = Missing::default();
        for command in commands {
            steps.push(match command {
                ComputeCommand::SetPipeline { pipeline } => {
                    match self.compute_pipeline(*pipeline, place)? {
                        Ok(made) => {
                            missing.pipeline = None;
                            Step::Pipeline(made)
                        }
                        Err(why) => {
                            missing.pipeline = Some((format!("compute pipeline {pipeline}"), why));
                            continue;
                        }
                    }
                }
                ComputeCommand::SetBindGroup {
                    index,
                    bind_group,
                    dynamic_offsets,
                } => {
                    let made = bind_group.map(|g| self.group(g, place)).transpose()?;
                    match made.transpose() {
                        Ok(made) => {
                            missing.groups.remove(index);
                            Step::Group(*index, made, dynamic_offsets.clone())
                        }
                        Err(why) => {
                            let what = format!("bind group {}", bind_group.unwrap_or(0));
                            missing.groups.insert(*index, (what, why));
                            continue;
                        }
                    }
                }
                dispatch => {
                    if let Some((what, why)) = missing.first() {
                        self.leave_out(format!("a dispatch with {what}"), why.clone());
                        continue;
                    }
                    match dispatch {
                        ComputeCommand::DispatchWorkgroupsIndirect { buffer, offset } => {
                            Step::Indirect(self.buffer(*buffer, place)?.clone(), *offset)
                        }
                        ComputeCommand::DispatchWorkgroups { x, y, z } => {
                            Step::Dispatch([*x, *y, *z])
                        }
                        _ => continue,
                    }
                }
            });
        }
        let gpu = self.gpu;
        let made = gpu.checked(place, || {
            self.encode(|e| {
                let mut pass = e.begin_compute_pass(&Default::default());
                for step in &steps {
                    match step {
                        Step::Pipeline(pipeline) => pass.set_pipeline(pipeline),
                        Step::Group(index, group, offsets) => {
                            pass.set_bind_group(*index, group.as_ref(), offsets);
                        }
                        Step::Dispatch([x, y, z]) => pass.dispatch_workgroups(*x, *y, *z),
                        Step::Indirect(buffer, offset) => {
                            pass.dispatch_workgroups_indirect(buffer, *offset);
                        }
                    }
                }
            });
        });
        Ok(made?)
    }
}

impl Encoded {
    fn encode(&self, pass: &mut wgpu::RenderPass<'_>) {
        match self {
            Self::Pipeline(pipeline) => pass.set_pipeline(pipeline),
            Self::Group(index, group, offsets) => {
                pass.set_bind_group(*index, group.as_ref(), offsets);
            }
            Self::Vertices(slot, Some(buffer), offset, size) => {
                pass.set_vertex_buffer(*slot, part(buffer, *offset, *size));
            }
            Self::Vertices(_, None, ..) => {}
            Self::Indices(buffer, format, offset, size) => {
                pass.set_index_buffer(part(buffer, *offset, *size), *format);
            }
            Self::Draw(vertices, instances) => pass.draw(vertices.clone(), instances.clone()),
            Self::DrawIndexed(indices, base, instances) => {
                pass.draw_indexed(indices.clone(), *base, instances.clone());
            }
            Self::DrawIndirect(buffer, offset) => pass.draw_indirect(buffer, *offset),
            Self::DrawIndexedIndirect(buffer, offset) => {
                pass.draw_indexed_indirect(buffer, *offset);
            }
            Self::Viewport([x, y, width, height, near, far]) => {
                pass.set_viewport(*x, *y, *width, *height, *near, *far);
            }
            Self::Scissor([x, y, width, height]) => {
                pass.set_scissor_rect(*x, *y, *width, *height);
            }
            Self::BlendConstant(color) => pass.set_blend_constant(*color),
            Self::StencilReference(reference) => pass.set_stencil_reference(*reference),
        }
    }
}

fn part(buffer: &wgpu::Buffer, offset: u64, size: Option<u64>) -> wgpu::BufferSlice<'_> {
    match size {
        Some(size) => buffer.slice(offset..offset.saturating_add(size)),
        None => buffer.slice(offset..),
    }
}

fn range(first: u32, count: u32) -> std::ops::Range<u32> {
    first..first.saturating_add(count)
}

fn depth_attachment<'v>(
    of: &DepthAttachment,
    view: &'v wgpu::TextureView,
    format: wgpu::TextureFormat,
) -> wgpu::RenderPassDepthStencilAttachment<'v> {
    let depth_ops = wgpu::Operations {
        load: match of.depth_load_op {
            Some(Load::Clear) => wgpu::LoadOp::Clear(of.depth_clear_value.unwrap_or(0.0)),
            _ => wgpu::LoadOp::Load,
        },
        store: of.depth_store_op.unwrap_or_default().wgpu(),
    };
    let stencil_ops = wgpu::Operations {
        load: match of.stencil_load_op {
            Some(Load::Clear) => wgpu::LoadOp::Clear(of.stencil_clear_value),
            _ => wgpu::LoadOp::Load,
        },
        store: of.stencil_store_op.unwrap_or_default().wgpu(),
    };
    wgpu::RenderPassDepthStencilAttachment {
        view,
        depth_ops: (format.has_depth_aspect() && !of.depth_read_only).then_some(depth_ops),
        stencil_ops: (format.has_stencil_aspect() && !of.stencil_read_only).then_some(stencil_ops),
    }
}
