//! Translation validation on an adapter: runs the stages of a variant and of the original as
//! compute stages, on random and adversarial inputs.
//!
//! [`preshade_validate`] has the promises, the inputs and the judge; this module is its
//! [`Runner`]. `harness` builds a compute stage from functions that `rewrite` changed. One
//! invocation runs one input. So the adapter's compilers take part, which no interpreter models.
//! Inputs that only a draw has (interpolation, derivatives, texels) are numbers, the same for both.

mod body;
mod harness;
mod rewrite;
mod textures;

use std::collections::BTreeMap;
use std::sync::Arc;

use preshade_plan::plan::{Plan, Role};
use preshade_validate::environment::{PassStages, TestPoint};
use preshade_validate::executor::{Draw, Runner};
use preshade_validate::stage::Ran;
use preshade_validate::{By, Check, Effort};

use harness::{ENTRY, Harness, buffers, harness, value, words};
use preshade_draw::render::Gpu;

/// Compares a variant with the original that it was made of, on an adapter. `told` gets each
/// promise before its turn.
pub fn validate_on(
    gpu: &Gpu,
    original: &Plan,
    variant: &Plan,
    effort: &Effort,
    told: &dyn Fn(Role, &str),
) -> Vec<Check> {
    let by = By {
        effort,
        runner: Some(&OnAdapter(gpu)),
        told,
    };
    preshade_validate::validate_by(original, variant, by)
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
        // All inputs of a pair have the same levels.
        let levels = draws.first().map(|d| Arc::clone(&d.inputs.levels));
        let mut harness = harness(stages, place, &levels.unwrap_or_default())?;
        let mut given = [Vec::new(), Vec::new()];
        for draw in draws {
            given[0].extend(words(&harness, draw)?);
            given[1].extend(buffers(&harness, draw)?);
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
        steps: 0,
        undefined: None,
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
    given: &[Vec<u32>; 2],
    draws: usize,
) -> Result<Vec<u32>, preshade_draw::render::Error> {
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
        let inputs = given.each_ref().map(|given| {
            let usage = Usage::STORAGE | Usage::COPY_DST;
            let input = buffer((given.len() as u64 * 4).max(4), usage);
            let given: Vec<u8> = given.iter().flat_map(|word| word.to_le_bytes()).collect();
            gpu.queue.write_buffer(&input, 0, &given);
            input
        });
        let output = buffer(bytes, Usage::STORAGE | Usage::COPY_SRC);
        let read = buffer(bytes, Usage::COPY_DST | Usage::MAP_READ);
        let all = [(0, &inputs[0]), (1, &output), (2, &inputs[1])];
        // The pipeline has only the buffers that it reads.
        let own = all.iter().take(if harness.reads_buffers { 3 } else { 2 });
        let entry = own.map(|(binding, buffer)| wgpu::BindGroupEntry {
            binding: *binding,
            resource: buffer.as_entire_binding(),
        });
        let entries: Vec<_> = entry.collect();
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(what),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
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

#[cfg(test)]
mod tests {
    use naga::front::wgsl;
    use preshade_plan::program::Program;
    use preshade_validate::stage::Stage;
    use shader_text::source::{Language, SourceMap};

    use super::*;

    /// The work of compilers and of the host's checks does not grow with an array.
    #[test]
    fn a_stage_is_as_long_whatever_its_arrays() {
        let lengths = [16, 64, 512, 4096].map(|n| {
            let text = format!(
                "struct Bones {{ m: array<mat4x4f, {n}> }}
                 @group(0) @binding(0) var<uniform> bones: Bones;
                 @vertex fn vs(@location(0) p: vec4f, @location(1) j: vec4u)
                     -> @builtin(position) vec4f {{ return bones.m[j.x] * bones.m[j.y] * p; }}"
            );
            let module = wgsl::parse_str(&text).expect("it parses");
            let sources = Arc::new(SourceMap::default());
            let program = Program::new(module, sources, Language::Wgsl).expect("it is valid");
            let kind = naga::ShaderStage::Vertex;
            let stages = PassStages {
                vertex: Stage::new(&program, kind, "vs").expect("it is there"),
                fragment: None,
            };
            let made = harness(stages, TestPoint::Vertex, &Arc::default()).expect("it is made");
            let functions = made.module.functions.iter().map(|(_, f)| f);
            let entries = made.module.entry_points.iter().map(|e| &e.function);
            let all = functions.chain(entries);
            (
                all.map(|f| f.expressions.len()).sum::<usize>(),
                made.words_of_buffers,
            )
        });
        assert!(
            lengths
                .iter()
                .all(|(expressions, _)| *expressions == lengths[0].0)
        );
        assert_eq!(lengths.map(|(_, words)| words), [256, 1024, 8192, 65536]);
    }
}
