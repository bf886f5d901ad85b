//! `preshade plan --exhaustive`: every candidate timed in every view, a job for each scene.

use std::path::Path;

use clap::CommandFactory;
use preshade_draw::render::{AdapterChoice, Gpu, cards};
use preshade_draw::scene::Scene;
use preshade_lab::jobs::{EVERY, Exhaustive, Kind, Outcome, Results, adapter_id};
use preshade_lab::measure::{self, Session};
use preshade_lab::search::plan::Model;
use preshade_lab::search::plan::model::Observation;
use preshade_lab::search::{candidates, plan as decide};
use preshade_plan::budget::Budget;
use preshade_plan::pass::Facts;
use preshade_scenes::ShaderForm;
use shader_text::files;

use crate::evaluate::{self, Settings};
use crate::input::ShaderArgs;
use crate::jobs::{self, Input};
use crate::materials::Job;
use crate::plan::{self, PlanArgs};
use crate::verify::command;
use crate::{Cli, Ending, Failure, Table, flags, merge, output, worker};

/// Flags of `plan` that are the parent's.
const OF_THE_RUN: [&str; 10] = [
    "adapter",
    "exhaustive",
    "format",
    "lock",
    "one",
    "out",
    "probes",
    "runners",
    "time",
    "workers",
];

/// Checks that `plan` has these flags of `verify`.
pub fn check_flags(words: &[String]) -> Result<(), Failure> {
    let command = Cli::command();
    let plan = command.find_subcommand("plan");
    let known: Vec<&str> = plan
        .into_iter()
        .flat_map(clap::Command::get_arguments)
        .filter_map(clap::Arg::get_long)
        .collect();
    match flags::without(words, &known).first() {
        None => Ok(()),
        Some(word) => Err(Failure(format!(
            "error: {word} does not go with --exhaustive: `plan` has no such flag"
        ))),
    }
}

/// The job of a scene.
pub fn job(
    input: &Input<'_>,
    scene: &Scene,
    budget: Option<Budget>,
    arguments: Vec<String>,
) -> Result<preshade_lab::jobs::Job, Failure> {
    let originals = measure::originals(scene);
    let mut plans = Vec::new();
    let recipes = candidates::recipes(budget)?;
    for recipe in &recipes {
        plans.extend(measure::variant(&originals, recipe, &Facts::default()).plans);
    }
    let given = |flag: &str| {
        let flag = format!("--{flag}=");
        arguments
            .iter()
            .find_map(|word| word.strip_prefix(flag.as_str()))
    };
    let frames = given("frames").and_then(|n| n.parse().ok());
    let (pictures, views) = jobs::estimate(scene, frames.unwrap_or(plan::FRAMES));
    let seconds = given("seconds").and_then(|n| n.parse().ok());
    let seconds = pictures * recipes.len() as f64 + views * seconds.unwrap_or(plan::SECONDS);
    input.job((Kind::Time, seconds), EVERY, arguments, &plans)
}

/// Measures the scene of a job, and prints what was found.
pub fn measured(args: &PlanArgs, jobs: &[Job]) -> Result<Ending, Failure> {
    let [job] = jobs else {
        return Err(Failure("error: a job is one scene".to_owned()));
    };
    let bar = output::bar();
    let choice = args.adapter.clone();
    let choice = choice.map_or(AdapterChoice::Best, AdapterChoice::Matching);
    // What takes a share of the adapter goes first: two of one process can lock each other out.
    let scene = plan::grouped(args, plan::scene(args, &job.shader)?)?;
    let open = || worker::in_turns(Gpu::with_trust(&choice, args.limits.limits().trust())?);
    let known = args.probes.as_deref().map(|file| probes(file, open));
    let known = known.transpose()?;
    let gpu = open()?;
    let (model, probes) = match known {
        None => plan::model(args, &gpu, &bar)?,
        Some(probes) => (Model::fit(&gpu.adapter().title(), &probes), probes),
    };
    let session = Session::new(&gpu, &scene, ShaderForm::Text)?;
    let (recipes, facts) = plan::prepare(args, &session, &bar)?;
    let settings = plan::settings(args, &model);
    let scene = decide::exhaust(&session, &recipes, &facts, &settings)?;
    // What could not be drawn any more looks like what cannot be drawn.
    if let Some(why) = gpu.lost() {
        return Err(Failure(format!(
            "error: the graphics device was lost: {why}"
        )));
    }
    output::json(&Exhaustive {
        adapter: adapter_id(gpu.adapter()),
        probes,
        scene,
    })?;
    Ok(Ending::Fine)
}

/// Reads the frames that a cost model is fitted to, or measures and writes them.
fn probes(
    file: &Path,
    open: impl Fn() -> Result<Gpu, Failure>,
) -> Result<Vec<Observation>, Failure> {
    // Held until they are written.
    let _first = worker::first_of_several(file)?;
    let known = std::fs::read_to_string(file).ok();
    // A file that cannot be read is written again.
    if let Some(probes) = known.and_then(|text| serde_json::from_str(&text).ok()) {
        return Ok(probes);
    }
    let (_, probes) = decide::probes::fit(&open()?, &mut |_| ())?;
    let bytes = serde_json::to_vec(&probes)?;
    shader_text::files::write_file(file, bytes).map_err(|e| Failure(format!("error: {e}")))?;
    Ok(probes)
}

/// Measures everything, and holds the choices against it.
pub fn run(args: &PlanArgs, inputs: &[Job]) -> Result<Ending, Failure> {
    let arguments = flags::without(&args.flags, &OF_THE_RUN);
    let mut list = Vec::new();
    let mut failed = Vec::new();
    for input in inputs {
        let path = plan::path_of(input);
        match listed(args, &input.shader, arguments.clone()) {
            Ok(job) => list.push(job),
            Err(Failure(why)) => {
                output::message(&format!("{}: {why}", path.display()));
                failed.push((path.display().to_string(), why));
            }
        }
    }
    // Removed when it is dropped.
    let temporary = tempfile::tempdir()?;
    let out = match &args.out {
        Some(out) => out.join("outcomes"),
        None => temporary.path().to_owned(),
    };
    if args.adapter.as_deref() == Some("all") {
        return Err(Failure(
            "error: --adapter all is for `evaluate`: the report is of one adapter".to_owned(),
        ));
    }
    let models = evaluate::models(cards(), args.adapter.as_deref())?;
    let settings = Settings {
        workers: args.workers.map_or(0, usize::from),
        // Views have times of their own.
        seconds: Some(u64::MAX),
        ..Settings::new(out.clone(), models)
    };
    let tally = evaluate::all_of(&list, &settings)?;
    if tally.stale > 0 {
        return Err(Failure(format!(
            "error: files of {} changed meanwhile",
            output::count(tally.stale, "scene")
        )));
    }
    let keys: Vec<&str> = list.iter().map(|job| job.key.as_str()).collect();
    let ids: Vec<String> = settings.models.iter().map(evaluate::Model::id).collect();
    let is_ours =
        |o: &Outcome| keys.contains(&o.job.key.as_str()) && ids.contains(&adapter_id(&o.adapter));
    let outcomes = merge::outcomes(&[out])?.into_iter().filter(is_ours);
    let results = Results::merge(outcomes, false).map_err(|e| Failure(format!("error: {e}")))?;
    let mut reports = results.regrets(plan::choosing(args), &command());
    for report in &mut reports {
        report.resolution = args.view.size();
        report.failed.splice(0..0, failed.iter().cloned());
    }
    let [report] = &reports[..] else {
        return Err(Failure(match failed.first() {
            Some(_) => "error: no scene could be read".to_owned(),
            None => {
                "error: --adapter all is for `evaluate`: the report is of one adapter".to_owned()
            }
        }));
    };
    let (json, csv) = (report.to_json()?, report.csv());
    let printed = match args.format {
        Table::Human => output::table(&report.render()),
        Table::Json => output::data(&json),
        Table::Csv => output::data(&csv),
    };
    let written = || -> Result<(), Failure> {
        let Some(dir) = &args.out else { return Ok(()) };
        let file = |name: &str, text: String| files::File {
            name: name.to_owned(),
            bytes: text.into_bytes(),
        };
        let files = [file("regret.json", json), file("regret.csv", csv)];
        shader_text::files::write(dir, &files).map_err(|e| Failure(format!("error: {e}")))?;
        Ok(())
    };
    output::both(printed, written(), args.out.as_deref())?;
    match report.failed.len() {
        0 => Ok(Ending::Fine),
        n => Err(Failure(format!(
            "error: {n} of {} inputs failed: {}",
            inputs.len(),
            report
                .failed
                .iter()
                .map(|(name, _)| name.as_str())
                .collect::<Vec<_>>()
                .join(", ")
        ))),
    }
}

fn listed(
    args: &PlanArgs,
    shader: &ShaderArgs,
    arguments: Vec<String>,
) -> Result<preshade_lab::jobs::Job, Failure> {
    let input = Input::new(shader)?;
    job(&input, &plan::scene(args, shader)?, args.budget, arguments)
}
