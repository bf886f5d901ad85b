//! Converts a plan's pipeline state to wgpu types: one function per type, no decisions.

use preshade_plan::state as plan;
use preshade_plan::state::DepthFormat;

pub(super) fn compare(c: plan::CompareFunction) -> wgpu::CompareFunction {
    use plan::CompareFunction as P;
    use wgpu::CompareFunction as W;
    match c {
        P::Never => W::Never,
        P::Less => W::Less,
        P::Equal => W::Equal,
        P::LessEqual => W::LessEqual,
        P::Greater => W::Greater,
        P::NotEqual => W::NotEqual,
        P::GreaterEqual => W::GreaterEqual,
        P::Always => W::Always,
    }
}

pub(super) fn depth_format(f: DepthFormat) -> wgpu::TextureFormat {
    use wgpu::TextureFormat as W;
    match f {
        DepthFormat::Depth16unorm => W::Depth16Unorm,
        DepthFormat::Depth24plus => W::Depth24Plus,
        DepthFormat::Depth24plusStencil8 => W::Depth24PlusStencil8,
        DepthFormat::Depth32float => W::Depth32Float,
        DepthFormat::Depth32floatStencil8 => W::Depth32FloatStencil8,
    }
}

/// A colour format by WebGPU's name, if frames can be drawn to it and compared.
pub(crate) fn color_format(name: &str) -> Option<wgpu::TextureFormat> {
    use wgpu::TextureFormat as W;
    Some(match name {
        "r8unorm" => W::R8Unorm,
        "rg8unorm" => W::Rg8Unorm,
        "rgba8unorm" => W::Rgba8Unorm,
        "rgba8unorm-srgb" => W::Rgba8UnormSrgb,
        "bgra8unorm" => W::Bgra8Unorm,
        "bgra8unorm-srgb" => W::Bgra8UnormSrgb,
        "rgb10a2unorm" => W::Rgb10a2Unorm,
        "rg11b10ufloat" => W::Rg11b10Ufloat,
        "r16float" => W::R16Float,
        "rg16float" => W::Rg16Float,
        "rgba16float" => W::Rgba16Float,
        "r32float" => W::R32Float,
        "rg32float" => W::Rg32Float,
        "rgba32float" => W::Rgba32Float,
        "r8uint" => W::R8Uint,
        "rgba8uint" => W::Rgba8Uint,
        "r16uint" => W::R16Uint,
        "rg16uint" => W::Rg16Uint,
        "rgba16uint" => W::Rgba16Uint,
        "r32uint" => W::R32Uint,
        "rg32uint" => W::Rg32Uint,
        "rgba32uint" => W::Rgba32Uint,
        "r32sint" => W::R32Sint,
        "rgba32sint" => W::Rgba32Sint,
        _ => return None,
    })
}

pub(super) fn stencil(s: Option<&plan::StencilState>) -> wgpu::StencilState {
    let Some(s) = s else {
        return wgpu::StencilState::default();
    };
    let face = |f: plan::StencilFace| wgpu::StencilFaceState {
        compare: compare(f.compare),
        fail_op: stencil_operation(f.fail),
        depth_fail_op: stencil_operation(f.depth_fail),
        pass_op: stencil_operation(f.pass),
    };
    wgpu::StencilState {
        front: face(s.front),
        back: face(s.back),
        read_mask: s.read_mask,
        write_mask: s.write_mask,
    }
}

fn stencil_operation(o: plan::StencilOperation) -> wgpu::StencilOperation {
    use plan::StencilOperation as P;
    use wgpu::StencilOperation as W;
    match o {
        P::Keep => W::Keep,
        P::Zero => W::Zero,
        P::Replace => W::Replace,
        P::Invert => W::Invert,
        P::IncrementClamp => W::IncrementClamp,
        P::DecrementClamp => W::DecrementClamp,
        P::IncrementWrap => W::IncrementWrap,
        P::DecrementWrap => W::DecrementWrap,
    }
}

pub(super) fn depth_stencil(
    format: DepthFormat,
    depth: &plan::DepthState,
    stencil_state: Option<&plan::StencilState>,
) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: depth_format(format),
        depth_write_enabled: Some(depth.write),
        depth_compare: Some(compare(depth.compare)),
        stencil: stencil(stencil_state),
        bias: wgpu::DepthBiasState {
            constant: depth.bias.constant,
            slope_scale: depth.bias.slope_scale,
            clamp: depth.bias.clamp,
        },
    }
}

pub(super) fn primitive(p: &plan::PrimitiveState) -> wgpu::PrimitiveState {
    use wgpu::PrimitiveTopology as W;
    let topology = match p.topology {
        plan::Topology::PointList => W::PointList,
        plan::Topology::LineList => W::LineList,
        plan::Topology::LineStrip => W::LineStrip,
        plan::Topology::TriangleList => W::TriangleList,
        plan::Topology::TriangleStrip => W::TriangleStrip,
    };
    wgpu::PrimitiveState {
        topology,
        strip_index_format: topology.is_strip().then_some(wgpu::IndexFormat::Uint32),
        front_face: match p.front_face {
            plan::FrontFace::Ccw => wgpu::FrontFace::Ccw,
            plan::FrontFace::Cw => wgpu::FrontFace::Cw,
        },
        cull_mode: match p.cull {
            plan::CullMode::None => None,
            plan::CullMode::Front => Some(wgpu::Face::Front),
            plan::CullMode::Back => Some(wgpu::Face::Back),
        },
        unclipped_depth: p.unclipped_depth,
        polygon_mode: wgpu::PolygonMode::Fill,
        conservative: false,
    }
}

pub(super) fn multisample(m: &plan::Multisample) -> wgpu::MultisampleState {
    wgpu::MultisampleState {
        count: m.count,
        mask: u64::from(m.mask),
        alpha_to_coverage_enabled: m.alpha_to_coverage,
    }
}

pub(super) fn blend(b: &plan::Blend) -> wgpu::BlendState {
    let component = |c: plan::BlendComponent| wgpu::BlendComponent {
        src_factor: blend_factor(c.src),
        dst_factor: blend_factor(c.dst),
        operation: match c.operation {
            plan::BlendOperation::Add => wgpu::BlendOperation::Add,
            plan::BlendOperation::Subtract => wgpu::BlendOperation::Subtract,
            plan::BlendOperation::ReverseSubtract => wgpu::BlendOperation::ReverseSubtract,
            plan::BlendOperation::Min => wgpu::BlendOperation::Min,
            plan::BlendOperation::Max => wgpu::BlendOperation::Max,
        },
    };
    wgpu::BlendState {
        color: component(b.color),
        alpha: component(b.alpha),
    }
}

fn blend_factor(f: plan::BlendFactor) -> wgpu::BlendFactor {
    use plan::BlendFactor as P;
    use wgpu::BlendFactor as W;
    match f {
        P::Zero => W::Zero,
        P::One => W::One,
        P::Src => W::Src,
        P::OneMinusSrc => W::OneMinusSrc,
        P::SrcAlpha => W::SrcAlpha,
        P::OneMinusSrcAlpha => W::OneMinusSrcAlpha,
        P::Dst => W::Dst,
        P::OneMinusDst => W::OneMinusDst,
        P::DstAlpha => W::DstAlpha,
        P::OneMinusDstAlpha => W::OneMinusDstAlpha,
        P::SrcAlphaSaturated => W::SrcAlphaSaturated,
    }
}

#[cfg(test)]
mod tests {
    use super::color_format;
    use preshade_plan::state::COLOR_FORMATS;

    #[test]
    fn every_format_that_is_taken_can_be_drawn_to() {
        for name in COLOR_FORMATS {
            assert!(color_format(name).is_some(), "{name}");
        }
    }
}
