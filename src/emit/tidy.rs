//! Makes naga's WGSL read like an author's, by rewriting its text and nothing else.
//!
//! naga's writer gives every load, call result and texture sample a `let _e12 = ..;`. Here, function by function:
//!
//! - a load that is used once is written where it is used, if nothing in between could change what it reads;
//! - a call's result gets the author's `let` name back, which the writer drops; other results are named after what they read or call;
//! - the parentheses around a whole right-hand side go.
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

use std::collections::{HashMap, HashSet};

use naga::{AddressSpace, Expression, Function, GlobalVariable, Handle, Module, StorageAccess};

use super::text::{self, Kind};

/// The text of `module` as the writer (and `repair`) left it, tidied.
pub(super) fn tidy(module: &Module, text: &str) -> String {
    let module_words = module_words(text);
    let impure: HashSet<String> = called_names(module, text);
    let mut functions = module
        .functions
        .iter()
        .map(|(_, f)| f)
        .chain(module.entry_points.iter().map(|e| &e.function));
    let mut out = String::with_capacity(text.len());
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        out.push_str(line);
        out.push('\n');
        if !line.starts_with("fn ") {
            continue;
        }
        let body: Vec<&str> = lines.by_ref().take_while(|l| *l != "}").collect();
        match functions.next() {
            Some(function) => {
                let mut words = module_words.clone();
                words.extend(
                    std::iter::once(&line)
                        .chain(&body)
                        .flat_map(|l| free_words(l)),
                );
                for line in Body::new(module, function, &impure).tidy(&body, words) {
                    out.push_str(&line);
                    out.push('\n');
                }
            }
            // A polyfill of the writer's own.
            None => body.iter().for_each(|line| {
                out.push_str(line);
                out.push('\n');
            }),
        }
        out.push_str("}\n");
    }
    out
}

/// Names of the functions the text declares: a call of one may store to anything.
fn called_names(module: &Module, text: &str) -> HashSet<String> {
    let count = module.functions.len() + module.entry_points.len();
    text.lines()
        .filter_map(|l| l.strip_prefix("fn "))
        .take(count)
        .filter_map(|l| Some(l.split_once('(')?.0.to_owned()))
        .collect()
}

/// Words of declarations at module scope, struct members and parameters of functions excepted.
fn module_words(text: &str) -> HashSet<&str> {
    text.lines()
        .filter(|l| !l.starts_with([' ', '}', '/']))
        .flat_map(|line| match line.strip_prefix("fn ") {
            Some(header) => vec![header.split('(').next().unwrap_or(header)],
            None => free_words(line).collect(),
        })
        .collect()
}

/// Words that are not the name of a member.
fn free_words(line: &str) -> impl Iterator<Item = &str> {
    let mut after_dot = false;
    text::tokens(line).filter_map(move |(kind, range)| {
        let word = &line[range];
        let free = kind == Kind::Word && !after_dot;
        after_dot = word == ".";
        free.then_some(word)
    })
}

struct Body<'a> {
    module: &'a Module,
    function: &'a Function,
    handles: Vec<Handle<Expression>>,
    impure: &'a HashSet<String>,
}

/// A `let _e12 = ..;` line.
struct Let {
    expression: usize,
}

impl<'a> Body<'a> {
    fn new(module: &'a Module, function: &'a Function, impure: &'a HashSet<String>) -> Self {
        Self {
            module,
            function,
            handles: function.expressions.iter().map(|(h, _)| h).collect(),
            impure,
        }
    }

    fn tidy(&self, body: &[&str], words: HashSet<&str>) -> Vec<String> {
        let mut lines: Vec<Option<String>> = body.iter().map(|l| Some((*l).to_owned())).collect();
        let uses = uses(body);
        let mut mutable: HashSet<usize> = HashSet::new();
        let mut kept: Vec<Let> = Vec::new();
        for line in 0..lines.len() {
            let Some(found) = lines[line].as_deref().and_then(baked) else {
                continue;
            };
            let place = self.place(&found, lines[line].as_deref());
            let target = place
                .as_ref()
                .and_then(|_| uses.get(&found.expression))
                .filter(|lines| lines.len() == 2)
                .map(|lines| lines[1]);
            if let (Some(place), Some(target)) = (place, target) {
                let reads_variable =
                    !self.is_constant_memory(found.expression) || mutable.contains(&line);
                let free = !reads_variable || self.nothing_stores(&lines[line + 1..target]);
                if free {
                    let name = format!("_e{}", found.expression);
                    if let Some(text) = &mut lines[target] {
                        *text = text::rename_words(text, |w| (w == name).then_some(place.as_str()));
                    }
                    lines[line] = None;
                    if reads_variable {
                        mutable.insert(target);
                    }
                    continue;
                }
            }
            kept.push(found);
        }
        let names = self.names(&kept, &words);
        lines
            .into_iter()
            .flatten()
            .map(|line| {
                let renamed = text::rename_words(&line, |w| names.get(w).map(String::as_str));
                without_outer_parentheses(&renamed)
            })
            .collect()
    }

    /// The right-hand side of a load, if it is only names, members and indices, which bind tighter than any operator.
    fn place(&self, found: &Let, line: Option<&str>) -> Option<String> {
        let handle = self.handle(found.expression)?;
        if !matches!(self.function.expressions[handle], Expression::Load { .. }) {
            return None;
        }
        let (_, right) = line?.split_once(" = ")?;
        let right = right.strip_suffix(';')?;
        let simple = text::tokens(right)
            .all(|(kind, range)| kind != Kind::Mark || matches!(&right[range], "." | "[" | "]"));
        simple.then(|| right.to_owned())
    }

    fn handle(&self, index: usize) -> Option<Handle<Expression>> {
        self.handles.get(index).copied()
    }

    /// Whether a load reads memory that no shader of the draw writes: a uniform, or a read-only buffer.
    fn is_constant_memory(&self, index: usize) -> bool {
        let constant =
            |global: Handle<GlobalVariable>| match self.module.global_variables[global].space {
                AddressSpace::Uniform | AddressSpace::Immediate => true,
                AddressSpace::Storage { access } => !access.contains(StorageAccess::STORE),
                _ => false,
            };
        let Some(Expression::Load { pointer }) =
            self.handle(index).map(|h| &self.function.expressions[h])
        else {
            return false;
        };
        matches!(self.root(*pointer), Expression::GlobalVariable(global) if constant(*global))
    }

    /// The variable an access chain begins at.
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

    /// Whether these lines, between a load and its use, leave every variable as it is and are run exactly when the load is: `let`s without
    /// calls of the module's own functions or of built-in functions that write.
    fn nothing_stores(&self, lines: &[Option<String>]) -> bool {
        lines.iter().flatten().all(|line| {
            line.trim_start().starts_with("let ")
                && text::tokens(line).all(|(kind, range)| {
                    let word = &line[range];
                    let writes = self.impure.contains(word)
                        || word.starts_with("atomic")
                        || word.starts_with("workgroup")
                        || word.starts_with("subgroup");
                    kind != Kind::Word || !writes
                })
        })
    }

    /// New names for the `_e12`s that stay.
    fn names(&self, kept: &[Let], words: &HashSet<&str>) -> HashMap<String, String> {
        let mut names: HashMap<String, String> = HashMap::new();
        let mut given: HashSet<String> = HashSet::new();
        for found in kept {
            let Some(handle) = self.handle(found.expression) else {
                continue;
            };
            let Some(wanted) = self.wanted_name(handle) else {
                continue;
            };
            let unique = unique(&wanted, |n| words.contains(n) || given.contains(n));
            given.insert(unique.clone());
            names.insert(format!("_e{}", found.expression), unique);
        }
        names
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
            _ => None,
        }
    }

    /// The name of what a pointer points at.
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

/// `name`, or the name with a number that no word of the text has.
fn unique(name: &str, used: impl Fn(&str) -> bool) -> String {
    let plain: String = name
        .chars()
        .filter(|c| c.is_ascii_alphanumeric() || *c == '_')
        .collect();
    // naga and WGSL refuse two underscores in front; `_` alone is no name.
    let plain = plain.trim_start_matches(|c: char| c == '_' || c.is_ascii_digit());
    let plain = if plain.is_empty() { "value" } else { plain };
    let taken = |n: &str| {
        used(n)
            || naga::keywords::wgsl::RESERVED.contains(&n)
            || naga::keywords::wgsl::BUILTIN_IDENTIFIERS.contains(&n)
    };
    if !taken(plain) {
        return plain.to_owned();
    }
    (2..)
        .map(|i| format!("{plain}{i}"))
        .find(|n| !taken(n))
        .unwrap_or_default()
}

/// `    let _e12 = ..;`, with or without a type.
fn baked(line: &str) -> Option<Let> {
    let rest = line.trim_start().strip_prefix("let _e")?;
    let digits = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    Some(Let {
        expression: rest[..digits].parse().ok()?,
    })
}

/// The lines each `_e12` is in, once for each time, its `let` first.
fn uses(body: &[&str]) -> HashMap<usize, Vec<usize>> {
    let mut uses: HashMap<usize, Vec<usize>> = HashMap::new();
    for (line, text) in body.iter().enumerate() {
        for (kind, range) in text::tokens(text) {
            if kind == Kind::Word
                && let Some(number) = text[range].strip_prefix("_e")
                && let Ok(number) = number.parse()
            {
                uses.entry(number).or_default().push(line);
            }
        }
    }
    uses
}

/// `a = (b + c);` without the parentheses, if they enclose the whole right-hand side of a `let`, an assignment or a return.
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
