//! Flags for a material's pipeline state, and the state file.

use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use preshade_compiler::command::material::{BlendFlag, StateFlags, check_state, with_suggestion};
use preshade_draw::scene::Scene;
use preshade_plan::state::{
    CompareFunction, CullMode, DepthDirection, DepthFormat, MaterialState, Topology,
};
use shader_text::limits::Limits;
use shader_text::read_limited;

use crate::Failure;

/// Pipeline state, which a shader does not contain.
#[derive(Clone, Default, clap::Args)]
#[command(next_help_heading = "Pipeline state")]
pub struct StateArgs {
    /// A TOML or JSON file with the whole state; the flags below override it.
    #[arg(long, value_name = "FILE")]
    pub state: Option<PathBuf>,
    /// Depth comparison; default: less, or greater with --reversed-z.
    #[arg(long, value_parser = words::<CompareFunction>(&COMPARE), value_name = "NAME")]
    pub depth_compare: Option<CompareFunction>,
    /// Depth format.
    #[arg(long, value_parser = words::<DepthFormat>(&DEPTH_FORMATS), value_name = "NAME")]
    pub depth_format: Option<DepthFormat>,
    /// Depth is 1 at the near plane and 0 at the far one.
    #[arg(long)]
    pub reversed_z: bool,
    /// The material does not write depth.
    #[arg(long)]
    pub no_depth_write: bool,
    /// Blending of the first colour target: none, alpha or add.
    #[arg(long, value_enum)]
    pub blend: Option<BlendArg>,
    /// Faces to cull.
    #[arg(long, value_parser = words::<CullMode>(&CULL), value_name = "NAME")]
    pub cull: Option<CullMode>,
    /// Primitive topology.
    #[arg(long, value_parser = words::<Topology>(&TOPOLOGIES), value_name = "NAME")]
    pub topology: Option<Topology>,
    /// Samples a pixel.
    #[arg(long, value_parser = ["1", "4"])]
    pub samples: Option<String>,
    /// Coverage from the alpha of the first target.
    #[arg(long)]
    pub alpha_to_coverage: bool,
}

/// Common blend states.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum BlendArg {
    /// Opaque.
    None,
    /// Source over.
    Alpha,
    /// Additive.
    Add,
}

/// Names of state values in JSON, which are WebGPU's.
const COMPARE: [&str; 8] = [
    "never",
    "less",
    "equal",
    "less-equal",
    "greater",
    "not-equal",
    "greater-equal",
    "always",
];
const DEPTH_FORMATS: [&str; 5] = [
    "depth16unorm",
    "depth24plus",
    "depth24plus-stencil8",
    "depth32float",
    "depth32float-stencil8",
];
const CULL: [&str; 3] = ["none", "front", "back"];
const TOPOLOGIES: [&str; 5] = [
    "point-list",
    "line-list",
    "line-strip",
    "triangle-list",
    "triangle-strip",
];

/// Reads a state value by its name.
fn words<T>(names: &'static [&'static str]) -> impl TypedValueParser<Value = T>
where
    T: serde::de::DeserializeOwned + Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(names)
        .try_map(|name| serde_json::from_value::<T>(serde_json::Value::String(name)))
}

impl StateArgs {
    /// Whether the user gave no culling.
    pub fn says_no_cull(&self) -> bool {
        self.cull.is_none() && self.state.is_none()
    }

    pub fn state(&self) -> Result<MaterialState, Failure> {
        let mut state = match &self.state {
            None => MaterialState::default(),
            Some(path) => {
                let text = read_limited::text(path, &Limits::default(), "source-bytes")
                    .map_err(|e| Failure::unread(path, &e))?;
                let read = if path.extension().is_some_and(|e| e == "json") {
                    serde_json::from_str(&text).map_err(|e| e.to_string())
                } else {
                    toml::from_str(&text).map_err(|e| e.to_string())
                };
                read.map_err(|e| {
                    Failure(format!(
                        "error: {}: {}",
                        path.display(),
                        with_suggestion(&e)
                    ))
                })?
            }
        };
        let flags = StateFlags {
            depth_compare: self.depth_compare,
            depth_format: self.depth_format,
            reversed_z: self.reversed_z,
            no_depth_write: self.no_depth_write,
            blend: self.blend.map(|blend| match blend {
                BlendArg::None => BlendFlag::None,
                BlendArg::Alpha => BlendFlag::Alpha,
                BlendArg::Add => BlendFlag::Add,
            }),
            cull: self.cull,
            topology: self.topology,
            samples: self.samples.as_ref().and_then(|s| s.parse().ok()),
            alpha_to_coverage: self.alpha_to_coverage,
        };
        flags.apply(&mut state);
        check_state(&state).map_err(|e| Failure(format!("error: {e}")))?;
        Ok(state)
    }

    /// The scene with the requested depth format, direction and sample count.
    pub fn set_up(&self, mut scene: Scene) -> Scene {
        let format = self.depth_format.unwrap_or(scene.depth_format);
        let direction = match self.reversed_z {
            true => DepthDirection::Reversed,
            false => scene.depth_direction,
        };
        if (format, direction) != (scene.depth_format, scene.depth_direction) {
            scene = scene.with_depth(format, direction);
        }
        match self.samples.as_deref() {
            None => scene,
            Some("4") => scene.with_samples(4),
            Some(_) => scene.with_samples(1),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic)]

    use super::*;

    /// The known names in serde's error.
    fn expected<T: serde::de::DeserializeOwned>() -> Vec<String> {
        let said = serde_json::from_str::<T>("\"?\"")
            .err()
            .unwrap()
            .to_string();
        said.split('`')
            .skip(3)
            .step_by(2)
            .map(str::to_owned)
            .collect()
    }

    #[test]
    fn the_help_lists_every_name_there_is() {
        assert_eq!(expected::<CompareFunction>(), COMPARE);
        assert_eq!(expected::<DepthFormat>(), DEPTH_FORMATS);
        assert_eq!(expected::<CullMode>(), CULL);
        assert_eq!(expected::<Topology>(), TOPOLOGIES);
    }

    #[test]
    fn a_slip_in_a_key_is_seen() {
        let said = toml::from_str::<MaterialState>("dept_write = false")
            .err()
            .unwrap();
        assert!(with_suggestion(&said.to_string()).ends_with("did you mean `depth_write`?"));
    }
}
