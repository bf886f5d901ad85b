//! Auxiliary pictures that a light draws: distances, what is left out of them, and the light's own
//! resources.

use preshade_passes::pass::Facts;
use preshade_passes::plan::{BindingSource, HostValue, Phase, Plan};

use crate::outputs::{SHADER, outputs, pass, text, with_facts};

fn of(shader: &str, recipe: &'static str) -> Result<Plan, String> {
    with_facts(shader, recipe, &Facts::default())
}

#[test]
fn a_distance_is_measured_in_front_of_the_view_s_matrix() {
    let plan = outputs("outputs:write=distance").unwrap();
    let text = text(&plan);
    assert!(text.contains("distance("), "{text}");
    let target = pass(&plan).targets[0].as_ref().unwrap();
    assert_eq!(target.format, "r32float");
    assert_eq!(pass(&plan).phase, Phase::Shadow);
    let bindings = &pass(&plan).bindings;
    let light = bindings.iter().find(|b| b.name == "point_light").unwrap();
    let value = HostValue::PointLight;
    assert_eq!(light.source, BindingSource::Host { value });
    assert!(
        text.contains("= point_light;") && text.contains(" / _e"),
        "{text}"
    );
    // Coverage is the author's, and the picture is the light's.
    assert!(text.contains("discard"), "{text}");
    let follows = &pass(&plan).view_dependent;
    assert!(
        follows.contains(&"camera.view_proj".to_owned()),
        "{follows:?}"
    );
    let note = "`outputs-distance` holds the distance of `world` from `point_light.xyz`";
    assert!(
        plan.notes.iter().any(|n| n.starts_with(note)),
        "{:?}",
        plan.notes
    );
}

/// Whatever the way a shader multiplies, the position in the world is the same.
#[test]
fn the_world_is_found_in_products_of_any_form() {
    let own = "return camera.view_proj * world;";
    let shader = SHADER.replace(
        "var clip = camera.view_proj * world;",
        "var clip = product(world);",
    );
    let one = "fn product(world: vec4<f32>) -> vec4<f32> { ";
    let with = |body: &str| {
        let added = format!("{one}{body} }}\n@vertex fn vs");
        shader.replace("@vertex fn vs", &added)
    };
    for body in [
        own,
        "return camera.view_proj * camera.view * world;",
        "return camera.view_proj * (camera.view * world);",
        "let both = camera.view_proj * camera.view; return both * world;",
        "let c = camera; return c.view_proj * world;",
    ] {
        let plan = of(&with(body), "outputs:write=distance").unwrap();
        let note = plan
            .notes
            .iter()
            .find(|n| n.starts_with("`outputs-distance`"));
        assert!(
            note.unwrap().contains(" of `world` from "),
            "{body}: {note:?}"
        );
        text(&plan);
    }
    // A matrix of the object's is a part of the way into the world.
    let left = SHADER.replace(
        "out.clip = clip_of(world);",
        "out.clip = camera.view_proj * model * vec4(position + offset, 1.0);",
    );
    let plan = of(&left, "outputs:write=distance").unwrap();
    let text = text(&plan);
    assert!(text.contains("model"), "{text}");
    let note = plan.notes.iter().find(|n| n.contains("model * "));
    assert!(note.is_some(), "{:?}", plan.notes);
}

#[test]
fn a_matrix_of_model_and_view_leaves_no_world() {
    let combined = SHADER
        .replace("view_proj: mat4x4<f32>", "mvp: mat4x4<f32>")
        .replace("camera.view_proj * world", "camera.mvp * world");
    let refused = of(&combined, "outputs:write=distance").unwrap_err();
    assert!(refused.starts_with("outputs[no-position]"), "{refused}");
    assert!(
        refused.contains("`camera.mvp` turns from the object's own space"),
        "{refused}"
    );
    assert!(refused.contains("`in.world` (vec3)"), "{refused}");
    let plan = of(&combined, "outputs:write=distance,position=in.world").unwrap();
    assert!(text(&plan).contains("distance("));
    let refused = of(&combined, "outputs:write=distance,position=in.uv").unwrap_err();
    assert!(refused.starts_with("outputs[not-a-position]"), "{refused}");
}

#[test]
fn a_light_and_a_range_are_taken_by_name() {
    let plan = outputs("outputs:write=distance,light=light.direction").unwrap();
    let own = text(&plan);
    assert!(
        own.contains("light.direction") && !own.contains("point_light"),
        "{own}"
    );
    assert!(!own.contains("/ "), "{own}");
    let plan = outputs("outputs:write=distance,light=light.direction,range=light.strength");
    let own = text(&plan.unwrap());
    assert!(
        own.contains(" / ") && own.contains("light.strength"),
        "{own}"
    );
    let refused = outputs("outputs:write=distance,light=light.strength").unwrap_err();
    assert!(refused.starts_with("outputs[not-a-position]"), "{refused}");
    let refused = outputs("outputs:write=distance,range=light.direction").unwrap_err();
    assert!(refused.contains("no number of type f32"), "{refused}");
    let refused = outputs("outputs:write=distance+velocity").unwrap_err();
    assert!(refused.starts_with("outputs[mixed-views]"), "{refused}");
}

#[test]
fn another_view_s_resources_take_the_place_of_the_author_s() {
    let refused = outputs("outputs:write=shadow,map=light.view_proj=camera.view_proj");
    let refused = refused.unwrap_err();
    assert!(
        refused.starts_with("outputs[other-view-lacks]"),
        "{refused}"
    );
    assert!(
        refused.contains("reads `camera.jitter`") && refused.contains("`light.view_proj`"),
        "{refused}"
    );
    let plan = outputs(
        "outputs:write=shadow,map=light.view_proj=camera.view_proj+light.none=camera.jitter",
    )
    .unwrap();
    let own = text(&plan);
    assert!(
        own.contains("light.view_proj") && !own.contains("camera"),
        "{own}"
    );
    let light = pass(&plan)
        .bindings
        .iter()
        .find(|b| b.name == "light")
        .unwrap();
    assert_eq!((light.group, light.binding), (0, 0));
    let name = "light".to_owned();
    assert_eq!(light.source, BindingSource::View { name });
    assert!(
        pass(&plan)
            .view_dependent
            .contains(&"light.view_proj".to_owned())
    );
    // The main pass is the author's.
    assert!(plan.program(plan.main().unwrap()).unwrap().is_as_written());
    // The struct is the same whatever the slice reads, and a name that is not there is told.
    let recipe = "outputs:write=shadow,map=light.view_proj=camera.view_proj+light.none=camera.jitter+light.at=camera.eye";
    let own = text(&outputs(recipe).unwrap());
    assert!(
        own.contains("none: vec2<f32>,\n    at: vec3<f32>,"),
        "{own}"
    );
    let refused = outputs("outputs:write=shadow,map=light.view_proj=camera.vp").unwrap_err();
    assert!(refused.starts_with("outputs[no-such-name]"), "{refused}");
    let refused = outputs("outputs:write=shadow,map=light.view_proj").unwrap_err();
    assert!(refused.contains("expected THEIRS=OURS"), "{refused}");
}

#[test]
fn a_mapping_numbers_the_other_view_s_variable() {
    let plan =
        outputs("outputs:write=shadow,map=2:5.view_proj=camera.view_proj+2:5.none=camera.jitter");
    let plan = plan.unwrap();
    let bindings = pass(&plan).bindings.iter();
    let view = bindings.filter(|b| matches!(b.source, BindingSource::View { .. }));
    let view: Vec<_> = view.map(|b| (b.group, b.binding)).collect();
    assert_eq!(view, [(2, 5)]);
    text(&plan);
}

#[test]
fn a_layout_declares_the_other_view_s_resources() {
    let layout =
        "struct Light { position: vec3<f32>, none: vec2<f32>, matrices: array<mat4x4<f32>, 4> }
        @group(3) @binding(1) var<uniform> light: Light;";
    let with = |map: &str| {
        let recipe = serde_json::json!({"write": "shadow", "map": map, "layout": layout});
        let params = serde_json::from_value(recipe).unwrap();
        use preshade_passes::outputs::Outputs;
        use preshade_passes::pass::Pass;
        match Outputs::run(
            &crate::outputs::original(SHADER),
            &Facts::default(),
            &params,
        ) {
            Ok(done) => Ok(done.plan),
            Err(refused) => Err(refused.first().to_string()),
        }
    };
    let plan = with("light.matrices[2]=camera.view_proj+light.none=camera.jitter").unwrap();
    let own = text(&plan);
    assert!(
        own.contains("light.matrices[2]") && own.contains("@group(3) @binding(1)"),
        "{own}"
    );
    // The offsets are those of the layout.
    assert!(own.contains("position: vec3<f32>"), "{own}");
    let refused = with("light.position=camera.view_proj+light.none=camera.jitter").unwrap_err();
    assert!(refused.contains("are not of one type"), "{refused}");
    let refused = with("light.eye=camera.view_proj+light.none=camera.jitter").unwrap_err();
    assert!(refused.starts_with("outputs[other-view]"), "{refused}");
    assert!(refused.contains("there is no `light.eye`"), "{refused}");
}

/// A leaf with parallax and a fade by distance. `KEPT` of it decides the shadow.
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
    assert!(refused.contains("at line "), "{refused}");
}
