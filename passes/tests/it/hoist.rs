//! Hoisting moves what it says, keeps what has to stay, and gives the same values at the vertices.

use std::collections::BTreeMap;

use naga::{Binding, ShaderStage};
use naga_edit::interface;
use naga_interp::{Stuck, Value};
use preshade_passes::transforms::hoist::{self, Hoist, HoistParams};
use preshade_plan::pass::{Facts, Frequency, Left, Outcome, Pass, Refused};
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;
use preshade_plan::state::MaterialState;
use proptest::prelude::*;

use crate::common::stages::{VERTEX, attributes, run};
use crate::common::{self, random};

fn original(source: &str) -> Plan {
    let program = common::program(source);
    Plan::original("test", program, "vs", Some("fs"), &MaterialState::default())
}

fn outcome(plan: &Plan, params: &HoistParams) -> Result<Outcome, Refused> {
    Hoist::run(plan, &Facts::default(), params)
}

fn hoisted(source: &str, params: &HoistParams) -> (Plan, String) {
    let plan = original(source);
    let done = outcome(&plan, params).unwrap();
    let next = done.plan;
    let text = common::wgsl(next.program(next.main().unwrap()).unwrap());
    (next, format!("// {}\n{text}", done.change.what))
}

fn budget() -> HoistParams {
    HoistParams {
        budget: Some(0.02),
        finite: preshade_passes::transforms::hoist::movable::Finite::Assumed,
        jumps: preshade_passes::transforms::hoist::movable::Jumps::Carried,
        ..HoistParams::default()
    }
}

const NOISE: &str = "
struct Scene { clip: mat4x4<f32>, tint: vec3<f32>, time: f32 }
@group(0) @binding(0) var<uniform> scene: Scene;
struct VertexOutput { @builtin(position) position: vec4<f32>, @location(0) world: vec3<f32>, \
    @location(1) uv: vec2<f32> }
fn hash(p: vec3<f32>) -> f32 { return fract(sin(dot(p, vec3(12.9898, 78.233, 37.719))) * \
    43758.5453); }
fn value_noise(p: vec3<f32>) -> f32 {
    let i = floor(p);
    let f = p - i;
    let u = f * f * (3.0 - 2.0 * f);
    let a = mix(hash(i), hash(i + vec3(1.0, 0.0, 0.0)), u.x);
    let b = mix(hash(i + vec3(0.0, 1.0, 0.0)), hash(i + vec3(1.0, 1.0, 0.0)), u.x);
    return mix(a, b, u.y);
}
fn fbm(p: vec3<f32>) -> f32 {
    var sum = 0.0;
    var amplitude = 0.5;
    var q = p;
    for (var octave = 0; octave < 4; octave++) {
        sum += amplitude * value_noise(q);
        q = q * 2.0;
        amplitude *= 0.5;
    }
    return sum;
}
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> VertexOutput {
    var out: VertexOutput;
    out.position = scene.clip * vec4(position, 1.0);
    out.world = position;
    out.uv = uv;
    return out;
}
@fragment fn fs(in: VertexOutput) -> @location(0) vec4<f32> {
    let n = fbm(in.world * 2.8 + scene.time);
    let edge = fwidth(in.uv.x);
    return vec4(scene.tint * n + edge, 1.0);
}
";

#[test]
fn a_loop_of_noise_moves_whole() {
    let (plan, text) = hoisted(NOISE, &budget());
    insta::assert_snapshot!(text);
    assert_eq!(plan.contract.kind(), "approximate");
}

/// Both stages run one after the other: what the fragment stage gives where a fragment lies on a
/// vertex.
fn at_vertex(program: &Program, seed: u32) -> Result<(BTreeMap<String, Value>, bool), Stuck> {
    let vertex = run(
        program,
        ShaderStage::Vertex,
        "vs",
        &attributes(seed),
        seed.is_multiple_of(2),
    )?;
    let varyings = &vertex.by_location;
    let fragment = run(
        program,
        ShaderStage::Fragment,
        "fs",
        varyings,
        seed.is_multiple_of(2),
    )?;
    Ok((fragment.by_binding, fragment.discarded))
}

/// Whether anything was hoisted.
fn the_same_at_vertices(bytes: &[u8], seeds: &[u32]) -> bool {
    let source = format!("{}{VERTEX}", random::shader(bytes));
    let plan = original(&source);
    let params = HoistParams {
        vertices_per_fragment: Some(0.0),
        ..budget()
    };
    let (next, what) = match outcome(&plan, &params) {
        Ok(done) => (done.plan, done.change.what),
        Err(refused) => {
            let bug = refused.refusals.iter().any(|r| r.code == "internal");
            assert!(!bug, "{refused:?}\n{source}");
            return false;
        }
    };
    let before = plan.program(plan.main().unwrap()).unwrap();
    let after = next.program(next.main().unwrap()).unwrap();
    for seed in seeds {
        let (Ok(a), Ok(b)) = (at_vertex(before, *seed), at_vertex(after, *seed)) else {
            continue;
        };
        assert_eq!(
            a,
            b,
            "seed {seed}: {what}\n{source}\n=====\n{}",
            common::wgsl(after)
        );
    }
    true
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn hoisted_shaders_give_the_same_at_vertices(
        bytes in proptest::collection::vec(any::<u8>(), 0..400),
        seed in any::<u32>(),
    ) {
        the_same_at_vertices(&bytes, &[seed, seed.rotate_left(9), 3]);
    }
}

#[test]
fn random_shaders_are_hoisted_often_enough_to_count() {
    let hoisted = (0..120_u32)
        .filter(|i| {
            let bytes: Vec<u8> = (0..200_u32)
                .map(|j| (i.wrapping_mul(7919).wrapping_add(j * j * 31) >> 3) as u8)
                .collect();
            the_same_at_vertices(&bytes, &[*i, i * 77 + 5])
        })
        .count();
    assert!(hoisted >= 15, "only {hoisted} of 120");
}

/// A material around a fragment body. The vertex stage gives a position in the world, a normal,
/// texture coordinates and a flat number.
fn material(globals: &str, body: &str) -> String {
    format!(
        "
struct Scene {{ clip: mat4x4<f32>, view: mat4x4<f32>, camera: vec3<f32>, time: f32, tint: \
    vec4<f32> }}
@group(0) @binding(0) var<uniform> scene: Scene;
@group(0) @binding(1) var map: texture_2d<f32>;
@group(0) @binding(2) var map_sampler: sampler;
struct Varyings {{
    @builtin(position) position: vec4<f32>,
    @location(0) world: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) uv: vec2<f32>,
    @location(3) @interpolate(flat) layer: f32,
}}
{globals}
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>, \
    @location(2) uv: vec2<f32>, @location(3) layer: f32) -> Varyings {{
    let bent = sin(position * 3.0) * cos(normal);
    return Varyings(scene.clip * vec4(position, 1.0), position + bent, normal, uv, layer);
}}
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {{
{body}
}}
"
    )
}

/// Why a named value stayed.
fn left(plan: &Plan, params: &HoistParams, name: &str) -> String {
    let left: Vec<Left> = outcome(plan, params).map_or_else(|r| r.left, |done| done.left);
    let found = left.iter().find(|l| l.name == name);
    found
        .unwrap_or_else(|| panic!("nothing is said of `{name}`: {left:#?}"))
        .reason
        .clone()
}

#[test]
fn work_on_uniforms_alone_is_carried_flat_and_exact() {
    let source = material(
        "",
        "let glow = pow(sin(scene.tint) * cos(scene.time), vec4(2.5));
    return glow * textureSample(map, map_sampler, in.uv);",
    );
    let (plan, text) = hoisted(&source, &HoistParams::default());
    insta::assert_snapshot!(text);
    assert_eq!(plan.contract.kind(), "exact");
}

#[test]
fn affine_work_is_carried_under_rounding() {
    let source = material(
        "",
        "let local = scene.view * vec4(in.world, 1.0);
    return vec4(saturate(1.0 + local.z * 0.1)) * scene.tint;",
    );
    let (plan, text) = hoisted(&source, &HoistParams::default());
    insta::assert_snapshot!(text);
    assert_eq!(plan.contract.kind(), "rounding");
}

#[test]
fn affine_work_that_reaches_a_jump_needs_a_budget() {
    let source = material(
        "",
        "let local = scene.view * vec4(in.world, 1.0);
    return vec4(fract(local.z) + floor(local.x));",
    );
    assert!(outcome(&original(&source), &HoistParams::default()).is_err());
    let (plan, _) = hoisted(&source, &budget());
    assert_eq!(plan.contract.kind(), "approximate");
}

/// What stays where nothing is said of jumps.
fn without_jumps() -> HoistParams {
    HoistParams {
        jumps: hoist::movable::Jumps::Stay,
        ..budget()
    }
}

#[test]
fn what_rests_on_a_jump_stays() {
    let dear = "sin(in.world.x * 3.0) * cos(in.world.y * 2.0) * exp(-in.world.z * in.world.z)";
    let packed = "let d = 0.5 + 0.4 * sin(in.world.x) * cos(in.world.z);
    let p = fract(vec4(16777216.0, 65536.0, 256.0, 1.0) * d);
    let value = p.x + p.y - p.z / 256.0 + sin(p.w);";
    for (jump, body) in [
        ("fract", format!("let value = 2.0 * fract({dear});")),
        ("fract", packed.to_owned()),
        (
            "floor",
            format!("let f = {dear};\n    let value = f - floor(f);"),
        ),
        ("ceil", format!("let value = sin(ceil({dear}));")),
        ("round", format!("let value = 0.25 * round(4.0 * {dear});")),
        ("trunc", format!("let value = 0.25 * trunc(4.0 * {dear});")),
        (
            "step",
            format!("let value = mix(0.25, 0.75, step(0.1, {dear}));"),
        ),
        ("sign", format!("let value = 0.5 * sign({dear});")),
        ("%", format!("let value = 3.0 * (({dear}) % 0.2);")),
        (
            "a comparison",
            format!("let value = sin(select(0.0, 2.0, {dear} > 0.1));"),
        ),
        (
            "a comparison",
            format!(
                "var value = in.world.x;\n    if {dear} > 0.1 {{ \
                 value = sin(in.world.y); }}\n    value = cos(value);"
            ),
        ),
        (
            "a conversion to an integer",
            format!("let value = 0.1 * f32(i32(8.0 * {dear}));"),
        ),
        (
            "packing",
            format!("let value = unpack4x8unorm(pack4x8unorm(vec4({dear}))).y * 2.0;"),
        ),
    ] {
        let source = material("", &format!("{body}\n    return vec4(value);"));
        let plan = original(&source);
        let left = left(&plan, &without_jumps(), "value");
        assert_eq!(
            left,
            format!("`{jump}` has a discontinuity, and interpolation would give values in between"),
            "{body}"
        );
        let text = match outcome(&plan, &without_jumps()).is_err() {
            true => String::new(),
            false => hoisted(&source, &without_jumps()).1,
        };
        assert!(!text.contains("value`"), "{text}");
        // The author's word, for noise.
        let (_, text) = hoisted(&source, &budget());
        assert!(text.starts_with("// carries `value`"), "{body}\n{text}");
    }
}

#[test]
fn a_jump_that_does_not_happen_holds_nothing_back() {
    for value in [
        // What is below 1 by its own terms has no whole number in it.
        "sin(floor(0.25 + 0.5 * saturate(in.world.x)) + in.world.y) * cos(in.world.z)",
        "sin(in.world.x) * cos(in.world.y) * select(0.5, 2.0, 3.0 + sin(in.world.z) > 1.0)",
        "sin(in.world.x) * cos(in.world.y) * atan2(in.world.z, 2.0 + sin(in.world.x))",
        // One number for the draw.
        "sin(in.world.x) * cos(in.world.y) * floor(scene.time)",
        "sin(in.world.x) * cos(in.world.y) * select(0.5, 2.0, scene.time > 1.0)",
    ] {
        let source = material(
            "",
            &format!("let value = {value};\n    return vec4(value);"),
        );
        let (_, text) = hoisted(&source, &without_jumps());
        assert!(text.starts_with("// carries `value`"), "{value}\n{text}");
    }
}

/// The open example of Mesa's `nir_opt_varyings`, from text to text: three inputs of which two sums
/// are needed.
#[test]
fn three_inputs_are_carried_as_two_sums() {
    let source = "
struct Varyings { @builtin(position) position: vec4<f32>, @location(0) a: vec4<f32>, \
    @location(1) b: vec4<f32>, @location(2) c: vec4<f32> }
@vertex fn vs(@location(0) a: vec4<f32>, @location(1) b: vec4<f32>, \
    @location(2) c: vec4<f32>) -> Varyings { return Varyings(a, a, b, c); }
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {
    let first = in.a + in.b;
    let second = in.b + in.c;
    return (first * first + second * second) * 0.25;
}
";
    let (_, text) = hoisted(source, &HoistParams::default());
    let fragment = &text[text.find("@fragment").unwrap()..];
    assert_eq!(fragment.matches("@location").count(), 2 + 1, "{fragment}");
    assert!(fragment.contains("first") && fragment.contains("second"));
}

#[test]
fn a_cut_inside_a_function_copies_it_for_that_call_alone() {
    let source = material(
        "fn sheen(n: vec3<f32>, v: vec3<f32>, base: vec3<f32>) -> vec3<f32> {
    let rim = pow(clamp(1.0 - dot(n, v), 0.01, 1.0), 4.0) * sin(n.x * 4.0) * cos(n.y * 3.0);
    return base * rim + base * base;
}",
        "let base = textureSample(map, map_sampler, in.uv).xyz;
    let smooth_one = sheen(in.normal, scene.camera - in.world, base);
    let mapped = sheen(base, in.world, base);
    return vec4(smooth_one + mapped, 1.0);",
    );
    let (_, text) = hoisted(&source, &budget());
    insta::assert_snapshot!(text);
}

#[test]
fn what_a_loop_does_not_change_moves_out_of_it() {
    let source = material(
        "fn glint(n: vec3<f32>, v: vec3<f32>, l: vec3<f32>) -> f32 {
    let facing = sin(dot(n, v) * 3.0) * cos(dot(n, v) * 5.0);
    return facing * dot(n, l);
}",
        "var lit = 0.0;
    for (var i = 0; i < 4; i++) {
        lit += glint(in.normal, in.world, vec3(f32(i)) - in.world) * dpdx(in.uv.x);
    }
    return vec4(lit);",
    );
    let (_, text) = hoisted(&source, &budget());
    insta::assert_snapshot!(text);
}

#[test]
fn varyings_that_nobody_reads_go_with_the_work_behind_them() {
    let source = material(
        "",
        "let a = sin(in.normal * 2.0) * cos(in.normal);\n    return vec4(a, 1.0);",
    );
    let (plan, text) = hoisted(&source, &budget());
    let main = plan.main().unwrap();
    let read: Vec<u32> = main.attributes.iter().map(|a| a.location).collect();
    assert_eq!(read, [0, 1], "{text}");
    assert!(!text.contains("bent"), "{text}");
}

#[test]
fn what_stays_says_why() {
    let source = material(
        "",
        "let slope = dpdx(in.uv.x) * 8.0 + sin(dpdy(in.uv.y));
    let texel = textureSample(map, map_sampler, in.uv);
    let mixed = sin(in.layer * in.world.x) * cos(in.layer);
    let cell = floor(in.world * 3.0);
    let unit = normalize(in.normal);
    var lit = 0.0;
    if texel.x > 0.5 { let inside = sin(in.world.y) * cos(in.world.z); lit = inside; }
    for (var i = 0; i < 3; i++) { let turn = sin(in.world.x * f32(i)); lit += turn; }
    return vec4(unit * slope + cell * mixed, lit) * texel;",
    );
    let plan = original(&source);
    let params = HoistParams {
        budget: Some(0.01),
        ..HoistParams::default()
    };
    let said: Vec<String> = ["slope", "texel", "mixed", "cell", "unit", "inside", "turn"]
        .map(|name| format!("{name}: {}", left(&plan, &params, name)))
        .to_vec();
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn more_values_than_varyings_are_packed_or_left() {
    use std::fmt::Write as _;
    let mut body = String::from("var sum = vec4(0.0);\n");
    for i in 0..24 {
        writeln!(
            body,
            "    let v{i}_ = sin(in.world.x * {i}.5) * cos(in.world.y * {i}.25) * sin(in.world.z + \
             {i}.0);
    sum += textureSampleLevel(map, map_sampler, vec2(v{i}_, fwidth(in.uv.x)), 0.0);"
        )
        .unwrap();
    }
    body.push_str("    return sum;");
    let (plan, text) = hoisted(&material("", &body), &budget());
    let main = plan.main().unwrap();
    let (_, entry) = plan
        .program(main)
        .unwrap()
        .entry_point(ShaderStage::Fragment, "fs")
        .unwrap();
    let varyings = interface::inputs(plan.program(main).unwrap().module(), &entry.function)
        .iter()
        .filter(|io| matches!(io.binding, Some(Binding::Location { .. })))
        .count();
    assert!((2..=16).contains(&varyings), "{varyings}\n{text}");
    assert!(text.contains("packed_a: vec4<f32>"), "{text}");
}

#[test]
fn refusals_are_told_by_code() {
    let stores = material(
        "@group(1) @binding(0) var<storage, read_write> seen: array<u32>;",
        "seen[0] = 1u; return vec4(sin(in.world), 1.0);",
    );
    let code = |source: &str, params: &HoistParams| {
        outcome(&original(source), params).unwrap_err().first().code
    };
    assert_eq!(code(&stores, &budget()), "fragment-stores");
    let plain = material("", "return vec4(in.world, 1.0);");
    assert_eq!(code(&plain, &budget()), "nothing-pays");
    let unbudgeted = HoistParams {
        allow: Some(preshade_passes::transforms::hoist::Allow::Approximate),
        ..HoistParams::default()
    };
    assert_eq!(code(&plain, &unbudgeted), "no-budget");
    for budget in [0.0, -1.0, 1.5, f64::NAN] {
        let params = HoistParams {
            budget: Some(budget),
            ..HoistParams::default()
        };
        assert_eq!(code(&plain, &params), "budget");
    }
}

/// Twice as many chains of calls at each level: more than anything can look at one by one.
#[test]
fn a_tree_of_calls_over_a_discard_is_told_to_be_too_large() {
    use std::fmt::Write as _;
    let mut globals = String::from("fn f0(x: f32) -> f32 { if x > 2.0 { discard; } return x; }\n");
    for i in 1..32 {
        let below = i - 1;
        writeln!(
            globals,
            "fn f{i}(x: f32) -> f32 {{ return f{below}(x) + f{below}(x + 0.5); }}"
        )
        .unwrap();
    }
    let source = material(&globals, "return vec4(f31(in.world.x));");
    let refused = outcome(&original(&source), &HoistParams::default()).unwrap_err();
    assert_eq!(refused.refusals[0].code, "too-large");
}

/// A choice made before is told apart from one that never was.
#[test]
fn values_that_are_not_there_are_named() {
    let source = material(
        "",
        "let glow = exp(sin(length(in.world) * 3.0));
    return vec4(glow);",
    );
    let plan = original(&source);
    let all = hoist::candidates(&plan, &Facts::default()).unwrap();
    let id = &all.first().unwrap().id;
    let carrying = |carry: &str| HoistParams {
        carry: Some(carry.to_owned()),
        finite: hoist::movable::Finite::Assumed,
        ..budget()
    };
    let refused = outcome(&plan, &carrying("0123456789abcdef")).unwrap_err();
    assert_eq!(refused.refusals[0].code, "unknown-values");
    assert!(refused.refusals[0].reason.contains("0123456789abcdef"));
    let params = carrying(&format!("{id}+0123456789abcdef"));
    let next = outcome(&plan, &params).unwrap().plan;
    let told = |n: &&String| n.contains("0123456789abcdef") && !n.contains(id.as_str());
    assert_eq!(
        next.notes.iter().filter(told).count(),
        1,
        "{:?}",
        next.notes
    );
}

/// Only what was measured moves approximately, also in a material of which nothing was measured.
#[test]
fn measurements_of_another_material_allow_nothing() {
    let plan = original(&material(
        "",
        "let wave = sin(in.world * 3.0) * cos(in.world.yzx);
        return vec4(wave, 1.0);",
    ));
    let params = HoistParams {
        budget: Some(0.02),
        ..HoistParams::default()
    };
    let of = |facts: &Facts| Hoist::run(&plan, facts, &params).map(drop);
    assert!(of(&Facts::default()).is_ok());
    let measured = Frequency {
        material: "another".to_owned(),
        value: "0123456789abcdef".to_owned(),
        name: "n".to_owned(),
        cost: 10.0,
        interpolation: None,
        bound: None,
        max_abs: 0.0,
        flip_mean: 0.0,
        flip_p99: 0.0,
        flip_tile: 0.0,
        nan_pixels: 0,
        location: None,
    };
    let facts = Facts {
        frequencies: vec![measured],
        ..Facts::default()
    };
    let refused = of(&facts).unwrap_err();
    let reason = |l: &Left| l.reason.contains("was not measured");
    assert!(refused.left.iter().any(reason), "{:?}", refused.left);
}

/// A normal of a height field has a component that stays away from 0, so it is finite at every vertex.
#[test]
fn normalize_moves_if_the_length_is_above_zero() {
    let moves = |vector: &str| {
        let body = format!("return vec4(normalize({vector}) * cos(in.world.x * in.world.y), 1.0);");
        let params = HoistParams {
            budget: Some(0.02),
            ..HoistParams::default()
        };
        let plan = outcome(&original(&material("", &body)), &params)
            .unwrap()
            .plan;
        let main = plan.main().unwrap();
        let module = plan.program(main).unwrap().module();
        let is_fragment = |e: &&naga::EntryPoint| e.stage == naga::ShaderStage::Fragment;
        let fragment = module.entry_points.iter().find(is_fragment).unwrap();
        let is_normalize = |(_, e): (_, &naga::Expression)| {
            let fun = naga::MathFunction::Normalize;
            matches!(e, naga::Expression::Math { fun: f, .. } if *f == fun)
        };
        !fragment.function.expressions.iter().any(is_normalize)
    };
    assert!(moves("vec3(in.world.xy, 1.0)"));
    assert!(moves("vec3(in.world.xy, 2.0 + sin(in.world.z))"));
    assert!(!moves("in.world"));
    assert!(!moves("vec3(in.world.xy, 1.0 + sin(in.world.z))"));
    // The square of the length may be infinite.
    assert!(!moves("vec3(in.world.xy * 1e25, 1.0)"));
}

/// Whoever does what a refusal says gets there, or is told that there is nothing.
#[test]
fn advice_comes_to_an_end() {
    use preshade_passes::transforms::hoist::Allow;
    use preshade_passes::transforms::hoist::movable::{Finite, Jumps};
    let sources = [
        NOISE.to_owned(),
        material("", "return vec4(in.world, 1.0);"),
        material(
            "",
            "return vec4(sin(in.world * 3.0) * cos(in.world.yzx), 1.0);",
        ),
        material(
            "",
            "return vec4(normalize(in.world) * exp(in.world.y), 1.0);",
        ),
    ];
    let mut ends = std::collections::BTreeSet::new();
    for source in &sources {
        for allow in [None, Some(Allow::Rounding)] {
            let mut params = HoistParams {
                allow,
                ..HoistParams::default()
            };
            let mut advised = 0;
            let end = loop {
                let Err(refused) = outcome(&original(source), &params) else {
                    break "hoisted";
                };
                assert!(advised < 3, "{source}: {:?}", refused.refusals);
                advised += 1;
                let remedy = &refused.refusals[0].remedy;
                if remedy.contains("no budget would help") {
                    assert!(hoist_all(source).is_err(), "{source}");
                    break "nothing";
                }
                if remedy.contains("finite=assumed") {
                    params.finite = Finite::Assumed;
                }
                if remedy.contains("jumps=carried") {
                    params.jumps = Jumps::Carried;
                }
                params.allow = params
                    .allow
                    .filter(|_| !remedy.contains("leave `allow` out"));
                params.budget = Some(0.02);
            };
            ends.insert(end);
        }
    }
    assert_eq!(ends.len(), 2, "{ends:?}");
}

/// What there is to hoist at the largest budget.
fn hoist_all(source: &str) -> Result<Outcome, Refused> {
    let params = HoistParams {
        budget: Some(1.0),
        ..budget()
    };
    outcome(&original(source), &params)
}

/// The length of a list, and what little is computed from it, is cheaper in each fragment than in a
/// varying, and the vertex stage would run the loop for it.
#[test]
fn the_length_of_a_list_is_not_carried() {
    for bound in [
        "arrayLength(&lights)",
        "arrayLength(&lights) - 1u",
        "u.count",
    ] {
        let text = format!(
            "struct U {{ count: u32, k: f32 }}
             @group(0) @binding(0) var<uniform> u: U;
             @group(0) @binding(1) var<storage, read> lights: array<vec4<f32>>;
             struct V {{ @builtin(position) position: vec4<f32>, @location(0) n: vec3<f32> }}
             @vertex fn vs(@location(0) p: vec3<f32>) -> V {{ return V(vec4(p, 1.0), p); }}
             @fragment fn fs(v: V) -> @location(0) vec4<f32> {{
               var sum = vec3<f32>(0.0);
               for (var i = 0u; i < {bound}; i++) {{
                 sum += max(dot(normalize(v.n), lights[i].xyz), 0.0) * lights[i].w;
               }}
               return vec4<f32>(sum * sin(u.k) * cos(u.k), 1.0);
             }}"
        );
        let plan = original(&text);
        let done = outcome(&plan, &HoistParams::default());
        let moved = done.map(|done| {
            let program = done.plan.program(done.plan.main().unwrap()).unwrap();
            common::wgsl(program)
        });
        if let Ok(text) = moved {
            let vertex = text.split("@vertex").nth(1).unwrap();
            let vertex = vertex.split("@fragment").next().unwrap();
            assert!(!vertex.contains("loop"), "{bound}: {text}");
            let hoisted = text.split("fn ").filter(|f| f.starts_with("hoisted"));
            assert!(
                hoisted.clone().all(|f| !f.contains("loop")),
                "{bound}: {text}"
            );
        }
    }
}
