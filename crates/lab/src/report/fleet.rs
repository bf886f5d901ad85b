//! Decisions over many adapters, for a terminal and for a spreadsheet.

use std::collections::BTreeMap;

use super::frontier::{self, speedup};
use super::grid::{self, Csv, number, quoted};
use super::html::promise;
use crate::jobs::FleetAdapter;
use crate::jobs::Standing;
use crate::jobs::decision::{
    FleetDecision, FleetDecisions, FleetFate, FleetFrontier, FleetFrontiers, FleetPoint,
    FleetVariant, OnAdapter,
};
use crate::measure::error::counted;

/// Most runners-up to print.
const SHOWN: usize = 5;

/// A decision as lines of text.
pub fn decision(of: &FleetDecision) -> String {
    let count = of.adapters.len();
    let summary = |v: &FleetVariant| {
        let is_timed = |a: &&OnAdapter| a.speedup.is_some() && of.adapters.contains(&a.adapter);
        let left = match count - v.adapters.iter().filter(is_timed).count() {
            0 => String::new(),
            left if left == count => return format!("{}: not timed", v.variant),
            left => format!(", not timed on {left}"),
        };
        format!(
            "{}: pays on {} of {count}, {:.2}x on average{left}",
            v.variant, v.pays, v.speedup
        )
    };
    let mut lines = vec![titled(&of.input, &of.arguments)];
    let chosen = |v: &&FleetVariant| Some(&v.variant) == of.choice.as_ref();
    match of.variants.iter().find(chosen) {
        None => lines.push(format!(
            "  Nothing pays on more than half of {}: draw every material as it is written.",
            counted(count as u64, "adapter")
        )),
        Some(v) => {
            lines.push(format!("  draw with {}", summary(v)));
            let promised = v.contract.as_ref().map(promise).unwrap_or_default();
            lines.push(format!(
                "  promise: {promised}; holds on {} of {}",
                v.holds, v.drawn
            ));
            let others = v.adapters.iter().filter(|a| !a.pays);
            let others = others.filter(|a| of.adapters.contains(&a.adapter));
            lines.extend(others.map(|a| format!("  does not pay on {}", on_adapter(a))));
            for name in &of.adapters {
                if !v.adapters.iter().any(|a| a.adapter == *name) {
                    lines.push(format!("  does not pay on {name}: not timed"));
                }
            }
        }
    }
    let may = of.variants.iter().filter(|v| v.may_be_chosen());
    let others: Vec<&FleetVariant> = may.filter(|v| !chosen(v)).collect();
    if !others.is_empty() {
        lines.push("  others:".to_owned());
        let shown = others.iter().take(SHOWN);
        lines.extend(shown.map(|v| format!("    {}", summary(v))));
    }
    if others.len() > SHOWN {
        lines.push(format!("    and {} more", others.len() - SHOWN));
    }
    let mut by_choice: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for a in &of.by_adapter {
        let choice = a.choice.as_deref().unwrap_or("as it is written");
        let with = a.speedup.map_or(String::new(), |s| format!(" {s:.2}x"));
        let adapters = by_choice.entry(choice).or_default();
        adapters.push(format!("{}{with}", a.adapter));
    }
    lines.push("  best for each adapter alone:".to_owned());
    let each = by_choice.iter();
    lines.extend(each.map(|(choice, on)| format!("    {choice}: {}", on.join(", "))));
    for v in of.variants.iter().filter(|v| v.is_broken()) {
        let broken = v.adapters.iter().filter(|a| a.standing == Standing::Broken);
        lines.extend(broken.map(|a| {
            format!(
                "  ! {} broke its promise on {}, and is not chosen: {}",
                v.variant, a.adapter, a.why
            )
        }));
    }
    lines.join("\n")
}

fn titled(input: &[String], arguments: &[String]) -> String {
    let input = input.join(" ");
    match arguments {
        [] => input,
        with => format!("{input} ({})", with.join(" ")),
    }
}

fn on_adapter(a: &OnAdapter) -> String {
    let mut told: Vec<String> = a.runs.iter().copied().map(speedup).collect();
    if a.slower {
        told.push("slower".to_owned());
    }
    told.extend(a.not_timed.iter().map(|why| format!("not timed: {why}")));
    if a.runs.is_empty() && a.not_timed.is_empty() {
        told.push("not timed".to_owned());
    }
    if a.standing != Standing::Holds {
        told.push(format!("{}: {}", a.standing.word(), a.why));
    }
    format!("{}: {}", a.adapter, told.join(", "))
}

/// One line an input, variant and adapter.
pub fn decisions_csv(of: &FleetDecisions) -> String {
    let mut csv = Csv::new(
        "input,variant,chosen,pays_on,of,mean_speedup,adapter,chosen_alone,verdict,pays,slower,\
         speedup",
    );
    for d in &of.decisions {
        for v in &d.variants {
            for a in &v.adapters {
                let alone = d.by_adapter.iter().any(|best| {
                    best.adapter == a.adapter && best.choice.as_ref() == Some(&v.variant)
                });
                csv.line([
                    quoted(&titled(&d.input, &d.arguments)),
                    quoted(&v.variant),
                    (d.choice.as_ref() == Some(&v.variant)).to_string(),
                    v.pays.to_string(),
                    d.adapters.len().to_string(),
                    v.speedup.to_string(),
                    quoted(&a.adapter),
                    alone.to_string(),
                    a.standing.word().to_owned(),
                    a.pays.to_string(),
                    a.slower.to_string(),
                    number(a.speedup),
                ]);
            }
        }
    }
    csv.text()
}

/// A frontier as lines of text.
pub fn frontier(of: &FleetFrontier) -> String {
    let metric = of.metric.to_string();
    let mut rows = vec![grid::row([
        format!("{metric:>9}"),
        format!("{:>8}", "speedup"),
        format!("{:>14}", "least to most"),
        format!("{:>6}", "timed"),
        "recipe".to_owned(),
    ])];
    let on = |p: &&FleetPoint| p.fate == FleetFate::Frontier;
    rows.extend(of.points.iter().filter(on).map(|p| {
        let [least, most] = p.range.unwrap_or_default();
        grid::row([
            p.error.map_or(String::new(), frontier::number),
            p.speedup.map_or(String::new(), |s| format!("{s:.2}x")),
            format!("{least:.2} to {most:.2}"),
            p.timed.to_string(),
            p.variant.clone(),
        ])
    }));
    let others = of.points.iter().filter(|p| !on(p));
    let others: Vec<String> = others
        .map(|p| format!("{}: {}", p.variant, fate(&p.fate)))
        .collect();
    let text = format!(
        "{}, {}: {}\n\n{}\n{}",
        titled(&of.input, &of.arguments),
        counted(of.adapters.len() as u64, "adapter"),
        of.adapters.join(", "),
        grid::aligned(&rows, |c| c == 4, false),
        others.join("\n")
    );
    text.trim_end().to_owned()
}

/// The fate in words.
pub(crate) fn fate(fate: &FleetFate) -> String {
    match fate {
        FleetFate::Frontier => "on the frontier".to_owned(),
        FleetFate::Beaten { by } => format!("beaten by {by}"),
        FleetFate::BeyondBudget => "beyond the budget".to_owned(),
        FleetFate::Broken { adapter, r#where } => format!("broken on {adapter}: {where}"),
        FleetFate::NotMeasured => "not measured".to_owned(),
    }
}

/// One line an input and variant.
pub fn frontiers_csv(of: &FleetFrontiers) -> String {
    let mut csv = Csv::new("input,variant,metric,error,speedup,least,most,timed,fate");
    for f in &of.frontiers {
        for p in &f.points {
            csv.line([
                quoted(&titled(&f.input, &f.arguments)),
                quoted(&p.variant),
                f.metric.to_string(),
                number(p.error),
                number(p.speedup),
                number(p.range.map(|r| r[0])),
                number(p.range.map(|r| r[1])),
                p.timed.to_string(),
                quoted(&fate(&p.fate)),
            ]);
        }
    }
    csv.text()
}

const COLUMNS: [&str; 8] = [
    "adapter", "driver", "backend", "machines", "cards", "pictures", "times", "failed",
];

fn cells(of: &FleetAdapter) -> [String; 8] {
    let machines: Vec<&str> = of.machines.iter().map(String::as_str).collect();
    [
        of.adapter.title(),
        of.adapter.driver.clone(),
        of.adapter.backend.clone(),
        machines.join(" "),
        of.cards.to_string(),
        of.pictures.to_string(),
        of.times.to_string(),
        of.failed.to_string(),
    ]
}

/// The adapters of a fleet as a table.
pub fn adapters(of: &[FleetAdapter]) -> String {
    let mut rows = vec![grid::row(COLUMNS)];
    rows.extend(of.iter().map(|a| grid::row(cells(a))));
    let table = grid::aligned(&rows, |_| true, false);
    table.trim_end().to_owned()
}

/// The same for a spreadsheet.
pub fn adapters_csv(of: &[FleetAdapter]) -> String {
    let mut csv = Csv::new(&COLUMNS.join(","));
    for adapter in of {
        csv.line(cells(adapter).map(|cell| quoted(&cell)));
    }
    csv.text()
}
