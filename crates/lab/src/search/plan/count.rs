//! Counts the fragments of each material in a view by drawing: each fragment adds 1 to its
//! material's channel of a float target.

use preshade_passes::rebuild::count;
use preshade_plan::plan::{GpuPass, Phase, Plan};
use preshade_plan::reflect;
use preshade_plan::state::{Blend, ColorTarget, CompareFunction};

use super::PlanError;
use super::frame_work::{Counted, Fragments};
use preshade_draw::render::{FrameSettings, Gpu, Prepared, SceneInputs};
use preshade_draw::scene::{DrawOrder, Frame};
use preshade_scenes::ShaderForm;

/// Materials counted in one frame, one a channel. Alpha is used by alpha to coverage.
const CHANNELS: usize = 3;

/// 16-bit floats blend everywhere, resolve, and count to 2048 without a loss.
const FORMAT: &str = "rgba16float";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Which {
    Rasterised,
    Drawn,
    Visible,
}

/// Counts the fragments of each material of a scene.
pub struct FragmentCounter<'a> {
    size: [u32; 2],
    materials: usize,
    /// The index of each group's first material, and its frame.
    groups: Vec<(usize, Which, Prepared<'a>)>,
    /// Counts that do not depend on the order of draws, of the frame last counted.
    last: Option<(Frame, Vec<Fragments>)>,
}

impl<'a> FragmentCounter<'a> {
    /// Prepares counting. `plans` are the original ones, in the scene's order.
    pub fn new(inputs: &'a SceneInputs<'a>, plans: &[Plan]) -> Result<Self, PlanError> {
        let mut groups = Vec::new();
        for first in (0..plans.len()).step_by(CHANNELS) {
            let channels = |material: usize| {
                let of = material.checked_sub(first).filter(|c| *c < CHANNELS);
                of.map_or(0, |channel| 1 << channel)
            };
            for which in [Which::Rasterised, Which::Drawn, Which::Visible] {
                let counting = plans
                    .iter()
                    .enumerate()
                    .filter(|(m, _)| which != Which::Rasterised || channels(*m) != 0)
                    .map(|(m, plan)| counting_plan(plan, which, channels(m)))
                    .collect::<Result<Vec<_>, _>>()?;
                let variant = preshade_scenes::variant(&counting, ShaderForm::Ir)?;
                let clear = FrameSettings {
                    clear_color: [0.0; 4],
                    initial_colors: false,
                };
                groups.push((first, which, Prepared::new(inputs, &variant, &clear)?));
            }
        }
        Ok(Self {
            size: inputs.scene().size,
            materials: plans.len(),
            groups,
            last: None,
        })
    }

    /// Counts in one frame. [`SceneInputs::set_frame`] must have set the uniforms of the same
    /// frame.
    pub fn count(&mut self, frame: &Frame, order: DrawOrder) -> Result<Counted, PlanError> {
        let known = self.last.take().filter(|(f, _)| f == frame);
        let is_known = known.is_some();
        let mut materials = known.map_or_else(
            || vec![Fragments::default(); self.materials],
            |(_, counts)| counts,
        );
        for (first, which, prepared) in &mut self.groups {
            if is_known && *which != Which::Drawn {
                continue;
            }
            prepared.aim(frame, order);
            let sums = sums(prepared)?;
            for (of, sum) in materials.iter_mut().skip(*first).zip(sums) {
                match which {
                    Which::Rasterised => of.rasterised = sum,
                    Which::Drawn => of.drawn = sum,
                    Which::Visible => of.visible = sum,
                }
            }
        }
        self.last = Some((*frame, materials.clone()));
        Ok(Counted {
            size: self.size,
            materials,
        })
    }
}

/// The sum of each channel over all pixels.
fn sums(prepared: &Prepared<'_>) -> Result<[f64; CHANNELS], PlanError> {
    let picture = prepared.render()?;
    let mut sums = [0.0; CHANNELS];
    let Some(Some(image)) = picture.colors.first() else {
        return Ok(sums);
    };
    for pixel in 0..(image.size[0] as usize * image.size[1] as usize) {
        for (sum, value) in sums.iter_mut().zip(image.rgba(pixel)) {
            *sum += f64::from(value);
        }
    }
    Ok(sums)
}

/// The original plan drawing 1s instead of colours, to the channels of that mask.
fn counting_plan(plan: &Plan, which: Which, channels: u8) -> Result<Plan, PlanError> {
    let mut out = plan.clone();
    out.passes.clear();
    for pass in &plan.passes {
        // Blended draws hide nothing and do not compete with opaque ones.
        if pass.phase == Phase::Blended && which != Which::Rasterised {
            continue;
        }
        // Depth alone hides, and is not shaded.
        if pass.fragment.is_none() {
            let drawn = which != Which::Rasterised;
            out.passes.extend(drawn.then(|| pass.clone()));
            continue;
        }
        let program = count::program(plan, pass).map_err(|e| PlanError::Counting {
            material: plan.material.clone(),
            message: e.message.clone(),
        })?;
        let mut counted = pass.clone();
        counted.phase = Phase::Opaque;
        counted.program = "count".to_owned();
        counted.fragment = Some(count::ENTRY.to_owned());
        counted.targets = vec![Some(ColorTarget {
            blend: Some(Blend::ADD),
            write_mask: channels,
            ..ColorTarget::opaque(FORMAT)
        })];
        reflect::fill(&mut counted, &program);
        out.programs.insert("count".to_owned(), program);
        let test = |pass: &mut GpuPass, compare: CompareFunction| {
            if let Some(depth) = &mut pass.depth {
                depth.compare = compare;
                depth.write = false;
            }
        };
        let mut silent = counted.clone();
        for target in silent.targets.iter_mut().flatten() {
            target.write_mask = 0;
        }
        match which {
            Which::Rasterised => {
                test(&mut counted, CompareFunction::Always);
                counted.stencil = None;
                out.passes.push(counted);
            }
            Which::Drawn => out.passes.push(counted),
            Which::Visible => {
                silent.phase = Phase::Depth;
                if pass.depth.as_ref().is_some_and(|d| d.write) {
                    test(&mut counted, CompareFunction::Equal);
                }
                out.passes.extend([silent, counted]);
            }
        }
    }
    Ok(out)
}

/// Whether an adapter draws on the CPU: sizes and times are then small.
pub(crate) fn is_software(gpu: &Gpu) -> bool {
    gpu.adapter().kind == "software"
}
