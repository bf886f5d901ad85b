//! A made-up draw: a triangle with the buffers and the id from which a pass of the visibility
//! buffer reads it, as the draw table describes them ([`preshade_plan::draw_table`]).
//!
//! Each seed has another layout: with and without indices, other offsets and strides, attributes
//! that step by instance, other draws before and after it. Words that the draw does not use are
//! random, so that a wrong offset shows.

use std::collections::BTreeMap;

use naga::{Binding, BuiltIn, Module};

use super::inputs::{Inputs, Random};
use super::stage::{Slot, Stage};
use naga_edit::interface::Io;
use naga_interp::{Number, Scalar, Value, from_bytes};
use preshade_plan::draw_table::{self, Entry, IDS, Words};
use preshade_plan::geometry::Stream;
use preshade_plan::plan::{BindingSource, BindingUse, GeometryPart, Plan};
use preshade_plan::state::CullMode;

/// Width and height of the target in pixels.
const SIDE: usize = 8;

/// A texel of the id texture.
pub(super) type Id = [u32; 4];

pub(super) struct Drawn<'a> {
    inputs: &'a Inputs,
    vertex: Stage<'a>,
    /// The triangle's number in its draw.
    pub(super) triangle: u32,
    pub(super) vertices: [u32; 3],
    pub(super) instance: u32,
    /// The front faces the viewer.
    pub(super) is_front: bool,
    /// A pixel that it covers.
    pub(super) pixel: [u32; 2],
    /// The draw's entry, without its attributes.
    pub(super) entry: Entry,
    indices: Vec<u32>,
    table: Vec<u32>,
    /// An id of another draw, or of none.
    pub(super) other: Id,
}

impl<'a> Drawn<'a> {
    /// The draw of a seed. With `is_plain`, vertices are numbered without indices from 0.
    pub(super) fn new(
        inputs: &'a Inputs,
        vertex: Stage<'a>,
        plan: &Plan,
        cull: CullMode,
        is_plain: bool,
    ) -> Self {
        let mut random = Random::new(inputs.seed, "draw");
        let mut below = |n: u32| random.below(n as usize) as u32;
        let instance = (inputs.seed % 3) as u32;
        let first_instance = below(instance + 1);
        let instances = instance - first_instance + 1 + below(3);
        let (triangle, after) = (below(5), below(3));
        let first = if is_plain { 0 } else { below(4) };
        let index_bytes = if is_plain { 0 } else { 2 * below(3) };
        let base_vertex = below(5) as i32 - 2;
        let ours = first + 3 * triangle;
        // Three vertices that differ, in any order.
        let turn = below(3);
        let mut numbers = vec![0; (ours + 3 * (1 + after)) as usize];
        for (at, number) in (0..).zip(&mut numbers) {
            *number = 2 + 4 * ((at + turn) % 3) + below(4);
        }
        let moved = |index: u32| index.wrapping_add_signed(base_vertex);
        let at = [ours, ours + 1, ours + 2];
        let (vertices, count) = match index_bytes {
            0 => (at, ours + 3),
            _ => {
                let most = numbers.iter().max().copied().unwrap_or_default();
                (at.map(|at| moved(numbers[at as usize])), moved(most) + 1)
            }
        };
        let indices = match index_bytes {
            2 => numbers.chunks(2).map(two_in_a_word).collect(),
            _ => numbers,
        };
        let before: Vec<u32> = (0..below(3)).map(|_| 1 + below(3)).collect();
        let behind: Vec<u32> = (0..below(2)).map(|_| 1 + below(3)).collect();
        let number = before.len();
        let draws = [&before[..], &[instances], &behind].concat();
        let first_ids = draw_table::first_ids(draws.iter().copied()).unwrap_or_default();
        let ids = plan.attachment(IDS).map(|a| &a.format);
        let is_word = ids == Some(&Words::One.format());
        let triangles = 1 + triangle + after;
        let of_draws = draws.iter().map(|instances| (*instances, triangles));
        let bits = draw_table::triangle_bits(of_draws).filter(|_| is_word);
        let bits = bits.unwrap_or(0);
        let neighbour = match number {
            0 => first_ids.get(1),
            _ => first_ids.first(),
        };
        let other = neighbour.map_or(0, |first| 1 + first);
        Self {
            inputs,
            vertex,
            triangle,
            vertices,
            instance,
            is_front: match cull {
                CullMode::None => below(2) == 0,
                CullMode::Back => true,
                CullMode::Front => false,
            },
            pixel: [below(SIDE as u32), below(SIDE as u32)],
            entry: Entry {
                first_id: first_ids.get(number).copied().unwrap_or_default(),
                instances,
                first_instance,
                number: number as u32,
                first,
                index_bytes,
                base_vertex,
                triangle_bits: bits,
                viewport: [0.0, 0.0, SIDE as f32, SIDE as f32],
                vertices: count,
                streams: Vec::new(),
            },
            indices,
            table: draw_table::table(bits, &first_ids),
            other: [other << bits, 0, 0, 1],
        }
    }

    /// The centre of its pixel.
    pub(super) fn center(&self) -> [f32; 2] {
        self.pixel.map(|at| at as f32 + 0.5)
    }

    /// An input of the original's vertex stage at a corner.
    pub(super) fn attribute(&self, module: &Module, io: &Io, corner: usize) -> Option<Value> {
        match Slot::of(io.binding.as_ref()?) {
            Slot::BuiltIn(BuiltIn::VertexIndex) => Some(Value::u32(self.vertices[corner])),
            Slot::BuiltIn(BuiltIn::InstanceIndex) => Some(Value::u32(self.instance)),
            Slot::Location(location, _) if self.is_by_instance(location) => {
                self.inputs.attribute(module, io, 0)
            }
            _ => self.inputs.attribute(module, io, corner),
        }
    }

    fn is_by_instance(&self, location: u32) -> bool {
        let of = format!("step of location {location}");
        Random::new(self.inputs.seed, &of).below(4) == 0
    }

    /// The contents of the bindings that read the draw, its id or the draw table.
    ///
    /// # Errors
    ///
    /// A message: the draw lacks one of them.
    pub(super) fn resources<F: Number>(
        &self,
        bindings: &[BindingUse],
        module: &Module,
        id: Id,
    ) -> Result<BTreeMap<(u32, u32), Value<F>>, String> {
        let mut filled = BTreeMap::new();
        for binding in bindings {
            let at = (binding.group, binding.binding);
            let value = match &binding.source {
                BindingSource::Attachment { name } if name == IDS => self.texture(id),
                BindingSource::Geometry { part } => match part {
                    GeometryPart::Draw { streams, .. } => self
                        .uniform(module, at, streams)
                        .ok_or("the draw's entry has another layout")?,
                    GeometryPart::Indices => words(&self.indices),
                    GeometryPart::Attribute(attribute) => {
                        let stream = self.stream(attribute.location);
                        words(&stream.ok_or("an attribute is not the original's")?.1)
                    }
                    GeometryPart::DrawTable => words(&self.table),
                    _ => continue,
                },
                _ => continue,
            };
            filled.insert(at, value);
        }
        Ok(filled)
    }

    /// The id texture: ids are 0 at other pixels.
    fn texture<F: Number>(&self, id: Id) -> Value<F> {
        let texel = |x: usize, y: usize| match [x as u32, y as u32] == self.pixel {
            true => words(&id),
            false => words(&[0; 4]),
        };
        let row = |y| Value::Composite((0..SIDE).map(|x| texel(x, y)).collect());
        let side = || Value::u32(SIDE as u32);
        let rows = Value::Composite((0..SIDE).map(row).collect());
        Value::Composite(vec![side(), side(), Value::u32(1), rows])
    }

    /// The draw's entry with these attributes, as the type of the variable at a binding.
    fn uniform<F: Number>(
        &self,
        module: &Module,
        (group, binding): (u32, u32),
        locations: &[u32],
    ) -> Option<Value<F>> {
        let mut entry = self.entry.clone();
        for location in locations {
            entry.streams.push(self.stream(*location)?.0);
        }
        let words = entry.words()?.into_iter();
        let bytes: Vec<u8> = words.flat_map(u32::to_le_bytes).collect();
        let is_it = |b: naga::ResourceBinding| (b.group, b.binding) == (group, binding);
        let mut globals = module.global_variables.iter();
        let (_, global) = globals.find(|(_, g)| g.binding.is_some_and(is_it))?;
        from_bytes(module, global.ty, &bytes)
    }

    /// The vertex buffer of an attribute.
    fn stream(&self, location: u32) -> Option<(Stream, Vec<u32>)> {
        let inputs = self.vertex.inputs();
        let is_it = |io: &&Io| matches!(io.binding, Some(Binding::Location { location: l, .. }) if l == location);
        let io = inputs.iter().find(is_it)?;
        let module = self.vertex.module();
        let mut random = Random::new(self.inputs.seed, &format!("stream {location}"));
        let scalar = module.types[io.ty].inner.scalar_kind()?;
        let kind = match scalar {
            naga::ScalarKind::Float => "float32",
            naga::ScalarKind::Sint => "sint32",
            naga::ScalarKind::Uint => "uint32",
            _ => return None,
        };
        let by_instance = self.is_by_instance(location);
        let [a, b, c] = [0, 1, 2].map(|corner| self.attribute(module, io, corner));
        let mut corners = Vec::new();
        for (corner, value) in [a, b, c].into_iter().enumerate() {
            let mut words = Vec::new();
            flatten(&value?, &mut words);
            let at = match by_instance {
                true => self.instance,
                false => self.vertices[corner],
            };
            corners.push((at as usize, words));
        }
        let count = corners[0].1.len();
        let offset = random.below(4);
        let stride = count + random.below(3);
        let Entry {
            first_instance,
            instances,
            vertices,
            ..
        } = self.entry;
        let elements = match by_instance {
            true => first_instance + instances,
            false => vertices,
        };
        let length = offset + stride * elements as usize;
        let mut words: Vec<u32> = (0..length)
            .map(|_| match kind {
                "float32" => (random.unit() * 4.0 - 2.0).to_bits(),
                _ => random.below(9) as u32,
            })
            .collect();
        for (at, values) in corners {
            let at = offset + at * stride;
            words.get_mut(at..at + count)?.copy_from_slice(&values);
        }
        let format = match count {
            1 => kind.to_owned(),
            n => format!("{kind}x{n}"),
        };
        let stream = Stream {
            offset: 4 * offset as u32,
            stride: 4 * stride as u32,
            format,
            by_instance,
        };
        Some((stream, words))
    }

    /// The draw as text, in addition to the inputs of the original.
    pub(super) fn as_text(&self) -> Vec<(String, String)> {
        let of = |name: &str, value: String| (name.to_owned(), value);
        let inputs = self.vertex.inputs();
        let stepping = inputs.iter().filter_map(|io| match io.binding {
            Some(Binding::Location { location, .. }) if self.is_by_instance(location) => {
                Some(location)
            }
            _ => None,
        });
        let stepping: Vec<u32> = stepping.collect();
        vec![
            of("the draw's entry", format!("{:?}", self.entry)),
            of("the triangle", self.triangle.to_string()),
            of("its vertices", format!("{:?}", self.vertices)),
            of("the instance", self.instance.to_string()),
            of("the pixel", format!("{:?}", self.pixel)),
            of("the front is seen", self.is_front.to_string()),
            of(
                "locations that step by instance, with vertex 0's value",
                format!("{stepping:?}"),
            ),
        ]
    }
}

fn two_in_a_word(indices: &[u32]) -> u32 {
    indices[0] | indices.get(1).map_or(0, |index| index << 16)
}

pub(super) fn words<F: Number>(words: &[u32]) -> Value<F> {
    Value::Composite(words.iter().map(|word| Value::u32(*word)).collect())
}

/// The words of a value in a buffer.
fn flatten(value: &Value, words: &mut Vec<u32>) {
    match value {
        Value::Scalar(Scalar::F32(x)) => words.push(x.to_bits()),
        Value::Scalar(Scalar::I32(x)) => words.push(*x as u32),
        Value::Scalar(Scalar::U32(x)) => words.push(*x),
        Value::Composite(parts) => parts.iter().for_each(|part| flatten(part, words)),
        _ => {}
    }
}
