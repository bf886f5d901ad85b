//! `early-discard` drawn: nothing that is seen changes, what is hidden is dropped, and what cannot
//! hold is refused.

use std::path::Path;

use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{FrameSettings, Prepared, Rendered, SceneInputs};
use preshade_draw::scene::{DrawOrder, Scene};
use preshade_lab::measure::{self, Counter, ErrorLadder, counting};
use preshade_passes::transforms::early_discard::PREPASS_PACKED;
use preshade_plan::budget::Budget;
use preshade_plan::contract::Contract;
use preshade_plan::pass::{Facts, Refusal};
use preshade_plan::plan::{AttachmentFormat, BindingSource, ClearValue, Plan, Role};
use preshade_plan::state::{CompareFunction, DepthBias, DepthDirection, DepthFormat};
use preshade_scenes::ShaderForm;

use crate::render_support::{gpu, planes, with_depth, with_samples};
use preshade_lab::measure::originals;

const ORDERS: [DrawOrder; 2] = [DrawOrder::BackToFront, DrawOrder::Shuffled];

fn scene(name: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/scenes")
        .join(name);
    preshade_scenes::load(&path).unwrap().resized([160, 90])
}

/// Five layers of a textured material that fill the screen, seen at a slant. `edit` makes the
/// fixture's text another.
fn layers(name: &str, edit: impl Fn(String) -> String) -> Scene {
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/shaders/textured.wgsl");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let shader = edit(std::fs::read_to_string(fixture).unwrap());
    std::fs::write(folder.join(format!("{name}.wgsl")), shader).unwrap();
    let path = folder.join(format!("{name}.toml"));
    let text = format!(
        r#"
size = [160, 90]
[materials.layer]
shader = "{name}.wgsl"
textures.albedo = {{ pattern = "checker", srgb = true }}
samplers.albedo_sampler = {{ anisotropy = 4 }}
values = {{ "light.ambient" = [0.2, 0.22, 0.25] }}
[meshes]
layer.plane = {{ size = [24, 14], segments = [8, 4] }}
[[draws]]
mesh = "layer"
material = "layer"
translate = [0, 0, -1]
rotate = [70, 0, 0]
field = {{ count = [1, 5, 1], spacing = [0, -0.45, 0], as = "draws" }}
[[cameras]]
eye = [0, 0, 0]
target = [0, 0, -1]
near = 0.1
far = 40
"#
    );
    std::fs::write(&path, text).unwrap();
    preshade_scenes::load(&path).unwrap()
}

/// The fixture's one sample.
const SAMPLE: &str = "textureSample(albedo, albedo_sampler, in.uv)";

fn apply(plan: &Plan, recipe: &str) -> Result<Plan, Box<Refusal>> {
    Recipe::parse([recipe])
        .unwrap()
        .apply(plan, &Facts::default())
}

/// The recipe on every opaque material of a scene, none of which may refuse it.
fn transformed(scene: &Scene, recipe: &str) -> Vec<Plan> {
    let is_blended = |p: &Plan| p.passes[0].targets.iter().flatten().any(|t| t.is_blended());
    originals(scene)
        .into_iter()
        .map(|p| match is_blended(&p) {
            true => p,
            false => apply(&p, recipe).unwrap(),
        })
        .collect()
}

fn draw(scene: &Scene, plans: &[Plan], form: ShaderForm) -> Vec<Rendered> {
    let inputs = SceneInputs::new(gpu(), scene).unwrap();
    let variant = preshade_scenes::variant(plans, form).unwrap();
    let mut prepared = Prepared::new(&inputs, &variant, &FrameSettings::of(scene)).unwrap();
    let mut pictures = Vec::new();
    for (_, frame) in scene.frames() {
        inputs.set_frame(frame).unwrap();
        for order in ORDERS {
            prepared.aim(frame, order);
            pictures.push(prepared.render().unwrap());
        }
    }
    pictures
}

fn error(scene: &Scene, plans: &[Plan]) -> ErrorLadder {
    let original = draw(scene, &originals(scene), ShaderForm::Text);
    let variant = draw(scene, plans, ShaderForm::Text);
    original
        .iter()
        .zip(&variant)
        .map(|(o, v)| measure::compare(o, v).unwrap())
        .fold(ErrorLadder::default(), |a, b| a.worst(&b))
}

fn assert_exact(what: &str, scene: &Scene, plans: &[Plan]) {
    let error = error(scene, plans);
    assert!(error.is_exact(), "{what}: {error:?}");
    assert_eq!(error.changed_depth, 0, "{what}: {error:?}");
}

/// Shaded fragments per covered pixel, drawn back to front.
fn shaded_per_pixel(scene: &Scene, plans: &[Plan]) -> f64 {
    let inputs = SceneInputs::new(gpu(), scene).unwrap();
    let mut counter = Counter::shaded(&inputs, plans, ShaderForm::Text, counting).unwrap();
    let frame = &scene.cameras[0].frames[0];
    inputs.set_frame(frame).unwrap();
    let shading = counter.count(frame, DrawOrder::BackToFront).unwrap();
    assert!(shading.covered > 0);
    shading.summary().per_pixel
}

/// Fragments of the main pass that do their work, whatever the depth test makes of them after it:
/// what a material that writes depth is charged for.
fn worked_per_pixel(scene: &Scene, plans: &[Plan]) -> f64 {
    let mut plans = plans.to_vec();
    for pass in plans.iter_mut().flat_map(|p| &mut p.passes) {
        if let (Role::Main, Some(depth)) = (pass.role, &mut pass.depth) {
            depth.compare = CompareFunction::Always;
            depth.write = false;
        }
    }
    shaded_per_pixel(scene, &plans)
}

#[test]
fn packed_depth_changes_nothing() {
    for name in [
        "simple.toml",
        "reversed-z.toml",
        "reversed-z-finite.toml",
        "frag-depth.toml",
        "log-depth.toml",
        "d16.toml",
        "viewport.toml",
    ] {
        let scene = scene(name);
        let plans = transformed(&scene, "early-discard:texture=packed");
        assert_exact(name, &scene, &plans);
    }
}

#[test]
fn packed_depth_is_exact_as_ir_too_and_drops_as_much_as_a_depth_texture() {
    let scene = scene("simple.toml");
    let packed = transformed(&scene, "early-discard:texture=packed");
    let original = draw(&scene, &originals(&scene), ShaderForm::Ir);
    assert_eq!(original, draw(&scene, &packed, ShaderForm::Ir));
    let overdraw = self::scene("overdraw-5.toml");
    for direction in [DepthDirection::Forward, DepthDirection::Reversed] {
        let planes = with_depth(planes([32, 32], 5), DepthFormat::Depth32float, direction);
        for scene in [&overdraw, &planes] {
            let [packed, depth] = ["early-discard:texture=packed", "early-discard"]
                .map(|recipe| shaded_per_pixel(scene, &transformed(scene, recipe)));
            assert_eq!((packed, depth), (1.0, 1.0), "{}", scene.name);
        }
    }
}

#[test]
fn a_packed_plan_says_where_the_depth_is() {
    for (direction, far) in [
        (DepthDirection::Forward, 1.0),
        (DepthDirection::Reversed, 0.0),
    ] {
        let scene = with_depth(planes([8, 8], 2), DepthFormat::Depth32float, direction);
        let plan = &transformed(&scene, "early-discard:texture=packed")[0];
        let packed = plan.attachment(PREPASS_PACKED).unwrap();
        assert_eq!(
            packed.format,
            AttachmentFormat::Color("rgba8unorm".to_owned())
        );
        assert_eq!(packed.clear, ClearValue::Color([far; 4]));
        let target = plan.passes[0].targets[0].as_ref().unwrap();
        assert_eq!(
            (plan.passes[0].role, target.attachment.as_deref()),
            (Role::Prepass, Some(PREPASS_PACKED))
        );
        let main = plan.main().unwrap();
        let from = |name: &str| BindingSource::Attachment {
            name: name.to_owned(),
        };
        assert!(
            main.bindings
                .iter()
                .any(|b| b.source == from(PREPASS_PACKED))
        );
        let json = serde_json::to_value(plan).unwrap();
        let listed = json["attachments"].as_array().unwrap();
        assert!(listed.iter().any(|a| a["format"] == "rgba8unorm"
            && a["clear"] == serde_json::json!([far, far, far, far])));
    }
}

#[test]
fn what_packing_cannot_hold_is_refused() {
    let scene = planes([8, 8], 2);
    let code = |scene: &Scene, recipe: &str| apply(&originals(scene)[0], recipe).unwrap_err().code;
    assert_eq!(
        code(&scene, "early-discard:texture=packed,attachment=readonly"),
        "packed-readonly"
    );
    let multisampled = with_samples(scene.clone(), 4);
    assert_eq!(
        code(&multisampled, "early-discard:texture=packed"),
        "packed-msaa"
    );
}

#[test]
fn a_bias_toward_the_viewer_is_refused() {
    for (direction, constant) in [(DepthDirection::Forward, -4), (DepthDirection::Reversed, 4)] {
        let mut scene = with_depth(planes([8, 8], 2), DepthFormat::Depth32float, direction);
        let bias = |constant| DepthBias {
            constant,
            ..DepthBias::default()
        };
        scene.materials[0].state.depth_bias = bias(constant);
        let refusal = apply(&originals(&scene)[0], "early-discard").unwrap_err();
        assert_eq!(refusal.code, "depth-bias");
        scene.materials[0].state.depth_bias = bias(-constant);
        assert_exact("away", &scene, &transformed(&scene, "early-discard"));
    }
}

#[test]
fn lanes_with_gradients_taken_first_need_a_budget() {
    let scene = layers("lane-budget", |text| text);
    let original = &originals(&scene)[0];
    let refused = |recipe: &str| apply(original, recipe).unwrap_err();
    let refusal = refused("early-discard:quad=lane");
    assert_eq!(refusal.code, "lane-needs-budget");
    assert!(refusal.remedy.contains("quad=vote") && refusal.remedy.contains("budget=0.02"));
    assert!(refusal.location.is_some());
    for budget in ["-0.1", "1.5"] {
        let recipe = format!("early-discard:quad=lane,budget={budget}");
        assert!(Recipe::parse([&recipe]).is_err(), "{recipe}");
    }
    // A picture of what is saved promises nothing, and a vote touches no sample.
    for recipe in ["early-discard:quad=lane,mode=invert", "early-discard"] {
        apply(original, recipe).unwrap();
    }
    let plan = apply(original, "early-discard:quad=lane,budget=0.02").unwrap();
    let files = preshade_compiler::emit::emit(
        &plan,
        &[preshade_plan::plan_file::Target::Wgsl],
        &preshade_compiler::emit::Options::default(),
    )
    .unwrap();
    let main = files
        .iter()
        .find(|f| f.name.ends_with(".main.wgsl"))
        .unwrap();
    let text = String::from_utf8(main.bytes.clone()).unwrap();
    assert!(
        text.contains("dpdxCoarse(") && text.contains("dpdyCoarse("),
        "{text}"
    );
}

#[test]
fn lanes_leave_one_by_one_with_gradients_taken_first() {
    let biased = "textureSampleBias(albedo, albedo_sampler, in.uv * 3.0, 1.5) * (1.0 - \
                  min(length(fwidth(in.uv)), 0.5))";
    for (name, sample) in [("lane-auto", SAMPLE), ("lane-bias", biased)] {
        let scene = layers(name, |text| text.replace(SAMPLE, sample));
        let plans = transformed(&scene, "early-discard:quad=lane,budget=0.02");
        let Contract::Approximate { budget, .. } = &plans[0].contract else {
            panic!("{:?}", plans[0].contract);
        };
        let error = error(&scene, &plans);
        assert_eq!(*budget, Budget::max_abs(0.02));
        assert!(budget.allows(&error), "{name}: {error:?}");
        assert_eq!(error.changed_depth, 0, "{name}: {error:?}");
        let before = shaded_per_pixel(&scene, &originals(&scene));
        let after = shaded_per_pixel(&scene, &plans);
        assert!(before > 3.0, "{name}: {before}");
        assert!((1.0..1.01).contains(&after), "{name}: {after}");
    }
}

#[test]
fn lanes_stay_where_a_derivative_cannot_come_first() {
    let refused = |name: &str, edit: &dyn Fn(String) -> String| {
        let scene = layers(name, edit);
        let refusal = apply(&originals(&scene)[0], "early-discard:quad=lane").unwrap_err();
        let location = refusal.location.unwrap_or_else(|| panic!("{name}"));
        (refusal.code, location.line)
    };
    let line = |text: &str| {
        let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/shaders/textured.wgsl");
        let source = std::fs::read_to_string(fixture).unwrap();
        1 + source.lines().position(|l| l.contains(text)).unwrap() as u32
    };
    let at_sample = line(SAMPLE);
    // A dependent read, a variable, and a sample in a callee.
    let dependent =
        "textureSample(albedo, albedo_sampler, textureLoad(albedo, vec2<i32>(0), 0).xy)";
    let spoils = "lane-spoils-derivatives".to_owned();
    assert_eq!(
        refused("lane-dependent", &|t| t.replace(SAMPLE, dependent)),
        (spoils.clone(), at_sample)
    );
    assert_eq!(
        refused("lane-variable", &|t| t
            .replace(
                "    let base = ",
                "    var uv = in.uv; uv *= 2.0; let base = "
            )
            .replace(SAMPLE, "textureSample(albedo, albedo_sampler, uv)")),
        (spoils.clone(), at_sample)
    );
    assert_eq!(
        refused("lane-callee", &|t| format!(
            "{}\nfn look(uv: vec2<f32>) -> vec4<f32> {{ \
             return textureSample(albedo, albedo_sampler, uv); }}\n",
            t.replace(SAMPLE, "look(in.uv)")
        ))
        .0,
        spoils
    );
    // An alpha test by a sample would round otherwise than in the pre-pass.
    assert_eq!(
        refused("lane-alpha", &|t| t.replace(
            "    let lambert",
            "    if base.a < 0.5 { discard; }\n    let lambert"
        )),
        ("lane-decides-coverage".to_owned(), at_sample)
    );
}

#[test]
fn lanes_without_derivatives_are_exact() {
    let scene = scene("overdraw-5.toml");
    let plans = transformed(&scene, "early-discard:quad=lane");
    assert!(matches!(plans[0].contract, Contract::Exact { .. }));
    assert_exact("overdraw-5", &scene, &plans);
    assert_eq!(shaded_per_pixel(&scene, &plans), 1.0);
}

#[test]
fn inverting_draws_what_would_be_saved() {
    // One layer hides nothing; of three the second is the nearest hidden one.
    for quad in ["vote", "lane"] {
        let recipe = format!("early-discard:mode=invert,quad={quad}");
        for (layers, seen) in [(1, 0), (2, 2), (3, 2)] {
            let scene = planes([16, 16], layers);
            for picture in draw(&scene, &transformed(&scene, &recipe), ShaderForm::Text) {
                let color = picture.colors[0].as_ref().unwrap();
                let pixels = color.bytes.as_chunks::<4>().0;
                assert!(
                    pixels.iter().all(|p| *p == [seen, seen, seen, 255]),
                    "{recipe} x{layers}: {:?}",
                    pixels[0]
                );
            }
        }
    }
    let scene = planes([8, 8], 2);
    let recipe = "early-discard:mode=invert,attachment=readonly";
    let refusal = apply(&originals(&scene)[0], recipe).unwrap_err();
    assert_eq!(refusal.code, "readonly-invert");
}

#[test]
fn inverting_and_culling_share_out_the_fragments() {
    let scene = scene("simple.toml");
    // Whatever the depth test makes of them.
    let fragments = |recipe: Option<&str>| {
        let mut plans = recipe.map_or_else(|| originals(&scene), |r| transformed(&scene, r));
        for pass in plans.iter_mut().flat_map(|p| &mut p.passes) {
            if let (Role::Main, Some(depth)) = (pass.role, &mut pass.depth) {
                depth.compare = CompareFunction::Always;
                depth.write = false;
            }
        }
        let inputs = SceneInputs::new(gpu(), &scene).unwrap();
        let mut counter = Counter::shaded(&inputs, &plans, ShaderForm::Text, counting).unwrap();
        let frame = &scene.cameras[0].frames[0];
        inputs.set_frame(frame).unwrap();
        counter.count(frame, DrawOrder::AsGiven).unwrap().fragments
    };
    let (kept, saved) = (
        fragments(Some("early-discard")),
        fragments(Some("early-discard:mode=invert")),
    );
    assert!(saved > 0);
    assert_eq!(kept + saved, fragments(None));
}

#[test]
fn a_fixed_tolerance_is_an_option() {
    let scene = scene("simple.toml");
    let plans = transformed(&scene, "early-discard:tolerance=0.0001");
    assert_exact("0.0001", &scene, &plans);
    // Nearer to each other than the article's tolerance: it drops nothing, where the derived one
    // does.
    let mut close = planes([16, 16], 2);
    for (i, draw) in close.draws.iter_mut().enumerate() {
        draw.transform.w_axis.z = 0.99 + 0.00005 * i as f32;
    }
    for (recipe, shaded) in [
        ("early-discard:tolerance=0.0001", 2.0),
        ("early-discard", 1.0),
    ] {
        let plans = transformed(&close, recipe);
        assert_eq!(shaded_per_pixel(&close, &plans), shaded, "{recipe}");
        assert_exact(recipe, &close, &plans);
    }
    assert!(Recipe::parse(["early-discard:tolerance=-1"]).is_err());
}

#[test]
fn the_slot_is_free_or_the_one_asked_for() {
    let scene = planes([16, 16], 3);
    let slot = |plan: &Plan| {
        let bindings = plan.main().unwrap().bindings.iter();
        let found: Vec<_> = bindings
            .filter(|b| b.source != BindingSource::Author)
            .map(|b| (b.group, b.binding, b.name.clone()))
            .collect();
        assert_eq!(found.len(), 1, "{found:?}");
        found[0].clone()
    };
    for (recipe, expected) in [
        ("early-discard", (1, 1)),
        ("early-discard:group=3,binding=7", (3, 7)),
        ("early-discard:group=0", (0, 1)),
        ("early-discard:binding=5", (1, 5)),
    ] {
        let plans = transformed(&scene, recipe);
        let (group, binding, name) = slot(&plans[0]);
        assert_eq!(
            ((group, binding), name.as_str()),
            (expected, "prepass_depth")
        );
        assert_exact(recipe, &scene, &plans);
    }
    let refusal = apply(&originals(&scene)[0], "early-discard:group=1,binding=0").unwrap_err();
    assert_eq!(refusal.code, "binding-taken");
    assert!(refusal.reason.contains("`object`"), "{}", refusal.reason);
    let refusal = apply(&originals(&scene)[0], "early-discard:group=4").unwrap_err();
    assert_eq!(refusal.code, "group-limit");
}

#[test]
fn multisampled_depth_holds_every_sample() {
    let scene = scene("msaa.toml");
    for recipe in ["early-discard", "early-discard:texture=float"] {
        let plans = transformed(&scene, recipe);
        assert_exact(recipe, &scene, &plans);
        let [before, after] = [&originals(&scene), &plans].map(|p| shaded_per_pixel(&scene, p));
        assert!(after < before, "{recipe}: {before} before, {after} after");
    }
}

#[test]
fn it_saves_where_the_hardware_cannot_test_early() {
    let scene = scene("frag-depth.toml");
    for recipe in [
        "early-discard",
        "early-discard:texture=float",
        "early-discard:texture=packed",
        "early-discard:quad=lane",
    ] {
        let plans = transformed(&scene, recipe);
        assert_exact(recipe, &scene, &plans);
        let [before, after] = [&originals(&scene), &plans].map(|p| worked_per_pixel(&scene, p));
        assert!(
            before > 2.0 && after < 1.3,
            "{before} before, {after} after"
        );
    }
}

#[test]
fn packed_depth_is_for_webgl() {
    use preshade_compiler::emit;
    use preshade_plan::plan_file::{PlanFile, Target};
    let scene = scene("frag-depth.toml");
    for plan in transformed(&self::scene("simple.toml"), "early-discard:texture=packed") {
        let files = emit::emit(&plan, &[Target::GlslEs300], &emit::Options::default()).unwrap();
        let text = |part: &str| {
            let file = files
                .iter()
                .find(|f| f.name.contains(part) && f.name.ends_with(".frag"))
                .unwrap();
            String::from_utf8(file.bytes.clone()).unwrap()
        };
        assert!(text(".main.").contains("texelFetch("));
        assert!(text(".prepass.").contains("pack_depth("));
        // Without fine derivatives a vote shields nobody: the form says so, where there is somebody
        // to shield.
        let json = files.iter().find(|f| f.name.ends_with(".json")).unwrap();
        let host: PlanFile = serde_json::from_slice(&json.bytes).unwrap();
        let samples = text(".main.").contains("texture(");
        let weaker = host.forms.get(&Target::GlslEs300);
        assert_eq!(weaker.is_some(), samples, "{}", plan.material);
        if let Some(form) = weaker {
            assert!(matches!(form.contract, Contract::Approximate { .. }));
        }
        assert!(matches!(host.plan.contract, Contract::Exact { .. }));
    }
    // A depth texture is what GLSL cannot say.
    let plan = apply(&originals(&scene)[0], "early-discard").unwrap();
    assert!(emit::emit(&plan, &[Target::GlslEs300], &emit::Options::default()).is_err());
}
