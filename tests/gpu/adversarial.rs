//! The shaders of `fixtures/adversarial`, each made to break a promise, drawn through every pass:
//! each promise holds, or the pass refuses by the code that names the cause.

use std::path::{Path, PathBuf};

use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::SelfTestResult;
use preshade_draw::scene::Scene;
use preshade_lab::measure::{self, Session, Settings, Timed, TimingSettings, record};
use preshade_plan::contract::Verdict;
use preshade_plan::pass::Use;
use preshade_plan::state::MaterialState;
use preshade_scenes::ShaderForm;
use shader_text::error::Color;
use shader_text::options::Options;

use crate::fixtures_support::recipes;
use crate::render_support::gpu;

/// Who has to refuse what, and by which code: the fixture, the start of the recipe, the code.
const REFUSED: &[(&str, &str, &str)] = &[
    ("at-far-plane", "depth-prepass:form=equal", "depth-ties"),
    ("centroid-color", "depth-prepass", "surviving-samples"),
    (
        "centroid-color",
        "early-discard:attachment",
        "surviving-samples",
    ),
    ("centroid-discard", "depth-prepass", "surviving-samples"),
    (
        "centroid-discard",
        "early-discard:attachment",
        "surviving-samples",
    ),
    ("centroid-texture", "depth-prepass", "surviving-samples"),
    ("depth-below-zero", "depth-prepass", "near-plane"),
    (
        "depth-below-zero",
        "early-discard:attachment",
        "readonly-depth-writer",
    ),
    (
        "depth-nan",
        "depth-prepass:form=equal",
        "depth-not-invariant",
    ),
    (
        "derivative-after-discard",
        "early-discard",
        "undefined-derivative",
    ),
    ("linear-clipped", "visibility-buffer", "interpolated"),
    ("quad-swap", "depth-prepass", "subgroup"),
    ("quad-swap", "early-discard", "subgroup"),
    ("quad-swap", "visibility-buffer", "subgroup"),
    ("sample-index-in-color", "depth-prepass", "sample-rate"),
    ("sample-index-in-color", "early-discard", "sample-rate"),
    ("sample-index-in-color", "visibility-buffer", "multisampled"),
    ("sample-index-unread", "hoist", "sample-rate"),
    ("sample-mask-in", "depth-prepass", "surviving-samples"),
    ("sample-mask-out", "depth-prepass", "sample-mask"),
    ("sample-mask-out", "early-discard", "sample-mask"),
    ("sample-varying-in-color", "depth-prepass", "sample-rate"),
    ("sample-varying-in-color", "early-discard", "sample-rate"),
    ("slopes-of-a-texture", "visibility-buffer", "interpolated"),
    ("subgroup-discard", "depth-prepass", "subgroup"),
    ("subgroup-discard", "early-discard", "subgroup"),
    ("subgroup-discard", "early-alpha", "subgroup"),
    ("subgroup-discard", "shadow", "subgroup"),
    ("subgroup-sum", "depth-prepass", "subgroup"),
    ("subgroup-sum", "early-discard", "subgroup"),
    ("subgroup-sum", "visibility-buffer", "subgroup"),
    ("subgroup-sum", "early-alpha", "subgroup"),
    ("sum-shared-with-discard", "depth-prepass", "fused-discard"),
    ("sum-shared-with-discard", "early-discard", "fused-discard"),
    ("sum-shared-with-discard", "early-alpha", "fused-discard"),
    ("sum-shared-with-discard", "shadow", "fused-discard"),
    ("twin-shared-with-discard", "depth-prepass", "fused-discard"),
    ("twin-shared-with-discard", "early-discard", "fused-discard"),
    ("two-globals-at-one-binding", "hoist", "shared-binding"),
    (
        "two-globals-at-one-binding",
        "visibility-buffer",
        "shared-binding",
    ),
    (
        "written-depth",
        "early-discard:attachment",
        "readonly-depth-writer",
    ),
    (
        "varying-shared-with-discard",
        "depth-prepass",
        "fused-discard",
    ),
    (
        "varying-shared-with-discard",
        "early-discard",
        "fused-discard",
    ),
];

/// Right pictures whose self-test fails, so that a host draws the original: the test's draws reject
/// other fragments and samples than the frame does, and on these a discard depends.
const FALLS_BACK: &[(&str, &str)] = &[("centroid-discard", "hoist"), ("subgroup-discard", "hoist")];

/// Nothing to compare: the sky throws no shadow.
const NOTHING_SEEN: &[(&str, &str)] = &[
    ("at-far-plane", "shadow"),
    // A pixel's velocity is compared with that of the triangle of its depth. Here all triangles have
    // one depth, or the material writes another.
    ("at-far-plane", VELOCITIES),
    ("conservative-depth", VELOCITIES),
    ("depth-above-one", VELOCITIES),
    ("depth-below-zero", VELOCITIES),
    ("depth-nan", VELOCITIES),
    ("written-depth", VELOCITIES),
    ("written-depth-glsl", VELOCITIES),
];

const VELOCITIES: &str = "outputs:write=velocity+id";

/// What the software adapter cannot draw, or no scene can fill. `tests/it/adversarial.rs` checks
/// the texts.
const NOT_DRAWN: &[&str] = &["barycentrics", "binding-array"];

/// The recipes that are drawn have one of these uses: each pass, and each of its forms that promises
/// something of its own. Budgets are left out: `verify` measures what they allow, and here nothing
/// does.
const USES: [Use; 5] = [
    Use::Exact,
    Use::ExactWithoutTies,
    Use::ExactWhereApplied,
    Use::Inject,
    Use::Plan,
];

/// Each fixture once, or once for each of its scenes.
fn fixtures() -> Vec<(String, Scene)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/adversarial");
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    files.sort();
    let mut found = Vec::new();
    for path in &files {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let has_scene = path.with_extension("toml").exists();
        let scene = match path.extension().and_then(|e| e.to_str()) {
            Some("toml") => {
                preshade_scenes::load(path).unwrap_or_else(|e| panic!("{}", e.render()))
            }
            Some("wgsl") if !has_scene => made_up(&[path]),
            Some("vert") if !has_scene => made_up(&[path, &path.with_extension("frag")]),
            _ => continue,
        };
        if !NOT_DRAWN.contains(&&*name) {
            found.push((name, small(scene)));
        }
    }
    assert!(found.len() >= 40, "{}", found.len());
    found
}

fn made_up(files: &[&Path]) -> Scene {
    let sources: Vec<Source> = files
        .iter()
        .map(|path| {
            let name = path.file_name().unwrap().to_string_lossy();
            Source::new(name, std::fs::read_to_string(path).unwrap())
        })
        .collect();
    let parsed = front::parse(&sources, &Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(Color::Never)));
    preshade_scenes::synthesise(parsed, MaterialState::default())
}

fn small(scene: Scene) -> Scene {
    let mut scene = scene.resized([160, 90]);
    scene.orders.truncate(1);
    for camera in &mut scene.cameras {
        camera.frames.truncate(1);
    }
    scene
}

/// What became of each recipe.
fn drawn(scene: &Scene) -> Result<record::Report, measure::Error> {
    let session = Session::new(gpu(), scene, ShaderForm::Text)?;
    let facts = measure::facts(&session)?;
    let originals = measure::originals(scene);
    let variants: Vec<_> = recipes(&USES)
        .into_iter()
        .filter(|recipe| !recipe.contains("budget"))
        .map(|r| measure::variant(&originals, &Recipe::parse_list(r).unwrap(), &facts))
        .collect();
    let settings = Settings {
        timed: Timed::No,
        timing: TimingSettings::default(),
        frames_per_camera: 1,
        command: String::new(),
    };
    let verified = measure::verify(&session, &variants, &settings, &mut |_| {})?;
    Ok(verified.report)
}

#[test]
fn every_promise_holds_or_is_refused_by_name() {
    let mut wrong = Vec::new();
    let mut held = 0;
    let mut refused = Vec::new();
    for (name, scene) in fixtures() {
        let report = match drawn(&scene) {
            Ok(report) => report,
            Err(error) => {
                wrong.push(format!("{name}: {error}"));
                continue;
            }
        };
        for variant in &report.variants[1..] {
            let label = format!("{name} by {}", variant.name);
            match &variant.verdict {
                Verdict::Holds => held += 1,
                Verdict::Broken { r#where } => wrong.push(format!("{label}: {where}")),
                Verdict::NotMeasured { why }
                    if variant.kept.is_empty()
                        && !NOTHING_SEEN.contains(&(name.as_str(), variant.name.as_str())) =>
                {
                    wrong.push(format!("{label}: not measured: {why}"));
                }
                Verdict::NotMeasured { .. } => {}
            }
            let failed = variant
                .self_test
                .iter()
                .find_map(|test| match &test.result {
                    SelfTestResult::Failed { failure, .. } => Some(failure),
                    _ => None,
                });
            if let Some(failure) = failed
                && !FALLS_BACK
                    .iter()
                    .any(|(fixture, pass)| *fixture == name && variant.name.contains(pass))
            {
                wrong.push(format!(
                    "{label}: self-test failed on a right picture: {failure}"
                ));
            }
            for kept in &variant.kept {
                refused.push((name.clone(), variant.name.clone(), kept.why.clone()));
            }
        }
    }
    for (name, recipe, why) in &refused {
        let code = why.split(['[', ']']).nth(1).unwrap();
        if code == "internal" || why.contains("bug") {
            wrong.push(format!("{name} by {recipe}: {why}"));
        }
    }
    for (fixture, recipe, code) in REFUSED {
        let named = refused.iter().any(|(name, refused, why)| {
            name == fixture && refused.starts_with(recipe) && why.contains(&format!("[{code}]"))
        });
        if !named {
            wrong.push(format!("{fixture}: {recipe} does not refuse by {code}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(held > 300, "{held}");
}
