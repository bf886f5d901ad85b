//! What may be NaN or infinite at a vertex does not travel, and what is seen to stay in range does.

use preshade_passes::hoist::{Hoist, Params};
use preshade_passes::pass::{Facts, Pass, Source, SourceRange};
use preshade_passes::plan::Plan;
use preshade_passes::state::MaterialState;

use crate::common;

/// Why `value` stays in the fragment stage that ends with it; `None` where it travels.
fn stays(body: &str, ranges: Vec<SourceRange>) -> Option<String> {
    let source = format!(
        "struct V {{ @builtin(position) position: vec4<f32>, @location(0) p: vec3<f32>, \
         @location(1) q: vec2<f32> }}
@group(0) @binding(0) var<uniform> u: vec4<f32>;
@vertex fn vs(@location(0) p: vec3<f32>) -> V {{ return V(vec4(p, 1.0), p, p.xy); }}
@fragment fn fs(v: V) -> @location(0) vec4<f32> {{ {body} return vec4(value * sin(dpdx(v.q.x))); }}"
    );
    let program = common::program(&source);
    let plan = Plan::original("test", program, "vs", Some("fs"), &MaterialState::default());
    let params = Params {
        budget: Some(0.02),
        vertices_per_fragment: Some(0.01),
        ..Params::default()
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

/// What a scene was seen to give counts before what is assumed.
#[test]
fn the_ranges_of_a_scene_decide() {
    let body = "let value = sin(exp(v.p.x));";
    let ranges = vec![SourceRange {
        material: "test".to_owned(),
        source: Source::Varying { location: 0 },
        low: -4.0,
        high: 40.0,
    }];
    assert!(stays(body, Vec::new()).is_some());
    assert_eq!(stays(body, ranges), None);
}
