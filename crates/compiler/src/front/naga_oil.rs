//! Compiles naga_oil's dialect (Bevy's until 0.19) with the crate
//! [`naga_oil`](https://docs.rs/naga_oil). A file becomes an importable module with
//! `#define_import_path`.
//!
//! Modules are searched in WGSL files beside the file, then in its subfolders, then in
//! `Options::include`. The composed module is written as WGSL and parsed again, so labels point at
//! that text. Only the composer's own errors point at the author's.
//!
//! Anything that the file's entry points do not reach is dropped. The composer imports whole
//! modules, and these can conflict: Bevy's `mesh.wgsl` imports pre-pass and main-pass bindings with
//! the same numbers.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use naga::valid::Capabilities;
use naga::{Module, TypeInner, compact};
use naga_oil::compose::{
    ComposableModuleDescriptor, Composer, ComposerError, ComposerErrorInner, NagaModuleDescriptor,
    ShaderDefValue, get_preprocessor_data,
};
use preshade_plan::program::Program;
use shader_text::source::{Language, SearchTarget, Searched};

use super::Source;
use super::dialect::{
    Compiled, CompiledFrom, Defined, definitions, files_below, folder_of, no_module, path_of,
};
use crate::wgsl::{self, WgslError};
use shader_text::error::{Code, Error};
use shader_text::options::Options;

/// Compiles a file and its imports to WGSL.
pub(super) fn compile(source: &Source, options: &Options) -> Result<Compiled, Error> {
    let (module, origin) = compose(source, options)?;
    let program = Program::new(module, Arc::default(), Language::Wgsl)
        .map_err(|invalid| Error::invalid(&invalid))?;
    let text = wgsl::write(&program, &source.name, "").map_err(|error| {
        let (WgslError::Inexpressible(why) | WgslError::Writer(why) | WgslError::Differs(why)) =
            error;
        let message = format!(
            "{}: the composed module cannot be written: {why}",
            source.name
        );
        Error::new(Code::Unsupported, message)
    })?;
    Ok(Compiled { text, origin })
}

/// A file with a `#define_import_path`.
struct Named {
    name: String,
    path: PathBuf,
    text: String,
    imports: Vec<String>,
}

/// The files below `folders` that have a `#define_import_path`.
fn named(folders: &[&Path], options: &Options) -> Vec<Named> {
    let all = files_below(folders, "wgsl", options).into_iter();
    all.filter_map(|(path, text)| {
        let (name, imports, _) = get_preprocessor_data(&text);
        Some(Named {
            name: name?,
            path,
            text,
            imports: imports.into_iter().map(|i| i.import).collect(),
        })
    })
    .collect()
}

/// A line for each module, to compare searches: path, module name and, for duplicates, the text.
fn fingerprints(all: &[Named]) -> Vec<String> {
    let mut called: HashMap<&str, usize> = HashMap::new();
    for one in all {
        *called.entry(&one.name).or_default() += 1;
    }
    let word = |one: &Named| {
        let said = match called.get(&*one.name) {
            Some(2..) => blake3::hash(one.text.as_bytes()).to_hex().to_string(),
            _ => String::new(),
        };
        format!("{} {} {said}", one.path.display(), one.name)
    };
    all.iter().map(word).collect()
}

/// The result of searching these folders now.
pub(super) fn found(folders: &[String]) -> Vec<String> {
    let folders: Vec<&Path> = folders.iter().map(Path::new).collect();
    fingerprints(&named(&folders, &Options::default()))
}

/// Composes the module and records its inputs.
fn compose(source: &Source, options: &Options) -> Result<(Module, CompiledFrom), Error> {
    let defines: HashMap<String, ShaderDefValue> = definitions(options)?
        .into_iter()
        .map(|(name, value)| {
            let value = match value {
                Defined::Bool(truth) => ShaderDefValue::Bool(truth),
                Defined::Int(number) => ShaderDefValue::Int(number),
                Defined::Uint(number) => ShaderDefValue::UInt(number),
            };
            (name, value)
        })
        .collect();
    let path = path_of(source, options);
    let own = folder_of(&path).to_owned();
    let mut folders: Vec<&Path> = vec![&own];
    folders.extend(options.include.iter().map(PathBuf::as_path));
    let mut library = Library {
        files: HashMap::new(),
        twice: HashMap::new(),
        imported: Vec::new(),
        open: Vec::new(),
        composer: Composer::non_validating().with_capabilities(Capabilities::all()),
    };
    let own_file = options.files.canonical(&path).ok();
    let all = named(&folders, options);
    let searched = Searched {
        folders: folders.iter().map(|f| f.display().to_string()).collect(),
        wanted: SearchTarget::Modules,
        found: fingerprints(&all),
    };
    let told = shader_text::tokens::without_comments(&source.text);
    let unknown = unknown_import(&told, &all);
    for one in all {
        // The given text of the main file takes precedence over the file on disk.
        if own_file.is_some() && own_file == options.files.canonical(&one.path).ok() {
            continue;
        }
        let file = File {
            place: Nearness::of(&one.path, &own),
            path: one.path.display().to_string(),
            text: one.text,
            imports: one.imports,
        };
        library.register(one.name, file);
    }
    let (own_name, imports, _) = get_preprocessor_data(&source.text);
    library.open.extend(own_name);
    for import in imports {
        library.add(&import.import)?;
    }
    let made = library.composer.make_naga_module(NagaModuleDescriptor {
        source: &source.text,
        file_path: &source.name,
        shader_defs: defines.clone(),
        ..NagaModuleDescriptor::default()
    });
    let mut module = made.map_err(|e| match &e.inner {
        ComposerErrorInner::ImportNotFound(module, _) => no_module(source, module, options),
        inner => {
            let is_syntax = matches!(inner, ComposerErrorInner::WgslParseError(_));
            match undefined(&source.text, &defines).filter(|_| is_syntax) {
                Some(name) => not_defined(source, name),
                None => library.error(&source.name, &e),
            }
        }
    })?;
    // The composer itself reports unknown modules that are used.
    if let Some(path) = unknown {
        return Err(no_module(source, path, options));
    }
    plain_names(&mut module);
    compact::compact(&mut module, compact::KeepUnused::No);
    let origin = CompiledFrom {
        imported: library.imported,
        absent: Vec::new(),
        searched: vec![searched],
    };
    Ok((module, origin))
}

/// The error for a cycle of imports.
fn cycle(modules: &[String]) -> Error {
    let named: Vec<String> = modules.iter().map(|m| format!("`{m}`")).collect();
    let message = match named.as_slice() {
        [one] => format!("{one} imports itself"),
        [a, b] => format!("{a} and {b} import each other"),
        [first, others @ ..] => format!("{first} imports itself through {}", others.join(", ")),
        [] => String::new(),
    };
    Error::new(Code::Parse, message).note("move what both need to a module of its own")
}

/// The first `#import` of a path that no module has, though nothing may use its names. Imports
/// under a condition are left to the composer.
fn unknown_import<'t>(text: &'t str, all: &[Named]) -> Option<&'t str> {
    let is_part = |whole: &str, part: &str| {
        let rest = whole.strip_prefix(part);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with("::"))
    };
    let is_known = |path: &str| {
        let mut all = all.iter();
        all.any(|m| is_part(path, &m.name) || is_part(&m.name, path))
    };
    let mut depth = 0_usize;
    for line in text.lines().map(str::trim_start) {
        if line.starts_with("#if") {
            depth += 1;
        } else if line.starts_with("#endif") {
            depth = depth.saturating_sub(1);
        }
        let Some(rest) = line.strip_prefix("#import ").filter(|_| depth == 0) else {
            continue;
        };
        let path = rest.trim_start();
        let end = path.find(|c: char| c.is_whitespace() || "{,;".contains(c));
        let path = path[..end.unwrap_or(path.len())].trim_end_matches("::");
        if !path.is_empty() && !path.starts_with('"') && !is_known(path) {
            return Some(path);
        }
    }
    None
}

/// The first `#{NAME}` that nothing defines, as the text of `NAME`. The composer would leave it, and
/// the parser would complain about `#`.
fn undefined<'t>(text: &'t str, defines: &HashMap<String, ShaderDefValue>) -> Option<&'t str> {
    let own = |name: &str| {
        let mut lines = text.lines();
        lines.any(|l| {
            l.trim_start()
                .strip_prefix("#define ")
                .is_some_and(|rest| rest.split_whitespace().next() == Some(name))
        })
    };
    let mut uses = text
        .split("#{")
        .skip(1)
        .filter_map(|rest| rest.split_once('}'));
    let name = uses.find(|(name, _)| !defines.contains_key(*name) && !own(name));
    name.map(|(name, _)| name)
}

/// The error of a `#{NAME}` that nothing defines.
fn not_defined(source: &Source, name: &str) -> Error {
    let written = format!("#{{{name}}}");
    let at = source.text.find(&written).unwrap_or_default();
    let span = naga::Span::new(at as u32, (at + written.len()) as u32);
    let error = Error::new(Code::Parse, format!("`{name}` is not defined"))
        .label(span, "")
        .note(format!("give its value: --define {name}=3, say"));
    match name {
        "MATERIAL_BIND_GROUP" => error.note(
            "Bevy's pipeline sets this and other definitions: docs/reference/wgsl-dialects.md \
             lists them",
        ),
        _ => error,
    }
}

/// Where a module's file is, nearest first.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Nearness {
    /// In the shader's folder.
    Own,
    /// In one of its subfolders.
    Below,
    /// In a folder of `Options::include`.
    Included,
}

impl Nearness {
    fn of(path: &Path, own: &Path) -> Self {
        match path.parent() {
            Some(folder) if folder == own => Self::Own,
            _ if path.starts_with(own) => Self::Below,
            _ => Self::Included,
        }
    }
}

struct File {
    path: String,
    text: String,
    imports: Vec<String>,
    place: Nearness,
}

impl File {
    /// Whether a package has both files as alternatives for one module: different names in one
    /// folder. The first is used. (Bevy has one for builds without meshlets.)
    fn is_choice_beside(&self, other: &Self) -> bool {
        let (a, b) = (Path::new(&self.path), Path::new(&other.path));
        self.place == Nearness::Included
            && a.parent() == b.parent()
            && a.file_name() != b.file_name()
    }
}

struct Library {
    /// Keyed by module name.
    files: HashMap<String, File>,
    /// Files with the same module name but another text, as in two versions of a package.
    twice: HashMap<String, String>,
    /// Added modules: path and text.
    imported: Vec<(String, String)>,
    /// The modules whose imports are being added, outermost first.
    open: Vec<String>,
    composer: Composer,
}

impl Library {
    /// Registers a file as module `name`, unless a nearer file has that name. Call it from near to
    /// far.
    fn register(&mut self, name: String, file: File) {
        match self.files.get(&name) {
            None => drop(self.files.insert(name, file)),
            Some(first) if first.place < file.place && file.place != Nearness::Included => {}
            Some(first) if first.text == file.text || first.is_choice_beside(&file) => {}
            Some(_) => drop(self.twice.entry(name).or_insert(file.path)),
        }
    }

    /// Adds a module after its imports. If a module is missing, the composer reports it when it is
    /// used.
    fn add(&mut self, name: &str) -> Result<(), Error> {
        if let Some(first) = self.open.iter().position(|open| open == name) {
            return Err(cycle(&self.open[first..]));
        }
        let Some(file) = self.files.remove(name) else {
            return Ok(());
        };
        if let Some(other) = self.twice.get(name) {
            return Err(Error::new(
                Code::Sources,
                format!("{} and {other} are both `{name}`", file.path),
            )
            .note("include the right folder only"));
        }
        self.open.push(name.to_owned());
        for import in &file.imports {
            self.add(import)?;
        }
        self.open.pop();
        let added = self
            .composer
            .add_composable_module(ComposableModuleDescriptor {
                source: &file.text,
                file_path: &file.path,
                ..ComposableModuleDescriptor::default()
            });
        match added.map(|_| ()) {
            Ok(()) => {
                self.imported.push((file.path, file.text));
                Ok(())
            }
            Err(e) => Err(self.error(&file.path, &e)),
        }
    }

    fn error(&self, path: &str, error: &ComposerError) -> Error {
        let error_text = error.emit_to_string(&self.composer);
        let first = error.to_string();
        let first = first.lines().next().unwrap_or_default();
        Error::new(Code::Parse, format!("{path}: {first}")).note(error_text)
    }
}

/// Removes naga_oil's module suffix from names. Bound variables keep theirs in case of a conflict.
fn plain_names(module: &mut Module) {
    fn plain(name: &mut Option<String>) {
        if let Some(name) = name
            && let Some((own, _)) = name.split_once("X_naga_oil_mod_X")
        {
            *name = own.to_owned();
        }
    }
    let handles: Vec<_> = module.types.iter().map(|(h, _)| h).collect();
    for handle in handles {
        let mut ty = module.types[handle].clone();
        // Unnamed types are identified by their content.
        if ty.name.is_none() {
            continue;
        }
        plain(&mut ty.name);
        if let TypeInner::Struct { members, .. } = &mut ty.inner {
            members.iter_mut().for_each(|m| plain(&mut m.name));
        }
        if module.types.get(&ty).is_none() {
            module.types.replace(handle, ty);
        }
    }
    module
        .global_variables
        .iter_mut()
        .for_each(|(_, g)| plain(&mut g.name));
    module
        .constants
        .iter_mut()
        .for_each(|(_, c)| plain(&mut c.name));
    for (_, function) in module.functions.iter_mut() {
        plain(&mut function.name);
    }
    // Without suffixes, names can conflict, and naga's writer renames global variables last. Rename
    // everything else so that the host's names stay.
    let globals = module.global_variables.iter();
    let taken: HashSet<String> = globals.filter_map(|(_, g)| g.name.clone()).collect();
    let give_way = |name: &mut String, ending: &str| {
        if taken.contains(name) {
            name.push_str(ending);
        }
    };
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    for function in functions.chain(module.entry_points.iter_mut().map(|e| &mut e.function)) {
        let arguments = function.arguments.iter_mut().map(|a| &mut a.name);
        let locals = function
            .local_variables
            .iter_mut()
            .map(|(_, l)| &mut l.name);
        let inner = arguments.chain(locals).flatten();
        for name in inner.chain(function.named_expressions.values_mut()) {
            give_way(name, "_local");
        }
        function
            .name
            .iter_mut()
            .for_each(|name| give_way(name, "_function"));
    }
}
