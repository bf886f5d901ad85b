//! `form=static`: the hoisted values read nothing that changes after load, so each new vertex
//! computes them once.
//!
//! ```text
//! load:    vs_points(id)          -> store(hoisted(between'(corners)))       the slice of the vertex stage to the hoisted values
//! frame:   vs(vertex, instance)   -> between(corners), load(..)              position and varyings, as in the other forms
//! ```
//!
//! The clip position follows the camera, so every frame interpolates it, with the ends of an edge
//! ordered by position. At load they are ordered by index. At a seam the hoisted values of the two
//! sides may therefore differ in the last bits; positions never do.

use std::collections::BTreeSet;

use naga::{
    AddressSpace, Expression, Function, GlobalVariable, Handle, Module, Span, Statement, TypeInner,
};

use super::build::{self, Functions, access, vertex_inputs};
use super::split::Origin;
use super::stored::{self, Evaluation, Stored};
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_dataflow::slice::{self, Criterion, OutputFilter};
use preshade_passes::rebuild::place::{self, PositionInvariance, Rewrite};
use preshade_passes::rebuild::snippet::{ours, word};
use preshade_plan::plan::{BindingSource, BindingUse};
use preshade_plan::program::Program;

/// Reason if the slice reads neither the corners nor the place between them.
pub(crate) const NO_CORNERS: &str = "what was hoisted does not know its vertex";

/// `functions`' module with a compute entry point `name` that stores only the hoisted values of
/// every new vertex. `program` is any program of the same source.
///
/// # Errors
/// The reason as text: our own WGSL is incomplete or does not validate.
pub(crate) fn kept(
    program: &Program,
    functions: &Functions,
    vertex: usize,
    name: &str,
    layout: &Stored,
) -> Result<Module, String> {
    let whole = build::pulled(functions, vertex);
    let whole = program.with_module(whole).map_err(|e| e.to_string())?;
    let graph = Graph::build(&whole);
    let criteria: Vec<Criterion> = layout
        .indices()
        .map(|i| Criterion::Output(OutputFilter::Index(i as usize)))
        .collect();
    let slice = slice::backward(&graph, vertex, &criteria);
    let mut module = place::entry_point(
        &graph,
        &slice,
        whole.module(),
        &format!("{name}_of"),
        "kept",
        PositionInvariance::AsWritten,
    );
    let placed = module.entry_points.pop().ok_or("nothing was placed")?;
    let mut function = Function {
        name: Some(place::free_name(&module, name, "of")),
        ..placed.function
    };
    for argument in &mut function.arguments {
        argument.binding = None;
    }
    if let Some(result) = &mut function.result {
        result.binding = None;
    }
    if function.arguments.len() != 2 {
        return Err(NO_CORNERS.to_owned());
    }
    let function = module.functions.append(function, Span::UNDEFINED);
    let functions = Functions {
        module,
        ..functions.clone()
    };
    let evaluation = Evaluation::Function(function);
    stored::stored(&functions, vertex, name, layout, evaluation)
}

/// `functions`' module with a vertex entry point that interpolates the author's outputs and reads
/// the hoisted values.
///
/// # Errors
/// The reason as text: our own WGSL is incomplete.
pub(crate) fn read(
    functions: &Functions,
    vertex: usize,
    origins: &[Origin],
    layout: &Stored,
) -> Result<Module, String> {
    let mut module = functions.module.clone();
    let index_of = ours(&functions.ours, "tessellated_index")?;
    let loads = layout.loads(&functions.ours)?;
    let word = word(&mut module);
    let point = &mut module.entry_points[vertex].function;
    let result = point.result.clone();
    *point = Function {
        name: point.name.clone(),
        result: result.clone(),
        ..Function::default()
    };
    let ty = result.ok_or("the vertex stage gives nothing")?.ty;
    Ok(place::rewritten(
        &module,
        FunctionId::EntryPoint(vertex),
        |build| {
            let inputs = vertex_inputs(build, word);
            let place = build.call(functions.place, inputs.clone());
            let author = place.and_then(|p| build.call(functions.between, vec![p]));
            let index = build.call(index_of, inputs);
            let (Some(author), Some(index)) = (author, index) else {
                return Rewrite::default();
            };
            build.name(author, "author");
            build.name(index, "index");
            let components = (0..)
                .zip(origins)
                .filter_map(|(i, origin)| match origin {
                    Origin::Author(Some(of)) => Some(access(build, author, *of)),
                    Origin::Author(None) => Some(author),
                    Origin::Hoisted => layout.load(build, &loads, i, index),
                })
                .collect();
            let value = build.expression(Expression::Compose { ty, components });
            build.statement(Statement::Return { value: Some(value) });
            Rewrite::default()
        },
    ))
}

/// A variable that a program reads.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Read {
    pub group: u32,
    pub binding: u32,
    pub name: String,
    /// Member of a uniform struct. `None` for the whole variable.
    pub member: Option<String>,
}

impl std::fmt::Display for Read {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.member {
            // Member of an unnamed GLSL block.
            Some(member) if self.name.is_empty() => f.write_str(member),
            Some(member) => write!(f, "{}.{member}", self.name),
            None => f.write_str(&self.name),
        }
    }
}

/// The author's variables that a program with these `bindings` reads. Samplers are left out,
/// because they do not change.
pub(crate) fn reads(program: &Program, bindings: &[BindingUse]) -> BTreeSet<Read> {
    let module = program.module();
    let mut found = BTreeSet::new();
    for (handle, global) in module.global_variables.iter() {
        let Some(at) = global.binding else { continue };
        let is_author = |b: &&BindingUse| {
            (b.group, b.binding) == (at.group, at.binding) && b.source == BindingSource::Author
        };
        let is_sampler = matches!(module.types[global.ty].inner, TypeInner::Sampler { .. });
        if is_sampler || !bindings.iter().any(|b| is_author(&b)) {
            continue;
        }
        let read = |member: Option<String>| Read {
            group: at.group,
            binding: at.binding,
            name: global.name.clone().unwrap_or_default(),
            member,
        };
        match members(module, handle) {
            Some(members) => found.extend(members.into_iter().map(|m| read(Some(m)))),
            None => {
                found.insert(read(None));
            }
        }
    }
    found
}

/// The members of a uniform struct that are read. `None` if it is also read in another way.
fn members(module: &Module, global: Handle<GlobalVariable>) -> Option<BTreeSet<String>> {
    let variable = &module.global_variables[global];
    let TypeInner::Struct { members, .. } = &module.types[variable.ty].inner else {
        return None;
    };
    if variable.space != AddressSpace::Uniform {
        return None;
    }
    let entries = module.entry_points.iter().map(|e| &e.function);
    let functions = module.functions.iter().map(|(_, f)| f).chain(entries);
    let mut names = BTreeSet::new();
    for function in functions {
        let pointers: BTreeSet<Handle<Expression>> = function
            .expressions
            .iter()
            .filter(|(_, e)| **e == Expression::GlobalVariable(global))
            .map(|(h, _)| h)
            .collect();
        for (_, expression) in function.expressions.iter() {
            match expression {
                Expression::AccessIndex { base, index } if pointers.contains(base) => {
                    names.insert(members.get(*index as usize)?.name.clone()?);
                }
                other => {
                    let mut operands = naga_operands::of_expression(other).into_iter();
                    if operands.any(|o| pointers.contains(&o)) {
                        return None;
                    }
                }
            }
        }
        let mut is_passed = false;
        naga_operands::visit(&function.body, &mut |statement| {
            let used = naga_operands::of_statement(statement);
            is_passed |= used.iter().any(|e| pointers.contains(e));
        });
        if is_passed {
            return None;
        }
    }
    Some(names)
}
