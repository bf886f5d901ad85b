//! Adapts built-ins, initial values and interpolation for naga's reader. WGSL has no point size,
//! because WebGPU's points have a size of one pixel.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use naga::{Expression, Function, Module, Statement, TypeInner};
use naga_edit::interface;
use rspirv::dr::{self, Builder, Instruction, Operand};
use rspirv::spirv::{BuiltIn, Decoration, Op, StorageClass, Word};

use super::prune::{self, entry};
use crate::words::{
    after_variables, decoration, decorations, globals, ids, is_access, literal, member_decorations,
    push, replace_ids, rewrite, storage_class,
};

/// Turns each written member of `gl_PerVertex` into a variable. The point size becomes a private
/// variable. Returns whether there is one.
pub(super) fn split_per_vertex(module: &mut Builder) -> bool {
    let all = globals(module.module_ref());
    // Built-in of each member, and whether it is invariant.
    let mut members = member_decorations(module.module_ref());
    let annotations = module.module_ref().annotations.iter();
    let sizes: BTreeSet<Word> = annotations
        .filter_map(|i| match i.operands.as_slice() {
            [
                Operand::IdRef(id),
                Operand::Decoration(_),
                Operand::BuiltIn(BuiltIn::PointSize),
            ] => Some(*id),
            _ => None,
        })
        .collect();
    members.retain(|_, all| decoration(all, Decoration::BuiltIn).is_some());
    let block = |id: Word| {
        let variable = all.get(&id).filter(|i| i.class.opcode == Op::Variable)?;
        storage_class(variable).filter(|c| *c == StorageClass::Output)?;
        let ty = ids(all.get(&variable.result_type?)?).next()?;
        members.contains_key(&(ty, 0)).then_some(ty)
    };
    let mut split: BTreeMap<(Word, u32), Word> = BTreeMap::new();
    let mut replaced: HashMap<Word, Word> = HashMap::new();
    let mut has_size = false;
    let mut declare = |module: &mut Builder, ty: Word, n: u32| {
        let key = (ty, n);
        *split.entry(key).or_insert_with(|| {
            let decorations = &members[&key];
            let size = Operand::BuiltIn(BuiltIn::PointSize);
            let is_size = decorations.iter().any(|i| i.operands.contains(&size));
            let class = match is_size {
                true => StorageClass::Private,
                false => StorageClass::Output,
            };
            has_size |= is_size;
            let of = all.get(&ty).and_then(|i| ids(i).nth(n as usize));
            let pointer = module.type_pointer(None, class, of.unwrap_or_default());
            let id = module.variable(pointer, None, class, None);
            for i in decorations.iter().filter(|_| !is_size) {
                let operands = std::iter::once(Operand::IdRef(id))
                    .chain(i.operands[2..].iter().cloned())
                    .collect();
                let i = Instruction::new(Op::Decorate, None, None, operands);
                module.module_mut().annotations.push(i);
            }
            let names = module.module_ref().debug_names.iter();
            let own = names.filter(|i| ids(i).next() == Some(ty)).find_map(|i| {
                match i.operands.as_slice() {
                    [_, Operand::LiteralBit32(of), Operand::LiteralString(name)] if *of == n => {
                        Some(name.clone())
                    }
                    _ => None,
                }
            });
            module.name(id, own.unwrap_or_else(|| format!("_{id}")));
            id
        })
    };
    let mut blocks: HashSet<Word> = HashSet::new();
    rewrite(module, |module, into: &mut Vec<Instruction>, mut i| {
        let base = ids(&i).next().filter(|_| is_access(&i));
        let found = base.and_then(|base| Some((base, block(base)?)));
        let index = ids(&i).nth(1).and_then(|id| all.get(&id));
        let index = index.and_then(|i| i.operands.first()).and_then(literal);
        let (Some((base, ty)), Some(n), Some(id)) = (found, index, i.result_id) else {
            into.push(i);
            return;
        };
        blocks.insert(base);
        let variable = declare(module, ty, n);
        match i.operands.len() {
            2 => {
                replaced.insert(id, variable);
            }
            _ => {
                i.operands.remove(0);
                i.operands[0] = Operand::IdRef(variable);
                into.push(i);
            }
        }
    });
    let all_split: Vec<Operand> = split.values().copied().map(Operand::IdRef).collect();
    replace_ids(module, &replaced);
    // A point size that is a variable of its own.
    for id in sizes {
        let variables = module.module_mut().types_global_values.iter_mut();
        let mut own = variables.filter(|i| i.result_id == Some(id));
        let Some(pointer) = own.next().and_then(|i| i.result_type) else {
            continue;
        };
        has_size = true;
        let of = all
            .get(&pointer)
            .and_then(|p| ids(p).next())
            .unwrap_or_default();
        let private = module.type_pointer(None, StorageClass::Private, of);
        let module = module.module_mut();
        for i in module
            .types_global_values
            .iter_mut()
            .filter(|i| i.result_id == Some(id))
        {
            i.result_type = Some(private);
            i.operands[0] = Operand::StorageClass(StorageClass::Private);
        }
        module.annotations.retain(|i| ids(i).next() != Some(id));
    }
    for entry in &mut module.module_mut().entry_points {
        let has_block = ids(entry).any(|id| blocks.contains(&id));
        if has_block {
            entry
                .operands
                .retain(|o| o.id_ref_any().is_none_or(|id| !blocks.contains(&id)));
            entry.operands.extend(all_split.iter().cloned());
        }
    }
    has_size
}

/// Drops memory access decorations of images: in the IR only buffers have them.
pub(super) fn drop_memory_decorations(module: &mut Builder) {
    let all = globals(module.module_ref());
    let is_image = |id: Word| {
        let class = all.get(&id).and_then(storage_class);
        class == Some(StorageClass::UniformConstant)
    };
    let says = |i: &Instruction| {
        matches!(
            i.operands.get(1),
            Some(Operand::Decoration(
                Decoration::Coherent | Decoration::Volatile
            ))
        )
    };
    let annotations = &mut module.module_mut().annotations;
    annotations.retain(|i| !(says(i) && ids(i).next().is_some_and(is_image)));
}

/// Stores initial values of outputs at the start of the entry points, because naga's reader drops
/// those of outputs that no instruction writes. Private variables with a computed initial value get
/// it there too, because the reader does not support it.
pub(super) fn store_initial(module: &mut Builder) {
    let all = globals(module.module_ref());
    let mut initial: HashMap<Word, Word> = HashMap::new();
    let mut private = Vec::new();
    for i in &mut module.module_mut().types_global_values {
        let (Some(id), Some(value)) = (i.result_id, ids(i).next()) else {
            continue;
        };
        let of = all.get(&value).map(|value| value.class.opcode);
        let is_computed = matches!(of, Some(Op::SpecConstantOp | Op::SpecConstantComposite));
        let is_variable = i.class.opcode == Op::Variable;
        let is_private = is_variable && storage_class(i) == Some(StorageClass::Private);
        if is_private && is_computed {
            private.push(id);
        } else if !prune::is_initial_output(i) {
            continue;
        }
        i.operands.truncate(1);
        initial.insert(id, value);
    }
    if initial.is_empty() {
        return;
    }
    let entries: Vec<(Word, Vec<Word>)> = module
        .module_ref()
        .entry_points
        .iter()
        .filter_map(|e| Some((entry(e)?.1, ids(e).skip(1).collect())))
        .collect();
    let mut functions = std::mem::take(&mut module.module_mut().functions);
    for (function, variables) in entries {
        let mut of_entry = functions.iter_mut();
        let function = of_entry.find(|f| f.def_id() == Some(function));
        let Some(first) = function.and_then(|f| f.blocks.first_mut()) else {
            continue;
        };
        let mut start = Vec::new();
        // From version 1.4 on, an entry point also lists private variables.
        let outputs = variables.into_iter().filter(|id| !private.contains(id));
        for id in outputs.chain(private.iter().copied()) {
            let Some(value) = initial.get(&id) else {
                continue;
            };
            let pointer = all.get(&id).and_then(|i| all.get(&i.result_type?));
            let ty = pointer.and_then(|p| all.get(&ids(p).next()?));
            let store = |block: &mut Vec<Instruction>, to: Word, value: Word| {
                let operands = [to, value].map(Operand::IdRef).to_vec();
                block.push(Instruction::new(Op::Store, None, None, operands));
            };
            let is_struct = |ty: &&Instruction| ty.class.opcode == Op::TypeStruct;
            let Some(ty) = ty.filter(is_struct).filter(|_| !private.contains(&id)) else {
                store(&mut start, id, *value);
                continue;
            };
            // [`split_per_vertex`] needs stores of single members.
            for (n, member) in ids(ty).enumerate() {
                let pointer = module.type_pointer(None, StorageClass::Output, member);
                let uint = module.type_int(32, 0);
                let index = module.constant_bit32(uint, n as u32);
                let path = [id, index].map(Operand::IdRef);
                let to = push(module, &mut start, (Op::AccessChain, pointer), path);
                let path = [Operand::IdRef(*value), Operand::LiteralBit32(n as u32)];
                let part = push(module, &mut start, (Op::CompositeExtract, member), path);
                store(&mut start, to, part);
            }
        }
        let at = after_variables(first);
        first.instructions.splice(at..at, start);
    }
    module.module_mut().functions = functions;
}

/// Replaces `BaseVertex` and `BaseInstance` by 0 where they are subtracted from `VertexIndex` and
/// `InstanceIndex`. Slang and DXC do so for `SV_VertexID` and `SV_InstanceID`, and Slang's own WGSL
/// omits the subtraction too. Returns a note for each.
pub(super) fn drop_bases(module: &mut Builder) -> Vec<String> {
    let mut notes = Vec::new();
    for (base, index, what) in [
        (BuiltIn::BaseVertex, BuiltIn::VertexIndex, "base vertex"),
        (
            BuiltIn::BaseInstance,
            BuiltIn::InstanceIndex,
            "first instance",
        ),
    ] {
        let of = |built_in: BuiltIn| -> HashSet<Word> {
            let all = module.module_ref().annotations.iter();
            let decorated = all.filter(|i| i.operands.contains(&Operand::BuiltIn(built_in)));
            decorated.filter_map(|i| ids(i).next()).collect()
        };
        let (bases, indices) = (of(base), of(index));
        let loads = |of: &HashSet<Word>| -> HashSet<Word> {
            let functions = module.module_ref().functions.iter();
            let all = functions.flat_map(dr::Function::all_inst_iter);
            let loads = all.filter(|i| i.class.opcode == Op::Load);
            let own = loads.filter(|i| ids(i).next().is_some_and(|id| of.contains(&id)));
            own.filter_map(|i| i.result_id).collect()
        };
        let (bases_read, indices_read) = (loads(&bases), loads(&indices));
        let is_difference = |i: &Instruction| {
            let operands: Vec<Word> = ids(i).collect();
            let is_index = |id: Word| indices_read.contains(&id);
            i.class.opcode == Op::ISub
                && matches!(operands[..], [a, b] if is_index(a) && bases_read.contains(&b))
        };
        let functions = module.module_ref().functions.iter();
        let all: Vec<&Instruction> = functions.flat_map(dr::Function::all_inst_iter).collect();
        let reads = |i: &&&Instruction| ids(i).any(|id| bases_read.contains(&id));
        if bases_read.is_empty() || !all.iter().filter(reads).all(|i| is_difference(i)) {
            continue;
        }
        rewrite(module, |_, block, i| {
            let base = ids(&i).nth(1);
            match (i.class.opcode, base, i.result_id) {
                (Op::ISub, Some(base), Some(id)) if bases_read.contains(&base) => {
                    let first = i.operands[..1].to_vec();
                    let op = Op::CopyObject;
                    block.push(Instruction::new(op, i.result_type, Some(id), first));
                }
                (Op::Load, _, Some(id)) if bases_read.contains(&id) => {}
                _ => block.push(i),
            }
        });
        notes.push(format!(
            "`{base:?}` is read as 0, because WebGPU has no such built-in: draw with a {what} of 0"
        ));
    }
    notes
}

/// Sampling of perspective inputs that differs from the pixel's centre, by location. naga's reader
/// loses it.
pub(super) fn sampled(module: &dr::Module) -> HashMap<u32, naga::Sampling> {
    let locations = decorations(module, Decoration::Location);
    let mut all = HashMap::new();
    for i in &module.annotations {
        let (Some(id), Some(Operand::Decoration(how))) = (ids(i).next(), i.operands.get(1)) else {
            continue;
        };
        let at = match how {
            Decoration::Centroid => naga::Sampling::Centroid,
            Decoration::Sample => naga::Sampling::Sample,
            _ => continue,
        };
        all.extend(locations.get(&id).map(|location| (*location, at)));
    }
    all
}

/// Applies this sampling to the inputs of the fragment stage.
pub(super) fn sample(module: &mut Module, sampled: &HashMap<u32, naga::Sampling>) {
    let fragments = module.entry_points.iter_mut();
    let fragments = fragments.filter(|e| e.stage == naga::ShaderStage::Fragment);
    for argument in fragments.flat_map(|e| &mut e.function.arguments) {
        if let Some(naga::Binding::Location {
            location,
            interpolation: Some(naga::Interpolation::Perspective),
            sampling,
            ..
        }) = &mut argument.binding
            && let Some(at) = sampled.get(location)
        {
            *sampling = Some(*at);
        }
    }
}

/// Copies the interpolation of the fragment stage's inputs to the vertex stage's outputs. SPIR-V
/// specifies only the former. Without a fragment stage, integers are flat.
pub(super) fn match_interpolation(modules: &mut [Module]) {
    let mut wanted: HashMap<u32, naga::Binding> = HashMap::new();
    for module in modules.iter() {
        let fragments = module.entry_points.iter();
        let fragments = fragments.filter(|e| e.stage == naga::ShaderStage::Fragment);
        for argument in fragments.flat_map(|e| &e.function.arguments) {
            if let Some(binding @ naga::Binding::Location { location, .. }) = &argument.binding {
                wanted.insert(*location, binding.clone());
            }
        }
    }
    let settle = |ty: &TypeInner, binding: &mut Option<naga::Binding>| {
        let Some(naga::Binding::Location {
            location,
            interpolation,
            sampling,
            ..
        }) = binding
        else {
            return;
        };
        match wanted.get(location) {
            Some(naga::Binding::Location {
                interpolation: of,
                sampling: at,
                ..
            }) => (*interpolation, *sampling) = (*of, *at),
            _ if ty.scalar_kind() != Some(naga::ScalarKind::Float) => {
                *interpolation = Some(naga::Interpolation::Flat);
                *sampling = None;
            }
            _ => {}
        }
    };
    for module in modules.iter_mut() {
        for index in 0..module.entry_points.len() {
            if module.entry_points[index].stage == naga::ShaderStage::Vertex {
                interface::edit_outputs(module, index, |_, ty, binding| settle(ty, binding));
            }
        }
    }
}

/// Names the outputs after their variables. naga's reader names only members of blocks.
pub(super) fn name_outputs(module: &mut Module) {
    for index in 0..module.entry_points.len() {
        let entry = &module.entry_points[index];
        let Some(result) = &entry.function.result else {
            continue;
        };
        let ty = result.ty;
        let TypeInner::Struct { members, .. } = &module.types[ty].inner else {
            name_single_output(module, index);
            continue;
        };
        let Some(names) = output_names(module, &entry.function, members.len()) else {
            continue;
        };
        let mut new = module.types[ty].clone();
        new.name.get_or_insert_with(|| struct_name(entry.stage));
        if let TypeInner::Struct { members, .. } = &mut new.inner {
            for (member, name) in members.iter_mut().zip(names) {
                if member.name.is_none() {
                    member.name = name;
                }
            }
        }
        if module.types.get(&new).is_none() {
            module.types.replace(ty, new);
        }
    }
}

fn struct_name(stage: naga::ShaderStage) -> String {
    let stage = naga_edit::interface::stage_name(stage);
    format!("{}{}Output", stage[..1].to_uppercase(), &stage[1..])
}

/// Wraps a single output in a struct, whose member gets the variable's name. A plain result has no
/// name.
fn name_single_output(module: &mut Module, index: usize) -> Option<()> {
    let entry = &module.entry_points[index];
    let result = entry.function.result.clone()?;
    if !matches!(result.binding, Some(naga::Binding::Location { .. })) {
        return None;
    }
    let mut body = entry.function.body.iter().enumerate().rev();
    let (at, value) = body.find_map(|(at, s)| match s {
        Statement::Return { value } => Some((at, (*value)?)),
        _ => None,
    })?;
    let name = loaded_from(module, &entry.function, value)?;
    let mut layouter = naga::proc::Layouter::default();
    layouter.update(module.to_ctx()).ok()?;
    let member = naga::StructMember {
        name: Some(name),
        ty: result.ty,
        binding: result.binding,
        offset: 0,
    };
    let outputs = naga::Type {
        name: Some(struct_name(entry.stage)),
        inner: TypeInner::Struct {
            members: vec![member],
            span: layouter[result.ty].to_stride(),
        },
    };
    let ty = module.types.insert(outputs, naga::Span::UNDEFINED);
    let function = &mut module.entry_points[index].function;
    let span = function.expressions.get_span(value);
    let components = vec![value];
    let whole = Expression::Compose { ty, components };
    let whole = function.expressions.append(whole, span);
    let mut end = naga::Block::new();
    let range = naga::Range::new_from_bounds(whole, whole);
    end.push(Statement::Emit(range), span);
    end.push(Statement::Return { value: Some(whole) }, span);
    function.body.splice(at..=at, end);
    function.result = Some(naga::FunctionResult { ty, binding: None });
    Some(())
}

/// Name of the variable from which a value is loaded.
fn loaded_from(
    module: &Module,
    function: &Function,
    value: naga::Handle<Expression>,
) -> Option<String> {
    let Expression::Load { pointer } = function.expressions[value] else {
        return None;
    };
    match function.expressions[pointer] {
        Expression::GlobalVariable(handle) => module.global_variables[handle].name.clone(),
        _ => None,
    }
}

/// Names of the private variables from which the entry point's `return` builds its result.
fn output_names(module: &Module, function: &Function, count: usize) -> Option<Vec<Option<String>>> {
    let value = function.body.iter().rev().find_map(|s| match s {
        Statement::Return { value } => *value,
        _ => None,
    })?;
    let Expression::Compose { components, .. } = &function.expressions[value] else {
        return None;
    };
    let names = components.iter();
    let names: Vec<Option<String>> = names.map(|c| loaded_from(module, function, *c)).collect();
    (names.len() == count).then_some(names)
}
