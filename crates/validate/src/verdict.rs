//! The verdicts of validation.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use shader_text::source::Location;

/// The verdict on a promise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Verdict {
    /// Holds for all inputs: original and variant compute the same operations.
    Proved {
        /// The kind of proof.
        by: Proof,
    },
    /// Held for random and adversarial inputs.
    Agreed {
        /// Inputs on which both terminated.
        inputs: u64,
        /// Those of them whose colours were compared, if colours are promised. For the others, only
        /// discards and depths were.
        #[serde(default)]
        compared: u64,
        /// Additional inputs on which an adapter rounded the two differently, within the original's
        /// permitted range.
        #[serde(default)]
        unsure: u64,
    },
    /// Violated: a bug in preshade.
    Counterexample(Box<Counterexample>),
    /// Not checked, or no input terminated. Never counts as a success.
    NotEvaluable {
        /// The reason.
        why: String,
    },
}

/// How a promise was proved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Proof {
    /// The deciding slices have the same canonical form ([`preshade_dataflow::slice`]).
    Slices {
        /// Inputs on which both were also run in full and agreed, because a fault of the slicer
        /// could affect both slices. At least 1.
        inputs: u64,
    },
    /// Run on terms ([`super::term`]), both end in the same ones.
    Terms {
        /// The number of paths, all of them covered.
        paths: u64,
    },
}

/// Inputs for which original and variant differ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Counterexample {
    /// Seed of the inputs.
    pub seed: u64,
    /// Each input's name and value.
    pub inputs: Vec<(String, String)>,
    /// The differing output.
    pub output: String,
    /// The original's value.
    pub original: String,
    /// The variant's value.
    pub variant: String,
    /// The first intermediate value that differs, if both compute one.
    pub first: Option<Diverged>,
}

/// A value that both compute differently.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Diverged {
    /// Its place in the author's source.
    pub location: Option<Location>,
    /// The author's text for it.
    pub text: String,
    /// The original's value.
    pub original: String,
    /// The variant's value.
    pub variant: String,
}

impl Verdict {
    /// Whether it is a counterexample.
    pub fn is_broken(&self) -> bool {
        matches!(self, Self::Counterexample(_))
    }

    /// Whether the promise was confirmed.
    pub fn holds(&self) -> bool {
        matches!(self, Self::Proved { .. } | Self::Agreed { .. })
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
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

/// A verdict without a result, and the reason.
pub(super) fn not_evaluated(why: &str) -> Verdict {
    Verdict::NotEvaluable {
        why: why.to_owned(),
    }
}
