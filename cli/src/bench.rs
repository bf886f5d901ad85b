//! `preshade bench`: (next)

use crate::{Failure, Outcome};

/// Arguments of `bench`.
#[derive(clap::Args)]
pub struct Args {}

/// Runs the yardstick.
pub fn run(_args: &Args) -> Result<Outcome, Failure> {
    Err(Failure("error: not there yet".to_owned()))
}
