//! What is asked. Names are those of the command line's flags, in camelCase.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use naga::ShaderStage;
use preshade_compiler::command::material::{
    StateFlags, check_state, define, name_of, reads_facing, with_suggestion,
};
use preshade_compiler::command::rewrite::read_layouts;
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_plan::plan::Plan;
use preshade_plan::state::{CullMode, MaterialState};
use serde::Deserialize;
use serde_json::{Map, Value, from_value};
use shader_text::limits::{Exceeded, Limits};
use shader_text::memory::Memory;
use shader_text::options::{self, ClipSpace};
use shader_text::source::Language;

use crate::failure::Failure;

/// The name of a text that was not in a file.
const STDIN: &str = "<stdin>";

/// A request.
pub enum Request {
    /// `rewrite`.
    Rewrite(Rewrite),
    /// `explain`.
    Explain(Explain),
    /// `agree`.
    #[cfg(feature = "check")]
    Agree(Box<Agree>),
    /// `graph`.
    Graph(Drawn),
    /// `passes`.
    Passes(Passes),
}

impl Request {
    /// Reads a request: JSON, with its `command`.
    ///
    /// Everything is read from a [`Value`], never from the text: serde writes a parser for each kind of
    /// source, and one is enough for the size of the module.
    pub fn read(text: &[u8]) -> Result<Self, serde_json::Error> {
        let mut request: Map<String, Value> = serde_json::from_slice(text)?;
        let command = request.remove("command").unwrap_or_default();
        let asked = Value::Object(request);
        match command.as_str() {
            Some("rewrite") => from_value(asked).map(Self::Rewrite),
            Some("explain") => from_value(asked).map(Self::Explain),
            #[cfg(feature = "check")]
            Some("agree") => from_value(asked).map(Self::Agree),
            Some("graph") => from_value(asked).map(Self::Graph),
            Some("passes") => from_value(asked).map(Self::Passes),
            _ => Err(serde::de::Error::custom(format!("{command} is no command"))),
        }
    }
}

/// How the answer is printed. Without it, nothing is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// For people.
    Human,
    /// For programs.
    Json,
    /// For a comment on a pull request, of `agree`.
    Markdown,
}

/// A shader and its pipeline state.
#[derive(Clone, Default, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "camelCase")]
pub struct Shader {
    /// One file, or a vertex and a fragment file.
    sources: Vec<File>,
    /// Files that `#include` and imports find, by path.
    files: BTreeMap<String, String>,
    name: Option<String>,
    vertex: Option<String>,
    fragment: Option<String>,
    include: Vec<PathBuf>,
    define: Vec<String>,
    clip: Option<ClipSpace>,
    limits: Option<String>,
    state: Option<State>,
    flags: StateFlags,
}

/// A file of a shader.
#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    name: String,
    text: String,
    language: Option<Lang>,
    stage: Option<Stage>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Lang {
    Wgsl,
    Glsl,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Stage {
    Vertex,
    Fragment,
}

/// Pipeline state.
#[derive(Clone, Deserialize)]
#[serde(rename_all = "lowercase")]
enum State {
    /// The content of a file, after its name.
    File(String, Value),
    /// The whole state.
    Whole(Box<MaterialState>),
}

/// The request `rewrite`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
pub struct Rewrite {
    /// The material.
    pub shader: Shader,
    /// The passes of the recipe.
    #[serde(default)]
    pub passes: Passing,
    /// Targets, by their names.
    #[serde(default)]
    pub emit: Vec<String>,
    /// Whether to hold the variant against the original, by proof and by an interpreter.
    #[serde(default)]
    pub validate: bool,
    /// The folder that the caller writes to.
    pub out: Option<PathBuf>,
    /// How the answer is printed.
    pub format: Option<Format>,
}

/// The request `explain`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
pub struct Explain {
    /// The material.
    pub shader: Shader,
    /// The passes to explain, each after those before it. Empty: every pass on its own.
    #[serde(default)]
    pub passes: Passing,
    /// Whether to print everything.
    #[serde(default)]
    pub verbose: bool,
    /// How the answer is printed.
    pub format: Option<Format>,
}

/// The request `agree`.
#[cfg(feature = "check")]
#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
pub struct Agree {
    /// The first program.
    pub shader: Shader,
    /// The second.
    pub with: Shader,
    /// What the two should have in common.
    pub r#as: String,
    /// The second's resources by the first's names, `THEIRS=OURS`.
    #[serde(default)]
    pub map: Vec<String>,
    /// The first program's normal.
    pub normal: Option<String>,
    /// The classes that break the relation.
    pub fail_on: Option<Vec<String>>,
    /// Inputs to try for each promise.
    pub inputs: Option<u64>,
    /// Whether to print everything.
    #[serde(default)]
    pub verbose: bool,
    /// How the answer is printed.
    pub format: Option<Format>,
}

/// The request `graph`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drawn {
    /// The material.
    pub shader: Shader,
}

/// The request `passes`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Passes {
    /// One pass; without it, all.
    pub name: Option<String>,
    /// How the answer is printed.
    pub format: Option<Format>,
}

/// Steps as on the command line, or a recipe as in `plan.json`.
#[derive(Deserialize)]
#[serde(try_from = "Value")]
pub enum Passing {
    /// A text each.
    Texts(Vec<String>),
    /// A recipe.
    Recipe(Recipe),
}

impl Default for Passing {
    fn default() -> Self {
        Self::Texts(Vec::new())
    }
}

impl TryFrom<Value> for Passing {
    type Error = serde_json::Error;

    fn try_from(passes: Value) -> Result<Self, Self::Error> {
        let texts = passes
            .as_array()
            .is_some_and(|of| of.iter().all(Value::is_string));
        match texts {
            true => from_value(passes).map(Self::Texts),
            false => from_value(passes).map(Self::Recipe),
        }
    }
}

impl Passing {
    /// The recipe. Layouts are among the shader's files.
    pub fn recipe(&self, shader: &Shader) -> Result<Recipe, Failure> {
        let mut recipe = match self {
            Self::Texts(texts) => {
                Recipe::parse(texts).map_err(|e| Failure::usage(e.to_string()))?
            }
            Self::Recipe(recipe) => recipe.clone(),
        };
        let memory = shader.memory();
        let read = |file: &str| {
            let text = memory.text(Path::new(file)).map(str::to_owned);
            text.ok_or_else(|| "it is not among the files".to_owned())
        };
        read_layouts(&mut recipe, &read).map_err(Failure::usage)?;
        Ok(recipe)
    }
}

impl Shader {
    fn memory(&self) -> Memory {
        let files = self.files.iter();
        files.map(|(path, text)| (path, text.clone())).collect()
    }

    /// Reads the program, with depths as written if `clip` says so.
    pub fn parse(&self, clip: Option<ClipSpace>) -> Result<front::Parsed, Failure> {
        let sources = self.sources.iter().map(|file| {
            let mut source = Source::new(file.name.clone(), file.text.clone());
            source.language = file.language.map(|language| match language {
                Lang::Wgsl => Language::Wgsl,
                Lang::Glsl => Language::Glsl,
            });
            source.stage = file.stage.map(|stage| match stage {
                Stage::Vertex => ShaderStage::Vertex,
                Stage::Fragment => ShaderStage::Fragment,
            });
            source
        });
        let define = self.define.iter().map(|text| define(text));
        let limits = Limits::parse(self.limits.as_deref().unwrap_or_default());
        let limits = limits.map_err(Failure::usage)?;
        for File { name, text, .. } in &self.sources {
            let (asked, most) = (text.len() as u64, limits.source_bytes);
            // As the command line, which leaves the text of stdin to the parser.
            if asked > most && name != STDIN {
                let what = format!("the bytes of {name}");
                let limit = "source-bytes";
                let exceeded = Exceeded {
                    limit,
                    what,
                    asked,
                    most,
                };
                return Err(Failure::too_large(name, &exceeded));
            }
        }
        let options = options::Options {
            vertex: self.vertex.clone(),
            fragment: self.fragment.clone(),
            defines: define.collect::<Result<_, _>>().map_err(Failure::usage)?,
            include: self.include.clone(),
            files: self.memory(),
            clip_space: clip.or(self.clip),
            limits,
            ..shader_text::options::Options::default()
        };
        let sources: Vec<Source> = sources.collect();
        front::parse(&sources, &options).map_err(|e| Failure::front(&e))
    }

    /// The material as its author wrote it.
    pub fn plan(&self, clip: Option<ClipSpace>) -> Result<Plan, Failure> {
        let parsed = self.parse(clip)?;
        let mut state = match &self.state {
            None => MaterialState::default(),
            Some(State::Whole(state)) => (**state).clone(),
            Some(State::File(name, content)) => from_value(content.clone()).map_err(|e| {
                Failure::usage(format!("{name}: {}", with_suggestion(&e.to_string())))
            })?,
        };
        self.flags.apply(&mut state);
        check_state(&state).map_err(Failure::usage)?;
        let says_no_cull = self.flags.cull.is_none() && self.state.is_none();
        if says_no_cull && reads_facing(&parsed) {
            state.primitive.cull = CullMode::None;
        }
        Ok(parsed.plan(&self.material(), &state))
    }

    /// Name of the material: the given one, or the file's without its endings.
    fn material(&self) -> String {
        if let Some(name) = &self.name {
            return name.clone();
        }
        let mut files = self.sources.iter().map(|file| file.name.as_str());
        let file = files.find(|name| *name != STDIN);
        let stem = file.and_then(|name| Path::new(name).file_stem()?.to_str());
        stem.map_or("material", name_of).to_owned()
    }

    /// Whether the caller gave the pipeline state.
    pub fn has_state(&self) -> bool {
        self.state.is_some()
    }

    /// Whether the caller gave the clip space.
    pub fn has_clip(&self) -> bool {
        self.clip.is_some()
    }

    /// The names of its files, joined.
    pub fn names(&self) -> String {
        let names: Vec<&str> = self.sources.iter().map(|file| file.name.as_str()).collect();
        names.join(",")
    }
}
