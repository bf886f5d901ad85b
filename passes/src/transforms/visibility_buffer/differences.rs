//! Finds where a rounding difference of interpolated values may become an arbitrary colour
//! difference.
//!
//! A rasteriser and a resolve interpolate the same real-number function with different rounding.
//! Operations pass this on as rounding until one has a discontinuity: a comparison, a `floor`, a
//! shadow test. Values that are the same in both, such as the pixel's place, its facing and flat
//! values, do not matter.

use naga::{
    Binding, BuiltIn, DerivativeControl, Expression, ImageDimension, SampleLevel, Span,
    SwizzleComponent, TypeInner,
};

use super::steep;
use crate::analysis::operations;
use crate::analysis::values::{Node, ValueId, Values};
use crate::core::reflect::Io;

/// The places that rounding differences reach, in a fragment stage sliced to its colours.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reached {
    /// The first operation with a discontinuity, and its place.
    pub discontinuity: Option<(&'static str, Span)>,
    /// The first operation with an unbounded slope, and its place.
    pub steep: Option<(&'static str, Span)>,
    /// Place of the first sample whose coordinates or level have rounding differences. It is
    /// continuous if its sampler filters, but texel weights are stored in steps of 1/256.
    pub sample: Option<Span>,
    /// The stage's uses of quad neighbours that the driver chooses.
    pub taken: Taken,
    /// Whether it reads an interpolated value.
    pub interpolated: bool,
    /// Whether a varying has linear interpolation: for clipped triangles the driver chooses the
    /// corners.
    pub linear: bool,
}

/// The stage's uses of quad neighbours, if the driver chooses them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Taken {
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

/// Follows rounding differences from the inputs of the fragment stage.
pub fn reached(values: &Values<'_, '_>) -> Reached {
    let inputs = &values.inputs;
    let users = values.users();
    let mut is_rounded = vec![false; values.values.len()];
    let mut work: Vec<ValueId> = Vec::new();
    let is_position = |id: ValueId| match values.values[id].node {
        Node::Input(input) => matches!(inputs.get(input).map(kind), Some(InputKind::Position)),
        _ => false,
    };
    for (id, value) in values.values.iter().enumerate() {
        let Node::Input(input) = value.node else {
            continue;
        };
        match inputs.get(input).map(kind) {
            Some(InputKind::Interpolated | InputKind::Position) => work.push(id),
            Some(InputKind::Same) | None => {}
        }
    }
    let all = 0..values.values.len();
    let samples: Vec<Sampled<'_>> = all
        .clone()
        .filter_map(|id| Sampled::new(values, id))
        .collect();
    let implicit = || samples.iter().filter(|s| s.is_implicit());
    let derives = |wanted: DerivativeControl| {
        let derives =
            |e: &Expression| matches!(e, Expression::Derivative { ctrl, .. } if *ctrl == wanted);
        let mut expressions = all.clone().filter_map(|id| expression(values, id));
        expressions.any(|(e, _)| derives(e))
    };
    let is_linear = |input: &Io| {
        let linear = Some(naga::Interpolation::Linear);
        matches!(input.binding, Some(Binding::Location { interpolation, .. }) if interpolation == linear)
    };
    let mut out = Reached {
        taken: Taken {
            derivatives: derives(DerivativeControl::None),
            coarse: derives(DerivativeControl::Coarse),
            samples: implicit().any(|s| !s.is_cube),
            cubes: implicit().any(|s| s.is_cube),
        },
        interpolated: inputs
            .iter()
            .any(|i| matches!(kind(i), InputKind::Interpolated)),
        linear: inputs.iter().any(is_linear),
        ..Reached::default()
    };
    let mut first: Option<ValueId> = None;
    while let Some(id) = work.pop() {
        if std::mem::replace(&mut is_rounded[id], true) {
            continue;
        }
        let of_position = is_position(id);
        for user in &users[id] {
            let Some((expression, span)) = expression(values, *user) else {
                work.push(*user);
                continue;
            };
            if of_position && is_place(expression) {
                continue;
            }
            // Depth and w are interpolated between the same corners.
            out.interpolated |= of_position;
            // Of several, take the first among the values, for a stable result.
            if let Some(name) = discontinuity(expression)
                && first.is_none_or(|f| *user < f)
            {
                first = Some(*user);
                out.discontinuity = Some((name, span));
            }
            work.push(*user);
        }
    }
    // A resolve computes its own gradients for implicit levels.
    let differs = |s: &&Sampled<'_>| s.is_implicit() || is_rounded[s.id];
    out.sample = samples.iter().find(differs).map(|s| s.span);
    out.steep = steep::steep(values, &is_rounded).map(|(id, name)| {
        let span = expression(values, id).map(|(_, span)| span);
        (name, span.unwrap_or(Span::UNDEFINED))
    });
    out
}

enum InputKind {
    Interpolated,
    /// Its x and y are the pixel's.
    Position,
    /// The same in rasteriser and resolve.
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

/// A sample among a stage's values.
struct Sampled<'p> {
    id: ValueId,
    level: &'p SampleLevel,
    is_cube: bool,
    span: Span,
}

impl<'p> Sampled<'p> {
    fn new(values: &Values<'_, 'p>, id: ValueId) -> Option<Self> {
        let Node::Expression(context, ..) = values.values[id].node else {
            return None;
        };
        let (expression, span) = expression(values, id)?;
        let Expression::ImageSample { image, level, .. } = expression else {
            return None;
        };
        let cube = ImageDimension::Cube;
        let image = values.function(context).ty(values.graph.module(), *image);
        Some(Self {
            id,
            level,
            is_cube: matches!(image, TypeInner::Image { dim, .. } if *dim == cube),
            span,
        })
    }

    fn is_implicit(&self) -> bool {
        matches!(self.level, SampleLevel::Auto | SampleLevel::Bias(_))
    }
}

/// Whether only the pixel's place of a position is used.
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

/// The name of an operation that turns a rounding difference of an operand into an arbitrary
/// difference.
fn discontinuity(expression: &Expression) -> Option<&'static str> {
    match expression {
        // Conversions of rounded numbers. Integers have no rounding, unless a conversion already
        // had the discontinuity.
        Expression::As {
            kind: naga::ScalarKind::Float,
            ..
        } => None,
        _ => operations::discontinuity(expression)
            .or_else(|| operations::of_sample(expression))
            .map(|d| d.name),
    }
}
