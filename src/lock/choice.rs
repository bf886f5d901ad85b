//! What was chosen for a material: made into a lock's entry, and made again from it.

use preshade_passes::contract::Verdict;
use preshade_passes::pass::Facts;
use preshade_passes::plan::Plan;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::inputs::{hash, said};
use super::{Inputs, Mismatch};
use crate::emit::{self, Target};
use crate::recipe::{Recipe, Step};

/// What was chosen for one material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Locked {
    /// The recipe, every step with its site and all its parameters. No steps: the original is best.
    pub recipe: Recipe,
    /// What it was made of.
    pub inputs: Inputs,
    /// BLAKE3 of the WGSL that came of it, comments and blanks at the ends of lines apart, in hex.
    pub shaders: String,
    /// What the passes read of the scene, as far as it is about this material.
    #[serde(default, skip_serializing_if = "is_nothing")]
    pub facts: Facts,
    /// The figures that spoke for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured: Option<Measured>,
}

fn is_nothing(facts: &Facts) -> bool {
    *facts == Facts::default()
}

/// What was measured of a choice, beside the original in one process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// The scene it was measured on, by its file's name.
    pub scene: String,
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    /// Name of the adapter, and `with checked shaders` behind it where they were compiled with checks.
    pub adapter: String,
    /// Its driver, with the version.
    pub driver: String,
    /// Whether the contract held there.
    pub verdict: Verdict,
    /// Median time of a frame of the original in the first view, in milliseconds.
    pub original_ms: f64,
    /// Median time of a frame of the choice there, in milliseconds.
    pub variant_ms: f64,
    /// Speedup there: its median between the ends of its confidence interval.
    pub speedup: [f64; 3],
}

impl Locked {
    /// Applies `recipe` and keeps it with the sites and parameters that it came to.
    ///
    /// `facts` is what the recipe was measured under; a recipe that rests on measured thresholds has to be written out first (`measure::written_out`), since what is kept here has no
    /// frequencies.
    ///
    /// # Errors
    /// [`Mismatch::Refused`], or [`Mismatch::Emit`] where the result cannot be written as WGSL.
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

    /// Makes the plan that was chosen.
    ///
    /// # Errors
    /// A step no longer applies, or the shaders that come of it are not those that were measured.
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
    let step = |step: &preshade_passes::plan::Step| {
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

/// What of `facts` a lock keeps for a material: nothing of the others, and no frequencies.
fn about(material: &str, facts: &Facts) -> Facts {
    // Every field by name: what is added to the facts has to say here whose it is.
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
        samplers,
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
        samplers: own(samplers, |s| s.material == material),
    }
}

fn own<T: Clone>(all: &[T], is_own: impl Fn(&T) -> bool) -> Vec<T> {
    all.iter().filter(|one| is_own(one)).cloned().collect()
}

/// Hash of the WGSL of a plan, in the order of its programs, as [`said`].
fn hash_shaders(plan: &Plan) -> Result<String, emit::Error> {
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
