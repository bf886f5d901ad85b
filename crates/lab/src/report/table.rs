//! The table for a terminal: plain text, aligned.

use preshade_plan::budget::Metric;
use preshade_plan::contract::Verdict;

use super::frontier;
use super::grid::{self, Cell, or_dash};
use super::headline::{headline, verdict};
use crate::measure::record::{PathTime, Report, VariantReport};
use crate::measure::{Clock, ErrorLadder, OutputsReport, ShadowReport};
use preshade_draw::render::SelfTestResult;

/// The report as lines of text, the headline first. `coloured`: with ANSI colours.
pub fn render(report: &Report, coloured: bool) -> String {
    let metrics = budgeted(report);
    let words = [
        "variant",
        "verdict",
        "changed px",
        "depths",
        "max abs",
        "FLIP",
    ];
    let mut header = grid::row(words);
    header.extend(metrics.iter().map(|metric| metric.to_string().into()));
    header.extend(["ms", "speedup", "shaded/px"].map(Cell::from));
    let mut rows = vec![header];
    rows.extend(report.variants.iter().map(|v| row(report, v, &metrics)));
    let part = report.part.as_deref();
    let mut out = format!(
        "{}\n\n{}\n\n{}\n{}{}",
        headline(report),
        super::place(
            &report.scene,
            part,
            report.resolution,
            report.samples,
            &report.adapter
        ),
        grid::aligned(&grid::ruled(rows), |c| c < 2, coloured),
        by_view(report, coloured),
        by_path(report)
    );
    for sweep in &report.sweeps {
        out.push_str(&sweep.table(report));
    }
    out.push_str(&notes(report));
    out
}

/// The metrics of the budgets that have no column of their own: those of the variants, and the
/// requested one.
fn budgeted(report: &Report) -> Vec<Metric> {
    let contracts = report.variants.iter().map(|v| v.contract.budgets());
    let asked = report.chosen.iter().map(|chosen| chosen.budget);
    let metrics = contracts.flatten().chain(asked).map(|budget| budget.metric);
    let mut found = Vec::new();
    for metric in metrics.filter(|m| matches!(m, Metric::FlipP99 | Metric::FlipTile)) {
        if !found.contains(&metric) {
            found.push(metric);
        }
    }
    found
}

fn row(report: &Report, v: &VariantReport, metrics: &[Metric]) -> Vec<Cell> {
    let error = v.error.as_ref();
    let drawn = |f: &dyn Fn(&ErrorLadder) -> String| or_dash(error, f);
    let mut cells = grid::row([
        v.name.clone(),
        verdict(report, v),
        drawn(&|e| e.changed_pixels.to_string()),
        drawn(&|e| e.changed_depth.to_string()),
        drawn(&|e| match e.max_abs {
            0.0 => "0".to_owned(),
            m => format!("{m:.4}"),
        }),
        drawn(&|e| frontier::number(e.flip_mean)),
    ]);
    let values = metrics.iter();
    let values = values.map(|metric| drawn(&|e| frontier::number(metric.of(e))));
    cells.extend(values.map(Cell::from));
    let time = or_dash(v.time_ms.as_ref(), |t| format!("{:.3}", t.estimate.median));
    let speedup = or_dash(v.speedup, frontier::speedup);
    let shaded = or_dash(v.shaded_per_pixel, |s| format!("{s:.2}"));
    cells.extend([
        time.into(),
        Cell::speedup(speedup, v.speedup),
        shaded.into(),
    ]);
    cells
}

/// The scene and adapter, broken contracts, and materials left alone.
pub(super) fn notes(report: &Report) -> String {
    let mut out = String::new();
    if let Some(view) = report.variants.first().and_then(|v| v.by_view.first()) {
        let clock = match report.clock {
            Some(Clock::GpuTimestamps) => "by GPU timestamps",
            Some(Clock::WallClock) => "by the wall clock",
            None => "not taken",
        };
        let views = report.variants.first().map_or(0, |v| v.by_view.len());
        out.push_str(&format!(
            "Errors are the worst of {views} views; times ({clock}) and shaded opaque fragments \
             are of camera `{}`, {}.\n",
            view.camera,
            preshade_draw::render::order::name(view.order)
        ));
    }
    if is_paired_otherwise(&report.variants) {
        out.push_str(
            "A speedup is the median of paired ratios, and ms is each variant's own median: the two \
             may disagree.\n",
        );
    }
    for warning in &report.warnings {
        out.push_str(&format!("Warning: {warning}.\n"));
    }
    for untested in &report.untested {
        out.push_str(&format!("Untested: {untested}.\n"));
    }
    if let Some(ties) = report.depth_ties.filter(|n| *n > 0) {
        let what = match report.samples {
            1 => "pixels",
            _ => "samples",
        };
        out.push_str(&format!(
            "depth ties: at {ties} {what}, over all views, two surfaces share the winning depth.\n"
        ));
    }
    let unrepeated = report.unrepeated();
    for (i, v) in report.variants.iter().enumerate() {
        if let Some(shadow) = &v.shadow {
            out.push_str(&under_the_light(&v.name, shadow));
        }
        if let Some(outputs) = &v.outputs {
            out.push_str(&aside(&v.name, outputs));
        }
        for junction in &v.junctions {
            out.push_str(&format!(
                "{}: {} edges of draw `{}` are edges of `{}` too, which is not divided alike: \
                 pixels along these T-junctions may show what is behind\n",
                v.name, junction.edges, junction.divided, junction.beside
            ));
        }
        let is_swept = is_swept(report, &v.name);
        let alpha = v.error.as_ref().map_or(0, |e| e.changed_alpha);
        if alpha > 0 && !is_swept {
            out.push_str(&format!(
                "{}: alpha alone differs at {alpha} pixels, and FLIP does not see alpha\n",
                v.name
            ));
        }
        let divided = v.cost.as_ref().and_then(|c| c.subdivision.as_ref());
        if let Some(cost) = divided.filter(|_| !is_swept) {
            let at_load = match cost.at_load {
                0 => String::new(),
                n => format!(", {n} at load"),
            };
            out.push_str(&format!(
                "{}: {} new vertices a frame (unshared {}){at_load}, {:.1} MB\n",
                v.name,
                cost.evaluations,
                cost.unshared,
                cost.bytes as f64 / 1e6
            ));
        }
        // Swept variants have their errors and reasons in the sweep's own table.
        if !is_swept {
            out.push_str(&budgets(v));
        }
        match &v.verdict {
            Verdict::Broken { r#where } => {
                out.push_str(&format!("{}: broken at {}\n", v.name, r#where));
            }
            // For the original, it is printed once.
            Verdict::NotMeasured { why }
                if !is_swept && (i == 0 || unrepeated.as_ref() != Some(why)) =>
            {
                out.push_str(&format!("{}: not measured: {why}\n", v.name));
            }
            Verdict::NotMeasured { .. } | Verdict::Holds => {}
        }
        out.push_str(&self_tests(v));
    }
    out.push_str(&left_alone(report));
    out
}

/// Whether a printed speedup and the printed times in its row disagree in direction, or by more
/// than 10 %.
fn is_paired_otherwise(variants: &[VariantReport]) -> bool {
    let time = |v: &VariantReport| v.time_ms.as_ref().map(|t| t.estimate.median);
    let [original, variants @ ..] = variants else {
        return false;
    };
    let printed = |factor: f64| (factor * 100.0).round();
    variants.iter().any(|v| {
        let (Some(before), Some(after), Some(speedup)) = (time(original), time(v), v.speedup)
        else {
            return false;
        };
        let (ratio, speedup) = (before / after, speedup.median);
        let (a, b) = (printed(ratio), printed(speedup));
        let is_turned = (a > 100.0 && b < 100.0) || (a < 100.0 && b > 100.0);
        is_turned || (ratio / speedup).ln().abs() > 1.1_f64.ln()
    })
}

/// Whether a variant is a point of a sweep.
fn is_swept(report: &Report, name: &str) -> bool {
    let mut points = report.sweeps.iter().flat_map(|s| &s.points);
    points.any(|p| p.variant == name)
}

/// The budgets of an approximation, each with the measured value.
fn budgets(v: &VariantReport) -> String {
    let budgets = v.contract.budgets();
    let (Some(error), false) = (&v.error, budgets.is_empty()) else {
        return String::new();
    };
    let told: Vec<String> = budgets
        .iter()
        .map(|b| format!("{b} (measured {:.5})", b.of(error)))
        .collect();
    format!("{}: an approximation, {}\n", v.name, told.join(", "))
}

/// The results and the costs of a shadow pass.
fn under_the_light(name: &str, shadow: &ShadowReport) -> String {
    let [w, h] = shadow.map;
    let mut line = format!(
        "{name}: {} of {} depths differ in a {w}x{h} map under the scene's light",
        shadow.depths.changed_depth, shadow.depths.covered
    );
    if let (Some(whole), Some(time), Some(speedup)) =
        (&shadow.whole_ms, &shadow.time_ms, &shadow.speedup)
    {
        line.push_str(&format!(
            "; {:.3} ms by whole programs, {:.3} ms by shadow passes: {}",
            whole.estimate.median,
            time.estimate.median,
            frontier::speedup(*speedup)
        ));
    }
    line + "\n"
}

/// The results and the costs of auxiliary pictures.
fn aside(name: &str, outputs: &OutputsReport) -> String {
    let mut line = format!(
        "{name}: {} of {} auxiliary depths differ",
        outputs.depths.changed_depth, outputs.depths.covered
    );
    if let Some(velocity) = &outputs.velocity {
        line.push_str(&format!(
            "; velocities of {} pixels are right to {:.4} pixels, roundings aside, and up to {:.2} pixels long; \
             {:.1} % were not compared",
            velocity.pixels,
            velocity.worst,
            velocity.longest,
            velocity.share_left_out() * 100.0
        ));
    }
    if let (Some(main), Some(time), Some(speedup)) =
        (&outputs.main_ms, &outputs.time_ms, &outputs.speedup)
    {
        line.push_str(&format!(
            "; timed in turns, apart from the table, {:.3} ms by main passes and {:.3} ms by \
             auxiliary passes: {}",
            main.estimate.median,
            time.estimate.median,
            frontier::speedup(*speedup)
        ));
    }
    line + "\n"
}

/// The self-tests of a variant's plans: one line for all that passed, one for each other.
fn self_tests(v: &VariantReport) -> String {
    let mut out = String::new();
    let mut held = 0;
    for test in &v.self_test {
        let (name, material) = (&v.name, &test.material);
        match &test.result {
            SelfTestResult::Held { .. } => held += 1,
            SelfTestResult::Failed {
                failure, camera, ..
            } => {
                let fallback = test.fallback.as_deref().unwrap_or("original");
                out.push_str(&format!(
                    "{name}: the self-test of `{material}` failed in camera `{camera}`: {failure}; \
                     a host falls back to `{fallback}`\n"
                ));
            }
            SelfTestResult::NotRun { why } => {
                out.push_str(&format!(
                    "{name}: the self-test of `{material}` says nothing: {why}\n"
                ));
            }
        }
    }
    let is_measured = !matches!(v.verdict, Verdict::NotMeasured { .. });
    if held > 0 && is_measured {
        out.push_str(&format!(
            "{}: self-test held for {held} of {} materials that have one\n",
            v.name,
            v.self_test.len()
        ));
    }
    out
}

/// Variants and materials that share a reason.
struct Alone<'r> {
    why: &'r str,
    without: Option<&'r str>,
    variants: Vec<&'r str>,
    materials: Vec<&'r str>,
}

/// One line a reason: which variants leave which materials as written, or without which step.
fn left_alone(report: &Report) -> String {
    let mut reasons: Vec<Alone<'_>> = Vec::new();
    let variants = report.variants.iter();
    for v in variants.filter(|v| !is_swept(report, &v.name)) {
        for kept in &v.kept {
            let (why, without) = (kept.why.as_str(), kept.without.as_deref());
            let same = |r: &Alone<'_>| r.why == why && r.without == without;
            let at = reasons.iter().position(same).unwrap_or_else(|| {
                reasons.push(Alone {
                    why,
                    without,
                    variants: Vec::new(),
                    materials: Vec::new(),
                });
                reasons.len() - 1
            });
            if !reasons[at].variants.contains(&v.name.as_str()) {
                reasons[at].variants.push(&v.name);
            }
            if !reasons[at].materials.contains(&kept.material.as_str()) {
                reasons[at].materials.push(&kept.material);
            }
        }
    }
    let quoted = |names: &[&str]| {
        names
            .iter()
            .map(|n| format!("`{n}`"))
            .collect::<Vec<_>>()
            .join(", ")
    };
    reasons
        .iter()
        .map(|r| {
            let how = match r.without {
                Some(step) => format!("without `{step}`"),
                None => "as written".to_owned(),
            };
            let (materials, variants) = (quoted(&r.materials), quoted(&r.variants));
            format!("{materials} {how} in {variants}: {}\n", r.why)
        })
        .collect()
}

/// The slow frames of each camera path.
fn by_path(report: &Report) -> String {
    let Some(original) = report.variants.first() else {
        return String::new();
    };
    let mut out = String::new();
    for path in &original.by_path {
        let times: Vec<String> = report
            .variants
            .iter()
            .filter_map(|v| {
                let same = |p: &&PathTime| (&p.camera, p.order) == (&path.camera, path.order);
                let own = v.by_path.iter().find(same)?;
                Some(format!("{} {:.3} ms", v.name, own.p95_ms))
            })
            .collect();
        out.push_str(&format!(
            "95% of {} frames of `{}`, {}, take no longer than: {}\n",
            path.frames,
            path.camera,
            preshade_draw::render::order::name(path.order),
            times.join(", ")
        ));
    }
    out
}

/// The speedups of every timed view, if there are several: a gain in one view may be a loss in
/// another.
fn by_view(report: &Report, coloured: bool) -> String {
    let [original, variants @ ..] = report.variants.as_slice() else {
        return String::new();
    };
    let timed: Vec<usize> = (0..original.by_view.len())
        .filter(|i| original.by_view[*i].time_ms.is_some())
        .collect();
    if timed.len() < 2 || variants.is_empty() {
        return String::new();
    }
    let header = ["view", "shaded/px", "ms"].into_iter();
    let names = variants.iter().map(|v| v.name.as_str());
    let mut rows = vec![grid::row(header.chain(names))];
    for i in timed {
        let view = &original.by_view[i];
        let order = preshade_draw::render::order::name(view.order);
        let mut cells = grid::row([
            format!("{} {}, {order}", view.camera, view.frame),
            or_dash(view.shaded_per_pixel, |s| format!("{s:.2}")),
            or_dash(view.time_ms.as_ref(), |t| {
                format!("{:.3}", t.estimate.median)
            }),
        ]);
        cells.extend(variants.iter().map(|v| {
            let speedup = v.by_view.get(i).and_then(|w| w.speedup);
            Cell::speedup(or_dash(speedup, |s| format!("{:.2}x", s.median)), speedup)
        }));
        rows.push(cells);
    }
    let lines = grid::aligned(&rows, |c| c < 1, coloured);
    format!("The original by view, and the speedup of each variant:\n\n{lines}\n")
}

#[cfg(test)]
mod tests {
    use preshade_plan::contract::Contract;

    use super::*;
    use crate::measure::{Estimate, FrameTime};

    #[test]
    fn times_that_disagree_with_their_speedup_are_explained() {
        let exactly = |median: f64| Estimate {
            median,
            low: median,
            high: median,
        };
        let timed = |ms: f64, speedup: f64| VariantReport {
            time_ms: Some(FrameTime {
                estimate: exactly(ms),
                samples: Vec::new(),
            }),
            speedup: Some(exactly(speedup)),
            ..VariantReport::new("a", "a", Contract::exact(), Verdict::Holds)
        };
        let of = |ms, speedup| is_paired_otherwise(&[timed(1.0, 1.0), timed(ms, speedup)]);
        assert!(of(1.02, 1.02) && of(0.5, 1.7));
        assert!(!of(0.5, 1.9) && !of(1.001, 1.001));
    }

    #[test]
    fn the_self_test_of_a_variant_that_was_not_measured_is_left_out() {
        let of = |verdict| VariantReport {
            self_test: vec![crate::measure::record::SelfTestReport {
                material: "m".to_owned(),
                result: SelfTestResult::Held { samples: 1 },
                fallback: None,
            }],
            ..VariantReport::new("a", "a", Contract::exact(), verdict)
        };
        assert!(self_tests(&of(Verdict::Holds)).contains("self-test held for 1 of 1"));
        let why = "the adapter was lost".to_owned();
        assert_eq!(self_tests(&of(Verdict::NotMeasured { why })), "");
    }
}
