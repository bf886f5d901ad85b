//! Predicts the error and the work of a candidate without drawing, to leave out those that cannot
//! be on the frontier.

use preshade_dataflow::graph::Graph;
use preshade_plan::budget::Metric;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use serde::Serialize;

use super::space::{Approximation, Candidate};

/// A prediction. Neither number is ever reported as measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Prediction {
    /// Error, by the metric of the search.
    pub error: f64,
    /// Static work of a frame, the original's being 1.
    pub work: f64,
}

/// Tolerance of the predicted error. Errors of several values add or hide each other, and
/// subdivision reduces them by curvature.
const ERROR_SLACK: f64 = 4.0;

/// Tolerance of the predicted work. A vertex costs less than a fragment, and static operations are
/// not time.
const WORK_SLACK: f64 = 1.5;

/// Predicts from the materials of a scene.
#[derive(Clone, Debug)]
pub(crate) struct Predictor<'f> {
    facts: &'f Facts,
    metric: Metric,
    /// Static cost of a fragment of the most expensive material.
    fragment: f64,
}

impl<'f> Predictor<'f> {
    /// A predictor for the materials as their author wrote them.
    pub fn new(plans: &[Plan], facts: &'f Facts, metric: Metric) -> Self {
        let fragment = |plan: &Plan| {
            let pass = plan.main()?;
            let fragment = pass.fragment.as_ref()?;
            let program = plan.program(pass)?;
            let (index, _) = program.entry_point(naga::ShaderStage::Fragment, fragment)?;
            Some(Graph::build(program).entry_cost(index))
        };
        Self {
            facts,
            metric,
            fragment: plans.iter().filter_map(fragment).fold(1.0, f64::max),
        }
    }

    /// The prediction for a candidate. `None`: the gain depends on the scene's overdraw.
    pub fn of(&self, candidate: &Candidate) -> Option<Prediction> {
        let Approximation { threshold, divided } = candidate.approximation?;
        let carried = || {
            let finite = self.facts.frequencies.iter().filter(|f| f.is_finite());
            finite.filter(|f| self.metric.of(f) <= threshold)
        };
        let alone = carried().map(|f| self.metric.of(f)).fold(0.0, f64::max);
        let saved = carried().map(|f| f.cost).fold(0.0, f64::max);
        let vertices = self.facts.vertices_per_fragment.unwrap_or(0.05);
        // Two triangles a vertex. Each has (n + 1)(n + 2) / 2 new vertices, or shares them.
        let (level, evaluations) = match divided {
            None => (1.0, vertices),
            Some((level, form)) => {
                let n = f64::from(level);
                let each = match form {
                    "pulled" => (n + 1.0) * (n + 2.0),
                    _ => n * n,
                };
                (
                    n,
                    if form == "static" {
                        0.0
                    } else {
                        vertices * each
                    },
                )
            }
        };
        Some(Prediction {
            // The error of linear interpolation falls with the square of the step.
            error: alone / (level * level),
            work: (self.fragment - saved + saved * evaluations).max(0.0) / self.fragment,
        })
    }
}

/// Why a candidate is not drawn, by its prediction and those of the others; `None`: it is.
pub(crate) fn hopeless(
    this: Prediction,
    others: &[Prediction],
    budget: Option<f64>,
) -> Option<String> {
    if let Some(budget) = budget
        && this.error > ERROR_SLACK * budget
    {
        return Some(format!(
            "an error of {:.4} is predicted where {budget} is allowed",
            this.error
        ));
    }
    if this.work > WORK_SLACK {
        return Some(format!(
            "{:.1} times the original's work is predicted",
            this.work
        ));
    }
    let beaten = others
        .iter()
        .any(|o| o.error * ERROR_SLACK < this.error && o.work * WORK_SLACK < this.work);
    beaten.then(|| "another is predicted to have both less error and less work by far".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(error: f64, work: f64) -> Prediction {
        Prediction { error, work }
    }

    #[test]
    fn only_what_is_far_off_is_left_out() {
        let others = [at(0.01, 0.2)];
        assert_eq!(hopeless(at(0.039, 0.5), &others, Some(0.01)), None);
        assert!(hopeless(at(0.041, 0.1), &others, Some(0.01)).is_some());
        assert_eq!(hopeless(at(0.041, 0.1), &others, None), None);
        assert!(hopeless(at(0.0, 1.6), &others, None).is_some());
        assert!(hopeless(at(0.05, 0.4), &others, None).is_some());
        assert_eq!(hopeless(at(0.05, 0.29), &others, None), None);
    }
}
