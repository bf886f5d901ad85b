//! Finds the textures and samplers that compare.
//!
//! In Vulkan's GLSL, their types do not show whether `sampler2DShadow(t, s)` compares with them; in
//! the IR they do. Parameters are followed through the calls of their functions.

use std::collections::HashSet;

use crate::tree::{FunctionId, GlobalId, Kind, Node, Stage};

/// A texture or sampler: a global, or a parameter of a function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Root {
    Global(GlobalId),
    Parameter(FunctionId, usize),
}

/// The textures and samplers that compare. All elements of an array count as one.
#[derive(Debug, Default)]
pub(super) struct Comparing(HashSet<Root>);

fn root(node: &Node, function: FunctionId) -> Option<Root> {
    match &*node.kind {
        Kind::Global(id) => Some(Root::Global(*id)),
        Kind::Parameter(i) => Some(Root::Parameter(function, *i)),
        Kind::Element(of, _) => root(of, function),
        _ => None,
    }
}

impl Comparing {
    pub(super) fn of(stage: &Stage) -> Self {
        let mut found = HashSet::new();
        let mut calls = Vec::new();
        for (id, function) in stage.functions.iter().enumerate() {
            let id = FunctionId(id);
            let body = function.iter().flat_map(|f| &f.body);
            body.for_each(|statement| {
                statement.visit(&mut |node| match &*node.kind {
                    Kind::Combine {
                        texture,
                        sampler,
                        compares: true,
                    } => found.extend([texture, sampler].into_iter().filter_map(|of| root(of, id))),
                    Kind::Call(callee, arguments) => {
                        for (i, argument) in arguments.iter().enumerate() {
                            if let Some(given) = root(argument, id) {
                                calls.push((Root::Parameter(*callee, i), given));
                            }
                        }
                    }
                    _ => {}
                });
            });
        }
        loop {
            let before = found.len();
            let more = calls
                .iter()
                .filter(|(parameter, _)| found.contains(parameter));
            let more: Vec<Root> = more.map(|(_, given)| *given).collect();
            found.extend(more);
            if found.len() == before {
                return Self(found);
            }
        }
    }

    pub(super) fn has_global(&self, id: GlobalId) -> bool {
        self.0.contains(&Root::Global(id))
    }

    pub(super) fn has_parameter(&self, function: FunctionId, i: usize) -> bool {
        self.0.contains(&Root::Parameter(function, i))
    }
}
