//! What the depth transforms refuse, by name and with a remedy: a refusal is a normal outcome, and
//! the original is kept.

use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_passes::analysis::neighbours;
use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::frame::{FrameLoad, FramePlan};
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::{
    Blend, ColorTarget, CompareFunction, DepthBias, MaterialState, StencilFace, StencilOperation,
    StencilState, Topology,
};
use shader_text::options::Options;

const VERTEX: &str =
    "@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }\n";
const FLAT: &str = "@fragment fn fs() -> @location(0) vec4<f32> { return vec4<f32>(1.0); }\n";

fn plan(text: &str, state: &MaterialState) -> Plan {
    let parsed = front::parse(&[Source::new("case.wgsl", text)], &Options::default()).unwrap();
    Plan::original(
        "case",
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        state,
    )
}

/// The code of the first refusal, or `applies`.
fn outcome(plan: &Plan, recipe: &str, facts: &Facts) -> String {
    match Recipe::parse([recipe]).unwrap().apply(plan, facts) {
        Ok(_) => "applies".to_owned(),
        Err(refusal) => {
            assert!(!refusal.remedy.is_empty(), "{refusal} names no remedy");
            refusal.code.clone()
        }
    }
}

fn state(change: impl FnOnce(&mut MaterialState)) -> MaterialState {
    let mut state = MaterialState::default();
    change(&mut state);
    state
}

/// Alpha to coverage with four samples a pixel.
fn covered(change: impl FnOnce(&mut MaterialState)) -> MaterialState {
    state(|s| {
        s.multisample.alpha_to_coverage = true;
        s.multisample.count = 4;
        change(s);
    })
}

#[test]
fn stages_whose_alpha_covers_otherwise_than_a_slice_would() {
    let vertex = "struct V { @builtin(position) p: vec4<f32>, @location(0) \
                  @interpolate(perspective, sample) uv: vec2<f32>, @location(1) a: f32 }\n\
                  @vertex fn vs(@location(0) p: vec4<f32>) -> V { return V(p, p.xy, p.z); }\n";
    let by_sample = format!(
        "{vertex}@fragment fn fs(v: V) -> @location(0) vec4<f32> {{ \
         return vec4<f32>(v.uv, 0.0, v.a); }}\n"
    );
    let three = format!(
        "{VERTEX}@fragment fn fs() -> @location(0) vec3<f32> {{ return vec3<f32>(1.0); }}\n"
    );
    let mask = format!(
        "{VERTEX}struct O {{ @location(0) c: vec4<f32>, @builtin(sample_mask) m: u32 }}\n\
         @fragment fn fs() -> O {{ return O(vec4<f32>(1.0), 1u); }}\n"
    );
    for (text, recipe, code) in [
        (&by_sample, "depth-prepass", "sample-rate"),
        (&three, "depth-prepass", "alpha-to-coverage"),
        (&mask, "depth-prepass", "sample-mask"),
        // A shadow map has one sample, and no colour.
        (&format!("{VERTEX}{FLAT}"), "shadow", "alpha-to-coverage"),
        (&format!("{VERTEX}{FLAT}"), "depth-prepass", "applies"),
    ] {
        let plan = plan(text, &covered(|_| ()));
        let refused = outcome(&plan, recipe, &Facts::default());
        assert_eq!(refused, code, "{recipe} on\n{text}");
    }
    // By sample, but without alpha to coverage.
    let plan = plan(&by_sample, &MaterialState::default());
    assert_eq!(
        outcome(&plan, "depth-prepass", &Facts::default()),
        "applies"
    );
}

#[test]
fn a_pre_pass_under_alpha_to_coverage_has_the_colour_targets_and_writes_none() {
    let text = format!(
        "{VERTEX}struct O {{ @location(0) c: vec4<f32>, @location(1) n: vec4<f32>, \
         @builtin(frag_depth) d: f32 }}\n\
         @fragment fn fs(@builtin(position) p: vec4<f32>) -> O {{ \
         return O(vec4<f32>(sin(p.xyz), p.x), cos(p), p.z); }}\n"
    );
    for recipe in ["depth-prepass", "early-discard"] {
        let original = plan(&text, &covered(|_| ()));
        let plan = Recipe::parse([recipe])
            .unwrap()
            .apply(&original, &Facts::default())
            .unwrap();
        let (prepass, main) = (&plan.passes[0], plan.main().unwrap());
        assert!(prepass.multisample.alpha_to_coverage && main.multisample.alpha_to_coverage);
        let masks = |targets: &[Option<ColorTarget>]| -> Vec<u8> {
            targets.iter().flatten().map(|t| t.write_mask).collect()
        };
        assert_eq!(masks(&prepass.targets), [0, 0]);
        assert_eq!(masks(&main.targets), [15, 15]);
        let Contract::Exact { given } = &plan.contract else {
            panic!("{:?}", plan.contract);
        };
        assert!(given.contains(&Assumption::SameAlphaCoverage), "{given:?}");
        let frame = FramePlan::merge([&plan]).unwrap();
        let loads: Vec<FrameLoad> = frame
            .passes
            .iter()
            .map(|p| p.color_ops[0].unwrap().load)
            .collect();
        assert_eq!(
            loads,
            [FrameLoad::Clear, FrameLoad::Load],
            "the first to touch the colour clears it"
        );
        let emitted = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
        let file = emitted
            .iter()
            .find(|f| f.name == "case.prepass.wgsl")
            .unwrap();
        let text = String::from_utf8(file.bytes.clone()).unwrap();
        assert!(text.contains("@builtin(frag_depth)"), "{text}");
        assert!(!text.contains("sin(") && !text.contains("cos("), "{text}");
    }
}

#[test]
fn states_that_no_prepass_can_stand_in_front_of() {
    let keep = StencilFace {
        compare: CompareFunction::Always,
        fail: StencilOperation::Keep,
        depth_fail: StencilOperation::Keep,
        pass: StencilOperation::Keep,
    };
    let stencil = |pass| StencilState {
        front: StencilFace { pass, ..keep },
        back: StencilFace { pass, ..keep },
        read_mask: 255,
        write_mask: 255,
        reference: 1,
    };
    let blended = |blend| {
        vec![Some(ColorTarget {
            blend: Some(blend),
            ..ColorTarget::opaque("rgba8unorm")
        })]
    };
    for (change, code) in [
        (state(|_| ()), "applies"),
        (state(|s| s.targets = blended(Blend::ALPHA)), "blended"),
        (state(|s| s.targets = blended(Blend::REPLACE)), "applies"),
        (state(|s| s.depth_write = false), "depth-write-off"),
        (
            state(|s| s.depth_compare = Some(CompareFunction::Always)),
            "compare",
        ),
        (
            state(|s| s.depth_compare = Some(CompareFunction::Equal)),
            "compare",
        ),
        (
            state(|s| s.depth_compare = Some(CompareFunction::LessEqual)),
            "applies",
        ),
        (
            state(|s| s.stencil = Some(stencil(StencilOperation::Replace))),
            "stencil-write",
        ),
        (
            state(|s| s.stencil = Some(stencil(StencilOperation::Keep))),
            "stencil-test",
        ),
        // One sample a pixel has no coverage to decide.
        (
            state(|s| s.multisample.alpha_to_coverage = true),
            "alpha-to-coverage",
        ),
        (covered(|_| ()), "applies"),
        (
            covered(|s| s.targets = vec![Some(ColorTarget::opaque("rg16float"))]),
            "alpha-to-coverage",
        ),
        (covered(|s| s.targets = vec![None]), "alpha-to-coverage"),
        (
            covered(|s| s.targets = vec![Some(ColorTarget::opaque("rgba16float"))]),
            "applies",
        ),
        (
            covered(|s| {
                s.targets = vec![Some(ColorTarget {
                    attachment: Some("elsewhere".to_owned()),
                    ..ColorTarget::opaque("rgba8unorm")
                })]
            }),
            "alpha-to-coverage",
        ),
    ] {
        let plan = plan(&format!("{VERTEX}{FLAT}"), &change);
        for recipe in ["depth-prepass", "depth-prepass:form=equal", "early-discard"] {
            assert_eq!(
                outcome(&plan, recipe, &Facts::default()),
                code,
                "{recipe} on {change:?}"
            );
        }
    }
}

/// What the plans of materials that write these channels of two targets say of each other: the code
/// of the refusal of the first, or `together`.
#[test]
fn materials_that_leave_channels_which_others_write() {
    let both = "struct O { @location(0) c: vec4<f32>, @location(1) n: vec4<f32> }\n\
                @fragment fn fs() -> O { return O(vec4<f32>(1.0), vec4<f32>(1.0)); }\n";
    let target = |write_mask| {
        Some(ColorTarget {
            write_mask,
            ..ColorTarget::opaque("rgba8unorm")
        })
    };
    let two = |second| state(|s| s.targets = vec![target(0b1111), second]);
    let narrow = Some(ColorTarget::opaque("rg8unorm"));
    let unwritten = |s: MaterialState| MaterialState {
        depth_write: false,
        ..s
    };
    // Text and state of both, what becomes of a pre-pass of the first, whether the first promises
    // less alone.
    for (first, second, code, partial) in [
        (
            (both, two(target(15))),
            (both, two(target(15))),
            "together",
            false,
        ),
        (
            (both, two(target(7))),
            (both, two(target(15))),
            "color-mask",
            true,
        ),
        (
            (both, two(target(7))),
            (both, two(target(7))),
            "together",
            true,
        ),
        (
            (both, two(target(7))),
            (both, two(target(3))),
            "color-mask",
            true,
        ),
        // The neighbour leaves what the first writes, with a pre-pass or without: farther draws of
        // the first show there.
        (
            (both, two(target(15))),
            (both, two(target(7))),
            "color-mask",
            false,
        ),
        (
            (both, two(target(15))),
            (both, two(target(0))),
            "color-mask",
            false,
        ),
        // One that writes no depth keeps nothing from covering what shows.
        (
            (both, two(target(15))),
            (both, unwritten(two(target(7)))),
            "together",
            false,
        ),
        (
            (both, two(target(7))),
            (both, unwritten(two(target(15)))),
            "color-mask",
            true,
        ),
        // Holes of a geometry buffer: not bound, not an output, not in the format.
        (
            (both, two(None)),
            (both, two(target(15))),
            "color-mask",
            true,
        ),
        ((both, two(None)), (both, two(None)), "together", true),
        (
            (FLAT, state(|_| ())),
            (both, two(target(15))),
            "color-mask",
            false,
        ),
        (
            (FLAT, two(target(15))),
            (both, two(target(15))),
            "color-mask",
            true,
        ),
        (
            (both, two(narrow.clone())),
            (both, two(narrow)),
            "together",
            false,
        ),
        (
            ("", state(|_| ())),
            (FLAT, state(|_| ())),
            "color-mask",
            true,
        ),
        (("", state(|_| ())), ("", state(|_| ())), "together", true),
    ] {
        let first = plan(&format!("{VERTEX}{}", first.0), &first.1);
        let mut second = plan(&format!("{VERTEX}{}", second.0), &second.1);
        second.material = "other".to_owned();
        for recipe in ["depth-prepass", "depth-prepass:form=equal", "early-discard"] {
            let Ok(plan) = Recipe::parse([recipe])
                .unwrap()
                .apply(&first, &Facts::default())
            else {
                // Nothing to leave early in a material without a fragment stage.
                assert_eq!(
                    (recipe, first.main().unwrap().fragment.as_deref()),
                    ("early-discard", None)
                );
                continue;
            };
            let conflict = neighbours::conflict(&plan, [&first, &second]);
            let refused = conflict.map_or("together".to_owned(), |r| r.code);
            assert_eq!(refused, code, "{recipe} on {first:#?}\nbeside {second:#?}");
            let Contract::Exact { given } = &plan.contract else {
                panic!("{:?}", plan.contract);
            };
            assert!(given.contains(&Assumption::OrdinaryNeighbours));
            assert_eq!(
                given.contains(&Assumption::LeftChannelsUnwritten),
                partial,
                "{recipe} on {first:#?}"
            );
        }
    }
}

#[test]
fn what_the_biased_form_alone_refuses() {
    let clamped = DepthBias {
        constant: 1000,
        slope_scale: 1.0,
        clamp: 1e-6,
    };
    for (change, recipe, code) in [
        (
            state(|s| s.depth_bias = clamped),
            "depth-prepass",
            "depth-bias-clamp",
        ),
        (
            state(|s| s.depth_bias = clamped),
            "depth-prepass:form=equal",
            "applies",
        ),
        (
            state(|s| s.primitive.topology = Topology::LineList),
            "depth-prepass",
            "bias-needs-triangles",
        ),
        (
            state(|s| s.primitive.topology = Topology::LineList),
            "depth-prepass:form=equal",
            "applies",
        ),
    ] {
        let plan = plan(&format!("{VERTEX}{FLAT}"), &change);
        assert_eq!(
            outcome(&plan, recipe, &Facts::default()),
            code,
            "{recipe} on {change:?}"
        );
    }
}

/// On the command line they are bad usage, whatever the shader; to the pass itself, a refusal.
#[test]
fn numbers_out_of_their_range() {
    let plan = plan(&format!("{VERTEX}{FLAT}"), &MaterialState::default());
    for (pass, name, value, range, code) in [
        ("hoist", "budget", 2.0, "above 0 and at most 1", "budget"),
        ("hoist", "budget", 0.0, "above 0 and at most 1", "budget"),
        ("hoist", "threshold", -0.5, "at least 0", "threshold"),
        (
            "hoist",
            "vertices-per-fragment",
            -1.0,
            "at least 0",
            "vertices-per-fragment",
        ),
        (
            "early-discard",
            "budget",
            1.5,
            "at least 0 and at most 1",
            "budget",
        ),
        (
            "early-discard",
            "tolerance",
            -1.0,
            "at least 0",
            "tolerance",
        ),
        (
            "depth-prepass",
            "bias-slope",
            -1.0,
            "at least 0",
            "bias-slope",
        ),
        (
            "depth-prepass",
            "bias-constant",
            0.0,
            "at least 1 and at most 16777216",
            "no-bias",
        ),
        (
            "depth-prepass",
            "bias-constant",
            4294967295.0,
            "at least 1 and at most 16777216",
            "bias-constant",
        ),
    ] {
        let text = format!("{pass}:{name}={value}");
        let error = Recipe::parse([&text]).unwrap_err().to_string();
        assert!(
            error.contains(&format!("`{name}` is {range}, which {value} is not")),
            "{error}"
        );
        let mut recipe = Recipe::parse([pass]).unwrap();
        let number = match name {
            "bias-constant" => serde_json::json!(value as u64),
            _ => serde_json::json!(value),
        };
        recipe.steps[0].params.insert(name.to_owned(), number);
        let refusal = recipe.apply(&plan, &Facts::default()).unwrap_err();
        assert_eq!(refusal.code, code, "{text}");
    }
}

/// A depth bias is part of the z that a fragment stage sees, and of nothing else of its position.
#[test]
fn only_the_depth_of_a_position_is_biased() {
    let read = "@fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> { \
                if CONDITION { discard; } return p; }\n";
    let of_struct = "struct In { @builtin(front_facing) f: bool, \
                     @builtin(position) p: vec4<f32> }\n\
                     @fragment fn fs(i: In) -> @location(0) vec4<f32> { var v = i; if CONDITION { \
                     discard; } return v.p; }\n";
    for (text, condition, code) in [
        (read, "fract(p.z * 300.0) > 0.5", "biased-position"),
        (read, "p.x + p.y + p.w > 3.0", "applies"),
        (
            read,
            "dot(p, vec4<f32>(0.0, 0.0, 1.0, 0.0)) > 0.5",
            "biased-position",
        ),
        (read, "p[u32(p.x) & 3u] > 0.5", "biased-position"),
        (read, "(p.wzyx * 2.0).y > 0.5", "biased-position"),
        (read, "(p.wzyx * 2.0).z > 0.5", "applies"),
        (of_struct, "v.p.z > 0.5", "biased-position"),
        (of_struct, "v.p.y > 0.5 && v.f", "applies"),
    ] {
        let text = format!("{VERTEX}{}", text.replace("CONDITION", condition));
        let plan = plan(&text, &MaterialState::default());
        for (recipe, code) in [
            ("depth-prepass", code),
            ("depth-prepass:form=equal", "applies"),
            ("early-discard", "applies"),
            ("early-discard:attachment=readonly", "applies"),
            ("shadow", "applies"),
        ] {
            assert_eq!(
                outcome(&plan, recipe, &Facts::default()),
                code,
                "{recipe} on {condition}"
            );
        }
        let shadow = Recipe::parse(["shadow"]).unwrap();
        let notes = shadow.apply(&plan, &Facts::default()).unwrap().notes;
        let told = notes.iter().any(|n| n.contains("the light's depth"));
        assert_eq!(told, code == "biased-position", "{notes:?}");
    }
}

/// A written depth is pushed away in the shader alone, so that a z it is made of is the main
/// pass's.
#[test]
fn the_pre_pass_of_a_depth_writer_leaves_the_rasteriser_as_it_is() {
    let text = format!(
        "{VERTEX}@early_depth_test(less_equal) @fragment fn fs(@builtin(position) p: vec4<f32>) -> \
         @builtin(frag_depth) f32 {{ if p.z < 0.2 {{ discard; }} return p.z * p.z; }}\n"
    );
    let author = DepthBias {
        constant: 3,
        slope_scale: 0.5,
        clamp: 0.0,
    };
    let original = plan(&text, &state(|s| s.depth_bias = author));
    let plan = Recipe::parse(["depth-prepass"])
        .unwrap()
        .apply(&original, &Facts::default())
        .unwrap();
    assert_eq!(plan.passes[0].depth.as_ref().unwrap().bias, author);
    let files = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
    let text = |name: &str| {
        let file = files.iter().find(|f| f.name == name).unwrap();
        String::from_utf8(file.bytes.clone()).unwrap()
    };
    let prepass = text("case.prepass.wgsl");
    // Pushed away, it may lie behind the rasterised depth.
    assert!(!prepass.contains("early_depth_test"), "{prepass}");
    assert!(text("case.main.wgsl").contains("@early_depth_test(less_equal)"));
}

#[test]
fn ties_are_refused_only_where_they_are_measured_and_matter() {
    let text = format!("{VERTEX}{FLAT}");
    let tied = Facts {
        depth_ties: Some(3),
        undiscarded_depth_ties: Some(3),
        ..Facts::default()
    };
    let less = plan(&text, &MaterialState::default());
    let less_equal = plan(
        &text,
        &state(|s| s.depth_compare = Some(CompareFunction::LessEqual)),
    );
    for (plan, recipe, facts, code) in [
        (&less, "depth-prepass:form=equal", &tied, "depth-ties"),
        (
            &less,
            "early-discard:attachment=readonly",
            &tied,
            "depth-ties",
        ),
        (&less, "depth-prepass", &tied, "applies"),
        (&less, "early-discard", &tied, "applies"),
        (
            &less,
            "depth-prepass:form=equal",
            &Facts::default(),
            "applies",
        ),
        // The last of several tied fragments wins in both.
        (&less_equal, "depth-prepass:form=equal", &tied, "applies"),
    ] {
        assert_eq!(outcome(plan, recipe, facts), code, "{recipe}");
    }
}

#[test]
fn shaders_that_do_more_than_shade() {
    let storage = "@group(0) @binding(0) var<storage, read_write> counter: array<atomic<u32>>;\n";
    let vertex_store = "@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { \
                        atomicAdd(&counter[0], 1u); return p; }\n";
    let fragment_store = "fn note() { atomicAdd(&counter[0], 1u); }\n\
                          @fragment fn fs() -> @location(0) vec4<f32> { note(); \
                          return vec4<f32>(1.0); }\n";
    let mask = "struct O { @location(0) c: vec4<f32>, @builtin(sample_mask) m: u32 }\n\
                @fragment fn fs() -> O { return O(vec4<f32>(1.0), 1u); }\n";
    let forced = "@early_depth_test(force) @fragment fn fs(@builtin(position) p: vec4<f32>) -> \
                  @location(0) vec4<f32> { if p.x < 3.0 { discard; } return vec4<f32>(1.0); }\n";
    let depth = "@fragment fn fs() -> @builtin(frag_depth) f32 { return 0.5; }\n";
    // Left by the discard alone where `x` is not above 0.
    let marched = "@fragment fn fs(@builtin(position) at: vec4<f32>) -> @builtin(frag_depth) f32 {
        var x = at.x - 8.0;
        loop { x = x * 1.7; if x > 4.0 { break; } if x <= 0.0 { discard; } }
        return fract(x);
    }\n";
    let counted = "@fragment fn fs(@builtin(position) at: vec4<f32>) -> @builtin(frag_depth) f32 {
        var x = at.x - 8.0;
        for (var i = 0; i < 8; i++) { x = x * 1.7; if x > 4.0 { break; } if x <= 0.0 { discard; } }
        return fract(x);
    }\n";
    for (text, recipe, code) in [
        (format!("{VERTEX}{marched}"), "early-discard", "depth-loop"),
        (format!("{VERTEX}{marched}"), "depth-prepass", "applies"),
        (format!("{VERTEX}{counted}"), "early-discard", "applies"),
        (
            format!("{storage}{vertex_store}{FLAT}"),
            "depth-prepass",
            "vertex-store",
        ),
        (
            format!("{storage}{VERTEX}{fragment_store}"),
            "depth-prepass",
            "fragment-store",
        ),
        (format!("{VERTEX}{mask}"), "depth-prepass", "sample-mask"),
        (
            format!("{VERTEX}{forced}"),
            "depth-prepass",
            "forced-early-test",
        ),
        (
            format!("{VERTEX}{depth}"),
            "depth-prepass:form=equal",
            "depth-not-invariant",
        ),
        (format!("{VERTEX}{depth}"), "depth-prepass", "applies"),
        (
            format!("{VERTEX}{depth}"),
            "early-discard:attachment=readonly",
            "readonly-depth-writer",
        ),
        (VERTEX.to_owned(), "early-discard", "no-fragment-stage"),
        (VERTEX.to_owned(), "depth-prepass", "applies"),
    ] {
        let plan = plan(&text, &MaterialState::default());
        assert_eq!(
            outcome(&plan, recipe, &Facts::default()),
            code,
            "{recipe} on\n{text}"
        );
    }
}

/// No order helps a step that the material refuses: then its own reason is told.
#[test]
fn an_order_is_blamed_only_where_another_helps() {
    let code = |text: &str| {
        let plan = plan(text, &MaterialState::default());
        let recipe = Recipe::parse(["depth-prepass", "early-alpha"]).unwrap();
        let (_, skipped) = preshade_compiler::pipeline::apply(&plan, &recipe, &Facts::default());
        let codes = skipped.iter().map(|s| s.refusal.code.clone());
        codes.collect::<Vec<_>>()
    };
    assert_eq!(code(&format!("{VERTEX}{FLAT}")), ["no-discard"]);
    let late = std::fs::read_to_string("fixtures/shaders/late-alpha.wgsl").unwrap();
    assert_eq!(code(&late), ["not-first"]);
}

/// WebGPU filters no depth texture. All passes of the material say so, for they share its bind group.
#[test]
fn a_sampler_of_depths_is_non_filtering() {
    use preshade_plan::plan::BindingLayout;
    let text = "@group(0) @binding(0) var leaf: texture_2d<f32>;
@group(0) @binding(1) var depths: texture_depth_2d;
@group(0) @binding(2) var both: sampler;
@group(0) @binding(3) var smooth_one: sampler;
struct V { @builtin(position) p: vec4f, @location(0) uv: vec2f }
@vertex fn vs(@location(0) p: vec4f) -> V { return V(p, p.xy); }
fn depth(t: texture_depth_2d, s: sampler, uv: vec2f) -> f32 { return textureSample(t, s, uv); }
@fragment fn fs(v: V) -> @location(0) vec4f {
    let test = textureSample(leaf, both, v.uv);
    let d = depth(depths, both, v.uv);
    let more = textureSample(leaf, smooth_one, v.uv);
    if (test.a < 0.5) { discard; }
    return test * d + more;
}
";
    let original = plan(text, &MaterialState::default());
    let recipe = Recipe::parse(["depth-prepass"]).unwrap();
    let changed = recipe.apply(&original, &Facts::default()).unwrap();
    assert_eq!(changed.passes.len(), 2);
    for pass in original.passes.iter().chain(&changed.passes) {
        let layout = |binding: u32| {
            let found = pass.bindings.iter().find(|b| b.binding == binding);
            found.and_then(|b| b.layout.clone())
        };
        assert_eq!(layout(2), Some(BindingLayout::non_filtering()));
        let filtering = BindingLayout::Sampler {
            ty: "filtering".to_owned(),
        };
        assert!(layout(3).is_none_or(|layout| layout == filtering));
    }
}
