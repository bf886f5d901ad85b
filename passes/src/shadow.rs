//! `shadow`: the depth-only version of a material, to be drawn under a light's view.
//!
//! Goal: a shadow pass that agrees with the picture, alpha test, displacement and all, because it is a slice of the same shader (engines that write it by hand
//! forget one or the other; see Bevy 8464 and Godot 84211).
//!
//! ```text
//! before:  main     vs + fs
//!
//! after:   shadow   vs_shadow (+ fs_shadow)        depth only, the host binds the light's view in place of the camera's
//!          main     vs + fs                        as it was
//! ```
//!
//! What the slices read of the camera is listed in the plan (`view_dependent`): the vertex stage's projection must be replaced, and an alpha or a displacement
//! that depends on the camera would follow the light.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::contract::Contract;
use crate::depth_only::{self, VertexStage};
use crate::opaque::{self, Opaque};
use crate::pass::{Facts, Pass, PassInfo, Refusal, SiteKey, Sites};
use crate::place::PositionInvariance;
use crate::plan::{Attachment, Phase, Plan, Role, Step};
use crate::state::{CompareFunction, DepthDirection, DepthFormat, DepthState};

/// Name of the depth attachment that the shadow pass writes.
pub const SHADOW_DEPTH: &str = "shadow-depth";

/// The pass.
pub struct Shadow;

/// Parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Params {
    /// Format of the shadow map.
    pub format: DepthFormat,
}
