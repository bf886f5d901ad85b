//! Enforces `--limits seconds` and `memory` for this process. A watchdog thread ends the whole
//! process, because a parser, an analysis or a driver that hangs cannot be stopped otherwise.
//! [`crate::worker`] bounds the processes that measure variants.

use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use shader_text::limits::Limits;

use crate::{output, worker};

/// Interval of the watchdog.
const TICK: Duration = Duration::from_millis(20);

/// How long the process may take to end: a driver that hangs may hold it up.
const GRACE: Duration = Duration::from_secs(2);

struct Bound {
    seconds: u64,
    memory: u64,
    /// When the work now in hand was begun; `None` while others work.
    since: Option<Instant>,
    /// Whether the reader of stdout expects JSON.
    wants_json: bool,
}

static BOUND: Mutex<Option<Bound>> = Mutex::new(None);

fn with<T>(work: impl FnOnce(&mut Option<Bound>) -> T) -> T {
    work(&mut BOUND.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Bounds this process from now on, if the limits say so and no parent process does.
pub fn start(limits: &Limits, wants_json: bool) {
    if !limits.isolates() || worker::mine().is_some() {
        return;
    }
    with(|bound| {
        *bound = Some(Bound {
            seconds: limits.seconds,
            memory: limits.memory,
            since: Some(Instant::now()),
            wants_json,
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
        let Some((why, wants_json)) = with(|bound| bound.as_ref().and_then(exceeded)) else {
            continue;
        };
        // The holder of stdout or stderr may be the one that hangs, and so may an exit handler.
        std::thread::spawn(|| {
            std::thread::sleep(GRACE);
            std::process::abort();
        });
        let message = format!("error: {why}");
        output::message(&message);
        if wants_json {
            output::failed(&message);
        }
        std::process::exit(2);
    }
}

fn exceeded(bound: &Bound) -> Option<(String, bool)> {
    let since = bound.since?;
    let why = if since.elapsed() > Duration::from_secs(bound.seconds) {
        worker::too_long(bound.seconds)
    } else {
        let bytes = worker::resident(std::process::id())?;
        (bytes > bound.memory).then(|| worker::too_large(bytes))?
    };
    Some((why, bound.wants_json))
}
