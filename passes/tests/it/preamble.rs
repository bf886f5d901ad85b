//! What is computed once a draw, what stays and why, and that both together are the author's stage.

use preshade_passes::transforms::preamble::{Allow, Preamble, PreambleParams};
use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::geometry::Geometry;
use preshade_plan::pass::{
    Facts, Left, MaterialTexture, Numbers, Pass, Refused, Source, SourceRange,
};
use preshade_plan::plan::{BindingKind, BindingSource, GeometryPart, Plan};
use preshade_plan::state::MaterialState;
use preshade_validate::{Effort, validate};

use crate::common;

const HEAD: &str = "
const MOST: u32 = 4u;
struct Settings { a: f32, b: f32, count: u32, c: vec3<f32>, d: vec4<f32>, list: array<vec4<f32>, MOST> }
@group(0) @binding(0) var<uniform> u: Settings;
@group(0) @binding(1) var map: texture_2d<f32>;
@group(0) @binding(2) var s: sampler;
struct V { @builtin(position) p: vec4<f32>, @location(0) uv: vec2<f32>, @location(1) n: vec3<f32> }
@vertex fn vs(@location(0) p: vec3<f32>) -> V { return V(vec4(p, 1.0), p.xy, p); }
";

fn original(body: &str) -> Plan {
    let text = format!("{HEAD}@fragment fn fs(v: V) -> @location(0) vec4<f32> {{\n{body}\n}}");
    planned(&text)
}

fn planned(text: &str) -> Plan {
    let program = common::program(text);
    Plan::original("test", program, "vs", Some("fs"), &MaterialState::default())
}

const EXACT: PreambleParams = PreambleParams {
    allow: Allow::Exact,
    limit: 16,
    least: 4.0,
};
const ROUNDING: PreambleParams = PreambleParams {
    allow: Allow::Rounding,
    ..EXACT
};

/// The variant, whose promises must hold in the interpreter.
fn applied(plan: &Plan, params: &PreambleParams) -> Plan {
    let done = Preamble::run(plan, &Facts::default(), params).unwrap();
    let effort = Effort {
        inputs: 24,
        ..Effort::default()
    };
    let checks = validate(plan, &done.plan, &effort);
    assert!(!checks.is_empty());
    for check in checks {
        assert!(
            check.verdict.holds(),
            "{}: {}",
            check.promise,
            check.verdict
        );
    }
    done.plan
}

fn refused(plan: &Plan, params: &PreambleParams) -> Refused {
    let outcome = Preamble::run(plan, &Facts::default(), params);
    outcome.map(|done| done.change.what).unwrap_err()
}

/// The refusal's code, and why the value of that name stays.
fn stays(body: &str, name: &str, params: &PreambleParams) -> (String, String) {
    let refused = refused(&original(body), params);
    let left = refused.left.iter().find(|l| l.name == name);
    let reason = left.map(|l| l.reason.clone());
    (refused.refusals[0].code.clone(), reason.unwrap_or_default())
}

fn main_text(plan: &Plan) -> String {
    common::wgsl(plan.program(plan.main().unwrap()).unwrap())
}

fn once_text(plan: &Plan) -> String {
    common::wgsl(&plan.programs[&plan.compute[0].program])
}

fn is_exact(plan: &Plan) -> bool {
    matches!(plan.contract, Contract::Exact { .. })
}

#[test]
fn an_exponential_of_uniforms_is_computed_once_a_draw() {
    let plan = original("let gain = exp2(u.a + u.b); return vec4(v.uv * gain, gain, 1.0);");
    let next = applied(&plan, &EXACT);
    assert!(is_exact(&next));
    assert_eq!(main_text(&next).matches("exp2").count(), 0);
    assert_eq!(once_text(&next).matches("exp2").count(), 1);
    let [compute] = &next.compute[..] else {
        panic!("{:?}", next.compute)
    };
    assert_eq!((compute.workgroup, &compute.geometry), (1, &Geometry::Draw));
    let main = next.main().unwrap();
    let values = |bindings: &[preshade_plan::plan::BindingUse]| {
        let mut found = bindings.iter().filter(|b| {
            b.source
                == BindingSource::Geometry {
                    part: GeometryPart::Values {
                        buffer: next.draw_buffers[0].name.clone(),
                    },
                }
        });
        let found = (found.next().unwrap().clone(), found.next());
        assert_eq!(found.1, None);
        found.0
    };
    let (read, written) = (values(&main.bindings), values(&compute.bindings));
    assert_eq!((read.group, read.binding), (written.group, written.binding));
    assert_eq!(read.kind, BindingKind::Uniform);
    assert_eq!(written.kind, BindingKind::StorageReadWrite);
    assert!(read.visibility.fragment && written.visibility.compute);
    // The author's buffer keeps its source in both.
    assert_eq!(compute.bindings[0].source, BindingSource::Author);
    // The main pass no longer reads it.
    assert!(main.bindings.iter().all(|b| b.binding == read.binding));
}

#[test]
fn values_are_stored_without_gaps() {
    let plan = original(
        "let a = exp2(u.a); let c = exp2(u.c); let d = exp2(u.d); let b = exp2(u.b);
        return vec4(c * v.uv.x, a) + d * v.uv.y + b * v.uv.xyxy;",
    );
    let next = applied(&plan, &EXACT);
    assert_eq!(next.draw_buffers[0].size, 48);
    let text = main_text(&next);
    let place = |name: &str| text.find(&format!("{name}: ")).unwrap();
    assert!(place("d") < place("c") && place("c") < place("a"), "{text}");
}

/// A compiler fuses `a * b` into the sum that reads it, if it sees both.
#[test]
fn a_product_stays_with_the_sum_that_reads_it_unless_rounding_is_allowed() {
    let body = "let k = sin(u.a) * cos(u.b); return vec4(v.uv.x + k, v.uv, 1.0);";
    let next = applied(&original(body), &EXACT);
    assert!(is_exact(&next));
    // The factors move, and the product stays.
    assert_eq!(main_text(&next).matches("sin").count(), 0);
    assert_eq!(main_text(&next).matches(" * ").count(), 1);
    let next = applied(&original(body), &ROUNDING);
    assert!(!is_exact(&next), "{:?}", next.contract);
    assert_eq!(main_text(&next).matches(" * ").count(), 0);
}

/// A compiler multiplies powers by adding their exponents, if it sees both.
#[test]
fn a_power_stays_with_what_it_is_rewritten_with() {
    let least = PreambleParams {
        least: 1.0,
        ..EXACT
    };
    let read = |how: &str| {
        let body = format!("let gain = exp2(sin(u.a)); let k = {how}; return vec4(k, v.uv, 1.0);");
        main_text(&applied(&original(&body), &least))
            .matches("let gain = exp2")
            .count()
    };
    for apart in [
        "gain * exp2(v.uv.x)",
        "gain * gain * v.uv.x",
        "v.uv.x / gain",
        "gain * pow(v.uv.x, v.uv.y)",
        "v.uv.x * log2(gain)",
        "pow(gain, v.uv.x)",
        "max(gain, 0.5) * sqrt(v.uv.x)",
        "gain * (1.0 / exp2(v.uv.x))",
    ] {
        assert_eq!(read(apart), 1, "{apart}");
    }
    for moved in [
        "gain * v.uv.x",
        "gain + exp2(v.uv.x)",
        "gain / v.uv.x",
        "pow(v.uv.x, gain)",
        "v.uv.x * max(gain, v.uv.y)",
    ] {
        assert_eq!(read(moved), 0, "{moved}");
    }
}

#[test]
fn what_a_loop_computes_in_all_moves_and_what_it_computes_each_time_stays() {
    let total = "var sum = 1.0;
        for (var i = 0u; i < MOST; i++) { if i < u.count { sum += dot(u.list[i], u.list[i]); } }
        let white = inverseSqrt(sum);";
    let plan = original(&format!("{total} return vec4(v.uv * white, 0.0, 1.0);"));
    let next = applied(&plan, &EXACT);
    assert!(is_exact(&next));
    assert!(!main_text(&next).contains("loop"));
    let each = "var sum = 0.0;
        for (var i = 0u; i < MOST; i++) {
            let power = exp2(u.list[i].x);
            sum = max(sum, power * v.uv.x);
        }
        return vec4(sum);";
    let (code, why) = stays(each, "power", &EXACT);
    assert_eq!(code, "nothing-pays");
    assert!(why.contains("each iteration of a loop"), "{why}");
}

#[test]
fn a_loop_that_may_not_end_stays() {
    let body = "var sum = 1.0;
        while sum < u.a { sum = sum * u.b; }
        let end = exp2(sum);
        return vec4(v.uv * end, 0.0, 1.0);";
    let (_, why) = stays(body, "end", &EXACT);
    assert!(why.contains("may not end"), "{why}");
}

#[test]
fn values_behind_branches_move_if_the_draw_decides_the_branch() {
    let body = |condition: &str| {
        format!(
            "var shine = v.uv.x;
            if {condition} {{ let power = exp2(u.a) ; shine = pow(v.uv.y, power); }}
            return vec4(shine);"
        )
    };
    let params = PreambleParams {
        least: 2.0,
        ..EXACT
    };
    let next = applied(&original(&body("u.b > 0.5")), &params);
    assert!(!main_text(&next).contains("exp2"));
    let (_, why) = stays(&body("v.n.x > 0.5"), "power", &params);
    assert!(why.contains("some fragments do not compute it"), "{why}");
}

#[test]
fn values_behind_a_discard_move() {
    let plan = original(
        "if textureSample(map, s, v.uv).a < 0.5 { discard; }
        let gain = exp2(u.a + u.b);
        return vec4(v.uv * gain, gain, 1.0);",
    );
    let next = applied(&plan, &EXACT);
    assert!(is_exact(&next));
    assert!(!once_text(&next).contains("discard"));
    assert!(main_text(&next).contains("discard"));
}

#[test]
fn textures_stay() {
    let body = "let texel = textureLoad(map, vec2(0, 0), 0); let gain = exp2(texel);
        return gain * v.uv.xyxy;";
    let (_, why) = stays(body, "gain", &EXACT);
    assert!(
        why.contains("an earlier pass of the frame may draw to"),
        "{why}"
    );
}

#[test]
fn immediate_data_and_overrides_stay() {
    let text = |declared: &str, read: &str| {
        planned(&format!(
            "{HEAD}{declared}
            @fragment fn fs(v: V) -> @location(0) vec4<f32> {{
                let gain = exp2({read});
                return vec4(v.uv * gain, gain, 1.0);
            }}"
        ))
    };
    for (declared, read, says) in [
        ("var<immediate> now: vec4<f32>;", "now.x", "immediate data"),
        ("override scale: f32 = 2.0;", "scale * u.a", "an override"),
    ] {
        let refused = refused(&text(declared, read), &EXACT);
        let left = refused.left.iter().find(|l| l.name == "gain").unwrap();
        assert!(left.reason.contains(says), "{}", left.reason);
    }
}

/// Facts that say which numbers a member has, by component.
fn numbers(member: &str, components: &[&[f32]]) -> SourceRange {
    let one = |numbers: &&[f32]| {
        numbers
            .iter()
            .copied()
            .map(Numbers::one)
            .reduce(Numbers::or)
    };
    let components: Vec<Numbers> = components.iter().filter_map(one).collect();
    let all = components.iter().copied().reduce(Numbers::or).unwrap();
    SourceRange {
        material: "test".to_owned(),
        source: Source::Buffer {
            group: 0,
            binding: 0,
            member: Some(member.to_owned()),
        },
        low: all.low,
        high: all.high,
        components,
    }
}

#[test]
fn what_may_be_subnormal_stays() {
    let rows: [(&str, [f32; 2], [f32; 4], bool); 29] = [
        // The gain, the members `a` and `b`, the vector `d`, and whether it stays.
        ("exp2(u.a * u.d.x)", [0.5, 1.0], [0.5, 1.0, 2.0, 3.0], false),
        (
            "exp2(u.a * u.d.x)",
            [2e-39, 1.0],
            [0.5, 1.0, 2.0, 3.0],
            true,
        ),
        // A component beside others, read in three ways; and one that nobody reads.
        (
            "exp2(u.d.x * 1e38)",
            [0.5, 1.0],
            [1e-39, 5.0, 1.0, 2.0],
            true,
        ),
        ("exp2(wise(u.d))", [0.5, 1.0], [1e-39, 5.0, 1.0, 2.0], true),
        (
            "exp2(u.d.zyx.z * 1e38)",
            [0.5, 1.0],
            [1e-39, 5.0, 1.0, 2.0],
            true,
        ),
        (
            "exp2(u.d.y * 0.3)",
            [0.5, 1.0],
            [1e-39, 5.0, 1.0, 2.0],
            false,
        ),
        // Results and terms.
        ("exp2(u.a * u.b)", [1e-20, 1e-19], [0.0; 4], true),
        ("exp2(u.a * u.b)", [1e-30, 1e-30], [0.0; 4], false),
        ("exp2(u.a - u.b)", [1.9e-38, 1.3e-38], [0.0; 4], true),
        ("exp2(u.a - u.b)", [1.9e-3, 1.3e-3], [0.0; 4], false),
        ("exp2(1.0 / u.a)", [3e38, 1.0], [0.0; 4], true),
        ("sin(exp2(u.a))", [-140.0, 1.0], [0.0; 4], true),
        ("sin(exp2(u.a))", [-100.0, 1.0], [0.0; 4], false),
        ("sin(pow(u.a, 30.0))", [0.05, 1.0], [0.0; 4], true),
        ("sin(pow(u.a, 30.0))", [0.5, 1.0], [0.0; 4], false),
        (
            "exp2(length(u.d.xyz))",
            [0.5, 1.0],
            [1e-22, 0.0, 0.0, 0.0],
            true,
        ),
        (
            "exp2(length(u.d.xyz))",
            [0.5, 1.0],
            [1e-22, 1.0, 0.0, 0.0],
            false,
        ),
        (
            "exp2(smoothstep(0.0, 2e-39, u.a))",
            [1e-39, 1.0],
            [0.0; 4],
            true,
        ),
        ("exp2(turns(u.a))", [1e-10, 1.0], [0.0; 4], true),
        ("exp2(turns(u.a))", [0.1, 1.0], [0.0; 4], false),
        // What is clamped to 1 was larger.
        (
            "exp2(saturate(u.a) * 1e-19 * 5e-20 * 1e38)",
            [3.0, 1.0],
            [0.0; 4],
            true,
        ),
        (
            "exp2(saturate(u.a) * 1e-19 * 5e-19 * 1e38)",
            [3.0, 1.0],
            [0.0; 4],
            false,
        ),
        (
            "exp2(smoothstep(0.0, 0.5, u.a) * 1e-19 * 5e-20 * 1e38)",
            [3.0, 1.0],
            [0.0; 4],
            true,
        ),
        // The bits of an integer, and of a number.
        (
            "exp2(bitcast<f32>(u.count) * 1e38)",
            [0.5, 1.0],
            [0.0; 4],
            true,
        ),
        (
            "exp2(bitcast<f32>(bitcast<u32>(u.a) + 1u) + u.b)",
            [0.5, 1.0],
            [0.0; 4],
            true,
        ),
        (
            "exp2(bitcast<f32>(bitcast<u32>(u.a) + 1u))",
            [0.5, 1.0],
            [0.0; 4],
            true,
        ),
        ("exp2(f32(u.count) * u.a)", [0.5, 1.0], [0.0; 4], false),
        // Decisions.
        (
            "exp2(select(0.2, 1.5, u.a > 0.0) * 1.3)",
            [1e-40, 1.0],
            [0.0; 4],
            true,
        ),
        (
            "exp2(f32(u32(u.a * 1e30)) * 0.3)",
            [1e-40, 1.0],
            [0.0; 4],
            true,
        ),
    ];
    let params = PreambleParams {
        least: 1.0,
        ..EXACT
    };
    for (gain, [a, b], d, stays) in rows {
        let text = format!(
            "{HEAD}
            fn wise(d: vec4<f32>) -> f32 {{ let e = d; return e.x * 1e38; }}
            fn turns(a: f32) -> f32 {{
                var x = 1.0;
                for (var i = 0; i < 4; i++) {{ x *= a; }}
                return x;
            }}
            @fragment fn fs(v: V) -> @location(0) vec4<f32> {{
                let gain = {gain};
                return vec4(v.uv * gain, gain, 1.0);
            }}"
        );
        let facts = Facts {
            ranges: vec![
                numbers("a", &[&[a]]),
                numbers("b", &[&[b]]),
                numbers("d", &d.each_ref().map(std::slice::from_ref)),
            ],
            ..Facts::default()
        };
        let (plan, is_gain) = (planned(&text), |l: &Left| l.name == "gain");
        let left = match Preamble::run(&plan, &facts, &params) {
            Ok(done) => done.left.into_iter().find(is_gain),
            Err(refused) => refused.left.into_iter().find(is_gain),
        };
        let why = left.map(|l| l.reason).unwrap_or_default();
        assert_eq!(
            why.contains("subnormal"),
            stays,
            "{gain} of {a}, {b}, {d:?}: {why}"
        );
    }
    // One draw of several has such a number.
    let plan = original("let gain = exp2(u.a * 1e38); return vec4(v.uv * gain, gain, 1.0);");
    let facts = Facts {
        ranges: vec![numbers("a", &[&[0.0, 1e-39, 1.0]])],
        ..Facts::default()
    };
    let refused = Preamble::run(&plan, &facts, &params).unwrap_err();
    assert!(refused.left.iter().any(|l| l.reason.contains("subnormal")));
}

#[test]
fn a_number_that_decides_a_discard_keeps_its_bits() {
    let body = "let edge = sin(u.a) * u.b; if v.uv.x - edge < 0.25 { discard; }
        return vec4(v.uv, 0.0, 1.0);";
    let params = PreambleParams {
        least: 0.0,
        ..ROUNDING
    };
    let next = applied(&original(body), &params);
    assert!(is_exact(&next), "{:?}", next.contract);
    let text = main_text(&next);
    assert_eq!(
        (text.matches("sin").count(), text.matches(" * ").count()),
        (0, 1)
    );
}

#[test]
fn no_more_is_stored_than_the_limit() {
    let plan = original(
        "let a = exp2(u.d); let b = exp2(u.d.wzyx); let c = exp2(sin(u.d));
        return (a * v.uv.x + b * v.uv.y) * c + v.uv.xyxy * c;",
    );
    let size = |limit| {
        let params = PreambleParams { limit, ..EXACT };
        let outcome = Preamble::run(&plan, &Facts::default(), &params).unwrap();
        outcome.plan.draw_buffers[0].size
    };
    assert_eq!(size(16), 48);
    assert!(size(2) <= 32);
    // The dearest.
    let one = PreambleParams { limit: 1, ..EXACT };
    let next = applied(&plan, &one);
    assert_eq!(next.draw_buffers[0].size, 16);
    assert!(once_text(&next).contains("sin"));
}

#[test]
fn nothing_pays_where_uniforms_decide_little() {
    let plain = "return vec4(v.uv * u.a, u.c.x, 1.0);";
    let refused_ = refused(&original(plain), &EXACT);
    assert_eq!(refused_.refusals[0].code, "nothing-pays");
    assert_eq!(refused_.refusals[0].remedy, "leave it as it is");
    let fused = "let k = normalize(u.c); return vec4(dot(k, v.n) + k.x);";
    let refusal = refused(&original(fused), &EXACT).first();
    assert!(
        refusal.remedy.contains("allow=rounding"),
        "{}",
        refusal.remedy
    );
}

#[test]
fn a_preamble_is_made_once() {
    let plan = original("let gain = exp2(u.a + u.b); return vec4(v.uv * gain, gain, 1.0);");
    let next = applied(&plan, &EXACT);
    let again = refused(&next, &EXACT).first();
    assert_eq!(again.code, "not-first");
}

/// Passes that draw another view, or that replace the stages, refuse a plan with a preamble; those that
/// draw the camera's view again keep it.
#[test]
fn later_passes_keep_the_preamble_or_refuse_it() {
    let plan = original(
        "let gain = exp2(u.a + u.b); if v.uv.x * gain > 3.0 { discard; }
        return vec4(v.uv * gain, gain, 1.0);",
    );
    let next = applied(&plan, &EXACT);
    let run = |name: &str| {
        let pass = preshade_geometry::pass_named(name).unwrap();
        pass.run(&next, &Facts::without_ties(), &serde_json::json!({}))
    };
    for name in ["shadow", "visibility-buffer", "specialize", "early-alpha"] {
        let refused = run(name).map(|done| done.change.what).unwrap_err();
        let codes: Vec<String> = refused.refusals.into_iter().map(|r| r.code).collect();
        assert!(codes.contains(&"not-first".to_owned()), "{name}: {codes:?}");
    }
    let done = run("depth-prepass").unwrap().plan;
    assert_eq!((done.compute.len(), done.draw_buffers.len()), (1, 1));
    let reads = |b: &preshade_plan::plan::BindingUse| {
        matches!(
            b.source,
            BindingSource::Geometry {
                part: GeometryPart::Values { .. }
            }
        )
    };
    assert_eq!(done.passes.len(), 2);
    assert!(done.passes.iter().all(|p| p.bindings.iter().any(reads)));
}

#[test]
fn a_stage_that_writes_memory_is_refused() {
    let plan = planned(&format!(
        "{HEAD}@group(0) @binding(3) var<storage, read_write> out: array<f32>;
        @fragment fn fs(v: V) -> @location(0) vec4<f32> {{
            let gain = exp2(u.a + u.b); out[0] = gain; return vec4(gain * v.uv, gain, 1.0);
        }}"
    ));
    assert_eq!(refused(&plan, &EXACT).first().code, "fragment-stores");
}

/// One use of a function is the draw's, another is not.
#[test]
fn each_call_is_judged_by_itself() {
    let plan = planned(&format!(
        "{HEAD}fn curve(x: f32) -> f32 {{ return exp2(exp2(x)); }}
        @fragment fn fs(v: V) -> @location(0) vec4<f32> {{
            return vec4(curve(u.a), curve(v.uv.x), v.uv);
        }}"
    ));
    let next = applied(&plan, &EXACT);
    assert_eq!(main_text(&next).matches("curve(").count(), 2);
    assert_eq!(once_text(&next).matches("exp2").count(), 2);
}

/// A compute pass also runs for a draw that covers nothing, so a loop that may not end must not get there.
#[test]
fn a_value_in_a_loop_that_may_not_end_stays() {
    let body = "var s = 1.0; var acc = 0.0;
        while s < u.a { s *= u.b; let gain = exp2(exp2(u.d.x)); acc = max(acc, gain * v.uv.x); }
        return vec4(acc);";
    let (code, reason) = stays(body, "gain", &EXACT);
    assert_eq!(code, "nothing-pays");
    assert_eq!(reason, "it depends on a loop that may not end");
}

#[test]
fn a_value_of_a_storage_buffer_stays() {
    let plan = planned(&format!(
        "{HEAD}@group(0) @binding(3) var<storage, read> lights: array<vec4<f32>>;
        @fragment fn fs(v: V) -> @location(0) vec4<f32> {{
            let gain = exp2(exp2(lights[0].x)); return vec4(v.uv * gain, gain, 1.0);
        }}"
    ));
    let refused = refused(&plan, &EXACT);
    let left = refused.left.iter().find(|l| l.name == "gain").unwrap();
    assert!(left.reason.contains("storage buffer"), "{}", left.reason);
}

#[test]
fn a_sample_of_a_texture_that_no_pass_writes_moves() {
    let plan = original(
        "let tone = textureSampleLevel(map, s, u.d.xy, 0.0).x;
        let gain = exp2(tone * u.a);
        return vec4(v.uv * gain, textureSample(map, s, v.uv).x, 1.0);",
    );
    let stays = refused(&plan, &EXACT);
    let left = stays.left.iter().find(|l| l.name == "gain").unwrap();
    assert!(
        left.reason
            .contains("an earlier pass of the frame may draw to"),
        "{}",
        left.reason
    );
    let steady = |binding| Facts {
        steady_textures: vec![MaterialTexture {
            material: "test".to_owned(),
            group: 0,
            binding,
        }],
        ..Facts::default()
    };
    assert!(Preamble::run(&plan, &steady(0), &EXACT).is_err());
    let next = Preamble::run(&plan, &steady(1), &EXACT).unwrap().plan;
    let Contract::Exact { given } = &next.contract else {
        panic!("{:?}", next.contract)
    };
    assert!(given.contains(&Assumption::SteadyTextures), "{given:?}");
    let (once, main) = (once_text(&next), main_text(&next));
    assert!(once.contains("textureSampleLevel(map, s, "), "{once}");
    assert!(
        !main.contains("exp2") && main.contains("textureSample(map, s, "),
        "{main}"
    );
    assert!(next.compute[0].bindings.iter().any(|b| b.name == "map"));
}

/// What decides a branch is computed with the value behind it.
#[test]
fn a_value_behind_a_texel_of_another_pass_stays() {
    let body = "var gain = 1.0;
        if textureSampleLevel(map, s, u.d.xy, 0.0).x > 0.5 { gain = exp2(exp2(exp2(u.a))); }
        return vec4(v.uv * gain, 0.0, 1.0);";
    let (code, _) = stays(body, "gain", &EXACT);
    assert_eq!(code, "nothing-pays");
}

/// They end in a product with a constant, which a sum takes in.
#[test]
fn unpacked_numbers_may_be_fused() {
    for unpack in [
        "unpack4x8unorm",
        "unpack4x8snorm",
        "unpack2x16unorm",
        "unpack2x16snorm",
    ] {
        let body = format!("let t = {unpack}(u.count).x; return vec4(v.uv.y + t, v.uv, 1.0);");
        let params = PreambleParams {
            least: 1.0,
            ..EXACT
        };
        let reason = stays(&body, "t", &params).1;
        assert!(reason.contains("fuse"), "{unpack}: {reason}");
    }
}
