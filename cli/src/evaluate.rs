//! `preshade evaluate`: runs jobs, and keeps one file for each result.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use preshade::unstable::emit;
use preshade::unstable::jobs::{
    self, JOB_SCHEMA, Job, JobResult, Kind, OUTCOME_SCHEMA, Outcome, Partition, Reason, Run,
    adapter_id,
};
use preshade::unstable::limits::Limits;
use preshade::unstable::measure::record::Report;
use preshade::unstable::passes::contract::Verdict;
use preshade::unstable::render::{self, AdapterReport};

use crate::{Ending, Failure, merge, output, verify, worker};

/// End of the names of results.
pub const EXTENSION: &str = ".outcome.json";

/// Arguments of `evaluate`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade evaluate --jobs jobs.jsonl --out results/
  preshade evaluate --jobs jobs.jsonl --partition hash:3/16 --adapter llvmpipe --out results/
  preshade evaluate --jobs jobs.jsonl --adapter all --workers 4 --out results/

Each job runs in a process of its own. Its result is one file, which is written whole or not at all:
the same command again goes on where it was. A broken promise, a lost device, a crash and a job that
takes too long are results too, and the next job runs. Timing jobs have their adapter for themselves
on this machine, also beside another `evaluate`.
Exit status 2: a job was not run, because its files are not those of the list.")]
pub struct EvaluateArgs {
    /// List of `preshade jobs`; `-` is stdin.
    #[arg(long, value_name = "FILE")]
    jobs: PathBuf,
    /// Folder for the results.
    #[arg(short, long, alias = "output", value_name = "DIR")]
    out: PathBuf,
    /// Run only this share of the jobs: hash:3/16 is the third of sixteen.
    #[arg(long, value_name = "hash:M/N", value_parser = Partition::parse)]
    partition: Option<Partition>,
    /// Run only these jobs.
    #[arg(long, value_enum)]
    kind: Option<KindArg>,
    /// Part of an adapter's name, driver or backend; `all` runs each job on every adapter of this
    /// machine.
    #[arg(long, value_name = "TEXT")]
    adapter: Option<String>,
    /// Jobs at once. Timing jobs of one adapter wait for each other.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    workers: u16,
    /// Stop a job after so many seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = worker::OF_A_VARIANT)]
    seconds: u64,
    /// Try a job that fails so many times in all, also over several runs of this command.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..))]
    attempts: u32,
    /// Name of this run of timing jobs; each run adds samples. Default: the machine's name.
    #[arg(long, value_name = "NAME", value_parser = parse_run)]
    run: Option<String>,
}

/// What to run.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum KindArg {
    /// Comparisons of pictures.
    Picture,
    /// Times.
    Time,
}

/// A run's name becomes a part of file names.
fn parse_run(text: &str) -> Result<String, String> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    match !text.is_empty() && text.len() <= 64 && text.chars().all(is_plain) {
        true => Ok(text.to_owned()),
        false => Err("expected letters, digits, `-` and `_`, at most 64".to_owned()),
    }
}

/// Runs the jobs.
pub fn run(args: &EvaluateArgs) -> Result<Ending, Failure> {
    verify::check_folder(&args.out)?;
    let all = read(&args.jobs)?;
    let adapters = adapters(args.adapter.as_deref())?;
    let host = host();
    let run = args.run.clone().unwrap_or_else(|| plain(&host));
    let mut tasks = Vec::new();
    let (mut done, mut nowhere) = (0, 0);
    for job in &all {
        let is_kind = args.kind.is_none_or(|kind| match kind {
            KindArg::Picture => job.kind == Kind::Picture,
            KindArg::Time => job.kind == Kind::Time,
        });
        if !is_kind || args.partition.is_some_and(|p| !p.contains(&job.key)) {
            continue;
        }
        let may_run = adapters.iter().filter(|a| {
            let wanted = job.adapter.as_deref();
            wanted.is_none_or(|text| a.matches(text))
        });
        let mut is_somewhere = false;
        for adapter in may_run {
            is_somewhere = true;
            let task = Task {
                file: args.out.join(file_name(job, adapter, &run)),
                job,
                adapter,
            };
            match task.known() {
                Some(outcome) if !outcome.is_open(args.attempts) => done += 1,
                known => tasks.push((task, known)),
            }
        }
        nowhere += usize::from(!is_somewhere);
    }
    if done > 0 {
        output::message(&format!("{} there already", output::count(done, "result")));
    }
    if nowhere > 0 {
        output::message(&format!(
            "warning: {} for adapters that this machine does not have",
            output::count(nowhere, "job")
        ));
    }
    let runner = Runner {
        args,
        host,
        run,
        hashes: changed_files(&tasks),
    };
    let next = AtomicUsize::new(0);
    let is_stopped = AtomicBool::new(false);
    let found = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..usize::from(args.workers).min(tasks.len()))
            .map(|_| {
                scope.spawn(|| {
                    let mut found = Found::default();
                    while !is_stopped.load(Ordering::Relaxed) {
                        let index = next.fetch_add(1, Ordering::Relaxed);
                        let Some((task, known)) = tasks.get(index) else {
                            break;
                        };
                        match runner.evaluate(task, known.as_ref(), &mut found) {
                            Ok(()) => {}
                            Err(failure) => {
                                // A disk that is full stays full.
                                is_stopped.store(true, Ordering::Relaxed);
                                return Err(failure);
                            }
                        }
                    }
                    Ok(found)
                })
            })
            .collect();
        let ended = workers.into_iter().map(|worker| {
            let panicked = |_| Err(Failure("error: a worker panicked".to_owned()));
            worker.join().unwrap_or_else(panicked)
        });
        ended.collect::<Result<Vec<Found>, Failure>>()
    })?;
    let sum = |of: fn(&Found) -> usize| found.iter().map(of).sum::<usize>();
    let stale: Vec<&String> = found.iter().flat_map(|f| &f.stale).collect();
    output::message(&format!(
        "{}: {} measured, {} of them broken; {} failed; {} not run",
        output::count(tasks.len(), "job"),
        sum(|f| f.measured),
        sum(|f| f.broken),
        sum(|f| f.failed),
        stale.len()
    ));
    match stale.len() {
        0 => Ok(Ending::Fine),
        n => Err(Failure(format!(
            "error: {} not run: their files are not those of the list",
            output::count(n, "job")
        ))),
    }
}

/// Reads a list of jobs.
fn read(path: &Path) -> Result<Vec<Job>, Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure(format!("error: {}: {e}", path.display()));
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
        let at = |e: &dyn std::fmt::Display| failed(&format!("line {}: {e}", i + 1));
        let job: Job = serde_json::from_str(line).map_err(|e| at(&e))?;
        if job.schema != JOB_SCHEMA {
            return Err(at(&format!(
                "its schema is `{}`, and this version reads `{JOB_SCHEMA}`",
                job.schema
            )));
        }
        // It becomes the name of a file.
        if job.key.len() != 32 || !job.key.bytes().all(|b| b.is_ascii_hexdigit()) {
            return Err(at(&"its key is not 32 hexadecimal digits"));
        }
        jobs.insert(job.key.clone(), job);
    }
    Ok(jobs.into_values().collect())
}

/// The adapters to run on.
fn adapters(wanted: Option<&str>) -> Result<Vec<AdapterReport>, Failure> {
    let mut all = render::adapters();
    // Two cards of one model cannot be selected by name, and their results would be one.
    let mut ids = BTreeSet::new();
    all.retain(|adapter| ids.insert(adapter_id(adapter)));
    let names: Vec<String> = all.iter().map(|a| a.name.clone()).collect();
    match wanted {
        Some("all") => {}
        Some(text) => {
            all = all
                .into_iter()
                .filter(|a| a.matches(text))
                .take(1)
                .collect()
        }
        None => all.truncate(1),
    }
    match all.is_empty() {
        false => Ok(all),
        true => Err(render::Error::NoAdapter {
            wanted: wanted.map(str::to_owned),
            found: names,
        }
        .into()),
    }
}

fn file_name(job: &Job, adapter: &AdapterReport, run: &str) -> String {
    let id = adapter_id(adapter);
    match job.kind {
        Kind::Picture => format!("{}.{id}{EXTENSION}", job.key),
        Kind::Time => format!("{}.{id}.{run}{EXTENSION}", job.key),
    }
}

/// One job on one adapter.
struct Task<'a> {
    job: &'a Job,
    adapter: &'a AdapterReport,
    file: PathBuf,
}

impl Task<'_> {
    /// The result that is there. One that cannot be read, as after a power cut, is measured again.
    fn known(&self) -> Option<Outcome> {
        merge::read(&self.file).ok()
    }
}

/// Results of one worker.
#[derive(Default)]
struct Found {
    measured: usize,
    broken: usize,
    failed: usize,
    /// Jobs whose files are not those of the list.
    stale: Vec<String>,
}

struct Runner<'a> {
    args: &'a EvaluateArgs,
    host: String,
    run: String,
    /// Files that differ from those of a job's list, by path and hash.
    hashes: BTreeMap<(String, String), String>,
}

/// Why each of the files of the tasks is not the one of its list, where it is not.
fn changed_files(tasks: &[(Task<'_>, Option<Outcome>)]) -> BTreeMap<(String, String), String> {
    let mut seen: BTreeMap<(String, String), Option<String>> = BTreeMap::new();
    for (path, hash) in tasks.iter().flat_map(|(task, _)| &task.job.files) {
        let known = seen.entry((path.clone(), hash.clone()));
        known.or_insert_with(|| match std::fs::read(path) {
            Err(e) => Some(e.to_string()),
            Ok(bytes) if jobs::hash(&bytes) != *hash => Some("it was changed".to_owned()),
            Ok(_) => None,
        });
    }
    seen.into_iter()
        .filter_map(|(file, why)| Some((file, why?)))
        .collect()
}

impl Runner<'_> {
    /// Runs one job and writes its result.
    ///
    /// # Errors
    /// The result cannot be written.
    fn evaluate(
        &self,
        task: &Task<'_>,
        known: Option<&Outcome>,
        found: &mut Found,
    ) -> Result<(), Failure> {
        let job = task.job;
        let mut files = job.files.iter();
        let stale = files.find_map(|(path, hash)| {
            let why = self.hashes.get(&(path.clone(), hash.clone()))?;
            Some(format!("{path}: {why}"))
        });
        if let Some(why) = stale {
            output::message(&format!("warning: {} is not run: {why}", named(job)));
            found.stale.push(why);
            return Ok(());
        }
        let lock = lock(task.adapter)?;
        let locked = match job.kind {
            Kind::Picture => lock.lock_shared(),
            Kind::Time => lock.lock(),
        };
        locked.map_err(|e| Failure(format!("error: the adapter cannot be locked: {e}")))?;
        // Another process may have the same share.
        if let Some(outcome) = task.known()
            && !outcome.is_open(self.args.attempts)
        {
            return Ok(());
        }
        let (start_ms, before) = (now(), load());
        let measured = self.measured(task);
        let run = (job.kind == Kind::Time).then(|| Run {
            id: self.run.clone(),
            host: self.host.clone(),
            start_ms,
            end_ms: now(),
            load: before.zip(load()).map(|(a, b)| [a, b]),
        });
        drop(lock);
        let result = match measured {
            Ok(report) => {
                found.measured += 1;
                found.broken += usize::from(report.is_broken());
                JobResult::Measured {
                    report: Box::new(report),
                }
            }
            Err(why) => {
                found.failed += 1;
                output::message(&format!("{}: {why}", named(job)));
                let attempts = match known.map(|outcome| &outcome.result) {
                    Some(JobResult::Failed { attempts, .. }) => attempts + 1,
                    _ => 1,
                };
                JobResult::Failed {
                    reason: Reason::of(&why),
                    why,
                    attempts,
                }
            }
        };
        let outcome = Outcome {
            schema: OUTCOME_SCHEMA.to_owned(),
            version: jobs::VERSION.to_owned(),
            key: job.key.clone(),
            kind: job.kind,
            input: job.input.clone(),
            variant: job.variant.clone(),
            adapter: task.adapter.clone(),
            run,
            result,
        };
        let name = task.file.file_name().unwrap_or_default();
        let file = emit::File {
            name: name.to_string_lossy().into_owned(),
            bytes: (serde_json::to_string_pretty(&outcome)? + "\n").into_bytes(),
        };
        emit::write(&self.args.out, &[file]).map_err(|e| Failure(format!("error: {e}")))?;
        Ok(())
    }

    /// The report of a job's own process.
    fn measured(&self, task: &Task<'_>) -> Result<Report, String> {
        let job = task.job;
        let mut command = worker::myself()?;
        // Only the job says how to draw.
        for (name, _) in std::env::vars_os() {
            if name.to_string_lossy().starts_with("PRESHADE_") {
                command.env_remove(name);
            }
        }
        command.env(worker::VARIABLE, worker::OF_A_JOB);
        let config = Temporary::new(&self.args.out, task)?;
        command.args(["verify", "--format", "json", "--config"]);
        command.arg(&config.0);
        command.args(["--adapter", &task.adapter.name]);
        if job.kind == Kind::Picture {
            command.args(["--time", "no"]);
        }
        command.args(&job.arguments);
        command
            .args(["--variant", &job.variant, "--"])
            .args(&job.input);
        let ended = worker::watched(command, &Limits::default(), self.args.seconds)
            .map_err(|why| why.replace("--limits seconds=N", "--seconds N"))?;
        if !matches!(ended.status.code(), Some(0 | 1 | 3)) {
            return Err(ended.why());
        }
        let mut report: Report = serde_json::from_str(&ended.out)
            .map_err(|e| format!("its report cannot be read: {e}"))?;
        if adapter_id(&report.adapter) != adapter_id(task.adapter) {
            return Err(format!("it ran on {}", report.adapter.name));
        }
        let [_, variant] = &report.variants[..] else {
            return Err(
                "its report is not of one variant: the configuration adds others".to_owned(),
            );
        };
        // What ended `verify`'s own workers may go by.
        if let Verdict::NotMeasured { why } = &variant.verdict
            && Reason::of(why) != Reason::Refused
        {
            return Err(why.clone());
        }
        // It names a temporary file.
        report.command = String::new();
        if job.kind == Kind::Picture {
            let costs = report.variants.iter_mut().filter_map(|v| v.cost.as_mut());
            costs.for_each(|cost| cost.creation_ms = None);
        }
        Ok(report)
    }
}

/// A job's configuration as a file, for as long as it runs.
struct Temporary(PathBuf);

impl Temporary {
    fn new(folder: &Path, task: &Task<'_>) -> Result<Self, String> {
        let (job, id) = (task.job, adapter_id(task.adapter));
        let name = format!(".{}.{id}.{}.toml", job.key, std::process::id());
        let path = folder.join(name);
        let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
        std::fs::create_dir_all(folder).map_err(failed)?;
        std::fs::write(&path, job.config.as_deref().unwrap_or_default()).map_err(failed)?;
        Ok(Self(path))
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// Input and variant, for messages.
fn named(job: &Job) -> String {
    format!("{} with {}", job.input.join(" "), job.variant)
}

/// The file that all processes of this machine lock while they use an adapter.
fn lock(adapter: &AdapterReport) -> Result<File, Failure> {
    let name = format!("preshade-adapter-{}.lock", adapter_id(adapter));
    let path = std::env::temp_dir().join(name);
    // Another user's cannot be written to, and need not be.
    let file = File::open(&path).or_else(|_| {
        let mut options = File::options();
        options.create(true).truncate(false).write(true).open(&path)
    });
    file.map_err(|e| Failure(format!("error: {}: {e}", path.display())))
}

/// Milliseconds since 1970.
fn now() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |d| u64::try_from(d.as_millis()).unwrap_or(u64::MAX))
}

/// Processes that wait for a core, on average over the last minute.
fn load() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/loadavg").ok()?;
    text.split_whitespace().next()?.parse().ok()
}

/// The machine's name.
fn host() -> String {
    let file = std::fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let variables = ["HOSTNAME", "COMPUTERNAME"].iter();
    let name = file.or_else(|| variables.filter_map(|v| std::env::var(v).ok()).next());
    let name = name.map(|n| n.trim().to_owned()).filter(|n| !n.is_empty());
    name.unwrap_or_else(|| "unknown".to_owned())
}

/// A name with only the characters of a run's name.
fn plain(name: &str) -> String {
    let keep = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
    name.chars().take(64).map(keep).collect()
}
