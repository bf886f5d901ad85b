//! Replays draws of WebGL. Its modules negate the y of positions, so that row 0 of every texture is
//! the bottom row, as in WebGL. Copies, uploads and texture coordinates then need no change.

use std::collections::{BTreeMap, BTreeSet};

use preshade_plan::plan::{BindingKind, BindingUse};
use preshade_plan::safety::Checks;
use wgpu::util::DeviceExt as _;

use super::objects::{color_target, depth_stencil, primitive};
use super::passes::Encoded;
use super::{Replay, ending};
use crate::capture::Error;
use crate::capture::material;
use crate::capture::reader::{Left, Reader};
use crate::capture::webgl::{self, BoundResource};
use preshade_draw::render::binding_type;
use preshade_draw::scene::Material;
use preshade_draw::scene::bind::{Data, Indices, VertexBuffer};
use preshade_frames::contents::cut;
use preshade_frames::file::RenderPipeline;
use preshade_frames::folder::get;
use preshade_frames::pass::{PassDraw, TexturePart};

/// Objects created for WebGL so far.
#[derive(Default)]
pub(super) struct Programs {
    /// Programs by render pipeline.
    materials: BTreeMap<usize, Result<Program, String>>,
    /// Pipelines by render pipeline and vertex layout.
    pipelines: BTreeMap<(usize, String), Result<wgpu::RenderPipeline, String>>,
    /// Buffers by hash of their content and usage.
    buffers: BTreeMap<(u128, u32), wgpu::Buffer>,
}

/// A program with its module and bindings.
#[derive(Clone)]
struct Program {
    material: Material,
    module: wgpu::ShaderModule,
    bindings: Vec<BindingUse>,
}

impl Replay<'_> {
    /// The encoded commands of a draw. Empty if it is left out.
    pub(super) fn draw_of_webgl(
        &mut self,
        draw: &PassDraw,
        place: &str,
    ) -> Result<Vec<Encoded>, Error> {
        match self.encoded(draw, place) {
            Ok(encoded) => Ok(encoded),
            Err(Left::Broken(Error::Render(
                error @ preshade_draw::render::Error::Refused { .. },
            ))) => {
                self.left(draw, error.to_string());
                Ok(Vec::new())
            }
            Err(Left::Broken(error)) => Err(error),
            Err(Left::Out(why)) => {
                self.left(draw, why);
                Ok(Vec::new())
            }
        }
    }

    fn left(&mut self, draw: &PassDraw, why: String) {
        self.leave_out(
            format!("a draw with render pipeline {}", draw.pipeline),
            why,
        );
    }

    fn encoded(&mut self, draw: &PassDraw, place: &str) -> Result<Vec<Encoded>, Left> {
        let all = &self.capture.file.render_pipelines;
        let pipeline = get(all, draw.pipeline, "render pipeline", place)?;
        let program = self.program(draw.pipeline, pipeline)?;
        let capture = self.capture;
        let contents = &self.contents;
        let mut part = |(buffer, offset, size): TexturePart| -> Result<Data, Left> {
            let bytes = contents.buffer(capture, buffer)?;
            Ok(Data::new(cut(&bytes, offset, size).to_vec()))
        };
        let material = &program.material;
        let vertices = webgl::interleaved(capture, draw, pipeline, material, &mut part)?;
        let (indices, call) =
            webgl::indices(capture, draw, pipeline, material, draw.call, &mut part)?;
        let unfiltered = self.unfiltered(draw, &program, place)?;
        let made = self.pipeline_of(draw.pipeline, pipeline, &program, &vertices, unfiltered)?;
        let mut encoded = vec![Encoded::Pipeline(made.clone())];
        for (group, bound) in self.groups_of(draw, &program, &made, place)? {
            encoded.push(Encoded::Group(group, Some(bound), Vec::new()));
        }
        for (slot, buffer) in vertices.iter().enumerate() {
            let held = self.held(&buffer.data, wgpu::BufferUsages::VERTEX)?;
            encoded.push(Encoded::Vertices(slot as u32, Some(held), 0, None));
        }
        encoded.extend(draw.viewport.map(Encoded::Viewport));
        encoded.extend(draw.scissor.map(Encoded::Scissor));
        let [r, g, b, a] = draw.blend_constant;
        encoded.push(Encoded::BlendConstant(wgpu::Color { r, g, b, a }));
        encoded.push(Encoded::StencilReference(draw.stencil_reference));
        let range = |first: u32, count: u32| first..first.saturating_add(count);
        let instances = range(call.first_instance, call.instances);
        let call = match indices {
            None => Encoded::Draw(range(call.first, call.count), instances),
            Some(Indices { format, data, .. }) => {
                let held = self.held(&data, wgpu::BufferUsages::INDEX)?;
                encoded.push(Encoded::Indices(held, format, 0, None));
                Encoded::DrawIndexed(range(call.first, call.count), call.base_vertex, instances)
            }
        };
        encoded.push(call);
        Ok(encoded)
    }

    fn program(&mut self, index: usize, pipeline: &RenderPipeline) -> Result<Program, Left> {
        if let Some(known) = self.programs.materials.get(&index) {
            return known.clone().map_err(Left::Out);
        }
        let name = format!("pipeline-{index}");
        let made = material::read(self.capture, pipeline, &name, Reader::Replay);
        let made = made.and_then(|material| {
            let module = ending::module(&material.program);
            let module = self.gpu.checked(&name, || {
                self.gpu.shader(
                    Checks::ALL,
                    wgpu::ShaderModuleDescriptor {
                        label: Some(&name),
                        source: wgpu::ShaderSource::Naga(std::borrow::Cow::Owned(module)),
                    },
                )
            });
            let plan = material.plan();
            let bindings = plan.main().map(|p| p.bindings.clone()).unwrap_or_default();
            Ok(Program {
                material,
                module: module.map_err(|e| Left::Out(e.to_string()))?,
                bindings,
            })
        });
        let made = match made {
            Ok(program) => Ok(program),
            Err(Left::Out(why)) => Err(why),
            Err(broken) => return Err(broken),
        };
        self.programs.materials.insert(index, made.clone());
        made.map_err(Left::Out)
    }

    fn pipeline_of(
        &mut self,
        index: usize,
        of: &RenderPipeline,
        program: &Program,
        vertices: &[VertexBuffer],
        unfiltered: BTreeSet<(u32, u32)>,
    ) -> Result<wgpu::RenderPipeline, Left> {
        let attributes: Vec<Vec<wgpu::VertexAttribute>> = vertices
            .iter()
            .map(|b| {
                let own = b.attributes.iter();
                let own = own.map(|a| wgpu::VertexAttribute {
                    format: a.format,
                    offset: a.offset,
                    shader_location: a.location,
                });
                own.collect()
            })
            .collect();
        let key = (index, format!("{attributes:?}{unfiltered:?}"));
        if let Some(known) = self.programs.pipelines.get(&key) {
            return known.clone().map_err(Left::Out);
        }
        let buffers: Vec<Option<wgpu::VertexBufferLayout<'_>>> = vertices
            .iter()
            .zip(&attributes)
            .map(|(b, attributes)| {
                Some(wgpu::VertexBufferLayout {
                    array_stride: b.stride,
                    step_mode: b.step,
                    attributes,
                })
            })
            .collect();
        let fragment = of.fragment.iter().flat_map(|f| &f.targets);
        let targets: Vec<Option<wgpu::ColorTargetState>> =
            fragment.map(|t| t.as_ref().map(color_target)).collect();
        let mut primitive = primitive(of);
        // Negated positions reverse the winding.
        primitive.front_face = match primitive.front_face {
            wgpu::FrontFace::Ccw => wgpu::FrontFace::Cw,
            wgpu::FrontFace::Cw => wgpu::FrontFace::Ccw,
        };
        if webgl::is_points(&program.material) {
            primitive.topology = wgpu::PrimitiveTopology::TriangleList;
            primitive.cull_mode = None;
        }
        let label = format!("render pipeline {index}");
        let layout = match unfiltered.is_empty() {
            true => None,
            false => Some(self.layout_of(&label, program, &unfiltered)?),
        };
        let material = &program.material;
        let made = self.gpu.checked(&label, || {
            let device = &self.gpu.device;
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(&label),
                layout: layout.as_ref(),
                vertex: wgpu::VertexState {
                    module: &program.module,
                    entry_point: Some(&material.vertex),
                    compilation_options: Default::default(),
                    buffers: &buffers,
                },
                primitive,
                depth_stencil: of.depth_stencil.as_ref().map(depth_stencil),
                multisample: wgpu::MultisampleState {
                    count: of.multisample.count,
                    mask: u64::from(of.multisample.mask),
                    alpha_to_coverage_enabled: of.multisample.alpha_to_coverage_enabled,
                },
                fragment: material.fragment.as_deref().map(|f| wgpu::FragmentState {
                    module: &program.module,
                    entry_point: Some(f),
                    compilation_options: Default::default(),
                    targets: &targets,
                }),
                multiview_mask: None,
                cache: None,
            })
        });
        let made = made.map_err(|e| e.to_string());
        self.programs.pipelines.insert(key, made.clone());
        made.map_err(Left::Out)
    }

    /// Bindings of depth textures that the program reads as floats, and of their samplers. WebGPU's
    /// derived layout would demand filtering.
    fn unfiltered(
        &mut self,
        draw: &PassDraw,
        program: &Program,
        place: &str,
    ) -> Result<BTreeSet<(u32, u32)>, Left> {
        let named = draw.named.unwrap_or(usize::MAX);
        let named = get(&self.capture.file.named, named, "named resources", place)?;
        let mut found = BTreeSet::new();
        for used in &program.bindings {
            if !matches!(used.kind, BindingKind::Texture | BindingKind::Sampler) {
                continue;
            }
            if let BoundResource::Texture(of) | BoundResource::Sampler(of) =
                webgl::given(&program.material, used, named)?
                && self
                    .texture(of.texture.texture, place)?
                    .format()
                    .has_depth_aspect()
            {
                found.insert((used.group, used.binding));
            }
        }
        Ok(found)
    }

    /// The layout of a program with some unfiltered textures.
    fn layout_of(
        &self,
        label: &str,
        program: &Program,
        unfiltered: &BTreeSet<(u32, u32)>,
    ) -> Result<wgpu::PipelineLayout, Left> {
        let mut groups: Vec<Vec<wgpu::BindGroupLayoutEntry>> = Vec::new();
        for used in &program.bindings {
            let planned = used.layout.as_ref().and_then(binding_type);
            let planned =
                planned.ok_or_else(|| Left::Out(format!("`{}` has no layout", used.name)))?;
            let is_float = |t: &mut wgpu::BindingType| match t {
                wgpu::BindingType::Texture { sample_type, .. } => {
                    *sample_type = wgpu::TextureSampleType::Float { filterable: false };
                }
                wgpu::BindingType::Sampler(of) => *of = wgpu::SamplerBindingType::NonFiltering,
                _ => {}
            };
            let mut ty = planned;
            if unfiltered.contains(&(used.group, used.binding)) {
                is_float(&mut ty);
            }
            let group = used.group as usize;
            groups.resize_with(groups.len().max(group + 1), Vec::new);
            groups[group].push(wgpu::BindGroupLayoutEntry {
                binding: used.binding,
                visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
                ty,
                count: None,
            });
        }
        let made = self.gpu.checked(label, || {
            let device = &self.gpu.device;
            let layouts: Vec<_> = groups
                .iter()
                .map(|entries| {
                    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                        label: None,
                        entries,
                    })
                })
                .collect();
            let layouts: Vec<_> = layouts.iter().map(Some).collect();
            device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(label),
                bind_group_layouts: &layouts,
                immediate_size: 0,
            })
        });
        made.map_err(|e| Left::Out(e.to_string()))
    }

    /// The bind groups of a draw, by group index.
    fn groups_of(
        &mut self,
        draw: &PassDraw,
        program: &Program,
        pipeline: &wgpu::RenderPipeline,
        place: &str,
    ) -> Result<BTreeMap<u32, wgpu::BindGroup>, Left> {
        enum Held {
            Buffer(wgpu::Buffer),
            View(wgpu::TextureView),
            Sampler(wgpu::Sampler),
        }
        let named = draw.named.unwrap_or(usize::MAX);
        let named = get(&self.capture.file.named, named, "named resources", place)?;
        let mut groups: BTreeMap<u32, Vec<(u32, Held)>> = BTreeMap::new();
        for used in &program.bindings {
            let held = match webgl::given(&program.material, used, named)? {
                BoundResource::Loose(data) => {
                    Held::Buffer(self.held(&data, wgpu::BufferUsages::UNIFORM)?)
                }
                BoundResource::Block(range) => {
                    let bytes = self.contents.buffer(self.capture, range.buffer)?;
                    let data = Data::new(cut(&bytes, range.offset, range.size).to_vec());
                    let data = crate::capture::texels::padded(data);
                    Held::Buffer(self.held(&data, wgpu::BufferUsages::UNIFORM)?)
                }
                BoundResource::Texture(found) => Held::View(self.sampled_view(found, place)?),
                BoundResource::Sampler(found) => {
                    let of = webgl::sampler_of(self.capture, found, place)?;
                    Held::Sampler(self.sampler_like(&of, place)?)
                }
            };
            groups
                .entry(used.group)
                .or_default()
                .push((used.binding, held));
        }
        let mut made = BTreeMap::new();
        for (group, held) in groups {
            let entries: Vec<wgpu::BindGroupEntry<'_>> = held
                .iter()
                .map(|(binding, held)| wgpu::BindGroupEntry {
                    binding: *binding,
                    resource: match held {
                        Held::Buffer(buffer) => buffer.as_entire_binding(),
                        Held::View(view) => wgpu::BindingResource::TextureView(view),
                        Held::Sampler(sampler) => wgpu::BindingResource::Sampler(sampler),
                    },
                })
                .collect();
            let bound = self.gpu.checked(place, || {
                let device = &self.gpu.device;
                device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: None,
                    layout: &pipeline.get_bind_group_layout(group),
                    entries: &entries,
                })
            });
            made.insert(group, bound.map_err(|e| Left::Out(e.to_string()))?);
        }
        Ok(made)
    }

    /// The view of a sampled texture. For a depth format, its depth aspect.
    fn sampled_view(
        &mut self,
        found: &preshade_frames::file::SampledTexture,
        place: &str,
    ) -> Result<wgpu::TextureView, Error> {
        let mut view = found.texture.clone();
        let format = self.texture(view.texture, place)?.format();
        if format.has_depth_aspect() && view.view.aspect.is_none() {
            view.view.aspect = Some(wgpu::TextureAspect::DepthOnly);
        }
        self.view(&view, place)
    }

    fn held(&mut self, data: &Data, usage: wgpu::BufferUsages) -> Result<wgpu::Buffer, Error> {
        let key = (data.id, usage.bits());
        if let Some(known) = self.programs.buffers.get(&key) {
            return Ok(known.clone());
        }
        let made = self.gpu.checked("a buffer of a draw", || {
            let mut contents = data.bytes.to_vec();
            contents.resize(contents.len().next_multiple_of(4).max(4), 0);
            let device = &self.gpu.device;
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: None,
                contents: &contents,
                usage,
            })
        })?;
        self.programs.buffers.insert(key, made.clone());
        Ok(made)
    }
}
