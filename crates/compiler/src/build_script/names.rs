//! Valid names of materials and variants.

/// Rust's keywords, strict and reserved, of all editions, in small letters.
const KEYWORDS: [&str; 52] = [
    "abstract", "as", "async", "await", "become", "box", "break", "const", "continue", "crate",
    "do", "dyn", "else", "enum", "extern", "false", "final", "fn", "for", "gen", "if", "impl",
    "in", "let", "loop", "macro", "match", "mod", "move", "mut", "override", "priv", "pub", "ref",
    "return", "self", "static", "struct", "super", "trait", "true", "try", "type", "typeof",
    "union", "unsafe", "unsized", "use", "virtual", "where", "while", "yield",
];

/// Names that would hide crates or prelude types in the generated module.
const HIDDEN: [&str; 24] = [
    "alloc",
    "bool",
    "char",
    "core",
    "f16",
    "f32",
    "f64",
    "f128",
    "i8",
    "i16",
    "i32",
    "i64",
    "i128",
    "isize",
    "preshade_generated",
    "preshade_self_test",
    "std",
    "str",
    "u8",
    "u16",
    "u32",
    "u64",
    "usize",
    "wgpu",
];

/// Whether a variant's module may have this name.
pub(super) fn is_a_modules(name: &str) -> bool {
    let word = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    let reserved = ["original", "variant", "u128"];
    name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(word)
        && !KEYWORDS.contains(&name)
        && !HIDDEN.contains(&name)
        && !reserved.contains(&name)
}
