//! `--results` of `plan` and `explore`: decides over the adapters of merged results. Opens no adapter.

use std::path::{Component, Path, PathBuf};

use preshade_compiler::emit;
use preshade_compiler::recipe::Recipe;
use preshade_lab::jobs::decision::{
    FleetDecision, FleetDecisions, FleetFrontiers, NoTimes, decide, frontier,
};
use preshade_lab::jobs::{Rows, Subject, VERSION, Variants, files, hash};
use preshade_lab::measure;
use preshade_lab::report::fleet;
use preshade_plan::budget::Budget;
use preshade_plan::plan::Plan;
use shader_text::files::File;
use shader_text::nearest::unknown;

use crate::file_names::from_here;
use crate::input::ShaderArgs;
use crate::materials::{self, Job};
use crate::{Ending, Failure, Table, output};

/// Where and how to print.
pub struct To<'a> {
    pub format: Table,
    pub out: Option<&'a Path>,
}

/// Decides which variant of each input to draw with.
pub fn plan(file: &Path, inputs: &[Job], to: &To<'_>) -> Result<Ending, Failure> {
    let results = files::results(file)?;
    let rows = results.rows();
    let (mut decisions, mut shaders) = (Vec::new(), Vec::new());
    let mut is_current = true;
    let failed = each(inputs, |shader| {
        let (subject, row) = found(&rows, file, &shader.files)?;
        is_current &= subject.version == VERSION;
        let decision = decide(&results, subject, row).map_err(|e| no_times(shader, &e))?;
        shaders.push((shader.clone(), decision.clone()));
        decisions.push(decision);
        Ok(())
    })?;
    let is_broken = |d: &FleetDecision| d.variants.iter().any(|v| v.is_broken());
    let is_broken = decisions.iter().any(is_broken);
    let tables: Vec<String> = decisions.iter().map(fleet::decision).collect();
    let decisions = FleetDecisions::new(decisions);
    let json = serde_json::to_string_pretty(&decisions)? + "\n";
    let csv = fleet::decisions_csv(&decisions);
    to.print(&tables, ("decision.json", json), csv)?;
    if !is_current && to.out.is_some() {
        // Its shaders may be others than those that were measured.
        output::message("note: no shaders are written: another version of preshade measured");
        shaders.clear();
    }
    for (shader, decision) in &shaders {
        let out = match (to.out, inputs.len()) {
            (None, _) => break,
            (Some(out), 1) => out.to_owned(),
            (Some(out), _) => {
                materials::folder_of(out, shader.files.first().unwrap_or(&PathBuf::new()))
            }
        };
        write(shader, decision, &out)?;
    }
    ended(&failed, inputs, is_broken)
}

/// Prints the frontier of each input.
pub fn explore(
    file: &Path,
    inputs: &[Job],
    budget: Option<Budget>,
    to: &To<'_>,
) -> Result<Ending, Failure> {
    let results = files::results(file)?;
    let rows = results.rows();
    let mut frontiers = Vec::new();
    let failed = each(inputs, |shader| {
        let (subject, row) = found(&rows, file, &shader.files)?;
        let found = frontier(&results, subject, row, budget).map_err(|e| no_times(shader, &e))?;
        frontiers.push(found);
        Ok(())
    })?;
    let is_broken = frontiers.iter().any(|f| f.is_broken());
    let tables: Vec<String> = frontiers.iter().map(fleet::frontier).collect();
    let frontiers = FleetFrontiers::new(frontiers);
    let json = serde_json::to_string_pretty(&frontiers)? + "\n";
    let csv = fleet::frontiers_csv(&frontiers);
    to.print(&tables, ("report.json", json), csv)?;
    ended(&failed, inputs, is_broken)
}

fn ended(failed: &[String], inputs: &[Job], is_broken: bool) -> Result<Ending, Failure> {
    match failed.is_empty() {
        true => Ok(Ending::of(is_broken, false)),
        false => Err(Failure::of_inputs(failed, inputs.len())),
    }
}

/// Runs `then` for each input. If one of several fails, reports it and goes on. Returns the names
/// of those that fail.
fn each(
    inputs: &[Job],
    mut then: impl FnMut(&ShaderArgs) -> Result<(), Failure>,
) -> Result<Vec<String>, Failure> {
    let mut names = Vec::new();
    for input in inputs {
        match then(&input.shader) {
            Ok(()) => {}
            Err(failure) if inputs.len() == 1 => return Err(failure),
            Err(Failure(why)) => {
                output::message(&why);
                names.push(name(&input.shader.files));
            }
        }
    }
    match names.len() == inputs.len() {
        true => Err(Failure("error: every input failed".to_owned())),
        false => Ok(names),
    }
}

fn name(files: &[PathBuf]) -> String {
    let files = files.iter().map(|f| f.display().to_string());
    files.collect::<Vec<_>>().join(" ")
}

/// The measurements of an input, if they are of the files that are on the disk now.
fn found<'r, 'a>(
    rows: &'r Rows<'a>,
    file: &Path,
    files: &[PathBuf],
) -> Result<(&'r Subject<'a>, &'r Variants<'a>), Failure> {
    let wanted = same_in_any_spelling(files.iter().map(PathBuf::as_path));
    let is_it = |s: &Subject<'_>| {
        same_in_any_spelling(s.input.iter().map(|i| Path::new(i.as_str()))) == wanted
    };
    let of_it: Vec<_> = rows.iter().filter(|(s, _)| is_it(s)).collect();
    let current = |s: &Subject<'_>| s.files.iter().find_map(|(p, h)| changed(p, h));
    let now: Vec<_> = of_it
        .iter()
        .filter(|(s, _)| current(s).is_none())
        .copied()
        .collect();
    match (&now[..], of_it.first()) {
        ([one], _) => Ok(*one),
        ([], None) => {
            let mut known: Vec<String> = rows.keys().map(|s| s.input.join(" ")).collect();
            known.dedup();
            let known: Vec<&str> = known.iter().map(String::as_str).collect();
            Err(Failure(format!(
                "error: {}: {}",
                file.display(),
                unknown("input", &name(files), &known)
            )))
        }
        ([], Some((subject, _))) => Err(Failure(format!(
            "error: {}: the results are of other files: {}; measure it again (`preshade jobs`, \
             `evaluate`, `merge`)",
            name(files),
            current(subject).unwrap_or_default()
        ))),
        (several, _) => {
            let titles: Vec<String> = several.iter().map(|(s, _)| s.title(rows)).collect();
            Err(Failure(format!(
                "error: {} has several measurements of it; merge those of one list of jobs:\n  {}",
                file.display(),
                titles.join("\n  ")
            )))
        }
    }
}

/// Paths as they are below the current folder, in any order.
fn same_in_any_spelling<'p>(paths: impl Iterator<Item = &'p Path>) -> Vec<PathBuf> {
    let plain = |path: &Path| -> PathBuf {
        let parts = from_here(path).components();
        parts.filter(|c| *c != Component::CurDir).collect()
    };
    let mut all: Vec<PathBuf> = paths.map(plain).collect();
    all.sort();
    all
}

/// Why a file is not the measured one. `None`: it is.
fn changed(path: &str, expected: &str) -> Option<String> {
    match std::fs::read(path) {
        Err(e) => Some(format!("{path}: {e}")),
        Ok(bytes) if hash(&bytes) != expected => Some(format!("{path} was changed")),
        Ok(_) => None,
    }
}

fn no_times(shader: &ShaderArgs, why: &NoTimes) -> Failure {
    let name = name(&shader.files);
    let hint = match why.why {
        Some(_) => String::new(),
        None => format!(
            "\nhelp: `preshade jobs {name} --explore --time first-frames` lists the jobs that have"
        ),
    };
    Failure(format!("error: {name}: {why}{hint}"))
}

impl To<'_> {
    fn print(
        &self,
        tables: &[String],
        (name, json): (&str, String),
        csv: String,
    ) -> Result<(), Failure> {
        let forms = output::Answer {
            table: tables.join("\n\n"),
            json,
            csv,
        };
        forms.tell(self.format, self.out, |dir| {
            let files = [
                File::text(name, forms.json.clone()),
                File::text("report.csv", forms.csv.clone()),
            ];
            shader_text::files::write(dir, &files)?;
            output::message(&format!("wrote {}", dir.join(name).display()));
            Ok(())
        })
    }
}

/// Flags that change no shader.
const OF_THE_PICTURE: [&str; 7] = [
    "camera", "form", "frames", "limits", "order", "seconds", "size",
];

/// Writes the shaders of the choice, or reports why it does not.
fn write(shader: &ShaderArgs, decision: &FleetDecision, out: &Path) -> Result<(), Failure> {
    let Some(choice) = &decision.choice else {
        return Ok(());
    };
    let left_out = |why: &str| {
        output::message(&format!(
            "note: the shaders of {choice} are not written: {why}"
        ));
        Ok(())
    };
    let others = crate::flags::without(&decision.arguments, &OF_THE_PICTURE);
    if !others.is_empty() {
        let others = others.join(" ");
        return left_out(&format!("they were measured with {others}"));
    }
    let recipe = Recipe::parse_list(choice)?;
    if measure::leaves_a_choice(&recipe) {
        return left_out("they depend on what is measured on the adapter");
    }
    let materials = shader.plans_by_draws(&recipe)?;
    let variant = measure::variant(&materials.frame, &recipe, &materials.known);
    if variant.is_refused() {
        return left_out("they depend on facts of the adapter");
    }
    let mut files = Vec::new();
    for plan in &variant.plans {
        files.extend(emit::emit(
            plan,
            &[shader.target()],
            &emit::Options::default(),
        )?);
    }
    if let Some(scene) = &materials.scene {
        let plans: Vec<&Plan> = variant.plans.iter().collect();
        let versions = measure::versions(scene, &plans);
        files.extend(versions.iter().map(emit::versions));
    }
    shader_text::files::write(out, &files)?;
    output::message(&format!(
        "wrote {} to {}",
        output::count(files.len(), "file"),
        out.display()
    ));
    Ok(())
}
