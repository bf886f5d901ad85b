//! A material on its own: its name, its definitions and its pipeline state.

use naga::{Binding, BuiltIn, ShaderStage};
use naga_edit::interface;
use preshade_plan::plan::Plan;
use preshade_plan::state::{
    Blend, COLOR_FORMATS, ColorTarget, CompareFunction, CullMode, DepthDirection, DepthFormat,
    MaterialState, Topology,
};
use serde::Deserialize;

use crate::front::Parsed;
use shader_text::nearest::nearest;

/// The name of a material: its file's without the endings. `stem` lacks the last of them.
pub fn name_of(stem: &str) -> &str {
    let stages = [".vert", ".frag", ".vs", ".fs"];
    let mut without = stages.iter().filter_map(|stage| stem.strip_suffix(stage));
    without.next().unwrap_or(stem)
}

/// Reads a definition, `NAME` or `NAME=VALUE`.
///
/// # Errors
/// It is neither, as a message.
pub fn define(text: &str) -> Result<(String, String), String> {
    let (name, value) = text.split_once('=').unwrap_or((text, "1"));
    let starts = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
    if !starts || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
        return Err(format!("--define {text}: expected NAME or NAME=VALUE"));
    }
    Ok((name.to_owned(), value.to_owned()))
}

/// serde's error for an unknown name, with the nearest known name.
pub fn with_suggestion(message: &str) -> String {
    let mut words = message.split('`').skip(1).step_by(2);
    let near = message
        .contains("unknown ")
        .then(|| words.next())
        .flatten()
        .and_then(|wrong| nearest(wrong, words));
    match near {
        Some(near) => format!("{}\n  = help: did you mean `{near}`?", message.trim_end()),
        None => message.to_owned(),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BlendFlag {
    None,
    /// Source over destination.
    Alpha,
    /// Additive.
    Add,
}

/// The states that a user changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "camelCase")]
pub struct StateFlags {
    pub depth_compare: Option<CompareFunction>,
    pub depth_format: Option<DepthFormat>,
    /// Depth is 1 at the near plane and 0 at the far one.
    pub reversed_z: bool,
    /// The material does not write depth.
    pub no_depth_write: bool,
    /// Blending of the first colour target.
    pub blend: Option<BlendFlag>,
    pub cull: Option<CullMode>,
    pub topology: Option<Topology>,
    pub samples: Option<u32>,
    /// Coverage from the alpha of the first target.
    pub alpha_to_coverage: bool,
}

impl StateFlags {
    /// Writes the given states into `state`.
    pub fn apply(self, state: &mut MaterialState) {
        if let Some(compare) = self.depth_compare {
            state.depth_compare = Some(compare);
        }
        if let Some(format) = self.depth_format {
            state.depth_format = format;
        }
        if self.reversed_z {
            state.depth_direction = DepthDirection::Reversed;
        }
        if self.no_depth_write {
            state.depth_write = false;
        }
        if let Some(cull) = self.cull {
            state.primitive.cull = cull;
        }
        if let Some(topology) = self.topology {
            state.primitive.topology = topology;
        }
        if let Some(samples) = self.samples {
            state.multisample.count = samples;
        }
        state.multisample.alpha_to_coverage |= self.alpha_to_coverage;
        if let Some(blend) = self.blend {
            let blend = match blend {
                BlendFlag::None => None,
                BlendFlag::Alpha => Some(Blend::ALPHA),
                BlendFlag::Add => Some(Blend::ADD),
            };
            if state.targets.is_empty() {
                state.targets.push(Some(ColorTarget::opaque("rgba8unorm")));
            }
            if let Some(Some(target)) = state.targets.first_mut() {
                target.blend = blend;
            }
        }
    }
}

/// Whether the fragment stage reads which side it draws, so that its back is meant to be visible.
pub fn reads_facing(parsed: &Parsed) -> bool {
    let module = parsed.program.module();
    let fragment = parsed.fragment.as_deref();
    let entry = fragment.and_then(|f| parsed.program.entry_point(ShaderStage::Fragment, f));
    let facing = Some(Binding::BuiltIn(BuiltIn::FrontFacing));
    entry.is_some_and(|(_, entry)| {
        let inputs = interface::inputs(module, &entry.function);
        inputs.iter().any(|io| io.binding == facing)
    })
}

/// A note about the state of a plan where the user gave none.
pub fn assumed(plan: &Plan) -> Option<String> {
    Some(format!(
        "note: pipeline state assumed of `{}`: {} (--state FILE or its flags say otherwise)",
        plan.material,
        described(plan)?
    ))
}

/// The pipeline state of a plan's main pass, in a line. `None`: it has none.
fn described(plan: &Plan) -> Option<String> {
    let pass = plan.main()?;
    let mut parts: Vec<String> = Vec::new();
    for target in pass.targets.iter().flatten() {
        parts.push(match target.blend {
            None => format!("opaque {}", target.format),
            Some(_) => format!("blended {}", target.format),
        });
    }
    parts.push(format!("cull {}", name(&pass.primitive.cull)));
    parts.push(name(&pass.primitive.topology));
    if let Some(depth) = &pass.depth {
        let format = plan
            .depth_format(&depth.attachment)
            .map_or(String::new(), |f| name(&f));
        let written = if depth.write {
            "written"
        } else {
            "not written"
        };
        parts.push(format!(
            "{} depth {}, {written}",
            name(&depth.compare),
            format
        ));
    }
    if pass.multisample.count > 1 {
        parts.push(format!("{} samples", pass.multisample.count));
    }
    Some(parts.join(", "))
}

/// A state value by its name in JSON.
fn name(value: &impl serde::Serialize) -> String {
    let json = serde_json::to_value(value).unwrap_or_default();
    json.as_str().unwrap_or_default().to_owned()
}

/// Checks a state.
///
/// # Errors
/// No adapter supports it, as a message.
pub fn check_state(state: &MaterialState) -> Result<(), String> {
    let samples = state.multisample.count;
    if !matches!(samples, 1 | 4) {
        return Err(format!("multisample.count is 1 or 4, not {samples}"));
    }
    for target in state.targets.iter().flatten() {
        if !COLOR_FORMATS.contains(&target.format.as_str()) {
            return Err(format!(
                "there is no colour format `{}` that can be drawn to and compared; \
                 in WebGPU's spelling: rgba8unorm, say",
                target.format
            ));
        }
    }
    Ok(())
}
