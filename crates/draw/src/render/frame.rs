//! One frame of a variant: built once, encoded as often as needed.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use preshade_plan::draw_table;
use preshade_plan::frame::{ColorAttachments, FrameLoad, FrameOps, FramePass};
use preshade_plan::geometry::Geometry;
use preshade_plan::plan::{Draws, Phase, When};
use preshade_plan::state::StoreOp;

use super::bounded::Guard;
use super::frame_draw_table::{Arguments, DrawTable};
use super::gpu::Gpu;
use super::inputs::{self, SceneInputs};
use super::layout::RendererGeometry;
use super::picture::{ColorImage, DepthImage};
use super::pipeline::{Build, PipelineKey, blank_fragment};
use super::shader::{PlannedPass, Variant};
use super::subdivided::{Meshes, Subdivided, SubdivisionCost};
use super::targets::{self, Targets};
use super::{Error, compute, order, readback};
use crate::scene::bind::{self, Area};
use crate::scene::{DrawOrder, Frame, Rows, Scene};

/// Settings of a frame that are independent of scene and plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameSettings {
    /// Clear value of the colour attachments, linear RGBA.
    pub clear_color: [f64; 4],
    /// Whether the colour attachments start with [`Scene::initial`] instead of the clear value.
    pub initial_colors: bool,
}

impl FrameSettings {
    /// Settings with the scene's background.
    pub fn of(scene: &Scene) -> Self {
        Self {
            clear_color: scene.clear_color,
            initial_colors: true,
        }
    }
}

/// A picture with its depth.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// Colour targets by location, resolved.
    pub colors: Vec<Option<ColorImage>>,
    /// Every sample of the scene's depth. `None` if the frame has no such attachment.
    pub depth: Option<DepthImage>,
}

/// The vertices that a compute pass computed for a draw.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ComputedVertices {
    /// Index of the draw in the scene.
    pub draw: usize,
    /// The origin of each vertex of one instance, as
    /// [`crate::render::subdivision::Mesh::points`].
    pub points: Vec<[u32; 4]>,
    /// The vertices, instance by instance, with the same number of words each.
    pub words: Vec<u32>,
}

/// A variant that is ready to be drawn: targets, pipelines, bind groups.
pub struct Prepared<'a> {
    gpu: &'a Gpu,
    inputs: &'a SceneInputs<'a>,
    targets: Targets,
    compute: Vec<compute::PreparedCompute>,
    meshes: Meshes,
    table: DrawTable,
    passes: Vec<PreparedPass>,
    settings: FrameSettings,
    /// Whether the samples of a colour target are kept after resolving.
    resolved_samples: wgpu::StoreOp,
    /// Limit on the indices or vertices to draw of each draw.
    most_corners: u32,
    /// Limit on the instances to draw of each draw.
    most_instances: u32,
    creation: Duration,
    pipelines: usize,
    /// The bounded copies to draw first. `None` if all loops end.
    guard: Option<Guard<'a>>,
}

/// The query of each render pass while a frame is drawn.
#[derive(Clone, Copy)]
enum Queries<'q> {
    None,
    Statistics(&'q wgpu::QuerySet),
    Occlusion(&'q wgpu::QuerySet),
}

struct PreparedPass {
    frame: FramePass,
    pipelines: Vec<wgpu::RenderPipeline>,
    /// Items by draw, in the scene's order. A draw has several if its material has several members.
    items: Vec<Item>,
    /// Indices of `items` in drawing order.
    sequence: Vec<usize>,
}

struct Item {
    draw: usize,
    pipeline: usize,
    groups: Vec<(u32, wgpu::BindGroup)>,
    /// Size of the immediate data in bytes.
    immediates: u32,
    stencil_reference: u32,
    /// The draw's vertex buffer in each attachment slot.
    vertex_buffers: Vec<usize>,
    call: Call,
}

enum Call {
    AsGiven,
    /// The subdivided triangles of the draw.
    Subdivided(Subdivided),
    /// This number of vertices, without vertex buffers.
    Unindexed(u32),
    /// One triangle over the whole screen.
    FullScreen,
    /// Arguments from a buffer of the frame.
    Indirect(Arguments),
}

impl Call {
    /// The area of the target that a draw with this geometry covers. `own` is that of the draw
    /// itself. Geometry from an indirect buffer covers all depths.
    fn area(&self, own: Area, whole: Area) -> Area {
        match self {
            Self::AsGiven | Self::Subdivided(_) | Self::Unindexed(_) => own,
            Self::FullScreen => whole,
            Self::Indirect(_) => own.with_all_depths(),
        }
    }
}

impl std::fmt::Debug for Prepared<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Prepared")
            .field("passes", &self.passes.len())
            .field("pipelines", &self.pipelines)
            .finish_non_exhaustive()
    }
}

impl<'a> Prepared<'a> {
    /// Builds everything that is needed to draw `variant`, aimed at the first frame of the first
    /// camera in the scene's first order.
    ///
    /// # Errors
    /// [`Error::Refused`] if a shader or pipeline does not compile (for an emitted shader, a bug in
    /// preshade), [`Error::Plan`] if the plan needs something that the frame or scene does not
    /// have, [`Error::Unsupported`] if the adapter lacks a feature.
    pub fn new(
        inputs: &'a SceneInputs<'a>,
        variant: &Variant,
        settings: &FrameSettings,
    ) -> Result<Self, Error> {
        Self::with_entries(inputs, variant, settings, |_| {})
    }

    /// [`Self::new`] with changed entries of the draw table. Tests use it to draw as a host that
    /// gets the table wrong.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_entries(
        inputs: &'a SceneInputs<'a>,
        variant: &Variant,
        settings: &FrameSettings,
        amend: fn(&mut draw_table::Entry),
    ) -> Result<Self, Error> {
        let (gpu, scene) = (inputs.gpu(), inputs.scene());
        check_loads(&variant.frame().passes)?;
        let targets = Targets::new(gpu, variant, scene.size)?;
        let guard = Guard::new(inputs, variant, settings)?;
        let start = Instant::now();
        let shaders = variant.compile(gpu, inputs.compiled())?;
        let blank = blank_fragment(gpu, inputs.compiled())?;
        let mut meshes = Meshes::new(scene.size);
        let table = DrawTable::new(inputs, variant.plans(), amend)
            .and_then(|table| {
                table.check(&variant.frame().attachments)?;
                Ok(table)
            })
            .map_err(|message| Error::Draws {
                scene: scene.name.clone(),
                message,
            })?;
        let compute = compute::prepare(inputs, variant, &shaders, &targets, &mut meshes, &table)?;
        compute::load(inputs, &compute)?;
        let mut builder = FrameBuilder {
            inputs,
            variant,
            targets: &targets,
            shaders: &shaders,
            blank: &blank,
            table: &table,
            meshes: &mut meshes,
        };
        let frame_passes = variant.frame().passes.iter();
        let passes = frame_passes
            .map(|pass| builder.pass(pass))
            .collect::<Result<Vec<_>, _>>()?;
        let mut prepared = Self {
            gpu,
            inputs,
            targets,
            pipelines: compute.len() + passes.iter().map(|p| p.pipelines.len()).sum::<usize>(),
            compute,
            meshes,
            table,
            passes,
            settings: *settings,
            // A host discards the samples after resolving, so we do too.
            resolved_samples: wgpu::StoreOp::Discard,
            most_corners: u32::MAX,
            most_instances: u32::MAX,
            creation: start.elapsed(),
            guard,
        };
        if let Some(frame) = scene.cameras.first().and_then(|c| c.frames.first()) {
            prepared.aim(
                frame,
                scene.orders.first().copied().unwrap_or(DrawOrder::AsGiven),
            );
        }
        Ok(prepared)
    }

    /// Sorts the draws for `frame`: opaque ones in `order`, blended ones back to front.
    /// [`SceneInputs::set_frame`] sets the uniforms.
    pub fn aim(&mut self, frame: &Frame, order: DrawOrder) {
        let opaque = order::opaque(self.inputs.scene(), frame, order);
        self.arrange(frame, &opaque);
    }

    /// As [`Self::aim`], with only these draws, given by index in the scene. Opaque ones are drawn
    /// in this order.
    pub fn arrange(&mut self, frame: &Frame, draws: &[usize]) {
        let mut blended = order::blended(self.inputs.scene(), frame);
        blended.retain(|draw| draws.contains(draw));
        for pass in &mut self.passes {
            let draws = match pass.frame.phase {
                Phase::Blended => &blended,
                _ => draws,
            };
            let items = &pass.items;
            pass.sequence = draws
                .iter()
                .flat_map(|draw| {
                    let first = items.partition_point(|i| i.draw < *draw);
                    (first..items.len()).take_while(move |i| items[*i].draw == *draw)
                })
                .collect();
        }
    }

    /// Restricts depth passes before the main passes to these draws, until the next [`Self::aim`].
    pub fn keep_ahead(&mut self, draws: &[usize]) {
        for pass in &mut self.passes {
            if pass.frame.phase == Phase::Depth {
                let items = &pass.items;
                pass.sequence.retain(|i| draws.contains(&items[*i].draw));
            }
        }
    }

    /// Draws bounded copies of the frame's shaders, if a loop of them may not end. Must be called
    /// before the frame is drawn.
    ///
    /// # Errors
    /// [`Error::Endless`], or as [`Prepared::draw`].
    pub fn check_end(&self) -> Result<(), Error> {
        self.guard.as_ref().map_or(Ok(()), Guard::check)
    }

    pub(super) fn inputs(&self) -> &'a SceneInputs<'a> {
        self.inputs
    }

    /// The first word of a buffer of the frame.
    ///
    /// # Errors
    /// [`Error::Lost`], [`Error::Refused`].
    pub(super) fn first_word(&self, buffer: &str) -> Result<u32, Error> {
        let what = "reading a buffer of the frame back";
        let Some(from) = self.table.words(buffer) else {
            return Ok(0);
        };
        let device = &self.gpu.device;
        let copy = self.gpu.checked(what, || {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(what),
                size: 4,
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            })
        })?;
        let mut encoder = device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(from, 0, &copy, 0, 4);
        self.gpu.submit(what, encoder)?;
        let bytes = self.gpu.read_buffer(&copy)?;
        let word = bytes.first_chunk::<4>().copied().unwrap_or_default();
        Ok(u32::from_le_bytes(word))
    }

    /// Runs the compute passes, and reads back the vertices that they computed for each draw.
    ///
    /// # Errors
    /// As [`Prepared::draw`].
    pub fn computed_vertices(&self) -> Result<Vec<ComputedVertices>, Error> {
        self.check_end()?;
        let what = "reading computed vertices back";
        let device = &self.gpu.device;
        let mut encoder = device.create_command_encoder(&Default::default());
        compute::encode(self.inputs, &self.compute, When::is_frame, &mut encoder);
        let mut copies = Vec::new();
        for (draw, points, buffer) in self.meshes.computed() {
            let copy = self.gpu.checked(what, || {
                device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some(what),
                    size: buffer.size(),
                    usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                    mapped_at_creation: false,
                })
            })?;
            encoder.copy_buffer_to_buffer(buffer, 0, &copy, 0, buffer.size());
            copies.push((draw, points, copy));
        }
        self.gpu.submit(what, encoder)?;
        let read = |(draw, points, copy): (usize, &[[u32; 4]], wgpu::Buffer)| {
            let bytes = self.gpu.read_buffer(&copy)?;
            let words = bytes.as_chunks::<4>().0.iter();
            Ok(ComputedVertices {
                draw,
                points: points.to_vec(),
                words: words.map(|w| u32::from_le_bytes(*w)).collect(),
            })
        };
        copies.into_iter().map(read).collect()
    }

    /// Encodes the whole frame, from clear to resolve. Call [`Self::check_end`] before submitting
    /// it.
    pub fn encode(&self, encoder: &mut wgpu::CommandEncoder) {
        self.encode_with(encoder, Queries::None);
    }

    /// Encodes the frame with one query per render pass.
    fn encode_with(&self, encoder: &mut wgpu::CommandEncoder, queries: Queries<'_>) {
        let mut done: Option<Phase> = None;
        self.table.clear(encoder);
        let initial = self.inputs.initial();
        initial.encode(&self.targets, self.settings.initial_colors, encoder);
        compute::encode(self.inputs, &self.compute, When::is_frame, encoder);
        let last_color = self
            .passes
            .iter()
            .rposition(|p| p.frame.colors == ColorAttachments::Scene);
        for (index, pass) in self.passes.iter().enumerate() {
            let next = pass.frame.phase;
            let between = |when: &When| {
                when.phase()
                    .is_some_and(|p| done.is_none_or(|done| p >= done) && p < next)
            };
            compute::encode(self.inputs, &self.compute, between, encoder);
            done = Some(next);
            let mut render = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: None,
                color_attachments: &self.color_attachments(pass, last_color == Some(index)),
                depth_stencil_attachment: self.depth_attachment(pass),
                occlusion_query_set: match queries {
                    Queries::Occlusion(set) => Some(set),
                    Queries::None | Queries::Statistics(_) => None,
                },
                ..Default::default()
            });
            match queries {
                Queries::None => {}
                Queries::Statistics(set) => {
                    render.begin_pipeline_statistics_query(set, index as u32);
                }
                Queries::Occlusion(_) => render.begin_occlusion_query(index as u32),
            }
            self.draw_all(pass, &mut render);
            match queries {
                Queries::None => {}
                Queries::Statistics(_) => render.end_pipeline_statistics_query(),
                Queries::Occlusion(_) => render.end_occlusion_query(),
            }
        }
        let behind = |when: &When| {
            when.phase()
                .is_some_and(|p| done.is_none_or(|done| p >= done))
        };
        compute::encode(self.inputs, &self.compute, behind, encoder);
    }

    /// Draws the frame once and returns pairs of vertex and fragment invocations, one pair per
    /// render pass. The device must have pipeline statistics.
    ///
    /// # Errors
    /// As [`Prepared::draw`].
    pub fn draw_counted(&self) -> Result<Vec<u64>, Error> {
        let types = wgpu::PipelineStatisticsTypes::VERTEX_SHADER_INVOCATIONS
            | wgpu::PipelineStatisticsTypes::FRAGMENT_SHADER_INVOCATIONS;
        self.draw_queried(wgpu::QueryType::PipelineStatistics(types), 2)
    }

    /// Draws the frame once. Returns a number for each render pass that is nonzero if samples
    /// passed its tests; many adapters return the number of samples.
    ///
    /// # Errors
    /// As [`Prepared::draw`].
    pub fn draw_occluded(&self) -> Result<Vec<u64>, Error> {
        self.draw_queried(wgpu::QueryType::Occlusion, 1)
    }

    /// Draws the frame once with a query of type `ty` for each render pass, of `words` 64-bit
    /// words.
    fn draw_queried(&self, ty: wgpu::QueryType, words: u64) -> Result<Vec<u64>, Error> {
        self.check_end()?;
        let count = self.passes.len() as u32;
        let bytes = u64::from(count) * 8 * words;
        let device = &self.gpu.device;
        let (encoder, read) = self.gpu.checked("a frame with queries", || {
            let set = device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("queries"),
                ty,
                count,
            });
            let buffer = |usage| {
                device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("queries"),
                    size: bytes,
                    usage,
                    mapped_at_creation: false,
                })
            };
            let resolved = buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC);
            let read = buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ);
            let mut encoder = device.create_command_encoder(&Default::default());
            let queries = match ty {
                wgpu::QueryType::Occlusion => Queries::Occlusion(&set),
                _ => Queries::Statistics(&set),
            };
            self.encode_with(&mut encoder, queries);
            encoder.resolve_query_set(&set, 0..count, &resolved, 0);
            encoder.copy_buffer_to_buffer(&resolved, 0, &read, 0, bytes);
            (encoder, read)
        })?;
        self.gpu.submit("a frame with queries", encoder)?;
        let bytes = self.gpu.read_buffer(&read)?;
        Ok(bytes
            .as_chunks::<8>()
            .0
            .iter()
            .map(|b| u64::from_le_bytes(*b))
            .collect())
    }

    /// Draws the frame once and waits.
    ///
    /// # Errors
    /// [`Error::Refused`] if a command is invalid, [`Error::Lost`] if the device is lost,
    /// [`Error::Endless`].
    pub fn draw(&self) -> Result<(), Error> {
        self.check_end()?;
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        self.gpu.checked("a frame", || self.encode(&mut encoder))?;
        self.gpu.submit("a frame", encoder)
    }

    /// Draws the frame once and reads it back.
    ///
    /// # Errors
    /// As [`Prepared::draw`].
    pub fn render(&self) -> Result<Rendered, Error> {
        self.draw()?;
        let colors = self
            .targets
            .colors
            .iter()
            .map(|slot| {
                let Some(target) = slot else { return Ok(None) };
                let texture = match &target.resolved {
                    Some((texture, _)) => texture,
                    None if target.drawn.sample_count() == 1 => &target.drawn,
                    // The format is multisampled and cannot be resolved, so a host could not show
                    // it either.
                    None => return Ok(None),
                };
                readback::color(self.gpu, texture, target.format).map(Some)
            })
            .collect::<Result<Vec<_>, Error>>()?;
        let depth = self.read_depth()?;
        let mut rendered = Rendered { colors, depth };
        if self.inputs.scene().rows == Rows::FromBottom {
            rendered
                .colors
                .iter_mut()
                .flatten()
                .for_each(ColorImage::turn_over);
            rendered.depth.iter_mut().for_each(DepthImage::turn_over);
        }
        Ok(rendered)
    }

    /// Draws the frame once and reads its depth back, in the texture's row order. `None` if it has
    /// no depth.
    ///
    /// # Errors
    /// As [`Prepared::draw`].
    pub fn depth(&self) -> Result<Option<DepthImage>, Error> {
        self.draw()?;
        self.read_depth()
    }

    fn read_depth(&self) -> Result<Option<DepthImage>, Error> {
        let depth = self.targets.depth(preshade_plan::plan::SCENE_DEPTH);
        depth
            .map(|d| readback::depth(self.gpu, &d.texture, d.format))
            .transpose()
    }

    /// Draws only the first triangle of the first instance of each draw.
    pub fn one_triangle_a_draw(self) -> Self {
        Self {
            most_corners: 3,
            most_instances: 1,
            ..self
        }
    }

    /// Keeps every sample of the colour targets, for [`Self::render_red`].
    pub fn keeping_samples(self) -> Self {
        Self {
            resolved_samples: wgpu::StoreOp::Store,
            ..self
        }
    }

    /// Draws the frame once and reads the red channel of every sample of colour target 0, which
    /// must have a float format.
    ///
    /// # Errors
    /// As [`Prepared::draw`].
    pub fn render_red(&self) -> Result<Option<DepthImage>, Error> {
        self.draw()?;
        match self.targets.colors.first() {
            Some(Some(target)) => readback::red(self.gpu, &target.drawn).map(Some),
            _ => Ok(None),
        }
    }

    /// Number of pipelines, and the time to compile shaders and create pipelines.
    pub fn creation(&self) -> (usize, Duration) {
        (self.pipelines, self.creation)
    }

    /// Draw calls of one frame.
    pub fn draw_calls(&self) -> usize {
        self.passes.iter().map(|p| p.sequence.len()).sum()
    }

    /// The cost of subdivided geometry per frame; `None` without subdivision.
    pub fn subdivision_cost(&self) -> Option<SubdivisionCost> {
        self.meshes.cost()
    }

    pub fn target_bytes(&self) -> u64 {
        self.targets.bytes()
    }

    /// Bytes of each attachment, by its name and format.
    pub fn targets(&self) -> BTreeMap<String, u64> {
        self.targets.each()
    }

    fn color_attachments(
        &self,
        pass: &PreparedPass,
        last: bool,
    ) -> Vec<Option<wgpu::RenderPassColorAttachment<'_>>> {
        let planned = |location: usize| pass.frame.color_ops.get(location).copied().flatten();
        match &pass.frame.colors {
            ColorAttachments::None => return Vec::new(),
            ColorAttachments::Named(names) => {
                return names
                    .iter()
                    .enumerate()
                    .map(|(location, name)| {
                        let target = self.targets.named(name.as_deref()?)?;
                        Some(wgpu::RenderPassColorAttachment {
                            view: &target.view,
                            depth_slice: None,
                            resolve_target: None,
                            ops: operations(planned(location)?, target.clear),
                        })
                    })
                    .collect();
            }
            ColorAttachments::Scene => {}
        }
        let own = &self.inputs.scene().initial.clear_colors;
        let clear = |location: usize| {
            let own = own.get(location).filter(|_| self.settings.initial_colors);
            let [r, g, b, a] = *own.unwrap_or(&self.settings.clear_color);
            wgpu::Color { r, g, b, a }
        };
        self.targets
            .colors
            .iter()
            .enumerate()
            .map(|(location, slot)| {
                let (target, planned) = (slot.as_ref()?, planned(location)?);
                let mut ops = operations(planned, clear(location));
                let initial = self.inputs.initial().color(location, &target.drawn);
                if initial.is_some() && self.settings.initial_colors {
                    ops.load = wgpu::LoadOp::Load;
                }
                // Stored attachments are visible, resolved if multisampled. Discarded ones are not.
                let resolved = target
                    .resolved
                    .as_ref()
                    .filter(|_| last && planned.store == StoreOp::Store);
                if resolved.is_some() {
                    ops.store = self.resolved_samples;
                }
                Some(wgpu::RenderPassColorAttachment {
                    view: &target.view,
                    depth_slice: None,
                    resolve_target: resolved.map(|(_, view)| view),
                    ops,
                })
            })
            .collect()
    }

    fn depth_attachment(
        &self,
        pass: &PreparedPass,
    ) -> Option<wgpu::RenderPassDepthStencilAttachment<'_>> {
        let target = self.targets.depth(pass.frame.depth.as_deref()?)?;
        let is_scene_depth = pass.frame.depth.as_deref() == Some(preshade_plan::plan::SCENE_DEPTH);
        let (mut keeps, mut clear_stencil) = ([false; 2], 0);
        if is_scene_depth {
            keeps = self.inputs.initial().keeps(&target.texture);
            clear_stencil = self.inputs.scene().initial.clear_stencil;
        }
        Some(wgpu::RenderPassDepthStencilAttachment {
            view: &target.view,
            depth_ops: (pass.frame.depth_ops).map(|o| kept(keeps[0], operations(o, target.clear))),
            stencil_ops: (pass.frame.stencil_ops)
                .map(|o| kept(keeps[1], operations(o, clear_stencil))),
        })
    }

    fn draw_all(&self, pass: &PreparedPass, render: &mut wgpu::RenderPass<'_>) {
        let scene = self.inputs.scene();
        let divisor = self.targets.divisor(&pass.frame);
        let target = [0, 0, scene.size[0], scene.size[1]];
        let whole = Area::of(scene.viewport.unwrap_or(target), scene.size);
        let mut current = None;
        let mut area = Area::of(target, scene.size);
        for item in pass.sequence.iter().filter_map(|i| pass.items.get(*i)) {
            let Some(draw) = self.inputs.draw(item.draw) else {
                continue;
            };
            let own = draw.area.map_or(whole, |own| own.scaled(scene.size));
            let wanted = targets::divided(item.call.area(own, whole), divisor);
            if area != wanted {
                wanted.set(render);
                area = wanted;
            }
            if current != Some(item.pipeline) {
                render.set_pipeline(&pass.pipelines[item.pipeline]);
                current = Some(item.pipeline);
            }
            render.set_stencil_reference(item.stencil_reference);
            for (group, bindings) in &item.groups {
                render.set_bind_group(*group, bindings, &[]);
            }
            if item.immediates > 0 {
                render.set_immediates(0, &draw.immediates(item.immediates));
            }
            for (slot, source) in item.vertex_buffers.iter().enumerate() {
                let own = draw.vertex_buffers.get(*source);
                let vertex = own.or_else(|| {
                    let previous = self.inputs.previous(item.draw)?;
                    let source = source.checked_sub(draw.vertex_buffers.len())?;
                    previous.vertex_buffers.get(source)
                });
                let Some(vertex) = vertex else { continue };
                render.set_vertex_buffer(slot as u32, vertex.buffer.slice(..));
            }
            let bind::Call {
                first,
                count,
                base_vertex,
                first_instance,
            } = draw.call;
            let corners = first..first + count.min(self.most_corners);
            let instances = draw.instances.min(self.most_instances);
            let instances = first_instance..first_instance + instances;
            match &item.call {
                Call::AsGiven => {}
                Call::Subdivided(subdivided) => {
                    subdivided.mesh.draw(render);
                    continue;
                }
                Call::Unindexed(vertices) => {
                    render.draw(0..*vertices, instances);
                    continue;
                }
                Call::FullScreen => {
                    render.draw(0..3, 0..1);
                    continue;
                }
                Call::Indirect(Arguments { buffer, offset }) => {
                    render.draw_indirect(buffer, *offset);
                    continue;
                }
            }
            match &draw.indices {
                Some(indices) => {
                    render.set_index_buffer(indices.buffer.slice(..), indices.format);
                    render.draw_indexed(corners, base_vertex, instances);
                }
                None => render.draw(corners, instances),
            }
        }
    }
}

/// Builds the render passes of a frame.
struct FrameBuilder<'b, 'a> {
    inputs: &'a SceneInputs<'a>,
    variant: &'b Variant,
    targets: &'b Targets,
    shaders: &'b BTreeMap<&'b str, wgpu::ShaderModule>,
    blank: &'b wgpu::ShaderModule,
    table: &'b DrawTable,
    meshes: &'b mut Meshes,
}

impl FrameBuilder<'_, '_> {
    fn pass(&mut self, frame_pass: &FramePass) -> Result<PreparedPass, Error> {
        let scene = self.inputs.scene();
        let mut pass = PreparedPass {
            frame: frame_pass.clone(),
            pipelines: Vec::new(),
            items: Vec::new(),
            sequence: Vec::new(),
        };
        let mut built: Vec<(PipelineKey, usize)> = Vec::new();
        for (index, draw) in scene.draws.iter().enumerate() {
            let Some(material) = scene.materials.get(draw.material) else {
                continue;
            };
            let members = frame_pass.members.iter();
            for (_, member) in members.filter(|(name, _)| *name == material.name) {
                let found = self.variant.member(&material.name, *member)?;
                if found.pass.draws == Draws::Opaque && material.state.is_blended() {
                    continue;
                }
                let is_one = pass.items.is_empty() && draw.instances <= 1;
                if found.pass.phase == Phase::HalfRate && !is_one {
                    return Err(found.failed(
                        "the values of one draw fit into its attachments of half the size, and the \
                         scene draws it several times, or several instances: give each draw a \
                         material of its own"
                            .to_owned(),
                    ));
                }
                let of = (draw.material, *member);
                let Some(item) = self.item(&mut pass, &mut built, &found, of, index)? else {
                    continue;
                };
                pass.items.push(item);
                if found.pass.draws == Draws::Once {
                    return Ok(pass);
                }
            }
        }
        Ok(pass)
    }

    /// The item of one draw, with a new pipeline if none in `built` fits. `None` without inputs.
    fn item(
        &mut self,
        pass: &mut PreparedPass,
        built: &mut Vec<(PipelineKey, usize)>,
        found: &PlannedPass<'_>,
        (material, member): (usize, usize),
        index: usize,
    ) -> Result<Option<Item>, Error> {
        let gpu = self.inputs.gpu();
        let gpu_pass = found.pass;
        let (Some(bound), Some(previous)) = (self.inputs.draw(index), self.inputs.previous(index))
        else {
            return Ok(None);
        };
        let (geometry, bindings) = (&gpu_pass.geometry, &gpu_pass.bindings);
        let subdivided = self
            .meshes
            .of(gpu, found.plan, geometry, bindings, (index, bound))
            .map_err(|message| found.failed(message))?;
        let drawn = self
            .table
            .of(gpu, bindings, (index, bound, previous))
            .map_err(|message| found.failed(message))?;
        let made = match &subdivided {
            Some(subdivided) => RendererGeometry::Subdivided(subdivided, &drawn),
            None => RendererGeometry::Drawn(&drawn),
        };
        let build = Build {
            gpu,
            compiled: self.inputs.compiled(),
            targets: self.targets,
            shaders: self.shaders,
            plan: found.plan,
            pass: gpu_pass,
            stages: found.stages,
            frame: &pass.frame,
            draw: bound,
            previous,
            made,
        };
        build.requirements()?;
        let vertex = build.vertex_layout()?;
        let filled = build.filled()?;
        let key = PipelineKey {
            material,
            member,
            vertex: vertex.clone(),
            bindings: filled.values().flatten().map(|b| b.entry).collect(),
            strip: build.strip_format(),
        };
        let groups = build.groups(&filled)?;
        let pipeline = match built.iter().find(|(k, _)| *k == key) {
            Some((_, i)) => *i,
            None => {
                let layouts = groups.iter().map(|(g, l, _)| (*g, l)).collect::<Vec<_>>();
                let pipeline = build.pipeline(self.blank, &layouts, &key)?;
                pass.pipelines.push(pipeline);
                built.push((key, pass.pipelines.len() - 1));
                pass.pipelines.len() - 1
            }
        };
        let call = match (subdivided, geometry) {
            (Some(subdivided), _) => Call::Subdivided(subdivided),
            (None, Geometry::Unindexed) => Call::Unindexed(drawn.triangles * 3),
            (None, Geometry::FullScreen) => Call::FullScreen,
            (None, Geometry::Indirect { buffer }) => {
                let arguments = self.table.arguments(buffer, &drawn);
                Call::Indirect(arguments.map_err(|m| found.failed(m))?)
            }
            (None, Geometry::Instances | Geometry::Vertices | Geometry::Draw) => {
                let message = "its geometry is computed, not drawn".to_owned();
                return Err(found.failed(message));
            }
            (None, _) => Call::AsGiven,
        };
        Ok(Some(Item {
            draw: index,
            pipeline,
            groups: groups.into_iter().map(|(g, _, b)| (g, b)).collect(),
            immediates: inputs::immediate_size(&gpu_pass.limits),
            stencil_reference: gpu_pass.stencil.as_ref().map_or(0, |s| s.reference),
            vertex_buffers: vertex.iter().map(|v| v.source).collect(),
            call,
        }))
    }
}

impl Area {
    fn set(self, render: &mut wgpu::RenderPass<'_>) {
        let [x, y, w, h, near, far] = self.viewport;
        render.set_viewport(x, y, w, h, near, far);
        let [x, y, w, h] = self.scissor;
        render.set_scissor_rect(x, y, w, h);
    }
}

/// Operations on an attachment. If `is_kept`, they load its content instead of clearing it.
fn kept<V>(is_kept: bool, mut of: wgpu::Operations<V>) -> wgpu::Operations<V> {
    if is_kept {
        of.load = wgpu::LoadOp::Load;
    }
    of
}

/// A frame's load and store operations as wgpu types.
fn operations<V>(ops: FrameOps, clear: V) -> wgpu::Operations<V> {
    wgpu::Operations {
        load: match ops.load {
            FrameLoad::Clear => wgpu::LoadOp::Clear(clear),
            FrameLoad::Load => wgpu::LoadOp::Load,
        },
        store: match ops.store {
            StoreOp::Store => wgpu::StoreOp::Store,
            StoreOp::Discard => wgpu::StoreOp::Discard,
        },
    }
}

/// Fails if a pass loads an attachment that no earlier pass has drawn: frames start with empty
/// attachments here.
fn check_loads(passes: &[FramePass]) -> Result<(), Error> {
    let mut drawn: Vec<String> = Vec::new();
    for pass in passes {
        let depth = pass.depth.clone().unwrap_or_default();
        let stencil = format!("{depth} (stencil)");
        let names: Vec<String> = match &pass.colors {
            ColorAttachments::Named(names) => names
                .iter()
                .map(|n| n.clone().unwrap_or_default())
                .collect(),
            _ => (0..pass.color_ops.len())
                .map(|i| format!("the scene's colour {i}"))
                .collect(),
        };
        let colors = names.into_iter().zip(&pass.color_ops);
        let aspects = [(depth, &pass.depth_ops), (stencil, &pass.stencil_ops)];
        for (name, ops) in aspects.into_iter().chain(colors) {
            match ops {
                Some(ops) if ops.load == FrameLoad::Load && !drawn.contains(&name) => {
                    return Err(Error::Attachment {
                        name,
                        message: "its first pass loads it, and nothing is in it yet".to_owned(),
                    });
                }
                Some(_) => drawn.push(name),
                None => {}
            }
        }
    }
    Ok(())
}
