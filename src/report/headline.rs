//! The sentence that a user needs: which variant to ship on this adapter, if any.

use std::collections::{BTreeMap, BTreeSet};

use preshade_passes::contract::{Contract, Verdict};

use crate::measure::Estimate;
use crate::measure::record::{ORIGINAL, Report, VariantReport};

/// The picture of a variant that keeps its contract.
pub(super) fn picture(contract: &Contract) -> &'static str {
    match contract {
        Contract::Exact { .. } => "same picture",
        Contract::Rounding { .. } => "within rounding",
        Contract::Approximate { .. } | Contract::Budgets { .. } => "within budget",
    }
}

/// The verdict in a word or two. The original has none, unless it could not be drawn.
pub(super) fn verdict(v: &VariantReport) -> &'static str {
    match &v.verdict {
        Verdict::Holds if v.name == ORIGINAL => "",
        Verdict::Holds => picture(&v.contract),
        Verdict::Broken { .. } => "BROKEN",
        Verdict::NotMeasured { .. } => "not measured",
    }
}

/// The sentence. A variant is worth shipping if it keeps its contract, is faster in at least one
/// timed view and faster in the mean of all. It counts as faster in a view if the whole 95 %
/// interval of its speedup is above 1, and as slower if all of it is below. Of several, the one with
/// the best mean is named; the number is its mean over the views in which it is faster.
pub fn headline(report: &Report) -> String {
    let drawn = || report.variants.iter().filter(|v| v.name != ORIGINAL);
    let broken: Vec<String> = drawn()
        .filter(|v| matches!(v.verdict, Verdict::Broken { .. }))
        .map(|v| format!("`{}`", v.name))
        .collect();
    let broken = match broken.len() {
        0 => String::new(),
        1 => format!(" {} is BROKEN: do not ship it.", broken[0]),
        _ => format!(" {} are BROKEN: do not ship them.", broken.join(", ")),
    };
    let said = match (not_measured(report), &report.chosen) {
        (Some(why), _) => format!("Not measured: {why}."),
        (None, Some(chosen)) => chosen.said(),
        (None, None) if report.clock.is_none() => {
            "Nothing was timed, so nothing is known to be worth shipping.".to_owned()
        }
        (None, None) => {
            let worth = drawn().filter_map(|v| Some((Speedups::of(v)?, v)));
            let best = worth.max_by(|(a, _), (b, _)| a.mean.total_cmp(&b.mean));
            best.map_or_else(
                || "Nothing here is worth shipping on this adapter: ship the original.".to_owned(),
                |(speedups, v)| {
                    let (name, picture) = (&v.name, picture(&v.contract));
                    format!("{name}{}: {picture}, {}.", refused(v), speedups.said())
                },
            )
        }
    };
    said + &broken
}

/// Why the pictures say nothing about any variant. `None`: they do.
fn not_measured(report: &Report) -> Option<String> {
    let mut whys = report.untested.clone();
    // Nothing else matters on an adapter that does not repeat itself.
    if let (true, Some(why)) = (report.is_unmeasured(), report.unrepeated()) {
        whys.insert(0, why);
    } else if report.is_unmeasured() {
        let variants = report.variants.iter().filter(|v| v.name != ORIGINAL);
        let all: BTreeSet<&str> = variants
            .filter_map(|v| match &v.verdict {
                Verdict::NotMeasured { why } => Some(why.as_str()),
                _ => None,
            })
            .collect();
        whys.extend(match all.into_iter().collect::<Vec<_>>()[..] {
            [why] => vec![format!("{why}{}", shared_reason(report))],
            _ => vec!["each variant has a reason of its own, below".to_owned()],
        });
    }
    (!whys.is_empty()).then(|| whys.join("; "))
}

/// The steps of a variant that materials refuse, in brackets.
fn refused(v: &VariantReport) -> String {
    let mut steps: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for kept in &v.kept {
        if let Some(step) = &kept.without {
            let materials = steps.entry(step).or_default();
            materials.push(format!("`{}`", kept.material));
        }
    }
    let steps = steps.iter();
    let said: Vec<String> = steps
        .map(|(step, materials)| format!("without {step} on {}", materials.join(", ")))
        .collect();
    match said.is_empty() {
        true => String::new(),
        false => format!(" ({})", said.join("; ")),
    }
}

/// The reason of all refusals, if it is one: a refusal reads `pass[code]: reason; to make it legal:
/// remedy`.
fn shared_reason(report: &Report) -> String {
    let kept = report.variants.iter().flat_map(|v| &v.kept);
    let reasons: BTreeSet<&str> = kept
        .filter_map(|k| {
            let (_, reason) = k.why.split_once("]: ")?;
            reason.split("; to make it legal").next()
        })
        .collect();
    match reasons.into_iter().collect::<Vec<_>>()[..] {
        [reason] => format!(": {reason}"),
        _ => String::new(),
    }
}

/// The speedups of a variant that is worth shipping.
struct Speedups {
    /// Geometric mean over all timed views.
    mean: f64,
    /// Geometric mean over the views in which it is faster.
    gain: f64,
    faster: usize,
    views: usize,
    /// The largest loss of time, of 1, and the cameras of the views in which it is slower.
    loss: f64,
    slower: BTreeSet<String>,
}

impl Speedups {
    fn of(v: &VariantReport) -> Option<Self> {
        if !matches!(v.verdict, Verdict::Holds) {
            return None;
        }
        let views = v.by_view.iter();
        let timed: Vec<(&str, Estimate)> = views
            .filter_map(|view| Some((view.camera.as_str(), view.speedup?)))
            .collect();
        let mean = |of: &mut dyn Iterator<Item = f64>| {
            let logs: Vec<f64> = of.map(f64::ln).collect();
            (logs.iter().sum::<f64>() / logs.len().max(1) as f64).exp()
        };
        let faster = || timed.iter().filter(|(_, s)| s.low > 1.0);
        let slower = || timed.iter().filter(|(_, s)| s.high < 1.0);
        let speedups = Self {
            mean: mean(&mut timed.iter().map(|(_, s)| s.median)),
            gain: mean(&mut faster().map(|(_, s)| s.median)),
            faster: faster().count(),
            views: timed.len(),
            loss: slower()
                .map(|(_, s)| 1.0 / s.median - 1.0)
                .fold(0.0, f64::max),
            slower: slower().map(|(camera, _)| (*camera).to_owned()).collect(),
        };
        (speedups.faster > 0 && speedups.mean > 1.0).then_some(speedups)
    }

    fn said(&self) -> String {
        let at = match (self.faster, self.views) {
            (_, 1) => String::new(),
            (n, of) if n == of => format!(" in all {of} views"),
            (n, of) => format!(" in {n} of {of} views"),
        };
        let slower: Vec<&str> = self.slower.iter().map(String::as_str).collect();
        let loss = match slower[..] {
            [] => String::new(),
            _ => format!(
                ", up to {:.0} % slower in {} views",
                (self.loss * 100.0).max(1.0),
                slower.join(" and ")
            ),
        };
        format!("{:.2}x faster{at}{loss}", self.gain)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::record::ViewReport;
    use crate::measure::{Clock, ErrorLadder};
    use crate::render::AdapterReport;
    use crate::scene::DrawOrder;

    fn variant(name: &str, speedups: &[(&str, f64)], verdict: Verdict) -> VariantReport {
        let view = |(camera, median): &(&str, f64)| ViewReport {
            camera: (*camera).to_owned(),
            frame: 0,
            order: DrawOrder::AsGiven,
            error: ErrorLadder::default(),
            time_ms: None,
            speedup: Some(Estimate {
                median: *median,
                low: median - 0.02,
                high: median + 0.02,
            }),
            shaded_per_pixel: None,
        };
        VariantReport {
            by_view: speedups.iter().map(view).collect(),
            ..VariantReport::new(name, name, Contract::exact(), verdict)
        }
    }

    fn said(variants: Vec<VariantReport>) -> String {
        headline(&report(variants))
    }

    fn report(variants: Vec<VariantReport>) -> Report {
        let views: Vec<(&str, f64)> = vec![("wall", 1.0); 3];
        let original = variant(ORIGINAL, &views, Verdict::Holds);
        Report {
            schema: String::new(),
            scene: "test".to_owned(),
            resolution: [1, 1],
            samples: 1,
            command: String::new(),
            adapter: AdapterReport {
                name: String::new(),
                driver: String::new(),
                backend: String::new(),
                kind: String::new(),
                timestamps: false,
                pipeline_statistics: false,
                features: Vec::new(),
                checked_shaders: false,
            },
            clock: Some(Clock::WallClock),
            depth_ties: None,
            assumed: Vec::new(),
            warnings: Vec::new(),
            untested: Vec::new(),
            variants: std::iter::once(original).chain(variants).collect(),
            sweeps: Vec::new(),
            chosen: None,
        }
    }

    #[test]
    fn the_best_variant_is_named_with_its_gain_and_its_loss() {
        let gains = [("wall", 3.0), ("wall", 3.0), ("open", 0.95)];
        let small = [("wall", 1.1), ("wall", 1.1), ("open", 1.0)];
        let all = vec![
            variant("a", &small, Verdict::Holds),
            variant("b", &gains, Verdict::Holds),
        ];
        assert_eq!(
            said(all),
            "b: same picture, 3.00x faster in 2 of 3 views, up to 5 % slower in open views."
        );
        let one = variant("a", &[("wall", 1.5)], Verdict::Holds);
        assert_eq!(said(vec![one]), "a: same picture, 1.50x faster.");
    }

    #[test]
    fn noise_losses_and_broken_variants_are_not_worth_shipping() {
        let nothing = "Nothing here is worth shipping on this adapter: ship the original.";
        let noise = [("wall", 1.01), ("wall", 1.01), ("open", 1.0)];
        // One gain does not outweigh two losses.
        let loss = [("wall", 1.1), ("wall", 0.8), ("open", 0.8)];
        for speedups in [noise, loss] {
            assert_eq!(said(vec![variant("a", &speedups, Verdict::Holds)]), nothing);
        }
        let broken = Verdict::Broken {
            r#where: "here".to_owned(),
        };
        let fast = variant("fast", &[("wall", 2.0)], broken);
        assert_eq!(
            said(vec![fast]),
            format!("{nothing} `fast` is BROKEN: do not ship it.")
        );
    }

    #[test]
    fn a_report_without_a_measured_variant_says_so() {
        let why = "every material refuses it".to_owned();
        let refused = variant("a", &[], Verdict::NotMeasured { why });
        assert_eq!(
            said(vec![refused]),
            "Not measured: every material refuses it."
        );
    }

    #[test]
    fn a_broken_variant_is_named_where_something_is_untested() {
        let broken = Verdict::Broken {
            r#where: "here".to_owned(),
        };
        let mut report = report(vec![variant("fast", &[("wall", 2.0)], broken)]);
        report.untested = vec!["nothing is discarded".to_owned()];
        assert_eq!(
            headline(&report),
            "Not measured: nothing is discarded. `fast` is BROKEN: do not ship it."
        );
    }
}
