//! The WebGPU limits that a pass needs raised (WebGPU section 3.6.2).

use std::collections::BTreeMap;

use naga::{AddressSpace, Binding, BuiltIn, Module, ShaderStage};

use crate::geometry::Geometry;
use crate::plan::{BindingKind, BindingLayout, BindingUse, ComputePass, GpuPass};
use crate::program::Program;
use crate::state::Topology;
use naga_edit::interface::{self, Io};

/// Limits by WebGPU's name, with the value that every WebGPU device has.
pub const DEFAULTS: [(&str, u64); 16] = [
    ("maxBindGroups", 4),
    ("maxBindingsPerBindGroup", 1000),
    ("maxColorAttachmentBytesPerSample", 32),
    ("maxColorAttachments", 8),
    ("maxComputeInvocationsPerWorkgroup", 256),
    ("maxComputeWorkgroupSizeX", 256),
    // wgpu's default; immediates are a feature there.
    ("maxImmediateSize", 0),
    ("maxInterStageShaderVariables", 16),
    ("maxSampledTexturesPerShaderStage", 16),
    ("maxSamplersPerShaderStage", 16),
    ("maxStorageBufferBindingSize", 134_217_728),
    ("maxStorageBuffersPerShaderStage", 8),
    ("maxStorageTexturesPerShaderStage", 4),
    ("maxUniformBufferBindingSize", 65_536),
    ("maxUniformBuffersPerShaderStage", 12),
    ("maxVertexAttributes", 16),
];

/// The limits that `pass` needs above their defaults. Its bindings, attributes and targets must be
/// filled in. The number of vertex buffers is the host's choice, so it isn't included.
pub(crate) fn above_default(pass: &GpuPass, program: &Program) -> BTreeMap<String, u64> {
    above(needed(pass, program))
}

/// The limits that a compute pass needs above their defaults. Its bindings must be filled in.
pub(crate) fn of_compute(pass: &ComputePass, program: &Program) -> BTreeMap<String, u64> {
    let count = |kinds: &[BindingKind]| {
        let bindings = pass.bindings.iter();
        bindings.filter(|b| kinds.contains(&b.kind)).count() as u64
    };
    let mut needed = of_bindings(&pass.bindings, &count);
    let side = u64::from(pass.workgroup);
    let invocations = match pass.geometry {
        Geometry::FullScreen | Geometry::Indirect { .. } => side * side,
        _ => side,
    };
    let stages = [(ShaderStage::Compute, pass.entry_point.as_str())];
    let immediates = immediate_size(program, &stages);
    needed.extend([
        ("maxImmediateSize", immediates.into()),
        ("maxComputeInvocationsPerWorkgroup", invocations),
        ("maxComputeWorkgroupSizeX", pass.workgroup.into()),
    ]);
    above(needed)
}

/// Bytes of immediate data that entry points read; 0 if none.
pub fn immediate_size(program: &Program, stages: &[(ShaderStage, &str)]) -> u32 {
    let module = program.module();
    let entries = stages.iter();
    let entries = entries.filter_map(|(stage, name)| program.entry_point(*stage, name));
    entries
        .flat_map(|(index, _)| {
            let info = program.info().get_entry_point(index);
            let globals = module.global_variables.iter();
            globals.filter(move |(handle, global)| {
                global.space == AddressSpace::Immediate && !info[*handle].is_empty()
            })
        })
        .map(|(_, global)| module.types[global.ty].inner.size(module.to_ctx()))
        .max()
        .unwrap_or(0)
}

fn above(needed: BTreeMap<&'static str, u64>) -> BTreeMap<String, u64> {
    DEFAULTS
        .iter()
        .filter_map(|(name, default)| {
            let value = *needed.get(name)?;
            (value > *default).then(|| ((*name).to_owned(), value))
        })
        .collect()
}

fn needed(pass: &GpuPass, program: &Program) -> BTreeMap<&'static str, u64> {
    let per_stage = |kinds: &[BindingKind]| {
        let count = |visible: fn(&BindingUse) -> bool| {
            let bindings = pass.bindings.iter();
            bindings
                .filter(|b| visible(b) && kinds.contains(&b.kind))
                .count()
        };
        count(|b| b.visibility.vertex).max(count(|b| b.visibility.fragment)) as u64
    };
    let mut needed = of_bindings(&pass.bindings, &per_stage);
    let locations = pass.attributes.iter().map(|a| u64::from(a.location) + 1);
    needed.extend([
        ("maxColorAttachmentBytesPerSample", bytes_per_sample(pass)),
        ("maxColorAttachments", pass.targets.len() as u64),
        (
            "maxImmediateSize",
            immediate_size(program, &pass.stages()).into(),
        ),
        ("maxInterStageShaderVariables", inter_stage(pass, program)),
        ("maxVertexAttributes", locations.max().unwrap_or(0)),
    ]);
    needed
}

/// The limits that bindings need. `per_stage` returns the largest count of the given kinds in one
/// stage.
fn of_bindings(
    bindings: &[BindingUse],
    per_stage: &dyn Fn(&[BindingKind]) -> u64,
) -> BTreeMap<&'static str, u64> {
    use BindingKind as K;
    let highest = |number: fn(&BindingUse) -> u32| {
        let numbers = bindings.iter().map(|b| u64::from(number(b)) + 1);
        numbers.max().unwrap_or(0)
    };
    let largest = |uniform: bool| {
        let sizes = bindings.iter().filter_map(|b| match &b.layout {
            Some(BindingLayout::Buffer {
                ty,
                min_binding_size,
            }) if (ty == "uniform") == uniform => Some(*min_binding_size),
            _ => None,
        });
        sizes.max().unwrap_or(0)
    };
    BTreeMap::from([
        ("maxBindGroups", highest(|b| b.group)),
        ("maxBindingsPerBindGroup", highest(|b| b.binding)),
        (
            "maxSampledTexturesPerShaderStage",
            per_stage(&[K::Texture, K::DepthTexture]),
        ),
        (
            "maxSamplersPerShaderStage",
            per_stage(&[K::Sampler, K::ComparisonSampler]),
        ),
        ("maxStorageBufferBindingSize", largest(false)),
        (
            "maxStorageBuffersPerShaderStage",
            per_stage(&[K::StorageRead, K::StorageReadWrite]),
        ),
        (
            "maxStorageTexturesPerShaderStage",
            per_stage(&[K::StorageTexture]),
        ),
        ("maxUniformBufferBindingSize", largest(true)),
        ("maxUniformBuffersPerShaderStage", per_stage(&[K::Uniform])),
    ])
}

/// Inter-stage variables: the locations up to the highest, and the built-in values that take up one
/// (WebGPU section 10.3.1, "validating inter-stage interfaces").
fn inter_stage(pass: &GpuPass, program: &Program) -> u64 {
    let module = program.module();
    let outputs = program
        .entry_point(ShaderStage::Vertex, &pass.vertex)
        .map(|(_, e)| interface::outputs(module, &e.function))
        .unwrap_or_default();
    let inputs = pass
        .fragment
        .as_deref()
        .and_then(|f| program.entry_point(ShaderStage::Fragment, f))
        .map(|(_, e)| interface::inputs(module, &e.function))
        .unwrap_or_default();
    let points = u64::from(pass.primitive.topology == Topology::PointList);
    let count = |all: &[Io], builtins: u64| {
        let locations = all.iter().filter_map(location);
        let taken = locations.clone().count() as u64 + builtins;
        taken.max(locations.max().map_or(0, |l| u64::from(l) + 1))
    };
    let of_outputs: u64 = outputs.iter().map(|io| clip_variables(module, io)).sum();
    let of_inputs = inputs
        .iter()
        .filter(|io| {
            matches!(
                io.binding,
                Some(Binding::BuiltIn(
                    BuiltIn::FrontFacing | BuiltIn::SampleIndex | BuiltIn::SampleMask
                ))
            )
        })
        .count() as u64;
    count(&outputs, of_outputs + points).max(count(&inputs, of_inputs))
}

fn location(io: &Io) -> Option<u32> {
    match io.binding {
        Some(Binding::Location { location, .. }) => Some(location),
        _ => None,
    }
}

/// Variables that clip distances take up: one for each four.
fn clip_variables(module: &Module, io: &Io) -> u64 {
    if io.binding != Some(Binding::BuiltIn(BuiltIn::ClipDistances)) {
        return 0;
    }
    match module.types[io.ty].inner {
        naga::TypeInner::Array {
            size: naga::ArraySize::Constant(n),
            ..
        } => u64::from(n.get().div_ceil(4)),
        _ => 0,
    }
}

/// Bytes per sample of all colour targets, aligned as each format needs (WebGPU section 10.3.3,
/// "calculating color attachment bytes per sample").
fn bytes_per_sample(pass: &GpuPass) -> u64 {
    pass.targets.iter().flatten().fold(0, |bytes: u64, target| {
        let (size, alignment) = cost(&target.format);
        bytes.next_multiple_of(alignment) + size
    })
}

/// "Render target pixel byte cost" and "render target component alignment" of a colour format
/// (WebGPU section 26.1.1), read off its name: the size of its components, and 8 for packed or
/// normalised four-component formats.
fn cost(format: &str) -> (u64, u64) {
    let format = format.trim_end_matches("-srgb");
    match format {
        "rgba8unorm" | "bgra8unorm" => return (8, 1),
        "rgb10a2unorm" | "rgb10a2uint" | "rg11b10ufloat" => return (8, 4),
        _ => {}
    }
    let digits = format.find(|c: char| c.is_ascii_digit()).unwrap_or(0);
    let components = digits as u64;
    let bits: String = format[digits..]
        .chars()
        .take_while(char::is_ascii_digit)
        .collect();
    let bytes = bits.parse::<u64>().map_or(1, |bits| (bits / 8).max(1));
    (components * bytes, bytes)
}

#[cfg(test)]
mod tests {
    use super::cost;

    #[test]
    fn the_cost_of_a_format_is_webgpus() {
        let table = [
            ("r8unorm", (1, 1)),
            ("rg8unorm", (2, 1)),
            ("rgba8unorm-srgb", (8, 1)),
            ("rgba8uint", (4, 1)),
            ("r16float", (2, 2)),
            ("rgba16float", (8, 2)),
            ("rg32uint", (8, 4)),
            ("rgba32float", (16, 4)),
            ("rg11b10ufloat", (8, 4)),
        ];
        for (format, expected) in table {
            assert_eq!(cost(format), expected, "{format}");
        }
    }
}
