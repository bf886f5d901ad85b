//! Frames drawn, compared with the original and timed side by side, view by view.

use preshade_passes::contract::{Contract, Verdict};

use super::Error;
use super::assign::Considered;
use super::candidates::Choices;
use super::count::View;
use super::decision::PlanCost;
use crate::measure::{self, Clock, ErrorLadder, Timing, TimingSettings, verdict};
use crate::render::{
    self, FrameSettings, Gpu, Prepared, Rendered, SceneInputs, ShaderForm, Variant,
};
use crate::scene::{DrawOrder, Frame};

/// A frame that is drawn.
pub struct Subject<'a> {
    /// Name, in words.
    pub name: String,
    /// What it promises.
    pub contract: Contract,
    /// What it takes to have it.
    pub cost: Option<PlanCost>,
    /// What is known of the promise.
    pub verdict: Verdict,
    /// The worst difference of all pictures yet; `None`: nothing was compared.
    pub error: Option<ErrorLadder>,
    prepared: Option<Prepared<'a>>,
}

impl<'a> Subject<'a> {
    /// Builds the frame. What cannot be built is [`Verdict::NotMeasured`].
    ///
    /// # Errors
    /// A lost adapter.
    pub fn new(
        inputs: &'a SceneInputs<'a>,
        choices: &[Choices],
        considered: &Considered,
        form: ShaderForm,
    ) -> Result<Self, Error> {
        let plans = considered.assignment.plans(choices);
        let contract = plans
            .iter()
            .fold(Contract::exact(), |c, plan| c.and(plan.contract.clone()));
        let built = Variant::new(&plans, form)
            .and_then(|v| Prepared::new(inputs, &v, &FrameSettings::of(inputs.scene())));
        let mut subject = Self {
            name: considered.assignment.name(choices),
            contract,
            cost: None,
            verdict: Verdict::NotMeasured {
                why: "nothing was drawn".to_owned(),
            },
            error: None,
            prepared: None,
        };
        match built {
            Ok(prepared) => {
                let (pipelines, creation) = prepared.creation();
                subject.cost = Some(PlanCost {
                    pipelines,
                    creation_ms: creation.as_secs_f64() * 1e3,
                    targets: prepared.targets(),
                });
                subject.prepared = Some(prepared);
            }
            Err(error @ render::Error::Lost(_)) => return Err(error.into()),
            Err(error) => {
                subject.verdict = Verdict::NotMeasured {
                    why: error.to_string(),
                };
            }
        }
        Ok(subject)
    }

    /// Whether it is drawn, and kept its promise so far.
    pub fn is_standing(&self) -> bool {
        self.prepared.is_some() && !matches!(self.verdict, Verdict::Broken { .. })
    }

    fn draw(&mut self, frame: &Frame, order: DrawOrder) -> Result<Option<Rendered>, Error> {
        let Some(prepared) = &mut self.prepared else {
            return Ok(None);
        };
        prepared.aim(frame, order);
        match prepared.render() {
            Ok(picture) => Ok(Some(picture)),
            Err(error @ render::Error::Lost(_)) => Err(error.into()),
            Err(error) => {
                self.prepared = None;
                self.verdict = Verdict::NotMeasured {
                    why: error.to_string(),
                };
                Ok(None)
            }
        }
    }
}

/// Draws one view with every subject and compares each with the first, which is the original and whose picture is given back. A picture that breaks a promise puts its subject out.
///
/// # Errors
/// When the original cannot be drawn, or the adapter is lost.
pub fn compare(
    inputs: &SceneInputs<'_>,
    subjects: &mut [Subject<'_>],
    view: &View,
    frame: &Frame,
) -> Result<Option<Rendered>, Error> {
    inputs.set_frame(frame)?;
    let [original, others @ ..] = subjects else {
        return Ok(None);
    };
    let Some(reference) = original.draw(frame, view.order)? else {
        return Ok(None);
    };
    original.verdict = Verdict::Holds;
    for subject in others.iter_mut().filter(|s| s.is_standing()) {
        let Some(picture) = subject.draw(frame, view.order)? else {
            continue;
        };
        let error = measure::compare(&reference, &picture).map_err(measure::Error::from)?;
        let worst = subject
            .error
            .take()
            .map_or(error.clone(), |e| e.worst(&error));
        subject.error = Some(worst);
        subject.verdict = match verdict::breaks(&subject.contract, &error) {
            None => Verdict::Holds,
            Some(how) => Verdict::Broken {
                r#where: format!("{view}: {how}"),
            },
        };
    }
    Ok(Some(reference))
}

/// Times one view with every subject that stands; `None` for the others.
///
/// # Errors
/// As [`measure::time`].
pub fn time(
    gpu: &Gpu,
    inputs: &SceneInputs<'_>,
    subjects: &mut [Subject<'_>],
    (frame, order): (&Frame, DrawOrder),
    settings: &TimingSettings,
) -> Result<(Clock, Vec<Option<Timing>>), Error> {
    inputs.set_frame(frame)?;
    let mut ready = Vec::new();
    let mut standing = Vec::new();
    for subject in subjects.iter_mut() {
        let stands = subject.is_standing();
        let prepared = subject.prepared.as_mut().filter(|_| stands);
        standing.push(prepared.is_some());
        if let Some(prepared) = prepared {
            prepared.aim(frame, order);
            ready.push(&*prepared);
        }
    }
    let (clock, timings) = measure::time(gpu, &ready, settings, |_| {})?;
    let mut timings = timings.into_iter();
    let of = |stands: bool| if stands { timings.next() } else { None };
    Ok((clock, standing.into_iter().map(of).collect()))
}
