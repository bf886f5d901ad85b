//! Which lookups are given the gradients or the bias that they name.
//!
//! A texel is made here of where it is looked up, not of the level that an adapter would take by itself: a transform may write out the gradients of an implicit sample, and scale them for a bias.
//! Where no lookup of the variant can be such a one, what it names is a part of what it is given, as the coordinate is: a gradient taken along the other axis, or a bias left out, then shows.

use std::collections::{BTreeMap, BTreeSet};

use naga::{Expression, Function, Handle, Module, SampleLevel, Statement};

use super::stage::Stage;
use super::world::Stages;
use crate::evaluate::Lookup;
use crate::graph::operands;

/// How often a texture is sampled with a level of each kind, in a text.
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

/// A texture by group and binding; `None`: one that a function was given.
type Texture = Option<(u32, u32)>;

/// The textures whose lookups are given what they name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Levels {
    gradients: BTreeSet<(u32, u32)>,
    biases: BTreeSet<(u32, u32)>,
}

impl Levels {
    /// Those of an original and a variant of it: gradients where the original leaves no level of that texture to the adapter, biases where neither names gradients, and both where nothing
    /// became a lookup of another kind.
    pub fn between(original: Stages<'_>, variant: Stages<'_>) -> Self {
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

    /// Whether lookups of this texture are given their gradients.
    pub fn gradients(&self, texture: Texture) -> bool {
        texture.is_some_and(|t| self.gradients.contains(&t))
    }

    /// Whether they are given their bias.
    pub fn biases(&self, texture: Texture) -> bool {
        texture.is_some_and(|t| self.biases.contains(&t))
    }

    /// What a lookup is given beside its coordinates.
    pub fn given<'a, F>(&self, lookup: &Lookup<'a, F>) -> &'a [F] {
        let counts = match lookup.footprint.len() {
            1 => self.biases(lookup.binding),
            _ => self.gradients(lookup.binding),
        };
        if counts { lookup.footprint } else { &[] }
    }
}

fn sampled(stages: Stages<'_>) -> BTreeMap<Texture, Kinds> {
    let mut found = BTreeMap::new();
    for stage in [Some(stages.vertex), stages.fragment].into_iter().flatten() {
        let module = stage.module();
        count(module, stage.function(), &mut found);
        for function in called(stage) {
            count(module, &module.functions[function], &mut found);
        }
    }
    found
}

/// The functions that a stage calls, and those call, each once.
fn called(stage: Stage<'_>) -> BTreeSet<Handle<Function>> {
    let module = stage.module();
    let mut found = BTreeSet::new();
    let mut left = vec![&stage.function().body];
    while let Some(block) = left.pop() {
        for statement in block {
            left.extend(operands::blocks(statement));
            if let Statement::Call { function, .. } = statement
                && found.insert(*function)
            {
                left.push(&module.functions[*function].body);
            }
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
