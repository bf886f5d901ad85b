//! Finds the ranges of the fragment stages' inputs. Reads the scene's frames and needs no adapter.
//!
//! Uniforms and buffers are read as the renderer fills them, in every frame. A varying is largest
//! at a vertex, because interpolation stays between the corners. The vertex stage runs on every
//! drawn vertex in every frame if that takes at most [`MOST_STEPS`]. Otherwise it runs in fewer,
//! evenly spaced frames, or on some vertices of one frame. The ranges are then widened.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use naga::{Module, TypeInner};
use naga_edit::interface;
use naga_interp::{Scalar, Value};
use preshade_dataflow::graph::Graph;
use preshade_plan::pass::{Numbers, Source, SourceRange};

use super::originals;
use super::vertices::{self, Vertices};
use preshade_draw::scene::bind::{self, DrawBindings};
use preshade_draw::scene::{Draw, Frame, Material, Scene, SceneError};
use preshade_scenes::StageFlow;

/// Steps of the interpreter over all vertices of a material.
pub(crate) const MOST_STEPS: u64 = 400_000;
/// Least number of vertices to run in a draw that has as many.
const LEAST_VERTICES: u64 = 500;
/// Times the steps that may be spent on that.
const DEAREST: u64 = 8;

/// The ranges of every varying and constant of the draw. If the vertex stage cannot be run, its
/// varyings have no bounds. Values that preshade made up, and varyings that depend on one, have
/// none either.
///
/// # Errors
///
/// A value that does not fit its variable.
pub fn ranges(scene: &Scene) -> Result<Vec<SourceRange>, SceneError> {
    let plans = originals(scene);
    let mut found = Vec::new();
    for (index, (material, plan)) in scene.materials.iter().zip(&plans).enumerate() {
        let Some(pass) = plan.main() else { continue };
        let Some((entry, point)) = material
            .program
            .entry_point(naga::ShaderStage::Vertex, &pass.vertex)
        else {
            continue;
        };
        let module = material.program.module();
        let draws: Vec<&Draw> = scene.draws.iter().filter(|d| d.material == index).collect();
        let frames: Vec<&Frame> = scene.frames().map(|(_, frame)| frame).collect();
        let mut ends = Ends::default();
        let most = MOST_STEPS / draws.len().max(1) as u64;
        let mut seen = Coverage::All;
        let mut unknown = BTreeSet::new();
        for draw in draws {
            let mut before = BTreeMap::new();
            let mut stage = None;
            let mut bound: Option<DrawBindings> = None;
            for (i, frame) in frames.iter().enumerate() {
                let bound = match &mut bound {
                    None => bound.insert(bind::draw(scene, material, pass, draw, frame)?),
                    // Values that follow no frame do not change.
                    Some(bound) => {
                        for now in bind::frame_buffers(scene, material, pass, draw, frame)? {
                            let same = |b: &&mut bind::BufferBinding| {
                                (b.group, b.binding) == (now.group, now.binding)
                            };
                            if let Some(buffer) = bound.buffers.iter_mut().find(same) {
                                *buffer = now;
                            }
                        }
                        bound
                    }
                };
                ends.add_buffers(module, bound, &mut before);
                if i == 0 {
                    unknown.extend(invented(material, entry, bound));
                }
                let is_seen = match &stage {
                    None => true,
                    Some(Ok(Sample { every, .. })) => i.is_multiple_of(*every),
                    Some(Err(_)) => false,
                };
                if !is_seen {
                    continue;
                }
                let vertices = Vertices::new(module, bound.clone(), |at| {
                    let mut read = pass.bindings.iter().filter(|b| b.visibility.vertex);
                    read.any(|b| (b.group, b.binding) == at)
                });
                let sample = match &mut stage {
                    Some(sample) => sample,
                    none => none.insert(Sample::of(&vertices, module, entry, most, frames.len())),
                };
                match sample {
                    Ok(sample) => {
                        let added = sample.vertices.iter().try_for_each(|(vertex, instance)| {
                            let (varyings, _) = vertices.run(module, entry, *vertex, *instance)?;
                            ends.add_varyings(varyings);
                            Ok::<(), String>(())
                        });
                        seen = seen.and(if added.is_ok() {
                            sample.seen
                        } else {
                            Coverage::None
                        });
                    }
                    Err(_) => seen = Coverage::None,
                }
            }
        }
        let outputs = interface::outputs(module, &point.function);
        ends.settle(seen, outputs.iter().filter_map(|o| o.binding.as_ref()));
        for source in unknown {
            ends.numbers.remove(&source);
            ends.of.insert(source, ANYTHING);
        }
        found.extend(
            ends.of
                .into_iter()
                .map(|(source, [low, high])| SourceRange {
                    material: material.name.clone(),
                    components: ends.numbers.remove(&source).unwrap_or_default(),
                    source,
                    low,
                    high,
                }),
        );
    }
    Ok(found)
}

/// The vertices that were run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Coverage {
    /// All vertices, in all frames.
    All,
    SomeFrames,
    /// Some, in one frame or more.
    SomeVertices,
    /// The vertex stage cannot be run.
    None,
}

impl Coverage {
    fn and(self, other: Self) -> Self {
        self.max(other)
    }
}

struct Sample {
    /// Vertex and instance indices.
    vertices: Vec<(u32, u32)>,
    /// Step between frames.
    every: usize,
    seen: Coverage,
}

impl Sample {
    /// # Errors
    /// Why the vertex stage cannot be run.
    fn of(
        vertices: &Vertices<'_>,
        module: &Module,
        entry: usize,
        most: u64,
        frames: usize,
    ) -> Result<Self, String> {
        let corners = 0..vertices.of_instance();
        let drawn: Option<BTreeSet<u32>> = corners
            .map(|corner| vertices::index(&vertices.bound, corner))
            .collect();
        let drawn: Vec<u32> = drawn.ok_or("the mesh is too short")?.into_iter().collect();
        let count = drawn.len() as u64 * u64::from(vertices.bound.instances);
        let (Some(first), 1..) = (drawn.first(), count) else {
            return Ok(Self {
                vertices: Vec::new(),
                every: 1,
                seen: Coverage::All,
            });
        };
        let (_, steps) = vertices.run(module, entry, *first, 0)?;
        // As if each run had its own copy, since it may write to it.
        let copied: u64 = vertices.environment.resources.values().map(numbers).sum();
        let affordable = most / (steps + copied).max(1);
        if affordable * DEAREST < LEAST_VERTICES.min(count) {
            return Err("a vertex takes too long".to_owned());
        }
        let at = |i: u64| {
            let (instance, vertex) = (i / drawn.len() as u64, i % drawn.len() as u64);
            (drawn[vertex as usize], instance as u32)
        };
        if affordable >= count {
            let every = frames.div_ceil((affordable / count) as usize).max(1);
            return Ok(Self {
                vertices: (0..count).map(at).collect(),
                every,
                seen: if every == 1 {
                    Coverage::All
                } else {
                    Coverage::SomeFrames
                },
            });
        }
        // Steps of the golden section meet no row of a grid again and again.
        let looked_at = affordable.max(LEAST_VERTICES).min(count);
        let spread = (0..looked_at).map(|i| {
            let part = (i as f64 * 0.618_033_988_749_895).fract();
            at(((part * count as f64) as u64).min(count - 1))
        });
        Ok(Self {
            vertices: spread.collect(),
            every: frames.max(1),
            seen: Coverage::SomeVertices,
        })
    }
}

/// The least and the largest of each source.
#[derive(Default)]
struct Ends {
    of: BTreeMap<Source, [f32; 2]>,
    /// The components of buffers that hold finite numbers only.
    numbers: BTreeMap<Source, Vec<Numbers>>,
}

/// The range of all finite numbers.
const ANYTHING: [f32; 2] = [f32::MIN, f32::MAX];

impl Ends {
    fn add(&mut self, source: Source, [low, high]: [f32; 2]) {
        let ends = self.of.entry(source).or_insert([low, high]);
        *ends = [ends[0].min(low), ends[1].max(high)];
    }

    fn add_part(&mut self, source: Source, part: &Value) {
        let Some(ends) = ends(part) else { return };
        let now = components(part);
        match self.numbers.get_mut(&source) {
            Some(before) if before.len() == now.len() => {
                for (before, now) in before.iter_mut().zip(now) {
                    *before = before.or(now);
                }
            }
            // Not finite, now or before.
            _ if self.of.contains_key(&source) => {
                self.numbers.remove(&source);
            }
            _ => {
                self.numbers.insert(source.clone(), now);
            }
        }
        self.add(source, ends);
    }

    fn add_varyings(&mut self, varyings: BTreeMap<u32, Value>) {
        for (location, value) in varyings {
            if let Some(ends) = ends(&value) {
                self.add(Source::Varying { location }, ends);
            }
        }
    }

    /// Buffers that equal those of `before` are skipped.
    fn add_buffers(
        &mut self,
        module: &Module,
        bound: &DrawBindings,
        before: &mut BTreeMap<(u32, u32), Arc<[u8]>>,
    ) {
        let changed: Vec<(u32, u32)> = bound
            .buffers
            .iter()
            .filter_map(|b| {
                let at = (b.group, b.binding);
                let now = &b.data.bytes;
                let same = before
                    .get(&at)
                    .is_some_and(|b| Arc::ptr_eq(b, now) || b == now);
                before.insert(at, Arc::clone(now));
                (!same).then_some(at)
            })
            .collect();
        for (_, global) in module.global_variables.iter() {
            let Some(at) = global.binding else { continue };
            if !changed.contains(&(at.group, at.binding)) {
                continue;
            }
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
                        self.add_part(source(member.name.clone()), part);
                    }
                }
                _ => self.add_part(source(None), &value),
            }
        }
    }

    /// Widens the ranges of varyings, unless all vertices were run in all frames.
    fn settle<'a>(&mut self, seen: Coverage, outputs: impl Iterator<Item = &'a naga::Binding>) {
        let by = match seen {
            Coverage::All => return,
            Coverage::SomeFrames => 0.5,
            Coverage::SomeVertices => 1.0,
            Coverage::None => {
                for output in outputs {
                    if let naga::Binding::Location { location, .. } = *output {
                        self.of.insert(Source::Varying { location }, ANYTHING);
                    }
                }
                return;
            }
        };
        for (source, [low, high]) in &mut self.of {
            if matches!(source, Source::Varying { .. }) {
                let more = by * low.abs().max(high.abs());
                (*low, *high) = ((*low - more).max(f32::MIN), (*high + more).min(f32::MAX));
            }
        }
    }
}

/// The varyings of a vertex stage, and the buffer members, that depend on a value that preshade
/// made up.
fn invented(material: &Material, entry: usize, bound: &DrawBindings) -> BTreeSet<Source> {
    let module = material.program.module();
    let attributes = bound.vertex_buffers.iter().flat_map(|b| &b.attributes);
    let attributes: BTreeSet<u32> = attributes
        .filter(|a| a.is_invented)
        .map(|a| a.location)
        .collect();
    let mut members: BTreeSet<Source> = BTreeSet::new();
    for (_, global) in module.global_variables.iter() {
        let Some(at) = global.binding else { continue };
        let is_it = |b: &&bind::BufferBinding| (b.group, b.binding) == (at.group, at.binding);
        let Some(buffer) = bound.buffers.iter().find(is_it) else {
            continue;
        };
        let source = |member| Source::Buffer {
            group: at.group,
            binding: at.binding,
            member,
        };
        match &module.types[global.ty].inner {
            TypeInner::Struct { members: all, .. } => {
                let ends = all.iter().skip(1).map(|m| m.offset as usize);
                let ends = ends.chain([buffer.data.bytes.len()]);
                let invented = all
                    .iter()
                    .zip(ends)
                    .filter(|(m, end)| buffer.is_invented(&(m.offset as usize..*end)));
                members.extend(invented.map(|(m, _)| source(m.name.clone())));
            }
            _ if buffer.invented.is_empty() => {}
            _ => {
                members.insert(source(None));
            }
        }
    }
    if attributes.is_empty() && members.is_empty() {
        return members;
    }
    let graph = Graph::build(&material.program);
    let outputs = interface::outputs(module, &module.entry_points[entry].function);
    let Some(flow) = StageFlow::new(&graph, entry) else {
        let locations = outputs.iter().filter_map(|o| location(o.binding.as_ref()));
        members.extend(locations.map(|location| Source::Varying { location }));
        return members;
    };
    let is_invented = |value: usize| {
        if let Some(input) = flow.input(value) {
            let io = flow.values.inputs.get(input);
            let at = io.and_then(|io| location(io.binding.as_ref()));
            return at.is_some_and(|at| attributes.contains(&at));
        }
        let Some(read) = flow.read(value) else {
            return false;
        };
        let global = &module.global_variables[read.global];
        let Some(at) = global.binding else {
            return false;
        };
        let member = match (&module.types[global.ty].inner, read.members.first()) {
            (TypeInner::Struct { members, .. }, Some(m)) => members[*m as usize].name.clone(),
            _ => None,
        };
        members.contains(&Source::Buffer {
            group: at.group,
            binding: at.binding,
            member,
        })
    };
    let mut varyings = Vec::new();
    for (binding, value) in flow.values.outputs() {
        if let Some(location) = location(binding.as_ref())
            && flow.behind(value).into_iter().any(is_invented)
        {
            varyings.push(Source::Varying { location });
        }
    }
    members.extend(varyings);
    members
}

fn location(binding: Option<&naga::Binding>) -> Option<u32> {
    match binding {
        Some(naga::Binding::Location { location, .. }) => Some(*location),
        _ => None,
    }
}

/// How many numbers a value holds.
fn numbers(value: &Value) -> u64 {
    match value {
        Value::Composite(parts) => parts.iter().map(numbers).sum(),
        _ => 1,
    }
}

/// The numbers of each component of a number or a vector, or all together of another value. Empty if
/// one is not finite.
fn components(value: &Value) -> Vec<Numbers> {
    fn each(value: &Value, found: &mut Vec<f32>) {
        match value {
            Value::Scalar(Scalar::F32(x)) => found.push(*x),
            Value::Composite(parts) => parts.iter().for_each(|part| each(part, found)),
            _ => {}
        }
    }
    let mut found = Vec::new();
    each(value, &mut found);
    let are_scalars = match value {
        Value::Composite(parts) => found.len() == parts.len() && parts.len() <= 4,
        _ => true,
    };
    let numbers = found.iter().copied().map(Numbers::one);
    match found.iter().all(|x| x.is_finite()) {
        false => Vec::new(),
        true if are_scalars => numbers.collect(),
        true => numbers.reduce(Numbers::or).into_iter().collect(),
    }
}

/// The least and the largest float of a value. `None`: it has none, or one of them is NaN.
fn ends(value: &Value) -> Option<[f32; 2]> {
    match value {
        Value::Scalar(Scalar::F32(x)) if x.is_finite() => Some([*x, *x]),
        Value::Scalar(Scalar::F32(_)) => Some(ANYTHING),
        Value::Composite(parts) => parts
            .iter()
            .filter_map(ends)
            .reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]),
        _ => None,
    }
}
