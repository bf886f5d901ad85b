//! Rates: how often a value changes, and which stages can compute it.
//!
//! `const < draw < instance < vertex` in a vertex stage; `const < draw < instance < {flat,
//! perspective, linear} x {center, centroid, sample} < fragment < sample` in a fragment stage. A
//! value's rate is the join of its inputs' rates and those of its control dependences. A flat value
//! joined with a smooth one has fragment rate: a vertex sees its own flat value, and the fragment
//! the provoking vertex's. Two different smooth classes join to `mixed`.
//!
//! [`super::rates`] computes them.

use naga::{Binding, BuiltIn, Interpolation, Sampling, ShaderStage, TypeInner};
use serde::{Deserialize, Serialize};

/// How a varying is interpolated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interpolated {
    /// Not interpolated: the provoking vertex's value.
    Flat,
    /// Perspective-correct.
    Perspective,
    /// Linear in screen space.
    Linear,
}

/// Where in the pixel a varying is interpolated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum At {
    /// At its centre.
    Center,
    /// Within the covered part.
    Centroid,
    Sample,
}

/// How often a value changes.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Rate {
    /// Never.
    #[default]
    Const,
    /// Per draw: uniforms, textures at constant coordinates.
    Draw,
    Instance,
    Vertex,
    /// An interpolated vertex value, of one interpolation class.
    Varying(Interpolated, At),
    /// A function of vertex values of two smooth interpolation classes.
    Mixed,
    /// Per fragment, or per other invocation.
    Fragment,
    Sample,
}

impl Rate {
    /// The lowest rate that is at least both.
    #[must_use]
    pub fn join(self, other: Self) -> Self {
        use Rate::{Const, Draw, Fragment, Instance, Mixed, Sample, Varying, Vertex};
        let smooth = |i| i != Interpolated::Flat;
        match (self.min(other), self.max(other)) {
            (low, high) if low == high => high,
            (Const | Draw | Instance, high) => high,
            (Varying(a, _), Varying(b, _)) if smooth(a) && smooth(b) => Mixed,
            (Varying(a, _), Mixed) if smooth(a) => Mixed,
            (Vertex | Varying(..) | Mixed, Varying(..) | Mixed | Fragment) => Fragment,
            (_, Sample) => Sample,
            (_, high) => high,
        }
    }

    /// Whether it changes at most per primitive, without interpolation.
    pub fn is_flat(self) -> bool {
        self <= Self::Varying(Interpolated::Flat, At::Sample) && self != Self::Vertex
    }

    /// The name in messages and JSON, such as `perspective-centroid`.
    pub fn name(self) -> String {
        match self {
            Self::Const => "const".to_owned(),
            Self::Draw => "draw".to_owned(),
            Self::Instance => "instance".to_owned(),
            Self::Vertex => "vertex".to_owned(),
            Self::Varying(Interpolated::Flat, _) => "flat".to_owned(),
            Self::Varying(interpolated, at) => {
                let interpolated = match interpolated {
                    Interpolated::Linear => "linear",
                    _ => "perspective",
                };
                match at {
                    At::Center => interpolated.to_owned(),
                    At::Centroid => format!("{interpolated}-centroid"),
                    At::Sample => format!("{interpolated}-sample"),
                }
            }
            Self::Mixed => "mixed".to_owned(),
            Self::Fragment => "fragment".to_owned(),
            Self::Sample => "sample".to_owned(),
        }
    }
}

/// The stages that can compute a value, however often it changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Stages {
    /// A vertex stage can compute it.
    pub vertex: bool,
    /// A fragment stage can compute it.
    pub fragment: bool,
}

impl Stages {
    /// Any stage can compute it.
    pub const ANY: Self = Self {
        vertex: true,
        fragment: true,
    };
    pub const VERTEX: Self = Self {
        vertex: true,
        fragment: false,
    };
    pub const FRAGMENT: Self = Self {
        vertex: false,
        fragment: true,
    };

    fn and(self, other: Self) -> Self {
        Self {
            vertex: self.vertex && other.vertex,
            fragment: self.fragment && other.fragment,
        }
    }
}

impl Default for Stages {
    fn default() -> Self {
        Self::ANY
    }
}

/// Rate and stages of a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Fact {
    pub rate: Rate,
    /// The stages that can compute it.
    pub stages: Stages,
}

impl Fact {
    pub const fn new(rate: Rate, stages: Stages) -> Self {
        Self { rate, stages }
    }

    /// The fact of a value that depends on both.
    #[must_use]
    pub fn join(self, other: Self) -> Self {
        Self {
            rate: self.rate.join(other.rate),
            stages: self.stages.and(other.stages),
        }
    }
}

/// The fact of an entry input with a binding.
pub fn of_binding(stage: ShaderStage, binding: &Binding, ty: &TypeInner) -> Fact {
    use BuiltIn as B;
    match (stage, binding) {
        (ShaderStage::Vertex, Binding::Location { .. }) => Fact::new(Rate::Vertex, Stages::VERTEX),
        (
            ShaderStage::Fragment,
            Binding::Location {
                interpolation,
                sampling,
                per_primitive,
                ..
            },
        ) => {
            let integer = !matches!(ty.scalar_kind(), Some(naga::ScalarKind::Float));
            let at = match sampling {
                Some(Sampling::Centroid) => At::Centroid,
                Some(Sampling::Sample) => At::Sample,
                _ => At::Center,
            };
            let rate = match interpolation {
                _ if *per_primitive => Rate::Varying(Interpolated::Flat, At::Center),
                Some(Interpolation::Flat) => Rate::Varying(Interpolated::Flat, At::Center),
                Some(Interpolation::PerVertex) => Rate::Fragment,
                Some(Interpolation::Linear) => Rate::Varying(Interpolated::Linear, at),
                Some(Interpolation::Perspective) => Rate::Varying(Interpolated::Perspective, at),
                None if integer => Rate::Varying(Interpolated::Flat, At::Center),
                None => Rate::Varying(Interpolated::Perspective, at),
            };
            Fact::new(rate, Stages::ANY)
        }
        (_, Binding::BuiltIn(builtin)) => match builtin {
            B::ViewIndex => Fact::new(Rate::Draw, Stages::ANY),
            B::DrawIndex | B::BaseInstance | B::BaseVertex => Fact::new(Rate::Draw, Stages::VERTEX),
            B::InstanceIndex => Fact::new(Rate::Instance, Stages::VERTEX),
            B::VertexIndex => Fact::new(Rate::Vertex, Stages::VERTEX),
            // They change per primitive, but no vertex stage can read them.
            B::FrontFacing | B::PrimitiveIndex => Fact::new(
                Rate::Varying(Interpolated::Flat, At::Center),
                Stages::FRAGMENT,
            ),
            B::SampleIndex => Fact::new(Rate::Sample, Stages::FRAGMENT),
            _ => Fact::new(Rate::Fragment, Stages::FRAGMENT),
        },
        _ => Fact::new(Rate::Fragment, Stages::ANY),
    }
}
