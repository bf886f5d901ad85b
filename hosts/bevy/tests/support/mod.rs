//! A headless app that draws one material, and what its passes drew.

pub mod materials;
pub mod picture;
pub mod read;

use std::any::TypeId;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bevy::app::PluginGroupBuilder;
use bevy::asset::RenderAssetUsages;
use bevy::camera::RenderTarget;
use bevy::core_pipeline::prepass::{
    DepthPrepass, MotionVectorPrepass, NormalPrepass, ViewPrepassTextures,
};
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::material::MaterialProperties;
use bevy::pbr::{PreparedMaterial, PrepassVertexShader, ViewShadowBindings};
use bevy::prelude::*;
use bevy::render::camera::TemporalJitter;
use bevy::render::erased_render_asset::ErasedRenderAssets;
use bevy::render::error_handler::{RenderError, RenderErrorHandler, RenderErrorPolicy};
use bevy::render::pipelined_rendering::PipelinedRenderingPlugin;
use bevy::render::render_resource::{
    Extent3d, PipelineCache, TextureDimension, TextureFormat, TextureUsages,
};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::render::settings::RenderCreation;
use bevy::render::view::ViewDepthTexture;
use bevy::render::{Render, RenderApp, RenderPlugin, RenderSystems};
use bevy::time::TimeUpdateStrategy;
use bevy::window::ExitCondition;
use bevy_preshade::Derivations;
use read::Texels;
pub use read::{Drawn, covered};

/// Width and height of pictures.
pub const SIZE: u32 = 128;

#[derive(Resource, Clone, Default)]
struct Probe(Arc<Mutex<Drawn>>, Arc<Mutex<bool>>);

/// Which pre-passes a camera has.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ahead {
    pub depth: bool,
    pub normal: bool,
    pub motion: bool,
    /// Whether the picture is shifted by a part of a pixel, as for temporal antialiasing.
    pub jitter: bool,
}

impl Ahead {
    pub const DEPTH: Self = Self {
        depth: true,
        normal: false,
        motion: false,
        jitter: false,
    };

    pub const NORMAL: Self = Self {
        normal: true,
        ..Self::DEPTH
    };

    /// As for temporal antialiasing.
    pub const MOTION: Self = Self {
        motion: true,
        ..Self::DEPTH
    };

    pub const ALL: Self = Self {
        depth: true,
        normal: true,
        motion: true,
        jitter: false,
    };
}

/// Bevy without a window, whose frames are drawn when the test says so.
pub fn plugins() -> PluginGroupBuilder {
    DefaultPlugins
        .set(WindowPlugin {
            primary_window: None,
            exit_condition: ExitCondition::DontExit,
            ..default()
        })
        .set(RenderPlugin {
            synchronous_pipeline_compilation: true,
            ..default()
        })
        .disable::<PipelinedRenderingPlugin>()
}

pub struct Stage {
    pub app: App,
    probe: Probe,
}

impl Stage {
    pub fn new(ahead: Ahead, set_up: impl FnOnce(&mut App)) -> Self {
        let mut app = App::new();
        app.add_plugins(plugins());
        app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO));
        let probe = Probe::default();
        let render = app.sub_app_mut(RenderApp);
        render.insert_resource(probe.clone());
        render.add_systems(
            Render,
            take.after(RenderSystems::Render)
                .before(RenderSystems::Cleanup),
        );
        set_up(&mut app);
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
        let picture = app.world_mut().resource_mut::<Assets<Image>>().add(picture);
        let camera = app
            .world_mut()
            .spawn((
                Camera3d {
                    depth_texture_usages: (TextureUsages::RENDER_ATTACHMENT
                        | TextureUsages::TEXTURE_BINDING)
                        .into(),
                    ..default()
                },
                RenderTarget::from(picture),
                Msaa::Off,
                Tonemapping::None,
                Transform::from_xyz(1.5, 1.0, 3.0).looking_at(Vec3::ZERO, Vec3::Y),
            ))
            .id();
        let mut camera = app.world_mut().entity_mut(camera);
        if ahead.depth {
            camera.insert(DepthPrepass);
        }
        if ahead.normal {
            camera.insert(NormalPrepass);
        }
        if ahead.motion {
            camera.insert(MotionVectorPrepass);
        }
        if ahead.jitter {
            camera.insert(TemporalJitter {
                offset: Vec2::new(0.3, -0.2),
            });
        }
        app.finish();
        app.cleanup();
        Self { app, probe }
    }

    /// Draws until nothing is derived or compiled.
    pub fn settle(&mut self) {
        let mut quiet = 0;
        for _ in 0..2000 {
            self.app.update();
            let render = self.app.sub_app(RenderApp).world();
            let derivations = render.get_resource::<Derivations>();
            let pending = derivations.map_or(0, Derivations::pending);
            // The placeholder is never ready.
            let waiting = render
                .resource::<PipelineCache>()
                .waiting_pipelines()
                .count();
            quiet = if pending == 0 && waiting <= 1 {
                quiet + 1
            } else {
                0
            };
            if quiet == 6 {
                return;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        panic!("still not settled");
    }

    /// Draws frames of 100 ms, and returns what the last one drew.
    pub fn draw(&mut self, frames: u32) -> Drawn {
        let step = TimeUpdateStrategy::ManualDuration(Duration::from_millis(100));
        self.app.insert_resource(step);
        for frame in 0..frames {
            *self.probe.1.lock().unwrap() = frame + 1 == frames;
            self.app.update();
        }
        *self.probe.1.lock().unwrap() = false;
        self.app
            .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO));
        self.probe.0.lock().unwrap().clone()
    }

    /// Takes the graphics device away. Bevy makes a new one.
    pub fn lose_device(&mut self) {
        let recover: fn(&RenderError, &mut World, &mut World) -> RenderErrorPolicy =
            |_, _, _| RenderErrorPolicy::Recover(RenderCreation::default());
        self.app.insert_resource(RenderErrorHandler(recover));
        let render = self.app.sub_app(RenderApp).world();
        let device = render.resource::<RenderDevice>().wgpu_device();
        device.destroy();
        // Bevy hears of it before it draws the next frame.
        device.poll(wgpu::PollType::Poll).ok();
    }

    /// The app has a material of Bevy's own too.
    fn materials<M: Material>(&self) -> impl Iterator<Item = &MaterialProperties> {
        let world = self.app.sub_app(RenderApp).world();
        let materials = world.resource::<ErasedRenderAssets<PreparedMaterial>>();
        let own = materials
            .iter()
            .filter(|(id, _)| id.type_id() == TypeId::of::<M>());
        own.map(|(_, material)| &*material.properties)
    }

    /// Whether depth alone is drawn with the bind group of each material.
    pub fn binds_material<M: Material>(&self) -> Vec<bool> {
        let is_bound = |of: &MaterialProperties| of.get_shader(PrepassVertexShader).is_some();
        self.materials::<M>().map(is_bound).collect()
    }

    /// Whether each material has a pre-pass.
    pub fn has_prepass<M: Material>(&self) -> Vec<bool> {
        self.materials::<M>().map(|of| of.prepass_enabled).collect()
    }

    pub fn derivations(&self) -> &Derivations {
        self.app
            .sub_app(RenderApp)
            .world()
            .resource::<Derivations>()
    }
}

fn take(
    probe: Res<Probe>,
    views: Query<(
        &ViewDepthTexture,
        Option<&ViewPrepassTextures>,
        Option<&ViewShadowBindings>,
    )>,
    (device, queue): (Res<RenderDevice>, Res<RenderQueue>),
) {
    if !*probe.1.lock().unwrap() {
        return;
    }
    for (depth, ahead, shadows) in &views {
        *probe.0.lock().unwrap() = Drawn::of(&device, &queue, (depth, ahead, shadows));
    }
}

/// How many texels differ at all.
pub fn differ(a: &Texels, b: &Texels) -> usize {
    assert_eq!(a.size, b.size);
    a.values
        .iter()
        .zip(&b.values)
        .filter(|(a, b)| a != b)
        .count()
}

/// The greatest difference of a component.
pub fn greatest(a: &Texels, b: &Texels) -> f32 {
    let pairs = a.values.iter().flatten().zip(b.values.iter().flatten());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}
