//! A lock's entry for one material: made from a chosen recipe, and turned into a plan again.

use preshade_plan::contract::Verdict;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::inputs::{hash, said};
use super::{Inputs, Mismatch};
use crate::emit;
use crate::recipe::{Recipe, Step};
use preshade_plan::plan_file::Target;

/// The choice for one material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Locked {
    /// The recipe, with all parameters. No steps: the original is best.
    pub recipe: Recipe,
    /// The source and the options that it was chosen for.
    pub inputs: Inputs,
    /// BLAKE3 of the resulting WGSL in hex, without comments and trailing blanks.
    pub shaders: String,
    /// The facts about this material that the passes read.
    #[serde(default, skip_serializing_if = "is_nothing")]
    pub facts: Facts,
    /// The measurements that decided.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured: Option<Measured>,
}

fn is_nothing(facts: &Facts) -> bool {
    *facts == Facts::default()
}

/// Measurements of a choice beside the original, in one process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// File name of the scene.
    pub scene: String,
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    /// Name of the adapter, followed by `with checked shaders` if shaders were compiled with
    /// checks.
    pub adapter: String,
    /// Its driver, with the version.
    pub driver: String,
    /// Whether the contract held there.
    pub verdict: Verdict,
    /// Median frame time of the original in the first view, in milliseconds.
    pub original_ms: f64,
    /// Median frame time of the choice in the first view, in milliseconds.
    pub variant_ms: f64,
    /// Speedup in the first view: low end, median and high end of its confidence interval.
    pub speedup: [f64; 3],
}

impl Locked {
    /// Applies `recipe` and keeps it with its resolved parameters.
    ///
    /// Resolve measured thresholds first, with `measure::written_out`: a lock keeps no frequencies.
    ///
    /// # Errors
    /// [`Mismatch::Refused`], or [`Mismatch::Emit`] if the result cannot be emitted as WGSL.
    pub fn resolve(
        original: &Plan,
        recipe: &Recipe,
        facts: &Facts,
        inputs: Inputs,
        measured: Option<Measured>,
    ) -> Result<Self, Mismatch> {
        let facts = about(&original.material, facts);
        let plan = recipe.apply(original, &facts).map_err(Mismatch::Refused)?;
        Ok(Self {
            recipe: resolved(&plan),
            shaders: hash_shaders(&plan)?,
            inputs,
            facts,
            measured,
        })
    }

    /// Makes the chosen plan.
    ///
    /// # Errors
    /// A step no longer applies, or the resulting shaders differ from the measured ones.
    pub fn apply(&self, original: &Plan) -> Result<Plan, Mismatch> {
        let plan = self.recipe.apply(original, &self.facts);
        let plan = plan.map_err(Mismatch::Refused)?;
        match hash_shaders(&plan)? == self.shaders {
            true => Ok(plan),
            false => Err(Mismatch::Shaders),
        }
    }
}

/// The steps of a plan as a recipe that finds the same sites again.
fn resolved(plan: &Plan) -> Recipe {
    let step = |step: &preshade_plan::plan::Step| {
        let params = step.params.as_object().cloned().unwrap_or_default();
        Step {
            pass: step.pass.clone(),
            params: params.into_iter().filter(|(_, v)| !v.is_null()).collect(),
            site: Some(step.site.clone()),
        }
    };
    Recipe {
        steps: plan.steps.iter().map(step).collect(),
    }
}

/// The facts that a lock keeps: those about the material, without frequencies.
fn about(material: &str, facts: &Facts) -> Facts {
    // Every field by name: a new fact must be assigned to a material here.
    let Facts {
        depth_ties,
        undiscarded_depth_ties,
        near_plane_pixels,
        vertices_per_fragment,
        changing,
        ranges,
        constants,
        frequencies: _,
        rasterizer,
        steady_textures,
        infinite_textures,
        narrow_depths,
        undrawn,
    } = facts;
    Facts {
        depth_ties: *depth_ties,
        undiscarded_depth_ties: *undiscarded_depth_ties,
        near_plane_pixels: *near_plane_pixels,
        vertices_per_fragment: *vertices_per_fragment,
        changing: changing
            .as_ref()
            .map(|all| own(all, |c| c.material == material)),
        ranges: own(ranges, |r| r.material == material),
        constants: own(constants, |c| c.material == material),
        frequencies: Vec::new(),
        rasterizer: *rasterizer,
        steady_textures: own(steady_textures, |s| s.material == material),
        infinite_textures: own(infinite_textures, |t| t.material == material),
        narrow_depths: own(narrow_depths, |name| name == material),
        undrawn: undrawn
            .as_ref()
            .map(|all| own(all, |u| u.material == material)),
    }
}

fn own<T: Clone>(all: &[T], is_own: impl Fn(&T) -> bool) -> Vec<T> {
    all.iter().filter(|one| is_own(one)).cloned().collect()
}

/// Hash of the WGSL of a plan, in the order of its programs, normalised by [`said`].
fn hash_shaders(plan: &Plan) -> Result<String, emit::EmitError> {
    let files = emit::emit(plan, &[Target::Wgsl], &emit::Options::default())?;
    let mut text = String::new();
    for file in files.iter().filter(|f| f.name.ends_with(".wgsl")) {
        text.push_str(&file.name);
        text.push('\n');
        text.push_str(&said(&String::from_utf8_lossy(&file.bytes)));
        text.push('\n');
    }
    Ok(hash(&text))
}
