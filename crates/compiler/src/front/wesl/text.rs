//! Converts a WESL text to the subset of the crate `wesl` 0.4.0: newer versions need a newer Rust.
//!
//! - [`with_conditions`] evaluates `@if`, `@elif` and `@else`, also in front of a block. The
//!   block's items or statements then take its place. Removed text becomes spaces, so that lines
//!   and columns stay.
//! - [`with_one_package`] turns imports of packages into imports of `package::packages::NAME`. The
//!   crate takes a package that two packages import for two.

use std::collections::{HashMap, HashSet};
use std::ops::Range;

/// Folder of the other packages among the modules of the one package that the crate sees.
pub(super) const PACKAGES: &str = "packages";

/// A condition that cannot be evaluated: the message, and the place in the text.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Wrong(pub String, pub Range<usize>);

/// A token: its text's range. Comments and spaces are left out.
struct Tokens<'t> {
    text: &'t str,
    ranges: Vec<Range<usize>>,
    /// By opening bracket, its closing one.
    closed_by: HashMap<usize, usize>,
}

impl<'t> Tokens<'t> {
    fn new(text: &'t str) -> Self {
        let bytes = text.as_bytes();
        let is_word = |b: &u8| b.is_ascii_alphanumeric() || *b == b'_' || *b >= 0x80;
        let mut ranges = Vec::new();
        let mut at = 0;
        while at < bytes.len() {
            let rest = &text.as_bytes()[at..];
            let length = match rest {
                [b'/', b'/', ..] => rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len()),
                [b'/', b'*', ..] => block_comment(rest),
                [b, ..] if b.is_ascii_whitespace() => 1,
                _ => {
                    let length = match rest {
                        [b':', b':', ..] | [b'&', b'&', ..] | [b'|', b'|', ..] => 2,
                        _ => rest
                            .iter()
                            .position(|b| !is_word(b))
                            .unwrap_or(rest.len())
                            .max(1),
                    };
                    ranges.push(at..at + length);
                    length
                }
            };
            at += length;
        }
        let mut tokens = Self {
            text,
            ranges,
            closed_by: HashMap::new(),
        };
        let mut open = Vec::new();
        for i in 0..tokens.ranges.len() {
            match tokens.get(i) {
                "(" | "[" | "{" => open.push(i),
                ")" | "]" | "}" => {
                    if let Some(start) = open.pop() {
                        tokens.closed_by.insert(start, i);
                    }
                }
                _ => {}
            }
        }
        tokens
    }

    fn get(&self, i: usize) -> &'t str {
        self.ranges.get(i).map_or("", |r| &self.text[r.clone()])
    }

    /// The token behind the bracket that closes the one at `i`, or the end.
    fn behind(&self, i: usize) -> usize {
        self.closed_by
            .get(&i)
            .map_or(self.ranges.len(), |end| end + 1)
    }

    /// The token behind an attribute at `i`.
    fn behind_attribute(&self, i: usize) -> usize {
        match self.get(i + 2) {
            "(" => self.behind(i + 2),
            _ => i + 2,
        }
    }

    /// The token behind the item, statement, member or parameter that starts at `i`.
    fn behind_node(&self, mut i: usize, is_listed: bool) -> usize {
        while self.get(i) == "@" {
            i = self.behind_attribute(i);
        }
        let is_import = self.get(i) == "import";
        let mut templates = 0;
        while i < self.ranges.len() {
            match self.get(i) {
                ";" => return i + 1,
                "," if is_listed && templates == 0 => return i + 1,
                ")" | "]" | "}" => return i,
                "<" if is_listed => templates += 1,
                ">" if is_listed => templates -= 1,
                "{" if !is_import => {
                    i = self.behind(i);
                    match self.get(i) {
                        "else" => {}
                        _ => return i,
                    }
                }
                "(" | "[" | "{" => {
                    i = self.behind(i);
                    continue;
                }
                _ => {}
            }
            i += 1;
        }
        i
    }

    fn span(&self, range: Range<usize>) -> Range<usize> {
        let start = self
            .ranges
            .get(range.start)
            .map_or(self.text.len(), |r| r.start);
        let last = range.end.saturating_sub(1).max(range.start);
        start..self.ranges.get(last).map_or(self.text.len(), |r| r.end)
    }
}

fn block_comment(text: &[u8]) -> usize {
    let (mut depth, mut at) = (0, 0);
    while at < text.len() {
        match &text[at..] {
            [b'/', b'*', ..] => (depth, at) = (depth + 1, at + 2),
            [b'*', b'/', ..] => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
        if depth == 0 {
            break;
        }
    }
    at
}

/// The text with its conditions evaluated. `is_on` gives the value of a name.
///
/// # Errors
/// A condition that is no expression of names, `true`, `false`, `!`, `&&` and `||`, or an `@elif` or
/// `@else` that follows no `@if`.
pub(super) fn with_conditions(text: &str, is_on: &dyn Fn(&str) -> bool) -> Result<String, Wrong> {
    let tokens = Tokens::new(text);
    let mut out = text.as_bytes().to_vec();
    let mut blank = |range: Range<usize>| {
        for byte in out[range].iter_mut().filter(|b| !b.is_ascii_whitespace()) {
            *byte = b' ';
        }
    };
    // By the token behind a node with a condition: whether one of its chain was true.
    let mut chains: HashMap<usize, bool> = HashMap::new();
    // Of each open bracket, whether it holds members or parameters.
    let mut open = Vec::new();
    let mut i = 0;
    while i < tokens.ranges.len() {
        match tokens.get(i) {
            "@" => {}
            bracket @ ("(" | "{" | "[") => {
                open.push(bracket != "{" || (i >= 2 && tokens.get(i - 2) == "struct"));
            }
            ")" | "}" | "]" => {
                open.pop();
            }
            _ => {}
        }
        if tokens.get(i) != "@" {
            i += 1;
            continue;
        }
        let start = i;
        let mut condition = None;
        while tokens.get(i) == "@" {
            let end = tokens.behind_attribute(i);
            if matches!(tokens.get(i + 1), "if" | "elif" | "else") {
                condition = Some(i..end);
            }
            i = end;
        }
        let Some(condition) = condition else {
            continue;
        };
        let is_listed = open.last().copied().unwrap_or_default();
        let end = tokens.behind_node(start, is_listed);
        let before = match tokens.get(condition.start + 1) {
            "if" => false,
            word => *chains.get(&start).ok_or_else(|| {
                let span = tokens.span(condition.clone());
                Wrong(format!("`@{word}` follows no `@if`"), span)
            })?,
        };
        let holds = match tokens.get(condition.start + 1) {
            "else" => true,
            _ => Condition::holds(&tokens, condition.start + 3..condition.end - 1, is_on)?,
        };
        chains.insert(end, before || holds);
        if before || !holds {
            blank(tokens.span(start..end));
            i = end;
            continue;
        }
        blank(tokens.span(condition));
        if tokens.get(i) == "{" {
            // Its items or statements take the place of the block.
            blank(tokens.ranges[i].clone());
            if let Some(close) = tokens.closed_by.get(&i) {
                blank(tokens.ranges[*close].clone());
            }
        }
    }
    Ok(String::from_utf8(out).unwrap_or_else(|_| text.to_owned()))
}

/// The expression of a condition.
struct Condition<'c, 't> {
    tokens: &'c Tokens<'t>,
    range: Range<usize>,
    is_on: &'c dyn Fn(&str) -> bool,
}

impl Condition<'_, '_> {
    fn holds(
        tokens: &Tokens<'_>,
        range: Range<usize>,
        is_on: &dyn Fn(&str) -> bool,
    ) -> Result<bool, Wrong> {
        let mut condition = Condition {
            tokens,
            range,
            is_on,
        };
        let holds = condition.or()?;
        match condition.range.is_empty() {
            true => Ok(holds),
            false => Err(condition.wrong()),
        }
    }

    fn wrong(&self) -> Wrong {
        let what = "a condition consists of names, `true`, `false`, `!`, `&&`, `||` and brackets";
        Wrong(what.to_owned(), self.tokens.span(self.range.clone()))
    }

    fn takes(&mut self, token: &str) -> bool {
        let is_next = !self.range.is_empty() && self.tokens.get(self.range.start) == token;
        self.range.start += usize::from(is_next);
        is_next
    }

    fn or(&mut self) -> Result<bool, Wrong> {
        let mut holds = self.and()?;
        while self.takes("||") {
            holds |= self.and()?;
        }
        Ok(holds)
    }

    fn and(&mut self) -> Result<bool, Wrong> {
        let mut holds = self.term()?;
        while self.takes("&&") {
            holds &= self.term()?;
        }
        Ok(holds)
    }

    fn term(&mut self) -> Result<bool, Wrong> {
        if self.takes("!") {
            return Ok(!self.term()?);
        }
        if self.takes("(") {
            let holds = self.or()?;
            return match self.takes(")") {
                true => Ok(holds),
                false => Err(self.wrong()),
            };
        }
        let name = self.tokens.get(self.range.start);
        let is_name = name.starts_with(|c: char| c.is_alphabetic() || c == '_');
        if self.range.is_empty() || !is_name {
            return Err(self.wrong());
        }
        self.range.start += 1;
        Ok(match name {
            "true" | "false" => name == "true",
            _ => (self.is_on)(name),
        })
    }
}

/// The conditions under which a module declares `name`, outermost first; `None` if it has no such
/// declaration.
pub(super) fn conditions_of(text: &str, name: &str) -> Option<Vec<String>> {
    let tokens = Tokens::new(text);
    let declares = |i: &usize| {
        let words = ["fn", "const", "alias", "struct", "override", "var"];
        let before = tokens.get(i.wrapping_sub(1));
        let is_typed = before == ">" && matches!(tokens.get(i + 1), ":" | "=");
        tokens.get(*i) == name && (words.contains(&before) || is_typed)
    };
    let declaration = (0..tokens.ranges.len()).find(declares)?;
    let mut conditions = Vec::new();
    // By the token behind a node with a condition: the conditions of its chain.
    let mut chains: HashMap<usize, Vec<&str>> = HashMap::new();
    for start in 0..declaration {
        let word = tokens.get(start + 1);
        if tokens.get(start) != "@" || !matches!(word, "if" | "elif" | "else") {
            continue;
        }
        let end = tokens.behind_node(start, false);
        let mut chain = match word {
            "if" => Vec::new(),
            _ => chains.get(&start).cloned().unwrap_or_default(),
        };
        let attribute = tokens.span(start..tokens.behind_attribute(start));
        chain.push(&text[attribute]);
        if (start..end).contains(&declaration) {
            conditions.push(chain.join(" .. "));
        }
        chains.insert(end, chain);
    }
    Some(conditions)
}

/// The tokens of the `import` statements, each without its first word.
fn imports(tokens: &Tokens<'_>) -> Vec<Range<usize>> {
    let starts = (0..tokens.ranges.len()).filter(|i| tokens.get(*i) == "import");
    let end = |i: &usize| tokens.get(*i) == ";" || *i == tokens.ranges.len();
    starts
        .filter_map(|start| Some(start + 1..(start + 1..).find(end)?))
        .collect()
}

/// The text of a module of `package` (`None`: the author's own) as a module of one package that
/// contains all others below [`PACKAGES`].
pub(super) fn with_one_package(text: &str, package: Option<&str>) -> String {
    let tokens = Tokens::new(text);
    let imports = imports(&tokens);
    // A path may start with the name of an imported module.
    let ends = |i: &usize| matches!(tokens.get(i + 1), ";" | "," | "}");
    let names = imports.iter().cloned().flatten().filter(ends);
    let names: HashSet<&str> = names.map(|i| tokens.get(i)).collect();
    let mut out = String::with_capacity(text.len());
    let mut copied = 0;
    for i in 0..tokens.ranges.len() {
        if tokens.get(i + 1) != "::" || (i > 0 && tokens.get(i - 1) == "::") {
            continue;
        }
        let continues = match imports.iter().find(|import| import.contains(&i)) {
            Some(import) => i > import.start,
            None => names.contains(tokens.get(i)),
        };
        let prefix = match (tokens.get(i), package) {
            _ if continues => continue,
            ("package", Some(package)) => format!("package::{PACKAGES}::{package}"),
            ("package" | "super", _) => continue,
            (other, _) => format!("package::{PACKAGES}::{other}"),
        };
        out.push_str(&text[copied..tokens.ranges[i].start]);
        out.push_str(&prefix);
        copied = tokens.ranges[i].end;
    }
    out.push_str(&text[copied..]);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(text: &str) -> String {
        let out = with_conditions(text, &|name| name == "ON").expect("valid conditions");
        assert_eq!(out.len(), text.len());
        out.split_whitespace().collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn a_block_gives_its_items() {
        let text = "@if(OFF) { const a = 1; fn f() {} } @elif(ON) { const a = 2; const b = 3; } \
                    @else { const a = 4; } const c = 5;";
        assert_eq!(kept(text), "const a = 2; const b = 3; const c = 5;");
        let text = "fn f() { @if(ON) { let x = 1; } @else { let x = 2; } return; }";
        assert_eq!(kept(text), "fn f() { let x = 1; return; }");
    }

    #[test]
    fn a_condition_takes_one_node() {
        let text =
            "struct S { @if(OFF) @location(0) a: array<f32, 4>, @if(ON) b: vec2<f32>, c: f32 }";
        assert_eq!(kept(text), "struct S { b: vec2<f32>, c: f32 }");
        let text = "fn f(@if(OFF) a: f32, @if(!OFF) @builtin(position) b: vec4f) {}";
        assert_eq!(kept(text), "fn f( @builtin(position) b: vec4f) {}");
        let text = "@if(OFF) import a::{b, c::{d}}; @else import e::f; @fragment fn g() {}";
        assert_eq!(kept(text), "import e::f; @fragment fn g() {}");
        let text = "@if(OFF) if a { b(); } else if c { d(); } else { e(); } @else g(); h();";
        assert_eq!(kept(text), "g(); h();");
        let text =
            "@if(OFF) var<storage, read> a: array<f32>; @if(ON && (OFF || true)) // no\n x();";
        assert_eq!(kept(text), "// no x();");
        let text = "@if(OFF) { @if(ON) { a(); } @else { b(); } } @else { @if(ON) c(); @else d(); }";
        assert_eq!(kept(text), "c();");
    }

    #[test]
    fn wrong_conditions_are_named_with_their_place() {
        let wrong = |text| with_conditions(text, &|_| true).expect_err("it is wrong").1;
        assert_eq!(wrong("fn f() {} @else fn g() {}"), 10..15);
        assert_eq!(wrong("@if(A + B) fn f() {}"), 6..9);
    }

    #[test]
    fn the_conditions_of_a_declaration_are_found() {
        let text = "@if(A) { @if(B) fn f() {} @else fn g() {} } fn h() { g(); } \
                    @if(C) var<private> v: f32;";
        let of = |name| conditions_of(text, name);
        assert_eq!(
            of("f"),
            Some(vec!["@if(A)".to_owned(), "@if(B)".to_owned()])
        );
        assert_eq!(
            of("g"),
            Some(vec!["@if(A)".to_owned(), "@if(B) .. @else".to_owned()])
        );
        assert_eq!(of("v"), Some(vec!["@if(C)".to_owned()]));
        assert_eq!(of("h"), Some(Vec::new()));
        assert_eq!(of("i"), None);
    }

    #[test]
    fn packages_are_modules_of_one() {
        let text = "import pb::deep::two; import package::{a, b::h}; @if(x) import super::c; \
                    fn f() { package::g(); h::i(); pc::d::e(); }";
        let expected = "import package::packages::pb::deep::two; import package::packages::pa::{a, \
                        b::h}; @if(x) import super::c; fn f() { package::packages::pa::g(); h::i(); \
                        package::packages::pc::d::e(); }";
        assert_eq!(with_one_package(text, Some("pa")), expected);
        let own = with_one_package("import package::a; import pb::c;", None);
        assert_eq!(own, "import package::a; import package::packages::pb::c;");
    }
}
