//! `preshade explain`: where each pass applies, or why it does not.

use std::ops::ControlFlow;

use preshade_compiler::command::explain::{
    self, Explained, Explanation, Order, every_step, explain,
};
use preshade_compiler::command::explain_text;
use preshade_compiler::command::rewrite::draws_depth_alone;
use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::Scene;
use preshade_lab::measure::{self, Detail, Session};
use preshade_passes::transforms::specialize::SpecializeParams;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_scenes::ShaderForm;

use crate::input::{Materials, ShaderArgs};
use crate::view::ViewArgs;
use crate::{Ending, Failure, Format, guesses, materials, output, worker};

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade explain lit.wgsl
  preshade explain lit.vert lit.frag --depth-format depth24plus --blend alpha
  preshade explain lit.wgsl --pass depth-prepass:form=equal --format json
  preshade explain scene.toml                       every material of a scene
  preshade explain scene.toml --scene --pass hoist:budget=0.01 --camera wall --size 640x360
                                                    what can be interpolated, measured on the scene

At most ten lines a material, the largest saving first. With -v or --pass: where each pass applies,
or why not, and what would make it legal. A refusal is no failure (exit status 0).
Static cost is in scalar operations, weighted: an addition of two floats is 1 op, a division 4, a
texture sample 32 (the whole table: the module `graph::cost`). A site is the hash of its slice.")]
pub struct ExplainArgs {
    /// Explain these passes, with these parameters, each after those before it; default: all
    /// passes, each on its own.
    #[arg(long = "pass", value_name = "NAME[:k=v,..]")]
    passes: Vec<String>,
    /// Draw the scene (for a shader, one is made up) and tell what each value of a fragment stage
    /// would cost the picture if it were interpolated from the vertices.
    #[arg(long)]
    scene: bool,
    /// Part of an adapter's name, driver or backend, for --scene.
    #[arg(long, value_name = "TEXT", requires = "scene")]
    adapter: Option<String>,
    #[command(flatten)]
    view: ViewArgs,
    /// Everything about every pass, with the reasons of refusals and the sources.
    #[arg(short, long)]
    verbose: bool,
    /// Output form.
    #[arg(long, value_enum, default_value_t = Format::Human)]
    format: Format,
    // Last, because its help heading applies to all following arguments.
    #[command(flatten)]
    pub shader: ShaderArgs,
}

/// The step with the largest static saving that is none of the passes in `drawn`, in words. `None`:
/// none saves enough to be worth a look.
pub fn largest_saving(shader: &ShaderArgs, drawn: &[&str]) -> Result<Option<String>, Failure> {
    let steps = every_step()?;
    let materials = shader.plans(&Recipe {
        steps: steps.clone(),
    })?;
    let mut best: Option<(String, f64)> = None;
    for plan in &materials.asked {
        let (known, frame) = (&materials.known, &materials.frame);
        let explained = explain(plan, &steps, known, frame, &[], Order::Apart);
        let Some((step, share)) = explain_text::largest(&explained, drawn) else {
            continue;
        };
        if best.as_ref().is_none_or(|(_, most)| share > *most) {
            let step = match materials.asked.len() {
                1 => step,
                _ => format!("{step} of `{}`", plan.material),
            };
            best = Some((step, share));
        }
    }
    Ok(best.map(|(step, _)| step))
}

/// Explains a material, or every material of a scene.
pub fn run(args: &ExplainArgs) -> Result<Ending, Failure> {
    let (steps, order) = explain::steps(&Recipe::parse(&args.passes)?)?;
    let recipe = Recipe {
        steps: steps.clone(),
    };
    let Materials {
        asked: plans,
        frame,
        known,
        scene,
        ..
    } = match order {
        // As `rewrite` takes it.
        Order::Chained => args.shader.plans_by_draws(&recipe)?,
        Order::Apart => args.shader.plans(&recipe)?,
    };
    if !args.scene && args.view.is_given() {
        return Err(Failure(
            "error: --camera and --size are for --scene: nothing else is drawn".to_owned(),
        ));
    }
    let stages = materials::between(&args.shader.files);
    stages.iter().for_each(|note| output::message(note));
    if scene.is_none() {
        let depth_alone = plans.iter().filter_map(draws_depth_alone);
        depth_alone.for_each(|note| output::message(&note));
    }
    let effects = args.shader.effects()?;
    let mut materials: Vec<Explained> = Vec::new();
    let mut groups: Option<Groups> = None;
    let mut add = |facts: &Facts, plan: &Plan| -> Result<(), Failure> {
        let mut explained = explain(plan, &steps, facts, &frame, &effects, order);
        if let (true, Some(scene)) = (explained.is_general(), &scene) {
            let groups = match &mut groups {
                Some(groups) => groups,
                none => none.insert(Groups::of(scene)?),
            };
            let own = groups.of_material(&plan.material);
            explained = explained.with_groups(&own, &groups.plans, &groups.known);
        }
        if args.format == Format::Human {
            let between = if materials.is_empty() { "" } else { "\n" };
            let text = match args.verbose || !args.passes.is_empty() {
                true => explain_text::all(&explained, plan),
                false => explain_text::brief(&explained),
            };
            output::data(&format!("{between}{text}"))?;
        }
        materials.push(explained);
        Ok(())
    };
    match args.scene {
        true => measured(args, &recipe, &plans, &mut add)?,
        false => plans.iter().try_for_each(|plan| add(&known, plan))?,
    }
    if args.format == Format::Json {
        output::json(&Explanation::from(materials))?;
    }
    Ok(Ending::Fine)
}

/// A scene whose draws are split into groups that need versions of their own.
struct Groups {
    scene: Scene,
    plans: Vec<Plan>,
    known: Facts,
}

impl Groups {
    fn of(scene: &Scene) -> Result<Self, Failure> {
        let scene = measure::grouped(scene, &SpecializeParams::default(), measure::MOST_GROUPS)?;
        Ok(Self {
            plans: measure::originals(&scene),
            known: measure::known(&scene),
            scene,
        })
    }

    fn of_material(&self, name: &str) -> Vec<&Plan> {
        let all = self.scene.materials.iter().zip(&self.plans);
        all.filter(|(m, _)| m.part_of.as_deref() == Some(name))
            .map(|(_, plan)| plan)
            .collect()
    }
}

/// Size on a software adapter, if none is given: three materials then take less than a minute on
/// two cores.
const SOFTWARE_SIZE: [u32; 2] = [320, 180];

/// Measures the facts of a scene by drawing it, and hands over each plan as soon as the facts about
/// its material are complete.
fn measured(
    args: &ExplainArgs,
    recipe: &Recipe,
    plans: &[Plan],
    each: &mut dyn FnMut(&Facts, &Plan) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let scene = args
        .view
        .of(args.shader.on(args.adapter.as_deref()).scene()?)?;
    let gpu = worker::open(args.adapter.as_deref(), &args.shader.limits.limits())?;
    guesses::tell(&scene);
    let scene = args.view.reduced(scene, &gpu, SOFTWARE_SIZE);
    let scene = match args.passes.is_empty() {
        true => scene,
        false => measure::grouped_for(scene, recipe)?,
    };
    let session = Session::sharing(&gpu, &scene, ShaderForm::Text)?;
    let bar = output::bar();
    bar.set_message("looking for depth ties");
    let facts = measure::facts(&session)?;
    bar.set_message("measuring what can be interpolated");
    let at = |plan: &Plan| {
        let mut materials = scene.materials.iter();
        materials.position(|m| m.name == plan.material)
    };
    let mut left = plans.iter().peekable();
    let mut failed = Ok(());
    measure::frequencies(&session, &facts, Detail::Table, &mut |step| {
        bar.set_position((step.done * 1000.0) as u64);
        while let Some(plan) = left.next_if(|plan| at(plan).is_none_or(|i| i < step.complete)) {
            let known = Facts {
                frequencies: step.measured.to_vec(),
                ..facts.clone()
            };
            bar.suspend(|| failed = each(&known, plan));
            if failed.is_err() {
                return ControlFlow::Break(());
            }
        }
        ControlFlow::Continue(())
    })?;
    bar.finish_and_clear();
    failed
}
