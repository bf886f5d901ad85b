//! The depth-only version of a material: the slice of its vertex stage that decides position, and the slice of its fragment stage that decides
//! discard and depth. What a depth pre-pass, a shadow pass and the depth texture of an early discard have in common.

use naga::{Binding, BuiltIn, Module, ShaderStage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::graph::Graph;
use crate::opaque::Opaque;
use crate::pass::{Refusal, Site, SiteCost, SiteKey};
use crate::place::{self, PositionInvariance};
use crate::plan::{Draws, GpuPass, Phase, Plan, Role};
use crate::program::Program;
use crate::reflect;
use crate::slice::{self, Criterion, Slice};
use crate::state::DepthState;

/// Which vertex stage a depth-only pass runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum VertexStage {
    /// The main pass's own entry point of the same module: what invariance holds for most widely.
    Same,
    /// The slice to position, clip distances, point size and view index, in a module of its own.
    Sliced,
}
