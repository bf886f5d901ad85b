//! preshade rewrites a material's shaders into faster variants, and verifies each by rendering it.
//!
//! A [`Recipe`] is a list of passes. [`rewrite`] applies it to a shader and emits the variant:
//!
//! ```
//! use preshade::{Facts, MaterialState, Options, Recipe, Shader, Source, Target, rewrite};
//!
//! let text = "
//!     @vertex fn vs(@location(0) p: vec3<f32>) -> @builtin(position) vec4<f32> { return vec4(p, 1.0); }
//!     @fragment fn fs() -> @location(0) vec4<f32> { return vec4(1.0); }";
//! let shader = Shader {
//!     name: "lit",
//!     sources: &[Source::new("lit.wgsl", text)],
//!     options: &Options::default(),
//!     state: &MaterialState::default(),
//! };
//! let recipe = Recipe::parse_list("depth-prepass,hoist")?;
//! let output = rewrite(shader, &recipe, &Facts::default(), &[Target::Wgsl])?;
//!
//! // A step that the shader refuses is skipped and reported. The others are applied.
//! assert_eq!(output.plan.steps[0].pass, "depth-prepass");
//! for skipped in &output.skipped {
//!     println!("{}; to make it legal: {}", skipped.refusal, skipped.refusal.remedy);
//! }
//! // The emitted shaders, and `lit.plan.json`, which describes how to draw them.
//! assert!(output.files.iter().any(|f| f.name == "lit.plan.json"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! - In a `build.rs`, use [`configure`] or [`compile`]: see [`build_script`].
//! - With the feature `verify`, `verify` draws a `Scene` with the original and its variants, and
//!   returns a `Report` of errors and times.
//!
//! Everything in [`unstable`] may change at any time.

#[cfg(feature = "compiler")]
pub mod build_script;
#[cfg(feature = "compiler")]
pub mod command;
#[cfg(feature = "compiler")]
pub mod emit;
#[cfg(feature = "compiler")]
pub mod front;
#[cfg(feature = "compiler")]
pub mod lock;
#[cfg(feature = "compiler")]
pub mod parameters;
#[cfg(feature = "compiler")]
pub mod pipeline;
#[cfg(feature = "compiler")]
pub mod recipe;
#[cfg(feature = "compiler")]
pub mod sweep;
#[cfg(feature = "compiler")]
pub mod wgsl;
#[cfg(feature = "spirv")]
mod words;

#[cfg(feature = "verify")]
pub mod capture;
#[cfg(feature = "verify")]
pub mod jobs;
#[cfg(feature = "verify")]
pub mod measure;
#[cfg(feature = "verify")]
pub mod render;
#[cfg(feature = "verify")]
pub mod report;
#[cfg(feature = "verify")]
pub mod scene;
#[cfg(feature = "verify")]
pub mod search;
#[cfg(feature = "verify")]
mod verify;

#[cfg(feature = "compiler")]
pub use build_script::{compile, configure};
#[cfg(feature = "compiler")]
pub use emit::{File, Target};
#[cfg(feature = "compiler")]
pub use front::Source;
#[cfg(feature = "compiler")]
pub use pipeline::{Output, Shader, Skipped, rewrite};
#[cfg(feature = "compiler")]
pub use preshade_plan::contract::Contract;
#[cfg(feature = "compiler")]
pub use preshade_plan::pass::{Facts, Refusal};
#[cfg(feature = "compiler")]
pub use preshade_plan::plan::{GpuPass, Plan};
#[cfg(feature = "compiler")]
pub use preshade_plan::state::{ColorTarget, CullMode, MaterialState};
#[cfg(feature = "compiler")]
pub use preshade_text::options::Options;
#[cfg(feature = "compiler")]
pub use recipe::{Recipe, Step};

#[cfg(feature = "verify")]
pub use measure::record::Report;
#[cfg(feature = "verify")]
pub use render::{AdapterChoice, Gpu};
#[cfg(feature = "verify")]
pub use scene::Scene;
#[cfg(feature = "verify")]
pub use verify::verify;

/// The internals, for preshade's own command line, tests and tools. This module has no stability
/// promise: anything in it may change in any release.
#[cfg(feature = "compiler")]
pub mod unstable {
    macro_rules! internal {
        ($($(#[$attribute:meta])* $module:ident)*) => {
            $($(#[$attribute])* #[allow(missing_docs)] pub mod $module { pub use crate::$module::*; })*
        };
    }
    internal! { build_script command emit front lock parameters pipeline recipe sweep }
    #[cfg(feature = "verify")]
    internal! { capture jobs measure render report scene search }
}

/// Includes the items of a material that the build script compiled:
/// `mod lit { crate::include_variant!("lit"); }`.
#[macro_export]
macro_rules! include_variant {
    ($material:literal) => {
        include!(concat!(env!("OUT_DIR"), "/", $material, ".rs"));
    };
}
