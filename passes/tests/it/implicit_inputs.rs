//! Passes refuse, or name an assumption, where they change what a stage depends on besides its
//! inputs.

use naga::ShaderStage;
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_passes::transforms::depth_prepass::{self, DepthPrepass};
use preshade_passes::transforms::early_discard::{self, EarlyDiscard, MainAttachment};
use preshade_passes::transforms::hoist::{self, Allow, Hoist};
use preshade_plan::contract::Assumption;
use preshade_plan::pass::{Facts, Outcome, Pass, Refused};
use preshade_plan::plan::{Plan, SelfTestDraw};
use preshade_plan::state::{Blend, ColorTarget, DepthFormat, MaterialState};

use crate::common;

/// A material whose fragment stage has these extra arguments and this body.
fn material(varying: &str, arguments: &str, body: &str) -> String {
    format!(
        "struct Uniforms {{ mvp: mat4x4<f32>, a: f32, b: f32 }}
@group(0) @binding(0) var<uniform> u: Uniforms;
struct Varyings {{
    @builtin(position) position: vec4<f32>,
    @location(0) {varying} uv: vec2<f32>,
    @location(1) normal: vec3<f32>,
}}
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>, \
    @location(2) uv: vec2<f32>) -> Varyings {{
    return Varyings(u.mvp * vec4<f32>(position, 1.0), uv, normal);
}}
@fragment fn fs(in: Varyings{arguments}) -> @location(0) vec4<f32> {{
{body}
}}"
    )
}

fn plan(source: &str, change: impl Fn(&mut MaterialState)) -> Plan {
    let mut state = MaterialState::default();
    change(&mut state);
    Plan::original("test", common::program(source), "vs", Some("fs"), &state)
}

fn four_samples(state: &mut MaterialState) {
    state.multisample.count = 4;
}

fn prepass(plan: &Plan) -> Result<Outcome, Refused> {
    DepthPrepass::run(
        plan,
        &Facts::default(),
        &depth_prepass::DepthPrepassParams::default(),
    )
}

fn equal(plan: &Plan, facts: &Facts) -> Result<Outcome, Refused> {
    let params = depth_prepass::DepthPrepassParams {
        form: depth_prepass::PrepassForm::Equal,
        ..depth_prepass::DepthPrepassParams::default()
    };
    DepthPrepass::run(plan, facts, &params)
}

fn early_discard(plan: &Plan, attachment: MainAttachment) -> Result<Outcome, Refused> {
    let params = early_discard::EarlyDiscardParams {
        attachment,
        ..early_discard::EarlyDiscardParams::default()
    };
    EarlyDiscard::run(plan, &Facts::default(), &params)
}

fn codes(result: Result<Outcome, Refused>) -> Vec<String> {
    match result {
        Ok(_) => Vec::new(),
        Err(refused) => refused.refusals.iter().map(|r| r.code.clone()).collect(),
    }
}

fn assumptions(result: Result<Outcome, Refused>) -> Vec<Assumption> {
    result.unwrap().plan.contract.given().to_vec()
}

const UV: &str = "@interpolate(perspective)";

#[test]
fn subgroup_operations_are_refused() {
    let body = "    let c = subgroupAdd(in.uv.x);
    return vec4<f32>(fract(c * 3.7), in.normal.y, 0.0, 1.0);";
    let plan = plan(&material(UV, "", body), |_| {});
    for result in [
        prepass(&plan),
        equal(&plan, &Facts::default()),
        early_discard(&plan, MainAttachment::Own),
    ] {
        assert_eq!(codes(result), ["subgroup"]);
    }
}

#[test]
fn a_slice_keeps_the_sample_rate_or_is_refused() {
    let arguments = ", @builtin(sample_index) sample: u32";
    let colour = "    return vec4<f32>(in.normal, f32(sample) / 4.0);";
    let by_pixel = format!("    if fract(in.position.x) < 0.45 {{ discard; }}\n{colour}");
    let by_sample = format!("    if sample == 2u && in.uv.x < 0.5 {{ discard; }}\n{colour}");
    let by_draw = format!("    if u.a < 0.45 {{ discard; }}\n{colour}");
    let refused = |body: &str, change: fn(&mut MaterialState)| {
        codes(prepass(&plan(&material(UV, arguments, body), change)))
    };
    assert_eq!(refused(&by_pixel, four_samples), ["sample-rate"]);
    // Both rates shade one point, to which SwiftShader interpolates by two formulas.
    assert_eq!(refused(&by_pixel, |_| {}), ["sample-rate"]);
    assert!(refused(&by_sample, four_samples).is_empty());
    assert!(refused(&by_draw, four_samples).is_empty());
    assert!(refused(colour, four_samples).is_empty());
}

#[test]
fn centroids_and_masks_are_refused_where_samples_are_rejected_early() {
    let body = "    return vec4<f32>(fract(in.uv * 20.0), in.normal.y, 1.0);";
    let centroid = material("@interpolate(perspective, centroid)", "", body);
    let plans = [plan(&centroid, four_samples), plan(&centroid, |_| {})];
    assert_eq!(codes(prepass(&plans[0])), ["surviving-samples"]);
    let readonly = early_discard(&plans[0], MainAttachment::Readonly);
    assert_eq!(codes(readonly), ["surviving-samples"]);
    assert!(codes(early_discard(&plans[0], MainAttachment::Own)).is_empty());
    assert!(codes(prepass(&plans[1])).is_empty());
    let mask = material(
        UV,
        ", @builtin(sample_mask) mask: u32",
        "    return vec4<f32>(f32(mask));",
    );
    assert_eq!(
        codes(prepass(&plan(&mask, four_samples))),
        ["surviving-samples"]
    );
}

#[test]
fn depths_that_a_shader_writes_are_clamped_in_every_format() {
    let source = "struct Uniforms { mvp: mat4x4<f32> }
@group(0) @binding(0) var<uniform> u: Uniforms;
@vertex fn vs(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> {
    return u.mvp * vec4<f32>(position, 1.0);
}
struct Output { @location(0) color: vec4<f32>, @builtin(frag_depth) depth: f32 }
@fragment fn fs(@builtin(position) position: vec4<f32>) -> Output {
    return Output(vec4<f32>(1.0), position.z - 0.99);
}";
    let plan = plan(source, |state| {
        state.depth_format = DepthFormat::Depth16unorm;
    });
    let near = Assumption::BeyondNearPlane;
    assert!(assumptions(prepass(&plan)).contains(&near));
    let whole = Assumption::WholeDepthRange;
    assert!(assumptions(early_discard(&plan, MainAttachment::Own)).contains(&whole));
}

/// Where a product moves and its sum stays, a compiler no longer fuses them.
#[test]
fn a_product_that_a_sum_reads_is_not_exact() {
    let exact = hoist::HoistParams {
        allow: Some(Allow::Exact),
        vertices_per_fragment: Some(0.0),
        ..hoist::HoistParams::default()
    };
    let hoisted = |body: &str| {
        let plan = plan(&material(UV, "", body), |_| {});
        let done = Hoist::run(&plan, &Facts::default(), &exact).unwrap();
        let text = common::wgsl(done.plan.program(done.plan.main().unwrap()).unwrap());
        let start = text.find("fn hoisted").unwrap();
        text[start..].split("\n}").next().unwrap().to_owned()
    };
    let cut = hoisted(
        "    let k = sin(u.a) * u.b;
    return vec4<f32>(fract((k + in.uv.x) * 65536.0), 0.5, 0.5, 1.0);",
    );
    assert!(cut.contains("sin(") && !cut.contains("* "), "{cut}");
    let compared = hoisted(
        "    let k = sin(u.a) * u.b;
    return vec4<f32>(select(0.0, 1.0, k < in.uv.x), 0.5, 0.5, 1.0);",
    );
    assert!(compared.contains("* "), "{compared}");
}

/// A compiler sees through `abs` and a selection, writes a known power as products, sees how a
/// varying was computed, and counts the readers that stay.
#[test]
fn what_a_compiler_rounds_otherwise_elsewhere_is_not_exact() {
    let exact = hoist::HoistParams {
        allow: Some(Allow::Exact),
        vertices_per_fragment: Some(0.0),
        ..hoist::HoistParams::default()
    };
    let hoisted = |body: &str| {
        let source = material("@interpolate(flat, either)", "", body);
        let done = Hoist::run(&plan(&source, |_| {}), &Facts::default(), &exact);
        done.map_or_else(|_| String::new(), |done| done.change.what)
    };
    let read = |k: &str| {
        format!("    let k = {k};\n    return vec4<f32>(k + in.position.x, 0.5, 0.5, 1.0);")
    };
    assert!(hoisted(&read("sin(u.a)")).contains("`k`"));
    assert!(hoisted(&read("floor(u.a * u.b)")).contains("`k`"));
    for body in [
        read("abs(u.a * u.b)"),
        read("max(u.a * u.b, 0.0)"),
        read("pow(u.a, 2.0)"),
        read("select(u.a * u.b, 1.0, u.b > 2.0)"),
        read("floor(in.uv.x + u.a)"),
        format!(
            "    let p = u.a * u.b;\n    let k = floor(p + u.a);\n{}",
            "    return vec4<f32>(k, p * in.position.x, 0.5, 1.0);"
        ),
    ] {
        let what = hoisted(&body);
        assert!(!what.contains("`k`"), "{what}: {body}");
    }
}

/// Without its input by sample, a specialised stage would run once for each pixel.
#[test]
fn a_specialised_stage_keeps_the_sample_rate() {
    let source = material(
        UV,
        ", @builtin(sample_index) sample: u32",
        "    var color = in.uv.x;
    if u.a > 0.5 { color = f32(sample); }
    return vec4<f32>(fract(color * 8.0));",
    );
    let specialize = preshade_geometry::pass_named("specialize").unwrap();
    let params = serde_json::json!({ "set": "u.a=0" });
    let run = |change: fn(&mut MaterialState)| {
        codes(specialize.run(&plan(&source, change), &Facts::default(), &params))
    };
    assert_eq!(run(four_samples), ["sample-rate"]);
    assert_eq!(run(|_| {}), ["sample-rate"]);
}

/// Code that joins a vertex stage may change how a driver compiles the position.
#[test]
fn an_edited_vertex_stage_is_compared_with_the_original() {
    let body = "    return vec4<f32>(sin(u.a), in.uv, 1.0);";
    let params = hoist::HoistParams {
        vertices_per_fragment: Some(0.0),
        ..hoist::HoistParams::default()
    };
    let source = material(UV, "", body);
    let hoisted = |source: &str| Hoist::run(&plan(source, |_| {}), &Facts::default(), &params);
    let plan = hoisted(&source).unwrap().plan;
    assert!(
        plan.contract
            .given()
            .contains(&Assumption::UnchangedPosition)
    );
    let runs = plan.self_test.as_ref().unwrap().runs.iter();
    let has_both = |draws: &[SelfTestDraw]| draws.iter().filter(|d| d.original).count() == 1;
    assert!(runs.clone().count() == 2 && runs.clone().all(|run| has_both(&run.draws)));

    let later = prepass(&plan).unwrap().plan;
    assert_eq!(later.self_test.unwrap().runs.len(), 3);
    let invariant = source.replace("@builtin(position)", "@invariant @builtin(position)");
    assert!(hoisted(&invariant).unwrap().plan.self_test.is_none());
}

/// Without its discard the main pass says nothing about coverage.
#[test]
fn a_main_pass_without_its_discard_is_compared_with_the_original() {
    let body = "    if fract(in.uv.x * u.a) < 0.5 { discard; }
    return vec4<f32>(in.normal, 1.0);";
    let plan = plan(&material(UV, "", body), |_| {});
    let facts = |ties| Facts {
        depth_ties: Some(0),
        undiscarded_depth_ties: Some(ties),
        ..Facts::default()
    };
    let compared = |ties| {
        let plan = equal(&plan, &facts(ties)).unwrap().plan;
        let runs = plan.self_test.unwrap().runs;
        runs.iter()
            .flat_map(|r| &r.draws)
            .filter(|d| d.original)
            .count()
    };
    assert_eq!(compared(0), 2);
    assert_eq!(compared(1), 0);
}

#[test]
fn a_budget_says_whether_it_was_measured() {
    let body = "    return vec4<f32>(normalize(in.normal), 1.0);";
    let plan = plan(&material(UV, "", body), |_| {});
    let params =
        serde_json::json!({ "budget": 0.1, "finite": "assumed", "vertices-per-fragment": 0 });
    let hoist = preshade_geometry::pass_named("hoist").unwrap();
    let given = |facts: &Facts| {
        let plan = hoist.run(&plan, facts, &params).unwrap().plan;
        assert_eq!(plan.contract.kind(), "approximate");
        plan.contract.given().to_vec()
    };
    assert!(given(&Facts::default()).contains(&Assumption::NotMeasured));
    let measured = Facts {
        depth_ties: Some(0),
        undrawn: Some(Vec::new()),
        ..Facts::default()
    };
    assert!(given(&measured).contains(&Assumption::MeasuredScene));
}

/// SPIR-V's `OpKill` ends a fragment, and its neighbours' derivatives are undefined from then on.
#[test]
fn a_discard_stays_where_a_derivative_follows_it() {
    let facts = Facts {
        depth_ties: Some(0),
        undiscarded_depth_ties: Some(0),
        ..Facts::default()
    };
    let discard = "if fract(in.uv.x * u.a) < 0.5 { discard; }";
    let colour = "return vec4<f32>(in.normal.xy, width, 1.0);";
    let before = format!("let width = fwidth(in.uv.x);\n{discard}\n{colour}");
    let after = format!("{discard}\nlet width = fwidth(in.uv.x);\n{colour}");
    let looped = format!(
        "var width = 0.0;
        for (var i = 0; i < 2; i++) {{
            width += fwidth(in.uv.x * f32(i));
            {discard}
        }}
        {colour}"
    );
    let discards = |body: &str| {
        let plan = plan(&material(UV, "", body), |_| {});
        let plan = equal(&plan, &facts).unwrap().plan;
        let main = plan.main().unwrap();
        let graph = Graph::build(plan.program(main).unwrap());
        let entry = graph.program().entry_point(ShaderStage::Fragment, "fs");
        graph.may_discard(FunctionId::EntryPoint(entry.unwrap().0))
    };
    assert!(!discards(&before));
    assert!(discards(&after) && discards(&looped));
}

#[test]
fn lanes_leave_early_only_where_derivatives_are_defined() {
    let codes = |first: &str, condition: &str| {
        let body = format!(
            "{first}
            var width = 0.0;
            if {condition} {{ width = fwidth(in.uv.x); }}
            return vec4<f32>(in.normal.xy, width, 1.0);"
        );
        codes(early_discard(
            &plan(&material(UV, "", &body), |_| {}),
            MainAttachment::Own,
        ))
    };
    let discard = "if fract(in.uv.x * u.a) < 0.5 { discard; }";
    assert_eq!(codes(discard, "in.uv.y > 0.5"), ["undefined-derivative"]);
    assert!(codes(discard, "u.b > 0.5").is_empty());
    assert!(codes("", "in.uv.y > 0.5").is_empty());
}

#[test]
fn a_refusal_tells_alpha_alone_from_blended_colour() {
    let source = material("", "", "    return vec4<f32>(in.uv, 0.0, 0.5);");
    let told = |blend: Blend| {
        let plan = plan(&source, |state| {
            state.targets = vec![Some(ColorTarget {
                blend: Some(blend),
                ..ColorTarget::opaque("rgba8unorm")
            })];
        });
        let refused = DepthPrepass::run(&plan, &Facts::default(), &Default::default());
        refused.unwrap_err().refusals[0].reason.clone()
    };
    let alone = Blend {
        color: Blend::REPLACE.color,
        ..Blend::ALPHA
    };
    assert!(
        told(alone).starts_with("the material blends alpha"),
        "{}",
        told(alone)
    );
    assert!(
        told(Blend::ALPHA).starts_with("the material is blended"),
        "{}",
        told(Blend::ALPHA)
    );
}
