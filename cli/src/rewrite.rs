//! `preshade rewrite`: a recipe applied, the shaders and the plan written.

use std::path::PathBuf;

use preshade::emit::{self, Target};
use preshade::passes::PASSES;
use preshade::passes::neighbours;
use preshade::passes::pass::{AnyPass, Facts};
use preshade::passes::plan::Plan;
use preshade::recipe::Recipe;

use crate::input::{Materials, ShaderArgs};
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
it. `preshade passes` lists the passes. A target that cannot say what a material does is told on
stderr with its reason; the other targets are written, plan.json names those alone, and the exit
status is 2. Files are written whole or not at all.")]
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
    /// GLSL 4.00 for OpenGL, what was hoisted in a tessellation stage.
    GlslTess,
    /// GLSL 4.50 for Vulkan, likewise.
    GlslVulkanTess,
}

impl From<EmitTarget> for Target {
    fn from(target: EmitTarget) -> Self {
        match target {
            EmitTarget::Wgsl => Self::Wgsl,
            EmitTarget::Spirv => Self::Spirv,
            EmitTarget::Glsl => Self::Glsl450,
            EmitTarget::GlslEs => Self::GlslEs300,
            EmitTarget::GlslTess => Self::GlslTess,
            EmitTarget::GlslVulkanTess => Self::GlslVulkanTess,
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
    let Materials {
        asked: originals,
        frame,
        known,
        ..
    } = args.shader.plans()?;
    let (mut files, mut errors) = (Vec::new(), Vec::new());
    for original in &originals {
        check_name(&original.material)?;
        let plan = apply(original, &recipe, &known, &frame);
        let budgets = plan.contract.budgets();
        if !budgets.is_empty() {
            let off: Vec<String> = budgets
                .iter()
                .map(|b| format!("{} ({})", b.budget, b.metric))
                .collect();
            output::message(&format!(
                "warning: `{}` is an approximation, allowed to be off by {}, and nothing is measured here: `preshade verify` tells whether it keeps \
                 that, and what to pass to `rewrite` for the choice it measured",
                plan.material,
                off.join(" and ")
            ));
        }
        let emitted = emit_each(&plan, &targets)?;
        files.extend(emitted.files);
        for error in emitted.errors {
            let error = format!("error: {error}");
            if !errors.contains(&error) {
                errors.push(error);
            }
        }
    }
    match &args.output {
        _ if files.is_empty() => {}
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
    if !errors.is_empty() {
        return Err(Failure(errors.join("\n")));
    }
    if recipe.steps.is_empty() {
        for original in &originals {
            output::message(&nothing_asked_for(original));
        }
    }
    Ok(Outcome::Fine)
}

/// What of a plan could be written.
struct Emitted {
    /// Nothing where every target failed.
    files: Vec<emit::File>,
    /// One a target that failed.
    errors: Vec<emit::Error>,
}

/// Emits `plan` in every target that can say it.
///
/// # Errors
/// When the plan itself is broken: a bug.
fn emit_each(plan: &Plan, targets: &[Target]) -> Result<Emitted, emit::Error> {
    let emit = |targets: &[Target]| emit::emit(plan, targets, &emit::Options::default());
    if let Ok(files) = emit(targets) {
        return Ok(Emitted {
            files,
            errors: Vec::new(),
        });
    }
    let (mut able, mut errors) = (Vec::new(), Vec::new());
    for target in targets {
        match emit(&[*target]) {
            Ok(_) => able.push(*target),
            Err(error @ emit::Error::BrokenPlan { .. }) => return Err(error),
            Err(error) => errors.push(error),
        }
    }
    let files = match able.is_empty() {
        true => Vec::new(),
        false => emit(&able)?,
    };
    Ok(Emitted { files, errors })
}

/// A note for who gave no `--pass`: the material is written as it is, and these passes would apply.
fn nothing_asked_for(original: &Plan) -> String {
    let applies = |pass: &&&dyn AnyPass| {
        let sites = pass.sites(original, &Facts::default(), &serde_json::json!({}));
        sites.is_ok_and(|s| !s.sites.is_empty())
    };
    let names: Vec<&str> = PASSES
        .iter()
        .filter(applies)
        .map(|p| p.info().name)
        .collect();
    let material = &original.material;
    let list = match names.is_empty() {
        true => "none applies to it".to_owned(),
        false => format!("these apply to it: {}", names.join(", ")),
    };
    format!("note: no --pass is given, so `{material}` is written as it is; {list}")
}

/// The steps of `recipe` that apply to a material drawn in one frame with `frame`; what is refused is told on stderr and left out.
fn apply(original: &Plan, recipe: &Recipe, facts: &Facts, frame: &[Plan]) -> Plan {
    let mut plan = original.clone();
    for step in &recipe.steps {
        let one = Recipe {
            steps: vec![step.clone()],
        };
        let applied =
            one.apply(&plan, facts)
                .and_then(|next| match neighbours::conflict(&next, frame) {
                    None => Ok(next),
                    Some(refusal) => Err(Box::new(refusal)),
                });
        match applied {
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
