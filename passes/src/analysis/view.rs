//! Finds the uniforms that follow the viewer: by name and type, the matrix that leads to the clip
//! position, and those that the user names.

use std::collections::BTreeSet;

use naga::{
    AddressSpace, BinaryOperator, Binding, BuiltIn, Expression, GlobalVariable, Handle, Module,
    ShaderStage, Type, TypeInner, VectorSize,
};

use crate::analysis::values::{ContextId, Node, ValueId, Values};
use preshade_dataflow::graph::Graph;
use preshade_plan::program::Program;

pub mod names;

pub use names::is_axis;

/// The user's statements about uniforms, by their paths ([`parts`]).
#[derive(Clone, Debug, Default)]
pub(crate) struct StatedUniforms {
    /// Paths of uniforms that follow the viewer.
    pub follow: Vec<String>,
    /// Paths of uniforms that do not, whatever their names suggest.
    pub stay: Vec<String>,
}

/// The uniforms that the stages of a program read and that follow the viewer: variables, or members
/// as `VARIABLE.MEMBER`. `verify` takes these from the light and all others from the camera.
pub(crate) fn view_dependent(program: &Program, said: &StatedUniforms) -> Vec<String> {
    let graph = Graph::build(program);
    let points = program.module().entry_points.iter();
    let stage = |of: ShaderStage| points.clone().position(|point| point.stage == of);
    let stages = (stage(ShaderStage::Vertex), stage(ShaderStage::Fragment));
    of_stages(&graph, stages, said)
}

/// [`view_dependent`] of a vertex and a fragment entry point.
pub(crate) fn of_stages(
    graph: &Graph<'_>,
    (vertex, fragment): (Option<usize>, Option<usize>),
    said: &StatedUniforms,
) -> Vec<String> {
    let module = graph.module();
    let all = paths(module);
    let mut found: BTreeSet<String> = all
        .iter()
        .filter(|path| path.follows(module))
        .map(|path| path.text(module))
        .collect();
    let mut read = BTreeSet::new();
    let mut is_known = true;
    for stage in [vertex, fragment].into_iter().flatten() {
        let Ok(values) = Values::new(graph, stage) else {
            is_known = false;
            continue;
        };
        read.extend((0..values.values.len()).filter_map(|value| read_path(&values, value)));
        if vertex == Some(stage) {
            found.extend(to_clip(&values));
        }
    }
    found.extend(said.follow.iter().cloned());
    let is_read = |name: &String| !is_known || read.iter().any(|path| is_part(path, name));
    // Variables at one binding share the host's buffer.
    let binding = |path: &Path| module.global_variables[path.variable].binding;
    let is_of_twin = |path: &Path| {
        let mut twins = all.iter().filter(|other| {
            other.variable != path.variable
                && binding(path).is_some()
                && binding(other) == binding(path)
        });
        twins.any(|other| is_read(&other.text(module)))
    };
    let stays = |name: &String| said.stay.iter().any(|own| is_part(own, name));
    let ordered = all.iter().map(|path| (path, path.text(module)));
    let ordered = ordered.filter(|(path, name)| {
        found.contains(name) && (is_read(name) || is_of_twin(path)) && !stays(name)
    });
    let mut listed: Vec<String> = Vec::new();
    for (_, name) in ordered {
        // The name of a whole variable includes its members.
        let is_listed = |whole: &String| name.starts_with(&format!("{whole}."));
        if !listed.iter().any(is_listed) {
            listed.push(name);
        }
    }
    listed
}

/// The paths of all uniforms and their members, in order.
pub(crate) fn parts(module: &Module) -> Vec<String> {
    paths(module).iter().map(|path| path.text(module)).collect()
}

/// Whether a value is a read of one of these uniforms ([`view_dependent`]), or of a part of one, or
/// of a whole that one is a part of.
pub(crate) fn is_read(values: &Values<'_, '_>, value: ValueId, names: &[String]) -> bool {
    let path = read_path(values, value);
    path.is_some_and(|path| names.iter().any(|name| is_part(&path, name)))
}

/// Whether one of two paths is the other, or leads to it.
fn is_part(a: &str, b: &str) -> bool {
    let (long, short) = if a.len() < b.len() { (b, a) } else { (a, b) };
    long.strip_prefix(short)
        .is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

/// A uniform, or a member of one.
#[derive(Clone, Debug)]
pub struct Path {
    variable: Handle<GlobalVariable>,
    members: Vec<u32>,
    ty: Handle<Type>,
}

impl Path {
    /// The types on the path, from the variable's on, each with the name of the variable or member.
    fn steps<'m>(&self, module: &'m Module) -> Vec<(&'m str, Handle<Type>)> {
        let global = &module.global_variables[self.variable];
        let mut ty = global.ty;
        let mut steps = vec![(global.name.as_deref().unwrap_or_default(), ty)];
        for index in &self.members {
            let TypeInner::Struct { members, .. } = &module.types[ty].inner else {
                break;
            };
            let Some(member) = members.get(*index as usize) else {
                break;
            };
            ty = member.ty;
            steps.push((member.name.as_deref().unwrap_or_default(), ty));
        }
        steps
    }

    fn text(&self, module: &Module) -> String {
        let steps = self.steps(module);
        let names: Vec<&str> = steps.iter().map(|(name, _)| *name).collect();
        names.join(".")
    }
}

/// All uniforms, and below each its members.
fn paths(module: &Module) -> Vec<Path> {
    let mut found = Vec::new();
    for (variable, global) in module.global_variables.iter() {
        if !is_uniform(global.space) {
            continue;
        }
        let mut work = vec![Path {
            variable,
            members: Vec::new(),
            ty: global.ty,
        }];
        while let Some(path) = work.pop() {
            if let TypeInner::Struct { members, .. } = &module.types[path.ty].inner {
                work.extend(
                    (0..members.len() as u32)
                        .zip(members)
                        .rev()
                        .map(|(index, member)| {
                            let mut members = path.members.clone();
                            members.push(index);
                            Path {
                                variable,
                                members,
                                ty: member.ty,
                            }
                        }),
                );
            }
            found.push(path);
        }
    }
    found
}

fn is_uniform(space: AddressSpace) -> bool {
    matches!(space, AddressSpace::Uniform | AddressSpace::Immediate)
}

/// The path of the uniform, or member of one, that a value is a read of.
fn read_path(values: &Values<'_, '_>, value: ValueId) -> Option<String> {
    let Node::Expression(context, e, path) = &values.values[value].node else {
        return None;
    };
    let module = values.graph.module();
    let (mut context, mut steps) = (*context, Vec::new());
    let Expression::Load { mut pointer } = values.function(context).function.expressions[*e] else {
        return None;
    };
    let variable = loop {
        match values.function(context).function.expressions[pointer] {
            Expression::AccessIndex { base, index } => {
                steps.push(Some(index));
                pointer = base;
            }
            Expression::Access { base, .. } => {
                steps.push(None);
                pointer = base;
            }
            Expression::GlobalVariable(variable) => break variable,
            Expression::FunctionArgument(i) => {
                let (caller, call) = values.contexts[context].call?;
                let outer = values.function(caller).statements.get(call).statement;
                let naga::Statement::Call { arguments, .. } = outer else {
                    return None;
                };
                (context, pointer) = (caller, *arguments.get(i as usize)?);
            }
            _ => return None,
        }
    };
    let global = &module.global_variables[variable];
    if !is_uniform(global.space) {
        return None;
    }
    // Elements and components are no parts of their own.
    let all = steps
        .into_iter()
        .rev()
        .chain(path.iter().copied().map(Some));
    let mut ty = global.ty;
    let mut members = Vec::new();
    for step in all {
        let (TypeInner::Struct { members: own, .. }, Some(index)) = (&module.types[ty].inner, step)
        else {
            break;
        };
        let Some(member) = own.get(index as usize) else {
            break;
        };
        members.push(index);
        ty = member.ty;
    }
    let path = Path {
        variable,
        members,
        ty,
    };
    Some(path.text(module))
}

/// The uniforms among the matrices that turn a vector into the clip position: the last one, and
/// those in front of it up to the view's, judged by names. An object's is none of these.
fn to_clip(values: &Values<'_, '_>) -> BTreeSet<String> {
    let outputs = values.outputs().into_iter();
    let positions = outputs
        .filter(|(binding, _)| matches!(binding, Some(Binding::BuiltIn(BuiltIn::Position { .. }))));
    let mut work: Vec<ValueId> = positions.map(|(_, value)| value).collect();
    let mut seen = vec![false; values.values.len()];
    let mut found = BTreeSet::new();
    while let Some(value) = work.pop() {
        if std::mem::replace(&mut seen[value], true) {
            continue;
        }
        if product(values, value).is_none() {
            work.extend(&values.values[value].operands);
            continue;
        }
        let mut factors = Vec::new();
        factors_of(values, value, &mut factors);
        for (i, factor) in factors.into_iter().enumerate() {
            let Some(path) = factor.and_then(|value| read_path(values, value)) else {
                break;
            };
            if i > 0 && names::is_of_object(&path) {
                break;
            }
            let is_whole = names::says_view(&path);
            found.insert(path);
            if is_whole {
                break;
            }
        }
    }
    found
}

/// A matrix times a vector, or a vector times a matrix: the factors, outermost first.
fn product(
    values: &Values<'_, '_>,
    value: ValueId,
) -> Option<(ContextId, [Handle<Expression>; 2], bool)> {
    let Node::Expression(context, e, path) = &values.values[value].node else {
        return None;
    };
    let f = values.function(*context);
    let Expression::Binary {
        op: BinaryOperator::Multiply,
        left,
        right,
    } = f.function.expressions[*e]
    else {
        return None;
    };
    let module = values.graph.module();
    let is_matrix = |e| matches!(f.ty(module, e), TypeInner::Matrix { columns, .. } if *columns == VectorSize::Quad);
    let is_vector =
        |e| matches!(f.ty(module, e), TypeInner::Vector { size, .. } if *size == VectorSize::Quad);
    let factors = match (path.is_empty(), is_matrix(left), is_matrix(right)) {
        (true, true, false) if is_vector(right) => ([left, right], false),
        (true, false, true) if is_vector(left) => ([right, left], true),
        _ => return None,
    };
    Some((*context, factors.0, factors.1))
}

/// The matrices of nested products, outermost first. `None`: a matrix that is computed in another
/// way.
fn factors_of(values: &Values<'_, '_>, value: ValueId, found: &mut Vec<Option<ValueId>>) {
    let value = source(values, value);
    let Some((context, [matrix, vector], is_row)) = product(values, value) else {
        return;
    };
    match values.named(context, matrix) {
        Some(matrix) => matrices_of(values, matrix, is_row, found),
        None => found.push(None),
    }
    if let Some(vector) = values.named(context, vector) {
        factors_of(values, vector, found);
    }
}

fn matrices_of(
    values: &Values<'_, '_>,
    value: ValueId,
    is_row: bool,
    found: &mut Vec<Option<ValueId>>,
) {
    let value = source(values, value);
    if let Node::Expression(context, e, _) = &values.values[value].node
        && let Expression::Binary {
            op: BinaryOperator::Multiply,
            left,
            right,
        } = values.function(*context).function.expressions[*e]
    {
        let sides = if is_row { [right, left] } else { [left, right] };
        for side in sides {
            match values.named(*context, side) {
                Some(side) => matrices_of(values, side, is_row, found),
                None => found.push(None),
            }
        }
        return;
    }
    found.push(Some(value));
}

/// The value that a variable, a result or a member was given, if it was given one alone.
fn source(values: &Values<'_, '_>, mut value: ValueId) -> ValueId {
    loop {
        let is_copy = match &values.values[value].node {
            Node::Version(..) => true,
            Node::Expression(context, e, _) => matches!(
                values.function(*context).function.expressions[*e],
                Expression::Load { .. }
                    | Expression::CallResult(_)
                    | Expression::AccessIndex { .. }
            ),
            _ => false,
        };
        match values.values[value].operands[..] {
            [one] if is_copy => value = one,
            _ => return value,
        }
    }
}
