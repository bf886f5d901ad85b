//! A part of a stage that runs ahead of the author's code, in the same invocation.

use std::collections::BTreeMap;

use naga::{
    AddressSpace, Binding, Expression, Function, GlobalVariable, Handle, Module, Span, Statement,
    Type,
};

use crate::rebuild::place::{self, CodeBuilder, PositionInvariance};
use naga_edit::interface;
use preshade_dataflow::graph::Graph;
use preshade_dataflow::slice::Slice;

/// A function made of a slice of a stage.
#[derive(Clone, Debug)]
pub struct Ahead {
    pub function: Handle<Function>,
    arguments: Vec<Argument>,
    /// Private variables that it may write. The author's code must find them as they were.
    private: Vec<Handle<GlobalVariable>>,
}

/// An argument made of the entry point's inputs.
#[derive(Clone, Debug)]
enum Argument {
    Input(Input),
    /// A struct of inputs, a member each.
    Struct(Handle<Type>, Vec<Input>),
}

/// An input of the entry point.
#[derive(Clone, Debug)]
struct Input {
    name: String,
    ty: Handle<Type>,
    binding: Binding,
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
        // In the order of the arguments and of their members.
        let mut inputs = interface::inputs(&module, &function).into_iter();
        let mut input = || {
            let io = inputs.next()?;
            Some(Input {
                name: io.name.unwrap_or_else(|| "input".to_owned()),
                ty: io.ty,
                binding: io.binding?,
            })
        };
        let mut arguments = Vec::new();
        for argument in &mut function.arguments {
            arguments.push(match argument.binding.take() {
                Some(_) => Argument::Input(input()?),
                None => {
                    let members = interface::members(&module, argument.ty)?;
                    let inputs = members.iter().map(|_| input());
                    Argument::Struct(argument.ty, inputs.collect::<Option<_>>()?)
                }
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

    /// Takes inputs at other locations: `to` gives the new ones. `suffix` ends their names.
    pub fn relocate(&mut self, to: &BTreeMap<u32, u32>, suffix: &str) {
        let inputs = self
            .arguments
            .iter_mut()
            .flat_map(|argument| match argument {
                Argument::Input(input) => std::slice::from_mut(input),
                Argument::Struct(_, inputs) => inputs,
            });
        for input in inputs {
            if let Binding::Location { location, .. } = &mut input.binding
                && let Some(other) = to.get(location)
            {
                *location = *other;
                input.name = format!("{}_{suffix}", input.name);
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
    let mut read = |input: &Input| build.input(&input.name, input.ty, &input.binding);
    match argument {
        Argument::Input(input) => read(input),
        Argument::Struct(ty, inputs) => {
            let components = inputs.iter().map(read).collect();
            build.expression(Expression::Compose {
                ty: *ty,
                components,
            })
        }
    }
}
