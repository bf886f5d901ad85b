//! Both stages of a material run by the interpreter, and what lies between them.

use std::collections::BTreeMap;
use std::fmt;

use naga::{Binding, BuiltIn, Interpolation, Module, Sampling, ShaderStage, TypeInner};

use crate::core::program::Program;
use crate::core::reflect::{self, Io};
use crate::evaluate::{self, Environment, Number, Outcome, Scalar, Stuck, Value};

/// What an input or an output is bound to. A position is one whether it is invariant or not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Slot {
    /// `@builtin`.
    BuiltIn(BuiltIn),
    /// `@location`, and `@blend_src`.
    Location(u32, Option<u32>),
}

/// The clip-space position that a vertex stage gives.
pub const POSITION: Slot = Slot::BuiltIn(BuiltIn::Position { invariant: false });

impl Slot {
    /// Of a binding.
    pub fn of(binding: &Binding) -> Self {
        match binding {
            Binding::BuiltIn(BuiltIn::Position { .. }) => POSITION,
            Binding::BuiltIn(builtin) => Self::BuiltIn(*builtin),
            Binding::Location {
                location,
                blend_src,
                ..
            } => Self::Location(*location, *blend_src),
        }
    }
}

impl fmt::Display for Slot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BuiltIn(BuiltIn::Position { .. }) => f.write_str("position"),
            Self::BuiltIn(builtin) => write!(f, "{builtin:?}"),
            Self::Location(location, None) => write!(f, "location {location}"),
            Self::Location(location, Some(source)) => {
                write!(f, "location {location}, blend source {source}")
            }
        }
    }
}

/// A stage of a program.
#[derive(Clone, Copy, Debug)]
pub struct Stage<'p> {
    /// The program.
    pub program: &'p Program,
    /// Index of the entry point.
    pub entry: usize,
}

/// What a stage gave.
#[derive(Clone, Debug)]
pub struct Ran<F = f32> {
    /// Its outputs.
    pub outputs: BTreeMap<Slot, Value<F>>,
    /// Whether it was discarded.
    pub discarded: bool,
    /// What it left in buffers.
    pub stored: BTreeMap<(u32, u32), Value<F>>,
    /// As [`Outcome::flips`].
    pub flips: u64,
}

impl<'p> Stage<'p> {
    /// The entry point of that name.
    pub fn new(program: &'p Program, stage: ShaderStage, name: &str) -> Option<Self> {
        let (entry, _) = program.entry_point(stage, name)?;
        Some(Self { program, entry })
    }

    /// Its module.
    pub fn module(self) -> &'p Module {
        self.program.module()
    }

    /// Its entry point's function.
    pub fn function(self) -> &'p naga::Function {
        &self.module().entry_points[self.entry].function
    }

    /// Its inputs, struct members apart.
    pub fn inputs(self) -> Vec<Io> {
        reflect::inputs(self.module(), self.function())
    }

    /// Its outputs, struct members apart.
    pub fn outputs(self) -> Vec<Io> {
        reflect::outputs(self.module(), self.function())
    }

    /// Runs it.
    ///
    /// # Errors
    /// [`Stuck`]; [`Stuck::Type`] where `input` has nothing for one of its inputs.
    pub fn run<F: Number>(
        self,
        input: &dyn Fn(&Io) -> Option<Value<F>>,
        environment: &Environment<'_, F>,
    ) -> Result<Ran<F>, Stuck> {
        let (module, function) = (self.module(), self.function());
        let missing = |io: &Io| Stuck::Type(format!("nothing is given for {:?}", io.binding));
        let given = |io: &Io| input(io).ok_or_else(|| missing(io));
        let arguments = function
            .arguments
            .iter()
            .map(|argument| {
                let opened = reflect::opened(module, std::slice::from_ref(argument));
                let is_struct = argument.binding.is_none()
                    && matches!(module.types[argument.ty].inner, TypeInner::Struct { .. });
                match (is_struct, &opened[..]) {
                    (false, [one]) => given(one),
                    (_, members) => {
                        let members = members.iter().map(given);
                        members.collect::<Result<_, _>>().map(Value::Composite)
                    }
                }
            })
            .collect::<Result<Vec<_>, _>>()?;
        let outcome = evaluate::entry_point(module, self.entry, &arguments, environment)?;
        Ok(self.told(outcome))
    }

    fn told<F: Number>(self, outcome: Outcome<F>) -> Ran<F> {
        let is_struct = self
            .function()
            .result
            .as_ref()
            .is_some_and(|r| r.binding.is_none());
        let values = match outcome.result {
            Some(Value::Composite(members)) if is_struct => members,
            Some(one) => vec![one],
            None => Vec::new(),
        };
        let slots = self.outputs();
        let slots = slots.iter().filter_map(|io| io.binding.as_ref());
        Ran {
            outputs: slots.map(Slot::of).zip(values).collect(),
            discarded: outcome.discarded,
            stored: outcome.stored,
            flips: outcome.flips,
        }
    }
}

/// Where in a triangle a fragment is.
pub enum At<'a, F> {
    /// On a corner, where interpolation gives what the vertex has.
    Corner(usize),
    /// Inside: what a rasteriser makes of a number at the three corners, by the kind of interpolation.
    Inside(&'a dyn Fn(Kind, [F; 3]) -> F),
}

/// How a number is interpolated, and at which point of a pixel.
pub type Kind = (Interpolation, Sampling);

/// What a binding says of it; what it leaves open is perspective, and the pixel's centre. `None` of a builtin.
pub fn kind(binding: &Binding) -> Option<Kind> {
    let Binding::Location {
        interpolation,
        sampling,
        ..
    } = binding
    else {
        return None;
    };
    Some((
        interpolation.unwrap_or(Interpolation::Perspective),
        sampling.unwrap_or(Sampling::Center),
    ))
}

/// What a fragment stage finds in an input, of what its triangle's vertices gave; flat ones are the first vertex's. `None` where no vertex stage gives it.
pub fn interpolated<F: Number>(io: &Io, corners: [&Ran<F>; 3], at: &At<'_, F>) -> Option<Value<F>> {
    let Some(binding @ Binding::Location { interpolation, .. }) = &io.binding else {
        return None;
    };
    let slot = Slot::of(binding);
    let [a, b, c] = corners.map(|corner| corner.outputs.get(&slot));
    match (interpolation, at) {
        (Some(Interpolation::Flat), _) => a.cloned(),
        (_, At::Corner(corner)) => [a, b, c].get(*corner)?.cloned(),
        (_, At::Inside(how)) => {
            let kind = kind(binding)?;
            between([a?, b?, c?], &|corners| how(kind, corners))
        }
    }
}

fn between<F: Number>(corners: [&Value<F>; 3], how: &dyn Fn([F; 3]) -> F) -> Option<Value<F>> {
    Some(match corners {
        [
            Value::Composite(a),
            Value::Composite(b),
            Value::Composite(c),
        ] => {
            let parts = a.iter().zip(b).zip(c);
            let parts = parts.map(|((a, b), c)| between([a, b, c], how));
            Value::Composite(parts.collect::<Option<_>>()?)
        }
        [
            Value::Scalar(Scalar::F32(a)),
            Value::Scalar(Scalar::F32(b)),
            Value::Scalar(Scalar::F32(c)),
        ] => Value::number(how([*a, *b, *c])),
        [first, ..] => first.clone(),
    })
}
