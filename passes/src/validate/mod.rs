//! Translation validation (Pnueli, Siegel and Singerman 1998; Necula 2000): what a variant promises of its stages, held against the original's after it was made, without a GPU.
//!
//! What follows from a plan (`promise`) is first tried to be proved (`proof`): where the slices that decide it have one canonical form, or where both stages, run on terms ([`term`]), end in the same ones. What cannot be proved
//! is run (`trial`; [`elsewhere`], on an adapter) on numbers, random and adversarial ones ([`inputs`]), until it is seen to be broken or has agreed often enough. A counterexample says where the two go apart first.
//!
//! What is held against what follows from the plan: a pass with the author's geometry gives the author's positions; a pre-pass, and a pass that writes ids, keeps and discards the same fragments;
//! the pass that shades gives the same colours, as far as the plan's contract says so: the same bits at the vertices whatever was hoisted, inside a triangle where it is `Exact`, within a step of
//! the target where it is `Rounding`. A budget is about a picture, which nobody draws here: that is `verify`'s to say. A guard's values are as it wants them.
//!
//! Two things are the interpreter's word for an adapter's. An operation has one result, wherever it stands. And a texel is a function of where it is looked up, and of gradients
//! and a bias that an access names ([`levels`]), not of the level that a lookup takes by itself.

use naga::{Expression, Literal, Span};

use crate::core::guard::{Guard, Place as Assumed};
use crate::core::plan::{Plan, Role};
use crate::core::program::Program;

#[cfg(test)]
mod broken_slicer;
pub mod compare;
pub mod elsewhere;
pub mod inputs;
pub mod levels;
mod promise;
mod proof;
pub mod stage;
pub mod term;
mod trial;
mod verdict;
pub mod world;

use elsewhere::Runner;
use promise::Pair;

pub use verdict::{Counterexample, Diverged, Proof, Verdict};

/// A promise, and what became of it.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct Check {
    /// Role of the pass.
    pub role: Role,
    /// What is promised, in words.
    pub promise: String,
    /// What became of it.
    pub verdict: Verdict,
}

/// How hard to look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Inputs that each promise is tried on.
    pub inputs: u64,
    /// The first of their seeds.
    pub seed: u64,
    /// Steps of the interpreter before it gives up on an input.
    pub steps: u64,
    /// Paths that a proof may have.
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

/// Holds a variant against the original it was made of.
pub fn validate(original: &Plan, variant: &Plan, effort: &Effort) -> Vec<Check> {
    checks(original, variant, effort, None)
}

/// Holds a variant against the original it was made of by running both elsewhere, whatever is proved of them here: what a compiler makes of a text is not seen in it.
pub fn validate_on(
    runner: &dyn Runner,
    original: &Plan,
    variant: &Plan,
    effort: &Effort,
) -> Vec<Check> {
    checks(original, variant, effort, Some(runner))
}

fn checks(
    original: &Plan,
    variant: &Plan,
    effort: &Effort,
    runner: Option<&dyn Runner>,
) -> Vec<Check> {
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
    for pass in &variant.compute {
        let why = "a compute pass is not run by the interpreter; `verify` draws what it makes";
        not(
            Role::Main,
            &format!("`{}`", pass.entry_point),
            why.to_owned(),
        );
    }
    let mut found = Vec::new();
    for pass in &variant.passes {
        match (pass.role, variant.program(pass)) {
            (Role::Classify | Role::Clear, _) => {}
            (Role::Resolve, _) => not(
                pass.role,
                "the colours",
                "it reads ids and buffers of the frame, which the interpreter does not fill; `verify` draws it".to_owned(),
            ),
            (_, None) => not(pass.role, "anything", "it has no program".to_owned()),
            (_, Some(other)) => {
                let other = with_overrides(other, variant.guard.as_ref());
                let own = with_overrides(program, variant.guard.as_ref());
                match Pair::new(variant, (main, &own), (pass, &other), (effort, runner)) {
                    Ok(pair) => found.extend(pair.checks()),
                    Err(why) => not(pass.role, "positions and colours", why),
                }
            }
        }
    }
    checks.extend(found);
    checks
}

/// The program with values for the overrides that have none: those a guard has, and 1.
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
