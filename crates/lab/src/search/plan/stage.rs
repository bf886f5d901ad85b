//! Frames drawn, compared with the original and timed side by side, view by view.

use preshade_plan::contract::Verdict;

use super::PlanError;
use super::assign::Considered;
use super::choices::Choices;
use super::decision::PlanCost;
use crate::measure::unsteady::Original;
use crate::measure::{self, Clock, Session, Subject, Timing, TimingSettings, View};
use preshade_draw::scene::{DrawOrder, Frame};

/// A plan of the frame that is measured.
pub struct Runner<'a> {
    pub name: String,
    /// The costs of having it.
    pub cost: Option<PlanCost>,
    pub subject: Subject<'a>,
}

impl<'a> Runner<'a> {
    /// Builds the frame. If that fails, it is [`Verdict::NotMeasured`].
    ///
    /// # Errors
    ///
    /// A lost adapter.
    pub fn new(
        session: &'a Session<'a>,
        choices: &[Choices],
        considered: &Considered,
    ) -> Result<Self, PlanError> {
        let mut runner = Self {
            name: considered.assignment.name(choices),
            cost: None,
            subject: Subject::new(session, considered.assignment.plans(choices)),
        };
        match runner.subject.build() {
            Ok(prepared) => {
                let (pipelines, creation) = prepared.creation();
                runner.cost = Some(PlanCost {
                    pipelines,
                    creation_ms: creation.as_secs_f64() * 1e3,
                    targets: prepared.targets(),
                });
            }
            Err(error) => runner.give_up(error.into())?,
        }
        Ok(runner)
    }

    /// Draws it no more, unless the adapter is lost.
    fn give_up(&mut self, error: measure::Error) -> Result<(), PlanError> {
        if error.is_lost() {
            return Err(error.into());
        }
        self.subject.quit(&error);
        Ok(())
    }
}

/// Draws one view with every runner and compares each with the first, the original, whose picture
/// is returned. A runner that breaks its contract is drawn no more.
///
/// # Errors
///
/// The original cannot be drawn, or the adapter is lost.
pub(crate) fn compare(
    session: &Session<'_>,
    runners: &mut [Runner<'_>],
    view: &View,
    frame: &Frame,
) -> Result<Option<Original>, PlanError> {
    session.inputs().set_frame(frame)?;
    let [original, others @ ..] = runners else {
        return Ok(None);
    };
    let Some(reference) = original.subject.draw(frame, view.order)? else {
        return Ok(None);
    };
    let is_captured = session.scene().is_captured();
    let mut first = Original::new(reference, session.scene());
    for runner in others.iter_mut().filter(|r| r.subject.is_standing()) {
        match runner.subject.draw(frame, view.order) {
            Ok(Some(mut picture)) => {
                let (own, subject) = (&mut original.subject, &mut runner.subject);
                if is_captured {
                    picture = first.of_variant(own, subject, (view, frame), picture)?;
                }
                subject.judge((view, frame), &first.picture, &picture)?;
            }
            Ok(None) => {}
            Err(error) => runner.give_up(error)?,
        }
    }
    original.subject.verdict = Verdict::Holds;
    Ok(Some(first))
}

/// Times one view with every standing runner. `None` for the others. The first runner is the
/// original. Another one that cannot be drawn is drawn no more.
///
/// # Errors
///
/// The original cannot be drawn, the adapter is lost, or as [`measure::time`].
pub(crate) fn time(
    session: &Session<'_>,
    runners: &mut [Runner<'_>],
    (frame, order): (&Frame, DrawOrder),
    settings: &TimingSettings,
) -> Result<(Clock, Vec<Option<Timing>>), PlanError> {
    session.inputs().set_frame(frame)?;
    let mut ready = Vec::new();
    let mut standing = Vec::new();
    // The fallback of a plan whose guard fails here may not build.
    for (index, runner) in runners.iter_mut().enumerate() {
        if runner.subject.is_standing()
            && let Err(error) = runner.subject.aimed(frame, order)
        {
            match index {
                0 => return Err(error.into()),
                _ => runner.give_up(error)?,
            }
        }
    }
    for runner in runners.iter_mut() {
        let prepared = match runner.subject.is_standing() {
            true => runner.subject.aimed(frame, order)?,
            false => None,
        };
        standing.push(prepared.is_some());
        ready.extend(prepared);
    }
    let (clock, timings) = measure::time(session.gpu(), &ready, settings, |_| {})?;
    let mut timings = timings.into_iter();
    let of = |stands: bool| if stands { timings.next() } else { None };
    Ok((clock, standing.into_iter().map(of).collect()))
}
