//! The vertex stage of a draw, run by the interpreter.

use std::collections::BTreeMap;
use std::sync::Arc;

use naga::{GlobalVariable, Module};
use naga_interp::{Environment, Number, RunResult, Stuck, Value, bound};

use preshade_draw::scene::bind::DrawBindings;

/// Steps of the interpreter for one vertex.
pub const STEPS: u64 = 200_000;

/// The inputs of a vertex stage.
pub struct Vertices<'e, F: 'static = f32> {
    pub bound: DrawBindings,
    /// Its uniforms and buffers. Texels are unknown at first, and so is everything that depends on
    /// them.
    pub environment: Environment<'e, F>,
}

impl<F: Number> Vertices<'_, F> {
    /// The inputs for a draw with this vertex stage, limited to the bindings that `reads` accepts.
    pub fn new(module: &Module, bound: DrawBindings, reads: impl Fn((u32, u32)) -> bool) -> Self {
        let mut resources = resources(module, &bound);
        resources.retain(|at, _| reads(*at));
        Self {
            environment: Environment {
                resources: resources.into(),
                texture: &|_: &naga_interp::Lookup<'_, F>| [F::of(f32::NAN); 4],
                derivative: None,
                trace: None,
                steps: STEPS,
            },
            bound,
        }
    }
}

impl<F: Number> Vertices<'_, F> {
    /// Fills in arrays of any length.
    pub fn add_arrays(&mut self, module: &Module) {
        let arrays = of_any_length(module, &self.bound);
        Arc::make_mut(&mut self.environment.resources).extend(arrays);
    }

    /// The clip position at a vertex.
    ///
    /// # Errors
    ///
    /// Why the vertex stage cannot be run, in a user's words.
    pub fn position(
        &self,
        module: &Module,
        entry: usize,
        vertex: u32,
        instance: u32,
    ) -> Result<[F; 4], String> {
        let outcome = self.outcome(module, entry, vertex, instance)?;
        let mut outputs = outputs(module, &module.entry_points[entry].function, outcome);
        let is_position = |binding: &_| {
            matches!(
                binding,
                naga::Binding::BuiltIn(naga::BuiltIn::Position { .. })
            )
        };
        let position = outputs.find(|(binding, _)| is_position(binding));
        let floats = position.and_then(|(_, value)| value.floats().ok());
        floats
            .and_then(|floats| floats.try_into().ok())
            .ok_or_else(|| "it returns no position".to_owned())
    }
}

impl<F: Number> Vertices<'_, F> {
    /// Vertices of one instance, each as often as it is drawn.
    pub fn of_instance(&self) -> u32 {
        self.bound.call.count
    }

    /// The varyings at a vertex, by location, and the steps it took. Instances count from the first
    /// one drawn.
    ///
    /// # Errors
    ///
    /// Why the vertex stage cannot be run, in a user's words.
    pub fn run(
        &self,
        module: &Module,
        entry: usize,
        vertex: u32,
        instance: u32,
    ) -> Result<(BTreeMap<u32, Value<F>>, u64), String> {
        let outcome = self.outcome(module, entry, vertex, instance)?;
        let steps = outcome.steps;
        let by_location = |(binding, value)| match binding {
            naga::Binding::Location { location, .. } => Some((location, value)),
            naga::Binding::BuiltIn(_) => None,
        };
        let outputs = outputs(module, &module.entry_points[entry].function, outcome);
        Ok((outputs.filter_map(by_location).collect(), steps))
    }

    fn outcome(
        &self,
        module: &Module,
        entry: usize,
        vertex: u32,
        instance: u32,
    ) -> Result<RunResult<F>, String> {
        let function = &module.entry_points[entry].function;
        let instance = self.bound.call.first_instance + instance;
        let arguments = function
            .arguments
            .iter()
            .map(|a| {
                let value = self.input(module, a.ty, a.binding.as_ref(), vertex, instance);
                value.as_ref().map(bound::exactly)
            })
            .collect::<Option<Vec<_>>>()
            .ok_or("an input of the vertex stage cannot be read")?;
        naga_interp::entry_point(module, entry, &arguments, &self.environment).map_err(said)
    }

    /// The value of an input at a vertex of an instance. `None`: the draw has none.
    pub fn input(
        &self,
        module: &naga::Module,
        ty: naga::Handle<naga::Type>,
        binding: Option<&naga::Binding>,
        vertex: u32,
        instance: u32,
    ) -> Option<Value> {
        match (binding, &module.types[ty].inner) {
            (None, naga::TypeInner::Struct { members, .. }) => {
                let members = members.iter();
                let values =
                    members.map(|m| self.input(module, m.ty, m.binding.as_ref(), vertex, instance));
                values.collect::<Option<_>>().map(Value::Composite)
            }
            (Some(naga::Binding::BuiltIn(naga::BuiltIn::VertexIndex)), _) => {
                Some(Value::u32(vertex))
            }
            (Some(naga::Binding::BuiltIn(naga::BuiltIn::InstanceIndex)), _) => {
                Some(Value::u32(instance))
            }
            (Some(naga::Binding::Location { location, .. }), inner) => {
                self.attribute(*location, inner, vertex, instance)
            }
            _ => None,
        }
    }

    /// An attribute of 32-bit numbers, widened to its type as WebGPU does: by 0, and 1 for the fourth.
    fn attribute(
        &self,
        location: u32,
        inner: &naga::TypeInner,
        vertex: u32,
        instance: u32,
    ) -> Option<Value> {
        let (buffer, attribute) = self.bound.vertex_buffers.iter().find_map(|b| {
            let found = b.attributes.iter().find(|a| a.location == location)?;
            Some((b, found))
        })?;
        let row = match buffer.step {
            wgpu::VertexStepMode::Instance => instance,
            _ => vertex,
        };
        let (count, scalar) = match inner {
            naga::TypeInner::Scalar(s) => (1, *s),
            naga::TypeInner::Vector { size, scalar } => (*size as usize, *scalar),
            _ => return None,
        };
        let name = format!("{:?}", attribute.format);
        let given = (attribute.format.size() / 4) as usize;
        if !["Float32", "Uint32", "Sint32"]
            .iter()
            .any(|kind| name.starts_with(kind))
        {
            return None;
        }
        let start = u64::from(row) * buffer.stride + attribute.offset;
        let bytes = buffer.data.bytes.get(usize::try_from(start).ok()?..)?;
        let components = (0..count).map(|i| {
            let missing = if i == 3 { 1.0_f32 } else { 0.0 };
            let word: [u8; 4] = *bytes.get(4 * i..)?.first_chunk()?;
            Some(match scalar.kind {
                naga::ScalarKind::Float if i < given => Value::f32(f32::from_le_bytes(word)),
                naga::ScalarKind::Float => Value::f32(missing),
                naga::ScalarKind::Uint if i < given => Value::u32(u32::from_le_bytes(word)),
                naga::ScalarKind::Sint if i < given => Value::i32(i32::from_le_bytes(word)),
                naga::ScalarKind::Uint => Value::u32(missing as u32),
                naga::ScalarKind::Sint => Value::i32(missing as i32),
                _ => return None,
            })
        });
        let components = components.collect::<Option<Vec<_>>>()?;
        match components.as_slice() {
            [one] => Some(one.clone()),
            _ => Some(Value::Composite(components)),
        }
    }
}

/// The outputs with their bindings.
fn outputs<F: Number>(
    module: &Module,
    function: &naga::Function,
    outcome: RunResult<F>,
) -> impl Iterator<Item = (naga::Binding, Value<F>)> {
    let values = match outcome.result {
        Some(Value::Composite(parts))
            if function
                .result
                .as_ref()
                .is_some_and(|r| r.binding.is_none()) =>
        {
            parts
        }
        Some(one) => vec![one],
        None => Vec::new(),
    };
    let outputs = naga_edit::interface::outputs(module, function).into_iter();
    outputs
        .zip(values)
        .filter_map(|(output, value)| Some((output.binding?, value)))
}

/// Why an evaluation stopped, in a user's words.
pub fn said(stuck: Stuck) -> String {
    match stuck {
        Stuck::Undecided(_) => {
            "what a branch or an index depends on differs within a triangle, or by a rounding"
                .to_owned()
        }
        Stuck::Steps => "it takes too many steps".to_owned(),
        Stuck::Unsupported(what) => {
            let name: String = what
                .chars()
                .take_while(char::is_ascii_alphanumeric)
                .collect();
            format!("`{name}` is not bounded")
        }
        other => other.to_string(),
    }
}

/// The uniforms and buffers of a draw that have a value.
pub fn resources<F: Number>(
    module: &Module,
    bound: &DrawBindings,
) -> BTreeMap<(u32, u32), Value<F>> {
    let globals = module.global_variables.iter();
    globals
        .filter_map(|(_, global)| {
            let at = global.binding.as_ref()?;
            Some(((at.group, at.binding), resource(module, global, bound)?))
        })
        .collect()
}

/// The value of a buffer variable in a draw. `None`: it is no buffer.
pub fn resource<F: Number>(
    module: &Module,
    global: &GlobalVariable,
    bound: &DrawBindings,
) -> Option<Value<F>> {
    naga_interp::from_bytes(module, global.ty, bytes_of(global, bound)?)
}

/// The content of a buffer variable in a draw.
fn bytes_of<'b>(global: &GlobalVariable, bound: &'b DrawBindings) -> Option<&'b [u8]> {
    let at = global.binding.as_ref()?;
    let at = (at.group, at.binding);
    let buffer = bound.buffers.iter().find(|b| (b.group, b.binding) == at)?;
    Some(&buffer.data.bytes)
}

/// Runtime-sized arrays get as many elements as their buffer has bytes for.
pub fn of_any_length<F: Number>(
    module: &Module,
    bound: &DrawBindings,
) -> BTreeMap<(u32, u32), Value<F>> {
    let globals = module.global_variables.iter();
    globals
        .filter_map(|(_, global)| {
            let at = global.binding.as_ref().map(|b| (b.group, b.binding))?;
            let naga::TypeInner::Array {
                base,
                size: naga::ArraySize::Dynamic,
                stride,
            } = module.types[global.ty].inner
            else {
                return None;
            };
            let elements = bytes_of(global, bound)?.chunks_exact(stride as usize);
            let elements = elements.map(|bytes| naga_interp::from_bytes(module, base, bytes));
            Some((at, Value::Composite(elements.collect::<Option<_>>()?)))
        })
        .collect()
}

/// The vertex that the draw's `at`-th corner is.
pub fn index(bound: &DrawBindings, at: u32) -> Option<u32> {
    let at = bound.call.first.checked_add(at)?;
    let Some(indices) = &bound.indices else {
        return Some(at);
    };
    let bytes = &indices.data.bytes;
    let at = at as usize;
    let index = match indices.format {
        wgpu::IndexFormat::Uint16 => bytes
            .as_chunks::<2>()
            .0
            .get(at)
            .map(|b| u32::from(u16::from_le_bytes(*b))),
        wgpu::IndexFormat::Uint32 => bytes
            .as_chunks::<4>()
            .0
            .get(at)
            .map(|b| u32::from_le_bytes(*b)),
    };
    index?.checked_add_signed(bound.call.base_vertex)
}
