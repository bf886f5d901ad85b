//! What is not proved is not said to hold: the verdicts of variants that no picture speaks for,
//! each by name.

use std::path::Path;
use std::sync::Arc;

use glam::{Mat4, Vec3};
use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::{self, Scene};
use preshade_lab::measure::record::{Report, VariantReport};
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings, Variant, verify};
use preshade_plan::budget::{Budget, Metric};
use preshade_plan::contract::{Contract, Verdict};
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::state::{Blend, ColorTarget, CompareFunction, MaterialState};
use preshade_scenes::ShaderForm;
use shader_text::options;

use crate::render_support::*;

fn run(scene: &Scene, variant: Variant) -> Report {
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    };
    verify(
        &Session::new(gpu(), scene, ShaderForm::Text).unwrap(),
        &[variant],
        &settings,
        &mut |_| {},
    )
    .unwrap()
    .report
}

fn made_by(scene: &Scene, recipe: &str) -> Variant {
    let recipe = Recipe::parse([recipe]).unwrap();
    measure::variant(&originals(scene), &recipe, &Facts::without_ties())
}

fn not_measured(report: &VariantReport) -> &str {
    match &report.verdict {
        Verdict::NotMeasured { why } => why,
        other => panic!("{}: {other:?}", report.name),
    }
}

#[test]
fn zero_covered_pixels_prove_nothing() {
    let mut scene = planes([32, 32], 2);
    for draw in &mut scene.draws {
        draw.transform = Mat4::from_translation(Vec3::new(0.0, 0.0, 2.0));
    }
    let report = run(&scene, made_by(&scene, "depth-prepass"));
    let [original, variant] = &report.variants[..] else {
        panic!("{} variants", report.variants.len());
    };
    // Nor that the original draws anything: what it would make a position of is named.
    let why = not_measured(original);
    assert!(why.starts_with("nothing is drawn in any view"), "{why}");
    assert!(
        why.contains("(`flat` reads `position` at location 0)"),
        "{why}"
    );
    assert_eq!(
        not_measured(variant),
        "no opaque surface is seen in any view"
    );
    assert!(variant.error.as_ref().unwrap().is_exact());
    assert!(!report.is_broken());
}

/// A blended surface alone covers nothing that a pre-pass could spare.
#[test]
fn blended_pixels_are_not_covered_ones() {
    let mut scene = planes([32, 32], 2);
    let mut glass = scene.materials[0].clone();
    glass.name = "glass".to_owned();
    glass.state.depth_write = false;
    glass.state.targets = vec![Some(ColorTarget {
        blend: Some(Blend::ALPHA),
        ..ColorTarget::opaque("rgba8unorm")
    })];
    scene.materials.push(glass);
    scene.draws[0].material = 1;
    scene.draws[1].transform = Mat4::from_translation(Vec3::new(0.0, 0.0, 2.0));
    let report = run(&scene, made_by(&scene, "depth-prepass"));
    assert_eq!(report.variants[0].verdict, Verdict::Holds);
    assert_eq!(
        not_measured(&report.variants[1]),
        "no opaque surface is seen in any view"
    );
}

/// Less beside Greater: one of them moves depth against the other, so neither may lay it ahead.
#[test]
fn compare_directions_that_do_not_match_are_refused() {
    let mut scene = planes([32, 32], 3);
    let mut against = scene.materials[0].clone();
    against.name = "against".to_owned();
    against.state.depth_compare = Some(CompareFunction::Greater);
    scene.materials.push(against);
    scene.draws[1].material = 1;
    for recipe in ["depth-prepass:form=equal", "early-discard"] {
        let variant = made_by(&scene, recipe);
        let why = |material: &str| {
            let kept = variant.kept.iter().find(|k| k.material == material);
            kept.unwrap_or_else(|| panic!("{recipe}: `{material}` is not kept"))
                .why
                .clone()
        };
        assert!(
            why("flat").contains("[neighbour-moves-depth]: material `against`"),
            "{recipe}: {}",
            why("flat")
        );
        why("against");
        assert!(variant.plans.iter().all(|p| p.steps.is_empty()), "{recipe}");
        let report = run(&scene, variant);
        assert_eq!(
            not_measured(&report.variants[1]),
            "every material refuses it"
        );
    }
    // Not for nothing: without the look at its neighbours it breaks.
    let mut plans = originals(&scene);
    let recipe = Recipe::parse(["depth-prepass:form=equal"]).unwrap();
    plans[0] = recipe.apply(&plans[0], &Facts::without_ties()).unwrap();
    let forced = Variant {
        name: "forced".to_owned(),
        recipe: recipe.to_string(),
        plans,
        kept: Vec::new(),
    };
    let error = run(&scene, forced).variants[1].error.clone().unwrap();
    assert!(!error.is_exact());
}

#[test]
fn a_neighbour_that_stores_keeps_every_depth_where_it_is() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scenes/neighbour-stores.toml");
    let scene = preshade_scenes::load(&path).unwrap().resized([64, 36]);
    for recipe in ["depth-prepass", "depth-prepass:form=equal", "early-discard"] {
        let variant = made_by(&scene, recipe);
        let codes: Vec<(&str, bool)> = variant
            .kept
            .iter()
            .map(|k| {
                let code = match k.material.as_str() {
                    "probe" => "[fragment-store]",
                    _ => "[neighbour-counts-fragments]: material `probe`",
                };
                (k.material.as_str(), k.why.contains(code))
            })
            .collect();
        assert_eq!(codes, [("probe", true), ("stone", true)], "{recipe}");
        assert!(variant.plans.iter().all(|p| p.steps.is_empty()), "{recipe}");
        let report = run(&scene, variant);
        assert_eq!(report.variants[0].verdict, Verdict::Holds);
        assert_eq!(
            not_measured(&report.variants[1]),
            "every material refuses it"
        );
    }
    // A shadow map is no frame of the neighbour's.
    let report = run(&scene, made_by(&scene, "shadow"));
    assert_eq!(report.variants[1].verdict, Verdict::Holds);
}

/// A leaning square whose colour goes through `waves` radians from its middle to its edge.
fn waves(waves: f32) -> Scene {
    let source = format!(
        "
struct Camera {{ view_proj: mat4x4<f32> }}
struct Object {{ model: mat4x4<f32>, tint: vec4<f32> }}
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> object: Object;
struct Out {{ @builtin(position) at: vec4<f32>, @location(0) place: vec2<f32> }}
@vertex fn vs(@location(0) position: vec3<f32>) -> Out {{
    return Out(camera.view_proj * object.model * vec4(position, 1.0), position.xy);
}}
@fragment fn fs(in: Out) -> @location(0) vec4<f32> {{
    return vec4(0.5 + 0.4 * sin({waves:?} * (in.place.x + in.place.y)), 0.5, 0.5, 1.0) * \
        object.tint;
}}"
    );
    let leaning = Mat4::from_translation(Vec3::new(0.0, 0.0, 0.5))
        * Mat4::from_rotation_z(0.37)
        * Mat4::from_scale(Vec3::splat(0.717));
    let drawn = draw("square", leaning, [1.0; 4]);
    scene([96, 96], vec![material("waves", &source)], vec![drawn])
}

#[test]
fn a_step_of_255_is_a_budget_that_steep_shading_exceeds() {
    let recipe = "visibility-buffer:budget=0.004";
    let gentle = waves(4.0);
    let report = run(&gentle, made_by(&gentle, recipe));
    assert_eq!(report.variants[1].verdict, Verdict::Holds);
    let steep = waves(200_000.0);
    let report = run(&steep, made_by(&steep, recipe));
    let Verdict::Broken { r#where } = &report.variants[1].verdict else {
        panic!("{:?}", report.variants[1].verdict);
    };
    assert!(r#where.contains("of a budget of 0.004"), "{where}");
}

/// Where the picture of a plan that was made for an adapter that does otherwise is off, that is
/// said beside.
#[test]
fn a_plan_for_another_adapter_is_named() {
    use preshade_plan::rasterizer::Corners;
    let seen = measure::rasterizer(gpu()).unwrap();
    let [own, other] = match seen.corners {
        Corners::Snapped => ["snapped", "as-given"],
        Corners::AsGiven | Corners::Held => ["as-given", "snapped"],
    };
    // Steep enough to tell a 512th of a pixel.
    let scene = waves(400.0);
    let of = |corners: &str| {
        let recipe = format!("visibility-buffer:corners={corners},budget=0.004");
        run(&scene, made_by(&scene, &recipe)).variants.remove(1)
    };
    assert_eq!(of(own).verdict, Verdict::Holds);
    let Verdict::Broken { r#where } = of(other).verdict else {
        panic!("{other} holds");
    };
    assert!(
        r#where.contains(&format!(
            "corners={other}, but the adapter was measured as `{own}`"
        )),
        "{where}"
    );
}

/// A half has 11 bits: from 8 on they lie further apart than steps of 255.
#[test]
fn a_step_of_a_target_of_halves_is_theirs() {
    for (format, largest) in [
        ("rgba16float", 40.0),
        ("rgba16float", 400.0),
        ("rgba8unorm", 1.0),
    ] {
        let mut bright = waves(4.0);
        bright.materials[0].state.targets = vec![Some(ColorTarget::opaque(format))];
        for draw in &mut bright.draws {
            let tint = vec![largest, largest, largest, 1.0];
            let value = preshade_draw::scene::Value::Numbers(tint);
            draw.values.insert("object.tint".to_owned(), value);
        }
        let report = run(&bright, made_by(&bright, "visibility-buffer:budget=1"));
        assert_eq!(
            report.variants[1].verdict,
            Verdict::Holds,
            "{format} {largest}"
        );
        let error = report.variants[1].error.as_ref().unwrap();
        assert!(error.max_steps <= 1.0 + 1e-4, "{error:?}");
        assert_eq!(error.beyond_step, 0, "{error:?}");
    }
}

/// The report on a square whose fragments are discarded under a condition.
fn discarding(condition: &str, recipe: &str) -> Report {
    let scene = discarding_scene(condition);
    run(&scene, made_by(&scene, recipe))
}

fn discarding_scene(condition: &str) -> Scene {
    let source = format!(
        "
struct Camera {{ view_proj: mat4x4<f32> }}
struct Object {{ model: mat4x4<f32>, tint: vec4<f32> }}
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> object: Object;
@group(1) @binding(1) var map: texture_2d<f32>;
override CUT: f32 = 0.0;
@vertex fn vs(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> {{
    return camera.view_proj * object.model * vec4(position, 1.0);
}}
@fragment fn fs(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {{
    if {condition} {{ discard; }}
    return vec4(at.x / 64.0, 0.5, 0.25, 1.0) * object.tint;
}}"
    );
    let there = Mat4::from_translation(Vec3::new(0.0, 0.0, 0.5));
    let drawn = draw("square", there, [1.0; 4]);
    scene([32, 32], vec![material("leaf", &source)], vec![drawn])
}

/// An override or a uniform makes the discard impossible: no fragment is asked for that takes it.
#[test]
fn a_discard_that_the_values_make_impossible_is_not_asked_for() {
    let texel = "textureLoad(map, vec2<i32>(at.xy), 0).a";
    let told = |condition: &str, format: Option<wgpu::TextureFormat>| {
        let mut scene = discarding_scene(condition);
        if let Some(format) = format {
            let size = usize::from(format == wgpu::TextureFormat::Rgba32Float) * 12 + 4;
            let image = Arc::new(scene::Image {
                size: [1, 1],
                layers: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                levels: vec![vec![0; size]],
            });
            let textures = &mut scene.materials[0].textures;
            textures.insert("map".to_owned(), image);
        }
        let variant = made_by(&scene, "depth-prepass");
        let report = run(&scene, variant);
        let is_told = |list: &[String]| list.iter().any(|w| w.contains("its discard is untested"));
        assert!(!is_told(&report.warnings), "{:?}", report.warnings);
        is_told(&report.untested)
    };
    let unorm = Some(wgpu::TextureFormat::Rgba8Unorm);
    let float = Some(wgpu::TextureFormat::Rgba32Float);
    let cases = [
        ("object.tint.a < CUT", None, false),
        ("object.tint.a < CUT + 0.5", None, false),
        // The texture is made up: a real one may have any texel.
        ("TEXEL < CUT", None, true),
        ("TEXEL < CUT", unorm, false),
        ("TEXEL < CUT - 0.5", unorm, false),
        ("TEXEL - 0.5 > object.tint.r", unorm, false),
        // All texels of this one are 0, and another's need not be.
        ("TEXEL > 0.5", unorm, true),
        ("TEXEL < CUT", float, true),
    ];
    for (condition, format, expected) in cases {
        let condition = condition.replace("TEXEL", texel);
        assert_eq!(
            told(&condition, format),
            expected,
            "{condition}, {format:?}"
        );
    }
}

#[test]
fn a_discard_that_no_fragment_takes_is_untested() {
    let untested =
        ["no fragment of `leaf` is discarded in any view, so that its discard is untested"];
    let prepass = discarding("at.x < 0.0", "depth-prepass");
    assert_eq!(prepass.untested, untested);
    assert_eq!(prepass.variants[1].verdict, Verdict::Holds);
    let tested = discarding("fract(at.x / 2.0) < 0.5", "depth-prepass");
    assert_eq!(tested.untested, [""; 0]);
    // A variant that leaves the discard alone needs no fragment that takes it.
    let kept = discarding("at.x < 0.0", "hoist");
    assert_eq!(kept.untested, [""; 0]);
    assert!(
        kept.warnings.contains(&untested[0].to_owned()),
        "{:?}",
        kept.warnings
    );
}

/// Leaves that do not tie in a made-up scene may tie in the real one.
#[test]
fn a_made_up_scene_without_ties_does_not_remove_a_discard() {
    use preshade_compiler::front::{self, Source};
    use preshade_scenes::synthesise;
    let text = include_str!("../app/shaders/leaf.wgsl");
    let parsed = front::parse(
        &[Source::new("leaf.wgsl", text)],
        &options::Options::default(),
    );
    let scene = synthesise(parsed.unwrap(), MaterialState::default()).resized([64, 36]);
    let facts = measure::facts(&Session::new(gpu(), &scene, ShaderForm::Text).unwrap()).unwrap();
    assert_ne!(facts.depth_ties, Some(0));
    assert_ne!(facts.undiscarded_depth_ties, Some(0));
    assert_ne!(facts.near_plane_pixels, Some(0));
    let recipe = Recipe::parse(["depth-prepass:form=equal"]).unwrap();
    // Without a tie at all: what does not remove the discard is the made-up scene.
    let facts = Facts {
        depth_ties: None,
        ..facts
    };
    let variant = measure::variant(&originals(&scene), &recipe, &facts);
    let main = variant.plans[0].main().unwrap();
    let wgsl = variant.plans[0].program(main).unwrap();
    let body = &wgsl.entry_point(
        naga::ShaderStage::Fragment,
        main.fragment.as_deref().unwrap(),
    );
    let body = format!("{:?}", body.unwrap().1.function.body);
    assert_eq!(variant.plans[0].passes.len(), 2, "{:?}", variant.kept);
    assert!(body.contains("Kill"), "{body}");
}

/// Two planes side by side: `left` is promised within a budget, `right` exactly. Whatever the budget
/// allows in all, what is seen of `right` keeps its bits.
#[test]
fn each_material_is_held_to_its_own_promise() {
    let mut scene = scene_of_two();
    let approximate = Contract::Approximate {
        budget: Budget {
            metric: Metric::FlipMean,
            limit: 0.9,
        },
        given: Vec::new(),
    };
    let tinted = |plan: &Plan, value: &str| {
        let text = FLAT.replace("return object.tint;", &format!("return {value};"));
        let mut changed = plan.clone();
        let of = changed.programs.values_mut();
        of.for_each(|of| *of = program(&text));
        changed
    };
    let slightly = "object.tint + vec4(0.1)";
    for samples in [1, 4] {
        scene = with_samples(scene, samples);
        let originals = originals(&scene);
        let verdict = |left: &str, right: &str| {
            let mut plans = vec![tinted(&originals[0], left), tinted(&originals[1], right)];
            plans[0].contract = approximate.clone();
            let report = run(&scene, variant_of(plans));
            report.variants[1].verdict.clone()
        };
        assert_eq!(verdict(slightly, "object.tint"), Verdict::Holds);
        assert_eq!(verdict("object.tint", "object.tint"), Verdict::Holds);
        for left in [slightly, "object.tint"] {
            let broken = verdict(left, slightly);
            assert!(
                matches!(&broken, Verdict::Broken { r#where } if r#where.contains("`right`, whose own promise is `exact`")),
                "{broken:?}"
            );
        }
    }
}

/// Depths have the original's bits under every promise whose positions stay.
#[test]
fn no_budget_allows_another_depth() {
    let scene = scene_of_two();
    let mut plans = originals(&scene);
    for plan in &mut plans {
        plan.contract = Contract::Approximate {
            budget: Budget::max_abs(0.9),
            given: Vec::new(),
        };
        plan.passes[0].depth.as_mut().unwrap().write = false;
    }
    let report = run(&scene, variant_of(plans));
    let verdict = &report.variants[1].verdict;
    assert!(
        matches!(verdict, Verdict::Broken { r#where } if r#where.contains("which no budget allows")),
        "{verdict:?}"
    );
}

/// Two squares side by side, each of its own material.
fn scene_of_two() -> Scene {
    let at = |x: f32| Mat4::from_translation(Vec3::new(x, 0.0, 0.5));
    let half = Mat4::from_scale(Vec3::new(0.5, 1.0, 1.0));
    let mut draws = vec![
        draw("left", at(-0.5) * half, [0.3; 4]),
        draw("right", at(0.5) * half, [0.6; 4]),
    ];
    draws[1].material = 1;
    let materials = ["left", "right"].map(|name| material(name, FLAT));
    crate::render_support::scene([32, 32], materials.into(), draws)
}

fn variant_of(plans: Vec<Plan>) -> Variant {
    Variant {
        name: "planted".to_owned(),
        recipe: "planted".to_owned(),
        plans,
        kept: Vec::new(),
    }
}
