//! Copies of functions that compute a wanted value in one of several calls, so that it is captured
//! in that call alone.

use std::collections::BTreeSet;

use super::{Distance, Extending, ExtraPicture, Face, Failed, Normal, Shows, Surface};
use crate::analysis::values::{ContextId, Values};
use crate::rebuild::isolate::isolate;
use crate::transforms::outputs::authored::{Authored, AuthoredPlace, calls_of};
use preshade_dataflow::graph::FunctionId;

impl Extending<'_, '_> {
    /// The wanted values, in functions that only their own calls run.
    pub(super) fn separate(
        &mut self,
        wanted: &[ExtraPicture],
    ) -> Result<Vec<ExtraPicture>, Failed> {
        let mut wanted = wanted.to_vec();
        let mut fragment: Vec<&mut Authored> = Vec::new();
        let mut vertex: Vec<&mut Authored> = Vec::new();
        for wanted in &mut wanted {
            match &mut wanted.shows {
                Shows::Value(value) | Shows::Direction(Normal::Value(value), _) => {
                    fragment.push(value);
                }
                Shows::Distance(Distance { from, .. })
                | Shows::Direction(Normal::Face(Face { from, .. }), _) => match from {
                    Surface::Value(value) => fragment.push(value),
                    Surface::World(world) => {
                        vertex.push(&mut world.vector);
                        vertex.extend(&mut world.matrices);
                    }
                },
                Shows::Velocity(_) | Shows::Id | Shows::Nothing => {}
            }
        }
        self.isolate(self.opaque.vertex, vertex)?;
        if let Some(entry) = self.opaque.fragment {
            self.isolate(entry, fragment)?;
        }
        Ok(wanted)
    }

    fn isolate(&mut self, entry: usize, values: Vec<&mut Authored>) -> Result<(), Failed> {
        let graph = &self.opaque.graph;
        let is_shared = |value: &Authored| {
            let function = value.function_id().filter(|_| !value.calls.is_empty());
            function.is_some_and(|function| calls_of(graph, entry, function).len() > 1)
        };
        let values: Vec<&mut Authored> = values.into_iter().filter(|v| is_shared(v)).collect();
        if values.is_empty() {
            return Ok(());
        }
        let all = Values::new(graph, entry).map_err(|e| Failed::Built(e.to_string()))?;
        let context = |value: &Authored| -> Option<ContextId> {
            let mut calls = value.calls.iter();
            calls.try_fold(0, |context, call| all.child(context, *call))
        };
        let contexts: BTreeSet<ContextId> = values.iter().filter_map(|v| context(v)).collect();
        let (module, copies) = isolate(&self.module, entry, &all, &contexts);
        self.module = module;
        for value in values {
            let copy = context(value).and_then(|context| copies.get(&context));
            let copy: FunctionId =
                *copy.ok_or_else(|| Failed::Built(format!("no call computes `{}`", value.name)))?;
            match &mut value.place {
                AuthoredPlace::Argument(id, _)
                | AuthoredPlace::Expression(id, _)
                | AuthoredPlace::Local(id, _) => {
                    *id = copy;
                }
                AuthoredPlace::Input(_) | AuthoredPlace::Global(_) => {}
            }
        }
        Ok(())
    }
}
