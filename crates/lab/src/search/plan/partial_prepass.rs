//! Which draws are worth drawing ahead in a depth pre-pass: often a few walls hide most, and the vertices of everything
//! else are cheaper left out.
//!
//! `depth-prepass` in its biased form leaves the main pass as the author wrote it. So any part of the draws may go ahead,
//! and the picture stays the same. The nearest draw of each pixel saves the fragments that are shaded there in vain. It
//! costs its vertices and fragments in the pre-pass. The best by their ratio are timed, in sets that save more and more.

use std::collections::BTreeMap;

use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use serde::Serialize;

use super::PlanError;
use super::choose::WORTHWHILE;
use super::frame_work::{Counting, of_draw};
use super::layers::Layers;
use crate::measure::{self, Estimate, Session, TimingSettings, compare};
use preshade_draw::scene::{DrawOrder, Frame};

/// Draws that go ahead in a depth pre-pass, measured against the original.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ahead {
    /// The recipe of their materials.
    pub recipe: String,
    /// The draws, by their place in the scene.
    pub draws: Vec<usize>,
    /// Draws of the scene that could go ahead.
    pub of: usize,
    /// Time of the original over its time with these draws ahead.
    pub speedup: Estimate,
    pub changed_pixels: u64,
    pub changed_depth: u64,
}

impl Ahead {
    /// Whether it is faster beyond noise by as much as a plan has to be, and draws the same.
    pub fn pays(&self) -> bool {
        self.speedup.low > WORTHWHILE && self.is_same()
    }

    fn is_same(&self) -> bool {
        self.changed_pixels == 0 && self.changed_depth == 0
    }
}

/// The pre-pass that may be drawn in part.
pub const RECIPE: &str = "depth-prepass";

/// The parts of the possible saving that the timed sets reach.
const PARTS: [f64; 3] = [0.5, 0.8, 0.95];

/// The least part of the view's fragment operations that must be hidden for anything to be measured.
const LEAST: f64 = 0.05;

/// Times the best sets of draws ahead. `plans` have the pre-pass where a material takes it. `None`:
/// too little is shaded in vain, or only all draws together are worth it, which is the plan of
/// [`RECIPE`]. [`preshade_draw::render::SceneInputs::set_frame`] must have set the uniforms of
/// `frame`.
///
/// # Errors
/// The original cannot be drawn or timed, or the adapter is lost.
pub fn measured(
    session: &Session<'_>,
    frame: &Frame,
    (layers, plans): (&Layers, &[Plan]),
    facts: &Facts,
    timing: &TimingSettings,
) -> Result<Option<Ahead>, PlanError> {
    let scene = session.scene();
    let costs: Vec<Option<[f64; 2]>> = plans
        .iter()
        .map(|p| Counting::of(p, facts).ahead_ops())
        .collect();
    let price = |draw: usize, samples: usize| {
        let [vertex, fragment] = costs[scene.draws[draw].material]?;
        let vertices = of_draw(scene, draw)?.vertices;
        Some(vertices * vertex + samples as f64 * fragment.max(1.0))
    };
    let worth = worth(layers, price);
    let of = scene.draws.iter();
    let of = of.filter(|d| costs[d.material].is_some()).count();
    let sets = sets(&worth, layers, of);
    if sets.is_empty() {
        return Ok(None);
    }
    let mut given = session.prepare(session.originals())?;
    given.aim(frame, DrawOrder::AsGiven);
    let picture = given.render()?;
    let mut subjects = vec![given];
    let mut drawn = Vec::new();
    for set in sets {
        let draw = || -> Result<_, measure::Error> {
            let mut ahead = session.prepare(plans)?;
            ahead.aim(frame, DrawOrder::AsGiven);
            ahead.keep_ahead(&set);
            let ladder = compare(&picture, &ahead.render()?)?;
            Ok((ahead, ladder))
        };
        // A pre-pass that the driver refuses is none, and no reason to end the plan.
        if let Some((ahead, ladder)) = measure::Error::unless_lost(draw())? {
            subjects.push(ahead);
            drawn.push((set, ladder));
        }
    }
    let subjects: Vec<_> = subjects.iter().collect();
    let (_, times) = measure::time(session.gpu(), &subjects, timing, |_| {})?;
    let each = times.iter().skip(1).zip(drawn);
    let each = each.map(|(time, (draws, ladder))| Ahead {
        recipe: RECIPE.to_owned(),
        draws,
        of,
        speedup: time.speedup,
        changed_pixels: ladder.changed_pixels,
        changed_depth: ladder.changed_depth,
    });
    let by_worth = |a: &Ahead| (a.is_same(), a.speedup.median);
    Ok(each.max_by(|a, b| {
        let (a, b) = (by_worth(a), by_worth(b));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    }))
}

/// A draw, the operations that it saves by going ahead, and those that it costs.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Worth {
    draw: usize,
    saved: f64,
    price: f64,
}

/// The draws that save more than they cost, the best by their ratio first. `price` is of a draw and its samples.
fn worth(layers: &Layers, price: impl Fn(usize, usize) -> Option<f64>) -> Vec<Worth> {
    let mut samples: BTreeMap<usize, usize> = BTreeMap::new();
    let mut pixels: Vec<(u32, usize, f32)> = Vec::new();
    let each = layers.runs.iter().flatten();
    for (draw, layer) in each.zip(layers.drawn.iter().flatten()) {
        samples.insert(*draw, layer.len());
        pixels.extend(layer.iter().map(|(at, depth)| (*at, *draw, *depth)));
    }
    pixels.sort_by_key(|(at, draw, _)| (*at, *draw));
    let mut saved: BTreeMap<usize, f64> = BTreeMap::new();
    for pixel in pixels.chunk_by(|a, b| a.0 == b.0) {
        let (mut nearest, mut shaded) = (pixel[0], 0.0);
        for next in &pixel[1..] {
            if layers.is_nearer(next.2, nearest.2) {
                shaded += layers.costs[nearest.1];
                nearest = *next;
            }
        }
        *saved.entry(nearest.1).or_default() += shaded;
    }
    let each = saved.into_iter();
    let each = each.filter_map(|(draw, saved)| {
        let price = price(draw, samples[&draw])?;
        Some(Worth { draw, saved, price })
    });
    let mut all: Vec<Worth> = each.filter(|w| w.saved > w.price).collect();
    all.sort_by(|a, b| (b.saved / b.price).total_cmp(&(a.saved / a.price)));
    all
}

/// The sets to time: the best draws by their ratio, until they reach a part of the possible saving.
/// In the order of the scene.
fn sets(worth: &[Worth], layers: &Layers, of: usize) -> Vec<Vec<usize>> {
    let all: f64 = worth.iter().map(|w| w.saved).sum();
    let drawn = layers.runs.iter().flatten();
    let drawn = drawn.zip(layers.drawn.iter().flatten());
    let ops: f64 = drawn
        .map(|(draw, layer)| layers.costs[*draw] * layer.len() as f64)
        .sum();
    let mut sets: Vec<Vec<usize>> = Vec::new();
    for part in PARTS.into_iter().filter(|_| all > LEAST * ops) {
        let mut left = all * part;
        let mut set: Vec<usize> = worth
            .iter()
            .take_while(|w| {
                let is_more = left > 0.0;
                left -= w.saved;
                is_more
            })
            .map(|w| w.draw)
            .collect();
        set.sort_unstable();
        if set.len() < of && !sets.contains(&set) {
            sets.push(set);
        }
    }
    sets
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws in one run, each with its samples and depths; a fragment costs 10 operations.
    fn layers(drawn: &[&[(u32, f32)]]) -> Layers {
        Layers {
            runs: vec![(0..drawn.len()).collect()],
            drawn: vec![drawn.iter().map(|l| l.to_vec()).collect()],
            costs: vec![10.0; drawn.len()],
            ..Layers::default()
        }
    }

    #[test]
    fn the_nearest_draw_saves_what_is_shaded_before_it() {
        let floor = [(0, 0.9), (1, 0.9), (2, 0.9), (3, 0.9)];
        let hill = [(1, 0.5), (2, 0.5)];
        let wall = [(1, 0.1), (2, 0.1), (3, 0.1)];
        let behind = [(1, 0.7)];
        let layers = layers(&[&floor, &hill, &wall, &behind]);
        let worth = worth(&layers, |_, samples| Some(samples as f64));
        let wall = Worth {
            draw: 2,
            saved: 50.0,
            price: 3.0,
        };
        assert_eq!(worth, [wall]);
        assert_eq!(sets(&worth, &layers, 4), [[2]]);
        // It is a material without a pre-pass, or too expensive.
        assert_eq!(super::worth(&layers, |_, _| None), []);
        assert_eq!(super::worth(&layers, |_, _| Some(60.0)), []);
    }

    #[test]
    fn a_set_has_the_draws_that_save_most_for_their_price() {
        let sky: Vec<(u32, f32)> = (0..10).map(|at| (at, 0.9)).collect();
        let wall: Vec<(u32, f32)> = (0..8).map(|at| (at, 0.5)).collect();
        let layers = layers(&[&sky, &wall, &[(8, 0.5)], &[(9, 0.5)]]);
        let price = |draw: usize, _| Some(if draw == 3 { 9.0 } else { 1.0 });
        let worth = worth(&layers, price);
        let draws: Vec<usize> = worth.iter().map(|w| w.draw).collect();
        assert_eq!(draws, [1, 2, 3]);
        assert_eq!(sets(&worth, &layers, 4), [vec![1], vec![1, 2, 3]]);
        // All draws that could go ahead are no part of them.
        assert_eq!(sets(&worth, &layers, 3), [[1]]);
    }
}
