//! Checks whether the plans of several materials may share a frame. A pre-pass of one changes which
//! fragments of the others run, and the depth they find.
//!
//! For ordinary opaque neighbours this has no effect on the final picture. It has one if a
//! neighbour moves depth away again (a sky drawn with `always`), if a neighbour counts fragments
//! that end up hidden (stencil writes, stores), and if hidden fragments remain visible in colour
//! channels that the covering surface does not write. Surfaces shaded from ids get their colour
//! before their neighbours are drawn, so the neighbours must write depth.

use crate::analysis::{opaque, refusals};
use preshade_dataflow::graph::Graph;
use preshade_plan::channels::{self, Channels};
use preshade_plan::pass::Refusal;
use preshade_plan::plan::{BindingSource, GpuPass, Phase, Plan, Role};

/// Why `plan` may not draw its depth ahead in a frame with `neighbours`; `None` where it may, or
/// does not. The plan's own material may be among them.
pub fn conflict<'a>(
    plan: &Plan,
    neighbours: impl IntoIterator<Item = &'a Plan>,
) -> Option<Refusal> {
    let step = plan.steps.last()?;
    let draws_ahead = |p: &&GpuPass| matches!(p.role, Role::Prepass | Role::Ids);
    let prepass = plan.passes.iter().find(draws_ahead)?;
    let direction = prepass.depth.as_ref()?.compare.direction();
    let neighbours: Vec<&Plan> = neighbours
        .into_iter()
        .filter(|n| n.material != plan.material)
        .collect();
    // Does the main pass trust the pre-pass's depth: by EQUAL, read-only, or as a texture? Then no
    // neighbour may have moved depth meanwhile. Under a bias the author's own comparison still
    // runs, and an overdrawn surface does not show: `shows_through` checks its colour.
    let samples =
        |b: &preshade_plan::plan::BindingUse| matches!(b.source, BindingSource::Attachment { .. });
    let main = plan.main().and_then(|p| Some((p, p.depth.as_ref()?)));
    // Without a main pass it is shaded from ids, before its neighbours are drawn.
    let trusts_depth = main.is_none_or(|(main, depth)| {
        depth.read_only || depth.compare.direction().is_none() || main.bindings.iter().any(samples)
    });
    let of_neighbour = |neighbour: &&Plan| {
        let pass = neighbour.main().filter(|p| p.phase == Phase::Opaque)?;
        let moves_depth = pass
            .depth
            .as_ref()
            .is_some_and(|d| d.write && d.compare.direction() != direction)
            && !neighbour.passes.iter().any(|p| draws_ahead(&p));
        if moves_depth && trusts_depth {
            return Some(Refusal::new(
                &step.pass,
                &refusals::NEIGHBOUR_MOVES_DEPTH,
                format!(
                    "material `{}` writes depth without comparing it, over what was drawn ahead of \
                     it",
                    neighbour.material
                ),
                "take depth-prepass:form=biased, which keeps the author's comparison, or draw that \
                 material in a phase of its own",
            ));
        }
        // Surfaces shaded from ids get their colour before any neighbour is drawn, whatever the
        // order was.
        if main.is_none() && !pass.depth.as_ref().is_some_and(|d| d.write) {
            return Some(Refusal::new(
                &step.pass,
                &refusals::NEIGHBOUR_WITHOUT_DEPTH,
                format!(
                    "material `{}` is opaque and writes no depth: what is drawn after it covers \
                     it, whatever is nearer, and what is shaded from ids would be drawn before it",
                    neighbour.material
                ),
                "let that material write depth, or draw it in a phase of its own, before or after \
                 the frame's opaque materials",
            ));
        }
        leaves_traces(neighbour, pass).then(|| {
            Refusal::new(
                &step.pass,
                &refusals::NEIGHBOUR_COUNTS_FRAGMENTS,
                format!(
                    "material `{}` writes stencil or memory, hidden fragments of it too: which of \
                     them run depends on who drew depth before",
                    neighbour.material
                ),
                "draw that material in a pass of its own, before the pre-pass or after the frame",
            )
        })
    };
    neighbours
        .iter()
        .find_map(of_neighbour)
        .or_else(|| shows_through(plan, &neighbours, &step.pass))
}

/// Why `plan`, which is shaded from ids, may not share a frame with `others`. `ties` is the number
/// of pixels in which two surfaces share the winning depth. A material that is not shaded from ids
/// is drawn later, so another order of draws decides a tie. `None` for other plans, if nothing
/// ties, and if all opaque materials are shaded from ids, which keeps their order.
pub fn tied<'a>(
    plan: &Plan,
    others: impl IntoIterator<Item = &'a Plan>,
    ties: Option<u64>,
) -> Option<Refusal> {
    let ties = ties.filter(|n| *n > 0)?;
    let has_ids = |p: &Plan| p.passes.iter().any(|p| p.role == Role::Ids);
    let step = plan.steps.last().filter(|_| has_ids(plan))?;
    let is_drawn = |p: &&Plan| !has_ids(p) && p.main().is_some_and(|m| m.phase == Phase::Opaque);
    let drawn = others.into_iter().find(is_drawn)?;
    Some(Refusal::new(
        &step.pass,
        &refusals::DEPTH_TIES,
        format!(
            "material `{}` is not shaded from ids and so is drawn after what is, and where two \
             surfaces share the winning depth (pixels: {ties}, over all views) the order of draws \
             decides which is seen",
            drawn.material
        ),
        "split all opaque materials of the frame or none of them, or set their surfaces apart (a \
         depth bias, an offset)",
    ))
}

/// The refusal of a frame in which a fragment that some pre-pass drops may show in the end.
///
/// A fragment that a pre-pass drops lies behind a fragment of its material. As written it was
/// drawn, and then covered: by that fragment, or by one still nearer which made that fragment fail.
/// Either must write every channel that the dropped one wrote. So every opaque material that writes
/// depth, with a pre-pass or without, must write every channel that any other opaque material
/// writes. Draws of one material leave the same channels.
fn shows_through(plan: &Plan, neighbours: &[&Plan], pass: &str) -> Option<Refusal> {
    let opaque = |plan: &Plan| -> Option<(String, Channels, bool)> {
        // The original's main pass. A transformed one may leave writing depth to its pre-pass, and
        // a plan shaded from ids has none.
        let original = plan.original.as_deref();
        let (whole, main) = match (plan.main(), original) {
            (Some(main), _) => (plan, main),
            (None, original) => (original?, original?.main()?),
        };
        let main = Some(main).filter(|p| p.phase == Phase::Opaque)?;
        let channels = channels::written(whole.program(main)?, main);
        let original = original.and_then(Plan::main).unwrap_or(main);
        let hides = original.depth.as_ref().is_some_and(|d| d.write);
        Some((plan.material.clone(), channels, hides))
    };
    let materials: Vec<_> = std::iter::once(plan)
        .chain(neighbours.iter().copied())
        .filter_map(opaque)
        .collect();
    for (front, written, _) in materials.iter().filter(|(_, _, hides)| *hides) {
        for (behind, needed, _) in materials.iter().filter(|(behind, ..)| behind != front) {
            let left = needed.left_by(written);
            if left.is_empty() {
                continue;
            }
            return Some(Refusal::new(
                pass,
                &refusals::COLOR_MASK,
                format!(
                    "material `{front}` hides what lies behind it and leaves {left} as it is, \
                     which material `{behind}` writes: there a hidden surface shows, if it was \
                     drawn first"
                ),
                format!(
                    "let `{front}` write all channels that the frame's opaque materials write, or \
                     draw it in a pass of its own after them, without depth-prepass and \
                     early-discard"
                ),
            ));
        }
    }
    None
}

/// Whether fragments that end up hidden leave something behind.
fn leaves_traces(plan: &Plan, pass: &GpuPass) -> bool {
    let stencil = pass
        .stencil
        .as_ref()
        .is_some_and(preshade_plan::state::StencilState::writes);
    stencil
        || plan
            .program(pass)
            .is_some_and(|program| opaque::stores(&Graph::build(program), program, pass))
}
