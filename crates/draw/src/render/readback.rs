//! Reading textures back, exactly.

use preshade_plan::state::DepthFormat;

use super::gpu::Gpu;
use super::picture::{ColorImage, DepthImage};
use super::{Error, state};

/// Reads a single-sampled colour texture of this format.
pub fn color(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    format: wgpu::TextureFormat,
) -> Result<ColorImage, Error> {
    let bytes = copy(gpu, texture, wgpu::TextureAspect::All, format)?;
    Ok(ColorImage {
        size: [texture.width(), texture.height()],
        format,
        bytes,
    })
}

/// Whether a depth texture can be copied to a buffer bit for bit (WebGPU section 26.1.2). Others
/// are read through a shader.
pub(super) fn is_copyable(format: DepthFormat, samples: u32) -> bool {
    samples == 1
        && matches!(
            format,
            DepthFormat::Depth16unorm
                | DepthFormat::Depth32float
                | DepthFormat::Depth32floatStencil8
        )
}

/// Reads every sample of a depth texture.
pub(super) fn depth(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    format: DepthFormat,
) -> Result<DepthImage, Error> {
    let samples = texture.sample_count();
    let values = if !is_copyable(format, samples) {
        load(gpu, texture, TexelSource::Depth, [0, 0])?
    } else if format == DepthFormat::Depth16unorm {
        copy(
            gpu,
            texture,
            wgpu::TextureAspect::All,
            state::depth_format(format),
        )?
        .as_chunks::<2>()
        .0
        .iter()
        .map(|b| f32::from(u16::from_le_bytes(*b)) / 65_535.0)
        .collect()
    } else {
        floats(&copy(
            gpu,
            texture,
            wgpu::TextureAspect::DepthOnly,
            wgpu::TextureFormat::Depth32Float,
        )?)
    };
    Ok(DepthImage {
        size: [texture.width(), texture.height()],
        samples,
        values,
    })
}

/// Reads the red channel of every sample of a float texture with `TEXTURE_BINDING`, in the layout
/// of [`DepthImage::values`].
pub(super) fn red(gpu: &Gpu, texture: &wgpu::Texture) -> Result<DepthImage, Error> {
    Ok(DepthImage {
        size: [texture.width(), texture.height()],
        samples: texture.sample_count(),
        values: load(gpu, texture, TexelSource::Float, [0, 0])?,
    })
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes
        .as_chunks::<4>()
        .0
        .iter()
        .map(|b| f32::from_le_bytes(*b))
        .collect()
}

/// Copies mip 0 of a flat texture and returns its rows without padding. `format` is the format of the
/// copied aspect.
fn copy(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    aspect: wgpu::TextureAspect,
    format: wgpu::TextureFormat,
) -> Result<Vec<u8>, Error> {
    let size = [texture.width(), texture.height(), 1];
    level(gpu, texture, aspect, format, [0, 0], size)
}

/// Copies one layer of a level, or all slices of a volume's, and returns its rows of blocks without
/// padding. `size` is in texels.
pub fn level(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    aspect: wgpu::TextureAspect,
    format: wgpu::TextureFormat,
    [level, layer]: [u32; 2],
    [width, height, slices]: [u32; 3],
) -> Result<Vec<u8>, Error> {
    let texel = format.block_copy_size(Some(aspect)).unwrap_or(4);
    let (across, down) = format.block_dimensions();
    let (row, rows) = (width.div_ceil(across) * texel, height.div_ceil(down));
    let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let what = "reading a target back";
    let buffer = gpu.checked(what, || {
        gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("readback"),
            size: u64::from(padded) * u64::from(rows) * u64::from(slices),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        })
    })?;
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: level,
            origin: wgpu::Origin3d {
                x: 0,
                y: 0,
                z: layer,
            },
            aspect,
        },
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(padded),
                rows_per_image: Some(rows),
            },
        },
        wgpu::Extent3d {
            width: width.next_multiple_of(across),
            height: height.next_multiple_of(down),
            depth_or_array_layers: slices,
        },
    );
    gpu.submit(what, encoder)?;
    let bytes = gpu.read_buffer(&buffer)?;
    Ok(bytes
        .chunks(padded as usize)
        .flat_map(|r| r.get(..row as usize).unwrap_or(&[]))
        .copied()
        .collect())
}

/// The depths of one layer of a level, for formats that cannot be copied.
pub fn depth_values(gpu: &Gpu, texture: &wgpu::Texture, at: [u32; 2]) -> Result<Vec<f32>, Error> {
    load(gpu, texture, TexelSource::Depth, at)
}

#[derive(Clone, Copy)]
enum TexelSource {
    Depth,
    Float,
}

/// Loads each sample of a layer of a level in a compute shader.
fn load(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    source: TexelSource,
    [mip, layer]: [u32; 2],
) -> Result<Vec<f32>, Error> {
    let [width, height] = [texture.width(), texture.height()].map(|s| (s >> mip).max(1));
    let samples = texture.sample_count();
    let multisampled = samples > 1;
    let what = "reading samples back";
    let ty = match (source, multisampled) {
        (TexelSource::Depth, false) => "texture_depth_2d",
        (TexelSource::Depth, true) => "texture_depth_multisampled_2d",
        (TexelSource::Float, false) => "texture_2d<f32>",
        (TexelSource::Float, true) => "texture_multisampled_2d<f32>",
    };
    let channel = match source {
        TexelSource::Depth => "",
        TexelSource::Float => ".x",
    };
    let level = if multisampled { "i32(sample)" } else { "0" };
    let code = format!(
        "@group(0) @binding(0) var source: {ty};
@group(0) @binding(1) var<storage, read_write> values: array<f32>;
@compute @workgroup_size(8, 8)
fn load(@builtin(global_invocation_id) at: vec3<u32>) {{
    let size = textureDimensions(source);
    if (at.x >= size.x || at.y >= size.y) {{ return; }}
    for (var sample = 0u; sample < {samples}u; sample++) {{
        values[(at.y * size.x + at.x) * {samples}u + sample] = textureLoad(source, \
            vec2<i32>(at.xy), {level}){channel};
    }}
}}"
    );
    let bytes = u64::from(width) * u64::from(height) * u64::from(samples) * 4;
    let (encoder, out) = gpu.checked(what, || {
        let device = &gpu.device;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("readback"),
            source: wgpu::ShaderSource::Wgsl(code.into()),
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("readback"),
            layout: None,
            module: &module,
            entry_point: None,
            compilation_options: Default::default(),
            cache: None,
        });
        let buffer = |usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("readback"),
                size: bytes,
                usage,
                mapped_at_creation: false,
            })
        };
        let values = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
        let out = buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ);
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            aspect: match source {
                TexelSource::Depth => wgpu::TextureAspect::DepthOnly,
                TexelSource::Float => wgpu::TextureAspect::All,
            },
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_mip_level: mip,
            mip_level_count: Some(1),
            base_array_layer: layer,
            array_layer_count: Some(1),
            ..Default::default()
        });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("readback"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(&view),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: values.as_entire_binding(),
                },
            ],
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        }
        encoder.copy_buffer_to_buffer(&values, 0, &out, 0, bytes);
        (encoder, out)
    })?;
    gpu.submit(what, encoder)?;
    Ok(floats(&gpu.read_buffer(&out)?))
}
