//! Obstacles to an early return of single lanes, and to a vote.

use naga::Expression;

use super::{EarlyDiscard, EarlyDiscardParams, Mode, gradients, refusals};
use crate::analysis::opaque::Opaque;
use preshade_plan::pass::{Pass, Refusal};
use shader_text::refusals::RefusalInfo;

/// Why single lanes must not return: a derivative that cannot be evaluated first, a rounded
/// derivative that decides coverage, or no budget for the rounding.
pub(crate) fn refuse_lane(
    opaque: &Opaque,
    fragment: usize,
    params: &EarlyDiscardParams,
) -> Option<Refusal> {
    const VOTE: &str =
        "take quad=vote, which leaves only when the whole quad is behind and touches no sample";
    let refuse = |code: &RefusalInfo, reason: &str, remedy: &str, span| {
        Refusal::new(EarlyDiscard::INFO.name, code, reason, remedy)
            .at(opaque.program.sources(), span)
    };
    let taken = match gradients::find(&opaque.graph, fragment) {
        Ok(taken) => taken,
        Err(span) => {
            return Some(refuse(
                &refusals::LANE_SPOILS_DERIVATIVES,
                "the fragment stage takes a derivative, or an implicit level of detail, of \
                 something that cannot be computed ahead of the discard, and a lane that left \
                 would spoil it for its neighbours",
                VOTE,
                span,
            ));
        }
    };
    let decides = opaque.decides.slice(&opaque.graph, fragment);
    let expressions = &opaque.program.module().entry_points[fragment]
        .function
        .expressions;
    let coverage = taken.iter().find(|e| {
        matches!(expressions[**e], Expression::ImageSample { .. })
            && decides.root().kept.expressions[e.index()].is_some()
    });
    let Some(sample) = coverage else {
        // A diagnostic picture differs everywhere and has no contract.
        let unsaid = params.budget.is_none() && params.mode == Mode::Cull;
        let first = taken.first().filter(|_| unsaid)?;
        return Some(refuse(
            &refusals::LANE_NEEDS_BUDGET,
            "gradients have to be taken ahead of the discard, and the level of detail they choose \
             rounds otherwise than the implicit one: up to 4/255 were measured in \
             trilinear textures, and anisotropic filtering is worst",
            "take quad=vote, which is exact, or say what difference is allowed: budget=0.02, say",
            expressions.get_span(*first),
        ));
    };
    Some(refuse(
        &refusals::LANE_DECIDES_COVERAGE,
        "a sample decides what a fragment covers, or its depth: with gradients taken first it \
         would round otherwise than in the pre-pass",
        VOTE,
        expressions.get_span(*sample),
    ))
}
