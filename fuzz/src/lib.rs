//! The targets, and the seeds of their corpora.

#[path = "../../tests/it/fuzz_support/mod.rs"]
pub mod support;

use std::sync::Once;

use arbitrary::{Arbitrary, Unstructured};
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// A module made of bytes by naga's own `Arbitrary`: few are valid, and those are written and read
/// back.
pub fn module(data: &[u8]) {
    let Ok(module) = naga::Module::arbitrary(&mut Unstructured::new(data)) else {
        return;
    };
    // What naga itself cannot take is its own fuzzers' to find.
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            let by_naga = info.location().is_some_and(|l| l.file().contains("/naga-"));
            if !by_naga {
                before(info);
            }
        }));
    });
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::default());
    let valid = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        validator.validate(&module).is_ok()
    }));
    if !valid.unwrap_or(false) {
        return;
    }
    support::whole(module);
}
