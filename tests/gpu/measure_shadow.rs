//! Shadow passes under the light: the same depths as the whole program leaves there, and a
//! forgotten alpha test or uniform is found.

use std::path::Path;

use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::{self, Scene};
use preshade_lab::measure::record::VariantReport;
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings, Variant, verify};
use preshade_plan::contract::Verdict;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{GpuPass, Phase};
use preshade_plan::state::{DepthDirection, DepthFormat};
use preshade_scenes::ShaderForm;

use crate::render_support::*;

fn load(name: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fixtures/scenes/{name}.toml"));
    let mut scene = preshade_scenes::load(&path).unwrap().resized([96, 54]);
    scene.light.map = 192;
    scene.cameras.truncate(2);
    scene.orders.truncate(1);
    scene
}

fn shadow(scene: &Scene) -> Variant {
    let recipe = Recipe::parse(["shadow"]).unwrap();
    measure::variant(&measure::originals(scene), &recipe, &Facts::default())
}

fn shadow_passes(variant: &mut Variant) -> impl Iterator<Item = &mut GpuPass> {
    variant
        .plans
        .iter_mut()
        .flat_map(|p| &mut p.passes)
        .filter(|p| p.phase == Phase::Shadow)
}

fn run(scene: &Scene, variant: Variant) -> VariantReport {
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    };
    let outcome = verify(
        &Session::new(gpu(), scene, ShaderForm::Text).unwrap(),
        &[variant],
        &settings,
        &mut |_| {},
    )
    .unwrap();
    outcome.report.variants.into_iter().nth(1).unwrap()
}

#[test]
fn no_depth_of_a_shadow_pass_differs_from_the_whole_programs() {
    for name in [
        "atrium",
        "instanced",
        "skinned",
        "displaced",
        "log-depth",
        "two-sided",
        "glsl",
        "vertex-pulling",
    ] {
        let scene = load(name);
        let report = run(&scene, shadow(&scene));
        assert_eq!(report.verdict, Verdict::Holds, "{name}");
        let shadow = report.shadow.unwrap();
        let depths = &shadow.depths;
        assert_eq!(
            (depths.changed_depth, depths.depth_max_ulp),
            (0, 0),
            "{name}"
        );
        assert!(depths.covered > 1000, "{name}: {} covered", depths.covered);
        assert!(shadow.whole_ms.is_none() && shadow.speedup.is_none());
    }
}

#[test]
fn a_shadow_map_is_forward_and_of_one_sample_whatever_the_camera_s_depth_is() {
    let scene = load("atrium")
        .with_depth(DepthFormat::Depth16unorm, DepthDirection::Reversed)
        .with_samples(4);
    let report = run(&scene, shadow(&scene));
    assert_eq!(report.verdict, Verdict::Holds);
    assert_eq!(report.shadow.unwrap().depths.changed_depth, 0);
}

/// An alpha-tested material, whose shadow has the holes of its leaves.
#[test]
fn a_shadow_pass_that_forgets_the_alpha_test_is_broken() {
    let scene = load("atrium").with_invariant_positions();
    let mut variant = shadow(&scene);
    let mut tested = 0;
    for pass in shadow_passes(&mut variant) {
        tested += usize::from(pass.fragment.take().is_some());
    }
    assert!(tested >= 4, "{tested} shadow passes test alpha");
    let report = run(&scene, variant);
    let Verdict::Broken { r#where } = &report.verdict else {
        panic!("{:?}", report.verdict);
    };
    assert!(
        r#where.starts_with("the light's view, at camera `"),
        "{where}"
    );
    assert!(report.shadow.unwrap().depths.changed_depth > 100);
    // The camera's frame has no part in it.
    assert!(report.error.unwrap().is_exact());
}

#[test]
fn a_plan_that_forgets_what_the_camera_decides_is_broken() {
    let scene = load("log-depth").with_invariant_positions();
    let mut variant = shadow(&scene);
    for pass in shadow_passes(&mut variant) {
        assert!(pass.view_dependent.contains(&"frame.far".to_owned()));
        pass.view_dependent.retain(|name| name != "frame.far");
    }
    assert!(matches!(
        run(&scene, variant).verdict,
        Verdict::Broken { .. }
    ));
}

#[test]
fn a_difference_without_invariant_positions_proves_nothing() {
    let scene = load("atrium");
    let mut variant = shadow(&scene);
    shadow_passes(&mut variant).for_each(|p| p.view_dependent.clear());
    let Verdict::NotMeasured { why } = run(&scene, variant).verdict else {
        panic!("it counts as a pass");
    };
    assert!(why.contains("--invariant marks it"), "{why}");
}

/// The box of the light holds what is drawn, instances too; a scene may say another.
#[test]
fn the_light_sees_all_that_is_drawn() {
    let mut scene = load("instanced");
    let view = |scene: &Scene| {
        let frame = scene.light_frame(0.0);
        frame.projection * frame.view
    };
    let all = view(&scene);
    let mut seen = 0;
    for draw in &scene.draws {
        let instances = match draw.instance_streams.get("instance_transform") {
            Some(scene::Stream::Float { data, .. }) => data.as_chunks::<16>().0,
            _ => &[glam::Mat4::IDENTITY.to_cols_array()][..],
        };
        for instance in instances {
            let at = draw.transform * glam::Mat4::from_cols_array(instance);
            let clip = all.project_point3(at.transform_point3(glam::Vec3::ZERO));
            assert!(clip.truncate().abs().max_element() <= 1.0 && (0.0..=1.0).contains(&clip.z));
            seen += 1;
        }
    }
    assert!(seen > 10, "{seen}");
    scene.light.center = Some(glam::Vec3::new(1.0, 2.0, 3.0));
    scene.light.extent = Some(glam::Vec3::new(8.0, 4.0, 20.0));
    let clip = view(&scene).project_point3(glam::Vec3::new(1.0, 2.0, 3.0));
    assert!(
        clip.abs_diff_eq(glam::Vec3::new(0.0, 0.0, 0.5), 1e-5),
        "{clip}"
    );
    let near = scene.light.direction * 10.0 + glam::Vec3::new(1.0, 2.0, 3.0);
    assert!(view(&scene).project_point3(near).z.abs() < 1e-5);
}

#[test]
fn a_light_that_sees_nothing_proves_nothing() {
    let mut scene = load("log-depth");
    scene.light.center = Some(glam::Vec3::splat(1e4));
    scene.light.extent = Some(glam::Vec3::ONE);
    let Verdict::NotMeasured { why } = run(&scene, shadow(&scene)).verdict else {
        panic!("it counts as a pass");
    };
    assert_eq!(why, "the light sees nothing that has a shadow pass");
}
