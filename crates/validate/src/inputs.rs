//! Ordinary and adversarial inputs of both stages.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use naga::{
    AddressSpace, ArraySize, BuiltIn, Handle, MathFunction, Module, ScalarKind, Type, TypeInner,
};

use super::arithmetic::{plus, times};
use super::compared_numbers::Numbers;
use super::levels::Levels;
pub use super::random::Random;
use super::stage::{POSITION, Slot, VaryingKind};
use super::tape::{NO_STEP, Source};
use naga_edit::interface::Io;
use naga_interp::{Lookup, Number, RUNTIME_ELEMENTS, Sampling, Scalar, Value, place, scalars};
use preshade_plan::guard::{Assumed, Guard, Place, ScalarType};

/// Largest buffer in scalars that is filled; longer ones stay 0.
const MOST_SCALARS: u32 = 1 << 14;

/// The kind of an input's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Profile {
    /// From -2 to 2, and for constants of the draw from 1/4 to 4, as `ordinary-numbers` promises
    /// ([`preshade_plan::contract::Assumption::OrdinaryNumbers`]).
    Ordinary,
    /// Ordinary ones, with one in six from `Extreme`.
    Mixed,
    Equal,
    /// 0 and -0, subnormal and huge ones, infinities, NaN, the largest and smallest integers.
    Extreme,
}

impl Profile {
    /// Random numbers that a number of a buffer takes.
    fn draws(self) -> u64 {
        match self {
            Self::Ordinary | Self::Extreme => 1,
            Self::Mixed => 2,
            Self::Equal => 0,
        }
    }
}

/// The profile of the n-th input; half of them are ordinary.
pub(crate) fn profile(n: u64) -> Profile {
    match n % 6 {
        0..=2 => Profile::Ordinary,
        3 => Profile::Mixed,
        4 => Profile::Extreme,
        _ => Profile::Equal,
    }
}

/// Corner cases of arithmetic.
const FLOATS: [f32; 22] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    -0.5,
    1e-45,
    -1.1e-39,
    f32::MIN_POSITIVE,
    1e-20,
    -1e-20,
    16_777_216.0,
    -1e6,
    1e20,
    f32::MAX,
    f32::MIN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::NAN,
    1.000_000_1,
    0.03,
    0.11,
];
const INTEGERS: [u32; 10] = [
    0,
    1,
    2,
    31,
    32,
    255,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_fffe,
    0xffff_ffff,
];

/// Values by group and binding.
pub(crate) type Resources = BTreeMap<(u32, u32), Value>;

/// The use of a number, on which the ordinary range depends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Of {
    Draw,
    Vertex,
}

/// The inputs of a draw.
#[derive(Clone, Debug)]
pub struct Inputs {
    /// The same seed gives the same inputs.
    pub seed: u64,
    pub profile: Profile,
    /// Uniforms, buffers, immediate data, and sizes of textures.
    pub resources: Arc<BTreeMap<(u32, u32), Value>>,
    /// Buffers that stay 0 because they are too long.
    pub left_out: Vec<(u32, u32)>,
    /// The lookups that receive bias or gradients.
    pub levels: Arc<Levels>,
    /// Texels that a guard fixes, by group, binding and channel.
    texels: BTreeMap<(u32, u32, u32), f32>,
    /// Attribute components that a guard fixes.
    attributes: BTreeMap<(u32, u32), f32>,
    /// Locations whose attributes have another location's numbers.
    same: BTreeMap<u32, u32>,
    /// The numbers that inputs shall reach.
    numbers: Option<Arc<Numbers>>,
    /// Single scalars that have another value.
    pins: Pins,
}

/// Single scalars of inputs, and their values.
pub(super) type Pins = Arc<BTreeMap<Source, Scalar>>;

impl Inputs {
    /// The derivatives of half of the fragments along x and y, per unit; the others have 0. A
    /// derivative is linear, and 0 for 0.
    pub fn slopes(&self) -> [f32; 2] {
        match self.seed.is_multiple_of(2) {
            true => [0.0; 2],
            false => [0.0625, -0.03125],
        }
    }

    /// The inputs of a seed for the variables of a module, within a guard.
    pub fn new(module: &Module, guard: Option<&Guard>, seed: u64) -> Self {
        Self::of_places(module, guard, seed, &|_, _| true, &mut Resources::new())
    }

    /// The same inputs, without the buffers that are not `wanted`, and nothing in the members of a
    /// struct that are not: values take time. Those of earlier inputs in `spare` give their memory.
    pub fn of_places(
        module: &Module,
        guard: Option<&Guard>,
        seed: u64,
        wanted: &dyn Fn((u32, u32), Option<usize>) -> bool,
        spare: &mut Resources,
    ) -> Self {
        let profile = profile(seed);
        let (mut resources, mut left_out) = (BTreeMap::new(), Vec::new());
        for (_, global) in module.global_variables.iter() {
            let Some(at) = place(global) else { continue };
            if global.space == AddressSpace::Handle {
                let size = texture_size(at).map(Value::u32);
                resources.insert(at, Value::Composite(size.to_vec()));
                continue;
            }
            if !wanted(at, None) {
                continue;
            }
            let filled = match &module.types[global.ty].inner {
                TypeInner::Struct { members, .. } => {
                    let members = members.iter().enumerate();
                    let wanted = members.filter(|(i, _)| wanted(at, Some(*i)));
                    let scalars = wanted.map(|(_, member)| scalars(module, member.ty));
                    scalars.fold(0, u32::saturating_add)
                }
                _ => scalars(module, global.ty),
            };
            if filled > MOST_SCALARS {
                left_out.push(at);
                continue;
            }
            let name = format!("resource {} {}", at.0, at.1);
            let mut random = Random::new(seed, &name);
            let mut part = |ty, member, to: &mut Value| match wanted(at, member) {
                true => refill(module, ty, (profile, Of::Draw), &mut random, to),
                false => {
                    random.skip(profile.draws() * u64::from(scalars(module, ty)));
                    *to = Value::Composite(Vec::new());
                    Some(())
                }
            };
            let mut value = spare.remove(&at).unwrap_or(Value::Composite(Vec::new()));
            let filled = match &module.types[global.ty].inner {
                TypeInner::Struct { members, .. } => {
                    let to = parts_of(&mut value, members.len());
                    let mut members = members.iter().enumerate().zip(to);
                    members.try_for_each(|((i, member), to)| part(member.ty, Some(i), to))
                }
                _ => part(global.ty, None, &mut value),
            };
            resources.extend(filled.map(|()| (at, value)));
        }
        let mut this = Self {
            seed,
            profile,
            resources: Arc::new(resources),
            left_out,
            levels: Arc::default(),
            texels: BTreeMap::new(),
            attributes: BTreeMap::new(),
            same: BTreeMap::new(),
            numbers: None,
            pins: Pins::default(),
        };
        for assumed in guard.into_iter().flat_map(|g| &g.values) {
            this.assume(module, assumed);
        }
        this
    }

    /// The same inputs, with bias and gradients passed to some lookups.
    #[must_use]
    pub fn with_levels(self, levels: &Arc<Levels>) -> Self {
        Self {
            levels: Arc::clone(levels),
            ..self
        }
    }

    /// The same inputs, with additional values from `more`.
    #[must_use]
    pub fn merged(self, more: Self) -> Self {
        let mut resources = Arc::unwrap_or_clone(more.resources);
        resources.extend(Arc::unwrap_or_clone(self.resources));
        let left_out = [self.left_out, more.left_out].concat();
        Self {
            resources: Arc::new(resources),
            left_out,
            ..self
        }
    }

    /// Lets inputs reach the numbers that programs compare with ([`Numbers::spread`]). Texture sizes
    /// stay.
    #[must_use]
    pub(super) fn spread(mut self, numbers: &Arc<Numbers>, modules: [&Module; 2]) -> Self {
        let globals = modules.iter().flat_map(|m| m.global_variables.iter());
        let buffers = globals.filter(|(_, g)| g.space != AddressSpace::Handle);
        let buffers: BTreeSet<_> = buffers.filter_map(|(_, global)| place(global)).collect();
        let resources = Arc::make_mut(&mut self.resources);
        for (at, value) in resources.iter_mut().filter(|(at, _)| buffers.contains(at)) {
            let mut random = Random::new(self.seed, &format!("spread {} {}", at.0, at.1));
            let mut change = |value: &mut Value| match self.seed.is_multiple_of(2) {
                true => numbers.enlarge(value, &mut random),
                false => numbers.spread(value, &mut random),
            };
            match value {
                Value::Composite(members) => members.iter_mut().for_each(change),
                one => change(one),
            }
        }
        Self {
            numbers: Some(Arc::clone(numbers)),
            ..self
        }
    }

    /// Gives a channel of a texture one value everywhere.
    pub fn fix_texel(&mut self, (group, binding): (u32, u32), channel: u32, value: f32) {
        self.texels.insert((group, binding, channel), value);
    }

    /// Gives a component of an attribute one value at every vertex.
    pub fn fix_attribute(&mut self, location: u32, component: u32, value: f32) {
        self.attributes.insert((location, component), value);
    }

    /// Gives single scalars other values.
    pub(super) fn pin(&mut self, pins: &Pins) {
        let resources = Arc::make_mut(&mut self.resources);
        for (source, number) in pins.iter() {
            match source {
                Source::Buffer(at, steps) => {
                    let steps = steps.iter().take_while(|step| **step != NO_STEP);
                    let part = steps.fold(resources.get_mut(at), |value, step| match value? {
                        Value::Composite(parts) => parts.get_mut(*step as usize),
                        _ => None,
                    });
                    if let Some(Value::Scalar(scalar)) = part {
                        replace(scalar, *number);
                    }
                }
                // Each of these is generated when it is read.
                Source::Texel(..) | Source::Attribute(..) | Source::Fragment(..) => {}
            }
        }
        self.pins = Arc::clone(pins);
    }

    /// A value with the components that are pinned.
    fn pinned(&self, value: &mut Value, source: &dyn Fn(u32) -> Source) {
        if self.pins.is_empty() {
            return;
        }
        let parts = match value {
            Value::Composite(parts) => &mut parts[..],
            one => std::slice::from_mut(one),
        };
        for (component, part) in (0..).zip(parts) {
            if let (Some(number), Value::Scalar(scalar)) = (self.pins.get(&source(component)), part)
            {
                replace(scalar, *number);
            }
        }
    }

    /// Where the numbers of an attribute come from.
    pub(super) fn slot(&self, io: &Io) -> Option<Slot> {
        Some(match Slot::of(io.binding.as_ref()?) {
            Slot::Location(location, blend) => {
                let other = self.same.get(&location);
                Slot::Location(other.copied().unwrap_or(location), blend)
            }
            slot @ Slot::BuiltIn(_) => slot,
        })
    }

    /// Gives the attributes of the first location of each pair the numbers of the second, and all
    /// others numbers of their own.
    pub(super) fn same_numbers(&mut self, pairs: &[(u32, u32)]) {
        self.same = pairs.iter().copied().collect();
    }

    fn assume(&mut self, module: &Module, assumed: &Assumed) {
        let mut random = Random::new(self.seed, &assumed.name);
        let number = within(assumed, &mut random);
        match &assumed.place {
            Place::Uniform {
                group,
                binding,
                offset,
            } => {
                let at = (*group, *binding);
                let global = module.global_variables.iter().find(|(_, g)| {
                    g.binding
                        .as_ref()
                        .is_some_and(|b| (b.group, b.binding) == at)
                });
                let resources = Arc::make_mut(&mut self.resources);
                if let (Some((_, global)), Some(value)) = (global, resources.get_mut(&at)) {
                    set(module, global.ty, value, *offset, number);
                }
            }
            Place::Attribute {
                location,
                component,
            } => {
                if let Scalar::F32(number) = number {
                    self.attributes.insert((*location, *component), number);
                }
            }
            Place::Texture {
                group,
                binding,
                channel,
            } => {
                if let Scalar::F32(number) = number {
                    self.texels.insert((*group, *binding, *channel), number);
                }
            }
            // The variant's text contains it; `super::with_overrides` sets it in the original.
            Place::Override { .. } => {}
        }
    }

    /// The corner for a vertex stage on its own.
    pub fn corner(&self) -> usize {
        // Seeds of each profile cover all corners.
        (self.seed / 6 % 3) as usize
    }

    /// The index of the triangle in its draw: the first in half of the inputs, and small if numbers
    /// are ordinary.
    fn triangle(&self) -> u32 {
        let mut random = Random::new(self.seed, "triangle");
        match (random.below(2), self.profile) {
            (0, _) => 0,
            (_, Profile::Ordinary) => 1 + random.below(2) as u32,
            _ => [1, 21, 340, 21_845, 1 << 20][random.below(5)],
        }
    }

    /// An input of a vertex stage at a corner of the triangle.
    pub fn attribute(&self, module: &Module, io: &Io, corner: usize) -> Option<Value> {
        let slot = self.slot(io)?;
        let mut random = Random::new(self.seed, &format!("vertex {slot} {corner}"));
        match slot {
            Slot::BuiltIn(BuiltIn::VertexIndex) => {
                return Some(Value::u32(3 * self.triangle() + corner as u32));
            }
            // One triangle is of one instance.
            Slot::BuiltIn(BuiltIn::InstanceIndex | BuiltIn::BaseInstance) => {
                let own = (self.seed % 3) as u32;
                let mut random = Random::new(self.seed, "instance");
                let numbers = self.numbers.as_ref();
                let index = numbers.map_or(own, |n| n.integer(own, &mut random));
                return Some(Value::u32(index));
            }
            _ => {}
        }
        let mut value = value(module, io.ty, self.profile, Of::Vertex, &mut random)?;
        if let Some(numbers) = &self.numbers {
            // All corners have one scale, and numbers of their own.
            let mut scale = Random::new(self.seed, &format!("spread {slot}"));
            numbers.spread_at(&mut value, &mut scale, &mut random);
        }
        if let Slot::Location(location, _) = slot {
            match &mut value {
                Value::Composite(parts) => {
                    for (component, part) in (0..).zip(parts) {
                        if let Some(number) = self.attributes.get(&(location, component)) {
                            *part = Value::f32(*number);
                        }
                    }
                }
                one => {
                    if let Some(number) = self.attributes.get(&(location, 0)) {
                        *one = Value::f32(*number);
                    }
                }
            }
        }
        self.pinned(&mut value, &|i| Source::Attribute(slot, corner, i));
        Some(value)
    }

    /// An input of a fragment stage that no vertex stage provides; or any, if all are to be random.
    pub fn fragment(&self, module: &Module, io: &Io) -> Option<Value> {
        let slot = Slot::of(io.binding.as_ref()?);
        let mut value = self.of_fragment(module, io, slot)?;
        self.pinned(&mut value, &|i| Source::Fragment(slot, i));
        Some(value)
    }

    fn of_fragment(&self, module: &Module, io: &Io, slot: Slot) -> Option<Value> {
        let mut random = Random::new(self.seed, &format!("fragment {slot}"));
        if slot == POSITION {
            // Within the target and the depth planes.
            let pixel = |random: &mut Random| random.below(64) as f32 + 0.5;
            let mut at = [pixel(&mut random), pixel(&mut random)];
            if let Some(numbers) = &self.numbers {
                at = at.map(|own| match random.below(2) {
                    0 => own,
                    _ => numbers.float(&mut random).abs().min(16_384.0).floor() + 0.5,
                });
            }
            let depth = match random.below(8) {
                0 => 0.0,
                1 => 1.0,
                2 => f32::MIN_POSITIVE,
                _ => random.unit(),
            };
            let w = match self.profile {
                Profile::Ordinary | Profile::Equal => 0.1 + random.unit(),
                Profile::Mixed | Profile::Extreme => {
                    float(Profile::Extreme, Of::Vertex, &mut random)
                }
            };
            return Some(Value::vector(&[at[0], at[1], depth, w]));
        }
        value(module, io.ty, self.profile, Of::Vertex, &mut random)
    }

    /// A texel from 0 to 1: a smooth function of the coordinates, different for each texture,
    /// sampler and offset. An implicit level has no influence.
    pub fn texel<F: Number>(&self, lookup: &Lookup<'_, F>) -> [F; 4] {
        let call = |function, of: &[F]| F::call(function, of).unwrap_or(of[0]);
        let bounded = |c| call(MathFunction::Clamp, &[c, F::of(-1e6), F::of(1e6)]);
        let start = F::of(start(lookup.binding, lookup.sampling));
        let numbers = self.levels.numbers(lookup, self.slopes());
        let sum = numbers
            .into_iter()
            .fold(start, |sum, c| plus(times(sum, 1.7), bounded(c)));
        [0, 1, 2, 3].map(|channel| match self.fixed_texel(lookup.binding, channel) {
            Some(fixed) => F::of(fixed),
            None => {
                let wave = call(MathFunction::Sin, &[times(sum, (channel + 1) as f32)]);
                plus(times(wave, 0.5), F::of(0.5))
            }
        })
    }

    /// A texel from sums and products only, which every adapter computes nearly equally:
    /// [`Self::bases`] plus half of a sum over the coordinates, if that is between 0 and 1.
    pub fn plain_texel<F: Number>(&self, lookup: &Lookup<'_, F>) -> [F; 4] {
        let add = |sum, (number, weight): (F, f32)| {
            let bounded = F::call(
                MathFunction::Clamp,
                &[number, F::of(-PLAIN_MOST), F::of(PLAIN_MOST)],
            );
            plus(sum, times(bounded.unwrap_or(number), weight))
        };
        let coordinates = lookup.coordinates.iter().enumerate();
        let levels = self.levels.given(lookup).iter().enumerate();
        let sum = coordinates
            .map(|(i, c)| (*c, plain_weight(i)))
            .chain(levels.map(|(i, c)| (*c, plain_level_weight(i))))
            .fold(F::of(plain_start(lookup.sampling)), add);
        let sum = F::call(MathFunction::Saturate, &[sum]).unwrap_or(sum);
        let [bases, scales] = self.bases(lookup.binding);
        [0, 1, 2, 3].map(|channel: usize| plus(times(sum, scales[channel]), F::of(bases[channel])))
    }

    /// For each channel of a texture, the constant part of its texels and the factor of the sum,
    /// which is 0 if a guard fixes the channel.
    pub fn bases(&self, texture: Option<(u32, u32)>) -> [[f32; 4]; 2] {
        let own = texture.map_or(0, |(group, binding)| group * 5 + binding);
        let channels = [0_u32, 1, 2, 3].map(|channel| {
            let part = channel as f32;
            match self.fixed_texel(texture, channel) {
                Some(fixed) => (fixed, 0.0),
                None => (
                    (own % 7) as f32 * 0.05 + part * 0.03125,
                    0.5 - part * 0.0625,
                ),
            }
        });
        [channels.map(|c| c.0), channels.map(|c| c.1)]
    }

    /// A texel channel that has one value everywhere.
    pub fn fixed_texel(&self, binding: Option<(u32, u32)>, channel: u32) -> Option<f32> {
        let (group, binding) = binding?;
        match self.pins.get(&Source::Texel((group, binding), channel)) {
            Some(Scalar::F32(pinned)) => Some(*pinned),
            _ => self.texels.get(&(group, binding, channel)).copied(),
        }
    }

    /// An attribute component that a guard fixes.
    pub fn fixed_attribute(&self, location: u32, component: u32) -> Option<f32> {
        self.attributes.get(&(location, component)).copied()
    }

    /// Weights of the corners at an inner point, for one kind of interpolation. Their sum is off by
    /// some last bits, as in a rasteriser.
    pub fn weights(&self, kind: VaryingKind) -> [f32; 3] {
        let mut random = Random::new(self.seed, &format!("weights {kind:?}"));
        let (u, v) = (random.unit(), random.unit());
        let (u, v) = if u + v > 1.0 {
            (1.0 - u, 1.0 - v)
        } else {
            (u, v)
        };
        [1.0 - u - v, u, v]
    }
}

/// Replaces a scalar by one of its type.
fn replace(scalar: &mut Scalar, by: Scalar) {
    if std::mem::discriminant(scalar) == std::mem::discriminant(&by) {
        *scalar = by;
    }
}

/// Width, height, and depth or layers of a texture, by its place. They differ, so that swaps show.
pub fn texture_size((group, binding): (u32, u32)) -> [u32; 3] {
    let own = (group * 5 + binding) % 7;
    [48 + 16 * own, 20 + 8 * own, 6 + own]
}

/// The largest coordinate that affects a plain texel.
pub const PLAIN_MOST: f32 = 1024.0;

/// The constant term of a plain texel's sum.
pub fn plain_start(sampling: Sampling) -> f32 {
    0.25 + start(None, sampling) * 0.0625
}

/// The weight of the i-th coordinate in it.
pub fn plain_weight(i: usize) -> f32 {
    [0.25, 0.1875, 0.140_625, 0.109_375][i.min(3)]
}

/// The weight of the i-th number of a bias or of gradients in it. All weights differ, so that swaps
/// show.
pub fn plain_level_weight(i: usize) -> f32 {
    [0.09375, 0.078_125, 0.0625, 0.046_875, 0.031_25, 0.023_437_5][i.min(5)]
}

/// The constant term of a texel, from all properties of the lookup except its coordinates.
pub(crate) fn start(texture: Option<(u32, u32)>, sampling: Sampling) -> f32 {
    let of =
        |at: Option<(u32, u32)>| at.map_or(0.0, |(group, binding)| (group * 16 + binding) as f32);
    let [x, y, z] = sampling.offset.map(|texels| texels as f32);
    let clamped = if sampling.clamped { 0.37 } else { 0.0 };
    of(texture) + of(sampling.sampler) * 0.11 + x * 0.23 + y * 0.29 + z * 0.31 + clamped
}

/// Scalars of all buffers that [`Inputs::new`] fills.
pub(crate) fn filled(module: &Module) -> u64 {
    let globals = module.global_variables.iter();
    globals
        .filter(|(_, g)| g.space != AddressSpace::Handle && place(g).is_some())
        .map(|(_, g)| scalars(module, g.ty))
        .filter(|scalars| *scalars <= MOST_SCALARS)
        .map(u64::from)
        .sum()
}

/// A number within bounds: one of the ends, or one between them.
fn within(assumed: &Assumed, random: &mut Random) -> Scalar {
    let (low, high) = (assumed.bounds.low, assumed.bounds.high);
    let number = match random.below(3) {
        0 => low,
        1 => high,
        _ => low + (high - low) * f64::from(random.unit()),
    };
    match assumed.ty {
        // Rounding must not leave the bounds.
        ScalarType::F32 => Scalar::F32((number as f32).clamp(low as f32, high as f32)),
        ScalarType::I32 => Scalar::I32(number.trunc().clamp(low, high) as i32),
        ScalarType::U32 => Scalar::U32(number.trunc().clamp(low, high) as u32),
    }
}

/// A value of a type; `None` if the interpreter has no values of it.
fn value(
    module: &Module,
    ty: Handle<Type>,
    profile: Profile,
    of: Of,
    random: &mut Random,
) -> Option<Value> {
    let mut value = Value::Composite(Vec::new());
    refill(module, ty, (profile, of), random, &mut value)?;
    Some(value)
}

/// Writes such a value over one of the same type, whose memory it takes.
fn refill(
    module: &Module,
    ty: Handle<Type>,
    (profile, of): (Profile, Of),
    random: &mut Random,
    to: &mut Value,
) -> Option<()> {
    let scalar = |s: naga::Scalar, random: &mut Random| {
        let scalar = match (s.kind, s.width) {
            (ScalarKind::Float, 4) => Scalar::F32(float(profile, of, random)),
            (ScalarKind::Sint, 4) => Scalar::I32(integer(profile, random) as i32),
            (ScalarKind::Uint, 4) => Scalar::U32(integer(profile, random)),
            (ScalarKind::Bool, _) => Scalar::Bool(random.below(2) == 0),
            _ => return None,
        };
        Some(Value::Scalar(scalar))
    };
    match &module.types[ty].inner {
        TypeInner::Scalar(s) | TypeInner::Atomic(s) => *to = scalar(*s, random)?,
        TypeInner::Vector { size, scalar: s } => {
            for part in parts_of(to, *size as usize) {
                *part = scalar(*s, random)?;
            }
        }
        TypeInner::Matrix {
            columns,
            rows,
            scalar: s,
        } => {
            for column in parts_of(to, *columns as usize) {
                for part in parts_of(column, *rows as usize) {
                    *part = scalar(*s, random)?;
                }
            }
        }
        TypeInner::Array { base, size, .. } => {
            let count = match size {
                ArraySize::Constant(n) => n.get(),
                _ => RUNTIME_ELEMENTS,
            };
            for part in parts_of(to, count as usize) {
                refill(module, *base, (profile, of), random, part)?;
            }
        }
        TypeInner::Struct { members, .. } => {
            for (member, part) in members.iter().zip(parts_of(to, members.len())) {
                refill(module, member.ty, (profile, of), random, part)?;
            }
        }
        _ => return None,
    }
    Some(())
}

/// The parts of a composite of this many; it becomes one.
fn parts_of(value: &mut Value, count: usize) -> &mut [Value] {
    let is_it = matches!(value, Value::Composite(parts) if parts.len() == count);
    if !is_it {
        *value = Value::Composite(vec![Value::u32(0); count]);
    }
    match value {
        Value::Composite(parts) => parts,
        _ => &mut [],
    }
}

fn float(profile: Profile, of: Of, random: &mut Random) -> f32 {
    let ordinary = |random: &mut Random| match of {
        Of::Vertex => random.unit() * 4.0 - 2.0,
        Of::Draw => 0.25 + random.unit() * 3.75,
    };
    match profile {
        Profile::Ordinary => ordinary(random),
        Profile::Mixed if random.below(6) > 0 => ordinary(random),
        Profile::Mixed | Profile::Extreme => FLOATS[random.below(FLOATS.len())],
        Profile::Equal => 1.5,
    }
}

/// Most are small, because they are trip counts and flags.
fn integer(profile: Profile, random: &mut Random) -> u32 {
    match profile {
        Profile::Ordinary => random.below(9) as u32,
        Profile::Mixed if random.below(6) > 0 => random.below(9) as u32,
        Profile::Mixed | Profile::Extreme => INTEGERS[random.below(INTEGERS.len())],
        Profile::Equal => 1,
    }
}

/// Writes a scalar at a byte offset in a value of this type.
pub(crate) fn set<F: Number>(
    module: &Module,
    ty: Handle<Type>,
    value: &mut Value<F>,
    offset: u32,
    number: Scalar<F>,
) {
    if let (TypeInner::Scalar(_), Value::Scalar(scalar), 0) =
        (&module.types[ty].inner, &mut *value, offset)
    {
        *scalar = number;
        return;
    }
    let Value::Composite(parts) = value else {
        return;
    };
    match &module.types[ty].inner {
        TypeInner::Vector { .. } => {
            if let Some(part) = parts.get_mut(offset as usize / 4) {
                *part = Value::Scalar(number);
            }
        }
        TypeInner::Matrix { rows, .. } => {
            let stride = if *rows as u32 == 2 { 8 } else { 16 };
            if let Some(Value::Composite(column)) = parts.get_mut((offset / stride) as usize)
                && let Some(part) = column.get_mut((offset % stride / 4) as usize)
            {
                *part = Value::Scalar(number);
            }
        }
        TypeInner::Array { base, stride, .. } => {
            if let Some(part) = parts.get_mut((offset / stride) as usize) {
                set(module, *base, part, offset % stride, number);
            }
        }
        TypeInner::Struct { members, .. } => {
            let found = members.iter().rposition(|m| m.offset <= offset);
            if let Some(index) = found
                && let Some(part) = parts.get_mut(index)
            {
                let member = &members[index];
                set(module, member.ty, part, offset - member.offset, number);
            }
        }
        _ => {}
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_member_is_the_same_with_and_without_others() {
        let text = "
            struct Light { at: vec3<f32>, kind: u32 }
            struct Frame { view: mat4x4<f32>, lights: array<Light, 3>, count: i32, wind: vec2<f32> }
            @group(0) @binding(0) var<uniform> frame: Frame;
            @fragment fn fs() -> @location(0) vec4<f32> { return vec4(frame.wind, 0.0, 1.0); }";
        let module = naga::front::wgsl::parse_str(text).unwrap();
        for seed in 0..12 {
            let whole = Inputs::new(&module, None, seed);
            let mut spare = Resources::clone(&whole.resources);
            let part = Inputs::of_places(
                &module,
                None,
                seed,
                &|_, member| member != Some(1),
                &mut spare,
            );
            let members = |inputs: &Inputs| inputs.resources[&(0, 0)].parts().unwrap().to_vec();
            let (whole, part) = (members(&whole), members(&part));
            for member in [0, 2, 3] {
                assert_eq!(
                    format!("{:?}", whole[member]),
                    format!("{:?}", part[member]),
                    "{seed}"
                );
            }
            assert_eq!(part[1].parts().unwrap().len(), 0);
        }
    }
}
