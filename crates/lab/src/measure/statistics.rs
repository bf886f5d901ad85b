//! Invocations as the adapter counts them.

use serde::{Deserialize, Serialize};

use super::Error;
use preshade_draw::render::{Gpu, Prepared};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Invocations {
    /// Vertex stage; the adapter's reuse of vertices is accounted for.
    pub vertex: u64,
    /// Fragment stage invocations, with helper lanes if the adapter counts them. `None` on software
    /// adapters, which count before the early depth test.
    pub fragment: Option<u64>,
}

/// Draws one frame and returns its invocations. `None`: the adapter does not count them.
pub fn invocations(gpu: &Gpu, prepared: &Prepared<'_>) -> Result<Option<Invocations>, Error> {
    if !gpu.has_pipeline_statistics() {
        return Ok(None);
    }
    let counts = prepared.draw_counted()?;
    let sum = |which: usize| counts.iter().skip(which).step_by(2).sum::<u64>();
    // Two counters a pass, in the order of their bits: vertex, then fragment.
    Ok(Some(Invocations {
        vertex: sum(0),
        fragment: (gpu.adapter().kind != "software").then(|| sum(1)),
    }))
}
