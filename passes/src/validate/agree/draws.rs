//! The inputs that both programs read.

use std::sync::Arc;

use naga::{Expression, Literal};

use super::fed::{self, Rule};
use super::trial::Two;
use crate::validate::inputs::{Inputs, Random};
use crate::validate::levels::{Levels, Reading};

impl Two<'_> {
    /// Why no numbers can be tried: a stage reads a buffer that is too long to fill.
    pub(super) fn unfilled(&self) -> Option<String> {
        let inputs = self.inputs(self.effort.seed, Reading::Level, &[]);
        for stages in [self.first, self.second] {
            for stage in [Some(stages.vertex), stages.fragment].into_iter().flatten() {
                let info = stage.program.info().get_entry_point(stage.entry);
                for (handle, global) in stage.module().global_variables.iter() {
                    let at = crate::evaluate::place(global);
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

    /// The inputs of a seed.
    pub(super) fn inputs(&self, seed: u64, reading: Reading, rules: &[Rule]) -> Inputs {
        let [ours, theirs] = [self.first, self.second].map(|s| s.vertex.module());
        let inputs = Inputs::new(ours, None, seed).beside(Inputs::new(theirs, None, seed));
        let mut inputs = inputs.with_levels(&Arc::new(Levels::all(reading)));
        fed::feed(rules, Arc::make_mut(&mut inputs.resources));
        for (location, component) in &self.matching.filled {
            let value = if *component == 3 { 1.0 } else { 0.0 };
            inputs.fix_attribute(*location, *component, value);
        }
        self.fix_texels(&mut inputs);
        inputs
    }

    /// In a quarter of the inputs, textures have the numbers that the programs compare with, and
    /// numbers between them: a threshold shows.
    fn fix_texels(&self, inputs: &mut Inputs) {
        if !inputs.seed.is_multiple_of(4) {
            return;
        }
        let numbers = self.thresholds();
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

    /// The numbers from 0 to 1 in the fragment stages, and those halfway between two of them.
    fn thresholds(&self) -> Vec<f32> {
        let mut all = Vec::new();
        for stages in [self.first, self.second] {
            let Some(fragment) = stages.fragment else {
                continue;
            };
            let module = fragment.module();
            let functions = module.functions.iter().map(|(_, f)| f);
            for function in functions.chain([fragment.function()]) {
                let literals = function.expressions.iter().filter_map(|(_, e)| literal(e));
                all.extend(literals);
            }
            all.extend(
                module
                    .global_expressions
                    .iter()
                    .filter_map(|(_, e)| literal(e)),
            );
        }
        all.retain(|n| (0.0..=1.0).contains(n));
        all.sort_by(f32::total_cmp);
        all.dedup();
        let between: Vec<f32> = all.windows(2).map(|w| (w[0] + w[1]) / 2.0).collect();
        all.extend(between);
        all
    }
}

fn literal(expression: &Expression) -> Option<f32> {
    match expression {
        Expression::Literal(Literal::F32(number)) => Some(*number),
        Expression::Literal(Literal::AbstractFloat(number)) => Some(*number as f32),
        _ => None,
    }
}
