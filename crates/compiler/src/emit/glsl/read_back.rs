//! Parses the written text with our own front end and compares it with the stage: uniforms,
//! samplers, blocks with offsets, attributes and varyings.

use std::collections::{BTreeMap, BTreeSet};

use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{
    AddressSpace, Binding, Function, GlobalVariable, Handle, Module, ShaderStage, Type, TypeInner,
};
use naga_edit::declared::{Declared, Type as Declares};
use naga_edit::interface::{self, Io};

use super::author::{self, Authored, Word};
use crate::emit::ReadBack;
use crate::front;
use crate::wgsl::varying::Varying;
use preshade_plan::plan_file::StageFile;
use shader_text::error::{Code, Color};
use shader_text::tokens as text;

/// Names of GLSL that our front end lacks. A `*` at the end is any rest.
const UNREAD: &[&str] = &["atomic*", "imageAtomic*", "frexp", "textureGatherOffset"];

/// Compares the text with its stage.
pub(super) fn read_back(
    authored: &Authored,
    text: &str,
    stage_file: &StageFile,
    stage: ShaderStage,
    entry: &str,
) -> ReadBack {
    let (module, declared) = match front::glsl_stage(&stage_file.file, text, stage) {
        Ok(read) => read,
        Err(e) => {
            return match unread(text) {
                Some(word) if e.code() != Code::Panic => match lost(text, stage_file) {
                    None => ReadBack::Unread(format!("`{word}`")),
                    Some(name) => ReadBack::Differs(format!("`{name}` is lost")),
                },
                _ => ReadBack::Differs(format!("it does not parse: {}", e.render(Color::Never))),
            };
        }
    };
    // In ES 1.00 an output only has an index: `gl_FragData[1]`.
    let outputs = match text.starts_with("#version 100") {
        true => Outputs::Numbered,
        false => Outputs::Named,
    };
    let valid = Validator::new(ValidationFlags::all(), Capabilities::all()).validate(&module);
    if let Err(invalid) = valid {
        return ReadBack::Differs(format!("it is not valid: {invalid}"));
    }
    let interface = || {
        let entry = (stage, entry);
        interface(authored, stage_file, &module, &declared, entry, outputs)
    };
    uniforms(authored, stage_file, &declared)
        .or_else(|| blocks(authored, stage_file, &module, &declared, stage, entry))
        .or_else(interface)
        .map_or(ReadBack::Same, ReadBack::Differs)
}

/// The first word of the text that our front end lacks.
fn unread(text: &str) -> Option<&str> {
    let mut words = text::tokens(text).map(|(_, range)| &text[range]);
    words.find(|word| {
        UNREAD.iter().any(|name| match name.strip_suffix('*') {
            Some(stem) => word.starts_with(stem),
            None => word == name,
        })
    })
}

/// A name that `plan.json` has and the text lacks.
fn lost<'a>(text: &str, stage_file: &'a StageFile) -> Option<&'a str> {
    let words: BTreeSet<&str> = text::tokens(text).map(|(_, range)| &text[range]).collect();
    let textures = stage_file.textures.iter().map(|t| t.name.as_str());
    let names = textures.chain(stage_file.blocks.iter().map(|b| b.block.as_str()));
    let names = names.chain(stage_file.uniforms.iter().map(|u| u.name.as_str()));
    let mut names = names.chain(stage_file.attributes.iter().map(|a| a.name.as_str()));
    names.find(|name| !words.contains(name.split(['.', '[']).next().unwrap_or(name)))
}

/// The uniform that naga adds to `gl_InstanceID`, which in GLSL starts at 0 for each draw. It is 0
/// unless the host sets it.
const FIRST_INSTANCE: &str = "naga_vs_first_instance";

/// The first line that only one set has.
fn differ(wanted: &BTreeSet<String>, found: &BTreeSet<String>) -> Option<String> {
    let missing = wanted.difference(found).next();
    let extra = found.difference(wanted).next();
    match (missing, extra) {
        (Some(m), Some(e)) => Some(format!("`{m}` became `{e}`")),
        (Some(m), None) => Some(format!("`{m}` is lost")),
        (None, Some(e)) => Some(format!("`{e}` is new")),
        (None, None) => None,
    }
}

/// Compares uniforms outside of blocks, and samplers.
fn uniforms(authored: &Authored, stage_file: &StageFile, read: &Declared) -> Option<String> {
    let root = |path: &str| path.split(['.', '[']).next().unwrap_or(path).to_owned();
    let mut names: BTreeSet<String> = stage_file.uniforms.iter().map(|u| u.name.clone()).collect();
    names.extend(stage_file.textures.iter().map(|t| root(&t.name)));
    let declared = authored.uniforms.iter();
    let types: BTreeMap<&str, &Declares> =
        declared.map(|u| (u.name.as_str(), &u.declares)).collect();
    // WebGPU's immediates become uniforms that the author does not have.
    let immediates: BTreeSet<&str> = ["vs", "fs", "cs"]
        .iter()
        .filter_map(
            |stage| match authored.words.get(&format!("_immediates_binding_{stage}")) {
                Some(Word::Path(name)) => Some(name.as_str()),
                _ => None,
            },
        )
        .collect();
    // So do texture sizes in ES 1.00.
    let sizes: BTreeSet<&str> = stage_file
        .textures
        .iter()
        .filter_map(|t| t.size.as_deref())
        .collect();
    let found = read.uniforms.iter().map(|u| u.name.clone());
    let found: BTreeSet<String> = found
        .filter(|n| n != FIRST_INSTANCE && !immediates.contains(n.as_str()))
        .filter(|n| !sizes.contains(n.as_str()))
        .collect();
    // Storage images are not uniforms either.
    let wanted = names
        .into_iter()
        .filter(|n| types.contains_key(n.as_str()) || found.contains(n));
    if let Some(difference) = differ(&wanted.collect(), &found) {
        return Some(format!("uniforms: {difference}"));
    }
    for uniform in &read.uniforms {
        let (mut wanted, mut found) = (BTreeSet::new(), BTreeSet::new());
        let Some(ty) = types.get(uniform.name.as_str()) else {
            continue;
        };
        type_lines(ty, &uniform.name, &mut wanted);
        type_lines(&uniform.ty, &uniform.name, &mut found);
        if let Some(difference) = differ(&wanted, &found) {
            return Some(format!("uniforms: {difference}"));
        }
    }
    let wanted: BTreeSet<String> = stage_file
        .textures
        .iter()
        .filter(|t| t.sampler.is_some())
        .map(|t| t.name.clone())
        .collect();
    for sampler in &read.samplers {
        let mut all = stage_file.textures.iter();
        let unit = all.find(|t| t.name == sampler.path).map(|t| t.unit);
        if let Some(unit) = unit
            && let Some(wrong) = number(read, sampler.texture, unit, &sampler.path)
        {
            return Some(wrong);
        }
    }
    let found = read.samplers.iter().map(|s| s.path.clone()).collect();
    let lost = wanted.difference(&found).next()?;
    Some(format!("the sampler `{lost}` is lost"))
}

/// Compares a number in the text with `plan.json`.
fn number(
    read: &Declared,
    at: naga::ResourceBinding,
    told: Option<u32>,
    name: &str,
) -> Option<String> {
    let found = read.numbers.iter().find(|n| n.binding == at);
    let found = found.map(|n| n.number);
    let word = |n: Option<u32>| n.map_or("no number".to_owned(), |n| format!("the number {n}"));
    (found != told).then(|| format!("`{name}` has {}, not {}", word(found), word(told)))
}

/// One line per leaf of a type, without struct names or member order.
fn type_lines(ty: &Declares, path: &str, out: &mut BTreeSet<String>) {
    match ty {
        Declares::Plain(name) => {
            out.insert(format!("{name} {path}"));
        }
        // ES has no one-dimensional textures.
        Declares::Sampler(name) => {
            out.insert(format!("{} {path}", name.replace("sampler1D", "sampler2D")));
        }
        Declares::Array(of, n) => type_lines(of, &format!("{path}[{n}]"), out),
        Declares::Struct(_, members) => {
            for member in members {
                type_lines(&member.ty, &format!("{path}.{}", member.name), out);
            }
        }
    }
}

/// Compares the offset of every number in blocks.
fn blocks(
    authored: &Authored,
    stage_file: &StageFile,
    read: &Module,
    declared: &Declared,
    stage: ShaderStage,
    entry: &str,
) -> Option<String> {
    let module = authored.program.module();
    let used = authored.program.entry_point(stage, entry);
    let used = used.map(|(index, _)| authored.program.info().get_entry_point(index));
    for block in &stage_file.blocks {
        let Some(found) = declared.blocks.iter().find(|b| b.name == block.block) else {
            return Some(format!("the block `{}` is lost", block.block));
        };
        if let Some(wrong) = number(declared, found.binding, block.slot, &block.block) {
            return Some(wrong);
        }
        let is_at = |global: &GlobalVariable, at: [u32; 2]| {
            let binding = global.binding.as_ref();
            binding.is_some_and(|b| [b.group, b.binding] == at)
        };
        let in_block = |g: &GlobalVariable| {
            let is = matches!(
                g.space,
                AddressSpace::Uniform | AddressSpace::Storage { .. }
            );
            is.then_some(g.ty)
        };
        // Another stage may have another variable at that binding.
        let mut own = module
            .global_variables
            .iter()
            .filter(|(handle, _)| used.is_none_or(|used| !used[*handle].is_empty()));
        let own = own.find(|(_, g)| is_at(g, block.binding));
        let Some(wanted) = own.and_then(|(_, g)| in_block(g)) else {
            continue;
        };
        // An unused block is optional.
        let at = [found.binding.group, found.binding.binding];
        let mut own = read.global_variables.iter().map(|(_, g)| g);
        let Some(mut found) = own.find(|g| is_at(g, at)).and_then(in_block) else {
            continue;
        };
        let mut rest = String::new();
        // A block of one variable, if the program has that variable.
        let stage_file = authored.blocks.values();
        let opened = stage_file.into_iter().find(|b| b.name == block.block);
        let opened = opened.is_some_and(|b| b.opened || b.of.is_some());
        if !opened
            && let TypeInner::Struct { members, .. } = &read.types[found].inner
            && let Some(member) = members.first()
        {
            found = member.ty;
            rest = format!(" of `{}`", block.block);
        }
        let (mut a, mut b) = (BTreeMap::new(), BTreeMap::new());
        let name = |mark: &str| match authored.words.get(mark) {
            Some(Word::Path(name)) => name.clone(),
            _ => mark.to_owned(),
        };
        offsets(module, wanted, 0, &block.block, &name, &mut a);
        offsets(read, found, 0, &block.block, &str::to_owned, &mut b);
        for (path, wanted) in a {
            match b.get(&path) {
                Some(found) if *found == wanted => {}
                Some(found) => return Some(format!("`{path}`{rest}, {wanted}, became {found}")),
                None => return Some(format!("`{path}`{rest} is lost")),
            }
        }
    }
    None
}

/// The path, offset and type of every number in a type.
fn offsets(
    module: &Module,
    ty: Handle<Type>,
    at: u32,
    path: &str,
    name: &dyn Fn(&str) -> String,
    out: &mut BTreeMap<String, String>,
) {
    match &module.types[ty].inner {
        TypeInner::Struct { members, .. } => {
            for member in members {
                let own = name(member.name.as_deref().unwrap_or_default());
                let path = format!("{path}.{own}");
                offsets(module, member.ty, at + member.offset, &path, name, out);
            }
        }
        TypeInner::Array { base, size, stride } => {
            let path = format!("{path}[{size:?} by {stride}]");
            offsets(module, *base, at, &path, name, out);
        }
        // Some matrices in structs are read as arrays of columns.
        TypeInner::Matrix {
            columns,
            rows,
            scalar,
        } => {
            let width = u32::from(scalar.width);
            let stride = width * if *rows as u32 == 2 { 2 } else { 4 };
            let path = format!("{path}[Constant({}) by {stride}]", *columns as u32);
            let column = format!("vec{}<f{}>", *rows as u32, 8 * width);
            out.insert(path, format!("{column} at {at}"));
        }
        _ => {
            let ty = interface::wgsl_type(module, ty);
            out.insert(path.to_owned(), format!("{ty} at {at}"));
        }
    }
}

/// The interface: location and index of a fragment output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outputs {
    Named,
    Numbered,
}

/// Compares the inputs and outputs of a stage.
fn interface(
    authored: &Authored,
    stage_file: &StageFile,
    read: &Module,
    declared: &Declared,
    (stage, entry): (ShaderStage, &str),
    told: Outputs,
) -> Option<String> {
    let module = authored.program.module();
    let (_, wanted) = authored.program.entry_point(stage, entry)?;
    let Some(found) = read.entry_points.first() else {
        return Some("it has no `main`".to_owned());
    };
    let (wanted, found) = (&wanted.function, &found.function);
    if stage == ShaderStage::Vertex {
        let wanted: BTreeSet<String> = stage_file
            .attributes
            .iter()
            .map(|a| a.name.clone())
            .collect();
        let names = declared.attributes.iter();
        let found: BTreeSet<String> = names.map(|a| a.declaration.name.clone()).collect();
        if let Some(difference) = differ(&wanted, &found) {
            return Some(format!("attributes: {difference}"));
        }
    }
    let number = |io: &Io| match io.binding {
        Some(Binding::Location { location, .. }) => location.to_string(),
        _ => String::new(),
    };
    let numbered =
        |outputs: bool| outputs && stage == ShaderStage::Fragment && told == Outputs::Numbered;
    let named = |io: &Io| stem(io.name.as_deref().unwrap_or_default());
    let written = |io: &Io, outputs: bool| {
        let Some(location) = author::naga_location(io) else {
            return String::new();
        };
        let side = match (stage, outputs) {
            (ShaderStage::Vertex, false) => "p2vs",
            (ShaderStage::Vertex, true) | (_, false) => "vs2fs",
            _ => "fs2p",
        };
        match authored.words.get(&format!("_{side}_location{location}")) {
            Some(Word::Path(path)) => stem(&path.replace(['[', ']'], "_")),
            _ => String::new(),
        }
    };
    let line = |module: &Module, io: &Io, name: String, travels: bool| {
        let varying = Varying::of(module, io)?;
        let how = varying.interpolation;
        let how = match (travels, how.starts_with("flat")) {
            (false, _) => String::new(),
            (_, true) => "flat".to_owned(),
            _ => how,
        };
        // Missing components of a target were added.
        let ty = match stage == ShaderStage::Fragment && !travels {
            true => module.types[io.ty]
                .inner
                .scalar_kind()
                .map(|k| format!("{k:?}")),
            false => Some(varying.ty),
        };
        Some(format!("{} {name} {how}", ty.unwrap_or_default()))
    };
    for outputs in [false, true] {
        let of = |module: &Module, f: &Function| match outputs {
            true => interface::outputs(module, f),
            false => interface::inputs(module, f),
        };
        let travels = outputs == (stage == ShaderStage::Vertex);
        let wanted: BTreeSet<String> = of(module, wanted)
            .iter()
            .filter_map(|io| match numbered(outputs) {
                true => line(module, io, number(io), travels),
                false => line(module, io, written(io, outputs), travels),
            })
            .collect();
        let found: BTreeSet<String> = of(read, found)
            .iter()
            .filter_map(|io| match numbered(outputs) {
                true => line(read, io, number(io), travels),
                false => line(read, io, named(io), travels),
            })
            .collect();
        // Unused inputs are optional.
        if let Some(extra) = found.difference(&wanted).next() {
            return Some(format!("`{extra}` is new"));
        }
        if outputs && let Some(lost) = wanted.difference(&found).next() {
            return Some(format!("`{lost}` is lost"));
        }
    }
    None
}

/// The name without a trailing number: a matrix or array is one name in the text and several
/// variables in the module.
fn stem(name: &str) -> String {
    let stem = name.strip_suffix("_rgba").unwrap_or(name);
    stem.trim_end_matches(|c: char| c.is_ascii_digit() || c == '_')
        .to_owned()
}
