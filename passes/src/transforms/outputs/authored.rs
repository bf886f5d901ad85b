//! The values of a stage that the author gave a name: inputs, `let`s, variables and their members.

use naga::{Expression, Function, GlobalVariable, Handle, LocalVariable, Module, Span, TypeInner};
use naga_edit::interface;

use crate::analysis::values::{ContextId, Values};
use naga_operands::calls;
use preshade_dataflow::graph::{FunctionId, Graph, StmtId, text};
use preshade_plan::program::Program;

/// Members of members that are looked at.
const DEEPEST: usize = 3;

/// Where a named value is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AuthoredPlace {
    /// An input of the entry point, by index in [`reflect::inputs`].
    Input(usize),
    /// An argument of a function that the entry point calls.
    Argument(FunctionId, u32),
    Expression(FunctionId, Handle<Expression>),
    Local(FunctionId, Handle<LocalVariable>),
    /// A private variable of the module.
    Global(Handle<GlobalVariable>),
}

/// A value that the author named, or a member of one.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Authored {
    /// The name: `normal`, or `surface.normal` for a member.
    pub name: String,
    /// Name of its function; empty for inputs and variables of the module.
    pub function: String,
    /// Where the value that has the name is.
    pub place: AuthoredPlace,
    /// The members that lead from there to the value.
    pub path: Vec<u32>,
    pub inner: TypeInner,
    /// Where it is in the source; undefined for inputs.
    pub span: Span,
    /// The calls that lead from the entry point to its function, where one chain of calls is meant.
    pub calls: Vec<StmtId>,
}

impl Authored {
    /// The value of an expression in one chain of calls. `None`: it is no value that a statement
    /// computes, or that a caller gives.
    pub fn at(values: &Values<'_, '_>, context: ContextId, e: Handle<Expression>) -> Option<Self> {
        let id = values.contexts[context].function;
        let f = values.function(context);
        let place = match f.function.expressions[e] {
            Expression::FunctionArgument(i) => AuthoredPlace::Argument(id, i),
            _ => {
                f.statements.evaluated_at(e)?;
                AuthoredPlace::Expression(id, e)
            }
        };
        let mut calls = Vec::new();
        let mut at = context;
        while let Some((caller, call)) = values.contexts[at].call {
            calls.push(call);
            at = caller;
        }
        calls.reverse();
        Some(Self {
            name: text::expression(values.graph.module(), f, e),
            function: values.graph.name(id),
            place,
            path: Vec::new(),
            inner: f.ty(values.graph.module(), e).clone(),
            span: match place {
                AuthoredPlace::Expression(..) => f.function.expressions.get_span(e),
                _ => Span::UNDEFINED,
            },
            calls,
        })
    }

    /// The function that the value is in; `None` for inputs and variables of the module.
    pub fn function_id(&self) -> Option<FunctionId> {
        match self.place {
            AuthoredPlace::Argument(id, _)
            | AuthoredPlace::Expression(id, _)
            | AuthoredPlace::Local(id, _) => Some(id),
            AuthoredPlace::Input(_) | AuthoredPlace::Global(_) => None,
        }
    }

    /// Whether `name` is this value: its name, or the end of it behind a dot, with `@FUNCTION`
    /// behind if several functions have one, and `:LINE` if one function has several.
    pub fn is_called(&self, name: &str, program: &Program) -> bool {
        let (name, line) = match name.rsplit_once(':') {
            Some((name, line)) => (name, Some(line)),
            None => (name, None),
        };
        let (name, function) = match name.split_once('@') {
            Some((name, function)) => (name, Some(function)),
            None => (name, None),
        };
        let is_end = || {
            let end = self.name.strip_suffix(name);
            end.is_some_and(|rest| rest.ends_with('.'))
        };
        let own_line = || program.sources().locate(self.span).map(|at| at.line);
        function.is_none_or(|f| f == self.function)
            && (self.name == name || is_end())
            && line.is_none_or(|line| own_line().is_some_and(|own| own.to_string() == line))
    }

    /// Whether it is a scalar or a vector.
    pub fn is_plain(&self) -> bool {
        matches!(self.inner, TypeInner::Scalar(_) | TypeInner::Vector { .. })
    }

    /// For messages: name, type, function and line.
    pub fn described(&self, program: &Program) -> String {
        let ty = match self.inner {
            TypeInner::Vector { size, .. } => format!("vec{}", size as u8),
            TypeInner::Matrix { .. } => "matrix".to_owned(),
            TypeInner::Array { .. } => "array".to_owned(),
            TypeInner::Struct { .. } => "struct".to_owned(),
            _ => "scalar".to_owned(),
        };
        let at = match program.sources().locate(self.span) {
            Some(at) => format!(", line {}", at.line),
            None => String::new(),
        };
        let of = match self.function.is_empty() {
            true => String::new(),
            false => format!("@{}", self.function),
        };
        format!("`{}{of}` ({ty}{at})", self.name)
    }
}

/// The calls that lead to a function from an entry point: those of the function itself or, if there
/// is one alone, of its caller.
pub(crate) fn calls_of(graph: &Graph<'_>, entry: usize, function: FunctionId) -> Vec<Span> {
    let module = graph.module();
    let called = calls::called(module, &module.entry_points[entry].function.body);
    let callers = called.iter().map(|h| FunctionId::Function(*h));
    let callers: Vec<FunctionId> = callers.chain([FunctionId::EntryPoint(entry)]).collect();
    let mut function = function;
    loop {
        let FunctionId::Function(callee) = function else {
            return Vec::new();
        };
        let sites: Vec<(FunctionId, Span)> = callers
            .iter()
            .flat_map(|caller| {
                let f = graph.function(*caller);
                let sites = f.calls().filter(|(_, to)| *to == callee);
                sites.map(|(at, _)| (*caller, f.statements.get(at).span))
            })
            .collect();
        match sites[..] {
            [(caller @ FunctionId::Function(_), _)] => function = caller,
            _ => return sites.into_iter().map(|(_, span)| span).collect(),
        }
    }
}

/// The named values of an entry point and of the functions that it calls, matrices, arrays and
/// structs among them.
pub(crate) fn of_entry(program: &Program, entry: usize) -> Vec<Authored> {
    let module = program.module();
    let mut found = Vec::new();
    let point = &module.entry_points[entry];
    let arguments = point.function.arguments.iter();
    let prefixes = arguments.flat_map(|argument| {
        let own = argument.name.clone().unwrap_or_default();
        match interface::members(module, argument.ty) {
            Some(members) if argument.binding.is_none() => vec![format!("{own}."); members.len()],
            _ => vec![String::new()],
        }
    });
    let inputs = interface::inputs(module, &point.function);
    for (i, (input, prefix)) in inputs.into_iter().zip(prefixes).enumerate() {
        let name = format!("{prefix}{}", input.name.unwrap_or_default());
        let at = (String::new(), AuthoredPlace::Input(i), Span::UNDEFINED);
        open(module, &mut found, name, &module.types[input.ty].inner, at);
    }
    let called = calls::called(module, &point.function.body);
    for function in called.iter().rev() {
        let id = FunctionId::Function(*function);
        of_function(program, &mut found, id, &module.functions[*function]);
    }
    of_function(
        program,
        &mut found,
        FunctionId::EntryPoint(entry),
        &point.function,
    );
    let info = program.info().get_entry_point(entry);
    for (handle, global) in module.global_variables.iter() {
        if global.space == naga::AddressSpace::Private
            && !info[handle].is_empty()
            && let Some(name) = global.name.clone()
        {
            let span = module.global_variables.get_span(handle);
            let at = (String::new(), AuthoredPlace::Global(handle), span);
            open(module, &mut found, name, &module.types[global.ty].inner, at);
        }
    }
    found
}

fn of_function(program: &Program, found: &mut Vec<Authored>, id: FunctionId, f: &Function) {
    let module = program.module();
    let (info, name) = match id {
        FunctionId::Function(h) => (&program.info()[h], f.name.clone().unwrap_or_default()),
        FunctionId::EntryPoint(i) => (
            program.info().get_entry_point(i),
            module.entry_points[i].name.clone(),
        ),
    };
    if let FunctionId::Function(_) = id {
        for (i, argument) in f.arguments.iter().enumerate() {
            let own = argument.name.clone().unwrap_or_default();
            let at = (
                name.clone(),
                AuthoredPlace::Argument(id, i as u32),
                Span::UNDEFINED,
            );
            open(module, found, own, &module.types[argument.ty].inner, at);
        }
    }
    for (e, own) in &f.named_expressions {
        // An argument has its own name, and a pointer no value.
        if matches!(f.expressions[*e], Expression::FunctionArgument(_)) {
            continue;
        }
        let at = (
            name.clone(),
            AuthoredPlace::Expression(id, *e),
            f.expressions.get_span(*e),
        );
        let inner = info[*e].ty.inner_with(&module.types);
        open(module, found, own.clone(), inner, at);
    }
    for (local, variable) in f.local_variables.iter() {
        if let Some(own) = variable.name.clone() {
            let at = (
                name.clone(),
                AuthoredPlace::Local(id, local),
                f.local_variables.get_span(local),
            );
            open(module, found, own, &module.types[variable.ty].inner, at);
        }
    }
}

/// Adds a value and its members.
fn open(
    module: &Module,
    found: &mut Vec<Authored>,
    name: String,
    inner: &TypeInner,
    (function, place, span): (String, AuthoredPlace, Span),
) {
    let mut work = vec![(name, inner.clone(), Vec::new())];
    while let Some((name, inner, path)) = work.pop() {
        if let TypeInner::Struct { members, .. } = &inner
            && path.len() < DEEPEST
        {
            for (i, member) in members.iter().enumerate().rev() {
                let own = member.name.as_deref().unwrap_or("?");
                let mut path = path.clone();
                path.push(i as u32);
                let inner = module.types[member.ty].inner.clone();
                work.push((format!("{name}.{own}"), inner, path));
            }
        }
        if matches!(
            inner,
            TypeInner::Scalar(_)
                | TypeInner::Vector { .. }
                | TypeInner::Matrix { .. }
                | TypeInner::Array { .. }
                | TypeInner::Struct { .. }
        ) {
            found.push(Authored {
                name,
                function: function.clone(),
                place,
                path,
                inner,
                span,
                calls: Vec::new(),
            });
        }
    }
}
