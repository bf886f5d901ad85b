//! The recipes that a search tries: ways to shade fewer fragments, and ways to compute less in
//! each. They are crossed once their gains are known.

use std::collections::BTreeSet;

use preshade_geometry::examples;
use preshade_plan::budget::Metric;
use preshade_plan::pass::{Facts, Frequency, Use};

use preshade_compiler::recipe::{Recipe, RecipeError};

/// Where new vertices are computed.
const FORMS: [&str; 3] = ["pulled", "shared", "static"];

/// Levels that triangles are divided at: each has about half of the error of the one before.
const LEVELS: [u32; 7] = [1, 2, 3, 4, 6, 8, 12];

/// Most thresholds on measured errors. Each selects another set of values to interpolate.
const MOST_THRESHOLDS: usize = 6;

/// Two errors with a smaller ratio count as equal.
const APART: f64 = 1.05;

/// A recipe and its parts.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    pub recipe: Recipe,
    /// The part that computes less in a fragment, with an error.
    pub approximation: Option<Approximation>,
    /// Whether it shades fewer fragments.
    pub covers: bool,
}

/// Values interpolated from the vertices of the author's triangles, or of smaller ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approximation {
    /// Largest measured error of an interpolated value.
    pub threshold: f64,
    /// Segments an edge, and where they are computed; `None`: the author's triangles.
    pub divided: Option<(u32, &'static str)>,
}

impl Candidate {
    /// Whether it is `other` and more: further steps, or the same values divided further.
    pub fn stands_on(&self, other: &Self) -> bool {
        let divided = |c: &Self| {
            c.approximation
                .and_then(|a| Some((a.threshold, a.divided?)))
        };
        let is_finer = match (divided(self), divided(other)) {
            (Some((t, (level, form))), Some((u, (coarse, same)))) => {
                t == u && form == same && level > coarse
            }
            _ => false,
        };
        is_finer
            || self.recipe.steps.len() > other.recipe.steps.len()
                && self.recipe.steps.starts_with(&other.recipe.steps)
    }
}

/// The recipes to begin with: each way alone.
pub(crate) fn seeds(facts: &Facts, metric: Metric) -> Vec<Candidate> {
    let mut found = Vec::new();
    let mut add = |text: String, approximation, covers| {
        if let Ok(recipe) = recipe(&text) {
            found.push(Candidate {
                recipe,
                approximation,
                covers,
            });
        }
    };
    let budget = format!("budget=1,{}", named(metric));
    let budget = budget.trim_end_matches(',');
    for (text, used) in examples() {
        match used {
            Use::Cover => add(text.to_owned(), None, true),
            Use::Simplify => add(text.replace("BUDGET", budget), None, false),
            _ => {}
        }
    }
    for threshold in thresholds(&facts.frequencies, metric) {
        let hoist = format!("hoist:budget=1,{}threshold={threshold}", named(metric));
        let of = |divided| Some(Approximation { threshold, divided });
        add(hoist.clone(), of(None), false);
        for form in FORMS {
            for level in LEVELS {
                let text = format!("{hoist},tessellate:form={form},level={level}");
                add(text, of(Some((level, form))), false);
            }
        }
    }
    found
}

/// `shading` and then `covering` in one recipe. `None`: they are not of these kinds.
pub(crate) fn cross(shading: &Candidate, covering: &Candidate) -> Option<Candidate> {
    (!shading.covers && covering.covers).then(|| Candidate {
        recipe: Recipe {
            steps: [shading.recipe.steps.clone(), covering.recipe.steps.clone()].concat(),
        },
        approximation: shading.approximation,
        covers: true,
    })
}

/// Recipes of the user's own.
pub(crate) fn given(recipes: Vec<Recipe>) -> Vec<Candidate> {
    let candidate = |recipe| Candidate {
        recipe,
        approximation: None,
        covers: false,
    };
    recipes.into_iter().map(candidate).collect()
}

fn recipe(text: &str) -> Result<Recipe, RecipeError> {
    Recipe::parse_list(text)
}

fn named(metric: Metric) -> String {
    match serde_json::to_value(metric) {
        Ok(serde_json::Value::String(name)) if metric != Metric::default() => {
            format!("metric={name},")
        }
        _ => String::new(),
    }
}

/// Thresholds between the measured errors, so that each selects more values than the one before;
/// the last selects all. They are few and evenly spread over the ranks.
fn thresholds(frequencies: &[Frequency], metric: Metric) -> Vec<f64> {
    let finite = frequencies.iter().filter(|f| f.is_finite());
    let mut errors: Vec<f64> = finite.map(|f| metric.of(f)).collect();
    errors.sort_by(f64::total_cmp);
    // Of errors that hardly differ, the largest remains: a threshold between them would separate
    // nothing.
    errors.reverse();
    errors.dedup_by(|a, b| *a * APART >= *b);
    errors.reverse();
    let last = errors.len().saturating_sub(1);
    let of = MOST_THRESHOLDS - 1;
    let ranks: BTreeSet<usize> = (0..=of).map(|i| i * last / of).collect();
    let above = |rank: usize| {
        let (this, next) = (*errors.get(rank)?, errors.get(rank + 1));
        // The fewest digits that separate the two, because users type the number again.
        let exact = next.map_or(1.0, |next| *next);
        (1..=16)
            .filter_map(|digits| format!("{this:.digits$e}").parse::<f64>().ok())
            .find(|t| *t >= this && *t < exact)
            .or(Some(this))
    };
    ranks.into_iter().filter_map(above).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn frequency(flip_mean: f64) -> Frequency {
        Frequency {
            material: "m".to_owned(),
            value: flip_mean.to_string(),
            name: String::new(),
            cost: 10.0,
            interpolation: None,
            bound: None,
            max_abs: 0.0,
            flip_mean,
            flip_p99: 0.0,
            flip_tile: 0.0,
            nan_pixels: 0,
            location: None,
        }
    }

    #[test]
    fn thresholds_part_the_values() {
        let errors: Vec<f64> = (0..40).map(|i| 0.013 * f64::from(i * i)).collect();
        let frequencies: Vec<_> = errors.iter().map(|e| frequency(*e)).collect();
        let found = thresholds(&frequencies, Metric::FlipMean);
        assert_eq!(found.len(), MOST_THRESHOLDS);
        let kept = |t: f64| errors.iter().filter(|e| **e <= t).count();
        let counts: Vec<usize> = found.iter().map(|t| kept(*t)).collect();
        assert_eq!(counts, [1, 8, 16, 24, 32, 40]);
        assert_eq!(thresholds(&[], Metric::FlipMean), [0.0; 0]);
    }

    #[test]
    fn without_a_measurement_nothing_is_approximated() {
        let seeds = seeds(&Facts::default(), Metric::FlipMean);
        assert!(seeds.iter().all(|c| c.approximation.is_none()));
        assert!(seeds.iter().any(|c| c.covers));
    }

    #[test]
    fn a_metric_is_said_where_it_is_not_the_default() {
        let facts = Facts {
            frequencies: vec![frequency(0.0)],
            ..Facts::default()
        };
        let texts = |metric| -> Vec<String> {
            let seeds = seeds(&facts, metric).into_iter();
            let approximate = seeds.filter(|c| c.approximation.is_some());
            approximate.map(|c| c.recipe.to_string()).collect()
        };
        assert!(!texts(Metric::FlipMean)[0].contains("metric"));
        assert!(texts(Metric::MaxAbs)[0].contains("metric=max_abs"));
    }

    #[test]
    fn a_finer_division_stands_on_a_coarser_one_and_both_on_their_hoist() {
        let facts = Facts {
            frequencies: vec![frequency(0.01)],
            ..Facts::default()
        };
        let seeds = seeds(&facts, Metric::FlipMean);
        let of = |divided| {
            let is = |c: &&Candidate| c.approximation.is_some_and(|a| a.divided == divided);
            seeds.iter().find(is).unwrap()
        };
        let (hoist, coarse, fine) = (of(None), of(Some((1, "static"))), of(Some((2, "static"))));
        assert!(coarse.stands_on(hoist) && fine.stands_on(hoist) && fine.stands_on(coarse));
        assert!(!coarse.stands_on(fine) && !hoist.stands_on(coarse));
        assert!(!fine.stands_on(of(Some((1, "shared")))));
    }

    #[test]
    fn what_shades_less_and_what_computes_less_are_crossed() {
        let facts = Facts {
            frequencies: vec![frequency(0.01)],
            ..Facts::default()
        };
        let seeds = seeds(&facts, Metric::FlipMean);
        let covering: Vec<_> = seeds.iter().filter(|c| c.covers).collect();
        let shading: Vec<_> = seeds.iter().filter(|c| !c.covers).collect();
        let both = cross(shading[0], covering[0]);
        let steps = both.as_ref().map(|b| b.recipe.steps.len());
        assert_eq!(steps, Some(2));
        assert_eq!(cross(covering[0], shading[0]), None);
    }
}
