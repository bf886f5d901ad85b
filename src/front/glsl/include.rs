//! The files that a text includes: where they are looked up, how far they may reach, and that they come to an end.

use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::io;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use glsl_lang_pp::processor::fs::FileSystem;
use naga::ShaderStage;

use super::pasted::{UNENDED, ended};
use super::rescan::{Macros, Rewritten};
use crate::front::Options;
use crate::limits::Limits;
use crate::regular;

/// Most times that files are included, one within another and one after another.
const INCLUDES: u64 = 10_000;

/// Files that a text includes: beside it, or below one of the include paths.
pub(super) struct Files {
    include: Vec<PathBuf>,
    /// See [`Options::root`].
    root: Option<PathBuf>,
    /// Of which the bytes of one file.
    limits: Limits,
    /// The lines of another stage are left blank in what is included too.
    stage: ShaderStage,
    /// What was read, by the path where it was found.
    pub read: Rc<RefCell<HashMap<PathBuf, String>>>,
    /// Where a file was found, by the path that was asked for.
    pub found: Rc<RefCell<HashMap<PathBuf, PathBuf>>>,
    /// What a file that was found is called: as it was asked for where it is there, so that messages say what the author wrote.
    pub shown: Rc<RefCell<HashMap<PathBuf, PathBuf>>>,
    /// Where a file was looked for in vain before it was found.
    pub absent: Rc<RefCell<BTreeSet<PathBuf>>>,
    /// The macros of all of it.
    macros: Macros,
    /// What the preprocessor was given in place of what was read.
    pub rewritten: Rc<RefCell<HashMap<PathBuf, Rewritten>>>,
}

fn refused(message: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, message)
}

/// How often a file is included by what includes it: `None` while that is being counted.
type Counted = BTreeMap<PathBuf, Option<u64>>;

impl Files {
    pub fn new(options: &Options, stage: ShaderStage) -> Self {
        Self {
            include: options.include.clone(),
            root: options.root.clone(),
            limits: options.limits,
            stage,
            read: Rc::default(),
            found: Rc::default(),
            shown: Rc::default(),
            absent: Rc::default(),
            macros: Macros::default(),
            rewritten: Rc::default(),
        }
    }

    /// Checks that what `text` includes comes to an end, whatever its conditions say: the preprocessor itself does not ask. What is to be preprocessed in place of `text`.
    ///
    /// # Errors
    /// A file that includes itself without a guard, or too many inclusions. What is not there is the preprocessor's to tell, where it is not left out.
    pub fn check(&mut self, text: &str, folder: &Path) -> io::Result<Option<Rewritten>> {
        let mut counted = Counted::new();
        self.count(text, folder, &mut counted)?;
        // A guard that any of the files takes back is none: then it is as if each were unguarded.
        if let Some(name) = self.taken_back(text, &counted)? {
            return Err(refused(format!(
                "a file includes itself behind `#ifndef {name}`, and `#undef {name}` takes that back: nothing is seen to end it"
            )));
        }
        let mut texts = vec![Cow::Borrowed(text)];
        for found in counted.keys() {
            texts.push(Cow::Owned(self.text(found)?));
        }
        self.macros = Macros::of(&texts);
        Ok(self.macros.rewrite(text))
    }

    /// The name that guards a file which includes itself, below it or at once, and that some text undefines.
    fn taken_back(&self, text: &str, counted: &Counted) -> io::Result<Option<String>> {
        let mut undefined = undefined(text);
        let mut guards = Vec::new();
        for found in counted.keys() {
            let inner = self.text(found)?;
            undefined.extend(self::undefined(&inner));
            guards.extend(guard(&inner).map(|name| (found, name)));
        }
        for (found, name) in guards {
            if undefined.contains(&name) && self.reaches(found, found)? {
                return Ok(Some(name));
            }
        }
        Ok(None)
    }

    /// Whether what `from` includes, at whatever remove, is `to`.
    fn reaches(&self, from: &Path, to: &Path) -> io::Result<bool> {
        let mut seen = BTreeSet::new();
        let mut left = vec![from.to_owned()];
        while let Some(file) = left.pop() {
            let folder = file.parent().unwrap_or(Path::new("")).to_owned();
            for name in included(&self.text(&file)?)? {
                let Ok(found) = self.find(&folder.join(name)) else {
                    continue;
                };
                if found == to {
                    return Ok(true);
                }
                if seen.insert(found.clone()) {
                    left.push(found);
                }
            }
        }
        Ok(false)
    }

    /// Inclusions below a text, its files' own among them.
    fn count(&self, text: &str, folder: &Path, counted: &mut Counted) -> io::Result<u64> {
        let mut all: u64 = 0;
        for name in included(text)? {
            let path = folder.join(&name);
            let Ok(found) = self.find(&path) else {
                continue;
            };
            let below = match counted.get(&found) {
                Some(known) => {
                    let inner = self.text(&found)?;
                    match (guard(&inner).is_some(), known) {
                        (true, _) => 1,
                        (false, Some(n)) => *n,
                        (false, None) => {
                            return Err(refused(format!(
                                "{} includes itself, and nothing ends it (#ifndef and #define first would)",
                                path.display()
                            )));
                        }
                    }
                }
                None => {
                    counted.insert(found.clone(), None);
                    let inner = self.text(&found)?;
                    let parent = path.parent().unwrap_or(Path::new(""));
                    let n = 1 + self.count(&inner, parent, counted)?;
                    counted.insert(found, Some(n));
                    n
                }
            };
            all = all.saturating_add(below);
            if all > INCLUDES || counted.len() as u64 > INCLUDES {
                return Err(refused(format!(
                    "files are included more than {INCLUDES} times"
                )));
            }
        }
        Ok(all)
    }

    /// The file meant by `path`, which is the including file's folder with what stands in quotes: of its endings, the longest that an include path has.
    fn find(&self, path: &Path) -> io::Result<PathBuf> {
        let beside = match &self.root {
            Some(root) => root.join(path),
            None => path.to_owned(),
        };
        let mut ending = path;
        let mut found = beside.canonicalize();
        let is_there = |path: &PathBuf| {
            let is_there = path.exists();
            if !is_there {
                self.absent.borrow_mut().insert(path.clone());
            }
            is_there
        };
        if found.is_err() {
            is_there(&beside);
        }
        while found.is_err() {
            let below = |d: &PathBuf| d.join(ending);
            if let Some(hit) = self.include.iter().map(below).find(is_there) {
                found = hit.canonicalize();
                break;
            }
            let mut parts = ending.components();
            if parts.next().is_none() || parts.as_path().as_os_str().is_empty() {
                return Err(io::Error::new(
                    io::ErrorKind::NotFound,
                    format!("there is no file {}", path.display()),
                ));
            }
            ending = parts.as_path();
        }
        let found = found?;
        match &self.root {
            Some(root) if !found.starts_with(root) => Err(io::Error::new(
                io::ErrorKind::PermissionDenied,
                format!("{} lies outside of the root folder", path.display()),
            )),
            _ => Ok(found),
        }
    }

    /// A file's text, if it is one and not too large.
    fn text(&self, found: &Path) -> io::Result<String> {
        let text = regular::text(found, &self.limits, "source-bytes").map_err(|e| match e {
            regular::Error::Io(e) => e,
            regular::Error::TooLarge(e) => refused(e.to_string()),
            other => refused(format!("{}: {other}", found.display())),
        })?;
        let text = ended(Cow::Owned(text));
        let text = text.ok_or_else(|| refused(format!("{}: {UNENDED}", found.display())))?;
        Ok(text.into_owned())
    }
}

/// The names in a text's `#include`s, with conditions left aside.
///
/// # Errors
/// One that a macro names: what it comes to is known only once it is read.
fn included(text: &str) -> io::Result<Vec<String>> {
    let mut names = Vec::new();
    for directive in directives(text) {
        let Some(rest) = directive.strip_prefix("include") else {
            continue;
        };
        if rest.starts_with(|c: char| c.is_alphanumeric() || c == '_') {
            continue;
        }
        let name = rest.trim();
        let quoted = name.strip_prefix(['"', '<']);
        let ended = quoted.and_then(|q| Some(q[..q.find(['"', '>'])?].to_owned()));
        names.push(ended.ok_or_else(|| {
            refused(format!(
                "`#include {name}` names its file by a macro: write the name in quotes"
            ))
        })?);
    }
    Ok(names)
}

/// The name that a text asks for and defines first, with all else behind it up to the end and none for when it is defined: the second time such a text is empty.
fn guard(text: &str) -> Option<String> {
    let all: Vec<String> = directives(text).collect();
    let name = all.first()?.strip_prefix("ifndef")?.trim();
    let defined = all.get(1)?.strip_prefix("define")?.trim();
    if defined
        .split(|c: char| !(c.is_alphanumeric() || c == '_'))
        .next()
        != Some(name)
    {
        return None;
    }
    let mut depth = 0;
    for (i, directive) in all.iter().enumerate() {
        if directive.starts_with("if") {
            depth += 1;
        } else if directive.starts_with("endif") {
            depth -= 1;
            if depth == 0 {
                return (i + 1 == all.len()).then(|| name.to_owned());
            }
        } else if depth == 1 && (directive.starts_with("else") || directive.starts_with("elif")) {
            return None;
        }
    }
    None
}

/// The names that a text's `#undef`s take back.
fn undefined(text: &str) -> BTreeSet<String> {
    directives(text)
        .filter_map(|d| Some(d.strip_prefix("undef")?.trim().to_owned()))
        .collect()
}

/// What follows the `#` of each directive, comments and continued lines taken out.
fn directives(text: &str) -> impl Iterator<Item = String> {
    let joined = text.replace("\\\r\n", "").replace("\\\n", "");
    let mut plain = String::with_capacity(joined.len());
    let mut rest = joined.as_str();
    // Whichever begins first, as the preprocessor has it: a `/*` behind `//` opens nothing.
    while let Some(at) = rest.find("//").into_iter().chain(rest.find("/*")).min() {
        plain.push_str(&rest[..at]);
        plain.push(' ');
        rest = match rest[at..].starts_with("//") {
            true => rest[at..].find('\n').map_or("", |end| &rest[at + end..]),
            false => rest[at + 2..]
                .split_once("*/")
                .map_or("", |(_, after)| after),
        };
    }
    plain.push_str(rest);
    let of_line = |line: &str| Some(line.trim().strip_prefix('#')?.trim().to_owned());
    let found: Vec<String> = plain.lines().filter_map(of_line).collect();
    found.into_iter()
}

impl FileSystem for Files {
    type Error = io::Error;

    fn canonicalize(&self, path: &Path) -> Result<PathBuf, io::Error> {
        let found = self.find(path)?;
        let text = self.text(&found)?;
        let is_there = match &self.root {
            Some(root) => root.join(path).exists(),
            None => path.exists(),
        };
        let name = if is_there { path } else { &found };
        let mut shown = self.shown.borrow_mut();
        shown
            .entry(found.clone())
            .or_insert_with(|| name.to_owned());
        let mut all = self.found.borrow_mut();
        all.insert(path.to_owned(), found.clone());
        self.read.borrow_mut().insert(found.clone(), text);
        Ok(found)
    }

    /// Asked of names in angle brackets, below the folder of the text: they are looked up as those in quotes are.
    fn exists(&self, path: &Path) -> bool {
        self.find(path).is_ok()
    }

    fn read(&self, path: &Path) -> Result<Cow<'_, str>, io::Error> {
        let text = match self.read.borrow().get(path) {
            Some(text) if super::has_stages(text) => super::stage_of(text, self.stage),
            Some(text) => text.clone(),
            None => self.text(path)?,
        };
        let text = match self.macros.rewrite(&text) {
            None => text,
            Some(rewritten) => {
                let text = rewritten.text.clone();
                let mut all = self.rewritten.borrow_mut();
                all.insert(path.to_owned(), rewritten);
                text
            }
        };
        ended(Cow::Owned(text)).ok_or_else(|| refused(UNENDED.to_owned()))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn names_and_guards_are_seen_through_comments_and_continued_lines() {
        let text = "// #include \"no\"\n#include \"a\"\n  # /* x */ include <b> // c\n#inc\\\nlude \"d\"\n/*\n#include \"e\"\n*/";
        assert_eq!(included(text).unwrap(), ["a", "b", "d"]);
        // A comment that opens behind a comment of one line.
        assert_eq!(included("// /*\n#include \"a\"\n").unwrap(), ["a"]);
        assert!(included("#define F \"f\"\n#include F\n").is_err());
        let is_guarded = |text: &str| guard(text).is_some();
        assert!(is_guarded(
            "/* it */\n#ifndef A_H\n#define A_H\n#ifdef B\n#else\n#endif\nfloat f;\n#endif\n"
        ));
        assert!(!is_guarded("#ifndef A_H\n#define A_HH\n#endif\n"));
        assert!(!is_guarded("#if 1\n#define A\n#endif\n"));
        // What stands for when it is defined, and behind it.
        assert!(!is_guarded(
            "#ifndef A\n#define A\n#else\n#include \"a\"\n#endif\n"
        ));
        assert!(!is_guarded(
            "#ifndef A\n#define A\n#endif\n#include \"a\"\n"
        ));
    }
}
