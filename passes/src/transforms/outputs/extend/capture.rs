//! A value of the author's, wherever it is computed, at the end of the fragment stage.

use naga::{Expression, Function, GlobalVariable, Handle, LocalVariable, Span, Statement, Type};
use naga_edit::interface;

use super::{Extending, Failed};
use crate::rebuild::insert_after::after;
use crate::transforms::outputs::authored::{Authored, AuthoredPlace};
use naga_edit::writer::FunctionWriter;
use naga_edit::{returns, variable};
use preshade_dataflow::graph::{FunctionGraph, FunctionId};

/// Where the entry point finds a value as it returns.
#[derive(Clone, Debug)]
pub(super) enum Captured {
    /// A value, with the members that lead to the scalar or vector.
    Value(Handle<Expression>, Vec<u32>),
    /// An argument of the entry point.
    Argument(u32, Vec<u32>),
    /// A variable of the entry point.
    Local(Handle<LocalVariable>, Vec<u32>),
    /// A variable of the module.
    Global(Handle<GlobalVariable>, Vec<u32>),
}

impl Captured {
    /// Reads the value at a return.
    pub(super) fn read(&self, writer: &mut FunctionWriter) -> Handle<Expression> {
        let (base, path, is_pointer) = match self {
            Self::Value(value, path) => (*value, path, false),
            Self::Argument(i, path) => {
                let argument = writer.expression(Expression::FunctionArgument(*i));
                (argument, path, false)
            }
            Self::Local(variable, path) => {
                let pointer = writer.expression(Expression::LocalVariable(*variable));
                (pointer, path, true)
            }
            Self::Global(variable, path) => {
                let pointer = writer.expression(Expression::GlobalVariable(*variable));
                (pointer, path, true)
            }
        };
        part(writer, base, path, is_pointer)
    }
}

impl Extending<'_, '_> {
    /// Makes a value available at the returns of the fragment stage's entry point: its last one,
    /// where it is computed several times, and 0 where it is not.
    pub(super) fn capture(
        &mut self,
        fragment: usize,
        value: &Authored,
    ) -> Result<Captured, Failed> {
        let path = value.path.clone();
        Ok(match value.place {
            AuthoredPlace::Input(i) => {
                let missing = || Failed::Built(format!("no argument has `{}`", value.name));
                self.input(fragment, i as u32, path).ok_or_else(missing)?
            }
            AuthoredPlace::Global(variable) => Captured::Global(variable, path),
            AuthoredPlace::Local(FunctionId::EntryPoint(_), variable) => {
                Captured::Local(variable, path)
            }
            AuthoredPlace::Argument(FunctionId::EntryPoint(_), i) => Captured::Argument(i, path),
            AuthoredPlace::Expression(id @ FunctionId::EntryPoint(_), e) => {
                if is_at_hand(self.opaque.graph.function(id), e) {
                    return Ok(Captured::Value(e, path));
                }
                let ty = self.ty(value.inner.clone());
                let function = &mut self.module.entry_points[fragment].function;
                let variable = LocalVariable {
                    name: Some(variable_name(value)),
                    ty,
                    init: None,
                };
                let variable = function.local_variables.append(variable, Span::UNDEFINED);
                store_after(function, e, &path, Expression::LocalVariable(variable));
                Captured::Local(variable, Vec::new())
            }
            AuthoredPlace::Expression(FunctionId::Function(h), e) => {
                let variable = self.private(value);
                let function = &mut self.module.functions[h];
                store_after(function, e, &path, Expression::GlobalVariable(variable));
                Captured::Global(variable, Vec::new())
            }
            AuthoredPlace::Local(FunctionId::Function(h), local) => {
                let variable = self.private(value);
                let function = &mut self.module.functions[h];
                store_at_end(function, &Captured::Local(local, path), variable);
                Captured::Global(variable, Vec::new())
            }
            AuthoredPlace::Argument(FunctionId::Function(h), i) => {
                let variable = self.private(value);
                let function = &mut self.module.functions[h];
                store_at_end(function, &Captured::Argument(i, path), variable);
                Captured::Global(variable, Vec::new())
            }
        })
    }

    /// Keeps a value in a variable of its own, so that it is available at the returns however the
    /// entry point is rewritten before them.
    pub(super) fn keep(&mut self, entry: usize, value: &Authored) -> Result<Captured, Failed> {
        let AuthoredPlace::Expression(FunctionId::EntryPoint(_), e) = value.place else {
            return self.capture(entry, value);
        };
        let variable = self.private(value);
        let function = &mut self.module.entry_points[entry].function;
        store_after(
            function,
            e,
            &value.path,
            Expression::GlobalVariable(variable),
        );
        Ok(Captured::Global(variable, Vec::new()))
    }

    /// An input, by index in the order of `reflect::inputs`.
    fn input(&self, fragment: usize, mut index: u32, mut path: Vec<u32>) -> Option<Captured> {
        let function = &self.module.entry_points[fragment].function;
        for (i, argument) in function.arguments.iter().enumerate() {
            let members = match argument.binding {
                Some(_) => None,
                None => interface::members(&self.module, argument.ty),
            };
            let count = members.as_ref().map_or(1, |m| m.len() as u32);
            if index < count {
                if members.is_some() {
                    path.insert(0, index);
                }
                return Some(Captured::Argument(i as u32, path));
            }
            index -= count;
        }
        None
    }

    /// A private variable for a value of a function.
    fn private(&mut self, value: &Authored) -> Handle<GlobalVariable> {
        let ty: Handle<Type> = self.ty(value.inner.clone());
        variable::private(&mut self.module, &variable_name(value), ty, None)
    }
}

/// The name of a variable that keeps a value.
fn variable_name(value: &Authored) -> String {
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let last = value.name.rsplit('.').next().unwrap_or_default();
    match !last.is_empty() && last.chars().all(is_word) {
        true => format!("captured_{last}"),
        false => "captured_value".to_owned(),
    }
}

/// Whether a value is computed on every way to every return, which may then read it.
fn is_at_hand(f: &FunctionGraph<'_>, e: Handle<Expression>) -> bool {
    let Some(at) = f.statements.evaluated_at(e) else {
        return true;
    };
    let mut before = f.statements.iter().take(at.index());
    f.statements.get(at).parent.is_none()
        && !before.any(|(_, n)| matches!(n.statement, Statement::Return { .. }))
}

/// A member of a value or variable.
fn part(
    writer: &mut FunctionWriter,
    base: Handle<Expression>,
    path: &[u32],
    is_pointer: bool,
) -> Handle<Expression> {
    let end = path.iter().fold(base, |base, index| {
        writer.expression(Expression::AccessIndex {
            base,
            index: *index,
        })
    });
    match is_pointer {
        true => writer.expression(Expression::Load { pointer: end }),
        false => end,
    }
}

/// Stores a part of a value behind the statement that computes it.
fn store_after(function: &mut Function, e: Handle<Expression>, path: &[u32], to: Expression) {
    after(function, &mut |writer, computed| {
        if computed == e {
            let value = part(writer, e, path, false);
            let pointer = writer.expression(to.clone());
            writer.statement(Statement::Store { pointer, value }, Span::UNDEFINED);
        }
    });
}

/// Stores a value at each return of a function.
fn store_at_end(function: &mut Function, captured: &Captured, to: Handle<GlobalVariable>) {
    returns::rewrite(function, &mut |writer, returned| {
        let value = captured.read(writer);
        let pointer = writer.expression(Expression::GlobalVariable(to));
        writer.statement(Statement::Store { pointer, value }, Span::UNDEFINED);
        returned
    });
}
