//! Makes a texture and a sampler of each combined image sampler, because naga's IR has no such
//! thing. The reverse of `emit::spirv::combined`.
//!
//! ```text
//! %t = OpVariable %ptr_sampled            %t = OpVariable %ptr_image
//!                                         %s = OpVariable %ptr_sampler
//! %1 = OpLoad %sampled %t                 %2 = OpLoad %image %t
//!                                         %3 = OpLoad %sampler %s
//!                                         %1 = OpSampledImage %sampled %2 %3
//! ```
//!
//! Functions that receive the one receive both. If all indices of an array are constants, each
//! element becomes a variable, else the array becomes two binding arrays.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use naga::ResourceBinding;
use naga_edit::declared::{CombinedSampler, Declaration, Numbered, Type};
use rspirv::dr::{self, Builder, Instruction, Operand};
use rspirv::spirv::{Decoration, Dim, Op, StorageClass, Word};

use crate::words::{
    after_variables, decorations, globals, ids, is_access, literal, names, pointee, push, rewrite,
    storage_class,
};

/// Descriptor set and binding.
type BindingPlace = (u32, u32);

/// A combined image sampler, or an array of them.
struct Variable {
    id: Word,
    name: String,
    place: BindingPlace,
    image: Word,
    /// Set for an array.
    length: Option<Length>,
    /// Number of elements, if each becomes a variable.
    elements: Option<u32>,
}

#[derive(Clone, Copy)]
enum Length {
    /// Id of the constant.
    Of(Word),
    Unknown,
}

/// The bindings of the textures and samplers that replace combined image samplers, in all modules
/// of a material.
#[derive(Default)]
pub(super) struct Places {
    taken: BTreeSet<BindingPlace>,
    /// Texture and sampler, by the author's binding and the element's index.
    given: BTreeMap<(BindingPlace, u32), [BindingPlace; 2]>,
    pub(super) samplers: Vec<CombinedSampler>,
    pub(super) uniforms: Vec<Declaration>,
    pub(super) numbers: Vec<Numbered>,
}

impl Places {
    /// Marks the bindings of a module as taken.
    pub(super) fn take(&mut self, module: &dr::Module) {
        let sets = decorations(module, Decoration::DescriptorSet);
        let bindings = decorations(module, Decoration::Binding);
        let all = bindings.iter();
        self.taken
            .extend(all.map(|(id, binding)| (sets.get(id).copied().unwrap_or(0), *binding)));
    }

    fn free(&mut self, set: u32) -> BindingPlace {
        let mut all = 0..;
        let place = all.find_map(|n| self.taken.insert((set, n)).then_some((set, n)));
        place.unwrap_or((set, u32::MAX))
    }

    /// The bindings of an element's texture and sampler. The first texture keeps the author's
    /// binding.
    fn of(&mut self, variable: &Variable, index: u32) -> [BindingPlace; 2] {
        let key = (variable.place, index);
        if let Some(given) = self.given.get(&key) {
            return *given;
        }
        let texture = match index {
            0 => variable.place,
            _ => self.free(variable.place.0),
        };
        let given = [texture, self.free(variable.place.0)];
        self.given.insert(key, given);
        given
    }
}

impl Places {
    /// Records that a texture and a sampler form a combined image sampler in the author's module.
    fn pair(&mut self, path: &str, [texture, sampler]: [BindingPlace; 2], number: u32) {
        let of = CombinedSampler {
            path: path.to_owned(),
            texture: binding(texture),
            sampler: binding(sampler),
        };
        if self.samplers.iter().all(|s| s.texture != of.texture) {
            self.numbers.push(Numbered {
                binding: of.texture,
                number,
            });
            self.samplers.push(of);
        }
    }

    fn declare(&mut self, name: String, ty: Type) {
        let declaration = Declaration {
            name,
            ty,
            location: None,
        };
        if !self.uniforms.contains(&declaration) {
            self.uniforms.push(declaration);
        }
    }
}

fn binding((group, binding): BindingPlace) -> ResourceBinding {
    ResourceBinding { group, binding }
}

/// Ids of a texture and its sampler: variables, or pointers to them.
type Pair = [Word; 2];

/// The replacement of a pointer to a combined image sampler or to an array of them.
#[derive(Clone)]
enum Became {
    Pair(Pair),
    /// One pair for each element of an array with constant indices.
    Elements(Vec<Pair>),
    /// Two arrays, for an array with dynamic indices.
    Arrays(Pair),
}

/// Moves samplers that share a texture's binding. HLSL compilers write combined image samplers so:
/// `Texture2D map : register(t1); SamplerState s : register(s1);`.
pub(super) fn part(module: &mut Builder, places: &mut Places) {
    let all = globals(module.module_ref());
    let names = names(module.module_ref());
    let sets = decorations(module.module_ref(), Decoration::DescriptorSet);
    let bindings = decorations(module.module_ref(), Decoration::Binding);
    let bound = |op: Op| {
        let variables = all.values().filter(|i| i.class.opcode == Op::Variable);
        let found = variables.filter_map(|i| {
            let id = i.result_id?;
            let of = all.get(&pointee(module.module_ref(), i.result_type?)?)?;
            let place = (sets.get(&id).copied().unwrap_or(0), *bindings.get(&id)?);
            (of.class.opcode == op).then_some((id, of.result_id?, place))
        });
        let mut found: Vec<_> = found.collect();
        found.sort_unstable();
        found
    };
    let samplers = bound(Op::TypeSampler);
    for (texture, image, place) in bound(Op::TypeImage) {
        let Some((sampler, ..)) = samplers.iter().find(|(_, _, of)| *of == place) else {
            continue;
        };
        let name = names
            .get(&texture)
            .cloned()
            .unwrap_or_else(|| format!("_{texture}"));
        let moved = match places.given.get(&(place, 0)) {
            Some([_, sampler]) => *sampler,
            None => places.free(place.0),
        };
        places.given.insert((place, 0), [place, moved]);
        let ty = glsl_type(&all, image);
        places.pair(&name, [place, moved], place.1);
        places.declare(name, ty);
        for i in &mut module.module_mut().annotations {
            if let [
                Operand::IdRef(id),
                Operand::Decoration(Decoration::Binding),
                Operand::LiteralBit32(n),
            ] = i.operands.as_mut_slice()
                && *id == *sampler
            {
                *n = moved.1;
            }
        }
    }
}

/// Splits all combined image samplers of a module. `map` becomes `map` and `map_sampler`. Returns
/// the old variable of each new one.
pub(super) fn separate(module: &mut Builder, places: &mut Places) -> HashMap<Word, Word> {
    let variables = variables(module.module_ref());
    let mut separate = Separate {
        globals: globals(module.module_ref()),
        became: HashMap::new(),
        loaded: HashMap::new(),
        pairs: HashMap::new(),
        sampler: module.type_sampler(),
    };
    for variable in variables {
        let became = separate.declare(module, places, &variable);
        separate.became.insert(variable.id, became);
    }
    let ids_of = |became: &Became| match became {
        Became::Pair(pair) | Became::Arrays(pair) => pair.to_vec(),
        Became::Elements(pairs) => pairs.concat(),
    };
    let old = separate.became.iter();
    let old = old.flat_map(|(old, became)| ids_of(became).into_iter().map(|new| (new, *old)));
    let old = old.collect();
    separate.parameters(module);
    if separate.became.is_empty() && separate.pairs.is_empty() {
        return old;
    }
    rewrite(module, |module, block, instruction| {
        separate.write(module, block, instruction);
    });
    for entry in &mut module.module_mut().entry_points {
        let became = entry
            .operands
            .iter()
            .skip(2)
            .filter_map(Operand::id_ref_any);
        let became = became
            .filter_map(|id| separate.became.get(&id))
            .flat_map(ids_of);
        let new: Vec<Operand> = became.map(Operand::IdRef).collect();
        entry.operands.extend(new);
    }
    let gone = |id: Option<Word>| {
        id.is_some_and(|id| match separate.became.get(&id) {
            Some(Became::Pair([texture, _])) => *texture != id,
            other => other.is_some(),
        })
    };
    let module = module.module_mut();
    module.types_global_values.retain(|i| !gone(i.result_id));
    for entry in &mut module.entry_points {
        let mut index = 0;
        entry.operands.retain(|o| {
            index += 1;
            index <= 2 || !gone(o.id_ref_any())
        });
    }
    old
}

fn variables(module: &dr::Module) -> Vec<Variable> {
    let all = globals(module);
    let names = names(module);
    let sets = decorations(module, Decoration::DescriptorSet);
    let bindings = decorations(module, Decoration::Binding);
    let found = module.types_global_values.iter().filter_map(|i| {
        let is_variable = i.class.opcode == Op::Variable;
        if !is_variable || storage_class(i) != Some(StorageClass::UniformConstant) {
            return None;
        }
        let id = i.result_id?;
        let of = all.get(&pointee(module, i.result_type?)?)?;
        let (sampled, length) = match of.class.opcode {
            Op::TypeArray | Op::TypeRuntimeArray => {
                let length = ids(of).nth(1).map_or(Length::Unknown, Length::Of);
                (all.get(&ids(of).next()?)?, Some(length))
            }
            _ => (of, None),
        };
        if sampled.class.opcode != Op::TypeSampledImage {
            return None;
        }
        Some(Variable {
            id,
            name: names.get(&id).cloned().unwrap_or_else(|| format!("_{id}")),
            place: (
                sets.get(&id).copied().unwrap_or(0),
                bindings.get(&id).copied().unwrap_or(0),
            ),
            image: ids(sampled).next()?,
            length,
            elements: length.and_then(|length| {
                let Length::Of(length) = length else {
                    return None;
                };
                let n = all.get(&length)?.operands.first().and_then(literal)?;
                (n <= MOST_ELEMENTS && has_constant_indices(module, &all, id)).then_some(n)
            }),
        })
    });
    found.collect()
}

/// Larger arrays are not split into elements.
const MOST_ELEMENTS: u32 = 16;

fn has_constant_indices(module: &dr::Module, all: &HashMap<Word, Instruction>, id: Word) -> bool {
    let functions = module
        .functions
        .iter()
        .flat_map(dr::Function::all_inst_iter);
    let mut uses = functions.filter(|i| ids(i).any(|used| used == id));
    uses.all(|i| {
        let index = ids(i).nth(1).and_then(|index| all.get(&index));
        let is_chain = is_access(i);
        is_chain && index.is_some_and(|i| i.class.opcode == Op::Constant)
    })
}

/// Finds arrays that cannot be split: nested arrays, and arguments of functions.
pub(super) fn check(module: &dr::Module) -> Result<(), Unfit> {
    let all = globals(module);
    let element = |ty: Word| {
        let ty = all.get(&ty)?;
        let is_array = matches!(ty.class.opcode, Op::TypeArray | Op::TypeRuntimeArray);
        is_array.then(|| ids(ty).next())?
    };
    let is_opaque = |ty: Word| {
        let op = all.get(&ty).map(|i| i.class.opcode);
        matches!(
            op,
            Some(Op::TypeImage | Op::TypeSampler | Op::TypeSampledImage)
        )
    };
    // The innermost element, if it is opaque, and the number of arrays around it.
    let arrays = |pointer: Option<Word>| {
        let mut ty = pointee(module, pointer?)?;
        let mut depth = 0;
        while let Some(of) = element(ty) {
            ty = of;
            depth += 1;
        }
        is_opaque(ty).then_some(depth)
    };
    for i in &module.types_global_values {
        let is_variable = i.class.opcode == Op::Variable;
        if is_variable && arrays(i.result_type).is_some_and(|depth| depth > 1) {
            return Err(Unfit {
                id: i.result_id.unwrap_or_default(),
                why: "an array of arrays of textures or samplers is not supported",
                remedy: "declare one array, and compute its index",
            });
        }
    }
    for i in module.functions.iter().flat_map(|f| &f.parameters) {
        if arrays(i.result_type).is_some_and(|depth| depth > 0) {
            return Err(Unfit {
                id: i.result_id.unwrap_or_default(),
                why: "an array of textures or samplers as an argument is not supported",
                remedy: "pass the elements that the function reads, one by one",
            });
        }
    }
    Ok(())
}

/// A combined image sampler that cannot be split.
pub(super) struct Unfit {
    pub(super) id: Word,
    pub(super) why: &'static str,
    pub(super) remedy: &'static str,
}

struct Separate {
    globals: HashMap<Word, Instruction>,
    became: HashMap<Word, Became>,
    /// The variables of loaded textures and samplers, by value.
    loaded: HashMap<Word, Word>,
    /// Texture and sampler of loaded combined image samplers, by value.
    pairs: HashMap<Word, Pair>,
    sampler: Word,
}

impl Separate {
    /// Declares the replacement of a variable. Outside of an array, the variable itself becomes the
    /// texture.
    fn declare(&self, module: &mut Builder, places: &mut Places, variable: &Variable) -> Became {
        let class = StorageClass::UniformConstant;
        let ty = glsl_type(&self.globals, variable.image);
        let mut path = variable.name.clone();
        let mut pair = |module: &mut Builder, path: &str, index: u32, arrays: Option<Length>| {
            let [texture, sampler] = places.of(variable, index);
            let made = [(variable.image, texture), (self.sampler, sampler)].map(|(of, place)| {
                let of = match arrays {
                    Some(Length::Of(length)) => module.type_array(of, length),
                    Some(Length::Unknown) => module.type_runtime_array(of),
                    None => of,
                };
                let pointer = module.type_pointer(None, class, of);
                let id = module.variable(pointer, None, class, None);
                for (decoration, n) in [
                    (Decoration::DescriptorSet, place.0),
                    (Decoration::Binding, place.1),
                ] {
                    module.decorate(id, decoration, [Operand::LiteralBit32(n)]);
                }
                id
            });
            let name = path.replace('[', "_").replace(']', "");
            module.name(made[0], name.clone());
            module.name(made[1], format!("{name}_sampler"));
            places.pair(path, [texture, sampler], variable.place.1 + index);
            made
        };
        let (became, ty) = match (variable.length, variable.elements) {
            (None, _) => (Became::Pair(pair(module, &path, 0, None)), ty),
            (Some(_), Some(n)) => {
                let all = (0..n).map(|i| {
                    path = format!("{}[{i}]", variable.name);
                    pair(module, &path, i, None)
                });
                (
                    Became::Elements(all.collect()),
                    Type::Array(Box::new(ty), n),
                )
            }
            (Some(length), None) => {
                return Became::Arrays(pair(module, &path, 0, Some(length)));
            }
        };
        places.declare(variable.name.clone(), ty);
        became
    }

    fn parameters(&mut self, module: &mut Builder) {
        let mut functions = std::mem::take(&mut module.module_mut().functions);
        let class = StorageClass::UniformConstant;
        for function in &mut functions {
            let mut changed = false;
            let mut parameters = Vec::new();
            let mut loads = Vec::new();
            for parameter in std::mem::take(&mut function.parameters) {
                let ty = parameter.result_type;
                let by_pointer = ty.and_then(|ty| self.image_behind(ty));
                let image = by_pointer.or_else(|| self.image_of(ty?));
                let (Some(image), Some(id), Some(ty)) = (image, parameter.result_id, ty) else {
                    parameters.push(parameter);
                    continue;
                };
                changed = true;
                let pair = [image, self.sampler].map(|of| {
                    let pointer = module.type_pointer(None, class, of);
                    let new = module.id();
                    let op = Op::FunctionParameter;
                    parameters.push(Instruction::new(op, Some(pointer), Some(new), Vec::new()));
                    new
                });
                if by_pointer.is_some() {
                    self.became.insert(id, Became::Pair(pair));
                    continue;
                }
                self.pairs.insert(id, pair);
                let load = [(image, pair[0]), (self.sampler, pair[1])]
                    .map(|(ty, of)| push(module, &mut loads, (Op::Load, ty), [Operand::IdRef(of)]));
                let operands = load.map(Operand::IdRef).to_vec();
                loads.push(Instruction::new(
                    Op::SampledImage,
                    Some(ty),
                    Some(id),
                    operands,
                ));
            }
            if let Some(first) = function.blocks.first_mut() {
                let at = after_variables(first);
                first.instructions.splice(at..at, loads);
            }
            function.parameters = parameters;
            if let Some(def) = function.def.as_mut().filter(|_| changed) {
                let types = function.parameters.iter().filter_map(|p| p.result_type);
                let types: Vec<Word> = types.collect();
                let result = def.result_type.unwrap_or_default();
                let ty = module.type_function(result, types);
                def.operands[1] = Operand::IdRef(ty);
            }
        }
        module.module_mut().functions = functions;
        let new: Vec<(Word, Pair)> = self
            .became
            .iter()
            .filter_map(|(id, became)| match became {
                Became::Pair(pair) => Some((*id, *pair)),
                _ => None,
            })
            .collect();
        let names = names(module.module_ref());
        for (id, [texture, sampler]) in new {
            if let Some(name) = names.get(&id)
                && !names.contains_key(&texture)
            {
                module.name(texture, name.clone());
                module.name(sampler, format!("{name}_sampler"));
            }
        }
    }

    /// The image type behind a pointer to a combined image sampler.
    fn image_behind(&self, pointer: Word) -> Option<Word> {
        let pointer = self.globals.get(&pointer)?;
        let is_pointer = pointer.class.opcode == Op::TypePointer;
        is_pointer.then(|| self.image_of(ids(pointer).next()?))?
    }

    /// The image type of a combined image sampler.
    fn image_of(&self, ty: Word) -> Option<Word> {
        let of = self.globals.get(&ty)?;
        (of.class.opcode == Op::TypeSampledImage).then(|| ids(of).next())?
    }

    fn write(&mut self, module: &mut Builder, block: &mut Vec<Instruction>, mut i: Instruction) {
        let class = StorageClass::UniformConstant;
        let first = ids(&i).next();
        let became = first.and_then(|id| self.became.get(&id)).cloned();
        match (i.class.opcode, became, i.result_id) {
            (_, Some(became), Some(id)) if is_access(&i) => {
                let index = ids(&i).nth(1).unwrap_or_default();
                let pair = match became {
                    Became::Elements(all) => {
                        let index = self.globals.get(&index);
                        let index = index.and_then(|i| i.operands.first()).and_then(literal);
                        let last = all.len().saturating_sub(1);
                        all[(index.unwrap_or(0) as usize).min(last)]
                    }
                    Became::Arrays(arrays) => {
                        let image = i.result_type.and_then(|ty| self.image_behind(ty));
                        let of = [image.unwrap_or_default(), self.sampler];
                        [0, 1].map(|n| {
                            let pointer = module.type_pointer(None, class, of[n]);
                            let path = [arrays[n], index].map(Operand::IdRef);
                            push(module, block, (i.class.opcode, pointer), path)
                        })
                    }
                    Became::Pair(pair) => pair,
                };
                self.became.insert(id, Became::Pair(pair));
            }
            (Op::Load, None, Some(id)) => {
                self.loaded.extend(first.map(|first| (id, first)));
                block.push(i);
            }
            (Op::SampledImage, _, Some(id)) => {
                let mut from = ids(&i).map(|id| self.loaded.get(&id).copied());
                if let (Some(Some(texture)), Some(Some(sampler))) = (from.next(), from.next()) {
                    self.pairs.insert(id, [texture, sampler]);
                }
                drop(from);
                block.push(i);
            }
            (Op::Load, Some(Became::Pair([texture, sampler])), Some(id)) => {
                self.pairs.insert(id, [texture, sampler]);
                let sampled = i.result_type.and_then(|ty| self.globals.get(&ty));
                let image = sampled.and_then(|s| ids(s).next()).unwrap_or_default();
                let load = [(image, texture), (self.sampler, sampler)]
                    .map(|(ty, of)| push(module, block, (Op::Load, ty), [Operand::IdRef(of)]));
                i.class = Instruction::new(Op::SampledImage, None, None, Vec::new()).class;
                i.operands = load.map(Operand::IdRef).to_vec();
                block.push(i);
            }
            (Op::FunctionCall, ..) => {
                let operands = std::mem::take(&mut i.operands).into_iter();
                i.operands = operands
                    .flat_map(|o| {
                        let id = o.id_ref_any();
                        let by_value = id.and_then(|id| self.pairs.get(&id));
                        match (id.and_then(|id| self.became.get(&id)), by_value) {
                            (Some(Became::Pair(pair)), _) | (_, Some(pair)) => {
                                pair.map(Operand::IdRef).to_vec()
                            }
                            _ => vec![o],
                        }
                    })
                    .collect();
                block.push(i);
            }
            _ => block.push(i),
        }
    }
}

/// The sampler type's name in GLSL, such as `usampler2DArray`.
fn glsl_type(globals: &HashMap<Word, Instruction>, image: Word) -> Type {
    let Some(image) = globals.get(&image) else {
        return Type::Sampler("sampler2D".to_owned());
    };
    let of = ids(image).next().and_then(|id| globals.get(&id));
    let sign = of.and_then(|i| i.operands.get(1)).and_then(literal);
    let prefix = match (of.map(|i| i.class.opcode), sign) {
        (Some(Op::TypeInt), Some(0)) => "u",
        (Some(Op::TypeInt), _) => "i",
        _ => "",
    };
    let number = |i: usize| image.operands.get(i).and_then(literal);
    let dim = match image.operands.get(1) {
        Some(Operand::Dim(Dim::Dim1D)) => "1D",
        Some(Operand::Dim(Dim::Dim3D)) => "3D",
        Some(Operand::Dim(Dim::DimCube)) => "Cube",
        _ => "2D",
    };
    let samples = if number(4) == Some(1) { "MS" } else { "" };
    let array = if number(3) == Some(1) { "Array" } else { "" };
    let shadow = if number(2) == Some(1) { "Shadow" } else { "" };
    Type::Sampler(format!("{prefix}sampler{dim}{samples}{array}{shadow}"))
}
