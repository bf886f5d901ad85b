//! Chooses the names that a host sees in GLSL text: the author's names of uniforms, blocks,
//! samplers, attributes, varyings and outputs.
//!
//! naga renames resources and adds numbers to other names. So the program gets unique marker words
//! as names before naga writes it, and `text` replaces the markers. All stages of a program share
//! the names, because GLSL links by name.

use std::collections::{HashMap, HashSet};

use naga::{
    AddressSpace, Binding, GlobalVariable, Handle, Module, ResourceBinding, ShaderStage, Type,
    TypeInner,
};
use naga_edit::declared::{Chosen, Declaration, Declared, Located, Type as Declares};
use naga_edit::interface;
use preshade_plan::program::Program;

use super::loose_uniforms::{self, LooseUniform};
use super::texture_copies::{self, Inseparable, TextureCopies};
use super::{layout, reserved_words};
use crate::emit::overrides::free_stem;

/// A program to write, and the names to put into its text.
pub(in crate::emit) struct Authored {
    /// With markers as names of structs, members and loose uniforms.
    pub program: Program,
    /// Replacements for markers and for names that naga chooses.
    pub(super) words: HashMap<String, Word>,
    /// LooseUniform uniforms by marker, in declaration order.
    pub(super) uniforms: Vec<Uniform>,
    /// Sampler members of a uniform's struct, by the struct's marker.
    pub(super) members: HashMap<String, Vec<SamplerMember>>,
    /// Structs that naga does not write because only their samplers are used: name and members,
    /// inner ones first.
    pub(super) structs: Vec<(String, Vec<SamplerMember>)>,
    /// Struct declarations of uniforms with samplers, by marker, inner ones first, for stages where
    /// naga writes none.
    pub(super) whole: Vec<(String, String)>,
    /// Padding of block structs, by marker.
    pub(super) paddings: HashMap<String, Vec<u32>>,
    /// Blocks, by naga's name of their variable.
    pub(super) blocks: HashMap<String, Block>,
    /// Inputs and outputs, by naga's name.
    pub(super) located: HashMap<String, LocatedName>,
    /// Names that are in use.
    pub(super) taken: Taken,
    /// The author's texture of each added copy.
    pub(super) twins: HashMap<ResourceBinding, ResourceBinding>,
}

/// The replacement of a word.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Word {
    /// A name, or a path to a part: `maps[2]`.
    Path(String),
    /// Nothing, and the following dot is dropped: the block's members are global.
    Nothing,
}

/// A uniform outside of blocks.
#[derive(Clone, Debug)]
pub(super) struct Uniform {
    pub name: String,
    /// Its marker; `None` if it has no data.
    pub mark: Option<String>,
    /// Group and binding of the plan's buffer.
    pub binding: Option<[u32; 2]>,
    /// Offset in the plan's buffer.
    pub offset: u32,
    /// The uniform whose value of the previous frame it has.
    pub previous_of: Option<String>,
    pub declares: Declares,
    /// The marker of its struct, if that has data.
    pub of: Option<String>,
    /// The name of its struct, if that only has samplers.
    pub of_samplers: Option<String>,
    /// The author's `layout(location = ..)`.
    pub location: Option<u32>,
    /// The author's `layout(binding = ..)` of an array of samplers.
    pub unit: Option<u32>,
}

/// A member of a struct that naga does not write.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct SamplerMember {
    pub name: String,
    pub ty: SamplerMemberType,
    pub dimensions: String,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum SamplerMemberType {
    Plain(String),
    Sampler(String),
    /// One of [`Authored::structs`].
    Struct(String),
}

impl SamplerMember {
    pub fn of_struct(&self) -> Option<&String> {
        match &self.ty {
            SamplerMemberType::Struct(name) => Some(name),
            SamplerMemberType::Plain(_) | SamplerMemberType::Sampler(_) => None,
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Block {
    pub name: String,
    /// `None`: its members are global.
    pub instance: Option<String>,
    /// Its members are in the block itself, not in a struct.
    pub opened: bool,
    /// It is a storage block in the std140 layout.
    pub std140: bool,
    /// The marker of its struct, if naga writes its members in the block: the last is unsized.
    pub of: Option<String>,
}

/// A vertex input or fragment output.
#[derive(Clone, Debug)]
pub(super) struct LocatedName {
    pub name: String,
    /// The first of its locations.
    pub location: u32,
    pub chosen: Chosen,
    /// Type and dimensions, if it is one variable for the author and several for naga.
    pub whole: Option<(String, String)>,
}

#[derive(Debug, Default)]
pub(super) struct Taken {
    pub all: HashSet<String>,
    pub vertex: HashSet<String>,
    pub fragment: HashSet<String>,
}

impl Taken {
    pub(super) fn is_taken(&self, stage: ShaderStage, word: &str) -> bool {
        let own = match stage {
            ShaderStage::Vertex => &self.vertex,
            _ => &self.fragment,
        };
        self.all.contains(word) || own.contains(word)
    }

    /// `wanted`, or a similar name that is free.
    fn claim(&mut self, wanted: &str, scope: Scope) -> String {
        let wanted = identifier(wanted);
        let free = |name: &str| {
            let taken = match scope {
                Scope::All => {
                    self.all.contains(name)
                        || self.vertex.contains(name)
                        || self.fragment.contains(name)
                }
                Scope::Vertex => self.all.contains(name) || self.vertex.contains(name),
                Scope::Fragment => self.all.contains(name) || self.fragment.contains(name),
            };
            !taken && !reserved_words::is_reserved(name)
        };
        let name = match free(&wanted) {
            true => wanted,
            false => {
                // GLSL reserves all names that begin with `gl_`.
                let stem = wanted.trim_start_matches("gl_").trim_end_matches('_');
                let mut numbered = (1..).map(|i| format!("{stem}_{i}"));
                numbered.find(|n| free(n)).unwrap_or_default()
            }
        };
        let set = match scope {
            Scope::All => &mut self.all,
            Scope::Vertex => &mut self.vertex,
            Scope::Fragment => &mut self.fragment,
        };
        set.insert(name.clone());
        name
    }
}

/// Whether a type is `part`, or has it in it.
fn holds(module: &Module, ty: Handle<Type>, part: Handle<Type>) -> bool {
    ty == part
        || match &module.types[ty].inner {
            TypeInner::Array { base, .. } | TypeInner::BindingArray { base, .. } => {
                holds(module, *base, part)
            }
            TypeInner::Struct { members, .. } => members.iter().any(|m| holds(module, m.ty, part)),
            _ => false,
        }
}

#[derive(Clone, Copy)]
enum Scope {
    All,
    Vertex,
    Fragment,
}

/// Converts a WGSL name to a GLSL identifier. WGSL allows any letters.
fn identifier(name: &str) -> String {
    let plain: String = name
        .chars()
        .map(|c| match c.is_ascii_alphanumeric() || c == '_' {
            true => c,
            false => '_',
        })
        .collect();
    match plain.bytes().next() {
        None => "unnamed".to_owned(),
        Some(b) if b.is_ascii_digit() => format!("_{plain}"),
        _ => plain,
    }
}

/// Why a program cannot be written.
pub enum Failed {
    /// A texture used with several samplers is passed to functions.
    Samplers,
    /// A block layout that GLSL cannot express.
    Layout(String),
    /// An author's name cannot be used.
    Names(String),
}

/// Prepares `program` to be written with its author's names.
pub(in crate::emit) fn prepare(program: &Program) -> Result<Authored, Failed> {
    let split = texture_copies::split(program).map_err(|Inseparable| Failed::Samplers)?;
    let (program, twins) = match split {
        Some(TextureCopies { ref program, of }) => (program, of),
        None => (program, HashMap::new()),
    };
    let declared = program.declared();
    let (mut module, loose) = match loose_uniforms::split(program.module(), declared) {
        Ok(loosened) => (loosened.module, loosened.uniforms),
        // A block passed to a function keeps its struct.
        Err(_) if declared.loose.is_none() => (program.module().clone(), Vec::new()),
        Err(what) => return Err(Failed::Names(what)),
    };
    let declared = &declared.with_previous();
    let mut out = Authored {
        program: program.clone(),
        words: HashMap::new(),
        uniforms: Vec::new(),
        members: HashMap::new(),
        structs: Vec::new(),
        whole: Vec::new(),
        paddings: HashMap::new(),
        blocks: HashMap::new(),
        located: HashMap::new(),
        taken: Taken::default(),
        twins,
    };
    let marks = Marks::of(&module);
    let mut names: HashMap<String, String> = HashMap::new();
    for uniform in &declared.uniforms {
        let name = out.taken.claim(&uniform.name, Scope::All);
        names.insert(uniform.name.clone(), name);
    }
    out.textures(&module, declared, &names);
    out.blocks(&module, declared, &marks);
    out.interface(&module, declared);
    let layouts = layout::layouts(&module, &|b| declared.is_loose(b)).map_err(Failed::Layout)?;
    for (_, global) in module.global_variables.iter() {
        if let Some(binding) = global.binding
            && layouts.std140.contains(&binding)
        {
            for name in out.resource_names(global, binding) {
                if let Some(block) = out.blocks.get_mut(&name) {
                    block.std140 = true;
                }
            }
        }
    }
    let types = out.mark_structs(&mut module, &marks);
    for (ty, floats) in layouts.paddings {
        if let Some(mark) = types.get(&ty) {
            out.paddings.insert(mark.clone(), floats);
        }
    }
    out.uniforms(&mut module, declared, &names, &loose, &marks, &types);
    out.program = program
        .with_module(module)
        .map_err(|invalid| Failed::Names(invalid.to_string()))?;
    Ok(out)
}

/// The prefix of markers, which no name of the module contains.
struct Marks(String);

impl Marks {
    fn of(module: &Module) -> Self {
        Self(free_stem(module, "preshade"))
    }

    fn of_type(&self, ty: Handle<Type>) -> String {
        format!("{}_type{}x", self.0, ty.index())
    }

    fn of_member(&self, ty: Handle<Type>, index: usize) -> String {
        format!("{}_member{}of{index}x", self.0, ty.index())
    }

    fn of_uniform(&self, index: usize) -> String {
        format!("{}_uniform{index}x", self.0)
    }
}

impl Authored {
    fn textures(&mut self, module: &Module, declared: &Declared, names: &HashMap<String, String>) {
        for (_, global) in module.global_variables.iter() {
            let (TypeInner::Image { .. }, Some(binding)) =
                (&module.types[global.ty].inner, global.binding)
            else {
                continue;
            };
            let combined = declared.samplers.iter().find(|s| s.texture == binding);
            let path = match combined {
                Some(combined) => {
                    let end = combined
                        .path
                        .find(['.', '['])
                        .unwrap_or(combined.path.len());
                    let (root, rest) = combined.path.split_at(end);
                    let root = names.get(root).map_or(root, String::as_str);
                    format!("{root}{rest}")
                }
                None => {
                    let name = global.name.as_deref().unwrap_or("image");
                    self.taken.claim(name, Scope::All)
                }
            };
            self.resource(global, binding, &Word::Path(path));
        }
    }

    /// The name of a stage's immediate data.
    pub(super) fn immediate(&self, stage: ShaderStage) -> Option<&str> {
        let end = match stage {
            ShaderStage::Vertex => "vs",
            ShaderStage::Compute => "cs",
            _ => "fs",
        };
        match self.words.get(&format!("_immediates_binding_{end}"))? {
            Word::Path(name) => Some(name),
            Word::Nothing => None,
        }
    }

    /// Registers naga's names of a resource.
    fn resource(&mut self, global: &GlobalVariable, binding: ResourceBinding, word: &Word) {
        for name in self.resource_names(global, binding) {
            self.words.insert(name, word.clone());
        }
    }

    /// naga's names of a resource in the stages that use it. Another stage may have another
    /// resource at that binding.
    fn resource_names(&self, global: &GlobalVariable, binding: ResourceBinding) -> Vec<String> {
        let ResourceBinding { group, binding } = binding;
        let of = self.stages_of(global).into_iter();
        of.map(|end| format!("_group_{group}_binding_{binding}_{end}"))
            .collect()
    }

    /// The ends of naga's names in the stages that use a variable.
    fn stages_of(&self, global: &GlobalVariable) -> Vec<&'static str> {
        let module = self.program.module();
        let mut own = module.global_variables.iter();
        let own = own.find(|(_, g)| g.binding == global.binding && g.name == global.name);
        let uses = |stage: ShaderStage| {
            let entries = module.entry_points.iter().enumerate();
            let mut entries = entries.filter(|(_, e)| e.stage == stage);
            own.is_none_or(|(handle, _)| {
                entries.any(|(i, _)| !self.program.info().get_entry_point(i)[handle].is_empty())
            })
        };
        let stages = [
            (ShaderStage::Vertex, "vs"),
            (ShaderStage::Fragment, "fs"),
            (ShaderStage::Compute, "cs"),
        ];
        let of = stages.iter().filter(|(stage, _)| uses(*stage));
        of.map(|(_, end)| *end).collect()
    }

    fn blocks(&mut self, module: &Module, declared: &Declared, marks: &Marks) {
        for (_, global) in module.global_variables.iter() {
            match global.space {
                AddressSpace::Uniform | AddressSpace::Storage { .. } => {}
                AddressSpace::Immediate => {
                    let name = global.name.as_deref().unwrap_or("immediates");
                    let name = self.taken.claim(name, Scope::All);
                    for stage in self.stages_of(global) {
                        let word = Word::Path(name.clone());
                        self.words
                            .insert(format!("_immediates_binding_{stage}"), word);
                    }
                    continue;
                }
                _ => continue,
            }
            let Some(binding) = global.binding else {
                continue;
            };
            if declared.is_loose(Some(binding)) {
                continue;
            }
            let ty = &module.types[global.ty];
            let members = match &ty.inner {
                TypeInner::Struct { members, .. } => members.as_slice(),
                _ => &[],
            };
            let stage_file = declared.blocks.iter().find(|b| b.binding == binding);
            let own = global.name.clone();
            let (name, instance) = match stage_file {
                Some(block) => (block.name.clone(), block.instance.clone()),
                None => (
                    match &ty.name {
                        Some(name) if !members.is_empty() => name.clone(),
                        _ => format!("{}_block", own.as_deref().unwrap_or("uniform")),
                    },
                    own,
                ),
            };
            let name = self.taken.claim(&name, Scope::All);
            // naga opens an unsized block itself.
            let open = ty.inner.is_dynamically_sized(&module.types) && !members.is_empty();
            let opened = !open && !members.is_empty();
            let instance = match instance {
                None if opened => {
                    for (i, member) in members.iter().enumerate() {
                        let author = member.name.as_deref().unwrap_or("member");
                        let given = self.taken.claim(author, Scope::All);
                        let mark = marks.of_member(global.ty, i);
                        self.words.insert(mark, Word::Path(given));
                    }
                    None
                }
                other => {
                    let wanted = other.unwrap_or_else(|| format!("{name}_data"));
                    Some(self.taken.claim(&wanted, Scope::All))
                }
            };
            let word = match &instance {
                Some(instance) => Word::Path(instance.clone()),
                None => Word::Nothing,
            };
            self.resource(global, binding, &word);
            let block = Block {
                name,
                instance,
                opened,
                std140: false,
                of: open.then(|| marks.of_type(global.ty)),
            };
            for variable in self.resource_names(global, binding) {
                self.blocks.insert(variable, block.clone());
            }
        }
    }

    /// Names attributes, outputs and varyings.
    fn interface(&mut self, module: &Module, declared: &Declared) {
        let entries = |stage: ShaderStage| {
            let all = module.entry_points.iter();
            all.filter(move |e| e.stage == stage)
        };
        let located = |io: &[interface::Io]| -> Vec<(u32, String)> {
            let mut all = Vec::new();
            for io in io {
                if let Some(location) = naga_location(io)
                    && all.iter().all(|(l, _)| *l != location)
                {
                    let name = io.name.clone().unwrap_or_default();
                    all.push((location, name));
                }
            }
            all
        };
        let inputs: Vec<_> = entries(ShaderStage::Vertex)
            .flat_map(|e| interface::inputs(module, &e.function))
            .collect();
        let outputs: Vec<_> = entries(ShaderStage::Fragment)
            .flat_map(|e| interface::outputs(module, &e.function))
            .collect();
        self.located(
            &located(&inputs),
            &declared.attributes,
            "p2vs",
            Scope::Vertex,
        );
        self.located(
            &located(&outputs),
            &declared.targets,
            "fs2p",
            Scope::Fragment,
        );

        let written =
            entries(ShaderStage::Vertex).flat_map(|e| interface::outputs(module, &e.function));
        let read =
            entries(ShaderStage::Fragment).flat_map(|e| interface::inputs(module, &e.function));
        let varyings: Vec<_> = written.chain(read).collect();
        for (location, name) in located(&varyings) {
            let wanted = match name.as_str() {
                "" => "varying",
                name => name,
            };
            let name = self.taken.claim(wanted, Scope::All);
            let word = Word::Path(name);
            self.words
                .insert(format!("_vs2fs_location{location}"), word);
        }
    }

    /// Names inputs or outputs by location.
    fn located(&mut self, all: &[(u32, String)], declared: &[Located], stem: &str, scope: Scope) {
        let naga = |location: u32| format!("_{stem}_location{location}");
        for (location, own) in all {
            if self.words.contains_key(&naga(*location)) {
                continue;
            }
            let covers = |l: &&Located| {
                let parts = parts(&l.declaration.ty);
                (l.location..l.location + parts.len() as u32).contains(location)
            };
            let Some(stage_file) = declared.iter().find(covers) else {
                let own = match (own.as_str(), scope) {
                    ("", Scope::Fragment) => &format!("target_{location}"),
                    ("", _) => &format!("input_{location}"),
                    (own, _) => own,
                };
                let name = self.taken.claim(own, scope);
                let input = LocatedName {
                    name: name.clone(),
                    location: *location,
                    chosen: Chosen::ByAuthor,
                    whole: None,
                };
                self.located.insert(naga(*location), input);
                self.words.insert(naga(*location), Word::Path(name));
                continue;
            };
            let Declaration { name, ty, .. } = &stage_file.declaration;
            let name = self.taken.claim(name, scope);
            let parts = parts(ty);
            for (i, part) in parts.iter().enumerate() {
                let whole = match (&parts[..], ty.innermost()) {
                    ([part], _) if part.is_empty() => None,
                    (_, Declares::Plain(plain)) => Some((plain.clone(), ty.dimensions())),
                    _ => None,
                };
                let at = naga(stage_file.location + i as u32);
                let input = LocatedName {
                    name: name.clone(),
                    location: stage_file.location,
                    chosen: stage_file.chosen,
                    whole,
                };
                self.located.insert(at.clone(), input);
                self.words.insert(at, Word::Path(format!("{name}{part}")));
            }
        }
    }

    /// Renames structs and members to markers.
    fn mark_structs(
        &mut self,
        module: &mut Module,
        marks: &Marks,
    ) -> HashMap<Handle<Type>, String> {
        let predeclared: HashSet<Handle<Type>> = module
            .special_types
            .predeclared_types
            .values()
            .copied()
            .collect();
        let structs: HashSet<String> = module
            .types
            .iter()
            .filter(|(_, ty)| matches!(ty.inner, TypeInner::Struct { .. }))
            .filter_map(|(_, ty)| ty.name.as_deref().map(identifier))
            .collect();
        let globals = module.global_variables.iter();
        let globals: Vec<Handle<Type>> = globals.map(|(_, g)| g.ty).collect();
        let mut own_marks = HashMap::new();
        let handles: Vec<Handle<Type>> = module.types.iter().map(|(h, _)| h).collect();
        for handle in handles {
            let mut ty = module.types[handle].clone();
            let TypeInner::Struct { members, .. } = &mut ty.inner else {
                continue;
            };
            if predeclared.contains(&handle) {
                continue;
            }
            let mut own = HashSet::new();
            // A host knows the members of a global variable's struct by their names.
            let is_hosts = globals.iter().any(|ty| holds(module, *ty, handle));
            for (i, member) in members.iter_mut().enumerate() {
                let mark = marks.of_member(handle, i);
                let author = identifier(member.name.as_deref().unwrap_or("member"));
                // Not every compiler takes a member that is named like a struct.
                let is_a_struct = structs.contains(&author) && !is_hosts;
                let mut name = match is_a_struct || reserved_words::is_keyword(&author) {
                    true => format!("own_{author}"),
                    false => author,
                };
                while !own.insert(name.clone()) {
                    name.push('x');
                }
                self.words.entry(mark.clone()).or_insert(Word::Path(name));
                member.name = Some(mark);
            }
            let entry = module.entry_points.iter().find(|e| {
                let result = e.function.result.as_ref();
                result.is_some_and(|r| r.ty == handle)
            });
            let author = match (&ty.name, entry.map(|e| e.stage)) {
                (Some(name), _) => name,
                (None, Some(ShaderStage::Vertex)) => "VertexOutput",
                (None, Some(ShaderStage::Fragment)) => "FragmentOutput",
                _ => "Struct",
            };
            let name = self.taken.claim(author, Scope::All);
            let mark = marks.of_type(handle);
            self.words.insert(mark.clone(), Word::Path(name));
            ty.name = Some(mark.clone());
            own_marks.insert(handle, mark);
            module.types.replace(handle, ty);
        }
        own_marks
    }

    fn uniforms(
        &mut self,
        module: &mut Module,
        declared: &Declared,
        names: &HashMap<String, String>,
        loose: &[LooseUniform],
        marks: &Marks,
        types: &HashMap<Handle<Type>, String>,
    ) {
        for (i, uniform) in declared.uniforms.iter().enumerate() {
            let data = loose.iter().find(|l| l.name == uniform.name);
            let mark = data.map(|data| {
                let mark = marks.of_uniform(i);
                let variable = &mut module.global_variables[data.variable];
                variable.name = Some(mark.clone());
                if uniform.ty.has_samplers() {
                    let ty = module.global_variables[data.variable].ty;
                    self.structs(module, ty, &uniform.ty, types);
                }
                mark
            });
            let name = names.get(&uniform.name).unwrap_or(&uniform.name).clone();
            if let Some(mark) = &mark {
                self.words.insert(mark.clone(), Word::Path(name.clone()));
            }
            let of_samplers = match (&mark, uniform.ty.innermost()) {
                (None, Declares::Struct(of, members)) if uniform.ty.has_samplers() => {
                    Some(self.own_struct(of, members))
                }
                _ => None,
            };
            self.uniforms.push(Uniform {
                name,
                mark,
                binding: data.map(|d| d.binding),
                offset: data.map_or(0, |d| d.offset),
                previous_of: data.and_then(|d| d.previous_of.clone()),
                declares: uniform.ty.clone(),
                of: data.and_then(|data| {
                    let mut ty = module.global_variables[data.variable].ty;
                    while let TypeInner::Array { base, .. } = module.types[ty].inner {
                        ty = base;
                    }
                    types.get(&ty).cloned()
                }),
                of_samplers,
                location: uniform.location,
                unit: first_unit(declared, uniform),
            });
        }
    }

    /// Records the sampler members of a uniform's structs, and the structs' declarations, inner
    /// ones first.
    fn structs(
        &mut self,
        module: &Module,
        ty: Handle<Type>,
        declares: &Declares,
        types: &HashMap<Handle<Type>, String>,
    ) {
        match (&module.types[ty].inner, declares) {
            (TypeInner::Array { base, .. }, Declares::Array(of, _)) => {
                self.structs(module, *base, of, types);
            }
            (TypeInner::Struct { members, .. }, Declares::Struct(_, declared)) => {
                let Some(mark) = types.get(&ty) else { return };
                if self.whole.iter().any(|(m, _)| m == mark) {
                    return;
                }
                // Members with data come first, in declaration order.
                let data = declared.iter().filter(|d| d.ty.has_data());
                let data: Vec<_> = members.iter().zip(data).collect();
                for (member, declaration) in &data {
                    self.structs(module, member.ty, &declaration.ty, types);
                }
                if declares.has_samplers() && !self.members.contains_key(mark) {
                    let samplers = self.sampler_members(declared);
                    self.members.insert(mark.clone(), samplers);
                }
                let mut lines = String::new();
                for (member, Declaration { ty, .. }) in data {
                    let mut of = member.ty;
                    while let TypeInner::Array { base, .. } = module.types[of].inner {
                        of = base;
                    }
                    let word = match ty.innermost() {
                        Declares::Plain(word) => Some(word),
                        _ => types.get(&of),
                    };
                    let (Some(word), Some(name)) = (word, &member.name) else {
                        return;
                    };
                    lines += &format!("    {word} {name}{};\n", ty.dimensions());
                }
                let text = format!("struct {mark} {{\n{lines}}};");
                self.whole.push((mark.clone(), text));
            }
            _ => {}
        }
    }

    /// Samplers among the declared members.
    fn sampler_members(&mut self, declared: &[Declaration]) -> Vec<SamplerMember> {
        let samplers = declared.iter().filter(|d| !d.ty.has_data());
        samplers.filter_map(|d| self.member(d)).collect()
    }

    fn member(&mut self, declared: &Declaration) -> Option<SamplerMember> {
        let ty = match declared.ty.innermost() {
            Declares::Plain(word) => SamplerMemberType::Plain(word.clone()),
            Declares::Sampler(sampler) => SamplerMemberType::Sampler(sampler.clone()),
            Declares::Struct(of, members) => {
                SamplerMemberType::Struct(self.own_struct(of, members))
            }
            Declares::Array(..) => return None,
        };
        Some(SamplerMember {
            name: declared.name.clone(),
            ty,
            dimensions: declared.ty.dimensions(),
        })
    }

    /// The name of a struct whose samplers alone are used.
    fn own_struct(&mut self, name: &str, declared: &[Declaration]) -> String {
        // The other stage may read its data, so it is declared alike here.
        let data = declared.iter().filter(|d| d.ty.has_data());
        let mut members: Vec<SamplerMember> = data.filter_map(|d| self.member(d)).collect();
        members.extend(self.sampler_members(declared));
        if let Some((name, _)) = self.structs.iter().find(|(_, m)| *m == members) {
            return name.clone();
        }
        let name = self.taken.claim(name, Scope::All);
        self.structs.push((name.clone(), members));
        name
    }
}

/// The author's binding of the first element of a sampler array.
fn first_unit(declared: &Declared, uniform: &Declaration) -> Option<u32> {
    let mut first = uniform.name.clone();
    let mut ty = &uniform.ty;
    while let Declares::Array(of, _) = ty {
        first.push_str("[0]");
        ty = of;
    }
    let sampler = declared.samplers.iter().find(|s| s.path == first)?;
    let mut numbers = declared.numbers.iter();
    let numbered = numbers.find(|n| n.binding == sampler.texture)?;
    matches!(
        (ty, &uniform.ty),
        (Declares::Sampler(_), Declares::Array(..))
    )
    .then_some(numbered.number)
}

/// The number in naga's name for an input or output with a location. The second output of dual
/// source blending has its index there.
pub(super) fn naga_location(io: &interface::Io) -> Option<u32> {
    match io.binding {
        Some(Binding::Location {
            blend_src: Some(index),
            ..
        }) => Some(index),
        Some(Binding::Location { location, .. }) => Some(location),
        _ => None,
    }
}

/// Suffixes of an input with several locations: matrix columns or array elements.
fn parts(ty: &Declares) -> Vec<String> {
    match ty {
        Declares::Array(of, n) => {
            let inner = parts(of);
            let element = |i: u32| inner.iter().map(move |p| format!("[{i}]{p}"));
            (0..*n).flat_map(element).collect()
        }
        Declares::Plain(name) => match name.split_once("mat") {
            Some((_, size)) => {
                let columns = size.bytes().next().map_or(0, |b| b.saturating_sub(b'0'));
                (0..columns).map(|i| format!("[{i}]")).collect()
            }
            None => vec![String::new()],
        },
        _ => vec![String::new()],
    }
}
