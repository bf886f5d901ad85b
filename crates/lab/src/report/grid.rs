//! Rows of cells: aligned for a terminal, joined for a spreadsheet.

use std::borrow::Cow;

use super::control_characters::plain;
use crate::measure::Estimate;

/// A cell of a terminal's table, with the estimate that colours it, if any.
#[derive(Clone, Debug, Default)]
pub(super) struct Cell {
    text: String,
    speedup: Option<Estimate>,
}

impl<T: Into<String>> From<T> for Cell {
    fn from(text: T) -> Self {
        Self {
            text: text.into(),
            speedup: None,
        }
    }
}

impl Cell {
    pub fn speedup(text: String, speedup: Option<Estimate>) -> Self {
        Self { text, speedup }
    }

    /// The cell padded to `width`. With `coloured`, gains beyond noise are green and losses red.
    fn padded(&self, width: usize, is_left: bool, coloured: bool) -> String {
        let Self { text, speedup } = self;
        let padded = match is_left {
            true => format!("{text:<width$}"),
            false => format!("{text:>width$}"),
        };
        let color = match speedup {
            Some(s) if s.high < 1.0 => 31,
            Some(s) if s.low > 1.0 => 32,
            _ if text == "BROKEN" => 31,
            _ => return padded,
        };
        match coloured {
            true => format!("\u{1b}[{color}m{padded}\u{1b}[0m"),
            false => padded,
        }
    }
}

/// The columns that align left, as words do. Numbers align right.
pub(super) type IsLeft = fn(usize) -> bool;

/// The width of each column.
fn widths(rows: &[Vec<Cell>]) -> Vec<usize> {
    let columns = rows.first().map_or(0, Vec::len);
    let width = |c: usize| rows.iter().map(move |r| r[c].text.chars().count());
    (0..columns).map(|c| width(c).max().unwrap_or(0)).collect()
}

/// The rows as lines.
pub(super) fn aligned(rows: &[Vec<Cell>], is_left: IsLeft, coloured: bool) -> String {
    let widths = widths(rows);
    let mut out = String::new();
    for row in rows {
        let cells = row.iter().zip(&widths).enumerate();
        let cells: Vec<String> = cells
            .map(|(c, (cell, width))| cell.padded(*width, is_left(c), coloured))
            .collect();
        out.push_str(cells.join("  ").trim_end());
        out.push('\n');
    }
    out
}

/// The rows with a line of dashes below the first.
pub(super) fn ruled(mut rows: Vec<Vec<Cell>>) -> Vec<Vec<Cell>> {
    let dashes = widths(&rows).into_iter().map(|w| "-".repeat(w).into());
    let dashes = dashes.collect();
    rows.insert(1, dashes);
    rows
}

/// A row of owned cells.
pub(super) fn row<T: Into<Cell>>(cells: impl IntoIterator<Item = T>) -> Vec<Cell> {
    cells.into_iter().map(Into::into).collect()
}

/// The text of an option, or a dash.
pub(super) fn or_dash<T>(value: Option<T>, said: impl FnOnce(T) -> String) -> String {
    value.map_or_else(|| "-".to_owned(), said)
}

/// Lines for a spreadsheet below a header.
pub(super) struct Csv(String);

impl Csv {
    pub fn new(header: &str) -> Self {
        Self(format!("{header}\n"))
    }

    pub fn line(&mut self, cells: impl AsRef<[String]>) {
        self.0.push_str(&cells.as_ref().join(","));
        self.0.push('\n');
    }

    pub fn text(self) -> String {
        self.0
    }
}

/// A number with all its digits; nothing where there is none.
pub(super) fn number(of: Option<f64>) -> String {
    of.map_or_else(String::new, |n| n.to_string())
}

/// Characters that begin a formula, full-width forms too, and characters that a spreadsheet skips
/// before one.
const FORMULAS: [char; 11] = [
    '=', '+', '-', '@', '\t', '\r', '\n', '\u{ff1d}', '\u{ff0b}', '\u{ff0d}', '\u{ff20}',
];

/// A field, quoted by RFC 4180. Text that a spreadsheet would read as a formula gets an apostrophe,
/// because names may come from strangers (OWASP, "CSV Injection").
pub(crate) fn quoted(text: &str) -> String {
    let is_formula = text.trim_start_matches(' ').starts_with(FORMULAS);
    let guard = if is_formula { "'" } else { "" };
    format!("\"{guard}{}\"", plain(text).replace('"', "\"\""))
}

/// Text as SVG has it.
pub(super) fn escaped(text: &str) -> Cow<'_, str> {
    let text = plain(text);
    match text.contains(['&', '<', '>']) {
        false => text,
        true => Cow::Owned(
            text.replace('&', "&amp;")
                .replace('<', "&lt;")
                .replace('>', "&gt;"),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::quoted;

    #[test]
    fn text_is_no_formula() {
        assert_eq!(quoted("a\u{1b}[2J"), "\"a\\u{1b}[2J\"");
        assert_eq!(quoted("say \"a\""), "\"say \"\"a\"\"\"");
        assert_eq!(quoted("=1+1"), "\"'=1+1\"");
        assert_eq!(quoted("  @SUM(a)"), "\"'  @SUM(a)\"");
        assert_eq!(quoted("a-b"), "\"a-b\"");
        // The rest of OWASP's list.
        for first in ["\n=1", "\u{ff1d}1", "\u{ff0b}1", "\u{ff0d}1", "\u{ff20}A"] {
            assert_eq!(quoted(first), format!("\"'{first}\""));
        }
    }
}
