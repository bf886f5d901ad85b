//! Jobs, results and machines as files.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use super::{JOB_SCHEMA, Job, MACHINE_SCHEMA, Machine, OUTCOME_SCHEMA, Outcome, Results, SCHEMA};

/// End of the names of results.
pub const EXTENSION: &str = ".outcome.json";

/// End of the names of files that list the adapters of a machine.
pub const MACHINES: &str = ".adapters.json";

/// A file that cannot be read, or is of another kind or version.
#[derive(Debug, thiserror::Error)]
#[error("{}: {why}", .path.display())]
pub struct FileError {
    path: PathBuf,
    why: String,
}

impl FileError {
    fn of(path: &Path, why: &dyn Display) -> Self {
        Self {
            path: path.to_owned(),
            why: why.to_string(),
        }
    }
}

/// Reads a list of jobs, each once; `-` is stdin.
///
/// # Errors
/// It cannot be read, or a line is no job.
pub fn jobs(path: &Path) -> Result<Vec<Job>, FileError> {
    let failed = |e: &dyn Display| FileError::of(path, e);
    let mut text = String::new();
    match path == Path::new("-") {
        true => std::io::stdin().read_to_string(&mut text),
        false => File::open(path).and_then(|mut file| file.read_to_string(&mut text)),
    }
    .map_err(|e| failed(&e))?;
    let mut jobs = BTreeMap::new();
    for (i, line) in text.lines().enumerate() {
        if line.trim().is_empty() {
            continue;
        }
        let at = |e: &dyn Display| failed(&format!("line {}: {e}", i + 1));
        let job: Job = serde_json::from_str(line).map_err(|e| at(&e))?;
        checked(&job.schema, JOB_SCHEMA).map_err(|e| at(&e))?;
        // It becomes the name of a file.
        if job.key.len() != 32 || !job.key.bytes().all(|b| b.is_ascii_hexdigit()) {
            return Err(at(&"its key is not 32 hexadecimal digits"));
        }
        jobs.insert(job.key.clone(), job);
    }
    Ok(jobs.into_values().collect())
}

/// Reads merged results.
///
/// # Errors
/// It cannot be read, or is of another kind or version.
pub fn results(file: &Path) -> Result<Results, FileError> {
    let wrong = "it is not what `preshade merge -o` writes, or of another version";
    read(file, wrong, (|r: &Results| &r.schema, SCHEMA))
}

/// Reads a result.
///
/// # Errors
/// It cannot be read, or is of another kind or version.
pub fn outcome(file: &Path) -> Result<Outcome, FileError> {
    read(file, NO_RESULT, (|o: &Outcome| &o.schema, OUTCOME_SCHEMA))
}

/// The results in folders, or in files.
///
/// # Errors
/// One cannot be read.
pub fn outcomes(paths: &[PathBuf]) -> Result<Vec<Outcome>, FileError> {
    let files = files(paths, EXTENSION)?;
    files.iter().map(|file| outcome(file)).collect()
}

/// The machines in folders, or in files.
///
/// # Errors
/// One cannot be read.
pub fn machines(paths: &[PathBuf]) -> Result<Vec<Machine>, FileError> {
    let files = files(paths, MACHINES)?;
    let machine = |file: &PathBuf| read(file, NO_RESULT, (|m: &Machine| &m.schema, MACHINE_SCHEMA));
    files.iter().map(machine).collect()
}

const NO_RESULT: &str = "it is no result of a job";

fn read<T: DeserializeOwned>(
    file: &Path,
    wrong: &str,
    (schema, expected): (fn(&T) -> &String, &str),
) -> Result<T, FileError> {
    let failed = |e: &dyn Display| FileError::of(file, e);
    let bytes = std::fs::read(file).map_err(|e| failed(&e))?;
    let read = serde_json::from_slice(&bytes).map_err(|e| failed(&format!("{wrong}: {e}")))?;
    checked(schema(&read), expected).map_err(|e| failed(&e))?;
    Ok(read)
}

fn checked(schema: &str, expected: &str) -> Result<(), String> {
    match schema == expected {
        true => Ok(()),
        false => Err(format!(
            "its schema is `{schema}`, and this version reads `{expected}`"
        )),
    }
}

/// The files of folders whose names end so, in order, and those of the files given that are of this kind.
fn files(paths: &[PathBuf], extension: &str) -> Result<Vec<PathBuf>, FileError> {
    let ends = |file: &Path, extension: &str| {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        // A file that is being written has another name until it is whole.
        name.ends_with(extension) && !name.starts_with('.')
    };
    let mut all = Vec::new();
    for path in paths {
        if !path.is_dir() {
            let is_wanted = ends(path, MACHINES) == (extension == MACHINES);
            all.extend(is_wanted.then(|| path.clone()));
            continue;
        }
        let failed = |e: std::io::Error| FileError::of(path, &e);
        let entries = std::fs::read_dir(path).map_err(failed)?;
        let found: Result<Vec<PathBuf>, _> = entries.map(|e| e.map(|e| e.path())).collect();
        let mut found = found.map_err(failed)?;
        found.retain(|file| ends(file, extension));
        found.sort();
        all.extend(found);
    }
    Ok(all)
}
