//! Whether another order of the draws is faster: sorting them is cheaper to have than any pass.
//!
//! A draw goes ahead of another one if it hides more of it than the other way round, in operations of
//! their fragment stages. Blended draws and those that depend on their place, by the depth test or
//! the stencil, stay where they are, and no draw moves past them. Draws that tie in depth keep their order.

use serde::Serialize;

use super::PlanError;
use super::choose::WORTHWHILE;
use super::layers::{Layer, Layers};
use crate::measure::{self, Estimate, Session, TimingSettings, compare};
use preshade_draw::scene::{DrawOrder, Frame};

/// Another order of the draws, measured against the scene's own.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sorting {
    /// All draws in that order, by their place in the scene.
    pub draws: Vec<usize>,
    /// The draws that move, if the others stay.
    pub moved: Vec<usize>,
    /// Time of the original in the scene's order over its time in this one.
    pub speedup: Estimate,
    pub changed_pixels: u64,
    /// Pixels whose depth differs. A shadow map has nothing else.
    pub changed_depth: u64,
}

impl Sorting {
    /// Whether it draws the same picture and depths, and is faster beyond noise by as much as a plan has to be.
    pub fn pays(&self) -> bool {
        self.speedup.low > WORTHWHILE && self.changed_pixels == 0 && self.changed_depth == 0
    }
}

/// The least part of the frame's fragment operations that an order must save to be measured.
const LEAST: f64 = 0.01;

/// Measures the frame in the order in which most is hidden. `None`: no order hides more.
/// [`preshade_draw::render::SceneInputs::set_frame`] must have set the uniforms of `frame`.
///
/// # Errors
/// The original cannot be drawn or timed, or the adapter is lost.
pub fn measured(
    session: &Session<'_>,
    frame: &Frame,
    layers: &Layers,
    timing: &TimingSettings,
) -> Result<Option<Sorting>, PlanError> {
    let Some(draws) = sorted(layers) else {
        return Ok(None);
    };
    let mut given = session.prepare(session.originals())?;
    given.aim(frame, DrawOrder::AsGiven);
    let mut sorted = session.prepare(session.originals())?;
    sorted.arrange(frame, &draws);
    let ladder = compare(&given.render()?, &sorted.render()?).map_err(measure::Error::from)?;
    let (_, times) = measure::time(session.gpu(), &[&given, &sorted], timing, |_| {})?;
    Ok(times.get(1).map(|time| Sorting {
        moved: moved(&draws),
        draws,
        speedup: time.speedup,
        changed_pixels: ladder.changed_pixels,
        changed_depth: ladder.changed_depth,
    }))
}

/// The order in which most is hidden, or `None` if it is the scene's own.
fn sorted(layers: &Layers) -> Option<Vec<usize>> {
    let mut order: Vec<usize> = (0..layers.costs.len()).collect();
    let (mut saved, mut all) = (0.0, 0.0);
    for (run, drawn) in layers.runs.iter().zip(&layers.drawn) {
        let cost_of = |i: usize| layers.costs[run[i]];
        let hidden = Hidden::of(drawn, cost_of, |a, b| layers.is_nearer(a, b));
        let own: Vec<usize> = (0..run.len()).collect();
        let best = hidden.best(&own);
        saved += hidden.lost(&own) - hidden.lost(&best);
        all += hidden.all;
        for (place, draw) in run.iter().zip(&best) {
            order[*place] = run[*draw];
        }
    }
    (saved > LEAST * all).then_some(order)
}

/// The fragments that some draws hide of each other.
struct Hidden {
    count: usize,
    /// Operations of the fragments of draw `b` that lie behind draw `a`, at `a * count + b`.
    behind: Vec<f64>,
    /// Whether two draws have the same depth somewhere, at the same place.
    tied: Vec<bool>,
    all: f64,
}

impl Hidden {
    fn of(
        layers: &[Layer],
        cost_of: impl Fn(usize) -> f64,
        is_nearer: impl Fn(f32, f32) -> bool,
    ) -> Self {
        let count = layers.len();
        let mut pixels: Vec<(u32, usize, f32)> = Vec::new();
        for (draw, layer) in layers.iter().enumerate() {
            pixels.extend(layer.iter().map(|(at, depth)| (*at, draw, *depth)));
        }
        pixels.sort_by_key(|(at, draw, _)| (*at, *draw));
        let mut behind = vec![0.0; count * count];
        let mut tied = vec![false; count * count];
        for pixel in pixels.chunk_by(|a, b| a.0 == b.0) {
            for (_, a, near) in pixel {
                for (_, b, far) in pixel {
                    if is_nearer(*near, *far) {
                        behind[a * count + b] += cost_of(*b);
                    }
                    tied[a * count + b] |= a != b && near == far;
                }
            }
        }
        Self {
            count,
            behind,
            tied,
            all: pixels.iter().map(|(_, draw, _)| cost_of(*draw)).sum(),
        }
    }

    /// The saving of `a` ahead of `b`, less that of `b` ahead of `a`.
    fn gain(&self, a: usize, b: usize) -> f64 {
        self.behind[a * self.count + b] - self.behind[b * self.count + a]
    }

    /// Operations of fragments that are drawn and hidden later, once for each draw that hides them.
    fn lost(&self, order: &[usize]) -> f64 {
        let pairs = order.iter().enumerate();
        pairs
            .flat_map(|(i, first)| order[i + 1..].iter().map(move |then| (first, then)))
            .map(|(first, then)| self.behind[then * self.count + first])
            .sum()
    }

    /// The better of the given order and the order by the balance of hidden fragments, each
    /// improved by swaps of neighbours. A swap happens only for a gain, so this ends.
    fn best(&self, given: &[usize]) -> Vec<usize> {
        let orders = [given.to_vec(), self.by_balance(given)].map(|mut order| {
            let mut is_changed = true;
            while is_changed {
                is_changed = false;
                for i in 1..order.len() {
                    let [before, then] = [order[i - 1], order[i]];
                    if !self.are_tied(before, then) && self.gain(then, before) > 0.0 {
                        order.swap(i - 1, i);
                        is_changed = true;
                    }
                }
            }
            order
        });
        let [given, by_balance] = orders;
        match self.lost(&by_balance) < self.lost(&given) {
            true => by_balance,
            false => given,
        }
    }

    /// The draws that hide most first, as far as those that tie allow.
    fn by_balance(&self, given: &[usize]) -> Vec<usize> {
        let balance = |a: usize| given.iter().map(|b| self.gain(a, *b)).sum::<f64>();
        let balances: Vec<f64> = (0..self.count).map(balance).collect();
        let mut left = given.to_vec();
        let mut order = Vec::new();
        while !left.is_empty() {
            let is_free = |i: &usize| !left[..*i].iter().any(|b| self.are_tied(*b, left[*i]));
            let free = (0..left.len()).filter(is_free);
            // Of equal draws, the first.
            let next = free
                .rev()
                .max_by(|a, b| balances[left[*a]].total_cmp(&balances[left[*b]]));
            order.push(left.remove(next.unwrap_or(0)));
        }
        order
    }

    fn are_tied(&self, a: usize, b: usize) -> bool {
        self.tied[a * self.count + b]
    }
}

/// The fewest draws that move: all but a longest sequence that stays in order.
fn moved(order: &[usize]) -> Vec<usize> {
    // The longest sequence that ends at each place, and the place before in it.
    let mut ends: Vec<(usize, Option<usize>)> = Vec::new();
    for (i, draw) in order.iter().enumerate() {
        let before = (0..i)
            .filter(|j| order[*j] < *draw)
            .max_by_key(|j| ends[*j].0);
        ends.push((before.map_or(0, |j| ends[j].0) + 1, before));
    }
    let mut at = (0..order.len()).max_by_key(|i| ends[*i].0);
    let mut stays = vec![false; order.len()];
    while let Some(i) = at {
        stays[i] = true;
        at = ends[i].1;
    }
    let moved = order.iter().zip(stays).filter(|(_, stays)| !stays);
    moved.map(|(draw, _)| *draw).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hidden(layers: &[&[(u32, f32)]]) -> Hidden {
        let layers: Vec<Layer> = layers.iter().map(|l| l.to_vec()).collect();
        Hidden::of(&layers, |_| 1.0, |a, b| a < b)
    }

    /// A shadow map has no colour that could differ.
    #[test]
    fn an_order_that_changes_depths_does_not_pay() {
        let sorting = |changed_depth| Sorting {
            draws: vec![1, 0],
            moved: vec![0],
            speedup: Estimate {
                median: 1.2,
                low: 1.1,
                high: 1.3,
            },
            changed_pixels: 0,
            changed_depth,
        };
        assert!(sorting(0).pays() && !sorting(1).pays());
    }

    #[test]
    fn what_hides_goes_first() {
        // The wall hides both others, and the box hides the floor in one pixel.
        let floor = [(0, 0.9), (1, 0.9), (2, 0.9)];
        let a_box = [(1, 0.5), (2, 0.5)];
        let wall = [(1, 0.1), (2, 0.1), (3, 0.1)];
        let hidden = hidden(&[&floor, &a_box, &wall]);
        assert_eq!(hidden.best(&[0, 1, 2]), [2, 1, 0]);
        assert_eq!(hidden.lost(&[0, 1, 2]), 6.0);
        assert_eq!(hidden.lost(&[2, 1, 0]), 0.0);
        assert_eq!(hidden.all, 8.0);
    }

    #[test]
    fn draws_that_hide_each_other_go_by_the_balance() {
        let a = [(0, 0.1), (1, 0.1), (2, 0.9)];
        let b = [(0, 0.5), (1, 0.5), (2, 0.5)];
        assert_eq!(hidden(&[&a, &b]).best(&[0, 1]), [0, 1]);
        assert_eq!(hidden(&[&b, &a]).best(&[0, 1]), [1, 0]);
    }

    #[test]
    fn draws_that_tie_keep_their_order() {
        let floor = [(0, 0.9), (1, 0.9), (2, 0.9)];
        let decal = [(1, 0.9), (2, 0.5)];
        let wall = [(1, 0.1), (2, 0.1), (3, 0.1)];
        assert_eq!(hidden(&[&floor, &decal, &wall]).best(&[0, 1, 2]), [2, 0, 1]);
    }

    #[test]
    fn what_need_not_move_stays() {
        let apart = [[(0, 0.5)], [(1, 0.5)], [(2, 0.5)]];
        let apart = apart.each_ref().map(|l| l.as_slice());
        assert_eq!(hidden(&apart).best(&[0, 1, 2]), [0, 1, 2]);
        assert_eq!(moved(&[0, 1, 2]), [0; 0]);
        assert_eq!(moved(&[3, 0, 1, 2]), [3]);
        assert_eq!(moved(&[2, 1, 0]).len(), 2);
    }
}
