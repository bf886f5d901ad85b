//! Codes of refusals and errors, and those of recipes and of any pass.

/// The code of a refusal or error, and its explanation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RefusalInfo {
    /// The code.
    pub code: &'static str,
    /// The reason, in general.
    pub explanation: &'static str,
    /// How to make the pass legal, or what to do about the error.
    pub remedy: &'static str,
}

/// Declares codes as constants of the type [`RefusalInfo`], and `REFUSALS`, the list of all of them.
#[macro_export]
macro_rules! refusals {
    ($($name:ident = $code:literal: $explanation:literal, $remedy:literal;)*) => {
        $(
            #[doc = concat!("`", $code, "`.")]
            pub const $name: $crate::core::refusals::RefusalInfo = $crate::core::refusals::RefusalInfo {
                code: $code,
                explanation: $explanation,
                remedy: $remedy,
            };
        )*

        /// All of them.
        pub const REFUSALS: &[$crate::core::refusals::RefusalInfo] = &[$($name),*];
    };
}

pub use refusals;

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
