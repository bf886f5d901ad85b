//! Runs naga so that neither its recursion nor its panics abort the process.

use std::cell::RefCell;
use std::panic;
use std::sync::Once;

/// Stack size for naga, which recurses once per nesting level. `front::nesting` bounds the levels,
/// and the system only commits pages that are used. WebAssembly has a single stack, whose size the
/// linker sets: a second one would come out of the heap and never be returned.
const STACK: usize = 256 << 20;

/// naga panicked: its message and location.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Panicked(pub String);

thread_local! {
    /// The message of a caught panic. `None` outside of a guard.
    static CAUGHT: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Runs `work` on a large stack, and converts a panic to an error without printing it. Stays on the
/// caller's thread, because starting one takes longer than reading a small shader.
pub fn run<T>(work: impl FnOnce() -> T) -> Result<T, Panicked> {
    match cfg!(target_family = "wasm") {
        true => caught(work),
        false => stacker::grow(STACK, || caught(work)),
    }
}

/// Converts a panic of `work` to an error without printing it. A program that is built to abort on
/// panics still ends, and its own hook prints the reason.
pub fn caught<T>(work: impl FnOnce() -> T) -> Result<T, Panicked> {
    if cfg!(not(panic = "unwind")) {
        return Ok(work());
    }
    install_hook();
    let outer = CAUGHT.replace(Some(String::new()));
    let result = panic::catch_unwind(panic::AssertUnwindSafe(work));
    let message = CAUGHT.replace(outer).unwrap_or_default();
    result.map_err(|_| Panicked(message))
}

/// Installs a panic hook once. It is silent inside of a guard and calls the previous hook
/// elsewhere. Removing it would race with other threads.
fn install_hook() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let previous = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            let ours = CAUGHT.with_borrow_mut(|c| match c {
                Some(message) => {
                    *message = in_crate(&info.to_string().replace('\n', " "));
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

/// Cuts paths of the build machine: they start at the crate's folder.
fn in_crate(message: &str) -> String {
    let word = |word: &str| {
        let path = word.replace('\\', "/");
        match path.rfind("/src/") {
            Some(source) if path.contains(".rs") => {
                let start = path[..source].rfind('/').map_or(0, |slash| slash + 1);
                path[start..].to_owned()
            }
            _ => word.to_owned(),
        }
    };
    message.split(' ').map(word).collect::<Vec<_>>().join(" ")
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
        assert!(error.0.contains("panics.rs"), "{error}");
    }

    #[test]
    fn no_path_of_the_build_machine_is_told() {
        let message = "panicked at /home/me/.cargo/registry/src/i-1/naga-30/src/back/a.rs:5:6: x/y";
        let short = "panicked at naga-30/src/back/a.rs:5:6: x/y";
        assert_eq!(in_crate(message), short);
        assert_eq!(
            in_crate(r"at C:\b\naga\src\a.rs:5:6:"),
            "at naga/src/a.rs:5:6:"
        );
        assert_eq!(in_crate("at src/panics.rs:1:2:"), "at src/panics.rs:1:2:");
    }

    #[test]
    fn guards_nest() {
        let outer = run(|| {
            let inner = run(|| -> u32 { panic!("inner") });
            assert!(inner.unwrap_err().0.contains("inner"));
            panic!("outer")
        });
        let outer: Result<u32, Panicked> = outer;
        assert!(outer.unwrap_err().0.contains("outer"));
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
