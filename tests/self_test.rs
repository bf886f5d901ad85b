//! The self-tests of plans, run as a host runs them: they hold as emitted, and fail where a driver (here: a changed plan) breaks what the plan rests on.
#![cfg(feature = "verify")]
#![allow(clippy::unwrap_used, clippy::panic)]

mod render_support;

use std::path::Path;

use preshade::measure::{self, Settings, Timed, TimingSettings, Variant, verify};
use preshade::passes::contract::Verdict;
use preshade::passes::pass::Facts;
use preshade::passes::plan::{Plan, Role, SamplesPassed, SelfTest};
use preshade::passes::program::Program;
use preshade::passes::state::{CompareFunction, DepthBias};
use preshade::recipe::Recipe;
use preshade::render::{SceneInputs, SelfTestResult, ShaderForm, self_test};
use preshade::report::table;
use preshade::scene::{self, Scene};
use render_support::*;

const BIASED: &str = "depth-prepass";
const EQUAL: &str = "depth-prepass:form=equal";

fn load(name: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fixtures/scenes/{name}.toml"));
    let mut scene = scene::load(&path).unwrap().resized([96, 54]);
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

fn has_failed(results: &[SelfTestResult]) -> bool {
    results
        .iter()
        .any(|r| matches!(r, SelfTestResult::Failed { .. }))
}

fn tests(variant: &mut Variant) -> Vec<&mut Plan> {
    let plans = variant.plans.iter_mut();
    plans.filter(|p| p.self_test.is_some()).collect()
}

/// Gives the pre-pass of every plan with a self-test a program of its own, made by `change` from the WGSL of the one it has.
fn change_prepass(variant: &mut Variant, change: impl Fn(&str) -> String) {
    for plan in tests(variant) {
        let pass = plan.passes.iter().find(|p| p.role == Role::Prepass);
        let program = plan.program(pass.unwrap()).unwrap();
        let info =
            naga::valid::Validator::new(Default::default(), naga::valid::Capabilities::all())
                .validate(program.module())
                .unwrap();
        let flags = naga::back::wgsl::WriterFlags::empty();
        let text = naga::back::wgsl::write_string(program.module(), &info, flags).unwrap();
        let changed = change(&text);
        assert_ne!(text, changed);
        let module = naga::front::wgsl::parse_str(&changed).unwrap();
        let changed: Program = program.with_module(module).unwrap();
        plan.programs.insert("moved".to_owned(), changed);
        for pass in plan.passes.iter_mut().filter(|p| p.role == Role::Prepass) {
            pass.program = "moved".to_owned();
        }
    }
}

fn set_bias(variant: &mut Variant, change: impl Fn(DepthBias) -> DepthBias) {
    for plan in tests(variant) {
        for pass in plan.passes.iter_mut().filter(|p| p.role == Role::Prepass) {
            let depth = pass.depth.as_mut().unwrap();
            depth.bias = change(depth.bias);
        }
    }
}

#[test]
fn they_hold_as_emitted() {
    for name in [
        "simple",
        "instanced",
        "skinned",
        "msaa",
        "reversed-z",
        "patchwork",
        "alpha-coverage",
        "frag-depth",
        "stencil-mask",
        "gbuffer",
        "viewport",
        "d16",
    ] {
        let scene = load(name);
        for recipe in [
            BIASED,
            EQUAL,
            "depth-prepass:form=equal,vertex=sliced",
            "early-discard:attachment=readonly",
        ] {
            let mut variant = variant(&scene, recipe);
            let with_test = tests(&mut variant).len();
            let results = run(&scene, &variant);
            assert_eq!(results.len(), with_test);
            println!("{name} {recipe}: {results:?}");
            for result in &results {
                assert!(
                    !matches!(result, SelfTestResult::Failed { .. }),
                    "{name} {recipe}: {result:?}"
                );
            }
        }
    }
}
