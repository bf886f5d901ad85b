//! Draws each opaque draw of a view alone: its depths show which fragments of other draws it hides.

use preshade_plan::pass::Facts;
use preshade_plan::plan::{Phase, Plan};
use preshade_plan::state::{ColorTarget, CompareFunction, DepthDirection};

use super::PlanError;
use super::frame_work::Counting;
use crate::measure::Session;
use preshade_draw::render::Prepared;
use preshade_draw::scene::{Frame, Scene};

/// Most draws to look at. The others stay as they are.
const MOST: usize = 256;

/// The opaque draws of a view.
#[derive(Clone, Debug, Default)]
pub struct Layers {
    /// Runs of draws that may change places, by their place in the scene.
    pub runs: Vec<Vec<usize>>,
    /// For each draw of each run, its samples and depths when drawn alone.
    pub drawn: Vec<Vec<Layer>>,
    /// Operations of a fragment of each draw of the scene.
    pub costs: Vec<f64>,
    /// Whether smaller depths are nearer, or larger ones.
    pub direction: DepthDirection,
}

impl Layers {
    /// Draws each of them. [`preshade_draw::render::SceneInputs::set_frame`] must have set the uniforms of `frame`.
    ///
    /// # Errors
    /// The original cannot be drawn, or the adapter is lost.
    pub fn draw(session: &Session<'_>, frame: &Frame, facts: &Facts) -> Result<Self, PlanError> {
        let (scene, originals) = (session.scene(), session.originals());
        let runs = runs(session, frame)?;
        let mut prepared = session.prepare(originals)?;
        let drawn = runs.iter().map(|run| layers(&mut prepared, frame, run));
        let ops: Vec<f64> = originals
            .iter()
            .map(|plan| Counting::of(plan, facts).fragment_ops().max(1.0))
            .collect();
        Ok(Self {
            drawn: drawn.collect::<Result<_, _>>()?,
            runs,
            costs: scene.draws.iter().map(|d| ops[d.material]).collect(),
            direction: scene.depth_direction,
        })
    }

    /// Whether the first of two depths is nearer.
    pub fn is_nearer(&self, a: f32, b: f32) -> bool {
        match self.direction {
            DepthDirection::Forward => a < b,
            DepthDirection::Reversed => a > b,
        }
    }
}

/// Runs of draws that may change places.
fn runs(session: &Session<'_>, frame: &Frame) -> Result<Vec<Vec<usize>>, PlanError> {
    let (scene, originals) = (session.scene(), session.originals());
    let movable: Vec<Option<Vec<u8>>> = originals.iter().map(|p| movable(p, scene)).collect();
    if movable.iter().all(Option::is_none) {
        return Ok(Vec::new());
    }
    // A draw at the depth of the cleared buffer leaves no trace there.
    let mut equal = originals.to_vec();
    for depth in equal
        .iter_mut()
        .flat_map(|p| &mut p.passes)
        .filter_map(|p| p.depth.as_mut())
    {
        depth.compare = CompareFunction::Equal;
        depth.write = false;
    }
    let mut at_clear = session.prepare(&equal)?;
    let mut runs: Vec<Vec<usize>> = vec![Vec::new()];
    let mut masks = None;
    let mut left = MOST;
    for (i, draw) in scene.draws.iter().enumerate() {
        let own = movable[draw.material].as_ref().filter(|_| left > 0);
        let is_movable = match own {
            Some(_) => {
                at_clear.arrange(frame, &[i]);
                let at_clear = at_clear.draw_occluded()?;
                at_clear.iter().all(|samples| *samples == 0)
            }
            None => false,
        };
        let own = own.filter(|_| is_movable);
        // Draws with other write masks start a new run: a hidden draw would show in the channels
        // that its mask leaves.
        if own.is_none() || own != masks {
            runs.push(Vec::new());
            masks = own;
        }
        if let (Some(_), Some(run)) = (own, runs.last_mut()) {
            run.push(i);
            left -= 1;
        }
    }
    runs.retain(|run| !run.is_empty());
    Ok(runs)
}

/// The channels that a material's draws write in each target, if the picture does not depend on their place unless
/// depths tie or other draws write other channels.
fn movable(plan: &Plan, scene: &Scene) -> Option<Vec<u8>> {
    let main = plan.main()?;
    let is_tested = main
        .depth
        .as_ref()
        .is_some_and(|d| d.write && d.compare.direction() == Some(scene.depth_direction));
    let replaces = |t: &Option<ColorTarget>| {
        let target = t.as_ref()?;
        target.blend.is_none().then_some(target.write_mask)
    };
    let masks = main.targets.iter().map(replaces).collect::<Option<_>>()?;
    let stencil = main.stencil.as_ref().is_some_and(|s| s.writes());
    let stores = main.bindings.iter().any(|b| b.kind.is_writable());
    let is_movable = is_tested && main.fragment.is_some() && !stencil && !stores;
    (is_movable && main.phase == Phase::Opaque).then_some(masks)
}

/// The samples and depths of a draw alone.
pub(crate) type Layer = Vec<(u32, f32)>;

fn layers(
    prepared: &mut Prepared<'_>,
    frame: &Frame,
    draws: &[usize],
) -> Result<Vec<Layer>, PlanError> {
    let mut depths = |draws: &[usize]| -> Result<Vec<f32>, PlanError> {
        prepared.arrange(frame, draws);
        Ok(prepared.depth()?.map_or(Vec::new(), |depth| depth.values))
    };
    let empty = depths(&[])?;
    let layer = |draw: &usize| {
        let drawn = depths(&[*draw])?;
        let samples = drawn.into_iter().zip(&empty).enumerate();
        let samples = samples.filter(|(_, (drawn, empty))| drawn != *empty);
        Ok(samples.map(|(at, (depth, _))| (at as u32, depth)).collect())
    };
    draws.iter().map(layer).collect()
}
