//! `preshade merge`: the union of the results of `evaluate`.

use std::path::{Path, PathBuf};

use preshade::unstable::jobs::{Answer, OUTCOME_SCHEMA, Outcome, Results};
use preshade::unstable::search::plan::regret::Choosing;
use preshade::unstable::{emit, report};

use crate::evaluate::EXTENSION;
use crate::{Ending, Failure, Table, output, verify};

/// Arguments of `merge`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade merge results/
  preshade merge laptop/ cluster/ -o results.json

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
    /// Merge results of several versions of preshade.
    #[arg(long)]
    mix_versions: bool,
    /// Output form.
    #[arg(long, value_enum, default_value_t = Table::Human)]
    format: Table,
}

/// Merges.
pub fn run(args: &MergeArgs) -> Result<Ending, Failure> {
    let outcomes = outcomes(&args.results)?;
    if outcomes.is_empty() {
        return Err(Failure(
            "error: no result is in the folders given: `evaluate --out` writes them".to_owned(),
        ));
    }
    let results =
        Results::merge(outcomes, args.mix_versions).map_err(|e| Failure(format!("error: {e}")))?;
    let json = results.to_json()?;
    if let Some(path) = &args.out {
        emit::write_file(path, json.clone().into_bytes())
            .map_err(|e| Failure(format!("error: {e}")))?;
        output::message(&format!("wrote {}", path.display()));
    }
    match args.format {
        Table::Json => output::data(&json)?,
        Table::Csv => output::data(&report::merged::csv(&results))?,
        Table::Human => {
            output::table(&report::merged::table(&results))?;
            for regret in results.regrets(Choosing::default(), &verify::command()) {
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

/// The results in folders, or in files.
///
/// # Errors
/// One cannot be read.
pub fn outcomes(paths: &[PathBuf]) -> Result<Vec<Outcome>, Failure> {
    let mut outcomes = Vec::new();
    for path in paths {
        for file in files(path)? {
            outcomes.push(read(&file)?);
        }
    }
    Ok(outcomes)
}

/// The results in a folder, or the one file.
fn files(path: &Path) -> Result<Vec<PathBuf>, Failure> {
    let failed = |e: std::io::Error| Failure(format!("error: {}: {e}", path.display()));
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut found = Vec::new();
    for entry in std::fs::read_dir(path).map_err(failed)? {
        let file = entry.map_err(failed)?.path();
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        // A file that is being written has another name until it is whole.
        if name.ends_with(EXTENSION) && !name.starts_with('.') {
            found.push(file);
        }
    }
    found.sort();
    Ok(found)
}

/// Reads one result.
pub fn read(file: &Path) -> Result<Outcome, Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure(format!("error: {}: {e}", file.display()));
    let text = std::fs::read_to_string(file).map_err(|e| failed(&e))?;
    let outcome: Outcome = serde_json::from_str(&text).map_err(|e| failed(&e))?;
    match outcome.schema == OUTCOME_SCHEMA {
        true => Ok(outcome),
        false => Err(failed(&format!(
            "its schema is `{}`, and this version reads `{OUTCOME_SCHEMA}`",
            outcome.schema
        ))),
    }
}
