//! What changes nothing, written into a shader's text as an author would: dead code behind an
//! opaque predicate, statements wrapped into branches and loops that run once, expressions split
//! and returned by name.
#![allow(dead_code, clippy::unwrap_used)]

use preshade_validate::inputs::Random;

/// Private variables: opaque to a transform, which does not know what ran before, and 0 and 1 all
/// the same.
const OPAQUE: &str = "
var<private> meta_zero: f32 = 0.0;
var<private> meta_one: i32 = 1;
var<private> meta_sink: f32;
";

/// A simple statement of a function's body, and where it begins and ends.
#[derive(Clone, Copy, Debug)]
pub struct Simple {
    start: usize,
    end: usize,
    /// It stands in a fragment entry point itself, where it may be discarded.
    in_fragment: bool,
}

/// The statements that end in a semicolon, outside of headers.
pub fn statements(text: &str) -> Vec<Simple> {
    let bytes = text.as_bytes();
    let mut found = Vec::new();
    let mut at = 0;
    // Whether each open brace holds statements, and whether the outermost is a fragment entry
    // point's.
    let mut braces: Vec<bool> = Vec::new();
    let (mut parens, mut start, mut in_fragment) = (0, 0, false);
    while at < bytes.len() {
        if text[at..].starts_with("//") {
            let line = text[at..].find('\n').unwrap_or(text.len() - at);
            at += line;
            // A comment ahead of a statement is not of it.
            if text[start..at].trim_start().starts_with("//") {
                start = at;
            }
            continue;
        }
        match bytes[at] {
            b'(' | b'[' => parens += 1,
            b')' | b']' => parens -= 1,
            b'{' => {
                let head = text[start..at].trim();
                if braces.is_empty() {
                    in_fragment = head.starts_with("@fragment");
                }
                let is_function = head.contains("fn ");
                let is_body = match braces.last() {
                    None => is_function,
                    Some(_) => !head.starts_with("switch"),
                };
                braces.push(is_body);
                start = at + 1;
            }
            b'}' => {
                braces.pop();
                start = at + 1;
            }
            b';' if parens == 0 => {
                let begin = start + (text[start..at].len() - text[start..at].trim_start().len());
                if braces.last() == Some(&true) {
                    found.push(Simple {
                        start: begin,
                        end: at + 1,
                        in_fragment,
                    });
                }
                start = at + 1;
            }
            _ => {}
        }
        at += 1;
    }
    found
}

/// What a statement may be written as instead.
pub fn injected(text: &str, statement: Simple, n: usize, random: &mut Random) -> String {
    let own = &text[statement.start..statement.end];
    let first = own.split(|c: char| !c.is_alphanumeric() && c != '_').next();
    let first = first.unwrap_or_default();
    let body = own.trim_end_matches(';');
    let dead = match random.below(if statement.in_fragment { 4 } else { 3 }) {
        0 => "meta_sink = sin(meta_sink + 1.0);".to_owned(),
        1 => format!("for (var meta_d{n} = 0; meta_d{n} < 3; meta_d{n}++) {{ meta_sink += 1.0; }}"),
        2 => "meta_one = 7; meta_zero = 9.0;".to_owned(),
        _ => "discard;".to_owned(),
    };
    let behind_opaque = format!("if meta_zero > 0.5 {{ {dead} }} {own}");
    if random.below(3) == 0 {
        return behind_opaque;
    }
    match first {
        "let" => {
            let (left, value) = body.split_once('=').unwrap();
            format!("let meta_s{n} = {value}; {left} = meta_s{n};")
        }
        "return" if body.len() > "return ".len() => {
            format!(
                "let meta_r{n} ={}; return meta_r{n};",
                &body["return".len()..]
            )
        }
        "var" | "const" | "return" | "discard" | "break" | "continue" | "const_assert" => {
            behind_opaque
        }
        _ => match random.below(4) {
            0 => format!("if meta_one == 1 {{ {own} }}"),
            1 => format!("for (var meta_i{n} = 0; meta_i{n} < meta_one; meta_i{n}++) {{ {own} }}"),
            2 => format!("loop {{ {own} if meta_one > 0 {{ break; }} }}"),
            _ => {
                format!("switch meta_one {{ case 1: {{ {own} }} default: {{ meta_sink = 3.0; }} }}")
            }
        },
    }
}

/// The shader with about as many injections.
pub fn injection(text: &str, seed: u64, count: usize) -> String {
    let mut random = Random::new(seed, "metamorphic");
    let all = statements(text);
    let mut out = String::new();
    let mut at = 0;
    for (n, statement) in all.iter().enumerate() {
        if random.below(all.len()) >= count {
            continue;
        }
        out.push_str(&text[at..statement.start]);
        out.push_str(&injected(text, *statement, n, &mut random));
        at = statement.end;
    }
    out.push_str(&text[at..]);
    out + OPAQUE
}
