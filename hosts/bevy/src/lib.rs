#![doc = include_str!("../README.md")]

use std::any::TypeId;
use std::hash::Hash;
use std::marker::PhantomData;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use bevy_app::{App, Plugin};
use bevy_asset::Handle;
use bevy_ecs::prelude::*;
use bevy_material::MaterialProperties;
use bevy_material::labels::ShaderLabel;
use bevy_pbr::{
    Material, MaterialFragmentShader, MaterialVertexShader, MeshMaterial3d, PreparedMaterial,
    PrepassFragmentShader, PrepassPipeline, PrepassVertexShader, RenderMaterialInstances,
};
use bevy_render::camera::DirtySpecializations;
use bevy_render::erased_render_asset::{ErasedRenderAssets, prepare_erased_assets};
use bevy_render::render_resource::PipelineCache;
use bevy_render::{ExtractSchedule, Render, RenderApp, RenderStartup, RenderSystems};
use bevy_shader::Shader;

mod compose;
mod derive;
mod measure;
mod specialize;

use compose::{Composer, Reloads, Shared};
pub use derive::Refused;
pub use measure::{Choice, Gain, Measurements};
use measure::{Enabled, Quiet};
pub use specialize::Derivations;

/// Derives the pre-pass and the shadows of the material `M` from its main shaders.
///
/// Add it behind `MaterialPlugin::<M>`. Nothing else changes.
pub struct PreshadePlugin<M: Material> {
    is_measured: bool,
    of: PhantomData<fn() -> M>,
}

impl<M: Material> Default for PreshadePlugin<M> {
    fn default() -> Self {
        Self {
            is_measured: false,
            of: PhantomData,
        }
    }
}

impl<M: Material> PreshadePlugin<M> {
    /// Draws the material's depth pre-pass where it saves time on this device, and leaves it out
    /// where it does not. Both are drawn and timed while the app runs: [`Measurements`] has the times.
    ///
    /// Take it if the pre-pass is there to save time: an object whose pre-pass is off is missing in
    /// the picture of depths. All pre-passes stay on while a camera has normals, motion vectors, deferred rendering,
    /// occlusion culling, contact shadows, order-independent transparency or the depth of the frame before, or while
    /// the app has forward decals. Materials with transmission, and effects of your own, read the picture too: don't
    /// take it there.
    ///
    /// Nothing is measured while no camera has a `DepthPrepass`.
    ///
    /// It adds Bevy's `RenderDiagnosticsPlugin`. If your app adds that too, add it first.
    ///
    /// The device must give times of its passes (Vulkan and DirectX 12 do). Otherwise the pre-pass
    /// stays on.
    pub fn measured() -> Self {
        Self {
            is_measured: true,
            ..Self::default()
        }
    }
}

/// What became of a shader: see [`Derivations::rows`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Row {
    /// Name of the material's type.
    pub material: &'static str,
    /// Whether a view asks for normals.
    pub normal: bool,
    /// Whether a view asks for motion vectors.
    pub motion: bool,
    /// How long composing and deriving took, in a task beside the frames.
    pub time: Duration,
    /// The state.
    pub state: State,
}

/// The state of a derivation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    /// The shader is being derived. Its objects are missing in the pre-pass until then.
    Pending,
    /// The pipelines are made of it.
    Derived {
        /// Whether there is a fragment stage: something is cut out, or more than depth is written.
        has_fragment: bool,
        /// Whether it reads the material's bind group.
        reads_material: bool,
        /// Whether its normals are those of triangles, because the shaders have none.
        is_flat: bool,
    },
    /// Bevy's own pipelines stay.
    Refused(Refused),
}

impl<M: Material> Plugin for PreshadePlugin<M>
where
    M::Data: PartialEq + Eq + Hash + Clone,
{
    fn build(&self, app: &mut App) {
        let Some(render) = app.get_sub_app_mut(RenderApp) else {
            return;
        };
        if !render.world().contains_resource::<Derivations>() {
            render
                .init_resource::<Derivations>()
                .init_resource::<Reloads>()
                .init_resource::<Settled>()
                .init_resource::<Quiet>()
                .add_systems(RenderStartup, init_composer)
                .add_systems(ExtractSchedule, compose::extract_shaders)
                .add_systems(Render, poll.in_set(RenderSystems::PrepareAssets));
        }
        let quiet = render.world().resource::<Quiet>().clone();
        render.add_systems(
            Render,
            (
                adopt::<M>
                    .after(prepare_erased_assets::<MeshMaterial3d<M>>)
                    .before(poll),
                respecialize::<M>.after(poll),
            )
                .in_set(RenderSystems::PrepareAssets),
        );
        if self.is_measured {
            measure::add::<M>(app, &quiet);
        }
    }
}

/// Whether answers came in this frame.
#[derive(Resource, Default)]
struct Settled {
    has_news: bool,
    /// Materials have another bind group for their depth.
    has_adopted: bool,
}

/// Runs again when a lost device is replaced: pipelines of the old one mean nothing then.
fn init_composer(world: &mut World) {
    let composer = Composer::of(world);
    world.insert_resource(Shared(Arc::new(composer)));
    world.insert_resource(Derivations::default());
}

fn poll(
    mut derivations: ResMut<Derivations>,
    mut settled: ResMut<Settled>,
    mut cache: ResMut<PipelineCache>,
    composer: Res<Shared>,
    reloads: Res<Reloads>,
    quiet: Res<Quiet>,
) {
    let has_adopted = std::mem::take(&mut settled.has_adopted);
    settled.has_news = derivations.poll(&composer.0, *reloads, &mut cache) || has_adopted;
    // The pipeline that stands in for others is never ready.
    let is_quiet = derivations.pending() == 0 && cache.waiting_pipelines().count() <= 1;
    quiet.0.store(is_quiet, Ordering::Relaxed);
}

/// Marks a material that makes its pipelines with us.
#[derive(ShaderLabel, Debug, Hash, PartialEq, Eq, Clone, Default)]
struct Adopted;

/// Has new and changed materials make their pipelines with us.
fn adopt<M: Material>(
    mut materials: ResMut<ErasedRenderAssets<PreparedMaterial>>,
    mut settled: ResMut<Settled>,
    derivations: Res<Derivations>,
    pipeline: Option<Res<PrepassPipeline>>,
) {
    let Some(pipeline) = pipeline else { return };
    let own = TypeId::of::<M>();
    let ours = materials.iter_mut().filter(|(id, _)| id.type_id() == own);
    for (_, material) in ours {
        let properties = &material.properties;
        let is_adopted = properties.get_shader(Adopted).is_some();
        if !is_adopted && !is_ours(properties) {
            continue;
        }
        // Bevy leaves the material's bind group out of depth alone, unless there is a pre-pass shader.
        // Then it draws objects of several materials at once.
        let reads = derivations.reads(own, &properties.material_key) != Some(false);
        let is_bound = properties.get_shader(PrepassVertexShader).is_some();
        if is_adopted && reads == is_bound {
            continue;
        }
        settled.has_adopted |= is_adopted;
        // Nothing draws it.
        let default = || pipeline.default_prepass_shader.clone();
        let mut properties = copied(properties);
        if !is_adopted {
            properties.prepass_specialize = Some(specialize::specialize::<M>);
            properties.add_shader(Adopted, default());
        }
        match reads {
            true => properties.add_shader(PrepassVertexShader, default()),
            false => properties
                .shaders
                .retain(|(label, _)| *label != PrepassVertexShader.intern()),
        }
        material.properties = Arc::new(properties);
    }
}

/// Whether a material has shaders of its own, and none for the pre-pass.
fn is_ours(properties: &MaterialProperties) -> bool {
    let shader = |handle: Option<Handle<Shader>>| handle.map(|h| is_bevys(&h));
    let vertex = shader(properties.get_shader(MaterialVertexShader));
    let fragment = shader(properties.get_shader(MaterialFragmentShader));
    let has_own = vertex == Some(false) || fragment == Some(false);
    let has_prepass = properties.get_shader(PrepassVertexShader).is_some()
        || shader(properties.get_shader(PrepassFragmentShader)) == Some(false);
    has_own && !has_prepass && properties.prepass_specialize.is_some()
}

/// Whether a shader is one of `bevy_pbr`.
fn is_bevys(shader: &Handle<Shader>) -> bool {
    shader.path().is_some_and(|path| {
        path.source().as_str() == Some("embedded") && path.path().starts_with("bevy_pbr")
    })
}

/// A copy: Bevy's has no `Clone`.
fn copied(of: &MaterialProperties) -> MaterialProperties {
    MaterialProperties {
        render_method: of.render_method,
        alpha_mode: of.alpha_mode,
        mesh_pipeline_key_bits: of.mesh_pipeline_key_bits,
        depth_bias: of.depth_bias,
        reads_view_transmission_texture: of.reads_view_transmission_texture,
        render_phase_type: of.render_phase_type,
        material_layout: of.material_layout.clone(),
        draw_functions: of.draw_functions.clone(),
        shaders: of.shaders.clone(),
        bindless: of.bindless,
        base_specialize: of.base_specialize,
        prepass_specialize: of.prepass_specialize,
        user_specialize: of.user_specialize,
        material_key: of.material_key.clone(),
        shadows_enabled: of.shadows_enabled,
        prepass_enabled: of.prepass_enabled,
    }
}

/// Has Bevy make the pipelines of a material's objects again once an answer came, or once its pre-pass
/// is turned on or off.
fn respecialize<M: Material>(
    settled: Res<Settled>,
    enabled: Option<Res<Enabled>>,
    instances: Res<RenderMaterialInstances>,
    mut materials: ResMut<ErasedRenderAssets<PreparedMaterial>>,
    mut dirty: ResMut<DirtySpecializations>,
    mut was_on: Local<Option<bool>>,
) {
    let is_on = enabled.and_then(|enabled| measure::switch::<M>(&mut materials, &enabled));
    // Of a material that is prepared anew, Bevy makes the pipelines itself.
    let is_switched = std::mem::replace(&mut *was_on, is_on) != is_on;
    if !settled.has_news && !is_switched {
        return;
    }
    let own = TypeId::of::<M>();
    let ours = instances
        .instances
        .iter()
        .filter(|(_, of)| of.asset_id.type_id() == own);
    dirty
        .changed_renderables
        .extend(ours.map(|(entity, _)| *entity));
}
