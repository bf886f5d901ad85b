//! What a variant costs in accuracy and gains in time, measured beside the original.
//!
//! [`error`] compares two pictures, [`mod@changing`] tells what is not the same in all frames and [`mod@constants`] what is, [`shading`] counts fragments and depth ties, [`timing`] times frames,
//! [`statistics`] asks the adapter what it invoked; [`frequency`] finds what can be interpolated, by the picture and ([`mod@interpolation`]) by the value itself ([`bounds`] proves how far that can be off);
//! [`mod@truth`] tells how far original and variant are from what nobody rounded; [`mod@junctions`] finds edges that two draws divide differently; [`mod@rasterizer`] tells what the adapter does that no language decides; [`on_adapter`] runs original and variant there on numbers, without drawing; [`shadow`] draws shadow passes under the light; [`mod@verify`] does all of it for every view of a scene, and
//! [`crossover`] tells at which value of a scene's variable one variant overtakes another.

pub mod bounds;
pub mod changing;
pub mod constants;
pub mod crossover;
pub mod effects;
mod elsewhere;
pub mod error;
pub mod frequency;
pub mod groups;
pub mod interpolation;
pub mod junctions;
pub mod on_adapter;
pub mod ranges;
pub mod rasterizer;
pub mod shading;
pub mod shadow;
pub mod statistics;
pub(crate) mod telling;
pub mod timing;
pub mod truth;
pub mod variant;
pub mod verdict;
pub mod verify;
mod vertices;

pub use changing::changing;
pub use constants::constants;
pub use effects::{EffectUse, effects};
pub use error::{ErrorLadder, compare};
pub use frequency::{
    frequencies, interpolations, leaves_a_choice, promised, within_budget, written_out,
};
pub use groups::{MOST_GROUPS, grouped, grouped_for};
pub use interpolation::interpolation;
pub use junctions::{Junction, junctions};
pub use on_adapter::validate_on;
pub use ranges::ranges;
pub use rasterizer::rasterizer;
pub use shading::{CountProgram, Counter, Discarded, Shading, ShadingSummary, facts};
pub use shadow::ShadowReport;
pub use timing::{
    Clock, Estimate, FEWEST_SAMPLES, FrameTime, Timing, TimingSettings, estimate, time,
};
pub(crate) use variant::unwritten;
pub use variant::{counting, variant};
pub use verify::{Outcome, Progress, Settings, Timed, Variant, verify};

use crate::scene::{Filter, bind};

/// Why something was not measured.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Nothing was drawn.
    #[error(transparent)]
    Render(#[from] crate::render::Error),
    /// Two pictures of different kinds.
    #[error(transparent)]
    Mismatch(#[from] error::Mismatch),
    /// The adapter's clock gave no positive time.
    #[error("the adapter's clock gave only zero or negative times")]
    Clock,
}

/// What a scene tells without being drawn. What its files do not fit is left out.
pub fn known(scene: &crate::scene::Scene) -> preshade_passes::pass::Facts {
    let changing = changing(scene).ok();
    let constants = changing
        .clone()
        .and_then(|changing| constants::constants_beside(scene, changing).ok());
    preshade_passes::pass::Facts {
        changing,
        constants: constants.unwrap_or_default(),
        ranges: ranges(scene).unwrap_or_default(),
        samplers: samplers(scene),
        ..preshade_passes::pass::Facts::default()
    }
}

/// How the samplers are set that the scene's materials are drawn with and that compare nothing.
fn samplers(scene: &crate::scene::Scene) -> Vec<preshade_passes::pass::SamplerState> {
    let plans = originals(scene);
    let mut found = Vec::new();
    for (material, plan) in scene.materials.iter().zip(&plans) {
        let bound = plan.main().map(|pass| bind::samplers(material, pass));
        let bound = bound.and_then(Result::ok).unwrap_or_default();
        let filtering = bound.iter().filter(|s| s.sampler.compare.is_none());
        found.extend(filtering.map(|s| preshade_passes::pass::SamplerState {
            material: material.name.clone(),
            group: s.group,
            binding: s.binding,
            filtered: s.sampler.filter == Filter::Linear,
            anisotropy: s.sampler.anisotropy,
        }));
    }
    found
}

/// [`known`], as far as the passes of `recipe` read it.
pub fn known_for(
    scene: &crate::scene::Scene,
    recipe: &crate::recipe::Recipe,
) -> preshade_passes::pass::Facts {
    use preshade_passes::depth_prepass::DepthPrepass;
    use preshade_passes::early_discard::EarlyDiscard;
    use preshade_passes::pass::{Facts, Pass};
    use preshade_passes::shadow::Shadow;
    use preshade_passes::skip_taps::SkipTaps;
    use preshade_passes::trim_loop::TrimLoop;
    // The passes that read neither: all others may.
    let names = [
        DepthPrepass::INFO.name,
        EarlyDiscard::INFO.name,
        Shadow::INFO.name,
        SkipTaps::INFO.name,
        TrimLoop::INFO.name,
    ];
    match recipe
        .steps
        .iter()
        .all(|s| names.contains(&s.pass.as_str()))
    {
        true => Facts::default(),
        false => known(scene),
    }
}

/// The plans that draw a scene's materials as their authors wrote them.
pub fn originals(scene: &crate::scene::Scene) -> Vec<preshade_passes::plan::Plan> {
    scene
        .materials
        .iter()
        .map(|m| {
            preshade_passes::plan::Plan::original(
                &m.name,
                m.program.clone(),
                &m.vertex,
                m.fragment.as_deref(),
                &m.state,
            )
        })
        .collect()
}
