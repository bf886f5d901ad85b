//! What part of a frame's time each of its passes takes, and whether its replay is right.

use super::Error;
use super::check::{Compared, shown};
use super::folder::Capture;
use super::pass::{Kind, passes};
use super::replay::{Replay, Until};
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

/// The parts of a frame's render passes, in order, from a replay. Each command is submitted and waited
/// for alone. Of several frames the least time of each command counts. Beside them, the replayed frame
/// against the page's picture, if there is one.
///
/// # Errors
/// The capture is broken, or the device is lost.
pub fn shares(
    capture: &Capture,
    gpu: &Gpu,
    frame: usize,
) -> Result<(Vec<Share>, Option<Compared>), Error> {
    let mut replay = Replay::new(gpu, capture);
    for earlier in 0..=frame {
        replay.frame(earlier, Until::End)?;
    }
    let compared = shown(capture, &mut replay, frame)?.map(|(compared, _)| compared);
    let mut least: Vec<f64> = Vec::new();
    for _ in 0..TIMED {
        let times = replay.timed(frame)?;
        match least.is_empty() {
            true => least = times,
            false => {
                for (least, now) in least.iter_mut().zip(times) {
                    *least = least.min(now);
                }
            }
        }
    }
    let whole: f64 = least.iter().sum();
    let all = passes(capture, frame)?;
    let share = |pass: &super::pass::Pass<'_>| Share {
        kind: pass.kind,
        draws: pass.draws.len(),
        part: least
            .get(pass.command)
            .map_or(0.0, |t| t / whole.max(f64::MIN_POSITIVE)),
    };
    Ok((all.iter().map(share).collect(), compared))
}
