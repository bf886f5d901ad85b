//! Splits inputs and outputs for naga's reader, which supports scalars and vectors. SPIR-V also
//! allows blocks, arrays and matrices.

use std::collections::{BTreeMap, HashMap, HashSet};

use rspirv::dr::{self, Builder, Instruction, Operand};
use rspirv::spirv::{BuiltIn, Decoration, Op, StorageClass, Word};

use super::prune::entry;
use crate::words::{
    after_variables, count_parts, decoration, globals, ids, is_access, literal, member_decorations,
    names, push, rewrite, storage_class,
};

/// The most parts of an input or output. WebGPU has fewer locations.
pub(super) const MOST_LEAVES: u32 = 64;

/// A scalar or vector of an input or output.
struct VaryingLeaf {
    /// Indices from the variable to this part.
    path: Vec<u32>,
    ty: Word,
    /// Type of the part's own variable: WGSL's sample mask is unsigned.
    own: Word,
    location: u32,
    /// Decorations for interpolation and sampling.
    decorations: Vec<Operand>,
    name: String,
}

/// An input or output that is neither a scalar nor a vector.
struct Compound {
    id: Word,
    class: StorageClass,
    leaves: Vec<VaryingLeaf>,
    /// A built-in that is unsigned in WGSL: `SampleMask` (an array of one number), `ViewIndex` or
    /// `DrawIndex`.
    unsigned: Option<BuiltIn>,
}

/// Turns blocks, arrays and matrices into private variables. The entry point copies inputs at its
/// start and outputs at its returns.
///
/// # Errors
/// The id of a variable with too many parts.
pub(super) fn open(module: &mut Builder) -> Result<(), Word> {
    let compounds = Types::of(module).compounds(module.module_ref())?;
    if compounds.is_empty() {
        return Ok(());
    }
    let mut made: HashMap<Word, Vec<(Word, VaryingLeaf)>> = HashMap::new();
    let mut classes: BTreeMap<Word, StorageClass> = BTreeMap::new();
    for compound in compounds {
        let mut leaves = Vec::new();
        for mut leaf in compound.leaves {
            if compound.unsigned.is_some() {
                leaf.own = module.type_int(32, 0);
            }
            let pointer = module.type_pointer(None, compound.class, leaf.own);
            let id = module.variable(pointer, None, compound.class, None);
            match compound.unsigned {
                Some(built_in) => {
                    let built_in = [Operand::BuiltIn(built_in)];
                    module.decorate(id, Decoration::BuiltIn, built_in);
                }
                None => {
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
            let body = after_variables(first);
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
    Ok(())
}

/// Copies a leaf between its own variable and the private one.
fn copy(
    module: &mut Builder,
    block: &mut Vec<Instruction>,
    (whole, leaf): (Word, Word),
    of: &VaryingLeaf,
    class: StorageClass,
) {
    let pointer = module.type_pointer(None, StorageClass::Private, of.ty);
    let uint = module.type_int(32, 0);
    let path = of.path.iter().map(|n| module.constant_bit32(uint, *n));
    let path: Vec<Word> = std::iter::once(whole).chain(path).collect();
    let part = match path.as_slice() {
        [whole] => *whole,
        _ => {
            let path = path.into_iter().map(Operand::IdRef);
            push(module, block, (Op::AccessChain, pointer), path)
        }
    };
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

/// Makes variables private, as well as the pointers that functions derive from them.
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
        let is_own = ids(&i).next().is_some_and(|id| pointers.contains(&id));
        if let (true, Some(ty), Some(id)) = (is_access(&i) && is_own, i.result_type, i.result_id) {
            i.result_type = Some(private(module, ty));
            pointers.insert(id);
        }
        block.push(i);
    });
}

struct Types {
    globals: HashMap<Word, Instruction>,
    names: HashMap<Word, String>,
    /// Decorations by id, and by struct and member.
    own: HashMap<Word, Vec<Instruction>>,
    members: HashMap<(Word, u32), Vec<Instruction>>,
    member_names: HashMap<(Word, u32), String>,
}

impl Types {
    fn of(module: &Builder) -> Self {
        let module = module.module_ref();
        let mut own: HashMap<Word, Vec<Instruction>> = HashMap::new();
        for i in &module.annotations {
            if let [Operand::IdRef(id), Operand::Decoration(_), ..] = i.operands.as_slice() {
                own.entry(*id).or_default().push(i.clone());
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
            members: member_decorations(module),
            member_names: member_names.collect(),
        }
    }

    fn compounds(&self, module: &dr::Module) -> Result<Vec<Compound>, Word> {
        let mut taken: HashSet<String> = self.names.values().cloned().collect();
        let mut found = Vec::new();
        for i in &module.types_global_values {
            let is_variable = i.class.opcode == Op::Variable;
            let (Some(id), Some(class)) = (i.result_id.filter(|_| is_variable), storage_class(i))
            else {
                continue;
            };
            if !matches!(class, StorageClass::Input | StorageClass::Output) {
                continue;
            }
            let pointer = i.result_type.and_then(|ty| self.globals.get(&ty));
            let Some(ty) = pointer.and_then(|p| ids(p).next()) else {
                continue;
            };
            let own = self.own.get(&id).map_or(&[][..], Vec::as_slice);
            let unsigned = self.unsigned(own, ty, class);
            let is_built_in = decoration(own, Decoration::BuiltIn).is_some();
            let op = self.globals.get(&ty).map(|i| i.class.opcode);
            let is_compound = matches!(op, Some(Op::TypeStruct | Op::TypeArray | Op::TypeMatrix));
            let is_opened = is_compound && !is_built_in && !self.has_built_ins(ty);
            if unsigned.is_none() && !is_opened {
                continue;
            }
            if count_parts(&self.globals, ty, false) > MOST_LEAVES {
                return Err(id);
            }
            let mut leaves = Vec::new();
            let mut location = decoration(own, Decoration::Location).unwrap_or(0);
            let name = self.names.get(&id).map_or("", String::as_str);
            let interpolated = interpolation(own);
            self.leaves(
                ty,
                &mut location,
                (&mut Vec::new(), name),
                &interpolated,
                &mut leaves,
            );
            for leaf in &mut leaves {
                unique(&mut leaf.name, &mut taken);
            }
            found.push(Compound {
                id,
                class,
                leaves,
                unsigned,
            });
        }
        Ok(found)
    }

    /// The built-in of a variable with signed integers, if it is unsigned in WGSL.
    fn unsigned(&self, own: &[Instruction], ty: Word, class: StorageClass) -> Option<BuiltIn> {
        let is = |b: &BuiltIn| {
            let b = Operand::BuiltIn(*b);
            own.iter().any(|i| i.operands.contains(&b))
        };
        if is(&BuiltIn::SampleMask) {
            return Some(BuiltIn::SampleMask);
        }
        let scalar = self.globals.get(&ty)?;
        let is_signed = scalar.class.opcode == Op::TypeInt
            && scalar.operands.get(1).and_then(literal) == Some(1);
        [BuiltIn::ViewIndex, BuiltIn::DrawIndex]
            .into_iter()
            .find(|b| is_signed && class == StorageClass::Input && is(b))
    }

    fn has_built_ins(&self, ty: Word) -> bool {
        let mut members = self.members.iter();
        members.any(|((id, _), all)| *id == ty && decoration(all, Decoration::BuiltIn).is_some())
    }

    fn leaves(
        &self,
        ty: Word,
        location: &mut u32,
        (path, name): (&mut Vec<u32>, &str),
        decorations: &[Operand],
        out: &mut Vec<VaryingLeaf>,
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
                    if let Some(own) = decoration(own, Decoration::Location) {
                        *location = own;
                    }
                    let decorations = [decorations, &interpolation(own)].concat();
                    let member_name = self.member_names.get(&key).map_or("", String::as_str);
                    let name = joined(name, member_name);
                    path.push(n as u32);
                    self.leaves(member, location, (path, &name), &decorations, out);
                    path.pop();
                }
            }
            (_, Some(count)) => {
                for n in 0..count {
                    path.push(n);
                    let name = joined(name, &n.to_string());
                    self.leaves(first, location, (path, &name), decorations, out);
                    path.pop();
                }
            }
            _ => {
                out.push(VaryingLeaf {
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

/// The name of a part. GLSL reserves two consecutive underscores.
fn joined(whole: &str, part: &str) -> String {
    let (start, end) = (whole.trim_end_matches('_'), part.trim_start_matches('_'));
    match (start, end) {
        ("", end) => end.to_owned(),
        (start, "") => start.to_owned(),
        (start, end) => format!("{start}_{end}"),
    }
}

/// Appends a number to a name that is taken.
fn unique(name: &mut String, taken: &mut HashSet<String>) {
    let mut all = 2..;
    let own = name.clone();
    while !taken.insert(name.clone()) {
        let Some(n) = all.next() else { return };
        *name = joined(&own, &n.to_string());
    }
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
