//! Candidates applied, drawn for their error, and raced for their time.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;

use super::arena::{Arena, Contender, LEAST_RACING};
use super::journal::{self, Journal, Known};
use super::predict::{Prediction, Predictor, hopeless};
use super::space::Candidate;
use super::watch::Watch;
use super::{Fate, SearchStage, Settings};
use crate::measure::error::counted;
use crate::measure::record::ORIGINAL;
use crate::measure::{self, Error, ErrorLadder, Session, TimingSettings, verdict};
use preshade_draw::render::{Prepared, Rendered};
use preshade_draw::scene::{DrawOrder, Frame};

/// The part of the time by which each stage ends. Verification gets the rest.
pub(super) const FREQUENCIES_BY: f64 = 0.25;
pub(super) const SEEDS_BY: f64 = 0.6;
pub(super) const CROSSED_BY: f64 = 0.75;

/// Samples in the first rung of a race; each rung has twice those of the one before.
pub(super) const FIRST_RUNG: usize = 6;

pub(super) const RUNGS: u32 = 3;

/// A candidate that takes so many times the original's time at first sight is not timed again.
pub(super) const TOO_SLOW: f64 = 3.0;

/// Frames shorter than so many milliseconds of wall-clock time are mostly submission overhead.
pub(super) const DEAR: f64 = 50.0;

/// How long a submission should take where an adapter draws several frames in one.
pub(super) const SUBMISSION: Duration = Duration::from_millis(6);

/// Ways of each kind that are crossed.
pub(super) const MOST_CROSSED: usize = 4;

/// Everything that all candidates share.
pub(super) struct Search<'a> {
    pub(super) session: &'a Session<'a>,
    /// The scene with fewer pixels, for errors.
    pub(super) drafts: &'a Session<'a>,
    pub(super) facts: &'a Facts,
    pub(super) settings: &'a Settings,
    pub(super) subject: String,
    /// The first frame is timed.
    pub(super) frames: Vec<&'a Frame>,
    /// The frames that errors are compared on.
    pub(super) draft_frames: Vec<&'a Frame>,
}

impl<'a> Search<'a> {
    pub(super) fn order(&self) -> DrawOrder {
        let first = self.session.scene().orders.first();
        first.copied().unwrap_or(DrawOrder::AsGiven)
    }

    /// Draws the frames that errors are compared on.
    pub(super) fn pictures(&self, plans: &[Plan]) -> Result<Vec<Rendered>, Error> {
        let order = self.order();
        Ok(self.drafts.pictures(plans, &self.draft_frames, order)?)
    }

    /// Aims at the headline view.
    pub(super) fn aim(&self, prepared: &mut Prepared<'a>) -> Result<(), Error> {
        if let Some(frame) = self.frames.first() {
            self.session.inputs().set_frame(frame)?;
            prepared.aim(frame, self.order());
        }
        Ok(())
    }

    /// Milliseconds of one frame by the wall clock.
    pub(super) fn glance(&self, prepared: &mut Prepared<'a>) -> Result<f64, Error> {
        self.aim(prepared)?;
        let start = Instant::now();
        prepared.draw()?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    /// Applies candidates. Leaves out refused ones, those with the text of another, and hopeless
    /// ones.
    pub(super) fn admit(
        &self,
        arena: &mut Arena<'a>,
        candidates: Vec<Candidate>,
        by: f64,
        watch: &mut Watch<'_>,
    ) {
        let predictor = Predictor::new(self.session.originals(), self.facts, self.settings.metric);
        let predictions: Vec<Option<Prediction>> =
            candidates.iter().map(|c| predictor.of(c)).collect();
        let mut keys: BTreeMap<String, String> = arena
            .contenders
            .iter()
            .filter_map(|c| Some((c.key.clone()?, c.point.name.clone())))
            .collect();
        keys.extend(
            journal::content(&self.subject, self.session.originals())
                .map(|k| (k, ORIGINAL.to_owned())),
        );
        let mut admitted = Vec::new();
        let mut refused: Vec<Candidate> = Vec::new();
        let mut kept = Vec::new();
        let mut late = Vec::new();
        for (candidate, prediction) in candidates.into_iter().zip(predictions) {
            // If rewriting takes long, the remaining candidates are skipped.
            if watch.left(by).is_zero() && kept.len() >= LEAST_RACING {
                watch.late = true;
                late.push((candidate, prediction));
                continue;
            }
            // An extension of a refused recipe is refused for the same reason and not listed.
            if refused.iter().any(|r| candidate.stands_on(r)) {
                continue;
            }
            let variant = measure::variant(self.session.originals(), &candidate.recipe, self.facts);
            if variant.is_incomplete() {
                refused.push(candidate.clone());
            }
            kept.push((candidate, prediction, variant));
        }
        // A refused recipe beats nothing.
        let known: Vec<Prediction> = kept
            .iter()
            .filter_map(|(_, p, v)| p.filter(|_| !v.is_incomplete()))
            .collect();
        for (candidate, prediction, variant) in kept {
            let is_refused = variant.is_incomplete();
            let key = journal::content(&self.subject, &variant.plans);
            let same = key.as_ref().and_then(|k| keys.get(k));
            let hopeless = || hopeless(prediction?, &known, self.settings.budget);
            let fate = match (is_refused, same, &key) {
                (true, ..) => Some(Fate::Refused {
                    why: variant
                        .kept
                        .first()
                        .map_or_else(String::new, |k| k.why.clone()),
                }),
                (_, _, None) => Some(Fate::NotMeasured {
                    why: "its shaders cannot be written as WGSL".to_owned(),
                }),
                (_, Some(name), _) => Some(Fate::Same { r#as: name.clone() }),
                _ => hopeless().map(|why| Fate::Predicted { why }),
            };
            if let (None, Some(key)) = (&fate, &key) {
                keys.insert(key.clone(), variant.name.clone());
            }
            admitted.push(Contender::new(candidate, prediction, variant, key, fate));
        }
        arena.contenders.extend(admitted);
        let unwritten = late.into_iter().map(|(candidate, prediction)| {
            let variant = measure::unwritten(&candidate.recipe);
            let why = "there was no time left to rewrite it".to_owned();
            let fate = Some(Fate::NotMeasured { why });
            Contender::new(candidate, prediction, variant, None, fate)
        });
        arena.contenders.extend(unwritten);
    }

    /// The order of drawing: first candidates without a prediction, then the predicted frontier,
    /// then the frontier of the rest, and so on.
    pub(super) fn sequence(arena: &Arena<'_>) -> Vec<usize> {
        let waiting = |i: &usize| {
            let c = &arena.contenders[*i];
            c.alive && c.point.error.is_none()
        };
        let all: Vec<usize> = (0..arena.contenders.len()).filter(waiting).collect();
        let predicted = |i: usize| arena.contenders[i].point.prediction;
        let mut sequence: Vec<usize> = all
            .iter()
            .copied()
            .filter(|i| predicted(*i).is_none())
            .collect();
        let mut rest: Vec<(usize, Prediction)> = all
            .iter()
            .filter_map(|i| Some((*i, predicted(*i)?)))
            .collect();
        while !rest.is_empty() {
            let beaten = |p: &Prediction| {
                rest.iter().any(|(_, q)| {
                    q.error <= p.error && q.work <= p.work && (q.error < p.error || q.work < p.work)
                })
            };
            let (layer, under): (Vec<_>, Vec<_>) = rest.iter().partition(|(_, p)| !beaten(p));
            sequence.extend(layer.iter().map(|(i, _)| i));
            rest = under;
        }
        sequence
    }

    /// Draws each waiting candidate, compares it with the original, and estimates its time.
    pub(super) fn draw(
        &self,
        arena: &mut Arena<'a>,
        journal: &mut Journal,
        by: f64,
        watch: &mut Watch<'_>,
    ) {
        let sequence = Self::sequence(arena);
        let count = sequence.len();
        for i in &sequence {
            let contender = &arena.contenders[*i];
            if let Some(key) = &contender.key {
                journal.plan(key, &contender.point.name);
            }
        }
        for (done, i) in sequence.into_iter().enumerate() {
            watch.at(
                SearchStage::Drawing,
                format!(
                    "drawing {} of {count}: {}",
                    done + 1,
                    arena.contenders[i].point.name
                ),
            );
            // Draw a few as long as there is any time, or there is no result at all.
            let few = arena.drawn < LEAST_RACING && !watch.left(1.0).is_zero();
            if watch.going_on(by).is_break() && (!few || watch.over().is_some()) {
                let why = watch.over().unwrap_or("there was no time left to draw it");
                arena.contenders[i].out(Fate::NotMeasured {
                    why: why.to_owned(),
                });
                continue;
            }
            if arena.drawn >= self.settings.most {
                let why = format!("{} others were drawn before it", arena.drawn);
                arena.contenders[i].out(Fate::NotMeasured { why });
                continue;
            }
            let key = arena.contenders[i].key.clone().unwrap_or_default();
            if !journal.begin(&key) {
                let why = "a search ended twice while it was drawn".to_owned();
                arena.contenders[i].out(Fate::NotMeasured { why });
                continue;
            }
            arena.drawn += 1;
            let drawn = self.draw_one(arena, i, journal);
            // A drawing that lost the device did not complete.
            if !matches!(&drawn, Err(Error::Render(error)) if error.is_lost()) {
                journal.end(&key);
            }
            if let Err(error) = drawn {
                let why = error.reason();
                arena.contenders[i].out(Fate::NotMeasured { why });
                watch.lost(&error);
            }
        }
        watch.forgive();
    }

    pub(super) fn draw_one(
        &self,
        arena: &mut Arena<'a>,
        i: usize,
        journal: &mut Journal,
    ) -> Result<(), Error> {
        let start = Instant::now();
        let contender = &mut arena.contenders[i];
        let key = contender.key.clone().unwrap_or_default();
        let known = journal.get(&key).cloned().unwrap_or_default();
        let error = match known.error {
            Some(error) => error,
            None => {
                let start = Instant::now();
                let drawn = self.pictures(&contender.variant.plans)?;
                let worst = ErrorLadder::worst_of(&arena.references, &drawn)?;
                arena.compared.0 += start.elapsed();
                arena.compared.1 += drawn.len() as u32;
                let entry = Known {
                    error: Some(worst.clone()),
                    ..Known::default()
                };
                journal.add(&key, entry);
                worst
            }
        };
        contender.point.error = Some(error.clone());
        let broken = verdict::Promise::of(&contender.variant.plans).broken(&error);
        let broken = broken.or_else(|| {
            (error.nan_pixels > 0)
                .then(|| format!("NaN or infinite: {}", counted(error.nan_pixels, "pixel")))
        });
        if let Some(why) = broken {
            contender.out(Fate::Broken { why });
            return Ok(());
        }
        contender.timed(&known.ratios, &known.times, self.settings.seed);
        let mut prepared = self.session.prepare(&contender.variant.plans)?;
        // The first frame compiles and uploads, so take the shorter of two.
        let glance = self.glance(&mut prepared)?.min(self.glance(&mut prepared)?);
        contender.sight = glance;
        contender.spent = start.elapsed();
        if glance > DEAR && glance > TOO_SLOW * arena.first_sight {
            let times = glance / arena.first_sight;
            contender.out(Fate::Slow { times });
            return Ok(());
        }
        contender.prepared = Some(prepared);
        Ok(())
    }

    /// Times all racing candidates against the original, in rungs, and drops beaten ones after
    /// each.
    pub(super) fn race(
        &self,
        arena: &mut Arena<'a>,
        journal: &mut Journal,
        by: f64,
        watch: &mut Watch<'_>,
    ) {
        for rung in 0..RUNGS {
            watch.at(SearchStage::Racing, "timing");
            let racing: Vec<usize> = (0..arena.contenders.len())
                .filter(|i| arena.contenders[*i].alive && arena.contenders[*i].prepared.is_some())
                .collect();
            // The first rung runs even late: without times there is no result.
            let late = watch.going_on(by).is_break() && rung > 0;
            if racing.is_empty() || late || watch.over().is_some() {
                break;
            }
            let Some((racing, samples)) = arena.fitting(racing, FIRST_RUNG << rung, watch.left(by))
            else {
                break;
            };
            if let Err(error) = self.rung(arena, &racing, samples, journal, watch) {
                watch.lost(&error);
                break;
            }
            arena.drop_beaten(self.settings.metric);
        }
        watch.forgive();
        let why = watch.over().unwrap_or("its time was not measured");
        for contender in &mut arena.contenders {
            if contender.alive && contender.point.speedup.is_none() {
                contender.out(Fate::NotMeasured {
                    why: why.to_owned(),
                });
            }
        }
    }

    pub(super) fn rung(
        &self,
        arena: &mut Arena<'a>,
        racing: &[usize],
        samples: usize,
        journal: &mut Journal,
        watch: &mut Watch<'_>,
    ) -> Result<(), Error> {
        self.aim(&mut arena.original)?;
        for i in racing {
            if let Some(prepared) = &mut arena.contenders[*i].prepared {
                self.aim(prepared)?;
            }
        }
        let against: Vec<&Prepared<'a>> = std::iter::once(&arena.original)
            .chain(
                racing
                    .iter()
                    .filter_map(|i| arena.contenders[*i].prepared.as_ref()),
            )
            .collect();
        let timing = TimingSettings {
            budget: Duration::ZERO,
            min_samples: samples,
            max_samples: samples,
            submission: SUBMISSION,
            deadline: Some(watch.deadline()),
            seed: self.settings.seed,
        };
        let (_, timings) = measure::time(self.session.gpu(), &against, &timing, |_| {
            watch.at(
                SearchStage::Racing,
                format!("timing {} variants", racing.len()),
            );
        })?;
        for (i, timing) in racing.iter().zip(&timings[1..]) {
            let contender = &mut arena.contenders[*i];
            contender.timed(&timing.ratios, &timing.time.samples, self.settings.seed);
            let entry = Known {
                error: None,
                ratios: timing.ratios.clone(),
                times: timing.time.samples.clone(),
            };
            journal.add(contender.key.as_deref().unwrap_or_default(), entry);
        }
        Ok(())
    }
}
