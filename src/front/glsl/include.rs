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

/// Most times that files are included, one within another and one after another.
const INCLUDES: u64 = 10_000;

/// Files that a text includes: beside it, or below one of the include paths.
pub(super) struct Files {
    include: Vec<PathBuf>,
    /// See [`Options::root`].
    root: Option<PathBuf>,
    /// Most bytes of one file.
    most: u64,
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
            most: options.limits.source_bytes,
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
        let mut texts = vec![Cow::Borrowed(text)];
        for found in counted.keys() {
            texts.push(Cow::Owned(self.text(found)?));
        }
        self.macros = Macros::of(&texts);
        Ok(self.macros.rewrite(text))
    }

    /// Inclusions below a text, its files' own among them.
    fn count(&self, text: &str, folder: &Path, counted: &mut Counted) -> io::Result<u64> {
        let mut all: u64 = 0;
        for name in included(text) {
            let path = folder.join(&name);
            let Ok(found) = self.find(&path) else {
                continue;
            };
            let below = match counted.get(&found) {
                Some(known) => {
                    let inner = self.text(&found)?;
                    match (is_guarded(&inner), known) {
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
        let about = std::fs::metadata(found)?;
        if !about.is_file() {
            return Err(refused(format!("{} is no file", found.display())));
        }
        if about.len() > self.most {
            return Err(refused(format!(
                "{} has {} bytes; the limit `source-bytes` is {}",
                found.display(),
                about.len(),
                self.most
            )));
        }
        let text = std::fs::read_to_string(found)?;
        let text = ended(Cow::Owned(text));
        let text = text.ok_or_else(|| refused(format!("{}: {UNENDED}", found.display())))?;
        Ok(text.into_owned())
    }
}

/// The names in a text's `#include`s, with conditions left aside.
fn included(text: &str) -> Vec<String> {
    directives(text)
        .filter_map(|d| {
            let name = d.strip_prefix("include")?.trim();
            let name = name.strip_prefix(['"', '<'])?;
            Some(name[..name.find(['"', '>'])?].to_owned())
        })
        .collect()
}

/// Whether a text defines what its first line asks for, and never takes it back: the second time it is empty.
fn is_guarded(text: &str) -> bool {
    let mut all = directives(text);
    let asked = all.next();
    let Some(name) = asked.as_deref().and_then(|d| d.strip_prefix("ifndef")) else {
        return false;
    };
    let name = name.trim();
    let defines = |d: &str| {
        let defined = d.strip_prefix("define").map(str::trim);
        defined.is_some_and(|d| {
            d.split(|c: char| !(c.is_alphanumeric() || c == '_')).next() == Some(name)
        })
    };
    all.next().is_some_and(|d| defines(&d)) && !all.any(|d| d.starts_with("undef"))
}

/// What follows the `#` of each directive, comments and continued lines taken out.
fn directives(text: &str) -> impl Iterator<Item = String> {
    let joined = text.replace("\\\r\n", "").replace("\\\n", "");
    let mut plain = String::with_capacity(joined.len());
    let mut rest = joined.as_str();
    while let Some(at) = rest.find("/*") {
        plain.push_str(&rest[..at]);
        plain.push(' ');
        rest = rest[at..].split_once("*/").map_or("", |(_, after)| after);
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

    fn exists(&self, path: &Path) -> bool {
        path.exists()
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
mod tests {
    use super::*;

    #[test]
    fn names_and_guards_are_seen_through_comments_and_continued_lines() {
        let text = "// #include \"no\"\n#include \"a\"\n  # /* x */ include <b> // c\n#inc\\\nlude \"d\"\n/*\n#include \"e\"\n*/";
        assert_eq!(included(text), ["a", "b", "d"]);
        assert!(is_guarded(
            "/* it */\n#ifndef A_H\n#define A_H\nfloat f;\n#endif\n"
        ));
        assert!(!is_guarded("#ifndef A_H\n#define A_HH\n#endif\n"));
        assert!(!is_guarded(
            "#ifndef A_H\n#define A_H\n#undef A_H\n#endif\n"
        ));
        assert!(!is_guarded("#if 1\n#define A\n#endif\n"));
    }
}
