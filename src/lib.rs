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
//! The crates below this one are preshade's own: they may change in any release.
#![warn(missing_docs)]

#[cfg(feature = "compiler")]
pub use preshade_compiler::build_script::{self, compile, configure};
#[cfg(feature = "compiler")]
pub use preshade_compiler::front::Source;
#[cfg(feature = "compiler")]
pub use preshade_compiler::pipeline::{Output, Shader, Skipped, rewrite};
#[cfg(feature = "compiler")]
pub use preshade_compiler::recipe::{Recipe, Step};
#[cfg(feature = "compiler")]
pub use preshade_plan::contract::Contract;
#[cfg(feature = "compiler")]
pub use preshade_plan::pass::{Facts, Refusal};
#[cfg(feature = "compiler")]
pub use preshade_plan::plan::{BindingSource, BindingUse, GpuPass, Plan};
#[cfg(feature = "compiler")]
pub use preshade_plan::plan_file::Target;
#[cfg(feature = "compiler")]
pub use preshade_plan::state::{ColorTarget, CullMode, MaterialState};
#[cfg(feature = "compiler")]
pub use shader_text::files::File;
#[cfg(feature = "compiler")]
pub use shader_text::options::Options;
#[cfg(feature = "compiler")]
pub use shader_text::source::Language;

#[cfg(feature = "verify")]
pub use preshade_draw::render::{AdapterChoice, Gpu};
#[cfg(feature = "verify")]
pub use preshade_draw::scene::Scene;
#[cfg(feature = "verify")]
pub use preshade_lab::measure::record::Report;
#[cfg(feature = "verify")]
pub use preshade_lab::verify;
#[cfg(feature = "verify")]
pub use preshade_scenes::load as load_scene;

/// Includes the items of a material that the build script compiled:
/// `mod lit { crate::include_variant!("lit"); }`.
#[macro_export]
macro_rules! include_variant {
    ($material:literal) => {
        include!(concat!(env!("OUT_DIR"), "/", $material, ".rs"));
    };
}
