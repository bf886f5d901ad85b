//! A small interpreter of naga IR on the CPU: one invocation, 32-bit scalars. It is the oracle for
//! the slicer: a slice must return the sliced value, bit for bit.
//!
//! It is generic over its float type, a [`Number`]: `f32`; `f64`; both in parallel ([`Shadowed`]),
//! to measure rounding errors; intervals and affine numbers, which cover a whole triangle
//! ([`mod@crate::bound`]); terms, which represent every number (`preshade-validate`).
//!
//! `discard` is a demotion, as in WGSL: the invocation is marked and continues. A dynamic index out
//! of bounds is clamped. Atomics and subgroup operations are not supported, because a single
//! invocation gives them no meaning. The caller provides texels and derivatives as inputs.
#![warn(missing_docs)]

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;

use naga::{Function, Module};

pub mod accuracy;
mod bits;
pub mod bound;
mod comparison_notes;
mod constants;
mod expression;
mod expression_kind;
mod flips;
pub mod interval;
mod layout;
mod machine;
pub mod math;
mod matrix;
mod number;
pub mod overrides;
mod scalar;
mod undefined;
mod value;
mod with_reference;

pub use constants::{OverrideValue, constant, default_constant};
pub use layout::{RUNTIME_ELEMENTS, from_bytes, place, scalars};
pub use number::Number;
pub use undefined::Undefined;
pub use value::{Scalar, Value};
pub use with_reference::{Shadowed, ulps};

use machine::Machine;

/// Why an evaluation stopped early.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Stuck {
    /// Something the interpreter doesn't support.
    #[error("not supported: {0}")]
    Unsupported(String),
    /// The step limit was reached.
    #[error("the step limit was reached")]
    Steps,
    /// A value has the wrong type: the module or an argument is invalid.
    #[error("type mismatch: {0}")]
    Type(String),
    /// A decision depends on a number that stands for several values.
    #[error("it depends on a number that is not one: {0}")]
    Undecided(String),
    /// An expression was used before its `Emit`.
    #[error("expression {0} is used before it is evaluated")]
    Unevaluated(usize),
}

/// A texture access.
#[derive(Clone, Debug)]
pub struct Lookup<'a, F = f32> {
    /// Group and binding of the texture.
    pub binding: Option<(u32, u32)>,
    /// Coordinates, array index, explicit sample or level, and depth reference, in this order, if
    /// present.
    pub coordinates: &'a [F],
    /// The bias, or both gradients. Empty if the level is implicit or explicit.
    pub footprint: &'a [F],
    /// How the texture is sampled.
    pub sampling: Sampling,
}

/// The constant properties of a texture access.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sampling {
    /// Group and binding of the sampler. `None` for a load.
    pub sampler: Option<(u32, u32)>,
    /// Offset in texels, 0 by default.
    pub offset: [i32; 3],
    /// Whether the level is implicit.
    pub implicit: bool,
    /// Whether coordinates are clamped half a texel from the edge (`textureSampleBaseClampToEdge`).
    pub clamped: bool,
    /// How many coordinates belong to the texture's axes. The level depends only on these. 0 for a
    /// load.
    pub axes: usize,
    /// Index of the coordinate that is an explicit level.
    pub level: Option<usize>,
}

/// A derivative (`dpdx`, `fwidthFine`) of one component.
#[derive(Clone, Copy, Debug)]
pub struct Derivative<F = f32> {
    /// Axis; `Width` requests `abs(dpdx) + abs(dpdy)` as a whole.
    pub axis: naga::DerivativeAxis,
    /// Coarse, fine or unspecified.
    pub control: naga::DerivativeControl,
    /// The component to differentiate.
    pub of: F,
}

/// An intermediate value.
#[derive(Clone, Debug)]
pub struct Traced<F = f32> {
    /// Span in the author's source.
    pub span: naga::Span,
    /// naga's name for the kind of expression or statement. It distinguishes an expression from an
    /// operand with the same span.
    pub kind: &'static str,
    /// The computed or stored value.
    pub value: Value<F>,
    /// The function (`None`: the entry point's) and the expression.
    pub at: (
        Option<naga::Handle<Function>>,
        naga::Handle<naga::Expression>,
    ),
    /// The operands, if the value compares scalars.
    pub compared: Option<[Value<F>; 2]>,
}

/// The environment of an invocation.
pub struct Environment<'a, F = f32> {
    /// Contents of uniforms, buffers and immediate data by [`place`]. For textures: width, height,
    /// and depth or layers, for size queries. A fourth part of a 2D texture is its texels, row by
    /// row, for loads; without it, they come from [`Self::texture`]. Runs share all contents, and
    /// copy a buffer on the first write.
    pub resources: Arc<BTreeMap<(u32, u32), Value<F>>>,
    /// Returns the texel of a lookup.
    pub texture: &'a dyn Fn(&Lookup<'_, F>) -> [F; 4],
    /// Returns a derivative. If `None`, a derivative stops the evaluation.
    pub derivative: Option<&'a dyn Fn(Derivative<F>) -> F>,
    /// Receives intermediate values, if set.
    pub trace: Option<&'a RefCell<Vec<Traced<F>>>>,
    /// Limit on evaluated statements and expressions. Values with more scalars than a 4x4 matrix
    /// cost one step for each additional one.
    pub steps: u64,
}

/// The result of an invocation.
#[derive(Clone, Debug)]
pub struct RunResult<F = f32> {
    /// The function's return value.
    pub result: Option<Value<F>>,
    /// Whether the invocation was discarded.
    pub discarded: bool,
    /// Final contents of writable storage buffers, by group and binding.
    pub stored: BTreeMap<(u32, u32), Value<F>>,
    /// How many comparisons and conversions, by component, the unrounded references would decide
    /// differently ([`Number::truth`]).
    pub flips: u64,
    /// Number of steps, as counted against the limit.
    pub steps: u64,
    /// The first operation with an undefined result in GLSL, and its place.
    pub undefined: Option<(Undefined, naga::Span)>,
}

/// Runs an entry point.
///
/// # Errors
/// [`Stuck`].
pub fn entry_point<F: Number>(
    module: &Module,
    entry: usize,
    arguments: &[Value<F>],
    environment: &Environment<'_, F>,
) -> Result<RunResult<F>, Stuck> {
    let function = &module.entry_points[entry].function;
    run(module, function, arguments, environment)
}

/// Runs a function of a module or an entry point, with initial globals.
///
/// # Errors
///
/// [`Stuck`].
pub fn run<F: Number>(
    module: &Module,
    function: &Function,
    arguments: &[Value<F>],
    environment: &Environment<'_, F>,
) -> Result<RunResult<F>, Stuck> {
    Machine::new(module, environment).run(function, arguments)
}

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
