//! Makes a [`Scene`] of one captured render pass. Its pipelines become the materials, and its draws
//! keep their captured bindings.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{Mat4, Vec3};
use preshade_plan::plan::BindingKind;
use preshade_plan::state::DepthDirection;

use super::maker::{Bound, Maker};
use super::material;
use super::measured::Measured;
use super::reader::Left;
use super::share::Share;
use super::{Error, alpha, noise, texels, webgl};
use preshade_draw::render::Gpu;
use preshade_draw::scene::bind::{
    Area, BufferBinding, Call, DrawBindings, Rate, SamplerBinding, VertexAttribute, VertexBuffer,
};
use preshade_draw::scene::{Camera, Draw, DrawOrder, DrawRange, Frame, Light, Mesh, Scene};
use preshade_frames::contents::Contents;
use preshade_frames::file::{self, RenderPipeline, Resource};
use preshade_frames::folder::{Capture, get};
use preshade_frames::pass::{self, Kind, Pass, PassDraw, passes};

/// How many materials to time. Each needs several replays of the frame.
const TIMED_MATERIALS: usize = 12;

/// A pass counts as equally long if it takes at least this part of the longest time.
const ABOUT_AS_LONG: f64 = 0.7;

/// Passes with a smaller part of the frame's time are reported together.
const LEAST_PART: f64 = 0.02;

/// Longest material name in characters. Files are named after it.
const LONGEST_NAME: usize = 64;

/// Selects a pass of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// Frame, from 0.
    pub frame: usize,
    /// Index of the render pass in the frame, from 0. `None`: the pass that takes longest, or
    /// without an adapter the main pass with the most vertices.
    pub pass: Option<usize>,
}

/// Makes a scene of one pass. Its notes list the differences from the captured frame.
///
/// With an adapter, earlier passes are replayed for their results. Without one, such textures and
/// buffers are empty, which is enough to read the programs.
///
/// # Errors
/// The capture is broken, lacks data or has no such pass, or none of the pass's pipelines can be
/// read.
pub fn scene(capture: &Capture, choice: Choice, gpu: Option<&Gpu>) -> Result<Scene, Error> {
    let all = passes(capture, choice.frame)?;
    let measured = gpu
        .map(|gpu| Measured::new(capture, gpu, choice.frame))
        .transpose()?;
    let shares = measured.as_ref().map(|m| m.of.shares.clone());
    let index = chosen(&all, choice, shares.as_deref())?;
    let pass = &all[index];
    let contents = Contents::before(capture, choice.frame, pass.command)?;
    let mut made = Maker {
        capture,
        pass,
        unblended: alpha::unblended(capture, pass),
        before: &all[..index],
        contents,
        written: Contents::written(capture)?,
        replay: None,
        gpu,
        frame: choice.frame,
        size: [0; 2],
        direction: DepthDirection::default(),
        buffers: BTreeMap::new(),
        images: BTreeMap::new(),
        notes: BTreeSet::new(),
        materials: Vec::new(),
        by_pipeline: BTreeMap::new(),
        bindings: BTreeMap::new(),
        meshes: Vec::new(),
    };
    let mut scene = made.scene()?;
    scene.notes = std::mem::take(&mut made.notes).into_iter().collect();
    if let (Some(gpu), Some(mut measured), Some(shares)) = (gpu, measured, shares) {
        if all.len() > 1 {
            let part = 100.0 * shares[index].part;
            scene.part = Some(format!("render pass {index} ({part:.0} % of the frame)"));
        }
        // `rewrite` reads programs without an adapter.
        let unasked = chosen(
            &all,
            Choice {
                pass: None,
                ..choice
            },
            None,
        )?;
        let mut line = told(&shares, index);
        if unasked != index {
            line.push_str(&format!(". `rewrite` takes it by `--render-pass {index}`"));
        }
        scene.notes.insert(0, line);
        let timed = made.by_time();
        let pipelines: Vec<usize> = timed.iter().map(|(pipeline, _)| *pipeline).collect();
        let parts = measured.without(choice.frame, &pipelines)?;
        let replayed = measured.keep();
        let names = timed.iter().map(|(_, materials)| {
            let names = materials
                .iter()
                .map(|m| format!("`{}`", scene.materials[*m].name));
            names.collect::<Vec<_>>().join(" and ")
        });
        let parts = names.zip(parts).collect();
        let left = scene.materials.len() - timed.iter().map(|(_, m)| m.len()).sum::<usize>();
        scene.notes.insert(1, told_materials(parts, left));
        for (left, count) in &replayed.left_out {
            scene.notes.push(format!(
                "the replay of the frame leaves out {count} of {}: {}",
                left.what, left.why
            ));
        }
        let Some(compared) = &replayed.compared else {
            let why = "the capture has no picture of the frame, so the replay was not compared";
            scene.notes.push(why.to_owned());
            return Ok(scene);
        };
        let noise = match compared.is_off() {
            true => noise::of_frame(capture, &all),
            false => None,
        };
        let page = &capture.file.source.adapter;
        let line = compared.told(page, &gpu.adapter().name, noise.as_deref());
        let at = if compared.is_off() {
            0
        } else {
            scene.notes.len()
        };
        scene.notes.insert(at, line);
    }
    Ok(scene)
}

/// A line for the report about the frame's passes and their times.
fn told(shares: &[Share], own: usize) -> String {
    let one = |(index, share): (usize, &Share)| {
        let drawn = match index == own {
            true => ", which this report is about",
            false => "",
        };
        let draws = match share.draws {
            1 => "1 draw".to_owned(),
            n => format!("{n} draws"),
        };
        let percent = 100.0 * share.part;
        format!(
            "{index}, {} of {draws}, {percent:.0} %{drawn}",
            share.kind.name()
        )
    };
    // Many small passes share one entry, after the others in order of time.
    let mut passes: Vec<(usize, &Share)> = shares.iter().enumerate().collect();
    passes.retain(|(index, s)| s.draws > 0 && (s.part >= LEAST_PART || *index == own));
    passes.sort_by(|a, b| b.1.part.total_cmp(&a.1.part));
    let small: Vec<&Share> = shares
        .iter()
        .enumerate()
        .filter(|(index, s)| s.draws > 0 && s.part < LEAST_PART && *index != own)
        .map(|(_, s)| s)
        .collect();
    let mut told: Vec<String> = passes.into_iter().map(one).collect();
    if !small.is_empty() {
        let part: f64 = small.iter().map(|s| s.part).sum();
        told.push(format!("{} others {:.0} %", small.len(), 100.0 * part));
    }
    let drawn = |share: &Share| matches!(share.kind, Kind::Main | Kind::FullScreen);
    let dearest = shares.iter().enumerate().filter(|(_, s)| drawn(s));
    let dearest = dearest.max_by(|a, b| a.1.part.total_cmp(&b.1.part));
    let other = match dearest {
        Some((index, share)) if index != own && share.part > shares[own].part => {
            format!(". For the one that takes longest, give `--render-pass {index}`")
        }
        _ => String::new(),
    };
    format!(
        "the frame's time by render pass: {}{other}",
        told.join("; ")
    )
}

/// A line for the report about the materials' parts of the frame's time, largest first.
fn told_materials(mut materials: Vec<(String, Option<f64>)>, left: usize) -> String {
    materials.sort_by(|a, b| b.1.unwrap_or(0.0).total_cmp(&a.1.unwrap_or(0.0)));
    let left = match left {
        0 => String::new(),
        n => format!("; {n} that draw fewer vertices are not timed"),
    };
    let one = |(name, part): (String, Option<f64>)| match part {
        Some(part) => format!("{name} {:.0} %", 100.0 * part),
        None => format!("{name}: too small to measure"),
    };
    let materials: Vec<String> = materials.into_iter().map(one).collect();
    format!(
        "the part of the frame's time that each material's draws take: {}{left}",
        materials.join(", ")
    )
}

/// Chooses the pass that takes longest, or without times the main pass with the most vertices.
/// Times vary. So among passes of about the longest time, main passes come before full-screen ones,
/// and passes with more vertices before others.
fn chosen(all: &[Pass<'_>], choice: Choice, shares: Option<&[Share]>) -> Result<usize, Error> {
    let place = format!("frame {}", choice.frame);
    if let Some(index) = choice.pass {
        get(all, index, "render pass", &place)?;
        return Ok(index);
    }
    let part = |index: usize| shares.and_then(|s| s.get(index)).map_or(1.0, |s| s.part);
    // Passes that draw only depth are the last resort.
    let kinds: [&[Kind]; 2] = [
        &[Kind::Main, Kind::FullScreen],
        &[Kind::Prepass, Kind::Shadow, Kind::Depth],
    ];
    for kinds in kinds {
        let of = || (0..all.len()).filter(|i| kinds.contains(&all[*i].kind));
        let longest = of().map(part).fold(0.0, f64::max);
        let near = of().filter(|i| part(*i) >= ABOUT_AS_LONG * longest);
        let best = near.max_by_key(|i| (all[*i].kind != Kind::FullScreen, all[*i].vertices()));
        if let Some(index) = best {
            return Ok(index);
        }
    }
    Err(Error::broken(place, "no render pass of it draws anything"))
}

impl<'c> Maker<'c> {
    fn scene(&mut self) -> Result<Scene, Error> {
        let capture = self.capture;
        let frame = get(&capture.file.frames, self.frame, "frame", "the capture")?;
        let target = self.target()?;
        self.size = target.size;
        self.direction = target.direction;
        let mut draws = Vec::new();
        self.note_clears();
        for (index, draw) in self
            .pass
            .draws
            .iter()
            .enumerate()
            .take(self.pass.before_clear)
        {
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
        self.note_order(&draws);
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
            part: None,
            initial: target.initial,
            rows: self.reader().rows(capture),
            notes: Vec::new(),
        })
    }

    /// Notes that the scene draws blended materials last, if the order differs.
    fn note_order(&mut self, draws: &[Draw]) {
        let is_blended = |d: &&Draw| self.materials[d.material].state.is_blended();
        let behind = draws.iter().skip_while(|d| !is_blended(d));
        let opaque = match behind.filter(|d| !is_blended(d)).count() {
            0 => return,
            1 => "1 opaque draw comes".to_owned(),
            n => format!("{n} opaque draws come"),
        };
        let note = format!("{opaque} after a blended one: the scene draws blended materials last");
        self.notes.insert(note);
    }

    /// Notes clears that a scene cannot express: it clears whole attachments, before it draws.
    fn note_clears(&mut self) {
        if !self.pass.leading_clears.is_empty() {
            let note = "the pass clears a part of its attachments before it draws, which the scene does not";
            self.notes.insert(note.to_owned());
        }
        if self.pass.clears_later {
            let drawn = self.pass.before_clear;
            self.notes.insert(format!(
                "the pass clears a part of its attachments after {drawn} of its {} draws, which the scene does not: \
                 what comes after is left out",
                self.pass.draws.len()
            ));
        }
    }

    /// The pipelines with the most vertices, each with its materials: one per stencil reference.
    fn by_time(&self) -> Vec<(usize, Vec<usize>)> {
        let mut vertices: BTreeMap<usize, u64> = BTreeMap::new();
        for draw in &self.pass.draws {
            *vertices.entry(draw.pipeline).or_default() += draw.call.vertices();
        }
        let materials = |pipeline: usize| -> Vec<usize> {
            let range = (pipeline, 0)..=(pipeline, u32::MAX);
            self.by_pipeline
                .range(range)
                .filter_map(|(_, material)| *material)
                .collect()
        };
        let mut of: Vec<_> = vertices
            .into_iter()
            .map(|(pipeline, vertices)| (vertices, pipeline, materials(pipeline)))
            .filter(|(_, _, materials)| !materials.is_empty())
            .collect();
        of.sort_by_key(|(vertices, ..)| std::cmp::Reverse(*vertices));
        of.truncate(TIMED_MATERIALS);
        of.into_iter()
            .map(|(_, pipeline, m)| (pipeline, m))
            .collect()
    }

    /// The material for a draw's pipeline. `None`, with a note, if its text cannot be read.
    fn material(&mut self, draw: &PassDraw) -> Result<Option<usize>, Error> {
        let all = &self.capture.file.render_pipelines;
        let of = get(all, draw.pipeline, "render pipeline", "a draw")?;
        let has_stencil = of.depth_stencil.as_ref().is_some_and(material::has_stencil);
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
        let found = match material::read(self.capture, of, &name, self.reader()) {
            Ok(mut material) => {
                material.state.depth_direction = self.direction;
                if let Some(stencil) = &mut material.state.stencil {
                    stencil.reference = key.1;
                }
                if self.unblended.contains(&draw.pipeline) {
                    let targets = material.state.targets.iter_mut().flatten();
                    targets.for_each(|target| target.blend = None);
                    if alpha::is_written(of) {
                        self.notes.insert(format!(
                            "`{name}` blends alpha alone, on an opaque canvas whose alpha nothing in the capture reads: it is \
                             drawn without blending. If your own code reads the canvas's alpha, keep the blending"
                        ));
                    }
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

    /// The name that three.js and Babylon.js define in the shader: `#define SHADER_NAME Stone`.
    fn named_in_text(&self, of: &RenderPipeline) -> Option<String> {
        let stage = of.fragment.as_ref().map_or(&of.vertex.stage, |f| &f.stage);
        let text = self.capture.text(stage.module).ok()?;
        let defined = |word: &str| {
            let mut lines = text
                .lines()
                .take(200)
                .map(|l| l.trim_start_matches(['/', ' ']));
            let value = lines.find_map(|l| l.strip_prefix(word))?;
            let name = value.rsplit(':').next().unwrap_or(value).trim();
            (!name.is_empty()).then(|| name.to_owned())
        };
        defined("#define SHADER_NAME ").or_else(|| defined("#define SHADER_TYPE "))
    }

    /// A name for files: the label, plus a number if another pipeline has the same label.
    fn name(&self, of: &RenderPipeline, pipeline: usize) -> String {
        let shader = self.capture.file.shaders.get(of.vertex.stage.module);
        let own = self.named_in_text(of);
        let labels = [
            of.label.as_str(),
            own.as_deref().unwrap_or(""),
            shader.map_or("", |s| &s.label),
        ];
        let label = labels.into_iter().find(|l| !l.trim().is_empty());
        let tame = |c: char| match c.is_ascii_alphanumeric() || "-_.".contains(c) {
            true => c,
            false => '-',
        };
        let name = label.unwrap_or_default().chars().take(LONGEST_NAME);
        let name: String = name.map(tame).collect();
        let name = match name.trim_matches(['-', '.']) {
            "" => format!("pipeline-{pipeline}"),
            name => name.to_owned(),
        };
        // A pipeline with another stencil reference is another material.
        let numbered = [name.clone(), format!("{name}-{pipeline}")].into_iter();
        let mut numbered = numbered.chain((2..).map(|n| format!("{name}-{pipeline}-{n}")));
        let is_free = |name: &String| self.materials.iter().all(|m| m.name != *name);
        numbered.find(is_free).unwrap_or_default()
    }

    fn draw(&mut self, index: usize, draw: &PassDraw, material: usize) -> Result<Draw, Left> {
        let call = self.call(draw.call)?;
        let all = &self.capture.file.render_pipelines;
        let pipeline = get(all, draw.pipeline, "render pipeline", "a draw")?;
        let (buffers, textures, samplers) = match draw.named {
            Some(named) => self.named_resources(named, material)?,
            None => self.resources(draw, material)?,
        };
        let program = self.materials[material].clone();
        let vertex_buffers = match self.capture.file.source.api.is_webgl() {
            true => {
                let capture = self.capture;
                webgl::interleaved(capture, draw, pipeline, &program, &mut |p| self.part(p))?
            }
            false => self.vertex_buffers(draw, pipeline)?,
        };
        let (indices, call) =
            webgl::indices(self.capture, draw, pipeline, &program, call, &mut |part| {
                self.part(part)
            })?;
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
        // Nothing reads the positions by name: only the program knows them.
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

    /// The arguments of a call, read from their buffer for an indirect draw.
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

    /// Viewport and scissor of a draw. `None` if it covers the whole target.
    fn area(&self, draw: &PassDraw) -> Option<Area> {
        let [width, height] = self.size;
        if draw.viewport.is_none() && draw.scissor.is_none() {
            return None;
        }
        let whole = [0.0, 0.0, width as f32, height as f32, 0.0, 1.0];
        Some(Area {
            viewport: draw.viewport.unwrap_or(whole),
            scissor: draw.scissor.unwrap_or([0, 0, width, height]),
            of: self.size,
        })
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
                    format: a.format.own()?,
                    offset: a.offset,
                    is_invented: false,
                })
            });
            let attributes = attributes.collect::<Option<Vec<_>>>();
            made.push(VertexBuffer {
                stride: layout.array_stride,
                step: layout.step_mode,
                attributes: attributes.ok_or_else(|| {
                    Left::Out("an attribute has no location, or a format of WebGL".to_owned())
                })?,
                data,
            });
        }
        Ok(made)
    }

    /// The resources of a draw's bind groups that the program reads.
    fn resources(&mut self, draw: &PassDraw, material: usize) -> Result<Bound, Left> {
        let mut bound: Bound = Default::default();
        let uses = self.bindings(material);
        for used in uses.iter() {
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
                    let texture = self.texture(view, place, used)?;
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
}
