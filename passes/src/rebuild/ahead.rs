//! A part of a stage that runs ahead of the author's code, in the same invocation.

use naga::{
    AddressSpace, Binding, Expression, Function, GlobalVariable, Handle, Module, Span, Statement,
    Type,
};

use crate::core::reflect;
use crate::graph::Graph;
use crate::rebuild::place::{self, CodeBuilder, PositionInvariance};
use crate::slice::Slice;

/// A function made of a slice of a stage.
#[derive(Clone, Debug)]
pub struct Ahead {
    /// The function.
    pub function: Handle<Function>,
    /// Its arguments.
    arguments: Vec<Argument>,
    /// Private variables that it may write. The author's code must find them as they were.
    private: Vec<Handle<GlobalVariable>>,
}

/// An argument made of the entry point's inputs.
#[derive(Clone, Debug)]
enum Argument {
    /// One input.
    Input(Handle<Type>, Binding),
    /// A struct of inputs, a member each.
    Struct(Handle<Type>, Vec<(Handle<Type>, Binding)>),
}

impl Ahead {
    /// Adds `slice` to `module` as a plain function of the stage's inputs.
    pub fn add(
        graph: &Graph<'_>,
        slice: &Slice,
        module: &Module,
        name: &str,
        suffix: &str,
    ) -> Option<(Module, Self)> {
        let invariance = PositionInvariance::AsWritten;
        let mut module = place::entry_point(graph, slice, module, name, suffix, invariance);
        let mut function = module.entry_points.pop()?.function;
        let mut arguments = Vec::new();
        for argument in &mut function.arguments {
            arguments.push(match argument.binding.take() {
                Some(binding) => Argument::Input(argument.ty, binding),
                None => Argument::Struct(argument.ty, reflect::members(&module, argument.ty)?),
            });
        }
        if let Some(result) = &mut function.result {
            result.binding = None;
        }
        function.name = Some(name.to_owned());
        let function = module.functions.append(function, Span::UNDEFINED);
        let is_private =
            |g: &Handle<GlobalVariable>| module.global_variables[*g].space == AddressSpace::Private;
        let private = slice.globals.iter().copied().filter(is_private).collect();
        let ahead = Self {
            function,
            arguments,
            private,
        };
        Some((module, ahead))
    }

    /// Takes the inputs at other locations: `to` gives the new one.
    pub fn relocate(&mut self, to: &dyn Fn(u32) -> u32) {
        let bindings = self
            .arguments
            .iter_mut()
            .flat_map(|argument| match argument {
                Argument::Input(_, binding) => vec![binding],
                Argument::Struct(_, members) => members.iter_mut().map(|(_, b)| b).collect(),
            });
        for binding in bindings {
            if let Binding::Location { location, .. } = binding {
                *location = to(*location);
            }
        }
    }

    /// Calls the function in a prologue, and puts private variables back after it.
    pub fn call(&self, build: &mut CodeBuilder<'_>, name: &str) -> Option<Handle<Expression>> {
        let arguments = self.arguments.iter().map(|a| argument(build, a)).collect();
        let saved: Vec<_> = self.private.iter().map(|g| save(build, *g)).collect();
        let result = build.call(self.function, arguments)?;
        build.name(result, name);
        for (pointer, value) in saved {
            build.statement(Statement::Store { pointer, value });
        }
        Some(result)
    }
}

/// A private variable and its value here.
fn save(
    build: &mut CodeBuilder<'_>,
    variable: Handle<GlobalVariable>,
) -> (Handle<Expression>, Handle<Expression>) {
    let pointer = build.expression(Expression::GlobalVariable(variable));
    (pointer, build.expression(Expression::Load { pointer }))
}

fn argument(build: &mut CodeBuilder<'_>, argument: &Argument) -> Handle<Expression> {
    match argument {
        Argument::Input(ty, binding) => build.input("input", *ty, binding),
        Argument::Struct(ty, members) => {
            let components = members
                .iter()
                .map(|(ty, binding)| build.input("input", *ty, binding))
                .collect();
            build.expression(Expression::Compose {
                ty: *ty,
                components,
            })
        }
    }
}
