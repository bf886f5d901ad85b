//! Two authors' programs of one material, drawn in one scene: the differences of their depths or
//! pictures, and the time of each.

use preshade_plan::state::MaterialState;
use preshade_validate::agree::Relation;
use serde::Serialize;

use super::error::ulps;
use super::record::{Picture, Pictures};
use super::{
    Clock, Error, ErrorLadder, Estimate, FrameTime, Session, TimingSettings, compare, time,
};
use preshade_compiler::command::agree_text::Drawn;
use preshade_draw::render::{self, Gpu, Rendered};
use preshade_draw::scene::{DrawOrder, Frame, Scene};
use preshade_scenes::ShaderForm;
use preshade_scenes::{StandIn, stand_in};

/// The pictures that are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// The depths from the scene's cameras.
    Depth,
    /// The depths from the scene's light.
    ShadowMap,
    /// The colours, and the depths, from the scene's cameras.
    Color,
}

impl Look {
    /// The pictures that decide a relation.
    pub fn of(relation: Relation) -> Self {
        match relation {
            Relation::Same => Self::Color,
            Relation::Shadow => Self::ShadowMap,
            _ => Self::Depth,
        }
    }
}

/// Both programs in the first frame of a camera.
#[derive(Clone, Debug, Serialize)]
pub struct Beside {
    pub camera: String,
    /// Pixels, or samples, that either program draws.
    pub covered: u64,
    /// Of these, the first program alone draws so many.
    pub lost: u64,
    /// Of these, the second program alone draws so many.
    pub kept: u64,
    /// Of these, both draw so many at other depths.
    pub moved: u64,
    /// Their largest distance, in steps between neighbouring 32-bit floats.
    pub moved_steps: u64,
    pub error: ErrorLadder,
    /// The times, of the first camera.
    pub times: Option<Times>,
    /// The first program's picture, and the difference.
    #[serde(skip)]
    pub pictures: Option<[Picture; 2]>,
}

/// Times of the two programs.
#[derive(Clone, Debug, Serialize)]
pub struct Times {
    pub clock: Clock,
    /// Milliseconds a frame of each.
    pub ms: [FrameTime; 2],
    /// The first program's time over the second's.
    pub speedup: Estimate,
}

impl Drawn for Beside {
    fn differs(&self, relation: Relation) -> Option<String> {
        let (pixels, depths) = (self.error.changed_pixels, self.error.changed_depth);
        let apart = self.lost + self.kept;
        let (is_broken, what) = match relation {
            Relation::Same => (
                pixels > 0 || depths > 0,
                format!("{pixels} pixels and {depths} depths"),
            ),
            // A light's matrix may be rounded differently, and its depths are biased.
            Relation::Shadow => (apart > 0, format!("{apart} depths")),
            // Each of these two ignores the part that the other decides.
            Relation::Position => (self.moved > 0, format!("{} depths", self.moved)),
            Relation::Discard => (apart > 0 && self.moved == 0, format!("{apart} depths")),
            _ => (
                apart + self.moved > 0,
                format!("{} depths", apart + self.moved),
            ),
        };
        let camera = &self.camera;
        is_broken.then(|| format!("seen by `{camera}`, the two draw {what} otherwise"))
    }

    fn lines(&self, relation: Relation) -> Vec<String> {
        let [first, second] = relation.names();
        let camera = &self.camera;
        let mut lines = Vec::new();
        match Look::of(relation) {
            Look::Color => lines.push(format!(
                "seen by `{camera}`: {} of {} pixels differ, mean FLIP {:.4}, and {} depths",
                self.error.changed_pixels,
                self.error.pixels,
                self.error.flip_mean,
                self.error.changed_depth
            )),
            _ => {
                let mut line = format!(
                    "seen by `{camera}`: of {} depths, {first} alone has {}, and {second} alone has {}",
                    self.covered, self.lost, self.kept
                );
                if self.moved > 0 {
                    let (moved, steps) = (self.moved, self.moved_steps);
                    line.push_str(&format!("; {moved} differ, by up to {steps} steps"));
                }
                lines.push(line);
            }
        }
        lines.extend(self.times.as_ref().map(|times| {
            let [a, b] = &times.ms;
            let ratio = &times.speedup;
            format!(
                "time: {first} {:.3} ms, {second} {:.3} ms, {:.2}x [{:.2}, {:.2}]",
                a.estimate.median, b.estimate.median, ratio.median, ratio.low, ratio.high
            )
        }));
        lines
    }
}

/// Draws `scene`, which has one material, with its own program and with `other`.
pub fn comparison(
    gpu: &Gpu,
    scene: &Scene,
    other: StandIn<'_>,
    look: Look,
    timing: Option<&TimingSettings>,
) -> Result<Vec<Beside>, Error> {
    let lit = scene.cameras.first().and_then(|c| c.frames.first());
    let lit = lit.map(|frame| scene.seen_from_light(frame.time));
    let scene = match (look, &lit) {
        (Look::ShadowMap, Some(lit)) => lit,
        _ => scene,
    };
    let own = scene.materials.first().map(|m| m.state.clone());
    let own = own.unwrap_or_default();
    let state = match look {
        Look::Color => own,
        // Its outputs are its own.
        _ => MaterialState {
            targets: Vec::new(),
            ..own
        },
    };
    let mut all = Vec::new();
    for camera in &scene.cameras {
        let Some(frame) = camera.frames.first() else {
            continue;
        };
        let theirs = stand_in(scene, other, &state, frame).map_err(|e| render::Error::Scene {
            draw: scene.name.clone(),
            message: e.to_string(),
        })?;
        let timing = timing.filter(|_| all.is_empty());
        let mut drawn = drawn(gpu, [scene, &theirs], frame, look, timing)?;
        drawn.camera.clone_from(&camera.name);
        all.push(drawn);
    }
    Ok(all)
}

fn drawn(
    gpu: &Gpu,
    scenes: [&Scene; 2],
    frame: &Frame,
    look: Look,
    timing: Option<&TimingSettings>,
) -> Result<Beside, Error> {
    let on = |scene| Session::new(gpu, scene, ShaderForm::Text);
    let [first, second] = [on(scenes[0])?, on(scenes[1])?];
    let [mut ours, mut theirs] = [
        first.prepare(first.originals())?,
        second.prepare(second.originals())?,
    ];
    let before = first.draw(&mut ours, frame, DrawOrder::FrontToBack)?;
    let after = second.draw(&mut theirs, frame, DrawOrder::FrontToBack)?;
    let times = timing.map(|settings| -> Result<Times, Error> {
        let (clock, mut timings) = time(gpu, &[&ours, &theirs], settings, |_| {})?;
        match (timings.pop(), timings.pop()) {
            (Some(second), Some(first)) => Ok(Times {
                clock,
                speedup: second.speedup,
                ms: [first.time, second.time],
            }),
            _ => Err(Error::Clock),
        }
    });
    let clear = scenes[0].depth_direction.clear_depth();
    let depth_alone = |picture: &Rendered| Rendered {
        colors: Vec::new(),
        depth: picture.depth.clone(),
    };
    let error = match look {
        Look::Color => compare(&before, &after)?,
        _ => compare(&depth_alone(&before), &depth_alone(&after))?,
    };
    let cells: Vec<Cell> = cells(&before, &after, clear).collect();
    let count = |wanted: Cell| cells.iter().filter(|cell| **cell == wanted).count() as u64;
    let nothing = count(Cell::Nothing);
    let pictures = match look {
        Look::Color => Pictures::new("second", &before, &after).map(|p| [p.original, p.difference]),
        _ => Picture::of(&before).map(|own| {
            let samples = before.depth.as_ref().map_or(1, |d| d.samples.max(1));
            let difference = difference(&own, &cells, samples as usize);
            [own, difference]
        }),
    };
    Ok(Beside {
        camera: String::new(),
        covered: cells.len() as u64 - nothing,
        lost: count(Cell::Lost),
        kept: count(Cell::Kept),
        moved: count(Cell::Moved),
        moved_steps: moved_steps(&before, &after, &cells),
        error,
        times: times.transpose()?,
        pictures,
    })
}

/// The drawing of two programs at a sample.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Cell {
    Nothing,
    Equal,
    /// Both draw, at other depths.
    Moved,
    Kept,
    Lost,
}

fn cells(before: &Rendered, after: &Rendered, clear: f32) -> impl Iterator<Item = Cell> {
    let depths = |picture: &Rendered| {
        let depth = picture.depth.as_ref();
        depth.map(|d| d.values.clone()).unwrap_or_default()
    };
    let pairs = depths(before).into_iter().zip(depths(after));
    pairs.map(move |(a, b)| match (a == clear, b == clear) {
        (true, true) => Cell::Nothing,
        (true, false) => Cell::Kept,
        (false, true) => Cell::Lost,
        (false, false) if a.to_bits() == b.to_bits() => Cell::Equal,
        (false, false) => Cell::Moved,
    })
}

/// The largest distance of two depths that both programs draw.
fn moved_steps(before: &Rendered, after: &Rendered, cells: &[Cell]) -> u64 {
    let (Some(a), Some(b)) = (&before.depth, &after.depth) else {
        return 0;
    };
    let pairs = a.values.iter().zip(&b.values).zip(cells);
    let moved = pairs.filter(|(_, cell)| **cell == Cell::Moved);
    moved.map(|((a, b), _)| ulps(*a, *b)).max().unwrap_or(0)
}

/// Orange: a program draws, without depth.
const LOST: [u8; 3] = [244, 144, 66];
/// Blue: depth where nothing is drawn.
const KEPT: [u8; 3] = [66, 160, 255];
/// A purple tint: another depth.
const MOVED: [u8; 3] = [110, 50, 130];

/// The first program's picture in dim grey, and the differences in colour: the worst of a pixel's
/// samples.
fn difference(own: &Picture, cells: &[Cell], samples: usize) -> Picture {
    let pixels = own.rgba.as_chunks::<4>().0.iter();
    let pixels = pixels.zip(cells.chunks(samples));
    let rgba = pixels.flat_map(|([r, g, b, _], cells)| {
        let sum = u32::from(*r) * 2 + u32::from(*g) * 5 + u32::from(*b);
        let grey = (sum / 16) as u8;
        let [r, g, b] = match cells.iter().max() {
            Some(Cell::Lost) => LOST,
            Some(Cell::Kept) => KEPT,
            Some(Cell::Moved) => MOVED.map(|c| c + grey / 3),
            _ => [grey; 3],
        };
        [r, g, b, 255]
    });
    Picture {
        size: own.size,
        rgba: rgba.collect(),
    }
}
