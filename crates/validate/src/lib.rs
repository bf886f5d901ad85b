//! Translation validation (Pnueli, Siegel and Singerman 1998; Necula 2000): checks a variant's
//! promises against the original after it was made, without a GPU.
//!
//! The plan determines the promises (`promise`). We first try a proof (`proof`): both stages have
//! the same canonical slice, or, run on terms ([`term`]), end in the same ones. Otherwise we run
//! both (`trial`; [`executor`], on an adapter) on random and adversarial numbers ([`inputs`]),
//! until they differ or have agreed often enough. A counterexample reports the first differing
//! value.
//!
//! The promises: a pass with the author's geometry has the author's positions. A pre-pass, or a
//! pass that writes ids, keeps and discards the same fragments. The shading pass has the same
//! colours, as far as the plan's contract promises: the same bits at vertices, whatever was
//! hoisted; the same bits inside a triangle for `Exact`, and within a step of the target for
//! `Rounding`. A budget is about a picture, so only `verify` can check it, except for that of the
//! visibility buffer: its resolve is the original's function with other roundings (`resolve`).
//! Values are within the plan's guard.
//!
//! Values that a compute pass makes once a draw are computed by the stages that read them
//! (`of_draw`).
//!
//! The passes of a visibility buffer read the draw's buffers. We make up a draw (`drawn`), run the
//! passes on it one after the other (`split`), and run the original as a rasteriser would (`quad`).
//!
//! Two simplifications of the interpreter: an operation has the same result everywhere, and a texel
//! depends on its coordinates and on explicit gradients and bias ([`levels`]), but not on an
//! implicit level. A quad has its own derivatives and levels.

use std::collections::BTreeMap;

use naga::{Expression, Literal, Span};

use preshade_plan::guard::{Guard, Place as Assumed};
use preshade_plan::plan::{ComputePass, Plan, Role};
use preshade_plan::program::Program;

pub mod agree;
mod arithmetic;
#[cfg(test)]
mod broken_slicer;
pub mod compare;
mod compared_numbers;
pub mod environment;
pub mod executor;
pub mod inputs;
pub mod levels;
mod made_up_draw;
mod per_draw_values;
mod promise;
mod proof;
mod quad;
mod random;
mod resolve;
pub mod stage;
mod static_frame;
mod tape;
pub mod term;
mod trial;
pub mod verdict;
mod visibility_buffer;

use executor::Runner;
use promise::Pair;

pub use verdict::{Counterexample, Diverged, Proof, Verdict};

/// A promise and its verdict.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct Check {
    /// Role of the pass.
    pub role: Role,
    /// The promise as text.
    pub promise: String,
    /// The verdict.
    pub verdict: Verdict,
}

/// The limits of the search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Number of inputs for each promise.
    pub inputs: u64,
    /// The first of their seeds.
    pub seed: u64,
    /// Interpreter steps per input.
    pub steps: u64,
    /// Most paths in a proof.
    pub paths: u64,
}

impl Default for Effort {
    fn default() -> Self {
        Self {
            inputs: 240,
            seed: 0,
            steps: 100_000,
            paths: 64,
        }
    }
}

#[derive(Clone, Copy)]
pub struct By<'a> {
    pub effort: &'a Effort,
    /// Another executor to run both on, even if a promise is proved: the proof doesn't cover that
    /// executor's compiler.
    pub runner: Option<&'a dyn Runner>,
    /// Gets each promise before its turn, as progress.
    pub told: &'a dyn Fn(Role, &str),
}

/// Validates a variant against the original it was made from.
pub fn validate(original: &Plan, variant: &Plan, effort: &Effort) -> Vec<Check> {
    let by = By {
        effort,
        runner: None,
        told: &|_, _| {},
    };
    validate_by(original, variant, by)
}

/// The same, on another executor or with progress.
pub fn validate_by(original: &Plan, variant: &Plan, by: By<'_>) -> Vec<Check> {
    let mut checks = Vec::new();
    let mut not = |role: Role, promise: &str, why: String| {
        checks.push(Check {
            role,
            promise: promise.to_owned(),
            verdict: Verdict::NotEvaluable { why },
        });
    };
    let Some((main, program)) = original
        .main()
        .and_then(|p| Some((p, original.program(p)?)))
    else {
        not(
            Role::Main,
            "anything",
            "the original has no main pass".to_owned(),
        );
        return checks;
    };
    if let Some(none) = variant.guard.as_ref().and_then(Guard::contradicted) {
        let why = format!(
            "no value of `{}` is one that the guard lets through",
            none.name
        );
        not(Role::Main, "anything", why);
        return checks;
    }
    let is_run = |p: &&ComputePass| visibility_buffer::runs(variant, p) || per_draw_values::runs(p);
    for pass in variant.compute.iter().filter(|p| !is_run(p)) {
        let why = "a compute pass is not run by the interpreter; `verify` draws what it makes";
        not(
            Role::Main,
            &format!("`{}`", pass.entry_point),
            why.to_owned(),
        );
    }
    let guard = variant.guard.as_ref();
    let own = with_overrides(program, guard);
    let programs = variant.programs.iter();
    let programs = programs.map(|(key, program)| (key.clone(), with_overrides(program, guard)));
    let mut programs: BTreeMap<String, Program> = programs.collect();
    for pass in variant.passes.iter().filter(|p| p.role == Role::Outputs) {
        if let Some(program) = programs.get_mut(&pass.program) {
            *program = static_frame::at_rest(program, pass);
        }
    }
    for pass in &variant.passes {
        match per_draw_values::computed(variant, &programs, pass) {
            Ok(Some(program)) => {
                programs.insert(pass.program.clone(), program);
            }
            Ok(None) => {}
            Err(why) => not(pass.role, "values of the draw", why),
        }
    }
    let mut found = Vec::new();
    for pass in &variant.passes {
        match (pass.role, programs.get(&pass.program)) {
            (Role::Classify | Role::Clear, _) => {}
            (_, None) => not(pass.role, "anything", "it has no program".to_owned()),
            (Role::Resolve, Some(_)) => {
                found.extend(resolve::checks(variant, &programs, (main, &own), pass, by));
            }
            (_, Some(other)) => match Pair::new(variant, (main, &own), (pass, other), by) {
                Ok(pair) => found.extend(pair.checks()),
                Err(why) => not(pass.role, "positions and colours", why),
            },
        }
    }
    checks.extend(found);
    checks
}

/// The program with values for overrides that have none: the guard's, or 1.
fn with_overrides(program: &Program, guard: Option<&Guard>) -> Program {
    let mut module = program.module().clone();
    let handles: Vec<_> = module.overrides.iter().map(|(h, _)| h).collect();
    for handle in handles {
        let name = module.overrides[handle].name.clone().unwrap_or_default();
        let assumed = guard.into_iter().flat_map(|g| &g.values);
        let fixed = assumed
            .filter(|a| a.place == Assumed::Override { name: name.clone() })
            .map(|a| a.bounds.low)
            .next();
        let number = match (fixed, module.overrides[handle].init) {
            (Some(number), _) => number,
            (None, None) => 1.0,
            (None, Some(_)) => continue,
        };
        let literal = match module.types[module.overrides[handle].ty].inner.scalar() {
            Some(naga::Scalar::BOOL) => Literal::Bool(number != 0.0),
            Some(naga::Scalar::I32) => Literal::I32(number as i32),
            Some(naga::Scalar::U32) => Literal::U32(number as u32),
            Some(naga::Scalar::F32) => Literal::F32(number as f32),
            _ => continue,
        };
        let init = module
            .global_expressions
            .append(Expression::Literal(literal), Span::UNDEFINED);
        module.overrides[handle].init = Some(init);
    }
    program
        .with_module(module)
        .unwrap_or_else(|_| program.clone())
}
