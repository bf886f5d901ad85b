//! The hand-written field of grass: forward, pre-pass, and visibility buffers with a fragment and a
//! compute resolve.

use std::collections::BTreeMap;

use preshade_compiler::front::{self, Source};
use preshade_draw::scene::{Material, Mesh, Scene, Value};
use preshade_lab::measure::handmade;
use preshade_plan::geometry::Geometry;
use preshade_plan::plan::{
    Attachment, BindingKind, BindingSource, BindingUse, ComputePass, Draws, GpuPass, Phase, Plan,
    Role, When,
};
use preshade_plan::program::Program;
use preshade_plan::reflect;
use preshade_plan::state::{ColorTarget, CompareFunction, CullMode, MaterialState};
use shader_text::options::Options;

use crate::Failure;

/// The hand-written forms, and the recipe that should match each.
pub const FORMS: [(&str, &str); 3] = [
    ("pre-pass", "depth-prepass:form=equal"),
    (
        "fragment resolve",
        "visibility-buffer:select=id,budget=0.02",
    ),
    (
        "compute resolve",
        "visibility-buffer:form=compute,budget=0.02",
    ),
];

/// Side of the field, in metres.
const SIDE: f64 = 80.0;

/// Attachment of the hand-written ids.
const IDS: &str = "hand-ids";

/// A number in `[0, 1)` for two integers.
fn random(n: u32, channel: u32) -> f64 {
    let mut h = n.wrapping_mul(0x9e37_79b9) ^ channel.wrapping_mul(0x85eb_ca6b);
    for (shift, factor) in [(16, 0x7feb_352d), (15, 0x846c_a68b)] {
        h = (h ^ (h >> shift)).wrapping_mul(factor);
    }
    f64::from((h ^ (h >> 16)) >> 8) / f64::from(1 << 24)
}

/// Crossed cards on a jittered grid in front of the camera, in random order. An instance has x, z,
/// rotation and height.
fn instances(count: u32) -> Vec<f64> {
    let side = f64::from(count).sqrt().ceil() as u32;
    let cell = SIDE / f64::from(side);
    let mut order: Vec<u32> = (0..count).collect();
    order.sort_by(|a, b| random(*a, 9).total_cmp(&random(*b, 9)));
    let place = |n: u32, i: u32, channel| cell * (f64::from(i) + random(n, channel));
    order
        .into_iter()
        .flat_map(|n| {
            [
                place(n, n % side, 0) - SIDE / 2.0,
                place(n, n / side, 1),
                random(n, 2) * std::f64::consts::TAU,
                0.5 + 0.5 * random(n, 3),
            ]
        })
        .collect()
}

/// The field as a scene: no vertex data, one instance two cards.
pub fn scene(text: &str, size: [u32; 2], count: u32) -> Result<Scene, Failure> {
    let parsed = super::parse(text, ["gvs", "gfs"])?;
    let mut state = MaterialState::default();
    state.primitive.cull = CullMode::None;
    let numbers = |n: f64| Value::Numbers(vec![n]);
    let [w, h] = size.map(f64::from);
    let values = BTreeMap::from([
        ("p.n".to_owned(), numbers(1.0)),
        ("p.layers".to_owned(), numbers(1.0)),
        ("p.w".to_owned(), numbers(w)),
        ("p.h".to_owned(), numbers(h)),
        ("p.inst".to_owned(), numbers(f64::from(count))),
        ("p.freq".to_owned(), numbers(1.0)),
        ("p.order".to_owned(), numbers(0.0)),
        ("p.pad1".to_owned(), numbers(0.0)),
        ("insts".to_owned(), Value::Numbers(instances(count))),
    ]);
    let material = Material {
        values,
        ..handmade::material("bounds", parsed, state)
    };
    let mesh = Mesh {
        name: "cards".to_owned(),
        vertex_count: 12,
        streams: BTreeMap::new(),
        indices: None,
        bounds: Default::default(),
    };
    let draws = vec![handmade::draw("field", count)];
    Ok(Scene {
        // The background of the hand-written resolves.
        clear_color: [0.5, 0.7, 0.9, 1.0],
        ..handmade::scene("handwritten", size, material, mesh, draws)
    })
}

/// A binding of the frozen shaders that is not the scene's.
fn binding(binding: u32, kind: BindingKind, source: BindingSource) -> BindingUse {
    BindingUse::new([0, binding], kind, source)
}

/// A hand-written form as a plan: the frozen entry points, and the state that goes with them.
pub fn handwritten(forward: &Plan, form: &str) -> Result<Plan, Failure> {
    let mut plan = forward.clone();
    let program = plan.programs.get("main").cloned().ok_or("no program")?;
    let main = plan.passes.pop().ok_or("no pass")?;
    if form == "pre-pass" {
        let mut prepass = GpuPass {
            role: Role::Prepass,
            phase: Phase::Depth,
            fragment: Some("gfs_depth".to_owned()),
            targets: Vec::new(),
            draws: Draws::Opaque,
            ..main.clone()
        };
        let mut main = GpuPass {
            fragment: Some("gfs_eq".to_owned()),
            ..main
        };
        if let Some(depth) = &mut main.depth {
            depth.compare = CompareFunction::Equal;
            depth.write = false;
        }
        for pass in [&mut prepass, &mut main] {
            reflect::fill(pass, &program);
        }
        plan.passes = vec![prepass, main];
        return Ok(plan);
    }
    plan.attachments
        .push(Attachment::color(IDS, "rg32uint", [0.0; 4]));
    let mut ids = GpuPass {
        role: Role::Ids,
        phase: Phase::Depth,
        fragment: Some("gfs_id".to_owned()),
        targets: vec![Some(ColorTarget {
            attachment: Some(IDS.to_owned()),
            ..ColorTarget::opaque("rg32uint")
        })],
        draws: Draws::Opaque,
        ..main.clone()
    };
    reflect::fill(&mut ids, &program);
    plan.passes.push(ids);
    let known = vec![
        binding(
            2,
            BindingKind::Texture,
            BindingSource::Attachment {
                name: IDS.to_owned(),
            },
        ),
        binding(
            4,
            BindingKind::StorageTexture,
            BindingSource::SceneColor { location: 0 },
        ),
    ];
    let mut screen = GpuPass {
        role: Role::Resolve,
        phase: Phase::Resolve,
        vertex: "fsq".to_owned(),
        fragment: Some("fs_resolve".to_owned()),
        depth: None,
        bindings: known.clone(),
        draws: Draws::Once,
        geometry: Geometry::FullScreen,
        ..main
    };
    if form == "compute resolve" {
        compute(&mut plan, &program, &known);
        // Draws nothing: the pass exists for its target, which is overwritten.
        screen.role = Role::Clear;
        screen.phase = Phase::Classify;
        screen.fragment = Some("fs".to_owned());
        screen.vertex = "vs".to_owned();
        screen.geometry = Geometry::AsGiven;
        screen.primitive.cull = CullMode::Back;
        for target in screen.targets.iter_mut().flatten() {
            target.write_mask = 0;
        }
        return cleared(plan, screen);
    }
    reflect::fill(&mut screen, &program);
    plan.passes.push(screen);
    Ok(plan)
}

fn compute(plan: &mut Plan, program: &Program, known: &[BindingUse]) {
    let entry = "cs_resolve";
    let mut pass = ComputePass {
        when: When::Behind {
            phase: Phase::Resolve,
        },
        bindings: known.to_vec(),
        ..ComputePass::new("main", entry, 8, Geometry::FullScreen)
    };
    reflect::fill_compute(&mut pass, program);
    plan.compute.push(pass);
}

/// The plan with the pass that clears the target, which is the one that preshade's own compute form
/// has.
fn cleared(mut plan: Plan, like: GpuPass) -> Result<Plan, Failure> {
    let wgsl =
        "@vertex fn vs() -> @builtin(position) vec4<f32> { return vec4<f32>(2.0, 2.0, 0.0, 1.0); }
@fragment fn fs() -> @location(0) vec4<f32> { return vec4<f32>(); }";
    let parsed = front::parse(&[Source::new("clear.wgsl", wgsl)], &Options::default())?;
    let pass = GpuPass {
        program: "clear".to_owned(),
        bindings: Vec::new(),
        geometry: Geometry::FullScreen,
        ..like
    };
    plan.add_pass(pass, parsed.program);
    Ok(plan)
}
