//! glTF files as they are: what becomes a draw, a material, a camera and a light.

use std::path::{Path, PathBuf};

use preshade_draw::scene::{self, Address, Filter, Material, Scene, SceneError, Value};
use preshade_plan::state::{CullMode, FrontFace};
use preshade_scenes::Access;
use preshade_scenes::Shading;
use preshade_scenes::Variables;
use shader_text::limits::Limits;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/gltf")
        .join(name)
}

fn load(shading: &Shading) -> Result<Scene, SceneError> {
    let file = fixture("panes.gltf");
    preshade_scenes::load_gltf(&file, shading, &Variables::new(), Access::default())
}

/// A scene of the fixtures' folder.
fn read(text: &str) -> Result<Scene, SceneError> {
    let variables = Variables::new();
    preshade_scenes::read(text, &fixture("scene.toml"), &variables, Access::default())
}

fn draws(scene: &Scene) -> Vec<(&str, &str, u32)> {
    let draws = scene.draws.iter();
    draws
        .map(|d| {
            (
                d.name.as_str(),
                scene.materials[d.material].name.as_str(),
                d.instances,
            )
        })
        .collect()
}

fn numbers<'m>(material: &'m Material, path: &str) -> &'m [f64] {
    match material.values.get(path) {
        Some(Value::Numbers(numbers)) => numbers,
        other => panic!("`{path}` is {other:?}"),
    }
}

#[test]
fn each_primitive_is_a_draw_with_its_own_material_and_state() {
    let scene = load(&Shading::BuiltIn).unwrap();
    assert_eq!(
        draws(&scene),
        [
            ("Front.0", "Leaves", 1),
            ("Front.1", "Glass", 1),
            ("Copies.0", "Leaves-2", 2),
            ("Copies.1", "Glass-2", 2),
        ]
    );
    let [leaves, glass, copied, _] = scene.materials.as_slice() else {
        panic!("{} materials", scene.materials.len());
    };
    // The node of the first two is mirrored.
    let faces = |m: &Material| (m.state.primitive.cull, m.state.primitive.front_face);
    assert_eq!(faces(leaves), (CullMode::None, FrontFace::Cw));
    assert_eq!(faces(glass), (CullMode::Back, FrontFace::Cw));
    assert_eq!(faces(copied), (CullMode::None, FrontFace::Ccw));
    let blends = |m: &Material| m.state.targets[0].as_ref().unwrap().blend.is_some();
    assert_eq!((blends(leaves), leaves.state.depth_write), (false, true));
    assert_eq!((blends(glass), glass.state.depth_write), (true, false));
    // A cut-out discards, and glass does not.
    let text = |m: &Material| m.program.sources().files()[0].text.to_string();
    assert!(text(leaves).contains("discard") && !text(glass).contains("discard"));
    assert_eq!(numbers(leaves, "material.alpha_cutoff"), [0.25]);
    let image = &leaves.textures["base_color_texture"];
    assert_eq!((image.size, image.levels.len()), ([2, 2], 1));
    assert!(image.format.is_srgb());
    let sampler = leaves.samplers["base_color_sampler"];
    assert_eq!(sampler.filter, Filter::Nearest);
    assert_eq!(
        (sampler.address, sampler.address_v),
        (Address::ClampToEdge, Some(Address::MirrorRepeat))
    );
    // The light and the camera are the file's.
    assert!(scene.light.direction.abs_diff_eq(glam::Vec3::Y, 1e-5));
    assert_eq!(scene.light.color.to_array(), [4.0, 2.0, 1.0]);
    assert_eq!(numbers(glass, "lights[0].color"), [4.0, 2.0, 1.0]);
    let camera = &scene.cameras[0];
    assert_eq!(camera.name, "Front view");
    assert_eq!(camera.frames[0].eye.to_array(), [0.0, 2.0, 6.0]);
    let notes = scene.notes.join("\n");
    assert!(notes.contains("KHR_materials_clearcoat"), "{notes}");
}

#[test]
fn a_shader_gets_the_files_values_by_name_and_role() {
    let scene = load(&Shading::Shader(fixture("panes.wgsl"))).unwrap();
    // It takes no instances: each copy is a draw.
    assert_eq!(scene.draws.len(), 6);
    assert_eq!(draws(&scene)[2].0, "Copies.0[0]");
    let leaves = &scene.materials[0];
    assert_eq!(leaves.name, "Leaves");
    assert_eq!(leaves.textures["t_albedo"].size, [2, 2]);
    // No emissive texture: one white texel.
    assert_eq!(leaves.textures["t_emissive"].levels, [vec![255; 4]]);
    assert_eq!(leaves.samplers["linear_sampler"].filter, Filter::Nearest);
    let glass = &scene.materials[1];
    let color = numbers(glass, "surface.base_color")
        .iter()
        .map(|n| *n as f32);
    assert_eq!(color.collect::<Vec<_>>(), [0.2, 0.4, 0.9, 0.5]);
    assert_eq!(numbers(glass, "surface.alpha_cutoff"), [0.0]);
    let notes = scene.notes.join("\n");
    assert!(
        notes.contains("`panes.wgsl` gets from the file:"),
        "{notes}"
    );
    assert!(notes.contains("the sampler of baseColorTexture"), "{notes}");
    assert!(
        notes.contains("made up: the material has no emissiveTexture"),
        "{notes}"
    );
}

#[test]
fn a_map_names_shaders_for_materials() {
    let scene = load(&Shading::Materials(fixture("panes.toml"))).unwrap();
    let names: Vec<&str> = scene.materials.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(
        names,
        ["Leaves-2", "Glass", "Leaves-3", "Glass-2"],
        "the template has no draw"
    );
    assert_eq!(numbers(&scene.materials[0], "surface.shade"), [0.5]);
    assert_eq!(scene.materials[1].vertex, "vertex_main");
}

#[test]
fn a_scene_takes_a_part_of_a_file() {
    let text = "materials.panes.shader = 'panes.wgsl'
        draws = [
            { gltf = { file = 'panes.gltf', node = 'Front', material = 'Glass' } },
            { gltf = { file = 'panes.gltf', node = 'Front' }, materials = { Leaves = 'panes' },
              translate = [5, 0, 0], values = {} },
        ]
        cameras = [{ eye = [0, 0, 9], target = [0, 0, 0] }]";
    let scene = read(text).unwrap();
    assert_eq!(
        draws(&scene),
        [
            ("Front.1", "Glass", 1),
            ("Front.0", "panes-Leaves", 1),
            ("Front.1", "Glass", 1),
        ]
    );
    let at = scene.draws[1].transform.transform_point3(glam::Vec3::ZERO);
    assert_eq!(at.to_array(), [5.0, 1.0, 0.0]);
    // Other materials store their colours as they are, and so does the built-in one here.
    let glass = scene.materials.iter().find(|m| m.name == "Glass").unwrap();
    assert_eq!(
        glass.state.targets[0].as_ref().unwrap().format,
        "rgba8unorm"
    );
    for (text, expected) in [
        (
            "draws = [{ gltf = { file = 'panes.gltf', node = 'Frnt' } }]",
            "did you mean `Front`",
        ),
        (
            "draws = [{ gltf = { file = 'panes.gltf' }, materials = { Leavs = 'x' } }]",
            "did you mean `Leaves`",
        ),
        (
            "draws = [{ gltf = { file = 'panes.gltf' }, range = { first = 3 } }]",
            "neither `field` nor `range`",
        ),
        ("draws = [{ mesh = 'x' }]", "or a `gltf`"),
    ] {
        let error = read(text).unwrap_err().render();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn what_cannot_be_read_is_named() {
    let folder = std::env::temp_dir().join(format!("preshade-gltf-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let original = std::fs::read_to_string(fixture("panes.gltf")).unwrap();
    let refused = |name: &str, text: &str, limits: Limits| {
        let file = folder.join(name);
        std::fs::write(&file, text).unwrap();
        let access = Access {
            limits,
            ..Access::default()
        };
        preshade_scenes::load_gltf(&file, &Shading::BuiltIn, &Variables::new(), access).unwrap_err()
    };
    let draco = original.replace(
        "\"extensionsUsed\"",
        "\"extensionsRequired\": [\"KHR_draco_mesh_compression\"], \"extensionsUsed\"",
    );
    let error = refused("draco.gltf", &draco, Limits::default());
    assert_eq!(error.code(), "gltf-extension");
    let text = error.render();
    assert!(
        text.contains("KHR_draco_mesh_compression") && text.contains("compression"),
        "{text}"
    );
    let missing = original.replace("data:image/png;base64,", "missing.png?");
    let error = refused("missing.gltf", &missing, Limits::default());
    assert!(
        error.message().contains("missing.png"),
        "{}",
        error.message()
    );
    let far = original.replace("data:image/png;base64,", "https://example.org/");
    let error = refused("far.gltf", &far, Limits::default());
    assert!(error.message().contains("network"), "{}", error.message());
    let small = Limits {
        texture_size: 1,
        ..Limits::default()
    };
    let error = refused("small.gltf", &original, small);
    assert!(
        error.message().contains("texture-size"),
        "{}",
        error.message()
    );
    std::fs::remove_dir_all(&folder).unwrap();
}

fn case(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/cases")
        .join(name)
}

#[test]
fn members_that_gltf_leaves_optional_may_be_absent() {
    let text = std::fs::read_to_string(case("gltf-scene-without-nodes.gltf")).unwrap();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    // An animation of a material has no node (KHR_animation_pointer).
    let animated = text.replacen(
        "\"scene\": 0",
        "\"animations\": [{\"samplers\": [{\"input\": 0, \"output\": 0}], \"channels\": [{\"sampler\": 0, \
         \"target\": {\"path\": \"pointer\"}}]}], \"scene\": 0",
        1,
    );
    assert_ne!(text, animated);
    let mut binary = b"glTF\x02\0\0\0".to_vec();
    let mut json = text.clone();
    json.push_str(&" ".repeat(json.len().wrapping_neg() % 4));
    binary.extend((20 + json.len() as u32).to_le_bytes());
    binary.extend((json.len() as u32).to_le_bytes());
    binary.extend(b"JSON");
    binary.extend(json.as_bytes());
    for (name, bytes) in [
        ("plain.gltf", text.clone().into_bytes()),
        ("mark.gltf", format!("\u{feff}{text}").into_bytes()),
        ("animated.gltf", animated.into_bytes()),
        ("binary.glb", binary),
    ] {
        let path = folder.join(name);
        std::fs::write(&path, bytes).unwrap();
        let scene = preshade_scenes::load_gltf(
            &path,
            &Shading::BuiltIn,
            &Variables::new(),
            Access::default(),
        );
        let scene = scene.unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(scene.draws.len(), 1, "{name}");
        let notes = scene.notes.join("\n");
        assert_eq!(
            notes.contains("animations"),
            name == "animated.gltf",
            "{notes}"
        );
    }
}

#[test]
fn an_index_beyond_the_vertices_is_named() {
    let path = case("gltf-index-out-of-range.gltf");
    let read = preshade_scenes::load_gltf(
        &path,
        &Shading::BuiltIn,
        &Variables::new(),
        Access::default(),
    );
    let message = read.unwrap_err().to_string();
    assert!(message.contains("index 9, and 4 vertices"), "{message}");
}

/// Each draw has one front face, so a mirrored instance is a draw of its own.
#[test]
fn a_mirrored_instance_has_its_own_front_face() {
    let path = case("gltf-mirrored-instance.gltf");
    let scene = preshade_scenes::load_gltf(
        &path,
        &Shading::BuiltIn,
        &Variables::new(),
        Access::default(),
    )
    .unwrap();
    let faces = scene.draws.iter().map(|d| {
        let state = &scene.materials[d.material].state;
        (d.instances, state.primitive.front_face)
    });
    let faces: Vec<(u32, FrontFace)> = faces.collect();
    assert_eq!(faces, [(1, FrontFace::Ccw), (1, FrontFace::Cw)]);
}

/// The author's shader on a glTF file gets its attributes by what it does with them, and the light's
/// colour is not the material's.
#[test]
fn attributes_are_matched_by_use_and_lights_are_no_materials() {
    for folder in ["gltf-short-names", "gltf-light-color"] {
        let [file, shader] = ["leaf.glb", "lit.wgsl"].map(|name| case(folder).join(name));
        let shading = Shading::Shader(shader);
        let scene =
            preshade_scenes::load_gltf(&file, &shading, &Variables::new(), Access::default());
        let scene = scene.unwrap_or_else(|e| panic!("{folder}: {e}"));
        let material = &scene.materials[scene.draws[0].material];
        let notes = scene.notes.join("\n");
        assert!(
            !material.values.contains_key("light.color"),
            "{folder}: {notes}"
        );
        if folder == "gltf-short-names" {
            let roles: Vec<(&str, &str)> = material
                .attribute_roles
                .iter()
                .map(|(name, stream)| (name.as_str(), stream.as_str()))
                .collect();
            assert_eq!(roles, [("n", "normal"), ("p", "position")]);
        }
        let guessed = scene::bind::guessed(&scene);
        let synthesised = guessed
            .iter()
            .filter(|g| matches!(g.guess, scene::bind::Guess::AttributeSynthesised));
        assert_eq!(synthesised.count(), 0, "{guessed:?}");
    }
}
