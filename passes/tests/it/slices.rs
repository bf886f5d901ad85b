//! What slices keep and drop, and what they look like as code.

use naga::ShaderStage;
use naga_edit::interface;
use preshade_dataflow::graph::{self, FunctionId, Graph};
use preshade_dataflow::slice::{self, Criterion, OutputFilter, Termination};
use preshade_passes::rebuild::place::{self, PositionInvariance};
use preshade_plan::program::Program;

use crate::common;

fn sliced(program: &Program, stage: ShaderStage, name: &str, criteria: &[Criterion]) -> Program {
    let graph = Graph::build(program);
    let (entry, _) = program.entry_point(stage, name).unwrap();
    let slice = slice::backward(&graph, entry, criteria);
    let placed = place::entry_point(
        &graph,
        &slice,
        program.module(),
        "sliced",
        "depth",
        PositionInvariance::AsWritten,
    );
    common::validated(program, placed.clone());
    common::validated(program, place::retain(&placed, &[(stage, "sliced")]))
}

fn position(source: &str) -> String {
    common::wgsl(&sliced(
        &common::program(source),
        ShaderStage::Vertex,
        "vs",
        &[Criterion::Output(OutputFilter::Position)],
    ))
}

fn discard(source: &str) -> String {
    common::wgsl(&sliced(
        &common::program(source),
        ShaderStage::Fragment,
        "fs",
        &[
            Criterion::Discard,
            Criterion::Output(OutputFilter::FragDepth),
        ],
    ))
}

const LIT: &str = "
struct Camera { view: mat4x4<f32>, projection: mat4x4<f32>, time: f32 }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<uniform> light: vec4<f32>;
struct VertexInput { @location(0) position: vec3<f32>, @location(1) normal: vec3<f32>, \
    @location(2) uv: vec2<f32> }
struct VertexOutput { @builtin(position) clip: vec4<f32>, @location(0) normal: vec3<f32>, \
    @location(1) uv: vec2<f32>, @location(2) glow: f32 }
fn noise(p: vec3<f32>) -> f32 {
    var sum = 0.0;
    for (var i = 0; i < 8; i++) { sum += sin(p.x * f32(i)) * light.w; }
    return sum;
}
fn wave(p: vec3<f32>) -> vec3<f32> { return p + vec3(0.0, sin(camera.time + p.x), 0.0); }
@vertex fn vs(in: VertexInput, @builtin(instance_index) instance: u32) -> VertexOutput {
    var out: VertexOutput;
    let world = wave(in.position);
    out.glow = noise(in.position) + f32(instance);
    out.normal = in.normal;
    out.uv = in.uv;
    out.clip = camera.projection * camera.view * vec4(world, 1.0);
    return out;
}
@group(1) @binding(0) var albedo: texture_2d<f32>;
@group(1) @binding(1) var smp: sampler;
struct Surface { color: vec3<f32>, alpha: f32 }
fn surface(in: VertexOutput) -> Surface {
    let texel = textureSample(albedo, smp, in.uv);
    return Surface(texel.rgb * noise(in.normal), texel.a);
}
@fragment fn fs(in: VertexOutput) -> @location(0) vec4<f32> {
    let s = surface(in);
    if s.alpha < 0.5 { discard; }
    return vec4(s.color * in.glow, 1.0);
}
";

#[test]
fn position_slice_of_a_lit_material() {
    insta::assert_snapshot!(position(LIT));
}

#[test]
fn discard_slice_of_a_lit_material() {
    insta::assert_snapshot!(discard(LIT));
}

fn fragment(source: &str, filter: OutputFilter) -> String {
    common::wgsl(&sliced(
        &common::program(source),
        ShaderStage::Fragment,
        "fs",
        &[Criterion::Output(filter)],
    ))
}

#[test]
fn a_loop_with_an_early_return_keeps_the_return() {
    let text = fragment(
        "@fragment fn fs(@location(0) x: f32) -> @location(0) f32 {
            var sum = 0.0; var unused = 1.0;
            for (var i = 0; i < 8; i++) {
                unused *= sin(x);
                if sum > x { return sum; }
                sum += 0.5;
            }
            return -1.0;
        }",
        OutputFilter::All,
    );
    insta::assert_snapshot!(text);
}

#[test]
fn a_break_decides_what_comes_after_it() {
    let text = fragment(
        "struct O { @location(0) a: f32, @location(1) b: f32 }
        @fragment fn fs(@location(0) x: f32, @location(1) y: f32) -> O {
            var o: O;
            for (var i = 0; i < 8; i++) {
                o.b += sin(y);
                if x < f32(i) { break; }
                o.a = f32(i);
            }
            return o;
        }",
        OutputFilter::Location(0),
    );
    assert!(text.contains("break"), "{text}");
    assert!(!text.contains("sin("), "{text}");
    assert!(
        text.contains("fn sliced(@location(0) x: f32) -> @location(0) f32"),
        "{text}"
    );
}

#[test]
fn a_continue_decides_what_it_skips() {
    let text = fragment(
        "@fragment fn fs(@location(0) x: f32) -> @location(0) f32 {
            var sum = 0.0; var other = 0.0;
            for (var i = 0; i < 8; i++) {
                if (i & 1) == 0 { continue; }
                if i == 5 { other = 1.0; continue; }
                sum += x;
            }
            return sum;
        }",
        OutputFilter::All,
    );
    assert_eq!(text.matches("continue;").count(), 2, "{text}");
    assert!(!text.contains("other"), "{text}");
}

#[test]
fn a_loop_that_decides_nothing_is_gone_unless_termination_is_preserved() {
    let program = common::program(
        "@fragment fn fs(@location(0) x: f32) -> @location(0) f32 {
            var k = x;
            loop { if k > 100.0 { break; } k = k * 2.0; }
            return x + 1.0;
        }",
    );
    let graph = Graph::build(&program);
    let criteria = [Criterion::Output(OutputFilter::All)];
    let assumed = slice::backward(&graph, 0, &criteria);
    let preserved = slice::backward_with(&graph, 0, &criteria, Termination::Preserved);
    assert_eq!(assumed.statement_count(&graph), 1);
    assert!(preserved.is_whole());
    assert!(assumed.cost < preserved.cost);
    assert_ne!(assumed.hash(&graph), preserved.hash(&graph));
}

#[test]
fn a_switch_that_falls_through_keeps_the_cases_it_comes_from() {
    // WGSL has no fall-through: the flag is set in the IR.
    let source = "@fragment fn fs(@location(0) @interpolate(flat) k: i32, @location(1) x: f32) -> \
                  @location(0) f32 {
        var a = 0.0; var b = 0.0;
        switch k {
            case 0: { a = x; b = sin(x); }
            case 1: { a += 1.0; }
            case 2: { b = 2.0; }
            default: { a = 5.0; }
        }
        return a;
    }";
    let program = common::program(source);
    let mut module = program.module().clone();
    for statement in module.entry_points[0].function.body.iter_mut() {
        if let naga::Statement::Switch { cases, .. } = statement {
            cases[0].fall_through = true;
        }
    }
    let program = common::validated(&program, module);
    let graph = Graph::build(&program);
    let slice = slice::backward(&graph, 0, &[Criterion::Output(OutputFilter::All)]);
    let f = graph.function(FunctionId::EntryPoint(0));
    let kept: Vec<String> = f
        .statements
        .iter()
        .filter(|(id, n)| {
            slice.root().kept.statements[id.index()]
                && matches!(n.statement, naga::Statement::Store { .. })
        })
        .map(|(id, _)| graph::text::statement(program.module(), f, id))
        .collect();
    assert_eq!(kept, ["a = x", "a = (a + 1.0)", "a = 5.0"]);
}

#[test]
fn a_discard_in_a_callee_brings_what_decides_it() {
    let text = discard(
        "@group(0) @binding(0) var t: texture_2d<f32>; @group(0) @binding(1) var s: sampler;
        struct V { @location(0) uv: vec2<f32>, @location(1) n: vec3<f32> }
        fn clip(alpha: f32, shade: f32) -> f32 {
            if alpha < 0.5 { discard; }
            return shade * 2.0;
        }
        fn lit(v: V) -> vec4<f32> {
            let c = textureSample(t, s, v.uv);
            let l = dot(v.n, vec3(0.0, 1.0, 0.0));
            return c * clip(c.a, l);
        }
        @fragment fn fs(v: V) -> @location(0) vec4<f32> { return lit(v); }",
    );
    insta::assert_snapshot!(text);
}

#[test]
fn a_frag_depth_slice_returns_the_depth_alone() {
    let text = discard(
        "struct O { @location(0) c: vec4<f32>, @builtin(frag_depth) d: f32 }
        @fragment fn fs(@builtin(position) p: vec4<f32>, @location(0) c: vec4<f32>) -> O {
            if c.a == 0.0 { discard; }
            return O(c * 2.0, p.z + 0.1);
        }",
    );
    assert!(text.contains("-> @builtin(frag_depth) f32"), "{text}");
    assert!(!text.contains("* 2"), "{text}");
    assert!(text.contains("discard"), "{text}");
}

#[test]
fn two_calls_with_different_demands_become_two_functions() {
    let text = fragment(
        "struct P { a: f32, b: f32 }
        fn pair(x: f32) -> P { return P(sin(x), cos(x)); }
        @fragment fn fs(@location(0) x: f32) -> @location(0) f32 {
            let one = pair(x); let two = pair(x + 1.0);
            return one.a + two.b;
        }",
        OutputFilter::All,
    );
    assert!(text.contains("fn pair_depth("), "{text}");
    assert!(text.contains("fn pair_depth_b("), "{text}");
}

#[test]
fn stores_through_pointers_and_private_globals_are_followed() {
    let text = fragment(
        "var<private> color: vec3<f32>; var<private> noise: f32;
        fn put(p: ptr<function, f32>, v: f32) { *p = v; noise = sin(v); color.x = v * 2.0; }
        @fragment fn fs(@location(0) x: f32) -> @location(0) vec4<f32> {
            var a = 0.0; var b = 0.0;
            put(&a, x); put(&b, x + 1.0);
            return vec4(color, b);
        }",
        OutputFilter::All,
    );
    assert!(!text.contains("sin("), "{text}");
    assert!(!text.contains("var a"), "{text}");
    insta::assert_snapshot!(text);
}

#[test]
fn a_slice_of_everything_is_whole_and_reuses_every_function() {
    let program = common::program(LIT);
    let graph = Graph::build(&program);
    let slice = slice::backward(&graph, 0, &[Criterion::Output(OutputFilter::All)]);
    assert!(slice.is_whole());
    let placed = place::entry_point(
        &graph,
        &slice,
        program.module(),
        "again",
        "x",
        PositionInvariance::AsWritten,
    );
    assert_eq!(placed.functions.len(), program.module().functions.len());
    common::validated(&program, placed);
}

fn alpha(source: &str) -> String {
    common::wgsl(&sliced(
        &common::program(source),
        ShaderStage::Fragment,
        "fs",
        &[Criterion::Component(OutputFilter::Location(0), 3)],
    ))
}

#[test]
fn an_alpha_slice_computes_no_colour() {
    for body in [
        "return vec4(color(x), x.w * 2.0);",
        "let c = vec4(color(x), x.w); return c * vec4(vec3(2.0), 2.0);",
        "var c = vec4(color(x), x.w); c.a = c.a * 2.0; return c;",
        "var c: vec4<f32>; c = vec4(color(x), x.w); return mix(c, -c, 0.5);",
        "return select(vec4(color(x), 1.0), vec4(x.w), vec4<bool>(true, false, true, x.w > 0.5));",
        "return vec4(vec4(color(x), x.w).wwwx.ab, vec4(color(x), x.w).xw).xyzw;",
    ] {
        let text = alpha(&format!(
            "fn color(x: vec4<f32>) -> vec3<f32> {{ return sin(x.xyz); }}
            @fragment fn fs(@location(0) x: vec4<f32>) -> @location(0) vec4<f32> {{ {body} }}"
        ));
        assert!(!text.contains("sin("), "{body}\n{text}");
        assert!(text.contains("x.w"), "{body}\n{text}");
    }
}

#[test]
fn an_alpha_slice_keeps_what_mixes_components() {
    for body in [
        "return normalize(vec4(sin(x.x), x.yzw));",
        "return mat4x4(x, x, x, x) * vec4(sin(x.x), x.yzw);",
        "return vec4(sin(x.x), x.yzw).wzyx;",
        "var c = vec4(sin(x.x), x.yzw); c[u32(x.y)] = 1.0; return c.wzyx;",
    ] {
        let text = alpha(&format!(
            "@fragment fn fs(@location(0) x: vec4<f32>) -> @location(0) vec4<f32> {{ {body} }}"
        ));
        assert!(text.contains("sin("), "{body}\n{text}");
    }
}

#[test]
fn the_hash_does_not_see_names_or_unrelated_code() {
    let hash = |source: &str| {
        let program = common::program(source);
        let graph = Graph::build(&program);
        let (entry, _) = program.entry_point(ShaderStage::Fragment, "fs").unwrap();
        slice::backward(&graph, entry, &[Criterion::Output(OutputFilter::All)]).hash(&graph)
    };
    let one = hash(
        "@fragment fn fs(@location(0) x: f32) -> @location(0) f32 { let y = x * 2.0; \
         return y + 1.0; }",
    );
    let other = hash(
        "struct Unused { a: mat4x4<f32> } fn unused(u: Unused) -> f32 { return u.a[0].x; }
        @fragment fn fs(@location(0) value: f32) -> @location(0) f32 { var dead = sin(value); \
            return value * 2.0 + 1.0; }",
    );
    let changed = hash(
        "@fragment fn fs(@location(0) x: f32) -> @location(0) f32 { let y = x * 2.5; \
         return y + 1.0; }",
    );
    assert_eq!(one.len(), 16);
    assert_eq!(one, other);
    assert_ne!(one, changed);
}

#[test]
fn an_invariant_position_is_marked() {
    let program = common::program(LIT);
    let marked = common::validated(
        &program,
        interface::with_invariant_position(program.module(), 0),
    );
    assert!(common::wgsl(&marked).contains("@invariant"));
    let graph = Graph::build(&program);
    let slice = slice::backward(&graph, 0, &[Criterion::Output(OutputFilter::Position)]);
    let placed = place::entry_point(
        &graph,
        &slice,
        program.module(),
        "vs_depth",
        "depth",
        PositionInvariance::Invariant,
    );
    let placed = place::retain(&placed, &[(ShaderStage::Vertex, "vs_depth")]);
    assert!(common::wgsl(&common::validated(&program, placed)).contains("@invariant"));
}

#[test]
fn discards_are_taken_out_of_callees_too() {
    let program = common::program(
        "fn clip(a: f32) -> f32 { if a < 0.5 { discard; } return a; }
        fn other(a: f32) -> f32 { return a; }
        @fragment fn fs(@location(0) a: f32) -> @location(0) f32 { if a > 2.0 { \
            discard; } return clip(a) + other(a); }",
    );
    let module = place::without_discard(program.module(), 0);
    let module = place::retain(&module, &[(ShaderStage::Fragment, "fs")]);
    let text = common::wgsl(&common::validated(&program, module));
    assert!(!text.contains("discard;"), "{text}");
    assert!(!text.contains("if "), "{text}");
    assert!(text.contains("fn other("), "{text}");
}

#[test]
fn a_prologue_stands_before_all_else() {
    let program = common::program(LIT);
    let (entry, _) = program.entry_point(ShaderStage::Fragment, "fs").unwrap();
    let module = place::prologue(program.module(), entry, |b| {
        let scalar = naga::Scalar::F32;
        let vec4 = b.ty(naga::TypeInner::Vector {
            size: naga::VectorSize::Quad,
            scalar,
        });
        let position = b.input(
            "position",
            vec4,
            &naga::Binding::BuiltIn(naga::BuiltIn::Position { invariant: false }),
        );
        let z = b.named(
            "depth",
            naga::Expression::AccessIndex {
                base: position,
                index: 2,
            },
        );
        let limit = b.literal(naga::Literal::F32(0.5));
        let behind = b.expression(naga::Expression::Binary {
            op: naga::BinaryOperator::Greater,
            left: z,
            right: limit,
        });
        b.if_then(behind, |b| b.statement(naga::Statement::Kill));
    });
    let module = place::retain(&module, &[(ShaderStage::Fragment, "fs")]);
    insta::assert_snapshot!(common::wgsl(&common::validated(&program, module)));
}

#[test]
fn retaining_drops_constants_nobody_uses() {
    let text = discard(
        "const LIMIT = 0.5f; const BRIGHT = vec3<f32>(1.0, 2.0, 3.0); const COUNT: u32 = 3u; \
         const TWICE: u32 = COUNT * 2u;
        @fragment fn fs(@location(0) x: vec4<f32>, @location(1) @interpolate(flat) n: u32) -> \
            @location(0) vec4<f32> {
            if x.w < LIMIT { discard; }
            return vec4(x.rgb * BRIGHT, f32(n + TWICE));
        }",
    );
    for gone in ["BRIGHT", "COUNT", "TWICE"] {
        assert!(!text.contains(gone), "{text}");
    }
}

#[test]
fn a_value_in_a_callee_keeps_the_calls_that_lead_to_it() {
    let program = common::program(
        "fn inner(x: f32, y: f32) -> f32 { let wanted = sin(x); return wanted + cos(y); }
        fn other(x: f32) -> f32 { return exp(x); }
        @fragment fn fs(@location(0) x: f32, @location(1) y: f32) -> @location(0) f32 {
            if y > 0.0 { return inner(x * 2.0, y); }
            return other(y);
        }",
    );
    let graph = Graph::build(&program);
    let (inner, function) = program
        .module()
        .functions
        .iter()
        .find(|(_, f)| f.name.as_deref() == Some("inner"))
        .unwrap();
    let (expression, _) = function
        .named_expressions
        .iter()
        .find(|(_, name)| *name == "wanted")
        .unwrap();
    let slice = slice::backward(
        &graph,
        0,
        &[Criterion::Value {
            function: FunctionId::Function(inner),
            expression: *expression,
        }],
    );
    assert_eq!(slice.inputs, [0, 1]);
    let parts: Vec<String> = slice.parts.iter().map(|p| graph.name(p.function)).collect();
    assert_eq!(parts, ["inner", "fs"]);
    assert_eq!(
        slice.parts[0]
            .kept
            .arguments
            .iter()
            .filter(|a| a.is_some())
            .count(),
        1
    );
    let placed = place::entry_point(
        &graph,
        &slice,
        program.module(),
        "wanted",
        "cut",
        PositionInvariance::AsWritten,
    );
    common::validated(&program, placed);
}
