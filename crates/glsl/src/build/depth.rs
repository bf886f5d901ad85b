//! Finds the textures that are compared.
//!
//! The type of a texture in Vulkan's GLSL does not say whether `sampler2DShadow(t, s)` compares it;
//! the IR's does. Parameters count through the calls of their functions.

use std::collections::HashSet;

use super::super::tree::{FunctionId, GlobalId, Kind, Node, Stage};

/// A texture: a global, or a parameter of a function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Texture {
    Global(GlobalId),
    Parameter(FunctionId, usize),
}

/// The textures that are compared.
#[derive(Debug, Default)]
pub(super) struct DepthTextures(HashSet<Texture>);

fn texture(node: &Node, function: FunctionId) -> Option<Texture> {
    match &*node.kind {
        Kind::Global(id) => Some(Texture::Global(*id)),
        Kind::Parameter(i) => Some(Texture::Parameter(function, *i)),
        _ => None,
    }
}

/// Calls `each` for a node and those in it.
fn visit<'n>(node: &'n Node, each: &mut dyn FnMut(&'n Node)) {
    each(node);
    node.kind.operands(&mut |of| visit(of, each));
}

impl DepthTextures {
    pub(super) fn of(stage: &Stage) -> Self {
        let mut found = HashSet::new();
        let mut calls = Vec::new();
        for (id, function) in stage.functions.iter().enumerate() {
            let id = FunctionId(id);
            let body = function.iter().flat_map(|f| &f.body);
            body.for_each(|statement| {
                statement.nodes(&mut |node| {
                    visit(node, &mut |node| match &*node.kind {
                        Kind::Combine {
                            texture: of,
                            compares: true,
                            ..
                        } => found.extend(texture(of, id)),
                        Kind::Call(callee, arguments) => {
                            for (i, argument) in arguments.iter().enumerate() {
                                if let Some(given) = texture(argument, id) {
                                    calls.push((Texture::Parameter(*callee, i), given));
                                }
                            }
                        }
                        _ => {}
                    });
                });
            });
        }
        loop {
            let before = found.len();
            let more = calls
                .iter()
                .filter(|(parameter, _)| found.contains(parameter));
            let more: Vec<Texture> = more.map(|(_, given)| *given).collect();
            found.extend(more);
            if found.len() == before {
                return Self(found);
            }
        }
    }

    pub(super) fn has_global(&self, id: GlobalId) -> bool {
        self.0.contains(&Texture::Global(id))
    }

    pub(super) fn has_parameter(&self, function: FunctionId, i: usize) -> bool {
        self.0.contains(&Texture::Parameter(function, i))
    }
}
