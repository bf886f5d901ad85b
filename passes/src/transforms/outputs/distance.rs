//! The two ends of a distance: a surface and a light.

use naga::{Binding, ScalarKind, TypeInner, VectorSize};

use super::extend::{Distance, Member, Shows, Surface};
use super::names::{self, refusal};
use super::world_position::{self, NoWorld};
use super::{OutputsParams, calls, refusals};
use crate::analysis::opaque::Opaque;
use crate::analysis::view::{self, StatedUniforms};
use preshade_plan::pass::Refusal;
use preshade_plan::program::Program;

/// The surface, the light and the range of the parameters.
pub(crate) fn distance(
    opaque: &Opaque<'_>,
    params: &OutputsParams,
    said: &StatedUniforms,
) -> Result<Shows, Box<Refusal>> {
    let program = opaque.program;
    let light = params.light.as_deref();
    let range = params.range.as_deref();
    Ok(Shows::Distance(Distance {
        from: surface(opaque, params, said)?,
        light: light.map(|name| light_of(program, name)).transpose()?,
        range: range.map(|name| range_of(program, name)).transpose()?,
    }))
}

pub(crate) fn surface(
    opaque: &Opaque<'_>,
    params: &OutputsParams,
    said: &StatedUniforms,
) -> Result<Surface, Box<Refusal>> {
    if let Some(name) = &params.position {
        let value = calls::single(opaque, names::value(opaque, name)?)?;
        let described = value.described(opaque.program);
        if !is_position(&value.inner) {
            let reason = format!("{described} is not a vector of three or four floats");
            return Err(refusal(&refusals::NOT_A_POSITION, reason));
        }
        let binding = names::binding(opaque, &value);
        if matches!(binding, Some(Binding::BuiltIn(_))) {
            let reason = format!("{described} is a place in the picture");
            return Err(refusal(&refusals::NOT_A_POSITION, reason));
        }
        if params.faces.is_some() && !binding.as_ref().is_some_and(has_derivatives) {
            let reason = format!(
                "{described} is not interpolated over the triangle, and `faces` needs such an input of the fragment \
                 stage"
            );
            return Err(refusal(&refusals::NOT_A_POSITION, reason));
        }
        return Ok(Surface::Value(value));
    }
    let follows = view::of_stages(&opaque.graph, (Some(opaque.vertex), opaque.fragment), said);
    let why = match world_position::position(&opaque.graph, opaque.vertex, &follows) {
        Ok(world) => return Ok(Surface::World(world)),
        Err(NoWorld::None) => {
            "no product of a view's matrix and a vector leads to the position".to_owned()
        }
        Err(NoWorld::Several) => {
            "several products of a view's matrix and a vector lead to the position".to_owned()
        }
        Err(NoWorld::NotAlways) => {
            "the vertex stage returns a position that no view's matrix turned, on some ways"
                .to_owned()
        }
        Err(NoWorld::Relative(name)) => format!(
            "`{name}` depends on the viewer before the view's matrix turns it, as a position \
             relative to the camera does"
        ),
        Err(NoWorld::Combined(name)) => format!(
            "`{name}` turns from the object's own space to the view's at once, so the vertex stage \
             has no position in the world"
        ),
    };
    let candidates = names::described(opaque, &|value| is_position(&value.inner));
    Err(refusal(
        &refusals::NO_POSITION,
        format!("{why}; {candidates}"),
    ))
}

/// The distance in words, for a message.
pub(crate) fn described(distance: &Distance, params: &OutputsParams) -> String {
    let surface = match &distance.from {
        Surface::Value(value) => format!("`{}`", value.name),
        Surface::World(world) => world.described(),
    };
    let (light, divided) = match (&params.light, &params.range) {
        (None, None) => (
            "`point_light.xyz`",
            ", divided by `point_light.w`".to_owned(),
        ),
        (None, Some(range)) => ("`point_light.xyz`", format!(", divided by `{range}`")),
        (Some(light), None) => (light.as_str(), String::new()),
        (Some(light), Some(range)) => (light.as_str(), format!(", divided by `{range}`")),
    };
    let clear = match distance.is_divided() {
        true => "1, the end of the range",
        false => "the largest number",
    };
    format!(
        "`outputs-distance` holds the distance of {surface} from {light}{divided}: give the \
         light's position in the same space. Where no surface is, it holds {clear}"
    )
}

fn light_of(program: &Program, name: &str) -> Result<Member, Box<Refusal>> {
    let found = names::member(program, name)?;
    match is_position(&program.module().types[found.ty].inner) {
        true => Ok(found),
        false => Err(refusal(
            &refusals::NOT_A_POSITION,
            format!("`{name}` is not a vector of three or four floats"),
        )),
    }
}

fn range_of(program: &Program, name: &str) -> Result<Member, Box<Refusal>> {
    let found = names::member(program, name)?;
    let is_float = |inner: &TypeInner| {
        matches!(inner, TypeInner::Scalar(scalar)
            if scalar.kind == ScalarKind::Float && scalar.width == 4)
    };
    match is_float(&program.module().types[found.ty].inner) {
        true => Ok(found),
        false => Err(refusal(
            &refusals::NO_SUCH_NAME,
            format!("`{name}` is no number of type f32"),
        )),
    }
}

/// Whether differences between neighbouring fragments are those of the surface.
fn has_derivatives(binding: &Binding) -> bool {
    use naga::{Interpolation, Sampling};
    let Binding::Location {
        interpolation,
        sampling,
        ..
    } = binding
    else {
        return false;
    };
    matches!(interpolation, None | Some(Interpolation::Perspective))
        && matches!(sampling, None | Some(Sampling::Center))
}

/// Whether a value may be a position: a vector of three floats, or of four.
fn is_position(inner: &TypeInner) -> bool {
    matches!(
        inner,
        TypeInner::Vector { size: VectorSize::Tri | VectorSize::Quad, scalar }
            if scalar.kind == ScalarKind::Float && scalar.width == 4
    )
}
