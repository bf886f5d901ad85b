//! A material in at most ten lines: what applies, what it saves, and what to type for the rest.

use preshade::unstable::passes::pass::Frequency;

use crate::explain::{Explained, PassExplained, SMALL, Saved};

/// Most passes to list.
const MOST_PASSES: usize = 5;
/// Most effects, and most values, on their lines.
const MOST_NAMED: usize = 3;

/// What a pass offers: the recipe step, the description of the change, and what it saves.
struct Offer<'e> {
    step: &'e str,
    what: &'e str,
    saved: Option<&'e Saved>,
}

impl<'e> Offer<'e> {
    /// `None`: the pass does not apply, or saves next to nothing.
    fn of(pass: &'e PassExplained) -> Option<Self> {
        let own = pass.sites.first().map(|change| Self {
            step: &pass.pass,
            what: &change.what,
            saved: pass.saved.as_ref(),
        });
        let within = || {
            let of = pass.within_budget.as_ref()?;
            Some(Self {
                step: &of.step,
                what: &of.change.what,
                saved: of.saved.as_ref(),
            })
        };
        own.or_else(within)
            .filter(|o| !o.saved.is_some_and(Saved::is_small))
    }

    fn share(&self) -> f64 {
        self.saved.map_or(0.0, Saved::share)
    }
}

/// The lines.
pub fn print(explained: &Explained) -> String {
    let stages: Vec<String> = explained
        .stages
        .iter()
        .map(|s| {
            let effects = match s.effects.is_empty() {
                true => String::new(),
                false => format!(" ({})", s.effects.join(", ")),
            };
            format!("{} `{}` {:.0} ops{effects}", s.stage, s.entry_point, s.cost)
        })
        .collect();
    let mut lines = vec![format!(
        "material {}: {}",
        explained.material,
        stages.join(", ")
    )];
    let mut offers: Vec<Offer<'_>> = explained.passes.iter().filter_map(Offer::of).collect();
    offers.sort_by(|a, b| b.share().total_cmp(&a.share()));
    let widest = offers.iter().take(MOST_PASSES).map(|o| o.step.len());
    let widest = widest.max().unwrap_or(0);
    lines.extend(offers.iter().take(MOST_PASSES).map(|offer| {
        let step = offer.step;
        match offer.saved {
            Some(saved) => format!("  {step:<widest$}  {saved}"),
            None => format!("  {step:<widest$}  {}", shortened(offer.what)),
        }
    }));
    let more: Vec<&str> = offers.iter().skip(MOST_PASSES).map(|o| o.step).collect();
    lines.extend(listed("applies too", &more));
    let small: Vec<&str> = explained
        .passes
        .iter()
        .filter(|p| p.saved.as_ref().is_some_and(Saved::is_small))
        .map(|p| p.pass.as_str())
        .collect();
    lines.extend(listed(
        &format!("saves less than {:.0} %", SMALL * 100.0),
        &small,
    ));
    let refused: Vec<String> = explained
        .passes
        .iter()
        .filter(|p| p.sites.is_empty() && p.within_budget.is_none())
        .map(|p| {
            let code = p.refusals.first().map_or("", |r| r.code.as_str());
            format!("{} ({code})", p.pass)
        })
        .collect();
    let refused: Vec<&str> = refused.iter().map(String::as_str).collect();
    lines.extend(listed("does not apply", &refused));
    let effects = explained.effects.iter().take(MOST_NAMED);
    let effects: Vec<String> = effects
        .map(|e| format!("{} ({:.0} ops, {})", e.name, e.cost, e.called_for_by()))
        .collect();
    let effects: Vec<&str> = effects.iter().map(String::as_str).collect();
    lines.extend(listed("effects that the draws decide", &effects));
    let switches = explained.switches.iter().take(MOST_NAMED);
    let switches: Vec<String> = switches
        .map(|e| format!("{} ({:.0} ops of the {} stage)", e.name, e.cost, e.stage))
        .collect();
    let switches: Vec<&str> = switches.iter().map(String::as_str).collect();
    lines.extend(listed(
        "`specialize` removes, where a value switches it off",
        &switches,
    ));
    let values = explained.frequencies.iter().filter(|f| f.is_finite());
    let values: Vec<String> = values.take(MOST_NAMED).map(value).collect();
    let values: Vec<&str> = values.iter().map(String::as_str).collect();
    lines.extend(listed("values and their error if interpolated", &values));
    lines.push(String::new());
    lines.join("\n")
}

/// Longest description, in characters.
const LONGEST: usize = 100;

fn shortened(text: &str) -> String {
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}..", text[..end].trim_end()),
        None => text.to_owned(),
    }
}

fn listed(what: &str, names: &[&str]) -> Option<String> {
    (!names.is_empty()).then(|| format!("  {what}: {}", names.join(", ")))
}

fn value(f: &Frequency) -> String {
    format!("`{}` ({:.0} ops, FLIP {:.5})", f.name, f.cost, f.flip_mean)
}
