//! The WGSL target: headers, the author's own text, and errors with their file.

use preshade_plan::budget::Budget;
use preshade_plan::contract::Contract;
use preshade_plan::plan::{Plan, Step};
use preshade_plan::program::Program;
use shader_text::source::Language;

use super::EmitError;
use crate::wgsl::{self, WgslError};
use preshade_plan::plan_file::Target;

/// Writes a reduced program. `name` is the file's, for errors, and `header` its first lines.
pub(super) fn write(program: &Program, name: &str, header: &str) -> Result<String, EmitError> {
    let (file, target) = (name.to_owned(), Target::Wgsl);
    wgsl::write(program, name, header).map_err(|error| match error {
        WgslError::Inexpressible(what) => EmitError::Inexpressible {
            file,
            target,
            what,
            remedy: "emit SPIR-V or GLSL, or use WGSL's struct layout".to_owned(),
        },
        // GLSL has it, and WGSL does not.
        WgslError::Writer(message) if message.starts_with("Unsupported builtin value") => {
            let of = message.rsplit(": ").next().unwrap_or_default();
            EmitError::Inexpressible {
                file,
                target,
                what: format!("the built-in {of}"),
                remedy: "emit SPIR-V, or pass the value in a uniform".to_owned(),
            }
        }
        WgslError::Writer(message) => EmitError::Writer {
            file,
            target,
            message,
        },
        WgslError::Differs(difference) => EmitError::Differs {
            file,
            target,
            difference,
        },
    })
}

/// The author's own text of an unchanged program; `None` for any other program.
pub(super) fn author_text(plan: &Plan, key: &str) -> Option<String> {
    let program = plan
        .programs
        .get(key)
        .filter(|p| p.language() == Language::Wgsl)?;
    program.author_text().map(str::to_owned)
}

/// Comment lines with the source files, the recipe and the contract. No date and no folder, so that
/// output is reproducible.
pub(super) fn header(plan: &Plan, program: &Program) -> String {
    let files: Vec<&str> = program
        .sources()
        .files()
        .iter()
        .filter(|f| !f.is_imported)
        .map(|f| f.name.rsplit(['/', '\\']).next().unwrap_or(&f.name))
        .collect();
    let one_line = |s: &str| s.replace(|c: char| c.is_control(), "?");
    let mut header = format!(
        "{} from {}; edits will be lost.\n",
        super::stale::GENERATED,
        one_line(&files.join(" and "))
    );
    let steps: Vec<String> = plan.steps.iter().map(in_a_line).collect();
    if !steps.is_empty() {
        header.push_str(&format!(
            "// Recipe: {}.\n",
            one_line(&steps.join(", then "))
        ));
        header.push_str(&format!("// Contract: {}.\n", contract(&plan.contract)));
    }
    header.push('\n');
    header
}

/// A step, without the text of whole files among its parameters.
fn in_a_line(step: &Step) -> String {
    let mut step = step.clone();
    let params = step.params.as_object_mut().into_iter().flatten();
    for (_, value) in params {
        if value.as_str().is_some_and(|text| text.contains('\n')) {
            *value = "..".into();
        }
    }
    step.to_string()
}

fn contract(contract: &Contract) -> String {
    let promise = match contract {
        Contract::Exact { .. } => "exact".to_owned(),
        Contract::Rounding { k, turned, .. } => match turned {
            None => format!("rounding, k = {k}"),
            Some(turned) => format!("rounding, k = {k}, {turned}"),
        },
        Contract::Approximate { .. } | Contract::Budgets { .. } => {
            let budgets: Vec<String> = contract.budgets().iter().map(Budget::to_string).collect();
            format!("approximate, {}", budgets.join(", "))
        }
    };
    let given: Vec<String> = contract
        .given()
        .iter()
        .map(|a| {
            // The name in plan.json.
            serde_json::to_value(a)
                .ok()
                .and_then(|v| v.as_str().map(str::to_owned))
                .unwrap_or_default()
        })
        .collect();
    match given[..] {
        [] => promise,
        _ => format!("{promise}, given {}", given.join(", ")),
    }
}
