//! The resolve pass: the author's two stages for the triangle that a pixel shows.
//!
//! ```text
//! fs_visible(at) -> id = ids[at]; discard where it is another draw's
//!                   a, b, c = vs_corner(each corner of the triangle, instance)
//!                   weights of a, b and c at this pixel, and at those of its quad for the gradients
//!                   fs_shaded(varyings by their own interpolation, builtins reconstructed, gradients)
//! ```

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    Binding, BuiltIn, Function, FunctionResult, Handle, Module, ScalarKind, ShaderStage, Span,
    Type, TypeInner,
};
use preshade_plan::draw_table::Words;

use super::gradients::{Explicit, GRADIENTS, Level};
use super::ids::{Facing, new_entry};
use super::legal::Stored;
use super::lists::Lists;
use super::stage::{ResolveStage, Shader, colors};
use super::stored_vertices::{Access, KeptVertices};
use super::text::{self, Slots};
use super::{Select, Vertices};
use crate::corner::{Author, corner};
use naga_edit::interface::{self, Io};
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_dataflow::slice::{self, Criterion, OutputFilter, Slice};
use preshade_passes::rebuild::outline::as_function;
use preshade_passes::rebuild::place::{self, PositionInvariance, Rewrite};
use preshade_passes::rebuild::snippet::{Linked, ours};
use preshade_plan::geometry::Formats;
use preshade_plan::plan::AttributeUse;
use preshade_plan::program::Program;
use preshade_plan::rasterizer::Corners;

pub(crate) const VERTEX: &str = "vs_visible";
pub(crate) const FRAGMENT: &str = "fs_visible";
pub(crate) const COMPUTE: &str = "cs_visible";

/// The inputs of the resolve pass.
pub(crate) struct Resolve<'a> {
    /// The graph of the author's program.
    pub graph: &'a Graph<'a>,
    /// The fragment stage without derivatives, sliced to its colours.
    pub explicit: Explicit,
    /// Index of that fragment stage.
    pub fragment: usize,
    /// Index of the author's vertex stage.
    pub vertex: usize,
    /// The author's attributes, to be fetched.
    pub attributes: &'a [AttributeUse],
    /// How the resolve determines the facing of a pixel.
    pub facing: Facing,
    /// How it skips the pixels of other draws.
    pub select: Select,
    pub runs: Runs,
    /// Allowed storage formats of attributes.
    pub formats: Formats,
    /// Words per id.
    pub words: Words,
    pub corners: Corners,
    pub lists: Lists,
    /// The source of the vertex results.
    pub vertices: Vertices,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Runs {
    /// In the fragment stage of a full-screen pass.
    Fragment,
    /// In a compute stage that writes these colours.
    Compute(Vec<Stored>),
}

/// Side of the compute workgroups, in pixels.
pub(crate) const WORKGROUP: u32 = 8;

/// A resolve stage and the attributes it fetches.
pub(crate) struct Built {
    pub module: Module,
    pub attributes: Vec<AttributeUse>,
    /// The stage that stores vertices for it, and the attributes that stage fetches.
    pub keeps: Option<Keeps>,
}

/// The compute stage that stores vertices.
pub(crate) struct Keeps {
    pub module: Module,
    pub attributes: Vec<AttributeUse>,
    /// Words per vertex.
    pub words: u32,
}

/// The criteria for the colours of a fragment stage.
pub(crate) fn colors_of(module: &Module, fragment: &Function) -> Vec<Criterion> {
    interface::outputs(module, fragment)
        .iter()
        .filter_map(|o| match o.binding {
            Some(Binding::Location { location, .. }) => {
                Some(Criterion::Output(OutputFilter::Location(location)))
            }
            _ => None,
        })
        .collect()
}

/// The program with a fragment entry point replaced by the slice of its colours.
///
/// # Errors
/// The slice does not validate, which is a bug.
pub(crate) fn shaded(graph: &Graph<'_>, colors: &Slice) -> Result<Program, String> {
    let program = graph.program();
    let name = format!(
        "{}_shaded",
        program.module().entry_points[colors.entry].name
    );
    let mut module = place::entry_point(
        graph,
        colors,
        program.module(),
        &name,
        "shaded",
        PositionInvariance::AsWritten,
    );
    module.entry_points.swap_remove(colors.entry);
    program.with_module(module).map_err(|e| e.to_string())
}

/// The fragment stage as functions.
struct Shaders {
    module: Module,
    result: Option<FunctionResult>,
    shade: Shader,
    /// The functions of the gradients.
    levels: Vec<(Level, Shader)>,
}

impl Shaders {
    fn new(explicit: Explicit, fragment: usize) -> Self {
        let mut module = explicit.program.module().clone();
        let shaded = module.entry_points.remove(fragment);
        let result = shaded.function.result.clone();
        let bindings: Vec<Vec<Binding>> = shaded
            .function
            .arguments
            .iter()
            .map(|a| match (&a.binding, interface::members(&module, a.ty)) {
                (Some(binding), _) => vec![binding.clone()],
                (None, members) => members
                    .unwrap_or_default()
                    .into_iter()
                    .map(|m| m.1)
                    .collect(),
            })
            .collect();
        let name = shaded.name.clone();
        let shaded = as_function(&module, shaded.function, &name);
        let shaded = module.functions.append(shaded, Span::UNDEFINED);
        let shade = Shader::new(&module, shaded, &bindings);
        let levels = explicit
            .levels
            .into_iter()
            .map(|level| {
                let shader = Shader::new(&module, level.function, &level.arguments);
                (level, shader)
            })
            .collect();
        Self {
            module,
            result,
            shade,
            levels,
        }
    }

    /// Locations of the author's varyings that the functions read.
    fn read(&self) -> BTreeSet<u32> {
        let levels = self.levels.iter().flat_map(|(_, s)| s.inputs());
        let all = levels.chain(self.shade.inputs());
        all.filter_map(|(_, b)| match b {
            Binding::Location { location, .. } if *location < GRADIENTS => Some(*location),
            _ => None,
        })
        .collect()
    }
}

impl Resolve<'_> {
    /// The module with the resolve pass's entry points.
    ///
    /// # Errors
    /// The reason as text: our own WGSL does not parse or link, or the stages do not fit together.
    pub fn build(self, slots: Slots) -> Result<Built, String> {
        let Self {
            graph,
            explicit,
            fragment,
            vertex,
            attributes,
            facing,
            select,
            runs,
            formats,
            words,
            corners,
            lists,
            vertices,
        } = self;
        let shaders = Shaders::new(explicit, fragment);
        let read = shaders.read();
        let Shaders {
            module,
            result,
            shade,
            levels,
        } = shaders;
        let (module, author) = author(graph, &module, vertex, &read)?;
        let used = used(&module, &author, attributes);
        let name = graph.module().entry_points[vertex].name.clone();
        let called = Author {
            function: author.function,
            given: author.given,
            inputs: &author.inputs,
        };
        let kept = match vertices {
            Vertices::Refetched => None,
            Vertices::Kept => {
                let given = (author.given, author.is_struct);
                Some(KeptVertices::of(&module, &author.outputs, given)?)
            }
        };
        let (used, keeps) = match &kept {
            None => (used, None),
            Some(kept) => {
                let module = keep(&module, kept, (&name, &called), slots, &used, formats)?;
                let keeps = Keeps {
                    module,
                    attributes: used,
                    words: kept.words,
                };
                (Vec::new(), Some(keeps))
            }
        };
        let widths = author.widths(&module);
        let mut wgsl = text::entry(slots, used.len());
        wgsl.push_str(&text::vertices(slots, &used, formats));
        wgsl.push_str(&text::resolve(slots, &widths, words, corners));
        let mut first = slots.first + Slots::STREAMS + used.len() as u32;
        if let Some(kept) = &kept {
            wgsl.push_str(&kept.text(slots.group, first, Access::Load));
            first += 1;
        }
        if let Runs::Compute(targets) = &runs {
            wgsl.push_str(&text::compute(slots.group, first, targets));
            first += targets.len() as u32;
        }
        match (&runs, lists) {
            (Runs::Fragment, Lists::None) => wgsl.push_str(text::SCREEN),
            _ => wgsl.push_str(&lists.read(slots.group, first)),
        }
        let Linked {
            module,
            ours: by_name,
        } = Linked::new(module, &wgsl)?;
        let (mut module, corner) = match &kept {
            Some(kept) => kept.load(module, &name, &by_name)?,
            None => corner(module, &name, &called, &fetched(&used, &by_name)?)?,
        };
        let result = result.ok_or("the fragment stage gives no colour")?;
        let stage = ResolveStage {
            corner,
            author: &author,
            shade: &shade,
            levels: &levels,
            ours: &by_name,
            facing,
            select,
            colors: colors(&module, &result),
            position: author
                .position()
                .ok_or("the vertex stage gives no position")?,
        };
        let FunctionResult { ty, binding } = result;
        let at = match runs {
            Runs::Fragment => {
                let result = Some((ty, binding));
                new_entry(&mut module, ShaderStage::Fragment, FRAGMENT, result)
            }
            Runs::Compute(_) => {
                let at = new_entry(&mut module, ShaderStage::Compute, COMPUTE, None);
                module.entry_points[at].workgroup_size = [WORKGROUP, WORKGROUP, 1];
                at
            }
        };
        let mut failed = None;
        let module = place::rewritten(&module, FunctionId::EntryPoint(at), |build| {
            failed = stage.write(build, &runs);
            Rewrite::default()
        });
        match failed {
            None => Ok(Built {
                module,
                attributes: used,
                keeps,
            }),
            Some(why) => Err(why),
        }
    }
}

/// The attributes that the author's vertex stage reads.
fn used(module: &Module, author: &VertexStage, all: &[AttributeUse]) -> Vec<AttributeUse> {
    let inputs = interface::opened(module, &author.inputs);
    let read = |a: &&AttributeUse| {
        inputs.iter().any(|i| {
            matches!(i.binding, Some(Binding::Location { location, .. }) if location == a.location)
        })
    };
    all.iter().filter(read).cloned().collect()
}

/// The generated functions that fetch these attributes, by location.
fn fetched(
    attributes: &[AttributeUse],
    by_name: &BTreeMap<String, Handle<Function>>,
) -> Result<Vec<(u32, Handle<Function>)>, String> {
    let one = |a: &AttributeUse| {
        let name = format!("visible_{}_", a.location);
        Ok((a.location, ours(by_name, &name)?))
    };
    attributes.iter().map(one).collect()
}

/// The module with the compute stage that stores vertices.
fn keep(
    module: &Module,
    kept: &KeptVertices,
    (name, called): (&str, &Author<'_>),
    slots: Slots,
    attributes: &[AttributeUse],
    formats: Formats,
) -> Result<Module, String> {
    let mut wgsl = text::entry(slots, attributes.len());
    wgsl.push_str(&text::vertices(slots, attributes, formats));
    let binding = slots.first + Slots::STREAMS + attributes.len() as u32;
    wgsl.push_str(&kept.text(slots.group, binding, Access::Store));
    let Linked {
        module,
        ours: by_name,
    } = Linked::new(module.clone(), &wgsl)?;
    let (module, corner) = corner(module, name, called, &fetched(attributes, &by_name)?)?;
    kept.store(module, corner, &by_name)
}

/// The needed part of the author's vertex stage, as a function.
pub struct VertexStage {
    function: Handle<Function>,
    given: Handle<Type>,
    inputs: Vec<naga::FunctionArgument>,
    pub outputs: Vec<Io>,
    /// Whether its outputs are members of a struct.
    pub is_struct: bool,
}

/// Adds the author's vertex stage to `onto`, sliced to the position and the locations that are
/// read. `onto` contains everything in the author's module, with the same handles.
fn author(
    graph: &Graph<'_>,
    onto: &Module,
    vertex: usize,
    read: &BTreeSet<u32>,
) -> Result<(Module, VertexStage), String> {
    let mut criteria = vec![Criterion::Output(OutputFilter::Position)];
    let locations = read.iter();
    criteria.extend(locations.map(|l| Criterion::Output(OutputFilter::Location(*l))));
    let slice = slice::backward(graph, vertex, &criteria);
    let name = format!("{}_author", graph.module().entry_points[vertex].name);
    let mut module = place::entry_point(
        graph,
        &slice,
        onto,
        &name,
        "author",
        PositionInvariance::AsWritten,
    );
    let placed = module.entry_points.pop().ok_or("nothing was placed")?;
    let outputs = interface::outputs(&module, &placed.function);
    let result = placed.function.result.as_ref();
    let result = result.ok_or("the vertex stage gives nothing")?;
    let (given, is_struct) = (result.ty, result.binding.is_none());
    let inputs = placed.function.arguments.clone();
    let function = as_function(&module, placed.function, &name);
    let function = module.functions.append(function, Span::UNDEFINED);
    let stage = VertexStage {
        function,
        given,
        inputs,
        outputs,
        is_struct,
    };
    Ok((module, stage))
}

impl VertexStage {
    fn position(&self) -> Option<u32> {
        let is =
            |b: &Option<Binding>| matches!(b, Some(Binding::BuiltIn(BuiltIn::Position { .. })));
        self.outputs
            .iter()
            .position(|o| is(&o.binding))
            .map(|i| i as u32)
    }

    /// The output at a location, and its index.
    pub fn output(&self, location: u32) -> Option<(u32, &Io)> {
        let is = |o: &Io| matches!(o.binding, Some(Binding::Location { location: l, .. }) if l == location);
        let found = self.outputs.iter().position(is)?;
        Some((found as u32, &self.outputs[found]))
    }

    /// Distinct widths of the interpolated outputs.
    fn widths(&self, module: &Module) -> Vec<u8> {
        let widths: BTreeSet<u8> = self
            .outputs
            .iter()
            .filter(|o| matches!(&o.binding, Some(Binding::Location { .. })))
            .filter(|o| module.types[o.ty].inner.scalar_kind() == Some(ScalarKind::Float))
            .map(|o| width(&module.types[o.ty].inner))
            .collect();
        widths.into_iter().collect()
    }
}

/// Number of components of a scalar or vector.
pub(crate) fn width(inner: &TypeInner) -> u8 {
    match inner {
        TypeInner::Vector { size, .. } => *size as u8,
        _ => 1,
    }
}
