//! Codes of recipes and of any pass.

use shader_text::refusals;

refusals! {
    BUDGET = "budget":
        "`budget=` is the largest difference of a colour that you allow. It is missing, or \
         outside 0 to 1.",
        "Give one: `budget=0.02`, say.";
    CONTRADICTION = "contradiction":
        "The pass assumes a value that the plan's guard already excludes: an earlier step assumes \
         another one, or its budget was measured with another one.",
        "Leave one of the steps out, or give values that both allow.";
    INTERNAL = "internal":
        "A transform built an invalid program. This is a bug in preshade. The original is kept.",
        "Please report it with the shader.";
    PARAMETERS = "parameters":
        "A parameter does not fit the pass.",
        "`preshade passes NAME` lists them.";
    REFUSED = "refused":
        "A pass refused and gave no reason of its own.",
        "`preshade explain` lists every reason.";
    SHARED_BINDING = "shared-binding":
        "Two variables have one binding, or both are immediate data, each in a stage of its own, and \
         the pass would use both in one stage.",
        "Give one of them another binding, or declare one variable for both stages.";
    STALE = "stale":
        "The site that the recipe names is no longer in the shader.",
        "Make the recipe anew.";
    UNKNOWN = "unknown":
        "There is no pass of that name.",
        "`preshade passes` lists them.";
}
