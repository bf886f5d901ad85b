//! Random structured fragment shaders as WGSL, from a string of bytes: each byte is a choice, and
//! where they run out the simplest is made, so that shrinking the bytes shrinks the program.

use std::fmt::Write;

/// Choices left to make.
pub struct Choices<'a> {
    bytes: std::slice::Iter<'a, u8>,
}

impl<'a> Choices<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self {
            bytes: bytes.iter(),
        }
    }

    /// A number below `n`; 0 when no choices are left.
    pub fn below(&mut self, n: usize) -> usize {
        self.bytes.next().map_or(0, |b| *b as usize % n)
    }
}

/// What a function body may use.
struct Scope {
    floats: Vec<&'static str>,
    integers: Vec<&'static str>,
    /// Readable only.
    float_inputs: Vec<&'static str>,
    integer_inputs: Vec<&'static str>,
    structs: Vec<&'static str>,
    arrays: Vec<&'static str>,
    vectors: Vec<&'static str>,
    /// A variable of four components; empty: none.
    color: &'static str,
    /// `return` statements, with `F` and `I` standing for expressions.
    result: &'static str,
    calls: Calls,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Calls {
    None,
    H0,
    Both,
}

struct Generator<'c, 'a> {
    choices: &'c mut Choices<'a>,
    scope: Scope,
    text: String,
    counters: usize,
    depth: usize,
    /// Whether `continue`, and `break`, are allowed here.
    in_loop: bool,
    in_breakable: bool,
}

/// A whole shader: private globals, two helpers that take pointers, and a fragment entry point with
/// four outputs.
pub fn shader(bytes: &[u8]) -> String {
    // The entry point gets half of the choices.
    let (helpers, entry) = bytes.split_at(bytes.len() / 2);
    let (first, second) = helpers.split_at(helpers.len() / 2);
    let mut text = String::from(
        "struct S { a: f32, b: vec2<f32>, n: i32 }
struct In { @location(0) p: vec4<f32>, @location(1) q: vec2<f32>, @location(2) \
    @interpolate(flat) k: i32, @location(3) r: f32 }
struct Out { @location(0) c: vec4<f32>, @location(1) e: f32, @location(2) n: i32, \
    @builtin(frag_depth) d: f32 }
var<private> g0: f32 = 0.25;
var<private> gs: S;
var<private> gi: i32;
",
    );
    function(
        &mut Choices::new(first),
        &mut text,
        "fn h0(p: ptr<function, f32>, x: f32, m: i32) -> S",
        "var f0: f32; var s: S; var arr: array<f32, 4>; var v: vec3<f32>; var i0: i32;",
        Scope {
            floats: vec!["*p", "f0", "s.a", "s.b.x", "s.b.y", "g0", "gs.a"],
            integers: vec!["i0", "s.n", "gi"],
            float_inputs: vec!["x"],
            integer_inputs: vec!["m"],
            structs: vec!["s", "gs"],
            arrays: vec!["arr"],
            vectors: vec!["v"],
            color: "",
            result: "S(F, vec2(F, F), I)|s",
            calls: Calls::None,
        },
    );
    function(
        &mut Choices::new(second),
        &mut text,
        "fn h1(t: ptr<function, S>, arr: ptr<function, array<f32, 4>>, w: S) -> f32",
        "var f0: f32 = 1.5; var f1: f32; var i0: i32; var v: vec3<f32>;",
        Scope {
            floats: vec!["f0", "f1", "(*t).a", "(*t).b.y", "g0", "v.z"],
            integers: vec!["i0", "(*t).n", "gs.n"],
            float_inputs: vec!["w.a", "w.b.x"],
            integer_inputs: vec!["w.n"],
            structs: vec!["*t", "gs"],
            arrays: vec!["(*arr)"],
            vectors: vec!["v"],
            color: "",
            result: "F|f1",
            calls: Calls::H0,
        },
    );
    function(
        &mut Choices::new(entry),
        &mut text,
        "@fragment fn fs(in: In, @builtin(front_facing) front: bool) -> Out",
        "var f0: f32; var f1: f32 = 2.0; var f2: f32; var i0: i32; var i1: i32 = 3; \
         var v: vec3<f32>; var s: S; var u: S; var arr: array<f32, 4>; var out: Out;",
        Scope {
            floats: vec![
                "f0", "f1", "f2", "v.x", "v.y", "s.a", "s.b.x", "u.a", "g0", "gs.a", "out.d",
                "out.e", "out.c.x", "out.c.w",
            ],
            integers: vec!["i0", "i1", "s.n", "u.n", "gi", "out.n"],
            float_inputs: vec![
                "in.p.x",
                "in.p.w",
                "in.q.y",
                "in.r",
                "select(0.5, 1.5, front)",
            ],
            integer_inputs: vec!["in.k"],
            structs: vec!["s", "u", "gs"],
            arrays: vec!["arr"],
            vectors: vec!["v"],
            color: "out.c",
            result: "out|Out(vec4(F, F, F, 1.0), F, I, F)|Out(vec4(v, F), F, I, F)",
            calls: Calls::Both,
        },
    );
    text
}

fn function(choices: &mut Choices<'_>, out: &mut String, head: &str, locals: &str, scope: Scope) {
    let mut generator = Generator {
        choices,
        scope,
        text: String::new(),
        counters: 0,
        depth: 0,
        in_loop: false,
        in_breakable: false,
    };
    generator.block();
    generator.block();
    generator.block();
    generator.leave();
    let (body, counters) = (generator.text, generator.counters);
    let _ = writeln!(out, "{head} {{\n{locals}");
    for k in 0..counters {
        let _ = writeln!(out, "var k{k}: i32;");
    }
    let _ = writeln!(out, "{body}}}");
}

impl Generator<'_, '_> {
    fn pick(&mut self, from: &[&'static str]) -> &'static str {
        from[self.choices.below(from.len())]
    }

    fn float(&mut self, depth: usize) -> String {
        let kinds = if depth == 0 { 4 } else { 9 };
        match self.choices.below(kinds) {
            0 => ["0.5", "1.25", "-0.75", "3.0"][self.choices.below(4)].to_owned(),
            1 => {
                let from = self.scope.floats.clone();
                self.pick(&from).to_owned()
            }
            2 => {
                let from = self.scope.float_inputs.clone();
                self.pick(&from).to_owned()
            }
            3 => {
                let vectors = self.scope.vectors.clone();
                format!(
                    "{}.{}",
                    self.pick(&vectors),
                    ["x", "y", "z"][self.choices.below(3)]
                )
            }
            4 => {
                let op = ["+", "-", "*"][self.choices.below(3)];
                format!("({} {op} {})", self.float(depth - 1), self.float(depth - 1))
            }
            5 => format!("sin({})", self.float(depth - 1)),
            6 => format!("f32({})", self.integer(depth - 1)),
            7 => {
                let arrays = self.scope.arrays.clone();
                let array = self.pick(&arrays);
                format!("{array}[{} & 3]", self.integer(depth - 1))
            }
            _ => format!(
                "select({}, {}, {})",
                self.float(depth - 1),
                self.float(depth - 1),
                self.condition()
            ),
        }
    }

    fn vector(&mut self) -> String {
        let vectors = self.scope.vectors.clone();
        match self.choices.below(3) {
            0 => self.pick(&vectors).to_owned(),
            1 => format!(
                "vec3({}, {}, {})",
                self.float(1),
                self.float(1),
                self.float(1)
            ),
            _ => format!("vec3({}, {}.yz)", self.float(1), self.pick(&vectors)),
        }
    }

    fn integer(&mut self, depth: usize) -> String {
        let kinds = if depth == 0 { 3 } else { 5 };
        match self.choices.below(kinds) {
            0 => ["0", "1", "2", "5"][self.choices.below(4)].to_owned(),
            1 => {
                let from = self.scope.integers.clone();
                self.pick(&from).to_owned()
            }
            2 => {
                let from = self.scope.integer_inputs.clone();
                self.pick(&from).to_owned()
            }
            3 => format!(
                "({} + {})",
                self.integer(depth - 1),
                self.integer(depth - 1)
            ),
            _ => format!("i32(clamp({}, -4.0, 4.0))", self.float(depth - 1)),
        }
    }

    fn condition(&mut self) -> String {
        match self.choices.below(3) {
            0 => format!("({} < {})", self.float(1), self.float(1)),
            1 => format!("({} > {})", self.integer(1), self.integer(1)),
            _ => format!("(({} & 1) == 0)", self.integer(1)),
        }
    }

    fn struct_value(&mut self) -> String {
        let structs = self.scope.structs.clone();
        match self.choices.below(3) {
            0 => self.pick(&structs).to_owned(),
            1 => format!(
                "S({}, vec2({}, {}), {})",
                self.float(1),
                self.float(1),
                self.float(1),
                self.integer(1)
            ),
            _ if self.scope.calls != Calls::None => self.call_h0(),
            _ => self.pick(&structs).to_owned(),
        }
    }

    fn call_h0(&mut self) -> String {
        let targets: &[&'static str] = match self.scope.calls {
            Calls::Both => &["f0", "f1", "u.a", "arr[1]", "out.e"],
            _ => &["f0", "f1"],
        };
        let target = self.pick(targets);
        format!("h0(&{target}, {}, {})", self.float(1), self.integer(1))
    }

    fn call_h1(&mut self) -> String {
        let target = self.pick(&["s", "u"]);
        let value = self.pick(&["gs", "s", "u"]);
        format!("h1(&{target}, &arr, {value})")
    }

    fn line(&mut self, text: &str) {
        self.text.push_str(text);
        self.text.push('\n');
    }

    fn block(&mut self) {
        for _ in 0..self.choices.below(4) {
            self.statement();
        }
    }

    /// A block that may end in a jump.
    fn jumping_block(&mut self) {
        self.depth += 1;
        self.block();
        self.depth -= 1;
        match self.choices.below(7) {
            1 if self.in_breakable => self.line("break;"),
            2 if self.in_loop => self.line("continue;"),
            3 => self.leave(),
            4 => self.line("discard;"),
            _ => {}
        }
    }

    fn leave(&mut self) {
        let results: Vec<&str> = self.scope.result.split('|').collect();
        let chosen = results[self.choices.below(results.len())];
        let mut text = String::new();
        for c in chosen.chars() {
            // `F` and `I` stand alone; in names they are lower-case.
            match c {
                'F' => text.push_str(&self.float(2)),
                'I' => text.push_str(&self.integer(1)),
                c => text.push(c),
            }
        }
        self.line(&format!("return {text};"));
    }

    fn statement(&mut self) {
        let kinds = if self.depth < 3 { 15 } else { 7 };
        match self.choices.below(kinds) {
            0 | 1 => {
                let floats = self.scope.floats.clone();
                let target = self.pick(&floats);
                let value = self.float(2);
                self.line(&format!("{target} = {value};"));
            }
            2 => {
                let integers = self.scope.integers.clone();
                let target = self.pick(&integers);
                let value = self.integer(2);
                self.line(&format!("{target} = {value};"));
            }
            3 => {
                let structs = self.scope.structs.clone();
                let target = self.pick(&structs);
                let value = self.struct_value();
                self.line(&format!("{target} = {value};"));
            }
            4 => {
                let vectors = self.scope.vectors.clone();
                let target = self.pick(&vectors);
                let text = match self.choices.below(9) {
                    0 => format!(
                        "{target} = vec3({}, {}, {});",
                        self.float(1),
                        self.float(1),
                        self.float(1)
                    ),
                    1 => format!("{target}.y = {};", self.float(2)),
                    2 => format!("{target} = {target}.zxy * {} + {target};", self.vector()),
                    3 => format!(
                        "{target} = mix({target}, {}, {});",
                        self.vector(),
                        self.float(1)
                    ),
                    4 => format!(
                        "{target} = select({target}, -{target}.yzx, {target} < {});",
                        self.vector()
                    ),
                    5 => format!(
                        "{target} = mat3x3({target}, {target}.yzx, {target}.zxy) * {target};"
                    ),
                    6 => format!(
                        "{target} = max(cross({target}, {}), vec3({}));",
                        self.vector(),
                        self.float(1)
                    ),
                    7 => match (self.scope.color, self.choices.below(4)) {
                        ("", _) => format!("{target} = vec3({target}.zx, {});", self.float(1)),
                        (color, 0) => {
                            format!("{color} = vec4({}, {});", self.vector(), self.float(1))
                        }
                        (color, 1) => format!("{color} = vec4({}, {target});", self.float(1)),
                        (color, 2) => {
                            format!("{color} = {color}.wzyx * vec4({target}.xy, in.q);")
                        }
                        (color, _) => format!(
                            "{color} = vec4({color}.a, {target}.zx, in.p.{color_component});",
                            color_component = ["x", "w"][self.choices.below(2)]
                        ),
                    },
                    _ => format!(
                        "{target}[{} % 3u] = {};",
                        format_args!("u32({})", self.integer(1)),
                        self.float(1)
                    ),
                };
                self.line(&text);
            }
            5 => {
                let arrays = self.scope.arrays.clone();
                let target = self.pick(&arrays);
                let text = match self.choices.below(3) {
                    0 => format!("{target}[2] = {};", self.float(2)),
                    1 => format!("{target}[{} & 3] = {};", self.integer(1), self.float(1)),
                    _ => format!(
                        "{target} = array<f32, 4>({}, {}, 0.0, 1.0);",
                        self.float(1),
                        self.float(1)
                    ),
                };
                self.line(&text);
            }
            6 => match self.scope.calls {
                Calls::Both => {
                    let call = self.call_h1();
                    self.line(&format!("f2 = {call};"));
                }
                Calls::H0 => {
                    let call = self.call_h0();
                    self.line(&format!("f1 = {call}.a;"));
                }
                Calls::None => {}
            },
            7..=9 => {
                let condition = self.condition();
                self.line(&format!("if {condition} {{"));
                self.jumping_block();
                if self.choices.below(2) == 1 {
                    self.line("} else {");
                    self.jumping_block();
                }
                self.line("}");
            }
            10 => self.switch(),
            _ => self.repeat(),
        }
    }

    fn switch(&mut self) {
        let selector = self.integer(1);
        self.line(&format!("switch {selector} {{"));
        let outer = std::mem::replace(&mut self.in_breakable, true);
        for value in 0..1 + self.choices.below(3) {
            self.line(&format!("case {value}: {{"));
            self.jumping_block();
            self.line("}");
        }
        self.line("default: {");
        self.jumping_block();
        self.line("}\n}");
        self.in_breakable = outer;
    }

    fn repeat(&mut self) {
        let k = format!("k{}", self.counters);
        self.counters += 1;
        let turns = 1 + self.choices.below(4);
        let outer = (
            std::mem::replace(&mut self.in_loop, true),
            std::mem::replace(&mut self.in_breakable, true),
        );
        self.line(&format!("{k} = 0;"));
        match self.choices.below(3) {
            0 => {
                self.line("loop {");
                self.jumping_block();
                self.line(&format!("continuing {{ {k} += 1;"));
                let floats = self.scope.floats.clone();
                let target = self.pick(&floats);
                let value = self.float(1);
                self.line(&format!("{target} = {value};"));
                self.line(&format!("break if {k} >= {turns};\n}}\n}}"));
            }
            1 => {
                self.line(&format!("for (; {k} < {turns}; {k} += 1) {{"));
                self.jumping_block();
                self.line("}");
            }
            _ => {
                self.line(&format!(
                    "loop {{\nif {k} >= {turns} {{ break; }}\n{k} += 1;"
                ));
                self.jumping_block();
                self.line("}");
            }
        }
        (self.in_loop, self.in_breakable) = outer;
    }
}

/// Makes cases of the switches of a module fall through into the next, as `choices` says: WGSL
/// cannot write it, GLSL and IR can.
pub fn fall_through(module: &mut naga::Module, choices: &mut Choices<'_>) {
    let functions = module
        .functions
        .iter_mut()
        .map(|(_, f)| f)
        .chain(module.entry_points.iter_mut().map(|e| &mut e.function));
    for function in functions {
        change(&mut function.body, choices);
    }
}

fn change(block: &mut naga::Block, choices: &mut Choices<'_>) {
    use naga::Statement as S;
    for statement in block.iter_mut() {
        match statement {
            S::Block(b) => change(b, choices),
            S::If { accept, reject, .. } => {
                change(accept, choices);
                change(reject, choices);
            }
            S::Loop {
                body, continuing, ..
            } => {
                change(body, choices);
                change(continuing, choices);
            }
            S::Switch { cases, .. } => {
                let last = cases.len() - 1;
                for (i, case) in cases.iter_mut().enumerate() {
                    change(&mut case.body, choices);
                    if i < last && choices.below(2) == 1 {
                        case.fall_through = true;
                        if matches!(case.body.last(), Some(S::Break)) {
                            let end = case.body.len();
                            case.body.cull(end - 1..);
                        }
                    }
                }
            }
            _ => {}
        }
    }
}
