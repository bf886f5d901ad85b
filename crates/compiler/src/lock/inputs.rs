//! The inputs of a choice, compared with the inputs of a build.

use std::collections::BTreeMap;
use std::path::Path;

use preshade_plan::state::MaterialState;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Mismatch, TOOL};
use crate::front;

/// Everything that determines the result of a recipe, except for facts about the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Inputs {
    /// [`TOOL`].
    pub tool: String,
    /// The material's files, in order, and the files that they include.
    pub sources: Vec<HashedSource>,
    /// Preprocessor definitions, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub defines: BTreeMap<String, String>,
    /// Vertex entry point.
    pub vertex: String,
    /// Fragment entry point. `None`: the material draws only depth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fragment: Option<String>,
    /// The author's pipeline state.
    pub state: MaterialState,
}

/// A source file, by name and content.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HashedSource {
    /// File name, without its folder.
    pub file: String,
    /// BLAKE3 of the text in hex, without comments, empty lines and trailing blanks.
    pub blake3: String,
}

impl Inputs {
    /// The inputs of a material as it is read now.
    pub fn of(parsed: &front::Parsed, defines: &[(String, String)], state: &MaterialState) -> Self {
        let files = parsed.program.sources().files();
        let mut sources: Vec<HashedSource> = Vec::new();
        for file in files {
            let hashed = HashedSource::of(&file.name, &file.text);
            // Both stages may include one file.
            if !sources.contains(&hashed) {
                sources.push(hashed);
            }
        }
        Self {
            tool: TOOL.to_owned(),
            sources,
            defines: defines.iter().cloned().collect(),
            vertex: parsed.vertex.clone(),
            fragment: parsed.fragment.clone(),
            state: state.clone(),
        }
    }

    /// Whether both have files of the same names.
    pub(super) fn is_of_files(&self, other: &Self) -> bool {
        let names = |inputs: &Self| inputs.sources.iter().map(|s| s.file.clone()).collect();
        let (own, others): (Vec<String>, Vec<String>) = (names(self), names(other));
        own == others
    }

    fn files(&self) -> String {
        let names: Vec<&str> = self.sources.iter().map(|s| s.file.as_str()).collect();
        names.join(" and ")
    }

    /// The first difference from `now`.
    pub(super) fn difference(&self, now: &Self) -> Option<Mismatch> {
        if self.tool != now.tool {
            return Some(Mismatch::Tool {
                locked: self.tool.clone(),
            });
        }
        if !self.is_of_files(now) {
            return Some(Mismatch::Files {
                locked: self.files(),
                now: now.files(),
            });
        }
        let mut both = self.sources.iter().zip(&now.sources);
        if let Some((_, edited)) = both.find(|(then, now)| then != now) {
            return Some(Mismatch::Source {
                file: edited.file.clone(),
            });
        }
        if self.defines != now.defines {
            let names = self.defines.keys().chain(now.defines.keys());
            let mut names: Vec<&str> = names
                .filter(|n| self.defines.get(*n) != now.defines.get(*n))
                .map(String::as_str)
                .collect();
            names.sort_unstable();
            names.dedup();
            return Some(Mismatch::Defines {
                names: names.join(", "),
            });
        }
        if (&self.vertex, &self.fragment) != (&now.vertex, &now.fragment) {
            return Some(Mismatch::EntryPoints);
        }
        (self.state != now.state).then(|| Mismatch::State {
            fields: differing(&self.state, &now.state),
        })
    }
}

/// The fields of two states that differ: `multisample.count is 4, and was 1`.
fn differing(then: &MaterialState, now: &MaterialState) -> String {
    use serde_json::Value;
    fn walk(at: &str, then: &Value, now: &Value, out: &mut Vec<String>) {
        let below = |key: &str| match at {
            "" => key.to_owned(),
            _ => format!("{at}.{key}"),
        };
        match (then, now) {
            _ if then == now => {}
            (Value::Object(a), Value::Object(b)) => {
                let mut keys: Vec<&String> = a.keys().chain(b.keys()).collect();
                keys.sort_unstable();
                keys.dedup();
                let of = |all: &serde_json::Map<String, Value>, key: &String| {
                    all.get(key).cloned().unwrap_or(Value::Null)
                };
                for key in keys {
                    walk(&below(key), &of(a, key), &of(b, key), out);
                }
            }
            (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
                for (i, (a, b)) in a.iter().zip(b).enumerate() {
                    walk(&below(&i.to_string()), a, b, out);
                }
            }
            _ => out.push(format!("{at} is {now}, and was {then}")),
        }
    }
    // Plain data: serialising it cannot fail.
    let value = |state: &MaterialState| serde_json::to_value(state).unwrap_or_default();
    let mut out = Vec::new();
    walk("", &value(then), &value(now), &mut out);
    out.join("; ")
}

impl HashedSource {
    fn of(name: &str, text: &str) -> Self {
        let path = Path::new(name);
        let file = path.file_name().unwrap_or(path.as_os_str());
        Self {
            file: file.to_string_lossy().into_owned(),
            blake3: hash(&said(text)),
        }
    }
}

/// The text with each comment as one blank, and without trailing blanks and empty lines. Comments
/// nest, as in WGSL. In GLSL they don't, but equality is only a hint here: the emitted shaders have
/// a hash of their own.
pub(super) fn said(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut depth = 0_u32;
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let (opens, closes) = (rest.starts_with("/*"), rest.starts_with("*/"));
        let mut length = c.len_utf8();
        if opens {
            (depth, length) = (depth + 1, 2);
        } else if closes && depth > 0 {
            (depth, length) = (depth - 1, 2);
            plain.push(' ');
        } else if depth == 0 && rest.starts_with("//") {
            length = rest.find(['\n', '\r']).unwrap_or(rest.len());
        } else if depth == 0 || c == '\n' {
            plain.push(c);
        }
        rest = &rest[length..];
    }
    let lines = plain.split(['\r', '\n']).map(str::trim_end);
    let lines: Vec<&str> = lines.filter(|line| !line.is_empty()).collect();
    lines.join("\n")
}

pub(super) fn hash(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex().to_string()
}
