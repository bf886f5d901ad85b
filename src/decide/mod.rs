//! What a scene calls for: for each material and each view the passes that pay on this adapter, and none that do not.
//!
//! [`candidates`] is the table of what is tried; [`work`] counts what a frame asks for off its plans and a few drawn counts ([`count`]); [`model`] turns that into milliseconds, fitted to the
//! built-in frames of [`probes`]; [`assign`] weighs whole frames by it; [`stage`] draws and times the most promising beside the original; [`choose`] and [`mod@policy`] decide on what was measured alone; [`scene`]
//! is all of it for one scene, [`so_far`] what is known of it on the way, [`decision`] what it says, and [`regret`] how good the choices are where everything is measured ([`mod@exhaust`]).
//!
//! A prediction decides what is measured, never what is chosen: no plan is taken that was not faster than the original on this adapter, beyond the noise of the clock.

pub mod assign;
pub mod candidates;
pub mod choose;
pub mod count;
pub mod decision;
pub mod exhaust;
pub mod model;
pub mod policy;
pub mod probes;
mod reasons;
pub mod regret;
pub mod scene;
pub mod so_far;
pub mod stage;
pub mod table;
pub mod terms;
pub mod work;

pub use candidates::{Choices, Refused, choices, recipes};
pub use count::View;
pub use decision::Decision;
pub use exhaust::{Exhausted, exhaust};
pub use model::{Model, ModelError, Origin};
pub use policy::{Held, Hold, Policy, Rule, Switch};
pub use regret::RegretReport;
pub use scene::{Settings, Timed, decide};
pub use so_far::{Progress, SceneSoFar, Unfinished};

/// Why nothing was decided.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The original could not be drawn or timed.
    #[error(transparent)]
    Measure(#[from] crate::measure::Error),
    /// Nothing was drawn.
    #[error(transparent)]
    Render(#[from] crate::render::Error),
    /// A counting stage of ours does not validate: a bug.
    #[error(
        "the counting stage of material `{material}` is invalid: {message}; this is a bug, please report it with the shader"
    )]
    Counting {
        /// Material.
        material: String,
        /// What is wrong with it.
        message: String,
    },
    /// A built-in probe does not parse: a bug.
    #[error("a built-in probe does not parse; this is a bug:\n{0}")]
    Probe(String),
    /// A recipe of the built-in table does not parse: a bug.
    #[error("a built-in recipe does not parse; this is a bug: {0}")]
    Recipe(#[from] crate::recipe::RecipeError),
    /// The scene has no camera.
    #[error("the scene `{0}` has no view to decide on")]
    NoView(String),
}
