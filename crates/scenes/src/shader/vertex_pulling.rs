//! Generates vertex data for a shader that fetches its vertices from a storage buffer.

use std::collections::BTreeMap;

use naga::{Expression, Handle, Module, ScalarKind, Type, TypeInner};
use preshade_passes::analysis::values::ValueId;

use super::flow::StageFlow;
use preshade_draw::scene::bind::{is_index_buffer, known_stream, stream_component};
use preshade_draw::scene::layout::{leaf_shape, runtime_array, scalar_count};
use preshade_draw::scene::{Mesh, Value};

/// A storage buffer of vertices.
pub(crate) struct Pulled {
    /// Name of the variable: a runtime-sized array, or a struct with only such an array.
    name: String,
    element: Handle<Type>,
    /// Path of members from an element to its position.
    position: Vec<u32>,
    /// Scalars per vertex, in an array of scalars.
    stride: usize,
    /// Names of the index arrays.
    indices: Vec<String>,
}

impl Pulled {
    /// The buffer that `value` is read from. `None` if its names have a known meaning, or if its
    /// layout is not supported.
    pub fn of(flow: &StageFlow<'_, '_>, value: ValueId) -> Option<Self> {
        let module = flow.values.graph.module();
        let read = flow.read(value)?;
        let global = &module.global_variables[read.global];
        let name = global.name.clone().filter(|n| !n.is_empty())?;
        let wrapped = match &module.types[global.ty].inner {
            TypeInner::Struct { members, .. } if members.len() == 1 => 1,
            TypeInner::Struct { .. } => return None,
            _ => 0,
        };
        let element = runtime_array(module, global.ty)?;
        let index = flow.behind(value);
        // A struct member is an offset or an id, but no list of indices.
        let is_list = |global: &naga::GlobalVariable| {
            let element = runtime_array(module, global.ty);
            element.is_some_and(|e| leaf_shape(&module.types[e].inner).is_some())
        };
        let mut indices: Vec<String> = index
            .iter()
            .filter(|v| flow.is_array_read(**v, &[ScalarKind::Uint, ScalarKind::Sint]))
            .map(|v| {
                flow.read(*v)
                    .map(|read| &module.global_variables[read.global])
            })
            .filter_map(|global| global.filter(|g| is_list(g))?.name.clone())
            .collect();
        indices.sort_unstable();
        indices.dedup();
        let is_struct = matches!(module.types[element].inner, TypeInner::Struct { .. });
        let is_named = known_stream(&name) == Some("position") && wrapped == 0 && !is_struct;
        if is_named && indices.iter().all(|name| is_index_buffer(name)) {
            return None;
        }
        let stride = index.iter().find_map(|v| literal_factor(flow, *v));
        Some(Self {
            name,
            element,
            position: read.members.get(wrapped..).unwrap_or_default().to_vec(),
            stride: stride.unwrap_or(3).clamp(3, 64),
            indices,
        })
    }

    /// The buffers' contents for one mesh without indices.
    pub fn values(&self, module: &Module, mesh: &Mesh) -> BTreeMap<String, Value> {
        let count = mesh.vertex_count as usize;
        let mut numbers = Vec::new();
        for vertex in 0..count {
            match module.types[self.element].inner {
                TypeInner::Scalar(_) => {
                    let streams = [("position", 3), ("normal", 3), ("uv", 2), ("color", 4)];
                    let all = streams.iter().flat_map(|(s, n)| {
                        (0..*n).map(|c| stream_component(mesh.streams.get(*s), vertex, c))
                    });
                    let padded = all.chain(std::iter::repeat(0.0));
                    numbers.extend(padded.take(self.stride));
                }
                _ => self.write(
                    module,
                    self.element,
                    &mut Vec::new(),
                    "",
                    vertex,
                    mesh,
                    &mut numbers,
                ),
            }
        }
        let of_vertex = match module.types[self.element].inner {
            TypeInner::Scalar(_) => self.stride,
            _ => scalar_count(module, self.element, 1),
        };
        if numbers.len() != count * of_vertex {
            return BTreeMap::new();
        }
        let mut values = BTreeMap::from([(self.name.clone(), Value::Numbers(numbers))]);
        for name in &self.indices {
            let numbers = (0..count).map(|i| i as f64).collect();
            values.insert(name.clone(), Value::Numbers(numbers));
        }
        values
    }

    #[expect(clippy::too_many_arguments, reason = "a recursion over a type")]
    fn write(
        &self,
        module: &Module,
        ty: Handle<Type>,
        path: &mut Vec<u32>,
        name: &str,
        vertex: usize,
        mesh: &Mesh,
        out: &mut Vec<f64>,
    ) {
        if let TypeInner::Struct { members, .. } = &module.types[ty].inner {
            for (i, member) in members.iter().enumerate() {
                path.push(i as u32);
                let name = member.name.as_deref().unwrap_or("");
                self.write(module, member.ty, path, name, vertex, mesh, out);
                path.pop();
            }
            return;
        }
        let Some((columns, rows, _)) = leaf_shape(&module.types[ty].inner) else {
            return;
        };
        let stream = match (*path == self.position, rows) {
            (true, _) => "position",
            (false, rows) => known_stream(name).unwrap_or(match rows {
                2 => "uv",
                3 => "normal",
                _ => "color",
            }),
        };
        let components = 0..(columns * rows) as usize;
        out.extend(components.map(|c| stream_component(mesh.streams.get(stream), vertex, c)));
    }
}

/// The literal that an index is multiplied by.
fn literal_factor(flow: &StageFlow<'_, '_>, value: ValueId) -> Option<usize> {
    let (context, left, right) = flow.product(value)?;
    let f = flow.values.function(context).function;
    let literal = |e: Handle<Expression>| match f.expressions[e] {
        Expression::Literal(naga::Literal::U32(n)) => Some(n as usize),
        Expression::Literal(naga::Literal::I32(n)) => usize::try_from(n).ok(),
        _ => None,
    };
    literal(left).or_else(|| literal(right))
}
