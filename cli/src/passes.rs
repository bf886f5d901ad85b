//! `preshade passes`: lists the passes and their parameters.

use std::fmt::Write;

use preshade::unstable::parameters::{Parameter, parameters};
use preshade::unstable::passes::{PASSES, pass_named};
use serde::Serialize;

use crate::output;
use crate::{Ending, Failure, Format};

/// Arguments of `passes`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade passes                          every pass in a line
  preshade passes depth-prepass            one pass and its parameters
  preshade passes --format json            all of it, for programs")]
pub struct PassesArgs {
    /// Show this pass with its parameters; default: every pass in a line.
    #[arg(value_name = "NAME")]
    name: Option<String>,
    /// Output form.
    #[arg(long, value_enum, default_value_t = Format::Human)]
    format: Format,
}

#[derive(Serialize)]
struct Listing {
    schema: &'static str,
    passes: Vec<PassListed>,
}

#[derive(Serialize)]
struct PassListed {
    name: &'static str,
    summary: &'static str,
    when: &'static str,
    hurts: &'static str,
    source: &'static str,
    parameters: Vec<Parameter>,
}

/// Lists the passes.
pub fn run(args: &PassesArgs) -> Result<Ending, Failure> {
    if let Some(name) = &args.name
        && pass_named(name).is_none()
    {
        let names: Vec<&str> = PASSES.iter().map(|p| p.info().name).collect();
        return Err(Failure::unknown("pass", name, &names));
    }
    let passes: Vec<PassListed> = PASSES
        .iter()
        .filter(|p| args.name.as_ref().is_none_or(|n| p.info().name == n))
        .map(|p| {
            let info = p.info();
            PassListed {
                name: info.name,
                summary: info.summary,
                when: info.when,
                hurts: info.hurts,
                source: info.source,
                parameters: parameters(*p),
            }
        })
        .collect();
    match (args.format, &args.name) {
        (Format::Json, _) => output::json(&Listing {
            schema: "preshade.passes.v1",
            passes,
        })?,
        (Format::Human, None) => {
            let mut text = String::new();
            for p in &passes {
                let _ = writeln!(text, "{:<18} {}", p.name, p.summary);
            }
            text.push_str("\n`preshade passes NAME` shows the parameters of one.\n");
            output::data(&text)?;
        }
        (Format::Human, Some(_)) => {
            for p in &passes {
                output::data(&details(p))?;
            }
        }
    }
    Ok(Ending::Fine)
}

fn details(pass: &PassListed) -> String {
    let mut text = format!(
        "{}\n  {}\n  take it where {}\n  hurts {}\n  source: {}\n",
        pass.name, pass.summary, pass.when, pass.hurts, pass.source
    );
    let (experts, usual): (Vec<&Parameter>, Vec<&Parameter>) =
        pass.parameters.iter().partition(|p| p.expert);
    for p in usual {
        let kind = match &p.kind {
            Some(kind) if p.choices.is_empty() => format!("={kind}"),
            _ => String::new(),
        };
        let range = p.range.map_or(String::new(), |r| format!(" ({r})"));
        let _ = writeln!(text, "\n  {}{kind}{range}\n      {}", p.name, p.what);
        for c in &p.choices {
            let default = if p.default.as_ref().and_then(|d| d.as_str()) == Some(&c.value) {
                " (the default)"
            } else {
                ""
            };
            let _ = writeln!(text, "      {:<12} {}{default}", c.value, c.what);
        }
        if let Some(default) = &p.default
            && p.choices.is_empty()
        {
            let _ = writeln!(text, "      default: {default}");
        }
    }
    if !experts.is_empty() {
        let experts: Vec<String> = experts.iter().map(|p| p.in_short()).collect();
        let _ = writeln!(
            text,
            "\n  expert parameters, for tests and unusual devices:\n      {}",
            experts.join(", ")
        );
    }
    let _ = writeln!(
        text,
        "\nAs in: --pass {}{}",
        pass.name,
        example(&pass.parameters)
    );
    text
}

/// `:name=value` with the first choice that is not the default.
fn example(parameters: &[Parameter]) -> String {
    parameters
        .iter()
        .filter(|p| p.default.is_some())
        .find_map(|p| {
            let other = p
                .choices
                .iter()
                .find(|c| p.default.as_ref().and_then(|d| d.as_str()) != Some(&c.value))?;
            Some(format!(":{}={}", p.name, other.value))
        })
        .unwrap_or_default()
}
