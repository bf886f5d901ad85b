//! `preshade verify` of many inputs: which promises hold on this adapter, one line an input.
//!
//! A promise is a recipe applied to a material. Each input is measured by a process of its own, so
//! that a crash, a hang or a lost device costs one input.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::Mutex;

use preshade_compiler::emit;
use preshade_compiler::recipe::Recipe;
use preshade_compiler::sweep::Sweep;
use preshade_draw::render::{AdapterReport, Gpu};
use preshade_draw::scene::Scene;
use preshade_lab::measure::record::{Report, VariantReport};
use preshade_lab::measure::{self, Session, Timed, Variant};
use preshade_lab::report::html::promise;
use preshade_lab::search::candidates;
use preshade_lab::verify::grouped;
use preshade_passes::transforms::specialize::Specialize;
use preshade_plan::contract::{Contract, Verdict};
use preshade_plan::pass::{Facts, Pass};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_scenes::Variables;
use serde::{Deserialize, Serialize};

use crate::materials::{Chosen, Job};
use crate::verify::{self, VerifyArgs};
use crate::{Ending, Failure, Table, flags, output, worker};

/// Most variants to draw together. Each keeps its compiled pipelines until its last view is drawn,
/// which are gigabytes for a large scene on a driver that runs on the CPU.
const AT_ONCE: usize = 16;

struct Recipes<'a> {
    /// Given by the user.
    given: &'a [Recipe],
    /// Declared by passes, without recipes whose parameters name something that no material of an
    /// input has.
    declared: Vec<Recipe>,
}

/// The promises of one input.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Promises {
    input: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    adapter: Option<AdapterReport>,
    /// Promises that every compared view keeps.
    held: usize,
    /// Recipes with a step that the material refuses.
    refused: usize,
    /// Promises that no picture could test.
    not_measured: usize,
    /// Reasons for `not_measured`, with the number of promises.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    why: BTreeMap<String, usize>,
    broken: Vec<Finding>,
    /// Declared recipes whose budget nobody measured before and that exceed it here.
    over_budget: Vec<Finding>,
    /// Why it was not drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    failed: Option<String>,
    /// Why a file of a folder is left out: it is not one material.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    left_out: Option<String>,
}

/// A variant whose picture breaks its contract.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Finding {
    variant: String,
    /// The materials that it changed.
    materials: Vec<String>,
    contract: Contract,
    /// The view, and how the picture differs there.
    r#where: String,
    /// The worst of all views.
    changed_pixels: u64,
    changed_depth: u64,
    /// Infinite is `null` in JSON.
    max_abs: Option<f64>,
    flip_mean: f64,
    /// The command that shows it alone.
    command: String,
}

/// The result of a run.
#[derive(Serialize)]
struct Summary<'a> {
    schema: &'static str,
    command: String,
    adapter: Option<&'a AdapterReport>,
    held: usize,
    refused: usize,
    not_measured: usize,
    over_budget: usize,
    broken: usize,
    failed: usize,
    inputs: &'a [Promises],
}

/// Measures each job with the recipes of `sweeps`, and with `--every-pass` the declared ones.
pub fn run(args: &VerifyArgs, jobs: &[Job], sweeps: &[Sweep]) -> Result<Ending, Failure> {
    args.check_many(false)?;
    let given = verify::recipes(sweeps);
    let mut declared = match args.every_pass {
        true => candidates::every_pass()?,
        false => Vec::new(),
    };
    declared.retain(|recipe| !given.contains(recipe));
    let recipes = Recipes {
        given: &given,
        declared,
    };
    if let Some(n) = worker::mine() {
        let job = n.checked_sub(1).and_then(|n| jobs.get(n));
        let job = job.ok_or_else(|| Failure("error: there is no such input".to_owned()))?;
        output::json(&measured(args, job, &recipes))?;
        return Ok(Ending::Fine);
    }
    let results = Results::new(args, jobs);
    let limits = args.shader.limits.limits();
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    worker::each(threads, jobs, |index, job| {
        let found = worker::run(index + 1, &limits, worker::OF_AN_INPUT)
            .and_then(|text| worker::printed::<Promises>(&text));
        let found = found.unwrap_or_else(|why| Promises {
            input: named(job),
            failed: Some(why),
            ..Promises::default()
        });
        results.add(index, found);
        ControlFlow::Continue(())
    });
    results.end(args)
}

/// The files of a job, as in a command.
fn named(job: &Job) -> String {
    shell_words::join(job.shader.files.iter().map(|f| f.display().to_string()))
}

/// Results, printed in the order of the inputs as soon as all before are there.
struct Results {
    human: bool,
    /// Width of the first column.
    width: usize,
    state: Mutex<(usize, Vec<Option<Promises>>)>,
}

impl Results {
    fn new(args: &VerifyArgs, jobs: &[Job]) -> Self {
        let names = jobs.iter().map(|j| named(j).chars().count());
        let results = Self {
            human: args.format == Table::Human,
            width: names.max().unwrap_or(0),
            state: Mutex::new((0, vec![None; jobs.len()])),
        };
        let head = ["held", "refused", "not measured", "over budget", "broken"];
        let head = results.row("input", head);
        results.print(&head);
        results
    }

    fn row(&self, name: &str, counts: [&str; 5]) -> String {
        let [held, refused, not_measured, over, broken] = counts;
        let width = self.width;
        format!(
            "{name:<width$}  {held:>5}  {refused:>7}  {not_measured:>12}  {over:>11}  {broken:>6}"
        )
    }

    /// Prints a part of the table. Errors are ignored here: the summary reports a stdout that is full.
    fn print(&self, text: &str) {
        if self.human {
            let _ = output::table(text);
        }
    }

    fn add(&self, index: usize, promises: Promises) {
        let mut state = self.state.lock().unwrap_or_else(|e| e.into_inner());
        let (shown, all) = &mut *state;
        if let Some(place) = all.get_mut(index) {
            *place = Some(promises);
        }
        while let Some(Some(promises)) = all.get(*shown) {
            *shown += 1;
            self.print(&self.lines(promises));
        }
    }

    /// The line of an input, and those of its broken promises.
    fn lines(&self, promises: &Promises) -> String {
        let first_line = |why: &str| why.lines().next().unwrap_or_default().to_owned();
        if let Some(why) = &promises.left_out {
            return format!("{}: left out: {}", promises.input, first_line(why));
        }
        if let Some(why) = &promises.failed {
            return format!("{}: NOT DRAWN: {}", promises.input, first_line(why));
        }
        let counts = [
            promises.held,
            promises.refused,
            promises.not_measured,
            promises_of(&promises.over_budget),
            promises_of(&promises.broken),
        ]
        .map(|n| n.to_string());
        let mut lines = vec![self.row(&promises.input, counts.each_ref().map(String::as_str))];
        for broken in &promises.broken {
            lines.push(format!(
                "  BROKEN {}: {}; worst of all views: {} pixels, {} depths, max abs {}",
                broken.variant,
                broken.r#where,
                broken.changed_pixels,
                broken.changed_depth,
                broken
                    .max_abs
                    .map_or("infinite".to_owned(), |m| format!("{m:.4}")),
            ));
            lines.push(format!("    promised: {}", promise(&broken.contract)));
            lines.push(format!("    {}", broken.command));
        }
        lines.join("\n")
    }

    fn end(self, args: &VerifyArgs) -> Result<Ending, Failure> {
        let (_, all) = self.state.into_inner().unwrap_or_else(|e| e.into_inner());
        let inputs: Vec<Promises> = all.into_iter().flatten().collect();
        let sum = |of: &dyn Fn(&Promises) -> usize| inputs.iter().map(of).sum::<usize>();
        let summary = Summary {
            schema: "preshade.promises.v1",
            command: verify::command(),
            adapter: inputs.iter().find_map(|p| p.adapter.as_ref()),
            held: sum(&|p| p.held),
            refused: sum(&|p| p.refused),
            not_measured: sum(&|p| p.not_measured),
            over_budget: sum(&|p| promises_of(&p.over_budget)),
            broken: sum(&|p| promises_of(&p.broken)),
            failed: sum(&|p| usize::from(p.failed.is_some())),
            inputs: &inputs,
        };
        match args.format {
            Table::Human => output::table(&summary.line())?,
            Table::Json | Table::Csv => output::json(&summary)?,
        }
        match summary.failed {
            _ if summary.broken > 0 => Ok(Ending::ContractBroken),
            0 if summary.held == 0 => Ok(Ending::NotMeasured),
            0 => Ok(Ending::Fine),
            n => Err(Failure(format!(
                "error: {} could not be drawn",
                output::count(n, "input")
            ))),
        }
    }
}

impl Summary<'_> {
    fn line(&self) -> String {
        let adapter = self
            .adapter
            .map_or(String::new(), |a| format!(" on {} ({})", a.name, a.driver));
        let mut why: BTreeMap<&str, usize> = BTreeMap::new();
        for (reason, n) in self.inputs.iter().flat_map(|p| &p.why) {
            *why.entry(reason).or_default() += n;
        }
        let why: Vec<String> = why
            .into_iter()
            .map(|(reason, n)| format!("  {n} not measured: {reason}\n"))
            .collect();
        format!(
            "\n{}Promises{adapter}, each a recipe applied to a material: {} held, {} refused, {} not \
             measured, {} over the budget of an example, {} broken; {} not drawn",
            why.concat(),
            self.held,
            self.refused,
            self.not_measured,
            self.over_budget,
            self.broken,
            output::count(self.failed, "input"),
        )
    }
}

/// The number of promises: one for each changed material.
fn promises_of(findings: &[Finding]) -> usize {
    findings.iter().map(|f| f.materials.len()).sum()
}

struct JudgedVariant {
    variant: Variant,
    /// Whether its budget, if it has one, is the user's, or was chosen by measurement. If not, it
    /// comes from an example.
    is_budget_kept: bool,
    /// Its place among the variants that are drawn.
    drawn: usize,
}

impl Promises {
    /// Adds a variant and its measurement. `untested`: why no verdict of this input counts.
    fn add(
        &mut self,
        judged: &JudgedVariant,
        report: &VariantReport,
        untested: Option<&str>,
        command: &dyn Fn(&str) -> String,
    ) {
        let variant = &judged.variant;
        let is_whole = |plan: &&Plan| variant.kept.iter().all(|k| k.material != plan.material);
        let whole = variant.plans.iter().filter(is_whole).count();
        let why = match (&report.verdict, untested) {
            (Verdict::Broken { r#where }, _) => {
                let changed = variant.plans.iter().filter(|p| !p.steps.is_empty());
                let materials: Vec<String> = changed.map(|p| p.material.clone()).collect();
                self.refused += variant.plans.len() - materials.len();
                let finding = Finding::new(variant, materials, r#where, report, command);
                let is_asked = !judged.is_budget_kept && !report.contract.budgets().is_empty();
                match is_asked {
                    true => self.over_budget.push(finding),
                    false => self.broken.push(finding),
                }
                return;
            }
            (Verdict::Holds, None) => None,
            (Verdict::Holds, Some(why)) => Some(why),
            (Verdict::NotMeasured { why }, _) => Some(why.as_str()),
        };
        self.refused += variant.plans.len() - whole;
        match why {
            None => self.held += whole,
            Some(_) if whole == 0 => {}
            Some(why) => {
                self.not_measured += whole;
                *self.why.entry(why.to_owned()).or_default() += whole;
            }
        }
    }
}

impl Finding {
    fn new(
        variant: &Variant,
        materials: Vec<String>,
        r#where: &str,
        report: &VariantReport,
        command: &dyn Fn(&str) -> String,
    ) -> Self {
        let error = report.error.clone().unwrap_or_default();
        Self {
            variant: variant.name.clone(),
            materials,
            contract: report.contract.clone(),
            r#where: r#where.to_owned(),
            changed_pixels: error.changed_pixels,
            changed_depth: error.changed_depth,
            max_abs: Some(error.max_abs).filter(|m| m.is_finite()),
            flip_mean: error.flip_mean,
            command: command(&variant.name),
        }
    }
}

/// Measures one job. A failure is part of the result.
fn measured(args: &VerifyArgs, job: &Job, recipes: &Recipes<'_>) -> Promises {
    let mut promises = Promises {
        input: named(job),
        ..Promises::default()
    };
    let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        measure_into(&mut promises, args, job, recipes)
    }));
    match result {
        Ok(Ok(())) => {}
        Ok(Err(Failure(why))) if is_left_out(job, &why) => promises.left_out = Some(why),
        Ok(Err(Failure(why))) => promises.failed = Some(why),
        Err(panic) => {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
            promises.failed = Some(format!("preshade panicked: {}", text.unwrap_or_default()));
        }
    }
    promises
}

/// Whether a file of a folder is not one material: it has no entry points, or those of several.
pub fn is_left_out(job: &Job, why: &str) -> bool {
    let is_ambiguous = why.starts_with("error[ambiguous-entry-point]");
    job.chosen == Chosen::Found && (is_ambiguous || job.shader.is_no_material())
}

fn measure_into(
    promises: &mut Promises,
    args: &VerifyArgs,
    job: &Job,
    recipes: &Recipes<'_>,
) -> Result<(), Failure> {
    let scene = verify::scene(args, &job.shader, &Variables::new())?;
    let originals = measure::originals(&scene);
    let named = |recipe: &&Recipe| recipe.check_names(&originals).is_ok();
    let given = recipes.given;
    for recipe in given {
        recipe.check_names(&originals)?;
    }
    let declared = recipes.declared.iter().filter(named);
    let recipes = given.iter().chain(declared);
    let specialises = |r: &&Recipe| r.steps.iter().any(|s| s.pass == Specialize::INFO.name);
    let (special, plain): (Vec<&Recipe>, Vec<&Recipe>) = recipes.partition(specialises);
    let gpu = verify::open(args)?;
    promises.adapter = Some(gpu.adapter().clone());
    let groups = match special.is_empty() {
        true => scene.clone(),
        false => {
            let special: Vec<Recipe> = special.iter().copied().cloned().collect();
            grouped(scene.clone(), &special)?
        }
    };
    // Draws that need versions of their own are materials of their own, to `specialize` alone.
    match groups.materials.len() == scene.materials.len() {
        true => {
            let all: Vec<&Recipe> = plain.into_iter().chain(special).collect();
            measure_scene(promises, args, job, &gpu, &scene, (given, &all))
        }
        false => {
            measure_scene(promises, args, job, &gpu, &scene, (given, &plain))?;
            measure_scene(promises, args, job, &gpu, &groups, (given, &special))
        }
    }
}

/// Measures `recipes`, the `given` ones among them, on a scene. A frame that several of them draw is
/// drawn once.
fn measure_scene(
    promises: &mut Promises,
    args: &VerifyArgs,
    job: &Job,
    gpu: &Gpu,
    scene: &Scene,
    (given, recipes): (&[Recipe], &[&Recipe]),
) -> Result<(), Failure> {
    let bar = output::bar();
    let session = Session::sharing(gpu, scene, args.shader_form())?;
    let mut facts = measure::facts(&session).unwrap_or_else(|_| Facts::default());
    let recipes: Vec<Recipe> = recipes.iter().copied().cloned().collect();
    let settled = measure::settled(&session, recipes, &mut facts, &mut |done, what| {
        bar.set_position((done * 1000.0) as u64);
        bar.set_message(what);
    })?;
    let mut drawn: Vec<Variant> = Vec::new();
    let mut by_frame: BTreeMap<String, usize> = BTreeMap::new();
    let mut all: Vec<JudgedVariant> = Vec::new();
    for settled in &settled {
        let variant = settled.variant(session.originals(), &facts);
        if let Some(note) = settled.note(&variant, &facts) {
            bar.suspend(|| output::message(&note));
        }
        let asked = &settled.asked;
        let variant = Variant {
            name: asked.to_string(),
            ..variant
        };
        let frame = frame(&variant.plans).unwrap_or_else(|| variant.name.clone());
        let drawn = *by_frame.entry(frame).or_insert_with(|| {
            drawn.push(variant.clone());
            drawn.len() - 1
        });
        all.push(JudgedVariant {
            variant,
            is_budget_kept: given.contains(asked) || measure::leaves_a_choice(asked),
            drawn,
        });
    }
    let settings = args.settings(scene, Timed::No);
    let command = |variant: &str| alone(args, job, variant);
    for (i, some) in drawn.chunks(AT_ONCE).enumerate() {
        let outcome = measure::verify(&session, some, &settings, &mut |_| {})?;
        if let Some(why) = outcome.lost {
            return Err(Failure(format!("the adapter was lost: {why}")));
        }
        let untested = untested(&outcome.report);
        // The original is first.
        for (j, report) in outcome.report.variants.iter().skip(1).enumerate() {
            let drawn = i * AT_ONCE + j;
            for judged in all.iter().filter(|judged| judged.drawn == drawn) {
                promises.add(judged, report, untested.as_deref(), &command);
            }
        }
    }
    bar.finish_and_clear();
    Ok(())
}

/// Why no verdict on this input counts.
fn untested(report: &Report) -> Option<String> {
    (!report.untested.is_empty()).then(|| report.untested.join("; "))
}

/// The drawn shaders of plans, as text: equal texts need one measurement. `None`: a plan cannot be
/// emitted.
pub fn frame(plans: &[Plan]) -> Option<String> {
    let mut text = String::new();
    for plan in plans {
        let plan = Plan {
            steps: Vec::new(),
            notes: Vec::new(),
            original: None,
            ..plan.clone()
        };
        let files = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).ok()?;
        for file in files {
            text.push_str(&file.name);
            text.push_str(&String::from_utf8_lossy(&file.bytes));
        }
    }
    Some(text)
}

/// Flags that choose variants, times and the form of the output.
pub const OF_SEVERAL: [&str; 7] = [
    "variant",
    "pass",
    "recipe",
    "every-pass",
    "format",
    "time",
    "budget",
];

/// The command that draws one variant of one input, with the flags of this one.
fn alone(args: &VerifyArgs, job: &Job, variant: &str) -> String {
    let mut words = vec!["preshade".to_owned(), "verify".to_owned()];
    words.extend(flags::without(&args.flags, &OF_SEVERAL));
    words.extend(job.shader.files.iter().map(|f| f.display().to_string()));
    words.extend(["--time", "no", "--variant", variant].map(str::to_owned));
    shell_words::join(words)
}
