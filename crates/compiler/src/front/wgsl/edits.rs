//! Replacements in a text, and the way back to the places that they replaced.

use std::ops::Range;

/// Replacements of parts of one text, in order. None overlap.
#[derive(Clone, Debug, Default)]
pub(super) struct Edits(Vec<(Range<usize>, String)>);

impl Edits {
    /// Replaces a part of the text. Earlier edits inside of it are dropped. An empty part inserts.
    pub(super) fn replace(&mut self, part: Range<usize>, by: impl Into<String>) {
        self.0
            .retain(|(old, _)| old.end <= part.start || old.start >= part.end);
        let at = self.0.partition_point(|(old, _)| old.start < part.start);
        self.0.insert(at, (part, by.into()));
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn applied(&self, text: &str) -> String {
        let mut out = String::with_capacity(text.len());
        let mut copied = 0;
        for (part, by) in &self.0 {
            out.push_str(&text[copied..part.start]);
            out.push_str(by);
            copied = part.end;
        }
        out.push_str(&text[copied..]);
        out
    }

    /// The part of the text that a part of the edited text stands for.
    pub(super) fn back(&self, part: Range<usize>) -> Range<usize> {
        let start = self.place(part.start, false);
        start..self.place(part.end, true).max(start)
    }

    /// The place in the original text. For a place inside a replacement, it is the start or the end
    /// of the replaced part.
    fn place(&self, at: usize, is_end: bool) -> usize {
        let (mut longer, mut shorter) = (0, 0);
        for (part, by) in &self.0 {
            let start = part.start + longer - shorter;
            let end = start + by.len();
            if at < start || is_end && at == start {
                break;
            }
            if at < end || is_end && at == end {
                return if is_end { part.end } else { part.start };
            }
            longer += by.len();
            shorter += part.len();
        }
        at + shorter - longer
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_found_again() {
        let text = "a = mix(1, f(2), 3); b";
        let mut edits = Edits::default();
        edits.replace(11..15, "7");
        assert_eq!(edits.applied(text), "a = mix(1, 7, 3); b");
        assert_eq!(edits.back(4..16), 4..19);
        assert_eq!(edits.back(11..12), 11..15);
        edits.replace(4..19, "(0.25)");
        edits.replace(0..0, "@x ");
        let edited = edits.applied(text);
        assert_eq!(edited, "@x a = (0.25); b");
        for (word, place) in [("a", 0..1), ("(0.25)", 4..19), ("25", 4..19), ("b", 21..22)] {
            let at = edited.find(word).unwrap_or_default();
            assert_eq!(edits.back(at..at + word.len()), place, "{word}");
        }
    }
}
