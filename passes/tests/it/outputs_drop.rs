//! What `view=drop` leaves out of a light's picture, and which uniforms follow the viewer.

use preshade_plan::plan::Plan;

use crate::outputs::{pass, text};
use crate::outputs_light::of;

/// A leaf with parallax and a fade by distance. `CUT` decides its coverage.
const RELIEF: &str = "
struct Camera { view_proj: mat4x4<f32>, eye: vec3<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var heights: texture_2d<f32>;
@group(0) @binding(2) var map: texture_2d<f32>;
@group(0) @binding(3) var s: sampler;
@group(0) @binding(4) var<uniform> fade_from: f32;
struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv: vec2<f32>,
    @location(1) world: vec3<f32>,
    @location(2) far: f32,
}
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> Varyings {
    let clip = camera.view_proj * vec4(position, 1.0);
    return Varyings(clip, uv, position, distance(camera.eye, position));
}
fn march(start: vec2<f32>, v: vec3<f32>) -> vec2<f32> {
    var uv = start;
    for (var i = 0; i < 8; i++) {
        let h = textureSampleLevel(heights, s, uv, 0.0).r;
        if h < f32(i) / 8.0 { break; }
        uv -= v.xy * 0.01;
    }
    return uv;
}
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {
    let v = normalize(camera.eye - in.world);
    let dx = dpdx(in.uv);
    let dy = dpdy(in.uv);
    let uv = march(in.uv, v);
    let texel = textureSampleGrad(map, s, uv, dx, dy);
    let fade = saturate(fade_from - in.far);
    CUT
    return texel;
}";

fn relief(cut: &str) -> String {
    RELIEF.replace("CUT", cut)
}

fn dropped(cut: &str) -> Result<Plan, String> {
    of(&relief(cut), "outputs:write=shadow,view=drop")
}

#[test]
fn parallax_is_left_out_of_a_shadow() {
    let plan = dropped("if texel.a < 0.5 { discard; }").unwrap();
    let own = text(&plan);
    assert!(own.contains("let uv_1 = in.uv;"), "{own}");
    assert!(
        !own.contains("march") && !own.contains("camera.eye"),
        "{own}"
    );
    let left_out = &pass(&plan).left_out;
    // The march's own coordinates, and those that it returns.
    let told = "(line 31): `in.uv` is in its place";
    assert!(left_out.iter().any(|l| l.contains(told)), "{left_out:?}");
    // As written, it follows the light.
    let kept = of(
        &relief("if texel.a < 0.5 { discard; }"),
        "outputs:write=shadow",
    )
    .unwrap();
    assert!(text(&kept).contains("march"));
    assert!(pass(&kept).left_out.is_empty());
}

#[test]
fn a_fade_is_left_out_of_a_shadow_and_the_alpha_test_stays() {
    for cut in [
        "if texel.a * (1.0 - in.far / fade_from) < 0.5 { discard; }",
        "if in.far > fade_from || texel.a < 0.5 { discard; }",
        "if texel.a < 0.5 || in.far > fade_from { discard; }",
        "if in.far > fade_from { discard; } if texel.a < 0.5 { discard; }",
        "if !(texel.a >= 0.5 && in.far < fade_from) { discard; }",
        "if texel.a < 0.5 || 1.0 / in.clip.w < fade_from { discard; }",
        "var a = texel.a; a *= saturate(fade_from - in.far); if a < 0.5 { discard; }",
    ] {
        let plan = dropped(cut).unwrap_or_else(|why| panic!("{cut}: {why}"));
        let own = text(&plan);
        assert!(own.contains("discard"), "{cut}: {own}");
        assert!(
            own.contains("0.5") && !own.contains("fade_from"),
            "{cut}: {own}"
        );
        assert!(
            pass(&plan).left_out.len() > 1,
            "{cut}: {:?}",
            pass(&plan).left_out
        );
    }
}

#[test]
fn a_shadow_without_the_viewer_may_have_no_fragment_stage() {
    let plan = dropped("if in.far > fade_from { discard; }").unwrap();
    assert!(!text(&plan).contains("discard"));
    assert!(pass(&plan).left_out[0].contains("it counts as false"));
}

/// A `discard` that nothing reaches would switch early depth tests off.
#[test]
fn conditions_that_became_constant_are_folded() {
    let far = "in.far > fade_from";
    for (cut, is_tested) in [
        (
            format!("if {far} || in.far > 7.0 * fade_from || {far} {{ discard; }}"),
            false,
        ),
        (format!("if ({far}) | ({far}) {{ discard; }}"), false),
        (
            format!("var gone = false; if {far} {{ gone = true; }} if gone {{ discard; }}"),
            false,
        ),
        (
            format!("if {far} || texel.a < 0.5 || {far} {{ discard; }}"),
            true,
        ),
    ] {
        let plan = dropped(&cut).unwrap_or_else(|why| panic!("{cut}: {why}"));
        let own = text(&plan);
        assert_eq!(own.contains("discard"), is_tested, "{own}");
        assert_eq!(pass(&plan).fragment.is_some(), is_tested, "{own}");
        assert!(!own.contains("false |"), "{own}");
    }
}

#[test]
fn what_does_not_depend_on_the_viewer_stays() {
    // A dither's place in the picture is not the viewer's.
    let cut = "if in.uv.x < fract(in.clip.x * 0.37 + in.clip.y * 0.71) { discard; }";
    let [kept, dropped] = [
        of(&relief(cut), "outputs:write=shadow").unwrap(),
        dropped(cut).unwrap(),
    ];
    assert_eq!(text(&kept), text(&dropped));
    assert!(pass(&dropped).left_out.is_empty());
}

#[test]
fn a_discard_that_the_viewer_alone_leads_to_is_refused() {
    let cut = "if in.far < fade_from { return texel; } if in.uv.x < 0.5 { discard; }";
    let refused = dropped(cut).unwrap_err();
    assert!(refused.starts_with("outputs[viewer-decides]"), "{refused}");
    assert!(refused.contains("(line "), "{refused}");
}

/// What a cut becomes. `texel` does not depend on the viewer by then.
fn kept(cut: &str) -> String {
    text(&dropped(cut).unwrap_or_else(|why| panic!("{cut}: {why}")))
}

#[test]
fn the_operations_around_the_viewer_s_stay() {
    for (cut, stays) in [
        (
            "if texel.a * fade * 2.0 < 0.5 { discard; }",
            "((_e a * 2f) < 0.5f)",
        ),
        (
            "if texel.a * fade - 0.5 < 0.0 { discard; }",
            "((_e a - 0.5f) < 0f)",
        ),
        (
            "if 1.0 - texel.a * fade > 0.5 { discard; }",
            "((1f - _e a) > 0.5f)",
        ),
        ("if min(texel.a, fade) < 0.5 { discard; }", "(_e a < 0.5f)"),
        (
            "if mix(0.0, texel.a, fade) < 0.5 { discard; }",
            "(_e a < 0.5f)",
        ),
        (
            "if texel.a - 0.2 * fade < 0.5 { discard; }",
            "(_e a < 0.5f)",
        ),
        ("if (texel * fade).a < 0.5 { discard; }", ".w < 0.5f)"),
    ] {
        let own = kept(cut);
        let condition = own.lines().find(|l| l.contains("if ")).unwrap();
        let shape: String = stays.replace("_e a", "");
        let words: Vec<&str> = shape.split_whitespace().collect();
        for word in words {
            assert!(
                condition.contains(word.trim_matches(['(', ')'])),
                "{cut}: {own}"
            );
        }
        assert!(!own.contains("saturate"), "{cut}: {own}");
    }
}

#[test]
fn the_tiling_of_a_coordinate_stays() {
    let tiled = |uv: &str| {
        let shader = relief("if texel.a < 0.5 { discard; }").replace(
            "textureSampleGrad(map, s, uv, dx, dy)",
            &format!("textureSampleLevel(map, s, {uv}, 0.0)"),
        );
        let plan = of(&shader, "outputs:write=shadow,view=drop").unwrap();
        let own = text(&plan);
        assert!(!own.contains("eye -"), "{uv}: {own}");
        own
    };
    assert!(tiled("uv * 2.0 + 0.5").contains("* 2f) + vec2(0.5f)"));
    assert!(tiled("(in.uv + v.xy * 0.02) * 4.0").contains("* 4f)"));
    assert!(tiled("in.uv * 3.0 + v.xy * 0.02").contains("* 3f)"));
    // What the viewer weights is no coordinate of the author's.
    assert!(!tiled("in.uv + v.xy * in.uv.yx").contains("yx"));
    // A march that ends between two of its steps.
    let own = tiled("mix(uv, uv + v.xy * 0.1, 0.5 * v.z)");
    assert!(!own.contains("mix") && own.contains("in.uv"), "{own}");
}

/// An alpha test never counts as false: its threshold becomes what it is without the viewer.
#[test]
fn a_threshold_loses_the_viewer() {
    for cut in [
        "if texel.a < 0.5 * fade { discard; }",
        "if fract(in.uv.x) < 0.5 * fade { discard; }",
        "if fract(in.uv.x) * fade < 0.5 { discard; }",
        "var cut = 0.5; if in.far > 20.0 { cut = 0.2; } if texel.a < cut { discard; }",
        "if in.far < 20.0 { if texel.a < 0.5 { discard; } }",
        "if in.far < 20.0 && texel.a < 0.5 { discard; }",
        "if !(in.far >= 20.0 || texel.a >= 0.5) { discard; }",
    ] {
        let own = kept(cut);
        assert!(
            own.contains("discard") && own.contains("0.5f"),
            "{cut}: {own}"
        );
        assert!(
            !own.contains("saturate") && !own.contains("20f"),
            "{cut}: {own}"
        );
    }
}

#[test]
fn what_nobody_can_say_is_refused_with_its_line() {
    for cut in [
        "if texel.a / in.far < 0.05 { discard; }",
        "if texel.a + 1.0 - fade < 0.5 { discard; }",
        "if texel.a + fade - 1.0 < 0.5 { discard; }",
        "if texel.a + fade < 1.5 { discard; }",
        "if texel.a < in.far * 0.1 { discard; }",
        "if texel.a < mix(0.5, 0.3, fade) { discard; }",
        "if texel.a < select(0.5, 0.2, in.far > 10.0) { discard; }",
        "if pow(texel.a, 1.0 + fade) < 0.5 { discard; }",
        "if select(texel.a, texel.r, in.far > 10.0) < 0.5 { discard; }",
        "if in.far < 20.0 { if texel.a < 0.5 { discard; } } else { if texel.a < 0.2 { discard; } }",
        "if fade < texel.r { discard; }",
        // An alpha that the shader computes, or a pattern on the surface.
        "if fract(in.uv.x) < in.far * 0.1 { discard; }",
        "if in.far < 20.0 { if fract(in.uv.x) < 0.5 { discard; } }",
        "if in.far < 20.0 { if fract(in.uv.x) * fade < 0.5 { discard; } }",
        "if in.far < 20.0 && fract(in.uv.x) < 0.5 { discard; }",
    ] {
        let refused = match dropped(cut) {
            Err(refused) => refused,
            Ok(plan) => panic!("{cut}: {}", text(&plan)),
        };
        assert!(
            refused.starts_with("outputs[viewer-decides]"),
            "{cut}: {refused}"
        );
        assert!(refused.contains("(line "), "{cut}: {refused}");
    }
}

/// Whatever form a test takes around the viewer's condition, inside it, or before it.
#[test]
fn a_test_of_a_texture_never_disappears() {
    let near = "in.far < 20.0";
    for cut in [
        "if texel.a < 0.5 { if NEAR { discard; } }",
        "if texel.a >= 0.5 { } else { if NEAR { discard; } }",
        "let cut = texel.a < 0.5; if cut { if NEAR { discard; } }",
        "if texel.a < 0.5 { maybe(in.far); }",
        "if NEAR { if texel.a < 0.5 { if in.far > 1.0 { discard; } } }",
        "for (var k = 0; k < 2; k++) { if texel.a < 0.5 { if NEAR { discard; } } }",
    ] {
        let shader = relief(&cut.replace("NEAR", near)).replace(
            "@fragment",
            "fn maybe(d: f32) { if d < 20.0 { discard; } }\n@fragment",
        );
        let plan = of(&shader, "outputs:write=shadow,view=drop");
        let own = text(&plan.unwrap_or_else(|why| panic!("{cut}: {why}")));
        assert!(own.contains("discard") && own.contains("0.5f"), "{own}");
        assert!(!own.contains("20f"), "{cut}: {own}");
    }
    for cut in [
        "if in.uv.x < 0.5 { if NEAR { discard; } }",
        "if texel.a >= 0.5 { return texel; } if NEAR { discard; }",
        "var hide = texel.a < 0.5; hide = hide && NEAR; if hide { discard; }",
        "var keep = texel.a >= 0.5; keep = keep || in.far > 20.0; if !keep { discard; }",
        "var hide = false; for (var k = 0; k < 3; k++) { if texel.a < 0.5 { hide = NEAR; } } if hide { discard; }",
        "var hide = false; for (var k = 0; k < 3; k++) { if hide { discard; } hide = texel.a < 0.5 && NEAR; }",
        "var hide = in.uv.x < 0.5; hide = hide && NEAR; if hide { discard; }",
        "if hidden(texel.a, in.far) { discard; }",
        "let near = NEAR; if near { discard; } if near { if texel.a < 0.5 { discard; } }",
    ] {
        let shader = relief(&cut.replace("NEAR", near)).replace(
            "@fragment",
            "fn hidden(a: f32, d: f32) -> bool { var h = a < 0.5; h = h && d < 20.0; return h; }
            @fragment",
        );
        match of(&shader, "outputs:write=shadow,view=drop") {
            Err(refused) => assert!(refused.starts_with("outputs[viewer-decides]"), "{refused}"),
            Ok(plan) => panic!("{cut}: {}", text(&plan)),
        }
    }
}

/// Where the viewer is near, the material is thin. It would be thin everywhere.
#[test]
fn a_test_that_the_viewer_limits_stays_if_it_is_the_only_one() {
    let other = "if texel.a < 0.5 { discard; }";
    for limited in [
        "if in.far < 1.0 && texel.r < 0.5 { discard; }",
        "if in.far < 1.0 { if texel.r < 0.5 { discard; } }",
        "if texel.r < 0.5 { if in.far < 1.0 { discard; } }",
        "if dot(camera.eye - in.world, vec3(0.0, 1.0, 0.0)) < 0.0 && texel.r < 0.7 { discard; }",
    ] {
        dropped(limited).unwrap_or_else(|why| panic!("{limited}: {why}"));
        for cut in [format!("{limited} {other}"), format!("{other} {limited}")] {
            let refused = match dropped(&cut) {
                Err(refused) => refused,
                Ok(plan) => panic!("{cut}: {}", text(&plan)),
            };
            assert!(refused.starts_with("outputs[viewer-decides]"), "{refused}");
        }
        // One that disappears is no other.
        let beside = format!("if in.far > 90.0 {{ discard; }} {limited}");
        dropped(&beside).unwrap_or_else(|why| panic!("{beside}: {why}"));
    }
    let both = "if texel.a < 0.2 || (in.far < 1.0 && texel.a < 0.5) { discard; }";
    assert!(dropped(both).is_err());
}

/// A decal reads its textures at places that the picture gives.
#[test]
fn a_texture_at_the_pixel_s_place_is_no_dither() {
    for cut in [
        "if fade < textureLoad(map, vec2<i32>(in.clip.xy), 0).r { discard; }",
        "let at = camera.view_proj * vec4(in.clip.xy, textureLoad(heights, vec2<i32>(in.clip.xy), 0).r, 1.0);
         if any(abs(at.xyz) > vec3(0.5)) { discard; }",
        "let at = camera.view_proj * vec4(in.clip.xy, 0.0, 1.0);
         if textureSampleLevel(map, s, at.xy, 0.0).a < 0.1 { discard; }",
    ] {
        let refused = match dropped(cut) {
            Err(refused) => refused,
            Ok(plan) => panic!("{cut}: {}", text(&plan)),
        };
        assert!(refused.starts_with("outputs[viewer-decides]"), "{refused}");
    }
}

#[test]
fn each_call_is_judged_apart() {
    let shader = relief("cut(texel.a * fade, 0.5); cut(texel.a, 0.1);").replace(
        "@fragment",
        "fn cut(a: f32, limit: f32) { if a < limit { discard; } }\n@fragment",
    );
    let plan = of(&shader, "outputs:write=shadow,view=drop").unwrap();
    let own = text(&plan);
    assert_eq!(own.matches("discard").count(), 1, "{own}");
    assert_eq!(own.matches("cut_outputs(").count(), 3, "{own}");
    assert!(own.contains("0.5f") && own.contains("0.1f"), "{own}");
    // One call fades its own threshold, and the other has none of the viewer's.
    let shader = relief("cut(texel.a, fade); cut(texel.a, 1.0);").replace(
        "@fragment",
        "fn cut(a: f32, fade: f32) { if a < 0.5 * fade { discard; } }\n@fragment",
    );
    let own = text(&of(&shader, "outputs:write=shadow,view=drop").unwrap());
    assert_eq!(own.matches("discard").count(), 2, "{own}");
    assert_eq!(own.matches("0.5f *").count(), 1, "{own}");
}

#[test]
fn a_dither_by_the_pixel_s_place_is_dropped() {
    for cut in [
        "if fade < fract(in.clip.x * 0.37) { discard; }",
        "if in.far > 10.0 { if fract(in.clip.x * 0.37) < 0.5 { discard; } }",
    ] {
        let own = kept(cut);
        assert!(!own.contains("discard"), "{cut}: {own}");
    }
}

#[test]
fn names_are_read_as_words() {
    let cut = "if texel.a < fade_from { discard; }";
    for name in [
        "alpha_clip",
        "clip_threshold",
        "eye_open",
        "review",
        "projector_alpha",
    ] {
        let shader = relief(cut).replace("fade_from", name);
        let plan = of(&shader, "outputs:write=shadow,view=drop").unwrap();
        assert!(text(&plan).contains("discard"), "{name}");
        let follows = &pass(&plan).view_dependent;
        assert_eq!(follows, &["camera.view_proj".to_owned()], "{name}");
    }
    let cut = "if texel.a * fade < 0.5 { discard; }";
    for name in [
        "camPos",
        "cam_position",
        "camOrigin",
        "observer",
        "lookFrom",
        "viewPos",
        "u_eye",
    ] {
        let shader = relief(cut)
            .replace("camera.", "frame.")
            .replace("camera:", "frame:")
            .replace("Camera", "Frame")
            .replace("eye", name);
        let plan = of(&shader, "outputs:write=shadow,view=drop").unwrap();
        assert!(!text(&plan).contains("saturate"), "{name}: {}", text(&plan));
        let kept = of(&shader, "outputs:write=shadow").unwrap();
        assert!(
            pass(&kept)
                .view_dependent
                .contains(&format!("frame.{name}")),
            "{:?}",
            pass(&kept).view_dependent
        );
    }
}

/// The matrix that makes the clip position follows the light, whatever it is called.
#[test]
fn the_matrix_of_the_clip_position_follows_the_viewer() {
    for name in ["m", "PV", "u_matrix", "lightVP", "cam_mat"] {
        let shader = relief("if texel.a * fade < 0.5 { discard; }")
            .replace("Camera", "Frame")
            .replace("camera", "g")
            .replace("view_proj", name);
        let plan = of(&shader, "outputs:write=shadow").unwrap();
        let follows = &pass(&plan).view_dependent;
        assert_eq!(follows, &[format!("g.{name}"), "g.eye".to_owned()]);
        // What the slice does not read is not listed.
        let plan = of(&shader, "outputs:write=shadow,view=drop").unwrap();
        let follows = &pass(&plan).view_dependent;
        assert_eq!(follows, &[format!("g.{name}")]);
    }
}

#[test]
fn the_user_names_the_viewer_where_names_do_not() {
    let shader = relief("if texel.a * fade < 0.5 { discard; }")
        .replace("Camera", "Frame")
        .replace("camera", "g")
        .replace("eye", "e");
    let plan = of(&shader, "outputs:write=shadow,view=drop").unwrap();
    let note = "`view=drop` left nothing out";
    assert!(
        plan.notes.iter().any(|n| n.starts_with(note)),
        "{:?}",
        plan.notes
    );
    let plan = of(&shader, "outputs:write=shadow,view=drop,viewer=g.e").unwrap();
    assert!(!pass(&plan).left_out.is_empty());
    assert!(!text(&plan).contains("saturate"));
    let plan = of(&shader, "outputs:write=shadow,viewer=e").unwrap();
    assert!(pass(&plan).view_dependent.contains(&"g.e".to_owned()));
    // A name that misleads.
    let shader = shader.replace("g.e", "g.eye").replace(" e:", " eye:");
    let plan = of(&shader, "outputs:write=shadow,viewer=-g.eye").unwrap();
    assert_eq!(pass(&plan).view_dependent, ["g.view_proj"]);
    let refused = of(&shader, "outputs:write=shadow,viewer=g.who").unwrap_err();
    assert!(refused.starts_with("outputs[no-such-name]"), "{refused}");
}
