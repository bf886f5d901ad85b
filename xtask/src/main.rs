//! Tools of preshade's makers: one file for each command. Data on stdout, messages on stderr.

use std::error::Error;
use std::process::ExitCode;

use clap::Parser;

mod bench;

/// Why a command failed.
type Failure = Box<dyn Error>;

/// Tools of preshade's makers.
#[derive(Parser)]
#[command(max_term_width = 110)]
enum Command {
    Bench(bench::BenchArgs),
}

fn main() -> ExitCode {
    let done = match Command::parse() {
        Command::Bench(args) => bench::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            let mut cause = error.source();
            while let Some(because) = cause {
                eprintln!("  because: {because}");
                cause = because.source();
            }
            ExitCode::from(2)
        }
    }
}

#[test]
fn the_command_line_is_consistent() {
    use clap::CommandFactory;
    Command::command().debug_assert();
}
