//! Whole frames: one candidate for each material. Predictions are about frames, because materials
//! hide each other.

use std::collections::BTreeMap;

use preshade_passes::analysis::neighbours;
use preshade_plan::contract::Contract;
use preshade_plan::frame::FramePlan;
use preshade_plan::plan::Plan;

use super::choices::{Candidate, Choices};
use super::frame_work::{self, Counted, DrawCounts};
use super::model::Model;
use super::terms::Work;

/// A candidate for each material: indices into [`Choices::candidates`], 0 being the original.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Assignment(pub Vec<usize>);

impl Assignment {
    /// Every material as written.
    pub fn original(choices: &[Choices]) -> Self {
        Self(vec![0; choices.len()])
    }

    /// Whether every material is as written.
    pub fn is_original(&self) -> bool {
        self.0.iter().all(|pick| *pick == 0)
    }

    fn candidates<'c>(&self, choices: &'c [Choices]) -> Vec<&'c Candidate> {
        let each = choices.iter().zip(&self.0);
        each.filter_map(|(c, pick)| c.candidates.get(*pick))
            .collect()
    }

    /// The plans of the frame, in the scene's order.
    pub fn plans(&self, choices: &[Choices]) -> Vec<Plan> {
        let each = self.candidates(choices).into_iter();
        each.map(|c| c.plan.clone()).collect()
    }

    /// The recipe of each material that has one.
    pub fn recipes(&self, choices: &[Choices]) -> BTreeMap<String, String> {
        let each = choices.iter().zip(self.candidates(choices));
        each.filter(|(_, c)| !c.recipe.steps.is_empty())
            .map(|(of, c)| (of.material.clone(), c.recipe.to_string()))
            .collect()
    }

    /// In words: the recipe, and where not all materials that could have it do, which do.
    pub fn name(&self, choices: &[Choices]) -> String {
        let recipes = self.recipes(choices);
        let mut by_recipe: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for (material, recipe) in &recipes {
            by_recipe.entry(recipe).or_default().push(material);
        }
        let parts: Vec<String> = by_recipe
            .iter()
            .map(|(recipe, materials)| {
                let takers = choices.iter().filter(|c| c.position(recipe).is_some());
                match by_recipe.len() == 1 && takers.count() == materials.len() {
                    true => (*recipe).to_owned(),
                    false => format!("{recipe} ({})", materials.join(", ")),
                }
            })
            .collect();
        match parts[..] {
            [] => crate::measure::record::ORIGINAL.to_owned(),
            _ => parts.join("; "),
        }
    }

    /// The same frame, with materials as written that conflict with the others. The notes give the
    /// reasons.
    pub fn mended(mut self, choices: &[Choices]) -> (Self, Vec<String>) {
        let mut notes = Vec::new();
        // Conflicts with the others' originals were checked when it became a candidate, but for ties.
        let has_ties = choices.iter().any(|c| c.depth_ties.is_some_and(|n| n > 0));
        let checked = usize::from(!has_ties);
        while self.0.iter().filter(|pick| **pick > 0).count() > checked {
            let candidates = self.candidates(choices);
            let plans: Vec<&Plan> = candidates.iter().map(|c| &c.plan).collect();
            let refused = plans.iter().enumerate().find_map(|(i, plan)| {
                let all = || plans.iter().copied();
                let tied = || neighbours::tied(plan, all(), choices[i].depth_ties);
                let refusal = neighbours::conflict(plan, all()).or_else(tied)?;
                Some((i, refusal.to_string()))
            });
            let (material, why) = match (refused, FramePlan::merge(plans.iter().copied())) {
                (Some(refused), _) => refused,
                (None, Ok(_)) => break,
                (None, Err(error)) => {
                    // Drop the last one that is not as written. The earlier ones remain.
                    match self.0.iter().rposition(|pick| *pick > 0) {
                        Some(last) => (last, error.to_string()),
                        None => break,
                    }
                }
            };
            notes.push(format!("{}: {why}", choices[material].material));
            self.0[material] = 0;
        }
        (self, notes)
    }

    /// The work of the frame in a view. `None`: its plans do not fit together.
    pub fn work(
        &self,
        choices: &[Choices],
        drawn: &[DrawCounts],
        counted: &Counted,
    ) -> Option<Work> {
        let candidates = self.candidates(choices);
        let plans: Vec<&Plan> = candidates.iter().map(|c| &c.plan).collect();
        let counting: Vec<_> = candidates.iter().map(|c| &c.counting).collect();
        frame_work::frame(&plans, &counting, drawn, counted).ok()
    }
}

/// A frame that is weighed.
#[derive(Clone, Debug, PartialEq)]
pub struct Considered {
    /// The candidate of each material.
    pub assignment: Assignment,
    /// By view.
    pub work: Vec<Work>,
    /// In milliseconds, by view.
    pub predicted: Vec<f64>,
    /// Materials that stay as written to make the plans fit.
    pub notes: Vec<String>,
}

/// Predicts frames from the counts in the views of a scene.
#[derive(Clone, Copy)]
pub struct FramePredictor<'a> {
    /// The candidates of each material.
    pub choices: &'a [Choices],
    /// The draws of each material.
    pub drawn: &'a [DrawCounts],
    /// By view.
    pub counted: &'a [Counted],
    pub model: &'a Model,
    pub taken: Taken,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Taken {
    /// Those that keep the picture but for rounding.
    Keeping,
    /// Also those that change it within a budget.
    #[default]
    All,
}

impl Taken {
    /// Whether a candidate may be in a frame.
    pub fn has(self, candidate: &Candidate) -> bool {
        self == Self::All || !matches!(candidate.plan.contract, Contract::Approximate { .. })
    }
}

impl FramePredictor<'_> {
    /// Predicts a frame, after conflicting materials were reset to their originals.
    pub fn consider(&self, assignment: Assignment) -> Option<Considered> {
        let (assignment, notes) = assignment.mended(self.choices);
        let considered = self.predict(assignment)?;
        Some(Considered {
            notes,
            ..considered
        })
    }

    /// Weighs a frame as it is.
    pub fn predict(&self, assignment: Assignment) -> Option<Considered> {
        let work: Option<Vec<Work>> = self
            .counted
            .iter()
            .map(|c| assignment.work(self.choices, self.drawn, c))
            .collect();
        let work = work?;
        Some(Considered {
            predicted: work.iter().map(|w| self.model.predict(w)).collect(),
            assignment,
            work,
            notes: Vec::new(),
        })
    }

    /// The frames to predict: the original; each recipe on all materials that accept it; and for
    /// each view the combination of each material's best candidate.
    pub fn frames(&self) -> Vec<Considered> {
        let mut wanted = vec![Assignment::original(self.choices)];
        let mut recipes: Vec<String> = Vec::new();
        let candidates = self.choices.iter().flat_map(|c| &c.candidates);
        for candidate in candidates.filter(|c| self.taken.has(c)) {
            let recipe = candidate.recipe.to_string();
            if !candidate.recipe.steps.is_empty() && !recipes.contains(&recipe) {
                recipes.push(recipe);
            }
        }
        wanted.extend(recipes.iter().map(|recipe| {
            let of = |c: &Choices| c.position(recipe).unwrap_or(0);
            Assignment(self.choices.iter().map(of).collect())
        }));
        wanted.extend((0..self.counted.len()).map(|view| self.mix(view)));
        let mut all: Vec<Considered> = Vec::new();
        for assignment in wanted {
            let Some(considered) = self.consider(assignment) else {
                continue;
            };
            if !all.iter().any(|c| c.assignment == considered.assignment) {
                all.push(considered);
            }
        }
        all
    }

    /// The best predicted candidate of each material, with the others as written.
    fn mix(&self, view: usize) -> Assignment {
        let mut mix = Assignment::original(self.choices);
        let Some(counted) = self.counted.get(view) else {
            return mix;
        };
        for (material, choices) in self.choices.iter().enumerate() {
            let time = |pick: &usize| {
                let mut alone = Assignment::original(self.choices);
                alone.0[material] = *pick;
                let work = alone.work(self.choices, self.drawn, counted);
                work.map_or(f64::INFINITY, |w| self.model.predict(&w))
            };
            let picks = self.picks(choices).map(|pick| (pick, time(&pick)));
            let best = picks.min_by(|a, b| a.1.total_cmp(&b.1));
            mix.0[material] = best.map_or(0, |(pick, _)| pick);
        }
        mix
    }

    fn picks<'c>(&self, choices: &'c Choices) -> impl Iterator<Item = usize> + use<'c> {
        let taken = self.taken;
        let candidates = choices.candidates.iter().enumerate();
        candidates
            .filter(move |(_, c)| taken.has(c))
            .map(|(pick, _)| pick)
    }

    /// Frames that differ from one in a single material, the most promising first.
    /// [`Self::consider`] checks whether they fit together.
    pub fn neighbours(&self, from: &Assignment) -> Vec<Considered> {
        let mut all = Vec::new();
        for (material, choices) in self.choices.iter().enumerate() {
            for pick in self.picks(choices) {
                if from.0.get(material) == Some(&pick) {
                    continue;
                }
                let mut changed = from.clone();
                changed.0[material] = pick;
                all.extend(self.predict(changed));
            }
        }
        let time = |c: &Considered| c.predicted.iter().sum::<f64>();
        all.sort_by(|a, b| time(a).total_cmp(&time(b)));
        all
    }
}

/// Indices of the frames to measure, from their predicted times by view: the original, which is the
/// first, and `runners` others. Views vote for their fastest frames.
///
/// A frame that may be the fastest of a view if predictions are off by `error` is measured too, until
/// there are twice as many.
pub(crate) fn finalists(predicted: &[&[f64]], runners: usize, error: f64) -> Vec<usize> {
    let views = predicted.first().map_or(0, |p| p.len());
    let mut votes: BTreeMap<usize, f64> = BTreeMap::new();
    let mut close: BTreeMap<usize, f64> = BTreeMap::new();
    for view in 0..views {
        let time = |i: usize| predicted[i].get(view).copied().unwrap_or(f64::INFINITY);
        let mut order: Vec<usize> = (1..predicted.len()).collect();
        order.sort_by(|a, b| time(*a).total_cmp(&time(*b)));
        for frame in &order {
            let over_best = time(*frame) / time(order[0]);
            if over_best * (1.0 - error) < 1.0 + error {
                let least = close.entry(*frame).or_insert(over_best);
                *least = least.min(over_best);
            }
        }
        for (place, frame) in order.into_iter().take(runners).enumerate() {
            *votes.entry(frame).or_default() += 1.0 / (place + 1) as f64;
        }
    }
    let mut voted: Vec<(usize, f64)> = votes.into_iter().collect();
    voted.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    voted.truncate(runners);
    let mut chosen: Vec<usize> = std::iter::once(0)
        .chain(voted.into_iter().map(|(frame, _)| frame))
        .collect();
    let mut close: Vec<(usize, f64)> = close.into_iter().collect();
    close.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    for (frame, _) in close {
        if chosen.len() <= 2 * runners && !chosen.contains(&frame) {
            chosen.push(frame);
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::finalists;

    #[test]
    fn the_original_and_the_most_promising() {
        let predicted: [&[f64]; 5] = [
            &[1.0, 1.0],
            &[0.5, 2.0],
            &[0.7, 0.6],
            &[3.0, 0.5],
            &[4.0, 4.0],
        ];
        assert_eq!(finalists(&predicted, 3, 0.0), [0, 1, 3, 2]);
        assert_eq!(finalists(&predicted, 9, 0.0), [0, 1, 3, 2, 4]);
        assert_eq!(finalists(&predicted[..1], 3, 0.0), [0]);
    }

    #[test]
    fn those_that_predictions_cannot_tell_from_the_best() {
        let predicted: [&[f64]; 5] = [&[9.0], &[1.0], &[1.1], &[1.2], &[1.9]];
        assert_eq!(finalists(&predicted, 1, 0.04), [0, 1]);
        assert_eq!(finalists(&predicted, 1, 0.06), [0, 1, 2]);
        assert_eq!(
            finalists(&predicted, 1, 0.5),
            [0, 1, 2],
            "at most twice as many"
        );
        assert_eq!(finalists(&predicted, 3, 0.5), [0, 1, 2, 3, 4]);
    }
}
