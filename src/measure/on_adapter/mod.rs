//! Translation validation on an adapter: runs the stages of a variant and of the original as
//! compute stages, on random and adversarial inputs.
//!
//! [`preshade_passes::validate`] has the promises, the inputs and the judge; this module is its
//! [`Runner`]. `harness` builds a compute stage from functions that `rewrite` changed. One
//! invocation runs one input. So the adapter's compilers take part, which no interpreter models.
//! Inputs that only a draw has (interpolation, derivatives, texels) are numbers, the same for both.

mod body;
mod harness;
mod rewrite;

use std::collections::BTreeMap;
use std::sync::Arc;

use preshade_passes::plan::Plan;
use preshade_passes::validate::elsewhere::{Draw, Runner};
use preshade_passes::validate::stage::Ran;
use preshade_passes::validate::world::{PassStages, TestPoint};
use preshade_passes::validate::{self, Check, Effort};

use crate::render::Gpu;
use harness::{ENTRY, Harness, harness, value, words};

/// Holds a variant against the original it was made of, on an adapter.
pub fn validate_on(gpu: &Gpu, original: &Plan, variant: &Plan, effort: &Effort) -> Vec<Check> {
    validate::validate_on(&OnAdapter(gpu), original, variant, effort)
}

/// Runs stages on an adapter.
#[derive(Debug)]
pub struct OnAdapter<'a>(pub &'a Gpu);

impl Runner for OnAdapter<'_> {
    fn run(
        &self,
        stages: PassStages<'_>,
        place: TestPoint,
        draws: &[Draw<'_>],
    ) -> Result<Vec<Ran>, String> {
        // Nothing is drawn but depth.
        if stages.fragment.is_none() && place != TestPoint::Vertex {
            return Ok(draws.iter().map(|_| nothing()).collect());
        }
        // Those of a pair are the same in all its inputs.
        let levels = draws.first().map(|d| Arc::clone(&d.inputs.levels));
        let mut harness = harness(stages, place, &levels.unwrap_or_default())?;
        let mut given = Vec::new();
        for draw in draws {
            given.extend(words(&harness, draw)?);
        }
        let left = dispatch(self.0, &harness, &given, draws.len()).map_err(|e| e.to_string())?;
        let left = left.chunks_exact(harness.words_out.max(1) as usize);
        left.map(|words| told(&mut harness, words)).collect()
    }
}

fn nothing() -> Ran {
    Ran {
        outputs: BTreeMap::new(),
        discarded: false,
        stored: BTreeMap::new(),
        flips: 0,
    }
}

fn told(harness: &mut Harness, words: &[u32]) -> Result<Ran, String> {
    let mut words = words.iter().copied();
    let discarded = words.next().ok_or("it left no words")? != 0;
    let mut ran = Ran {
        discarded,
        ..nothing()
    };
    for (slot, ty) in &harness.outputs {
        let value = value(&mut harness.source, *ty, &mut words)?;
        ran.outputs.insert(*slot, value);
    }
    Ok(ran)
}

/// The words that all draws leave.
fn dispatch(
    gpu: &Gpu,
    harness: &Harness,
    given: &[u32],
    draws: usize,
) -> Result<Vec<u32>, crate::render::Error> {
    let what = "a stage as a compute stage";
    let bytes = (harness.words_out as usize * draws * 4).max(4) as u64;
    let (encoder, read) = gpu.checked(what, || {
        let device = &gpu.device;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(what),
            source: wgpu::ShaderSource::Naga(std::borrow::Cow::Owned(harness.module.clone())),
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(what),
            layout: None,
            module: &module,
            entry_point: Some(ENTRY),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        let buffer = |size: u64, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(what),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        use wgpu::BufferUsages as Usage;
        let input = buffer(
            (given.len() as u64 * 4).max(4),
            Usage::STORAGE | Usage::COPY_DST,
        );
        let given: Vec<u8> = given.iter().flat_map(|word| word.to_le_bytes()).collect();
        gpu.queue.write_buffer(&input, 0, &given);
        let output = buffer(bytes, Usage::STORAGE | Usage::COPY_SRC);
        let read = buffer(bytes, Usage::COPY_DST | Usage::MAP_READ);
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(what),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: input.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: output.as_entire_binding(),
                },
            ],
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(draws as u32, 1, 1);
        }
        encoder.copy_buffer_to_buffer(&output, 0, &read, 0, bytes);
        (encoder, read)
    })?;
    gpu.submit(what, encoder)?;
    let bytes = gpu.read_buffer(&read)?;
    let words = bytes.chunks_exact(4);
    Ok(words
        .map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
        .collect())
}
