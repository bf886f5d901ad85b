//! Parses one WGSL file to a naga module.

use naga::front::wgsl;
use preshade_passes::link::offset;

use super::error::{Code, Error};
use crate::wgsl::subgroups;

/// Parses `text`. Error labels are offset by `base`; the module's spans are not.
pub(super) fn parse(text: &str, base: u32) -> Result<naga::Module, Error> {
    wgsl::parse_str(&subgroups::without(text)).map_err(|e| {
        // naga reports its recursion limit as an internal error without a span.
        if e.message().contains("recursion limit") {
            return Error::new(Code::TooDeep, "expressions are nested too deeply to parse")
                .note("naga's parser stops at 200 levels; move inner parts to variables");
        }
        let mut error = Error::new(Code::Parse, e.message());
        for (span, label) in e.labels() {
            error = error.label(offset(span, base), label);
        }
        for note in e.notes() {
            error = error.note(note);
        }
        error.with_remedy()
    })
}
