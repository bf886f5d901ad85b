//! What is measured so far, kept in the folder of the report while a run goes on: one that is killed leaves it there.

use std::path::{Path, PathBuf};

use preshade::decide::so_far;
use preshade::emit::{self, File};
use preshade::report::{Unfinished, unfinished};

use crate::{Failure, output};

/// Writes into a folder, if there is one.
pub struct Keeper {
    folder: Option<PathBuf>,
    written: Vec<String>,
}

impl Keeper {
    /// Of `--out`.
    pub fn new(folder: Option<&Path>) -> Self {
        Self {
            folder: folder.map(Path::to_owned),
            written: Vec::new(),
        }
    }

    /// Keeps a report that is not whole.
    pub fn keep_report(&mut self, so_far: &Unfinished) {
        // These types give no error.
        if let Ok(json) = serde_json::to_string_pretty(so_far) {
            self.keep(unfinished::FILE, json + "\n");
        }
    }

    /// Keeps `text` under `name`, in place of what was there. What cannot be written is told once, and the run goes on.
    pub fn keep(&mut self, name: &str, text: String) {
        let Some(folder) = &self.folder else { return };
        let file = File {
            name: name.to_owned(),
            bytes: text.into_bytes(),
        };
        match emit::write(folder, &[file]) {
            Ok(_) => {
                if !self.written.iter().any(|w| w == name) {
                    self.written.push(name.to_owned());
                }
            }
            Err(e) => {
                output::message(&format!(
                    "warning: what is measured so far is not kept: {e}"
                ));
                self.folder = None;
            }
        }
    }

    /// A failure, with the files that have what was measured before it.
    pub fn named(&self, Failure(mut why): Failure) -> Failure {
        let Some(folder) = &self.folder else {
            return Failure(why);
        };
        let files = self.written.iter().map(|name| folder.join(name));
        for file in files.filter(|f| f.is_file()) {
            why = format!(
                "{}\n = what was measured is in {}",
                why.trim_end(),
                file.display()
            );
        }
        Failure(why)
    }

    /// The report is written: nothing is unfinished any more, nor what an earlier run left.
    pub fn done(&self) {
        let Some(folder) = &self.folder else { return };
        let names = self.written.iter().map(String::as_str);
        for name in names.chain([unfinished::FILE, so_far::FILE]) {
            let _ = std::fs::remove_file(folder.join(name));
        }
    }
}
