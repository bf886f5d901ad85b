//! Bad scenes are refused with a clear message at the right place.

use std::path::{Path, PathBuf};

use preshade_draw::scene;

/// A scene that is right but for what a case changes.
const GOOD: &str = r#"size = [64, 32]

[materials.tiles]
shader = "../shaders/tiles.wgsl"
values = { "light.ambient" = [0.2, 0.2, 0.2] }
textures.albedo = { pattern = "checker", size = 16 }

[meshes]
cube.box = { size = [1, 1, 1] }

[[draws]]
mesh = "cube"
material = "tiles"

[[cameras]]
eye = [1, 2, 5]
target = [0, 0, 0]
"#;

/// A folder of its own, with a scene beside a shader folder as in the fixtures.
fn folder(case: &str) -> PathBuf {
    let root = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("scene_errors")
        .join(case);
    std::fs::create_dir_all(root.join("scenes")).unwrap();
    std::fs::create_dir_all(root.join("shaders")).unwrap();
    std::fs::write(root.join("preshade.toml"), "").unwrap();
    let shader = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/shaders/textured.wgsl");
    std::fs::copy(shader, root.join("shaders/tiles.wgsl")).unwrap();
    root
}

fn load(case: &str, text: &str) -> Result<scene::Scene, scene::SceneError> {
    let path = folder(case).join("scenes/bad.toml");
    std::fs::write(&path, text).unwrap();
    preshade_scenes::load(&path)
}

/// The frame, without the folder the test ran in.
fn refusal(case: &str, from: &str, to: &str) -> String {
    assert!(GOOD.contains(from), "{from}");
    let error = load(case, &GOOD.replace(from, to)).unwrap_err();
    let root = folder(case).display().to_string();
    error.render().replace(&root, "ROOT").trim_end().to_owned()
}

#[test]
fn the_scene_that_cases_spoil_is_good() {
    let scene = load("good", GOOD).unwrap();
    assert_eq!(scene.draws.len(), 1);
}

#[test]
fn unknown_keys_are_told_with_the_nearest_known_one() {
    insta::assert_snapshot!(refusal("top", "size = [64", "sizes = [64"));
    insta::assert_snapshot!(refusal("nested", "box = { size", "box = { syze"));
    insta::assert_snapshot!(refusal("pattern", "\"checker\"", "\"chequer\""));
    insta::assert_snapshot!(refusal("far", "target =", "elephant = 3\ntarget ="));
}

#[test]
fn a_cube_wants_a_square_picture() {
    let root = folder("cube");
    let shader = "@group(0) @binding(0) var sky: texture_cube<f32>;
@group(0) @binding(1) var s: sampler;
@vertex fn vs(@location(0) position: vec3f) -> @builtin(position) vec4f { \
                  return vec4f(position, 1.0); }
@fragment fn fs(@builtin(position) p: vec4f) -> @location(0) vec4f { \
                  return textureSample(sky, s, p.xyz); }
";
    std::fs::write(root.join("shaders/sky.wgsl"), shader).unwrap();
    let of = |width: u32| {
        let mut png = Vec::new();
        let texels = vec![255_u8; (width * 2 * 4) as usize];
        image::write_buffer_with_format(
            &mut std::io::Cursor::new(&mut png),
            &texels,
            width,
            2,
            image::ColorType::Rgba8,
            image::ImageFormat::Png,
        )
        .unwrap();
        std::fs::write(root.join("scenes/sky.png"), png).unwrap();
        let text = GOOD
            .replace("tiles.wgsl", "sky.wgsl")
            .replace(
                "textures.albedo = { pattern = \"checker\", size = 16 }",
                "textures.sky = { file = \"sky.png\" }",
            )
            .replace("values = { \"light.ambient\" = [0.2, 0.2, 0.2] }\n", "");
        let path = root.join("scenes/bad.toml");
        std::fs::write(&path, text).unwrap();
        preshade_scenes::load(&path)
    };
    assert_eq!(of(2).unwrap().materials[0].textures["sky"].size, [2, 2]);
    let told = of(4).unwrap_err().render();
    let told = told.replace(&root.display().to_string(), "ROOT");
    insta::assert_snapshot!(told.trim_end());
}

#[test]
fn names_that_lead_nowhere_are_told() {
    insta::assert_snapshot!(refusal("mesh", "mesh = \"cube\"", "mesh = \"cub\""));
    insta::assert_snapshot!(refusal(
        "material",
        "material = \"tiles\"",
        "material = \"wood\""
    ));
    insta::assert_snapshot!(refusal("value", "light.ambient", "light.ambiant"));
    insta::assert_snapshot!(refusal(
        "texture-name",
        "textures.albedo",
        "textures.albedoo"
    ));
    let with = |stream: &str| format!("attributes.uv = \"{stream}\"\ntextures.albedo");
    insta::assert_snapshot!(refusal("stream", "textures.albedo", &with("posiiton")));
    insta::assert_snapshot!(refusal("stream-far", "textures.albedo", &with("elephant")));
    // Also where the shader's use of an attribute tells its stream.
    for attribute in ["position", "normal"] {
        let named = format!("attributes.{attribute} = \"uv7\"\ntextures.albedo");
        let refused = refusal(&format!("stream-{attribute}"), "textures.albedo", &named);
        assert!(refused.contains("has no stream `uv7`"), "{refused}");
    }
    // One that a mesh may lack reads what it does then.
    for (case, stream) in [
        ("own", "position"),
        ("lacking", "color"),
        ("alias", "texcoord1"),
    ] {
        let text = GOOD.replace("textures.albedo", &with(stream));
        assert!(load(&format!("stream-{case}"), &text).is_ok(), "{stream}");
    }
}

#[test]
fn files_that_are_missing_or_out_of_bounds_are_told() {
    insta::assert_snapshot!(refusal("missing", "tiles.wgsl", "tyles.wgsl"));
    insta::assert_snapshot!(refusal(
        "picture",
        "pattern = \"checker\"",
        "file = \"nothing.png\""
    ));
    let outside = folder("outside").parent().unwrap().join("secret.wgsl");
    std::fs::write(outside, "// not yours").unwrap();
    insta::assert_snapshot!(refusal(
        "outside",
        "../shaders/tiles.wgsl",
        "../../secret.wgsl"
    ));
}

#[test]
fn sizes_that_cannot_be_drawn_are_told() {
    insta::assert_snapshot!(refusal("zero", "[64, 32]", "[0, 0]"));
    insta::assert_snapshot!(refusal(
        "viewport",
        "size = [64, 32]",
        "size = [64, 32]\nviewport = [40, 0, 32, 32]"
    ));
    insta::assert_snapshot!(refusal(
        "samples",
        "size = [64, 32]",
        "size = [64, 32]\nsamples = 3"
    ));
    insta::assert_snapshot!(refusal("camera", "target =", "near = 3\nfar = 2\ntarget ="));
    for (case, light) in [
        ("light-direction", "direction = [0, 0, 0]"),
        ("light-extent", "extent = [4, 0, 4]"),
        ("light-map", "map = 0"),
    ] {
        let to = format!("size = [64, 32]\nlight = {{ {light} }}");
        insta::assert_snapshot!(case, refusal(case, "size = [64, 32]", &to));
    }
}

#[test]
fn values_that_do_not_fit_are_told() {
    insta::assert_snapshot!(refusal("short", "[0.2, 0.2, 0.2]", "[0.2, 0.2]"));
    insta::assert_snapshot!(refusal(
        "semantic",
        "[0.2, 0.2, 0.2]",
        "\"$camera_positin\""
    ));
    insta::assert_snapshot!(refusal("matrix", "[0.2, 0.2, 0.2]", "\"$view\""));
}

#[test]
fn broken_shaders_keep_their_own_frame() {
    let root = folder("shader");
    std::fs::write(
        root.join("shaders/broken.wgsl"),
        "@vertex fn v() -> f32 {\n    return x;\n}\n",
    )
    .unwrap();
    insta::assert_snapshot!(refusal("shader", "tiles.wgsl", "broken.wgsl"));
}

#[test]
fn syntax_errors_are_framed() {
    insta::assert_snapshot!(refusal("syntax", "size = [64, 32]", "size = [64, 32"));
    insta::assert_snapshot!(refusal(
        "merge-loop",
        "cube.box = { size = [1, 1, 1] }",
        "cube.merge = [{ mesh = \"other\" }]\nother.merge = [{ mesh = \"cube\" }]"
    ));
    insta::assert_snapshot!(refusal(
        "two-shapes",
        "cube.box = { size = [1, 1, 1] }",
        "cube = { box = {}, sphere = {} }"
    ));
}

#[test]
fn orbits_that_are_none_are_told() {
    let orbit = |distance: &str| format!("orbit = {{ yaw = 0, pitch = 0, distance = {distance} }}");
    insta::assert_snapshot!(refusal("orbit", "target = [0, 0, 0]", &orbit("2")));
    let eye = "eye = [1, 2, 5]\ntarget = [0, 0, 0]";
    insta::assert_snapshot!(refusal("orbit", eye, &orbit("-1")));
}

#[test]
fn cells_of_a_texture_are_counted_before_they_are_drawn() {
    for pattern in ["solid", "noise", "bricks", "stones", "leaf", "blades"] {
        let of = |scale: u32| {
            let to = format!("{{ pattern = \"{pattern}\", size = 16, scale = {scale} }}");
            GOOD.replace("{ pattern = \"checker\", size = 16 }", &to)
        };
        for scale in [0, 4097, 1 << 28, 1 << 31, u32::MAX] {
            let told = load("scale", &of(scale)).unwrap_err().render();
            let said = format!("texture `albedo` with {scale} cells across");
            assert!(
                told.contains(&said) && told.contains("bad.toml:6:"),
                "{told}"
            );
        }
        // The most there may be wraps nowhere.
        assert!(load("scale", &of(4096)).is_ok(), "{pattern}");
    }
}

fn load_strictly(case: &str, text: &str) -> Result<scene::Scene, scene::SceneError> {
    let path = folder(case).join("scenes/bad.toml");
    std::fs::write(&path, text).unwrap();
    let access = preshade_scenes::Access {
        limits: shader_text::limits::Limits::strict(),
        ..preshade_scenes::Access::default()
    };
    preshade_scenes::load_within(&path, &preshade_scenes::Variables::new(), access)
}

#[test]
fn draws_are_counted_before_they_are_made() {
    let field =
        |n: u32| format!("field = {{ count = [{n}, 1, 1], spacing = [1, 1, 1], as = \"draws\" }}");
    let with = |what: &str| {
        let skinned = GOOD.replace("[1, 1, 1] }", "[1, 1, 1] }\ncube.skin = { joints = 256 }");
        skinned.replace(
            "material = \"tiles\"",
            &format!("material = \"tiles\"\n{what}"),
        )
    };
    // 64 GB, were each draw to have joints of its own.
    let told = load("draws", &with(&field(4_000_000)))
        .unwrap_err()
        .render();
    assert!(
        told.contains("the number of draws would be 4000000; the limit `draws` is 200000"),
        "{told}"
    );
    assert!(told.contains("bad.toml:15:"), "{told}");
    let scene = load_strictly("draws", &with(&field(5000))).unwrap();
    let [first, .., last] = &scene.draws[..] else {
        panic!("{} draws", scene.draws.len());
    };
    assert!(std::sync::Arc::ptr_eq(&first.joints, &last.joints));
    // Weights, values and names are each draw's own.
    let weights = vec!["1.0"; 40_000].join(", ");
    let heavy = with(&format!("morph_weights = [{weights}]\n{}", field(5000)));
    let told = load_strictly("draws", &heavy).unwrap_err().render();
    assert!(
        told.contains("the limit `scene-bytes` is 268435456"),
        "{told}"
    );
    // So are the streams of copies in one draw: 96 bytes each.
    let copies = field(4_000_000).replace("draws", "instances");
    let path = folder("instances").join("scenes/bad.toml");
    std::fs::write(&path, with(&copies)).unwrap();
    let access = preshade_scenes::Access {
        limits: shader_text::limits::Limits::parse("scene-bytes=300M").unwrap(),
        ..preshade_scenes::Access::default()
    };
    let refused = preshade_scenes::load_within(&path, &preshade_scenes::Variables::new(), access);
    let told = refused.unwrap_err().render();
    assert!(
        told.contains("bytes of vertex data, texels and draws would be 384"),
        "{told}"
    );
}

#[test]
fn frames_of_all_cameras_are_counted_before_they_are_made() {
    let path = "[[cameras]]\npath = { frames = 1000, keys = [{ \
                eye = [1, 2, 5], target = [0, 0, 0] }, { \
                eye = [2, 2, 5], target = [0, 0, 0] }] }\n";
    let cameras = |n: usize| format!("{GOOD}\n{}", path.repeat(n));
    let told = load("frames", &cameras(20)).unwrap_err().render();
    let said = "the frames of all cameras would be 20001; the limit `frames` is 20000";
    assert!(told.contains(said), "{told}");
    let told = load_strictly("frames", &cameras(1)).unwrap_err().render();
    assert!(
        told.contains("would be 1001; the limit `frames` is 1000"),
        "{told}"
    );
    assert!(load("frames", &cameras(1)).is_ok());
}

#[test]
fn the_shadow_map_and_instances_are_under_limits_too() {
    let light = |side: u32| format!("light.map = {side}\n{GOOD}");
    let told = load_strictly("map", &light(4096)).unwrap_err().render();
    let said = "the pixels of the shadow map would be 16777216; the limit `pixels` is 4194304";
    assert!(
        told.contains(said) && told.contains("bad.toml:1:"),
        "{told}"
    );
    assert!(load_strictly("map", &light(2048)).is_ok());
    assert!(load("map", &light(8192)).is_ok());
    let instances = |n: u32| {
        let to = format!("material = \"tiles\"\nrange = {{ instances = {n} }}");
        GOOD.replace("material = \"tiles\"", &to)
    };
    let told = load("many", &instances(u32::MAX)).unwrap_err().render();
    let said = "the instances of a draw would be 4294967295; the limit `copies` is 4000000";
    assert!(
        told.contains(said) && told.contains("bad.toml:14:"),
        "{told}"
    );
    assert!(load("many", &instances(4_000_000)).is_ok());
}

#[test]
fn a_range_that_leaves_its_mesh_or_its_field_is_told() {
    let of = |case: &str, range: &str| {
        let to = format!("material = \"tiles\"\n{range}");
        refusal(case, "material = \"tiles\"", &to)
    };
    for (case, range, told) in [
        (
            "range-indices",
            "range = { first = 30, count = 12 }",
            "takes indices 30 to 42, and mesh `cube` has 36",
        ),
        (
            "range-first",
            "range = { first = 37 }",
            "takes indices 37 to 36",
        ),
        (
            "range-vertex",
            "range = { base_vertex = 20 }",
            "takes vertex 24 of mesh `cube`, which has 24",
        ),
        (
            "range-below",
            "range = { base_vertex = -1 }",
            "takes vertex -1 of mesh `cube`",
        ),
        (
            "range-copies",
            "range = { first_instance = 2, instances = 3 }\n\
             field = { count = [4, 1, 1], spacing = [2, 0, 0] }",
            "instances 2 to 5 of a field of 4 copies",
        ),
        (
            "range-none",
            "range = { first_instance = 4 }\nfield = { count = [4, 1, 1], spacing = [2, 0, 0] }",
            "of a field of 4 copies",
        ),
        (
            "range-many",
            "range = { first_instance = 4294967295, instances = 3 }",
            "ends at instance 4294967298, and an index of instances has 32 bits",
        ),
    ] {
        let error = of(case, range);
        assert!(error.contains(told), "{error}");
        assert!(error.contains("bad.toml"), "{error}");
    }
    let range = "material = \"tiles\"\nrange = { first = 6, count = 12, base_vertex = 4, \
                 first_instance = 1 }\nfield = { count = [4, 1, 1], spacing = [2, 0, 0] }";
    let scene = load("range", &GOOD.replace("material = \"tiles\"", range)).unwrap();
    let draw = &scene.draws[0];
    let found = (draw.range.first, draw.range.count, draw.range.base_vertex);
    assert_eq!(found, (6, Some(12), 4));
    assert_eq!((draw.range.first_instance, draw.instances), (1, 3));
}

/// Lights in an array of 4 and as many again as the scene says, a struct with an array in each.
const LIT: &str = "
struct Light { color: vec3f, weights: array<vec4f, 2> }
struct Sun { lights: array<Light, 4>, gain: f32 }
@group(0) @binding(0) var<uniform> sun: Sun;
@group(0) @binding(1) var<storage, read> more: array<vec4f>;
@vertex fn vs(@location(0) position: vec3f) -> @builtin(position) vec4f { \
    return vec4f(position, sun.gain); }
@fragment fn fs() -> @location(0) vec4f { return vec4f(sun.lights[1].color, 1.0) + \
    sun.lights[2].weights[1] + more[0]; }
";

#[test]
fn values_that_would_change_nothing_are_told() {
    let root = folder("indices");
    std::fs::write(root.join("shaders/lit.wgsl"), LIT).unwrap();
    let with = |values: &str| {
        let text = GOOD
            .replace("tiles.wgsl", "lit.wgsl")
            .replace(
                "textures.albedo = { pattern = \"checker\", size = 16 }\n",
                "",
            )
            .replace("\"light.ambient\" = [0.2, 0.2, 0.2]", values);
        load("indices", &text)
    };
    for values in [
        "\"sun.lights[3].color\" = [1, 0, 0], \"sun.lights.color\" = [0, 0, 1]",
        "\"sun.lights[0].weights[1]\" = [1, 0, 0, 1]",
        "\"sun.lights.weights\" = 0.5",
        "more = [1, 1, 1, 1, 2, 2, 2, 2], \"sun.gain\" = 2",
    ] {
        assert!(with(values).is_ok(), "{values}: {:?}", with(values).err());
    }
    for (values, told) in [
        (
            "\"sun.lights[4].color\" = 1",
            "`lights` has 4 elements, and no number 4",
        ),
        ("\"sun.lights[-1].color\" = 1", "an index is a whole number"),
        ("\"sun.lights[x].color\" = 1", "an index is a whole number"),
        ("\"sun.lights[].color\" = 1", "an index is a whole number"),
        (
            "\"sun.lights[0]color\" = 1",
            "has no variable `sun.lights[0]color`",
        ),
        (
            "\"sun.lights[0][1].color\" = 1",
            "`lights` is not an array of that many dimensions",
        ),
        ("\"sun.gain[0]\" = 1", "`gain` is not an array"),
        (
            "\"sun.lights.weights[1]\" = 1",
            "`lights` is an array, and has no index here",
        ),
        (
            "\"sun.lights[0]\" = 1, \"sun.lights[0].color\" = 1",
            "`sun.lights[0]` gives it already",
        ),
        (
            "sun = 1, \"sun.lights[0].color\" = 1",
            "`sun` gives it already",
        ),
        ("\"more[100000]\" = 1", "and no number 100000"),
        // What would be looked up as another path than it is written.
        ("\"sun.lights[01].color\" = 1", "an index is a whole number"),
        ("\"sun.lights[+1].color\" = 1", "an index is a whole number"),
        ("\"sun.lights].color\" = 1", "an index is a whole number"),
    ] {
        let error = with(values).unwrap_err().render();
        assert!(error.contains(told), "{values}: {error}");
        assert!(error.contains("bad.toml:5:"), "{values}: {error}");
    }
}

#[test]
fn a_misfit_is_told_at_the_draw_that_has_it() {
    let text = GOOD.replace(
        "material = \"tiles\"\n",
        "material = \"tiles\"\nvalues = { \"light.ambient\" = [1, 1, 1] }\n",
    );
    let second = "\n[[draws]]\nmesh = \"cube\"\nmaterial = \"tiles\"\n\
                  values = { \"light.ambient\" = [1, 1] }\n";
    let error = load("misfit", &(text + second)).unwrap_err().render();
    assert!(
        error.contains("= [1, 1] }") && !error.contains("[1, 1, 1] }"),
        "{error}"
    );
}

#[test]
fn numbers_that_mean_nothing_are_told_where_they_stand() {
    insta::assert_snapshot!(refusal("size", "size = [1, 1, 1]", "size = [1, -1, 1]"));
    insta::assert_snapshot!(refusal("nan", "eye = [1, 2, 5]", "eye = [1, nan, 5]"));
    for (from, to, told) in [
        (
            "box = { size = [1, 1, 1] }",
            "sphere = { radius = 0 }",
            "`radius` of 0",
        ),
        (
            "box = { size = [1, 1, 1] }",
            "sphere = { radius = -0.5 }",
            "`radius` of -0.5",
        ),
        (
            "box = { size = [1, 1, 1] }",
            "plane = { segments = [4, 0] }",
            "`segments` of 0",
        ),
        (
            "box = { size = [1, 1, 1] }",
            "cards = { count = 0 }",
            "`count` of 0",
        ),
        (
            "box = { size = [1, 1, 1] }",
            "box = { tiling = inf }",
            "`tiling` of inf",
        ),
        ("eye = [1, 2, 5]", "eye = [1, 1e39, 5]", "`eye` of 1"),
        (
            "eye = [1, 2, 5]",
            "eye = [1, 2, 5]\ntime = -inf",
            "`time` of -inf",
        ),
        (
            "eye = [1, 2, 5]",
            "eye = [1, 2, 5]\nfov = nan",
            "`fov` of NaN",
        ),
        (
            "mesh = \"cube\"",
            "mesh = \"cube\"\nscale = nan",
            "`scale` of NaN",
        ),
    ] {
        let error = refusal("numbers", from, to);
        assert!(error.contains(told), "{to}: {error}");
        assert!(error.contains("bad.toml:"), "{to}: {error}");
    }
    // What means something: no end of sight, a value that a shader is tried with, a mirror.
    for (from, to) in [
        ("eye = [1, 2, 5]", "eye = [1, 2, 5]\nfar = inf"),
        ("[0.2, 0.2, 0.2]", "[nan, inf, 0.2]"),
        ("mesh = \"cube\"", "mesh = \"cube\"\nscale = [1, -1, 0]"),
    ] {
        let scene = load("numbers", &GOOD.replace(from, to));
        assert!(scene.is_ok(), "{to}: {:?}", scene.err());
    }
}

#[test]
fn immediate_data_is_named_like_a_uniform() {
    let case = folder("immediate");
    let shader = case.join("shaders/tiles.wgsl");
    let text = std::fs::read_to_string(&shader).unwrap();
    let pushed = "struct Push { gain: vec3<f32>, gloss: f32 }\nvar<immediate> push: Push;\n"
        .to_owned()
        + &text.replace("let lit = ", "let lit = push.gain + ");
    std::fs::write(&shader, &pushed).unwrap();
    let path = case.join("scenes/immediate.toml");
    let drawn = |values: &str| {
        let text = GOOD.replace("values = {", &format!("values = {{ {values}"));
        std::fs::write(&path, text).unwrap();
        let scene = preshade_scenes::load(&path).map_err(|e| e.to_string())?;
        let plan = &preshade_lab::measure::originals(&scene)[0];
        let (_, frame) = scene.frames().next().unwrap();
        let (pass, draw) = (plan.main().unwrap(), &scene.draws[0]);
        assert_eq!(pass.limits.get("maxImmediateSize"), Some(&16));
        let bound = scene::bind::draw(&scene, &scene.materials[0], pass, draw, frame);
        let guessed = scene::bind::guessed(&scene);
        let bytes = bound.map_err(|e| e.to_string())?.immediates.unwrap().bytes;
        let words = bytes.as_chunks::<4>().0.iter();
        let numbers: Vec<f32> = words.map(|w| f32::from_le_bytes(*w)).collect();
        Ok((numbers, guessed.iter().any(|g| g.name == "push.gloss")))
    };
    let given: Result<_, String> = drawn("\"push.gain\" = [1, 2, 3], \"push.gloss\" = 4,");
    assert_eq!(given, Ok((vec![1.0, 2.0, 3.0, 4.0], false)));
    // What the scene leaves open is made up, and listed.
    let (numbers, is_guessed) = drawn("\"push.gain\" = [1, 2, 3],").unwrap();
    assert!(is_guessed && numbers[3] > 0.0, "{numbers:?}");
    let misspelt = drawn("\"push.gian\" = [1, 2, 3],").unwrap_err();
    assert!(misspelt.contains("no variable `push.gian`"), "{misspelt}");
    // Two variables share their bytes.
    std::fs::write(
        &shader,
        format!("{pushed}\nvar<immediate> other: vec4<f32>;\n"),
    )
    .unwrap();
    let two = drawn("").unwrap_err();
    assert!(
        two.contains("`push` and `other` are both immediate data"),
        "{two}"
    );
}
