//! Gives blocks the author's members. naga writes a block as the only member of a struct of its
//! own, and the front end fills gaps between members with floats.

use std::collections::{BTreeMap, HashMap};

use naga::valid::FunctionInfo;
use naga::{Expression, Function, Handle, Module, Type, TypeInner};
use naga_edit::declared;
use preshade_plan::program::Program;
use rspirv::dr::{Builder, Instruction, Operand};
use rspirv::spirv::{Decoration, Op, StorageClass};

use naga_spirv::words::{ids, pointee, replace_ids, rewrite};

/// The new index of each member of a struct; `None` for padding.
type Moved = BTreeMap<Handle<Type>, Vec<Option<u32>>>;

/// The program without the floats that the front end added to blocks. `None` if it has none. The
/// other members keep their offsets.
pub(super) fn without_padding(program: &Program) -> Option<Program> {
    let mut module = program.module().clone();
    let mut moved = Moved::new();
    for (_, global) in program.module().global_variables.iter() {
        let mut ty = module.types[global.ty].clone();
        let (TypeInner::Struct { members, .. }, Some(name)) = (&mut ty.inner, &ty.name) else {
            continue;
        };
        let is_padding = |own: &Option<String>| {
            let own = own.as_deref();
            own.is_some_and(|own| declared::is_padding(name, own))
        };
        let mut next = 0..;
        let mut index = |is_padding: bool| match is_padding {
            true => None,
            false => next.next(),
        };
        let indices: Vec<Option<u32>> =
            members.iter().map(|m| index(is_padding(&m.name))).collect();
        members.retain(|m| !is_padding(&m.name));
        if members.len() < indices.len() && !members.is_empty() {
            moved.insert(global.ty, indices);
            module.types.replace(global.ty, ty);
        }
    }
    if moved.is_empty() {
        return None;
    }
    let Module {
        functions,
        entry_points,
        ..
    } = &mut module;
    let info = program.info();
    let old = &program.module().types;
    for (handle, function) in functions.iter_mut() {
        move_members(function, &info[handle], old, &moved)?;
    }
    for (i, entry) in entry_points.iter_mut().enumerate() {
        move_members(&mut entry.function, info.get_entry_point(i), old, &moved)?;
    }
    program.with_module(module).ok()
}

/// Changes the indices of members. `None` if padding is read after all.
fn move_members(
    function: &mut Function,
    info: &FunctionInfo,
    types: &naga::UniqueArena<Type>,
    moved: &Moved,
) -> Option<()> {
    let of = |e: Handle<Expression>| match info[e].ty.inner_with(types) {
        TypeInner::Pointer { base, .. } => Some(*base),
        _ => info[e].ty.handle(),
    };
    for (_, expression) in function.expressions.iter_mut() {
        match expression {
            Expression::AccessIndex { base, index } => {
                if let Some(indices) = of(*base).and_then(|ty| moved.get(&ty)) {
                    *index = (*indices.get(*index as usize)?)?;
                }
            }
            Expression::Compose { ty, .. } if moved.contains_key(ty) => return None,
            _ => {}
        }
    }
    Some(())
}

/// Makes each block the struct of its members.
///
/// ```text
/// %w = OpTypeStruct %p
/// %u = OpVariable %ptr_w Uniform          %u = OpVariable %ptr_p Uniform
/// %1 = OpAccessChain %ptr_p %u %zero
/// OpAccessChain .. %1 %two                OpAccessChain .. %u %two
/// ```
pub(super) fn unwrap(module: &mut Builder) {
    let wrapped = wrapped(module);
    for Wrapped {
        variable,
        class,
        outer,
        inner,
    } in &wrapped
    {
        let pointer = module.type_pointer(None, *class, *inner);
        let module_ref = module.module_mut();
        module_ref
            .annotations
            .retain(|i| ids(i).next() != Some(*outer));
        let globals = &mut module_ref.types_global_values;
        globals.retain(|i| i.result_id != Some(*variable));
        module.variable(pointer, Some(*variable), *class, None);
        let block = Instruction::new(
            Op::Decorate,
            None,
            None,
            vec![
                Operand::IdRef(*inner),
                Operand::Decoration(Decoration::Block),
            ],
        );
        let annotations = &mut module.module_mut().annotations;
        if !annotations.contains(&block) {
            annotations.push(block);
        }
    }
    let mut replaced = HashMap::new();
    rewrite(module, |_, block, instruction| {
        let base = ids(&instruction).next();
        let of = wrapped.iter().find(|w| Some(w.variable) == base);
        match (of, instruction.result_id) {
            (Some(of), Some(id)) if instruction.class.opcode == Op::AccessChain => {
                replaced.insert(id, of.variable);
            }
            _ => block.push(instruction),
        }
    });
    replace_ids(module, &replaced);
}

/// A block that is the only member of a struct.
struct Wrapped {
    variable: u32,
    class: StorageClass,
    outer: u32,
    inner: u32,
}

/// The blocks that can be unwrapped: a block cannot be part of another type.
fn wrapped(module: &Builder) -> Vec<Wrapped> {
    let module = module.module_ref();
    let globals = &module.types_global_values;
    let members = |id: u32| -> Option<Vec<u32>> {
        let is_it = |i: &&Instruction| i.class.opcode == Op::TypeStruct && i.result_id == Some(id);
        Some(ids(globals.iter().find(is_it)?).collect())
    };
    let is_named = |id: u32| module.debug_names.iter().any(|i| ids(i).next() == Some(id));
    let is_part = |id: u32, outer: u32| {
        globals.iter().any(|i| {
            let holds = matches!(
                i.class.opcode,
                Op::TypeStruct | Op::TypeArray | Op::TypeRuntimeArray
            );
            holds && i.result_id != Some(outer) && ids(i).any(|part| part == id)
        })
    };
    let variables = globals.iter().filter(|i| i.class.opcode == Op::Variable);
    let all: Vec<Wrapped> = variables
        .filter_map(|i| {
            let Some(Operand::StorageClass(class)) = i.operands.first() else {
                return None;
            };
            let outer = pointee(module, i.result_type?)?;
            let [inner] = members(outer)?[..] else {
                return None;
            };
            members(inner)?;
            Some(Wrapped {
                variable: i.result_id?,
                class: *class,
                outer,
                inner,
            })
        })
        .filter(|w| !is_named(w.outer))
        .collect();
    let is_free = |w: &Wrapped| {
        let mut wrappers = all.iter().filter(|o| o.inner == w.inner).map(|o| o.outer);
        let first = wrappers.next().unwrap_or(w.outer);
        !is_part(w.inner, first) && wrappers.next().is_none()
    };
    let free: Vec<bool> = all.iter().map(is_free).collect();
    let mut free = free.into_iter();
    let mut all = all;
    all.retain(|_| free.next().unwrap_or_default());
    all
}
