//! Merged results: each variant of each input on each adapter, the failed jobs, and the regret of `plan`.

use askama::Template;

use super::{Gallery, PageError, Shell, words};
use crate::jobs::{AdapterResult, Answer, Kind, Reason, Results, Standing};
use crate::measure::error::counted;
use crate::report::control_characters::plain;
use crate::report::frontier;
use crate::report::merged::holds_and_pays;
use crate::search::plan::RegretReport;
use preshade_draw::render::AdapterReport;

#[derive(Template)]
#[template(path = "html/merged.html")]
struct Page<'a> {
    shell: Shell,
    adapters: Vec<&'a AdapterReport>,
    inputs: Vec<Input<'a>>,
    failed: Vec<[String; 4]>,
    regrets: Vec<Regret>,
}

/// An input with its variants.
struct Input<'a> {
    title: String,
    rows: Vec<Row<'a>>,
}

struct Row<'a> {
    variant: &'a str,
    counted: String,
    cells: Vec<Cell<'a>>,
}

/// The result of an adapter for it.
#[derive(Default)]
struct Cell<'a> {
    word: &'static str,
    why: &'a str,
    times: Vec<String>,
    class: &'static str,
}

/// The regret on an adapter.
struct Regret {
    title: String,
    rows: Vec<[String; 9]>,
    text: String,
}

pub fn page(
    results: &Results,
    regrets: &[RegretReport],
    command: &str,
) -> Result<String, PageError> {
    let rows = results.rows();
    let mut adapters: Vec<(&String, &AdapterReport)> = results.adapters.iter().collect();
    adapters.sort_by_key(|(_, a)| (&a.name, &a.driver, &a.backend));
    let inputs: Vec<Input<'_>> = rows
        .iter()
        .map(|(subject, variants)| Input {
            title: subject.title(&rows),
            rows: variants
                .iter()
                .map(|(variant, said)| Row {
                    variant,
                    counted: holds_and_pays(said),
                    cells: adapters
                        .iter()
                        .map(|(id, _)| said.get(id.as_str()).map(cell).unwrap_or_default())
                        .collect(),
                })
                .collect(),
        })
        .collect();
    let variants: usize = inputs.iter().map(|i| i.rows.len()).sum();
    let failed = failed(results);
    let versions: Vec<&str> = results.versions.iter().map(String::as_str).collect();
    let page = Page {
        shell: Shell {
            title: "Merged results".to_owned(),
            headline: format!(
                "{} of {} on {}",
                counted(variants as u64, "variant"),
                counted(inputs.len() as u64, "input"),
                counted(results.adapters.len() as u64, "adapter")
            ),
            about: format!(
                "preshade {}. {} without a report.",
                versions.join(", "),
                counted(failed.len() as u64, "job")
            ),
            said: Vec::new(),
            command: command.to_owned(),
            file: "results.json",
            // With many adapters and inputs, the data are too large for a page.
            data: "null".to_owned(),
            gallery: Gallery::default(),
        },
        adapters: adapters.into_iter().map(|(_, a)| a).collect(),
        inputs,
        failed,
        regrets: regrets.iter().map(regret).collect(),
    };
    Ok(plain(&page.render()?).into_owned())
}

fn cell<'a>(said: &AdapterResult<'a>) -> Cell<'a> {
    let (standing, why) = said.standing();
    let times = said.times.iter().map(|time| match time {
        Ok(speedup) => frontier::speedup(*speedup),
        Err(why) => format!("not timed: {why}"),
    });
    Cell {
        word: match standing {
            Standing::NoPicture => "",
            standing => standing.word(),
        },
        why,
        times: times.collect(),
        class: match standing {
            Standing::Broken => "broken",
            _ if said.pays() => "faster",
            _ if said.is_slower() => "slower",
            Standing::Holds | Standing::NoPicture => "",
            _ => "soft",
        },
    }
}

fn failed(results: &Results) -> Vec<[String; 4]> {
    let names = results.names();
    let mut all = Vec::new();
    for merged in results.jobs.values() {
        for (id, answer) in &merged.answers {
            let Answer::Failed { reason, why } = answer else {
                continue;
            };
            let name = names.get(id.as_str()).unwrap_or(id);
            let what = match merged.job.kind {
                Kind::Picture => "",
                Kind::Time => ", times",
            };
            all.push([
                format!("{}{what}", merged.job.name()),
                name.clone(),
                word(*reason).to_owned(),
                why.clone(),
            ]);
        }
    }
    all.sort();
    all
}

fn word(reason: Reason) -> &'static str {
    match reason {
        Reason::Refused => "refused",
        Reason::Crashed => "crashed",
        Reason::DeviceLost => "device lost",
        Reason::OutOfMemory => "out of memory",
        Reason::TimedOut => "took too long",
    }
}

fn regret(of: &RegretReport) -> Regret {
    let percent = |x: f64| format!("{:.2} %", x * 100.0);
    let rows = of.summary.iter().map(|s| {
        [
            format!("{}, {}", s.choice, s.scenes),
            s.views.to_string(),
            s.changed.to_string(),
            s.counted.to_string(),
            percent(s.median),
            percent(s.p95),
            percent(s.worst),
            s.slower.to_string(),
            s.worst_at.clone(),
        ]
    });
    Regret {
        title: of.adapter.title(),
        rows: rows.collect(),
        text: of.render(),
    }
}
