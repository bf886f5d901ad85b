//! The fragment stage of an extended material: the author's decisions, and other outputs.

use naga::{
    BinaryOperator, Binding, BuiltIn, Expression, FunctionArgument, FunctionResult, Handle,
    Literal, MathFunction, Scalar, ScalarKind, SwizzleComponent, Type, TypeInner, VectorSize,
};
use naga_edit::interface;

use super::capture::Captured;
use super::vertex::{self, member};
use super::{
    Direction, Distance, Extending, ExtraPicture, Face, Failed, Member, Normal, Shows, Surface,
    Varying, Varyings, buffer, returned,
};
use crate::rebuild::color::{empty_fragment, location};
use crate::rebuild::place;
use crate::rebuild::snippet::link_snippet;
use naga_edit::returns;
use naga_edit::writer::FunctionWriter;
use preshade_plan::plan::HostValue;

/// Name of the fragment stage of a material that has none.
const OWN: &str = "fragment";

/// Octahedral normals (Cigolle et al., "A Survey of Efficient Representations for Independent Unit
/// Vectors", 2014), from -1 to 1.
const OCTAHEDRAL: &str = "\
fn octahedral(v: vec3<f32>) -> vec2<f32> {
    // A vector of length 0 stays 0.
    let flat = v.xy / max(abs(v.x) + abs(v.y) + abs(v.z), 1e-30);
    let side = select(vec2<f32>(-1.0), vec2<f32>(1.0), flat >= vec2<f32>(0.0));
    return select((1.0 - abs(flat.yx)) * side, flat, v.z >= 0.0);
}";

/// The normal of a triangle from its position and the x, y and w of its clip position. A target may
/// be upside down, so the place in the picture gives the direction of the derivatives. `SIDE` is
/// the comparison for the visible side.
///
/// The derivatives are those of the position divided by w, and point the same way. The position
/// divided by w is linear in the picture, so a difference of two pixels is exact. A difference of
/// positions turns round where the triangle's plane meets the horizon between them.
const FACE: &str = "\
fn face_normal(position: vec3<f32>, clip: vec3<f32>) -> vec3<f32> {
    let reciprocal = 1.0 / clip.z;
    let place = clip.xy * reciprocal;
    let place_x = dpdx(place);
    let place_y = dpdy(place);
    let scaled = position * reciprocal;
    let x = dpdx(scaled) - position * dpdx(reciprocal);
    let y = dpdy(scaled) - position * dpdy(reciprocal);
    // The products of small vectors may be too small for a float.
    let normal = cross(y / max(length(y), 1e-30), x / max(length(x), 1e-30));
    let is_seen = place_x.x * place_y.y - place_x.y * place_y.x SIDE 0.0;
    // A vector of length 0 stays 0.
    return select(-normal, normal, is_seen) / max(length(normal), 1e-30);
}";

/// An output that is ready to be written.
enum Ready {
    /// A value, with the type that it is converted to.
    Value(Captured, Widened),
    Direction(Captured, Direction, Option<Handle<naga::Function>>),
    /// Arguments with the positions, and whether y of clip space points down.
    Velocity([u32; 2], bool),
    Nothing,
    Id(u32, Handle<naga::GlobalVariable>, Handle<Type>),
    Distance(Measured),
}

/// A distance that is ready to be written.
struct Measured {
    from: Point,
    light: Member,
    is_light_of_four: bool,
    /// A number of its own; `None`: the fourth component of `light`, if `is_divided`.
    range: Option<Member>,
    is_divided: bool,
}

/// A position of three components, or of four.
struct Point {
    value: Captured,
    is_of_four: bool,
}

/// How a value fills a target.
#[derive(Clone, Copy, Debug)]
struct Widened {
    /// Half floats become floats first, and truth values 0 and 1.
    to: Option<ScalarKind>,
    /// The type of four components that one of three is filled up to with 1.
    filled: Option<(Handle<Type>, ScalarKind)>,
}

impl Extending<'_, '_> {
    /// Extends the fragment stage, or makes one. Returns its name and the targets' formats.
    pub(super) fn fragment_stage(
        &mut self,
        wanted: &[ExtraPicture],
        varyings: &Varyings,
    ) -> Result<(String, Vec<&'static str>), Failed> {
        let entry = self.opaque.fragment.unwrap_or_else(|| {
            self.module.entry_points.push(empty_fragment(OWN));
            self.module.entry_points.len() - 1
        });
        let own = self.module.entry_points[entry].function.result.clone();
        let mut ready = Vec::new();
        let mut formats = Vec::new();
        let mut members = Vec::new();
        for (i, wanted) in wanted.iter().enumerate() {
            let (made, ty, format) = self.ready(entry, wanted, varyings)?;
            ready.push(made);
            formats.push(format);
            let name = wanted
                .name
                .replace(|c: char| !c.is_ascii_alphanumeric(), "_");
            members.push(member(name, ty, Some(location(i as u32))));
        }
        let depth = self.depth_output(own.as_ref());
        if let Some((_, ty)) = depth {
            let binding = Binding::BuiltIn(BuiltIn::FragDepth);
            members.push(member("depth".to_owned(), ty, Some(binding)));
        }
        let result = match &members[..] {
            [one] => FunctionResult {
                ty: one.ty,
                binding: one.binding.clone(),
            },
            _ => {
                let name = Some("Outputs".to_owned());
                let ty = place::io_struct(&mut self.module, name, members.clone());
                FunctionResult { ty, binding: None }
            }
        };
        let types: Vec<Handle<Type>> = members.iter().map(|m| m.ty).collect();
        let is_single = members.len() == 1;
        let function = &mut self.module.entry_points[entry].function;
        function.result = Some(result.clone());
        returns::rewrite(function, &mut |writer, own| {
            let mut components: Vec<_> = ready
                .iter()
                .zip(&types)
                .map(|(ready, ty)| ready.write(writer, *ty))
                .collect();
            if let Some((index, _)) = depth {
                let own = own?;
                components.push(match index {
                    Some(index) => returned(writer, own, index),
                    None => own,
                });
            }
            match is_single {
                true => components.pop(),
                false => Some(writer.expression(Expression::Compose {
                    ty: result.ty,
                    components,
                })),
            }
        });
        let name = self.module.entry_points[entry].name.clone();
        Ok((name, formats))
    }

    /// The depth among the author's outputs: its member, unless it is the only one, and its type.
    fn depth_output(&self, own: Option<&FunctionResult>) -> Option<(Option<u32>, Handle<Type>)> {
        let own = own?;
        let depth = Some(Binding::BuiltIn(BuiltIn::FragDepth));
        if own.binding == depth {
            return Some((None, own.ty));
        }
        let members = interface::members(&self.module, own.ty)?;
        let mut members = (0..).zip(members);
        let (index, (ty, _)) = members.find(|(_, (_, binding))| Some(binding) == depth.as_ref())?;
        Some((Some(index), ty))
    }

    /// Prepares an output: with the type of its output, and the format of its target.
    fn ready(
        &mut self,
        entry: usize,
        wanted: &ExtraPicture,
        varyings: &Varyings,
    ) -> Result<(Ready, Handle<Type>, &'static str), Failed> {
        let missing = || Failed::Built(format!("`{}` has no varying", wanted.name));
        Ok(match &wanted.shows {
            Shows::Value(value) => {
                let (inner, widened) = self.widen(&value.inner);
                let format = format(&inner, wanted.full);
                let format = format.ok_or_else(|| Failed::Type(value.name.clone()))?;
                let captured = self.capture(entry, value)?;
                (Ready::Value(captured, widened), self.ty(inner), format)
            }
            Shows::Direction(normal, direction) => {
                let captured = match normal {
                    Normal::Value(value) => self.capture(entry, value)?,
                    Normal::Face(face) => {
                        let face = self.face(entry, face, varyings)?;
                        face.ok_or_else(missing)?
                    }
                };
                let mut encode = None;
                let mut size = VectorSize::Quad;
                if direction.octahedral {
                    encode = Some(self.snippet(OCTAHEDRAL)?);
                    size = VectorSize::Bi;
                }
                let inner = TypeInner::Vector {
                    size,
                    scalar: Scalar::F32,
                };
                let format = format(&inner, wanted.full);
                let format = format.ok_or_else(|| Failed::Type(wanted.name.clone()))?;
                let ready = Ready::Direction(captured, direction.clone(), encode);
                (ready, self.ty(inner), format)
            }
            Shows::Velocity(velocity) => {
                let now = varyings.clip.as_ref().ok_or_else(missing)?;
                let before = varyings.previous.as_ref().ok_or_else(missing)?;
                let inner = TypeInner::Vector {
                    size: VectorSize::Bi,
                    scalar: Scalar::F32,
                };
                let format = match wanted.full {
                    true => "rg32float",
                    false => "rg16float",
                };
                let arguments = [self.take(entry, now), self.take(entry, before)];
                let ready = Ready::Velocity(arguments, velocity.is_down);
                (ready, self.ty(inner), format)
            }
            Shows::Id => {
                let instance = varyings.instance.as_ref().ok_or_else(missing)?;
                let argument = self.take(entry, instance);
                let draw = self.host_uniform("draw_id", instance.ty, HostValue::DrawId);
                let ty = self.ty(TypeInner::Vector {
                    size: VectorSize::Bi,
                    scalar: Scalar::U32,
                });
                (Ready::Id(argument, draw, ty), ty, "rg32uint")
            }
            Shows::Distance(distance) => {
                let ty = self.ty(TypeInner::Scalar(Scalar::F32));
                let measured = self.measured(entry, distance, varyings)?;
                let measured = measured.ok_or_else(missing)?;
                // A depth of 16 bits is of no use to a comparison of depths.
                (Ready::Distance(measured), ty, "r32float")
            }
            Shows::Nothing => {
                let inner = TypeInner::Vector {
                    size: VectorSize::Quad,
                    scalar: Scalar::F32,
                };
                (Ready::Nothing, self.ty(inner), "rgba8unorm")
            }
        })
    }

    /// Prepares a distance. `None`: the vertex stage does not pass its position on.
    fn measured(
        &mut self,
        entry: usize,
        distance: &Distance,
        varyings: &Varyings,
    ) -> Result<Option<Measured>, Failed> {
        let Some(from) = self.point(entry, &distance.from, varyings)? else {
            return Ok(None);
        };
        let light = distance.light.clone();
        let light = light.unwrap_or_else(|| self.host_vector("point_light", HostValue::PointLight));
        Ok(Some(Measured {
            from,
            is_light_of_four: is_four(&self.module.types[light.ty].inner),
            light,
            range: distance.range.clone(),
            is_divided: distance.is_divided(),
        }))
    }

    /// The position of a surface. `None`: the vertex stage does not pass it on.
    fn point(
        &mut self,
        entry: usize,
        surface: &Surface,
        varyings: &Varyings,
    ) -> Result<Option<Point>, Failed> {
        Ok(match surface {
            Surface::Value(value) => Some(Point {
                value: self.capture(entry, value)?,
                is_of_four: is_four(&value.inner),
            }),
            Surface::World(world) => varyings.world.as_ref().map(|varying| Point {
                value: Captured::Argument(self.take(entry, varying), Vec::new()),
                is_of_four: !world.is_point,
            }),
        })
    }

    /// The normal of the triangle, computed before the author's code: derivatives must not stand
    /// behind branches. `None`: the vertex stage does not pass on the surface's position.
    fn face(
        &mut self,
        entry: usize,
        face: &Face,
        varyings: &Varyings,
    ) -> Result<Option<Captured>, Failed> {
        let (Some(point), Some(clip)) = (
            self.point(entry, &face.from, varyings)?,
            varyings.clip.as_ref(),
        ) else {
            return Ok(None);
        };
        let clip = self.take(entry, clip);
        // Where y of the clip position points up and that of the derivatives down, the place turns the other way round.
        let side = match face.is_left_handed == face.is_down {
            true => "<",
            false => ">",
        };
        let normal = self.snippet(&FACE.replace("SIDE", side))?;
        let function = &mut self.module.entry_points[entry].function;
        let value = FunctionWriter::start(function, |writer| {
            let position = point.read(writer);
            let clip = writer.expression(Expression::FunctionArgument(clip));
            writer.call(normal, vec![position, clip])
        });
        Ok(Some(Captured::Value(value, Vec::new())))
    }

    /// Adds a function of ours to the module.
    fn snippet(&mut self, wgsl: &str) -> Result<Handle<naga::Function>, Failed> {
        let module = std::mem::take(&mut self.module);
        let (module, function) =
            link_snippet(module, wgsl).map_err(|e| Failed::Built(e.to_string()))?;
        self.module = module;
        Ok(function)
    }

    /// The argument of the fragment stage that takes a varying. Two outputs may need the same one.
    fn take(&mut self, entry: usize, varying: &Varying) -> u32 {
        let arguments = &mut self.module.entry_points[entry].function.arguments;
        let known = arguments
            .iter()
            .position(|a| a.binding.as_ref() == Some(&varying.binding));
        if let Some(known) = known {
            return known as u32;
        }
        arguments.push(FunctionArgument {
            name: Some(varying.name.to_owned()),
            ty: varying.ty,
            binding: Some(varying.binding.clone()),
        });
        arguments.len() as u32 - 1
    }

    /// The type that a target takes for a value. No target has three components, half floats or
    /// truth values.
    fn widen(&mut self, inner: &TypeInner) -> (TypeInner, Widened) {
        let mut scalar = inner.scalar().unwrap_or(Scalar::F32);
        let to = match scalar {
            Scalar::F16 => Some(Scalar::F32),
            Scalar::BOOL => Some(Scalar::U32),
            _ => None,
        };
        scalar = to.unwrap_or(scalar);
        let (inner, is_filled) = match inner {
            TypeInner::Vector { size, .. } => {
                let is_filled = *size == VectorSize::Tri;
                let size = if is_filled { VectorSize::Quad } else { *size };
                (TypeInner::Vector { size, scalar }, is_filled)
            }
            _ => (TypeInner::Scalar(scalar), false),
        };
        let ty = self.ty(inner.clone());
        let filled = is_filled.then_some((ty, scalar.kind));
        (
            inner,
            Widened {
                to: to.map(|scalar| scalar.kind),
                filled,
            },
        )
    }
}

/// The format of a target for values of a type. `None` if there is none.
fn format(inner: &TypeInner, full: bool) -> Option<&'static str> {
    let (size, scalar) = match inner {
        TypeInner::Scalar(scalar) => (1, *scalar),
        TypeInner::Vector { size, scalar } => (*size as u32, *scalar),
        _ => return None,
    };
    let names = match (scalar.kind, scalar.width, full) {
        (ScalarKind::Float, 4, false) => ["r16float", "rg16float", "rgba16float"],
        (ScalarKind::Float, 4, true) => ["r32float", "rg32float", "rgba32float"],
        (ScalarKind::Uint, 4, _) => ["r32uint", "rg32uint", "rgba32uint"],
        (ScalarKind::Sint, 4, _) => ["r32sint", "rg32sint", "rgba32sint"],
        _ => return None,
    };
    Some(names[size.min(3) as usize - 1])
}

impl Ready {
    /// Writes the value of an output of type `ty`.
    fn write(&self, writer: &mut FunctionWriter, ty: Handle<Type>) -> Handle<Expression> {
        match self {
            Self::Value(captured, widened) => {
                let value = captured.read(writer);
                widen(writer, value, *widened)
            }
            Self::Direction(captured, direction, encode) => {
                let read = captured.read(writer);
                let value = match &direction.turned {
                    Some(matrix) => turned(writer, read, matrix),
                    None => read,
                };
                match encode {
                    Some(function) => writer.call(*function, vec![value]),
                    None => {
                        let value = match direction.unsigned {
                            true => halved(writer, value),
                            false => value,
                        };
                        let one = writer.expression(Expression::Literal(Literal::F32(1.0)));
                        let components = vec![value, one];
                        writer.expression(Expression::Compose { ty, components })
                    }
                }
            }
            Self::Distance(measured) => measured.write(writer),
            Self::Nothing => writer.expression(Expression::ZeroValue(ty)),
            Self::Velocity(clips, is_down) => velocity(writer, *clips, *is_down, ty),
            Self::Id(instance, draw, ty) => {
                let instance = writer.expression(Expression::FunctionArgument(*instance));
                let mut append = |e| writer.expression(e);
                let draw = append(Expression::GlobalVariable(*draw));
                let draw = append(Expression::Load { pointer: draw });
                writer.expression(Expression::Compose {
                    ty: *ty,
                    components: vec![draw, instance],
                })
            }
        }
    }
}

impl Point {
    /// Its first three components, divided by the fourth if there is one: weights that do not add up to 1 scale all
    /// four.
    fn read(&self, writer: &mut FunctionWriter) -> Handle<Expression> {
        use SwizzleComponent::{W, X, Y, Z};
        let base = self.value.read(writer);
        if !self.is_of_four {
            return base;
        }
        let w = writer.expression(Expression::AccessIndex { base, index: 3 });
        let three = vertex::three(writer, base, [X, Y, Z, W]);
        let w = writer.expression(Expression::Splat {
            size: VectorSize::Tri,
            value: w,
        });
        binary(writer, BinaryOperator::Divide, three, w)
    }
}

impl Measured {
    fn write(&self, writer: &mut FunctionWriter) -> Handle<Expression> {
        use SwizzleComponent::{W, X, Y, Z};
        let arg = self.from.read(writer);
        let light = buffer(&mut |e| writer.expression(e), &self.light);
        let arg1 = match self.is_light_of_four {
            true => vertex::three(writer, light, [X, Y, Z, W]),
            false => light,
        };
        let distance = writer.expression(Expression::Math {
            fun: MathFunction::Distance,
            arg,
            arg1: Some(arg1),
            arg2: None,
            arg3: None,
        });
        if !self.is_divided {
            return distance;
        }
        let range = match &self.range {
            Some(range) => buffer(&mut |e| writer.expression(e), range),
            None => writer.expression(Expression::AccessIndex {
                base: light,
                index: 3,
            }),
        };
        binary(writer, BinaryOperator::Divide, distance, range)
    }
}

/// A vector of three from -1 to 1 as one from 0 to 1.
fn halved(writer: &mut FunctionWriter, value: Handle<Expression>) -> Handle<Expression> {
    let half = writer.expression(Expression::Literal(Literal::F32(0.5)));
    let scaled = binary(writer, BinaryOperator::Multiply, value, half);
    let half = writer.expression(Expression::Splat {
        size: VectorSize::Tri,
        value: half,
    });
    binary(writer, BinaryOperator::Add, scaled, half)
}

fn is_four(inner: &TypeInner) -> bool {
    matches!(
        inner,
        TypeInner::Vector {
            size: VectorSize::Quad,
            ..
        }
    )
}

fn widen(
    writer: &mut FunctionWriter,
    mut value: Handle<Expression>,
    widened: Widened,
) -> Handle<Expression> {
    if let Some(kind) = widened.to {
        value = writer.expression(Expression::As {
            expr: value,
            kind,
            convert: Some(4),
        });
    }
    let Some((ty, kind)) = widened.filled else {
        return value;
    };
    let one = writer.expression(Expression::Literal(match kind {
        ScalarKind::Uint => Literal::U32(1),
        ScalarKind::Sint => Literal::I32(1),
        _ => Literal::F32(1.0),
    }));
    let components = vec![value, one];
    writer.expression(Expression::Compose { ty, components })
}

/// A direction, turned by a matrix of three or four columns and normalised.
fn turned(
    writer: &mut FunctionWriter,
    value: Handle<Expression>,
    matrix: &Member,
) -> Handle<Expression> {
    use SwizzleComponent::{X, Y, Z};
    let mut append = |e| writer.expression(e);
    let matrix = buffer(&mut append, matrix);
    // The upper left 3x3 part, column by column: of a 4x4 matrix too.
    let mut sum = None;
    for index in 0..3 {
        let column = writer.expression(Expression::AccessIndex {
            base: matrix,
            index,
        });
        let column = vertex::three(writer, column, [X, Y, Z, Z]);
        let scale = writer.expression(Expression::AccessIndex { base: value, index });
        let term = binary(writer, BinaryOperator::Multiply, column, scale);
        sum = Some(match sum {
            Some(sum) => binary(writer, BinaryOperator::Add, sum, term),
            None => term,
        });
    }
    let sum = sum.unwrap_or(value);
    let [length, unit] = [MathFunction::Length, MathFunction::Normalize].map(|fun| {
        writer.expression(Expression::Math {
            fun,
            arg: sum,
            arg1: None,
            arg2: None,
            arg3: None,
        })
    });
    // A vector of length 0 stays 0: the stage returned before it computed one.
    let zero = writer.expression(Expression::Literal(Literal::F32(0.0)));
    let condition = binary(writer, BinaryOperator::Greater, length, zero);
    writer.expression(Expression::Select {
        condition,
        accept: unit,
        reject: sum,
    })
}

fn binary(
    writer: &mut FunctionWriter,
    op: BinaryOperator,
    left: Handle<Expression>,
    right: Handle<Expression>,
) -> Handle<Expression> {
    writer.expression(Expression::Binary { op, left, right })
}

/// `(now.xy / now.w - before.xy / before.w) * vec2(0.5, -0.5)`, where the third component is w. In
/// the picture y points down; if it does in clip space, nothing is negated.
fn velocity(
    writer: &mut FunctionWriter,
    clips: [u32; 2],
    is_down: bool,
    ty: Handle<Type>,
) -> Handle<Expression> {
    use SwizzleComponent::{X, Y};
    let [now, before] = clips.map(|argument| {
        let clip = writer.expression(Expression::FunctionArgument(argument));
        let xy = writer.expression(Expression::Swizzle {
            size: VectorSize::Bi,
            vector: clip,
            pattern: [X, Y, Y, Y],
        });
        let w = writer.expression(Expression::AccessIndex {
            base: clip,
            index: 2,
        });
        let w = writer.expression(Expression::Splat {
            size: VectorSize::Bi,
            value: w,
        });
        binary(writer, BinaryOperator::Divide, xy, w)
    });
    let difference = binary(writer, BinaryOperator::Subtract, now, before);
    let components = [0.5, if is_down { 0.5 } else { -0.5 }]
        .map(|half| writer.expression(Expression::Literal(Literal::F32(half))))
        .to_vec();
    let half = writer.expression(Expression::Compose { ty, components });
    binary(writer, BinaryOperator::Multiply, difference, half)
}
