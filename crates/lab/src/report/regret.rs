//! How good the choices of `plan` are, for a terminal and for a spreadsheet.

use super::grid::{Csv, quoted};
use crate::search::plan::reasons::ratio;
use crate::search::plan::regret::{PlanRegret, RegretReport};

impl RegretReport {
    /// Each view as a line for a spreadsheet.
    pub fn csv(&self) -> String {
        let mut csv = Csv::new(
            "scene,held_out,view,shaded_per_pixel,best,alone,alone_regret,alone_speedup,policy,\
             policy_regret,policy_speedup",
        );
        for scene in &self.scenes {
            for view in &scene.views {
                let judged = |j: &PlanRegret| {
                    let plan = quoted(&scene.plans[j.plan]);
                    format!("{plan},{},{}", j.regret(), j.speedup.median)
                };
                csv.line([
                    quoted(&scene.scene),
                    scene.held_out.to_string(),
                    quoted(&view.view.to_string()),
                    view.shaded_per_pixel.to_string(),
                    quoted(&scene.plans[view.best]),
                    judged(&view.alone),
                    judged(&view.policy),
                ]);
            }
        }
        csv.text()
    }

    /// The report as lines of text.
    pub fn render(&self) -> String {
        let percent = |x: f64| format!("{:.2} %", x * 100.0);
        let mut lines = vec![
            format!(
                "regret of plan on {}, {} scenes",
                self.adapter.title(),
                self.scenes.len()
            ),
            String::new(),
            format!(
                "{:<9} {:<9} {:>6} {:>8} {:>8} {:>8} {:>8} {:>8} {:>7}  worst at",
                "choice",
                "scenes",
                "views",
                "changed",
                "counted",
                "median",
                "p95",
                "worst",
                "slower"
            ),
        ];
        lines.extend(self.summary.iter().map(|s| {
            format!(
                "{:<9} {:<9} {:>6} {:>8} {:>8} {:>8} {:>8} {:>8} {:>7}  {}",
                s.choice,
                s.scenes,
                s.views,
                s.changed,
                s.counted,
                percent(s.median),
                percent(s.p95),
                percent(s.worst),
                s.slower,
                s.worst_at
            )
        }));
        lines.push(String::new());
        lines.extend(self.prediction.iter().map(|p| {
            format!(
                "predicted against measured, {}: {} frames, time off by {} at the median, ratio to \
                 the original by {}; predicted first is within 1 % of the fastest in {} of {} \
                 views",
                p.scenes,
                p.frames,
                percent(p.time),
                percent(p.ratio),
                p.first,
                p.views
            )
        }));
        lines.push(
            "best: of the plans measured, which are the original, each recipe alone and the mixes \
             predicted best; choices are judged before they are refined material by material"
                .to_owned(),
        );
        lines.push(String::new());
        for scene in &self.scenes {
            for view in &scene.views {
                let line =
                    |j: &PlanRegret| format!("{} {}", scene.plans[j.plan], ratio(&j.speedup));
                lines.push(format!(
                    "{}: {}: {}; regret {}; policy {}, regret {}; best {}",
                    scene.scene,
                    view.view,
                    line(&view.alone),
                    percent(view.alone.regret()),
                    line(&view.policy),
                    percent(view.policy.regret()),
                    scene.plans[view.best]
                ));
            }
        }
        lines.extend(
            self.failed
                .iter()
                .map(|(s, why)| format!("{s}: not measured: {why}")),
        );
        lines.join("\n")
    }
}
