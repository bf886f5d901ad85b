//! Restores parts of WGSL that naga's writer drops: `enable f16`, `diagnostic(..)`,
//! `@early_depth_test(..)`, `@size(..)`, `_ = texture;`, and author's names that end in a digit.
//!
//! This relies on the writer's order: structs, functions and entry points follow their arenas, and
//! each begins a line. If a later naga changes that, the fingerprint comparison fails.

use naga::proc::Layouter;
use naga::{
    AddressSpace, ConservativeDepth, EarlyDepthTest, Expression, FastHashMap, FastHashSet,
    Function, GlobalVariable, Handle, Module, Type, TypeInner,
};

use super::fingerprint::{filter_chain, filters};
use shader_text::tokens as text;
use shader_text::tokens::{TokenKind, Words};

/// Restores everything that the writer dropped.
///
/// # Errors
/// Anything that WGSL cannot express.
pub(crate) fn repair(module: &Module, text: &str) -> Result<String, String> {
    let sizes = member_sizes(module)?;
    let attributes = function_attributes(module);
    let mut out = directives(module, text);
    let mut structs = sizes.iter();
    let named = named_resources(module, text);
    let mut functions = attributes.iter().zip(&named);
    let none = Vec::new();
    let mut members: Option<std::slice::Iter<'_, Option<u32>>> = None;
    let mut lines = text.lines().peekable();
    while let Some(line) = lines.next() {
        let begins_function = |line: &str| line.starts_with("fn ");
        if line.starts_with("struct ") {
            members = structs.next().map(|s| s.iter());
        } else if line.starts_with('}') {
            members = None;
        } else if let Some(Some(Some(size))) = members.as_mut().map(Iterator::next) {
            let member = line.trim_start();
            out.push_str(&line[..line.len() - member.len()]);
            out.push_str(&format!("@size({size}) {member}\n"));
            continue;
        }
        // Attributes precede the stage's, on their own line.
        let stage_line = line.starts_with('@') && lines.peek().is_some_and(|l| begins_function(l));
        if stage_line || begins_function(line) {
            let (attributes, named) = functions.next().unwrap_or((&none, &none));
            for attribute in attributes {
                out.push_str(attribute);
                out.push('\n');
            }
            out.push_str(line.trim_end());
            out.push('\n');
            if stage_line && let Some(line) = lines.next() {
                out.push_str(line);
                out.push('\n');
            }
            for name in named {
                out.push_str(&format!("    _ = {name};\n"));
            }
            continue;
        }
        out.push_str(line);
        out.push('\n');
    }
    Ok(authors_names(module, &out))
}

/// `enable f16;` if it is missing, and the module's diagnostic filters. Directives come first, in
/// any order.
fn directives(module: &Module, text: &str) -> String {
    let mut out = String::new();
    let half = text::tokens(text).any(|(kind, range)| match kind {
        TokenKind::Word => &text[range] == "f16",
        TokenKind::Number => text[range].ends_with('h'),
        TokenKind::Mark => false,
    });
    if half && !text.contains("enable f16;") {
        out.push_str("enable f16;\n");
    }
    // naga's parser makes the last one the innermost, which `filters` lists first.
    for (severity, rule) in shared_filters(module).into_iter().rev() {
        out.push_str(&format!("diagnostic({severity}, {rule});\n"));
    }
    if !out.is_empty() && !text.starts_with("enable") {
        out.push('\n');
    }
    out
}

/// The module's filters, without those that a function does not have: it comes from another module
/// that was linked.
fn shared_filters(module: &Module) -> Vec<(String, String)> {
    let mut shared = filters(&module.diagnostic_filters, module.diagnostic_filter_leaf);
    let functions = module.functions.iter().map(|(_, f)| f);
    let functions = functions.chain(module.entry_points.iter().map(|e| &e.function));
    for leaf in functions.filter_map(|f| f.diagnostic_filter_leaf) {
        let own = filter_chain(&module.diagnostic_filters, Some(leaf));
        shared.retain(|filter| own.contains(filter));
    }
    shared
}

/// The missing attributes of each function and then each entry point.
fn function_attributes(module: &Module) -> Vec<Vec<String>> {
    let shared = shared_filters(module);
    let diagnostics = |function: &naga::Function| -> Vec<String> {
        // Functions that passes create have no filter of their own, so the module's apply.
        let leaf = function.diagnostic_filter_leaf;
        let leaf = leaf.or(module.diagnostic_filter_leaf);
        let all = filters(&module.diagnostic_filters, leaf);
        all.iter()
            .filter(|filter| !shared.contains(filter))
            .rev()
            .map(|(severity, rule)| format!("@diagnostic({severity}, {rule})"))
            .collect()
    };
    let functions = module.functions.iter().map(|(_, f)| diagnostics(f));
    let entries = module.entry_points.iter().map(|e| {
        let mut attributes = diagnostics(&e.function);
        attributes.extend(e.early_depth_test.map(|test| {
            let how = match test {
                EarlyDepthTest::Force => "force",
                EarlyDepthTest::Allow { conservative } => match conservative {
                    ConservativeDepth::GreaterEqual => "greater_equal",
                    ConservativeDepth::LessEqual => "less_equal",
                    ConservativeDepth::Unchanged => "unchanged",
                },
            };
            format!("@early_depth_test({how})")
        }));
        attributes
    });
    functions.chain(entries).collect()
}

/// The textures and samplers that each function and then each entry point only names (`_ = t;`),
/// which keeps them in an automatic layout. The names are those in the text.
fn named_resources(module: &Module, text: &str) -> Vec<Vec<String>> {
    let name = |g: &GlobalVariable| {
        let at = g.binding?;
        let head = format!("@group({}) @binding({})", at.group, at.binding);
        let mut declared = text.split(head.as_str()).skip(1);
        let (Some(rest), None) = (declared.next(), declared.next()) else {
            return None;
        };
        let name = rest.trim_start().strip_prefix("var ")?.split(':').next()?;
        Some(name.to_owned())
    };
    let of = |f: &Function| {
        let named = f.named_expressions.keys();
        let globals = named.filter_map(|e| match f.expressions[*e] {
            Expression::GlobalVariable(g) => Some(&module.global_variables[g]),
            _ => None,
        });
        let resources = globals.filter(|g| g.space == AddressSpace::Handle);
        resources.filter_map(name).collect()
    };
    let functions = module.functions.iter().map(|(_, f)| of(f));
    functions
        .chain(module.entry_points.iter().map(|e| of(&e.function)))
        .collect()
}

/// For each declared struct, the `@size` of each member that places the next member or the struct's
/// end (WGSL 14.4.1, "Structure Layout Rules").
fn member_sizes(module: &Module) -> Result<Vec<Vec<Option<u32>>>, String> {
    let mut layouter = Layouter::default();
    layouter
        .update(module.to_ctx())
        .map_err(|e| e.to_string())?;
    let mut all = Vec::new();
    for (handle, ty) in module.types.iter() {
        let TypeInner::Struct { members, span } = &ty.inner else {
            continue;
        };
        if is_predeclared(module, handle) {
            continue;
        }
        let mut sizes = Vec::new();
        for (i, member) in members.iter().enumerate() {
            let size = module.types[member.ty].inner.size(module.to_ctx());
            let end = member.offset + size;
            let needed = match members.get(i + 1) {
                Some(next) => {
                    let natural = layouter[next.ty].alignment.round_up(end);
                    (natural != next.offset).then_some(next.offset)
                }
                None => {
                    let natural = layouter[handle].alignment.round_up(end);
                    let runtime = module.types[member.ty]
                        .inner
                        .is_dynamically_sized(&module.types);
                    (natural != *span && !runtime).then_some(*span)
                }
            };
            sizes.push(match needed {
                // Offsets in an interface struct have no meaning.
                Some(_) if member.binding.is_some() => None,
                Some(needed) if needed >= end => Some(needed - member.offset),
                Some(needed) => {
                    return Err(format!(
                        "in struct `{}`, the member after `{}` is at byte {needed}, but WGSL \
                         places it at byte {end} or later",
                        ty.name.as_deref().unwrap_or("(unnamed)"),
                        member.name.as_deref().unwrap_or("(unnamed)"),
                    ));
                }
                None => None,
            });
        }
        all.push(sizes);
    }
    Ok(all)
}

/// Whether the struct is a WGSL builtin, which the writer does not declare.
fn is_predeclared(module: &Module, ty: Handle<Type>) -> bool {
    let special = &module.special_types;
    special.predeclared_types.values().any(|t| *t == ty)
        || Some(ty) == special.external_texture_params
        || Some(ty) == special.external_texture_transfer_function
}

/// Removes the `_` that naga's writer appends to names ending in a digit, unless the name would
/// conflict.
fn authors_names(module: &Module, text: &str) -> String {
    let authors = names(module);
    let words: FastHashSet<&str> = text::tokens(text)
        .filter(|(kind, _)| *kind == TokenKind::Word)
        .map(|(_, range)| &text[range])
        .collect();
    let mut renames: FastHashMap<&str, &str> = words
        .iter()
        .filter_map(|word| {
            let short = word.strip_suffix('_')?;
            let free = short.ends_with(|c: char| c.is_ascii_digit())
                && authors.contains(short)
                && !words.contains(short)
                && !naga::keywords::wgsl::RESERVED_SET.contains(short)
                && !naga::keywords::wgsl::BUILTIN_IDENTIFIER_SET.contains(short);
            free.then_some((*word, short))
        })
        .collect();
    let kept_by_host = host_names(module, text).filter(|(_, wanted)| !words.contains(wanted));
    renames.extend(kept_by_host);
    if renames.is_empty() {
        return text.to_owned();
    }
    text::rename_words(text, Words::All, |word| renames.get(word).copied())
}

/// Names that the host uses and the writer changed, entry points and overrides: written and
/// original. The writer also drops trailing underscores and transliterates letters beyond ASCII.
fn host_names<'a>(module: &'a Module, text: &'a str) -> impl Iterator<Item = (&'a str, &'a str)> {
    let entries = text
        .lines()
        .filter_map(|l| l.strip_prefix("fn ")?.split_once('('))
        .map(|(name, _)| name)
        .skip(module.functions.len())
        .zip(module.entry_points.iter().map(|e| e.name.as_str()));
    let overrides = text
        .lines()
        .filter(|l| l.starts_with("override ") || l.starts_with("@id("))
        .filter_map(|l| Some(l.split_once("override ")?.1.split_once(':')?.0))
        .zip(
            module
                .overrides
                .iter()
                .map(|(_, o)| o.name.as_deref().unwrap_or("")),
        );
    entries
        .chain(overrides)
        .filter(|(written, wanted)| written != wanted && !wanted.is_empty())
}

fn names(module: &Module) -> FastHashSet<&str> {
    let mut names: FastHashSet<&str> = FastHashSet::default();
    for (_, ty) in module.types.iter() {
        names.extend(ty.name.as_deref());
        if let TypeInner::Struct { members, .. } = &ty.inner {
            names.extend(members.iter().filter_map(|m| m.name.as_deref()));
        }
    }
    names.extend(
        module
            .constants
            .iter()
            .filter_map(|(_, c)| c.name.as_deref()),
    );
    names.extend(
        module
            .overrides
            .iter()
            .filter_map(|(_, o)| o.name.as_deref()),
    );
    names.extend(
        module
            .global_variables
            .iter()
            .filter_map(|(_, g)| g.name.as_deref()),
    );
    let functions = module.functions.iter().map(|(_, f)| f);
    let entries = module.entry_points.iter().map(|e| &e.function);
    for function in functions.chain(entries) {
        names.extend(function.name.as_deref());
        names.extend(function.arguments.iter().filter_map(|a| a.name.as_deref()));
        names.extend(
            function
                .local_variables
                .iter()
                .filter_map(|(_, l)| l.name.as_deref()),
        );
        names.extend(function.named_expressions.values().map(String::as_str));
    }
    names.extend(module.entry_points.iter().map(|e| e.name.as_str()));
    names
}
