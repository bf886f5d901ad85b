//! `preshade explain`: where each pass applies, or why it does not.

use std::fmt;
use std::ops::ControlFlow;

use preshade::unstable::measure::{self, Detail, EffectUse, Session};
use preshade::unstable::parameters::parameters;
use preshade::unstable::passes::PASSES;
use preshade::unstable::passes::graph::Graph;
use preshade::unstable::passes::pass::{Change, Facts, Frequency, Left, Refusal};
use preshade::unstable::passes::plan::Plan;
use preshade::unstable::passes::specialize::effects::{self, CalledFor, Effect};
use preshade::unstable::pipeline;
use preshade::unstable::recipe::{Recipe, Step};
use preshade::unstable::render::{AdapterChoice, Gpu, ShaderForm};
use serde::Serialize;

use crate::explained;
use crate::guesses;
use crate::input::{Materials, ShaderArgs};
use crate::output;
use crate::view::ViewArgs;
use crate::{Ending, Failure, Format};

/// Arguments of `explain`.
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

#[derive(Serialize)]
struct Explanation {
    schema: &'static str,
    materials: Vec<Explained>,
}

/// A material and what each pass does to it.
#[derive(Serialize)]
pub struct Explained {
    pub material: String,
    pub stages: Vec<StageCost>,
    /// The effects that the scene's draws use, the most expensive first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectUse>,
    /// The code behind conditions that uniforms and constants decide, where no draw is known.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub switches: Vec<Effect>,
    pub passes: Vec<PassExplained>,
    /// By error against saved cost, the best first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub frequencies: Vec<Frequency>,
}

#[derive(Serialize)]
pub struct StageCost {
    pub stage: &'static str,
    pub entry_point: String,
    pub cost: f64,
    pub expressions: usize,
    pub effects: Vec<String>,
}

#[derive(Serialize)]
pub struct PassExplained {
    pub pass: String,
    pub summary: &'static str,
    pub hurts: &'static str,
    pub source: &'static str,
    /// The change that it makes; at most one.
    pub sites: Vec<Change>,
    /// What the change saves. `None`: it does not apply, or it saves no operations but fragments.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub saved: Option<Saved>,
    /// What it does within a budget, if it is refused without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub within_budget: Option<WithinBudget>,
    pub refusals: Vec<Refusal>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub left: Vec<Left>,
}

/// A pass with a budget.
#[derive(Serialize)]
pub struct WithinBudget {
    /// The recipe step.
    pub step: String,
    pub change: Change,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub saved: Option<Saved>,
}

/// The static cost that a stage of the main pass loses.
#[derive(Serialize)]
pub struct Saved {
    stage: &'static str,
    /// Operations saved.
    ops: f64,
    /// Operations before.
    of: f64,
}

/// The least share of a stage's static cost that is worth a pass.
pub const SMALL: f64 = measure::WORTH_A_LOOK;

/// The budget with which a pass is tried that is refused without one.
const BUDGET: f64 = 0.02;

impl Saved {
    /// `None`: `after` has more passes, so that its stages alone say little, or no stage costs less.
    fn between(before: &Plan, after: &Plan) -> Option<Self> {
        let passes = |plan: &Plan| (plan.passes.len(), plan.compute.len());
        if passes(before) != passes(after) {
            return None;
        }
        let (before, after) = (stages(before), stages(after));
        let stages = before.iter().zip(&after).map(|(a, b)| Self {
            stage: a.stage,
            ops: a.cost - b.cost,
            of: a.cost,
        });
        let best = stages.max_by(|a, b| a.share().total_cmp(&b.share()));
        best.filter(|s| s.ops > 0.0)
    }

    /// The share of the stage.
    pub fn share(&self) -> f64 {
        self.ops / self.of.max(1.0)
    }

    /// Whether it is too little to be worth a pass.
    pub fn is_small(&self) -> bool {
        self.share() < SMALL
    }
}

impl fmt::Display for Saved {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { stage, ops, of } = self;
        let percent = 100.0 * self.share();
        write!(
            f,
            "saves {ops:.0} of {of:.0} ops of the {stage} stage ({percent:.0} %)"
        )
    }
}

/// Which plan each pass is explained on.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Order {
    /// The original.
    Apart,
    /// The plan that the passes before it made.
    Chained,
}

/// Every pass, with its own defaults.
fn every_step() -> Result<Vec<Step>, Failure> {
    let steps = PASSES.iter().map(|p| Step::parse(p.info().name));
    Ok(steps.collect::<Result<_, _>>()?)
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
        let explained = explain(plan, &steps, known, frame, &[], Order::Apart)?;
        let Some((step, share)) = explained::largest(&explained, drawn) else {
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
    let steps = if args.passes.is_empty() {
        every_step()?
    } else {
        args.passes
            .iter()
            .map(|p| Step::parse(p))
            .collect::<Result<Vec<_>, _>>()?
    };
    let order = match args.passes.is_empty() {
        true => Order::Apart,
        false => Order::Chained,
    };
    let recipe = Recipe {
        steps: steps.clone(),
    };
    let Materials {
        asked: plans,
        frame,
        known,
        ..
    } = args.shader.plans(&recipe)?;
    if !args.scene && args.view.is_given() {
        return Err(Failure(
            "error: --camera and --size are for --scene: nothing else is drawn".to_owned(),
        ));
    }
    let effects = args.shader.effects()?;
    let mut materials: Vec<Explained> = Vec::new();
    let mut add = |facts: &Facts, plan: &Plan| -> Result<(), Failure> {
        let explained = explain(plan, &steps, facts, &frame, &effects, order)?;
        if args.format == Format::Human {
            let between = if materials.is_empty() { "" } else { "\n" };
            let text = match args.verbose || !args.passes.is_empty() {
                true => explained::all(&explained, plan),
                false => explained::brief(&explained),
            };
            output::data(&format!("{between}{text}"))?;
        }
        materials.push(explained);
        Ok(())
    };
    match args.scene {
        true => measured(args, &plans, &mut add)?,
        false => plans.iter().try_for_each(|plan| add(&known, plan))?,
    }
    if args.format == Format::Json {
        output::json(&Explanation {
            schema: "preshade.explain.v1",
            materials,
        })?;
    }
    Ok(Ending::Fine)
}

/// Size on a software adapter, if none is given: three materials then take less than a minute on
/// two cores.
const SOFTWARE_SIZE: [u32; 2] = [320, 180];

/// Measures the facts of a scene by drawing it, and hands over each plan as soon as the facts about
/// its material are complete.
fn measured(
    args: &ExplainArgs,
    plans: &[Plan],
    each: &mut dyn FnMut(&Facts, &Plan) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let scene = args
        .view
        .of(args.shader.on(args.adapter.as_deref()).scene()?)?;
    let choice = args
        .adapter
        .clone()
        .map_or(AdapterChoice::Best, AdapterChoice::Matching);
    let gpu = Gpu::with_trust(&choice, args.shader.limits.limits().trust())?;
    guesses::tell(&scene);
    let scene = args.view.reduced(scene, &gpu, SOFTWARE_SIZE);
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

fn explain(
    plan: &Plan,
    steps: &[Step],
    facts: &Facts,
    frame: &[Plan],
    uses: &[EffectUse],
    order: Order,
) -> Result<Explained, Failure> {
    let mut before = plan.clone();
    let mut frequencies: Vec<Frequency> = facts
        .frequencies
        .iter()
        .filter(|f| f.material == plan.material)
        .cloned()
        .collect();
    // One name at one place is one line, that with the least error for what it saves.
    frequencies.sort_by(|a, b| {
        let key = |f: &Frequency| f.flip_mean / f.cost.max(1.0);
        key(a).total_cmp(&key(b)).then(b.cost.total_cmp(&a.cost))
    });
    let mut named = Vec::new();
    frequencies.retain(|f| {
        let name = (f.name.clone(), f.location.clone());
        let is_new = !named.contains(&name);
        named.push(name);
        is_new
    });
    let uses: Vec<EffectUse> = uses
        .iter()
        .filter(|e| e.material == plan.material)
        .cloned()
        .collect();
    let switches = match uses.is_empty() {
        true => effects::effects(plan, facts),
        false => Ok(Vec::new()),
    };
    // A condition that is known, or that no value of the host decides, is no switch.
    let is_switch = |e: &Effect| e.called_for == CalledFor::Open && e.name != effects::UNNAMED;
    Ok(Explained {
        frequencies,
        material: plan.material.clone(),
        effects: uses,
        switches: switches
            .unwrap_or_default()
            .into_iter()
            .filter(is_switch)
            .collect(),
        stages: stages(plan),
        passes: steps
            .iter()
            .map(|step| {
                let Some(pass) = preshade::unstable::passes::pass_named(&step.pass) else {
                    return Err(Failure(format!("error: no pass `{}`", step.pass)));
                };
                let info = pass.info();
                let mut explained = PassExplained {
                    pass: step.to_string(),
                    summary: info.summary,
                    hurts: info.hurts,
                    source: info.source,
                    sites: Vec::new(),
                    saved: None,
                    within_budget: None,
                    refusals: Vec::new(),
                    left: Vec::new(),
                };
                match pipeline::run(step, &before, frame, facts) {
                    Ok(done) => {
                        explained.saved = Saved::between(&before, &done.plan);
                        explained.sites = vec![done.change];
                        explained.left = done.left;
                        if order == Order::Chained {
                            before = done.plan;
                        }
                    }
                    Err(refused) => {
                        explained.refusals = refused.refusals;
                        explained.left = refused.left;
                        explained.within_budget = within_budget(step, &before, frame, facts);
                    }
                }
                Ok(explained)
            })
            .collect::<Result<_, _>>()?,
    })
}

/// What a refused step does with a budget. `None`: it has no such parameter, has one already, or is
/// refused all the same.
fn within_budget(step: &Step, plan: &Plan, frame: &[Plan], facts: &Facts) -> Option<WithinBudget> {
    let pass = preshade::unstable::passes::pass_named(&step.pass)?;
    let takes = parameters(pass).iter().any(|p| p.name == "budget");
    if !takes || step.params.contains_key("budget") {
        return None;
    }
    let mut step = step.clone();
    step.params.insert("budget".to_owned(), BUDGET.into());
    let done = pipeline::run(&step, plan, frame, facts).ok()?;
    Some(WithinBudget {
        step: step.to_string(),
        saved: Saved::between(plan, &done.plan),
        change: done.change,
    })
}

fn stages(plan: &Plan) -> Vec<StageCost> {
    let Some((pass, program)) = plan.main().and_then(|p| Some((p, plan.program(p)?))) else {
        return Vec::new();
    };
    let graph = Graph::build(program);
    let mut stages = Vec::new();
    for (stage, word, name) in [
        (
            preshade::unstable::passes::naga::ShaderStage::Vertex,
            "vertex",
            Some(&pass.vertex),
        ),
        (
            preshade::unstable::passes::naga::ShaderStage::Fragment,
            "fragment",
            pass.fragment.as_ref(),
        ),
    ] {
        let Some((index, entry)) = name.and_then(|n| program.entry_point(stage, n)) else {
            continue;
        };
        stages.push(StageCost {
            stage: word,
            entry_point: entry.name.clone(),
            cost: graph.entry_cost(index),
            expressions: entry.function.expressions.len(),
            effects: graph.entry_effects(index),
        });
    }
    stages
}

#[cfg(test)]
mod tests {
    use preshade::unstable::passes::pass::{Site, SiteCost};
    use preshade::unstable::passes::plan::Role;

    use super::*;

    fn pass(name: &str, ops: f64) -> PassExplained {
        PassExplained {
            pass: name.to_owned(),
            summary: "",
            hurts: "",
            source: "",
            sites: vec![Change {
                key: Site {
                    role: Role::Main,
                    entry_point: "fs".to_owned(),
                    slice: String::new(),
                },
                what: String::new(),
                location: None,
                cost: SiteCost::default(),
            }],
            saved: Some(Saved {
                stage: "fragment",
                ops,
                of: 100.0,
            }),
            within_budget: None,
            refusals: Vec::new(),
            left: Vec::new(),
        }
    }

    #[test]
    fn the_largest_saving_that_was_not_drawn_is_told() {
        let explained = Explained {
            material: "m".to_owned(),
            stages: Vec::new(),
            effects: Vec::new(),
            switches: Vec::new(),
            passes: vec![
                pass("hoist", 20.0),
                pass("early-alpha", 40.0),
                pass("b", 4.0),
            ],
            frequencies: Vec::new(),
        };
        let told = |drawn: &[&str]| explained::largest(&explained, drawn).map(|(step, _)| step);
        assert_eq!(
            told(&["early-alpha"]).as_deref(),
            Some("hoist, which saves 20 of 100 ops of the fragment stage (20 %)")
        );
        // Less than 5 % is no hint.
        assert_eq!(told(&["early-alpha", "hoist"]), None);
    }
}
