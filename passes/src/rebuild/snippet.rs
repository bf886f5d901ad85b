//! Functions of our own in the author's module: linked from WGSL text, or written with a
//! [`CodeBuilder`].

use std::collections::BTreeMap;

use naga::{
    Expression, Function, FunctionArgument, FunctionResult, Handle, Module, Scalar, Span, Type,
    TypeInner,
};

use crate::rebuild::place::{self, CodeBuilder, Rewrite};
use naga_edit::link;
use preshade_dataflow::graph::FunctionId;

/// A source offset beyond every file: our own text has no place in the author's.
pub const NOWHERE: u32 = u32::MAX / 2;

/// A module with our own functions.
pub struct Linked {
    pub module: Module,
    pub ours: BTreeMap<String, Handle<Function>>,
}

impl Linked {
    /// Links the functions of `wgsl` into `module`.
    pub fn new(module: Module, wgsl: &str) -> Result<Self, String> {
        let snippet = naga::front::wgsl::parse_str(wgsl)
            .map_err(|e| format!("our own text does not parse: {}", e.message()))?;
        let linked =
            link::link(module, &snippet, NOWHERE, "preshade").map_err(|e| e.message.clone())?;
        let names = snippet.functions.iter().map(|(_, f)| f.name.clone());
        let named = names.zip(&linked.functions);
        Ok(Self {
            ours: named.filter_map(|(n, h)| Some((n?, *h))).collect(),
            module: linked.module,
        })
    }
}

pub fn ours(
    functions: &BTreeMap<String, Handle<Function>>,
    name: &str,
) -> Result<Handle<Function>, String> {
    let found = functions.get(name).copied();
    found.ok_or_else(|| format!("our own text has no `{name}`"))
}

/// `module` with a snippet of our own, and the snippet's one function.
///
/// # Errors
/// When it does not parse or link.
pub(crate) fn link_snippet(
    module: Module,
    wgsl: &str,
) -> Result<(Module, Handle<Function>), InjectError> {
    let Linked { module, ours } = Linked::new(module, wgsl).map_err(InjectError)?;
    let mut functions = ours.into_values();
    match (functions.next(), functions.next()) {
        (Some(function), None) => Ok((module, function)),
        _ => Err(InjectError("the snippet is not one function".to_owned())),
    }
}

/// A snippet of our own that does not parse: a bug.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct InjectError(pub(crate) String);

/// Defines a function `NAME_SUFFIX` whose body `build` writes.
pub fn define(
    mut module: Module,
    (name, suffix): (&str, &str),
    arguments: &[(&str, Handle<Type>)],
    result: Handle<Type>,
    build: impl FnOnce(&mut CodeBuilder<'_>, &[Handle<Expression>]),
) -> (Module, Handle<Function>) {
    let function = Function {
        name: Some(place::free_name(&module, name, suffix)),
        arguments: arguments
            .iter()
            .map(|(name, ty)| FunctionArgument {
                name: Some((*name).to_owned()),
                ty: *ty,
                binding: None,
            })
            .collect(),
        result: Some(FunctionResult {
            ty: result,
            binding: None,
        }),
        ..Function::default()
    };
    let handle = module.functions.append(function, Span::UNDEFINED);
    let module = place::rewritten(&module, FunctionId::Function(handle), |builder| {
        let passed: Vec<_> = (0..arguments.len() as u32)
            .map(|i| builder.expression(Expression::FunctionArgument(i)))
            .collect();
        build(builder, &passed);
        Rewrite::default()
    });
    (module, handle)
}

pub fn word(module: &mut Module) -> Handle<Type> {
    let inner = TypeInner::Scalar(Scalar::U32);
    module
        .types
        .insert(Type { name: None, inner }, Span::UNDEFINED)
}
