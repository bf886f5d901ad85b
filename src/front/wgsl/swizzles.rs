//! Assignments to several components, `q.xy = e;`, which Chrome takes and naga does not.

use std::ops::Range;

use super::tokens::{Kind, tokens};

/// Whether naga's message is about such an assignment, among others.
pub(super) fn is_rejected(message: &str) -> bool {
    message.contains("invalid left-hand side of assignment")
}

/// The statement that assigns to `target`, and a block that assigns to one component after the
/// other.
pub(super) fn apart(text: &str, target: Range<usize>) -> Option<(Range<usize>, String)> {
    let written = text.get(target.clone())?;
    let (whole, names) = written.rsplit_once('.')?;
    let (whole, names) = (whole.trim_end(), names.trim());
    let is_set = |set: &str| names.chars().all(|c| set.contains(c));
    let is_twice = |c: char| names.matches(c).count() > 1;
    if !(is_set("xyzw") || is_set("rgba")) || names.len() < 2 || names.chars().any(is_twice) {
        return None;
    }
    // What a call returns is evaluated once.
    let of = tokens(whole);
    let calls =
        |pair: &[super::tokens::Token<'_>]| pair[0].kind == Kind::Word && pair[1].text == "(";
    if of.windows(2).any(calls) {
        return None;
    }
    let behind = tokens(&text[target.end..]);
    let end = target.end + behind.iter().find(|t| t.text == ";")?.at;
    let first = behind.first()?;
    if !first.text.ends_with('=') {
        return None;
    }
    let rest = &text[target.end..end];
    let mut block = format!("{{ var preshade_part = {whole}.{names}; preshade_part {rest};");
    for (from, to) in ["x", "y", "z", "w"].iter().zip(names.chars()) {
        block.push_str(&format!(" {whole}.{to} = preshade_part.{from};"));
    }
    block.push_str(" }");
    Some((target.start..end + 1, block))
}
