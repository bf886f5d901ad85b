//! Decodes a buffer's bytes by the shader's type.

use naga::{AddressSpace, ArraySize, GlobalVariable, Handle, Module, ScalarKind, Type, TypeInner};

use super::number::Number;
use super::value::{Scalar, Value};

/// Decodes a value of type `ty` from the start of `bytes` (WGSL section 14.4, memory layout).
/// `None` if there are too few bytes, or the type has a runtime size or scalars of other widths
/// than 32 bits.
pub fn from_bytes<F: Number>(module: &Module, ty: Handle<Type>, bytes: &[u8]) -> Option<Value<F>> {
    Some(match &module.types[ty].inner {
        TypeInner::Scalar(s) => scalar(*s, bytes)?,
        TypeInner::Vector { size, scalar } => vector(*size as usize, *scalar, bytes)?,
        TypeInner::Matrix {
            columns,
            rows,
            scalar,
        } => {
            // A column of three is padded to four.
            let stride = 4 * if *rows as usize == 2 { 2 } else { 4 };
            let column = |c: usize| vector(*rows as usize, *scalar, bytes.get(c * stride..)?);
            Value::Composite((0..*columns as usize).map(column).collect::<Option<_>>()?)
        }
        TypeInner::Array {
            base,
            size: ArraySize::Constant(count),
            stride,
        } => {
            let element = |i: u32| from_bytes(module, *base, bytes.get((i * stride) as usize..)?);
            Value::Composite((0..count.get()).map(element).collect::<Option<_>>()?)
        }
        TypeInner::Struct { members, .. } => Value::Composite(
            members
                .iter()
                .map(|m| from_bytes(module, m.ty, bytes.get(m.offset as usize..)?))
                .collect::<Option<_>>()?,
        ),
        _ => return None,
    })
}

fn vector<F: Number>(size: usize, of: naga::Scalar, bytes: &[u8]) -> Option<Value<F>> {
    let component = |i: usize| scalar(of, bytes.get(4 * i..)?);
    Some(Value::Composite(
        (0..size).map(component).collect::<Option<_>>()?,
    ))
}

fn scalar<F: Number>(of: naga::Scalar, bytes: &[u8]) -> Option<Value<F>> {
    let word: [u8; 4] = *bytes.first_chunk()?;
    Some(Value::Scalar(match (of.kind, of.width) {
        (ScalarKind::Float, 4) => Scalar::F32(F::of(f32::from_le_bytes(word))),
        (ScalarKind::Sint, 4) => Scalar::I32(i32::from_le_bytes(word)),
        (ScalarKind::Uint, 4) => Scalar::U32(u32::from_le_bytes(word)),
        _ => return None,
    }))
}

/// The key of a variable's contents in [`Environment::resources`](super::Environment::resources):
/// its group and binding. Immediate data has no binding. It gets a group of its own and a number
/// from the variable's name, because each stage may have one.
pub fn place(global: &GlobalVariable) -> Option<(u32, u32)> {
    match (&global.binding, global.space) {
        (Some(at), _) => Some((at.group, at.binding)),
        (None, AddressSpace::Immediate) => {
            let name = global.name.as_deref().unwrap_or_default();
            let hash = |h: u32, b| (h ^ u32::from(b)).wrapping_mul(0x0100_0193);
            Some((u32::MAX, name.bytes().fold(0x811c_9dc5, hash)))
        }
        (None, _) => None,
    }
}

/// Assumed number of elements in a runtime-sized array of unknown length.
pub const RUNTIME_ELEMENTS: u32 = 16;

/// Number of scalars in a type. `u32::MAX` if unknown or larger.
pub fn scalars(module: &Module, ty: Handle<Type>) -> u32 {
    match &module.types[ty].inner {
        TypeInner::Scalar(_) | TypeInner::Atomic(_) => 1,
        TypeInner::Vector { size, .. } => *size as u32,
        TypeInner::Matrix { columns, rows, .. } => *columns as u32 * *rows as u32,
        TypeInner::Array { base, size, .. } => {
            let count = match size {
                ArraySize::Constant(n) => n.get(),
                _ => RUNTIME_ELEMENTS,
            };
            scalars(module, *base).saturating_mul(count)
        }
        TypeInner::Struct { members, .. } => members
            .iter()
            .fold(0, |sum: u32, m| sum.saturating_add(scalars(module, m.ty))),
        _ => u32::MAX,
    }
}
