//! The record of a measurement, as data: the JSON of `verify`. The module `report` prints it.

mod choice;
pub mod partial_report;
mod path;
mod picture;
mod sweep;

use preshade_plan::contract::{Contract, Verdict};
use serde::{Deserialize, Serialize};

use super::error::counted;
use super::statistics::Invocations;
use super::{Clock, ErrorLadder, Estimate, FrameTime, Junction, OutputsReport, ShadowReport};
use preshade_draw::render::{AdapterReport, SelfTestResult, SubdivisionCost};
use preshade_draw::scene::DrawOrder;
use preshade_draw::scene::bind::Guessed;

pub use choice::{Choice, Chosen};
pub use partial_report::Unfinished;
pub use path::PathTime;
pub(super) use path::times;
pub use picture::{DIFFERENCE_FACTOR, Elsewhere, FAINTEST, Picture, Pictures, Worst};
pub use sweep::{SweepPoint, SweepReport};

/// Version of the JSON that [`Report`] serialises to.
pub(crate) const SCHEMA: &str = "preshade.verify.v1";

/// Name of the first variant: the scene as its author wrote it.
pub const ORIGINAL: &str = "original";

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    pub schema: String,
    pub scene: String,
    /// For a captured frame, the part of it that `scene` is, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// Width and height, in pixels.
    pub resolution: [u32; 2],
    pub samples: u32,
    /// The command that measured it.
    pub command: String,
    pub adapter: AdapterReport,
    /// The clock of all times. `None`: nothing was timed.
    pub clock: Option<Clock>,
    /// Depth ties over every view, in samples. `None`: not measured.
    pub depth_ties: Option<u64>,
    /// Whether preshade made the scene up, around a bare shader.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub made_up: bool,
    /// Inputs that the scene does not give: filled by convention, or made up.
    pub assumed: Vec<Guessed>,
    /// Notes about a captured frame: parts that the scene draws differently, the shares of its
    /// time, and how its replay compares with the page.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Reasons to trust the pictures less: a single colour, or attributes that are made up.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Reasons why the pictures test too little, so that no verdict counts.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub untested: Vec<String>,
    /// The recipe with the largest static saving among those that were neither requested nor drawn,
    /// with its saving. `None`: a drawn variant pays, or nothing saves enough.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub not_drawn: Option<String>,
    /// The original first, named [`ORIGINAL`].
    pub variants: Vec<VariantReport>,
    /// Swept recipes, whose points are among the variants.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sweeps: Vec<SweepReport>,
    /// The variant selected by a budget. `None`: no budget was set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chosen: Option<Chosen>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VariantReport {
    pub name: String,
    /// The recipe that made it, as it is written on a command line.
    pub recipe: String,
    pub contract: Contract,
    /// Whether measurement confirms the contract.
    pub verdict: Verdict,
    /// The worst of every view, rung by rung. `None`: nothing was compared.
    pub error: Option<ErrorLadder>,
    /// Milliseconds a frame in the headline view: first camera, first order.
    pub time_ms: Option<FrameTime>,
    /// The original's time over this one's, in the headline view.
    pub speedup: Option<Estimate>,
    /// Shaded fragments a covered pixel in the headline view; 1.00 is the least there can be.
    pub shaded_per_pixel: Option<f64>,
    pub cost: Option<Cost>,
    /// Its shadow passes under the scene's light; `None`: it has none.
    pub shadow: Option<ShadowReport>,
    /// Its auxiliary pictures; `None`: it has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outputs: Option<OutputsReport>,
    /// The self-tests of its plans, in the scene's order of materials. Empty where no plan has one.
    pub self_test: Vec<SelfTestReport>,
    /// Edges that it divides in one draw and not in the adjacent draw. Empty where nothing is
    /// subdivided.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub junctions: Vec<Junction>,
    /// Materials of the scene that this variant draws as their author wrote them, and why.
    pub kept: Vec<KeptMaterial>,
    /// Each camera path with several timed frames.
    pub by_path: Vec<PathTime>,
    /// Each camera, frame and order.
    pub by_view: Vec<ViewReport>,
}

/// The self-test of one plan.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SelfTestReport {
    pub material: String,
    #[serde(flatten)]
    pub result: SelfTestResult,
    /// The recipe that the plan names for where it fails.
    pub fallback: Option<String>,
}

/// A material that a variant leaves alone, wholly or in part.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeptMaterial {
    pub material: String,
    /// The skipped step, if other steps changed the material.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub without: Option<String>,
    pub why: String,
}

/// Costs other than GPU time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    pub pipelines: usize,
    /// Milliseconds to compile its shaders and build its pipelines. `None`: a job for pictures, whose
    /// result depends on no time.
    pub creation_ms: Option<f64>,
    /// Draw calls of one frame.
    pub draw_calls: usize,
    /// Bytes of its depth and colour attachments.
    pub target_bytes: u64,
    /// The cost of subdivided geometry. `None`: there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subdivision: Option<SubdivisionCost>,
    /// Milliseconds the CPU takes to encode one frame; `None`: not timed.
    pub encode_ms: Option<f64>,
    /// Invocations of one frame in the headline view, where the adapter counts them.
    pub invocations: Option<Invocations>,
}

/// One variant in one view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewReport {
    pub camera: String,
    /// Frame of the camera, from 0.
    pub frame: usize,
    pub order: DrawOrder,
    /// Against the original.
    pub error: ErrorLadder,
    /// Milliseconds a frame, where this view was timed.
    pub time_ms: Option<FrameTime>,
    /// The original's time over this one's.
    pub speedup: Option<Estimate>,
    /// Shaded fragments a covered pixel, where they were counted.
    pub shaded_per_pixel: Option<f64>,
}

impl VariantReport {
    /// A variant without measurements.
    pub fn new(name: &str, recipe: &str, contract: Contract, verdict: Verdict) -> Self {
        Self {
            name: name.to_owned(),
            recipe: recipe.to_owned(),
            contract,
            verdict,
            error: None,
            time_ms: None,
            speedup: None,
            shaded_per_pixel: None,
            cost: None,
            shadow: None,
            outputs: None,
            self_test: Vec::new(),
            junctions: Vec::new(),
            kept: Vec::new(),
            by_path: Vec::new(),
            by_view: Vec::new(),
        }
    }
}

impl Report {
    /// Whether any variant broke its contract.
    pub fn is_broken(&self) -> bool {
        self.variants
            .iter()
            .any(|v| matches!(v.verdict, Verdict::Broken { .. }))
    }

    /// Whether there are variants, and none was measured.
    pub fn is_unmeasured(&self) -> bool {
        let mut variants = self.variants.iter().skip(1).peekable();
        let is_open = |v: &VariantReport| matches!(v.verdict, Verdict::NotMeasured { .. });
        variants.peek().is_some() && variants.all(is_open)
    }

    /// Why no picture proves anything: two of the original differ. `None`: they do not.
    pub(crate) fn unrepeated(&self) -> Option<String> {
        let original = self.variants.first().filter(|v| v.name == ORIGINAL)?;
        let error = original.error.as_ref().filter(|e| !e.is_exact())?;
        let differing = match error.changed_pixels {
            0 => counted(error.changed_depth, "depth"),
            n => counted(n, "pixel"),
        };
        Some(format!(
            "the original does not repeat itself on this adapter ({differing})"
        ))
    }

    /// Takes back the verdicts of some variants.
    pub(crate) fn void(&mut self, why: &str, is_void: impl Fn(&VariantReport) -> bool) {
        for variant in self.variants.iter_mut().filter(|v| is_void(v)) {
            variant.verdict = Verdict::NotMeasured {
                why: why.to_owned(),
            };
        }
    }

    /// The JSON of record, indented, with a newline at its end.
    pub fn to_json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }
}
