//! What is known of a material after the run.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

/// What is known of a material.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Record {
    pub name: String,
    pub files: Vec<String>,
    /// Whether the author's own compiler takes the text; `None`: not judged.
    pub legal: Option<bool>,
    /// What neither WebGPU nor naga's extensions of it have, by the author's SPIR-V.
    pub unsayable: Option<String>,
    /// Whether it is read.
    pub read: Outcome,
    /// By pass.
    pub passes: BTreeMap<String, Outcome>,
    /// By pass (`original` first) and target.
    pub targets: BTreeMap<String, BTreeMap<String, Outcome>>,
    /// How many texts were judged.
    pub judged: usize,
    /// Texts of naga's extensions, which Tint was not asked about.
    pub beyond_tint: usize,
    /// Texts that a judge refuses.
    pub invalid: Vec<String>,
    /// Stages whose interface was compared with the author's.
    pub reflected: usize,
    /// Where the interface differs from the author's.
    pub reflection: Vec<String>,
    /// Resources that the author declares without using them, and that ours has not.
    pub unused: Vec<String>,
    /// Specialisation constants whose defaults are final, as the plan says.
    pub settled: Vec<String>,
    /// Blocks that the other stage declares with more members, which both stages have in the IR.
    pub longer: Vec<String>,
    /// What calls itself a bug.
    pub bugs: Vec<String>,
    pub panics: Vec<String>,
    /// Why the process ended before its time.
    pub ended: Option<String>,
}

/// What came of a step.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    #[default]
    NotTried,
    Done,
    Refused {
        code: String,
        message: String,
    },
}

impl Outcome {
    pub fn is_done(&self) -> bool {
        *self == Self::Done
    }

    fn word(&self) -> &str {
        match self {
            Self::NotTried => "-",
            Self::Done => "yes",
            Self::Refused { code, .. } => code,
        }
    }
}

impl Record {
    /// Whether it counts towards what should be read.
    pub fn is_wanted(&self) -> bool {
        self.legal != Some(false) && self.unsayable.is_none()
    }

    /// What must not be.
    pub fn faults(&self) -> Vec<(&'static str, &str)> {
        let lists = [
            ("invalid", &self.invalid),
            ("reflection", &self.reflection),
            ("bug", &self.bugs),
            ("panic", &self.panics),
        ];
        let faults = lists.into_iter().flat_map(|(kind, list)| {
            let lines = list.iter();
            lines.map(move |line| (kind, line.as_str()))
        });
        let ended = self.ended.as_deref().map(|why| match why {
            "timed out" => ("time-out", why),
            _ => ("panic", why),
        });
        faults.chain(ended).collect()
    }
}

impl fmt::Display for Record {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.name)?;
        match &self.read {
            Outcome::Done => write!(f, " read")?,
            Outcome::NotTried => {}
            Outcome::Refused { code, message } => write!(f, " refused[{code}] {message}")?,
        }
        if self.legal == Some(false) {
            write!(f, "; not legal")?;
        }
        if let Some(what) = &self.unsayable {
            write!(f, "; WebGPU has no {what}")?;
        }
        if !self.passes.is_empty() {
            let words = self.passes.iter().map(|(n, o)| format!("{n} {}", o.word()));
            let words: Vec<String> = words.collect();
            write!(f, "; passes: {}", words.join(", "))?;
        }
        if let Some(original) = self.targets.get("original") {
            let words = original.iter().map(|(n, o)| format!("{n} {}", o.word()));
            let words: Vec<String> = words.collect();
            write!(f, "; targets: {}", words.join(", "))?;
        }
        if self.judged > 0 {
            let wrong = self.invalid.len();
            write!(f, "; {} texts judged, {wrong} invalid", self.judged)?;
        }
        for (kind, line) in self.faults() {
            write!(f, "\n    {kind}: {line}")?;
        }
        Ok(())
    }
}
