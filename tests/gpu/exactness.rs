//! The promise of an `exact` contract, kept or broken: every scene, under every depth set-up, drawn
//! as written and as each variant, compared bit by bit.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{AdapterChoice, FrameSettings, Gpu, Prepared, Rendered, SceneInputs};
use preshade_draw::scene::{DrawOrder, Scene};
use preshade_geometry::examples;
use preshade_lab::measure::{self, ErrorLadder, Session};
use preshade_plan::contract::Contract;
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan::Plan;
use preshade_plan::state::{DepthBias, DepthDirection, DepthFormat};
use preshade_scenes::ShaderForm;

/// Sorted both ways, and as an unsorted host draws.
const ORDERS: [DrawOrder; 3] = [
    DrawOrder::BackToFront,
    DrawOrder::FrontToBack,
    DrawOrder::AsGiven,
];

/// Small enough for a software rasteriser; not a multiple of the quad or of any tile.
const SIZE: [u32; 2] = [163, 91];

fn scenes() -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> =
        std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scenes"))
            .unwrap()
            .map(|e| e.unwrap().path())
            .filter(|p| p.extension().is_some_and(|e| e == "toml"))
            .collect();
    found.sort();
    assert!(found.len() > 20);
    found
}

fn load(name: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/scenes")
        .join(name);
    small(preshade_scenes::load(&path).unwrap_or_else(|e| panic!("{}", e.render())))
}

/// The scene at [`SIZE`], with the first frame of each camera and one from the middle of each path.
fn small(scene: Scene) -> Scene {
    let mut scene = scene.resized(SIZE);
    for camera in &mut scene.cameras {
        let middle = camera.frames.len() / 2;
        camera.frames = if middle == 0 {
            vec![camera.frames[0]]
        } else {
            vec![camera.frames[0], camera.frames[middle]]
        };
    }
    scene
}

fn pictures(
    inputs: &SceneInputs<'_>,
    scene: &Scene,
    plans: &[Plan],
    form: ShaderForm,
) -> Vec<Rendered> {
    let variant = preshade_scenes::variant(plans, form).unwrap();
    let mut prepared = Prepared::new(inputs, &variant, &FrameSettings::of(scene)).unwrap();
    let mut pictures = Vec::new();
    for (_, frame) in scene.frames() {
        inputs.set_frame(frame).unwrap();
        for order in ORDERS {
            prepared.aim(frame, order);
            pictures.push(prepared.render().unwrap());
        }
    }
    pictures
}

fn worst(original: &[Rendered], variant: &[Rendered]) -> ErrorLadder {
    assert_eq!(original.len(), variant.len());
    let compare = |(o, v)| measure::compare(o, v).unwrap();
    original
        .iter()
        .zip(variant)
        .map(compare)
        .fold(ErrorLadder::default(), |a, b| a.worst(&b))
}

/// Draws `scene` as written and as every recipe, and says what is not as promised.
fn broken(gpu: &Gpu, label: &str, scene: &Scene, form: ShaderForm) -> Vec<String> {
    let inputs = SceneInputs::new(gpu, scene).unwrap();
    let originals = measure::originals(scene);
    let facts = measure::facts(&Session::new(gpu, scene, ShaderForm::Text).unwrap()).unwrap();
    let ties = facts.depth_ties.unwrap();
    let reference = pictures(&inputs, scene, &originals, form);
    assert!(
        reference
            .iter()
            .flat_map(|r| &r.colors)
            .flatten()
            .any(|c| c.bytes.chunks(4).any(|t| t != &c.bytes[..4])),
        "{label} draws nothing"
    );
    let mut wrong = Vec::new();
    let exact = [Use::Exact, Use::ExactWithoutTies, Use::ExactWhereApplied];
    for (recipe, used) in examples().filter(|(_, used)| exact.contains(used)) {
        let parsed = Recipe::parse_list(recipe).unwrap();
        let variant = measure::variant(&originals, &parsed, &facts);
        let transformed = variant.plans.iter().filter(|p| !p.steps.is_empty()).count();
        if ties > 0 && *used == Use::ExactWithoutTies {
            // Materials that compare with LessEqual tie harmlessly; the others must have refused,
            // by name.
            let named = variant.kept.iter().any(|k| k.why.contains("depth-ties"));
            if !named {
                wrong.push(format!("{label}: {recipe} did not refuse {ties} ties"));
            }
            continue;
        }
        if transformed == 0 && *used == Use::ExactWhereApplied {
            continue;
        }
        if transformed == 0 {
            // What a shader writes as depth is neither read-only nor invariant, and some neighbours
            // forbid it; nothing else may keep every material of a fixture out.
            let expected = [
                "readonly-depth-writer",
                "depth-not-invariant",
                "neighbour-moves-depth",
                "neighbour-counts-fragments",
                // The neighbours themselves, in the scenes made of them.
                "stencil-write",
                "stencil-test",
                "fragment-store",
                "[compare]",
            ];
            // What three scenes are made for.
            let made_for = if label.starts_with("color-mask") {
                "[color-mask]"
            } else if label.starts_with("depth-bands") {
                "[biased-position]"
            } else if label.starts_with("deferred") {
                "[depth-write-off]"
            } else {
                "[]"
            };
            if !variant.kept.iter().all(|k| {
                expected.iter().any(|code| k.why.contains(code)) || k.why.contains(made_for)
            }) {
                wrong.push(format!(
                    "{label}: {recipe} applies to no material: {:?}",
                    variant.kept
                ));
            }
            continue;
        }
        for plan in variant.plans.iter().filter(|p| !p.steps.is_empty()) {
            assert!(
                matches!(plan.contract, Contract::Exact { .. }),
                "{label}: {recipe}"
            );
        }
        let error = worst(&reference, &pictures(&inputs, scene, &variant.plans, form));
        if !error.is_exact() {
            wrong.push(format!(
                "{label}: {recipe}: {} pixels, {} depths",
                error.changed_pixels, error.changed_depth
            ));
        }
    }
    wrong
}

/// Opened once: some drivers deadlock when many devices come and go in one process.
fn gpu() -> &'static Gpu {
    static GPU: OnceLock<Gpu> = OnceLock::new();
    GPU.get_or_init(|| Gpu::new(&AdapterChoice::Best).unwrap_or_else(|e| panic!("{e}")))
}

#[test]
fn every_scene_keeps_every_pixel_and_depth() {
    let gpu = gpu();
    let mut wrong = Vec::new();
    for path in scenes() {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        wrong.extend(broken(gpu, &name, &load(&name), ShaderForm::Text));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_original_with_invariant_position_is_kept_too() {
    let gpu = gpu();
    let mut wrong = Vec::new();
    for name in [
        "gallery.toml",
        "skinned.toml",
        "frag-depth.toml",
        "shrine.toml",
    ] {
        wrong.extend(broken(
            gpu,
            &format!("{name} @invariant"),
            &load(name).with_invariant_positions(),
            ShaderForm::Text,
        ));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_ir_draws_what_the_text_draws() {
    let gpu = gpu();
    let mut wrong = Vec::new();
    for name in ["gallery.toml", "frag-depth.toml"] {
        wrong.extend(broken(
            gpu,
            &format!("{name} ir"),
            &load(name),
            ShaderForm::Ir,
        ));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_depth_format_direction_and_sample_count() {
    let gpu = gpu();
    let mut wrong = Vec::new();
    for name in ["simple.toml", "atrium.toml"] {
        for format in [
            DepthFormat::Depth16unorm,
            DepthFormat::Depth24plus,
            DepthFormat::Depth32float,
        ] {
            for direction in [DepthDirection::Forward, DepthDirection::Reversed] {
                for samples in [1, 4] {
                    let scene = load(name)
                        .with_depth(format, direction)
                        .with_samples(samples);
                    let label = format!("{name} {format:?} {direction:?} x{samples}");
                    wrong.extend(broken(gpu, &label, &scene, ShaderForm::Text));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_viewport_offset_and_half_resolution() {
    let gpu = gpu();
    let mut wrong = Vec::new();
    for name in ["gallery.toml", "atrium.toml"] {
        let offset = load(name).with_viewport([21, 13, 97, 61]);
        wrong.extend(broken(
            gpu,
            &format!("{name} viewport"),
            &offset,
            ShaderForm::Text,
        ));
        let half = load(name).resized([SIZE[0] / 2, SIZE[1] / 2]);
        wrong.extend(broken(
            gpu,
            &format!("{name} half"),
            &half,
            ShaderForm::Text,
        ));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// `LessEqual` is no fallback, and a pre-pass without a bias no biased one: both change the picture
/// where surfaces tie. If this stops failing, the tests above prove nothing.
#[test]
fn what_ties_would_break_is_seen_to_break() {
    let gpu = gpu();
    let scene = load("atrium.toml");
    let inputs = SceneInputs::new(gpu, &scene).unwrap();
    let originals = measure::originals(&scene);
    let reference = pictures(&inputs, &scene, &originals, ShaderForm::Text);
    // Ties not measured: `equal` is taken at its word.
    let equal = measure::variant(
        &originals,
        &Recipe::parse(["depth-prepass:form=equal"]).unwrap(),
        &Facts::default(),
    );
    let error = worst(
        &reference,
        &pictures(&inputs, &scene, &equal.plans, ShaderForm::Text),
    );
    assert!(
        error.changed_pixels > 0,
        "coplanar decals and crossing cards break EQUAL"
    );
}

/// The same of alpha to coverage: a pre-pass that leaves it out covers samples that the main pass
/// does not.
#[test]
fn what_alpha_leaves_uncovered_is_seen_to_break() {
    let gpu = gpu();
    let scene = load("alpha-coverage.toml");
    let inputs = SceneInputs::new(gpu, &scene).unwrap();
    let originals = measure::originals(&scene);
    let reference = pictures(&inputs, &scene, &originals, ShaderForm::Text);
    for recipe in ["depth-prepass", "early-discard"] {
        let recipe = Recipe::parse_list(recipe).unwrap();
        let mut plans = measure::variant(&originals, &recipe, &Facts::default()).plans;
        let exact = worst(
            &reference,
            &pictures(&inputs, &scene, &plans, ShaderForm::Text),
        );
        assert!(exact.is_exact(), "{recipe}: {exact:?}");
        for pass in plans.iter_mut().filter_map(|p| p.passes.first_mut()) {
            pass.multisample.alpha_to_coverage = false;
        }
        let covered = worst(
            &reference,
            &pictures(&inputs, &scene, &plans, ShaderForm::Text),
        );
        assert!(covered.changed_pixels > 100, "{recipe}: {covered:?}");
    }
}

/// A pre-pass biased in spite of the refusal of a material that discards by its depth: the same
/// slices, at depths that are not the main pass's.
#[test]
fn what_a_bias_does_to_the_depth_a_stage_sees_is_seen_to_break() {
    let gpu = gpu();
    let scene = load("depth-bands.toml");
    let inputs = SceneInputs::new(gpu, &scene).unwrap();
    let originals = measure::originals(&scene);
    let reference = pictures(&inputs, &scene, &originals, ShaderForm::Text);
    let recipe = Recipe::parse(["depth-prepass"]).unwrap();
    let refusal = recipe.apply(&originals[0], &Facts::default()).unwrap_err();
    assert_eq!(refusal.code, "biased-position");
    let recipe = Recipe::parse(["depth-prepass:form=equal,vertex=sliced"]).unwrap();
    let mut plan = recipe.apply(&originals[0], &Facts::without_ties()).unwrap();
    let bias = DepthBias {
        constant: 64,
        slope_scale: 2.0,
        clamp: 0.0,
    };
    let depth = originals[0].passes[0].depth.clone();
    plan.passes[1].depth = depth;
    plan.passes[0].depth.as_mut().unwrap().bias = bias;
    let error = worst(
        &reference,
        &pictures(&inputs, &scene, &[plan], ShaderForm::Text),
    );
    assert!(error.changed_pixels > 20, "{error:?}");
}

/// What lies hidden shows in the channels that a material leaves as they are. Each material by
/// itself takes the recipe; only the frame knows better.
#[test]
fn what_a_colour_mask_lets_through_is_seen_to_break() {
    let gpu = gpu();
    for name in ["color-mask.toml", "color-mask-neighbour.toml"] {
        let scene = load(name);
        let inputs = SceneInputs::new(gpu, &scene).unwrap();
        let originals = measure::originals(&scene);
        let reference = pictures(&inputs, &scene, &originals, ShaderForm::Text);
        for recipe in [
            "depth-prepass",
            "depth-prepass:form=equal",
            "early-discard",
            "early-discard:attachment=readonly",
        ] {
            let recipe = Recipe::parse_list(recipe).unwrap();
            let facts = Facts::without_ties();
            let alone: Vec<Plan> = originals
                .iter()
                .map(|o| recipe.apply(o, &facts).unwrap())
                .collect();
            let error = worst(
                &reference,
                &pictures(&inputs, &scene, &alone, ShaderForm::Text),
            );
            assert!(error.changed_pixels > 100, "{name}: {recipe}: {error:?}");
            let kept = measure::variant(&originals, &recipe, &facts).kept;
            assert_eq!(kept.len(), originals.len(), "{name}: {recipe}: {kept:?}");
            for k in kept {
                assert!(
                    k.why.contains("[color-mask]"),
                    "{name}: {recipe}: {}",
                    k.why
                );
            }
        }
    }
}

#[test]
fn each_covered_pixel_is_shaded_once() {
    let gpu = gpu();
    for name in [
        "shrine.toml",
        "overdraw-20.toml",
        "gallery.toml",
        "alpha-coverage.toml",
    ] {
        let scene = load(name);
        let inputs = SceneInputs::new(gpu, &scene).unwrap();
        let originals = measure::originals(&scene);
        let facts = measure::facts(&Session::new(gpu, &scene, ShaderForm::Text).unwrap()).unwrap();
        let shaded = |plans: &[Plan]| {
            let mut counter =
                measure::Counter::shaded(&inputs, plans, ShaderForm::Text, measure::counting)
                    .unwrap();
            let (_, frame) = scene.frames().next().unwrap();
            inputs.set_frame(frame).unwrap();
            counter
                .count(frame, DrawOrder::BackToFront)
                .unwrap()
                .summary()
                .per_pixel
        };
        let before = shaded(&originals);
        for (recipe, limit) in [("depth-prepass:form=equal", 1.0), ("depth-prepass", 1.05)] {
            let variant =
                measure::variant(&originals, &Recipe::parse_list(recipe).unwrap(), &facts);
            let after = shaded(&variant.plans);
            assert!(
                after >= 1.0 && after <= limit,
                "{name}: {recipe} shades {after} a pixel, the original {before}"
            );
        }
    }
}
