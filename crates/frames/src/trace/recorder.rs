//! Simulates a trace's actions: objects get numbers, and commands become those of a frame folder.

use std::rc::Rc;

use wgpu_core::binding_model::BindingResource;
use wgpu_core::command::PointerReferences;
use wgpu_core::device::trace::{
    Action, Data, TraceBindGroupDescriptor, TraceComputePipelineDescriptor,
    TraceGeneralRenderPipelineDescriptor,
};
use wgpu_core::id::{PointerId, markers};
use wgpu_core::pipeline::RenderPipelineVertexProcessor;

use super::data::Store;
use super::ids::{Ids, Module, Surface};
use super::version::Version;
use super::{FramesBy, OrRefusal, Refusal, TraceError, objects, passes, refusal, shaders};
use crate::file::{
    AlphaMode, BindGroup, BufferRange, CaptureFile, Command, ComputePipeline, Extent,
    FragmentState, GroupEntry, GroupLayout, LayoutChoice, Origin, PipelineLayout, RenderPipeline,
    Resource, Shader, TexelLayout, TexelPlace, Texture, VertexState, View,
};

/// A command of the queue, and the parts of it that were refused. `command` is `None` if all of it
/// was.
pub(super) struct Step {
    pub command: Option<Command>,
    pub refused: Vec<Refusal>,
}

/// The end of a frame.
#[derive(Clone, Copy)]
pub(super) struct Mark {
    /// Number of steps before it.
    pub end: usize,
    /// The texture that the app shows.
    pub canvas: Option<usize>,
    pub alpha_mode: Option<AlphaMode>,
    pub by: FramesBy,
}

/// State after the actions so far.
pub(super) struct Recorder {
    /// All objects of the trace.
    pub file: CaptureFile,
    pub store: Store,
    pub steps: Vec<Step>,
    pub marks: Vec<Mark>,
    pub(super) ids: Ids,
    version: Version,
}

pub(super) type TraceAction = Action<'static, PointerReferences>;

impl Recorder {
    pub fn new(store: Store, version: Version) -> Self {
        Self {
            file: CaptureFile::default(),
            store,
            steps: Vec::new(),
            marks: Vec::new(),
            ids: Ids::default(),
            version,
        }
    }

    pub fn act(&mut self, action: TraceAction) -> Result<(), TraceError> {
        match action {
            Action::ConfigureSurface(id, config) => {
                let texture = Texture {
                    size: Extent([config.width, config.height, 1]),
                    format: config.format,
                    dimension: wgpu::TextureDimension::D2,
                    mip_level_count: 1,
                    sample_count: 1,
                    usage: config.usage.bits() & 0x1f,
                    view_formats: config.view_formats,
                    label: String::new(),
                };
                let acquired = None;
                let alpha_mode = alpha_mode(config.alpha_mode);
                let surface = Surface {
                    texture,
                    alpha_mode,
                    acquired,
                };
                self.ids.surfaces.set(id, Ok(surface));
            }
            Action::GetSurfaceTexture { id, parent } => self.acquire(id, parent),
            Action::Present(surface) => {
                let surface = self.ids.surfaces.get(surface).ok();
                let canvas = surface.as_ref().and_then(|s| s.acquired);
                let alpha_mode = surface.and_then(|s| s.alpha_mode);
                self.mark(canvas, alpha_mode, FramesBy::Present);
            }
            Action::WriteBuffer {
                id,
                data,
                offset,
                size,
                ..
            } => {
                let data = self.store.add(data, Some(size))?;
                let made = self.ids.buffers.get(id).map(|buffer| Command::WriteBuffer {
                    buffer,
                    offset,
                    data,
                });
                self.step(made);
            }
            Action::WriteTexture {
                to,
                data,
                layout,
                size,
            } => {
                let data = self.store.add(data, None)?;
                let made = self.place(&to).map(|destination| Command::WriteTexture {
                    destination,
                    data,
                    layout: TexelLayout {
                        offset: layout.offset,
                        bytes_per_row: layout.bytes_per_row,
                        rows_per_image: layout.rows_per_image,
                    },
                    size: objects::extent(size),
                });
                self.step(made);
            }
            Action::Submit(_, commands) => self.submit(commands),
            Action::FailedCommands { error, .. } => {
                self.step(Err(refusal("commands that failed in the app", &error)));
            }
            object => self.create(object)?,
        }
        Ok(())
    }

    fn create(&mut self, action: TraceAction) -> Result<(), TraceError> {
        let ids = &mut self.ids;
        match action {
            Action::CreateBuffer(id, desc) => {
                let number = push(&mut self.file.buffers, objects::buffer(&desc));
                ids.buffers.set(id, Ok(number));
            }
            Action::CreateTexture(id, desc) => {
                let number = push(&mut self.file.textures, objects::texture(&desc));
                ids.textures.set(id, Ok(number));
            }
            Action::CreateTextureError(id, _) => {
                ids.textures
                    .set(id, Err(refusal("a texture", "it failed in the app")));
            }
            Action::CreateTextureView { id, parent, desc } => {
                let texture = ids.textures.get(parent);
                let view = objects::view(&desc);
                ids.views
                    .set(id, texture.map(|texture| View { texture, view }));
            }
            Action::CreateSampler(id, desc) => {
                let made = objects::sampler(&desc);
                let made = made.map(|sampler| push(&mut self.file.samplers, sampler));
                ids.samplers.set(id, made);
            }
            Action::CreateBindGroupLayout(id, desc) => {
                let made = objects::group_layout(&desc);
                let made = made.map(|of| push(&mut self.file.bind_group_layouts, of));
                ids.group_layouts.set(id, made.map(GroupLayout::Number));
            }
            Action::GetRenderPipelineBindGroupLayout {
                id,
                pipeline,
                index: group,
            } => {
                let made = ids.render_pipelines.get(pipeline);
                let made = made.map(|pipeline| GroupLayout::Render { pipeline, group });
                ids.group_layouts.set(id, made);
            }
            Action::GetComputePipelineBindGroupLayout {
                id,
                pipeline,
                index: group,
            } => {
                let made = ids.compute_pipelines.get(pipeline);
                let made = made.map(|compute_pipeline| GroupLayout::Compute {
                    compute_pipeline,
                    group,
                });
                ids.group_layouts.set(id, made);
            }
            Action::CreatePipelineLayout(id, desc) => {
                let groups = desc.bind_group_layouts.iter();
                let made = self.pipeline_layout(groups.copied(), desc.immediate_size);
                self.ids.pipeline_layouts.set(id, made);
            }
            Action::CreateBindGroup(id, desc) => {
                let made = self.group(&desc);
                self.ids.groups.set(id, made);
            }
            Action::CreateShaderModule { id, desc, data } => {
                let label = objects::label(desc.label.as_deref());
                self.module(id, data, label)?;
            }
            Action::CreateShaderModulePassthrough { id, .. } => {
                let why = "it is passed to the driver as it is";
                ids.modules.set(id, Err(refusal("a shader", why)));
            }
            Action::CreateComputePipeline { id, desc } => {
                let made = self.compute_pipeline(&desc)?;
                self.ids.compute_pipelines.set(id, made);
            }
            Action::CreateGeneralRenderPipeline { id, desc } => {
                let made = self.render_pipeline(desc)?;
                self.ids.render_pipelines.set(id, made);
            }
            Action::CreateRenderBundle { id, base, .. } => {
                let bundle = passes::drawn(ids, &base);
                ids.bundles.set(id, Ok(Rc::new(bundle)));
            }
            // Dropped objects are not used again. Queries, external textures and ray tracing
            // objects are refused where they are used.
            _ => {}
        }
        Ok(())
    }

    fn acquire(&mut self, id: PointerId<markers::Texture>, parent: PointerId<markers::Surface>) {
        let made = self.ids.surfaces.get(parent).map(|mut surface| {
            let number = push(&mut self.file.textures, surface.texture.clone());
            surface.acquired = Some(number);
            self.ids.surfaces.set(parent, Ok(surface));
            number
        });
        self.ids.textures.set(id, made);
    }

    pub(super) fn mark(
        &mut self,
        canvas: Option<usize>,
        alpha_mode: Option<AlphaMode>,
        by: FramesBy,
    ) {
        self.marks.push(Mark {
            end: self.steps.len(),
            canvas,
            alpha_mode,
            by,
        });
    }

    pub(super) fn step(&mut self, made: OrRefusal<Command>) {
        let (command, refused) = match made {
            Ok(command) => (Some(command), Vec::new()),
            Err(why) => (None, vec![why]),
        };
        self.steps.push(Step { command, refused });
    }

    pub(super) fn place(
        &self,
        of: &wgpu::TexelCopyTextureInfoBase<PointerId<markers::Texture>>,
    ) -> OrRefusal<TexelPlace> {
        Ok(TexelPlace {
            texture: self.ids.textures.get(of.texture)?,
            mip_level: of.mip_level,
            origin: Origin([of.origin.x, of.origin.y, of.origin.z]),
            aspect: Some(of.aspect),
        })
    }

    fn pipeline_layout(
        &mut self,
        groups: impl Iterator<Item = Option<PointerId<markers::BindGroupLayout>>>,
        immediates: u32,
    ) -> OrRefusal<usize> {
        const WHAT: &str = "a pipeline layout";
        if immediates > 0 {
            return Err(refusal(WHAT, "it has immediate data (push constants)"));
        }
        let group = |g: PointerId<_>| match self.ids.group_layouts.get(g)? {
            GroupLayout::Number(number) => Ok(number),
            _ => Err(refusal(WHAT, "it has the derived layout of a pipeline")),
        };
        let groups = groups.map(|g| g.map(group).transpose());
        let bind_group_layouts = groups.collect::<OrRefusal<Vec<_>>>()?;
        let made = PipelineLayout { bind_group_layouts };
        Ok(push(&mut self.file.pipeline_layouts, made))
    }

    fn group(&mut self, of: &TraceBindGroupDescriptor<'_>) -> OrRefusal<usize> {
        const WHAT: &str = "a bind group";
        let layout = self.ids.group_layouts.get(of.layout)?;
        let mut entries = Vec::new();
        for entry in of.entries.iter() {
            let resource = match &entry.resource {
                BindingResource::Buffer(part) => Resource::Buffer(BufferRange {
                    buffer: self.ids.buffers.get(part.buffer)?,
                    offset: part.offset,
                    size: part.size,
                }),
                BindingResource::Sampler(id) => Resource::Sampler {
                    sampler: self.ids.samplers.get(*id)?,
                },
                BindingResource::TextureView(id) => Resource::Texture(self.ids.views.get(*id)?),
                BindingResource::BufferArray(_)
                | BindingResource::SamplerArray(_)
                | BindingResource::TextureViewArray(_) => {
                    return Err(refusal(WHAT, "it has an array of bindings"));
                }
                BindingResource::AccelerationStructure(_)
                | BindingResource::AccelerationStructureArray(_) => {
                    return Err(refusal(WHAT, "it has an acceleration structure"));
                }
                BindingResource::ExternalTexture(_) => {
                    return Err(refusal(WHAT, "it has an external texture"));
                }
            };
            entries.push(GroupEntry {
                binding: entry.binding,
                resource,
            });
        }
        Ok(push(
            &mut self.file.bind_groups,
            BindGroup { layout, entries },
        ))
    }

    fn module(
        &mut self,
        id: PointerId<markers::ShaderModule>,
        data: Data,
        label: String,
    ) -> Result<(), TraceError> {
        let Some(kind) = shaders::kind(&data) else {
            let why = "it is in a language that this version does not know";
            self.ids.modules.set(id, Err(refusal("a shader", why)));
            return Ok(());
        };
        let data = self.store.add(data, None)?;
        let number = None;
        self.ids.modules.set(
            id,
            Ok(Module {
                data,
                kind,
                label,
                number,
            }),
        );
        Ok(())
    }

    /// The number of a shader. Reads its text when a pipeline first needs it.
    fn shader(
        &mut self,
        id: PointerId<markers::ShaderModule>,
    ) -> Result<OrRefusal<usize>, TraceError> {
        let mut module = match self.ids.modules.get(id) {
            Ok(module) => module,
            Err(why) => return Ok(Err(why)),
        };
        if let Some(number) = module.number {
            return Ok(number);
        }
        let bytes = self.store.bytes(&module.data)?;
        let made = shaders::read(&bytes, module.kind, self.version).map(|(language, bytes)| {
            let data = self.store.add_bytes(bytes);
            let label = module.label.clone();
            push(
                &mut self.file.shaders,
                Shader {
                    data,
                    language,
                    label,
                },
            )
        });
        module.number = Some(made.clone());
        self.ids.modules.set(id, Ok(module));
        Ok(made)
    }

    fn layout(&self, id: Option<PointerId<markers::PipelineLayout>>) -> OrRefusal<LayoutChoice> {
        id.map_or(Ok(LayoutChoice::Auto), |id| {
            self.ids.pipeline_layouts.get(id).map(LayoutChoice::Number)
        })
    }

    fn compute_pipeline(
        &mut self,
        of: &TraceComputePipelineDescriptor<'_>,
    ) -> Result<OrRefusal<usize>, TraceError> {
        let module = self.shader(of.stage.module)?;
        let layout = self.layout(of.layout);
        Ok(module.and_then(|module| {
            let made = ComputePipeline {
                label: objects::label(of.label.as_deref()),
                layout: layout?,
                compute: objects::stage(&of.stage, module),
            };
            Ok(push(&mut self.file.compute_pipelines, made))
        }))
    }

    fn render_pipeline(
        &mut self,
        of: TraceGeneralRenderPipelineDescriptor<'_>,
    ) -> Result<OrRefusal<usize>, TraceError> {
        const WHAT: &str = "a render pipeline";
        let RenderPipelineVertexProcessor::Vertex(vertex) = &of.vertex else {
            return Ok(Err(refusal(WHAT, "it has a mesh shader")));
        };
        if of.multiview_mask.is_some() {
            return Ok(Err(refusal(WHAT, "it draws several views at once")));
        }
        let module = self.shader(vertex.stage.module)?;
        let pixels = of.fragment.as_ref();
        let pixels = pixels.map(|f| self.shader(f.stage.module)).transpose()?;
        let layout = self.layout(of.layout);
        let made =
            module.and_then(|module| {
                let fragment = of.fragment.as_ref().zip(pixels).map(
                    |(f, pixels)| -> OrRefusal<FragmentState> {
                        let targets = f.targets.iter().map(|t| t.as_ref().map(objects::target));
                        Ok(FragmentState {
                            stage: objects::stage(&f.stage, pixels?),
                            targets: targets.collect(),
                        })
                    },
                );
                let buffers = vertex.buffers.iter();
                Ok(RenderPipeline {
                    label: objects::label(of.label.as_deref()),
                    layout: layout?,
                    vertex: VertexState {
                        stage: objects::stage(&vertex.stage, module),
                        buffers: buffers
                            .map(|b| b.as_ref().map(objects::vertex_buffer))
                            .collect(),
                    },
                    fragment: fragment.transpose()?,
                    primitive: objects::primitive(&of.primitive)?,
                    clip_space: None,
                    depth_stencil: of.depth_stencil.as_ref().map(objects::depth_stencil),
                    multisample: objects::multisample(&of.multisample),
                })
            });
        Ok(made.map(|made| push(&mut self.file.render_pipelines, made)))
    }
}

/// Appends an entry, and returns its number.
fn push<T>(list: &mut Vec<T>, entry: T) -> usize {
    list.push(entry);
    list.len() - 1
}

/// Converts an alpha mode. `None` if the app left it to the system.
fn alpha_mode(of: wgpu::CompositeAlphaMode) -> Option<AlphaMode> {
    match of {
        wgpu::CompositeAlphaMode::Opaque => Some(AlphaMode::Opaque),
        wgpu::CompositeAlphaMode::PreMultiplied => Some(AlphaMode::Premultiplied),
        wgpu::CompositeAlphaMode::PostMultiplied => Some(AlphaMode::Postmultiplied),
        wgpu::CompositeAlphaMode::Auto | wgpu::CompositeAlphaMode::Inherit => None,
    }
}
