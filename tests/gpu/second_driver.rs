//! Tests of promises, run again on a second driver.

use std::process::Command;

use crate::swiftshader_support::{VARIABLE, swiftshader};

/// Tests of what may differ between drivers: depths, samples, formats, self-tests.
const TESTS: [&str; 7] = [
    "exactness::every_depth_format_direction_and_sample_count",
    "exactness::a_viewport_offset_and_half_resolution",
    "half_rate::pixels_with_a_texel_are_the_authors",
    "half_rate::a_discard_is_each_pixels_own",
    "early_discard::multisampled_depth_holds_every_sample",
    "self_test::they_hold_as_emitted",
    "self_test::surfaces_at_the_far_plane_hold",
];

/// Another process, since the loader reads the variable of the process.
#[test]
fn promises_hold_on_swiftshader() {
    let output = Command::new(std::env::current_exe().unwrap())
        .arg("--exact")
        .args(TESTS)
        .env(VARIABLE, swiftshader())
        .env("PRESHADE_ADAPTER", "SwiftShader")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}");
    let passed = format!("{} passed", TESTS.len());
    assert!(said.contains(&passed), "{said}");
}
