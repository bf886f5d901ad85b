//! Inputs that decide: ties of comparisons, what stands behind an equality, and rounding.

use preshade_passes::validate::agree::{Class, Relation};

use crate::agree::{classes, held};

/// A material whose fragment stage computes `c` from `v.uv`, `u` and the texture.
fn material(body: &str) -> String {
    format!(
        "struct U {{ mvp: mat4x4<f32>, v: vec4<f32>, a: f32, b: f32, n: i32, k: i32 }}
        @group(0) @binding(0) var<uniform> u: U;
        @group(0) @binding(1) var tex: texture_2d<f32>;
        @group(0) @binding(2) var smp: sampler;
        struct V {{ @builtin(position) position: vec4<f32>, @location(0) uv: vec2<f32> }}
        @vertex fn vs(@location(0) p: vec3<f32>, @location(1) uv: vec2<f32>) -> V {{
            return V(u.mvp * vec4<f32>(p, 1.0), uv);
        }}
        @fragment fn fs(v: V) -> @location(0) vec4<f32> {{
            var c = 0.0;
            let t = textureSample(tex, smp, v.uv);
            {body}
            return vec4<f32>(c, v.uv.x, 0.0, 1.0);
        }}"
    )
}

fn found(first: &str, second: &str) -> Vec<Class> {
    let held = held(Relation::Same, &material(first), &material(second), &[]);
    classes(&held.unwrap())
}

/// Each pair differs at a tie alone, or behind one.
const APART: [[&str; 2]; 20] = [
    [
        "if (t.w < u.a) { discard; }",
        "if (t.w <= u.a) { discard; }",
    ],
    [
        "if (v.uv.x < u.a) { c = 1.0; }",
        "if (v.uv.x <= u.a) { c = 1.0; }",
    ],
    [
        "c = select(0.0, 1.0, u.a * 3.0 >= 1.11);",
        "c = select(0.0, 1.0, u.a * 3.0 > 1.11);",
    ],
    [
        "if (u.a * 10.0 - 3.7 == 0.0 && u.b * 3.0 == 1.11) { c = 0.3; }",
        "if (u.a * 10.0 - 3.7 == 0.0 && u.b * 3.0 == 1.11) { c = 0.4; }",
    ],
    [
        "if (u.v.w % 3.0 == -1.0) { c = 0.3; }",
        "if (u.v.w % 3.0 == -1.0) { c = 0.4; }",
    ],
    ["c = 0.3; if (u.v.w % 3.0 != -1.0) { c = 0.1; }", "c = 0.1;"],
    [
        "switch i32(v.uv.x * 5.0) { case 37: { if (v.uv.y > 0.9137) { c = 1.0; } } default: {} }",
        "switch i32(v.uv.x * 5.0) { case 37: { if (v.uv.y > 0.9139) { c = 1.0; } } default: {} }",
    ],
    [
        "switch i32(u.b * 5.0) { case -3: { c = 1.0; } default: {} }",
        "switch i32(u.b * 5.0) { case -3: { c = 2.0; } default: {} }",
    ],
    [
        "c = step(0.713, u.b * v.uv.x);",
        "c = select(0.0, 1.0, u.b * v.uv.x > 0.713);",
    ],
    [
        "c = sign(u.v.x - 2.25);",
        "c = select(-1.0, 1.0, u.v.x - 2.25 >= 0.0);",
    ],
    [
        "if (min(v.uv.x, 0.61) < 0.61) { c = 1.0; }",
        "if (v.uv.x <= 0.61) { c = 1.0; }",
    ],
    [
        "if (max(v.uv.x, 0.61) > 0.61) { c = 1.0; }",
        "if (v.uv.x >= 0.61) { c = 1.0; }",
    ],
    [
        "if (clamp(v.uv.x * 4.0 - 1.75, 0.0, 1.0) >= 1.0) { c = 1.0; }",
        "if (v.uv.x * 4.0 - 1.75 > 1.0) { c = 1.0; }",
    ],
    [
        "if (smoothstep(0.25, 0.6, v.uv.x) > 0.0) { c = 1.0; }",
        "if (v.uv.x >= 0.25) { c = 1.0; }",
    ],
    [
        "for (var i = 0; i < 4; i++) { if (v.uv.x * f32(i) == 1.5) { c += 1.0; } }",
        "for (var i = 0; i < 4; i++) { if (v.uv.x * f32(i) == 1.5) { c += 2.0; } }",
    ],
    [
        "let g = abs(fract(v.uv.x - 0.5) - 0.5) / fwidth(v.uv.x); c = 1.0 - min(g, 1.0);",
        "let g = abs(abs(v.uv.x - 0.5) - 0.5) / fwidth(v.uv.x); c = 1.0 - min(g, 1.0);",
    ],
    [
        "if (all(v.uv == u.v.xy)) { c = 1.0; }",
        "if (all(v.uv == u.v.xy)) { c = 2.0; }",
    ],
    [
        "if (sqrt(u.a) == 1.75) { c = 1.0; }",
        "if (sqrt(u.a) == 1.75) { c = 2.0; }",
    ],
    [
        "if (exp2(u.a) > 9.0) { c = 1.0; }",
        "if (exp2(u.a) > 9.00001) { c = 1.0; }",
    ],
    [
        "if (t.x * 2.0 - 1.0 == u.b) { c = 1.0; }",
        "if (t.x * 2.0 - 1.0 == u.b) { c = 2.0; }",
    ],
];

#[test]
fn ties_and_what_stands_behind_them_are_tried() {
    for [first, second] in APART {
        for (a, b) in [(first, second), (second, first)] {
            let classes = found(a, b);
            let is_found =
                |c: &Class| matches!(c, Class::Color | Class::KeepsHidden | Class::Loses);
            assert!(classes.iter().any(is_found), "{a}\n{b}\n{classes:?}");
        }
    }
}

/// Each pair says the same, and rounds otherwise.
const ROUNDED: [[&str; 2]; 6] = [
    [
        "if (t.w < u.a) { discard; }",
        "if (1.0 - t.w > 1.0 - u.a) { discard; }",
    ],
    [
        "if (t.w < u.a) { discard; }",
        "if (t.w * 3.0 < u.a * 3.0) { discard; }",
    ],
    [
        "if (t.w < u.a) { discard; }",
        "if (t.w + 0.1 < u.a + 0.1) { discard; }",
    ],
    [
        "if (t.w < u.a) { discard; }",
        "if (t.w - u.a < 0.0) { discard; }",
    ],
    [
        "if (v.uv.x < u.a) { c = 1.0; }",
        "if (v.uv.x * 0.1 < u.a * 0.1) { c = 1.0; }",
    ],
    [
        "c = v.uv.x * (u.a + u.b);",
        "c = v.uv.x * u.a + v.uv.x * u.b;",
    ],
];

#[test]
fn rounding_is_no_other_threshold() {
    for [first, second] in ROUNDED {
        for (a, b) in [(first, second), (second, first)] {
            let classes = found(a, b);
            let is_rounding = |c: &Class| matches!(c, Class::Rounding | Class::Extreme);
            assert!(classes.iter().all(is_rounding), "{a}\n{b}\n{classes:?}");
        }
    }
}

/// Levels that differ, and thresholds that do.
#[test]
fn a_level_is_to_blame_where_both_sample_one_place_at_two() {
    let sample = |how: &str, less: &str| format!("if ({how}.w {less} u.a) {{ discard; }}");
    let own = sample("textureSample(tex, smp, v.uv)", "<");
    let differ = |how: &str, less: &str| {
        let classes = found(&own, &sample(how, less));
        classes.contains(&Class::LevelOnly)
    };
    assert!(differ("textureSampleBias(tex, smp, v.uv, -1.0)", "<"));
    assert!(differ("textureSampleLevel(tex, smp, v.uv, 0.0)", "<"));
    assert!(!differ("textureSample(tex, smp, v.uv * 2.0)", "<"));
    assert!(!differ("textureSample(tex, smp, v.uv)", "<="));
    assert!(!differ("textureSample(tex, smp, v.uv)", "+ 0.01 <"));
    assert!(!differ("textureSample(tex, smp, v.uv)", "* u.b <"));
}

/// Differences of interfaces that only a GPU shows.
#[test]
fn flat_varyings_and_invariance_are_notes() {
    let material = |invariant: &str, flat: &str| {
        format!(
            "struct V {{ {invariant} @builtin(position) p: vec4<f32>, @location(0) @interpolate({flat}) k: u32 }}
            @vertex fn vs(@location(0) p: vec4<f32>, @location(1) k: u32) -> V {{ return V(p, k); }}
            @fragment fn fs(v: V) -> @location(0) vec4<f32> {{ return vec4<f32>(f32(v.k)); }}"
        )
    };
    let notes = |first: &str, second: &str| held(Relation::Same, first, second, &[]).unwrap().notes;
    let own = material("@invariant", "flat, first");
    assert_eq!(notes(&own, &own), [""; 0]);
    let dropped = notes(&own, &material("", "flat, first"));
    assert!(
        dropped[0].starts_with("the position of the first is invariant"),
        "{dropped:?}"
    );
    let either = notes(&own, &material("@invariant", "flat, either"));
    assert!(
        either[0].starts_with("`k` is of either vertex"),
        "{either:?}"
    );
}
