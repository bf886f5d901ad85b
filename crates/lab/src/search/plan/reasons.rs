//! Why a material is drawn as it is, in words.

use preshade_plan::contract::Verdict;

use super::decision::{Decision, PlanReport, PredictedRecipe};
use crate::measure::Estimate;

/// The reasons for one material. `recipes` are its recipes in the plans of the policy, which is
/// final.
pub(crate) fn of(
    material: &str,
    recipes: &[String],
    predicted: &[PredictedRecipe],
    decision: &Decision,
) -> Vec<String> {
    let mut reasons = Vec::new();
    let drawn = decision.drawn();
    for (plan, recipe) in drawn.iter().zip(recipes) {
        let views = |i: &usize| decision.views[*i].plan == *plan;
        if !recipe.is_empty() {
            reasons.push(gain(decision, *plan, recipe, &views));
        }
    }
    if recipes.iter().any(String::is_empty) {
        reasons.push(match predicted.is_empty() {
            true => "no pass applies to it".to_owned(),
            false => left(material, recipes, predicted, decision),
        });
    }
    let broken = decision.plans.iter().filter_map(|p| match &p.verdict {
        Verdict::Broken { r#where } if p.recipes.contains_key(material) => Some(format!(
            "`{}` broke its promise and is out: {}",
            p.name, r#where
        )),
        _ => None,
    });
    reasons.extend(broken);
    reasons
}

/// Speedups of a plan in the views of a kind, the largest first: measured, or where nothing was, predicted.
fn speedups(
    decision: &Decision,
    plan: &PlanReport,
    views: &dyn Fn(&usize) -> bool,
) -> Vec<(Estimate, String)> {
    let each = (0..decision.views.len()).filter(|i| views(i));
    let mut all: Vec<(Estimate, String)> = each
        .filter_map(|i| {
            let at = plan.by_view.get(i)?;
            let before = decision.plans.first()?.by_view.get(i)?;
            let ratio = before.predicted_ms / at.predicted_ms;
            let predicted = Estimate {
                median: ratio,
                low: ratio,
                high: ratio,
            };
            let speedup = match decision.clock {
                Some(_) => at.speedup?,
                None => predicted,
            };
            Some((speedup, decision.views[i].view.to_string()))
        })
        .collect();
    all.sort_by(|a, b| b.0.median.total_cmp(&a.0.median));
    all
}

/// A ratio and its interval; of a prediction, which has none, the ratio.
pub(crate) fn ratio(e: &Estimate) -> String {
    match e.low < e.high {
        true => format!("{:.3}x [{:.3}, {:.3}]", e.median, e.low, e.high),
        false => format!("{:.3}x", e.median),
    }
}

fn gain(decision: &Decision, plan: usize, recipe: &str, views: &dyn Fn(&usize) -> bool) -> String {
    let all = speedups(decision, &decision.plans[plan], views);
    let whole = decision.part.as_deref().unwrap_or("the frame");
    let is = match decision.clock {
        Some(_) => format!("{whole} is"),
        None => format!("{whole} is predicted to be"),
    };
    match (all.first(), all.last()) {
        (Some((best, at)), Some((worst, least))) if all.len() > 1 => format!(
            "`{recipe}`: {is} {} at {at}, and at the least {} at {least}",
            ratio(best),
            ratio(worst)
        ),
        (Some((best, at)), _) => format!("`{recipe}`: {is} {} at {at}", ratio(best)),
        _ => format!("`{recipe}`: in no view that was looked at"),
    }
}

/// Why a material stays as written although recipes apply to it.
fn left(
    material: &str,
    recipes: &[String],
    predicted: &[PredictedRecipe],
    decision: &Decision,
) -> String {
    let drawn = decision.drawn();
    let original = drawn.iter().zip(recipes).find(|(_, r)| r.is_empty());
    let at = original.map(|(plan, _)| *plan);
    // The views in which it is drawn as written.
    let views = |i: &usize| Some(decision.views[*i].plan) == at;
    let tried = decision.plans.iter().filter(|p| {
        p.recipes.contains_key(material) && !matches!(p.verdict, Verdict::Broken { .. })
    });
    let best = tried
        .map(|p| (p, speedups(decision, p, &views)))
        .filter(|(_, all)| !all.is_empty())
        .max_by(|(_, a), (_, b)| a[0].0.median.total_cmp(&b[0].0.median));
    let Some((plan, all)) = best else {
        let least = predicted
            .iter()
            .min_by(|a, b| a.relative_time.total_cmp(&b.relative_time));
        return least.map_or("nothing else was measured".to_owned(), |p| {
            format!(
                "as written: nothing of it was among the runners-up; the best predicted, `{}`, \
                 takes {:.3} of the time of {}",
                p.recipe,
                p.relative_time,
                decision.part.as_deref().unwrap_or("the frame")
            )
        });
    };
    let (gain, gained) = &all[0];
    let loss = all.iter().rev().find(|(s, _)| s.high < 1.0);
    match loss {
        Some((loss, lost)) if gain.low > super::choose::WORTHWHILE => format!(
            "as written: `{}` gains at {gained}, {}, and loses at {lost}, {}",
            plan.name,
            ratio(gain),
            ratio(loss)
        ),
        None if gain.low > super::choose::WORTHWHILE => {
            let of = at.and_then(|at| beside(decision, at, gain, (gained, &views)));
            format!(
                "as written: the best {} that changes it, `{}`, is {} at {gained}; {}",
                how(decision),
                plan.name,
                ratio(gain),
                of.unwrap_or_else(|| "it is not known to pay in all views of a rule".to_owned())
            )
        }
        _ => format!(
            "as written: nothing {}{}. The best {}, `{}`, is {} at {gained}{}",
            match decision.clock {
                Some(_) => "pays",
                None => "is predicted to pay",
            },
            match original.is_some() && drawn.len() > 1 {
                true => " there",
                false => "",
            },
            how(decision),
            plan.name,
            ratio(gain),
            hidden(decision, &views)
        ),
    }
}

fn how(decision: &Decision) -> &'static str {
    match decision.clock {
        Some(_) => "tried",
        None => "by prediction",
    }
}

/// Why a plan is drawn in place of one that gains `gain`. `None`: the original is drawn, or it has no figure at that view.
fn beside(
    decision: &Decision,
    drawn: usize,
    gain: &Estimate,
    (at, views): (&str, &dyn Fn(&usize) -> bool),
) -> Option<String> {
    let plan = decision.plans.get(drawn).filter(|_| drawn > 0)?;
    let all = speedups(decision, plan, views);
    let (own, _) = all.iter().find(|(_, view)| view == at)?;
    let why = match gain.median <= own.median {
        true => "",
        false => ", and better over all views or in what it promises",
    };
    Some(format!(
        "`{}`, which is drawn, is {} there{why}",
        plan.name,
        ratio(own)
    ))
}

/// The most that hiding fragments could gain.
fn hidden(decision: &Decision, views: &dyn Fn(&usize) -> bool) -> String {
    let each = decision.views.iter().enumerate().filter(|(i, _)| views(i));
    let most = each.map(|(_, v)| v.overdraw).fold(0.0, f64::max);
    match most < 1.1 {
        true => format!(
            "; {most:.2} fragments are shaded for each that is seen, so that depth ahead has next \
             to nothing to hide"
        ),
        false => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use preshade_plan::contract::Contract;

    use super::*;
    use crate::jobs::made_up::adapter;
    use crate::measure::{Clock, View};
    use crate::search::plan::decision::{PlanView, SCHEMA, ViewReport};
    use crate::search::plan::model::Model;
    use crate::search::plan::policy::{Policy, Rule, RuleRange};
    use preshade_draw::scene::DrawOrder;

    fn about(median: f64) -> Estimate {
        Estimate {
            median,
            low: median - 0.002,
            high: median + 0.002,
        }
    }

    /// One view, and a plan of each name that changes these materials, the original first.
    fn decision(plans: &[(&str, &[&str], f64)], drawn: usize) -> Decision {
        let plan = |(name, materials, speedup): &(&str, &[&str], f64)| PlanReport {
            name: (*name).to_owned(),
            recipes: materials
                .iter()
                .map(|m| ((*m).to_owned(), "depth-prepass".to_owned()))
                .collect(),
            contract: Contract::exact(),
            verdict: Verdict::Holds,
            error: None,
            cost: None,
            notes: Vec::new(),
            by_view: vec![PlanView {
                predicted_ms: 1.0,
                time_ms: None,
                speedup: Some(about(*speedup)),
            }],
        };
        Decision {
            schema: SCHEMA.to_owned(),
            scene: String::new(),
            part: None,
            resolution: [1, 1],
            command: String::new(),
            adapter: adapter(""),
            clock: Some(Clock::WallClock),
            policy: Policy(vec![RuleRange {
                orders: vec![DrawOrder::AsGiven],
                rule: Rule::One { plan: drawn },
            }]),
            materials: Vec::new(),
            plans: plans.iter().map(plan).collect(),
            views: vec![ViewReport {
                again: None,
                view: View {
                    camera: "wall".to_owned(),
                    frame: 0,
                    order: DrawOrder::AsGiven,
                },
                shaded_per_pixel: 2.0,
                overdraw: 2.0,
                materials: Vec::new(),
                plan: drawn,
                alone: drawn,
                sorted: None,
                ahead: None,
            }],
            warnings: Vec::new(),
            switch_cost: Vec::new(),
            model: Model::nominal(),
        }
    }

    fn said(plans: &[(&str, &[&str], f64)], drawn: usize) -> String {
        let predicted = PredictedRecipe {
            recipe: "depth-prepass".to_owned(),
            relative_time: 0.9,
        };
        let recipes = [String::new()];
        of("a", &recipes, &[predicted], &decision(plans, drawn)).join("; ")
    }

    #[test]
    fn a_gain_is_not_said_to_be_none() {
        let original = ("original", &[][..], 1.0);
        let plans = |both: f64| {
            [
                original,
                ("B", &["b"][..], 1.41),
                ("A and B", &["a", "b"], both),
            ]
        };
        assert_eq!(
            said(&plans(1.4), 1),
            "as written: the best tried that changes it, `A and B`, is 1.400x [1.398, 1.402] at wall, \
             as given; `B`, which is drawn, is 1.410x [1.408, 1.412] there"
        );
        assert!(
            said(&plans(1.415), 1).ends_with("and better over all views or in what it promises")
        );
        let none = said(&[original, ("A", &["a"], 1.001)], 0);
        assert!(
            none.starts_with("as written: nothing pays. The best tried, `A`"),
            "{none}"
        );
        let unknown = said(&[original, ("A", &["a"], 1.2)], 0);
        assert!(
            unknown.ends_with("it is not known to pay in all views of a rule"),
            "{unknown}"
        );
    }
}
