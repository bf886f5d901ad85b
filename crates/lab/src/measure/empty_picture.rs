//! Whether the original draws anything: of an empty picture, no figure means anything.

use preshade_plan::plan::{GpuPass, Phase, Plan};
use preshade_plan::state::CompareFunction;

use super::picture_warnings::{self, draws, faces_away};
use super::verdict::nothing_drawn;
use super::{CountProgram, Error, Session};
use preshade_draw::scene::{DrawOrder, Frame};

/// Fails unless the original draws a fragment in one of `frames`.
///
/// # Errors
/// [`Error::Nothing`] with the reason, or as [`Counter::shaded`].
pub(crate) fn check_seen(
    session: &Session<'_>,
    frames: &[(&Frame, DrawOrder)],
) -> Result<(), Error> {
    let opaque: Vec<Plan> = session.originals().iter().map(opaque).collect();
    let all = |_: &Plan, _: &GpuPass| CountProgram::Constant;
    if draws(session, &opaque, frames, all)? {
        return Ok(());
    }
    let untested: Vec<Plan> = opaque.iter().map(untested).collect();
    Err(Error::Nothing(if faces_away(session, frames)? {
        picture_warnings::FACES_AWAY.to_owned()
    } else if draws(session, &untested, frames, all)? {
        HIDDEN.to_owned()
    } else {
        nothing_drawn(session.originals()).unwrap_or_else(|| NOTHING.to_owned())
    }))
}

const NOTHING: &str = "the original draws nothing in any view: every triangle lies outside of the view \
                       or is discarded";

const HIDDEN: &str = "the original draws nothing in any view: every fragment fails the depth test. Look \
                      whether the depth is cleared to the far end (`--reversed-z` clears to 0), and whether \
                      `depth_compare` fits the projection";

/// The plan with its blended draws among the opaque ones, so that they are counted too.
fn opaque(plan: &Plan) -> Plan {
    let mut plan = plan.clone();
    for pass in &mut plan.passes {
        if pass.phase == Phase::Blended {
            pass.phase = Phase::Opaque;
        }
    }
    plan
}

/// The plan without a depth test.
fn untested(plan: &Plan) -> Plan {
    let mut plan = plan.clone();
    for depth in plan.passes.iter_mut().filter_map(|p| p.depth.as_mut()) {
        depth.compare = CompareFunction::Always;
    }
    plan
}
