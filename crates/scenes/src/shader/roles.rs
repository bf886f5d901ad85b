//! Infers the roles of a shader's inputs from the dataflow of its stages. Names only decide between
//! inputs that the dataflow allows.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    AddressSpace, BinaryOperator, Binding, BuiltIn, Expression, MathFunction, Module, ScalarKind,
    ShaderStage, TypeInner,
};
use naga_edit::interface::Io;
use preshade_dataflow::graph::Graph;
use preshade_passes::analysis::values::ValueId;

use super::flow::{BufferRead, MOST_INDIRECT, Nearest, StageFlow, location};
use super::vertex_pulling::Pulled;
use super::{discards, divisors, loops, skin};
use preshade_compiler::front::Parsed;
use preshade_draw::scene::bind::{is_instance_data, known_stream};
use preshade_draw::scene::layout::{leaf_shape, runtime_array};
use preshade_draw::scene::{Image, Semantic, Value};

/// The inferred roles of a shader's inputs.
#[derive(Default)]
pub(crate) struct Roles {
    /// Mesh stream by attribute name.
    pub attributes: BTreeMap<String, String>,
    /// Values by path.
    pub values: BTreeMap<String, Value>,
    /// Images by the name of the texture.
    pub textures: BTreeMap<String, std::sync::Arc<Image>>,
    /// The buffer that the vertex stage fetches its vertices from, unless its names identify it.
    pub pulled: Option<Pulled>,
    /// Whether an attribute or a buffer holds the mesh's positions.
    pub has_mesh: bool,
    /// Whether the shader places each object itself.
    pub is_placed: bool,
    /// Whether per-instance data places the instances.
    pub is_instanced: bool,
    /// Whether the instance index affects the position.
    pub uses_instance: bool,
    /// Per-instance matrices in buffers whose names have no known meaning.
    pub instance_matrices: Vec<BufferRead>,
}

impl Roles {
    /// Infers the roles from both stages. A stage that is too large to analyse gets none. `given`
    /// are the values that the scene sets.
    pub fn of(parsed: &Parsed, given: &BTreeMap<String, Value>) -> Self {
        let mut this = Self::default();
        let graph = Graph::build(&parsed.program);
        let stage = |stage, name: &str| {
            let (entry, _) = parsed.program.entry_point(stage, name)?;
            StageFlow::new(&graph, entry)
        };
        let vertex = stage(ShaderStage::Vertex, &parsed.vertex);
        let fragment = parsed.fragment.as_deref();
        let fragment = fragment.and_then(|name| stage(ShaderStage::Fragment, name));
        match &vertex {
            Some(vertex) => this.vertices(vertex, fragment.as_ref(), given),
            // Assume the usual matrices if there is no dataflow.
            None => this.is_placed = true,
        }
        for stage in vertex.iter().chain(&fragment) {
            this.values.extend(loops::counts(stage));
            for (path, number) in divisors::numbers(stage) {
                this.values.entry(path).or_insert(number);
            }
        }
        if let Some(fragment) = &fragment {
            let found = discards::inputs(fragment);
            this.values.extend(found.values);
            this.textures.extend(found.textures);
        }
        this
    }

    /// The paths of values that the renderer provides.
    pub fn semantics(&self) -> impl Iterator<Item = (String, Semantic)> {
        self.values.iter().filter_map(|(path, value)| match value {
            Value::Semantic(name) => Some((path.clone(), Semantic::from_name(name)?)),
            Value::Numbers(_) => None,
        })
    }

    fn vertices(
        &mut self,
        flow: &StageFlow<'_, '_>,
        fragment: Option<&StageFlow<'_, '_>>,
        given: &BTreeMap<String, Value>,
    ) {
        let module = flow.values.graph.module();
        let outputs = flow.values.outputs();
        let is_position =
            |b: &Option<Binding>| matches!(b, Some(Binding::BuiltIn(BuiltIn::Position { .. })));
        let position = outputs.iter().find(|(b, _)| is_position(b));
        let Some((_, position)) = position else {
            return;
        };
        let near = flow.nearest(*position);
        let attribute = position_attribute(flow, &near);
        let source = match attribute {
            Some(value) => Some(value),
            None => self.pull(flow, &near),
        };
        self.has_mesh = source.is_some();
        if source.is_none() {
            self.divisors(flow, *position);
        }
        let mut taken = BTreeSet::new();
        if let Some(input) = attribute.and_then(|value| flow.input(value)) {
            taken.insert(input);
            self.attribute(&flow.values.inputs[input], "position");
        }
        if let Some(fragment) = fragment {
            self.texture_coordinates(flow, fragment, &mut taken);
        }
        self.skin(flow, &mut taken);
        self.other_attributes(flow, &mut taken);
        let chain = source.map(|source| matrices(flow, &near.way(source)));
        self.camera(module, &chain.unwrap_or_default(), given);
        self.normal_matrices(flow);
        self.placement(flow, *position);
    }

    fn attribute(&mut self, io: &Io, stream: &str) {
        if let Some(name) = &io.name {
            self.attributes.insert(name.clone(), stream.to_owned());
        }
    }

    /// Finds the buffer of positions. `None` if the shader generates its vertices.
    fn pull(&mut self, flow: &StageFlow<'_, '_>, near: &Nearest) -> Option<ValueId> {
        let mut found: Vec<(u32, ValueId)> = near
            .cost
            .iter()
            .filter(|(value, cost)| {
                **cost < MOST_INDIRECT
                    && flow.is_array_read(**value, &[ScalarKind::Float])
                    && reads_builtin(flow, **value, BuiltIn::VertexIndex)
            })
            .map(|(value, cost)| (*cost, *value))
            .collect();
        found.sort_unstable();
        let (_, value) = found.first()?;
        self.pulled = Pulled::of(flow, *value);
        self.first_vertices(flow, *value);
        Some(*value)
    }

    /// Gives 0 to the integers that are added to the vertex index, because each mesh starts at the
    /// beginning of its buffer.
    fn first_vertices(&mut self, flow: &StageFlow<'_, '_>, vertex: ValueId) {
        let module = flow.values.graph.module();
        for value in flow.behind(vertex) {
            let Some((context, Expression::Binary { op, left, right }, _)) = flow.expression(value)
            else {
                continue;
            };
            let sides = [*left, *right].map(|e| flow.values.named(context, e));
            let [Some(left), Some(right)] = sides else {
                continue;
            };
            for (offset, number) in [(left, right), (right, left)] {
                if *op == BinaryOperator::Add
                    && reads_builtin(flow, number, BuiltIn::VertexIndex)
                    && let Some(read) = flow.read(flow.through(offset))
                    && read.semantic(module).is_none()
                    && leaf_shape(&module.types[read.ty].inner)
                        .is_some_and(|(_, _, scalar)| scalar.kind != ScalarKind::Float)
                    && !reads_builtin(flow, offset, BuiltIn::VertexIndex)
                {
                    self.values
                        .insert(read.text(module), Value::Numbers(vec![0.0]));
                }
            }
        }
    }

    /// Gives 1 to uniforms that divide made-up numbers on the way to a position without a mesh,
    /// such as a window's size. Those numbers range from 0 to 1, not from 0 to 1920.
    fn divisors(&mut self, flow: &StageFlow<'_, '_>, position: ValueId) {
        let module = flow.values.graph.module();
        let is_made_up = |v: &ValueId| {
            let read = flow.read(*v);
            read.is_some_and(|read| read.semantic(module).is_none())
        };
        for division in divisors::divisions(flow, flow.behind(position)) {
            let divided = division.divided;
            if !divided.is_some_and(|v| flow.behind(v).iter().any(is_made_up)) {
                continue;
            }
            for read in division.by {
                if let Some((1, _, scalar)) = leaf_shape(&module.types[read.ty].inner)
                    && scalar.kind == ScalarKind::Float
                {
                    let number = Value::Numbers(vec![1.0]);
                    self.values.insert(read.text(module), number);
                }
            }
        }
    }

    /// Assigns texture coordinates to the attributes at which a texture is sampled.
    fn texture_coordinates(
        &mut self,
        flow: &StageFlow<'_, '_>,
        fragment: &StageFlow<'_, '_>,
        taken: &mut BTreeSet<usize>,
    ) {
        let mut locations = BTreeSet::new();
        for value in 0..fragment.values.values.len() {
            let Some((context, expression, _)) = fragment.expression(value) else {
                continue;
            };
            let Expression::ImageSample { coordinate, .. } = expression else {
                continue;
            };
            let Some(coordinate) = fragment.values.named(context, *coordinate) else {
                continue;
            };
            let near = fragment.nearest(coordinate);
            let inputs = near.cost.iter().filter(|(_, cost)| **cost < MOST_INDIRECT);
            let inputs = inputs.filter_map(|(value, _)| fragment.input(*value));
            locations.extend(inputs.filter_map(|i| location(&fragment.values.inputs[i])));
        }
        for (binding, value) in flow.values.outputs() {
            let Some(Binding::Location { location: at, .. }) = binding else {
                continue;
            };
            if !locations.contains(&at) {
                continue;
            }
            let near = flow.nearest(value);
            let mut inputs: Vec<(u32, usize)> = near
                .cost
                .iter()
                .filter_map(|(value, cost)| Some((*cost, flow.input(*value)?)))
                .collect();
            inputs.sort_unstable();
            for (cost, input) in inputs {
                let io = &flow.values.inputs[input];
                // A two-component attribute is used as texture coordinates even if its name means
                // something else.
                let known = known_stream(io.name.as_deref().unwrap_or(""));
                let is_unknown = !matches!(known, Some("uv" | "uv1"));
                if cost < MOST_INDIRECT
                    && is_unknown
                    && flow.shape(io) == Some((2, ScalarKind::Float))
                    && taken.insert(input)
                {
                    self.attribute(io, "uv");
                }
            }
        }
    }

    /// Assigns a stream of the right type to the remaining attributes without a known name.
    fn other_attributes(&mut self, flow: &StageFlow<'_, '_>, taken: &mut BTreeSet<usize>) {
        let name = |io: &Io| io.name.clone().unwrap_or_default();
        let mut has_normal = flow
            .values
            .inputs
            .iter()
            .any(|io| known_stream(&name(io)) == Some("normal"));
        for (input, io) in flow.values.inputs.iter().enumerate() {
            if location(io).is_none() || known_stream(&name(io)).is_some() || !taken.insert(input) {
                continue;
            }
            let stream = match flow.shape(io) {
                Some((2, ScalarKind::Float)) => "uv",
                Some((3, ScalarKind::Float)) if !has_normal => {
                    has_normal = true;
                    "normal"
                }
                Some((3 | 4, ScalarKind::Float)) => "color",
                _ => continue,
            };
            self.attribute(io, stream);
        }
    }

    /// Assigns the roles of a skin's attributes and matrix array.
    fn skin(&mut self, flow: &StageFlow<'_, '_>, taken: &mut BTreeSet<usize>) {
        let (module, inputs) = (flow.values.graph.module(), &flow.values.inputs);
        for skin in skin::skins(flow) {
            taken.extend([skin.joints, skin.weights]);
            self.attribute(&inputs[skin.joints], "joints");
            self.attribute(&inputs[skin.weights], "weights");
            if skin.matrices.semantic(module) != Some(Semantic::Joints) {
                let value = Value::Semantic(Semantic::Joints.name().to_owned());
                self.values.insert(skin.matrices.text(module), value);
            }
        }
    }

    /// Assigns the camera's matrices to those on the way to the position, outermost first.
    fn camera(&mut self, module: &Module, chain: &[BufferRead], given: &BTreeMap<String, Value>) {
        let said = |read: &BufferRead| {
            let path = read.text(module);
            match given.get(&path).or_else(|| self.values.get(&path)) {
                Some(Value::Semantic(name)) => Semantic::from_name(name),
                _ => read.semantic(module),
            }
        };
        let chain = chain.iter().map(|read| (read, said(read)));
        // Joints are no camera matrices: each moves only its own vertices.
        let (chain, names): (Vec<_>, Vec<_>) = chain
            .filter(|(_, name)| *name != Some(Semantic::Joints))
            .unzip();
        let meanings = camera_of(&names);
        for ((read, name), meaning) in chain.into_iter().zip(names).zip(meanings) {
            if name != Some(*meaning) {
                let value = Value::Semantic(meaning.name().to_owned());
                self.values.insert(read.text(module), value);
            }
        }
    }

    /// Assigns the normal matrix to matrices without a known name that multiply the normal.
    fn normal_matrices(&mut self, flow: &StageFlow<'_, '_>) {
        let module = flow.values.graph.module();
        let is_normal = |value: &ValueId| {
            let input = flow.input(*value).map(|i| &flow.values.inputs[i]);
            let name = input.and_then(|io| io.name.as_deref()).unwrap_or("");
            let stream = self.attributes.get(name).map(String::as_str);
            stream.or_else(|| known_stream(name)) == Some("normal")
        };
        let mut found = Vec::new();
        for value in 0..flow.values.values.len() {
            let Some(Product {
                vector,
                matrix,
                order,
            }) = Product::of(flow, value)
            else {
                continue;
            };
            let near = flow.nearest(vector);
            if near.cost.iter().any(|(v, cost)| *cost < 10 && is_normal(v))
                && let [only] = factors(flow, matrix, order).as_slice()
                && only.semantic(module).is_none()
                && !self.values.contains_key(&only.text(module))
            {
                found.push(only.text(module));
            }
        }
        let meaning = Semantic::NormalMatrix.name();
        let values = found
            .into_iter()
            .map(|path| (path, Value::Semantic(meaning.to_owned())));
        self.values.extend(values);
    }

    /// Infers whether the shader places objects and instances.
    fn placement(&mut self, flow: &StageFlow<'_, '_>, position: ValueId) {
        let module = flow.values.graph.module();
        for value in flow.behind(position) {
            if let Some(input) = flow.input(value) {
                let io = &flow.values.inputs[input];
                self.uses_instance |= io.binding == Some(Binding::BuiltIn(BuiltIn::InstanceIndex));
                self.is_instanced |=
                    location(io).is_some() && is_instance_data(io.name.as_deref().unwrap_or(""));
            } else if let Some(read) = flow.read(value) {
                let meaning = match self.values.get(&read.text(module)) {
                    Some(Value::Semantic(name)) => Semantic::from_name(name),
                    _ => read.semantic(module),
                };
                use Semantic::{Model, ModelView, ModelViewProjection};
                let global = &module.global_variables[read.global];
                let is_array = runtime_array(module, global.ty).is_some();
                let is_matrix = matches!(module.types[read.ty].inner, TypeInner::Matrix { .. });
                if is_array && is_instance_data(global.name.as_deref().unwrap_or("")) {
                    self.is_instanced = true;
                } else if is_matrix
                    && matches!(meaning, Some(Model | ModelView | ModelViewProjection))
                {
                    self.is_placed = true;
                } else if is_array
                    && is_matrix
                    && meaning.is_none()
                    && reads_builtin(flow, value, BuiltIn::InstanceIndex)
                {
                    self.is_instanced = true;
                    self.instance_matrices.push(read);
                }
            }
        }
    }
}

/// The position attribute: by name, or else the most direct attribute whose name has no other
/// meaning.
fn position_attribute(flow: &StageFlow<'_, '_>, near: &Nearest) -> Option<ValueId> {
    let mut found: Vec<(u32, u32, u32, ValueId)> = Vec::new();
    for (value, cost) in &near.cost {
        let Some(input) = flow.input(*value) else {
            continue;
        };
        let io = &flow.values.inputs[input];
        let (Some(location), Some((2..=4, ScalarKind::Float))) = (location(io), flow.shape(io))
        else {
            continue;
        };
        let name = io.name.as_deref().unwrap_or("");
        let other = match known_stream(name) {
            Some("position") => 0,
            None if !is_instance_data(name) => 1,
            _ => 2,
        };
        if *cost < MOST_INDIRECT || other == 0 {
            found.push((other, *cost, location, *value));
        }
    }
    found.sort_unstable();
    found.first().map(|(.., value)| *value)
}

/// The camera matrices for a chain with these names, outermost first. May be shorter than the
/// chain.
fn camera_of(names: &[Option<Semantic>]) -> &'static [Semantic] {
    use Semantic::{Model, ModelView, ModelViewProjection, Projection, View, ViewProjection};
    let chains: &[&[Semantic]] = match names.len() {
        0 => &[],
        1 => &[&[ModelViewProjection], &[ViewProjection]],
        2 => &[
            &[ViewProjection, Model],
            &[Projection, ModelView],
            &[Projection, View],
        ],
        _ => &[&[Projection, View, Model], &[ViewProjection, Model]],
    };
    let agreed = |chain: &&&[Semantic]| {
        let agrees = |(name, meaning): &(&Option<Semantic>, &Semantic)| **name == Some(**meaning);
        names.iter().zip(chain.iter()).filter(agrees).count()
    };
    let mut best: &'static [Semantic] = &[];
    let mut most = None;
    for chain in chains {
        let agreed = agreed(&chain);
        if most.is_none_or(|most| agreed > most) {
            (best, most) = (chain, Some(agreed));
        }
    }
    best
}

/// The uniform matrices that multiply a vector on the path to the position, outermost first.
fn matrices(flow: &StageFlow<'_, '_>, way: &[ValueId]) -> Vec<BufferRead> {
    let mut found = Vec::new();
    for (value, next) in way.iter().zip(way.iter().skip(1)) {
        if let Some(product) = Product::of(flow, *value)
            && product.vector == *next
        {
            found.extend(factors(flow, product.matrix, product.order));
        }
    }
    found
}

/// The outermost factor in a product of matrices: the one applied last.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Outermost {
    /// As `a` in `a * b * vector`.
    First,
    /// As `b` in `vector * a * b`.
    Last,
}

impl Outermost {
    /// The outermost factor in the transposed product.
    fn turned(self) -> Self {
        match self {
            Self::First => Self::Last,
            Self::Last => Self::First,
        }
    }
}

/// A product of a matrix and a vector, in either order. naga reads a `row_major` matrix as the
/// transpose of a column-major one.
struct Product {
    matrix: ValueId,
    vector: ValueId,
    order: Outermost,
}

impl Product {
    fn of(flow: &StageFlow<'_, '_>, value: ValueId) -> Option<Self> {
        let (context, left, right) = flow.product(value)?;
        let f = flow.values.function(context);
        let ty = |e| f.ty(flow.values.graph.module(), e);
        let named = |e| flow.values.named(context, e);
        let (matrix, vector, order) = match (ty(left), ty(right)) {
            (TypeInner::Matrix { .. }, TypeInner::Vector { .. }) => (left, right, Outermost::First),
            (TypeInner::Vector { .. }, TypeInner::Matrix { .. }) => (right, left, Outermost::Last),
            _ => return None,
        };
        Some(Self {
            matrix: named(matrix)?,
            vector: named(vector)?,
            order,
        })
    }
}

/// The uniform matrices of a product of matrices, outermost first.
fn factors(flow: &StageFlow<'_, '_>, matrix: ValueId, order: Outermost) -> Vec<BufferRead> {
    let module = flow.values.graph.module();
    let matrix = flow.through(matrix);
    if let Some(read) = flow.read(matrix) {
        let global = &module.global_variables[read.global];
        let is_uniform =
            global.space == AddressSpace::Uniform || runtime_array(module, global.ty).is_none();
        let is_matrix = matches!(module.types[read.ty].inner, TypeInner::Matrix { .. });
        return match is_uniform && is_matrix {
            true => vec![read],
            false => Vec::new(),
        };
    }
    let Some((context, expression, _)) = flow.expression(matrix) else {
        return Vec::new();
    };
    let (mut operands, order) = match *expression {
        Expression::Binary {
            op: BinaryOperator::Multiply,
            left,
            right,
        } => (vec![left, right], order),
        Expression::Math {
            fun: MathFunction::Transpose,
            arg,
            ..
        } => (vec![arg], order.turned()),
        _ => return Vec::new(),
    };
    if order == Outermost::Last {
        operands.reverse();
    }
    let operands = operands.into_iter();
    let values = operands.filter_map(|e| flow.values.named(context, e));
    values
        .filter(|v| *v != matrix)
        .flat_map(|v| factors(flow, v, order))
        .collect()
}

/// Whether a value depends on a built-in input.
fn reads_builtin(flow: &StageFlow<'_, '_>, value: ValueId, builtin: BuiltIn) -> bool {
    let inputs = flow.behind(value).into_iter().filter_map(|v| flow.input(v));
    let mut bindings = inputs.filter_map(|i| flow.values.inputs[i].binding.clone());
    bindings.any(|b| b == Binding::BuiltIn(builtin))
}
