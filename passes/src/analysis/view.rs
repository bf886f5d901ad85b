//! Which uniforms follow the viewer. A shader has nothing but names to tell them by.

use naga::{AddressSpace, Expression, TypeInner, VectorSize};

use crate::analysis::values::{Node, ValueId, Values};
use crate::core::program::Program;

/// Uniforms with camera, view, eye or projection in their name or a member's, and members of such
/// structs that give its place or range. The name is all that a shader reveals about a matrix.
/// `verify` takes these from the light and all others from the camera. If no name tells, all
/// matrices that the pass reads count, except those of an object.
pub fn view_dependent(program: &Program) -> Vec<String> {
    let module = program.module();
    let says_view = |name: &str| {
        let name = name.to_lowercase();
        let part_of = [
            "camera", "view", "eye", "proj", "mvp", "screen", "clip", "znear", "zfar",
        ];
        let whole = ["vp", "near", "far", "near_plane", "far_plane", "transform"];
        part_of.iter().any(|w| name.contains(w)) || whole.contains(&name.trim_start_matches("u_"))
    };
    let says_place = |name: &str| {
        let name = name.to_lowercase();
        ["pos", "origin", "near", "far", "matrix", "vp"]
            .iter()
            .any(|w| name.contains(w))
    };
    let mut found = Vec::new();
    for (_, global) in module
        .global_variables
        .iter()
        .filter(|(_, g)| g.space == AddressSpace::Uniform)
    {
        let variable = global.name.clone().unwrap_or_default();
        let struct_name = module.types[global.ty].name.as_deref().unwrap_or("");
        let of_view = says_view(&variable) || says_view(struct_name);
        let members = match &module.types[global.ty].inner {
            TypeInner::Struct { members, .. } => members.as_slice(),
            _ => &[],
        };
        if says_view(&variable) && members.is_empty() {
            found.push(variable.clone());
        }
        found.extend(
            members
                .iter()
                .filter_map(|m| m.name.as_deref())
                .filter(|m| says_view(m) || (of_view && says_place(m)))
                .map(|m| format!("{variable}.{m}")),
        );
    }
    if found.is_empty() {
        return matrices(module);
    }
    found
}

/// Whether a value is a read of one of these uniforms: variables, or members as
/// `VARIABLE.MEMBER`. A read of a whole variable counts if a member is among them.
pub fn is_read(values: &Values<'_, '_>, value: ValueId, names: &[String]) -> bool {
    let Node::Expression(context, e, path) = &values.values[value].node else {
        return false;
    };
    let function = values.function(*context).function;
    let Expression::Load { pointer } = function.expressions[*e] else {
        return false;
    };
    let (mut at, mut member) = (pointer, path.first().copied());
    loop {
        match function.expressions[at] {
            Expression::AccessIndex { base, index } => (at, member) = (base, Some(index)),
            Expression::Access { base, .. } => (at, member) = (base, None),
            Expression::GlobalVariable(global) => {
                let module = values.graph.module();
                let global = &module.global_variables[global];
                let variable = global.name.as_deref().unwrap_or_default();
                let start = format!("{variable}.");
                let own = match (&module.types[global.ty].inner, member) {
                    (TypeInner::Struct { members, .. }, Some(index)) => members
                        .get(index as usize)
                        .and_then(|m| m.name.as_deref())
                        .map(|name| format!("{start}{name}")),
                    _ => None,
                };
                let is_whole = own.is_none();
                return global.space == AddressSpace::Uniform
                    && names.iter().any(|name| {
                        name == variable
                            || Some(name) == own.as_ref()
                            || (is_whole && name.starts_with(&start))
                    });
            }
            _ => return false,
        }
    }
}

/// Matrices of uniforms whose names are not those of an object. Where no name tells the camera's
/// matrix, it is among them.
fn matrices(module: &naga::Module) -> Vec<String> {
    let is_of_object = |name: &str| {
        let name = name.to_lowercase();
        let of_object = [
            "model", "world", "object", "local", "bone", "joint", "instance",
        ];
        of_object.iter().any(|w| name.contains(w))
    };
    let is_matrix = |ty: naga::Handle<naga::Type>| {
        let inner = &module.types[ty].inner;
        matches!(inner, TypeInner::Matrix { columns, rows, .. }
            if (*columns, *rows) == (VectorSize::Quad, VectorSize::Quad))
    };
    let uniforms = module.global_variables.iter().map(|(_, global)| global);
    let uniforms = uniforms.filter(|global| global.space == AddressSpace::Uniform);
    let paths = uniforms.flat_map(|global| {
        let variable = global.name.clone().unwrap_or_default();
        match &module.types[global.ty].inner {
            TypeInner::Struct { members, .. } => {
                let matrices = members.iter().filter(|m| is_matrix(m.ty));
                let names = matrices.filter_map(|m| m.name.as_deref());
                names.map(|name| format!("{variable}.{name}")).collect()
            }
            _ if is_matrix(global.ty) => vec![variable],
            _ => Vec::new(),
        }
    });
    paths.filter(|path| !is_of_object(path)).collect()
}
