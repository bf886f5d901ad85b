//! Tests that run other programs on emitted shaders: Tint, Dawn, spirv-val, glslang, WebGL, Vulkan
//! hosts in C, and cargo on the example host. `scripts/setup.sh accept three native` installs them. A
//! test fails if its program is missing.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::too_many_lines,
    missing_docs
)]

mod accept;
#[path = "../support/fixtures_support.rs"]
mod fixtures_support;
#[path = "../support/interfaces.rs"]
mod interfaces;
#[path = "../support/reflection_support.rs"]
mod reflection_support;
#[path = "../support/swiftshader_support.rs"]
mod swiftshader_support;
#[path = "../../passes/tests/it/uniformity_cases.rs"]
mod uniformity_cases;
#[path = "../it/wgsl_in_cases.rs"]
mod wgsl_in_cases;

mod acceptance;
mod drawn_by_dawn;
mod emit;
mod es100;
mod example;
mod fixtures_emit;
mod flows;
mod glsl_in;
mod glsl_layout;
mod glsl_names;
mod interface_texts;
mod lacks;
mod native;
mod reflection;
mod spirv_in;
mod spirv_meaning;
mod spirv_modules;
mod webgl;
