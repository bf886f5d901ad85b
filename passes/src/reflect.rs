//! What an entry point really uses: bindings, vertex attributes, outputs, features.

use naga::valid::GlobalUse;
use naga::{
    AddressSpace, Binding, Function, Handle, ImageClass, Module, ShaderStage, StorageAccess, Type,
    TypeInner,
};

use crate::plan::{
    AttributeUse, BindingKind, BindingLayout, BindingSource, BindingUse, ComputePass, GpuPass,
    Visibility,
};
use crate::program::Program;

/// One input or output of an entry point: an argument, a result, or a member of either.
#[derive(Clone, Debug)]
pub struct Io {
    /// Argument or member name.
    pub name: Option<String>,
    /// Type.
    pub ty: Handle<Type>,
    /// Location or builtin.
    pub binding: Option<Binding>,
}

/// The inputs of an entry point, struct arguments opened.
pub fn inputs(module: &Module, function: &Function) -> Vec<Io> {
    opened(module, &function.arguments)
}

/// Arguments as inputs, struct arguments opened.
pub fn opened(module: &Module, arguments: &[naga::FunctionArgument]) -> Vec<Io> {
    arguments
        .iter()
        .flat_map(|a| open(module, a.name.clone(), a.ty, a.binding.clone()))
        .collect()
}

/// The outputs of an entry point, a struct result opened.
pub fn outputs(module: &Module, function: &Function) -> Vec<Io> {
    function
        .result
        .iter()
        .flat_map(|r| open(module, None, r.ty, r.binding.clone()))
        .collect()
}

fn open(
    module: &Module,
    name: Option<String>,
    ty: Handle<Type>,
    binding: Option<Binding>,
) -> Vec<Io> {
    match (&binding, &module.types[ty].inner) {
        (None, TypeInner::Struct { members, .. }) => members
            .iter()
            .map(|m| Io {
                name: m.name.clone(),
                ty: m.ty,
                binding: m.binding.clone(),
            })
            .collect(),
        _ => vec![Io { name, ty, binding }],
    }
}

/// Type and binding of each member of a struct of inputs or outputs; `None` where it is not one.
pub fn members(module: &Module, ty: Handle<Type>) -> Option<Vec<(Handle<Type>, Binding)>> {
    let TypeInner::Struct { members, .. } = &module.types[ty].inner else {
        return None;
    };
    members
        .iter()
        .map(|m| Some((m.ty, m.binding.clone()?)))
        .collect()
}

/// What a global variable with a binding holds; `None` for one without.
pub fn binding_kind(module: &Module, global: &naga::GlobalVariable) -> Option<BindingKind> {
    global.binding.as_ref()?;
    // A binding array holds what its elements hold.
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

/// What a bind group layout says of a global variable with a binding.
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

/// The bindings that entry points use, by group and binding. One that is among `known` keeps its source; others are the author's.
pub fn bindings(
    program: &Program,
    stages: &[(ShaderStage, &str)],
    known: &[BindingUse],
) -> Vec<BindingUse> {
    let module = program.module();
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
            let i = match bindings
                .iter()
                .position(|b| (b.group, b.binding) == (at.group, at.binding))
            {
                Some(i) => i,
                None => {
                    let source = known
                        .iter()
                        .find(|b| (b.group, b.binding) == (at.group, at.binding))
                        .map_or(BindingSource::Author, |b| b.source.clone());
                    bindings.push(BindingUse {
                        group: at.group,
                        binding: at.binding,
                        name: global.name.clone().unwrap_or_default(),
                        kind,
                        visibility: Visibility::default(),
                        layout: binding_layout(module, global, &source),
                        source,
                    });
                    bindings.len() - 1
                }
            };
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

/// Fills a pass's bindings, attributes, features and limits from the entry points it names. A binding that the pass already takes from an attachment, or from a draw's
/// geometry, keeps that source.
pub fn fill(pass: &mut GpuPass, program: &Program) {
    let module = program.module();
    let stages: Vec<(ShaderStage, &str)> = [
        (ShaderStage::Vertex, Some(pass.vertex.as_str())),
        (ShaderStage::Fragment, pass.fragment.as_deref()),
    ]
    .into_iter()
    .filter_map(|(stage, name)| Some((stage, name?)))
    .collect();
    let bindings = bindings(program, &stages, &pass.bindings);
    pass.features = features(pass, module);
    pass.bindings = bindings;
    pass.attributes = match program.entry_point(ShaderStage::Vertex, &pass.vertex) {
        None => Vec::new(),
        Some((_, entry)) => inputs(module, &entry.function)
            .into_iter()
            .filter_map(|io| match io.binding {
                Some(Binding::Location { location, .. }) => Some(AttributeUse {
                    location,
                    name: io.name.unwrap_or_default(),
                    ty: wgsl_type(module, io.ty),
                }),
                _ => None,
            })
            .collect(),
    };
    pass.attributes.sort_by_key(|a| a.location);
    pass.limits = crate::limits::above_default(pass, program);
}

/// Fills a compute pass's bindings, features and limits from the entry point it names, as [`fill`] does.
pub fn fill_compute(pass: &mut ComputePass, program: &Program) {
    let stages = [(ShaderStage::Compute, pass.entry_point.as_str())];
    pass.bindings = bindings(program, &stages, &pass.bindings);
    pass.features = match half_precision(program.module()) {
        true => vec!["shader-f16".to_owned()],
        false => Vec::new(),
    };
    pass.limits = crate::limits::of_compute(pass);
}

/// Whether a module computes with `f16`.
fn half_precision(module: &Module) -> bool {
    let half = |inner: &TypeInner| inner.scalar() == Some(naga::Scalar::F16);
    // A conversion may be all there is of it: its type is then in no arena.
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

/// WebGPU features that a pass needs, by name: from its state, and from the module it draws with.
fn features(pass: &GpuPass, module: &Module) -> Vec<String> {
    let half_precision = half_precision(module);
    let is = |b: &Option<Binding>, builtin: naga::BuiltIn| *b == Some(Binding::BuiltIn(builtin));
    let stages = [
        (ShaderStage::Vertex, Some(pass.vertex.as_str())),
        (ShaderStage::Fragment, pass.fragment.as_deref()),
    ];
    let io: Vec<Io> = module
        .entry_points
        .iter()
        .filter(|e| stages.contains(&(e.stage, Some(e.name.as_str()))))
        .flat_map(|e| {
            inputs(module, &e.function)
                .into_iter()
                .chain(outputs(module, &e.function))
        })
        .collect();
    let dual = |b: &Option<Binding>| {
        matches!(
            b,
            Some(Binding::Location {
                blend_src: Some(_),
                ..
            })
        )
    };
    [
        (
            "clip-distances",
            io.iter()
                .any(|i| is(&i.binding, naga::BuiltIn::ClipDistances)),
        ),
        ("depth-clip-control", pass.primitive.unclipped_depth),
        ("dual-source-blending", io.iter().any(|i| dual(&i.binding))),
        (
            "primitive-index",
            io.iter()
                .any(|i| is(&i.binding, naga::BuiltIn::PrimitiveIndex)),
        ),
        ("shader-f16", half_precision),
    ]
    .into_iter()
    .filter(|(_, needed)| *needed)
    .map(|(name, _)| name.to_owned())
    .collect()
}

/// A scalar, vector or matrix type in WGSL's spelling.
pub fn wgsl_type(module: &Module, ty: Handle<Type>) -> String {
    fn scalar(s: naga::Scalar) -> String {
        use naga::ScalarKind::{AbstractFloat, AbstractInt, Bool, Float, Sint, Uint};
        match s.kind {
            Bool => "bool".to_owned(),
            Sint | AbstractInt => format!("i{}", s.width as u32 * 8),
            Uint => format!("u{}", s.width as u32 * 8),
            Float | AbstractFloat => format!("f{}", s.width as u32 * 8),
        }
    }
    match &module.types[ty].inner {
        TypeInner::Scalar(s) => scalar(*s),
        TypeInner::Vector { size, scalar: s } => format!("vec{}<{}>", *size as u8, scalar(*s)),
        TypeInner::Matrix {
            columns,
            rows,
            scalar: s,
        } => {
            format!("mat{}x{}<{}>", *columns as u8, *rows as u8, scalar(*s))
        }
        _ => module.types[ty]
            .name
            .clone()
            .unwrap_or_else(|| "?".to_owned()),
    }
}
