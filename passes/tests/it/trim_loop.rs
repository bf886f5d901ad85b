//! What trimming leaves of a loop: as many turns as it says, and no other change.

use std::collections::BTreeMap;

use naga::ShaderStage;
use naga_interp::{Environment, Scalar, Value};
use preshade_passes::transforms::trim_loop::{TrimLoop, TrimLoopParams};
use preshade_plan::budget::{Budget, Metric};
use preshade_plan::pass::{Facts, Pass};
use preshade_plan::plan::Plan;
use preshade_plan::state::MaterialState;

use crate::common;

const VERTEX: &str = "
@vertex fn vs(@location(0) p: vec3<f32>) -> @builtin(position) vec4<f32> { return vec4(p, 1.0); }
";

fn original(fragment: &str) -> Plan {
    let program = common::program(&format!("{VERTEX}{fragment}"));
    Plan::original("test", program, "vs", Some("fs"), &MaterialState::default())
}

fn params(turns: u32, of: Option<&str>) -> TrimLoopParams {
    TrimLoopParams {
        turns,
        of: of.map(str::to_owned),
        budget: Some(0.1),
        ..TrimLoopParams::default()
    }
}

/// The trimmed plan, or why not.
fn trimmed(plan: &Plan, params: &TrimLoopParams) -> Result<Plan, String> {
    match TrimLoop::run(plan, &Facts::default(), params) {
        Ok(done) => Ok(done.plan),
        Err(refused) => Err(refused.first().to_string()),
    }
}

fn reason(fragment: &str) -> String {
    let found = TrimLoop::run(&original(fragment), &Facts::default(), &params(1, None));
    found.unwrap_err().left[0].reason.clone()
}

fn text(plan: &Plan) -> String {
    common::wgsl(plan.program(plan.main().unwrap()).unwrap())
}

/// The red that the fragment stage, which has no inputs, writes.
fn red(plan: &Plan) -> f32 {
    let program = plan.program(plan.main().unwrap()).unwrap();
    let (entry, _) = program.entry_point(ShaderStage::Fragment, "fs").unwrap();
    let environment = Environment {
        resources: BTreeMap::new().into(),
        texture: &|_| [0.0; 4],
        derivative: None,
        trace: None,
        steps: 10_000,
    };
    let outcome = naga_interp::entry_point(program.module(), entry, &[], &environment).unwrap();
    match outcome.result {
        Some(Value::Composite(parts)) => match parts[0] {
            Value::Scalar(Scalar::F32(red)) => red,
            _ => panic!("{parts:?}"),
        },
        other => panic!("{other:?}"),
    }
}

#[test]
fn every_way_to_count_loses_as_many_turns_as_it_is_told() {
    // Each adds up a digit a turn, so that the sum tells which turns were made.
    let heads = [
        "for (var i = 0; i < 6; i++)",
        "for (var i = 0; i <= 5; i++)",
        "for (var i = 6; i > 0; i--)",
        "for (var i = 5; i >= 0; i--)",
        "for (var i = 0; i != 6; i++)",
        "for (var i = 0u; i < 18u; i += 3u)",
        "for (var i = 0u; i < 16u; i += 3u)",
        "for (var i = 1; i < 64; i *= 2)",
        "for (var i = -3; i < 3; i++)",
    ];
    for head in heads {
        for (turns, expected) in [(1, 5), (2, 4), (5, 1), (9, 1)] {
            let plan = original(&format!(
                "@fragment fn fs() -> @location(0) vec4<f32> {{
                    var sum = 0.0;
                    {head} {{ sum = sum * 10.0 + 1.0; }}
                    return vec4(sum);
                }}"
            ));
            assert_eq!(red(&plan), 111_111.0, "{head}");
            let less = trimmed(&plan, &params(turns, None)).unwrap();
            let ones = (0..expected).fold(0.0, |sum, _| sum * 10.0 + 1.0);
            assert_eq!(red(&less), ones, "{head}, {turns} turns less");
        }
    }
}

#[test]
fn a_callee_is_trimmed_by_its_name() {
    let plan = original(
        "fn octaves(p: f32) -> f32 {
            var sum = 0.0; var weight = 1.0;
            for (var i = 0; i < 4; i++) { sum += weight * sin(p * f32(i)); weight *= 0.5; }
            return sum;
        }
        fn march(p: f32) -> f32 { var t = p; for (var i = 0; i < 8; i++) { \
            t += cos(t); } return t; }
        @fragment fn fs(@location(0) p: f32) -> @location(0) vec4<f32> { \
            return vec4(octaves(p) + march(p)); }",
    );
    let one = trimmed(&plan, &params(1, Some("octaves"))).unwrap();
    assert!(
        text(&one).contains("< 3i)") && text(&one).contains("< 8i)"),
        "{}",
        text(&one)
    );
    let both = trimmed(&plan, &params(2, Some("octaves + march"))).unwrap();
    assert!(
        text(&both).contains("< 2i)") && text(&both).contains("< 6i)"),
        "{}",
        text(&both)
    );
    assert_eq!(
        text(&both),
        text(&trimmed(&plan, &params(2, None)).unwrap())
    );
    let error = trimmed(&plan, &params(1, Some("octave"))).unwrap_err();
    assert!(error.contains("calls no `octave`"), "{error}");
    assert!(
        one.contract.budgets()
            == [Budget {
                metric: Metric::FlipMean,
                limit: 0.1
            }]
    );
    assert!(
        one.notes[0].contains("3 iterations instead of 4"),
        "{:?}",
        one.notes
    );
}

#[test]
fn without_a_budget_nothing_goes() {
    let plan = original(
        "@fragment fn fs() -> @location(0) vec4<f32> { var s = 0.0; for (var i = 0; i < 4; i++) { \
         s += 1.0; } return vec4(s); }",
    );
    let error = trimmed(&plan, &TrimLoopParams::default()).unwrap_err();
    assert!(error.contains("no-budget"), "{error}");
}

#[test]
fn what_decides_more_than_a_colour_stays() {
    let loops = |before: &str, after: &str| {
        reason(&format!(
            "@group(0) @binding(0) var<storage, read_write> log: array<f32>;
            {before}
            @fragment fn fs(@location(0) x: f32) -> @location(0) vec4<f32> {{
                var s = x;
                {after}
                return vec4(s);
            }}"
        ))
    };
    let counted = "for (var i = 0; i < 4; i++) { s += sin(s); }";
    assert!(loops("", &format!("{counted} if s > 2.0 {{ discard; }}")).contains("discard"));
    assert!(
        loops("", "for (var i = 0; i < 4; i++) { s += 1.0; log[i] = s; }")
            .contains("writes memory")
    );
    assert!(loops("", "for (var i = 0; f32(i) < x; i++) { s += 1.0; }").contains("not a constant"));
    assert!(loops("", "for (var i = 0; i < 1; i++) { s += 1.0; }").contains("one iteration"));
    let shared = reason(
        "fn wave(x: f32) -> f32 { var s = x; for (var i = 0; i < 4; i++) { \
         s += sin(s); } return s; }
        @vertex fn other(@location(0) p: f32) -> @builtin(position) vec4<f32> { \
            return vec4(wave(p)); }
        @fragment fn fs(@location(0) x: f32) -> @location(0) vec4<f32> { return vec4(wave(x)); }",
    );
    assert!(shared.contains("vertex stage"), "{shared}");
}

/// The last light is a light like the first: no turn over the scene's own data goes, however the
/// counter gets there.
#[test]
fn a_loop_over_the_scene_stays_unless_its_turns_ebb_away() {
    let head = "struct Light { at: vec4<f32>, color: vec4<f32> }
        struct Scene { lights: array<Light, 8>, weights: array<vec4<f32>, 8> }
        @group(0) @binding(0) var<uniform> scene: Scene;
        @group(0) @binding(1) var<storage, read> more: array<Light>;
        @group(0) @binding(2) var rows: texture_2d<f32>;
        @group(0) @binding(3) var layers: texture_2d_array<f32>;
        @group(0) @binding(4) var s: sampler;
        fn lit(i: i32) -> f32 { return scene.lights[i].color.x; }
        fn shaded(l: Light) -> f32 { return l.color.x * l.at.y; }";
    let body = |term: &str| {
        format!(
            "{head} @fragment fn fs(@location(0) x: f32) -> @location(0) vec4<f32> {{
                var sum = x; var weight = 1.0;
                for (var i = 0; i < 4; i++) {{ {term} }}
                return vec4(sum);
            }}"
        )
    };
    for (term, read) in [
        ("sum += scene.lights[i].color.x;", "scene"),
        ("let light = more[i * 2]; sum += shaded(light);", "more"),
        ("sum += lit(i);", "scene"),
        (
            "let j = i + 1; sum += textureLoad(rows, vec2(j, 0), 0).x;",
            "rows",
        ),
        (
            "sum += textureSampleLevel(layers, s, vec2(x), i, 0.0).x;",
            "layers",
        ),
        // What shrinks begins anew in each turn, or ebbs away within one.
        (
            "var d = x + f32(i); d *= 0.5; sum += d * scene.lights[i].color.x;",
            "scene",
        ),
    ] {
        let why = reason(&body(term));
        assert!(
            why.contains(&format!("`{read}` by its counter")),
            "{term}: {why}"
        );
    }
    // Of a loop within, which may be cut, what shrinks says nothing of the one around it.
    let term = "weight = 1.0; for (var k = 0; k < 3; k++) { weight *= 0.5; \
                sum += weight * sin(x * f32(k)); } sum += scene.lights[i].color.x;";
    let inner = trimmed(&original(&body(term)), &params(1, None)).unwrap();
    let inner = text(&inner);
    assert!(inner.contains("< 4i") && inner.contains("< 2i"), "{inner}");
    // A weight that shrinks, or data that no counter reads.
    for term in [
        "sum += weight * scene.lights[i].color.x; weight *= 0.5;",
        "sum += weight * scene.lights[i].color.x; weight = weight / 2.0;",
        "sum += scene.lights[0].color.x * sin(x * f32(i));",
    ] {
        assert!(
            trimmed(&original(&body(term)), &params(1, None)).is_ok(),
            "{term}"
        );
    }
    // Nothing says that this one ebbs away, and that is told.
    let note = |term: &str| {
        trimmed(&original(&body(term)), &params(1, None))
            .unwrap()
            .notes[0]
            .clone()
    };
    assert!(note("sum += sin(x * f32(i));").contains("may add as much"));
    assert!(!note("sum += weight * sin(x * f32(i)); weight *= 0.5;").contains("may add as much"));
}

/// `i *= -2` goes to and fro: each of its values but the last is passed on the way back.
#[test]
fn a_loop_without_a_bound_for_less_turns_stays() {
    let alone = "@fragment fn fs(@location(0) x: f32) -> @location(0) vec4<f32> {
        var s = 0.0; for (var i = 1; i < 10; i *= -2) { s += x; } return vec4(s); }";
    let stays = reason(alone);
    assert!(stays.contains("no other bound"), "{stays}");
    let beside = alone.replace("return", "for (var j = 0; j < 4; j++) { s += x; } return");
    let found = TrimLoop::run(&original(&beside), &Facts::default(), &params(1, None)).unwrap();
    assert!(found.change.what.contains("3 iterations instead of 4"));
    assert_eq!(
        found.change.what.matches("instead of").count(),
        2,
        "{found:#?}"
    );
    assert_eq!(found.left.len(), 1);
}

#[test]
fn loops_that_do_not_decide_the_discard_go() {
    let plan = original(
        "@fragment fn fs(@location(0) x: f32) -> @location(0) vec4<f32> {
            if x > 2.0 { discard; }
            var s = x;
            for (var i = 0; i < 4; i++) { s += sin(s); }
            return vec4(s);
        }",
    );
    let less = trimmed(&plan, &params(1, None)).unwrap();
    insta::assert_snapshot!(text(&less));
}
