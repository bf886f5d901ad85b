//! A command's own work under `--limits seconds` and `memory`: reading, transforming, telling, and what it draws in this process. A thread of its own looks, for nothing takes
//! work back from a parser, an analysis or a driver that does not end; so the whole process ends. What is measured in other processes [`crate::worker`] bounds.

use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use preshade::limits::Limits;

use crate::{output, worker};

/// How often the clock is looked at.
const TICK: Duration = Duration::from_millis(20);

/// How long the process may take to end: a driver that hangs may hold it up.
const GRACE: Duration = Duration::from_secs(2);

/// What is bounded.
struct Bound {
    seconds: u64,
    memory: u64,
    /// When the work now in hand was begun; `None` while others work.
    since: Option<Instant>,
    /// Whether who reads stdout is left with JSON.
    wants_json: bool,
}

static BOUND: Mutex<Option<Bound>> = Mutex::new(None);

fn with<T>(work: impl FnOnce(&mut Option<Bound>) -> T) -> T {
    work(&mut BOUND.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Bounds all that this process does from now on, where the limits say so and no other process does it.
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

/// Does `work`, which waits for a process that has bounds of its own.
pub fn elsewhere<T>(work: impl FnOnce() -> T) -> T {
    let set = |since| with(|bound| bound.iter_mut().for_each(|b| b.since = since));
    set(None);
    let done = work();
    set(Some(Instant::now()));
    done
}

fn watch() {
    loop {
        std::thread::sleep(TICK);
        let Some((why, wants_json)) = with(|bound| bound.as_ref().and_then(exceeded)) else {
            continue;
        };
        // Whoever holds stdout or stderr may be what hangs, and so may what runs when a process ends.
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
