//! Writes the resolve's entry point, statement by statement.

use std::collections::BTreeMap;

use naga::{
    BinaryOperator, Binding, BuiltIn, Expression, Function, FunctionResult, Handle, Interpolation,
    Literal, Module, Scalar, ScalarKind, Statement, StructMember, Type, TypeInner, VectorSize,
};

use super::Select;
use super::gradients::{GRADIENTS, Level};
use super::ids::Facing;
use super::legal::Stored;
use super::resolve::{Runs, VertexStage, width};
use naga_edit::interface::Io;
use preshade_passes::rebuild::place::CodeBuilder;
use preshade_plan::rasterizer::Neighbours;

/// An input of the fragment stage.
type StageInput = (Handle<Type>, Binding);

/// A function of the fragment stage's inputs.
pub struct Shader {
    pub function: Handle<Function>,
    /// The types of its arguments, and the inputs for them or their members.
    arguments: Vec<(Handle<Type>, Vec<StageInput>)>,
}

impl Shader {
    pub fn new(module: &Module, function: Handle<Function>, bindings: &[Vec<Binding>]) -> Self {
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

    pub fn inputs(&self) -> impl Iterator<Item = &StageInput> {
        self.arguments.iter().flat_map(|(_, members)| members)
    }

    fn call(
        &self,
        build: &mut CodeBuilder<'_>,
        mut value: impl FnMut(&mut CodeBuilder<'_>, Handle<Type>, &Binding) -> Handle<Expression>,
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

/// The fragment stage under construction, and its callees.
pub(crate) struct ResolveStage<'a> {
    pub corner: Handle<Function>,
    pub author: &'a VertexStage,
    pub shade: &'a Shader,
    pub levels: &'a [(Level, Shader)],
    pub ours: &'a BTreeMap<String, Handle<Function>>,
    pub facing: Facing,
    pub select: Select,
    pub colors: Colors,
    /// Index of the position among the author's outputs.
    pub position: u32,
}

/// The colours in the fragment stage's result.
pub(crate) enum Colors {
    /// The result is a colour.
    One(Colored),
    /// They are members. `None`: the second source of a blend, which an opaque pass does not read.
    Members(Vec<Option<Colored>>),
}

#[derive(Clone, Copy)]
pub(crate) struct Colored {
    location: u32,
    /// Bytes per component.
    width: u8,
}

/// The colours in the author's result.
pub(crate) fn colors(module: &Module, result: &FunctionResult) -> Colors {
    let color = |ty: Handle<Type>, b: &Option<Binding>| Colored {
        location: match b {
            Some(Binding::Location { location, .. }) => *location,
            _ => 0,
        },
        width: module.types[ty].inner.scalar_width().unwrap_or(4),
    };
    match (&result.binding, &module.types[result.ty].inner) {
        (None, TypeInner::Struct { members, .. }) => {
            let is_second = |b: &Option<Binding>| {
                matches!(
                    b,
                    Some(Binding::Location {
                        blend_src: Some(1),
                        ..
                    })
                )
            };
            let first =
                |m: &StructMember| (!is_second(&m.binding)).then(|| color(m.ty, &m.binding));
            Colors::Members(members.iter().map(first).collect())
        }
        (binding, _) => Colors::One(color(result.ty, binding)),
    }
}

/// Values shared by all pixels of a triangle.
struct Triangle {
    id: Handle<Expression>,
    number: Handle<Expression>,
    /// The author's outputs at each corner.
    corners: [Handle<Expression>; 3],
    positions: [Handle<Expression>; 3],
}

/// Where a pixel may lie relative to the triangle.
#[derive(Clone, Copy, PartialEq, Eq)]
enum LanePlace {
    /// The triangle covers it.
    Covered,
    Anywhere,
}

/// A pixel and its place in the triangle.
struct Lane {
    at: Handle<Expression>,
    perspective: Handle<Expression>,
    linear: Option<Handle<Expression>>,
}

impl ResolveStage<'_> {
    fn our(
        &self,
        build: &mut CodeBuilder<'_>,
        name: &str,
        arguments: Vec<Handle<Expression>>,
    ) -> Option<Handle<Expression>> {
        build.call(*self.ours.get(name)?, arguments)
    }

    /// Writes the stage. Returns a message if it fails.
    pub fn write(&self, build: &mut CodeBuilder<'_>, runs: &Runs) -> Option<String> {
        let written = match runs {
            Runs::Fragment => self.fragment(build),
            Runs::Compute(targets) => self.compute(build, targets),
        };
        written
            .is_none()
            .then(|| "a function of ours, or an input of the fragment stage, is missing".to_owned())
    }

    fn fragment(&self, build: &mut CodeBuilder<'_>) -> Option<()> {
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

    fn compute(&self, build: &mut CodeBuilder<'_>, targets: &[Stored]) -> Option<()> {
        let vec3 = build.ty(TypeInner::Vector {
            size: VectorSize::Tri,
            scalar: Scalar::U32,
        });
        let inputs = [
            ("group", BuiltIn::WorkGroupId),
            ("local", BuiltIn::LocalInvocationId),
        ];
        let passed = inputs
            .map(|(name, builtin)| build.argument(name, vec3, Some(Binding::BuiltIn(builtin))));
        let number = self.our(build, "visible_place", passed.to_vec())?;
        build.name(number, "number");
        let leave = Statement::Return { value: None };
        let outside = self.our(build, "visible_outside", vec![number])?;
        build.if_then(outside, |build| build.statement(leave.clone()));
        let at = self.our(build, "visible_pixel", vec![number])?;
        build.name(at, "at");
        let value = self.color(build, at, leave)?;
        let stores: Vec<(Colored, Option<u32>)> = match &self.colors {
            Colors::One(location) => vec![(*location, None)],
            Colors::Members(locations) => {
                let members = locations.iter().zip(0..);
                members
                    .filter_map(|(l, index)| Some(((*l)?, Some(index))))
                    .collect()
            }
        };
        // Colours without a target are not written.
        let is_kept = |(location, _): &(Colored, Option<u32>)| {
            targets.iter().any(|t| t.location == location.location)
        };
        for (Colored { location, width }, member) in stores.into_iter().filter(is_kept) {
            let mut color = match member {
                None => value,
                Some(index) => build.expression(Expression::AccessIndex { base: value, index }),
            };
            if width != Scalar::F32.width {
                color = build.expression(Expression::As {
                    expr: color,
                    kind: ScalarKind::Float,
                    convert: Some(Scalar::F32.width),
                });
            }
            let store = self.ours.get(&format!("visible_store_{location}_"))?;
            build.call(*store, vec![number, color]);
        }
        Some(())
    }

    /// The fragment stage's result at a pixel, or `leave` if the pixel belongs to another draw.
    fn color(
        &self,
        build: &mut CodeBuilder<'_>,
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
        let here = self.lane(build, &triangle, pixel, LanePlace::Covered)?;
        let mut gradients = BTreeMap::new();
        for (level, shader) in self.levels {
            self.differences(build, &triangle, &here, (level, shader), &mut gradients)?;
        }
        self.call(build, self.shade, &triangle, &here, &gradients)
    }

    fn triangle(
        &self,
        build: &mut CodeBuilder<'_>,
        at: Handle<Expression>,
        leave: Statement,
    ) -> Option<Triangle> {
        let id = self.our(build, "visible_id", vec![at])?;
        build.name(id, "id");
        if matches!(self.select, Select::Id | Select::Tiles) {
            let is_ours = self.our(build, "visible_is_ours", vec![id])?;
            let other = build.expression(Expression::Unary {
                op: naga::UnaryOperator::LogicalNot,
                expr: is_ours,
            });
            build.if_then(other, |build| build.statement(leave));
        }
        let instance = self.our(build, "visible_instance", vec![id])?;
        build.name(instance, "instance");
        let number = self.our(build, "visible_triangle", vec![id])?;
        build.name(number, "triangle");
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
        build: &mut CodeBuilder<'_>,
        base: Handle<Expression>,
        index: u32,
    ) -> Handle<Expression> {
        match self.author.is_struct {
            true => build.expression(Expression::AccessIndex { base, index }),
            false => base,
        }
    }

    /// The weights at a pixel.
    fn lane(
        &self,
        build: &mut CodeBuilder<'_>,
        triangle: &Triangle,
        at: Handle<Expression>,
        place: LanePlace,
    ) -> Option<Lane> {
        let [a, b, c] = triangle.positions;
        let mut edges = self.our(build, "visible_edges", vec![at, a, b, c])?;
        if place == LanePlace::Covered {
            edges = self.our(build, "visible_covered", vec![edges])?;
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
        build: &mut CodeBuilder<'_>,
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
        build: &mut CodeBuilder<'_>,
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
            Binding::BuiltIn(BuiltIn::FrontFacing) => match self.facing {
                Facing::Front => Some(build.literal(Literal::Bool(true))),
                Facing::Back => Some(build.literal(Literal::Bool(false))),
                Facing::Written => self.our(build, "visible_is_front", vec![triangle.id]),
            },
            Binding::BuiltIn(BuiltIn::PrimitiveIndex) => Some(triangle.number),
            Binding::BuiltIn(_) => None,
        }
    }

    /// The gradients of a level: differences of its values between pixels of the quad.
    fn differences(
        &self,
        build: &mut CodeBuilder<'_>,
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
                    own = self.lane(build, triangle, at, LanePlace::Anywhere)?;
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
            let part = |build: &mut CodeBuilder<'_>, base| match several {
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

/// How a pixel gets a vertex output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Travels {
    /// Taken from the first corner.
    Flat,
    Perspective,
    Linear,
}

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
