//! What every command that takes a shader takes: files, entry points, pipeline state.

use std::io::Read;
use std::path::{Path, PathBuf};

use preshade::front::{self, Source};
use preshade::passes::plan::Plan;
use preshade::passes::program::Language;
use preshade::passes::state::{
    Blend, ColorTarget, CompareFunction, CullMode, DepthDirection, DepthFormat, MaterialState,
    Topology,
};

use crate::Failure;

/// A shader and the state it is drawn with.
#[derive(clap::Args)]
pub struct ShaderArgs {
    /// A WGSL file with both entry points, or a vertex and a fragment file; `-` is stdin.
    #[arg(required = true, num_args = 1..=2, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Language of the input; needed for stdin, otherwise told by the file's ending.
    #[arg(long, value_enum)]
    pub lang: Option<Lang>,
    /// Vertex entry point, where the shader has several.
    #[arg(long, value_name = "NAME")]
    pub vertex: Option<String>,
    /// Fragment entry point, where the shader has several.
    #[arg(long, value_name = "NAME")]
    pub fragment: Option<String>,
    /// Name of the material; default: the file's.
    #[arg(long)]
    pub name: Option<String>,
    #[command(flatten)]
    pub state: StateArgs,
}

/// Source language.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Lang {
    /// WebGPU Shading Language.
    Wgsl,
    /// GLSL 4.40 to 4.60.
    Glsl,
}

impl From<Lang> for Language {
    fn from(lang: Lang) -> Self {
        match lang {
            Lang::Wgsl => Self::Wgsl,
            Lang::Glsl => Self::Glsl,
        }
    }
}

/// Pipeline state, which no shader says of itself.
#[derive(clap::Args)]
#[command(next_help_heading = "Pipeline state")]
pub struct StateArgs {
    /// A TOML or JSON file with the whole state; the flags below go on top of it.
    #[arg(long, value_name = "FILE")]
    pub state: Option<PathBuf>,
    /// Depth comparison; default: less, or greater with --reversed-z.
    #[arg(long, value_parser = parse_enum::<CompareFunction>)]
    pub depth_compare: Option<CompareFunction>,
    /// Depth format.
    #[arg(long, value_parser = parse_enum::<DepthFormat>)]
    pub depth_format: Option<DepthFormat>,
    /// Depth is 1 at the near plane and 0 at the far one.
    #[arg(long)]
    pub reversed_z: bool,
    /// The material does not write depth.
    #[arg(long)]
    pub no_depth_write: bool,
    /// Blending of the first colour target: none, alpha or add.
    #[arg(long, value_enum)]
    pub blend: Option<BlendArg>,
    /// Faces that are dropped.
    #[arg(long, value_parser = parse_enum::<CullMode>)]
    pub cull: Option<CullMode>,
    /// Primitive topology.
    #[arg(long, value_parser = parse_enum::<Topology>)]
    pub topology: Option<Topology>,
    /// Samples a pixel.
    #[arg(long, value_parser = ["1", "4"])]
    pub samples: Option<String>,
    /// Coverage from the alpha of the first target.
    #[arg(long)]
    pub alpha_to_coverage: bool,
}

/// Common blend states.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum BlendArg {
    /// Opaque.
    None,
    /// Source over.
    Alpha,
    /// Additive.
    Add,
}

/// Reads a state enum by the name it has in JSON, which is WebGPU's.
fn parse_enum<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_value(serde_json::Value::String(text.to_owned())).map_err(|e| e.to_string())
}

impl StateArgs {
    /// The state in force.
    pub fn state(&self) -> Result<MaterialState, Failure> {
        let mut state = match &self.state {
            None => MaterialState::default(),
            Some(path) => {
                let text = std::fs::read_to_string(path)
                    .map_err(|e| Failure(format!("error: {}: {e}", path.display())))?;
                let read = if path.extension().is_some_and(|e| e == "json") {
                    serde_json::from_str(&text).map_err(|e| e.to_string())
                } else {
                    toml::from_str(&text).map_err(|e| e.to_string())
                };
                read.map_err(|e| Failure(format!("error: {}: {e}", path.display())))?
            }
        };
        if let Some(compare) = self.depth_compare {
            state.depth_compare = Some(compare);
        }
        if let Some(format) = self.depth_format {
            state.depth_format = format;
        }
        if self.reversed_z {
            state.depth_direction = DepthDirection::Reversed;
        }
        if self.no_depth_write {
            state.depth_write = false;
        }
        if let Some(cull) = self.cull {
            state.primitive.cull = cull;
        }
        if let Some(topology) = self.topology {
            state.primitive.topology = topology;
        }
        if let Some(samples) = &self.samples {
            state.multisample.count = if samples == "4" { 4 } else { 1 };
        }
        state.multisample.alpha_to_coverage |= self.alpha_to_coverage;
        if let Some(blend) = self.blend {
            let blend = match blend {
                BlendArg::None => None,
                BlendArg::Alpha => Some(Blend::ALPHA),
                BlendArg::Add => Some(Blend::ADD),
            };
            if state.targets.is_empty() {
                state.targets.push(Some(ColorTarget::opaque("rgba8unorm")));
            }
            if let Some(Some(target)) = state.targets.first_mut() {
                target.blend = blend;
            }
        }
        Ok(state)
    }
}

impl ShaderArgs {
    /// Reads and parses the shader, and makes its original plan.
    pub fn plan(&self) -> Result<Plan, Failure> {
        let parsed = self.parse()?;
        let state = self.state.state()?;
        Ok(Plan::original(
            &self.material_name(),
            parsed.program,
            &parsed.vertex,
            parsed.fragment.as_deref(),
            &state,
        ))
    }

    /// Reads and parses the shader.
    pub fn parse(&self) -> Result<front::Parsed, Failure> {
        let sources = self
            .files
            .iter()
            .map(|f| self.source(f))
            .collect::<Result<Vec<_>, _>>()?;
        let options = front::Options {
            vertex: self.vertex.clone(),
            fragment: self.fragment.clone(),
            ..front::Options::default()
        };
        front::parse(&sources, &options).map_err(|e| Failure(e.render(color())))
    }

    fn source(&self, path: &Path) -> Result<Source, Failure> {
        let language = self.lang.map(Language::from);
        if path == Path::new("-") {
            if language.is_none() {
                return Err(Failure("error: stdin has no file name to tell its language from: give --lang wgsl or --lang glsl".to_owned()));
            }
            let mut bytes = Vec::new();
            std::io::stdin()
                .lock()
                .read_to_end(&mut bytes)
                .map_err(|e| Failure(format!("error: stdin: {e}")))?;
            return Ok(Source {
                name: "<stdin>".to_owned(),
                text: utf8(bytes, "stdin")?,
                language,
                stage: None,
            });
        }
        let bytes =
            std::fs::read(path).map_err(|e| Failure(format!("error: {}: {e}", path.display())))?;
        let name = path.display().to_string();
        let text = utf8(bytes, &name)?;
        Ok(Source {
            name,
            text,
            language,
            stage: None,
        })
    }

    /// Name of the material.
    pub fn material_name(&self) -> String {
        self.name.clone().unwrap_or_else(|| {
            self.files
                .first()
                .filter(|f| *f != Path::new("-"))
                .and_then(|f| f.file_stem())
                .map_or_else(
                    || "material".to_owned(),
                    |s| s.to_string_lossy().into_owned(),
                )
        })
    }
}

fn utf8(bytes: Vec<u8>, name: &str) -> Result<String, Failure> {
    String::from_utf8(bytes).map_err(|e| {
        Failure(format!(
            "error: {name}: not UTF-8 text (byte {})",
            e.utf8_error().valid_up_to()
        ))
    })
}

fn color() -> front::Color {
    if crate::color_on_stderr() {
        front::Color::Always
    } else {
        front::Color::Never
    }
}
