//! Small scenes made by hand, whose pictures are known without drawing them.
#![allow(dead_code)] // Each test binary uses its own part.

pub mod parts;

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use glam::{Mat4, Vec3};
use preshade_draw::render::{AdapterChoice, FrameSettings, Gpu, Prepared, Rendered, SceneInputs};
use preshade_draw::scene::{
    Camera, Draw, DrawOrder, DrawRange, Frame, Light, Material, Mesh, Scene, Stream, Value,
};
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;
use preshade_plan::state::{DepthDirection, DepthFormat, MaterialState};
use preshade_scenes::ShaderForm;
use shader_text::source::{Language, SourceMap};

/// The adapter of the environment's choice, opened once: some drivers deadlock when many devices
/// come and go in one process. Tests fail without an adapter: a skipped picture proves nothing.
pub fn gpu() -> &'static Gpu {
    static GPU: OnceLock<Gpu> = OnceLock::new();
    GPU.get_or_init(|| {
        let choice = match std::env::var("PRESHADE_ADAPTER") {
            Ok(name) => AdapterChoice::Matching(name),
            Err(_) => AdapterChoice::Best,
        };
        Gpu::new(&choice).unwrap()
    })
}

/// A flat colour from a uniform, on positions that a uniform transforms.
pub const FLAT: &str = "
struct Camera { view_proj: mat4x4<f32> }
struct Object { model: mat4x4<f32>, tint: vec4<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> object: Object;
@vertex fn vs(@location(0) position: vec3<f32>) -> @invariant @builtin(position) vec4<f32> {
    return camera.view_proj * object.model * vec4(position, 1.0);
}
@fragment fn fs() -> @location(0) vec4<f32> { return object.tint; }
";

pub fn program(source: &str) -> Program {
    let mut sources = SourceMap::new();
    sources.add("test.wgsl", source);
    let module = naga::front::wgsl::parse_str(source).unwrap();
    Program::new(module, Arc::new(sources), Language::Wgsl).unwrap()
}

pub fn material(name: &str, source: &str) -> Material {
    Material {
        name: name.to_owned(),
        file: None,
        program: program(source),
        vertex: "vs".to_owned(),
        fragment: Some("fs".to_owned()),
        defines: BTreeMap::new(),
        state: MaterialState::default(),
        values: BTreeMap::new(),
        textures: BTreeMap::new(),
        samplers: BTreeMap::new(),
        attributes: BTreeMap::new(),
        attribute_roles: BTreeMap::new(),
        value_roles: BTreeMap::new(),
        part_of: None,
    }
}

/// A square over -1..1 in x and y at z 0, counter-clockwise in clip space.
pub fn square() -> Mesh {
    Mesh {
        name: "square".to_owned(),
        vertex_count: 4,
        streams: BTreeMap::from([(
            "position".to_owned(),
            Stream::Float {
                components: 3,
                data: vec![
                    -1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 1.0, 1.0, 0.0, -1.0, 1.0, 0.0,
                ],
            },
        )]),
        indices: Some(vec![0, 1, 2, 0, 2, 3]),
        bounds: [Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0)],
    }
}

pub fn draw(name: &str, transform: Mat4, tint: [f64; 4]) -> Draw {
    Draw {
        name: name.to_owned(),
        mesh: 0,
        material: 0,
        transform,
        range: DrawRange::default(),
        instances: 1,
        instance_streams: BTreeMap::new(),
        joints: [].into(),
        morph_weights: Vec::new(),
        values: BTreeMap::from([("object.tint".to_owned(), Value::Numbers(tint.to_vec()))]),
        captured: None,
    }
}

/// A scene that looks along +z from z = -10 with no perspective: world z in 0..1 is depth (or one
/// minus depth).
pub fn scene(size: [u32; 2], materials: Vec<Material>, draws: Vec<Draw>) -> Scene {
    Scene {
        name: "test".to_owned(),
        size,
        viewport: None,
        depth_format: DepthFormat::Depth32float,
        depth_direction: DepthDirection::Forward,
        samples: 1,
        clear_color: [0.0, 0.0, 0.0, 1.0],
        materials,
        meshes: vec![square()],
        draws,
        cameras: vec![Camera {
            name: "front".to_owned(),
            frames: vec![Frame {
                view: Mat4::IDENTITY,
                projection: Mat4::IDENTITY,
                eye: Vec3::new(0.0, 0.0, -10.0),
                time: 0.0,
            }],
        }],
        orders: vec![DrawOrder::FrontToBack, DrawOrder::BackToFront],
        files: Vec::new(),
        is_made_up: false,
        own_size: None,
        part: None,
        initial: Default::default(),
        rows: Default::default(),
        notes: Vec::new(),
        light: Light {
            direction: Vec3::Y,
            color: Vec3::ONE,
            map: 64,
            ..Light::default()
        },
    }
}

/// `n` full-screen squares at depths 1/(n+1), 2/(n+1) and so on, nearest first, each of its own
/// grey.
pub fn planes(size: [u32; 2], n: usize) -> Scene {
    let draws = (1..=n)
        .map(|i| {
            let z = i as f32 / (n + 1) as f32;
            let grey = i as f64 / 255.0;
            draw(
                &format!("plane {i}"),
                Mat4::from_translation(Vec3::new(0.0, 0.0, z)),
                [grey, grey, grey, 1.0],
            )
        })
        .collect();
    scene(size, vec![material("flat", FLAT)], draws)
}

/// Applies the scene-wide depth settings to its materials, as loading a scene file does.
pub fn with_depth(mut scene: Scene, format: DepthFormat, direction: DepthDirection) -> Scene {
    scene.depth_format = format;
    scene.depth_direction = direction;
    for m in &mut scene.materials {
        m.state.depth_format = format;
        m.state.depth_direction = direction;
    }
    if direction == DepthDirection::Reversed {
        for frame in scene.cameras.iter_mut().flat_map(|c| &mut c.frames) {
            frame.projection =
                Mat4::from_translation(Vec3::Z) * Mat4::from_scale(Vec3::new(1.0, 1.0, -1.0));
        }
    }
    scene
}

pub fn with_samples(mut scene: Scene, samples: u32) -> Scene {
    scene.samples = samples;
    for m in &mut scene.materials {
        m.state.multisample.count = samples;
    }
    scene
}

pub use preshade_lab::measure::originals;

/// Draws `plans` as the scene's first camera sees them.
pub fn render_as(
    gpu: &Gpu,
    scene: &Scene,
    plans: &[Plan],
    order: DrawOrder,
    form: ShaderForm,
) -> Rendered {
    let inputs = SceneInputs::new(gpu, scene).unwrap();
    let variant = preshade_scenes::variant(plans, form).unwrap();
    let mut prepared = Prepared::new(&inputs, &variant, &FrameSettings::of(scene)).unwrap();
    let frame = &scene.cameras[0].frames[0];
    inputs.set_frame(frame).unwrap();
    prepared.aim(frame, order);
    prepared.render().unwrap()
}

pub fn render(gpu: &Gpu, scene: &Scene) -> Rendered {
    render_as(
        gpu,
        scene,
        &originals(scene),
        DrawOrder::BackToFront,
        ShaderForm::Text,
    )
}

/// A pre-pass by hand: depth only, then EQUAL without depth write.
pub fn with_prepass(plan: &Plan) -> Plan {
    use preshade_plan::plan::{Phase, Role};
    let mut plan = plan.clone();
    let mut prepass = plan.passes[0].clone();
    prepass.role = Role::Prepass;
    prepass.phase = Phase::Depth;
    prepass.fragment = None;
    prepass.targets.clear();
    preshade_plan::reflect::fill(&mut prepass, &plan.programs["main"]);
    let depth = plan.passes[0].depth.as_mut().unwrap();
    depth.compare = preshade_plan::state::CompareFunction::Equal;
    depth.write = false;
    plan.passes.insert(0, prepass);
    plan
}
