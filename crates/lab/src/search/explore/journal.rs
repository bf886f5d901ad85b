//! Keeps measurements by the hash of the measured shaders. So an interrupted search continues, and
//! a text that two recipes produce is drawn once.
//!
//! The file has one JSON object a line, appended after each measurement. Unreadable lines (a
//! truncated write, another version) are skipped.

use std::collections::BTreeMap;
use std::fmt::{self, Write as _};
use std::fs::{File, OpenOptions};
use std::io::{self, Write as _};
use std::path::Path;

use preshade_compiler::emit;
use preshade_draw::render::AdapterReport;
use preshade_draw::scene::{DrawOrder, Scene};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_scenes::ShaderForm;
use serde::{Deserialize, Serialize};

use crate::measure::ErrorLadder;

/// The measurements of a variant.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Known {
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

/// A line that holds no measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Mark {
    /// A candidate to measure, under this name.
    Planned(String),
    Begun,
    /// A candidate that is drawn, or cannot be.
    Ended,
}

#[derive(Serialize, Deserialize)]
struct Line {
    key: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mark: Option<Mark>,
    #[serde(flatten)]
    entry: Known,
}

/// A planned measurement and its progress.
#[derive(Clone, Debug, Default)]
struct Way {
    name: String,
    /// How often its drawing was begun and came to no end.
    unended: u32,
    ended: bool,
}

/// After so many runs that ended while drawing it, a candidate is drawn no more.
const PATIENCE: u32 = 2;

/// Measurements by key, and the file they are appended to.
#[derive(Debug, Default)]
pub struct Journal {
    known: BTreeMap<String, Known>,
    ways: BTreeMap<String, Way>,
    file: Option<File>,
    /// The first error of writing: a full disk ends no search.
    trouble: Option<String>,
}

impl Journal {
    /// A journal in memory, without a file.
    pub fn new() -> Self {
        Self::default()
    }

    /// Reads the file and appends to it from now on. Creates it if necessary.
    pub fn open(path: &Path) -> io::Result<Self> {
        if let Some(dir) = path.parent() {
            std::fs::create_dir_all(dir)?;
        }
        let mut known: BTreeMap<String, Known> = BTreeMap::new();
        let mut ways: BTreeMap<String, Way> = BTreeMap::new();
        match std::fs::read(path) {
            Ok(bytes) => {
                for line in String::from_utf8_lossy(&bytes).lines() {
                    let Ok(Line { key, mark, entry }) = serde_json::from_str(line) else {
                        continue;
                    };
                    match mark {
                        Some(mark) => ways.entry(key).or_default().take(mark),
                        None => add(known.entry(key).or_default(), entry),
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
            ways,
            file: Some(file),
            trouble: None,
        })
    }

    pub fn get(&self, key: &str) -> Option<&Known> {
        self.known.get(key)
    }

    /// Adds to the measurements under `key`: an error replaces the one before, samples are
    /// appended.
    pub fn add(&mut self, key: &str, entry: Known) {
        add(self.known.entry(key.to_owned()).or_default(), entry.clone());
        self.write(&Line {
            key: key.to_owned(),
            mark: None,
            entry,
        });
    }

    fn mark(&mut self, key: &str, mark: Mark) {
        self.ways
            .entry(key.to_owned())
            .or_default()
            .take(mark.clone());
        self.write(&Line {
            key: key.to_owned(),
            mark: Some(mark),
            entry: Known::default(),
        });
    }

    /// Records that a measurement is planned, so that a killed search leaves a list of the missing
    /// ones.
    pub fn plan(&mut self, key: &str, name: &str) {
        if self.ways.get(key).is_none_or(|w| w.name != name) {
            self.mark(key, Mark::Planned(name.to_owned()));
        }
    }

    /// Records that drawing begins, which may end the process. `false`: it has ended the process
    /// before, so do not draw it.
    pub fn begin(&mut self, key: &str) -> bool {
        if self.ways.get(key).is_some_and(|w| w.unended >= PATIENCE) {
            return false;
        }
        self.mark(key, Mark::Begun);
        true
    }

    /// Keeps that its drawing came to an end, good or bad.
    pub fn end(&mut self, key: &str) {
        self.mark(key, Mark::Ended);
    }

    /// Names of planned measurements that did not complete.
    pub fn missing(&self) -> Vec<&str> {
        let missing = self.ways.values().filter(|w| !w.ended);
        missing.map(|w| w.name.as_str()).collect()
    }

    fn write(&mut self, line: &Line) {
        let Some(file) = &mut self.file else { return };
        let written = serde_json::to_string(line)
            .map_err(io::Error::from)
            .and_then(|text| file.write_all((text + "\n").as_bytes()));
        if let Err(error) = written {
            self.trouble.get_or_insert(error.to_string());
            self.file = None;
        }
    }

    /// Why the file is no longer written. Measurements remain in memory.
    pub fn trouble(&self) -> Option<&str> {
        self.trouble.as_deref()
    }
}

impl Way {
    fn take(&mut self, mark: Mark) {
        match mark {
            Mark::Planned(name) => self.name = name,
            Mark::Begun => self.unended += 1,
            Mark::Ended => {
                self.unended = self.unended.saturating_sub(1);
                self.ended = true;
            }
        }
    }
}

fn add(to: &mut Known, mut more: Known) {
    to.error = more.error.or(to.error.take());
    to.ratios.append(&mut more.ratios);
    to.times.append(&mut more.times);
}

/// Hashes everything that two searches must share to share measurements: the version of preshade,
/// the adapter, the scene, the draw order and the form of the shaders.
pub(crate) fn subject(
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

/// Hashes the texts and the plan of every material. `None`: one cannot be emitted.
pub(crate) fn content(subject: &str, plans: &[Plan]) -> Option<String> {
    let mut hash = Hash::default();
    hash.0.update(subject.as_bytes());
    for plan in plans {
        let files = emit::emit(plan, &[Target::Wgsl], &emit::Options::default()).ok()?;
        for file in files {
            hash.0.update(file.name.as_bytes());
            hash.0.update(&(file.bytes.len() as u64).to_le_bytes());
            hash.0.update(&file.bytes);
        }
    }
    Some(hash.finish())
}

/// A blake3 hash of everything written to it. Streams a scene's `Debug` text without holding all of
/// it.
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

    fn entry(ratios: &[f64]) -> Known {
        Known {
            error: None,
            ratios: ratios.to_vec(),
            times: Vec::new(),
        }
    }

    #[test]
    fn what_a_killed_search_did_not_reach_is_missing() {
        let dir = std::env::temp_dir().join(format!("preshade-missing-{}", std::process::id()));
        let path = dir.join("journal.jsonl");
        let _ = std::fs::remove_dir_all(&dir);
        let mut journal = Journal::open(&path).unwrap();
        for name in ["a", "b", "c"] {
            journal.plan(&format!("key of {name}"), name);
        }
        assert!(journal.begin("key of a"));
        journal.add("key of a", entry(&[1.0]));
        journal.end("key of a");
        assert!(journal.begin("key of b"));
        // Killed, started again, killed again at the same one.
        drop(journal);
        let mut journal = Journal::open(&path).unwrap();
        assert_eq!(journal.missing(), ["b", "c"]);
        assert!(journal.begin("key of b"));
        drop(journal);
        let mut journal = Journal::open(&path).unwrap();
        assert!(!journal.begin("key of b"));
        assert!(journal.begin("key of c"));
        journal.end("key of c");
        assert_eq!(journal.missing(), ["b"]);
        assert_eq!(journal.get("key of a").unwrap(), &entry(&[1.0]));
        std::fs::remove_dir_all(&dir).unwrap();
    }

    #[test]
    fn a_cut_off_line_loses_itself_alone() {
        let dir = std::env::temp_dir().join(format!("preshade-journal-{}", std::process::id()));
        let path = dir.join("journal.jsonl");
        let _ = std::fs::remove_dir_all(&dir);
        let mut journal = Journal::open(&path).unwrap();
        journal.add("a", entry(&[1.0]));
        journal.add("a", entry(&[2.0]));
        let error = Known {
            error: Some(ErrorLadder {
                changed_pixels: 3,
                flip_mean: 0.1 + 0.2,
                ..ErrorLadder::default()
            }),
            ..Known::default()
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
