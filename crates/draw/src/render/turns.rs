//! Lets several processes take turns on an adapter: they draw pictures at the same time, but
//! measure times alone.

use std::fs::File;
use std::io;
use std::sync::{Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

/// Lock files that all processes on an adapter share.
#[derive(Debug)]
pub struct Turns {
    lock: File,
    /// Held by a process that waits to be alone. Meanwhile no other process gets a share.
    gate: File,
    /// Whether the adapter is the CPU. Then all work of this process disturbs measurements, not
    /// only its drawing.
    is_cpu: bool,
    tell: fn(Turn),
    state: Mutex<State>,
}

/// A state of a process on a shared adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// Waiting for other processes.
    Waits,
    /// The wait is over.
    Runs,
    /// It had the adapter for itself. Times are milliseconds of [`timeline`].
    Alone { start_ms: u64, end_ms: u64 },
}

#[derive(Debug, Default)]
struct State {
    /// Number of threads that are drawing.
    shared: usize,
    is_alone: bool,
}

impl Turns {
    /// Shares an adapter through these two lock files. Calls `tell` on each [`Turn`].
    pub fn new([lock, gate]: [File; 2], tell: fn(Turn)) -> Self {
        Self {
            lock,
            gate,
            is_cpu: false,
            tell,
            state: Mutex::default(),
        }
    }

    /// Starts to take turns. If the adapter is the CPU, this process holds a share from now on.
    pub(super) fn begin(mut self, is_cpu: bool) -> io::Result<Self> {
        self.is_cpu = is_cpu;
        if is_cpu {
            self.take_share()?;
        }
        Ok(self)
    }

    /// Draws at the same time as other processes.
    pub(super) fn beside<T>(&self, draw: impl FnOnce() -> T) -> io::Result<T> {
        {
            let mut state = self.state();
            if !self.is_cpu && !state.is_alone && state.shared == 0 {
                self.take_share()?;
            }
            state.shared += 1;
        }
        let _end = OnDrop(|| {
            let mut state = self.state();
            state.shared -= 1;
            if !self.is_cpu && !state.is_alone && state.shared == 0 {
                // The system unlocks it when the process ends.
                let _ = self.lock.unlock();
            }
        });
        Ok(draw())
    }

    /// Runs `time` while no other process draws. Only one thread at a time may call this, and
    /// meanwhile the others of this process must not draw.
    pub(super) fn alone<T>(&self, time: impl FnOnce() -> T) -> io::Result<T> {
        // Locks cannot be upgraded on all systems.
        if self.is_cpu {
            self.lock.unlock()?;
        }
        self.take(File::try_lock, File::lock)?;
        self.state().is_alone = true;
        let start_ms = timeline().1;
        let timed = {
            let _end = OnDrop(|| {
                self.state().is_alone = false;
                (self.tell)(Turn::Alone {
                    start_ms,
                    end_ms: timeline().1,
                });
                let _ = self.lock.unlock();
            });
            time()
        };
        if self.is_cpu {
            self.take_share()?;
        }
        Ok(timed)
    }

    fn take_share(&self) -> io::Result<()> {
        self.take(File::try_lock_shared, File::lock_shared)
    }

    /// Takes the lock after passing the gate.
    fn take(
        &self,
        at_once: fn(&File) -> Result<(), std::fs::TryLockError>,
        later: fn(&File) -> io::Result<()>,
    ) -> io::Result<()> {
        let files = [&self.gate, &self.lock];
        let mut taken = 0;
        if files.iter().all(|file| {
            let got = at_once(file).is_ok();
            taken += usize::from(got);
            got
        }) {
            return self.gate.unlock();
        }
        (self.tell)(Turn::Waits);
        let got = files.iter().skip(taken).try_for_each(|file| later(file));
        (self.tell)(Turn::Runs);
        got.and(self.gate.unlock())
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Runs a function at the end of a scope, even after a panic.
struct OnDrop<F: FnMut()>(F);

impl<F: FnMut()> Drop for OnDrop<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}

/// The machine's boot id, and milliseconds since boot, which are unaffected by clock changes. Where
/// these are unknown: an empty id, and milliseconds since 1970.
pub fn timeline() -> (String, u64) {
    let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").ok();
    let uptime = std::fs::read_to_string("/proc/uptime").ok();
    let seconds = uptime.and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    match boot.zip(seconds) {
        Some((boot, seconds)) => (boot.trim().to_owned(), (seconds * 1e3).round() as u64),
        None => (String::new(), since_1970()),
    }
}

pub fn since_1970() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |d| u64::try_from(d.as_millis()).unwrap_or(u64::MAX))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Duration;

    use super::*;

    static WAITS: AtomicUsize = AtomicUsize::new(0);

    fn count(turn: Turn) {
        if turn == Turn::Waits {
            WAITS.fetch_add(1, Ordering::Relaxed);
        }
    }

    #[test]
    fn nobody_draws_while_another_times() {
        let path = std::env::temp_dir().join(format!("preshade-turns-{}", std::process::id()));
        // Each has its own file handles, as processes have.
        let turns = |is_cpu| {
            let files = [path.clone(), path.with_extension("gate")].map(|path| {
                let mut options = File::options();
                let file = options.create(true).truncate(false).write(true).open(path);
                file.unwrap()
            });
            Turns::new(files, count).begin(is_cpu).unwrap()
        };
        let drawing = AtomicUsize::new(0);
        let draw = || {
            drawing.fetch_add(1, Ordering::Relaxed);
            std::thread::sleep(Duration::from_millis(2));
            drawing.fetch_sub(1, Ordering::Relaxed);
        };
        let time = || {
            for _ in 0..5 {
                assert_eq!(drawing.load(Ordering::Relaxed), 0);
                std::thread::sleep(Duration::from_millis(1));
            }
        };
        for is_cpu in [false, true] {
            let start = std::sync::Barrier::new(3);
            std::thread::scope(|scope| {
                for _ in 0..3 {
                    scope.spawn(|| {
                        let mine = turns(is_cpu);
                        start.wait();
                        for _ in 0..5 {
                            mine.beside(draw).unwrap();
                            mine.alone(time).unwrap();
                        }
                    });
                }
            });
        }
        assert!(WAITS.load(Ordering::Relaxed) > 0);
        std::fs::remove_file(&path).unwrap();
        std::fs::remove_file(path.with_extension("gate")).unwrap();
    }
}
