//! Values of functions that are called more than once.

use super::authored::{Authored, calls_of};
use super::names::refusal;
use super::refusals;
use crate::analysis::opaque::Opaque;
use preshade_plan::pass::Refusal;

/// The value, if one call alone computes it.
pub(crate) fn single(opaque: &Opaque<'_>, value: Authored) -> Result<Authored, Box<Refusal>> {
    let (Some(entry), Some(function)) = (opaque.fragment, value.function_id()) else {
        return Ok(value);
    };
    // Its role in the dataflow identifies the call.
    if !value.calls.is_empty() {
        return Ok(value);
    }
    let calls = calls_of(&opaque.graph, entry, function);
    if calls.len() < 2 {
        return Ok(value);
    }
    let lines = calls.iter().filter_map(|span| {
        let at = opaque.program.sources().locate(*span)?;
        Some(at.line.to_string())
    });
    let lines: Vec<String> = lines.collect();
    let lines = match lines.is_empty() {
        true => String::new(),
        false => format!(" (lines {})", lines.join(", ")),
    };
    let described = value.described(opaque.program);
    Err(refusal(
        &refusals::SEVERAL_CALLS,
        format!(
            "{described} has a value in each of {} calls{lines}",
            calls.len()
        ),
    ))
}
