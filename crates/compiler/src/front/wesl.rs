//! Compiles WESL (`import`, `@if`; Bevy's dialect since 0.20) to WGSL with the crate
//! [`wesl`](https://docs.rs/wesl).
//!
//! `package::a::b` is searched below the nearest parent folder called `src` or `shaders`, or else
//! the file's own folder. Other packages are searched below `Options::include`: a folder with the
//! package's name, or the package's folder in it. The package `constants` has the integers that are
//! defined. Labels point at the resulting WGSL.

mod text;

use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use shader_text::source::{SearchTarget, Searched};
use wesl::syntax::PathOrigin;
use wesl::{
    CompileOptions, Diagnostic, EscapeMangler, ImportError, ModulePath, ResolveError, Resolver,
};

use super::Source;
use super::dialect::{
    Compiled, CompiledFrom, Defined, definitions, folder_of, no_module, path_of, text_within,
};
use shader_text::error::{Code, Error};
use shader_text::memory::Memory;
use shader_text::options::Options;

/// Compiles a file and its imports to WGSL.
pub(super) fn compile(source: &Source, options: &Options) -> Result<Compiled, Error> {
    let mut constants = String::new();
    let mut on = BTreeSet::new();
    for (name, value) in definitions(options)? {
        match value {
            Defined::Bool(false) => continue,
            Defined::Bool(true) => {}
            Defined::Int(value) => constants += &format!("const {name} = {value};\n"),
            Defined::Uint(value) => constants += &format!("const {name} = {value}u;\n"),
        }
        on.insert(name);
    }
    let file = path_of(source, options);
    let root = package(folder_of(&file));
    let below = file.strip_prefix(&root).unwrap_or(&file).with_extension("");
    let components: Vec<String> = below
        .iter()
        .map(|c| c.to_string_lossy().into_owned())
        .collect();
    let resolver = Packages {
        main: (components.clone(), source.text.clone()),
        constants,
        on,
        root,
        options,
        read: RefCell::default(),
        absent: RefCell::default(),
        packages: RefCell::default(),
    };
    let path = ModulePath::new(PathOrigin::Absolute, components);
    let compile = CompileOptions {
        condcomp: false,
        ..CompileOptions::default()
    };
    let compiled = wesl::compile_sourcemap(&path, &resolver, &EscapeMangler, &compile);
    let text = compiled.map(|c| c.to_string()).map_err(|e| {
        if let Some(module) = missing(&e) {
            return no_module(source, &author_path(module), options);
        }
        if let Some((module, name)) = undeclared(&e) {
            return resolver.undeclared(source, module, name);
        }
        let message = without_colors(&e.to_string());
        let first = message.lines().next().unwrap_or_default();
        Error::new(Code::Parse, format!("{}: {first}", source.name)).note(message.clone())
    })?;
    let imported = resolver.read.into_inner().into_iter();
    let absent = resolver.absent.into_inner();
    let packages = resolver.packages.into_inner();
    let folders = shown(&options.include);
    let origin = CompiledFrom {
        imported: imported
            .map(|(path, text)| (path.display().to_string(), text))
            .collect(),
        absent: absent.iter().map(|p| p.display().to_string()).collect(),
        searched: packages
            .into_iter()
            .map(|(name, found)| Searched {
                folders: folders.clone(),
                wanted: SearchTarget::Package(name),
                found,
            })
            .collect(),
    };
    Ok(Compiled { text, origin })
}

/// The module that was not found, if that is the error.
fn missing(error: &wesl::Error) -> Option<&ModulePath> {
    match error {
        wesl::Error::ResolveError(e) | wesl::Error::ImportError(ImportError::ResolveError(e)) => {
            match e {
                ResolveError::ModuleNotFound(path, _) => Some(path),
                ResolveError::Error(within) => missing(&within.error),
                ResolveError::FileNotFound(..) => None,
            }
        }
        wesl::Error::Error(within) => missing(&within.error),
        _ => None,
    }
}

/// The module and the name that it does not declare, if that is the error.
fn undeclared(error: &wesl::Error) -> Option<(&ModulePath, &str)> {
    match error {
        wesl::Error::ImportError(ImportError::MissingDecl(module, name)) => Some((module, name)),
        wesl::Error::Error(within) => undeclared(&within.error),
        _ => None,
    }
}

/// A module as the author's imports name it.
fn author_path(module: &ModulePath) -> String {
    let (package, below) = package_of(module);
    let package = package.unwrap_or("package").to_owned();
    let path = std::iter::once(package).chain(below.iter().cloned());
    path.collect::<Vec<_>>().join("::")
}

fn shown(paths: &[PathBuf]) -> Vec<String> {
    paths.iter().map(|p| p.display().to_string()).collect()
}

/// The folders of a package among these folders now.
pub(super) fn found(folders: &[String], package: &str) -> Vec<String> {
    let folders: Vec<PathBuf> = folders.iter().map(PathBuf::from).collect();
    shown(&roots(&folders, package, &Memory::default()))
}

/// Removes terminal colour sequences (ECMA-48 8.3.117), which the crate always writes.
fn without_colors(text: &str) -> String {
    let mut parts = text.split("\u{1b}[");
    let mut out = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        out.push_str(part.split_once('m').map_or(part, |(_, rest)| rest));
    }
    out
}

/// The package root of a file in `folder`.
fn package(folder: &Path) -> PathBuf {
    let is_root = |f: &&Path| f.ends_with("src") || f.ends_with("shaders");
    let found = folder.ancestors().find(is_root);
    found.unwrap_or(folder).to_owned()
}

struct Packages<'a> {
    /// The file itself, which need not exist on disk.
    main: (Vec<String>, String),
    /// The text of the package `constants`.
    constants: String,
    /// The names for which a condition is true.
    on: BTreeSet<String>,
    root: PathBuf,
    options: &'a Options,
    /// The text of each file that was read.
    read: RefCell<BTreeMap<PathBuf, String>>,
    /// Paths that did not exist.
    absent: RefCell<BTreeSet<PathBuf>>,
    /// Other packages and their candidate folders.
    packages: RefCell<BTreeMap<String, Vec<String>>>,
}

/// Candidate folders of another package in `Options::include`.
fn roots(include: &[PathBuf], package: &str, memory: &Memory) -> Vec<PathBuf> {
    // Cargo appends a version to a package's folder name.
    let is_called = |folder: &Path| {
        let name = folder.file_name().map(|n| n.to_string_lossy());
        name.is_some_and(|n| {
            n == package
                || n.strip_prefix(package)
                    .and_then(|rest| rest.strip_prefix('-'))
                    .is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()))
        })
    };
    let mut out = Vec::new();
    for folder in include {
        if is_called(folder) {
            out.push(folder.clone());
        }
        let entries = memory.entries(folder).into_iter();
        out.extend(entries.filter(|p| is_called(p)));
    }
    let sources: Vec<PathBuf> = out.iter().map(|f| f.join("src")).collect();
    sources.into_iter().chain(out).collect()
}

impl Packages<'_> {
    /// The text of a module of `package` (`None`: the author's own).
    fn text(&self, package: Option<&str>, below: &[String]) -> Option<Cow<'_, str>> {
        let roots = match package {
            None if below == self.main.0 => return Some(Cow::Borrowed(&self.main.1)),
            Some("constants") if below.is_empty() => {
                return Some(Cow::Borrowed(&self.constants));
            }
            None => vec![self.root.clone()],
            Some(name) => {
                let roots = roots(&self.options.include, name, &self.options.files);
                let mut packages = self.packages.borrow_mut();
                packages.insert(name.to_owned(), shown(&roots));
                roots
            }
        };
        let below: PathBuf = below.iter().collect();
        for root in roots {
            for ending in ["wesl", "wgsl"] {
                let file = root.join(&below).with_extension(ending);
                if let Some(text) = text_within(&file, self.options) {
                    self.read.borrow_mut().insert(file.clone(), text.clone());
                    return Some(Cow::Owned(text));
                }
                self.absent.borrow_mut().insert(file);
            }
        }
        None
    }
}

impl Packages<'_> {
    /// A module that lacks a declaration: with the conditions that leave it out, if there are any.
    fn undeclared(&self, source: &Source, module: &ModulePath, name: &str) -> Error {
        let path = author_path(module);
        let (package, below) = package_of(module);
        let error = Error::new(
            Code::Parse,
            format!("{}: `{path}` does not declare `{name}`", source.name),
        );
        if package == Some("constants") {
            return error.note(format!("the host defines it: --define {name}=NUMBER"));
        }
        let text = self.text(package, below);
        match text.and_then(|text| text::conditions_of(&text, name)) {
            Some(conditions) if !conditions.is_empty() => error.note(format!(
                "it does under `{}`, which your definitions leave out; --define NAME adds one",
                conditions.join(" ")
            )),
            _ => error,
        }
    }
}

impl Resolver for Packages<'_> {
    fn resolve_source<'s>(&'s self, path: &ModulePath) -> Result<Cow<'s, str>, ResolveError> {
        let (package, below) = package_of(path);
        let Some(text) = self.text(package, below) else {
            return Err(ResolveError::ModuleNotFound(
                path.clone(),
                "no such file; other packages are searched in the include folders".to_owned(),
            ));
        };
        let is_on = |name: &str| self.on.contains(name);
        let evaluated =
            text::with_conditions(&text, &is_on).map_err(|text::Wrong(what, span)| {
                let error = wesl::Error::Custom(what);
                ResolveError::Error(
                    Diagnostic::from(error)
                        .with_module_path(path.clone(), None)
                        .with_source(text.to_string())
                        .with_span(span.into()),
                )
            })?;
        Ok(Cow::Owned(text::with_one_package(&evaluated, package)))
    }
}

/// The package of a module (`None`: the author's own) and its path there.
fn package_of(path: &ModulePath) -> (Option<&str>, &[String]) {
    match (&path.origin, path.components.as_slice()) {
        (PathOrigin::Package(name), below) => (Some(name), below),
        (_, [packages, name, below @ ..]) if packages == text::PACKAGES => (Some(name), below),
        (_, below) => (None, below),
    }
}
