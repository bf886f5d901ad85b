//! Tests of commands that draw: they need an adapter, `capture` Chromium, `page` and `three` also node and
//! npm, `schedulers` GNU parallel, `hyperqueue` its Python package.
//! `scripts/setup.sh vulkan three swiftshader fleet` installs them. A test fails if something is missing.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::too_many_lines,
    missing_docs
)]

#[path = "../support/browser_support.rs"]
mod browser_support;
#[path = "../../../tests/support/capture_support.rs"]
#[allow(dead_code)]
mod capture_support;
#[path = "../support/hostile_support.rs"]
mod hostile_support;
#[path = "../../../tests/support/swiftshader_support.rs"]
mod swiftshader_support;
#[path = "../support/trees.rs"]
mod trees;

mod action;
mod agree;
#[cfg(feature = "capture")]
mod capture;
mod cases;
mod cli;
mod fleet;
mod hostile;
// The package has a wheel for this kind of machine only.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod hyperqueue;
mod kept;
mod locks;
mod newcomer;
mod page;
mod plan;
mod promises;
mod readme;
#[cfg(target_os = "linux")]
mod schedulers;
mod three;
