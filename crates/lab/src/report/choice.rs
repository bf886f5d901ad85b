//! A choice in words.

use super::frontier;
use crate::measure::Estimate;
use crate::measure::record::{Choice, Chosen};

impl Chosen {
    pub fn said(&self) -> String {
        let open = match (&self.choice, self.unverified) {
            (Choice::Within { .. }, _) | (_, 0) => String::new(),
            (_, 1) => " One more was drawn within it, and not verified.".to_owned(),
            (_, n) => format!(" {n} more were drawn within it, and not verified."),
        };
        self.said_of_verified() + &open
    }

    fn said_of_verified(&self) -> String {
        let (name, most) = (self.budget.metric, self.budget.limit);
        let times = |speedup: Option<Estimate>| {
            speedup.map_or_else(|| "not timed".to_owned(), frontier::speedup)
        };
        match &self.choice {
            Choice::Within {
                variant,
                error,
                speedup,
            } => {
                let recipe = self.recipe.as_ref();
                let recipe = recipe.map(|r| format!(" `rewrite` makes it of {r}"));
                format!(
                    "Within {name}={most} the best is {variant}: {}, {name} {error:.5}.{}",
                    times(*speedup),
                    recipe.unwrap_or_default()
                )
            }
            Choice::NoGain {
                variant,
                error,
                speedup,
            } => format!(
                "No variant within {name}={most} is faster than the original beyond noise: the \
                 fastest is {variant}, {}, {name} {error:.5}.",
                frontier::speedup(*speedup)
            ),
            Choice::None {
                nearest: Some(variant),
                error: Some(error),
                speedup,
            } => format!(
                "No variant is within {name}={most}: the best error is {error:.5}, of {variant}, \
                 {}.",
                times(*speedup)
            ),
            Choice::None { .. } => format!(
                "No variant within {name}={most} stood beside the original: each that was drawn is \
                 slower, further off, broke its own promise, or was not verified."
            ),
        }
    }
}
