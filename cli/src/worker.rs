//! Measures variants, or inputs, in separate processes, so that one that hangs, crashes, loses its
//! device or uses up its memory does not affect the others.

use std::io::Read;
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use preshade::unstable::limits::Limits;

use crate::bounded;

/// Names, to the process that does it, which of the variants it measures: 0 is the original alone. Of
/// several inputs, which of them, from 1.
pub const VARIABLE: &str = "PRESHADE_WORKER";

/// Its value for a process that runs a whole job, as if a user had started it.
pub const OF_A_JOB: &str = "job";

/// Interval of checks on a worker.
const TICK: Duration = Duration::from_millis(20);

/// Seconds before the worker of a variant counts as hung, if no limit is set. A variant draws in
/// seconds, and a submission takes 120 at most.
pub const OF_A_VARIANT: u64 = 600;

/// The same for an input, of which a worker draws a hundred variants.
pub const OF_AN_INPUT: u64 = 3600;

/// The variant that this process is to measure for another one, if it is.
pub fn mine() -> Option<usize> {
    std::env::var(VARIABLE).ok()?.parse().ok()
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
    match ended.status.code() {
        Some(0 | 1) => Ok(ended.out),
        _ => Err(ended.why()),
    }
}

/// A command that runs this program.
///
/// # Errors
/// In words.
pub fn myself() -> Result<Command, String> {
    let program = std::env::current_exe();
    program.map(Command::new).map_err(not_started)
}

fn not_started(error: std::io::Error) -> String {
    format!("no process could be started for it: {error}")
}

/// A process that ended by itself.
pub struct Ended {
    /// Its exit status.
    pub status: ExitStatus,
    /// Its stdout.
    pub out: String,
    /// Its stderr.
    told: String,
}

impl Ended {
    /// Its exit status and the last line of its stderr.
    pub fn why(&self) -> String {
        let last = self.told.lines().rfind(|l| !l.trim().is_empty());
        let last = last.map_or(String::new(), |l| format!(": {}", l.trim()));
        format!("its process ended with {}{last}", self.status)
    }
}

/// Runs a command to its end, and kills it after `seconds`, or over the memory of `limits`.
///
/// # Errors
/// In words, if it was killed or did not start.
pub fn watched(mut command: Command, limits: &Limits, seconds: u64) -> Result<Ended, String> {
    let mut child = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(not_started)?;
    // Kept open while it runs.
    let alive = child.stdin.take();
    let out = drain(child.stdout.take());
    let told = drain(child.stderr.take());
    let start = Instant::now();
    let ended = loop {
        match child.try_wait() {
            Ok(Some(status)) => break Ok(status),
            Ok(None) => {}
            Err(e) => break Err(e.to_string()),
        }
        if start.elapsed() > Duration::from_secs(seconds) {
            break Err(too_long(seconds));
        }
        if let Some(bytes) = resident(child.id()).filter(|b| *b > limits.memory) {
            break Err(too_large(bytes));
        }
        std::thread::sleep(TICK);
    };
    if ended.is_err() {
        // It may have ended by itself in between.
        let _ = child.kill();
        let _ = child.wait();
    }
    drop(alive);
    let text =
        |bytes: Option<Vec<u8>>| String::from_utf8_lossy(&bytes.unwrap_or_default()).into_owned();
    let (out, told) = (text(out.join().ok()), text(told.join().ok()));
    Ok(Ended {
        status: ended?,
        out,
        told,
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

/// The reason for stopping a process that took too long.
pub fn too_long(seconds: u64) -> String {
    format!("it was stopped after {seconds} s (--limits seconds=N)")
}

/// The reason for stopping a process that used too much memory.
pub fn too_large(bytes: u64) -> String {
    let mib = bytes >> 20;
    format!("it was stopped at {mib} MiB of memory (--limits memory=N)")
}

/// Resident bytes of a process from `VmRSS` of `/proc`, if available.
pub fn resident(process: u32) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find(|l| l.starts_with("VmRSS:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib << 10)
}
