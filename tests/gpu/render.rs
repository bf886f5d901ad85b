//! What is drawn is what a plan says: known pixels, exact depth, every depth format and direction,
//! several samples, viewports.

use glam::{Mat4, Vec3};
use preshade_draw::render::{self, AdapterChoice, Gpu, SceneInputs};
use preshade_draw::scene::DrawOrder;
use preshade_plan::plan::{BindingKind, BindingSource, BindingUse, GpuPass, Plan, SCENE_DEPTH};
use preshade_plan::state::{
    Blend, ColorTarget, CompareFunction, DepthDirection, DepthFormat, Topology,
};
use preshade_scenes::ShaderForm;
use shader_text::limits::Limits;

use crate::render_support::*;

fn texel(image: &render::ColorImage, x: u32, y: u32) -> [u8; 4] {
    let index = (y * image.size[0] + x) as usize;
    image.texel(index).try_into().unwrap()
}

#[test]
fn a_square_covers_exactly_its_pixels() {
    let gpu = gpu();
    // The left half, from x = 0 to 32 of 64.
    let transform = Mat4::from_translation(Vec3::new(-0.5, 0.0, 0.25))
        * Mat4::from_scale(Vec3::new(0.5, 1.0, 1.0));
    let scene = scene(
        [64, 48],
        vec![material("flat", FLAT)],
        vec![draw("left", transform, [1.0, 0.2, 0.0, 0.6])],
    );
    let out = render(gpu, &scene);
    let color = out.colors[0].as_ref().unwrap();
    let depth = out.depth.as_ref().unwrap();
    assert_eq!(color.size, [64, 48]);
    for y in 0..48 {
        for x in 0..64 {
            let inside = x < 32;
            let expected = if inside {
                [255, 51, 0, 153]
            } else {
                [0, 0, 0, 255]
            };
            assert_eq!(texel(color, x, y), expected, "at {x}, {y}");
            assert_eq!(depth.at(x, y, 0), Some(if inside { 0.25 } else { 1.0 }));
        }
    }
}

#[test]
fn both_roads_to_the_driver_draw_the_same_bits() {
    let gpu = gpu();
    let scene = planes([32, 32], 3);
    let plans = originals(&scene);
    let text = render_as(gpu, &scene, &plans, DrawOrder::AsGiven, ShaderForm::Text);
    let ir = render_as(gpu, &scene, &plans, DrawOrder::AsGiven, ShaderForm::Ir);
    assert_eq!(text, ir);
    assert_eq!(
        texel(text.colors[0].as_ref().unwrap(), 5, 5),
        [1, 1, 1, 255]
    );
}

/// Depths that every format under test stores to within its own step.
#[test]
fn depth_is_read_back_exactly_in_every_format_and_direction() {
    let gpu = gpu();
    let formats = [
        (DepthFormat::Depth16unorm, 1.0 / 65_535.0),
        (DepthFormat::Depth24plus, 1.0 / 16_777_215.0),
        (DepthFormat::Depth24plusStencil8, 1.0 / 16_777_215.0),
        (DepthFormat::Depth32float, 0.0),
        (DepthFormat::Depth32floatStencil8, 0.0),
    ];
    for (format, step) in formats {
        for direction in [DepthDirection::Forward, DepthDirection::Reversed] {
            let scene = with_depth(planes([16, 16], 3), format, direction);
            let out = render(gpu, &scene);
            let depth = out.depth.unwrap();
            assert_eq!(depth.values.len(), 256);
            // The nearest plane wins, whichever way depth grows; its depth is a power of two, exact
            // as a float.
            let expected = match direction {
                DepthDirection::Forward => 0.25_f32,
                DepthDirection::Reversed => 0.75,
            };
            for v in &depth.values {
                assert!(
                    (v - expected).abs() <= step,
                    "{format:?} {direction:?}: {v} is not {expected}"
                );
            }
            if let DepthFormat::Depth16unorm = format {
                let n = depth.values[0] * 65_535.0;
                assert_eq!(n, n.round(), "16-bit depths are whole steps");
            }
            assert_eq!(
                texel(out.colors[0].as_ref().unwrap(), 8, 8),
                [1, 1, 1, 255],
                "{format:?} {direction:?}"
            );
        }
    }
}

#[test]
fn every_sample_has_its_own_depth() {
    let gpu = gpu();
    // A diagonal edge: the upper left triangle of the square.
    let mut scene = with_samples(planes([16, 16], 1), 4);
    scene.meshes[0].indices = Some(vec![0, 2, 3]);
    for format in [DepthFormat::Depth32float, DepthFormat::Depth24plus] {
        let scene = with_depth(scene.clone(), format, DepthDirection::Forward);
        let out = render(gpu, &scene);
        let depth = out.depth.unwrap();
        assert_eq!((depth.samples, depth.values.len()), (4, 16 * 16 * 4));
        let at = |x: u32, y: u32| {
            (0..4)
                .map(|s| depth.at(x, y, s).unwrap())
                .collect::<Vec<_>>()
        };
        assert!(at(2, 2).iter().all(|d| (d - 0.5).abs() < 1e-6));
        assert_eq!(at(13, 13)[0], 1.0);
        // On the diagonal some samples are covered and some are not, and the colour is their mean.
        let covered = at(8, 7).iter().filter(|d| **d < 1.0).count()
            + at(8, 8).iter().filter(|d| **d < 1.0).count();
        assert!((1..8).contains(&covered), "{covered} of 8");
        assert_eq!(out.colors[0].as_ref().unwrap().size, [16, 16]);
    }
}

/// Both materials draw one box: OpenGL's depths, from -1 to 1, are those of WebGPU on the screen.
#[test]
fn a_material_of_opengl_has_the_depths_of_its_neighbour() {
    let dir = tempfile::tempdir().unwrap();
    let wgsl = "@group(0) @binding(0) var<uniform> mvp: mat4x4f;
        @vertex fn vs(@location(0) position: vec3f) -> @builtin(position) vec4f {
            return mvp * vec4f(position, 1.0);
        }
        @fragment fn fs() -> @location(0) vec4f { return vec4f(1.0); }";
    let frag = "#version 330
        layout(location = 0) out vec4 color;
        void main() { color = vec4(1.0); }";
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    write("own.wgsl", wgsl);
    write("gl.frag", frag);
    let drawn = |material: &str| {
        let scene = format!(
            "size = [48, 32]\n{material}\n[meshes]\nblock.box = {{ size = [1, 2, 1] }}\n\
             [[draws]]\nmesh = \"block\"\nmaterial = \"only\"\nrotate = [20, 30, 0]\n\
             [[cameras]]\neye = [2, 2, 4]\ntarget = [0, 0, 0]\n"
        );
        let file = dir.path().join("scene.toml");
        std::fs::write(&file, scene).unwrap();
        let scene = preshade_scenes::load(&file).unwrap_or_else(|e| panic!("{}", e.render()));
        render(gpu(), &scene).depth.unwrap().values
    };
    let webgpu = drawn("materials.only.shader = \"own.wgsl\"");
    let covered = webgpu.iter().filter(|d| **d < 1.0).count();
    assert!(covered > 50, "{covered}");
    for (uniforms, matrix) in [
        ("uniform mat4 mvp;", "mvp"),
        (
            "uniform mat4 projection; uniform mat4 view; uniform mat4 model;",
            "projection * view * model",
        ),
        (
            "uniform mat4 inverseProjection; uniform mat4 modelView;",
            "inverse(inverseProjection) * modelView",
        ),
    ] {
        write(
            "gl.vert",
            &format!(
                "#version 330\n{uniforms}\nlayout(location = 0) in vec3 position;\n\
                 void main() {{ gl_Position = {matrix} * vec4(position, 1.0); }}"
            ),
        );
        let opengl = drawn("materials.only = { vertex = \"gl.vert\", fragment = \"gl.frag\" }");
        for (a, b) in webgpu.iter().zip(&opengl) {
            assert!((a - b).abs() < 1e-5, "{matrix}: {a} {b}");
        }
    }
}

#[test]
fn a_viewport_confines_the_picture() {
    let gpu = gpu();
    let mut scene = planes([32, 32], 2);
    scene.viewport = Some([8, 4, 16, 20]);
    let out = render(gpu, &scene);
    let color = out.colors[0].as_ref().unwrap();
    for y in 0..32 {
        for x in 0..32 {
            let inside = (8..24).contains(&x) && (4..24).contains(&y);
            let expected = if inside {
                [1, 1, 1, 255]
            } else {
                [0, 0, 0, 255]
            };
            assert_eq!(texel(color, x, y), expected, "at {x}, {y}");
        }
    }
}

#[test]
fn blended_draws_come_last_and_back_to_front() {
    let gpu = gpu();
    let mut opaque = material("flat", FLAT);
    opaque.state.targets = vec![Some(ColorTarget::opaque("rgba8unorm"))];
    let mut glass = material("glass", FLAT);
    glass.state.depth_write = false;
    glass.state.targets = vec![Some(ColorTarget {
        blend: Some(Blend::ALPHA),
        ..ColorTarget::opaque("rgba8unorm")
    })];
    let at = |z: f32| Mat4::from_translation(Vec3::new(0.0, 0.0, z));
    let mut near = draw("near glass", at(0.2), [1.0, 0.0, 0.0, 0.4]);
    let mut far = draw("far glass", at(0.4), [0.0, 1.0, 0.0, 0.4]);
    (near.material, far.material) = (1, 1);
    // Given in the worst order there is.
    let draws = vec![near, far, draw("wall", at(0.8), [0.0, 0.0, 1.0, 1.0])];
    let scene = scene([8, 8], vec![opaque, glass], draws);
    let out = render(gpu, &scene);
    // (0.6 blue + 0.4 green) * 0.6 + 0.4 red, each step stored in 8 bits and none of them near a
    // tie: 153, 102; then 102, 61.2, 91.8.
    let texel = texel(out.colors[0].as_ref().unwrap(), 4, 4);
    assert_eq!(texel[..3], [102, 61, 92]);
}

#[test]
fn materials_with_fewer_targets_leave_the_others_alone() {
    let gpu = gpu();
    let two = FLAT.replace(
        "@fragment fn fs() -> @location(0) vec4<f32> { return object.tint; }",
        "struct Out { @location(0) a: vec4<f32>, @location(1) b: vec4<f32> }
         @fragment fn fs() -> Out { return Out(object.tint, vec4(0.0, 2.5, 0.0, 1.0)); }",
    );
    let mut both = material("both", &two);
    both.state.targets = vec![
        Some(ColorTarget::opaque("rgba8unorm")),
        Some(ColorTarget::opaque("rgba16float")),
    ];
    let mut one = material("one", FLAT);
    one.state.targets = vec![Some(ColorTarget::opaque("rgba8unorm"))];
    let at = |z: f32| Mat4::from_translation(Vec3::new(0.0, 0.0, z));
    let far = draw("far", at(0.8), [0.0, 0.0, 1.0, 1.0]);
    let mut near = draw("near", at(0.2), [1.0, 0.0, 0.0, 1.0]);
    near.material = 1;
    let scene = scene([8, 8], vec![both, one], vec![far, near]);
    let out = render(gpu, &scene);
    assert_eq!(
        texel(out.colors[0].as_ref().unwrap(), 0, 0),
        [255, 0, 0, 255]
    );
    assert_eq!(
        out.colors[1].as_ref().unwrap().rgba(0),
        [0.0, 2.5, 0.0, 1.0]
    );
}

#[test]
fn strips_and_unindexed_meshes_draw() {
    let gpu = gpu();
    let mut scene = planes([8, 8], 1);
    scene.materials[0].state.primitive.topology = Topology::TriangleStrip;
    scene.meshes[0].indices = Some(vec![0, 1, 3, 2]);
    let strip = render(gpu, &scene);
    scene.meshes[0] = square();
    scene.materials[0].state.primitive.topology = Topology::TriangleList;
    let list = render(gpu, &scene);
    assert_eq!(strip, list);
    scene.meshes[0].indices = None;
    scene.meshes[0].vertex_count = 3;
    let corner = render(gpu, &scene);
    assert_eq!(
        texel(corner.colors[0].as_ref().unwrap(), 7, 7),
        [1, 1, 1, 255]
    );
    assert_eq!(
        texel(corner.colors[0].as_ref().unwrap(), 0, 0),
        [0, 0, 0, 255]
    );
}

#[test]
fn a_prepass_draws_the_same_picture_and_depth() {
    let gpu = gpu();
    for samples in [1, 4] {
        let scene = with_samples(planes([32, 32], 4), samples);
        let plans = originals(&scene);
        let variant: Vec<Plan> = plans.iter().map(with_prepass).collect();
        assert!(!variant[0].passes[0].bindings[0].visibility.fragment);
        for order in [DrawOrder::FrontToBack, DrawOrder::Shuffled] {
            let a = render_as(gpu, &scene, &plans, order, ShaderForm::Text);
            let b = render_as(gpu, &scene, &variant, order, ShaderForm::Text);
            assert_eq!(a, b);
        }
    }
}

/// A main pass that reads the depth of a pre-pass while that depth is attached read-only.
fn reading_depth(plan: &Plan, kind: BindingKind, samples: u32) -> Plan {
    let (ty, channel, level) = match (kind, samples) {
        (BindingKind::DepthTexture, 1) => ("texture_depth_2d", "", "0"),
        (BindingKind::DepthTexture, _) => ("texture_depth_multisampled_2d", "", "0"),
        (_, 1) => ("texture_2d<f32>", ".x", "0"),
        _ => ("texture_multisampled_2d<f32>", ".x", "0"),
    };
    let source = FLAT.replace(
        "@fragment fn fs() -> @location(0) vec4<f32> { return object.tint; }",
        &format!(
            "@group(2) @binding(3) var scene_depth: {ty};
             @fragment fn fs(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {{
                 if (at.z > textureLoad(scene_depth, vec2<i32>(at.xy), {level}){channel}) {{ \
                     discard; }}
                 return object.tint;
             }}"
        ),
    );
    let mut plan = with_prepass(plan);
    let shader = program(&source);
    let main: &mut GpuPass = &mut plan.passes[1];
    main.program = "reading".to_owned();
    let name = SCENE_DEPTH.to_owned();
    let source = BindingSource::Attachment { name };
    main.bindings.push(BindingUse::new([2, 3], kind, source));
    preshade_plan::reflect::fill(main, &shader);
    let depth = main.depth.as_mut().unwrap();
    depth.compare = CompareFunction::LessEqual;
    depth.read_only = true;
    plan.programs.insert("reading".to_owned(), shader);
    plan.attachments[0].sampled = true;
    plan
}

#[test]
fn depth_can_be_read_while_it_is_attached_read_only() {
    let gpu = gpu();
    for samples in [1, 4] {
        for kind in [BindingKind::DepthTexture, BindingKind::Texture] {
            let scene = with_samples(planes([32, 32], 4), samples);
            let plans = originals(&scene);
            let variant: Vec<Plan> = plans
                .iter()
                .map(|p| reading_depth(p, kind, samples))
                .collect();
            let order = DrawOrder::BackToFront;
            let a = render_as(gpu, &scene, &plans, order, ShaderForm::Text);
            let b = render_as(gpu, &scene, &variant, order, ShaderForm::Text);
            assert_eq!(a, b, "{kind:?} x{samples}");
        }
    }
}

#[test]
fn a_forgotten_requirement_is_an_error() {
    let gpu = gpu();
    let scene = planes([8, 8], 1);
    let inputs = SceneInputs::new(gpu, &scene).unwrap();
    let prepare = |plan: Plan| {
        let variant = preshade_scenes::variant(&[plan], ShaderForm::Text).unwrap();
        let settings = render::FrameSettings::of(&scene);
        render::Prepared::new(&inputs, &variant, &settings)
            .unwrap_err()
            .to_string()
    };
    let plan = reading_depth(&originals(&scene)[0], BindingKind::DepthTexture, 1);
    // The attachment is not marked as sampled.
    let mut wrong = plan.clone();
    wrong.attachments[0].sampled = false;
    let message = prepare(wrong);
    assert!(message.contains("does not mark as sampled"), "{message}");
    // A binding of the shader is not listed.
    let mut wrong = plan.clone();
    wrong.passes[1].bindings.retain(|b| b.group != 2);
    let message = prepare(wrong);
    assert!(
        message.contains("the pipeline of pass `reading` of material `flat`"),
        "{message}"
    );
    // A binding is not visible to the stage that uses it.
    let mut wrong = plan.clone();
    wrong.passes[1].bindings[1].visibility.vertex = false;
    let message = prepare(wrong);
    assert!(
        message.contains("the pipeline of pass `reading`"),
        "{message}"
    );
    // A feature nobody has.
    let mut wrong = plan;
    wrong.passes[1].features.push("time-travel".to_owned());
    let message = prepare(wrong);
    assert!(message.contains("needs time-travel"), "{message}");
}

#[test]
fn a_frame_without_pixels_is_an_error() {
    let gpu = gpu();
    let scene = planes([0, 8], 1);
    let inputs = SceneInputs::new(gpu, &scene).unwrap();
    let variant = preshade_scenes::variant(&originals(&scene), ShaderForm::Text).unwrap();
    let settings = render::FrameSettings::of(&scene);
    let error = render::Prepared::new(&inputs, &variant, &settings).unwrap_err();
    assert_eq!(error.to_string(), "cannot draw a frame of 0x8 pixels");
}

#[test]
fn an_adapter_that_is_not_there_is_named() {
    let error = Gpu::new(&AdapterChoice::Matching("Voodoo 5 6000".to_owned())).unwrap_err();
    let message = error.to_string();
    assert!(
        message.contains("`Voodoo 5 6000`") && message.contains("there are:"),
        "{message}"
    );
    let none = render::Error::NoAdapter {
        wanted: None,
        found: Vec::new(),
    };
    assert!(none.to_string().contains("mesa-vulkan-drivers libvulkan1"));
}

#[test]
fn adapters_are_listed_with_what_they_can_measure() {
    let gpu = gpu();
    let listed = render::adapters();
    assert!(listed.iter().any(|a| a == gpu.adapter()), "{listed:?}");
}

/// Divides by 0 and reads past the end of an array, by numbers that no compiler knows.
const ASTRAY: &str = "
struct Camera { view_proj: mat4x4<f32> }
struct Object { model: mat4x4<f32>, tint: vec4<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> object: Object;
@vertex fn vs(@location(0) position: vec3<f32>) -> @invariant @builtin(position) vec4<f32> {
    return camera.view_proj * object.model * vec4(position, 1.0);
}
@fragment fn fs() -> @location(0) vec4<f32> {
    let none = u32(object.tint.x);
    var steps = array<u32, 4>(10u, 20u, 30u, 40u);
    steps[none] = 50u;
    return vec4(f32(51u / none), f32(51u % none), f32(steps[none + 4099u]), 255.0) / 255.0;
}
";

#[test]
fn strangers_shaders_are_compiled_with_checks_and_the_report_says_so() {
    let choice =
        std::env::var("PRESHADE_ADAPTER").map_or(AdapterChoice::Best, AdapterChoice::Matching);
    let strict = Gpu::with_trust(&choice, Limits::strict().trust()).unwrap();
    assert!(strict.adapter().checked_shaders);
    assert!(strict.adapter().title().ends_with(" with checked shaders"));
    assert!(!gpu().adapter().checked_shaders && gpu().adapter().title() == gpu().adapter().name);
    let json = |gpu: &Gpu| serde_json::to_value(gpu.adapter()).unwrap();
    assert_eq!(json(&strict)["checked_shaders"], true);
    let scene = scene(
        [4, 4],
        vec![material("astray", ASTRAY)],
        vec![draw("square", Mat4::IDENTITY, [0.0; 4])],
    );
    // Numbers of WGSL's: x / 0 is x, x % 0 is 0, and an index past the end is the last one.
    for form in [ShaderForm::Text, ShaderForm::Ir] {
        let order = DrawOrder::AsGiven;
        let out = render_as(&strict, &scene, &originals(&scene), order, form);
        let color = out.colors[0].as_ref().unwrap();
        assert_eq!(texel(color, 1, 1), [51, 0, 40, 255], "{form:?}");
    }
}
