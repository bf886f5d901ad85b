//! Parameters of `outputs`: slips, a cutoff for alpha, a group of one's own, and notes.

use preshade_passes::transforms::outputs::Outputs;
use preshade_plan::pass::{Facts, Pass};
use preshade_plan::plan::{BindingSource, Draws, Plan, Role};
use preshade_plan::state::{Blend, ColorTarget, MaterialState};
use preshade_validate::{Effort, Verdict, validate};

use crate::common;
use crate::outputs::{SHADER, original, outputs, params, pass, text};

#[test]
fn parameters_that_are_malformed_or_idle_are_slips() {
    for (recipe, said) in [
        ("outputs:write=+", "names nothing"),
        ("outputs:write=velocity+velocity", "`velocity` twice"),
        ("outputs:write=velocity,view=drop", "`view` has no effect"),
        (
            "outputs:write=depth,octahedral=true",
            "`octahedral` has no effect",
        ),
        (
            "outputs:write=normal,octahedral=true,unsigned=true",
            "`unsigned` has no effect without `write=normal` without",
        ),
        (
            "outputs:write=id,precision=full",
            "`precision` has no effect",
        ),
        (
            "outputs:write=id,colour-target=bound",
            "`colour-target` has no",
        ),
        ("outputs:write=depth,static=model", "`static` has no effect"),
        (
            "outputs:write=shadow,range=light.strength",
            "`range` has no effect",
        ),
        (
            "outputs:write=id,jitter=camera.jitter",
            "`jitter` has no effect",
        ),
        ("outputs:write=id,y=down", "`y` has no effect"),
        (
            "outputs:write=id,faces=right-handed",
            "`faces` has no effect without `write=normal`",
        ),
        (
            "outputs:write=normal,faces=right-handed,normal=n",
            "`faces` takes the triangle's normal, and `normal` another",
        ),
        (
            "outputs:write=velocity,static=light",
            "does not read `light`",
        ),
        ("outputs:write=id,cutoff=-1", "from 0 to 1, and not -1"),
        ("outputs:write=id,cutoff=1.5", "from 0 to 1, and not 1.5"),
        ("outputs:write=shadow,layout=view.wgsl", "without `map`"),
        (
            "outputs:write=shadow,map=light.view_proj",
            "expected THEIRS=OURS",
        ),
        (
            "outputs:write=shadow,map=light.view_proj=camera.viewproj",
            "in the material, there is no `camera.viewproj`",
        ),
    ] {
        let slip = Outputs::misnamed(&original(SHADER), &params(recipe));
        let slip = slip.unwrap_or_else(|| panic!("{recipe}"));
        assert!(slip.message.contains(said), "{recipe}: {}", slip.message);
    }
    let layout = "struct L { view_proj: mat4x4<f32>, eye: vec4<f32> }
        @group(0) @binding(0) var<uniform> light: L;";
    for (map, said) in [
        (
            "light.viewproj=camera.view_proj",
            Some("in the layout, there is no"),
        ),
        ("light.eye=camera.view_proj", Some("are not of one type")),
        ("light.view_proj=camera.view_proj", None),
    ] {
        let mut params = params("outputs:write=shadow");
        params.map = Some(map.to_owned());
        params.layout = Some(layout.to_owned());
        let slip = Outputs::misnamed(&original(SHADER), &params).map(|slip| slip.message);
        let is_it = match (said, &slip) {
            (Some(said), Some(message)) => message.contains(said),
            (None, None) => true,
            _ => false,
        };
        assert!(is_it, "{map}: {slip:?}");
    }
}

fn with_state(state: &MaterialState, recipe: &'static str) -> Result<Plan, String> {
    let plan = Plan::original("test", common::program(SHADER), "vs", Some("fs"), state);
    let made = Outputs::run(&plan, &Facts::default(), &params(recipe));
    made.map(|made| made.plan)
        .map_err(|why| why.first().to_string())
}

/// The triangle's normal needs a position that no branch computes: the vertex stage's, or an input.
#[test]
fn faces_take_a_position_of_the_vertex_stage_or_an_input() {
    for recipe in [
        "outputs:write=normal,faces=right-handed",
        "outputs:write=normal,faces=left-handed,position=in.world",
        // What both need is passed on once.
        "outputs:write=velocity+normal,faces=right-handed",
        "outputs:write=normal+distance,faces=right-handed",
    ] {
        let text = text(&outputs(recipe).unwrap());
        let body = text.split("@fragment").nth(1).unwrap();
        let first = body.find("face_normal(").unwrap();
        // The alpha test comes behind it.
        assert!(first < body.find("discard").unwrap(), "{body}");
    }
    for (recipe, said) in [
        (
            "outputs:write=normal,faces=right-handed,position=surface.albedo",
            "is not interpolated",
        ),
        (
            "outputs:write=normal,faces=right-handed,position=in.clip",
            "is a place in the picture",
        ),
    ] {
        let refused = outputs(recipe).unwrap_err();
        assert!(refused.starts_with("outputs[not-a-position]"), "{refused}");
        assert!(refused.contains(said), "{refused}");
    }
}

/// A struct of several shaders has members that this one leaves at 0.
#[test]
fn an_input_that_the_vertex_stage_does_not_write_is_no_normal() {
    let recipe = "outputs:write=normal,normal=in.normal";
    let written = "out.normal = (model * vec4(normal, 0.0)).xyz;";
    for (by, is_taken) in [
        (written, true),
        ("out.normal = vec3(0.0, 0.0, 1.0);", true),
        ("", false),
    ] {
        let shader = SHADER.replace(written, by);
        let done = crate::outputs::with_facts(&shader, recipe, &Facts::default());
        match done {
            Ok(_) => assert!(is_taken, "{by}"),
            Err(refused) => {
                assert!(!is_taken, "{by}: {refused}");
                let said = "outputs[no-normal]: the vertex stage writes nothing to `in.normal`";
                assert!(refused.starts_with(said), "{refused}");
            }
        }
    }
}

#[test]
fn a_cutoff_takes_the_place_of_alpha_to_coverage_and_blending() {
    let mut covered = MaterialState::default();
    covered.multisample.count = 4;
    covered.multisample.alpha_to_coverage = true;
    let blended = MaterialState {
        depth_write: false,
        targets: vec![Some(ColorTarget {
            blend: Some(Blend::ALPHA),
            ..ColorTarget::opaque("rgba8unorm")
        })],
        ..MaterialState::default()
    };
    for (state, what) in [(&covered, "alpha to coverage"), (&blended, "blending")] {
        for write in ["outputs:write=id", "outputs:write=shadow"] {
            let refused = with_state(state, write).unwrap_err();
            assert!(refused.starts_with("outputs[alpha-decides]"), "{refused}");
            assert!(refused.contains(what), "{refused}");
        }
        let plan = with_state(state, "outputs:write=velocity+id,cutoff=0.25").unwrap();
        let text = text(&plan);
        assert!(text.contains(">= 0.25f)"), "{text}");
        let pass = pass(&plan);
        assert!(pass.left_out[0].starts_with(what), "{:?}", pass.left_out);
        assert_eq!(pass.draws, Draws::All);
        assert!(pass.depth.as_ref().unwrap().write);
        assert!(!pass.multisample.alpha_to_coverage);
        assert!(pass.targets.iter().flatten().all(|t| !t.is_blended()));
        // The main pass is the author's.
        let main = plan.main().unwrap();
        assert!(plan.program(main).unwrap().is_as_written());
    }
    // It is not applied to others.
    let [with, without] = ["outputs:write=id,cutoff=0.5", "outputs:write=id"]
        .map(|recipe| text(&outputs(recipe).unwrap()));
    assert_eq!(with, without);
}

/// The alpha that blends is that of the blended target.
#[test]
fn a_cutoff_tests_the_alpha_of_the_blended_target() {
    let shader = SHADER
        .replace("@fragment fn fs(", "struct Targets { @location(0) ids: vec4<f32>, @location(1) colour: vec4<f32> }\n@fragment fn fs(")
        .replace("-> @location(0) vec4<f32> {", "-> Targets {")
        .replace(
            "return vec4(surface.albedo * lit(n, v, light.direction) * light.strength, 1.0);",
            "return Targets(vec4(surface.albedo, 0.75), vec4(surface.albedo, surface.roughness));",
        );
    let state = MaterialState {
        targets: vec![
            Some(ColorTarget::opaque("rgba8unorm")),
            Some(ColorTarget {
                blend: Some(Blend::ALPHA),
                ..ColorTarget::opaque("rgba8unorm")
            }),
        ],
        ..MaterialState::default()
    };
    let plan = Plan::original("test", common::program(&shader), "vs", Some("fs"), &state);
    let made = Outputs::run(
        &plan,
        &Facts::default(),
        &params("outputs:write=id,cutoff=0.25"),
    );
    let Ok(made) = made else { panic!("refused") };
    let text = text(&made.plan);
    assert!(
        text.contains(">= 0.25f)") && !text.contains("0.75f"),
        "{text}"
    );
    assert!(!text.contains("Targets("), "{text}");
}

#[test]
fn new_bindings_are_in_the_group_that_is_given() {
    let plan = outputs("outputs:write=velocity+id,group=3").unwrap();
    let groups = |is_ours: bool| -> Vec<u32> {
        let all = pass(&plan).bindings.iter();
        let of = all.filter(|b| (b.source != BindingSource::Author) == is_ours);
        of.map(|b| b.group).collect()
    };
    assert_eq!(groups(true), [3, 3, 3]);
    assert!(groups(false).iter().all(|group| *group < 3));
}

#[test]
fn attributes_that_look_like_transforms_are_named_until_they_move() {
    let shader = |own: &str, value: &str| {
        format!(
            "@group(0) @binding(0) var<uniform> vp: mat4x4<f32>;
            @vertex fn vs(@location(0) p: vec3<f32>, {own}) -> @builtin(position) vec4<f32> {{
                return vp * {value};
            }}
            @fragment fn fs() -> @location(0) vec4<f32> {{ return vec4(1.0); }}"
        )
    };
    let columns =
        "@location(1) m0: vec4<f32>, @location(2) m1: vec4<f32>, @location(3) m2: vec4<f32>";
    let matrix = shader(
        columns,
        "vec4(dot(m0, vec4(p, 1.0)), dot(m1.xyz, p), dot(m2.xyz, p), 1.0)",
    );
    let offset = shader(
        "@location(1) instanceOffset: vec3<f32>",
        "vec4(p + instanceOffset, 1.0)",
    );
    let plain = shader("@location(1) uv0: vec2<f32>", "vec4(p + uv0.xyx, 1.0)");
    for (shader, recipe, named) in [
        (&matrix, "outputs:write=velocity", Some("moving=m0+m1+m2`")),
        (&matrix, "outputs:write=velocity,moving=m0+m1+m2", None),
        (&matrix, "outputs:write=id", None),
        (
            &offset,
            "outputs:write=velocity",
            Some("moving=instanceOffset`"),
        ),
        (&plain, "outputs:write=velocity", None),
    ] {
        let made = Outputs::run(&original(shader), &Facts::default(), &params(recipe));
        let Ok(made) = made else { panic!("{recipe}") };
        let mut notes = made.plan.notes.iter();
        let note = notes.find(|note| note.contains("as unchanged"));
        match named {
            Some(named) => assert!(note.unwrap().contains(named), "{note:?}"),
            None => assert_eq!(note, None, "{recipe}"),
        }
    }
}

/// With the current buffers in place of the previous ones, positions and discards are the author's.
#[test]
fn velocities_and_ids_are_checked_at_rest() {
    let effort = Effort {
        inputs: 36,
        ..Effort::default()
    };
    for recipe in [
        "outputs:write=velocity+id",
        "outputs:write=velocity,jitter=camera.jitter",
        "outputs:write=distance",
    ] {
        let plan = outputs(recipe).unwrap();
        let checks = validate(&original(SHADER), &plan, &effort);
        let own: Vec<_> = checks.iter().filter(|c| c.role == Role::Outputs).collect();
        assert_eq!(own.len(), 2, "{recipe}: {own:?}");
        for check in own {
            let is_held = matches!(
                check.verdict,
                Verdict::Proved { .. } | Verdict::Agreed { .. }
            );
            assert!(is_held, "{recipe}: {check:?}");
        }
    }
}

/// An output of one float fits no target of four.
#[test]
fn assumed_targets_have_no_more_components_than_outputs() {
    for (ty, format) in [
        ("f32", "r8unorm"),
        ("vec2<f32>", "rg8unorm"),
        ("vec4<f32>", "rgba8unorm"),
        ("u32", "r32uint"),
        ("vec2<i32>", "rg32sint"),
    ] {
        let shader = format!(
            "@vertex fn vs() -> @builtin(position) vec4<f32> {{ return vec4(0.0); }}
            @fragment fn fs() -> @location(0) {ty} {{ return {ty}(); }}"
        );
        let plan = original(&shader);
        let target = plan.main().unwrap().targets[0].as_ref().unwrap();
        assert_eq!(target.format, format, "{ty}");
    }
}
