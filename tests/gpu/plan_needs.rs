//! What a plan says it needs of a device is enough: a device with WebGPU's default limits, raised
//! to what the emitted plans say, and with the features they name and no other, draws what they
//! describe without an error. `plan_is_enough.rs` is the converse: nothing of a plan is said in
//! vain.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{AdapterChoice, Error, FrameSettings, Gpu, Prepared, SceneInputs};
use preshade_draw::scene::{DrawOrder, Scene};
use preshade_lab::measure;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::{PlanFile, Target};
use preshade_plan::state::{ColorTarget, MaterialState};
use preshade_scenes::ShaderForm;
use preshade_scenes::synthesise;
use shader_text::options;

use crate::interfaces::{interfaces, varied};

fn load(name: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/scenes")
        .join(name);
    let scene = preshade_scenes::load(&path).unwrap_or_else(|e| panic!("{}", e.render()));
    scene.resized([97, 61])
}

/// What the emitted plans say they need.
#[derive(Debug, Default, PartialEq)]
struct Needs {
    features: BTreeSet<String>,
    limits: BTreeMap<String, u64>,
}

fn needs(plans: &[Plan]) -> Needs {
    let mut needs = Needs::default();
    for plan in plans {
        let files = emit::emit(plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
        let json = files
            .iter()
            .find(|f| f.name.ends_with(".plan.json"))
            .unwrap();
        let file: PlanFile = serde_json::from_slice(&json.bytes).unwrap();
        let compute = file.plan.compute.into_iter();
        let compute = compute.map(|pass| (pass.features, pass.limits));
        let render = file.plan.passes.into_iter();
        let render = render.map(|pass| (pass.features, pass.limits));
        for (features, limits) in compute.chain(render) {
            needs.features.extend(features);
            for (name, value) in limits {
                let most = needs.limits.entry(name).or_default();
                *most = value.max(*most);
            }
        }
    }
    needs
}

fn recipe(scene: &Scene, steps: &[&str]) -> Vec<Plan> {
    let originals = measure::originals(scene);
    let recipe = Recipe::parse(steps).unwrap();
    measure::variant(&originals, &recipe, &Facts::without_ties()).plans
}

/// One frame, on a device with `needs` and no more.
fn draw(scene: &Scene, plans: &[Plan], needs: &Needs) -> Result<(), Error> {
    let gpu = Gpu::with_needs(&AdapterChoice::Best, &needs.features, &needs.limits)?;
    let inputs = SceneInputs::new(&gpu, scene)?;
    let variant = preshade_scenes::variant(plans, ShaderForm::Text)?;
    let mut prepared = Prepared::new(&inputs, &variant, &FrameSettings::of(scene))?;
    let (_, frame) = scene.frames().next().unwrap();
    inputs.set_frame(frame)?;
    prepared.aim(frame, DrawOrder::AsGiven);
    prepared.render()?;
    Ok(())
}

#[test]
fn a_device_with_what_the_plans_name_and_no_more_draws_them() {
    let smooth = "hoist:budget=1,finite=assumed,jumps=carried";
    for (scene, steps) in [
        ("simple.toml", &["depth-prepass"][..]),
        ("simple.toml", &["early-discard"]),
        ("gbuffer.toml", &["depth-prepass:form=equal"]),
        ("frag-depth.toml", &["early-discard:texture=packed"]),
        ("vertex-pulling.toml", &["depth-prepass"]),
        ("instanced.toml", &["early-discard:attachment=readonly"]),
        ("alpha-coverage.toml", &["depth-prepass"]),
        ("teapot-noise.toml", &[smooth, "tessellate:level=2"]),
        (
            "teapot-noise.toml",
            &[smooth, "tessellate:level=2,form=shared"],
        ),
        (
            "teapot-noise.toml",
            &[smooth, "tessellate:level=4,edge-pixels=9"],
        ),
    ] {
        let scene_ = load(scene);
        let plans = recipe(&scene_, steps);
        assert!(
            plans.iter().any(|p| !p.steps.is_empty()),
            "{scene}: {steps:?}"
        );
        let needs = needs(&plans);
        draw(&scene_, &plans, &needs)
            .unwrap_or_else(|e| panic!("{scene}: {steps:?} with {needs:?}: {e}"));
    }
}

/// The pipelines have explicit layouts, from the plans alone.
#[test]
fn the_layouts_of_plans_serve_two_variables_at_one_binding() {
    let text = include_str!("../materials/shared-binding.wgsl");
    let source = Source::new("shared-binding.wgsl", text);
    let parsed = front::parse(&[source], &options::Options::default()).unwrap();
    let scene = synthesise(parsed, MaterialState::default()).resized([97, 61]);
    for steps in [
        &[][..],
        &["depth-prepass"],
        &["depth-prepass:form=equal"],
        &["early-discard"],
    ] {
        let plans = recipe(&scene, steps);
        let applied = plans.iter().all(|p| p.steps.len() == steps.len());
        assert!(applied, "{steps:?}");
        let drawn = draw(&scene, &plans, &needs(&plans));
        drawn.unwrap_or_else(|e| panic!("{steps:?}: {e}"));
    }
}

/// So do those of every builtin, interpolation, resource, target and state, in some recipe.
#[test]
fn the_layouts_of_plans_serve_every_interface() {
    let (mut drawn, mut lacking, mut wrong) = (BTreeSet::new(), BTreeSet::new(), Vec::new());
    // Every seventh: a scene and a device each.
    for interface in interfaces(1, 0).iter().step_by(7) {
        let scene = synthesise(interface.parsed(), interface.state()).resized([33, 21]);
        let original = measure::originals(&scene).remove(0);
        let plans = match varied(interface.recipe(), &original) {
            Ok(plan) => [plan],
            Err(_) => continue,
        };
        match draw(&scene, &plans, &needs(&plans)) {
            Ok(()) => drawn.extend(interface.names()),
            Err(Error::Unsupported { feature, .. }) => {
                lacking.insert(feature);
            }
            // No device with such a feature, and no scene with immediate data or storage textures.
            Err(e) if e.to_string().contains("Unsupported features") => {
                lacking.insert(e.to_string());
            }
            Err(e) if e.to_string().contains("immediate data") => {
                lacking.insert("immediate data".to_owned());
            }
            Err(e) if e.to_string().contains("binds a storage texture") => {
                lacking.insert("storage textures".to_owned());
            }
            Err(e) => wrong.push(format!(
                "{:?}: {e}\n{}",
                interface.names(),
                interface.text()
            )),
        }
    }
    println!("drawn: {drawn:?}, lacking: {lacking:?}");
    assert!(
        wrong.is_empty(),
        "{} are wrong:\n{}",
        wrong.len(),
        wrong.join("\n\n")
    );
    assert!(drawn.len() > 60, "{drawn:?}");
}

/// Three targets of sixteen bytes, and depth clipping off: more than every device has.
#[test]
fn a_device_with_less_than_that_does_not() {
    let mut scene = load("gbuffer.toml");
    let material = &mut scene.materials[0].state;
    material.targets = vec![Some(ColorTarget::opaque("rgba32float")); 3];
    material.primitive.unclipped_depth = true;
    let plans = recipe(&scene, &["depth-prepass"]);
    let needs = needs(&plans);
    let limit = "maxColorAttachmentBytesPerSample".to_owned();
    let expected = Needs {
        features: BTreeSet::from(["depth-clip-control".to_owned()]),
        limits: BTreeMap::from([(limit, 48)]),
    };
    assert_eq!(needs, expected);
    draw(&scene, &plans, &needs).unwrap();
    let poorer = [
        Needs {
            features: BTreeSet::new(),
            limits: needs.limits.clone(),
        },
        Needs {
            features: needs.features.clone(),
            limits: BTreeMap::new(),
        },
    ];
    for needs in poorer {
        let error = draw(&scene, &plans, &needs).unwrap_err();
        assert!(
            matches!(error, Error::Unsupported { .. }),
            "{needs:?}: {error}"
        );
    }
}
