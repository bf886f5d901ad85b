//! `preshade rewrite`: a recipe applied, the shaders and the plan written.

use std::path::PathBuf;

use preshade::emit::{self, Target};
use preshade::passes::pass::Facts;
use preshade::passes::plan::Plan;
use preshade::recipe::Recipe;

use crate::input::ShaderArgs;
use crate::output;
use crate::{Failure, Outcome};

/// Arguments of `rewrite`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade rewrite lit.wgsl --pass depth-prepass                       to stdout
  preshade rewrite lit.wgsl --pass depth-prepass:form=equal --emit wgsl,spirv -o out/
  preshade rewrite lit.vert lit.frag --pass early-discard:texture=float --emit glsl-es -o out/
  preshade rewrite scene.toml --pass depth-prepass -o out/             every material of a scene
  preshade rewrite - --lang wgsl --pass depth-prepass < lit.wgsl

A pass that does not apply is told on stderr with its reason, and the material is written without
it. `preshade passes` lists the passes. Files are written whole or not at all.")]
pub struct Args {
    /// A pass of the recipe, in order: `depth-prepass`, `early-discard:quad=lane,budget=0.02` and so on.
    #[arg(long = "pass", value_name = "NAME[:k=v,..]")]
    passes: Vec<String>,
    /// What to write, separated by commas; `plan.json` comes with it.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "wgsl")]
    emit: Vec<EmitTarget>,
    /// Folder to write to, made if it is not there; without it the texts and the plan go to stdout.
    #[arg(short, long, alias = "out", value_name = "DIR")]
    output: Option<PathBuf>,
    // Last, for its help heading holds for what follows it.
    #[command(flatten)]
    shader: ShaderArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum EmitTarget {
    /// WGSL, one file a program.
    Wgsl,
    /// SPIR-V binaries.
    Spirv,
    /// GLSL 4.50 for OpenGL.
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

/// Rewrites a material, or every material of a scene.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let recipe = Recipe::parse(&args.passes)?;
    let targets: Vec<Target> = args.emit.iter().map(|t| Target::from(*t)).collect();
    if args.output.is_none() && targets.contains(&Target::Spirv) {
        return Err(Failure(
            "error: SPIR-V is binary: say with -o DIR where to write it".to_owned(),
        ));
    }
    let originals = args.shader.plans()?;
    let mut files = Vec::new();
    for original in &originals {
        check_name(&original.material)?;
        let plan = apply(original, &recipe);
        files.extend(emit::emit(&plan, &targets, &emit::Options::default())?);
    }
    match &args.output {
        Some(dir) => {
            let changed = emit::write(dir, &files).map_err(|e| Failure(format!("error: {e}")))?;
            for path in &changed {
                output::message(&format!("wrote {}", path.display()));
            }
            if changed.is_empty() {
                output::message(&format!("{} is up to date", dir.display()));
            }
        }
        None => {
            for file in &files {
                let text = String::from_utf8_lossy(&file.bytes);
                output::data(&format!("// {}\n{text}", file.name))?;
            }
        }
    }
    Ok(Outcome::Fine)
}

/// The steps of `recipe` that apply; what is refused is told on stderr and left out.
fn apply(original: &Plan, recipe: &Recipe) -> Plan {
    let mut plan = original.clone();
    for step in &recipe.steps {
        let one = Recipe {
            steps: vec![step.clone()],
        };
        match one.apply(&plan, &Facts::default()) {
            Ok(next) => plan = next,
            Err(refusal) => output::message(&crate::explain::refusal(&refusal, &plan)),
        }
    }
    plan
}

/// A material's name begins its files' names, so it must not lead out of the folder.
fn check_name(material: &str) -> Result<(), Failure> {
    if material.is_empty() || material.contains(['/', '\\']) {
        return Err(Failure(format!(
            "error: `{material}` cannot begin a file name: give another with --name"
        )));
    }
    Ok(())
}
