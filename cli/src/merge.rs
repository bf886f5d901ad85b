//! `preshade merge`: the union of the results of `evaluate`.

use std::path::PathBuf;

use preshade_lab::jobs::{self, Answer, FleetAdapter, Job, Results, fleet};
use preshade_lab::report;
use preshade_lab::search::plan::regret::Choosing;
use shader_text::files;

use crate::{Ending, Failure, Table, output, verify};

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade merge results/
  preshade merge laptop/ cluster/ -o results.json
  preshade merge results/ --html report/             report/index.html: adapters as columns
  preshade merge results/ --adapters                 what the machines have
  preshade merge results/ --jobs jobs.jsonl          how many of these jobs have results

The same results give the same bytes, in any order and however often a part was run. Two different
pictures of one job on one adapter and driver are an error, and so are timing jobs that shared an
adapter. A job that failed in one place and ran in another counts as run.
Exit status 1: a variant broke its contract on some adapter.")]
pub struct MergeArgs {
    /// Folders of `evaluate --out`, or files in them.
    #[arg(required = true, value_name = "DIR")]
    results: Vec<PathBuf>,
    /// Write the merged results to this file.
    #[arg(short, long, alias = "output", value_name = "FILE")]
    out: Option<PathBuf>,
    /// Folder for `index.html`: what each adapter said of each variant, in one page.
    #[arg(long, value_name = "DIR")]
    html: Option<PathBuf>,
    /// Print the adapters of the machines, and how many results each has. No job has to have run.
    #[arg(long)]
    adapters: bool,
    /// Say how many jobs of this list of `preshade jobs` have results; `-` is stdin.
    #[arg(long, value_name = "FILE")]
    jobs: Option<PathBuf>,
    /// Merge results of several versions of preshade.
    #[arg(long)]
    mix_versions: bool,
    /// Output form.
    #[arg(long, value_enum, default_value_t = Table::Human)]
    format: Table,
}

pub fn run(args: &MergeArgs) -> Result<Ending, Failure> {
    let outcomes = jobs::files::outcomes(&args.results)?;
    let machines = match args.adapters {
        true => jobs::files::machines(&args.results)?,
        false => Vec::new(),
    };
    if outcomes.is_empty() && machines.is_empty() {
        return Err(Failure(
            "error: no result is in the folders given: `evaluate --out` writes them".to_owned(),
        ));
    }
    let results = Results::merge(outcomes, args.mix_versions)?;
    if let Some(list) = &args.jobs {
        output::message(&standing(&jobs::files::jobs(list)?, &results));
    }
    let json = results.to_json()?;
    if let Some(path) = &args.out {
        files::write_file(path, json.clone().into_bytes())?;
        output::message(&format!("wrote {}", path.display()));
    }
    let command = verify::command();
    let regrets = results.regrets(Choosing::default(), &command);
    if let Some(dir) = &args.html {
        let page = report::html::merged::page(&results, &regrets, &command)?;
        files::write(dir, &[files::File::text("index.html", page)])?;
        output::message(&format!("wrote {}", dir.join("index.html").display()));
    }
    match args.format {
        _ if args.adapters => print(&fleet(&results, &machines), args.format)?,
        Table::Json => output::data(&json)?,
        Table::Csv => output::data(&report::merged::csv(&results))?,
        Table::Human => {
            output::table(&report::merged::table(&results))?;
            for regret in regrets {
                output::table(&format!("\n{}", regret.render()))?;
            }
        }
    }
    let reports = results.jobs.values().flat_map(|job| job.answers.values());
    let is_broken = reports.flat_map(|answer| match answer {
        Answer::Measured { runs } => runs.values().collect(),
        Answer::Failed { .. } => Vec::new(),
    });
    let mut is_broken = is_broken.map(|measured| measured.found.is_broken());
    Ok(Ending::of(is_broken.any(|broken| broken), false))
}

/// How many of these jobs have results on some adapter.
fn standing(jobs: &[Job], results: &Results) -> String {
    let ran = jobs.iter().filter_map(|job| results.jobs.get(&job.key));
    let is_measured = |a: &Answer| matches!(a, Answer::Measured { .. });
    let (measured, failed): (Vec<_>, Vec<_>) =
        ran.partition(|job| job.answers.values().any(is_measured));
    let failed = match failed.len() {
        0 => String::new(),
        n => format!(", {n} failed"),
    };
    let (measured, all) = (measured.len(), output::count(jobs.len(), "job"));
    let have = match jobs.len() {
        1 => "has",
        _ => "have",
    };
    format!("{measured} of {all} {have} results{failed}")
}

/// The adapters of a fleet, as JSON.
#[derive(serde::Serialize)]
struct Fleet<'a> {
    schema: &'static str,
    adapters: &'a [FleetAdapter],
}

fn print(adapters: &[FleetAdapter], format: Table) -> Result<(), Failure> {
    match format {
        Table::Human => output::table(&report::fleet::adapters(adapters)),
        Table::Csv => output::data(&report::fleet::adapters_csv(adapters)),
        Table::Json => output::json(&Fleet {
            schema: "preshade.fleet.v1",
            adapters,
        }),
    }
}
