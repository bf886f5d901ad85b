//! Immediate data (push constants) in scenes: named as uniforms are, and set before each draw.

use std::path::Path;

use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::{DrawOrder, Scene};
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings, verify};
use preshade_plan::contract::Verdict;
use preshade_plan::pass::Facts;
use preshade_scenes::ShaderForm;

use crate::render_support::gpu;

/// Both stages read it, and the matrix follows the camera.
const SHADER: &str = "
struct Push { mvp: mat4x4<f32>, tint: vec4<f32> }
var<immediate> push: Push;
struct V { @builtin(position) position: vec4<f32>, @location(0) n: vec3<f32> }
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>) -> V {
  return V(push.mvp * vec4<f32>(position, 1.0), normal);
}
@fragment fn fs(v: V) -> @location(0) vec4<f32> {
  if (v.n.y < -2.0) { discard; }
  return push.tint * (0.75 + 0.25 * v.n.y);
}
";

/// Each stage has a part of its own.
const SPLIT: &str = "
struct Draw { mvp: mat4x4<f32> }
struct Look { pad: mat4x4<f32>, tint: vec4<f32> }
var<immediate> push: Draw;
var<immediate> look: Look;
struct V { @builtin(position) position: vec4<f32>, @location(0) n: vec3<f32> }
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>) -> V {
  return V(push.mvp * vec4<f32>(position, 1.0), normal);
}
@fragment fn fs(v: V) -> @location(0) vec4<f32> {
  if (v.n.y < -2.0) { discard; }
  return look.tint * (0.75 + 0.25 * v.n.y);
}
";

/// With one variable, and with one for each stage. `test` names the files.
fn scenes(test: &str) -> [Scene; 2] {
    [
        boxes(&format!("{test}-shared"), SHADER, "push.tint"),
        boxes(&format!("{test}-split"), SPLIT, "look.tint"),
    ]
}

/// Two boxes, the nearer one drawn last. `tint` is the path of their colour.
fn boxes(name: &str, shader: &str, tint: &str) -> Scene {
    let path = tint;
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("preshade.toml"), "").unwrap();
    std::fs::write(folder.join("push.wgsl"), shader).unwrap();
    let draw = |[x, z]: [f32; 2], tint: &str| {
        format!(
            "[[draws]]\nmesh = \"cube\"\nmaterial = \"cubes\"\ntranslate = [{x}, 0, {z}]\nvalues = {{ \"{path}\" = {tint} }}\n"
        )
    };
    let text = format!(
        "size = [64, 48]\n[materials.cubes]\nshader = \"push.wgsl\"\nvalues = {{ \"push.mvp\" = \"$mvp\" }}\n\
         [meshes]\ncube.box = {{ size = [1, 1, 1] }}\n{}{}[[cameras]]\neye = [0, 0.5, 4]\ntarget = [0, 0, 0]\n",
        draw([1.2, -1.0], "[1, 0, 0, 1]"),
        draw([0.0, 1.0], "[0, 1, 0, 1]"),
    );
    let path = folder.join("scene.toml");
    std::fs::write(&path, text).unwrap();
    preshade_scenes::load(&path).unwrap()
}

#[test]
fn each_draw_has_its_own_immediate_data() {
    for scene in scenes("immediates-drawn") {
        colours_of_both_boxes(&scene);
    }
}

fn colours_of_both_boxes(scene: &Scene) {
    let session = Session::new(gpu(), scene, ShaderForm::Text).unwrap();
    let (_, frame) = scene.frames().next().unwrap();
    let picture = session
        .pictures(session.originals(), &[frame], DrawOrder::AsGiven)
        .unwrap();
    let texels = picture[0].colors[0].as_ref().unwrap().to_rgba8();
    let (mut red, mut green) = (0, 0);
    for texel in texels.as_chunks::<4>().0 {
        red += usize::from(texel[0] > 100 && texel[1] == 0);
        green += usize::from(texel[1] > 100 && texel[0] == 0);
    }
    assert!(green > 100 && red > 0, "{red} red, {green} green");
}

#[test]
fn variants_of_materials_with_immediate_data_are_verified() {
    let [shared, split] = scenes("immediates-verified");
    let recipes = [
        "depth-prepass",
        "early-discard",
        "visibility-buffer:budget=0.1",
    ];
    variants_hold(&shared, &recipes);
    variants_hold(&split, &recipes[..2]);
    let recipe = Recipe::parse([recipes[2]]).unwrap();
    let variant = measure::variant(&measure::originals(&split), &recipe, &Facts::without_ties());
    let refusals = format!("{:?}", variant.kept);
    assert!(refusals.contains("are immediate data"), "{refusals}");
}

fn variants_hold(scene: &Scene, recipes: &[&str]) {
    let session = Session::new(gpu(), scene, ShaderForm::Text).unwrap();
    let variants: Vec<_> = recipes
        .iter()
        .map(|recipe| {
            let recipe = Recipe::parse([*recipe]).unwrap();
            measure::variant(&measure::originals(scene), &recipe, &Facts::without_ties())
        })
        .collect();
    for variant in &variants {
        let passes = &variant.plans[0].passes;
        assert!(
            passes
                .iter()
                .any(|p| p.limits.get("maxImmediateSize") == Some(&80)),
            "{passes:?}"
        );
    }
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    };
    let report = verify(&session, &variants, &settings, &mut |_| {})
        .unwrap()
        .report;
    for variant in &report.variants {
        assert_eq!(variant.verdict, Verdict::Holds, "{}", variant.name);
    }
}
