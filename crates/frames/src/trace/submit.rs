//! Converts the work of the queue: copies, clears and passes.

use wgpu_core::command::{
    Command as CoreCommand, LoadOp, PointerReferences, RenderPassColorAttachment,
    ResolvedPassChannel, ResolvedRenderPassDepthStencilAttachment,
};
use wgpu_core::id::{PointerId, markers};

use super::recorder::{Recorder, Step};
use super::{FramesBy, OrRefusal, objects, passes, refusal};
use crate::file::{
    BufferPlace, Color, ColorAttachment, Command, DepthAttachment, Load, RenderPassDescriptor,
    Store, TexelLayout,
};

type View = PointerId<markers::TextureView>;

impl Recorder {
    /// Converts the commands of a submission. If it draws, it ends a frame of an app without a
    /// window.
    pub(super) fn submit(&mut self, commands: Vec<CoreCommand<PointerReferences>>) {
        let first = self.steps.len();
        for command in commands {
            self.command(command);
        }
        let passes = self.steps[first..].iter().rev();
        let mut passes = passes.filter_map(|step| match &step.command {
            Some(Command::RenderPass { descriptor, .. }) => Some(shown(descriptor)),
            _ => None,
        });
        if let Some(last) = passes.next() {
            let canvas = last.or_else(|| passes.flatten().next());
            self.mark(canvas, None, FramesBy::Submit);
        }
    }

    fn command(&mut self, command: CoreCommand<PointerReferences>) {
        match command {
            CoreCommand::RunRenderPass {
                pass,
                color_attachments,
                depth_stencil_attachment,
                multiview_mask,
                ..
            } => {
                if multiview_mask.is_some() {
                    self.step(Err(refusal(
                        "a render pass",
                        "it draws several views at once",
                    )));
                    return;
                }
                let label = objects::label(pass.label.as_deref());
                let made = self.descriptor(label, &color_attachments, depth_stencil_attachment);
                let kept = passes::drawn(&self.ids, &pass);
                match made {
                    Ok(descriptor) => self.steps.push(Step {
                        command: Some(Command::RenderPass {
                            descriptor,
                            commands: kept.commands,
                        }),
                        refused: kept.refused,
                    }),
                    Err(why) => self.step(Err(why)),
                }
            }
            CoreCommand::RunComputePass { pass, .. } => {
                let kept = passes::computed(&self.ids, &pass);
                self.steps.push(Step {
                    command: Some(Command::ComputePass {
                        label: objects::label(pass.label.as_deref()),
                        commands: kept.commands,
                    }),
                    refused: kept.refused,
                });
            }
            CoreCommand::WriteTimestamp { .. } | CoreCommand::ResolveQuerySet { .. } => {
                self.step(Err(refusal("a query", "its result")));
            }
            CoreCommand::BuildAccelerationStructures { .. } => {
                self.step(Err(refusal("an acceleration structure", "rays need it")));
            }
            CoreCommand::PushDebugGroup(_)
            | CoreCommand::PopDebugGroup
            | CoreCommand::InsertDebugMarker(_)
            | CoreCommand::TransitionResources { .. } => {}
            copy => {
                let made = self.copy(copy);
                self.step(made);
            }
        }
    }

    fn copy(&mut self, command: CoreCommand<PointerReferences>) -> OrRefusal<Command> {
        let buffer = |id| self.ids.buffers.get(id);
        let place =
            |of: &wgpu::TexelCopyBufferInfoBase<PointerId<markers::Buffer>>| -> OrRefusal<BufferPlace> {
                Ok(BufferPlace {
                    buffer: self.ids.buffers.get(of.buffer)?,
                    layout: TexelLayout {
                        offset: of.layout.offset,
                        bytes_per_row: of.layout.bytes_per_row,
                        rows_per_image: of.layout.rows_per_image,
                    },
                })
            };
        Ok(match command {
            CoreCommand::CopyBufferToBuffer {
                src,
                src_offset,
                dst,
                dst_offset,
                size,
            } => Command::CopyBufferToBuffer {
                source: buffer(src)?,
                source_offset: src_offset,
                destination: buffer(dst)?,
                destination_offset: dst_offset,
                size,
            },
            CoreCommand::CopyBufferToTexture { src, dst, size } => Command::CopyBufferToTexture {
                source: place(&src)?,
                destination: self.place(&dst)?,
                size: objects::extent(size),
            },
            CoreCommand::CopyTextureToBuffer { src, dst, size } => Command::CopyTextureToBuffer {
                source: self.place(&src)?,
                destination: place(&dst)?,
                size: objects::extent(size),
            },
            CoreCommand::CopyTextureToTexture { src, dst, size } => Command::CopyTextureToTexture {
                source: self.place(&src)?,
                destination: self.place(&dst)?,
                size: objects::extent(size),
            },
            CoreCommand::ClearBuffer { dst, offset, size } => Command::ClearBuffer {
                buffer: buffer(dst)?,
                offset,
                size,
            },
            CoreCommand::ClearTexture { .. } => {
                return Err(refusal("a clear of a texture", "outside a render pass"));
            }
            _ => return Err(refusal("a command", "this version does not know it")),
        })
    }

    fn descriptor(
        &self,
        label: String,
        colors: &[Option<RenderPassColorAttachment<View>>],
        depth: Option<ResolvedRenderPassDepthStencilAttachment<View>>,
    ) -> OrRefusal<RenderPassDescriptor> {
        let color = |a: &RenderPassColorAttachment<View>| -> OrRefusal<ColorAttachment> {
            let resolve = a.resolve_target.map(|r| self.ids.views.get(r));
            let (load_op, clear) = load(a.load_op);
            Ok(ColorAttachment {
                view: self.ids.views.get(a.view)?,
                depth_slice: a.depth_slice,
                resolve_target: resolve.transpose()?,
                load_op,
                store_op: store(a.store_op),
                clear_value: clear.map(|c| Color::List([c.r, c.g, c.b, c.a].map(Some))),
            })
        };
        let colors = colors.iter().map(|a| a.as_ref().map(color).transpose());
        let depth = depth.map(|d| -> OrRefusal<DepthAttachment> {
            let (depth_load_op, depth_store_op, depth_clear_value) = channel(&d.depth);
            let (stencil_load_op, stencil_store_op, stencil_clear) = channel(&d.stencil);
            Ok(DepthAttachment {
                view: self.ids.views.get(d.view)?,
                depth_load_op,
                depth_store_op,
                depth_clear_value,
                depth_read_only: depth_load_op.is_none(),
                stencil_load_op,
                stencil_store_op,
                stencil_clear_value: stencil_clear.unwrap_or(0),
                stencil_read_only: stencil_load_op.is_none(),
            })
        });
        Ok(RenderPassDescriptor {
            label,
            color_attachments: colors.collect::<OrRefusal<Vec<_>>>()?,
            depth_stencil_attachment: depth.transpose()?,
        })
    }
}

/// The resolved first colour target, which stands for the picture of an app without a window.
fn shown(pass: &RenderPassDescriptor) -> Option<usize> {
    let first = pass.color_attachments.iter().flatten().next()?;
    let view = first.resolve_target.as_ref().unwrap_or(&first.view);
    Some(view.texture)
}

/// Converts a load operation. Content that the app does not care about is cleared.
fn load<V>(of: LoadOp<V>) -> (Load, Option<V>) {
    match of {
        LoadOp::Clear(value) => (Load::Clear, Some(value)),
        LoadOp::Load => (Load::Load, None),
        LoadOp::DontCare(_) => (Load::Clear, None),
    }
}

fn store(of: wgpu::StoreOp) -> Store {
    match of {
        wgpu::StoreOp::Store => Store::Store,
        wgpu::StoreOp::Discard => Store::Discard,
    }
}

/// The load, store and clear of a channel. All `None` if the channel is read-only.
fn channel<V: Copy>(of: &ResolvedPassChannel<V>) -> (Option<Load>, Option<Store>, Option<V>) {
    match of {
        ResolvedPassChannel::ReadOnly => (None, None, None),
        ResolvedPassChannel::Operational(ops) => {
            let (load, clear) = load(ops.load);
            (Some(load), Some(store(ops.store)), clear)
        }
    }
}
