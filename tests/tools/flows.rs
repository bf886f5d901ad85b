//! Fragment shaders of random control flow: switches that fall through, loops, and ways out of them.

/// Writes a shader from a seed.
pub(crate) struct Flows {
    state: u64,
    loops: u32,
    /// Statements left to nest.
    left: u32,
}

/// What control may leave from a place.
#[derive(Clone, Copy)]
struct Around {
    in_loop: bool,
    in_switch: bool,
    /// The function returns a value.
    returns: bool,
}

impl Flows {
    pub(crate) fn new(seed: u64) -> Self {
        let state = (seed + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        Self {
            state,
            loops: 0,
            left: 0,
        }
    }

    /// A number below `n`.
    fn below(&mut self, n: u64) -> u64 {
        self.state ^= self.state << 13;
        self.state ^= self.state >> 7;
        self.state ^= self.state << 17;
        (self.state >> 33) % n
    }

    fn pick<'a>(&mut self, of: &[&'a str]) -> &'a str {
        of[self.below(of.len() as u64) as usize]
    }

    /// A shader that reads `v`.
    pub(crate) fn fragment(&mut self) -> String {
        let calls = self.below(2) == 0;
        let writes = self.below(7) > 0;
        let mut function = String::new();
        if calls {
            self.left = 14;
            let body = self.statements(
                2,
                3,
                Around {
                    in_loop: false,
                    in_switch: false,
                    returns: true,
                },
            );
            function = format!(
                "float f(float x, int i) {{ float y = 0.5, z = v.x; int j = i + 1; {body} return x + y * z; }}\n"
            );
        }
        self.left = 22;
        let body = self.statements(
            3,
            3,
            Around {
                in_loop: false,
                in_switch: false,
                returns: false,
            },
        );
        let call = if calls { "x = f(y, j);" } else { "" };
        let (output, first, last) = match writes {
            true => (
                "layout(location=0) out vec4 o;",
                "o = vec4(0.0);",
                "o = vec4(x, y, z, float(i) + float(j) * 0.125);",
            ),
            false => ("", "", "if (x + y > 1.5) discard;"),
        };
        format!(
            "#version 450\nlayout(location=0) in vec2 v; {output}\n{function}void main() {{\n\
             float x = v.x * 2.0, y = v.y, z = 0.25; int i = int(v.x * 5.0), j = int(v.y * 4.0);\n\
             {first} {call}\n{body}\n{last} }}\n"
        )
    }

    fn statements(&mut self, count: u64, depth: u32, around: Around) -> String {
        let mut all = String::new();
        for _ in 0..count {
            all += &self.statement(depth, around);
            all += "\n";
        }
        all
    }

    fn block(&mut self, depth: u32, around: Around) -> String {
        let count = 1 + self.below(3);
        self.statements(count, depth, around)
    }

    fn statement(&mut self, depth: u32, around: Around) -> String {
        self.left = self.left.saturating_sub(1);
        let choice = if depth == 0 || self.left == 0 {
            self.below(4)
        } else {
            self.below(12)
        };
        match choice {
            0..2 => self.assignment(),
            2..4 => {
                let (is, leave) = (self.condition(), self.leave(around));
                format!("if ({is}) {{ {} {leave} }}", self.assignment())
            }
            4..6 => {
                let is = self.condition();
                let then = self.block(depth - 1, around);
                match self.below(2) {
                    0 => format!("if ({is}) {{ {then} }}"),
                    _ => format!(
                        "if ({is}) {{ {then} }} else {{ {} }}",
                        self.block(depth - 1, around)
                    ),
                }
            }
            6..10 => self.switch(depth, around),
            _ => self.repeat(depth, around),
        }
    }

    fn switch(&mut self, depth: u32, around: Around) -> String {
        let mut labels: Vec<String> = (0..6)
            .filter(|_| self.below(2) == 0)
            .map(|n| format!("case {n}:"))
            .collect();
        for at in (1..labels.len()).rev() {
            let with = self.below(at as u64 + 1) as usize;
            labels.swap(at, with);
        }
        if labels.is_empty() || self.below(3) > 0 {
            let at = self.below(labels.len() as u64 + 1) as usize;
            labels.insert(at, "default:".to_owned());
        }
        let around = Around {
            in_switch: true,
            ..around
        };
        let mut cases = String::new();
        for label in labels {
            cases += &label;
            // Some share the statements of the next one, some fall into it.
            if self.below(5) > 0 {
                let body = self.statements(1, depth - 1, around);
                let end = match self.below(4) {
                    0 => "",
                    1 => &self.leave(around),
                    _ => "break;",
                };
                cases += &format!(" {{ {body} }} {end}\n");
            }
        }
        let of = self.pick(&["i", "j", "i & 3", "int(v.x * 6.0)", "(i + j) & 7"]);
        format!("switch ({of}) {{ {cases} break; }}")
    }

    fn repeat(&mut self, depth: u32, around: Around) -> String {
        self.loops += 1;
        let (k, most) = (format!("k{}", self.loops), 1 + self.below(4));
        let around = Around {
            in_loop: true,
            in_switch: false,
            ..around
        };
        let body = self.block(depth - 1, around);
        match self.below(3) {
            0 => format!("for (int {k} = 0; {k} < {most}; {k}++) {{ {body} }}"),
            1 => format!("int {k} = 0; while ({k} < {most}) {{ {k}++; {body} }}"),
            _ => {
                let is = self.condition();
                format!("int {k} = 0; do {{ {k}++; {body} }} while ({k} < {most} && {is});")
            }
        }
    }

    fn leave(&mut self, around: Around) -> String {
        let mut ways = vec!["discard;"];
        match around.returns {
            true => ways.extend(["return x;", "return y + 0.5;"]),
            false => ways.extend(["return;", "return;"]),
        }
        if around.in_loop {
            ways.extend(["continue;"; 2]);
        }
        if around.in_loop || around.in_switch {
            ways.extend(["break;"; 3]);
        }
        self.pick(&ways).to_owned()
    }

    fn assignment(&mut self) -> String {
        let (a, b, c) = (self.variable(), self.variable(), self.variable());
        match self.below(6) {
            0 => format!("{a} = {b} + 0.25;"),
            1 => format!("{a} = {b} * 0.5 + v.y;"),
            2 => format!("{a} = max({b}, {c});"),
            3 => format!("{a} = float(i) * 0.125;"),
            4 => format!("i = (i + {}) & 7;", 1 + self.below(3)),
            _ => "j = (i + j) & 7;".to_owned(),
        }
    }

    fn condition(&mut self) -> String {
        let n = self.below(5);
        match self.below(5) {
            0 => format!(
                "{} > {}",
                self.variable(),
                self.pick(&["0.3", "0.75", "1.5"])
            ),
            1 => format!("i {} {n}", self.pick(&["==", "<", ">", "!="])),
            2 => format!("j {} {n}", self.pick(&["==", "<", ">", "!="])),
            3 => format!(
                "v.{} < {}",
                self.pick(&["x", "y"]),
                self.pick(&["0.25", "0.5", "0.75"])
            ),
            _ => format!("(i & 1) == {} || {} < 0.5", n & 1, self.variable()),
        }
    }

    fn variable(&mut self) -> &'static str {
        self.pick(&["x", "y", "z"])
    }
}
