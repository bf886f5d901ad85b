//! In place of Bevy's function that makes the pipelines of a material's pre-pass and shadows.

use std::any::TypeId;
use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::Duration;

use bevy_asset::uuid::Uuid;
use bevy_asset::{AssetId, Handle};
use bevy_ecs::prelude::*;
use bevy_log::{debug, info, warn};
use bevy_material::descriptor::{
    CachedRenderPipelineId, FragmentState, RenderPipelineDescriptor, VertexState,
};
use bevy_material::key::{ErasedMaterialKey, ErasedMaterialPipelineKey, ErasedMeshPipelineKey};
use bevy_material::specialize::SpecializedMeshPipelineError;
use bevy_material::{AlphaMode, MaterialProperties};
use bevy_mesh::MeshVertexBufferLayoutRef;
use bevy_pbr::{
    MATERIAL_BIND_GROUP_INDEX, MaterialFragmentShader, MaterialPipeline, MaterialVertexShader,
    MeshPipeline, MeshPipelineKey, PrepassFragmentShader, PrepassPipeline,
    PrepassPipelineSpecializer, PrepassVertexShader,
};
use bevy_platform::time::Instant;
use bevy_render::render_resource::{PipelineCache, PrimitiveState, SpecializedMeshPipeline};
use bevy_shader::{Shader, ShaderDefVal};
use bevy_tasks::futures::check_ready;
use bevy_tasks::{AsyncComputeTaskPool, Task};
use naga::ShaderStage;

use crate::compose::{Composer, Failed, Reloads, Shared, Stage, check};
use crate::derive::{Derived, Refused, Wanted, derive};

/// The code of a shader with an error.
const BROKEN: &str = "shader";

/// What one shader is derived from.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Request {
    vertex: Stage,
    fragment: Stage,
    wanted: Wanted,
}

/// What became of a request.
enum Answer {
    /// A derived shader, under the name that pipelines know it by.
    Derived(Derived, Handle<Shader>),
    Refused(Refused),
}

/// What a task comes to, and how long it took. `None`: something is not loaded yet.
type Answered = (Option<Result<Derived, Refused>>, Duration);

struct Job {
    /// Name of the material's type.
    material: &'static str,
    task: Option<Task<Answered>>,
    answer: Option<Arc<Answer>>,
    /// How long the last task took.
    time: Duration,
    /// Shaders were changed since.
    is_stale: bool,
}

/// A pipeline: what has the same key, layout and alpha is drawn alike.
type Key = (ErasedMaterialPipelineKey, MeshVertexBufferLayoutRef, Alpha);

/// What alpha decides. Bevy's keys do not always say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Alpha {
    /// Nothing but what the shader discards.
    Discards,
    /// How much of a pixel is covered. What is blended casts shadows.
    Covers,
    /// What Bevy's own pre-pass shader makes of it: it cuts by the colour before it is multiplied by alpha.
    Bevys,
}

impl Alpha {
    fn of(properties: &MaterialProperties) -> Self {
        match properties.alpha_mode {
            AlphaMode::AlphaToCoverage | AlphaMode::Blend => Self::Covers,
            AlphaMode::Add | AlphaMode::Premultiplied
                if properties.get_shader(PrepassFragmentShader).is_some() =>
            {
                Self::Bevys
            }
            _ => Self::Discards,
        }
    }
}

/// The derivations, and the pipelines that are made of them.
#[derive(Resource, Default)]
pub struct Derivations {
    jobs: HashMap<Request, Job>,
    /// With what they are made of; `None`: Bevy's own. A new answer takes those of the old one out.
    pipelines: HashMap<Key, (CachedRenderPipelineId, Option<Arc<Answer>>)>,
    /// Drawn while the shader is derived: nothing.
    placeholder: Option<CachedRenderPipelineId>,
    /// Whether depth alone reads the material's bind group.
    reads: HashMap<TypeId, HashMap<ErasedMaterialKey, bool>>,
    reloads: Reloads,
    /// Errors of shaders that the log has: one shader has many pipelines.
    logged: HashSet<(&'static str, String)>,
    /// Whether pipelines have to be made anew and Bevy does not know yet, and when it heard of some.
    has_news: bool,
    told: Option<Instant>,
}

/// Bevy makes the pipelines of all of a material's objects again. While many shaders are derived it does not for
/// each answer.
const PERIOD: Duration = Duration::from_millis(100);

impl Derivations {
    /// How many shaders are being derived.
    pub fn pending(&self) -> usize {
        self.jobs.values().filter(|job| job.task.is_some()).count()
    }

    /// A row for each derived shader, in no order.
    pub fn rows(&self) -> impl Iterator<Item = crate::Row> {
        self.jobs.iter().map(|(request, job)| crate::Row {
            material: job.material,
            normal: request.wanted.normal,
            motion: request.wanted.motion,
            time: job.time,
            state: match job.answer.as_deref() {
                None => crate::State::Pending,
                Some(Answer::Derived(derived, _)) => crate::State::Derived {
                    has_fragment: derived.fragment.is_some(),
                    reads_material: derived.reads_material,
                    is_flat: derived.is_flat,
                },
                Some(Answer::Refused(refused)) => crate::State::Refused(refused.clone()),
            },
        })
    }

    /// The texts of derived shaders.
    pub fn texts(&self) -> impl Iterator<Item = &str> {
        self.jobs
            .values()
            .filter_map(|job| match job.answer.as_deref() {
                Some(Answer::Derived(derived, _)) => Some(derived.text.as_str()),
                _ => None,
            })
    }

    /// Whether the depth of a material reads its bind group; `None`: no shader of it is derived yet.
    pub(crate) fn reads(&self, of: TypeId, key: &ErasedMaterialKey) -> Option<bool> {
        self.reads.get(&of)?.get(key).copied()
    }

    /// Starts what is stale, and takes what is ready. Returns whether pipelines have to be made anew.
    pub fn poll(
        &mut self,
        composer: &Arc<Composer>,
        reloads: Reloads,
        cache: &mut PipelineCache,
    ) -> bool {
        let is_new = self.reloads.changed != reloads.changed;
        let has_arrived = self.reloads.arrived != reloads.arrived;
        self.reloads = reloads;
        if is_new {
            self.logged.clear();
        }
        for (request, job) in &mut self.jobs {
            job.is_stale |= is_new || has_arrived && job.answer.is_none();
            if job.task.is_none() && job.is_stale {
                job.is_stale = false;
                job.task = Some(start(request.clone(), composer.clone()));
            }
            let Some((done, time)) = job.task.as_mut().and_then(check_ready) else {
                continue;
            };
            job.task = None;
            job.time = time;
            let Some(result) = done else {
                // An import is not loaded yet. Once something is, the job starts again.
                continue;
            };
            let is_same = match (&result, job.answer.as_deref()) {
                (Ok(new), Some(Answer::Derived(old, _))) => new == old,
                (Err(new), Some(Answer::Refused(old))) => new == old,
                _ => false,
            };
            if is_same {
                continue;
            }
            self.has_news = true;
            let answer = Arc::new(taken(
                job.material,
                request,
                result,
                cache,
                &mut self.logged,
            ));
            if let Some(old) = job.answer.replace(answer) {
                let is_old = |made: &Option<_>| made.as_ref().is_some_and(|m| Arc::ptr_eq(m, &old));
                self.pipelines.retain(|_, (_, made)| !is_old(made));
            }
        }
        let is_due = self.pending() == 0 || self.told.is_none_or(|told| told.elapsed() >= PERIOD);
        let tells = self.has_news && is_due;
        if tells {
            self.has_news = false;
            self.told = Some(Instant::now());
        }
        tells
    }
}

/// Keeps a result, and tells the author of a refusal.
fn taken(
    material: &'static str,
    request: &Request,
    result: Result<Derived, Refused>,
    cache: &mut PipelineCache,
    logged: &mut HashSet<(&'static str, String)>,
) -> Answer {
    match result {
        Ok(derived) => {
            let id = Uuid::new_v4();
            let path = format!("preshade/{material}.wgsl");
            debug!("{material}: derived {path}:\n{}", derived.text);
            if derived.is_flat {
                info!(
                    "preshade: `{material}` has no normal, so the pre-pass writes those of triangles"
                );
            }
            let shader = Shader::from_wgsl(derived.text.clone(), path);
            cache.set_shader(AssetId::Uuid { uuid: id }, shader);
            Answer::Derived(derived, Handle::Uuid(id, std::marker::PhantomData))
        }
        Err(refused) => {
            let Wanted { normal, motion, .. } = request.wanted;
            let of = match (normal, motion) {
                (false, false) => "depth and shadows",
                (true, false) => "depth and normals",
                (false, true) => "depth and motion",
                (true, true) => "depth, normals and motion",
            };
            let is_known =
                refused.code == BROKEN && !logged.insert((material, refused.reason.clone()));
            if is_known {
                return Answer::Refused(refused);
            }
            warn!(
                "preshade: {of} of `{material}` stay Bevy's own [{}]: {}; to change that: {}",
                refused.code, refused.reason, refused.remedy
            );
            Answer::Refused(refused)
        }
    }
}

fn start(request: Request, composer: Arc<Composer>) -> Task<Answered> {
    AsyncComputeTaskPool::get().spawn(async move {
        let before = Instant::now();
        (answer(&request, &composer), before.elapsed())
    })
}

/// `None`: something is not loaded yet.
fn answer(request: &Request, composer: &Composer) -> Option<Result<Derived, Refused>> {
    let composed = || {
        let vertex = composer.compose(&request.vertex, ShaderStage::Vertex)?;
        Ok((
            vertex,
            composer.compose(&request.fragment, ShaderStage::Fragment)?,
        ))
    };
    match composed() {
        Ok((vertex, fragment)) => {
            let derived = derive(&vertex, &fragment, request.wanted);
            Some(derived.and_then(|derived| match check(&derived.text) {
                Ok(()) => Ok(derived),
                Err(why) => Err(Refused::new("invalid", why, "report it to preshade")),
            }))
        }
        Err(Failed::NotYet) => None,
        Err(Failed::Broken(why)) => {
            let remedy = "mend the shader, which has an error";
            Some(Err(Refused::new(BROKEN, why, remedy)))
        }
    }
}

/// Makes the pipeline of a material's pre-pass or shadow. `M` gives the material's name in messages.
pub fn specialize<M: 'static>(
    world: &mut World,
    key: ErasedMaterialPipelineKey,
    layout: &MeshVertexBufferLayoutRef,
    properties: &Arc<MaterialProperties>,
) -> Result<CachedRenderPipelineId, SpecializedMeshPipelineError> {
    // Bevy asks for each object and view.
    let alpha = Alpha::of(properties);
    let whole = (key.clone(), layout.clone(), alpha);
    if let Some((known, _)) = world.resource::<Derivations>().pipelines.get(&whole) {
        return Ok(*known);
    }
    let (of, own_key) = (key.type_id, key.material_key.clone());
    let own = PrepassPipelineSpecializer {
        pipeline: world.resource::<PrepassPipeline>().clone(),
        properties: properties.clone(),
    };
    let descriptor = own.specialize(key.clone(), layout)?;
    let mesh_key: MeshPipelineKey = key.mesh_key.downcast();
    let has_emulation = mesh_key.contains(MeshPipelineKey::UNCLIPPED_DEPTH_ORTHO)
        && !own.pipeline.depth_clip_control_supported;
    let is_deferred = mesh_key.contains(MeshPipelineKey::DEFERRED_PREPASS);
    world.resource_scope(|world, mut derivations: Mut<Derivations>| {
        let derivations = &mut *derivations;
        let cache = world.resource::<PipelineCache>();
        // As for an asset that is not loaded: the pipeline of a shader that never comes.
        let stand_in = |known: &mut Option<_>| {
            let waits = || cache.queue_render_pipeline(waiting(descriptor.clone()));
            Ok(*known.get_or_insert_with(waits))
        };
        let is_bevys = is_deferred || has_emulation || alpha == Alpha::Bevys;
        let (answer, main) = match is_bevys {
            true => (None, None),
            false => {
                let main = main_pipeline(world, key, layout, properties)?;
                let request = Request::of(&main, mesh_key, alpha == Alpha::Covers);
                let job = derivations
                    .jobs
                    .entry(request.clone())
                    .or_insert_with(|| Job {
                        material: short(std::any::type_name::<M>()),
                        task: Some(start(request, world.resource::<Shared>().0.clone())),
                        answer: None,
                        time: Duration::ZERO,
                        is_stale: false,
                    });
                let Some(answer) = job.answer.clone() else {
                    return stand_in(&mut derivations.placeholder);
                };
                (Some(answer), Some(main))
            }
        };
        if is_depth_only(mesh_key) {
            let derived = match answer.as_deref() {
                Some(Answer::Derived(derived, _)) => derived.reads_material,
                _ => false,
            };
            let reads = derivations.reads.entry(of).or_default();
            let reads = reads.entry(own_key).or_default();
            *reads |= derived;
            if derived && properties.get_shader(PrepassVertexShader).is_none() {
                // It was left out for other objects. The material gets it back.
                derivations.has_news = true;
                return stand_in(&mut derivations.placeholder);
            }
        }
        let descriptor = match (answer.as_deref(), main) {
            (Some(Answer::Derived(derived, shader)), Some(main)) => {
                replaced(descriptor, main, derived, shader)
            }
            _ => descriptor,
        };
        let id = cache.queue_render_pipeline(descriptor);
        derivations.pipelines.insert(whole, (id, answer));
        Ok(id)
    })
}

impl Request {
    fn of(main: &RenderPipelineDescriptor, key: MeshPipelineKey, alpha_covers: bool) -> Self {
        let vertex = Stage {
            shader: main.vertex.shader.id(),
            defs: main.vertex.shader_defs.clone(),
            entry: main.vertex.entry_point.as_ref().map(ToString::to_string),
        };
        let fragment = main.fragment.as_ref().map(|fragment| Stage {
            shader: fragment.shader.id(),
            defs: fragment.shader_defs.clone(),
            entry: fragment.entry_point.as_ref().map(ToString::to_string),
        });
        let motion = key.contains(MeshPipelineKey::MOTION_VECTOR_PREPASS);
        Self {
            fragment: fragment.unwrap_or_else(|| vertex.clone()),
            vertex,
            wanted: Wanted {
                normal: key.contains(MeshPipelineKey::NORMAL_PREPASS),
                motion,
                previous_skin: motion && key.contains(MeshPipelineKey::HAS_PREVIOUS_SKIN),
                previous_morph: motion && key.contains(MeshPipelineKey::HAS_PREVIOUS_MORPH),
                alpha_covers,
            },
        }
    }
}

/// The pipeline of the main pass, as `MaterialPipelineSpecializer` makes it.
fn main_pipeline(
    world: &World,
    mut key: ErasedMaterialPipelineKey,
    layout: &MeshVertexBufferLayoutRef,
    properties: &MaterialProperties,
) -> Result<RenderPipelineDescriptor, SpecializedMeshPipelineError> {
    let mesh_pipeline = world.resource::<MeshPipeline>().clone();
    let mesh_key: MeshPipelineKey = key.mesh_key.downcast();
    // The main pass reads the pre-pass where there is one. What it decides must not depend on it.
    let own = MeshPipelineKey::ALL_PREPASS_BITS | MeshPipelineKey::UNCLIPPED_DEPTH_ORTHO;
    let kept = mesh_key.intersection(MeshPipelineKey::MAY_DISCARD);
    let mesh_key = mesh_key.difference(own) | kept;
    key.mesh_key = ErasedMeshPipelineKey::new(mesh_key);
    let mut main = mesh_pipeline.specialize(mesh_key, layout)?;
    let group = MATERIAL_BIND_GROUP_INDEX as u32;
    let define = || ShaderDefVal::UInt("MATERIAL_BIND_GROUP".into(), group);
    main.vertex.shader_defs.push(define());
    if let Some(fragment) = &mut main.fragment {
        fragment.shader_defs.push(define());
        if let Some(shader) = properties.get_shader(MaterialFragmentShader) {
            fragment.shader = shader;
        }
    }
    if let Some(shader) = properties.get_shader(MaterialVertexShader) {
        main.vertex.shader = shader;
    }
    if let Some(layout) = &properties.material_layout {
        main.layout
            .insert(MATERIAL_BIND_GROUP_INDEX, layout.clone());
    }
    if let Some(specialize) = properties.user_specialize {
        specialize(&MaterialPipeline { mesh_pipeline }, &mut main, layout, key)?;
    }
    if properties.bindless {
        main.vertex.shader_defs.push("BINDLESS".into());
        if let Some(fragment) = &mut main.fragment {
            fragment.shader_defs.push("BINDLESS".into());
        }
    }
    Ok(main)
}

/// Bevy's pipeline with the derived shaders.
fn replaced(
    own: RenderPipelineDescriptor,
    main: RenderPipelineDescriptor,
    derived: &Derived,
    shader: &Handle<Shader>,
) -> RenderPipelineDescriptor {
    let targets = own.fragment.map(|f| f.targets).unwrap_or_default();
    RenderPipelineDescriptor {
        vertex: VertexState {
            shader: shader.clone(),
            shader_defs: Vec::new(),
            entry_point: Some(derived.vertex.clone().into()),
            // The attributes have the main pass's locations.
            buffers: main.vertex.buffers,
        },
        fragment: derived.fragment.as_ref().map(|entry| FragmentState {
            shader: shader.clone(),
            shader_defs: Vec::new(),
            entry_point: Some(entry.clone().into()),
            targets,
        }),
        // Bevy's pre-pass culls nothing unless the material says so for it too.
        primitive: PrimitiveState {
            cull_mode: main.primitive.cull_mode,
            front_face: main.primitive.front_face,
            ..own.primitive
        },
        label: Some("preshade_prepass_pipeline".into()),
        ..own
    }
}

/// Whether Bevy leaves the material's bind group out, unless it has a pre-pass shader.
fn is_depth_only(key: MeshPipelineKey) -> bool {
    !key.intersects(
        MeshPipelineKey::NORMAL_PREPASS
            | MeshPipelineKey::MOTION_VECTOR_PREPASS
            | MeshPipelineKey::DEFERRED_PREPASS
            | MeshPipelineKey::MAY_DISCARD,
    )
}

/// A pipeline that is never ready.
fn waiting(own: RenderPipelineDescriptor) -> RenderPipelineDescriptor {
    let never = Handle::Uuid(Uuid::nil(), std::marker::PhantomData);
    RenderPipelineDescriptor {
        vertex: VertexState {
            shader: never,
            ..own.vertex
        },
        fragment: None,
        ..own
    }
}

/// The last part of a type's path, with its arguments.
pub fn short(name: &'static str) -> &'static str {
    let head = name.find('<').unwrap_or(name.len());
    name[..head].rfind("::").map_or(name, |at| &name[at + 2..])
}
