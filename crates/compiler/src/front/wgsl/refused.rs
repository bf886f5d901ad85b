//! Modules that naga's validator accepts and WGSL forbids. Every browser refuses the text of such a
//! module, and of each slice of it.

use naga::valid::FunctionInfo;
use naga::{
    Binding, Block, Expression, Function, Handle, ImageClass, Literal, MathFunction, Module,
    SampleLevel, ScalarKind, Span, Statement, TypeInner,
};
use preshade_plan::program::Program;

use super::aliases;
use shader_text::error::{Code, Error};

/// The largest location, group or binding.
const MOST: u32 = i32::MAX as u32;

/// Finds the first thing that WGSL does not have.
pub(in super::super) fn check(program: &Program) -> Result<(), Error> {
    let (module, info) = (program.module(), program.info());
    for (handle, variable) in module.global_variables.iter() {
        let numbers = variable.binding.map_or([0, 0], |b| [b.group, b.binding]);
        if let Some(number) = numbers.into_iter().find(|n| *n > MOST) {
            let message = format!("{number} is no group or binding: it is no i32");
            return Err(error(message, module.global_variables.get_span(handle)));
        }
    }
    for (handle, ty) in module.types.iter() {
        if let TypeInner::Struct { members, .. } = &ty.inner {
            let bindings = members.iter().map(|m| m.binding.as_ref());
            locations(bindings, module.types.get_span(handle))?;
        }
    }
    aliases::check(module).map_err(|span| {
        error(
            "the call writes a variable that it also gets under another name",
            span,
        )
    })?;
    for (handle, function) in module.functions.iter() {
        check_function(module, function, &info[handle])?;
    }
    for (n, entry) in module.entry_points.iter().enumerate() {
        let arguments = entry.function.arguments.iter().map(|a| a.binding.as_ref());
        let result = entry.function.result.as_ref().map(|r| r.binding.as_ref());
        locations(arguments.chain(result), Span::UNDEFINED)?;
        check_function(module, &entry.function, info.get_entry_point(n))?;
    }
    Ok(())
}

fn error(message: impl Into<String>, span: Span) -> Error {
    let error = Error::new(Code::Invalid, message);
    match span.is_defined() {
        true => error.label(span, ""),
        false => error,
    }
    .note("no browser takes it")
}

fn locations<'b>(
    bindings: impl Iterator<Item = Option<&'b Binding>>,
    span: Span,
) -> Result<(), Error> {
    for binding in bindings.flatten() {
        if let Binding::Location { location, .. } = binding
            && *location > MOST
        {
            return Err(error(
                format!("{location} is no location: it is no i32"),
                span,
            ));
        }
    }
    Ok(())
}

fn check_function(module: &Module, function: &Function, info: &FunctionInfo) -> Result<(), Error> {
    for (handle, expression) in function.expressions.iter() {
        if let Some(message) = misuse(module, function, info, expression) {
            return Err(error(message, function.expressions.get_span(handle)));
        }
    }
    match endless(&function.body) {
        Some(span) => Err(error("the loop does not exit", span)),
        None => Ok(()),
    }
}

/// The mistake in an expression whose types naga accepts.
fn misuse(
    module: &Module,
    function: &Function,
    info: &FunctionInfo,
    expression: &Expression,
) -> Option<String> {
    let kind = |e: Handle<Expression>| info[e].ty.inner_with(&module.types).scalar_kind();
    let numbers = |e: Handle<Expression>| numbers(module, function, e);
    let pairs = |a, b, holds: fn(f64, f64) -> bool| {
        let (a, b) = (numbers(a)?, numbers(b)?);
        let components = a.len().max(b.len());
        let at = |v: &Vec<f64>, n: usize| v.get(n).or(v.first()).copied();
        let mut all = (0..components).filter_map(|n| Some((at(&a, n)?, at(&b, n)?)));
        all.find(|(a, b)| holds(*a, *b))
    };
    match *expression {
        Expression::Math {
            fun,
            arg,
            arg1,
            arg2,
            arg3,
        } => match fun {
            MathFunction::Sign if kind(arg) == Some(ScalarKind::Uint) => {
                Some("`sign` takes no unsigned numbers".to_owned())
            }
            MathFunction::Clamp => pairs(arg1?, arg2?, |low, high| low > high)
                .map(|(low, high)| format!("`clamp` from {low} to {high}: the first is larger")),
            MathFunction::SmoothStep => pairs(arg, arg1?, |low, high| low == high)
                .map(|(low, _)| format!("both edges of `smoothstep` are {low}")),
            MathFunction::Ldexp => numbers(arg1?)?
                .into_iter()
                .find(|n| *n > 128.0)
                .map(|n| format!("the exponent of `ldexp` is {n}, and 128 is the largest")),
            MathFunction::ExtractBits | MathFunction::InsertBits => {
                let (offset, count) = match fun {
                    MathFunction::ExtractBits => (arg1?, arg2?),
                    _ => (arg2?, arg3?),
                };
                pairs(offset, count, |offset, count| offset + count > 32.0)
                    .map(|(offset, count)| format!("{count} bits from bit {offset} are beyond 32"))
            }
            _ => None,
        },
        Expression::ImageSample {
            image,
            level,
            offset,
            ..
        } => {
            let inner = info[image].ty.inner_with(&module.types);
            let depth = matches!(
                inner,
                TypeInner::Image {
                    class: ImageClass::Depth { .. },
                    ..
                }
            );
            if depth && matches!(level, SampleLevel::Gradient { .. }) {
                return Some("`textureSampleGrad` takes no depth texture".to_owned());
            }
            numbers(offset?)?
                .into_iter()
                .find(|n| !(-8.0..8.0).contains(n))
                .map(|n| format!("the offset is {n}: it is -8 to 7"))
        }
        _ => None,
    }
}

/// The numbers of a constant, by component.
fn numbers(module: &Module, function: &Function, e: Handle<Expression>) -> Option<Vec<f64>> {
    fn of(
        module: &Module,
        expression: &Expression,
        inner: &dyn Fn(Handle<Expression>) -> Option<Vec<f64>>,
    ) -> Option<Vec<f64>> {
        match expression {
            Expression::Literal(literal) => Some(vec![match *literal {
                Literal::F32(v) => f64::from(v),
                Literal::F16(v) => f64::from(v),
                Literal::F64(v) => v,
                Literal::I32(v) => f64::from(v),
                Literal::U32(v) => f64::from(v),
                _ => return None,
            }]),
            Expression::Splat { value, .. } => inner(*value),
            Expression::Compose { components, .. } => {
                let all = components.iter().map(|c| inner(*c));
                Some(all.collect::<Option<Vec<_>>>()?.concat())
            }
            Expression::ZeroValue(ty) => match module.types[*ty].inner {
                TypeInner::Scalar(_) | TypeInner::Vector { .. } => Some(vec![0.0]),
                _ => None,
            },
            Expression::Constant(c) => global(module, module.constants[*c].init),
            _ => None,
        }
    }
    fn global(module: &Module, e: Handle<Expression>) -> Option<Vec<f64>> {
        of(module, &module.global_expressions[e], &|e| {
            global(module, e)
        })
    }
    of(module, &function.expressions[e], &|e| {
        numbers(module, function, e)
    })
}

/// A loop that nothing leaves.
fn endless(block: &Block) -> Option<Span> {
    for (statement, span) in block.span_iter() {
        if let Statement::Loop {
            body,
            continuing,
            break_if,
        } = statement
            && break_if.is_none()
            && !leaves(body, false)
            && !leaves(continuing, false)
        {
            return Some(*span);
        }
        if let Some(span) = naga_operands::blocks(statement)
            .into_iter()
            .find_map(endless)
        {
            return Some(span);
        }
    }
    None
}

/// Whether a statement leaves the loop around the block. A `break` inside of `is_inner` leaves
/// another statement.
fn leaves(block: &Block, is_inner: bool) -> bool {
    block.iter().any(|statement| match statement {
        Statement::Return { .. } => true,
        Statement::Break => !is_inner,
        Statement::Switch { .. } | Statement::Loop { .. } => naga_operands::blocks(statement)
            .into_iter()
            .any(|b| leaves(b, true)),
        other => naga_operands::blocks(other)
            .into_iter()
            .any(|b| leaves(b, is_inner)),
    })
}
