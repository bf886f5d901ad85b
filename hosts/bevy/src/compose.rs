//! Bevy's own composer beside Bevy's: a material's main shaders as WGSL text.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bevy_asset::{AssetEvent, AssetId, Assets};
use bevy_ecs::message::MessageReader;
use bevy_ecs::prelude::*;
use bevy_render::Extract;
use bevy_render::renderer::{RenderAdapter, RenderDevice};
use bevy_shader::{
    Shader, ShaderCache, ShaderCacheError, ShaderCacheSource, ShaderDefVal, ValidateShader,
};
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{Module, ShaderStage};

use crate::derive::Composed;

/// Between a name and the module that naga_oil took it from.
const DECORATION: &str = "X_naga_oil_mod_X";

/// One stage of a pipeline, as its descriptor names it.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Stage {
    /// The shader.
    pub shader: AssetId<Shader>,
    /// Its definitions.
    pub defs: Vec<ShaderDefVal>,
    /// Its entry point; `None`: the only one of the stage.
    pub entry: Option<String>,
}

/// Why a stage cannot be composed.
#[derive(Debug)]
pub enum Failed {
    /// A shader, or one that it imports, is not loaded yet.
    NotYet,
    /// The reason, for people.
    Broken(String),
}

enum Change {
    Set(AssetId<Shader>, Box<Shader>),
    Remove(AssetId<Shader>),
}

/// A module that is taken out once: composed modules of physically based materials have megabytes.
type Taken = Mutex<Option<Module>>;

struct Cache {
    cache: ShaderCache<Taken, ()>,
    shaders: HashMap<AssetId<Shader>, Shader>,
}

/// The composer, and the shaders that it has not seen yet. Composing takes milliseconds, so tasks do
/// it: they take the changes, and the frame only adds to them.
pub struct Composer {
    changes: Mutex<Vec<Change>>,
    cache: Mutex<Cache>,
    /// Definitions that Bevy adds to each shader.
    global: Vec<ShaderDefVal>,
    has_all: AtomicBool,
}

/// The module as it is: preshade gets the text of what one pipeline needs of it.
fn keep(_: &(), source: ShaderCacheSource, _: &ValidateShader) -> Result<Taken, ShaderCacheError> {
    let module = match source {
        ShaderCacheSource::Naga(module) => module,
        ShaderCacheSource::Wgsl(text) => naga::front::wgsl::parse_str(&text)
            .map_err(|e| ShaderCacheError::CreateShaderModule(e.emit_to_string(&text)))?,
        ShaderCacheSource::SpirV(_) => {
            let why = "the shader is SPIR-V, and only WGSL is read";
            return Err(ShaderCacheError::CreateShaderModule(why.to_owned()));
        }
    };
    Ok(Mutex::new(Some(module)))
}

impl Composer {
    /// Without any shader.
    pub fn of(world: &World) -> Self {
        let device = world.resource::<RenderDevice>();
        let flags = world
            .resource::<RenderAdapter>()
            .get_downlevel_capabilities()
            .flags;
        // As `PipelineCache::new`.
        let storage = device.limits().max_storage_buffers_per_shader_stage;
        let name = "AVAILABLE_STORAGE_BUFFER_BINDINGS".to_owned();
        let mut global = vec![ShaderDefVal::UInt(name, storage)];
        if cfg!(target_abi = "sim") {
            global.push("NO_CUBE_ARRAY_TEXTURES_SUPPORT".into());
        }
        Self {
            changes: Mutex::default(),
            cache: Mutex::new(Cache {
                cache: ShaderCache::new((), device.features(), flags, keep),
                shaders: HashMap::default(),
            }),
            global,
            has_all: AtomicBool::new(false),
        }
    }
}

/// The composer, which tasks share.
#[derive(Resource)]
pub struct Shared(pub Arc<Composer>);

/// Counts what happened to shaders.
#[derive(Resource, Clone, Copy, Default)]
pub struct Reloads {
    /// Changes of shaders that were known before.
    pub changed: u64,
    /// Shaders that came or changed: a missing import may be among them.
    pub arrived: u64,
}

/// Takes over the shaders of the main world, as Bevy's pipeline cache does.
pub fn extract_shaders(
    composer: Option<Res<Shared>>,
    mut reloads: ResMut<Reloads>,
    shaders: Extract<Res<Assets<Shader>>>,
    mut events: Extract<MessageReader<AssetEvent<Shader>>>,
) {
    let Some(composer) = composer else { return };
    let Composer {
        changes,
        global,
        has_all,
        ..
    } = &*composer.0;
    let mut changes = lock(changes);
    let set = |id: AssetId<Shader>, shader: &Shader| {
        let mut shader = shader.clone();
        shader.shader_defs.extend(global.iter().cloned());
        Change::Set(id, Box::new(shader))
    };
    if !has_all.swap(true, Ordering::Relaxed) {
        changes.extend(shaders.iter().map(|(id, shader)| set(id, shader)));
        events.clear();
        reloads.arrived += 1;
        return;
    }
    for event in events.read() {
        match event {
            AssetEvent::Added { id } | AssetEvent::Modified { id } => {
                changes.extend(shaders.get(*id).map(|shader| set(*id, shader)));
                reloads.arrived += 1;
                reloads.changed += u64::from(matches!(event, AssetEvent::Modified { .. }));
            }
            AssetEvent::Removed { id } => changes.push(Change::Remove(*id)),
            AssetEvent::Unused { .. } | AssetEvent::LoadedWithDependencies { .. } => {}
        }
    }
}

impl Composer {
    /// The WGSL of a stage.
    ///
    /// # Errors
    /// An import is missing, or the shader has an error.
    pub fn compose(&self, stage: &Stage, of: ShaderStage) -> Result<Composed, Failed> {
        let mut cache = lock(&self.cache);
        for change in std::mem::take(&mut *lock(&self.changes)) {
            cache.change(change);
        }
        let mut module = cache.module(stage)?;
        let path = cache.shaders.get(&stage.shader).map(|s| s.path.clone());
        let path = path.unwrap_or_default();
        drop(cache);
        let is_own = |e: &naga::EntryPoint| {
            e.stage == of && stage.entry.as_ref().is_none_or(|name| e.name == *name)
        };
        let Some(entry) = module
            .entry_points
            .iter()
            .find(|e| is_own(e))
            .map(|e| e.name.clone())
        else {
            return Err(Failed::Broken(format!(
                "`{path}` has no entry point for {of:?}"
            )));
        };
        module
            .entry_points
            .retain(|e| e.stage == of && e.name == entry);
        undecorated(&mut module);
        naga::compact::compact(&mut module, naga::compact::KeepUnused::No);
        let text = written(&module).map_err(Failed::Broken)?;
        Ok(Composed { text, entry, path })
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Cache {
    fn change(&mut self, change: Change) {
        match change {
            Change::Set(id, shader) => {
                self.shaders.insert(id, (*shader).clone());
                self.cache.set_shader(id, *shader);
            }
            Change::Remove(id) => {
                self.shaders.remove(&id);
                self.cache.remove(id);
            }
        }
    }

    fn module(&mut self, stage: &Stage) -> Result<Module, Failed> {
        if let Some(module) = self.take(stage)? {
            return Ok(module);
        }
        // It was taken before: setting the shader again has the cache compose it again.
        if let Some(shader) = self.shaders.get(&stage.shader) {
            self.cache.set_shader(stage.shader, shader.clone());
        }
        self.take(stage)?.ok_or(Failed::NotYet)
    }

    fn take(&mut self, stage: &Stage) -> Result<Option<Module>, Failed> {
        // The number of a pipeline matters to those who make pipelines. We do not.
        let taken = self
            .cache
            .get(0, stage.shader, &stage.defs)
            .map_err(|e| match e {
                ShaderCacheError::ShaderNotLoaded(_)
                | ShaderCacheError::ShaderImportNotYetAvailable => Failed::NotYet,
                ShaderCacheError::ProcessShaderError(e) => {
                    Failed::Broken(e.emit_to_string(&self.cache.composer))
                }
                ShaderCacheError::CreateShaderModule(why) => Failed::Broken(why),
            })?;
        Ok(lock(&taken).take())
    }
}

/// Whether Bevy's naga takes a text. The compiler's own may be another version.
pub fn check(text: &str) -> Result<(), String> {
    let module = naga::front::wgsl::parse_str(text).map_err(|e| e.emit_to_string(text))?;
    valid(&module, text).map(|_| ())
}

fn valid(module: &Module, text: &str) -> Result<ModuleInfo, String> {
    Validator::new(ValidationFlags::all(), Capabilities::all())
        .validate(module)
        .map_err(|e| e.emit_to_string(text))
}

fn written(module: &Module) -> Result<String, String> {
    let info = valid(module, "")?;
    naga::back::wgsl::write_string(module, &info, naga::back::wgsl::WriterFlags::empty())
        .map_err(|e| e.to_string())
}

/// Gives everything the name that its author gave it. The writer tells two of a name apart.
fn undecorated(module: &mut Module) {
    let cut = |name: &mut Option<String>| {
        if let Some(name) = name
            && let Some(at) = name.find(DECORATION)
        {
            name.truncate(at);
        }
    };
    for (_, global) in module.global_variables.iter_mut() {
        cut(&mut global.name);
    }
    for (_, constant) in module.constants.iter_mut() {
        cut(&mut constant.name);
    }
    for (_, function) in module.functions.iter_mut() {
        cut(&mut function.name);
    }
    let types: Vec<_> = module
        .types
        .iter()
        .map(|(handle, ty)| (handle, ty.clone()))
        .collect();
    for (handle, mut ty) in types {
        let before = ty.name.clone();
        cut(&mut ty.name);
        // Types are told apart by their names too.
        if ty.name != before && module.types.get(&ty).is_none() {
            module.types.replace(handle, ty);
        }
    }
}
