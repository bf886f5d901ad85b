//! Decides, for each material and view of a scene, which passes pay on this adapter.
//!
//! [`mod@choices`] applies the [candidates](super::candidates). [`frame_work`] computes the work of
//! a frame from its plans and a few counts ([`count`]). [`model`] turns work into milliseconds and
//! is fitted to the built-in frames of [`probes`]. [`assign`] ranks whole frames by prediction.
//! [`stage`] draws and times the best against the original. [`choose`] and [`mod@policy`] decide
//! from measurements alone. [`layers`] draws each opaque draw alone, so that [`sorting`] finds a
//! better order of the draws and [`partial_prepass`] the draws that a pre-pass needs. [`scene`]
//! does all of it for one scene, [`partial_results`] has the results on the way, and [`decision`]
//! is the result. [`regret`] evaluates the choices where everything was measured ([`mod@exhaust`]).
//!
//! A prediction decides only which plans are measured. A plan is chosen only if it was faster than
//! the original on this adapter, beyond the noise of the clock.

pub mod assign;
pub mod choices;
pub mod choose;
mod confirm;
pub mod count;
pub mod decision;
pub mod exhaust;
pub mod frame_work;
pub mod layers;
pub mod model;
pub mod partial_prepass;
pub mod partial_results;
pub mod policy;
pub mod probes;
pub(crate) mod reasons;
pub mod regret;
pub mod scene;
pub mod sorting;
pub mod stage;
pub mod terms;

pub use super::candidates::recipes;
pub use crate::measure::View;
pub use choices::{Choices, Refused, choices};
pub use decision::Decision;
pub use exhaust::{Exhausted, exhaust};
pub use model::{Model, ModelError, ModelOrigin};
pub use partial_results::{PlanProgress, SceneSoFar, Unfinished};
pub use policy::{Hold, Policy, Rule, RuleRange, Switch};
pub use regret::RegretReport;
pub use scene::{Settings, Timed, decide};

#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The original could not be drawn or timed.
    #[error(transparent)]
    Measure(#[from] crate::measure::Error),
    #[error(transparent)]
    Render(#[from] preshade_draw::render::Error),
    /// A counting stage of ours does not validate: a bug.
    #[error(
        "the counting stage of material `{material}` is invalid: {message}; this is a bug, please \
         report it with the shader"
    )]
    Counting { material: String, message: String },
    /// A built-in probe does not parse: a bug.
    #[error("a built-in probe does not parse; this is a bug:\n{0}")]
    Probe(String),
    /// A recipe of the built-in table does not parse: a bug.
    #[error("a built-in recipe does not parse; this is a bug: {0}")]
    Recipe(#[from] preshade_compiler::recipe::RecipeError),
    /// The scene has no camera.
    #[error("the scene `{0}` has no view to decide on")]
    NoView(String),
}
