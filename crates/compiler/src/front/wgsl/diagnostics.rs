//! `@diagnostic` of a statement, which naga lacks: the whole function gets the attribute.

use std::ops::Range;

use super::edits::Edits;
use super::tokens::{Kind, Token};

/// Severities, weakest first.
const SEVERITIES: [&str; 4] = ["off", "info", "warning", "error"];

/// Statements that may have attributes.
const STATEMENTS: [&str; 6] = ["{", "if", "for", "while", "loop", "switch"];

/// One `@diagnostic(severity, rule)`.
struct Attribute<'t> {
    range: Range<usize>,
    severity: usize,
    rule: &'t str,
}

/// The attribute that begins at token `n`, and the number of its tokens.
fn attribute<'t>(text: &'t str, tokens: &[Token<'t>], n: usize) -> Option<(Attribute<'t>, usize)> {
    let word = |k: usize| tokens.get(n + k).map(|t| t.text);
    if word(0)? != "@" || word(1)? != "diagnostic" || word(2)? != "(" || word(4)? != "," {
        return None;
    }
    let severity = SEVERITIES.iter().position(|s| word(3) == Some(s))?;
    let close = tokens[n..].iter().position(|t| t.text == ")")?;
    let rule = tokens.get(n + 5..n + close)?;
    let (first, last) = (rule.first()?, rule.iter().rfind(|t| t.kind == Kind::Word)?);
    let attribute = Attribute {
        range: tokens[n].at..tokens[n + close].range().end,
        severity,
        rule: &text[first.at..last.range().end],
    };
    Some((attribute, close + 1))
}

/// A directive `diagnostic(severity, rule);`.
fn directive<'t>(text: &'t str, tokens: &[Token<'t>], n: usize) -> Option<(usize, &'t str)> {
    let word = |k: usize| tokens.get(n + k).map(|t| t.text);
    if word(0)? != "diagnostic" || word(1)? != "(" || n > 0 && tokens[n - 1].text != ";" {
        return None;
    }
    let severity = SEVERITIES.iter().position(|s| word(2) == Some(s))?;
    let close = tokens[n..].iter().position(|t| t.text == ")")?;
    let rule = tokens.get(n + 4..n + close)?;
    let (first, last) = (rule.first()?, rule.last()?);
    Some((severity, &text[first.at..last.range().end]))
}

/// Moves each statement's attribute to its function. Of several with one rule, the weakest holds.
pub(super) fn lift(text: &str, tokens: &[Token<'_>], edits: &mut Edits) {
    let mut directives: Vec<(usize, &str)> = Vec::new();
    // Of the declaration: attributes in front of it, and those of its statements.
    let (mut own, mut inner): (Vec<Attribute<'_>>, Vec<Attribute<'_>>) = Default::default();
    let mut function: Option<usize> = None;
    let (mut braces, mut n) = (0_usize, 0);
    while let Some(token) = tokens.get(n) {
        let found = attribute(text, tokens, n);
        let length = found.as_ref().map_or(1, |(_, length)| *length);
        if let Some((attribute, _)) = found {
            match function {
                None if braces == 0 => own.push(attribute),
                Some(_) if is_of_statement(text, tokens, n) => inner.push(attribute),
                _ => {}
            }
            n += length;
            continue;
        }
        match token.text {
            "fn" if braces == 0 => function = Some(token.at),
            "{" => braces += 1,
            "}" => braces = braces.saturating_sub(1),
            "diagnostic" if braces == 0 => directives.extend(directive(text, tokens, n)),
            _ => {}
        }
        if braces == 0 && matches!(token.text, "}" | ";") {
            if let Some(at) = function.take() {
                settle(at, &own, &inner, &directives, edits);
            }
            own.clear();
            inner.clear();
        }
        n += 1;
    }
}

/// Whether a statement that may have attributes follows the attribute.
fn is_of_statement(text: &str, tokens: &[Token<'_>], mut n: usize) -> bool {
    while let Some((_, length)) = attribute(text, tokens, n) {
        n += length;
    }
    tokens.get(n).is_some_and(|t| STATEMENTS.contains(&t.text))
}

/// Writes a function's attributes in front of its `fn`, which is at `at`.
fn settle(
    at: usize,
    own: &[Attribute<'_>],
    inner: &[Attribute<'_>],
    directives: &[(usize, &str)],
    edits: &mut Edits,
) {
    let mut written = String::new();
    for (n, attribute) in inner.iter().enumerate() {
        edits.replace(attribute.range.clone(), "");
        if inner[..n].iter().any(|a| a.rule == attribute.rule) {
            continue;
        }
        let same = |a: &&Attribute<'_>| a.rule == attribute.rule;
        let alike = own.iter().chain(inner).filter(same).map(|a| a.severity);
        // Without an attribute of its own, a function has the module's severity.
        let is_own = own.iter().any(|a| a.rule == attribute.rule);
        let module = directives
            .iter()
            .filter(|(_, rule)| !is_own && *rule == attribute.rule);
        let weakest = alike.chain(module.map(|(severity, _)| *severity)).min();
        let severity = SEVERITIES[weakest.unwrap_or(attribute.severity)];
        written.push_str(&format!("@diagnostic({severity}, {}) ", attribute.rule));
        for replaced in own.iter().filter(same) {
            edits.replace(replaced.range.clone(), "");
        }
    }
    if !written.is_empty() {
        edits.replace(at..at, written);
    }
}

#[cfg(test)]
mod tests {
    use super::super::tokens::tokens;
    use super::*;

    #[test]
    fn the_function_gets_its_statements_attributes() {
        const RULE: &str = "derivative_uniformity";
        for (given, lifted) in [
            (
                "fn f() { @diagnostic(off, R) if a {} else @diagnostic(info, R) {} }",
                "@diagnostic(off, R) fn f() {  if a {} else  {} }",
            ),
            (
                "@diagnostic(warning, R) fn f() { @diagnostic(info,R) for (;;) {} }",
                " @diagnostic(info, R) fn f() {  for (;;) {} }",
            ),
            (
                "diagnostic(off, R); fn f() { @diagnostic(error, R) { a(); } }",
                "diagnostic(off, R); @diagnostic(off, R) fn f() {  { a(); } }",
            ),
            (
                "@diagnostic(off, R) fn f() {} fn g() @diagnostic(info, x.y) { }",
                "@diagnostic(off, R) fn f() {} @diagnostic(info, x.y) fn g()  { }",
            ),
            // Not at a statement that may have one.
            (
                "fn f() { @diagnostic(off, R) a = 1; }",
                "fn f() { @diagnostic(off, R) a = 1; }",
            ),
        ] {
            let (given, lifted) = (given.replace('R', RULE), lifted.replace('R', RULE));
            let mut edits = Edits::default();
            lift(&given, &tokens(&given), &mut edits);
            assert_eq!(edits.applied(&given), lifted);
        }
    }
}
