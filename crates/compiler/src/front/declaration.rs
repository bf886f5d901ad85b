//! Finds a member, an argument or a varying in the author's text. naga's IR has spans only for
//! whole types and variables.
//!
//! This reads tokens of text that has already been parsed. If in doubt it finds nothing.

use std::ops::Range;

use naga::{ShaderStage, Span};
use naga_edit::interface::stage_name;
use shader_text::source::{SourceFile, SourceMap};

/// A word, a number or one sign. Comments and preprocessor lines are skipped.
#[derive(Clone, Copy)]
struct Token<'a> {
    text: &'a str,
    at: usize,
}

impl Token<'_> {
    fn end(self) -> usize {
        self.at + self.text.len()
    }
}

fn tokens(text: &str) -> Vec<Token<'_>> {
    let is_word = |c: char| c.is_alphanumeric() || matches!(c, '_' | '.');
    let mut out = Vec::new();
    let mut at = 0;
    while let Some(c) = text[at..].chars().next() {
        let rest = &text[at..];
        let to = |end: &str| rest.find(end).map_or(rest.len(), |i| i + end.len());
        at += match c {
            '/' if rest.starts_with("//") => to("\n"),
            '/' if rest.starts_with("/*") => to("*/"),
            '#' => to("\n"),
            c if c.is_whitespace() => c.len_utf8(),
            c => {
                let length = match is_word(c) {
                    true => rest.find(|c| !is_word(c)).unwrap_or(rest.len()),
                    false => c.len_utf8(),
                };
                out.push(Token {
                    text: &rest[..length],
                    at,
                });
                length
            }
        };
    }
    out
}

/// The declarations in a bracket, separated by commas or semicolons. `inside` begins after the
/// opening bracket.
fn declarations<'t, 'a>(inside: &'t [Token<'a>]) -> Vec<&'t [Token<'a>]> {
    let mut depth = 0_i32;
    let mut start = 0;
    let mut out = Vec::new();
    for (i, token) in inside.iter().enumerate() {
        match token.text {
            "(" | "[" | "{" | "<" => depth += 1,
            ")" | "]" | "}" | ">" if depth == 0 => {
                out.push(&inside[start..i]);
                return out;
            }
            ")" | "]" | "}" | ">" => depth -= 1,
            "," | ";" if depth == 0 => {
                out.push(&inside[start..i]);
                start = i + 1;
            }
            _ => {}
        }
    }
    out.push(&inside[start..]);
    out
}

fn range(declaration: &[Token<'_>]) -> Option<Range<usize>> {
    Some(declaration.first()?.at..declaration.last()?.end())
}

fn span(file: &SourceFile, offset: usize, range: Range<usize>) -> Span {
    let at = |i: usize| file.base + (offset + i) as u32;
    Span::new(at(range.start), at(range.end))
}

/// The member `name` of the struct or block declared at `of`.
pub(super) fn member(sources: &SourceMap, of: Span, name: &str) -> Option<Span> {
    let file = sources.file_of(of)?;
    let start = of.to_range()?.start - file.base as usize;
    // Some spans end at the name, so search for the next opening bracket.
    let tokens = tokens(file.text.get(start..)?);
    let open = tokens.iter().position(|t| matches!(t.text, "{" | ";"))?;
    let inside = tokens
        .get(open + 1..)
        .filter(|_| tokens[open].text == "{")?;
    declarations(inside)
        .into_iter()
        .find(|d| d.iter().any(|t| t.text == name))
        .and_then(range)
        .map(|r| span(file, start, r))
}

/// The span of an entry point's name in WGSL text, which naga's IR lacks. `None` for GLSL.
pub(super) fn entry_point(sources: &SourceMap, stage: ShaderStage, name: &str) -> Option<Span> {
    let attribute = format!("@{}", stage_name(stage));
    // Linking may have appended the stage.
    let authors = name.strip_suffix(&format!("_{}", stage_name(stage)));
    for name in [Some(name), authors].into_iter().flatten() {
        for file in sources.files() {
            for (at, _) in file.text.match_indices("fn ") {
                let rest = file.text[at + 3..].trim_start();
                let start = file.text.len() - rest.len();
                let is_name = rest
                    .strip_prefix(name)
                    .is_some_and(|r| r.trim_start().starts_with('('));
                // The function's attributes begin after the previous item.
                let before = &file.text[..at];
                let item = before.rfind(['}', ';']).map_or(before, |i| &before[i..]);
                if is_name && item.contains(&attribute) {
                    let start = file.base + start as u32;
                    return Some(Span::new(start, start + name.len() as u32));
                }
            }
        }
    }
    None
}

/// The input or output of an entry point at a location: an argument, a result, or a struct member.
pub(super) fn varying(
    sources: &SourceMap,
    stage: ShaderStage,
    entry_point: &str,
    direction: Direction,
    location: u32,
) -> Option<Span> {
    match self::entry_point(sources, stage, entry_point) {
        Some(name) => wgsl_varying(sources, name, direction, location),
        None => glsl_varying(sources, stage, direction, location),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Direction {
    In,
    Out,
}

fn wgsl_varying(
    sources: &SourceMap,
    entry_point: Span,
    direction: Direction,
    location: u32,
) -> Option<Span> {
    let file = sources.file_of(entry_point)?;
    let start = entry_point.to_range()?.end - file.base as usize;
    let signature = tokens(file.text.get(start..)?);
    let body = signature.iter().position(|t| t.text == "{")?;
    let signature = &signature[..body];
    let arrow = signature
        .windows(2)
        .position(|w| w[0].text == "-" && w[1].text == ">");
    let declared: Vec<&[Token<'_>]> = match direction {
        Direction::In => declarations(signature.get(1..arrow.unwrap_or(body))?),
        Direction::Out => vec![signature.get(arrow? + 2..)?],
    };
    let at = |d: &&[Token<'_>]| is_at(d, location);
    if let Some(found) = declared.iter().copied().find(at) {
        return range(found).map(|r| span(file, start, r));
    }
    let all = tokens(&file.text);
    let names = declared.iter().copied().flatten().map(|t| t.text);
    names
        .filter_map(|name| {
            let opens =
                |w: &[Token<'_>]| w[0].text == "struct" && w[1].text == name && w[2].text == "{";
            let open = all.windows(3).position(opens)?;
            declarations(&all[open + 3..]).into_iter().find(at)
        })
        .find_map(range)
        .map(|r| span(file, 0, r))
}

/// A GLSL file holds one stage, and its varyings are global.
fn glsl_varying(
    sources: &SourceMap,
    stage: ShaderStage,
    direction: Direction,
    location: u32,
) -> Option<Span> {
    let qualifier = match direction {
        Direction::In => "in",
        Direction::Out => "out",
    };
    sources.files().iter().find_map(|file| {
        let all = tokens(&file.text);
        let is_vertex = all.iter().any(|t| t.text == "gl_Position");
        if is_vertex != (stage == ShaderStage::Vertex) {
            return None;
        }
        all.split(|t| matches!(t.text, ";" | "}"))
            .find(|d| is_at(d, location) && d.iter().any(|t| t.text == qualifier))
            .and_then(range)
            .map(|r| span(file, 0, r))
    })
}

/// Whether a declaration has `@location(N)` or `location = N`.
fn is_at(declaration: &[Token<'_>], location: u32) -> bool {
    let number = |t: &Token<'_>| t.text.trim_end_matches(['u', 'i']).parse() == Ok(location);
    declaration
        .windows(3)
        .any(|w| w[0].text == "location" && matches!(w[1].text, "(" | "=") && number(&w[2]))
}
