//! Counts the pixels that a compute resolve shades, with a full-screen pass.

use naga::ShaderStage;

use super::binding_sources::parts;
use super::resolve;
use super::text::{self, Slots};
use preshade_passes::rebuild::place;
use preshade_passes::rebuild::snippet::Linked;
use preshade_plan::draw_table::{IDS, Words};
use preshade_plan::geometry::Formats;
use preshade_plan::plan::{ComputePass, Draws, GpuPass, Phase, Plan, Role};
use preshade_plan::program::Program;
use preshade_plan::reflect;

/// The full-screen pass and program that replace a resolving compute pass to count its pixels.
///
/// # Errors
/// Our own program does not validate, which is a bug.
pub fn counted(plan: &Plan, compute: &ComputePass) -> Result<(GpuPass, Program), String> {
    let program = plan
        .programs
        .get(&compute.program)
        .ok_or("it has no program of that name")?;
    let ids = plan.attachment(IDS).map(|a| &a.format);
    let words = match ids == Some(&Words::One.format()) {
        true => Words::One,
        false => Words::Two,
    };
    let module = Linked::new(naga::Module::default(), &text::count(words))?.module;
    let entries = [
        (ShaderStage::Vertex, resolve::VERTEX),
        (ShaderStage::Fragment, "fs_count"),
    ];
    let program = program
        .with_module(place::retain(&module, &entries))
        .map_err(|e| e.to_string())?;
    let like = plan
        .passes
        .iter()
        .find(|p| p.role == Role::Clear)
        .ok_or("nothing clears what it writes to")?;
    let mut pass = GpuPass {
        role: Role::Resolve,
        phase: Phase::Resolve,
        program: "count".to_owned(),
        vertex: resolve::VERTEX.to_owned(),
        fragment: Some("fs_count".to_owned()),
        draws: Draws::Opaque,
        bindings: parts(Slots { group: 0, first: 0 }, &[], Formats::Declared),
        ..like.clone()
    };
    reflect::fill(&mut pass, &program);
    Ok((pass, program))
}
