//! Stored vertex results: a compute pass runs the vertex stage once per vertex and instance, and a
//! resolve loads the results.
//!
//! ```text
//! cs_vertices    each vertex of each instance    vs_corner(vertex, instance), its words stored
//! vs_kept(vertex, instance)                      the same, loaded
//! ```

use std::collections::BTreeMap;
use std::fmt::Write;

use naga::{
    BinaryOperator, Binding, BuiltIn, Expression, Function, Handle, Literal, Module, Scalar,
    ScalarKind, ShaderStage, Statement, Type, TypeInner, VectorSize,
};

use super::ids::new_entry;
use super::resolve::width;
use naga_edit::interface::Io;
use preshade_dataflow::graph::FunctionId;
use preshade_passes::rebuild::place::{self, CodeBuilder, Rewrite};
use preshade_passes::rebuild::snippet::{define, ours, word};

/// Name of the compute entry point.
pub(crate) const ENTRY: &str = "cs_vertices";
pub(crate) const BUFFER: &str = "visibility-vertices";
pub(crate) const WORKGROUP: u32 = 64;

/// The layout of a vertex in the buffer.
#[derive(Clone, Debug)]
pub(crate) struct KeptVertices {
    /// Type, components and first word of each output.
    members: Vec<(Handle<Type>, u8, u32)>,
    /// Words per vertex.
    pub words: u32,
    /// The vertex stage's result type, and whether its outputs are members.
    given: (Handle<Type>, bool),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Access {
    Store,
    Load,
}

impl KeptVertices {
    /// The layout of these outputs.
    ///
    /// # Errors
    /// The reason as text: an output does not consist of 32-bit numbers.
    pub fn of(
        module: &Module,
        outputs: &[Io],
        given: (Handle<Type>, bool),
    ) -> Result<Self, String> {
        let mut kept = Self {
            members: Vec::new(),
            words: 0,
            given,
        };
        for output in outputs {
            let inner = &module.types[output.ty].inner;
            if inner.scalar().is_none_or(|s| s.width != 4) {
                return Err(
                    "an output of the vertex stage is not made of 32-bit numbers".to_owned(),
                );
            }
            let width = width(inner);
            kept.members.push((output.ty, width, kept.words));
            kept.words += u32::from(width);
        }
        Ok(kept)
    }

    /// The buffer at this binding, and the functions that store or load its words.
    pub fn text(&self, group: u32, binding: u32, access: Access) -> String {
        let mode = match access {
            Access::Store => "read_write",
            Access::Load => "read",
        };
        let mut out = format!(
            "@group({group}) @binding({binding}) var<storage, {mode}> visibility_vertices: array<u32>;\n"
        );
        out.push_str(match access {
            Access::Store => INVOCATIONS,
            Access::Load => VERTEX,
        });
        let mut widths: Vec<u8> = self.members.iter().map(|m| m.1).collect();
        widths.sort_unstable();
        widths.dedup();
        for width in widths {
            let (ty, components): (_, &[&str]) = match width {
                1 => ("u32".to_owned(), &[""]),
                n => (
                    format!("vec{n}<u32>"),
                    &[".x", ".y", ".z", ".w"][..usize::from(n)],
                ),
            };
            let at = |i: usize| format!("visibility_vertices[at + {i}u]");
            let _ = match access {
                Access::Store => {
                    let stores: String = components
                        .iter()
                        .enumerate()
                        .map(|(i, c)| format!("    {} = value{c};\n", at(i)))
                        .collect();
                    write!(
                        out,
                        "fn visible_keep_{width}_(at: u32, value: {ty}) {{\n{stores}}}\n"
                    )
                }
                Access::Load => {
                    let loads: Vec<String> = (0..components.len()).map(at).collect();
                    let loads = loads.join(", ");
                    write!(
                        out,
                        "fn visible_kept_{width}_(at: u32) -> {ty} {{\n    return {ty}({loads});\n}}\n"
                    )
                }
            };
        }
        out
    }

    /// `NAME_kept(vertex, instance)`: loads a result.
    ///
    /// # Errors
    /// The reason as text: our own WGSL lacks a function.
    pub fn load(
        &self,
        mut module: Module,
        name: &str,
        by_name: &BTreeMap<String, Handle<Function>>,
    ) -> Result<(Module, Handle<Function>), String> {
        let word = word(&mut module);
        let place = ours(by_name, "visible_vertex")?;
        let mut loads = BTreeMap::new();
        for (_, width, _) in &self.members {
            loads.insert(*width, ours(by_name, &format!("visible_kept_{width}_"))?);
        }
        let arguments = [("vertex", word), ("instance", word)];
        let (ty, is_struct) = self.given;
        Ok(define(
            module,
            (name, "kept"),
            &arguments,
            ty,
            |build, passed| {
                let vertex = build.call(place, passed.to_vec());
                let Some(vertex) = vertex else { return };
                let mut components = Vec::new();
                for (ty, width, first) in &self.members {
                    let at = self.at(build, vertex, *first);
                    let Some(loaded) = build.call(loads[width], vec![at]) else {
                        return;
                    };
                    let kind = build.module().types[*ty].inner.scalar_kind();
                    components.push(match kind {
                        Some(kind) if kind != ScalarKind::Uint => bits(build, loaded, kind),
                        _ => loaded,
                    });
                }
                let value = match is_struct {
                    true => Some(build.expression(Expression::Compose { ty, components })),
                    false => components.pop(),
                };
                build.statement(Statement::Return { value });
            },
        ))
    }

    /// Adds the compute stage that stores the results of `corner`.
    ///
    /// # Errors
    /// The reason as text: our own WGSL lacks a function.
    pub fn store(
        &self,
        mut module: Module,
        corner: Handle<Function>,
        by_name: &BTreeMap<String, Handle<Function>>,
    ) -> Result<Module, String> {
        let names = [
            "visible_invocation",
            "visible_is_past",
            "visible_vertex_of",
            "visible_instance_of",
        ];
        let mut found = Vec::new();
        for name in names {
            found.push(ours(by_name, name)?);
        }
        let mut keeps = BTreeMap::new();
        for (_, width, _) in &self.members {
            keeps.insert(*width, ours(by_name, &format!("visible_keep_{width}_"))?);
        }
        let at = new_entry(&mut module, ShaderStage::Compute, ENTRY, None);
        module.entry_points[at].workgroup_size = [WORKGROUP, 1, 1];
        let mut is_written = false;
        let module = place::rewritten(&module, FunctionId::EntryPoint(at), |build| {
            is_written = self.write(build, corner, &found, &keeps).is_some();
            Rewrite::default()
        });
        match is_written {
            true => Ok(module),
            false => Err("a function of ours gives nothing".to_owned()),
        }
    }

    fn write(
        &self,
        build: &mut CodeBuilder<'_>,
        corner: Handle<Function>,
        found: &[Handle<Function>],
        keeps: &BTreeMap<u8, Handle<Function>>,
    ) -> Option<()> {
        let [invocation, is_past, vertex_of, instance_of] = found[..] else {
            return None;
        };
        let word = build.ty(TypeInner::Scalar(Scalar::U32));
        let triple = build.ty(TypeInner::Vector {
            size: VectorSize::Tri,
            scalar: Scalar::U32,
        });
        let group = Binding::BuiltIn(BuiltIn::WorkGroupId);
        let group = build.argument("group", triple, Some(group));
        let local = Binding::BuiltIn(BuiltIn::LocalInvocationIndex);
        let local = build.argument("local", word, Some(local));
        let number = build.call(invocation, vec![group, local])?;
        build.name(number, "number");
        let past = build.call(is_past, vec![number])?;
        build.if_then(past, |build| {
            build.statement(Statement::Return { value: None });
        });
        let vertex = build.call(vertex_of, vec![number])?;
        let instance = build.call(instance_of, vec![number])?;
        let value = build.call(corner, vec![vertex, instance])?;
        for (index, (ty, width, first)) in (0..).zip(&self.members) {
            let mut part = match self.given.1 {
                true => build.expression(Expression::AccessIndex { base: value, index }),
                false => value,
            };
            let kind = build.module().types[*ty].inner.scalar_kind();
            if kind != Some(ScalarKind::Uint) {
                part = bits(build, part, ScalarKind::Uint);
            }
            let at = self.at(build, number, *first);
            build.call(*keeps.get(width)?, vec![at, part]);
        }
        Some(())
    }

    /// The word of an output of a vertex.
    fn at(
        &self,
        build: &mut CodeBuilder<'_>,
        index: Handle<Expression>,
        word: u32,
    ) -> Handle<Expression> {
        let right = build.literal(Literal::U32(self.words));
        let left = build.expression(Expression::Binary {
            op: BinaryOperator::Multiply,
            left: index,
            right,
        });
        let right = build.literal(Literal::U32(word));
        build.expression(Expression::Binary {
            op: BinaryOperator::Add,
            left,
            right,
        })
    }
}

/// Bitcasts to another scalar kind.
fn bits(
    build: &mut CodeBuilder<'_>,
    value: Handle<Expression>,
    kind: ScalarKind,
) -> Handle<Expression> {
    build.expression(Expression::As {
        expr: value,
        kind,
        convert: None,
    })
}

const VERTEX: &str = "fn visible_vertex(vertex: u32, instance: u32) -> u32 {
    return (instance - visibility.first_instance) * visibility.counts.x + vertex;
}
";

const INVOCATIONS: &str = "fn visible_invocation(group: vec3<u32>, at: u32) -> u32 {
    return (group.y * 65535u + group.x) * 64u + at;
}
fn visible_is_past(number: u32) -> bool {
    return number >= visibility.counts.x * visibility.instances;
}
fn visible_vertex_of(number: u32) -> u32 {
    return number % visibility.counts.x;
}
fn visible_instance_of(number: u32) -> u32 {
    return visibility.first_instance + number / visibility.counts.x;
}
";
