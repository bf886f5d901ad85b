//! The new vertex stage: the author's, then the hoisted work.
//!
//! ```text
//! fn vs_author(..) -> VertexOutput_author          the author's, sliced to the outputs still needed
//! fn hoisted(..) -> Hoisted
//! @vertex fn vs(..) -> VertexOutput_hoist {
//!     let author = vs_author(..);
//!     let carried = hoisted(author.normal, ..);
//!     return VertexOutput_hoist(author.position, author.uv, carried.specular);
//! }
//! ```
//!
//! They are two functions so that a tessellated version can call the first for three corners and
//! the second for each new vertex.

use std::collections::BTreeSet;

use naga::{
    Binding, Expression, FunctionResult, Handle, Module, Span, StructMember, Type, TypeInner,
};

use super::pack::VaryingSlot;
use super::remainder::{slot_binding, slot_name, slot_type, width};
use crate::rebuild::outline::{self, Failed, Hoisted, Wanted};
use crate::rebuild::place::{self, PositionInvariance, Rewrite};
use naga_edit::interface;
use preshade_dataflow::graph::Graph;
use preshade_dataflow::slice::{self, Criterion, OutputFilter};
use preshade_plan::program::Program;

/// The outputs of the new vertex stage.
pub(crate) struct Outputs<'a> {
    /// Locations of the author's varyings that the fragment stage still reads.
    pub kept: &'a BTreeSet<u32>,
    /// The moved values.
    pub wanted: &'a [Wanted],
    pub slots: &'a [VaryingSlot],
    /// By slot.
    pub locations: &'a [u32],
}

/// `module` with its vertex entry point calling the author's stage and `hoisted`.
///
/// # Errors
/// [`Failed`].
pub(crate) fn rebuild(
    program: &Program,
    module: Module,
    vertex: usize,
    hoisted: &Hoisted,
    outputs: &Outputs<'_>,
) -> Result<Module, Failed> {
    let (hoisted, arguments) = (hoisted.function, &hoisted.arguments);
    let needed: BTreeSet<u32> = arguments
        .iter()
        .flatten()
        .chain(outputs.kept)
        .copied()
        .collect();
    let mut module = sliced(&program.with_module(module)?, vertex, &needed);
    let Some(placed) = module.entry_points.pop() else {
        return Err(Failed::Built("nothing was placed".to_owned()));
    };
    let name = module.entry_points[vertex].name.clone();
    let given = interface::outputs(&module, &placed.function);
    let is_struct = placed.function.result.as_ref().is_some_and(|r| {
        r.binding.is_none() && matches!(module.types[r.ty].inner, TypeInner::Struct { .. })
    });
    let inputs = placed.function.arguments.clone();
    let struct_name = placed
        .function
        .result
        .as_ref()
        .and_then(|r| module.types[r.ty].name.clone());
    let author = outline::as_function(&module, placed.function, &format!("{name}_author"));
    let author = module.functions.append(author, Span::UNDEFINED);
    let (result, of_result) = result_type(&mut module, &given, struct_name, outputs);
    let hoisted_types: Vec<Handle<Type>> = module.functions[hoisted]
        .arguments
        .iter()
        .map(|a| a.ty)
        .collect();
    let entry = &mut module.entry_points[vertex].function;
    *entry = naga::Function {
        name: Some(name),
        result: Some(FunctionResult {
            ty: result,
            binding: None,
        }),
        ..naga::Function::default()
    };
    let mut failed = None;
    let module = place::rewritten(
        &module,
        preshade_dataflow::graph::FunctionId::EntryPoint(vertex),
        |build| {
            let Some(from_author) = build.call_with_inputs(author, &inputs) else {
                failed = Some(Failed::Built("the vertex stage gives nothing".to_owned()));
                return Rewrite::default();
            };
            build.name(from_author, "author");
            let output = |build: &mut place::CodeBuilder<'_>, index: usize| match is_struct {
                true => build.expression(Expression::AccessIndex {
                    base: from_author,
                    index: index as u32,
                }),
                false => from_author,
            };
            let mut passed = Vec::new();
            for (locations, ty) in arguments.iter().zip(&hoisted_types) {
                let mut members = Vec::new();
                for location in locations {
                    match given.iter().position(|io| is_at(io, *location)) {
                        Some(index) => members.push(output(build, index)),
                        None => {
                            failed = Some(Failed::NoOutput(*location));
                            return Rewrite::default();
                        }
                    }
                }
                let is_struct = matches!(build.module().types[*ty].inner, TypeInner::Struct { .. });
                passed.push(match (is_struct, &members[..]) {
                    (false, [one]) => *one,
                    _ => build.expression(Expression::Compose {
                        ty: *ty,
                        components: members,
                    }),
                });
            }
            let Some(carried) = build.call(hoisted, passed) else {
                failed = Some(Failed::Built("nothing is hoisted".to_owned()));
                return Rewrite::default();
            };
            build.name(carried, "carried");
            let values = each(build, outputs, carried);
            let mut components = Vec::new();
            for source in &of_result {
                components.push(match source {
                    OutputSource::Author(index) => output(build, *index),
                    OutputSource::Slot(slot) => pack(build, outputs, &values, *slot),
                });
            }
            let value = build.expression(Expression::Compose {
                ty: result,
                components,
            });
            build.statement(naga::Statement::Return { value: Some(value) });
            Rewrite::default()
        },
    );
    match failed {
        Some(why) => Err(why),
        None => Ok(module),
    }
}

/// The module with the slice of a vertex stage to the position and some locations, as its last entry
/// point.
fn sliced(program: &Program, vertex: usize, locations: &BTreeSet<u32>) -> Module {
    let graph = Graph::build(program);
    let location = |l: &u32| Criterion::Output(OutputFilter::Location(*l));
    let mut criteria = vec![Criterion::Output(OutputFilter::Rasterization)];
    criteria.extend(locations.iter().map(location));
    let slice = slice::backward(&graph, vertex, &criteria);
    place::entry_point(
        &graph,
        &slice,
        program.module(),
        "preshade_author",
        "author",
        PositionInvariance::AsWritten,
    )
}

/// The interpolated values, each by itself.
fn each(
    build: &mut place::CodeBuilder<'_>,
    outputs: &Outputs<'_>,
    all: Handle<Expression>,
) -> Vec<Handle<Expression>> {
    let member = |index| build.expression(Expression::AccessIndex { base: all, index });
    match outputs.wanted {
        [_] => vec![all],
        several => (0..several.len() as u32).map(member).collect(),
    }
}

/// The varying of a slot, composed of its values.
fn pack(
    build: &mut place::CodeBuilder<'_>,
    outputs: &Outputs<'_>,
    values: &[Handle<Expression>],
    slot: usize,
) -> Handle<Expression> {
    let slot = &outputs.slots[slot];
    let parts: Vec<_> = slot.parts.iter().map(|(i, _)| values[*i]).collect();
    match parts[..] {
        [one] if width(&outputs.wanted[slot.parts[0].0].inner) == slot.width => one,
        _ => {
            let ty = build.ty(slot_type(slot));
            build.expression(Expression::Compose {
                ty,
                components: parts,
            })
        }
    }
}

fn is_at(io: &interface::Io, wanted: u32) -> bool {
    matches!(io.binding, Some(Binding::Location { location, .. }) if location == wanted)
}

/// The source of a member of the result.
enum OutputSource {
    /// An output of the author's stage, by index.
    Author(usize),
    /// A varying with moved values, by index.
    Slot(usize),
}

fn result_type(
    module: &mut Module,
    given: &[interface::Io],
    name: Option<String>,
    outputs: &Outputs<'_>,
) -> (Handle<Type>, Vec<OutputSource>) {
    let mut members = Vec::new();
    let mut sources = Vec::new();
    for (index, io) in given.iter().enumerate() {
        let goes_on = match &io.binding {
            Some(Binding::Location { location, .. }) => outputs.kept.contains(location),
            Some(Binding::BuiltIn(_)) => true,
            None => false,
        };
        if goes_on {
            members.push(StructMember {
                name: Some(io.name.clone().unwrap_or_else(|| "position".to_owned())),
                ty: io.ty,
                binding: io.binding.clone(),
                offset: 0,
            });
            sources.push(OutputSource::Author(index));
        }
    }
    for (index, slot) in outputs.slots.iter().enumerate() {
        let ty = module.types.insert(
            Type {
                name: None,
                inner: slot_type(slot),
            },
            Span::UNDEFINED,
        );
        members.push(StructMember {
            name: Some(slot_name(index, slot, outputs.wanted)),
            ty,
            binding: Some(slot_binding(slot, outputs.locations[index])),
            offset: 0,
        });
        sources.push(OutputSource::Slot(index));
    }
    let base = name.unwrap_or_else(|| "VertexOutput".to_owned());
    let base = base.strip_suffix("_author").unwrap_or(&base).to_owned();
    let ty = place::io_struct(module, Some(format!("{base}_hoist")), members);
    (ty, sources)
}
