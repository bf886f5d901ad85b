//! Converts commands of render and compute passes, with numbers for objects. Draws that use a
//! refused object are left out and counted. Bundles are expanded.

use std::collections::BTreeMap;
use std::convert::Infallible;

use wgpu_core::command::{
    BasePass, ComputeCommand as CoreComputeCommand, DrawCommandFamily, PointerReferences,
    RenderCommand,
};

use super::ids::{Ids, Usable};
use super::objects::index_format;
use super::{OrRefusal, Refusal, refusal};
use crate::file::{Color, ComputeCommand, DrawCommand};

/// Bound objects that were refused: the next draws or dispatches cannot be written.
#[derive(Default)]
struct Missing {
    pipeline: Option<Refusal>,
    groups: BTreeMap<u32, Refusal>,
    /// Vertex buffers by slot; the index buffer is the last slot.
    buffers: BTreeMap<u32, Refusal>,
}

const INDICES: u32 = u32::MAX;

/// Limit on the draws of one indirect command.
const MOST_INDIRECT: u64 = 1 << 20;

impl Missing {
    fn first(&self) -> Option<&Refusal> {
        let groups = self.groups.values();
        self.pipeline
            .iter()
            .chain(groups)
            .chain(self.buffers.values())
            .next()
    }
}

/// State of a pass or bundle that is being converted.
struct Pass<'i, C> {
    ids: &'i Ids,
    kept: Usable<C>,
    missing: Missing,
    offsets: std::vec::IntoIter<u32>,
}

type CorePass<C> = BasePass<C, Infallible>;

/// The commands of a render pass or bundle.
pub(super) fn drawn(
    ids: &Ids,
    pass: &CorePass<RenderCommand<PointerReferences>>,
) -> Usable<DrawCommand> {
    let mut made = Pass {
        ids,
        kept: Usable::default(),
        missing: Missing::default(),
        offsets: pass.dynamic_offsets.clone().into_iter(),
    };
    for command in &pass.commands {
        made.command(command);
    }
    made.kept
}

impl<C> Pass<'_, C> {
    fn push(&mut self, command: C) {
        self.kept.commands.push(command);
    }

    fn refuse(&mut self, what: &str, why: &str) {
        self.kept.refused.push(refusal(what, why));
    }

    /// Adds a draw or dispatch, unless an object that it needs was refused.
    fn act(&mut self, made: OrRefusal<C>) {
        match (self.missing.first(), made) {
            (Some(missing), _) => self.kept.refused.push(missing.clone()),
            (None, Err(why)) => self.kept.refused.push(why),
            (None, Ok(command)) => self.push(command),
        }
    }

    fn pipeline(&mut self, made: OrRefusal<usize>, command: impl FnOnce(usize) -> C) {
        self.missing.pipeline = made.as_ref().err().cloned();
        if let Ok(pipeline) = made {
            self.push(command(pipeline));
        }
    }

    fn group(
        &mut self,
        index: u32,
        offsets: usize,
        made: Option<OrRefusal<usize>>,
        command: impl FnOnce(Option<usize>, Vec<u32>) -> C,
    ) {
        let dynamic_offsets = self.offsets.by_ref().take(offsets).collect();
        match made.transpose() {
            Ok(group) => {
                self.missing.groups.remove(&index);
                self.push(command(group, dynamic_offsets));
            }
            Err(why) => {
                self.missing.groups.insert(index, why);
            }
        }
    }
}

impl Pass<'_, DrawCommand> {
    fn command(&mut self, command: &RenderCommand<PointerReferences>) {
        use RenderCommand as R;
        match command {
            R::SetBindGroup {
                index,
                num_dynamic_offsets,
                bind_group,
            } => {
                let index = *index;
                let made = bind_group.map(|g| self.ids.groups.get(g));
                self.group(
                    index,
                    *num_dynamic_offsets,
                    made,
                    |bind_group, dynamic_offsets| DrawCommand::SetBindGroup {
                        index,
                        bind_group,
                        dynamic_offsets,
                    },
                );
            }
            R::SetPipeline(id) => {
                let made = self.ids.render_pipelines.get(*id);
                self.pipeline(made, |pipeline| DrawCommand::SetPipeline { pipeline });
            }
            R::SetIndexBuffer { .. } | R::SetVertexBuffer { .. } => self.buffer(command),
            R::SetBlendConstant(c) => self.push(DrawCommand::SetBlendConstant {
                color: Color::List([c.r, c.g, c.b, c.a].map(Some)),
            }),
            R::SetStencilReference(reference) => self.push(DrawCommand::SetStencilReference {
                reference: *reference,
            }),
            R::SetViewport {
                rect,
                depth_min,
                depth_max,
            } => self.push(DrawCommand::SetViewport {
                x: rect.x,
                y: rect.y,
                width: rect.w,
                height: rect.h,
                min_depth: *depth_min,
                max_depth: *depth_max,
            }),
            R::SetScissor(rect) => self.push(DrawCommand::SetScissorRect {
                x: rect.x,
                y: rect.y,
                width: rect.w,
                height: rect.h,
            }),
            R::ExecuteBundle(id) => self.bundle(*id),
            R::Draw { .. }
            | R::DrawIndexed { .. }
            | R::DrawMeshTasks { .. }
            | R::DrawIndirect { .. }
            | R::MultiDrawIndirectCount { .. } => self.draw(command),
            R::BeginOcclusionQuery { .. } => self.refuse("an occlusion query", "its result"),
            R::BeginPipelineStatisticsQuery { .. } => {
                self.refuse("a statistics query", "its result")
            }
            R::WriteTimestamp { .. } => self.refuse("a timestamp", "its result"),
            // Immediates belong to pipelines that are refused.
            R::SetImmediate { .. }
            | R::EndOcclusionQuery
            | R::EndPipelineStatisticsQuery
            | R::PushDebugGroup { .. }
            | R::PopDebugGroup
            | R::InsertDebugMarker { .. } => {}
        }
    }

    fn buffer(&mut self, command: &RenderCommand<PointerReferences>) {
        let (slot, made) = match command {
            RenderCommand::SetIndexBuffer {
                buffer,
                index_format: format,
                offset,
                size,
            } => {
                let made = self.ids.buffers.get(*buffer);
                let made = made.map(|buffer| DrawCommand::SetIndexBuffer {
                    buffer,
                    index_format: index_format(*format),
                    offset: *offset,
                    size: size.map(|s| s.get()),
                });
                (INDICES, made)
            }
            RenderCommand::SetVertexBuffer {
                slot,
                buffer,
                offset,
                size,
            } => {
                let made = buffer.map(|b| self.ids.buffers.get(b)).transpose();
                let made = made.map(|buffer| DrawCommand::SetVertexBuffer {
                    slot: *slot,
                    buffer,
                    offset: *offset,
                    size: size.map(|s| s.get()),
                });
                (*slot, made)
            }
            _ => return,
        };
        match made {
            Ok(command) => {
                self.missing.buffers.remove(&slot);
                self.push(command);
            }
            Err(why) => {
                self.missing.buffers.insert(slot, why);
            }
        }
    }

    fn draw(&mut self, command: &RenderCommand<PointerReferences>) {
        match command {
            RenderCommand::Draw {
                vertex_count,
                instance_count,
                first_vertex,
                first_instance,
            } => self.act(Ok(DrawCommand::Draw {
                vertex_count: *vertex_count,
                instance_count: *instance_count,
                first_vertex: *first_vertex,
                first_instance: *first_instance,
            })),
            RenderCommand::DrawIndexed {
                index_count,
                instance_count,
                first_index,
                base_vertex,
                first_instance,
            } => self.act(Ok(DrawCommand::DrawIndexed {
                index_count: *index_count,
                instance_count: *instance_count,
                first_index: *first_index,
                base_vertex: *base_vertex,
                first_instance: *first_instance,
            })),
            RenderCommand::DrawIndirect {
                buffer,
                offset,
                count,
                family,
                ..
            } => {
                let buffer = self.ids.buffers.get(*buffer);
                if u64::from(*count) > MOST_INDIRECT {
                    return self.refuse("an indirect draw", "it has too many draws");
                }
                for index in 0..u64::from(*count) {
                    let made = buffer
                        .clone()
                        .and_then(|b| indirect(b, *offset, index, *family));
                    self.act(made);
                }
            }
            RenderCommand::MultiDrawIndirectCount { .. } => {
                self.refuse("an indirect draw", "its count is in a buffer");
            }
            _ => self.refuse("a draw", "of mesh shaders"),
        }
    }

    /// Expands a bundle. Afterwards no pipeline, group or buffer is bound.
    fn bundle(&mut self, id: wgpu_core::id::PointerId<wgpu_core::id::markers::RenderBundle>) {
        self.missing = Missing::default();
        match self.ids.bundles.get(id) {
            Ok(bundle) => {
                self.kept.commands.extend(bundle.commands.iter().cloned());
                self.kept.refused.extend(bundle.refused.iter().cloned());
            }
            Err(why) => self.kept.refused.push(why),
        }
    }
}

/// One draw of a multi-draw: its arguments follow those of the draws before it.
fn indirect(
    buffer: usize,
    offset: u64,
    index: u64,
    family: DrawCommandFamily,
) -> OrRefusal<DrawCommand> {
    match family {
        DrawCommandFamily::Draw => Ok(DrawCommand::DrawIndirect {
            buffer,
            offset: offset.saturating_add(16 * index),
        }),
        DrawCommandFamily::DrawIndexed => Ok(DrawCommand::DrawIndexedIndirect {
            buffer,
            offset: offset.saturating_add(20 * index),
        }),
        DrawCommandFamily::DrawMeshTasks => Err(refusal("a draw", "of mesh shaders")),
    }
}

/// The commands of a compute pass.
pub(super) fn computed(
    ids: &Ids,
    pass: &CorePass<CoreComputeCommand<PointerReferences>>,
) -> Usable<ComputeCommand> {
    use CoreComputeCommand as C;
    let mut made = Pass {
        ids,
        kept: Usable::default(),
        missing: Missing::default(),
        offsets: pass.dynamic_offsets.clone().into_iter(),
    };
    for command in &pass.commands {
        match command {
            C::SetBindGroup {
                index,
                num_dynamic_offsets,
                bind_group,
            } => {
                let index = *index;
                let group = bind_group.map(|g| ids.groups.get(g));
                made.group(
                    index,
                    *num_dynamic_offsets,
                    group,
                    |bind_group, dynamic_offsets| ComputeCommand::SetBindGroup {
                        index,
                        bind_group,
                        dynamic_offsets,
                    },
                );
            }
            C::SetPipeline(id) => {
                let pipeline = ids.compute_pipelines.get(*id);
                made.pipeline(pipeline, |pipeline| ComputeCommand::SetPipeline {
                    pipeline,
                });
            }
            C::DispatchWorkgroups([x, y, z]) => made.act(Ok(ComputeCommand::DispatchWorkgroups {
                x: *x,
                y: *y,
                z: *z,
            })),
            C::DispatchWorkgroupsIndirect { buffer, offset } => {
                let buffer = ids.buffers.get(*buffer);
                made.act(
                    buffer.map(|buffer| ComputeCommand::DispatchWorkgroupsIndirect {
                        buffer,
                        offset: *offset,
                    }),
                );
            }
            C::WriteTimestamp { .. } => made.refuse("a timestamp", "its result"),
            C::BeginPipelineStatisticsQuery { .. } => {
                made.refuse("a statistics query", "its result")
            }
            C::SetImmediate { .. }
            | C::EndPipelineStatisticsQuery
            | C::PushDebugGroup { .. }
            | C::PopDebugGroup
            | C::InsertDebugMarker { .. }
            | C::TransitionResources { .. } => {}
        }
    }
    made.kept
}
