//! What lies in a block lies there in what is emitted too, to the byte: glslang's offsets of the
//! author's text against those of each target.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use shader_text::{files, options};

/// Offset and kind of each number of a block.
type Numbers = BTreeSet<(u32, char)>;

/// Elements of an array without a length that are looked at.
const ELEMENTS: u32 = 3;

const VERTEX: &str = "#version 450
layout(location = 0) in vec3 position;
layout(location = 0) out vec2 at;
void main() { at = position.xy; gl_Position = vec4(position, 1.0); }
";

/// The SPIR-V that glslang makes of a text, by OpenGL's rules.
fn glslang(text: &str, name: &str) -> Vec<u32> {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.frag"));
    std::fs::write(&path, text).unwrap();
    let out = path.with_extension("frag.spv");
    let said = Command::new("glslangValidator")
        .args(["-G", "--aml", "-o"])
        .arg(&out)
        .arg(&path)
        .output()
        .unwrap_or_else(|e| panic!("glslangValidator does not start: {e}"));
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    let bytes = std::fs::read(&out).unwrap_or_else(|_| panic!("{said}\n{text}"));
    std::fs::remove_file(&out).unwrap();
    bytes
        .chunks_exact(4)
        .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect()
}

/// A module's blocks by binding, read out of its decorations (SPIR-V 1.6, section 3.20).
fn of_spirv(words: &[u32]) -> BTreeMap<u32, Numbers> {
    let mut types: HashMap<u32, (u16, Vec<u32>)> = HashMap::new();
    let mut constants = HashMap::new();
    let mut strides = HashMap::new();
    let mut members: HashMap<(u32, u32, u32), u32> = HashMap::new();
    let mut bindings = HashMap::new();
    let mut variables = Vec::new();
    let mut rest = &words[5..];
    while let Some(first) = rest.first() {
        let (op, length) = (*first as u16, (*first >> 16) as usize);
        let operands = &rest[1..length];
        match op {
            21..=24 | 28..=30 | 32 => {
                types.insert(operands[0], (op, operands[1..].to_vec()));
            }
            43 => {
                constants.insert(operands[1], operands[2]);
            }
            59 => variables.push((operands[0], operands[1])),
            71 if operands[1] == 6 => {
                strides.insert(operands[0], operands[2]);
            }
            71 if operands[1] == 33 => {
                bindings.insert(operands[0], operands[2]);
            }
            // A member's offset, its matrix's stride, or that it is row major.
            72 => {
                let value = operands.get(3).copied().unwrap_or(1);
                members.insert((operands[0], operands[1], operands[2]), value);
            }
            _ => {}
        }
        rest = &rest[length..];
    }
    struct Of<'a> {
        types: &'a HashMap<u32, (u16, Vec<u32>)>,
        constants: &'a HashMap<u32, u32>,
        strides: &'a HashMap<u32, u32>,
        members: &'a HashMap<(u32, u32, u32), u32>,
    }
    impl Of<'_> {
        /// `matrix`: the stride of a matrix in it, and whether that is one of rows.
        fn walk(&self, ty: u32, at: u32, matrix: (u32, bool), out: &mut Numbers) {
            let (op, operands) = &self.types[&ty];
            match op {
                21 => {
                    out.insert((at, 'i'));
                }
                22 => {
                    out.insert((at, 'f'));
                }
                23 => {
                    (0..operands[1]).for_each(|i| self.walk(operands[0], at + 4 * i, matrix, out))
                }
                24 => {
                    let (vector, columns) = (operands[0], operands[1]);
                    let rows = self.types[&vector].1[1];
                    for (c, r) in (0..columns).flat_map(|c| (0..rows).map(move |r| (c, r))) {
                        let offset = match matrix.1 {
                            true => matrix.0 * r + 4 * c,
                            false => matrix.0 * c + 4 * r,
                        };
                        out.insert((at + offset, 'f'));
                    }
                }
                28 | 29 => {
                    let length = operands.get(1).map_or(ELEMENTS, |n| self.constants[n]);
                    for i in 0..length {
                        self.walk(operands[0], at + i * self.strides[&ty], matrix, out);
                    }
                }
                30 => {
                    for (i, member) in (0..).zip(operands) {
                        let said = |what: u32| self.members.get(&(ty, i, what)).copied();
                        let offset = said(35).unwrap_or_else(|| panic!("a member without offset"));
                        let matrix = (said(7).unwrap_or(0), said(4).is_some());
                        self.walk(*member, at + offset, matrix, out);
                    }
                }
                other => panic!("a type by instruction {other}"),
            }
        }
    }
    let of = Of {
        types: &types,
        constants: &constants,
        strides: &strides,
        members: &members,
    };
    let mut out = BTreeMap::new();
    for (pointer, variable) in variables {
        let Some(binding) = bindings.get(&variable) else {
            continue;
        };
        let mut numbers = Numbers::new();
        of.walk(types[&pointer].1[1], 0, (0, false), &mut numbers);
        out.insert(*binding, numbers);
    }
    out
}

/// As [`of_spirv`], of the module that naga reads of WGSL.
fn of_wgsl(text: &str) -> BTreeMap<u32, Numbers> {
    let module = naga::front::wgsl::parse_str(text).unwrap_or_else(|e| panic!("{e}\n{text}"));
    fn walk(module: &naga::Module, ty: naga::Handle<naga::Type>, at: u32, out: &mut Numbers) {
        use naga::TypeInner as T;
        let kind = |scalar: naga::Scalar| match scalar.kind {
            naga::ScalarKind::Float => 'f',
            _ => 'i',
        };
        match &module.types[ty].inner {
            T::Scalar(scalar) => {
                out.insert((at, kind(*scalar)));
            }
            T::Vector { size, scalar } => {
                out.extend((0..*size as u32).map(|i| (at + 4 * i, kind(*scalar))));
            }
            T::Matrix { columns, rows, .. } => {
                let stride = if *rows as u32 == 2 { 8 } else { 16 };
                for c in 0..*columns as u32 {
                    out.extend((0..*rows as u32).map(|r| (at + stride * c + 4 * r, 'f')));
                }
            }
            T::Array { base, size, stride } => {
                let length = match size {
                    naga::ArraySize::Constant(n) => n.get(),
                    _ => ELEMENTS,
                };
                (0..length).for_each(|i| walk(module, *base, at + i * stride, out));
            }
            T::Struct { members, .. } => {
                for member in members {
                    walk(module, member.ty, at + member.offset, out);
                }
            }
            other => panic!("{other:?}"),
        }
    }
    let mut out = BTreeMap::new();
    for (_, global) in module.global_variables.iter() {
        if let Some(binding) = global.binding {
            let mut numbers = Numbers::new();
            walk(&module, global.ty, 0, &mut numbers);
            out.insert(binding.binding, numbers);
        }
    }
    out
}

/// The fragment stage of what is emitted.
fn emitted(fragment: &str, target: Target) -> String {
    let sources = [
        Source::new("m.vert", VERTEX),
        Source::new("m.frag", fragment),
    ];
    let parsed = front::parse(&sources, &options::Options::default())
        .unwrap_or_else(|e| panic!("{}\n{fragment}", e.render(shader_text::error::Color::Never)));
    let plan = Plan::original(
        "m",
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    );
    let files = emit::emit(&plan, &[target], &emit::Options::default())
        .unwrap_or_else(|e| panic!("{e}\n{fragment}"));
    let of = |f: &&files::File| f.name.ends_with(".frag") || f.name.ends_with(".wgsl");
    let file = files.iter().find(of).unwrap();
    String::from_utf8(file.bytes.clone()).unwrap()
}

/// Fails where a number that the author's text has in a block is elsewhere in what is emitted.
fn compare(fragment: &str, name: &str) {
    let wanted = of_spirv(&glslang(fragment, &format!("{name}-author")));
    assert!(!wanted.is_empty());
    for target in [Target::Glsl450, Target::Wgsl] {
        let text = emitted(fragment, target);
        let found = match target {
            Target::Wgsl => of_wgsl(&text),
            _ => of_spirv(&glslang(&text, &format!("{name}-emitted"))),
        };
        for (binding, wanted) in &wanted {
            let lost = found.get(binding).map(|f| wanted.difference(f).collect());
            let lost: Vec<_> = lost.unwrap_or_else(|| wanted.iter().collect());
            assert!(
                lost.is_empty(),
                "{name}, {target:?}, binding {binding}: not at {lost:?}\n{fragment}\n{text}"
            );
        }
    }
}

#[test]
fn a_struct_lies_by_the_rules_of_each_block_it_is_in() {
    compare(
        "#version 450
struct Lamp { vec3 at; bool lit; float falloff[3]; mat2 turn; vec2 size[2]; };
struct Hall { float width; Lamp lamps[2]; mat3x2 frame; };
layout(std430, binding = 1) readonly buffer Tight { float one; Hall halls[]; } tight;
layout(std140, binding = 2) readonly buffer Loose { float one; Lamp lamp; float many[]; } loose;
layout(std140, binding = 3) uniform Uniforms { Lamp lamp; Hall hall; mat2 turn; };
layout(location = 0) in vec2 at;
layout(location = 0) out vec4 color;
float lit(Lamp l) { return l.lit ? l.falloff[1] + l.turn[1].x : l.size[1].y; }
void main() {
    Hall hall = tight.halls[int(at.x)];
    vec2 turned = tight.halls[1].lamps[0].turn * at + turn * at + hall.frame * vec3(at, 1.0);
    color = vec4(lit(tight.halls[2].lamps[1]), lit(loose.lamp), lit(lamp), loose.many[2] + \
        turned.x);
    color.x += hall.width + tight.one + loose.one + hall.lamps[1].falloff[int(at.y)];
}
",
        "lamps",
    );
}

/// What is read out of a struct of std430 is what is written there.
#[test]
fn a_storage_block_is_written_as_it_is_read() {
    let text = emitted(
        "#version 450
struct S { bool on; float many[3]; mat2 turn; };
layout(std430, binding = 0) buffer Out { S all[]; };
layout(location = 0) in vec2 at;
layout(location = 0) out vec4 color;
void main() {
    int i = int(at.x);
    all[i].on = at.x > 0.5;
    all[i].many[2] = at.y;
    all[i].many = float[3](1.0, 2.0, at.x);
    all[i].turn = mat2(at, at.yx);
    color = vec4(all[i].turn[0], all[i].many[i], float(all[i].on));
}
",
        Target::Glsl450,
    );
    for line in ["float many[3];", "vec2 turn[2];", "uint on;", "std430"] {
        assert!(text.contains(line), "{line}\n{text}");
    }
}

/// Structs are read, and written, as a whole too, each at an index that is taken once.
#[test]
fn a_struct_of_a_storage_block_is_copied_whole() {
    let text = emitted(
        "#version 450
struct S { bool on; float many[3]; mat2 turn; };
layout(std430, binding = 0) buffer Out { S all[]; };
layout(location = 0) in vec2 at;
layout(location = 0) out vec4 color;
void main() {
    int i = int(at.x);
    all[i++] = all[i];
    S s = all[i++];
    all[4] = S(at.y > 0.5, float[3](at.x, at.y, 1.0), mat2(at, at.yx));
    color = vec4(s.turn[0], s.many[i], float(s.on));
}
",
        Target::Wgsl,
    );
    for store in [
        "all[4i].on = select(0u, 1u, ",
        "all[4i].many = array<f32, 3>(",
        "all[4i].turn = array<vec2<f32>, 2>(",
    ] {
        assert!(text.contains(store), "{store}\n{text}");
    }
    // Two indices, and no more.
    assert_eq!(text.matches(" + 1i").count(), 2, "{text}");
}

/// Numbers by lot (Steele, Lea, Flood 2014: SplitMix).
struct Lot(u64);

impl Lot {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % n as u64) as usize
    }
}

const PLAIN: [&str; 17] = [
    "float", "int", "uint", "bool", "vec2", "vec3", "vec4", "ivec3", "uvec2", "bvec3", "mat2",
    "mat3", "mat4", "mat2x3", "mat3x2", "mat4x2", "mat4x3",
];

/// A number of what is at `path`.
fn number(ty: &str, path: &str) -> String {
    match ty {
        "bool" => format!("({path} ? 1.0 : 0.0)"),
        "bvec3" => format!("({path}.y ? 1.0 : 0.0)"),
        "float" | "int" | "uint" => format!("float({path})"),
        _ if ty.starts_with("mat") => format!("{path}[1].y"),
        _ => format!("float({path}.y)"),
    }
}

/// A member of a type by lot, its declaration and a number read of it.
fn member(lot: &mut Lot, structs: &[&str], name: &str) -> (String, String) {
    let of = lot.below(PLAIN.len() + 2 * structs.len());
    let array = lot.below(3) == 0;
    let (dimensions, index) = if array { ("[3]", "[i]") } else { ("", "") };
    match PLAIN.get(of) {
        Some(ty) => (
            format!("{ty} {name}{dimensions};"),
            number(ty, &format!("{name}{index}")),
        ),
        None => {
            let of = structs[(of - PLAIN.len()) % structs.len()];
            (
                format!("{of} {name}{dimensions};"),
                format!("of_{of}({name}{index}, i)"),
            )
        }
    }
}

#[test]
fn blocks_of_any_types_keep_their_layout() {
    for seed in 0..24 {
        let mut lot = Lot(seed);
        let mut text = "#version 450\n".to_owned();
        let mut functions = String::new();
        let all = ["A", "B", "C"];
        for (i, name) in all.into_iter().enumerate() {
            let (mut members, mut sum) = (String::new(), Vec::new());
            for m in 0..1 + lot.below(4) {
                let (declared, read) = member(&mut lot, &all[..i], &format!("m{m}"));
                members += &format!("    {declared}\n");
                sum.push(match read.starts_with("of_") {
                    true => read.replacen('(', "(s.", 1),
                    false => read.replacen(&format!("m{m}"), &format!("s.m{m}"), 1),
                });
            }
            writeln!(text, "struct {name} {{\n{members}}};").unwrap();
            let sum = sum.join(" + ");
            writeln!(
                functions,
                "float of_{name}({name} s, int i) {{ return {sum}; }}"
            )
            .unwrap();
        }
        let mut sum = Vec::new();
        let layouts = [
            "std430, binding = 1) readonly buffer",
            "std140, binding = 2) readonly buffer",
            "std140, binding = 3) uniform",
            "std430, binding = 4) readonly buffer",
        ];
        for (b, layout) in layouts.into_iter().enumerate() {
            let rows = ["", "row_major, "][lot.below(2)];
            let layout = format!("layout({rows}{layout}");
            let mut members = String::new();
            for m in 0..1 + lot.below(4) {
                let (declared, read) = member(&mut lot, &all, &format!("b{b}m{m}"));
                members += &format!("    {declared}\n");
                sum.push(read);
            }
            if b == 0 || b == 1 {
                let (declared, _) = member(&mut lot, &all, "last");
                let (ty, _) = declared.split_once(' ').unwrap();
                members += &format!("    {ty} last{b}[];\n");
                sum.push(match all.contains(&ty) {
                    true => format!("of_{ty}(last{b}[i], i)"),
                    false => number(ty, &format!("last{b}[i]")),
                });
            }
            writeln!(text, "{layout} Block{b} {{\n{members}}};").unwrap();
        }
        text += "layout(location = 0) in vec2 at;\nlayout(location = 0) out vec4 color;\n";
        text += &functions;
        let sum = sum.join("\n        + ");
        writeln!(
            text,
            "void main() {{\n    int i = int(at.x);\n    color = vec4({sum});\n}}"
        )
        .unwrap();
        compare(&text, &format!("lot-{seed}"));
    }
}
