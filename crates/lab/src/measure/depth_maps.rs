//! Compares depths of passes outside of the frame with those of the authors' whole programs.

use preshade_plan::contract::Verdict;
use preshade_plan::plan::{Attachment, GpuPass, Phase, Plan, SCENE_DEPTH};
use preshade_plan::state::Multisample;
use serde::{Deserialize, Serialize};

use super::error::counted;
use super::{Error, compare};
use preshade_draw::render::Rendered;

/// The depths of such passes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DepthReport {
    /// Materials with such a pass. No other material is drawn.
    pub materials: Vec<String>,
    /// Parts of the author's decisions about coverage that the passes leave out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
    /// Pixels with anything in them, over all cameras.
    pub covered: u64,
    /// Pixels whose depth bits differ from those of the whole programs, over all cameras.
    pub changed_depth: u64,
    /// Largest distance of two depths, in steps between neighbouring 32-bit floats.
    pub depth_max_ulp: u64,
    /// Camera, column and row of the first depth that differs.
    pub first_difference: Option<(String, [u32; 2])>,
}

/// The words of a verdict on passes of one kind.
pub(super) struct Words {
    /// The pass, in a sentence about its parts that are left out.
    pub pass: &'static str,
    /// The pass, in a sentence about exactness.
    pub exact: &'static str,
    /// Why nothing was compared.
    pub unseen: &'static str,
    /// Begins the place of a difference.
    pub at: &'static str,
}

impl DepthReport {
    /// Adds the pictures of the whole programs and of the passes from a camera. `is_covered` is about depths.
    pub(super) fn add(
        &mut self,
        camera: &str,
        [reference, drawn]: [&Rendered; 2],
        is_covered: impl Fn(f32) -> bool,
    ) -> Result<(), Error> {
        let depth = |picture: &Rendered| Rendered {
            colors: Vec::new(),
            depth: picture.depth.clone(),
        };
        let error = compare(&depth(reference), &depth(drawn))?;
        let depths = reference.depth.iter().flat_map(|d| &d.values);
        self.covered += depths.filter(|d| is_covered(**d)).count() as u64;
        self.changed_depth += error.changed_depth;
        self.depth_max_ulp = self.depth_max_ulp.max(error.depth_max_ulp);
        if let (None, Some(at)) = (&self.first_difference, error.first_difference) {
            self.first_difference = Some((camera.to_owned(), at));
        }
        Ok(())
    }

    /// Whether the depths are equal. `invariant`: every material drawn marks its position `@invariant`. Without
    /// it, two programs may round positions differently.
    pub(super) fn verdict(&self, invariant: bool, words: &Words) -> Verdict {
        let Words {
            pass,
            exact,
            unseen,
            at,
        } = words;
        let not_measured = |why: String| Verdict::NotMeasured { why };
        if !self.left_out.is_empty() {
            return not_measured(format!(
                "its {pass} leaves out what decides coverage in the original: {}",
                self.left_out.join("; ")
            ));
        }
        let Some((camera, [x, y])) = &self.first_difference else {
            return match self.covered {
                0 => not_measured((*unseen).to_owned()),
                _ => Verdict::Holds,
            };
        };
        let r#where = format!(
            "{at} camera `{camera}`: {} differ by up to {}, the first at {x}, {y}",
            counted(self.changed_depth, "depth"),
            counted(self.depth_max_ulp, "step")
        );
        match invariant {
            true => Verdict::Broken { r#where },
            false => not_measured(format!(
                "its {exact} is exact against an original whose position is @invariant, and this \
                 one's is not (--invariant marks it): {where}"
            )),
        }
    }
}

/// The map as the frame's only depth: the renderer reads that one back.
fn map_of(plan: &Plan, pass: &GpuPass) -> Vec<Attachment> {
    let map = pass
        .depth
        .as_ref()
        .and_then(|d| plan.attachment(&d.attachment));
    let rename = |map: &Attachment| Attachment {
        name: SCENE_DEPTH.to_owned(),
        ..map.clone()
    };
    map.map(rename).into_iter().collect()
}

fn into_map(mut pass: GpuPass) -> GpuPass {
    pass.phase = Phase::Depth;
    // Its pictures are the frame's own colours.
    for target in pass.targets.iter_mut().flatten() {
        target.attachment = None;
    }
    if let Some(depth) = &mut pass.depth {
        depth.attachment = SCENE_DEPTH.to_owned();
    }
    pass
}

/// A pass outside of the frame by itself: its depth and its pictures are those of the frame.
pub(super) fn alone(plan: &Plan, pass: &GpuPass) -> Plan {
    let mut alone = plan.clone();
    alone.attachments = map_of(plan, pass);
    alone.programs.retain(|key, _| *key == pass.program);
    alone.passes = vec![into_map(pass.clone())];
    alone.self_test = None;
    alone
}

/// The author's program as a host without preshade draws it into the map: with the pass's depth
/// state and without colours.
pub(super) fn whole_program(mut original: Plan, plan: &Plan, shadow: &GpuPass) -> Plan {
    original.attachments = map_of(plan, shadow);
    for pass in &mut original.passes {
        pass.depth.clone_from(&shadow.depth);
        pass.stencil = None;
        pass.multisample = Multisample::default();
        for target in pass.targets.iter_mut().flatten() {
            target.write_mask = 0;
        }
        *pass = into_map(pass.clone());
    }
    original
}
