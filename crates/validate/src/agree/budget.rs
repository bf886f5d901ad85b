//! The cost limit of a pair of programs, in steps of the interpreter, so that a result does not
//! depend on the machine.

use std::cell::{Cell, OnceCell, RefCell};
use std::collections::BTreeMap;
use std::sync::Arc;

use crate::environment::{self, PassStages, TestPoint, Texels};
use crate::inputs::{Inputs, Resources};
use crate::stage::{POSITION, Ran};
use naga_interp::Stuck;

/// All runs of a pair on numbers take as many steps as this many of the longest runs.
const RUNS: u64 = 160;

/// All runs of a promise on terms.
const RUNS_OF_TERMS: u64 = 10;

/// The steps that a pair may still take.
pub(super) struct Budget {
    /// The most steps of a run.
    run: u64,
    left: Cell<u64>,
    /// Values of earlier inputs, whose memory the next ones take.
    spare: RefCell<Resources>,
}

impl Budget {
    /// A budget for a pair whose runs take at most `run` steps.
    pub(super) fn new(run: u64) -> Self {
        Self {
            run,
            left: Cell::default(),
            spare: RefCell::default(),
        }
    }

    /// Adds the share of one of some promises.
    pub(super) fn share(&self, promises: u64) {
        let all = self.run.saturating_mul(RUNS);
        self.left
            .set(self.left.get().saturating_add(all / promises.max(1)));
    }

    /// Steps of all runs of a promise on terms.
    pub(super) fn of_terms(&self) -> u64 {
        self.run.saturating_mul(RUNS_OF_TERMS)
    }

    /// Steps that a search must leave. The first search leaves half of them to the others.
    pub(super) fn allowed(&self, is_first: bool) -> u64 {
        if is_first { self.left.get() / 2 } else { 0 }
    }

    /// Whether at most `allowed` steps are left.
    pub(super) fn is_below(&self, allowed: u64) -> bool {
        self.left.get() <= allowed
    }

    /// The steps that are left.
    pub(super) fn left(&self) -> u64 {
        self.left.get()
    }

    pub(super) fn spend(&self, steps: u64) {
        self.left.set(self.left.get().saturating_sub(steps));
    }

    /// Keeps the memory of inputs that nobody needs any more.
    pub(super) fn keep(&self, inputs: Inputs) {
        if let Ok(values) = Arc::try_unwrap(inputs.resources) {
            self.spare.borrow_mut().extend(values);
        }
    }

    /// Values whose memory the next inputs take.
    pub(super) fn spare(&self) -> Resources {
        self.spare.take()
    }
}

/// A triangle of both programs.
pub(super) struct Draw<'i> {
    pub(super) inputs: &'i Inputs,
    stages: [PassStages<'i>; 2],
    budget: &'i Budget,
    /// Results of the vertex stages at its corners. All fragments share them.
    corners: [OnceCell<Result<[Ran; 3], Stuck>>; 2],
}

impl<'i> Draw<'i> {
    pub(super) fn new(inputs: &'i Inputs, stages: [PassStages<'i>; 2], budget: &'i Budget) -> Self {
        Self {
            inputs,
            stages,
            budget,
            corners: [OnceCell::new(), OnceCell::new()],
        }
    }

    /// Whether the first program's vertices of a place are in view: the whole triangle, or a corner.
    pub(super) fn is_seen(&self, place: TestPoint, steps: u64) -> bool {
        let Ok(corners) = self.corners(0, steps) else {
            return false;
        };
        let is_seen = |ran: &Ran| {
            let position = ran.outputs.get(&POSITION);
            let position = position.and_then(|p| p.floats().ok()).unwrap_or_default();
            let [x, y, z, w] = position[..] else {
                return false;
            };
            let is_inside = x.abs() <= w && y.abs() <= w && (0.0..=w).contains(&z);
            w > 0.0 && w.is_finite() && is_inside
        };
        match place {
            TestPoint::Corner(corner) => corners.get(corner).is_some_and(is_seen),
            _ => corners.iter().all(is_seen),
        }
    }

    /// The vertices of a program.
    fn corners(&self, program: usize, steps: u64) -> Result<&[Ran; 3], Stuck> {
        let corners = self.corners[program].get_or_init(|| {
            let attached = BTreeMap::new();
            let world = environment::concrete(self.inputs, &attached, Texels::Waves);
            let corners = world.corners(self.stages[program].vertex, steps, &|_| None);
            match &corners {
                Ok(corners) => self.budget.spend(corners.iter().map(|ran| ran.steps).sum()),
                Err(_) => self.budget.spend(steps),
            }
            corners
        });
        corners.as_ref().map_err(Clone::clone)
    }

    /// Runs a program at a place.
    pub(super) fn run(&self, program: usize, place: TestPoint, steps: u64) -> Result<Ran, Stuck> {
        let attached = BTreeMap::new();
        let world = environment::concrete(self.inputs, &attached, Texels::Waves);
        let stages = self.stages[program];
        let spent = |ran: &Result<Ran, Stuck>| match ran {
            Ok(ran) => self.budget.spend(ran.steps),
            Err(_) => self.budget.spend(steps),
        };
        let (Some(fragment), TestPoint::Corner(_) | TestPoint::Inside) = (stages.fragment, place)
        else {
            let ran = world.run(stages, place, steps, None);
            spent(&ran);
            return ran;
        };
        let corners = self.corners(program, steps)?;
        let ran = world.shaded(fragment, place, corners, steps, None);
        spent(&ran);
        ran
    }
}
