//! Small texts of WGSL at the edges of what naga takes. `wgsl_in.rs` holds the front end against
//! them, and `tests/tools` holds them against Tint.

/// Statements of a fragment stage, or declarations, and a part of the error. `None`: taken.
pub struct Case {
    pub declarations: &'static str,
    pub statements: &'static str,
    pub refused: Option<&'static str>,
}

const fn refused(statements: &'static str, error: &'static str) -> Case {
    Case {
        declarations: "",
        statements,
        refused: Some(error),
    }
}

const fn taken(statements: &'static str) -> Case {
    Case {
        declarations: "",
        statements,
        refused: None,
    }
}

const fn declared(declarations: &'static str) -> Case {
    Case {
        declarations,
        statements: "",
        refused: None,
    }
}

/// The whole text of a case.
pub fn text(case: &Case) -> String {
    format!(
        "{}
struct V {{ @builtin(position) position: vec4f, @location(0) uv: vec2f }}
@group(0) @binding(0) var color: texture_2d<f32>;
@group(0) @binding(1) var linear: sampler;
@group(0) @binding(2) var depth: texture_depth_2d;
@vertex fn vs(@location(0) p: vec3f) -> V {{ return V(vec4f(p, 1.0), p.xy); }}
@fragment fn fs(v: V) -> @location(0) vec4f {{
  var x = v.uv.x; var y = v.uv.y; var a = i32(x * 9.0); var b = a + 1; var u = u32(a);
  var p = x > 0.5; var q = y > 0.5; var w = v.uv; var f = vec4f(x, y, x, y);
  {}
  return vec4f(x, y, f.z, w.x);
}}
",
        case.declarations, case.statements
    )
}

pub const CASES: &[Case] = &[
    // Operators without a precedence between them.
    refused("let z = a + b ^ a;", "`+` and `^` need parentheses"),
    refused("let z = a | b & a;", "`|` and `&` need parentheses"),
    refused("let z = p && q || p;", "`&&` and `||` need parentheses"),
    refused("let z = p || q && p;", "`||` and `&&` need parentheses"),
    refused("let z = a << u + u;", "`<<` and `+` need parentheses"),
    refused("let z = a - b >> u;", "`-` and `>>` need parentheses"),
    refused("let z = a << u << u;", "`<<` and `<<` need parentheses"),
    refused("let z = p == q == p;", "`==` and `==` need parentheses"),
    refused("let z = p & q == p;", "`&` and `==` need parentheses"),
    refused("let z = p && q & p;", "`&&` and `&` need parentheses"),
    refused("if a < b && p || q { x = 1.0; }", "`&&` and `||`"),
    refused(
        "for (var i = 0; i < 3 && p | q; i++) { x += 1.0; }",
        "`&&` and `|`",
    ),
    refused("w[a & 1 + 1] = 0.0;", "`&` and `+`"),
    taken("let z = a + b * a - b / 2 % 3;"),
    taken("let z = a < b && b < a && !p; let t = a + b == b && p;"),
    taken("let z = a & b & a; let s = a ^ b ^ 1; let t = (a + b) ^ (a << u);"),
    taken("let z = a << u < b << u; let t = a + b < b - a;"),
    taken("let z = array<array<i32, 2>, 2>(); let t = a < b; let s = b > a;"),
    taken("a <<= u; a ^= b + 1; a &= -b; a |= ~b; b >>= 1u;"),
    // Arguments that the built-in functions do not have.
    refused("let z = sign(u);", "`sign` takes no unsigned numbers"),
    refused(
        "let z = sign(vec3u(u));",
        "`sign` takes no unsigned numbers",
    ),
    refused("let z = clamp(x, 1.0, 0.0);", "the first is larger"),
    refused(
        "let z = clamp(w, vec2f(0.0, 0.5), vec2f(1.0, 0.25));",
        "the first is larger",
    ),
    refused("let z = smoothstep(0.5, 0.5, x);", "both edges"),
    refused("let z = ldexp(x, 200);", "128 is the largest"),
    refused("let z = extractBits(u, 30u, 10u);", "beyond 32"),
    refused("let z = insertBits(u, u, 30u, 10u);", "beyond 32"),
    refused(
        "let z = textureSampleGrad(depth, linear, w, w, w);",
        "no depth texture",
    ),
    refused(
        "let z = textureSample(color, linear, w, vec2i(9, 1));",
        "the offset is 9",
    ),
    taken("let z = clamp(x, 0.5, 0.5); let s = smoothstep(0.6, 0.2, x); let l = ldexp(x, 128);"),
    taken("let z = extractBits(u, 24u, 8u) + u32(sign(a)); let s = sign(w);"),
    taken("let z = textureSample(color, linear, w, vec2i(-8, 7));"),
    // Loops that nothing leaves.
    refused("loop { x = 1.0; }", "does not exit"),
    refused(
        "loop { switch a { case 1: { break; } default: {} } }",
        "does not exit",
    ),
    refused("loop { loop { break; } }", "does not exit"),
    taken("loop { switch a { case 1: { return f; } default: {} } }"),
    taken("loop { if p { break; } }"),
    taken("loop { x += 1.0; continuing { break if x > 3.0; } }"),
    Case {
        declarations: "@group(0) @binding(3000000000) var other: sampler;",
        statements: "",
        refused: Some("3000000000 is no group or binding"),
    },
    // One variable under two names.
    Case {
        declarations: "fn copy(p: ptr<function, f32>, q: ptr<function, f32>) { *p = *q; } fn sum(p: ptr<function, f32>, q: ptr<function, f32>) -> f32 { return *p + *q; } var<private> g: f32; fn add(p: ptr<private, f32>) { *p += g; } fn put(p: ptr<private, f32>) { *p += 1.0; }",
        statements: "copy(&x, &x);",
        refused: Some("under another name"),
    },
    Case {
        declarations: "fn copy(p: ptr<function, f32>, q: ptr<function, f32>) { *p = *q; } fn sum(p: ptr<function, f32>, q: ptr<function, f32>) -> f32 { return *p + *q; } var<private> g: f32; fn add(p: ptr<private, f32>) { *p += g; } fn put(p: ptr<private, f32>) { *p += 1.0; }",
        statements: "add(&g);",
        refused: Some("under another name"),
    },
    Case {
        declarations: "fn copy(p: ptr<function, f32>, q: ptr<function, f32>) { *p = *q; } fn sum(p: ptr<function, f32>, q: ptr<function, f32>) -> f32 { return *p + *q; } var<private> g: f32; fn add(p: ptr<private, f32>) { *p += g; } fn put(p: ptr<private, f32>) { *p += 1.0; }",
        statements: "copy(&x, &y); x = sum(&y, &y); put(&g);",
        refused: None,
    },
    // What naga lacks.
    taken("const z = mix(0.25, 0.75, 0.5); x += z;"),
    taken("const z = smoothstep(0.0, 1.0, 0.25); const s = mix(z, 1.0, z); x += s;"),
    taken("let z = mix(0.25, 0.75, 0.5) + smoothstep(1.0, 0.0, 0.5); x += z;"),
    taken("let z = ldexp(0.5, 2) + quantizeToF16(0.1); x += z;"),
    taken("const z = bitcast<f32>(0x3f000000u); x += z;"),
    taken("const m = transpose(mat2x2f(1, 2, 3, 4)); x += m[0].y + determinant(m);"),
    taken("const z = unpack4x8unorm(0xff00ff00u); x += z.y;"),
    taken("const z = pack4x8unorm(vec4f(0.5)); x += f32(z & 1u);"),
    taken("const z = reflect(vec2f(1, 0), vec2f(0, 1)); x += z.x;"),
    taken("const z = faceForward(vec2f(1, 0), vec2f(0, 1), vec2f(1, 1)); x += z.x;"),
    taken("const z = ldexp(0.5, 2); const s = quantizeToF16(0.1); x += z + s;"),
    taken(
        "const z = extractBits(0xf0u, 4u, 4u); const s = insertBits(0, 3, 1u, 2u); x += f32(z) + f32(s);",
    ),
    taken("const n = i32(mix(1.0, 3.0, 0.5)); var t = array<f32, n>(); x += t[1];"),
    taken(
        "{ const k = 2.0; const z = mix(k, 4.0, 0.5); x += z; } { const k = 1.0; const z = mix(k, 4.0, 0.5); x += z; }",
    ),
    declared(
        "const M = transpose(mat2x3f(vec3f(1), vec3f(2))); const N = M[0].x * mix(A, 1.0, 0.5); const A = bitcast<f32>(B); const B = 0x3f000000u;",
    ),
    declared(
        "struct S { k: f32 } const S1 = S(mix(0.0, 1.0, 0.5)); alias F = f32; const G = mix(F(1), F(2), F(0.5));",
    ),
    taken("@diagnostic(off, derivative_uniformity) if p { x = dpdx(y); }"),
    taken("if p @diagnostic(off, derivative_uniformity) { x = dpdx(y); }"),
    taken("@diagnostic(off, derivative_uniformity) for (var i = 0; i < a; i++) { x = dpdx(y); }"),
    taken("@diagnostic(off, derivative_uniformity) while x < 3.0 { x += 1.0 + abs(dpdx(y)); }"),
    taken(
        "@diagnostic(off, derivative_uniformity) loop { x += 1.0 + abs(dpdx(y)); if x > 3.0 { break; } }",
    ),
    taken(
        "@diagnostic(off, derivative_uniformity) switch a { case 1: { x = dpdx(y); } default: {} }",
    ),
    taken("@diagnostic(off, derivative_uniformity) { if p { x = dpdx(y); } }"),
    taken(
        "switch a { case 1: @diagnostic(off, derivative_uniformity) { x = dpdx(y); } default: {} }",
    ),
    taken("f.xy = w; f.zyx += vec3f(1.0, 2.0, x); w.yx = w;"),
    taken("var t = array<vec4f, 2>(f, f); t[a & 1].yz += w; x += t[0].y;"),
    taken(
        "x = smoothstep(0, 4, 1) + y; x *= mix(0, 3, 0.5); x += transpose(mat2x2(1, 2, 3, 4))[0].y;",
    ),
    taken("const k = 3; { const k = 5.0; x = mix(0.0, k, 0.5); }"),
    taken("const z = frexp(3.0).exp; x = f32(z); const s = modf(2.5).fract; y += s;"),
    taken("const_assert 1 + 1 == 2; const_assert (1 + 1) == 2; const_assert(3 > 2);"),
    declared("const_assert mix(0.0, 1.0, 0.5) == 0.5; const_assert (2 + 1) * 2 == 6;"),
    refused("const_assert (1 + 1) == 3;", "const_assert"),
    refused("let k = x; const z = mix(0.0, k, 0.5); x = z;", ""),
    refused("f.xx = w;", "invalid left-hand side"),
    refused("const z = mix(x, 1.0, 0.5); x = z;", ""),
];
