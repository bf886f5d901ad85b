//! Adds variables to a module.

use naga::{
    AddressSpace, Expression, GlobalVariable, Handle, MemoryDecorations, Module, Scalar, Span,
    Type, TypeInner,
};

/// Adds a private variable. Without `init` it starts at 0.
pub fn private(
    module: &mut Module,
    name: &str,
    ty: Handle<Type>,
    init: Option<Handle<Expression>>,
) -> Handle<GlobalVariable> {
    let variable = GlobalVariable {
        name: Some(name.to_owned()),
        space: AddressSpace::Private,
        binding: None,
        ty,
        init,
        memory_decorations: MemoryDecorations::empty(),
    };
    module.global_variables.append(variable, Span::UNDEFINED)
}

/// Adds a private bool that starts as `false`.
pub fn private_bool(module: &mut Module, name: &str) -> Handle<GlobalVariable> {
    let bool = Type {
        name: None,
        inner: TypeInner::Scalar(Scalar::BOOL),
    };
    let ty = module.types.insert(bool, Span::UNDEFINED);
    private(module, name, ty, None)
}
