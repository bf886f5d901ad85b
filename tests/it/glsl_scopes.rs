//! Names and scopes of GLSL, `#line`, and statements that are lowered: each text means what the
//! plainer one beside it does.

use preshade_compiler::front::{self, Source};
use preshade_plan::plan::Plan;
use preshade_plan::state::MaterialState;
use preshade_validate::Effort;
use preshade_validate::agree::{Relation, agree};
use shader_text::error::{Code, Color};
use shader_text::options::Options;

const VERTEX: &str = "#version 430
in vec3 position; out vec2 uv;
void main() { uv = position.xy; gl_Position = vec4(position, 1.0); }
";

fn parsed(vertex: &str, fragment: &str) -> Result<Plan, shader_text::error::Error> {
    let sources = [
        Source::new("m.vert", vertex),
        Source::new("m.frag", fragment),
    ];
    let parsed = front::parse(&sources, &Options::default())?;
    Ok(parsed.plan("m", &MaterialState::default()))
}

/// The text of a fragment stage from declarations and the body of `main`, or from a whole text that
/// begins with `#version`.
fn whole(text: &str) -> String {
    if text.contains("#version") {
        return text.to_owned();
    }
    let (declared, body) = text.split_once("main:").unwrap();
    format!(
        "#version 430\nin vec2 uv; out vec4 c;\nstruct Light {{ vec3 p; float x; }};\n\
         {declared}\nvoid main() {{ float r = 0.0; {body} c = vec4(r, uv, 1.0); }}\n"
    )
}

fn mean_the_same(pairs: &[[&str; 2]]) {
    for texts in pairs {
        let [text, plain] = texts.map(|t| {
            parsed(VERTEX, &whole(t)).unwrap_or_else(|e| panic!("{t}: {}", e.render(Color::Never)))
        });
        let effort = Effort {
            inputs: 24,
            ..Effort::default()
        };
        let held = agree(&text, &plain, Relation::Same.into(), &effort).unwrap();
        assert!(held.holds(), "{texts:?}: {:#?}", held.findings);
    }
}

/// GLSL 4.60, 4.2.2: a variable hides a struct of its name to the end of its scope.
#[test]
fn a_name_may_be_that_of_a_struct() {
    mean_the_same(&[
        [
            "struct Scene { float k; Light Light; }; main: Scene s; s.Light.x = uv.x; s.k = 0.1; r = s.Light.x + s.k;",
            "main: r = uv.x + 0.1;",
        ],
        [
            "struct Scene { Light Light[2], Other; float k, Scene; }; main: Scene s; s.Light[1].x = uv.x; s.Other.x = uv.y; s.Scene = 2.0; r = s.Light[1].x + s.Other.x * s.Scene;",
            "main: r = uv.x + uv.y * 2.0;",
        ],
        [
            "main: Light Light = Light(vec3(0.1), uv.x); r = Light.x + Light.p.y;",
            "main: r = uv.x + 0.1;",
        ],
        [
            "main: { float a = 0.5, Light = uv.x + a, b = Light * 2.0; r = b - Light; } Light l = Light(vec3(1.0), 2.0); r += l.x;",
            "main: r = (uv.x + 0.5) * 2.0 - (uv.x + 0.5); r += 2.0;",
        ],
        [
            "float f(Light Light, float k) { return Light.x * k; } float g(Light l); float g(Light l) { return l.x; } main: r = f(Light(vec3(0.0), uv.x), 3.0) + g(Light(vec3(0.0), uv.y));",
            "main: r = uv.x * 3.0 + uv.y;",
        ],
        [
            "float f(const in float Light, Light l) { return Light * l.x; } main: r = f(uv.x, Light(vec3(0.0), 3.0));",
            "main: r = uv.x * 3.0;",
        ],
        [
            "main: for (int Light = 0; Light < 3; Light++) r += float(Light) * uv.x; Light l = Light(vec3(0.0), uv.y); r += l.x;",
            "main: r += 0.0 * uv.x; r += 1.0 * uv.x; r += 2.0 * uv.x; r += uv.y;",
        ],
        [
            "main: for (int i = 0; i < 2; i++) { vec2 Light = uv * float(i); r += Light.y; } r += Light(vec3(0.0), uv.y).x;",
            "main: r += (uv * 0.0).y; r += (uv * 1.0).y; r += uv.y;",
        ],
        [
            "main: Light a = Light(vec3(1.0), uv.x); { struct Light { float y; }; Light b = Light(uv.y); r = b.y; } Light d = a; r += d.x;",
            "main: r = uv.y; r += uv.x;",
        ],
        [
            "float f(float x) { struct Inner { float a; }; Inner i = Inner(x); return i.a; } float g(float x) { struct Inner { vec2 b; }; Inner i = Inner(vec2(x)); return i.b.y; } main: r = f(uv.x) + g(uv.y);",
            "main: r = uv.x + uv.y;",
        ],
        [
            "main: float S = uv.x; { struct S { float a; }; S s = S(2.0); r = s.a; } r += S;",
            "main: r = 2.0; r += uv.x;",
        ],
        [
            "float f(float S) { return S; } main: struct S { float a; }; S s = S(uv.y); r = f(s.a);",
            "main: r = uv.y;",
        ],
        [
            "main: int n = 0; while (bool Light = n < 3) { n++; r += Light ? uv.x : 0.0; } Light l = Light(vec3(0.0), uv.y); r += l.x;",
            "main: for (int n = 0; n < 3; n++) r += uv.x; r += uv.y;",
        ],
        [
            "main: Light Light[2] = Light[2](Light(vec3(0.0), uv.x), Light(vec3(0.0), uv.y)); r = Light[0].x + Light[1].x;",
            "main: r = uv.x + uv.y;",
        ],
        [
            "main: float a[2]; a[0] = uv.x; if (uv.x > 0.5) { float Light = a[0]; r = Light; } else { Light Light; Light.x = 2.0; r = Light.x; }",
            "main: if (uv.x > 0.5) { r = uv.x; } else { r = 2.0; }",
        ],
        [
            "main: switch (int(uv.x * 4.0)) { case 0: float Light = uv.y; r = Light; break; default: r = 1.0; } r += Light(vec3(0.0), 1.0).x;",
            "main: if (int(uv.x * 4.0) == 0) { r = uv.y; } else { r = 1.0; } r += 1.0;",
        ],
    ]);
}

/// The next line has the number, and before GLSL 3.30 the one behind it (as glslang has it).
#[test]
fn line_numbers_follow_line() {
    for (head, line, file) in [
        ("#version 430\nin vec2 uv; out vec4 c;\n#line 100", 100, 0),
        ("#version 330\nin vec2 uv; out vec4 c;\n#line 100 7", 100, 7),
        (
            "#version 300 es\nprecision highp float; in vec2 uv; out vec4 c;\n#line 40 + 2",
            42,
            0,
        ),
        (
            "#version 430\nin vec2 uv; out vec4 c;\n#define AT 5\n#line AT AT + 1",
            5,
            6,
        ),
        (
            "#version 430\nin vec2 uv; out vec4 c;\n#line 9 \"a.glsl\"",
            9,
            0,
        ),
        (
            "#version 430\nin vec2 uv; out vec4 c;\n#if 0\n#line 7\n#endif\n#line 3\n\n\n",
            6,
            0,
        ),
        ("#version 150\nin vec2 uv; out vec4 c;\n#line 100", 101, 0),
    ] {
        let body = "void main() { c = vec4(float(LINE), float(FILE), uv); }\n";
        let text = format!("{head}\n{body}");
        let of = text.replace("LINE", "__LINE__").replace("FILE", "__FILE__");
        let plain = text
            .replace("LINE", &line.to_string())
            .replace("FILE", &file.to_string());
        mean_the_same(&[[of.as_str(), plain.as_str()]]);
    }
    let text =
        "#version 430\nin vec2 uv; out vec4 c;\n#line 100\nvoid main() { c = vec3(uv, 1.0); }\n";
    let error = parsed(VERTEX, text).unwrap_err();
    assert_eq!(error.location().unwrap().line, 4, "the file's own line");
    for wrong in ["#line", "#line x", "#line 1 2 3", "#line -1"] {
        let text = format!("#version 430\n{wrong}\nvoid main() {{}}\n");
        let error = parsed(VERTEX, &text).unwrap_err();
        assert_eq!(error.code(), Code::Parse, "{wrong}");
    }
}

/// What a local variable or a parameter hides is not used.
#[test]
fn a_varying_that_is_hidden_is_not_read() {
    let vertex =
        "attribute vec3 p; varying vec4 v; void main() { v = vec4(p, 1.0); gl_Position = v; }";
    let fragment = |declared: &str, body: &str| {
        format!(
            "precision mediump float; varying vec2 uv; varying vec4 v; {declared}\n\
             void main() {{ float r = 0.0; {body} gl_FragColor = vec4(r) + v; }}"
        )
    };
    for (declared, body) in [
        ("", "vec2 uv = v.xy; r = uv.x;"),
        ("", "for (float uv = 0.0; uv < 2.0; uv += 1.0) r += uv;"),
        ("", "{ float a = 1.0, uv = a; r = uv; }"),
        ("", "if (v.x > 0.0) { vec2 uv = v.xy; r = uv.y; }"),
        ("float f(float uv) { return uv; }", "r = f(2.0);"),
        ("struct S { vec2 uv; };", "S s; s.uv = v.xy; r = s.uv.x;"),
        (
            "vec2 unused() { return uv; }",
            "float unused = 1.0; r = unused;",
        ),
        (
            "vec2 g = vec2(1.0); float f(vec2 uv) { vec2 g = uv; return g.x; }",
            "r = f(g);",
        ),
    ] {
        let read = parsed(vertex, &fragment(declared, body));
        read.unwrap_or_else(|e| panic!("{body}: {}", e.render(Color::Never)));
    }
    for (declared, body) in [
        ("", "r = uv.x;"),
        ("", "vec2 uv = uv; r = uv.x;"),
        ("", "{ float uv = 1.0; r = uv; } r += uv.x;"),
        (
            "float f(float k) { return uv.x * k; }",
            "vec2 uv = v.xy; r = f(uv.x);",
        ),
        (
            "float f() { return uv.x; }",
            "for (int uv = 0; uv < 2; uv++) r += f();",
        ),
    ] {
        let error = parsed(vertex, &fragment(declared, body)).unwrap_err();
        assert_eq!(error.code(), Code::Interface, "{body}");
    }
}

/// A switch is a scope of GLSL and none of naga's.
#[test]
fn what_a_switch_declares_ends_with_it() {
    mean_the_same(&[
        [
            "main: switch (int(uv.x * 3.0)) { case 0: float t = 1.0; r += t; break; default: r += uv.y; } float t = 2.0; r += t;",
            "main: if (int(uv.x * 3.0) == 0) r += 1.0; else r += uv.y; r += 2.0;",
        ],
        [
            "float t = 5.0; const float k = 0.25; main: switch (int(uv.x * 3.0)) { case 0: float t = 1.0; const float k = 2.0; r += t * k; break; default: r += uv.y; } r += t + k;",
            "main: if (int(uv.x * 3.0) == 0) r += 2.0; else r += uv.y; r += 5.25;",
        ],
        [
            "float f(float gain) { float s = 0.0; switch (int(uv.x * 3.0)) { case 0: float gain = 10.0; s += gain; break; default: s += 1.0; } return s + gain; } main: r = f(2.0);",
            "main: r = (int(uv.x * 3.0) == 0 ? 10.0 : 1.0) + 2.0;",
        ],
        [
            "main: float w = 1.0; switch (int(uv.x * 3.0)) { case 0: float w = 3.0; case 1: w = uv.y; { float w = 9.0; switch (1) { case 1: float w = 4.0; r += w; } r += w; } r += w; break; default: break; } r += w; do { float w = 3.0; r += w; } while (w < 0.5); for (float w = 0.0, e = 2.0; w < e; w += 1.0) r += w; r += w;",
            "main: int i = int(uv.x * 3.0); if (i == 0 || i == 1) r += 13.0 + uv.y; r += 1.0; r += 3.0; r += 1.0; r += 1.0;",
        ],
        [
            "main: const int n = 2; switch (int(uv.x * 3.0)) { case 0: const int n = 3; float a[n]; a[n - 1] = uv.y; r = a[2]; break; case n: r = 7.0; } float b[n]; b[1] = 1.0; r += b[1];",
            "main: int i = int(uv.x * 3.0); r = i == 0 ? uv.y : i == 3 ? 7.0 : 0.0; r += 1.0;",
        ],
    ]);
}

/// glslang and Mesa read the target of `+=` behind the value.
#[test]
fn a_compound_assignment_reads_its_target_last() {
    const DECLARED: &str = "float acc = 1.0; float next() { acc *= 3.0; return acc + uv.x; } float grow(inout float x) { x *= 2.0; return 1.0; } main: ";
    mean_the_same(
        &[
            ["acc += next(); r = acc;", "r = 3.0 + (3.0 + uv.x);"],
            ["float y = uv.y; y -= grow(y); r = y;", "r = uv.y * 2.0 - 1.0;"],
            ["float z = uv.y; z = z - grow(z); r = z;", "r = uv.y - 1.0;"],
            ["int i = 2; i *= (i = 5); r = float(i);", "r = 25.0;"],
            ["int i = 2; i += i++; r = float(i);", "r = 5.0;"],
            ["vec2 v = uv; v.y += grow(v.y); r = v.y;", "r = uv.y * 2.0 + 1.0;"],
            ["vec2 v = uv; v.yx += vec2(grow(v.y), v.x = 4.0); r = v.y + v.x;", "r = uv.y * 2.0 + 1.0 + 8.0;"],
            ["float a[2]; a[0] = uv.x; a[1] = uv.y; int i = 0; a[i] += float(i = 1); r = a[0] - a[1];", "r = uv.x + 1.0 - uv.y;"],
            ["float a[2]; a[0] = uv.x; a[1] = uv.y; int i = 0; a[i++] += float(i); r = a[0] - a[1];", "r = uv.x + 1.0 - uv.y;"],
            ["float x = 1.0, y = 2.0; x += y += x *= 3.0; r = x * 10.0 + y;", "r = 85.0;"],
            ["mat2 m = mat2(uv, uv); m[1] *= (m[1].x = 2.0); r = m[1].x + m[1].y + m[0].x;", "r = 4.0 + uv.y * 2.0 + uv.x;"],
        ]
        .map(|[text, plain]| {
            [text, plain].map(|body| -> &str { format!("{DECLARED}{body}").leak() })
        }),
    );
}

/// A directive in a comment is none.
#[test]
fn a_version_in_a_comment_is_none() {
    mean_the_same(&[
        [
            "#version 430\n/*\n#version 100\n#pragma stage vertex\n*/\nin vec2 uv; out vec4 c;\nvoid main() { c = vec4(uv, 0.0, 1.0); }",
            "#version 430\nin vec2 uv; out vec4 c;\nvoid main() { c = vec4(uv, 0.0, 1.0); }",
        ],
        [
            "/*\n#version 100\n*/\n#version 430\nin vec2 uv; out vec4 c;\nvoid main() { c = vec4(uv, 0.0, 1.0); }",
            "#version 430\nin vec2 uv; out vec4 c;\nvoid main() { c = vec4(uv, 0.0, 1.0); }",
        ],
    ]);
}

#[test]
fn statements_and_operators_of_glsl_are_lowered() {
    mean_the_same(&[
        [
            "main: int k = 0; while (bool go = k < int(uv.x * 5.0)) { r += go ? 0.1 : 0.0; k++; if (k == 2) continue; }",
            "main: int k = 0; while (k < int(uv.x * 5.0)) { r += 0.1; k++; }",
        ],
        [
            "main: bool go = uv.y > 0.5; for (int k = 0; bool go = k < 4; k++) { if (k == 1) continue; r += go ? uv.x : 9.0; } r += go ? 1.0 : 0.0;",
            "main: for (int k = 0; k < 4; k++) { if (k == 1) continue; r += uv.x; } r += uv.y > 0.5 ? 1.0 : 0.0;",
        ],
        [
            "main: vec4 q = vec4(uv, 3.0, 4.0); q.zyx[1] = 8.0; q.wz[0] += 1.0; q.xyzw.wz.x = q.w + uv.x; int i = uv.x > 0.5 ? 1 : 0; q.yx[i] = 5.0; r = q.x + q.y * 2.0 + q.z * 3.0 + q.w * 4.0;",
            "main: vec4 q = vec4(uv, 3.0, 4.0); q.y = 8.0; q.w += 1.0; q.w = q.w + uv.x; int i = uv.x > 0.5 ? 1 : 0; if (i == 0) q.y = 5.0; else if (i == 1) q.x = 5.0; r = q.x + q.y * 2.0 + q.z * 3.0 + q.w * 4.0;",
        ],
        [
            "main: mat3 m = mat3(uv.x); m[1].zyx[0] = uv.y; m[2].yx[1] += 4.0; r = m[1].z + m[2].x + vec3(uv, 2.0).zyx[1];",
            "main: r = uv.y + 4.0 + uv.y;",
        ],
        [
            "main: switch (int(uv.x * 4.0) << 31) { case 1 << 31: r = 1.0; break; case -1: r = 2.0; break; case 0: break; }",
            "main: r = (int(uv.x * 4.0) & 1) == 1 ? 1.0 : 0.0;",
        ],
        [
            "main: uint m = uint(uv.x * 9.0); uvec2 n = -uvec2(m, 3u); r = float((-m) & 255u) + float(n.y & 15u) + float(-1u & 7u);",
            "main: uint m = uint(uv.x * 9.0); r = float((~m + 1u) & 255u) + 13.0 + 7.0;",
        ],
    ]);
}

/// GLSL 4.60, 5.1: the operands of an expression, and the indices of a target, from left to right.
#[test]
fn operands_are_evaluated_from_left_to_right() {
    mean_the_same(&[
        [
            "main: mat2 m = mat2(uv, uv * 2.0 + 1.0); int k = 0; r = m[k++][k++] + float(k);",
            "main: r = uv.y + 2.0;",
        ],
        [
            "main: mat2 q = mat2(uv, uv); int k = 0; q[k++][k++] = 9.0; r = q[0][1] - q[1][0] + float(k);",
            "main: r = 9.0 - uv.x + 2.0;",
        ],
        [
            "struct S { float q[2]; }; main: S s[2]; s[0].q[0] = 1.0; s[0].q[1] = uv.x; s[1].q[0] = uv.y; s[1].q[1] = 2.0; int k = 0; r = s[k++].q[k];",
            "main: r = uv.x;",
        ],
        [
            "int k = 0; vec4 vv() { k = 2; return vec4(uv, 7.0, 8.0); } main: r = vv()[k];",
            "main: r = 7.0;",
        ],
        [
            "main: float a[2][2] = float[2][2](float[2](1.0, uv.x), float[2](uv.y, 2.0)); int k = 0; r = a[k++][k++];",
            "main: r = uv.x;",
        ],
        [
            "const float M[4] = float[4](1.0, 2.0, 3.0, 4.0); main: int k = 1; vec4 w = vec4(M[k++], M[k++], M[k], 0.0); r = w.x * 100.0 + w.y * 10.0 + w.z;",
            "main: r = 234.0;",
        ],
        [
            "const mat2 M = mat2(1.0, 2.0, 3.0, 4.0); main: int k = 0; r = M[k++][k++];",
            "main: r = 2.0;",
        ],
        [
            "float g = 1.0; vec3 gv = vec3(1.0); mat2 gm = mat2(1.0); float ch() { g = uv.x; return 2.0; } vec3 chv() { gv = vec3(uv.x); return vec3(2.0, 3.0, 4.0); } mat2 chm() { gm = mat2(5.0); return mat2(2.0); } main: mat3 o = outerProduct(gv, chv()); r = o[1].x + o[0].z * 10.0;",
            "main: r = 3.0 + 20.0;",
        ],
        [
            "float g = 1.0; vec3 gv = vec3(1.0); mat2 gm = mat2(1.0); float ch() { g = uv.x; return 2.0; } vec3 chv() { gv = vec3(uv.x); return vec3(2.0, 3.0, 4.0); } mat2 chm() { gm = mat2(5.0); return mat2(2.0); } main: mat2 o = matrixCompMult(gm, chm()); r = o[0].x + o[1].y * 10.0;",
            "main: r = 22.0;",
        ],
        [
            "float g = 1.0; vec3 gv = vec3(1.0); mat2 gm = mat2(1.0); float ch() { g = uv.x; return 2.0; } vec3 chv() { gv = vec3(uv.x); return vec3(2.0, 3.0, 4.0); } mat2 chm() { gm = mat2(5.0); return mat2(2.0); } main: r = reflect(g, ch());",
            "main: r = 1.0 - 2.0 * 2.0 * 2.0 * 1.0;",
        ],
        [
            "float g = 1.0; vec3 gv = vec3(1.0); mat2 gm = mat2(1.0); float ch() { g = uv.x; return 2.0; } vec3 chv() { gv = vec3(uv.x); return vec3(2.0, 3.0, 4.0); } mat2 chm() { gm = mat2(5.0); return mat2(2.0); } main: r = faceforward(g, ch(), g);",
            "main: r = uv.x * 2.0 < 0.0 ? 1.0 : -1.0;",
        ],
        [
            "float g = 1.0; vec3 gv = vec3(1.0); mat2 gm = mat2(1.0); float ch() { g = uv.x; return 2.0; } vec3 chv() { gv = vec3(uv.x); return vec3(2.0, 3.0, 4.0); } mat2 chm() { gm = mat2(5.0); return mat2(2.0); } main: r = mix(gv, chv(), bvec3(true, false, false)).y;",
            "main: r = 1.0;",
        ],
        [
            "float g = 1.0; vec3 gv = vec3(1.0); mat2 gm = mat2(1.0); float ch() { g = uv.x; return 2.0; } vec3 chv() { gv = vec3(uv.x); return vec3(2.0, 3.0, 4.0); } mat2 chm() { gm = mat2(5.0); return mat2(2.0); } struct S { float a; float b; }; S s = S(1.0, 2.0); S chs() { s.a = 5.0; return S(1.0, 2.0); } main: r = s == chs() ? 1.0 : 2.0;",
            "main: r = 1.0;",
        ],
        [
            "float a[2] = float[2](1.0, 2.0); float[2] cha() { a[1] = 7.0; return float[2](1.0, 2.0); } main: r = a == cha() ? 1.0 : 2.0;",
            "main: r = 1.0;",
        ],
        [
            "float g = 1.0; vec3 gv = vec3(1.0); mat2 gm = mat2(1.0); float ch() { g = uv.x; return 2.0; } vec3 chv() { gv = vec3(uv.x); return vec3(2.0, 3.0, 4.0); } mat2 chm() { gm = mat2(5.0); return mat2(2.0); } mat2 other = mat2(2.0); main: r = gm == chm() ? 1.0 : 2.0; r += gm == mat2(5.0) ? 4.0 : 8.0;",
            "main: r = 6.0;",
        ],
        [
            "main: float a[2] = float[2](1.0, uv.x * uv.x + 5.0); r = a != (a[1] = 3.0, a) ? 1.0 : 2.0;",
            "main: r = 1.0;",
        ],
        [
            "int k = 0; float ch() { k = k * 10 + 1; return uv.x; } float[2] ar() { k = k * 10 + 2; return float[2](uv.y, 4.0); } struct S { float a; float q[2]; }; main: S s = S(ch(), ar()); r = s.a + s.q[0] + s.q[1] + float(k);",
            "main: r = uv.x + uv.y + 4.0 + 12.0;",
        ],
        [
            "struct S { float a; float q[2]; float b; }; main: int k = 0; float z[2] = float[2](uv.x, 1.0); S s = S(float(k), (k++, z), float(k++)); r = s.a + s.b * 10.0 + s.q[0] + float(k) * 100.0;",
            "main: r = 10.0 + uv.x + 200.0;",
        ],
        [
            "int g; int ff() { g = 5; { int g = 0; g++; } return 1; } main: g = int(uv.x * 9.0); g += ff(); r = float(g);",
            "main: r = 6.0;",
        ],
        [
            "int g; int ff() { g = 5; int g = 0; g++; return 1; } main: g = int(uv.x * 9.0); g += ff(); r = float(g);",
            "main: r = 6.0;",
        ],
        [
            "int g; int ff() { for (int g = 0; g < 3; g++) {} g = 5; return 1; } main: g = int(uv.x * 9.0); g += ff(); r = float(g);",
            "main: r = 6.0;",
        ],
    ]);
}

/// GLSL 4.60, 6.1: a call means a function that the text declares before it.
#[test]
fn a_call_sees_what_is_declared_before_it() {
    mean_the_same(&[
        [
            "float g(float x) { return 1.0; } float t() { return g(3); } float g(int x) { return 2.0; } main: r = t() + g(3) * 10.0;",
            "main: r = 21.0;",
        ],
        [
            "#version 330\nin vec2 uv; out vec4 c; float a(float x) { return cosh(x); } float cosh(float x) { return 2.0; } void main() { c = vec4(a(uv.x), cosh(uv.x), uv.x, 1.0); }",
            "#version 330\nin vec2 uv; out vec4 c; void main() { c = vec4(cosh(uv.x), 2.0, uv.x, 1.0); }",
        ],
    ]);
}

/// Arrays of structs below 16 bytes lie otherwise in blocks than in variables.
#[test]
fn structs_of_small_members_are_copied_whole() {
    const USES: &str =
        "E one = MADE; F q = F(1.0, E[2](one, one)); E t[2] = q.e; q.e[0] = t[1]; q.e = t;";
    let structs = [
        ("float a;", "E(uv.x)", "a"),
        ("int a;", "E(int(uv.x))", "a"),
        ("bool a;", "E(uv.x > 0.5)", "a"),
        ("vec2 a;", "E(uv)", "a.y"),
        ("float a; float b;", "E(uv.x, uv.y)", "b"),
        ("ivec2 a; float b;", "E(ivec2(uv), uv.y)", "b"),
        ("mat2 a;", "E(mat2(uv, uv))", "a[1].y"),
        ("bool a[2];", "E(bool[2](uv.x > 0.5, true))", "a[0]"),
        ("float a[3];", "E(float[3](uv.x, 1.0, 2.0))", "a[0]"),
    ];
    let blocks = [
        ("", ""),
        (
            "layout(std140, binding = 0) uniform B { F b; E m; };",
            "q.e[0] = b.e[1]; t = b.e; q = b; q.e[1] = m; q.e[1] = one;",
        ),
        (
            "layout(std430, binding = 0) readonly buffer B { F b; E m[3]; };",
            "q.e[0] = b.e[1]; t = b.e; q = b; q.e[0] = m[1]; q.e[1] = one;",
        ),
    ];
    let mut pairs: Vec<[String; 2]> = Vec::new();
    for (members, made, part) in structs {
        for (block, copies) in blocks {
            let head =
                format!("struct E {{ {members} }}; struct F {{ float x; E e[2]; }}; {block}");
            let uses = USES.replace("MADE", made);
            pairs.push([
                format!("{head} main: {uses} {copies} r = float(q.e[1].{part});"),
                format!("{head} main: E one = {made}; r = float(one.{part});"),
            ]);
        }
    }
    let pairs: Vec<[&str; 2]> = pairs
        .iter()
        .map(|[a, b]| [a.as_str(), b.as_str()])
        .collect();
    mean_the_same(&pairs);
}

#[test]
fn values_of_blocks_constants_and_arrays_are_those_of_glsl() {
    mean_the_same(&[
        [
            "struct S { vec2 y[2]; }; layout(std140, binding = 0) uniform B { S a; }; main: S t = a; S q = S(vec2[2](a.y[0], a.y[1])); r = t == q ? 1.0 : 2.0;",
            "struct S { vec2 y[2]; }; layout(std140, binding = 0) uniform B { S a; }; main: r = a.y[0] == a.y[0] && a.y[1] == a.y[1] ? 1.0 : 2.0;",
        ],
        [
            "struct S { float y[2]; }; layout(std140, binding = 0) uniform B { S a; }; main: S t = a; S q = S(float[2](a.y[0], a.y[1])); r = a != q ? 1.0 : 2.0;",
            "struct S { float y[2]; }; layout(std140, binding = 0) uniform B { S a; }; main: r = a.y[0] != a.y[0] || a.y[1] != a.y[1] ? 1.0 : 2.0;",
        ],
        [
            "struct S { mat2 y; }; layout(std140, binding = 0) uniform B { S a; }; main: S t = a; S q = S(a.y); r = t == q ? 1.0 : 2.0;",
            "struct S { mat2 y; }; layout(std140, binding = 0) uniform B { S a; }; main: r = a.y[0] == a.y[0] && a.y[1] == a.y[1] ? 1.0 : 2.0;",
        ],
        [
            "struct S { bool y; bvec2 z; }; layout(std140, binding = 0) uniform B { S a; }; main: S t = a; S q = S(a.y, a.z); r = t == q ? 1.0 : 2.0;",
            "main: r = 1.0;",
        ],
        [
            "struct S { bool y[2]; }; layout(std140, binding = 0) uniform B { S a; }; main: S t = a; S q = S(bool[2](a.y[0], a.y[1])); r = t == q ? 1.0 : 2.0;",
            "main: r = 1.0;",
        ],
        [
            "float[2] mk(float a, float b, float k) { return float[2](a, b); } main: float a[2] = float[2](uv.x, uv.y); float b[] = a; float d[] = mk(uv.x, 2.0, 1.0); float e[] = uv.x > 0.5 ? a : d; r = b[1] + d[1] + e[0] + float(b.length() + d.length());",
            "main: r = uv.y + 2.0 + uv.x + 4.0;",
        ],
        [
            "const float a[2] = float[2](1.0, 2.0); float b[] = a; float[3] mk() { return float[3](1.0, 2.0, 3.0); } float d[] = mk(); main: r = b[1] + d[2] + uv.x + float(b.length());",
            "main: r = 2.0 + 3.0 + uv.x + 2.0;",
        ],
        [
            "struct S { float q[3]; }; main: S s; s.q = float[](uv.x, 1.0, 2.0); float b[] = s.q; float k[][2] = float[][2](float[2](uv.y, 1.0), float[2](2.0, 3.0)); float l[] = k[0]; r = b[0] + l[0] + float(l.length());",
            "main: r = uv.x + uv.y + 2.0;",
        ],
        [
            "main: switch (int(uv.x * 3.0)) { case 0: r = 1.0; break; default: ; }",
            "main: r = int(uv.x * 3.0) == 0 ? 1.0 : 0.0;",
        ],
        [
            "main: switch (int(uv.x * 3.0)) { case 0: r = 1.0; break; default: }",
            "main: r = int(uv.x * 3.0) == 0 ? 1.0 : 0.0;",
        ],
        [
            "main: switch (int(uv.x * 3.0)) { default: r = 1.0; break; case 0: }",
            "main: r = int(uv.x * 3.0) != 0 ? 1.0 : 0.0;",
        ],
        [
            "const int W[] = int[](2, 3); const mat2 M = mat2(1.0, 2.0, 3.0, 4.0); struct C { int n; float x; }; const C K = C(3, 0.5); main: float q[W[0]]; float p[K.n]; float z[int(M[1][0])]; switch (int(uv.x * 4.0)) { case W[1]: r = 1.0; break; default: break; } r += float(q.length() + p.length() * 10 + z.length() * 100);",
            "main: r = int(uv.x * 4.0) == 3 ? 1.0 : 0.0; r += 332.0;",
        ],
        [
            "uniform vec4 b[gl_MaxDrawBuffers]; main: r = float(b.length()) + float(gl_MaxVertexUniformVectors);",
            "uniform vec4 b[8]; main: r = 8.0 + 256.0;",
        ],
        // The level without gradients is the first.
        [
            "uniform samplerCubeShadow s; main: r = textureGrad(s, vec4(uv, 0.5, 0.5), vec3(0.0), vec3(0.0));",
            "uniform samplerCubeShadow s; main: r = textureGrad(s, vec4(uv, 0.5, 0.5), vec3(0), vec3(0.0, 0.0, 0.0));",
        ],
        [
            "struct S0 { bvec3 x; }; struct S1 { S0 a; mat2 m; }; layout(row_major, std140, binding = 0) uniform B { S1 s; }; main: S1 t = s; r = t.a.x.y == s.a.x.y ? 1.0 : 0.0;",
            "main: r = 1.0;",
        ],
        [
            "uniform sampler2D s; main: c = texture(s, ivec2(1, 2)) + textureProj(s, ivec3(1, 2, 1)) + textureOffset(s, ivec2(1), ivec2(1, 2)) + textureLod(s, uvec2(1), 1) + textureGrad(s, uv, ivec2(1), ivec2(0));",
            "uniform sampler2D s; main: c = texture(s, vec2(1, 2)) + textureProj(s, vec3(1, 2, 1)) + textureOffset(s, vec2(1), ivec2(1, 2)) + textureLod(s, vec2(1), 1.0) + textureGrad(s, uv, vec2(1), vec2(0));",
        ],
    ]);
}

#[test]
fn what_glsl_forbids_is_refused_in_its_words() {
    let wrong = [
        (
            "#define A 1\n#define A 2\nmain: r = float(A);",
            "defined twice",
        ),
        (
            "#define A(x) x\n#define A(y) y\nmain: r = float(A(1));",
            "defined twice",
        ),
        (
            "float g(float x) { float x = 1.0; return x; } main: r = g(1.0);",
            "declared twice",
        ),
        (
            "main: for (int k = 0; k < 2; k++) { int k = 2; r += float(k); }",
            "declared twice",
        ),
        (
            "main: while (bool go = r < 1.0) { float go = 1.0; r += go; }",
            "declared twice",
        ),
        (
            "uniform float f; const float k[2] = float[2](1.0, f); main: r = k[1];",
            "must be constant",
        ),
        (
            "float g() { return 1.0; } const float k = g(); main: r = k;",
            "must be constant",
        ),
        ("main: int k; k += 1.5;", "int"),
        ("main: int k; k *= uv.x;", "int"),
        ("main: int k; k += 1u;", "int"),
        ("main: ivec2 q; q *= 1.5;", "ivec2"),
        ("main: float q; q += uv;", "float"),
        (
            "float a(float x) { return 1.0; } float a(float x) { return 2.0; } main: r = a(1.0);",
            "two bodies",
        ),
        ("void main() {} main: r = 1.0;", "two bodies"),
        (
            "float a(float x); int a(float x) { return 1; } main: r = 1.0;",
            "another",
        ),
        (
            "float t() { return gg(1.0); } float gg(float x) { return x; } main: r = t();",
            "before it is declared",
        ),
        (
            "float t() { return gg; } float gg = 1.0; main: r = t();",
            "not declared before",
        ),
        ("void g(const int a) { a = 2; } main: g(1);", "constant"),
        (
            "void g(const in float a[2]) { a[1] = 2.0; } main: g(float[2](1.0, 2.0));",
            "constant",
        ),
        ("main: r = uv.x.y;", "components"),
        ("main: int i = 1; i = i.w;", "components"),
        ("uniform float f; main: vec4 q = f.rgba;", "components"),
        ("main: bool b = true; b++;", "next value"),
        (
            "uniform sampler2DShadow s; main: r = textureLod(s, vec3(uv, 0.5), uv.x);",
            "level",
        ),
        (
            "uniform sampler2DShadow s; main: r = textureGrad(s, vec3(uv, 0.5), uv, uv);",
            "gradients",
        ),
        (
            "uniform samplerCubeShadow s; main: r = textureGrad(s, vec4(uv, 0.5, 0.5), vec3(uv, 1.0), vec3(uv, 1.0));",
            "gradients",
        ),
        (
            "uniform sampler2DShadow s; main: r = texture(s, vec3(uv, 0.5), 1.0);",
            "a bias",
        ),
        ("main: break;", "`break` must"),
        ("main: if (uv.x > 0.5) continue;", "`continue` must"),
        ("main: switch (1) { case 1: continue; }", "`continue` must"),
        ("main: switch (1.0) { case 1: break; }", "an int or a uint"),
        (
            "main: switch (1) { case 1: break; case 1: break; }",
            "twice",
        ),
        (
            "main: switch (1) { default: break; default: break; }",
            "twice",
        ),
        (
            "int g() { return; } main: r = float(g());",
            "returns an int",
        ),
        (
            "uniform sampler2D s; main: c = textureOffset(s, uv, ivec2(uv));",
            "must be a constant",
        ),
        ("main: float q; q += uv.xy;", "expected"),
    ];
    for (text, message) in wrong {
        let Err(error) = parsed(VERTEX, &whole(text)) else {
            panic!("accepted: {text}");
        };
        let told = error.render(Color::Never);
        let first = told.lines().next().unwrap_or_default();
        assert!(first.contains(message), "{text}: {told}");
        let code = error.code();
        assert!(
            matches!(code, Code::Parse | Code::Unsupported),
            "{text}: {told}"
        );
    }
    let right = [
        "#define A 1 + 2\n#define A  1 +  2\n#undef A\n#define A 3\nmain: r = float(A); for (int k = 0; k < 2; k++) { { int k = 2; r += float(k); } } for (int k = 0; k < 2; k++) r += 1.0; do { float k = 1.0; r += k; } while (r < 1.0); float k = 2.0; r += k;",
        "const float k = sin(2.0) * float(gl_MaxDrawBuffers); uniform vec4 a[3]; const int n = a.length(); const float w[2] = float[2](k, 2.0); struct S { float x; }; const S s = S(w[1]); main: r = k + float(n) + w[1] + s.x;",
        "main: uint k = 1u; k += 1; k <<= 2; r = float(k); int n = 1; n <<= 3u; r *= 2; vec2 q = uv; q *= 2; q *= mat2(1.0); r += q.x; r += uv.x.x;",
        "float gg(float); float t() { return gg(1.0); } float gg(float x) { return x; } main: r = t();",
        "uniform sampler2DShadow s; main: r = textureLod(s, vec3(uv, 0.5), 0.0) + textureLod(s, vec3(uv, 0.5), 0);",
        "uniform sampler2D s; const ivec2 o[2] = ivec2[2](ivec2(1), ivec2(2)); const ivec2 k = ivec2(1); main: c = textureOffset(s, uv, k) + textureOffset(s, uv, o[1]) + textureOffset(s, uv, -k);",
    ];
    for text in right {
        let parsed = parsed(VERTEX, &whole(text));
        assert!(parsed.is_ok(), "{text}: {:?}", parsed.err());
    }
}
