//! A [`Scene`] of one captured render pass. Its pipelines are the materials, and its draws bind what
//! they bound when the frame was captured.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{Mat4, Vec3};
use preshade_passes::plan::BindingKind;
use preshade_passes::state::{
    Blend, BlendComponent, ColorTarget, DepthBias, DepthDirection, DepthFormat, MaterialState,
    Multisample, PrimitiveState, StencilFace, StencilState,
};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::contents::Contents;
use super::file::{
    self, Cull, IndexFormat, Load, RenderPipeline, Resource, ShaderLanguage, Topology, View,
};
use super::folder::{Capture, get};
use super::pass::{self, Kind, Part, Pass, PassDraw, passes};
use super::replay::{Replay, Until};
use super::{Error, texels};
use crate::front::{self, Source};
use crate::render::Gpu;
use crate::scene::bind::{
    Area, BufferBinding, Call, Data, DrawBindings, Indices, Rate, SamplerBinding, TextureBinding,
    TextureContent, VertexAttribute, VertexBuffer,
};
use crate::scene::{
    Camera, Draw, DrawOrder, DrawRange, Frame, Image, Light, Material, Mesh, Scene,
};

/// Which pass of which frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// Frame, from 0.
    pub frame: usize,
    /// Number of the render pass in the frame, from 0. `None`: the main pass with most vertices.
    pub pass: Option<usize>,
}

/// A scene, and what it leaves out.
#[derive(Debug)]
pub struct Converted {
    /// The scene.
    pub scene: Scene,
    /// Number of the render pass in the frame.
    pub pass: usize,
    /// What the scene does not draw as the frame did, each with the reason.
    pub notes: Vec<String>,
}

/// A scene of one pass. With an adapter, what earlier passes drew is replayed; without, such
/// textures and buffers are empty, which is enough to read the programs.
///
/// # Errors
/// The capture is broken, lacks data or has no such pass, or none of the pass's pipelines can be
/// read.
pub fn scene(capture: &Capture, choice: Choice, gpu: Option<&Gpu>) -> Result<Converted, Error> {
    let all = passes(capture, choice.frame)?;
    let index = chosen(&all, choice)?;
    let pass = &all[index];
    let contents = Contents::before(capture, choice.frame, pass.command)?;
    let mut made = Maker {
        capture,
        pass,
        contents,
        replay: None,
        gpu,
        frame: choice.frame,
        size: [0; 2],
        buffers: RefCell::default(),
        images: BTreeMap::new(),
        notes: BTreeSet::new(),
        materials: Vec::new(),
        by_pipeline: BTreeMap::new(),
        meshes: Vec::new(),
    };
    let scene = made.scene()?;
    Ok(Converted {
        scene,
        pass: index,
        notes: made.notes.into_iter().collect(),
    })
}

/// The pass to take.
fn chosen(all: &[Pass<'_>], choice: Choice) -> Result<usize, Error> {
    let place = format!("frame {}", choice.frame);
    if let Some(index) = choice.pass {
        get(all, index, "render pass", &place)?;
        return Ok(index);
    }
    let vertices = |p: &Pass<'_>| -> u64 {
        let of = |d: &PassDraw| u64::from(d.call.count.max(1)) * u64::from(d.call.instances.max(1));
        p.draws.iter().map(of).sum()
    };
    let main = all.iter().enumerate().filter(|(_, p)| p.kind == Kind::Main);
    main.max_by_key(|(_, p)| vertices(p))
        .map(|(index, _)| index)
        .ok_or_else(|| Error::broken(place, "no render pass of it draws materials"))
}

/// The same name in another list of WebGPU's names.
fn same<T: DeserializeOwned>(of: impl Serialize) -> Result<T, String> {
    let text = serde_json::to_value(of).map_err(|e| e.to_string())?;
    let shown = text.to_string();
    serde_json::from_value(text).map_err(|_| format!("preshade has no {shown}"))
}

pub(super) struct Maker<'c> {
    pub(super) capture: &'c Capture,
    pass: &'c Pass<'c>,
    contents: Contents,
    replay: Option<Replay<'c>>,
    gpu: Option<&'c Gpu>,
    frame: usize,
    /// Width and height of the target.
    size: [u32; 2],
    buffers: RefCell<BTreeMap<Part, Data>>,
    images: BTreeMap<(usize, String), Arc<Image>>,
    notes: BTreeSet<String>,
    pub(super) materials: Vec<Material>,
    /// Material of each pipeline and stencil reference, or `None` if it cannot be read.
    by_pipeline: BTreeMap<(usize, u32), Option<usize>>,
    meshes: Vec<Mesh>,
}

impl<'c> Maker<'c> {
    fn scene(&mut self) -> Result<Scene, Error> {
        let capture = self.capture;
        let frame = get(&capture.file.frames, self.frame, "frame", "the capture")?;
        let target = self.target()?;
        self.size = target.size;
        let mut draws = Vec::new();
        for (index, draw) in self.pass.draws.iter().enumerate() {
            let Some(material) = self.material(draw)? else {
                continue;
            };
            match self.draw(index, draw, material) {
                Ok(made) => draws.push(made),
                Err(Left::Out(why)) => {
                    let name = &self.materials[material].name;
                    self.notes
                        .insert(format!("draw {index} of `{name}` is left out: {why}"));
                }
                Err(Left::Broken(error)) => return Err(error),
            }
        }
        if draws.is_empty() {
            let why: Vec<&str> = self.notes.iter().map(String::as_str).collect();
            return Err(Error::broken(
                format!("frame {}, render pass", self.frame),
                format!("none of its draws can be read\n{}", why.join("\n")),
            ));
        }
        Ok(Scene {
            name: capture.name(),
            size: target.size,
            viewport: None,
            depth_format: target.depth.unwrap_or_default(),
            depth_direction: target.direction,
            samples: target.samples,
            clear_color: target.clear,
            materials: std::mem::take(&mut self.materials),
            meshes: std::mem::take(&mut self.meshes),
            draws,
            cameras: vec![Camera {
                name: "captured".to_owned(),
                frames: vec![Frame {
                    view: Mat4::IDENTITY,
                    projection: Mat4::IDENTITY,
                    eye: Vec3::ZERO,
                    time: frame.time as f32,
                }],
            }],
            orders: vec![DrawOrder::AsGiven],
            light: Light::default(),
            files: capture.files(),
            is_made_up: false,
            own_size: None,
        })
    }

    fn target(&mut self) -> Result<Target, Error> {
        let capture = self.capture;
        let texture = |view: &View| get(&capture.file.textures, view.texture, "texture", "a pass");
        let colors = self.pass.descriptor.color_attachments.iter().flatten();
        let first = colors.clone().next();
        let depth = self.pass.descriptor.depth_stencil_attachment.as_ref();
        let view = first.map(|c| &c.view).or(depth.map(|d| &d.view));
        let view = view.ok_or_else(|| Error::broken("a render pass", "it has no attachment"))?;
        let of = texture(view)?;
        let [width, height, _] = of.size.0;
        let level = view.view.base_mip_level;
        let size = [width, height].map(|s| (s >> level).max(1));
        if colors.clone().any(|c| c.load_op == Load::Load) {
            self.notes.insert(
                "the pass draws onto what is there, and the scene onto its clear colour".to_owned(),
            );
        }
        let mut made = Target {
            size,
            samples: of.sample_count,
            clear: first
                .and_then(|c| c.clear_value)
                .map_or([0.0; 4], file::Color::numbers),
            depth: None,
            direction: DepthDirection::Forward,
        };
        if let Some(depth) = depth {
            let format = texture(&depth.view)?.format;
            made.depth = Some(same(format).map_err(|e| Error::broken("a render pass", e))?);
            let clear = depth.depth_clear_value.unwrap_or(1.0);
            if depth.depth_load_op == Some(Load::Load) || depth.depth_load_op.is_none() {
                self.notes.insert(
                    "the pass tests the depth of an earlier one, and the scene a cleared depth"
                        .to_owned(),
                );
            }
            made.direction = match clear < 0.5 {
                true => DepthDirection::Reversed,
                false => DepthDirection::Forward,
            };
        }
        Ok(made)
    }

    /// The material of a pipeline. `None`, with a note, if its text cannot be read.
    fn material(&mut self, draw: &PassDraw) -> Result<Option<usize>, Error> {
        let all = &self.capture.file.render_pipelines;
        let of = get(all, draw.pipeline, "render pipeline", "a draw")?;
        let has_stencil = of.depth_stencil.as_ref().is_some_and(has_stencil);
        let key = (
            draw.pipeline,
            if has_stencil {
                draw.stencil_reference
            } else {
                0
            },
        );
        if let Some(known) = self.by_pipeline.get(&key) {
            return Ok(*known);
        }
        let name = self.name(of, draw.pipeline);
        let found = match self.read(of, &name) {
            Ok(mut material) => {
                if let Some(stencil) = &mut material.state.stencil {
                    stencil.reference = key.1;
                }
                self.materials.push(material);
                Some(self.materials.len() - 1)
            }
            Err(Left::Broken(error)) => return Err(error),
            Err(Left::Out(why)) => {
                self.notes
                    .insert(format!("what `{name}` draws is left out: {why}"));
                None
            }
        };
        self.by_pipeline.insert(key, found);
        Ok(found)
    }

    /// A name for files: the label, with the number if another pipeline has it too.
    fn name(&self, of: &RenderPipeline, pipeline: usize) -> String {
        let shader = self.capture.file.shaders.get(of.vertex.stage.module);
        let labels = [of.label.as_str(), shader.map_or("", |s| &s.label)];
        let label = labels.into_iter().find(|l| !l.trim().is_empty());
        let tame = |c: char| match c.is_ascii_alphanumeric() || "-_.".contains(c) {
            true => c,
            false => '-',
        };
        let name: String = label.unwrap_or("pipeline").chars().map(tame).collect();
        let name = name.trim_matches('-').to_owned();
        let taken = self.materials.iter().any(|m| m.name == name);
        match taken || label.is_none() || name.is_empty() {
            true => format!("{name}-{pipeline}"),
            false => name,
        }
    }

    fn read(&self, of: &RenderPipeline, name: &str) -> Result<Material, Left> {
        let vertex = &of.vertex.stage;
        let fragment = of.fragment.as_ref().map(|f| &f.stage);
        if !vertex.constants.is_empty() || fragment.is_some_and(|f| !f.constants.is_empty()) {
            return Err(Left::Out("its pipeline sets constants".to_owned()));
        }
        let mut modules = vec![vertex.module];
        modules.extend(fragment.map(|f| f.module).filter(|m| *m != vertex.module));
        let mut sources = Vec::new();
        for module in modules {
            let shader = get(&self.capture.file.shaders, module, "shader", name)?;
            let ending = match shader.language {
                ShaderLanguage::Wgsl => "wgsl",
                ShaderLanguage::SpirV => "spv",
                ShaderLanguage::GlslEs100 | ShaderLanguage::GlslEs300 if sources.is_empty() => {
                    "vert"
                }
                ShaderLanguage::GlslEs100 | ShaderLanguage::GlslEs300 => "frag",
            };
            let bytes = self.capture.data(&shader.data)?.to_vec();
            let source = Source::from_bytes(format!("{name}.{ending}"), bytes);
            sources.push(source.map_err(|e| Left::Out(e.to_string()))?);
        }
        let options = front::Options {
            vertex: vertex.entry_point.clone(),
            fragment: fragment.and_then(|f| f.entry_point.clone()),
            limits: *self.capture.limits(),
            ..front::Options::default()
        };
        let parsed = front::parse(&sources, &options).map_err(|e| Left::Out(e.to_string()))?;
        Ok(Material {
            name: name.to_owned(),
            file: None,
            vertex: parsed.vertex,
            fragment: fragment.and(parsed.fragment),
            program: parsed.program,
            defines: BTreeMap::new(),
            state: self.state(of).map_err(Left::Out)?,
            values: BTreeMap::new(),
            textures: BTreeMap::new(),
            samplers: BTreeMap::new(),
            attributes: BTreeMap::new(),
        })
    }

    fn state(&self, of: &RenderPipeline) -> Result<MaterialState, String> {
        let p = &of.primitive;
        let mut state = MaterialState {
            primitive: PrimitiveState {
                topology: match p.topology {
                    Topology::TriangleFan | Topology::LineLoop => {
                        return Err("it draws a fan or a loop".to_owned());
                    }
                    other => same(super::replay::topology(other))?,
                },
                cull: match p.cull_mode {
                    Cull::None => preshade_passes::state::CullMode::None,
                    Cull::Front => preshade_passes::state::CullMode::Front,
                    Cull::Back => preshade_passes::state::CullMode::Back,
                },
                front_face: same(p.front_face)?,
                unclipped_depth: p.unclipped_depth,
            },
            multisample: Multisample {
                count: of.multisample.count,
                mask: of.multisample.mask,
                alpha_to_coverage: of.multisample.alpha_to_coverage_enabled,
            },
            ..MaterialState::default()
        };
        if let Some(depth) = &of.depth_stencil {
            let compare = depth.depth_compare.unwrap_or(wgpu::CompareFunction::Always);
            state.depth_compare = Some(same(compare)?);
            state.depth_write = depth.depth_write_enabled.unwrap_or(false);
            state.depth_format = same(depth.format)?;
            state.depth_bias = DepthBias {
                constant: depth.depth_bias,
                slope_scale: depth.depth_bias_slope_scale,
                clamp: depth.depth_bias_clamp,
            };
            state.stencil = stencil(depth)?;
        } else {
            state.depth_compare = Some(preshade_passes::state::CompareFunction::Always);
            state.depth_write = false;
        }
        for target in of.fragment.iter().flat_map(|f| &f.targets) {
            state
                .targets
                .push(target.as_ref().map(color_target).transpose()?);
        }
        Ok(state)
    }

    fn draw(&mut self, index: usize, draw: &PassDraw, material: usize) -> Result<Draw, Left> {
        let call = self.call(draw.call)?;
        let all = &self.capture.file.render_pipelines;
        let pipeline = get(all, draw.pipeline, "render pipeline", "a draw")?;
        let (buffers, textures, samplers) = match draw.named {
            Some(named) => self.named_resources(named, material)?,
            None => self.resources(draw, material)?,
        };
        let vertex_buffers = match self.capture.file.source.api.is_webgl() {
            true => self.interleaved(draw, pipeline, material)?,
            false => self.vertex_buffers(draw, pipeline)?,
        };
        let indices = match call.indexed {
            true => Some(self.indices(draw)?),
            false => None,
        };
        let mut vertex_count = vertex_buffers
            .iter()
            .filter(|b| b.step == wgpu::VertexStepMode::Vertex)
            .map(|b| b.data.bytes.len() as u64 / b.stride.max(1))
            .min()
            .unwrap_or(u64::from(call.first) + u64::from(call.count))
            as u32;
        if indices.is_none() {
            vertex_count = vertex_count.max(call.first.saturating_add(call.count));
        }
        let bound = DrawBindings {
            immediates: None,
            buffers,
            textures,
            samplers,
            vertex_buffers,
            indices,
            vertex_count,
            call: Call {
                first: call.first,
                count: call.count,
                base_vertex: call.base_vertex,
                first_instance: call.first_instance,
            },
            instances: call.instances,
            area: self.area(draw),
        };
        // Its positions are the program's business: nothing asks for them by name.
        self.meshes.push(Mesh {
            name: format!("draw-{index}"),
            vertex_count: call.first.saturating_add(call.count),
            streams: BTreeMap::new(),
            indices: None,
            bounds: [Vec3::ZERO; 2],
        });
        Ok(Draw {
            name: format!("draw-{index}"),
            mesh: self.meshes.len() - 1,
            material,
            transform: Mat4::IDENTITY,
            range: DrawRange {
                first: call.first,
                count: Some(call.count),
                base_vertex: 0,
                first_instance: call.first_instance,
            },
            instances: call.instances,
            instance_streams: BTreeMap::new(),
            joints: [].into(),
            morph_weights: Vec::new(),
            values: BTreeMap::new(),
            captured: Some(Arc::new(bound)),
        })
    }

    /// The arguments of a call, from their buffer if they are in one.
    fn call(&mut self, call: pass::Call) -> Result<pass::Call, Left> {
        let Some((buffer, offset)) = call.indirect else {
            return Ok(call);
        };
        if self.gpu.is_none() && self.contents.is_computed(buffer) {
            return Ok(call);
        }
        let words = self.part((buffer, offset, Some(20)))?;
        let word = |i: usize| {
            let bytes = words.bytes.as_chunks::<4>().0.get(i);
            bytes.map_or(0, |b| u32::from_le_bytes(*b))
        };
        Ok(pass::Call {
            count: word(0),
            instances: word(1),
            first: word(2),
            base_vertex: match call.indexed {
                true => word(3) as i32,
                false => 0,
            },
            first_instance: word(if call.indexed { 4 } else { 3 }),
            ..call
        })
    }

    /// Viewport and scissor of a draw. `None`: the whole target.
    fn area(&self, draw: &PassDraw) -> Option<Area> {
        let [width, height] = self.size;
        if draw.viewport.is_none() && draw.scissor.is_none() {
            return None;
        }
        Some(Area {
            viewport: draw
                .viewport
                .unwrap_or([0.0, 0.0, width as f32, height as f32, 0.0, 1.0]),
            scissor: draw.scissor.unwrap_or([0, 0, width, height]),
        })
    }

    /// Part of a buffer as data. Equal parts are one allocation.
    pub(super) fn part(&mut self, part: Part) -> Result<Data, Left> {
        if let Some(known) = self.buffers.borrow().get(&part) {
            return Ok(known.clone());
        }
        let (buffer, offset, size) = part;
        let bytes = match self.contents.is_computed(buffer) {
            false => self.contents.buffer(self.capture, buffer)?,
            true => match self.replayed()? {
                Some(replay) => replay.read_buffer(buffer)?.into(),
                None => self.contents.buffer(self.capture, buffer)?,
            },
        };
        let first = (offset as usize).min(bytes.len());
        let last = size.map_or(bytes.len(), |s| first.saturating_add(s as usize));
        let data = Data::new(bytes[first..last.min(bytes.len())].to_vec());
        self.buffers.borrow_mut().insert(part, data.clone());
        Ok(data)
    }

    /// The replay, before the pass. `None` without an adapter.
    fn replayed(&mut self) -> Result<Option<&mut Replay<'c>>, Error> {
        let Some(gpu) = self.gpu else { return Ok(None) };
        if self.replay.is_none() {
            let mut replay = Replay::new(gpu, self.capture);
            for earlier in 0..self.frame {
                replay.frame(earlier, Until::End)?;
            }
            replay.frame(self.frame, Until::Command(self.pass.command))?;
            for (left, count) in replay.left_out() {
                self.notes.insert(format!(
                    "before the pass, {count} of {} is left out: {}",
                    left.what, left.why
                ));
            }
            self.replay = Some(replay);
        }
        Ok(self.replay.as_mut())
    }

    fn vertex_buffers(
        &mut self,
        draw: &PassDraw,
        pipeline: &RenderPipeline,
    ) -> Result<Vec<VertexBuffer>, Left> {
        let mut made = Vec::new();
        for (slot, layout) in pipeline.vertex.buffers.iter().enumerate() {
            let Some(layout) = layout else { continue };
            let Some(part) = draw.vertices.get(&(slot as u32)) else {
                return Err(Left::Out(format!("vertex buffer {slot} is not set")));
            };
            let data = self.part(*part)?;
            let attributes = layout.attributes.iter().map(|a| {
                Some(VertexAttribute {
                    location: a.shader_location?,
                    format: a.format,
                    offset: a.offset,
                    is_invented: false,
                })
            });
            let attributes = attributes.collect::<Option<Vec<_>>>();
            made.push(VertexBuffer {
                stride: layout.array_stride,
                step: layout.step_mode,
                attributes: attributes
                    .ok_or_else(|| Left::Out("an attribute has no location".to_owned()))?,
                data,
            });
        }
        Ok(made)
    }

    fn indices(&mut self, draw: &PassDraw) -> Result<Indices, Left> {
        let Some((part, format)) = draw.indices else {
            return Err(Left::Out("no index buffer is set".to_owned()));
        };
        let mut data = self.part(part)?;
        let (format, size) = match format {
            IndexFormat::Uint32 => (wgpu::IndexFormat::Uint32, 4),
            IndexFormat::Uint16 => (wgpu::IndexFormat::Uint16, 2),
            IndexFormat::Uint8 => {
                let wide = data.bytes.iter().flat_map(|b| u16::from(*b).to_le_bytes());
                data = Data::new(wide.collect());
                (wgpu::IndexFormat::Uint16, 2)
            }
        };
        let count = (data.bytes.len() / size) as u32;
        if !data.bytes.len().is_multiple_of(4) {
            let mut bytes = data.bytes.to_vec();
            bytes.resize(bytes.len().next_multiple_of(4), 0);
            data = Data::new(bytes);
        }
        Ok(Indices {
            format,
            count,
            data,
        })
    }

    /// What the draw's bind groups hold, as far as the program reads it.
    fn resources(&mut self, draw: &PassDraw, material: usize) -> Result<Bound, Left> {
        let mut bound: Bound = Default::default();
        let plan = self.materials[material].plan();
        let uses = plan.main().map(|p| p.bindings.clone()).unwrap_or_default();
        for used in uses {
            let missing = || {
                Left::Out(format!(
                    "nothing is bound to `{}`, group {}, binding {}",
                    used.name, used.group, used.binding
                ))
            };
            let (group, offsets) = draw.groups.get(&used.group).ok_or_else(missing)?;
            let of = get(
                &self.capture.file.bind_groups,
                *group,
                "bind group",
                "a draw",
            )?;
            let entry = of.entries.iter().find(|e| e.binding == used.binding);
            let entry = entry.ok_or_else(missing)?;
            let place = (used.group, used.binding);
            match &entry.resource {
                Resource::Buffer(range) => {
                    let offset = self.dynamic_offset(of, offsets, used.binding);
                    let mut size = range.size;
                    let whole = get(&self.capture.file.buffers, range.buffer, "buffer", "a draw")?;
                    let first = range.offset.saturating_add(offset);
                    size = size.or(Some(whole.size.saturating_sub(range.offset)));
                    let data = texels::padded(self.part((range.buffer, first, size))?);
                    bound.0.push(BufferBinding {
                        group: place.0,
                        binding: place.1,
                        kind: used.kind,
                        data,
                        rate: Rate::Draw,
                        invented: Vec::new(),
                    });
                }
                Resource::Texture(view) => {
                    if used.kind == BindingKind::StorageTexture {
                        return Err(Left::Out(format!("`{}` is a storage texture", used.name)));
                    }
                    let texture = self.texture(view, place, &used)?;
                    bound.1.push(texture);
                }
                Resource::Sampler { sampler } => {
                    let of = get(&self.capture.file.samplers, *sampler, "sampler", "a draw")?;
                    bound.2.push(SamplerBinding {
                        group: place.0,
                        binding: place.1,
                        sampler: texels::sampler(of),
                    });
                }
            }
        }
        Ok(bound)
    }

    /// The dynamic offset of a binding.
    fn dynamic_offset(&self, group: &file::BindGroup, offsets: &[u32], binding: u32) -> u64 {
        let file::GroupLayout::Number(layout) = group.layout else {
            return 0;
        };
        let layout = self.capture.file.bind_group_layouts.get(layout);
        let mut dynamic: Vec<u32> = layout
            .iter()
            .flat_map(|l| &l.entries)
            .filter(|e| e.buffer.as_ref().is_some_and(|b| b.has_dynamic_offset))
            .map(|e| e.binding)
            .collect();
        dynamic.sort_unstable();
        let at = dynamic.iter().position(|b| *b == binding);
        at.and_then(|at| offsets.get(at))
            .map_or(0, |o| u64::from(*o))
    }

    pub(super) fn texture(
        &mut self,
        view: &View,
        (group, binding): (u32, u32),
        used: &preshade_passes::plan::BindingUse,
    ) -> Result<TextureBinding, Left> {
        let of = get(
            &self.capture.file.textures,
            view.texture,
            "texture",
            "a draw",
        )?;
        if of.sample_count > 1 {
            return Err(Left::Out(format!("`{}` has several samples", used.name)));
        }
        let key = (view.texture, format!("{:?}", view.view));
        let image = match self.images.get(&key) {
            Some(known) => Arc::clone(known),
            None => {
                let image = Arc::new(self.image(view)?);
                self.images.insert(key, Arc::clone(&image));
                image
            }
        };
        let dimension = view.view.dimension.unwrap_or(match of.dimension {
            wgpu::TextureDimension::D1 => wgpu::TextureViewDimension::D1,
            wgpu::TextureDimension::D2 if of.size.0[2] > 1 => wgpu::TextureViewDimension::D2Array,
            wgpu::TextureDimension::D2 => wgpu::TextureViewDimension::D2,
            wgpu::TextureDimension::D3 => wgpu::TextureViewDimension::D3,
        });
        let features = wgpu::Features::all();
        let sample_type = match used.kind {
            BindingKind::DepthTexture => wgpu::TextureSampleType::Depth,
            _ => image
                .format
                .sample_type(view.view.aspect, Some(features))
                .map(|ty| match ty {
                    wgpu::TextureSampleType::Depth => {
                        wgpu::TextureSampleType::Float { filterable: false }
                    }
                    other => other,
                })
                .unwrap_or_default(),
        };
        Ok(TextureBinding {
            group,
            binding,
            content: TextureContent::Image(image),
            view: dimension,
            sample_type,
            multisampled: false,
            is_invented: false,
        })
    }

    /// The levels and layers of a view.
    fn image(&mut self, view: &View) -> Result<Image, Left> {
        if self.contents.is_as_at_start(view.texture) {
            return Ok(texels::at_start(self.capture, view)?);
        }
        let capture = self.capture;
        match self.replayed()? {
            Some(replay) => Ok(replay.read_view(view)?),
            None => Ok(texels::empty(capture, view)?),
        }
    }
}

/// Buffers, textures and samplers of a draw.
pub(super) type Bound = (Vec<BufferBinding>, Vec<TextureBinding>, Vec<SamplerBinding>);

/// The targets of the pass.
struct Target {
    size: [u32; 2],
    samples: u32,
    clear: [f64; 4],
    depth: Option<DepthFormat>,
    direction: DepthDirection,
}

/// Why a draw is not in the scene.
pub(super) enum Left {
    /// It is left out, and everything else is drawn.
    Out(String),
    /// The capture is broken, or the device is lost.
    Broken(Error),
}

impl From<Error> for Left {
    fn from(error: Error) -> Self {
        Self::Broken(error)
    }
}

fn has_stencil(of: &file::DepthStencil) -> bool {
    let plain = file::StencilFace::default();
    of.stencil_front != plain || of.stencil_back != plain
}

fn stencil(of: &file::DepthStencil) -> Result<Option<StencilState>, String> {
    if !has_stencil(of) {
        return Ok(None);
    }
    let face = |f: file::StencilFace| -> Result<StencilFace, String> {
        Ok(StencilFace {
            compare: same(f.compare)?,
            fail: same(f.fail_op)?,
            depth_fail: same(f.depth_fail_op)?,
            pass: same(f.pass_op)?,
        })
    };
    Ok(Some(StencilState {
        front: face(of.stencil_front)?,
        back: face(of.stencil_back)?,
        read_mask: of.stencil_read_mask,
        write_mask: of.stencil_write_mask,
        reference: 0,
    }))
}

fn color_target(of: &file::ColorTarget) -> Result<ColorTarget, String> {
    let component = |c: file::BlendComponent| -> Result<BlendComponent, String> {
        Ok(BlendComponent {
            src: same(c.src_factor)?,
            dst: same(c.dst_factor)?,
            operation: same(c.operation)?,
        })
    };
    let blend = of.blend.as_ref().map(|b| {
        Ok::<_, String>(Blend {
            color: component(b.color)?,
            alpha: component(b.alpha)?,
        })
    });
    let mut target = ColorTarget::opaque(same::<String>(of.format)?);
    target.blend = blend.transpose()?;
    target.write_mask = (of.write_mask & 0xf) as u8;
    Ok(target)
}
