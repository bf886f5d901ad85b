//! The tessellation stages that are emitted run: OpenGL draws what the WebGPU emulation of the same
//! level draws.

use std::path::Path;

use preshade_compiler::emit::{self, ClipSpace};
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::{ColorImage, DepthImage, Rendered};
use preshade_draw::scene::{DrawOrder, Scene, bind};
use preshade_lab::measure;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::{PlanFile, Target};
use preshade_plan::state::{CompareFunction, CullMode, FrontFace};
use preshade_scenes::ShaderForm;

use crate::native::{Attribute, Native, PatchDraw};
use crate::render_support;

const HOIST: &str = "hoist:budget=0.05,finite=assumed,jumps=carried";

/// A scene of the fixtures at half its size: one draw of one material.
fn load(name: &str) -> Scene {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/scenes");
    let scene = preshade_scenes::load(&folder.join(name)).unwrap_or_else(|e| panic!("{e:?}"));
    assert_eq!((scene.draws.len(), scene.materials.len()), (1, 1));
    let size = scene.size.map(|n| n / 2);
    scene.resized(size)
}

fn plan(scene: &Scene, recipe: &[&str]) -> Plan {
    let original = &measure::originals(scene)[0];
    let recipe = Recipe::parse(recipe).unwrap();
    recipe
        .apply(original, &Facts::default())
        .unwrap_or_else(|r| panic!("{r}"))
}

/// What wgpu draws of a plan.
fn emulated(scene: &Scene, plan: &Plan) -> Rendered {
    let plans = std::slice::from_ref(plan);
    let (gpu, order) = (render_support::gpu(), DrawOrder::AsGiven);
    render_support::render_as(gpu, scene, plans, order, ShaderForm::Text)
}

/// What OpenGL draws of a hoisted plan, from the files a host is given and what `plan.json` says of
/// them.
fn tessellated(gl: &Native, scene: &Scene, hoisted: &Plan, level: u32) -> Rendered {
    let options = emit::Options {
        // Which also turns the rows: the lowest, which OpenGL's come from, is WebGPU's highest.
        glsl_clip_space: ClipSpace::OpenGl,
    };
    let files = emit::emit(hoisted, &[Target::GlslTess], &options).unwrap();
    let content = |name: &str| {
        let file = files.iter().find(|f| f.name == name).unwrap();
        std::str::from_utf8(&file.bytes).unwrap()
    };
    let name = format!("{}.plan.json", hoisted.material);
    let host: PlanFile = serde_json::from_str(content(&name)).unwrap();
    let of = &host.files[0];
    let tessellation = &of.tessellation[&Target::GlslTess];
    let stages = [
        &of.vertex[&Target::GlslTess],
        &tessellation.control,
        &tessellation.evaluation,
        &of.fragment[&Target::GlslTess],
    ];

    let pass = &hoisted.passes[0];
    let depth = pass.depth.as_ref().unwrap();
    assert_eq!(pass.primitive.cull, CullMode::Back);
    assert_eq!(pass.primitive.front_face, FrontFace::Ccw);
    assert_eq!(depth.compare, CompareFunction::Less);
    let (draw, frame) = (&scene.draws[0], &scene.cameras[0].frames[0]);
    let bound = bind::draw(scene, &scene.materials[0], pass, draw, frame).unwrap();
    let blocks = stages.iter().flat_map(|s| &s.blocks).map(|block| {
        let of = |b: &&bind::BufferBinding| [b.group, b.binding] == block.binding;
        let buffer = bound.buffers.iter().find(of).unwrap();
        (block.block.as_str(), &*buffer.data.bytes)
    });
    let [vertices] = &bound.vertex_buffers[..] else {
        panic!("one vertex buffer");
    };
    let indices = bound.indices.as_ref().unwrap();
    let bytes = &indices.data.bytes[..];
    let all: Vec<u32> = match indices.format {
        wgpu::IndexFormat::Uint16 => bytes
            .chunks_exact(2)
            .map(|b| u16::from_le_bytes(b.try_into().unwrap()).into())
            .collect(),
        wgpu::IndexFormat::Uint32 => bytes
            .chunks_exact(4)
            .map(|b| u32::from_le_bytes(b.try_into().unwrap()))
            .collect(),
    };
    let attributes = vertices.attributes.iter().map(|a| Attribute {
        location: a.location,
        components: match a.format {
            wgpu::VertexFormat::Float32 => 1,
            wgpu::VertexFormat::Float32x2 => 2,
            wgpu::VertexFormat::Float32x3 => 3,
            wgpu::VertexFormat::Float32x4 => 4,
            other => panic!("{other:?}"),
        },
        offset: a.offset as i32,
    });
    let pixels = gl.draw(&PatchDraw {
        size: scene.size,
        clear_color: scene.clear_color.map(|c| c as f32),
        stages: stages.map(|s| content(&s.file)),
        level: level as f32,
        blocks: blocks.collect(),
        vertices: &vertices.data.bytes,
        stride: vertices.stride as i32,
        attributes: attributes.collect(),
        indices: all[..indices.count as usize].to_vec(),
    });
    Rendered {
        colors: vec![Some(ColorImage {
            size: scene.size,
            format: wgpu::TextureFormat::Rgba8Unorm,
            bytes: pixels.color,
        })],
        depth: Some(DepthImage {
            size: scene.size,
            samples: 1,
            values: pixels.depth,
        }),
    }
}

/// Pixels that one picture covers and the other does not: where the depth is that of the far plane.
fn covered_otherwise(a: &Rendered, b: &Rendered) -> usize {
    let [a, b] = [a, b].map(|r| &r.depth.as_ref().unwrap().values);
    let pairs = a.iter().zip(b.iter());
    pairs.filter(|(a, b)| (**a == 1.0) != (**b == 1.0)).count()
}

/// Pixels that both cover, with a channel further apart than so many steps of 255.
fn apart(a: &Rendered, b: &Rendered, steps: u8) -> usize {
    let colors = [a, b].map(|r| r.colors[0].as_ref().unwrap());
    let depths = [a, b].map(|r| &r.depth.as_ref().unwrap().values);
    let differs = |i: &usize| {
        let texels = colors[0].texel(*i).iter().zip(colors[1].texel(*i));
        let covered = depths.iter().all(|d| d[*i] != 1.0);
        covered && texels.into_iter().any(|(a, b)| a.abs_diff(*b) > steps)
    };
    (0..depths[0].len()).filter(differs).count()
}

/// Writes pictures to look at, where `PRESHADE_PICTURES` names a folder.
fn show(name: &str, picture: &Rendered) {
    if let Some(folder) = std::env::var_os("PRESHADE_PICTURES") {
        let image = picture.colors[0].as_ref().unwrap();
        let [width, height] = image.size;
        let path = Path::new(&folder).join(format!("{name}.png"));
        image::save_buffer(path, &image.bytes, width, height, image::ColorType::Rgba8).unwrap();
    }
}

/// The bounds of [`same_picture`]. Two rasterisers may round an edge to either side of a sample, so
/// a pixel in a thousand may be covered otherwise; a varying may round otherwise in either, so a
/// colour may be a step of 255 away, and one in ten thousand more, where another triangle is seen
/// at a silhouette. On Mesa's software drivers, Vulkan against OpenGL, coverage does not differ,
/// and fewer than forty colours do, by one step.
fn same_picture(what: &str, expected: &Rendered, native: &Rendered) {
    let coverage = covered_otherwise(expected, native);
    let [any, more] = [0, 1].map(|steps| apart(expected, native, steps));
    println!(
        "  {what}: {coverage} pixels covered otherwise, {any} of another colour, {more} by more \
         than 1/255"
    );
    let [width, height] = native.colors[0].as_ref().unwrap().size;
    let pixels = (width * height) as usize;
    assert!(coverage <= pixels / 1000, "{what}");
    assert!(more <= pixels / 10_000, "{what}");
}

fn check(name: &str) {
    let gl = Native::new();
    println!("{name} on {}", gl.renderer());
    let scene = load(&format!("{name}.toml"));
    let original = emulated(&scene, &plan(&scene, &[]));
    let hoisted = plan(&scene, &[HOIST]);
    show(&format!("{name}-original"), &original);
    let mut errors = Vec::new();
    for level in [1, 2, 3, 5] {
        println!(" level {level}");
        let native = tessellated(&gl, &scene, &hoisted, level);
        show(&format!("{name}-native-{level}"), &native);
        let step = format!("tessellate:pattern=gl,level={level}");
        let same = emulated(&scene, &plan(&scene, &[HOIST, &step]));
        show(&format!("{name}-emulated-{level}"), &same);
        same_picture("the emulation", &same, &native);
        if level == 1 {
            same_picture("hoisted alone", &emulated(&scene, &hoisted), &native);
        }
        let error = measure::compare(&original, &native).unwrap();
        println!(
            "  the original: FLIP mean {:.6}, p99 {:.5}, max {:.4}",
            error.flip_mean, error.flip_p99, error.max_abs
        );
        errors.push(error.flip_mean);
    }
    // Each level comes closer to the picture with all of it in the fragment stage, and the last one
    // at least four times as close as the first.
    assert!(errors.is_sorted_by(|a, b| a > b), "{errors:?}");
    assert!(errors[3] < errors[0] / 4.0, "{errors:?}");
}

#[test]
fn noise() {
    check("teapot-noise");
}

#[test]
fn specular() {
    check("teapot-specular");
}
