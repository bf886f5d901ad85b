//! A decision for a terminal: plain text, without colours.

use preshade_passes::contract::Verdict;

use crate::render::order;
use crate::search::plan::decision::{Decision, PlanReport, SwitchCost};
use crate::search::plan::model::ModelOrigin;
use crate::search::plan::policy::Rule;
use crate::search::plan::reasons::ratio;

/// The decision as lines of text.
pub fn render(decision: &Decision) -> String {
    let adapter = &decision.adapter;
    let mut lines = vec![
        format!(
            "{}, {}x{}, on {} ({}, {})",
            decision.scene,
            decision.resolution[0],
            decision.resolution[1],
            adapter.title(),
            adapter.backend,
            adapter.kind
        ),
        model(decision),
        String::new(),
    ];
    lines.extend(policy(decision));
    lines.extend(decision.warnings.iter().map(|w| format!("Warning: {w}.")));
    for material in &decision.materials {
        let recipes: Vec<&str> = material
            .recipes
            .iter()
            .map(|r| if r.is_empty() { "as written" } else { r })
            .collect();
        let mut shown = recipes.clone();
        shown.dedup();
        lines.push(format!("\n{}: {}", material.material, shown.join(", or ")));
        lines.extend(material.reasons.iter().map(|r| format!("  {r}")));
        let mut predicted: Vec<_> = material.predicted.iter().collect();
        predicted.sort_by(|a, b| a.relative_time.total_cmp(&b.relative_time));
        if !predicted.is_empty() {
            let each = predicted.iter().take(SHOWN);
            let each: Vec<String> = each
                .map(|p| format!("{} {:.2}", p.recipe, p.relative_time))
                .collect();
            lines.push(format!("  predicted time by itself: {}", each.join(", ")));
        }
        let mut refused: Vec<(&str, Vec<&str>)> = Vec::new();
        for r in &material.refused {
            match refused.iter_mut().find(|(why, _)| *why == r.why) {
                Some((_, recipes)) => recipes.push(&r.recipe),
                None => refused.push((&r.why, vec![&r.recipe])),
            }
        }
        let told = refused.into_iter();
        lines.extend(told.map(|(why, recipes)| format!("  not {}: {why}", recipes.join(", nor "))));
    }
    lines.push(String::new());
    lines.extend(views(decision));
    lines.join("\n")
}

/// Most predictions to print for one material.
const SHOWN: usize = 5;

pub(crate) fn model(decision: &Decision) -> String {
    match &decision.model.origin {
        ModelOrigin::Nominal => {
            "cost model: nominal, of no adapter; nothing is timed, and the choice is a prediction"
                .to_owned()
        }
        ModelOrigin::Fitted {
            adapter,
            frames,
            median_error,
            worst_error,
        } => format!(
            "cost model: fitted to {frames} frames on {adapter}, off by {:.0} % at the median and \
             {:.0} % at the worst",
            median_error * 100.0,
            worst_error * 100.0
        ),
    }
}

/// The plans to draw with, one rule after the other.
pub(crate) fn policy(decision: &Decision) -> Vec<String> {
    let rules = decision.policy.0.iter().enumerate();
    let apart = decision.policy.0.len() > 1;
    let told = rules.flat_map(|(i, held)| {
        let mut lines = rule(decision, &held.rule);
        if let Some(cost) = decision.switch_cost.get(i).copied().flatten() {
            lines.push(switch_cost(&cost));
        }
        if apart {
            let orders: Vec<&str> = held.orders.iter().copied().map(order::name).collect();
            lines[0] = format!("drawn {}: {}", orders.join(" or "), lines[0]);
        }
        lines
    });
    told.collect()
}

fn rule(decision: &Decision, rule: &Rule) -> Vec<String> {
    let name = |plan: usize| {
        let found = decision.plans.get(plan);
        found.map_or(String::new(), |p| p.name.clone())
    };
    let predicted = match decision.clock {
        Some(_) => "",
        None => "predicted, not measured: ",
    };
    match rule {
        Rule::One { plan: 0 } if decision.clock.is_none() => {
            vec!["nothing is predicted to pay: draw every material as it is written".to_owned()]
        }
        Rule::One { plan: 0 } => {
            vec!["nothing pays: draw every material as it is written".to_owned()]
        }
        Rule::One { plan } => vec![format!("{predicted}draw with: {}", name(*plan))],
        Rule::Switch(switch) => vec![
            format!("{predicted}below: {}", name(switch.below)),
            format!("above: {}", name(switch.above)),
            format!(
                "switch up where more than {:.3} fragments a pixel are shaded, and back under {:.3}",
                switch.on, switch.off
            ),
        ],
    }
}

/// The costs of keeping both plans of a switch.
pub(crate) fn switch_cost(cost: &SwitchCost) -> String {
    format!(
        "both together have {} pipelines, made in {:.0} ms, and {:.1} MB of attachments that only \
         one of them has; --one holds to one plan",
        cost.pipelines,
        cost.creation_ms,
        cost.target_bytes as f64 * 1e-6
    )
}

/// Each view with each plan: predicted, measured, and how much faster.
fn views(decision: &Decision) -> Vec<String> {
    let mut lines =
        vec!["by view: predicted ms, measured ms, speedup (* drawn with, ! out)".to_owned()];
    for (i, view) in decision.views.iter().enumerate() {
        lines.push(format!(
            "{}: {:.2} shaded a pixel, overdraw {:.2}",
            view.view, view.shaded_per_pixel, view.overdraw
        ));
        for (number, plan) in decision.plans.iter().enumerate() {
            let mark = match (view.plan == number, is_out(plan)) {
                (true, _) => "*",
                (_, true) => "!",
                _ => " ",
            };
            let Some(at) = plan.by_view.get(i) else {
                continue;
            };
            let time = at
                .time_ms
                .map_or("-".to_owned(), |t| format!("{:.3}", t.median));
            let speedup = at.speedup.as_ref().map_or(String::new(), ratio);
            let line = format!(
                "  {mark} {:>8.3}  {time:>8}  {speedup:<22}  {}",
                at.predicted_ms, plan.name
            );
            lines.push(line.trim_end().to_owned());
        }
    }
    let out = decision.plans.iter().filter_map(|p| match &p.verdict {
        Verdict::Broken { r#where } => Some(format!("! {} broke its promise: {}", p.name, r#where)),
        Verdict::NotMeasured { why } if decision.clock.is_some() => {
            Some(format!("! {} was not measured: {why}", p.name))
        }
        _ => None,
    });
    lines.extend(out);
    lines
}

fn is_out(plan: &PlanReport) -> bool {
    matches!(plan.verdict, Verdict::Broken { .. })
}
