//! naga_oil's dialect, Bevy's until 0.19: modules that name themselves by `#define_import_path`, put together by the crate [`naga_oil`](https://docs.rs/naga_oil).
//!
//! Modules are looked for in the WGSL files beside the file, then below its folder, then below the folders of `Options::include`. What the composer makes is a module, which is written as WGSL and read
//! as any other: places are those of that text. The composer's own errors have the author's. What the file's entry points do not reach is left out: the composer brings each imported
//! module whole, and a file's imports are not all of one pipeline (Bevy's `mesh.wgsl` imports bindings of the pre-pass and of the main pass, which have the same numbers).

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use naga::valid::Capabilities;
use naga::{Module, TypeInner, compact};
use naga_oil::compose::{
    ComposableModuleDescriptor, Composer, ComposerError, NagaModuleDescriptor, ShaderDefValue,
    get_preprocessor_data,
};
use preshade_passes::program::{Language, Program, Searched, Wanted};

use super::dialect::{Compiled, Defined, Origin, beside, definitions, files_below, path_of};
use super::error::{Code, Error};
use super::{Options, Source};
use crate::emit::wgsl;

/// The WGSL that a file and all that it imports come to.
pub(super) fn compile(source: &Source, options: &Options) -> Result<Compiled, Error> {
    let (module, origin) = compose(source, options)?;
    let program = Program::new(module, Arc::default(), Language::Wgsl)
        .map_err(|invalid| Error::invalid(&invalid))?;
    let text = wgsl::write(&program, &source.name, "")
        .map_err(|e| Error::new(Code::Unsupported, e.to_string()))?;
    Ok(Compiled { text, origin })
}

/// A file that names itself a module.
struct Named {
    name: String,
    path: PathBuf,
    text: String,
    imports: Vec<String>,
}

/// The files in folders, and below them, that name themselves modules.
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

/// Each of them in a word: its path, what it is called and, where others are called so, what it says.
fn told(all: &[Named]) -> Vec<String> {
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

/// What a search of these folders for modules finds now.
pub(super) fn found(folders: &[String]) -> Vec<String> {
    let folders: Vec<&Path> = folders.iter().map(Path::new).collect();
    told(&named(&folders, &Options::default()))
}

/// The module, and what it came of.
fn compose(source: &Source, options: &Options) -> Result<(Module, Origin), Error> {
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
    let own = beside(&path).to_owned();
    let mut folders: Vec<&Path> = vec![&own];
    folders.extend(options.include.iter().map(PathBuf::as_path));
    let mut library = Library {
        files: HashMap::new(),
        twice: HashMap::new(),
        imported: Vec::new(),
        composer: Composer::non_validating().with_capabilities(Capabilities::all()),
    };
    let own_file = path.canonicalize().ok();
    let all = named(&folders, options);
    let searched = Searched {
        folders: folders.iter().map(|f| f.display().to_string()).collect(),
        wanted: Wanted::Modules,
        found: told(&all),
    };
    for one in all {
        // The file itself goes by what it was given as, which need not be what is on the disk.
        if own_file.is_some() && own_file == one.path.canonicalize().ok() {
            continue;
        }
        let file = File {
            place: Place::of(&one.path, &own),
            path: one.path.display().to_string(),
            text: one.text,
            imports: one.imports,
        };
        library.know(one.name, file);
    }
    let (_, imports, _) = get_preprocessor_data(&source.text);
    for import in imports {
        library.add(&import.import)?;
    }
    let made = library.composer.make_naga_module(NagaModuleDescriptor {
        source: &source.text,
        file_path: &source.name,
        shader_defs: defines,
        ..NagaModuleDescriptor::default()
    });
    let mut module = made.map_err(|e| library.error(&source.name, &e))?;
    plain_names(&mut module);
    compact::compact(&mut module, compact::KeepUnused::No);
    let origin = Origin {
        imported: library.imported,
        absent: Vec::new(),
        searched: vec![searched],
    };
    Ok((module, origin))
}

/// Where a file lies that names itself a module: what is nearer to the shader goes before what is farther.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Place {
    /// In the shader's own folder.
    Own,
    /// Below it.
    Below,
    /// In a folder that the user includes.
    Included,
}

impl Place {
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
    place: Place,
}

impl File {
    /// Whether both are a package's choices for one module, of which the first goes: files of other names in one of its folders (Bevy has one for want of meshlets).
    fn is_choice_beside(&self, other: &Self) -> bool {
        let (a, b) = (Path::new(&self.path), Path::new(&other.path));
        self.place == Place::Included && a.parent() == b.parent() && a.file_name() != b.file_name()
    }
}

struct Library {
    /// By the name that a module gives itself.
    files: HashMap<String, File>,
    /// Another file with the same name for a module and another text, as two versions of a package have it.
    twice: HashMap<String, String>,
    /// Files whose modules were added, each with its text.
    imported: Vec<(String, String)>,
    composer: Composer,
}

impl Library {
    /// Takes a file as the module `name`, where none that is nearer is that already. Files are told from near to far.
    fn know(&mut self, name: String, file: File) {
        match self.files.get(&name) {
            None => drop(self.files.insert(name, file)),
            Some(first) if first.place < file.place && file.place != Place::Included => {}
            Some(first) if first.text == file.text || first.is_choice_beside(&file) => {}
            Some(_) => drop(self.twice.entry(name).or_insert(file.path)),
        }
    }

    /// Adds a module behind those that it imports. One that is not found is left for the composer to name, should it be needed.
    fn add(&mut self, name: &str) -> Result<(), Error> {
        let Some(file) = self.files.remove(name) else {
            return Ok(());
        };
        if let Some(other) = self.twice.get(name) {
            return Err(Error::new(
                Code::Sources,
                format!("{} and {other} are both `{name}`", file.path),
            )
            .note("include the folder of the one that is meant, and not the other's"));
        }
        for import in &file.imports {
            self.add(import)?;
        }
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

/// Names without the mark of the module that they are from; those of variables that a host binds stay whatever else is called so.
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
        // Types without a name are told apart by what they are.
        if ty.name.is_none() {
            continue;
        }
        plain(&mut ty.name);
        if let TypeInner::Struct { members, .. } = &mut ty.inner {
            members.iter_mut().for_each(|m| plain(&mut m.name));
        }
        // Nothing to do, or the name of another one just like it.
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
    // Modules have names apart, what comes of them has not, and naga's writer names variables of the module last: what a host sees keeps its name.
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
