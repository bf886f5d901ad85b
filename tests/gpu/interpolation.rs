//! How far values are from their interpolation: as the adapter finds it at points of the meshes,
//! and as it is proved for all points.

use std::ops::ControlFlow;
use std::path::Path;

use preshade_draw::scene::Scene;
use preshade_lab::measure::{self, Detail, Session};
use preshade_passes::transforms::hoist::{self, Hoist};
use preshade_plan::pass::{Bound, Facts, Frequency, Pass};
use preshade_scenes::ShaderForm;

use crate::render_support::gpu;

fn frequencies(name: &str) -> Vec<Frequency> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/scenes")
        .join(format!("{name}.toml"));
    measured(&preshade_scenes::load(&path).unwrap().resized([96, 54]))
}

fn measured(scene: &Scene) -> Vec<Frequency> {
    measure::frequencies(
        &Session::new(gpu(), scene, ShaderForm::Text).unwrap(),
        &Facts::default(),
        Detail::Table,
        &mut |_| ControlFlow::Continue(()),
    )
    .unwrap()
}

#[test]
fn no_point_of_a_mesh_is_further_off_than_is_proved() {
    let found = frequencies("strata");
    assert!(found.len() >= 8, "{found:#?}");
    for f in &found {
        let sampled = f.interpolation.unwrap();
        let Some(Bound::Proved {
            max,
            roundings,
            triangles,
            of,
            frames,
        }) = f.bound
        else {
            panic!("{f:#?}")
        };
        assert_eq!((triangles, frames), (of, 2), "{}", f.name);
        assert!(roundings < 0.02, "{}: {roundings}", f.name);
        assert!(sampled.points > 1000 && sampled.not_finite == 0, "{f:#?}");
        assert!(
            sampled.max <= max + roundings,
            "{}: {} above {max} and {roundings}",
            f.name,
            sampled.max
        );
        assert!(sampled.mean <= sampled.max && sampled.max <= sampled.range + 1e-4);
    }
    // What bends little is known well: the sampling finds most of what is proved.
    let bent = found.iter().find(|f| f.name.contains("* 9.0")).unwrap();
    let Some(Bound::Proved { max, .. }) = bent.bound else {
        panic!("{bent:#?}")
    };
    let sampled = bent.interpolation.unwrap().max;
    assert!(max < 1.5 * sampled, "{max} proved of {sampled}");
}

#[test]
fn a_lattice_of_noise_has_no_bound_and_says_why() {
    let found = frequencies("noise-grid-16");
    assert!(!found.is_empty());
    for f in &found {
        assert!(f.interpolation.unwrap().max > 0.05, "{f:#?}");
        match f.bound.as_ref().unwrap() {
            Bound::Unbounded { why } => assert!(!why.is_empty()),
            Bound::Proved { max, roundings, .. } => {
                assert!(max + roundings >= f.interpolation.unwrap().max);
            }
        }
    }
}

/// A plane of which one edge has `uv.x` 0.
fn plane(name: &str, fragment: &str) -> Scene {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("interpolation");
    std::fs::create_dir_all(&folder).unwrap();
    let shader = format!(
        "@group(0) @binding(0) var<uniform> camera: mat4x4<f32>;
@group(1) @binding(0) var<uniform> u: vec4<f32>;
struct Vertex {{ @builtin(position) clip: vec4<f32>, @location(0) uv: vec2<f32>, \
    @location(1) odd: f32 }}
@vertex fn vs_main(@location(0) p: vec3<f32>, @location(2) uv: vec2<f32>) -> Vertex {{
    return Vertex(camera * vec4(p, 1.0), uv, 1.0 / uv.y);
}}
@fragment fn fs_main(v: Vertex) -> @location(0) vec4<f32> {{ {fragment} }}"
    );
    std::fs::write(folder.join(format!("{name}.wgsl")), shader).unwrap();
    let scene = format!(
        "size = [96, 54]
[materials.m]
shader = \"{name}.wgsl\"
values = {{ \"u\" = [0.7, 0.1, 0.5, 0.25] }}
state.primitive.cull = \"none\"
[meshes]
p.plane = {{ size = [4, 4], segments = [3, 3] }}
[[draws]]
mesh = \"p\"
material = \"m\"
[[cameras]]
eye = [0.4, 3.0, 2.0]
target = [0, 0, 0]
"
    );
    let path = folder.join(format!("{name}.toml"));
    std::fs::write(&path, scene).unwrap();
    preshade_scenes::load(&path).unwrap()
}

/// At the edge `inverse * inverse` overflows and 0 times it is no number, which a target of 8 bits
/// cannot hold. The value says so itself; a varying of the author's that is infinite there says
/// nothing of a value that does not rest on it.
#[test]
fn a_value_that_is_not_finite_is_left_whatever_the_target_holds() {
    let scene = plane(
        "not-finite",
        "let x = v.uv.x; let inverse = 1.0 / max(x * x, 1e-30);
    let spoiled = sin(x * x * x * x * (inverse * inverse) * cos(v.uv.y * 0.5));
    let sound = sin(cos(v.uv.x * 0.7) + sin(v.uv.y * 0.9));
    return vec4(spoiled, sound, saturate(v.odd), 1.0);",
    );
    let found = measured(&scene);
    let named = |name: &str| found.iter().find(|f| f.name == name).unwrap();
    let (spoiled, sound) = (named("spoiled"), named("sound"));
    assert_eq!(spoiled.nan_pixels, 0);
    assert!(!spoiled.is_finite(), "{spoiled:#?}");
    assert!(sound.is_finite(), "{sound:#?}");
    let plans = measure::originals(&scene);
    let facts = Facts {
        frequencies: found.clone(),
        ..Facts::default()
    };
    let params = hoist::HoistParams {
        budget: Some(1.0),
        threshold: Some(1.0),
        vertices_per_fragment: Some(0.01),
        ..hoist::HoistParams::default()
    };
    let done = Hoist::run(&plans[0], &facts, &params).unwrap();
    let left = done.left.iter().find(|l| l.name.contains("spoiled"));
    let left = left.unwrap_or_else(|| panic!("{:#?}", done.left));
    assert!(left.reason.contains("NaN or infinite"), "{left:?}");
    assert!(done.left.iter().all(|l| !l.name.contains("sound")));
}

/// 0.7 times 10 is 7 once it is rounded: what an adapter takes for it is not known, and either is
/// within what is proved.
#[test]
fn what_a_rounding_decides_is_not_proved_to_be_near() {
    let scene = plane(
        "rounding",
        "let steps = floor(u.x * 10.0) - 5.5; let wave = steps * sin(v.uv.x * v.uv.y * 0.9 + \
         v.uv.x * v.uv.x);
    var high = 1.0; if u.x * 10.0 >= 7.0 { high = 40.0; }
    let branch = high * sin(v.uv.x * v.uv.y * 0.9);
    return vec4(wave, branch, saturate(v.odd), 1.0);",
    );
    let found = measured(&scene);
    let named = |name: &str| found.iter().find(|f| f.name == name).unwrap();
    let wave = named("wave");
    let Some(Bound::Proved { max, roundings, .. }) = wave.bound else {
        panic!("{wave:#?}")
    };
    assert!(wave.interpolation.unwrap().max <= max + roundings);
    let branch = named("branch");
    let Some(Bound::Unbounded { why }) = &branch.bound else {
        panic!("{branch:#?}")
    };
    assert!(why.contains("rounding"), "{why}");
}
