//! A budget holds for the branches that were drawn, and says which: for other values the guard
//! draws the original.

use std::path::Path;

use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::Scene;
use preshade_lab::measure::record::Report;
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings, Variant, verify};
use preshade_plan::contract::{Assumption, Verdict};
use preshade_plan::pass::Facts;
use preshade_scenes::ShaderForm;

use crate::render_support::gpu;

const SHADER: &str = "
struct U { mvp: mat4x4<f32>, color: vec4<f32>, n: i32 }
@group(0) @binding(0) var<uniform> u: U;
struct V { @builtin(position) position: vec4<f32>, @location(0) uv: vec2<f32>, @location(1) n: vec3<f32> }
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>, @location(2) uv: vec2<f32>) -> V {
  return V(u.mvp * vec4<f32>(position, 1.0), uv, normal);
}
@fragment fn fs(v: V) -> @location(0) vec4<f32> {
  var c = v.n * 0.5 + 0.5;
  if (u.n == 1) { let r = v.uv * 40.0; c = vec3<f32>(sin(r.x) * 0.5 + 0.5, cos(r.y * 1.3) * 0.5 + 0.5, sin(r.x + r.y) * 0.5 + 0.5); }
  return vec4<f32>(c, 1.0);
}
";

/// A plane, with `u.n` of each of its draws.
fn drawn_with(name: &str, all: &[i32]) -> Scene {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("undrawn")
        .join(name);
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("preshade.toml"), "").unwrap();
    std::fs::write(folder.join("case.wgsl"), SHADER).unwrap();
    let mut text =
        "size = [96, 64]\n[materials.plane]\nshader = \"case.wgsl\"\nvalues = { \"u.n\" = 0, \
                    \"u.color\" = [1, 1, 1, 1] }\n[meshes]\nfloor.plane = { size = [6, 6] }\n"
            .to_owned();
    for n in all {
        text.push_str(&format!(
            "[[draws]]\nmesh = \"floor\"\nmaterial = \"plane\"\nvalues = {{ \"u.n\" = {n} }}\n"
        ));
    }
    text.push_str("[[cameras]]\neye = [0, 2, 3]\ntarget = [0, 0, 0]\n");
    let path = folder.join("scene.toml");
    std::fs::write(&path, text).unwrap();
    preshade_scenes::load(&path).unwrap()
}

const RECIPE: &str = "hoist:budget=0.01,finite=assumed,jumps=carried";

fn made_for(scene: &Scene) -> Variant {
    let session = Session::new(gpu(), scene, ShaderForm::Text).unwrap();
    let facts = measure::facts(&session).unwrap();
    let recipe = Recipe::parse([RECIPE]).unwrap();
    measure::variant(&measure::originals(scene), &recipe, &facts)
}

fn run(scene: &Scene, variant: &Variant) -> Report {
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    };
    let session = Session::new(gpu(), scene, ShaderForm::Text).unwrap();
    let variants = std::slice::from_ref(variant);
    verify(&session, variants, &settings, &mut |_| {})
        .unwrap()
        .report
}

#[test]
fn a_budget_measured_on_one_side_of_a_branch_is_guarded_on_the_other() {
    let drawn = drawn_with("zero", &[0]);
    let mut variant = made_for(&drawn);
    let plan = &variant.plans[0];
    let given = plan.contract.given();
    assert!(given.contains(&Assumption::MeasuredScene), "{given:?}");
    assert!(given.contains(&Assumption::ValuesOfTheGuard), "{given:?}");
    let guard: Vec<String> = plan
        .guard
        .iter()
        .flat_map(|g| &g.values)
        .map(ToString::to_string)
        .collect();
    assert_eq!(guard, ["u.n = 0"]);

    let report = run(&drawn, &variant);
    assert_eq!(report.variants[1].verdict, Verdict::Holds);
    let said = "`u.n` is 0 in every draw, so one way of the branch at ";
    let is_said = |w: &String| w.starts_with(said) && w.contains("case.wgsl:10 was never run");
    assert!(report.warnings.iter().any(is_said), "{:?}", report.warnings);

    // The same plan in a scene with the other value: the original is drawn, and the reason said.
    let other = drawn_with("one", &[1]);
    let report = run(&other, &variant);
    let kept = &report.variants[1].kept;
    assert!(
        kept.iter().any(|k| k.why.contains("u.n = 0 was assumed")),
        "{kept:?}"
    );
    assert!(!report.is_broken());

    // Without its guard the promise is false there.
    variant.plans[0].guard = None;
    assert!(run(&other, &variant).is_broken());
}

/// Two draws that go both ways leave nothing to guard; two on one side are guarded between them.
#[test]
fn only_ways_that_no_draw_takes_are_guarded() {
    let of = |name: &str, all: &[i32]| measure::undrawn(&drawn_with(name, all)).unwrap();
    assert_eq!(of("both", &[0, 1]), []);
    let values = |found: &[preshade_plan::pass::Undrawn]| -> Vec<String> {
        let each = found.iter().flat_map(|u| &u.values);
        each.map(ToString::to_string).collect()
    };
    assert_eq!(values(&of("above", &[2, 5])), ["u.n = 2..5"]);
    // Between 0 and 2 is 1, which takes the other way: only the first draw's value is promised.
    assert_eq!(values(&of("around", &[0, 2])), ["u.n = 0"]);
}

/// `verify` of a bare shader made the values up, so they are no evidence.
#[test]
fn a_made_up_scene_leaves_its_branches_untested() {
    let mut made_up = drawn_with("made-up", &[0]);
    made_up.is_made_up = true;
    let variant = made_for(&made_up);
    let plan = &variant.plans[0];
    assert!(plan.contract.given().contains(&Assumption::NotMeasured));
    assert_eq!(plan.guard, None);
    let report = run(&made_up, &variant);
    let Verdict::NotMeasured { why } = &report.variants[1].verdict else {
        panic!("{:?}", report.variants[1].verdict);
    };
    assert!(why.starts_with("`u.n` is 0 in every draw"), "{why}");
    // A promise without a budget does not rest on the values that were drawn.
    let recipe = Recipe::parse_list("depth-prepass").unwrap();
    let originals = measure::originals(&made_up);
    let exact = measure::variant(&originals, &recipe, &Facts::default());
    let report = run(&made_up, &exact);
    assert_eq!(report.variants[1].verdict, Verdict::Holds);
    assert_eq!(report.untested, [""; 0]);
}
