//! What part of a frame's time its passes and materials take, and whether its replay is right.

use std::collections::BTreeMap;

use super::Error;
use super::check::{Compared, shown};
use super::folder::Capture;
use super::pass::{Kind, passes};
use super::replay::{LeftOut, Replay, Until};
use crate::render::Gpu;

/// Frames that are timed, after one that is not.
const TIMED: usize = 3;

/// A render pass and its part of the frame's time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share {
    /// What the pass is for.
    pub kind: Kind,
    /// Its draws.
    pub draws: usize,
    /// Its part of the time of all commands that draw, compute or copy, from 0 to 1.
    pub part: f64,
}

/// What a frame's time consists of.
#[derive(Clone, Debug, Default)]
pub struct Shares {
    /// Each render pass, in order.
    pub passes: Vec<Share>,
    /// By how much the frame is shorter without the draws of each of the given pipelines, from 0 to 1. They may
    /// overlap on the screen, so the parts need not add up to their pass's. `None`: the frame's own times vary by more.
    pub pipelines: Vec<Option<f64>>,
    /// The replayed frame against the page's picture, if there is one.
    pub compared: Option<Compared>,
    /// What the replay left out, and how often.
    pub left_out: BTreeMap<LeftOut, u64>,
}

/// The parts of a frame's time, from a replay. Each command is submitted and waited for alone. Of several
/// frames the least time of each command counts. `pipelines` are render pipelines: the frame is replayed
/// without the draws of one after the other.
///
/// # Errors
/// The capture is broken, or the device is lost.
pub fn shares(
    capture: &Capture,
    gpu: &Gpu,
    frame: usize,
    pipelines: &[usize],
) -> Result<Shares, Error> {
    let mut replay = Replay::new(gpu, capture);
    for earlier in 0..=frame {
        replay.frame(earlier, Until::End)?;
    }
    let compared = shown(capture, &mut replay, frame)?.map(|(compared, _)| compared);
    let left_out = replay.left_out().clone();
    let mut whole = Vec::new();
    let mut totals = Vec::new();
    let mut without = vec![Vec::new(); pipelines.len()];
    for _ in 0..TIMED {
        let times = replay.timed(frame)?;
        totals.push(times.iter().sum::<f64>());
        least(&mut whole, times);
        for (pipeline, times) in pipelines.iter().zip(&mut without) {
            replay.hide(Some(*pipeline));
            least(times, replay.timed(frame)?);
        }
        replay.hide(None);
    }
    let total = whole.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let share = |pass: &super::pass::Pass<'_>| Share {
        kind: pass.kind,
        draws: pass.draws.len(),
        part: whole.get(pass.command).map_or(0.0, |t| t / total),
    };
    // The least times of two runs differ by about as much as the two least of one.
    totals.sort_by(f64::total_cmp);
    let varies = totals.get(1).map_or(0.0, |second| second / totals[0] - 1.0);
    let gone = |times: &Vec<f64>| {
        let part = 1.0 - times.iter().sum::<f64>() / total;
        (part > varies).then_some(part)
    };
    Ok(Shares {
        passes: passes(capture, frame)?.iter().map(share).collect(),
        pipelines: without.iter().map(gone).collect(),
        compared,
        left_out,
    })
}

/// Keeps the lesser time of each command.
fn least(so_far: &mut Vec<f64>, now: Vec<f64>) {
    if so_far.is_empty() {
        *so_far = now;
        return;
    }
    for (least, now) in so_far.iter_mut().zip(now) {
        *least = least.min(now);
    }
}
