//! Caches the compiled objects of a session. A search draws many frames that differ in one
//! material, or in none of their shaders.

use std::sync::{Mutex, PoisonError};

use preshade_plan::safety::Checks;

use super::Error;
use super::gpu::Gpu;

/// The compiled objects so far, by content.
#[derive(Debug, Default)]
pub(super) struct Compiled {
    shaders: Memo<(String, Checks), wgpu::ShaderModule>,
    pub layouts: Memo<Vec<wgpu::BindGroupLayoutEntry>, wgpu::BindGroupLayout>,
    pub render: Memo<RenderKey, wgpu::RenderPipeline>,
    pub compute: Memo<ComputeKey, wgpu::ComputePipeline>,
}

/// A shader module and an entry point.
pub(super) type StageKey = (wgpu::ShaderModule, String);

/// Everything that a render pipeline is built from.
#[derive(Debug, PartialEq)]
pub(super) struct RenderKey {
    pub vertex: StageKey,
    pub fragment: Option<StageKey>,
    pub layouts: Vec<Option<wgpu::BindGroupLayout>>,
    pub immediates: u32,
    pub buffers: Vec<VertexLayout>,
    pub primitive: wgpu::PrimitiveState,
    pub depth_stencil: Option<wgpu::DepthStencilState>,
    pub multisample: wgpu::MultisampleState,
    pub targets: Vec<Option<wgpu::ColorTargetState>>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct VertexLayout {
    /// Index of the vertex buffer. Those of the previous frame follow the draw's own.
    pub source: usize,
    pub stride: u64,
    pub step: wgpu::VertexStepMode,
    pub attributes: Vec<wgpu::VertexAttribute>,
}

/// Everything that a compute pipeline is built from.
#[derive(Debug, PartialEq)]
pub(super) struct ComputeKey {
    pub stage: StageKey,
    pub layouts: Vec<Option<wgpu::BindGroupLayout>>,
    pub immediates: u32,
}

/// Values by key, in a list: pipeline states have no order and no hash, and a session has a few
/// hundred.
#[derive(Debug)]
pub(super) struct Memo<K, V>(Mutex<Vec<(K, V)>>);

impl<K, V> Default for Memo<K, V> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

/// The value of `key`, from `memo` if it holds one. Otherwise makes it.
pub(super) fn shared<K: PartialEq, V: Clone>(
    memo: Option<&Memo<K, V>>,
    key: impl FnOnce() -> K,
    make: impl FnOnce() -> Result<V, Error>,
) -> Result<V, Error> {
    let Some(Memo(memo)) = memo else {
        return make();
    };
    let key = key();
    let mut known = memo.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, value)) = known.iter().find(|(k, _)| *k == key) {
        return Ok(value.clone());
    }
    let value = make()?;
    known.push((key, value.clone()));
    Ok(value)
}

/// The module for a WGSL text, compiled with the checks that it needs.
pub(super) fn shader(
    gpu: &Gpu,
    compiled: Option<&Compiled>,
    label: &str,
    (text, needed): (&str, Checks),
) -> Result<wgpu::ShaderModule, Error> {
    let make = || {
        gpu.checked(&format!("the shader `{label}`"), || {
            gpu.shader(
                needed,
                wgpu::ShaderModuleDescriptor {
                    label: Some(label),
                    source: wgpu::ShaderSource::Wgsl(text.into()),
                },
            )
        })
    };
    shared(
        compiled.map(|c| &c.shaders),
        || (text.to_owned(), needed),
        make,
    )
}
