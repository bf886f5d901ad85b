//! Whether the plans of several materials may stand in one frame: a pre-pass of one changes which fragments of the others run, and in what depth they find.
//!
//! For ordinary opaque neighbours that changes nothing in the end. It does where a neighbour moves depth away again (a sky drawn with `always`), or where what it
//! leaves behind counts fragments that end up hidden (stencil writes, stores).

use crate::graph::Graph;
use crate::opaque;
use crate::pass::Refusal;
use crate::plan::{BindingSource, GpuPass, Phase, Plan, Role};

/// Why `plan` may not draw its depth ahead in a frame with `neighbours`; `None` where it may, or does not.
pub fn conflict<'a>(
    plan: &Plan,
    neighbours: impl IntoIterator<Item = &'a Plan>,
) -> Option<Refusal> {
    let step = plan.steps.last()?;
    let draws_ahead = |p: &&GpuPass| matches!(p.role, Role::Prepass | Role::Ids);
    let prepass = plan.passes.iter().find(draws_ahead)?;
    let direction = prepass.depth.as_ref()?.compare.direction();
    // Who takes the pre-pass's depth for the last word: by EQUAL, read-only, or as a texture. Nobody may have moved depth meanwhile.
    let samples =
        |b: &crate::plan::BindingUse| matches!(b.source, BindingSource::Attachment { .. });
    let main = plan.main().and_then(|p| Some((p, p.depth.as_ref()?)));
    // Without a main pass it is shaded from ids, before its neighbours are drawn.
    let trusts_depth = main.is_none_or(|(main, depth)| {
        depth.read_only || depth.compare.direction().is_none() || main.bindings.iter().any(samples)
    });
    neighbours.into_iter().filter(|n| n.material != plan.material).find_map(|neighbour| {
        let pass = neighbour.main().filter(|p| p.phase == Phase::Opaque)?;
        let moves_depth = pass.depth.as_ref().is_some_and(|d| d.write && d.compare.direction() != direction)
            && !neighbour.passes.iter().any(|p| draws_ahead(&p));
        // Under a bias the author's own comparison goes on, and what a mover overdraws does not show; unless it leaves colour standing.
        let opaque_colors = !pass.targets.is_empty() && pass.targets.iter().flatten().all(|t| t.write_mask == 0b1111);
        if moves_depth && (trusts_depth || !opaque_colors) {
            return Some(Refusal::new(
                &step.pass,
                "neighbour-moves-depth",
                format!("material `{}` writes depth without comparing it, over what was drawn ahead of it", neighbour.material),
                "take depth-prepass:form=biased, which keeps the author's comparison, or draw that material in a phase of its own",
            ));
        }
        leaves_traces(neighbour, pass).then(|| {
            Refusal::new(
                &step.pass,
                "neighbour-counts-fragments",
                format!(
                    "material `{}` writes stencil or memory, hidden fragments of it too: which of them run depends on who drew depth before",
                    neighbour.material
                ),
                "draw that material in a pass of its own, before the pre-pass or after the frame",
            )
        })
    })
}

/// Whether fragments that end up hidden leave something behind.
fn leaves_traces(plan: &Plan, pass: &GpuPass) -> bool {
    let stencil = pass
        .stencil
        .as_ref()
        .is_some_and(crate::state::StencilState::writes);
    stencil
        || plan
            .program(pass)
            .is_some_and(|program| opaque::stores(&Graph::build(program), program, pass))
}
