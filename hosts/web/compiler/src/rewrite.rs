//! `rewrite`.

use preshade_compiler::command::material::assumed;
use preshade_compiler::command::refusal::rendered;
use preshade_compiler::command::rewrite::{self, Report, Rewritten};
use preshade_compiler::emit::EmitError;
use preshade_compiler::pipeline::{self, Applied, Frame};
use preshade_compiler::recipe::{Recipe, Step};
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_validate::Check;
#[cfg(feature = "check")]
use preshade_validate::{By, Effort, validate_by};
use serde::Serialize;
use shader_text::files::File;
use shader_text::nearest::unknown;

use crate::request::Rewrite;
use crate::{Answer, Failure, Format, pretty};

/// The record, and what only JavaScript reads.
#[derive(Serialize)]
pub struct Variant {
    #[serde(flatten)]
    report: Report,
    /// A refusal each, as a note on the author's source.
    rendered: Vec<String>,
    /// A target each that cannot express the variant.
    failed: Vec<Failed>,
    /// The files, if the caller writes them.
    written: Vec<Written>,
}

#[derive(Serialize)]
struct Failed {
    code: &'static str,
    message: String,
}

#[derive(Serialize)]
struct Written {
    name: String,
    text: String,
}

/// The files that a plan was read from.
pub fn read(plan: &Plan) -> Vec<String> {
    let programs = plan.original.iter().flat_map(|p| p.programs.values());
    let programs = programs.chain(plan.programs.values());
    let files = programs.flat_map(|p| p.sources().files());
    let mut names: Vec<String> = files.map(|f| f.name.clone()).collect();
    names.sort();
    names.dedup();
    names
}

fn targets(names: &[String]) -> Result<Vec<Target>, Failure> {
    let target = |name: &String| {
        Target::from_name(name).ok_or_else(|| {
            let known: Vec<&str> = Target::ALL.iter().map(|t| t.name()).collect();
            Failure::usage(unknown("target", name, &known))
        })
    };
    match names {
        [] => Ok(vec![Target::Wgsl]),
        names => names.iter().map(target).collect(),
    }
}

/// Rewrites a material.
pub fn answer(asked: &Rewrite) -> Result<Answer<Variant>, Failure> {
    let recipe = asked.passes.recipe(&asked.shader)?;
    let targets = targets(&asked.emit)?;
    let made = make(asked, &recipe, &targets);
    match (made, asked.format) {
        // The command line reports a material that it cannot read, beside others.
        (Err(failure), Some(Format::Json)) => unread(&failure),
        (made, _) => made,
    }
}

/// The report of a material that cannot be read.
fn unread(failure: &Failure) -> Result<Answer<Variant>, Failure> {
    let errors = vec![failure.rendered().to_owned()];
    let report = Report::new(Vec::new(), errors.clone());
    Ok(Answer {
        status: 2,
        stdout: Some(pretty(&report)?),
        errors,
        ..Answer::new(Variant {
            report,
            rendered: Vec::new(),
            failed: Vec::new(),
            written: Vec::new(),
        })
    })
}

fn make(asked: &Rewrite, recipe: &Recipe, targets: &[Target]) -> Result<Answer<Variant>, Failure> {
    let shader = &asked.shader;
    let original = shader.plan(None)?;
    let alone = std::slice::from_ref(&original);
    recipe
        .check_names(alone)
        .map_err(|e| Failure::usage(e.to_string()))?;
    if !shader_text::files::is_material_name(&original.material) {
        return Err(Failure::usage(format!(
            "`{}` cannot begin a file name: give another with --name",
            original.material
        )));
    }
    let frame = Frame {
        materials: alone,
        neighbours: alone,
    };
    let mut refused = Vec::new();
    let mut inspect = |_: &Step, plan: &Plan, result: &Applied| {
        refused.extend(result.as_ref().err().map(|refusal| rendered(refusal, plan)));
        true
    };
    let (mut plans, skipped) = pipeline::apply_in(frame, recipe, &Facts::default(), &mut inspect);
    let plan = plans.remove(0);
    let mut messages: Vec<String> = rewrite::removed_discard(&plan).into_iter().collect();
    messages.extend(rewrite::draws_depth_alone(&original));
    messages.extend(refused.iter().cloned());
    messages.extend(rewrite::messages(&plan, true));
    let validation = validated(asked.validate, &original, &plan)?;
    let checks = validation.iter().flatten();
    messages.extend(rewrite::check_messages(&plan.material, "", checks));
    if asked.validate {
        messages.push(format!(
            "note: `{}` is not run on an adapter: none is at hand",
            plan.material
        ));
    }
    let is_broken = validation.iter().flatten().any(|c| c.verdict.is_broken());
    let (files, failed) = match is_broken {
        true => (Vec::new(), Vec::new()),
        false => pipeline::emit(&plan, targets),
    };
    messages.extend(rewrite::added(&plan, &files));
    let mut after = Vec::new();
    if recipe.steps.is_empty() && failed.is_empty() {
        after.push(rewrite::nothing_asked_for(&original));
    }
    let is_written = !files.is_empty() && (asked.out.is_some() || failed.is_empty());
    if is_written && !shader.has_state() && !recipe.steps.is_empty() {
        after.extend(assumed(&original));
    }
    let refusals = skipped.into_iter().map(|s| *s.refusal).collect();
    let rewritten = Rewritten {
        validation,
        ..Rewritten::new(&plan, refusals, &files, asked.out.as_deref())
    };
    let errors: Vec<String> = failed.iter().map(|e| format!("error: {e}")).collect();
    let report = Report::new(vec![rewritten], errors.clone());
    let stdout = match asked.format {
        None => None,
        Some(Format::Json) => Some(pretty(&report)?),
        Some(_) if asked.out.is_some() => Some(String::new()),
        Some(_) => Some(printed(&files)),
    };
    let status = match (errors.is_empty(), is_broken) {
        (false, _) => 2,
        (true, true) => 1,
        (true, false) => 0,
    };
    let variant = Variant {
        report,
        rendered: refused,
        failed: failed.iter().map(failed_target).collect(),
        written: match asked.out {
            Some(_) => files.iter().map(written).collect(),
            None => Vec::new(),
        },
    };
    Ok(Answer {
        status,
        stdout,
        messages,
        after,
        errors,
        read: read(&plan),
        ..Answer::new(variant)
    })
}

/// Holds the variant against the original, if that is asked for.
#[cfg(feature = "check")]
fn validated(is_asked: bool, original: &Plan, plan: &Plan) -> Result<Option<Vec<Check>>, Failure> {
    Ok(is_asked.then(|| {
        let by = By {
            effort: &Effort::default(),
            runner: None,
            told: &|_, _| {},
        };
        validate_by(original, plan, by)
    }))
}

/// As above: this build cannot.
#[cfg(not(feature = "check"))]
fn validated(is_asked: bool, _: &Plan, _: &Plan) -> Result<Option<Vec<Check>>, Failure> {
    match is_asked {
        true => Err(Failure::usage("`validate` needs preshade-full.wasm")),
        false => Ok(None),
    }
}

fn text(file: &File) -> String {
    String::from_utf8_lossy(&file.bytes).into_owned()
}

fn written(file: &File) -> Written {
    Written {
        name: file.name.clone(),
        text: text(file),
    }
}

fn failed_target(error: &EmitError) -> Failed {
    Failed {
        code: error.code(),
        message: error.to_string(),
    }
}

/// The files as the command line prints them.
fn printed(files: &[File]) -> String {
    let text = |file: &File| {
        let text = format!("// {}\n{}", file.name, text(file));
        match text.ends_with('\n') {
            true => text,
            false => text + "\n",
        }
    };
    files.iter().map(text).collect()
}
