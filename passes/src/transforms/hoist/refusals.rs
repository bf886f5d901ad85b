//! The refusals of `hoist`.

use crate::core::refusals::refusals;

refusals! {
    FRAGMENT_STORES = "fragment-stores":
        "The fragment stage writes memory, and `hoist` does not follow what it writes.",
        "Move the writes to a pass of their own.";
    INTERFACE = "interface":
        "`hoist` cannot lay out the varyings anew.",
        "Let the vertex stage write every input of the fragment stage.";
    NOT_CARRIED = "not-carried":
        "`hoist:carry=` names a value that the shader does not have, or for which the varyings \
         have no room.",
        "Use one that `preshade explain --scene` lists.";
    NOT_SEPARABLE = "not-separable":
        "The values that `hoist` would move cannot be separated from the rest of the stage.",
        "Compute them ahead of the branch or return that encloses them.";
    NOTHING_PAYS = "nothing-pays":
        "No value that `hoist` may move saves a fragment more than interpolating it costs.",
        "The message names the one thing that would help: a budget, a measurement, \
         `finite=assumed`, `jumps=carried` or a larger error. `preshade explain` lists the values \
         that were not moved, and why.";
    OVER_BUDGET = "over-budget":
        "No choice of values keeps the budget in this recipe: another step changes the picture, or \
         no value could be measured.",
        "Allow a larger budget, or leave out a step.";
    THRESHOLD = "threshold":
        "The threshold is a number of at least 0.",
        "Leave it out to have it found.";
    UNKNOWN_VALUES = "unknown-values":
        "`hoist:carry=` names values that are not in this fragment stage.",
        "Measure again: `preshade verify` prints the values to give.";
    VERTICES_PER_FRAGMENT = "vertices-per-fragment":
        "The number of vertices for each fragment is a finite number of at least 0.",
        "Leave it out to have it measured.";
}
