//! The refusals of `hoist`.

use shader_text::refusals::refusals;

refusals! {
    INTERFACE = "interface":
        "`hoist` cannot lay out the varyings anew.",
        "Let the vertex stage write every input of the fragment stage.";
    NOT_CARRIED = "not-carried":
        "`hoist:carry=` names a value that the shader does not have, or for which the varyings \
         have no room.",
        "Use one that `preshade explain --scene` lists.";
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
