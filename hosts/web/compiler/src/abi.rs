//! What JavaScript calls. Each buffer is owned by this module: JavaScript asks for its place, and reads
//! or writes it between two calls.
//!
//! ```text
//! at = room(length);  JavaScript writes the request, UTF-8, at `at`
//! length = answer();  at = answer_at();  JavaScript reads the answer, UTF-8
//! after a trap: length = panicked();  at = panic_at()
//! ```

#![allow(
    unsafe_code,
    reason = "exported names are declared by an unsafe attribute: no other item has these names"
)]

use std::cell::RefCell;
use std::panic;

thread_local! {
    static REQUEST: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
    static ANSWER: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
    static PANIC: RefCell<String> = const { RefCell::new(String::new()) };
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
    panic::set_hook(Box::new(|info| {
        let message = preshade::unstable::panics::in_crate(&info.to_string().replace('\n', " "));
        PANIC.set(message);
    }));
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

/// The length of the message of the panic that ended this instance. 0: there was none.
#[unsafe(no_mangle)]
pub extern "C" fn panicked() -> usize {
    PANIC.with_borrow(String::len)
}

/// The place of that message.
#[unsafe(no_mangle)]
pub extern "C" fn panic_at() -> *const u8 {
    PANIC.with_borrow(|message| message.as_ptr())
}
