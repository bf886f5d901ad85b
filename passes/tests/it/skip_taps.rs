//! What is left of a sum when its small terms go: which texels are read, what comes out, and what
//! stays.

use std::cell::RefCell;
use std::collections::BTreeMap;

use naga::ShaderStage;
use naga_interp::{Environment, Scalar, Value};
use preshade_passes::transforms::skip_taps::{SkipTaps, SkipTapsParams};
use preshade_plan::budget::{Budget, Metric};
use preshade_plan::contract::Assumption;
use preshade_plan::pass::{Facts, MaterialTexture, Pass};
use preshade_plan::plan::Plan;
use preshade_plan::state::MaterialState;

use crate::common;

const HEAD: &str = "
struct Weights { w: vec4<f32> }
@group(0) @binding(0) var<uniform> u: Weights;
@group(1) @binding(0) var s: sampler;
@group(1) @binding(1) var a: texture_2d<f32>;
@group(1) @binding(2) var b: texture_2d<f32>;
@group(1) @binding(3) var c: texture_2d<f32>;
@vertex fn vs(@location(0) p: vec3<f32>) -> @builtin(position) vec4<f32> { return vec4(p, 1.0); }
fn level(map: texture_2d<f32>, uv: vec2<f32>) -> vec4<f32> { \
    return textureSampleLevel(map, s, uv, 0.0); }
";

fn original(fragment: &str) -> Plan {
    let program = common::program(&format!("{HEAD}{fragment}"));
    Plan::original("test", program, "vs", Some("fs"), &MaterialState::default())
}

fn params(threshold: f64, budget: Option<f64>) -> SkipTapsParams {
    SkipTapsParams {
        threshold,
        budget,
        ..SkipTapsParams::default()
    }
}

fn skipped(plan: &Plan, params: &SkipTapsParams) -> Result<Plan, String> {
    match SkipTaps::run(plan, &Facts::default(), params) {
        Ok(done) => Ok(done.plan),
        Err(refused) => Err(refused.first().to_string()),
    }
}

fn text(plan: &Plan) -> String {
    common::wgsl(plan.program(plan.main().unwrap()).unwrap())
}

/// The red that a fragment stage without inputs writes under these weights, and the textures that
/// it looked into, by their bindings: 1, 2 and 3 hold a tenth of that.
fn drawn(plan: &Plan, weights: [f32; 4]) -> (f32, Vec<u32>) {
    let program = plan.program(plan.main().unwrap()).unwrap();
    let (entry, _) = program.entry_point(ShaderStage::Fragment, "fs").unwrap();
    let looked = RefCell::new(Vec::new());
    let weights = Value::Composite(weights.map(Value::f32).to_vec());
    let environment = Environment {
        resources: BTreeMap::from([((0, 0), Value::Composite(vec![weights]))]).into(),
        texture: &|lookup| {
            let (_, binding) = lookup.binding.unwrap();
            looked.borrow_mut().push(binding);
            [0.1 * binding as f32; 4]
        },
        derivative: None,
        trace: None,
        steps: 10_000,
    };
    let outcome = naga_interp::entry_point(program.module(), entry, &[], &environment).unwrap();
    let red = match outcome.result {
        Some(Value::Composite(parts)) => match parts[0] {
            Value::Scalar(Scalar::F32(red)) => red,
            _ => panic!("{parts:?}"),
        },
        other => panic!("{other:?}"),
    };
    (red, looked.into_inner())
}

/// Sums of three terms, as they are written.
const SUMS: [&str; 6] = [
    "return u.w.x * level(a, vec2(0.5)) + u.w.y * level(b, vec2(0.5)) + u.w.z * level(c, \
     vec2(0.5));",
    "var sum = level(a, vec2(0.5)).rgb * u.w.x; sum += level(b, vec2(0.5)).rgb * u.w.y; \
     sum += textureSampleLevel(c, s, vec2(0.5), 0.0).rgb * u.w.z; return vec4(sum, 1.0);",
    "let x = textureSampleLevel(a, s, vec2(0.5), 0.0); \
     let y = textureSampleLevel(b, s, vec2(0.5), 0.0); \
     let z = textureSampleLevel(c, s, vec2(0.5), 0.0);
     let w = u.w; return x * w.x + y * w.y + z * w.z;",
    "return vec4(dot(vec3(level(a, vec2(0.5)).r, level(b, vec2(0.5)).g, level(c, vec2(0.5)).b), \
     u.w.xyz));",
    "return fma(vec4(u.w.x), level(a, vec2(0.5)), fma(level(b, vec2(0.5)), vec4(u.w.y), u.w.z * \
     level(c, vec2(0.5)) + vec4(0.0)));",
    "var sum = vec4(0.0); for (var i = 0; i < 1; i++) { sum += u.w.x * level(a, vec2(0.5)); \
     if i == 0 { sum += u.w.y * level(b, vec2(0.5)) + u.w.z * level(c, vec2(0.5)); } } return sum;",
];

#[test]
fn every_way_to_write_a_sum_loses_its_small_terms_and_no_other() {
    for body in SUMS {
        let plan = original(&format!(
            "@fragment fn fs() -> @location(0) vec4<f32> {{ {body} }}"
        ));
        let less = skipped(&plan, &params(0.1, Some(0.1))).unwrap();
        for mask in 0..8_u32 {
            let big = |bit: u32| mask & (1 << bit) != 0;
            let weight = |bit: u32| if big(bit) { 0.5 } else { -0.05 };
            let weights = [weight(0), weight(1), weight(2), 0.0];
            let (_, looked) = drawn(&plan, weights);
            assert_eq!(looked.len(), 3, "{body}");
            let (red, mut looked) = drawn(&less, weights);
            looked.sort_unstable();
            let expected: Vec<u32> = (0..3).filter(|b| big(*b)).map(|b| b + 1).collect();
            assert_eq!(looked, expected, "{body}, {weights:?}\n{}", text(&less));
            let sum: f32 = expected.iter().map(|b| 0.5 * 0.1 * *b as f32).sum();
            assert!((red - sum).abs() < 1e-6, "{body}, {weights:?}: {red}");
        }
    }
}

#[test]
fn a_threshold_of_nothing_leaves_the_sum() {
    for body in SUMS {
        let plan = original(&format!(
            "@fragment fn fs() -> @location(0) vec4<f32> {{ {body} }}"
        ));
        let less = skipped(&plan, &params(0.0, None)).unwrap();
        // A weight of NaN is no 0.
        for weights in [
            [0.0, 0.3, 0.7, 0.0],
            [1.0, 0.0, 0.0, 0.0],
            [-0.0, 1e-30, -0.4, 0.0],
            [f32::NAN, 0.0, 1.0, 0.0],
        ] {
            let [(before, _), (after, looked)] = [&plan, &less].map(|p| drawn(p, weights));
            let same = before == after || before.is_nan() && after.is_nan();
            assert!(same, "{body}, {weights:?}: {before}, {after}");
            let zeros = weights[..3].iter().filter(|w| **w == 0.0).count();
            assert!(looked.len() == 3 - zeros, "{body}, {weights:?}: {looked:?}");
        }
        let given = less.contract.given();
        assert!(
            given.contains(&Assumption::FiniteTaps),
            "{:?}",
            less.contract
        );
        assert!(less.contract.budgets().is_empty(), "{:?}", less.contract);
    }
}

/// Who tells the sign of a sum of zeros, or has an infinite term: the statements after the sum `s`.
#[test]
fn a_zero_that_somebody_tells_stays() {
    let rows = [
        // What is made of the sum, and whether the terms stay.
        ("return vec4(1.0 / s);", true),
        ("return vec4(u.w.x / (s * 2.0));", true),
        ("return vec4(atan2(s, -1.0));", true),
        ("return vec4(inverseSqrt(s));", true),
        ("return vec4(f32(bitcast<u32>(s) >> 31u));", true),
        (
            "let p = pack2x16float(vec2(s)); return vec4(unpack4x8unorm(p));",
            true,
        ),
        ("let q = min(floor(-s), 0.5); return vec4(1.0 / q);", true),
        (
            "var t = s; if u.w.w > 0.5 { t = t + t; } return vec4(1.0 / t);",
            true,
        ),
        ("return vec4(1.0 / twice(s));", true),
        ("return vec4(s);", false),
        ("return vec4(select(0.1, 0.9, s > 0.0));", false),
        ("return vec4(1.0 / (s + 0.25));", false),
        ("return vec4(1.0 / (1.0 + s * s));", false),
        ("return vec4(1.0 / abs(s));", false),
        (
            "return vec4(1.0 / exp2(s), length(vec2(s)), f32(i32(s)), 1.0);",
            false,
        ),
    ];
    for (body, stays) in rows {
        let plan = original(&format!(
            "fn twice(x: f32) -> f32 {{ return x * 2.0; }}
            @fragment fn fs() -> @location(0) vec4<f32> {{
                let s = u.w.x * (level(a, vec2(0.5)).x - 1.5) + u.w.y * level(b, vec2(0.5)).x;
                {body}
            }}"
        ));
        assert_eq!(skipped(&plan, &params(0.0, None)).is_err(), stays, "{body}");
        // A budget is measured.
        assert!(skipped(&plan, &params(0.0, Some(0.1))).is_ok(), "{body}");
    }
}

#[test]
fn a_term_that_may_be_infinite_stays() {
    let rows = [
        ("1.0 / level(a, vec2(0.5))", true),
        ("log(level(a, vec2(0.5)))", true),
        ("sqrt(level(a, vec2(0.5)) - 0.5)", true),
        ("pow(level(a, vec2(0.5)), u.w)", true),
        ("vec4(normalize(level(a, vec2(0.5)).xyz - 0.5), 1.0)", true),
        ("sqrt(level(a, vec2(0.5)))", false),
        ("level(a, vec2(0.5) / u.w.xy) * 2.0 - 1.0", false),
        ("1.0 / (level(a, vec2(0.5)) + 0.5)", false),
    ];
    for (tap, stays) in rows {
        let plan = original(&format!(
            "@fragment fn fs() -> @location(0) vec4<f32> {{
                return u.w.x * ({tap}) + vec4(0.25);
            }}"
        ));
        assert_eq!(skipped(&plan, &params(0.0, None)).is_err(), stays, "{tap}");
    }
    // A texture that holds such a number.
    let body = "return u.w.x * level(a, vec2(0.5)) + u.w.y * level(b, vec2(0.5));";
    let plan = original(&format!(
        "@fragment fn fs() -> @location(0) vec4<f32> {{ {body} }}"
    ));
    let facts = |binding: u32| Facts {
        infinite_textures: vec![MaterialTexture {
            material: plan.material.clone(),
            group: 1,
            binding,
        }],
        ..Facts::default()
    };
    let left = |binding: u32| {
        let done = SkipTaps::run(&plan, &facts(binding), &params(0.0, None)).unwrap();
        done.left
            .iter()
            .filter(|l| l.reason.contains("its texture holds"))
            .count()
    };
    assert_eq!([1, 2, 9].map(left), [1, 1, 0]);
}

#[test]
fn a_mix_is_two_terms() {
    let plan = original(
        "@fragment fn fs() -> @location(0) vec4<f32> {
            let rock = level(a, vec2(0.5));
            let both = mix(rock, level(b, vec2(0.5)), u.w.x);
            return mix(both, level(c, vec2(0.5)), u.w.y);
        }",
    );
    let less = skipped(&plan, &params(0.1, Some(0.1))).unwrap();
    let looked = |x: f32, y: f32| {
        let (red, mut looked) = drawn(&less, [x, y, 0.0, 0.0]);
        looked.sort_unstable();
        let (whole, _) = drawn(&plan, [x, y, 0.0, 0.0]);
        assert!((red - whole).abs() <= 0.1 * 0.3, "{red} of {whole}");
        looked
    };
    assert_eq!(looked(0.5, 0.5), [1, 2, 3]);
    assert_eq!(looked(0.95, 0.5), [2, 3]);
    assert_eq!(looked(0.05, 0.5), [1, 3]);
    assert_eq!(looked(0.5, 0.0), [1, 2]);
    // What is in a term goes with it, though its own weights are large.
    assert_eq!(looked(0.5, 1.0), [3]);
}

#[test]
fn implicit_levels_become_gradients_taken_ahead() {
    let plan = original(
        "fn triplanar(map: texture_2d<f32>, p: vec3<f32>, w: vec3<f32>) -> vec3<f32> {
            let x = textureSample(map, s, p.zy).rgb;
            let y = textureSample(map, s, p.xz).rgb;
            let z = textureSample(map, s, p.xy).rgb;
            return x * w.x + y * w.y + z * w.z;
        }
        @fragment fn fs(@location(0) p: vec3<f32>) -> @location(0) vec4<f32> {
            return vec4(triplanar(a, p, u.w.xyz), 1.0);
        }",
    );
    let less = skipped(&plan, &params(0.02, Some(0.01))).unwrap();
    insta::assert_snapshot!(text(&less));
    assert!(
        less.contract.budgets()
            == [Budget {
                metric: Metric::FlipMean,
                limit: 0.01
            }]
    );
    // Even where only products with 0 go: adapters make other levels of gradients.
    let error = skipped(&plan, &params(0.0, None)).unwrap_err();
    assert!(
        error.contains("no-budget") && error.contains("implicit"),
        "{error}"
    );
}

#[test]
fn what_cannot_go_is_told() {
    let reasons = |fragment: &str| -> Vec<String> {
        let found = SkipTaps::run(
            &original(fragment),
            &Facts::default(),
            &params(0.1, Some(0.1)),
        )
        .unwrap_err();
        assert_eq!(found.refusals[0].code, "no-tap");
        found.left.into_iter().map(|l| l.reason).collect()
    };
    let stays = |body: &str, why: &str| {
        let told = reasons(&format!(
            "fn implicit(uv: vec2<f32>) -> vec4<f32> {{ return textureSample(a, s, uv); }}
            @fragment fn fs(@location(0) uv: vec2<f32>) -> @location(0) vec4<f32> {{ {body} }}"
        ));
        assert!(told.iter().any(|r| r.contains(why)), "{body}: {told:?}");
    };
    stays(
        "let x = level(a, uv); return x * (u.w.x * x.r) + u.w;",
        "another use",
    );
    stays("return implicit(uv) * u.w.x + u.w;", "implicit level");
    stays(
        "return textureSampleBias(a, s, uv, 1.0) * u.w.x + u.w;",
        "bias",
    );
    stays(
        "var x = level(a, uv); if uv.x > 0.5 { x = u.w; } return x * u.w.x + u.w;",
        "variable",
    );
    stays(
        "let x = u.w.x * level(a, uv) + u.w; if x.a < 0.5 { discard; } return x;",
        "discard",
    );
    stays(
        "let x = level(a, uv); if uv.x > 0.5 { return u.w.x * x + u.w; } return u.w;",
        "another block",
    );
    // A constant weighs every fragment alike.
    assert!(
        reasons(
            "@fragment fn fs() -> @location(0) vec4<f32> { \
             return 0.5 * level(a, vec2(0.5)) + u.w; }"
        )
        .is_empty()
    );
    let shared = reasons(
        "fn wave(p: f32) -> f32 { return u.w.x * level(a, vec2(p)).r + p; }
        @vertex fn other(@location(0) p: f32) -> @builtin(position) vec4<f32> { \
            return vec4(wave(p)); }
        @fragment fn fs(@location(0) p: f32) -> @location(0) vec4<f32> { return vec4(wave(p)); }",
    );
    assert!(shared[0].contains("vertex stage"), "{shared:?}");
}

#[test]
fn a_budget_is_asked_for_and_functions_are_named() {
    let plan = original(
        "fn grass(p: vec2<f32>) -> vec4<f32> { return u.w.x * level(a, p) + u.w; }
        fn rock(p: vec2<f32>) -> vec4<f32> { return u.w.x * level(b, p) + u.w; }
        @fragment fn fs(@location(0) p: vec2<f32>) -> @location(0) vec4<f32> { \
            return grass(p) + rock(p); }",
    );
    let error = skipped(&plan, &params(0.1, None)).unwrap_err();
    assert!(error.contains("no-budget"), "{error}");
    let of = |names: &str| SkipTapsParams {
        of: Some(names.to_owned()),
        ..params(0.1, Some(0.1))
    };
    let one = skipped(&plan, &of("rock")).unwrap();
    assert_eq!(text(&one).matches("if ").count(), 1, "{}", text(&one));
    let both = skipped(&plan, &of("rock + grass")).unwrap();
    assert_eq!(text(&both).matches("if ").count(), 2, "{}", text(&both));
    let error = skipped(&plan, &of("sand")).unwrap_err();
    assert!(error.contains("calls no `sand`"), "{error}");
    assert!(one.notes[0].contains("a term of a sum"), "{:?}", one.notes);
}
