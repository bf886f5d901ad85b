//! The parameters.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Which operations to fold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Fold {
    /// Integers, bools, selections and branches: the same bits.
    #[default]
    Exact,
    /// Also floats: additions of 0, products with 0 or 1, mixes by 0 or 1. The same real numbers if
    /// all are finite.
    Rounding,
}

/// Parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct SpecializeParams {
    /// Values to assume in addition to the scene's; they take precedence. `name=number`, joined by
    /// `+`. A name is the path of a uniform's scalar (`material.fog_density`, `lights[0].color.x`),
    /// a suffix that only one path has, or an override.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set: Option<String>,
    /// Which operations to fold.
    pub fold: Fold,
    /// Unrolls loops with a known count of at most this many iterations. 0 removes only loops that
    /// never run.
    #[schemars(range(max = 64))]
    pub unroll: u32,
}

impl Default for SpecializeParams {
    fn default() -> Self {
        Self {
            set: None,
            fold: Fold::default(),
            unroll: 4,
        }
    }
}
