//! Keys of `values`: paths into a variable such as `lights[1].color`, or `lights.color` for every
//! element.

use std::collections::BTreeMap;

use naga::{ArraySize, Handle, Module, Type, TypeInner};

use super::globals::{globals, immediates};
use super::layout;
use super::{Material, SceneError, Value};

/// Refuses keys without an effect: unknown paths, indices beyond an array, and duplicates.
///
/// # Errors
/// The first such key is the error's subject.
pub fn check(material: &Material, values: &BTreeMap<String, Value>) -> Result<(), SceneError> {
    if values.is_empty() {
        return Ok(());
    }
    let module = material.program.module();
    let buffers = || {
        let bound = globals(&material.program).filter(|g| g.is_buffer);
        let bound = bound.map(|g| (g.name, g.ty));
        bound.chain(immediates(&material.program))
    };
    let paths: Vec<String> = buffers()
        .flat_map(|(name, ty)| layout::paths(module, name, ty))
        .collect();
    for key in values.keys() {
        if !paths.contains(&without_indices(key)) {
            return Err(SceneError::new(format!(
                "the shader of material `{}` has no variable `{key}`",
                material.name
            ))
            .suggest(key, paths.iter().map(String::as_str))
            .about(key));
        }
        let wrong = |what: String, help: &str| {
            Err(SceneError::new(format!("`{key}`: {what}"))
                .help(help)
                .about(key))
        };
        let Some(steps) = steps(key) else {
            return wrong(
                "an index is a whole number".to_owned(),
                "`lights[1].color` gives one element, `lights.color` all of them",
            );
        };
        for (name, ty) in buffers() {
            if let Err((what, help)) = check_indices(module, name, ty, &steps, None) {
                return wrong(what, help);
            }
        }
        let is_given_by = |(other, value): &(&String, &Value)| {
            matches!(value, Value::Numbers(_))
                && [key.clone(), without_indices(key)].iter().any(|path| {
                    path.strip_prefix(other.as_str())
                        .is_some_and(|rest| rest.starts_with(['.', '[']))
                })
        };
        if let Some((other, _)) = values.iter().find(is_given_by) {
            return wrong(
                format!("`{other}` gives it already"),
                "give the whole, or its parts one by one",
            );
        }
    }
    Ok(())
}

/// Refuses indices beyond `length` in a runtime-sized array or an array with an override as its
/// length. The length is known only when the data is bound.
///
/// # Errors
/// The first such key is the error's subject.
pub(super) fn check_length<'a>(
    module: &Module,
    name: &str,
    ty: Handle<Type>,
    length: usize,
    keys: impl IntoIterator<Item = &'a String>,
) -> Result<(), SceneError> {
    for key in keys.into_iter().filter(|k| k.contains('[')) {
        if let Some(steps) = steps(key)
            && let Err((what, help)) = check_indices(module, name, ty, &steps, Some(length))
        {
            return Err(SceneError::new(format!("`{key}`: {what}"))
                .help(help)
                .about(key));
        }
    }
    Ok(())
}

/// `lights[1].color` without its indices.
pub fn without_indices(path: &str) -> String {
    let mut depth = 0;
    path.chars()
        .filter(|c| {
            match c {
                '[' => depth += 1,
                ']' => {
                    depth -= 1;
                    return false;
                }
                _ => {}
            }
            depth == 0
        })
        .collect()
}

/// A member name with its indices.
type PathStep<'a> = (&'a str, Vec<usize>);

/// The members of a path. `None` if an index is not a canonical number.
fn steps(path: &str) -> Option<Vec<PathStep<'_>>> {
    let steps = members(path)?;
    let names: Vec<&str> = steps.iter().map(|(name, _)| *name).collect();
    let written = steps.iter().map(|(name, indices)| {
        let indices: String = indices.iter().map(|i| format!("[{i}]")).collect();
        format!("{name}{indices}")
    });
    let is_itself = written.collect::<Vec<_>>().join(".") == path;
    (is_itself && names.join(".") == without_indices(path)).then_some(steps)
}

fn members(path: &str) -> Option<Vec<PathStep<'_>>> {
    path.split('.')
        .map(|member| {
            let (name, indices) = member.split_once('[').unwrap_or((member, ""));
            if indices.is_empty() {
                return (!member.contains('[')).then_some((name, Vec::new()));
            }
            let indices = indices.strip_suffix(']')?.split("][");
            let indices: Option<Vec<usize>> = indices.map(|i| i.parse().ok()).collect();
            Some((name, indices?))
        })
        .collect()
}

/// The error in a path's indices, if the path leads into the variable `name`. `length` is the
/// length of arrays whose type does not give one, once known.
fn check_indices(
    module: &Module,
    name: &str,
    ty: Handle<Type>,
    steps: &[PathStep<'_>],
    length: Option<usize>,
) -> Result<(), (String, &'static str)> {
    let has_any = steps.iter().any(|(_, indices)| !indices.is_empty());
    let mut ty = ty;
    for (at, (step, indices)) in steps.iter().enumerate() {
        let is_variable = at == 0 && !name.is_empty();
        if is_variable && *step != name {
            return Ok(());
        }
        if !is_variable {
            let TypeInner::Struct { members, .. } = &module.types[ty].inner else {
                return Ok(());
            };
            let Some(member) = members.iter().find(|m| m.name.as_deref() == Some(step)) else {
                return Ok(());
            };
            ty = member.ty;
        }
        for index in indices {
            let TypeInner::Array { base, size, .. } = module.types[ty].inner else {
                return Err((
                    format!("`{step}` is not an array of that many dimensions"),
                    "components are given together: `[1, 0, 0]`",
                ));
            };
            let length = match size {
                ArraySize::Constant(n) => Some(n.get() as usize),
                ArraySize::Pending(_) | ArraySize::Dynamic => length,
            };
            if let Some(length) = length.filter(|length| index >= length) {
                return Err((
                    format!("`{step}` has {length} elements, and no number {index}"),
                    "they count from 0",
                ));
            }
            ty = base;
        }
        while let TypeInner::Array { base, .. } = module.types[ty].inner {
            if has_any && at + 1 < steps.len() {
                return Err((
                    format!("`{step}` is an array, and has no index here"),
                    "give an index at each array on the way, or at none",
                ));
            }
            ty = base;
        }
    }
    Ok(())
}
