//! Rewrites naga's GLSL with the author's names, token by token.
//!
//! naga's global declarations have few forms. Any other form is an error.

use std::collections::{HashMap, HashSet};
use std::ops::Range;

use naga::ShaderStage;
use naga_edit::declared::{Chosen, Type as Declares};

use super::author::{Authored, LocatedName, SamplerMember, SamplerMemberType, Word};
use super::layout;
use preshade_plan::plan_file::{GlslAttribute, GlslUniform, StageFile};
use shader_text::tokens as text;
use shader_text::tokens::TokenKind;

/// The GLSL dialect to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dialect {
    Desktop,
    Es,
}

/// A form of naga's text that we do not expect.
pub(super) struct Unexpected(pub String);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TextItem<'a> {
    /// `#version`, `#extension`, `precision`.
    Head(&'a str),
    Struct(&'a str),
    Function(&'a str),
    /// Any other declaration up to its semicolon.
    Declaration(&'a str),
}

/// Rewrites the text of `stage`, and renames `stage_file`.
pub(super) fn named(
    authored: &Authored,
    naga: &str,
    stage: ShaderStage,
    dialect: Dialect,
    mut stage_file: StageFile,
) -> Result<(String, StageFile), Unexpected> {
    let constructed = match authored.paddings.is_empty() {
        true => naga.to_owned(),
        false => layout::padded_constructors(naga, &authored.paddings),
    };
    let items = items(&constructed)?;
    let mut structs: HashMap<&str, String> = HashMap::new();
    for item in &items {
        if let TextItem::Struct(text) = item
            && let Some(mark) = words(text).nth(1)
        {
            let text = match authored.paddings.get(mark) {
                Some(floats) => layout::padded_struct(text, floats)?,
                None => (*text).to_owned(),
            };
            structs.insert(mark, text);
        }
    }
    let rewrite = NameRewrite {
        authored,
        collisions: collisions(authored, &items, stage),
    };
    let textures = stage_file.textures.clone();
    let paths: HashSet<&str> = textures.iter().map(|t| t.name.as_str()).collect();
    let mut out = Parts {
        used: HashSet::new(),
        ..Parts::default()
    };
    for item in &items {
        match item {
            TextItem::Head(text) => {
                out.head.push_str(text.trim_end());
                out.head.push('\n');
            }
            TextItem::Struct(_) => {}
            TextItem::Function(text) => {
                out.note_types(text);
                out.functions.push(rewrite.function(text));
            }
            TextItem::Declaration(text) => {
                declaration(&rewrite, text, stage, &structs, &paths, &mut out)?
            }
        }
    }
    uniforms(authored, dialect, &mut out, &paths, &mut stage_file);
    for texture in &mut stage_file.textures {
        if let Some(Word::Path(path)) = authored.words.get(&texture.name) {
            // An array has a single binding, from which its elements count.
            if path.contains(['.', '[']) {
                let root = path.split('[').next().unwrap_or_default();
                let mut all = authored.uniforms.iter();
                let whole = all.find(|u| u.name == root && dialect == Dialect::Desktop);
                let given = whole.is_some_and(|u| u.unit.is_some());
                texture.unit = texture.unit.filter(|_| given);
            }
            texture.name = path.clone();
        }
    }
    stage_file.textures.sort_by(|a, b| a.name.cmp(&b.name));
    for block in &mut stage_file.blocks {
        if let Some(name) = out.renamed_blocks.get(&block.block) {
            block.block = name.clone();
        }
    }
    stage_file.attributes = std::mem::take(&mut out.attributes);
    Ok((out.text(&rewrite, &items, &structs, dialect), stage_file))
}

/// The parts of the new text.
#[derive(Default)]
struct Parts {
    head: String,
    uniforms: Vec<String>,
    declarations: Vec<String>,
    functions: Vec<String>,
    /// Markers of the types in use.
    used: HashSet<String>,
    /// Structs in use that naga does not write, except for nested ones.
    own_structs: HashSet<String>,
    /// Type and dimensions that naga wrote for each loose uniform.
    loose: HashMap<String, [String; 2]>,
    /// Type and line that naga wrote for each sampler, by path.
    samplers: HashMap<String, [String; 2]>,
    renamed_blocks: HashMap<String, String>,
    located: HashSet<String>,
    attributes: Vec<GlslAttribute>,
}

impl Parts {
    fn note_types(&mut self, text: &str) {
        self.used.extend(words(text).map(str::to_owned));
    }

    fn text(
        &self,
        rewrite: &NameRewrite<'_>,
        items: &[TextItem<'_>],
        structs: &HashMap<&str, String>,
        dialect: Dialect,
    ) -> String {
        // Structs contain structs, which naga writes first.
        let mut used = self.used.clone();
        for item in items.iter().rev() {
            if let TextItem::Struct(text) = item
                && words(text).nth(1).is_some_and(|n| used.contains(n))
            {
                used.extend(words(text).map(str::to_owned));
            }
        }
        // naga writes no struct if only its samplers are read.
        let unwritten = rewrite.authored.whole.iter();
        let mut unwritten: Vec<&(String, String)> = unwritten
            .filter(|(mark, _)| !structs.contains_key(mark.as_str()))
            .collect();
        for (mark, text) in unwritten.iter().rev() {
            if used.contains(mark) {
                used.extend(words(text).map(str::to_owned));
            }
        }
        unwritten.retain(|(mark, _)| used.contains(mark));
        let mut out = self.head.clone();
        out.push('\n');
        let mut own = self.own_structs.clone();
        for (name, members) in rewrite.authored.structs.iter().rev() {
            if own.contains(name) {
                own.extend(members.iter().filter_map(SamplerMember::of_struct).cloned());
            }
        }
        for (name, members) in &rewrite.authored.structs {
            if own.contains(name) {
                out += &format!("struct {name} {{\n{}}};\n", member_lines(members, dialect));
            }
        }
        for item in items {
            let TextItem::Struct(text) = item else {
                continue;
            };
            let Some(mark) = words(text).nth(1).filter(|n| used.contains(*n)) else {
                continue;
            };
            out += &rewrite.with_samplers(
                mark,
                structs.get(mark).map_or(text, String::as_str),
                dialect,
            );
        }
        for (mark, text) in unwritten {
            out += &rewrite.with_samplers(mark, text, dialect);
        }
        for part in [&self.uniforms, &self.declarations] {
            for line in part {
                out += line.trim();
                out.push('\n');
            }
            if !part.is_empty() {
                out.push('\n');
            }
        }
        out += self
            .functions
            .iter()
            .map(|f| format!("{}\n", f.trim()))
            .collect::<Vec<_>>()
            .join("\n")
            .as_str();
        out
    }
}

fn member_lines(members: &[SamplerMember], dialect: Dialect) -> String {
    members
        .iter()
        .map(|m| {
            let ty = match &m.ty {
                SamplerMemberType::Sampler(ty) => sampler_type(ty, dialect),
                SamplerMemberType::Plain(name) | SamplerMemberType::Struct(name) => name.clone(),
            };
            format!("    {ty} {}{};\n", m.name, m.dimensions)
        })
        .collect()
}

/// Converts a sampler type to ES, with a precision where ES has no default.
fn sampler_type(ty: &str, dialect: Dialect) -> String {
    match dialect {
        Dialect::Desktop => ty.to_owned(),
        Dialect::Es => format!("highp {}", ty.replace("sampler1D", "sampler2D")),
    }
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text::tokens(text)
        .filter(|(kind, _)| *kind == TokenKind::Word)
        .map(|(_, range)| &text[range])
}

/// The text's parts in order.
fn items(naga: &str) -> Result<Vec<TextItem<'_>>, Unexpected> {
    let mut out = Vec::new();
    let mut rest = naga;
    loop {
        rest = rest.trim_start();
        if rest.is_empty() {
            return Ok(out);
        }
        if rest.starts_with('#') {
            let end = rest.find('\n').unwrap_or(rest.len());
            out.push(TextItem::Head(&rest[..end]));
            rest = &rest[end..];
            continue;
        }
        let first = words(rest).next().unwrap_or_default();
        let mut depth = 0u32;
        let mut end = None;
        let mut function = false;
        for (_, range) in text::tokens(rest) {
            match &rest[range.clone()] {
                "{" | "(" => depth += 1,
                ")" => depth = depth.saturating_sub(1),
                "}" => {
                    depth = depth.saturating_sub(1);
                    let head = rest.find('{').map_or("", |at| &rest[..at]);
                    let is_block =
                        words(head).any(|w| matches!(w, "struct" | "uniform" | "buffer"));
                    if depth == 0 && !is_block {
                        function = true;
                        end = Some(range.end);
                        break;
                    }
                }
                ";" if depth == 0 => {
                    end = Some(range.end);
                    break;
                }
                _ => {}
            }
        }
        let end = end.ok_or_else(|| Unexpected("the end of the text".to_owned()))?;
        let (item, after) = rest.split_at(end);
        rest = after;
        out.push(match (first, function) {
            (_, true) => TextItem::Function(item),
            ("precision", _) => TextItem::Head(item),
            ("struct", _) => TextItem::Struct(item),
            _ => TextItem::Declaration(item),
        });
    }
}

/// New names for naga's names that collide with the author's.
fn collisions(
    authored: &Authored,
    items: &[TextItem<'_>],
    stage: ShaderStage,
) -> HashMap<String, String> {
    let mut all: HashSet<&str> = HashSet::new();
    for item in items {
        if let TextItem::Head(_) = item {
            continue;
        }
        let (TextItem::Head(text)
        | TextItem::Struct(text)
        | TextItem::Function(text)
        | TextItem::Declaration(text)) = *item;
        all.extend(free(text).map(|range| &text[range]));
    }
    let mut out: HashMap<String, String> = HashMap::new();
    let taken = |name: &str| authored.taken.is_taken(stage, name);
    // naga calls a second `gl` `gl_1`, which GLSL reserves.
    let is_number = |w: &str| w.bytes().all(|b| b.is_ascii_digit() || b == b'_');
    let is_own = |w: &str| w.strip_prefix("gl_").is_some_and(is_number);
    let mut colliding: Vec<&str> = all
        .iter()
        .copied()
        .filter(|w| (taken(w) || is_own(w)) && !authored.words.contains_key(*w))
        .collect();
    colliding.sort_unstable();
    for word in colliding {
        let stem = word.trim_end_matches('_');
        let stem = match is_own(word) {
            true => "own_gl",
            false => stem,
        };
        let new = (1..).map(|i| format!("{stem}_{i}"));
        let mut new = new.filter(|n| !taken(n) && !all.contains(n.as_str()));
        if let Some(new) = new.find(|n| !out.values().any(|o| o == n)) {
            out.insert(word.to_owned(), new);
        }
    }
    out
}

/// Words that are neither members nor inside of `layout(..)`.
fn free(text: &str) -> impl Iterator<Item = Range<usize>> + '_ {
    let mut before = "";
    let mut layout = 0u32;
    text::tokens(text).filter_map(move |(kind, range)| {
        let word = &text[range.clone()];
        let member = before == ".";
        match (layout, word) {
            (0, "(") if before == "layout" => layout = 1,
            (1.., "(") => layout += 1,
            (1.., ")") => layout -= 1,
            _ => {}
        }
        before = word;
        (kind == TokenKind::Word && !member && layout == 0).then_some(range)
    })
}

struct NameRewrite<'a> {
    authored: &'a Authored,
    collisions: HashMap<String, String>,
}

impl NameRewrite<'_> {
    /// Adds sampler members to a struct.
    fn with_samplers(&self, mark: &str, text: &str, dialect: Dialect) -> String {
        let mut written = self.plain(text);
        if let Some(members) = self.authored.members.get(mark)
            && let Some(at) = written.rfind('}')
        {
            written.insert_str(at, &member_lines(members, dialect));
        }
        format!("{}\n", written.trim())
    }

    fn plain(&self, text: &str) -> String {
        self.with(text, &HashMap::new())
    }

    /// Replaces every word; `own` has this function's replacements.
    fn with(&self, text: &str, own: &HashMap<&str, &str>) -> String {
        let free: HashSet<usize> = free(text).map(|r| r.start).collect();
        let mut out = String::with_capacity(text.len());
        let mut copied = 0;
        let mut drop_dot = false;
        for (kind, range) in text::tokens(text) {
            let word = &text[range.clone()];
            if drop_dot && word == "." {
                out.push_str(&text[copied..range.start]);
                copied = range.end;
            }
            drop_dot = false;
            if kind != TokenKind::Word {
                continue;
            }
            let is_free = free.contains(&range.start);
            let word = match own.get(word) {
                Some(other) if is_free => other,
                _ => word,
            };
            let new = match self.authored.words.get(word) {
                Some(Word::Path(path)) => Some(path.as_str()),
                Some(Word::Nothing) => {
                    drop_dot = true;
                    Some("")
                }
                None if is_free => self.collisions.get(word).map(String::as_str),
                None => None,
            };
            if let Some(new) = new {
                out.push_str(&text[copied..range.start]);
                out.push_str(new);
                copied = range.end;
            }
        }
        out.push_str(&text[copied..]);
        out
    }

    /// Rewrites a function. In `main`, reads inputs directly instead of naga's copies.
    fn function(&self, text: &str) -> String {
        let tokens: Vec<Range<usize>> = text::tokens(text).map(|(_, range)| range).collect();
        let word = |i: usize| tokens.get(i).map_or("", |r| &text[r.clone()]);
        if (word(0), word(1)) != ("void", "main") {
            return self.plain(text);
        }
        let Some(mut at) = tokens.iter().position(|r| &text[r.clone()] == "{") else {
            return self.plain(text);
        };
        let begin = tokens[at].end;
        let mut own = HashMap::new();
        let mut end = begin;
        while word(at + 3) == "=" && word(at + 5) == ";" && is_input(word(at + 4)) {
            own.insert(word(at + 2), word(at + 4));
            at += 5;
            end = tokens[at].end;
        }
        let without = format!("{}{}", &text[..begin], &text[end..]);
        // The names borrow from the old text.
        self.with(&without, &own)
    }
}

/// Whether naga's name is that of a stage input.
fn is_input(word: &str) -> bool {
    word.starts_with("_p2vs_location") || word.starts_with("_vs2fs_location")
}

fn declaration(
    rewrite: &NameRewrite<'_>,
    text: &str,
    stage: ShaderStage,
    structs: &HashMap<&str, String>,
    textures: &HashSet<&str>,
    out: &mut Parts,
) -> Result<(), Unexpected> {
    let authored = rewrite.authored;
    let free: Vec<&str> = free(text).map(|range| &text[range]).collect();
    // A loose uniform, which naga declares as a variable.
    if let Some(uniform) = authored
        .uniforms
        .iter()
        .filter_map(|u| u.mark.as_deref())
        .find(|mark| free.contains(mark))
    {
        let declared = text.split('=').next().unwrap_or(text).trim_end_matches(';');
        let (ty, dimensions) = declared
            .split_once(uniform)
            .ok_or_else(|| Unexpected(format!("`{text}`")))?;
        out.note_types(ty);
        let ty = rewrite.plain(ty.trim());
        let dimensions = dimensions.trim().to_owned();
        out.loose.insert(uniform.to_owned(), [ty, dimensions]);
        return Ok(());
    }
    // A block.
    if let Some(variable) = free.iter().find(|w| authored.blocks.contains_key(**w)) {
        let block = &authored.blocks[*variable];
        let open = text
            .find('{')
            .ok_or_else(|| Unexpected(format!("`{text}`")))?;
        let head = &text[..open];
        let old = words(head).last().unwrap_or_default();
        out.renamed_blocks
            .insert(old.to_owned(), block.name.clone());
        let head = head.trim_end().trim_end_matches(old);
        let head = &match block.std140 {
            true => head.replacen("std430", "std140", 1),
            false => head.to_owned(),
        };
        let inner = free.iter().rev().nth(1).and_then(|ty| structs.get(ty));
        let line = match inner {
            Some(of) if block.opened => {
                let members = &of[of.find('{').unwrap_or(0)..];
                let members = members.trim_end_matches(';').trim_end();
                out.note_types(members);
                let instance = block.instance.as_deref().unwrap_or_default();
                let gap = if instance.is_empty() { "" } else { " " };
                format!(
                    "{head}{} {}{gap}{instance};",
                    block.name,
                    rewrite.plain(members)
                )
            }
            _ => {
                out.note_types(text);
                let of = block.of.as_ref().and_then(|of| authored.paddings.get(of));
                let rest = match of {
                    Some(floats) => layout::padded_struct(&text[open..], floats)?,
                    None => text[open..].to_owned(),
                };
                format!("{head}{} {}", block.name, rewrite.plain(&rest))
            }
        };
        out.declarations.push(line);
        return Ok(());
    }
    // A texture: part of a uniform, or separate.
    if let Some(texture) = free.iter().find(|w| textures.contains(**w))
        && let Some(Word::Path(path)) = authored.words.get(*texture)
    {
        let after = text
            .find("uniform ")
            .map_or("", |at| &text[at + "uniform ".len()..]);
        let ty = after
            .split(texture)
            .next()
            .unwrap_or_default()
            .trim()
            .to_owned();
        let line = rewrite.plain(text);
        out.samplers.insert(path.clone(), [ty, line]);
        return Ok(());
    }
    // An input or output with a location.
    if let Some(name) = free.iter().find(|w| authored.located.contains_key(**w)) {
        located(rewrite, text, &authored.located[*name], stage, out);
        return Ok(());
    }
    out.note_types(text);
    out.declarations.push(rewrite.plain(text));
    Ok(())
}

/// A vertex input or fragment output.
fn located(
    rewrite: &NameRewrite<'_>,
    text: &str,
    input: &LocatedName,
    stage: ShaderStage,
    out: &mut Parts,
) {
    if !out.located.insert(input.name.clone()) {
        return;
    }
    let vertex = stage == ShaderStage::Vertex;
    let LocatedName {
        name,
        location,
        chosen,
        whole,
    } = input;
    let given = !vertex || *chosen == Chosen::ByAuthor;
    if vertex {
        out.attributes.push(GlslAttribute {
            name: name.clone(),
            location: *location,
            explicit: given,
        });
    }
    let layout = match given {
        true => format!("layout(location = {location}) "),
        false => String::new(),
    };
    let line = match whole {
        Some((ty, dimensions)) => {
            let word = if vertex { "in" } else { "out" };
            format!("{layout}{word} {ty} {name}{dimensions};")
        }
        None if given => rewrite.plain(text),
        None => {
            let rest = text.find(')').map_or(text, |at| &text[at + 1..]);
            rewrite.plain(rest)
        }
    };
    out.declarations.push(line);
}

/// Declares the uniforms outside of blocks, in the author's order.
fn uniforms(
    authored: &Authored,
    dialect: Dialect,
    out: &mut Parts,
    textures: &HashSet<&str>,
    stage_file: &mut StageFile,
) {
    let paths: Vec<String> = textures
        .iter()
        .filter_map(|t| match authored.words.get(*t) {
            Some(Word::Path(path)) => Some(path.clone()),
            _ => None,
        })
        .collect();
    let mut own: HashSet<&str> = HashSet::new();
    let mut lines = Vec::new();
    for uniform in &authored.uniforms {
        let name = uniform.name.as_str();
        let part = |path: &String| {
            path.strip_prefix(name)
                .is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '[']))
        };
        let sampled: Vec<&String> = paths.iter().filter(|p| part(p)).collect();
        own.extend(sampled.iter().map(|p| p.as_str()));
        let read = uniform.mark.as_ref().and_then(|mark| out.loose.get(mark));
        let explicit = dialect == Dialect::Desktop;
        let location = uniform.location.filter(|_| explicit);
        let layout = layout_of(location, uniform.unit.filter(|_| explicit));
        if let Some([ty, dimensions]) = read {
            lines.push(format!("{layout}uniform {ty} {name}{dimensions};"));
        } else if sampled.is_empty() {
            continue;
        } else if let Some(of) = &uniform.of_samplers {
            out.own_structs.insert(of.clone());
            lines.push(format!(
                "{layout}uniform {of} {name}{};",
                uniform.declares.dimensions()
            ));
        } else if let Declares::Sampler(_) = uniform.declares {
            let line = out.samplers.get(name).map(|[_, line]| match location {
                Some(n) => line.replacen("layout(", &format!("layout(location = {n}, "), 1),
                None => line.clone(),
            });
            lines.extend(line);
        } else if let Declares::Sampler(declared) = uniform.declares.innermost() {
            let of = sampled.first().and_then(|p| out.samplers.get(*p));
            let ty = of.map_or_else(|| sampler_type(declared, dialect), |[ty, _]| ty.clone());
            lines.push(format!(
                "{layout}uniform {ty} {name}{};",
                uniform.declares.dimensions()
            ));
        } else if let Some(of) = &uniform.of
            && let Some(Word::Path(ty)) = authored.words.get(of)
        {
            // Declared although only its samplers are read.
            out.used.insert(of.clone());
            lines.push(format!(
                "{layout}uniform {ty} {name}{};",
                uniform.declares.dimensions()
            ));
        }
        if read.is_some()
            && let Some(binding) = uniform.binding
        {
            stage_file.uniforms.push(GlslUniform {
                name: name.to_owned(),
                binding,
                offset: uniform.offset,
                location,
                previous_of: uniform.previous_of.clone(),
            });
        }
        if uniform.mark.is_some() && uniform.declares.has_samplers() {
            needed_structs(authored, out);
        }
    }
    let mut others: Vec<&String> = paths.iter().filter(|p| !own.contains(p.as_str())).collect();
    others.sort();
    let others: Vec<String> = others
        .into_iter()
        .filter_map(|p| out.samplers.get(p).map(|[_, line]| line.clone()))
        .collect();
    out.uniforms = lines;
    out.uniforms.extend(others);
}

/// `layout(..)` and a space, or nothing.
fn layout_of(location: Option<u32>, binding: Option<u32>) -> String {
    let of = |word: &str, n: Option<u32>| n.map(|n| format!("{word} = {n}"));
    let stage_file = [of("location", location), of("binding", binding)];
    match stage_file.into_iter().flatten().collect::<Vec<_>>()[..] {
        [] => String::new(),
        ref stage_file => format!("layout({}) ", stage_file.join(", ")),
    }
}

/// Adds structs nested in those that naga writes.
fn needed_structs(authored: &Authored, out: &mut Parts) {
    let members = authored.members.values().flatten();
    out.own_structs
        .extend(members.filter_map(SamplerMember::of_struct).cloned());
}
