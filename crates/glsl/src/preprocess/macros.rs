//! Expands macros as in C (C11 6.10.3; GLSL 4.60, 3.3). Arguments are expanded before substitution,
//! and the result is scanned again together with the following text. No macro expands within itself
//! (D. Prosser's hide sets).

use std::rc::Rc;

use super::tokens::{Token, TokenKind};
use super::{Preprocessor, Stop};

#[derive(Clone, Debug)]
pub(super) struct Macro {
    /// `None` for an object-like macro.
    pub parameters: Option<Vec<u32>>,
    pub body: Vec<Token>,
    /// Whether it is predefined, such as `GL_ES`.
    pub is_own: bool,
    /// Whether the text defines it.
    pub is_authors: bool,
}

pub(super) enum TokenSource {
    Files,
    /// A list, in reverse order.
    List(Vec<Token>),
}

impl TokenSource {
    pub(super) fn list(mut tokens: Vec<Token>) -> Self {
        tokens.reverse();
        Self::List(tokens)
    }
}

/// Maximum nesting of calls in arguments.
const DEPTH: usize = 100;

/// Maximum size of a hide set.
const HIDDEN: usize = 256;
/// Hide-set comparisons that cost as much as one token.
const SHARE: usize = 64;

impl Preprocessor<'_> {
    /// Adds `name` to a hide set. Sets are copied, so their size is limited.
    fn with(
        &self,
        hidden: Option<&Rc<[u32]>>,
        name: u32,
        place: (u32, u32),
    ) -> Result<Rc<[u32]>, Stop> {
        let mut all: Vec<u32> = hidden.map(|h| h.to_vec()).unwrap_or_default();
        if !all.contains(&name) {
            all.push(name);
        }
        match all.len() > HIDDEN {
            true => Err(self.too_deep(place)),
            false => Ok(Rc::from(all)),
        }
    }

    pub(super) fn next(&mut self, input: &mut TokenSource) -> Result<Option<Token>, Stop> {
        match input {
            TokenSource::Files => self.next_token(),
            TokenSource::List(tokens) => Ok(tokens.pop()),
        }
    }

    fn unread(&mut self, input: &mut TokenSource, tokens: Vec<Token>) -> Result<(), Stop> {
        self.work(tokens.len())?;
        let back = tokens.into_iter().rev();
        match input {
            TokenSource::Files => self.pending.extend(back),
            TokenSource::List(tokens) => tokens.extend(back),
        }
        Ok(())
    }

    /// Expands a whole list.
    pub(super) fn expanded(
        &mut self,
        tokens: Vec<Token>,
        depth: usize,
    ) -> Result<Vec<Token>, Stop> {
        let mut input = TokenSource::list(tokens);
        let mut out = Vec::new();
        while let Some(token) = self.next(&mut input)? {
            if let Some(token) = self.expand(token, &mut input, depth)? {
                self.work(1)?;
                out.push(token);
            }
        }
        Ok(out)
    }

    /// Returns the token, or `None` after replacing a macro call by its expansion in `input`.
    pub(super) fn expand(
        &mut self,
        mut token: Token,
        input: &mut TokenSource,
        depth: usize,
    ) -> Result<Option<Token>, Stop> {
        if token.kind != TokenKind::Word || token.is_hidden_from(token.name) {
            return Ok(Some(token));
        }
        if let Some(text) = self.own_value(&token) {
            token.kind = TokenKind::Number;
            token.name = self.names.number(&text);
            return Ok(Some(token));
        }
        let Some(found) = self.macros.get(&token.name).cloned() else {
            return Ok(Some(token));
        };
        self.out.is_more = true;
        let Some(parameters) = &found.parameters else {
            let place = (token.start, token.end);
            let hidden = self.with(token.hidden.as_ref(), token.name, place)?;
            let body = self.substituted(&found, &[], &[], place, &hidden, depth)?;
            self.unread(input, body)?;
            return Ok(None);
        };
        let open = self.next(input)?;
        match open {
            Some(open) if self.is(&open, "(") => {}
            other => {
                if let Some(other) = other {
                    self.unread(input, vec![other])?;
                }
                return Ok(Some(token));
            }
        }
        let (mut arguments, mut nested) = (vec![Vec::new()], 0usize);
        let close = loop {
            let Some(next) = self.next(input)? else {
                let name = self.names.text(token.name);
                return Err(self.stop(
                    format!("the call of the macro `{name}` is not closed"),
                    (token.start, token.end),
                ));
            };
            self.work(1)?;
            let text = self.names.text(next.name);
            match (&*text, nested) {
                (")", 0) => break next,
                (",", 0) => {
                    arguments.push(Vec::new());
                    continue;
                }
                ("(", _) => nested += 1,
                (")", _) => nested -= 1,
                _ => {}
            }
            if let Some(last) = arguments.last_mut() {
                last.push(next);
            }
        };
        if parameters.is_empty() && arguments.iter().all(Vec::is_empty) && arguments.len() == 1 {
            arguments.clear();
        }
        let place = (token.start, token.end.max(self.end_of_call(&token, &close)));
        if arguments.len() != parameters.len() {
            let name = self.names.text(token.name);
            let wanted = parameters.len();
            let ending = if wanted == 1 { "" } else { "s" };
            return Err(self.stop(
                format!(
                    "the macro `{name}` takes {wanted} argument{ending}, but {} are given",
                    arguments.len()
                ),
                place,
            ));
        }
        let both = |name: &u32| close.is_hidden_from(*name);
        let shared: Vec<u32> = token
            .hidden
            .iter()
            .flat_map(|h| h.iter().copied())
            .collect();
        self.work(shared.len() * close.hidden.as_ref().map_or(0, |h| h.len()) / SHARE)?;
        let shared: Rc<[u32]> = shared.into_iter().filter(both).collect();
        let hidden = self.with(Some(&shared), token.name, place)?;
        let body = self.substituted(&found, parameters, &arguments, place, &hidden, depth)?;
        self.unread(input, body)?;
        Ok(None)
    }

    /// The end of a call if it is in one file, else the end of its name.
    fn end_of_call(&self, name: &Token, close: &Token) -> u32 {
        let in_one_file = self.file_at(name.start) == self.file_at(close.start);
        match in_one_file && close.end > name.start && close.end - name.start < 1 << 16 {
            true => close.end,
            false => name.end,
        }
    }

    /// Substitutes arguments in the macro's body and pastes tokens.
    fn substituted(
        &mut self,
        of: &Macro,
        parameters: &[u32],
        arguments: &[Vec<Token>],
        place: (u32, u32),
        hidden: &Rc<[u32]>,
        depth: usize,
    ) -> Result<Vec<Token>, Stop> {
        if depth > DEPTH {
            return Err(self.too_deep(place));
        }
        let paste = self.names.number("##");
        let is_paste = |i: Option<usize>| {
            let token = i.and_then(|i| of.body.get(i));
            token.is_some_and(|t| t.kind == TokenKind::Other && t.name == paste)
        };
        let mut full: Vec<Option<Vec<Token>>> = vec![None; arguments.len()];
        let mut out: Vec<Token> = Vec::with_capacity(of.body.len());
        // Whether the next token is pasted, and whether there is a token to paste it to.
        let mut pasting = false;
        let mut left_is_empty = true;
        for (i, token) in of.body.iter().enumerate() {
            if is_paste(Some(i)) {
                pasting = true;
                continue;
            }
            let number = match token.kind {
                TokenKind::Word => parameters.iter().position(|p| *p == token.name),
                _ => None,
            };
            let piece = match number.and_then(|n| arguments.get(n).map(|a| (n, a))) {
                None => vec![Token {
                    start: place.0,
                    end: place.1,
                    begins_line: false,
                    ..token.clone()
                }],
                Some((_, argument)) if pasting || is_paste(Some(i + 1)) => argument.clone(),
                Some((n, argument)) => match full.get(n).cloned().flatten() {
                    Some(done) => done,
                    None => {
                        let done = self.expanded(argument.clone(), depth + 1)?;
                        if let Some(slot) = full.get_mut(n) {
                            *slot = Some(done.clone());
                        }
                        done
                    }
                },
            };
            self.work(piece.len())?;
            let was_pasting = std::mem::take(&mut pasting);
            let is_empty = piece.is_empty();
            let mut piece = piece.into_iter();
            if was_pasting
                && !left_is_empty
                && let Some(right) = piece.next()
                && let Some(left) = out.pop()
            {
                out.push(self.pasted(&left, &right, place)?);
            }
            out.extend(piece);
            left_is_empty = is_empty && (!was_pasting || left_is_empty);
        }
        for token in &mut out {
            let mut all = match &token.hidden {
                None => {
                    token.hidden = Some(Rc::clone(hidden));
                    continue;
                }
                Some(own) => own.to_vec(),
            };
            if all.len() > HIDDEN {
                return Err(self.too_deep(place));
            }
            self.work(all.len() * hidden.len() / SHARE)?;
            all.extend(hidden.iter().filter(|h| !token.is_hidden_from(**h)));
            token.hidden = Some(Rc::from(all));
        }
        Ok(out)
    }

    fn pasted(&mut self, left: &Token, right: &Token, place: (u32, u32)) -> Result<Token, Stop> {
        let text = format!(
            "{}{}",
            self.names.text(left.name),
            self.names.text(right.name)
        );
        let joined = super::tokens::Joined::of(&text);
        let made = super::tokens::tokens(&joined, 0, &mut self.names).unwrap_or_default();
        match &made[..] {
            [one, line] if line.kind == TokenKind::Line => Ok(Token {
                kind: one.kind,
                name: one.name,
                start: place.0,
                end: place.1,
                begins_line: false,
                hidden: left.hidden.clone(),
            }),
            _ => Err(self.stop(format!("`##` makes `{text}`, which is not a token"), place)),
        }
    }
}
