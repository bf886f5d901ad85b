//! Which values may travel from the vertex stage, as what, and why the others stay.

use naga::{BinaryOperator, Expression, MathFunction, ScalarKind, Statement, TypeInner};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::form::{Form, forms};
use super::sensitive::{sensitive, with_operands, with_users};
use super::sign::Signs;
use super::values::{ContextId, Node, ValueId, Values};
use crate::graph::memory::Origin;
use crate::graph::rate::{At, Interpolated, Rate};
use crate::graph::{StmtId, cost, effect};
use crate::reflect;

/// As what a value may travel. Ordered from the strongest promise to the weakest.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Class {
    /// Constant over the draw or over the primitive and carried flat, or components of a varying: the same bits.
    Exact,
    /// Affine in varyings of one interpolation class with coefficients of the draw: the same real number, rounded elsewhere.
    Affine,
    /// Anything else: the interpolated value is another one.
    Smooth,
}

/// How a value is carried.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Carriage {
    /// What that does to it.
    pub class: Class,
    /// Interpolation.
    pub interpolated: Interpolated,
    /// Where in the pixel.
    pub at: At,
}

/// Why a value stays in the fragment stage.
#[derive(
    Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Stays {
    /// There is nothing to carry: a pointer, a struct, an array, or what is the same for every draw.
    NotCarried,
    /// It is an incoming varying already.
    Varying,
    /// No vertex stage can have it.
    Fragment {
        /// What ties it to the fragment: a derivative, an implicit level of detail, or an input.
        because: String,
    },
    /// It is another in each turn of a loop.
    InLoop,
    /// Whether it is computed differs between fragments.
    Conditional,
    /// It rests on a loop that is not seen to end.
    MayNotEnd,
    /// It mixes a flat value with a smooth one: a vertex sees its own flat value, the fragment the provoking vertex's.
    FlatAndSmooth,
    /// It decides which fragments there are, or how deep: the same bits are wanted there.
    Coverage,
    /// It jumps: between two vertices there is no value in between.
    Discontinuous {
        /// The operation.
        operation: String,
    },
    /// It is not one of those that were chosen.
    NotChosen,
    /// It was measured: the picture differs by more than is wanted.
    Measured {
        /// By how much, in the budget's metric.
        error: String,
    },
    /// It was measured: there are pixels that are not finite.
    MeasuredNotFinite,
    /// It was not measured, though others were.
    NotMeasured,
    /// It may be NaN or infinite at a vertex, and would spoil the whole triangle.
    MayNotBeFinite {
        /// The operation.
        operation: String,
    },
}

impl std::fmt::Display for Stays {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NotCarried => f.write_str("it is not a value that a varying can hold"),
            Self::Varying => f.write_str("it is a varying already"),
            Self::Fragment { because } => write!(f, "no vertex stage has it: {because}"),
            Self::InLoop => f.write_str("it is another in each turn of a loop"),
            Self::Conditional => f.write_str("whether it is computed differs between fragments"),
            Self::MayNotEnd => f.write_str("it rests on a loop that is not seen to end"),
            Self::FlatAndSmooth => f.write_str("it mixes a flat value with a smooth one"),
            Self::Coverage => {
                f.write_str("it decides a discard, or the depth or the samples of the fragment")
            }
            Self::Discontinuous { operation } => {
                write!(
                    f,
                    "`{operation}` jumps: interpolation would make up values between"
                )
            }
            Self::NotChosen => f.write_str("it is not among the chosen values"),
            Self::Measured { error } => write!(f, "carried alone it makes an error of {error}"),
            Self::MeasuredNotFinite => {
                f.write_str("carried alone it makes pixels that are not finite")
            }
            Self::NotMeasured => f.write_str("carrying it was not measured"),
            Self::MayNotBeFinite { operation } => write!(
                f,
                "`{operation}` may be NaN or infinite at a vertex, which would spoil the whole triangle"
            ),
        }
    }
}

/// What may be assumed of values at vertices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Finite {
    /// Only what is seen from the code to be finite travels.
    #[default]
    Proved,
    /// All values are taken to be finite at every vertex.
    Assumed,
}

/// For each value, how it may be carried or why it stays.
pub fn judge(values: &Values<'_, '_>, finite: Finite) -> Vec<Result<Carriage, Stays>> {
    let forms = forms(values);
    let endless = endless(values);
    let sensitive = sensitive(values);
    let coverage = with_operands(values, values.coverage.clone());
    let hazards = match finite {
        Finite::Proved => hazards(values),
        Finite::Assumed => vec![None; values.values.len()],
    };
    (0..values.values.len())
        .map(|id| {
            let scalar = carried_scalar(values, id)?;
            let (context, e, at) = values.expression(id).ok_or(Stays::NotCarried)?;
            let fact = values.values[id].fact;
            if !fact.stages.vertex {
                let because = what_pins(values, id);
                return Err(Stays::Fragment { because });
            }
            if endless[id] {
                return Err(Stays::MayNotEnd);
            }
            if turns(values, id, &loops_around(values, context, at)) {
                return Err(Stays::InLoop);
            }
            if values.control_rate(context, at) > Rate::Draw {
                return Err(Stays::Conditional);
            }
            let carriage = |class, interpolated, at| Carriage {
                class,
                interpolated,
                at,
            };
            let flat = carriage(Class::Exact, Interpolated::Flat, At::Center);
            let (interpolated, at) = match fact.rate {
                Rate::Const => return Err(Stays::NotCarried),
                Rate::Draw | Rate::Instance | Rate::Varying(Interpolated::Flat, _) => {
                    return Ok(flat);
                }
                Rate::Varying(interpolated, at) => (interpolated, at),
                Rate::Mixed => (Interpolated::Perspective, At::Center),
                Rate::Vertex | Rate::Fragment | Rate::Sample => return Err(Stays::FlatAndSmooth),
            };
            if scalar != ScalarKind::Float {
                return Err(Stays::Discontinuous {
                    operation: "an integer".to_owned(),
                });
            }
            if forms[id] == Form::Part {
                return Ok(carriage(Class::Exact, interpolated, at));
            }
            if coverage[id] {
                return Err(Stays::Coverage);
            }
            if forms[id] == Form::Affine && !sensitive[id] {
                return Ok(carriage(Class::Affine, interpolated, at));
            }
            let expression = &values.function(context).function.expressions[e];
            if let Some(operation) = jump(expression) {
                return Err(Stays::Discontinuous { operation });
            }
            if let Some(hazard) = &hazards[id] {
                return Err(Stays::MayNotBeFinite {
                    operation: hazard.clone(),
                });
            }
            Ok(carriage(Class::Smooth, interpolated, at))
        })
        .collect()
}

/// Kind of the scalars of a value that a varying can hold: 32-bit scalars and vectors.
fn carried_scalar(values: &Values<'_, '_>, id: ValueId) -> Result<ScalarKind, Stays> {
    let Some((context, e, _)) = values.expression(id) else {
        return Err(match values.values[id].node {
            Node::Input(_) => Stays::Varying,
            _ => Stays::NotCarried,
        });
    };
    match values.function(context).ty(values.graph.module(), e) {
        TypeInner::Scalar(s) | TypeInner::Vector { scalar: s, .. }
            if s.width == 4 && s.kind != ScalarKind::Bool =>
        {
            Ok(s.kind)
        }
        _ => Err(Stays::NotCarried),
    }
}

/// The loops a statement stands in, those around the calls that lead to it included.
fn loops_around(
    values: &Values<'_, '_>,
    context: ContextId,
    at: StmtId,
) -> Vec<(ContextId, StmtId)> {
    let mut loops = Vec::new();
    let mut place = Some((context, at));
    while let Some((context, at)) = place {
        let statements = &values.function(context).statements;
        loops.extend(
            statements
                .ancestors(at)
                .filter(|a| matches!(statements.get(*a).statement, Statement::Loop { .. }))
                .map(|a| (context, a)),
        );
        place = values.contexts[context].call;
    }
    loops
}

/// Whether a value may differ from turn to turn of these loops: it rests on what they carry from one to the next.
fn turns(values: &Values<'_, '_>, id: ValueId, loops: &[(ContextId, StmtId)]) -> bool {
    if loops.is_empty() {
        return false;
    }
    let mut seen = vec![false; values.values.len()];
    let mut stack = vec![id];
    while let Some(at) = stack.pop() {
        if std::mem::replace(&mut seen[at], true) {
            continue;
        }
        if let Node::Version(context, version) = values.values[at].node
            && let Origin::Phi {
                at: Some(merge), ..
            } = values.function(context).memory.origin(version)
            && loops.contains(&(context, *merge))
        {
            return true;
        }
        stack.extend(&values.values[at].operands);
    }
    false
}

/// In words, what ties a value to the fragment stage.
fn what_pins(values: &Values<'_, '_>, id: ValueId) -> String {
    let mut seen = vec![false; values.values.len()];
    let mut queue = std::collections::VecDeque::from([id]);
    while let Some(at) = queue.pop_front() {
        if std::mem::replace(&mut seen[at], true) {
            continue;
        }
        if values.is_pinned(at) {
            let module = values.graph.module();
            return match &values.values[at].node {
                Node::Input(i) => {
                    let inputs = reflect::inputs(module, values.function(0).function);
                    let name = inputs.get(*i).and_then(|io| io.name.clone());
                    format!("it rests on the input `{}`", name.unwrap_or_default())
                }
                Node::Expression(context, e, _) => {
                    let expression = &values.function(*context).function.expressions[*e];
                    match effect::of_expression(expression) {
                        Some(effect::Effect::Derivative) => "it rests on a derivative".to_owned(),
                        Some(effect::Effect::ImplicitLod) => {
                            "it rests on a texture sample at an implicit level of detail".to_owned()
                        }
                        _ => "it rests on memory that invocations write".to_owned(),
                    }
                }
                _ => "it rests on memory that invocations write".to_owned(),
            };
        }
        queue.extend(
            values.values[at]
                .operands
                .iter()
                .filter(|o| !values.values[**o].fact.stages.vertex),
        );
    }
    "it rests on what only a fragment has".to_owned()
}

/// Values that rest on a loop of which it is not seen how many turns it makes.
fn endless(values: &Values<'_, '_>) -> Vec<bool> {
    let module = values.graph.module();
    let ends_unseen = |id: ValueId| {
        let (context, at) = match values.values[id].node {
            Node::Version(context, v) => match values.function(context).memory.origin(v) {
                Origin::Phi { at: Some(at), .. } => (context, *at),
                _ => return false,
            },
            Node::Control(context, at) => (context, at),
            _ => return false,
        };
        let f = values.function(context);
        std::iter::once(at)
            .chain(f.statements.ancestors(at))
            .any(|s| {
                matches!(f.statements.get(s).statement, Statement::Loop { .. })
                    && cost::trips(module, f, s).is_none()
            })
    };
    let loops = (0..values.values.len()).filter(|id| ends_unseen(*id));
    with_users(values, loops.collect())
}

/// The name of an operation whose result jumps.
pub(crate) fn jump(expression: &Expression) -> Option<String> {
    use BinaryOperator as B;
    let name = match expression {
        Expression::Math { fun, .. } => match fun {
            MathFunction::Floor => "floor",
            MathFunction::Ceil => "ceil",
            MathFunction::Round => "round",
            MathFunction::Trunc => "trunc",
            MathFunction::Fract => "fract",
            MathFunction::Step => "step",
            MathFunction::Sign => "sign",
            MathFunction::Modf | MathFunction::Frexp => "modf",
            MathFunction::QuantizeToF16 => "quantizeToF16",
            _ => return None,
        },
        Expression::Binary { op, .. } => match op {
            B::Modulo => "%",
            B::Equal | B::NotEqual | B::Less | B::LessEqual | B::Greater | B::GreaterEqual => {
                "a comparison"
            }
            B::And | B::ExclusiveOr | B::InclusiveOr | B::ShiftLeft | B::ShiftRight => {
                "a bit operation"
            }
            _ => return None,
        },
        Expression::As { kind, convert, .. } => match (kind, convert) {
            (ScalarKind::Float, Some(_)) => "a conversion",
            (_, None) => "bitcast",
            _ => "a conversion to an integer",
        },
        Expression::Relational { .. } => "a test",
        _ => return None,
    };
    Some(name.to_owned())
}

/// For each value, an operation in or below it whose result may be NaN or infinite.
fn hazards(values: &Values<'_, '_>) -> Vec<Option<String>> {
    let signs = Signs::new(values);
    let users = values.users();
    let mut hazards: Vec<Option<String>> = vec![None; values.values.len()];
    let mut work: Vec<ValueId> = Vec::new();
    for (id, value) in values.values.iter().enumerate() {
        if let Node::Expression(context, e, _) = &value.node
            && let Some(operation) = signs.hazard(values, *context, *e)
        {
            hazards[id] = Some(operation.to_owned());
            work.push(id);
        }
    }
    while let Some(id) = work.pop() {
        for user in &users[id] {
            if hazards[*user].is_none() {
                hazards[*user] = hazards[id].clone();
                work.push(*user);
            }
        }
    }
    hazards
}
