//! `preshade rewrite`: a recipe applied, the shaders and the plan written.

use std::path::PathBuf;

use preshade::emit::{self, Target};
use preshade::passes::pass::Facts;
use preshade::recipe::Recipe;

use crate::input::ShaderArgs;
use crate::{Failure, Outcome};

/// Arguments of `rewrite`.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    shader: ShaderArgs,
    /// A pass of the recipe, in order: `depth-prepass`, `early-discard:quad=lane` and so on.
    #[arg(long = "pass", value_name = "NAME[:k=v,..]")]
    passes: Vec<String>,
    /// What to write.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "wgsl")]
    emit: Vec<EmitTarget>,
    /// Folder to write to; without it the WGSL of each program goes to stdout.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum EmitTarget {
    /// `MATERIAL.ROLE.wgsl`
    Wgsl,
    /// SPIR-V binaries.
    Spirv,
    /// GLSL 4.50 for Vulkan and desktop GL.
    Glsl,
    /// GLSL ES 3.00 for WebGL 2.
    GlslEs,
}

impl From<EmitTarget> for Target {
    fn from(target: EmitTarget) -> Self {
        match target {
            EmitTarget::Wgsl => Self::Wgsl,
            EmitTarget::Spirv => Self::Spirv,
            EmitTarget::Glsl => Self::Glsl450,
            EmitTarget::GlslEs => Self::GlslEs300,
        }
    }
}

/// Rewrites one material.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let recipe = Recipe::parse(&args.passes)?;
    let original = args.shader.plan()?;
    let mut plan = original;
    for step in &recipe.steps {
        let one = Recipe {
            steps: vec![step.clone()],
        };
        match one.apply(&plan, &Facts::default()) {
            Ok(next) => plan = next,
            Err(refusal) => eprintln!("{}", crate::explain::refusal(&refusal, &plan)),
        }
    }
    let targets: Vec<Target> = args.emit.iter().map(|t| Target::from(*t)).collect();
    let files = emit::emit(&plan, &targets, &emit::Options::default())?;
    match &args.output {
        Some(dir) => {
            for path in emit::write(dir, &files)
                .map_err(|e| Failure(format!("error: {}: {e}", dir.display())))?
            {
                eprintln!("wrote {}", path.display());
            }
        }
        None => {
            for file in &files {
                match std::str::from_utf8(&file.bytes) {
                    Ok(text) => println!("// {}\n{text}", file.name),
                    Err(_) => {
                        return Err(Failure(format!(
                            "error: {} is binary: give -o DIR",
                            file.name
                        )));
                    }
                }
            }
        }
    }
    Ok(Outcome::Fine)
}
