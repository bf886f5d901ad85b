//! `preshade passes`: lists the passes and their parameters.

use preshade_compiler::command::passes;

use crate::{Ending, Failure, Format, output};

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

pub fn run(args: &PassesArgs) -> Result<Ending, Failure> {
    let listing = passes::list(args.name.as_deref()).map_err(|e| Failure(format!("error: {e}")))?;
    match args.format {
        Format::Json => output::json(&listing)?,
        Format::Human => output::data(&listing.text())?,
    }
    Ok(Ending::Fine)
}
