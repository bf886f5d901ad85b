//! Measures the chosen plans once more: the largest of many noisy gains is larger than its plan's.

use super::PlanError;
use super::assign::Considered;
use super::choose::WORTHWHILE;
use super::policy::{Policy, Rule, RuleRange};
use super::scene::{Measured, Scouted, Settings};
use super::stage::{self, Runner};
use crate::measure::{Estimate, Session, bench};
use preshade_draw::scene::DrawOrder;

/// The most that two measurements of the original differ by on an idle machine.
const IDLE: f64 = 1.05;

/// By how much the original differs from itself, as a factor of at least 1.
pub(super) fn apart(again: &Estimate) -> f64 {
    again.median.max(1.0 / again.median.max(f64::MIN_POSITIVE))
}

/// Measures the plans of `policy` against the original, and the original against itself, in every
/// view. Replaces the search's measurements of them. Returns the original against itself by view.
pub(super) fn confirm(
    session: &Session<'_>,
    scouted: &Scouted,
    settings: &Settings<'_>,
    frames: &[Considered],
    policy: &Policy,
    measured: &mut Measured,
) -> Result<Vec<Option<Estimate>>, PlanError> {
    let drawn: Vec<usize> = policy.plans().into_iter().filter(|p| *p != 0).collect();
    if drawn.is_empty() {
        return Ok(Vec::new());
    }
    let mut lot = Vec::new();
    for plan in [0, 0].iter().chain(&drawn) {
        lot.push(Runner::new(session, &scouted.choices, &frames[*plan])?);
    }
    let mut again = Vec::new();
    for (i, (view, frame)) in scouted.views.iter().enumerate() {
        stage::compare(session, &mut lot, (view, frame))?;
        let at = (view, frame);
        let (_, timings) = bench::race(session, &mut lot, at, &settings.timing, |_| {})?;
        let mut timings = timings.into_iter().skip(1);
        again.push(timings.next().flatten().map(|t| t.speedup));
        for (plan, timing) in drawn.iter().zip(timings) {
            measured.times[*plan][i] = timing.as_ref().map(|t| t.time.estimate);
            measured.table.rows[*plan][i] = timing.map(|t| t.speedup);
        }
    }
    Ok(again)
}

/// The policy. If a plan of it gains in no view more than the original differs from itself by, the
/// original. Adds the reasons to `warnings`.
pub(super) fn held(
    policy: Policy,
    (scouted, frames): (&Scouted, &[Considered]),
    (measured, again): (&Measured, &[Option<Estimate>]),
    warnings: &mut Vec<String>,
) -> Policy {
    let factor = |view: usize| {
        again
            .get(view)
            .copied()
            .flatten()
            .map_or(1.0, |a| apart(&a))
    };
    let views = || scouted.views.iter().enumerate();
    let busiest = views().max_by(|a, b| factor(a.0).total_cmp(&factor(b.0)));
    if let Some((i, (view, _))) = busiest.filter(|(i, _)| factor(*i) > IDLE) {
        warnings.push(format!(
            "this machine is busy: the original differs from itself by {:.0} % in {view}",
            (factor(i) - 1.0) * 100.0
        ));
    }
    let gains = |plan: usize| {
        views().any(|(i, _)| {
            let fresh = measured.table.rows[plan][i];
            fresh.is_some_and(|s| s.low > WORTHWHILE.max(factor(i)))
        })
    };
    let drawn = policy.plans().into_iter().filter(|p| *p != 0);
    let lost: Vec<usize> = drawn.filter(|plan| !gains(*plan)).collect();
    if lost.is_empty() {
        return policy;
    }
    for plan in lost {
        warnings.push(format!(
            "`{}` was the fastest of those tried, but measured again it gains no more than the original \
             differs from itself by: draw as written, or measure again on an idle machine",
            frames[plan].assignment.name(&scouted.choices)
        ));
    }
    let mut orders: Vec<DrawOrder> = Vec::new();
    for held in &policy.0 {
        orders.extend(
            held.orders
                .iter()
                .filter(|o| !orders.contains(o))
                .copied()
                .collect::<Vec<_>>(),
        );
    }
    Policy(vec![RuleRange {
        orders,
        rule: Rule::One { plan: 0 },
    }])
}
