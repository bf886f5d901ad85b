//! Frames drawn and compared with the original, view by view.

use preshade_plan::contract::Verdict;

use super::PlanError;
use super::assign::Considered;
use super::choices::Choices;
use super::decision::PlanCost;
use crate::measure::bench::{self, Contestant, Repeat};
use crate::measure::unsteady::Original;
use crate::measure::{self, Session, Subject, View};
use preshade_draw::render::Rendered;
use preshade_draw::scene::Frame;

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
}

impl<'a> Contestant<'a> for Runner<'a> {
    fn subject(&mut self) -> &mut Subject<'a> {
        &mut self.subject
    }

    /// A frame that breaks its contract is drawn no more.
    fn hold(
        &mut self,
        view: (&View, &Frame),
        original: &Original,
        picture: &Rendered,
    ) -> Result<(), measure::Error> {
        self.subject.judge(view, &original.picture, picture)?;
        if !self.subject.is_standing() {
            self.subject.stop();
        }
        Ok(())
    }
}

/// Draws one view with every runner and compares each with the first, the original.
///
/// # Errors
/// The original cannot be drawn, or the adapter is lost.
pub(crate) fn compare(
    session: &Session<'_>,
    runners: &mut [Runner<'_>],
    view: (&View, &Frame),
) -> Result<Option<Original>, PlanError> {
    session.inputs().set_frame(view.1)?;
    let first = bench::compare(runners, view, Repeat::BeforeBlame)?;
    if let (Some(_), Some(original)) = (&first, runners.first_mut()) {
        original.subject.verdict = Verdict::Holds;
    }
    Ok(first)
}
