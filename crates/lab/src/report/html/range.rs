//! Ratios with their intervals on one scale, a strip for each row of a table.

use crate::measure::Estimate;

/// Width of a strip in SVG's units; its height is 16.
pub(crate) const WIDTH: f64 = 160.0;

/// A scale that several strips share.
#[derive(Clone, Copy)]
pub(crate) struct Scale {
    from: f64,
    to: f64,
}

/// A strip: where the interval lies, and where 1 does.
pub(crate) struct Strip {
    /// Start of the interval, in percent.
    pub low: f64,
    pub median: f64,
    pub high: f64,
    /// Place of the ratio 1, in percent.
    pub even: f64,
    /// How the interval compares with 1: `faster`, `slower` or `level`.
    pub class: &'static str,
}

impl Scale {
    /// A scale that has all of these on it, and 1. Ratios far beyond ten are drawn at its end.
    pub fn of<'e>(ratios: impl Iterator<Item = &'e Estimate>) -> Self {
        let (mut from, mut to) = (0.9_f64, 1.1_f64);
        for ratio in ratios.filter(|r| r.low.is_finite() && r.high.is_finite()) {
            from = from.min(ratio.low);
            to = to.max(ratio.high.min(10.0));
        }
        let margin = (to - from) * 0.04;
        Self {
            from: from - margin,
            to: to + margin,
        }
    }

    pub fn strip(self, ratio: &Estimate) -> Strip {
        let at = |value: f64| {
            let part = (value - self.from) / (self.to - self.from);
            (part.clamp(0.0, 1.0) * WIDTH * 10.0).round() / 10.0
        };
        Strip {
            low: at(ratio.low),
            median: at(ratio.median),
            high: at(ratio.high),
            even: at(1.0),
            class: match () {
                () if ratio.low > 1.0 => "faster",
                () if ratio.high < 1.0 => "slower",
                () => "level",
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_of_one_scale_compare() {
        let of = |low, median, high| Estimate { median, low, high };
        let ratios = [of(0.5, 0.6, 0.7), of(0.99, 1.0, 1.01), of(2.0, 2.2, 2.4)];
        let scale = Scale::of(ratios.iter());
        let [slow, level, fast] = ratios.map(|r| scale.strip(&r));
        assert_eq!(
            [slow.class, level.class, fast.class],
            ["slower", "level", "faster"]
        );
        assert_eq!((slow.even, level.median), (fast.even, slow.even));
        assert!(slow.high < slow.even && fast.low > fast.even);
        assert!(slow.low >= 0.0 && fast.high <= WIDTH);
    }
}
