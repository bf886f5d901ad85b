//! What `agree` claims, it has checked.

use std::fmt::Write as _;

use preshade_validate::Effort;
use preshade_validate::agree::{Agreement, Class, Outcome, Relation, agree};

use crate::agree::{classes, held, plan};

/// A skinned material that fades, and what its velocity pass declares and returns.
fn skinned(declared: &str, previous: &str, end: &str) -> String {
    let mut text = format!(
        "struct Camera {{ view_proj: mat4x4<f32>, prev_view_proj: mat4x4<f32> }}
        @group(0) @binding(0) var<uniform> camera: Camera;
        @group(1) @binding(0) var<uniform> model: mat4x4<f32>;
        {declared}
        struct V {{ @builtin(position) at: vec4<f32>, @location(0) now: vec4<f32>, @location(1) before: vec4<f32> }}"
    );
    let _ = write!(
        text,
        "@vertex fn vs(@location(0) p: vec3<f32>, @location(1) q: vec4<f32>) -> V {{
            let now = camera.view_proj * model * vec4(p, 1.0);
            return V(now, now, {previous}); }}
        @fragment fn fs(in: V) -> @location(0) vec4<f32> {{
            if fract(in.at.x * 0.37 + in.at.y * 0.11) < 0.5 {{ discard; }}
            let velocity = in.now.xy / in.now.w - in.before.xy / in.before.w;
            return vec4({end}, 0.0, 1.0); }}"
    );
    text
}

fn outcome<'a>(agreement: &'a Agreement, promise: &str) -> &'a Outcome {
    let mut promises = agreement.promises.iter();
    &promises.find(|h| h.promise == promise).unwrap().outcome
}

#[test]
fn a_velocity_reads_each_previous_value() {
    let main = skinned("", "now", "vec2(1.0)");
    let model = "@group(1) @binding(1) var<uniform> prev_model: mat4x4<f32>;";
    let right = "camera.prev_view_proj * prev_model * vec4(p, 1.0)";
    let stiff = "camera.prev_view_proj * model * vec4(p, 1.0)";
    for (declared, previous, end, expected, note) in [
        (model, right, "velocity", None, None),
        (model, right, "velocity * vec2(0.5, -0.5) + 0.5", None, None),
        (
            model,
            stiff,
            "velocity",
            Some("does not read `prev_model`, so it takes `model` as unmoved"),
            None,
        ),
        (
            "",
            stiff,
            "velocity",
            None,
            Some("previous value of `model`"),
        ),
        (model, right, "vec2(0.0)", Some("does not read"), None),
        (model, right, "velocity.yx", Some("does not follow"), None),
        (
            model,
            right,
            "velocity / 0.0 * 0.0",
            Some("at a point in view"),
            None,
        ),
        (
            model,
            right,
            "sqrt(velocity - 99.0)",
            Some("at a point in view"),
            None,
        ),
    ] {
        let second = skinned(declared, previous, end);
        let agreement = held(Relation::Velocity, &main, &second, &[]).unwrap();
        let moves = agreement.findings.iter();
        let moves: Vec<&String> = moves
            .filter(|f| f.class == Class::Moves)
            .map(|f| &f.words)
            .collect();
        match expected {
            None => {
                assert!(moves.is_empty(), "{end}: {moves:?}");
                let outcome = outcome(&agreement, "velocity in motion");
                assert!(matches!(outcome, Outcome::Agreed { .. }), "{agreement:#?}");
            }
            Some(words) => assert!(moves.iter().any(|m| m.contains(words)), "{end}: {moves:?}"),
        }
        let notes = agreement.notes.join("; ");
        assert_eq!(notes.is_empty(), note.is_none(), "{notes}");
        assert!(notes.contains(note.unwrap_or_default()), "{notes}");
    }
}

#[test]
fn an_attribute_of_the_last_frame_has_a_partner() {
    let main = skinned("", "now", "vec2(1.0)");
    let model = "@group(1) @binding(1) var<uniform> prev_model: mat4x4<f32>;";
    for (name, maps) in [("prev_p", &[][..]), ("p_previous", &[]), ("r", &["r=p"])] {
        let with = |previous: &str| {
            let end = "velocity";
            let text = skinned(
                model,
                &format!("camera.prev_view_proj * prev_model * vec4({previous}, 1.0)"),
                end,
            );
            text.replace(
                "@location(1) q: vec4<f32>",
                &format!("@location(2) {name}: vec3<f32>"),
            )
        };
        let right = held(Relation::Velocity, &main, &with(name), maps).unwrap();
        assert_eq!(classes(&right), [], "{name}: {right:#?}");
        let wrong = held(
            Relation::Velocity,
            &main,
            &with(&format!("{name}.yxz")),
            maps,
        );
        assert_eq!(classes(&wrong.unwrap()), [Class::Moves], "{name}");
    }
}

const NORMALS: &str = "
    @group(0) @binding(0) var<uniform> view: mat4x4<f32>;
    struct V { @builtin(position) at: vec4<f32>, @location(0) n: vec3<f32> }
    struct G { @location(0) normal: vec4<f32> }
    @vertex fn vs(@location(0) p: vec3<f32>, @location(1) n: vec3<f32>) -> V {
        return V(view * vec4(p, 1.0), n); }
    @fragment fn fs(in: V) -> G { return G(vec4(normalize(in.n), 1.0)); }";

#[test]
fn a_normal_that_is_no_number_differs() {
    let none = "vec4(sqrt(-1.0 - in.n * in.n), 1.0)";
    let with = |end| NORMALS.replace("vec4(normalize(in.n), 1.0)", end);
    let agreement = held(Relation::Normal, NORMALS, &with(none), &[]).unwrap();
    assert_eq!(classes(&agreement), [Class::Color], "{agreement:#?}");
    let agreement = held(Relation::Normal, &with(none), NORMALS, &[]).unwrap();
    assert_eq!(agreement.not_evaluated(&[]).map(|_| ()), Some(()));
    assert!(agreement.is_nothing());
}

/// A material whose depth a pass may bias, and whose alpha it tests.
const LEAF: &str = "
    struct Light { view: mat4x4<f32>, bias: f32 }
    struct Material { cut: f32, opacity: f32 }
    @group(0) @binding(0) var<uniform> light: Light;
    @group(0) @binding(1) var<uniform> m: Material;
    @group(0) @binding(2) var t: texture_2d<f32>;
    @group(0) @binding(3) var s: sampler;
    struct V { @builtin(position) at: vec4<f32>, @location(0) uv: vec2<f32> }
    @vertex fn vs(@location(0) p: vec3<f32>, @location(1) uv: vec2<f32>) -> V {
        var c = light.view * vec4(p, 1.0);
        return V(c, uv); }
    @fragment fn fs(in: V) -> @location(0) vec4<f32> {
        let a = textureSample(t, s, in.uv).a * m.opacity;
        if a < m.cut { discard; }
        return vec4(a); }";

#[test]
fn a_bias_is_small_finite_and_goes_one_way() {
    for (edit, class) in [
        ("c.z += 0.01 * c.w;", Class::DepthBias),
        ("c.z += light.bias * c.w;", Class::DepthBias),
        ("c.z = clamp(c.z, 0.0, c.w);", Class::DepthBias),
        ("c.z = -c.z;", Class::Position),
        ("c.z = 0.0;", Class::Position),
        ("c.z = 2.0 * c.w;", Class::Position),
        ("c.z = p.z;", Class::Position),
        ("c.z = sqrt(-1.0 - p.x * p.x);", Class::Position),
        ("if p.x > 0.0 { c.z += 1000.0; }", Class::Position),
    ] {
        let second = LEAF.replace("return V(", &format!("{edit} return V("));
        let agreement = held(Relation::Shadow, LEAF, &second, &[]).unwrap();
        assert_eq!(classes(&agreement), [class], "{edit}: {agreement:#?}");
    }
}

#[test]
fn rare_discards_are_neither_extreme_nor_of_levels() {
    for (edit, class) in [
        ("a < m.cut || fract(in.uv.x * 64.0) > 0.95", Class::Loses),
        ("a < m.cut || fract(in.uv.x * 64.0) > 0.995", Class::Loses),
        ("a <= m.cut", Class::Loses),
    ] {
        let second = LEAF.replace("a < m.cut", edit);
        let agreement = held(Relation::Shadow, LEAF, &second, &[]).unwrap();
        assert_eq!(classes(&agreement), [class], "{edit}: {agreement:#?}");
    }
}

#[test]
fn one_host_fills_both_versions() {
    let swapped = LEAF.replace("cut: f32, opacity: f32", "opacity: f32, cut: f32");
    let moved = LEAF.replace("@location(1) uv", "@location(2) uv");
    let widened = LEAF.replace("cut: f32, opacity", "tint: vec4<f32>, cut: f32, opacity");
    let same = [Class::Unmatched];
    for (second, note, of_same) in [
        (
            &swapped,
            "`opacity` is at byte 0 there and at byte 4 here",
            &[][..],
        ),
        (&moved, "`uv` is at location 2 there and at 1 here", &same),
        (
            &widened,
            "`cut` is at byte 16 there and at byte 0 here",
            &same,
        ),
    ] {
        let agreement = held(Relation::Same, LEAF, second, &[]).unwrap();
        let found = classes(&agreement);
        assert!(!found.is_empty(), "{note}: {agreement:#?}");
        assert!(
            of_same.iter().all(|class| found.contains(class)),
            "{found:?}"
        );
        let agreement = held(Relation::Shadow, LEAF, second, &[]).unwrap();
        assert_eq!(classes(&agreement), [], "{note}: {agreement:#?}");
        assert!(agreement.notes.iter().any(|n| n == note), "{agreement:#?}");
    }
}

#[test]
fn coverage_follows_alpha() {
    let hair = LEAF.replace("if a < m.cut { discard; }", "");
    let mut first = plan("main.wgsl", &hair);
    for pass in &mut first.passes {
        pass.multisample.alpha_to_coverage = true;
        pass.multisample.count = 4;
    }
    let solid = hair.replace("-> @location(0) vec4<f32>", "");
    let solid = solid.replace("return vec4(a);", "");
    for (second, expected) in [(&solid, &[Class::KeepsHidden][..]), (&hair, &[])] {
        let second = plan("other.wgsl", second);
        let agreement = agree(&first, &second, Relation::Shadow.into(), &Effort::default());
        let agreement = agreement.unwrap();
        assert_eq!(classes(&agreement), expected, "{agreement:#?}");
    }
}
