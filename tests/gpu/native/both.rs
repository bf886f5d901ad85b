//! One pair on both roads: through preshade on wgpu, and as its author wrote it on OpenGL, from the
//! same bytes.

use std::collections::BTreeMap;

use naga::{Binding, Module, ResourceBinding, ShaderStage, TypeInner};
use naga_edit::declared::{Declared, Type as Declares};
use naga_edit::interface;
use preshade_compiler::front::{self, Source};
use preshade_draw::render::Rendered;
use preshade_draw::scene::bind::{self, DrawBindings, TextureContent};
use preshade_draw::scene::{Address, DrawOrder, Filter, Scene};
use preshade_lab::measure;
use preshade_plan::plan::BindingKind;
use preshade_plan::plan_file::{PassFiles, StageFile, Target};
use preshade_plan::state::{CullMode, MaterialState};
use preshade_scenes::ShaderForm;
use preshade_scenes::synthesise;
use shader_text::options;

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
    let options = options::Options {
        clip_space: Some(options::ClipSpace::OpenGl),
        ..shader_text::options::Options::default()
    };
    let parsed =
        front::parse(&sources, &options).map_err(|e| e.render(shader_text::error::Color::Never))?;
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
    let name = |location: u32| Some(attribute(&material.program, &material.vertex, location));
    Draw {
        uniform: Box::new(move |path| {
            let g = loose?;
            part(module, g.ty, &buffer(g.binding?)?.data.bytes, path)
        }),
        blocks: blocks.collect(),
        textures: textures(declared, bound),
        vertices: vertices(bound, &name),
        indices: indices(bound),
        first: bound.call.first as i32,
        count: bound.call.count as i32,
        instances: bound.instances as i32,
    }
}

/// The vertex buffers, with the name and the column that `name` gives of each location.
fn vertices(bound: &DrawBindings, name: &dyn Fn(u32) -> Option<(String, u32)>) -> Vec<Vertices> {
    let vertices = bound.vertex_buffers.iter().map(|v| Vertices {
        bytes: v.data.bytes.to_vec(),
        stride: v.stride as i32,
        per_instance: v.step == wgpu::VertexStepMode::Instance,
        attributes: v
            .attributes
            .iter()
            .filter_map(|a| {
                let (name, column) = name(a.location)?;
                Some(Attribute {
                    name,
                    column,
                    components: a.format.size() as i32 / 4,
                    offset: a.offset as i32,
                    integer: matches!(
                        a.format,
                        wgpu::VertexFormat::Uint32 | wgpu::VertexFormat::Uint32x4
                    ),
                })
            })
            .collect(),
    });
    vertices.collect()
}

fn indices(bound: &DrawBindings) -> Option<Vec<u32>> {
    let indices = bound.indices.as_ref()?;
    let bytes = &indices.data.bytes;
    Some(match indices.format {
        wgpu::IndexFormat::Uint16 => {
            let words = bytes.chunks_exact(2);
            words
                .map(|b| u16::from_le_bytes(b.try_into().unwrap()).into())
                .collect()
        }
        wgpu::IndexFormat::Uint32 => {
            let words = bytes.chunks_exact(4);
            words
                .map(|b| u32::from_le_bytes(b.try_into().unwrap()))
                .collect()
        }
    })
}

/// The textures by the author's paths: `maps[1]`, `material.diffuse`.
fn textures(declared: &Declared, bound: &DrawBindings) -> BTreeMap<String, Texture> {
    let at = |b: ResourceBinding| [b.group, b.binding];
    let combined = declared.samplers.iter().filter_map(|combined| {
        let made = texture(bound, at(combined.texture), Some(at(combined.sampler)));
        let made = made.unwrap_or_else(|e| panic!("{}: {e}", combined.path));
        Some((combined.path.clone(), made?))
    });
    combined.collect()
}

/// The texture that a draw binds at a group and binding, read through the sampler there. `None`: it
/// binds none. An error is what OpenGL is not given here.
fn texture(
    bound: &DrawBindings,
    at: [u32; 2],
    sampler: Option<[u32; 2]>,
) -> Result<Option<Texture>, String> {
    let mut textures = bound.textures.iter();
    let Some(texture) = textures.find(|t| [t.group, t.binding] == at) else {
        return Ok(None);
    };
    let mut samplers = bound.samplers.iter();
    let sampler = samplers.find(|s| Some([s.group, s.binding]) == sampler);
    // One that is only fetched from has no sampler in the plan, and any will do.
    let sampler = sampler.map(|s| s.sampler).unwrap_or_default();
    let TextureContent::Image(image) = &texture.content else {
        return Err("a texture that is no image".to_owned());
    };
    if image.format.block_copy_size(None) != Some(4) || sampler.compare.is_some() {
        return Err("a texture of other texels, or one that is compared".to_owned());
    }
    Ok(Some(Texture {
        size: image.size.map(|n| n as i32),
        levels: image.levels.clone(),
        layers: image.layers as usize,
        srgb: image.format.is_srgb(),
        linear: sampler.filter == Filter::Linear,
        clamp: sampler.address == Address::ClampToEdge,
    }))
}

/// A draw of the GLSL that `files` names, by the names there. An error is what OpenGL is not given
/// here.
pub fn written_draw<'a>(bound: &'a DrawBindings, files: &PassFiles) -> Result<Draw<'a>, String> {
    let stages = [&files.vertex, &files.fragment];
    let stages: Vec<&StageFile> = stages
        .iter()
        .filter_map(|s| s.get(&Target::Glsl450))
        .collect();
    let mut blocks = BTreeMap::new();
    let mut textures = BTreeMap::new();
    for stage in &stages {
        if !stage.uniforms.is_empty() {
            return Err("uniforms outside of blocks".to_owned());
        }
        for block in &stage.blocks {
            let buffer = bound.buffers.iter();
            let mut buffer = buffer.filter(|b| [b.group, b.binding] == block.binding);
            let Some(buffer) = buffer.next() else {
                continue;
            };
            if buffer.kind != BindingKind::Uniform {
                return Err("a storage buffer".to_owned());
            }
            blocks.insert(block.block.clone(), buffer.data.bytes.to_vec());
        }
        for named in &stage.textures {
            if let Some(texture) = texture(bound, named.texture, named.sampler)? {
                textures.insert(named.name.clone(), texture);
            }
        }
    }
    let name = |location: u32| {
        let attributes = stages.iter().flat_map(|s| &s.attributes);
        let mut named = attributes.filter(|a| a.location <= location);
        let named = named.by_ref().max_by_key(|a| a.location);
        named.map(|a| (a.name.clone(), location - a.location))
    };
    Ok(Draw {
        // WebGPU's instances are counted from the draw's first, which is 0 here.
        uniform: Box::new(|path| (path == "naga_vs_first_instance").then(|| vec![0; 16])),
        blocks,
        textures,
        vertices: vertices(bound, &name),
        indices: indices(bound),
        first: bound.call.first as i32,
        count: bound.call.count as i32,
        instances: bound.instances as i32,
    })
}

/// The author's attribute at a location, and which of its columns that is.
fn attribute(
    program: &preshade_plan::program::Program,
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
    let inputs = interface::inputs(program.module(), &entry.function);
    let at = |io: &&interface::Io| matches!(io.binding, Some(Binding::Location { location: l, .. }) if l == location);
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
