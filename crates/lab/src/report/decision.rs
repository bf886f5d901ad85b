//! A decision for a terminal: plain text, without colours.

use preshade_plan::contract::Verdict;

use crate::search::plan::decision::{
    Decision, MaterialDecision, PlanReport, SwitchCost, ViewReport,
};
use crate::search::plan::model::ModelOrigin;
use crate::search::plan::policy::Rule;
use crate::search::plan::reasons::ratio;
use preshade_draw::render::order;

/// The decision as lines of text.
pub fn render(decision: &Decision) -> String {
    let part = decision.part.as_deref();
    let mut lines = vec![
        super::place(
            &decision.scene,
            part,
            decision.resolution,
            1,
            &decision.adapter,
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
        lines.extend(refused(material));
    }
    if decision.materials.iter().any(|m| !m.refused.is_empty()) {
        lines.push(
            "\n`preshade --explain CODE` explains a code; --format json has every reason"
                .to_owned(),
        );
    }
    lines.push(String::new());
    lines.extend(views(decision));
    lines.join("\n")
}

/// The steps that a material refuses, each with its codes. A refusal reads `pass[code]: reason`.
fn refused(material: &MaterialDecision) -> Option<String> {
    let mut codes: Vec<String> = Vec::new();
    for refused in &material.refused {
        let (head, _) = refused.why.split_once(": ").unwrap_or((&refused.why, ""));
        let code = match head.split_once('[') {
            Some((pass, code)) => {
                let mut steps = refused.recipe.split(" + ");
                let step = steps.find(|step| step.split(':').next() == Some(pass));
                format!("{} ({}", step.unwrap_or(pass), code.replace(']', ")"))
            }
            None => head.to_owned(),
        };
        if !codes.contains(&code) {
            codes.push(code);
        }
    }
    (!codes.is_empty()).then(|| format!("  does not apply: {}", codes.join(", ")))
}

/// Most predictions of one material, and most plans of one view, to print.
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
    told.chain(decision.views.iter().filter_map(sorted))
        .chain(decision.views.iter().filter_map(ahead))
        .collect()
}

/// The gain of another order of the draws in a view, if it pays.
fn sorted(view: &ViewReport) -> Option<String> {
    let sorted = view.sorted.as_ref().filter(|s| s.pays())?;
    Some(format!(
        "{}: sort {} of {} draws front to back: {} as written, without a new pass; no pixel changes",
        view.view,
        sorted.moved.len(),
        sorted.draws.len(),
        ratio(&sorted.speedup),
    ))
}

/// The gain of a pre-pass of some draws in a view, if it pays.
fn ahead(view: &ViewReport) -> Option<String> {
    let ahead = view.ahead.as_ref().filter(|a| a.pays())?;
    Some(format!(
        "{}: draw {} of {} draws ahead in `{}`: {} as written; no pixel changes",
        view.view,
        ahead.draws.len(),
        ahead.of,
        ahead.recipe,
        ratio(&ahead.speedup),
    ))
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
            vec!["Nothing is predicted to pay: draw every material as it is written.".to_owned()]
        }
        Rule::One { plan: 0 } => {
            vec!["Nothing pays: draw every material as it is written.".to_owned()]
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

/// Each view with the plans that matter in it, and the speedup of each over the original. Their
/// times are not printed: each was measured against an original of its own.
fn views(decision: &Decision) -> Vec<String> {
    let predicted = match decision.clock {
        Some(_) => "",
        None => "predicted ",
    };
    let mut lines = vec![format!(
        "{predicted}speedup by view (* drawn with, ! broke its promise)"
    )];
    for (i, view) in decision.views.iter().enumerate() {
        let original = decision.plans.first().and_then(|p| p.by_view.get(i));
        let time = original.map_or(String::new(), |at| {
            let ms = at.time_ms.map_or(at.predicted_ms, |time| time.median);
            format!("{ms:.3} ms as written")
        });
        let again = view.again.as_ref().map_or(String::new(), |again| {
            format!(", against itself {}", ratio(again))
        });
        lines.push(format!(
            "{}: {:.2} opaque fragments shaded a pixel, overdraw {:.2}, {time}{again}",
            view.view, view.shaded_per_pixel, view.overdraw
        ));
        let plans = decision.plans.iter().enumerate();
        let mut shown: Vec<(usize, &PlanReport, f64, String)> = plans
            .filter_map(|(number, plan)| {
                let at = plan.by_view.get(i)?;
                let predicted = original.map_or(1.0, |o| o.predicted_ms / at.predicted_ms);
                let (factor, said) = match (&at.speedup, decision.clock) {
                    (Some(measured), _) => (measured.median, ratio(measured)),
                    (None, None) => (predicted, format!("{predicted:.3}x")),
                    (None, Some(_)) if view.plan == number => (1.0, "1.000x".to_owned()),
                    (None, Some(_)) => return None,
                };
                (number > 0 || view.plan == 0).then_some((number, plan, factor, said))
            })
            .collect();
        shown.sort_by(|a, b| {
            (b.0 == view.plan)
                .cmp(&(a.0 == view.plan))
                .then(b.2.total_cmp(&a.2))
        });
        for (number, plan, _, said) in shown.into_iter().take(SHOWN) {
            let mark = match (view.plan == number, is_out(plan)) {
                (true, _) => "*",
                (_, true) => "!",
                _ => " ",
            };
            lines.push(format!("  {mark} {said:<22}  {}", plan.name));
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
