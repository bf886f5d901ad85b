//! Splits a trace into actions without reading it whole.

use std::io::BufRead;

use super::TraceError;
use shader_text::limits::Limits;

pub(super) struct Element {
    pub text: String,
    /// Its first line in the file, from 1.
    pub line: usize,
}

/// Iterates over the elements of a RON list.
pub(super) struct Elements<R> {
    input: R,
    limits: Limits,
    line: usize,
    has_begun: bool,
    /// Whether the list was closed. A trace that was cut short lacks its end.
    pub is_closed: bool,
}

/// State of the scan between two bytes.
#[derive(Default)]
struct TextState {
    depth: usize,
    is_text: bool,
    is_escaped: bool,
}

impl TextState {
    /// Whether the byte ends an element of the list.
    fn ends(&mut self, byte: u8) -> bool {
        if self.is_text {
            match byte {
                _ if self.is_escaped => self.is_escaped = false,
                b'\\' => self.is_escaped = true,
                b'"' => self.is_text = false,
                _ => {}
            }
            return false;
        }
        match byte {
            b'"' => self.is_text = true,
            b'(' | b'[' | b'{' => self.depth += 1,
            b')' | b'}' => self.depth = self.depth.saturating_sub(1),
            b']' if self.depth == 0 => return true,
            b']' => self.depth -= 1,
            b',' => return self.depth == 0,
            _ => {}
        }
        false
    }
}

impl<R: BufRead> Elements<R> {
    pub fn new(input: R, limits: &Limits) -> Self {
        Self {
            input,
            limits: *limits,
            line: 1,
            has_begun: false,
            is_closed: false,
        }
    }

    /// The next element. An element that is cut off at the end of the file does not count.
    pub fn next(&mut self) -> Result<Option<Element>, TraceError> {
        let mut bytes = Vec::new();
        let mut place = TextState::default();
        let mut first_line = self.line;
        while !self.is_closed {
            let input = self.input.fill_buf().map_err(TraceError::Io)?;
            if input.is_empty() {
                return Ok(None);
            }
            let (mut used, mut is_whole) = (0, false);
            for &byte in input {
                used += 1;
                self.line += usize::from(byte == b'\n');
                if !self.has_begun {
                    match byte {
                        b'[' => self.has_begun = true,
                        _ if byte.is_ascii_whitespace() => {}
                        _ => return Err(TraceError::NoTrace("it does not begin with `[`")),
                    }
                    continue;
                }
                if place.ends(byte) {
                    self.is_closed = byte == b']';
                    is_whole = true;
                    break;
                }
                if bytes.is_empty() {
                    if byte.is_ascii_whitespace() {
                        continue;
                    }
                    first_line = self.line;
                }
                bytes.push(byte);
            }
            self.input.consume(used);
            let length = bytes.len() as u64;
            self.limits
                .check("file-bytes", length, "the bytes of an action")?;
            if is_whole && !bytes.is_empty() {
                let line = first_line;
                let text = String::from_utf8(std::mem::take(&mut bytes));
                let text = text.map_err(|_| TraceError::Action {
                    action: "?".to_owned(),
                    line,
                    why: "it is not UTF-8 text".to_owned(),
                })?;
                return Ok(Some(Element { text, line }));
            }
        }
        Ok(None)
    }
}
