//! Rates, effects, control dependence, cost and the printed graph.

use naga::{Expression, ShaderStage, Statement};
use preshade_dataflow::graph::counted::{self, Ends};
use preshade_dataflow::graph::{FunctionId, Graph, text};

use crate::common;

/// The rate of each named value of the fragment stage, `name: rate`, with the stages that can have
/// it where not all can.
fn rates(source: &str, stage: ShaderStage) -> Vec<String> {
    let program = common::program(source);
    let graph = Graph::build(&program);
    let (entry, point) = program
        .module()
        .entry_points
        .iter()
        .enumerate()
        .find(|(_, e)| e.stage == stage)
        .unwrap();
    point
        .function
        .named_expressions
        .iter()
        .filter(|(e, _)| {
            !matches!(
                point.function.expressions[**e],
                Expression::FunctionArgument(_)
            )
        })
        .map(|(e, name)| {
            let fact = graph.fact(FunctionId::EntryPoint(entry), *e);
            let only = match (fact.stages.vertex, fact.stages.fragment) {
                (true, true) => "",
                (true, false) => " vertex-only",
                (false, true) => " fragment-only",
                (false, false) => " nowhere",
            };
            format!("{name}: {}{only}", fact.rate.name())
        })
        .collect()
}

#[test]
fn rates_of_fragment_values() {
    let got = rates(
        "struct U { color: vec4<f32>, k: i32 }
        @group(0) @binding(0) var<uniform> u: U;
        @group(0) @binding(1) var<storage, read> buffer: array<f32>;
        @group(0) @binding(2) var<storage, read_write> written: array<f32>;
        @group(0) @binding(3) var t: texture_2d<f32>;
        @group(0) @binding(4) var s: sampler;
        fn twice(x: f32) -> f32 { return x * 2.0; }
        fn pair(a: f32, b: f32) -> vec2<f32> { return vec2(a, b); }
        @fragment fn fs(@builtin(position) p: vec4<f32>, @builtin(front_facing) front: bool, \
            @builtin(sample_index) sample: u32,
            @location(0) uv: vec2<f32>, @location(1) @interpolate(linear) l: f32, @location(2) \
                @interpolate(flat) id: u32,
            @location(3) @interpolate(perspective, centroid) c: f32) -> @location(0) vec4<f32> {
            let per_sample = sin(1.0 + f32(sample));
            let uniform_value = u.color * 2.0;
            let by_uniform_index = buffer[u.k];
            let by_flat_index = buffer[id];
            let contended = written[0];
            let smooth_value = uv.x * u.color.x;
            let linear_value = l + 1.0;
            let mixed_value = uv.x + l;
            let centroids = uv.x + c;
            let flat_value = f32(id) * 2.0;
            let flat_and_smooth = f32(id) * uv.x;
            let facing = select(1.0, 2.0, front);
            let slope = dpdx(uv.x);
            let auto_lod = textureSample(t, s, uv);
            let chosen_lod = textureSampleLevel(t, s, uv, 0.0);
            let at_constant = textureSampleLevel(t, s, vec2(0.5), 0.0);
            let window = p.x;
            let called = twice(uv.y);
            let called_uniform = twice(u.color.y);
            var decided = 1.0;
            if uv.x > 0.5 { decided = u.color.z; }
            let by_control = decided * 1.0;
            var plain = u.color.w;
            let not_by_control = plain * 2.0;
            return vec4(per_sample + uniform_value.x + by_uniform_index + by_flat_index + \
                contended + smooth_value + linear_value + mixed_value
                + centroids + flat_value + flat_and_smooth + facing + slope + auto_lod.x + \
                    chosen_lod.x + at_constant.x + window + called
                + called_uniform + by_control + not_by_control);
        }",
        ShaderStage::Fragment,
    );
    insta::assert_snapshot!(got.join("\n"));
}

#[test]
fn rates_of_vertex_values() {
    let got = rates(
        "@group(0) @binding(0) var<uniform> m: mat4x4<f32>;
        @group(0) @binding(1) var<storage, read> instances: array<vec4<f32>>;
        @vertex fn vs(@builtin(instance_index) i: u32, @builtin(vertex_index) v: u32, \
            @location(0) p: vec3<f32>) -> @builtin(position) vec4<f32> {
            let camera = m * vec4(1.0);
            let offset = instances[i] * 2.0;
            let corner = f32(v) * 0.5;
            let world = offset + vec4(p, 1.0);
            return world + camera + corner;
        }",
        ShaderStage::Vertex,
    );
    assert_eq!(
        got,
        [
            "camera: draw",
            "offset: instance vertex-only",
            "corner: vertex vertex-only",
            "world: vertex vertex-only"
        ]
    );
}

/// Each statement that is no `Emit`, with what it is control-dependent on.
fn control(source: &str) -> String {
    let program = common::program(source);
    let graph = Graph::build(&program);
    let f = graph.function(FunctionId::EntryPoint(0));
    let line = |id| text::statement(program.module(), f, id);
    f.statements
        .iter()
        .filter(|(_, n)| !matches!(n.statement, Statement::Emit(_) | Statement::Block(_)))
        .map(|(id, _)| {
            let on: Vec<String> = f.control.of(id).iter().map(|p| line(*p)).collect();
            format!("{} <- {}", line(id), on.join(" | "))
        })
        .collect::<Vec<_>>()
        .join("\n")
}

#[test]
fn control_dependence_over_jumps() {
    insta::assert_snapshot!(control(
        "@fragment fn fs(@location(0) x: f32, @location(1) @interpolate(flat) k: i32) -> \
         @location(0) f32 {
            var a = 0.0;
            if x < 0.0 { return 1.0; }
            for (var i = 0; i < 4; i++) {
                if x > 3.0 { break; }
                if x > 2.0 { continue; }
                a = 2.0;
            }
            switch k {
                case 0: { a = 3.0; if x > 1.0 { break; } a = 4.0; }
                default: { if x > 5.0 { discard; } a = 6.0; }
            }
            return a;
        }"
    ));
}

/// Of each loop of the body, in order.
fn trips(body: &str) -> Vec<Option<u32>> {
    let program = common::program(&format!(
        "@fragment fn fs(@location(0) x: f32) -> @location(0) f32 {{ var a = 0.0;\n{body}\n\
         return a; }}"
    ));
    let graph = Graph::build(&program);
    let f = graph.function(FunctionId::EntryPoint(0));
    f.statements
        .iter()
        .filter(|(_, n)| matches!(n.statement, Statement::Loop { .. }))
        .map(|(id, _)| counted::trips(program.module(), f, id))
        .collect()
}

#[test]
fn trips_of_counted_loops() {
    let counted = trips(
        "for (var i = 0; i < 10; i++) { a += x; }
         for (var i = 16u; i > 1u; i = i - 3u) { a += x; }
         for (var i = 0; i < 10; i++) { for (var j = 0; j <= 2; j++) { a += x; } }
         for (var i = 0; f32(i) < x; i++) { a += x; }",
    );
    assert_eq!(counted, [Some(10), Some(5), Some(10), Some(3), None]);
}

/// A loop to the smaller of two numbers takes no more iterations than the one that is known.
#[test]
fn a_known_bound_of_two_is_enough() {
    let bodies = |bound: &str| {
        let text = format!(
            "@group(0) @binding(0) var<uniform> count: i32;
            @fragment fn fs() -> @location(0) f32 {{
                var a = 0.0; for (var i = 0; i < {bound}; i++) {{ a += 1.0; }} return a; }}"
        );
        let program = common::program(&text);
        let graph = Graph::build(&program);
        graph.ends(FunctionId::EntryPoint(0))
    };
    assert_eq!(bodies("min(count, 8)"), Ends::Always);
    assert_eq!(bodies("min(8, count)"), Ends::Always);
    assert_eq!(bodies("count"), Ends::Guarded);
    assert_eq!(bodies("max(count, 8)"), Ends::Unknown);
}

/// A counter that leaves its range comes in at the other end: the first of these never ends, others
/// end later than they seem to.
#[test]
fn a_counter_that_wraps_is_not_counted() {
    let counted = trips(
        "for (var i = 10u; i >= 0u; i -= 1u) { a += x; }
         for (var i = 4294967290u; i <= 4294967295u; i += 1u) { a += x; }
         for (var i = 2147483640i; i > 0; i += 4) { a += x; }
         for (var i = 1i; i > 0; i = i * 65536) { a += x; }
         for (var i = 4294967290u; i < 4294967295u; i += 1u) { a += x; }
         for (var i = -3i; i < 3; i += 1) { a += x; }",
    );
    assert_eq!(counted, [None, None, None, None, Some(5), Some(6)]);
}

#[test]
fn effects_go_up_through_calls() {
    let program = common::program(
        "@group(0) @binding(0) var<storage, read_write> log: array<u32>;
        struct O { @location(0) c: f32, @builtin(frag_depth) d: f32 }
        fn note(i: u32) { log[i] = 1u; }
        fn clip(a: f32) -> f32 { if a < 0.5 { discard; } return dpdx(a); }
        @fragment fn fs(@location(0) x: f32) -> O { note(0u); return O(clip(x), 0.5); }
        @vertex fn vs() -> @builtin(position) vec4<f32> { return vec4(0.0); }",
    );
    let graph = Graph::build(&program);
    let (fs, _) = program.entry_point(ShaderStage::Fragment, "fs").unwrap();
    let (vs, _) = program.entry_point(ShaderStage::Vertex, "vs").unwrap();
    assert_eq!(
        graph.entry_effects(fs),
        ["discard", "derivative", "store", "frag-depth"]
    );
    assert!(graph.entry_effects(vs).is_empty());
}

const SMALL: &str = "@group(0) @binding(0) var<uniform> tint: vec4<f32>;
@fragment fn fs(@location(0) uv: vec2<f32>) -> @location(0) vec4<f32> {
    var c = tint;
    if uv.x > 0.5 {
        c.x = uv.y;
    }
    if c.w < 0.1 { discard; }
    return c;
}
";

#[test]
fn a_small_graph_as_dot() {
    let program = common::program(SMALL);
    insta::assert_snapshot!(Graph::build(&program).to_dot());
}

#[test]
fn a_small_graph_as_json() {
    let program = common::program(SMALL);
    let data = Graph::build(&program).to_data();
    for edge in &data.edges {
        assert!(edge.from < data.nodes.len() && edge.to < data.nodes.len());
    }
    insta::assert_json_snapshot!(data);
}

#[test]
fn components_of_a_vector_are_cells_of_their_own() {
    let program = common::program(SMALL);
    let graph = Graph::build(&program);
    let f = graph.function(FunctionId::EntryPoint(0));
    assert_eq!(f.memory.cells.len(), 4);
    // The comparison sees the one store to `w`, not the merge at `x`.
    let (load, _) = f
        .function
        .expressions
        .iter()
        .filter(|(e, x)| matches!(x, Expression::Load { .. }) && f.memory.loads.contains_key(e))
        .min_by_key(|(e, _)| f.statements.evaluated_at(*e))
        .unwrap();
    assert_eq!(f.memory.loads[&load].len(), 1);
}
