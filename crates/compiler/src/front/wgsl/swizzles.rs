//! Assignments to several components, `q.xy = e;`, which Chrome takes and naga does not.

use std::ops::Range;

use super::tokens::{Token, tokens};

/// Whether naga's message is about such an assignment, among others.
pub(super) fn is_rejected(message: &str) -> bool {
    message.contains("invalid left-hand side of assignment")
}

/// Replacements of parts of a text.
pub(super) type Replaced = Vec<(Range<usize>, String)>;

/// The statement that assigns to `target`, and a block that assigns to one component after the
/// other. In the head of a `for`, which holds no block, a loop that holds the statement.
pub(super) fn assign_components(text: &str, target: Range<usize>) -> Option<Replaced> {
    let tokens = tokens(text);
    if let Some(at) = head_around(&tokens, target.start) {
        return without_head(text, &tokens[at..]);
    }
    let behind = &tokens[tokens.partition_point(|t| t.at < target.end)..];
    let end = behind.iter().find(|t| t.text == ";")?.at;
    let block = by_component(text.get(target.clone())?, &text[target.end..end])?;
    Some(vec![(target.start..end + 1, block)])
}

/// A block that assigns to one component after the other. `rest` begins with the operator.
fn by_component(target: &str, rest: &str) -> Option<String> {
    let (whole, names) = target.rsplit_once('.')?;
    let (whole, names) = (whole.trim_end(), names.trim());
    let is_set = |set: &str| names.chars().all(|c| set.contains(c));
    let is_twice = |c: char| names.matches(c).count() > 1;
    if !(is_set("xyzw") || is_set("rgba")) || names.len() < 2 || names.chars().any(is_twice) {
        return None;
    }
    if !tokens(rest).first()?.text.ends_with('=') {
        return None;
    }
    // An index is evaluated once, ahead of the value.
    let (at, whole) = match whole.contains('[') {
        true => (
            format!("let preshade_at = &({whole}); "),
            "(*preshade_at)".to_owned(),
        ),
        false => (String::new(), whole.to_owned()),
    };
    let mut block = format!("{{ {at}var preshade_part = {whole}.{names}; preshade_part {rest};");
    for (from, to) in ["x", "y", "z", "w"].iter().zip(names.chars()) {
        block.push_str(&format!(" {whole}.{to} = preshade_part.{from};"));
    }
    block.push_str(" }");
    Some(block)
}

/// The `for` whose head is around a place.
fn head_around(tokens: &[Token<'_>], place: usize) -> Option<usize> {
    let mut depth = 0_usize;
    for n in (0..tokens.partition_point(|t| t.at < place)).rev() {
        match tokens[n].text {
            ")" => depth += 1,
            "(" if depth == 0 => return n.checked_sub(1).filter(|n| tokens[*n].text == "for"),
            "(" => depth -= 1,
            "{" | "}" => return None,
            _ => {}
        }
    }
    None
}

/// The `for` that tokens begin with, as a `loop` (WGSL 9.4.4).
fn without_head(text: &str, head: &[Token<'_>]) -> Option<Replaced> {
    let close = end_of(head, 1, ("(", ")"))?;
    let mut ends = vec![1];
    let mut depth = 0_usize;
    for (n, token) in head[..close].iter().enumerate() {
        match token.text {
            "(" => depth += 1,
            ")" => depth -= 1,
            ";" if depth == 1 => ends.push(n),
            _ => {}
        }
    }
    ends.push(close);
    let parts = ends.windows(2);
    let parts = parts.map(|p| text[head[p[0]].range().end..head[p[1]].at].trim());
    let [first, condition, next] = parts.collect::<Vec<_>>().try_into().ok()?;
    // The first sign that assigns: declarations and calls have other targets.
    let assigned = |part: &str| {
        let all = tokens(part);
        let sign = all.iter().find(|t| t.text.ends_with('='))?.at;
        by_component(&part[..sign], &part[sign..])
    };
    let statement = |part: &str| match part.is_empty() {
        true => String::new(),
        false => assigned(part).unwrap_or_else(|| format!("{part};")) + " ",
    };
    let leave = match condition.is_empty() {
        true => String::new(),
        false => format!("if !({condition}) {{ break; }} "),
    };
    let body = end_of(head, close + 1, ("{", "}"))?;
    let whole = head[0].at..head[close].range().end;
    Some(vec![
        (whole, format!("{{ {}loop {{ {leave}", statement(first))),
        (
            head[body].range(),
            format!("}} continuing {{ {}}} }} }}", statement(next)),
        ),
    ])
}

/// The bracket that closes the one at `open`.
fn end_of(tokens: &[Token<'_>], open: usize, of: (&str, &str)) -> Option<usize> {
    let mut depth = 0_usize;
    for (n, token) in tokens.iter().enumerate().skip(open) {
        depth += usize::from(token.text == of.0);
        depth = depth.checked_sub(usize::from(token.text == of.1))?;
        if depth == 0 {
            return (n > open).then_some(n);
        }
    }
    None
}
