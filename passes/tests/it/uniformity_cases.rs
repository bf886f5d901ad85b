//! The cases: a line of each says what decides, and what WGSL's section 15.2 makes of it.

/// What the rules say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Whatever needs uniform control flow has it.
    Uniform,
    /// Something may not have it.
    MayBeNonUniform,
}

/// A body of a fragment stage, and what stands ahead of it.
pub struct Case {
    /// The rule, and the case of it.
    pub name: &'static str,
    pub declarations: &'static str,
    pub body: &'static str,
    pub verdict: Verdict,
}

use Verdict::{MayBeNonUniform, Uniform};

/// The whole module.
pub fn text(case: &Case) -> String {
    format!(
        "@group(0) @binding(0) var<uniform> u: vec4<f32>;
@group(0) @binding(1) var<storage, read> ro: array<f32>;
@group(0) @binding(2) var<storage, read_write> rw: array<f32>;
@group(0) @binding(3) var t: texture_2d<f32>;
@group(0) @binding(4) var s: sampler;
var<private> p: f32;
{}
@fragment
fn fs(@location(0) v: f32, @location(1) @interpolate(flat) n: i32) -> @location(0) vec4<f32> {{
    var out = 0.0;
    {}
    return vec4(out);
}}
",
        case.declarations, case.body
    )
}

const fn case(
    verdict: Verdict,
    name: &'static str,
    declarations: &'static str,
    body: &'static str,
) -> Case {
    Case {
        name,
        declarations,
        body,
        verdict,
    }
}

pub const CASES: &[Case] = &[
    case(
        Uniform,
        "inputs: a constant decides",
        "",
        "if 1 < 2 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "inputs: an override decides",
        "override steps: i32 = 2;",
        "if steps > 1 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "inputs: a uniform decides",
        "",
        "if u.x > 0.5 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "inputs: a read-only buffer decides, at a uniform index",
        "",
        "if ro[i32(u.y)] > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "inputs: a read-only buffer decides, at an index of the fragment",
        "",
        "if ro[n] > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "inputs: a written buffer decides",
        "",
        "if rw[0] > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "inputs: a private variable decides",
        "",
        "if p > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "inputs: a private variable decides that was just set",
        "",
        "p = 1.0; if p > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "inputs: a varying decides",
        "",
        "if v > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "inputs: a flat varying decides",
        "",
        "if n > 1 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "inputs: the length of an array decides",
        "",
        "if arrayLength(&ro) > 4u { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "inputs: the size of a texture decides",
        "",
        "if textureDimensions(t).x > 4u { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "inputs: a texel at uniform coordinates decides",
        "",
        "if textureLoad(t, vec2(1, 2), 0).x > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "inputs: a texel at the fragment's coordinates decides",
        "",
        "if textureLoad(t, vec2(n), 0).x > 0.5 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "inputs: a sample at a given level, of uniform coordinates, decides",
        "",
        "if textureSampleLevel(t, s, u.xy, 0.0).x > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "inputs: a derivative decides",
        "",
        "if dpdy(u.x) > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "inputs: an implicit sample decides",
        "",
        "if textureSample(t, s, u.xy).x > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "needs: a derivative in a branch of the fragment",
        "",
        "if v > 0.5 { out += dpdy(v); }",
    ),
    case(
        MayBeNonUniform,
        "needs: a fine derivative in a branch of the fragment",
        "",
        "if v > 0.5 { out += fwidthFine(v); }",
    ),
    case(
        MayBeNonUniform,
        "needs: a coarse derivative in a branch of the fragment",
        "",
        "if v > 0.5 { out += dpdxCoarse(v); }",
    ),
    case(
        MayBeNonUniform,
        "needs: an implicit sample in a branch of the fragment",
        "",
        "if v > 0.5 { out += textureSample(t, s, vec2(v)).x; }",
    ),
    case(
        MayBeNonUniform,
        "needs: a biased sample in a branch of the fragment",
        "",
        "if v > 0.5 { out += textureSampleBias(t, s, vec2(v), 1.0).x; }",
    ),
    case(
        Uniform,
        "needs: a sample at a given level in a branch of the fragment needs nothing",
        "",
        "if v > 0.5 { out += textureSampleLevel(t, s, vec2(v), 1.0).x; }",
    ),
    case(
        Uniform,
        "needs: a sample with given gradients in a branch of the fragment needs nothing",
        "",
        "if v > 0.5 { out += textureSampleGrad(t, s, vec2(v), vec2(v), vec2(v)).x; }",
    ),
    case(
        Uniform,
        "needs: a gather in a branch of the fragment needs nothing",
        "",
        "if v > 0.5 { out += textureGather(0, t, s, vec2(v)).x; }",
    ),
    case(
        Uniform,
        "needs: a load in a branch of the fragment needs nothing",
        "",
        "if v > 0.5 { out += textureLoad(t, vec2(n), 0).x; }",
    ),
    case(
        Uniform,
        "needs: arithmetic in a branch of the fragment needs nothing",
        "",
        "if v > 0.5 { out += sqrt(v); }",
    ),
    case(
        Uniform,
        "if: behind a branch of the fragment",
        "",
        "if v > 0.5 { out = 1.0; } out += dpdx(v);",
    ),
    case(
        MayBeNonUniform,
        "if: in the other branch",
        "",
        "if v > 0.5 { out = 1.0; } else { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "if: in a uniform branch within one of the fragment",
        "",
        "if v > 0.5 { if u.x > 0.5 { out += dpdx(v); } }",
    ),
    case(
        MayBeNonUniform,
        "if: behind a return of some fragments",
        "",
        "if v > 0.5 { return vec4(0.0); } out += dpdx(v);",
    ),
    case(
        Uniform,
        "if: behind a return of all or none",
        "",
        "if u.x > 0.5 { return vec4(0.0); } out += dpdx(v);",
    ),
    case(
        Uniform,
        "if: ahead of a return of some fragments",
        "",
        "out += dpdx(v); if v > 0.5 { return vec4(0.0); }",
    ),
    case(
        Uniform,
        "if: behind a discard of some fragments",
        "",
        "if v > 0.5 { discard; } out += dpdx(v);",
    ),
    case(
        MayBeNonUniform,
        "if: in the branch that discards",
        "",
        "if v > 0.5 { discard; out += dpdx(v); }",
    ),
    case(
        Uniform,
        "if: behind a return that ends both branches",
        "",
        "if v > 0.5 { return vec4(0.0); } else { return vec4(1.0); }",
    ),
    case(
        MayBeNonUniform,
        "variables: set in a branch of the fragment",
        "",
        "var x = 0.0; if v > 0.5 { x = 1.0; } if x > 0.5 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "variables: set in a uniform branch",
        "",
        "var x = 0.0; if u.x > 0.5 { x = 1.0; } if x > 0.5 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "variables: set anew behind the branch",
        "",
        "var x = v; x = u.x; if x > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "variables: set anew in one branch alone",
        "",
        "var x = v; if u.x > 0.5 { x = 1.0; } if x > 0.5 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "variables: set anew in both branches",
        "",
        "var x = v; if u.x > 0.5 { x = 1.0; } else { x = 2.0; } if x > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "variables: one component of the fragment, another decides",
        "",
        "var x = vec2(0.0); x.x = v; if x.y > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "variables: an element of the fragment, another decides",
        "",
        "var x = array(0.0, 1.0); x[0] = v; if x[1] > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "variables: an element at an index of the fragment",
        "",
        "var x = array(0.0, 0.0); x[n] = 1.0; if x[0] > 0.5 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "variables: the whole set anew",
        "",
        "var x = vec2(v); x = vec2(u.x); if x.y > 0.5 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "variables: a let of the fragment that nothing uses",
        "",
        "let x = v; if u.x > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "variables: through a pointer",
        "",
        "var x = 0.0; let at = &x; *at = v; if x > 0.5 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "variables: swapped",
        "",
        "var x = v; var y = u.x; let z = x; x = y; y = z; if x > 0.5 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "variables: added to, and set on the way to a return",
        "",
        "var x = 0.0; if v > 0.5 { x = v; return vec4(x); } if x > 0.5 { out = 1.0; }",
    ),
    case(
        Uniform,
        "loops: of constant turns",
        "",
        "for (var i = 0; i < 4; i++) { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "loops: of uniform turns",
        "",
        "for (var i = 0; i < i32(u.x); i++) { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "loops: of turns of the fragment",
        "",
        "for (var i = 0; i < n; i++) { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "loops: behind one of turns of the fragment",
        "",
        "for (var i = 0; i < n; i++) { out += 1.0; } out += dpdx(v);",
    ),
    case(
        MayBeNonUniform,
        "loops: a counter of the fragment behind it",
        "",
        "var i = 0; while i < n { i++; } if i > 3 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "loops: ahead of a break of the fragment, and so in the next turn",
        "",
        "loop { out += dpdx(v); if v > out { break; } }",
    ),
    case(
        Uniform,
        "loops: behind a uniform break",
        "",
        "for (var i = 0; i < 9; i++) { if u.x > f32(i) { break; } out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "loops: behind a continue of the fragment",
        "",
        "for (var i = 0; i < 4; i++) { if v > f32(i) { continue; } out += dpdx(v); }",
    ),
    case(
        Uniform,
        "loops: behind a loop with a continue of the fragment",
        "",
        "for (var i = 0; i < 4; i++) { if v > f32(i) { continue; } out += 1.0; } out += dpdx(v);",
    ),
    case(
        MayBeNonUniform,
        "loops: in the continuing part, behind a continue of the fragment",
        "",
        "var i = 0; loop { if v > f32(i) { continue; } out += 1.0; continuing { out += dpdx(v); \
         i++; break if i > 3; } }",
    ),
    case(
        Uniform,
        "loops: a uniform break-if",
        "",
        "var i = 0; loop { out += dpdx(v); continuing { i++; break if i > i32(u.x); } }",
    ),
    case(
        MayBeNonUniform,
        "loops: a break-if of the fragment",
        "",
        "var i = 0; loop { out += dpdx(v); continuing { i++; break if i > n; } }",
    ),
    case(
        MayBeNonUniform,
        "loops: behind a return of some fragments within",
        "",
        "for (var i = 0; i < 4; i++) { if v > f32(i) { return vec4(0.0); } } out += dpdx(v);",
    ),
    case(
        MayBeNonUniform,
        "loops: a value that becomes the fragment's in the turn before",
        "",
        "var x = 0.0; for (var i = 0; i < 4; i++) { if x > 0.5 { out += dpdx(v); } x = v; }",
    ),
    case(
        Uniform,
        "loops: a value that is the fragment's for a while",
        "",
        "var x = 0.0; for (var i = 0; i < 4; i++) { x = v; out += x; x = u.x; if x > 0.5 { \
         out += dpdx(v); } }",
    ),
    case(
        Uniform,
        "loops: one within another, of turns of the fragment",
        "",
        "for (var i = 0; i < 4; i++) { for (var j = 0; j < n; j++) { \
         out += 1.0; } out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "loops: a value set ahead of a break of the fragment",
        "",
        "var x = 0.0; loop { if v > 0.5 { x = 1.0; break; } break; } if x > 0.5 { \
         out += dpdx(v); }",
    ),
    case(
        Uniform,
        "switch: by a uniform",
        "",
        "switch i32(u.x) { case 1: { out += dpdx(v); } default: { } }",
    ),
    case(
        MayBeNonUniform,
        "switch: by the fragment",
        "",
        "switch n { case 1: { out += dpdx(v); } default: { } }",
    ),
    case(
        Uniform,
        "switch: behind one by the fragment",
        "",
        "switch n { case 1: { out = 1.0; } default: { } } out += dpdx(v);",
    ),
    case(
        MayBeNonUniform,
        "switch: behind one by the fragment that returns",
        "",
        "switch n { case 1: { return vec4(0.0); } default: { } } out += dpdx(v);",
    ),
    case(
        MayBeNonUniform,
        "switch: behind a break of the fragment within a case",
        "",
        "switch i32(u.x) { case 1: { if v > 0.5 { break; } out += dpdx(v); } default: { } }",
    ),
    case(
        Uniform,
        "switch: a break of the fragment, behind the switch",
        "",
        "switch i32(u.x) { case 1: { if v > 0.5 { break; } out = 1.0; } default: { } } out += \
         dpdx(v);",
    ),
    case(
        MayBeNonUniform,
        "switch: a value of the case",
        "",
        "var x = 0.0; switch n { case 1: { x = 1.0; } default: { x = 2.0; } } if x > 1.0 { \
         out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "short circuits: behind a conjunct of the fragment",
        "",
        "if v > 0.5 && dpdx(v) > 0.0 { out = 1.0; }",
    ),
    case(
        Uniform,
        "short circuits: ahead of a conjunct of the fragment",
        "",
        "if dpdx(v) > 0.0 && v > 0.5 { out = 1.0; }",
    ),
    case(
        Uniform,
        "short circuits: behind a uniform conjunct",
        "",
        "if u.x > 0.5 && dpdx(v) > 0.0 { out = 1.0; }",
    ),
    case(
        MayBeNonUniform,
        "short circuits: behind a disjunct of the fragment",
        "",
        "if v > 0.5 || dpdx(v) > 0.0 { out = 1.0; }",
    ),
    case(
        Uniform,
        "short circuits: a whole conjunction behind another statement",
        "",
        "let both = v > 0.5 && u.x > 0.5; out += dpdx(v); out += f32(both);",
    ),
    case(
        Uniform,
        "short circuits: without one, by &",
        "",
        "if (v > 0.5) & (dpdx(v) > 0.0) { out = 1.0; }",
    ),
    case(
        Uniform,
        "selection: select evaluates both",
        "",
        "out = select(0.0, dpdx(v), v > 0.5);",
    ),
    case(
        MayBeNonUniform,
        "calls: of what needs it, in a branch of the fragment",
        "fn slope(x: f32) -> f32 { return dpdx(x); }",
        "if v > 0.5 { out = slope(v); }",
    ),
    case(
        Uniform,
        "calls: of what needs it, at the top",
        "fn slope(x: f32) -> f32 { return dpdx(x); }",
        "out = slope(v);",
    ),
    case(
        MayBeNonUniform,
        "calls: of what calls what needs it",
        "fn slope(x: f32) -> f32 { return dpdx(x); } fn twice(x: f32) -> f32 { \
         return slope(x) + slope(2.0 * x); }",
        "if v > 0.5 { out = twice(v); }",
    ),
    case(
        Uniform,
        "calls: a parameter decides, and is uniform",
        "fn chosen(by: f32, x: f32) -> f32 { if by > 0.5 { return dpdx(x); } return x; }",
        "out = chosen(u.x, v);",
    ),
    case(
        MayBeNonUniform,
        "calls: a parameter decides, and is the fragment's",
        "fn chosen(by: f32, x: f32) -> f32 { if by > 0.5 { return dpdx(x); } return x; }",
        "out = chosen(v, u.x);",
    ),
    case(
        Uniform,
        "calls: a result of a uniform parameter",
        "fn pick(a: f32, b: f32) -> f32 { return a; }",
        "if pick(u.x, v) > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "calls: a result of a parameter of the fragment",
        "fn pick(a: f32, b: f32) -> f32 { return a; }",
        "if pick(v, u.x) > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "calls: a result of one of two parameters, by a third",
        "fn one(by: f32) -> f32 { if by > 0.5 { return 1.0; } return 2.0; }",
        "if one(v) > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "calls: a result that is the fragment's whatever is passed",
        "fn own(x: f32) -> f32 { return x + rw[0]; }",
        "if own(u.x) > 0.5 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "calls: behind a return within the callee",
        "fn early(x: f32) -> f32 { if x > 0.5 { return 1.0; } return 2.0; }",
        "out = early(v); out += dpdx(v);",
    ),
    case(
        Uniform,
        "calls: behind a discard within the callee",
        "fn drop(x: f32) { if x > 0.5 { discard; } }",
        "drop(v); out += dpdx(v);",
    ),
    case(
        MayBeNonUniform,
        "calls: an argument that itself needs it, in a branch",
        "fn pick(a: f32, b: f32) -> f32 { return a; }",
        "if v > 0.5 { out = pick(dpdx(v), 1.0); }",
    ),
    case(
        Uniform,
        "pointers: a callee writes what is uniform",
        "fn put(to: ptr<function, f32>, x: f32) { *to = x; }",
        "var x = v; put(&x, u.x); if x > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "pointers: a callee writes what is the fragment's",
        "fn put(to: ptr<function, f32>, x: f32) { *to = x; }",
        "var x = u.x; put(&x, v); if x > 0.5 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "pointers: what is pointed to decides, and is uniform",
        "fn decided(by: ptr<function, f32>, x: f32) -> f32 { if *by > 0.5 { \
         return dpdx(x); } return x; }",
        "var x = u.x; out = decided(&x, v);",
    ),
    case(
        MayBeNonUniform,
        "pointers: what is pointed to decides, and is the fragment's",
        "fn decided(by: ptr<function, f32>, x: f32) -> f32 { if *by > 0.5 { \
         return dpdx(x); } return x; }",
        "var x = v; out = decided(&x, v);",
    ),
    case(
        MayBeNonUniform,
        "pointers: a callee writes in a branch of its parameter",
        "fn maybe(to: ptr<function, f32>, by: f32) { if by > 0.5 { *to = 1.0; } }",
        "var x = 0.0; maybe(&x, v); if x > 0.5 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "pointers: a callee leaves it as it is",
        "fn look(at: ptr<function, f32>) -> f32 { return *at; }",
        "var x = u.x; look(&x); if x > 0.5 { out += dpdx(v); }",
    ),
    case(
        Uniform,
        "pointers: one to another",
        "fn copy(to: ptr<function, f32>, other: ptr<function, f32>) { *to = *other; }",
        "var x = v; var y = u.x; copy(&x, &y); if x > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "pointers: the other to the one",
        "fn copy(to: ptr<function, f32>, other: ptr<function, f32>) { *to = *other; }",
        "var x = v; var y = u.x; copy(&y, &x); if y > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "pointers: passed on",
        "fn put(to: ptr<function, f32>, x: f32) { *to = x; } fn through(to: ptr<function, f32>, x: \
         f32) { put(to, x); }",
        "var x = u.x; through(&x, v); if x > 0.5 { out += dpdx(v); }",
    ),
    case(
        MayBeNonUniform,
        "phony: an assignment of what needs it",
        "",
        "if v > 0.5 { _ = dpdx(v); }",
    ),
    case(
        Uniform,
        "phony: an assignment of what needs it, at the top",
        "",
        "_ = dpdx(v);",
    ),
    case(
        Uniform,
        "dead: behind a return that all take",
        "",
        "out = 1.0; if u.x > 0.0 { return vec4(out); } else { return vec4(0.0); }",
    ),
];
