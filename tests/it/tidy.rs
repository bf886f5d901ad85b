//! Which files may import which: read from `use` declarations and paths in code.
//!
//! The exceptions are those of today. A test fails for a new one and for one that is gone, so the
//! lists only shrink.
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// A module's path from its crate's root.
type Module = Vec<String>;

/// The sources of each crate, and the rooms in it whose order matters, lowest first. A room imports only rooms before
/// it. Rooms that are not listed are free.
const CRATES: [(&str, &[&str]); 18] = [
    ("crates/text/src", &[]),
    ("crates/operands/src", &[]),
    ("crates/interp/src", &[]),
    ("crates/ir/src", &[]),
    ("crates/glsl/src", &[]),
    ("crates/spirv/src", &[]),
    ("crates/plan/src", &[]),
    ("crates/dataflow/src", &["graph", "slice"]),
    ("passes/src", &["analysis", "rebuild", "transforms"]),
    ("crates/geometry/src", &[]),
    ("crates/validate/src", &[]),
    (
        "crates/compiler/src",
        &["wgsl", "front", "emit", "pipeline", "command"],
    ),
    ("crates/frames/src", &[]),
    ("crates/draw/src", &["scene", "render"]),
    (
        "crates/scenes/src",
        &["image", "mesh", "asset", "shader", "file", "capture"],
    ),
    ("crates/lab/src", &["measure", "search", "jobs", "report"]),
    ("cli/src", &[]),
    ("xtask/src", &[]),
];

#[test]
fn rooms_import_only_rooms_below() {
    let upward = CRATES.iter().flat_map(|(sources, order)| {
        against(&imports(sources), order)
            .into_iter()
            .map(move |found| format!("{sources}: {found}"))
    });
    assert_eq!(upward.collect::<BTreeSet<_>>(), BTreeSet::new());
}

#[test]
fn no_transform_imports_another() {
    let transform = |m: &Module| (m.len() > 1 && m[0] == "transforms").then(|| m[1].clone());
    let mut found = BTreeSet::new();
    for (from, to) in edges(&imports("passes/src")) {
        if let (Some(a), Some(b)) = (transform(from), transform(to))
            && a != b
        {
            found.insert(format!("{} -> {b}", from.join("::")));
        }
    }
    assert_eq!(found, BTreeSet::new());
}

/// What only one transform uses is that transform's.
#[test]
fn each_shared_module_has_two_users() {
    let imports = imports("passes/src");
    let above = CRATES
        .iter()
        .skip_while(|(sources, _)| *sources != "passes/src");
    let above: Vec<_> = above
        .skip(1)
        .flat_map(|(sources, _)| texts(sources))
        .collect();
    // The root re-exports modules for the crates above.
    let exported = paths(&texts("passes/src")[&Vec::new()]);
    let rooms = ["analysis", "rebuild"];
    let shared: BTreeSet<&[String]> = imports
        .keys()
        .filter(|m| m.len() > 1 && rooms.contains(&m[0].as_str()))
        .map(|m| &m[..2])
        .collect();
    let mut homeless = BTreeSet::new();
    for of in shared {
        let name = of.join("::");
        let path = format!("preshade_passes::{name}");
        let mut users = BTreeSet::new();
        if exported.iter().any(|e| e == of) || above.iter().any(|(_, text)| text.contains(&path)) {
            users.insert("preshade".to_owned());
        }
        let (mut reached, mut open) = (BTreeSet::new(), vec![of]);
        while let Some(next) = open.pop() {
            let importing = edges(&imports)
                .filter(|(from, to)| to.starts_with(next) && !from.starts_with(next));
            for (from, _) in importing {
                match from.first().map(String::as_str) {
                    None => {}
                    Some("transforms") if from.len() > 1 => drop(users.insert(from[1].clone())),
                    Some(room) if rooms.contains(&room) => {
                        open.extend(from.get(..2).filter(|shared| reached.insert(*shared)));
                    }
                    Some(room) => drop(users.insert(room.to_owned())),
                }
            }
        }
        if users.len() < 2 && !users.contains("preshade") {
            homeless.insert(format!("{name} <- {users:?}"));
        }
    }
    assert_eq!(homeless, BTreeSet::new());
}

/// The children of one module may import each other: the file `room/name.rs` and the folder
/// `room/name` are one module.
#[test]
fn no_two_modules_import_each_other() {
    let mut found = BTreeSet::new();
    for (sources, order) in CRATES {
        let imports = imports(sources);
        // Crates without rooms are one room.
        let depth = if order.is_empty() { 1 } else { 2 };
        let module = |m: &Module| m[..m.len().min(depth)].join("::");
        let all: BTreeSet<(String, String)> = edges(&imports)
            .map(|(from, to)| (module(from), module(to)))
            .filter(|(from, to)| !from.starts_with(to.as_str()) && !to.starts_with(from.as_str()))
            .collect();
        let is_mutual = |(a, b): &&(String, String)| a < b && all.contains(&(b.clone(), a.clone()));
        let mutual = all.iter().filter(is_mutual);
        found.extend(mutual.map(|(a, b)| format!("{sources}: {a} <-> {b}")));
    }
    assert_eq!(found, BTreeSet::new());
}

fn edges(imports: &BTreeMap<Module, BTreeSet<Module>>) -> impl Iterator<Item = (&Module, &Module)> {
    let all = imports.iter();
    all.flat_map(|(from, to)| to.iter().map(move |to| (from, to)))
}

fn against(imports: &BTreeMap<Module, BTreeSet<Module>>, order: &[&str]) -> BTreeSet<String> {
    let rank = |m: &Module| {
        let room = m.first()?;
        order.iter().position(|of| of == room)
    };
    let upward = edges(imports).filter(|(from, to)| rank(to) > rank(from) && rank(from).is_some());
    upward
        .map(|(from, to)| format!("{} -> {}", from.join("::"), to[0]))
        .collect()
}

/// The modules that each module of a crate's sources imports, tests apart.
fn imports(sources: &str) -> BTreeMap<Module, BTreeSet<Module>> {
    let texts = texts(sources);
    let found = texts.iter().map(|(module, text)| {
        let named = paths(text)
            .into_iter()
            .filter_map(|path| resolve(module, &path, &texts));
        (module.clone(), named.filter(|to| to != module).collect())
    });
    found.collect()
}

/// The code of each module of a crate's sources, tests apart.
fn texts(sources: &str) -> BTreeMap<Module, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(sources);
    let mut texts = BTreeMap::new();
    read(&root, &mut Vec::new(), &mut texts);
    texts
}

fn read(folder: &Path, at: &mut Module, texts: &mut BTreeMap<Module, String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        at.push(name.clone());
        if path.is_dir() {
            read(&path, at, texts);
        } else if path.extension().is_some_and(|e| e == "rs") {
            let module = if name == "mod" || name == "lib" {
                at[..at.len() - 1].to_vec()
            } else {
                at.clone()
            };
            let text = fs::read_to_string(&path).unwrap();
            let code = text.split("#[cfg(test)]").next().unwrap().lines();
            let code = code.map(|line| line.split("//").next().unwrap());
            texts.insert(module, code.collect::<Vec<_>>().join("\n"));
        }
        at.pop();
    }
}

/// The paths that a text imports or names from `crate` or `super`.
fn paths(text: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    let is_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    for (at, word) in text.match_indices("use ") {
        if text[..at]
            .chars()
            .next_back()
            .is_none_or(char::is_whitespace)
        {
            let tree = text[at + word.len()..].split(';').next().unwrap();
            expand(tree, &[], &mut found);
        }
    }
    for start in ["crate::", "super::"] {
        for (at, _) in text.match_indices(start) {
            let path: String = text[at..].chars().take_while(|c| is_path(*c)).collect();
            found.push(path.split("::").map(str::to_owned).collect());
        }
    }
    found
}

/// The paths of a use tree: `a::{b, c::d}` is `a::b` and `a::c::d`.
fn expand(tree: &str, before: &[String], found: &mut Vec<Vec<String>>) {
    let (head, inner) = match tree.split_once('{') {
        Some((head, rest)) => (head, rest.rsplit_once('}').map(|(inner, _)| inner)),
        None => (tree.split(" as ").next().unwrap(), None),
    };
    let mut path = before.to_vec();
    path.extend(
        head.split("::")
            .map(str::trim)
            .filter(|s| !s.is_empty())
            .map(str::to_owned),
    );
    let Some(inner) = inner else {
        found.push(path);
        return;
    };
    let (mut depth, mut from) = (0, 0);
    for (at, c) in inner.char_indices().chain([(inner.len(), ',')]) {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                if !inner[from..at].trim().is_empty() {
                    expand(&inner[from..at], &path, found);
                }
                from = at + 1;
            }
            _ => {}
        }
    }
}

/// The module of this crate that holds the item at `path`, as seen from `module`.
fn resolve(module: &Module, path: &[String], texts: &BTreeMap<Module, String>) -> Option<Module> {
    let supers = path.iter().take_while(|p| *p == "super").count();
    let mut full = match path.first()?.as_str() {
        "crate" => path[1..].to_vec(),
        "super" => [
            &module[..module.len().checked_sub(supers)?],
            &path[supers..],
        ]
        .concat(),
        _ => [module, path].concat(),
    };
    // `crate::coverage` is a re-export of `crate::analysis::coverage`.
    if path[0] == "crate" && !texts.keys().any(|m| m.first() == full.first()) {
        full = [texts.keys().find(|m| m.get(1) == full.first())?, &full[1..]].concat();
    }
    while !texts.contains_key(&full) {
        full.pop();
        if full.is_empty() {
            return None;
        }
    }
    // A path that starts with an item of this module, or with another crate.
    (full != *module).then_some(full)
}
