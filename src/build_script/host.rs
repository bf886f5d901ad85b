// What a host needs to draw with a generated material: plain data of wgpu's own types, and the calls that make wgpu objects of it. Nothing here knows preshade.

/// One GPU pass of a material.
#[derive(Clone, Debug)]
pub struct Pass {
    /// What it is for: `main`, `prepass`, `shadow`, `ids`, `classify`, `resolve` or `clear`.
    pub role: &'static str,
    /// When in the frame it runs: no pass of a phase starts before those of earlier phases, over all materials, have ended.
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
    pub depth: Option<Depth>,
    /// Multisampling.
    pub multisample: wgpu::MultisampleState,
    /// Colour targets, by location.
    pub targets: &'static [Option<wgpu::ColorTargetState>],
    /// What is done with each of them in a render pass.
    pub colors: &'static [Option<Color>],
    /// Bindings of each bind group. Those of the author's resources are laid out alike in all passes of the material, so that one bind group serves them all.
    pub groups: &'static [&'static [Binding]],
    /// Vertex attributes that it reads.
    pub attributes: &'static [Attribute],
    /// Features that the device must have.
    pub features: wgpu::Features,
    /// Raises limits to what the pass needs.
    pub raise_limits: fn(&mut wgpu::Limits),
    /// Which draws of the material it draws.
    pub draws: Draws,
    /// What is drawn of them, as in the plan: `as-given`, or what the plan's JSON says more of.
    pub geometry: &'static str,
    /// Uniforms that must come from another view than the camera's: the light's, for a shadow pass.
    pub view_dependent: &'static [&'static str],
    /// Bytes of immediate data that the host sets before it draws.
    pub immediate_size: u32,
    /// Pipeline-overridable constants of the pass: given by [`PipelineOptions::constants`].
    pub overrides: &'static [Override],
    /// Keys of those that the material has and this pass does not read.
    pub unread_overrides: &'static [&'static str],
    /// What its variant takes for granted: of constants, pipelines are made for nothing else.
    pub guard: &'static [Assumed],
    /// The samples of a pixel may be others than [`Pass::multisample`] says: [`PipelineOptions::samples`].
    pub samples_are_free: bool,
}

/// A pipeline-overridable constant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Override {
    /// Its `@id`, or else its name.
    pub key: &'static str,
    /// It has no default, and has to be given.
    pub is_needed: bool,
}

/// What a host knows of a pipeline only when it runs. The default is what the build script was told.
#[derive(Clone, Copy, Debug, Default)]
pub struct PipelineOptions<'a> {
    /// Formats of the scene's colours, by location, as the surface has them: each of the same kind of numbers as what the build was told. Where there is none the build's is taken.
    pub formats: &'a [Option<wgpu::TextureFormat>],
    /// Samples of a pixel of the scene's attachments; those of `ATTACHMENTS` are then made by [`Attachment::texture_with`]. Passes of shadow maps keep theirs.
    pub samples: Option<u32>,
    /// Of the index buffer, where strips are drawn; 32 bits by default.
    pub strip_index_format: Option<wgpu::IndexFormat>,
    /// Values of the material's pipeline-overridable constants, by `@id` or else by name. Give the same to each of its passes, those of the original among them: one that does not read it takes
    /// none. A variant that was made for other values is an [`Unfit::Guard`]; its `CONSTANTS` are those that it was made for.
    pub constants: &'a [(&'a str, f64)],
}

/// When a pass runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// Shadow maps: the light's view, outside the camera's frame.
    Shadow,
    /// Depth only, opaque draws; ids with it.
    Depth,
    /// What each pixel shows is told apart, over all materials.
    Classify,
    /// Shaded from ids.
    Resolve,
    /// Shaded, opaque draws.
    Opaque,
    /// Blended draws, last, in the host's order.
    Blended,
}

/// Which draws a pass draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Draws {
    /// All of the material.
    All,
    /// The opaque ones.
    Opaque,
    /// None: once for the frame.
    Once,
}

/// The depth state of a pass.
#[derive(Clone, Debug)]
pub struct Depth {
    /// Name of the attachment, one of `ATTACHMENTS`.
    pub attachment: &'static str,
    /// For the pipeline.
    pub state: wgpu::DepthStencilState,
    /// Reference value of the stencil test.
    pub stencil_reference: u32,
    /// It is bound read-only, and may be sampled in the same pass.
    pub read_only: bool,
    /// What the depth aspect is cleared to.
    pub clear: f32,
    /// What the pass finds and leaves.
    pub ops: Ops,
    /// The same of the stencil aspect, where the format has one.
    pub stencil_ops: Option<Ops>,
}

/// What a pass does with a colour attachment.
#[derive(Clone, Copy, Debug)]
pub struct Color {
    /// Attachment of the material's own that is drawn to; `None`: the scene's colour of this location.
    pub attachment: Option<&'static str>,
    /// What the pass finds and leaves.
    pub ops: Ops,
}

/// Load and store operations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ops {
    /// The first render pass of the frame that has the attachment clears it; otherwise all of them load.
    pub clear_first: bool,
    /// What the pass leaves.
    pub store: wgpu::StoreOp,
}

/// A binding of a pass.
#[derive(Clone, Copy, Debug)]
pub struct Binding {
    /// Variable's name in the shader.
    pub name: &'static str,
    /// Who provides the resource.
    pub source: Source,
    /// For the bind group layout.
    pub entry: wgpu::BindGroupLayoutEntry,
}

/// Where a binding's resource comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The author's own resource of that group and binding.
    Author,
    /// The whole of an attachment that an earlier pass wrote.
    Attachment(&'static str),
    /// The scene's colour of a location, as a storage texture.
    SceneColor(u32),
    /// A part of the draw's geometry, as JSON in the words of the plan.
    Geometry(&'static str),
}

/// A texture that passes write or read, of the size of the scene's colour.
#[derive(Clone, Copy, Debug)]
pub struct Attachment {
    /// The name that passes refer to it by. `scene-depth` is the one that all main passes of a frame share.
    pub name: &'static str,
    /// Format.
    pub format: wgpu::TextureFormat,
    /// Samples a pixel.
    pub samples: u32,
    /// Usages it needs.
    pub usage: wgpu::TextureUsages,
}

/// A vertex attribute that a pass reads.
#[derive(Clone, Copy, Debug)]
pub struct Attribute {
    /// `@location`.
    pub location: u32,
    /// The author's name for it.
    pub name: &'static str,
    /// The format that holds the shader's type as it is.
    pub format: wgpu::VertexFormat,
}

/// Work of a compute pass.
#[derive(Clone, Copy, Debug)]
pub struct Compute {
    /// WGSL.
    pub wgsl: &'static str,
    /// Entry point.
    pub entry_point: &'static str,
    /// Invocations of a workgroup, as the plan counts them.
    pub workgroup: u32,
    /// What it is run over and when, as JSON in the words of the plan.
    pub geometry: &'static str,
    /// When it runs, as JSON in the words of the plan.
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
    /// Keys of those that the material has and this pass does not read.
    pub unread_overrides: &'static [&'static str],
    /// What its variant takes for granted: of constants, pipelines are made for nothing else.
    pub guard: &'static [Assumed],
}

/// One plan of a material, with all that a frame needs of it.
#[derive(Clone, Copy, Debug)]
pub struct Variant {
    /// What was done to the original.
    pub recipe: &'static str,
    /// What it takes for granted of the values that it is drawn with; nothing where that is empty.
    pub guard: &'static [Assumed],
    /// Its passes, in the order they run.
    pub passes: &'static [&'static Pass],
    /// Its compute passes, in the order they run.
    pub compute: &'static [Compute],
    /// Textures that its passes write or read, the scene's depth first.
    pub attachments: &'static [Attachment],
    /// To be run at load; where it fails, draw the original.
    pub self_test: Option<&'static SelfTest>,
}

impl Variant {
    /// Whether the constants of the material's pipelines and the uniforms of a draw are as it takes for granted; asked whenever one is written. `constants` are those of
    /// [`PipelineOptions::constants`]. `bytes` gives the content of a binding, by group and binding; one that is not there, or is too short, is not. Of attributes and textures no buffer tells: of
    /// those in [`Variant::guard`] the host sees to it that they stay.
    pub fn guard_holds<'b>(
        &self,
        constants: &[(&str, f64)],
        bytes: impl Fn(u32, u32) -> Option<&'b [u8]>,
    ) -> bool {
        self.guard.iter().all(|a| a.holds(constants, &bytes))
    }
}

/// A number that a variant takes to lie between two others, both included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Assumed {
    /// The author's name for it: `material.fog_density`, `lights[1].color.x`.
    pub name: &'static str,
    /// Where it comes from.
    pub place: Place,
    /// Its type.
    pub ty: ScalarType,
    /// The least that it may be.
    pub low: f64,
    /// The greatest.
    pub high: f64,
}

/// Where a number comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// A scalar of a uniform buffer, so many bytes into its binding.
    Uniform {
        /// Bind group.
        group: u32,
        /// Binding.
        binding: u32,
        /// Bytes into it.
        offset: u32,
    },
    /// A component of a vertex attribute, the same for every vertex and instance of a draw.
    Attribute {
        /// Location.
        location: u32,
        /// Component, from 0.
        component: u32,
    },
    /// A channel of a texture, the same in every texel of every level.
    Texture {
        /// Bind group.
        group: u32,
        /// Binding.
        binding: u32,
        /// Channel, from 0.
        channel: u32,
    },
    /// A pipeline-overridable constant. What it decides is decided in the variant's texts: no pipeline of theirs is made for another value, and the original's needs this one given.
    Override {
        /// Its `@id`, or else its name.
        key: &'static str,
        /// It has such a value where a host gives it none and the other constants that are taken for granted are as they should be.
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
    /// As [`Variant::guard_holds`]; whatever is no uniform and no constant holds.
    pub fn holds<'b>(
        &self,
        constants: &[(&str, f64)],
        bytes: impl Fn(u32, u32) -> Option<&'b [u8]>,
    ) -> bool {
        let Place::Uniform {
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

    /// Whether a constant is as it should be; whatever is none holds.
    fn holds_for(&self, constants: &[(&str, f64)]) -> bool {
        let Place::Override { key, is_default } = self.place else {
            return true;
        };
        // wgpu takes the last of a key.
        match constants.iter().rev().find(|(k, _)| *k == key) {
            None => is_default,
            Some((_, value)) => self.contains(match self.ty {
                ScalarType::F32 => f64::from(*value as f32),
                ScalarType::I32 | ScalarType::U32 => *value,
            }),
        }
    }

    fn contains(&self, number: f64) -> bool {
        // No comparison holds for NaN.
        self.low <= number && number <= self.high
    }
}

/// What a host has does not fit a pass.
#[derive(Clone, Debug, PartialEq)]
pub enum Unfit {
    /// Vertex buffers, formats, samples or constants are none that the material can be drawn with: why.
    Host(String),
    /// The constant has another value than the variant was made for: draw `original`, or give all pipelines of the material what the variant's `CONSTANTS` say.
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
                "the variant was made for `{name}` = {low}: give that to it and to the original in `PipelineOptions::constants`, or draw the original"
            ),
            Self::Guard(Assumed {
                name, low, high, ..
            }) => write!(
                f,
                "the variant was made for `{name}` between {low} and {high}: give such a value to it and to the original in `PipelineOptions::constants`, or draw the original"
            ),
        }
    }
}

impl std::error::Error for Unfit {}

/// The host's vertex buffers, with the attributes that a pass reads and no others. Slots stay where they are.
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

/// Of the host's constants those that a pass reads, where all of them are what its variant was made for.
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

    /// The host's vertex buffers as this pass reads them. `buffers` hold what the author's shader reads, slot by slot.
    ///
    /// # Errors
    /// An attribute is in none of them, or in a format whose numbers are of another kind.
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

    /// The pipeline, complete: shader, layout, states, targets.
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

    /// As [`Pass::pipeline`], with what the host knows only now: the surface's format, say.
    ///
    /// # Errors
    /// As [`Pass::vertex_buffers`]; a format of another kind of numbers, samples that the variant was not made for, a constant that the material has not, or one without a value. [`Unfit::Guard`]
    /// where a constant has another value than the variant was made for.
    pub fn pipeline_with(
        &self,
        device: &wgpu::Device,
        buffers: &[wgpu::VertexBufferLayout<'_>],
        options: &PipelineOptions<'_>,
    ) -> Result<wgpu::RenderPipeline, Unfit> {
        let depth = self.depth.as_ref().map(|d| d.state.clone());
        self.pipeline_of(device, buffers, depth, options)
    }

    /// The colour targets, with the formats that the host has.
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
                    "the pass `{}` was made for {:?} at location {at}, which {format:?} cannot take the place of",
                    self.role, target.format
                )));
            }
            target.format = format;
        }
        Ok(targets)
    }

    /// The samples of a pixel, as the host has them.
    fn samples_with(&self, options: &PipelineOptions<'_>) -> Result<u32, Unfit> {
        let built = self.multisample.count;
        match options.samples {
            Some(samples) if samples == built || self.phase == Phase::Shadow => Ok(built),
            Some(samples) if self.samples_are_free => Ok(samples),
            Some(samples) => Err(Unfit::Host(format!(
                "the pass `{}` is of a variant that was made for {built} samples a pixel, not for {samples}",
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
    /// A constant without a value, or [`Unfit::Guard`] where one has another value than the variant was made for.
    pub fn pipeline(&self, device: &wgpu::Device) -> Result<wgpu::ComputePipeline, Unfit> {
        self.pipeline_with(device, &PipelineOptions::default())
    }

    /// As [`Compute::pipeline`], with the constants that the passes of the material are made with.
    ///
    /// # Errors
    /// As [`Compute::pipeline`], and for a constant that the material has not.
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

impl Depth {
    /// For the render pass; `first`: no render pass of the frame before it had this attachment.
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
    /// For the render pass; `first`: no render pass of the frame before it had this attachment.
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

    /// The texture, of so many samples a pixel: for passes that are made with [`PipelineOptions::samples`].
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
