//! A scene drawn with the original and its variants, view by view.

mod ended;

use std::cell::OnceCell;

use preshade_passes::contract::{Contract, Verdict};
use preshade_passes::plan::{GpuPass, Plan};

use super::elsewhere::{OtherCameras, Seen};
use super::shading::{CountProgram, Counter, Shading};
use super::statistics::invocations;
use super::telling::{self, Colours};
use super::verdict::{breaks, nothing_drawn};
use super::{Clock, Error, ErrorLadder, TimingSettings, compare, originals, shadow, time};
use crate::render::{
    FrameSettings, Gpu, Prepared, Rendered, SceneInputs, SelfTestResult, ShaderForm,
    Variant as HostVariant, order, self_test,
};
use crate::report::{
    Cost, Kept, ORIGINAL, Pictures, Report, SCHEMA, SelfTestReport, Unfinished, VariantReport,
    ViewReport, Worst,
};
use crate::scene::{DrawOrder, Frame, Scene, bind};

/// A variant to measure.
#[derive(Clone, Debug)]
pub struct Variant {
    /// Name, for the table and for files.
    pub name: String,
    /// The recipe, as it is written on a command line.
    pub recipe: String,
    /// One plan a material, in the scene's order.
    pub plans: Vec<Plan>,
    /// Materials it leaves alone.
    pub kept: Vec<Kept>,
}

/// Which views are timed. All views are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Timed {
    /// None.
    No,
    /// The first frame of the first camera, in the first order.
    #[default]
    Headline,
    /// The first frame of every camera, in every order.
    FirstFrames,
    /// Every frame of every camera, in every order.
    Everything,
}

/// How to measure.
pub struct Settings<'a> {
    /// The road shaders take to the driver.
    pub form: ShaderForm,
    /// Views to time.
    pub timed: Timed,
    /// How long and how often, for each timed view.
    pub timing: TimingSettings,
    /// At most so many frames of each camera are compared, evenly spaced from its first. A path has dozens.
    pub frames_per_camera: usize,
    /// What stands in for a pass's fragment stage while fragments are counted.
    pub count: &'a dyn Fn(&Plan, &GpuPass) -> CountProgram,
    /// The command to put into the report.
    pub command: String,
}

/// How far a measurement is.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// Part done, 0 to 1.
    pub done: f64,
    /// What is being done.
    pub what: String,
    /// What is measured, after each view; `None`: nothing more than before.
    pub so_far: Option<Box<Unfinished>>,
}

impl Progress {
    fn at(done: f64, what: impl Into<String>) -> Self {
        Self {
            done,
            what: what.into(),
            so_far: None,
        }
    }
}

/// What was measured, and the pictures of the headline view.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The figures.
    pub report: Report,
    /// Pictures of the variants that were drawn, without the original.
    pub pictures: Vec<Pictures>,
    /// Why measuring ended before the last view, with the adapter lost; `None`: it did not.
    pub lost: Option<String>,
}

/// A camera's frame in one order.
#[derive(Clone, Copy)]
struct View<'s> {
    camera: &'s str,
    index: usize,
    frame: &'s Frame,
    order: DrawOrder,
    first_frame: bool,
    headline: bool,
}

/// A variant on its way.
struct Subject<'a> {
    prepared: Option<Prepared<'a>>,
    /// Its plans.
    plans: Vec<Plan>,
    /// What is drawn where guards do not hold: the plans, by index, that are drawn as their author wrote them.
    fallback: Option<(Vec<usize>, Prepared<'a>)>,
    counter: Option<Counter<'a>>,
    report: VariantReport,
    pictures: Option<Pictures>,
    /// The largest error yet, by mean FLIP and then by changed pixels, and its pictures unless it is the headline's.
    worst: Option<((f64, u64), Option<Worst>)>,
    /// What the cameras but the headline's see of it.
    elsewhere: OtherCameras,
    /// First view that broke the contract.
    broken: Option<String>,
    /// What drawing its shadow passes under the light says; `None`: it has none, or they were not drawn yet.
    shadow: Option<Verdict>,
    /// Pixels with anything opaque in them, over the views counted.
    covered: Option<u64>,
    /// What to say of a picture with nothing in it; `None` where blended draws, which are not counted, may be in it.
    empty: Option<String>,
}

/// Draws every view of `scene` with the original and with `variants`, compares, counts and times them.
///
/// A variant that does not compile, or with which the adapter is lost, is [`Verdict::NotMeasured`]; what was measured of the others stands.
///
/// # Errors
/// When the original itself cannot be drawn.
pub fn verify(
    gpu: &Gpu,
    scene: &Scene,
    variants: &[Variant],
    settings: &Settings<'_>,
    progress: &mut dyn FnMut(Progress),
) -> Result<Outcome, Error> {
    progress(Progress::at(0.0, "uploading the scene"));
    let inputs = SceneInputs::new(gpu, scene)?;
    let original = Variant {
        name: ORIGINAL.to_owned(),
        recipe: String::new(),
        plans: originals(scene),
        kept: Vec::new(),
    };
    let mut subjects = Vec::new();
    for (i, variant) in std::iter::once(&original).chain(variants).enumerate() {
        let done = 0.1 * i as f64 / (variants.len() + 1) as f64;
        progress(Progress::at(done, format!("compiling `{}`", variant.name)));
        subjects.push(Subject::new(&inputs, variant, settings, i == 0)?);
    }
    let mut ties = Counter::ties(
        &inputs,
        &original.plans,
        settings.form,
        super::Discarded::LeftOut,
        settings.count,
    )?;
    let views = views(scene, settings);
    let mut clock = None;
    let mut depth_ties = Some(0);
    let mut colours = Colours::default();
    let mut lost = None;
    for (i, view) in views.iter().enumerate() {
        let at = |part: f64, what: String| {
            Progress::at(0.1 + 0.9 * (i as f64 + part) / views.len() as f64, what)
        };
        progress(at(0.0, view.to_string()));
        let mut measure = || -> Result<(), Error> {
            if view.order == views[0].order {
                inputs.set_frame(view.frame)?;
                let n = ties.ties_in(view.frame, view.order)?;
                depth_ties = depth_ties.map(|sum| sum + n);
            }
            inputs.set_frame(view.frame)?;
            let reference =
                compare_view(&inputs, &mut subjects, view, views[0].camera, settings.form)?;
            reference.iter().for_each(|r| colours.look(r));
            count_view(&mut subjects, view)?;
            if view.headline {
                for subject in &mut subjects {
                    subject.count_invocations(gpu)?;
                }
            }
            if settings.timed.includes(view) {
                let tick = |part: f64| {
                    progress(at(0.5 + 0.5 * part, format!("timing {view}")));
                };
                clock = Some(time_view(&inputs, &mut subjects, view, settings, tick)?);
            }
            Ok(())
        };
        if let Err(error) = measure() {
            // Without the original there is nothing to compare with, and a lost adapter draws no more.
            lost = Some(error.to_string());
            break;
        }
        let missing: Vec<String> = views[i + 1..].iter().map(View::to_string).collect();
        let measured = Report {
            clock,
            variants: subjects.iter().map(Subject::so_far).collect(),
            ..blank(gpu, scene, settings)
        };
        progress(Progress {
            so_far: Some(Box::new(Unfinished::new(measured, missing))),
            ..at(1.0, view.to_string())
        });
    }
    for (subject, variant) in subjects.iter_mut().skip(1).zip(variants) {
        if lost.is_none() && variant.plans.iter().any(shadow::has_shadow) {
            let what = format!("`{}` under the light", variant.name);
            progress(Progress::at(1.0 - f64::EPSILON, what));
            subject.measure_shadow(gpu, scene, variant, settings);
        }
        subject.run_self_tests(&inputs, variant, settings, lost.as_deref());
    }
    let assumed = bind::guessed(scene);
    let nothing = subjects.iter().all(|s| s.covered.unwrap_or(0) == 0);
    let mut warnings: Vec<String> = telling::missing_attributes(&assumed).into_iter().collect();
    // Of pictures with nothing in them the verdicts say more.
    warnings.extend(colours.warning().filter(|_| !nothing));
    let frames: Vec<_> = views.iter().map(|v| (v.frame, v.order)).collect();
    let (plans, count) = (&original.plans, settings.count);
    let away = nothing
        && lost.is_none()
        && telling::faces_away(&inputs, plans, settings.form, count, &frames).unwrap_or(false);
    let mut report = Report {
        clock,
        depth_ties: depth_ties.filter(|_| lost.is_none()),
        assumed,
        warnings,
        ..blank(gpu, scene, settings)
    };
    let mut pictures = Vec::new();
    for subject in subjects {
        let (variant, picture) = subject.finish(gpu, lost.as_deref(), away);
        report.variants.push(variant);
        pictures.extend(picture);
    }
    progress(Progress::at(1.0, "done"));
    Ok(Outcome {
        report,
        pictures,
        lost,
    })
}

/// A report of nothing yet.
fn blank(gpu: &Gpu, scene: &Scene, settings: &Settings<'_>) -> Report {
    Report {
        schema: SCHEMA.to_owned(),
        scene: scene.name.clone(),
        resolution: scene.size,
        samples: scene.samples,
        command: settings.command.clone(),
        adapter: gpu.adapter().clone(),
        clock: None,
        depth_ties: None,
        assumed: Vec::new(),
        warnings: Vec::new(),
        variants: Vec::new(),
        sweeps: Vec::new(),
        chosen: None,
    }
}

fn views<'s>(scene: &'s Scene, settings: &Settings<'_>) -> Vec<View<'s>> {
    let orders = match scene.orders.as_slice() {
        [] => &[DrawOrder::AsGiven],
        orders => orders,
    };
    let mut views = Vec::new();
    for camera in &scene.cameras {
        let frames = camera.frames.len();
        let taken = frames.min(settings.frames_per_camera.max(1));
        for i in 0..taken {
            let index = i * frames / taken;
            for order in orders {
                views.push(View {
                    camera: &camera.name,
                    index,
                    frame: &camera.frames[index],
                    order: *order,
                    first_frame: i == 0,
                    headline: views.is_empty(),
                });
            }
        }
    }
    views
}

impl std::fmt::Display for View<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "camera `{}` frame {} {}",
            self.camera,
            self.index,
            order::name(self.order)
        )
    }
}

impl Timed {
    fn includes(self, view: &View<'_>) -> bool {
        match self {
            Self::No => false,
            Self::Headline => view.headline,
            Self::FirstFrames => view.first_frame,
            Self::Everything => true,
        }
    }
}

/// Draws the view with every subject and compares each with the first, whose picture is given back. `headline` is the camera of the first view.
fn compare_view<'a>(
    inputs: &'a SceneInputs<'a>,
    subjects: &mut [Subject<'a>],
    view: &View<'_>,
    headline: &str,
    form: ShaderForm,
) -> Result<Option<Rendered>, Error> {
    let [original, variants @ ..] = subjects else {
        return Ok(None);
    };
    let Some(reference) = original.draw(inputs, view, form)? else {
        return Ok(None);
    };
    // The original's picture, which all that show this view share.
    let shown = OnceCell::new();
    // The original again: an adapter that does not repeat itself proves nothing.
    if view.headline
        && let Some(again) = original.draw(inputs, view, form)?
    {
        let seen = Seen {
            reference: &reference,
            shown: &shown,
            picture: &again,
        };
        original.compare(view, headline, seen)?;
    } else {
        original.add_view(view, ErrorLadder::default());
    }
    for variant in variants {
        match variant.draw(inputs, view, form) {
            Ok(Some(picture)) => {
                let seen = Seen {
                    reference: &reference,
                    shown: &shown,
                    picture: &picture,
                };
                if let Err(error) = variant.compare(view, headline, seen) {
                    variant.give_up(&error);
                }
            }
            Ok(None) => {}
            Err(error @ Error::Render(crate::render::Error::Lost(_))) => return Err(error),
            Err(error) => variant.give_up(&error),
        }
    }
    Ok(Some(reference))
}

/// Counts what every subject shades in this view.
fn count_view(subjects: &mut [Subject<'_>], view: &View<'_>) -> Result<(), Error> {
    let mut before: Option<Shading> = None;
    for subject in subjects {
        let Some(counter) = &mut subject.counter else {
            continue;
        };
        let shading = match counter.count(view.frame, view.order) {
            Ok(shading) => shading,
            Err(error @ Error::Render(crate::render::Error::Lost(_))) => return Err(error),
            Err(error) => {
                subject.give_up(&error);
                continue;
            }
        };
        *subject.covered.get_or_insert(0) += shading.covered;
        let per_pixel = Some(shading.summary().per_pixel);
        if let Some(row) = subject.report.by_view.last_mut() {
            row.shaded_per_pixel = per_pixel;
        }
        if view.headline {
            subject.report.shaded_per_pixel = per_pixel;
            if let Some(pictures) = &mut subject.pictures {
                pictures.overdraw_before = before.clone();
                pictures.overdraw_after = Some(shading.clone());
            }
        }
        before.get_or_insert(shading);
    }
    Ok(())
}

fn time_view<'a>(
    inputs: &'a SceneInputs<'a>,
    subjects: &mut [Subject<'a>],
    view: &View<'_>,
    settings: &Settings<'_>,
    tick: impl FnMut(f64),
) -> Result<Clock, Error> {
    let mut ready = Vec::new();
    let mut rows = Vec::new();
    for (i, subject) in subjects.iter_mut().enumerate() {
        if let Some(prepared) = subject.aimed(inputs, view, settings.form)? {
            ready.push(prepared);
            rows.push(i);
        }
    }
    let (clock, timings) = time(inputs.gpu(), &ready, &settings.timing, tick)?;
    for (i, timing) in rows.into_iter().zip(timings) {
        let report = &mut subjects[i].report;
        if let Some(row) = report.by_view.last_mut() {
            row.time_ms = Some(timing.time.clone());
            row.speedup = Some(timing.speedup);
        }
        if view.headline {
            report.time_ms = Some(timing.time);
            report.speedup = Some(timing.speedup);
            if let Some(cost) = &mut report.cost {
                cost.encode_ms = Some(timing.encode_ms);
            }
        }
    }
    Ok(clock)
}

impl<'a> Subject<'a> {
    /// Builds the pipelines of a variant. A failure is its verdict, or the error of all when it is the original.
    fn new(
        inputs: &'a SceneInputs<'a>,
        variant: &Variant,
        settings: &Settings<'_>,
        is_original: bool,
    ) -> Result<Self, Error> {
        let contract = variant
            .plans
            .iter()
            .fold(Contract::exact(), |c, plan| c.and(plan.contract.clone()));
        let mut subject = Self {
            prepared: None,
            plans: variant.plans.clone(),
            fallback: None,
            counter: None,
            report: VariantReport {
                name: variant.name.clone(),
                recipe: variant.recipe.clone(),
                contract,
                verdict: Verdict::NotMeasured {
                    why: "nothing was drawn".to_owned(),
                },
                error: None,
                time_ms: None,
                speedup: None,
                shaded_per_pixel: None,
                cost: None,
                shadow: None,
                self_test: Vec::new(),
                junctions: super::junctions(inputs.scene(), &variant.plans),
                kept: variant.kept.clone(),
                by_path: Vec::new(),
                by_view: Vec::new(),
            },
            pictures: None,
            worst: None,
            elsewhere: OtherCameras::default(),
            broken: None,
            shadow: None,
            covered: None,
            empty: nothing_drawn(&variant.plans),
        };
        let built = || -> Result<_, Error> {
            let host = HostVariant::new(&variant.plans, settings.form)?;
            let frame = FrameSettings::of(inputs.scene());
            let prepared = Prepared::new(inputs, &host, &frame)?;
            let counter = Counter::shaded(inputs, &variant.plans, settings.form, settings.count)?;
            Ok((prepared, counter))
        };
        if !variant.plans.is_empty() && variant.kept.len() == variant.plans.len() {
            // Its picture is the original's, which says nothing of the recipe.
            subject.report.verdict = Verdict::NotMeasured {
                why: "every material refuses it".to_owned(),
            };
            return Ok(subject);
        }
        match built() {
            Ok((prepared, counter)) => {
                let (pipelines, creation) = prepared.creation();
                subject.report.cost = Some(Cost {
                    pipelines,
                    creation_ms: creation.as_secs_f64() * 1e3,
                    draw_calls: prepared.draw_calls(),
                    target_bytes: prepared.target_bytes(),
                    subdivision: prepared.subdivision_cost(),
                    encode_ms: None,
                    invocations: None,
                });
                subject.prepared = Some(prepared);
                subject.counter = Some(counter);
            }
            Err(error) if is_original => return Err(error),
            Err(error) => subject.give_up(&error),
        }
        Ok(subject)
    }

    fn draw(
        &mut self,
        inputs: &'a SceneInputs<'a>,
        view: &View<'_>,
        form: ShaderForm,
    ) -> Result<Option<Rendered>, Error> {
        let Some(prepared) = self.aimed(inputs, view, form)? else {
            return Ok(None);
        };
        Ok(Some(prepared.render()?))
    }

    /// What draws this view, as a host would choose it: the variant, or where a guard does not hold the author's own for that material.
    fn aimed(
        &mut self,
        inputs: &'a SceneInputs<'a>,
        view: &View<'_>,
        form: ShaderForm,
    ) -> Result<Option<&Prepared<'a>>, Error> {
        let Some(prepared) = &mut self.prepared else {
            return Ok(None);
        };
        let violated = inputs.violated(&self.plans, view.frame)?;
        if violated.is_empty() {
            prepared.aim(view.frame, view.order);
            return Ok(Some(prepared));
        }
        for (index, assumed) in &violated {
            let material = &self.plans[*index].material;
            if !self.report.kept.iter().any(|k| k.material == *material) {
                self.report.kept.push(Kept {
                    material: material.clone(),
                    why: format!("its guard does not hold in {view}: {assumed} was assumed"),
                });
            }
        }
        let indices: Vec<usize> = violated.iter().map(|(i, _)| *i).collect();
        let fallback = match self.fallback.take() {
            Some((of, prepared)) if of == indices => (of, prepared),
            _ => {
                let plans = self.plans.iter().enumerate().map(|(i, plan)| {
                    let original = plan.original.as_deref().filter(|_| indices.contains(&i));
                    original.unwrap_or(plan).clone()
                });
                let plans: Vec<Plan> = plans.collect();
                let host = HostVariant::new(&plans, form)?;
                let frame = FrameSettings::of(inputs.scene());
                (indices, Prepared::new(inputs, &host, &frame)?)
            }
        };
        let (_, prepared) = self.fallback.insert(fallback);
        prepared.aim(view.frame, view.order);
        Ok(Some(prepared))
    }

    fn compare(&mut self, view: &View<'_>, headline: &str, seen: Seen<'_>) -> Result<(), Error> {
        let (reference, picture) = (seen.reference, seen.picture);
        let error = compare(reference, picture)?;
        if self.broken.is_none() {
            self.broken = breaks(&self.report.contract, &error).map(|how| format!("{view}: {how}"));
        }
        if view.headline {
            self.pictures = Pictures::new(&self.report.name, reference, picture);
        }
        let key = (error.flip_mean, error.changed_pixels);
        if key > self.worst.as_ref().map_or((0.0, 0), |w| w.0) {
            let pictures = match view.headline {
                // Those are kept anyway.
                true => None,
                false => Pictures::new(&self.report.name, reference, picture),
            };
            let worst = pictures.map(|p| Worst {
                view: view.to_string(),
                error: error.clone(),
                original: p.original,
                variant: p.variant,
                difference: p.difference,
            });
            self.worst = Some((key, worst));
        }
        if view.camera != headline {
            let name = view.to_string();
            self.elsewhere.look(view.camera, name, &error, seen);
        }
        self.add_view(view, error);
        Ok(())
    }

    fn add_view(&mut self, view: &View<'_>, error: ErrorLadder) {
        let worst = match &self.report.error {
            Some(worst) => worst.worst(&error),
            None => error.clone(),
        };
        self.report.error = Some(worst);
        self.report.by_view.push(ViewReport {
            camera: view.camera.to_owned(),
            frame: view.index,
            order: view.order,
            error,
            time_ms: None,
            speedup: None,
            shaded_per_pixel: None,
        });
    }

    fn count_invocations(&mut self, gpu: &Gpu) -> Result<(), Error> {
        if let (Some(prepared), Some(cost)) = (&self.prepared, &mut self.report.cost) {
            cost.invocations = invocations(gpu, prepared)?;
        }
        Ok(())
    }

    /// Draws its shadow passes under the light, and keeps what that says.
    fn measure_shadow(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        variant: &Variant,
        settings: &Settings<'_>,
    ) {
        let invariant = variant
            .plans
            .iter()
            .filter(|p| shadow::has_shadow(p))
            .all(shadow::has_invariant_position);
        self.shadow = Some(match shadow::measure(gpu, scene, variant, settings) {
            Ok(report) => self.report.shadow.insert(report).verdict(invariant),
            Err(error) => Verdict::NotMeasured {
                why: format!("its shadow pass: {error}"),
            },
        });
    }

    /// Runs the self-tests of its plans. What they say is no verdict: they are for hosts, which have no original to compare with. `lost` says why there
    /// is no adapter any more.
    fn run_self_tests(
        &mut self,
        inputs: &SceneInputs<'_>,
        variant: &Variant,
        settings: &Settings<'_>,
        lost: Option<&str>,
    ) {
        for plan in variant.plans.iter().filter(|p| p.self_test.is_some()) {
            let run = match lost {
                Some(why) => Err(why.to_owned()),
                None => self_test(inputs, plan, settings.form).map_err(|e| e.to_string()),
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

    /// Draws it no more.
    fn give_up(&mut self, error: &Error) {
        self.prepared = None;
        self.counter = None;
        self.report.verdict = Verdict::NotMeasured {
            why: error.to_string(),
        };
    }
}
