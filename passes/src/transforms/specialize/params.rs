//! What the pass is told.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What may be folded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Fold {
    /// Integers, truths, selections and branches: the same bits.
    #[default]
    Exact,
    /// Floats too: what is added to 0, multiplied by 0 or 1, or mixed by 0 or 1. The same real numbers, where all are finite.
    Rounding,
}

/// Parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Params {
    /// Values to assume beside those of the scene, and before them: `name=number`, joined by `+`. A name is the path of a uniform's scalar (`material.fog_density`, `lights[0].color.x`), the
    /// end of one that is the only such, or an override.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set: Option<String>,
    /// What may be folded.
    pub fold: Fold,
    /// Loops whose turns are known and are no more than this are written out; with 0 only those that never turn.
    #[schemars(range(max = 64))]
    pub unroll: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            set: None,
            fold: Fold::default(),
            unroll: 4,
        }
    }
}
