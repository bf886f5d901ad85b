//! Runs both stages of a material in the interpreter, and interpolates between them.

use std::collections::BTreeMap;
use std::fmt;

use naga::{Binding, BuiltIn, Interpolation, Module, Sampling, ShaderStage, TypeInner};
use naga_edit::interface::{self, Io};
use naga_interp::{Environment, Number, RunResult, Scalar, Stuck, Undefined, Value};
use preshade_plan::program::Program;

/// The binding of an input or output. Invariance of a position is ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Slot {
    /// `@builtin`.
    BuiltIn(BuiltIn),
    /// `@location`, and `@blend_src`.
    Location(u32, Option<u32>),
}

/// The clip-space position of a vertex stage.
pub const POSITION: Slot = Slot::BuiltIn(BuiltIn::Position { invariant: false });

impl Slot {
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

#[derive(Clone, Copy, Debug)]
pub struct Stage<'p> {
    pub program: &'p Program,
    /// Index of the entry point.
    pub entry: usize,
}

#[derive(Clone, Debug)]
pub struct Ran<F = f32> {
    pub outputs: BTreeMap<Slot, Value<F>>,
    pub discarded: bool,
    /// Final contents of buffers, by group and binding.
    pub stored: BTreeMap<(u32, u32), Value<F>>,
    /// As [`RunResult::flips`].
    pub flips: u64,
    /// As [`RunResult::steps`].
    pub steps: u64,
    /// As [`RunResult::undefined`].
    pub undefined: Option<(Undefined, naga::Span)>,
}

impl<'p> Stage<'p> {
    /// The entry point of that name.
    pub fn new(program: &'p Program, stage: ShaderStage, name: &str) -> Option<Self> {
        let (entry, _) = program.entry_point(stage, name)?;
        Some(Self { program, entry })
    }

    pub fn module(self) -> &'p Module {
        self.program.module()
    }

    pub fn function(self) -> &'p naga::Function {
        &self.module().entry_points[self.entry].function
    }

    /// Its inputs, with structs expanded.
    pub fn inputs(self) -> Vec<Io> {
        interface::inputs(self.module(), self.function())
    }

    /// Its outputs, with structs expanded.
    pub fn outputs(self) -> Vec<Io> {
        interface::outputs(self.module(), self.function())
    }

    /// Runs it.
    ///
    /// # Errors
    ///
    /// [`Stuck`]; [`Stuck::Type`] if `input` lacks one of its inputs.
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
                let opened = interface::opened(module, std::slice::from_ref(argument));
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
        let outcome = naga_interp::entry_point(module, self.entry, &arguments, environment)?;
        Ok(self.ran(outcome))
    }

    fn ran<F: Number>(self, outcome: RunResult<F>) -> Ran<F> {
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
            steps: outcome.steps,
            undefined: outcome.undefined,
        }
    }
}

/// The position of a fragment in a triangle.
pub enum At<'a, F> {
    /// At a corner, where the fragment has the vertex's values.
    Corner(usize),
    /// Inside: interpolates the three corners' numbers, by kind of interpolation.
    Inside(&'a dyn Fn(VaryingKind, [F; 3]) -> F),
}

/// Interpolation and sampling of a varying.
pub type VaryingKind = (Interpolation, Sampling);

/// The kind of a binding; perspective and the pixel's centre by default. `None` for a builtin.
pub fn kind(binding: &Binding) -> Option<VaryingKind> {
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

/// The value of a fragment input from the results of its triangle's vertices; a flat one is the
/// first vertex's. `None` if no vertex stage provides it.
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
