//! The numbers that two programs compare with, and inputs that reach them.
//!
//! If a program discards beyond a distance of 30, points must be about 30 away. If it tests a flag,
//! an integer must have that bit.

use std::collections::BTreeSet;

use naga::{Expression, Literal, Statement, SwitchValue, TypeInner};

use super::environment::PassStages;
use super::random::Random;
use super::stage::Stage;
use naga_interp::{Scalar, Value};
use naga_operands::calls;

/// Powers of two between the scales of inputs: from 1/8 to 256.
const SCALES: usize = 12;

/// Numbers of programs, in ascending order.
#[derive(Clone, Debug, Default)]
pub(super) struct Numbers {
    floats: Vec<f32>,
    integers: Vec<u32>,
}

impl Numbers {
    /// All literals of the stages, cases of switches and lengths of arrays; and 0, 1/2 and 1.
    pub(super) fn of(two: [PassStages<'_>; 2]) -> Self {
        let mut floats = vec![0.0, 0.5, 1.0];
        let mut integers = BTreeSet::from([0, 1]);
        let stages = two.into_iter().flat_map(|s| [Some(s.vertex), s.fragment]);
        for stage in stages.flatten() {
            of_stage(stage, &mut floats, &mut integers);
        }
        floats.retain(|n| n.is_finite());
        floats.sort_by(f32::total_cmp);
        floats.dedup();
        let integers = integers.into_iter().collect();
        Self { floats, integers }
    }

    /// The integers, in ascending order.
    pub(super) fn integers(&self) -> &[u32] {
        &self.integers
    }

    /// Those from 0 to 1, and those halfway between two of them.
    pub(super) fn thresholds(&self) -> Vec<f32> {
        let is_in = |n: &&f32| (0.0..=1.0).contains(*n);
        let mut all: Vec<f32> = self.floats.iter().filter(is_in).copied().collect();
        let between: Vec<f32> = all.windows(2).map(|w| (w[0] + w[1]) / 2.0).collect();
        all.extend(between);
        all
    }

    /// Scales the numbers of one variable, attribute or member alike, and replaces some scalars and
    /// components of vectors by numbers of the programs.
    pub(super) fn spread(&self, value: &mut Value, random: &mut Random) {
        let mut scale = random.clone();
        self.spread_at(value, &mut scale, random);
    }

    /// Enlarges scalars alone, which many conditions compare with something computed.
    pub(super) fn enlarge(&self, value: &mut Value, random: &mut Random) {
        match value {
            Value::Scalar(Scalar::F32(x)) => *x *= (2.0 + random.below(8) as f32).exp2(),
            Value::Composite(_) => {}
            other => self.each(other, random, 1.0, usize::MAX),
        }
    }

    /// Likewise, with a scale from other random numbers.
    pub(super) fn spread_at(&self, value: &mut Value, scale: &mut Random, random: &mut Random) {
        let scale = self.scale(scale);
        let is_scalar = |v: &Value| matches!(v, Value::Scalar(_));
        let replaces = match value {
            Value::Scalar(_) => 2,
            Value::Composite(parts) if parts.iter().all(is_scalar) => 6,
            _ => usize::MAX,
        };
        self.each(value, random, scale, replaces);
    }

    /// One in `replaces` floats, and half of the integers, are replaced.
    fn each(&self, value: &mut Value, random: &mut Random, scale: f32, replaces: usize) {
        match value {
            Value::Composite(parts) => {
                for part in parts {
                    self.each(part, random, scale, replaces);
                }
            }
            Value::Scalar(Scalar::F32(x)) => {
                *x = match replaces != usize::MAX && random.below(replaces) == 0 {
                    true => self.float(random),
                    false => *x * scale,
                };
            }
            Value::Scalar(Scalar::U32(x)) => *x = self.integer(*x, random),
            Value::Scalar(Scalar::I32(x)) => *x = self.integer(*x as u32, random) as i32,
            _ => {}
        }
    }

    fn scale(&self, random: &mut Random) -> f32 {
        let size = match random.below(8) {
            0..=3 => return 1.0,
            4 | 5 => (random.below(SCALES) as f32 - 3.0).exp2(),
            _ => {
                let literal = self.floats[random.below(self.floats.len())].abs();
                let size = literal * [0.5, 1.0, 2.0][random.below(3)];
                if (1e-3..1e5).contains(&size) {
                    size
                } else {
                    1.0
                }
            }
        };
        if random.below(8) == 0 { -size } else { size }
    }

    /// A number of the programs, one of its neighbours, or one halfway to the next.
    pub(super) fn float(&self, random: &mut Random) -> f32 {
        let at = random.below(self.floats.len());
        let number = self.floats[at];
        match random.below(6) {
            0 => number.next_up(),
            1 => number.next_down(),
            2 | 3 => self
                .floats
                .get(at + 1)
                .map_or(number + 1.0, |next| number + (next - number) * 0.5),
            _ => number,
        }
    }

    /// In half of the cases the number itself. In the others a number of the programs, a neighbour,
    /// a bit at that place, or two of them combined.
    pub(super) fn integer(&self, own: u32, random: &mut Random) -> u32 {
        let mut one = || self.integers[random.below(self.integers.len())];
        let (first, second) = (one(), one());
        match random.below(12) {
            0..=5 => own,
            6 => first.wrapping_add(1),
            7 => first.wrapping_sub(1),
            8 => 1_u32.checked_shl(first).unwrap_or(first),
            9 => first | second,
            // Within an array of this length.
            10 => random.below(first.clamp(1, 1 << 16) as usize) as u32,
            _ => first,
        }
    }
}

fn of_stage(stage: Stage<'_>, floats: &mut Vec<f32>, integers: &mut BTreeSet<u32>) {
    let module = stage.module();
    let called = calls::called(module, &stage.function().body);
    let called = called.iter().map(|f| &module.functions[*f]);
    let functions: Vec<_> = called.chain([stage.function()]).collect();
    let arenas = functions.iter().map(|f| &f.expressions);
    for (_, expression) in arenas
        .chain([&module.global_expressions])
        .flat_map(|a| a.iter())
    {
        let Expression::Literal(literal) = expression else {
            continue;
        };
        match *literal {
            Literal::F32(x) => floats.push(x),
            Literal::F64(x) | Literal::AbstractFloat(x) => floats.push(x as f32),
            Literal::F16(x) => floats.push(x.to_f32()),
            Literal::U32(n) => _ = integers.insert(n),
            Literal::I32(n) => _ = integers.insert(n as u32),
            Literal::AbstractInt(n) => _ = integers.insert(n as u32),
            _ => {}
        }
    }
    for function in functions {
        naga_operands::visit(&function.body, &mut |statement| {
            if let Statement::Switch { cases, .. } = statement {
                integers.extend(cases.iter().filter_map(|case| match case.value {
                    SwitchValue::U32(n) => Some(n),
                    SwitchValue::I32(n) => Some(n as u32),
                    SwitchValue::Default => None,
                }));
            }
        });
    }
    for (_, ty) in module.types.iter() {
        if let TypeInner::Array { size, .. } = ty.inner
            && let naga::ArraySize::Constant(n) = size
        {
            integers.insert(n.get());
        }
    }
}
