//! The clock of a search, and whoever watches it.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use super::{Ended, ExploreProgress, SearchStage};
use crate::measure::Error;

/// The clock, and whoever watches it.
pub(super) struct Watch<'p> {
    pub(super) start: Instant,
    pub(super) time: Duration,
    pub(super) ended: Ended,
    /// Something was skipped because time was short.
    pub(super) late: bool,
    pub(super) progress: &'p mut dyn FnMut(ExploreProgress) -> ControlFlow<()>,
}

impl Watch<'_> {
    pub(super) fn spent(&self) -> Duration {
        self.start.elapsed()
    }

    /// Time left for this part.
    pub(super) fn left(&self, by: f64) -> Duration {
        self.time.mul_f64(by).saturating_sub(self.spent())
    }

    /// The end of the whole search.
    pub(super) fn deadline(&self) -> Instant {
        self.start + self.time
    }

    pub(super) fn at(&mut self, stage: SearchStage, what: impl Into<String>) {
        let spent = self.spent();
        let told = (self.progress)(ExploreProgress {
            stage,
            what: what.into(),
            done: (spent.as_secs_f64() / self.time.as_secs_f64().max(1e-9)).min(1.0),
            left: self.time.saturating_sub(spent),
        });
        if told.is_break() {
            self.ended = Ended::Stopped;
        }
    }

    /// Whether there is time left for this part.
    pub(super) fn going_on(&mut self, by: f64) -> ControlFlow<()> {
        if self.ended == Ended::Complete && self.spent() > self.time.mul_f64(by) {
            self.ended = Ended::OutOfTime;
        }
        match self.ended {
            Ended::Complete => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        }
    }

    /// A stage that used up its part leaves the rest to the next.
    pub(super) fn forgive(&mut self) {
        if self.ended == Ended::OutOfTime {
            self.ended = Ended::Complete;
            self.late = true;
        }
    }

    pub(super) fn end(&self) -> Ended {
        match (&self.ended, self.late) {
            (Ended::Complete, true) => Ended::OutOfTime,
            (ended, _) => ended.clone(),
        }
    }

    /// Why nothing more is measured; `None` while it is.
    pub(super) fn over(&self) -> Option<&'static str> {
        match self.ended {
            Ended::Complete | Ended::OutOfTime => None,
            Ended::Stopped => Some("the search was stopped"),
            Ended::Lost { .. } => Some("the graphics device was lost"),
        }
    }

    pub(super) fn lost(&mut self, error: &Error) -> bool {
        let is_lost = matches!(error, Error::Render(error) if error.is_lost());
        if is_lost {
            self.ended = Ended::Lost {
                why: error.to_string(),
            };
        }
        is_lost
    }
}
