//! Decides which lookups receive their explicit gradients or bias.
//!
//! Our texels depend on coordinates, not on an implicit level: a transform may write out the
//! gradients of an implicit sample, and scale them for a bias. If no lookup of the variant can be
//! such a rewritten one, its gradients or bias do affect the texel. A gradient along the wrong
//! axis, or a dropped bias, then shows.

use std::collections::{BTreeMap, BTreeSet};

use naga::{Expression, Function, Module, SampleLevel};

use super::arithmetic::{exp2, product, times};
use super::environment::PassStages;
use naga_interp::{Lookup, Number};
use naga_operands::calls;

/// The number of samples of a texture in a text, by kind of level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Kinds {
    implicit: usize,
    biased: usize,
    gradients: usize,
}

impl Kinds {
    fn and(self, other: Self) -> Self {
        Self {
            implicit: self.implicit + other.implicit,
            biased: self.biased + other.biased,
            gradients: self.gradients + other.gradients,
        }
    }
}

/// A texture by group and binding; `None` for a function's argument.
type Texture = Option<(u32, u32)>;

/// How texels depend on the mip level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reading {
    /// On the gradients and biases of the chosen textures.
    #[default]
    Chosen,
    /// On the level, however the lookup names it: an implicit level is that of the coordinates'
    /// derivatives.
    Level,
    Ignored,
}

/// The textures whose lookups receive gradients or bias.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Levels {
    reading: Reading,
    gradients: BTreeSet<(u32, u32)>,
    biases: BTreeSet<(u32, u32)>,
}

/// A level changes a texel as much as a place does.
const LEVEL_SCALE: f32 = 16.0;

impl Levels {
    /// The same reading for all textures.
    pub fn all(reading: Reading) -> Self {
        Self {
            reading,
            ..Self::default()
        }
    }

    /// The numbers that decide a texel, with the derivatives of a unit along x and y.
    pub fn numbers<F: Number>(&self, lookup: &Lookup<'_, F>, slopes: [f32; 2]) -> Vec<F> {
        let coordinates = lookup.coordinates.iter().copied();
        let along = |scale: F| {
            let axes = &lookup.coordinates[..lookup.sampling.axes];
            let slopes = slopes.into_iter();
            let each = move |slope| axes.iter().map(move |c| product(times(*c, slope), scale));
            slopes.flat_map(each)
        };
        match (self.reading, lookup.footprint) {
            (Reading::Chosen, _) => coordinates
                .chain(self.given(lookup).iter().copied())
                .collect(),
            (Reading::Ignored, _) => {
                let coordinates = coordinates.enumerate();
                let coordinates = coordinates.filter(|(i, _)| Some(*i) != lookup.sampling.level);
                coordinates.map(|(_, c)| c).collect()
            }
            (Reading::Level, []) if lookup.sampling.implicit => {
                coordinates.chain(along(F::of(LEVEL_SCALE))).collect()
            }
            (Reading::Level, [bias]) => coordinates
                .chain(along(times(exp2(*bias), LEVEL_SCALE)))
                .collect(),
            (Reading::Level, gradients) => {
                let gradients = gradients.iter().map(|g| times(*g, LEVEL_SCALE));
                coordinates.chain(gradients).collect()
            }
        }
    }

    /// Compares an original and its variant. Lookups receive gradients if the original never uses
    /// an implicit level of that texture, biases if neither uses gradients, and both if no lookup
    /// changed its kind.
    pub fn between(original: PassStages<'_>, variant: PassStages<'_>) -> Self {
        let (original, variant) = (sampled(original), sampled(variant));
        let of = |kinds: &BTreeMap<Texture, Kinds>, texture| {
            let kinds = |texture| kinds.get(&texture).copied().unwrap_or_default();
            kinds(Some(texture)).and(kinds(None))
        };
        let textures = original.keys().chain(variant.keys()).flatten();
        let mut this = Self::default();
        for texture in textures.copied() {
            let (original, variant) = (of(&original, texture), of(&variant, texture));
            let same = original == variant;
            if same || (original.gradients > 0 && original.implicit + original.biased == 0) {
                this.gradients.insert(texture);
            }
            if same || (original.gradients == 0 && variant.gradients == 0) {
                this.biases.insert(texture);
            }
        }
        this
    }

    /// Whether lookups of this texture receive their gradients.
    pub fn gradients(&self, texture: Texture) -> bool {
        texture.is_some_and(|t| self.gradients.contains(&t))
    }

    /// Whether they receive their bias.
    pub fn biases(&self, texture: Texture) -> bool {
        texture.is_some_and(|t| self.biases.contains(&t))
    }

    /// The additional numbers of a lookup that its texel depends on.
    pub fn given<'a, F>(&self, lookup: &Lookup<'a, F>) -> &'a [F] {
        let counts = match lookup.footprint.len() {
            1 => self.biases(lookup.binding),
            _ => self.gradients(lookup.binding),
        };
        if counts { lookup.footprint } else { &[] }
    }
}

fn sampled(stages: PassStages<'_>) -> BTreeMap<Texture, Kinds> {
    let mut found = BTreeMap::new();
    for stage in [Some(stages.vertex), stages.fragment].into_iter().flatten() {
        let module = stage.module();
        count(module, stage.function(), &mut found);
        for function in calls::called(module, &stage.function().body) {
            count(module, &module.functions[function], &mut found);
        }
    }
    found
}

fn count(module: &Module, function: &Function, found: &mut BTreeMap<Texture, Kinds>) {
    for (_, expression) in function.expressions.iter() {
        let Expression::ImageSample { image, level, .. } = expression else {
            continue;
        };
        let texture = match function.expressions[*image] {
            Expression::GlobalVariable(global) => module.global_variables[global].binding,
            _ => None,
        };
        let kinds = found
            .entry(texture.map(|b| (b.group, b.binding)))
            .or_default();
        match level {
            SampleLevel::Auto => kinds.implicit += 1,
            SampleLevel::Bias(_) => kinds.biased += 1,
            SampleLevel::Gradient { .. } => kinds.gradients += 1,
            SampleLevel::Zero | SampleLevel::Exact(_) => {}
        }
    }
}
