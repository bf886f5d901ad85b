//! Passes in any order, with any parameters, on the fixture materials: all compose or refuse.

use std::sync::OnceLock;

use preshade_compiler::front::{self, Source};
use preshade_compiler::parameters::{Parameter, parameters};
use preshade_compiler::recipe::Recipe;
use preshade_geometry::PASSES;
use preshade_plan::pass::{AnyPass, Facts};
use preshade_plan::plan::Plan;
use preshade_plan::state::{CullMode, DepthDirection, DepthFormat, MaterialState};
use shader_text::options::Options;

use super::{Bytes, emitted, root};

/// Most steps of a recipe.
const STEPS: usize = 4;

/// The WGSL fixture materials, by name.
pub fn materials() -> &'static [(String, Plan)] {
    static MATERIALS: OnceLock<Vec<(String, Plan)>> = OnceLock::new();
    MATERIALS.get_or_init(|| {
        let folder = root().join("fixtures/shaders");
        let mut files: Vec<_> = std::fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().path())
            .filter(|p| p.extension().is_some_and(|e| e == "wgsl"))
            .collect();
        files.sort();
        let of = |path: &std::path::PathBuf| {
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            let text = std::fs::read_to_string(path).unwrap();
            let parsed = front::parse(&[Source::new("m.wgsl", text)], &Options::default()).unwrap();
            let fragment = parsed.fragment.as_deref();
            let state = MaterialState::default();
            let plan = Plan::original(&name, parsed.program, &parsed.vertex, fragment, &state);
            (name, plan)
        };
        files.iter().map(of).collect()
    })
}

/// A fixture material.
pub fn material(name: &str) -> Plan {
    let found = materials().iter().find(|(n, _)| n == name);
    found.unwrap().1.clone()
}

/// A material under a state of its own.
fn chosen(bytes: &mut Bytes<'_>) -> Plan {
    let all = materials();
    let (name, plan) = &all[bytes.below(all.len())];
    let mut state = MaterialState {
        depth_format: [
            DepthFormat::Depth32float,
            DepthFormat::Depth24plus,
            DepthFormat::Depth16unorm,
        ][bytes.below(3)],
        ..MaterialState::default()
    };
    let flags = bytes.byte();
    if flags & 1 != 0 {
        state.depth_direction = DepthDirection::Reversed;
    }
    if flags & 2 != 0 {
        state.multisample.count = 4;
    }
    if flags & 4 != 0 {
        state.primitive.cull = CullMode::None;
    }
    if flags & 0x30 == 0x30 {
        state.multisample.alpha_to_coverage = state.multisample.count == 4;
    }
    let pass = plan.main().unwrap();
    let program = plan.program(pass).unwrap().clone();
    Plan::original(
        name,
        program,
        &pass.vertex,
        pass.fragment.as_deref(),
        &state,
    )
}

fn facts(bytes: &mut Bytes<'_>) -> Facts {
    match bytes.below(3) {
        0 => Facts::default(),
        1 => Facts::without_ties(),
        _ => Facts {
            depth_ties: Some(7),
            undiscarded_depth_ties: Some(3),
            near_plane_pixels: Some(5),
            ..Facts::default()
        },
    }
}

fn value(parameter: &Parameter, bytes: &mut Bytes<'_>) -> Option<String> {
    if !parameter.choices.is_empty() {
        let at = bytes.below(parameter.choices.len());
        return Some(parameter.choices[at].value.clone());
    }
    Some(
        match parameter.kind.as_deref()? {
            "integer" => [
                "0",
                "1",
                "2",
                "3",
                "5",
                "8",
                "16",
                "64",
                "1000",
                "4294967295",
            ][bytes.below(10)],
            "number" => {
                ["0", "0.004", "0.02", "0.5", "1", "2", "1e-30", "1e30", "-1"][bytes.below(9)]
            }
            "boolean" => ["true", "false"][bytes.below(2)],
            // Words: names of values and sites, that are rarely there.
            _ => ["x", "model", "camera.time", "all"][bytes.below(4)],
        }
        .to_owned(),
    )
}

fn step(pass: &'static dyn AnyPass, bytes: &mut Bytes<'_>) -> String {
    let mut text = pass.info().name.to_owned();
    let all = parameters(pass);
    let mut taken = Vec::new();
    for _ in 0..bytes.below(4) {
        let at = bytes.below(all.len().max(1));
        let Some(parameter) = all.get(at).filter(|_| !taken.contains(&at)) else {
            continue;
        };
        taken.push(at);
        if let Some(value) = value(parameter, bytes) {
            let separator = if text.contains(':') { ',' } else { ':' };
            text.push(separator);
            text.push_str(&format!("{}={value}", parameter.name));
        }
    }
    // What approximates is refused without a budget, and there would be little to compose.
    if all.iter().any(|p| p.name == "budget") && !text.contains("budget=") && bytes.below(2) == 0 {
        let separator = if text.contains(':') { ',' } else { ':' };
        text.push_str(&format!("{separator}budget=1"));
    }
    text
}

/// How a recipe ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// It could not be read: a number out of its range.
    Unread,
    /// A step was refused.
    Refused,
    /// It made a plan, which was emitted and read back.
    Composed,
}

/// Material, state, facts and recipe of `data`, applied.
pub fn recipes(data: &[u8]) -> Ended {
    let bytes = &mut Bytes(data);
    let plan = chosen(bytes);
    let facts = facts(bytes);
    let steps = 1 + bytes.below(STEPS);
    let steps: Vec<String> = (0..steps)
        .map(|_| step(PASSES[bytes.below(PASSES.len())], bytes))
        .collect();
    let Ok(recipe) = Recipe::parse(&steps) else {
        return Ended::Unread;
    };
    match recipe.apply(&plan, &facts) {
        Err(_) => Ended::Refused,
        Ok(plan) => {
            emitted(&plan);
            Ended::Composed
        }
    }
}
