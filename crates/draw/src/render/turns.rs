//! Turns on an adapter that several processes draw on: pictures go side by side, and times are taken
//! alone.

use std::fs::File;
use std::io;
use std::sync::{Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

/// Locks that all processes share which draw on an adapter.
#[derive(Debug)]
pub struct Turns {
    lock: File,
    /// Held by who waits to be alone, so that no other takes a share meanwhile.
    gate: File,
    /// Whether all work of this process disturbs times, and not its drawing alone: the adapter is the CPU.
    is_cpu: bool,
    tell: fn(Turn),
    state: Mutex<State>,
}

/// What happens to a process on a shared adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// It waits for other processes.
    Waits,
    /// It waits no more.
    Runs,
    /// It had the adapter for itself, from and to these milliseconds of [`timeline`].
    Alone {
        /// When it began.
        start_ms: u64,
        /// When it ended.
        end_ms: u64,
    },
}

#[derive(Debug, Default)]
struct State {
    /// Drawing threads.
    shared: usize,
    is_alone: bool,
}

impl Turns {
    /// Shares an adapter by these two lock files. `tell` hears of each [`Turn`].
    pub fn new([lock, gate]: [File; 2], tell: fn(Turn)) -> Self {
        Self {
            lock,
            gate,
            is_cpu: false,
            tell,
            state: Mutex::default(),
        }
    }

    /// Says whether the adapter is the CPU: then this process holds its share from now on.
    pub(super) fn begin(mut self, is_cpu: bool) -> io::Result<Self> {
        self.is_cpu = is_cpu;
        if is_cpu {
            self.take_share()?;
        }
        Ok(self)
    }

    /// Draws beside other processes that draw.
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
                // It is unlocked at the end of the process at the latest.
                let _ = self.lock.unlock();
            }
        });
        Ok(draw())
    }

    /// Runs `time` while no other process draws. One thread at a time may do so, and while it does, the
    /// others of this process must not draw.
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

    /// Takes the lock, through the gate.
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

/// Runs a function at the end of a scope, also of one that panics.
struct OnDrop<F: FnMut()>(F);

impl<F: FnMut()> Drop for OnDrop<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}

/// The name of a start of this machine, and the milliseconds since, or an empty name and those since 1970
/// where that is not known. Only the former go on when a clock is set.
pub fn timeline() -> (String, u64) {
    let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").ok();
    let uptime = std::fs::read_to_string("/proc/uptime").ok();
    let seconds = uptime.and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    match boot.zip(seconds) {
        Some((boot, seconds)) => (boot.trim().to_owned(), (seconds * 1e3).round() as u64),
        None => (String::new(), since_1970()),
    }
}

/// Milliseconds since 1970.
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
        // Each has a handle of its own, as processes have.
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
