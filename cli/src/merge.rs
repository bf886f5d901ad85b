//! `preshade merge`: the union of the results of `evaluate`.

use std::path::{Path, PathBuf};

use preshade_lab::jobs::{
    Answer, FleetAdapter, Job, MACHINE_SCHEMA, Machine, OUTCOME_SCHEMA, Outcome, Results, fleet,
};
use preshade_lab::report;
use preshade_lab::search::plan::regret::Choosing;
use shader_text::files;

use crate::evaluate::{self, EXTENSION, MACHINES};
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
    let outcomes = outcomes(&args.results)?;
    let machines = match args.adapters {
        true => machines(&args.results)?,
        false => Vec::new(),
    };
    if outcomes.is_empty() && machines.is_empty() {
        return Err(Failure(
            "error: no result is in the folders given: `evaluate --out` writes them".to_owned(),
        ));
    }
    let results =
        Results::merge(outcomes, args.mix_versions).map_err(|e| Failure(format!("error: {e}")))?;
    if let Some(list) = &args.jobs {
        output::message(&standing(&evaluate::read(list)?, &results));
    }
    let json = results.to_json()?;
    if let Some(path) = &args.out {
        shader_text::files::write_file(path, json.clone().into_bytes())
            .map_err(|e| Failure(format!("error: {e}")))?;
        output::message(&format!("wrote {}", path.display()));
    }
    let command = verify::command();
    let regrets = results.regrets(Choosing::default(), &command);
    if let Some(dir) = &args.html {
        let page = files::File {
            name: "index.html".to_owned(),
            bytes: report::html::merged::page(&results, &regrets, &command)?.into_bytes(),
        };
        shader_text::files::write(dir, &[page]).map_err(|e| Failure(format!("error: {e}")))?;
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
    Ok(match is_broken.any(|broken| broken) {
        true => Ending::ContractBroken,
        false => Ending::Fine,
    })
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

/// The results in folders, or in files.
pub fn outcomes(paths: &[PathBuf]) -> Result<Vec<Outcome>, Failure> {
    let mut outcomes = Vec::new();
    for path in paths {
        for file in files(path, EXTENSION)? {
            outcomes.push(read(&file)?);
        }
    }
    Ok(outcomes)
}

/// The machines in folders, or in files.
fn machines(paths: &[PathBuf]) -> Result<Vec<Machine>, Failure> {
    let mut machines = Vec::new();
    for path in paths {
        for file in files(path, MACHINES)? {
            let machine: Machine = parsed(&file)?;
            checked(&file, &machine.schema, MACHINE_SCHEMA)?;
            machines.push(machine);
        }
    }
    Ok(machines)
}

/// The files of a folder whose names end so, or the one file. One of the other kind is none.
fn files(path: &Path, extension: &str) -> Result<Vec<PathBuf>, Failure> {
    let failed = |e: std::io::Error| Failure(format!("error: {}: {e}", path.display()));
    let ends = |file: &Path, extension: &str| {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        // A file that is being written has another name until it is whole.
        name.ends_with(extension) && !name.starts_with('.')
    };
    if !path.is_dir() {
        let is_of_machine = ends(path, MACHINES);
        return Ok(match is_of_machine == (extension == MACHINES) {
            true => vec![path.to_owned()],
            false => Vec::new(),
        });
    }
    let mut found = Vec::new();
    for entry in std::fs::read_dir(path).map_err(failed)? {
        let file = entry.map_err(failed)?.path();
        if ends(&file, extension) {
            found.push(file);
        }
    }
    found.sort();
    Ok(found)
}

pub fn read(file: &Path) -> Result<Outcome, Failure> {
    let outcome: Outcome = parsed(file)?;
    checked(file, &outcome.schema, OUTCOME_SCHEMA)?;
    Ok(outcome)
}

fn parsed<T: serde::de::DeserializeOwned>(file: &Path) -> Result<T, Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure(format!("error: {}: {e}", file.display()));
    let bytes = std::fs::read(file).map_err(|e| failed(&e))?;
    serde_json::from_slice(&bytes).map_err(|e| failed(&format!("it is no result of a job: {e}")))
}

fn checked(file: &Path, schema: &str, read: &str) -> Result<(), Failure> {
    match schema == read {
        true => Ok(()),
        false => Err(Failure(format!(
            "error: {}: its schema is `{schema}`, and this version reads `{read}`",
            file.display()
        ))),
    }
}
