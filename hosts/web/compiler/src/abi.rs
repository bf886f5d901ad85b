//! What JavaScript calls. Each buffer is owned by this module: JavaScript asks for its place, and reads
//! or writes it between two calls.
//!
//! ```text
//! at = room(length);  JavaScript writes the request, UTF-8, at `at`
//! length = answer();  at = answer_at();  JavaScript reads the answer, UTF-8
//! ```

#![allow(
    unsafe_code,
    reason = "exported names are declared by an unsafe attribute: no other item has these names"
)]

use std::cell::RefCell;

thread_local! {
    static REQUEST: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
    static ANSWER: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

/// Makes room for a request of so many bytes, and returns its place.
#[unsafe(no_mangle)]
pub extern "C" fn room(length: usize) -> *mut u8 {
    REQUEST.with_borrow_mut(|request| {
        *request = vec![0; length];
        request.as_mut_ptr()
    })
}

/// Answers the request, and returns the length of the answer.
#[unsafe(no_mangle)]
pub extern "C" fn answer() -> usize {
    let request = REQUEST.take();
    let answer = crate::answer(&request);
    drop(request);
    ANSWER.with_borrow_mut(|kept| {
        *kept = answer.into_bytes();
        kept.len()
    })
}

/// The place of the answer.
#[unsafe(no_mangle)]
pub extern "C" fn answer_at() -> *const u8 {
    ANSWER.with_borrow(|answer| answer.as_ptr())
}
