//! Ways to break the slicer, so that a test sees who notices. Outside of this crate's own tests it has none.

/// What the slicer forgets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// What decides whether a statement is reached: an early return.
    Control,
    /// What one of the branches that meet wrote.
    Merge,
    /// What a partial write left as it was.
    Under,
    /// What a call writes.
    Callee,
}

#[cfg(not(test))]
pub const fn has(_: Fault) -> bool {
    false
}

#[cfg(test)]
thread_local! {
    static FAULT: std::cell::Cell<Option<Fault>> = const { std::cell::Cell::new(None) };
}

#[cfg(test)]
pub fn has(fault: Fault) -> bool {
    FAULT.get() == Some(fault)
}

/// Runs with a slicer that has the fault, on this thread.
#[cfg(test)]
pub fn with<T>(fault: Fault, run: impl FnOnce() -> T) -> T {
    FAULT.set(Some(fault));
    let ran = run();
    FAULT.set(None);
    ran
}
