//! Subdivided geometry covers what it covered: no cracks, no overlaps, and at level 1 the picture
//! it was made from.

use std::collections::BTreeMap;

use glam::{Mat4, Vec3};
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{ColorImage, Rendered};
use preshade_draw::scene::{Draw, DrawOrder, Frame, Scene};
use preshade_lab::measure;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::state::{Blend, ColorTarget, CompareFunction};
use preshade_scenes::ShaderForm;
use preshade_scenes::mesh::Sphere;

use crate::render_support::{self, gpu, material, render_as, scene};

/// Green waves to hoist, and a step of red for each fragment.
const WAVES: &str = "
struct Camera { view_proj: mat4x4<f32>, time: f32 }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(1) @binding(0) var<uniform> model: mat4x4<f32>;
struct VertexOut { @builtin(position) clip: vec4<f32>, @location(0) world: vec3<f32>, \
    @location(1) uv: vec2<f32> }
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> VertexOut {
    let world = model * vec4(position, 1.0);
    return VertexOut(camera.view_proj * world, world.xyz, uv);
}
@fragment fn fs(in: VertexOut) -> @location(0) vec4<f32> {
    let waves = sin(in.world.x * 9.0) * cos(in.world.y * 7.0) * sin(in.world.z * 8.0 + \
        camera.time) * exp(sin(in.world.x * 5.0)) + sin(exp(in.world.y));
    return vec4(1.0 / 255.0, 0.5 + 0.2 * waves, 0.0, 1.0) + 0.0 * in.uv.xyxy;
}
";

fn sphere(source: &str) -> Scene {
    let mut scene = scene([211, 173], vec![material("waves", source)], Vec::new());
    scene.meshes = vec![
        Sphere {
            radius: 1.0,
            segments: 13,
            rings: 7,
        }
        .mesh("sphere"),
    ];
    scene.draws = vec![Draw {
        transform: Mat4::from_rotation_x(0.7) * Mat4::from_rotation_y(0.3),
        values: BTreeMap::new(),
        ..render_support::draw("sphere", Mat4::IDENTITY, [1.0; 4])
    }];
    let eye = Vec3::new(0.3, 0.4, 2.6);
    let view = Mat4::look_at_rh(eye, Vec3::ZERO, Vec3::Y);
    scene.cameras[0].frames = vec![Frame {
        view,
        projection: Mat4::perspective_rh(0.9, 211.0 / 173.0, 0.1, 10.0),
        eye,
        time: 0.4,
    }];
    scene
}

fn plans(scene: &Scene, recipe: &[&str]) -> Vec<Plan> {
    let recipe = Recipe::parse(recipe).unwrap();
    let facts = Facts::default();
    measure::originals(scene)
        .iter()
        .map(|p| recipe.apply(p, &facts).unwrap_or_else(|r| panic!("{r}")))
        .collect()
}

fn draw(scene: &Scene, recipe: &[&str]) -> Rendered {
    let plans = plans(scene, recipe);
    let text = render_as(gpu(), scene, &plans, DrawOrder::AsGiven, ShaderForm::Text);
    let ir = render_as(gpu(), scene, &plans, DrawOrder::AsGiven, ShaderForm::Ir);
    assert_eq!(text, ir, "text and IR differ");
    text
}

fn color(rendered: &Rendered) -> &ColorImage {
    rendered.colors[0].as_ref().unwrap()
}

const HOIST: &str = "hoist:budget=0.05,finite=assumed,jumps=carried";

/// Every pattern in every form.
const PARAMETERS: [&str; 6] = [
    "pattern=gl,form=pulled",
    "pattern=uniform,form=pulled",
    "pattern=gl,form=shared",
    "pattern=uniform,form=shared",
    "pattern=gl,form=static,fixed=model+camera.time",
    "pattern=uniform,form=static,fixed=model+camera.time",
];

/// Fragments of each pixel, counted in steps of red.
fn counting(mut scene: Scene) -> Scene {
    let state = &mut scene.materials[0].state;
    state.targets = vec![Some(ColorTarget {
        blend: Some(Blend::ADD),
        ..ColorTarget::opaque("rgba8unorm")
    })];
    state.depth_compare = Some(CompareFunction::Always);
    state.depth_write = false;
    scene
}

#[test]
fn level_1_is_the_picture_it_was_made_from() {
    let scene = sphere(WAVES);
    let hoisted = draw(&scene, &[HOIST]);
    for parameters in PARAMETERS {
        let one = draw(
            &scene,
            &[HOIST, &format!("tessellate:level=1,{parameters}")],
        );
        assert_eq!(one, hoisted, "{parameters}");
    }
}

#[test]
fn a_closed_mesh_has_neither_cracks_nor_overlaps() {
    let scene = counting(sphere(WAVES));
    for parameters in PARAMETERS {
        for level in 1..=8 {
            let recipe = format!("tessellate:level={level},{parameters}");
            let picture = draw(&scene, &[HOIST, &recipe]);
            let image = color(&picture);
            let mut counts = BTreeMap::new();
            let [width, height] = image.size.map(|n| n as usize);
            for y in 0..height {
                let row = y * width..(y + 1) * width;
                let red: Vec<u8> = row.map(|i| image.texel(i)[0]).collect();
                let Some(first) = red.iter().position(|r| *r != 0) else {
                    continue;
                };
                let last = red.iter().rposition(|r| *r != 0).unwrap();
                for r in &red[first..=last] {
                    *counts.entry(*r).or_insert(0) += 1;
                }
            }
            let once: u32 = counts.get(&1).copied().unwrap_or_default();
            assert!(once > 8000, "{recipe}: {counts:?}");
            assert_eq!(counts.len(), 1, "{recipe}: {counts:?}");
        }
    }
}

#[test]
fn both_forms_draw_one_picture() {
    let scene = sphere(WAVES);
    for (pattern, level) in [("gl", 2), ("gl", 5), ("uniform", 3)] {
        let of = |form: &str| {
            let recipe = format!("tessellate:level={level},pattern={pattern},form={form}");
            draw(&scene, &[HOIST, &recipe])
        };
        let (pulled, shared) = (of("pulled"), of("shared"));
        assert_eq!(pulled, shared, "{pattern} {level}");
    }
}

/// More vertices follow what bends more closely: the error to the picture of every fragment falls
/// about with the square of the level.
#[test]
fn the_error_falls_with_the_level() {
    let scene = sphere(WAVES);
    let plans = measure::originals(&scene);
    let original = render_as(gpu(), &scene, &plans, DrawOrder::AsGiven, ShaderForm::Text);
    let error = |level: u32| {
        let recipe = format!("tessellate:level={level},pattern=uniform");
        let picture = draw(&scene, &[HOIST, &recipe]);
        let pairs = color(&picture).bytes.iter().zip(&color(&original).bytes);
        pairs.map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>()
    };
    let errors: Vec<f64> = [1, 2, 4, 8].map(error).to_vec();
    assert!(errors.windows(2).all(|w| w[1] < w[0] * 0.5), "{errors:?}");
}

/// A pre-pass of a subdivided main pass draws the same triangles: not a pixel and not a depth
/// changes.
#[test]
fn a_prepass_is_divided_alike() {
    let scene = sphere(WAVES);
    for parameters in PARAMETERS.into_iter().chain(["edge-pixels=9"]) {
        let divided = format!("tessellate:level=3,{parameters}");
        let forward = draw(&scene, &[HOIST, &divided]);
        for prepass in ["depth-prepass", "depth-prepass:form=equal", "early-discard"] {
            let with = draw(&scene, &[HOIST, &divided, prepass]);
            assert_eq!(with, forward, "{divided}, {prepass}");
        }
    }
}

/// Instance data are fetched by the author's instance, vertex data by the author's index, of 16
/// bits and of 32, and without indices.
#[test]
fn instances_and_indices_of_every_kind_are_fetched() {
    let source = WAVES
        .replace(
            "@location(1) uv: vec2<f32>) -> VertexOut {",
            "@location(1) uv: vec2<f32>, @location(2) instance_offset: vec3<f32>) -> VertexOut {",
        )
        .replace(
            "model * vec4(position, 1.0);",
            "model * vec4(position * 0.4 + instance_offset, 1.0);",
        );
    let mut scene = sphere(&source);
    scene.draws[0].instances = 3;
    let transform = |x: f32| Mat4::from_translation(Vec3::new(x, 0.3 * x, 0.0));
    let transforms = [-0.7, 0.1, 0.6].map(transform);
    scene.draws[0].instance_streams.insert(
        "instance_transform".to_owned(),
        preshade_draw::scene::Stream::Float {
            components: 16,
            data: transforms.iter().flat_map(|m| m.to_cols_array()).collect(),
        },
    );
    let check = |scene: &Scene, what: &str| {
        let hoisted = draw(scene, &[HOIST]);
        let lit = color(&hoisted).bytes.chunks(4).filter(|p| p[1] != 0);
        assert!(lit.count() > 3000, "{what}");
        for parameters in PARAMETERS {
            let divided = format!("tessellate:level=1,{parameters}");
            assert_eq!(
                draw(scene, &[HOIST, &divided]),
                hoisted,
                "{what}, {divided}"
            );
        }
    };
    check(&scene, "16 bits");
    let mesh = &mut scene.meshes[0];
    // More vertices than 16 bits count, of which no triangle uses the last.
    mesh.vertex_count = 70_000;
    for stream in mesh.streams.values_mut() {
        if let preshade_draw::scene::Stream::Float { components, data } = stream {
            data.resize(70_000 * *components as usize, 0.0);
        }
    }
    check(&scene, "32 bits");
    let mesh = &mut scene.meshes[0];
    let indices = mesh.indices.take().unwrap();
    for stream in mesh.streams.values_mut() {
        if let preshade_draw::scene::Stream::Float { components, data } = stream {
            let n = *components as usize;
            let gathered = indices
                .iter()
                .flat_map(|i| data[*i as usize * n..][..n].to_vec());
            *data = gathered.collect();
        }
    }
    mesh.vertex_count = indices.len() as u32;
    check(&scene, "no indices");
}

/// A strip with restarts, of 16-bit and 32-bit indices, is divided as the list of its triangles is.
#[test]
fn strips_are_divided_as_lists() {
    let mut scene = sphere(WAVES);
    scene.materials[0].state.primitive.cull = preshade_plan::state::CullMode::Back;
    let given = scene.meshes[0].indices.clone().unwrap();
    let mut triangles = given.as_chunks::<3>().0.iter().peekable();
    let (mut strip, mut list) = (Vec::new(), Vec::new());
    while let Some([a, b, c]) = triangles.next() {
        strip.extend([*b, *c, *a]);
        list.extend([*b, *c, *a]);
        // The other half of a quad goes on with the strip.
        if let Some([_, _, d]) = triangles.next_if(|[e, f, _]| (e, f) == (a, c)) {
            strip.push(*d);
            list.extend([*c, *d, *a]);
        }
        strip.push(u32::MAX);
    }
    assert_eq!(list.len(), given.len());
    assert!(strip.len() < given.len());
    scene.meshes[0].indices = Some(strip);
    scene.materials[0].state.primitive.topology = preshade_plan::state::Topology::TriangleStrip;
    let check = |scene: &Scene, what: &str| {
        let hoisted = draw(scene, &[HOIST]);
        for parameters in PARAMETERS.into_iter().chain(["edge-pixels=200"]) {
            let one = format!("tessellate:level=1,{parameters}");
            assert_eq!(draw(scene, &[HOIST, &one]), hoisted, "{what}, {one}");
        }
        let mut listed = scene.clone();
        listed.meshes[0].indices = Some(list.clone());
        listed.materials[0].state.primitive.topology = Default::default();
        for parameters in PARAMETERS {
            let many = format!("tessellate:level=4,{parameters}");
            let of_list = draw(&listed, &[HOIST, &many]);
            assert_eq!(draw(scene, &[HOIST, &many]), of_list, "{what}, {many}");
        }
    };
    check(&scene, "16 bits");
    let mesh = &mut scene.meshes[0];
    mesh.vertex_count = 70_000;
    for stream in mesh.streams.values_mut() {
        if let preshade_draw::scene::Stream::Float { components, data } = stream {
            data.resize(70_000 * *components as usize, 0.0);
        }
    }
    check(&scene, "32 bits");
}

/// Cameras that see the edges of one sphere at many lengths: near and far, along and across, and
/// from so near that some reach behind the viewer.
fn around() -> Vec<Frame> {
    let eyes = [
        [0.3, 0.4, 2.6],
        [2.2, 1.1, -1.0],
        [0.0, 1.35, 0.3],
        [-1.1, -0.1, 0.3],
        [0.2, -0.9, -0.8],
        [6.0, 3.0, -5.0],
    ];
    let of = |eye: [f32; 3]| {
        let eye = Vec3::from_array(eye);
        Frame {
            view: Mat4::look_at_rh(eye, Vec3::new(0.1, 0.2, 0.0), Vec3::Y),
            projection: Mat4::perspective_rh(0.9, 211.0 / 173.0, 0.01, 20.0),
            eye,
            time: 0.4,
        }
    };
    eyes.map(of).to_vec()
}

/// Which pixels something was drawn to, and how often more than once.
fn coverage(rendered: &Rendered) -> (Vec<bool>, usize) {
    let red = color(rendered).bytes.chunks(4).map(|p| p[0]);
    let covered = red.clone().map(|r| r > 0).collect();
    (covered, red.filter(|r| *r > 1).count())
}

/// Edges of other levels meet in every triangle, and not one pixel inside the closed mesh shows the
/// background.
#[test]
fn adaptive_levels_leave_no_cracks() {
    let mut scene = counting(sphere(WAVES));
    scene.materials[0].state.primitive.cull = preshade_plan::state::CullMode::Back;
    for frame in around() {
        scene.cameras[0].frames = vec![frame];
        let (expected, _) = coverage(&draw(&scene, &[HOIST]));
        assert!(expected.iter().filter(|c| **c).count() > 500);
        for parameters in [
            "level=16,edge-pixels=8",
            "level=7,edge-pixels=5",
            "level=2,edge-pixels=30",
            "level=40,edge-pixels=2",
        ] {
            let step = format!("tessellate:{parameters}");
            let (covered, twice) = coverage(&draw(&scene, &[HOIST, &step]));
            let eye = frame.eye;
            assert!(covered == expected, "{parameters} from {eye}");
            assert_eq!(twice, 0, "{parameters} from {eye}");
        }
    }
}

/// Shorter segments follow what bends more closely, up to what the highest level gives everywhere.
#[test]
fn shorter_segments_err_less() {
    let scene = sphere(WAVES);
    let plans = measure::originals(&scene);
    let original = render_as(gpu(), &scene, &plans, DrawOrder::AsGiven, ShaderForm::Text);
    let error = |parameters: &str| {
        let picture = draw(&scene, &[HOIST, &format!("tessellate:{parameters}")]);
        let pairs = color(&picture).bytes.iter().zip(&color(&original).bytes);
        pairs.map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>()
    };
    let errors = [32, 16, 8, 4].map(|pixels| error(&format!("level=16,edge-pixels={pixels}")));
    assert!(errors.windows(2).all(|w| w[1] < w[0] * 0.7), "{errors:?}");
    // Every edge is longer than sixteen pixels of one each: the highest level everywhere.
    let highest = error("level=8,edge-pixels=1");
    let uniform = error("level=8,pattern=uniform");
    assert!(
        (highest / uniform - 1.0).abs() < 0.02,
        "{highest} {uniform}"
    );
}

/// A sphere in two draws, of which one is left undivided: a ring of 13 edges is theirs both.
/// Divided alike there is none.
#[test]
fn an_edge_divided_on_one_side_alone_is_found() {
    let mut scene = sphere(WAVES);
    let whole = scene.meshes[0].clone();
    let indices = whole.indices.clone().unwrap();
    let height = |i: &u32| {
        let preshade_draw::scene::Stream::Float { data, .. } = &whole.streams["position"] else {
            panic!("positions are floats");
        };
        data[*i as usize * 3 + 1]
    };
    let half = |upper: bool| {
        let triangles = indices.chunks(3);
        let of_half = triangles.filter(|t| (t.iter().map(height).sum::<f32>() > 0.3) == upper);
        let mut mesh = whole.clone();
        mesh.indices = Some(of_half.flatten().copied().collect());
        mesh
    };
    scene.meshes = vec![half(true), half(false)];
    let lower = Draw {
        mesh: 1,
        material: 1,
        name: "lower".to_owned(),
        ..scene.draws[0].clone()
    };
    scene.draws.push(lower);
    scene.materials.push(material("plain", WAVES));
    let divided = plans(&scene, &[HOIST, "tessellate:level=3"]);
    assert_eq!(measure::junctions(&scene, &divided), []);
    // Of one level, but on one side alone by the length on the screen.
    let adaptive = plans(&scene, &[HOIST, "tessellate:level=3,edge-pixels=8"]);
    assert_eq!(measure::junctions(&scene, &adaptive), []);
    let found = measure::junctions(&scene, &[adaptive[0].clone(), divided[1].clone()]);
    let [found] = &found[..] else {
        panic!("{found:?}")
    };
    assert_eq!((found.edges, &*found.divided), (13, "lower"));
    let mut mixed = divided;
    mixed[1] = measure::originals(&scene)[1].clone();
    let found = measure::junctions(&scene, &mixed);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(found[0].edges, 13, "{found:?}");
    assert_eq!((&*found[0].divided, &*found[0].beside), ("sphere", "lower"));
}
