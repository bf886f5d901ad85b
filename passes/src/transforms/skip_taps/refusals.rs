//! The refusals of `skip-taps`.

use shader_text::refusals::refusals;

refusals! {
    NO_TAP = "no-tap":
        "`skip-taps` found no weighted texture sample that may be left out. `explain` lists the \
         weighted samples and the reasons: another use (in its own weight, for example), an \
         implicit level in a called function, a level bias, a variable that holds it, a discard \
         that depends on it, or a vertex stage that runs it too.",
        "Sample with gradients or a level, and multiply with the weight where nothing else reads \
         the sample.";
}
