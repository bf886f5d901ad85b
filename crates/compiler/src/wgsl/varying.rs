//! A value interpolated from vertices to fragments, with explicit defaults.

use naga::{Binding, Interpolation, Module, Sampling, ScalarKind, TypeInner};
use naga_edit::interface::{self, Io};

/// A vertex output or fragment input at a location.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Varying {
    pub location: u32,
    pub ty: String,
    /// Interpolation, as text for messages.
    pub interpolation: String,
}

impl Varying {
    /// `io` as a varying; `None` for a builtin.
    pub(crate) fn of(module: &Module, io: &Io) -> Option<Self> {
        let Some(Binding::Location {
            location,
            interpolation,
            sampling,
            ..
        }) = io.binding
        else {
            return None;
        };
        let integer = matches!(
            module.types[io.ty].inner,
            TypeInner::Scalar(s) | TypeInner::Vector { scalar: s, .. }
                if s.kind != ScalarKind::Float
        );
        let interpolation = interpolation.unwrap_or(if integer {
            Interpolation::Flat
        } else {
            Interpolation::Perspective
        });
        let (how, fallback) = match interpolation {
            Interpolation::Perspective => ("perspective", Sampling::Center),
            Interpolation::Linear => ("linear", Sampling::Center),
            Interpolation::Flat => ("flat", Sampling::First),
            Interpolation::PerVertex => ("per-vertex", Sampling::Center),
        };
        let sampling = match sampling.unwrap_or(fallback) {
            Sampling::Center => "at the centre",
            Sampling::Centroid => "at the centroid",
            Sampling::Sample => "at the sample",
            Sampling::First => "from the first vertex",
            Sampling::Either => "from either vertex",
        };
        Some(Self {
            location,
            ty: interface::wgsl_type(module, io.ty),
            interpolation: format!("{how} {sampling}"),
        })
    }
}
