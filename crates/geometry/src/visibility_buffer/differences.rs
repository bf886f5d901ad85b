//! Finds the values behind a fragment stage's colours that rasteriser and resolve round
//! differently.
//!
//! Both interpolate the same real-number function, and no language defines its last bits. One
//! operation later the difference may have any size: a texel's weight has steps of 1/256, a
//! highlight is steep, a comparison is a jump. The pixel's position, its facing and flat values are
//! equal in both.

use naga::{
    Binding, BuiltIn, DerivativeControl, Expression, ImageDimension, SampleLevel, Span,
    SwizzleComponent, TypeInner,
};

use naga_edit::interface::Io;
use preshade_passes::analysis::values::{Node, ValueId, Values};

/// Values that rasteriser and resolve round differently, in a fragment stage sliced to its colours.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Reached {
    /// Place of the first expression that reads an interpolated value, or that samples at an
    /// implicit level.
    pub rounded: Option<Span>,
    /// Whether it reads an interpolated value.
    pub interpolated: bool,
    /// The stage's uses of quad neighbours that the driver chooses.
    pub taken: Taken,
}

/// The stage's uses of quad neighbours, if the driver chooses them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Taken {
    /// `dpdx`, `dpdy`, `fwidth`.
    pub derivatives: bool,
    /// The `Coarse` variants.
    pub coarse: bool,
    /// Implicit-LOD samples, without cubes.
    pub samples: bool,
    /// Implicit-LOD samples of cubes.
    pub cubes: bool,
}

impl Taken {
    /// Whether any field is set.
    pub fn any(self) -> bool {
        self != Self::default()
    }
}

/// Finds the differently rounded values of a stage.
pub(crate) fn reached(values: &Values<'_, '_>) -> Reached {
    let users = values.users();
    let mut out = Reached::default();
    let mut first: Option<ValueId> = None;
    let mut rounds = |id: ValueId| first = Some(first.map_or(id, |f| f.min(id)));
    for (id, value) in values.values.iter().enumerate() {
        if let Node::Input(input) = value.node {
            let Some(kind) = values.inputs.get(input).map(kind) else {
                continue;
            };
            let reads = |user: &&ValueId| match (kind, expression(values, **user)) {
                (InputKind::Same, _) => false,
                // Depth and w are interpolated between the same corners.
                (InputKind::Position, Some((expression, _))) => !is_place(expression),
                (InputKind::Position | InputKind::Interpolated, _) => true,
            };
            if let Some(user) = users[id].iter().find(reads) {
                out.interpolated = true;
                rounds(*user);
            }
        }
        match expression(values, id) {
            Some((Expression::Derivative { ctrl, .. }, _)) => match ctrl {
                DerivativeControl::None => out.taken.derivatives = true,
                DerivativeControl::Coarse => out.taken.coarse = true,
                DerivativeControl::Fine => {}
            },
            Some((
                Expression::ImageSample {
                    image,
                    level: SampleLevel::Auto | SampleLevel::Bias(_),
                    ..
                },
                _,
            )) => {
                match is_cube(values, id, *image) {
                    true => out.taken.cubes = true,
                    false => out.taken.samples = true,
                }
                rounds(id);
            }
            _ => {}
        }
    }
    let place = |id| expression(values, id).map_or(Span::UNDEFINED, |(_, span)| span);
    out.rounded = first.map(place);
    out
}

#[derive(Clone, Copy)]
enum InputKind {
    Interpolated,
    /// Only its x and y equal the pixel's.
    Position,
    /// Equal in rasteriser and resolve.
    Same,
}

fn kind(input: &Io) -> InputKind {
    match &input.binding {
        Some(Binding::Location {
            interpolation: Some(naga::Interpolation::Flat),
            ..
        }) => InputKind::Same,
        Some(Binding::Location { .. }) => InputKind::Interpolated,
        Some(Binding::BuiltIn(BuiltIn::Position { .. })) => InputKind::Position,
        _ => InputKind::Same,
    }
}

/// The expression of a value or its component, and the place.
fn expression<'p>(values: &Values<'_, 'p>, id: ValueId) -> Option<(&'p Expression, Span)> {
    let Node::Expression(context, e, _) = values.values[id].node else {
        return None;
    };
    let expressions = &values.function(context).function.expressions;
    Some((&expressions[e], expressions.get_span(e)))
}

fn is_cube(values: &Values<'_, '_>, sample: ValueId, image: naga::Handle<Expression>) -> bool {
    let Node::Expression(context, ..) = values.values[sample].node else {
        return false;
    };
    let cube = ImageDimension::Cube;
    let image = values.function(context).ty(values.graph.module(), image);
    matches!(image, TypeInner::Image { dim, .. } if *dim == cube)
}

/// Whether only the pixel coordinates of a position are used.
fn is_place(expression: &Expression) -> bool {
    use SwizzleComponent::{X, Y};
    match expression {
        Expression::AccessIndex { index, .. } => *index < 2,
        Expression::Swizzle { size, pattern, .. } => {
            pattern[..*size as usize].iter().all(|c| matches!(c, X | Y))
        }
        _ => false,
    }
}
