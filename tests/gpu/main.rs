//! Tests that draw: they need a Vulkan, Metal or DirectX adapter, a software one at least, and EGL.
//! `scripts/setup.sh vulkan gl swiftshader` installs Mesa's, and the second driver. A test fails if it
//! finds no adapter.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::too_many_lines,
    missing_docs
)]

#[path = "../support/capture_support.rs"]
mod capture_support;
#[path = "../support/fixtures_support.rs"]
mod fixtures_support;
#[path = "../support/interfaces.rs"]
mod interfaces;
#[path = "../../passes/tests/it/metamorphic_support.rs"]
mod metamorphic_support;
mod native;
#[path = "../support/outputs_support.rs"]
mod outputs_support;
#[path = "../support/render_support/mod.rs"]
mod render_support;
#[path = "../support/swiftshader_support.rs"]
mod swiftshader_support;

mod adversarial;
mod captures;
mod decide;
mod device_lost;
mod early_discard;
mod endless;
mod evaluate_on_adapter;
mod exactness;
mod explore;
mod glsl_native;
mod half_rate;
mod hoist;
mod immediates;
mod interpolation;
mod made_up;
mod measure;
mod measure_shadow;
mod measure_verdicts;
mod measure_verify;
mod metamorphic_pictures;
mod native_tessellation;
mod noise_grid;
mod outputs;
mod plan_is_enough;
mod plan_mutations;
mod plan_needs;
mod profile;
mod render;
mod second_driver;
mod self_test;
mod skip_taps;
mod specialize;
mod sweep;
mod tessellate;
mod tessellate_static;
mod texture_formats;
mod traces;
mod undrawn;
mod validate_on_adapter;
mod visibility_buffer;
