//! The GPU resources of a scene's draws. The author's program binds them, and every pass of every
//! variant shares them.

use std::collections::BTreeMap;
use std::num::NonZeroU64;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use preshade_plan::guard::Assumed;
use preshade_plan::plan::{BindingKind, GpuPass, Plan};
use wgpu::util::{BufferInitDescriptor, DeviceExt};

use super::compiled::Compiled;
use super::gpu::Gpu;
use super::initial::Initial;
use super::textures::Textures;
use super::{Error, state};
use crate::scene::bind::{self, Rate};
use crate::scene::{Address, Filter, Frame, Scene, SceneError};

/// The resources of all draws of a scene.
#[derive(Debug)]
pub struct SceneInputs<'a> {
    gpu: &'a Gpu,
    scene: &'a Scene,
    /// Each material's original pass. It binds everything that a variant may bind.
    authored: Vec<GpuPass>,
    draws: Vec<DrawInputs>,
    /// The resources of the same draws in the previous frame.
    previous: Option<&'a SceneInputs<'a>>,
    compiled: Option<Compiled>,
    initial: Initial,
    /// Incremented by each call of [`SceneInputs::set_frame`].
    pub(super) serial: AtomicU64,
}

/// The resources of one draw.
#[derive(Debug)]
pub(super) struct DrawInputs {
    /// By group and binding.
    pub resources: BTreeMap<(u32, u32), Resource>,
    /// Immediate data in the current frame. Empty if there is none.
    pub immediates: Mutex<Arc<[u8]>>,
    pub vertex_buffers: Vec<VertexInput>,
    pub indices: Option<IndexInput>,
    pub vertex_count: u32,
    pub call: bind::Call,
    pub instances: u32,
    /// Viewport and scissor of the draw, if it has its own.
    pub area: Option<bind::Area>,
}

impl DrawInputs {
    /// The first `size` bytes of the immediate data, or all if there are fewer.
    pub fn immediates(&self, size: u32) -> Vec<u8> {
        let own = self.immediates.lock();
        let own = own.unwrap_or_else(PoisonError::into_inner);
        own.iter().copied().take(size as usize).collect()
    }
}

/// The bytes of immediate data that a pass reads, from its limits.
pub(super) fn immediate_size(limits: &BTreeMap<String, u64>) -> u32 {
    let size = limits.get("maxImmediateSize").copied().unwrap_or(0);
    u32::try_from(size).unwrap_or(u32::MAX)
}

/// A resource and its binding type.
#[derive(Debug)]
pub(super) enum Resource {
    Buffer(wgpu::Buffer, wgpu::BufferBindingType),
    Texture(wgpu::TextureView, wgpu::BindingType),
    Sampler(wgpu::Sampler, wgpu::BindingType),
}

#[derive(Debug)]
pub(super) struct VertexInput {
    pub buffer: wgpu::Buffer,
    pub stride: u64,
    pub step: wgpu::VertexStepMode,
    pub attributes: Vec<bind::VertexAttribute>,
}

#[derive(Debug)]
pub(super) struct IndexInput {
    pub buffer: wgpu::Buffer,
    pub format: wgpu::IndexFormat,
    /// Content of the buffer, for meshes derived from it.
    pub bytes: Arc<[u8]>,
}

impl Resource {
    /// The binding type. The `min_binding_size` of a buffer is its actual size.
    pub fn provided(&self) -> wgpu::BindingType {
        match self {
            Self::Buffer(buffer, ty) => wgpu::BindingType::Buffer {
                ty: *ty,
                has_dynamic_offset: false,
                min_binding_size: NonZeroU64::new(buffer.size()),
            },
            Self::Texture(_, ty) | Self::Sampler(_, ty) => *ty,
        }
    }

    pub fn binding(&self) -> wgpu::BindingResource<'_> {
        match self {
            Self::Buffer(buffer, _) => buffer.as_entire_binding(),
            Self::Texture(view, _) => wgpu::BindingResource::TextureView(view),
            Self::Sampler(sampler, _) => wgpu::BindingResource::Sampler(sampler),
        }
    }
}

/// Uploads so far, by content.
#[derive(Default)]
struct Uploads {
    buffers: BTreeMap<(u128, u32), wgpu::Buffer>,
    textures: Textures,
}

impl<'a> SceneInputs<'a> {
    /// The author's original pass of a material.
    pub(super) fn authored(&self, material: usize) -> Option<&GpuPass> {
        self.authored.get(material)
    }

    /// Binds and uploads everything that the draws of `scene` need, for the first frame of its
    /// first camera.
    ///
    /// # Errors
    /// [`Error::Scene`] if a value does not fit a material, or an error of the adapter.
    pub fn new(gpu: &'a Gpu, scene: &'a Scene) -> Result<Self, Error> {
        let mut uploads = Uploads::default();
        let authored: Vec<GpuPass> = scene
            .materials
            .iter()
            .filter_map(|m| {
                Plan::original(
                    &m.name,
                    m.program.clone(),
                    &m.vertex,
                    m.fragment.as_deref(),
                    &m.state,
                )
                .passes
                .pop()
            })
            .collect();
        let first = scene.cameras.first().and_then(|c| c.frames.first());
        let frame = first.ok_or_else(|| Error::Scene {
            draw: scene.name.clone(),
            message: "the scene has no camera".to_owned(),
        })?;
        let draws = scene
            .draws
            .iter()
            .map(|draw| {
                let failed = |message: String| Error::Scene {
                    draw: draw.name.clone(),
                    message,
                };
                let material = scene
                    .materials
                    .get(draw.material)
                    .ok_or_else(|| failed(format!("there is no material {}", draw.material)))?;
                let pass = &authored[draw.material];
                let bound = bind::draw(scene, material, pass, draw, frame)
                    .map_err(|e| failed(e.to_string()))?;
                gpu.checked(&format!("what draw `{}` binds", draw.name), || {
                    uploads.draw(gpu, &bound, &draw.name)
                })?
            })
            .collect::<Result<_, Error>>()?;
        Ok(Self {
            gpu,
            scene,
            authored,
            draws,
            previous: None,
            compiled: None,
            initial: Initial::new(gpu, scene)?,
            serial: AtomicU64::new(0),
        })
    }

    /// Adds the resources of the previous frame of the same draws, for passes that read them.
    /// Without them, the previous frame counts as equal to the current one.
    #[must_use]
    pub fn after(self, previous: &'a SceneInputs<'a>) -> Self {
        Self {
            previous: Some(previous),
            ..self
        }
    }

    /// Lets frames share shaders and pipelines. [`super::Prepared::creation`] then differs from the
    /// time that a host takes.
    #[must_use]
    pub fn sharing(self) -> Self {
        Self {
            compiled: Some(Compiled::default()),
            ..self
        }
    }

    /// Initial contents of the attachments.
    pub(super) fn initial(&self) -> &Initial {
        &self.initial
    }

    /// Objects that frames share, if they do.
    pub(super) fn compiled(&self) -> Option<&Compiled> {
        self.compiled.as_ref()
    }

    /// Updates the values that depend on the camera and the time.
    ///
    /// # Errors
    /// As [`SceneInputs::new`].
    pub fn set_frame(&self, frame: &Frame) -> Result<(), Error> {
        self.serial.fetch_add(1, Ordering::Relaxed);
        let mut writes = Vec::new();
        for (draw, inputs) in self.scene.draws.iter().zip(&self.draws) {
            let material = &self.scene.materials[draw.material];
            let pass = &self.authored[draw.material];
            let failed = |e: SceneError| Error::Scene {
                draw: draw.name.clone(),
                message: e.to_string(),
            };
            let changed = bind::frame_buffers(self.scene, material, pass, draw, frame);
            let changed = changed.map_err(failed)?;
            if let Some(data) =
                bind::immediates(self.scene, material, draw, frame).map_err(failed)?
            {
                let own = inputs.immediates.lock();
                *own.unwrap_or_else(PoisonError::into_inner) = data.bytes;
            }
            for b in changed {
                if let Some(Resource::Buffer(buffer, _)) =
                    inputs.resources.get(&(b.group, b.binding))
                {
                    writes.push((buffer, b.data.bytes));
                }
            }
        }
        self.gpu.checked("writing the uniforms of a frame", || {
            for (buffer, bytes) in &writes {
                self.gpu.queue.write_buffer(buffer, 0, bytes);
            }
        })
    }

    /// The plans whose guard a draw violates in `frame`, by index, each with the first violating
    /// value. A host draws the originals of these materials.
    ///
    /// # Errors
    /// As [`SceneInputs::new`].
    pub fn violated(&self, plans: &[Plan], frame: &Frame) -> Result<Vec<(usize, Assumed)>, Error> {
        let mut found = Vec::new();
        for (index, plan) in plans.iter().enumerate() {
            let Some(guard) = &plan.guard else { continue };
            for draw in &self.scene.draws {
                let Some(material) = self.scene.materials.get(draw.material) else {
                    continue;
                };
                if material.name != plan.material {
                    continue;
                }
                let pass = &self.authored[draw.material];
                let bound = bind::uniform_buffers(self.scene, material, pass, draw, frame);
                let bound = bound.map_err(|e| Error::Scene {
                    draw: draw.name.clone(),
                    message: e.to_string(),
                })?;
                let bytes = |group, binding| {
                    let at = |b: &&bind::BufferBinding| (b.group, b.binding) == (group, binding);
                    bound.iter().find(at).map(|b| &*b.data.bytes)
                };
                if let Some(assumed) = guard.violated(bytes) {
                    found.push((index, assumed.clone()));
                    break;
                }
            }
        }
        Ok(found)
    }

    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    pub fn gpu(&self) -> &'a Gpu {
        self.gpu
    }

    /// Number of triangles of a triangle-list draw, over all instances.
    pub fn triangles(&self, draw: usize) -> u64 {
        self.draw(draw)
            .map_or(0, |d| u64::from(d.call.count / 3) * u64::from(d.instances))
    }

    pub(super) fn draw(&self, index: usize) -> Option<&DrawInputs> {
        self.draws.get(index)
    }

    /// The draw in the previous frame.
    pub(super) fn previous(&self, index: usize) -> Option<&DrawInputs> {
        self.previous
            .map_or_else(|| self.draw(index), |p| p.draw(index))
    }
}

impl Uploads {
    fn draw(
        &mut self,
        gpu: &Gpu,
        bound: &bind::DrawBindings,
        name: &str,
    ) -> Result<DrawInputs, Error> {
        let mut resources = BTreeMap::new();
        for b in &bound.buffers {
            let (usage, ty) = match b.kind {
                BindingKind::Uniform => (
                    wgpu::BufferUsages::UNIFORM,
                    wgpu::BufferBindingType::Uniform,
                ),
                kind => (
                    wgpu::BufferUsages::STORAGE,
                    wgpu::BufferBindingType::Storage {
                        read_only: kind == BindingKind::StorageRead,
                    },
                ),
            };
            // Buffers that the host or a shader writes cannot be shared.
            let shared = b.rate == Rate::Draw && b.kind != BindingKind::StorageReadWrite;
            let buffer = if shared {
                self.buffer(gpu, &b.data, usage)
            } else {
                create(gpu, &b.data, usage | wgpu::BufferUsages::COPY_DST)
            };
            resources.insert((b.group, b.binding), Resource::Buffer(buffer, ty));
        }
        for t in &bound.textures {
            let (view, layout) = self.textures.view(gpu, t, name)?;
            resources.insert((t.group, t.binding), Resource::Texture(view, layout));
        }
        // A shader may sample depths and wide floats only with a non-filtering sampler.
        let is_unfiltered = resources.values().any(is_unfiltered);
        for s in &bound.samplers {
            let of = sampler(&s.sampler, anisotropy_limit(gpu));
            let layout = wgpu::BindingType::Sampler(match s.sampler.compare {
                Some(_) => wgpu::SamplerBindingType::Comparison,
                None if is_unfiltered && filters_nothing(&of) => {
                    wgpu::SamplerBindingType::NonFiltering
                }
                None => wgpu::SamplerBindingType::Filtering,
            });
            let sampler = gpu.device.create_sampler(&of);
            resources.insert((s.group, s.binding), Resource::Sampler(sampler, layout));
        }
        let vertex_buffers = bound
            .vertex_buffers
            .iter()
            .map(|v| VertexInput {
                // A subdividing pass reads it as storage.
                buffer: self.buffer(
                    gpu,
                    &v.data,
                    wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::STORAGE,
                ),
                stride: v.stride,
                step: v.step,
                attributes: v.attributes.clone(),
            })
            .collect();
        let indices = bound.indices.as_ref().map(|i| IndexInput {
            buffer: self.buffer(
                gpu,
                &i.data,
                wgpu::BufferUsages::INDEX | wgpu::BufferUsages::STORAGE,
            ),
            format: i.format,
            bytes: Arc::clone(&i.data.bytes),
        });
        Ok(DrawInputs {
            resources,
            immediates: Mutex::new(
                bound
                    .immediates
                    .as_ref()
                    .map_or_else(|| Arc::from([]), |data| Arc::clone(&data.bytes)),
            ),
            vertex_buffers,
            indices,
            vertex_count: bound.vertex_count,
            call: bound.call,
            instances: bound.instances,
            area: bound.area,
        })
    }

    fn buffer(&mut self, gpu: &Gpu, data: &bind::Data, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        self.buffers
            .entry((data.id, usage.bits()))
            .or_insert_with(|| create(gpu, data, usage))
            .clone()
    }
}

fn create(gpu: &Gpu, data: &bind::Data, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    // Empty bindings are not allowed, so a mesh without vertices gets a few bytes.
    let empty = [0_u8; 16];
    gpu.device.create_buffer_init(&BufferInitDescriptor {
        label: None,
        contents: if data.bytes.is_empty() {
            &empty
        } else {
            &data.bytes
        },
        usage,
    })
}

/// Largest anisotropy: 1 on software adapters. llvmpipe in Mesa 22.3 walks the footprint texel by
/// texel, so overflowing gradients keep it busy for minutes.
fn anisotropy_limit(gpu: &Gpu) -> u16 {
    match gpu.adapter().kind.as_str() {
        "software" => 1,
        _ => 16,
    }
}

/// Whether a resource is a texture that no sampler can filter.
fn is_unfiltered(resource: &Resource) -> bool {
    let Resource::Texture(_, wgpu::BindingType::Texture { sample_type, .. }) = resource else {
        return false;
    };
    matches!(
        sample_type,
        wgpu::TextureSampleType::Depth | wgpu::TextureSampleType::Float { filterable: false }
    )
}

fn filters_nothing(sampler: &wgpu::SamplerDescriptor<'_>) -> bool {
    sampler.mag_filter == wgpu::FilterMode::Nearest
        && sampler.min_filter == wgpu::FilterMode::Nearest
        && sampler.mipmap_filter == wgpu::MipmapFilterMode::Nearest
}

fn sampler(s: &crate::scene::Sampler, anisotropy_limit: u16) -> wgpu::SamplerDescriptor<'static> {
    let address = |address| match address {
        Address::Repeat => wgpu::AddressMode::Repeat,
        Address::MirrorRepeat => wgpu::AddressMode::MirrorRepeat,
        Address::ClampToEdge => wgpu::AddressMode::ClampToEdge,
    };
    let filter = |filter| match filter {
        Filter::Nearest => wgpu::FilterMode::Nearest,
        Filter::Linear => wgpu::FilterMode::Linear,
    };
    let (min, mip) = (
        s.min_filter.unwrap_or(s.filter),
        s.mip_filter.unwrap_or(s.filter),
    );
    let [least, most] = s.lod.unwrap_or([0.0, 32.0]);
    wgpu::SamplerDescriptor {
        label: None,
        address_mode_u: address(s.address),
        address_mode_v: address(s.address_v.unwrap_or(s.address)),
        address_mode_w: address(s.address_w.unwrap_or(s.address)),
        mag_filter: filter(s.filter),
        min_filter: filter(min),
        mipmap_filter: match mip {
            Filter::Nearest => wgpu::MipmapFilterMode::Nearest,
            Filter::Linear => wgpu::MipmapFilterMode::Linear,
        },
        lod_min_clamp: least,
        lod_max_clamp: most,
        compare: s.compare.map(state::compare),
        anisotropy_clamp: match [s.filter, min, mip] {
            [Filter::Linear, Filter::Linear, Filter::Linear] => {
                s.anisotropy.clamp(1, anisotropy_limit)
            }
            _ => 1,
        },
        ..Default::default()
    }
}
