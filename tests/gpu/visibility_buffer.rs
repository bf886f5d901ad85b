//! A visibility buffer draws what forward shading draws: the same pixels covered, at the same
//! depths, and colours that differ by what rounding does.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use glam::{Mat4, Vec3};
use preshade_compiler::emit;
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{FrameSettings, Prepared, Rendered, SceneInputs, SelfTestResult};
use preshade_draw::scene::{DrawOrder, Image, Material, Mesh, Scene, Stream, Value};
use preshade_lab::measure::{self, Counter};
use preshade_plan::contract::{Assumption, Contract, Surface, Turned};
use preshade_plan::draw_table::Entry;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{Plan, Role};
use preshade_plan::plan_file::Target;
use preshade_plan::rasterizer::{Corners, Neighbours, Rasterizer};
use preshade_plan::state::{ColorTarget, CullMode, FrontFace};
use preshade_scenes::{ShaderForm, self_test};

use crate::render_support::*;

/// The forms that must all draw alike.
const FORMS: [&str; 13] = [
    "visibility-buffer",
    "visibility-buffer:select=id",
    "visibility-buffer:ids=unindexed",
    "visibility-buffer:form=compute",
    "visibility-buffer:formats=any",
    "visibility-buffer:words=one",
    "visibility-buffer:words=one,ids=unindexed,form=compute",
    "visibility-buffer:select=tiles",
    "visibility-buffer:select=tiles,form=compute",
    "visibility-buffer:form=binned",
    "visibility-buffer:form=binned,words=one,ids=unindexed",
    "visibility-buffer:vertices=kept",
    "visibility-buffer:vertices=kept,form=compute,select=tiles,formats=any",
];

/// Those whose promise is about an original that marks its position `@invariant`: a driver may give
/// another text of it other bits.
const OF_MARKED: [&str; 3] = [
    "visibility-buffer:vertex=sliced",
    "visibility-buffer:vertex=sliced,invariant=as-written,ids=unindexed",
    "visibility-buffer:invariant=add",
];

/// What the adapter was seen to do, as facts.
fn seen() -> &'static Facts {
    static SEEN: OnceLock<Facts> = OnceLock::new();
    SEEN.get_or_init(|| Facts {
        rasterizer: Some(measure::rasterizer(gpu()).unwrap()),
        ..Facts::default()
    })
}

/// The recipe with any difference allowed: tests compare pictures themselves.
fn within_any(recipe: &str) -> String {
    match (recipe.contains("budget="), recipe.contains(':')) {
        (true, _) => recipe.to_owned(),
        (false, true) => format!("{recipe},budget=1"),
        (false, false) => format!("{recipe}:budget=1"),
    }
}

/// Split for the adapter at hand, with any difference allowed.
fn split(plan: &Plan, recipe: &str) -> Plan {
    promised(plan, &within_any(recipe))
}

/// Split as the recipe says.
fn promised(plan: &Plan, recipe: &str) -> Plan {
    let recipe = Recipe::parse([recipe]).unwrap();
    recipe.apply(plan, seen()).unwrap()
}

fn refused(scene: &Scene) -> String {
    let recipe = Recipe::parse(["visibility-buffer"]).unwrap();
    let plan = &originals(scene)[0];
    recipe.apply(plan, &Facts::default()).unwrap_err().code
}

/// How two pictures differ.
#[derive(Debug, PartialEq)]
struct Difference {
    /// Pixels that one covers and the other does not.
    coverage: usize,
    depths: usize,
    /// Pixels with another colour.
    colors: usize,
    /// Largest difference of a channel, in steps of 255.
    most: u8,
}

/// `scene` has a clear colour that no surface gives.
fn difference(before: &Rendered, after: &Rendered) -> Difference {
    let [a, b] = [before, after].map(|r| r.colors[0].as_ref().unwrap());
    let [da, db] = [before, after].map(|r| &r.depth.as_ref().unwrap().values);
    let (mut coverage, mut colors, mut most) = (0, 0, 0);
    let far = |depth: &f32| *depth == 1.0;
    coverage += da.iter().zip(db).filter(|(a, b)| far(a) != far(b)).count();
    for (p, q) in a.bytes.chunks_exact(4).zip(b.bytes.chunks_exact(4)) {
        let by = p.iter().zip(q).map(|(p, q)| p.abs_diff(*q)).max().unwrap();
        colors += usize::from(by > 0);
        most = most.max(by);
    }
    Difference {
        coverage,
        depths: da
            .iter()
            .zip(db)
            .filter(|(a, b)| a.to_bits() != b.to_bits())
            .count(),
        colors,
        most,
    }
}

/// Draws `scene` forward and in every form, those of [`OF_MARKED`] with its positions marked,
/// asserts that the forms agree and that coverage and depth are the forward ones, and returns how
/// colours differ.
fn compared(scene: &Scene) -> Difference {
    let marked = scene.clone().with_invariant_positions();
    compared_with(&marked, &OF_MARKED.map(str::to_owned));
    compared_with(scene, &FORMS.map(str::to_owned))
}

fn compared_with(scene: &Scene, forms: &[String]) -> Difference {
    let plans = originals(scene);
    let order = DrawOrder::AsGiven;
    let forward = render_as(gpu(), scene, &plans, order, ShaderForm::Text);
    let mut found: Option<Difference> = None;
    for form in forms {
        let split: Vec<Plan> = plans.iter().map(|p| split(p, form)).collect();
        let drawn = render_as(gpu(), scene, &split, order, ShaderForm::Text);
        let difference = difference(&forward, &drawn);
        assert_eq!((difference.coverage, difference.depths), (0, 0), "{form}");
        if let Some(found) = &found {
            assert_eq!(&difference, found, "{form}");
        }
        found = Some(difference);
    }
    // Something is in sight.
    let depth = forward.depth.unwrap();
    assert!(depth.values.iter().any(|d| *d < 1.0));
    found.unwrap()
}

/// At most one step of 255 in at most one pixel of a thousand.
fn assert_rounds(scene: &Scene) {
    let difference = compared(scene);
    let pixels = (scene.size[0] * scene.size[1]) as usize;
    assert!(
        difference.most <= 1 && difference.colors * 1000 <= pixels,
        "{difference:?} of {pixels}"
    );
}

fn floats(components: u32, data: Vec<f32>) -> Stream {
    Stream::Float { components, data }
}

/// Triangles of these positions, with uvs of their x and y.
fn mesh(positions: &[[f32; 3]], indices: Option<Vec<u32>>) -> Mesh {
    let uvs = positions.iter().flat_map(|p| [p[0] * 0.5, p[1] * 0.5]);
    Mesh {
        name: "test".to_owned(),
        vertex_count: positions.len() as u32,
        streams: BTreeMap::from([
            ("position".to_owned(), floats(3, positions.concat())),
            ("uv".to_owned(), floats(2, uvs.collect())),
        ]),
        indices,
        bounds: [Vec3::splat(-1.0), Vec3::splat(1.0)],
    }
}

/// The frame at an angle and with perspective, its near plane at 0.1.
fn perspective(mut scene: Scene, eye: Vec3, target: Vec3) -> Scene {
    let frame = &mut scene.cameras[0].frames[0];
    frame.view = glam::camera_look_at(eye, target);
    frame.projection = Mat4::perspective_rh(1.0, 1.0, 0.1, 50.0);
    frame.eye = eye;
    scene
}

mod glam {
    pub use ::glam::*;
    pub fn camera_look_at(eye: Vec3, target: Vec3) -> Mat4 {
        Mat4::look_at_rh(eye, target, Vec3::Y)
    }
}

/// A material whose fragment stage is `body`, of an input `in` with `uv`, `world` and what
/// `varyings` adds.
fn shader(name: &str, declared: &str, varyings: &str, given: &str, body: &str) -> Material {
    let source = format!(
        "
struct Camera {{ view_proj: mat4x4<f32> }}
struct Object {{ model: mat4x4<f32>, tint: vec4<f32> }}
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> object: Object;
{declared}
struct Out {{ @builtin(position) at: vec4<f32>, @location(0) uv: vec2<f32>, \
    @location(1) world: vec3<f32>, {varyings} }}
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>, \
    @builtin(vertex_index) index: u32, @builtin(instance_index) instance: u32) -> Out {{
    let world = object.model * vec4(position, 1.0);
    return Out(camera.view_proj * world, uv, world.xyz, {given});
}}
@fragment fn fs(in: Out) -> @location(0) vec4<f32> {{ {body} }}
"
    );
    let mut material = material(name, &source);
    material.state.primitive.cull = CullMode::None;
    material
}

const TEXTURES: &str = "@group(1) @binding(1) var albedo: texture_2d<f32>;
@group(1) @binding(2) var relief: texture_2d<f32>;
@group(1) @binding(3) var smooth_sampler: sampler;";

/// A texture whose mip levels have a grey each.
fn mips(levels: u32) -> Arc<Image> {
    let size = 1 << (levels - 1);
    let levels = (0..levels).map(|level| {
        let texels = ((size >> level) * (size >> level)) as usize;
        let grey = (40 + level * 20) as u8;
        [grey, 255 - grey, 90, 255].repeat(texels)
    });
    Arc::new(Image::rgba8([size; 2], 1, false, levels.collect()))
}

/// A soft pattern with all its mips.
fn pattern() -> Arc<Image> {
    let recipe = preshade_draw::scene::image::Recipe {
        pattern: Some(preshade_draw::scene::image::Pattern::Noise),
        size: 128,
        ..Default::default()
    };
    Arc::new(recipe.generate())
}

#[test]
fn the_adapter_is_looked_at() {
    let seen = seen().rasterizer.unwrap();
    if gpu().adapter().name.contains("llvmpipe") {
        let expected = Rasterizer {
            corners: Corners::AsGiven,
            coarse: Neighbours::Own,
            cubes: Neighbours::Own,
            ..Rasterizer::default()
        };
        assert_eq!(seen, expected);
    }
    println!("{seen:?}");
}

#[test]
fn snapped_corners_are_where_the_rasteriser_puts_them() {
    let size = 128.0;
    let corners = [[-0.9, -0.8, 0.5], [0.95, -0.7, 0.5], [0.1, 0.9, 0.5]];
    // Each a third of a step of 1/256 pixel off the grid, in clip space.
    let at = |steps: f32| {
        corners.map(|corner| {
            let on_grid = |x: f32, by: f32| {
                let pixel = ((x * 0.5 + 0.5) * size * 256.0).round() + by;
                pixel / (size * 256.0) * 2.0 - 1.0
            };
            [
                on_grid(corner[0], steps),
                on_grid(corner[1], -steps),
                corner[2],
            ]
        })
    };
    // A step of 1/256 pixel is some steps of 255.
    let body = "return vec4(0.5 + 0.4 * sin(in.uv * 6000.0), 0.5, 1.0) * object.tint;";
    let draw_at = |steps: f32, recipe: &str| {
        let mut scene = scene(
            [size as u32; 2],
            vec![shader("ramp", "", "", "", body)],
            vec![draw("triangle", Mat4::IDENTITY, [1.0; 4])],
        );
        scene.meshes = vec![mesh(&at(steps), None)];
        // The same at each corner, wherever it is put.
        let uv = corners.iter().flat_map(|p| [p[0] * 0.5, p[1] * 0.5]);
        let uv = floats(2, uv.collect());
        scene.meshes[0].streams.insert("uv".to_owned(), uv);
        let plans: Vec<Plan> = originals(&scene).iter().map(|p| split(p, recipe)).collect();
        render_as(gpu(), &scene, &plans, DrawOrder::AsGiven, ShaderForm::Text)
    };
    let on_grid = draw_at(0.0, "visibility-buffer:corners=as-given");
    let snapped = difference(
        &on_grid,
        &draw_at(0.33, "visibility-buffer:corners=snapped"),
    );
    let given = difference(
        &on_grid,
        &draw_at(0.33, "visibility-buffer:corners=as-given"),
    );
    assert!(snapped.most <= 2, "{snapped:?}");
    assert!(given.most > 5 && given.colors > 1000, "{given:?}");
}

#[test]
fn snapped_corners_far_out_of_the_viewport() {
    // In pixels from the middle of 128, up to 96,000; waves of some ten pixels.
    for reach in [200.0, 900.0, 1500.0] {
        let corners = [[-reach, -1.3, 0.5], [reach, -1.1, 0.5], [0.3, reach, 0.5]];
        let body = "return vec4(0.5 + 0.4 * sin(in.uv * 40.0), 0.5, 1.0) * object.tint;";
        let mut scene = scene(
            [128; 2],
            vec![shader("far", "", "", "", body)],
            vec![draw("triangle", Mat4::IDENTITY, [1.0; 4])],
        );
        scene.meshes = vec![mesh(&corners, None)];
        let uv = corners.iter().flat_map(|p| [p[0], p[1]]);
        let uv = floats(2, uv.collect());
        scene.meshes[0].streams.insert("uv".to_owned(), uv);
        let originals = originals(&scene);
        let recipe = "visibility-buffer:corners=snapped";
        let plans: Vec<Plan> = originals.iter().map(|p| split(p, recipe)).collect();
        let drawn =
            |plans: &[Plan]| render_as(gpu(), &scene, plans, DrawOrder::AsGiven, ShaderForm::Text);
        let found = difference(&drawn(&originals), &drawn(&plans));
        assert!(found.most <= 2, "{reach}: {found:?}");
    }
}

/// A floor that reaches behind the viewer.
fn floor(material: Material) -> Scene {
    let mut scene = scene(
        [128, 96],
        vec![material],
        vec![draw("floor", Mat4::IDENTITY, [0.9, 0.8, 0.7, 1.0])],
    );
    let corners = [
        [-9.0, 0.0, -9.0],
        [9.0, 0.0, -9.0],
        [9.0, 0.0, 9.0],
        [-9.0, 0.0, 9.0],
    ];
    scene.meshes = vec![mesh(&corners, Some(vec![0, 2, 1, 0, 3, 2]))];
    // In world units: the mesh lies flat.
    let uv = corners.iter().flat_map(|p| [p[0] * 0.3, p[2] * 0.3]);
    scene.meshes[0]
        .streams
        .insert("uv".to_owned(), floats(2, uv.collect()));
    perspective(scene, Vec3::new(0.3, 1.1, 2.0), Vec3::new(0.0, 0.6, -1.0))
}

#[test]
fn triangles_that_reach_behind_the_viewer() {
    let waves = "return vec4(0.5 + 0.4 * sin(in.world * 3.0), 1.0) * object.tint;";
    assert_rounds(&floor(shader("waves", "", "", "", waves)));
}

#[test]
fn every_varying_by_its_own_interpolation() {
    let scene = floor(shader(
        "kinds",
        "",
        "@location(2) @interpolate(flat) first: vec2<u32>, @location(3) \
         @interpolate(linear) screen: vec2<f32>, @location(4) @interpolate(flat) corner: f32,",
        "vec2(index, instance), uv, f32(index)",
        "return vec4(fract(f32(in.first.x) * 0.3), 0.5 + 0.1 * in.screen.x, 0.5 + 0.1 * in.uv.y, \
         1.0) * vec4(1.0, 1.0, 1.0 - 0.1 * in.corner, 1.0);",
    ));
    // A linear varying has no place behind the viewer: what drivers make of it there is theirs.
    let scene = perspective(scene, Vec3::new(0.3, 6.0, 18.0), Vec3::ZERO);
    assert_rounds(&scene);
}

#[test]
fn builtins_are_made_again() {
    let source = shader("builtins", "", "", "", "return vec4(1.0);");
    let text = source.program.author_text().unwrap();
    let stage =
        "@fragment fn fs(in: Out, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    let side = select(0.2, 0.9, front);
    return vec4(side, in.at.x / 128.0, in.at.z * 0.9, 0.5 + 0.05 * in.at.w) * 0.9;
}";
    let text = format!("{}{stage}", &text[..text.find("@fragment").unwrap()]);
    for (winding, cull) in [
        (FrontFace::Ccw, CullMode::None),
        (FrontFace::Cw, CullMode::None),
        (FrontFace::Ccw, CullMode::Back),
        (FrontFace::Cw, CullMode::Front),
    ] {
        let mut material = material("builtins", &text);
        material.state.primitive.cull = cull;
        material.state.primitive.front_face = winding;
        let mut scene = floor(material);
        let mut turned = scene.draws[0].clone();
        turned.name = "turned".to_owned();
        turned.transform = Mat4::from_rotation_x(2.2) * Mat4::from_scale(Vec3::splat(0.1));
        scene.draws.push(turned);
        assert_rounds(&scene);
    }
}

#[test]
fn slivers_keep_their_colours() {
    // A fan of triangles as thin as a hundredth of a pixel.
    let mut positions = vec![[0.0, 0.0, 0.5]];
    let mut indices = Vec::new();
    for i in 0..180_u32 {
        let turn = i as f32 * std::f32::consts::TAU / 180.0;
        for (out, bend) in [(1.4, 0.0), (1.4, 0.0005 * (i % 7) as f32)] {
            let turn = turn + bend;
            positions.push([out * turn.cos(), out * turn.sin(), 0.5]);
        }
        indices.extend([0, 1 + 2 * i, 2 + 2 * i]);
    }
    let body = "return vec4(0.5 + 0.2 * in.uv, 0.5, 1.0) * object.tint;";
    let mut scene = scene(
        [128, 128],
        vec![shader("slivers", "", "", "", body)],
        vec![draw("fan", Mat4::IDENTITY, [0.9, 0.8, 0.7, 1.0])],
    );
    scene.meshes = vec![mesh(&positions, Some(indices))];
    assert_rounds(&scene);
}

/// Three draws in two materials: 16-bit indices, 32-bit indices, and none.
fn three_draws() -> Scene {
    let body = "let base = textureSample(albedo, smooth_sampler, in.uv * 2.0);
    return vec4(base.rgb * (0.6 + 0.4 * sin(in.world.x * 4.0)), 1.0) * object.tint;";
    let other = "let base = textureSample(relief, smooth_sampler, in.uv.yx * 3.0);
    return vec4(base.bgr, 1.0) * object.tint;";
    let mut materials = vec![
        shader("one", TEXTURES, "", "", body),
        shader("other", TEXTURES, "", "", other),
    ];
    materials[0].textures.insert("albedo".to_owned(), pattern());
    materials[1].textures.insert("relief".to_owned(), mips(6));
    let quad = [
        [-1.0, -1.0, 0.0],
        [1.0, -1.0, 0.0],
        [1.0, 1.0, 0.0],
        [-1.0, 1.0, 0.0],
    ];
    let at = |x: f32, z: f32| {
        Mat4::from_translation(Vec3::new(x, 0.0, z)) * Mat4::from_rotation_y(0.7 * x)
    };
    let mut draws: Vec<_> = [(0.0, 0.0), (-0.8, -0.5), (0.7, 0.4)]
        .into_iter()
        .enumerate()
        .map(|(i, (x, z))| {
            let mut d = draw(&format!("draw {i}"), at(x, z), [0.9, 0.8, 0.9, 1.0]);
            (d.mesh, d.material) = (i, i % 2);
            d
        })
        .collect();
    // An instanced one behind them, whose instances differ by number alone.
    let mut many = draws[0].clone();
    many.name = "many".to_owned();
    many.instances = 3;
    many.transform = at(0.2, -1.5) * Mat4::from_scale(Vec3::splat(2.0));
    draws.insert(1, many);
    let mut scene = scene([160, 120], materials, draws);
    // More vertices than 16 bits count, most of them unused.
    let mut wide: Vec<[f32; 3]> = vec![[5.0, 5.0, 5.0]; 66_000];
    wide.extend(quad);
    let last = wide.len() as u32 - 4;
    let unindexed = [0, 1, 2, 0, 2, 3].map(|i| quad[i]);
    scene.meshes = vec![
        mesh(&quad, Some(vec![0, 1, 2, 0, 2, 3])),
        mesh(&wide, Some([0, 1, 2, 0, 2, 3].map(|i| i + last).to_vec())),
        mesh(&unindexed, None),
    ];
    perspective(scene, Vec3::new(0.4, 0.8, 3.2), Vec3::ZERO)
}

#[test]
fn draws_of_several_materials_and_index_formats() {
    assert_rounds(&three_draws());
}

#[test]
fn draws_of_parts_of_meshes_and_instances() {
    assert_rounds(&parts::parts());
}

/// Each word of a draw's entry, got wrong, shows in those forms that read it.
#[rustfmt::skip] // One row a word.
#[test]
fn every_word_of_the_draw_table_is_needed() {
    let scene = parts::parts();
    let inputs = SceneInputs::new(gpu(), &scene).unwrap();
    let plans = originals(&scene);
    let drawn = |form: &str, amend: fn(&mut Entry)| {
        let split: Vec<Plan> = plans.iter().map(|p| split(p, form)).collect();
        let variant = preshade_scenes::variant(&split, ShaderForm::Text).unwrap();
        let settings = FrameSettings::of(&scene);
        let mut prepared =
            Prepared::with_entries(&inputs, &variant, &settings, amend).unwrap();
        prepared.aim(&scene.cameras[0].frames[0], DrawOrder::AsGiven);
        prepared.render().unwrap()
    };
    // What each form reads beside what all read.
    type Word = (&'static str, fn(&mut Entry), &'static [&'static str]);
    let words: [Word; 17] = [
        ("first id", |e| e.first_id += 1, &["select=depth", "select=tiles", "form=binned"]),
        ("instances", |e| e.instances -= 1, &["select=id", "form=compute", "select=tiles", "form=binned"]),
        ("first instance", |e| e.first_instance += 1, &["select=depth", "ids=unindexed,select=id", "vertices=kept"]),
        ("number", |e| e.number ^= 1, &["select=depth", "select=tiles", "form=binned"]),
        ("first", |e| e.first += 3, &["select=depth", "ids=unindexed,select=id", "vertices=kept"]),
        ("index bytes", |e| e.index_bytes ^= 6, &["select=depth", "ids=unindexed,select=id"]),
        ("base vertex", |e| e.base_vertex += 1, &["select=depth", "ids=unindexed,select=id", "vertices=kept"]),
        ("triangle bits", |e| e.triangle_bits += 1, &["words=one", "words=one,form=binned"]),
        ("viewport x", |e| e.viewport[0] += 1.0, &["select=depth", "select=tiles", "form=binned"]),
        ("viewport y", |e| e.viewport[1] += 1.0, &["select=depth", "select=tiles", "form=binned"]),
        ("viewport width", |e| e.viewport[2] += 1.0, &["select=depth", "select=tiles", "form=binned"]),
        ("viewport height", |e| e.viewport[3] += 1.0, &["select=depth", "select=tiles", "form=binned"]),
        ("vertices", |e| e.vertices -= 1, &["vertices=kept"]),
        ("offset", |e| e.streams.iter_mut().for_each(|s| s.offset += 4), &["select=depth", "ids=unindexed", "formats=any"]),
        ("stride", |e| e.streams.iter_mut().for_each(|s| s.stride += 4), &["select=depth", "ids=unindexed", "formats=any"]),
        ("format", |e| e.streams.iter_mut().for_each(|s| s.format = "unorm8x4".to_owned()), &["formats=any"]),
        ("step", |e| e.streams.iter_mut().for_each(|s| s.by_instance = !s.by_instance), &["select=depth", "ids=unindexed"]),
    ];
    let mut right: BTreeMap<&str, Rendered> = BTreeMap::new();
    let mut alike = Vec::new();
    for (word, amend, forms) in words {
        for form in forms {
            let recipe = format!("visibility-buffer:{form}");
            let right = right.entry(form).or_insert_with(|| drawn(&recipe, |_| {}));
            if drawn(&recipe, amend) == *right {
                alike.push(format!("{word}: {form}"));
            }
        }
    }
    assert!(alike.is_empty(), "{alike:?}");
}

/// Two draws of some hundred instances each, which their numbers place: more than one workgroup
/// sorts.
#[test]
fn instances_by_the_hundred() {
    let source = "
struct Camera { view_proj: mat4x4<f32> }
struct Object { model: mat4x4<f32>, tint: vec4<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> object: Object;
struct Out { @builtin(position) at: vec4<f32>, @location(0) world: vec3<f32>, @location(1) \
    @interpolate(flat) shade: f32 }
@vertex fn vs(@location(0) position: vec3<f32>, @builtin(instance_index) instance: u32) -> Out {
    let place = vec3(f32(instance % 30u) - 14.5, f32(instance / 30u) - 14.5, f32(instance % 7u) * \
        0.3);
    let world = object.model * vec4(position * 0.8 + place, 1.0);
    return Out(camera.view_proj * world, world.xyz, f32(instance % 11u) * 0.05);
}
@fragment fn fs(in: Out) -> @location(0) vec4<f32> {
    return vec4(0.3 + in.shade + 0.1 * sin(in.world), 1.0) * object.tint;
}";
    let mut crowd = material("crowd", source);
    crowd.state.primitive.cull = CullMode::None;
    let behind = Mat4::from_translation(Vec3::new(3.0, 2.0, -4.0));
    let mut draws = vec![
        draw("near", Mat4::IDENTITY, [0.9, 0.8, 0.7, 1.0]),
        draw("far", behind, [0.5, 0.8, 0.9, 1.0]),
    ];
    (draws[0].instances, draws[1].instances) = (900, 610);
    let mut scene = scene([203, 149], vec![crowd], draws);
    let triangle = [[-0.5, -0.5, 0.0], [0.5, -0.4, 0.1], [0.0, 0.5, 0.0]];
    scene.meshes = vec![mesh(&triangle, None)];
    assert_rounds(&perspective(scene, Vec3::new(2.0, 3.0, 30.0), Vec3::ZERO));
}

#[test]
fn each_pixel_is_shaded_once() {
    let scene = three_draws();
    let inputs = SceneInputs::new(gpu(), &scene).unwrap();
    for form in FORMS {
        let plans: Vec<Plan> = originals(&scene).iter().map(|p| split(p, form)).collect();
        let mut counter =
            Counter::shaded(&inputs, &plans, ShaderForm::Text, measure::counting).unwrap();
        let frame = &scene.cameras[0].frames[0];
        inputs.set_frame(frame).unwrap();
        let counted = counter.count(frame, DrawOrder::BackToFront).unwrap();
        assert!(counted.covered > 1000);
        assert_eq!(counted.fragments, counted.covered, "{form}");
    }
}

#[test]
fn gradients_choose_the_mips_that_forward_shading_chooses() {
    let body = "return textureSample(albedo, smooth_sampler, in.uv * 4.0) * object.tint;";
    let mut material = shader("mips", TEXTURES, "", "", body);
    material.textures.insert("albedo".to_owned(), mips(8));
    let difference = compared(&floor(material));
    let pixels = 128 * 96;
    // A level more or less is 20 steps of grey: the level is the same to a twentieth. How a level
    // is rounded, implicit or from gradients, no language says.
    assert!(
        difference.most <= 1 && difference.colors * 50 <= pixels,
        "{difference:?}"
    );
}

#[test]
fn a_biased_sample_and_a_sample_of_a_sample() {
    let body = "let wave = textureSample(relief, smooth_sampler, in.uv).xy;
    let base = textureSampleBias(albedo, smooth_sampler, in.uv + wave * 0.2, 1.0);
    let other = textureSampleBias(albedo, smooth_sampler, in.uv * 2.0, in.uv.x);
    return vec4(mix(base.rgb, other.rgb, 0.3), 1.0) * object.tint;";
    let mut material = shader("dependent", TEXTURES, "", "", body);
    material.textures.insert("albedo".to_owned(), pattern());
    material.textures.insert("relief".to_owned(), pattern());
    let difference = compared(&floor(material));
    assert!(
        difference.most <= 2 && difference.colors < 128 * 96 / 20,
        "{difference:?}"
    );
}

#[test]
fn what_is_interpolated_needs_a_budget() {
    let declared = "@group(1) @binding(1) var albedo: texture_2d<f32>;
@group(1) @binding(2) var by: sampler;
fn fetched(at: vec2<f32>) -> vec4<f32> { return textureSample(albedo, by, at); }";
    let of = |body: &str, recipe: &str| {
        let scene = floor(shader("sampled", declared, "", "", body));
        let recipe = Recipe::parse([recipe]).unwrap();
        match recipe.apply(&originals(&scene)[0], &Facts::default()) {
            Ok(split) => split.contract.kind().to_owned(),
            Err(refusal) => format!("{} {}", refusal.code, refusal.location.unwrap().line),
        }
    };
    for rounded in [
        "vec4(in.uv, 0.0, 1.0)",
        "vec4(in.at.z)",
        "textureSampleLevel(albedo, by, in.uv, 0.0)",
    ] {
        let body = format!("return object.tint * {rounded};");
        assert_eq!(
            of(&body, "visibility-buffer"),
            "interpolated 14",
            "{rounded}"
        );
        assert_eq!(of(&body, "visibility-buffer:budget=0.05"), "approximate");
    }
    // The resolve makes the gradients of the level.
    let body = "return fetched(in.at.xy / 300.0) * object.tint;";
    assert_eq!(of(body, "visibility-buffer"), "interpolated 8");
    for same in [
        "vec4(in.at.xy / 300.0, 0.0, 1.0)",
        "textureLoad(albedo, vec2<i32>(in.at.xy) % 2, 0)",
        "textureSampleLevel(albedo, by, in.at.xy, 0.0)",
    ] {
        let body = format!("return object.tint * {same};");
        assert_eq!(of(&body, "visibility-buffer"), "rounding", "{same}");
    }
}

#[test]
fn a_cube_is_sampled_at_the_levels_that_the_adapter_takes() {
    let declared = "@group(1) @binding(1) var albedo: texture_cube<f32>;
@group(1) @binding(2) var smooth_sampler: sampler;";
    // A direction whose gradients differ from pixel to pixel.
    let body = "let waves = vec3(sin(in.uv.x * 9.0), 0.6, cos(in.uv.y * 7.0));
    return textureSample(albedo, smooth_sampler, waves) * object.tint;";
    let mut material = shader("cube", declared, "", "", body);
    let mut levels = (*mips(7)).clone();
    levels.layers = 6;
    for level in &mut levels.levels {
        *level = level.repeat(6);
    }
    material
        .textures
        .insert("albedo".to_owned(), Arc::new(levels));
    let scene = floor(material);
    assert_eq!(refused(&scene), "interpolated");
    let difference = compared(&scene);
    assert_eq!((difference.coverage, difference.depths), (0, 0));
    // Software takes the levels of the gradients it is given; a card (an H200, by 44 steps) has
    // levels of its own, which is why a budget is asked for.
    if gpu().adapter().kind == "software" {
        assert!(
            difference.most <= 1 && difference.colors * 50 <= 128 * 96,
            "{difference:?}"
        );
    }
    // Other neighbours give other levels, so that the choice is seen.
    let [own, quad] = ["own", "quad"].map(|of| {
        let recipe = format!("visibility-buffer:cubes={of},budget=1");
        let plans: Vec<Plan> = originals(&scene)
            .iter()
            .map(|p| split(p, &recipe))
            .collect();
        render_as(gpu(), &scene, &plans, DrawOrder::AsGiven, ShaderForm::Text)
    });
    assert!(difference_of_levels(&own, &quad) > 100);
}

/// Pixels that differ by more than a step.
fn difference_of_levels(a: &Rendered, b: &Rendered) -> usize {
    let [a, b] = [a, b].map(|r| &r.colors[0].as_ref().unwrap().bytes);
    let pixels = a.chunks_exact(4).zip(b.chunks_exact(4));
    let far = |(p, q): &(&[u8], &[u8])| p.iter().zip(*q).any(|(p, q)| p.abs_diff(*q) > 1);
    pixels.filter(far).count()
}

#[test]
fn coarse_derivatives_are_those_of_the_adapter() {
    let body = "let bent = in.uv.x * in.uv.y * 3.0;
    return vec4(0.4 + dpdxCoarse(bent) * 4.0, 0.4 + dpdyCoarse(bent) * 4.0, fwidth(bent) * 2.0, \
        1.0) * object.tint;";
    let difference = compared(&floor(shader("coarse", "", "", "", body)));
    assert!(difference.most <= 1, "{difference:?}");
}

/// What drawing says of a scene that cannot be.
fn not_drawn(scene: &Scene, recipe: &str) -> String {
    let plans: Vec<Plan> = originals(scene).iter().map(|p| split(p, recipe)).collect();
    let inputs = SceneInputs::new(gpu(), scene).unwrap();
    let variant = preshade_scenes::variant(&plans, ShaderForm::Text).unwrap();
    let error = Prepared::new(&inputs, &variant, &FrameSettings::of(scene)).unwrap_err();
    error.to_string()
}

#[test]
fn more_than_ids_and_buffers_hold_is_told_before_it_is_drawn() {
    let mut scene = floor(shader("many", "", "", "", "return object.tint;"));
    scene.draws.push(scene.draws[0].clone());
    for (instances, recipe, told) in [
        (
            3_000_000_000,
            "visibility-buffer",
            "they have 6000000000 instances, and ids tell 4294967294 apart",
        ),
        (
            700_000_000,
            "visibility-buffer:words=one",
            "1400000000 instances, and 2 triangles with their sides, do not fit into ids of one \
             word: take words=two",
        ),
        (
            2_000_000_000,
            "visibility-buffer:form=binned",
            "the buffer `visibility-bin-instances` would have 16000000000 bytes, and the adapter \
             binds",
        ),
        (
            500_000_000,
            "visibility-buffer:vertices=kept",
            "the vertices of `floor` would take",
        ),
    ] {
        for draw in &mut scene.draws {
            draw.instances = instances;
        }
        let found = not_drawn(&scene, recipe);
        assert!(found.contains(told), "{found}");
    }
    // 4,000,000 instances are no trouble.
    for draw in &mut scene.draws {
        draw.instances = 2_000_000;
    }
    let inputs = SceneInputs::new(gpu(), &scene).unwrap();
    for form in ["words=one", "form=binned"] {
        let recipe = format!("visibility-buffer:{form}");
        let plans: Vec<Plan> = originals(&scene)
            .iter()
            .map(|p| split(p, &recipe))
            .collect();
        let variant = preshade_scenes::variant(&plans, ShaderForm::Text).unwrap();
        Prepared::new(&inputs, &variant, &FrameSettings::of(&scene)).unwrap();
    }
}

#[test]
fn an_id_beside_all_varyings_that_a_device_promises() {
    let varyings: String = (2..16)
        .map(|l| format!("@location({l}) more_{l}: f32, "))
        .collect();
    let given = vec!["uv.x"; 14].join(", ");
    let body = "return object.tint + in.more_15 * 0.1;";
    let mut scene = floor(shader("sixteen", "", &varyings, &given, body));
    assert_eq!(refused(&scene), "too-many-varyings");
    let limit = |recipe: &str| {
        let plan = split(&originals(&scene)[0], recipe);
        let ids = plan.passes.iter().find(|p| p.role == Role::Ids).unwrap();
        ids.limits.get("maxInterStageShaderVariables").copied()
    };
    assert_eq!(limit("visibility-buffer:vertex=same"), Some(17));
    assert_eq!(limit("visibility-buffer:vertex=sliced"), None);
    scene = scene.with_invariant_positions();
    assert_rounds(&scene);
}

#[test]
fn what_selects_nothing_is_refused() {
    let scene = floor(shader("plain", "", "", "", "return object.tint;"));
    for parameters in [
        "form=binned,select=tiles",
        "form=binned,select=id",
        "form=compute,select=depth",
    ] {
        let recipe = Recipe::parse([format!("visibility-buffer:{parameters}")]).unwrap();
        let refusal = recipe.apply(&originals(&scene)[0], seen()).unwrap_err();
        assert_eq!(refusal.code, "select", "{parameters}");
    }
}

#[test]
fn names_of_ours_may_be_the_authors() {
    let body = "return vec4(0.5 + 0.4 * sin(in.world * 3.0), 1.0) * object.tint;";
    let text = shader("names", "", "", "", body);
    let text = text.program.author_text().unwrap().to_owned();
    for (vertex, fragment) in [
        ("vs_visible", "fs_visible"),
        ("vs_visible_ids", "fs_visible_ids"),
        ("cs_visible", "vs_visible"),
    ] {
        let text = text.replace("fn vs(", &format!("fn {vertex}("));
        let text = text.replace("fn fs(", &format!("fn {fragment}("));
        let mut material = material("names", &text);
        (material.vertex, material.fragment) = (vertex.to_owned(), Some(fragment.to_owned()));
        material.state.primitive.cull = CullMode::None;
        assert_rounds(&floor(material));
    }
}

/// What is not a stage has our names, or overrides those of our arguments and variables.
#[test]
fn names_of_ours_may_be_anything_of_the_authors() {
    let ours = [
        "vs_visible",
        "fs_visible",
        "cs_visible",
        "vs_visible_ids",
        "fs_visible_ids",
        "visible_cross",
        "visibility",
    ];
    for name in ours {
        for declared in [
            format!(
                "fn {name}() -> f32 {{ return 0.25; }} fn shade() -> f32 {{ return {name}(); }}"
            ),
            format!("struct {name} {{ v: f32 }} fn shade() -> f32 {{ return {name}(0.25).v; }}"),
            format!("const {name} = vec2(0.25, 0.5); fn shade() -> f32 {{ return {name}.x; }}"),
        ] {
            let body = "return vec4(shade() + 0.4 * sin(in.world), 1.0) * object.tint;";
            assert_drawn(&floor(shader("named", &declared, "", "", body)), &declared);
        }
    }
    for name in [
        "a", "b", "c", "at", "id", "vertex", "instance", "triangle", "corner", "weights", "edges",
        "pixel", "number",
    ] {
        let declared = format!("override {name}: f32 = 0.25;");
        let body = format!("return vec4({name} + 0.4 * sin(in.world), 1.0) * object.tint;");
        assert_drawn(&floor(shader("held", &declared, "", "", &body)), &declared);
    }
}

/// Drawn in two forms, from the text that is shipped, as forward within a step.
fn assert_drawn(scene: &Scene, what: &str) {
    let plans = originals(scene);
    let order = DrawOrder::AsGiven;
    let forward = render_as(gpu(), scene, &plans, order, ShaderForm::Text);
    for form in [
        "visibility-buffer",
        "visibility-buffer:form=compute,vertices=kept",
    ] {
        let split: Vec<Plan> = plans.iter().map(|p| split(p, form)).collect();
        let targets = [preshade_plan::plan_file::Target::Wgsl];
        preshade_compiler::emit::emit(
            &split[0],
            &targets,
            &preshade_compiler::emit::Options::default(),
        )
        .unwrap_or_else(|e| panic!("{what}: {e}"));
        let drawn = render_as(gpu(), scene, &split, order, ShaderForm::Text);
        let found = difference(&forward, &drawn);
        assert!(found.most <= 1, "{what}, {form}: {found:?}");
    }
}

/// What is drawn that is no number is stored in no other way.
#[test]
fn what_is_no_number_is_stored_as_it_is_drawn() {
    for format in ["rgba8unorm", "rgba8unorm-srgb"] {
        for body in [
            "return vec4(pow(in.world - 0.3, vec3(2.2)), 1.0) * object.tint;",
            "return vec4(0.5, 0.2, 0.4, sqrt(in.world.x));",
            "let far = in.world.x * 1e20 * 1e20; return vec4(far, -far, far - far, 1.0);",
        ] {
            let mut material = shader("none", "", "", "", body);
            material.state.targets = vec![Some(ColorTarget::opaque(format))];
            let scene = floor(material);
            let plans = originals(&scene);
            let order = DrawOrder::AsGiven;
            let forward = render_as(gpu(), &scene, &plans, order, ShaderForm::Text);
            for form in [
                "visibility-buffer",
                "visibility-buffer:form=compute",
                "visibility-buffer:form=binned",
            ] {
                let split: Vec<Plan> = plans.iter().map(|p| split(p, form)).collect();
                let drawn = render_as(gpu(), &scene, &split, order, ShaderForm::Text);
                let found = difference(&forward, &drawn);
                // At the edge of what is a number a last bit decides.
                let pixels = (scene.size[0] * scene.size[1]) as usize;
                let far = |p: &[u8], q: &[u8]| p.iter().zip(q).any(|(p, q)| p.abs_diff(*q) > 1);
                let [a, b] = [&forward, &drawn].map(|r| &r.colors[0].as_ref().unwrap().bytes);
                let beyond = a
                    .chunks_exact(4)
                    .zip(b.chunks_exact(4))
                    .filter(|(p, q)| far(p, q));
                let beyond = beyond.count();
                assert!(
                    beyond * 1000 <= pixels,
                    "{format}, {form}, {body}: {beyond}, {found:?}"
                );
            }
        }
    }
}

/// A colour that goes to no target, and one of half precision where the adapter has it.
#[test]
fn colours_are_stored_where_there_is_a_target() {
    let text = shader("two", "", "", "", "return object.tint;");
    let text = text.program.author_text().unwrap().to_owned();
    let stage = "struct Two { @location(0) first: vec4<f32>, @location(1) second: vec4<f32> }
@fragment fn fs(in: Out) -> Two { return Two(vec4(0.5 + 0.4 * sin(in.world), 1.0), vec4(in.uv, \
    0.0, 1.0)); }";
    let text = format!("{}{stage}", &text[..text.find("@fragment").unwrap()]);
    let mut two = material("two", &text);
    two.state.primitive.cull = CullMode::None;
    assert_rounds(&floor(two));
    let half = shader("half", "", "", "", "return object.tint;");
    let half = half.program.author_text().unwrap().to_owned();
    let stage = "@fragment fn fs(in: Out) -> @location(0) vec4<f16> { \
                 return vec4<f16>(vec4(0.5 + 0.4 * sin(in.world), 1.0)); }";
    let half = format!(
        "enable f16;\n{}{stage}",
        &half[..half.find("@fragment").unwrap()]
    );
    let half = floor(material("half", &half));
    for form in [
        "visibility-buffer:form=compute",
        "visibility-buffer:form=binned",
    ] {
        let plan = split(&originals(&half)[0], form);
        let targets = [preshade_plan::plan_file::Target::Wgsl];
        preshade_compiler::emit::emit(
            &plan,
            &targets,
            &preshade_compiler::emit::Options::default(),
        )
        .unwrap();
    }
}

#[test]
fn a_fragment_stage_without_colours_is_refused() {
    let text = shader("none", "", "", "", "return object.tint;");
    let text = text.program.author_text().unwrap().to_owned();
    let stage = "@fragment fn fs(in: Out) { if in.uv.x > 0.5 { discard; } }";
    let text = format!("{}{stage}", &text[..text.find("@fragment").unwrap()]);
    assert_eq!(refused(&floor(material("none", &text))), "no-color");
}

#[test]
fn derivatives_by_name_and_in_called_functions() {
    let declared = "fn soft(v: f32) -> f32 { return fwidth(v) * 2.0; }
fn twice(v: f32) -> f32 { return soft(v) + soft(v * 0.5); }";
    let body = "return vec4(0.3 + twice(in.uv.x), 0.3 + dpdx(in.uv.y), 0.3 - dpdyFine(in.uv.y) + \
                dpdxCoarse(in.uv.x), 1.0) * object.tint;";
    let difference = compared(&floor(shader("derived", declared, "", "", body)));
    assert!(difference.most <= 1, "{difference:?}");
}

#[test]
fn derivatives_of_what_does_not_vary() {
    for body in [
        "return textureSample(albedo, smooth_sampler, SOMEWHERE) * object.tint;",
        "return object.tint + vec4(dpdx(0.3));",
    ] {
        let declared = format!("{TEXTURES}\nconst SOMEWHERE = vec2(0.3, 0.4);");
        let mut material = shader("constant", &declared, "", "", body);
        if body.contains("albedo") {
            material.textures.insert("albedo".to_owned(), pattern());
        }
        assert_rounds(&floor(material));
    }
}

#[test]
fn holes_and_written_depths() {
    let declared = TEXTURES;
    let body = "if textureSample(albedo, smooth_sampler, in.uv).g < 0.5 { discard; }
    return vec4(0.5 + 0.3 * sin(in.world), 1.0) * object.tint;";
    let mut holes = shader("holes", declared, "", "", body);
    holes.textures.insert("albedo".to_owned(), pattern());
    let mut scene = floor(holes);
    assert_rounds(&scene);
    let text = scene.materials[0].program.author_text().unwrap().to_owned();
    let stage = "struct Written { @location(0) color: vec4<f32>, @builtin(frag_depth) depth: f32 }
@fragment fn fs(in: Out) -> Written {
    if in.uv.x > 2.0 { discard; }
    return Written(vec4(0.5 + 0.3 * sin(in.world), 1.0) * object.tint, in.at.z * 0.5);
}";
    let text = format!("{}{stage}", &text[..text.find("@fragment").unwrap()]);
    let mut material = material("written", &text);
    material.state.primitive.cull = CullMode::None;
    scene.materials = vec![material];
    assert_rounds(&scene);
}

#[test]
fn what_was_hoisted_is_split_too() {
    let body = "let n = normalize(in.world + vec3(0.0, 3.0, 0.0));
    return vec4(0.5 + 0.4 * n * object.tint.rgb, 1.0);";
    let mut scene = floor(shader("hoisted", "", "", "", body));
    let tint = Value::Numbers(vec![0.9, 0.7, 0.5, 1.0]);
    scene.draws[0].values.insert("object.tint".to_owned(), tint);
    let recipe = Recipe::parse_list("hoist:budget=1,finite=assumed,jumps=carried").unwrap();
    let hoisted: Vec<Plan> = originals(&scene)
        .iter()
        .map(|p| recipe.apply(p, &Facts::default()).unwrap())
        .collect();
    let split: Vec<Plan> = hoisted
        .iter()
        .map(|p| split(p, "visibility-buffer"))
        .collect();
    let [a, b] = [&hoisted, &split]
        .map(|p| render_as(gpu(), &scene, p, DrawOrder::AsGiven, ShaderForm::Text));
    let difference = difference(&a, &b);
    assert_eq!((difference.coverage, difference.depths), (0, 0));
    assert!(difference.most <= 1, "{difference:?}");
}

#[test]
fn a_neighbour_that_is_not_split_is_drawn_behind() {
    let mut scene = three_draws();
    let state = format!("{TEXTURES} var<private> seen: f32;");
    let body = "seen = 0.7; return vec4(in.uv + seen, 0.5, 1.0) * object.tint;";
    scene.materials[1] = shader("other", &state, "", "", body);
    let plans = originals(&scene);
    let order = DrawOrder::AsGiven;
    let forward = render_as(gpu(), &scene, &plans, order, ShaderForm::Text);
    for form in FORMS {
        let recipe = Recipe::parse_list(&within_any(form)).unwrap();
        let variant = measure::variant(&plans, &recipe, &Facts::default());
        let kept: Vec<&str> = variant.kept.iter().map(|k| k.material.as_str()).collect();
        assert_eq!(kept, ["other"]);
        let drawn = render_as(gpu(), &scene, &variant.plans, order, ShaderForm::Text);
        let difference = difference(&forward, &drawn);
        assert_eq!((difference.coverage, difference.depths), (0, 0), "{form}");
        assert!(
            difference.most <= 1 && difference.colors < 20,
            "{difference:?}"
        );
    }
}

#[test]
fn a_neighbour_that_moves_depth_keeps_it_from_being_split() {
    let mut scene = three_draws();
    scene.materials[1].state.depth_compare = Some(preshade_plan::state::CompareFunction::Always);
    let plans = originals(&scene);
    let recipe = Recipe::parse(["visibility-buffer:budget=1"]).unwrap();
    let variant = measure::variant(&plans, &recipe, &Facts::default());
    let why: Vec<&str> = variant.kept.iter().map(|k| k.why.as_str()).collect();
    assert!(why[0].contains("neighbour-moves-depth"), "{why:?}");
    assert!(why[1].contains("compare"), "{why:?}");
}

#[test]
fn a_neighbour_that_writes_no_depth_keeps_it_from_being_split() {
    let mut scene = three_draws();
    // A sky, drawn first.
    scene.materials[1].state.depth_write = false;
    scene.draws[0].material = 1;
    let plans = originals(&scene);
    for (recipe, kept) in [
        ("visibility-buffer:budget=1", 2),
        ("depth-prepass:form=biased", 1),
    ] {
        let recipe = Recipe::parse([recipe]).unwrap();
        let variant = measure::variant(&plans, &recipe, seen());
        let why: Vec<&str> = variant.kept.iter().map(|k| k.why.as_str()).collect();
        assert_eq!(why.len(), kept, "{why:?}");
        if kept == 2 {
            assert!(why[0].contains("neighbour-without-depth"), "{why:?}");
        }
        let order = DrawOrder::AsGiven;
        let [forward, drawn] =
            [&plans, &variant.plans].map(|p| render_as(gpu(), &scene, p, order, ShaderForm::Text));
        assert!(forward == drawn);
    }
}

#[test]
fn positions_are_the_authors_or_marked() {
    let mut scene = floor(shader("plain", "", "", "", "return object.tint;"));
    let given = |scene: &Scene, recipe: &str| {
        let plan = promised(&originals(scene)[0], recipe);
        let given = plan.contract.given().to_vec();
        assert!(given.contains(&Assumption::SameDrawOrder));
        // What is not marked may be rounded otherwise.
        let is_rounded = matches!(
            plan.contract,
            Contract::Rounding {
                turned: Some(Turned {
                    surface: Surface::Rounded,
                    ..
                }),
                ..
            }
        );
        assert_ne!(is_rounded, given.contains(&Assumption::InvariantPosition));
        let pass = plan.passes.iter().find(|p| p.role == Role::Ids).unwrap();
        let program = plan.program(pass).unwrap();
        let (_, entry) = program
            .entry_point(naga::ShaderStage::Vertex, &pass.vertex)
            .unwrap();
        let outputs = naga_edit::interface::outputs(program.module(), &entry.function);
        let marked = naga::Binding::BuiltIn(naga::BuiltIn::Position { invariant: true });
        (
            outputs.len(),
            outputs.iter().any(|o| o.binding == Some(marked.clone())),
            given.contains(&Assumption::InvariantOriginal),
        )
    };
    // The position, two varyings and the id; or the position and the id, marked.
    assert_eq!(given(&scene, "visibility-buffer"), (4, false, false));
    let sliced = "visibility-buffer:vertex=sliced";
    assert_eq!(given(&scene, sliced), (2, true, true));
    let as_written = "visibility-buffer:vertex=sliced,invariant=as-written";
    assert_eq!(given(&scene, as_written), (2, false, false));
    scene = scene.with_invariant_positions();
    assert_eq!(given(&scene, "visibility-buffer"), (2, true, false));
}

#[test]
fn a_self_test_holds_the_id_pass_against_the_original() {
    let scene = three_draws();
    let inputs = SceneInputs::new(gpu(), &scene).unwrap();
    let marked = scene.clone().with_invariant_positions();
    let all = FORMS.map(|form| (&scene, form));
    for (scene, form) in all.into_iter().chain(OF_MARKED.map(|form| (&marked, form))) {
        for plan in originals(scene) {
            let mut plan = split(&plan, form);
            let run = |plan: &Plan| self_test(&inputs, plan, ShaderForm::Text).unwrap().unwrap();
            let result = run(&plan);
            assert!(
                matches!(result, SelfTestResult::Held { samples } if samples > 1000),
                "{form}: {result:?}"
            );
            // One step farther away.
            let ids = plan.passes.iter_mut().find(|p| p.role == Role::Ids);
            ids.unwrap().depth.as_mut().unwrap().bias.constant = 1;
            let result = run(&plan);
            assert!(
                matches!(result, SelfTestResult::Failed { .. }),
                "{form}: {result:?}"
            );
        }
    }
}

#[test]
fn it_is_not_split_behind_a_prepass_nor_twice() {
    let scene = three_draws();
    let plan = &originals(&scene)[0];
    for (recipe, code) in [
        ("depth-prepass,visibility-buffer", "has-prepass"),
        ("visibility-buffer:budget=1,depth-prepass", "no-main-pass"),
        (
            "visibility-buffer:budget=1,visibility-buffer",
            "no-main-pass",
        ),
    ] {
        let recipe = Recipe::parse_list(recipe).unwrap();
        let refusal = recipe.apply(plan, &Facts::default()).unwrap_err();
        assert_eq!(refusal.code, code);
    }
}

#[test]
fn what_cannot_be_split_is_refused() {
    let plain = || shader("plain", TEXTURES, "", "", "return object.tint;");
    let with = |change: &dyn Fn(&mut Material)| {
        let mut material = plain();
        change(&mut material);
        refused(&floor(material))
    };
    assert_eq!(
        with(&|m| m.state.primitive.topology = preshade_plan::state::Topology::TriangleStrip),
        "topology"
    );
    assert_eq!(with(&|m| m.state.multisample.count = 4), "multisampled");
    let looped = "var sum = vec4(0.0);
    for (var i = 0; i < 3; i++) { sum += textureSample(albedo, smooth_sampler, in.uv * f32(i)); }
    return sum;";
    assert_eq!(
        refused(&floor(shader("looped", TEXTURES, "", "", looped))),
        "gradient-in-loop"
    );
    for of in [
        // Relief from the differences of a height, and a sample by its normal.
        "let h = textureSample(relief, smooth_sampler, in.uv).x; \
         let n = normalize(in.world + dpdx(h)); return textureSample(albedo, smooth_sampler, \
         n.xz);",
        "let l = length(vec2(dpdx(in.uv.x * in.uv.x), dpdy(in.uv.y))); return vec4(fwidth(l));",
        "return vec4(dpdx(dpdy(in.uv.x * in.uv.y) * 2.0));",
        "return vec4(dpdx(dpdy(in.uv.x * in.uv.y)));",
        "return vec4(dpdxCoarse(dpdyCoarse(in.uv.x * in.uv.y)));",
        "return textureSample(albedo, smooth_sampler, dpdxFine(in.uv) * 40.0);",
        "return textureSample(albedo, smooth_sampler, dpdxFine(in.uv));",
    ] {
        let material = shader("twice", TEXTURES, "", "", of);
        assert_eq!(refused(&floor(material)), "gradient-of-gradient", "{of}");
    }
    let compared = "@group(1) @binding(1) var map: texture_depth_2d;
@group(1) @binding(2) var compare: sampler_comparison;";
    let body = "return object.tint * textureSampleCompare(map, compare, in.uv, 0.5);";
    assert_eq!(
        refused(&floor(shader("shadowed", compared, "", "", body))),
        "no-gradient-form"
    );
    let state = "var<private> seen: f32;";
    let body = "seen = in.uv.x; return object.tint * seen;";
    assert_eq!(
        refused(&floor(shader("state", state, "", "", body))),
        "fragment-state"
    );
}

#[test]
fn a_derivative_that_is_not_fine_rests_on_the_drivers_choice() {
    for (derivative, rests) in [
        ("dpdx", true),
        ("fwidth", true),
        ("dpdyCoarse", true),
        ("dpdyFine", false),
        ("fwidthFine", false),
    ] {
        let body = format!("return object.tint + 0.1 * {derivative}(in.uv.x * in.uv.y);");
        let scene = floor(shader("derived", "", "", "", &body));
        let plan = split(&originals(&scene)[0], "visibility-buffer");
        let named = Assumption::DerivativeNeighbours;
        assert_eq!(
            plan.contract.given().contains(&named),
            rests,
            "{derivative}"
        );
    }
}

fn resolve_in_compute(plans: &[Plan]) -> bool {
    plans
        .iter()
        .flat_map(|p| &p.passes)
        .all(|p| p.role != Role::Resolve)
}

#[test]
fn srgb_targets_and_float_ones() {
    let waves = "return vec4(0.4 + 0.4 * sin(in.world * 3.0), 0.7) * object.tint;";
    for format in ["rgba8unorm-srgb", "rgba16float"] {
        let mut material = shader("waves", "", "", "", waves);
        material.state.targets = vec![Some(ColorTarget::opaque(format))];
        let scene = floor(material);
        let plans = originals(&scene);
        let draw = |plans: &[Plan]| {
            let drawn = render_as(gpu(), &scene, plans, DrawOrder::AsGiven, ShaderForm::Text);
            drawn.colors[0].clone().unwrap()
        };
        let forward = draw(&plans);
        for form in FORMS {
            let split: Vec<Plan> = plans.iter().map(|p| split(p, form)).collect();
            let drawn = draw(&split);
            assert_eq!((drawn.format, drawn.size), (forward.format, forward.size));
            let pixels = (scene.size[0] * scene.size[1]) as usize;
            let step = |a: f32, b: f32| (a - b).abs() > 1.01 / 255.0;
            let far = (0..pixels).filter(|i| {
                let (a, b) = (forward.rgba(*i), drawn.rgba(*i));
                a.iter().zip(b).any(|(a, b)| step(*a, b))
            });
            assert_eq!(far.count(), 0, "{format} {form}");
            // A target may encode by a curve of its own: Direct3D grants it 0.6 of a step.
            let encodes = format.ends_with("srgb") && resolve_in_compute(&split);
            let changed = (0..pixels).filter(|i| forward.texel(*i) != drawn.texel(*i));
            let changed = changed.count();
            assert!(
                encodes || changed * 50 < pixels,
                "{format} {form}: {changed}"
            );
        }
    }
}

#[test]
fn texts() {
    let body = "return vec4(in.uv, 0.5, 1.0) * object.tint;";
    let scene = floor(shader("texts", "", "", "", body));
    let mut out = String::new();
    for recipe in [
        "visibility-buffer:select=tiles,corners=snapped,budget=1",
        "visibility-buffer:form=binned,words=one,budget=1",
    ] {
        // For any adapter.
        let recipe = Recipe::parse([recipe]).unwrap();
        let plan = &originals(&scene)[0];
        let plan = recipe.apply(plan, &Facts::default()).unwrap();
        let files = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
        for file in files {
            if file.name.ends_with(".wgsl") && !file.name.contains("original") {
                let text = String::from_utf8(file.bytes).unwrap();
                out.push_str(&format!("---- {}\n{text}\n", file.name));
            }
        }
        for compute in &plan.compute {
            let bound: Vec<&str> = compute.bindings.iter().map(|b| b.name.as_str()).collect();
            out.push_str(&format!(
                "compute {} {:?} {:?} {:?}: {}\n",
                compute.entry_point,
                compute.when,
                compute.draws,
                compute.geometry,
                bound.join(", ")
            ));
        }
    }
    insta::assert_snapshot!(out);
}

#[test]
fn the_emitted_text_and_the_ir_draw_alike() {
    let scene = three_draws();
    let plans: Vec<Plan> = originals(&scene)
        .iter()
        .map(|p| split(p, "visibility-buffer:budget=1"))
        .collect();
    let [text, ir] = [ShaderForm::Text, ShaderForm::Ir]
        .map(|form| render_as(gpu(), &scene, &plans, DrawOrder::AsGiven, form));
    assert_eq!(text, ir);
}

/// The rim of a ray-traced sphere, far away through a long lens: what cancels under the root is all
/// there is, and comes out as steps.
#[test]
fn a_root_of_what_cancels_is_promised_nothing_without_a_budget() {
    let path =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scenes/frag-depth.toml");
    let mut scene = preshade_scenes::load(&path).unwrap().resized([320, 180]);
    let eye = Vec3::new(30.0, 27.0, 90.0);
    let frame = &mut scene.cameras[0].frames[0];
    frame.view = Mat4::look_at_rh(eye, Vec3::new(0.0, 1.8, 0.0), Vec3::Y);
    frame.projection = Mat4::perspective_rh(0.14, 320.0 / 180.0, 0.1, 600.0);
    frame.eye = eye;
    assert_eq!(refused(&scene), "interpolated");
    let difference = compared_with(&scene, &["visibility-buffer:budget=1".to_owned()]);
    assert!(difference.most > 1, "{difference:?}");
}
