//! The results of `agree`, and their forms.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use preshade_validate::agree::{Agreement, By, Class, Finding, Outcome, Relation, Spot};
use serde::Serialize;

use super::agree::Cost;
use shader_text::nearest::unknown;

/// The result of drawing both programs in a scene.
pub trait Drawn: Serialize {
    /// The comparison, a line each.
    fn lines(&self, relation: Relation) -> Vec<String>;

    /// The difference that breaks the relation, in words.
    fn differs(&self, relation: Relation) -> Option<String>;
}

/// No scene was drawn.
#[derive(Serialize)]
pub enum Undrawn {}

impl Drawn for Undrawn {
    fn lines(&self, _: Relation) -> Vec<String> {
        Vec::new()
    }

    fn differs(&self, _: Relation) -> Option<String> {
        None
    }
}

/// A finding that the user accepts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Waiver {
    pub pair: String,
    /// The class of the finding.
    pub class: Class,
    pub reason: String,
}

/// A finding, and the caller's judgement of it.
#[derive(Serialize)]
struct JudgedFinding {
    #[serde(flatten)]
    finding: Finding,
    /// Whether it makes the exit status 1.
    breaks: bool,
    /// The reason of the waiver that accepts it.
    #[serde(skip_serializing_if = "Option::is_none")]
    waived: Option<String>,
}

#[derive(Serialize)]
pub struct Pair<D = Undrawn> {
    pub name: String,
    #[serde(flatten)]
    agreement: Agreement,
    /// The findings of the agreement, judged.
    #[serde(rename = "judged")]
    findings: Vec<JudgedFinding>,
    /// How the programs were read, a sentence each.
    notes: Vec<String>,
    /// Static costs of the first and the second program.
    cost: [Cost; 2],
    /// Both programs in a scene, by camera.
    drawn: Vec<D>,
}

#[derive(Serialize)]
pub struct Report<D = Undrawn> {
    schema: &'static str,
    pub pairs: Vec<Pair<D>>,
    /// Sentences on materials that are in one of two folders alone.
    pub alone: Vec<String>,
    /// Files in both folders that are no materials.
    pub left_out: usize,
    /// Pairs of two folders with the same text.
    pub unchanged: usize,
    unused_waivers: Vec<Waiver>,
    /// Sentences on waivers of pairs that are not there.
    lost_waivers: Vec<String>,
    /// Errors of pairs that could not be compared.
    pub errors: Vec<String>,
}

impl<D> Default for Report<D> {
    fn default() -> Self {
        Self {
            schema: "preshade.agree.v1",
            pairs: Vec::new(),
            alone: Vec::new(),
            left_out: 0,
            unchanged: 0,
            unused_waivers: Vec::new(),
            lost_waivers: Vec::new(),
            errors: Vec::new(),
        }
    }
}

impl<D: Drawn> Pair<D> {
    /// The result of a comparison.
    pub fn new(
        name: String,
        mut agreement: Agreement,
        notes: Vec<String>,
        cost: [Cost; 2],
        drawn: Vec<D>,
    ) -> Self {
        let mut findings = std::mem::take(&mut agreement.findings);
        let relation = agreement.relation;
        let differing = drawn.iter().filter_map(|drawn| drawn.differs(relation));
        findings.extend(differing.map(|words| Finding::general(Class::Drawn, "the scene", words)));
        let judged = findings.into_iter().map(|finding| JudgedFinding {
            finding,
            breaks: false,
            waived: None,
        });
        Self {
            name,
            agreement,
            findings: judged.collect(),
            notes,
            cost,
            drawn,
        }
    }

    /// Whether a matrix was paired with another one, or with a product, without a mapping.
    fn has_guess(&self) -> bool {
        let mut partners = self.agreement.partners.iter();
        partners.any(|partner| partner.by == By::Product)
    }

    /// The result of a promise in a few words.
    fn outcome(&self, promise: &str) -> String {
        let of_it = || {
            self.findings
                .iter()
                .filter(|j| j.finding.promise == promise)
        };
        let held = self
            .agreement
            .promises
            .iter()
            .find(|h| h.promise == promise);
        let Some(held) = held else {
            return String::new();
        };
        match &held.outcome {
            Outcome::Proved {
                slices: true,
                inputs,
            } => {
                format!("proved: the same slice, and agreed on {inputs} inputs")
            }
            // A guess is no proof.
            Outcome::Proved { .. } if self.has_guess() => {
                "the same operations, if the note on the matrix holds".to_owned()
            }
            Outcome::Proved { .. } => "proved: the same operations".to_owned(),
            Outcome::Agreed {
                inputs,
                cut_from: None,
            } => format!("agreed on {inputs} inputs"),
            Outcome::Agreed {
                inputs,
                cut_from: Some(all),
            } => format!("agreed on {inputs} of {all} inputs: too expensive for more"),
            Outcome::NotEvaluated { why } => format!("not evaluated: {why}"),
            Outcome::Differs => {
                let names: Vec<&str> = of_it().map(|j| j.finding.class.name()).collect();
                let is_small = |j: &JudgedFinding| !j.breaks && is_small(j.finding.class);
                if of_it().all(is_small) {
                    return "agrees but for rounding, or infinite and huge numbers".to_owned();
                }
                format!("differs: {}", names.join(", "))
            }
        }
    }

    /// Whether a promise was not evaluated, and no waiver accepts that.
    fn is_partial(&self) -> bool {
        let waived = self.findings.iter().filter(|j| j.waived.is_some());
        let waived: Vec<&str> = waived.map(|j| j.finding.words.as_str()).collect();
        self.agreement.is_nothing() || self.agreement.not_evaluated(&waived).is_some()
    }
}

impl<D: Drawn> Report<D> {
    /// Applies waivers, and notes which were not needed, and which name no pair. `names` has all pairs,
    /// and whether each could be read.
    pub fn waive(
        &mut self,
        waivers: &[Waiver],
        names: &BTreeMap<String, bool>,
        breaks: impl Fn(Class, Relation) -> bool,
    ) {
        let mut used = vec![false; waivers.len()];
        for pair in &mut self.pairs {
            for judged in &mut pair.findings {
                let class = judged.finding.class;
                let mut all = waivers.iter().zip(&mut used);
                let waiver = all.find(|(w, _)| w.class == class && w.pair == pair.name);
                match waiver {
                    Some((waiver, used)) => {
                        *used = true;
                        judged.waived = Some(waiver.reason.clone());
                    }
                    None => judged.breaks = breaks(class, pair.agreement.relation),
                }
            }
        }
        let unused = waivers.iter().zip(&used).filter(|(_, used)| !**used);
        for (waiver, _) in unused {
            match names.get(&waiver.pair) {
                Some(true) => self.unused_waivers.push(waiver.clone()),
                // The pair could not be read: the waiver may be needed.
                Some(false) => {}
                None => {
                    let known: Vec<&str> = names.keys().map(String::as_str).collect();
                    let class = waiver.class.name();
                    let why = unknown("pair", &waiver.pair, &known);
                    self.lost_waivers
                        .push(format!("the waiver of {class}: {why}"));
                }
            }
        }
    }

    /// Whether a finding breaks a relation.
    pub fn is_broken(&self) -> bool {
        let mut findings = self.pairs.iter().flat_map(|p| &p.findings);
        findings.any(|j| j.breaks)
    }

    /// Whether a promise was not evaluated.
    pub fn is_partial(&self) -> bool {
        let is_all_unread = self.pairs.is_empty() && self.unchanged == 0;
        is_all_unread || self.pairs.iter().any(Pair::is_partial)
    }

    /// The report as text.
    pub fn human(&self, verbose: bool) -> String {
        let mut out = String::new();
        for pair in &self.pairs {
            let relation = pair.agreement.relation.name();
            let _ = writeln!(out, "{}, as {relation}", pair.name);
            if verbose {
                for partner in &pair.agreement.partners {
                    let by = serde_json::to_value(partner.by);
                    let by = by
                        .ok()
                        .and_then(|v| v.as_str().map(str::to_owned))
                        .unwrap_or_default();
                    let _ = writeln!(out, "  `{}` is `{}` by {by}", partner.theirs, partner.ours);
                }
            }
            for note in &pair.notes {
                let _ = writeln!(out, "  note: {note}");
            }
            for held in &pair.agreement.promises {
                let _ = writeln!(out, "  {}: {}", held.promise, pair.outcome(&held.promise));
            }
            for judged in &pair.findings {
                write_judged(&mut out, judged, pair.agreement.relation, verbose);
            }
            for line in pair
                .drawn
                .iter()
                .flat_map(|b| b.lines(pair.agreement.relation))
            {
                let _ = writeln!(out, "  {line}");
            }
            if pair.agreement.relation == Relation::Same {
                for line in costs(&pair.cost) {
                    let _ = writeln!(out, "  {line}");
                }
            }
        }
        if self.unchanged > 0 {
            let _ = writeln!(out, "{} unchanged", self.unchanged);
        }
        for alone in &self.alone {
            let _ = writeln!(out, "{alone}");
        }
        if self.left_out > 0 {
            let _ = writeln!(out, "{} left out: no materials", self.left_out);
        }
        let unused = self.unused_waivers.iter().map(unused);
        for warning in unused.chain(self.lost_waivers.iter().cloned()) {
            let _ = writeln!(out, "warning: {warning}");
        }
        out
    }

    /// The report as a comment on a pull request.
    pub fn markdown(&self) -> String {
        let mut out = String::new();
        let broken = self
            .pairs
            .iter()
            .filter(|p| p.findings.iter().any(|j| j.breaks));
        let (broken, all) = (broken.count(), self.pairs.len());
        let _ = match broken {
            0 if self.is_partial() => {
                writeln!(out, "### Shaders: {all} compared, not all evaluated\n")
            }
            0 => writeln!(out, "### Shaders: {all} compared, none differs\n"),
            _ => writeln!(out, "### Shaders: {broken} of {all} differ\n"),
        };
        if self.unchanged > 0 {
            let _ = writeln!(out, "Unchanged: {}.\n", self.unchanged);
        }
        for alone in &self.alone {
            let _ = writeln!(out, "{}.\n", cell(alone));
        }
        if self.pairs.is_empty() {
            return out;
        }
        let is_same = |p: &&Pair<D>| p.agreement.relation == Relation::Same;
        let _ = writeln!(
            out,
            "| shader | result | vertex ops | fragment ops |\n|---|---|--:|--:|"
        );
        for pair in &self.pairs {
            let is_note = |j: &&JudgedFinding| j.finding.class == Class::Variant && !j.breaks;
            let result = match &pair.findings[..] {
                all if all.iter().all(|j| is_note(&j)) => {
                    let mut words: Vec<String> = pair
                        .agreement
                        .promises
                        .iter()
                        .map(|h| {
                            let outcome = pair.outcome(&h.promise);
                            let short = outcome.split(':').next().unwrap_or_default();
                            format!("{} {short}", h.promise)
                        })
                        .collect();
                    words.dedup();
                    words.extend(all.iter().map(|j| j.finding.class.name().to_owned()));
                    words.join(", ")
                }
                some => {
                    let names: Vec<String> = some
                        .iter()
                        .map(|j| match (&j.waived, j.breaks) {
                            (Some(_), _) => format!("{} (waived)", j.finding.class.name()),
                            (None, true) => format!("**{}**", j.finding.class.name()),
                            (None, false) => j.finding.class.name().to_owned(),
                        })
                        .collect();
                    names.join(", ")
                }
            };
            let [vertex, fragment] = match Some(pair).filter(is_same) {
                Some(_) => {
                    let [before, after] = &pair.cost;
                    [
                        change(before.vertex, after.vertex),
                        change(before.fragment, after.fragment),
                    ]
                }
                None => [String::new(), String::new()],
            };
            let name = cell(&pair.name);
            let _ = writeln!(
                out,
                "| `{name}` | {} | {vertex} | {fragment} |",
                cell(&result)
            );
        }
        for pair in self.pairs.iter().filter(|p| !p.findings.is_empty()) {
            let _ = writeln!(
                out,
                "\n`{}`, as {}:\n",
                pair.name,
                pair.agreement.relation.name()
            );
            for judged in &pair.findings {
                let finding = &judged.finding;
                let waived = judged.waived.as_ref().map(|r| format!(" (waived: {r})"));
                let _ = writeln!(
                    out,
                    "- **{}**: {}{}",
                    finding.class.name(),
                    finding.words,
                    waived.unwrap_or_default()
                );
                for (who, spot) in lines(finding, pair.agreement.relation) {
                    let _ = writeln!(out, "  - {who}: {}", told_spot(spot));
                }
            }
        }
        for pair in &self.pairs {
            for note in &pair.notes {
                let _ = writeln!(out, "\n`{}`: {note}", pair.name);
            }
        }
        for pair in self.pairs.iter().filter(|p| !p.drawn.is_empty()) {
            let _ = writeln!(out, "\n`{}` in the scene:\n", pair.name);
            let lines = pair
                .drawn
                .iter()
                .flat_map(|b| b.lines(pair.agreement.relation));
            lines.for_each(|line| {
                let _ = writeln!(out, "- {line}");
            });
        }
        let unused = self.unused_waivers.iter().map(unused);
        for warning in unused.chain(self.lost_waivers.iter().cloned()) {
            let _ = writeln!(out, "\n{warning}");
        }
        out
    }
}

fn unused(waiver: &Waiver) -> String {
    format!(
        "the waiver of {} for `{}` is not needed any more",
        waiver.class.name(),
        waiver.pair
    )
}

/// Whether a picture shows it at most in a last bit.
fn is_small(class: Class) -> bool {
    matches!(class, Class::Rounding | Class::Extreme)
}

fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}

fn write_judged(out: &mut String, judged: &JudgedFinding, relation: Relation, verbose: bool) {
    let finding = &judged.finding;
    let level = match (&judged.waived, judged.breaks) {
        (Some(_), _) => "waived",
        (None, true) => "error",
        (None, false) => "note",
    };
    let _ = writeln!(
        out,
        "  {level}[{}]: {}",
        finding.class.name(),
        finding.words
    );
    if let Some(reason) = &judged.waived {
        let _ = writeln!(out, "    waived: {reason}");
    }
    if is_small(finding.class) && !judged.breaks && !verbose {
        return;
    }
    for (who, spot) in lines(finding, relation) {
        let _ = writeln!(out, "    {who}: {}", told_spot(spot));
    }
    if verbose {
        for (name, value) in &finding.inputs {
            let _ = writeln!(out, "    with {name} = {value}");
        }
        if let Some(seed) = finding.seed {
            let _ = writeln!(out, "    inputs of seed {seed}");
        }
    }
}

/// The lines of both authors, each once.
fn lines(finding: &Finding, relation: Relation) -> Vec<(String, &Spot)> {
    let [first, second] = relation.names();
    let all = [
        (first, &finding.first),
        (first, &finding.first_decides),
        (second, &finding.second),
        (second, &finding.second_decides),
    ];
    let mut lines: Vec<(String, &Spot)> = Vec::new();
    for (who, spot) in all {
        if let Some(spot) = spot
            && !lines
                .iter()
                .any(|(w, s)| w == who && s.location == spot.location)
        {
            lines.push((who.to_owned(), spot));
        }
    }
    lines
}

fn told_spot(spot: &Spot) -> String {
    let at = match &spot.location {
        Some(at) => format!("{}:{}:{} ", at.file, at.line, at.column),
        None => String::new(),
    };
    format!("{at}`{}` = {}", spot.text, spot.value)
}

/// The costs of the stages before and after.
fn costs([before, after]: &[Cost; 2]) -> Vec<String> {
    let line = |stage: &str, before: Option<f64>, after: Option<f64>| {
        before.or(after)?;
        Some(format!("{stage}: {} ops", change(before, after)))
    };
    [
        line("vertex", before.vertex, after.vertex),
        line("fragment", before.fragment, after.fragment),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn change(before: Option<f64>, after: Option<f64>) -> String {
    let said = |cost: Option<f64>| cost.map_or("none".to_owned(), |c| format!("{c:.0}"));
    match (before, after) {
        (None, None) => String::new(),
        (Some(a), Some(b)) if a == b => said(before),
        (Some(a), Some(b)) if a > 0.0 => {
            format!(
                "{} → {} ({:+.0} %)",
                said(before),
                said(after),
                (b - a) / a * 100.0
            )
        }
        _ => format!("{} → {}", said(before), said(after)),
    }
}
