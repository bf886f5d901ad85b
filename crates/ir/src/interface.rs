//! The inputs and outputs of entry points, and the names of their types and stages in WGSL.

use naga::{
    Binding, BuiltIn, Function, Handle, Module, ShaderStage, StructMember, Type, TypeInner,
};

/// One input or output of an entry point: an argument, a result, or a member of either.
#[derive(Clone, Debug)]
pub struct Io {
    /// Argument or member name.
    pub name: Option<String>,
    pub ty: Handle<Type>,
    /// Location or builtin.
    pub binding: Option<Binding>,
}

/// The inputs of an entry point, with struct arguments expanded.
pub fn inputs(module: &Module, function: &Function) -> Vec<Io> {
    opened(module, &function.arguments)
}

/// Arguments as inputs, with struct arguments expanded.
pub fn opened(module: &Module, arguments: &[naga::FunctionArgument]) -> Vec<Io> {
    arguments
        .iter()
        .flat_map(|a| open(module, a.name.clone(), a.ty, a.binding.clone()))
        .collect()
}

/// The outputs of an entry point, with a struct result expanded.
pub fn outputs(module: &Module, function: &Function) -> Vec<Io> {
    function
        .result
        .iter()
        .flat_map(|r| open(module, None, r.ty, r.binding.clone()))
        .collect()
}

/// Changes the binding of each output of an entry point. `edit` receives its name, its type and the
/// binding.
pub fn edit_outputs(
    module: &mut Module,
    entry: usize,
    mut edit: impl FnMut(Option<&str>, &TypeInner, &mut Option<Binding>),
) {
    let Some(result) = &mut module.entry_points[entry].function.result else {
        return;
    };
    let mut ty = module.types[result.ty].clone();
    let TypeInner::Struct { members, .. } = &mut ty.inner else {
        return edit(None, &ty.inner, &mut result.binding);
    };
    for member in members {
        let inner = &module.types[member.ty].inner;
        edit(member.name.as_deref(), inner, &mut member.binding);
    }
    if module.types.get(&ty).is_none() {
        module.types.replace(result.ty, ty);
    }
}

/// The module with an entry point's position marked `@invariant`. For a struct result the mark is
/// in the type. It then affects every entry point that returns the type, and has no effect in
/// fragment stages that take it.
pub fn with_invariant_position(module: &Module, entry: usize) -> Module {
    let mut module = module.clone();
    let Some(result) = module.entry_points[entry].function.result.clone() else {
        return module;
    };
    let marked = invariant(result.binding.clone());
    if marked != result.binding {
        if let Some(result) = &mut module.entry_points[entry].function.result {
            result.binding = marked;
        }
        return module;
    }
    let Type { name, inner } = module.types[result.ty].clone();
    let TypeInner::Struct { members, span } = inner else {
        return module;
    };
    let members_marked: Vec<StructMember> = members
        .iter()
        .map(|m| StructMember {
            binding: invariant(m.binding.clone()),
            ..m.clone()
        })
        .collect();
    if members_marked == members {
        return module;
    }
    // The mark is part of the type, which functions, variables and other types may use, so we
    // replace it in place.
    let mut replaced = Type {
        name,
        inner: TypeInner::Struct {
            members: members_marked,
            span,
        },
    };
    while module.types.get(&replaced).is_some() {
        replaced.name = Some(format!("{}_invariant", replaced.name.unwrap_or_default()));
    }
    module.types.replace(result.ty, replaced);
    module
}

/// A binding, with `@invariant` if it is a position.
pub fn invariant(binding: Option<Binding>) -> Option<Binding> {
    match binding {
        Some(Binding::BuiltIn(BuiltIn::Position { .. })) => {
            Some(Binding::BuiltIn(BuiltIn::Position { invariant: true }))
        }
        other => other,
    }
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

/// Type and binding of each member of a struct of inputs or outputs. `None` for other types.
pub fn members(module: &Module, ty: Handle<Type>) -> Option<Vec<(Handle<Type>, Binding)>> {
    let TypeInner::Struct { members, .. } = &module.types[ty].inner else {
        return None;
    };
    members
        .iter()
        .map(|m| Some((m.ty, m.binding.clone()?)))
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

/// The stage's name in messages.
pub fn stage_name(stage: ShaderStage) -> &'static str {
    match stage {
        ShaderStage::Vertex => "vertex",
        ShaderStage::Fragment => "fragment",
        ShaderStage::Compute => "compute",
        ShaderStage::Task => "task",
        ShaderStage::Mesh => "mesh",
        _ => "ray tracing",
    }
}
