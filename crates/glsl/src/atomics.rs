//! Makes atomic functions of the placeholders that stand for them, and atomic types of the members
//! that they change: naga's GLSL front end has neither.

use naga::{
    AddressSpace, AtomicFunction, Expression, FastHashMap, Function, GlobalVariable, Handle,
    ImageClass, Module, Span, Statement, StorageAccess, Type, TypeInner, UniqueArena,
};
use preshade_ir::writer::FunctionWriter;

use super::placeholders::{Atomic, Placeholder, Placeholders};
use super::stage::unsupported;
use preshade_ir::wrapped_main;
use preshade_text::error::Error;

/// A part of a variable: the indices from the whole to it. Elements of an array count alike.
type Part = (Handle<GlobalVariable>, Vec<u32>);

/// Replaces the calls of placeholders. `place` maps error spans to the source.
pub(super) fn replace(
    module: &mut Module,
    placeholders: &Placeholders,
    place: &dyn Fn(Span) -> Span,
) -> Result<(), Error> {
    images(module, placeholders);
    let mut found: Vec<(Handle<Function>, Atomic, Handle<Type>)> = Vec::new();
    for (handle, function) in module.functions.iter() {
        let of = function.name.as_ref().and_then(|n| placeholders.get(n));
        if let (Some(Placeholder::Atomic(atomic)), Some(result)) = (of, &function.result) {
            found.push((handle, *atomic, result.ty));
        }
    }
    if found.is_empty() {
        return Ok(());
    }
    let was_valid = wrapped_main::is_valid(module);
    let mut parts = Vec::new();
    let Module {
        functions,
        entry_points,
        global_variables,
        ..
    } = module;
    let functions = functions.iter_mut().map(|(_, f)| f);
    for function in functions.chain(entry_points.iter_mut().map(|e| &mut e.function)) {
        let mut refused = None;
        let expressions = &mut function.expressions;
        naga_operands::visit_mut(&mut function.body, &mut |statement| {
            let Statement::Call {
                function: called,
                arguments,
                result: Some(result),
            } = statement
            else {
                return;
            };
            let Some((_, atomic, ty)) = found.iter().find(|(h, ..)| h == called) else {
                return;
            };
            let span = expressions.get_span(*result);
            let pointer = match expressions[arguments[0]] {
                Expression::Load { pointer } => pointer,
                _ => return refused = Some(span),
            };
            let part = part_of(expressions, pointer);
            let is_storage =
                |(g, _): &Part| matches!(global_variables[*g].space, AddressSpace::Storage { .. });
            let Some(part) = part.filter(is_storage) else {
                return refused = Some(span);
            };
            parts.push(part);
            expressions[*result] = Expression::AtomicResult {
                ty: *ty,
                comparison: false,
            };
            *statement = Statement::Atomic {
                pointer,
                fun: function_of(*atomic),
                value: arguments[1],
                result: Some(*result),
            };
        });
        if let Some(span) = refused {
            return Err(refuse(place(span)));
        }
    }
    for (global, path) in parts {
        let ty = module.global_variables[global].ty;
        let ty = with_atomic(&mut module.types, ty, &path);
        module.global_variables[global].ty = ty;
    }
    match !was_valid || wrapped_main::is_valid(module) {
        true => Ok(()),
        // A struct with an atomic member is no value.
        false => Err(unsupported(
            "a struct whose member an atomic function changes is read or written as a whole",
            None,
        )
        .note("read and write its members one by one")),
    }
}

/// Replaces the stores of what placeholders of image atomics return.
///
/// ```text
/// %2 = Call imageAtomicAdd_uint(%1)
/// ImageStore { image: %0, value: %2 }            ImageAtomic { image: %0, value: %1 }
/// ```
fn images(module: &mut Module, placeholders: &Placeholders) {
    let of = |f: &Function| match placeholders.get(f.name.as_ref()?) {
        Some(Placeholder::ImageAtomic(atomic)) => Some((*atomic, f.result.as_ref()?.ty)),
        _ => None,
    };
    let found = module.functions.iter();
    let found: FastHashMap<_, _> = found.filter_map(|(h, f)| Some((h, of(f)?))).collect();
    if found.is_empty() {
        return;
    }
    let mut changed = Vec::new();
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    for function in functions.chain(entries) {
        let mut values = FastHashMap::default();
        FunctionWriter::rewrite(function, &mut |writer, statement, span| match statement {
            Statement::Call {
                function,
                ref arguments,
                result: Some(result),
            } if found.contains_key(&function) => {
                let (atomic, ty) = found[&function];
                // A result needs its call.
                writer.function.expressions[result] = Expression::ZeroValue(ty);
                values.insert(result, (atomic, arguments[0]));
            }
            Statement::ImageStore {
                image,
                coordinate,
                array_index,
                value,
            } if values.contains_key(&value) => {
                // Lowering sees to it that it is one.
                if let Expression::GlobalVariable(global) = writer.function.expressions[image] {
                    changed.push(global);
                }
                let (atomic, value) = values[&value];
                let atomic = Statement::ImageAtomic {
                    image,
                    coordinate,
                    array_index,
                    fun: function_of(atomic),
                    value,
                };
                writer.statement(atomic, span);
            }
            other => writer.statement(other, span),
        });
    }
    for global in changed {
        let mut ty = module.types[module.global_variables[global].ty].clone();
        if let TypeInner::Image {
            class: ImageClass::Storage { access, .. },
            ..
        } = &mut ty.inner
        {
            // WGSL's `atomic`.
            *access = StorageAccess::all();
        }
        module.global_variables[global].ty = module.types.insert(ty, Span::UNDEFINED);
    }
}

fn refuse(place: Span) -> Error {
    unsupported(
        "an atomic function takes a member of a storage block",
        Some(place),
    )
    .note("name the member itself, not a copy of it")
}

fn function_of(atomic: Atomic) -> AtomicFunction {
    match atomic {
        Atomic::Add => AtomicFunction::Add,
        Atomic::And => AtomicFunction::And,
        Atomic::Or => AtomicFunction::InclusiveOr,
        Atomic::Xor => AtomicFunction::ExclusiveOr,
        Atomic::Min => AtomicFunction::Min,
        Atomic::Max => AtomicFunction::Max,
        Atomic::Exchange => AtomicFunction::Exchange { compare: None },
    }
}

fn part_of(expressions: &naga::Arena<Expression>, pointer: Handle<Expression>) -> Option<Part> {
    let (base, index) = match expressions[pointer] {
        Expression::GlobalVariable(global) => return Some((global, Vec::new())),
        Expression::AccessIndex { base, index } => (base, index),
        Expression::Access { base, .. } => (base, 0),
        _ => return None,
    };
    let (global, mut path) = part_of(expressions, base)?;
    path.push(index);
    Some((global, path))
}

/// The type with an atomic scalar at the end of the path.
fn with_atomic(types: &mut UniqueArena<Type>, ty: Handle<Type>, path: &[u32]) -> Handle<Type> {
    let mut of = types[ty].clone();
    match (&mut of.inner, path) {
        (TypeInner::Scalar(scalar), _) => of.inner = TypeInner::Atomic(*scalar),
        (TypeInner::Array { base, .. } | TypeInner::BindingArray { base, .. }, [_, rest @ ..]) => {
            *base = with_atomic(types, *base, rest)
        }
        (TypeInner::Struct { members, .. }, [first, rest @ ..]) => {
            if let Some(member) = members.get_mut(*first as usize) {
                member.ty = with_atomic(types, member.ty, rest);
            }
        }
        _ => return ty,
    }
    types.insert(of, Span::UNDEFINED)
}
