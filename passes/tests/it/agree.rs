//! Two programs held against each other, whoever wrote them.

use std::sync::Arc;

use naga::front::wgsl;
use preshade_plan::mapping::Equation;
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;
use preshade_plan::state::MaterialState;
use preshade_validate::Effort;
use preshade_validate::agree::{Agreement, Class, Mismatch, Outcome, Question, Relation, agree};
use shader_text::source::{Language, SourceMap};

const MAIN: &str = include_str!("../../../fixtures/agree/leaf.wgsl");
const SHADOW: &str = include_str!("../../../fixtures/agree/leaf.shadow.wgsl");

pub fn plan(name: &str, text: &str) -> Plan {
    let module = wgsl::parse_str(text).unwrap();
    let mut sources = SourceMap::new();
    sources.add(name, text);
    let fragment = module.entry_points.iter();
    let fragment = fragment.filter(|e| e.stage == naga::ShaderStage::Fragment);
    let fragment = fragment.map(|e| e.name.clone()).next();
    let program = Program::new(module, Arc::new(sources), Language::Wgsl).unwrap();
    let state = MaterialState::default();
    Plan::original(name, program, "vs", fragment.as_deref(), &state)
}

pub fn held(
    relation: Relation,
    first: &str,
    second: &str,
    maps: &[&str],
) -> Result<Agreement, Mismatch> {
    let maps: Vec<Equation> = maps.iter().map(|m| m.parse().unwrap()).collect();
    let question = Question {
        maps: &maps,
        ..relation.into()
    };
    answered(question, first, second)
}

pub fn answered(question: Question<'_>, first: &str, second: &str) -> Result<Agreement, Mismatch> {
    let effort = Effort {
        inputs: 480,
        ..Effort::default()
    };
    let (first, second) = (plan("main.wgsl", first), plan("other.wgsl", second));
    agree(&first, &second, question, &effort)
}

/// The classes of findings, without the note on rounding that most pre-passes get.
pub fn classes(agreement: &Agreement) -> Vec<Class> {
    let classes = agreement.findings.iter().map(|f| f.class);
    classes.filter(|class| *class != Class::Variant).collect()
}

#[test]
fn a_shadow_by_hand_agrees_though_its_bindings_and_structs_are_its_own() {
    let agreement = held(Relation::Shadow, MAIN, SHADOW, &[]).unwrap();
    // It multiplies its matrices in another order.
    assert_eq!(classes(&agreement), [Class::Rounding]);
    let coverage = &agreement.promises[1].outcome;
    assert!(matches!(coverage, Outcome::Proved { .. }), "{agreement:#?}");
}

#[test]
fn another_threshold_is_told_in_words_with_both_lines() {
    let shadow = SHADOW.replace("alpha < 0.5", "alpha < 0.2");
    let agreement = held(Relation::Shadow, MAIN, &shadow, &[]).unwrap();
    let finding = &agreement.findings[0];
    assert_eq!(finding.class, Class::KeepsHidden);
    let said = &finding.words;
    assert!(
        said.starts_with("the shadow pass keeps this fragment at `alpha` = "),
        "{said}"
    );
    assert!(
        said.ends_with("the main pass discards it: its threshold is 0.5, not 0.2"),
        "{said}"
    );
    let at = |spot: &Option<preshade_validate::agree::Spot>| {
        let place = spot.as_ref().unwrap().location.clone().unwrap();
        (place.file, place.line)
    };
    assert_eq!(at(&finding.first_decides), ("main.wgsl".to_owned(), 30));
    assert_eq!(at(&finding.second_decides), ("other.wgsl".to_owned(), 21));
}

#[test]
fn what_the_shadow_forgets_is_found() {
    for (forgotten, class) in [
        (("uv * material.uv_scale", "uv"), Class::KeepsHidden),
        ((" * material.opacity", ""), Class::KeepsHidden),
        (("in.uv).a", "in.uv.yx).a"), Class::KeepsHidden),
        (
            ("sin(light.time + position.y)", "sin(light.time)"),
            Class::Position,
        ),
        (
            ("light.view_proj * model", "light.view_proj"),
            Class::Position,
        ),
    ] {
        let shadow = SHADOW.replace(forgotten.0, forgotten.1);
        assert_ne!(shadow, SHADOW, "{forgotten:?}");
        let agreement = held(Relation::Shadow, MAIN, &shadow, &[]).unwrap();
        assert!(
            classes(&agreement).contains(&class),
            "{forgotten:?}: {agreement:#?}"
        );
    }
}

#[test]
fn another_bias_is_another_level_alone() {
    let biased = MAIN.replace("in.uv)", "in.uv, -1.0)");
    let biased = biased.replace("textureSample(", "textureSampleBias(");
    let agreement = held(Relation::Shadow, &biased, SHADOW, &[]).unwrap();
    assert!(
        classes(&agreement).contains(&Class::LevelOnly),
        "{agreement:#?}"
    );
    assert!(
        !classes(&agreement).contains(&Class::KeepsHidden),
        "{agreement:#?}"
    );
    // Gradients of the coordinates are the implicit level.
    let gradients = SHADOW.replace("in.uv)", "in.uv, dpdx(in.uv), dpdy(in.uv))");
    let gradients = gradients.replace("textureSample(", "textureSampleGrad(");
    let agreement = held(Relation::Discard, MAIN, &gradients, &[]).unwrap();
    assert_eq!(classes(&agreement), [], "{agreement:#?}");
}

/// The light's matrix has a name of its own, in a buffer of another shape.
#[test]
fn a_name_without_a_partner_is_a_finding_until_a_map_gives_it_one() {
    let shadow = SHADOW.replace("view_proj", "to_light");
    let agreement = held(Relation::Shadow, MAIN, &shadow, &[]).unwrap();
    assert_eq!(classes(&agreement), [Class::Unmatched], "{agreement:#?}");
    let said = &agreement.findings[0].words;
    assert!(said.contains("`light.to_light` (mat4x4<f32>)"), "{said}");
    assert!(said.contains("`camera.view_proj`"), "{said}");
    let maps = ["light.to_light=camera.view_proj"];
    let agreement = held(Relation::Shadow, MAIN, &shadow, &maps).unwrap();
    assert_eq!(classes(&agreement), [Class::Rounding], "{agreement:#?}");
}

#[test]
fn discards_that_depend_on_the_view_are_told_apart() {
    let main = MAIN.replace("alpha < 0.5", "alpha < 0.2 * camera.eye.x");
    let shadow = SHADOW
        .replace("time: f32 }", "time: f32, position: vec4<f32> }")
        .replace("alpha < 0.5", "alpha < 0.2 * light.position.x");
    let maps = [
        "light.position=camera.eye",
        "light.view_proj=camera.view_proj",
    ];
    let agreement = held(Relation::Shadow, &main, &shadow, &maps).unwrap();
    assert!(
        classes(&agreement).contains(&Class::ViewDependent),
        "{agreement:#?}"
    );
    assert!(
        !classes(&agreement).contains(&Class::KeepsHidden),
        "{agreement:#?}"
    );
}

#[test]
fn a_velocity_pass_rests_if_nothing_moves() {
    let velocity = "
        struct Camera { view_proj: mat4x4<f32>, prev_view_proj: mat4x4<f32>, time: f32, prev_time: f32 }
        @group(0) @binding(0) var<uniform> camera: Camera;
        @group(1) @binding(0) var<uniform> model: mat4x4<f32>;
        @group(1) @binding(1) var<uniform> prev_model: mat4x4<f32>;
        struct Out { @builtin(position) position: vec4<f32>, @location(0) now: vec4<f32>, @location(1) before: vec4<f32> }
        @vertex fn vs(@location(0) position: vec3<f32>) -> Out {
            let now = position + vec3(sin(camera.time + position.y) * 0.1, 0.0, 0.0);
            let before = position + vec3(sin(camera.prev_time + position.y) * 0.1, 0.0, 0.0);
            let clip = camera.view_proj * (model * vec4(now, 1.0));
            return Out(clip, clip, camera.prev_view_proj * (prev_model * vec4(before, 1.0)));
        }
        @fragment fn fs(in: Out) -> @location(0) vec2<f32> {
            return (in.now.xy / in.now.w - in.before.xy / in.before.w) * 0.5;
        }";
    let main = MAIN.replace("discard;", "");
    let agreement = held(Relation::Velocity, &main, velocity, &[]).unwrap();
    assert_eq!(classes(&agreement), [], "{agreement:#?}");
    // The previous position does not sway.
    let stiff = velocity.replace("vec4(before, 1.0)", "vec4(position, 1.0)");
    let agreement = held(Relation::Velocity, &main, &stiff, &[]).unwrap();
    assert_eq!(classes(&agreement), [Class::Moves], "{agreement:#?}");
}

#[test]
fn a_normal_pass_writes_the_normal_of_the_g_buffer() {
    let main = "
        @group(0) @binding(0) var<uniform> view: mat4x4<f32>;
        struct V { @builtin(position) position: vec4<f32>, @location(0) n: vec3<f32> }
        struct G { @location(0) albedo: vec4<f32>, @location(1) normal: vec4<f32> }
        @vertex fn vs(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>) -> V {
            return V(view * vec4(position, 1.0), normal); }
        @fragment fn fs(in: V) -> G { return G(vec4(1.0), vec4(normalize(in.n), 1.0)); }";
    let own = "
        @group(0) @binding(0) var<uniform> view: mat4x4<f32>;
        struct V { @builtin(position) position: vec4<f32>, @location(0) n: vec3<f32> }
        @vertex fn vs(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>) -> V {
            return V(view * vec4(position, 1.0), normal); }
        @fragment fn fs(in: V) -> @location(0) vec4<f32> { return vec4(normalize(in.n), 1.0); }";
    let agreement = held(Relation::Normal, main, own, &[]).unwrap();
    assert!(agreement.holds(), "{agreement:#?}");
    let raw = own.replace("normalize(in.n)", "in.n");
    let agreement = held(Relation::Normal, main, &raw, &[]).unwrap();
    assert_eq!(classes(&agreement), [Class::Color], "{agreement:#?}");
}

#[test]
fn same_sees_colours_and_takes_numbers_over_names() {
    let agreement = held(Relation::Same, MAIN, MAIN, &[]).unwrap();
    assert!(agreement.holds(), "{agreement:#?}");
    let renamed = MAIN
        .replace("material", "surface")
        .replace("texel", "t")
        .replace("camera", "eye_data")
        .replace("wind(", "sway(");
    assert!(held(Relation::Same, MAIN, &renamed, &[]).unwrap().holds());
    let darker = MAIN.replace("0.1);", "0.2);");
    let agreement = held(Relation::Same, MAIN, &darker, &[]).unwrap();
    assert_eq!(classes(&agreement), [Class::Color], "{agreement:#?}");
    // The host's bindings have not changed with the names.
    let swapped = "
        @group(0) @binding(0) var<uniform> b: vec4<f32>;
        @group(0) @binding(1) var<uniform> a: vec4<f32>;
        @vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p * a + b; }";
    let plain = swapped
        .replace("binding(0)", "binding(9)")
        .replace("binding(1)", "binding(0)")
        .replace("binding(9)", "binding(1)");
    let agreement = held(Relation::Same, &plain, swapped, &[]).unwrap();
    assert_eq!(classes(&agreement), [Class::Position], "{agreement:#?}");
    assert!(
        held(Relation::Position, &plain, swapped, &[])
            .unwrap()
            .holds()
    );
}

#[test]
fn what_does_not_fit_is_one_error() {
    let other = "
        @group(3) @binding(7) var<uniform> z: array<vec4<f32>, 3>;
        @vertex fn vs(@location(5) q: vec2<u32>) -> @builtin(position) vec4<f32> { return z[q.x]; }";
    assert_eq!(
        held(Relation::Prepass, MAIN, other, &[]).unwrap_err(),
        Mismatch::Nothing
    );
    for map in [
        "light.none=camera.view_proj",
        "light.time=camera.view_proj",
        "light=nothing",
    ] {
        let error = held(Relation::Shadow, MAIN, SHADOW, &[map]).unwrap_err();
        assert!(matches!(error, Mismatch::Map { .. }), "{error}");
    }
}

/// A material whose bits are chosen by the faults below.
const WIDE: &str = "
    struct Camera { view_proj: mat4x4<f32>, eye: vec4<f32>, fade_far: f32 }
    @group(0) @binding(0) var<uniform> camera: Camera;
    @group(0) @binding(1) var<uniform> flags: vec4<u32>;
    @group(0) @binding(2) var<uniform> bones: array<mat4x4<f32>, 32>;
    @group(0) @binding(3) var albedo: texture_2d<f32>;
    @group(0) @binding(4) var own: sampler;
    struct V { @builtin(position) position: vec4<f32>, @location(0) world: vec3<f32>, @location(1) uv: vec2<f32> }
    @vertex fn vs(@location(0) p: vec3<f32>, @location(1) bone: u32, @builtin(instance_index) i: u32) -> V {
        var q = bones[bone] * vec4(p, 1.0);
        if (flags.x & 64u) != 0u { q.y += 1.0; }
        if i > 20u { q.x += 1.0; }
        return V(camera.view_proj * q, p, p.xy);
    }
    struct F { @location(0) color: vec4<f32>, @builtin(sample_mask) mask: u32 }
    @fragment fn fs(in: V) -> F {
        let texel = textureSample(albedo, own, in.uv);
        if distance(camera.eye.xyz, in.world) > 30.0 { discard; }
        if texel.a < 0.5 { discard; }
        return F(texel, select(3u, 15u, texel.r > 0.4));
    }";

#[test]
fn what_ordinary_numbers_seldom_reach_is_found() {
    let alike = held(Relation::Prepass, WIDE, WIDE, &[]).unwrap();
    assert!(alike.holds(), "{alike:#?}");
    let faults: [(&str, &str, &[Class]); 9] = [
        ("& 64u", "& 128u", &[Class::Position]),
        ("i > 20u", "i > 30u", &[Class::Position]),
        ("bones[bone]", "bones[min(bone, 20u)]", &[Class::Position]),
        ("> 30.0", "> 50.0", &[Class::KeepsHidden]),
        (
            "if distance(camera.eye.xyz, in.world) > 30.0 { discard; }",
            "",
            &[Class::KeepsHidden],
        ),
        ("texel.a < 0.5", "texel.a < 0.3", &[Class::KeepsHidden]),
        ("texel.a < 0.5", "texel.a <= 0.5", &[Class::Loses]),
        ("texel.r > 0.4", "texel.r > 0.2", &[Class::KeepsHidden]),
        ("own", "other", &[Class::Unmatched]),
    ];
    for (from, to, expected) in faults {
        let mut other = WIDE.replace(from, to);
        if to == "other" {
            other = other.replace("@binding(4)", "@binding(5)");
        }
        let agreement = held(Relation::Prepass, WIDE, &other, &[]).unwrap();
        let found = classes(&agreement);
        assert!(
            expected.iter().all(|class| found.contains(class)),
            "{from}: {found:?}"
        );
    }
}

#[test]
fn clip_distances_and_alpha_to_coverage_are_compared() {
    let clipped = "
        enable clip_distances;
        @group(0) @binding(0) var<uniform> m: mat4x4<f32>;
        struct V { @builtin(position) position: vec4<f32>, @builtin(clip_distances) clip: array<f32, 1> }
        @vertex fn vs(@location(0) p: vec3<f32>) -> V { return V(m * vec4(p, 1.0), array<f32, 1>(p.x)); }";
    let whole = "
        @group(0) @binding(0) var<uniform> m: mat4x4<f32>;
        @vertex fn vs(@location(0) p: vec3<f32>) -> @builtin(position) vec4<f32> { return m * vec4(p, 1.0); }";
    for relation in [Relation::Prepass, Relation::Shadow, Relation::Position] {
        let agreement = held(relation, clipped, whole, &[]).unwrap();
        assert_eq!(classes(&agreement), [Class::Position], "{agreement:#?}");
    }
}

#[test]
fn a_store_of_another_number_is_no_rounding() {
    let text = "
        @group(0) @binding(0) var<storage, read_write> seen: array<u32, 4>;
        @vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }
        @fragment fn fs() -> @location(0) vec4<f32> { seen[1] = 5u; return vec4(1.0); }";
    let agreement = held(Relation::Same, text, &text.replace("5u", "9u"), &[]).unwrap();
    assert_eq!(classes(&agreement), [Class::Color], "{agreement:#?}");
}

#[test]
fn a_velocity_follows_the_motion() {
    let main = "
        struct Camera { view_proj: mat4x4<f32>, prev_view_proj: mat4x4<f32> }
        @group(0) @binding(0) var<uniform> camera: Camera;
        @vertex fn vs(@location(0) p: vec3<f32>) -> @builtin(position) vec4<f32> {
            return camera.view_proj * vec4(p, 1.0); }
        @fragment fn fs() -> @location(0) vec4<f32> { return vec4(1.0); }";
    let velocity = "
        struct Camera { view_proj: mat4x4<f32>, prev_view_proj: mat4x4<f32> }
        @group(0) @binding(0) var<uniform> camera: Camera;
        struct V { @builtin(position) position: vec4<f32>, @location(0) now: vec4<f32>, @location(1) before: vec4<f32> }
        @vertex fn vs(@location(0) p: vec3<f32>) -> V {
            let now = camera.view_proj * vec4(p, 1.0);
            return V(now, now, camera.prev_view_proj * vec4(p, 1.0)); }
        @fragment fn fs(in: V) -> @location(0) vec2<f32> {
            return clamp(in.now.xy / in.now.w - in.before.xy / in.before.w, vec2(-1.0), vec2(1.0)); }";
    let agreement = held(Relation::Velocity, main, velocity, &[]).unwrap();
    assert!(agreement.holds(), "{agreement:#?}");
    for (from, to) in [
        ("camera.prev_view_proj *", "camera.view_proj *"),
        ("in.before.xy / in.before.w", "in.before.xy / in.now.w"),
        ("in.before.xy /", "in.before.yx /"),
        ("in.now.xy / in.now.w", "in.before.xy / in.before.w"),
    ] {
        let agreement = held(Relation::Velocity, main, &velocity.replace(from, to), &[]).unwrap();
        assert_eq!(
            classes(&agreement),
            [Class::Moves],
            "{from}: {agreement:#?}"
        );
    }
    // Grass sways, and its last frame has this frame's time.
    let sways = |text: &str| {
        text.replace(
            "camera: Camera;",
            "camera: Camera; @group(0) @binding(1) var<uniform> time: f32;",
        )
        .replace(
            "vec4(p, 1.0)",
            "vec4(p.x + sin(time + p.x) * p.y, p.yz, 1.0)",
        )
    };
    let agreement = held(Relation::Velocity, &sways(main), &sways(velocity), &[]).unwrap();
    let moves = agreement
        .findings
        .iter()
        .filter(|f| f.class == Class::Moves);
    let said: Vec<&str> = moves.map(|f| f.words.as_str()).collect();
    assert_eq!(
        said,
        ["the position depends on `time`, and the velocity pass reads no previous value of it"]
    );
}

/// A material without discards, and its material's buffer under another hand's names.
const PLAIN: &str = "
    struct Object { model: mat4x4<f32>, prev_model: mat4x4<f32> }
    struct Material { tint: vec4<f32>, cut: f32 }
    @group(0) @binding(0) var<uniform> view: mat4x4<f32>;
    @group(1) @binding(0) var<uniform> object: Object;
    @group(1) @binding(1) var<uniform> m: Material;
    struct V { @builtin(position) position: vec4<f32>, @location(0) uv: vec2<f32> }
    @vertex fn vs(@location(0) p: vec3<f32>, @location(1) uv: vec2<f32>) -> V {
        var c = view * (object.model * vec4(p, 1.0));
        return V(c, uv); }
    @fragment fn fs(in: V) -> @location(0) vec4<f32> {
        if fwidthCoarse(in.uv.x) + in.uv.y < m.cut { discard; }
        return m.tint; }";

#[test]
fn what_no_input_shows_is_a_note() {
    let invariant = PLAIN.replace("@builtin(position)", "@builtin(position) @invariant");
    let ordered = invariant
        .replace("tint", "base")
        .replace("cut: f32", "least: f32")
        .replace("m.cut", "m.least");
    let fine = invariant.replace("fwidthCoarse", "fwidthFine");
    let other = invariant.replace(
        "object.model * vec4(p, 1.0)",
        "object.model * vec4(p.xyz, 1.0)",
    );
    for (relation, first, second, expected) in [
        (
            Relation::Prepass,
            PLAIN,
            PLAIN,
            Some("neither position is invariant"),
        ),
        (
            Relation::Velocity,
            PLAIN,
            &invariant,
            Some("the position of the main pass"),
        ),
        (
            Relation::Prepass,
            &invariant,
            PLAIN,
            Some("the position of the pre-pass"),
        ),
        (Relation::Shadow, PLAIN, PLAIN, None),
        (Relation::Prepass, &invariant, &other, None),
        (
            Relation::Prepass,
            &invariant,
            &ordered,
            Some("`base` is `tint`, `least` is `cut`"),
        ),
        (Relation::Same, &invariant, &ordered, None),
        (
            Relation::Prepass,
            &invariant,
            &fine,
            Some("`fwidthCoarse`, and the pre-pass `fwidthFine`"),
        ),
    ] {
        let agreement = held(relation, first, second, &[]).unwrap();
        let variant = agreement
            .findings
            .iter()
            .filter(|f| f.class == Class::Variant);
        let mut said: Vec<&String> = variant.map(|f| &f.words).collect();
        said.extend(&agreement.notes);
        let is_it = match (expected, &said[..]) {
            (None, []) => true,
            (Some(words), [one]) => one.contains(words),
            _ => false,
        };
        assert!(is_it, "{expected:?}: {said:?}");
        assert!(!Class::Variant.breaks(relation));
        assert_eq!(
            agreement.holds(),
            relation != Relation::Velocity,
            "{agreement:#?}"
        );
    }
}

#[test]
fn a_bias_of_the_depth_goes_one_way() {
    let with = |edit: &str| PLAIN.replace("return V(c,", &format!("{edit} return V(c,"));
    let pancaked = "c.z = max(c.z + 0.001 * c.w, 0.0);";
    for (edit, relation, class) in [
        (pancaked, Relation::Shadow, Class::DepthBias),
        (pancaked, Relation::Prepass, Class::DepthBias),
        (pancaked, Relation::Position, Class::Position),
        ("c.z = c.w - c.z;", Relation::Shadow, Class::Position),
        (
            "c.z += 0.01; c.x += 0.01;",
            Relation::Shadow,
            Class::Position,
        ),
    ] {
        let agreement = held(relation, PLAIN, &with(edit), &[]).unwrap();
        assert_eq!(classes(&agreement), [class], "{edit}: {agreement:#?}");
    }
    assert!(
        !Class::DepthBias.breaks(Relation::Shadow) && Class::DepthBias.breaks(Relation::Prepass)
    );
}

#[test]
fn a_finding_names_what_differs() {
    for (first, from, to, expected) in [
        (
            PLAIN,
            "object.model *",
            "object.prev_model *",
            "`object.prev_model` is (",
        ),
        (
            PLAIN,
            "vec4(p, 1.0)",
            "vec4(p * 1.00002, 1.0)",
            "`p * 1.00002` is (",
        ),
        (
            WIDE,
            "if distance(camera.eye.xyz, in.world) > 30.0 { discard; }",
            "",
            "> 30.0` compares ",
        ),
        (
            WIDE,
            "if distance(camera.eye.xyz, in.world) > 30.0 { discard; }",
            "",
            "and the pre-pass has no such condition",
        ),
    ] {
        let agreement = held(Relation::Prepass, first, &first.replace(from, to), &[]).unwrap();
        let said = &agreement.findings[0].words;
        assert!(said.contains(expected), "{to}: {said}");
        let [_, ours, theirs] = agreement.findings[0].output.as_ref().unwrap();
        assert_ne!(ours, theirs);
        let places: Vec<&str> = said.split(" at (").skip(1).collect();
        if let [theirs, ours] = places[..] {
            let numbers = |text: &str| text.split(')').next().unwrap().to_owned();
            assert_ne!(numbers(ours), numbers(theirs), "{said}");
        }
    }
}

#[test]
fn a_normal_is_found_by_its_name_or_its_role() {
    let lit = |end: &str| {
        format!(
            "@group(0) @binding(0) var<uniform> view: mat4x4<f32>;
            @group(0) @binding(1) var<uniform> light: vec4<f32>;
            struct V {{ @builtin(position) position: vec4<f32>, @location(0) n: vec3<f32> }}
            @vertex fn vs(@location(0) p: vec3<f32>, @location(1) n: vec3<f32>) -> V {{
                return V(view * vec4(p, 1.0), n); }}
            fn oct(n: vec3<f32>) -> vec2<f32> {{
                let p = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
                let s = select(vec2(-1.0), vec2(1.0), p >= vec2(0.0));
                return select(p, (1.0 - abs(p.yx)) * s, n.z < 0.0); }}
            @fragment fn fs(in: V) -> @location(0) vec4<f32> {{ {end} }}"
        )
    };
    let by_role = lit("let n = normalize(in.n); return vec4(dot(n, normalize(light.xyz)));");
    let unlit = lit("return light;");
    let n = "let n = normalize(in.n); ";
    for (first, name, second, expected) in [
        (&by_role, None, "return vec4(n, 0.0);", Some(true)),
        (
            &by_role,
            None,
            "return vec4(n * 0.5 + 0.5, 0.0);",
            Some(true),
        ),
        (&by_role, Some("n"), "return vec4(n, 0.0);", Some(true)),
        (&unlit, Some("in.n"), "return vec4(n, 0.0);", Some(true)),
        (&by_role, None, "return vec4(n.xzy, 0.0);", Some(false)),
        (&by_role, None, "return vec4(in.n, 0.0);", Some(false)),
        (
            &by_role,
            None,
            "return vec4(n * 0.6 + 0.4, 0.0);",
            Some(false),
        ),
        (&unlit, None, "return vec4(n, 0.0);", None),
        (&by_role, Some("nothing"), "return vec4(n, 0.0);", None),
    ] {
        let question = Question {
            normal: name,
            ..Relation::Normal.into()
        };
        let agreement = answered(question, first, &lit(&format!("{n}{second}"))).unwrap();
        let outcome = &agreement.promises[2].outcome;
        let is_it = match expected {
            Some(true) => matches!(outcome, Outcome::Agreed { .. }),
            Some(false) => classes(&agreement) == [Class::Color],
            None => matches!(outcome, Outcome::NotEvaluated { .. }),
        };
        assert!(is_it, "{second}: {agreement:#?}");
        assert_eq!(agreement.is_nothing(), expected.is_none(), "{second}");
    }
    // Two numbers are octahedral.
    for (encoded, is_it) in [
        ("oct(n)", true),
        ("oct(n) * 0.5 + 0.5", true),
        ("n.xy", false),
    ] {
        let second = lit(&format!("{n}return {encoded};")).replace(
            "fs(in: V) -> @location(0) vec4",
            "fs(in: V) -> @location(0) vec2",
        );
        let agreement = held(Relation::Normal, &by_role, &second, &[]).unwrap();
        assert_eq!(agreement.holds(), is_it, "{encoded}: {agreement:#?}");
    }
}

#[test]
fn a_pair_has_a_budget() {
    let material = |fetches: u32, least: &str| {
        PLAIN
            .replace(
                "struct V ",
                "@group(1) @binding(2) var t: texture_2d<f32>; struct V ",
            )
            .replace(
                "if fwidthCoarse(in.uv.x) + in.uv.y < m.cut {",
                &format!(
                    "var a = 0.0; for (var k = 0; k < {fetches}; k++) {{
                        a += textureLoad(t, vec2(i32(in.uv.x * 64.0), k), 0).a; }}
                    if a < {least} {{"
                ),
            )
    };
    let effort = Effort {
        inputs: 480,
        steps: 10_000,
        ..Effort::default()
    };
    for (fetches, expected) in [(4, 480..=1920), (50, 120..=300), (100, 0..=0), (900, 0..=0)] {
        let half = fetches / 2;
        let first = plan("main.wgsl", &material(fetches, &format!("{half}.0")));
        let second = material(fetches, "0.0").replace("if a <", &format!("if a - {half}.0 <"));
        let second = plan("other.wgsl", &second);
        let agreement = agree(&first, &second, Relation::Discard.into(), &effort).unwrap();
        let inputs = match &agreement.promises[0].outcome {
            Outcome::Agreed { inputs, cut_from } => {
                assert_eq!(cut_from.is_some(), fetches == 50);
                *inputs
            }
            Outcome::NotEvaluated { why } => {
                let reason = if fetches == 100 {
                    "too expensive"
                } else {
                    "step limit"
                };
                assert!(why.contains(reason), "{why}");
                0
            }
            other => panic!("{fetches}: {other:?}"),
        };
        assert!(expected.contains(&inputs), "{fetches}: {inputs}");
    }
}
