//! The viewer's part in a fragment stage's coverage, and the rest without it.
//!
//! A texture coordinate becomes its value before the viewer took part: of `uv + offset` it is `uv`.
//! A condition of a discard becomes the condition without the viewer: of `alpha * fade < 0.5` it is
//! `alpha < 0.5`. Each call of a function is judged separately.

use std::collections::{BTreeMap, BTreeSet};

use naga::{Binding, BuiltIn, Expression, Handle};

use crate::analysis::reach::{with_operands, with_users};
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use crate::analysis::view;
use preshade_dataflow::graph::rate::Rate;
use preshade_dataflow::graph::{FunctionGraph, FunctionId, Graph, StmtId};

mod conditions;
mod kills;
mod loads;
mod surrounding_tests;
mod without_viewer;

/// The replacement of an expression.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Instead {
    /// Another expression of the author's, in the same function.
    Other(Handle<Expression>),
    Bool(bool),
}

/// An expression in one chain of calls.
pub type At = (ContextId, Handle<Expression>);

pub(crate) type Changes = BTreeMap<At, Instead>;

/// It is unclear what this condition is without the viewer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Unclear(pub At);

/// Locations of the vertex stage's outputs that depend on the viewer. `follows` are its uniforms
/// ([`view::view_dependent`]).
pub(crate) fn varyings(graph: &Graph<'_>, vertex: usize, follows: &[String]) -> BTreeSet<u32> {
    let Ok(values) = Values::new(graph, vertex) else {
        return BTreeSet::new();
    };
    let sources = (0..values.values.len()).filter(|v| view::is_read(&values, *v, follows));
    let dependent = with_users(&values, sources.collect());
    let outputs = values.outputs().into_iter();
    let locations = outputs.filter_map(|(binding, value)| match binding {
        Some(Binding::Location { location, .. }) if dependent[value] => Some(location),
        _ => None,
    });
    locations.collect()
}

/// A fragment stage, and which of its values depend on the viewer.
pub(crate) struct Stage<'g, 'p> {
    pub values: Values<'g, 'p>,
    /// Whether each value depends on the viewer.
    dependent: Vec<bool>,
    /// Whether coverage depends on each value.
    decides: Vec<bool>,
    /// Whether each value depends on an interpolated input.
    interpolated: Vec<bool>,
    /// Whether each value depends on a texture that is read at interpolated coordinates: the
    /// material's, and no pattern of pixels.
    textured: Vec<bool>,
    /// Whether each value depends on a texture that is read at a place of the picture's: a dither's
    /// pattern, or the surface below a decal.
    screen: Vec<bool>,
}

/// The parts of the material that a value without the viewer reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum ViewerReads {
    /// Nothing that differs on its surface: uniforms, the pixel's place.
    Nothing,
    /// Interpolated inputs, or textures at a place of the picture's.
    Inputs,
    Textures,
}

impl<'g, 'p> Stage<'g, 'p> {
    /// `None`: the stage is too large to analyse.
    pub fn new(
        graph: &'g Graph<'p>,
        fragment: usize,
        follows: &[String],
        varyings: &BTreeSet<u32>,
    ) -> Option<Self> {
        let values = Values::new(graph, fragment).ok()?;
        let all = 0..values.values.len();
        let sources = all
            .clone()
            .filter(|v| is_source(&values, *v, follows, varyings));
        let dependent = with_users(&values, sources.collect());
        let decides = with_operands(&values, values.coverage.clone());
        let inputs = all.clone().filter(
            |v| matches!(&values.values[*v].node, Node::Input(i) if is_location(&values, *i)),
        );
        let interpolated = with_users(&values, inputs.collect());
        let texels = all.filter(|v| is_texel(&values, *v));
        let (texels, others): (Vec<_>, Vec<_>) = texels.partition(|v| interpolated[*v]);
        let textured = with_users(&values, texels);
        let others = others.into_iter().filter(|v| varies(&values, *v));
        let screen = with_users(&values, others.collect());
        Some(Self {
            values,
            dependent,
            decides,
            interpolated,
            textured,
            screen,
        })
    }

    /// The changes that take the viewer out of texture coordinates that coverage depends on.
    pub fn coordinates(&self) -> Changes {
        let mut changes = Changes::new();
        for context in 0..self.values.contexts.len() {
            let f = self.values.function(context);
            for (e, expression) in f.function.expressions.iter() {
                if let Expression::ImageSample { coordinate, .. }
                | Expression::ImageLoad { coordinate, .. } = *expression
                    && self.is(&self.decides, (context, e))
                    && self.depends((context, coordinate))
                {
                    changes.extend(without_viewer::of_coordinate(self, (context, coordinate)));
                }
            }
        }
        changes
    }

    pub fn f(&self, context: ContextId) -> &'g FunctionGraph<'p> {
        self.values.function(context)
    }

    fn is(&self, marks: &[bool], (context, e): At) -> bool {
        self.values.named(context, e).is_some_and(|v| marks[v])
    }

    fn depends(&self, at: At) -> bool {
        self.is(&self.dependent, at)
    }

    fn is_textured(&self, at: At) -> bool {
        self.is(&self.textured, at)
    }

    fn reads_screen(&self, at: At) -> bool {
        self.is(&self.screen, at)
    }

    /// The parts of the material that a value reads. If it loses the viewer, at least an input is
    /// left.
    fn reads(&self, at: At) -> ViewerReads {
        let decides = self.depends(at) || self.reads_screen(at);
        match self.is_textured(at) {
            true => ViewerReads::Textures,
            false if decides || (self.is(&self.interpolated, at) && self.is_varying(at)) => {
                ViewerReads::Inputs
            }
            false => ViewerReads::Nothing,
        }
    }

    /// Whether an expression differs from fragment to fragment.
    fn is_varying(&self, (context, e): At) -> bool {
        let value = self.values.named(context, e);
        value.is_some_and(|v| varies(&self.values, v))
    }

    /// Whether a statement runs only if something of the viewer's is so.
    fn is_controlled(&self, mut context: ContextId, mut statement: StmtId) -> bool {
        loop {
            if let Some(control) = self.values.get(&Node::Control(context, statement)) {
                return self.dependent[control];
            }
            match self.values.contexts[context].call {
                Some(call) => (context, statement) = call,
                None => return false,
            }
        }
    }

    /// The argument that a call gives to a function; `None` for the entry point's.
    fn argument(&self, context: ContextId, index: u32) -> Option<At> {
        let (caller, call) = self.values.contexts[context].call?;
        match self.f(caller).statements.get(call).statement {
            naga::Statement::Call { arguments, .. } => {
                Some((caller, *arguments.get(index as usize)?))
            }
            _ => None,
        }
    }

    /// The origin of a value: for an argument, the caller's value.
    fn origin(&self, mut at: At) -> At {
        while let Expression::FunctionArgument(i) = self.f(at.0).function.expressions[at.1]
            && let Some(outer) = self.argument(at.0, i)
        {
            at = outer;
        }
        at
    }

    /// The context of the call that has a result.
    fn callee(&self, (context, result): At) -> Option<ContextId> {
        let call = self.f(context).statements.evaluated_at(result)?;
        self.values.child(context, call)
    }

    /// The values that a function returns, in one context.
    fn returns(&self, context: ContextId) -> Vec<(StmtId, At)> {
        let f = self.f(context);
        let all = f.statements.iter();
        all.filter_map(|(id, node)| match node.statement {
            naga::Statement::Return { value: Some(value) } if f.control.is_reachable(id) => {
                Some((id, (context, *value)))
            }
            _ => None,
        })
        .collect()
    }

    /// Whether a context is a call below another, or the same.
    fn is_below(&self, mut context: ContextId, above: ContextId) -> bool {
        loop {
            if context == above {
                return true;
            }
            match self.values.contexts[context].call {
                Some((caller, _)) => context = caller,
                None => return false,
            }
        }
    }

    /// The functions that are called in more than one way.
    pub fn shared(&self) -> BTreeSet<FunctionId> {
        let mut seen = BTreeSet::new();
        let functions = self.values.contexts.iter().map(|c| c.function);
        functions.filter(|f| !seen.insert(*f)).collect()
    }
}

/// Whether a value comes from the viewer.
fn is_source(
    values: &Values<'_, '_>,
    value: ValueId,
    follows: &[String],
    varyings: &BTreeSet<u32>,
) -> bool {
    match &values.values[value].node {
        Node::Input(i) => matches!(
            values.inputs[*i].binding,
            Some(Binding::Location { location, .. }) if varyings.contains(&location)
        ),
        Node::Expression(context, e, _) => {
            // How far the surface is. Its place in the picture is no property of the viewer.
            let f = values.function(*context).function;
            let is_far = matches!(
                f.expressions[*e],
                Expression::AccessIndex { index: 2 | 3, .. }
            );
            (is_far && is_of_position(values, value)) || view::is_read(values, value, follows)
        }
        _ => false,
    }
}

/// Whether a value differs from fragment to fragment.
fn varies(values: &Values<'_, '_>, value: ValueId) -> bool {
    values.values[value].fact.rate > Rate::Instance
}

fn is_of_position(values: &Values<'_, '_>, value: ValueId) -> bool {
    let [one] = values.values[value].operands[..] else {
        return false;
    };
    let Node::Input(input) = values.values[one].node else {
        return false;
    };
    let binding = values.inputs[input].binding.as_ref();
    matches!(binding, Some(Binding::BuiltIn(BuiltIn::Position { .. })))
}

fn is_location(values: &Values<'_, '_>, input: usize) -> bool {
    let binding = values.inputs[input].binding.as_ref();
    matches!(binding, Some(Binding::Location { .. }))
}

fn is_texel(values: &Values<'_, '_>, value: ValueId) -> bool {
    let Node::Expression(context, e, _) = &values.values[value].node else {
        return false;
    };
    let f = values.function(*context).function;
    matches!(
        f.expressions[*e],
        Expression::ImageSample { .. } | Expression::ImageLoad { .. }
    )
}
