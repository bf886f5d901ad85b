//! What specialising leaves, what it assumes, and that with those values it computes the same.

use naga_interp::Value;
use preshade_passes::transforms::specialize::{Fold, Specialize, SpecializeParams, as_drawn};
use preshade_plan::contract::{Contract, Surface};
use preshade_plan::guard::{Assumed, Bounds, Place, ScalarType};
use preshade_plan::pass::{Constant, Facts, Pass};
use preshade_plan::plan::Plan;

use crate::common;
use crate::common::specialized::{
    facts_of_texture, original, ran, set, specialized, specialized_with, text,
};

const LIT: &str = "
struct Material { flags: u32, fog: f32, lights: u32, coat: f32, color: vec4<f32>, mode: i32 }
@group(0) @binding(0) var<uniform> material: Material;
@group(0) @binding(1) var normal_map: texture_2d<f32>;
@group(0) @binding(2) var map_sampler: sampler;
const NORMAL: u32 = 1u;
const CUTOUT: u32 = 2u;
struct Varyings { @builtin(position) position: vec4<f32>, @location(0) normal: vec3<f32>, \
    @location(1) uv: vec2<f32>, @location(2) distance: f32 }
fn has(flag: u32) -> bool { return (material.flags & flag) != 0u; }
fn light(n: vec3<f32>, i: u32) -> f32 { return max(dot(n, normalize(vec3(f32(i), 1.0, 0.5))), \
    0.0); }
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>, \
    @location(2) uv: vec2<f32>) -> Varyings {
    return Varyings(vec4(position, 1.0), normal, uv, length(position));
}
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {
    var n = normalize(in.normal);
    if has(NORMAL) { n = normalize(n + textureSample(normal_map, map_sampler, in.uv).xyz); }
    if has(CUTOUT) && material.color.a < 0.5 { discard; }
    var sum = vec3(0.0);
    for (var i = 0u; i < material.lights; i++) { sum += light(n, i) * material.color.rgb; }
    switch material.mode { case 1: { sum = sum.zyx; } case 2: { sum *= 2.0; } default: { \
        sum += 0.1; } }
    sum = mix(sum, vec3(1.0), material.coat);
    if material.fog > 0.0 { sum = mix(sum, vec3(0.5), 1.0 - exp(-material.fog * in.distance)); }
    return vec4(sum, material.color.a);
}
";

#[test]
fn everything_off() {
    let params = set("flags=0+fog=0+lights=0+mode=7");
    let plan = specialized(&original(LIT), &params).unwrap();
    insta::assert_snapshot!(text(&plan));
    let main = plan.main().unwrap();
    let names: Vec<&str> = main.bindings.iter().map(|b| b.name.as_str()).collect();
    assert_eq!(names, ["material"]);
    assert!(main.attributes.iter().all(|a| a.name != "uv"));
    assert_eq!(plan.contract.kind(), "rounding");
    assert_eq!(plan.fallback.as_deref(), Some("original"));
}

/// What is promised of a fragment stage with this body, and of a vertex stage whose position is
/// this, when the uniform `flag` is known to be 0.
fn promised(position: &str, body: &str) -> Contract {
    promised_with("flag=0", position, body)
}

fn promised_with(known: &str, position: &str, body: &str) -> Contract {
    let source = format!(
        "struct U {{ flag: u32, a: vec4<f32>, b: vec4<f32>, c: vec4<f32> }}
@group(0) @binding(0) var<uniform> u: U;
struct V {{ @builtin(position) position: vec4<f32>, @location(0) t: vec4<f32> }}
@vertex fn vs(@location(0) p: vec4<f32>) -> V {{
    var at = p * u.b;
    {position}
    return V(at, p);
}}
@fragment fn fs(@location(0) t: vec4<f32>) -> @location(0) vec4<f32> {{ {body} }}"
    );
    specialized(&original(&source), &set(known))
        .unwrap()
        .contract
}

/// A compiler fuses and reorders by what it sees around an operation. Where that stays as it was
/// the bits do; where it changes no text can promise them.
#[test]
fn exact_is_promised_where_nothing_around_a_float_operation_changes() {
    let exact = |body: &str| assert_eq!(promised("", body).kind(), "exact", "{body}");
    // What is read by no other operation is rounded by itself.
    exact("var x = t * u.a; if u.flag > 0u { x = x + u.b; } return x;");
    exact("if u.flag > 0u { return t * u.c + u.b; } return t * u.a + u.b;");
    // Neither of the two values that meet is an operation, nor is a constant.
    exact("var x = t; if u.flag > 0u { x = u.b; } return x * u.c;");
    exact("return select(t * u.a + u.b, u.c, u.flag > 0u);");
    let rounds = |body: &str, most: u32| match promised("", body) {
        Contract::Rounding { k, turned, .. } => {
            assert!((1..=most).contains(&k), "{k}: {body}");
            turned
        }
        other => panic!("{other:?}: {body}"),
    };
    let nothing_turns = |body: &str| assert_eq!(rounds(body, 2), None, "{body}");
    // One of two values, and then a product alone: it may be fused.
    nothing_turns("var x = t * u.a; if u.flag > 0u { x = u.c; } return x + u.b;");
    // Two blocks, and then one.
    nothing_turns("let x = t * u.a; if u.flag > 0u { discard; } return x + u.b;");
    // A reader less.
    nothing_turns("let x = t * u.a; let y = x + u.b; if u.flag > 0u { return x - y; } return y;");
    // A constant that may be multiplied out.
    nothing_turns("var x = vec4(3.0); if u.flag > 0u { x = u.c; } return t / x;");
    // The same sum decides.
    let decided =
        "var x = t * u.a; if u.flag > 0u { x = u.c; } if (x + u.b).x < 0.5 { discard; } return t;";
    let turned = rounds(decided, 2).unwrap();
    assert_eq!(turned.surface, Surface::Kept);
    assert!(turned.share > 0.0 && turned.share < 1e-4, "{turned:?}");
}

/// A compiler may write out the iterations of a loop if constants say how many there are, and fuse across them.
#[test]
fn a_loop_whose_iterations_become_constant_may_round_otherwise() {
    let kind = |known: &str, body: &str| promised_with(known, "", body).kind();
    for body in [
        "var x = t; for (var i = 0u; i < u.flag; i++) { x = x * u.a + u.b; } return x;",
        "var x = t; for (var i = 0u; i < 16u; i++) { if i >= u.flag { break; } x += u.a; } return x;",
        "var x = t; var i = 0u; loop { x += u.a; i++; continuing { break if i >= u.flag; } } return x * u.b;",
        "var x = t; for (var i = 0u; i < u.flag && x.y < 9.0; i++) { x += u.a; } return x + u.b;",
    ] {
        assert_eq!(kind("flag=9", body), "rounding", "{body}");
    }
    let constant = "var x = t; for (var i = 0u; i < 9u; i++) { x = x * u.a + u.b; } \
                    if u.flag > 0u { x = u.c; } return x;";
    assert_eq!(kind("flag=0", constant), "exact");
}

#[test]
fn a_position_that_may_round_otherwise_is_told() {
    let moved = "if u.flag > 0u { at = u.a; } at = at + u.c;";
    let Contract::Rounding {
        turned: Some(turned),
        ..
    } = promised(moved, "return t;")
    else {
        panic!("a position is promised its bits");
    };
    assert_eq!(turned.surface, Surface::Rounded);
    let still = "if u.flag > 0u { at = u.a; }";
    assert_eq!(promised(still, "return t;").kind(), "exact");
}

#[test]
fn some_on() {
    let params = set("flags=1+fog=0.25+lights=2+mode=2+coat=0");
    let plan = specialized(&original(LIT), &params).unwrap();
    insta::assert_snapshot!(text(&plan));
    let guard = plan.guard.unwrap();
    let names: Vec<String> = guard.values.iter().map(ToString::to_string).collect();
    // A weight that no branch tests decides nothing exactly.
    let expected = [
        "material.flags = 1",
        "material.fog = 0.25",
        "material.lights = 2",
        "material.mode = 2",
    ];
    assert_eq!(names, expected);
}

#[test]
fn many_lights_stay_a_loop_with_a_literal_bound() {
    let plan = specialized(&original(LIT), &set("lights=30")).unwrap();
    let text = text(&plan);
    assert!(text.contains("< 30u"), "{text}");
}

#[test]
fn a_weight_of_nothing_goes_where_floats_may_be_folded() {
    let params = SpecializeParams {
        fold: Fold::Rounding,
        ..set("coat=0")
    };
    let plan = specialized(&original(LIT), &params).unwrap();
    assert_eq!(plan.contract.kind(), "rounding");
    assert!(!text(&plan).contains("material.coat"), "{}", text(&plan));
    let refused = specialized(&original(LIT), &set("coat=0"))
        .map(|p| text(&p))
        .unwrap_err();
    assert!(refused.contains("nothing-known"), "{refused}");
}

#[test]
fn a_zero_stays_in_a_sum_whose_sign_somebody_tells() {
    let rows = [
        ("return vec4(1.0 / (-max(i.x, 0.0) + u.b));", false),
        ("return vec4(atan2(u.b - max(i.x, 0.0), -1.0));", false),
        ("return vec4(atan2(u.b * i.x, -1.0));", false),
        ("let q = -(i * u.b); return vec4(1.0 / q.y);", false),
        ("return vec4(0.3 + i.x * u.b);", true),
        (
            "return vec4(atan2(max(i.x, 0.0) * -2.0 - u.b, -1.0));",
            false,
        ),
        ("return vec4(i.x + u.b);", true),
        ("return vec4(1.0 / (abs(i.x) + 1.0 + u.b));", true),
        ("return vec4(mix(0.3, 1.0 / i.x, u.b));", false),
        ("return vec4(mix(0.3, i.x, u.b));", true),
    ];
    for (body, folds) in rows {
        let text = format!(
            "struct U {{ a: f32, b: f32 }}
@group(0) @binding(0) var<uniform> u: U;
struct V {{ @builtin(position) p: vec4<f32>, @location(0) i: vec2<f32> }}
@vertex fn vs(@location(0) p: vec4<f32>) -> V {{ return V(p, p.xy); }}
@fragment fn fs(v: V) -> @location(0) vec4<f32> {{ let i = v.i; {body} }}"
        );
        let params = SpecializeParams {
            fold: Fold::Rounding,
            ..set("b=0")
        };
        let done = specialized(&original(&text), &params);
        assert_eq!(done.is_ok(), folds, "{body}");
    }
}

/// Original and variant are counted with what the draws are known to run.
#[test]
fn code_that_no_draw_runs_saves_nothing() {
    let source = |mode: &str, steps: &str| {
        original(&format!(
            "struct U {{ mode: u32, steps: i32 }}
@group(0) @binding(0) var<uniform> u: U;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> {{ return p; }}
@fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {{
    var x = p.x;
    if {mode} == 1u {{ for (var i = 0; i < 30; i++) {{ x = sin(x) + cos(x); }} }}
    for (var i = 0; i < {steps}; i++) {{ x = sqrt(x) * 0.5; }}
    return vec4(x);
}}"
        ))
    };
    let plan = source("u.mode", "u.steps");
    let constant = |offset: u32, ty: ScalarType, value: f64| Constant {
        material: plan.material.clone(),
        value: Assumed {
            name: String::new(),
            place: Place::Uniform {
                group: 0,
                binding: 0,
                offset,
            },
            ty,
            bounds: Bounds::one(value),
        },
    };
    let facts = |mode: f64, steps: f64| Facts {
        constants: vec![
            constant(0, ScalarType::U32, mode),
            constant(4, ScalarType::I32, steps),
        ],
        ..Facts::default()
    };
    let cost = |plan: &Plan, facts: &Facts| {
        let pass = plan.main().unwrap();
        let program = plan.program(pass).unwrap();
        let (entry, _) = program
            .entry_point(naga::ShaderStage::Fragment, "fs")
            .unwrap();
        as_drawn(program, pass, &plan.material, facts).entry_cost(entry)
    };
    for (mode, steps) in [(0.0, 50.0), (1.0, 50.0), (0.0, 3.0), (1.0, 100.0)] {
        let facts = facts(mode, steps);
        let done = Specialize::run(&plan, &facts, &SpecializeParams::default()).unwrap();
        let [drawn, left] = [&plan, &done.plan].map(|plan| cost(plan, &facts));
        // The original reads uniforms and compares them, and that is all that it does more.
        let said = format!("{mode}, {steps}: {drawn}, {left}");
        assert!(left <= drawn && left >= 0.4 * drawn, "{said}");
        let branch = 30.0 * mode;
        assert!(
            drawn > 5.0 * (steps + branch) && drawn < 13.0 * (steps + branch) + 10.0,
            "{said}"
        );
        let saved = done.change.cost.slice;
        assert!((saved - (drawn - left)).abs() < 1e-9, "{said}: {saved}");
    }
}

#[test]
fn what_does_not_fit_is_refused_with_what_would() {
    let refused = |values: &str| {
        specialized(&original(LIT), &set(values))
            .map(|p| text(&p))
            .unwrap_err()
    };
    assert!(refused("fgo=0").contains("is named `fgo`"));
    assert!(refused("flags=0.5").contains("cannot be 0.5"));
    assert!(refused("flags").contains("is not `name=number`"));
    assert!(refused("flags=1+flags=2").contains("`material.flags` is given twice"));
    // Nor by two steps: no value would be let through by both.
    let once = specialized(&original(LIT), &set("flags=1")).unwrap();
    let twice = specialized(&once, &set("flags=2"));
    assert!(twice.is_err_and(|why| why.contains("material.flags") || why.contains("no branch")));
}

/// What the adapter may round either way is not decided.
#[test]
fn a_comparison_within_a_rounding_stays() {
    let source = |condition: &str| {
        format!(
            "struct U {{ a: f32, b: f32, n: u32 }}
@group(0) @binding(0) var<uniform> u: U;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> {{ return p; }}
@fragment fn fs() -> @location(0) vec4<f32> {{
    if {condition} {{ return vec4(1.0); }}
    return vec4(u.b);
}}"
        )
    };
    let folds = |condition: &str, values: &str| {
        specialized(&original(&source(condition)), &set(values)).is_ok()
    };
    assert!(folds("u.a > 0.0", "a=0"));
    assert!(folds("u.a * u.b > 0.0", "a=0+b=3"));
    assert!(folds("u.a * u.b > 0.5", "a=2+b=3"));
    // 0.1 * 3 is 0.3 only to within a rounding.
    assert!(!folds("u.a * u.b > 0.3", "a=0.1+b=3"));
    // A denormal may be flushed to 0.
    assert!(!folds("u.a > 0.0", "a=1e-40"));
    assert!(folds("u.a >= 0.0", "a=1e-40"));
    assert!(!folds("1.0 / u.a > 0.0", "a=0"));
    // Wrapping integers are not followed.
    assert!(!folds("u.n + 4294967295u > 3u", "n=2"));
}

#[test]
fn an_override_takes_its_value() {
    let source = "
override FANCY: bool = true;
override OCTAVES: u32 = 8u;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }
@fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {
    var sum = 0.0;
    if FANCY { for (var i = 0u; i < OCTAVES; i++) { sum += sin(p.x * f32(i)); } }
    return vec4(sum);
}";
    let plan = specialized(&original(source), &set("FANCY=0")).unwrap();
    let without = text(&plan);
    assert!(
        !without.contains("sin") && !without.contains("FANCY"),
        "{without}"
    );
    let plan = specialized(&original(source), &set("OCTAVES=2")).unwrap();
    let two = text(&plan);
    assert!(!two.contains("loop") && two.contains("if FANCY"), "{two}");
}

/// A material whose fragment stage has this body, of a uniform `u` and an input `p`.
fn material(functions: &str, body: &str) -> String {
    format!(
        "struct U {{ k: u32, index: u32, other: u32, w: f32, v: vec4<f32>, m: mat2x2<f32> }}
@group(0) @binding(0) var<uniform> u: U;
@group(0) @binding(1) var white: texture_2d<f32>;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> {{ return p; }}
{functions}
@fragment fn fs(@location(0) p: vec4<f32>) -> @location(0) vec4<f32> {{ {body} }}"
    )
}

/// The content of `u`.
fn uniform([k, index, other]: [u32; 3], w: f32) -> Value {
    let vector =
        |count: usize| Value::Composite((0..count).map(|i| Value::f32(i as f32 + 0.5)).collect());
    Value::Composite(vec![
        Value::u32(k),
        Value::u32(index),
        Value::u32(other),
        Value::f32(w),
        vector(4),
        Value::Composite(vec![vector(2), vector(2)]),
    ])
}

/// Names of what a plan assumes.
fn assumed(plan: &preshade_plan::plan::Plan) -> Vec<&str> {
    let guard = plan.guard.as_ref().unwrap();
    guard.values.iter().map(|v| v.name.as_str()).collect()
}

#[test]
fn variables_keep_what_they_begin_with() {
    for (ty, begins, read) in [
        ("vec3<f32>", "vec3(0.5, 0.2, 0.1)", "c"),
        ("vec3<f32>", "vec3(0.5)", "c"),
        ("vec3<f32>", "vec3(vec2(0.5, 0.25), 1.0)", "c"),
        (
            "mat2x3<f32>",
            "mat2x3(vec3(0.5), vec3(0.2, 0.3, 0.1))",
            "c[1]",
        ),
        (
            "array<vec3<f32>, 2>",
            "array(vec3(0.5), vec3(0.2, 0.3, 0.1))",
            "c[1]",
        ),
        ("S", "S(1.0, vec3(0.2, 0.3, 0.1))", "c.b"),
    ] {
        let body = format!(
            "var c: {ty} = {begins}; if u.k == 3u {{ {read}.x += p.x; }} return vec4({read}, 1.0);"
        );
        let plan = original(&material("struct S { a: f32, b: vec3<f32> }", &body));
        let next = specialized(&plan, &set("k=0")).unwrap();
        let content = uniform([0, 0, 0], 0.0);
        let p = [0.25, 0.5, 0.75, 1.0];
        let before = ran(&plan, &content, p).unwrap();
        assert_eq!(ran(&next, &content, p).unwrap(), before, "{}", text(&next));
    }
}

#[test]
fn what_was_folded_in_a_function_is_assumed_wherever_it_is_called() {
    // A loop is tried, and given up: what its turn called stays folded.
    let f = "fn f() -> f32 { if u.k == 0u { return 0.25; } return u.v.x; }
fn g() -> f32 { return f() + f(); }";
    let given_up = "var c = 0.0; for (var i = 0; i < i32(p.x); i++) { \
                    c += g(); } if u.other == 0u { c *= u.v.y; } return vec4(c);";
    let plan = specialized(&original(&material(f, given_up)), &set("k=0+other=0")).unwrap();
    assert_eq!(assumed(&plan), ["u.k", "u.other"]);
    let nested = "var s = 0.0; for (var i = 0u; i < u.index; i++) { for (var j = 0u; j < u32(p.x); \
                  j++) { if j == 3u { continue; } s += f(); } } return u.v * s;";
    let plan = specialized(&original(&material(f, nested)), &set("k=0+index=2")).unwrap();
    assert_eq!(assumed(&plan), ["u.k", "u.index"]);
    // It is all that folds.
    let alone = "var c = 0.0; for (var i = 0; i < i32(p.x); i++) { c += f(); } return vec4(c);";
    let plan = specialized(&original(&material(f, alone)), &set("k=0")).unwrap();
    assert_eq!(assumed(&plan), ["u.k"]);
}

#[test]
fn a_texel_is_known_within_its_texture_alone() {
    let refused = |load: &str| {
        let body = format!("if textureLoad(white, {load}).x > 0.5 {{ return u.v; }} return p;");
        let plan = original(&material("", &body));
        specialized_with(
            &plan,
            &facts_of_texture(1, 1.0),
            &SpecializeParams::default(),
        )
        .is_err()
    };
    // Every texture has this one.
    assert!(!refused("vec2(0, 0), 0"));
    // Beyond them a read gives 0, or any texel.
    assert!(refused("vec2<i32>(p.xy), 0"));
    assert!(refused("vec2(0, 0), i32(p.x)"));
    assert!(refused("vec2(1, 0), 0"));
    let body = "if textureLoad(white, vec2<i32>(p.xy), 0).x >= 0.0 { return u.v; } return p;";
    let plan = original(&material("", body));
    specialized_with(
        &plan,
        &facts_of_texture(1, 1.0),
        &SpecializeParams::default(),
    )
    .unwrap();
}

#[test]
fn nothing_is_decided_by_a_product_with_0_of_what_may_be_infinite() {
    let params = |values: &str| SpecializeParams {
        fold: Fold::Rounding,
        ..set(values)
    };
    let decides =
        "let x = 1.0 / (p.x - floor(p.x)); if !(u.w * x < 0.5) { return u.v; } return vec4(0.5);";
    let refused = specialized(&original(&material("", decides)), &params("u.w=0"))
        .map(|p| text(&p))
        .unwrap_err();
    assert!(refused.contains("nothing-known"), "{refused}");
    let converted = "return u.v * f32(i32(u.w * p.x) + 1) + f32(u.w * p.y > 0.0);";
    let refused = specialized(&original(&material("", converted)), &params("u.w=0"))
        .map(|p| text(&p))
        .unwrap_err();
    assert!(refused.contains("nothing-known"), "{refused}");
    // Of what is known to be finite a product with 0 is 0.
    let known = "if u.w * f32(u.k) < 0.5 { return u.v; } return vec4(0.5);";
    specialized(&original(&material("", known)), &set("u.w=0+k=7")).unwrap();
    // A weight still goes.
    let weight = "return mix(u.v, p, u.w * p.x);";
    let plan = specialized(&original(&material("", weight)), &params("u.w=0")).unwrap();
    assert!(!text(&plan).contains("mix"), "{}", text(&plan));
}

#[test]
fn a_rounding_that_was_folded_may_turn_what_rests_on_it() {
    let promised = |body: &str| {
        let params = SpecializeParams {
            fold: Fold::Rounding,
            ..set("u.w=1")
        };
        match specialized(&original(&material("", body)), &params)
            .unwrap()
            .contract
        {
            Contract::Rounding { turned, .. } => turned,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(promised("return mix(p, u.v, u.w);"), None);
    let turned = promised("let x = mix(p.x, p.y, u.w); if x > u.v.x { return p; } return u.v;");
    assert_eq!(turned.unwrap().surface, Surface::Kept);
}

#[test]
fn halves_are_not_read_as_floats() {
    for halves in ["a: vec2<f16>", "a: mat2x2<f16>"] {
        let read = if halves.contains("mat") {
            "u.a[1].x"
        } else {
            "u.a.y"
        };
        let source = format!(
            "enable f16;
struct U {{ {halves}, b: f32, c: f32, k: vec4<f32> }}
@group(0) @binding(0) var<uniform> u: U;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> {{ return p; }}
@fragment fn fs(@location(0) p: vec4<f32>) -> @location(0) vec4<f32> {{
    if f32({read}) > 0.5 {{ return p; }}
    return u.k;
}}"
        );
        let refused = specialized(&original(&source), &set("u.b=0+u.c=0"))
            .map(|p| text(&p))
            .unwrap_err();
        assert!(refused.contains("nothing-known"), "{refused}");
    }
}

#[test]
fn where_a_store_goes_is_assumed() {
    let body = "var a: array<u32, 4>; a[3] = u.k; a[u.index] = 0u; if a[3] == 1u { \
                return u.v; } return vec4(0.5);";
    let plan = original(&material("", body));
    // Within bounds it is decided, and beyond them anything may be written.
    for index in [1, 3] {
        let next = specialized(&plan, &set(&format!("k=1+index={index}"))).unwrap();
        assert!(assumed(&next).contains(&"u.index"), "{:?}", assumed(&next));
    }
    let next = specialized(&plan, &set("k=1+index=7")).unwrap();
    assert!(text(&next).contains("if (_e"), "{}", text(&next));
}

#[test]
fn a_matrix_of_ones_is_not_1() {
    for product in ["p.xy * u.m", "u.m * p.xy"] {
        let params = SpecializeParams {
            fold: Fold::Rounding,
            ..set("m[0].x=1+m[0].y=1+m[1].x=1+m[1].y=1")
        };
        let plan = original(&material("", &format!("return vec4({product}, 0.0, 1.0);")));
        let refused = specialized(&plan, &params).map(|p| text(&p)).unwrap_err();
        assert!(refused.contains("nothing-known"), "{refused}");
    }
}

#[test]
fn a_loop_may_lose_its_last_break() {
    let endless = "var s = 0u; loop { s += 1u; if u.k == 3u { break; } if s > 100u { \
                   return vec4(1.0); } } return u.v;";
    let called = "fn h(x: f32) -> f32 { for (var i = 0u; ; i++) { if u.k == 3u && i == 4u { \
                  break; } if f32(i) > x { return f32(i); } } return 0.0; }";
    for (functions, body) in [("", endless), (called, "return u.v * h(p.x);")] {
        let plan = original(&material(functions, body));
        let next = specialized(&plan, &set("k=2")).unwrap();
        // It reads back as valid.
        common::program(&text(&next));
        let content = uniform([2, 0, 0], 0.0);
        let p = [2.5, 0.5, 0.75, 1.0];
        assert_eq!(
            ran(&next, &content, p).unwrap(),
            ran(&plan, &content, p).unwrap()
        );
    }
}

const OVERRIDES: &str = "
override K: f32 = 0.5;
override FANCY: bool = false;
@id(7) override N: u32 = 4u;
override M: u32 = N * 2u;
@group(0) @binding(0) var<uniform> u: vec4<f32>;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }
@fragment fn fs(@location(0) p: vec4<f32>) -> @location(0) vec4<f32> {
    var c = u * K;
    if FANCY { c += p; }
    for (var i = 0u; i < M; i++) { c *= 2.0; }
    return c;
}";

#[test]
fn overrides_and_those_that_follow_from_them_take_their_values() {
    let plan = original(OVERRIDES);
    let next = specialized(&plan, &set("N=1+K=0.75+FANCY=true")).unwrap();
    // All that the text has another value of, whether it decides or not.
    let guard = next.guard.as_ref().unwrap();
    let values: Vec<String> = guard.values.iter().map(ToString::to_string).collect();
    assert_eq!(values, ["FANCY = 1", "K = 0.75", "M = 2", "N = 1"]);
    let written = text(&next);
    assert!(written.contains("override K: f32 = 0.75"), "{written}");
    assert!(
        !written.contains("loop") && !written.contains("if ("),
        "{written}"
    );
}

#[test]
fn overrides_that_rest_on_others_stay_and_values_that_none_can_have_are_refused() {
    let plan = original(OVERRIDES);
    // What M is rests on an N that nobody gave.
    let next = specialized(&plan, &set("FANCY=false")).unwrap();
    let module = next.program(next.main().unwrap()).unwrap().module();
    let mut overrides = module.overrides.iter().map(|(_, o)| o);
    let m = overrides.find(|o| o.name.as_deref() == Some("M")).unwrap();
    let init = &module.global_expressions[m.init.unwrap()];
    assert!(matches!(init, naga::Expression::Binary { .. }), "{init:?}");
    let refused = specialized(&plan, &set("FANCY=2"))
        .map(|p| text(&p))
        .unwrap_err();
    assert!(refused.contains("cannot be 2"), "{refused}");
    specialized(&plan, &set("FANCY=false+M=3")).unwrap();
}

#[test]
fn two_uniforms_at_one_binding_are_told_apart_by_type() {
    let source = "
struct A { k: u32, c: vec4<f32> }
struct B { f: f32, c: vec4<f32> }
@group(0) @binding(0) var<uniform> a: A;
@group(0) @binding(0) var<uniform> b: B;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { if b.f > 2.0 { \
    return p * 2.0; } return p; }
@fragment fn fs(@location(0) p: vec4<f32>) -> @location(0) vec4<f32> { if a.k == 1065353216u { \
    return a.c; } return p; }";
    let plan = original(source);
    let one = specialized(&plan, &set("a.k=1")).unwrap();
    assert!(text(&one).contains("> 2f"), "{}", text(&one));
    assert_eq!(assumed(&one), ["a.k"]);
    let both = specialized(&plan, &set("a.k=1+b.f=1")).unwrap();
    assert_eq!(assumed(&both), ["b.f", "a.k"]);
}

/// A front end computes what is made of literals alone, with other bits, and refuses 0 / 0.
#[test]
fn a_selected_constant_is_not_computed_with_by_a_front_end() {
    for (body, params) in [
        (
            "return vec4(select(p.x, 0.0, u.k == 0u) / 0.0);",
            set("k=0"),
        ),
        ("return p * f32(1 / select(1, 0, u.k == 0u));", set("k=0")),
        (
            "if u.k == 1u { return p; } return vec4(1.0 / f32(u.k == 1u));",
            set("k=0"),
        ),
        (
            "return p * (select(vec4(0.1), p, u.k == 1u) * 3.0);",
            set("k=0"),
        ),
        (
            "return vec4(mix(0.0, p.x, u.w) / 0.0);",
            SpecializeParams {
                fold: Fold::Rounding,
                ..set("u.w=0")
            },
        ),
    ] {
        let plan = original(&material("", body));
        let next = specialized(&plan, &params).unwrap();
        let written = text(&next);
        assert!(
            !written.contains("select") && !written.contains("mix"),
            "{written}"
        );
        let content = uniform([0, 0, 0], 0.0);
        let p = [2.5, 0.5, 0.75, 1.0];
        assert_eq!(
            ran(&next, &content, p).unwrap(),
            ran(&plan, &content, p).unwrap()
        );
    }
    // What nothing is computed of stays as it is written.
    let plan = original(&material(
        "",
        "var c = p; c = select(vec4(0.5), p, u.k == 1u); return c;",
    ));
    let written = text(&specialized(&plan, &set("k=0")).unwrap());
    assert!(written.contains("c = vec4(0.5f)"), "{written}");
}

/// Each loop is tried once, however many stand around it: with a try for each way to give up those
/// outside this would not end.
#[test]
fn loops_in_loops_are_walked_once() {
    for head in ["i32(p.x)", "i32(u.k) + 30", "i32(u.other)"] {
        let depth = 24;
        let heads: String = (0..depth)
            .map(|i| format!("for (var i{i} = 0; i{i} < {head}; i{i}++) {{\n"))
            .collect();
        let body = format!(
            "var c = p; {heads} if u.k == 3u {{ c += sin(c); }} c *= u.v; {} return c;",
            "}".repeat(depth)
        );
        let next = specialized(&original(&material("", &body)), &set("k=3+other=2")).unwrap();
        assert!(!text(&next).contains("== 3u"), "{}", text(&next));
    }
}
