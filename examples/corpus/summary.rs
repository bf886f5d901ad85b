//! The tables at the end of a run.

use std::collections::BTreeMap;
use std::path::PathBuf;

use crate::record::{Outcome, Record};

/// Prints what came of all materials; false if anything is wrong.
pub fn print(records: &[Record], folders: &[PathBuf]) -> bool {
    println!();
    println!("| collection | materials | legal | legal and sayable | read | share |");
    println!("|---|---:|---:|---:|---:|---:|");
    for folder in folders {
        let start = folder.display().to_string();
        let of: Vec<&Record> = records
            .iter()
            .filter(|r| r.name.starts_with(&start))
            .collect();
        row(&start, &of);
    }
    row("all", &records.iter().collect::<Vec<_>>());
    reasons(records);
    outcomes("pass", records, |r| r.passes.iter().collect());
    outcomes("target", records, |r| {
        r.targets.get("original").into_iter().flatten().collect()
    });
    outcomes("target, of what passes make", records, |r| {
        let variants = r.targets.iter().filter(|(pass, _)| *pass != "original");
        variants.flat_map(|(_, targets)| targets).collect()
    });
    let mut faults: BTreeMap<&str, usize> = BTreeMap::new();
    for (kind, _) in records.iter().flat_map(Record::faults) {
        *faults.entry(kind).or_default() += 1;
    }
    let count = |kind: &str| faults.get(kind).copied().unwrap_or_default();
    let sum = |of: fn(&Record) -> usize| records.iter().map(of).sum::<usize>();
    println!(
        "\n| texts judged | not known to Tint | invalid | stages reflected | differ | bugs | panics | time-outs |\n\
         |---:|---:|---:|---:|---:|---:|---:|---:|\n| {} | {} | {} | {} | {} | {} | {} | {} |",
        sum(|r| r.judged),
        sum(|r| r.beyond_tint),
        count("invalid"),
        sum(|r| r.reflected),
        count("reflection"),
        count("bug"),
        count("panic"),
        count("time-out"),
    );
    faults.is_empty()
}

fn row(name: &str, records: &[&Record]) {
    let count = |of: &dyn Fn(&Record) -> bool| records.iter().filter(|r| of(r)).count();
    let legal = count(&|r| r.legal != Some(false));
    let wanted = count(&Record::is_wanted);
    let read = count(&|r| r.is_wanted() && r.read.is_done());
    let share = 100.0 * read as f64 / wanted.max(1) as f64;
    let all = records.len();
    println!("| {name} | {all} | {legal} | {wanted} | {read} | {share:.1} % |");
}

/// Why what is legal is not read.
fn reasons(records: &[Record]) {
    let mut counted: BTreeMap<(bool, String), Vec<&str>> = BTreeMap::new();
    for record in records.iter().filter(|r| r.legal != Some(false)) {
        if let Outcome::Refused { code, message } = &record.read {
            let key = (!record.is_wanted(), format!("{code}: {}", general(message)));
            counted.entry(key).or_default().push(&record.name);
        }
    }
    let mut rows: Vec<_> = counted.into_iter().collect();
    rows.sort_by_key(|((unsayable, _), names)| (*unsayable, std::cmp::Reverse(names.len())));
    println!("\n| count | sayable | refused | first |\n|---:|---|---|---|");
    for ((unsayable, why), names) in rows {
        let sayable = if unsayable { "no" } else { "yes" };
        let why = why.replace('|', "\\|");
        println!("| {} | {sayable} | {why} | {} |", names.len(), names[0]);
    }
}

fn outcomes<'a>(
    title: &str,
    records: &'a [Record],
    of: fn(&'a Record) -> Vec<(&'a String, &'a Outcome)>,
) {
    let mut counted: BTreeMap<&str, (usize, BTreeMap<&str, usize>)> = BTreeMap::new();
    for (name, outcome) in records.iter().flat_map(of) {
        let entry = counted.entry(name).or_default();
        match outcome {
            Outcome::NotTried => {}
            Outcome::Done => entry.0 += 1,
            Outcome::Refused { code, .. } => *entry.1.entry(code).or_default() += 1,
        }
    }
    println!("\n| {title} | yes | refused |\n|---|---:|---|");
    for (name, (done, refused)) in counted {
        let mut codes: Vec<_> = refused.into_iter().collect();
        codes.sort_by_key(|(_, n)| std::cmp::Reverse(*n));
        let codes: Vec<String> = codes.iter().map(|(c, n)| format!("{n} {c}")).collect();
        println!("| {name} | {done} | {} |", codes.join(", "));
    }
}

/// The message without what is this file's alone: names in quotes and numbers.
fn general(message: &str) -> String {
    let mut out = String::new();
    for c in message.chars().take(200) {
        match c {
            _ if c.is_ascii_digit() && out.ends_with('#') => {}
            _ if c.is_ascii_digit() => out.push('#'),
            _ => out.push(c),
        }
    }
    out
}
