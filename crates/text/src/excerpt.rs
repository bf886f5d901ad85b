//! Excerpts of files for errors. Long lines, such as those of minified shaders, are cut around the
//! reported places.

use std::ops::Range;

use codespan_reporting::files::{Error, Files, SimpleFile};

/// Lines with more bytes are cut.
const LONGEST: usize = 500;
/// Bytes to show on either side of a place.
const AROUND: usize = 100;
const MORE: &str = "\u{2026}";

/// A line that was cut.
struct Cut {
    line: Range<usize>,
    /// The part of the line that is shown.
    shown: Range<usize>,
    /// Offset of this part in the excerpt.
    at: usize,
    /// Line number, from 0.
    index: usize,
    /// Characters that are left out before the shown part.
    ahead: usize,
}

#[derive(Default)]
pub struct Excerpts(Vec<(SimpleFile<String, String>, Vec<Cut>)>);

impl Excerpts {
    /// Adds a file with the `places` to show.
    pub fn add(&mut self, name: String, text: &str, places: &[Range<usize>]) {
        let mut out = String::with_capacity(text.len());
        let mut cuts = Vec::new();
        let mut start = 0;
        for (index, whole) in text.split_inclusive('\n').enumerate() {
            let line = start..start + whole.trim_end_matches(['\n', '\r']).len();
            start += whole.len();
            if line.len() <= LONGEST {
                out.push_str(whole);
                continue;
            }
            let here = places
                .iter()
                .find(|p| line.contains(&p.start) || p.start == line.end);
            let (from, to) = match here {
                Some(place) => (
                    place.start.saturating_sub(AROUND).max(line.start),
                    place.end.min(place.start + AROUND) + AROUND,
                ),
                None => (line.start, line.start + AROUND),
            };
            let shown = text.floor_char_boundary(from)..text.ceil_char_boundary(to.min(line.end));
            let is_cut = shown.start > line.start;
            out.push_str(if is_cut { MORE } else { "" });
            cuts.push(Cut {
                at: out.len(),
                index,
                ahead: text[line.start..shown.start].chars().count() - usize::from(is_cut),
                line: line.clone(),
                shown: shown.clone(),
            });
            out.push_str(&text[shown.clone()]);
            out.push_str(if shown.end < line.end { MORE } else { "" });
            out.push_str(&text[line.end..start]);
        }
        self.0.push((SimpleFile::new(name, out), cuts));
    }

    /// Converts a place in a file to its place in the excerpt. If it is not shown, takes the
    /// nearest one.
    pub fn place(&self, id: usize, place: Range<usize>) -> Range<usize> {
        let cuts = self.0.get(id).map_or(&[][..], |(_, cuts)| cuts);
        let to = |at: usize| {
            let next = cuts.partition_point(|c| c.line.start <= at);
            let Some(cut) = next.checked_sub(1).map(|n| &cuts[n]) else {
                return at;
            };
            let end = cut.at + cut.shown.len();
            match at <= cut.line.end {
                true => cut.at + at.clamp(cut.shown.start, cut.shown.end) - cut.shown.start,
                false => {
                    let more = if cut.shown.end < cut.line.end {
                        MORE.len()
                    } else {
                        0
                    };
                    end + more + at - cut.line.end
                }
            }
        };
        to(place.start)..to(place.end)
    }

    fn file(&self, id: usize) -> Result<&(SimpleFile<String, String>, Vec<Cut>), Error> {
        self.0.get(id).ok_or(Error::FileMissing)
    }
}

impl<'a> Files<'a> for Excerpts {
    type FileId = usize;
    type Name = &'a str;
    type Source = &'a str;

    fn name(&'a self, id: usize) -> Result<&'a str, Error> {
        Ok(self.file(id)?.0.name())
    }

    fn source(&'a self, id: usize) -> Result<&'a str, Error> {
        Ok(self.file(id)?.0.source())
    }

    fn line_index(&'a self, id: usize, at: usize) -> Result<usize, Error> {
        self.file(id)?.0.line_index((), at)
    }

    fn line_range(&'a self, id: usize, line: usize) -> Result<Range<usize>, Error> {
        self.file(id)?.0.line_range((), line)
    }

    fn column_number(&'a self, id: usize, line: usize, at: usize) -> Result<usize, Error> {
        let (file, cuts) = self.file(id)?;
        let ahead = cuts.iter().find(|c| c.index == line).map_or(0, |c| c.ahead);
        Ok(file.column_number((), line, at)? + ahead)
    }
}

/// A text with its long lines cut at their ends.
pub(crate) fn short_lines(text: &str) -> String {
    let cut = |line: &str| match line.len() <= LONGEST {
        true => line.to_owned(),
        false => format!("{}{MORE}", &line[..line.floor_char_boundary(2 * AROUND)]),
    };
    text.split('\n').map(cut).collect::<Vec<_>>().join("\n")
}
