//! Auxiliary pictures of every fixture against what they must be: for the tests, which assert, and
//! for the example `outputs`, which prints.
#![allow(dead_code)]

use std::path::PathBuf;
use std::time::Duration;

use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{FrameSettings, Gpu, Prepared, Rendered, SceneInputs};
use preshade_draw::scene::{Draw, DrawOrder, Scene};
use preshade_lab::measure::outputs::{self, OutputsReport};
use preshade_lab::measure::{
    self, Estimate, Session, Settings, Timed, TimingSettings, Variant, shadow,
};
use preshade_plan::contract::Verdict;
use preshade_plan::plan::{Attachment, GpuPass, Phase, Plan, Role, SCENE_DEPTH};
use preshade_plan::reflect;
use preshade_plan::state::MaterialState;
use preshade_scenes::ShaderForm;
use shader_text::options::Options;

use crate::fixtures_support::{materials, root};

/// The scenes whose vertices move, each with the attributes that move in it.
pub const SCENES: [(&str, &str); 6] = [
    ("skinned", ""),
    ("morphed", ""),
    ("instanced", ",moving=model_0+model_1+model_2+model_3"),
    ("wind", ""),
    ("displaced", ""),
    ("crowd", ",moving=instance_place"),
];

/// Geometry passes that were written by hand: a scene, a material of it and the file.
pub const BY_HAND: [(&str, &str, &str); 2] = [
    ("atrium", "marble", "gbuffer-pbr.wgsl"),
    ("morphed", "clay", "gbuffer-morphed.wgsl"),
];

/// A scene to draw, in one order.
pub struct Subject {
    /// The fixture's file or the scene's.
    pub name: String,
    /// The scene.
    pub scene: Scene,
    /// Attributes that move, as a part of a recipe.
    pub moving: &'static str,
}

/// A scene of `fixtures`, with one camera and one order.
pub fn load(name: &str, size: [u32; 2]) -> Scene {
    let path = root().join(format!("fixtures/scenes/{name}.toml"));
    let mut scene = preshade_scenes::load(&path).unwrap().resized(size);
    scene.cameras.truncate(1);
    scene.orders.truncate(1);
    scene
}

/// A scene with so many instances of each draw that it has about `most` vertices at most.
pub fn limited(mut scene: Scene, most: u32) -> Scene {
    for draw in &mut scene.draws {
        let vertices = scene.meshes[draw.mesh].vertex_count.max(1);
        draw.instances = draw.instances.min((most / vertices).max(1));
    }
    scene
}

/// The scenes whose vertices move, [`limited`].
pub fn moving_scenes(size: [u32; 2], most: u32) -> Vec<Subject> {
    let subject = |(name, moving): (&str, &'static str)| {
        let scene = limited(load(name, size), most);
        Subject {
            name: format!("scene {name}"),
            scene,
            moving,
        }
    };
    SCENES.into_iter().map(subject).collect()
}

/// Every material of `fixtures`, in a scene made for it.
pub fn fixtures(size: [u32; 2]) -> Vec<Subject> {
    let subject = |files: Vec<PathBuf>| {
        let name = files[0].file_name().unwrap().to_string_lossy().into_owned();
        let sources: Vec<Source> = files
            .iter()
            .map(|path| {
                let name = path.file_name().unwrap().to_string_lossy();
                Source::from_bytes(name, std::fs::read(path).unwrap()).unwrap()
            })
            .collect();
        let parsed = front::parse(&sources, &Options::default()).unwrap();
        let mut scene = preshade_scenes::synthesise(parsed, MaterialState::default()).resized(size);
        scene.cameras.truncate(1);
        scene.orders.truncate(1);
        Subject {
            name,
            scene,
            moving: "",
        }
    };
    materials().into_iter().map(subject).collect()
}

/// A variant with what the scene's files tell.
pub fn variant(scene: &Scene, recipe: &str) -> Variant {
    let recipe = Recipe::parse([recipe]).unwrap();
    measure::variant(&measure::originals(scene), &recipe, &measure::known(scene))
}

/// The draws in the frame before, as `verify` takes them for a variant.
pub fn earlier(scene: &Scene, variant: &Variant) -> Scene {
    let originals = measure::originals(scene);
    outputs::earlier(scene, &|before: &Draw, now: &Draw| {
        outputs::allowed(scene, &originals, variant, before, now)
    })
}

/// Times are short, so that all scenes take minutes.
pub fn settings(timed: Timed) -> Settings {
    Settings {
        timed,
        timing: TimingSettings {
            budget: Duration::from_millis(400),
            max_samples: 60,
            ..TimingSettings::default()
        },
        frames_per_camera: 1,
        command: String::new(),
    }
}

/// One picture of a subject.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Row {
    /// The fixture or scene.
    pub subject: String,
    /// What is written.
    pub write: String,
    /// Why it was refused; `None`: it was drawn.
    pub refused: Option<String>,
    /// Pixels with anything in them.
    pub covered: u64,
    /// Of these, those whose depth differs from that of the author's whole program.
    pub changed_depth: u64,
    /// By how many steps between neighbouring floats at most.
    pub depth_max_ulp: u64,
    /// Pixels whose velocity was compared; not compared; the longest; the largest difference, in
    /// pixels.
    pub velocity: Option<(u64, u64, f64, f64)>,
    /// Why a position was not evaluated.
    pub not_evaluated: Option<String>,
    /// The verdict in words.
    pub verdict: String,
    /// Whether the verdict is that all holds.
    pub holds: bool,
    /// Milliseconds a frame of the main passes: for `shadow`, of the whole programs in the map.
    pub main_ms: Option<f64>,
    /// Milliseconds a frame of the auxiliary passes.
    pub pass_ms: Option<f64>,
    /// The main passes' time over the auxiliary passes', with its interval.
    pub speedup: Option<Estimate>,
}

/// Draws `write` of a subject and compares it.
pub fn row(gpu: &Gpu, subject: &Subject, write: &str, timed: Timed) -> Row {
    let moving = match write.contains("velocity") {
        true => subject.moving,
        false => "",
    };
    let scene = &subject.scene;
    let variant = variant(scene, &format!("outputs:write={write}{moving}"));
    let mut row = Row {
        subject: subject.name.clone(),
        write: write.to_owned(),
        refused: None,
        covered: 0,
        changed_depth: 0,
        depth_max_ulp: 0,
        velocity: None,
        not_evaluated: None,
        verdict: String::new(),
        holds: false,
        main_ms: None,
        pass_ms: None,
        speedup: None,
    };
    let has_pass = |plan: &Plan| plan.passes.iter().any(|p| p.role == Role::Outputs);
    if !variant.plans.iter().any(has_pass) {
        row.refused = Some(variant.kept.iter().map(|k| k.why.clone()).collect());
        return row;
    }
    let session = Session::new(gpu, scene, ShaderForm::Text).unwrap();
    // Depths are compared bit by bit in any case: `invariant` only says whether a difference is
    // broken or expected.
    let verdict = if write.contains("shadow") || write.contains("distance") {
        let report = shadow::measure(&session, &variant, &settings(timed)).unwrap();
        row.covered = report.depths.covered;
        row.changed_depth = report.depths.changed_depth;
        row.depth_max_ulp = report.depths.depth_max_ulp;
        row.main_ms = report.whole_ms.as_ref().map(|t| t.estimate.median);
        row.pass_ms = report.time_ms.as_ref().map(|t| t.estimate.median);
        row.speedup = report.speedup;
        report.verdict(true)
    } else {
        let earlier = earlier(scene, &variant);
        let report = outputs::measure(&session, &earlier, &variant, &settings(timed));
        let report = report.unwrap();
        row.covered = report.depths.covered;
        row.changed_depth = report.depths.changed_depth;
        row.depth_max_ulp = report.depths.depth_max_ulp;
        let velocity = report.velocity.as_ref();
        row.velocity = velocity.map(|v| (v.pixels, v.left_out, v.longest, v.worst));
        row.not_evaluated = velocity.and_then(|v| v.not_evaluated.clone());
        row.main_ms = report.main_ms.as_ref().map(|t| t.estimate.median);
        row.pass_ms = report.time_ms.as_ref().map(|t| t.estimate.median);
        row.speedup = report.speedup;
        report.verdict(true)
    };
    row.holds = verdict == Verdict::Holds;
    row.verdict = match verdict {
        Verdict::Holds => "holds".to_owned(),
        Verdict::Broken { r#where } => r#where,
        Verdict::NotMeasured { why } => why,
    };
    row
}

/// The report on a scene, for tests that look closer.
pub fn report(gpu: &Gpu, scene: &Scene, earlier: &Scene, variant: &Variant) -> OutputsReport {
    let session = Session::new(gpu, scene, ShaderForm::Text).unwrap();
    outputs::measure(&session, earlier, variant, &settings(Timed::No)).unwrap()
}

/// The pass of outputs as the only one of a plan, with its pictures as the frame's colours.
pub fn alone(plan: &Plan) -> Plan {
    let is_it = |p: &&GpuPass| p.role == Role::Outputs;
    let mut pass: GpuPass = plan.passes.iter().find(is_it).unwrap().clone();
    let map = plan.attachment("outputs-depth").unwrap().clone();
    pass.phase = Phase::Opaque;
    pass.depth.as_mut().unwrap().attachment = SCENE_DEPTH.to_owned();
    for target in pass.targets.iter_mut().flatten() {
        target.attachment = None;
    }
    let mut alone = plan.clone();
    alone.attachments = vec![Attachment {
        name: SCENE_DEPTH.to_owned(),
        ..map
    }];
    alone.passes = vec![pass];
    alone
}

/// The same with a program that was written by hand.
pub fn by_hand(plan: &Plan, file: &str) -> Plan {
    let path = root().join("fixtures/handwritten").join(file);
    let source = Source::from_bytes(file.to_owned(), std::fs::read(path).unwrap()).unwrap();
    let program = front::parse(&[source], &Options::default())
        .unwrap()
        .program;
    let mut plan = alone(plan);
    let pass = &mut plan.passes[0];
    pass.vertex = "vs_geometry".to_owned();
    pass.fragment = Some("fs_geometry".to_owned());
    reflect::fill(pass, &program);
    plan.programs.insert(pass.program.clone(), program);
    plan
}

/// A picture of a plan in the scene's first frame.
pub fn drawn(gpu: &Gpu, scene: &Scene, plans: &[Plan]) -> Rendered {
    let session = Session::new(gpu, scene, ShaderForm::Text).unwrap();
    let mut prepared = session.prepare(plans).unwrap();
    let frame = scene.cameras[0].frames[0];
    let picture = session.draw(&mut prepared, &frame, DrawOrder::FrontToBack);
    picture.unwrap()
}

/// A picture of plans in the scene's first frame, with the draws of `earlier` in the frame before.
pub fn drawn_after(gpu: &Gpu, earlier: &Scene, scene: &Scene, plans: &[Plan]) -> Rendered {
    let previous = SceneInputs::new(gpu, earlier).unwrap();
    let inputs = SceneInputs::new(gpu, scene).unwrap().after(&previous);
    let variant = preshade_scenes::variant(plans, ShaderForm::Text).unwrap();
    let mut prepared = Prepared::new(&inputs, &variant, &FrameSettings::of(scene)).unwrap();
    prepared.aim(&scene.cameras[0].frames[0], DrawOrder::FrontToBack);
    prepared.render().unwrap()
}

/// Normals against a geometry pass that was written by hand.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Normals {
    pub scene: &'static str,
    pub file: &'static str,
    /// Pixels that the one by hand draws.
    pub covered: usize,
    /// The largest difference of a component.
    pub worst: f32,
}

/// Compares the normals of each of [`BY_HAND`].
pub fn normals(gpu: &Gpu, size: [u32; 2]) -> Vec<Normals> {
    let compare = |(name, material, file): (&'static str, &str, &'static str)| {
        let mut scene = load(name, size);
        let all = &scene.materials;
        let index = all.iter().position(|m| m.name == material).unwrap();
        scene.draws.retain(|d| d.material == index);
        scene.materials = vec![scene.materials[index].clone()];
        for draw in &mut scene.draws {
            draw.material = 0;
        }
        let variant = variant(&scene, "outputs:write=normal,precision=full");
        let plan = &variant.plans[0];
        let ours = drawn(gpu, &scene, &[alone(plan)]);
        let theirs = drawn(gpu, &scene, &[by_hand(plan, file)]);
        let depths = theirs.depth.clone().unwrap().values;
        let [ours, theirs] = [ours, theirs].map(|r| r.colors[0].clone().unwrap());
        let (mut covered, mut worst) = (0, 0.0_f32);
        for (pixel, depth) in depths.into_iter().enumerate() {
            covered += usize::from(depth != 0.0 && depth != 1.0);
            for (a, b) in ours.rgba(pixel).into_iter().zip(theirs.rgba(pixel)) {
                worst = worst.max((a - b).abs());
            }
        }
        Normals {
            scene: name,
            file,
            covered,
            worst,
        }
    };
    BY_HAND.into_iter().map(compare).collect()
}
