//! The self-tests of plans, run as a host runs them: they hold as emitted, and fail where a driver
//! (here: a changed plan) breaks what the plan rests on.

use std::path::Path;

use glam::Mat4;
use naga::{
    BinaryOperator, Binding, BuiltIn, Expression, Literal, Module, Scalar, ShaderStage, Span, Type,
    TypeInner, VectorSize,
};
use naga_edit::returns;
use naga_edit::writer::FunctionWriter;
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{SceneInputs, SelfTestResult};
use preshade_draw::scene::Scene;
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings, Variant, verify};
use preshade_lab::report::table;
use preshade_plan::contract::Verdict;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{Plan, Role, SamplesPassed};
use preshade_plan::state::{CompareFunction, DepthBias};
use preshade_scenes::ShaderForm;
use preshade_scenes::self_test;

use crate::render_support::{scene as scene_of, *};

const BIASED: &str = "depth-prepass";
const EQUAL: &str = "depth-prepass:form=equal";

fn load(name: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fixtures/scenes/{name}.toml"));
    let mut scene = preshade_scenes::load(&path).unwrap().resized([96, 54]);
    scene.cameras.truncate(2);
    scene.orders.truncate(1);
    scene
}

/// The variant, as if the scene were free of ties.
fn variant(scene: &Scene, recipe: &str) -> Variant {
    let facts = Facts {
        depth_ties: Some(0),
        ..Facts::default()
    };
    let recipe = Recipe::parse([recipe]).unwrap();
    measure::variant(&measure::originals(scene), &recipe, &facts)
}

/// What the self-tests of a variant's plans say, of those that have one.
fn run(scene: &Scene, variant: &Variant) -> Vec<SelfTestResult> {
    let inputs = SceneInputs::new(gpu(), scene).unwrap();
    let test = |plan| self_test(&inputs, plan, ShaderForm::Text).unwrap();
    variant.plans.iter().filter_map(test).collect()
}

fn all_failed(results: &[SelfTestResult]) -> bool {
    let failed = |r: &SelfTestResult| matches!(r, SelfTestResult::Failed { .. });
    !results.is_empty() && results.iter().all(failed)
}

fn tests(variant: &mut Variant) -> Vec<&mut Plan> {
    let plans = variant.plans.iter_mut();
    plans.filter(|p| p.self_test.is_some()).collect()
}

/// Gives one pass of every plan with a self-test a program of its own, whose position is multiplied
/// by `factor`, component by component: what a driver does that compiles one vertex stage in two
/// ways.
fn scale_position(variant: &mut Variant, role: Role, factor: [f32; 4]) {
    for plan in tests(variant) {
        let pass = plan.passes.iter().find(|p| p.role == role).unwrap();
        let program = plan.program(pass).unwrap();
        let mut module = program.module().clone();
        let (index, _) = program
            .entry_point(ShaderStage::Vertex, &pass.vertex)
            .unwrap();
        scale(&mut module, index, factor);
        let moved = program.with_module(module).unwrap();
        plan.programs.insert("moved".to_owned(), moved);
        for pass in plan.passes.iter_mut().filter(|p| p.role == role) {
            pass.program = "moved".to_owned();
        }
    }
}

fn scale(module: &mut Module, entry: usize, factor: [f32; 4]) {
    let is_position = |binding: &Option<Binding>| {
        matches!(binding, Some(Binding::BuiltIn(BuiltIn::Position { .. })))
    };
    let vector = Type {
        name: None,
        inner: TypeInner::Vector {
            size: VectorSize::Quad,
            scalar: Scalar::F32,
        },
    };
    let vector = module.types.insert(vector, Span::UNDEFINED);
    let function = &mut module.entry_points[entry].function;
    let result = function.result.clone().unwrap();
    let members = match &module.types[result.ty].inner {
        TypeInner::Struct { members, .. } => Some(members),
        _ => None,
    };
    let mut scaled = 0;
    returns::rewrite(function, &mut |writer, value| {
        let value = value?;
        let components = factor
            .map(|f| writer.expression(Expression::Literal(Literal::F32(f))))
            .to_vec();
        let by = writer.expression(Expression::Compose {
            ty: vector,
            components,
        });
        let mut times = |writer: &mut FunctionWriter, left| {
            scaled += 1;
            writer.expression(Expression::Binary {
                op: BinaryOperator::Multiply,
                left,
                right: by,
            })
        };
        let Some(members) = members else {
            return Some(times(writer, value));
        };
        let components = (0..)
            .zip(members)
            .map(|(index, member)| {
                let part = writer.expression(Expression::AccessIndex { base: value, index });
                match is_position(&member.binding) {
                    true => times(writer, part),
                    false => part,
                }
            })
            .collect();
        Some(writer.expression(Expression::Compose {
            ty: result.ty,
            components,
        }))
    });
    assert!(scaled > 0);
}

fn set_bias(variant: &mut Variant, change: impl Fn(DepthBias) -> DepthBias) {
    for plan in tests(variant) {
        for pass in plan.passes.iter_mut().filter(|p| p.role == Role::Prepass) {
            let depth = pass.depth.as_mut().unwrap();
            depth.bias = change(depth.bias);
        }
    }
}

/// Scenes, with the number of materials whose plans have a self-test in every form.
const SCENES: [(&str, usize); 9] = [
    ("simple", 3),
    ("instanced", 1),
    ("skinned", 1),
    ("msaa", 3),
    ("reversed-z", 3),
    ("alpha-coverage", 3),
    ("gbuffer", 1),
    ("viewport", 3),
    ("d16", 3),
];

const READ_ONLY: &str = "early-discard:attachment=readonly";

#[test]
fn they_hold_as_emitted() {
    for (name, materials) in SCENES {
        let scene = load(name);
        for recipe in [
            BIASED,
            EQUAL,
            "depth-prepass:form=equal,vertex=sliced",
            READ_ONLY,
        ] {
            let results = run(&scene, &variant(&scene, recipe));
            assert_eq!(results.len(), materials, "{name} {recipe}");
            for result in &results {
                assert!(
                    matches!(result, SelfTestResult::Held { samples } if *samples > 50),
                    "{name} {recipe}: {result:?}"
                );
            }
        }
    }
}

#[test]
fn what_writes_depth_is_tested_biased() {
    let scene = load("frag-depth");
    let results = run(&scene, &variant(&scene, BIASED));
    assert!(
        matches!(results[..], [SelfTestResult::Held { .. }]),
        "{results:?}"
    );
}

#[test]
fn a_bias_of_the_wrong_sign_fails() {
    for (name, _) in SCENES {
        let scene = load(name);
        let mut turned = variant(&scene, BIASED);
        set_bias(&mut turned, |bias| DepthBias {
            constant: -bias.constant,
            slope_scale: -bias.slope_scale,
            ..bias
        });
        assert!(all_failed(&run(&scene, &turned)), "{name}");
    }
}

#[test]
fn without_a_bias_what_must_be_strictly_nearer_fails() {
    let scene = load("simple");
    let mut flat = variant(&scene, BIASED);
    set_bias(&mut flat, |_| DepthBias::default());
    assert!(all_failed(&run(&scene, &flat)));
    // Under LessEqual a tie passes, as long as it is one.
    let mut scene = scene;
    for material in &mut scene.materials {
        material.state.depth_compare = Some(CompareFunction::LessEqual);
    }
    let mut flat = variant(&scene, BIASED);
    set_bias(&mut flat, |_| DepthBias::default());
    let results = run(&scene, &flat);
    assert!(
        results
            .iter()
            .all(|r| matches!(r, SelfTestResult::Held { .. })),
        "{results:?}"
    );
    let nearer = [1.0, 1.0, 1.0 - 1e-6, 1.0];
    scale_position(&mut flat, Role::Prepass, nearer);
    assert!(all_failed(&run(&scene, &flat)));
}

#[test]
fn positions_that_differ_in_their_last_bits_fail_under_equal() {
    for (name, _) in SCENES.iter().filter(|(name, _)| *name != "d16") {
        let scene = load(name);
        for (role, factor) in [
            (Role::Prepass, 1.0 + 1e-6),
            (Role::Prepass, 1.0 - 1e-6),
            (Role::Main, 1.0 + 1e-6),
            (Role::Main, 1.0 - 1e-6),
        ] {
            let mut moved = variant(&scene, EQUAL);
            scale_position(&mut moved, role, [factor, factor, factor, 1.0]);
            let results = run(&scene, &moved);
            assert!(
                all_failed(&results),
                "{name} {role:?} {factor}: {results:?}"
            );
        }
    }
}

#[test]
fn a_main_pass_behind_the_depth_it_reads_fails() {
    let scene = load("simple");
    let mut moved = variant(&scene, READ_ONLY);
    scale_position(&mut moved, Role::Main, [1.0, 1.0, 1.0 + 1e-6, 1.0]);
    assert!(all_failed(&run(&scene, &moved)));
}

#[test]
fn a_pre_pass_is_compared_with_the_original_where_the_main_pass_discards_no_more() {
    let scene = load("simple");
    let facts = Facts {
        depth_ties: Some(0),
        undiscarded_depth_ties: Some(0),
        ..Facts::default()
    };
    let recipe = Recipe::parse([EQUAL]).unwrap();
    let mut kept = measure::variant(&measure::originals(&scene), &recipe, &facts);
    let runs = |p: &Plan| (p.material.clone(), p.self_test.as_ref().unwrap().runs.len());
    let mut counts: Vec<_> = kept.plans.iter().map(runs).collect();
    counts.sort();
    let expected = [("leaves", 3), ("marble", 2), ("tiles", 2)];
    assert_eq!(counts, expected.map(|(m, n)| (m.to_owned(), n)));
    let results = run(&scene, &kept);
    assert!(
        results
            .iter()
            .all(|r| matches!(r, SelfTestResult::Held { .. })),
        "{results:?}"
    );
    scale_position(&mut kept, Role::Main, [1.0, 1.0, 1.0 + 1e-6, 1.0]);
    assert!(all_failed(&run(&scene, &kept)));
}

/// The pre-pass that decides coverage alone covers what the original discards.
#[test]
fn a_pre_pass_that_covers_more_fails() {
    let scene = load("simple");
    let facts = Facts {
        depth_ties: Some(0),
        undiscarded_depth_ties: Some(0),
        ..Facts::default()
    };
    let recipe = Recipe::parse([EQUAL]).unwrap();
    let mut whole = measure::variant(&measure::originals(&scene), &recipe, &facts);
    whole.plans.retain(|plan| plan.material == "leaves");
    for plan in tests(&mut whole) {
        let prepass = plan.passes.iter_mut().find(|p| p.role == Role::Prepass);
        prepass.unwrap().fragment = None;
    }
    let results = run(&scene, &whole);
    assert!(all_failed(&results), "{results:?}");
}

/// A hoisted vertex stage is compared with the original's, also before and behind a pre-pass.
#[test]
fn an_edited_vertex_stage_that_moves_fails() {
    let scene = load("instanced");
    for then in [
        None,
        Some(BIASED),
        Some(EQUAL),
        Some("early-discard"),
        Some(READ_ONLY),
    ] {
        let recipe = Recipe::parse(["hoist:allow=exact"].into_iter().chain(then)).unwrap();
        let facts = Facts {
            depth_ties: Some(0),
            ..Facts::default()
        };
        let edited = || measure::variant(&measure::originals(&scene), &recipe, &facts);
        let results = run(&scene, &edited());
        assert!(
            matches!(results[..], [SelfTestResult::Held { .. }]),
            "{recipe}: {results:?}"
        );
        for factor in [1.0 + 1e-6, 1.0 - 1e-6] {
            let mut moved = edited();
            scale_position(&mut moved, Role::Main, [factor, factor, factor, 1.0]);
            let results = run(&scene, &moved);
            assert!(all_failed(&results), "{recipe} {factor}: {results:?}");
        }
    }
}

/// At the far plane a biased depth is clamped to what depth is cleared to, and hides nothing.
#[test]
fn surfaces_at_the_far_plane_hold() {
    let source = "
struct Camera { view_proj: mat4x4<f32> }
struct Object { model: mat4x4<f32>, tint: vec4<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> object: Object;
struct Output { @location(0) color: vec4<f32>, @builtin(frag_depth) depth: f32 }
@vertex fn vs(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> {
    return camera.view_proj * object.model * vec4(position, 1.0);
}
@fragment fn fs(@builtin(position) position: vec4<f32>) -> Output {
    return Output(object.tint, select(0.5, 1.5, position.x > 16.0));
}
";
    let draws = vec![draw("far", Mat4::IDENTITY, [1.0; 4])];
    let scene = scene_of([32, 32], vec![material("far", source)], draws);
    let results = run(&scene, &variant(&scene, BIASED));
    assert!(
        matches!(results[..], [SelfTestResult::Held { .. }]),
        "{results:?}"
    );
}

#[test]
fn what_no_camera_sees_says_nothing() {
    let mut scene = load("instanced");
    let variant = variant(&scene, BIASED);
    scene.draws.clear();
    let results = run(&scene, &variant);
    assert!(
        matches!(results[..], [SelfTestResult::NotRun { .. }]),
        "{results:?}"
    );
}

#[test]
fn an_own_attachment_and_an_original_have_none() {
    let scene = load("simple");
    assert_eq!(run(&scene, &variant(&scene, "early-discard")), []);
    assert!(
        measure::originals(&scene)
            .iter()
            .all(|p| p.self_test.is_none())
    );
}

#[test]
fn verify_names_the_fallback_and_leaves_the_verdict_to_the_picture() {
    let scene = load("simple");
    let mut held = variant(&scene, EQUAL);
    held.name = "held".to_owned();
    let mut failed = variant(&scene, BIASED);
    failed.name = "failed".to_owned();
    // The test is data: this one cannot be met, whatever the pictures are.
    for plan in tests(&mut failed) {
        for draw in plan
            .self_test
            .iter_mut()
            .flat_map(|t| &mut t.runs)
            .flat_map(|r| &mut r.draws)
        {
            if draw.samples == SamplesPassed::None {
                draw.compare = CompareFunction::Always;
            }
        }
    }
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    };
    let outcome = verify(
        &Session::new(gpu(), &scene, ShaderForm::Text).unwrap(),
        &[held, failed],
        &settings,
        &mut |_| {},
    )
    .unwrap();
    let report = outcome.report;
    assert!(!report.is_broken());
    assert_eq!(report.variants[0].self_test, []);
    assert_eq!(report.variants[1].self_test.len(), 3);
    assert_eq!(report.variants[2].verdict, Verdict::Holds);
    let json: serde_json::Value = serde_json::from_str(&report.to_json().unwrap()).unwrap();
    assert_eq!(json["variants"][1]["self_test"][0]["result"], "held");
    assert_eq!(
        json["variants"][1]["self_test"][0]["fallback"],
        "depth-prepass:form=biased"
    );
    let failed = &json["variants"][2]["self_test"][0];
    assert_eq!(
        (&failed["result"], &failed["fallback"]),
        (&"failed".into(), &"original".into())
    );
    let text = table::render(&report, false);
    assert!(
        text.contains("held: self-test held for 3 of 3 materials"),
        "{text}"
    );
    assert!(text.contains("a host falls back to `original`"), "{text}");
}

#[test]
fn a_host_reads_it_from_the_plan() {
    let scene = load("reversed-z");
    let plan = |recipe| {
        let mut variant = variant(&scene, recipe);
        serde_json::to_value(&*tests(&mut variant)[0]).unwrap()
    };
    let json = plan(EQUAL);
    let draw = |role: &str, compare: &str, write: bool, samples: &str| {
        serde_json::json!({
            "role": role,
            "attachment": "self-test-depth",
            "compare": compare,
            "write": write,
            "samples": samples,
        })
    };
    let test = &json["self_test"];
    assert_eq!(test["attachment"]["name"], "self-test-depth");
    assert_eq!(
        test["attachment"]["format"],
        json["attachments"][0]["format"]
    );
    assert_eq!(test["attachment"]["clear"], 0.0);
    assert_eq!(
        test["runs"][0]["draws"],
        serde_json::json!([
            draw("main", "greater", true, "some"),
            draw("prepass", "greater", false, "none"),
        ])
    );
    assert_eq!(
        test["runs"][1]["draws"],
        serde_json::json!([
            draw("prepass", "greater", true, "some"),
            draw("main", "greater", false, "none"),
        ])
    );
    let json = plan(BIASED);
    assert_eq!(
        json["self_test"]["runs"][0]["draws"],
        serde_json::json!([
            draw("main", "greater", true, "some"),
            draw("prepass", "greater-equal", false, "none"),
        ])
    );
}
