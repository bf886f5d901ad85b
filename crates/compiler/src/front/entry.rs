//! Chooses the entry points and checks that the stages fit together.

use naga::{Binding, Module, ShaderStage, compact};
use naga_edit::interface;
use preshade_plan::plan::BindingUse;
use preshade_plan::program::Program;
use preshade_plan::reflect;
use shader_text::source::SourceMap;

use super::declaration::{self, Direction, entry_point};
use crate::wgsl::varying::Varying;
use naga_edit::interface::stage_name;
use shader_text::error::{Code, Error};
use shader_text::options::Options;

pub(super) struct Entries {
    pub vertex: String,
    pub fragment: Option<String>,
}

/// Takes the only entry point of each stage, or the one that `options` names.
pub(super) fn choose(
    module: &Module,
    options: &Options,
    sources: &SourceMap,
) -> Result<Entries, Error> {
    let Some(vertex) = one(
        module,
        ShaderStage::Vertex,
        options.vertex.as_deref(),
        sources,
    )?
    else {
        return Err(no_vertex(module, sources));
    };
    let fragment = one(
        module,
        ShaderStage::Fragment,
        options.fragment.as_deref(),
        sources,
    )?;
    Ok(Entries { vertex, fragment })
}

/// The error of a module without a vertex stage.
fn no_vertex(module: &Module, sources: &SourceMap) -> Error {
    let entries = || module.entry_points.iter();
    let is_of_material = |stage| matches!(stage, ShaderStage::Vertex | ShaderStage::Fragment);
    let other = entries().find(|e| !is_of_material(e.stage));
    if let Some(other) = other.filter(|_| !entries().any(|e| is_of_material(e.stage))) {
        let (name, stage) = (&other.name, stage_name(other.stage));
        return Error::new(
            Code::NoEntryPoint,
            format!("{stage} shaders are not materials, and `{name}` is one"),
        )
        .label_if(entry_point(sources, other.stage, name))
        .note("preshade moves work between the vertex and the fragment stage of a material");
    }
    let others: Vec<String> = entries()
        .map(|e| format!("`{}` ({:?})", e.name, e.stage))
        .collect();
    let error = Error::new(Code::NoEntryPoint, "there is no vertex entry point");
    match others.is_empty() {
        true => error.note("mark a function with @vertex, or add the vertex file"),
        false => error.note(format!(
            "there is {}; add the vertex stage in another file or, in WGSL, as a function marked \
             @vertex",
            others.join(", ")
        )),
    }
}

fn one(
    module: &Module,
    stage: ShaderStage,
    wanted: Option<&str>,
    sources: &SourceMap,
) -> Result<Option<String>, Error> {
    let names: Vec<&str> = module
        .entry_points
        .iter()
        .filter(|e| e.stage == stage)
        .map(|e| e.name.as_str())
        .collect();
    let at = |name: &str| entry_point(sources, stage, name);
    let stage = stage_name(stage);
    match (wanted, names.as_slice()) {
        (Some(wanted), _) => {
            if let Some(name) = names.iter().find(|n| **n == wanted) {
                return Ok(Some((*name).to_owned()));
            }
            // GLSL's `main` has another name here.
            if let ("main", [only]) = (wanted, names.as_slice())
                && *only == format!("{stage}_main")
            {
                return Ok(Some((*only).to_owned()));
            }
            let error = Error::new(
                Code::UnknownEntryPoint,
                format!("there is no {stage} entry point `{wanted}`"),
            );
            Err(match nearest(wanted, &names) {
                Some(name) => error.note(format!("did you mean `{name}`?")),
                None if names.is_empty() => {
                    error.note(format!("the file has no {stage} entry point"))
                }
                None => error.note(format!("there is {}", list(&names))),
            })
        }
        (None, []) => Ok(None),
        (None, [name]) => Ok(Some((*name).to_owned())),
        (None, _) => {
            let error = Error::new(
                Code::AmbiguousEntryPoint,
                format!(
                    "there are {} {stage} entry points: {}",
                    names.len(),
                    list(&names)
                ),
            );
            let error = names
                .iter()
                .filter_map(|n| at(n))
                .fold(error, |e, span| e.label(span, ""));
            Err(error.note(format!("choose one with --{stage} NAME")))
        }
    }
}

/// If one of two files has only a fragment (or only a vertex) stage, drops the other file's entry
/// points of that stage. Bevy's `mesh.wgsl` has a fragment stage that paints meshes pink.
pub(super) fn drop_other_stage(first: &mut Module, second: &mut Module) {
    let only = |module: &Module, stage: ShaderStage| {
        let mut stages = module.entry_points.iter().map(|e| e.stage).peekable();
        stages.peek().is_some() && stages.all(|s| s == stage)
    };
    for stage in [ShaderStage::Vertex, ShaderStage::Fragment] {
        let other = match (only(first, stage), only(second, stage)) {
            (true, false) => &mut *second,
            (false, true) => &mut *first,
            _ => continue,
        };
        if other.entry_points.iter().any(|e| e.stage == stage) {
            other.entry_points.retain(|e| e.stage != stage);
            compact::compact(other, compact::KeepUnused::No);
        }
    }
}

fn list(names: &[&str]) -> String {
    names
        .iter()
        .map(|n| format!("`{n}`"))
        .collect::<Vec<_>>()
        .join(", ")
}

/// The name with the fewest edits from `wanted`, if at most a third of its letters differ.
fn nearest<'a>(wanted: &str, names: &[&'a str]) -> Option<&'a str> {
    names
        .iter()
        .map(|n| (distance(wanted, n), *n))
        .filter(|(d, n)| *d <= n.chars().count().max(3) / 3 + 1)
        .min()
        .map(|(_, n)| n)
}

/// Levenshtein distance in characters.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let substituted = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

pub(super) fn names(module: &Module) -> Vec<(ShaderStage, String)> {
    let entries = module.entry_points.iter();
    entries.map(|e| (e.stage, e.name.clone())).collect()
}

pub struct Bound {
    at: naga::ResourceBinding,
    name: String,
    span: naga::Span,
}

/// The bound variables of a module.
pub(super) fn bound(module: &Module) -> Vec<Bound> {
    let globals = module.global_variables.iter();
    let bound = globals.filter_map(|(handle, global)| {
        Some(Bound {
            at: global.binding?,
            name: global.name.clone().unwrap_or_default(),
            span: module.global_variables.get_span(handle),
        })
    });
    bound.collect()
}

/// Names both variables where a stage uses two at one binding. naga labels the second alone.
pub(super) fn name_clash(error: Error, bound: &[Bound]) -> Error {
    if !error.message().contains("conflict with other resource") {
        return error;
    }
    let labelled = |b: &&Bound| error.labels().iter().any(|l| l.span == b.span);
    let Some(second) = bound.iter().find(labelled) else {
        return error;
    };
    let same = |b: &&Bound| b.at == second.at && b.span != second.span;
    let Some(first) = bound.iter().find(same) else {
        return error;
    };
    Error::new(
        Code::Invalid,
        format!(
            "one stage uses `{}` and `{}`, and both have group {} binding {}",
            first.name, second.name, second.at.group, second.at.binding
        ),
    )
    .label(second.span, "")
    .label(first.span, "")
    .note("give one of them another number")
}

/// Labels a validation error that names an entry point without a span.
pub(super) fn locate_invalid(
    error: Error,
    names: &[(ShaderStage, String)],
    sources: &SourceMap,
) -> Error {
    if !error.labels().is_empty() {
        return error;
    }
    let named = names.iter().find(|(_, name)| {
        error
            .message()
            .starts_with(&format!("Entry point {name} at "))
    });
    let at = named.and_then(|(stage, name)| entry_point(sources, *stage, name));
    error.label_if(at)
}

/// Checks the inter-stage interface as WebGPU does (10.3.2): each fragment input needs a vertex
/// output of the same location, type and interpolation.
pub(super) fn check_interface(
    module: &Module,
    entries: &Entries,
    sources: &SourceMap,
) -> Result<(), Error> {
    let find = |stage, name: &str| {
        module
            .entry_points
            .iter()
            .find(|e| e.stage == stage && e.name == name)
    };
    let Some(vertex) = find(ShaderStage::Vertex, &entries.vertex) else {
        return Ok(());
    };
    let outputs = interface::outputs(module, &vertex.function);
    let position = outputs.iter().any(|o| {
        matches!(
            o.binding,
            Some(Binding::BuiltIn(naga::BuiltIn::Position { .. }))
        )
    });
    if !position {
        return Err(Error::new(
            Code::Interface,
            format!(
                "the vertex entry point `{}` writes no position",
                vertex.name
            ),
        )
        .note("give it an output @builtin(position), or write gl_Position"));
    }
    let Some(fragment) = entries
        .fragment
        .as_deref()
        .and_then(|f| find(ShaderStage::Fragment, f))
    else {
        return Ok(());
    };
    for input in interface::inputs(module, &fragment.function) {
        let Some(wanted) = Varying::of(module, &input) else {
            continue;
        };
        let given = outputs
            .iter()
            .filter_map(|o| Varying::of(module, o))
            .find(|o| o.location == wanted.location);
        let what = format!(
            "fragment input {} at location {}",
            input
                .name
                .as_deref()
                .map_or("(unnamed)".to_owned(), |n| format!("`{n}`")),
            wanted.location
        );
        let error = match given {
            None => Error::new(
                Code::Interface,
                format!("{what} matches no output of `{}`", vertex.name),
            ),
            Some(given) if given.ty != wanted.ty => Error::new(
                Code::Interface,
                format!(
                    "{what} is a {}, but the vertex stage writes a {}",
                    wanted.ty, given.ty
                ),
            ),
            Some(given) if given.interpolation != wanted.interpolation => Error::new(
                Code::Interface,
                format!(
                    "{what} is interpolated {}, but the vertex stage's output {}",
                    wanted.interpolation, given.interpolation
                ),
            ),
            Some(_) => continue,
        };
        let at = |stage, name: &str, direction| {
            declaration::varying(sources, stage, name, direction, wanted.location)
                .or_else(|| entry_point(sources, stage, name))
        };
        return Err(error
            .label_if(at(ShaderStage::Fragment, &fragment.name, Direction::In))
            .label_if(at(ShaderStage::Vertex, &vertex.name, Direction::Out)));
    }
    Ok(())
}

/// Checks that one bind group layout serves both stages (WebGPU 10.2).
pub(super) fn check_bindings(program: &Program, entries: &Entries) -> Result<(), Error> {
    let Some(fragment) = entries.fragment.as_deref() else {
        return Ok(());
    };
    let stages = [
        (ShaderStage::Vertex, entries.vertex.as_str()),
        (ShaderStage::Fragment, fragment),
    ];
    let Some(both) = reflect::conflict(program, stages) else {
        return Ok(());
    };
    let [vertex, fragment] = &both;
    let error = Error::new(
        Code::Interface,
        format!(
            "the vertex stage's `{}` and the fragment stage's `{}` differ in kind, but both have \
             group {} binding {}",
            vertex.name, fragment.name, vertex.group, vertex.binding
        ),
    );
    let module = program.module();
    let span = |binding: &BindingUse| {
        let mut globals = module.global_variables.iter();
        let named = globals.find(|(_, g)| {
            let at = g.binding.map(|b| (b.group, b.binding));
            at == Some((binding.group, binding.binding))
                && g.name.as_deref() == Some(binding.name.as_str())
        });
        named.map(|(handle, _)| module.global_variables.get_span(handle))
    };
    let error = both.iter().fold(error, |e, b| e.label_if(span(b)));
    Err(error.note("a pipeline binds one resource there: give one of them another number"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_offered_only_if_near() {
        assert_eq!(distance("kitten", "sitting"), 3);
        assert_eq!(nearest("fs_mian", &["fs_main", "vs_main"]), Some("fs_main"));
        assert_eq!(nearest("shadow", &["fs_main"]), None);
    }
}
