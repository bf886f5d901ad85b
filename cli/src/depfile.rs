//! `--depfile`: dependencies of the written files, as make rules, which ninja reads too.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use shader_text::files;

use crate::{Failure, output};

/// Written files, and the files that they depend on.
pub type Rule = (Vec<PathBuf>, Vec<PathBuf>);

/// Writes `rules` to a file if they differ from its content, to stdout for `-`, or to a pipe or
/// terminal.
pub fn write(path: &Path, rules: &[Rule]) -> Result<(), Failure> {
    let text = text(rules);
    if path == Path::new("-") {
        return output::data(&text);
    }
    let is_file = fs::metadata(path).map_or(true, |about| about.is_file() || about.is_dir());
    if !is_file {
        // Reading a pipe would wait for ourselves.
        return match fs::write(path, text) {
            Err(e) if e.kind() != ErrorKind::BrokenPipe => {
                Err(Failure(format!("error: {}: {e}", path.display())))
            }
            _ => Ok(()),
        };
    }
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty());
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let file = files::File::text(name, text);
    files::write(folder.unwrap_or(Path::new(".")), &[file])?;
    Ok(())
}

/// One rule a line, and an empty rule for each file that was read, so that make goes on if one is
/// deleted, as with `gcc -MP`.
fn text(rules: &[Rule]) -> String {
    let mut text = String::new();
    let list = |paths: &[PathBuf], place: RulePart| {
        let words: Vec<String> = paths.iter().map(|p| escaped(p, place)).collect();
        words.join(" ")
    };
    for (written, read) in rules {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{}: {}",
            list(written, RulePart::Target),
            list(read, RulePart::Prerequisite)
        );
    }
    let read: BTreeSet<&PathBuf> = rules.iter().flat_map(|(_, read)| read).collect();
    for file in read {
        let _ = writeln!(text, "{}:", escaped(file, RulePart::Target));
    }
    text
}

/// Position of a path in a rule.
#[derive(Clone, Copy, PartialEq, Eq)]
enum RulePart {
    Target,
    Prerequisite,
}

/// A path as make reads it (GNU make, 4.2 "Rule Syntax" and 4.12.1 on `%` in targets).
fn escaped(path: &Path, place: RulePart) -> String {
    let text = path.display().to_string();
    let mut escaped = String::with_capacity(text.len());
    for (at, c) in text.char_indices() {
        // `C:/` is a drive.
        let is_drive = at == 1 && text[2..].starts_with(['/', '\\']);
        match c {
            '$' => escaped.push('$'),
            ' ' | '#' => {
                // Backslashes before it would escape each other.
                let before = text[..at].bytes().rev().take_while(|b| *b == b'\\').count();
                escaped.extend(std::iter::repeat_n('\\', before + 1));
            }
            ':' if !is_drive => escaped.push('\\'),
            '%' if place == RulePart::Target => escaped.push('\\'),
            _ => {}
        }
        escaped.push(c);
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_make_would_read_otherwise_is_escaped() {
        let path = |text: &str| vec![PathBuf::from(text)];
        let rules = [
            (path("out/a b%.wgsl"), path("in/$a%#b:c.wgsl")),
            (path("C:/out/d"), path("in/$a%#b:c.wgsl")),
            (path("out\\e"), path("in\\ f\\g.wgsl")),
        ];
        assert_eq!(
            text(&rules),
            "out/a\\ b\\%.wgsl: in/$$a%\\#b\\:c.wgsl\nC:/out/d: in/$$a%\\#b\\:c.wgsl\n\
             out\\e: in\\\\\\ f\\g.wgsl\nin/$$a\\%\\#b\\:c.wgsl:\nin\\\\\\ f\\g.wgsl:\n"
        );
    }
}
