//! What may be NaN or infinite at a vertex does not travel, and what is seen to stay in range does.

use preshade_passes::transforms::hoist::{Hoist, HoistParams};
use preshade_plan::pass::{Facts, Pass, Source, SourceRange};
use preshade_plan::plan::Plan;
use preshade_plan::state::MaterialState;

use crate::common;

/// Why `value` stays in the fragment stage that ends with it; `None` where it travels.
fn stays(body: &str, ranges: Vec<SourceRange>) -> Option<String> {
    let source = format!(
        "enable f16;
struct V {{ @builtin(position) position: vec4<f32>, @location(0) p: vec3<f32>, \
         @location(1) q: vec2<f32> }}
@group(0) @binding(0) var<uniform> u: vec4<f32>;
@group(0) @binding(1) var<uniform> h: vec2<f16>;
@group(0) @binding(2) var<uniform> k: vec2<i32>;
@vertex fn vs(@location(0) p: vec3<f32>) -> V {{ return V(vec4(p, 1.0), p, p.xy); }}
@fragment fn fs(v: V) -> @location(0) vec4<f32> {{ {body} return vec4(value * sin(dpdx(v.q.x))); }}"
    );
    let program = common::program(&source);
    let plan = Plan::original("test", program, "vs", Some("fs"), &MaterialState::default());
    let params = HoistParams {
        budget: Some(0.02),
        vertices_per_fragment: Some(0.01),
        ..HoistParams::default()
    };
    let facts = Facts {
        ranges,
        ..Facts::default()
    };
    let done = Hoist::run(&plan, &facts, &params);
    let applies = done.is_ok();
    let left = done.map_or_else(|refused| refused.left, |done| done.left);
    let found = left.iter().find(|l| l.name == "value");
    assert!(found.is_some() || applies, "{body}: {left:#?}");
    found.map(|l| l.reason.clone())
}

#[test]
fn what_may_overflow_stays_and_says_what_is_assumed() {
    for (operation, body) in [
        ("exp", "let value = sin(exp(v.p.x));"),
        ("exp2", "let value = sin(exp2(v.p.x * u.x));"),
        ("pow", "let value = sin(pow(abs(v.p.x), 8.0));"),
        ("sinh", "let value = sin(sinh(v.p.x));"),
        ("cosh", "let value = sin(cosh(v.p.x));"),
        (
            "*",
            "let a = v.p.x * v.p.y * v.p.z * u.x; let value = sin(a * a);",
        ),
        (
            "*",
            "let a = 1.0 / max(v.p.x * v.p.x, 1e-30); let value = sin(a * a);",
        ),
        (
            "*",
            "var a = v.p.x; for (var i = 0; i < 7; i++) { a *= v.p.y; } let value = sin(a);",
        ),
    ] {
        let reason = stays(body, Vec::new()).unwrap_or_else(|| panic!("{body} travels"));
        assert!(
            reason.starts_with(&format!("`{operation}` may overflow")),
            "{reason}"
        );
        assert!(reason.contains("2^20"), "{reason}");
    }
}

#[test]
fn what_is_seen_to_stay_in_range_travels() {
    for body in [
        "let value = exp(min(v.p.x, 80.0));",
        "let value = exp(-dot(v.p, v.p)) * sin(v.p.x);",
        "let value = exp2(sin(v.p.x) * 8.0) * cos(v.p.y);",
        "let value = pow(saturate(v.p.x), 64.0) * sin(v.q.x);",
        "let value = sin(v.p.x * v.p.y * v.p.z) * cos(u.x * u.y * v.q.x);",
        "var value = 0.0; for (var i = 0; i < 5; i++) { value += sin(v.p.x * f32(i)); }",
        "var value = 0.0; var f = 1.0; for (var i = 0; i < 6; i++) { value += sin(v.p.x * f); \
         f *= 2.0; }",
    ] {
        assert_eq!(stays(body, Vec::new()), None, "{body}");
    }
}

/// The quotients inside of these may be 0 / 0 or infinite, although the results are bounded.
#[test]
fn what_divides_inside_is_not_hoisted() {
    for (reason, body) in [
        ("`tanh` may overflow", "let value = tanh(v.p.x);"),
        (
            "`smoothstep` may be NaN",
            "let value = smoothstep(u.x, u.y, v.p.x);",
        ),
        (
            "`atan2` may be NaN",
            "let value = atan2(u.x, u.y) * sin(v.p.x);",
        ),
        (
            "`%` may overflow",
            "let value = sin(exp2(min(u.x, 100.0)) % 1e-20) * sin(v.p.x);",
        ),
    ] {
        let found = stays(body, Vec::new()).unwrap_or_else(|| panic!("{body} is hoisted"));
        assert!(found.starts_with(reason), "{body}: {found}");
    }
    for body in [
        "let value = tanh(clamp(v.p.x, -87.0, 87.0));",
        "let value = smoothstep(0.0, 1.0, v.p.x) * sin(v.p.y);",
        "let value = atan2(u.x, 2.0 + sin(u.y)) * sin(v.p.x);",
    ] {
        assert_eq!(stays(body, Vec::new()), None, "{body}");
    }
}

/// An `f16` overflows at 65504. Only the numbers of 32 bits have ranges.
#[test]
fn what_has_another_width_is_not_hoisted() {
    for body in [
        "let value = sin(f32(h.x)) * sin(v.p.y);",
        "let value = sin(f32(h.x * h.y)) * sin(v.p.y);",
        "let value = sin(f32(i64(k.x))) * sin(v.p.y);",
    ] {
        let found = stays(body, Vec::new()).unwrap_or_else(|| panic!("{body} is hoisted"));
        assert!(
            found.starts_with("`conversion` may overflow"),
            "{body}: {found}"
        );
    }
    let body = "let value = f32(k.x) * sin(v.p.y);";
    assert_eq!(stays(body, Vec::new()), None);
}

/// What a scene was seen to give counts before what is assumed.
#[test]
fn the_ranges_of_a_scene_decide() {
    let body = "let value = sin(exp(v.p.x));";
    let ranges = vec![SourceRange {
        material: "test".to_owned(),
        source: Source::Varying { location: 0 },
        low: -4.0,
        high: 40.0,
        components: Vec::new(),
    }];
    assert!(stays(body, Vec::new()).is_some());
    assert_eq!(stays(body, ranges), None);
}
