//! `--sweep`: the values of a scene variable at which `verify` measures.

use preshade_scenes::{Variable, Variables};

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Axis {
    pub variable: String,
    /// Ascending.
    pub values: Vec<u32>,
}

impl Axis {
    /// Reads `NAME=A..B[:STEPS]`: values at a constant ratio, about 2 by default.
    pub fn parse(text: &str) -> Result<Self, String> {
        let expected = "expected NAME=A..B[:STEPS], instances=50000..400000 say";
        let (variable, range) = text.split_once('=').ok_or(expected)?;
        let (range, steps) = match range.split_once(':') {
            Some((range, steps)) => (range, Some(steps)),
            None => (range, None),
        };
        let (low, high) = range.split_once("..").ok_or(expected)?;
        let number = |s: &str| match s.trim().replace('_', "").parse::<u32>() {
            Ok(n @ 1..) => Ok(n),
            _ => Err(format!("`{s}` is not a whole number from 1")),
        };
        let (low, high) = (number(low)?, number(high)?);
        if low > high {
            return Err(format!("{low} is more than {high}"));
        }
        let ratio = f64::from(high) / f64::from(low);
        let steps = match steps {
            Some(steps) => match number(steps)? {
                n @ 2..=64 => n,
                n => return Err(format!("{n} steps: 2 to 64 are allowed")),
            },
            None => ratio.log2().round() as u32 + 1,
        };
        let mut values: Vec<u32> = (0..steps)
            .map(|i| {
                let part = f64::from(i) / f64::from((steps - 1).max(1));
                (f64::from(low) * ratio.powf(part)).round() as u32
            })
            .collect();
        values.dedup();
        Ok(Self {
            variable: variable.trim().to_owned(),
            values,
        })
    }

    /// The variable at one of its values.
    pub fn at(&self, value: u32) -> Variables {
        Variables::from([(self.variable.clone(), Variable::Number(value))])
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn steps_double_unless_they_are_given() {
        let values = |text| Axis::parse(text).unwrap().values;
        assert_eq!(
            values("n=50000..400000"),
            [50_000, 100_000, 200_000, 400_000]
        );
        assert_eq!(values("n=1..9:3"), [1, 3, 9]);
        assert_eq!(values("n=7..7"), [7]);
        for wrong in ["n", "n=5", "n=9..1", "n=0..4", "n=1..4:1", "n=a..b"] {
            assert!(Axis::parse(wrong).is_err(), "{wrong}");
        }
    }
}
