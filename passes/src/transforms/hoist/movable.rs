//! Decides which values may move to the vertex stage and how, and why the others must not.

use std::collections::VecDeque;
use std::sync::Arc;

use naga::ScalarKind;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::form::{Form, forms};
use super::{choose, discontinuity};
use crate::analysis::loops::{LoopEnds, iterated};
use crate::analysis::range::AllRanges;
use crate::analysis::reach::with_operands;
use crate::analysis::rounding::Roundings;
use crate::analysis::values::{Node, ValueId, Values};
use crate::analysis::{contraction, hazard, operations, subnormal, transitive_cost};
use preshade_dataflow::graph::effect;
use preshade_dataflow::graph::rate::{At, Interpolated, Rate};
use preshade_plan::pass::SourceRange;

/// How a value may move, from the strongest contract to the weakest.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Class {
    /// Flat constants of the draw or primitive that no compiler fuses into their reader, or
    /// components of a varying: the same bits.
    Exact,
    /// Affine in varyings of one interpolation class with draw-uniform coefficients, or a flat
    /// constant that a compiler may fuse: the same real number with other rounding.
    Affine,
    /// Anything else: interpolation changes the value.
    Smooth,
}

/// How a value is interpolated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Carriage {
    /// The effect on the value.
    pub class: Class,
    pub interpolated: Interpolated,
    /// Interpolation location in the pixel.
    pub at: At,
}

/// Why a value must stay in the fragment stage.
#[derive(
    Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum NotHoisted {
    /// No varying can hold it: a pointer, a struct, an array; or it is the same for every draw; or
    /// to compute it once costs a fragment no more than to read a varying.
    NotCarried,
    /// It is an incoming varying.
    Varying,
    /// No vertex stage can compute it.
    Fragment {
        /// The reason: a derivative, an implicit level of detail, or a fragment input.
        because: String,
    },
    /// It changes between iterations of a loop.
    InLoop,
    /// Fragments differ in whether they compute it.
    Conditional,
    /// It depends on a loop that may not end.
    MayNotEnd,
    /// It mixes a flat value with a smooth one. A vertex sees its own flat value, the fragment the
    /// provoking vertex's.
    FlatAndSmooth,
    /// It decides coverage or depth, which need the same bits.
    Coverage,
    /// It is discontinuous: interpolation between vertices is meaningless.
    Discontinuous {
        /// The operation.
        operation: String,
    },
    /// A periodic operation uses it: a small error becomes a full step.
    Reaches {
        /// The periodic operation.
        operation: String,
    },
    /// It is not among the chosen values.
    NotChosen,
    /// Its measured error is too large.
    Measured {
        /// The error in the budget's metric.
        error: String,
    },
    /// Measurement found that it, or a pixel drawn with it, is not finite.
    MeasuredNotFinite,
    /// It was not measured, although other values were.
    NotMeasured,
    /// It may be NaN or infinite at a vertex, which would spoil the whole triangle.
    MayNotBeFinite {
        /// The operation.
        operation: String,
    },
    /// It depends on a number that may be subnormal in the scene. Some stages of a driver take it for 0.
    Subnormal,
    /// It may overflow `f32` at a vertex.
    MayOverflow {
        /// The operation.
        operation: String,
    },
}

impl From<discontinuity::Discontinuity> for NotHoisted {
    fn from(discontinuity: discontinuity::Discontinuity) -> Self {
        match discontinuity {
            discontinuity::Discontinuity::Own(operation) => Self::Discontinuous {
                operation: operation.to_owned(),
            },
            discontinuity::Discontinuity::Amplified(operation) => Self::Reaches {
                operation: operation.to_owned(),
            },
        }
    }
}

impl std::fmt::Display for NotHoisted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NotCarried => f.write_str("a varying cannot hold its type"),
            Self::Varying => f.write_str("it is already a varying"),
            Self::Fragment { because } => f.write_str(because),
            Self::InLoop => f.write_str("it changes with each iteration of a loop"),
            Self::Conditional => f.write_str("some fragments do not compute it"),
            Self::MayNotEnd => f.write_str(
                "it depends on a loop that may not end: count to a constant, to `min(n, 16)`, or \
                 to a number in a uniform buffer",
            ),
            Self::FlatAndSmooth => f.write_str("it mixes a flat value with an interpolated one"),
            Self::Coverage => f.write_str("it decides a discard, a depth or the sample mask"),
            Self::Discontinuous { operation } => {
                write!(
                    f,
                    "`{operation}` has a discontinuity, and interpolation would give values in \
                     between"
                )
            }
            Self::Reaches { operation } => write!(
                f,
                "`{operation}` is applied to this value later, so a tiny interpolation error would \
                 become a full step"
            ),
            Self::NotChosen => f.write_str("it is not among the chosen values"),
            Self::Measured { error } => write!(f, "hoisted alone, it causes an error of {error}"),
            Self::MeasuredNotFinite => f.write_str(
                "it was measured: it, or a pixel drawn with it, is NaN or infinite somewhere",
            ),
            Self::NotMeasured => f.write_str("its error was not measured"),
            Self::MayNotBeFinite { operation } => write!(
                f,
                "`{operation}` may be NaN or infinite at a vertex, which would spoil the whole \
                 triangle"
            ),
            Self::Subnormal => f.write_str(
                "it depends on a subnormal number, which some stages of a driver take for 0",
            ),
            Self::MayOverflow { operation } => write!(
                f,
                "`{operation}` may overflow `f32` at a vertex, which would spoil the whole \
                 triangle (without a scene, inputs are assumed to be below 2^20)"
            ),
        }
    }
}

/// Assumption about values at vertices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Finite {
    /// Only values that are proved finite may move.
    #[default]
    Proved,
    /// All values are assumed finite at every vertex.
    Assumed,
}

/// Assumption about values that depend on a discontinuity: a `floor`, a comparison, an integer, a
/// branch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Jumps {
    /// They must not move, unless range analysis excludes the discontinuity.
    #[default]
    Stay,
    /// They are assumed to vary slowly over a triangle, as noise does although it uses `floor`.
    Carried,
}

/// Assumptions about unmeasured values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Assumed {
    pub finite: Finite,
    pub jumps: Jumps,
}

impl Assumed {
    pub const ALL: Self = Self {
        finite: Finite::Assumed,
        jumps: Jumps::Carried,
    };
}

/// How a value may move, or why it must not.
pub(crate) type Verdict = Result<Carriage, NotHoisted>;

/// The verdicts of a fragment stage's values.
#[derive(Clone, Debug)]
pub struct Judged {
    pub verdicts: Vec<Verdict>,
    /// Rounding error of the outputs if values move.
    pub roundings: Arc<Roundings>,
    /// Whether moving each value only changes its rounding: it is affine in the varyings, or fused.
    pub affine: Arc<[bool]>,
    /// Ids of an earlier choice that no value has.
    pub unknown: Vec<String>,
}

/// The required precision of the outputs, and the ranges that decide it.
#[derive(Clone, Debug, PartialEq)]
pub struct Precision {
    /// Ranges of varyings and draw constants; empty without a scene.
    pub ranges: Vec<SourceRange>,
    /// Largest change of an output by rounding.
    pub most: f64,
}

impl Precision {
    /// Allows no rounding.
    pub const EXACT: Self = Self {
        ranges: Vec::new(),
        most: -1.0,
    };
}

/// Restricts verdicts under [`Assumed::ALL`] to those under `assumed`.
pub(super) fn held_back(
    values: &Values<'_, '_>,
    assumed: Assumed,
    precision: &Precision,
    all: &[Verdict],
) -> Vec<Verdict> {
    let mut verdicts = all.to_vec();
    let mut hold = |reasons: Vec<Option<NotHoisted>>, holds: fn(&Carriage) -> bool| {
        for (verdict, reason) in verdicts.iter_mut().zip(reasons) {
            if let (Ok(carriage), Some(reason)) = (&*verdict, reason)
                && carriage.class == Class::Smooth
                && holds(carriage)
            {
                *verdict = Err(reason);
            }
        }
    };
    if assumed == Assumed::ALL {
        return verdicts;
    }
    let known = &precision.ranges;
    let ranges = AllRanges::new(values, values.cycles(), known, hazard::LARGEST_INPUT);
    if assumed.jumps == Jumps::Stay {
        let reached = discontinuity::reached(values, &ranges).into_iter();
        hold(reached.map(|d| d.map(NotHoisted::from)).collect(), |_| true);
    }
    if assumed.finite == Finite::Proved {
        // A flat value equals the one that every fragment computed, NaN or not.
        hold(hazards(values, &ranges), |c| {
            c.interpolated != Interpolated::Flat
        });
    }
    verdicts
}

/// The verdict of each value under [`Assumed::ALL`].
pub(super) fn judge(values: &Values<'_, '_>, precision: &Precision) -> Judged {
    let forms = forms(values);
    let ends = LoopEnds::new(values);
    let iterated = iterated(values);
    let pins = pins(values);
    let unsteady = contraction::unsteady(values);
    let has_parts = forms.contains(&Form::Part);
    let twins = has_parts.then(|| contraction::twins(values));
    let is_twin = |id: ValueId| twins.as_ref().is_some_and(|twins| twins[id]);
    let is_rounded = |id: ValueId| match forms[id] {
        Form::Affine => true,
        Form::Uniform => unsteady[id],
        Form::Part | Form::Other => false,
    };
    let may = |id: ValueId| is_rounded(id) && values.values[id].fact.stages.vertex;
    let roundings = Roundings::new(values, &precision.ranges, &unsteady, may);
    let coverage = with_operands(values, values.coverage.clone());
    let subnormal = subnormal::changed(values, &precision.ranges);
    let verdicts = (0..values.values.len())
        .map(|id| {
            let scalar = carried_scalar(values, id)?;
            let (context, e, at) = values.expression(id).ok_or(NotHoisted::NotCarried)?;
            let fact = values.values[id].fact;
            if !fact.stages.vertex {
                let because = what_pins(values, pins[id]);
                return Err(NotHoisted::Fragment { because });
            }
            if subnormal[id] {
                return Err(NotHoisted::Subnormal);
            }
            if !ends.may_end(id) {
                return Err(NotHoisted::MayNotEnd);
            }
            if iterated[id] {
                return Err(NotHoisted::InLoop);
            }
            if values.control_rate(context, at) > Rate::Draw {
                return Err(NotHoisted::Conditional);
            }
            let carriage = |class, interpolated, at| Carriage {
                class,
                interpolated,
                at,
            };
            let (interpolated, at) = match fact.rate {
                Rate::Const => return Err(NotHoisted::NotCarried),
                Rate::Draw | Rate::Instance | Rate::Varying(Interpolated::Flat, _) => {
                    if fact.rate == Rate::Draw && is_cheap(values, id) {
                        return Err(NotHoisted::NotCarried);
                    }
                    // A compiler that fuses it into its reader rounds differently from one that
                    // does not see both.
                    let class = match unsteady[id] {
                        false => Class::Exact,
                        true if coverage[id] => return Err(NotHoisted::Coverage),
                        true if roundings.of(id) <= precision.most => Class::Affine,
                        true => Class::Smooth,
                    };
                    return Ok(carriage(class, Interpolated::Flat, At::Center));
                }
                Rate::Varying(interpolated, at) => (interpolated, at),
                Rate::Mixed => (Interpolated::Perspective, At::Center),
                Rate::Vertex | Rate::Fragment | Rate::Sample => {
                    return Err(NotHoisted::FlatAndSmooth);
                }
            };
            if scalar != ScalarKind::Float {
                return Err(NotHoisted::Discontinuous {
                    operation: "an integer".to_owned(),
                });
            }
            // In two varyings, a compiler no longer sees that two names are one component.
            if forms[id] == Form::Part && is_twin(id) {
                return Err(NotHoisted::NotCarried);
            }
            if forms[id] == Form::Part {
                return Ok(carriage(Class::Exact, interpolated, at));
            }
            if coverage[id] {
                return Err(NotHoisted::Coverage);
            }
            if forms[id] == Form::Affine && roundings.of(id) <= precision.most {
                return Ok(carriage(Class::Affine, interpolated, at));
            }
            let expression = &values.function(context).function.expressions[e];
            if let Some(found) = operations::discontinuity(expression) {
                let operation = found.name.to_owned();
                return Err(NotHoisted::Discontinuous { operation });
            }
            Ok(carriage(Class::Smooth, interpolated, at))
        })
        .collect();
    Judged {
        verdicts,
        roundings: Arc::new(roundings),
        affine: (0..values.values.len()).map(is_rounded).collect(),
        unknown: Vec::new(),
    }
}

/// Whether a constant of the draw costs a fragment no more to compute once than to read from a flat
/// varying.
fn is_cheap(values: &Values<'_, '_>, id: ValueId) -> bool {
    let shape = values.shape(id);
    shape.is_some_and(|(_, width)| {
        transitive_cost::is_cheap(values, id, choose::FLAT_PRICE * f64::from(width))
    })
}

/// Scalar type of a value that a varying can hold: 32-bit scalars and vectors.
fn carried_scalar(values: &Values<'_, '_>, id: ValueId) -> Result<ScalarKind, NotHoisted> {
    match values.shape(id) {
        Some((s, _)) if s.width == 4 && s.kind != ScalarKind::Bool => Ok(s.kind),
        _ if matches!(values.values[id].node, Node::Input(_)) => Err(NotHoisted::Varying),
        _ => Err(NotHoisted::NotCarried),
    }
}

/// For each value, the nearest dependence (or itself) that is pinned to the fragment stage.
fn pins(values: &Values<'_, '_>) -> Vec<Option<ValueId>> {
    // Breadth-first from all pins at once.
    let users = values.users();
    let mut distance = vec![usize::MAX; values.values.len()];
    let mut queue: VecDeque<ValueId> = (0..values.values.len())
        .filter(|id| values.is_pinned(*id))
        .collect();
    for id in &queue {
        distance[*id] = 0;
    }
    let mut pins: Vec<Option<ValueId>> = vec![None; values.values.len()];
    while let Some(id) = queue.pop_front() {
        // If several are equally near, the one through the first operand.
        let operands = &values.values[id].operands;
        pins[id] = match distance[id] {
            0 => Some(id),
            here => operands
                .iter()
                .find(|o| distance[**o] == here - 1)
                .and_then(|o| pins[*o]),
        };
        for user in &users[id] {
            if distance[*user] == usize::MAX {
                distance[*user] = distance[id] + 1;
                queue.push_back(*user);
            }
        }
    }
    pins
}

/// A message about why a value is pinned.
fn what_pins(values: &Values<'_, '_>, pin: Option<ValueId>) -> String {
    let Some(pin) = pin else {
        return "it depends on a value that only a fragment has".to_owned();
    };
    match &values.values[pin].node {
        Node::Input(i) => {
            let name = values.inputs.get(*i).and_then(|io| io.name.as_deref());
            format!(
                "it depends on the fragment input `{}`, which a vertex does not have",
                name.unwrap_or_default()
            )
        }
        Node::Expression(context, e, _) => {
            let expression = &values.function(*context).function.expressions[*e];
            match effect::of_expression(expression) {
                Some(effect::Effect::Derivative) => "it depends on a derivative, which cannot be \
                    computed per vertex"
                    .to_owned(),
                Some(effect::Effect::ImplicitLod) => {
                    "it depends on a texture sample at an implicit level of detail, which needs \
                     derivatives and cannot run per vertex"
                        .to_owned()
                }
                _ => "it depends on memory that shader invocations write".to_owned(),
            }
        }
        _ => "it depends on memory that shader invocations write".to_owned(),
    }
}

/// For each value, an operation in its computation whose result may be NaN or infinite.
fn hazards(values: &Values<'_, '_>, ranges: &AllRanges) -> Vec<Option<NotHoisted>> {
    let computed = AllRanges::computed(values, values.cycles());
    let users = values.users();
    let hazard = |id: ValueId| {
        let (context, e, _) = values.expression(id)?;
        let undefined = hazard::undefined(values, &computed, context, e);
        let undefined = undefined.map(|operation| NotHoisted::MayNotBeFinite {
            operation: operation.to_owned(),
        });
        undefined.or_else(|| {
            hazard::overflow(values, ranges, id).map(|operation| NotHoisted::MayOverflow {
                operation: operation.to_owned(),
            })
        })
    };
    let mut hazards: Vec<Option<NotHoisted>> = (0..values.values.len()).map(hazard).collect();
    // An undefined result explains more than the overflow it causes.
    let is_undefined =
        |h: &Option<NotHoisted>| matches!(h, Some(NotHoisted::MayNotBeFinite { .. }));
    let (undefined, rest): (Vec<ValueId>, Vec<ValueId>) = (0..hazards.len())
        .filter(|id| hazards[*id].is_some())
        .partition(|id| is_undefined(&hazards[*id]));
    for mut work in [undefined, rest] {
        while let Some(id) = work.pop() {
            for user in &users[id] {
                let is_weaker = is_undefined(&hazards[id]) && !is_undefined(&hazards[*user]);
                if hazards[*user].is_none() || is_weaker {
                    hazards[*user] = hazards[id].clone();
                    work.push(*user);
                }
            }
        }
    }
    hazards
}
