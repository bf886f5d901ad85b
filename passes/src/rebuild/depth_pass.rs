//! Adds the GPU pass of a depth-only program to a plan. Depth pre-pass, shadow pass and the depth
//! texture of an early discard share it.

use naga::{Module, ShaderStage};

use super::depth_only::{Invariance, Placed};
use super::place;
use crate::analysis::opaque::Opaque;
use crate::analysis::{coverage, refusals};
use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::pass::Refusal;
use preshade_plan::plan::{Draws, GpuPass, Phase, Plan, Role};
use preshade_plan::reflect;
use preshade_plan::state::{CompareFunction, DepthFormat, DepthState};

/// The material, for a picture of its own that has one sample and no colour of the author's: alpha
/// to coverage does not apply there.
///
/// # Errors
/// As [`Opaque::examine`], and for a material that alpha covers or whose stages read values made of
/// the camera's uniforms.
pub fn alone<'p>(plan: &'p Plan, name: &'static str) -> Result<Opaque<'p>, Vec<Refusal>> {
    let opaque = Opaque::examine(plan, name)?;
    if !plan.draw_buffers.is_empty() {
        return Err(vec![Refusal::new(
            name,
            &refusals::NOT_FIRST,
            "its stages read what a compute pass makes of the camera's uniforms, and the picture \
             may be of another view",
            "derive it from a plan without `preamble`",
        )]);
    }
    if opaque.decides.alpha {
        return Err(vec![Refusal::new(
            name,
            &refusals::ALPHA_TO_COVERAGE,
            "coverage comes from alpha, sample by sample, and a picture of one sample, such as a \
             shadow map, has no colour target to take alpha from",
            "test alpha by discard",
        )]);
    }
    Ok(opaque)
}

/// The depth of a light's picture, a frame of its own: forward, without the camera's bias, which is in
/// units of the camera's format and direction. A light needs its own, which the host knows.
pub(crate) fn of_light(attachment: String, format: DepthFormat) -> DepthState {
    DepthState::new(attachment, format, CompareFunction::Less, true)
}

/// The program of a pre-pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PrepassProgram {
    /// The main pass's, because the hardware compares depths of both passes for equality.
    Main,
    /// A module that contains only the pre-pass's entry points.
    Own,
}

impl PrepassProgram {
    /// The module of the main pass for the pre-pass `placed`: the shared one, or the author's with
    /// the position marked if needed.
    pub fn main_module(self, opaque: &Opaque, placed: &Placed, invariance: Invariance) -> Module {
        match self {
            Self::Main => placed.module.clone(),
            Self::Own => invariance.apply(opaque.program.module().clone(), opaque.vertex),
        }
    }

    /// Inserts the pre-pass before the main pass. `name` is the pass that asks.
    ///
    /// # Errors
    /// Our program does not validate: a bug.
    pub fn insert(
        self,
        plan: &mut Plan,
        opaque: &Opaque,
        placed: Placed,
        depth: DepthState,
        name: &str,
    ) -> Result<(), Box<Refusal>> {
        let (role, phase) = (Role::Prepass, Phase::Depth);
        match self {
            Self::Own => insert_own(plan, opaque, placed, role, phase, depth, name),
            Self::Main => {
                let main = &opaque.pass.program;
                insert(plan, opaque.pass, &placed, main, role, phase, depth);
                Ok(())
            }
        }
    }
}

/// Puts `main` in place of the module of the main pass's program.
///
/// # Errors
/// It does not validate: a bug.
pub(crate) fn replace_main(
    plan: &mut Plan,
    opaque: &Opaque,
    main: Module,
    name: &str,
) -> Result<(), Box<Refusal>> {
    let main = opaque
        .program
        .with_module(main)
        .map_err(|e| Refusal::bug(name, e))?;
    plan.programs.insert(opaque.pass.program.clone(), main);
    Ok(())
}

/// The assumptions under which a pre-pass of other positions hides no fragment that the main pass
/// shows, if it leaves a margin.
pub(crate) const WITH_MARGIN: [Assumption; 3] = [
    Assumption::PositionWithinBias,
    Assumption::SameViewport,
    Assumption::OrdinaryNeighbours,
];

/// Inserts a depth-only GPU pass before the main pass. Under alpha to coverage it has the main
/// pass's colour targets with an empty write mask. `program` is the key of a program in the plan.
fn insert(
    plan: &mut Plan,
    main: &GpuPass,
    placed: &Placed,
    program: &str,
    role: Role,
    phase: Phase,
    depth: DepthState,
) {
    let mut pass = GpuPass {
        role,
        phase,
        program: program.to_owned(),
        vertex: placed.vertex.clone(),
        fragment: placed.fragment.clone(),
        depth: Some(depth),
        targets: coverage::targets(main),
        // `fill` updates the list and keeps the sources.
        bindings: main.bindings.clone(),
        attributes: Vec::new(),
        draws: Draws::Opaque,
        ..main.clone()
    };
    if let Some(p) = plan.programs.get(program) {
        reflect::fill(&mut pass, p);
    }
    plan.passes.insert(0, pass);
}

/// Inserts a depth-only GPU pass with its own program, which contains only its entry points and is
/// named after its role.
///
/// # Errors
/// Our program does not validate: a bug.
pub(crate) fn insert_own(
    plan: &mut Plan,
    opaque: &Opaque,
    placed: Placed,
    role: Role,
    phase: Phase,
    depth: DepthState,
    name: &str,
) -> Result<(), Box<Refusal>> {
    let mut kept = vec![(ShaderStage::Vertex, placed.vertex.as_str())];
    kept.extend(
        placed
            .fragment
            .as_deref()
            .map(|f| (ShaderStage::Fragment, f)),
    );
    let program = opaque
        .program
        .with_module(place::retain(&placed.module, &kept))
        .map_err(|e| Refusal::bug(name, e))?;
    plan.programs.insert(role.name().to_owned(), program);
    insert(plan, opaque.pass, &placed, role.name(), role, phase, depth);
    Ok(())
}

/// Finishes every transform: updates bindings and attributes, derives the contract from the steps.
pub fn finish(plan: &mut Plan, fallback: &str) {
    for pass in &mut plan.passes {
        if let Some(program) = plan.programs.get(&pass.program) {
            reflect::fill(pass, program);
        }
    }
    plan.contract = plan
        .steps
        .iter()
        .map(|s| s.contract.clone())
        .fold(Contract::exact(), Contract::and);
    plan.fallback = Some(fallback.to_owned());
}
