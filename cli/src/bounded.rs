//! Enforces `--limits seconds` and `memory` for this process. A watchdog thread ends the whole
//! process, because a parser, an analysis or a driver that hangs cannot be stopped otherwise.
//! [`crate::worker`] bounds the processes that measure variants.

use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use shader_text::limits::Limits;

/// Interval of the watchdog's checks.
const TICK: Duration = Duration::from_millis(20);

/// How long the process may take to end: a driver that hangs may hold it up.
const GRACE: Duration = Duration::from_secs(2);

struct Bound {
    seconds: u64,
    memory: u64,
    /// When the current work began; `None` while another process works.
    since: Option<Instant>,
    /// Prints why the process ends.
    tell: fn(&str),
}

static BOUND: Mutex<Option<Bound>> = Mutex::new(None);

fn with<T>(work: impl FnOnce(&mut Option<Bound>) -> T) -> T {
    work(&mut BOUND.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Bounds this process from now on, if the limits require it.
pub fn start(limits: &Limits, tell: fn(&str)) {
    if !limits.isolates() {
        return;
    }
    with(|bound| {
        *bound = Some(Bound {
            seconds: limits.seconds,
            memory: limits.memory,
            since: Some(Instant::now()),
            tell,
        });
    });
    static WATCHED: OnceLock<()> = OnceLock::new();
    WATCHED.get_or_init(|| {
        std::thread::spawn(watch);
    });
}

/// A step is done: the next one has its full time.
pub fn step() {
    with(|bound| {
        if let Some(since) = bound.as_mut().and_then(|b| b.since.as_mut()) {
            *since = Instant::now();
        }
    });
}

/// Stops the clock while others work.
pub fn pause() {
    with(|bound| bound.iter_mut().for_each(|b| b.since = None));
}

pub fn resume() {
    with(|bound| {
        bound
            .iter_mut()
            .for_each(|b| b.since = Some(Instant::now()))
    });
}

/// Does `work`, which waits for a process that has bounds of its own.
pub fn elsewhere<T>(work: impl FnOnce() -> T) -> T {
    pause();
    let done = work();
    resume();
    done
}

fn watch() {
    loop {
        std::thread::sleep(TICK);
        let found = with(|bound| {
            let bound = bound.as_ref()?;
            Some((exceeded(bound)?, bound.tell))
        });
        let Some((why, tell)) = found else {
            continue;
        };
        // The holder of stdout or stderr may be the one that hangs, and so may an exit handler.
        std::thread::spawn(|| {
            std::thread::sleep(GRACE);
            std::process::abort();
        });
        tell(&format!("error: {why}"));
        std::process::exit(2);
    }
}

fn exceeded(bound: &Bound) -> Option<String> {
    let since = bound.since?;
    if since.elapsed() > Duration::from_secs(bound.seconds) {
        return Some(too_long(bound.seconds));
    }
    let bytes = resident(std::process::id())?;
    (bytes > bound.memory).then(|| too_large(bytes))
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
