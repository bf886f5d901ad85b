//! GLSL of every dialect draws through preshade what OpenGL draws of the author's own text: same scene, same values, pictures within 1/255.
#![cfg(feature = "verify")]
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

use std::collections::BTreeMap;
use std::path::Path;

use naga::{Binding, Module, TypeInner};
use preshade::front::{self, Source};
use preshade::measure;
use preshade::passes::reflect;
use preshade::passes::state::{CullMode, MaterialState};
use preshade::render::{Rendered, ShaderForm};
use preshade::scene::bind::{self, DrawBindings, TextureContent};
use preshade::scene::{Address, DrawOrder, Filter, Scene, synthesise};

#[allow(dead_code, reason = "patches are another test's")]
mod native;
mod render_support;

use native::Native;
use native::pair::{Attribute, Draw, FirstRow, Texture, Vertices};

/// The pairs under `fixtures/glsl/dialects` that are drawn, the `#version` that a host puts before a text without one, and where rows begin: a text that says
/// `origin_upper_left` itself is not turned once more.
const PAIRS: [(&str, &str, FirstRow); 13] = [
    ("es100-textured", "#version 100\n", FirstRow::Highest),
    ("gl120-sampling", "", FirstRow::Highest),
    ("es300-block", "", FirstRow::Highest),
    ("es300-ids", "", FirstRow::Highest),
    ("gl120-arrays", "", FirstRow::Highest),
    ("gl150-window", "", FirstRow::Lowest),
    ("gl330-material", "", FirstRow::Highest),
    ("gl330-functions", "", FirstRow::Highest),
    ("gl400-matrices", "", FirstRow::Highest),
    ("gl410-samplers", "", FirstRow::Highest),
    ("seed1-tiling", "#version 100\n", FirstRow::Highest),
    ("seed4-specular", "#version 330\n", FirstRow::Highest),
    ("seed4-noise", "", FirstRow::Highest),
];

fn texts(name: &str) -> [String; 2] {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/glsl/dialects");
    ["vert", "frag"].map(|e| std::fs::read_to_string(folder.join(format!("{name}.{e}"))).unwrap())
}

fn scene(name: &str, texts: &[String; 2]) -> Scene {
    let sources = [
        Source::new(format!("{name}.vert"), &texts[0]),
        Source::new(format!("{name}.frag"), &texts[1]),
    ];
    let parsed = front::parse(&sources, &front::Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(front::Color::Never)));
    let mut state = MaterialState::default();
    state.primitive.cull = CullMode::None;
    synthesise(parsed, state).resized([320, 180])
}

/// The bytes of a member or element of a variable, by its path; the rest of the buffer from there.
fn part(
    module: &Module,
    ty: naga::Handle<naga::Type>,
    bytes: &[u8],
    path: &str,
) -> Option<Vec<u8>> {
    let path = path.trim_start_matches('.');
    if path.is_empty() {
        // Of what ends the buffer: a vec3 as the last column has no fourth word.
        let mut bytes = bytes.to_vec();
        bytes.extend([0; 16]);
        return Some(bytes);
    }
    match &module.types[ty].inner {
        TypeInner::Struct { members, .. } => {
            let end = path.find(['.', '[']).unwrap_or(path.len());
            let member = members
                .iter()
                .find(|m| m.name.as_deref() == Some(&path[..end]))?;
            part(
                module,
                member.ty,
                &bytes[member.offset as usize..],
                &path[end..],
            )
        }
        TypeInner::Array { base, stride, .. } => {
            let (index, rest) = path.strip_prefix('[')?.split_once(']')?;
            let at = index.parse::<usize>().ok()? * *stride as usize;
            part(module, *base, &bytes[at..], rest)
        }
        _ => None,
    }
}

fn native_draw<'a>(scene: &'a Scene, bound: &'a DrawBindings) -> Draw<'a> {
    let material = &scene.materials[0];
    let module = material.program.module();
    let global = |name: &str| {
        let mut all = module.global_variables.iter().map(|(_, g)| g);
        all.find(|g| g.name.as_deref() == Some(name))
            .and_then(|g| g.binding)
    };
    let buffer = |b: naga::ResourceBinding| {
        let mut all = bound.buffers.iter();
        all.find(|x| (x.group, x.binding) == (b.group, b.binding))
            .unwrap()
    };
    let mut blocks = BTreeMap::new();
    for (_, g) in module
        .global_variables
        .iter()
        .filter(|(_, g)| g.space == naga::AddressSpace::Uniform)
    {
        let name = module.types[g.ty].name.clone().unwrap_or_default();
        blocks.insert(name, buffer(g.binding.unwrap()).data.bytes.to_vec());
    }
    // `maps[1]` and `material.diffuse` became `maps_1` and `material_diffuse`.
    let mut textures = BTreeMap::new();
    for (_, g) in module.global_variables.iter() {
        let (Some(name), Some(at)) = (&g.name, g.binding) else {
            continue;
        };
        let Some(texture) = bound
            .textures
            .iter()
            .find(|t| (t.group, t.binding) == (at.group, at.binding))
        else {
            continue;
        };
        let TextureContent::Image(image) = &texture.content else {
            panic!("{name}");
        };
        let sampler = global(&format!("{name}_sampler")).unwrap();
        let mut samplers = bound.samplers.iter();
        let sampler = samplers
            .find(|s| (s.group, s.binding) == (sampler.group, sampler.binding))
            .unwrap()
            .sampler;
        let made = || Texture {
            size: image.size.map(|n| n as i32),
            levels: image.levels.clone(),
            layers: image.layers as usize,
            srgb: image.srgb,
            linear: sampler.filter == Filter::Linear,
            clamp: sampler.address == Address::ClampToEdge,
        };
        textures.insert(name.clone(), made());
        if let Some((start, end)) = name.rsplit_once('_') {
            textures.insert(format!("{start}[{end}]"), made());
            textures.insert(format!("{start}.{end}"), made());
        }
    }
    let (_, entry) = material
        .program
        .entry_point(naga::ShaderStage::Vertex, &material.vertex)
        .unwrap();
    let inputs = reflect::inputs(module, &entry.function);
    let named = |location: u32| {
        let at = |io: &&reflect::Io| matches!(io.binding, Some(Binding::Location { location: l, .. }) if l == location);
        inputs
            .iter()
            .find(at)
            .and_then(|io| io.name.clone())
            .unwrap()
    };
    let vertices = bound.vertex_buffers.iter().map(|v| Vertices {
        bytes: v.data.bytes.to_vec(),
        stride: v.stride as i32,
        per_instance: v.step == wgpu::VertexStepMode::Instance,
        attributes: v
            .attributes
            .iter()
            .map(|a| Attribute {
                name: named(a.location),
                column: 0,
                components: a.format.size() as i32 / 4,
                offset: a.offset as i32,
                integer: matches!(
                    a.format,
                    wgpu::VertexFormat::Uint32 | wgpu::VertexFormat::Uint32x4
                ),
            })
            .collect(),
    });
    let indices = bound.indices.as_ref().map(|i| match i.format {
        wgpu::IndexFormat::Uint16 => i
            .data
            .bytes
            .chunks_exact(2)
            .map(|b| u16::from_le_bytes(b.try_into().unwrap()).into())
            .collect(),
        wgpu::IndexFormat::Uint32 => i
            .data
            .bytes
            .chunks_exact(4)
            .map(|b| u32::from_le_bytes(b.try_into().unwrap()))
            .collect(),
    });
    let loose = module
        .global_variables
        .iter()
        .map(|(_, g)| g)
        .find(|g| g.name.as_deref() == Some("uniforms"));
    Draw {
        uniform: Box::new(move |path| {
            let g = loose?;
            part(module, g.ty, &buffer(g.binding?).data.bytes, path)
        }),
        blocks,
        textures,
        vertices: vertices.collect(),
        indices,
        first: bound.call.first as i32,
        count: bound.call.count as i32,
        instances: 1,
    }
}

/// What the two pictures differ in: pixels that one covers and the other does not, those that another triangle's edge decides, and the rest that are more than 1/255 apart.
fn compare(
    name: &str,
    channels: usize,
    ours: &Rendered,
    color: &[u8],
    depth: &[f32],
) -> [usize; 2] {
    let picture = ours.colors[0].as_ref().unwrap();
    let depths = &ours.depth.as_ref().unwrap().values;
    let mut covered = 0;
    let mut apart = 0;
    for i in 0..depth.len() {
        if (depths[i] == 1.0) != (depth[i] == 1.0) {
            covered += 1;
            continue;
        }
        // Where another surface is seen, the depth says so.
        let silhouette = (depths[i] - depth[i]).abs() > 1e-3;
        let texel = picture.texel(i).iter().zip(&color[4 * i..4 * i + channels]);
        if texel.into_iter().any(|(a, b)| a.abs_diff(*b) > 1) {
            match silhouette {
                true => covered += 1,
                false => apart += 1,
            }
        }
    }
    println!("  {name}: {covered} pixels at edges, {apart} of another colour");
    [covered, apart]
}

#[test]
fn pairs_draw_as_opengl_draws_them() {
    let gl = Native::new();
    println!("on {}", gl.renderer());
    let mut wrong = Vec::new();
    for (name, version, first) in PAIRS {
        let texts = texts(name);
        let scene = scene(name, &texts);
        let original = &measure::originals(&scene)[0];
        let ours = render_support::render_as(
            render_support::gpu(),
            &scene,
            std::slice::from_ref(original),
            DrawOrder::AsGiven,
            ShaderForm::Text,
        );
        let frame = &scene.cameras[0].frames[0];
        let bound: Vec<DrawBindings> = scene
            .draws
            .iter()
            .map(|draw| {
                bind::draw(
                    &scene,
                    &scene.materials[0],
                    &original.passes[0],
                    draw,
                    frame,
                )
                .unwrap()
            })
            .collect();
        let draws: Vec<Draw<'_>> = bound.iter().map(|b| native_draw(&scene, b)).collect();
        let [vertex, fragment] = &texts;
        let (vertex, fragment) = (format!("{version}{vertex}"), format!("{version}{fragment}"));
        let clear = scene.clear_color.map(|c| c as f32);
        let pixels = gl.draw_pair(first, scene.size, clear, [&vertex, &fragment], &draws);
        if let Some(folder) = std::env::var_os("PRESHADE_PICTURES") {
            let image = ours.colors[0].as_ref().unwrap();
            let [w, h] = image.size;
            for (what, bytes) in [("ours", &image.bytes), ("gl", &pixels.color)] {
                let path = Path::new(&folder).join(format!("{name}-{what}.png"));
                image::save_buffer(path, bytes, w, h, image::ColorType::Rgba8).unwrap();
            }
        }
        // Of an output of three components OpenGL leaves alpha open.
        let channels = if texts[1].contains("out vec3") { 3 } else { 4 };
        // A picture with nothing in it would prove nothing.
        let seen = pixels.depth.iter().filter(|d| **d != 1.0).count();
        assert!(seen > pixels.depth.len() / 20, "{name} draws {seen} pixels");
        let [edges, apart] = compare(name, channels, &ours, &pixels.color, &pixels.depth);
        // Rows are numbered from the other end, so a sample on an edge goes to the other side.
        if apart > 0 || edges > pixels.depth.len() / 500 {
            wrong.push((name, edges, apart));
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}
