// The runtime of a generated material: plain data in wgpu's types, and functions that create wgpu
// objects from it. Nothing here depends on preshade.

/// One GPU pass of a material.
#[derive(Clone, Debug)]
pub struct Pass {
    /// Role: `main`, `prepass`, `shadow`, `ids`, `classify`, `resolve` or `clear`.
    pub role: &'static str,
    /// When it runs in the frame: a phase starts after the earlier phases of all materials have
    /// ended.
    pub phase: Phase,
    /// WGSL of the pass.
    pub wgsl: &'static str,
    /// Vertex entry point.
    pub vertex: &'static str,
    /// Fragment entry point; `None` draws depth alone.
    pub fragment: Option<&'static str>,
    /// Primitive state.
    pub primitive: wgpu::PrimitiveState,
    /// Depth and stencil.
    pub depth: Option<DepthUse>,
    /// Multisampling.
    pub multisample: wgpu::MultisampleState,
    /// Colour targets, by location.
    pub targets: &'static [Option<wgpu::ColorTargetState>],
    /// Load and store operations of each target.
    pub colors: &'static [Option<Color>],
    /// Bindings of each bind group. The author's resources have the same layout in all passes of
    /// the material, so that one bind group serves them all.
    pub groups: &'static [&'static [Binding]],
    /// Vertex attributes that it reads.
    pub attributes: &'static [Attribute],
    /// Features that the device must have.
    pub features: wgpu::Features,
    /// Raises limits to what the pass needs.
    pub raise_limits: fn(&mut wgpu::Limits),
    /// The draws that it includes.
    pub draws: Draws,
    /// Geometry of the draws, as in the plan: `as-given`, or another kind that the plan's JSON
    /// describes.
    pub geometry: &'static str,
    /// Uniforms that must describe another view than the camera's. A shadow pass uses the light's.
    pub view_dependent: &'static [&'static str],
    /// Bytes of immediate data that the host sets before it draws.
    pub immediate_size: u32,
    /// Pipeline-overridable constants of the pass: given by [`PipelineOptions::constants`].
    pub overrides: &'static [Override],
    /// Keys of the material's constants that this pass does not read.
    pub unread_overrides: &'static [&'static str],
    /// The guard of its variant. Pipelines are only created for the constants that it allows.
    pub guard: &'static [Assumed],
    /// [`PipelineOptions::samples`] may differ from [`Pass::multisample`].
    pub samples_are_free: bool,
}

/// A pipeline-overridable constant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Override {
    /// Its `@id`, or its name if it has none.
    pub key: &'static str,
    /// It has no default, so the host must set it.
    pub is_needed: bool,
}

/// Properties of a pipeline that a host only knows at run time. The defaults are the build
/// script's.
#[derive(Clone, Copy, Debug, Default)]
pub struct PipelineOptions<'a> {
    /// Formats of the scene's colours, by location: the surface's, for example. Each must have the
    /// same sample type as the build's, which is the default.
    pub formats: &'a [Option<wgpu::TextureFormat>],
    /// Samples a pixel of the scene's attachments. Create those of `ATTACHMENTS` with
    /// [`Attachment::texture_with`]. Shadow maps keep their own count.
    pub samples: Option<u32>,
    /// Index format of strips. Default: 32 bits.
    pub strip_index_format: Option<wgpu::IndexFormat>,
    /// Values of the material's pipeline-overridable constants, by `@id`, or by name without one.
    /// Give the same values to all its passes, the original's included. A pass ignores constants
    /// that it does not read. A variant that was made for other values returns [`Unfit::Guard`];
    /// its `CONSTANTS` list the values that it was made for.
    pub constants: &'a [(&'a str, f64)],
}

/// When a pass runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// Shadow maps: the light's view, outside the camera's frame.
    Shadow,
    /// Auxiliary pictures of the camera's view, outside the frame.
    Outputs,
    /// Depth and ids of opaque draws.
    Depth,
    /// Pixels are classified by material.
    Classify,
    /// Pixels are shaded from ids.
    Resolve,
    /// Opaque draws are shaded.
    Opaque,
    /// Blended draws, last, in the host's order.
    Blended,
}

/// The draws of a pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Draws {
    /// All of the material.
    All,
    /// The opaque ones.
    Opaque,
    /// None: the pass runs once a frame.
    Once,
}

/// The depth state of a pass.
#[derive(Clone, Debug)]
pub struct DepthUse {
    /// Name of the attachment, one of `ATTACHMENTS`.
    pub attachment: &'static str,
    /// For the pipeline.
    pub state: wgpu::DepthStencilState,
    /// Reference value of the stencil test.
    pub stencil_reference: u32,
    /// It is bound read-only, and may be sampled in the same pass.
    pub read_only: bool,
    /// Clear value of the depth aspect.
    pub clear: f32,
    /// Load and store operations.
    pub ops: Ops,
    /// Load and store operations of the stencil aspect, if the format has one.
    pub stencil_ops: Option<Ops>,
}

/// A pass's use of a colour attachment.
#[derive(Clone, Copy, Debug)]
pub struct Color {
    /// The material's own attachment. `None`: the scene's colour of this location.
    pub attachment: Option<&'static str>,
    /// Load and store operations.
    pub ops: Ops,
}

/// Load and store operations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ops {
    /// The frame's first render pass with the attachment clears it. `false`: every pass loads it.
    pub clear_first: bool,
    /// The store operation.
    pub store: wgpu::StoreOp,
}

/// A binding of a pass.
#[derive(Clone, Copy, Debug)]
pub struct Binding {
    /// Variable's name in the shader.
    pub name: &'static str,
    /// Where the resource comes from.
    pub source: ResourceSource,
    /// For the bind group layout.
    pub entry: wgpu::BindGroupLayoutEntry,
}

/// Where a binding's resource comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResourceSource {
    /// The author's resource of that group and binding.
    Author,
    /// An attachment that an earlier pass wrote.
    Attachment(&'static str),
    /// The scene's colour of a location, as a storage texture.
    SceneColor(u32),
    /// A part of the draw's geometry, as the plan's JSON.
    Geometry(&'static str),
    /// What the author's resource of this group and binding held in the previous frame; `None` for
    /// the immediate data.
    Previous(Option<(u32, u32)>),
    /// A uniform buffer with the number of the draw, from 1.
    DrawId,
    /// A uniform buffer with position and range of a point light.
    PointLight,
    /// The resource of this name of another view.
    View(&'static str),
}

/// A texture that passes write or read. It has the size of the scene's colour.
#[derive(Clone, Copy, Debug)]
pub struct Attachment {
    /// The name that passes use. All main passes of a frame share `scene-depth`.
    pub name: &'static str,
    /// Format.
    pub format: wgpu::TextureFormat,
    /// Samples a pixel.
    pub samples: u32,
    /// Required usages.
    pub usage: wgpu::TextureUsages,
}

/// A vertex attribute that a pass reads.
#[derive(Clone, Copy, Debug)]
pub struct Attribute {
    /// `@location`.
    pub location: u32,
    /// The author's name.
    pub name: &'static str,
    /// The format with the same layout as the shader's type.
    pub format: wgpu::VertexFormat,
}

/// One compute pass of a material.
#[derive(Clone, Copy, Debug)]
pub struct Compute {
    /// WGSL.
    pub wgsl: &'static str,
    /// Entry point.
    pub entry_point: &'static str,
    /// Workgroup size.
    pub workgroup: u32,
    /// The domain of its dispatch, as the plan's JSON.
    pub geometry: &'static str,
    /// When it runs, as the plan's JSON.
    pub when: &'static str,
    /// Bindings of each bind group.
    pub groups: &'static [&'static [Binding]],
    /// Features that the device must have.
    pub features: wgpu::Features,
    /// Raises limits to what the pass needs.
    pub raise_limits: fn(&mut wgpu::Limits),
    /// Bytes of immediate data that the host sets before it dispatches.
    pub immediate_size: u32,
    /// Pipeline-overridable constants of the pass: given by [`PipelineOptions::constants`].
    pub overrides: &'static [Override],
    /// Keys of the material's constants that this pass does not read.
    pub unread_overrides: &'static [&'static str],
    /// The guard of its variant. Pipelines are only created for the constants that it allows.
    pub guard: &'static [Assumed],
}

/// One plan of a material.
#[derive(Clone, Copy, Debug)]
pub struct Variant {
    /// The applied steps.
    pub recipe: &'static str,
    /// The values that it is valid for. Empty: all values.
    pub guard: &'static [Assumed],
    /// Its passes, in the order they run.
    pub passes: &'static [&'static Pass],
    /// Its compute passes, in the order they run.
    pub compute: &'static [Compute],
    /// Textures that its passes write or read. The scene's depth comes first.
    pub attachments: &'static [Attachment],
    /// Run it when you load the material. If it fails, draw the original.
    pub self_test: Option<&'static SelfTest>,
}

impl Variant {
    /// Whether the variant is valid for the pipelines' constants and a draw's uniforms. Check
    /// whenever you write one of them. `constants` are [`PipelineOptions::constants`]. `bytes`
    /// returns the content of a binding, by group and binding; the guard fails if it is missing or
    /// too short. Attributes and textures in [`Variant::guard`] are not checked: the host must keep
    /// them constant.
    pub fn guard_holds<'b>(
        &self,
        constants: &[(&str, f64)],
        bytes: impl Fn(u32, u32) -> Option<&'b [u8]>,
    ) -> bool {
        self.guard.iter().all(|a| a.holds(constants, &bytes))
    }
}

/// A number that must lie in a closed range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Assumed {
    /// The author's name: `material.fog_density`, `lights[1].color.x`.
    pub name: &'static str,
    /// Its source.
    pub place: NumberPlace,
    /// Its type.
    pub ty: ScalarType,
    /// Smallest allowed value.
    pub low: f64,
    /// Largest allowed value.
    pub high: f64,
}

/// Where a number comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NumberPlace {
    /// A scalar of a uniform buffer.
    Uniform {
        /// Bind group.
        group: u32,
        /// Binding.
        binding: u32,
        /// Offset in bytes.
        offset: u32,
    },
    /// A component of a vertex attribute that is constant over a draw.
    Attribute {
        /// Location.
        location: u32,
        /// Component, from 0.
        component: u32,
    },
    /// A channel of a texture that is constant over all texels and levels.
    Texture {
        /// Bind group.
        group: u32,
        /// Binding.
        binding: u32,
        /// Channel, from 0.
        channel: u32,
    },
    /// A pipeline-overridable constant. The variant's shaders are compiled for this value. Its
    /// pipelines are created for no other value, and the original's pipelines need it set too.
    Override {
        /// Its `@id`, or its name if it has none.
        key: &'static str,
        /// Its default is such a value, given that the guard's other constants are valid.
        is_default: bool,
    },
}

/// The type of a scalar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScalarType {
    /// `f32`.
    F32,
    /// `i32`.
    I32,
    /// `u32`.
    U32,
}

impl Assumed {
    /// As [`Variant::guard_holds`]. Holds for anything that is not a uniform or a constant.
    pub fn holds<'b>(
        &self,
        constants: &[(&str, f64)],
        bytes: impl Fn(u32, u32) -> Option<&'b [u8]>,
    ) -> bool {
        let NumberPlace::Uniform {
            group,
            binding,
            offset,
        } = self.place
        else {
            return self.holds_for(constants);
        };
        let content = bytes(group, binding).and_then(|b| b.get(offset as usize..));
        let Some(word) = content.and_then(|b| b.first_chunk::<4>()) else {
            return false;
        };
        self.contains(match self.ty {
            ScalarType::F32 => f64::from(f32::from_le_bytes(*word)),
            ScalarType::I32 => f64::from(i32::from_le_bytes(*word)),
            ScalarType::U32 => f64::from(u32::from_le_bytes(*word)),
        })
    }

    /// Whether a constant has a valid value. Holds for anything that is not a constant.
    fn holds_for(&self, constants: &[(&str, f64)]) -> bool {
        let NumberPlace::Override { key, is_default } = self.place else {
            return true;
        };
        // wgpu uses the last value of a key.
        match constants.iter().rev().find(|(k, _)| *k == key) {
            None => is_default,
            Some((_, value)) => self.contains(match self.ty {
                ScalarType::F32 => f64::from(*value as f32),
                ScalarType::I32 | ScalarType::U32 => *value,
            }),
        }
    }

    fn contains(&self, number: f64) -> bool {
        // Comparisons with NaN fail.
        self.low <= number && number <= self.high
    }
}

/// The host's data does not fit a pass.
#[derive(Clone, Debug, PartialEq)]
pub enum Unfit {
    /// The material cannot be drawn with these vertex buffers, formats, samples or constants. Has
    /// the reason.
    Host(String),
    /// The variant was made for another value of this constant. Draw `original`, or set the
    /// variant's `CONSTANTS` in all pipelines of the material.
    Guard(Assumed),
}

impl std::fmt::Display for Unfit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Host(why) => f.write_str(why),
            Self::Guard(Assumed {
                name, low, high, ..
            }) if low == high => write!(
                f,
                "the variant was made for `{name}` = {low}: give that to it and to the original in \
                 `PipelineOptions::constants`, or draw the original"
            ),
            Self::Guard(Assumed {
                name, low, high, ..
            }) => write!(
                f,
                "the variant was made for `{name}` between {low} and {high}: give such a value to \
                 it and to the original in `PipelineOptions::constants`, or draw the original"
            ),
        }
    }
}

impl std::error::Error for Unfit {}

/// The host's vertex buffers, with only the attributes that a pass reads. Slots are unchanged.
#[derive(Clone, Debug)]
pub struct VertexBuffers(
    Vec<(
        wgpu::BufferAddress,
        wgpu::VertexStepMode,
        Vec<wgpu::VertexAttribute>,
    )>,
);

impl VertexBuffers {
    /// For the pipeline.
    pub fn layouts(&self) -> Vec<Option<wgpu::VertexBufferLayout<'_>>> {
        self.0
            .iter()
            .map(|(array_stride, step_mode, attributes)| {
                (!attributes.is_empty()).then_some(wgpu::VertexBufferLayout {
                    array_stride: *array_stride,
                    step_mode: *step_mode,
                    attributes,
                })
            })
            .collect()
    }
}

fn group_layouts(device: &wgpu::Device, groups: &[&[Binding]]) -> Vec<wgpu::BindGroupLayout> {
    let layout = |bindings: &&[Binding]| {
        let entries: Vec<wgpu::BindGroupLayoutEntry> = bindings.iter().map(|b| b.entry).collect();
        device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &entries,
        })
    };
    groups.iter().map(layout).collect()
}

fn pipeline_layout(
    device: &wgpu::Device,
    groups: &[&[Binding]],
    immediate_size: u32,
) -> wgpu::PipelineLayout {
    let layouts = group_layouts(device, groups);
    let layouts: Vec<Option<&wgpu::BindGroupLayout>> = layouts.iter().map(Some).collect();
    device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &layouts,
        immediate_size,
    })
}

fn module(device: &wgpu::Device, label: &str, wgsl: &'static str) -> wgpu::ShaderModule {
    device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(wgsl.into()),
    })
}

/// The host's constants that a pass reads, if all constants satisfy its variant's guard.
pub(super) fn constants_with<'a>(
    overrides: &[Override],
    unread: &[&str],
    guard: &[Assumed],
    constants: &'a [(&'a str, f64)],
) -> Result<Vec<(&'a str, f64)>, Unfit> {
    if let Some(assumed) = guard.iter().find(|a| !a.holds_for(constants)) {
        return Err(Unfit::Guard(*assumed));
    }
    let mut own = Vec::new();
    for (key, value) in constants {
        if overrides.iter().any(|o| o.key == *key) {
            own.push((*key, *value));
        } else if !unread.contains(key) {
            return Err(Unfit::Host(format!("the material has no override `{key}`")));
        }
    }
    let is_given = |o: &&Override| own.iter().any(|(key, _)| *key == o.key);
    let mut missing = overrides.iter().filter(|o| o.is_needed);
    match missing.find(|o| !is_given(o)) {
        Some(o) => Err(Unfit::Host(format!(
            "the override `{}` has no default: give it in `PipelineOptions::constants`",
            o.key
        ))),
        None => Ok(own),
    }
}

impl Pass {
    /// Layouts of its bind groups.
    pub fn bind_group_layouts(&self, device: &wgpu::Device) -> Vec<wgpu::BindGroupLayout> {
        group_layouts(device, self.groups)
    }

    /// The host's vertex buffers as this pass reads them. `buffers` are the buffers of the author's
    /// shader, by slot.
    ///
    /// # Errors
    /// An attribute is missing, or has a format of another sample type.
    pub fn vertex_buffers(
        &self,
        buffers: &[wgpu::VertexBufferLayout<'_>],
    ) -> Result<VertexBuffers, Unfit> {
        for wanted in self.attributes {
            let all = buffers.iter().flat_map(|b| b.attributes);
            let Some(has) = all.clone().find(|a| a.shader_location == wanted.location) else {
                return Err(Unfit::Host(format!(
                    "no vertex buffer has `{}` at location {}",
                    wanted.name, wanted.location
                )));
            };
            let kind = |format: wgpu::VertexFormat| {
                let name = format!("{format:?}");
                (name.starts_with("Sint"), name.starts_with("Uint"))
            };
            if kind(has.format) != kind(wanted.format) {
                return Err(Unfit::Host(format!(
                    "`{}` is read as {:?}, which {:?} does not feed",
                    wanted.name, wanted.format, has.format
                )));
            }
        }
        let read = |a: &&wgpu::VertexAttribute| {
            self.attributes
                .iter()
                .any(|w| w.location == a.shader_location)
        };
        let buffer = |b: &wgpu::VertexBufferLayout<'_>| {
            (
                b.array_stride,
                b.step_mode,
                b.attributes.iter().filter(read).copied().collect(),
            )
        };
        Ok(VertexBuffers(buffers.iter().map(buffer).collect()))
    }

    /// The complete pipeline.
    ///
    /// # Errors
    /// As [`Pass::vertex_buffers`].
    pub fn pipeline(
        &self,
        device: &wgpu::Device,
        buffers: &[wgpu::VertexBufferLayout<'_>],
    ) -> Result<wgpu::RenderPipeline, Unfit> {
        self.pipeline_with(device, buffers, &PipelineOptions::default())
    }

    /// As [`Pass::pipeline`], with properties that are known at run time, such as the surface's
    /// format.
    ///
    /// # Errors
    /// As [`Pass::vertex_buffers`]; a format of another sample type, an unsupported sample count,
    /// an unknown constant, or one without a value. [`Unfit::Guard`] if the variant was made for
    /// another value.
    pub fn pipeline_with(
        &self,
        device: &wgpu::Device,
        buffers: &[wgpu::VertexBufferLayout<'_>],
        options: &PipelineOptions<'_>,
    ) -> Result<wgpu::RenderPipeline, Unfit> {
        let depth = self.depth.as_ref().map(|d| d.state.clone());
        self.pipeline_of(device, buffers, depth, options)
    }

    /// The colour targets, with the host's formats.
    fn targets_with(
        &self,
        options: &PipelineOptions<'_>,
    ) -> Result<Vec<Option<wgpu::ColorTargetState>>, Unfit> {
        let kind = |format: wgpu::TextureFormat| {
            let sampled = format.sample_type(None, None);
            match sampled {
                Some(wgpu::TextureSampleType::Uint) => Some("unsigned integers"),
                Some(wgpu::TextureSampleType::Sint) => Some("signed integers"),
                Some(wgpu::TextureSampleType::Float { .. }) => Some("floats"),
                _ => None,
            }
        };
        let mut targets = self.targets.to_vec();
        for (at, target) in targets.iter_mut().enumerate() {
            let of_scene = self.colors.get(at).and_then(|c| c.as_ref());
            let of_scene = of_scene.is_some_and(|c| c.attachment.is_none());
            let given = options.formats.get(at).copied().flatten();
            let (Some(target), Some(format), true) = (target, given, of_scene) else {
                continue;
            };
            if kind(format).is_none() || kind(format) != kind(target.format) {
                return Err(Unfit::Host(format!(
                    "the pass `{}` was made for {:?} at location {at}, which {format:?} cannot \
                     take the place of",
                    self.role, target.format
                )));
            }
            target.format = format;
        }
        Ok(targets)
    }

    /// The multisample state, with the host's sample count.
    fn samples_with(&self, options: &PipelineOptions<'_>) -> Result<u32, Unfit> {
        let built = self.multisample.count;
        match options.samples {
            Some(samples)
                if samples == built || matches!(self.phase, Phase::Shadow | Phase::Outputs) =>
            {
                Ok(built)
            }
            Some(samples) if self.samples_are_free => Ok(samples),
            Some(samples) => Err(Unfit::Host(format!(
                "the pass `{}` is of a variant that was made for {built} samples a pixel, not for \
                 {samples}",
                self.role
            ))),
            None => Ok(built),
        }
    }

    fn pipeline_of(
        &self,
        device: &wgpu::Device,
        buffers: &[wgpu::VertexBufferLayout<'_>],
        depth_stencil: Option<wgpu::DepthStencilState>,
        options: &PipelineOptions<'_>,
    ) -> Result<wgpu::RenderPipeline, Unfit> {
        let buffers = self.vertex_buffers(buffers)?;
        let targets = self.targets_with(options)?;
        let multisample = wgpu::MultisampleState {
            count: self.samples_with(options)?,
            ..self.multisample
        };
        let constants = constants_with(
            self.overrides,
            self.unread_overrides,
            self.guard,
            options.constants,
        )?;
        let compilation = || wgpu::PipelineCompilationOptions {
            constants: &constants,
            ..wgpu::PipelineCompilationOptions::default()
        };
        let mut primitive = self.primitive;
        if primitive.strip_index_format.is_some() && options.strip_index_format.is_some() {
            primitive.strip_index_format = options.strip_index_format;
        }
        let module = module(device, self.role, self.wgsl);
        Ok(
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(self.role),
                layout: Some(&pipeline_layout(device, self.groups, self.immediate_size)),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(self.vertex),
                    compilation_options: compilation(),
                    buffers: &buffers.layouts(),
                },
                primitive,
                depth_stencil,
                multisample,
                fragment: self.fragment.map(|entry| wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(entry),
                    compilation_options: compilation(),
                    targets: &targets,
                }),
                multiview_mask: None,
                cache: None,
            }),
        )
    }
}

impl Compute {
    /// Layouts of its bind groups.
    pub fn bind_group_layouts(&self, device: &wgpu::Device) -> Vec<wgpu::BindGroupLayout> {
        group_layouts(device, self.groups)
    }

    /// The pipeline.
    ///
    /// # Errors
    /// A constant without a value, or [`Unfit::Guard`] if the variant was made for another value.
    pub fn pipeline(&self, device: &wgpu::Device) -> Result<wgpu::ComputePipeline, Unfit> {
        self.pipeline_with(device, &PipelineOptions::default())
    }

    /// As [`Compute::pipeline`], with constants.
    ///
    /// # Errors
    /// As [`Compute::pipeline`], and for an unknown constant.
    pub fn pipeline_with(
        &self,
        device: &wgpu::Device,
        options: &PipelineOptions<'_>,
    ) -> Result<wgpu::ComputePipeline, Unfit> {
        let constants = constants_with(
            self.overrides,
            self.unread_overrides,
            self.guard,
            options.constants,
        )?;
        Ok(
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(self.entry_point),
                layout: Some(&pipeline_layout(device, self.groups, self.immediate_size)),
                module: &module(device, self.entry_point, self.wgsl),
                entry_point: Some(self.entry_point),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &constants,
                    ..wgpu::PipelineCompilationOptions::default()
                },
                cache: None,
            }),
        )
    }
}

impl Ops {
    fn of<V>(self, first: bool, clear: V) -> wgpu::Operations<V> {
        let load = match self.clear_first && first {
            true => wgpu::LoadOp::Clear(clear),
            false => wgpu::LoadOp::Load,
        };
        wgpu::Operations {
            load,
            store: self.store,
        }
    }
}

impl DepthUse {
    /// For the render pass. `first`: no earlier render pass of the frame has this attachment.
    pub fn attach<'v>(
        &self,
        view: &'v wgpu::TextureView,
        first: bool,
    ) -> wgpu::RenderPassDepthStencilAttachment<'v> {
        wgpu::RenderPassDepthStencilAttachment {
            view,
            depth_ops: (!self.read_only).then(|| self.ops.of(first, self.clear)),
            stencil_ops: match self.read_only {
                true => None,
                false => self.stencil_ops.map(|ops| ops.of(first, 0)),
            },
        }
    }
}

impl Color {
    /// For the render pass. `first`: no earlier render pass of the frame has this attachment.
    pub fn attach<'v>(
        &self,
        view: &'v wgpu::TextureView,
        first: bool,
        clear: wgpu::Color,
    ) -> wgpu::RenderPassColorAttachment<'v> {
        wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: self.ops.of(first, clear),
        }
    }
}

impl Attachment {
    /// The texture.
    pub fn texture(&self, device: &wgpu::Device, size: wgpu::Extent3d) -> wgpu::Texture {
        self.texture_with(device, size, self.samples)
    }

    /// The texture with another sample count, for pipelines with [`PipelineOptions::samples`].
    pub fn texture_with(
        &self,
        device: &wgpu::Device,
        size: wgpu::Extent3d,
        samples: u32,
    ) -> wgpu::Texture {
        device.create_texture(&wgpu::TextureDescriptor {
            label: Some(self.name),
            size,
            mip_level_count: 1,
            sample_count: samples,
            dimension: wgpu::TextureDimension::D2,
            format: self.format,
            usage: self.usage,
            view_formats: &[],
        })
    }
}

#[path = "host/self_test.rs"]
mod preshade_self_test;
pub use preshade_self_test::*;
