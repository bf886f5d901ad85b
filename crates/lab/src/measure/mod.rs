//! Measures variants against the original: accuracy, work and time.
//!
//! A [`Session`] owns a scene on an adapter. [`Subject`]s are plans that it draws in [`View`]s.
//! [`mod@verify`] draws, compares, counts and times every view, and [`record`] holds the results.
//!
//! [`error`] compares pictures, [`shading`] counts fragments and depth ties, [`timing`] times
//! frames, [`statistics`] reads the adapter's counters, [`shadow`] draws shadow passes under the
//! light, and [`outputs`] auxiliary pictures. [`frequency`], [`mod@interpolation`] and [`bounds`]
//! find values that can be interpolated. [`mod@changing`], [`mod@constants`], [`mod@ranges`] and
//! [`mod@undrawn`] read a scene's files without drawing. [`mod@junctions`] finds T-junctions,
//! [`mod@rasterizer`] tests the adapter's rasteriser, and [`on_adapter`] runs both versions on
//! numbers. [`crossover`] finds the value of a scene's variable at which one variant overtakes
//! another.

pub(crate) mod bench;
mod bound_textures;
pub mod bounds;
pub mod changing;
pub mod comparison;
pub mod constants;
pub mod crossover;
mod depth_maps;
mod discardable;
pub mod effects;
mod empty_picture;
pub mod error;
mod flip;
pub mod frequency;
pub mod groups;
pub mod handmade;
pub mod interpolation;
pub mod junctions;
pub mod on_adapter;
mod other_cameras;
pub mod outputs;
pub(crate) mod picture_warnings;
pub mod profile;
mod promises_by_material;
pub mod ranges;
pub mod rasterizer;
pub mod record;
mod session;
mod settings;
pub mod shading;
pub mod shadow;
mod slivers;
pub mod statistics;
mod subject;
mod texels;
pub mod timing;
pub mod undrawn;
pub(crate) mod unsteady;
pub mod variant;
pub mod verdict;
pub mod verify;
pub mod vertices;
mod view;

pub use bound_textures::bound;
pub use changing::changing;
pub use comparison::{Beside, Look, comparison};
pub use constants::constants;
pub use depth_maps::DepthReport;
pub use effects::effects;
pub(crate) use empty_picture::check_seen;
pub use error::{ErrorLadder, compare};
pub use frequency::{
    Detail, Settled, frequencies, leaves_a_choice, promised, settled, within_budget, written_out,
};
pub use groups::{MOST_GROUPS, grouped, grouped_for, versions};
pub use interpolation::interpolation;
pub use junctions::{Junction, junctions};
pub use on_adapter::validate_on;
pub use outputs::OutputsReport;
pub use ranges::ranges;
pub use rasterizer::rasterizer;
pub use session::Session;
pub use settings::{Settings, Timed, parse_seconds, parse_size};
pub use shading::{
    CountProgram, Counter, Discarded, Shading, ShadingSummary, facts, facts_for_choice,
};
pub use shadow::ShadowReport;
pub use subject::Subject;
pub use timing::{
    Clock, Estimate, FEWEST_SAMPLES, FrameTime, Timing, TimingSettings, estimate, time,
};
pub use undrawn::undrawn;
pub(crate) use variant::unwritten;
pub use variant::{Variant, counting, refused, variant};
pub use verify::{Verified, VerifyProgress, verify};
pub use view::View;
pub(crate) use view::{choosing, small};

/// Why something was not measured.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error(transparent)]
    Render(#[from] preshade_draw::render::Error),
    /// Two pictures of different kinds.
    #[error(transparent)]
    Mismatch(#[from] error::Mismatch),
    /// A recipe names something that no material of the scene has.
    #[error(transparent)]
    Recipe(#[from] preshade_compiler::recipe::RecipeError),
    /// A value of the scene does not fit its variable.
    #[error(transparent)]
    Scene(#[from] preshade_draw::scene::SceneError),
    /// The original draws nothing; with the reason.
    #[error("{start}{0}", start = preshade_draw::render::NOT_MEASURED)]
    Nothing(String),
    /// The adapter's clock gave no positive time.
    #[error("the adapter's clock gave only zero or negative times")]
    Clock,
}

impl Error {
    /// See [`preshade_draw::render::Error::is_lost`].
    pub fn is_lost(&self) -> bool {
        matches!(self, Self::Render(error) if error.is_lost())
    }

    /// Its text, for a sentence that already begins with "not measured".
    pub fn reason(&self) -> String {
        self.to_string()
            .replace(preshade_draw::render::NOT_MEASURED, "")
    }

    /// Whether a loop did not end ([`preshade_draw::render::Error::Endless`]).
    pub(crate) fn is_endless(&self) -> bool {
        matches!(
            self,
            Self::Render(preshade_draw::render::Error::Endless { .. })
        )
    }

    /// The measurement, or `None` if it is impossible. A lost adapter stays an error.
    pub(crate) fn unless_lost<T, E: Into<Self>>(found: Result<T, E>) -> Result<Option<T>, Self> {
        match found.map_err(Into::into) {
            Ok(found) => Ok(Some(found)),
            Err(error) if error.is_lost() => Err(error),
            Err(_) => Ok(None),
        }
    }
}

/// The facts that a scene's files give without drawing. Values that do not fit are skipped. A
/// made-up scene gives none: a variant of a bare shader must hold for all values.
pub fn known(scene: &preshade_draw::scene::Scene) -> preshade_plan::pass::Facts {
    if scene.is_made_up {
        return preshade_plan::pass::Facts::default();
    }
    let changing = changing(scene).ok();
    let constants = changing
        .clone()
        .and_then(|changing| constants::constants_beside(scene, changing).ok());
    let bound = bound(scene).unwrap_or_default();
    let those = |which: fn(&bound_textures::Texels) -> bool| {
        let those = bound.textures.iter().filter(|(_, texels)| which(texels));
        those.map(|(texture, _)| texture.clone()).collect()
    };
    preshade_plan::pass::Facts {
        changing,
        constants: constants.unwrap_or_default(),
        ranges: ranges(scene).unwrap_or_default(),
        steady_textures: those(|texels| texels.is_steady),
        infinite_textures: those(|texels| texels.is_infinite),
        narrow_depths: bound.narrow_depths.iter().cloned().collect(),
        undrawn: undrawn(scene).ok(),
        ..preshade_plan::pass::Facts::default()
    }
}

/// [`known`] if a pass of `recipe` reads it, otherwise nothing.
pub fn known_for(
    scene: &preshade_draw::scene::Scene,
    recipe: &preshade_compiler::recipe::Recipe,
) -> preshade_plan::pass::Facts {
    let reads = |step: &preshade_compiler::recipe::Step| {
        let pass = preshade_geometry::pass_named(&step.pass);
        // A budget holds for the branches that the scene draws.
        step.params.contains_key("budget") || pass.is_none_or(|pass| pass.info().reads_scene)
    };
    match recipe.steps.iter().any(reads) {
        true => known(scene),
        false => preshade_plan::pass::Facts::default(),
    }
}

/// The plans that draw a scene's materials as their authors wrote them.
pub fn originals(scene: &preshade_draw::scene::Scene) -> Vec<preshade_plan::plan::Plan> {
    scene
        .materials
        .iter()
        .map(|m| {
            preshade_plan::plan::Plan::original(
                &m.name,
                m.program.clone(),
                &m.vertex,
                m.fragment.as_deref(),
                &m.state,
            )
        })
        .collect()
}
