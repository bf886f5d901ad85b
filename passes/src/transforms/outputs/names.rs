//! Resolves the names among the parameters.

use std::collections::BTreeSet;

use naga::{
    AddressSpace, Binding, GlobalVariable, Handle, Module, ScalarKind, TypeInner, VectorSize,
};

use super::authored::{self, Authored, AuthoredPlace};
use super::extend::Member;
use super::{Asked, OutputsParams, jitter, list, lit, refusals, unwritten};
use crate::analysis::opaque::Opaque;
use naga_edit::{declared, interface};
use preshade_plan::mapping::{self, Path};
use preshade_plan::pass::{Misnamed, Refusal};
use preshade_plan::program::Program;
use shader_text::refusals::RefusalInfo;

/// Most candidates that a refusal lists.
const MOST: usize = 12;

pub(super) fn refusal(code: &RefusalInfo, reason: impl Into<String>) -> Box<Refusal> {
    Box::new(Refusal::new(
        super::NAME,
        code,
        reason,
        refusals::remedy(code),
    ))
}

/// The first name among the parameters that the material lacks.
pub(crate) fn misnamed(opaque: &Opaque<'_>, params: &OutputsParams) -> Option<Misnamed> {
    let program = opaque.program;
    let values = || all_values(opaque).into_iter().map(|v| v.name);
    let paths = || buffers(program).into_iter().map(|(path, _)| path);
    let missing = |refused: &Refusal| refused.code == refusals::NO_SUCH_NAME.code;
    let found = |name: &str, refused: Box<Refusal>, known: Vec<String>| {
        missing(&refused).then(|| Misnamed {
            message: refused.reason,
            name: name.to_owned(),
            known,
        })
    };
    let named = params
        .requested()
        .into_iter()
        .filter_map(|asked| match asked {
            Asked::Named(name) => Some(name),
            _ => None,
        });
    let mut named = named
        .chain(params.normal.clone())
        .chain(params.position.clone());
    let of_value = named.find_map(|name| {
        let refused = value(opaque, &name).err()?;
        found(&name, refused, values().collect())
    });
    let buffers = [&params.still, &params.matrix, &params.light, &params.range];
    let mut buffers = buffers.into_iter().flat_map(|text| list(text.as_deref()));
    let of_value = of_value.or_else(|| {
        buffers.find_map(|name| found(name, member(program, name).err()?, paths().collect()))
    });
    let jitter = list(params.jitter.as_deref());
    let (pairs, words): (Vec<&str>, Vec<&str>) = jitter.partition(|w| w.contains('='));
    let of_value = of_value.or_else(|| {
        words.iter().find_map(|name| {
            let refused = jitter::of(program, name).err()?;
            found(name, refused, paths().collect())
        })
    });
    let of_value = of_value.or_else(|| {
        let mut names = pairs.iter().flat_map(|pair| pair.split('='));
        names.find_map(|name| found(name, member(program, name).err()?, paths().collect()))
    });
    of_value.or_else(|| {
        list(params.moving.as_deref()).find_map(|name| {
            let refused = attributes(opaque, std::iter::once(name)).err()?;
            found(
                name,
                refused,
                attribute_names(opaque)
                    .into_iter()
                    .map(|(n, _)| n)
                    .collect(),
            )
        })
    })
}

/// Words of a list for a message.
fn listed(all: &[String]) -> String {
    let more = all.len().saturating_sub(MOST);
    let shown = all[..all.len() - more].join(", ");
    match more {
        0 => shown,
        _ => format!("{shown} and {more} more"),
    }
}

/// The value of the fragment stage that the author calls `name`.
pub(crate) fn value(opaque: &Opaque<'_>, name: &str) -> Result<Authored, Box<Refusal>> {
    let all = all_values(opaque);
    let program = opaque.program;
    let called = all.iter().filter(|v| v.is_called(name, program));
    let called: Vec<&Authored> = called.collect();
    // A whole name counts before the end of another.
    let exact = called
        .iter()
        .filter(|v| name.split(['@', ':']).next() == Some(&v.name));
    let exact: Vec<&Authored> = exact.copied().collect();
    match (&exact[..], &called[..]) {
        ([one], _) | ([], [one]) => Ok((*one).clone()),
        ([], []) => {
            if let Some(other) = other_type(opaque, name) {
                return Err(refusal(
                    &refusals::OUTPUT_TYPE,
                    format!("no colour target holds {}", other.described(program)),
                ));
            }
            let known: Vec<String> = all.iter().map(|v| v.described(opaque.program)).collect();
            let known = match known.is_empty() {
                true => "it has no named values".to_owned(),
                false => format!("it has {}", listed(&known)),
            };
            Err(refusal(
                &refusals::NO_SUCH_NAME,
                format!("the fragment stage has no value `{name}`: {known}"),
            ))
        }
        ([], several) | (several, _) => {
            let of = several.first().map(|v| &v.function);
            let is_of_one = several.iter().all(|v| Some(&v.function) == of);
            let by_line = |v: &Authored| {
                let at = program.sources().locate(v.span)?;
                is_of_one.then(|| format!("`{}@{}:{}`", v.name, v.function, at.line))
            };
            let told = |v: &&Authored| by_line(v).unwrap_or_else(|| v.described(program));
            let several: Vec<String> = several.iter().map(told).collect();
            Err(refusal(
                &refusals::AMBIGUOUS_NAME,
                format!("`{name}` may be {}", listed(&several)),
            ))
        }
    }
}

/// A value of that name that is no scalar or vector.
fn other_type(opaque: &Opaque<'_>, name: &str) -> Option<Authored> {
    let all = authored::of_entry(opaque.program, opaque.fragment?);
    let mut others = all.into_iter().filter(|v| !v.is_plain());
    others.find(|v| v.is_called(name, opaque.program))
}

/// The values of the fragment stage that may be meant, for a message.
pub(crate) fn described(opaque: &Opaque<'_>, is_candidate: &dyn Fn(&Authored) -> bool) -> String {
    let mut all = all_values(opaque);
    all.retain(is_candidate);
    let all: Vec<String> = all.iter().map(|v| v.described(opaque.program)).collect();
    match all.is_empty() {
        true => "the fragment stage has no other candidate".to_owned(),
        false => format!("candidates are {}", listed(&all)),
    }
}

fn all_values(opaque: &Opaque<'_>) -> Vec<Authored> {
    let fragment = opaque
        .fragment
        .map(|f| authored::of_entry(opaque.program, f));
    let mut all = fragment.unwrap_or_default();
    all.retain(Authored::is_plain);
    all
}

/// The material's normal: by name, or by its role.
pub(crate) fn normal(opaque: &Opaque<'_>, name: Option<&str>) -> Result<Authored, Box<Refusal>> {
    if let Some(name) = name {
        let found = value(opaque, name)?;
        let described = found.described(opaque.program);
        if !is_direction(&found) {
            let reason = format!("{described} is not a vec3 of floats");
            return Err(refusal(&refusals::NOT_A_DIRECTION, reason));
        }
        if is_unwritten(opaque, &found) {
            let reason = format!("the vertex stage writes nothing to {described}");
            return Err(refusal(&refusals::NO_NORMAL, reason));
        }
        return Ok(found);
    }
    let fragment = opaque.fragment.map(|f| lit::normals(&opaque.graph, f));
    let mut found = fragment.unwrap_or_default();
    if found.len() == 1
        && let Some(only) = found.pop()
    {
        return Ok(only);
    }
    let mut candidates = found;
    let (code, reason) = match candidates.is_empty() {
        true => {
            candidates = all_values(opaque);
            candidates.retain(is_direction);
            let reason = "no unit vector meets a light's vector in a dot product";
            (&refusals::NO_NORMAL, reason)
        }
        false => {
            let reason = "several unit vectors meet a light's vector in a dot product";
            (&refusals::SEVERAL_NORMALS, reason)
        }
    };
    let candidates: Vec<String> = candidates
        .iter()
        .map(|v| v.described(opaque.program))
        .collect();
    let candidates = match candidates.is_empty() {
        true => "the fragment stage names no vec3".to_owned(),
        false => format!("candidates are {}", listed(&candidates)),
    };
    Err(refusal(code, format!("{reason}; {candidates}")))
}

/// Whether a value is an input that the vertex stage does not write.
fn is_unwritten(opaque: &Opaque<'_>, value: &Authored) -> bool {
    let binding = binding(opaque, value);
    matches!(binding, Some(Binding::Location { location, .. })
        if unwritten::is_unwritten(&opaque.graph, opaque.vertex, location))
}

/// The binding of a value that is an input of the fragment stage.
pub(crate) fn binding(opaque: &Opaque<'_>, value: &Authored) -> Option<Binding> {
    let AuthoredPlace::Input(index) = value.place else {
        return None;
    };
    let module = opaque.program.module();
    let inputs = interface::inputs(module, &module.entry_points[opaque.fragment?].function);
    inputs.into_iter().nth(index)?.binding
}

fn is_direction(value: &Authored) -> bool {
    matches!(
        value.inner,
        TypeInner::Vector { size: VectorSize::Tri, scalar }
            if scalar.kind == ScalarKind::Float && scalar.width == 4
    )
}

/// All buffers, their members and the members of these, by path.
fn buffers(program: &Program) -> Vec<(String, Member)> {
    let module = program.module();
    let declared = program.declared();
    let mut found = Vec::new();
    for (handle, global) in module.global_variables.iter() {
        if !is_buffer(module, handle) {
            continue;
        }
        let whole = Member {
            global: handle,
            steps: Vec::new(),
            ty: global.ty,
        };
        // A plain uniform of WebGL has no block, and an unnamed block has a name of its own.
        let name = match global.binding.is_some() && global.binding == declared.loose {
            true => String::new(),
            false => declared.name_of(global),
        };
        let mut work = vec![(name, whole)];
        while let Some((path, member)) = work.pop() {
            let members = mapping::members(module, member.ty).into_iter();
            for (i, (own, ty)) in members.enumerate().rev() {
                let path = match path.is_empty() {
                    true => own,
                    false => format!("{path}.{own}"),
                };
                let mut steps = member.steps.clone();
                steps.push(i);
                let global = handle;
                work.push((path, Member { global, steps, ty }));
            }
            if !path.is_empty() {
                found.push((path, member));
            }
        }
    }
    found
}

fn is_buffer(module: &Module, variable: Handle<GlobalVariable>) -> bool {
    matches!(
        module.global_variables[variable].space,
        AddressSpace::Uniform | AddressSpace::Storage { .. } | AddressSpace::Immediate
    )
}

/// The buffer, or the part of one, of that name or path. A path may leave its start out.
pub(crate) fn member(program: &Program, name: &str) -> Result<Member, Box<Refusal>> {
    let module = program.module();
    let path = name.parse::<Path>().ok();
    let whole = path.and_then(|path| path.resolve(module).ok());
    if let Some(found) = whole.filter(|found| is_buffer(module, found.global)) {
        return Ok(found);
    }
    let all = buffers(program);
    let end = format!(".{name}");
    let called = all
        .iter()
        .filter(|(path, _)| path == name || path.ends_with(&end));
    match called.collect::<Vec<_>>()[..] {
        [(_, one)] => Ok(one.clone()),
        [] => {
            let known: Vec<String> = all.iter().map(|(path, _)| format!("`{path}`")).collect();
            Err(refusal(
                &refusals::NO_SUCH_NAME,
                format!(
                    "no buffer or member is called `{name}`: there are {}",
                    listed(&known)
                ),
            ))
        }
        ref several => {
            let several: Vec<String> = several
                .iter()
                .map(|(path, _)| format!("`{path}`"))
                .collect();
            Err(refusal(
                &refusals::AMBIGUOUS_NAME,
                format!("`{name}` may be {}", listed(&several)),
            ))
        }
    }
}

/// A matrix of three or four columns and rows.
pub(crate) fn matrix(program: &Program, name: &str) -> Result<Member, Box<Refusal>> {
    let found = member(program, name)?;
    match is_matrix(program.module(), &found) {
        true => Ok(found),
        false => Err(refusal(
            &refusals::NO_SUCH_NAME,
            format!(
                "`{name}` is no matrix of 3x3 or 4x4 floats: {}",
                matrices(program)
            ),
        )),
    }
}

/// The matrices that there are, for a message.
pub(crate) fn matrices(program: &Program) -> String {
    let all = buffers(program).into_iter();
    let all = all.filter(|(_, member)| is_matrix(program.module(), member));
    let all: Vec<String> = all.map(|(path, _)| format!("`{path}`")).collect();
    match all.is_empty() {
        true => "the material has none".to_owned(),
        false => format!("the material has {}", listed(&all)),
    }
}

fn is_matrix(module: &Module, member: &Member) -> bool {
    matches!(&module.types[member.ty].inner, TypeInner::Matrix { columns, rows, scalar }
        if columns == rows && *columns >= VectorSize::Tri && scalar.width == 4)
}

/// The buffers and the loose uniforms of these names.
pub(crate) fn still<'n>(
    program: &Program,
    names: impl Iterator<Item = &'n str>,
) -> Result<Vec<Member>, Box<Refusal>> {
    let module = program.module();
    let declared = program.declared();
    let still = |name: &str| {
        let found = member(program, name)?;
        let global = &module.global_variables[found.global];
        let is_loose = global.binding.is_some() && global.binding == declared.loose;
        let is_whole = found.steps.len() == usize::from(is_loose);
        if is_whole || found.steps.is_empty() {
            return Ok(found);
        }
        let whole = mapping::name_of(module, found.global, &found.steps[..usize::from(is_loose)]);
        let whole = match is_loose {
            true => whole.members.join("."),
            false => declared.name_of(global),
        };
        Err(refusal(
            &refusals::NO_SUCH_NAME,
            format!(
                "`{name}` is a part of a buffer, and hosts keep whole buffers: name the variable \
                 `{whole}`"
            ),
        ))
    };
    names.map(still).collect()
}

/// Locations of the attributes of these names.
pub(crate) fn attributes<'n>(
    opaque: &Opaque<'_>,
    names: impl Iterator<Item = &'n str>,
) -> Result<BTreeSet<u32>, Box<Refusal>> {
    let attributes = attribute_names(opaque);
    let matrices = &opaque.program.declared().attributes;
    let location = |name: &str| {
        let found = attributes.iter().find(|(own, _)| *own == name);
        let column = found.map(|(_, location)| vec![*location]);
        // A matrix is a vector for each column.
        let whole = || {
            let of = matrices.iter().find(|a| a.declaration.name == name)?;
            Some((of.location..of.location + columns(&of.declaration.ty)).collect())
        };
        column.or_else(whole).ok_or_else(|| {
            let known: Vec<String> = attributes.iter().map(|(n, _)| format!("`{n}`")).collect();
            refusal(
                &refusals::NO_SUCH_NAME,
                format!(
                    "no attribute is called `{name}`: there are {}",
                    listed(&known)
                ),
            )
        })
    };
    let all: Vec<Vec<u32>> = names.map(location).collect::<Result<_, _>>()?;
    Ok(all.into_iter().flatten().collect())
}

/// The locations of an attribute of GLSL.
fn columns(ty: &declared::Type) -> u32 {
    match ty {
        declared::Type::Array(of, n) => n * columns(of),
        declared::Type::Plain(name) => {
            let size = name.split_once("mat").map(|(_, size)| size);
            let columns = size.and_then(|size| size.chars().next()?.to_digit(10));
            columns.unwrap_or(1)
        }
        _ => 1,
    }
}

/// Names of all attributes, with their locations.
fn attribute_names(opaque: &Opaque<'_>) -> Vec<(String, u32)> {
    let module = opaque.program.module();
    let inputs = interface::inputs(module, &module.entry_points[opaque.vertex].function);
    let attributes = inputs.into_iter().filter_map(|io| match io.binding {
        Some(Binding::Location { location, .. }) => Some((io.name?, location)),
        _ => None,
    });
    attributes.collect()
}
