//! Notes about the pictures for a host's author.

use super::extend::{ExtraPicture, Normal, Shows};
use super::{OutputsParams, distance};
use crate::analysis::opaque::Opaque;
use naga_edit::interface;
use preshade_dataflow::slice::{self, Criterion, OutputFilter};

/// Words in the names of attributes that place an instance.
const PLACES: [&str; 5] = ["instance", "transform", "model", "matrix", "object"];

/// The notes on all pictures, a sentence each.
pub(crate) fn notes(
    opaque: &Opaque<'_>,
    params: &OutputsParams,
    wanted: &[ExtraPicture],
) -> Vec<String> {
    let mut found = Vec::new();
    if wanted.is_empty() {
        found.push(
            "the pass `outputs` writes no colour: WebGL refuses it while a colour target is bound; \
             `colour-target=bound` writes one"
                .to_owned(),
        );
    }
    found.extend(wanted.iter().filter_map(|w| match &w.shows {
        Shows::Distance(of) => Some(distance::described(of, params)),
        Shows::Direction(Normal::Value(normal), _) if params.normal.is_none() => Some(format!(
            "`outputs-normal` holds {}, which meets a light in a dot product. If that is no normal, \
             such as a tangent of hair, name it: `normal=NAME`",
            normal.described(opaque.program)
        )),
        _ => None,
    }));
    let module = opaque.program.module();
    if wanted.iter().any(|w| matches!(w.shows, Shows::Velocity(_))) {
        let info = opaque.program.info().get_entry_point(opaque.vertex);
        let textures = module.global_variables.iter().filter(|(handle, global)| {
            let inner = &module.types[global.ty].inner;
            matches!(inner, naga::TypeInner::Image { .. }) && !info[*handle].is_empty()
        });
        let names = textures.filter_map(|(_, global)| global.name.as_deref());
        let names: Vec<String> = names.map(|name| format!("`{name}`")).collect();
        if !names.is_empty() {
            let names = names.join(", ");
            found.push(format!(
                "velocities take what the vertex stage samples as unchanged: {names}"
            ));
        }
    }
    found.extend(unchanged(opaque, wanted));
    found
}

/// The attributes that look like transforms of instances and count as unchanged. No state of a
/// material shows which attributes belong to instances.
fn unchanged(opaque: &Opaque<'_>, wanted: &[ExtraPicture]) -> Option<String> {
    let velocity = wanted.iter().find_map(|w| match &w.shows {
        Shows::Velocity(velocity) => Some(velocity),
        _ => None,
    })?;
    let module = opaque.program.module();
    let position = [Criterion::Output(OutputFilter::Position)];
    let slice = slice::backward(&opaque.graph, opaque.vertex, &position);
    let inputs = interface::inputs(module, &module.entry_points[opaque.vertex].function);
    let read = slice.inputs.iter().filter_map(|i| inputs.get(*i));
    let named = read.filter_map(|io| match io.binding {
        Some(naga::Binding::Location { location, .. }) => Some((io.name.clone()?, location)),
        _ => None,
    });
    let all: Vec<(String, u32)> = named
        .filter(|(_, location)| !velocity.moving.contains(location))
        .collect();
    let stem = |name: &str| {
        name.trim_end_matches(|c: char| c.is_ascii_digit())
            .to_owned()
    };
    let is_numbered = |name: &str| stem(name) != name;
    let is_matrix = |name: &str| {
        let columns = all
            .iter()
            .filter(|(other, _)| is_numbered(other) && stem(other) == stem(name));
        is_numbered(name) && columns.count() >= 3
    };
    let looks = |name: &String| {
        let lower = name.to_lowercase();
        PLACES.iter().any(|word| lower.contains(word)) || is_matrix(name)
    };
    let names: Vec<&String> = all
        .iter()
        .map(|(name, _)| name)
        .filter(|n| looks(n))
        .collect();
    names.first()?;
    let quoted: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
    let joined: Vec<&str> = names.iter().map(|name| name.as_str()).collect();
    Some(format!(
        "velocities take these attributes as unchanged: {}. If they move, name them: `moving={}`",
        quoted.join(", "),
        joined.join("+")
    ))
}
