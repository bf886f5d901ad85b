//! The pipeline: source text and a recipe in; plans, refusals and files out.
//!
//! Every command, build script, lock file and search applies its recipes here, with one policy: a
//! refused step is skipped and reported, and the next step is tried on the plan so far.

use preshade_passes::analysis::{neighbours, refusals};
use preshade_plan::pass::{Facts, Outcome, Refusal, Refused};
use preshade_plan::plan::Plan;
use preshade_plan::state::MaterialState;
use shader_text::options;
use shader_text::refusals::RefusalInfo;

use crate::emit;
use crate::front::{self, Parsed};
use crate::recipe::{Recipe, Step};
use preshade_plan::plan_file::Target;
use shader_text::files::File;

/// A material's source, and how to read it.
#[derive(Clone, Copy, Debug)]
pub struct Shader<'a> {
    /// Name of the material. It begins the names of the emitted files.
    pub name: &'a str,
    /// One WGSL file, or a vertex and a fragment file.
    pub sources: &'a [front::Source],
    pub options: &'a options::Options,
    /// The pipeline state that the material is drawn with.
    pub state: &'a MaterialState,
}

#[derive(Debug)]
pub struct Output {
    /// The variant. `plan.steps` lists the applied steps; without any, it is the original.
    pub plan: Plan,
    pub skipped: Vec<Skipped>,
    /// The emitted shaders and `plan.json`.
    pub files: Vec<File>,
    /// One error for each target that cannot express the variant.
    pub errors: Vec<emit::EmitError>,
}

/// Parses a shader, applies `recipe` and emits the variant for each target.
///
/// # Errors
/// The shader cannot be parsed. Refused steps and failed targets are part of the [`Output`].
pub fn rewrite(
    shader: Shader<'_>,
    recipe: &Recipe,
    facts: &Facts,
    targets: &[Target],
) -> Result<Output, shader_text::error::Error> {
    let original = front::parse(shader.sources, shader.options)?.plan(shader.name, shader.state);
    let (plan, skipped) = apply(&original, recipe, facts);
    let (files, errors) = emit(&plan, targets);
    Ok(Output {
        plan,
        skipped,
        files,
        errors,
    })
}

impl Parsed {
    /// The plan that draws the shader as written.
    pub fn plan(self, name: &str, state: &MaterialState) -> Plan {
        let fragment = self.fragment.as_deref();
        Plan::original(name, self.program, &self.vertex, fragment, state)
    }
}

#[derive(Clone, Debug)]
pub struct Skipped {
    /// Name of the material that refused it.
    pub material: String,
    pub step: Step,
    /// The reason, with its remedy.
    pub refusal: Box<Refusal>,
}

/// Materials to rewrite, and the frame that they are drawn in.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    pub materials: &'a [Plan],
    /// The originals of the whole frame, `materials` among them.
    pub neighbours: &'a [Plan],
}

/// The plan after a step, or its refusal.
pub type Applied = Result<Plan, Box<Refusal>>;

/// Sees each result, with the step and the plan before it. Returns whether a new plan is taken: a
/// caller that has conditions of its own skips the step with `false`, and reports it.
pub(crate) type Inspect<'f> = dyn FnMut(&Step, &Plan, &Applied) -> bool + 'f;

/// Applies `recipe` to one material on its own.
pub fn apply(original: &Plan, recipe: &Recipe, facts: &Facts) -> (Plan, Vec<Skipped>) {
    let frame = Frame {
        materials: std::slice::from_ref(original),
        neighbours: &[],
    };
    let (mut plans, skipped) = apply_in(frame, recipe, facts, &mut |_, _, _| true);
    (plans.remove(0), skipped)
}

impl Recipe {
    /// Applies every step to a material on its own, for callers that need all of them. It ends at
    /// the first refusal.
    ///
    /// # Errors
    /// The first refusal. A step that would change other code than was recorded is refused as `stale`.
    pub fn apply(&self, plan: &Plan, facts: &Facts) -> Applied {
        self.steps.iter().try_fold(plan.clone(), |plan, step| {
            let steps = vec![step.clone()];
            let (plan, skipped) = apply(&plan, &Self { steps }, facts);
            match skipped.into_iter().next() {
                None => Ok(plan),
                Some(first) => Err(first.refusal),
            }
        })
    }
}

/// The latest step before which the refused step `at` of a recipe would be taken, along with all that
/// were taken before it. `None`: the order is not to blame.
pub fn earlier(
    original: &Plan,
    neighbours: &[Plan],
    recipe: &Recipe,
    at: usize,
    facts: &Facts,
) -> Option<usize> {
    let applied = |plan: &Plan, step: &Step| Some(run(step, plan, neighbours, facts).ok()?.plan);
    // Of each taken step, its number and the plan before it.
    let mut taken: Vec<(usize, Plan)> = Vec::new();
    let mut plan = original.clone();
    for (n, step) in recipe.steps[..at].iter().enumerate() {
        if let Some(next) = applied(&plan, step) {
            taken.push((n, std::mem::replace(&mut plan, next)));
        }
    }
    let fits = |from: &usize| {
        let moved = applied(&taken[*from].1, &recipe.steps[at]);
        let mut rest = taken[*from..].iter();
        rest.try_fold(moved?, |plan, (n, _)| applied(&plan, &recipe.steps[*n]))
    };
    let from = (0..taken.len()).rev().find(|from| fits(from).is_some())?;
    Some(taken[from].0)
}

/// Applies `recipe` to the materials of a frame, step by step. Returns their plans in order, and the
/// skipped steps. A step is also refused if the frame cannot be drawn with its result.
pub fn apply_in(
    frame: Frame<'_>,
    recipe: &Recipe,
    facts: &Facts,
    inspect: &mut Inspect<'_>,
) -> (Vec<Plan>, Vec<Skipped>) {
    let mut plans = frame.materials.to_vec();
    let mut skipped = Vec::new();
    for step in &recipe.steps {
        let tried = |plan: &Plan| run(step, plan, frame.neighbours, facts);
        let both = plans.iter().zip(frame.materials);
        let results = both.map(|(plan, original)| match tried(plan) {
            Ok(outcome) => Ok(outcome.plan),
            Err(refused) => Err(of_material(refused, || tried(original)).first()),
        });
        let results: Vec<Applied> = results.collect();
        let drawn = results.iter().zip(&plans);
        let drawn: Vec<Plan> = drawn
            .map(|(r, p)| r.as_ref().unwrap_or(p).clone())
            .collect();
        let tied = |plan: Plan| match neighbours::tied(&plan, &drawn, facts.depth_ties) {
            Some(refusal) => Err(Box::new(refusal)),
            None => Ok(plan),
        };
        let results = results.into_iter().map(|result| result.and_then(tied));
        for (plan, result) in plans.iter_mut().zip(results) {
            let is_taken = inspect(step, plan, &result);
            match result {
                Ok(next) if is_taken => *plan = next,
                Ok(_) => {}
                Err(refusal) => skipped.push(Skipped {
                    material: plan.material.clone(),
                    step: step.clone(),
                    refusal,
                }),
            }
        }
    }
    (plans, skipped)
}

/// The refusal of a step that earlier steps prevent. If the material refuses it on its own too,
/// this is the material's refusal, for then no other order helps.
fn of_material(refused: Refused, alone: impl FnOnce() -> Result<Outcome, Refused>) -> Refused {
    let is_order = |r: &Refusal| ORDERS.iter().any(|info| info.code == r.code);
    match refused.refusals.first().is_some_and(is_order) {
        true => alone().err().unwrap_or(refused),
        false => refused,
    }
}

/// The refusals that blame the steps before.
const ORDERS: [&RefusalInfo; 2] = [&refusals::NOT_FIRST, &refusals::HAS_PREPASS];

/// Runs one step on a material. It is also refused if its result conflicts with the `neighbours` as
/// written.
///
/// # Errors
/// Every reason.
pub fn run(
    step: &Step,
    plan: &Plan,
    neighbours: &[Plan],
    facts: &Facts,
) -> Result<Outcome, Refused> {
    let outcome = step.run(plan, facts)?;
    match neighbours::conflict(&outcome.plan, neighbours) {
        None => Ok(outcome),
        Some(refusal) => Err(Refused {
            refusals: vec![refusal],
            left: outcome.left,
        }),
    }
}

/// Emits `plan` for each target that can express it, with one `plan.json`. Returns the files, and
/// an error for each of the other targets.
pub fn emit(plan: &Plan, targets: &[Target]) -> (Vec<File>, Vec<emit::EmitError>) {
    let options = emit::Options::default();
    let (files, _, errors) = emit_by(targets, |targets| {
        Ok((emit::emit(plan, targets, &options)?, Vec::new()))
    });
    (files, errors)
}

/// Files, a sentence on each that was not compared, and the errors of targets.
type Compared = (Vec<File>, Vec<String>, Vec<emit::EmitError>);

/// As [`emit()`], byte for byte, and compares the meaning of each text with its program: a few
/// milliseconds each.
pub fn emit_compared(plan: &Plan, targets: &[Target]) -> Compared {
    let options = emit::Options::default();
    emit_by(targets, |targets| {
        emit::emit_compared(plan, targets, &options, emit::Meaning::QUICK)
    })
}

fn emit_by(
    targets: &[Target],
    emit: impl Fn(&[Target]) -> Result<(Vec<File>, Vec<String>), emit::EmitError>,
) -> Compared {
    if let Ok((files, uncompared)) = emit(targets) {
        return (files, uncompared, Vec::new());
    }
    let (mut able, mut errors) = (Vec::new(), Vec::new());
    for target in targets {
        match emit(&[*target]) {
            Ok(_) => able.push(*target),
            Err(error) => errors.push(error),
        }
    }
    // Without any target there is no plan.json either.
    if able.is_empty() {
        return (Vec::new(), Vec::new(), errors);
    }
    match emit(&able) {
        Ok((files, uncompared)) => (files, uncompared, errors),
        Err(error) => {
            errors.push(error);
            (Vec::new(), Vec::new(), errors)
        }
    }
}
