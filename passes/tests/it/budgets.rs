//! What a budget is based on: pictures of a scene and the values of their branches, or nothing.

use preshade_geometry::{PASSES, pass_named};
use preshade_passes::transforms::specialize::branches::{Way, branches};
use preshade_plan::contract::Assumption;
use preshade_plan::guard::{Assumed, Bounds, Place, ScalarType};
use preshade_plan::pass::{Facts, Undrawn};
use preshade_plan::plan::Plan;
use preshade_plan::state::MaterialState;

use crate::common;

const SHADER: &str = "
struct U { n: i32, octaves: i32, seed: f32 }
@group(0) @binding(0) var<uniform> u: U;
@group(0) @binding(1) var map: texture_2d<f32>;
@group(0) @binding(2) var smooth_sampler: sampler;
struct V { @builtin(position) position: vec4<f32>, @location(0) uv: vec2<f32> }
@vertex fn vs(@location(0) p: vec3<f32>) -> V { return V(vec4(p, 1.0), p.xy); }
@fragment fn fs(v: V) -> @location(0) vec4<f32> {
  var c = vec3<f32>(sin(v.uv.x) * 0.5 + 0.5);
  if u.n == 1 { c = vec3<f32>(sin(v.uv.x * 40.0 + cos(v.uv.y * 30.0))); }
  var weight = 0.5;
  for (var i = 0; i < 4; i++) { c += weight * sin(v.uv.xyx * f32(i + 1)); weight *= 0.5; }
  return vec4<f32>(c, 1.0);
}
";

fn original() -> Plan {
    let program = common::program(SHADER);
    Plan::original("test", program, "vs", Some("fs"), &MaterialState::default())
}

fn n_is(low: f64, high: f64) -> Assumed {
    Assumed {
        name: "u.n".to_owned(),
        place: Place::Uniform {
            group: 0,
            binding: 0,
            offset: 0,
        },
        ty: ScalarType::I32,
        bounds: Bounds { low, high },
    }
}

fn undrawn() -> Undrawn {
    Undrawn {
        material: "test".to_owned(),
        condition: "u.n == 1".to_owned(),
        location: None,
        values: vec![n_is(0.0, 0.0)],
    }
}

/// The plans of every pass with a budget that applies to the shader.
fn with_budgets(facts: &Facts) -> Vec<(&'static str, Plan)> {
    let mut found = Vec::new();
    for (recipe, params) in [
        (
            "hoist",
            "{\"budget\":0.1,\"finite\":\"assumed\",\"jumps\":\"carried\"}",
        ),
        ("trim-loop", "{\"budget\":0.1}"),
    ] {
        let params = serde_json::from_str(params).unwrap();
        let outcome = pass_named(recipe).unwrap().run(&original(), facts, &params);
        let plan = outcome
            .unwrap_or_else(|e| panic!("{recipe}: {}", e.first()))
            .plan;
        assert!(!plan.contract.budgets().is_empty(), "{recipe}");
        found.push((recipe, plan));
    }
    found
}

#[test]
fn a_budget_holds_for_the_branches_that_were_drawn() {
    let measured = Facts {
        undrawn: Some(vec![undrawn()]),
        ..Facts::without_ties()
    };
    for (recipe, plan) in with_budgets(&measured) {
        let given = plan.contract.given();
        for assumption in [Assumption::MeasuredScene, Assumption::ValuesOfTheGuard] {
            assert!(given.contains(&assumption), "{recipe}: {given:?}");
        }
        let guard = plan.guard.unwrap();
        assert_eq!(guard.values, [n_is(0.0, 0.0)], "{recipe}");
        let [drawn, other] = [0_i32, 1].map(|n| n.to_le_bytes());
        assert!(guard.holds(|_, _| Some(&drawn)), "{recipe}");
        assert!(!guard.holds(|_, _| Some(&other)), "{recipe}");
    }
}

#[test]
fn a_budget_that_nobody_drew_says_so() {
    // Read and not drawn; drawn, but made up; nothing.
    let read = Facts {
        undrawn: Some(Vec::new()),
        ..Facts::default()
    };
    for facts in [read, Facts::without_ties(), Facts::default()] {
        for (recipe, plan) in with_budgets(&facts) {
            let given = plan.contract.given();
            assert!(
                given.contains(&Assumption::NotMeasured),
                "{recipe}: {given:?}"
            );
            assert!(!given.contains(&Assumption::MeasuredScene), "{recipe}");
            assert_eq!(plan.guard, None, "{recipe}");
        }
    }
}

/// The scene was drawn with other values than those that an earlier step assumes.
#[test]
fn a_contradicted_guard_is_no_evidence() {
    let mut plan = original();
    plan.guard = Some(preshade_plan::guard::Guard {
        values: vec![n_is(1.0, 1.0)],
    });
    let facts = Facts {
        undrawn: Some(vec![undrawn()]),
        ..Facts::without_ties()
    };
    let params = serde_json::json!({ "budget": 0.1 });
    let trimmed = pass_named("trim-loop").unwrap().run(&plan, &facts, &params);
    let trimmed = trimmed.unwrap().plan;
    assert!(trimmed.contract.given().contains(&Assumption::NotMeasured));
    assert_eq!(trimmed.guard, plan.guard);
}

#[test]
fn branches_go_the_way_of_the_values() {
    let facts = |n: f64| Facts {
        constants: vec![preshade_plan::pass::Constant {
            material: "test".to_owned(),
            value: n_is(n, n),
        }],
        ..Facts::default()
    };
    for (n, way) in [(1.0, Way::Arm(0)), (0.0, Way::Arm(1))] {
        let found = branches(&original(), &facts(n)).unwrap();
        let of_n: Vec<_> = found.values().filter(|b| !b.values.is_empty()).collect();
        let [branch] = of_n[..] else {
            panic!("{found:?}")
        };
        assert_eq!(branch.ways, [way]);
        assert_eq!(branch.condition, "u.n == 1");
        assert_eq!(branch.location.as_ref().map(|l| l.line), Some(10));
    }
    let unknown = branches(&original(), &Facts::default()).unwrap();
    assert!(
        unknown.values().any(|b| b.ways == [Way::Open]),
        "{unknown:?}"
    );
}

/// Every recipe of every pass assumes something, or leaves the main pass alone; else it is refused
/// as a bug.
#[test]
fn no_promise_assumes_nothing() {
    let mut applied = 0;
    for pass in PASSES.iter() {
        for example in pass.examples() {
            if example.recipe.contains(',')
                && example.recipe.split(',').any(|p| pass_named(p).is_some())
            {
                continue;
            }
            let (_, params) = common::step(example.recipe);
            match pass.run(&original(), &Facts::without_ties(), &params) {
                Ok(_) => applied += 1,
                Err(refused) => assert!(
                    refused.refusals.iter().all(|r| r.code != "internal"),
                    "{}: {}",
                    example.recipe,
                    refused.clone().first()
                ),
            }
        }
    }
    assert!(applied >= 5, "{applied}");
}
