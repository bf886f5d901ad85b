//! `passes`.

use preshade_compiler::command::passes::{Listing, list};

use crate::request::Passes;
use crate::{Answer, Failure, Format, pretty};

/// Lists the passes.
pub fn answer(asked: &Passes) -> Result<Answer<Listing>, Failure> {
    let listing = list(asked.name.as_deref()).map_err(Failure::usage)?;
    let stdout = match asked.format {
        None => None,
        Some(Format::Json) => Some(pretty(&listing)?),
        Some(_) => Some(listing.text()),
    };
    Ok(Answer {
        stdout,
        ..Answer::new(listing)
    })
}
