//! Auxiliary pictures: which values they take, what the previous frame is computed from, and what is
//! refused.

use std::collections::BTreeSet;

use preshade_passes::transforms::outputs::{Outputs, OutputsParams};
use preshade_plan::pass::{Facts, Pass};
use preshade_plan::plan::{BindingKind, BindingSource, GpuPass, HostValue, Plan, Role};
use preshade_plan::state::MaterialState;

use crate::common;

pub const SHADER: &str = "
struct Camera { view_proj: mat4x4<f32>, view: mat4x4<f32>, eye: vec3<f32>, jitter: vec2<f32> }
struct Light { direction: vec3<f32>, strength: f32 }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<uniform> light: Light;
@group(1) @binding(0) var<uniform> model: mat4x4<f32>;
@group(1) @binding(1) var map: texture_2d<f32>;
@group(1) @binding(2) var map_sampler: sampler;
struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) normal: vec3<f32>,
    @location(1) uv: vec2<f32>,
    @location(2) world: vec3<f32>,
}
struct Surface { albedo: vec3<f32>, roughness: f32 }
fn clip_of(world: vec4<f32>) -> vec4<f32> {
    var clip = camera.view_proj * world;
    clip.x += camera.jitter.x * clip.w;
    clip.y += camera.jitter.y * clip.w;
    return clip;
}
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>,
    @location(2) uv: vec2<f32>, @location(3) offset: vec3<f32>) -> Varyings {
    var out: Varyings;
    let world = model * vec4(position + offset, 1.0);
    out.clip = clip_of(world);
    out.normal = (model * vec4(normal, 0.0)).xyz;
    out.uv = uv;
    out.world = world.xyz;
    return out;
}
fn surface_of(uv: vec2<f32>) -> Surface {
    var s: Surface;
    let texel = textureSample(map, map_sampler, uv);
    s.albedo = texel.rgb;
    s.roughness = texel.a;
    return s;
}
fn lit(n: vec3<f32>, v: vec3<f32>, l: vec3<f32>) -> f32 {
    let h = normalize(v + l);
    return max(dot(n, l), 0.0) + pow(max(dot(n, h), 0.0), 8.0);
}
@fragment fn fs(in: Varyings, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    let surface = surface_of(in.uv);
    if surface.roughness < 0.1 { discard; }
    var n = normalize(in.normal);
    if !front { n = -n; }
    let v = normalize(camera.eye - in.world);
    return vec4(surface.albedo * lit(n, v, light.direction) * light.strength, 1.0);
}";

pub fn original(shader: &str) -> Plan {
    let state = MaterialState::default();
    Plan::original("test", common::program(shader), "vs", Some("fs"), &state)
}

pub fn params(recipe: &'static str) -> OutputsParams {
    serde_json::from_value(common::step(recipe).1).unwrap()
}

pub fn with_facts(shader: &str, recipe: &'static str, facts: &Facts) -> Result<Plan, String> {
    match Outputs::run(&original(shader), facts, &params(recipe)) {
        Ok(done) => Ok(done.plan),
        Err(refused) => Err(refused.first().to_string()),
    }
}

pub fn outputs(recipe: &'static str) -> Result<Plan, String> {
    with_facts(SHADER, recipe, &Facts::default())
}

pub fn pass(plan: &Plan) -> &GpuPass {
    plan.passes
        .iter()
        .find(|p| p.role == Role::Outputs)
        .unwrap()
}

pub fn text(plan: &Plan) -> String {
    common::wgsl(plan.program(pass(plan)).unwrap())
}

/// Names of the buffers of the previous frame.
fn previous(plan: &Plan) -> Vec<&str> {
    let sources = pass(plan).bindings.iter().map(|b| &b.source);
    let names = sources.filter_map(|source| match source {
        BindingSource::Previous { of, .. } => Some(of.as_str()),
        _ => None,
    });
    names.collect()
}

#[test]
fn depth_alone_is_what_decides_position_and_coverage() {
    let plan = outputs("outputs:write=depth").unwrap();
    let text = text(&plan);
    assert!(
        text.contains("discard") && !text.contains("light"),
        "{text}"
    );
    assert!(pass(&plan).targets.is_empty());
    let depth = pass(&plan).depth.as_ref().unwrap();
    assert_eq!(depth.attachment, "outputs-depth");
    // The main pass is the author's.
    let main = plan.main().unwrap();
    assert!(plan.program(main).unwrap().is_as_written());
}

#[test]
fn shadow_writes_the_same_program_as_the_pass_of_that_name() {
    use preshade_passes::transforms::shadow::{self, Shadow};
    let by_outputs = outputs("outputs:write=shadow").unwrap();
    let plan = original(SHADER);
    let by_shadow = Shadow::run(&plan, &Facts::default(), &shadow::ShadowParams::default());
    let Ok(by_shadow) = by_shadow else {
        panic!("shadow is refused")
    };
    let shadow = by_shadow
        .plan
        .passes
        .iter()
        .find(|p| p.role == Role::Shadow);
    let shadow = shadow.unwrap();
    let own = common::wgsl(by_shadow.plan.program(shadow).unwrap());
    assert_eq!(text(&by_outputs), own.replace("_shadow", "_outputs"));
    assert_eq!(pass(&by_outputs).view_dependent, shadow.view_dependent);
    assert_eq!(pass(&by_outputs).phase, shadow.phase);
}

#[test]
fn the_normal_is_the_vector_that_meets_the_light() {
    let plan = outputs("outputs:write=normal").unwrap();
    let text = text(&plan);
    // Two-sided: the value after the author turned it.
    assert!(text.contains("n = -("), "{text}");
    assert!(!text.contains("light") && !text.contains("eye -"), "{text}");
    let target = pass(&plan).targets[0].as_ref().unwrap();
    assert_eq!(target.format, "rgba16float");
    assert_eq!(target.attachment.as_deref(), Some("outputs-normal"));
    // Nothing but the normal and what decides coverage is passed on.
    assert!(!text.contains("out.world"), "{text}");
}

#[test]
fn a_material_without_light_lists_its_candidates() {
    let dark = SHADER.replace("lit(n, v, light.direction) * light.strength", "n");
    let refused = with_facts(&dark, "outputs:write=normal", &Facts::default()).unwrap_err();
    assert!(refused.starts_with("outputs[no-normal]"), "{refused}");
    for candidate in [
        "`in.normal` (vec3)",
        "`n@fs` (vec3, line ",
        "`v@fs` (vec3, line ",
    ] {
        assert!(refused.contains(candidate), "{candidate}: {refused}");
    }
    let plan = with_facts(&dark, "outputs:write=normal,normal=n", &Facts::default()).unwrap();
    assert!(text(&plan).contains("n = -("));
}

#[test]
fn two_normals_are_refused_by_both_names() {
    let two = SHADER.replace("let v = normalize", "let smooth_n = normalize(in.normal + vec3(0.0, 0.1, 0.0)); let k = dot(smooth_n, light.direction); let v = k * normalize");
    let refused = with_facts(&two, "outputs:write=normal", &Facts::default()).unwrap_err();
    assert!(refused.contains("several unit vectors"), "{refused}");
    assert!(refused.contains("@fs` (vec3, line "), "{refused}");
}

/// A tangent of hair has the role of a normal, so a note tells which value was taken. A light may be
/// a constant.
#[test]
fn a_note_tells_the_normal_and_a_light_may_be_constant() {
    for light in ["vec3(0.0, 1.0, 0.0)", "normalize(vec3(1.0, 2.0, 3.0))"] {
        let shader = SHADER.replace("light.direction)", &format!("{light})"));
        let plan = with_facts(&shader, "outputs:write=normal", &Facts::default()).unwrap();
        let told = plan
            .notes
            .iter()
            .find(|note| note.starts_with("`outputs-normal` holds"));
        assert!(told.unwrap().contains("(vec3, line "), "{told:?}");
    }
    let plan = outputs("outputs:write=normal,normal=v@fs").unwrap();
    assert!(
        !plan
            .notes
            .iter()
            .any(|note| note.contains("outputs-normal"))
    );
}

#[test]
fn a_normal_is_turned_by_a_matrix_and_encoded() {
    let plan = outputs("outputs:write=normal,matrix=camera.view,octahedral=true").unwrap();
    let text = text(&plan);
    assert!(
        text.contains("octahedral(") && text.contains("camera.view"),
        "{text}"
    );
    let target = pass(&plan).targets[0].as_ref().unwrap();
    assert_eq!(target.format, "rg16float");
    let refused = outputs("outputs:write=normal,matrix=camera.eye").unwrap_err();
    assert!(
        refused.contains("`camera.view`") && refused.contains("`model`"),
        "{refused}"
    );
}

#[test]
fn a_value_is_found_by_name_member_and_function() {
    for (recipe, format) in [
        ("outputs:write=surface.albedo", "rgba16float"),
        ("outputs:write=albedo@fs", "rgba16float"),
        ("outputs:write=h,precision=full", "rgba32float"),
        ("outputs:write=s.roughness", "r16float"),
        ("outputs:write=uv@surface_of", "rg16float"),
        ("outputs:write=in.uv", "rg16float"),
        ("outputs:write=n@lit", "rgba16float"),
    ] {
        let plan = outputs(recipe);
        let plan = plan.unwrap_or_else(|why| panic!("{recipe}: {why}"));
        let target = pass(&plan).targets[0].as_ref().unwrap();
        assert_eq!(target.format, format, "{recipe}");
        text(&plan);
    }
    let refused = outputs("outputs:write=n").unwrap_err();
    assert!(refused.starts_with("outputs[ambiguous-name]"), "{refused}");
    assert!(
        refused.contains("`n@lit`") && refused.contains("`n@fs`"),
        "{refused}"
    );
    let refused = outputs("outputs:write=sheen").unwrap_err();
    assert!(refused.starts_with("outputs[no-such-name]"), "{refused}");
    let slip =
        Outputs::misnamed(&original(SHADER), &params("outputs:write=suface.albedo")).unwrap();
    assert!(
        slip.known.contains(&"surface.albedo".to_owned()),
        "{slip:?}"
    );
}

#[test]
fn velocity_keeps_copies_of_what_the_position_reads() {
    let plan = outputs("outputs:write=velocity").unwrap();
    assert_eq!(previous(&plan), ["camera", "model"]);
    let text = text(&plan);
    assert!(text.contains("= camera_previous.view_proj;"), "{text}");
    assert!(text.contains("fn clip_of_previous("), "{text}");
    assert!(!text.contains("previous_previous"), "{text}");
    // Each copy has a number of its own.
    let numbers = pass(&plan).bindings.iter().map(|b| (b.group, b.binding));
    let numbers: BTreeSet<_> = numbers.collect();
    assert_eq!(numbers.len(), pass(&plan).bindings.len());
    let plan = outputs("outputs:write=velocity,static=model").unwrap();
    assert_eq!(previous(&plan), ["camera"]);
    let refused = outputs("outputs:write=velocity,static=camera.view").unwrap_err();
    assert!(refused.contains("name the variable `camera`"), "{refused}");
}

/// A scene's frames move no object, so they do not say what is static.
#[test]
fn facts_of_a_scene_leave_no_copy_out() {
    let facts = Facts {
        changing: Some(Vec::new()),
        ..Facts::default()
    };
    let plan = with_facts(SHADER, "outputs:write=velocity", &facts).unwrap();
    assert_eq!(previous(&plan), ["camera", "model"]);
}

/// The text of a function. What a slice cuts has a suffix.
fn body<'t>(text: &'t str, function: &str) -> &'t str {
    let whole = text.find(&format!("fn {function}("));
    let cut = || text.find(&format!("fn {function}_outputs("));
    let start = whole.or_else(cut).unwrap();
    let end = text[start..].find("\n}").unwrap();
    &text[start..start + end]
}

#[test]
fn jitter_counts_as_zero_in_both_frames() {
    let plan = outputs("outputs:write=velocity,jitter=camera.jitter").unwrap();
    let text = text(&plan);
    // The position that is drawn has it.
    assert!(body(&text, "clip_of").contains("camera.jitter.x"), "{text}");
    for (function, own) in [
        ("position_unjittered", "camera_unjittered"),
        ("position_previous", "camera_previous_unjittered"),
    ] {
        let body = body(&text, function);
        let zero = format!("{own}.jitter = vec2<f32>();");
        assert!(body.contains(&zero), "{text}");
        assert!(text.contains(&format!("= {function}")), "{text}");
    }
    let read = text.matches("camera.jitter").count();
    assert_eq!(read, 2, "{text}");
    assert!(!text.contains("camera_previous.jitter"), "{text}");
}

const JITTERED: &str = "
struct Camera { view_proj: mat4x4<f32>, jitter: array<vec4<f32>, 4>, frame: u32 }
struct Frame { camera: Camera, lights: array<vec4<f32>, 4> }
@group(0) @binding(0) var<uniform> frame: Frame;
fn shift(c: Camera) -> vec2<f32> { return c.jitter[c.frame].xy; }
@vertex fn vs(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> {
    var clip = frame.camera.view_proj * vec4(position, 1.0);
    clip += vec4(SHIFT * clip.w, 0.0, 0.0);
    return clip;
}
@fragment fn fs() -> @location(0) vec4<f32> { return frame.lights[1]; }";

/// Whatever way the shader takes to its jitter: only the position that is drawn takes it from the
/// buffer.
#[test]
fn jitter_is_left_out_of_copies_arguments_pointers_and_arrays() {
    for shift in [
        "frame.camera.jitter[frame.camera.frame].xy",
        "shift(frame.camera)",
        "through(frame)",
        "behind()",
    ] {
        let shader = JITTERED.replace("SHIFT", shift)
            + "fn through(f: Frame) -> vec2<f32> { var local = f; return local.camera.jitter[1].xy; }
            fn behind() -> vec2<f32> {
                let jitter = &frame.camera.jitter;
                return (*jitter)[frame.camera.frame].xy;
            }";
        let recipe = "outputs:write=velocity,jitter=frame.camera.jitter";
        let plan = with_facts(&shader, recipe, &Facts::default()).unwrap();
        let text = text(&plan);
        for function in ["position_unjittered", "position_previous"] {
            let body = body(&text, function);
            let (first, rest) = body
                .split_once(".camera.jitter = array<vec4<f32>, 4>();")
                .unwrap();
            let copied = ["_unjittered = ", "_unjittered.camera = "];
            assert!(copied.iter().any(|word| first.contains(word)), "{text}");
            assert!(
                !rest.contains(" frame.") && !rest.contains(" frame_previous."),
                "{text}"
            );
        }
    }
    let recipe = "outputs:write=velocity,jitter=frame.lights";
    let refused = with_facts(
        &JITTERED.replace("SHIFT", "vec2(0.0)"),
        recipe,
        &Facts::default(),
    );
    let refused = refused.unwrap_err();
    assert!(refused.starts_with("outputs[unread-jitter]"), "{refused}");
    assert!(refused.contains("`frame.lights`"), "{refused}");
}

/// Engines that keep a matrix without jitter beside the one with it: the other is read in both frames.
#[test]
fn a_part_without_jitter_takes_the_place_of_one_with_it() {
    let steady = "outputs:write=velocity,jitter=camera.view=camera.view_proj";
    let text = text(&outputs(steady).unwrap());
    let drawn = body(&text, "clip_of");
    assert!(drawn.contains("camera.view_proj"), "{text}");
    for (function, own) in [
        ("clip_of_unjittered", "camera.view;"),
        ("clip_of_previous", "camera_previous.view;"),
    ] {
        let function = body(&text, function);
        assert!(function.contains(own), "{text}");
        assert!(!function.contains("view_proj"), "{text}");
    }
    for (recipe, said) in [
        (
            "outputs:write=velocity,jitter=camera.eye=camera.view_proj",
            "outputs[unread-jitter]: the two of `camera.eye=camera.view_proj` are not of one type",
        ),
        (
            "outputs:write=velocity,jitter=camera.view_proj=camera.view",
            "outputs[unread-jitter]: the position does not read `camera.view`",
        ),
        (
            "outputs:write=shadow,jitter=camera.view=camera.view_proj",
            "outputs[unread-jitter]: a light's matrix is its own",
        ),
    ] {
        let refused = outputs(recipe).unwrap_err();
        assert!(refused.starts_with(said), "{refused}");
    }
}

/// A target without negative numbers holds a normal from 0 to 1.
#[test]
fn a_normal_from_0_to_1() {
    let text = text(&outputs("outputs:write=normal,unsigned=true").unwrap());
    assert!(text.contains("* 0.5f) + vec3(0.5f)), 1f)"), "{text}");
}

/// Without a matrix there is no position, so a whole one is no jitter.
#[test]
fn a_matrix_is_no_jitter_and_numbers_of_it_are() {
    for (jitter, path) in [
        (
            "outputs:write=velocity,jitter=camera.view_proj",
            "`camera.view_proj`",
        ),
        ("outputs:write=velocity,jitter=camera", "`camera.view_proj`"),
        ("outputs:write=velocity,jitter=model", "`model`"),
    ] {
        let refused = outputs(jitter).unwrap_err();
        assert!(refused.starts_with("outputs[jitter-matrix]"), "{refused}");
        assert!(refused.contains(path), "{refused}");
    }
    for (jitter, elements) in [
        (
            "outputs:write=velocity,jitter=camera.view_proj[2].xy",
            &["[2][0]", "[2][1]"][..],
        ),
        (
            "outputs:write=velocity,jitter=camera.view_proj[2][0]",
            &["[2][0]"],
        ),
        (
            "outputs:write=velocity,jitter=camera.view_proj[3]",
            &["[3][0]", "[3][3]"],
        ),
    ] {
        let text = text(&outputs(jitter).unwrap());
        for element in elements {
            let (column, row) = element.split_at(3);
            let letter = ["x", "y", "z", "w"][row[1..2].parse::<usize>().unwrap()];
            for own in ["camera_unjittered", "camera_previous_unjittered"] {
                let forms = [
                    format!("{own}.view_proj{element} = 0f;"),
                    format!("{own}.view_proj{column}.{letter} = 0f;"),
                ];
                assert!(
                    forms.iter().any(|form| text.contains(form)),
                    "{jitter}: {text}"
                );
            }
        }
    }
    for beyond in [
        "outputs:write=velocity,jitter=camera.view_proj[4].xy",
        "outputs:write=velocity,jitter=camera.view_proj[2].q",
        "outputs:write=velocity,jitter=camera.view_proj[2][4]",
    ] {
        let refused = outputs(beyond).unwrap_err();
        assert!(refused.starts_with("outputs[no-such-name]"), "{refused}");
    }
}

/// A light has no jitter.
#[test]
fn jitter_is_left_out_of_a_light_s_picture() {
    for recipe in [
        "outputs:write=shadow,jitter=camera.jitter",
        "outputs:write=distance,jitter=camera.jitter",
        "outputs:write=shadow,jitter=camera.jitter,map=lamp.view_proj=camera.view_proj",
    ] {
        let text = text(&outputs(recipe).unwrap());
        assert!(!text.contains("camera.jitter"), "{recipe}: {text}");
        assert!(text.contains("jitter_zero"), "{recipe}: {text}");
    }
}

#[test]
fn the_y_of_a_velocity_is_that_of_the_language_unless_it_is_said() {
    for (recipe, y) in [
        ("outputs:write=velocity", "-0.5f"),
        ("outputs:write=velocity,y=up", "-0.5f"),
        ("outputs:write=velocity,y=down", " 0.5f"),
    ] {
        let text = text(&outputs(recipe).unwrap());
        assert!(
            text.contains(&format!(
                "vec2<f32>(0.5f,{}",
                if y.starts_with('-') {
                    format!(" {y}")
                } else {
                    y.to_owned()
                }
            )),
            "{recipe}: {text}"
        );
    }
}

#[test]
fn push_constants_with_an_array_are_copied_to_a_storage_buffer() {
    for (extra, kind) in [
        ("array<f32, 3>", BindingKind::StorageRead),
        ("vec4<f32>", BindingKind::Uniform),
    ] {
        let shader = format!(
            "struct Camera {{ view_proj: mat4x4<f32>, w: {extra} }}
            var<immediate> camera: Camera;
            @vertex fn vs(@location(0) p: vec3<f32>) -> @builtin(position) vec4<f32> {{
                return camera.view_proj * vec4(p * camera.w[2], 1.0);
            }}
            @fragment fn fs() -> @location(0) vec4<f32> {{ return vec4(1.0); }}"
        );
        let plan = with_facts(&shader, "outputs:write=velocity", &Facts::default()).unwrap();
        let copy = &pass(&plan).bindings[0];
        assert_eq!((copy.kind, previous(&plan)), (kind, vec!["camera"]));
    }
}

/// Names of the author's that look like ours stay the author's.
#[test]
fn functions_that_end_like_ours_keep_their_names() {
    let shader = SHADER.replace("clip_of", "clip_previous");
    let plan = with_facts(&shader, "outputs:write=velocity", &Facts::default()).unwrap();
    let text = text(&plan);
    assert!(
        body(&text, "clip_previous").contains("camera.view_proj"),
        "{text}"
    );
    assert!(!text.contains("fn function"), "{text}");
}

#[test]
fn attributes_that_move_have_a_copy() {
    let plan = outputs("outputs:write=velocity,moving=offset").unwrap();
    let attributes = pass(&plan).attributes.iter();
    let attributes: Vec<_> = attributes.map(|a| (a.location, a.previous_of)).collect();
    // The slice reads no normal, so its number is free.
    assert_eq!(attributes, [(0, None), (1, Some(3)), (2, None), (3, None)]);
    let refused = outputs("outputs:write=velocity,moving=offsets").unwrap_err();
    assert!(refused.starts_with("outputs[no-such-name]"), "{refused}");
}

/// `count` varyings and attributes from `first` on, which decide the coverage if `reads`.
fn with_locations(first: u32, count: u32, reads: bool) -> String {
    let all = || first..first + count;
    let list = |of: &dyn Fn(u32) -> String| all().map(of).collect::<Vec<_>>().join(", ");
    let sum = |of: &str| {
        let terms = all().map(|i| format!("{of}{i}"));
        terms.collect::<Vec<_>>().join(" + ")
    };
    let cut = if reads {
        "if sum.x < 0.5 { discard; }"
    } else {
        ""
    };
    format!(
        "@group(0) @binding(0) var<uniform> view_proj: mat4x4<f32>;
        struct Varyings {{ @builtin(position) clip: vec4<f32>, {} }}
        @vertex fn vs({}) -> Varyings {{ return Varyings(view_proj * ({}), {}); }}
        @fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {{
            let sum = {};
            {cut}
            return sum;
        }}",
        list(&|i| format!("@location({i}) v{i}: vec4<f32>")),
        list(&|i| format!("@location({i}) a{i}: vec4<f32>")),
        sum("a"),
        list(&|i| format!("a{i}")),
        sum("in.v"),
    )
}

#[test]
fn locations_that_the_slice_leaves_free_are_taken_first() {
    let made = |shader: &str, recipe: &'static str| with_facts(shader, recipe, &Facts::default());
    let plan = made(
        &with_locations(15, 1, false),
        "outputs:write=velocity,moving=a15",
    )
    .unwrap();
    let text = text(&plan);
    assert!(text.contains("@location(0) current_clip"), "{text}");
    assert!(text.contains("@location(1) previous_clip"), "{text}");
    let attributes = pass(&plan).attributes.iter();
    let attributes: Vec<_> = attributes.map(|a| (a.location, a.previous_of)).collect();
    assert_eq!(attributes, [(0, Some(15)), (15, None)]);
    assert!(pass(&plan).limits.is_empty(), "{:?}", pass(&plan).limits);
}

#[test]
fn more_than_every_device_has_is_refused_by_its_number() {
    for (shader, recipe, needed) in [
        (
            with_locations(0, 16, true),
            "outputs:write=velocity",
            "18 varyings",
        ),
        (with_locations(0, 15, true), "outputs:write=id", ""),
        (
            with_locations(0, 14, false),
            "outputs:write=velocity,moving=a0+a1+a2",
            "17 attributes",
        ),
        (
            with_locations(0, 9, false),
            "outputs:write=in.v0+in.v1+in.v2,precision=full",
            "48 bytes of colour",
        ),
        (
            with_locations(0, 9, false),
            "outputs:write=in.v0+in.v1+in.v2+in.v3+in.v4+in.v5+in.v6+in.v7+in.v8",
            "9 targets",
        ),
    ] {
        match with_facts(&shader, recipe, &Facts::default()) {
            Ok(_) => assert_eq!(needed, "", "{recipe}"),
            Err(refused) => {
                assert!(refused.starts_with("outputs[too-many]"), "{refused}");
                assert!(!needed.is_empty() && refused.contains(needed), "{refused}");
            }
        }
    }
}

const NAMED: &str = "
@group(0) @binding(0) var<uniform> view_proj: mat4x4<f32>;
struct Varyings { @builtin(position) clip: vec4<f32>, @location(0) uv: vec2<f32> }
@vertex fn vs(@location(0) p: vec3<f32>) -> Varyings {
    return Varyings(view_proj * vec4(p, 1.0), p.xy);
}
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {
    var turn = mat2x2<f32>(1.0, 0.5, 0.25, 1.0);
    var knots = array<f32, 3>(1.0, 2.0, 3.0);
    let left = in.uv < vec2(0.5);
    let wet = left.x;
    var tone = in.uv.x;
    if wet { var tone = in.uv.y; tone *= 2.0; knots[1] = tone; }
    return vec4(turn * in.uv * tone, knots[i32(in.uv.x)], f32(left.y));
}";

#[test]
fn truth_values_are_written_as_numbers() {
    let named = |recipe: &'static str| with_facts(NAMED, recipe, &Facts::default());
    for (recipe, format, written) in [
        ("outputs:write=wet", "r32uint", "u32(wet)"),
        ("outputs:write=left", "rg32uint", "vec2<u32>(left)"),
    ] {
        let plan = named(recipe).unwrap();
        let target = pass(&plan).targets[0].as_ref().unwrap();
        assert_eq!(target.format, format);
        let text = text(&plan);
        assert!(text.contains(written), "{text}");
    }
}

#[test]
fn a_value_without_a_target_is_refused_for_its_type() {
    let named = |recipe: &'static str| with_facts(NAMED, recipe, &Facts::default()).unwrap_err();
    for (recipe, what) in [
        ("outputs:write=turn", "`turn@fs` (matrix"),
        ("outputs:write=knots", "`knots@fs` (array"),
    ] {
        let refused = named(recipe);
        assert!(refused.starts_with("outputs[output-type]"), "{refused}");
        assert!(refused.contains(what), "{refused}");
    }
}

#[test]
fn a_shadowed_name_is_told_apart_by_its_line() {
    let named = |recipe: &'static str| with_facts(NAMED, recipe, &Facts::default());
    let refused = named("outputs:write=tone").unwrap_err();
    assert!(
        refused.contains("`tone@fs:12`") && refused.contains("`tone@fs:13`"),
        "{refused}"
    );
    for recipe in ["outputs:write=tone@fs:12", "outputs:write=tone:13"] {
        named(recipe).unwrap_or_else(|why| panic!("{recipe}: {why}"));
    }
}

#[test]
fn id_takes_the_draw_from_the_host() {
    let plan = outputs("outputs:write=id").unwrap();
    let host = BindingSource::Host {
        value: HostValue::DrawId,
    };
    let draw = pass(&plan).bindings.iter().find(|b| b.source == host);
    assert_eq!(draw.map(|b| (b.group, b.binding)), Some((1, 3)));
    assert!(text(&plan).contains("@builtin(instance_index)"));
}

#[test]
fn a_material_without_fragment_stage_has_outputs_too() {
    let program = common::program(SHADER);
    let state = MaterialState::default();
    let plan = Plan::original("test", program, "vs", None, &state);
    let done = Outputs::run(
        &plan,
        &Facts::default(),
        &params("outputs:write=velocity+id"),
    );
    let Ok(done) = done else { panic!("refused") };
    assert_eq!(pass(&done.plan).targets.len(), 2);
    text(&done.plan);
}

#[test]
fn a_bound_colour_target_is_written() {
    let plan = outputs("outputs:write=shadow,colour-target=bound").unwrap();
    let text = text(&plan);
    assert!(text.contains("-> @location(0) vec4<f32>"), "{text}");
    let target = pass(&plan).targets[0].as_ref().unwrap();
    assert_eq!(
        (target.format.as_str(), target.write_mask),
        ("rgba8unorm", 0)
    );
    // Without it, a note tells hosts of WebGL.
    let plan = outputs("outputs:write=shadow").unwrap();
    assert!(plan.notes.iter().any(|n| n.contains("colour-target=bound")));
}

#[test]
fn views_are_not_mixed_and_a_plan_has_one_pass_of_outputs() {
    let refused = outputs("outputs:write=shadow+velocity").unwrap_err();
    assert!(refused.starts_with("outputs[mixed-views]"), "{refused}");
    let plan = outputs("outputs:write=id").unwrap();
    let again = Outputs::run(&plan, &Facts::default(), &OutputsParams::default());
    let Err(refused) = again else { panic!("twice") };
    assert_eq!(refused.first().code, "has-outputs");
}

/// Two lights' calls of one function.
const TWICE: &str = "
@group(0) @binding(0) var<uniform> vp: mat4x4<f32>;
@group(0) @binding(1) var<uniform> light: vec4<f32>;
struct Out { @builtin(position) position: vec4<f32>, @location(0) n: vec3<f32>, @location(1) k: vec3<f32> }
@vertex fn vs(@location(0) p: vec3<f32>, @location(1) n: vec3<f32>) -> Out { return Out(vp * vec4(p, 1.0), n, p); }
fn lit(v: vec3<f32>, l: vec3<f32>) -> f32 { let u = normalize(v); return dot(u, l); }
@fragment fn fs(i: Out) -> @location(0) vec4<f32> {
    if i.k.x > 0.5 { return vec4(1.0); }
    let a = lit(i.n, light.xyz);
    let b = lit(SECOND);
    return vec4(a, b, 0.0, 1.0);
}";

#[test]
fn a_normal_is_that_of_the_call_that_meets_the_light() {
    let shader = TWICE.replace("SECOND", "i.k, vec3(0.0, 1.0, 0.0)");
    let own = text(&with_facts(&shader, "outputs:write=normal", &Facts::default()).unwrap());
    assert_eq!(own.matches("captured_value = ").count(), 1, "{own}");
    // The other call is not there.
    assert!(own.contains("i.n") && !own.contains("lit_1("), "{own}");
    // Two calls with one normal are no two normals.
    let shader = TWICE.replace("SECOND", "i.n, light.yzw");
    with_facts(&shader, "outputs:write=normal", &Facts::default()).unwrap();
}

#[test]
fn a_name_that_several_calls_compute_is_refused() {
    let shader = TWICE.replace("SECOND", "i.k, vec3(0.0, 1.0, 0.0)");
    for recipe in [
        "outputs:write=u",
        "outputs:write=normal,normal=u",
        "outputs:write=distance,position=u",
    ] {
        let refused = with_facts(&shader, recipe, &Facts::default()).unwrap_err();
        assert!(refused.starts_with("outputs[several-calls]"), "{refused}");
        assert!(refused.contains("2 calls (lines 9, 10)"), "{refused}");
    }
}

/// Where the stage returns before it computes the normal, 0 is written, and no NaN.
#[test]
fn a_direction_of_length_0_stays_0() {
    let shader = TWICE.replace("SECOND", "i.k, vec3(0.0, 1.0, 0.0)");
    let run = |recipe| text(&with_facts(&shader, recipe, &Facts::default()).unwrap());
    let own = run("outputs:write=normal,octahedral=true");
    assert!(own.contains("max("), "{own}");
    let own = run("outputs:write=normal,matrix=vp");
    assert!(own.contains("select(") && own.contains("length("), "{own}");
}
