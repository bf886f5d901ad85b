//! Text to program: what is read, how two files become one, and how every bad input is told.

use std::time::{Duration, Instant};

use preshade_compiler::front::{self, Parsed, Source};
use shader_text::error::{Code, Color, Error};
use shader_text::options::Options;
use shader_text::source::Language;

const VERTEX: &str = r"
struct Camera { view_proj: mat4x4<f32>, eye: vec3<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
const SCALE: f32 = 2.0;
fn remap(x: f32) -> f32 { return x * 0.5 + 0.5; }
struct Varyings { @builtin(position) clip: vec4<f32>, @location(0) uv: vec2<f32> }
@vertex
fn main(@location(0) position: vec3<f32>) -> Varyings {
    return Varyings(camera.view_proj * vec4(position * SCALE, remap(1.0)), position.xy);
}
";

const FRAGMENT: &str = r"
struct View { matrix: mat4x4<f32>, eye: vec3<f32> }
@group(0) @binding(0) var<uniform> view: View;
@group(1) @binding(0) var t: texture_2d<f32>;
const SCALE: f32 = 3.0;
fn remap(x: f32) -> f32 { return x * 0.5 + 0.5; }
fn fade(v: View, x: f32) -> f32 { return remap(x) * SCALE * v.eye.x; }
@fragment
fn main(@location(0) uv: vec2<f32>) -> @location(0) vec4<f32> {
    return vec4(fade(view, uv.x));
}
";

fn parse(sources: &[(&str, &str)]) -> Result<Parsed, Error> {
    parse_with(sources, &Options::default())
}

fn parse_with(sources: &[(&str, &str)], options: &Options) -> Result<Parsed, Error> {
    let sources: Vec<Source> = sources.iter().map(|(n, t)| Source::new(*n, *t)).collect();
    front::parse(&sources, options)
}

/// The rendered error, and that it is of this kind.
fn refused(code: Code, sources: &[(&str, &str)]) -> String {
    refused_with(code, sources, &Options::default())
}

fn refused_with(code: Code, sources: &[(&str, &str)], options: &Options) -> String {
    let error = parse_with(sources, options).unwrap_err();
    assert_eq!(error.code(), code, "{}", error.render(Color::Never));
    error.render(Color::Never)
}

fn material(fragment: &str) -> String {
    format!(
        "@vertex fn vs() -> @builtin(position) vec4<f32> {{ return vec4(0.0); }}\n\
         @fragment fn fs() -> @location(0) vec4<f32> {{\n{fragment}\n}}\n"
    )
}

#[test]
fn two_files_become_one_module() {
    let parsed = parse(&[("a.wgsl", VERTEX), ("b.wgsl", FRAGMENT)]).unwrap();
    assert_eq!(parsed.vertex, "main");
    assert_eq!(parsed.fragment.as_deref(), Some("main_fragment"));
    let module = parsed.program.module();
    // One uniform, though the files name its struct differently.
    let globals: Vec<_> = module
        .global_variables
        .iter()
        .map(|(_, g)| g.name.clone().unwrap())
        .collect();
    assert_eq!(globals, ["camera", "t"]);
    // `remap` is the same in both, `SCALE` is not.
    let functions: Vec<_> = module
        .functions
        .iter()
        .map(|(_, f)| f.name.clone().unwrap())
        .collect();
    assert_eq!(functions, ["remap", "fade"]);
    assert_eq!(module.constants.len(), 2);
    // Spans of the second file's items name the second file.
    let (fade, _) = module.functions.iter().nth(1).unwrap();
    let at = parsed
        .program
        .sources()
        .locate(module.functions.get_span(fade))
        .unwrap();
    assert_eq!((at.file.as_str(), at.line), ("b.wgsl", 7));
}

/// What an expression's span says is in the text it was written in, in whichever file.
#[test]
fn expressions_of_the_second_file_are_found_in_it() {
    let written = |sources: &[(&str, &str)], text: &str| {
        let parsed = parse(sources).unwrap();
        let program = &parsed.program;
        let (_, entry) = program
            .entry_point(
                naga::ShaderStage::Fragment,
                parsed.fragment.as_deref().unwrap(),
            )
            .unwrap();
        let functions = program.module().functions.iter().map(|(_, f)| f);
        let found = functions.chain([&entry.function]).any(|f| {
            f.expressions.iter().any(|(e, _)| {
                let at = program.sources().locate(f.expressions.get_span(e));
                at.is_some_and(|at| {
                    let range = at.range.start as usize..at.range.end as usize;
                    at.file == sources[1].0 && sources[1].1.get(range) == Some(text)
                })
            })
        });
        assert!(found, "`{text}` is nowhere in the second file");
    };
    written(
        &[("a.wgsl", VERTEX), ("b.wgsl", FRAGMENT)],
        "remap(x) * SCALE",
    );
    let vertex =
        "#version 450\nlayout(location = 0) in vec4 p;\nvoid main() { gl_Position = p; }\n";
    let fragment = "#version 450\nlayout(location = 0) out vec4 color;\n\
        void main() { float shade = sin(0.25) * gl_FragCoord.x; color = vec4(cos(shade)); }\n";
    written(&[("a.vert", vertex), ("b.frag", fragment)], "shade");
}

#[test]
fn the_order_of_the_files_does_not_matter() {
    let parsed = parse(&[("b.wgsl", FRAGMENT), ("a.wgsl", VERTEX)]).unwrap();
    assert_eq!(parsed.vertex, "main_vertex");
    assert_eq!(parsed.fragment.as_deref(), Some("main"));
}

#[test]
fn a_glsl_pair_becomes_one_module() {
    let vertex = "#version 450
layout(location = 0) in vec3 position;
layout(location = 0) out vec2 uv;
layout(set = 0, binding = 0) uniform Camera { mat4 view_proj; } camera;
void main() { uv = position.xy; gl_Position = camera.view_proj * vec4(position, 1.0); }
";
    let fragment = "#version 450
layout(location = 0) in vec2 uv;
layout(location = 0) out vec4 color;
layout(set = 1, binding = 0) uniform texture2D albedo;
layout(set = 1, binding = 1) uniform sampler filtering;
void main() {
    vec4 texel = texture(sampler2D(albedo, filtering), uv);
    if (texel.a < CUTOFF) discard;
    color = texel;
}
";
    let options = Options {
        defines: vec![("CUTOFF".to_owned(), "0.5".to_owned())],
        ..Options::default()
    };
    let parsed = parse_with(&[("m.vert", vertex), ("m.frag", fragment)], &options).unwrap();
    assert_eq!(parsed.program.language(), Language::Glsl);
    assert_eq!(parsed.vertex, "vertex_main");
    assert_eq!(parsed.fragment.as_deref(), Some("fragment_main"));
    // The author's name is accepted too.
    let named = Options {
        vertex: Some("main".to_owned()),
        ..options
    };
    assert!(parse_with(&[("m.vert", vertex), ("m.frag", fragment)], &named).is_ok());
}

#[test]
fn a_depth_only_material_has_no_fragment_stage() {
    let text = "@vertex fn vs() -> @builtin(position) vec4<f32> { return vec4(0.0); }";
    assert_eq!(parse(&[("a.wgsl", text)]).unwrap().fragment, None);
}

#[test]
fn empty_files_are_refused() {
    insta::assert_snapshot!(refused(
        Code::Empty,
        &[("a.wgsl", "// nothing\n/* at all */\n")]
    ));
    refused(Code::Empty, &[]);
}

#[test]
fn what_cannot_be_told_is_asked_for() {
    insta::assert_snapshot!(
        "unknown_language",
        refused(Code::UnknownLanguage, &[("<stdin>", "fn f() {}")])
    );
    let source = Source::new("<stdin>", "void main() {}").with_language(Language::Glsl);
    let error = front::parse(&[source], &Options::default()).unwrap_err();
    assert_eq!(error.code(), Code::UnknownStage);
    insta::assert_snapshot!("unknown_stage", error.render(Color::Never));
}

#[test]
fn two_files_of_one_stage_are_refused() {
    insta::assert_snapshot!(refused(
        Code::Sources,
        &[("a.frag", "void main() {}"), ("b.frag", "void main() {}")]
    ));
}

#[test]
fn two_languages_are_refused() {
    insta::assert_snapshot!(refused(
        Code::Sources,
        &[("a.vert", "void main() {}"), ("b.wgsl", FRAGMENT)]
    ));
}

#[test]
fn a_syntax_error_is_framed() {
    insta::assert_snapshot!(refused(
        Code::Parse,
        &[("a.wgsl", &material("    let x = 1.0 +;"))]
    ));
}

#[test]
fn an_error_in_the_second_file_names_it() {
    insta::assert_snapshot!(refused(
        Code::Parse,
        &[
            ("a.wgsl", VERTEX),
            (
                "b.wgsl",
                "@fragment\nfn fs() -> @location(0) vec4<f32> {\n    return colour;\n}\n"
            )
        ]
    ));
}

#[test]
fn an_invalid_module_is_framed() {
    insta::assert_snapshot!(refused(
        Code::Invalid,
        &[("a.wgsl", &material("    let x = 1.0;"))]
    ));
}

#[test]
fn a_glsl_error_is_framed_where_the_author_wrote_it() {
    insta::assert_snapshot!(refused(
        Code::Parse,
        &[(
            "a.frag",
            "#version 450\nuniform sampler2D t;\nvoid main() {\n    vec2 uv = vec2(0.0)\n    \
             gl_FragDepth = texture(t, uv).r;\n}\n"
        )]
    ));
    insta::assert_snapshot!(
        "glsl_es",
        refused(
            Code::Unsupported,
            &[(
                "a.frag",
                "precision mediump float;\n#define AT gl_PointCoord\n\
                 void main() {\n    gl_FragColor = vec4(AT, 0.0, 1.0);\n}\n"
            )]
        )
    );
}

#[test]
fn a_missing_entry_point_is_told() {
    insta::assert_snapshot!(refused(Code::NoEntryPoint, &[("a.wgsl", FRAGMENT)]));
}

#[test]
fn two_fragment_entry_points_need_a_choice() {
    let text = format!(
        "{}@fragment fn other() {{}}\n",
        material("return vec4(0.0);")
    );
    insta::assert_snapshot!(refused(Code::AmbiguousEntryPoint, &[("a.wgsl", &text)]));
    let options = Options {
        fragment: Some("other".to_owned()),
        ..Options::default()
    };
    let parsed = parse_with(&[("a.wgsl", &text)], &options).unwrap();
    assert_eq!(parsed.fragment.as_deref(), Some("other"));
}

#[test]
fn a_misspelt_entry_point_is_guessed() {
    let options = Options {
        fragment: Some("sf".to_owned()),
        ..Options::default()
    };
    insta::assert_snapshot!(refused_with(
        Code::UnknownEntryPoint,
        &[("a.wgsl", &material("return vec4(0.0);"))],
        &options
    ));
}

#[test]
fn one_binding_with_two_types_is_refused() {
    let other = FRAGMENT.replace(
        "struct View { matrix: mat4x4<f32>, eye: vec3<f32> }",
        "struct View { eye: vec3<f32> }",
    );
    insta::assert_snapshot!(refused(
        Code::Link,
        &[("a.wgsl", VERTEX), ("b.wgsl", &other)]
    ));
}

/// A `cbuffer` of HLSL may hold all its members in one struct, of which each stage declares a part.
#[test]
fn the_longer_struct_in_a_block_holds_for_both_stages() {
    let block = |more: &str| {
        format!(
            "struct Inner {{ m: mat4x4f, {more} }} struct Block {{ all: Inner }}
             @group(0) @binding(0) var<uniform> u: Block;"
        )
    };
    let [short, long] = ["", "tint: vec4f"].map(block);
    let vertex =
        "@vertex fn vs(@location(0) p: vec4f) -> @builtin(position) vec4f { return u.all.m * p; }";
    let fragment =
        |value: &str| format!("@fragment fn fs() -> @location(0) vec4f {{ return {value}; }}");
    for (a, b, value) in [(&short, &long, "u.all.tint"), (&long, &short, "u.all.m[0]")] {
        let (vertex, fragment) = (format!("{a} {vertex}"), format!("{b} {}", fragment(value)));
        let parsed = parse(&[("v.wgsl", &vertex), ("f.wgsl", &fragment)]).unwrap();
        let module = parsed.program.module();
        assert_eq!(module.global_variables.len(), 1);
        let (_, block) = module.global_variables.iter().next().unwrap();
        assert_eq!(module.types[block.ty].inner.size(module.to_ctx()), 80);
    }
}

#[test]
fn stages_that_do_not_fit_are_refused() {
    let other = |with: &str| FRAGMENT.replace("@location(0) uv: vec2<f32>", with);
    insta::assert_snapshot!(
        "interface_location",
        refused(
            Code::Interface,
            &[
                ("a.wgsl", VERTEX),
                ("b.wgsl", &other("@location(3) uv: vec2<f32>"))
            ]
        )
    );
    insta::assert_snapshot!(
        "interface_type",
        refused(
            Code::Interface,
            &[
                ("a.wgsl", VERTEX),
                ("b.wgsl", &other("@location(0) uv: vec4<f32>"))
            ]
        )
    );
    insta::assert_snapshot!(
        "interface_interpolation",
        refused(
            Code::Interface,
            &[
                ("a.wgsl", VERTEX),
                (
                    "b.wgsl",
                    &other("@location(0) @interpolate(linear) uv: vec2<f32>")
                )
            ]
        )
    );
}

/// Varyings in structs and in declarations of their own, in either language: the member is shown,
/// on both sides.
#[test]
fn a_varying_that_does_not_fit_is_shown_where_it_is_declared() {
    let text = material("    return vec4(1.0);");
    let one = text.replace(
        "@fragment",
        "struct Wanted {\n    // at @location(1): no\n    @builtin(front_facing) front: bool,\n    \
         @location(1) far: vec3<f32>,\n}\n@fragment",
    );
    let one = one.replacen("fn fs()", "fn fs(wanted: Wanted)", 1);
    insta::assert_snapshot!(
        "interface_struct",
        refused(Code::Interface, &[("a.wgsl", &one)])
    );
    let vertex = "#version 450\nlayout(location = 0) in vec3 position;\n\
                  layout(location = 0) out vec2 uv; // the\nlayout(location = 1) out vec4 tint;\n\
                  void main() {\n    uv = position.xy;\n    tint = vec4(1.0);\n    gl_Position = \
                  vec4(position, 1.0);\n}\n";
    let fragment = "#version 450\nlayout(location = 0) in vec2 uv;\n\
                    /* layout(location = 1) in vec2 no; */\nlayout(location = 1) in vec3 tint;\n\
                    layout(location = 0) out vec4 color;\nvoid main() {\n    color = vec4(tint, \
                    uv.x);\n}\n";
    insta::assert_snapshot!(
        "interface_glsl",
        refused(Code::Interface, &[("a.vert", vertex), ("a.frag", fragment)])
    );
}

/// The member that differs, in a struct within the struct.
#[test]
fn one_binding_with_two_layouts_shows_the_members() {
    let frame = |member: &str, stage: &str| {
        format!(
            "struct Lens {{ near: f32, {member} }}\nstruct Frame {{\n    view_proj: \
             mat4x4<f32>,\n    lens: Lens,\n}}\n\
             @group(0) @binding(0) var<uniform> frame: Frame;\n{stage}\n"
        )
    };
    let vertex = frame(
        "far: f32",
        "@vertex fn vs() -> @builtin(position) vec4<f32> { return frame.view_proj[0]; }",
    );
    let fragment = frame(
        "/* far: f32 */ far: vec2<f32>",
        "@fragment fn fs() -> @location(0) vec4<f32> { return vec4(frame.lens.far, 0.0, 1.0); }",
    );
    let error = refused(Code::Link, &[("a.wgsl", &vertex), ("b.wgsl", &fragment)]);
    insta::assert_snapshot!(error);
}

#[test]
fn what_would_exhaust_the_stack_is_refused_quickly() {
    let n = 100_000;
    let glsl = |body: &str| {
        format!("#version 450\nlayout(location=0) out vec4 c;\nvoid main() {{ {body} }}\n")
    };
    let cases = [
        (
            "a.wgsl",
            material(&format!(
                "return vec4({}1.0{});",
                "(".repeat(n),
                ")".repeat(n)
            )),
        ),
        (
            "a.wgsl",
            material(&format!("return vec4(1.0{});", " + 1.0".repeat(n))),
        ),
        (
            "a.wgsl",
            material(&format!("let b = {}true; return vec4(0.0);", "!".repeat(n))),
        ),
        (
            "a.wgsl",
            material(&format!("{}{}", "{".repeat(n), "}".repeat(n))),
        ),
        (
            "a.wgsl",
            material(&format!("if false {{}} {}", "else if false {}".repeat(n))),
        ),
        (
            "a.wgsl",
            format!(
                "fn f() -> array<{}i32{}> {{}}",
                "array<".repeat(n),
                ",1>".repeat(n)
            ),
        ),
        (
            "a.frag",
            glsl(&format!("c = vec4({}1.0{});", "(".repeat(n), ")".repeat(n))),
        ),
        ("a.frag", glsl(&format!("c = vec4({}1.0);", "- ".repeat(n)))),
        (
            "a.frag",
            glsl(&format!(
                "if (false) {{}} {}",
                "else if (false) {}".repeat(n)
            )),
        ),
        (
            "a.frag",
            glsl(&format!("{} c = vec4(0.0);", "if (true) ".repeat(n))),
        ),
        (
            "a.frag",
            glsl(&format!("c = {} vec4(0.0);", "c = ".repeat(n))),
        ),
    ];
    for (i, (name, text)) in cases.iter().enumerate() {
        let start = Instant::now();
        let error = parse(&[(name, text)]).unwrap_err();
        assert_eq!(error.code(), Code::TooDeep, "case {i}: {}", error.message());
        // Not a timing assertion: a bound that only a hang or a quadratic blow-up breaks.
        assert!(start.elapsed() < Duration::from_secs(10), "case {i}");
    }
    insta::assert_snapshot!(refused(
        Code::TooDeep,
        &[(
            "a.wgsl",
            &material(&format!(
                "let x = {}1.0{};",
                "(".repeat(200),
                ")".repeat(200)
            ))
        )]
    ));
}

#[test]
fn colours_are_an_option() {
    let error = parse(&[("a.wgsl", "fn f( {}")]).unwrap_err();
    assert!(error.render(Color::Always).contains('\u{1b}'));
    assert!(!error.render(Color::Never).contains('\u{1b}'));
}

#[test]
fn the_terminal_is_not_driven_by_the_source() {
    let error = parse(&[("a\u{1b}[2J.wgsl", "fn f( \u{1b}[31m {}")]).unwrap_err();
    assert!(!error.render(Color::Never).contains('\u{1b}'));
}

#[test]
fn a_byte_order_mark_is_no_part_of_the_text() {
    let text = format!("\u{feff}{}", material("    return vec4(nothing);"));
    let error = parse(&[("a.wgsl", &text)]).unwrap_err();
    let at = error.location().unwrap();
    assert_eq!((at.line, at.column), (3, 17));
    let text = format!("\u{feff}{}", material("    return vec4(1.0);"));
    assert!(parse(&[("a.wgsl", &text)]).is_ok());
}

/// A fragment stage on top of a chain of as many functions.
fn chain(length: usize) -> String {
    use std::fmt::Write as _;
    let mut text = String::from("fn g0(x: f32) -> f32 { return sin(x); }\n");
    for i in 1..length {
        writeln!(
            text,
            "fn g{i}(x: f32) -> f32 {{ return g{}(x) + 0.5; }}",
            i - 1
        )
        .unwrap();
    }
    writeln!(
        text,
        "@vertex fn vs(@location(0) p: vec4f) -> @builtin(position) vec4f {{ return p; }}
@fragment fn fs(@builtin(position) p: vec4f) -> @location(0) vec4f {{ return vec4f(g{}(p.x)); }}",
        length - 1
    )
    .unwrap();
    text
}

#[test]
fn a_chain_of_calls_has_an_end() {
    let parse = |length| parse(&[("chain.wgsl", &chain(length))]);
    assert_eq!(parse(200).err().map(|e| e.to_string()), None);
    let error = parse(6000).unwrap_err();
    assert_eq!(error.code(), Code::Invalid);
    assert!(
        error
            .message()
            .contains("chain of more than 256 calls, up to `g255`"),
        "{}",
        error.message()
    );
    assert_eq!(error.labels().len(), 1);
}

/// WGSL that Tint takes and naga refuses: the message says what to write, and that is taken.
#[test]
fn what_naga_lacks_has_a_remedy() {
    let read = |body: &str, declared: &str| {
        let text = format!(
            "{declared}
@vertex fn vs(@location(0) p: vec4f) -> @builtin(position) vec4f {{ return p; }}
@fragment fn fs(@builtin(position) q: vec4f) -> @location(0) vec4f {{ {body} }}"
        );
        front::parse(&[Source::new("m.wgsl", text)], &Options::default())
    };
    let buffer = "@group(0) @binding(0) var<storage> s: array<vec4f, 4>;\n";
    let pointer =
        format!("{buffer}fn f(p: ptr<storage, array<vec4f, 4>>) -> vec4f {{ return (*p)[1]; }}");
    let value = format!("{buffer}fn f(p: array<vec4f, 4>) -> vec4f {{ return p[1]; }}");
    for (body, declared, remedy, better, declared_better) in [
        (
            "let a = i32(q.x); return vec4f(f32(2--a));",
            "",
            "write `- -`",
            "let a = i32(q.x); return vec4f(f32(2- -a));",
            "",
        ),
        (
            "const f = frexp(8.5); return vec4f(f.fract);",
            "",
            "write its value",
            "var x = 8.5; let f = frexp(x); return vec4f(f.fract);",
            "",
        ),
        (
            "return f(&s);",
            &pointer,
            "pass the value",
            "return f(s);",
            &value,
        ),
    ] {
        let error = read(body, declared).expect_err(body);
        let notes = error.notes().join("\n");
        assert!(
            notes.contains(remedy),
            "{body}: {} {notes}",
            error.message()
        );
        let read = read(better, declared_better);
        assert!(read.is_ok(), "{better}: {:?}", read.err());
    }
}
