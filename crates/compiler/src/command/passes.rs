//! The list of passes and their parameters.

use std::fmt::Write;

use preshade_geometry::{PASSES, pass_named};
use serde::Serialize;

use crate::parameters::{Parameter, parameters};
use shader_text::nearest::unknown;

/// The passes, or one of them.
#[derive(Serialize)]
pub struct Listing {
    schema: &'static str,
    passes: Vec<Listed>,
    /// Whether the user named one pass, which is then described in full.
    #[serde(skip)]
    is_one: bool,
}

#[derive(Serialize)]
struct Listed {
    name: &'static str,
    summary: &'static str,
    when: &'static str,
    hurts: &'static str,
    source: &'static str,
    parameters: Vec<Parameter>,
}

/// Lists every pass, or the one of that name.
///
/// # Errors
/// There is no such pass, as a message with the names.
pub fn list(name: Option<&str>) -> Result<Listing, String> {
    if let Some(name) = name
        && pass_named(name).is_none()
    {
        let names: Vec<&str> = PASSES.iter().map(|p| p.info().name).collect();
        return Err(unknown("pass", name, &names));
    }
    let passes = PASSES
        .iter()
        .filter(|p| name.is_none_or(|n| p.info().name == n))
        .map(|p| {
            let info = p.info();
            Listed {
                name: info.name,
                summary: info.summary,
                when: info.when,
                hurts: info.hurts,
                source: info.source,
                parameters: parameters(*p),
            }
        });
    Ok(Listing {
        schema: "preshade.passes.v1",
        passes: passes.collect(),
        is_one: name.is_some(),
    })
}

impl Listing {
    /// The list as text.
    pub fn text(&self) -> String {
        if self.is_one {
            return self.passes.iter().map(details).collect();
        }
        let mut text = String::new();
        for p in &self.passes {
            let _ = writeln!(text, "{:<18} {}", p.name, p.summary);
        }
        text + "\n`preshade passes NAME` shows the parameters of one.\n"
    }
}

fn details(pass: &Listed) -> String {
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
