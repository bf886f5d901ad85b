//! Atomic functions, and the atomic types of their targets.

use naga::front::Typifier;
use naga::proc::ResolveContext;
use naga::{
    AddressSpace, Arena, AtomicFunction, Expression, GlobalVariable, Handle, ImageClass, Module,
    Span, Statement, StorageAccess, Type, TypeInner, UniqueArena,
};

use super::expression::Position;
use super::{Body, Builder, Value};
use crate::errors::unsupported;
use crate::tree::Node;
use shader_text::error::Error;

/// A part of a variable: the indices from the whole to it. All elements of an array count as one.
pub(super) type PartOfVariable = (Handle<GlobalVariable>, Vec<u32>);

impl<'s> Body<'_, 's> {
    pub(super) fn atomic(
        &mut self,
        of: AtomicFunction,
        target: &'s Node,
        value: &'s Node,
    ) -> Result<Value, Error> {
        let place = self.span.is_defined().then_some(self.span);
        let refusal = || {
            let message = "an atomic function takes a member of a storage block";
            unsupported(message, place).note("name the member itself, not a copy of it")
        };
        let at = Position::Base { constant: true };
        let pointer = self.evaluate(target, at).ok().flatten();
        let pointer = pointer.ok_or_else(refusal)?;
        let value = self.value(value)?;
        let ty = match *self.ty(pointer)? {
            TypeInner::Pointer { base, .. } => base,
            TypeInner::ValuePointer { scalar, .. } => {
                self.builder.insert(TypeInner::Scalar(scalar))
            }
            _ => return Err(refusal()),
        };
        let part = part_of(&self.writer.function.expressions, pointer);
        let globals = &self.builder.module.global_variables;
        let is_storage = |(global, _): &PartOfVariable| {
            matches!(globals[*global].space, AddressSpace::Storage { .. })
        };
        let part = part.filter(is_storage).ok_or_else(refusal)?;
        self.builder.atomics.push(part);
        let comparison = false;
        let result = self.unevaluated(Expression::AtomicResult { ty, comparison });
        self.push(Statement::Atomic {
            pointer,
            fun: of,
            value,
            result: Some(result),
        });
        Ok(result)
    }

    pub(super) fn image_atomic(
        &mut self,
        of: AtomicFunction,
        [image, at, value]: [&'s Node; 3],
    ) -> Result<(), Error> {
        let [image, coordinate, array_index] = self.texel(image, at)?;
        let value = self.value(value)?;
        let (Some(image), Some(coordinate)) = (image, coordinate) else {
            return Err(self.refused("this is not a texture"));
        };
        if let Expression::GlobalVariable(global) = *self.expression(image) {
            self.builder.atomic_images.push(global);
        }
        let atomic = Statement::ImageAtomic {
            image,
            coordinate,
            array_index,
            fun: of,
            value,
        };
        self.push(atomic);
        Ok(())
    }
}

impl Builder<'_> {
    /// Gives the targets of atomic functions an atomic type.
    pub(super) fn atomics(&mut self) -> Result<(), Error> {
        let module = &mut self.module;
        for global in std::mem::take(&mut self.atomic_images) {
            let mut ty = module.types[module.global_variables[global].ty].clone();
            if let TypeInner::Image {
                class: ImageClass::Storage { access, .. },
                ..
            } = &mut ty.inner
            {
                // WGSL's `atomic` allows loads and stores.
                *access = StorageAccess::all();
            }
            module.global_variables[global].ty = module.types.insert(ty, Span::UNDEFINED);
        }
        if self.atomics.is_empty() {
            return Ok(());
        }
        for (global, path) in std::mem::take(&mut self.atomics) {
            let ty = module.global_variables[global].ty;
            let ty = with_atomic(&mut module.types, ty, &path);
            module.global_variables[global].ty = ty;
        }
        match reads_whole(module) {
            None => Ok(()),
            // A struct with an atomic member is not a value.
            Some(span) => Err(unsupported(
                "a struct whose member an atomic function changes is read or written as a whole",
                span.is_defined().then_some(span),
            )
            .note("read and write its members one by one")),
        }
    }
}

/// Where a function reads something with an atomic member as a whole.
fn reads_whole(module: &Module) -> Option<Span> {
    let functions = module.functions.iter().map(|(_, f)| f);
    let mut functions = functions.chain(module.entry_points.iter().map(|e| &e.function));
    functions.find_map(|function| {
        let context =
            ResolveContext::with_locals(module, &function.local_variables, &function.arguments);
        let mut types = Typifier::new();
        function.expressions.iter().find_map(|(handle, e)| {
            let Expression::Load { pointer } = *e else {
                return None;
            };
            types.grow(pointer, &function.expressions, &context).ok()?;
            match *types.get(pointer, &module.types) {
                TypeInner::Pointer { base, .. } if has_atomic(&module.types, base, false) => {
                    Some(function.expressions.get_span(handle))
                }
                _ => None,
            }
        })
    })
}

/// Whether a type has an atomic member, or (`or_is`) is atomic itself.
fn has_atomic(types: &UniqueArena<Type>, ty: Handle<Type>, or_is: bool) -> bool {
    match &types[ty].inner {
        TypeInner::Atomic(_) => or_is,
        TypeInner::Array { base, .. } => has_atomic(types, *base, true),
        TypeInner::Struct { members, .. } => members.iter().any(|m| has_atomic(types, m.ty, true)),
        _ => false,
    }
}

fn part_of(expressions: &Arena<Expression>, pointer: Value) -> Option<PartOfVariable> {
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
