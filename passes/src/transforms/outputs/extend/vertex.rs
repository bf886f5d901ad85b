//! The vertex stage of an extended material: the author's, and the values that the fragment stage
//! needs.

use naga::{
    BinaryOperator, Binding, BuiltIn, Expression, FunctionResult, Handle, Interpolation, Sampling,
    Scalar, StructMember, SwizzleComponent, TypeInner, VectorSize,
};
use naga_edit::interface;

use super::capture::Captured;
use super::{
    Extending, ExtraPicture, Failed, Normal, Shows, Surface, Varying, Varyings, is_position,
    returned, varying,
};
use crate::rebuild::place;
use crate::rebuild::prologue::Ahead;
use naga_edit::returns;
use naga_edit::writer::FunctionWriter;

/// The content of a varying.
enum Carried {
    /// The position that the author's code returns, without z.
    Position,
    /// A position of ours, without z.
    Clip(Handle<Expression>),
    /// A value of the prologue.
    Value(Handle<Expression>),
    /// A position in the world.
    World(WorldPosition),
}

/// A position in the world: a vector and the matrices that turn it, outermost first.
#[derive(Clone, Debug)]
struct WorldPosition {
    vector: Captured,
    matrices: Vec<Captured>,
    /// Whether the fourth component is 1.
    is_point: bool,
}

impl WorldPosition {
    fn read(&self, writer: &mut FunctionWriter) -> Handle<Expression> {
        let mut value = self.vector.read(writer);
        for matrix in self.matrices.iter().rev() {
            let left = matrix.read(writer);
            value = writer.expression(Expression::Binary {
                op: BinaryOperator::Multiply,
                left,
                right: value,
            });
        }
        value
    }
}

impl Extending<'_, '_> {
    pub(super) fn vertex_stage(&mut self, wanted: &[ExtraPicture]) -> Result<Varyings, Failed> {
        let mut varyings = Varyings::default();
        let kept = self.world(wanted)?;
        let mut next = self.free_location();
        let mut take = || {
            next += 1;
            next - 1
        };
        let velocity = wanted.iter().find_map(|w| match &w.shows {
            Shows::Velocity(velocity) => Some(velocity),
            _ => None,
        });
        let is_face = |w: &ExtraPicture| matches!(w.shows, Shows::Direction(Normal::Face(_), _));
        let positions = velocity.map(|v| self.positions(v)).transpose()?;
        let ty = self.vec3();
        let mut clip = |name| Varying {
            name,
            ty,
            binding: varying(take(), Interpolation::Perspective, Sampling::Center),
        };
        if positions.is_some() || wanted.iter().any(is_face) {
            varyings.clip = Some(clip("current_clip"));
        }
        varyings.previous = positions.is_some().then(|| clip("previous_clip"));
        if wanted.iter().any(|w| matches!(w.shows, Shows::Id)) {
            varyings.instance = Some(Varying {
                name: "instance",
                ty: self.ty(TypeInner::Scalar(Scalar::U32)),
                binding: varying(take(), Interpolation::Flat, Sampling::Either),
            });
        }
        if let Some(kept) = &kept {
            let ty = match kept.is_point {
                true => self.vec3(),
                false => self.ty(TypeInner::Vector {
                    size: VectorSize::Quad,
                    scalar: Scalar::F32,
                }),
            };
            varyings.world = Some(Varying {
                name: "world",
                ty,
                binding: varying(take(), Interpolation::Perspective, Sampling::Center),
            });
        }
        let all = [
            varyings.clip.as_ref(),
            varyings.previous.as_ref(),
            varyings.instance.as_ref(),
            varyings.world.as_ref(),
        ];
        if all.iter().any(Option::is_some) {
            self.carry(&all, positions, kept)?;
        }
        Ok(varyings)
    }

    /// Keeps the position in the world, if a picture needs it.
    fn world(&mut self, wanted: &[ExtraPicture]) -> Result<Option<WorldPosition>, Failed> {
        let world = wanted.iter().find_map(|w| match w.shows.surface()? {
            Surface::World(world) => Some(world),
            Surface::Value(_) => None,
        });
        let Some(world) = world else { return Ok(None) };
        let vertex = self.opaque.vertex;
        let matrices = world.matrices.iter().map(|m| self.keep(vertex, m));
        Ok(Some(WorldPosition {
            is_point: world.is_point,
            matrices: matrices.collect::<Result<_, _>>()?,
            vector: self.keep(vertex, &world.vector)?,
        }))
    }

    /// Makes the vertex stage return the varyings in addition to its own outputs.
    fn carry(
        &mut self,
        all: &[Option<&Varying>; 4],
        positions: Option<(Option<Ahead>, Ahead)>,
        kept: Option<WorldPosition>,
    ) -> Result<(), Failed> {
        let missing = || Failed::Built("a vertex stage without a position".to_owned());
        let entry = self.opaque.vertex;
        let mut carried: Vec<Option<Carried>> = Vec::new();
        self.module = place::prologue(&self.module, entry, |build| {
            match positions {
                Some((now, before)) => {
                    carried.push(match now {
                        None => Some(Carried::Position),
                        Some(now) => now.call(build, "now").map(Carried::Clip),
                    });
                    carried.push(before.call(build, "before").map(Carried::Clip));
                }
                None => carried.extend(all[0].map(|_| Some(Carried::Position))),
            }
            if let Some(varying) = all[2] {
                let instance = Binding::BuiltIn(BuiltIn::InstanceIndex);
                let value = build.input("instance_index", varying.ty, &instance);
                carried.push(Some(Carried::Value(value)));
            }
            carried.extend(kept.map(|kept| Some(Carried::World(kept))));
        });
        let carried: Option<Vec<Carried>> = carried.into_iter().collect();
        let carried = carried.ok_or_else(missing)?;
        let module = &self.module;
        let function = &module.entry_points[entry].function;
        let mut members: Vec<StructMember> = interface::outputs(module, function)
            .into_iter()
            .map(|io| {
                member(
                    io.name.unwrap_or_else(|| "position".to_owned()),
                    io.ty,
                    io.binding,
                )
            })
            .collect();
        let own = members.len() as u32;
        let position = members.iter().position(|m| is_position(m.binding.as_ref()));
        let position = position.ok_or_else(missing)?;
        let is_struct = function
            .result
            .as_ref()
            .is_some_and(|r| r.binding.is_none());
        members.extend(all.iter().flatten().map(|varying| {
            let binding = Some(varying.binding.clone());
            member(varying.name.to_owned(), varying.ty, binding)
        }));
        let ty = place::io_struct(&mut self.module, Some("Varyings".to_owned()), members);
        let function = &mut self.module.entry_points[entry].function;
        function.result = Some(FunctionResult { ty, binding: None });
        returns::rewrite(function, &mut |writer, value| {
            let value = value?;
            let mut components: Vec<_> = match is_struct {
                false => vec![value],
                true => (0..own)
                    .map(|index| returned(writer, value, index))
                    .collect(),
            };
            let position = components[position];
            for value in &carried {
                use SwizzleComponent::{W, X, Y, Z};
                components.push(match value {
                    Carried::Position => three(writer, position, [X, Y, W, W]),
                    Carried::Clip(clip) => three(writer, *clip, [X, Y, W, W]),
                    Carried::Value(value) => *value,
                    Carried::World(kept) => {
                        let world = kept.read(writer);
                        match kept.is_point {
                            true => three(writer, world, [X, Y, Z, W]),
                            false => world,
                        }
                    }
                });
            }
            Some(writer.expression(Expression::Compose { ty, components }))
        });
        Ok(())
    }
}

/// The first three components of `pattern`.
pub(super) fn three(
    writer: &mut FunctionWriter,
    vector: Handle<Expression>,
    pattern: [SwizzleComponent; 4],
) -> Handle<Expression> {
    writer.expression(Expression::Swizzle {
        size: VectorSize::Tri,
        vector,
        pattern,
    })
}

/// A member whose offset follows from the struct's.
pub(super) fn member(
    name: String,
    ty: Handle<naga::Type>,
    binding: Option<Binding>,
) -> StructMember {
    StructMember {
        name: Some(name),
        ty,
        binding,
        offset: 0,
    }
}
