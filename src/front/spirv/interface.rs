//! Fits inputs and outputs to naga's reader: it reads scalars and vectors, where SPIR-V may have
//! blocks, arrays and matrices. WGSL has no point size, because WebGPU's points are one pixel large.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use naga::{Expression, Function, Module, Statement, TypeInner};
use rspirv::dr::{self, Builder, Instruction, Operand};
use rspirv::spirv::{BuiltIn, Decoration, Op, StorageClass, Word};

use super::combined::names;
use super::prune::entry;
use crate::words::{decorations, globals, ids, literal, push, replace_ids, rewrite, storage_class};

/// Makes a variable of each member of `gl_PerVertex` that is written. The point size becomes private:
/// returns whether there is one.
pub(super) fn split_per_vertex(module: &mut Builder) -> bool {
    let all = globals(module.module_ref());
    // The built-in of each member, and whether it is invariant.
    let mut members: HashMap<(Word, u32), Vec<Instruction>> = HashMap::new();
    let mut sizes: BTreeSet<Word> = BTreeSet::new();
    for i in &module.module_ref().annotations {
        match i.operands.as_slice() {
            [Operand::IdRef(id), Operand::LiteralBit32(n), ..] => {
                members.entry((*id, *n)).or_default().push(i.clone());
            }
            [Operand::IdRef(id), _, Operand::BuiltIn(BuiltIn::PointSize)] => {
                sizes.insert(*id);
            }
            _ => {}
        }
    }
    members.retain(|_, all| number(all, Decoration::BuiltIn).is_some());
    let block = |id: Word| {
        let variable = all.get(&id).filter(|i| i.class.opcode == Op::Variable)?;
        let class = storage_class(variable).filter(|c| *c == StorageClass::Output)?;
        let ty = ids(all.get(&variable.result_type?)?).next()?;
        members.contains_key(&(ty, 0)).then_some((ty, class))
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
        let is_chain = matches!(i.class.opcode, Op::AccessChain | Op::InBoundsAccessChain);
        let base = ids(&i).next().filter(|_| is_chain);
        let found = base.and_then(|base| Some((base, block(base)?.0)));
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
    // A point size of its own.
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

/// Reads `BaseVertex` and `BaseInstance` as 0 where they are subtracted from `VertexIndex` and
/// `InstanceIndex`. Slang and DXC do so for `SV_VertexID` and `SV_InstanceID`; Slang's own WGSL
/// leaves it out too. Returns a note for each.
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

/// Where inputs with perspective are taken, if it is not the pixel's centre, by location. naga's
/// reader forgets it.
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

/// Gives them to the inputs of the fragment stage.
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

/// Gives outputs of the vertex stage the interpolation of the fragment stage's inputs: in SPIR-V
/// only the latter says it. Without a fragment stage, integers are flat.
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
    for module in modules.iter_mut() {
        for index in 0..module.entry_points.len() {
            let entry = &mut module.entry_points[index];
            let Some(result) = &mut entry.function.result else {
                continue;
            };
            if entry.stage != naga::ShaderStage::Vertex {
                continue;
            }
            let settle = |binding: &mut Option<naga::Binding>, ty: &TypeInner| {
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
            let mut ty = module.types[result.ty].clone();
            let TypeInner::Struct { members, .. } = &mut ty.inner else {
                settle(&mut result.binding, &ty.inner);
                continue;
            };
            for member in members {
                settle(&mut member.binding, &module.types[member.ty].inner);
            }
            if module.types.get(&ty).is_none() {
                module.types.replace(result.ty, ty);
            }
        }
    }
}

/// A scalar or vector of an input or output.
struct Leaf {
    /// Indices from the variable.
    path: Vec<u32>,
    ty: Word,
    /// The type of its own variable: WGSL's sample mask has no sign.
    own: Word,
    location: u32,
    /// Interpolation and sampling.
    decorations: Vec<Operand>,
    name: String,
}

/// An input or output that is no scalar or vector.
struct Compound {
    id: Word,
    class: StorageClass,
    leaves: Vec<Leaf>,
    /// `SampleMask`, an array of one number.
    is_mask: bool,
}

/// Makes private variables of blocks, arrays and matrices. The entry point copies inputs at its
/// start and outputs at its ends.
pub(super) fn open(module: &mut Builder) {
    let compounds = Types::of(module).compounds(module.module_ref());
    if compounds.is_empty() {
        return;
    }
    let mut made: HashMap<Word, Vec<(Word, Leaf)>> = HashMap::new();
    let mut classes: BTreeMap<Word, StorageClass> = BTreeMap::new();
    for compound in compounds {
        let mut leaves = Vec::new();
        for mut leaf in compound.leaves {
            if compound.is_mask {
                leaf.own = module.type_int(32, 0);
            }
            let pointer = module.type_pointer(None, compound.class, leaf.own);
            let id = module.variable(pointer, None, compound.class, None);
            match compound.is_mask {
                true => {
                    let mask = [Operand::BuiltIn(BuiltIn::SampleMask)];
                    module.decorate(id, Decoration::BuiltIn, mask);
                }
                false => {
                    let location = [Operand::LiteralBit32(leaf.location)];
                    module.decorate(id, Decoration::Location, location);
                }
            }
            for decoration in &leaf.decorations {
                if let Operand::Decoration(decoration) = decoration {
                    module.decorate(id, *decoration, []);
                }
            }
            module.name(id, leaf.name.clone());
            leaves.push((id, leaf));
        }
        classes.insert(compound.id, compound.class);
        made.insert(compound.id, leaves);
    }
    make_private(module, &classes);
    let entries: Vec<(usize, Word, Vec<Word>)> = module
        .module_ref()
        .entry_points
        .iter()
        .enumerate()
        .filter_map(|(at, e)| Some((at, entry(e)?.1, ids(e).skip(1).collect())))
        .collect();
    let mut functions = std::mem::take(&mut module.module_mut().functions);
    for (at, function, variables) in entries {
        let own = || variables.iter().filter_map(|v| Some((*v, made.get(v)?)));
        let Some(function) = functions.iter_mut().find(|f| f.def_id() == Some(function)) else {
            continue;
        };
        let copies = |module: &mut Builder, class: StorageClass| {
            let mut block = Vec::new();
            for (id, leaves) in own().filter(|(id, _)| classes[id] == class) {
                for (leaf, of) in leaves {
                    copy(module, &mut block, (id, *leaf), of, class);
                }
            }
            block
        };
        let inputs = copies(module, StorageClass::Input);
        for block in &mut function.blocks {
            let is_end = |i: &Instruction| i.class.opcode == Op::Return;
            if let Some(end) = block.instructions.iter().position(is_end) {
                let outputs = copies(module, StorageClass::Output);
                block.instructions.splice(end..end, outputs);
            }
        }
        if let Some(first) = function.blocks.first_mut() {
            let is_head = |i: &Instruction| matches!(i.class.opcode, Op::Variable | Op::Line);
            let body = first
                .instructions
                .iter()
                .position(|i| !is_head(i))
                .unwrap_or(0);
            first.instructions.splice(body..body, inputs);
        }
        let leaves = own().flat_map(|(_, leaves)| leaves.iter().map(|(id, _)| *id));
        let leaves: Vec<Operand> = leaves.map(Operand::IdRef).collect();
        let operands = &mut module.module_mut().entry_points[at].operands;
        let is_compound = |o: &Operand| o.id_ref_any().is_some_and(|id| made.contains_key(&id));
        operands.retain(|o| !is_compound(o));
        operands.extend(leaves);
    }
    module.module_mut().functions = functions;
    let is_of_input = |i: &Instruction| {
        let kind = i.operands.get(1);
        let decorates = |kind: &Operand| {
            matches!(
                kind,
                Operand::Decoration(
                    Decoration::Location
                        | Decoration::BuiltIn
                        | Decoration::Flat
                        | Decoration::NoPerspective
                        | Decoration::Centroid
                        | Decoration::Sample
                )
            )
        };
        ids(i).next().is_some_and(|id| made.contains_key(&id)) && kind.is_some_and(decorates)
    };
    module.module_mut().annotations.retain(|i| !is_of_input(i));
}

/// Copies a leaf between its own variable and the private one.
fn copy(
    module: &mut Builder,
    block: &mut Vec<Instruction>,
    (whole, leaf): (Word, Word),
    of: &Leaf,
    class: StorageClass,
) {
    let pointer = module.type_pointer(None, StorageClass::Private, of.ty);
    let uint = module.type_int(32, 0);
    let path = of.path.iter().map(|n| module.constant_bit32(uint, *n));
    let path: Vec<Word> = std::iter::once(whole).chain(path).collect();
    let part = push(
        module,
        block,
        (Op::AccessChain, pointer),
        path.into_iter().map(Operand::IdRef),
    );
    let ((from, ty), (to, target)) = match class {
        StorageClass::Input => ((leaf, of.own), (part, of.ty)),
        _ => ((part, of.ty), (leaf, of.own)),
    };
    let mut value = push(module, block, (Op::Load, ty), [Operand::IdRef(from)]);
    if ty != target {
        value = push(
            module,
            block,
            (Op::Bitcast, target),
            [Operand::IdRef(value)],
        );
    }
    let store = [to, value].map(Operand::IdRef).to_vec();
    block.push(Instruction::new(Op::Store, None, None, store));
}

/// Makes variables private, and the pointers that functions take from them.
fn make_private(module: &mut Builder, classes: &BTreeMap<Word, StorageClass>) {
    let all = globals(module.module_ref());
    let private = |module: &mut Builder, pointer: Word| {
        let of = all
            .get(&pointer)
            .and_then(|p| ids(p).next())
            .unwrap_or_default();
        module.type_pointer(None, StorageClass::Private, of)
    };
    for id in classes.keys() {
        let Some(pointer) = all.get(id).and_then(|i| i.result_type) else {
            continue;
        };
        let new = private(module, pointer);
        let variables = module.module_mut().types_global_values.iter_mut();
        for i in variables.filter(|i| i.result_id == Some(*id)) {
            i.result_type = Some(new);
            i.operands[0] = Operand::StorageClass(StorageClass::Private);
        }
    }
    let mut pointers: HashSet<Word> = classes.keys().copied().collect();
    rewrite(module, |module, block, mut i| {
        let is_chain = matches!(i.class.opcode, Op::AccessChain | Op::InBoundsAccessChain);
        let is_own = ids(&i).next().is_some_and(|id| pointers.contains(&id));
        if let (true, Some(ty), Some(id)) = (is_chain && is_own, i.result_type, i.result_id) {
            i.result_type = Some(private(module, ty));
            pointers.insert(id);
        }
        block.push(i);
    });
}

struct Types {
    globals: HashMap<Word, Instruction>,
    names: HashMap<Word, String>,
    /// Decorations of ids, and of members.
    own: HashMap<Word, Vec<Instruction>>,
    members: HashMap<(Word, u32), Vec<Instruction>>,
    member_names: HashMap<(Word, u32), String>,
}

impl Types {
    fn of(module: &Builder) -> Self {
        let module = module.module_ref();
        let mut own: HashMap<Word, Vec<Instruction>> = HashMap::new();
        let mut members: HashMap<(Word, u32), Vec<Instruction>> = HashMap::new();
        for i in &module.annotations {
            match i.operands.as_slice() {
                [Operand::IdRef(id), Operand::LiteralBit32(n), ..] => {
                    members.entry((*id, *n)).or_default().push(i.clone());
                }
                [Operand::IdRef(id), ..] => own.entry(*id).or_default().push(i.clone()),
                _ => {}
            }
        }
        let member_names = module
            .debug_names
            .iter()
            .filter_map(|i| match i.operands.as_slice() {
                [
                    Operand::IdRef(id),
                    Operand::LiteralBit32(n),
                    Operand::LiteralString(name),
                ] => Some(((*id, *n), name.clone())),
                _ => None,
            });
        Self {
            globals: globals(module),
            names: names(module),
            own,
            members,
            member_names: member_names.collect(),
        }
    }

    fn compounds(&self, module: &dr::Module) -> Vec<Compound> {
        let variables = module.types_global_values.iter();
        let found = variables.filter_map(|i| {
            let id = i.result_id.filter(|_| i.class.opcode == Op::Variable)?;
            let class = storage_class(i)?;
            if !matches!(class, StorageClass::Input | StorageClass::Output) {
                return None;
            }
            let ty = ids(self.globals.get(&i.result_type?)?).next()?;
            let none = Vec::new();
            let own = self.own.get(&id).unwrap_or(&none);
            let mask = Operand::BuiltIn(BuiltIn::SampleMask);
            let is_mask = own.iter().any(|i| i.operands.contains(&mask));
            let is_built_in = !is_mask && number(own, Decoration::BuiltIn).is_some();
            let op = self.globals.get(&ty)?.class.opcode;
            let is_compound = matches!(op, Op::TypeStruct | Op::TypeArray | Op::TypeMatrix);
            if is_built_in || !is_compound || self.has_built_ins(ty) {
                return None;
            }
            let mut leaves = Vec::new();
            let mut location = number(own, Decoration::Location).unwrap_or(0);
            let name = self.names.get(&id).cloned().unwrap_or_default();
            let interpolated = interpolation(own);
            self.leaves(
                ty,
                &mut location,
                (&mut Vec::new(), &name),
                &interpolated,
                &mut leaves,
            );
            Some(Compound {
                id,
                class,
                leaves,
                is_mask,
            })
        });
        found.collect()
    }

    fn has_built_ins(&self, ty: Word) -> bool {
        let mut members = self.members.iter();
        members.any(|((id, _), all)| *id == ty && number(all, Decoration::BuiltIn).is_some())
    }

    fn leaves(
        &self,
        ty: Word,
        location: &mut u32,
        (path, name): (&mut Vec<u32>, &str),
        decorations: &[Operand],
        out: &mut Vec<Leaf>,
    ) {
        let Some(i) = self.globals.get(&ty) else {
            return;
        };
        let first = ids(i).next().unwrap_or_default();
        let count = match i.class.opcode {
            Op::TypeArray => {
                let length = ids(i).nth(1).and_then(|n| self.globals.get(&n));
                length.and_then(|n| n.operands.first()).and_then(literal)
            }
            Op::TypeMatrix => i.operands.get(1).and_then(literal),
            _ => None,
        };
        match (i.class.opcode, count) {
            (Op::TypeStruct, _) => {
                for (n, member) in ids(i).enumerate() {
                    let key = (ty, n as u32);
                    let none = Vec::new();
                    let own = self.members.get(&key).unwrap_or(&none);
                    if let Some(own) = number(own, Decoration::Location) {
                        *location = own;
                    }
                    let decorations = [decorations, &interpolation(own)].concat();
                    let member_name = self.member_names.get(&key).map_or("", String::as_str);
                    let name = format!("{name}_{member_name}");
                    path.push(n as u32);
                    self.leaves(member, location, (path, &name), &decorations, out);
                    path.pop();
                }
            }
            (_, Some(count)) => {
                for n in 0..count {
                    path.push(n);
                    let name = format!("{name}_{n}");
                    self.leaves(first, location, (path, &name), decorations, out);
                    path.pop();
                }
            }
            _ => {
                out.push(Leaf {
                    path: path.clone(),
                    ty,
                    own: ty,
                    location: *location,
                    decorations: decorations.to_vec(),
                    name: name.to_owned(),
                });
                *location += 1;
            }
        }
    }
}

/// The number of a decoration.
fn number(all: &[Instruction], kind: Decoration) -> Option<u32> {
    let is = |i: &&Instruction| i.operands.contains(&Operand::Decoration(kind));
    let found = all.iter().find(is)?;
    Some(found.operands.last().and_then(literal).unwrap_or(0))
}

fn interpolation(all: &[Instruction]) -> Vec<Operand> {
    let operands = all.iter().flat_map(|i| &i.operands);
    let is_wanted = |o: &&Operand| {
        matches!(
            o,
            Operand::Decoration(
                Decoration::Flat
                    | Decoration::NoPerspective
                    | Decoration::Centroid
                    | Decoration::Sample
            )
        )
    };
    operands.filter(is_wanted).cloned().collect()
}

/// Names the outputs by the variables that they come from: naga's reader names none but the members
/// of blocks.
pub(super) fn name_outputs(module: &mut Module) {
    for index in 0..module.entry_points.len() {
        let entry = &module.entry_points[index];
        let Some(result) = &entry.function.result else {
            continue;
        };
        let ty = result.ty;
        let TypeInner::Struct { members, .. } = &module.types[ty].inner else {
            continue;
        };
        let Some(names) = output_names(module, &entry.function, members.len()) else {
            continue;
        };
        let mut new = module.types[ty].clone();
        new.name.get_or_insert_with(|| {
            let stage = super::super::declaration::stage_name(entry.stage);
            format!("{}{}Output", stage[..1].to_uppercase(), &stage[1..])
        });
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

/// The names of the private variables that the entry point's `return` puts together.
fn output_names(module: &Module, function: &Function, count: usize) -> Option<Vec<Option<String>>> {
    let value = function.body.iter().rev().find_map(|s| match s {
        Statement::Return { value } => *value,
        _ => None,
    })?;
    let Expression::Compose { components, .. } = &function.expressions[value] else {
        return None;
    };
    let name = |component| {
        let Expression::Load { pointer } = function.expressions[component] else {
            return None;
        };
        match function.expressions[pointer] {
            Expression::GlobalVariable(handle) => module.global_variables[handle].name.clone(),
            _ => None,
        }
    };
    let names: Vec<Option<String>> = components.iter().map(|c| name(*c)).collect();
    (names.len() == count).then_some(names)
}
