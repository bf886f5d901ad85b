//! Codes of refusals and errors, with explanations and remedies.

/// The code of a refusal or error, and its explanation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RefusalInfo {
    pub code: &'static str,
    /// The reason in general terms.
    pub explanation: &'static str,
    /// How to make the pass legal, or how to fix the error.
    pub remedy: &'static str,
}

/// Declares codes as constants of the type [`RefusalInfo`], and `REFUSALS`, the list of all of them.
#[macro_export]
macro_rules! refusals {
    ($($name:ident = $code:literal: $explanation:literal, $remedy:literal;)*) => {
        $(
            #[doc = concat!("`", $code, "`.")]
            pub const $name: $crate::refusals::RefusalInfo = $crate::refusals::RefusalInfo {
                code: $code,
                explanation: $explanation,
                remedy: $remedy,
            };
        )*

        /// All codes of this module.
        pub const REFUSALS: &[$crate::refusals::RefusalInfo] = &[$($name),*];
    };
}

pub use refusals;
