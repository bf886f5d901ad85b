//! Output: data to stdout, messages and progress to stderr.

use std::io::{self, ErrorKind, IsTerminal, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use preshade_lab::report::control_characters::is_obeyed;

use crate::{Failure, Table, bounded, worker};

/// Whether anything was printed to stdout.
static HAS_DATA: AtomicBool = AtomicBool::new(false);

/// Prints an error to stdout as JSON if nothing was printed yet, for readers of JSON.
pub fn failed(message: &str) {
    if HAS_DATA.load(Ordering::Relaxed) {
        return;
    }
    // The exit status reports the failure anyway.
    let _ = json(&serde_json::json!({ "schema": "preshade.error.v1", "errors": [message] }));
}

/// Prints `text` to stdout, with a newline at its end. A closed pipe (`| head -1`) is not a failure.
pub fn data(text: &str) -> Result<(), Failure> {
    HAS_DATA.store(true, Ordering::Relaxed);
    let mut out = io::stdout().lock();
    let newline = if text.ends_with('\n') { "" } else { "\n" };
    let written = out
        .write_all(text.as_bytes())
        .and_then(|()| out.write_all(newline.as_bytes()))
        .and_then(|()| out.flush());
    match written {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(Failure(format!("error: stdout: {e}"))),
        _ => Ok(()),
    }
}

/// Prints a table, which may contain names from strangers, as [`data`].
pub fn table(text: &str) -> Result<(), Failure> {
    data(&plain(text))
}

/// Escapes characters that a terminal interprets: control characters, and those that change the
/// direction of text. Newlines, tabs and our own colours stay.
fn plain(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        // ESC [ digits m
        let color = rest.strip_prefix("\u{1b}[").and_then(|tail| {
            let end = tail.find(|c: char| !(c.is_ascii_digit() || c == ';'))?;
            tail[end..].starts_with('m').then_some(2 + end + 1)
        });
        let length = match color {
            Some(length) => length,
            None => c.len_utf8(),
        };
        match is_obeyed(c) && color.is_none() {
            true => out.push_str(&format!("\\u{{{:x}}}", u32::from(c))),
            false => out.push_str(&rest[..length]),
        }
        rest = &rest[length..];
    }
    out
}

/// Prints `value` to stdout as JSON.
pub fn json(value: &impl serde::Serialize) -> Result<(), Failure> {
    data(&serde_json::to_string_pretty(value)?)
}

/// The result of a command, in each form that it prints.
pub struct Answer {
    pub table: String,
    pub json: String,
    pub csv: String,
}

impl Answer {
    pub fn print(&self, form: Table) -> Result<(), Failure> {
        match form {
            Table::Human => table(&self.table),
            Table::Json => data(&self.json),
            Table::Csv => data(&self.csv),
        }
    }

    /// Prints, and then writes `files` to the folder, if there is one: a full disk must not lose
    /// the measurements.
    pub fn tell(
        &self,
        form: Table,
        folder: Option<&Path>,
        files: impl FnOnce(&Path) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let printed = self.print(form);
        both(printed, folder.map_or(Ok(()), files), folder)
    }
}

/// Combines the results of printing and of writing to a folder. If one fails, the message names the
/// other output.
pub fn both(
    printed: Result<(), Failure>,
    written: Result<(), Failure>,
    folder: Option<&Path>,
) -> Result<(), Failure> {
    match (printed, written) {
        (Ok(()), Ok(())) => Ok(()),
        (Ok(()), Err(Failure(why))) => Err(Failure(format!(
            "{}\n = what was measured is on stdout",
            why.trim_end()
        ))),
        (Err(Failure(why)), Ok(())) => Err(Failure(match folder {
            Some(folder) => format!("{why}\n = what was measured is in {}", folder.display()),
            None => why,
        })),
        (Err(Failure(first)), Err(Failure(second))) => {
            Err(Failure(format!("{}\n{second}", first.trim_end())))
        }
    }
}

/// `1 file`, `2 files`.
pub fn count(n: usize, what: &str) -> String {
    match n {
        1 => format!("1 {what}"),
        _ => format!("{n} {what}s"),
    }
}

/// Prints a message to stderr. Errors are ignored.
pub fn message(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{}", plain(text.trim_end()));
}

/// The variable that switches progress off, with the value `no`.
pub const PROGRESS: &str = "PRESHADE_PROGRESS";

/// Longest time without a line of progress.
const SILENCE: Duration = Duration::from_secs(5);

/// Progress of a command: a bar or a spinner on a terminal, otherwise a line from time to time.
pub struct ProgressLine {
    bar: Option<ProgressBar>,
    /// State of the printed lines; `None` if the progress has no lines.
    said: Option<Arc<Mutex<ProgressState>>>,
}

/// The state of a line of progress.
struct ProgressState {
    began: Instant,
    told: Instant,
    what: String,
    /// Steps done, of 1000; `None` if their number is unknown.
    done: Option<u64>,
}

/// Starts progress of 1000 steps.
pub fn bar() -> ProgressLine {
    progress(Some(0), "{bar:30} {elapsed} {wide_msg}")
}

/// Starts progress of an unknown number of steps.
pub fn spinner() -> ProgressLine {
    progress(None, "{spinner} {elapsed} {wide_msg}")
}

/// Runs `work`, with progress if it takes long.
pub fn working<T>(what: impl Into<String>, work: impl FnOnce() -> T) -> T {
    let line = spinner();
    line.set_message(what);
    let done = work();
    line.finish_and_clear();
    done
}

fn progress(done: Option<u64>, template: &str) -> ProgressLine {
    let is_asked = std::env::var_os(PROGRESS).is_none_or(|v| v != "no");
    let bar = io::stderr().is_terminal().then(|| {
        let bar = match done {
            Some(_) => ProgressBar::new(1000),
            None => ProgressBar::new_spinner(),
        };
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_secs(1));
        bar
    });
    // A worker process prints none.
    let tells = bar.is_none() && is_asked && worker::mine().is_none();
    let said = tells.then(|| {
        let now = Instant::now();
        let said = Arc::new(Mutex::new(ProgressState {
            began: now,
            told: now,
            what: String::new(),
            done,
        }));
        let line = Arc::downgrade(&said);
        // It ends with the line.
        std::thread::spawn(move || {
            loop {
                std::thread::sleep(SILENCE / 10);
                let Some(said) = line.upgrade() else { break };
                said.lock().unwrap_or_else(PoisonError::into_inner).tell();
            }
        });
        said
    });
    ProgressLine { bar, said }
}

impl ProgressState {
    /// Prints a line if the last one is long ago.
    fn tell(&mut self) {
        if self.told.elapsed() < SILENCE || self.what.is_empty() {
            return;
        }
        self.told = Instant::now();
        let seconds = self.began.elapsed().as_secs();
        // A share below 1 % or of 100 % is left out.
        let part = self.done.filter(|done| (10..1000).contains(done));
        let done = part.map(|done| format!(", {} %", done / 10));
        let done = done.unwrap_or_default();
        message(&format!("{seconds} s: {}{done}", self.what));
    }
}

impl ProgressLine {
    fn say(&self, change: impl FnOnce(&mut ProgressState)) {
        if let Some(said) = &self.said {
            change(&mut said.lock().unwrap_or_else(PoisonError::into_inner));
        }
    }

    pub fn set_message(&self, what: impl Into<String>) {
        let what = what.into();
        match &self.bar {
            Some(bar) => bar.set_message(what),
            None => self.say(|said| said.what = what),
        }
    }

    /// Sets the number of steps done, of 1000.
    pub fn set_position(&self, done: u64) {
        bounded::step();
        match &self.bar {
            // While the work goes on, the bar must not look finished.
            Some(bar) => bar.set_position(done.min(999)),
            None => self.say(|said| said.done = Some(done)),
        }
    }

    pub fn reset(&self) {
        match &self.bar {
            Some(bar) => bar.reset(),
            None => self.say(|said| said.done = said.done.map(|_| 0)),
        }
    }

    /// Hides the bar while `work` prints.
    pub fn suspend(&self, work: impl FnOnce()) {
        match &self.bar {
            Some(bar) => bar.suspend(work),
            None => work(),
        }
    }

    /// Removes the bar, and ends the lines.
    pub fn finish_and_clear(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        self.say(|said| said.what.clear());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_terminal_is_told_nothing_by_a_name() {
        let name = "a\u{1b}]0;owned\u{7}\u{1b}[2J\u{202e}b\u{9b}1A\r";
        let told = plain(name);
        assert_eq!(
            told,
            "a\\u{1b}]0;owned\\u{7}\\u{1b}[2J\\u{202e}b\\u{9b}1A\\u{d}"
        );
        let ours = "\u{1b}[1;31merror\u{1b}[0m: x\n\ty é";
        assert_eq!(plain(ours), ours);
    }
}
