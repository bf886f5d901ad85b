//! What GLSL says: which function is called, how blocks lie, what the preprocessor is asked, and
//! errors in GLSL's words.

use preshade_compiler::emit;
use preshade_compiler::front::{self, Parsed, Source};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use shader_text::error::{Code, Color};
use shader_text::options::{self, Options};

const VERTEX: &str = "attribute vec4 p; void main() { gl_Position = p; }";

fn sources(fragment: &str) -> Vec<Source> {
    vec![
        Source::new("a.vert", VERTEX),
        Source::new("a.frag", fragment),
    ]
}

fn parse(fragment: &str) -> Parsed {
    front::parse(&sources(fragment), &Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(Color::Never)))
}

/// The material as WGSL.
fn given(fragment: &str) -> String {
    wgsl(parse(fragment))
}

/// How often the text steps the variable `i`.
fn steps(text: &str) -> usize {
    let lines = text.lines().map(str::trim);
    lines.filter(|l| l.starts_with("i = i_value")).count()
}

/// Code, message and line of what is refused.
fn refused(fragment: &str) -> (Code, String, u32) {
    let error = front::parse(&sources(fragment), &Options::default()).unwrap_err();
    let line = error.location().map_or(0, |l| l.line);
    (error.code(), error.render(Color::Never), line)
}

fn plan(parsed: Parsed) -> Plan {
    let fragment = parsed.fragment.as_deref();
    let state = MaterialState::default();
    Plan::original("m", parsed.program, &parsed.vertex, fragment, &state)
}

fn wgsl(parsed: Parsed) -> String {
    let plan = plan(parsed);
    let files = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap();
    let file = files.iter().find(|f| f.name.ends_with(".wgsl")).unwrap();
    String::from_utf8(file.bytes.clone()).unwrap()
}

/// In GLSL ES nothing is converted, on the desktop the best is taken, and of two as good none.
#[test]
fn the_function_that_is_called_is_the_one_that_glsl_calls() {
    let desktop = |body: &str| {
        format!(
            "#version 400
out vec4 c;
float f(float x) {{ return 0.25; }}
float f(uint x) {{ return 0.5; }}
float g(float x, int y) {{ return 0.125; }}
float g(int x, float y) {{ return 0.75; }}
float h(int x, float y) {{ return 0.375; }}
float h(float x, float y) {{ return 0.875; }}
void main() {{
    {body}
}}
"
        )
    };
    let (code, told, line) = refused(&desktop("c = vec4(f(1));"));
    assert_eq!((code, line), (Code::Parse, 10), "{told}");
    assert!(
        told.contains("`f` with (int) is ambiguous: `f(float)`, `f(uint)`"),
        "{told}"
    );
    let (_, told, _) = refused(&desktop("c = vec4(g(1, 2));"));
    assert!(told.contains("`g` with (int, int) is ambiguous"), "{told}");
    let (_, told, _) = refused(&desktop("c = vec4(f(vec2(1.0)));"));
    assert!(told.contains("no `f` takes (vec2)"), "{told}");
    assert!(told.contains("`f(float)`, `f(uint)`"), "{told}");
    // One conversion is better than two.
    let text = given(&desktop(
        "c = vec4(h(1, 2), f(2u), f(true ? 1.0 : 2), 1.0);",
    ));
    assert!(text.contains("h(1i, 2f)"), "{text}");
    let es = "#version 300 es
precision highp float;
out vec4 c;
float f(float x) { return x; }
void main() { c = vec4(f(1)); }
";
    let (_, told, line) = refused(es);
    assert!(told.contains("no `f` takes (int)") && line == 5, "{told}");
    assert!(
        told.contains("GLSL ES has no implicit conversions"),
        "{told}"
    );
    // In GLSL ES 1.00 a function of the author's stands beside GLSL's own.
    let beside = "precision mediump float;
float mix(float a) { return a; }
void main() { gl_FragColor = vec4(mix(0.5), mix(0.1, 0.2, 0.3), 0.0, 1.0); }
";
    let text = given(
        beside
            .replacen("precision", "#version 100\nprecision", 1)
            .as_str(),
    );
    assert!(text.contains("mix_(0.5f)"), "{text}");
}

/// Which element is meant is settled in the argument's turn (4.60, section 6.1.1): Mesa reads `i`
/// once all arguments are evaluated, so this one is not drawn beside it.
#[test]
fn arguments_are_evaluated_from_left_to_right() {
    let text = "#version 330
out vec4 c;
float sum(float low, inout float a, float high) { a += low; return a + high; }
void main() {
    float a[3] = float[3](0.1, 0.4, 0.7);
    int i = 0;
    c = vec4(sum(float(i++), a[i], float(i++)));
}
";
    let text = given(text);
    let main = text.split("@fragment").nth(1).unwrap();
    insta::assert_snapshot!("arguments_in_order", main);
    // What nothing else touches is written in place.
    let plain = text_of_call("float x = 0.5; c = vec4(sum(sin(x), x, x * 2.0));");
    assert!(!plain.contains("held"), "{plain}");
    let twice = text_of_call("vec2 v = vec2(0.5); c = vec4(sum(v.x, v.y, 1.0));");
    assert!(
        twice.contains("v.y = ") && twice.contains("held"),
        "{twice}"
    );
}

fn text_of_call(body: &str) -> String {
    given(&format!(
        "#version 330
out vec4 c;
float sum(float low, inout float a, float high) {{ a += low; return a + high; }}
void main() {{ {body} }}
"
    ))
}

const ROWS: &str = "#version 430
struct Bone { mat3x4 turn; float weight; };
struct Pair { Bone bones[2]; mat2 small; bool on; };
layout(LAYOUT, row_major, binding = 0) buffer Poses {
    mat4 whole;
    layout(column_major) mat4 plain;
    mat2x3 tall[2];
    Pair pairs[3];
    mat3 last;
} poses;
layout(binding = 1) uniform Which { int i; } which;
out vec4 c;
void main() {
    int i = which.i;
    vec4 v = vec4(0.1, 0.2, 0.3, 0.4);
    poses.whole = poses.plain * poses.whole;
    poses.whole[1] = v;
    poses.whole[i].zx += v.xy;
    poses.whole[2].y *= 2.0;
    poses.whole[i][i] = 0.5;
    poses.tall[1][i] = v.xyz;
    poses.tall[0] = mat2x3(v.xyz, v.yzw);
    poses.pairs[i].bones[1].turn[2] = v;
    poses.pairs[i].bones[0] = poses.pairs[2].bones[1];
    Pair pair = poses.pairs[i];
    pair.bones[0].turn[1].xy = v.zw;
    pair.on = !pair.on;
    poses.pairs[1] = pair;
    poses.pairs[0].on = pair.small[1].x > 0.5;
    poses.pairs[0].small[1] += v.xy;
    poses.last++;
    c = poses.whole[1] + poses.pairs[2].bones[1].turn[0] + vec4(poses.tall[1][0], 1.0) + \
        float(poses.pairs[1].on);
}
";

/// Matrices by rows lie transposed, in structs and arrays too, and what is stored to one of their
/// columns goes to a component of each row.
#[test]
fn matrices_by_rows_are_stored_as_they_lie() {
    for layout in ["std430", "std140"] {
        let text = given(&ROWS.replace("LAYOUT", layout));
        insta::assert_snapshot!(format!("rows_{layout}"), text);
        let parsed = parse(&ROWS.replace("LAYOUT", layout));
        let module = parsed.program.module();
        // By hand: by std140 each row has 16 bytes, by std430 a row of two has 8; a `mat3x4` has 4
        // rows of 3.
        let expected: &[(&str, u32)] = match layout {
            "std430" => &[
                ("whole", 0),
                ("plain", 64),
                ("tall", 128),
                ("pairs", 176),
                ("last", 176 + 3 * 192),
            ],
            _ => &[
                ("whole", 0),
                ("plain", 64),
                ("tall", 128),
                ("pairs", 224),
                ("last", 224 + 3 * 208),
            ],
        };
        let found = module.types.iter().find_map(|(_, ty)| match &ty.inner {
            naga::TypeInner::Struct { members, .. } => {
                let has = |name: &str| members.iter().any(|m| m.name.as_deref() == Some(name));
                (has("whole") && has("last")).then_some(members)
            }
            _ => None,
        });
        let at: Vec<(&str, u32)> = found
            .unwrap()
            .iter()
            .filter(|m| {
                expected
                    .iter()
                    .any(|(name, _)| m.name.as_deref() == Some(name))
            })
            .map(|m| (m.name.as_deref().unwrap(), m.offset))
            .collect();
        assert_eq!(at, expected, "{layout}");
        wgsl(parsed);
    }
}

/// A struct in a storage block has no padding that one in a uniform block has, whatever else it is
/// used for.
#[test]
fn structs_in_storage_blocks_are_not_padded() {
    let text = "#version 430
struct Light { vec3 at; float power; float falloff[3]; };
layout(std430, binding = 0) readonly buffer Lights { Light lights[]; };
layout(std140, binding = 1) uniform One { Light one; };
out vec4 c;
void main() {
    Light light = lights[1];
    light.falloff[1] += one.falloff[2];
    c = vec4(light.at, light.falloff[1]) + lights[2].falloff[0];
}
";
    let parsed = parse(text);
    let module = parsed.program.module();
    let stride = module.types.iter().find_map(|(_, ty)| match ty.inner {
        naga::TypeInner::Array {
            size: naga::ArraySize::Dynamic,
            stride,
            ..
        } => Some(stride),
        _ => None,
    });
    // 12 + 4 + 3 * 4, in steps of 16.
    assert_eq!(stride, Some(32));
    wgsl(parsed);
}

/// GLSL ES 3.00, section 3.4; desktop GLSL compilers take 0.
#[test]
fn what_if_asks_of_names_that_are_not_defined() {
    let text = |version: &str, condition: &str| {
        format!(
            "#version {version}
precision highp float;
out vec4 c;
#define HERE 1
#if {condition}
float level = 0.5;
#else
float level = 0.25;
#endif
void main() {{ c = vec4(level); }}
"
        )
    };
    let (code, told, line) = refused(&text("300 es", "QUALITY > 1"));
    assert_eq!((code, line), (Code::Parse, 5), "{told}");
    assert!(told.contains("`QUALITY` is not defined"), "{told}");
    assert!(told.contains("test `defined(..)` first"), "{told}");
    let level = |version: &str, condition: &str| {
        let text = given(&text(version, condition));
        text.contains("level: f32 = 0.5f;")
    };
    assert!(!level("330", "QUALITY > 1"));
    assert!(level("330", "QUALITY == 0"));
    // What is not asked for is not missed.
    assert!(!level("300 es", "defined(QUALITY) && QUALITY > 1"));
    assert!(level("300 es", "HERE == 1 || QUALITY > 1"));
    assert!(level("300 es", "!defined QUALITY && defined HERE"));
    let elif = text("300 es", "HERE").replace("#else", "#elif QUALITY");
    assert!(given(&elif).contains("level: f32 = 0.5f;"));
    let (_, _, line) = refused(&elif.replace("HERE 1", "HERE 0"));
    assert_eq!(line, 7);
    let (_, told, line) = refused(&text("330", "1").replace("#endif", ""));
    assert!(told.contains("has no `#endif`") && line == 5, "{told}");
}

/// C11 6.10.3, which GLSL's preprocessor follows.
#[test]
fn macros_reach_others() {
    let text = |body: &str| {
        format!(
            "#version 330
#define twice(x) ((x) * 2.0)
#define more(x) twice(1.0 + x)
#define apply(f, x) f(x)
#define name twice
#define call name
#define paste(a, b) a##b
#define pasted(a, b) paste(a, b)
#define six 6
#define empty
#define self(x) x + self
out vec4 c;
float self = 0.5;
void main() {{
    float a = 0.25;
    c = vec4({body});
}}
"
        )
    };
    for (called, written) in [
        ("twice(more(a))", "(1.0 + a) * 2.0 * 2.0"),
        ("more(more(a))", "(1.0 + (1.0 + a) * 2.0) * 2.0"),
        ("apply(twice, apply(more, a))", "(1.0 + a) * 2.0 * 2.0"),
        ("call(a)", "a * 2.0"),
        ("pasted(tw, ice)(a)", "a * 2.0"),
        ("pasted(0., six) empty", "0.6"),
        ("self(a)", "a + self"),
        ("twice\n(\na\n)", "a * 2.0"),
        ("apply(empty twice, a)", "a * 2.0"),
    ] {
        let (called, written) = (given(&text(called)), given(&text(written)));
        assert_eq!(called, written);
    }
    let (_, told, line) = refused(&text("twice(a, a)"));
    assert!(
        told.contains("the macro `twice` takes 1 argument, but 2 are given"),
        "{told}"
    );
    assert_eq!(line, 16);
    // Doubled again and again it comes to an end.
    let mut endless = text("b40(a0)");
    for i in 0..40 {
        let line = format!(
            "#define b{}(x) b{i}(x + x)\n#define a{} a{i} + a{i}\n",
            i + 1,
            i + 1
        );
        endless.insert_str("#version 330\n".len(), &line);
    }
    let endless = endless.replace("a0 ", "1.0 ");
    let (code, told, _) = refused(&endless);
    assert_eq!(code, Code::TooDeep, "{told}");
}

/// Types by GLSL's names, at the author's line.
#[test]
fn errors_are_in_the_words_of_glsl() {
    let mut all = String::new();
    for body in [
        "c = m * v3;",
        "float x = v3;",
        "v3 = vec2(1.0);",
        "v3 += m[0];",
        "int n = 1.5;",
        "c = vec4(v3, v3, 1.0, 1.0);",
        "c = vec4(1.0, 2.0);",
        "if (v3.x) c = vec4(1.0);",
        "c = v3.x[0] * vec4(1.0);",
        "c = vec4(max(v3, vec2(1.0)), 1.0, 1.0);",
        "c = vec4(v3.xw, 1.0, 1.0);",
        "c = vec4(part.weight);",
        "c = part;",
        "c = vec4(!v3.x);",
        "c = true ? v3 : 1.0;",
        "c = vec4(nothing());",
        "c = vec4(texture(map, 1));",
        "c = vec4(v3[1.0]);",
        "c = Part(1.0);",
        "u = 1.0;",
        "float v3; float v3;",
        "c = vec4(dot(v3, 1.0));",
        "return 1.0;",
        "c = vec4(1 + true);",
        "const float k;",
        "v3.xx = vec2(1.0);",
        "c = vec4(undeclared);",
        "c = vec4(mat2(1.0) == mat3(1.0));",
        "part.gain = vec2(1.0);",
    ] {
        let text = format!(
            "#version 330
struct Part {{ float gain; vec3 tint; }};
uniform float u;
uniform sampler2D map;
in float nowhere;
out vec4 c;
void nothing() {{}}
void main() {{
    mat4 m = mat4(1.0);
    vec3 v3 = vec3(u);
    Part part = Part(1.0, v3);
    {body}
}}
"
        );
        let text = text.replace("in float nowhere;\n", "");
        let error = match front::parse(&sources(&text), &Options::default()) {
            Ok(_) => {
                all += &format!("{body}\n  accepted\n");
                continue;
            }
            Err(error) => error,
        };
        let at = error.location().map(|l| (l.line, l.column));
        assert_eq!(at.map(|a| a.0), Some(11), "{body}: {error}");
        let told = error.render(Color::Never);
        assert!(
            !told.contains("naga") && !told.contains("Vector {"),
            "{told}"
        );
        all += &format!("{body}\n  {}: {}\n", at.unwrap().1, error.message());
        for note in error.notes() {
            all += &format!("    {note}\n");
        }
    }
    insta::assert_snapshot!("errors", all);
}

/// What an array of varyings is taken apart into is named as a constant of ours would be.
#[test]
fn names_of_ours_are_told_apart() {
    let vertex = "#version 330
in vec4 p;
out vec2 offset[2];
void main() { offset = vec2[2](p.xy, p.zw); gl_Position = p; }
";
    let fragment = "#version 330
uniform sampler2D map;
in vec2 offset[2];
out vec4 c;
void main() { c = textureOffset(map, offset[0], ivec2(1, 0)) + textureOffset(map, offset[1], \
    ivec2(0, 1)); }
";
    let sources = [
        Source::new("a.vert", vertex),
        Source::new("a.frag", fragment),
    ];
    let parsed = front::parse(&sources, &Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(Color::Never)));
    let text = wgsl(parsed);
    assert_eq!(text.matches("textureSample(").count(), 2, "{text}");
}

/// A function of floats returns one of what it is given of ints too, so that `int(..)` round it is
/// no word too many.
#[test]
fn functions_of_floats_return_floats() {
    let text = given(
        "#version 330
uniform vec2 v;
out vec4 c;
void main() {
    int x = int(mod(v.x, 8));
    int y = int(step(v.y, 1)) + int(pow(2, 3));
    ivec2 z = ivec2(mod(v, 8));
    c = vec4(x, y, z);
}
",
    );
    assert!(
        text.contains("i32(") && !text.contains("i32(i32("),
        "{text}"
    );
}

/// Each stage may be in a file of its own, of which the other stage has nothing.
#[test]
fn stages_lie_in_included_files() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("stages");
    std::fs::create_dir_all(&folder).unwrap();
    let vertex = "#pragma stage vertex
layout(location = 0) in vec4 p;
layout(location = 0) out vec2 at;
void main() { at = p.xy; gl_Position = p; }
";
    let fragment = "#pragma stage fragment
layout(location = 0) in vec2 at;
layout(location = 0) out vec4 c;
void main() { c = vec4(at, LEVEL, 1.0); }
";
    std::fs::write(folder.join("v.h"), vertex).unwrap();
    std::fs::write(folder.join("f.h"), fragment).unwrap();
    let text = "#version 450
#define LEVEL 0.5
#include \"v.h\"
#include \"f.h\"
";
    let options = Options {
        include: vec![folder],
        ..Options::default()
    };
    let parsed = front::parse(&[Source::new("a.slang", text)], &options)
        .unwrap_or_else(|e| panic!("{}", e.render(Color::Never)));
    assert!(parsed.fragment.is_some());
    wgsl(parsed);
}

/// What stands behind an `#include` belongs to the stage that the included file ends in.
#[test]
fn a_stage_goes_on_behind_the_file_that_begins_it() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("stages-go-on");
    std::fs::create_dir_all(&folder).unwrap();
    let base = "#pragma stage vertex
layout(location = 0) in vec4 p;
void main() { gl_Position = p; }
#pragma stage fragment
layout(location = 0) out vec4 c;
void main() {
    vec4 made = vec4(0.25);";
    std::fs::write(folder.join("base.h"), base).unwrap();
    let text = "#version 450
#define LEVEL 0.5
#include \"base.h\"
#undef LEVEL
#define LEVEL 0.75
    c = made + LEVEL;
}
#pragma stage vertex
float more() { return LEVEL; }
";
    let options = Options {
        include: vec![folder],
        ..Options::default()
    };
    let source = [Source::new("a.slang", text)];
    let parsed = front::parse(&source, &options);
    let text = wgsl(parsed.unwrap_or_else(|e| panic!("{}", e.render(Color::Never))));
    assert!(text.contains("0.75f"), "{text}");
}

/// A product that begins with a number is no number: it is read before what the next argument does.
#[test]
fn an_argument_that_begins_with_a_digit_keeps_its_turn() {
    let text = text_of_call(
        "float v[3] = float[3](0.1, 0.2, 0.3); int i = 0; \
         c = vec4(sum(2.0 * float(i), v[i++], 1.0));",
    );
    let held = text
        .find("held = 2f * f32(")
        .unwrap_or_else(|| panic!("{text}"));
    assert!(held < text.find("i = i_value").unwrap(), "{text}");
    // A number stays where it is.
    assert!(text.contains(", 1f)"), "{text}");
}

/// What is lowered to see what it is, and lowered again to be written, does what it does once.
#[test]
fn what_is_looked_at_before_it_is_written_is_done_once() {
    let desktop = |functions: &str, body: &str| {
        given(&format!(
            "#version 330
out vec4 c;
{functions}
void main() {{
    float h[4] = float[4](0.0, 0.0, 0.0, 0.0);
    float v[4] = float[4](0.1, 0.2, 0.3, 0.4);
    int n[4] = int[4](0, 1, 2, 3);
    int i = 0;
    {body}
    c = vec4(h[0] + v[1]);
}}
"
        ))
    };
    let add = "void add(inout float x) { x += 1.0; }";
    let sum = "float sum(inout float x) { x += 1.0; return x; }";
    let es = given(
        "#version 100
precision highp float;
float g(inout float x) { x += 1.0; return x; }
float round(float x) { return floor(x + 0.5); }
void main() {
    float a[3];
    a[0] = 0.0; a[1] = 1.0; a[2] = 2.0;
    int i = 0;
    gl_FragColor = vec4(round(g(a[i++])));
}
",
    );
    let texts = [
        desktop("", "h[n[i++]++] += 1.0;"),
        desktop("", "h[n[i++]++]++;"),
        desktop(add, "for (int j = 0; j < 4; add(v[i++])) { j++; }"),
        desktop(sum, "for (int j = 0; j < 4; sum(v[i++])) { j++; }"),
        desktop(add, "add(h[n[i++]++]);"),
        es,
    ];
    for text in texts {
        assert_eq!(steps(&text), 1, "{text}");
        // Whatever is read of ours was written before.
        for line in text.lines().filter(|l| l.contains("var held")) {
            let name = line.trim().trim_start_matches("var ").split(':').next();
            let name = name.unwrap();
            let read = text.find(&format!("= {name};"));
            let written = text.find(&format!("{name} = "));
            assert!(read.is_none() || written < read, "{name}: {text}");
        }
    }
}

/// A call within a call of the same name, and an assignment in the index of another, are lowered in
/// time that does not double with each level.
#[test]
fn nested_calls_and_assignments_are_lowered_in_time() {
    let rounds = format!("{}x{}", "round(".repeat(50), ")".repeat(50));
    let text = given(&format!(
        "#version 100
precision highp float;
uniform float x;
float round(float x) {{ return floor(x + 0.5); }}
void main() {{ gl_FragColor = vec4({rounds}); }}
"
    ));
    assert_eq!(text.matches("round_(").count(), 51, "{text}");
    let indices = format!("a[{}0{}", "(a[".repeat(40), "] += 1)".repeat(40));
    given(&format!(
        "#version 330
out vec4 c;
void main() {{
    int a[3] = int[3](0, 0, 0);
    {indices}] += 1;
    c = vec4(float(a[0]));
}}
"
    ));
}

/// Variables of ours are numbered, not named by ever more underscores: a thousand are found in no
/// time, in a text that is not all names.
#[test]
fn many_variables_of_ours_are_named_in_time() {
    let body = "v[f()] += 1.0; ".repeat(1000);
    let text = given(&format!(
        "#version 330
out vec4 c;
int at;
int f() {{ at++; return at & 3; }}
void main() {{
    float v[4] = float[4](0.0, 0.0, 0.0, 0.0);
    {body}
    c = vec4(v[0]);
}}
"
    ));
    assert_eq!(text.matches("var held").count(), 1000);
}

/// What `main` does last is of its outputs, whatever locals are called where it returns.
#[test]
fn a_local_does_not_hide_an_output_where_main_ends() {
    let text = given(
        "#version 330
uniform float x;
out vec3 color;
out float parts[2];
void main() {
    color = vec3(1.0);
    parts[0] = 0.5; parts[1] = 0.25;
    float parts = 2.0;
    if (x > 0.0) { vec3 color = vec3(0.0); color.x = parts; return; }
}
",
    );
    let main = text.split("@fragment").nth(1).unwrap();
    insta::assert_snapshot!("locals_beside_outputs", main);
}

/// `layout(row_major) uniform;` is of uniform blocks alone, `layout(std140) buffer;` of storage
/// blocks (4.60, 4.4.5).
#[test]
fn defaults_of_blocks_are_of_their_own_kind() {
    let text = |defaults: &str| {
        given(&format!(
            "#version 430
{defaults}
layout(std140, binding = 0) uniform U {{ mat4 u; }};
layout(binding = 1) buffer B {{ mat4 m; float a[4]; }};
out vec4 c;
void main() {{ c = u[0] + m[0] + vec4(a[1]); }}
"
        ))
    };
    let uniform = text("layout(row_major) uniform;");
    assert_eq!(uniform.matches("transpose(").count(), 1, "{uniform}");
    assert!(uniform.contains("array<f32, 4>"), "{uniform}");
    let buffer = text("layout(row_major) uniform; layout(column_major, std140) buffer;");
    assert_eq!(buffer.matches("transpose(").count(), 1, "{buffer}");
    assert!(buffer.contains("array<vec4<f32>, 4>"), "{buffer}");
}

/// Arrays are bounded by what they hold in all, what is told apart one by one sooner, and no number
/// overflows.
#[test]
fn arrays_are_bounded_by_their_product() {
    let large = [
        "varying float v[1048576][1048576]; void main() { gl_FragColor = vec4(v[0][0]); }",
        "uniform sampler2D s[1024][1024]; void main() { \
         gl_FragColor = texture2D(s[0][0], vec2(0.5)); }",
        "void main() { float a[4096][4]; float b[4096][4]; gl_FragColor = vec4(a == b); }",
        "struct S { float f[1048576]; }; struct T { S s[1048576]; }; varying T t; void main() { \
         gl_FragColor = vec4(t.s[0].f[0]); }",
    ];
    for text in large {
        let (code, told, line) = refused(&format!("#version 430 compatibility\n{text}\n"));
        assert_eq!((code, line), (Code::TooDeep, 2), "{told}");
    }
    // Forty structs, each of two of the one before.
    let mut nested = "#version 120\nstruct S0 { float x; };\n".to_owned();
    for i in 1..40 {
        nested += &format!("struct S{i} {{ S{} a; S{} b; }};\n", i - 1, i - 1);
    }
    nested += "varying S39 s; void main() { gl_FragColor = vec4(1.0); }\n";
    let (code, told, line) = refused(&nested);
    assert_eq!((code, line), (Code::TooDeep, 15), "{told}");
    refused(
        "#version 430\nlayout(location = 4294967295u) out mat4 m; void main() { m = mat4(1.0); }\n",
    );
}

/// Chains whose brackets are closed at once, and commas, nest as deeply as they are long; lists of
/// values do not.
#[test]
fn chains_without_open_brackets_are_bounded() {
    let main = |body: &str| {
        format!("#version 450\nlayout(location = 0) out vec4 c;\nvoid main() {{ {body} }}\n")
    };
    let refused_glsl = |text: String| refused(&text).0;
    let commas = "x,".repeat(100_000);
    for body in [
        format!("float x = 1.0; float y = ({commas}x);"),
        format!("float x = 1.0; {commas}x;"),
        format!("float x = 1.0; {{{{ {commas}x; }}}}"),
        format!("float x = 1.0; if (1.0 > ({commas}x)) {{ }}"),
        format!("float a[1]; c = vec4(a{});", "[0]".repeat(100_000)),
        format!("float a{};", "[1]".repeat(100_000)),
    ] {
        assert_eq!(refused_glsl(main(&body)), Code::TooDeep, "{}", &body[..40]);
    }
    let wgsl = |text: String| front::parse(&[Source::new("a.wgsl", text)], &Options::default());
    let chain = format!(
        "fn f(a: array<f32, 1>) -> f32 {{ return a{}; }}",
        "[0]".repeat(100_000)
    );
    assert_eq!(wgsl(chain).unwrap_err().code(), Code::TooDeep);
    // Tables of thousands, and as many directives.
    let values = "vec2(sin(0.5), 1.0), ".repeat(2_500);
    let table =
        format!("const vec2 t[2501] = vec2[]({values}vec2(0.0)); int i = 0; c = t[i].xyxy;");
    let text = main(&table).replace(
        "void main",
        &("#if defined(A)\n#endif\n".repeat(1_600) + "void main"),
    );
    parse(&text);
    let values = "vec2(sin(0.5), 1.0), ".repeat(2_500);
    let table = format!(
        "const t = array<vec2<f32>, 2500>({values});
@vertex fn v() -> @builtin(position) vec4<f32> {{ return vec4(0.0); }}
@fragment fn f() -> @location(0) vec4<f32> {{ return vec4(t[3], 0.0, 1.0); }}
"
    );
    wgsl(table).unwrap();
}

/// Directives are found however they are spaced, and any number of unknown extensions is passed
/// over.
#[test]
fn directives_exhaust_no_stack() {
    let main = "layout(location = 0) out vec4 c;\nvoid main() { c = vec4(L15 1.0 R15); }\n";
    let doubled = |space: &str, letter: char, bracket: char| -> String {
        let line = |i: usize| match i {
            0 => format!("#{space}define {letter}0 {bracket}\n"),
            i => format!(
                "#{space}define {letter}{i} {letter}{} {letter}{}\n",
                i - 1,
                i - 1
            ),
        };
        (0..16).map(line).collect()
    };
    for space in ["  ", "\t", " /* */ ", "\\\n"] {
        let macros = doubled(space, 'L', '(') + &doubled(space, 'R', ')');
        let (code, told, _) = refused(&format!("#version 450\n{macros}{main}"));
        assert_eq!(code, Code::TooDeep, "{told}");
    }
    let extensions = "#extension GL_A_b : enable\n".repeat(100_000);
    let text = format!("#version 330\n{extensions}out vec4 c;\nvoid main() {{ c = vec4(1.0); }}\n");
    parse(&text);
}

/// A function of the author's that is called like one of ours stays what it is.
#[test]
fn a_function_called_like_a_gather_is_none() {
    let text = wgsl(parse(
        "#version 430
uniform sampler2D map;
out vec4 c;
vec4 gather_sampler_2(vec4 v) { return v * 0.25; }
vec4 gather_sampler2D_0(vec4 v) { return v * 0.5; }
void main() { c = gather_sampler_2(vec4(1.0)) + gather_sampler2D_0(vec4(1.0)) + textureGather(map, \
    vec2(0.5)); }
",
    ));
    assert_eq!(text.matches("textureGather(").count(), 1, "{text}");
    assert!(text.contains("0.25") && text.contains("0.5"), "{text}");
}

/// Macros that each call the next are bounded by how many one word comes through.
#[test]
fn chains_of_macros_are_bounded() {
    let names: String = (0..20_000)
        .map(|i| format!("#define A{i} A{}\n", i + 1))
        .collect();
    let calls: String = (0..20_000)
        .map(|i| format!("#define A{i}(x) A{}(x)\n", i + 1))
        .collect();
    for (macros, call) in [(names, "A0"), (calls, "A0(1.0)")] {
        let (code, told, _) = refused(&format!(
            "#version 330\n{macros}out vec4 c;\nvoid main() {{ c = vec4({call}); }}\n"
        ));
        assert_eq!(code, Code::TooDeep, "{told}");
    }
    let names: String = (0..200)
        .map(|i| format!("#define A{i} A{}\n", i + 1))
        .collect();
    parse(&format!(
        "#version 330\n{names}#define A200 1.0\nout vec4 c;\nvoid main() {{ c = vec4(A0); }}\n"
    ));
}

/// `layout(origin_upper_left)` is said again, where GLSL has it; half pixels are not passed over.
#[test]
fn where_window_coordinates_begin_is_said_again() {
    let text = |layout: &str| {
        format!(
            "#version 150\nlayout({layout}) in vec4 gl_FragCoord;\nout vec4 c;\n\
             void main() {{ c = vec4(gl_FragCoord.y / 600.0); }}\n"
        )
    };
    let emitted = |target: Target| {
        let plan = plan(parse(&text("origin_upper_left")));
        emit::emit(&plan, &[target], &emit::Options::default())
    };
    let files = emitted(Target::Glsl450).unwrap();
    let file = files.iter().find(|f| f.name.ends_with(".frag")).unwrap();
    let written = String::from_utf8(file.bytes.clone()).unwrap();
    let said = written
        .find("layout(origin_upper_left) in vec4 gl_FragCoord;")
        .unwrap();
    assert!(said < written.find("void main").unwrap(), "{written}");
    let error = emitted(Target::GlslEs300).unwrap_err();
    assert!(error.to_string().contains("origin_upper_left"), "{error}");
    // What is read at the pixel's own place of what another pass has drawn would be of another row.
    let plan = plan(parse(&text("origin_upper_left")));
    let recipe = Recipe::parse(["early-discard"]).unwrap();
    let variant = recipe.apply(&plan, &Facts::default()).unwrap();
    let options = emit::Options::default();
    let error = emit::emit(&variant, &[Target::Glsl450], &options).unwrap_err();
    assert!(error.to_string().contains("another pass draws"), "{error}");
    emit::emit(&variant, &[Target::Wgsl], &options).unwrap();
    let (code, told, line) = refused(&text("origin_upper_left, pixel_center_integer"));
    assert_eq!((code, line), (Code::Unsupported, 2), "{told}");
    assert!(told.contains("`pixel_center_integer`"), "{told}");
}

/// A text for Vulkan finds `VULKAN` defined (GL_KHR_vulkan_glsl), and one of which that is not
/// known is told.
#[test]
fn vulkan_is_defined_where_it_is_known() {
    let text = "#version 450
layout(location = 0) out vec4 c;
#ifdef VULKAN
const float x = 0.25;
#else
const float x = 0.75;
#endif
void main() { c = vec4(x, VULKAN_OR_0, 0.0, 1.0); }
";
    let text = |of: &str| text.replace("VULKAN_OR_0", of);
    let read = |text: String, clip_space| {
        let vertex = "#version 450\nvoid main() { gl_Position = vec4(0.0); }\n";
        let sources = [Source::new("a.vert", vertex), Source::new("a.frag", text)];
        let options = Options {
            clip_space,
            ..Options::default()
        };
        front::parse(&sources, &options).unwrap_or_else(|e| panic!("{}", e.render(Color::Never)))
    };
    let vulkan = read(text("float(VULKAN)"), Some(options::ClipSpace::AsWritten));
    assert!(vulkan.program.declared().notes.is_empty());
    let vulkan = wgsl(vulkan);
    assert!(
        vulkan.contains("0.25") && vulkan.contains("100"),
        "{vulkan}"
    );
    let guessed = read(text("0.0"), None);
    let notes = guessed.program.declared().notes.join("\n");
    assert!(notes.contains("`--define VULKAN=100`"), "{notes}");
    assert!(wgsl(guessed).contains("0.75"));
    let opengl = read(text("0.0"), Some(options::ClipSpace::OpenGl));
    assert!(opengl.program.declared().notes.is_empty());
}

/// What WebGPU counts from the other side is told, and only that.
#[test]
fn rows_that_are_counted_from_the_other_side_are_told() {
    let notes = |head: &str, value: &str| {
        let text =
            format!("#version 330\n{head}\nout vec4 c;\nvoid main() {{ c = vec4({value}); }}\n");
        plan(parse(&text)).notes
    };
    assert!(notes("", "gl_FragCoord.x + gl_FragCoord.z").is_empty());
    for value in [
        "gl_FragCoord.y",
        "gl_FragCoord.xyx.x",
        "gl_FragCoord",
        "gl_FragCoord[1]",
    ] {
        let told = notes("", value);
        assert_eq!(told.len(), 1, "{value}");
        assert!(
            told[0].starts_with("`gl_FragCoord.y` counts rows"),
            "{}",
            told[0]
        );
        let upper = "layout(origin_upper_left) in vec4 gl_FragCoord;";
        assert!(notes(upper, value).is_empty(), "{value}");
    }
    let told = notes("", "dFdy(gl_FragCoord.x) + dFdx(1.0)");
    assert!(told.len() == 1 && told[0].starts_with("`dFdy`"), "{told:?}");
}

/// On the desktop too, GLSL's own function is called where none of the author's of that name fits.
#[test]
fn functions_of_the_author_stand_beside_those_of_glsl() {
    let text = given(
        "#version 330
uniform vec3 v;
out vec4 c;
float max(float a, float b, float c) { return max(max(a, b), c); }
void main() { c = vec4(max(v.x, v.y, v.z), max(v.x, 1), max(1, 2, 3), 1.0); }
",
    );
    // The declaration and two calls.
    assert_eq!(text.matches("max_(").count(), 3, "{text}");
}

/// A `defined` that a macro brings asks as one that is written out does.
#[test]
fn a_macro_may_ask_what_is_defined() {
    for (version, out) in [
        ("330", "out vec4 c;"),
        ("300 es", "precision highp float; out vec4 c;"),
    ] {
        let text = given(&format!(
            "#version {version}
#define USE_MAP
#define HAS_MAP defined(USE_MAP)
#define HAS_FOG defined USE_FOG
{out}
void main() {{
#if HAS_MAP && !HAS_FOG
    c = vec4(0.25);
#else
    c = vec4(0.75);
#endif
}}
"
        ));
        assert!(text.contains("0.25f") && !text.contains("0.75f"), "{text}");
    }
}

/// What chooses a sampler is evaluated once, whatever it is: the line of every batch renderer.
#[test]
fn a_sampler_is_chosen_by_any_index() {
    let text = given(
        "#version 330
uniform sampler2D textures[3];
uniform float index;
out vec4 c;
void main() { int i = 0; c = texture(textures[int(index)], vec2(0.5)) + texture(textures[i++], \
    vec2(0.5)); }
",
    );
    assert!(text.contains("held = i32("), "{text}");
    assert_eq!(steps(&text), 1, "{text}");
}

#[test]
fn a_directive_that_glsl_does_not_have_is_no_comment() {
    let with = |line: &str| {
        format!("void main() {{ float sum = 0.5;\n{line}\ngl_FragColor = vec4(sum); }}")
    };
    for line in ["# sum += 1.0;", "#def A 1", "#import <x>", "#3"] {
        let (code, told, at) = refused(&with(line));
        assert_eq!((code, at), (Code::Parse, 2), "{told}");
        assert!(told.contains("unknown directive `#"), "{told}");
    }
    for line in [
        "#",
        "# // nothing",
        "#line 7",
        "#pragma optimize(off)",
        "#if 0\n#def A 1\n#endif",
    ] {
        parse(&with(line));
    }
}

#[test]
fn a_struct_of_which_samplers_alone_are_read_is_declared_whole() {
    let fragment = "#version 330 core
        struct Layer { vec2 scale; sampler2D map; };
        struct Material { sampler2D diffuse; float shininess; Layer layers[2]; };
        uniform Material material;
        uniform Material others[2];
        out vec4 color;
        float unread(Material m) { return m.shininess + m.layers[1].scale.x; }
        void main() { color = texture(material.diffuse, vec2(0.5)) + \
            texture(others[1].layers[1].map, vec2(0.5)); }";
    let vertex = "#version 330 core\nin vec4 p; void main() { gl_Position = p; }";
    let sources = [
        Source::new("a.vert", vertex),
        Source::new("a.frag", fragment),
    ];
    let plan = plan(front::parse(&sources, &Options::default()).unwrap());
    for target in [Target::Glsl450, Target::GlslEs300] {
        let files = emit::emit(&plan, &[target], &emit::Options::default()).unwrap();
        let text = files.iter().find(|f| f.name.ends_with(".frag")).unwrap();
        let text = String::from_utf8_lossy(&text.bytes);
        assert!(
            text.contains("float shininess;") && text.contains("vec2 scale;"),
            "{text}"
        );
        assert!(
            text.contains(" material;") && text.contains(" others[2];"),
            "{text}"
        );
    }
}

/// Lengths may come of any constant expression: of floats, vectors, conversions and other arrays'
/// lengths, told from what hides them.
#[test]
fn lengths_come_of_every_kind_of_constant() {
    let text = given(
        "#version 330
const float F = 3; const ivec2 S = ivec2(vec2(4.7, 5.0)); const uint U = 2u; \
    const vec3 V = vec3(2.0) * S.xyx;
float table[7];
out vec4 c;
void main() {
    float a[int(F)], b[S.y], d[U + 1u], e[int(V[1]) - 2], f[-S.x + 10];
    const int n = table.length();
    float g[n * 2];
    { float table[2]; float h[table.length()]; const float F = 11.0; float k[int(F) + 1]; \
        c = vec4(h[1], k[3], 0.0, 0.0); }
    c += vec4(a[0] + b[0], d[0] + e[0], f[0], g[0] + table[6]);
}
",
    );
    for declared in [
        "var a: array<f32, 3>",
        "var b: array<f32, 5>",
        "var d: array<f32, 3>",
        "var e: array<f32, 8>",
        "var f: array<f32, 6>",
        "var g: array<f32, 14>",
        "var h: array<f32, 2>",
        "var k: array<f32, 12>",
    ] {
        assert!(text.contains(declared), "{declared}: {text}");
    }
    let (code, told, line) = refused(
        "#version 330\nconst int n = 2;\nout vec4 c;\nvoid f(int n) {\n float a[n]; }\n\
         void main() { f(1); c = vec4(1.0); }\n",
    );
    assert_eq!((code, line), (Code::Unsupported, 5), "{told}");
}

/// An offset is what its constants come to, and a name of ours that both stages' unnamed structs
/// share says what they hold.
#[test]
fn offsets_and_unnamed_structs_are_told_by_what_they_hold() {
    let text = given(
        "#version 400
uniform sampler2D map;
const ivec2 STEP = ivec2(1, -2);
out vec4 c;
void main() {
    const int i = 3;
    c = textureOffset(map, vec2(0.5), ivec2(i, 0)) + textureOffset(map, vec2(0.5), STEP * 2 + 1) + \
        textureGather(map, vec2(0.5), i - 1);
}
",
    );
    for literal in ["vec2<i32>(3i, 0i)", "vec2<i32>(3i, -3i)"] {
        assert!(text.contains(literal), "{literal}: {text}");
    }

    let sources = [
        Source::new(
            "a.vert",
            "#version 330\nuniform struct { mat4 view; } camera;\nin vec4 p;\n\
             void main() { gl_Position = camera.view * p; }\n",
        ),
        Source::new(
            "a.frag",
            "#version 330\nuniform struct { vec3 color; float amount; } light;\n\
             uniform struct { float amount; } fog;\nout vec4 c;\n\
             void main() { c = vec4(light.color * light.amount, fog.amount); }\n",
        ),
    ];
    wgsl(
        front::parse(&sources, &Options::default())
            .unwrap_or_else(|e| panic!("{}", e.render(Color::Never))),
    );
}

/// What stands behind a jump is left out, and still has to be right.
#[test]
fn what_is_not_reached_is_left_out() {
    let text = given(
        "#version 330
out vec4 c;
uniform int n;
float f(float x) { { return x * 2.0; } return 1.0; }
void main() {
    c = vec4(0.25);
    switch (n) { case 0: { c.x = f(0.5); break; } c = vec4(0.125); int k; case 1: k = 1; \
        c.y = float(k); }
    if (n > 3) { discard; c.x = f(3.0); }
    { return; }
    c = vec4(f(0.75));
}
",
    );
    for gone in ["0.125f", "3f", "0.75f"] {
        assert!(!text.contains(gone), "{gone}: {text}");
    }
    assert!(
        text.contains("f(0.5f)") && text.contains("var k: i32;"),
        "{text}"
    );
    let (code, told, line) = refused(
        "#version 330\nout vec4 c;\nvoid main() { c = vec4(1.0); return;\n c = vec2(1.0); }\n",
    );
    assert_eq!((code, line), (Code::Parse, 4), "{told}");
}

/// WGSL goes on behind a `discard`, so that a function whose end it is needs a result there.
#[test]
fn a_function_that_ends_in_a_discard_returns() {
    for fragment in [
        "varying vec2 uv; void main() { if (uv.x > 0.5) { gl_FragColor = vec4(1.0); \
         return; } discard; }",
        "varying vec2 uv; float f(float x) { if (x > 0.5) return x; discard; \
         return 1.0; } void main() { gl_FragColor = vec4(f(uv.x)); }",
        "varying vec2 uv; float f(float x) { if (x > 0.5) { return x; } else { \
         discard; } } void main() { gl_FragColor = vec4(f(uv.x)); }",
        "varying vec2 uv; float f(float x) { for (int i = 0; i < 4; i++) { if (x > 0.5) return x; \
         x += 0.1; } discard; } void main() { gl_FragColor = vec4(f(uv.x)); }",
    ] {
        let vertex =
            "attribute vec4 p; varying vec2 uv; void main() { uv = p.xy; gl_Position = p; }";
        let sources = [
            Source::new("a.vert", vertex),
            Source::new("a.frag", fragment),
        ];
        let plan = plan(front::parse(&sources, &Options::default()).unwrap());
        for target in [Target::Wgsl, Target::Glsl450] {
            let files = emit::emit(&plan, &[target], &emit::Options::default()).unwrap();
            let text = files
                .iter()
                .map(|f| String::from_utf8_lossy(&f.bytes))
                .collect::<String>();
            let (_, behind) = text.split_once("discard;").unwrap();
            // In the same function.
            let behind = behind.split("\n}").next().unwrap_or_default();
            assert!(behind.contains("return"), "{text}");
        }
    }
}

#[test]
fn what_a_switch_declares_behind_a_jump_has_no_first_value() {
    let text = given(
        "#version 330
uniform int n;
out vec4 c;
float next() { return 0.25; }
void main() {
    c = vec4(0.0);
    switch (n) { case 0: c.x = 1.0; break; float j = next(), k; case 1: j = 2.0; k = j; \
        c.y = j + k; }
}
",
    );
    assert!(
        text.contains("var j: f32;") && !text.contains("next()"),
        "{text}"
    );
}

/// WGSL has no constant infinity, so the GPU divides.
#[test]
fn a_literal_divided_by_zero_is_divided_on_the_gpu() {
    let body = |value: &str| {
        format!(
            "precision highp float; uniform float x;
void main() {{ gl_FragColor = vec4(x > 2.0 ? {value} : x); }}"
        )
    };
    for value in ["1.0 / 0.0", "-1.0 / 0.0", "0.0 / 0.0", "1.0 / (2.0 - 2.0)"] {
        let text = wgsl(parse(&body(value)));
        assert!(
            text.contains("1f / held") || text.contains("0f / held"),
            "{value}: {text}"
        );
    }
    let text = wgsl(parse(&body("1.0 / 2.0")));
    assert!(text.contains("0.5f"), "{text}");
}

/// The index of an output says something only if another output has index 1.
#[test]
fn an_output_of_index_0_alone_is_an_output() {
    let text = |layout: &str| {
        format!(
            "#version 440
layout(std430, binding = 0) buffer B {{ uint n; }} b;
layout({layout}) out vec4 c;
void main() {{ c = vec4(atomicAdd(b.n, 1u)); }}
"
        )
    };
    assert_eq!(
        given(&text("location = 0, index = 0")),
        given(&text("location = 0"))
    );
    let (code, told, _) = refused(&text("location = 0, index = 1"));
    assert_eq!(code, Code::Invalid, "{told}");
    assert!(told.contains("two sources"), "{told}");
}

#[test]
fn samplers_read_no_integers() {
    let text = |call: &str| {
        format!(
            "#version 400
uniform usampler2D map;
out uvec4 c;
void main() {{
    c = {call};
}}
"
        )
    };
    for function in ["texture", "textureLod"] {
        let level = if function == "texture" { "" } else { ", 0.0" };
        let (code, told, line) = refused(&text(&format!("{function}(map, vec2(0.5){level})")));
        assert_eq!((code, line), (Code::Unsupported, 5), "{told}");
        let says = format!("`{function}` of `usampler2D` is not supported: WebGPU's samplers");
        assert!(
            told.contains(&says) && told.contains("`texelFetch`"),
            "{told}"
        );
    }
    parse(&text(
        "texelFetch(map, textureSize(map, 0) / 2, 0) + textureGather(map, vec2(0.5))",
    ));
}

#[test]
fn extensions_add_words() {
    let block = "layout(std430, binding = 0) readonly buffer B { vec4 all[]; } b;";
    let blocks = "#extension GL_ARB_shader_storage_buffer_object";
    let text = |extension: &str, declared: &str, value: &str| {
        format!(
            "#version 330\n{extension}\n{declared}\nout vec4 c;\nvoid main() {{ c = vec4({value}); }}\n"
        )
    };
    for behaviour in ["require", "enable"] {
        let extension = format!("{blocks} : {behaviour}");
        let wgsl = wgsl(parse(&text(&extension, block, "b.all[1]")));
        assert!(wgsl.contains("var<storage> b"), "{wgsl}");
    }
    for extension in ["", &format!("{blocks} : disable")] {
        parse(&text(extension, "float buffer = 1.0;", "buffer"));
    }
    let images = "#extension GL_ARB_shader_image_load_store : enable";
    let image = "layout(binding = 0, rgba8) uniform readonly image2D i;";
    parse(&text(images, image, "imageLoad(i, ivec2(0))"));
}

#[test]
fn arrays_of_images_and_subroutines_are_refused_at_their_line() {
    let with = |version: &str, declared: &str| {
        refused(&format!(
            "#version {version}\nout vec4 c;\n{declared}\nvoid main() {{ c = vec4(1.0); }}\n"
        ))
    };
    for array in [
        "layout(binding = 0, rgba8) uniform image2D t[3];",
        "layout(binding = 0) uniform writeonly image2D t[2][2];",
    ] {
        let (code, told, line) = with("430", array);
        assert_eq!((code, line), (Code::Unsupported, 3), "{told}");
        assert!(
            told.contains("arrays of images are not supported"),
            "{told}"
        );
    }
    let extension = "330\n#extension GL_ARB_shader_subroutine : require";
    for (version, declared, at) in [
        ("400", "subroutine vec4 Shade(vec2 p);", 3),
        (
            "400",
            "subroutine(Shade) vec4 red(vec2 p) { return p.xyxy; }",
            3,
        ),
        ("460", "subroutine uniform Shade shade;", 3),
        (extension, "subroutine vec4 Shade(vec2 p);", 4),
    ] {
        let (code, told, line) = with(version, declared);
        assert_eq!((code, line), (Code::Unsupported, at), "{told}");
        assert!(told.contains("`subroutine` is not supported"), "{told}");
    }
    parse(
        "#version 330\nout vec4 c;\nvoid main() { float subroutine = 1.0; c = vec4(subroutine); }\n",
    );
}

#[test]
fn a_gather_may_have_an_offset() {
    let text = |declared: &str, call: &str| {
        format!("#version 400\n{declared}\nout vec4 c;\nvoid main() {{\n    c = {call};\n}}\n")
    };
    let map = "uniform sampler2D map; const ivec2 STEP = ivec2(1, -2);";
    let shadow = "uniform sampler2DShadow map;";
    for (declared, call, says) in [
        (
            map,
            "textureGatherOffset(map, vec2(0.5), STEP * 2, 2)",
            "textureGather(2, t, s, p, vec2<i32>(2i, -4i))",
        ),
        (
            map,
            "textureGatherOffset(map, vec2(0.5), ivec2(7, -8))",
            "textureGather(0, t, s, p, vec2<i32>(7i, -8i))",
        ),
        (
            shadow,
            "textureGatherOffset(map, vec2(0.5), 0.25, ivec2(0, 1))",
            "textureGatherCompare(t, s, p, depth, vec2<i32>(0i, 1i))",
        ),
    ] {
        let plan = plan(parse(&text(declared, call)));
        let targets = [Target::Wgsl, Target::Spirv, Target::Glsl450];
        let files = emit::emit(&plan, &targets, &emit::Options::default()).unwrap();
        let wgsl = files.iter().find(|f| f.name.ends_with(".wgsl")).unwrap();
        let wgsl = String::from_utf8_lossy(&wgsl.bytes);
        assert!(wgsl.contains(says), "{says}\n{wgsl}");
    }
    for (declared, call, says) in [
        (
            map,
            "textureGatherOffset(map, vec2(0.5), ivec2(gl_FragCoord.xy))",
            "must be constant, from -8 to 7",
        ),
        (
            map,
            "textureGatherOffset(map, vec2(0.5), ivec2(0, 8))",
            "must be constant, from -8 to 7",
        ),
        (
            "uniform sampler2DArray map;",
            "textureGatherOffset(map, vec3(0.5), ivec2(1))",
            "of `sampler2DArray` is not supported",
        ),
    ] {
        let (code, told, line) = refused(&text(declared, call));
        assert_eq!((code, line), (Code::Unsupported, 5), "{told}");
        assert!(told.contains(says), "{told}");
    }
}

/// Without derivatives the base level is sampled (4.60, 8.9), of a cube that compares too.
#[test]
fn a_vertex_stage_compares_at_the_base_level() {
    for (sampler, arguments) in [
        ("samplerCubeShadow", "p"),
        ("samplerCubeArrayShadow", "p, 0.5"),
        ("sampler2DArrayShadow", "p"),
    ] {
        let vertex = format!(
            "#version 400
in vec4 p;
uniform {sampler} map;
void main() {{ gl_Position = p * texture(map, {arguments}); }}
"
        );
        let sources = [
            Source::new("a.vert", vertex),
            Source::new(
                "a.frag",
                "#version 400\nout vec4 c;\nvoid main() { c = vec4(1.0); }",
            ),
        ];
        let parsed = front::parse(&sources, &Options::default())
            .unwrap_or_else(|e| panic!("{sampler}: {}", e.render(Color::Never)));
        let text = wgsl(parsed);
        assert!(text.contains("textureSampleCompareLevel(map, "), "{text}");
    }
}

/// GLSL 4.60, 7.6.2.2 of OpenGL 4.6: an array's elements are aligned to 16 bytes, and no more.
#[test]
fn doubles_lie_as_std140_has_it() {
    let text = "#version 430
layout(std140, binding = 0) uniform B { double d[3]; dvec2 e[2]; dvec3 g; float z; dmat2 m; } b;
out vec4 c;
void main() {
    double d[3] = b.d;
    c = vec4(float(d[1] + b.d[2] + b.e[1].y + b.g.z + b.m[1].y), b.z, 0.0, 1.0);
}
";
    let parsed = parse(text);
    let module = parsed.program.module();
    let members = module.types.iter().find_map(|(_, ty)| match &ty.inner {
        naga::TypeInner::Struct { members, .. } => {
            let is_block = members.iter().any(|m| m.name.as_deref() == Some("z"));
            is_block.then_some(members)
        }
        _ => None,
    });
    let stride = |ty| match module.types[ty].inner {
        naga::TypeInner::Array { stride, .. } => stride,
        _ => 0,
    };
    let found = members.unwrap().iter();
    let found: Vec<(u32, u32)> = found.map(|m| (m.offset, stride(m.ty))).collect();
    assert_eq!(found, [(0, 16), (48, 16), (96, 0), (120, 0), (128, 0)]);
}

/// A struct with padded elements that also travels between the stages.
#[test]
fn a_padded_struct_may_be_a_varying() {
    let declared = "#version 430
struct S { vec2 k[2]; mat2 m; float w[2]; };
layout(std140, binding = 0) uniform B { S s; } b;
";
    let vertex = format!(
        "{declared}in vec4 p; layout(location = 0) out S v; void main() {{ v = b.s; v.k[1] = p.xy; gl_Position = p; }}"
    );
    let fragment = format!(
        "{declared}layout(location = 0) in S v; out vec4 c; void main() {{ S t = v; c = vec4(t.k[1], v.m[1].y + t.w[1], float(t == b.s)); }}"
    );
    let sources = [
        Source::new("a.vert", vertex),
        Source::new("a.frag", fragment),
    ];
    let parsed = front::parse(&sources, &Options::default())
        .unwrap_or_else(|e| panic!("{}", e.render(Color::Never)));
    let text = wgsl(parsed);
    assert!(
        text.contains("v_k_1_: vec2<f32>") || text.contains("v_k_1: vec2<f32>"),
        "{text}"
    );
}
