//! Runs naga where neither its recursion nor its panics can take the process down.

use std::cell::RefCell;
use std::panic;
use std::sync::Once;

/// Stack of the thread naga runs on. Its front and back ends recurse once a nesting level; [`super::nesting`] bounds the levels, this
/// bounds what a level may cost. Only touched pages are ever backed by memory.
const STACK: usize = 256 << 20;

/// naga panicked; the message and where.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub(crate) struct Panicked(pub String);

thread_local! {
    /// On a guarded thread: the panic's message, once there is one. `None` leaves panics to the process's own hook.
    static CAUGHT: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Calls `work` on a thread of its own with a large stack and turns a panic into a value, printing nothing.
pub(crate) fn run<T: Send>(work: impl FnOnce() -> T + Send) -> Result<T, Panicked> {
    install_hook();
    let caught = || CAUGHT.with_borrow_mut(Option::take).unwrap_or_default();
    let result = std::thread::scope(|scope| {
        let thread = std::thread::Builder::new()
            .name("preshade-naga".to_owned())
            .stack_size(STACK)
            .spawn_scoped(scope, || {
                CAUGHT.with_borrow_mut(|c| *c = Some(String::new()));
                panic::catch_unwind(panic::AssertUnwindSafe(work)).map_err(|_| caught())
            });
        match thread {
            Ok(thread) => thread
                .join()
                .unwrap_or_else(|_| Err("the guarded thread died".to_owned())),
            Err(e) => Err(format!("no thread with a {STACK}-byte stack: {e}")),
        }
    });
    result.map_err(Panicked)
}

/// A panic hook that is silent on guarded threads and passes every other panic on to the hook it found. It is installed once and stays:
/// taking it out again would race with other threads that set theirs.
fn install_hook() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let previous = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            let ours = CAUGHT.with_borrow_mut(|c| match c {
                Some(message) => {
                    *message = info.to_string().replace('\n', " ");
                    true
                }
                None => false,
            });
            if !ours {
                previous(info);
            }
        }));
    });
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic)]
    use super::*;

    #[test]
    fn a_value_comes_back() {
        assert_eq!(run(|| 7), Ok(7));
    }

    #[test]
    fn a_panic_is_a_value_that_names_its_place() {
        let error = run(|| -> u32 { panic!("index {} of {}", 3, 2) }).unwrap_err();
        assert!(error.0.contains("index 3 of 2"), "{error}");
        assert!(error.0.contains("guard.rs"), "{error}");
    }

    #[test]
    fn deep_recursion_has_room() {
        fn depth(n: u32) -> u32 {
            let pad = std::hint::black_box([n; 64]);
            if n == 0 { 0 } else { 1 + depth(pad[0] - 1) }
        }
        assert_eq!(run(|| depth(100_000)), Ok(100_000));
    }
}
