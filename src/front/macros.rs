//! Refuses GLSL whose macros would expand without bound: thirty lines that each name the line before twice make a billion tokens, and the
//! preprocessor naga uses counts none of them.

use std::collections::HashMap;

use super::error::{Code, Error};

/// Most words a file may have once its macros are expanded.
const WORDS: u64 = 1 << 20;

#[derive(Clone, Copy)]
struct Macro<'a> {
    /// Most often a single parameter is named in the body; 0 without parameters.
    repeats: u64,
    body: &'a str,
}

/// Checks `text`, with the definitions the caller adds.
pub(super) fn check(text: &str, defines: &[(String, String)]) -> Result<(), Error> {
    // A definition may go over several lines.
    let joined = text.replace("\\\r\n", " ").replace("\\\n", " ");
    let mut macros: HashMap<&str, Macro<'_>> = HashMap::new();
    for (name, body) in defines {
        macros.insert(name, Macro { repeats: 0, body });
    }
    let mut code = String::new();
    for line in joined.lines() {
        let directive = line.trim_start().strip_prefix('#').map(str::trim_start);
        match directive.and_then(|d| d.strip_prefix("define ")) {
            Some(definition) => {
                let (name, found) = definition_of(definition.trim_start());
                macros.insert(name, found);
            }
            None => {
                code.push_str(line);
                code.push('\n');
            }
        }
    }
    if macros.is_empty() {
        return Ok(());
    }
    let mut sizes = HashMap::new();
    if size(&code, &macros, &mut sizes) > WORDS {
        return Err(Error::new(
            Code::TooDeep,
            format!("macros expand to more than {WORDS} words"),
        )
        .note("write functions in their place"));
    }
    Ok(())
}

/// `NAME body` or `NAME(a, b) body`.
fn definition_of(definition: &str) -> (&str, Macro<'_>) {
    let end = definition
        .find(|c: char| !(c.is_alphanumeric() || c == '_'))
        .unwrap_or(definition.len());
    let (name, rest) = definition.split_at(end);
    match rest.strip_prefix('(').and_then(|r| r.split_once(')')) {
        Some((parameters, body)) => {
            let uses = |p: &str| words(body).filter(|(w, _)| *w == p).count() as u64;
            let repeats = parameters.split(',').map(|p| uses(p.trim())).max();
            let repeats = repeats.unwrap_or(0).max(1);
            (name, Macro { repeats, body })
        }
        None => (
            name,
            Macro {
                repeats: 0,
                body: rest,
            },
        ),
    }
}

/// Words of `text` once expanded, or more.
fn size<'a>(
    text: &'a str,
    macros: &HashMap<&'a str, Macro<'a>>,
    sizes: &mut HashMap<&'a str, u64>,
) -> u64 {
    let mut total = 0u64;
    // How often what stands in each open bracket is repeated.
    let mut repeats = vec![1u64];
    let mut callee = 1u64;
    for (word, is_name) in words(text) {
        let here = repeats.last().copied().unwrap_or(1);
        match word {
            "(" => repeats.push(here.saturating_mul(callee)),
            ")" if repeats.len() > 1 => {
                repeats.pop();
            }
            _ => {}
        }
        callee = 1;
        let mut cost = 1;
        if is_name && let Some(found) = macros.get(word) {
            callee = found.repeats.max(1);
            cost = match sizes.get(word) {
                Some(known) => *known,
                None => {
                    // A macro does not expand within itself.
                    sizes.insert(word, 1);
                    let known = size(found.body, macros, sizes).max(1);
                    sizes.insert(word, known);
                    known
                }
            };
        }
        total = total.saturating_add(cost.saturating_mul(here));
    }
    total
}

/// Names, and each other character that is not a space, with whether it is a name.
fn words(text: &str) -> impl Iterator<Item = (&str, bool)> {
    let mut rest = text;
    std::iter::from_fn(move || {
        rest = rest.trim_start();
        let first = rest.chars().next()?;
        let in_name = |c: char| c.is_alphanumeric() || c == '_';
        let length = match in_name(first) {
            true => rest.find(|c| !in_name(c)).unwrap_or(rest.len()),
            false => first.len_utf8(),
        };
        let (word, after) = rest.split_at(length);
        rest = after;
        Some((word, in_name(first)))
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn ordinary_macros_pass() {
        let text = "#define PI 3.14\n#define SQUARE(x) ((x) * (x))\n#define A B\n#define B A\n#define LONG \\\n  1 + 2\n\
                    void main() { float x = SQUARE(SQUARE(PI)) + A + LONG; }\n";
        assert!(check(text, &[]).is_ok());
    }

    #[test]
    fn doubling_macros_are_refused() {
        let mut text = "#define A0 1.0 +\n".to_owned();
        for i in 1..40 {
            text.push_str(&format!("#define A{i} A{0} A{0}\n", i - 1));
        }
        assert!(check(&text, &[]).is_ok());
        let error = check(&format!("{text}float x = A39 1.0;"), &[]).unwrap_err();
        assert_eq!(error.code(), Code::TooDeep);
    }

    #[test]
    fn nested_calls_of_a_doubling_macro_are_refused() {
        let text = format!(
            "#define F(x) (x + x)\nfloat y = {}1.0{};",
            "F(".repeat(40),
            ")".repeat(40)
        );
        assert_eq!(check(&text, &[]).unwrap_err().code(), Code::TooDeep);
    }
}
