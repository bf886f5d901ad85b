//! The promise of an `exact` contract, kept or broken: every scene, every depth set-up, drawn as written and as each variant, compared bit by bit.
#![cfg(feature = "verify")]
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

use preshade::measure::{self, CountProgram, ErrorLadder};
use preshade::passes::contract::Contract;
use preshade::passes::pass::Facts;
use preshade::passes::plan::{GpuPass, Plan};
use preshade::recipe::Recipe;
use preshade::render::{
    AdapterChoice, FrameSettings, Gpu, Prepared, Rendered, SceneInputs, ShaderForm, Variant,
};
use preshade::scene::{DrawOrder, Scene};

const BIASED: &str = "depth-prepass";
const EQUAL: &str = "depth-prepass:form=equal";
const EQUAL_SLICED: &str = "depth-prepass:form=equal,vertex=sliced";
const VOTE: &str = "early-discard";

fn count(plan: &Plan, pass: &GpuPass) -> CountProgram {
    CountProgram::Sliced {
        program: preshade::passes::count::program(plan, pass).unwrap(),
        vertex: pass.vertex.clone(),
        fragment: preshade::passes::count::ENTRY.to_owned(),
    }
}

/// The recipe on every material that takes it; the others stay as they are.
fn apply(originals: &[Plan], recipe: &str, facts: &Facts) -> Vec<Plan> {
    let recipe = Recipe::parse([recipe]).unwrap();
    originals
        .iter()
        .map(|p| recipe.apply(p, facts).unwrap_or_else(|_| p.clone()))
        .collect()
}

fn draw_all(
    inputs: &SceneInputs<'_>,
    scene: &Scene,
    plans: &[Plan],
    form: ShaderForm,
) -> Vec<Rendered> {
    let variant = Variant::new(plans, form).unwrap();
    let mut prepared = Prepared::new(inputs, &variant, &FrameSettings::of(scene)).unwrap();
    let mut pictures = Vec::new();
    for (_, frame) in scene.frames() {
        inputs.set_frame(frame).unwrap();
        for order in [
            DrawOrder::BackToFront,
            DrawOrder::Shuffled,
            DrawOrder::FrontToBack,
        ] {
            prepared.aim(frame, order);
            pictures.push(prepared.render().unwrap());
        }
    }
    pictures
}

fn worst(original: &[Rendered], variant: &[Rendered]) -> ErrorLadder {
    original
        .iter()
        .zip(variant)
        .map(|(o, v)| measure::compare(o, v).unwrap())
        .fold(ErrorLadder::default(), |a, b| a.worst(&b))
}

#[test]
fn probe() {
    let gpu = Gpu::new(&AdapterChoice::Best).unwrap();
    let path = std::env::var("SCENE").unwrap_or_else(|_| "fixtures/scenes/simple.toml".to_owned());
    let scene = preshade::scene::load(std::path::Path::new(&path)).unwrap();
    let inputs = SceneInputs::new(&gpu, &scene).unwrap();
    let originals = measure::originals(&scene);
    let facts = measure::facts(&gpu, &scene, ShaderForm::Text, count).unwrap();
    println!("ties {facts:?}");
    let reference = draw_all(&inputs, &scene, &originals, ShaderForm::Text);
    for recipe in [
        BIASED,
        EQUAL,
        EQUAL_SLICED,
        VOTE,
        "early-discard:attachment=readonly",
    ] {
        let plans = apply(&originals, recipe, &facts);
        let contracts: Vec<&Contract> = plans.iter().map(|p| &p.contract).collect();
        let pictures = draw_all(&inputs, &scene, &plans, ShaderForm::Text);
        println!(
            "{recipe}: {:?}\n  {contracts:?}",
            worst(&reference, &pictures)
        );
    }
}
