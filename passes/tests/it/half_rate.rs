//! What is computed at half the rate, what guides it, what stays and why, and that a pixel without
//! neighbours computes what the author's stage does.

use preshade_passes::transforms::half_rate::{Edges, HalfRate, HalfRateParams};
use preshade_plan::contract::Contract;
use preshade_plan::frame::{ColorAttachments, FramePlan};
use preshade_plan::pass::{Facts, Pass, Refused};
use preshade_plan::plan::{BindingSource, Plan, Role};
use preshade_plan::state::{
    ColorTarget, CompareFunction, MaterialState, Multisample, StencilFace, StencilOperation,
    StencilState,
};
use preshade_validate::{Effort, validate};

use crate::common;

const HEAD: &str = "
struct Frame { taps: array<vec4<f32>, 16>, count: u32, bright: f32 }
@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var depths: texture_2d<f32>;
@group(0) @binding(2) var normals: texture_2d<f32>;
@group(0) @binding(3) var noise: texture_2d<f32>;
@group(0) @binding(4) var albedo: texture_2d<f32>;
@group(0) @binding(5) var s: sampler;
struct V { @builtin(position) at: vec4<f32>, @location(0) uv: vec2<f32> }
@vertex fn vs(@builtin(vertex_index) i: u32) -> V {
    let uv = vec2<f32>(f32(i & 1u), f32(i >> 1u)) * 2.0;
    return V(vec4<f32>(uv * 2.0 - 1.0, 0.0, 1.0), uv);
}
fn occlusion(pixel: vec2<i32>, turn: f32, z: f32, n: vec3<f32>) -> f32 {
    var sum = 0.0;
    for (var i = 0; i < 16; i++) {
        let away = frame.taps[i].xy * turn;
        let tap = textureLoad(depths, pixel + vec2<i32>(away), 0).x;
        sum += max((tap - z) * n.x, 0.0);
    }
    return sum / 16.0;
}
";

/// The usual beginning of a stage.
const LOADS: &str = "let pixel = vec2<i32>(v.at.xy);
    let z = textureLoad(depths, pixel, 0).x;
    let n = textureLoad(normals, pixel, 0).xyz;
    let turn = textureLoad(noise, pixel, 0).x;
    ";

fn full_screen() -> MaterialState {
    MaterialState {
        depth_compare: Some(CompareFunction::Always),
        depth_write: false,
        ..MaterialState::default()
    }
}

fn in_state(body: &str, state: &MaterialState) -> Plan {
    let text = format!("{HEAD}@fragment fn fs(v: V) -> @location(0) vec4<f32> {{\n{body}\n}}");
    Plan::original("screen", common::program(&text), "vs", Some("fs"), state)
}

fn original(body: &str) -> Plan {
    in_state(&format!("{LOADS}{body}"), &full_screen())
}

fn within() -> HalfRateParams {
    HalfRateParams {
        budget: Some(0.01),
        ..HalfRateParams::default()
    }
}

/// The variant. Where no texel is covered, its stage has the author's colours, if pixels compute them.
fn applied(plan: &Plan, params: &HalfRateParams) -> Plan {
    let done = HalfRate::run(plan, &Facts::default(), params).unwrap();
    let effort = Effort {
        inputs: 24,
        ..Effort::default()
    };
    for check in validate(plan, &done.plan, &effort) {
        assert!(
            !check.verdict.is_broken(),
            "{}: {}",
            check.promise,
            check.verdict
        );
    }
    done.plan
}

fn refused(plan: &Plan, params: &HalfRateParams) -> Refused {
    let outcome = HalfRate::run(plan, &Facts::default(), params);
    outcome.map(|done| done.change.what).unwrap_err()
}

fn code(plan: &Plan, params: &HalfRateParams) -> String {
    refused(plan, params).refusals[0].code.clone()
}

fn text_of(plan: &Plan, role: Role) -> String {
    let pass = plan.passes.iter().find(|p| p.role == role).unwrap();
    common::wgsl(plan.program(pass).unwrap())
}

fn note(plan: &Plan) -> &str {
    plan.notes.last().unwrap()
}

#[test]
fn occlusion_moves_and_the_texel_of_the_pixel_stays() {
    let plan = original(
        "let open = 1.0 - occlusion(pixel, 4.0, z, n);
        let color = textureLoad(albedo, pixel, 0).rgb;
        return vec4<f32>(color * open, 1.0);",
    );
    let next = applied(&plan, &within());
    let (half, main) = (text_of(&next, Role::HalfRate), text_of(&next, Role::Main));
    assert!(
        half.contains("occlusion") && !half.contains("albedo"),
        "{half}"
    );
    assert!(main.contains("albedo"), "{main}");
    assert!(
        note(&next).starts_with("computes `open`"),
        "{}",
        note(&next)
    );
    assert!(matches!(next.contract, Contract::Approximate { .. }));
}

#[test]
fn what_only_moves_the_taps_is_no_guide() {
    let plan = original("return vec4<f32>(occlusion(pixel, turn * 8.0, z, n));");
    let next = applied(&plan, &within());
    assert!(
        note(&next).contains("edges are those of `z`, `n`,"),
        "{}",
        note(&next)
    );
    // Two words of normal, one of depth, one value.
    assert_eq!(next.attachments.len(), 2);
}

#[test]
fn a_neighbours_texel_is_no_guide() {
    let plan = original(
        "let beside = textureLoad(albedo, pixel + vec2<i32>(1, 0), 0).x;
        return vec4<f32>(occlusion(pixel, 4.0, beside, vec3<f32>(beside)));",
    );
    let next = applied(&plan, &within());
    assert!(
        note(&next).contains("no value tells edges"),
        "{}",
        note(&next)
    );
}

#[test]
fn the_user_names_guides() {
    let plan = original("return vec4<f32>(occlusion(pixel, turn * 8.0, z, n));");
    let guided = |guide: &str| HalfRateParams {
        guide: Some(guide.to_owned()),
        ..within()
    };
    let next = applied(&plan, &guided("n"));
    assert!(
        note(&next).contains("edges are those of `n`,"),
        "{}",
        note(&next)
    );
    let next = applied(&plan, &guided("none"));
    assert!(
        note(&next).contains("no value tells edges"),
        "{}",
        note(&next)
    );
    let refused = refused(&plan, &guided("z+turn"));
    assert_eq!(refused.refusals[0].code, "no-guide");
    assert!(
        refused.refusals[0].remedy.contains("z, n"),
        "{:?}",
        refused.refusals
    );
}

#[test]
fn a_texel_has_the_values_and_the_guides_and_half_the_size() {
    let body = "return vec4<f32>(occlusion(pixel, 4.0, z, n) * vec3<f32>(n.yz, z), 1.0);";
    let next = applied(&original(body), &within());
    let targets: Vec<_> = next.attachments.iter().filter(|a| a.divisor == 2).collect();
    assert_eq!(targets.len(), next.attachments.len() - 1);
    assert_eq!(targets[0].size([161, 91]), [81, 46]);
    let json = serde_json::to_value(&next).unwrap();
    assert!(json["attachments"][0].get("divisor").is_none());
    assert_eq!(json["attachments"][1]["divisor"], 2);
    let half = &next.passes[0];
    assert_eq!((half.role, &half.depth), (Role::HalfRate, &None));
    let read = next.main().unwrap().bindings.iter().filter(|b| {
        matches!(&b.source, BindingSource::Attachment { name } if name.starts_with("half-rate-screen"))
    });
    assert_eq!(read.count(), targets.len());
}

#[test]
fn the_half_rate_pass_comes_first_and_alone() {
    let next = applied(
        &original("return vec4<f32>(occlusion(pixel, 4.0, z, n));"),
        &within(),
    );
    let other = Plan {
        material: "other".to_owned(),
        ..original("return vec4<f32>(z);")
    };
    let frame = FramePlan::merge([&other, &next]).unwrap();
    let [half, main] = &frame.passes[..] else {
        panic!("{:?}", frame.passes)
    };
    assert_eq!(half.members, [("screen".to_owned(), 0)]);
    assert!(matches!(half.colors, ColorAttachments::Named(_)));
    assert_eq!(main.members.len(), 2);
}

#[test]
fn a_discard_stays_with_the_pixels() {
    let plan = original(
        "if z >= 1.0 { discard; }
        return vec4<f32>(occlusion(pixel, 4.0, z, n));",
    );
    let next = applied(&plan, &within());
    assert!(text_of(&next, Role::Main).contains("discard"));
    assert!(!text_of(&next, Role::HalfRate).contains("discard"));
}

#[test]
fn what_decides_a_discard_stays() {
    let plan = original(
        "let open = occlusion(pixel, 4.0, z, n);
        if open < 0.5 { discard; }
        return vec4<f32>(open);",
    );
    let refused = refused(&plan, &within());
    assert_eq!(refused.refusals[0].code, "nothing-at-half-rate");
    let open = refused.left.iter().find(|l| l.name == "open").unwrap();
    assert!(open.reason.contains("decides a discard"), "{}", open.reason);
}

#[test]
fn a_value_behind_a_return_moves_and_one_in_a_branch_stays() {
    let next = applied(
        &original(
            "if z >= 1.0 { return vec4<f32>(n, 0.0); }
            return vec4<f32>(occlusion(pixel, 4.0, z, n));",
        ),
        &within(),
    );
    assert!(!text_of(&next, Role::HalfRate).contains("return vec4<f32>(n"));
    let plan = original(
        "var color = n;
        if z < 1.0 { let open = occlusion(pixel, 4.0, z, n); color = color * open; }
        return vec4<f32>(color, v.uv.x);",
    );
    let done = HalfRate::run(&plan, &Facts::default(), &within());
    // The branch moves as a whole, or not at all.
    let names = done.map(|d| d.change.what).unwrap_or_default();
    assert!(!names.starts_with("computes `open`"), "{names}");
}

#[test]
fn derivatives_and_levels_are_those_of_neighbouring_pixels() {
    let body = "var sum = dpdx(v.uv.x) * 3.0 + textureSample(albedo, s, v.uv * 2.0).x;
        for (var i = 0; i < 64; i++) { sum += sin(sum * frame.taps[i & 15].x); }
        return vec4<f32>(sum);";
    let computed = HalfRateParams {
        edges: Edges::Computed,
        ..within()
    };
    let next = applied(&original(body), &computed);
    let half = text_of(&next, Role::HalfRate);
    assert!(half.contains("textureSampleBias"), "{half}");
    assert!(half.contains("dpdx(") && half.contains("* 0.5"), "{half}");
    // A branch must take no derivative, so no pixel computes the value itself. The texel that guides is
    // sampled outside of branches.
    let main = text_of(&next, Role::Main);
    assert!(!main.contains("dpdx") && !main.contains("sin("), "{main}");
    assert!(note(&next).contains("need derivatives"), "{}", note(&next));
}

#[test]
fn a_pixel_unlike_its_neighbours_computes_if_asked() {
    let plan = original("return vec4<f32>(occlusion(pixel, 4.0, z, n));");
    let main = |edges| {
        let params = HalfRateParams { edges, ..within() };
        text_of(&applied(&plan, &params), Role::Main)
    };
    let [blended, computed] = [Edges::Blended, Edges::Computed].map(main);
    assert!(!blended.contains("fn occlusion"), "{blended}");
    assert!(computed.contains("fn occlusion"), "{computed}");
}

#[test]
fn other_draws_are_refused() {
    let body = format!("{LOADS}return vec4<f32>(occlusion(pixel, 4.0, z, n));");
    let face = StencilFace {
        compare: CompareFunction::Equal,
        fail: StencilOperation::Keep,
        depth_fail: StencilOperation::Keep,
        pass: StencilOperation::Keep,
    };
    let stencil = StencilState {
        front: face,
        back: face,
        read_mask: 1,
        write_mask: 0,
        reference: 1,
    };
    let with = |state: &dyn Fn(&mut MaterialState)| {
        let mut changed = full_screen();
        state(&mut changed);
        code(&in_state(&body, &changed), &within())
    };
    assert_eq!(with(&|s| s.depth_write = true), "depth-test");
    assert_eq!(with(&|s| s.depth_compare = None), "depth-test");
    assert_eq!(
        with(&|s| s.stencil = Some(stencil.clone())),
        "half-rate-stencil"
    );
    let many = Multisample {
        count: 4,
        ..Multisample::default()
    };
    assert_eq!(with(&|s| s.multisample = many), "half-rate-samples");
    assert_eq!(
        code(&original("return vec4<f32>(z);"), &within()),
        "nothing-at-half-rate"
    );
    let plan = in_state(&body, &full_screen());
    assert_eq!(code(&plan, &HalfRateParams::default()), "no-budget");
    let blended = MaterialState {
        targets: vec![Some(ColorTarget {
            blend: Some(preshade_plan::state::Blend::ALPHA),
            ..ColorTarget::opaque("rgba8unorm")
        })],
        ..full_screen()
    };
    let next = applied(&in_state(&body, &blended), &within());
    assert!(
        next.main().unwrap().targets[0]
            .as_ref()
            .unwrap()
            .is_blended()
    );
    assert!(!next.passes[0].targets[0].as_ref().unwrap().is_blended());
}
