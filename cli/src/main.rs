//! `preshade` at the command line. One file a subcommand; data on stdout, messages on stderr.
//!
//! Exit status: 0 fine (a refusal is fine: the original is kept), 1 a contract broke, 2 bad usage or input.

use std::io::IsTerminal;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use preshade::nearest::nearest;

mod adapters;
mod bench;
mod explain;
mod explore;
mod graph;
mod input;
mod output;
mod passes;
mod plan;
mod rewrite;
mod variable;
mod verify;
mod view;

/// Writes faster variants of a material's shaders, and proves each by picture and clock.
#[derive(Parser)]
#[command(
    name = "preshade",
    version,
    propagate_version = true,
    max_term_width = 110,
    after_help = "\
Examples:
  preshade explain lit.wgsl
  preshade rewrite lit.wgsl --pass depth-prepass --emit wgsl,glsl -o out/
  preshade verify lit.wgsl
  preshade verify scene.toml --pass depth-prepass:form=equal --out report/

Data goes to stdout, messages to stderr.
Exit status: 0 fine (also where a pass is refused: the original is kept), 1 a variant broke its
contract, 2 bad usage or input."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// What applies to a shader, what is refused and why, rates and costs.
    Explain(explain::Args),
    /// The dataflow graph, as dot or JSON.
    Graph(graph::Args),
    /// The passes there are, and the parameters of each.
    Passes(passes::Args),
    /// Rewrites a shader by a recipe of passes.
    Rewrite(rewrite::Args),
    /// Draws a scene (or a bare shader) with the original and its variants: error, time, verdict.
    Verify(verify::Args),
    /// What a scene calls for on this adapter: per material the passes that pay, chosen by measurement.
    Plan(plan::Args),
    /// What accuracy costs in time: the recipes that no other beats in both.
    Explore(explore::Args),
    /// What can be measured on.
    Adapters(adapters::Args),
    /// The frozen hand-written shaders beside what preshade makes of the same forward entry points.
    Bench(bench::Args),
}

/// How a command ended, apart from bad usage or input.
pub enum Outcome {
    /// All is well.
    Fine,
    /// A variant broke its contract.
    ContractBroken,
}

/// Bad usage or input: a message that is already fit to print.
#[derive(Debug)]
pub struct Failure(pub String);

impl Failure {
    /// There is no `what` of that name: the nearest one, and all there are.
    pub fn unknown(what: &str, name: &str, known: &[&str]) -> Self {
        Self(format!("error: {}", unknown(what, name, known)))
    }
}

/// As [`Failure::unknown`], for the argument parser, which says `error:` itself.
pub fn unknown(what: &str, name: &str, known: &[&str]) -> String {
    let near = nearest(name, known.iter().copied())
        .map(|n| format!(" (did you mean `{n}`?)"))
        .unwrap_or_default();
    match known {
        [] => format!("there is no {what} `{name}`: there are none"),
        _ => format!(
            "there is no {what} `{name}`{near}; there are: {}",
            known.join(", ")
        ),
    }
}

impl<E: std::error::Error> From<E> for Failure {
    fn from(error: E) -> Self {
        let mut message = format!("error: {error}");
        let mut source = error.source();
        while let Some(s) = source {
            message.push_str(&format!("\n  because: {s}"));
            source = s.source();
        }
        Self(message)
    }
}

/// Output form of commands that print data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// For reading.
    Human,
    /// For programs.
    Json,
}

/// Whether stderr takes colour.
pub fn color_on_stderr() -> bool {
    std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty()) && std::io::stderr().is_terminal()
}

/// Keeps Mesa's device-select layer from looking for a Wayland display where there is none, which it complains of on stderr: nothing is
/// shown on a screen, and adapters are sorted by kind here.
fn keep_drivers_quiet() {
    const ABOUT_DISPLAYS: [&str; 4] = [
        "XDG_RUNTIME_DIR",
        "WAYLAND_DISPLAY",
        "MESA_VK_DEVICE_SELECT",
        "NODEVICE_SELECT",
    ];
    if cfg!(target_os = "linux") && ABOUT_DISPLAYS.iter().all(|v| std::env::var_os(v).is_none()) {
        // SAFETY: called first thing in `main`, while this is the only thread.
        #[allow(unsafe_code)]
        unsafe {
            std::env::set_var("NODEVICE_SELECT", "1");
        }
    }
}

fn main() -> ExitCode {
    keep_drivers_quiet();
    let result = match Cli::parse().command {
        Command::Explain(a) => explain::run(&a),
        Command::Graph(a) => graph::run(&a),
        Command::Passes(a) => passes::run(&a),
        Command::Rewrite(a) => rewrite::run(&a),
        Command::Verify(a) => verify::run(&a),
        Command::Plan(a) => plan::run(&a),
        Command::Explore(a) => explore::run(&a),
        Command::Adapters(a) => adapters::run(&a),
        Command::Bench(a) => bench::run(&a),
    };
    match result {
        Ok(Outcome::Fine) => ExitCode::SUCCESS,
        Ok(Outcome::ContractBroken) => ExitCode::from(1),
        Err(Failure(message)) => {
            output::message(&message);
            ExitCode::from(2)
        }
    }
}
