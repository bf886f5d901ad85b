//! Tests that need no adapter and no tools: `cargo test --all-features --test it`.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::too_many_lines,
    missing_docs
)]

#[path = "../support/capture_support.rs"]
mod capture_support;
mod combinations_support;
#[path = "../support/fixtures_support.rs"]
mod fixtures_support;
mod fuzz_support;
mod results_support;

mod adversarial;
mod agree;
mod agree_cases;
mod bevy;
mod build_script;
mod captures;
mod combinations;
mod dialects;
mod emit_tessellation;
mod front;
mod front_mutations;
mod fuzz_corpus;
mod glsl;
mod glsl_scopes;
mod glsl_semantics;
mod glsl_vulkan;
mod gltf;
mod half_rate;
mod outputs_glsl;
mod pass_pages;
mod refusals;
mod results_page;
mod scene_by_use;
mod scene_errors;
mod scene_gltf;
mod scene_image;
mod scene_load;
mod scene_mesh;
mod scene_overdraw;
mod scene_shaders;
mod scene_synthesise;
mod shared_binding;
mod snapshots;
mod text_meaning;
mod tidy;
mod traces;
mod validate;
mod wgsl_in;
mod wgsl_in_cases;
