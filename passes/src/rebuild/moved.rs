//! Values that a pass takes out of a fragment stage, and that the stage is given instead: the code
//! that such passes share, wherever the values come from.

use naga::Module;
use serde::Serialize;

use super::outline::{self, Failed, Wanted};
use super::place::CodeBuilder;
use super::remainder::{self, Given};
use crate::analysis::loops::LoopEnds;
use crate::analysis::named::span;
use crate::analysis::values::{ValueId, Values};
use preshade_dataflow::slice::Termination;
use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::guard::Guard;
use preshade_plan::pass::{Left, Outcome, Refusal, Refused};
use preshade_plan::plan::{Change, GpuPass, ORIGINAL, Plan, Role, Site, SiteCost};

/// The values that leave a fragment stage.
pub(crate) struct MovedValues<'v, 'g, 'p> {
    pub values: &'v Values<'g, 'p>,
    /// Those that leave it, in the order in which they are given.
    pub ids: Vec<ValueId>,
    pub wanted: Vec<Wanted>,
    /// Values that stay, and why.
    pub left: Vec<Left>,
    /// The guard under which their loops end.
    pub guard: Option<Guard>,
}

impl<'v, 'g, 'p> MovedValues<'v, 'g, 'p> {
    /// `unnamed` is the name of values that have none. `left` may list values that leave.
    pub fn new(
        values: &'v Values<'g, 'p>,
        ids: Vec<ValueId>,
        unnamed: &str,
        mut left: Vec<Left>,
    ) -> Self {
        let wanted = outline::wanted(values, ids.iter().copied(), unnamed);
        left.retain(|l| !wanted.iter().any(|w| w.name == l.name));
        Self {
            guard: LoopEnds::new(values).guard(values, &ids),
            values,
            ids,
            wanted,
            left,
        }
    }

    pub fn names(&self) -> String {
        let names = self.wanted.iter().map(|w| format!("`{}`", w.name));
        names.collect::<Vec<_>>().join(", ")
    }

    /// The rest of the stage, by [`remainder::rebuild`].
    ///
    /// # Errors
    /// [`Failed`].
    pub fn remainder(
        &self,
        module: &Module,
        termination: Termination,
        given: &mut dyn FnMut(&mut CodeBuilder<'_>) -> Given,
    ) -> Result<Module, Failed> {
        let program = self.values.graph.program();
        remainder::rebuild(
            program,
            module,
            self.values,
            &self.wanted,
            termination,
            given,
        )
    }

    /// The refusal, with the values that stay.
    pub fn refused(&self, refusal: Refusal) -> Refused {
        (Box::new(refusal), self.left.clone()).into()
    }

    /// The change of the stage in the main pass `pass`. The description `what` holds under the
    /// guard.
    pub fn change(&self, pass: &GpuPass, what: &str, cost: SiteCost) -> Change {
        let sources = self.values.graph.program().sources();
        let mut spans = self.ids.iter().filter_map(|id| span(self.values, *id));
        Change {
            key: Site {
                role: Role::Main,
                entry_point: pass.fragment.clone().unwrap_or_default(),
                slice: outline::hash(self.values, self.ids.iter().copied()),
            },
            what: Guard::condition(self.guard.as_ref()) + what,
            location: spans.find_map(|span| sources.locate(span)),
            cost,
        }
    }

    /// The plan `next` with a step of the pass `name`, whose contract holds under the assumptions
    /// `given` and the guard.
    pub fn outcome(
        self,
        mut next: Plan,
        (name, params): (&str, &impl Serialize),
        change: Change,
        mut given: Vec<Assumption>,
        contract: impl FnOnce(Vec<Assumption>) -> Contract,
    ) -> Outcome {
        next.assume(self.guard, &mut given);
        next.add_step(name, params, &change, contract(given));
        next.fallback = Some(ORIGINAL.to_owned());
        Outcome {
            plan: next,
            change,
            left: self.left,
        }
    }
}
