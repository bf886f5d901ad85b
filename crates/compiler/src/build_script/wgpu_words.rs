//! Writes a plan's values as Rust expressions of wgpu's types, all of them valid in constants. Enum
//! variants that the plan shares with WebGPU have wgpu's names.

use std::collections::BTreeMap;
use std::fmt::Debug;

use preshade_plan::plan::{AttachmentFormat, BindingKind, BindingLayout, BindingUse};
use preshade_plan::state::{
    Blend, BlendComponent, ColorTarget, CullMode, DepthFormat, DepthState, Multisample,
    PrimitiveState, StencilFace, StencilState, Topology,
};

/// `wgpu::PrimitiveState`. Strips have 32-bit indices unless the host sets another format.
pub(super) fn primitive(p: &PrimitiveState) -> String {
    let strip = match p.topology {
        Topology::LineStrip | Topology::TriangleStrip => "Some(wgpu::IndexFormat::Uint32)",
        _ => "None",
    };
    let cull = match p.cull {
        CullMode::None => "None",
        CullMode::Front => "Some(wgpu::Face::Front)",
        CullMode::Back => "Some(wgpu::Face::Back)",
    };
    format!(
        "wgpu::PrimitiveState {{ topology: wgpu::PrimitiveTopology::{:?}, strip_index_format: \
         {strip}, front_face: wgpu::FrontFace::{:?}, cull_mode: {cull}, unclipped_depth: {}, \
         polygon_mode: wgpu::PolygonMode::Fill, conservative: false }}",
        p.topology, p.front_face, p.unclipped_depth
    )
}

pub(super) fn multisample(m: &Multisample) -> String {
    format!(
        "wgpu::MultisampleState {{ count: {}, mask: {}, alpha_to_coverage_enabled: {} }}",
        m.count, m.mask, m.alpha_to_coverage
    )
}

pub(super) fn depth_stencil(
    format: DepthFormat,
    depth: &DepthState,
    stencil: Option<&StencilState>,
) -> String {
    let stencil = match stencil {
        None => "wgpu::StencilState { front: wgpu::StencilFaceState::IGNORE, back: \
                 wgpu::StencilFaceState::IGNORE, read_mask: 0, write_mask: 0 }"
            .to_owned(),
        Some(s) => format!(
            "wgpu::StencilState {{ front: {}, back: {}, read_mask: {}, write_mask: {} }}",
            face(s.front),
            face(s.back),
            s.read_mask,
            s.write_mask
        ),
    };
    format!(
        "wgpu::DepthStencilState {{ format: {}, depth_write_enabled: Some({}), depth_compare: \
         Some(wgpu::CompareFunction::{:?}), stencil: {stencil}, bias: wgpu::DepthBiasState {{ \
         constant: {}, slope_scale: {:?}, clamp: {:?} }} }}",
        depth_format(format),
        depth.write,
        depth.compare,
        depth.bias.constant,
        depth.bias.slope_scale,
        depth.bias.clamp
    )
}

fn face(f: StencilFace) -> String {
    let operation = |o: &dyn Debug| format!("wgpu::StencilOperation::{o:?}");
    format!(
        "wgpu::StencilFaceState {{ compare: wgpu::CompareFunction::{:?}, fail_op: {}, \
         depth_fail_op: {}, pass_op: {} }}",
        f.compare,
        operation(&f.fail),
        operation(&f.depth_fail),
        operation(&f.pass)
    )
}

fn depth_format(format: DepthFormat) -> &'static str {
    match format {
        DepthFormat::Depth16unorm => "wgpu::TextureFormat::Depth16Unorm",
        DepthFormat::Depth24plus => "wgpu::TextureFormat::Depth24Plus",
        DepthFormat::Depth24plusStencil8 => "wgpu::TextureFormat::Depth24PlusStencil8",
        DepthFormat::Depth32float => "wgpu::TextureFormat::Depth32Float",
        DepthFormat::Depth32floatStencil8 => "wgpu::TextureFormat::Depth32FloatStencil8",
    }
}

pub(super) fn attachment_format(format: &AttachmentFormat) -> String {
    match format {
        AttachmentFormat::Depth(format) => depth_format(*format).to_owned(),
        AttachmentFormat::Color(name) => color_format(name),
    }
}

/// Colour formats that can be drawn to, in WebGPU's spelling.
const TARGETS: [&str; 39] = [
    "r8unorm",
    "r8uint",
    "r8sint",
    "r16unorm",
    "r16uint",
    "r16sint",
    "r16float",
    "rg8unorm",
    "rg8uint",
    "rg8sint",
    "r32uint",
    "r32sint",
    "r32float",
    "rg16unorm",
    "rg16uint",
    "rg16sint",
    "rg16float",
    "rgba8unorm",
    "rgba8unorm-srgb",
    "rgba8uint",
    "rgba8sint",
    "bgra8unorm",
    "bgra8unorm-srgb",
    "rgb10a2uint",
    "rgb10a2unorm",
    "rg11b10ufloat",
    "rg32uint",
    "rg32sint",
    "rg32float",
    "rgba16unorm",
    "rgba16uint",
    "rgba16sint",
    "rgba16float",
    "rgba32uint",
    "rgba32sint",
    "rgba32float",
    "r16snorm",
    "rg16snorm",
    "rgba16snorm",
];

/// The reason why no pipeline can draw to a format of this name. `None`: one can.
pub(super) fn no_target(name: &str) -> Option<String> {
    if TARGETS.contains(&name) {
        return None;
    }
    let near = shader_text::nearest::nearest(name, TARGETS);
    let near = near.map_or(String::new(), |near| format!("; did you mean `{near}`?"));
    Some(format!(
        "there is no colour format `{name}` that can be drawn to, in WebGPU's spelling{near}"
    ))
}

/// A colour format in WebGPU's spelling, `rgba8unorm-srgb`, in wgpu's: `Rgba8UnormSrgb`.
pub(super) fn color_format(name: &str) -> String {
    let (name, srgb) = match name.strip_suffix("-srgb") {
        Some(name) => (name, "Srgb"),
        None => (name, ""),
    };
    let kinds = ["unorm", "snorm", "uint", "sint", "ufloat", "float"];
    let kind = kinds.iter().find(|k| name.ends_with(**k)).copied();
    let kind = kind.unwrap_or_default();
    let channels = name.strip_suffix(kind).unwrap_or(name);
    format!(
        "wgpu::TextureFormat::{}{}{srgb}",
        capital(channels),
        capital(kind)
    )
}

fn capital(word: &str) -> String {
    let mut letters = word.chars();
    let first = letters.next().map(|c| c.to_ascii_uppercase());
    first.into_iter().chain(letters).collect()
}

pub(super) fn color_target(target: &ColorTarget) -> String {
    let blend = target
        .blend
        .as_ref()
        .map_or("None".to_owned(), |b| format!("Some({})", blend(b)));
    format!(
        "wgpu::ColorTargetState {{ format: {}, blend: {blend}, write_mask: \
         wgpu::ColorWrites::from_bits_truncate({}) }}",
        color_format(&target.format),
        target.write_mask
    )
}

fn blend(b: &Blend) -> String {
    let component = |c: &BlendComponent| {
        format!(
            "wgpu::BlendComponent {{ src_factor: wgpu::BlendFactor::{:?}, dst_factor: \
             wgpu::BlendFactor::{:?}, operation: wgpu::BlendOperation::{:?} }}",
            c.src, c.dst, c.operation
        )
    };
    format!(
        "wgpu::BlendState {{ color: {}, alpha: {} }}",
        component(&b.color),
        component(&b.alpha)
    )
}

/// `wgpu::BindingType`. `dynamic` and `unfilterable` are the host's settings.
pub(super) fn binding_type(binding: &BindingUse, dynamic: bool, unfilterable: bool) -> String {
    let Some(layout) = &binding.layout else {
        return match binding.kind {
            BindingKind::AccelerationStructure => {
                "wgpu::BindingType::AccelerationStructure { vertex_return: false }".to_owned()
            }
            _ => "wgpu::BindingType::ExternalTexture".to_owned(),
        };
    };
    match layout {
        BindingLayout::Buffer {
            ty,
            min_binding_size,
        } => {
            let ty = match ty.as_str() {
                "uniform" => "Uniform",
                "storage" => "Storage { read_only: false }",
                _ => "Storage { read_only: true }",
            };
            format!(
                "wgpu::BindingType::Buffer {{ ty: wgpu::BufferBindingType::{ty}, \
                 has_dynamic_offset: {dynamic}, min_binding_size: \
                 std::num::NonZeroU64::new({min_binding_size}) }}"
            )
        }
        BindingLayout::Sampler { ty } => {
            let ty = match ty.as_str() {
                "filtering" if !unfilterable => "Filtering",
                "comparison" => "Comparison",
                _ => "NonFiltering",
            };
            format!("wgpu::BindingType::Sampler(wgpu::SamplerBindingType::{ty})")
        }
        BindingLayout::Texture {
            sample_type,
            view_dimension,
            multisampled,
        } => {
            let ty = match sample_type.as_str() {
                "float" if !unfilterable => "Float { filterable: true }",
                "depth" => "Depth",
                "sint" => "Sint",
                "uint" => "Uint",
                _ => "Float { filterable: false }",
            };
            format!(
                "wgpu::BindingType::Texture {{ sample_type: wgpu::TextureSampleType::{ty}, \
                 view_dimension: {}, multisampled: {multisampled} }}",
                dimension(view_dimension)
            )
        }
        BindingLayout::StorageTexture {
            access,
            format,
            view_dimension,
        } => {
            let access = match access.as_str() {
                "write-only" => "WriteOnly",
                "read-only" => "ReadOnly",
                "atomic" => "Atomic",
                _ => "ReadWrite",
            };
            format!(
                "wgpu::BindingType::StorageTexture {{ access: \
                 wgpu::StorageTextureAccess::{access}, format: {}, view_dimension: {} }}",
                color_format(format),
                dimension(view_dimension)
            )
        }
    }
}

fn dimension(name: &str) -> &'static str {
    match name {
        "1d" => "wgpu::TextureViewDimension::D1",
        "2d-array" => "wgpu::TextureViewDimension::D2Array",
        "3d" => "wgpu::TextureViewDimension::D3",
        "cube" => "wgpu::TextureViewDimension::Cube",
        "cube-array" => "wgpu::TextureViewDimension::CubeArray",
        _ => "wgpu::TextureViewDimension::D2",
    }
}

/// The variant of `wgpu::VertexFormat` with the same layout as a WGSL type, and its size in bytes.
pub(super) fn vertex_format(ty: &str) -> Option<(&'static str, u64)> {
    Some(match ty {
        "f32" => ("Float32", 4),
        "vec2<f32>" => ("Float32x2", 8),
        "vec3<f32>" => ("Float32x3", 12),
        "vec4<f32>" => ("Float32x4", 16),
        "i32" => ("Sint32", 4),
        "vec2<i32>" => ("Sint32x2", 8),
        "vec3<i32>" => ("Sint32x3", 12),
        "vec4<i32>" => ("Sint32x4", 16),
        "u32" => ("Uint32", 4),
        "vec2<u32>" => ("Uint32x2", 8),
        "vec3<u32>" => ("Uint32x3", 12),
        "vec4<u32>" => ("Uint32x4", 16),
        "f16" => ("Float16", 2),
        "vec2<f16>" => ("Float16x2", 4),
        // No vertex format has three halves. The fourth is ignored.
        "vec3<f16>" | "vec4<f16>" => ("Float16x4", 8),
        _ => return None,
    })
}

/// Features that a plan may name, with wgpu's constants: those of [`preshade_plan::features`],
/// and those of formats and states.
const FEATURES: [(&str, &str); 47] = [
    ("bgra8unorm-storage", "BGRA8UNORM_STORAGE"),
    ("clip-distances", "CLIP_DISTANCES"),
    ("depth-clip-control", "DEPTH_CLIP_CONTROL"),
    ("depth32float-stencil8", "DEPTH32FLOAT_STENCIL8"),
    ("dual-source-blending", "DUAL_SOURCE_BLENDING"),
    ("float32-blendable", "FLOAT32_BLENDABLE"),
    ("float32-filterable", "FLOAT32_FILTERABLE"),
    ("immediates", "IMMEDIATES"),
    ("indirect-first-instance", "INDIRECT_FIRST_INSTANCE"),
    ("primitive-index", "PRIMITIVE_INDEX"),
    ("rg11b10ufloat-renderable", "RG11B10UFLOAT_RENDERABLE"),
    ("shader-f16", "SHADER_F16"),
    ("subgroups", "SUBGROUP"),
    (
        "wgpu-acceleration-structure-binding-array",
        "ACCELERATION_STRUCTURE_BINDING_ARRAY",
    ),
    ("wgpu-buffer-binding-array", "BUFFER_BINDING_ARRAY"),
    ("wgpu-cooperative-matrix", "EXPERIMENTAL_COOPERATIVE_MATRIX"),
    ("wgpu-external-texture", "EXTERNAL_TEXTURE"),
    (
        "wgpu-memory-decoration-coherent",
        "MEMORY_DECORATION_COHERENT",
    ),
    (
        "wgpu-memory-decoration-volatile",
        "MEMORY_DECORATION_VOLATILE",
    ),
    ("wgpu-mesh-shader", "EXPERIMENTAL_MESH_SHADER"),
    ("wgpu-mesh-shader-points", "EXPERIMENTAL_MESH_SHADER_POINTS"),
    ("wgpu-multiview", "MULTIVIEW"),
    (
        "wgpu-ray-hit-vertex-return",
        "EXPERIMENTAL_RAY_HIT_VERTEX_RETURN",
    ),
    ("wgpu-ray-query", "EXPERIMENTAL_RAY_QUERY"),
    (
        "wgpu-ray-tracing-pipelines",
        "EXPERIMENTAL_RAY_TRACING_PIPELINES",
    ),
    (
        "wgpu-sampled-texture-and-storage-buffer-array-non-uniform-indexing",
        "SAMPLED_TEXTURE_AND_STORAGE_BUFFER_ARRAY_NON_UNIFORM_INDEXING",
    ),
    ("wgpu-shader-barycentrics", "SHADER_BARYCENTRICS"),
    ("wgpu-shader-draw-index", "SHADER_DRAW_INDEX"),
    ("wgpu-shader-early-depth-test", "SHADER_EARLY_DEPTH_TEST"),
    ("wgpu-shader-f64", "SHADER_F64"),
    ("wgpu-shader-float32-atomic", "SHADER_FLOAT32_ATOMIC"),
    ("wgpu-shader-i16", "SHADER_I16"),
    ("wgpu-shader-int64", "SHADER_INT64"),
    (
        "wgpu-shader-int64-atomic-all-ops",
        "SHADER_INT64_ATOMIC_ALL_OPS",
    ),
    (
        "wgpu-shader-int64-atomic-min-max",
        "SHADER_INT64_ATOMIC_MIN_MAX",
    ),
    ("wgpu-shader-per-vertex", "SHADER_PER_VERTEX"),
    (
        "wgpu-storage-resource-binding-array",
        "STORAGE_RESOURCE_BINDING_ARRAY",
    ),
    (
        "wgpu-storage-texture-array-non-uniform-indexing",
        "STORAGE_TEXTURE_ARRAY_NON_UNIFORM_INDEXING",
    ),
    ("wgpu-subgroup-barrier", "SUBGROUP_BARRIER"),
    ("wgpu-subgroup-vertex", "SUBGROUP_VERTEX"),
    (
        "wgpu-texture-adapter-specific-format-features",
        "TEXTURE_ADAPTER_SPECIFIC_FORMAT_FEATURES",
    ),
    ("wgpu-texture-atomic", "TEXTURE_ATOMIC"),
    ("wgpu-texture-binding-array", "TEXTURE_BINDING_ARRAY"),
    (
        "wgpu-texture-format-16-bit-norm",
        "TEXTURE_FORMAT_16BIT_NORM",
    ),
    ("wgpu-texture-int64-atomic", "TEXTURE_INT64_ATOMIC"),
    (
        "wgpu-uniform-buffer-binding-arrays",
        "UNIFORM_BUFFER_BINDING_ARRAYS",
    ),
    ("wgpu-vertex-writable-storage", "VERTEX_WRITABLE_STORAGE"),
];

/// `wgpu::Features` by WebGPU's names, or by wgpu's for native features.
///
/// # Errors
/// There is no such feature.
pub(super) fn features(names: &[String]) -> Result<String, String> {
    names.iter().try_fold(
        "wgpu::Features::empty()".to_owned(),
        |text, name| match FEATURES.iter().find(|(known, _)| known == name) {
            Some((_, constant)) => Ok(format!("{text}.union(wgpu::Features::{constant})")),
            None => Err(format!("it needs the feature `{name}`, which wgpu has not")),
        },
    )
}

/// A function that raises `wgpu::Limits`, by WebGPU's names.
pub(super) fn raise_limits(limits: &BTreeMap<String, u64>) -> String {
    if limits.is_empty() {
        return "|_| ()".to_owned();
    }
    let raised: Vec<String> = limits
        .iter()
        .map(|(name, value)| {
            let field = snake_case(name);
            format!("limits.{field} = limits.{field}.max({value});")
        })
        .collect();
    format!("|limits| {{ {} }}", raised.join(" "))
}

fn snake_case(name: &str) -> String {
    let mut text = String::new();
    for c in name.chars() {
        if c.is_ascii_uppercase() {
            text.push('_');
        }
        text.push(c.to_ascii_lowercase());
    }
    text
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn color_formats_are_wgpus() {
        for name in [
            "rgba8unorm",
            "bgra8unorm-srgb",
            "rg11b10ufloat",
            "rgb10a2unorm",
            "r32float",
            "rgba16uint",
            "r32sint",
        ] {
            let format: wgpu::TextureFormat = serde_json::from_value(name.into()).unwrap();
            assert_eq!(
                color_format(name),
                format!("wgpu::TextureFormat::{format:?}")
            );
        }
    }

    #[test]
    fn limits_have_wgpus_names() {
        let limits = format!("{:?}", wgpu::Limits::default());
        for (name, _) in preshade_plan::limits::DEFAULTS {
            let field = snake_case(name);
            assert!(limits.contains(&format!(" {field}: ")), "{field}");
        }
    }

    #[test]
    fn features_have_wgpus_names_and_none_is_forgotten() {
        use preshade_plan::features::{CAPABILITIES, Has};
        for (name, constant) in FEATURES {
            let named = wgpu::Features::from_name(constant);
            assert_eq!(name.parse().ok(), named, "{name}");
            assert!(named.is_some(), "{constant}");
        }
        for (capability, has) in CAPABILITIES {
            let Has::Features(names) = has else {
                continue;
            };
            let names: Vec<String> = names.iter().map(|n| (*n).to_owned()).collect();
            assert!(features(&names).is_ok(), "{capability:?}");
        }
        let said = features(&["naga-cull-distance".to_owned()]).unwrap_err();
        assert!(said.contains("`naga-cull-distance`, which wgpu has not"));
    }
}
