//! Codes of refusals and errors, with explanations and remedies.

/// The code of a refusal or error, and its explanation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RefusalInfo {
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
            pub const $name: $crate::refusals::RefusalInfo = $crate::refusals::RefusalInfo {
                code: $code,
                explanation: $explanation,
                remedy: $remedy,
            };
        )*

        /// All of them.
        pub const REFUSALS: &[$crate::refusals::RefusalInfo] = &[$($name),*];
    };
}

pub use refusals;
