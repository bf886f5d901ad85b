//! A small interpreter of naga IR on the CPU: one invocation, 32-bit scalars. It is what the slicer is tested against: running a slice gives
//! the sliced value, bit for bit.
//!
//! It is generic over what it takes for a float, a [`Number`]: `f32`; `f64`; both side by side ([`Shadowed`]), which tells how far rounding has led from the truth; intervals
//! and affine numbers, which stand for all of a triangle ([`mod@crate::evaluate::bound`]); terms, which stand for every number there is ([`mod@crate::validate`]).
//!
//! `discard` is a demotion, as in WGSL: the invocation is marked and runs on. A dynamic index out of bounds is clamped. Atomics and subgroup operations have no meaning for one
//! invocation alone. What textures and derivatives give is the caller's to say: they are inputs.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;

use naga::{Function, Module};

mod bits;
pub mod bound;
mod expression;
mod flips;
mod layout;
mod machine;
mod math;
mod matrix;
mod number;
pub(crate) mod overrides;
mod shadow;
mod value;

pub use layout::{RUNTIME_ELEMENTS, from_bytes, scalars};
pub use number::Number;
pub use shadow::{Shadowed, ulps};
pub use value::{OverrideValue, Scalar, Value, constant};

use machine::Machine;

/// Why an evaluation came to no end.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Stuck {
    /// Something the interpreter does not do.
    #[error("not supported: {0}")]
    Unsupported(String),
    /// The step limit was reached.
    #[error("the step limit was reached")]
    Steps,
    /// A value of the wrong type: the module or an argument is not valid.
    #[error("type mismatch: {0}")]
    Type(String),
    /// What to do next rests on a number that is several.
    #[error("it rests on a number that is not one: {0}")]
    Undecided(String),
    /// An expression was used that no `Emit` before it evaluates.
    #[error("expression {0} is used before it is evaluated")]
    Unevaluated(usize),
}

/// A texture access.
#[derive(Clone, Debug)]
pub struct Lookup<'a, F = f32> {
    /// Group and binding of the texture.
    pub binding: Option<(u32, u32)>,
    /// Coordinates, array index, sample or level if one is named, depth reference: in this order, those there are.
    pub coordinates: &'a [F],
    /// What else decides the level: a bias, or both gradients. Empty where the level is implicit or named.
    pub footprint: &'a [F],
    /// How the texture is looked up.
    pub sampling: Sampling,
}

/// How a texture is looked up, beside where: what an access says with words and constants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sampling {
    /// Group and binding of the sampler; `None`: a load, which has none.
    pub sampler: Option<(u32, u32)>,
    /// Texels beside the place; 0 where the access says nothing.
    pub offset: [i32; 3],
    /// It takes the level that its neighbours call for.
    pub implicit: bool,
    /// It stays half a texel away from the edge (`textureSampleBaseClampToEdge`).
    pub clamped: bool,
}

/// A derivative (`dpdx`, `fwidthFine`) of one component.
#[derive(Clone, Copy, Debug)]
pub struct Derivative<F = f32> {
    /// Along which axis; `Width` is `abs(dpdx) + abs(dpdy)`, which the caller is asked for as such.
    pub axis: naga::DerivativeAxis,
    /// How fine.
    pub control: naga::DerivativeControl,
    /// Of what.
    pub of: F,
}

/// A value that was computed on the way.
#[derive(Clone, Debug)]
pub struct Traced<F = f32> {
    /// The author's text for it.
    pub span: naga::Span,
    /// What kind of expression or statement it is, in naga's word: spans of an expression and its operand may be one.
    pub kind: &'static str,
    /// The value: of an expression, or stored.
    pub value: Value<F>,
}

/// What surrounds an invocation.
pub struct Environment<'a, F = f32> {
    /// Contents of uniforms and buffers by group and binding. Runs share them: what a run writes to is copied, once.
    pub resources: Arc<BTreeMap<(u32, u32), Value<F>>>,
    /// The texel a lookup gives.
    pub texture: &'a dyn Fn(&Lookup<'_, F>) -> [F; 4],
    /// What a derivative gives; `None`: it stops the evaluation.
    pub derivative: Option<&'a dyn Fn(Derivative<F>) -> F>,
    /// Where to write down what is computed on the way, if anywhere.
    pub trace: Option<&'a RefCell<Vec<Traced<F>>>>,
    /// Statements and expressions evaluated before the interpreter gives up. A value of more scalars than a 4x4 matrix counts a step for each of those beyond it.
    pub steps: u64,
}

/// What an invocation did.
#[derive(Clone, Debug)]
pub struct Outcome<F = f32> {
    /// What it returned.
    pub result: Option<Value<F>>,
    /// Whether it was discarded.
    pub discarded: bool,
    /// What storage buffers that it may write hold at its end, by group and binding.
    pub stored: BTreeMap<(u32, u32), Value<F>>,
    /// Comparisons and conversions that would have come out otherwise had nothing been rounded, component by component: of numbers that know their truth ([`Number::truth`]).
    pub flips: u64,
    /// Steps it took.
    pub steps: u64,
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
) -> Result<Outcome<F>, Stuck> {
    let function = &module.entry_points[entry].function;
    run(module, function, arguments, environment)
}

/// Runs a function, of a module or of an entry point of it, with globals as they are at the beginning.
///
/// # Errors
/// [`Stuck`].
pub fn run<F: Number>(
    module: &Module,
    function: &Function,
    arguments: &[Value<F>],
    environment: &Environment<'_, F>,
) -> Result<Outcome<F>, Stuck> {
    Machine::new(module, environment).run(function, arguments)
}
