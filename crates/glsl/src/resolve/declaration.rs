//! Resolves globals: structs, resources, variables and constants.

use std::mem;

use naga::{AddressSpace, BinaryOperator, ResourceBinding, ShaderStage, Span, StorageAccess};
use naga_edit::declared;

use super::fold::Folds;
use super::{Pair, Resolver, Var};
use crate::built_in_variables;
use crate::errors::unsupported;
use crate::formats::format_named;
use crate::interface::{BindingSlot, handles};
use crate::layout::{BlockEntry, MemoryLayout, Rules, stored};
use crate::stage::{Block, Global as AstGlobal, Storage, Variable};
use crate::tree::{
    BlockTy, GlobalId, GlobalKind, HandleTy, Kind, Member, Node, Statement, StructTy,
};
use crate::ty::{GlslMember, Ty};
use shader_text::error::Error;
use shader_text::options::ClipSpace;

fn bound(slot: BindingSlot) -> ResourceBinding {
    ResourceBinding {
        group: slot.0,
        binding: slot.1,
    }
}

impl Resolver<'_, '_> {
    pub(super) fn stage(&mut self) -> Result<(), Error> {
        self.resources()?;
        self.varyings()?;
        let varyings = self.out.declared.len();
        self.globals()?;
        if self.clip == ClipSpace::OpenGl
            && self.is_vertex()
            && self.stage.used.contains("gl_Position")
            && let Some(own) = built_in_variables::plain("gl_Position", self.stage.kind)
        {
            // z = (z + w) / 2
            let position = Node::new(Kind::BuiltIn(own));
            let [z, w] = [2, 3].map(|c| position.component(c));
            let sum = Node::binary(BinaryOperator::Add, z.clone(), w);
            let half = Node::binary(BinaryOperator::Multiply, sum, Node::float(0.5));
            let halved = Statement::evaluate(Node::assign(&z, half));
            self.epilogue.push(halved);
        }
        if !self.is_vertex() && self.stage.used.contains("gl_SampleMask") {
            let mask = self.standin("gl_SampleMask", "SampleMask").node.nth(0);
            let out = self.output_of("gl_SampleMask");
            let mask = Node::convert(&Ty::UINT, mask);
            let written = Statement::evaluate(Node::assign(&out, mask));
            self.epilogue.push(written);
        }
        self.functions()?;
        // This comes last, because local structs are found while functions are resolved.
        self.structs();
        let standins = self.standins_declared();
        self.out.declared.splice(varyings..varyings, standins);
        let mut offsets = mem::take(&mut self.offsets);
        offsets.sort_by(|(_, a), (_, b)| {
            let name = |id: &GlobalId| &self.out.globals[id.0].name;
            name(a).cmp(name(b))
        });
        self.out.declared.extend(offsets.iter().map(|(_, id)| *id));
        let helpers = self.helpers.values().copied();
        self.out.order.splice(0..0, helpers);
        self.out.early_fragment_tests =
            self.stage.early_fragment_tests && self.stage.kind == ShaderStage::Fragment;
        self.out.invariant = self.stage.invariant && self.is_vertex();
        Ok(())
    }

    fn structs(&mut self) {
        for name in self.stage.structs.order.clone() {
            let Some(of) = self.stage.structs.get(&name) else {
                continue;
            };
            let entries = self.stage.structs.entries(of);
            let of_members = of.in_uniform_block.then_some(Rules::Std140);
            let members = stored_members(entries, of_members, |i| format!("padding_{i}"));
            let rules = (of.is_hosted || of.tight).then_some(Rules::Std140);
            if !members.is_empty() {
                self.out.structs.push(StructTy {
                    name,
                    rules,
                    members,
                });
            }
        }
    }

    /// Adds a global, and declares it after the previous ones.
    pub(super) fn declare(
        &mut self,
        name: Option<String>,
        kind: GlobalKind,
        place: Option<Span>,
    ) -> Node {
        let (id, node) = self.global_node(name, kind, place);
        self.out.declared.push(id);
        node
    }

    fn resources(&mut self) -> Result<(), Error> {
        self.loose_uniforms();
        let loose = mem::take(&mut self.out.declared);
        // Blocks with an instance name come before all others.
        let mut later = Vec::new();
        for block in self.stage.blocks.clone() {
            let (id, is_first) = self.block(&block);
            match is_first {
                true => self.out.declared.push(id),
                false => later.push(id),
            }
        }
        self.out.declared.extend(loose);
        self.out.declared.append(&mut later);
        for variable in self.stage.opaque.clone() {
            self.opaque(&variable)?;
        }
        for uniform in self.stage.uniforms.clone() {
            // An unused texture is inactive, as in OpenGL.
            if self.stage.used.contains(&uniform.name) {
                self.samplers(&uniform);
            }
        }
        Ok(())
    }

    /// A block and its members. Returns true for a block with an instance name, which comes before
    /// all others.
    fn block(&mut self, block: &Block) -> (GlobalId, bool) {
        let storage = block.qualifiers.storage == Some(Storage::Buffer);
        let rules = block.rules();
        let lay = |member: &GlslMember| MemoryLayout {
            rows: member.row_major,
            ..MemoryLayout::by(rules)
        };
        let slot = self.interface.blocks.get(&block.name).copied();
        let shapes: Vec<GlslMember> = block
            .members
            .iter()
            .map(|m| GlslMember {
                ty: self.shape(&m.ty, lay(m)),
                ..m.clone()
            })
            .collect();
        let entries = match rules {
            Rules::Std140 => self.stage.structs.laid_out(&shapes, false),
            _ => shapes.iter().map(BlockEntry::Member).collect(),
        };
        let members = stored_members(entries, Some(rules), |i| declared::padding(&block.name, i));
        let instance = block.instance.clone();
        let memory = &block.qualifiers.memory;
        let space = match (block.qualifiers.says("push_constant"), storage) {
            (true, _) => AddressSpace::Immediate,
            (false, true) => AddressSpace::Storage {
                access: access(memory),
            },
            (false, false) => AddressSpace::Uniform,
        };
        let last = block.members.last().map(|m| &m.ty);
        let is_unsized = matches!(last, Some(Ty::Array(_, None)));
        let has_atomics = self.stage.used.iter().any(|w| w.starts_with("atomic"));
        let is_open = match instance {
            None => true,
            Some(_) => storage && block.array.is_none() && (is_unsized || has_atomics),
        };
        let kind = GlobalKind::Block(BlockTy {
            is_open,
            name: block.name.clone(),
            members,
            rules,
            space,
            binding: (space != AddressSpace::Immediate).then(|| bound(slot.unwrap_or_default())),
            length: block.array,
        });
        let (id, node) = self.global_node(instance.clone(), kind, block.place);
        let fixed = match storage {
            true if memory.contains(&"readonly") => Some("in a readonly block"),
            true => None,
            false => Some("a uniform"),
        };
        for member in &block.members {
            let node = node.field(member.name.as_str());
            let mut var = Var::plain(node, member.ty.clone()).fixed(fixed);
            var.ex.lay = lay(member);
            // A block is not a value; only its members are.
            match &block.instance {
                Some(instance) if block.array.is_some() => {
                    self.bind(&format!("{instance}[].{}", member.name), var);
                }
                Some(instance) => self.bind(&format!("{instance}.{}", member.name), var),
                None => self.bind(&member.name, var),
            }
        }
        (id, !is_open)
    }

    /// A separate texture, sampler or image.
    fn opaque(&mut self, variable: &Variable) -> Result<(), Error> {
        let of = variable.ty.base_name();
        if matches!(variable.ty, Ty::Array(..)) && of.contains("image") {
            return Err(
                unsupported("arrays of images are not supported", variable.place)
                    .note("declare an image for each element, or one with layers (`image2DArray`)"),
            );
        }
        let slot = self.interface.opaque.get(&variable.name).copied();
        let name = variable.name.clone();
        let words = variable.qualifiers.layout.iter();
        let mut words = words.filter(|(_, value)| value.is_none());
        let format = words.find_map(|(word, _)| format_named(word));
        let mut lengths = Vec::new();
        let mut ty = &variable.ty;
        while let Ty::Array(of, length) = ty {
            lengths.push(length.map(|length| length.n));
            ty = of;
        }
        let kind = GlobalKind::Handle {
            ty: HandleTy::plain(&of),
            lengths,
            binding: bound(slot.unwrap_or_default()),
            format,
            access: access(&variable.qualifiers.memory),
        };
        let node = self.declare(Some(name), kind, variable.place);
        self.bind(&variable.name, Var::plain(node, variable.ty.clone()));
        Ok(())
    }

    /// The split samplers of a uniform.
    fn samplers(&mut self, uniform: &Variable) {
        let mut found = Vec::new();
        let structs = &self.stage.structs;
        structs.samplers(&uniform.ty, &uniform.name, &mut found);
        for (path, _) in found {
            let Some(sampler) = self.interface.samplers.get(&path).cloned() else {
                continue;
            };
            let mut declare = |name: &str, ty, slot| {
                let kind = GlobalKind::Handle {
                    ty,
                    lengths: Vec::new(),
                    binding: bound(slot),
                    format: None,
                    access: StorageAccess::empty(),
                };
                self.declare(Some(name.to_owned()), kind, uniform.place)
            };
            let [texture_ty, sampler_ty] = handles(&sampler.combined);
            let [t, s] = sampler.slots;
            let pair = Pair {
                texture: declare(&sampler.texture, texture_ty, t),
                sampler: declare(&sampler.sampler, sampler_ty, s),
                combined: sampler.combined,
            };
            self.pairs.insert(path, pair);
        }
    }

    fn loose_uniforms(&mut self) {
        let [block, instance] = self.interface.uniform_block.clone();
        let members = self.interface.uniforms.clone();
        let entries = self.stage.structs.laid_out(&members, false);
        let stored = stored_members(entries, Some(Rules::Std140), |i| format!("padding_{i}"));
        let kind = GlobalKind::Block(BlockTy {
            name: block,
            members: stored,
            rules: Rules::Std140,
            space: AddressSpace::Uniform,
            binding: Some(bound(self.interface.uniform_slot)),
            length: None,
            is_open: false,
        });
        let (id, node) = self.global_node(Some(instance), kind, None);
        for uniform in self.stage.uniforms.clone() {
            let path = self
                .stage
                .structs
                .has_samplers(&uniform.ty)
                .then(|| uniform.name.clone());
            let node = node.field(uniform.name.as_str());
            let mut var = Var::plain(node, uniform.ty.clone()).fixed(Some("a uniform"));
            var.ex.lay = MemoryLayout::by(Rules::Std140);
            var.ex.path = path;
            self.bind(&uniform.name, var);
        }
        // A stage only declares the block if it reads from it.
        if members.iter().any(|m| self.stage.used.contains(&m.name)) {
            self.out.declared.push(id);
        }
    }

    fn globals(&mut self) -> Result<(), Error> {
        let globals = mem::take(&mut self.stage.globals);
        self.temporaries = Some(Vec::new());
        for global in &globals {
            self.global(global)?;
        }
        self.temporaries_of_globals = self.temporaries.take().unwrap_or_default();
        Ok(())
    }

    fn global(&mut self, global: &AstGlobal<'_>) -> Result<(), Error> {
        let author = global.name.as_str();
        let name = author.to_owned();
        let is_const = global.qualifiers.storage == Some(Storage::Const);
        let id = global.qualifiers.number("constant_id");
        let mut ty = global.ty.clone();
        let mut folds = Folds::No;
        let is_used = self.stage.used.contains(author) || id.is_some();
        let mut late = None;
        let kind = match global.init.filter(|_| is_used) {
            None => GlobalKind::Variable {
                ty: ty.clone(),
                init: None,
            },
            Some(init) => {
                if is_const {
                    self.check_constant(init)?;
                }
                let temporaries = self.temporaries.as_ref().map_or(0, Vec::len);
                let value = self.initial(init, &mut ty)?;
                let is_whole = temporaries == self.temporaries.as_ref().map_or(0, Vec::len);
                let ty = ty.clone();
                match (id, is_whole && self.is_simple(init)) {
                    (Some(id), _) => {
                        let init = value;
                        GlobalKind::Override { ty, id, init }
                    }
                    (None, true) if is_const => {
                        let known = self.stage.constants.value(author);
                        let known = known.filter(|_| ty.components().is_some());
                        folds = known.map_or(Folds::Unknown, Folds::To);
                        GlobalKind::Constant { ty, init: value }
                    }
                    (None, true) => GlobalKind::Variable {
                        ty,
                        init: Some(value),
                    },
                    (None, false) => {
                        late = Some(value);
                        GlobalKind::Variable { ty, init: None }
                    }
                }
            }
        };
        let (id, node) = self.global_node(Some(name), kind, global.place);
        if is_used {
            self.out.declared.push(id);
        }
        if let Some(value) = late {
            let assigned = Statement::evaluate(Node::assign(&node, value));
            self.prologue.push(assigned.at(global.place));
        }
        let mut var = Var::plain(node, ty).fixed(is_const.then_some("a constant"));
        var.ex.folds = folds;
        self.bind(author, var);
        Ok(())
    }
}

/// The members of a block or struct with their stored types. `padding` returns the name of an
/// unused member, by number.
fn stored_members(
    entries: Vec<BlockEntry<'_>>,
    rules: Option<Rules>,
    padding: impl Fn(usize) -> String,
) -> Vec<Member> {
    let member = |(i, entry): (usize, BlockEntry<'_>)| match entry {
        BlockEntry::Member(member) => Member {
            name: member.name.clone(),
            ty: match rules {
                Some(rules) => stored(&member.ty, rules),
                None => member.ty.clone(),
            },
            span: member.place.unwrap_or_default(),
        },
        BlockEntry::Padding => Member {
            name: padding(i),
            ty: Ty::FLOAT,
            span: Span::UNDEFINED,
        },
    };
    entries.into_iter().enumerate().map(member).collect()
}

/// The access that memory qualifiers permit.
fn access(memory: &[&str]) -> StorageAccess {
    let mut access = StorageAccess::LOAD | StorageAccess::STORE;
    if memory.contains(&"readonly") {
        access &= StorageAccess::LOAD;
    }
    if memory.contains(&"writeonly") {
        access &= StorageAccess::STORE;
    }
    access
}
