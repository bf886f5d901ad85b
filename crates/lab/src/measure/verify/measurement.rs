//! The original or a variant on its way through the views.

use preshade_plan::contract::Verdict;

use crate::measure::bench::Contestant;
use crate::measure::other_cameras::OtherCameras;
use crate::measure::record::{
    Cost, KeptMaterial, ORIGINAL, Pictures, SelfTestReport, VariantReport, ViewReport, Worst,
};
use crate::measure::statistics::invocations;
use crate::measure::unsteady::Original;
use crate::measure::variant::EVERY_REFUSES;
use crate::measure::verdict::nothing_drawn;
use crate::measure::{
    Counter, Error, Session, Settings, Shading, Subject, Timing, Variant, View, counting,
    junctions, outputs, shadow, slivers,
};
use preshade_draw::render::{Gpu, Rendered, SelfTestResult};
use preshade_draw::scene::{Draw, Frame};
use preshade_scenes::self_test;

/// The original or a variant.
pub(super) struct Measurement<'a> {
    pub(super) subject: Subject<'a>,
    headline: Option<View>,
    counter: Option<Counter<'a>>,
    pub(super) report: VariantReport,
    pub(super) pictures: Option<Pictures>,
    /// The largest error so far, by mean FLIP and then by changed pixels, with its pictures unless
    /// it is the headline view.
    pub(super) worst: Option<((f64, u64), Option<Worst>)>,
    /// The pictures from the other cameras.
    pub(super) elsewhere: OtherCameras,
    /// The verdict on its passes outside of the frame: shadow maps and auxiliary pictures. `None`: it
    /// has none, or they were not drawn yet.
    pub(super) aside: Option<Verdict>,
    /// Pixels with anything opaque in them, over the views counted.
    pub(super) covered: Option<u64>,
    /// The reason for an empty picture. `None`: blended draws, which are not counted, may be in it.
    pub(super) empty: Option<String>,
    /// Why the views that break the contract so far do not meet an assumption of it; `None`: one of
    /// them does, or none breaks it.
    pub(super) unmet: Option<String>,
}

/// Counts the fragments of every subject in a view.
pub(super) fn count_view(
    subjects: &mut [Measurement<'_>],
    (view, frame): (&View, &Frame),
    is_headline: bool,
) -> Result<(), Error> {
    let mut before: Option<Shading> = None;
    for subject in subjects {
        let Some(counter) = &mut subject.counter else {
            continue;
        };
        let shading = match counter.count(frame, view.order) {
            Ok(shading) => shading,
            Err(error) => {
                subject.give_up(error)?;
                continue;
            }
        };
        *subject.covered.get_or_insert(0) += shading.covered;
        let per_pixel = Some(shading.summary().per_pixel);
        if let Some(row) = subject.report.by_view.last_mut() {
            row.shaded_per_pixel = per_pixel;
        }
        if is_headline {
            subject.report.shaded_per_pixel = per_pixel;
            if let Some(pictures) = &mut subject.pictures {
                // Without an opaque surface nothing was counted.
                let counted = |s: &Shading| !s.counts.values.is_empty();
                pictures.overdraw_before = before.clone().filter(counted);
                pictures.overdraw_after = Some(shading.clone()).filter(counted);
            }
        }
        before.get_or_insert(shading);
    }
    Ok(())
}

impl<'a> Contestant<'a> for Measurement<'a> {
    fn subject(&mut self) -> &mut Subject<'a> {
        &mut self.subject
    }

    fn hold(
        &mut self,
        (view, frame): (&View, &Frame),
        original: &Original,
        picture: &Rendered,
    ) -> Result<(), Error> {
        let reference = &original.picture;
        let stood = !self.is_broken();
        let (error, broke) = self.subject.compare((view, frame), reference, picture)?;
        if let Some(broke) = broke.filter(|_| stood || self.unmet.is_some()) {
            let picture = broke.picture.as_ref().unwrap_or(picture);
            let session = self.subject.session();
            self.unmet = slivers::explain(session, &broke.promise, frame, [reference, picture]);
        }
        let is_headline = self.headline.as_ref() == Some(view);
        if is_headline {
            self.pictures = Pictures::new(&self.report.name, reference, picture);
        }
        let key = (error.flip_mean, error.changed_pixels);
        if key > self.worst.as_ref().map_or((0.0, 0), |w| w.0) {
            let pictures = match is_headline {
                // The headline's pictures are stored anyway.
                true => None,
                false => Pictures::new(&self.report.name, reference, picture),
            };
            let worst = pictures.map(|p| Worst {
                view: view.described(),
                error: error.clone(),
                original: p.original,
                variant: p.variant,
                difference: p.difference,
            });
            self.worst = Some((key, worst));
        }
        if self
            .headline
            .as_ref()
            .is_some_and(|h| h.camera != view.camera)
        {
            self.elsewhere.look(view, &error, original, picture);
        }
        self.report.by_view.push(ViewReport {
            camera: view.camera.clone(),
            frame: view.frame,
            order: view.order,
            error,
            time_ms: None,
            speedup: None,
            shaded_per_pixel: None,
        });
        Ok(())
    }

    /// Keeps which materials were drawn as written for their guards failed.
    fn aimed(&mut self, view: &View) {
        for (index, assumed) in self.subject.unguarded.drain(..) {
            let material = &self.subject.plans[index].material;
            let is_original = |k: &KeptMaterial| k.material == *material && k.without.is_none();
            if !self.report.kept.iter().any(is_original) {
                self.report.kept.push(KeptMaterial {
                    material: material.clone(),
                    without: None,
                    why: format!(
                        "its guard does not hold in {}: {assumed} was assumed",
                        view.described()
                    ),
                });
            }
        }
    }

    fn quit(&mut self, error: &Error) {
        self.counter = None;
        self.subject.quit(error);
    }
}

impl<'a> Measurement<'a> {
    /// Builds the pipelines of a variant. If that fails, the variant is not measured.
    ///
    /// # Errors
    ///
    /// The original cannot be built.
    pub(super) fn new(
        session: &'a Session<'a>,
        variant: &Variant,
        headline: Option<&View>,
    ) -> Result<(Self, Option<String>), Error> {
        let subject = Subject::new(session, variant.plans.clone());
        let mut drawn = Self {
            headline: headline.cloned(),
            counter: None,
            report: VariantReport {
                junctions: junctions(session.scene(), &variant.plans),
                kept: variant.kept.clone(),
                ..VariantReport::new(
                    &variant.name,
                    &variant.recipe,
                    subject.promise.contract.clone(),
                    subject.verdict.clone(),
                )
            },
            pictures: None,
            worst: None,
            elsewhere: OtherCameras::default(),
            aside: None,
            covered: None,
            empty: nothing_drawn(&variant.plans),
            unmet: None,
            subject,
        };
        if variant.is_refused() {
            // Its picture would equal the original's and prove nothing.
            drawn.subject.verdict = Verdict::NotMeasured {
                why: EVERY_REFUSES.to_owned(),
            };
            return Ok((drawn, None));
        }
        let lost = match drawn.build(session, variant) {
            Ok(()) => None,
            Err(error) if variant.name == ORIGINAL => return Err(error),
            Err(error) => {
                drawn.quit(&error);
                error.is_lost().then(|| error.to_string())
            }
        };
        Ok((drawn, lost))
    }

    fn build(&mut self, session: &'a Session<'a>, variant: &Variant) -> Result<(), Error> {
        let prepared = self.subject.build()?;
        let (pipelines, creation) = prepared.creation();
        let cost = Cost {
            pipelines,
            creation_ms: Some(creation.as_secs_f64() * 1e3),
            draw_calls: prepared.draw_calls(),
            target_bytes: prepared.target_bytes(),
            subdivision: prepared.subdivision_cost(),
            encode_ms: None,
            invocations: None,
        };
        let counter = Counter::shaded(session.inputs(), &variant.plans, session.form(), counting);
        self.counter = Some(counter?);
        self.report.cost = Some(cost);
        Ok(())
    }

    fn is_broken(&self) -> bool {
        matches!(self.subject.verdict, Verdict::Broken { .. })
    }

    /// Keeps its time in the view last compared.
    pub(super) fn timed(&mut self, timing: Timing, is_headline: bool) {
        if let Some(row) = self.report.by_view.last_mut() {
            row.time_ms = Some(timing.time.clone());
            row.speedup = Some(timing.speedup);
        }
        if is_headline {
            self.report.time_ms = Some(timing.time);
            self.report.speedup = Some(timing.speedup);
            if let Some(cost) = &mut self.report.cost {
                cost.encode_ms = Some(timing.encode_ms);
            }
        }
    }

    pub(super) fn count_invocations(&mut self, gpu: &Gpu) -> Result<(), Error> {
        if let (Some(prepared), Some(cost)) = (self.subject.prepared(), &mut self.report.cost) {
            cost.invocations = invocations(gpu, prepared)?;
        }
        Ok(())
    }

    /// Draws its shadow passes under the light and keeps the result.
    ///
    /// # Errors
    ///
    /// The adapter is lost.
    pub(super) fn measure_shadow(
        &mut self,
        session: &Session<'_>,
        variant: &Variant,
        settings: &Settings,
    ) -> Result<(), Error> {
        let invariant = variant
            .plans
            .iter()
            .filter(|p| shadow::has_shadow(p))
            .all(shadow::has_invariant_position);
        let verdict = match shadow::measure(session, variant, settings) {
            Ok(report) => self.report.shadow.insert(report).verdict(invariant),
            Err(error) if error.is_lost() => return Err(error),
            Err(error) => Verdict::NotMeasured {
                why: format!("its shadow pass: {}", error.reason()),
            },
        };
        self.judge_aside(verdict);
        Ok(())
    }

    /// Draws its auxiliary pictures and keeps the result.
    ///
    /// # Errors
    ///
    /// The adapter is lost.
    pub(super) fn measure_outputs(
        &mut self,
        session: &Session<'_>,
        variant: &Variant,
        settings: &Settings,
    ) -> Result<(), Error> {
        let drawn = variant.plans.iter().filter(|p| outputs::has_outputs(p));
        let invariant = drawn.into_iter().all(shadow::has_invariant_position);
        let scene = session.scene();
        let allows = |before: &Draw, now: &Draw| {
            outputs::allowed(scene, session.originals(), variant, before, now)
        };
        let earlier = outputs::earlier(scene, &allows);
        let measured = outputs::measure(session, &earlier, variant, settings);
        let drawn = Error::unless_lost(outputs::pictures(session, &earlier, variant))?;
        if let Some(pictures) = &mut self.pictures {
            pictures.outputs = drawn.unwrap_or_default();
        }
        let verdict = match measured {
            Ok(report) => self.report.outputs.insert(report).verdict(invariant),
            Err(error) if error.is_lost() => return Err(error),
            Err(error) => Verdict::NotMeasured {
                why: format!("its auxiliary pictures: {}", error.reason()),
            },
        };
        self.judge_aside(verdict);
        Ok(())
    }

    /// Keeps the worst verdict on passes outside of the frame.
    fn judge_aside(&mut self, verdict: Verdict) {
        let rank = |verdict: &Verdict| match verdict {
            Verdict::Broken { .. } => 2,
            Verdict::NotMeasured { .. } => 1,
            _ => 0,
        };
        if self
            .aside
            .as_ref()
            .is_none_or(|known| rank(known) < rank(&verdict))
        {
            self.aside = Some(verdict);
        }
    }

    /// Runs the self-tests of its plans. They do not affect the verdict: they are for hosts, which
    /// cannot compare with the original. `lost`: why there is no adapter any more.
    pub(super) fn run_self_tests(&mut self, session: &Session<'_>, lost: Option<&str>) {
        for plan in self.subject.plans.iter().filter(|p| p.self_test.is_some()) {
            let run = match lost {
                Some(why) => Err(why.to_owned()),
                None => {
                    self_test(session.inputs(), plan, session.form()).map_err(|e| e.to_string())
                }
            };
            let result = match run {
                Ok(None) => continue,
                Ok(Some(result)) => result,
                Err(why) => SelfTestResult::NotRun { why },
            };
            self.report.self_test.push(SelfTestReport {
                material: plan.material.clone(),
                result,
                fallback: plan.fallback.clone(),
            });
        }
    }
}
