//! Abstract values: bounds of scalars, with the assumptions that each depends on.
//!
//! Bounds are real numbers. Every result is widened by more than an adapter's rounding, so that it
//! contains the adapter's number however the adapter rounds, flushes denormals or contracts
//! products and sums. No bound contains NaN: a value that may be NaN is [`AbstractValue::Unknown`].

use std::collections::BTreeSet;
use std::rc::Rc;

use naga::{Literal, ScalarKind};

use naga_interp::interval::Interval;

/// Indices of the assumptions that a value depends on.
pub(crate) type Sources = Rc<BTreeSet<usize>>;

/// Stands for the assumption that a factor of a product with 0 is finite. No value can prove it;
/// `fold=rounding` assumes it for summed floats, but never bases a decision on it.
pub(crate) const FINITE: usize = usize::MAX;

/// A scalar with inclusive bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Scalar {
    Bool(bool),
    /// An `i32`, `u32` or `f32`.
    Number(ScalarKind, Interval),
}

impl Scalar {
    /// An input `f32`. An adapter may flush it.
    pub fn float(value: f64) -> Self {
        Self::Number(ScalarKind::Float, Interval::input(value))
    }

    /// A number of `kind`; `None` if it may wrap, or be infinite or NaN.
    pub fn number(kind: ScalarKind, interval: Interval) -> Option<Self> {
        let bounds = match kind {
            ScalarKind::Float => Interval::up_to(f64::MAX),
            ScalarKind::Sint => Interval::new(f64::from(i32::MIN), f64::from(i32::MAX)),
            ScalarKind::Uint => Interval::new(0.0, f64::from(u32::MAX)),
            _ => return None,
        };
        let fits = bounds.low <= interval.low && interval.high <= bounds.high;
        fits.then_some(Self::Number(kind, interval))
    }

    fn join(self, other: Self) -> Option<Self> {
        match (self, other) {
            (Self::Bool(a), Self::Bool(b)) if a == b => Some(self),
            (Self::Number(kind, a), Self::Number(other, b)) if kind == other => {
                Some(Self::Number(kind, a.or(b)))
            }
            _ => None,
        }
    }

    /// The integer, if it is a single one.
    pub fn integer(self) -> Option<i64> {
        match self {
            Self::Number(ScalarKind::Sint | ScalarKind::Uint, x) => x.number().map(|x| x as i64),
            _ => None,
        }
    }

    /// Its literal, if it is a single integer or bool.
    fn literal(self) -> Option<Literal> {
        match self {
            Self::Bool(b) => Some(Literal::Bool(b)),
            Self::Number(ScalarKind::Sint, _) => self.integer()?.try_into().ok().map(Literal::I32),
            Self::Number(..) => self.integer()?.try_into().ok().map(Literal::U32),
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) enum AbstractValue {
    #[default]
    Unknown,
    /// A scalar's bounds.
    Scalar(Scalar, Sources),
    /// The abstract value of each component, column, element or member.
    Parts(Vec<AbstractValue>),
}

impl AbstractValue {
    /// A constant of the author's, which depends on no assumption.
    pub fn constant(scalar: Scalar) -> Self {
        Self::Scalar(scalar, Sources::default())
    }

    /// The scalar and the assumptions it depends on.
    pub fn scalar(&self) -> Option<(Scalar, &Sources)> {
        match self {
            Self::Scalar(s, sources) => Some((*s, sources)),
            _ => None,
        }
    }

    /// The bool, if it is known by an assumption.
    pub fn assumed_truth(&self) -> Option<(bool, &Sources)> {
        match self.scalar()? {
            (Scalar::Bool(b), sources) if !sources.is_empty() => Some((b, sources)),
            _ => None,
        }
    }

    /// The bool, if it is known.
    pub fn truth(&self) -> Option<bool> {
        match self.scalar()? {
            (Scalar::Bool(b), _) => Some(b),
            _ => None,
        }
    }

    /// The literal that may replace it: an integer or bool that depends on an assumption. Floats
    /// are never replaced, because front ends fold calls of float literals on the CPU.
    pub fn literal(&self) -> Option<(Literal, &Sources)> {
        match self.scalar()? {
            (scalar, sources) if !sources.is_empty() => Some((scalar.literal()?, sources)),
            _ => None,
        }
    }

    /// The integer, if it is a single one.
    pub fn index(&self) -> Option<(u32, &Sources)> {
        let (scalar, sources) = self.scalar()?;
        Some((u32::try_from(scalar.integer()?).ok()?, sources))
    }

    pub fn part(&self, index: usize) -> Self {
        match self {
            Self::Parts(parts) => parts.get(index).cloned().unwrap_or_default(),
            _ => Self::Unknown,
        }
    }

    /// The part at the end of a path.
    pub fn at(&self, path: &[u32]) -> Self {
        path.iter()
            .fold(self.clone(), |known, i| known.part(*i as usize))
    }

    /// Replaces the part at the end of a path. A value without known parts stays unknown.
    pub fn set(&mut self, path: &[u32], value: Self) {
        match (path, self) {
            ([], this) => *this = value,
            ([first, rest @ ..], Self::Parts(parts)) => {
                if let Some(part) = parts.get_mut(*first as usize) {
                    part.set(rest, value);
                }
            }
            _ => {}
        }
    }

    /// The bounds that contain both.
    #[must_use]
    pub fn join(&self, other: &Self) -> Self {
        match (self, other) {
            (Self::Scalar(a, s), Self::Scalar(b, t)) => match a.join(*b) {
                Some(scalar) => Self::Scalar(scalar, both(s, t)),
                None => Self::Unknown,
            },
            (Self::Parts(a), Self::Parts(b)) if a.len() == b.len() => {
                Self::Parts(a.iter().zip(b).map(|(a, b)| a.join(b)).collect())
            }
            _ => Self::Unknown,
        }
    }

    /// Replaces each scalar.
    #[must_use]
    pub fn map(self, change: &dyn Fn(Scalar, Sources) -> Self) -> Self {
        match self {
            Self::Unknown => Self::Unknown,
            Self::Scalar(scalar, sources) => change(scalar, sources),
            Self::Parts(parts) => Self::Parts(parts.into_iter().map(|p| p.map(change)).collect()),
        }
    }

    /// The same value with more assumptions.
    #[must_use]
    pub fn resting_on(self, more: &Sources) -> Self {
        self.map(&|scalar, sources| Self::Scalar(scalar, both(&sources, more)))
    }

    /// Whether any part depends on an assumption.
    pub fn is_assumed(&self) -> bool {
        match self {
            Self::Unknown => false,
            Self::Scalar(_, sources) => !sources.is_empty(),
            Self::Parts(parts) => parts.iter().any(Self::is_assumed),
        }
    }

    /// The same value; parts that are all unknown become [`AbstractValue::Unknown`].
    #[must_use]
    pub fn settled(self) -> Self {
        match self {
            Self::Parts(parts) => {
                let parts: Vec<Self> = parts.into_iter().map(Self::settled).collect();
                match parts.iter().all(|p| *p == Self::Unknown) {
                    true => Self::Unknown,
                    false => Self::Parts(parts),
                }
            }
            other => other,
        }
    }

    /// Without bools and integers that depend on [`FINITE`].
    #[must_use]
    pub fn undecided_by_finite(self) -> Self {
        self.map(&|scalar, sources| match scalar {
            Scalar::Number(ScalarKind::Float, _) => Self::Scalar(scalar, sources),
            _ if sources.contains(&FINITE) => Self::Unknown,
            _ => Self::Scalar(scalar, sources),
        })
    }

    /// Without parts that depend on no assumption.
    #[must_use]
    pub fn assumed_only(&self) -> Self {
        match self.is_assumed() {
            true => self.clone(),
            false => Self::Unknown,
        }
    }

    /// Applies a function component by component. A scalar among vectors counts for each of its
    /// components.
    pub fn zip(operands: &[&Self], function: &dyn Fn(&[Scalar]) -> Option<Scalar>) -> Self {
        let width = operands.iter().find_map(|o| match o {
            Self::Parts(parts) => Some(parts.len()),
            _ => None,
        });
        let Some(width) = width else {
            let mut scalars = Vec::new();
            let mut sources = Sources::default();
            for operand in operands {
                let Some((scalar, from)) = operand.scalar() else {
                    return Self::Unknown;
                };
                scalars.push(scalar);
                sources = both(&sources, from);
            }
            return function(&scalars).map_or(Self::Unknown, |s| Self::Scalar(s, sources));
        };
        let component = |i: usize| {
            let parts: Vec<Self> = operands
                .iter()
                .map(|o| match o {
                    Self::Parts(_) => o.part(i),
                    scalar => (*scalar).clone(),
                })
                .collect();
            Self::zip(&parts.iter().collect::<Vec<_>>(), function)
        };
        Self::Parts((0..width).map(component).collect())
    }
}

/// The union of two dependences.
pub(crate) fn both(a: &Sources, b: &Sources) -> Sources {
    if b.is_subset(a) {
        return Rc::clone(a);
    }
    if a.is_subset(b) {
        return Rc::clone(b);
    }
    Rc::new(a.union(b).copied().collect())
}
