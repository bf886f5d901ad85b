//! The hoisted work as a function from the author's varyings to the moved values.
//!
//! ```text
//! fn hoisted(varyings: VertexOutput_hoisted) -> Hoisted
//! ```
//!
//! It is the author's fragment stage with another result, sliced to that result.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    AddressSpace, Binding, Block, Expression, Function, FunctionArgument, FunctionResult, Handle,
    LocalVariable, Module, Span, Statement, StructMember, Type, TypeInner,
};

use crate::analysis::values::{ContextId, ValueId, Values};
use crate::analysis::{named, refusals};
use crate::rebuild::color::location;
use crate::rebuild::insert_after::after;
use crate::rebuild::isolate::isolate;
use crate::rebuild::place::{self, PositionInvariance};
use naga_edit::returns;
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_dataflow::slice::{self, Criterion, OutputFilter};
use preshade_plan::pass::Refusal;
use preshade_plan::program::Program;

#[derive(Clone, Debug)]
pub struct Wanted {
    /// The chain of calls that computes it.
    pub context: ContextId,
    pub expression: Handle<Expression>,
    /// A scalar or vector type.
    pub inner: TypeInner,
    pub name: String,
}

/// The values to return, with distinct names; `unnamed` is the name of those that have none.
pub(crate) fn wanted(
    values: &Values<'_, '_>,
    ids: impl IntoIterator<Item = ValueId>,
    unnamed: &str,
) -> Vec<Wanted> {
    let mut taken: BTreeSet<String> = BTreeSet::new();
    ids.into_iter()
        .filter_map(|id| {
            let (context, expression, _) = values.expression(id)?;
            let base = named::name(values, id).unwrap_or_else(|| unnamed.to_owned());
            let mut name = base.clone();
            // The first value with a name keeps it.
            for i in 1.. {
                if taken.insert(name.clone()) {
                    break;
                }
                name = format!("{base}_{}", named::letters(i));
            }
            let f = values.function(context);
            let inner = f.ty(values.graph.module(), expression).clone();
            Some(Wanted {
                context,
                expression,
                inner,
                name,
            })
        })
        .collect()
}

/// Hash of the slice that computes values.
pub(crate) fn hash(values: &Values<'_, '_>, ids: impl IntoIterator<Item = ValueId>) -> String {
    let criterion = |id| {
        let (context, expression, _) = values.expression(id)?;
        Some(Criterion::Value {
            function: values.contexts[context].function,
            expression,
        })
    };
    let criteria: Vec<Criterion> = ids.into_iter().filter_map(criterion).collect();
    slice::backward(values.graph, values.entry, &criteria).hash(values.graph)
}

/// The function in its module.
#[derive(Clone, Debug)]
pub(crate) struct Hoisted {
    /// The module; the author's functions and entry points are unchanged.
    pub module: Module,
    pub function: Handle<Function>,
    /// Varying locations for each argument, or for each member of a struct argument.
    pub arguments: Vec<Vec<u32>>,
}

/// Why the stages could not be rebuilt.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Failed {
    /// The slice depends on an input that the values do not depend on: a decision of the fragment
    /// stage.
    #[error(
        "the code that computes the values cannot be separated from code that only a fragment can run"
    )]
    NotSeparable,
    /// The vertex stage has no such output.
    #[error("the vertex stage has no output at location {0}")]
    NoOutput(u32),
    /// The result is invalid: a bug.
    #[error("{0}")]
    Built(String),
}

impl Failed {
    /// The refusal of the pass `name`.
    pub fn refusal(self, name: &str) -> Refusal {
        match self {
            Self::NotSeparable => Refusal::new(
                name,
                &refusals::NOT_SEPARABLE,
                self.to_string(),
                "compute it before the branch or return that precedes it",
            ),
            Self::NoOutput(_) | Self::Built(_) => Refusal::bug(name, self),
        }
    }
}

impl From<Box<shader_text::source::Invalid>> for Failed {
    fn from(invalid: Box<shader_text::source::Invalid>) -> Self {
        Self::Built(invalid.to_string())
    }
}

const ENTRY: &str = "preshade_hoisted";

/// Adds the function to the module.
///
/// # Errors
/// [`Failed`].
pub(crate) fn add(
    program: &Program,
    values: &Values<'_, '_>,
    wanted: &[Wanted],
) -> Result<Hoisted, Failed> {
    let extracted = extract(program, values, wanted, &HOISTED)?;
    let arguments = extracted
        .arguments
        .iter()
        .map(|bindings| bindings.iter().map(location_of).collect())
        .collect::<Option<_>>()
        .ok_or(Failed::NotSeparable)?;
    Ok(Hoisted {
        module: extracted.module,
        function: extracted.function,
        arguments,
    })
}

/// Values of a fragment stage as a function of its inputs.
#[derive(Clone, Debug)]
pub struct Extracted {
    /// The module; the author's functions and entry points are unchanged.
    pub module: Module,
    pub function: Handle<Function>,
    /// The fragment input for each argument, or for each member of a struct argument.
    pub arguments: Vec<Vec<Binding>>,
}

/// Names of a function of values, and of its result struct.
#[derive(Clone, Copy, Debug)]
pub struct Names {
    /// The function's name, and the suffix of its parts.
    pub function: &'static str,
    pub values: &'static str,
}

const HOISTED: Names = Names {
    function: "hoisted",
    values: "Hoisted",
};

/// Adds a function of the fragment stage's inputs that returns `wanted`: the value, or a struct of
/// several in order.
///
/// # Errors
/// [`Failed::Built`].
pub fn extract(
    program: &Program,
    values: &Values<'_, '_>,
    wanted: &[Wanted],
    names: &Names,
) -> Result<Extracted, Failed> {
    let mut module = program.module().clone();
    let entry = module.entry_points.len();
    let mut copy = module.entry_points[values.entry].clone();
    copy.name = ENTRY.to_owned();
    module.entry_points.push(copy);
    let contexts: BTreeSet<ContextId> = wanted.iter().map(|w| w.context).collect();
    let (mut module, copies) = isolate(&module, entry, values, &contexts);
    let result = result_type(&mut module, wanted, names.values);
    // Code after the last value decides nothing and may return early. It stays, unreachable,
    // because some of its expressions must not stand alone.
    let end = prefix(values, wanted);
    let mut leave = Block::new();
    leave.push(Statement::Return { value: None }, Span::UNDEFINED);
    let body = &mut module.entry_points[entry].function.body;
    without_returns(body);
    body.splice(end..end, leave);
    if is_direct(values, wanted) {
        let function = &mut module.entry_points[entry].function;
        returns::rewrite(function, &mut |writer, _| match wanted {
            [one] => Some(one.expression),
            several => Some(writer.expression(Expression::Compose {
                ty: result,
                components: several.iter().map(|w| w.expression).collect(),
            })),
        });
    } else {
        capture(&mut module, entry, &copies, wanted, result);
    }
    let binding = matches!(wanted, [_]).then(|| location(0));
    module.entry_points[entry].function.result = Some(FunctionResult {
        ty: result,
        binding,
    });
    // Only the copy is analysed.
    let others = module.entry_points.drain(..entry).collect();
    let built = program.with_module(module)?;
    let graph = Graph::build(&built);
    let all = [Criterion::Output(OutputFilter::All)];
    let slice = slice::backward(&graph, 0, &all);
    let mut module = place::entry_point(
        &graph,
        &slice,
        built.module(),
        names.function,
        names.function,
        PositionInvariance::AsWritten,
    );
    let Some(placed) = module.entry_points.pop() else {
        return Err(Failed::Built("nothing was placed".to_owned()));
    };
    // The functions that only the copy called go with the next compaction.
    module.entry_points = others;
    let arguments = placed
        .function
        .arguments
        .iter()
        .map(|a| bindings(&module, a))
        .collect::<Option<_>>()
        .ok_or_else(|| Failed::Built("an input has no binding".to_owned()))?;
    unbind(&mut module, result, wanted);
    let function = as_function(&module, placed.function, names.function);
    let function = module.functions.append(function, Span::UNDEFINED);
    Ok(Extracted {
        module,
        function,
        arguments,
    })
}

/// The bindings of an argument, or of the members of a struct argument.
fn bindings(module: &Module, argument: &FunctionArgument) -> Option<Vec<Binding>> {
    match &module.types[argument.ty].inner {
        TypeInner::Struct { members, .. } if argument.binding.is_none() => {
            members.iter().map(|m| m.binding.clone()).collect()
        }
        _ => Some(vec![argument.binding.clone()?]),
    }
}

/// Location of a varying; `None` for a builtin.
fn location_of(binding: &Binding) -> Option<u32> {
    match binding {
        Binding::Location { location, .. } => Some(*location),
        Binding::BuiltIn(_) => None,
    }
}

/// An entry point's function made callable: without bindings, with its own name.
pub fn as_function(module: &Module, mut function: Function, name: &str) -> Function {
    let taken = |name: &str| {
        module
            .functions
            .iter()
            .any(|(_, f)| f.name.as_deref() == Some(name))
            || module.entry_points.iter().any(|e| e.name == name)
            || module
                .global_variables
                .iter()
                .any(|(_, g)| g.name.as_deref() == Some(name))
    };
    function.name = Some(if taken(name) {
        place::free_name(module, name, "of")
    } else {
        name.to_owned()
    });
    for argument in &mut function.arguments {
        argument.binding = None;
    }
    if let Some(result) = &mut function.result {
        result.binding = None;
    }
    function
}

/// The result type: a value, or a struct of several. Its members have locations while it belongs to
/// an entry point.
fn result_type(module: &mut Module, wanted: &[Wanted], name: &str) -> Handle<Type> {
    let types: Vec<Handle<Type>> = wanted
        .iter()
        .map(|w| {
            let inner = w.inner.clone();
            let ty = Type { name: None, inner };
            module.types.insert(ty, Span::UNDEFINED)
        })
        .collect();
    if let [one] = types[..] {
        return one;
    }
    let members = wanted
        .iter()
        .zip(types)
        .enumerate()
        .map(|(i, (w, ty))| StructMember {
            name: Some(w.name.clone()),
            ty,
            binding: Some(location(i as u32)),
            offset: 0,
        })
        .collect();
    let taken = |name: &str| {
        module
            .types
            .iter()
            .any(|(_, t)| t.name.as_deref() == Some(name))
    };
    // Every level adds one, and those of two levels may be alike but for the name.
    let mut name = name.to_owned();
    while taken(&name) {
        name += "Values";
    }
    place::io_struct(module, Some(name), members)
}

/// Removes the locations from the result's members.
fn unbind(module: &mut Module, result: Handle<Type>, wanted: &[Wanted]) {
    let [_, _, ..] = wanted else { return };
    let Type { name, inner } = module.types[result].clone();
    if let TypeInner::Struct { mut members, span } = inner {
        for member in &mut members {
            member.binding = None;
        }
        let inner = TypeInner::Struct { members, span };
        module.types.replace(result, Type { name, inner });
    }
}

/// Removes returns, except those that end a loop. If the author returns before a value is computed,
/// the value is unused and may be anything. If the value was computed before, later code does not
/// compute it again.
fn without_returns(block: &mut Block) {
    for (mut statement, span) in std::mem::take(block).span_into_iter() {
        match &mut statement {
            Statement::Return { .. } => continue,
            Statement::Loop { .. } => {}
            other => naga_operands::blocks_mut(other)
                .into_iter()
                .for_each(without_returns),
        }
        block.push(statement, span);
    }
}

/// Number of outermost statements up to the one that computes the last value.
fn prefix(values: &Values<'_, '_>, wanted: &[Wanted]) -> usize {
    let f = values.function(0);
    let last = wanted
        .iter()
        .filter_map(|w| {
            let (mut context, mut at) = (
                w.context,
                values
                    .function(w.context)
                    .statements
                    .evaluated_at(w.expression)?,
            );
            while let Some((caller, call)) = values.contexts[context].call {
                (context, at) = (caller, call);
            }
            Some(f.statements.ancestors(at).last().unwrap_or(at))
        })
        .max();
    let outermost = f
        .statements
        .iter()
        .filter(|(id, n)| n.parent.is_none() && last.is_some_and(|last| *id <= last));
    outermost.count()
}

/// Whether all values are available at the end of the entry point, and there is no other exit.
fn is_direct(values: &Values<'_, '_>, wanted: &[Wanted]) -> bool {
    let f = values.function(0);
    let mut last = 0;
    let at_hand = wanted.iter().all(|w| {
        // Expression handles of other functions are meaningless here.
        let own = (w.context == 0).then_some(w.expression);
        let at = own.and_then(|e| f.statements.evaluated_at(e));
        last = last.max(at.map_or(0, |at| at.index()));
        at.is_some_and(|at| f.statements.get(at).parent.is_none())
    });
    at_hand
        && !f
            .statements
            .iter()
            .take(last)
            .any(|(_, n)| matches!(n.statement, Statement::Return { .. }))
}

/// Makes the entry point and the copied functions write the values into one variable, which the
/// entry point returns.
fn capture(
    module: &mut Module,
    entry: usize,
    copies: &BTreeMap<ContextId, FunctionId>,
    wanted: &[Wanted],
    result: Handle<Type>,
) {
    let pointer_type = module.types.insert(
        Type {
            name: None,
            inner: TypeInner::Pointer {
                base: result,
                space: AddressSpace::Function,
            },
        },
        Span::UNDEFINED,
    );
    let passed_on: BTreeSet<Handle<Function>> = copies
        .values()
        .filter_map(|id| match id {
            FunctionId::Function(h) => Some(*h),
            FunctionId::EntryPoint(_) => None,
        })
        .collect();
    for (context, id) in copies {
        let function = match id {
            FunctionId::Function(h) => &mut module.functions[*h],
            FunctionId::EntryPoint(_) => &mut module.entry_points[entry].function,
        };
        let pointer = match id {
            FunctionId::Function(_) => {
                function.arguments.push(FunctionArgument {
                    name: Some("values".to_owned()),
                    ty: pointer_type,
                    binding: None,
                });
                Expression::FunctionArgument(function.arguments.len() as u32 - 1)
            }
            FunctionId::EntryPoint(_) => {
                let variable = LocalVariable {
                    name: Some("values".to_owned()),
                    ty: result,
                    init: None,
                };
                let variable = function.local_variables.append(variable, Span::UNDEFINED);
                Expression::LocalVariable(variable)
            }
        };
        let pointer = function.expressions.append(pointer, Span::UNDEFINED);
        let captures: BTreeMap<Handle<Expression>, u32> = wanted
            .iter()
            .enumerate()
            .filter(|(_, w)| w.context == *context)
            .map(|(i, w)| (w.expression, i as u32))
            .collect();
        let is_struct = wanted.len() > 1;
        naga_operands::visit_mut(&mut function.body, &mut |statement| {
            if let Statement::Call {
                function,
                arguments,
                ..
            } = statement
                && passed_on.contains(function)
            {
                arguments.push(pointer);
            }
        });
        after(function, &mut |writer, value| {
            let Some(index) = captures.get(&value).copied() else {
                return;
            };
            let base = pointer;
            let pointer = match is_struct {
                true => writer.expression(Expression::AccessIndex { base, index }),
                false => base,
            };
            writer.statement(Statement::Store { pointer, value }, Span::UNDEFINED);
        });
        if matches!(id, FunctionId::EntryPoint(_)) {
            returns::rewrite(function, &mut |writer, _| {
                Some(writer.expression(Expression::Load { pointer }))
            });
        }
    }
}
