//! What GLSL means once it is read: held against glslang's SPIR-V of the same text by `agree`, and
//! the WGSL written of it against Tint.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use preshade_validate::Effort;
use preshade_validate::agree::{Relation, agree};
use shader_text::error::Color;
use shader_text::options;

use crate::accept;
use crate::spirv_in::glslang;

const VERTEX: &str = "#version 450
layout(location = 0) in vec3 position;
layout(location = 0) out vec2 vUv;
void main() { vUv = position.xy; gl_Position = vec4(position, 1.0); }
";

fn read(sources: &[Source]) -> Result<Plan, String> {
    let parsed = front::parse(sources, &options::Options::default());
    let parsed = parsed.map_err(|e| e.render(Color::Never))?;
    Ok(parsed.plan("m", &MaterialState::default()))
}

fn of_texts(vertex: &str, fragment: &str) -> Result<Plan, String> {
    read(&[
        Source::new("m.vert", vertex),
        Source::new("m.frag", fragment),
    ])
}

/// The program as glslang reads it.
fn of_glslang(vertex: &str, fragment: &str, dir: &Path) -> Plan {
    let module = |name: &str, text: &str| {
        let path = dir.join(name);
        std::fs::write(&path, text).unwrap();
        let bytes = glslang(&path, &[], dir);
        Source::from_bytes(format!("{name}.spv"), bytes).unwrap()
    };
    let modules = [module("m.vert", vertex), module("m.frag", fragment)];
    read(&modules).unwrap_or_else(|e| panic!("{e}\n{fragment}"))
}

/// Why both programs differ, if they do.
fn difference(one: &Plan, other: &Plan) -> Option<String> {
    let agreement = agree(one, other, Relation::Same.into(), &Effort::default()).unwrap();
    (!agreement.holds()).then(|| format!("{:#?}", agreement.findings))
}

/// What Tint says of the WGSL written.
fn refusals(plans: &[(String, Plan)]) -> Vec<String> {
    let text = |(_, plan): &(String, Plan)| {
        let files = emit::emit(plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
        let file = files.into_iter().find(|f| f.name.ends_with(".wgsl"));
        String::from_utf8(file.unwrap().bytes).unwrap()
    };
    let texts: Vec<String> = plans.iter().map(text).collect();
    let errors = accept::tint_says(&texts);
    let refused = errors.iter().zip(plans).zip(&texts);
    let refused = refused.filter(|((errors, _), _)| !errors.is_empty());
    refused
        .map(|((errors, (name, _)), text)| format!("{name}: {errors:?}\n{text}"))
        .collect()
}

fn scratch() -> PathBuf {
    let dir = accept::scratch();
    std::fs::create_dir_all(&dir).unwrap();
    dir
}

/// The GLSL of `fixtures/cases` that is about reading it.
fn cases() -> Vec<(String, String)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/cases");
    let mut found = Vec::new();
    for dir in [folder.clone(), folder.join("adv")] {
        for entry in std::fs::read_dir(&dir).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            let is_in = name.starts_with("glsl-") && !name.starts_with("glsl-out");
            if (is_in || name.starts_with("wgsl-out-")) && name.ends_with(".frag") {
                found.push((name, std::fs::read_to_string(path).unwrap()));
            }
        }
    }
    found.sort();
    found
}

/// glslang folds their constants to infinities and NaN, which naga reads in no module.
const INFINITE: [&str; 4] = [
    "glsl-constant-folded-zero.frag",
    "glsl-constant-invalid-argument.frag",
    "glsl-constant-overflow.frag",
    "wgsl-out-infinity-from-bits.frag",
];

/// Its discard never runs, so discards are not evaluated; its colours are.
const NEVER_DISCARDS: &str = "glsl-constant-shift-to-sign.frag";

/// Each is read, Chrome's compiler takes its WGSL, and it means what glslang says.
#[test]
fn every_case_means_what_glslang_says() {
    let dir = scratch();
    let cases = cases();
    assert!(cases.len() >= 16, "{cases:?}");
    let (mut plans, mut wrong) = (Vec::new(), Vec::new());
    for (name, fragment) in cases {
        let ours = of_texts(VERTEX, &fragment).unwrap_or_else(|e| panic!("{name}: {e}"));
        // Vulkan's GLSL has locations.
        let vulkan = fragment
            .replace("#version 430 core", "#version 450")
            .replace(
                "\nin vec2 vUv; out vec4 c;",
                "\nlayout(location = 0) in vec2 vUv; layout(location = 0) out vec4 c;",
            );
        if !INFINITE.contains(&name.as_str()) {
            let theirs = of_glslang(VERTEX, &vulkan, &dir);
            let found = difference(&ours, &theirs);
            let found = found.filter(|d| d != "[]" || name != NEVER_DISCARDS);
            wrong.extend(found.map(|d| format!("{name}: {d}")));
        }
        plans.push((name, ours));
    }
    wrong.extend(refusals(&plans));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    std::fs::remove_dir_all(&dir).unwrap();
}

/// Every combination of one value a place.
fn combinations(places: &[&[&str]]) -> Vec<Vec<String>> {
    let mut all = vec![Vec::new()];
    for values in places {
        let with = |before: &Vec<String>| {
            let more = |v: &&str| [&before[..], &[(*v).to_owned()]].concat();
            values.iter().map(more).collect::<Vec<_>>()
        };
        all = all.iter().flat_map(with).collect();
    }
    all
}

const FLOATS: &[&str] = &["0.0", "-1.0", "1.5", "1e30", "x"];
const VECTORS: &[&str] = &["vec3(0.0)", "vec3(-1.0, 0.5, 2.0)", "vec3(1e30)", "vec3(x)"];
const INTS: &[&str] = &["0", "-1", "31", "32", "2147483647", "i"];
const UINTS: &[&str] = &[
    "0u",
    "1u",
    "32u",
    "0xffffffffu",
    "0x7f800000u",
    "0x7c00u",
    "u",
];

/// Expressions of floats: every operator and function, with constants in every place.
fn expressions() -> Vec<String> {
    let mut all = Vec::new();
    let mut calls = |names: &str, places: &[&[&str]], ending: &str| {
        for name in names.split(' ') {
            for arguments in combinations(places) {
                all.push(format!("float({name}({}){ending})", arguments.join(", ")));
            }
        }
    };
    let of_one = "radians degrees sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh exp \
                  log exp2 log2 sqrt inversesqrt abs sign floor trunc round roundEven ceil fract \
                  normalize isnan isinf";
    calls(of_one, &[FLOATS], "");
    calls(of_one, &[VECTORS], ".x");
    calls(
        "length floatBitsToInt floatBitsToUint int uint bool",
        &[FLOATS],
        "",
    );
    calls("length", &[VECTORS], "");
    let of_two = "atan pow mod min max step reflect";
    calls(of_two, &[FLOATS, FLOATS], "");
    calls(of_two, &[VECTORS, VECTORS], ".x");
    calls("mod min max", &[VECTORS, &["0.0", "x"]], ".x");
    calls("distance dot", &[VECTORS, VECTORS], "");
    let of_three = "clamp mix smoothstep fma faceforward refract";
    calls(of_three, &[&FLOATS[1..], FLOATS, FLOATS], "");
    calls(
        "clamp mix smoothstep fma faceforward",
        &[VECTORS, VECTORS, &["vec3(0.5)"]],
        ".x",
    );
    let of_bits = "bitCount findLSB findMSB bitfieldReverse";
    calls(of_bits, &[INTS], "");
    calls(of_bits, &[UINTS], "");
    calls("abs sign intBitsToFloat", &[INTS], "");
    calls("uintBitsToFloat", &[UINTS], "");
    let unpacked = "unpackHalf2x16 unpackSnorm2x16 unpackUnorm2x16 unpackSnorm4x8 unpackUnorm4x8";
    calls(unpacked, &[UINTS], ".x");
    let packed = "packHalf2x16 packSnorm2x16 packUnorm2x16";
    calls(packed, &[&["vec2(0.0)", "vec2(1e30)", "vec2(x)"]], "");
    calls(
        "packSnorm4x8 packUnorm4x8",
        &[&["vec4(0.0)", "vec4(1e30)", "vec4(x)"]],
        "",
    );
    let bits: &[&str] = &["0", "8", "28", "32", "i"];
    calls("bitfieldExtract", &[&["i", "u", "5", "5u"], bits, bits], "");
    calls("bitfieldInsert", &[&["i", "5"], &["7"], bits, bits], "");
    calls(
        "ldexp",
        &[FLOATS, &["0", "127", "128", "200", "-200", "i"]],
        "",
    );
    calls("min max", &[INTS, INTS], "");
    calls("clamp", &[INTS, &["0", "-1", "i"], &["0", "5", "-9"]], "");
    calls(
        "mix",
        &[&["true", "b"], &["false", "b"], &["true", "false", "b"]],
        "",
    );
    calls("mix", &[&["1", "i"], &["2", "i"], &["true", "b"]], "");
    let bools: &[&str] = &["bvec3(true)", "bvec3(b, true, false)"];
    calls("mix", &[bools, bools, bools], ".y");
    let matrices: &[&str] = &["mat2(1e30)", "mat2(0.0)", "mat2(x)"];
    calls("determinant", &[matrices], "");
    calls("inverse transpose", &[matrices], "[0].x");
    calls("matrixCompMult", &[matrices, matrices], "[0].x");
    let mut binary = |operators: &str, values: &[&str], ending: &str| {
        for operator in operators.split(' ') {
            for pair in combinations(&[values, values]) {
                let [a, b] = &pair[..] else { unreachable!() };
                all.push(format!("float(({a} {operator} {b}){ending})"));
            }
        }
    };
    binary("+ - * / % << >> & | ^", INTS, "");
    binary("+ - * / % << >> & | ^", UINTS, "");
    binary("+ - * / < ==", FLOATS, "");
    binary("+ - * /", &["0.0", "(2.0 - 2.0)", "-1.0", "x"], "");
    binary("+ - * /", VECTORS, ".y");
    binary("+ - *", matrices, "[0].x");
    for n in UINTS {
        all.push(format!("float(-{n})"));
        all.push(format!("float((-uvec2({n}, 3u)).x)"));
    }
    all
}

/// In GLSL a constant may be infinite or undefined, and WGSL has no such constants: each is read, and
/// written so that Chrome's compiler takes it, in a function and at the top.
#[test]
fn constants_follow_the_rules_of_glsl() {
    let all = expressions();
    assert!(all.len() > 2000, "{}", all.len());
    let head = "#version 450\nlayout(location = 0) in vec2 vUv; layout(location = 0) out vec4 c;\n";
    let is_constant = |e: &&String| {
        let words = e.split(|c: char| !c.is_alphanumeric() && c != '.');
        !words.clone().any(|w| ["x", "i", "u", "b"].contains(&w))
    };
    let mut plans = Vec::new();
    let mut wrong = Vec::new();
    let mut add = |name: String, fragment: String| match of_texts(VERTEX, &fragment) {
        Ok(plan) => plans.push((name, plan)),
        Err(e) => wrong.push(e),
    };
    for (n, part) in all.chunks(200).enumerate() {
        let sums: String = part.iter().map(|e| format!("    s += {e};\n")).collect();
        let locals = "float x = vUv.x; int i = int(x); uint u = uint(i); bool b = x > 0.5;";
        let body = format!("    {locals} float s = 0.0;\n{sums}    c = vec4(s);\n");
        add(format!("{n}"), format!("{head}void main() {{\n{body}}}\n"));
    }
    let constants: Vec<&String> = all.iter().filter(is_constant).collect();
    assert!(constants.len() > 500, "{}", constants.len());
    for (n, part) in constants.chunks(200).enumerate() {
        let mut text = head.to_owned();
        for (k, e) in part.iter().enumerate() {
            writeln!(text, "const float K{k} = {e};").unwrap();
        }
        let names: Vec<String> = (0..part.len()).map(|k| format!("K{k}")).collect();
        text += &format!("void main() {{ c = vec4({}); }}\n", names.join(" + "));
        add(format!("top {n}"), text);
    }
    wrong.extend(refusals(&plans));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    // A length must still be a number.
    for length in ["5 / 0", "1 << 31", "int(sqrt(-1.0))", "-1"] {
        let fragment = format!("{head}void main() {{ float a[{length}]; c = vec4(a[0]); }}\n");
        assert!(of_texts(VERTEX, &fragment).is_err(), "{length}");
    }
}

/// A stream of numbers (Knuth's MMIX).
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (self.0 >> 33) as usize % n
    }
}

/// A switch with labels in any order, that fall through, leave, and nest.
fn switch(numbers: &mut Numbers, depth: usize, in_loop: bool, out: &mut String) {
    let selector = ["i", "i + k", "k"][numbers.below(3)];
    writeln!(out, "switch ({selector}) {{").unwrap();
    let first = numbers.below(4) as i64 - 2;
    let count = 1 + numbers.below(5);
    let default = numbers.below(count + 2);
    for n in 0..count {
        match n == default {
            true => out.push_str("default: "),
            false => write!(out, "case {}: ", first + (n as i64 * 5) % 7).unwrap(),
        }
        // The last must not be empty.
        let needs_body = n + 1 == count;
        let mut is_empty = true;
        for _ in 0..numbers.below(3) {
            is_empty = false;
            match numbers.below(9) {
                0 => out.push_str("if (x > 4.0) break;\n"),
                1 => out.push_str("if (x > 3.0) { break; } else { x += 0.5; }\n"),
                2 => out.push_str("{ x += 2.0; break; }\n"),
                3 if in_loop => out.push_str("if (x > 6.0) continue;\n"),
                4 if depth < 2 => switch(numbers, depth + 1, in_loop, out),
                5 if depth < 2 => {
                    let j = format!("j{depth}");
                    writeln!(out, "for (int {j} = 0; {j} < 3; {j}++) {{").unwrap();
                    switch(numbers, depth + 1, true, out);
                    out.push_str("}\n");
                }
                _ => writeln!(out, "x = x * 1.5 + {}.0;", 1 + numbers.below(9)).unwrap(),
            }
        }
        match numbers.below(4) {
            0 | 1 => out.push_str("break;\n"),
            2 if in_loop => out.push_str("continue;\n"),
            _ if needs_body && is_empty => out.push_str("x += 1.0;\n"),
            _ => {}
        }
    }
    out.push_str("}\n");
}

/// Cases that fall through, that only break, and `default` anywhere.
#[test]
fn switches_mean_what_glslang_says() {
    let dir = scratch();
    let mut wrong = Vec::new();
    for seed in 0..24 {
        let mut text = "#version 450
layout(location = 0) in vec2 vUv; layout(location = 0) out vec4 c;
void main() {
int i = int(floor(vUv.x * 8.0)) - 1; int k = int(floor(vUv.y * 4.0)); float x = 0.0;
"
        .to_owned();
        let mut numbers = Numbers(seed);
        switch(&mut numbers, 0, false, &mut text);
        switch(&mut numbers, 1, false, &mut text);
        text += "c = vec4(x, float(i), float(k), 1.0);\n}\n";
        let ours = of_texts(VERTEX, &text).unwrap_or_else(|e| panic!("{e}\n{text}"));
        let theirs = of_glslang(VERTEX, &text, &dir);
        wrong.extend(difference(&ours, &theirs).map(|d| format!("{seed}: {d}\n{text}")));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    std::fs::remove_dir_all(&dir).unwrap();
}
