//! Separate textures of Vulkan as arguments: a combination must be at its point of use, so a
//! function takes the texture and the sampler.
//!
//! before
//! ```glsl
//! vec4 twice(sampler2D t, vec2 uv) { return texture(t, uv) + texture(t, uv); }
//! .. twice(map, uv)
//! ```
//! after
//! ```glsl
//! vec4 twice(texture2D t, sampler t_sampler, vec2 uv) { return texture(sampler2D(t, t_sampler), uv) + ..; }
//! .. twice(map, map_sampler, uv)
//! ```

use std::collections::{HashMap, HashSet};
use std::ops::Range;

use shader_text::tokens as text;
use shader_text::tokens::TokenKind;

/// A texture and its sampler.
#[derive(Clone, Debug)]
pub(super) struct Separate {
    /// The combined type, such as `usampler2D`.
    pub combined: String,
    pub texture: String,
    pub sampler: String,
}

impl Separate {
    fn combination(&self) -> String {
        let Self {
            combined,
            texture,
            sampler,
        } = self;
        format!("{combined}({texture}, {sampler})")
    }
}

/// The types of a texture and its sampler.
pub(super) fn split(combined: &str) -> [String; 2] {
    let texture = combined.replacen("sampler", "texture", 1);
    let is_shadow = combined.ends_with("Shadow");
    let sampler = if is_shadow {
        "samplerShadow"
    } else {
        "sampler"
    };
    [
        texture.trim_end_matches("Shadow").to_owned(),
        sampler.to_owned(),
    ]
}

/// A parameter of a function, by its position.
type Parameter<'t> = (&'t str, usize);

struct Word<'t> {
    word: &'t str,
    range: Range<usize>,
    function: &'t str,
    /// The parameter that it is the whole argument of.
    given: Option<Parameter<'t>>,
}

/// Combines the separate textures of `text` where it uses them. Fails with the name of a texture
/// whose parameter gets a combined one elsewhere.
pub(super) fn combined_at_use<'t>(
    text: &'t str,
    globals: &HashMap<String, Separate>,
) -> Result<String, &'t str> {
    let functions = functions(text);
    let words = words(text, &functions);
    let parameter = |word: &Word<'t>| -> Option<Parameter<'t>> {
        let all = functions.get(word.function)?;
        let at = all.iter().position(|(_, name)| *name == word.word)?;
        Some((word.function, at))
    };
    let is_separate = |word: &Word<'t>, apart: &HashSet<Parameter<'t>>| match parameter(word) {
        Some(parameter) => apart.contains(&parameter),
        None => globals.contains_key(word.word),
    };
    let mut apart = HashSet::new();
    // GLSL has no recursion, so this ends after at most as many rounds as the call depth.
    loop {
        let before = apart.len();
        for word in &words {
            if let (Some(to), true) = (word.given, is_separate(word, &apart)) {
                apart.insert(to);
            }
        }
        if apart.len() == before {
            break;
        }
    }
    let of = |word: &Word<'t>| -> Option<Separate> {
        let Some((function, at)) = parameter(word) else {
            return globals.get(word.word).cloned();
        };
        Some(Separate {
            combined: functions[function][at].0.to_owned(),
            texture: word.word.to_owned(),
            sampler: format!("{}_sampler", word.word),
        })
    };
    let mut out = String::with_capacity(text.len());
    let mut copied = 0;
    for word in &words {
        let is_given = word.given.is_some_and(|to| apart.contains(&to));
        if !is_separate(word, &apart) {
            match is_given {
                true => return Err(word.word),
                false => continue,
            }
        }
        let Some(separate) = of(word) else { continue };
        let line = text[..word.range.start].rfind('\n').map_or(0, |at| at + 1);
        // Its declaration: `sampler2D t` in the head.
        let is_head = !text[line..].starts_with(' ') && parameter(word).is_some();
        let [texture, sampler] = split(&separate.combined);
        let (start, new) = match (is_head, is_given) {
            (true, _) => (
                word.range.start - separate.combined.len() - 1,
                format!(
                    "{texture} {}, {sampler} {}",
                    separate.texture, separate.sampler
                ),
            ),
            (_, true) => (
                word.range.start,
                format!("{}, {}", separate.texture, separate.sampler),
            ),
            _ => (word.range.start, separate.combination()),
        };
        out += &text[copied..start];
        out += &new;
        copied = word.range.end;
    }
    Ok(out + &text[copied..])
}

/// A function's head: the line that begins its body.
fn is_head(line: &str) -> bool {
    !line.starts_with([' ', '}', '#']) && line.ends_with('{') && line.contains('(')
}

/// The types and names of the parameters of each function.
fn functions(text: &str) -> HashMap<&str, Vec<(&str, &str)>> {
    let heads = text.lines().filter(|l| is_head(l));
    heads
        .filter_map(|head| {
            let (before, rest) = head.split_once('(')?;
            let (inside, _) = rest.rsplit_once(')')?;
            let parameters = inside.split(',').filter_map(|p| {
                let mut words = p.split_whitespace().rev();
                let name = words.next()?;
                Some((words.next()?, name))
            });
            let name = before.rsplit(' ').next()?;
            Some((name, parameters.collect()))
        })
        .collect()
}

fn words<'t>(text: &'t str, functions: &HashMap<&'t str, Vec<(&str, &str)>>) -> Vec<Word<'t>> {
    let tokens: Vec<_> = text::tokens(text).collect();
    let at = |i: usize| tokens.get(i).map_or("", |(_, range)| &text[range.clone()]);
    let mut out = Vec::new();
    // The callees whose arguments these are, with the number of the argument.
    let mut calls: Vec<(&str, usize)> = Vec::new();
    let (mut function, mut ends) = ("", 0);
    for (i, (kind, range)) in tokens.iter().enumerate() {
        let line = text[..range.start].rfind('\n').map_or(0, |at| at + 1);
        if line == range.start && line >= ends {
            let head = text[line..].lines().next().unwrap_or_default();
            let called = head.split_once('(').map_or("", |(before, _)| before);
            function = match is_head(head) {
                true => called.rsplit(' ').next().unwrap_or_default(),
                false => "",
            };
            if !function.is_empty() {
                let body = text[line..].find("\n}");
                ends = body.map_or(text.len(), |n| line + n + 1);
            }
        }
        match at(i) {
            "(" => calls.push((if i > 0 { at(i - 1) } else { "" }, 0)),
            ")" => drop(calls.pop()),
            "," => {
                if let Some((_, n)) = calls.last_mut() {
                    *n += 1;
                }
            }
            word if *kind == TokenKind::Word && !function.is_empty() => {
                let is_whole =
                    matches!(at(i.saturating_sub(1)), "(" | ",") && matches!(at(i + 1), ")" | ",");
                let call = calls.last().filter(|(c, _)| functions.contains_key(c));
                out.push(Word {
                    word,
                    range: range.clone(),
                    function,
                    given: call.copied().filter(|_| is_whole),
                });
            }
            _ => {}
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn globals() -> HashMap<String, Separate> {
        let separate = Separate {
            combined: "sampler2D".to_owned(),
            texture: "map".to_owned(),
            sampler: "map_sampler".to_owned(),
        };
        HashMap::from([("map".to_owned(), separate)])
    }

    #[test]
    fn a_function_takes_both() {
        let text = "vec4 f(sampler2D t, vec2 uv) {\n    return texture(t, uv);\n}\n\
                    vec4 g(sampler2D t) {\n    return f(t, vec2(0.0));\n}\n\
                    void main() {\n    vec4 c = texture(map, uv) + g(map);\n}\n";
        let changed = combined_at_use(text, &globals());
        let wanted = "vec4 f(texture2D t, sampler t_sampler, vec2 uv) {\n    return \
                      texture(sampler2D(t, t_sampler), uv);\n}\n\
                      vec4 g(texture2D t, sampler t_sampler) {\n    return f(t, t_sampler, \
                      vec2(0.0));\n}\n\
                      void main() {\n    vec4 c = texture(sampler2D(map, map_sampler), uv) + \
                      g(map, map_sampler);\n}\n";
        assert_eq!(changed.as_deref(), Ok(wanted));
    }

    #[test]
    fn a_function_that_gets_a_combined_one_too_is_refused() {
        let text = "vec4 f(sampler2D t) {\n    return texture(t, vec2(0.0));\n}\n\
                    void main() {\n    vec4 c = f(map) + f(other);\n}\n";
        assert_eq!(combined_at_use(text, &globals()), Err("other"));
    }
}
