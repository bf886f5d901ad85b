//! Finds mesh and instance data by the usual names of attributes and vertex-pulling buffers.

use glam::Mat4;
use naga::{Binding, Handle, ScalarKind, Type};
use preshade_plan::plan::GpuPass;

use super::super::globals::{globals, is_read};
use super::super::layout::{self, VariableLeaf};
use super::super::semantic::normalise;
use super::super::{Draw, DrawRange, Material, Mesh, Scene, SceneError, Semantic, Stream, Value};
use super::{Call, Data, Indices, VertexAttribute, VertexBuffer, hash01, vertex_inputs};

/// Attribute names, normalised, and their streams.
const ALIASES: &[(&str, &str)] = &[
    ("position", "position"),
    ("positions", "position"),
    ("pos", "position"),
    ("vertexposition", "position"),
    ("points", "position"),
    ("normal", "normal"),
    ("normals", "normal"),
    ("norm", "normal"),
    ("vertexnormal", "normal"),
    ("tangent", "tangent"),
    ("tangents", "tangent"),
    ("uv", "uv"),
    ("uvs", "uv"),
    ("uv0", "uv"),
    ("st", "uv"),
    ("texcoord", "uv"),
    ("texcoords", "uv"),
    ("texcoord0", "uv"),
    ("texturecoord", "uv"),
    ("vertexuv", "uv"),
    ("uv1", "uv1"),
    ("uv2", "uv1"),
    ("texcoord1", "uv1"),
    ("color", "color"),
    ("colors", "color"),
    ("colour", "color"),
    ("color0", "color"),
    ("vertexcolor", "color"),
    ("joints", "joints"),
    ("skinindex", "joints"),
    ("joints0", "joints"),
    ("jointindices", "joints"),
    ("boneindices", "joints"),
    ("weights", "weights"),
    ("skinweight", "weights"),
    ("weights0", "weights"),
    ("jointweights", "weights"),
    ("boneweights", "weights"),
    ("skinweights", "weights"),
];

/// Names of per-instance matrices, normalised. A final digit selects a column.
const INSTANCE_MATRICES: &[&str] = &[
    "instancetransform",
    "instancematrix",
    "instancemodel",
    "instanceworld",
    "instance",
    "model",
    "modelmatrix",
    "world",
    "transform",
    "matrix",
];

/// Names of storage buffers with one element per instance, normalised.
const INSTANCE_BUFFERS: &[&str] = &[
    "instances",
    "instancedata",
    "instancetransforms",
    "instancematrices",
    "transforms",
    "models",
    "modelmatrices",
    "matrices",
    "objects",
    "perinstance",
];

#[derive(Clone, Debug, PartialEq)]
enum AttributeSource {
    Vertex(String),
    /// A stream of the mesh, by the attribute's use in the shader.
    Role(String),
    Instance(String),
    InstanceColumn(usize),
    InstanceOffset,
    Synthesised,
}

impl AttributeSource {
    /// Whether the scene does not specify the source of the values.
    fn is_guessed(&self) -> bool {
        matches!(self, Self::Role(_) | Self::Synthesised)
    }
}

/// A [`AttributeSource`] resolved to its data.
enum Found<'a> {
    /// A stream of the mesh or of the instances.
    Stream(Option<&'a Stream>),
    /// A column of the instance's matrix.
    Column(usize),
    /// The same value for all vertices.
    Same([f64; 4]),
}

/// One attribute of the author's vertex stage.
struct Attribute {
    location: u32,
    name: String,
    components: u32,
    kind: ScalarKind,
    source: AttributeSource,
}

impl Attribute {
    fn by_instance(&self) -> bool {
        matches!(
            self.source,
            AttributeSource::Instance(_)
                | AttributeSource::InstanceColumn(_)
                | AttributeSource::InstanceOffset
        )
    }
}

/// The vertex and instance data of one draw.
pub(super) struct Streams<'a> {
    material: &'a Material,
    draw: &'a Draw,
    mesh: &'a Mesh,
    /// Whether preshade made up the scene.
    is_made_up: bool,
    attributes: Vec<Attribute>,
    /// Instance to world, or to model space if the program multiplies by the model matrix itself.
    instances: Vec<Mat4>,
    /// The matrix of an instance without a transform of its own.
    placed: Mat4,
    pulls_indices: bool,
}

impl<'a> Streams<'a> {
    pub(super) fn new(
        scene: &'a Scene,
        material: &'a Material,
        draw: &'a Draw,
    ) -> Result<Self, SceneError> {
        let mesh = scene.meshes.get(draw.mesh).ok_or_else(|| {
            SceneError::new(format!(
                "draw `{}` names mesh {} of {}",
                draw.name,
                draw.mesh,
                scene.meshes.len()
            ))
        })?;
        let module = material.program.module();
        let mut attributes = Vec::new();
        for io in vertex_inputs(material)? {
            let Some(Binding::Location { location, .. }) = io.binding else {
                continue;
            };
            let name = io.name.unwrap_or_default();
            let Some((_, components, scalar)) = layout::leaf_shape(&module.types[io.ty].inner)
            else {
                continue;
            };
            attributes.push(Attribute {
                location,
                source: source(material, mesh, draw, &name),
                name,
                components,
                kind: scalar.kind,
            });
        }
        attributes.sort_by_key(|a| a.location);
        let given = match draw.instance_streams.get("instance_transform") {
            Some(Stream::Float { data, .. }) => {
                data.chunks_exact(16).map(Mat4::from_cols_slice).collect()
            }
            _ => Vec::new(),
        };
        let outer = if reads_model(material) {
            Mat4::IDENTITY
        } else {
            draw.transform
        };
        Ok(Self {
            material,
            draw,
            mesh,
            is_made_up: scene.is_made_up,
            attributes,
            instances: given.into_iter().map(|m: Mat4| outer * m).collect(),
            placed: outer,
            pulls_indices: globals(&material.program).any(|g| {
                is_index_buffer(g.name) && g.is_storage && is_read(material, g.group, g.binding)
            }),
        })
    }

    /// The interleaved buffers, with the attributes that `pass` reads.
    pub(super) fn vertex_buffers(&self, pass: &GpuPass) -> Result<Vec<VertexBuffer>, SceneError> {
        let mut out = Vec::new();
        for step in [wgpu::VertexStepMode::Vertex, wgpu::VertexStepMode::Instance] {
            let by_instance = step == wgpu::VertexStepMode::Instance;
            let members: Vec<&Attribute> = self
                .attributes
                .iter()
                .filter(|a| a.by_instance() == by_instance)
                .collect();
            let stride: u64 = members.iter().map(|a| u64::from(a.components) * 4).sum();
            let mut attributes = Vec::new();
            let mut offset = 0;
            for a in &members {
                if pass.attributes.iter().any(|p| p.location == a.location) {
                    attributes.push(VertexAttribute {
                        location: a.location,
                        format: format(a)?,
                        offset,
                        is_invented: self.is_made_up || a.source.is_guessed(),
                    });
                }
                offset += u64::from(a.components) * 4;
            }
            if attributes.is_empty() {
                continue;
            }
            let count = if by_instance {
                instances_held(self.draw)
            } else {
                self.mesh.vertex_count as usize
            };
            let mut bytes = Vec::with_capacity(count * stride as usize);
            // Look up names once, not for every vertex.
            let found: Vec<(&Attribute, Found<'_>)> =
                members.iter().map(|a| (*a, self.found(a))).collect();
            for i in 0..count {
                for (a, found) in &found {
                    for c in 0..a.components as usize {
                        let mut word = [0; 4];
                        layout::scalar_bytes(&mut word, a.kind, self.component(found, i, c));
                        bytes.extend_from_slice(&word);
                    }
                }
            }
            out.push(VertexBuffer {
                stride,
                step,
                attributes,
                data: Data::new(bytes),
            });
        }
        Ok(out)
    }

    /// Resolves the source of an attribute.
    fn found(&self, a: &Attribute) -> Found<'_> {
        match &a.source {
            AttributeSource::Vertex(name) | AttributeSource::Role(name) => {
                Found::Stream(self.mesh.streams.get(name))
            }
            AttributeSource::Instance(name) => Found::Stream(self.draw.instance_streams.get(name)),
            AttributeSource::InstanceColumn(column) => Found::Column(*column),
            AttributeSource::InstanceOffset => Found::Column(3),
            AttributeSource::Synthesised => {
                let roles = [&self.material.attributes, &self.material.attribute_roles];
                let role = roles.into_iter().find_map(|roles| roles.get(&a.name));
                let name = role.unwrap_or(&a.name);
                Found::Same([0, 1, 2, 3].map(|c| synthesised_attribute(name, c)))
            }
        }
    }

    /// One component of an attribute at a vertex or an instance.
    fn component(&self, found: &Found<'_>, i: usize, c: usize) -> f64 {
        match found {
            Found::Stream(stream) => stream_component(*stream, i, c),
            Found::Column(column) => f64::from(self.instance(i).col(*column)[c.min(3)]),
            Found::Same(value) => value[c.min(3)],
        }
    }

    /// Attributes that get a stream of the mesh by their use, with that stream.
    pub(super) fn by_role(&self) -> impl Iterator<Item = (&str, &str)> {
        self.attributes.iter().filter_map(|a| match &a.source {
            AttributeSource::Role(stream) => Some((a.name.as_str(), stream.as_str())),
            // In a made-up scene, only the dataflow determines these attributes.
            AttributeSource::Vertex(stream) if self.is_made_up => {
                let is_named = known_stream(&a.name) == Some(stream);
                (!is_named).then_some((a.name.as_str(), stream.as_str()))
            }
            _ => None,
        })
    }

    /// Attributes that neither the mesh nor the draw provides.
    pub(super) fn synthesised(&self) -> impl Iterator<Item = &str> {
        let missing = |a: &&Attribute| a.source == AttributeSource::Synthesised;
        self.attributes
            .iter()
            .filter(missing)
            .map(|a| a.name.as_str())
    }

    fn instance(&self, i: usize) -> Mat4 {
        self.instances.get(i).copied().unwrap_or(self.placed)
    }

    /// The indices, unless the program fetches them itself.
    pub(super) fn indices(&self) -> Option<Indices> {
        let indices = self.mesh.indices.as_ref().filter(|_| !self.pulls_indices)?;
        let (format, mut bytes) = if self.mesh.vertex_count <= 65_535 {
            let short = indices.iter().flat_map(|i| (*i as u16).to_le_bytes());
            (wgpu::IndexFormat::Uint16, short.collect::<Vec<u8>>())
        } else {
            let long = indices.iter().flat_map(|i| i.to_le_bytes());
            (wgpu::IndexFormat::Uint32, long.collect())
        };
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        Some(Indices {
            format,
            count: indices.len() as u32,
            data: Data::new(bytes),
        })
    }

    /// Number of vertices, or of indices if the program fetches them itself.
    pub(super) fn vertex_count(&self) -> u32 {
        match &self.mesh.indices {
            Some(indices) if self.pulls_indices => indices.len() as u32,
            _ => self.mesh.vertex_count,
        }
    }

    pub(super) fn call(&self) -> Call {
        let DrawRange {
            first,
            count,
            base_vertex,
            first_instance,
        } = self.draw.range;
        let indices = self.mesh.indices.as_ref();
        let there = indices.map_or(self.mesh.vertex_count, |i| i.len() as u32);
        let left = there.saturating_sub(first);
        Call {
            first,
            count: count.map_or(left, |count| count.min(left)),
            base_vertex: match indices {
                Some(_) if !self.pulls_indices => base_vertex,
                _ => 0,
            },
            first_instance,
        }
    }

    /// Length of a variable's runtime-sized array. The author sets `given` numbers of it.
    pub(super) fn runtime_length(
        &self,
        name: &str,
        ty: Handle<Type>,
        given: Option<usize>,
    ) -> usize {
        let module = self.material.program.module();
        let Some(element) = layout::runtime_array(module, ty) else {
            return 0;
        };
        let scalars = layout::scalar_count(module, element, 1).max(1);
        if let Some(given) = given {
            return given.div_ceil(scalars).max(1);
        }
        let normal = normalise(name);
        if is_index_buffer(name) {
            return self
                .mesh
                .indices
                .as_ref()
                .map_or(self.mesh.vertex_count as usize, Vec::len);
        }
        if let Some(stream) = alias(&normal).filter(|_| !is_of_matrices(module, element)) {
            let (components, count) = self.mesh.streams.get(stream).map_or((1, 0), |s| match s {
                Stream::Float { components, data } => (*components as usize, data.len()),
                Stream::Uint { components, data } => (*components as usize, data.len()),
            });
            // An array of scalars holds all numbers; an array of vectors has one element per
            // vertex.
            return if scalars == 1 {
                count
            } else {
                count / components
            }
            .max(1);
        }
        if is_vertex_buffer(&normal) {
            return self.mesh.vertex_count.max(1) as usize;
        }
        if INSTANCE_BUFFERS.contains(&normal.as_str()) || normal.starts_with("instance") {
            return instances_held(self.draw);
        }
        let is_of = |path: &str| {
            let rest = path.strip_prefix(name);
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        };
        let mut said = meanings(self.material);
        let said = said.find_map(|(path, semantic)| is_of(path).then_some(semantic));
        match said.or_else(|| Semantic::from_name(name)) {
            Some(Semantic::Joints) => self.draw.joints.len().max(1),
            Some(Semantic::MorphWeights) => self.draw.morph_weights.len().max(1),
            _ => 16,
        }
    }

    /// The numbers of one element of a vertex-pulling or instance buffer, or of a morph or joint
    /// list. `None` for other variables.
    pub(super) fn element(
        &self,
        variable: &str,
        ty: Handle<Type>,
        leaf: &VariableLeaf<'_>,
    ) -> Option<[f64; 16]> {
        layout::runtime_array(self.material.program.module(), ty)?;
        let i = leaf.index?;
        let is_matrix = leaf.columns > 1;
        let mut out = [0.0; 16];
        let rows = leaf.rows as usize;
        if is_index_buffer(variable) {
            let indices = self.mesh.indices.as_ref();
            out[0] = indices.map_or(i as f64, |n| n.get(i).map_or(0.0, |v| f64::from(*v)));
            return Some(out);
        }
        let (variable, member) = (normalise(variable), normalise(leaf.name()));
        let stream = alias(&variable).or_else(|| {
            is_vertex_buffer(&variable)
                .then(|| alias(&member))
                .flatten()
        });
        // No mesh has matrices: `joints` of matrices are the pose.
        let stream = stream.filter(|_| !is_matrix);
        if let Some(name) = stream {
            let stream = self.mesh.streams.get(name);
            for (c, n) in out.iter_mut().enumerate().take(rows) {
                *n = match (rows, stream) {
                    (1, Some(Stream::Float { data, .. })) => {
                        data.get(i).map_or(0.0, |v| f64::from(*v))
                    }
                    (1, Some(Stream::Uint { data, .. })) => {
                        data.get(i).map_or(0.0, |v| f64::from(*v))
                    }
                    (_, Some(_)) => stream_component(stream, i, c),
                    (_, None) => synthesised_attribute(name, c),
                };
            }
            return Some(out);
        }
        if !INSTANCE_BUFFERS.contains(&variable.as_str()) && !variable.starts_with("instance") {
            return None;
        }
        let own = self
            .draw
            .instance_streams
            .iter()
            .find(|(n, _)| {
                let n = normalise(n);
                n == member || n.strip_prefix("instance") == Some(member.as_str())
            })
            .filter(|(n, _)| n.as_str() != "instance_transform");
        if let Some((_, stream)) = own {
            for (c, n) in out.iter_mut().enumerate().take(rows) {
                *n = stream_component(Some(stream), i, c);
            }
            return Some(out);
        }
        if is_matrix {
            let matrix = if Semantic::from_name(leaf.name()) == Some(Semantic::NormalMatrix) {
                self.instance(i).inverse().transpose()
            } else {
                self.instance(i)
            };
            for c in 0..leaf.columns as usize {
                for r in 0..rows {
                    out[c * rows + r] = f64::from(matrix.col(c)[r]);
                }
            }
            return Some(out);
        }
        if member.contains("offset")
            || member.contains("position")
            || member.contains("translation")
        {
            for (c, n) in out.iter_mut().enumerate().take(rows) {
                *n = f64::from(self.instance(i).w_axis[c]);
            }
            return Some(out);
        }
        None
    }
}

/// Instances that the buffer must hold, including those before the first drawn one.
fn instances_held(draw: &Draw) -> usize {
    draw.range.first_instance as usize + draw.instances.max(1) as usize
}

/// The stream that an attribute or buffer holds, by its name.
pub fn known_stream(name: &str) -> Option<&'static str> {
    let normal = normalise(name);
    let morph = normal.starts_with("morph").then_some("morph");
    alias(&normal).or(morph)
}

/// Whether an attribute or buffer holds per-instance data, by its name.
pub fn is_instance_data(name: &str) -> bool {
    let normal = normalise(name);
    instance_part(&normal).is_some()
        || INSTANCE_BUFFERS.contains(&normal.as_str())
        || normal.starts_with("instance")
}

fn alias(normal: &str) -> Option<&'static str> {
    ALIASES.iter().find(|(a, _)| *a == normal).map(|(_, s)| *s)
}

/// Whether the elements of an array are matrices, alone or in a struct of one member.
fn is_of_matrices(module: &naga::Module, element: Handle<Type>) -> bool {
    match &module.types[element].inner {
        naga::TypeInner::Matrix { .. } => true,
        naga::TypeInner::Struct { members, .. } => match members.as_slice() {
            [only] => is_of_matrices(module, only.ty),
            _ => false,
        },
        _ => false,
    }
}

pub fn is_index_buffer(name: &str) -> bool {
    matches!(
        normalise(name).as_str(),
        "indices" | "indexbuffer" | "triangles" | "vertexindices"
    )
}

fn is_vertex_buffer(normal: &str) -> bool {
    matches!(
        normal,
        "vertices" | "vertexbuffer" | "vertexdata" | "verts" | "meshvertices"
    )
}

/// Meanings of paths: first those from the scene, then those from their use.
fn meanings(material: &Material) -> impl Iterator<Item = (&str, Semantic)> {
    let said = material.values.iter().filter_map(|(path, value)| {
        let Value::Semantic(name) = value else {
            return None;
        };
        Some((path.as_str(), Semantic::from_name(name)?))
    });
    let used = material.value_roles.iter().map(|(p, s)| (p.as_str(), *s));
    said.chain(used)
}

/// Whether the program itself applies the model matrix.
fn reads_model(material: &Material) -> bool {
    let module = material.program.module();
    globals(&material.program)
        .filter(|g| g.is_buffer)
        .filter(|g| layout::runtime_array(module, g.ty).is_none())
        .flat_map(|g| layout::paths(module, g.name, g.ty))
        .any(|path| {
            let said = meanings(material).find_map(|(of, s)| (of == path).then_some(s));
            let named = path.rsplit('.').next().and_then(Semantic::from_name);
            matches!(
                said.or(named),
                Some(Semantic::Model | Semantic::ModelViewProjection | Semantic::ModelView)
            )
        })
}

fn source(material: &Material, mesh: &Mesh, draw: &Draw, name: &str) -> AttributeSource {
    if let Some(given) = material.attributes.get(name) {
        if mesh.streams.contains_key(given) {
            return AttributeSource::Vertex(given.clone());
        }
        if draw.instance_streams.contains_key(given) {
            return AttributeSource::Instance(given.clone());
        }
    }
    let normal = normalise(material.attributes.get(name).map_or(name, String::as_str));
    if let Some(part) = instance_part(&normal) {
        return part;
    }
    if let Some(given) = draw
        .instance_streams
        .keys()
        .find(|n| normalise(n) == normal)
    {
        return AttributeSource::Instance(given.clone());
    }
    if let Some(own) = mesh.streams.keys().find(|n| normalise(n) == normal) {
        return AttributeSource::Vertex(own.clone());
    }
    let is_there = |stream: &&str| mesh.streams.contains_key(*stream);
    // What the scene names goes before the use: a wrong name is an error.
    let is_given = material.attributes.contains_key(name);
    let by_use = material.attribute_roles.get(name).filter(|_| !is_given);
    let by_use = by_use.map(String::as_str);
    match (by_use.filter(is_there), alias(&normal).filter(is_there)) {
        (Some(stream), named) if named != Some(stream) => AttributeSource::Role(stream.to_owned()),
        (_, Some(stream)) => AttributeSource::Vertex(stream.to_owned()),
        (_, None) => AttributeSource::Synthesised,
    }
}

/// The part of an instance's matrix that an attribute holds, by its normalised name.
fn instance_part(normal: &str) -> Option<AttributeSource> {
    let (stem, digit) = match normal.char_indices().last() {
        Some((at, c @ '0'..='3')) => (&normal[..at], c as usize - '0' as usize),
        _ => (normal, 0),
    };
    let stem = stem
        .strip_suffix("column")
        .or_else(|| stem.strip_suffix("col"))
        .or_else(|| stem.strip_suffix("row"))
        .unwrap_or(stem);
    if INSTANCE_MATRICES.contains(&stem) && stem.len() < normal.len() {
        return Some(AttributeSource::InstanceColumn(digit));
    }
    let offsets = ["instanceoffset", "instanceposition", "instancetranslation"];
    offsets
        .contains(&normal)
        .then_some(AttributeSource::InstanceOffset)
}

/// The first attribute whose stream the material names wrongly: neither the draw nor its mesh has
/// it, and it is not an optional stream.
pub fn unknown_stream<'m>(
    material: &'m Material,
    mesh: &Mesh,
    draw: &Draw,
) -> Option<(&'m str, &'m str)> {
    let means_nothing = |name: &str| {
        let normal = normalise(name);
        let is_optional = alias(&normal).is_some()
            || normal.starts_with("morph")
            || matches!(normal.as_str(), "instancecolor" | "instanceplace");
        !is_optional
    };
    let mut named = material.attributes.iter();
    named
        .find(|(attribute, stream)| {
            source(material, mesh, draw, attribute) == AttributeSource::Synthesised
                && means_nothing(stream)
        })
        .map(|(attribute, stream)| (attribute.as_str(), stream.as_str()))
}

/// The value of an attribute that the mesh lacks: white, facing +z, only the first joint, no morph,
/// or a number derived from its name.
fn synthesised_attribute(name: &str, component: usize) -> f64 {
    let normal = normalise(name);
    let pick = |v: [f64; 4]| v[component.min(3)];
    match alias(&normal).unwrap_or(&normal) {
        "color" => 1.0,
        "normal" => pick([0.0, 0.0, 1.0, 0.0]),
        "tangent" => pick([1.0, 0.0, 0.0, 1.0]),
        "weights" => pick([1.0, 0.0, 0.0, 0.0]),
        "joints" => 0.0,
        "position" => pick([0.0, 0.0, 0.0, 1.0]),
        "instancecolor" => 1.0,
        _ if normal.starts_with("morph") => 0.0,
        _ => 0.25 + 0.5 * hash01(&normal, 0, component),
    }
}

/// A component of a stream. As in WebGPU's vertex fetch, a missing fourth component is 1 and other
/// missing components are 0.
pub fn stream_component(stream: Option<&Stream>, i: usize, c: usize) -> f64 {
    let missing = if c == 3 { 1.0 } else { 0.0 };
    match stream {
        Some(Stream::Float { components, data }) if c < *components as usize => data
            .get(i * *components as usize + c)
            .map_or(missing, |v| f64::from(*v)),
        Some(Stream::Uint { components, data }) if c < *components as usize => data
            .get(i * *components as usize + c)
            .map_or(missing, |v| f64::from(*v)),
        _ => missing,
    }
}

fn format(a: &Attribute) -> Result<wgpu::VertexFormat, SceneError> {
    use wgpu::VertexFormat as F;
    Ok(match (a.kind, a.components) {
        (ScalarKind::Float, 1) => F::Float32,
        (ScalarKind::Float, 2) => F::Float32x2,
        (ScalarKind::Float, 3) => F::Float32x3,
        (ScalarKind::Float, 4) => F::Float32x4,
        (ScalarKind::Uint, 1) => F::Uint32,
        (ScalarKind::Uint, 2) => F::Uint32x2,
        (ScalarKind::Uint, 3) => F::Uint32x3,
        (ScalarKind::Uint, 4) => F::Uint32x4,
        (ScalarKind::Sint, 1) => F::Sint32,
        (ScalarKind::Sint, 2) => F::Sint32x2,
        (ScalarKind::Sint, 3) => F::Sint32x3,
        (ScalarKind::Sint, 4) => F::Sint32x4,
        _ => {
            return Err(SceneError::new(format!(
                "vertex attribute `{}` is of a type no vertex format has",
                a.name
            )));
        }
    })
}
