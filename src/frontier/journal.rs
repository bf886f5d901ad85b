//! What was measured, kept by the hash of what was measured: a search that was ended goes on where it was, and a text that two recipes write is drawn once.
//!
//! The file holds one JSON object a line, appended as each measurement ends. A line that cannot be read (a write that was cut off, another version) is as if it were not there.

use std::collections::BTreeMap;
use std::fmt::{self, Write as _};
use std::fs::{File, OpenOptions};
use std::io::{self, Write as _};
use std::path::Path;

use preshade_passes::plan::Plan;
use serde::{Deserialize, Serialize};

use crate::emit;
use crate::measure::ErrorLadder;
use crate::render::{AdapterReport, ShaderForm};
use crate::scene::{DrawOrder, Scene};

/// What is known of a variant.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Against the original, the worst of the pictures that candidates are compared on; `None`: not drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<ErrorLadder>,
    /// The original's time over its own, round by round.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ratios: Vec<f64>,
    /// Milliseconds a frame, round by round.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub times: Vec<f64>,
}

#[derive(Serialize, Deserialize)]
struct Line {
    key: String,
    #[serde(flatten)]
    entry: Entry,
}

/// Measurements by key, and the file they are appended to.
#[derive(Debug, Default)]
pub struct Journal {
    known: BTreeMap<String, Entry>,
    file: Option<File>,
    /// The first error of writing: a full disk ends no search.
    trouble: Option<String>,
}

impl Journal {
    /// One that is kept in memory alone.
    pub fn new() -> Self {
        Self::default()
    }

    /// Reads the file, which is made if it is not there, and appends to it from now on.
    ///
    /// # Errors
    /// What the file system says.
    pub fn open(path: &Path) -> io::Result<Self> {
        if let Some(dir) = path.parent() {
            std::fs::create_dir_all(dir)?;
        }
        let mut known: BTreeMap<String, Entry> = BTreeMap::new();
        match std::fs::read(path) {
            Ok(bytes) => {
                for line in String::from_utf8_lossy(&bytes).lines() {
                    if let Ok(Line { key, entry }) = serde_json::from_str(line) {
                        add(known.entry(key).or_default(), entry);
                    }
                }
            }
            Err(e) if e.kind() == io::ErrorKind::NotFound => {}
            Err(e) => return Err(e),
        }
        let mut file = OpenOptions::new().create(true).append(true).open(path)?;
        // A line that was cut off ends here.
        file.write_all(b"\n")?;
        Ok(Self {
            known,
            file: Some(file),
            trouble: None,
        })
    }

    /// What is known under `key`.
    pub fn get(&self, key: &str) -> Option<&Entry> {
        self.known.get(key)
    }

    /// Keeps more of what is under `key`: an error takes the place of the one before, samples are added.
    pub fn add(&mut self, key: &str, entry: Entry) {
        let line = Line {
            key: key.to_owned(),
            entry: entry.clone(),
        };
        add(self.known.entry(key.to_owned()).or_default(), entry);
        let Some(file) = &mut self.file else { return };
        let written = serde_json::to_string(&line)
            .map_err(io::Error::from)
            .and_then(|text| file.write_all((text + "\n").as_bytes()));
        if let Err(error) = written {
            self.trouble.get_or_insert(error.to_string());
            self.file = None;
        }
    }

    /// Why it is no longer written; what is in memory stands.
    pub fn trouble(&self) -> Option<&str> {
        self.trouble.as_deref()
    }
}

fn add(to: &mut Entry, mut more: Entry) {
    to.error = more.error.or(to.error.take());
    to.ratios.append(&mut more.ratios);
    to.times.append(&mut more.times);
}

/// Hashes what two searches must agree on to share measurements: this version of preshade, the adapter, the scene, the order it is drawn in and the road of its shaders.
pub fn subject(
    adapter: &AdapterReport,
    scene: &Scene,
    order: DrawOrder,
    form: ShaderForm,
) -> String {
    let mut hash = Hash::default();
    let _ = write!(
        hash,
        "{} {adapter:?} {order:?} {form:?} {scene:?}",
        env!("CARGO_PKG_VERSION")
    );
    hash.finish()
}

/// Hashes what is drawn: the texts and the plan of every material. `None` where one cannot be emitted.
pub fn content(subject: &str, plans: &[Plan]) -> Option<String> {
    let mut hash = Hash::default();
    hash.0.update(subject.as_bytes());
    for plan in plans {
        let files = emit::emit(plan, &[emit::Target::Wgsl], &emit::Options::default()).ok()?;
        for file in files {
            hash.0.update(file.name.as_bytes());
            hash.0.update(&(file.bytes.len() as u64).to_le_bytes());
            hash.0.update(&file.bytes);
        }
    }
    Some(hash.finish())
}

/// blake3 of what is written to it: a scene is hashed by all that its `Debug` tells, without the text ever being whole.
#[derive(Default)]
struct Hash(blake3::Hasher);

impl Hash {
    /// 32 hex digits.
    fn finish(&self) -> String {
        self.0.finalize().to_hex()[..32].to_owned()
    }
}

impl fmt::Write for Hash {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.update(text.as_bytes());
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn entry(ratios: &[f64]) -> Entry {
        Entry {
            error: None,
            ratios: ratios.to_vec(),
            times: Vec::new(),
        }
    }

    #[test]
    fn a_cut_off_line_loses_itself_alone() {
        let dir = std::env::temp_dir().join(format!("preshade-journal-{}", std::process::id()));
        let path = dir.join("journal.jsonl");
        let _ = std::fs::remove_dir_all(&dir);
        let mut journal = Journal::open(&path).unwrap();
        journal.add("a", entry(&[1.0]));
        journal.add("a", entry(&[2.0]));
        let error = Entry {
            error: Some(ErrorLadder {
                changed_pixels: 3,
                flip_mean: 0.1 + 0.2,
                ..ErrorLadder::default()
            }),
            ..Entry::default()
        };
        journal.add("b", error.clone());
        drop(journal);
        let mut file = OpenOptions::new().append(true).open(&path).unwrap();
        file.write_all(br#"{"key":"c","rati"#).unwrap();
        drop(file);
        let mut journal = Journal::open(&path).unwrap();
        journal.add("d", entry(&[4.0]));
        drop(journal);
        let journal = Journal::open(&path).unwrap();
        assert_eq!(journal.get("a").unwrap(), &entry(&[1.0, 2.0]));
        assert_eq!(journal.get("b").unwrap(), &error);
        assert_eq!(journal.get("c"), None);
        assert_eq!(journal.get("d").unwrap(), &entry(&[4.0]));
        std::fs::remove_dir_all(&dir).unwrap();
    }
}
