//! Many specialisations of one material: what they cost in time and memory.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use bevy::Mode;
use bevy::asset::uuid::Uuid;
use bevy::mesh::MeshVertexBufferLayoutRef;
use bevy::pbr::{MaterialPipeline, MaterialPipelineKey};
use bevy::prelude::*;
use bevy::render::render_resource::{
    AsBindGroup, RenderPipelineDescriptor, SpecializedMeshPipelineError,
};
use bevy::shader::{Shader, ShaderDefVal, ShaderRef};
use serde_json::{Value, json};

static COUNT: Mutex<u32> = Mutex::new(0);

const TEXT: &str = include_str!("many.wgsl");

fn shader() -> Handle<Shader> {
    Handle::Uuid(Uuid::from_u128(0x6d61_6e79), std::marker::PhantomData)
}

/// A material whose number is a definition in its shader.
#[derive(Asset, TypePath, AsBindGroup, Clone)]
#[bind_group_data(Number)]
struct Numbered {
    #[uniform(0)]
    amount: f32,
    number: u32,
}

#[derive(Clone, Copy, PartialEq, Eq, Hash)]
#[repr(C)]
struct Number(u32);

impl From<&Numbered> for Number {
    fn from(of: &Numbered) -> Self {
        Self(of.number)
    }
}

impl Material for Numbered {
    fn vertex_shader() -> ShaderRef {
        shader().into()
    }

    fn fragment_shader() -> ShaderRef {
        shader().into()
    }

    fn specialize(
        _: &MaterialPipeline,
        descriptor: &mut RenderPipelineDescriptor,
        _: &MeshVertexBufferLayoutRef,
        key: MaterialPipelineKey<Self>,
    ) -> Result<(), SpecializedMeshPipelineError> {
        let number = || ShaderDefVal::UInt("NUMBER".into(), key.bind_group_data.0);
        descriptor.vertex.shader_defs.push(number());
        if let Some(fragment) = &mut descriptor.fragment {
            fragment.shader_defs.push(number());
        }
        Ok(())
    }
}

fn set_up(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<Numbered>>,
    mut shaders: ResMut<Assets<Shader>>,
) {
    let Handle::Uuid(uuid, _) = shader() else {
        return;
    };
    let _ = shaders.insert(AssetId::Uuid { uuid }, Shader::from_wgsl(TEXT, "many.wgsl"));
    let mesh = meshes.add(Cuboid::from_length(0.1));
    let count = *COUNT
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner);
    for number in 0..count {
        let material = materials.add(Numbered {
            amount: 0.1,
            number,
        });
        let at = Vec3::new((number % 40) as f32, (number / 40) as f32, 0.0) * 0.15;
        commands.spawn((
            Mesh3d(mesh.clone()),
            MeshMaterial3d(material),
            Transform::from_translation(at - Vec3::new(3.0, 2.0, 0.0)),
        ));
    }
    commands.spawn((
        Camera3d::default(),
        Transform::from_xyz(0.0, 0.0, 8.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
}

fn app() {
    App::new()
        .add_plugins((DefaultPlugins, MaterialPlugin::<Numbered>::default()))
        .add_systems(Startup, set_up)
        .run();
}

/// Resident memory of this process, in megabytes.
fn resident() -> Result<f64, String> {
    let text = std::fs::read_to_string("/proc/self/status").map_err(|e| e.to_string())?;
    let line = text.lines().find(|line| line.starts_with("VmRSS:"));
    let number = line.and_then(|line| line.split_whitespace().nth(1));
    let kilobytes: f64 = number.and_then(|n| n.parse().ok()).ok_or("no VmRSS")?;
    Ok((kilobytes / 102.4).round() / 10.0)
}

/// The row of one run.
pub fn row(mode: &str, count: &str) -> Result<Value, String> {
    let count: u32 = count.parse().map_err(|_| "COUNT is a number")?;
    let which = match mode {
        "main" => Mode::Main,
        "bevy" => Mode::Bevy,
        "derived" => Mode::Derived,
        _ => return Err(format!("{mode} is not a mode")),
    };
    *COUNT
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner) = count;
    // As in an app, so that the length of frames means something.
    bevy::WAITS.store(false, std::sync::atomic::Ordering::Relaxed);
    let start = Instant::now();
    let drawn = bevy::drawn(which, app).ok_or("nothing was drawn")?;
    let mut times: Vec<Duration> = drawn.rows.iter().map(|row| row.time).collect();
    times.sort();
    let ms = |time: Duration| (time.as_secs_f64() * 1e5).round() / 100.0;
    let at = |part: f64| {
        let index = ((times.len() as f64 - 1.0) * part).max(0.0) as usize;
        times.get(index).copied().map(ms)
    };
    let frame = |part: f64| {
        let index = ((drawn.frames.len() as f64 - 1.0) * part) as usize;
        drawn.frames.get(index).copied().map(ms)
    };
    Ok(json!({
        "mode": mode,
        "count": count,
        "adapter": drawn.adapter,
        "settled": !drawn.is_pending,
        "shaders": drawn.rows.len(),
        "derivation_ms": { "median": at(0.5), "p90": at(0.9), "longest": at(1.0) },
        "text_bytes": drawn.texts.iter().map(String::len).sum::<usize>(),
        "frame_ms": { "median": frame(0.5), "p99": frame(0.99), "longest": frame(1.0) },
        "resident_mb": resident()?,
        "seconds": start.elapsed().as_secs(),
    }))
}
