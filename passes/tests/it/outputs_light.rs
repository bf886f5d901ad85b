//! Auxiliary pictures that a light draws: distances, and the light's own resources.

use preshade_plan::pass::Facts;
use preshade_plan::plan::{BindingSource, HostValue, Phase, Plan};

use crate::outputs::{SHADER, outputs, pass, text, with_facts};

pub fn of(shader: &str, recipe: &'static str) -> Result<Plan, String> {
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
    assert!(own.contains("return distance("), "{own}");
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
        use preshade_passes::transforms::outputs::Outputs;
        use preshade_plan::pass::Pass;
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

/// A vertex stage with these functions and this body, and one matrix of the camera and the model.
fn vertex(functions: &str, body: &str) -> String {
    format!(
        "struct Camera {{ view_proj: mat4x4<f32>, eye: vec3<f32>, right: vec3<f32> }}
        @group(0) @binding(0) var<uniform> camera: Camera;
        @group(0) @binding(1) var<uniform> model: mat4x4<f32>;
        @group(0) @binding(2) var map: texture_2d<f32>;
        struct Varyings {{ @builtin(position) clip: vec4<f32>, @location(0) at: vec2<f32> }}
        {functions}
        @vertex fn vs(@location(0) p: vec3<f32>, @location(1) sky: f32) -> Varyings {{
            {body}
        }}
        @fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {{
            if textureLoad(map, vec2<i32>(in.at), 0).a < 0.5 {{ discard; }}
            return vec4(1.0);
        }}"
    )
}

const PROJECT: &str = "fn project(w: vec4<f32>) -> vec4<f32> { \
                       let c = camera.view_proj * w; return c; }";

/// Another call of the same function, whose result coverage needs, is not measured.
#[test]
fn a_distance_is_measured_in_the_call_that_makes_the_position() {
    let body = "let c = project(model * vec4(p, 1.0));
        let tip = project(model * vec4(0.0, 5.0, 0.0, 1.0));
        return Varyings(c, tip.xy / tip.w);";
    let plan = of(&vertex(PROJECT, body), "outputs:write=distance").unwrap();
    let own = text(&plan);
    assert_eq!(own.matches("captured_w = ").count(), 1, "{own}");
    let name: String = own
        .match_indices("fn project")
        .find(|(at, _)| {
            own[*at..]
                .split("\n}")
                .next()
                .unwrap()
                .contains("captured_w = ")
        })
        .map(|(at, _)| own[at + 3..].chars().take_while(|c| *c != '(').collect())
        .unwrap();
    // The position's call stores it, and the tip's does not.
    let call = own.find(&format!("= {name}(")).unwrap();
    let line = own[call..].lines().next().unwrap();
    assert_eq!(own.matches(&format!("= {name}(")).count(), 1, "{own}");
    assert!(!line.contains("5"), "{own}");
}

#[test]
fn a_position_that_no_matrix_turned_on_some_ways_is_no_world() {
    for body in [
        "if sky > 0.5 { return Varyings(vec4(p, 1.0), p.xy); }
         return Varyings(project(model * vec4(p, 1.0)), p.xy);",
        "var c = vec4(p, 1.0); if sky < 0.5 { c = project(model * c); } return Varyings(c, p.xy);",
    ] {
        let refused = of(&vertex(PROJECT, body), "outputs:write=distance").unwrap_err();
        assert!(refused.starts_with("outputs[no-position]"), "{refused}");
        assert!(refused.contains("on some ways"), "{refused}");
    }
    // A part that is changed behind the product is no other way.
    let body = "var c = project(model * vec4(p, 1.0)); c.z = 0.5; c.x += sky * c.w;
        return Varyings(c, p.xy);";
    of(&vertex(PROJECT, body), "outputs:write=distance").unwrap();
}

#[test]
fn a_position_relative_to_the_camera_is_no_world() {
    let body = "let w = model * vec4(p, 1.0); let rel = vec4(w.xyz - camera.eye, 1.0);
        return Varyings(project(rel), p.xy);";
    let refused = of(&vertex(PROJECT, body), "outputs:write=distance").unwrap_err();
    assert!(refused.contains("relative to the camera"), "{refused}");
    // A billboard's axes leave it in the world.
    let body = "let w = vec4(p + camera.right * sky, 1.0); return Varyings(project(w), p.xy);";
    of(&vertex(PROJECT, body), "outputs:write=distance").unwrap();
}

#[test]
fn a_position_is_divided_by_its_fourth_component_unless_it_is_1() {
    let with = |world: &str| {
        let body = format!("return Varyings(project({world}), p.xy);");
        text(&of(&vertex(PROJECT, &body), "outputs:write=distance").unwrap())
    };
    let divided = with("vec4(p * 2.0, 2.0)");
    assert!(divided.contains(".xyz / "), "{divided}");
    let point = with("vec4(p, 1.0)");
    assert!(!point.contains(".xyz / "), "{point}");
}

#[test]
fn where_no_surface_is_a_distance_is_the_end_of_the_range() {
    use preshade_plan::plan::ClearValue;
    let clear = |recipe| {
        let plan = outputs(recipe).unwrap();
        let attachment = plan
            .attachments
            .iter()
            .find(|a| a.name == "outputs-distance")
            .unwrap();
        let ClearValue::Color([clear, ..]) = attachment.clear else {
            panic!("{attachment:?}");
        };
        (clear, plan.notes.join("\n"))
    };
    let (divided, notes) = clear("outputs:write=distance");
    assert_eq!(divided, 1.0);
    assert!(
        notes.contains("it holds 1, the end of the range"),
        "{notes}"
    );
    let (whole, notes) = clear("outputs:write=distance,light=light.direction");
    assert_eq!(whole, f64::from(f32::MAX));
    assert!(notes.contains("the largest number"), "{notes}");
}
