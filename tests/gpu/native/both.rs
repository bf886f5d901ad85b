//! One pair on both roads: through preshade on wgpu, and as its author wrote it on OpenGL, from the
//! same bytes.

use std::collections::BTreeMap;

use naga::{Binding, Module, ResourceBinding, ShaderStage, TypeInner};
use preshade::unstable::front::{self, Source};
use preshade::unstable::measure;
use preshade::unstable::passes::declared::{Declared, Type as Declares};
use preshade::unstable::passes::reflect;
use preshade::unstable::passes::state::{CullMode, MaterialState};
use preshade::unstable::render::{Rendered, ShaderForm};
use preshade::unstable::scene::bind::{self, DrawBindings, TextureContent};
use preshade::unstable::scene::{Address, DrawOrder, Filter, Scene, synthesise};

use super::pair::{Attribute, Draw, FirstRow, Texture, Vertices};
use super::{Native, Pixels};
use crate::render_support;

/// A scene for a pair whose uniforms get what their names say, or anything.
pub fn scene(name: &str, texts: &[String; 2], size: [u32; 2]) -> Result<Scene, String> {
    let sources = [
        Source::new(format!("{name}.vert"), &texts[0]),
        Source::new(format!("{name}.frag"), &texts[1]),
    ];
    // What OpenGL draws is written for OpenGL, whatever its dialect.
    let options = front::Options {
        clip_space: Some(front::ClipSpace::OpenGl),
        ..front::Options::default()
    };
    let parsed = front::parse(&sources, &options).map_err(|e| e.render(front::Color::Never))?;
    let mut state = MaterialState::default();
    state.primitive.cull = CullMode::None;
    Ok(synthesise(parsed, state).resized(size))
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

/// A draw as OpenGL is told of it.
pub fn native_draw<'a>(scene: &'a Scene, bound: &'a DrawBindings) -> Draw<'a> {
    let material = &scene.materials[0];
    let module = material.program.module();
    let declared = material.program.declared();
    let buffer = |b: ResourceBinding| {
        let mut all = bound.buffers.iter();
        all.find(|x| (x.group, x.binding) == (b.group, b.binding))
    };
    let blocks = declared.blocks.iter().filter_map(|b| {
        let bytes = buffer(b.binding)?.data.bytes.to_vec();
        Some((b.name.clone(), bytes))
    });
    let loose = module
        .global_variables
        .iter()
        .map(|(_, g)| g)
        .find(|g| g.binding.is_some() && g.binding == declared.loose);
    let vertices = bound.vertex_buffers.iter().map(|v| Vertices {
        bytes: v.data.bytes.to_vec(),
        stride: v.stride as i32,
        per_instance: v.step == wgpu::VertexStepMode::Instance,
        attributes: v
            .attributes
            .iter()
            .map(|a| {
                let (name, column) = attribute(&material.program, &material.vertex, a.location);
                Attribute {
                    name,
                    column,
                    components: a.format.size() as i32 / 4,
                    offset: a.offset as i32,
                    integer: matches!(
                        a.format,
                        wgpu::VertexFormat::Uint32 | wgpu::VertexFormat::Uint32x4
                    ),
                }
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
    Draw {
        uniform: Box::new(move |path| {
            let g = loose?;
            part(module, g.ty, &buffer(g.binding?)?.data.bytes, path)
        }),
        blocks: blocks.collect(),
        textures: textures(declared, bound),
        vertices: vertices.collect(),
        indices,
        first: bound.call.first as i32,
        count: bound.call.count as i32,
        instances: bound.instances as i32,
    }
}

/// The textures by the author's paths: `maps[1]`, `material.diffuse`.
fn textures(declared: &Declared, bound: &DrawBindings) -> BTreeMap<String, Texture> {
    let mut out = BTreeMap::new();
    for combined in &declared.samplers {
        let at = |b: ResourceBinding| (b.group, b.binding);
        let mut textures = bound.textures.iter();
        let texture = textures.find(|t| (t.group, t.binding) == at(combined.texture));
        let mut samplers = bound.samplers.iter();
        let sampler = samplers.find(|s| (s.group, s.binding) == at(combined.sampler));
        let Some(texture) = texture else {
            continue;
        };
        // One that is only fetched from has no sampler in the plan, and any will do.
        let sampler = sampler.map(|s| s.sampler).unwrap_or_default();
        let TextureContent::Image(image) = &texture.content else {
            panic!("{} is no image", combined.path);
        };
        let made = Texture {
            size: image.size.map(|n| n as i32),
            levels: image.levels.clone(),
            layers: image.layers as usize,
            srgb: image.format.is_srgb(),
            linear: sampler.filter == Filter::Linear,
            clamp: sampler.address == Address::ClampToEdge,
        };
        out.insert(combined.path.clone(), made);
    }
    out
}

/// The author's attribute at a location, and which of its columns that is.
fn attribute(
    program: &preshade::unstable::passes::program::Program,
    vertex: &str,
    location: u32,
) -> (String, u32) {
    let columns = |ty: &Declares| match ty {
        Declares::Plain(name) => {
            let columns = name
                .split_once("mat")
                .and_then(|(_, n)| n.get(..1)?.parse().ok());
            columns.unwrap_or(1)
        }
        _ => 1,
    };
    for a in &program.declared().attributes {
        if (a.location..a.location + columns(&a.declaration.ty)).contains(&location) {
            return (a.declaration.name.clone(), location - a.location);
        }
    }
    let (_, entry) = program.entry_point(ShaderStage::Vertex, vertex).unwrap();
    let inputs = reflect::inputs(program.module(), &entry.function);
    let at = |io: &&reflect::Io| matches!(io.binding, Some(Binding::Location { location: l, .. }) if l == location);
    let name = inputs.iter().find(at).and_then(|io| io.name.clone());
    (name.unwrap(), 0)
}

/// The pictures of both roads.
pub struct Both {
    pub ours: Rendered,
    pub native: Pixels,
}

/// Draws a scene of one pair on both. `texts` are what OpenGL gets.
pub fn draw(gl: &Native, scene: &Scene, texts: [&str; 2], first: FirstRow) -> Result<Both, String> {
    let original = &measure::originals(scene)[0];
    let ours = render_support::render_as(
        render_support::gpu(),
        scene,
        std::slice::from_ref(original),
        DrawOrder::AsGiven,
        ShaderForm::Text,
    );
    let bound = bound(scene)?;
    let draws: Vec<Draw<'_>> = bound.iter().map(|b| native_draw(scene, b)).collect();
    let clear = scene.clear_color.map(|c| c as f32);
    let native = gl.draw_pair(first, scene.size, clear, texts, &draws)?;
    Ok(Both { ours, native })
}

/// What each draw of a scene of one material binds.
pub fn bound(scene: &Scene) -> Result<Vec<DrawBindings>, String> {
    let original = &measure::originals(scene)[0];
    let frame = &scene.cameras[0].frames[0];
    let (material, pass) = (&scene.materials[0], &original.passes[0]);
    let bind = |draw| bind::draw(scene, material, pass, draw, frame).map_err(|e| e.to_string());
    scene.draws.iter().map(bind).collect()
}

/// How many components the fragment stage's output has: OpenGL leaves the others open.
pub fn channels(fragment: &str) -> usize {
    let outputs = ["out float ", "out vec2 ", "out vec3 "];
    let narrow = outputs.iter().position(|o| fragment.contains(o));
    narrow.map_or(4, |i| i + 1)
}

/// How two pictures differ.
#[derive(Clone, Copy, Debug, Default)]
pub struct Difference {
    /// Pixels that something is drawn to.
    pub seen: usize,
    /// Pixels that one covers and the other does not, or that show another triangle.
    pub edges: usize,
    /// All others that are more than 1/255 apart.
    pub apart: usize,
    /// The largest difference among those, of 255.
    pub most: u8,
}

impl Both {
    /// The difference in the first `channels`.
    pub fn difference(&self, channels: usize) -> Difference {
        // What writes depth alone has no picture.
        let picture = self.ours.colors.first().and_then(Option::as_ref);
        let depths = &self.ours.depth.as_ref().unwrap().values;
        let mut out = Difference::default();
        for (i, depth) in self.native.depth.iter().enumerate() {
            out.seen += usize::from(*depth != 1.0);
            // Where another surface is seen, the depth says so.
            let silhouette =
                (depths[i] == 1.0) != (*depth == 1.0) || (depths[i] - depth).abs() > 1e-3;
            let native = &self.native.color[4 * i..4 * i + channels];
            let texel = picture.map_or([].as_slice(), |p| p.texel(i));
            let apart = texel.iter().zip(native).map(|(a, b)| a.abs_diff(*b));
            let apart = apart.max().unwrap_or(0);
            match silhouette {
                true => out.edges += usize::from(apart > 1 || picture.is_none()),
                false if apart > 1 => {
                    out.apart += 1;
                    out.most = out.most.max(apart);
                }
                false => {}
            }
        }
        out
    }

    /// Keeps both pictures.
    pub fn save(&self, folder: &std::path::Path, name: &str) {
        let Some(Some(image)) = self.ours.colors.first() else {
            return;
        };
        let [w, h] = image.size;
        for (what, bytes) in [("ours", &image.bytes), ("gl", &self.native.color)] {
            let path = folder.join(format!("{name}-{what}.png"));
            image::save_buffer(path, bytes, w, h, image::ColorType::Rgba8).unwrap();
        }
    }
}
