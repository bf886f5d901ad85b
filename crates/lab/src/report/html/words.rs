//! Contracts and verdicts in words.

use preshade_plan::contract::{Contract, Verdict};

use crate::measure::record::SelfTestReport;
use crate::measure::{Clock, ErrorLadder, Estimate};
use preshade_draw::render::{AdapterReport, SelfTestResult};

pub fn contract(contract: &Contract) -> String {
    let promise = match contract {
        Contract::Exact { .. } => "the same bits".to_owned(),
        Contract::Rounding { k, turned, .. } => match turned {
            None => format!("within {k} roundings"),
            Some(turned) => format!("within {k} roundings, {turned}"),
        },
        Contract::Approximate { .. } | Contract::Budgets { .. } => {
            let budgets: Vec<String> = contract.budgets().iter().map(ToString::to_string).collect();
            budgets.join(", ")
        }
    };
    let given: Vec<String> = contract
        .given()
        .iter()
        .filter_map(|a| Some(serde_json::to_value(a).ok()?.as_str()?.to_owned()))
        .collect();
    match given.is_empty() {
        true => promise,
        false => format!("{promise}, given {}", given.join(", ")),
    }
}

/// Text as HTML: escaped, with code between backticks.
pub(crate) fn marked(text: &str) -> String {
    let parts: Vec<String> = text.split('`').map(escaped).collect();
    // A backtick too many is a backtick.
    if parts.len().is_multiple_of(2) {
        return parts.join("`");
    }
    let each = parts.iter().enumerate();
    each.map(|(i, part)| match i % 2 {
        0 => part.clone(),
        _ => format!("<code>{part}</code>"),
    })
    .collect()
}

fn escaped(text: &str) -> String {
    text.chars()
        .fold(String::with_capacity(text.len()), |mut out, c| {
            match c {
                '&' => out.push_str("&amp;"),
                '<' => out.push_str("&lt;"),
                '>' => out.push_str("&gt;"),
                '"' => out.push_str("&quot;"),
                '\'' => out.push_str("&#39;"),
                c => out.push(c),
            }
            out
        })
}

pub(crate) fn verdict(verdict: &Verdict) -> String {
    match verdict {
        Verdict::Holds => "holds in every view".to_owned(),
        Verdict::Broken { r#where } => format!("broken: {where}"),
        Verdict::NotMeasured { why } => format!("not measured: {why}"),
    }
}

pub(crate) fn self_test(test: &SelfTestReport) -> String {
    let material = &test.material;
    match &test.result {
        SelfTestResult::Held { samples } => format!("{material}: held, {samples} samples laid"),
        SelfTestResult::Failed {
            failure, camera, ..
        } => {
            let fallback = test.fallback.as_deref().unwrap_or("original");
            format!(
                "{material}: failed in camera {camera}: {failure}; a host falls back to {fallback}"
            )
        }
        SelfTestResult::NotRun { why } => format!("{material}: says nothing: {why}"),
    }
}

pub(crate) fn adapter(adapter: &AdapterReport) -> String {
    format!(
        "{} ({}, {}, {})",
        adapter.title(),
        adapter.backend,
        adapter.kind,
        adapter.driver
    )
}

/// The clock of the times, in words.
pub(crate) fn clock(clock: Option<Clock>) -> &'static str {
    match clock {
        Some(Clock::GpuTimestamps) => "Timed by the GPU's own clock.",
        Some(Clock::WallClock) => "Timed by the wall clock.",
        None => "Nothing was timed.",
    }
}

/// The sign for an unknown value.
pub(crate) const DASH: &str = "–";

/// A time in milliseconds, with its interval.
pub(crate) fn ms(time: &Estimate) -> String {
    format!("{:.3} [{:.3}, {:.3}]", time.median, time.low, time.high)
}

/// A difference in a few words.
pub(crate) fn error(error: &ErrorLadder) -> String {
    let mut told = match error.changed_pixels {
        0 => "no pixel differs".to_owned(),
        n => format!(
            "{n} pixels differ, by {:.4} at most, mean FLIP {:.5}",
            error.max_abs, error.flip_mean
        ),
    };
    for (n, what) in [
        (error.changed_depth, "depths differ"),
        (error.nan_pixels, "pixels are not finite"),
    ] {
        if n > 0 {
            told.push_str(&format!(", {n} {what}"));
        }
    }
    told
}

/// The text of an option, or a dash.
pub(crate) fn or_dash<T>(value: Option<T>, said: impl FnOnce(T) -> String) -> String {
    value.map_or_else(|| DASH.to_owned(), said)
}

#[cfg(test)]
mod tests {
    use super::marked;

    #[test]
    fn what_stands_between_backticks_is_code_and_nothing_is_markup() {
        assert_eq!(marked("as `a<b>`, so"), "as <code>a&lt;b&gt;</code>, so");
        assert_eq!(marked("a ` b"), "a ` b");
        assert_eq!(marked("<img src='x'>"), "&lt;img src=&#39;x&#39;&gt;");
    }
}
