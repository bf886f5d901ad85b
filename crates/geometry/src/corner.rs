//! The author's vertex stage as a function of any vertex of a draw, for any stage.
//!
//! ```text
//! fn vs_corner(vertex: u32, instance: u32) -> VertexOutput         the author's stage on attributes of `fetch`
//! ```

use naga::{
    Binding, BuiltIn, Expression, Function, FunctionArgument, Handle, Module, Statement, Type,
    TypeInner,
};

use preshade_passes::rebuild::place::CodeBuilder;
use preshade_passes::rebuild::snippet::{define, word};

/// The author's vertex stage as a function.
pub(crate) struct Author<'a> {
    pub function: Handle<Function>,
    pub given: Handle<Type>,
    /// The inputs of the author's entry point.
    pub inputs: &'a [FunctionArgument],
}

/// Adds the author's stage for one vertex, as `NAME_corner`. `fetch` holds the function of each
/// attribute, by location.
///
/// # Errors
/// The reason as text: an input that no vertex has.
pub(crate) fn corner(
    mut module: Module,
    name: &str,
    author: &Author<'_>,
    fetch: &[(u32, Handle<Function>)],
) -> Result<(Module, Handle<Function>), String> {
    let word = word(&mut module);
    let mut failed = None;
    let (module, handle) = define(
        module,
        (name, "corner"),
        &[("vertex", word), ("instance", word)],
        author.given,
        |build, passed| {
            let one = |build: &mut CodeBuilder<'_>, binding: Option<&Binding>| match binding {
                Some(Binding::BuiltIn(BuiltIn::VertexIndex)) => Some(passed[0]),
                Some(Binding::BuiltIn(BuiltIn::InstanceIndex)) => Some(passed[1]),
                Some(Binding::Location { location, .. }) => {
                    let of = fetch.iter().find(|(l, _)| l == location);
                    of.and_then(|(_, f)| build.call(*f, passed.to_vec()))
                }
                _ => None,
            };
            let mut arguments = Vec::new();
            for input in author.inputs {
                let members = match (&input.binding, &build.module().types[input.ty].inner) {
                    (None, TypeInner::Struct { members, .. }) => Some(members.clone()),
                    _ => None,
                };
                let value = match members {
                    None => one(build, input.binding.as_ref()),
                    Some(members) => members
                        .iter()
                        .map(|m| one(build, m.binding.as_ref()))
                        .collect::<Option<Vec<_>>>()
                        .map(|components| {
                            build.expression(Expression::Compose {
                                ty: input.ty,
                                components,
                            })
                        }),
                };
                match value {
                    Some(value) => arguments.push(value),
                    None => failed = Some(input.name.clone().unwrap_or_default()),
                }
            }
            if failed.is_none() {
                let value = build.call(author.function, arguments);
                build.statement(Statement::Return { value });
            }
        },
    );
    match failed {
        None => Ok((module, handle)),
        Some(input) => Err(format!("the input `{input}` has no source")),
    }
}
