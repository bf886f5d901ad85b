//! Turns a text for OpenGL into one for Vulkan (GLSL 4.60, GL_KHR_vulkan_glsl): sets, push
//! constants, specialisation constants, separate textures and samplers.

use std::collections::{BTreeMap, HashMap, HashSet};

use naga::{Handle, Module, ResourceBinding, ShaderStage, Type, TypeInner};
use naga_edit::declared::{self, Chosen, CombinedSampler};
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;

use super::separate_textures::{self, Separate};
use super::text::Unexpected;
use crate::emit::combined::{BindingPlace, CombinedSamplers, element};
use crate::emit::overrides::{SpecIds, Variable};
use preshade_plan::plan_file::StageFile;
use shader_text::tokens as text;
use shader_text::tokens::TokenKind;

/// The resources that all stages of a program share.
pub(in crate::emit) struct Vulkan {
    /// The program with its loose uniforms in a block: Vulkan has no other uniforms. The author's
    /// numbers are in `pairs`.
    pub(in crate::emit) program: Program,
    pub(super) pairs: CombinedSamplers,
    pub(super) ids: SpecIds,
}

impl Vulkan {
    /// For `program`, a program of `plan`.
    pub(in crate::emit) fn of(plan: &Plan, program: &Program) -> Self {
        let mut declared = program.declared().clone();
        declared.loose = None;
        declared.previous = None;
        declared.host = None;
        // Nor does a host query locations by names.
        for attribute in &mut declared.attributes {
            attribute.chosen = Chosen::ByAuthor;
        }
        // Nor has it structs of samplers. Samplers outside of numbered arrays are declared one by
        // one.
        let module = program.module();
        let numbers = program.declared().numbers.iter();
        let numbered: HashSet<_> = numbers.map(|n| n.binding).collect();
        for i in 0..declared.samplers.len() {
            let CombinedSampler { path, texture, .. } = &declared.samplers[i];
            let is_element = element(&declared, path).is_some() && numbered.contains(texture);
            if path.contains(['.', '[']) && !is_element {
                let flat = path.replace(']', "").replace(['.', '['], "_");
                declared.samplers[i].path = free(module, &declared.samplers, (*texture, flat));
            }
        }
        let paths = declared.samplers.iter().map(|s| s.path.as_str());
        let roots: HashSet<&str> = paths.filter_map(|p| p.split('[').next()).collect();
        declared
            .uniforms
            .retain(|u| roots.contains(u.name.as_str()));
        // The places come from the author's numbers, which the text must not have a second time.
        let with_numbers = program.clone().with_declared(declared.clone());
        let pairs = CombinedSamplers::of(plan, &with_numbers);
        declared.numbers.clear();
        Self {
            program: program.clone().with_declared(declared),
            pairs,
            ids: SpecIds::of(plan),
        }
    }
}

/// The name, or a longer one that nothing but this texture has.
fn free(
    module: &Module,
    samplers: &[CombinedSampler],
    (texture, mut name): (ResourceBinding, String),
) -> String {
    let globals = module.global_variables.iter().map(|(_, g)| g);
    let others = globals.filter(|g| g.binding != Some(texture));
    let mut taken: HashSet<&str> = others.filter_map(|g| g.name.as_deref()).collect();
    taken.extend(
        module
            .functions
            .iter()
            .filter_map(|(_, f)| f.name.as_deref()),
    );
    taken.extend(module.types.iter().filter_map(|(_, t)| t.name.as_deref()));
    taken.extend(samplers.iter().map(|s| s.path.as_str()));
    while taken.contains(name.as_str()) {
        name.push_str("_x");
    }
    name
}

/// The inputs for the text of a stage.
pub(super) struct Resources<'a> {
    pub(super) module: &'a Module,
    pub(super) pairs: &'a CombinedSamplers,
    /// Name and type of the stage's immediate data.
    pub(super) immediate: Option<(&'a str, Handle<Type>)>,
    pub(super) variables: &'a [Variable],
    /// The plan's binding of each `layout(binding = ..)`.
    pub(super) numbers: &'a BTreeMap<u32, BindingPlace>,
    /// The author's `discard` demotes to a helper invocation.
    pub(super) demotes: bool,
}

/// Rewrites `text`, and the numbers of `stage_file`.
pub(super) fn rewritten(
    text: &str,
    stage: ShaderStage,
    stage_file: &mut StageFile,
    resources: &Resources<'_>,
) -> Result<String, Unexpected> {
    let mut text = indices(text, stage);
    if resources.demotes {
        text = demoting(&text);
    }
    for variable in resources.variables {
        text = constant(&text, variable)?;
    }
    if let Some((name, ty)) = resources.immediate {
        text = push_constants(&text, name, &resources.module.types[ty].inner)?;
    }
    textures(&text, stage_file, resources)
}

/// The words of a text, as ranges.
fn words(text: &str) -> impl Iterator<Item = (&str, std::ops::Range<usize>)> {
    text::tokens(text)
        .filter(|(kind, _)| *kind == TokenKind::Word)
        .map(|(_, range)| (&text[range.clone()], range))
}

fn replaced(text: &str, with: &HashMap<&str, String>) -> String {
    let mut out = String::with_capacity(text.len());
    let mut copied = 0;
    for (word, range) in words(text) {
        if let Some(new) = with.get(word) {
            out += &text[copied..range.start];
            out += new;
            copied = range.end;
        }
    }
    out + &text[copied..]
}

/// Demotes instead of discarding (GL_EXT_demote_to_helper_invocation).
fn demoting(text: &str) -> String {
    let with = HashMap::from([("discard", "demote".to_owned())]);
    let text = match text.split_once('\n') {
        Some((version, rest)) if words(rest).any(|(word, _)| word == "discard") => {
            format!("{version}\n#extension GL_EXT_demote_to_helper_invocation : require\n{rest}")
        }
        _ => text.to_owned(),
    };
    replaced(&text, &with)
}

/// Vulkan's vertex and instance indices count from the draw's first, as those of WGSL do.
fn indices(text: &str, stage: ShaderStage) -> String {
    const FIRST: &str = "naga_vs_first_instance";
    if stage != ShaderStage::Vertex {
        return text.to_owned();
    }
    let lines = text.split_inclusive('\n');
    let text: String = lines
        .filter(|line| !(line.starts_with("uniform ") && line.contains(FIRST)))
        .collect();
    let text = text.replace(&format!(" + {FIRST}"), "");
    let with = [
        ("gl_VertexID", "gl_VertexIndex"),
        ("gl_InstanceID", "gl_InstanceIndex"),
    ];
    replaced(&text, &with.map(|(a, b)| (a, b.to_owned())).into())
}

/// Declares a specialisation constant in place of its variable.
fn constant(text: &str, variable: &Variable) -> Result<String, Unexpected> {
    let marker = variable.marker.as_str();
    let unexpected = || Unexpected(format!("the override `{}`", variable.constant.name));
    let of_global = |line: &&str| {
        !line.starts_with(char::is_whitespace)
            && words(line).nth(1).is_some_and(|(w, _)| w == marker)
    };
    let line = text.lines().find(of_global).ok_or_else(unexpected)?;
    let id = variable.constant.id;
    let text = text.replacen(line, &format!("layout(constant_id = {id}) const {line}"), 1);
    let taken: HashSet<&str> = words(&text).map(|(word, _)| word).collect();
    let mut name = variable.constant.name.clone();
    while taken.contains(name.as_str()) || super::reserved_words::is_reserved(&name) {
        name.push_str("_x");
    }
    Ok(replaced(&text, &HashMap::from([(marker, name)])))
}

/// Declares the uniform of immediate data as a block with the members' offsets.
fn push_constants(text: &str, instance: &str, ty: &TypeInner) -> Result<String, Unexpected> {
    let of = |line: &str| match words(line).map(|(word, _)| word).collect::<Vec<_>>()[..] {
        ["uniform", of, name] if name == instance => Some(of.to_owned()),
        _ => None,
    };
    let mut lines = text.lines().filter_map(|line| Some((line, of(line)?)));
    let (line, of) = lines
        .next()
        .ok_or_else(|| Unexpected("the immediate data".to_owned()))?;
    // If both stages have a block of this name, the second has a number behind it.
    let authors = of.trim_end_matches(|c: char| c.is_ascii_digit());
    let authors = [&of, authors.strip_suffix('_').unwrap_or(&of)];
    let head = format!("struct {of} {{\n");
    let body = text
        .split_once(&head)
        .and_then(|(_, rest)| rest.split_once("};"));
    let opened = match (ty, body) {
        (TypeInner::Struct { members, .. }, Some((body, _))) => {
            let lines: Vec<&str> = body.lines().collect();
            let offsets = lines.iter().zip(members).map(|(line, member)| {
                let own = words(line).last().map(|(word, _)| word);
                match own.is_some_and(|own| authors.iter().any(|a| declared::is_padding(a, own))) {
                    true => String::new(),
                    false => format!("    layout(offset = {}) {}\n", member.offset, line.trim()),
                }
            });
            (lines.len() == members.len()).then(|| offsets.collect::<String>())
        }
        _ => None,
    };
    // A block is no value: one that is read as a whole keeps its struct.
    let mut tokens = text::tokens(text).map(|(_, range)| &text[range]).peekable();
    let mut whole = 0;
    while let Some(token) = tokens.next() {
        whole += usize::from(token == instance && tokens.peek() != Some(&"."));
    }
    let Some(members) = opened.filter(|_| whole == 1) else {
        let block = format!(
            "layout(push_constant, std430) uniform {of}Block {{\n    {of} {instance};\n}};"
        );
        return Ok(text.replacen(line, &block, 1));
    };
    let is_only_here = words(text).filter(|(word, _)| *word == of).count() == 2;
    let name = if is_only_here { "" } else { "Block" };
    let block =
        format!("layout(push_constant, std430) uniform {of}{name} {{\n{members}}} {instance};");
    let out = text.replacen(line, &block, 1);
    let declared = body
        .filter(|_| is_only_here)
        .map(|(body, _)| format!("{head}{body}}};\n"));
    Ok(declared.map_or(out.clone(), |declared| out.replacen(&declared, "", 1)))
}

/// Gives resources their sets. Splits textures and samplers that the author did not combine.
fn textures(
    text: &str,
    stage_file: &mut StageFile,
    resources: &Resources<'_>,
) -> Result<String, Unexpected> {
    let mut places: BTreeMap<u32, BindingPlace> = resources.numbers.clone();
    let mut apart: HashMap<String, (BindingPlace, Option<BindingPlace>)> = HashMap::new();
    for texture in &mut stage_file.textures {
        let place = texture.texture.into();
        let pair = resources.pairs.all.iter().find(|c| c.texture == place);
        let number = places.iter().find(|(_, p)| **p == place).map(|(n, _)| *n);
        match (pair, number) {
            (Some(pair), Some(number)) => {
                places.insert(number, pair.place);
                texture.unit = Some(pair.place.1);
            }
            _ => {
                let sampler = texture.sampler.map(BindingPlace::from);
                apart.insert(texture.name.clone(), (place, sampler));
            }
        }
    }
    stage_file.textures.retain(|t| !apart.contains_key(&t.name));
    for block in &mut stage_file.blocks {
        block.slot = Some(block.binding[1]);
    }
    let mut constructed: HashMap<String, Separate> = HashMap::new();
    let mut samplers: BTreeMap<BindingPlace, String> = BTreeMap::new();
    let mut fetched = false;
    let mut declarations = Vec::new();
    for line in text.lines() {
        let line = match line.strip_prefix("uniform ") {
            Some(rest) => {
                let name = words(rest).nth(1).map(|(word, _)| word).unwrap_or_default();
                let mut arrays = resources.pairs.all.iter().filter(|c| c.element.is_some());
                let (set, binding) = arrays
                    .find(|c| c.root() == name)
                    .map(|c| c.place)
                    .ok_or_else(|| Unexpected(format!("the uniform `{name}`")))?;
                format!("layout(set = {set}, binding = {binding}) {line}")
            }
            None => with_set(line, &places)?,
        };
        let declared = line
            .starts_with("layout(")
            .then(|| words(&line).last())
            .flatten();
        let name = declared.map(|(word, _)| word.to_owned());
        let Some((name, (_, sampler))) = name.as_ref().and_then(|n| apart.get_key_value(n)) else {
            declarations.push(line);
            continue;
        };
        let Some(at) = line.find("sampler") else {
            // A storage image.
            declarations.push(line);
            continue;
        };
        let ty = line[at..].split(' ').next().unwrap_or_default();
        let prefix = line[..at].rsplit(' ').next().unwrap_or_default();
        let [texture_type, sampler_type] = separate_textures::split(ty);
        declarations.push(format!("{}{texture_type} {name};", &line[..at]));
        let Some(sampler) = sampler else {
            fetched = true;
            continue;
        };
        let word = samplers.entry(*sampler).or_insert_with(|| {
            let word = format!("{name}_sampler");
            let (set, binding) = *sampler;
            declarations.push(format!(
                "layout(set = {set}, binding = {binding}) uniform {sampler_type} {word};"
            ));
            word
        });
        let separate = Separate {
            combined: format!("{prefix}{ty}"),
            texture: name.clone(),
            sampler: word.clone(),
        };
        constructed.insert(name.clone(), separate);
    }
    let whole: String = declarations.iter().map(|l| format!("{l}\n")).collect();
    let mut out = separate_textures::combined_at_use(&whole, &constructed).map_err(|name| {
        Unexpected(format!(
            "the combined sampler `{name}` passed to a function that takes a texture too"
        ))
    })?;
    if fetched {
        let extension = "#extension GL_EXT_samplerless_texture_functions : require\n";
        let at = out.find('\n').map_or(0, |at| at + 1);
        out.insert_str(at, extension);
    }
    Ok(out)
}

/// Replaces `binding = N` of a declaration by the set and binding.
fn with_set(line: &str, places: &BTreeMap<u32, BindingPlace>) -> Result<String, Unexpected> {
    const BINDING: &str = "binding = ";
    let Some(at) = line
        .starts_with("layout(")
        .then(|| line.find(BINDING))
        .flatten()
    else {
        return Ok(line.to_owned());
    };
    let (head, rest) = line.split_at(at);
    let rest = &rest[BINDING.len()..];
    let end = rest
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(rest.len());
    let (number, rest) = rest.split_at(end);
    let place = number.parse().ok().and_then(|n: u32| places.get(&n));
    let (set, binding) = place.ok_or_else(|| Unexpected(format!("`{line}`")))?;
    Ok(format!("{head}set = {set}, binding = {binding}{rest}"))
}
