//! `preshade evaluate`: runs jobs, and keeps one file for each result.

use std::collections::BTreeMap;
use std::fs::File;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use preshade_draw::render::{self, AdapterReport, Card, turns};
use preshade_lab::jobs::files::{EXTENSION, MACHINES};
use preshade_lab::jobs::{
    self, EVERY, Exhaustive, Found, Job, JobResult, Kind, Machine, OUTCOME_SCHEMA, Outcome,
    Partition, Reason, Run, adapter_id,
};
use preshade_lab::measure::record::Report;
use preshade_plan::contract::Verdict;
use shader_text::limits::Limits;

use crate::output::{self, ProgressLine};
use crate::{Ending, Failure, verify, worker};

/// Name of a run without `--run`: the same on all machines, so that a job that moves to another one
/// is not measured twice.
const RUN: &str = "first";

/// Times to try a job that fails, without `--attempts`.
const ATTEMPTS: u32 = 2;

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade evaluate --jobs jobs.jsonl --out results/
  preshade evaluate --jobs jobs.jsonl --partition hash:3/16 --adapter llvmpipe --out results/
  preshade evaluate --jobs jobs.jsonl --adapter all --workers 4 --out results/

Each job runs in a process of its own. Its result is one file, which is written whole or not at all:
the same command again goes on where it was. A broken promise, a lost device, a crash and a job that
takes too long are results too, and the next job runs. While a job times, no other draws on its card,
also of another `evaluate`.
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
    /// Part of an adapter's name, driver or backend, or `#2` for the second of `preshade adapters`;
    /// `all` runs each job on every model. Of several cards of one model each runs a part.
    #[arg(long, value_name = "TEXT")]
    adapter: Option<String>,
    /// Jobs at once; default: one for each card. While one times, the others compile and compare.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    workers: Option<u16>,
    /// Stop a job after so many seconds. Waiting for other jobs does not count.
    /// Default: 600, and 3600 for every candidate of a scene.
    #[arg(long, value_name = "SECONDS")]
    seconds: Option<u64>,
    /// Try a job that fails so many times in all, also over several runs of this command.
    #[arg(long, value_name = "N", default_value_t = ATTEMPTS, value_parser = clap::value_parser!(u32).range(1..))]
    attempts: u32,
    /// Name of this run of timing jobs; each run adds samples.
    #[arg(long, value_name = "NAME", default_value = RUN, value_parser = parse_run)]
    run: String,
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

pub fn run(args: &EvaluateArgs) -> Result<Ending, Failure> {
    let all = jobs::files::jobs(&args.jobs)?;
    let share = all.into_iter().filter(|job| {
        let is_kind = args.kind.is_none_or(|kind| match kind {
            KindArg::Picture => job.kind == Kind::Picture,
            KindArg::Time => job.kind == Kind::Time,
        });
        is_kind && args.partition.is_none_or(|p| p.contains(&job.key))
    });
    let cards = render::cards();
    note_machine(&args.out, &cards)?;
    let settings = Settings {
        workers: args.workers.map_or(0, usize::from),
        seconds: args.seconds,
        attempts: args.attempts,
        run: args.run.clone(),
        ..Settings::new(args.out.clone(), models(cards, args.adapter.as_deref())?)
    };
    let tally = all_of(&share.collect::<Vec<_>>(), &settings)?;
    if tally.nowhere > 0 {
        output::message(&format!(
            "warning: {} for adapters that this machine does not have",
            output::count(tally.nowhere, "job")
        ));
    }
    output::message(&format!(
        "{}: {} measured, {} of them broken; {} failed; {} not run",
        output::count(tally.jobs, "job"),
        tally.measured,
        tally.broken,
        tally.failed,
        tally.stale
    ));
    match tally.stale {
        0 => Ok(Ending::Fine),
        n => Err(Failure(format!(
            "error: {} not run: their files are not those of the list",
            output::count(n, "job")
        ))),
    }
}

/// Writes which adapters this machine has, for `merge --adapters`.
fn note_machine(out: &Path, cards: &[Card]) -> Result<(), Failure> {
    verify::check_folder(out)?;
    let host = host();
    let text = serde_json::to_string_pretty(&Machine::new(&host, cards))? + "\n";
    let file = out.join(format!("{}{MACHINES}", plain(&host)));
    Ok(shader_text::files::write_file(&file, text.into_bytes())?)
}

pub struct Settings {
    pub out: PathBuf,
    /// Each job runs on each of them that its filter lets through.
    pub models: Vec<Model>,
    /// Jobs at once; 0: one for each card.
    pub workers: usize,
    /// A job is stopped after so many seconds. `None`: after the worker's limit for its kind of
    /// job.
    pub seconds: Option<u64>,
    /// A job that fails is tried so many times in all.
    pub attempts: u32,
    /// Name of this run of timing jobs.
    pub run: String,
}

impl Settings {
    pub fn new(out: PathBuf, models: Vec<Model>) -> Self {
        Self {
            out,
            models,
            workers: 0,
            seconds: None,
            attempts: ATTEMPTS,
            run: RUN.to_owned(),
        }
    }
}

#[derive(Debug, Default)]
pub struct Tally {
    /// Jobs that had no result.
    pub jobs: usize,
    /// Jobs that no adapter may run.
    pub nowhere: usize,
    /// Jobs that have a report now.
    pub measured: usize,
    /// Those that broke a contract.
    pub broken: usize,
    pub failed: usize,
    /// Jobs whose files are not those of the list.
    pub stale: usize,
}

impl Tally {
    /// Adds the result of a job.
    fn add(&mut self, one: &Self) {
        self.measured += one.measured;
        self.broken += one.broken;
        self.failed += one.failed;
        self.stale += one.stale;
    }
}

/// Adapters of one name, driver and backend: results of one are those of all.
pub struct Model {
    report: AdapterReport,
    cards: Vec<CardShare>,
}

/// A card, and the number of jobs that this process runs there.
struct CardShare {
    card: Card,
    busy: AtomicUsize,
}

impl Model {
    pub fn id(&self) -> String {
        adapter_id(&self.report)
    }

    /// The card with the fewest jobs of this process, and of those one that no other process uses.
    pub fn take(&self) -> Result<Seat<'_>, Failure> {
        let mut cards: Vec<&CardShare> = self.cards.iter().collect();
        cards.sort_by_key(|place| place.busy.load(Ordering::Relaxed));
        let mut first = None;
        for place in &cards {
            let file = worker::opened(&lock_of(&place.card, "seat"))?;
            if file.try_lock().is_ok() {
                first = Some((*place, Some(file)));
                break;
            }
        }
        let (place, file) = match (first, cards.first()) {
            (Some(first), _) => first,
            (None, Some(place)) => (*place, None),
            (None, None) => return Err(Failure("error: a model without cards: a bug".to_owned())),
        };
        place.busy.fetch_add(1, Ordering::Relaxed);
        Ok(Seat {
            place,
            _of_others: file,
        })
    }
}

pub struct Seat<'a> {
    place: &'a CardShare,
    /// Locked while it is in use, to make other processes take other cards.
    _of_others: Option<File>,
}

impl Seat<'_> {
    /// A command for a process on this card, which takes turns with those of others. Its arguments
    /// alone define how to draw: no variable of preshade's is passed on.
    pub fn command(&self) -> Result<Command, Failure> {
        let mut command = worker::myself().map_err(|why| Failure(format!("error: {why}")))?;
        for (name, _) in std::env::vars_os() {
            if name.to_string_lossy().starts_with("PRESHADE_") {
                command.env_remove(name);
            }
        }
        command.env(worker::VARIABLE, worker::OF_A_JOB);
        command.env(worker::LOCK, lock_of(&self.place.card, "lock"));
        Ok(command)
    }

    /// The flag that selects this card.
    pub fn adapter(&self) -> String {
        format!("--adapter={}", self.place.card.choice)
    }
}

impl Drop for Seat<'_> {
    fn drop(&mut self) {
        self.place.busy.fetch_sub(1, Ordering::Relaxed);
    }
}

/// The models among `cards` that match. Without `wanted` the best one; `all`: each.
pub fn models(cards: Vec<Card>, wanted: Option<&str>) -> Result<Vec<Model>, Failure> {
    let found = cards.iter().map(|card| card.report.name.clone()).collect();
    let mut models: Vec<Model> = Vec::new();
    for card in cards {
        let is_wanted = match wanted {
            None | Some("all") => true,
            Some(text) => card.choice == text || card.report.matches(text),
        };
        if !is_wanted {
            continue;
        }
        let id = adapter_id(&card.report);
        let report = card.report.clone();
        let place = CardShare {
            card,
            busy: AtomicUsize::new(0),
        };
        match models.iter_mut().find(|model| model.id() == id) {
            Some(model) => model.cards.push(place),
            None => models.push(Model {
                report,
                cards: vec![place],
            }),
        }
    }
    if wanted != Some("all") {
        models.truncate(1);
    }
    match models.is_empty() {
        false => Ok(models),
        true => Err(render::Error::NoAdapter {
            wanted: wanted.map(str::to_owned),
            found,
        }
        .into()),
    }
}

/// Runs those jobs that have no result. Two processes may do so with one folder.
pub fn all_of(jobs: &[Job], settings: &Settings) -> Result<Tally, Failure> {
    verify::check_folder(&settings.out)?;
    let host = host();
    let run = settings.run.clone();
    let runner = Runner {
        settings,
        host,
        run,
        files: Mutex::default(),
    };
    let mut tally = Tally::default();
    let (mut tasks, mut done, mut given_up) = (Vec::new(), 0, 0);
    for job in jobs {
        let wanted = job.adapter.as_deref();
        let may_run = settings.models.iter();
        let may_run = may_run.filter(|m| wanted.is_none_or(|text| m.report.matches(text)));
        let mut is_somewhere = false;
        for model in may_run {
            is_somewhere = true;
            let name = file_name(job, &model.report, &runner.run);
            let task = Task {
                file: settings.out.join(name),
                job,
                model,
            };
            match task.known().filter(|o| !o.is_open(settings.attempts)) {
                None => tasks.push(task),
                Some(known) => match runner.stale(job) {
                    Some(why) => {
                        output::message(&format!("warning: {} is not run: {why}", job.name()));
                        tally.stale += 1;
                    }
                    None => {
                        done += 1;
                        given_up += usize::from(matches!(known.result, JobResult::Failed { .. }));
                    }
                },
            }
        }
        tally.nowhere += usize::from(!is_somewhere);
    }
    // A long job that starts last would run alone.
    tasks.sort_by(|a, b| b.job.seconds.total_cmp(&a.job.seconds));
    tally.jobs = tasks.len();
    if done > 0 {
        output::message(&format!("{} there already", output::count(done, "result")));
    }
    if given_up > 0 {
        output::message(&format!(
            "{given_up} of them failed {} times or more: a larger --attempts tries again",
            settings.attempts
        ));
    }
    let cards = settings.models.iter().map(|m| m.cards.len()).sum();
    let workers = match settings.workers {
        0 => cards,
        n => n,
    };
    let bar = Mutex::new(output::bar());
    let found = Mutex::new((tally, Ok(())));
    worker::each(workers, &tasks, |index, task| {
        show(&bar, |bar| {
            bar.set_position((index * 1000 / tasks.len()) as u64);
            bar.set_message(task.job.name());
        });
        let result = runner.evaluate(task, &bar);
        let (tally, ended) = &mut *found.lock().unwrap_or_else(PoisonError::into_inner);
        match result {
            Ok(one) => tally.add(&one),
            Err(failure) => {
                // A disk that is full stays full.
                *ended = Err(failure);
                return ControlFlow::Break(());
            }
        }
        ControlFlow::Continue(())
    });
    let (tally, ended) = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    ended?;
    show(&bar, ProgressLine::finish_and_clear);
    Ok(tally)
}

fn show(bar: &Mutex<ProgressLine>, change: impl FnOnce(&ProgressLine)) {
    change(&bar.lock().unwrap_or_else(PoisonError::into_inner));
}

fn file_name(job: &Job, adapter: &AdapterReport, run: &str) -> String {
    let id = adapter_id(adapter);
    match job.kind {
        Kind::Picture => format!("{}.{id}{EXTENSION}", job.key),
        Kind::Time => format!("{}.{id}.{run}{EXTENSION}", job.key),
    }
}

/// One job on one model of adapters.
struct Task<'a> {
    job: &'a Job,
    model: &'a Model,
    file: PathBuf,
}

impl Task<'_> {
    /// The result that is there. One that cannot be read is measured again.
    fn known(&self) -> Option<Outcome> {
        jobs::files::outcome(&self.file).ok()
    }

    fn is_open(&self, attempts: u32) -> bool {
        self.known().is_none_or(|outcome| outcome.is_open(attempts))
    }
}

struct Runner<'a> {
    settings: &'a Settings,
    host: String,
    run: String,
    /// Hashes of files, with the size and the time of the last change that they belong to.
    files: Mutex<BTreeMap<String, (Stamp, String)>>,
}

type Stamp = (u64, Option<SystemTime>);

impl Runner<'_> {
    /// Why a file is not the one of the list, if it is not.
    fn changed(&self, path: &str, hash: &str) -> Option<String> {
        let stamp = match std::fs::metadata(path) {
            Ok(file) => (file.len(), file.modified().ok()),
            Err(e) => return Some(e.to_string()),
        };
        let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        let known = files.get(path).filter(|(at, _)| *at == stamp);
        let now = match known {
            Some((_, hash)) => hash.clone(),
            None => match std::fs::read(path) {
                Ok(bytes) => jobs::hash(&bytes),
                Err(e) => return Some(e.to_string()),
            },
        };
        let is_changed = now != hash;
        files.insert(path.to_owned(), (stamp, now));
        is_changed.then(|| "it was changed".to_owned())
    }

    /// Why a job's files are not those of the list, if they are not.
    fn stale(&self, job: &Job) -> Option<String> {
        let mut files = job.files.iter();
        files.find_map(|(path, hash)| Some(format!("{path}: {}", self.changed(path, hash)?)))
    }

    /// Runs one job until it has a result or was tried often enough, and writes the result each time.
    fn evaluate(&self, task: &Task<'_>, bar: &Mutex<ProgressLine>) -> Result<Tally, Failure> {
        let job = task.job;
        let mut tally = Tally::default();
        let tell = |why: &str| {
            let message = format!("{}: {why}", job.name());
            show(bar, |bar| bar.suspend(|| output::message(&message)));
        };
        let mut ended = None;
        // Another process may have the same share.
        while task.is_open(self.settings.attempts) {
            let mut stale = self.stale(job);
            let mut measured = None;
            if stale.is_none() {
                measured = Some(self.measured(task)?);
                // It may have read files that changed meanwhile.
                stale = self.stale(job);
            }
            let (None, Some((run, result))) = (&stale, measured) else {
                tell(&format!("not run: {}", stale.unwrap_or_default()));
                tally.stale += 1;
                return Ok(tally);
            };
            if let Err(why) = &result {
                tell(why);
            }
            ended = Some(result.as_ref().map(Found::is_broken).map_err(|_| ()));
            self.keep(task, run, result)?;
        }
        match ended {
            None => {}
            Some(Err(())) => tally.failed += 1,
            Some(Ok(is_broken)) => {
                tally.measured += 1;
                tally.broken += usize::from(is_broken);
            }
        }
        Ok(tally)
    }

    fn keep(
        &self,
        task: &Task<'_>,
        run: Run,
        result: Result<Found, String>,
    ) -> Result<(), Failure> {
        let job = task.job;
        let result = match result {
            Ok(found) => JobResult::Measured { found },
            Err(why) => JobResult::Failed {
                reason: Reason::of(&why),
                why,
                attempts: match task.known().map(|outcome| outcome.result) {
                    None => 1,
                    Some(JobResult::Failed { attempts, .. }) => attempts + 1,
                    // Another process was luckier.
                    Some(JobResult::Measured { .. }) => return Ok(()),
                },
            },
        };
        let outcome = Outcome {
            schema: OUTCOME_SCHEMA.to_owned(),
            version: jobs::VERSION.to_owned(),
            job: job.in_any_list(),
            adapter: task.model.report.clone(),
            run: (job.kind == Kind::Time).then_some(run),
            result,
        };
        let text = serde_json::to_string_pretty(&outcome)? + "\n";
        Ok(shader_text::files::write_file(
            &task.file,
            text.into_bytes(),
        )?)
    }

    /// The result of a job's own process, or the reason why there is none.
    fn measured(&self, task: &Task<'_>) -> Result<(Run, Result<Found, String>), Failure> {
        let seat = task.model.take()?;
        let (start_ms, before) = (turns::since_1970(), load());
        let command = self.command(task, &seat)?;
        let seconds = self
            .settings
            .seconds
            .unwrap_or(match task.job.variant == EVERY {
                true => worker::OF_AN_INPUT,
                false => worker::OF_A_VARIANT,
            });
        let ended = worker::watched(command, &Limits::default(), seconds)
            .map_err(|why| Failure(format!("error: {why}")))?;
        let run = Run {
            id: self.run.clone(),
            host: self.host.clone(),
            boot: turns::timeline().0,
            card: seat.place.card.address.clone(),
            start_ms,
            end_ms: turns::since_1970(),
            alone: ended.alone.clone(),
            load: before.zip(load()).map(|(a, b)| [a, b]),
        };
        let adapter = &task.model.report;
        let found = match &ended.status {
            Err(why) => Err(why.replace("--limits seconds=N", "--seconds N")),
            Ok(status) if !matches!(status.code(), Some(0 | 1 | 3)) => Err(ended.why(*status)),
            Ok(_) if task.job.variant == EVERY => worker::printed::<Exhaustive>(&ended.out)
                .and_then(|found| match found.adapter == adapter_id(adapter) {
                    true => Ok(Found::Exhausted(Box::new(found))),
                    false => Err("it ran on another adapter".to_owned()),
                }),
            Ok(_) => {
                worker::printed::<Report>(&ended.out).and_then(|r| checked(r, task.job, adapter))
            }
        };
        Ok((run, found))
    }

    fn command(&self, task: &Task<'_>, seat: &Seat<'_>) -> Result<Command, Failure> {
        let job = task.job;
        let (mut command, adapter) = (seat.command()?, seat.adapter());
        match job.variant == EVERY {
            true => {
                command.args(["plan", "--exhaustive", &adapter]);
                if !job
                    .arguments
                    .iter()
                    .any(|word| word.starts_with("--model="))
                {
                    let name = format!("{}.{}.probes.json", task.model.id(), jobs::VERSION);
                    command.arg("--probes").arg(self.settings.out.join(name));
                }
            }
            false => {
                command.args(["verify", "--format=json", &adapter]);
                command.arg(format!("--variant={}", job.variant));
                if job.kind == Kind::Picture {
                    command.arg("--time=no");
                }
            }
        }
        command.args(&job.arguments).arg("--").args(&job.input);
        Ok(command)
    }
}

/// The report, without parts that differ from run to run.
fn checked(mut report: Report, job: &Job, adapter: &AdapterReport) -> Result<Found, String> {
    if adapter_id(&report.adapter) != adapter_id(adapter) {
        return Err(format!("it ran on {}", report.adapter.name));
    }
    if report.variants.len() != 2 {
        return Err("its report is not of one variant".to_owned());
    }
    // Conditions that ended `verify`'s own workers may go away.
    for variant in &report.variants {
        if let Verdict::NotMeasured { why } = &variant.verdict
            && Reason::of(why) != Reason::Refused
        {
            return Err(why.clone());
        }
    }
    report.command = String::new();
    if job.kind == Kind::Picture {
        let costs = report.variants.iter_mut().filter_map(|v| v.cost.as_mut());
        costs.for_each(|cost| cost.creation_ms = None);
    }
    Ok(Found::Report(Box::new(report)))
}

/// A file that all processes lock which use a card.
fn lock_of(card: &Card, what: &str) -> PathBuf {
    let place = jobs::hash(card.address.as_bytes());
    std::env::temp_dir().join(format!("preshade-{place}.{what}"))
}

/// Processes that wait for a core, on average over the last minute.
fn load() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/loadavg").ok()?;
    text.split_whitespace().next()?.parse().ok()
}

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
