//! The files of `agree`: pairs of programs, and findings to accept.

use std::path::{Path, PathBuf};

use preshade_compiler::command::agree::class_named;
use preshade_compiler::command::agree_text::Waiver;
use preshade_plan::mapping::Equation;
use preshade_validate::agree::Relation;
use serde::Deserialize;

use crate::Failure;
use crate::agree::files;
use crate::input::ShaderArgs;

/// Two programs and their relation.
pub struct Asked {
    /// The pair's name; default: the files.
    pub name: Option<String>,
    pub first: ShaderArgs,
    pub second: ShaderArgs,
    pub relation: Relation,
    pub maps: Vec<Equation>,
    pub normal: Option<String>,
}

impl Asked {
    /// Its name, or that of its files.
    pub fn name(&self) -> String {
        self.name.clone().unwrap_or_else(|| {
            format!("{} {}", files(&self.first.files), files(&self.second.files))
        })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct File {
    #[serde(default)]
    pair: Vec<PairEntry>,
    #[serde(default)]
    waiver: Vec<WaiverEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct PairEntry {
    name: Option<String>,
    first: Files,
    second: Files,
    r#as: Relation,
    #[serde(default)]
    map: Vec<String>,
    normal: Option<String>,
    vertex: Option<String>,
    fragment: Option<String>,
    second_vertex: Option<String>,
    second_fragment: Option<String>,
    #[serde(default)]
    define: Vec<String>,
    second_define: Option<Vec<String>>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Files {
    One(PathBuf),
    Several(Vec<PathBuf>),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WaiverEntry {
    pair: String,
    class: String,
    reason: String,
}

fn file(path: &Path) -> Result<File, Failure> {
    let failed = |why: String| Failure(format!("error: {}: {why}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|e| failed(e.to_string()))?;
    toml::from_str(&text).map_err(|e| failed(e.to_string().trim_end().to_owned()))
}

/// The pairs of a file, with paths below a folder.
pub fn read(path: &Path, folder: &Path, shader: &ShaderArgs) -> Result<Vec<Asked>, Failure> {
    let failed = |why: String| Failure(format!("error: {}: {why}", path.display()));
    let pairs = file(path)?.pair;
    if pairs.is_empty() {
        return Err(failed("it has no [[pair]]".to_owned()));
    }
    let asked = pairs.into_iter().map(|pair| {
        let name = pair.name.unwrap_or_else(|| {
            let words = |files: &Files| match files {
                Files::One(file) => file.display().to_string(),
                Files::Several(files) => {
                    let files: Vec<String> =
                        files.iter().map(|f| f.display().to_string()).collect();
                    files.join(",")
                }
            };
            format!("{} {}", words(&pair.first), words(&pair.second))
        });
        let below = |files: Files| match files {
            Files::One(file) => vec![folder.join(file)],
            Files::Several(files) => files.into_iter().map(|f| folder.join(f)).collect(),
        };
        let side = |files, vertex, fragment, define: Vec<String>| {
            let mut side = ShaderArgs {
                files: below(files),
                vertex,
                fragment,
                ..shader.clone()
            };
            side.glsl.define.extend(define);
            side
        };
        let maps = pair.map.iter().map(|text| text.parse::<Equation>());
        let maps = maps
            .collect::<Result<_, _>>()
            .map_err(|e| failed(format!("map: {e}")))?;
        let define = pair.define;
        Ok(Asked {
            name: Some(name),
            second: side(
                pair.second,
                pair.second_vertex,
                pair.second_fragment,
                pair.second_define.unwrap_or_else(|| define.clone()),
            ),
            first: side(pair.first, pair.vertex, pair.fragment, define),
            relation: pair.r#as,
            maps,
            normal: pair.normal,
        })
    });
    asked.collect()
}

/// The waivers of a file of pairs, if it has some.
pub fn waivers_beside(path: &Path) -> Result<Vec<Waiver>, Failure> {
    let failed = |why: String| Failure(format!("error: {}: {why}", path.display()));
    let waivers = file(path)?.waiver.into_iter().map(|w| {
        if w.reason.trim().is_empty() {
            return Err(failed(format!("the waiver of `{}` has no reason", w.pair)));
        }
        Ok(Waiver {
            class: class_named(&w.class).map_err(failed)?,
            pair: w.pair,
            reason: w.reason,
        })
    });
    waivers.collect()
}

/// The waivers of a file.
pub fn waivers(path: &Path) -> Result<Vec<Waiver>, Failure> {
    let found = waivers_beside(path)?;
    match found.is_empty() {
        true => Err(Failure(format!(
            "error: {}: it has no [[waiver]]",
            path.display()
        ))),
        false => Ok(found),
    }
}
