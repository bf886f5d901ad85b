//! Measures variants, or inputs, in separate processes, so that one that hangs, crashes, loses its
//! device or uses up its memory does not affect the others.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::ops::ControlFlow;
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use preshade_draw::render::turns::{Turn, Turns};
use preshade_draw::render::{AdapterChoice, Gpu};
use preshade_lab::jobs::hash;
use shader_text::limits::Limits;

use crate::{Failure, bounded};

/// Names, to the process that does it, which of the variants it measures: 0 is the original alone. Of
/// several inputs, which of them, from 1.
pub const VARIABLE: &str = "PRESHADE_WORKER";

/// Its value for a process that runs a whole job, as if a user had started it.
pub const OF_A_JOB: &str = "job";

/// The lock file by which jobs share their adapter.
pub const LOCK: &str = "PRESHADE_SHARED_ADAPTER";

/// Begins a line of a job's stderr that reports a [`Turn`].
const TURN: char = '\u{1e}';

/// Interval of checks on a worker.
const TICK: Duration = Duration::from_millis(20);

/// Seconds before the worker of a variant counts as hung, if no limit is set. A variant draws in
/// seconds, and a submission takes 120 at most.
pub const OF_A_VARIANT: u64 = 600;

/// The same for an input. A worker draws a hundred variants of it.
pub const OF_AN_INPUT: u64 = 3600;

/// The variant that this process is to measure for another one, if it is.
pub fn mine() -> Option<usize> {
    std::env::var(VARIABLE).ok()?.parse().ok()
}

/// Whether this process runs a job, or a part of one. Then its command line alone counts, and
/// neither the environment nor a configuration file of this machine.
pub fn is_job() -> bool {
    has_parent() && std::env::var_os(LOCK).is_some()
}

/// Whether another process of preshade waits for this one.
pub fn has_parent() -> bool {
    std::env::var_os(VARIABLE).is_some()
}

/// Ends this process when its parent ends for any reason: the pipe that is its stdin then has no
/// writer.
pub fn end_with_parent() {
    std::thread::spawn(|| {
        let mut rest = Vec::new();
        let _ = std::io::stdin().lock().read_to_end(&mut rest);
        // Whatever the graphics driver is at: no destructor runs.
        std::process::abort();
    });
}

/// Opens an adapter: the best one, or the one with this text in its name, driver or backend.
pub fn open(adapter: Option<&str>, limits: &Limits) -> Result<Gpu, Failure> {
    let choice = adapter.map_or(AdapterChoice::Best, |text| {
        AdapterChoice::Matching(text.to_owned())
    });
    in_turns(Gpu::with_trust(&choice, limits.trust())?)
}

/// Takes turns with the jobs of other processes, if this is one.
fn in_turns(gpu: Gpu) -> Result<Gpu, Failure> {
    match std::env::var_os(LOCK).filter(|_| is_job()) {
        None => Ok(gpu),
        Some(path) => {
            let path = Path::new(&path);
            let (lock, gate) = (opened(path)?, opened(&path.with_extension("gate"))?);
            Ok(gpu.in_turns(Turns::new([lock, gate], tell))?)
        }
    }
}

/// Takes a lock for a file that several jobs need, so that one of them makes it. To be taken before the
/// adapter is shared: who holds a share while it waits would keep the other one from timing.
pub fn first_of_several(file: &Path) -> Result<File, Failure> {
    let file = std::path::absolute(file)?;
    let key = hash(file.as_os_str().as_encoded_bytes());
    let lock = opened(&std::env::temp_dir().join(format!("preshade-{key}.first")))?;
    if lock.try_lock().is_err() {
        tell(Turn::Waits);
        lock.lock()?;
        tell(Turn::Runs);
    }
    Ok(lock)
}

/// Opens a lock file, and makes it if it is missing.
pub fn opened(lock: &Path) -> Result<File, Failure> {
    let mut options = File::options();
    let file = options.create(true).truncate(false).write(true).open(lock);
    // Another user's cannot be written to, and need not be.
    let file = file.or_else(|e| File::open(lock).map_err(|_| e));
    file.map_err(|e| Failure(format!("error: {}: {e}", lock.display())))
}

fn tell(turn: Turn) {
    match turn {
        Turn::Waits => {
            bounded::pause();
            eprintln!("{TURN}waits");
        }
        Turn::Runs => {
            bounded::resume();
            eprintln!("{TURN}runs");
        }
        Turn::Alone { start_ms, end_ms } => eprintln!("{TURN}alone {start_ms} {end_ms}"),
    }
}

/// Parses a line of [`tell`].
fn turn(line: &str) -> Option<Turn> {
    let mut words = line.strip_prefix(TURN)?.split(' ');
    Some(match words.next()? {
        "waits" => Turn::Waits,
        "runs" => Turn::Runs,
        "alone" => Turn::Alone {
            start_ms: words.next()?.parse().ok()?,
            end_ms: words.next()?.parse().ok()?,
        },
        _ => return None,
    })
}

/// Runs this command again for one variant or input, within `limits` and `patience` seconds, and
/// returns its stdout.
///
/// # Errors
///
/// Why it has no result, in words for a report.
pub fn run(which: usize, limits: &Limits, patience: u64) -> Result<String, String> {
    bounded::elsewhere(|| ended(which, limits, patience))
}

fn ended(which: usize, limits: &Limits, patience: u64) -> Result<String, String> {
    let mut command = myself()?;
    command
        .args(std::env::args_os().skip(1))
        .env(VARIABLE, which.to_string());
    let ended = watched(command, limits, limits.seconds.min(patience))?;
    let status = ended.status.clone()?;
    match status.code() {
        Some(0 | 1) => Ok(ended.out),
        _ => Err(ended.why(status)),
    }
}

/// Runs `work` for each item with its number, on so many threads, until one returns `Break`.
pub fn each<T: Sync>(
    threads: usize,
    items: &[T],
    work: impl Fn(usize, &T) -> ControlFlow<()> + Sync,
) {
    let (next, is_stopped) = (AtomicUsize::new(0), AtomicBool::new(false));
    let run = || {
        while !is_stopped.load(Ordering::Relaxed) {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(index) else { break };
            if work(index, item).is_break() {
                is_stopped.store(true, Ordering::Relaxed);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..threads.min(items.len()) {
            scope.spawn(run);
        }
    });
}

/// A command that runs this program.
pub fn myself() -> Result<Command, String> {
    let program = std::env::current_exe();
    program.map(Command::new).map_err(not_started)
}

fn not_started(error: std::io::Error) -> String {
    format!("no process could be started for it: {error}")
}

pub struct Ended {
    /// Its exit status, or why it was killed.
    pub status: Result<ExitStatus, String>,
    pub out: String,
    /// The lines of its stderr that are neither empty nor a [`Turn`].
    pub told: Vec<String>,
    /// When it had a shared adapter for itself: starts and ends in milliseconds.
    pub alone: Vec<[u64; 2]>,
}

impl Ended {
    /// Its exit status, and the last error on its stderr or the last line.
    pub fn why(&self, status: ExitStatus) -> String {
        let error = self.told.iter().rfind(|line| line.starts_with("error"));
        match error.or(self.told.last()) {
            None => format!("its process ended with {status}"),
            Some(told) => format!("its process ended with {status}: {told}"),
        }
    }
}

/// Runs a command to its end, and kills it after `seconds`, or over the memory of `limits`. Waiting for an
/// adapter that others use does not count.
pub fn watched(mut command: Command, limits: &Limits, seconds: u64) -> Result<Ended, String> {
    let mut child = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(not_started)?;
    // Holds the pipe open while it runs.
    let alive = child.stdin.take();
    let out = drain(child.stdout.take());
    let waits = Arc::new(AtomicBool::new(false));
    let told = listen(child.stderr.take(), Arc::clone(&waits));
    let (mut spent, mut before) = (Duration::ZERO, Instant::now());
    let status = loop {
        match child.try_wait() {
            Ok(Some(status)) => break Ok(status),
            Ok(None) => {}
            Err(e) => break Err(e.to_string()),
        }
        let now = Instant::now();
        if !waits.load(Ordering::Relaxed) {
            spent += now - before;
        }
        before = now;
        if spent > Duration::from_secs(seconds) {
            break Err(bounded::too_long(seconds));
        }
        if let Some(bytes) = bounded::resident(child.id()).filter(|b| *b > limits.memory) {
            break Err(bounded::too_large(bytes));
        }
        std::thread::sleep(TICK);
    };
    if status.is_err() {
        // It may have ended by itself in between.
        let _ = child.kill();
        let _ = child.wait();
    }
    drop(alive);
    let (told, alone) = told.join().unwrap_or_default();
    Ok(Ended {
        status,
        out: String::from_utf8_lossy(&out.join().unwrap_or_default()).into_owned(),
        told,
        alone,
    })
}

/// Reads stderr to its end in a thread. Returns its lines, and when the process was alone.
fn listen(
    pipe: Option<impl Read + Send + 'static>,
    waits: Arc<AtomicBool>,
) -> std::thread::JoinHandle<(Vec<String>, Vec<[u64; 2]>)> {
    std::thread::spawn(move || {
        let (mut told, mut alone) = (Vec::new(), Vec::new());
        let lines = pipe.map(|pipe| BufReader::new(pipe).split(b'\n'));
        for line in lines.into_iter().flatten().map_while(Result::ok) {
            let line = String::from_utf8_lossy(&line);
            let Some(turn) = turn(&line) else {
                if !line.trim().is_empty() {
                    told.push(line.trim().to_owned());
                }
                continue;
            };
            match turn {
                Turn::Waits => waits.store(true, Ordering::Relaxed),
                Turn::Runs => waits.store(false, Ordering::Relaxed),
                Turn::Alone { start_ms, end_ms } => alone.push([start_ms, end_ms]),
            }
            // A job's own workers are not its parent's.
            if is_job() {
                tell(turn);
            }
        }
        // A process that was killed while it waited does not report the end of its wait.
        if waits.load(Ordering::Relaxed) && is_job() {
            tell(Turn::Runs);
        }
        (told, alone)
    })
}

/// Reads a pipe to its end in a thread, because a full pipe would block the process.
fn drain(pipe: Option<impl Read + Send + 'static>) -> std::thread::JoinHandle<Vec<u8>> {
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut pipe) = pipe {
            let _ = pipe.read_to_end(&mut bytes);
        }
        bytes
    })
}

/// The value that a process printed, or the error that it printed instead.
pub fn printed<T: serde::de::DeserializeOwned>(json: &str) -> Result<T, String> {
    serde_json::from_str(json).map_err(|e| {
        let value: serde_json::Value = serde_json::from_str(json).unwrap_or_default();
        let error = value["errors"][0].as_str().map(str::to_owned);
        error.unwrap_or_else(|| format!("its report cannot be read: {e}"))
    })
}
