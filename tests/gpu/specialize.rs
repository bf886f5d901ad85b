//! What specialising promises, drawn: nothing changes, and where a value is not as assumed the
//! host's fallback is.

use std::path::Path;

use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_dataflow::graph::Graph;
use preshade_draw::render::{FrameSettings, Prepared, Rendered, SceneInputs};
use preshade_draw::scene::bind::{self, BufferBinding};
use preshade_draw::scene::{Scene, Value};
use preshade_lab::measure::record::VariantReport;
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings};
use preshade_passes::transforms::specialize::SpecializeParams;
use preshade_passes::transforms::specialize::dispatch::Dispatch;
use preshade_plan::contract::Verdict;
use preshade_plan::guard::Assumed;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::{PlanFile, Target};
use preshade_scenes::ShaderForm;
use shader_text::options::Options;

use crate::render_support::gpu;

fn scene(name: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/scenes")
        .join(format!("{name}.toml"));
    preshade_scenes::load(&path).unwrap().resized([160, 90])
}

fn museum() -> Scene {
    let mut scene = scene("museum");
    for camera in &mut scene.cameras {
        let frames = camera.frames.len();
        camera.frames = vec![camera.frames[0], camera.frames[frames / 2]];
        camera.frames.truncate(frames);
    }
    scene.orders.truncate(1);
    scene
}

fn facts(scene: &Scene) -> Facts {
    Facts {
        constants: measure::constants(scene).unwrap(),
        ..Facts::without_ties()
    }
}

fn specialized(scene: &Scene, recipe: &str) -> measure::Variant {
    let recipe = Recipe::parse_list(recipe).unwrap();
    measure::variant(&measure::originals(scene), &recipe, &facts(scene))
}

fn verified(scene: &Scene, variant: measure::Variant) -> VariantReport {
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 2,
        command: String::new(),
    };
    let outcome = measure::verify(
        &Session::new(gpu(), scene, ShaderForm::Text).unwrap(),
        &[variant],
        &settings,
        &mut |_| {},
    )
    .unwrap();
    outcome.report.variants.into_iter().nth(1).unwrap()
}

fn drawn(scene: &Scene, plans: &[Plan]) -> Rendered {
    let inputs = SceneInputs::new(gpu(), scene).unwrap();
    let variant = preshade_scenes::variant(plans, ShaderForm::Text).unwrap();
    let settings = FrameSettings::of(scene);
    Prepared::new(&inputs, &variant, &settings)
        .unwrap()
        .render()
        .unwrap()
}

/// Eight kinds of exhibit, a version each, and the picture of the one material that can do
/// everything.
#[test]
fn a_museum_takes_eight_versions_and_changes_no_pixel() {
    let whole = museum();
    let scene =
        measure::grouped(&whole, &SpecializeParams::default(), measure::MOST_GROUPS).unwrap();
    assert_eq!(scene.materials.len(), 8);
    let rows = |s: &Scene| s.draws.iter().map(|d| d.name.clone()).collect::<Vec<_>>();
    assert_eq!(rows(&scene), rows(&whole));
    for alone in ["specialize", "specialize,depth-prepass"] {
        let report = verified(&scene, specialized(&scene, alone));
        assert_eq!(report.verdict, Verdict::Holds, "{alone}: {:?}", report.kept);
        assert!(report.kept.is_empty(), "{alone}: {:?}", report.kept);
        let error = report.error.unwrap();
        assert_eq!(error.changed_pixels, 0, "{alone}");
        assert_eq!(error.changed_depth, 0, "{alone}");
    }
    let (before, after) = (
        drawn(&whole, &measure::originals(&whole)),
        drawn(&scene, &specialized(&scene, "specialize").plans),
    );
    assert_eq!(before, after);
}

/// A host that looks at a draw's values alone takes the version that was made for the draw.
#[test]
fn a_draw_finds_its_version() {
    let mut scene = museum();
    scene = measure::grouped(&scene, &SpecializeParams::default(), measure::MOST_GROUPS).unwrap();
    let frame = scene.cameras[0].frames[0];
    let (plans, originals) = (
        specialized(&scene, "specialize").plans,
        measure::originals(&scene),
    );
    let plans: Vec<&Plan> = plans.iter().collect();
    let found = measure::versions(&scene, &plans);
    let [versions] = &found[..] else {
        panic!("{found:?}");
    };
    assert_eq!(
        (versions.material.as_str(), versions.versions.len()),
        ("museum", 8)
    );
    let costs = versions.versions.windows(2);
    assert!(
        costs
            .into_iter()
            .all(|v| v[0].operations <= v[1].operations)
    );
    let mut dispatch = Dispatch::new(versions.clone());
    for (index, draw) in scene.draws.iter().enumerate() {
        let (material, pass) = (
            &scene.materials[draw.material],
            originals[draw.material].main().unwrap(),
        );
        let bound = bind::uniform_buffers(&scene, material, pass, draw, &frame).unwrap();
        let bytes = |group, binding| {
            let at = |b: &&BufferBinding| (b.group, b.binding) == (group, binding);
            bound.iter().find(at).map(|b| &b.data.bytes[..])
        };
        let mut own = versions.versions.iter();
        let own = own.find(|v| v.draws.contains(&index)).unwrap();
        let is_kept = |value: &Assumed| own.guard.values.contains(value);
        let chosen = dispatch.choose(bytes, is_kept).unwrap();
        assert_eq!(chosen.name, own.name, "{}", draw.name);
    }
}

/// What is left of a material goes through every other pass, and keeps what both promise; what
/// cannot stand together is refused by name.
#[test]
fn other_passes_work_on_what_is_left() {
    let mut scene = museum();
    let kinds = ["banner", "puppet", "bronze"];
    scene
        .draws
        .retain(|d| kinds.iter().any(|k| d.name.starts_with(k)));
    scene.cameras.truncate(1);
    scene.cameras[0].frames.truncate(1);
    let scene =
        measure::grouped(&scene, &SpecializeParams::default(), measure::MOST_GROUPS).unwrap();
    assert_eq!(scene.materials.len(), 3);
    let bits = [
        "specialize,depth-prepass:form=equal",
        "specialize,early-discard",
    ];
    let within = [
        "specialize,visibility-buffer:budget=0.05",
        "specialize,hoist:budget=0.05,finite=assumed,jumps=carried",
        "specialize,hoist:budget=0.05,finite=assumed,jumps=carried,depth-prepass",
    ];
    for recipe in bits.into_iter().chain(within) {
        let variant = specialized(&scene, recipe);
        for plan in variant.plans.iter().filter(|p| !p.steps.is_empty()) {
            let guard = plan.guard.as_ref();
            assert!(guard.is_some_and(|g| !g.values.is_empty()), "{recipe}");
            assert!(plan.fallback.is_some(), "{recipe}");
        }
        let report = verified(&scene, variant);
        assert_eq!(report.verdict, Verdict::Holds, "{recipe}");
        // Some of them have nothing that is worth carrying.
        let refused = |why: &str| why.contains("hoist[");
        assert!(report.kept.len() < 3, "{recipe}: {:?}", report.kept);
        let mut kept = report.kept.iter();
        assert!(kept.all(|k| refused(&k.why)), "{recipe}: {:?}", report.kept);
        let error = report.error.unwrap();
        assert_eq!(error.changed_depth, 0, "{recipe}");
        if bits.contains(&recipe) {
            // Nothing is fused here, so that nothing is fused otherwise.
            assert_eq!(error.changed_pixels, 0, "{recipe}");
        }
    }
    let why = |recipe: &str| {
        let report = verified(&scene, specialized(&scene, recipe));
        assert_eq!(report.kept.len(), 3, "{recipe}");
        report.kept[0].why.clone()
    };
    assert!(why("specialize,hoist").contains("hoist[nothing-pays]"));
    assert!(why("depth-prepass,specialize").contains("specialize[not-first]"));
}

/// naga's GLSL front end has statements evaluate the initial values of locals. They are kept,
/// whatever rewrites the function: three.js's tone mapping turned black without them.
#[test]
fn initial_values_of_glsl_locals_stay() {
    let vertex = "#version 450
        layout(location = 0) in vec3 position;
        void main() { gl_Position = vec4(position, 1.0); }";
    let fragment = "#version 450
        layout(binding = 0) uniform Fog { float density; float weight; } fog;
        layout(binding = 1) uniform texture2D map;
        layout(binding = 2) uniform sampler map_sampler;
        layout(location = 0) out vec4 color;
        vec3 graded(vec3 c) {
            const mat3 grade = mat3(vec3(0.59719, 0.07600, 0.02840), vec3(0.35458, 0.90834, \
                0.13383), vec3(0.04823, 0.01566, 0.83777));
            if (fog.density > 0.0) { c = mix(c, vec3(0.5), fog.density); }
            return grade * c + fog.weight * textureLod(sampler2D(map, map_sampler), c.xy, 0.0).rgb;
        }
        void main() { color = vec4(graded(gl_FragCoord.xyz), 1.0); }";
    let sources = [
        Source::new("grade.vert", vertex),
        Source::new("grade.frag", fragment),
    ];
    let parsed = front::parse(&sources, &Options::default()).unwrap();
    let (fragment, state) = (parsed.fragment.as_deref(), Default::default());
    let original = Plan::original("grade", parsed.program, &parsed.vertex, fragment, &state);
    let options = emit::Options::default();
    for recipe in ["specialize:set=density=0", "skip-taps:budget=0.1"] {
        let recipe = Recipe::parse_list(recipe).unwrap();
        let plan = recipe.apply(&original, &Facts::default()).unwrap();
        let files = emit::emit(&plan, &[Target::Wgsl], &options).unwrap();
        let main = files.iter().find(|f| f.name == "grade.main.wgsl").unwrap();
        let text = String::from_utf8(main.bytes.clone()).unwrap();
        assert!(text.contains("0.59719f"), "{recipe}\n{text}");
    }
}

#[test]
fn at_most_so_many_versions_are_made() {
    let scene = museum();
    let few = measure::grouped(&scene, &SpecializeParams::default(), 3).unwrap();
    assert_eq!(few.materials.len(), 3);
    let variant = specialized(&few, "specialize");
    let report = verified(&few, variant);
    assert_eq!(report.verdict, Verdict::Holds);
    assert_eq!(report.error.unwrap().changed_pixels, 0);
}

/// Fog comes up behind the back of a variant that was made without: the variant is wrong, its guard
/// says so, and what is drawn is the original.
#[test]
fn a_violated_guard_takes_the_original() {
    let clear = measure::grouped(
        &museum(),
        &SpecializeParams::default(),
        measure::MOST_GROUPS,
    )
    .unwrap();
    let variant = specialized(&clear, "specialize");
    let mut foggy = clear.clone();
    for draw in &mut foggy.draws {
        let fog = Value::Numbers(vec![0.2]);
        draw.values.insert("hall.fog_density".to_owned(), fog);
    }
    let original = drawn(&foggy, &measure::originals(&foggy));
    assert_ne!(
        drawn(&foggy, &variant.plans),
        original,
        "the guard is needed"
    );
    let inputs = SceneInputs::new(gpu(), &foggy).unwrap();
    let frame = &foggy.cameras[0].frames[0];
    let violated = inputs.violated(&variant.plans, frame).unwrap();
    // Slab, banner and jelly are foggy already, with another density.
    assert_eq!(violated.len(), 8);
    assert!(violated.iter().all(|(_, a)| a.name == "hall.fog_density"));
    let report = verified(&foggy, variant);
    assert_eq!(report.kept.len(), 8);
    assert!(report.kept[0].why.contains("hall.fog_density"));
    assert_eq!(report.error.unwrap().changed_pixels, 0);
}

/// A host has the guard, and the original that it falls back to, in `plan.json`, whatever comes on
/// top.
#[test]
fn the_guard_travels_with_the_plan() {
    let scene = measure::grouped(
        &museum(),
        &SpecializeParams::default(),
        measure::MOST_GROUPS,
    )
    .unwrap();
    for recipe in ["specialize", "specialize,depth-prepass:form=equal"] {
        for plan in specialized(&scene, recipe).plans {
            let options = emit::Options::default();
            let files = emit::emit(&plan, &[Target::Wgsl], &options).unwrap();
            let json = files
                .iter()
                .find(|f| f.name.ends_with(".plan.json"))
                .unwrap();
            let read: PlanFile = serde_json::from_slice(&json.bytes).unwrap();
            let guard = read.plan.guard.clone().unwrap();
            assert!(!guard.values.is_empty());
            assert_eq!(Some(guard), plan.guard);
            assert!(read.original.is_some(), "{recipe}");
        }
    }
}

/// Scenes of which some material has a branch, a loop or a selection that its own values decide.
#[test]
fn other_scenes_keep_their_pixels() {
    for name in ["gallery", "glsl"] {
        let scene = scene(name);
        let report = verified(&scene, specialized(&scene, "specialize"));
        assert_eq!(report.verdict, Verdict::Holds, "{name}");
        let error = report.error.unwrap();
        assert_eq!(error.changed_pixels, 0, "{name}");
        assert_eq!(error.changed_depth, 0, "{name}");
    }
}

/// Ten effects, named, each called for by as many draws as the scene file says.
#[test]
fn effects_are_found_and_counted() {
    let used = measure::effects(&museum()).unwrap();
    let found: Vec<(&str, usize)> = used
        .iter()
        .map(|e| {
            assert_eq!(e.called_for + e.not_called_for, 40, "{}", e.name);
            assert!(e.evidence.iter().all(|e| !e.is_empty()), "{}", e.name);
            (e.name.as_str(), e.called_for)
        })
        .collect();
    let mut found = found;
    found.sort_unstable();
    let expected = [
        ("alpha test", 5),
        ("clear coat", 10),
        ("emissive", 10),
        ("fog", 15),
        ("light loop", 15),
        ("morph targets", 5),
        ("normal mapping", 15),
        ("parallax", 5),
        ("shadows", 15),
        ("skinning", 5),
    ];
    assert_eq!(found, expected);
}

/// What a person makes of the museum for a kind of exhibit, frozen before there was a generator:
/// the same picture, and no fewer operations.
#[test]
fn hand_specialised_exhibits_are_matched() {
    let whole = museum();
    for kind in ["plinth", "bronze", "banner", "puppet"] {
        let mut scene = whole.clone();
        scene.draws.retain(|d| d.name.starts_with(kind));
        assert_eq!(scene.draws.len(), 5);
        let material = &scene.materials[0];
        let path = format!("fixtures/handwritten/museum-{kind}.wgsl");
        let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path));
        let source = Source::new(format!("{kind}.wgsl"), text.unwrap());
        let parsed = front::parse(&[source], &Options::default()).unwrap();
        let (name, fragment) = (&material.name, parsed.fragment.as_deref());
        let (program, vertex) = (parsed.program, &parsed.vertex);
        let hand = Plan::original(name, program, vertex, fragment, &material.state);
        let generated = specialized(&scene, "specialize").plans.remove(0);
        let original = drawn(&scene, &measure::originals(&scene));
        assert_eq!(
            drawn(&scene, std::slice::from_ref(&hand)),
            original,
            "{kind}"
        );
        assert_eq!(
            drawn(&scene, std::slice::from_ref(&generated)),
            original,
            "{kind}"
        );
        let [by_hand, ours] = [&hand, &generated].map(|plan| {
            let pass = plan.main().unwrap();
            let program = plan.program(pass).unwrap();
            let graph = Graph::build(program);
            let stages = [
                (naga::ShaderStage::Vertex, Some(pass.vertex.as_str())),
                (naga::ShaderStage::Fragment, pass.fragment.as_deref()),
            ];
            stages.map(|(stage, name)| {
                let (entry, _) = program.entry_point(stage, name.unwrap()).unwrap();
                graph.entry_cost(entry)
            })
        });
        for (ours, by_hand) in ours.into_iter().zip(by_hand) {
            assert!(
                ours <= by_hand / 0.95,
                "{kind}: {ours} ops, by hand {by_hand}"
            );
        }
        let used = |plan: &Plan| {
            let pass = plan.main().unwrap();
            let bindings = pass.bindings.iter().map(|b| b.name.clone());
            let attributes = pass.attributes.iter().map(|a| a.name.clone());
            bindings.chain(attributes).collect::<Vec<_>>()
        };
        assert_eq!(used(&generated), used(&hand), "{kind}");
    }
}
