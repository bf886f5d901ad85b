//! Loops to a number in a uniform buffer: which guard ends them, and what each pass makes of it.

use preshade_geometry::pass_named;
use preshade_passes::transforms::half_rate::{self, HalfRate};
use preshade_passes::transforms::hoist::{self, Hoist};
use preshade_passes::transforms::preamble::{self, Preamble};
use preshade_plan::guard::{Assumed, Bounds, Place, ScalarType};
use preshade_plan::pass::{Constant, Facts, Outcome, Pass, Refused};
use preshade_plan::plan::{Plan, Role};
use preshade_plan::state::{CompareFunction, MaterialState};
use preshade_validate::{Effort, validate};

use crate::common;

const HEAD: &str = "
struct Lamp { place: vec3<f32>, reach: f32 }
struct Counts { lamps: u32, taps: i32, part: f32 }
struct Frame { lamps: array<Lamp, 16>, count: u32, @align(16) counts: Counts, @align(16) many: array<vec4<u32>, 100> }
@group(1) @binding(2) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> numbers: array<u32>;
@group(0) @binding(3) var map: texture_2d<f32>;
struct V { @builtin(position) at: vec4<f32>, @location(0) uv: vec2<f32>, @location(1) n: vec3<f32> }
@vertex fn vs(@location(0) p: vec3<f32>) -> V { return V(vec4(p, 1.0), p.xy, p); }
";

fn original(body: &str) -> Plan {
    let text = format!("{HEAD}@fragment fn fs(v: V) -> @location(0) vec4<f32> {{\n{body}\n}}");
    let state = MaterialState {
        depth_compare: Some(CompareFunction::Always),
        depth_write: false,
        ..MaterialState::default()
    };
    Plan::original("test", common::program(&text), "vs", Some("fs"), &state)
}

fn half(plan: &Plan) -> Result<Outcome, Refused> {
    let params = half_rate::HalfRateParams {
        budget: Some(0.01),
        ..half_rate::HalfRateParams::default()
    };
    HalfRate::run(plan, &Facts::default(), &params)
}

fn once(plan: &Plan) -> Result<Outcome, Refused> {
    let params = preamble::PreambleParams {
        allow: preamble::Allow::Rounding,
        ..preamble::PreambleParams::default()
    };
    Preamble::run(plan, &Facts::default(), &params)
}

fn hoisted(plan: &Plan) -> Result<Outcome, Refused> {
    let params = hoist::HoistParams {
        budget: Some(0.02),
        finite: hoist::movable::Finite::Assumed,
        jumps: hoist::movable::Jumps::Carried,
        ..hoist::HoistParams::default()
    };
    Hoist::run(plan, &Facts::default(), &params)
}

/// The numbers of the plan's guard, in words.
fn guard(plan: &Plan) -> Vec<String> {
    let values = plan.guard.iter().flat_map(|g| &g.values);
    values.map(ToString::to_string).collect()
}

/// The sum over the lamps up to a bound.
fn light(bound: &str) -> String {
    format!(
        "var sum = 0.0;
        for (var i = 0u; i < {bound}; i++) {{
            let away = frame.lamps[i].place - vec3(v.uv, 0.0);
            sum += max(dot(v.n, away) / (length(away) + 1.0), 0.0);
        }}
        return vec4<f32>(sum, sum * 0.5, 0.0, 1.0) * textureLoad(map, vec2<i32>(v.at.xy), 0);"
    )
}

#[test]
fn the_bound_is_named_with_its_place_and_type() {
    let next = half(&original(&light("frame.counts.lamps"))).unwrap().plan;
    let [assumed] = &next.guard.as_ref().unwrap().values[..] else {
        panic!("{:?}", next.guard);
    };
    let Assumed {
        name,
        place,
        ty,
        bounds,
    } = assumed;
    assert_eq!(name, "frame.counts.lamps");
    // 16 lamps of 16 bytes, the count, and the alignment of a struct in a uniform buffer.
    let expected = Place::Uniform {
        group: 1,
        binding: 2,
        offset: 16 * 16 + 16,
    };
    assert_eq!((place, *ty), (&expected, ScalarType::U32));
    assert_eq!([bounds.low, bounds.high], [0.0, 1024.0]);
    assert_eq!(next.fallback.as_deref(), Some("original"));
}

#[test]
fn which_bounds_a_guard_can_hold() {
    for (bound, expected) in [
        ("frame.count", Some(vec!["frame.count = 0..1024"])),
        (
            "u32(frame.counts.taps)",
            Some(vec!["frame.counts.taps = 0..1024"]),
        ),
        (
            "u32(frame.counts.part)",
            Some(vec!["frame.counts.part = 0..1024"]),
        ),
        ("frame.many[99].y", Some(vec!["frame.many[99].y = 0..1024"])),
        ("16u", Some(vec![])),
        ("min(frame.count, 16u)", Some(vec![])),
        ("min(16u, numbers[0])", Some(vec![])),
        ("max(frame.count, 16u)", None),
        ("numbers[0]", None),
        ("frame.many[numbers[0]].x", None),
        ("frame.count * 2u", None),
        ("bitcast<u32>(frame.counts.part)", None),
        ("u32(v.uv.x)", None),
    ] {
        let found = half(&original(&light(bound)));
        let found = found.ok().map(|done| guard(&done.plan));
        let expected = expected.map(|all| all.into_iter().map(str::to_owned).collect());
        assert_eq!(found, expected, "{bound}");
    }
}

#[test]
fn which_counters_a_guard_can_bound() {
    let of = |head: &str, next: &str| {
        let body = light("").replace(
            "for (var i = 0u; i < ; i++)",
            &format!("for ({head}; {next})"),
        );
        half(&original(&body)).is_ok()
    };
    assert!(of("var i = 0u; i <= frame.count", "i += 2u"));
    assert!(of("var i = -4i; i < frame.counts.taps", "i++"));
    assert!(!of("var i = 0u; i < frame.count", "i += 0u"));
    assert!(!of("var i = 0u; i != frame.count", "i += 2u"));
    assert!(!of("var i = 16u; i > frame.count", "i -= 1u"));
    assert!(!of("var i = frame.count; i < 16u", "i += 1u"));
}

/// A discard may protect the author's stage from a huge number. The half-rate stage leaves it out: the guard
/// protects that one.
#[test]
fn a_stage_without_the_authors_discard_has_a_guard() {
    let body = format!("if v.uv.x > 0.5 {{ discard; }}\n{}", light("frame.count"));
    let next = half(&original(&body)).unwrap().plan;
    assert_eq!(guard(&next), ["frame.count = 0..1024"]);
    let half = next.passes.iter().find(|p| p.role == Role::HalfRate);
    let half = common::wgsl(next.program(half.unwrap()).unwrap());
    assert!(
        half.contains("frame.count") && !half.contains("discard"),
        "{half}"
    );
}

/// The loop leaves the fragment stage with its values, and no empty one stays.
#[test]
fn a_loop_that_moved_is_gone() {
    let body = "var sum = 0.0;
        for (var i = 0u; i < frame.count; i++) { sum = max(sum, exp2(frame.lamps[i].reach)); }
        let gain = exp2(sum);
        return vec4<f32>(v.uv * gain, v.n.x, 1.0);";
    let plan = original(body);
    for (what, done) in [("preamble", once(&plan)), ("hoist", hoisted(&plan))] {
        let next = done.unwrap().plan;
        assert_eq!(guard(&next), ["frame.count = 0..1024"], "{what}");
        let given = serde_json::to_string(&next.contract).unwrap();
        assert!(given.contains("values-of-the-guard"), "{what}: {given}");
        let fragment = common::wgsl(next.program(next.main().unwrap()).unwrap());
        let fragment = &fragment[fragment.find("@fragment").unwrap()..];
        assert!(
            !fragment.contains("for (") && !fragment.contains("loop"),
            "{what}: {fragment}"
        );
        let effort = Effort {
            inputs: 12,
            ..Effort::default()
        };
        for check in validate(&plan, &next, &effort) {
            assert!(
                !check.verdict.is_broken(),
                "{what}: {}: {}",
                check.promise,
                check.verdict
            );
        }
    }
}

/// What decides a branch is computed with the value behind it.
#[test]
fn a_loop_in_a_condition_is_guarded_or_refused() {
    let body = |bound: &str| {
        format!(
            "var sum = 0.0; var gain = 1.0;
            for (var i = 0u; i < {bound}; i++) {{ sum += frame.lamps[i].reach; }}
            if sum > 1.0 {{ gain = exp2(exp2(exp2(frame.counts.part))); }}
            return vec4<f32>(v.uv * gain, v.n.x, 1.0);"
        )
    };
    for pass in [once, hoisted] {
        if let Ok(done) = pass(&original(&body("frame.count"))) {
            assert_eq!(guard(&done.plan), ["frame.count = 0..1024"]);
        }
        if let Ok(done) = pass(&original(&body("numbers[0]"))) {
            assert!(!done.change.what.contains("gain"), "{}", done.change.what);
        }
    }
}

/// A guard bounds each loop, and not the product of two.
#[test]
fn nested_loops_stay() {
    let nested = light("frame.count").replace(
        "sum +=",
        "for (var j = 0i; j < frame.counts.taps; j++) { sum += 0.25; }\nsum +=",
    );
    let refused = half(&original(&nested)).unwrap_err();
    let left = refused.left.iter();
    let reasons: Vec<&str> = left.map(|l| l.reason.as_str()).collect();
    assert!(
        reasons.iter().any(|r| r.contains("may not end")),
        "{reasons:?}"
    );
}

#[test]
fn a_loop_of_a_callee_is_guarded_unless_a_call_gives_its_bound() {
    let text = |bound: &str, argument: &str| {
        format!(
            "{HEAD}fn lit(n: vec3<f32>, count: u32) -> f32 {{
                var sum = 0.0;
                for (var i = 0u; i < {bound}; i++) {{
                    sum += max(dot(n, frame.lamps[i].place) / length(frame.lamps[i].place), 0.0);
                }}
                return exp2(exp2(sum));
            }}
            @fragment fn fs(v: V) -> @location(0) vec4<f32> {{
                return vec4<f32>(lit(v.n, {argument})) * textureLoad(map, vec2<i32>(v.at.xy), 0);
            }}"
        )
    };
    let plan = |text: &str| {
        let state = MaterialState {
            depth_compare: Some(CompareFunction::Always),
            depth_write: false,
            ..MaterialState::default()
        };
        Plan::original("test", common::program(text), "vs", Some("fs"), &state)
    };
    let next = half(&plan(&text("frame.count", "0u"))).unwrap().plan;
    assert_eq!(guard(&next), ["frame.count = 0..1024"]);
    assert!(half(&plan(&text("count", "frame.count"))).is_err());
}

#[test]
fn other_values_need_no_guard() {
    let body = "var sum = 0.0;
        for (var i = 0u; i < frame.count; i++) { sum += frame.lamps[i].reach * v.at.x; }
        let gain = exp2(exp2(exp2(frame.counts.part)));
        return vec4<f32>(v.uv * gain, sum, 1.0);";
    let next = once(&original(body)).unwrap().plan;
    assert_eq!(next.guard, None);
    let main = common::wgsl(next.program(next.main().unwrap()).unwrap());
    assert!(main.contains("loop"), "{main}");
}

const LAMPS: &str = "
    var sum = 0.0;
    for (var i = 0u; i < frame.count; i++) { sum += exp(frame.lamps[i % 16u].reach * v.uv.x); }
    return vec4(sum);";

/// A step that excludes what an earlier one assumes is refused; two that agree share a guard.
#[test]
fn a_value_outside_an_earlier_guard_is_refused() {
    let moved = hoisted(&original(LAMPS)).unwrap();
    let what = &moved.change.what;
    assert!(
        what.starts_with("with frame.count = 0..1024: carries"),
        "{what}"
    );
    let set = |count: u32| {
        let params = serde_json::json!({ "set": format!("frame.count={count}") });
        let specialize = pass_named("specialize").unwrap();
        specialize.run(&moved.plan, &Facts::default(), &params)
    };
    let few = set(3).unwrap().plan;
    let guard = few.guard.map(|g| g.to_string());
    assert_eq!(guard.as_deref(), Some("frame.count = 3"));
    let refused = set(2000).unwrap_err().first();
    assert_eq!(refused.code, "contradiction");
    assert!(
        refused.reason.contains("`frame.count`"),
        "{}",
        refused.reason
    );
}

/// A scene that the guard leaves out gets the variant, and is told that it draws the original.
#[test]
fn a_scene_outside_the_guard_is_told() {
    let plan = original(LAMPS);
    let hoist = pass_named("hoist").unwrap();
    let params = serde_json::json!({ "budget": 0.02, "finite": "assumed", "jumps": "carried" });
    let mut value = hoisted(&plan).unwrap().plan.guard.unwrap().values.remove(0);
    let mut notes = |count: f64| {
        value.bounds = Bounds::one(count);
        let constant = Constant {
            material: plan.material.clone(),
            value: value.clone(),
        };
        let facts = Facts {
            constants: vec![constant],
            ..Facts::default()
        };
        let next = hoist.run(&plan, &facts, &params).unwrap().plan;
        next.notes
            .iter()
            .filter(|n| n.contains("the original is drawn"))
            .count()
    };
    assert_eq!((notes(16.0), notes(2000.0)), (0, 1));
}
