//! Pairs of shaders made by a grammar: every construct that the front end rewrites, in every
//! dialect that has it, put together at random.
//!
//! What is computed is smooth, or decided by whole numbers: the two roads may differ by roundings,
//! and a picture that jumps where they do would prove nothing.

use std::fmt::Write as _;

/// A pair of a seed.
pub struct Pair {
    /// The vertex and the fragment shader, with their `#version`.
    pub texts: [String; 2],
    /// What is in them.
    pub constructs: Vec<&'static str>,
}

/// How many constructs there are.
pub const CONSTRUCTS: usize = 51;

/// A GLSL that a host may get.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Dialect {
    version: u32,
    es: bool,
}

impl Dialect {
    const ALL: [Self; 8] = [
        Self {
            version: 100,
            es: true,
        },
        Self {
            version: 300,
            es: true,
        },
        Self {
            version: 120,
            es: false,
        },
        Self {
            version: 130,
            es: false,
        },
        Self {
            version: 150,
            es: false,
        },
        Self {
            version: 330,
            es: false,
        },
        Self {
            version: 400,
            es: false,
        },
        Self {
            version: 420,
            es: false,
        },
    ];

    fn directive(self) -> String {
        match (self.version, self.es) {
            (100, _) => "#version 100\n".to_owned(),
            (n, true) => format!("#version {n} es\n"),
            (n @ 150.., false) => format!("#version {n} core\n"),
            (n, false) => format!("#version {n}\n"),
        }
    }

    /// `in` and `out`, integers, blocks.
    fn is_new(self) -> bool {
        self.version >= 130
    }

    fn has_blocks(self) -> bool {
        self.version >= 150
    }
}

/// Steele, Lea and Flood's SplitMix64 (OOPSLA 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    fn often(&mut self) -> bool {
        self.below(3) > 0
    }

    fn of<'a>(&mut self, all: &'a [String]) -> &'a str {
        &all[self.below(all.len())]
    }

    fn number(&mut self) -> String {
        format!("{}.{}", self.below(2), 1 + self.below(9))
    }
}

/// What a stage may name, by the number of components.
type Names = [Vec<String>; 4];

struct Maker {
    random: Random,
    dialect: Dialect,
    constructs: Vec<&'static str>,
    vertex: Stage,
    fragment: Stage,
}

#[derive(Default)]
struct Stage {
    declared: String,
    functions: String,
    body: String,
    names: Names,
}

fn vector(n: usize) -> String {
    match n {
        1 => "float".to_owned(),
        n => format!("vec{n}"),
    }
}

/// The pair of a seed, always the same.
pub fn pair(seed: u64) -> Pair {
    let dialect = Dialect::ALL[seed as usize % Dialect::ALL.len()];
    let mut maker = Maker {
        random: Random(seed),
        dialect,
        constructs: Vec::new(),
        vertex: Stage::default(),
        fragment: Stage::default(),
    };
    maker.vertex();
    maker.varyings();
    maker.uniforms();
    maker.samplers();
    for _ in 0..3 {
        maker.function();
    }
    for _ in 0..7 {
        maker.statement();
    }
    maker.output();
    maker.finish()
}

impl Maker {
    fn say(&mut self, construct: &'static str) {
        if !self.constructs.contains(&construct) {
            self.constructs.push(construct);
        }
    }

    /// A smooth expression of `n` components over what a stage has.
    fn expression(&mut self, names: &Names, n: usize, depth: usize) -> String {
        let ty = vector(n);
        if depth == 0 || self.random.below(6) == 0 {
            let all = &names[n - 1];
            return match all.is_empty() || self.random.below(4) == 0 {
                true => {
                    let number = self.random.number();
                    format!("{ty}({number})")
                }
                false => self.random.of(all).to_owned(),
            };
        }
        let a = self.expression(names, n, depth - 1);
        match self.random.below(12) {
            0 => format!("sin({a})"),
            1 => format!("cos({a} * 2.0)"),
            2 => format!("sqrt(abs({a}) + 0.25)"),
            3 => {
                let b = self.expression(names, n, depth - 1);
                format!("mix({a}, {b}, 0.{})", 1 + self.random.below(8))
            }
            4 => format!("smoothstep(-1.0, 2.0, {a})"),
            5 => format!("clamp({a}, -1.5, 1.5)"),
            6 => {
                let b = self.expression(names, n, depth - 1);
                format!("({a} - {b})")
            }
            7 => {
                let b = self.expression(names, n, depth - 1);
                format!("({a} * 0.5 + {b})")
            }
            8 => {
                let from = 1 + self.random.below(4);
                let b = self.expression(names, from, depth - 1);
                let c = self.expression(names, from, depth - 1);
                format!("{ty}(dot({b}, {c}) * 0.25)")
            }
            9 if n > 1 => {
                self.say("swizzle");
                let letters: String = (0..n)
                    .map(|_| ["x", "y", "z", "w"][self.random.below(n)])
                    .collect();
                format!("({a}).{letters}")
            }
            10 => {
                let parts: Vec<String> = (0..n)
                    .map(|_| self.expression(names, 1, depth - 1))
                    .collect();
                format!("{ty}({})", parts.join(", "))
            }
            _ => {
                let b = self.expression(names, n, depth - 1);
                format!("exp(-abs({a} + {b}))")
            }
        }
    }

    fn inputs(&self) -> &'static str {
        match self.dialect.is_new() {
            true => "in",
            false => "attribute",
        }
    }

    fn vertex(&mut self) {
        let word = self.inputs();
        let d = &mut self.vertex.declared;
        writeln!(
            d,
            "{word} vec3 position;\n{word} vec3 normal;\n{word} vec2 uv;"
        )
        .unwrap();
        self.say("attributes");
        self.vertex.declared += "uniform mat4 modelViewMatrix, projectionMatrix;\n";
        self.vertex.names = [
            Vec::new(),
            vec!["uv".to_owned(), "position.xy".to_owned()],
            vec!["position".to_owned(), "normal".to_owned()],
            Vec::new(),
        ];
        if self.dialect.version == 420 && self.random.often() {
            self.say("location in one stage");
            let with = "layout(location = 0) in vec3 position;";
            self.vertex.declared = self.vertex.declared.replace("in vec3 position;", with);
        }
        if self.random.often() {
            self.say("invariant");
            self.vertex.declared += "invariant gl_Position;\n";
        }
        if self.dialect.is_new() && self.random.often() {
            self.say("gl_VertexID");
            self.vertex.body += "    float turn = float(gl_VertexID / 1000000);\n";
            self.vertex.names[0].push("turn".to_owned());
        }
        if self.dialect.version >= 400 && self.random.often() {
            self.say("precise");
            self.vertex.body += "    precise float exactly = position.x * 0.5 + position.y;\n";
            self.vertex.names[0].push("exactly".to_owned());
        }
        if self.random.often() {
            self.say("matrix by columns");
            self.vertex.body += "    mat3 turned = mat3(modelViewMatrix);\n    vec3 view = \
                                 turned[2] * 0.1;\n    view.x += turned[0][1];\n";
            self.vertex.names[2].push("view".to_owned());
        }
    }

    fn varying(&mut self, ty: &str, name: &str, value: &str, how: &str) {
        let (out, into) = match self.dialect.is_new() {
            true => ("out", "in"),
            false => ("varying", "varying"),
        };
        writeln!(self.vertex.declared, "{how}{out} {ty} {name};").unwrap();
        writeln!(self.fragment.declared, "{how}{into} {ty} {name};").unwrap();
        writeln!(self.vertex.body, "    {name} = {value};").unwrap();
    }

    fn varyings(&mut self) {
        let names = self.vertex.names.clone();
        for i in 0..1 + self.random.below(4) {
            let n = 1 + self.random.below(4);
            let value = self.expression(&names, n, 2);
            let (ty, name) = (vector(n), format!("carried{i}"));
            self.varying(&ty, &name, &value, "");
            self.fragment.names[n - 1].push(name);
        }
        self.varying("vec2", "vUv", "uv", "");
        self.fragment.names[1].push("vUv".to_owned());
        if self.random.often() {
            self.say("matrix varying");
            let value = "mat2(uv, position.xy * 0.5)";
            self.varying("mat2", "frame", value, "");
            self.fragment.names[1].push("(frame * vec2(0.3, 0.4))".to_owned());
            self.fragment.names[1].push("frame[1]".to_owned());
        }
        if self.dialect.version != 100 && self.random.often() {
            self.say("array varying");
            let (out, into) = match self.dialect.is_new() {
                true => ("out", "in"),
                false => ("varying", "varying"),
            };
            writeln!(self.vertex.declared, "{out} vec3 parts[2];").unwrap();
            writeln!(self.fragment.declared, "{into} vec3 parts[2];").unwrap();
            self.vertex.body += "    parts[0] = normal;\n    parts[1] = position * 0.3;\n";
            self.fragment.names[2].push("parts[0]".to_owned());
            self.fragment.names[2].push("parts[1]".to_owned());
        }
        if self.dialect.has_blocks() && !self.dialect.es && self.random.often() {
            self.say("block of varyings");
            self.vertex.declared += "out Passed { vec3 across; float along; } passed;\n";
            self.fragment.declared += "in Passed { vec3 across; float along; } got;\n";
            self.vertex.body += "    passed.across = normal * 0.5;\n    passed.along = uv.x;\n";
            self.fragment.names[2].push("got.across".to_owned());
            self.fragment.names[0].push("got.along".to_owned());
        }
        if self.dialect.is_new() && self.random.often() {
            self.say("flat");
            self.varying("float", "step_", "0.25", "flat ");
            self.fragment.names[0].push("step_".to_owned());
        }
        if self.dialect.version >= 130 && !self.dialect.es && self.random.often() {
            self.say("noperspective");
            self.varying("vec2", "screen", "uv * 0.5", "noperspective ");
            self.fragment.names[1].push("screen".to_owned());
        }
    }

    fn uniforms(&mut self) {
        let add = |this: &mut Self, text: &str, names: &[(usize, &str)]| {
            this.fragment.declared += text;
            for (n, name) in names {
                this.fragment.names[n - 1].push((*name).to_owned());
            }
        };
        add(
            self,
            "uniform vec3 tint;\nuniform float amount;\n",
            &[(3, "tint"), (1, "amount")],
        );
        self.say("loose uniforms");
        if self.random.often() {
            self.say("uniform of both stages");
            self.vertex.declared += "uniform vec3 tint;\n";
            self.vertex.names[2].push("tint".to_owned());
        }
        if self.random.often() {
            self.say("array of floats");
            let names = [(1, "weights[2]"), (1, "weights[0]"), (2, "spots[1]")];
            add(
                self,
                "uniform float weights[4];\nuniform vec2 spots[3];\n",
                &names,
            );
        }
        if self.random.often() {
            self.say("bool uniform");
            add(self, "uniform bool lit;\n", &[(1, "(lit ? 0.5 : 0.25)")]);
        }
        if self.random.often() {
            self.say("matrix uniforms");
            let names = [(2, "(turn2 * vec2(0.2, 0.3))"), (3, "(turn3 * vec3(0.1))")];
            add(self, "uniform mat2 turn2;\nuniform mat3 turn3;\n", &names);
        }
        if self.random.often() {
            self.say("struct uniform");
            let names = [(3, "lamp.color"), (1, "lamp.reach"), (3, "lamps[1].color")];
            add(
                self,
                "struct Lamp { vec3 color; float reach; bool on; };\nuniform Lamp lamp;\n\
                 uniform Lamp lamps[2];\n",
                &names,
            );
            self.fragment.body +=
                "    Lamp copied = lamps[0];\n    if (copied.on) copied.reach = 0.75;\n";
            self.fragment.names[0].push("copied.reach".to_owned());
        }
        if self.dialect.is_new() && self.random.often() {
            self.say("integer uniform");
            add(self, "uniform int count;\n", &[(1, "float(count % 3)")]);
        }
        if self.dialect.has_blocks() && self.random.often() {
            self.say("uniform block");
            let names = [
                (3, "sky"),
                (1, "haze[1]"),
                (3, "scene.sun.xyz"),
                (1, "scene.level"),
            ];
            let text = "layout(std140) uniform Air { vec3 sky; float haze[2]; };\n\
                        layout(std140) uniform Scene { vec4 sun; float level; \
                        mat3 basis; } scene;\n";
            add(self, text, &names);
            if !self.dialect.es && self.random.often() {
                self.say("row_major");
                self.fragment.declared +=
                    "layout(std140, row_major) uniform Rows { mat3 rows; mat4x3 wide; };\n";
                self.fragment.names[2].push("(rows * vec3(0.2))".to_owned());
                self.fragment.names[2].push("(wide * vec4(0.1))".to_owned());
            }
        }
    }

    fn samplers(&mut self) {
        let read = match self.dialect.is_new() {
            true => "texture",
            false => "texture2D",
        };
        self.fragment.declared += "uniform sampler2D map;\n";
        self.fragment.names[3].push(format!("{read}(map, vUv)"));
        self.say(read);
        if self.random.often() {
            self.say("sampler in a struct");
            self.fragment.declared +=
                "struct Layer { sampler2D albedo; vec2 shift; };\nuniform Layer layer;\n";
            self.fragment.names[3].push(format!("{read}(layer.albedo, vUv + layer.shift)"));
        }
        if self.random.often() {
            self.say("array of samplers");
            self.fragment.declared += "uniform sampler2D maps[2];\n";
            self.fragment.names[3].push(format!("{read}(maps[1], vUv * 2.0)"));
            self.fragment.names[3].push(format!("{read}(maps[0], vUv)"));
        }
        if self.random.often() {
            self.say("sampler as a parameter");
            let text = format!(
                "vec4 twice(sampler2D from, vec2 at) {{ \
                 return 0.5 * ({read}(from, at) + {read}(from, at.yx)); }}\n"
            );
            self.fragment.functions += &text;
            self.fragment.names[3].push("twice(map, vUv)".to_owned());
        }
        if self.random.often() {
            self.say("cube");
            let cube = match self.dialect.is_new() {
                true => "texture",
                false => "textureCube",
            };
            self.fragment.declared += "uniform samplerCube sky_;\n";
            self.fragment.names[3].push(format!("{cube}(sky_, vec3(vUv - 0.5, 0.7))"));
        }
        if self.dialect.is_new() && self.random.often() {
            self.say("textureLod and texelFetch");
            self.fragment.names[3].push("textureLod(map, vUv, 1.0)".to_owned());
            self.fragment.names[3].push("texelFetch(map, ivec2(3, 5), 0)".to_owned());
        }
        if self.dialect.version >= 400 && self.random.often() {
            self.say("textureGather");
            self.fragment.names[3].push("textureGather(map, vec2(0.3, 0.6))".to_owned());
        }
        if self.random.often() {
            self.say("projected");
            let word = match self.dialect.is_new() {
                true => "textureProj",
                false => "texture2DProj",
            };
            self.fragment.names[3].push(format!("{word}(map, vec3(vUv, 1.5))"));
        }
    }

    fn function(&mut self) {
        let k = self.random.below(1000);
        let (n, names) = (1 + self.random.below(4), self.arguments());
        let (ty, name) = (vector(n), format!("made{k}x{n}"));
        if self.fragment.functions.contains(&name) {
            return;
        }
        let value = self.expression(&names, n, 3);
        let number = self.random.number();
        match self.random.below(4) {
            0 => {
                self.say("inout");
                writeln!(
                    self.fragment.functions,
                    "void {name}(inout {ty} grown, in vec3 a, float b) {{ vec2 c = a.xy; \
                     vec4 d = vec4(a, b); grown += {value}; }}"
                )
                .unwrap();
                let local = format!("held{k}");
                writeln!(
                    self.fragment.body,
                    "    {ty} {local} = {ty}({number});\n    {name}({local}, tint, amount);"
                )
                .unwrap();
                self.fragment.names[n - 1].push(local);
            }
            1 => {
                self.say("overloads");
                writeln!(
                    self.fragment.functions,
                    "{ty} {name}(vec3 a) {{ float b = a.x; vec2 c = a.yz; vec4 d = vec4(a, 1.0); \
                     return {value}; }}\n{ty} {name}(float b) {{ return {name}(vec3(b, 0.5, b)); }}"
                )
                .unwrap();
                self.fragment.names[n - 1].push(format!("{name}(amount)"));
            }
            2 => {
                self.say("macros");
                // ES and GLSL 1.20 have no `##`.
                let pastes = self.dialect.is_new() && !self.dialect.es;
                let paste = match pastes {
                    true => format!("#define PASTE{k}(a, b) a##b\n"),
                    false => String::new(),
                };
                writeln!(
                    self.fragment.functions,
                    "{paste}#define SQUARE{k}(x) ((x) * (x))"
                )
                .unwrap();
                writeln!(
                    self.fragment.functions,
                    "{ty} {name}(vec3 a) {{ float b = SQUARE{k}(a.x); vec2 c = a.yz; \
                     vec4 d = vec4(a, 1.0); return {value}; }}"
                )
                .unwrap();
                let call = match pastes {
                    true => format!("PASTE{k}(made, {k}x{n})(tint)"),
                    false => format!("{name}(tint)"),
                };
                self.fragment.names[n - 1].push(call);
            }
            _ => {
                self.say("early return");
                writeln!(
                    self.fragment.functions,
                    "{ty} {name}(vec3 a, int k) {{ float b = a.x; vec2 c = a.yz; \
                     vec4 d = vec4(a, 1.0); if (k == 1) return {ty}({number}); return {value}; }}"
                )
                .unwrap();
                self.fragment.names[n - 1].push(format!("{name}(tint, 0)"));
            }
        }
    }

    fn arguments(&self) -> Names {
        ["b", "c", "a", "d"].map(|name| vec![name.to_owned()])
    }

    #[allow(clippy::too_many_lines, reason = "a case for each kind of statement")]
    fn statement(&mut self) {
        let names = self.fragment.names.clone();
        let k = self.random.below(10_000);
        let n = 1 + self.random.below(4);
        let (ty, local) = (vector(n), format!("value{k}"));
        if self.fragment.body.contains(&local) {
            return;
        }
        let value = self.expression(&names, n, 3);
        writeln!(self.fragment.body, "    {ty} {local} = {value};").unwrap();
        let more = self.expression(&names, n, 2);
        let text = match self.random.below(14) {
            0 => {
                self.say("for");
                format!(
                    "for (int i{k} = 0; i{k} < 3; i{k}++) {{ if (i{k} == 1) continue; \
                     {local} = {local} * 0.5 + {more}; }}"
                )
            }
            1 if self.dialect.version != 100 => {
                self.say("while");
                format!(
                    "int i{k} = 0; while (i{k} < 4) {{ i{k}++; if (i{k} == 3) break; \
                     {local} += {more} * 0.1; }}"
                )
            }
            2 if self.dialect.version != 100 => {
                self.say("do");
                format!(
                    "int i{k} = 2; do {{ {local} = mix({local}, {more}, 0.3); \
                     i{k}--; }} while (i{k} > 0);"
                )
            }
            3 if self.dialect.is_new() => {
                self.say("switch");
                format!(
                    "switch (int(gl_FragCoord.x) % 4) {{ case 0: {local} += {more}; break; \
                     case 1: {local} *= 0.5; default: {local} -= {more} * 0.2; }}"
                )
            }
            4 if self.dialect.version != 100 => {
                self.say("array");
                let list = format!("{ty}[2]({local}, {more})");
                match self.dialect.version {
                    120.. => format!(
                        "{ty} list{k}[2] = {list}; for (int i{k} = 0; i{k} < 2; \
                         i{k}++) {local} += list{k}[i{k}] * 0.5;"
                    ),
                    _ => String::new(),
                }
            }
            5 if n >= 3 => {
                self.say("swizzle assigned");
                format!("{local}.zx = {local}.xy * 0.5; {local}.y += 0.125;")
            }
            6 => {
                self.say("struct");
                format!(
                    "struct Own{k} {{ {ty} first; float second; }}; \
                     Own{k} own{k} = Own{k}({local}, 0.5); {local} = own{k}.first * own{k}.second;"
                )
            }
            7 => {
                self.say("ternary");
                format!("{local} = mod(floor(gl_FragCoord.y), 2.0) < 0.5 ? {local} : {more};")
            }
            8 if self.dialect.is_new() => {
                self.say("effect in an index");
                format!(
                    "{ty} list{k}[3]; list{k}[0] = {local}; list{k}[1] = {more}; \
                     list{k}[2] = {local} * 0.5; int at{k} = 0; list{k}[at{k}++] *= 0.75; \
                     list{k}[at{k}++] += {ty}(0.125); {local} = list{k}[--at{k}]; \
                     {local} += list{k}[0] * float(at{k});"
                )
            }
            9 if self.dialect.is_new() => {
                self.say("element as out argument");
                writeln!(
                    self.fragment.functions,
                    "void grow{k}(inout {ty} x, float by) {{ x += {ty}(by); }}\n\
                     float taken{k}(out {ty} x) {{ x = {ty}(0.25); return 0.5; }}"
                )
                .unwrap();
                format!(
                    "{ty} list{k}[2]; list{k}[0] = {local}; list{k}[1] = {more}; int at{k} = 0; \
                     grow{k}(list{k}[at{k}++], 0.25); grow{k}(list{k}[at{k}], 0.5 * float(at{k})); \
                     {local} = list{k}[0] + list{k}[1]; {local} *= taken{k}(list{k}[--at{k}]); \
                     {local} += list{k}[0];"
                )
            }
            10 => {
                self.say("behind a jump");
                let dead = self.expression(&names, n, 2);
                format!(
                    "for (int i{k} = 0; i{k} < 3; i{k}++) {{ {local} += {more} * 0.2; \
                     if (i{k} == 1) {{ break; {local} = {dead}; }} continue; {local} = {dead}; }}"
                )
            }
            11 if self.dialect.is_new() => {
                self.say("cases in braces");
                format!(
                    "switch (int(gl_FragCoord.y) % 3) {{ case 0: {{ {local} += {more}; \
                     break; }} case 1: {{ {{ {local} *= 0.5; }} break; }} default: {{ \
                     {local} -= {more} * 0.2; }} }}"
                )
            }
            12 if self.dialect.version != 100 => {
                self.say("length by a constant");
                format!(
                    "const float LONG{k} = 2.5; {ty} list{k}[int(LONG{k})]; list{k}[0] = {local}; \
                     list{k}[1] = {more}; {local} = list{k}[0] * 0.5 + list{k}[1] * \
                     float(list{k}.length());"
                )
            }
            _ => {
                self.say("discard");
                format!(
                    "if (mod(floor(gl_FragCoord.x) + floor(gl_FragCoord.y), 13.0) < 0.5) discard; \
                     {local} += {more};"
                )
            }
        };
        writeln!(self.fragment.body, "    {text}").unwrap();
        self.fragment.names[n - 1].push(local);
    }

    fn output(&mut self) {
        let names = self.fragment.names.clone();
        let values: Vec<String> = (0..3)
            .map(|_| {
                let n = 1 + self.random.below(4);
                let value = self.expression(&names, n, 3);
                match n {
                    1 => format!("vec4({value})"),
                    2 => format!("vec4({value}, 0.5, 1.0)"),
                    3 => format!("vec4({value}, 1.0)"),
                    _ => value,
                }
            })
            .collect();
        // All locals count.
        let locals: Vec<String> = names
            .iter()
            .enumerate()
            .flat_map(|(i, all)| {
                let ending = ["", ".x", ".y", ".z"][i];
                let own = all.iter().filter(|n| n.starts_with("value"));
                own.map(move |n| format!("{n}{ending}")).collect::<Vec<_>>()
            })
            .collect();
        let sum = match locals.is_empty() {
            true => "0.0".to_owned(),
            false => locals.join(" + "),
        };
        let color = format!("0.5 + 0.5 * sin({} + vec4({sum}))", values.join(" + "));
        let target = match self.dialect.is_new() {
            true => {
                self.say("named output");
                self.fragment.declared += "out vec4 outColor;\n";
                "outColor"
            }
            false if self.random.often() => {
                self.say("gl_FragColor");
                "gl_FragColor"
            }
            false => {
                self.say("gl_FragData");
                "gl_FragData[0]"
            }
        };
        writeln!(self.fragment.body, "    {target} = {color};").unwrap();
    }

    fn finish(self) -> Pair {
        let directive = self.dialect.directive();
        let precision = match self.dialect.es {
            true => "precision highp float;\nprecision highp int;\n",
            false => "",
        };
        let Stage { declared, body, .. } = &self.vertex;
        // A triangle that is clipped has no linear values that two drivers, or two clip spaces,
        // agree on: small enough to be seen whole.
        let size = match declared.contains("noperspective") {
            true => "0.41",
            false => "1.0",
        };
        let place = format!(
            "    gl_Position = projectionMatrix * modelViewMatrix * vec4(position * {size}, 1.0);\n"
        );
        let vertex = format!("{directive}{precision}{declared}void main() {{\n{body}{place}}}\n");
        let Stage {
            declared,
            functions,
            body,
            ..
        } = &self.fragment;
        let fragment =
            format!("{directive}{precision}{declared}{functions}void main() {{\n{body}}}\n");
        Pair {
            texts: [vertex, fragment],
            constructs: self.constructs,
        }
    }
}
