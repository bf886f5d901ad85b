//! Keeps the results so far in the report's folder. A run that is killed leaves them there.

use std::path::{Path, PathBuf};

use preshade_lab::measure::record::{Unfinished, partial_report};
use preshade_lab::search::plan::partial_results;
use shader_text::files::File;

use crate::{Failure, output};

/// Writes into a folder, if there is one.
pub struct Keeper {
    folder: Option<PathBuf>,
    written: Vec<String>,
}

impl Keeper {
    /// Takes the folder of `--out`.
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
            self.keep(partial_report::FILE, json + "\n");
        }
    }

    /// Writes `text` to `name`. If that fails, warns once and the run continues.
    pub fn keep(&mut self, name: &str, text: String) {
        let Some(folder) = &self.folder else { return };
        let file = File {
            name: name.to_owned(),
            bytes: text.into_bytes(),
        };
        match shader_text::files::write(folder, &[file]) {
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

    /// A failure that also names the files with the results so far.
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

    /// Removes the files of unfinished runs, this one's and earlier ones', because the report is
    /// written.
    pub fn done(&self) {
        let Some(folder) = &self.folder else { return };
        let names = self.written.iter().map(String::as_str);
        for name in names.chain([partial_report::FILE, partial_results::FILE]) {
            let _ = std::fs::remove_file(folder.join(name));
        }
    }
}
