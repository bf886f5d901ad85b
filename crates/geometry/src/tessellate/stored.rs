//! Stores new vertices in a buffer: the compute stage that writes them and the vertex stage that
//! loads them.

use std::collections::BTreeMap;

use naga::{
    BinaryOperator, Binding, BuiltIn, Expression, Function, Handle, Literal, Module, Scalar,
    ScalarKind, ShaderStage, Span, Statement, Type, TypeInner, VectorSize,
};

use super::Slots;
use super::build::{Functions, access, vertex_inputs};
use super::text::{self, Points, WORKGROUP};
use preshade_dataflow::graph::FunctionId;
use preshade_passes::rebuild::place::{self, CodeBuilder, Rewrite};
use preshade_passes::rebuild::snippet::{Linked, ours, word};

/// A member of a vertex stage's result in the buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Member {
    index: u32,
    ty: Handle<Type>,
    /// Offset in words.
    word: u32,
    /// Size in words.
    width: u8,
}

/// The layout of a new vertex in the buffer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Stored {
    members: Vec<Member>,
    /// Words per vertex.
    pub words: u32,
}

impl Stored {
    /// The layout of these members, by index, of a vertex stage's result type.
    ///
    /// # Errors
    /// The reason as text: a member does not consist of 32-bit numbers.
    pub fn of(
        module: &Module,
        result: Handle<Type>,
        stored_too: impl Fn(u32) -> bool,
    ) -> Result<Self, String> {
        let TypeInner::Struct { members, .. } = &module.types[result].inner else {
            return Err("the vertex stage gives no struct".to_owned());
        };
        let mut stored = Self {
            members: Vec::new(),
            words: 0,
        };
        for (index, member) in (0..).zip(members) {
            if !stored_too(index) {
                continue;
            }
            let width = match &module.types[member.ty].inner {
                TypeInner::Scalar(s) if s.width == 4 => 1,
                TypeInner::Vector { size, scalar } if scalar.width == 4 => *size as u8,
                _ => return Err("a varying is not made of 32-bit numbers".to_owned()),
            };
            stored.members.push(Member {
                index,
                ty: member.ty,
                word: stored.words,
                width,
            });
            stored.words += u32::from(width);
        }
        Ok(stored)
    }

    /// Distinct widths of the members.
    pub fn widths(&self) -> Vec<u8> {
        let mut widths: Vec<u8> = self.members.iter().map(|m| m.width).collect();
        widths.sort_unstable();
        widths.dedup();
        widths
    }

    /// Indices of the members in the result.
    pub fn indices(&self) -> impl Iterator<Item = u32> {
        self.members.iter().map(|m| m.index)
    }

    /// Loads a member of a vertex from the buffer. `None` if it is not stored, or if our own WGSL
    /// is incomplete.
    pub(super) fn load(
        &self,
        build: &mut CodeBuilder<'_>,
        loads: &BTreeMap<u8, Handle<Function>>,
        index: u32,
        vertex: Handle<Expression>,
    ) -> Option<Handle<Expression>> {
        let member = self.members.iter().find(|m| m.index == index)?;
        let at = self.at(build, vertex, member.word);
        let loaded = build.call(*loads.get(&member.width)?, vec![at])?;
        let kind = build.module().types[member.ty].inner.scalar_kind();
        Some(match kind {
            Some(ScalarKind::Uint) | None => loaded,
            Some(kind) => bits(build, loaded, kind),
        })
    }

    /// The generated functions that load the members, by width.
    ///
    /// # Errors
    /// The reason as text: our own WGSL is incomplete.
    pub(super) fn loads(
        &self,
        by_name: &BTreeMap<String, Handle<Function>>,
    ) -> Result<BTreeMap<u8, Handle<Function>>, String> {
        let one = |width: u8| Ok((width, ours(by_name, &format!("tessellated_load_{width}_"))?));
        self.widths().into_iter().map(one).collect()
    }

    /// The word offset of a member of a vertex.
    fn at(
        &self,
        build: &mut CodeBuilder<'_>,
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

/// Bitcasts a 32-bit number or vector.
fn bits(
    build: &mut CodeBuilder<'_>,
    expr: Handle<Expression>,
    kind: ScalarKind,
) -> Handle<Expression> {
    build.expression(Expression::As {
        expr,
        kind,
        convert: None,
    })
}

/// The values that a compute stage stores.
#[derive(Clone, Copy)]
pub(crate) enum Evaluation {
    /// The vertex stage's whole result.
    Vertex,
    /// The result of this function of (vertex, instance): the stored members in order, or the only
    /// one.
    Function(Handle<Function>),
}

/// `functions`' module with a compute entry point that evaluates and stores every new vertex.
///
/// # Errors
/// The reason as text: our own WGSL is incomplete.
pub(crate) fn stored(
    functions: &Functions,
    vertex: usize,
    name: &str,
    stored: &Stored,
    evaluation: Evaluation,
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
    let (index_of, is_one) = (ours("tessellated_index")?, ours("tessellated_is_one")?);
    let is_only = match evaluation {
        Evaluation::Vertex => false,
        Evaluation::Function(function) => {
            let result = module.functions[function].result.as_ref();
            !result.is_some_and(|r| matches!(module.types[r.ty].inner, TypeInner::Struct { .. }))
        }
    };
    let of_index = [
        ours("tessellated_vertex_of")?,
        ours("tessellated_instance_of")?,
    ];
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
            let at = of_index.map(|f| build.call(f, vec![index]));
            let at: Vec<_> = at.into_iter().flatten().collect();
            let value = match evaluation {
                Evaluation::Function(function) => build.call(function, at),
                Evaluation::Vertex => {
                    let place = build.call(functions.place, at);
                    let author = place.and_then(|p| build.call(functions.between, vec![p]));
                    author.and_then(|a| build.call(functions.rest, vec![a]))
                }
            };
            let Some(value) = value else { return };
            for (i, stored_member) in (0..).zip(&stored.members) {
                let member = match evaluation {
                    Evaluation::Vertex => access(build, value, stored_member.index),
                    Evaluation::Function(_) if is_only => value,
                    Evaluation::Function(_) => access(build, value, i),
                };
                let kind = build.module().types[stored_member.ty].inner.scalar_kind();
                let member = match kind {
                    Some(ScalarKind::Uint) => member,
                    _ => bits(build, member, ScalarKind::Uint),
                };
                let at = stored.at(build, index, stored_member.word);
                build.call(stores[&stored_member.width], vec![at, member]);
            }
        });
        Rewrite::default()
    }))
}

/// `module` with a vertex entry point that reads the vertices that a compute pass stored.
///
/// # Errors
/// The reason as text: our own WGSL is incomplete.
pub(crate) fn loaded(
    module: Module,
    vertex: usize,
    slots: Slots,
    stored: &Stored,
) -> Result<Module, String> {
    let widths = stored.widths();
    let wgsl = text::constants(slots, 0, None) + &text::points(slots, Points::Loaded, &widths);
    let Linked {
        mut module,
        ours: by_name,
    } = Linked::new(module, &wgsl)?;
    let index_of = ours(&by_name, "tessellated_index")?;
    let loads = stored.loads(&by_name)?;
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
            let components = stored
                .indices()
                .filter_map(|member| stored.load(build, &loads, member, index))
                .collect();
            let value = build.expression(Expression::Compose { ty, components });
            build.statement(Statement::Return { value: Some(value) });
            Rewrite::default()
        },
    ))
}
