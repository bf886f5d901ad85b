//! Measures the parts of a frame's time that its passes and materials take, and compares its replay
//! with the page.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::Error;
use super::check::{Compared, shown};
use super::replay::{LeftOut, Replay, Until};
use preshade_draw::render::Gpu;
use preshade_frames::folder::Capture;
use preshade_frames::pass::{Kind, Pass, passes};

/// How many times to execute the frame with timing, after one time without.
const TIMED: usize = 3;

/// A render pass and its part of the frame's time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Share {
    pub kind: Kind,
    pub draws: usize,
    /// Part of the time of all commands that draw, compute or copy, from 0 to 1.
    pub part: f64,
}

/// A frame with timed commands: each is submitted alone and waited for. Repetitions count with the
/// shortest time.
pub(super) struct Timer<'a> {
    capture: &'a Capture,
    frame: usize,
    replay: Replay<'a>,
    /// Shortest time of each command, in seconds.
    commands: Vec<f64>,
    /// Time of the whole frame in each repetition, in seconds.
    totals: Vec<f64>,
    /// Difference from the page's picture, if the frame has one.
    pub compared: Option<Compared>,
}

impl<'a> Timer<'a> {
    /// Replays the capture up to the end of the frame, and times the frame.
    ///
    /// # Errors
    /// The capture is broken, or the device is lost.
    pub fn new(capture: &'a Capture, gpu: &'a Gpu, frame: usize) -> Result<Self, Error> {
        let mut replay = Replay::new(gpu, capture);
        for earlier in 0..=frame {
            replay.frame(earlier, Until::End)?;
        }
        let compared = shown(capture, &mut replay, frame)?.map(|(compared, _)| compared);
        let mut made = Self {
            capture,
            frame,
            replay,
            commands: Vec::new(),
            totals: Vec::new(),
            compared,
        };
        for _ in 0..TIMED {
            made.time()?;
        }
        Ok(made)
    }

    fn time(&mut self) -> Result<(), Error> {
        let times = self.replay.timed(self.frame)?;
        self.totals.push(times.iter().sum());
        least(&mut self.commands, times);
        Ok(())
    }

    /// Parts that the replay left out, and how often.
    pub fn left_out(&self) -> &BTreeMap<LeftOut, u64> {
        self.replay.left_out()
    }

    fn total(&self) -> f64 {
        self.commands.iter().sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// The frame's render passes, in order.
    ///
    /// # Errors
    /// The capture is broken.
    pub fn passes(&self) -> Result<Vec<Share>, Error> {
        let total = self.total();
        let share = |pass: &Pass<'_>| Share {
            kind: pass.kind,
            draws: pass.draws.len(),
            part: self.commands.get(pass.command).map_or(0.0, |t| t / total),
        };
        Ok(passes(self.capture, self.frame)?
            .iter()
            .map(share)
            .collect())
    }

    /// The part of the frame's time that goes away without the draws of each pipeline, from 0 to 1.
    /// `None` if it is smaller than the variation between repetitions.
    ///
    /// Draws may overlap on the screen, so the parts need not add up to that of their pass.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn without(&mut self, pipelines: &[usize]) -> Result<Vec<Option<f64>>, Error> {
        let mut without = vec![Vec::new(); pipelines.len()];
        for _ in 0..TIMED {
            self.time()?;
            for (pipeline, times) in pipelines.iter().zip(&mut without) {
                self.replay.hide(Some(*pipeline));
                let timed = self.replay.timed(self.frame);
                self.replay.hide(None);
                least(times, timed?);
            }
        }
        let total = self.total();
        // The shortest times of two runs differ by about as much as the two shortest of one.
        let mut totals = self.totals.clone();
        totals.sort_by(f64::total_cmp);
        let varies = totals.get(1).map_or(0.0, |second| second / totals[0] - 1.0);
        let gone = |times: &Vec<f64>| {
            let part = 1.0 - times.iter().sum::<f64>() / total;
            (part > varies).then_some(part)
        };
        Ok(without.iter().map(gone).collect())
    }
}

/// Takes the minimum time of each command.
fn least(so_far: &mut Vec<f64>, now: Vec<f64>) {
    if so_far.is_empty() {
        *so_far = now;
        return;
    }
    for (least, now) in so_far.iter_mut().zip(now) {
        *least = least.min(now);
    }
}
