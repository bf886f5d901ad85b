//! The environment of a draw, shared by the original and the variant, as numbers or as terms.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;

use naga::{BuiltIn, Handle, Module, ScalarKind, Type, TypeInner};

use super::arithmetic::{plus, times};
use super::inputs::{Inputs, Random};
use super::made_up_draw::Drawn;
use super::stage::{At, POSITION, Ran, Slot, Stage, VaryingKind, interpolated};
use super::tape::{NO_STEP, Source, Steps, Taped};
use super::term::Symbolic;
use naga_edit::interface::Io;
use naga_interp::bound::{Interval, exactly};
use naga_interp::{
    Derivative, Environment, Lookup, Number, Scalar, Stuck, Traced, Value, place, scalars,
};

#[derive(Clone, Copy, Debug)]
pub struct PassStages<'p> {
    pub vertex: Stage<'p>,
    /// The fragment stage, if there is one.
    pub fragment: Option<Stage<'p>>,
}

/// The stage and position to compare.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TestPoint {
    /// The vertex stage, at a corner that depends on the input ([`Inputs::corner`]).
    Vertex,
    /// The fragment stage at a corner of a triangle, with that vertex's outputs as inputs.
    Corner(usize),
    /// The fragment stage inside a triangle.
    Inside,
    /// The fragment stage on arbitrary inputs, without a vertex stage.
    Anywhere,
}

/// Returns an input of a stage.
type StageInput<'a, F> = Box<dyn Fn(&Module, &Io, usize) -> Option<Value<F>> + 'a>;

/// Returns the texel of a lookup.
type Texel<'a, F> = Box<dyn Fn(&Lookup<'_, F>) -> [F; 4] + 'a>;

/// The data of a draw.
pub(crate) struct World<'a, F: 'a> {
    /// By group and binding.
    pub resources: Arc<BTreeMap<(u32, u32), Value<F>>>,
    /// The corner of [`TestPoint::Vertex`].
    corner: usize,
    attribute: StageInput<'a, F>,
    fragment: StageInput<'a, F>,
    texel: Texel<'a, F>,
    derivative: Box<dyn Fn(Derivative<F>) -> F + 'a>,
    inside: Box<dyn Fn(VaryingKind, [F; 3]) -> F + 'a>,
}

impl<F: Number> World<'_, F> {
    /// Runs stages in it.
    ///
    /// # Errors
    ///
    /// [`Stuck`].
    pub fn run(
        &self,
        stages: PassStages<'_>,
        place: TestPoint,
        steps: u64,
        trace: Option<&RefCell<Vec<Traced<F>>>>,
    ) -> Result<Ran<F>, Stuck> {
        match (place, stages.fragment) {
            (TestPoint::Vertex, _) => self.vertex(stages.vertex, self.corner, steps, trace),
            // Only depth is drawn.
            (_, None) => Ok(Ran {
                outputs: BTreeMap::new(),
                discarded: false,
                stored: BTreeMap::new(),
                flips: 0,
                steps: 0,
                undefined: None,
            }),
            (TestPoint::Anywhere, Some(fragment)) => {
                let own = |io: &Io| (self.fragment)(fragment.module(), io, 0);
                fragment.run(&own, &self.environment(steps, trace))
            }
            (_, Some(fragment)) => {
                // Traces only the vertex whose numbers are not interpolated.
                let traced = |corner| trace.filter(|_| place == TestPoint::Corner(corner));
                let corners = self.corners(stages.vertex, steps, &traced)?;
                self.shaded(fragment, place, &corners, steps, trace)
            }
        }
    }

    fn environment<'e>(
        &'e self,
        steps: u64,
        trace: Option<&'e RefCell<Vec<Traced<F>>>>,
    ) -> Environment<'e, F> {
        Environment {
            resources: Arc::clone(&self.resources),
            texture: &*self.texel,
            derivative: Some(&*self.derivative),
            trace,
            steps,
        }
    }

    fn vertex(
        &self,
        stage: Stage<'_>,
        corner: usize,
        steps: u64,
        trace: Option<&RefCell<Vec<Traced<F>>>>,
    ) -> Result<Ran<F>, Stuck> {
        let module = stage.module();
        let input = |io: &Io| (self.attribute)(module, io, corner);
        stage.run(&input, &self.environment(steps, trace))
    }

    /// Runs a vertex stage at the corners of the triangle.
    pub(super) fn corners<'t>(
        &self,
        stage: Stage<'_>,
        steps: u64,
        traced: &dyn Fn(usize) -> Option<&'t RefCell<Vec<Traced<F>>>>,
    ) -> Result<[Ran<F>; 3], Stuck>
    where
        F: 't,
    {
        let vertex = |corner| self.vertex(stage, corner, steps, traced(corner));
        Ok([vertex(0)?, vertex(1)?, vertex(2)?])
    }

    /// Runs a fragment stage between corners, or at one of them.
    pub(super) fn shaded(
        &self,
        fragment: Stage<'_>,
        place: TestPoint,
        corners: &[Ran<F>; 3],
        steps: u64,
        trace: Option<&RefCell<Vec<Traced<F>>>>,
    ) -> Result<Ran<F>, Stuck> {
        let module = fragment.module();
        let own = |io: &Io| (self.fragment)(module, io, 0);
        let at = match place {
            TestPoint::Corner(corner) => At::Corner(corner),
            _ => At::Inside(&*self.inside),
        };
        let input = |io: &Io| match io.binding {
            Some(naga::Binding::Location { .. }) => interpolated(io, corners.each_ref(), &at),
            _ => own(io),
        };
        fragment.run(&input, &self.environment(steps, trace))
    }
}

impl<'a> World<'a, f32> {
    /// Takes vertices and buffers from a draw.
    pub(super) fn draw(&mut self, drawn: &'a Drawn<'a>, buffers: BTreeMap<(u32, u32), Value>) {
        Arc::make_mut(&mut self.resources).extend(buffers);
        self.attribute = Box::new(|module, io, corner| drawn.attribute(module, io, corner));
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Texels {
    /// Waves over the coordinates, which distinguish places best ([`Inputs::texel`]).
    Waves,
    /// Sums that any adapter computes closely ([`Inputs::plain_texel`]).
    Plain,
}

pub(crate) fn concrete<'a>(
    inputs: &'a Inputs,
    attachments: &'a BTreeMap<(u32, u32), [f32; 4]>,
    texels: Texels,
) -> World<'a, f32> {
    World {
        resources: Arc::clone(&inputs.resources),
        corner: inputs.corner(),
        attribute: Box::new(|module, io, corner| inputs.attribute(module, io, corner)),
        fragment: Box::new(|module, io, _| inputs.fragment(module, io)),
        texel: Box::new(move |lookup| {
            let attachment = lookup.binding.and_then(|at| attachments.get(&at));
            attachment.copied().unwrap_or_else(|| match texels {
                Texels::Waves => inputs.texel(lookup),
                Texels::Plain => inputs.plain_texel(lookup),
            })
        }),
        derivative: Box::new(|derivative| slope(inputs, derivative)),
        inside: Box::new(|kind, corners: [f32; 3]| {
            let parts = corners.iter().zip(inputs.weights(kind));
            parts.fold(0.0, |sum, (corner, weight)| sum + corner * weight)
        }),
    }
}

/// A world of intervals: the values an adapter may compute from those numbers.
pub(crate) fn ranging<'a>(
    inputs: &'a Inputs,
    attachments: &'a BTreeMap<(u32, u32), [f32; 4]>,
) -> World<'a, Interval> {
    let exact = |value: Value| exactly::<Interval>(&value);
    let resources = inputs.resources.iter();
    World {
        resources: Arc::new(resources.map(|(at, v)| (*at, exactly(v))).collect()),
        corner: inputs.corner(),
        attribute: Box::new(move |module, io, corner| {
            inputs.attribute(module, io, corner).map(exact)
        }),
        fragment: Box::new(move |module, io, _| inputs.fragment(module, io).map(exact)),
        texel: Box::new(|lookup| {
            let attachment = lookup.binding.and_then(|at| attachments.get(&at));
            match attachment {
                Some(texel) => texel.map(Interval::of),
                None => inputs.plain_texel(lookup),
            }
        }),
        derivative: Box::new(|derivative| slope(inputs, derivative)),
        inside: Box::new(|kind, corners| {
            let weights = inputs.weights(kind);
            let products = corners.iter().zip(weights).map(|(c, w)| times(*c, w));
            products.reduce(plus).unwrap_or(Interval::ANYTHING)
        }),
    }
}

/// A world of numbers with twice the digits, to distinguish a difference from rounding.
pub(super) fn precise(inputs: &Inputs) -> World<'_, f64> {
    let exact = |value: Value| exactly::<f64>(&value);
    World {
        resources: Arc::new(
            inputs
                .resources
                .iter()
                .map(|(at, v)| (*at, exactly(v)))
                .collect(),
        ),
        corner: inputs.corner(),
        attribute: Box::new(move |module, io, corner| {
            inputs.attribute(module, io, corner).map(exact)
        }),
        fragment: Box::new(move |module, io, _| inputs.fragment(module, io).map(exact)),
        texel: Box::new(|lookup| inputs.texel(lookup)),
        derivative: Box::new(|derivative| slope(inputs, derivative)),
        inside: Box::new(|kind, corners: [f64; 3]| {
            let parts = corners.iter().zip(inputs.weights(kind));
            parts.fold(0.0, |sum, (corner, weight)| {
                sum + corner * f64::from(weight)
            })
        }),
    }
}

/// The uniforms and buffers of a draw on a tape.
pub(super) fn taped_buffers(inputs: &Inputs) -> BTreeMap<(u32, u32), Value<Taped>> {
    let all = inputs.resources.iter();
    all.map(|(at, value)| {
        let mut steps = [NO_STEP; 8];
        (*at, on_tape(value, (*at, &mut steps, 0)))
    })
    .collect()
}

/// A value of a buffer on a tape. Values that are nested too deep are constant.
fn on_tape(value: &Value, (at, steps, depth): ((u32, u32), &mut Steps, usize)) -> Value<Taped> {
    match value {
        Value::Scalar(Scalar::F32(x)) => {
            Value::number(Taped::input(Source::Buffer(at, *steps), *x))
        }
        Value::Composite(parts) if depth < steps.len() => {
            let parts = (0..).zip(parts).map(|(i, part)| {
                steps[depth] = i;
                on_tape(part, (at, steps, depth + 1))
            });
            let parts = parts.collect();
            steps[depth] = NO_STEP;
            Value::Composite(parts)
        }
        other => exactly(other),
    }
}

/// A world of numbers on a tape ([`super::tape`]), with the buffers of [`taped_buffers`].
pub(super) fn taped<'a>(
    inputs: &'a Inputs,
    resources: BTreeMap<(u32, u32), Value<Taped>>,
) -> World<'a, Taped> {
    // The components of an input.
    let components = |value: Value, source: &dyn Fn(u32) -> Option<Source>| {
        let one = |(i, part): (u32, Value)| match (part, source(i)) {
            (Value::Scalar(Scalar::F32(x)), Some(source)) => Value::number(Taped::input(source, x)),
            (part, source) => {
                if let (Value::Scalar(scalar), Some(source)) = (&part, source) {
                    Taped::read_integer(source, *scalar);
                }
                exactly(&part)
            }
        };
        match value {
            Value::Composite(parts) => Value::Composite((0..).zip(parts).map(one).collect()),
            scalar => one((0, scalar)),
        }
    };
    World {
        resources: Arc::new(resources),
        corner: inputs.corner(),
        attribute: Box::new(move |module, io, corner| {
            let slot = inputs.slot(io)?;
            let is_fixed = |i| match slot {
                Slot::Location(location, _) => inputs.fixed_attribute(location, i).is_some(),
                Slot::BuiltIn(_) => false,
            };
            let source = |i| (!is_fixed(i)).then_some(Source::Attribute(slot, corner, i));
            Some(components(inputs.attribute(module, io, corner)?, &source))
        }),
        fragment: Box::new(move |module, io, _| {
            let slot = Slot::of(io.binding.as_ref()?);
            let value = inputs.fragment(module, io)?;
            Some(components(value, &|i| Some(Source::Fragment(slot, i))))
        }),
        texel: Box::new(|lookup| {
            Taped::looked_up(lookup);
            let values = |all: &[Taped]| all.iter().map(|x| x.value).collect::<Vec<_>>();
            let (coordinates, footprint) = (values(lookup.coordinates), values(lookup.footprint));
            let texel = inputs.texel(&Lookup {
                binding: lookup.binding,
                coordinates: &coordinates,
                footprint: &footprint,
                sampling: lookup.sampling,
            });
            let channels = (0..).zip(texel).map(|(channel, x)| match lookup.binding {
                Some(at) => Taped::input(Source::Texel(at, channel), x),
                None => Taped::of(x),
            });
            let mut all = [Taped::of(0.0); 4];
            all.iter_mut().zip(channels).for_each(|(to, x)| *to = x);
            all
        }),
        derivative: Box::new(|derivative| slope(inputs, derivative)),
        inside: Box::new(|kind, corners: [Taped; 3]| {
            let parts = corners.iter().zip(inputs.weights(kind));
            parts.fold(Taped::of(0.0), |sum, (corner, weight)| {
                plus(sum, times(*corner, weight))
            })
        }),
    }
}

fn slope<F: Number>(inputs: &Inputs, derivative: Derivative<F>) -> F {
    let [x, y] = inputs.slopes().map(|slope| times(derivative.of, slope));
    let size = |slope: F| F::call(naga::MathFunction::Abs, &[slope]).unwrap_or(slope);
    match derivative.axis {
        naga::DerivativeAxis::X => x,
        naga::DerivativeAxis::Y => y,
        naga::DerivativeAxis::Width => plus(size(x), size(y)),
    }
}

/// The depth of a fragment, and the depth that a prologue compares it with: equal, before and
/// behind.
pub(crate) fn depths(inputs: &Inputs, module: &Module, io: Option<&Io>, clear: f32) -> [f32; 2] {
    let own = io
        .and_then(|io| inputs.fragment(module, io))
        .and_then(|p| p.floats().ok())
        .map_or(0.5, |p| p[2]);
    let mut random = Random::new(inputs.seed, "attachment");
    let other = match random.below(6) {
        0 => clear,
        1 => own,
        2 => own.next_up(),
        3 => own.next_down(),
        _ => random.unit(),
    };
    [own, other.clamp(0.0, 1.0)]
}

/// The uniforms and buffers of a module, as terms.
pub(super) fn buffers_of_terms(module: &Module) -> BTreeMap<(u32, u32), Value<Symbolic>> {
    let (mut resources, mut filled) = (BTreeMap::new(), 0_u32);
    for (_, global) in module.global_variables.iter() {
        let Some(at) = place(global) else { continue };
        // A proof is for textures of any size.
        if global.space == naga::AddressSpace::Handle {
            continue;
        }
        let name = format!("resource {} {}", at.0, at.1);
        // A runtime-sized array has no terms beyond its assumed length.
        filled = scalars(module, global.ty).saturating_add(filled);
        let value = match filled < MOST_SCALARS {
            true => terms(module, global.ty, &name),
            false => opaque(&name),
        };
        resources.insert(at, value);
    }
    resources
}

/// A world of terms, except for numbers that a guard fixes, which `inputs` contains.
pub(crate) fn symbolic<'a>(module: &'a Module, inputs: &'a Inputs) -> World<'a, Symbolic> {
    World {
        resources: Arc::new(buffers_of_terms(module)),
        // A term represents the number of any corner.
        corner: 0,
        attribute: Box::new(|module, io, corner| {
            let slot = Slot::of(io.binding.as_ref()?);
            let mut value = terms(module, io.ty, &format!("vertex {slot} {corner}"));
            if let Slot::Location(location, _) = slot {
                let fixed = |component| inputs.fixed_attribute(location, component);
                match &mut value {
                    Value::Composite(parts) => {
                        for (component, part) in (0..).zip(parts) {
                            if let Some(number) = fixed(component) {
                                *part = Value::number(Symbolic::of(number));
                            }
                        }
                    }
                    one => {
                        if let Some(number) = fixed(0) {
                            *one = Value::number(Symbolic::of(number));
                        }
                    }
                }
            }
            Some(value)
        }),
        fragment: Box::new(|module, io, _| {
            let slot = Slot::of(io.binding.as_ref()?);
            Some(match slot {
                // Both cases are tried.
                Slot::BuiltIn(BuiltIn::FrontFacing) => {
                    let front = Symbolic::holds(
                        naga::BinaryOperator::Less,
                        Symbolic::input("front"),
                        Symbolic::of(0.0),
                    );
                    Value::Scalar(Scalar::Bool(front?))
                }
                _ if slot == POSITION => terms(module, io.ty, "fragment position"),
                _ => terms(module, io.ty, &format!("fragment {slot}")),
            })
        }),
        texel: Box::new(|lookup| {
            let of = [lookup.coordinates, lookup.footprint].concat();
            let name = format!(
                "texel {:?} {} {:?}",
                lookup.binding,
                lookup.coordinates.len(),
                lookup.sampling
            );
            [0, 1, 2, 3].map(
                |channel| match inputs.fixed_texel(lookup.binding, channel) {
                    Some(number) => Symbolic::of(number),
                    None => Symbolic::given(&format!("{name} {channel}"), &of),
                },
            )
        }),
        derivative: Box::new(|d| {
            Symbolic::given(&format!("derivative {:?} {:?}", d.axis, d.control), &[d.of])
        }),
        inside: Box::new(|kind, corners| {
            Symbolic::given(&format!("interpolated {kind:?}"), &corners)
        }),
    }
}

/// Scalars of the buffers that are filled with terms.
const MOST_SCALARS: u32 = 4096;

/// A term for each float of a type. Its other scalars may be copied but not used.
fn terms(module: &Module, ty: Handle<Type>, name: &str) -> Value<Symbolic> {
    let times = |count: usize, part: &dyn Fn(usize) -> Value<Symbolic>| {
        Value::Composite((0..count).map(part).collect())
    };
    let scalar = |s: naga::Scalar, name: &str| match (s.kind, s.width) {
        (ScalarKind::Float, 4) => Value::number(Symbolic::input(name)),
        _ => opaque(name),
    };
    match &module.types[ty].inner {
        TypeInner::Scalar(s) => scalar(*s, name),
        TypeInner::Vector { size, scalar: s } => {
            times(*size as usize, &|i| scalar(*s, &format!("{name} {i}")))
        }
        TypeInner::Matrix {
            columns,
            rows,
            scalar: s,
        } => times(*columns as usize, &|c| {
            times(*rows as usize, &|r| scalar(*s, &format!("{name} {c} {r}")))
        }),
        TypeInner::Array {
            base,
            size: naga::ArraySize::Constant(count),
            ..
        } => times(count.get() as usize, &|i| {
            terms(module, *base, &format!("{name} {i}"))
        }),
        TypeInner::Struct { members, .. } => {
            let parts = members.iter().enumerate();
            Value::Composite(
                parts
                    .map(|(i, m)| terms(module, m.ty, &format!("{name} {i}")))
                    .collect(),
            )
        }
        _ => opaque(name),
    }
}

/// An unknown value, equal only to itself: an invalid pointer, which stops every use of it.
fn opaque(name: &str) -> Value<Symbolic> {
    Value::Pointer {
        address: usize::MAX,
        path: name.bytes().map(usize::from).collect(),
    }
}
