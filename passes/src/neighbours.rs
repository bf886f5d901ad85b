//! Whether the plans of several materials may stand in one frame: a pre-pass of one changes which fragments of the others run, and in what depth they find.
//!
//! For ordinary opaque neighbours that changes nothing in the end. It does where a neighbour moves depth away again (a sky drawn with `always`), or where what it
//! leaves behind counts fragments that end up hidden (stencil writes, stores).

use crate::graph::Graph;
use crate::opaque;
use crate::pass::Refusal;
use crate::plan::{GpuPass, Phase, Plan, Role};

/// Why `plan` may not draw its depth ahead in a frame with `neighbours`; `None` where it may, or does not.
pub fn conflict<'a>(
    plan: &Plan,
    neighbours: impl IntoIterator<Item = &'a Plan>,
) -> Option<Refusal> {
    let step = plan.steps.last()?;
    let prepass = plan.passes.iter().find(|p| p.role == Role::Prepass)?;
    let direction = prepass.depth.as_ref()?.compare.direction();
    let main = plan.main()?.depth.as_ref()?;
    // The main pass takes the depth it finds for its own: nobody may have moved it.
    let trusts_depth = main.read_only || main.compare.direction().is_none();
    neighbours.into_iter().filter(|n| n.material != plan.material).find_map(|neighbour| {
        let pass = neighbour.main().filter(|p| p.phase == Phase::Opaque)?;
        let moves_depth = pass.depth.as_ref().is_some_and(|d| d.write && d.compare.direction() != direction)
            && !neighbour.passes.iter().any(|p| p.role == Role::Prepass);
        if trusts_depth && moves_depth {
            return Some(Refusal::new(
                &step.pass,
                "neighbour-moves-depth",
                format!("material `{}` writes depth without comparing it, over what the pre-pass laid", neighbour.material),
                "take depth-prepass:form=biased or early-discard:attachment=own, which keep the author's comparison",
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
