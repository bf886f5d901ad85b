//! The plans of a frame, drawn against the original and checked by their contract.

use preshade_plan::contract::Verdict;
use preshade_plan::guard::Assumed;
use preshade_plan::plan::Plan;

use super::promises_by_material::{Broke, Group};
use super::verdict::Promise;
use super::{Error, ErrorLadder, Session, View, compare};
use preshade_draw::render::{self, Prepared, Rendered};
use preshade_draw::scene::{DrawOrder, Frame};

/// The plans of a frame, one a material, with everything that drawing them needs.
pub struct Subject<'a> {
    session: &'a Session<'a>,
    /// The plans, in the scene's order of materials.
    pub plans: Vec<Plan>,
    /// The promise of all plans together.
    pub promise: Promise,
    /// Promises of groups of materials, where they differ from that of all.
    groups: Vec<Group<'a>>,
    /// The promise that the verdict is about: another one if it is broken for some materials alone.
    pub judged: Promise,
    /// Whether the pictures so far keep the contract.
    pub verdict: Verdict,
    /// The worst difference of all pictures so far; `None`: nothing was compared.
    pub error: Option<ErrorLadder>,
    /// Materials drawn as written because their guard failed, with the failed assumption.
    pub unguarded: Vec<(usize, Assumed)>,
    /// Whether some view was drawn with a plan that a pass made.
    pub is_exercised: bool,
    prepared: Option<Prepared<'a>>,
    /// The materials whose guards failed last, and the frame that draws these as written.
    fallback: Option<(Vec<usize>, Prepared<'a>)>,
}

impl<'a> Subject<'a> {
    /// A frame of `plans`, not yet built.
    pub fn new(session: &'a Session<'a>, plans: Vec<Plan>) -> Self {
        let promise = Promise::of(&plans);
        Self {
            session,
            groups: Group::of(&plans),
            judged: promise.clone(),
            promise,
            plans,
            verdict: Verdict::NotMeasured {
                why: "nothing was drawn".to_owned(),
            },
            error: None,
            unguarded: Vec::new(),
            is_exercised: false,
            prepared: None,
            fallback: None,
        }
    }

    pub fn build(&mut self) -> Result<&Prepared<'a>, render::Error> {
        let prepared = self.session.prepare(&self.plans)?;
        Ok(self.prepared.insert(prepared))
    }

    /// The session that it is drawn in.
    pub fn session(&self) -> &'a Session<'a> {
        self.session
    }

    /// The built frame; `None`: it cannot be drawn.
    pub fn prepared(&self) -> Option<&Prepared<'a>> {
        self.prepared.as_ref()
    }

    /// Whether it can be drawn and has not broken its contract so far.
    pub fn is_standing(&self) -> bool {
        self.prepared.is_some() && !matches!(self.verdict, Verdict::Broken { .. })
    }

    /// Stops drawing it, with the verdict so far.
    pub(crate) fn stop(&mut self) {
        self.prepared = None;
    }

    /// Stops drawing it. A broken contract stays broken.
    pub fn quit(&mut self, error: &Error) {
        self.prepared = None;
        if !matches!(self.verdict, Verdict::Broken { .. }) {
            self.verdict = Verdict::NotMeasured {
                why: error.reason(),
            };
        }
    }

    /// The frame aimed at a view, as a host draws it: materials with failing guards are drawn as
    /// written. `None`: it cannot be drawn.
    pub fn aimed(
        &mut self,
        frame: &Frame,
        order: DrawOrder,
    ) -> Result<Option<&Prepared<'a>>, Error> {
        let Some(prepared) = &mut self.prepared else {
            return Ok(None);
        };
        let failed = self.session.inputs().violated(&self.plans, frame)?;
        let is_drawn = |i: usize, plan: &Plan| {
            !plan.steps.is_empty() && failed.iter().all(|(index, _)| *index != i)
        };
        let mut plans = self.plans.iter().enumerate();
        self.is_exercised |= plans.any(|(i, plan)| is_drawn(i, plan));
        if failed.is_empty() {
            prepared.aim(frame, order);
            return Ok(Some(prepared));
        }
        let indices: Vec<usize> = failed.iter().map(|(i, _)| *i).collect();
        self.unguarded.extend(failed);
        let fallback = match self.fallback.take() {
            Some((of, prepared)) if of == indices => (of, prepared),
            _ => {
                let mut plans = self.plans.clone();
                for i in &indices {
                    if let Some(original) = plans[*i].original.clone() {
                        plans[*i] = Plan::clone(&original);
                    }
                }
                (indices, self.session.prepare(&plans)?)
            }
        };
        let (_, prepared) = self.fallback.insert(fallback);
        prepared.aim(frame, order);
        Ok(Some(prepared))
    }

    /// Draws a view with the uniforms last set by [`render::SceneInputs::set_frame`]. `None`: it
    /// cannot be drawn.
    pub fn draw(&mut self, frame: &Frame, order: DrawOrder) -> Result<Option<Rendered>, Error> {
        let prepared = self.aimed(frame, order)?;
        Ok(prepared.map(Prepared::render).transpose()?)
    }

    /// Compares a picture with the original's and checks the promise of all materials together, and
    /// then each material's own. The verdict names the first broken view.
    ///
    /// # Errors
    ///
    /// Pictures of different kinds; the picture of the materials' places cannot be drawn.
    pub(super) fn compare(
        &mut self,
        (view, frame): (&View, &Frame),
        reference: &Rendered,
        picture: &Rendered,
    ) -> Result<(ErrorLadder, Option<Broke>), Error> {
        let (error, broke) = self.held((view, frame), reference, picture)?;
        self.add(&error);
        if !matches!(self.verdict, Verdict::Broken { .. }) {
            self.verdict = match &broke {
                None => Verdict::Holds,
                Some(broke) => {
                    self.judged = broke.promise.clone();
                    Verdict::Broken {
                        r#where: format!("{}: {}", view.described(), broke.how),
                    }
                }
            };
        }
        Ok((error, broke))
    }

    /// The difference of a picture, and how it breaks the promise of all materials together or one of their own.
    fn held(
        &mut self,
        (view, frame): (&View, &Frame),
        reference: &Rendered,
        picture: &Rendered,
    ) -> Result<(ErrorLadder, Option<Broke>), Error> {
        let error = compare(reference, picture)?;
        let mut broke = self.promise.broken(&error).map(|how| Broke {
            how,
            promise: self.promise.clone(),
            picture: None,
        });
        for group in &mut self.groups {
            if broke.is_none() && !error.is_exact() {
                broke = group.broken(self.session, (frame, view.order), [reference, picture])?;
            }
        }
        Ok((error, broke))
    }

    /// Whether a picture breaks the contract. The verdict stays as it is.
    pub(crate) fn breaks(
        &mut self,
        view: (&View, &Frame),
        reference: &Rendered,
        picture: &Rendered,
    ) -> Result<bool, Error> {
        Ok(self.held(view, reference, picture)?.1.is_some())
    }

    /// Compares a picture with the reference: adds their difference, and decides the verdict.
    ///
    /// # Errors
    ///
    /// Pictures of different kinds; the picture of the materials' places cannot be drawn.
    pub fn judge(
        &mut self,
        view: (&View, &Frame),
        reference: &Rendered,
        picture: &Rendered,
    ) -> Result<ErrorLadder, Error> {
        Ok(self.compare(view, reference, picture)?.0)
    }

    /// Adds a difference to the worst so far.
    pub fn add(&mut self, error: &ErrorLadder) {
        let worst = self.error.take();
        self.error = Some(worst.map_or_else(|| error.clone(), |worst| worst.worst(error)));
    }
}
