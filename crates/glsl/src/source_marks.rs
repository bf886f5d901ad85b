//! Maps the rewritten text back to the author's source.
//!
//! During printing, the text contains marks: a number between two control characters, before each
//! piece with a known source span. [`Marks::settle`] removes them and records their positions.

use naga::Span;

const OPEN: char = '\u{1}';
const CLOSE: char = '\u{2}';

/// The source spans of marks, by number.
#[derive(Clone, Debug, Default)]
pub(super) struct Marks(Vec<Span>);

impl Marks {
    /// Returns the mark to print before text that comes from `place`.
    pub(super) fn mark(&mut self, place: Option<Span>) -> String {
        match place {
            Some(place) => {
                self.0.push(place);
                format!("{OPEN}{}{CLOSE}", self.0.len() - 1)
            }
            None => String::new(),
        }
    }

    /// Removes the marks and returns their positions.
    pub(super) fn settle(&self, marked: &str) -> (String, Map) {
        let mut text = String::with_capacity(marked.len());
        let mut marks = Vec::new();
        let mut rest = marked;
        while let Some((before, after)) = rest.split_once(OPEN) {
            text.push_str(before);
            let (number, after) = after.split_once(CLOSE).unwrap_or((after, ""));
            if let Some(place) = number.parse().ok().and_then(|n: usize| self.0.get(n)) {
                marks.push((text.len() as u32, *place));
            }
            rest = after;
        }
        text.push_str(rest);
        (text, Map(marks))
    }
}

/// `text` without marks.
pub(super) fn unmarked(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut inside = false;
    for c in text.chars() {
        match c {
            OPEN => inside = true,
            CLOSE => inside = false,
            c if !inside => out.push(c),
            _ => {}
        }
    }
    out
}

/// Maps spans of the rewritten text to the source.
#[derive(Clone, Debug, Default)]
pub(super) struct Map(Vec<(u32, Span)>);

impl Map {
    /// The source span of a span of the rewritten text; undefined for generated text.
    pub(super) fn back(&self, span: Span) -> Span {
        let Some(range) = span.to_range() else {
            return span;
        };
        let at = |offset: usize| {
            let next = self.0.partition_point(|(o, _)| *o as usize <= offset);
            self.0.get(next.checked_sub(1)?).map(|(_, place)| *place)
        };
        let Some(first) = at(range.start) else {
            return Span::UNDEFINED;
        };
        let last = at(range.end.saturating_sub(1).max(range.start)).unwrap_or(first);
        match (first.to_range(), last.to_range()) {
            (Some(a), Some(b)) if a.start < b.end && b.end - a.start < 1 << 16 => {
                Span::new(a.start as u32, b.end as u32)
            }
            _ => first,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_go_and_places_stay() {
        let mut marks = Marks::default();
        let a = marks.mark(Some(Span::new(10, 11)));
        let b = marks.mark(Some(Span::new(14, 17)));
        let marked = format!("x = {a}f({b}uv)");
        assert_eq!(unmarked(&marked), "x = f(uv)");
        let (text, map) = marks.settle(&marked);
        assert_eq!(text, "x = f(uv)");
        assert_eq!(map.back(Span::new(4, 9)), Span::new(10, 17));
        assert_eq!(map.back(Span::new(6, 8)), Span::new(14, 17));
        assert_eq!(map.back(Span::new(0, 1)), Span::UNDEFINED);
    }
}
