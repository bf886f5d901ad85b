//! Immediate data (push constants) in scenes: named as uniforms are, and set before each draw.

use std::path::Path;

use preshade::unstable::measure::{self, Session, Settings, Timed, TimingSettings, verify};
use preshade::unstable::passes::contract::Verdict;
use preshade::unstable::passes::pass::Facts;
use preshade::unstable::recipe::Recipe;
use preshade::unstable::render::ShaderForm;
use preshade::unstable::scene::{self, DrawOrder, Scene};

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

/// Two boxes, the nearer one drawn last.
fn boxes() -> Scene {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("immediates");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("preshade.toml"), "").unwrap();
    std::fs::write(folder.join("push.wgsl"), SHADER).unwrap();
    let draw = |[x, z]: [f32; 2], tint: &str| {
        format!(
            "[[draws]]\nmesh = \"cube\"\nmaterial = \"cubes\"\ntranslate = [{x}, 0, {z}]\nvalues = {{ \"push.tint\" = {tint} }}\n"
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
    scene::load(&path).unwrap()
}

#[test]
fn each_draw_has_its_own_immediate_data() {
    let scene = boxes();
    let session = Session::new(gpu(), &scene, ShaderForm::Text).unwrap();
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
    let scene = boxes();
    let session = Session::new(gpu(), &scene, ShaderForm::Text).unwrap();
    let variants: Vec<_> = [
        "depth-prepass",
        "early-discard",
        "visibility-buffer:budget=0.1",
    ]
    .iter()
    .map(|recipe| {
        let recipe = Recipe::parse([*recipe]).unwrap();
        measure::variant(&measure::originals(&scene), &recipe, &Facts::without_ties())
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
