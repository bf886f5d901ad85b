//! The functions of a subdivided vertex stage around the author's.
//!
//! ```text
//! fn vs_corner(vertex, instance) -> VertexOutput              the author's stage, on attributes fetched from the host's buffers
//! fn vs_between(place) -> VertexOutput                        its outputs at a new vertex
//! fn vs_rest(VertexOutput) -> VertexOutput_hoist              the hoisted values and the varyings
//! ```

use std::collections::BTreeMap;

use naga::{
    BinaryOperator, Binding, BuiltIn, Expression, Function, Handle, Literal, Module, Span,
    Statement, Type, VectorSize,
};

use super::split::{Carried, Outputs, Split};
use super::text::{Order, Text};
use crate::corner::Author;
use preshade_dataflow::graph::FunctionId;
use preshade_passes::rebuild::place::{self, CodeBuilder, Rewrite};
use preshade_passes::rebuild::snippet::{Linked, define, ours, word};

/// The generated functions, in their module.
#[derive(Clone, Debug)]
pub(crate) struct Functions {
    /// The module, with an unchanged entry point.
    pub module: Module,
    /// `tessellated_place(vertex, instance) -> place`.
    pub place: Handle<Function>,
    /// `vs_between(place) -> given`.
    pub between: Handle<Function>,
    /// `vs_rest(given) -> result`.
    pub rest: Handle<Function>,
    /// Functions of the generated WGSL, by name.
    pub(super) ours: BTreeMap<String, Handle<Function>>,
}

/// Adds the functions to `module`. `name` is that of the vertex entry point.
///
/// # Errors
/// The reason as text: our own WGSL does not parse or link, or the author's stage has an input that
/// no vertex stage has.
pub(crate) fn add(
    module: Module,
    name: &str,
    split: Split,
    outputs: &Outputs,
    text: &Text<'_>,
) -> Result<Functions, String> {
    let Linked {
        module,
        ours: by_name,
    } = Linked::new(module, &text.wgsl())?;
    let place = ours(&by_name, "tessellated_place")?;
    let precedes = match text.order {
        Order::ByPosition => Some(ours(&by_name, "tessellated_precedes")?),
        Order::AsRecorded => None,
    };
    let fetch = fetch(&by_name, text)?;
    let mut blends = Vec::new();
    for width in text.widths {
        let function = ours(&by_name, &format!("tessellated_blend_{width}_"))?;
        blends.push((*width, function));
    }
    let place_type = module.functions[place]
        .result
        .as_ref()
        .map(|r| r.ty)
        .ok_or("`tessellated_place` gives nothing")?;
    let (module, corner) = corner(module, name, &split, &fetch)?;
    let (module, between) = between(
        module,
        name,
        &Between {
            corner,
            precedes,
            blends: &blends,
            place: place_type,
            given: split.given,
            outputs,
        },
    )?;
    let (module, rest) = code_behind(module, name, &split);
    Ok(Functions {
        module,
        place,
        between,
        rest,
        ours: by_name,
    })
}

/// The generated functions that read the author's attributes, by location.
pub(super) fn fetch(
    by_name: &BTreeMap<String, Handle<Function>>,
    text: &Text<'_>,
) -> Result<Vec<(u32, Handle<Function>)>, String> {
    let locations = text.attributes.iter().map(|a| a.location);
    locations
        .map(|l| Ok((l, ours(by_name, &format!("tessellated_{l}_"))?)))
        .collect()
}

/// The code after the author's stage, as a function of the author's outputs.
pub(super) fn code_behind(
    mut module: Module,
    name: &str,
    split: &Split,
) -> (Module, Handle<Function>) {
    let rest = Function {
        name: Some(place::free_name(&module, name, "rest")),
        ..split.rest.clone()
    };
    let rest = module.functions.append(rest, Span::UNDEFINED);
    (module, rest)
}

/// The author's stage at one of the original vertices.
pub(super) fn corner(
    module: Module,
    name: &str,
    split: &Split,
    fetch: &[(u32, Handle<Function>)],
) -> Result<(Module, Handle<Function>), String> {
    let author = Author {
        function: split.author,
        given: split.given,
        inputs: &split.inputs,
    };
    crate::corner::corner(module, name, &author, fetch)
}

/// The inputs of the interpolation.
struct Between<'a> {
    corner: Handle<Function>,
    /// `None` if the ends of an edge keep their order.
    precedes: Option<Handle<Function>>,
    blends: &'a [(u8, Handle<Function>)],
    place: Handle<Type>,
    given: Handle<Type>,
    outputs: &'a Outputs,
}

impl Between<'_> {
    fn output(
        &self,
        build: &mut CodeBuilder<'_>,
        base: Handle<Expression>,
        index: usize,
    ) -> Handle<Expression> {
        match self.outputs.is_struct {
            true => access(build, base, index as u32),
            false => base,
        }
    }

    /// Composes the outputs into the author's result type.
    fn compose(
        &self,
        build: &mut CodeBuilder<'_>,
        components: Vec<Handle<Expression>>,
    ) -> Handle<Expression> {
        match components[..] {
            [only] if !self.outputs.is_struct => only,
            _ => build.expression(Expression::Compose {
                ty: self.given,
                components,
            }),
        }
    }

    /// Returns `value`, with flat members from the first vertex.
    fn leave(
        &self,
        build: &mut CodeBuilder<'_>,
        value: Handle<Expression>,
        provoking: Option<Handle<Expression>>,
    ) {
        let value = match provoking {
            None => value,
            Some(provoking) => {
                let carried = self.outputs.carried.iter().enumerate();
                let components = carried
                    .map(|(i, c)| match c {
                        Carried::Flat => self.output(build, provoking, i),
                        Carried::Blended(_) => self.output(build, value, i),
                    })
                    .collect();
                self.compose(build, components)
            }
        };
        build.statement(Statement::Return { value: Some(value) });
    }
}

pub(super) fn access(
    build: &mut CodeBuilder<'_>,
    base: Handle<Expression>,
    index: u32,
) -> Handle<Expression> {
    build.expression(Expression::AccessIndex { base, index })
}

/// `a == 0.0` or `a != 0.0`.
fn compare_zero(
    build: &mut CodeBuilder<'_>,
    op: BinaryOperator,
    left: Handle<Expression>,
) -> Handle<Expression> {
    let right = build.literal(Literal::F32(0.0));
    build.expression(Expression::Binary { op, left, right })
}

/// The outputs at a new vertex. A corner keeps its own. Outputs on an edge depend only on its two
/// ends, in an order that both triangles agree on, however they number the ends.
fn between(
    module: Module,
    name: &str,
    with: &Between<'_>,
) -> Result<(Module, Handle<Function>), String> {
    let mut failed = None;
    let (module, handle) = define(
        module,
        (name, "between"),
        &[("place", with.place)],
        with.given,
        |build, passed| {
            let place = passed[0];
            let corners = access(build, place, 0);
            let weights = access(build, place, 1);
            let instance = access(build, place, 3);
            let provoking = with.outputs.has_flat().then(|| {
                let vertex = access(build, place, 2);
                build.call(with.corner, vec![vertex, instance])
            });
            let provoking = provoking.flatten();
            let at = |build: &mut CodeBuilder<'_>, corner: u32| {
                let vertex = access(build, corners, corner);
                build.call(with.corner, vec![vertex, instance])
            };
            let Some(a) = at(build, 0) else {
                failed = Some("the author's vertex stage gives nothing");
                return;
            };
            build.name(a, "a");
            let second = access(build, weights, 1);
            let alone = compare_zero(build, BinaryOperator::Equal, second);
            build.if_then(alone, |build| with.leave(build, a, provoking));
            let Some(b) = at(build, 1) else { return };
            build.name(b, "b");
            let c = build.local("c", with.given);
            build.statement(Statement::Store {
                pointer: c,
                value: a,
            });
            let third = access(build, weights, 2);
            let inside = compare_zero(build, BinaryOperator::NotEqual, third);
            build.if_then(inside, |build| {
                if let Some(value) = at(build, 2) {
                    build.statement(Statement::Store { pointer: c, value });
                }
            });
            let c = build.expression(Expression::Load { pointer: c });
            let swap = match with.precedes {
                None => build.literal(Literal::Bool(false)),
                Some(precedes) => {
                    let ends = [b, a].map(|end| with.output(build, end, with.outputs.position));
                    let Some(swap) = build.call(precedes, ends.to_vec()) else {
                        return;
                    };
                    build.name(swap, "swap");
                    swap
                }
            };
            let turned = build.expression(Expression::Swizzle {
                size: VectorSize::Tri,
                vector: weights,
                pattern: [
                    naga::SwizzleComponent::Y,
                    naga::SwizzleComponent::X,
                    naga::SwizzleComponent::Z,
                    naga::SwizzleComponent::W,
                ],
            });
            let weights = build.expression(Expression::Select {
                condition: swap,
                accept: turned,
                reject: weights,
            });
            let mut components = Vec::new();
            for (i, carried) in with.outputs.carried.iter().enumerate() {
                let of_a = with.output(build, a, i);
                components.push(match carried {
                    Carried::Flat => of_a,
                    Carried::Blended(width) => {
                        let of_b = with.output(build, b, i);
                        let of_c = with.output(build, c, i);
                        let blend = with.blends.iter().find(|(w, _)| w == width);
                        let arguments = vec![weights, swap, of_a, of_b, of_c];
                        match blend.and_then(|(_, f)| build.call(*f, arguments)) {
                            Some(value) => value,
                            None => {
                                failed = Some("a varying has no function that interpolates it");
                                return;
                            }
                        }
                    }
                });
            }
            let value = with.compose(build, components);
            with.leave(build, value, provoking);
        },
    );
    match failed {
        None => Ok((module, handle)),
        Some(why) => Err(why.to_owned()),
    }
}

/// `module` with a vertex entry point that draws the pattern through `functions`.
pub(crate) fn pulled(functions: &Functions, entry: usize) -> Module {
    let mut module = functions.module.clone();
    let word = word(&mut module);
    let point = &mut module.entry_points[entry].function;
    *point = Function {
        name: point.name.clone(),
        result: point.result.clone(),
        ..Function::default()
    };
    place::rewritten(&module, FunctionId::EntryPoint(entry), |build| {
        let inputs = vertex_inputs(build, word);
        let place = build.call(functions.place, inputs);
        let author = place.and_then(|p| build.call(functions.between, vec![p]));
        if let Some(author) = author {
            build.name(author, "author");
            let value = build.call(functions.rest, vec![author]);
            build.statement(Statement::Return { value });
        }
        Rewrite::default()
    })
}

/// The inputs of every generated vertex stage.
pub(super) fn vertex_inputs(
    build: &mut CodeBuilder<'_>,
    word: Handle<Type>,
) -> Vec<Handle<Expression>> {
    let inputs = [
        ("vertex", BuiltIn::VertexIndex),
        ("instance", BuiltIn::InstanceIndex),
    ];
    inputs
        .into_iter()
        .map(|(name, b)| build.argument(name, word, Some(Binding::BuiltIn(b))))
        .collect()
}
