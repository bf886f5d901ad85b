//! Values at half the rate, drawn: pixels that have a texel are the author's, edges and thin things are
//! kept, and a size need not be even.

use std::path::Path;

use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{ColorImage, FrameSettings, Prepared, SceneInputs};
use preshade_draw::scene::Scene;
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings};
use preshade_plan::contract::Verdict;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_scenes::ShaderForm;

use crate::render_support::gpu;

/// Sizes with and without a texel for each pixel of the last row and column.
const SIZES: [[u32; 2]; 3] = [[161, 91], [160, 90], [1, 1]];

fn load(name: &str, size: [u32; 2]) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    preshade_scenes::load(&path.join(name))
        .unwrap()
        .resized(size)
}

fn picture(scene: &Scene, plans: &[Plan]) -> ColorImage {
    let inputs = SceneInputs::new(gpu(), scene).unwrap();
    let variant = preshade_scenes::variant(plans, ShaderForm::Text).unwrap();
    let prepared = Prepared::new(&inputs, &variant, &FrameSettings::of(scene)).unwrap();
    inputs.set_frame(&scene.cameras[0].frames[0]).unwrap();
    let rendered = prepared.render().unwrap();
    rendered.colors.into_iter().flatten().next().unwrap()
}

fn halved(scene: &Scene, recipe: &str) -> Vec<Plan> {
    let recipe = Recipe::parse_list(recipe).unwrap();
    let made = measure::variant(&measure::originals(scene), &recipe, &Facts::default());
    assert!(
        made.plans.iter().any(|p| p.passes.len() == 2),
        "{recipe:?} is refused"
    );
    made.plans
}

/// The largest difference of a channel, of the pixels that `of` takes.
fn most(scene: &Scene, recipe: &str, of: impl Fn(u32, u32) -> bool) -> f32 {
    let original = picture(scene, &measure::originals(scene));
    let variant = picture(scene, &halved(scene, recipe));
    let [width, height] = original.size;
    let mut most = 0.0_f32;
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        if of(x, y) {
            let at = (y * width + x) as usize;
            for (a, b) in original.rgba(at).into_iter().zip(variant.rgba(at)) {
                most = most.max((a - b).abs());
            }
        }
    }
    most
}

const STEP: f32 = 1.0 / 255.0;

#[test]
fn pixels_with_a_texel_are_the_authors() {
    for size in SIZES {
        let scene = load("scenes/deferred.toml", size);
        let even = most(&scene, "half-rate:budget=1", |x, y| {
            x % 2 == 0 && y % 2 == 0
        });
        assert!(even <= 1.01 * STEP, "{size:?}: {even}");
    }
    let scene = load("scenes/deferred.toml", SIZES[0]).with_viewport([21, 13, 97, 61]);
    let even = most(&scene, "half-rate:budget=1", |x, y| {
        x % 2 == 0 && y % 2 == 0
    });
    assert!(even <= 1.01 * STEP, "{even}");
}

#[test]
fn a_wall_keeps_its_budget() {
    let scene = load("scenes/deferred.toml", [640, 360]);
    let originals = measure::originals(&scene);
    let recipe = Recipe::parse_list("half-rate:budget=0.01").unwrap();
    let variant = measure::variant(&originals, &recipe, &Facts::default());
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    };
    let session = Session::new(gpu(), &scene, ShaderForm::Text).unwrap();
    let outcome = measure::verify(&session, &[variant], &settings, &mut |_| {}).unwrap();
    let report = &outcome.report.variants[1];
    assert_eq!(report.verdict, Verdict::Holds, "{report:?}");
    assert!(report.error.as_ref().unwrap().changed_pixels > 0);
}

/// A grid of lines one pixel wide, most of them between the texels.
#[test]
fn thin_things_are_kept_by_their_guide() {
    let scene = load("adversarial/thin-lines.toml", SIZES[1]);
    let off = |more: &str| most(&scene, &format!("half-rate:budget=1{more}"), |_, _| true);
    let [guided, computed, unguided] = ["", ",edges=computed", ",guide=none"].map(off);
    assert!(
        computed <= guided && guided < 0.8 * unguided,
        "{computed} {guided} {unguided}"
    );
}

/// Half of the pixels are discarded, by themselves and in blocks.
#[test]
fn a_discard_is_each_pixels_own() {
    for size in SIZES {
        let scene = load("adversarial/discarded-between.toml", size);
        let original = picture(&scene, &measure::originals(&scene));
        let variant = picture(&scene, &halved(&scene, "half-rate:budget=1"));
        let [width, height] = size;
        let clear = |image: &ColorImage, at| image.rgba(at)[3] == 0.0;
        for at in 0..(width * height) as usize {
            assert_eq!(clear(&original, at), clear(&variant, at), "{size:?}: {at}");
        }
    }
}

#[test]
fn several_draws_of_a_material_are_told() {
    let mut scene = load("scenes/deferred.toml", SIZES[0]);
    scene.draws.push(scene.draws[0].clone());
    let inputs = SceneInputs::new(gpu(), &scene).unwrap();
    let variant =
        preshade_scenes::variant(&halved(&scene, "half-rate:budget=1"), ShaderForm::Text).unwrap();
    let error = Prepared::new(&inputs, &variant, &FrameSettings::of(&scene)).unwrap_err();
    assert!(
        error.to_string().contains("draws it several times"),
        "{error}"
    );
}
