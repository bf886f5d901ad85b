//! Random materials full of what a draw decides: integers, flags, loops to counts, functions that
//! branch on uniforms. As in [`super::random`] each byte is a choice.

use std::fmt::Write;

use super::random::Choices;

/// The uniform `u` at group 0, binding 0: its scalars in the order of their offsets, four bytes
/// each.
pub const FIELDS: [(&str, Kind); 7] = [
    ("u.a", Kind::Integer),
    ("u.b", Kind::Integer),
    ("u.d", Kind::Integer),
    ("u.e", Kind::Integer),
    ("u.w", Kind::Float),
    ("u.z", Kind::Float),
    ("u.y", Kind::Float),
];

/// The type of a scalar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Integer,
    Float,
}

const HEAD: &str = "
struct U { a: i32, b: i32, d: i32, e: i32, w: f32, z: f32, y: f32 }
@group(0) @binding(0) var<uniform> u: U;
struct Varyings { @builtin(position) position: vec4<f32>, @location(0) p: vec4<f32>, \
    @location(1) q: vec2<f32>,
    @location(2) @interpolate(flat) k: i32, @location(3) r: f32 }
@vertex fn vs(@location(0) p: vec4<f32>, @location(1) q: vec2<f32>, @location(2) k: i32, \
    @location(3) r: f32) -> Varyings {
    var kept = u.d;
    if u.b > 1 { kept = k; }
    return Varyings(p * 2.0, p, q * 0.5, kept, u.w);
}
struct In { @location(0) p: vec4<f32>, @location(1) q: vec2<f32>, @location(2) \
    @interpolate(flat) k: i32, @location(3) r: f32 }
struct S { a: i32, v: vec2<i32>, f: f32 }
var<private> g: i32 = 2;
fn color(x: i32, y: i32, f: f32) -> vec4<f32> { return vec4(f32(x), f32(y), f, 1.0); }
fn bump(q: ptr<function, i32>, x: i32) { if u.e == 1 { *q += x; } else { *q -= 1; } }
";

/// A whole material.
pub fn material(bytes: &[u8]) -> String {
    let quarter = bytes.len() / 4;
    let (first, rest) = bytes.split_at(quarter);
    let (second, rest) = rest.split_at(quarter);
    let mut out = HEAD.to_owned();
    for (i, bytes) in [first, second].into_iter().enumerate() {
        let mut generator = Generator::new(bytes, i, &["q", "x"], Leaves::Integer);
        generator.block();
        generator.block();
        let _ = writeln!(
            out,
            "fn f{i}(x: i32) -> i32 {{
var q = x; var arr = array<i32, 4>(1, 2, 3, 4); var vv = vec2<i32>(3, 1); var s: S; var f = 0.5;
let k = x; let r = 0.25; let px = f32(x);
{}return q + arr[1] + vv.x + s.a; }}",
            generator.text
        );
    }
    let mut generator = Generator::new(rest, 2, &["a", "b"], Leaves::Color);
    for _ in 0..4 {
        generator.block();
    }
    let _ = writeln!(
        out,
        "@fragment fn fs(in: In, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {{
var a = i32(in.p.x * 4.0); var b = u.a; var arr = array<i32, 4>(4, 3, 2, 1); \
    var vv = vec2<i32>(2); var s = S(1, vec2(2, 3), 0.5); var f = 0.25;
let k = in.k; let r = in.r; let px = in.p.x;
{}return color(a + b * 7 + arr[0] + arr[1] * 3 + arr[2] * 5 + arr[3] * 9 + vv.x + vv.y + s.a + \
    s.v.y, g, f + s.f); }}",
        generator.text
    );
    out
}

/// What a `return` gives.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Leaves {
    Integer,
    Color,
}

/// What stands around a statement that a `break` or a `continue` may leave.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Around {
    Nothing,
    Switch,
    Loop,
    SwitchInLoop,
}

struct Generator<'a> {
    choices: Choices<'a>,
    /// Which function: it calls those of less.
    number: usize,
    /// Integers that may be written.
    variables: Vec<String>,
    /// Loop counters in scope.
    counters: Vec<String>,
    leaves: Leaves,
    around: Around,
    depth: usize,
    named: usize,
    text: String,
}

impl<'a> Generator<'a> {
    fn new(bytes: &'a [u8], number: usize, variables: &[&str], leaves: Leaves) -> Self {
        let variables = variables.iter().filter(|v| **v != "x");
        Self {
            choices: Choices::new(bytes),
            number,
            variables: variables.map(|v| (*v).to_owned()).collect(),
            counters: Vec::new(),
            leaves,
            around: Around::Nothing,
            depth: 0,
            named: 0,
            text: String::new(),
        }
    }

    fn pick<'b>(&mut self, from: &[&'b str]) -> &'b str {
        from[self.choices.below(from.len())]
    }

    fn variable(&mut self) -> String {
        self.variables[self.choices.below(self.variables.len())].clone()
    }

    fn integer(&mut self, depth: usize) -> String {
        let kinds = if depth == 0 { 5 } else { 15 };
        match self.choices.below(kinds) {
            0 => self.variable(),
            1 => self.pick(&["u.a", "u.b", "u.d", "u.e"]).to_owned(),
            2 => self.pick(&["0", "1", "2", "3", "7", "(-1)"]).to_owned(),
            3 => match self.counters.last() {
                Some(counter) => counter.clone(),
                None => "k".to_owned(),
            },
            4 => self
                .pick(&["k", "s.a", "vv.x", "arr[2]", "s.v.y", "g"])
                .to_owned(),
            5 | 6 => {
                let op = self.pick(&["+", "-", "*", "&", "|", "^"]);
                format!(
                    "({} {op} {})",
                    self.integer(depth - 1),
                    self.integer(depth - 1)
                )
            }
            7 => format!("arr[({}) & 3]", self.integer(depth - 1)),
            8 => format!("vv[u32({}) & 1u]", self.integer(depth - 1)),
            9 => format!(
                "select({}, {}, {})",
                self.integer(depth - 1),
                self.integer(depth - 1),
                self.condition(depth - 1)
            ),
            10 => {
                let fun = self.pick(&["min", "max"]);
                format!(
                    "{fun}({}, {})",
                    self.integer(depth - 1),
                    self.integer(depth - 1)
                )
            }
            11 => format!(
                "(({}) << (u32({}) & 7u))",
                self.integer(depth - 1),
                self.integer(depth - 1)
            ),
            12 => {
                let by = self.pick(&["3", "5", "(u.b | 1)"]);
                let op = self.pick(&["%", "/"]);
                format!("(({}) {op} {by})", self.integer(depth - 1))
            }
            13 => format!("i32(clamp({}, -9.0, 9.0))", self.float(depth - 1)),
            _ if self.number > 0 => {
                let callee = self.choices.below(self.number.min(2));
                format!("f{callee}({})", self.integer(depth - 1))
            }
            _ => format!("arr[{}]", self.pick(&["u.a", "u.e", "k"])),
        }
    }

    fn float(&mut self, depth: usize) -> String {
        let kinds = if depth == 0 { 4 } else { 9 };
        match self.choices.below(kinds) {
            0 => self.pick(&["u.w", "u.z", "u.y"]).to_owned(),
            1 => self.pick(&["px", "f", "s.f", "r"]).to_owned(),
            2 => self.pick(&["0.0", "0.5", "1.0", "-2.25"]).to_owned(),
            3 => format!("f32({})", self.variable()),
            4 | 5 => {
                let op = self.pick(&["+", "-", "*", "*", "/"]);
                format!("({} {op} {})", self.float(depth - 1), self.float(depth - 1))
            }
            6 => format!(
                "mix({}, {}, {})",
                self.float(depth - 1),
                self.float(depth - 1),
                self.float(depth - 1)
            ),
            7 => {
                let fun = self.pick(&["abs", "floor", "saturate", "sign", "sin"]);
                format!("{fun}({})", self.float(depth - 1))
            }
            _ => format!(
                "select({}, {}, {})",
                self.float(depth - 1),
                self.float(depth - 1),
                self.condition(depth - 1)
            ),
        }
    }

    fn condition(&mut self, depth: usize) -> String {
        let comparison = |this: &mut Self| this.pick(&["==", "!=", "<", ">=", ">"]).to_owned();
        let kinds = if depth == 0 { 3 } else { 7 };
        match self.choices.below(kinds) {
            0 => {
                let field = self.pick(&["u.a", "u.b", "u.d", "u.e"]);
                format!(
                    "{field} {} {}",
                    comparison(self),
                    self.pick(&["0", "1", "2", "-1"])
                )
            }
            1 => {
                let field = self.pick(&["u.w", "u.z", "u.y"]);
                format!(
                    "{field} {} {}",
                    comparison(self),
                    self.pick(&["0.0", "0.5", "1.0"])
                )
            }
            2 => format!(
                "{} {} {}",
                self.variable(),
                comparison(self),
                self.pick(&["u.a", "2", "k"])
            ),
            3 => {
                let op = self.pick(&["&&", "||"]);
                format!(
                    "({}) {op} ({})",
                    self.condition(depth - 1),
                    self.condition(depth - 1)
                )
            }
            4 => format!("!({})", self.condition(depth - 1)),
            5 => format!(
                "{} {} {}",
                self.integer(1),
                comparison(self),
                self.integer(1)
            ),
            _ => format!("{} {} {}", self.float(1), comparison(self), self.float(1)),
        }
    }

    fn line(&mut self, text: &str) {
        self.text.push_str(text);
        self.text.push('\n');
    }

    fn block(&mut self) {
        let (variables, counters) = (self.variables.len(), self.counters.len());
        self.depth += 1;
        for _ in 0..1 + self.choices.below(3) {
            self.statement();
        }
        self.depth -= 1;
        if self.depth > 0 {
            self.variables.truncate(variables);
        }
        self.counters.truncate(counters);
    }

    fn within(&mut self, around: Around) {
        let outer = std::mem::replace(&mut self.around, around);
        self.block();
        self.around = outer;
    }

    fn statement(&mut self) {
        let kinds = if self.depth < 4 { 20 } else { 11 };
        match self.choices.below(kinds) {
            0 | 1 => {
                let (to, op) = (self.variable(), self.pick(&["=", "+=", "-=", "*="]));
                let value = self.integer(2);
                self.line(&format!("{to} {op} {value};"));
            }
            2 => {
                let (at, value) = (self.integer(1), self.integer(2));
                self.line(&format!("arr[({at}) & 3] = {value};"));
            }
            3 => {
                let (at, value) = (self.integer(1), self.integer(1));
                let line = match self.choices.below(3) {
                    0 => format!("vv[u32({at}) & 1u] = {value};"),
                    1 => format!("vv = vec2({at}, {value});"),
                    _ => format!("vv = vv.yx + vec2({value});"),
                };
                self.line(&line);
            }
            4 => {
                let value = self.integer(1);
                self.line(&format!("g += {value};"));
            }
            5 => {
                let (to, value) = (self.variable(), self.integer(1));
                let to = match self.choices.below(3) {
                    0 => "s.a".to_owned(),
                    1 => "arr[1]".to_owned(),
                    _ => to,
                };
                self.line(&format!("bump(&{to}, {value});"));
            }
            6 => {
                let value = self.float(2);
                let to = self.pick(&["f", "s.f"]);
                self.line(&format!("{to} = {value};"));
            }
            7 => {
                let value = self.integer(1);
                let to = self.pick(&["s.a", "s.v.x", "s.v.y"]);
                self.line(&format!("{to} = {value};"));
            }
            8 => {
                let name = format!("x{}", self.named);
                self.named += 1;
                let value = match self.choices.below(3) {
                    0 => String::new(),
                    _ => format!(" = {}", self.integer(2)),
                };
                self.line(&format!("var {name}: i32{value};"));
                self.variables.push(name);
            }
            9 => self.leave(),
            10 => {
                let (at, value) = (self.pick(&["u.a", "u.e", "k"]), self.integer(1));
                self.line(&format!("arr[{at}] = {value};"));
            }
            11..=14 => {
                let condition = self.condition(2);
                self.line(&format!("if {condition} {{"));
                self.within(self.around);
                if self.choices.below(2) == 1 {
                    self.line("} else {");
                    self.within(self.around);
                }
                self.line("}");
            }
            15 | 16 => self.switch(),
            _ => self.repeat(),
        }
    }

    /// A jump behind a condition.
    fn leave(&mut self) {
        let condition = self.condition(1);
        let jump = match (self.around, self.choices.below(4)) {
            (Around::Switch | Around::Loop | Around::SwitchInLoop, 0) => "break;".to_owned(),
            (Around::Loop | Around::SwitchInLoop, 1) => "continue;".to_owned(),
            (_, 2) if self.leaves == Leaves::Color => "discard;".to_owned(),
            _ => {
                let value = self.integer(1);
                match self.leaves {
                    Leaves::Integer => format!("return {value};"),
                    Leaves::Color => format!("return color({value}, g, f);"),
                }
            }
        };
        self.line(&format!("if {condition} {{ {jump} }}"));
    }

    fn switch(&mut self) {
        let around = match self.around {
            Around::Nothing | Around::Switch => Around::Switch,
            Around::Loop | Around::SwitchInLoop => Around::SwitchInLoop,
        };
        let selector = self.integer(1);
        self.line(&format!("switch {selector} {{"));
        let first = self.choices.below(3) as i32 - 1;
        self.line(&format!("case {first}: {{"));
        self.within(around);
        let more = self.pick(&["", ", 7"]);
        self.line(&format!("}}\ncase {}{more}: {{", first + 1));
        self.within(around);
        self.line("}\ndefault: {");
        self.within(around);
        self.line("}\n}");
    }

    fn repeat(&mut self) {
        let k = format!("k{}", self.named);
        self.named += 1;
        let most = match self.choices.below(7) {
            0 => "u.a & 3",
            1 => "u.b & 3",
            2 => "3",
            3 => "k & 3",
            4 => "u.d & 7",
            5 => "u.e",
            _ => "2",
        };
        self.counters.push(k.clone());
        match self.choices.below(4) {
            0 | 1 => {
                self.line(&format!("for (var {k} = 0; {k} < ({most}); {k}++) {{"));
                self.within(Around::Loop);
                self.line("}");
            }
            2 => {
                self.line(&format!("var {k} = 0; loop {{"));
                self.within(Around::Loop);
                let value = self.variable();
                self.line(&format!(
                    "continuing {{ {k} += 1; {value} += 1; break if {k} > ({most}); }}\n}}"
                ));
            }
            _ => {
                // What is left of it once its break is never taken may only return.
                self.line(&format!(
                    "var {k} = 0; loop {{\nif {k} >= ({most}) {{ break; }} {k} += 1;"
                ));
                self.within(Around::Loop);
                self.line("}");
            }
        }
        self.counters.retain(|c| *c != k);
    }
}
