//! preshade's compiler as WebAssembly: a request in JSON becomes an answer in JSON.
//!
//! The answers are those of the command line ([`preshade_compiler::command`]), with what it would
//! print, so that the package's own command line prints the same.
//!
//! The package has two builds. A page that rewrites loads the one without the feature `check`, which is a
//! tenth smaller. The other is loaded with the first call that needs it.

#![cfg_attr(
    not(feature = "check"),
    allow(dead_code, reason = "what only `agree` asks of a shader")
)]

mod abi;
#[cfg(feature = "check")]
mod agree;
mod explain;
mod failure;
mod graph;
mod passes;
mod request;
mod rewrite;

use serde::Serialize;

use failure::Failure;
use request::{Format, Request};

/// The answer to a request.
#[derive(Serialize)]
struct Answer<R: Serialize> {
    /// The exit status of the command line: 0, or 1 if a relation or a contract is broken, 2 if a part
    /// failed, 3 if a part was not evaluated.
    status: u8,
    /// The record.
    report: R,
    /// What the command line prints to stdout, if a format was asked for.
    stdout: Option<String>,
    /// What it prints to stderr: notes and warnings, before and after it writes files.
    messages: Vec<String>,
    after: Vec<String>,
    /// Errors of a part.
    errors: Vec<String>,
    /// Files that were read, as they are named in messages.
    read: Vec<String>,
}

impl<R: Serialize> Answer<R> {
    fn new(report: R) -> Self {
        Self {
            status: 0,
            report,
            stdout: None,
            messages: Vec::new(),
            after: Vec::new(),
            errors: Vec::new(),
            read: Vec::new(),
        }
    }
}

/// A record as the command line prints it.
fn pretty(report: &impl Serialize) -> Result<String, Failure> {
    let text = serde_json::to_string_pretty(report);
    text.map(|text| text + "\n")
        .map_err(|e| Failure::usage(e.to_string()))
}

/// The JSON of an answer or of an error.
fn written<R: Serialize>(answer: Result<Answer<R>, Failure>) -> String {
    #[derive(Serialize)]
    struct Failed {
        error: Failure,
    }
    let text = match answer {
        Ok(answer) => serde_json::to_string(&answer),
        Err(error) => serde_json::to_string(&Failed { error }),
    };
    // A map whose keys are no text has no JSON; the records have none.
    text.unwrap_or_else(|e| format!("{{\"error\":{{\"code\":\"usage\",\"message\":\"{e}\"}}}}"))
}

/// Answers a request.
fn answer(request: &[u8]) -> String {
    let request = Request::read(request);
    match request.map_err(|e| Failure::usage(format!("the request: {e}"))) {
        Ok(Request::Rewrite(asked)) => written(rewrite::answer(&asked)),
        Ok(Request::Explain(asked)) => written(explain::answer(&asked)),
        #[cfg(feature = "check")]
        Ok(Request::Agree(asked)) => written(agree::answer(&asked)),
        Ok(Request::Graph(asked)) => written(graph::answer(&asked)),
        Ok(Request::Passes(asked)) => written(passes::answer(&asked)),
        Err(failure) => written::<()>(Err(failure)),
    }
}
