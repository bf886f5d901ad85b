//! Faults for mutation tests of the slicer. Other builds have none.

/// A dependence that the faulty slicer ignores.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Control dependence: an early return.
    Control,
    /// A write in one of the merged branches.
    Merge,
    /// The part that a partial write preserves.
    Under,
    /// A callee's writes.
    Callee,
}

#[cfg(not(any(test, feature = "faulty-slicer")))]
/// Whether the slicer has this fault.
pub const fn has(_: Fault) -> bool {
    false
}

#[cfg(any(test, feature = "faulty-slicer"))]
thread_local! {
    static FAULT: std::cell::Cell<Option<Fault>> = const { std::cell::Cell::new(None) };
}

#[cfg(any(test, feature = "faulty-slicer"))]
/// Whether the slicer has this fault.
pub(crate) fn has(fault: Fault) -> bool {
    FAULT.get() == Some(fault)
}

/// Runs with a faulty slicer on this thread.
#[cfg(any(test, feature = "faulty-slicer"))]
pub fn with<T>(fault: Fault, run: impl FnOnce() -> T) -> T {
    FAULT.set(Some(fault));
    let ran = run();
    FAULT.set(None);
    ran
}
