//! The refusals of `skip-taps`.

use crate::core::refusals::refusals;

refusals! {
    NO_TAP = "no-tap":
        "`skip-taps` found no texture sample with a weight that may be left out. `explain` lists \
         what was weighed and why it stays: read elsewhere too (by its own weight, say), sampled \
         at an implicit level in a called function, biased, kept in a variable, part of what \
         decides a discard, or run by the vertex stage too.",
        "Sample with gradients or a level, and multiply with the weight where nothing else reads \
         the sample.";
}
