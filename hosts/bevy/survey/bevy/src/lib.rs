//! Bevy as examples see it, without a window: the same names, and three differences.
//!
//! - [`DefaultPlugins`] draws to pictures, a set number of frames, and keeps what the passes drew.
//! - [`MaterialPlugin`] brings `PreshadePlugin` along where [`Mode::Derived`] asks for it: that is the one
//!   line that an app adds.
//! - Cameras have no multisampling, and the pre-passes that the mode asks for.

use std::marker::PhantomData;
use std::sync::Mutex;
use std::time::Duration;

pub use real::*;

extern crate self as bevy;

#[path = "../../../tests/support/read.rs"]
mod read;

pub use read::{Drawn as Passes, Texels, covered};

/// What examples import.
pub mod prelude {
    pub use crate::{DefaultPlugins, MaterialPlugin};
    pub use real::prelude::*;
}

use bevy_preshade::{Derivations, PreshadePlugin, Row};
use real::app::{AppExit, PluginGroup, PluginGroupBuilder};
use real::asset::RenderAssetUsages;
use real::camera::{ImageRenderTarget, RenderTarget};
use real::core_pipeline::prepass::{
    DeferredPrepass, DepthPrepass, MotionVectorPrepass, NormalPrepass, ViewPrepassTextures,
};
use real::ecs::entity::Entity;
use real::pbr::ViewShadowBindings;
use real::prelude::*;
use real::render::camera::ExtractedCamera;
use real::render::pipelined_rendering::PipelinedRenderingPlugin;
use real::render::render_resource::{
    Extent3d, PipelineCache, TextureDimension, TextureFormat, TextureUsages,
};
use real::render::renderer::{RenderDevice, RenderQueue};
use real::render::view::ViewDepthTexture;
use real::render::{Render, RenderApp, RenderPlugin, RenderSystems};
use real::time::TimeUpdateStrategy;
use real::window::ExitCondition;

/// How an app is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Without any pre-pass.
    Main,
    /// With Bevy's own pre-passes.
    Bevy,
    /// With derived ones.
    Derived,
}

/// What a camera drew in the last frame.
#[derive(Clone, Debug, Default)]
pub struct View {
    /// By its passes.
    pub passes: Passes,
    /// The picture.
    pub picture: Texels,
}

/// What an app drew.
#[derive(Clone, Debug, Default)]
pub struct Drawn {
    /// In the order in which cameras are drawn.
    pub views: Vec<View>,
    /// What became of its shaders.
    pub rows: Vec<Row>,
    /// The derived texts.
    pub texts: Vec<String>,
    /// Whether an answer was still missing at the end.
    pub is_pending: bool,
    /// The adapter.
    pub adapter: String,
    /// How long frames took on the CPU, in order of length.
    pub frames: Vec<Duration>,
}

/// Width and height of pictures.
const SIZE: u32 = 256;
/// Frames while assets are loaded, with no time between them. Many examples count frames, so all
/// modes draw as many.
const WARM_UP: u32 = 120;
/// Frames after which pipelines are not waited for.
const MOST: u32 = 2000;
const PAUSE: Duration = Duration::from_millis(15);
/// Frames with time between them.
const FRAMES: u32 = 3;

/// Whether a frame waits for the pipelines that it wants.
pub static WAITS: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(true);

static MODE: Mutex<Mode> = Mutex::new(Mode::Main);
static DRAWN: Mutex<Option<Drawn>> = Mutex::new(None);

/// Runs an app as `main` would, and returns what its last frame drew.
pub fn drawn(mode: Mode, main: fn()) -> Option<Drawn> {
    *locked(&MODE) = mode;
    main();
    locked(&DRAWN).take()
}

fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// Bevy's, with the plugin where the mode asks for it.
pub struct MaterialPlugin<M>(PhantomData<fn() -> M>);

impl<M> Default for MaterialPlugin<M> {
    fn default() -> Self {
        Self(PhantomData)
    }
}

impl<M: Material> Plugin for MaterialPlugin<M>
where
    M::Data: PartialEq + Eq + std::hash::Hash + Clone,
{
    fn build(&self, app: &mut App) {
        app.add_plugins(real::pbr::MaterialPlugin::<M>::default());
        if *locked(&MODE) == Mode::Derived {
            app.add_plugins(PreshadePlugin::<M>::default());
        }
    }
}

/// Bevy's, without a window.
pub struct DefaultPlugins;

impl PluginGroup for DefaultPlugins {
    fn build(self) -> PluginGroupBuilder {
        real::DefaultPlugins
            .build()
            .set(WindowPlugin {
                exit_condition: ExitCondition::DontExit,
                ..default()
            })
            .set(RenderPlugin {
                synchronous_pipeline_compilation: WAITS.load(std::sync::atomic::Ordering::Relaxed),
                ..default()
            })
            .disable::<PipelinedRenderingPlugin>()
            .add(Survey)
    }
}

/// What the probe reads of the last frame.
#[derive(Resource, Default)]
struct Probe {
    is_on: bool,
    drawn: Drawn,
}

struct Survey;

impl Plugin for Survey {
    fn build(&self, app: &mut App) {
        app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO))
            .add_systems(PostStartup, aim)
            .add_systems(Last, aim)
            .set_runner(run);
        if let Some(render) = app.get_sub_app_mut(RenderApp) {
            render.init_resource::<Probe>().add_systems(
                Render,
                take.after(RenderSystems::Render)
                    .before(RenderSystems::Cleanup),
            );
        }
    }
}

/// Has cameras of windows draw to pictures.
fn aim(
    mut commands: Commands,
    mut images: ResMut<Assets<Image>>,
    mut cameras: Query<(Entity, &mut Camera3d, Option<&mut RenderTarget>), Added<Camera3d>>,
) {
    for (entity, mut camera, target) in &mut cameras {
        let usages =
            TextureUsages::from(camera.depth_texture_usages) | TextureUsages::TEXTURE_BINDING;
        camera.depth_texture_usages = usages.into();
        let mut camera = commands.entity(entity);
        camera.insert(Msaa::Off);
        match *locked(&MODE) {
            Mode::Main => {
                camera.remove::<(
                    DepthPrepass,
                    NormalPrepass,
                    MotionVectorPrepass,
                    DeferredPrepass,
                )>();
            }
            Mode::Bevy | Mode::Derived => {
                camera.insert((DepthPrepass, NormalPrepass, MotionVectorPrepass));
            }
        }
        if target.is_none_or(|target| matches!(*target, RenderTarget::Window(_))) {
            let size = Extent3d {
                width: SIZE,
                height: SIZE,
                depth_or_array_layers: 1,
            };
            let mut picture = Image::new_uninit(
                size,
                TextureDimension::D2,
                TextureFormat::Rgba8UnormSrgb,
                RenderAssetUsages::all(),
            );
            picture.texture_descriptor.usage |= TextureUsages::RENDER_ATTACHMENT;
            camera.insert(RenderTarget::Image(ImageRenderTarget::from(
                images.add(picture),
            )));
        }
    }
}

/// Whether something is being derived or compiled.
fn is_pending(app: &App) -> bool {
    let world = app.sub_app(RenderApp).world();
    let waiting = world.resource::<PipelineCache>().waiting_pipelines();
    let derivations = world.get_resource::<Derivations>();
    // One pipeline is never ready: the one that stands in for those to come.
    waiting.count() > 1 || derivations.is_some_and(|of| of.pending() > 0)
}

/// Draws a set number of frames, or more if pipelines are still missing.
fn run(mut app: App) -> AppExit {
    app.finish();
    app.cleanup();
    let mut frames = Vec::new();
    for frame in 0..MOST {
        if frame >= WARM_UP && !is_pending(&app) {
            break;
        }
        let before = std::time::Instant::now();
        app.update();
        frames.push(before.elapsed());
        std::thread::sleep(PAUSE);
    }
    frames.sort();
    let step = TimeUpdateStrategy::ManualDuration(Duration::from_millis(100));
    app.insert_resource(step);
    for frame in 0..FRAMES {
        app.sub_app_mut(RenderApp)
            .world_mut()
            .resource_mut::<Probe>()
            .is_on = frame + 1 == FRAMES;
        app.update();
    }
    let is_pending = is_pending(&app);
    let world = app.sub_app_mut(RenderApp).world_mut();
    let mut drawn = std::mem::take(&mut world.resource_mut::<Probe>().drawn);
    if let Some(derivations) = world.get_resource::<Derivations>() {
        drawn.rows = derivations.rows().collect();
        drawn.texts = derivations.texts().map(str::to_owned).collect();
    }
    let info = world.resource::<real::render::renderer::RenderAdapterInfo>();
    drawn.adapter = format!("{} ({})", info.name, info.driver_info);
    drawn.is_pending = is_pending;
    drawn.frames = frames;
    *locked(&DRAWN) = Some(drawn);
    AppExit::Success
}

fn take(
    mut probe: ResMut<Probe>,
    views: Query<(
        Entity,
        &ExtractedCamera,
        &real::render::view::ViewTarget,
        &ViewDepthTexture,
        Option<&ViewPrepassTextures>,
        Option<&ViewShadowBindings>,
    )>,
    (device, queue): (Res<RenderDevice>, Res<RenderQueue>),
) {
    if !probe.is_on {
        return;
    }
    let mut views: Vec<_> = views.iter().collect();
    views.sort_by_key(|(entity, camera, ..)| (camera.order, *entity));
    probe.drawn.views = views
        .into_iter()
        .map(|(_, _, target, depth, ahead, shadows)| View {
            passes: Passes::of(&device, &queue, (depth, ahead, shadows)),
            picture: read::read(&device, &queue, target.main_texture()),
        })
        .collect();
}
