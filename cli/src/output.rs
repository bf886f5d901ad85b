//! Data onto stdout.

use std::io::{self, ErrorKind, Write};

use crate::Failure;

/// Prints `text` to stdout, with a newline at its end. A reader that has seen enough and closed the pipe (`| head -1`) is no failure.
pub fn data(text: &str) -> Result<(), Failure> {
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

/// Prints `value` to stdout as JSON.
pub fn json(value: &impl serde::Serialize) -> Result<(), Failure> {
    data(&serde_json::to_string_pretty(value)?)
}

/// Prints a message to stderr; one that nobody reads is dropped.
pub fn message(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{}", text.trim_end());
}

/// Progress on a terminal, of 1000 steps; nothing where messages go elsewhere.
pub fn bar() -> indicatif::ProgressBar {
    if !std::io::IsTerminal::is_terminal(&std::io::stderr()) {
        return indicatif::ProgressBar::hidden();
    }
    let bar = indicatif::ProgressBar::new(1000);
    if let Ok(style) = indicatif::ProgressStyle::with_template("{bar:30} {elapsed} {wide_msg}") {
        bar.set_style(style);
    }
    bar
}
