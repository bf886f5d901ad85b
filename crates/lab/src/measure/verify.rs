//! A scene drawn with the original and its variants, view by view.

mod final_verdict;
mod measurement;

use std::collections::BTreeSet;

use preshade_plan::contract::Verdict;

use super::bench::{self, Repeat};
use super::picture_warnings::{self, Colours, decides_coverage, undiscarded};
use super::shading::Counter;
use super::{Clock, Discarded, Error, Session, Settings, Variant, View, counting, outputs, shadow};
use crate::measure::record::{ORIGINAL, Pictures, Report, SCHEMA, Unfinished};
use measurement::Measurement;
use preshade_draw::scene::{Frame, bind};

/// How far a measurement is.
#[derive(Clone, Debug, PartialEq)]
pub struct VerifyProgress {
    /// Part done, 0 to 1.
    pub done: f64,
    pub what: String,
    /// The results so far, after each view. `None`: nothing new.
    pub so_far: Option<Box<Unfinished>>,
}

impl VerifyProgress {
    pub(crate) fn at(done: f64, what: impl Into<String>) -> Self {
        Self {
            done,
            what: what.into(),
            so_far: None,
        }
    }

    /// Progress in `view` of `views`. `part` of it is done.
    fn of_view(view: usize, part: f64, views: usize, what: String) -> Self {
        Self::at(0.1 + 0.9 * (view as f64 + part) / views as f64, what)
    }
}

/// The report and the pictures of the headline view.
#[derive(Clone, Debug)]
pub struct Verified {
    pub report: Report,
    /// Pictures of the variants that were drawn, without the original.
    pub pictures: Vec<Pictures>,
    /// Why measuring ended early, with the adapter lost; `None`: it did not.
    pub lost: Option<String>,
}

struct Run<'a, 'p> {
    session: &'a Session<'a>,
    settings: &'a Settings,
    progress: &'p mut dyn FnMut(VerifyProgress),
    views: Vec<(View, &'a Frame)>,
    /// The original first.
    subjects: Vec<Measurement<'a>>,
    clock: Option<Clock>,
    depth_ties: u64,
    colours: Colours,
    /// Pixels that are left out, in the view with most.
    unsteady: u64,
    /// Why the run ended early.
    lost: Option<String>,
}

/// Draws every view of a scene with the original and with `variants`. Compares, counts and times
/// them.
///
/// A variant that does not compile, or with which the adapter is lost, is not measured. The results
/// of the others remain.
///
/// # Errors
///
/// The original cannot be drawn, or the adapter is lost before the first view.
pub fn verify(
    session: &Session<'_>,
    variants: &[Variant],
    settings: &Settings,
    progress: &mut dyn FnMut(VerifyProgress),
) -> Result<Verified, Error> {
    let original = Variant {
        name: ORIGINAL.to_owned(),
        recipe: String::new(),
        plans: session.originals().to_vec(),
        kept: Vec::new(),
    };
    let views = View::all(session.scene(), settings.frames_per_camera);
    let headline = views.first().map(|(view, _)| view.clone());
    let (mut subjects, mut lost) = (Vec::new(), None);
    for (i, variant) in std::iter::once(&original).chain(variants).enumerate() {
        let done = 0.1 * i as f64 / (variants.len() + 1) as f64;
        progress(VerifyProgress::at(
            done,
            format!("compiling `{}`", variant.name),
        ));
        let (subject, why) = Measurement::new(session, variant, headline.as_ref())?;
        subjects.push(subject);
        lost = lost.or(why);
    }
    let mut run = Run {
        session,
        settings,
        progress,
        views,
        subjects,
        clock: None,
        depth_ties: 0,
        colours: Colours::default(),
        unsteady: 0,
        lost,
    };
    if run.lost.is_none() {
        run.measure()?;
    }
    run.finish(variants)
}

impl Run<'_, '_> {
    /// Measures view by view, until the last or until the adapter is lost.
    fn measure(&mut self) -> Result<(), Error> {
        let (plans, form) = (self.session.originals(), self.session.form());
        let inputs = self.session.inputs();
        let mut ties = Counter::ties(inputs, plans, form, Discarded::LeftOut, counting)?;
        for i in 0..self.views.len() {
            self.tell(i, 0.0, self.views[i].0.described());
            if let Err(error) = self.measure_view(i, &mut ties) {
                if error.is_endless() {
                    return Err(error);
                }
                // Without the original there is nothing to compare with, and a lost adapter draws no more.
                self.lost = Some(error.to_string());
                break;
            }
            let missing = self.views[i + 1..].iter().map(|(v, _)| v.described());
            let so_far = Report {
                clock: self.clock,
                variants: self.subjects.iter().map(Measurement::so_far).collect(),
                ..self.blank()
            };
            let unfinished = Unfinished::new(so_far, missing.collect());
            let mut told = self.at(i, 1.0, self.views[i].0.described());
            told.so_far = Some(Box::new(unfinished));
            (self.progress)(told);
        }
        Ok(())
    }

    fn measure_view(&mut self, index: usize, ties: &mut Counter<'_>) -> Result<(), Error> {
        let (view, frame) = self.views[index].clone();
        self.session.inputs().set_frame(frame)?;
        if view.order == self.views[0].0.order {
            self.depth_ties += ties.ties_in(frame, view.order)?;
        }
        let first = bench::compare(&mut self.subjects, (&view, frame), Repeat::Always)?;
        if let Some(first) = &first {
            self.colours.look(&first.picture);
            self.unsteady = self.unsteady.max(first.unsteady());
        }
        measurement::count_view(&mut self.subjects, (&view, frame), index == 0)?;
        if index == 0 {
            for subject in &mut self.subjects {
                subject.count_invocations(self.session.gpu())?;
            }
        }
        if self.settings.timed.includes(&view, index == 0) {
            self.time_view(index)?;
        }
        Ok(())
    }

    fn time_view(&mut self, index: usize) -> Result<(), Error> {
        let (view, frame) = self.views[index].clone();
        let (progress, views) = (&mut self.progress, self.views.len());
        let tick = |part: f64| {
            let what = format!("timing {}", view.described());
            progress(VerifyProgress::of_view(
                index,
                0.5 + 0.5 * part,
                views,
                what,
            ));
        };
        let at = (&view, frame);
        let timing = &self.settings.timing;
        let (clock, timings) = bench::race(self.session, &mut self.subjects, at, timing, tick)?;
        self.clock = Some(clock);
        for (subject, timing) in self.subjects.iter_mut().zip(timings) {
            if let Some(timing) = timing {
                subject.timed(timing, index == 0);
            }
        }
        Ok(())
    }

    /// Everything after the last view, and the report.
    fn finish(mut self, variants: &[Variant]) -> Result<Verified, Error> {
        for (subject, variant) in self.subjects.iter_mut().skip(1).zip(variants) {
            if self.lost.is_none() && variant.plans.iter().any(shadow::has_shadow) {
                let what = format!("`{}` under the light", variant.name);
                (self.progress)(VerifyProgress::at(1.0 - f64::EPSILON, what));
                let measured = subject.measure_shadow(self.session, variant, self.settings);
                self.lost = measured.err().map(|error| error.to_string());
            }
            if self.lost.is_none() && variant.plans.iter().any(outputs::has_outputs) {
                let what = format!("the auxiliary pictures of `{}`", variant.name);
                (self.progress)(VerifyProgress::at(1.0 - f64::EPSILON, what));
                let measured = subject.measure_outputs(self.session, variant, self.settings);
                self.lost = measured.err().map(|error| error.to_string());
            }
            subject.run_self_tests(self.session, self.lost.as_deref());
        }
        let assumed = bind::guessed(self.session.scene());
        let nothing = self.subjects.iter().all(|s| s.covered.unwrap_or(0) == 0);
        let mut warnings: Vec<String> = picture_warnings::missing_attributes(&assumed)
            .into_iter()
            .collect();
        warnings.extend(picture_warnings::overlapping_draws(self.session.scene()));
        // If the pictures are empty, the verdicts report it.
        warnings.extend(self.colours.warning().filter(|_| !nothing));
        warnings.extend(picture_warnings::unsteady(self.unsteady));
        let frames: Vec<_> = self.views.iter().map(|(v, f)| (*f, v.order)).collect();
        // The verdicts report an empty picture.
        let undiscarded = match nothing || self.lost.is_some() {
            true => Vec::new(),
            false => undiscarded(self.session, &frames)?,
        };
        let drawn = self.subjects.iter().skip(1).zip(variants);
        let drawn = drawn.filter(|(subject, _)| subject.covered.is_some());
        let deciding: BTreeSet<&str> = drawn
            .flat_map(|(_, variant)| &variant.plans)
            .filter(|plan| decides_coverage(plan))
            .map(|plan| plan.material.as_str())
            .collect();
        let mut untested = Vec::new();
        for materials in undiscarded {
            let is_decided = materials.iter().any(|m| deciding.contains(m));
            // A captured frame is all that the user has: nobody can add a fragment that is
            // discarded.
            let list = if is_decided && !self.session.scene().is_captured() {
                &mut untested
            } else {
                &mut warnings
            };
            list.push(picture_warnings::untested(&materials));
        }
        let scene = self.session.scene();
        let drawn = self.subjects.iter().skip(1).zip(variants);
        let drawn = drawn.filter(|(subject, _)| subject.covered.is_some());
        let plans = drawn.flat_map(|(_, variant)| &variant.plans);
        let mut unbudgeted = None;
        if let Some(branches) = picture_warnings::undrawn(scene, plans) {
            // For a real scene, the guard limits a host to the drawn values.
            match scene.is_made_up {
                true => unbudgeted = Some(branches),
                false => warnings.push(branches),
            }
        }
        let away = nothing
            && self.lost.is_none()
            && picture_warnings::faces_away(self.session, &frames).unwrap_or(false);
        let mut report = Report {
            clock: self.clock,
            depth_ties: self.lost.is_none().then_some(self.depth_ties),
            assumed,
            warnings,
            untested,
            ..self.blank()
        };
        let mut pictures = Vec::new();
        for subject in self.subjects {
            let (variant, picture) = subject.finish(self.session.gpu(), self.lost.as_deref(), away);
            report.variants.push(variant);
            pictures.extend(picture);
        }
        if let Some(why) = unbudgeted {
            // A promise without a budget does not depend on the drawn values.
            report.void(&why, |v| {
                v.verdict == Verdict::Holds && !v.contract.budgets().is_empty()
            });
        }
        if let Some(why) = report.unrepeated() {
            report.void(&why, |v| !matches!(v.verdict, Verdict::NotMeasured { .. }));
        }
        (self.progress)(VerifyProgress::at(1.0, "done"));
        Ok(Verified {
            report,
            pictures,
            lost: self.lost,
        })
    }

    /// How far the run is, in part of a view.
    fn at(&self, view: usize, part: f64, what: String) -> VerifyProgress {
        VerifyProgress::of_view(view, part, self.views.len(), what)
    }

    fn tell(&mut self, view: usize, part: f64, what: String) {
        let at = self.at(view, part, what);
        (self.progress)(at);
    }

    /// A report of nothing yet.
    fn blank(&self) -> Report {
        let scene = self.session.scene();
        Report {
            schema: SCHEMA.to_owned(),
            scene: scene.name.clone(),
            part: scene.part.clone(),
            resolution: scene.size,
            samples: scene.samples,
            command: self.settings.command.clone(),
            adapter: self.session.gpu().adapter().clone(),
            clock: None,
            depth_ties: None,
            made_up: scene.is_made_up,
            assumed: Vec::new(),
            notes: scene.notes.clone(),
            warnings: Vec::new(),
            untested: Vec::new(),
            not_drawn: None,
            variants: Vec::new(),
            sweeps: Vec::new(),
            chosen: None,
        }
    }
}
