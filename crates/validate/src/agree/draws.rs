//! The inputs that both programs read.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::fed::{self, Rule};
use super::reads;
use super::trial::Two;
use crate::environment::PassStages;
use crate::inputs::{Inputs, Pins, Profile, Random};
use crate::levels::{Levels, Reading};
use naga_interp::{Scalar, Value};

/// Which inputs: those of a seed, with single scalars pinned.
#[derive(Clone, Debug, Default)]
pub struct Point {
    pub(super) seed: u64,
    pub(super) pins: Pins,
}

impl From<u64> for Point {
    fn from(seed: u64) -> Self {
        Self {
            seed,
            pins: Pins::default(),
        }
    }
}

impl Two<'_> {
    /// Why no numbers can be tried: a stage reads a buffer that is too long to fill.
    pub(super) fn unfilled(&self) -> Option<String> {
        let seed = self.effort.seed.into();
        let inputs = self.inputs(&seed, Reading::Level, &[], &self.read(&[]));
        for stages in [self.first, self.second] {
            for stage in [Some(stages.vertex), stages.fragment].into_iter().flatten() {
                let info = stage.program.info().get_entry_point(stage.entry);
                for (handle, global) in stage.module().global_variables.iter() {
                    let at = naga_interp::place(global);
                    let is_left = at.is_some_and(|at| inputs.left_out.contains(&at));
                    if is_left && !info[handle].is_empty() {
                        let name = global.name.as_deref().unwrap_or("a buffer");
                        return Some(format!("`{name}` is too long to be filled with numbers"));
                    }
                }
            }
        }
        None
    }

    pub(super) fn read(&self, rules: &[Rule]) -> Read {
        read_by([self.first, self.second], rules)
    }

    /// The inputs of a point, in the buffers that are `read`.
    pub(super) fn inputs(
        &self,
        point: &Point,
        reading: Reading,
        rules: &[Rule],
        read: &Read,
    ) -> Inputs {
        let seed = point.seed;
        let [ours, theirs] = [self.first, self.second].map(|s| s.vertex.module());
        let is_read = |at: (u32, u32), member: Option<usize>| match (read.get(&at), member) {
            (None, _) => false,
            (Some(None), _) | (Some(Some(_)), None) => true,
            (Some(Some(members)), Some(member)) => members.contains(&member),
        };
        let mut spare = self.budget.spare();
        let first = Inputs::of_places(ours, None, seed, &is_read, &mut spare);
        let is_left = |at, member| is_read(at, member) && !first.resources.contains_key(&at);
        let second = Inputs::of_places(theirs, None, seed, &is_left, &mut spare);
        let mut inputs = first.merged(second);
        if inputs.profile == Profile::Ordinary && !seed.is_multiple_of(6) {
            inputs = inputs.spread(&self.numbers, [ours, theirs]);
        }
        let mut inputs = inputs.with_levels(&Arc::new(Levels::all(reading)));
        // A bias is small.
        for (at, steps) in &self.matching.biases {
            let resources = Arc::make_mut(&mut inputs.resources);
            if let Some(value) = resources.get_mut(at)
                && let Some(value) = fed::part_mut(value, steps)
            {
                shrink(value);
            }
        }
        inputs.pin(&point.pins);
        fed::feed(rules, Arc::make_mut(&mut inputs.resources));
        inputs.same_numbers(&self.matching.previous_inputs);
        for (location, component) in &self.matching.filled {
            let value = if *component == 3 { 1.0 } else { 0.0 };
            inputs.fix_attribute(*location, *component, value);
        }
        self.fix_texels(&mut inputs);
        inputs
    }

    /// In a quarter of the inputs, textures have the numbers that the programs compare with, and
    /// numbers between them: a threshold shows. A number of a buffer may be one, too.
    fn fix_texels(&self, inputs: &mut Inputs) {
        if !inputs.seed.is_multiple_of(4) {
            return;
        }
        let mut numbers = self.numbers.thresholds();
        for value in inputs.resources.values() {
            few_scalars(value, &mut numbers);
        }
        let mut random = Random::new(inputs.seed, "thresholds");
        let module = self.first.vertex.module();
        for (_, global) in module.global_variables.iter() {
            let (Some(at), naga::AddressSpace::Handle) = (&global.binding, global.space) else {
                continue;
            };
            for channel in 0..4 {
                let number = numbers.get(random.below(2 * numbers.len().max(1)));
                if let Some(number) = number {
                    inputs.fix_texel((at.group, at.binding), channel, *number);
                }
            }
        }
    }
}

/// Makes ordinary numbers those of a bias.
fn shrink(value: &mut Value) {
    match value {
        Value::Scalar(Scalar::F32(x)) if x.abs() < 1e6 => *x = (*x * 0.01).clamp(-0.04, 0.04),
        Value::Composite(parts) => parts.iter_mut().for_each(shrink),
        _ => {}
    }
}

/// Buffers by group and binding, and their members by index, or `None` for the whole.
pub(super) type Read = BTreeMap<(u32, u32), Option<BTreeSet<usize>>>;

/// The parts that the stages of two programs read, and those that rules feed them from.
pub(super) fn read_by(two: [PassStages<'_>; 2], rules: &[Rule]) -> Read {
    let stages = two.into_iter().flat_map(|s| [Some(s.vertex), s.fragment]);
    let read = stages
        .flatten()
        .flat_map(|stage| reads::parts(stage, &|_| true));
    let factors = rules.iter().flat_map(|rule| rule.times.iter().cloned());
    let fed = rules
        .iter()
        .map(|rule| (rule.from, rule.from_steps.clone()))
        .chain(factors);
    let mut all = Read::new();
    for (at, steps) in read.chain(fed) {
        let members = all.entry(at).or_insert_with(|| Some(BTreeSet::new()));
        match (steps.first(), members) {
            (Some(member), Some(members)) => _ = members.insert(*member),
            (None, members) => *members = None,
            (Some(_), None) => {}
        }
    }
    all
}

/// Floats of a value that are no part of a matrix or a longer array.
fn few_scalars(value: &Value, out: &mut Vec<f32>) {
    let is_nested = |v: &Value| matches!(v, Value::Composite(_));
    match value {
        Value::Scalar(Scalar::F32(x)) => out.push(*x),
        Value::Composite(members) => {
            for member in members {
                match member {
                    Value::Composite(parts) if parts.iter().any(is_nested) => {}
                    other => few_scalars(other, out),
                }
            }
        }
        _ => {}
    }
}
