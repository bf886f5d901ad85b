//! The sentence that a user needs: which variant to ship on this adapter, if any.

use std::collections::{BTreeMap, BTreeSet};

use preshade_plan::contract::{Contract, Verdict};

use crate::measure::error::counted;
use crate::measure::record::{ORIGINAL, Report, VariantReport, ViewReport};
use crate::measure::shadow::ShadowReport;
use crate::measure::variant::without_remedy;
use crate::measure::{Estimate, OutputsReport};
use preshade_draw::render::order;
use preshade_draw::scene::DrawOrder;

/// The picture of a variant that keeps its contract.
pub(super) fn picture(contract: &Contract) -> &'static str {
    match contract {
        Contract::Exact { .. } => "same picture",
        Contract::Rounding { .. } => "within rounding",
        Contract::Approximate { .. } | Contract::Budgets { .. } => "within budget",
    }
}

/// The verdict in a word or two. The original has none, unless it could not be drawn. A variant that
/// keeps its own promise may be over the `--budget` of the report.
pub(super) fn verdict(report: &Report, v: &VariantReport) -> String {
    let asked = report.chosen.as_ref().map(|c| c.budget);
    let over = asked.filter(|b| v.error.as_ref().is_some_and(|e| !b.allows(e)));
    match (&v.verdict, over) {
        (Verdict::Holds, _) if v.name == ORIGINAL => String::new(),
        (Verdict::Holds, Some(b)) => format!("over {}={}", b.metric, b.limit),
        (Verdict::Holds, None) => picture(&v.contract).to_owned(),
        (Verdict::Broken { .. }, _) => "BROKEN".to_owned(),
        (Verdict::NotMeasured { .. }, _) => "not measured".to_owned(),
    }
}

/// The sentence. A variant is worth shipping if it keeps its contract, is faster in at least one
/// timed view, and is faster in the mean of all. If some views are drawn front to back, the mean is
/// of those. It counts as faster in a view if the whole 95 % interval of its speedup is above 1,
/// and as slower if all of it is below. Of several, the sentence names the one with the best mean;
/// the number is its mean over the views in which it is faster.
pub(crate) fn headline(report: &Report) -> String {
    let broken: Vec<String> = drawn(report)
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
        (None, None) if aside(report).is_some() => {
            let on = if report.made_up {
                "On a made-up scene: "
            } else {
                ""
            };
            format!("{on}{}", aside(report).unwrap_or_default())
        }
        (None, None) if report.made_up => made_up(report),
        (None, None) if report.clock.is_none() => {
            "Nothing was timed, so nothing is known to be worth shipping.".to_owned()
        }
        (None, None) => match best(report) {
            Some((v, speedups)) => {
                let (name, picture) = (&v.name, picture(&v.contract));
                format!("{name}{}: {picture}, {}.", refused(v), speedups.said())
            }
            None => format!(
                "{} worth shipping on this adapter: ship the original.{}",
                nobody(report),
                not_drawn(report)
            ),
        },
    };
    said + &broken
}

/// Whether the headline is that no variant is worth shipping.
pub fn nothing_pays(report: &Report) -> bool {
    let is_timed = report.clock.is_some() && report.chosen.is_none();
    let is_of_frame = aside(report).is_none();
    is_timed && is_of_frame && not_measured(report).is_none() && best(report).is_none()
}

/// The use of variants that draw only pictures in addition to the frame, and their cost relative to
/// the whole programs. `None`: one draws the frame in another way.
fn aside(report: &Report) -> Option<String> {
    let costs: Option<Vec<String>> = drawn(report)
        .filter(|v| matches!(v.verdict, Verdict::Holds))
        .map(|v| match (&v.outputs, &v.shadow) {
            (Some(outputs), _) => Some(pictures_of(&v.name, outputs)),
            (None, Some(shadow)) if has_only_shadows(&v.recipe) => {
                Some(shadows_of(&v.name, shadow))
            }
            _ => None,
        })
        .collect();
    costs
        .filter(|costs| !costs.is_empty())
        .map(|costs| costs.join(" "))
}

fn pictures_of(name: &str, outputs: &OutputsReport) -> String {
    let right = match &outputs.velocity {
        Some(velocity) => format!(
            "velocities right to {:.4} pixels in {}",
            velocity.worst,
            counted(velocity.pixels, "pixel")
        ),
        None => format!(
            "the original's depths in {}",
            counted(outputs.depths.covered, "pixel")
        ),
    };
    // The ratio is of times that were measured in turns. The table's are of another moment.
    let cost = outputs.speedup.as_ref().map_or(String::new(), |speedup| {
        let share = 100.0 / speedup.median;
        format!(", for {share:.0} % of the main passes' time")
    });
    format!("`{name}` has {right}{cost}.")
}

fn shadows_of(name: &str, shadow: &ShadowReport) -> String {
    let covered = counted(shadow.depths.covered, "pixel");
    let cost = shadow.speedup.as_ref().map_or(String::new(), |speedup| {
        let share = 100.0 / speedup.median;
        format!(", for {share:.0} % of their time")
    });
    format!("`{name}` has the whole programs' depths in {covered} of shadow maps{cost}.")
}

/// Whether a recipe leaves the camera's frame as it is, and adds shadow passes.
fn has_only_shadows(recipe: &str) -> bool {
    let mut steps = recipe.split(" + ");
    steps.all(|step| step.split(':').next() == Some("shadow"))
}

fn drawn(report: &Report) -> impl Iterator<Item = &VariantReport> {
    report.variants.iter().filter(|v| v.name != ORIGINAL)
}

/// The variant that is most worth shipping.
fn best(report: &Report) -> Option<(&VariantReport, Speedups<'_>)> {
    let worth = drawn(report).filter_map(|v| Some((v, Speedups::of(v)?)));
    worth.max_by(|(_, a), (_, b)| a.mean.total_cmp(&b.mean))
}

/// The sentence if preshade made the scene up, which is no basis for a decision.
fn made_up(report: &Report) -> String {
    let guessed = match report.assumed.len() {
        0 => String::new(),
        1 => " (1 guessed input)".to_owned(),
        n => format!(" ({n} guessed inputs)"),
    };
    let found = match best(report) {
        _ if report.clock.is_none() => "nothing was timed.".to_owned(),
        Some((v, speedups)) => format!(
            "{} with {}{}, {}.",
            picture(&v.contract),
            v.name,
            refused(v),
            speedups.said()
        ),
        None => format!(
            "{} faster.{}",
            nobody(report).replacen("None", "none", 1),
            not_drawn(report)
        ),
    };
    format!("On a made-up scene{guessed}: {found} Give your scene before you decide.")
}

/// The beginning of a sentence that denies something of all variants.
fn nobody(report: &Report) -> String {
    let measured = drawn(report).filter(|v| !matches!(v.verdict, Verdict::NotMeasured { .. }));
    let names: Vec<&str> = measured.map(|v| v.name.as_str()).collect();
    match names[..] {
        [] => "Nothing here is".to_owned(),
        [one] => format!("`{one}` is not"),
        _ => format!("None of the {} recipes drawn is", names.len()),
    }
}

/// A recipe to try where nothing that was drawn pays.
fn not_drawn(report: &Report) -> String {
    let recipe = report.not_drawn.as_ref();
    recipe.map_or(String::new(), |recipe| format!(" Not drawn: {recipe}."))
}

/// Why the pictures are no evidence about any variant. `None`: they are.
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
/// remedy` or `pass[code]: reason; does not apply`.
fn shared_reason(report: &Report) -> String {
    let kept = report.variants.iter().flat_map(|v| &v.kept);
    let reasons: BTreeSet<&str> = kept
        .filter_map(|k| {
            let (_, reason) = without_remedy(&k.why).split_once("]: ")?;
            Some(reason)
        })
        .collect();
    match reasons.into_iter().collect::<Vec<_>>()[..] {
        [reason] => format!(": {reason}"),
        _ => String::new(),
    }
}

/// The speedups of a variant that is worth shipping.
struct Speedups<'r> {
    /// Geometric mean over the timed views, of those drawn front to back if some are.
    mean: f64,
    timed: Vec<(&'r ViewReport, Estimate)>,
}

impl<'r> Speedups<'r> {
    fn of(v: &'r VariantReport) -> Option<Self> {
        if !matches!(v.verdict, Verdict::Holds) {
            return None;
        }
        let views = v.by_view.iter();
        let timed: Vec<_> = views
            .filter_map(|view| Some((view, view.speedup?)))
            .collect();
        // As a good engine draws; back to front makes a pre-pass look much better than it is.
        let in_front = |view: &ViewReport| view.order == DrawOrder::FrontToBack;
        let has_front = timed.iter().any(|(view, _)| in_front(view));
        let judged = timed
            .iter()
            .filter(|(view, _)| !has_front || in_front(view));
        let judged: Vec<Estimate> = judged.map(|(_, s)| *s).collect();
        let mean = geometric_mean(judged.iter().map(|s| s.median));
        let is_faster = judged.iter().any(|s| s.low > 1.0);
        (is_faster && mean > 1.0).then_some(Self { mean, timed })
    }

    fn faster(&self) -> impl Iterator<Item = &(&'r ViewReport, Estimate)> {
        self.timed.iter().filter(|(_, s)| s.low > 1.0)
    }

    fn slower(&self) -> impl Iterator<Item = &(&'r ViewReport, Estimate)> {
        self.timed.iter().filter(|(_, s)| s.high < 1.0)
    }

    /// Whether the views are one picture in several draw orders.
    fn differ_in_order(&self) -> bool {
        let cameras: BTreeSet<(&str, usize)> = self
            .timed
            .iter()
            .map(|(view, _)| (view.camera.as_str(), view.frame))
            .collect();
        cameras.len() == 1 && self.timed.len() > 1
    }

    fn said(&self) -> String {
        let by_order = self.differ_in_order();
        let at = match (self.faster().count(), self.timed.len()) {
            (_, 1) => String::new(),
            (n, of) if n == of && by_order => format!(" in all {of} draw orders"),
            (n, of) if n == of => format!(" in all {of} views"),
            _ if by_order => format!(" {}", orders(self.faster())),
            (n, of) => format!(" in {n} of {of} views"),
        };
        let cameras: BTreeSet<&str> = self.slower().map(|(v, _)| v.camera.as_str()).collect();
        let worst = self.slower().map(|(_, s)| 1.0 / s.median - 1.0);
        let worst = (worst.fold(0.0, f64::max) * 100.0).max(1.0);
        let loss = match (self.slower().count(), by_order) {
            (0, _) => String::new(),
            (1, true) => format!(", {worst:.0} % slower {}", orders(self.slower())),
            (_, true) => format!(", up to {worst:.0} % slower {}", orders(self.slower())),
            (_, false) => {
                let cameras: Vec<&str> = cameras.into_iter().collect();
                format!(
                    ", up to {worst:.0} % slower in {} views",
                    cameras.join(" and ")
                )
            }
        };
        let gain = geometric_mean(self.faster().map(|(_, s)| s.median));
        format!("{gain:.2}x faster{at}{loss}")
    }
}

fn geometric_mean(of: impl Iterator<Item = f64>) -> f64 {
    let logs: Vec<f64> = of.map(f64::ln).collect();
    (logs.iter().sum::<f64>() / logs.len().max(1) as f64).exp()
}

/// The draw orders of some views.
fn orders<'v, 'r: 'v>(views: impl Iterator<Item = &'v (&'r ViewReport, Estimate)>) -> String {
    let names: Vec<String> = views
        .map(|(view, _)| {
            let common = match view.order {
                DrawOrder::FrontToBack => " (the order most engines use)",
                _ => "",
            };
            format!("{}{common}", order::name(view.order))
        })
        .collect();
    names.join(" and ")
}

#[cfg(test)]
mod tests {
    use preshade_plan::budget::{Budget, Metric};

    use super::*;
    use crate::jobs::made_up::adapter;
    use crate::measure::record::{Choice, Chosen};
    use crate::measure::{Clock, DepthReport, ErrorLadder};

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
            part: None,
            resolution: [1, 1],
            samples: 1,
            command: String::new(),
            adapter: adapter(""),
            clock: Some(Clock::WallClock),
            depth_ties: None,
            made_up: false,
            assumed: Vec::new(),
            notes: Vec::new(),
            warnings: Vec::new(),
            untested: Vec::new(),
            not_drawn: None,
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

    /// It is no replacement of the main pass.
    #[test]
    fn an_auxiliary_pass_is_told_by_its_cost() {
        let outputs = OutputsReport {
            depths: DepthReport {
                covered: 1,
                ..DepthReport::default()
            },
            velocity: None,
            main_ms: None,
            time_ms: None,
            speedup: Some(Estimate {
                median: 2.0,
                low: 2.0,
                high: 2.0,
            }),
        };
        let own = VariantReport {
            outputs: Some(outputs),
            ..variant("a", &[("wall", 1.0)], Verdict::Holds)
        };
        let report = report(vec![own]);
        assert_eq!(
            headline(&report),
            "`a` has the original's depths in 1 pixel, for 50 % of the main passes' time."
        );
        assert!(!nothing_pays(&report));
    }

    /// The camera's frame is the original's, so its times decide nothing.
    #[test]
    fn a_shadow_pass_is_told_by_its_maps() {
        let shadow = ShadowReport {
            map: [64, 64],
            depths: DepthReport {
                covered: 12,
                ..DepthReport::default()
            },
            whole_ms: None,
            time_ms: None,
            speedup: Some(Estimate {
                median: 4.0,
                low: 4.0,
                high: 4.0,
            }),
        };
        let own = |recipe: &str| VariantReport {
            recipe: recipe.to_owned(),
            shadow: Some(shadow.clone()),
            ..variant("a", &[("wall", 1.0)], Verdict::Holds)
        };
        let of_maps = report(vec![own("shadow:alpha=kept")]);
        assert_eq!(
            headline(&of_maps),
            "`a` has the whole programs' depths in 12 pixels of shadow maps, for 25 % of their time."
        );
        assert!(!nothing_pays(&of_maps));
        // With a pass that changes the frame, the frame decides.
        assert!(nothing_pays(&report(vec![own("depth-prepass + shadow")])));
    }

    #[test]
    fn noise_losses_and_broken_variants_are_not_worth_shipping() {
        let nothing = "`a` is not worth shipping on this adapter: ship the original.";
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
        let slow = || variant("a", &noise, Verdict::Holds);
        assert_eq!(
            said(vec![slow(), fast]),
            "None of the 2 recipes drawn is worth shipping on this adapter: ship the original. \
             `fast` is BROKEN: do not ship it."
        );
        let mut report = report(vec![slow()]);
        report.not_drawn = Some("hoist, which saves 9 of 9 ops".to_owned());
        assert_eq!(
            headline(&report),
            format!("{nothing} Not drawn: hoist, which saves 9 of 9 ops.")
        );
    }

    #[test]
    fn the_orders_of_one_camera_are_named() {
        let of = |speedups: [f64; 3]| {
            let mut one = variant("a", &speedups.map(|s| ("wall", s)), Verdict::Holds);
            let orders = [
                DrawOrder::FrontToBack,
                DrawOrder::BackToFront,
                DrawOrder::Shuffled,
            ];
            for (view, order) in one.by_view.iter_mut().zip(orders) {
                view.order = order;
            }
            said(vec![one])
        };
        // A variant that pays only in an order that no engine draws in is not worth shipping.
        let nothing = "`a` is not worth shipping on this adapter: ship the original.";
        assert_eq!(of([1.0 / 1.14, 1.5, 1.5]), nothing);
        let told = of([1.5, 1.5, 1.0 / 1.14]);
        assert!(
            told.starts_with(
                "a: same picture, 1.50x faster front to back (the order most engines use) and back \
                 to front, 14 % slower"
            ),
            "{told}"
        );
        let all = variant("a", &[("wall", 1.5); 3], Verdict::Holds);
        assert_eq!(
            said(vec![all]),
            "a: same picture, 1.50x faster in all 3 draw orders."
        );
    }

    #[test]
    fn a_made_up_scene_decides_nothing() {
        let of = |variants| Report {
            made_up: true,
            ..report(variants)
        };
        assert_eq!(
            headline(&of(vec![variant("a", &[("wall", 1.5)], Verdict::Holds)])),
            "On a made-up scene: same picture with a, 1.50x faster. Give your scene before you decide."
        );
        let slow = |name| variant(name, &[("wall", 0.5)], Verdict::Holds);
        assert_eq!(
            headline(&of(vec![slow("a"), slow("b")])),
            "On a made-up scene: none of the 2 recipes drawn is faster. Give your scene before you decide."
        );
    }

    #[test]
    fn an_original_that_does_not_repeat_itself_is_said_first() {
        let mut report = report(vec![variant("a", &[("wall", 1.5)], Verdict::Holds)]);
        report.untested = vec!["nothing is discarded".to_owned()];
        report.variants[0].error = Some(ErrorLadder {
            changed_pixels: 96,
            ..ErrorLadder::default()
        });
        let why = report.unrepeated().unwrap_or_default();
        report.void(&why, |_| true);
        assert_eq!(
            headline(&report),
            "Not measured: the original does not repeat itself on this adapter (96 pixels); nothing is discarded."
        );
    }

    #[test]
    fn a_variant_over_the_budget_that_was_asked_for_is_not_within_it() {
        let budget = |limit| Budget {
            metric: Metric::FlipMean,
            limit,
        };
        let mut own = variant("a", &[("wall", 1.5)], Verdict::Holds);
        own.error = Some(ErrorLadder {
            flip_mean: 0.05,
            ..ErrorLadder::default()
        });
        let mut report = report(vec![own]);
        for (limit, said) in [(0.02, "over flip_mean=0.02"), (0.1, "same picture")] {
            report.chosen = Some(Chosen::among(&report.variants, budget(limit)));
            assert_eq!(verdict(&report, &report.variants[1]), said);
        }
    }

    #[test]
    fn a_variant_that_breaks_its_promise_is_not_chosen() {
        let broken = Verdict::Broken {
            r#where: "here".to_owned(),
        };
        let mut variants = vec![
            variant("fast", &[("wall", 2.0)], broken),
            variant("slower", &[("wall", 1.5)], Verdict::Holds),
        ];
        variants
            .iter_mut()
            .for_each(|v| v.error = Some(ErrorLadder::default()));
        let budget = Budget {
            metric: Metric::FlipTile,
            limit: 0.1,
        };
        let chosen = |variants: &[VariantReport]| match Chosen::among(variants, budget).choice {
            Choice::Within { variant, .. } => Some(variant),
            _ => None,
        };
        assert_eq!(chosen(&variants).as_deref(), Some("slower"));
        assert_eq!(chosen(&variants[..1]), None);
    }

    #[test]
    fn a_report_without_a_measured_variant_says_so() {
        let why = "every material refuses it".to_owned();
        let refused = || variant("a", &[], Verdict::NotMeasured { why: why.clone() });
        assert_eq!(
            said(vec![refused()]),
            "Not measured: every material refuses it."
        );
        // A sentence about one variant does not hold for all.
        let holds = variant("b", &[("wall", 1.5)], Verdict::Holds);
        assert_eq!(
            said(vec![refused(), holds]),
            "b: same picture, 1.50x faster."
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
