//! The scene, and a frame of it: any list of passes of the leaf, executed as they say.

use std::collections::HashMap;

use crate::leaf::{self, Attachment, Pass, Phase, PipelineOptions, ResourceSource, Unfit};

/// Leaves, back to front, so that a pre-pass has something to save.
const LEAVES: usize = 24;

/// What is drawn, on the device.
pub struct Grove {
    pub vertices: wgpu::Buffer,
    count: u32,
    frame: wgpu::Buffer,
    texture: wgpu::TextureView,
    sampler: wgpu::Sampler,
}

/// A variant of the leaf, ready to be drawn at one size.
pub struct Variant {
    passes: Vec<(&'static Pass, wgpu::RenderPipeline, Vec<wgpu::BindGroup>)>,
    attachments: HashMap<&'static str, wgpu::TextureView>,
}

/// The device with what every pass of every variant needs.
pub async fn device(
    instance: &wgpu::Instance,
    surface: Option<&wgpu::Surface<'_>>,
) -> Result<(wgpu::Adapter, wgpu::Device, wgpu::Queue), Box<dyn std::error::Error>> {
    let options = wgpu::RequestAdapterOptions {
        compatible_surface: surface,
        ..Default::default()
    };
    let adapter = instance.request_adapter(&options).await?;
    let mut features = wgpu::Features::empty();
    let mut limits = wgpu::Limits::default();
    let variants = [
        leaf::original::PASSES,
        leaf::PASSES,
        leaf::early_discard::PASSES,
    ];
    let still = leaf::still::CHOICES.iter().flat_map(|v| v.passes);
    for pass in variants.into_iter().flatten().chain(still) {
        features |= pass.features;
        (pass.raise_limits)(&mut limits);
    }
    let descriptor = wgpu::DeviceDescriptor {
        required_features: features,
        required_limits: limits,
        ..Default::default()
    };
    let (device, queue) = adapter.request_device(&descriptor).await?;
    Ok((adapter, device, queue))
}

impl Grove {
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Self {
        let mut vertices: Vec<u8> = Vec::new();
        for i in 0..LEAVES {
            let t = i as f32 / LEAVES as f32;
            let (x, y, z) = (
                0.8 * (i as f32 * 2.4).sin(),
                0.6 * (i as f32 * 1.7).cos(),
                0.9 - 0.8 * t,
            );
            for (dx, dy) in [
                (0.0, 0.0),
                (1.0, 0.0),
                (0.0, 1.0),
                (0.0, 1.0),
                (1.0, 0.0),
                (1.0, 1.0),
            ] {
                for value in [x + dx - 0.5, y + dy - 0.5, z + 0.05 * dx, dx, 1.0 - dy] {
                    vertices.extend(f32::to_le_bytes(value));
                }
            }
        }
        let buffer = |bytes: &[u8], usage| {
            let buffer = device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: bytes.len() as u64,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            queue.write_buffer(&buffer, 0, bytes);
            buffer
        };
        let size = wgpu::Extent3d {
            width: 64,
            height: 64,
            depth_or_array_layers: 1,
        };
        let texels: Vec<u8> = (0..64 * 64)
            .flat_map(|i| {
                let (x, y) = ((i % 64) as f32 / 32.0 - 1.0, (i / 64) as f32 / 32.0 - 1.0);
                let inside = x.abs() < 0.9 * (1.0 - y * y);
                [
                    60,
                    140 + (20.0 * (12.0 * x).sin()) as u8,
                    50,
                    if inside { 255 } else { 0 },
                ]
            })
            .collect();
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("leaf"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(256),
            rows_per_image: None,
        };
        queue.write_texture(texture.as_image_copy(), &texels, layout, size);
        Self {
            count: LEAVES as u32 * 6,
            frame: buffer(&[0; 80], wgpu::BufferUsages::UNIFORM),
            vertices: buffer(&vertices, wgpu::BufferUsages::VERTEX),
            texture: texture.create_view(&Default::default()),
            sampler: device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        }
    }

    /// The same numbers for every pass of a frame; their bytes.
    pub fn set_time(&self, queue: &wgpu::Queue, time: f32) -> Vec<u8> {
        let mut frame = [0.0_f32; 20];
        for i in [0, 5, 10, 15] {
            frame[i] = 1.0;
        }
        frame[16] = time;
        let bytes: Vec<u8> = frame.iter().flat_map(|f| f.to_le_bytes()).collect();
        queue.write_buffer(&self.frame, 0, &bytes);
        bytes
    }

    /// The bind groups of a pass: the author's resources by name, attachments as the pass says.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        pass: &Pass,
        attachment: &dyn Fn(&str) -> Option<wgpu::TextureView>,
    ) -> Vec<wgpu::BindGroup> {
        let layouts = pass.bind_group_layouts(device);
        let groups = pass.groups.iter().zip(&layouts);
        groups
            .map(|(bindings, layout)| {
                let views: Vec<Option<wgpu::TextureView>> = bindings
                    .iter()
                    .map(|b| match b.source {
                        ResourceSource::Attachment(name) => attachment(name),
                        _ => None,
                    })
                    .collect();
                let entries: Vec<wgpu::BindGroupEntry<'_>> = bindings
                    .iter()
                    .zip(&views)
                    .map(|(binding, view)| wgpu::BindGroupEntry {
                        binding: binding.entry.binding,
                        resource: match (view, binding.name) {
                            (Some(view), _) => wgpu::BindingResource::TextureView(view),
                            (None, "frame") => self.frame.as_entire_binding(),
                            (None, "leaf") => wgpu::BindingResource::TextureView(&self.texture),
                            (None, _) => wgpu::BindingResource::Sampler(&self.sampler),
                        },
                    })
                    .collect();
                device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: None,
                    layout,
                    entries: &entries,
                })
            })
            .collect()
    }

    /// Draws the leaves in a render pass whose pipeline is set.
    pub fn draw(&self, render: &mut wgpu::RenderPass<'_>, groups: &[wgpu::BindGroup]) {
        for (index, group) in (0..).zip(groups) {
            render.set_bind_group(index, group, &[]);
        }
        render.set_vertex_buffer(0, self.vertices.slice(..));
        render.draw(0..self.count, 0..1);
    }
}

impl Variant {
    /// Pipelines, bind groups and attachments of `passes`.
    pub fn new(
        device: &wgpu::Device,
        grove: &Grove,
        passes: &[&'static Pass],
        attachments: &'static [Attachment],
        size: wgpu::Extent3d,
        options: &PipelineOptions<'_>,
    ) -> Result<Self, Unfit> {
        let view = |a: &Attachment| {
            (
                a.name,
                a.texture(device, size).create_view(&Default::default()),
            )
        };
        let attachments: HashMap<_, _> = attachments.iter().map(view).collect();
        let find = |name: &str| attachments.get(name).cloned();
        // A shadow pass is for a light's view, of which there is none here.
        let passes = passes.iter().filter(|p| p.phase != Phase::Shadow);
        let passes = passes
            .map(|pass| {
                let pipeline = pass.pipeline_with(device, &[leaf::INTERLEAVED], options)?;
                Ok((*pass, pipeline, grove.bind(device, pass, &find)))
            })
            .collect::<Result<_, Unfit>>()?;
        Ok(Self {
            passes,
            attachments,
        })
    }

    /// A frame of one material: its passes in order.
    pub fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        grove: &Grove,
        color: &wgpu::TextureView,
    ) {
        let mut seen: Vec<&str> = Vec::new();
        let mut first = |name: &'static str| {
            let first = !seen.contains(&name);
            seen.push(name);
            first
        };
        for (pass, pipeline, groups) in &self.passes {
            let sky = wgpu::Color {
                r: 0.5,
                g: 0.7,
                b: 0.9,
                a: 1.0,
            };
            let colors: Vec<_> = pass
                .colors
                .iter()
                .map(|target| {
                    let target = target.as_ref()?;
                    let name = target.attachment.unwrap_or("scene-color-0");
                    let view = target
                        .attachment
                        .map_or(color, |name| &self.attachments[name]);
                    Some(target.attach(view, first(name), sky))
                })
                .collect();
            let depth = pass.depth.as_ref();
            let depth =
                depth.map(|d| d.attach(&self.attachments[d.attachment], first(d.attachment)));
            let mut render = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some(pass.role),
                color_attachments: &colors,
                depth_stencil_attachment: depth,
                ..Default::default()
            });
            render.set_pipeline(pipeline);
            grove.draw(&mut render, groups);
        }
    }
}
