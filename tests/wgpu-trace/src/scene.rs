//! What is drawn: levels of a texture and offsets are computed first, then come frames of a shadow pass, a pass that
//! adds to a texture, and a main pass with a bundle. The tests of traces draw this too: the driver compiles for
//! the processor at hand, so a picture that another machine kept can differ.

pub const SIZE: [u32; 2] = [64, 48];
pub const FRAMES: u32 = 3;

pub struct Scene {
    bricks: wgpu::Texture,
    shadows: wgpu::TextureView,
    trail: wgpu::TextureView,
    placed: wgpu::Buffer,
    corners: wgpu::Buffer,
    indices: wgpu::Buffer,
    offsets: wgpu::Buffer,
    shadow: wgpu::RenderPipeline,
    lit: wgpu::RenderPipeline,
    added: wgpu::RenderPipeline,
    place: wgpu::BindGroup,
    look: wgpu::BindGroup,
    bundle: wgpu::RenderBundle,
}

const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

fn texture(
    device: &wgpu::Device,
    label: &str,
    size: [u32; 2],
    levels: u32,
    format: wgpu::TextureFormat,
) -> wgpu::Texture {
    let mut usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
    if format != DEPTH {
        usage |= wgpu::TextureUsages::COPY_DST;
    }
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d {
            width: size[0],
            height: size[1],
            depth_or_array_layers: 1,
        },
        mip_level_count: levels,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

fn filled(
    device: &wgpu::Device,
    label: &str,
    usage: wgpu::BufferUsages,
    bytes: &[u8],
) -> wgpu::Buffer {
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: bytes.len() as u64,
        usage,
        mapped_at_creation: true,
    });
    let mapped = buffer.get_mapped_range_mut(..);
    #[cfg(not(feature = "v29"))]
    let mapped = mapped.expect("a mapped buffer");
    let mut mapped = mapped;
    mapped.copy_from_slice(bytes);
    drop(mapped);
    buffer.unmap();
    buffer
}

/// A texture to draw into without a window.
pub fn target(device: &wgpu::Device, format: wgpu::TextureFormat) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some("target"),
        size: wgpu::Extent3d {
            width: SIZE[0],
            height: SIZE[1],
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

/// The texels of a target, row by row, in the order of its channels.
pub fn read(device: &wgpu::Device, queue: &wgpu::Queue, texture: &wgpu::Texture) -> Vec<u8> {
    // 64 texels are 256 bytes, as copies demand.
    let row = SIZE[0] * 4;
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("picture"),
        size: u64::from(row * SIZE[1]),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(row),
                rows_per_image: None,
            },
        },
        texture.size(),
    );
    queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |r| r.expect("a picture"));
    device
        .poll(wgpu::PollType::wait_indefinitely())
        .expect("a device");
    let mapped = buffer.get_mapped_range(..);
    #[cfg(not(feature = "v29"))]
    let mapped = mapped.expect("a mapped buffer");
    mapped.to_vec()
}

fn bytes(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|n| n.to_le_bytes()).collect()
}

impl Scene {
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue, format: wgpu::TextureFormat) -> Self {
        let module = device.create_shader_module(wgpu::include_wgsl!("scene.wgsl"));
        let layouts = Layouts::new(device);
        let bricks = texture(device, "bricks", [8, 8], 4, wgpu::TextureFormat::Rgba8Unorm);
        let shadows =
            texture(device, "shadows", [32, 24], 1, DEPTH).create_view(&Default::default());
        let trail = texture(device, "trail", [4, 4], 1, wgpu::TextureFormat::R8Unorm)
            .create_view(&Default::default());
        let mut slots = bytes(&[1.0, 0.0, 0.0, 0.0, 0.5, 0.25]);
        slots.resize(256, 0);
        slots.extend(bytes(&[1.0, 0.0, 0.0, 0.0, 1.8, 0.75]));
        slots.resize(512, 0);
        let placed = filled(
            device,
            "placed",
            wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            &slots,
        );
        let corners = bytes(&[-0.5, -0.5, 0.5, -0.5, 0.5, 0.5, -0.5, 0.5]);
        let corners = filled(device, "corners", wgpu::BufferUsages::VERTEX, &corners);
        let indices: Vec<u8> = [0u16, 1, 2, 0, 2, 3]
            .iter()
            .flat_map(|n| n.to_le_bytes())
            .collect();
        let indices = filled(device, "indices", wgpu::BufferUsages::INDEX, &indices);
        let offsets = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("offsets"),
            size: 48,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::VERTEX,
            mapped_at_creation: false,
        });
        let place = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("place"),
            layout: &layouts.place,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &placed,
                    offset: 0,
                    size: std::num::NonZeroU64::new(32),
                }),
            }],
        });
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("smooth"),
            address_mode_u: wgpu::AddressMode::Repeat,
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        let all = bricks.create_view(&Default::default());
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        let look = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("look"),
            layout: &layouts.look,
            entries: &[
                entry(0, wgpu::BindingResource::TextureView(&all)),
                entry(1, wgpu::BindingResource::Sampler(&sampler)),
                entry(2, wgpu::BindingResource::TextureView(&shadows)),
                entry(3, wgpu::BindingResource::TextureView(&trail)),
            ],
        });
        let pipelines = Pipelines {
            device,
            module: &module,
        };
        let shadow = pipelines.drawn(Some(&layouts.of(device, 1)), "shadow", true, None);
        let lit = pipelines.drawn(
            Some(&layouts.of(device, 2)),
            "shown",
            true,
            Some(("lit", format, None)),
        );
        let more = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::One,
            dst_factor: wgpu::BlendFactor::One,
            operation: wgpu::BlendOperation::Add,
        };
        let added = pipelines.drawn(
            None,
            "everywhere",
            false,
            Some((
                "added",
                wgpu::TextureFormat::R8Unorm,
                Some(wgpu::BlendState {
                    color: more,
                    alpha: more,
                }),
            )),
        );
        let mut bundle =
            device.create_render_bundle_encoder(&wgpu::RenderBundleEncoderDescriptor {
                label: Some("floor"),
                color_formats: &[Some(format)],
                depth_stencil: None,
                sample_count: 1,
                multiview: None,
            });
        bundle.set_pipeline(&lit);
        bundle.set_bind_group(0, &place, &[256]);
        bundle.set_bind_group(1, &look, &[]);
        bundle.set_vertex_buffer(0, corners.slice(..));
        bundle.set_vertex_buffer(1, offsets.slice(16..32));
        bundle.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint16);
        bundle.draw_indexed(0..6, 0, 0..1);
        let bundle = bundle.finish(&Default::default());
        let scene = Self {
            bricks,
            shadows,
            trail,
            placed,
            corners,
            indices,
            offsets,
            shadow,
            lit,
            added,
            place,
            look,
            bundle,
        };
        scene.prepare(device, queue, &pipelines);
        scene
    }

    /// Texels with their smaller levels, and the instances' offsets.
    fn prepare(&self, device: &wgpu::Device, queue: &wgpu::Queue, pipelines: &Pipelines<'_>) {
        let texels: Vec<u8> = (0..64u8)
            .flat_map(|i| [255 - i * 3, (i % 8) * 32, (i / 8) * 32, 255])
            .collect();
        queue.write_texture(
            self.bricks.as_image_copy(),
            &texels,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(32),
                rows_per_image: None,
            },
            wgpu::Extent3d {
                width: 8,
                height: 8,
                depth_or_array_layers: 1,
            },
        );
        let halved = pipelines.drawn(
            None,
            "everywhere",
            false,
            Some(("halved", wgpu::TextureFormat::Rgba8Unorm, None)),
        );
        let spread = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("spread"),
            layout: None,
            module: pipelines.module,
            entry_point: Some("spread"),
            compilation_options: Default::default(),
            cache: None,
        });
        let storage = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("offsets"),
            layout: &spread.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: self.offsets.as_entire_binding(),
            }],
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        for level in 1..4 {
            let view = |level| {
                self.bricks.create_view(&wgpu::TextureViewDescriptor {
                    base_mip_level: level,
                    mip_level_count: Some(1),
                    ..Default::default()
                })
            };
            let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("finer"),
                layout: &halved.get_bind_group_layout(0),
                entries: &[wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(&view(level - 1)),
                }],
            });
            let target = view(level);
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("level"),
                color_attachments: &[color(&target, wgpu::LoadOp::Clear(wgpu::Color::BLACK))],
                ..Default::default()
            });
            pass.set_pipeline(&halved);
            pass.set_bind_group(0, &group, &[]);
            pass.draw(0..3, 0..1);
        }
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&spread);
            pass.set_bind_group(0, &storage, &[]);
            pass.dispatch_workgroups(1, 1, 1);
        }
        queue.submit([encoder.finish()]);
    }

    pub fn frame(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        target: &wgpu::Texture,
        frame: u32,
    ) {
        let angle = 0.3 * frame as f32;
        queue.write_buffer(&self.placed, 0, &bytes(&[angle.cos(), angle.sin()]));
        let target = target.create_view(&Default::default());
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("shadows"),
                color_attachments: &[],
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: &self.shadows,
                    depth_ops: Some(wgpu::Operations {
                        load: wgpu::LoadOp::Clear(1.0),
                        store: wgpu::StoreOp::Store,
                    }),
                    stencil_ops: None,
                }),
                ..Default::default()
            });
            pass.set_pipeline(&self.shadow);
            self.instances(&mut pass);
        }
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("trail"),
                color_attachments: &[color(&self.trail, wgpu::LoadOp::Load)],
                ..Default::default()
            });
            pass.set_pipeline(&self.added);
            pass.draw(0..3, 0..1);
        }
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("main"),
                color_attachments: &[color(&target, wgpu::LoadOp::Clear(wgpu::Color::BLUE))],
                ..Default::default()
            });
            pass.execute_bundles([&self.bundle]);
            pass.set_pipeline(&self.lit);
            pass.set_bind_group(1, &self.look, &[]);
            pass.set_viewport(0.0, 0.0, 64.0, 48.0, 0.0, 1.0);
            self.instances(&mut pass);
        }
        queue.submit([encoder.finish()]);
    }

    fn instances(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_bind_group(0, &self.place, &[0]);
        pass.set_vertex_buffer(0, self.corners.slice(..));
        pass.set_vertex_buffer(1, self.offsets.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint16);
        pass.draw_indexed(0..6, 0, 0..3);
    }
}

fn color(
    view: &wgpu::TextureView,
    load: wgpu::LoadOp<wgpu::Color>,
) -> Option<wgpu::RenderPassColorAttachment<'_>> {
    Some(wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations {
            load,
            store: wgpu::StoreOp::Store,
        },
    })
}

struct Layouts {
    place: wgpu::BindGroupLayout,
    look: wgpu::BindGroupLayout,
}

impl Layouts {
    fn new(device: &wgpu::Device) -> Self {
        let entry = |binding, visibility, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility,
            ty,
            count: None,
        };
        let sampled = |sample_type| wgpu::BindingType::Texture {
            sample_type,
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        let fragment = wgpu::ShaderStages::FRAGMENT;
        Self {
            place: device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("place"),
                entries: &[entry(
                    0,
                    wgpu::ShaderStages::VERTEX,
                    wgpu::BindingType::Buffer {
                        ty: wgpu::BufferBindingType::Uniform,
                        has_dynamic_offset: true,
                        min_binding_size: None,
                    },
                )],
            }),
            look: device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("look"),
                entries: &[
                    entry(
                        0,
                        fragment,
                        sampled(wgpu::TextureSampleType::Float { filterable: true }),
                    ),
                    entry(
                        1,
                        fragment,
                        wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
                    ),
                    entry(2, fragment, sampled(wgpu::TextureSampleType::Depth)),
                    entry(
                        3,
                        fragment,
                        sampled(wgpu::TextureSampleType::Float { filterable: false }),
                    ),
                ],
            }),
        }
    }

    /// The layout of a pipeline with the first groups.
    fn of(&self, device: &wgpu::Device, groups: usize) -> wgpu::PipelineLayout {
        let all = [Some(&self.place), Some(&self.look)];
        device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &all[..groups],
            immediate_size: 0,
        })
    }
}

struct Pipelines<'a> {
    device: &'a wgpu::Device,
    module: &'a wgpu::ShaderModule,
}

impl Pipelines<'_> {
    /// Draws corners with instances, or a triangle over everything. Without a colour it draws depths.
    fn drawn(
        &self,
        layout: Option<&wgpu::PipelineLayout>,
        vertex: &str,
        has_vertices: bool,
        fragment: Option<(&str, wgpu::TextureFormat, Option<wgpu::BlendState>)>,
    ) -> wgpu::RenderPipeline {
        let corners = wgpu::VertexBufferLayout {
            array_stride: 8,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &wgpu::vertex_attr_array![0 => Float32x2],
        };
        let offsets = wgpu::VertexBufferLayout {
            array_stride: 16,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: &wgpu::vertex_attr_array![1 => Float32x4],
        };
        #[cfg(feature = "v29")]
        let buffers = [corners, offsets];
        #[cfg(not(feature = "v29"))]
        let buffers = [Some(corners), Some(offsets)];
        let targets = fragment.map(|(_, format, blend)| {
            [Some(wgpu::ColorTargetState {
                format,
                blend,
                write_mask: wgpu::ColorWrites::ALL,
            })]
        });
        self.device
            .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(fragment.map_or(vertex, |f| f.0)),
                layout,
                vertex: wgpu::VertexState {
                    module: self.module,
                    entry_point: Some(vertex),
                    compilation_options: Default::default(),
                    buffers: if has_vertices { &buffers } else { &[] },
                },
                primitive: wgpu::PrimitiveState::default(),
                depth_stencil: fragment.is_none().then_some(wgpu::DepthStencilState {
                    format: DEPTH,
                    depth_write_enabled: Some(true),
                    depth_compare: Some(wgpu::CompareFunction::LessEqual),
                    stencil: Default::default(),
                    bias: Default::default(),
                }),
                multisample: Default::default(),
                fragment: fragment
                    .zip(targets.as_ref())
                    .map(|((entry, ..), targets)| wgpu::FragmentState {
                        module: self.module,
                        entry_point: Some(entry),
                        compilation_options: Default::default(),
                        targets,
                    }),
                multiview_mask: None,
                cache: None,
            })
    }
}
