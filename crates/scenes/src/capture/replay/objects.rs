//! wgpu objects for a capture, created on first use.

use std::collections::BTreeMap;

use preshade_plan::safety::Checks;
use wgpu::util::DeviceExt as _;

use super::{Replay, ending};
use crate::capture::material::topology;
use crate::capture::{Error, texels};
use preshade_frames::contents::whole;
use preshade_frames::file::{
    BindGroup, Cull, DepthStencil, GroupLayout, IndexFormat, LayoutChoice, LayoutEntry,
    RenderPipeline, Resource, Sampler, ShaderLanguage, Stage, StartTexture, StencilFace, Texture,
    Topology, View, ViewDescriptor,
};
use preshade_frames::folder::get;

/// Objects created so far, by index.
#[derive(Default)]
pub(super) struct Objects {
    buffers: BTreeMap<usize, wgpu::Buffer>,
    textures: BTreeMap<usize, wgpu::Texture>,
    samplers: Vec<(Sampler, wgpu::Sampler)>,
    modules: BTreeMap<usize, wgpu::ShaderModule>,
    group_layouts: BTreeMap<usize, wgpu::BindGroupLayout>,
    pipeline_layouts: BTreeMap<usize, wgpu::PipelineLayout>,
    groups: BTreeMap<usize, Created<wgpu::BindGroup>>,
    render_pipelines: BTreeMap<usize, Created<wgpu::RenderPipeline>>,
    compute_pipelines: BTreeMap<usize, Created<wgpu::ComputePipeline>>,
}

/// An object, or why it could not be created.
type Created<T> = Result<T, String>;

/// Separates failures of a single object from a lost device or a broken capture, which end the
/// replay.
fn refused<T>(made: Result<T, Error>) -> Result<Created<T>, Error> {
    match made {
        Ok(made) => Ok(Ok(made)),
        Err(Error::Render(error @ preshade_draw::render::Error::Refused { .. })) => {
            Ok(Err(error.to_string()))
        }
        Err(Error::Render(error @ preshade_draw::render::Error::Unsupported { .. })) => {
            Ok(Err(error.to_string()))
        }
        Err(other) => Err(other),
    }
}

impl Replay<'_> {
    pub(super) fn buffer(&mut self, index: usize, place: &str) -> Result<&wgpu::Buffer, Error> {
        if !self.objects.buffers.contains_key(&index) {
            let made = self.new_buffer(index, place)?;
            self.objects.buffers.insert(index, made);
        }
        Ok(&self.objects.buffers[&index])
    }

    fn new_buffer(&self, index: usize, place: &str) -> Result<wgpu::Buffer, Error> {
        let file = &self.capture.file;
        let of = get(&file.buffers, index, "buffer", place)?;
        let start = file.start.buffers.iter().find(|b| b.buffer == index);
        // The recorder turned mapped writes into commands.
        let mut usage = wgpu::BufferUsages::from_bits_truncate(of.usage);
        usage -= wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::MAP_WRITE;
        usage |= wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let label = format!("buffer {index} {}", of.label);
        let bytes = start.map(|s| self.capture.data(&s.data)).transpose()?;
        if let Some(bytes) = &bytes {
            whole(&label, bytes, of.size)?;
        }
        let size = of.size.next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT);
        let made = self.gpu.checked(&label, || match bytes {
            Some(bytes) => {
                let mut contents = bytes.to_vec();
                contents.resize(size as usize, 0);
                self.gpu
                    .device
                    .create_buffer_init(&wgpu::util::BufferInitDescriptor {
                        label: Some(&label),
                        contents: &contents,
                        usage,
                    })
            }
            None => self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(&label),
                size,
                usage,
                mapped_at_creation: false,
            }),
        })?;
        Ok(made)
    }

    pub(super) fn texture(&mut self, index: usize, place: &str) -> Result<&wgpu::Texture, Error> {
        if !self.objects.textures.contains_key(&index) {
            let made = self.new_texture(index, place)?;
            self.objects.textures.insert(index, made);
        }
        Ok(&self.objects.textures[&index])
    }

    fn new_texture(&self, index: usize, place: &str) -> Result<wgpu::Texture, Error> {
        let file = &self.capture.file;
        let of = get(&file.textures, index, "texture", place)?;
        let label = format!("texture {index} {}", of.label);
        let texture = self.gpu.checked(&label, || {
            let mut descriptor = texture_descriptor(of, &label);
            descriptor.format = self.readable(of.format);
            self.gpu.device.create_texture(&descriptor)
        })?;
        let starts = || file.start.textures.iter().filter(|t| t.texture == index);
        let is_depth = |start: &&StartTexture| {
            of.format.has_depth_aspect() && start.aspect != Some(wgpu::TextureAspect::StencilOnly)
        };
        if of.sample_count == 1 && starts().any(|start| is_depth(&start)) {
            self.start_depths(index, &texture)?;
        }
        for start in starts().filter(|start| !is_depth(start)) {
            let bytes = self.capture.data(&start.data)?;
            let aspect = start.aspect.unwrap_or_default();
            let size = level_size(of, start.mip_level, start.layer.is_some());
            let (row, rows) = rows(of.format, aspect, size);
            let needed = u64::from(row) * u64::from(rows) * u64::from(size.depth_or_array_layers);
            if (bytes.len() as u64) < needed {
                let (level, found) = (start.mip_level, bytes.len());
                let why = format!("level {level} has {found} bytes, and its texels have {needed}");
                return Err(Error::broken(label, why));
            }
            let to = wgpu::TexelCopyTextureInfo {
                texture: &texture,
                mip_level: start.mip_level,
                origin: wgpu::Origin3d {
                    x: 0,
                    y: 0,
                    z: start.layer.unwrap_or(0),
                },
                aspect,
            };
            let layout = wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(row),
                rows_per_image: Some(rows),
            };
            self.write_texels(of.format, to, bytes, layout, size, &label)?;
        }
        Ok(texture)
    }

    /// Draws the start content of a depth texture. Not all adapters can copy to depths.
    fn start_depths(&self, index: usize, texture: &wgpu::Texture) -> Result<(), Error> {
        let view = View {
            texture: index,
            view: ViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                ..ViewDescriptor::default()
            },
        };
        let image = texels::at_start(self.capture, &view)?;
        let label = format!("texture {index}");
        let drawn = self.gpu.checked(&label, || {
            preshade_draw::render::depths::draw(self.gpu, &image, texture, 0)
        })?;
        drawn.map_err(|why| Error::broken(label, why))
    }

    pub(super) fn view(&mut self, view: &View, place: &str) -> Result<wgpu::TextureView, Error> {
        let texture = self.texture(view.texture, place)?.clone();
        let mut descriptor = view.view.wgpu();
        descriptor.format = descriptor.format.map(|f| self.readable(f));
        Ok(self
            .gpu
            .checked(place, || texture.create_view(&descriptor))?)
    }

    pub(super) fn sampler(&mut self, index: usize, place: &str) -> Result<wgpu::Sampler, Error> {
        let of = get(&self.capture.file.samplers, index, "sampler", place)?;
        self.sampler_like(of, place)
    }

    /// A sampler. Equal descriptors share one.
    pub(super) fn sampler_like(
        &mut self,
        of: &Sampler,
        place: &str,
    ) -> Result<wgpu::Sampler, Error> {
        let known = self.objects.samplers.iter().find(|(known, _)| known == of);
        if let Some((_, known)) = known {
            return Ok(known.clone());
        }
        let descriptor = of.wgpu();
        let create = || self.gpu.device.create_sampler(&descriptor);
        let made = self.gpu.checked(place, create)?;
        self.objects.samplers.push((of.clone(), made.clone()));
        Ok(made)
    }

    fn module(&mut self, index: usize, place: &str) -> Result<wgpu::ShaderModule, Error> {
        if let Some(known) = self.objects.modules.get(&index) {
            return Ok(known.clone());
        }
        let of = get(&self.capture.file.shaders, index, "shader", place)?;
        let label = format!("shader {index}");
        let source = match of.language {
            ShaderLanguage::SpirV => {
                let words = self.capture.data(&of.data)?;
                let words = words.chunks_exact(4);
                let words = words.map(|w| u32::from_le_bytes([w[0], w[1], w[2], w[3]]));
                wgpu::ShaderSource::SpirV(words.collect())
            }
            _ => {
                let text = self.capture.text(index)?;
                wgpu::ShaderSource::Wgsl(preshade_compiler::front::for_naga(&text).into())
            }
        };
        let source = ending::source(source);
        let made = self.gpu.checked(&label, || {
            // The page's shader ran with all of WGSL's checks.
            self.gpu.shader(
                Checks::ALL,
                wgpu::ShaderModuleDescriptor {
                    label: Some(&label),
                    source,
                },
            )
        })?;
        self.objects.modules.insert(index, made.clone());
        Ok(made)
    }

    fn group_layout(&mut self, index: usize, place: &str) -> Result<wgpu::BindGroupLayout, Error> {
        if let Some(known) = self.objects.group_layouts.get(&index) {
            return Ok(known.clone());
        }
        let of = get(
            &self.capture.file.bind_group_layouts,
            index,
            "bind group layout",
            place,
        )?;
        let label = format!("bind group layout {index}");
        let entries = of.entries.iter().map(|e| entry(e, &label));
        let entries = entries.collect::<Result<Vec<_>, Error>>()?;
        let made = self.gpu.checked(&label, || {
            self.gpu
                .device
                .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                    label: Some(&label),
                    entries: &entries,
                })
        })?;
        self.objects.group_layouts.insert(index, made.clone());
        Ok(made)
    }

    fn pipeline_layout(
        &mut self,
        choice: &LayoutChoice,
        place: &str,
    ) -> Result<Option<wgpu::PipelineLayout>, Error> {
        let index = match choice {
            LayoutChoice::Number(index) => *index,
            LayoutChoice::Auto | LayoutChoice::Text(_) => return Ok(None),
        };
        if let Some(known) = self.objects.pipeline_layouts.get(&index) {
            return Ok(Some(known.clone()));
        }
        let of = get(
            &self.capture.file.pipeline_layouts,
            index,
            "pipeline layout",
            place,
        )?;
        let groups = of.bind_group_layouts.clone().into_iter();
        let groups = groups.map(|g| g.map(|g| self.group_layout(g, place)).transpose());
        let groups = groups.collect::<Result<Vec<_>, Error>>()?;
        let groups: Vec<Option<&wgpu::BindGroupLayout>> =
            groups.iter().map(Option::as_ref).collect();
        let label = format!("pipeline layout {index}");
        let made = self.gpu.checked(&label, || {
            self.gpu
                .device
                .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                    label: Some(&label),
                    bind_group_layouts: &groups,
                    ..Default::default()
                })
        })?;
        self.objects.pipeline_layouts.insert(index, made.clone());
        Ok(Some(made))
    }

    pub(super) fn group(
        &mut self,
        index: usize,
        place: &str,
    ) -> Result<Created<wgpu::BindGroup>, Error> {
        if let Some(known) = self.objects.groups.get(&index) {
            return Ok(known.clone());
        }
        let of = get(&self.capture.file.bind_groups, index, "bind group", place)?;
        let made = refused(self.new_group(index, of))?;
        self.objects.groups.insert(index, made.clone());
        Ok(made)
    }

    fn new_group(&mut self, index: usize, of: &BindGroup) -> Result<wgpu::BindGroup, Error> {
        let label = format!("bind group {index}");
        let layout = match &of.layout {
            GroupLayout::Number(layout) => self.group_layout(*layout, &label)?,
            GroupLayout::Render { pipeline, group } => {
                let made = self.render_pipeline(*pipeline, &label)?;
                derived(made.map(|p| p.get_bind_group_layout(*group)), &label)?
            }
            GroupLayout::Compute {
                compute_pipeline,
                group,
            } => {
                let made = self.compute_pipeline(*compute_pipeline, &label)?;
                derived(made.map(|p| p.get_bind_group_layout(*group)), &label)?
            }
        };
        enum Held {
            Buffer(wgpu::Buffer, u64, Option<u64>),
            View(wgpu::TextureView),
            Sampler(wgpu::Sampler),
        }
        let mut held = Vec::new();
        for e in &of.entries {
            held.push((
                e.binding,
                match &e.resource {
                    Resource::Buffer(range) => Held::Buffer(
                        self.buffer(range.buffer, &label)?.clone(),
                        range.offset,
                        range.size,
                    ),
                    Resource::Texture(view) => Held::View(self.view(view, &label)?),
                    Resource::Sampler { sampler } => {
                        Held::Sampler(self.sampler(*sampler, &label)?.clone())
                    }
                },
            ));
        }
        let entries: Vec<wgpu::BindGroupEntry<'_>> = held
            .iter()
            .map(|(binding, held)| wgpu::BindGroupEntry {
                binding: *binding,
                resource: match held {
                    Held::Buffer(buffer, offset, size) => {
                        wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                            buffer,
                            offset: *offset,
                            size: size.and_then(std::num::NonZeroU64::new),
                        })
                    }
                    Held::View(view) => wgpu::BindingResource::TextureView(view),
                    Held::Sampler(sampler) => wgpu::BindingResource::Sampler(sampler),
                },
            })
            .collect();
        Ok(self.gpu.checked(&label, || {
            self.gpu
                .device
                .create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some(&label),
                    layout: &layout,
                    entries: &entries,
                })
        })?)
    }

    pub(super) fn render_pipeline(
        &mut self,
        index: usize,
        place: &str,
    ) -> Result<Created<wgpu::RenderPipeline>, Error> {
        if let Some(known) = self.objects.render_pipelines.get(&index) {
            return Ok(known.clone());
        }
        let all = &self.capture.file.render_pipelines;
        let of = get(all, index, "render pipeline", place)?;
        let made = refused(self.new_render_pipeline(index, of))?;
        self.objects.render_pipelines.insert(index, made.clone());
        Ok(made)
    }

    fn new_render_pipeline(
        &mut self,
        index: usize,
        of: &RenderPipeline,
    ) -> Result<wgpu::RenderPipeline, Error> {
        let label = format!("render pipeline {index} {}", of.label);
        let layout = self.pipeline_layout(&of.layout, &label)?;
        let vertex = self.module(of.vertex.stage.module, &label)?;
        let fragment = of.fragment.as_ref();
        let fragment = fragment.map(|f| Ok::<_, Error>((f, self.module(f.stage.module, &label)?)));
        let fragment = fragment.transpose()?;
        let attributes = of.vertex.buffers.iter().map(|b| {
            let own = b.iter().flat_map(|b| &b.attributes);
            let own = own.map(|a| {
                let shader_location = a
                    .shader_location
                    .ok_or_else(|| Error::broken(&label, "an attribute has no `shaderLocation`"))?;
                let format = a.format.own();
                let format = format
                    .ok_or_else(|| Error::broken(&label, "an attribute has a format of WebGL"))?;
                Ok(wgpu::VertexAttribute {
                    format,
                    offset: a.offset,
                    shader_location,
                })
            });
            own.collect::<Result<Vec<_>, Error>>()
        });
        let attributes = attributes.collect::<Result<Vec<_>, Error>>()?;
        let layouts = of.vertex.buffers.iter().zip(&attributes);
        let buffers: Vec<Option<wgpu::VertexBufferLayout<'_>>> = layouts
            .map(|(b, attributes)| {
                b.as_ref().map(|b| wgpu::VertexBufferLayout {
                    array_stride: b.array_stride,
                    step_mode: b.step_mode,
                    attributes,
                })
            })
            .collect();
        let targets: Vec<Option<wgpu::ColorTargetState>> = of
            .fragment
            .iter()
            .flat_map(|f| &f.targets)
            .map(|t| t.as_ref().map(color_target))
            .collect();
        let constants =
            |stage: &Stage| -> Vec<(String, f64)> { stage.constants.clone().into_iter().collect() };
        let vertex_constants = constants(&of.vertex.stage);
        let fragment_constants = of.fragment.as_ref().map(|f| constants(&f.stage));
        let fragment_constants = fragment_constants.unwrap_or_default();
        let vertex_constants = named(&vertex_constants);
        let fragment_constants = named(&fragment_constants);
        Ok(self.gpu.checked(&label, || {
            let device = &self.gpu.device;
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(&label),
                layout: layout.as_ref(),
                vertex: wgpu::VertexState {
                    module: &vertex,
                    entry_point: of.vertex.stage.entry_point.as_deref(),
                    compilation_options: wgpu::PipelineCompilationOptions {
                        constants: &vertex_constants,
                        ..Default::default()
                    },
                    buffers: &buffers,
                },
                primitive: primitive(of),
                depth_stencil: of.depth_stencil.as_ref().map(depth_stencil),
                multisample: wgpu::MultisampleState {
                    count: of.multisample.count,
                    mask: u64::from(of.multisample.mask),
                    alpha_to_coverage_enabled: of.multisample.alpha_to_coverage_enabled,
                },
                fragment: fragment.as_ref().map(|(f, module)| wgpu::FragmentState {
                    module,
                    entry_point: f.stage.entry_point.as_deref(),
                    compilation_options: wgpu::PipelineCompilationOptions {
                        constants: &fragment_constants,
                        ..Default::default()
                    },
                    targets: &targets,
                }),
                multiview_mask: None,
                cache: None,
            })
        })?)
    }

    pub(super) fn compute_pipeline(
        &mut self,
        index: usize,
        place: &str,
    ) -> Result<Created<wgpu::ComputePipeline>, Error> {
        if let Some(known) = self.objects.compute_pipelines.get(&index) {
            return Ok(known.clone());
        }
        let all = &self.capture.file.compute_pipelines;
        let of = get(all, index, "compute pipeline", place)?;
        let label = format!("compute pipeline {index} {}", of.label);
        let layout = self.pipeline_layout(&of.layout, &label)?;
        let constants: Vec<(String, f64)> = of.compute.constants.clone().into_iter().collect();
        let constants = named(&constants);
        let made = self.module(of.compute.module, &label).and_then(|module| {
            Ok(self.gpu.checked(&label, || {
                let device = &self.gpu.device;
                device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(&label),
                    layout: layout.as_ref(),
                    module: &module,
                    entry_point: of.compute.entry_point.as_deref(),
                    compilation_options: wgpu::PipelineCompilationOptions {
                        constants: &constants,
                        ..Default::default()
                    },
                    cache: None,
                })
            })?)
        });
        let made = refused(made)?;
        self.objects.compute_pipelines.insert(index, made.clone());
        Ok(made)
    }
}

fn named(constants: &[(String, f64)]) -> Vec<(&str, f64)> {
    constants.iter().map(|(n, v)| (n.as_str(), *v)).collect()
}

/// The layout of a pipeline, which must exist.
fn derived<T>(made: Created<T>, label: &str) -> Result<T, Error> {
    made.map_err(|why| {
        Error::Render(preshade_draw::render::Error::Refused {
            what: label.to_owned(),
            message: format!("its layout is that of a pipeline that was left out: {why}"),
        })
    })
}

fn texture_descriptor<'l>(of: &'l Texture, label: &'l str) -> wgpu::TextureDescriptor<'l> {
    let mut usage = wgpu::TextureUsages::from_bits_truncate(of.usage);
    if of.sample_count == 1 {
        usage |= wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::COPY_DST;
    }
    if of.format.is_depth_stencil_format() {
        // Start content is drawn, and results of a pass are read in a shader.
        usage |= wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
    }
    wgpu::TextureDescriptor {
        label: Some(label),
        size: of.size.wgpu(),
        mip_level_count: of.mip_level_count,
        sample_count: of.sample_count,
        dimension: of.dimension,
        format: of.format,
        usage,
        view_formats: &of.view_formats,
    }
}

/// Size of a level in whole blocks, with all layers or one.
fn level_size(of: &Texture, level: u32, one_layer: bool) -> wgpu::Extent3d {
    let size = of.size.wgpu().mip_level_size(level, of.dimension);
    let size = size.physical_size(of.format);
    wgpu::Extent3d {
        depth_or_array_layers: match one_layer {
            true => 1,
            false => size.depth_or_array_layers,
        },
        ..size
    }
}

/// Bytes in a row of blocks, and rows of blocks in a layer.
fn rows(
    format: wgpu::TextureFormat,
    aspect: wgpu::TextureAspect,
    size: wgpu::Extent3d,
) -> (u32, u32) {
    let (across, down) = format.block_dimensions();
    let block = format.block_copy_size(Some(aspect)).unwrap_or(4);
    (
        size.width.div_ceil(across) * block,
        size.height.div_ceil(down),
    )
}

fn entry(of: &LayoutEntry, label: &str) -> Result<wgpu::BindGroupLayoutEntry, Error> {
    let two = wgpu::TextureViewDimension::D2;
    let ty = match of {
        LayoutEntry {
            buffer: Some(b), ..
        } => wgpu::BindingType::Buffer {
            ty: b.ty.wgpu(),
            has_dynamic_offset: b.has_dynamic_offset,
            min_binding_size: std::num::NonZeroU64::new(b.min_binding_size),
        },
        LayoutEntry {
            sampler: Some(s), ..
        } => wgpu::BindingType::Sampler(s.ty),
        LayoutEntry {
            texture: Some(t), ..
        } => wgpu::BindingType::Texture {
            sample_type: t.sample_type.wgpu(),
            view_dimension: t.view_dimension.unwrap_or(two),
            multisampled: t.multisampled,
        },
        LayoutEntry {
            storage_texture: Some(t),
            ..
        } => wgpu::BindingType::StorageTexture {
            access: t.access,
            format: t.format,
            view_dimension: t.view_dimension.unwrap_or(two),
        },
        _ => {
            return Err(Error::Render(preshade_draw::render::Error::Refused {
                what: label.to_owned(),
                message: format!(
                    "binding {} is an external texture, or of a kind that this version does not \
                     know",
                    of.binding
                ),
            }));
        }
    };
    Ok(wgpu::BindGroupLayoutEntry {
        binding: of.binding,
        visibility: wgpu::ShaderStages::from_bits_truncate(of.visibility),
        ty,
        count: None,
    })
}

pub(super) fn color_target(of: &preshade_frames::file::ColorTarget) -> wgpu::ColorTargetState {
    let component = |c: preshade_frames::file::BlendComponent| wgpu::BlendComponent {
        src_factor: c.src_factor,
        dst_factor: c.dst_factor,
        operation: c.operation,
    };
    wgpu::ColorTargetState {
        format: of.format,
        blend: of.blend.as_ref().map(|b| wgpu::BlendState {
            color: component(b.color),
            alpha: component(b.alpha),
        }),
        write_mask: wgpu::ColorWrites::from_bits_truncate(of.write_mask),
    }
}

pub(super) fn depth_stencil(of: &DepthStencil) -> wgpu::DepthStencilState {
    let face = |f: StencilFace| wgpu::StencilFaceState {
        compare: f.compare,
        fail_op: f.fail_op,
        depth_fail_op: f.depth_fail_op,
        pass_op: f.pass_op,
    };
    let has_depth = of.format.has_depth_aspect();
    wgpu::DepthStencilState {
        format: of.format,
        depth_write_enabled: of
            .depth_write_enabled
            .or_else(|| has_depth.then_some(false)),
        depth_compare: of
            .depth_compare
            .or_else(|| has_depth.then_some(wgpu::CompareFunction::Always)),
        stencil: wgpu::StencilState {
            front: face(of.stencil_front),
            back: face(of.stencil_back),
            read_mask: of.stencil_read_mask,
            write_mask: of.stencil_write_mask,
        },
        bias: wgpu::DepthBiasState {
            constant: of.depth_bias,
            slope_scale: of.depth_bias_slope_scale,
            clamp: of.depth_bias_clamp,
        },
    }
}

pub(super) fn primitive(of: &RenderPipeline) -> wgpu::PrimitiveState {
    let p = &of.primitive;
    wgpu::PrimitiveState {
        topology: topology(p.topology),
        strip_index_format: match p.topology {
            // The generated indices have 32 bits.
            Topology::LineLoop => Some(wgpu::IndexFormat::Uint32),
            _ => p.strip_index_format.map(index_format),
        },
        front_face: p.front_face,
        cull_mode: match p.cull_mode {
            Cull::None => None,
            Cull::Front => Some(wgpu::Face::Front),
            Cull::Back => Some(wgpu::Face::Back),
        },
        unclipped_depth: p.unclipped_depth,
        polygon_mode: wgpu::PolygonMode::Fill,
        conservative: false,
    }
}

/// Indices of 8 bits are widened to 16.
pub(super) fn index_format(of: IndexFormat) -> wgpu::IndexFormat {
    match of {
        IndexFormat::Uint8 | IndexFormat::Uint16 => wgpu::IndexFormat::Uint16,
        IndexFormat::Uint32 => wgpu::IndexFormat::Uint32,
    }
}
