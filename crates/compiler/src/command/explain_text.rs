//! The report of `explain`, in ten lines or in full.

use preshade_plan::pass::{Bound, Frequency, Left, Refusal};
use preshade_plan::plan::{Plan, SiteCost};

use super::explain::{EffectUse, Explained, PassExplained, Saved, VersionExplained, WORTH_A_LOOK};
use super::refusal;

const MOST_PASSES: usize = 4;
/// Most effects, and most values, on their lines.
const MOST_NAMED: usize = 3;

/// A possible change: the recipe step, its description, and the saved cost.
struct Offer<'e> {
    step: &'e str,
    what: &'e str,
    saved: Option<&'e Saved>,
    /// Whether nothing is known yet about its error.
    is_approximate: bool,
    /// The number of versions, one for each group of draws. This offer is the version that saves
    /// most. 0: the change is for all draws.
    versions: usize,
}

impl<'e> Offer<'e> {
    /// `None`: the pass does not apply, not even within a budget.
    fn of(pass: &'e PassExplained) -> Option<Self> {
        let own = pass.sites.first().map(|change| Self {
            step: &pass.pass,
            what: &change.what,
            saved: pass.saved.as_ref(),
            is_approximate: false,
            versions: 0,
        });
        let within = || {
            let of = pass.within_budget.as_ref()?;
            Some(Self {
                step: &of.step,
                what: &of.change.what,
                saved: of.saved.as_ref(),
                is_approximate: true,
                versions: 0,
            })
        };
        let versions = || {
            let share = |v: &&VersionExplained| v.saved.as_ref().map_or(0.0, Saved::share);
            let all = pass.versions.iter();
            let best = all.max_by(|a, b| share(a).total_cmp(&share(b)))?;
            Some(Self {
                step: &pass.pass,
                what: &best.change.what,
                saved: best.saved.as_ref(),
                is_approximate: false,
                versions: pass.versions.len(),
            })
        };
        own.or_else(within).or_else(versions)
    }

    fn is_small(&self) -> bool {
        self.saved.is_some_and(Saved::is_small)
    }

    fn share(&self) -> f64 {
        self.saved.map_or(0.0, Saved::share)
    }
}

/// The step that saves the largest share of a stage, leaving out the passes in `drawn`; with the
/// saved cost and the share. `None`: none saves enough to be worth a look.
pub fn largest(explained: &Explained, drawn: &[&str]) -> Option<(String, f64)> {
    let passes = explained.passes.iter();
    let offers = passes.filter(|p| !drawn.contains(&p.pass.as_str()));
    let offers = offers.filter_map(Offer::of).filter(|o| !o.is_small());
    let best = offers.max_by(|a, b| a.share().total_cmp(&b.share()))?;
    let saved = best.saved?;
    Some((format!("{}, which {saved}", best.step), saved.share()))
}

/// At most ten lines: the steps that apply, and the cost that they save.
pub fn brief(explained: &Explained) -> String {
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
    let all = explained.passes.iter().filter_map(Offer::of);
    let (small, mut offers): (Vec<_>, Vec<_>) = all.partition(Offer::is_small);
    offers.sort_by(|a, b| b.share().total_cmp(&a.share()));
    let widest = offers.iter().take(MOST_PASSES).map(|o| o.step.len());
    let widest = widest.max().unwrap_or(0);
    lines.extend(offers.iter().take(MOST_PASSES).map(|offer| {
        let step = offer.step;
        let open = match (offer.is_approximate, offer.versions) {
            (true, _) => "; `verify` measures whether its error is within the budget".to_owned(),
            (false, 0) => String::new(),
            (false, n) => format!(": the most of {n} versions, one for each group of draws"),
        };
        match offer.saved {
            Some(saved) => format!("  {step:<widest$}  {saved}{open}"),
            None => format!("  {step:<widest$}  {}{open}", first_part(offer.what)),
        }
    }));
    let more = offers.iter().skip(MOST_PASSES);
    lines.extend(listed("applies too", more.map(|o| o.step.to_owned())));
    lines.extend(listed(
        &format!("saves less than {:.0} %", WORTH_A_LOOK * 100.0),
        small.iter().map(|o| o.step.to_owned()),
    ));
    let refused = explained.passes.iter().filter(|p| Offer::of(p).is_none());
    let refused = refused.map(|p| {
        let code = p.refusals.first().map_or("", |r| r.code.as_str());
        format!("{} ({code})", p.pass)
    });
    lines.extend(listed("does not apply", refused));
    let effects = explained.effects.iter().take(MOST_NAMED);
    lines.extend(listed(
        "effects that the draws decide",
        effects.map(|e| format!("{} ({:.0} ops, {})", e.name, e.cost, e.called_for_by())),
    ));
    let switches = explained.switches.iter().take(MOST_NAMED);
    lines.extend(listed(
        "`specialize` removes, where a value switches it off",
        switches.map(|e| format!("{} ({:.0} ops of the {} stage)", e.name, e.cost, e.stage)),
    ));
    let values = explained.frequencies.iter().filter(|f| f.is_finite());
    lines.extend(listed(
        "values and their error if interpolated",
        values.take(MOST_NAMED).map(value),
    ));
    lines.push(String::new());
    lines.join("\n")
}

/// The first part of a description in several, which are separated by semicolons.
fn first_part(text: &str) -> &str {
    text.split("; ").next().unwrap_or(text)
}

fn listed(what: &str, names: impl Iterator<Item = String>) -> Option<String> {
    let names: Vec<String> = names.collect();
    (!names.is_empty()).then(|| format!("  {what}: {}", names.join(", ")))
}

fn value(f: &Frequency) -> String {
    format!("`{}` ({:.0} ops, FLIP {:.5})", f.name, f.cost, f.flip_mean)
}

/// The cost of a site's slice and of its source. A pass that runs a stage several times costs more
/// than its source.
fn cost(of: SiteCost) -> String {
    let between = match of.slice > of.whole {
        true => "in place of",
        false => "of",
    };
    format!("{:.0} {between} {:.0} ops", of.slice, of.whole)
}

/// The report in full.
pub fn all(explained: &Explained, plan: &Plan) -> String {
    let mut lines = vec![format!("material {}", explained.material)];
    for s in &explained.stages {
        let effects = if s.effects.is_empty() {
            String::new()
        } else {
            format!("; {}", s.effects.join(", "))
        };
        lines.push(format!(
            "  {} `{}`: static cost {:.0} ops, {} expressions{effects}",
            s.stage, s.entry_point, s.cost, s.expressions
        ));
    }
    lines.extend(effect_table(&explained.effects));
    lines.extend(explained.switches.iter().map(|e| {
        let (name, cost, stage) = (&e.name, e.cost, &e.stage);
        format!(
            "  `{name}`, where a value switches it off: {cost:.0} ops less of the {stage} stage"
        )
    }));
    for p in &explained.passes {
        lines.push(format!("\n{}\n  {}", p.pass, p.summary));
        if let Some(saved) = p.saved.as_ref().filter(|s| s.is_small()) {
            lines.push(format!("  not worth it: {saved}"));
        }
        for site in &p.sites {
            lines.push(format!(
                "  applies to `{}`: {}\n    static cost {}{}\n    hurts {}",
                site.key.entry_point,
                site.what,
                cost(site.cost),
                // A stage that needs no slice has dashes for its half of the hash.
                match site.key.slice.trim_matches('-') {
                    "" => String::new(),
                    slice => format!("; site {slice}"),
                },
                p.hurts
            ));
        }
        for r in &p.refusals {
            lines.push(indent(&refusal::rendered(&without_explain(r), plan)));
        }
        if !p.versions.is_empty() {
            lines.push(
                "  but with a version for each group of draws, which `rewrite` writes:".to_owned(),
            );
        }
        lines.extend(p.versions.iter().map(|version| {
            let saved = version.saved.as_ref();
            let saved = saved.map_or_else(|| version.change.what.clone(), Saved::to_string);
            format!("    `{}` {saved}", version.material)
        }));
        if let Some(within) = &p.within_budget {
            lines.push(format!("  with {}: {}", within.step, within.change.what));
        }
        lines.extend(left(&p.left));
        lines.push(format!("  source: {}", p.source));
    }
    lines.extend(frequency_table(&explained.frequencies));
    lines.push(String::new());
    lines.join("\n")
}

/// The values that might be interpolated.
fn frequency_table(frequencies: &[Frequency]) -> Vec<String> {
    if frequencies.is_empty() {
        return Vec::new();
    }
    let mut lines = vec![
        "\nvalues that might be interpolated, by error against saved cost; \
         off by: how far the value itself is from its interpolation on\n\
         the scene's triangles (NaN: somewhere it is NaN or infinite); \
         at most: the same, proved with an adapter's roundings for the frames\n\
         looked at, two a camera (*: for a part of the triangles)\n  \
         saved ops  FLIP mean   max abs  NaN px  off by  at most    range  value"
            .to_owned(),
    ];
    for f in frequencies {
        let place = f.location.as_ref().map_or(String::new(), |l| {
            format!(" ({}:{}:{})", l.file, l.line, l.column)
        });
        let (off, range) = f
            .interpolation
            .as_ref()
            .map_or(("-".to_owned(), "-".to_owned()), |i| {
                let off = match i.not_finite {
                    0 => short(i.max),
                    _ => "NaN".to_owned(),
                };
                (off, short(i.range))
            });
        let bound = match &f.bound {
            Some(Bound::Proved {
                max,
                roundings,
                triangles,
                of,
                ..
            }) => {
                let part = if triangles < of { "*" } else { "" };
                format!("{}{part}", short(max + roundings))
            }
            Some(Bound::Unbounded { .. }) => "unbounded".to_owned(),
            None => "-".to_owned(),
        };
        lines.push(format!(
            "  {:>9.0}  {:>9.6}  {:>8.4}  {:>6}  {off:>6}  {bound:>9}  {range:>6}  `{}`{place}",
            f.cost, f.flip_mean, f.max_abs, f.nan_pixels, f.name
        ));
    }
    lines
}

/// Which effects the draws of a material call for.
fn effect_table(effects: &[EffectUse]) -> Vec<String> {
    if effects.is_empty() {
        return Vec::new();
    }
    let widest = effects.iter().map(|e| e.name.len()).max().unwrap_or(0);
    let mut lines = vec![format!(
        "\neffects that the draws decide, by static cost\n  {:<widest$}  {:<8}  {:>6}  {:<16}  \
         evidence",
        "effect", "stage", "ops", "called for"
    )];
    for e in effects {
        let (called_for, evidence) = (e.called_for_by(), e.evidence_said());
        lines.push(format!(
            "  {:<widest$}  {:<8}  {:>6.0}  {called_for:<16}  {evidence}",
            e.name, e.stage, e.cost
        ));
    }
    lines
}

/// A number in four digits or so.
fn short(number: f64) -> String {
    match number.abs() {
        0.0 => "0".to_owned(),
        1e-3..1e4 => format!("{number:.4}").chars().take(6).collect(),
        _ => format!("{number:.0e}"),
    }
}

/// Most values to list as not hoisted, the most expensive first.
const MOST_LEFT: usize = 8;

/// The values that a pass did not move, one a line.
fn left(left: &[Left]) -> Vec<String> {
    let mut lines: Vec<String> = left
        .iter()
        .take(MOST_LEFT)
        .map(|l| {
            let line = l
                .location
                .as_ref()
                .map_or(String::new(), |l| format!("line {}, ", l.line));
            format!(
                "  `{}` ({line}{:.0} ops) is unchanged: {}",
                l.name, l.cost, l.reason
            )
        })
        .collect();
    if left.len() > MOST_LEFT {
        lines.push(format!(
            "  and {} more stay (--format json lists them)",
            left.len() - MOST_LEFT
        ));
    }
    lines
}

fn indent(text: &str) -> String {
    text.lines()
        .map(|l| format!("  {l}"))
        .collect::<Vec<_>>()
        .join("\n")
}

/// The refusal without advice to run `explain`, which is running.
fn without_explain(refusal: &Refusal) -> Refusal {
    let (kept, _) = refusal
        .remedy
        .split_once("`preshade explain` lists")
        .unwrap_or((&refusal.remedy, ""));
    Refusal {
        remedy: kept.trim_end_matches([';', ' ']).to_owned(),
        ..refusal.clone()
    }
}
