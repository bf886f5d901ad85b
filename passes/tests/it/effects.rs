//! What a draw calls for of a material, and what each effect is said to cost.

use preshade_passes::transforms::specialize::effects::{CalledFor, Effect, effects};
use preshade_plan::guard::{Assumed, Bounds, Place, ScalarType};
use preshade_plan::pass::{Constant, Facts};

use crate::common::specialized::original;

/// The effects of a fragment stage with this body where `u.n` and `u.fog_density` are 0.
fn found(functions: &str, body: &str) -> Vec<Effect> {
    let source = format!(
        "struct U {{ n: i32, fog_density: f32, c: vec4<f32> }}
@group(0) @binding(0) var<uniform> u: U;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> {{ return p; }}
{functions}
@fragment fn fs(@location(0) p: vec4<f32>) -> @location(0) vec4<f32> {{ {body} }}"
    );
    let constant = |name: &str, offset, ty| Constant {
        material: "test".to_owned(),
        value: Assumed {
            name: name.to_owned(),
            place: Place::Uniform {
                group: 0,
                binding: 0,
                offset,
            },
            ty,
            bounds: Bounds::one(0.0),
        },
    };
    let facts = Facts {
        constants: vec![
            constant("u.n", 0, ScalarType::I32),
            constant("u.fog_density", 4, ScalarType::F32),
        ],
        ..Facts::default()
    };
    effects(&original(&source), &facts).unwrap()
}

fn told(effects: &[Effect]) -> Vec<(&str, CalledFor)> {
    let each = effects.iter();
    each.map(|e| (e.name.as_str(), e.called_for)).collect()
}

#[test]
fn a_branch_of_a_loop_is_told_beside_what_ends_the_loop() {
    let body = "var c = vec4(0.0); var i = 0;
loop { if u.fog_density > 0.0 { c += sin(p.xyzx) * cos(p.zyxx); } i++; if f32(i) > p.x { break; } }
return c;";
    let effects = found("", body);
    assert_eq!(told(&effects), [("fog", CalledFor::No)]);
    assert!(effects[0].cost > 8.0, "{effects:?}");
}

#[test]
fn a_loop_to_a_count_is_told_as_one() {
    let body = "var c = p; for (var i = 0; i < u.n; i++) { c += sin(c); } return c;";
    let effects = found("", body);
    assert_eq!(told(&effects), [("n", CalledFor::No)]);
    assert!(effects[0].cost > 4.0, "{effects:?}");
}

#[test]
fn an_early_return_is_charged_with_what_follows_it() {
    let functions = "fn shadow(x: f32) -> f32 { if u.n == 0 { \
                     return 0.25; } return sin(x) * cos(x * 2.0) * sin(x * 3.0); }
fn relit(x: f32) -> f32 { if u.n == 0 { return 0.25; } return sin(x) * cos(x * 2.0); }";
    let effects = found(functions, "return vec4(shadow(p.x) + relit(p.y));");
    // Each by its function, which is what is left early.
    assert_eq!(
        told(&effects),
        [("shadows", CalledFor::No), ("relit", CalledFor::No)]
    );
    assert!(effects[1].cost >= 8.0, "{effects:?}");
    assert!(effects[0].cost > effects[1].cost, "{effects:?}");
    // Within a loop a turn's rest follows, and no more.
    let body = "var c = p; for (var i = 0; i < i32(p.x); i++) { if u.n == 0 { \
                continue; } c = sin(c); } return exp(exp(c));";
    let skipped = found("", body);
    assert_eq!(told(&skipped), [("n", CalledFor::No)]);
    assert!(skipped[0].cost > 4.0, "{skipped:?}");
}

#[test]
fn a_function_that_is_called_twice_costs_twice() {
    let functions =
        "fn shadow(x: f32) -> f32 { if u.n == 0 { return 0.25; } return sin(x) * cos(x * 2.0); }";
    let once = found(functions, "return vec4(shadow(p.x));");
    let twice = found(functions, "return vec4(shadow(p.x) + shadow(p.y));");
    assert_eq!(twice[0].cost, 2.0 * once[0].cost);
}
