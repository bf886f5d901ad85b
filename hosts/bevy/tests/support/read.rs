//! Reads what passes drew: any texture that a shader can read.

use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::pbr::ViewShadowBindings;
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::render::texture::ColorAttachment;
use bevy::render::view::ViewDepthTexture;

/// The texels of a texture, layer by layer and row by row.
#[derive(Clone, Default, PartialEq)]
pub struct Texels {
    pub size: [u32; 3],
    pub values: Vec<[f32; 4]>,
}

impl std::fmt::Debug for Texels {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "texels of {:?}", self.size)
    }
}

/// What the passes of a view drew.
#[derive(Clone, Debug, Default)]
pub struct Drawn {
    /// After the main pass.
    pub depth: Texels,
    /// After the pre-pass.
    pub ahead: Option<Texels>,
    pub normal: Option<Texels>,
    pub motion: Option<Texels>,
    /// Shadow maps of directional lights, and of point and spot lights.
    pub shadows: [Texels; 2],
}

/// Where the passes of a view draw to.
pub type Targets<'t> = (
    &'t ViewDepthTexture,
    Option<&'t ViewPrepassTextures>,
    Option<&'t ViewShadowBindings>,
);

impl Drawn {
    /// Reads all that the passes drew.
    pub fn of(
        device: &RenderDevice,
        queue: &RenderQueue,
        (depth, ahead, shadows): Targets,
    ) -> Self {
        let texels = |texture: &wgpu::Texture| read(device, queue, texture);
        let of = |of: &Option<ColorAttachment>| of.as_ref().map(|of| texels(&of.texture.texture));
        Self {
            depth: texels(&depth.texture),
            ahead: ahead.and_then(|ahead| of(&ahead.depth)),
            normal: ahead.and_then(|ahead| of(&ahead.normal)),
            motion: ahead.and_then(|ahead| of(&ahead.motion_vectors)),
            shadows: shadows.map_or_else(Default::default, |shadows| {
                [
                    texels(&shadows.directional_light_depth_texture),
                    texels(&shadows.point_light_depth_texture),
                ]
            }),
        }
    }
}

/// How many texels something was drawn to: Bevy clears depth to 0.
pub fn covered(depth: &Texels) -> usize {
    depth.values.iter().filter(|v| v[0] != 0.0).count()
}

/// Copies a texture to memory.
pub fn read(device: &RenderDevice, queue: &RenderQueue, texture: &wgpu::Texture) -> Texels {
    let device = device.wgpu_device();
    let size = texture.size();
    let is_depth = texture.format().is_depth_stencil_format();
    let (ty, load) = match is_depth {
        true => (
            "texture_depth_2d_array",
            "vec4(textureLoad(texels, at.xy, at.z, 0), 0.0, 0.0, 0.0)",
        ),
        false => (
            "texture_2d_array<f32>",
            "textureLoad(texels, at.xy, at.z, 0)",
        ),
    };
    let text = format!(
        "@group(0) @binding(0) var texels: {ty};
        @group(0) @binding(1) var<storage, read_write> out: array<vec4<f32>>;
        @compute @workgroup_size(8, 8) fn main(@builtin(global_invocation_id) at: vec3<u32>) {{
            let size = textureDimensions(texels);
            if (any(at.xy >= size)) {{ return; }}
            out[(at.z * size.y + at.y) * size.x + at.x] = {load};
        }}"
    );
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(text.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("main"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let count =
        u64::from(size.width) * u64::from(size.height) * u64::from(size.depth_or_array_layers);
    let buffer = |usage| {
        device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: count * 16,
            usage,
            mapped_at_creation: false,
        })
    };
    let out = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
    let mapped = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
    let view = texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        aspect: match is_depth {
            true => wgpu::TextureAspect::DepthOnly,
            false => wgpu::TextureAspect::All,
        },
        ..Default::default()
    });
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::TextureView(&view),
            },
            wgpu::BindGroupEntry {
                binding: 1,
                resource: out.as_entire_binding(),
            },
        ],
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(
            size.width.div_ceil(8),
            size.height.div_ceil(8),
            size.depth_or_array_layers,
        );
    }
    encoder.copy_buffer_to_buffer(&out, 0, &mapped, 0, count * 16);
    queue.submit([encoder.finish()]);
    mapped
        .slice(..)
        .map_async(wgpu::MapMode::Read, |result| result.unwrap());
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let bytes = mapped.slice(..).get_mapped_range();
    let number = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let values = bytes
        .chunks_exact(16)
        .map(|texel| [0, 4, 8, 12].map(|at| number(&texel[at..at + 4])))
        .collect();
    Texels {
        size: [size.width, size.height, size.depth_or_array_layers],
        values,
    }
}
