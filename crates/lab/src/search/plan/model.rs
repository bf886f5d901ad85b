//! The cost model: milliseconds a frame as a sum over its work. Each [`Term`] has an amount, and a
//! coefficient that the adapter takes for one.
//!
//! The coefficients are fitted to measured frames by least squares of the relative error, so that
//! short frames count as much as long ones. No coefficient is below 0: no work saves time. There is
//! no other regularisation. Terms that the frames cannot separate may share their coefficients,
//! which does not change predictions for similar frames.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::terms::{Term, Work};

/// Version of the JSON of a [`Model`].
pub(crate) const SCHEMA: &str = "preshade.model.v1";

/// A frame that was measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Observation {
    pub work: Work,
    /// Milliseconds it took, above 0.
    pub ms: f64,
}

/// Where the coefficients come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum ModelOrigin {
    /// Fitted to frames that an adapter drew.
    Fitted {
        adapter: String,
        frames: usize,
        /// Median of the relative errors at these frames.
        median_error: f64,
        worst_error: f64,
    },
    /// For no adapter: the static cost model. It ranks candidates if nothing may be timed, but
    /// predicts no times.
    Nominal,
}

/// The cost of frames on an adapter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Model {
    pub schema: String,
    /// Where the coefficients come from.
    pub origin: ModelOrigin,
    /// Nanoseconds for one unit of each term. Missing terms are 0.
    pub nanoseconds: BTreeMap<Term, f64>,
}

/// A model that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The text is no JSON of a model.
    #[error("this is no cost model: {0}")]
    Json(#[from] serde_json::Error),
    /// The model is of another version.
    #[error("the cost model is of version `{0}`, and this preshade reads `{SCHEMA}`")]
    Version(String),
    /// A coefficient is negative or no number.
    #[error("the cost model's coefficient of `{0}` is not a number of at least 0")]
    Coefficient(&'static str),
}

impl Model {
    /// Fits the coefficients to `frames`.
    pub fn fit(adapter: &str, frames: &[Observation]) -> Self {
        let rows: Vec<Vec<f64>> = frames
            .iter()
            .map(|f| f.work.amounts().iter().map(|a| a / f.ms).collect())
            .collect();
        let solution = non_negative(&rows, Term::ALL.len());
        let mut model = Self {
            schema: SCHEMA.to_owned(),
            origin: ModelOrigin::Nominal,
            nanoseconds: Term::ALL
                .into_iter()
                .zip(solution)
                .filter(|(_, c)| *c > 0.0)
                .map(|(term, ms)| (term, significant(ms * 1e6)))
                .collect(),
        };
        let mut errors = model.errors(frames);
        errors.sort_by(f64::total_cmp);
        model.origin = ModelOrigin::Fitted {
            adapter: adapter.to_owned(),
            frames: frames.len(),
            median_error: significant(errors.get(errors.len() / 2).copied().unwrap_or_default()),
            worst_error: significant(errors.last().copied().unwrap_or_default()),
        };
        model
    }

    /// A model for no adapter: one picosecond for an operation of a fragment, and everything else
    /// in the proportions of fast graphics cards.
    pub fn nominal() -> Self {
        let picoseconds = [
            (Term::Passes, 2e6),
            (Term::Draws, 1e6),
            (Term::Vertices, 100.0),
            (Term::VertexOps, 1.0),
            (Term::Triangles, 100.0),
            (Term::Tested, 10.0),
            (Term::Fragments, 20.0),
            (Term::FragmentOps, 1.0),
            (Term::SampleOps, 1.0),
            (Term::Bytes, 2.0),
            (Term::AttachmentBytes, 1.0),
            (Term::Dispatches, 2e6),
            (Term::ComputeInvocations, 20.0),
            (Term::ComputeOps, 0.5),
        ];
        Self {
            schema: SCHEMA.to_owned(),
            origin: ModelOrigin::Nominal,
            nanoseconds: picoseconds.map(|(t, p)| (t, p * 1e-3)).into(),
        }
    }

    /// Milliseconds that a frame takes.
    pub fn predict(&self, work: &Work) -> f64 {
        let each = self.nanoseconds.iter();
        each.map(|(term, ns)| ns * work.of(*term)).sum::<f64>() * 1e-6
    }

    /// How far a prediction is typically off, as a part of 1. 0 if the model was not fitted.
    pub fn error(&self) -> f64 {
        match &self.origin {
            ModelOrigin::Fitted { median_error, .. } => median_error.min(1.0),
            ModelOrigin::Nominal => 0.0,
        }
    }

    /// The relative error of the prediction at each frame.
    pub fn errors(&self, frames: &[Observation]) -> Vec<f64> {
        let error = |f: &Observation| (self.predict(&f.work) / f.ms - 1.0).abs();
        frames.iter().map(error).collect()
    }

    /// Reads the output of [`Model::to_json`].
    ///
    /// # Errors
    ///
    /// Invalid text, another version, or a coefficient below 0.
    pub fn from_json(text: &str) -> Result<Self, ModelError> {
        let value: serde_json::Value = serde_json::from_str(text)?;
        if let Some(schema) = value.get("schema").and_then(|s| s.as_str())
            && schema != SCHEMA
        {
            return Err(ModelError::Version(schema.to_owned()));
        }
        let model: Self = serde_json::from_value(value)?;
        let bad = |ns: &f64| !(ns.is_finite() && *ns >= 0.0);
        match model.nanoseconds.iter().find(|(_, ns)| bad(ns)) {
            Some((term, _)) => Err(ModelError::Coefficient(term.name())),
            None => Ok(model),
        }
    }

    /// The model as JSON, for later runs on the adapter.
    ///
    /// # Errors
    /// A number that JSON cannot express.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self)
    }
}

/// Six digits: more than a clock has, and as many as text keeps.
fn significant(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

/// Iterations of the descent. The sums have about 15 columns, so this takes a few milliseconds.
const SWEEPS: usize = 20_000;

/// The `x >= 0` that minimises the sum of squares of `rows * x - 1`. Uses cyclic coordinate descent
/// on columns scaled to length 1 (Franc, Hlavac, Navara 2005). A zero column gets 0.
fn non_negative(rows: &[Vec<f64>], columns: usize) -> Vec<f64> {
    let column = |j: usize| rows.iter().map(move |r| r[j]);
    let length: Vec<f64> = (0..columns)
        .map(|j| column(j).map(|v| v * v).sum::<f64>().sqrt())
        .collect();
    let scaled = |j: usize| {
        let by = match length[j] > 0.0 {
            true => 1.0 / length[j],
            false => 0.0,
        };
        column(j).map(move |v| v * by)
    };
    let product = |i: usize, j: usize| scaled(i).zip(scaled(j)).map(|(a, b)| a * b).sum::<f64>();
    let gram: Vec<Vec<f64>> = (0..columns)
        .map(|i| (0..columns).map(|j| product(i, j)).collect())
        .collect();
    let target: Vec<f64> = (0..columns).map(|j| scaled(j).sum()).collect();
    let mut x = vec![0.0; columns];
    for _ in 0..SWEEPS {
        let mut moved = 0.0_f64;
        for j in 0..columns {
            if gram[j][j] <= 0.0 {
                continue;
            }
            let gradient: f64 = gram[j].iter().zip(&x).map(|(g, x)| g * x).sum::<f64>() - target[j];
            let next = f64::max(x[j] - gradient / gram[j][j], 0.0);
            moved = moved.max((next - x[j]).abs());
            x[j] = next;
        }
        if moved < 1e-12 {
            break;
        }
    }
    (0..columns)
        .map(|j| {
            if length[j] > 0.0 {
                x[j] / length[j]
            } else {
                0.0
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of pseudo-random work (a linear congruential generator), with their times by these
    /// coefficients.
    fn frames(nanoseconds: &[(Term, f64)], noise: f64) -> Vec<Observation> {
        let mut state = 1_u64;
        let mut next = move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as f64 / (1_u64 << 31) as f64
        };
        let mut frame = || {
            let mut work = Work::default();
            for term in Term::ALL {
                // Over three orders of magnitude, as frames are.
                work.add(term, 10_f64.powf(3.0 + 3.0 * next()));
            }
            let each = nanoseconds.iter().map(|(t, ns)| ns * work.of(*t));
            let ms = each.sum::<f64>() * 1e-6 * (1.0 + noise * (next() - 0.5));
            Observation { work, ms }
        };
        (0..120).map(|_| frame()).collect()
    }

    const TRUE: [(Term, f64); 4] = [
        (Term::VertexOps, 0.25),
        (Term::FragmentOps, 2.0),
        (Term::Bytes, 0.5),
        (Term::Passes, 40.0),
    ];

    #[test]
    fn a_fit_finds_the_coefficients() {
        let frames = frames(&TRUE, 0.0);
        let model = Model::fit("none", &frames);
        for term in Term::ALL {
            let known = TRUE.iter().find(|(t, _)| *t == term);
            let expected = known.map_or(0.0, |(_, ns)| *ns);
            let found = model.nanoseconds.get(&term).copied().unwrap_or_default();
            assert!((found - expected).abs() < 1e-4, "{term:?}: {found}");
        }
        assert!(model.errors(&frames).iter().all(|e| *e < 1e-6));
    }

    #[test]
    fn a_fit_to_noise_predicts_within_it_and_has_nothing_below_0() {
        let model = Model::fit("none", &frames(&TRUE, 0.1));
        assert!(model.nanoseconds.values().all(|ns| *ns > 0.0));
        let errors = model.errors(&frames(&TRUE, 0.0));
        assert!(errors.iter().all(|e| *e < 0.1), "{errors:?}");
        let ModelOrigin::Fitted {
            frames,
            median_error,
            worst_error,
            ..
        } = &model.origin
        else {
            unreachable!("{:?}", model.origin)
        };
        assert_eq!(*frames, 120);
        assert!(median_error < worst_error && *worst_error < 0.2);
    }

    #[test]
    fn a_model_is_read_as_it_was_written() {
        let model = Model::fit("an adapter", &frames(&TRUE, 0.1));
        let text = model.to_json().unwrap_or_default();
        assert_eq!(Model::from_json(&text).ok(), Some(model));
        let of = |text: &str| Model::from_json(text).err().map(|e| e.to_string());
        let other = text.replace(SCHEMA, "preshade.model.v9");
        assert!(of(&other).is_some_and(|e| e.contains("preshade.model.v9")));
        let negative = r#"{"schema":"preshade.model.v1","origin":{"kind":"nominal"},"nanoseconds":{"draws":-1}}"#;
        assert!(of(negative).is_some_and(|e| e.contains("`draws`")));
        assert!(of("[").is_some());
    }

    #[test]
    fn no_frame_takes_no_time() {
        let model = Model::fit("none", &[]);
        assert_eq!(model.predict(&Work::default()), 0.0);
    }
}
