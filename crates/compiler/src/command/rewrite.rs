//! The report of `rewrite`.

use std::path::{Path, PathBuf};

use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_geometry::PASSES;
use preshade_plan::contract::Contract;
use preshade_plan::pass::{AnyPass, Facts, Refusal};
use preshade_plan::plan::{GpuPass, Plan};
use preshade_plan::program::Program;
use preshade_validate::{Check, Verdict};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::recipe::Recipe;
use shader_text::files::File;

/// The result for one material.
#[derive(Serialize)]
pub struct Rewritten {
    pub material: String,
    pub recipe: String,
    pub contract: Contract,
    /// Reasons of the skipped steps.
    pub refusals: Vec<Refusal>,
    /// Sentences for the host's author.
    pub notes: Vec<String>,
    /// Results of validation by proof and interpreter, if requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub validation: Option<Vec<Check>>,
    /// Results of validation on an adapter, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub validation_on: Option<OnAdapter>,
    /// The shaders and the plan.
    pub files: Vec<Written>,
}

impl Rewritten {
    /// The record of `plan` and its files, which are written to `folder`, or printed without one.
    pub fn new(plan: &Plan, refusals: Vec<Refusal>, files: &[File], folder: Option<&Path>) -> Self {
        let written = files.iter().map(|file| Written {
            name: file.name.clone(),
            content: match folder {
                Some(folder) => Content::Path(folder.join(&file.name)),
                None => Content::Text(String::from_utf8_lossy(&file.bytes).into_owned()),
            },
        });
        let steps = plan.steps.iter().map(ToString::to_string);
        let emitted = notes(files);
        Self {
            material: plan.material.clone(),
            recipe: steps.collect::<Vec<_>>().join(" + "),
            contract: plan.contract.clone(),
            refusals,
            notes: match emitted[..] {
                [] => plan.notes.clone(),
                _ => emitted,
            },
            validation: None,
            validation_on: None,
            files: written.collect(),
        }
    }

    /// Whether the variant breaks its contract.
    pub fn is_broken(&self) -> bool {
        let elsewhere = self.validation_on.iter().flat_map(|v| &v.checks);
        let checks = self.validation.iter().flatten().chain(elsewhere);
        checks.into_iter().any(|c| c.verdict.is_broken())
    }
}

/// Results of running original and variant on an adapter.
#[derive(Serialize)]
pub struct OnAdapter {
    pub adapter: String,
    pub checks: Vec<Check>,
}

/// A file that was written or printed.
#[derive(Serialize)]
pub struct Written {
    pub name: String,
    /// Its path, or its content if it was printed.
    #[serde(flatten)]
    pub content: Content,
}

#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Content {
    Path(PathBuf),
    Text(String),
}

/// The result for all materials.
#[derive(Serialize)]
pub struct Report {
    schema: &'static str,
    pub materials: Vec<Rewritten>,
    /// One for each material that could not be read, expressed or written.
    pub errors: Vec<String>,
}

impl Report {
    pub fn new(materials: Vec<Rewritten>, errors: Vec<String>) -> Self {
        Self {
            schema: "preshade.rewrite.v1",
            materials,
            errors,
        }
    }
}

/// Puts the declarations of `layout` files in place of their names. The text becomes one line, because
/// generated files quote their recipe in a comment.
///
/// # Errors
/// `read` cannot read a file, as a message.
pub fn read_layouts(
    recipe: &mut Recipe,
    read: &dyn Fn(&str) -> Result<String, String>,
) -> Result<(), String> {
    let layouts = recipe
        .steps
        .iter_mut()
        .filter(|step| step.pass == "outputs")
        .filter_map(|step| step.params.get_mut("layout"));
    for layout in layouts {
        let Value::String(file) = &*layout else {
            continue;
        };
        let text = read(file).map_err(|e| format!("the layout `{file}` cannot be read: {e}"))?;
        let lines = text.lines().map(|line| line.split("//").next());
        let words = lines.flatten().flat_map(str::split_whitespace);
        *layout = Value::String(words.collect::<Vec<_>>().join(" "));
    }
    Ok(())
}

/// Messages about a variant: the unmeasured part of its budget, and its notes. Of several
/// materials, each has a part of the values that a recipe names.
pub fn messages(plan: &Plan, is_alone: bool) -> Vec<String> {
    let mut messages: Vec<String> = unmeasured(plan).into_iter().collect();
    for note in &plan.notes {
        let is_stale = note.starts_with("`carry` names") && is_alone;
        let (level, advice) = match is_stale {
            true => (
                "warning",
                "; the shader was edited since: choose again with `verify`",
            ),
            false => ("note", ""),
        };
        messages.push(format!("{level}: `{}`: {note}{advice}", plan.material));
    }
    messages
}

/// The notes that emission added about its files.
pub fn added(plan: &Plan, files: &[File]) -> Vec<String> {
    let emitted = notes(files).into_iter();
    let added = emitted.filter(|note| !plan.notes.contains(note));
    added
        .map(|note| format!("note: `{}`: {note}", plan.material))
        .collect()
}

/// A note on a material without a fragment stage.
pub fn draws_depth_alone(original: &Plan) -> Option<String> {
    let is_so = original.passes.iter().all(|p| p.fragment.is_none());
    is_so.then(|| {
        format!(
            "note: `{}` has no fragment stage: it is taken for a material that draws depth \
             alone; where its fragment stage is in another file, give both",
            original.material
        )
    })
}

/// A warning about the budget of a variant that nothing measures.
fn unmeasured(plan: &Plan) -> Option<String> {
    let budgets = plan.contract.budgets();
    if budgets.is_empty() {
        return None;
    }
    let off: Vec<String> = budgets
        .iter()
        .map(|b| format!("{} ({})", b.limit, b.metric))
        .collect();
    Some(format!(
        "warning: `{}` is an approximation that may be off by {}, and `rewrite` measures nothing: \
         `preshade verify` reports whether the budget holds, and which recipe to pass to `rewrite`",
        plan.material,
        off.join(" and ")
    ))
}

/// The notes in the `plan.json` among `files`.
fn notes(files: &[File]) -> Vec<String> {
    /// The notes alone: to read a whole plan takes 300 kB of the module for browsers.
    #[derive(Deserialize)]
    struct Noted {
        #[serde(default)]
        notes: Vec<String>,
    }
    let json = files.iter().find(|f| f.name.ends_with(".plan.json"));
    let plan = json.and_then(|f| serde_json::from_slice::<Noted>(&f.bytes).ok());
    plan.map_or_else(Vec::new, |plan| plan.notes)
}

/// The results of checks, as messages: one for all that fail to run for one reason.
pub fn check_messages<'c>(
    material: &str,
    place: &str,
    checks: impl IntoIterator<Item = &'c Check>,
) -> Vec<String> {
    let mut groups: Vec<Vec<&Check>> = Vec::new();
    for check in checks {
        let is_unrun = matches!(check.verdict, Verdict::NotEvaluable { .. });
        let same = |group: &&mut Vec<&Check>| group[0].verdict == check.verdict;
        match groups.iter_mut().find(same).filter(|_| is_unrun) {
            Some(group) => group.push(check),
            None => groups.push(vec![check]),
        }
    }
    let groups = groups.iter();
    groups
        .map(|group| message(material, place, group))
        .collect()
}

/// A message on checks of one verdict.
fn message(material: &str, place: &str, checks: &[&Check]) -> String {
    let check = checks[0];
    let level = match check.verdict {
        Verdict::Counterexample(_) => "error",
        Verdict::NotEvaluable { .. } => "warning",
        Verdict::Proved { .. } | Verdict::Agreed { .. } => "note",
    };
    let promises = checks
        .iter()
        .map(|check| format!("{} pass, {}", check.role.name(), check.promise));
    let line = format!(
        "{level}: `{material}`, {}{place}: {}",
        promises.collect::<Vec<_>>().join("; "),
        check.verdict
    );
    match check.verdict.is_broken() {
        true => format!(
            "{line}\nnothing is written of `{material}`: this is a bug in preshade, please report \
             it with the shader"
        ),
        false => line,
    }
}

/// A note without `--pass`: the material is written as it is, and these passes would apply.
pub fn nothing_asked_for(original: &Plan) -> String {
    let applies = |pass: &&&dyn AnyPass| {
        let outcome = pass.run(original, &Facts::default(), &serde_json::json!({}));
        outcome.is_ok()
    };
    let names: Vec<&str> = PASSES
        .iter()
        .filter(applies)
        .map(|p| p.info().name)
        .collect();
    let material = &original.material;
    let list = match names.is_empty() {
        true => "none applies to it".to_owned(),
        false => format!("these apply to it: {}", names.join(", ")),
    };
    format!("note: no --pass is given, so `{material}` is written as it is; {list}")
}

/// Whether a material's main pass may discard.
pub fn discards(plan: &Plan) -> bool {
    plan.main().is_some_and(|pass| may_discard(plan, pass))
}

fn may_discard(plan: &Plan, pass: &GpuPass) -> bool {
    let Some(program) = plan.program(pass) else {
        return false;
    };
    stage_may_discard(program, pass.fragment.as_deref())
}

/// Whether the fragment stage of this name may discard.
pub fn stage_may_discard(program: &Program, fragment: Option<&str>) -> bool {
    let entry = fragment.and_then(|f| program.entry_point(naga::ShaderStage::Fragment, f));
    entry.is_some_and(|(index, _)| Graph::build(program).may_discard(FunctionId::EntryPoint(index)))
}

/// Most values of a guard that a message lists.
const LISTED: usize = 6;

/// A message for a variant whose guard removed the material's last discard.
pub fn removed_discard(plan: &Plan) -> Option<String> {
    let guard = plan.guard.as_ref().filter(|g| !g.values.is_empty())?;
    let original = plan.original.as_deref()?;
    if !discards(original) || plan.passes.iter().any(|pass| may_discard(plan, pass)) {
        return None;
    }
    let mut values: Vec<String> = guard.values.iter().map(ToString::to_string).collect();
    let more = values.len().saturating_sub(LISTED);
    values.truncate(LISTED);
    if more > 0 {
        values.push(format!("{more} more"));
    }
    Some(format!(
        "warning: `{}`: this variant discards no fragment, and the original does. It is right only \
         for the given values: {}",
        plan.material,
        values.join(", ")
    ))
}

#[cfg(test)]
mod tests {
    use preshade_plan::plan::Role;

    use super::check_messages;
    use preshade_validate::Check;
    use preshade_validate::verdict::Verdict;

    #[test]
    fn checks_that_cannot_run_for_one_reason_are_one_warning() {
        let check = |role, promise: &str, verdict| Check {
            role,
            promise: promise.to_owned(),
            verdict,
        };
        let unrun = |why: &str| Verdict::NotEvaluable {
            why: why.to_owned(),
        };
        let agreed = || Verdict::Agreed {
            inputs: 3,
            compared: 0,
            unsure: 0,
        };
        let checks = [
            check(Role::Main, "positions", unrun("no buffers")),
            check(Role::Main, "depths", agreed()),
            check(Role::Main, "colours", unrun("no buffers")),
            check(Role::Main, "discards", agreed()),
            check(Role::Main, "ids", unrun("a budget")),
        ];
        let said = check_messages("m", " on this adapter", &checks);
        assert_eq!(said.len(), 4, "{said:?}");
        let first = "warning: `m`, main pass, positions; main pass, colours on this adapter: not \
                     evaluated: no buffers";
        assert_eq!(said[0], first);
    }
}
