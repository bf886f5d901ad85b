//! Distinguishes a struct's name from a variable, member or inner struct with the same name.
//!
//! glsl-lang's lexer makes every name of a struct a type name, wherever it occurs. In GLSL names
//! have scopes (4.60, 4.2.2): a variable hides a struct of its name from the end of its declarator
//! to the end of its scope, a parameter does in the function's body, and a member hides nothing.

use std::collections::{HashMap, HashSet};

use glsl_lang::lexer::Token;

/// The meaning of a name in a scope.
#[derive(Debug)]
enum Meaning {
    Variable,
    /// A struct, by its name in the tree.
    Struct(String),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scope {
    /// The braces of a struct or a block.
    Members,
    /// Any other braces, and the whole text.
    Others,
    /// A `for` or `while`, from its head to its end. `at`: number of enclosing parentheses and
    /// brackets.
    Loop { at: usize, in_head: bool },
}

/// The token before a brace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Before {
    Assigns,
    Name,
    Other,
}

/// Follows the tokens of a stage.
#[derive(Debug)]
pub(super) struct TypeNames<'a> {
    /// The text that the tokens refer to.
    text: &'a str,
    scopes: Vec<(Scope, HashMap<String, Meaning>)>,
    /// For each open parenthesis or bracket, whether it is a bracket after a type.
    open: Vec<bool>,
    before: Before,
    /// Whether the previous token ends a type, so that a name declares something.
    follows_type: bool,
    follows_struct: bool,
    follows_dot: bool,
    /// Whether the next braces belong to a named struct.
    opens_struct: bool,
    /// Position of the current list of declarators: number of enclosing parentheses and scopes.
    list: Option<(usize, usize)>,
    /// The current declarator. Empty for a member.
    declarator: Option<String>,
    /// Parameters of the function whose head is being read.
    parameters: Vec<String>,
    structs: HashSet<String>,
}

impl<'a> TypeNames<'a> {
    pub(super) fn new(text: &'a str) -> Self {
        Self {
            text,
            scopes: vec![(Scope::Others, HashMap::new())],
            open: Vec::new(),
            before: Before::Other,
            follows_type: false,
            follows_struct: false,
            follows_dot: false,
            opens_struct: false,
            list: None,
            declarator: None,
            parameters: Vec::new(),
            structs: HashSet::new(),
        }
    }

    /// Turns the next token into a name or a type name, if it is either. `word`: its text.
    pub(super) fn settle(&mut self, token: &mut Token, word: &str) {
        let dot = std::mem::replace(&mut self.follows_dot, matches!(token, Token::Dot));
        let of_struct = std::mem::replace(&mut self.follows_struct, matches!(token, Token::Struct));
        let of_type = std::mem::take(&mut self.follows_type);
        let before = std::mem::replace(&mut self.before, Before::Other);
        let (Token::Identifier(name) | Token::TypeName(name)) = &*token else {
            return match token {
                Token::LeftBrace => self.open_braces(before, of_struct),
                _ => self.follow(token, word, of_type),
            };
        };
        let name = name.to_string();
        self.before = Before::Name;
        if dot {
            *token = Token::Identifier(name.into());
        } else if of_struct {
            self.opens_struct = true;
            *token = Token::Identifier(self.new_struct(name).into());
        } else if of_type || self.list == Some(self.depth()) && self.declarator.is_none() {
            *token = Token::Identifier(name.as_str().into());
            self.begin_declarator(name);
        } else {
            match self.scopes.iter().rev().find_map(|(_, s)| s.get(&name)) {
                Some(Meaning::Variable) => *token = Token::Identifier(name.into()),
                Some(Meaning::Struct(own)) => *token = Token::TypeName(own.as_str().into()),
                None => {}
            }
            self.follows_type = matches!(token, Token::TypeName(_));
        }
    }

    fn depth(&self) -> (usize, usize) {
        (self.open.len(), self.scopes.len())
    }

    fn is_global(&self) -> bool {
        self.scopes.len() == 1
    }

    fn bind(&mut self, name: String, meaning: Meaning) {
        if let Some((_, scope)) = self.scopes.last_mut() {
            scope.insert(name, meaning);
        }
    }

    /// Declares a struct. In the tree, a struct in a function gets a unique name.
    fn new_struct(&mut self, name: String) -> String {
        let mut own = name.clone();
        if !self.is_global() {
            let is_free = |n: &String| !self.structs.contains(n) && !self.text.contains(n.as_str());
            let mut numbered = (1..).map(|n| format!("{name}_inner{n}"));
            own = numbered.find(is_free).unwrap_or(own);
        }
        self.structs.insert(own.clone());
        self.bind(name, Meaning::Struct(own.clone()));
        own
    }

    fn begin_declarator(&mut self, name: String) {
        if self.is_global() && !self.open.is_empty() {
            self.parameters.push(name);
            return;
        }
        let is_member = matches!(self.scopes.last(), Some((Scope::Members, _)));
        self.list = Some(self.depth());
        self.declarator = Some(if is_member { String::new() } else { name });
    }

    /// Brings the current variable into scope.
    fn end_declarator(&mut self) {
        if let Some(name) = self.declarator.take().filter(|n| !n.is_empty()) {
            self.bind(name, Meaning::Variable);
        }
    }

    fn open_braces(&mut self, before: Before, of_struct: bool) {
        // A block's members follow its name.
        let of_block = self.is_global() && before == Before::Name;
        if std::mem::take(&mut self.opens_struct) || of_struct || of_block {
            self.scopes.push((Scope::Members, HashMap::new()));
            return;
        }
        if self.is_global() && before == Before::Other {
            // A function's name is not a declarator.
            self.declarator = None;
            self.list = None;
        }
        if let Some((scope @ Scope::Loop { in_head: false, .. }, _)) = self.scopes.last_mut() {
            // The body of a loop is part of its scope.
            *scope = Scope::Others;
            return;
        }
        let parameters = std::mem::take(&mut self.parameters).into_iter();
        let own = parameters.map(|p| (p, Meaning::Variable)).collect();
        self.scopes.push((Scope::Others, own));
    }

    /// Processes any other token.
    fn follow(&mut self, token: &Token, word: &str, of_type: bool) {
        match token {
            Token::LeftParen => self.open.push(false),
            Token::LeftBracket => self.open.push(of_type),
            Token::RightParen | Token::RightBracket => {
                self.follows_type = self.open.pop() == Some(true);
                if self.list.is_some_and(|(open, _)| open > self.open.len()) {
                    // `while (bool a = ..)`
                    self.end_declarator();
                    self.list = None;
                }
                if let Some((Scope::Loop { at, in_head }, _)) = self.scopes.last_mut() {
                    *in_head &= self.open.len() > *at;
                }
            }
            Token::RightBrace => {
                let closed = (self.scopes.len() > 1).then(|| self.scopes.pop()).flatten();
                // `struct { .. } name`
                self.follows_type = matches!(closed, Some((Scope::Members, _)));
            }
            Token::For | Token::While => {
                let at = self.open.len();
                let scope = Scope::Loop { at, in_head: true };
                self.scopes.push((scope, HashMap::new()));
            }
            Token::Comma if self.list == Some(self.depth()) => self.end_declarator(),
            Token::Semicolon => self.end_statement(),
            Token::Equal => self.before = Before::Assigns,
            _ => self.follows_type = is_type(word),
        }
    }

    fn end_statement(&mut self) {
        if self.list == Some(self.depth()) {
            self.end_declarator();
            self.list = None;
        }
        if self.is_global() {
            self.parameters.clear();
        }
        // The body of a loop without braces.
        while let Some((Scope::Loop { at, in_head: false }, _)) = self.scopes.last()
            && *at == self.open.len()
        {
            self.scopes.pop();
        }
    }
}

/// Whether a keyword is a type.
fn is_type(word: &str) -> bool {
    const PARTS: [&str; 6] = ["vec", "mat", "sampler", "image", "texture", "subpassInput"];
    let bare = word.strip_prefix(['b', 'd', 'i', 'u']);
    let is = |word: &str| PARTS.iter().any(|p| word.starts_with(p));
    is(word)
        || bare.is_some_and(is)
        || [
            "void",
            "bool",
            "int",
            "uint",
            "float",
            "double",
            "atomic_uint",
        ]
        .contains(&word)
}
