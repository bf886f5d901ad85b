//! The resolve pass: the author's two stages on the triangle that a pixel shows.
//!
//! ```text
//! fs_visible(at) -> id = ids[at]; discard where it is another draw's
//!                   a, b, c = vs_corner(each corner of the triangle, instance)
//!                   weights of a, b and c at this pixel, and at those of its quad for the gradients
//!                   fs_shaded(varyings by their own interpolation, builtins reconstructed, gradients)
//! ```

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    BinaryOperator, Binding, BuiltIn, Expression, Function, FunctionResult, Handle, Interpolation,
    Literal, Module, Scalar, ScalarKind, ShaderStage, Span, Statement, Type, TypeInner, VectorSize,
};

use super::Select;
use super::gradients::{Explicit, GRADIENTS, Level, Neighbours};
use super::ids::new_entry;
use super::text::{self, Slots};
use crate::fetch::{Author, Linked, corner, ours};
use crate::geometry::Formats;
use crate::graph::{FunctionId, Graph};
use crate::hoist::hoisted::as_function;
use crate::place::{self, Builder, PositionInvariance, Rewrite};
use crate::plan::AttributeUse;
use crate::program::Program;
use crate::reflect::{self, Io};
use crate::slice::{self, Criterion, OutputFilter};
use crate::state::FrontFace;

/// Names of the entry points.
pub const VERTEX: &str = "vs_visible";
/// Names of the entry points.
pub const FRAGMENT: &str = "fs_visible";
/// Names of the entry points.
pub const COMPUTE: &str = "cs_visible";

/// A function of the fragment stage's inputs.
struct Shader {
    function: Handle<Function>,
    /// The types of its arguments, and the inputs that they, or their members, stand for.
    arguments: Vec<(Handle<Type>, Vec<(Handle<Type>, Binding)>)>,
}

impl Shader {
    fn new(module: &Module, function: Handle<Function>, bindings: &[Vec<Binding>]) -> Self {
        let arguments = module.functions[function].arguments.iter().zip(bindings);
        let arguments = arguments.map(|(argument, bindings)| {
            let types = match &module.types[argument.ty].inner {
                TypeInner::Struct { members, .. } => members.iter().map(|m| m.ty).collect(),
                _ => vec![argument.ty],
            };
            let members = types.into_iter().zip(bindings.iter().cloned());
            (argument.ty, members.collect())
        });
        Self {
            function,
            arguments: arguments.collect(),
        }
    }

    fn inputs(&self) -> impl Iterator<Item = &(Handle<Type>, Binding)> {
        self.arguments.iter().flat_map(|(_, members)| members)
    }

    fn call(
        &self,
        build: &mut Builder<'_>,
        mut value: impl FnMut(&mut Builder<'_>, Handle<Type>, &Binding) -> Handle<Expression>,
    ) -> Option<Handle<Expression>> {
        let mut passed = Vec::new();
        for (ty, members) in &self.arguments {
            let mut components: Vec<_> = members
                .iter()
                .map(|(ty, binding)| value(build, *ty, binding))
                .collect();
            let is_struct = matches!(build.module().types[*ty].inner, TypeInner::Struct { .. });
            passed.push(match components.pop() {
                Some(only) if !is_struct => only,
                last => {
                    components.extend(last);
                    build.expression(Expression::Compose {
                        ty: *ty,
                        components,
                    })
                }
            });
        }
        build.call(self.function, passed)
    }
}

/// What the resolve pass is made of.
pub struct Resolve<'a> {
    /// The fragment stage without derivatives, sliced to its colours.
    pub explicit: Explicit,
    /// Index of that fragment stage.
    pub fragment: usize,
    /// Index of the author's vertex stage.
    pub vertex: usize,
    /// Attributes to fetch: those of the author's.
    pub attributes: &'a [AttributeUse],
    /// Winding of front faces.
    pub front_face: FrontFace,
    /// How pixels of other draws are passed over.
    pub select: Select,
    /// Where it is run.
    pub runs: Runs,
    /// Formats that attributes may be stored in.
    pub formats: Formats,
}

/// Where the resolve is run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Runs {
    /// In the fragment stage of a pass over the screen.
    Fragment,
    /// In a compute stage that writes the colours of these locations and formats.
    Compute(Vec<(u32, String)>),
}

/// Side of the compute stage's workgroups, in pixels.
pub const WORKGROUP: u32 = 8;

/// A resolve stage, and the attributes it fetches.
pub struct Built {
    pub module: Module,
    pub attributes: Vec<AttributeUse>,
}

/// The fragment entry point of that index sliced to its colours, in the place of the entry point.
///
/// # Errors
/// A slice of ours that does not validate: a bug.
pub fn shaded(program: &Program, fragment: usize) -> Result<(Program, usize), String> {
    let graph = Graph::build(program);
    let entry = &program.module().entry_points[fragment];
    let outputs = reflect::outputs(program.module(), &entry.function);
    let colors: Vec<Criterion> = outputs
        .iter()
        .filter_map(|o| match o.binding {
            Some(Binding::Location { location, .. }) => {
                Some(Criterion::Output(OutputFilter::Location(location)))
            }
            _ => None,
        })
        .collect();
    let slice = slice::backward(&graph, fragment, &colors);
    let name = format!("{}_shaded", entry.name);
    let module = place::entry_point(
        &graph,
        &slice,
        program.module(),
        &name,
        "shaded",
        PositionInvariance::AsWritten,
    );
    let index = module.entry_points.len() - 1;
    let program = program.with_module(module).map_err(|e| e.to_string())?;
    Ok((program, index))
}

impl Resolve<'_> {
    /// The module with the resolve pass's entry points.
    ///
    /// # Errors
    /// In words: our own text does not parse or link, or the stages do not fit together.
    pub fn build(self, slots: Slots) -> Result<Built, String> {
        let Self {
            explicit,
            fragment,
            vertex,
            attributes,
            front_face,
            select,
            runs,
            formats,
        } = self;
        let mut module = explicit.program.module().clone();
        let shaded = module.entry_points.remove(fragment);
        let result = shaded.function.result.clone();
        let bindings: Vec<Vec<Binding>> = shaded
            .function
            .arguments
            .iter()
            .map(|a| match (&a.binding, reflect::members(&module, a.ty)) {
                (Some(binding), _) => vec![binding.clone()],
                (None, members) => members
                    .unwrap_or_default()
                    .into_iter()
                    .map(|m| m.1)
                    .collect(),
            })
            .collect();
        let name = shaded.name.clone();
        let shaded = as_function(&module, shaded.function, &name);
        let shaded = module.functions.append(shaded, Span::UNDEFINED);
        let shade = Shader::new(&module, shaded, &bindings);
        let levels: Vec<(Level, Shader)> = explicit
            .levels
            .into_iter()
            .map(|level| {
                let shader = Shader::new(&module, level.function, &level.arguments);
                (level, shader)
            })
            .collect();
        let read: BTreeSet<u32> = levels
            .iter()
            .flat_map(|(_, s)| s.inputs())
            .chain(shade.inputs())
            .filter_map(|(_, b)| match b {
                Binding::Location { location, .. } if *location < GRADIENTS => Some(*location),
                _ => None,
            })
            .collect();
        let built = explicit
            .program
            .with_module(module)
            .map_err(|e| e.to_string())?;
        let (module, author) = author(&built, vertex, &read)?;
        let used: Vec<AttributeUse> = {
            let inputs = reflect::opened(&module, &author.inputs);
            let read = |a: &&AttributeUse| {
                inputs.iter().any(|i| {
                    matches!(i.binding, Some(Binding::Location { location, .. }) if location == a.location)
                })
            };
            attributes.iter().filter(read).cloned().collect()
        };
        let widths = author.widths(&module);
        let mut wgsl = text::entry(slots, used.len());
        wgsl.push_str(&text::vertices(slots, &used, formats));
        wgsl.push_str(&text::resolve(slots, &widths));
        if let Runs::Compute(targets) = &runs {
            let first = slots.first + Slots::STREAMS + used.len() as u32;
            wgsl.push_str(&text::compute(slots.group, first, targets));
        }
        let Linked {
            module,
            ours: by_name,
        } = Linked::new(module, &wgsl)?;
        let mut fetch = Vec::new();
        for attribute in &used {
            let name = format!("visible_{}_", attribute.location);
            fetch.push((attribute.location, ours(&by_name, &name)?));
        }
        let name = module.entry_points[vertex].name.clone();
        let called = Author {
            function: author.function,
            given: author.given,
            inputs: &author.inputs,
        };
        let (mut module, corner) = corner(module, &name, &called, &fetch)?;
        let result = result.ok_or("the fragment stage gives no colour")?;
        let stage = Stage {
            corner,
            author: &author,
            shade: &shade,
            levels: &levels,
            ours: &by_name,
            front_face,
            select,
            colors: colors(&module, &result),
            position: author
                .position()
                .ok_or("the vertex stage gives no position")?,
        };
        let FunctionResult { ty, binding } = result;
        let at = match runs {
            Runs::Fragment => {
                let result = Some((ty, binding));
                new_entry(&mut module, ShaderStage::Fragment, FRAGMENT, result)
            }
            Runs::Compute(_) => {
                let at = new_entry(&mut module, ShaderStage::Compute, COMPUTE, None);
                module.entry_points[at].workgroup_size = [WORKGROUP, WORKGROUP, 1];
                at
            }
        };
        let mut failed = None;
        let module = place::rewritten(&module, FunctionId::EntryPoint(at), |build| {
            failed = stage.write(build, &runs);
            Rewrite::default()
        });
        match failed {
            None => Ok(Built {
                module,
                attributes: used,
            }),
            Some(why) => Err(why),
        }
    }
}

/// The author's vertex stage as far as it is needed, as a function.
struct VertexStage {
    function: Handle<Function>,
    given: Handle<Type>,
    inputs: Vec<naga::FunctionArgument>,
    outputs: Vec<Io>,
    is_struct: bool,
}

fn author(
    program: &Program,
    vertex: usize,
    read: &BTreeSet<u32>,
) -> Result<(Module, VertexStage), String> {
    let graph = Graph::build(program);
    let mut criteria = vec![Criterion::Output(OutputFilter::Position)];
    let locations = read.iter();
    criteria.extend(locations.map(|l| Criterion::Output(OutputFilter::Location(*l))));
    let slice = slice::backward(&graph, vertex, &criteria);
    let name = format!("{}_author", program.module().entry_points[vertex].name);
    let mut module = place::entry_point(
        &graph,
        &slice,
        program.module(),
        &name,
        "author",
        PositionInvariance::AsWritten,
    );
    let placed = module.entry_points.pop().ok_or("nothing was placed")?;
    let outputs = reflect::outputs(&module, &placed.function);
    let result = placed.function.result.as_ref();
    let result = result.ok_or("the vertex stage gives nothing")?;
    let (given, is_struct) = (result.ty, result.binding.is_none());
    let inputs = placed.function.arguments.clone();
    let function = as_function(&module, placed.function, &name);
    let function = module.functions.append(function, Span::UNDEFINED);
    let stage = VertexStage {
        function,
        given,
        inputs,
        outputs,
        is_struct,
    };
    Ok((module, stage))
}

/// How an output of the vertex stage reaches a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Travels {
    /// The first corner's.
    Flat,
    Perspective,
    Linear,
}

impl VertexStage {
    fn position(&self) -> Option<u32> {
        let is =
            |b: &Option<Binding>| matches!(b, Some(Binding::BuiltIn(BuiltIn::Position { .. })));
        self.outputs
            .iter()
            .position(|o| is(&o.binding))
            .map(|i| i as u32)
    }

    fn output(&self, location: u32) -> Option<(u32, &Io)> {
        let is = |o: &Io| matches!(o.binding, Some(Binding::Location { location: l, .. }) if l == location);
        let found = self.outputs.iter().position(is)?;
        Some((found as u32, &self.outputs[found]))
    }

    /// Widths of what is interpolated, each once.
    fn widths(&self, module: &Module) -> Vec<u8> {
        let widths: BTreeSet<u8> = self
            .outputs
            .iter()
            .filter(|o| matches!(&o.binding, Some(Binding::Location { .. })))
            .filter(|o| module.types[o.ty].inner.scalar_kind() == Some(ScalarKind::Float))
            .map(|o| width(&module.types[o.ty].inner))
            .collect();
        widths.into_iter().collect()
    }
}

fn width(inner: &TypeInner) -> u8 {
    match inner {
        TypeInner::Vector { size, .. } => *size as u8,
        _ => 1,
    }
}

/// The fragment stage that is written, and what it calls.
struct Stage<'a> {
    corner: Handle<Function>,
    author: &'a VertexStage,
    shade: &'a Shader,
    levels: &'a [(Level, Shader)],
    ours: &'a BTreeMap<String, Handle<Function>>,
    front_face: FrontFace,
    select: Select,
    colors: Colors,
    position: u32,
}

/// The colours in what the fragment stage gives.
enum Colors {
    /// It is the colour of that location.
    One(u32),
    /// They are members, of these locations.
    Members(Vec<u32>),
}

fn colors(module: &Module, result: &FunctionResult) -> Colors {
    let location = |b: &Option<Binding>| match b {
        Some(Binding::Location { location, .. }) => *location,
        _ => 0,
    };
    match (&result.binding, &module.types[result.ty].inner) {
        (None, TypeInner::Struct { members, .. }) => {
            Colors::Members(members.iter().map(|m| location(&m.binding)).collect())
        }
        (binding, _) => Colors::One(location(binding)),
    }
}

/// What is the same for all pixels of a triangle.
struct Triangle {
    id: Handle<Expression>,
    number: Handle<Expression>,
    /// What the author's stage gives at each corner.
    corners: [Handle<Expression>; 3],
    positions: [Handle<Expression>; 3],
}

/// What is known of where a pixel is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Place {
    /// In the triangle: a weight that is not between 0 and 1 was rounded, and is put there.
    Inside,
    Anywhere,
}

/// A pixel, and where in the triangle it is.
struct Lane {
    at: Handle<Expression>,
    perspective: Handle<Expression>,
    linear: Option<Handle<Expression>>,
}

impl Stage<'_> {
    fn our(
        &self,
        build: &mut Builder<'_>,
        name: &str,
        arguments: Vec<Handle<Expression>>,
    ) -> Option<Handle<Expression>> {
        let value = build.call(*self.ours.get(name)?, arguments);
        value
    }

    /// Writes the stage; why it could not, in words.
    fn write(&self, build: &mut Builder<'_>, runs: &Runs) -> Option<String> {
        let written = match runs {
            Runs::Fragment => self.fragment(build),
            Runs::Compute(_) => self.compute(build),
        };
        written
            .is_none()
            .then(|| "a function of ours, or an input of the fragment stage, is missing".to_owned())
    }

    fn fragment(&self, build: &mut Builder<'_>) -> Option<()> {
        let vec4 = build.ty(TypeInner::Vector {
            size: VectorSize::Quad,
            scalar: Scalar::F32,
        });
        let position = Binding::BuiltIn(BuiltIn::Position { invariant: false });
        let at = build.argument("at", vec4, Some(position));
        let value = self.color(build, at, Statement::Kill)?;
        build.statement(Statement::Return { value: Some(value) });
        Some(())
    }

    fn compute(&self, build: &mut Builder<'_>) -> Option<()> {
        let vec3 = build.ty(TypeInner::Vector {
            size: VectorSize::Tri,
            scalar: Scalar::U32,
        });
        let number = Binding::BuiltIn(BuiltIn::GlobalInvocationId);
        let number = build.argument("number", vec3, Some(number));
        let leave = Statement::Return { value: None };
        let outside = self.our(build, "visible_outside", vec![number])?;
        build.if_then(outside, |build| build.statement(leave.clone()));
        let at = self.our(build, "visible_pixel", vec![number])?;
        build.name(at, "at");
        let value = self.color(build, at, leave)?;
        let stores: Vec<(u32, Option<u32>)> = match &self.colors {
            Colors::One(location) => vec![(*location, None)],
            Colors::Members(locations) => {
                let members = locations.iter().zip(0..);
                members.map(|(l, index)| (*l, Some(index))).collect()
            }
        };
        for (location, member) in stores {
            let color = match member {
                None => value,
                Some(index) => build.expression(Expression::AccessIndex { base: value, index }),
            };
            let store = self.ours.get(&format!("visible_store_{location}_"))?;
            build.call(*store, vec![number, color]);
        }
        Some(())
    }

    /// What the fragment stage gives at a pixel; where it is another draw's, `leave`.
    fn color(
        &self,
        build: &mut Builder<'_>,
        at: Handle<Expression>,
        leave: Statement,
    ) -> Option<Handle<Expression>> {
        let triangle = self.triangle(build, at, leave)?;
        let pixel = build.expression(Expression::Swizzle {
            size: VectorSize::Bi,
            vector: at,
            pattern: XYZW,
        });
        build.name(pixel, "pixel");
        let here = self.lane(build, &triangle, pixel, Place::Inside)?;
        let mut gradients = BTreeMap::new();
        for (level, shader) in self.levels {
            self.differences(build, &triangle, &here, (level, shader), &mut gradients)?;
        }
        self.call(build, self.shade, &triangle, &here, &gradients)
    }

    fn triangle(
        &self,
        build: &mut Builder<'_>,
        at: Handle<Expression>,
        leave: Statement,
    ) -> Option<Triangle> {
        let id = self.our(build, "visible_id", vec![at])?;
        build.name(id, "id");
        if self.select == Select::Id {
            let is_ours = self.our(build, "visible_is_ours", vec![id])?;
            let other = build.expression(Expression::Unary {
                op: naga::UnaryOperator::LogicalNot,
                expr: is_ours,
            });
            build.if_then(other, |build| build.statement(leave));
        }
        let instance = self.our(build, "visible_instance", vec![id])?;
        build.name(instance, "instance");
        let number = build.named("triangle", Expression::AccessIndex { base: id, index: 1 });
        let mut corners = Vec::new();
        for (corner, name) in ["a", "b", "c"].into_iter().enumerate() {
            let corner = build.literal(Literal::U32(corner as u32));
            let vertex = self.our(build, "visible_corner", vec![number, corner])?;
            let value = build.call(self.corner, vec![vertex, instance])?;
            build.name(value, name);
            corners.push(value);
        }
        let corners: [Handle<Expression>; 3] = corners.try_into().ok()?;
        let positions = corners.map(|c| self.part(build, c, self.position));
        Some(Triangle {
            id,
            number,
            corners,
            positions,
        })
    }

    /// One of the author's outputs.
    fn part(
        &self,
        build: &mut Builder<'_>,
        base: Handle<Expression>,
        index: u32,
    ) -> Handle<Expression> {
        match self.author.is_struct {
            true => build.expression(Expression::AccessIndex { base, index }),
            false => base,
        }
    }

    /// Weights at a pixel.
    fn lane(
        &self,
        build: &mut Builder<'_>,
        triangle: &Triangle,
        at: Handle<Expression>,
        place: Place,
    ) -> Option<Lane> {
        let [a, b, c] = triangle.positions;
        let mut edges = self.our(build, "visible_edges", vec![at, a, b, c])?;
        if place == Place::Inside {
            edges = self.our(build, "visible_inside", vec![edges])?;
        }
        let perspective = self.our(build, "visible_normalised", vec![edges])?;
        let is_linear = |o: &Io| travels(o.binding.as_ref(), ScalarKind::Float) == Travels::Linear;
        let linear = match self.author.outputs.iter().any(is_linear) {
            true => Some(self.our(build, "visible_linear", vec![edges, a, b, c])?),
            false => None,
        };
        Some(Lane {
            at,
            perspective,
            linear,
        })
    }

    /// Calls a function of the fragment stage's inputs for a pixel.
    fn call(
        &self,
        build: &mut Builder<'_>,
        shader: &Shader,
        triangle: &Triangle,
        lane: &Lane,
        gradients: &BTreeMap<u32, Handle<Expression>>,
    ) -> Option<Handle<Expression>> {
        let mut missing = false;
        let value = shader.call(build, |build, ty, binding| {
            let found = self.input(build, triangle, lane, gradients, (ty, binding));
            found.unwrap_or_else(|| {
                missing = true;
                triangle.id
            })
        });
        value.filter(|_| !missing)
    }

    /// An input of the fragment stage at a pixel.
    fn input(
        &self,
        build: &mut Builder<'_>,
        triangle: &Triangle,
        lane: &Lane,
        gradients: &BTreeMap<u32, Handle<Expression>>,
        (ty, binding): (Handle<Type>, &Binding),
    ) -> Option<Handle<Expression>> {
        let [a, b, c] = triangle.positions;
        match binding {
            Binding::Location { location, .. } if *location >= GRADIENTS => {
                gradients.get(location).copied()
            }
            Binding::Location { location, .. } => {
                let (index, output) = self.author.output(*location)?;
                let inner = build.module().types[ty].inner.clone();
                let weights = match travels(output.binding.as_ref(), inner.scalar_kind()?) {
                    Travels::Flat => return Some(self.part(build, triangle.corners[0], index)),
                    Travels::Perspective => lane.perspective,
                    Travels::Linear => lane.linear?,
                };
                let mut passed = vec![weights];
                for corner in triangle.corners {
                    passed.push(self.part(build, corner, index));
                }
                self.our(build, &format!("visible_blend_{}_", width(&inner)), passed)
            }
            Binding::BuiltIn(BuiltIn::Position { .. }) => self.our(
                build,
                "visible_position",
                vec![lane.at, lane.perspective, a, b, c],
            ),
            Binding::BuiltIn(BuiltIn::FrontFacing) => {
                let winding = self.our(build, "visible_winding", vec![a, b, c])?;
                let zero = build.literal(Literal::F32(0.0));
                Some(build.expression(Expression::Binary {
                    op: match self.front_face {
                        FrontFace::Ccw => BinaryOperator::Greater,
                        FrontFace::Cw => BinaryOperator::Less,
                    },
                    left: winding,
                    right: zero,
                }))
            }
            Binding::BuiltIn(BuiltIn::PrimitiveIndex) => Some(triangle.number),
            Binding::BuiltIn(_) => None,
        }
    }

    /// The gradients of a level: differences of its values between pixels of the quad.
    fn differences(
        &self,
        build: &mut Builder<'_>,
        triangle: &Triangle,
        here: &Lane,
        (level, shader): (&Level, &Shader),
        gradients: &mut BTreeMap<u32, Handle<Expression>>,
    ) -> Option<()> {
        let neighbour = match level.neighbours {
            Neighbours::Quad => "visible_in_quad",
            Neighbours::Own => "visible_beside",
        };
        let mut values = Vec::new();
        for (x, y) in [(0, 0), (1, 0), (0, 1)] {
            let own;
            let lane = match (level.neighbours, x + y) {
                (Neighbours::Own, 0) => here,
                _ => {
                    let [x, y] = [x, y].map(|n| build.literal(Literal::U32(n)));
                    let at = self.our(build, neighbour, vec![here.at, x, y])?;
                    own = self.lane(build, triangle, at, Place::Anywhere)?;
                    &own
                }
            };
            values.push(self.call(build, shader, triangle, lane, gradients)?);
        }
        let [first, x, y] = values[..] else {
            return None;
        };
        let away = match level.neighbours {
            Neighbours::Quad => None,
            Neighbours::Own => Some(self.our(build, "visible_away", vec![here.at])?),
        };
        let several = level.values.len() > 1;
        for index in 0..level.values.len() as u32 {
            let part = |build: &mut Builder<'_>, base| match several {
                true => build.expression(Expression::AccessIndex { base, index }),
                false => base,
            };
            for (axis, beside) in [x, y].into_iter().enumerate() {
                let (left, right) = (part(build, beside), part(build, first));
                let mut gradient = build.expression(Expression::Binary {
                    op: BinaryOperator::Subtract,
                    left,
                    right,
                });
                if let Some(away) = away {
                    let right = build.expression(Expression::AccessIndex {
                        base: away,
                        index: axis as u32,
                    });
                    gradient = build.expression(Expression::Binary {
                        op: BinaryOperator::Multiply,
                        left: gradient,
                        right,
                    });
                }
                let location = level.first + 2 * index + axis as u32;
                gradients.insert(location, gradient);
            }
        }
        Some(())
    }
}

const XYZW: [naga::SwizzleComponent; 4] = [
    naga::SwizzleComponent::X,
    naga::SwizzleComponent::Y,
    naga::SwizzleComponent::Z,
    naga::SwizzleComponent::W,
];

fn travels(binding: Option<&Binding>, kind: ScalarKind) -> Travels {
    match binding {
        Some(Binding::Location {
            interpolation: Some(Interpolation::Linear),
            ..
        }) => Travels::Linear,
        Some(Binding::Location {
            interpolation: Some(Interpolation::Flat),
            ..
        }) => Travels::Flat,
        _ if kind != ScalarKind::Float => Travels::Flat,
        _ => Travels::Perspective,
    }
}
