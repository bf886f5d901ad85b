//! Executes directives.

use std::path::{Path, PathBuf};
use std::rc::Rc;

use naga::{ShaderStage, Span};

use super::condition::{Word, Wrong, evaluate, integer};
use super::macros::{Macro, TokenSource};
use super::tokens::{Joined, Token, TokenKind, tokens};
use super::{INCLUDES, Numbering, OPEN, Open, Preprocessor, Reading, Stop, unclosed};
use crate::version::Dialect;
use shader_text::error::{Code, Error};

impl Preprocessor<'_> {
    /// `#line LINE` and `#line LINE FILE`, both constant expressions. The next line gets the number
    /// LINE; before GLSL 3.30, the line after it does.
    fn line(&mut self, rest: Vec<Token>, place: (u32, u32)) -> Result<(), Stop> {
        let own = self.own_line(place.1.saturating_sub(1));
        let mut expanded = self.expanded(rest, 0)?;
        // GL_GOOGLE_cpp_style_line_directive names a file instead of numbering it.
        expanded.pop_if(|t| t.kind == TokenKind::Quoted);
        let words = self.words(&expanded, place)?;
        let both = (1..=words.len()).rev().find_map(|n| {
            let line = evaluate(&words[..n], true).ok()?;
            let file = match &words[n..] {
                [] => None,
                file => Some(evaluate(file, true).ok()?),
            };
            Some((line, file))
        });
        let numbers = both.filter(|(line, file)| {
            let fits = |n: &i64| u32::try_from(*n).is_ok();
            fits(line) && file.as_ref().is_none_or(fits)
        });
        let Some((line, file)) = numbers else {
            return Err(self.stop("`#line` takes the number of a line, and of a file", place));
        };
        let Dialect { version, es } = self.dialect;
        let next = line + i64::from(!es && version < 330);
        if let Some(reading) = self.open.last_mut() {
            reading.numbering.shift = next - (own + 1);
            reading.numbering.file = file.unwrap_or(reading.numbering.file);
        }
        Ok(())
    }

    pub(super) fn directive(&mut self, hash: &Token, line: Vec<Token>) -> Result<(), Stop> {
        let mut rest = line.into_iter();
        let Some(first) = rest.next() else {
            return Ok(());
        };
        let rest: Vec<Token> = rest.collect();
        let end = rest.last().unwrap_or(&first).end;
        let place = (hash.start, end.max(first.end));
        let active = self.is_active();
        let word = self.names.text(first.name);
        match &*word {
            "if" | "ifdef" | "ifndef" => {
                let holds = match (active, &*word) {
                    (false, _) => false,
                    (true, "if") => self.condition(rest, place)?,
                    (true, word) => {
                        let name = self.named(&rest, word, place)?;
                        self.is_defined(name) == (word == "ifdef")
                    }
                };
                self.conditions.push(Open {
                    active: active && holds,
                    taken: holds,
                    outside: active,
                    seen_else: false,
                    place: Span::new(place.0, place.1),
                });
            }
            "elif" | "else" | "endif" => {
                let Some(mut open) = self.conditions.pop() else {
                    return Err(self.stop(format!("this `#{word}` has no `#if`"), place));
                };
                if &*word == "endif" {
                    return Ok(());
                }
                if open.seen_else {
                    return Err(self.stop(format!("this `#{word}` follows `#else`"), place));
                }
                let holds = match &*word {
                    "else" => {
                        open.seen_else = true;
                        true
                    }
                    // After an active group the condition is not evaluated.
                    _ if !open.outside || open.taken => false,
                    _ => self.condition(rest, place)?,
                };
                open.active = open.outside && !open.taken && holds;
                open.taken |= open.active;
                self.conditions.push(open);
            }
            "pragma" if rest.first().is_some_and(|t| self.is(t, "stage")) => {
                let own = match self.stage {
                    ShaderStage::Vertex => "vertex",
                    _ => "fragment",
                };
                self.elsewhere = !rest.get(1).is_some_and(|t| self.is(t, own));
            }
            _ if !active => {}
            "define" | "undef" | "error" | "line" if self.elsewhere => {}
            "define" => self.define(&rest, place)?,
            "undef" => {
                let name = self.named(&rest, "undef", place)?;
                self.refuse_own(name, place)?;
                self.macros.remove(&name);
            }
            "error" => {
                let words: Vec<Rc<str>> = rest.iter().map(|t| self.names.text(t.name)).collect();
                return Err(self.stop(format!("#error {}", words.join(" ")), place));
            }
            "include" => self.include(rest, place)?,
            "version" => {
                let words: Vec<Rc<str>> = rest.iter().map(|t| self.names.text(t.name)).collect();
                if let Some(version) = words.first().and_then(|v| v.parse().ok()) {
                    self.dialect.version = version;
                }
                self.out.lexed_version = match self.lexed_version {
                    // The lexer has no Vulkan mode for ES.
                    460 if self.dialect.es => 460,
                    460 if (420..=460).contains(&self.dialect.version) => 460,
                    _ => self.dialect.version,
                };
            }
            "pragma" => {
                let words: Vec<Rc<str>> = rest.iter().map(|t| self.names.text(t.name)).collect();
                self.out.invariant_all |= words.concat().contains("STDGLinvariant(all)");
            }
            "extension" => {
                let words: Vec<Rc<str>> = rest.iter().map(|t| self.names.text(t.name)).collect();
                if let [name, .., behaviour] = &words[..]
                    && &**behaviour != "disable"
                {
                    self.out.extensions.insert(name.to_string());
                }
            }
            "line" => self.line(rest, place)?,
            _ => return Err(self.stop(format!("unknown directive `#{word}`"), place)),
        }
        Ok(())
    }

    fn named(&self, rest: &[Token], directive: &str, place: (u32, u32)) -> Result<u32, Stop> {
        let name = rest.first().filter(|t| t.kind == TokenKind::Word);
        name.map(|t| t.name)
            .ok_or_else(|| self.stop(format!("`#{directive}` names no macro"), place))
    }

    fn is_defined(&mut self, name: u32) -> bool {
        let is = self.macros.contains_key(&name) || self.computed.contains(&name);
        self.out.asks_for_vulkan |= !is && &*self.names.text(name) == "VULKAN";
        is
    }

    fn refuse_own(&self, name: u32, place: (u32, u32)) -> Result<(), Stop> {
        let text = self.names.text(name);
        let is_own = self.macros.get(&name).is_some_and(|m| m.is_own)
            || self.computed.contains(&name)
            || &*text == "defined";
        match is_own || text.starts_with("GL_") {
            true => Err(self.stop(format!("GLSL reserves the name `{text}`"), place)),
            false => Ok(()),
        }
    }

    fn define(&mut self, rest: &[Token], place: (u32, u32)) -> Result<(), Stop> {
        let name = self.named(rest, "define", place)?;
        self.refuse_own(name, place)?;
        let called = match (rest.first(), rest.get(1)) {
            (Some(name), Some(open)) => self.is(open, "(") && open.start == name.end,
            _ => false,
        };
        let mut at = 1;
        let mut parameters = None;
        if called {
            let mut names = Vec::new();
            at = 2;
            loop {
                let token = rest.get(at);
                at += 1;
                let text = token.map(|t| self.names.text(t.name));
                match (token, text.as_deref()) {
                    (_, Some(")")) => break,
                    (_, Some(",")) => {}
                    (Some(token), _) if token.kind == TokenKind::Word => names.push(token.name),
                    _ => {
                        let name = self.names.text(name);
                        return Err(self.stop(
                            format!("the parameters of the macro `{name}` are not closed"),
                            place,
                        ));
                    }
                }
            }
            parameters = Some(names);
        }
        let body = rest.get(at..).unwrap_or_default().to_vec();
        let made = Macro {
            parameters,
            body,
            is_own: false,
            is_authors: true,
        };
        let words = |of: &Macro| of.body.iter().map(|t| t.name).collect::<Vec<_>>();
        let is_same = |old: &Macro| old.parameters == made.parameters && words(old) == words(&made);
        let old = self.macros.get(&name).filter(|old| old.is_authors);
        if old.is_some_and(|old| !is_same(old)) {
            let message = format!("`{}` is defined twice, differently", self.names.text(name));
            return Err(self.stop(message, place));
        }
        self.macros.insert(name, Rc::new(made));
        Ok(())
    }

    /// The result of `defined`.
    fn answer(&mut self, asked: Token, name: u32) -> Token {
        let value = u8::from(self.is_defined(name)).to_string();
        Token {
            kind: TokenKind::Number,
            name: self.names.number(&value),
            ..asked
        }
    }

    fn condition(&mut self, line: Vec<Token>, place: (u32, u32)) -> Result<bool, Stop> {
        // The operand of `defined` is not expanded.
        let mut ready = Vec::new();
        let mut rest = line.into_iter().peekable();
        while let Some(token) = rest.next() {
            if !self.is(&token, "defined") {
                ready.push(token);
                continue;
            }
            let bracket = rest.next_if(|t| self.is(t, "(")).is_some();
            let name = rest.next_if(|t| t.kind == TokenKind::Word);
            let closed = !bracket || rest.next_if(|t| self.is(t, ")")).is_some();
            let Some(name) = name.filter(|_| closed) else {
                return Err(self.stop("`defined` names no macro", place));
            };
            ready.push(self.answer(token, name.name));
        }
        let mut input = TokenSource::list(ready);
        let mut expanded = Vec::new();
        while let Some(token) = self.next(&mut input)? {
            // Macros may produce `defined`. C leaves that undefined (C11 6.10.1), but compilers
            // accept it.
            if self.is(&token, "defined") {
                let mut name = self.next(&mut input)?;
                let bracket = name.as_ref().is_some_and(|t| self.is(t, "("));
                if bracket {
                    name = self.next(&mut input)?;
                }
                let closed = !bracket || self.next(&mut input)?.is_some_and(|t| self.is(&t, ")"));
                let Some(name) = name.filter(|t| closed && t.kind == TokenKind::Word) else {
                    return Err(self.stop("`defined` names no macro", place));
                };
                expanded.push(self.answer(token, name.name));
            } else if let Some(token) = self.expand(token, &mut input, 0)? {
                self.work(1)?;
                expanded.push(token);
            }
        }
        let words = self.words(&expanded, place)?;
        let strict = self.dialect.es;
        evaluate(&words, strict).map(|v| v != 0).map_err(|wrong| {
            let token = |at: usize| expanded.get(at);
            let text = |at: usize| {
                token(at)
                    .map(|t| self.names.text(t.name))
                    .unwrap_or_default()
            };
            let at = |at: usize| token(at).map_or(place, |t| (t.start, t.end));
            match wrong {
                Wrong::Undefined(i) => self
                    .stop(format!("`{}` is not defined", text(i)), at(i))
                    .note(
                        "in GLSL ES an undefined name is an error in `#if` (ES 3.00, section 3.4): \
                         test `defined(..)` first",
                    ),
                Wrong::Malformed(Some(i)) if i < words.len() => self.stop(
                    format!("`{}` cannot be here in a condition", text(i)),
                    at(i),
                ),
                Wrong::Malformed(_) => self.stop("this condition is incomplete", place),
                Wrong::DivisionByZero => self.stop("this condition divides by 0", place),
                Wrong::TooDeep => self.too_deep(place),
            }
        })
    }

    /// The words of an expanded expression.
    fn words(&self, expanded: &[Token], place: (u32, u32)) -> Result<Vec<Word>, Stop> {
        let word = |(i, token): (usize, &Token)| {
            let text = self.names.text(token.name);
            Ok(match token.kind {
                TokenKind::Number => Word::Number(integer(&text).ok_or_else(|| {
                    let message = format!("`{text}` is not an integer, which a directive needs");
                    self.stop(message, place)
                })?),
                TokenKind::Word => Word::Undefined(i),
                _ => Word::Operator(text.to_string()),
            })
        };
        expanded.iter().enumerate().map(word).collect()
    }

    fn include(&mut self, line: Vec<Token>, place: (u32, u32)) -> Result<(), Stop> {
        let is_name = |this: &Self, line: &[Token]| {
            line.first()
                .is_some_and(|t| t.kind == TokenKind::Quoted || this.is(t, "<"))
        };
        let line = match is_name(self, &line) {
            true => line,
            false => self.expanded(line, 0)?,
        };
        if !is_name(self, &line) {
            return Err(self
                .stop("`#include` names no file", place)
                .note("put the name in quotes or angle brackets, or use a macro for it"));
        }
        let texts: Vec<Rc<str>> = line.iter().map(|t| self.names.text(t.name)).collect();
        let angled = line.first().is_some_and(|t| t.kind != TokenKind::Quoted);
        let name = match (&texts[..], angled) {
            ([first, ..], false) => first.trim_matches('"').to_owned(),
            ([_, rest @ ..], _) => {
                // The tokens as written, with spaces.
                let closed = rest.iter().position(|t| &**t == ">" || t.ends_with('>'));
                let Some(closed) = closed else {
                    return Err(self.stop("the name of this `#include` is not closed", place));
                };
                rest[..closed].concat()
            }
            _ => String::new(),
        };
        self.included += 1;
        self.out.is_more = true;
        if self.included > INCLUDES {
            let message = format!("files are included more than {INCLUDES} times");
            return Err(Error::new(Code::TooDeep, message).label(Span::new(place.0, place.1), ""));
        }
        let (folder, found) = match self.open.last() {
            Some(reading) => {
                let found = reading.found.as_deref().and_then(Path::parent);
                (reading.folder.clone(), found.map(Path::to_owned))
            }
            None => (self.home.clone(), None),
        };
        let mut beside = vec![folder];
        if angled {
            beside.insert(0, self.home.clone());
        }
        beside.extend(found);
        let asked: Vec<PathBuf> = beside.iter().map(|f| f.join(&name)).collect();
        let told = |e: &std::io::Error| {
            self.stop(e.to_string(), place)
                .note("searched: beside the file, then the include folders; --include DIR adds one")
        };
        let mut first = None;
        let hit = asked.iter().find_map(|path| match self.files.find(path) {
            Ok(found) => Some((path.clone(), found)),
            Err(error) => {
                first.get_or_insert(error);
                None
            }
        });
        let Some((asked, found)) = hit else {
            let error = first.unwrap_or_else(|| std::io::Error::other("there is no such file"));
            return Err(told(&error));
        };
        let tokens = match self.known.get(&found) {
            Some((_, tokens)) => Rc::clone(tokens),
            None => {
                let text = self.files.text(&found).map_err(|e| told(&e))?;
                let tokens = self.read(&asked, &found, text)?;
                let name = asked.to_string_lossy().into_owned();
                self.known.insert(found.clone(), (name, Rc::clone(&tokens)));
                tokens
            }
        };
        if self.open.len() > OPEN {
            // Name the file that includes itself.
            let twice = |i: &usize| {
                let rest = self.open.get(i + 1..).unwrap_or_default();
                rest.iter().any(|r| r.found == self.open[*i].found)
            };
            let round = (1..self.open.len()).find(twice);
            let round = round.and_then(|i| self.known.get(self.open[i].found.as_ref()?));
            return Err(match round {
                Some((name, _)) => self
                    .stop(format!("{name} includes itself without end"), place)
                    .note(
                        "begin it with `#ifndef A_NAME` and `#define A_NAME`, and end it with \
                         `#endif`",
                    ),
                None => self.stop(format!("includes are nested more than {OPEN} deep"), place),
            });
        }
        self.open.push(Reading {
            tokens,
            at: 0,
            folder: asked.parent().unwrap_or(Path::new("")).to_owned(),
            found: Some(found),
            numbering: Numbering::default(),
        });
        Ok(())
    }

    /// Tokenises a file and adds it to the source map.
    fn read(&mut self, asked: &Path, found: &Path, text: String) -> Result<Rc<Vec<Token>>, Stop> {
        let own = crate::stage_of(&text, self.stage);
        let name = self.files.shown(asked, found);
        let base = self.map.add(name, text);
        let own = match own.strip_prefix('\u{feff}') {
            Some(rest) => format!("   {rest}"),
            None => own,
        };
        let tokens = tokens(&Joined::of(&own), base, &mut self.names)
            .map_err(|at| unclosed(Span::new(at, at + 2)))?;
        Ok(Rc::new(tokens))
    }
}
