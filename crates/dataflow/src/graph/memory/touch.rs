//! The memory accesses of statements and expressions.

use naga::{Expression, Function, Handle, Module, RayQueryFunction, Statement};

use crate::graph::cells::{self, Cell, Place, Root};
use crate::graph::memory::{Certainty, Footprint, in_caller};

/// A read or write of memory by a statement or expression.
#[derive(Clone, Debug)]
pub(super) struct Access {
    pub place: Place,
    /// Whether a write covers the whole place.
    pub certainty: Certainty,
}

pub(super) struct Touch<'a, 'f> {
    pub module: &'a Module,
    pub function: &'a Function,
    pub footprint: &'a dyn Fn(Handle<Function>) -> &'f Footprint,
}

impl Touch<'_, '_> {
    fn place(&self, pointer: Handle<Expression>) -> Option<Place> {
        cells::place(self.module, self.function, pointer)
    }

    /// The place that an expression reads.
    pub fn expression(&self, expression: Handle<Expression>) -> Option<Place> {
        match self.function.expressions[expression] {
            Expression::Load { pointer } => self.place(pointer),
            Expression::RayQueryGetIntersection { query, .. }
            | Expression::RayQueryVertexPositions { query, .. } => self.place(query),
            Expression::ImageLoad { image, .. } => self.place(image),
            Expression::CooperativeLoad { ref data, .. } => self.place(data.pointer),
            _ => None,
        }
    }

    /// The reads and writes of a statement, without its blocks and emitted expressions.
    pub fn statement(&self, statement: &Statement) -> (Vec<Access>, Vec<Access>) {
        let one = |pointer, certainty| {
            self.place(pointer)
                .map(|place| Access { place, certainty })
                .into_iter()
                .collect::<Vec<_>>()
        };
        let both = |pointer| (one(pointer, Certainty::May), one(pointer, Certainty::May));
        match statement {
            Statement::Store { pointer, .. } => (Vec::new(), one(*pointer, Certainty::Must)),
            Statement::ImageStore { image, .. } => (Vec::new(), one(*image, Certainty::May)),
            Statement::Atomic { pointer, .. } => both(*pointer),
            Statement::ImageAtomic { image, .. } => both(*image),
            Statement::WorkGroupUniformLoad { pointer, .. } => both(*pointer),
            Statement::RayQuery { query, fun } => match fun {
                RayQueryFunction::Initialize { .. } => (Vec::new(), one(*query, Certainty::Must)),
                _ => both(*query),
            },
            Statement::RayPipelineFunction(naga::RayPipelineFunction::TraceRay {
                payload, ..
            }) => both(*payload),
            Statement::CooperativeStore { data, .. } => both(data.pointer),
            Statement::ControlBarrier(_) | Statement::MemoryBarrier(_) => {
                let shared: Vec<Access> = self
                    .module
                    .global_variables
                    .iter()
                    .filter(|(g, v)| {
                        v.space != naga::AddressSpace::Private
                            && cells::is_written_space(self.module, *g)
                    })
                    .map(|(g, _)| Access {
                        place: Place {
                            root: Root::Global(g),
                            path: Vec::new(),
                            dynamic: true,
                        },
                        certainty: Certainty::May,
                    })
                    .collect();
                (shared.clone(), shared)
            }
            Statement::Call {
                function,
                arguments,
                ..
            } => {
                let footprint = (self.footprint)(*function);
                let at = |cell: &Cell| in_caller(self.module, self.function, arguments, cell);
                let reads = footprint
                    .reads
                    .iter()
                    .filter_map(|cell| {
                        Some(Access {
                            place: at(cell)?,
                            certainty: Certainty::May,
                        })
                    })
                    .collect();
                let writes = footprint
                    .writes
                    .iter()
                    .filter_map(|(cell, certainty)| {
                        Some(Access {
                            place: at(cell)?,
                            certainty: *certainty,
                        })
                    })
                    .collect();
                (reads, writes)
            }
            _ => (Vec::new(), Vec::new()),
        }
    }
}
