//! A material with other outputs: the author's stages, extended by the values of auxiliary
//! pictures. Slices of the result are programs of these pictures.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    AddressSpace, Binding, BuiltIn, Expression, GlobalVariable, Handle, Interpolation, Module,
    ResourceBinding, Sampling, Scalar, Span, StructMember, Type, TypeInner, VectorSize,
};

use super::authored::Authored;
use super::world_position::World;
use crate::analysis::opaque::Opaque;
use crate::rebuild::depth_only::Placed;
use naga_edit::declared::{self, Declaration, Declared};
use naga_edit::interface;
use naga_edit::writer::FunctionWriter;
use preshade_plan::mapping;
use preshade_plan::plan::{AttributeUse, BindingSource, HostValue};
use preshade_plan::program::Program;

mod capture;
mod fragment;
mod locations;
mod previous;
mod separate_calls;
mod vertex;
pub mod without_jitter;

#[derive(Clone, Debug)]
pub(crate) struct ExtraPicture {
    pub name: String,
    pub shows: Shows,
    /// Whether its target holds floats of 32 bits, in place of 16.
    pub full: bool,
}

/// The content of a picture.
#[derive(Clone, Debug)]
pub(crate) enum Shows {
    /// A value of the fragment stage.
    Value(Authored),
    Direction(Normal, Direction),
    /// Where a point is on the screen, less where it was in the previous frame.
    Velocity(Velocity),
    /// Numbers of draw and instance.
    Id,
    /// How far the surface is from a light.
    Distance(Distance),
    /// Zeros, for an API that wants each bound target to be written.
    Nothing,
}

/// A direction of the surface.
#[derive(Clone, Debug)]
pub(crate) enum Normal {
    /// A value of the fragment stage.
    Value(Authored),
    /// The normal of the triangle.
    Face(Face),
}

/// The triangle whose normal is written.
#[derive(Clone, Debug)]
pub(crate) struct Face {
    /// The surface. A value is an input of the fragment stage.
    pub from: Surface,
    /// Whether its axes are left-handed.
    pub is_left_handed: bool,
    /// Whether the y of the clip position points down.
    pub is_down: bool,
}

/// How a direction is written.
#[derive(Clone, Debug, Default)]
pub(crate) struct Direction {
    /// A matrix in a buffer that turns it first.
    pub turned: Option<Member>,
    /// Whether it is encoded in two numbers.
    pub octahedral: bool,
    /// Whether it is encoded in three numbers from 0 to 1.
    pub unsigned: bool,
}

/// A buffer, or a part of one.
pub(crate) type Member = mapping::MappedPlace;

/// The two ends of a distance, and its unit.
#[derive(Clone, Debug)]
pub(crate) struct Distance {
    pub from: Surface,
    /// The light's position, a vector of three or four; `None`: a uniform of the pass has it, with
    /// the range as the fourth component.
    pub light: Option<Member>,
    /// A number that the distance is divided by.
    pub range: Option<Member>,
}

#[derive(Clone, Debug)]
pub(crate) enum Surface {
    /// A vector of three or four of the fragment stage.
    Value(Authored),
    /// A position of the vertex stage.
    World(World),
}

/// The resources from which the position of the previous frame is computed.
#[derive(Clone, Debug, Default)]
pub(crate) struct Velocity {
    /// Buffers, or loose uniforms, that do not change.
    pub still: Vec<Member>,
    /// Locations of attributes that change.
    pub moving: BTreeSet<u32>,
    /// Buffers, or parts of them, that are taken as 0 in both frames. The steps may lead to a number
    /// in a matrix, and the type is then the matrix's.
    pub jitter: Vec<Member>,
    /// Parts of buffers that have jitter, and those without that take their place.
    pub steady: Vec<[Member; 2]>,
    /// Whether the y of the clip position points down.
    pub is_down: bool,
}

#[derive(Debug)]
pub(crate) struct Extended {
    /// Its program, with the author's entry points extended.
    pub program: Program,
    /// Name of the fragment entry point.
    pub fragment: String,
    /// Format of the target of each output, by location.
    pub formats: Vec<&'static str>,
    /// Sources of bindings that the author does not have.
    pub bindings: BTreeMap<(u32, u32), BindingSource>,
    /// Attributes of the previous frame: location, and that of the author's.
    pub attributes: BTreeMap<u32, u32>,
    /// The first locations of varyings and of attributes that are not the author's.
    first: [u32; 2],
}

/// Why a material cannot be extended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failed {
    /// No target has a format for the value of this name.
    Type(String),
    /// The position of the previous frame cannot be computed, for this reason.
    Previous(String),
    /// The position does not read this jitter.
    Unread(String),
    /// The result is invalid: a bug.
    Built(String),
}

/// A material that is being extended.
struct Extending<'o, 'p> {
    opaque: &'o Opaque<'p>,
    module: Module,
    bindings: BTreeMap<(u32, u32), BindingSource>,
    attributes: BTreeMap<u32, u32>,
    /// The group of new bindings, if it is given.
    group: Option<u32>,
    /// The block of the previous frame's loose uniforms.
    previous_loose: Option<ResourceBinding>,
    /// A loose uniform that the host fills: its block, and its declaration.
    host_loose: Option<(ResourceBinding, Declaration)>,
}

/// A value that the vertex stage passes on.
#[derive(Clone, Debug)]
struct Varying {
    name: &'static str,
    ty: Handle<Type>,
    binding: Binding,
}

/// The values that the vertex stage passes on.
#[derive(Clone, Debug, Default)]
struct Varyings {
    /// x, y and w of the clip position.
    clip: Option<Varying>,
    /// Clip position of the previous frame.
    previous: Option<Varying>,
    instance: Option<Varying>,
    /// Position in the world.
    world: Option<Varying>,
}

/// Extends the main pass of a material by outputs, at locations from 0. New bindings are in `group`;
/// by default, copies of buffers are in the group of the original.
///
/// # Errors
/// [`Failed`].
pub(crate) fn extend(
    opaque: &Opaque<'_>,
    wanted: &[ExtraPicture],
    group: Option<u32>,
) -> Result<Extended, Failed> {
    let mut extending = Extending {
        opaque,
        module: opaque.program.module().clone(),
        bindings: BTreeMap::new(),
        attributes: BTreeMap::new(),
        group,
        previous_loose: None,
        host_loose: None,
    };
    let first = [extending.free_location(), extending.free_attribute()];
    let wanted = extending.separate(wanted)?;
    let varyings = extending.vertex_stage(&wanted)?;
    let (fragment, formats) = extending.fragment_stage(&wanted, &varyings)?;
    let program = opaque.program.with_module(extending.module);
    let program = program.map_err(|e| Failed::Built(e.to_string()))?;
    let mut declared = Declared {
        previous: extending.previous_loose,
        ..opaque.program.declared().clone()
    };
    if let Some((at, uniform)) = extending.host_loose {
        declared.host = Some(at);
        declared.uniforms.push(uniform);
    }
    Ok(Extended {
        program: program.with_declared(declared),
        fragment,
        formats,
        bindings: extending.bindings,
        attributes: extending.attributes,
        first,
    })
}

impl Shows {
    /// The surface that it is computed from.
    fn surface(&self) -> Option<&Surface> {
        match self {
            Self::Distance(Distance { from, .. })
            | Self::Direction(Normal::Face(Face { from, .. }), _) => Some(from),
            _ => None,
        }
    }
}

impl Distance {
    /// The value of the picture where no surface is: the end of the range, or the largest number.
    pub fn clear_value(&self) -> f64 {
        match self.is_divided() {
            true => 1.0,
            false => f64::from(f32::MAX),
        }
    }

    /// Whether distances are divided by the range.
    pub fn is_divided(&self) -> bool {
        self.range.is_some() || self.light.is_none()
    }
}

impl Extended {
    /// Gives our varyings and attributes the first locations that the author's leave free: the
    /// slice needs few of the author's.
    pub fn renumber(&mut self, placed: &mut Placed) {
        let [varying, attribute] = self.first;
        locations::varyings(placed, varying);
        let to = locations::attributes(placed, attribute);
        let attributes = self.attributes.iter();
        self.attributes = attributes
            .map(|(location, of)| (to.get(location).copied().unwrap_or(*location), *of))
            .collect();
    }

    /// Marks the attributes of the previous frame.
    pub fn mark(&self, attributes: &mut [AttributeUse]) {
        for attribute in attributes {
            attribute.previous_of = self.attributes.get(&attribute.location).copied();
        }
    }
}

impl Extending<'_, '_> {
    fn ty(&mut self, inner: TypeInner) -> Handle<Type> {
        let ty = Type { name: None, inner };
        self.module.types.insert(ty, Span::UNDEFINED)
    }

    fn vec3(&mut self) -> Handle<Type> {
        self.ty(TypeInner::Vector {
            size: VectorSize::Tri,
            scalar: Scalar::F32,
        })
    }

    /// The first location that neither stage has between the two.
    fn free_location(&self) -> u32 {
        let module = &self.module;
        let vertex = &module.entry_points[self.opaque.vertex].function;
        let fragment = self
            .opaque
            .fragment
            .map(|f| &module.entry_points[f].function);
        let outputs = interface::outputs(module, vertex);
        let inputs = fragment.map(|f| interface::inputs(module, f));
        let all = outputs.into_iter().chain(inputs.into_iter().flatten());
        let locations = all.filter_map(|io| location_of(io.binding.as_ref()));
        locations.max().map_or(0, |most| most + 1)
    }

    /// The first location behind those of the author's attributes.
    fn free_attribute(&self) -> u32 {
        let module = &self.module;
        let function = &module.entry_points[self.opaque.vertex].function;
        let inputs = interface::inputs(module, function);
        let taken = inputs
            .iter()
            .filter_map(|io| location_of(io.binding.as_ref()));
        taken.max().map_or(0, |most| most + 1)
    }

    /// The first binding behind all others of a group, or of the group that is given.
    fn free_binding(&self, group: u32) -> ResourceBinding {
        let group = self.group.unwrap_or(group);
        let globals = self.module.global_variables.iter();
        let of_group = globals.filter_map(|(_, g)| g.binding.filter(|b| b.group == group));
        let binding = of_group.map(|b| b.binding + 1).max().unwrap_or(0);
        ResourceBinding { group, binding }
    }

    /// A vector of four that the host fills. A shader with loose uniforms gets another loose one.
    fn host_vector(&mut self, name: &str, value: HostValue) -> Member {
        let vector = self.ty(TypeInner::Vector {
            size: VectorSize::Quad,
            scalar: Scalar::F32,
        });
        let known = self.opaque.program.declared();
        if known.loose.is_none() {
            return Member {
                global: self.host_uniform(name, vector, value),
                steps: Vec::new(),
                ty: vector,
            };
        }
        let mut free = name.to_owned();
        while known.uniforms.iter().any(|u| u.name == free) {
            free.push('_');
        }
        let block = Type {
            name: Some(format!("{free}_block")),
            inner: TypeInner::Struct {
                members: vec![StructMember {
                    name: Some(free.clone()),
                    ty: vector,
                    binding: None,
                    offset: 0,
                }],
                span: 16,
            },
        };
        let ty = self.module.types.insert(block, Span::UNDEFINED);
        let global = self.host_uniform(&format!("{free}_uniforms"), ty, value);
        let uniform = Declaration {
            name: free,
            ty: declared::Type::Plain("vec4".to_owned()),
            location: None,
        };
        let at = self.module.global_variables[global].binding;
        self.host_loose = at.map(|at| (at, uniform));
        Member {
            global,
            steps: vec![0],
            ty: vector,
        }
    }

    /// A uniform that the host fills, in the last group of the author's: that of the most frequent
    /// changes, by custom.
    fn host_uniform(
        &mut self,
        name: &str,
        ty: Handle<Type>,
        value: HostValue,
    ) -> Handle<GlobalVariable> {
        let globals = self.module.global_variables.iter();
        let groups = globals.filter_map(|(_, g)| Some(g.binding?.group));
        let at = self.free_binding(groups.max().unwrap_or(0));
        self.bindings
            .insert((at.group, at.binding), BindingSource::Host { value });
        let variable = GlobalVariable {
            name: Some(name.to_owned()),
            space: AddressSpace::Uniform,
            binding: Some(at),
            ty,
            init: None,
            memory_decorations: naga::MemoryDecorations::empty(),
        };
        self.module
            .global_variables
            .append(variable, Span::UNDEFINED)
    }
}

fn location_of(binding: Option<&Binding>) -> Option<u32> {
    match binding {
        Some(Binding::Location { location, .. }) => Some(*location),
        _ => None,
    }
}

fn varying(location: u32, interpolation: Interpolation, sampling: Sampling) -> Binding {
    Binding::Location {
        location,
        interpolation: Some(interpolation),
        sampling: Some(sampling),
        blend_src: None,
        per_primitive: false,
    }
}

/// Whether a binding is a vertex stage's position.
fn is_position(binding: Option<&Binding>) -> bool {
    matches!(binding, Some(Binding::BuiltIn(BuiltIn::Position { .. })))
}

/// A pointer to a part of a variable.
fn pointer(
    append: &mut dyn FnMut(Expression) -> Handle<Expression>,
    variable: Handle<GlobalVariable>,
    steps: &[usize],
) -> Handle<Expression> {
    let whole = append(Expression::GlobalVariable(variable));
    steps.iter().fold(whole, |base, step| {
        let index = *step as u32;
        append(Expression::AccessIndex { base, index })
    })
}

/// The value of a buffer, or of a part of it.
fn buffer(
    append: &mut dyn FnMut(Expression) -> Handle<Expression>,
    member: &Member,
) -> Handle<Expression> {
    let pointer = pointer(append, member.global, &member.steps);
    append(Expression::Load { pointer })
}

/// A member of a returned struct.
fn returned(
    writer: &mut FunctionWriter,
    value: Handle<Expression>,
    index: u32,
) -> Handle<Expression> {
    match &writer.function.expressions[value] {
        Expression::Compose { components, .. } => components[index as usize],
        _ => writer.expression(Expression::AccessIndex { base: value, index }),
    }
}
