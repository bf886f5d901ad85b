//! The bindings, vertex attributes, outputs and features that an entry point uses.

use std::collections::HashSet;

use naga::valid::GlobalUse;
use naga::{
    AddressSpace, Binding, Handle, ImageClass, Module, ShaderStage, StorageAccess, TypeInner,
};

use crate::features;
use crate::plan::{
    AttributeUse, BindingKind, BindingLayout, BindingSource, BindingUse, ComputePass, GpuPass,
};
use crate::program::Program;
use naga_edit::interface::{inputs, wgsl_type};

/// The resource kind of a global variable; `None` without a binding.
pub(crate) fn binding_kind(module: &Module, global: &naga::GlobalVariable) -> Option<BindingKind> {
    global.binding.as_ref()?;
    // A binding array has the kind of its elements.
    let inner = match module.types[global.ty].inner {
        TypeInner::BindingArray { base, .. } => &module.types[base].inner,
        ref inner => inner,
    };
    Some(match (&global.space, inner) {
        (AddressSpace::Uniform, _) => BindingKind::Uniform,
        (AddressSpace::Storage { access }, _) if access.contains(StorageAccess::STORE) => {
            BindingKind::StorageReadWrite
        }
        (AddressSpace::Storage { .. }, _) => BindingKind::StorageRead,
        (_, TypeInner::Sampler { comparison: true }) => BindingKind::ComparisonSampler,
        (_, TypeInner::Sampler { .. }) => BindingKind::Sampler,
        (
            _,
            TypeInner::Image {
                class: ImageClass::Depth { .. },
                ..
            },
        ) => BindingKind::DepthTexture,
        (
            _,
            TypeInner::Image {
                class: ImageClass::Storage { .. },
                ..
            },
        ) => BindingKind::StorageTexture,
        (_, TypeInner::AccelerationStructure { .. }) => BindingKind::AccelerationStructure,
        _ => BindingKind::Texture,
    })
}

/// The layout entry of a global variable with a binding.
fn binding_layout(
    module: &Module,
    global: &naga::GlobalVariable,
    source: &BindingSource,
) -> Option<BindingLayout> {
    let inner = match module.types[global.ty].inner {
        TypeInner::BindingArray { base, .. } => &module.types[base].inner,
        ref inner => inner,
    };
    let buffer = |ty: &str| BindingLayout::Buffer {
        ty: ty.to_owned(),
        min_binding_size: u64::from(inner.size(module.to_ctx())),
    };
    Some(match (global.space, inner) {
        (AddressSpace::Uniform, _) => buffer("uniform"),
        (AddressSpace::Storage { access }, _) if access.contains(StorageAccess::STORE) => {
            buffer("storage")
        }
        (AddressSpace::Storage { .. }, _) => buffer("read-only-storage"),
        (_, TypeInner::Sampler { comparison }) => BindingLayout::Sampler {
            ty: if *comparison {
                "comparison"
            } else {
                "filtering"
            }
            .to_owned(),
        },
        (
            _,
            TypeInner::Image {
                dim,
                arrayed,
                class,
            },
        ) => {
            let view_dimension = match (dim, arrayed) {
                (naga::ImageDimension::D1, _) => "1d",
                (naga::ImageDimension::D2, false) => "2d",
                (naga::ImageDimension::D2, true) => "2d-array",
                (naga::ImageDimension::D3, _) => "3d",
                (naga::ImageDimension::Cube, false) => "cube",
                (naga::ImageDimension::Cube, true) => "cube-array",
            }
            .to_owned();
            match class {
                ImageClass::Storage { format, access } => BindingLayout::StorageTexture {
                    access: match (
                        access.contains(StorageAccess::LOAD),
                        access.contains(StorageAccess::STORE),
                    ) {
                        // Only wgpu has it.
                        _ if access.contains(StorageAccess::ATOMIC) => "atomic",
                        (true, true) => "read-write",
                        (true, false) => "read-only",
                        (false, _) => "write-only",
                    }
                    .to_owned(),
                    format: format!("{format:?}").to_lowercase(),
                    view_dimension,
                },
                ImageClass::Depth { multi } => BindingLayout::Texture {
                    sample_type: "depth".to_owned(),
                    view_dimension,
                    multisampled: *multi,
                },
                ImageClass::Sampled { kind, multi } => BindingLayout::Texture {
                    sample_type: match (kind, source) {
                        (naga::ScalarKind::Sint, _) => "sint",
                        (naga::ScalarKind::Uint, _) => "uint",
                        // A depth texture bound as float, and any multisampled one, cannot be filtered.
                        (_, BindingSource::Attachment { .. }) => "unfilterable-float",
                        _ if *multi => "unfilterable-float",
                        _ => "float",
                    }
                    .to_owned(),
                    view_dimension,
                    multisampled: *multi,
                },
                ImageClass::External => return None,
            }
        }
        _ => return None,
    })
}

fn buffer_size(binding: &BindingUse) -> u64 {
    match &binding.layout {
        Some(BindingLayout::Buffer {
            min_binding_size, ..
        }) => *min_binding_size,
        _ => 0,
    }
}

/// Group and binding behind all bindings of the last used group.
pub fn free_binding(module: &Module) -> (u32, u32) {
    let bindings = || {
        let globals = module.global_variables.iter();
        globals.filter_map(|(_, g)| g.binding)
    };
    let group = bindings().map(|b| b.group).max().unwrap_or(0);
    let first = bindings()
        .filter(|b| b.group == group)
        .map(|b| b.binding + 1)
        .max();
    (group, first.unwrap_or(0))
}

/// Two bindings at one number that no bind group layout serves, one of each stage.
pub fn conflict(
    program: &Program,
    [first, second]: [(ShaderStage, &str); 2],
) -> Option<[BindingUse; 2]> {
    let needs = |b: &BindingUse| match &b.layout {
        Some(BindingLayout::Buffer { ty, .. }) => Some(BindingLayout::Buffer {
            ty: ty.clone(),
            min_binding_size: 0,
        }),
        other => other.clone(),
    };
    let others = bindings(program, &[second], &[]);
    bindings(program, &[first], &[]).into_iter().find_map(|b| {
        let mut others = others.iter();
        let other = others.find(|o| (o.group, o.binding) == (b.group, b.binding))?;
        let differ = b.kind != other.kind || needs(&b) != needs(other);
        differ.then(|| [b, other.clone()])
    })
}

/// The samplers, but for comparison samplers, that sample a depth texture: WebGPU filters none.
fn unfiltered(
    program: &Program,
    stages: &[(ShaderStage, &str)],
) -> HashSet<Handle<naga::GlobalVariable>> {
    let module = program.module();
    let entries = stages.iter();
    let entries = entries.filter_map(|(stage, name)| program.entry_point(*stage, name));
    let keys = entries.flat_map(|(index, _)| &program.info().get_entry_point(index).sampling_set);
    let is = |global: Handle<naga::GlobalVariable>, kind| {
        binding_kind(module, &module.global_variables[global]) == Some(kind)
    };
    keys.filter(|key| is(key.image, BindingKind::DepthTexture))
        .filter(|key| is(key.sampler, BindingKind::Sampler))
        .map(|key| key.sampler)
        .collect()
}

/// The bindings of entry points, by group and binding. Those among `known` keep their source;
/// others are the author's. If two stages have a variable each at one binding, the larger counts.
pub fn bindings(
    program: &Program,
    stages: &[(ShaderStage, &str)],
    known: &[BindingUse],
) -> Vec<BindingUse> {
    let module = program.module();
    let unfiltered = unfiltered(program, stages);
    let mut bindings: Vec<BindingUse> = Vec::new();
    for (stage, name) in stages {
        let Some((index, _)) = program.entry_point(*stage, name) else {
            continue;
        };
        let info = program.info().get_entry_point(index);
        for (handle, global) in module.global_variables.iter() {
            let (Some(at), Some(kind)) = (&global.binding, binding_kind(module, global)) else {
                continue;
            };
            if info[handle] == GlobalUse::empty() {
                continue;
            }
            let here = |b: &&BindingUse| (b.group, b.binding) == (at.group, at.binding);
            let known = known.iter().find(here);
            let source = known.map_or(BindingSource::Author, |b| b.source.clone());
            let mut layout = binding_layout(module, global, &source);
            // All passes of a material share its bind groups, and so do those that sample no depth.
            let was = known.and_then(|b| b.layout.as_ref());
            let is_non_filtering = was.is_some_and(|was| *was == BindingLayout::non_filtering());
            if is_non_filtering || unfiltered.contains(&handle) {
                layout = Some(BindingLayout::non_filtering());
            }
            let new = BindingUse {
                name: global.name.clone().unwrap_or_default(),
                layout,
                ..BindingUse::new([at.group, at.binding], kind, source)
            };
            let i = match bindings.iter().position(|b| here(&b)) {
                Some(i) => i,
                None => {
                    bindings.push(new.clone());
                    bindings.len() - 1
                }
            };
            // Each stage may have a variable of its own. The buffer must be large enough for both.
            if buffer_size(&new) > buffer_size(&bindings[i]) {
                bindings[i] = BindingUse {
                    visibility: bindings[i].visibility,
                    ..new
                };
            }
            match stage {
                ShaderStage::Vertex => bindings[i].visibility.vertex = true,
                ShaderStage::Fragment => bindings[i].visibility.fragment = true,
                ShaderStage::Compute => bindings[i].visibility.compute = true,
                _ => {}
            }
        }
    }
    bindings.sort_by_key(|b| (b.group, b.binding));
    bindings
}

/// Fills a pass's bindings, attributes, features and limits from its entry points. A binding with
/// another source than the author keeps it, and so does an attribute.
pub fn fill(pass: &mut GpuPass, program: &Program) {
    let module = program.module();
    let bindings = bindings(program, &pass.stages(), &pass.bindings);
    pass.bindings = bindings;
    // The caller has already added the feature of the depth format.
    let depth = pass.features.iter().find(|f| *f == DEPTH32FLOAT_STENCIL8);
    let depth = depth.filter(|_| pass.depth.is_some()).cloned();
    pass.features = of_pass(pass, program);
    pass.features.extend(depth);
    pass.features.sort_unstable();
    let known = std::mem::take(&mut pass.attributes);
    let previous_of = |location| known.iter().find(|a| a.location == location)?.previous_of;
    pass.attributes = match program.entry_point(ShaderStage::Vertex, &pass.vertex) {
        None => Vec::new(),
        Some((_, entry)) => inputs(module, &entry.function)
            .into_iter()
            .filter_map(|io| match io.binding {
                Some(Binding::Location { location, .. }) => Some(AttributeUse {
                    location,
                    name: io.name.unwrap_or_default(),
                    ty: wgsl_type(module, io.ty),
                    previous_of: previous_of(location),
                }),
                _ => None,
            })
            .collect(),
    };
    pass.attributes.sort_by_key(|a| a.location);
    pass.limits = crate::limits::above_default(pass, program);
}

/// The feature of the depth format of that name.
pub(crate) const DEPTH32FLOAT_STENCIL8: &str = "depth32float-stencil8";

/// Fills a compute pass's bindings, features and limits from the entry point it names, as [`fill`] does.
pub fn fill_compute(pass: &mut ComputePass, program: &Program) {
    let stages = [(ShaderStage::Compute, pass.entry_point.as_str())];
    pass.bindings = bindings(program, &stages, &pass.bindings);
    pass.features = of_module(program, &pass.bindings);
    pass.limits = crate::limits::of_compute(pass, program);
}

/// Whether a module computes with `f16`: its text must enable it, even where the validator finds no
/// use.
fn half_precision(module: &Module) -> bool {
    let half = |inner: &TypeInner| inner.scalar() == Some(naga::Scalar::F16);
    // A conversion may be the only use; its type is then in no arena.
    let converts = |e: &naga::Expression| {
        matches!(
            e,
            naga::Expression::As {
                kind: naga::ScalarKind::Float,
                convert: Some(2),
                ..
            } | naga::Expression::Literal(naga::Literal::F16(_))
        )
    };
    let functions = module.functions.iter().map(|(_, f)| f);
    module.types.iter().any(|(_, t)| half(&t.inner))
        || functions
            .chain(module.entry_points.iter().map(|e| &e.function))
            .any(|f| f.expressions.iter().any(|(_, e)| converts(e)))
}

/// Features that a module needs; `bindings` are those of its entry points in use. A device checks
/// the whole module, unused parts included.
fn of_module(program: &Program, bindings: &[BindingUse]) -> Vec<String> {
    let mut all = features::of_capabilities(program.capabilities());
    all.extend(half_precision(program.module()).then(|| "shader-f16".to_owned()));
    for binding in bindings {
        let writes = match &binding.layout {
            Some(BindingLayout::StorageTexture { access, format, .. }) => {
                all.extend(features::of_storage(format, access).map(str::to_owned));
                access != "read-only"
            }
            _ => binding.kind == BindingKind::StorageReadWrite,
        };
        if binding.visibility.vertex && writes {
            all.push("wgpu-vertex-writable-storage".to_owned());
        }
    }
    all.sort_unstable();
    all.dedup();
    all
}

/// Whether a binding is an array of resources (`binding_array`), which plan layouts can't express.
pub fn is_array(module: &Module, binding: &BindingUse) -> bool {
    module.global_variables.iter().any(|(_, g)| {
        let at = g.binding.map(|b| (b.group, b.binding));
        at == Some((binding.group, binding.binding))
            && matches!(module.types[g.ty].inner, TypeInner::BindingArray { .. })
    })
}

/// Features that a pass needs, by WebGPU's name or else by wgpu's: from its state, and from its
/// module. Its bindings must be filled in.
fn of_pass(pass: &GpuPass, program: &Program) -> Vec<String> {
    let target = |wanted: &dyn Fn(&str, bool) -> bool| {
        let mut targets = pass.targets.iter().flatten();
        targets.any(|t| wanted(&t.format, t.blend.is_some()))
    };
    let several = pass.multisample.count > 1;
    let own = [
        ("depth-clip-control", pass.primitive.unclipped_depth),
        (
            "float32-blendable",
            target(&|f, blended| blended && f.ends_with("32float")),
        ),
        (
            "rg11b10ufloat-renderable",
            target(&|f, _| f == "rg11b10ufloat"),
        ),
        (
            "wgpu-texture-format-16-bit-norm",
            target(&|f, _| features::is_16_bit_norm(f)),
        ),
        // wgpu knows no such target that all adapters support.
        (
            features::ADAPTERS_FORMATS,
            target(&|f, _| features::is_16_bit_norm(f)),
        ),
        // WebGPU has one sample or four, and four not in the widest formats.
        (
            features::ADAPTERS_FORMATS,
            ![1, 4].contains(&pass.multisample.count)
                || several
                    && target(&|f, _| {
                        ["r32uint", "r32sint", "rg32", "rgba32"]
                            .iter()
                            .any(|w| f.starts_with(w))
                    }),
        ),
    ]
    .into_iter()
    .filter(|(_, needed)| *needed)
    .map(|(name, _)| name.to_owned());
    let mut all: Vec<String> = own.collect();
    all.extend(of_module(program, &pass.bindings));
    all.sort_unstable();
    all.dedup();
    all
}
