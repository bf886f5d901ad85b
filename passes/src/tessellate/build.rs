//! The functions of a subdivided vertex stage, around the author's.
//!
//! ```text
//! fn vs_corner(vertex, instance) -> VertexOutput              the author's stage, on attributes fetched from the host's buffers
//! fn vs_between(place) -> VertexOutput                        its outputs at a new vertex
//! fn vs_rest(VertexOutput) -> VertexOutput_hoist              what was hoisted, and the varyings
//! ```

use std::collections::BTreeMap;

use naga::{
    BinaryOperator, Binding, BuiltIn, Expression, Function, FunctionArgument, FunctionResult,
    Handle, Literal, Module, Scalar, ScalarKind, ShaderStage, Span, Statement, Type, TypeInner,
    VectorSize,
};

use super::Slots;
use super::split::{Carried, Outputs, Split};
use super::text::{self, Points, Text, WORKGROUP};
use crate::graph::FunctionId;
use crate::link;
use crate::place::{self, Builder, Rewrite};

/// An offset past every file of a source map: our own text has no place in the author's.
const NOWHERE: u32 = u32::MAX / 2;

/// The functions, in their module.
#[derive(Clone, Debug)]
pub struct Functions {
    /// The module, whose entry point is as it was.
    pub module: Module,
    /// `tessellated_place(vertex, instance) -> place`.
    pub place: Handle<Function>,
    /// `vs_between(place) -> given`.
    pub between: Handle<Function>,
    /// `vs_rest(given) -> result`.
    pub rest: Handle<Function>,
    /// Those of our own text, by name.
    ours: BTreeMap<String, Handle<Function>>,
}

/// A module with functions of our own text.
struct Linked {
    module: Module,
    ours: BTreeMap<String, Handle<Function>>,
}

impl Linked {
    /// Adds `wgsl` to `module`.
    fn new(module: Module, wgsl: &str) -> Result<Self, String> {
        let snippet = naga::front::wgsl::parse_str(wgsl)
            .map_err(|e| format!("our own text does not parse: {}", e.message()))?;
        let linked =
            link::link(module, &snippet, NOWHERE, "preshade").map_err(|e| e.message.clone())?;
        let names = snippet.functions.iter().map(|(_, f)| f.name.clone());
        let named = names.zip(&linked.functions);
        Ok(Self {
            ours: named.filter_map(|(n, h)| Some((n?, *h))).collect(),
            module: linked.module,
        })
    }
}

/// A function of our own text.
fn ours(
    functions: &BTreeMap<String, Handle<Function>>,
    name: &str,
) -> Result<Handle<Function>, String> {
    let found = functions.get(name).copied();
    found.ok_or_else(|| format!("our own text has no `{name}`"))
}

/// Adds the functions to `module`. `name` is the vertex entry point's.
///
/// # Errors
/// In words: our own text does not parse or link, or an input of the author's is none that a vertex stage has.
pub fn add(
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
    let precedes = ours(&by_name, "tessellated_precedes")?;
    let mut fetch = Vec::new();
    for attribute in text.attributes {
        let function = ours(&by_name, &format!("tessellated_{}_", attribute.location))?;
        fetch.push((attribute.location, function));
    }
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
    let (mut module, between) = between(
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
    let rest = Function {
        name: Some(place::free_name(&module, name, "rest")),
        ..split.rest
    };
    let rest = module.functions.append(rest, Span::UNDEFINED);
    Ok(Functions {
        module,
        place,
        between,
        rest,
        ours: by_name,
    })
}

/// A new function, named `NAME_SUFFIX` and written by `build`.
fn define(
    mut module: Module,
    (name, suffix): (&str, &str),
    arguments: &[(&str, Handle<Type>)],
    result: Handle<Type>,
    build: impl FnOnce(&mut Builder<'_>, &[Handle<Expression>]),
) -> (Module, Handle<Function>) {
    let function = Function {
        name: Some(place::free_name(&module, name, suffix)),
        arguments: arguments
            .iter()
            .map(|(name, ty)| FunctionArgument {
                name: Some((*name).to_owned()),
                ty: *ty,
                binding: None,
            })
            .collect(),
        result: Some(FunctionResult {
            ty: result,
            binding: None,
        }),
        ..Function::default()
    };
    let handle = module.functions.append(function, Span::UNDEFINED);
    let module = place::rewritten(&module, FunctionId::Function(handle), |builder| {
        let passed: Vec<_> = (0..arguments.len() as u32)
            .map(|i| builder.expression(Expression::FunctionArgument(i)))
            .collect();
        build(builder, &passed);
        Rewrite::default()
    });
    (module, handle)
}

/// A `u32` type.
pub fn word(module: &mut Module) -> Handle<Type> {
    let inner = TypeInner::Scalar(Scalar::U32);
    module
        .types
        .insert(Type { name: None, inner }, Span::UNDEFINED)
}

/// The author's stage on one of the author's vertices.
fn corner(
    mut module: Module,
    name: &str,
    split: &Split,
    fetch: &[(u32, Handle<Function>)],
) -> Result<(Module, Handle<Function>), String> {
    let word = word(&mut module);
    let mut failed = None;
    let inputs = split.inputs.clone();
    let author = split.author;
    let (module, handle) = define(
        module,
        (name, "corner"),
        &[("vertex", word), ("instance", word)],
        split.given,
        |build, passed| {
            let one = |build: &mut Builder<'_>, binding: Option<&Binding>| match binding {
                Some(Binding::BuiltIn(BuiltIn::VertexIndex)) => Some(passed[0]),
                Some(Binding::BuiltIn(BuiltIn::InstanceIndex)) => Some(passed[1]),
                Some(Binding::Location { location, .. }) => {
                    let of = fetch.iter().find(|(l, _)| l == location);
                    of.and_then(|(_, f)| build.call(*f, passed.to_vec()))
                }
                _ => None,
            };
            let mut arguments = Vec::new();
            for input in &inputs {
                let members = match (&input.binding, &build.module().types[input.ty].inner) {
                    (None, TypeInner::Struct { members, .. }) => Some(members.clone()),
                    _ => None,
                };
                let value = match members {
                    None => one(build, input.binding.as_ref()),
                    Some(members) => members
                        .iter()
                        .map(|m| one(build, m.binding.as_ref()))
                        .collect::<Option<Vec<_>>>()
                        .map(|components| {
                            build.expression(Expression::Compose {
                                ty: input.ty,
                                components,
                            })
                        }),
                };
                match value {
                    Some(value) => arguments.push(value),
                    None => failed = Some(input.name.clone().unwrap_or_default()),
                }
            }
            if failed.is_none() {
                let value = build.call(author, arguments);
                build.statement(Statement::Return { value });
            }
        },
    );
    match failed {
        None => Ok((module, handle)),
        Some(input) => Err(format!("the input `{input}` has no source")),
    }
}

/// What interpolating takes.
struct Between<'a> {
    corner: Handle<Function>,
    precedes: Handle<Function>,
    blends: &'a [(u8, Handle<Function>)],
    place: Handle<Type>,
    given: Handle<Type>,
    outputs: &'a Outputs,
}

impl Between<'_> {
    fn output(
        &self,
        build: &mut Builder<'_>,
        base: Handle<Expression>,
        index: usize,
    ) -> Handle<Expression> {
        match self.outputs.is_struct {
            true => access(build, base, index as u32),
            false => base,
        }
    }

    /// The outputs, one by one, as what the author's stage gives.
    fn compose(
        &self,
        build: &mut Builder<'_>,
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

    /// Returns `value` with what is flat taken from the first vertex.
    fn leave(
        &self,
        build: &mut Builder<'_>,
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

fn access(build: &mut Builder<'_>, base: Handle<Expression>, index: u32) -> Handle<Expression> {
    build.expression(Expression::AccessIndex { base, index })
}

/// `a == 0.0` or `a != 0.0`.
fn compare_zero(
    build: &mut Builder<'_>,
    op: BinaryOperator,
    left: Handle<Expression>,
) -> Handle<Expression> {
    let right = build.literal(Literal::F32(0.0));
    build.expression(Expression::Binary { op, left, right })
}

/// The outputs at a new vertex. A corner's are its own. Those on an edge rest on its two ends alone, which are put into an order that both of its triangles agree on,
/// also where they call the ends by other numbers.
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
            let at = |build: &mut Builder<'_>, corner: u32| {
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
            let ends = [b, a].map(|end| with.output(build, end, with.outputs.position));
            let Some(swap) = build.call(with.precedes, ends.to_vec()) else {
                return;
            };
            build.name(swap, "swap");
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

/// `module` with the vertex entry point of that index drawing the pattern, `functions` being its own.
pub fn pulled(functions: &Functions, entry: usize) -> Module {
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

/// How a new vertex lies in the buffer that holds it once computed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stored {
    /// Each member of the vertex stage's result: its type, first word and width.
    members: Vec<(Handle<Type>, u32, u8)>,
    /// Words of a vertex.
    pub words: u32,
}

impl Stored {
    /// Of a vertex stage's result type.
    ///
    /// # Errors
    /// In words: a member is not made of 32-bit numbers.
    pub fn of(module: &Module, result: Handle<Type>) -> Result<Self, String> {
        let TypeInner::Struct { members, .. } = &module.types[result].inner else {
            return Err("the vertex stage gives no struct".to_owned());
        };
        let mut stored = Self {
            members: Vec::new(),
            words: 0,
        };
        for member in members {
            let width = match &module.types[member.ty].inner {
                TypeInner::Scalar(s) if s.width == 4 => 1,
                TypeInner::Vector { size, scalar } if scalar.width == 4 => *size as u8,
                _ => return Err("a varying is not made of 32-bit numbers".to_owned()),
            };
            stored.members.push((member.ty, stored.words, width));
            stored.words += u32::from(width);
        }
        Ok(stored)
    }

    /// Widths of its members, each once.
    pub fn widths(&self) -> Vec<u8> {
        let mut widths: Vec<u8> = self.members.iter().map(|m| m.2).collect();
        widths.sort_unstable();
        widths.dedup();
        widths
    }

    /// The word of a member, of the vertex of that index.
    fn at(
        &self,
        build: &mut Builder<'_>,
        index: Handle<Expression>,
        word: u32,
    ) -> Handle<Expression> {
        let words = build.literal(Literal::U32(self.words));
        let first = build.expression(Expression::Binary {
            op: BinaryOperator::Multiply,
            left: index,
            right: words,
        });
        if word == 0 {
            return first;
        }
        let word = build.literal(Literal::U32(word));
        build.expression(Expression::Binary {
            op: BinaryOperator::Add,
            left: first,
            right: word,
        })
    }
}

/// The bits of a 32-bit number or vector, as another kind of it.
fn bits(build: &mut Builder<'_>, expr: Handle<Expression>, kind: ScalarKind) -> Handle<Expression> {
    build.expression(Expression::As {
        expr,
        kind,
        convert: None,
    })
}

/// `functions`' module with a compute entry point that evaluates and stores every new vertex.
///
/// # Errors
/// In words: our own text lacks something.
pub fn stored(
    functions: &Functions,
    vertex: usize,
    name: &str,
    stored: &Stored,
) -> Result<Module, String> {
    let mut module = functions.module.clone();
    let triple = module.types.insert(
        Type {
            name: None,
            inner: TypeInner::Vector {
                size: VectorSize::Tri,
                scalar: Scalar::U32,
            },
        },
        Span::UNDEFINED,
    );
    let entry = naga::EntryPoint {
        name: name.to_owned(),
        stage: ShaderStage::Compute,
        workgroup_size: [WORKGROUP, 1, 1],
        function: Function {
            name: Some(name.to_owned()),
            ..Function::default()
        },
        ..module.entry_points[vertex].clone()
    };
    module.entry_points.push(entry);
    let entry = FunctionId::EntryPoint(module.entry_points.len() - 1);
    let ours = |name: &str| ours(&functions.ours, name);
    let (index_of, is_one, place_of) = (
        ours("tessellated_index")?,
        ours("tessellated_is_one")?,
        ours("tessellated_place_of")?,
    );
    let mut stores = BTreeMap::new();
    for width in stored.widths() {
        stores.insert(width, ours(&format!("tessellated_store_{width}_"))?);
    }
    Ok(place::rewritten(&module, entry, |build| {
        let inputs = [
            ("id", BuiltIn::GlobalInvocationId),
            ("groups", BuiltIn::NumWorkGroups),
        ];
        let inputs: Vec<_> = inputs
            .into_iter()
            .map(|(name, b)| build.argument(name, triple, Some(Binding::BuiltIn(b))))
            .collect();
        let index = build.call(index_of, inputs);
        let one = index.and_then(|i| build.call(is_one, vec![i]));
        let (Some(index), Some(one)) = (index, one) else {
            return Rewrite::default();
        };
        build.name(index, "index");
        build.if_then(one, |build| {
            let place = build.call(place_of, vec![index]);
            let author = place.and_then(|p| build.call(functions.between, vec![p]));
            let Some(value) = author.and_then(|a| build.call(functions.rest, vec![a])) else {
                return;
            };
            for (i, (ty, word, width)) in stored.members.iter().enumerate() {
                let member = access(build, value, i as u32);
                let member = match build.module().types[*ty].inner.scalar_kind() {
                    Some(ScalarKind::Uint) => member,
                    _ => bits(build, member, ScalarKind::Uint),
                };
                let at = stored.at(build, index, *word);
                build.call(stores[width], vec![at, member]);
            }
        });
        Rewrite::default()
    }))
}

/// `module` with the vertex entry point of that index reading what a compute pass stored.
///
/// # Errors
/// In words: our own text lacks something.
pub fn loaded(
    module: Module,
    vertex: usize,
    slots: Slots,
    stored: &Stored,
) -> Result<Module, String> {
    let widths = stored.widths();
    let wgsl = text::constants(slots, 0) + &text::points(slots, Points::Loaded, &widths);
    let Linked {
        mut module,
        ours: by_name,
    } = Linked::new(module, &wgsl)?;
    let index_of = ours(&by_name, "tessellated_index")?;
    let mut loads = BTreeMap::new();
    for width in widths {
        loads.insert(
            width,
            ours(&by_name, &format!("tessellated_load_{width}_"))?,
        );
    }
    let word = word(&mut module);
    let point = &mut module.entry_points[vertex].function;
    let result = point.result.clone();
    let ty = result.as_ref().map(|r| r.ty);
    *point = Function {
        name: point.name.clone(),
        result,
        ..Function::default()
    };
    let ty = ty.ok_or("the vertex stage gives nothing")?;
    Ok(place::rewritten(
        &module,
        FunctionId::EntryPoint(vertex),
        |build| {
            let inputs = vertex_inputs(build, word);
            let Some(index) = build.call(index_of, inputs) else {
                return Rewrite::default();
            };
            build.name(index, "index");
            let mut components = Vec::new();
            for (member, at, width) in &stored.members {
                let at = stored.at(build, index, *at);
                let Some(loaded) = build.call(loads[width], vec![at]) else {
                    continue;
                };
                let kind = build.module().types[*member].inner.scalar_kind();
                components.push(match kind {
                    Some(ScalarKind::Uint) | None => loaded,
                    Some(kind) => bits(build, loaded, kind),
                });
            }
            let value = build.expression(Expression::Compose { ty, components });
            build.statement(Statement::Return { value: Some(value) });
            Rewrite::default()
        },
    ))
}

/// The inputs of every vertex stage of ours.
fn vertex_inputs(build: &mut Builder<'_>, word: Handle<Type>) -> Vec<Handle<Expression>> {
    let inputs = [
        ("vertex", BuiltIn::VertexIndex),
        ("instance", BuiltIn::InstanceIndex),
    ];
    inputs
        .into_iter()
        .map(|(name, b)| build.argument(name, word, Some(Binding::BuiltIn(b))))
        .collect()
}
