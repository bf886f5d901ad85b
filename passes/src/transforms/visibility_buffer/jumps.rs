//! Where a rounding of what a resolve interpolates may become any difference of a colour.
//!
//! A rasteriser and a resolve interpolate the same function of real numbers, and round differently. What follows passes that on as a rounding, until an operation jumps: a
//! comparison at the edge, a `floor` at an integer, a shadow test. What does not vary, the pixel's place, its side and flat values are the same in both.

use naga::{
    Binding, BuiltIn, DerivativeControl, Expression, Handle, ImageDimension, MathFunction,
    ResourceBinding, SampleLevel, Span, SwizzleComponent, TypeInner,
};

use super::steep;
use crate::analysis::jumps::jump;
use crate::analysis::values::{ContextId, Node, TooLarge, ValueId, Values};
use crate::core::program::Program;
use crate::core::reflect::{self, Io};
use crate::graph::Graph;

/// What roundings of interpolated values reach, in a fragment stage sliced to its colours.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reached {
    /// The first operation that jumps, and its place.
    pub jump: Option<(String, Span)>,
    /// The first operation whose slope has no bound, and its place.
    pub steep: Option<(&'static str, Span)>,
    /// Samples whose coordinates or level round otherwise, which is continuous if their sampler filters.
    pub samples: Vec<Sample>,
    /// What the stage takes anywhere of neighbours that are the driver's choice.
    pub taken: Taken,
    /// Something interpolated is read.
    pub interpolated: bool,
    /// The place of the first sample whose implicit level has a bias: a resolve scales gradients by 2 to the bias, and a sampler adds the bias to the level.
    pub biased: Option<Span>,
    /// The place of the first sample of a cube at an implicit level: of which gradients, and on which face, is the driver's choice, and gradients that are given are treated otherwise.
    pub cube: Option<Span>,
    /// A varying is interpolated linearly on the screen: between which corners, where the triangle is clipped, is the driver's choice.
    pub linear: bool,
}

/// A sample of a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The sampler, where that is one that is known.
    pub sampler: Option<ResourceBinding>,
    /// Whether the level, and along which line a filter may be anisotropic, comes of gradients.
    pub by_gradients: bool,
    /// Where it stands.
    pub span: Span,
}

/// What a fragment stage takes of its neighbours, where the driver chooses which they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Taken {
    /// `dpdx`, `dpdy`, `fwidth`.
    pub derivatives: bool,
    /// Those that are `Coarse`.
    pub coarse: bool,
    /// Samples at an implicit level, but of cubes.
    pub samples: bool,
    /// Such samples of cubes.
    pub cubes: bool,
}

impl Taken {
    /// Whether there is anything.
    pub fn any(self) -> bool {
        self != Self::default()
    }
}

/// Follows them from the inputs of the fragment entry point of that index.
///
/// # Errors
/// The stage has too many values.
pub fn reached(program: &Program, entry: usize) -> Result<Reached, TooLarge> {
    let graph = Graph::build(program);
    let values = Values::new(&graph, entry)?;
    let module = program.module();
    let inputs = reflect::inputs(module, &module.entry_points[entry].function);
    let users = values.users();
    let mut is_rounded = vec![false; values.values.len()];
    let mut work: Vec<ValueId> = Vec::new();
    let is_position = |id: ValueId| match values.values[id].node {
        Node::Input(input) => matches!(inputs.get(input).map(kind), Some(Kind::Position)),
        _ => false,
    };
    for (id, value) in values.values.iter().enumerate() {
        let Node::Input(input) = value.node else {
            continue;
        };
        match inputs.get(input).map(kind) {
            Some(Kind::Interpolated | Kind::Position) => work.push(id),
            Some(Kind::Same) | None => {}
        }
    }
    let all = 0..values.values.len();
    let samples: Vec<Sampled<'_>> = all
        .clone()
        .filter_map(|id| Sampled::new(&values, id))
        .collect();
    let implicit = || samples.iter().filter(|s| s.is_implicit());
    let cube = implicit().find(|s| s.is_cube);
    let derives = |wanted: DerivativeControl| {
        let derives =
            |e: &Expression| matches!(e, Expression::Derivative { ctrl, .. } if *ctrl == wanted);
        let mut expressions = all.clone().filter_map(|id| expression(&values, id));
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
            cubes: cube.is_some(),
        },
        interpolated: inputs.iter().any(|i| matches!(kind(i), Kind::Interpolated)),
        biased: samples
            .iter()
            .find(|s| matches!(s.level, SampleLevel::Bias(_)))
            .map(|s| s.sample.span),
        cube: cube.map(|s| s.sample.span),
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
            let Some((expression, span)) = expression(&values, *user) else {
                work.push(*user);
                continue;
            };
            if of_position && is_place(expression) {
                continue;
            }
            // A depth, a w: made between the same corners.
            out.interpolated |= of_position;
            // Of several, the one that stands first among the values: always the same.
            if let Some(name) = jumps(expression)
                && first.is_none_or(|f| *user < f)
            {
                first = Some(*user);
                out.jump = Some((name, span));
            }
            work.push(*user);
        }
    }
    // A resolve makes gradients of its own of what an implicit level is of.
    let differs = |s: &&Sampled<'_>| s.is_implicit() || is_rounded[s.id];
    out.samples = samples.iter().filter(differs).map(|s| s.sample).collect();
    out.steep = steep::steep(&values, &is_rounded).map(|(id, name)| {
        let span = expression(&values, id).map(|(_, span)| span);
        (name, span.unwrap_or(Span::UNDEFINED))
    });
    Ok(out)
}

enum Kind {
    Interpolated,
    /// Its x and y are the pixel's.
    Position,
    /// The same for rasteriser and resolve.
    Same,
}

fn kind(input: &Io) -> Kind {
    match &input.binding {
        Some(Binding::Location {
            interpolation: Some(naga::Interpolation::Flat),
            ..
        }) => Kind::Same,
        Some(Binding::Location { .. }) => Kind::Interpolated,
        Some(Binding::BuiltIn(BuiltIn::Position { .. })) => Kind::Position,
        _ => Kind::Same,
    }
}

/// The expression that a value is, or is a part of, and its place.
fn expression<'p>(values: &Values<'_, 'p>, id: ValueId) -> Option<(&'p Expression, Span)> {
    let Node::Expression(context, e, _) = values.values[id].node else {
        return None;
    };
    let expressions = &values.function(context).function.expressions;
    Some((&expressions[e], expressions.get_span(e)))
}

/// A sample among the values of a stage.
struct Sampled<'p> {
    id: ValueId,
    level: &'p SampleLevel,
    is_cube: bool,
    sample: Sample,
}

impl<'p> Sampled<'p> {
    fn new(values: &Values<'_, 'p>, id: ValueId) -> Option<Self> {
        let Node::Expression(context, ..) = values.values[id].node else {
            return None;
        };
        let (expression, span) = expression(values, id)?;
        let Expression::ImageSample {
            image,
            sampler,
            level,
            ..
        } = expression
        else {
            return None;
        };
        let cube = ImageDimension::Cube;
        let image = values.function(context).ty(values.graph.module(), *image);
        Some(Self {
            id,
            level,
            is_cube: matches!(image, TypeInner::Image { dim, .. } if *dim == cube),
            sample: Sample {
                sampler: binding(values, context, *sampler),
                by_gradients: !matches!(level, SampleLevel::Zero | SampleLevel::Exact(_)),
                span,
            },
        })
    }

    fn is_implicit(&self) -> bool {
        matches!(self.level, SampleLevel::Auto | SampleLevel::Bias(_))
    }
}

/// The binding that an expression of a fragment stage is; `None` where it is not known to be one.
fn binding(
    values: &Values<'_, '_>,
    context: ContextId,
    resource: Handle<Expression>,
) -> Option<ResourceBinding> {
    let Node::Expression(context, e, _) = values.values[values.named(context, resource)?].node
    else {
        return None;
    };
    let Expression::GlobalVariable(global) = values.function(context).function.expressions[e]
    else {
        return None;
    };
    values.graph.module().global_variables[global].binding
}

/// Whether of a position no more is taken than the pixel's place.
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

/// The name of an operation that makes any difference of a rounding in one of its operands.
fn jumps(expression: &Expression) -> Option<String> {
    match expression {
        // Of a number that is rounded: an integer is not, or its own conversion has jumped.
        Expression::As {
            kind: naga::ScalarKind::Float,
            ..
        } => None,
        Expression::ImageSample {
            gather: Some(_), ..
        } => Some("a gathered texel".to_owned()),
        Expression::ImageSample {
            depth_ref: Some(_), ..
        } => Some("a depth comparison".to_owned()),
        Expression::Math {
            fun:
                MathFunction::Pack4x8snorm
                | MathFunction::Pack4x8unorm
                | MathFunction::Pack2x16snorm
                | MathFunction::Pack2x16unorm
                | MathFunction::Pack2x16float,
            ..
        } => Some("packing".to_owned()),
        _ => jump(expression).map(str::to_owned),
    }
}
