//! The device features that a module needs, by WebGPU's names, or by wgpu's where WebGPU has none.
//!
//! The first table maps the capabilities of naga's validator, which wgpu checks too. The second is
//! of storage texture formats, which the validator ignores (WebGPU section 26.1.1, "Plain color
//! formats").

use naga::Module;
use naga::valid::{Capabilities as C, ValidationFlags, Validator};

/// The devices that have a capability.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Has {
    Everyone,
    /// A device with all of these features.
    Features(&'static [&'static str]),
    /// No device: wgpu has no feature for it.
    Nobody,
}

use Has::{Everyone, Features, Nobody};

/// Who has each of naga's capabilities. Where either of two is enough, the later one counts.
pub const CAPABILITIES: [(C, Has); 44] = [
    (C::IMMEDIATES, Features(&["immediates"])),
    (C::FLOAT64, Features(&["wgpu-shader-f64"])),
    (C::PRIMITIVE_INDEX, Features(&["primitive-index"])),
    (
        C::TEXTURE_AND_SAMPLER_BINDING_ARRAY,
        Features(&["wgpu-texture-binding-array"]),
    ),
    (
        C::BUFFER_BINDING_ARRAY,
        Features(&["wgpu-buffer-binding-array"]),
    ),
    (
        C::STORAGE_TEXTURE_BINDING_ARRAY,
        Features(&[
            "wgpu-texture-binding-array",
            "wgpu-storage-resource-binding-array",
        ]),
    ),
    (
        C::STORAGE_BUFFER_BINDING_ARRAY,
        Features(&[
            "wgpu-buffer-binding-array",
            "wgpu-storage-resource-binding-array",
        ]),
    ),
    (C::CLIP_DISTANCES, Features(&["clip-distances"])),
    (C::CULL_DISTANCE, Nobody),
    (
        C::STORAGE_TEXTURE_16BIT_NORM_FORMATS,
        Features(&["wgpu-texture-format-16-bit-norm"]),
    ),
    (C::MULTIVIEW, Features(&["wgpu-multiview"])),
    (
        C::EARLY_DEPTH_TEST,
        Features(&["wgpu-shader-early-depth-test"]),
    ),
    (C::MULTISAMPLED_SHADING, Everyone),
    (
        C::RAY_HIT_VERTEX_POSITION,
        Features(&["wgpu-ray-hit-vertex-return"]),
    ),
    (C::RAY_QUERY, Features(&["wgpu-ray-query"])),
    (C::DUAL_SOURCE_BLENDING, Features(&["dual-source-blending"])),
    (C::CUBE_ARRAY_TEXTURES, Everyone),
    (C::SHADER_INT64, Features(&["wgpu-shader-int64"])),
    (C::SUBGROUP_BARRIER, Features(&["wgpu-subgroup-barrier"])),
    (
        C::SUBGROUP_VERTEX_STAGE,
        Features(&["wgpu-subgroup-vertex"]),
    ),
    (C::SUBGROUP, Features(&["subgroups"])),
    (
        C::SHADER_INT64_ATOMIC_ALL_OPS,
        Features(&["wgpu-shader-int64-atomic-all-ops"]),
    ),
    (
        C::SHADER_INT64_ATOMIC_MIN_MAX,
        Features(&["wgpu-shader-int64-atomic-min-max"]),
    ),
    (
        C::SHADER_FLOAT32_ATOMIC,
        Features(&["wgpu-shader-float32-atomic"]),
    ),
    // wgpu permits this format and access only with the feature for all of them.
    (
        C::TEXTURE_INT64_ATOMIC,
        Features(&["wgpu-texture-atomic", "wgpu-texture-int64-atomic"]),
    ),
    (C::TEXTURE_ATOMIC, Features(&["wgpu-texture-atomic"])),
    (C::SHADER_FLOAT16, Features(&["shader-f16"])),
    (C::TEXTURE_EXTERNAL, Features(&["wgpu-external-texture"])),
    (C::SHADER_FLOAT16_IN_FLOAT32, Everyone),
    (
        C::SHADER_BARYCENTRICS,
        Features(&["wgpu-shader-barycentrics"]),
    ),
    (
        C::MESH_SHADER_POINT_TOPOLOGY,
        Features(&["wgpu-mesh-shader-points"]),
    ),
    (C::MESH_SHADER, Features(&["wgpu-mesh-shader"])),
    (
        C::TEXTURE_AND_SAMPLER_BINDING_ARRAY_NON_UNIFORM_INDEXING,
        Features(&["wgpu-sampled-texture-and-storage-buffer-array-non-uniform-indexing"]),
    ),
    (
        C::BUFFER_BINDING_ARRAY_NON_UNIFORM_INDEXING,
        Features(&["wgpu-uniform-buffer-binding-arrays"]),
    ),
    (
        C::STORAGE_TEXTURE_BINDING_ARRAY_NON_UNIFORM_INDEXING,
        Features(&["wgpu-storage-texture-array-non-uniform-indexing"]),
    ),
    (
        C::STORAGE_BUFFER_BINDING_ARRAY_NON_UNIFORM_INDEXING,
        Features(&["wgpu-sampled-texture-and-storage-buffer-array-non-uniform-indexing"]),
    ),
    (
        C::COOPERATIVE_MATRIX,
        Features(&["wgpu-cooperative-matrix"]),
    ),
    (C::PER_VERTEX, Features(&["wgpu-shader-per-vertex"])),
    (
        C::RAY_TRACING_PIPELINE,
        Features(&["wgpu-ray-tracing-pipelines"]),
    ),
    (C::DRAW_INDEX, Features(&["wgpu-shader-draw-index"])),
    (
        C::ACCELERATION_STRUCTURE_BINDING_ARRAY,
        Features(&["wgpu-acceleration-structure-binding-array"]),
    ),
    (
        C::MEMORY_DECORATION_COHERENT,
        Features(&["wgpu-memory-decoration-coherent"]),
    ),
    (
        C::MEMORY_DECORATION_VOLATILE,
        Features(&["wgpu-memory-decoration-volatile"]),
    ),
    (C::SHADER_INT16, Features(&["wgpu-shader-i16"])),
];

/// The capabilities that every WebGPU device has.
pub(crate) fn core() -> C {
    let every = CAPABILITIES.iter().filter(|(_, has)| *has == Everyone);
    every.fold(C::empty(), |all, (capability, _)| all | *capability)
}

/// The capabilities beyond [`core`] that a valid module needs: we remove each that validation
/// doesn't miss.
pub(crate) fn needed(module: &Module) -> C {
    /// Removes from `kept` the capabilities among `some` that validation does not need.
    fn leave_out(module: &Module, kept: &mut C, some: &[C]) {
        let less = some.iter().fold(*kept, |all, one| all - *one);
        let mut validator = Validator::new(ValidationFlags::all(), less);
        if validator.validate(module).is_ok() {
            *kept = less;
        } else if some.len() > 1 {
            let (first, second) = some.split_at(some.len() / 2);
            leave_out(module, kept, first);
            leave_out(module, kept, second);
        }
    }
    let beyond: Vec<C> = CAPABILITIES
        .iter()
        .map(|(capability, _)| *capability)
        .filter(|one| !core().contains(*one))
        .collect();
    let mut kept = C::all();
    leave_out(module, &mut kept, &beyond);
    kept - core()
}

/// The features of capabilities. A capability that no device has keeps naga's name:
/// `naga-cull-distance`.
pub(crate) fn of_capabilities(capabilities: C) -> Vec<String> {
    let mut all = Vec::new();
    for (name, capability) in capabilities.iter_names() {
        let has = CAPABILITIES.iter().find(|(c, _)| *c == capability);
        match has {
            Some((_, Everyone)) => {}
            Some((_, Features(features))) => all.extend(features.iter().map(|f| (*f).to_owned())),
            Some((_, Nobody)) | None => {
                all.push(format!("naga-{}", name.to_lowercase().replace('_', "-")));
            }
        }
    }
    all
}

/// The feature under which an adapter may report its own abilities of any format.
pub(crate) const ADAPTERS_FORMATS: &str = "wgpu-texture-adapter-specific-format-features";

/// The feature that a storage texture needs, from the format and access of its layout.
pub(crate) fn of_storage(format: &str, access: &str) -> Option<&'static str> {
    let (reads, writes) = match access {
        "read-only" => (true, false),
        "write-only" => (false, true),
        _ => (true, true),
    };
    match format {
        "r32float" | "r32sint" | "r32uint" => None,
        // A capability covers it.
        "r64uint" if access == "atomic" => None,
        "bgra8unorm" if !reads => Some("bgra8unorm-storage"),
        _ if reads && writes => Some(ADAPTERS_FORMATS),
        "rgba8unorm" | "rgba8snorm" | "rgba8uint" | "rgba8sint" | "rgba16uint" | "rgba16sint"
        | "rgba16float" | "rg32uint" | "rg32sint" | "rg32float" | "rgba32uint" | "rgba32sint"
        | "rgba32float" | "r64uint" => None,
        // A capability covers them.
        _ if is_16_bit_norm(format) => None,
        _ => Some(ADAPTERS_FORMATS),
    }
}

/// 16-bit formats normalised to 0..1 or -1..1.
pub(crate) fn is_16_bit_norm(format: &str) -> bool {
    format.ends_with("16unorm") || format.ends_with("16snorm")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A new capability in naga fails this test.
    #[test]
    fn every_capability_is_in_the_table_once() {
        for (name, capability) in C::all().iter_names() {
            let rows = CAPABILITIES.iter().filter(|(c, _)| *c == capability);
            assert_eq!(rows.count(), 1, "{name}");
        }
        assert_eq!(C::all().iter_names().count(), CAPABILITIES.len());
    }

    #[test]
    fn what_a_module_needs_is_found_and_no_more() {
        let needed = |text: &str| {
            let module = naga::front::wgsl::parse_str(text);
            let module = module.map_err(|e| e.emit_to_string(text)).unwrap();
            of_capabilities(super::needed(&module))
        };
        let body = |value: &str| {
            format!("@fragment fn f() -> @location(0) vec4<f32> {{ return vec4<f32>({value}); }}")
        };
        for (text, expected) in [
            (body("1.0"), &[][..]),
            (
                format!(
                    "enable f16;\nvar<private> x: f32;\n{}",
                    body("f32(f16(x) * 2.0h)")
                ),
                &["shader-f16"],
            ),
            (
                format!("var<private> x: f32;\n{}", body("f32(f64(x) * 2.0lf)")),
                &["wgpu-shader-f64"],
            ),
            (
                format!("var<private> x: f32;\n{}", body("f32(i64(x) * 2li)")),
                &["wgpu-shader-int64"],
            ),
            (body("subgroupAdd(1.0)"), &["subgroups"]),
            (
                "@vertex fn v() -> @builtin(position) vec4<f32> { \
                 return vec4<f32>(subgroupAdd(1.0)); }"
                    .to_owned(),
                &["wgpu-subgroup-vertex", "subgroups"],
            ),
            (
                format!("@early_depth_test(force) {}", body("1.0")),
                &["wgpu-shader-early-depth-test"],
            ),
            (
                format!("var<immediate> k: f32;\n{}", body("k")),
                &["immediates"],
            ),
            (
                "@fragment fn f(@builtin(view_index) v: u32) -> @location(0) vec4<f32> { \
                 return vec4<f32>(f32(v)); }"
                    .to_owned(),
                &["wgpu-multiview"],
            ),
            (
                "@group(0) @binding(0) var<storage, read_write> a: atomic<u64>;\n\
                 @compute @workgroup_size(1) fn c() { atomicMax(&a, 1lu); }"
                    .to_owned(),
                &["wgpu-shader-int64", "wgpu-shader-int64-atomic-min-max"],
            ),
        ] {
            let mut expected: Vec<&str> = expected.to_vec();
            let mut found = needed(&text);
            expected.sort_unstable();
            found.sort();
            assert_eq!(found, expected, "{text}");
        }
    }

    #[test]
    fn formats_that_not_every_device_stores_to_need_a_feature() {
        for (format, access, feature) in [
            ("rgba8unorm", "write-only", None),
            ("rgba8unorm", "read-write", Some(ADAPTERS_FORMATS)),
            ("r32float", "read-write", None),
            ("r32uint", "atomic", None),
            ("r8unorm", "write-only", Some(ADAPTERS_FORMATS)),
            ("rg16float", "read-only", Some(ADAPTERS_FORMATS)),
            ("rg11b10ufloat", "write-only", Some(ADAPTERS_FORMATS)),
            ("rgb10a2unorm", "write-only", Some(ADAPTERS_FORMATS)),
            ("bgra8unorm", "write-only", Some("bgra8unorm-storage")),
            ("bgra8unorm", "read-only", Some(ADAPTERS_FORMATS)),
            ("rgba16unorm", "write-only", None),
        ] {
            assert_eq!(of_storage(format, access), feature, "{format} {access}");
        }
    }
}
