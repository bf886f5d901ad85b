//! Between which numbers the fragment stages' inputs lie, read off a scene's own frames: no adapter is asked.
//!
//! Uniforms and buffers are read as the renderer fills them. Varyings are largest at vertices, for what is interpolated lies between: the vertex stage is run on them, on all
//! of them where that takes no longer than a step limit, or else on as many as it may take, evenly; the range is then widened by half its width to either side.

use std::collections::BTreeMap;

use naga::{Module, TypeInner};
use preshade_passes::evaluate::{Scalar, Value};
use preshade_passes::pass::{Source, SourceRange};

use super::originals;
use super::vertices::{self, Vertices};
use crate::scene::bind;
use crate::scene::{Error, Scene};

/// Steps of the interpreter over all vertices of a material.
const MOST_STEPS: u64 = 150_000;

/// Where every varying and every constant of the draw lies, in all frames of all cameras. Nothing is told of a material whose vertex stage cannot be run: it samples
/// a texture, say.
///
/// # Errors
/// A value that does not fit its variable.
pub fn ranges(scene: &Scene) -> Result<Vec<SourceRange>, Error> {
    let plans = originals(scene);
    let mut found = Vec::new();
    for (index, (material, plan)) in scene.materials.iter().zip(&plans).enumerate() {
        let Some(pass) = plan.main() else { continue };
        let Some((vertex, _)) = material
            .program
            .entry_point(naga::ShaderStage::Vertex, &pass.vertex)
        else {
            continue;
        };
        let module = material.program.module();
        let mut ends = Ends::default();
        let draws: Vec<_> = scene.draws.iter().filter(|d| d.material == index).collect();
        let frames = scene.frames().count().max(1);
        let steps = MOST_STEPS / (draws.len().max(1) * frames) as u64;
        let (mut is_known, mut is_complete) = (true, true);
        for draw in draws {
            for (_, frame) in scene.frames() {
                let bound = bind::draw(scene, material, pass, draw, frame)?;
                ends.add_buffers(module, &bound);
                let vertices = Vertices::new(module, bound);
                match ends.add_varyings(&vertices, module, vertex, steps) {
                    Ok(all) => is_complete &= all,
                    Err(_) => is_known = false,
                }
            }
        }
        if !is_known {
            continue;
        }
        if !is_complete {
            ends.widen_varyings();
        }
        found.extend(ends.0.into_iter().map(|(source, [low, high])| SourceRange {
            material: material.name.clone(),
            source,
            low,
            high,
        }));
    }
    Ok(found)
}

/// The least and the largest of each source.
#[derive(Default)]
struct Ends(BTreeMap<Source, [f32; 2]>);

impl Ends {
    fn add(&mut self, source: Source, value: &Value) {
        match value {
            Value::Scalar(Scalar::F32(x)) => {
                let [low, high] = self
                    .0
                    .entry(source)
                    .or_insert([f32::INFINITY, f32::NEG_INFINITY]);
                match x.is_nan() {
                    // Nothing is known of what it makes.
                    true => (*low, *high) = (f32::NEG_INFINITY, f32::INFINITY),
                    false => (*low, *high) = (low.min(*x), high.max(*x)),
                }
            }
            Value::Composite(parts) => parts.iter().for_each(|p| self.add(source.clone(), p)),
            _ => {}
        }
    }

    fn add_buffers(&mut self, module: &Module, bound: &bind::DrawBindings) {
        for (_, global) in module.global_variables.iter() {
            let Some(at) = global.binding else { continue };
            let Some(value) = vertices::resource(module, global, bound) else {
                continue;
            };
            let source = |member| Source::Buffer {
                group: at.group,
                binding: at.binding,
                member,
            };
            match (&module.types[global.ty].inner, &value) {
                (TypeInner::Struct { members, .. }, Value::Composite(parts)) => {
                    for (member, part) in members.iter().zip(parts) {
                        self.add(source(member.name.clone()), part);
                    }
                }
                _ => self.add(source(None), &value),
            }
        }
    }

    fn widen_varyings(&mut self) {
        for (source, [low, high]) in &mut self.0 {
            if matches!(source, Source::Varying { .. }) {
                let half = (*high - *low) / 2.0;
                (*low, *high) = (*low - half, *high + half);
            }
        }
    }

    /// Whether that were all vertices.
    ///
    /// # Errors
    /// Why the vertex stage cannot be run.
    fn add_varyings(
        &mut self,
        vertices: &Vertices<f32>,
        module: &Module,
        entry: usize,
        most: u64,
    ) -> Result<bool, String> {
        let each = u64::from(vertices.of_instance());
        let count = each * u64::from(vertices.bound.instances);
        let mut at = |i: u64| -> Result<u64, String> {
            let (instance, corner) = ((i / each) as u32, (i % each) as u32);
            let vertex = vertices::index(&vertices.bound, corner).ok_or("the mesh is too short")?;
            let (varyings, steps) = vertices.run(module, entry, vertex, instance)?;
            for (location, value) in varyings {
                self.add(Source::Varying { location }, &value);
            }
            Ok(steps)
        };
        if count == 0 {
            return Ok(true);
        }
        let looked_at = (most / at(0)?.max(1)).clamp(1, count);
        (1..looked_at).try_for_each(|i| at(i * count / looked_at).map(drop))?;
        Ok(looked_at == count)
    }
}
