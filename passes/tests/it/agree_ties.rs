//! Inputs that decide: ties of comparisons, what stands behind an equality, and rounding.

use preshade_validate::agree::{Class, Relation};

use crate::agree::{classes, held};

/// A material whose fragment stage computes `c` from `v.uv`, `u` and the texture.
fn material(body: &str) -> String {
    format!(
        "struct U {{ mvp: mat4x4<f32>, v: vec4<f32>, a: f32, b: f32, n: i32, k: i32,
            w: vec4<i32>, m: u32 }}
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

/// Conditions that hold where several equations do, or one between integers that are computed.
const RARE: [&str; 19] = [
    "u.n == 1917 && u.k == -23",
    "(u.n == 1917) & (u.k == -23)",
    "u.n == 1917 && t.x == u.b && u.k == -23",
    "(u.m & 7u) == 5u && u.k == 77",
    "(u.m & 0xff00ff00u) == 0x12003400u && u.k == 77",
    "(u.m & 0xffu) == 0x80u && (u.m >> 24u) == 0x7fu",
    "(u.m >> 16u) == 7u",
    "extractBits(u.m, 9u, 7u) == 93u",
    "u.n * 3 + u.k == 777",
    "u.n / 7 == 391 && u.k % 97 == 45",
    "u.n - 5 > 1917 && u.n - 5 < 1920",
    "f32(u.n) * 0.5 == 1917.5",
    "i32(v.uv.x * 5.0) * 2 + 1 == 4095",
    "i32(v.uv.x * 5.0) + u.k == 4095 && u.n == 1917",
    "all(u.w == vec4<i32>(11, -27, 391, 4001))",
    "all(u.v == vec4<f32>(0.37, -2.3, 7.9, 1.1))",
    "all(u.mvp[0] == u.v.wzyx) && u.mvp[1].y == 0.37",
    "(u.mvp * u.v).x == 3.0",
    "sqrt(u.a) > 3.5 && u.b > 19.0 && u.v.z < -4.0",
];

/// Cases of selectors that are computed.
const CASES: [[&str; 2]; 3] = [
    ["u.n * 2 + 1", "4095"],
    ["i32(u.m >> 24u) - 7", "93"],
    ["u.n + u.k", "777"],
];

/// Each pair says the same in other words.
const ALIKE: [[&str; 2]; 7] = [
    [
        "if (u.n == 1917 && u.k == -23) { c = 1.0; }",
        "if (u.k == -23) { if (u.n == 1917) { c = 1.0; } }",
    ],
    [
        "if ((u.m & 0xff00u) == 0x1200u) { c = 1.0; }",
        "if (((u.m >> 8u) & 0xffu) == 0x12u) { c = 1.0; }",
    ],
    [
        "switch u.n * 2 + 1 { case 4095: { c = 1.0; } default: {} }",
        "if (u.n * 2 + 1 == 4095) { c = 1.0; }",
    ],
    [
        "if (u.n * 3 + u.k == 777) { c = 1.0; }",
        "if (u.k - 777 == -(u.n * 3)) { c = 1.0; }",
    ],
    [
        "if (all(u.w == vec4<i32>(11, -27, 391, 4001))) { c = 1.0; }",
        "if (u.w.w == 4001 && u.w.z == 391 && u.w.y == -27 && u.w.x == 11) { c = 1.0; }",
    ],
    [
        "if (all(u.mvp[1] == u.v)) { c = 1.0; }",
        "if (!any(u.v != u.mvp[1])) { c = 1.0; }",
    ],
    [
        "if (u.n > 1917) { c = 1.0; }",
        "if (u.n >= 1918) { c = 1.0; }",
    ],
];

#[test]
fn what_says_the_same_of_integers_agrees() {
    for [first, second] in ALIKE {
        for (a, b) in [(first, second), (second, first)] {
            assert_eq!(found(a, b), [], "{a}\n{b}");
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

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    #[test]
    fn what_stands_behind_several_equations_is_tried() {
        let behind = RARE.map(|condition| format!("if ({condition}) {{ c = 1.0; }}"));
        let cases = CASES.map(|[selector, case]| {
            format!("switch {selector} {{ case 3, {case}: {{ c = 1.0; }} default: {{}} }}")
        });
        for body in behind.iter().chain(&cases) {
            let without = body
                .replace("c = 1.0", "c = 0.0")
                .replace("case 3, ", "case 3: { c = 1.0; } case ");
            for (a, b) in [(body, &without), (&without, body)] {
                let classes = found(a, b);
                assert!(classes.contains(&Class::Color), "{a}\n{b}\n{classes:?}");
            }
        }
    }

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
}
