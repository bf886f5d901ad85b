//! Converts objects of wgpu to those of a frame folder. Refuses features that a frame folder cannot
//! express.

use wgpu_core::binding_model::BindGroupLayoutDescriptor;
use wgpu_core::pipeline::{ProgrammableStageDescriptor, VertexBufferLayout as CoreVertexBuffer};
use wgpu_core::resource::{
    BufferDescriptor, SamplerDescriptor, TextureDescriptor, TextureViewDescriptor,
};

use super::paths::stripped;
use super::{OrRefusal, refusal};
use crate::file::{
    AttributeFormat, BindGroupLayout, Blend, BlendComponent, Buffer, BufferLayout, BufferType,
    ColorTarget, Cull, DepthStencil, Extent, IndexFormat, LayoutEntry, Multisample, Primitive,
    SampleType, Sampler, SamplerLayout, Stage, StencilFace, StorageTextureLayout, Texture,
    TextureLayout, Topology, VertexAttribute, VertexBufferLayout, ViewDescriptor,
};

/// Bits of the buffer usages that WebGPU has.
const BUFFER_USAGES: u32 = 0x3ff;
/// Bits of the texture usages that WebGPU has.
const TEXTURE_USAGES: u32 = 0x1f;

pub(super) fn label(of: Option<&str>) -> String {
    of.map(stripped).unwrap_or_default()
}

pub(super) fn buffer(of: &BufferDescriptor<'_>) -> Buffer {
    Buffer {
        size: of.size,
        usage: of.usage.bits() & BUFFER_USAGES,
        label: label(of.label.as_deref()),
    }
}

pub(super) fn texture(of: &TextureDescriptor<'_>) -> Texture {
    Texture {
        size: extent(of.size),
        format: of.format,
        dimension: of.dimension,
        mip_level_count: of.mip_level_count,
        sample_count: of.sample_count,
        usage: of.usage.bits() & TEXTURE_USAGES,
        view_formats: of.view_formats.clone(),
        label: label(of.label.as_deref()),
    }
}

pub(super) fn extent(of: wgpu::Extent3d) -> Extent {
    Extent([of.width, of.height, of.depth_or_array_layers])
}

pub(super) fn view(of: &TextureViewDescriptor<'_>) -> ViewDescriptor {
    ViewDescriptor {
        format: of.format,
        dimension: of.dimension,
        aspect: Some(of.range.aspect),
        base_mip_level: of.range.base_mip_level,
        mip_level_count: of.range.mip_level_count,
        base_array_layer: of.range.base_array_layer,
        array_layer_count: of.range.array_layer_count,
    }
}

pub(super) fn sampler(of: &SamplerDescriptor<'_>) -> OrRefusal<Sampler> {
    if of.address_modes.contains(&wgpu::AddressMode::ClampToBorder) {
        return Err(refusal("a sampler", "WebGPU has no border colour"));
    }
    let [address_mode_u, address_mode_v, address_mode_w] = of.address_modes;
    Ok(Sampler {
        address_mode_u,
        address_mode_v,
        address_mode_w,
        mag_filter: of.mag_filter,
        min_filter: of.min_filter,
        mipmap_filter: of.mipmap_filter,
        lod_min_clamp: of.lod_min_clamp,
        lod_max_clamp: of.lod_max_clamp,
        compare: of.compare,
        max_anisotropy: of.anisotropy_clamp,
    })
}

pub(super) fn group_layout(of: &BindGroupLayoutDescriptor<'_>) -> OrRefusal<BindGroupLayout> {
    let entries = of.entries.iter().map(layout_entry);
    Ok(BindGroupLayout {
        entries: entries.collect::<OrRefusal<Vec<_>>>()?,
    })
}

fn layout_entry(of: &wgpu::BindGroupLayoutEntry) -> OrRefusal<LayoutEntry> {
    const WHAT: &str = "a bind group layout";
    let mut entry = LayoutEntry {
        binding: of.binding,
        visibility: of.visibility.bits(),
        buffer: None,
        sampler: None,
        texture: None,
        storage_texture: None,
    };
    if of.count.is_some() {
        return Err(refusal(WHAT, "it has an array of bindings"));
    }
    match of.ty {
        wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset,
            min_binding_size,
        } => {
            entry.buffer = Some(BufferLayout {
                ty: match ty {
                    wgpu::BufferBindingType::Uniform => BufferType::Uniform,
                    wgpu::BufferBindingType::Storage { read_only: false } => BufferType::Storage,
                    wgpu::BufferBindingType::Storage { read_only: true } => {
                        BufferType::ReadOnlyStorage
                    }
                },
                has_dynamic_offset,
                min_binding_size: min_binding_size.map_or(0, |s| s.get()),
            });
        }
        wgpu::BindingType::Sampler(ty) => entry.sampler = Some(SamplerLayout { ty }),
        wgpu::BindingType::Texture {
            sample_type,
            view_dimension,
            multisampled,
        } => {
            entry.texture = Some(TextureLayout {
                sample_type: match sample_type {
                    wgpu::TextureSampleType::Float { filterable: true } => SampleType::Float,
                    wgpu::TextureSampleType::Float { filterable: false } => {
                        SampleType::UnfilterableFloat
                    }
                    wgpu::TextureSampleType::Depth => SampleType::Depth,
                    wgpu::TextureSampleType::Sint => SampleType::Sint,
                    wgpu::TextureSampleType::Uint => SampleType::Uint,
                },
                view_dimension: Some(view_dimension),
                multisampled,
            });
        }
        wgpu::BindingType::StorageTexture {
            access,
            format,
            view_dimension,
        } => {
            if access == wgpu::StorageTextureAccess::Atomic {
                return Err(refusal(WHAT, "it has a texture for atomic access"));
            }
            entry.storage_texture = Some(StorageTextureLayout {
                access,
                format,
                view_dimension: Some(view_dimension),
            });
        }
        wgpu::BindingType::AccelerationStructure { .. } => {
            return Err(refusal(WHAT, "it has an acceleration structure"));
        }
        wgpu::BindingType::ExternalTexture => {
            return Err(refusal(WHAT, "it has an external texture"));
        }
    }
    Ok(entry)
}

/// A shader stage that names its module by number.
pub(super) fn stage<M>(of: &ProgrammableStageDescriptor<'_, M>, module: usize) -> Stage {
    let constants = of.constants.iter();
    Stage {
        module,
        entry_point: of.entry_point.as_deref().map(str::to_owned),
        constants: constants.map(|(name, v)| (name.clone(), *v)).collect(),
    }
}

pub(super) fn vertex_buffer(of: &CoreVertexBuffer<'_>) -> VertexBufferLayout {
    let attributes = of.attributes.iter().map(|a| VertexAttribute {
        format: AttributeFormat::Own(a.format),
        offset: a.offset,
        shader_location: Some(a.shader_location),
        name: None,
        column: 0,
    });
    VertexBufferLayout {
        array_stride: of.array_stride,
        step_mode: of.step_mode,
        attributes: attributes.collect(),
        divisor: 1,
    }
}

pub(super) fn primitive(of: &wgpu::PrimitiveState) -> OrRefusal<Primitive> {
    const WHAT: &str = "a render pipeline";
    if of.polygon_mode != wgpu::PolygonMode::Fill {
        return Err(refusal(
            WHAT,
            "it draws edges or corners of triangles alone",
        ));
    }
    if of.conservative {
        return Err(refusal(WHAT, "its rasterisation is conservative"));
    }
    Ok(Primitive {
        topology: match of.topology {
            wgpu::PrimitiveTopology::PointList => Topology::PointList,
            wgpu::PrimitiveTopology::LineList => Topology::LineList,
            wgpu::PrimitiveTopology::LineStrip => Topology::LineStrip,
            wgpu::PrimitiveTopology::TriangleList => Topology::TriangleList,
            wgpu::PrimitiveTopology::TriangleStrip => Topology::TriangleStrip,
        },
        strip_index_format: of.strip_index_format.map(index_format),
        front_face: of.front_face,
        cull_mode: match of.cull_mode {
            None => Cull::None,
            Some(wgpu::Face::Front) => Cull::Front,
            Some(wgpu::Face::Back) => Cull::Back,
        },
        unclipped_depth: of.unclipped_depth,
    })
}

pub(super) fn index_format(of: wgpu::IndexFormat) -> IndexFormat {
    match of {
        wgpu::IndexFormat::Uint16 => IndexFormat::Uint16,
        wgpu::IndexFormat::Uint32 => IndexFormat::Uint32,
    }
}

pub(super) fn depth_stencil(of: &wgpu::DepthStencilState) -> DepthStencil {
    let face = |f: wgpu::StencilFaceState| StencilFace {
        compare: f.compare,
        fail_op: f.fail_op,
        depth_fail_op: f.depth_fail_op,
        pass_op: f.pass_op,
    };
    DepthStencil {
        format: of.format,
        depth_write_enabled: of.depth_write_enabled,
        depth_compare: of.depth_compare,
        stencil_front: face(of.stencil.front),
        stencil_back: face(of.stencil.back),
        stencil_read_mask: of.stencil.read_mask,
        stencil_write_mask: of.stencil.write_mask,
        depth_bias: of.bias.constant,
        depth_bias_slope_scale: of.bias.slope_scale,
        depth_bias_clamp: of.bias.clamp,
    }
}

pub(super) fn multisample(of: &wgpu::MultisampleState) -> Multisample {
    Multisample {
        count: of.count,
        mask: of.mask as u32,
        alpha_to_coverage_enabled: of.alpha_to_coverage_enabled,
    }
}

pub(super) fn target(of: &wgpu::ColorTargetState) -> ColorTarget {
    let component = |c: wgpu::BlendComponent| BlendComponent {
        src_factor: c.src_factor,
        dst_factor: c.dst_factor,
        operation: c.operation,
    };
    ColorTarget {
        format: of.format,
        blend: of.blend.map(|b| Blend {
            color: component(b.color),
            alpha: component(b.alpha),
        }),
        write_mask: of.write_mask.bits(),
    }
}
