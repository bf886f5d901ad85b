//! `preshade` at the command line. One file a subcommand; data on stdout, messages on stderr.
//!
//! Exit status: 0 fine (a refusal is fine: the original is kept), 1 a contract broke, 2 bad usage or input.

use std::io::IsTerminal;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

mod adapters;
mod bench;
mod explain;
mod graph;
mod input;
mod rewrite;
mod verify;

/// Writes faster variants of a material's shaders, and proves each by picture and clock.
#[derive(Parser)]
#[command(
    name = "preshade",
    version,
    about,
    propagate_version = true,
    max_term_width = 110
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
    /// Rewrites a shader by a recipe of passes.
    Rewrite(rewrite::Args),
    /// Draws a scene (or a bare shader) with the original and its variants: error, time, verdict.
    Verify(verify::Args),
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

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Explain(a) => explain::run(&a),
        Command::Graph(a) => graph::run(&a),
        Command::Rewrite(a) => rewrite::run(&a),
        Command::Verify(a) => verify::run(&a),
        Command::Adapters(a) => adapters::run(&a),
        Command::Bench(a) => bench::run(&a),
    };
    match result {
        Ok(Outcome::Fine) => ExitCode::SUCCESS,
        Ok(Outcome::ContractBroken) => ExitCode::from(1),
        Err(Failure(message)) => {
            eprintln!("{}", message.trim_end());
            ExitCode::from(2)
        }
    }
}
