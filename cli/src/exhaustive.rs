//! `preshade plan --exhaustive`: every candidate timed in every view, a job for each scene.

use std::path::Path;

use preshade_draw::render::{Gpu, cards};
use preshade_lab::jobs::{Exhaustive, Outcome, Results, adapter_id, files};
use preshade_lab::measure::Session;
use preshade_lab::search::plan as decide;
use preshade_lab::search::plan::Model;
use preshade_lab::search::plan::model::Observation;
use preshade_scenes::ShaderForm;
use shader_text::files::File;

use crate::evaluate::{self, Settings};
use crate::input::ShaderArgs;
use crate::jobs::{self, Input};
use crate::materials::Job;
use crate::plan::{self, PlanArgs};
use crate::verify::command;
use crate::{Ending, Failure, flags, output, worker};

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

/// Measures everything, or the scene of a job.
pub fn run(args: &PlanArgs) -> Result<Ending, Failure> {
    let (jobs, _) = args.inputs()?;
    if args.lock || !args.is_timed() {
        return Err(Failure(
            "error: --exhaustive measures, and chooses nothing: it goes without --lock and --time \
             no"
            .to_owned(),
        ));
    }
    match (worker::is_job(), &jobs[..]) {
        (false, _) => judged(args, &jobs),
        (true, [job]) => measured(args, job),
        (true, _) => Err(Failure("error: a job is one scene".to_owned())),
    }
}

/// Measures the scene of a job, and prints the result.
fn measured(args: &PlanArgs, job: &Job) -> Result<Ending, Failure> {
    let bar = output::bar();
    // Probes take a share of the adapter, so they come first: two of one process can lock each
    // other out.
    let scene = plan::grouped(args, plan::scene(args, &job.shader)?)?;
    let open = || plan::open(args);
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
    // After the device was lost, a plan that it did not draw looks like one that cannot be drawn.
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
    shader_text::files::write_file(file, bytes)?;
    Ok(probes)
}

/// Measures everything, and holds the choices against it.
fn judged(args: &PlanArgs, inputs: &[Job]) -> Result<Ending, Failure> {
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
    let outcomes = files::outcomes(&[out])?.into_iter().filter(is_ours);
    let results = Results::merge(outcomes, false)?;
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
    let forms = output::Answer {
        table: report.render(),
        json: report.to_json()?,
        csv: report.csv(),
    };
    forms.tell(args.format, args.out.as_deref(), |dir| {
        let files = [
            File::text("regret.json", forms.json.clone()),
            File::text("regret.csv", forms.csv.clone()),
        ];
        shader_text::files::write(dir, &files)?;
        Ok(())
    })?;
    let failed = report.failed.iter().map(|(name, _)| name.clone());
    let failed: Vec<String> = failed.collect();
    match failed.is_empty() {
        true => Ok(Ending::Fine),
        false => Err(Failure::of_inputs(&failed, inputs.len())),
    }
}

fn listed(
    args: &PlanArgs,
    shader: &ShaderArgs,
    arguments: Vec<String>,
) -> Result<preshade_lab::jobs::Job, Failure> {
    let input = Input::new(shader)?;
    jobs::exhaustive(&input, &plan::scene(args, shader)?, args.budget, arguments)
}
