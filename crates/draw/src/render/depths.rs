//! Writes depths by drawing them: WebGPU allows copies to few depth formats, and resolves none.

use preshade_plan::safety::Checks;
use wgpu::{TextureDimension, TextureFormat, TextureUsages, TextureViewDimension};

use super::gpu::Gpu;
use super::upload::{depth_cleared, one_layer, size, upload};
use crate::scene::Image;

/// The source of a texture's depths.
#[derive(Clone, Copy)]
enum Source {
    /// The first channel of a float texture.
    Floats,
    Depths,
    /// The first sample of a multisampled depth texture.
    Samples,
}

/// A position in one layer of a mip level.
pub struct TexelPosition<'t> {
    pub texture: &'t wgpu::Texture,
    pub level: u32,
    pub layer: u32,
    pub at: [u32; 2],
}

/// A depth texture with an image's depths.
pub(super) fn texture(
    gpu: &Gpu,
    image: &Image,
    view: TextureViewDimension,
) -> Result<wgpu::Texture, String> {
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: size(image, view)?,
        mip_level_count: image.levels.len() as u32,
        sample_count: 1,
        dimension: TextureDimension::D2,
        format: TextureFormat::Depth32Float,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    draw(gpu, image, &texture, 0)?;
    Ok(texture)
}

/// Draws an image's depths to a texture of any depth format with the same layers. The image's
/// levels become those of the texture from `first` on.
///
/// # Errors
/// The reason as text: the image has no depths that can be read.
pub fn draw(gpu: &Gpu, image: &Image, texture: &wgpu::Texture, first: u32) -> Result<(), String> {
    let texels = image
        .texels()
        .ok_or_else(|| format!("{:?} stores no depths that can be read", image.format))?;
    let mut bytes = Image {
        format: TextureFormat::R32Float,
        levels: Vec::new(),
        ..image.clone()
    };
    for level in 0..image.levels.len() as u32 {
        let [width, height, layers] = image.extent(level);
        let places = (0..layers).flat_map(|z| (0..height).map(move |y| (y, z)));
        let places = places.flat_map(|(y, z)| (0..width).map(move |x| [x, y, z]));
        let numbers = places.map(|place| texels.at(level, place).map_or(1.0, |t| t[0]));
        let numbers = numbers.flat_map(f32::to_le_bytes).collect();
        bytes.levels.push(numbers);
    }
    let from = upload(
        gpu,
        &bytes,
        TextureViewDimension::D2Array,
        TextureFormat::R32Float,
    )?;
    let pipeline = pipeline(gpu, texture.format(), Source::Floats, [0, 0]);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    for level in 0..image.levels.len() as u32 {
        for layer in 0..texture.depth_or_array_layers() {
            let from = one_layer(&from, level, layer % image.layers.max(1));
            let to = one_layer(texture, first + level, layer);
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: None,
                color_attachments: &[],
                depth_stencil_attachment: Some(depth_cleared(&to, 1.0)),
                ..Default::default()
            });
            stored(gpu, &mut pass, &pipeline, &from);
        }
    }
    gpu.queue.submit([encoder.finish()]);
    Ok(())
}

/// Copies a rectangle of depths into a single-sampled texture. Takes the first of several samples,
/// as drivers do. The stencil stays unchanged.
pub fn copy(
    gpu: &Gpu,
    encoder: &mut wgpu::CommandEncoder,
    from: &TexelPosition<'_>,
    to: &TexelPosition<'_>,
    [width, height]: [u32; 2],
) {
    let source = match from.texture.sample_count() {
        1 => Source::Depths,
        _ => Source::Samples,
    };
    let offset = [0, 1].map(|i| i64::from(from.at[i]) - i64::from(to.at[i]));
    let pipeline = pipeline(gpu, to.texture.format(), source, offset);
    let view = from.texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(TextureViewDimension::D2),
        aspect: wgpu::TextureAspect::DepthOnly,
        base_mip_level: from.level,
        mip_level_count: Some(1),
        base_array_layer: from.layer,
        array_layer_count: Some(1),
        ..Default::default()
    });
    let target = one_layer(to.texture, to.level, to.layer);
    let mut attachment = depth_cleared(&target, 1.0);
    attachment.depth_ops = Some(wgpu::Operations {
        load: wgpu::LoadOp::Load,
        store: wgpu::StoreOp::Store,
    });
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("depths"),
        color_attachments: &[],
        depth_stencil_attachment: Some(attachment),
        ..Default::default()
    });
    pass.set_scissor_rect(to.at[0], to.at[1], width, height);
    stored(gpu, &mut pass, &pipeline, &view);
}

fn stored(
    gpu: &Gpu,
    pass: &mut wgpu::RenderPass<'_>,
    pipeline: &wgpu::RenderPipeline,
    from: &wgpu::TextureView,
) {
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[wgpu::BindGroupEntry {
            binding: 0,
            resource: wgpu::BindingResource::TextureView(from),
        }],
    });
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.draw(0..3, 0..1);
}

/// A pipeline that draws a triangle over the target. It stores the source's value `offset` texels
/// away.
fn pipeline(
    gpu: &Gpu,
    format: TextureFormat,
    source: Source,
    [x, y]: [i64; 2],
) -> wgpu::RenderPipeline {
    let (ty, channel) = match source {
        Source::Floats => ("texture_2d<f32>", ".r"),
        Source::Depths => ("texture_depth_2d", ""),
        Source::Samples => ("texture_depth_multisampled_2d", ""),
    };
    let text = format!(
        "@group(0) @binding(0) var numbers: {ty};
@vertex
fn everywhere(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {{
    return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}}
@fragment
fn stored(@builtin(position) at: vec4f) -> @builtin(frag_depth) f32 {{
    return textureLoad(numbers, vec2i(at.xy) + vec2i({x}, {y}), 0){channel};
}}"
    );
    let module = gpu.shader(
        Checks::default(),
        wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(text.into()),
        },
    );
    gpu.device
        .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: None,
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("everywhere"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Always),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("stored"),
                compilation_options: Default::default(),
                targets: &[],
            }),
            multiview_mask: None,
            cache: None,
        })
}
