//! What validation says.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::core::program::Location;

/// What became of a promise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Verdict {
    /// It holds for all inputs: original and variant do the same operations on them.
    Proved {
        /// How it was seen.
        by: Proof,
    },
    /// It held for so many inputs, random and adversarial ones.
    Agreed {
        /// Inputs that both were run on to their end.
        inputs: u64,
        /// Those of them whose colours were compared, where colours are promised: of the others it was whether they are kept, and depths.
        #[serde(default)]
        compared: u64,
        /// Inputs beside them on which an adapter rounded the two apart, within what it may make of the original.
        #[serde(default)]
        unsure: u64,
    },
    /// It does not hold: a bug in preshade.
    Counterexample(Box<Counterexample>),
    /// It was not looked at, or no input came to an end. Never counts as a success.
    NotEvaluable {
        /// Why.
        why: String,
    },
}

/// How a promise was proved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Proof {
    /// The slices that decide it have one canonical form ([`crate::slice`]).
    Slices {
        /// Numbers that both were run on beside, whole, and agreed: the slicer that says so may have cut the variant too, and what it forgets would be missing in both. 0: they cannot be run.
        inputs: u64,
    },
    /// Run on terms ([`super::term`]), both end in the same ones.
    Terms {
        /// Along so many paths, which are all there are.
        paths: u64,
    },
}

/// Inputs for which original and variant differ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Counterexample {
    /// Seed of the inputs.
    pub seed: u64,
    /// Each input: its name, and its value in words.
    pub inputs: Vec<(String, String)>,
    /// What differs.
    pub output: String,
    /// What the original gives.
    pub original: String,
    /// What the variant gives.
    pub variant: String,
    /// The first value on the way that is another; `None` where none is that both compute.
    pub first: Option<Diverged>,
}

/// A value that both compute, and not to the same.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Diverged {
    /// Where it is in the author's source.
    pub location: Option<Location>,
    /// The author's text for it.
    pub text: String,
    /// What the original computes.
    pub original: String,
    /// What the variant computes.
    pub variant: String,
}

impl Verdict {
    /// Whether it is a counterexample.
    pub fn is_broken(&self) -> bool {
        matches!(self, Self::Counterexample(_))
    }

    /// Whether the promise was seen to hold.
    pub fn holds(&self) -> bool {
        matches!(self, Self::Proved { .. } | Self::Agreed { .. })
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Proved {
                by: Proof::Slices { inputs: 0 },
            } => f.write_str("proved: the same slice, by the slicer's word alone"),
            Self::Proved {
                by: Proof::Slices { inputs },
            } => write!(f, "proved: the same slice, and agreed on {inputs} inputs"),
            Self::Proved {
                by: Proof::Terms { paths: 1 },
            } => f.write_str("proved: the same operations"),
            Self::Proved {
                by: Proof::Terms { paths },
            } => write!(f, "proved: the same operations, along {paths} paths"),
            Self::Agreed {
                inputs,
                compared,
                unsure,
            } => {
                write!(f, "agreed on {inputs} inputs")?;
                if compared < inputs {
                    write!(f, ", in colours on {compared} of them")?;
                }
                match unsure {
                    0 => Ok(()),
                    n => write!(f, "; rounded apart on {n} more"),
                }
            }
            Self::NotEvaluable { why } => write!(f, "not evaluated: {why}"),
            Self::Counterexample(found) => write!(f, "does not hold: {found}"),
        }
    }
}

impl fmt::Display for Counterexample {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} is {} instead of {} (inputs of seed {})",
            self.output, self.variant, self.original, self.seed
        )?;
        if let Some(first) = &self.first {
            write!(f, "\n  first at ")?;
            if let Some(at) = &first.location {
                write!(f, "{}:{}:{} ", at.file, at.line, at.column)?;
            }
            write!(
                f,
                "`{}`, which is {} instead of {}",
                first.text, first.variant, first.original
            )?;
        }
        for (name, value) in &self.inputs {
            write!(f, "\n  with {name} = {value}")?;
        }
        Ok(())
    }
}

/// A verdict that nothing was seen, and why.
pub(super) fn not_evaluated(why: &str) -> Verdict {
    Verdict::NotEvaluable {
        why: why.to_owned(),
    }
}
