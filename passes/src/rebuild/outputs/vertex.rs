//! The vertex stage of an extended material: the author's, and what the fragment stage needs of it.

use naga::{
    Binding, BuiltIn, Expression, FunctionResult, Handle, Interpolation, Sampling, Scalar,
    StructMember, SwizzleComponent, TypeInner, VectorSize,
};

use super::{Extending, Failed, Shows, Varying, Varyings, Wanted, is_position, varying};
use crate::core::reflect;
use crate::rebuild::ahead::Ahead;
use crate::rebuild::place::{self, CodeBuilder};
use crate::rebuild::returns;
use crate::rebuild::writer::FunctionWriter;

/// What a varying carries.
enum Carried {
    /// The position that the author's code returns, without z.
    Position,
    /// A position of ours, without z.
    Clip(Handle<Expression>),
    /// A value of the prologue.
    Value(Handle<Expression>),
}

impl Extending<'_, '_> {
    /// Extends the vertex stage.
    pub(super) fn vertex_stage(&mut self, wanted: &[Wanted]) -> Result<Varyings, Failed> {
        let mut varyings = Varyings::default();
        let mut next = self.free_location();
        let mut take = || {
            next += 1;
            next - 1
        };
        let velocity = wanted.iter().find_map(|w| match &w.shows {
            Shows::Velocity(velocity) => Some(velocity),
            _ => None,
        });
        let mut positions = None;
        if let Some(velocity) = velocity {
            positions = Some(self.positions(velocity)?);
            let ty = self.vec3();
            varyings.clip = Some(["clip_now", "clip_before"].map(|name| Varying {
                name,
                ty,
                binding: varying(take(), Interpolation::Perspective, Sampling::Center),
            }));
        }
        if wanted.iter().any(|w| matches!(w.shows, Shows::Id)) {
            varyings.instance = Some(Varying {
                name: "instance",
                ty: self.ty(TypeInner::Scalar(Scalar::U32)),
                binding: varying(take(), Interpolation::Flat, Sampling::Either),
            });
        }
        let all = [
            varyings.clip.as_ref().map(|[now, _]| now),
            varyings.clip.as_ref().map(|[_, before]| before),
            varyings.instance.as_ref(),
        ];
        if all.iter().any(Option::is_some) {
            self.carry(&all, positions);
        }
        Ok(varyings)
    }

    /// Makes the vertex stage return the varyings beside its own outputs.
    fn carry(&mut self, all: &[Option<&Varying>; 3], positions: Option<(Option<Ahead>, Ahead)>) {
        let entry = self.opaque.vertex;
        let mut carried = Vec::new();
        self.module = place::prologue(&self.module, entry, |build| {
            if let Some((now, before)) = positions {
                carried.push(match now {
                    None => Carried::Position,
                    Some(now) => Carried::Clip(called(build, &now, "now")),
                });
                carried.push(Carried::Clip(called(build, &before, "before")));
            }
            if let Some(varying) = all[2] {
                let instance = Binding::BuiltIn(BuiltIn::InstanceIndex);
                let value = build.input("instance_index", varying.ty, &instance);
                carried.push(Carried::Value(value));
            }
        });
        let module = &self.module;
        let function = &module.entry_points[entry].function;
        let mut members: Vec<StructMember> = reflect::outputs(module, function)
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
                    .map(|index| writer.expression(Expression::AccessIndex { base: value, index }))
                    .collect(),
            };
            let position = components[position?];
            for value in &carried {
                components.push(match *value {
                    Carried::Position => without_z(writer, position),
                    Carried::Clip(clip) => without_z(writer, clip),
                    Carried::Value(value) => value,
                });
            }
            Some(writer.expression(Expression::Compose { ty, components }))
        });
    }
}

/// The result of a function that computes a position.
fn called(build: &mut CodeBuilder<'_>, ahead: &Ahead, name: &str) -> Handle<Expression> {
    match ahead.call(build, name) {
        Some(result) => result,
        // A position slice has a result.
        None => build.literal(naga::Literal::F32(0.0)),
    }
}

fn without_z(writer: &mut FunctionWriter, clip: Handle<Expression>) -> Handle<Expression> {
    use SwizzleComponent::{W, X, Y};
    writer.expression(Expression::Swizzle {
        size: VectorSize::Tri,
        vector: clip,
        pattern: [X, Y, W, W],
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
