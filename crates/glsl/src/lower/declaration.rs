//! Global declarations in the order that naga needs: structs, resources, inputs and outputs,
//! globals, functions.

use std::collections::HashMap;

use naga::ShaderStage;
use preshade_ir::declared;

use super::super::built_ins;
use super::super::interface::{BindingSlot, Opened, SplitSampler, index, split_type};
use super::super::source_marks::{Marks, unmarked};
use super::super::stage::{Block, Global, Qualifiers, Storage, Variable, unsupported};
use super::super::ty::{BlockEntry, Component, GlslMember, MemoryLayout, Rules, Ty, stored};
use super::fold::Folds;
use super::{Lower, RESERVED, Var};
use preshade_text::error::Error;
use preshade_text::options::ClipSpace;

/// The output beside the array of a built-in.
pub(super) fn output_of(built_in: &str) -> String {
    format!("{}_out", built_in.trim_start_matches("gl_"))
}

impl Lower<'_, '_> {
    pub(super) fn stage(&mut self) -> Result<String, Error> {
        let resources = self.resources()?;
        let varyings = self.varyings()?;
        let globals = self.globals()?;
        if self.clip == ClipSpace::OpenGl
            && self.is_vertex()
            && self.stage.used.contains("gl_Position")
        {
            self.epilogue
                .push("gl_Position.z = (gl_Position.z + gl_Position.w) * 0.5;".to_owned());
        }
        if !self.is_vertex() && self.stage.used.contains("gl_SampleMask") {
            let mask = self.standin("gl_SampleMask", "SampleMask");
            let out = self.helper_name(&output_of("gl_SampleMask"));
            self.epilogue.push(format!("{out} = uint({mask}[0]);"));
        }
        let functions = self.functions()?;
        // Last, because local structs are found while lowering.
        let structs = self.structs();
        let standins = self.standins_declared();

        let mut out = "#version 450\n".to_owned();
        if self.stage.early_fragment_tests && self.stage.kind == ShaderStage::Fragment {
            out += "layout(early_fragment_tests) in;\n";
        }
        if self.stage.invariant && self.is_vertex() {
            out += "invariant gl_Position;\n";
        }
        for part in [structs, resources, varyings, standins, globals] {
            if !part.is_empty() {
                out += "\n";
                out += &part;
            }
        }
        for helper in self.helpers.values() {
            out += "\n";
            out += helper;
        }
        out += &functions;
        Ok(out)
    }

    fn structs(&mut self) -> String {
        let mut out = String::new();
        for name in self.stage.structs.order.clone() {
            let Some(of) = self.stage.structs.get(&name).cloned() else {
                continue;
            };
            let entries = match of.in_uniform_block {
                true => self.stage.structs.laid_out(&of.members, true),
                false => {
                    let data = of
                        .members
                        .iter()
                        .filter(|m| self.stage.structs.has_data(&m.ty));
                    data.map(BlockEntry::Member).collect()
                }
            };
            if entries.is_empty() {
                continue;
            }
            out += &format!("struct {name} {{\n");
            for (i, entry) in entries.into_iter().enumerate() {
                let BlockEntry::Member(member) = entry else {
                    out += &format!("    float padding_{i};\n");
                    continue;
                };
                out += &self.marks.mark(member.place);
                let ty = match of.in_uniform_block {
                    true => stored(&member.ty, Rules::Std140),
                    false => member.ty.clone(),
                };
                out += &format!("    {};\n", ty.declare(&member.name));
            }
            out += "};\n";
        }
        out
    }

    fn layout(slot: BindingSlot) -> String {
        format!("set = {}, binding = {}", slot.0, slot.1)
    }

    fn resources(&mut self) -> Result<String, Error> {
        let mut out = self.loose_uniforms()?;
        // naga makes members of a block global names, even if the block has an instance. Later
        // declarations hide them again.
        let mut first = String::new();
        for block in self.stage.blocks.clone() {
            let (text, is_first) = self.block(&block);
            if is_first { &mut first } else { &mut out }.push_str(&text);
        }
        for variable in self.stage.opaque.clone() {
            out += &self.opaque(&variable)?;
        }
        for uniform in self.stage.uniforms.clone() {
            // An unused texture is inactive, as in OpenGL.
            if self.stage.used.contains(&uniform.name) {
                out += &self.samplers(&uniform);
            }
        }
        Ok(first + &out)
    }

    /// Declares a block and its members. Returns true for a block with an instance name, which
    /// comes before all others.
    fn block(&mut self, block: &Block) -> (String, bool) {
        let storage = block.qualifiers.storage == Some(Storage::Buffer);
        let rules = block.rules();
        let lay = |member: &GlslMember| MemoryLayout {
            rows: member.row_major,
            ..MemoryLayout::by(rules)
        };
        let slot = self.interface.blocks.get(&block.name).copied();
        let layout = if block.qualifiers.says("push_constant") {
            "push_constant, std430".to_owned()
        } else {
            let rules = match (storage, rules) {
                (true, Rules::Std140) => ", std140",
                (true, _) => ", std430",
                _ => "",
            };
            Self::layout(slot.unwrap_or_default()) + rules
        };
        let mark = self.marks.mark(block.place);
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
        let is_member = |name: &String| block.members.iter().any(|m| m.name == *name);
        let instance = block.instance.as_ref().map(|i| match is_member(i) {
            true => self.fresh(i),
            false => self.safe(i),
        });
        let last = block.members.last().map(|m| &m.ty);
        // naga reads a block's member by loading the whole block, which fails for an unsized one, and
        // for one with atomic members.
        let is_unsized = matches!(last, Some(Ty::Array(_, None)));
        let has_atomics = self.stage.used.iter().any(|w| w.starts_with("atomic"));
        let is_whole = !is_unsized && !has_atomics;
        let open = instance
            .clone()
            .filter(|_| storage && !is_whole && block.array.is_none());
        let mut names = Vec::new();
        let mut renamed: HashMap<String, String> = HashMap::new();
        let mut body = String::new();
        for (i, entry) in entries.into_iter().enumerate() {
            match entry {
                BlockEntry::Member(member) => {
                    let mut own = member.clone();
                    if let Some(instance) = &open {
                        own.name = self.fresh(&format!("{instance}_{}", member.name));
                        renamed.insert(member.name.clone(), own.name.clone());
                    } else if RESERVED.contains(&member.name.as_str()) {
                        own.name = self.safe(&member.name);
                        renamed.insert(member.name.clone(), own.name.clone());
                    }
                    body += &member_text(&mut self.marks, &own, rules);
                    names.push(member.name.clone());
                }
                BlockEntry::Padding => {
                    let name = declared::padding(&block.name, i);
                    body += &format!("    float {name};\n");
                    names.push(name);
                }
            }
        }
        let fixed = match storage {
            true if block.qualifiers.memory.contains(&"readonly") => Some("in a readonly block"),
            true => None,
            false => Some("a uniform"),
        };
        for member in &block.members {
            let own = renamed.get(&member.name).unwrap_or(&member.name);
            let text = match &instance {
                Some(instance) if open.is_none() => format!("{instance}.{own}"),
                _ => own.clone(),
            };
            let mut var = Var::plain(text, member.ty.clone()).fixed(fixed);
            var.lay = lay(member);
            // A block is not a value; only its members are.
            match &block.instance {
                Some(instance) if block.array.is_some() => {
                    self.bind(&format!("{instance}[].{}", member.name), var);
                }
                Some(instance) => self.bind(&format!("{instance}.{}", member.name), var),
                None => self.bind(&member.name, var),
            }
        }
        let name = self.safe(&block.name);
        let memory = memory(&block.qualifiers);
        let word = if storage { "buffer" } else { "uniform" };
        let text = format!("{mark}layout({layout}) {memory}{word} {name} {{\n{body}}}");
        match (instance, open) {
            (Some(instance), None) => {
                let length = match block.array {
                    Some(Some(n)) => format!("[{n}]"),
                    Some(None) => "[]".to_owned(),
                    None => String::new(),
                };
                return (format!("{text} {instance}{length};\n"), true);
            }
            (_, Some(instance)) => self.interface.opened.extend(slot.map(|slot| Opened {
                slot,
                instance,
                members: names,
            })),
            (None, None) => {}
        }
        (format!("{text};\n"), false)
    }

    /// Declares a separate texture, sampler or image.
    fn opaque(&mut self, variable: &Variable) -> Result<String, Error> {
        if matches!(variable.ty, Ty::Array(..)) && variable.ty.base_name().contains("image") {
            return Err(unsupported(
                "arrays of images are not supported: naga's GLSL parser reads no format of them",
                variable.place,
            )
            .note("declare an image for each element, or one with layers (`image2DArray`)"));
        }
        let slot = self.interface.opaque.get(&variable.name).copied();
        let name = self.safe(&variable.name);
        let layout = variable.qualifiers.layout.iter();
        let format: String = layout
            .filter(|(k, v)| v.is_none() && k.starts_with(['r']))
            .map(|(k, _)| format!(", {k}"))
            .collect();
        let mark = self.marks.mark(variable.place);
        let text = format!(
            "{mark}layout({}{format}) uniform {}{};\n",
            Self::layout(slot.unwrap_or_default()),
            memory(&variable.qualifiers),
            variable.ty.declare(&name)
        );
        self.bind(&variable.name, Var::plain(name, variable.ty.clone()));
        Ok(text)
    }

    /// Declares the split samplers of a uniform.
    fn samplers(&mut self, uniform: &Variable) -> String {
        let mut found = Vec::new();
        let structs = &self.stage.structs;
        structs.samplers(&uniform.ty, &uniform.name, &mut found);
        let mut out = String::new();
        for (path, _) in found {
            let Some(bound) = self.interface.samplers.get(&path) else {
                continue;
            };
            let mark = self.marks.mark(uniform.place);
            let SplitSampler {
                combined,
                texture,
                sampler,
            } = &bound.pair;
            let [texture_type, sampler_type] = split_type(combined);
            let [t, s] = bound.slots.map(Self::layout);
            out += &format!("{mark}layout({t}) uniform {texture_type} {texture};\n");
            out += &format!("layout({s}) uniform {sampler_type} {sampler};\n");
        }
        out
    }

    fn loose_uniforms(&mut self) -> Result<String, Error> {
        let [block, instance] = self.interface.uniform_block.clone();
        let members = self.interface.uniforms.clone();
        for uniform in self.stage.uniforms.clone() {
            let path = self
                .stage
                .structs
                .has_samplers(&uniform.ty)
                .then(|| uniform.name.clone());
            let var = Var {
                text: format!("{instance}.{}", uniform.name),
                ty: uniform.ty.clone(),
                lay: MemoryLayout::by(Rules::Std140),
                path,
                fixed: Some("a uniform"),
                folds: Folds::No,
            };
            self.bind(&uniform.name, var);
        }
        // A stage only declares the block if it reads from it.
        if !members.iter().any(|m| self.stage.used.contains(&m.name)) {
            return Ok(String::new());
        }
        let layout = Self::layout(self.interface.uniform_slot);
        let mut out = format!("layout({layout}) uniform {block} {{\n");
        for (i, entry) in self
            .stage
            .structs
            .laid_out(&members, false)
            .into_iter()
            .enumerate()
        {
            out += &match entry {
                BlockEntry::Member(member) => member_text(&mut self.marks, member, Rules::Std140),
                BlockEntry::Padding => format!("    float padding_{i};\n"),
            };
        }
        Ok(out + &format!("}} {instance};\n"))
    }

    fn varyings(&mut self) -> Result<String, Error> {
        let at = index(self.stage.kind);
        let mut out = String::new();
        for variable in self.stage.inputs.clone() {
            let location = self.interface.inputs[at].get(&variable.key()).copied();
            let used = self.stage.used.contains(variable.used_as());
            self.varying(&variable, location.filter(|_| used), Storage::In, &mut out)?;
        }
        for variable in self.stage.outputs.clone() {
            let location = self.interface.outputs[at].get(&variable.key()).copied();
            let read = self.interface.inputs[1].contains_key(&variable.key());
            let used = self.stage.used.contains(variable.used_as()) || at == 0 && read;
            self.varying(&variable, location.filter(|_| used), Storage::Out, &mut out)?;
        }
        Ok(out)
    }

    /// An input or output. One with several locations becomes a global variable, and one varying
    /// for each part.
    fn varying(
        &mut self,
        variable: &Variable,
        location: Option<u32>,
        direction: Storage,
        out: &mut String,
    ) -> Result<(), Error> {
        let emitted = variable.emitted();
        let name = self.safe(&emitted);
        let mut leaves = Vec::new();
        self.stage.structs.leaves(&variable.ty, "", &mut leaves);
        let fixed = (direction == Storage::In).then_some("an input");
        let var = Var::plain(name.clone(), variable.ty.clone()).fixed(fixed);
        match &variable.block {
            Some((_, Some(instance))) => self.bind(&format!("{instance}.{}", variable.name), var),
            _ => self.bind(&variable.name, var),
        }
        let Some(location) = location else {
            return Ok(());
        };
        let word = if direction == Storage::In {
            "in"
        } else {
            "out"
        };
        let travels = self.is_vertex() == (direction == Storage::Out);
        let [how, at] = match travels {
            true => self
                .interface
                .interpolation
                .get(&variable.key())
                .copied()
                .unwrap_or_default(),
            false => [None, None],
        };
        // Both sources of a blend have an index in the IR; GLSL's default is 0. Index 0 without
        // another means nothing.
        let outputs = &self.stage.outputs;
        let is_second = |v: &Variable| v.qualifiers.number("index").is_some_and(|n| n > 0);
        let index = match direction == Storage::Out && outputs.iter().any(is_second) {
            true => format!(
                ", index = {}",
                variable.qualifiers.number("index").unwrap_or(0)
            ),
            false => String::new(),
        };
        let mark = self.marks.mark(variable.place);
        let target = !self.is_vertex() && direction == Storage::Out;
        let narrow = target && variable.ty.components().is_some_and(|n| n < 4);
        let mut declare = |at_location: u32, ty: &Ty, name: &str| -> Result<(), Error> {
            let integer = matches!(ty.kind(), Some(Component::Int | Component::Uint));
            if ty.kind() == Some(Component::Bool) {
                return Err(unsupported(
                    "a bool cannot be an input or an output",
                    variable.place,
                ));
            }
            let how = match travels && integer {
                true => Some("flat"),
                false => how,
            };
            // Flat values come from one vertex, so the sampling position does not matter.
            let at = at.filter(|_| how != Some("flat"));
            // naga ignores the sampling position without an explicit interpolation.
            let how = how.or(at.and(Some("smooth")));
            let words: String = [how, at]
                .into_iter()
                .flatten()
                .map(|w| format!("{w} "))
                .collect();
            *out += &format!(
                "{mark}layout(location = {at_location}{index}) {words}{word} {};\n",
                ty.declare(name)
            );
            Ok(())
        };
        if let [(ending, ty)] = &leaves[..]
            && ending.is_empty()
            && !narrow
        {
            return declare(location, ty, &name);
        }
        if let [(ending, ty)] = &leaves[..]
            && ending.is_empty()
            && narrow
        {
            // WebGPU needs all components of the target. OpenGL leaves the rest undefined; we write
            // opaque black.
            let kind = ty.kind().unwrap_or(Component::Float);
            let leaf = self.fresh(&format!("{name}_rgba"));
            let rest = match ty.components() {
                Some(1) => ", 0, 0, 1",
                Some(2) => ", 0, 1",
                _ => ", 1",
            };
            let vector = Ty::Vector(kind, 4);
            declare(location, &vector, &leaf)?;
            *out += &format!("{};\n", ty.declare(&name));
            self.last_read.insert(name.clone());
            self.epilogue
                .push(format!("{leaf} = {}({name}{rest});", vector.name()));
            return Ok(());
        }
        let mut declared = Vec::new();
        for (i, (ending, ty)) in leaves.iter().enumerate() {
            let leaf = self.fresh(&format!("{name}{}", super::super::interface::flat(ending)));
            declare(location.saturating_add(i as u32), ty, &leaf)?;
            declared.push((leaf, format!("{name}{ending}")));
        }
        *out += &format!("{};\n", variable.ty.declare(&name));
        if direction != Storage::In {
            self.last_read.insert(name.clone());
        }
        for (leaf, part) in declared {
            match direction {
                Storage::In => self.prologue.push(format!("{part} = {leaf};")),
                _ => self.epilogue.push(format!("{leaf} = {part};")),
            }
        }
        Ok(())
    }

    fn globals(&mut self) -> Result<String, Error> {
        let mut out = String::new();
        let globals = std::mem::take(&mut self.stage.globals);
        self.temporaries = Some(Vec::new());
        for global in &globals {
            self.global(global, &mut out)?;
        }
        self.temporaries_of_globals = self.temporaries.take().unwrap_or_default();
        Ok(out)
    }

    fn global(&mut self, global: &Global<'_>, out: &mut String) -> Result<(), Error> {
        let author = global.name.as_str();
        let name = self.safe(author);
        let fixed = (global.qualifiers.storage == Some(Storage::Const)).then_some("a constant");
        let mut var = Var::plain(name.clone(), global.ty.clone()).fixed(fixed);
        if !self.stage.used.contains(author) && !global.qualifiers.says("constant_id") {
            self.bind(author, var);
            return Ok(());
        }
        let mark = self.marks.mark(global.place);
        let declared = global.ty.declare(&name);
        match global.init {
            None => *out += &format!("{mark}{declared};\n"),
            Some(init) => {
                let temporaries = self.temporaries.as_ref().map_or(0, Vec::len);
                let value = self.initial(init, &global.ty)?;
                let is_whole = temporaries == self.temporaries.as_ref().map_or(0, Vec::len);
                let id = global.qualifiers.number("constant_id");
                if let Some(id) = id {
                    let layout = format!("layout(constant_id = {id})");
                    *out += &format!("{mark}{layout} const {declared} = {value};\n");
                } else if is_whole && self.is_simple(init) {
                    let word = match global.qualifiers.storage {
                        Some(Storage::Const) => {
                            let value = self.stage.constants.value(author);
                            var.folds = value.map_or(Folds::Unknown, Folds::To);
                            "const "
                        }
                        _ => "",
                    };
                    *out += &format!("{mark}{word}{declared} = {value};\n");
                } else {
                    *out += &format!("{mark}{declared};\n");
                    let value = unmarked(&value);
                    self.prologue.push(format!("{mark}{name} = {value};"));
                }
            }
        }
        self.bind(author, var);
        Ok(())
    }

    /// Declares globals for `gl_FragColor` and other names that naga lacks.
    fn standins_declared(&self) -> String {
        let mut out = String::new();
        for (of, name) in &self.standins {
            out += &match *of {
                "gl_FragColor" => format!("layout(location = 0) out vec4 {name};\n"),
                "gl_SampleMask" => format!("int {name}[1] = int[1](-1);\n"),
                "gl_ClipDistance" => {
                    let used = self.clip_distances.max(1);
                    let n = self.stage.clip_distances.unwrap_or(used);
                    format!("float {name}[{n}];\n")
                }
                _ if built_ins::variable(of, self.stage.kind).is_some() => String::new(),
                _ => format!("float {name};\n"),
            };
            if let Some(variable) = built_ins::variable(of, self.stage.kind) {
                let (at, ty) = (variable.location(), variable.ty);
                let (direction, name) = match self.helper_names.get(&output_of(of)) {
                    Some(output) if variable.is_output => ("out", output),
                    _ => ("in", name),
                };
                out += &format!("layout(location = {at}) {direction} {ty} {name};\n");
            }
        }
        for target in &self.targets {
            out += &format!(
                "layout(location = {target}) out vec4 {};\n",
                self.target_name(*target)
            );
        }
        out
    }

    pub(super) fn target_name(&self, target: u32) -> String {
        let mut name = format!("FragData_{target}");
        while self.stage.unit.names.contains(&name) {
            name.push('_');
        }
        name
    }
}

/// Declares a block member with its stored type.
fn member_text(marks: &mut Marks, member: &GlslMember, rules: Rules) -> String {
    let mark = marks.mark(member.place);
    let ty = stored(&member.ty, rules);
    format!("{mark}    {};\n", ty.declare(&member.name))
}

/// `readonly` and other memory qualifiers.
fn memory(qualifiers: &Qualifiers) -> String {
    qualifiers.memory.iter().map(|m| format!("{m} ")).collect()
}
