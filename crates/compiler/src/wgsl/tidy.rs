//! Makes naga's WGSL text readable, without changing the program.
//!
//! naga's writer gives every load, call result and texture sample a `let _e12 = ..;`. In each
//! function:
//!
//! - A load or texture read that is used once moves to its use, if nothing between can change the
//!   value.
//! - A call's result gets the author's `let` name, which the writer drops. Other results are named
//!   after their source.
//! - Names numbered only because of other functions lose the number.
//! - Parentheses around a whole right-hand side or argument go, and loops become `for` and `while`.
//!
//! before
//! ```wgsl
//! let _e7 = camera.view_proj;
//! out.clip = (_e7 * vec4<f32>(position, 1f));
//! let _e9 = shade(normal);
//! ```
//! after
//! ```wgsl
//! out.clip = camera.view_proj * vec4<f32>(position, 1f);
//! let color = shade(normal);
//! ```

use naga::{
    AddressSpace, Expression, FastHashMap, FastHashSet, Function, Handle, ImageClass, Module,
    StorageAccess, TypeInner,
};

use super::loops;
use shader_text::tokens as text;
use shader_text::tokens::{TokenKind, Words};

/// Tidies the text of `module` after the writer and `repair`.
pub(crate) fn tidy(module: &Module, text: &str) -> String {
    let module_words = module_words(text);
    let impure = declared_functions(module, text);
    let mut functions = module
        .functions
        .iter()
        .map(|(_, f)| f)
        .chain(module.entry_points.iter().map(|e| &e.function));
    let mut out = String::with_capacity(text.len());
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        if line.starts_with("@group(") {
            // The variable is on the next line.
            out.push_str(line.trim_end());
            out.push(' ');
            continue;
        }
        if !line.starts_with("fn ") {
            out.push_str(line);
            out.push('\n');
            continue;
        }
        let mut whole = vec![line];
        whole.extend(lines.by_ref().take_while(|l| *l != "}"));
        let tidied = match functions.next() {
            Some(function) => Body::new(module, function, &impure).tidy(&whole, &module_words),
            // A polyfill of the writer's.
            None => whole.iter().map(|l| (*l).to_owned()).collect(),
        };
        for line in tidied {
            out.push_str(&line);
            out.push('\n');
        }
        out.push_str("}\n");
    }
    out
}

/// Names of declared functions. A call of one may store to anything.
fn declared_functions(module: &Module, text: &str) -> FastHashSet<String> {
    let count = module.functions.len() + module.entry_points.len();
    text.lines()
        .filter_map(|l| l.strip_prefix("fn "))
        .take(count)
        .filter_map(|l| Some(l.split_once('(')?.0.to_owned()))
        .collect()
}

/// The words of global declarations, except for struct members and parameters.
fn module_words(text: &str) -> FastHashSet<&str> {
    text.lines()
        .filter(|l| !l.starts_with([' ', '}', '/']))
        .flat_map(|line| match line.strip_prefix("fn ") {
            Some(header) => vec![header.split('(').next().unwrap_or(header)],
            None => free_words(line).collect(),
        })
        .collect()
}

/// Words that are not members.
fn free_words(line: &str) -> impl Iterator<Item = &str> {
    let mut after_dot = false;
    text::tokens(line).filter_map(move |(kind, range)| {
        let word = &line[range];
        let free = kind == TokenKind::Word && !after_dot;
        after_dot = word == ".";
        free.then_some(word)
    })
}

struct Body<'a> {
    module: &'a Module,
    function: &'a Function,
    handles: Vec<Handle<Expression>>,
    impure: &'a FastHashSet<String>,
}

/// Whether the text is a name with members and indices. Indices are always bracketed.
fn is_place(text: &str) -> bool {
    let mut depth = 0usize;
    text::tokens(text).all(|(kind, range)| {
        match &text[range] {
            "[" => depth += 1,
            "]" => depth = depth.saturating_sub(1),
            "." => {}
            _ => return kind != TokenKind::Mark || depth > 0,
        }
        true
    })
}

/// The reads of a value, which limit where it may move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ChangedBy {
    /// Nothing: it may move within its scope.
    Constant,
    /// A texture: it may move within the same control flow.
    Texture,
    Variable,
}

/// A right-hand side that may move to its use.
struct MovableValue {
    text: String,
    reads: ChangedBy,
}

impl<'a> Body<'a> {
    fn new(module: &'a Module, function: &'a Function, impure: &'a FastHashSet<String>) -> Self {
        Self {
            module,
            function,
            handles: function.expressions.iter().map(|(h, _)| h).collect(),
            impure,
        }
    }

    /// A function's lines without the last brace.
    fn tidy(&self, whole: &[&str], module_words: &FastHashSet<&str>) -> Vec<String> {
        let mut lines = self.write_where_used(whole);
        let mut words: FastHashSet<&str> = whole.iter().flat_map(|l| free_words(l)).collect();
        words.extend(module_words);
        let mut names = self.result_names(&lines, &words);
        self.shorten(whole, module_words, &mut names);
        for line in &mut lines {
            let renamed =
                text::rename_words(line, Words::Free, |w| names.get(w).map(String::as_str));
            *line = without_argument_parentheses(&without_outer_parentheses(&renamed));
        }
        loops::structured(lines)
    }

    /// Moves values that are used once to their use, where that is safe.
    fn write_where_used(&self, whole: &[&str]) -> Vec<String> {
        let mut lines: Vec<Option<String>> = whole.iter().map(|l| Some((*l).to_owned())).collect();
        let uses = uses(whole);
        let barriers = self.barriers(whole);
        // Lines that now read a variable.
        let mut reading: FastHashSet<usize> = FastHashSet::default();
        // By line: the values that move there.
        let mut moved: FastHashMap<usize, FastHashMap<String, String>> = FastHashMap::default();
        for line in 0..lines.len() {
            if let (Some(values), Some(text)) = (moved.remove(&line), &mut lines[line]) {
                *text =
                    text::rename_words(text, Words::Free, |w| values.get(w).map(String::as_str));
            }
            let Some(expression) = lines[line].as_deref().and_then(baked) else {
                continue;
            };
            let (Some(value), Some([_, target])) = (
                self.movable(expression, lines[line].as_deref()),
                uses.get(&expression).map(Vec::as_slice),
            ) else {
                continue;
            };
            let reads = value.reads == ChangedBy::Variable || reading.contains(&line);
            if (reads || value.reads == ChangedBy::Texture)
                && barriers[line + 1] != barriers[*target]
            {
                continue;
            }
            let values = moved.entry(*target).or_default();
            values.insert(format!("_e{expression}"), value.text);
            lines[line] = None;
            if reads {
                reading.insert(*target);
            }
        }
        lines.into_iter().flatten().collect()
    }

    /// The movable value of a `let`: a load written with names, members and indices, or a texture
    /// read. Both bind tighter than any operator.
    fn movable(&self, expression: usize, line: Option<&str>) -> Option<MovableValue> {
        let handle = self.handle(expression)?;
        let (_, right) = line?.split_once(" = ")?;
        let right = right.strip_suffix(';')?;
        let reads = match self.function.expressions[handle] {
            Expression::Load { pointer } => {
                match (is_place(right), self.is_constant_memory(pointer)) {
                    (false, _) => return None,
                    (true, true) => ChangedBy::Constant,
                    (true, false) => ChangedBy::Variable,
                }
            }
            Expression::ImageSample { .. } => ChangedBy::Texture,
            Expression::ImageLoad { image, .. } if !self.is_storage_texture(image) => {
                ChangedBy::Texture
            }
            _ => return None,
        };
        Some(MovableValue {
            text: right.to_owned(),
            reads,
        })
    }

    fn is_storage_texture(&self, image: Handle<Expression>) -> bool {
        let Expression::GlobalVariable(global) = self.function.expressions[image] else {
            return true;
        };
        matches!(
            self.module.types[self.module.global_variables[global].ty].inner,
            TypeInner::Image {
                class: ImageClass::Storage { .. },
                ..
            }
        )
    }

    fn handle(&self, index: usize) -> Option<Handle<Expression>> {
        self.handles.get(index).copied()
    }

    /// Whether a pointer points to memory that no shader of the draw writes: a uniform or read-only
    /// buffer.
    fn is_constant_memory(&self, pointer: Handle<Expression>) -> bool {
        let Expression::GlobalVariable(global) = *self.root(pointer) else {
            return false;
        };
        match self.module.global_variables[global].space {
            AddressSpace::Uniform | AddressSpace::Immediate => true,
            AddressSpace::Storage { access } => !access.contains(StorageAccess::STORE),
            _ => false,
        }
    }

    /// The base variable of an access chain.
    fn root(&self, mut at: Handle<Expression>) -> &Expression {
        loop {
            match &self.function.expressions[at] {
                Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => {
                    at = *base
                }
                other => return other,
            }
        }
    }

    /// For each line and the end: how many preceding lines may change a variable or begin or end a
    /// block. Only `let`s without calls that write are harmless.
    fn barriers(&self, lines: &[&str]) -> Vec<usize> {
        let pure = |line: &str| {
            line.trim_start().starts_with("let ")
                && text::tokens(line).all(|(kind, range)| {
                    let word = &line[range];
                    let writes = self.impure.contains(word)
                        || word.starts_with("atomic")
                        || word.starts_with("workgroup")
                        || word.starts_with("subgroup");
                    kind != TokenKind::Word || !writes
                })
        };
        let mut count = 0;
        let mut counts = vec![0];
        for line in lines {
            count += usize::from(!pure(line));
            counts.push(count);
        }
        counts
    }

    /// New names for the remaining `_e12`s.
    fn result_names(
        &self,
        lines: &[String],
        words: &FastHashSet<&str>,
    ) -> FastHashMap<String, String> {
        let mut names: FastHashMap<String, String> = FastHashMap::default();
        let mut given: FastHashSet<String> = FastHashSet::default();
        for expression in lines.iter().filter_map(|l| baked(l)) {
            let Some(wanted) = self.handle(expression).and_then(|h| self.wanted_name(h)) else {
                continue;
            };
            let unique = unique(&wanted, |n| words.contains(n) || given.contains(n));
            given.insert(unique.clone());
            names.insert(format!("_e{expression}"), unique);
        }
        names
    }

    /// Removes numbers that naga adds to names used anywhere else in the module (`uv_1`), if the
    /// name is free in this function.
    fn shorten(
        &self,
        whole: &[&str],
        module_words: &FastHashSet<&str>,
        names: &mut FastHashMap<String, String>,
    ) {
        let own: FastHashSet<&str> = self
            .function
            .arguments
            .iter()
            .filter_map(|a| a.name.as_deref())
            .chain(
                self.function
                    .local_variables
                    .iter()
                    .filter_map(|(_, l)| l.name.as_deref()),
            )
            .chain(self.function.named_expressions.values().map(String::as_str))
            .collect();
        let used: FastHashSet<&str> = whole.iter().flat_map(|l| free_words(l)).collect();
        let mut given: FastHashSet<String> = names.values().cloned().collect();
        for word in whole.iter().flat_map(|l| free_words(l)) {
            let Some((base, number)) = word.rsplit_once('_') else {
                continue;
            };
            let numbered = !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit());
            let free = !used.contains(base)
                && !module_words.contains(base)
                && !given.contains(base)
                && !is_known(base);
            // If the function declares a local of its own name, the number may be the function's.
            let module_level = module_words.contains(word);
            if numbered && own.contains(base) && !own.contains(word) && !module_level && free {
                given.insert(base.to_owned());
                names.insert(word.to_owned(), base.to_owned());
            }
        }
    }

    fn wanted_name(&self, handle: Handle<Expression>) -> Option<String> {
        if let Some(name) = self.function.named_expressions.get(&handle) {
            return Some(name.clone());
        }
        let global = |e: Handle<Expression>| match self.function.expressions[e] {
            Expression::GlobalVariable(g) => self.module.global_variables[g].name.clone(),
            _ => None,
        };
        match &self.function.expressions[handle] {
            Expression::CallResult(callee) => {
                let name = self.module.functions[*callee].name.as_deref()?;
                Some(format!("{name}_result"))
            }
            Expression::ImageSample { image, .. } | Expression::ImageLoad { image, .. } => {
                Some(format!("{}_texel", global(*image)?))
            }
            Expression::ImageQuery { image, .. } => Some(format!("{}_size", global(*image)?)),
            Expression::Load { pointer } => Some(format!("{}_value", self.member(*pointer)?)),
            _ => Some("value".to_owned()),
        }
    }

    /// The name of a pointer's target.
    fn member(&self, pointer: Handle<Expression>) -> Option<String> {
        let named = match &self.function.expressions[pointer] {
            Expression::LocalVariable(l) => self.function.local_variables[*l].name.clone(),
            Expression::GlobalVariable(g) => self.module.global_variables[*g].name.clone(),
            Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => {
                self.member(*base)
            }
            _ => None,
        };
        named.filter(|n| !n.is_empty())
    }
}

/// `name`, or with a number if the text already has it.
fn unique(name: &str, used: impl Fn(&str) -> bool) -> String {
    let plain: String = name
        .chars()
        .filter(|c| c.is_ascii_alphanumeric() || *c == '_')
        .collect();
    // naga and WGSL reject two leading underscores, and `_` alone is not a name.
    let plain = plain.trim_start_matches(|c: char| c == '_' || c.is_ascii_digit());
    let plain = if plain.is_empty() { "value" } else { plain };
    let taken = |n: &str| used(n) || is_known(n);
    if !taken(plain) {
        return plain.to_owned();
    }
    (2..)
        .map(|i| format!("{plain}{i}"))
        .find(|n| !taken(n))
        .unwrap_or_default()
}

/// Whether the word is reserved or predeclared in WGSL.
fn is_known(word: &str) -> bool {
    naga::keywords::wgsl::RESERVED_SET.contains(word)
        || naga::keywords::wgsl::BUILTIN_IDENTIFIER_SET.contains(word)
}

/// The number in `    let _e12 = ..;`, with or without a type.
fn baked(line: &str) -> Option<usize> {
    let rest = line.trim_start().strip_prefix("let _e")?;
    let digits = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    rest[..digits].parse().ok()
}

/// For each `_e12`, the lines that mention it, once per mention, its `let` first.
fn uses(body: &[&str]) -> FastHashMap<usize, Vec<usize>> {
    let mut uses: FastHashMap<usize, Vec<usize>> = FastHashMap::default();
    for (line, text) in body.iter().enumerate() {
        for (kind, range) in text::tokens(text) {
            if kind == TokenKind::Word
                && let Some(number) = text[range].strip_prefix("_e")
                && let Ok(number) = number.parse()
            {
                uses.entry(number).or_default().push(line);
            }
        }
    }
    uses
}

/// `a = (b + c);` without parentheses that enclose the whole right-hand side of a `let`, an
/// assignment or a return.
fn without_outer_parentheses(line: &str) -> String {
    let strip = |start: usize| -> Option<String> {
        let inner = line[start..].strip_prefix('(')?.strip_suffix(");")?;
        let mut depth = 0i32;
        for (_, range) in text::tokens(inner) {
            match &inner[range] {
                "(" => depth += 1,
                ")" => depth -= 1,
                _ => {}
            }
            if depth < 0 {
                return None;
            }
        }
        Some(format!("{}{inner};", &line[..start]))
    };
    let start = match line.find(" = ") {
        Some(at) => at + 3,
        None => match line.find("return (") {
            Some(at) => at + 7,
            None => return line.to_owned(),
        },
    };
    strip(start).unwrap_or_else(|| line.to_owned())
}

/// `f((a + b), (c))` without parentheses around whole arguments and indices. Comparisons keep
/// theirs: `f((a < b), (c > d))` could otherwise be read as a template.
fn without_argument_parentheses(line: &str) -> String {
    let tokens: Vec<_> = text::tokens(line).map(|(_, range)| range).collect();
    let word = |i: usize| tokens.get(i).map_or("", |r| &line[r.clone()]);
    let mut dropped: Vec<usize> = Vec::new();
    let mut open: Vec<usize> = Vec::new();
    for i in 0..tokens.len() {
        match word(i) {
            "(" => open.push(i),
            ")" => {
                let Some(start) = open.pop() else { continue };
                let before = start.checked_sub(1).map_or("", word);
                let whole =
                    matches!(before, "(" | "," | "[") && matches!(word(i + 1), ")" | "," | "]");
                let inside = &line[tokens[start].end..tokens[i].start];
                if whole && !inside.contains(" <") && !inside.contains(" >") {
                    dropped.extend([tokens[start].start, tokens[i].start]);
                }
            }
            _ => {}
        }
    }
    if dropped.is_empty() {
        return line.to_owned();
    }
    line.char_indices()
        .filter(|(at, _)| !dropped.contains(at))
        .map(|(_, c)| c)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_needless_parentheses_go() {
        let bare = |l| without_argument_parentheses(&without_outer_parentheses(l));
        assert_eq!(bare("x = (a + (b * c));"), "x = a + (b * c);");
        assert_eq!(bare("x = (a + b) * (c + d);"), "x = (a + b) * (c + d);");
        assert_eq!(bare("return ((a + b));"), "return (a + b);");
        assert_eq!(
            bare("f((a + b), c[(i & 3u)], (&p));"),
            "f(a + b, c[i & 3u], &p);"
        );
        assert_eq!(bare("f((a < b), (c > d));"), "f((a < b), (c > d));");
        assert_eq!(bare("if ((a + b) == c) {"), "if ((a + b) == c) {");
    }
}
