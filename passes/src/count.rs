//! A fragment stage that only counts: what the material's would keep, drawn as the constant 1.
//!
//! Drawn with additive blending and the depth state of the pass it stands for, it makes the overdraw picture and the number of shaded fragments per
//! covered pixel on any adapter. Fragments that the material discards are not counted: what is left is what hid each other.

use naga::{Binding, BuiltIn, Expression, FunctionResult, Handle, Literal, Module, Scalar, ShaderStage, Span, StructMember, Type, TypeInner, VectorSize};

use crate::graph::Graph;
use crate::head;
use crate::place::{self, PositionInvariance};
use crate::plan::{GpuPass, Plan};
use crate::program::{Invalid, Program};
use crate::slice::{self, Criterion};

/// Name of the counting entry point.
pub const ENTRY: &str = "preshade_count";

/// The program of `pass` with an entry point [`ENTRY`] whose one colour output, location 0, is (1, 1, 1, 1). Depth is written where the material writes it.
///
/// # Errors
/// A slice of ours that does not validate: a bug.
pub fn program(plan: &Plan, pass: &GpuPass) -> Result<Program, Box<Invalid>> {
    let missing = |what: &str| Box::new(Invalid { message: format!("the plan has no {what}"), labels: Vec::new() });
    let program = plan.program(pass).ok_or_else(|| missing("program of that name"))?;
    let fragment = match &pass.fragment {
        None => None,
        Some(name) => Some(program.entry_point(ShaderStage::Fragment, name).ok_or_else(|| missing("fragment entry point of that name"))?.0),
    };
    todo(program, fragment)
}
