//! Tessellation builds valid programs around any hoisted vertex stage, and refuses what it cannot
//! divide.

use naga_interp::{Environment, Value};
use preshade_geometry::tessellate::{Tessellate, TessellateParams};
use preshade_passes::transforms::hoist::{self, Hoist};
use preshade_plan::geometry::{Constants, Geometry, Stream, Subdivision};
use preshade_plan::pass::{Facts, Pass, Refusal, Refused};
use preshade_plan::pattern::{self, Pattern};
use preshade_plan::plan::{BindingSource, GeometryPart, Plan};
use preshade_plan::state::{MaterialState, PrimitiveState, Topology};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

use crate::common;

fn original(source: &str, state: &MaterialState) -> Plan {
    Plan::original("test", common::program(source), "vs", Some("fs"), state)
}

fn hoisted(plan: &Plan) -> Plan {
    let params = hoist::HoistParams {
        budget: Some(0.02),
        finite: hoist::movable::Finite::Assumed,
        ..hoist::HoistParams::default()
    };
    apply::<Hoist>(plan, &params).unwrap()
}

fn apply<P: Pass>(plan: &Plan, params: &P::Params) -> Result<Plan, Box<Refusal>> {
    let done = P::run(plan, &Facts::default(), params);
    done.map(|done| done.plan).map_err(Refused::first)
}

fn refused(source: &str) -> Box<Refusal> {
    let plan = hoisted(&original(source, &MaterialState::default()));
    apply::<Tessellate>(&plan, &TessellateParams::default()).unwrap_err()
}

const WAVES: &str = "
struct Scene { clip: mat4x4<f32>, tint: vec3<f32>, time: f32 }
@group(0) @binding(0) var<uniform> scene: Scene;
struct VertexInput { @location(0) position: vec3<f32>, @location(2) uv: vec2<f32>, \
    @builtin(instance_index) instance: u32 }
struct VertexOutput { @builtin(position) position: vec4<f32>, @location(0) world: vec3<f32>, \
    @location(1) uv: vec2<f32>, @location(2) @interpolate(flat) kind: u32 }
@vertex fn vs(in: VertexInput, @location(3) kind: vec4<u32>) -> VertexOutput {
    var out: VertexOutput;
    out.position = scene.clip * vec4(in.position, 1.0) + f32(in.instance);
    out.world = in.position;
    out.uv = in.uv;
    out.kind = kind.x;
    return out;
}
@fragment fn fs(in: VertexOutput) -> @location(0) vec4<f32> {
    let waves = sin(in.world.x * 3.0) * cos(in.world.y * 5.0) * sin(in.world.z + scene.time) + \
        exp(sin(in.world.x)) * sin(in.world.y);
    return vec4(scene.tint * waves + fwidth(in.uv.x) + f32(in.kind), 1.0);
}
";

#[test]
fn the_vertex_stage_pulls_corners_and_interpolates() {
    let plan = hoisted(&original(WAVES, &MaterialState::default()));
    let next = apply::<Tessellate>(&plan, &TessellateParams::default()).unwrap();
    let main = next.main().unwrap();
    insta::assert_snapshot!(common::wgsl(next.program(main).unwrap()));
    assert!(main.attributes.is_empty());
    let Geometry::Subdivided(subdivision) = &main.geometry else {
        panic!("{:?}", main.geometry)
    };
    assert_eq!(subdivision.vertices.len(), 12);
    assert_eq!(subdivision.indices.len(), 39);
    let streams: Vec<u32> = main
        .bindings
        .iter()
        .filter_map(|b| match &b.source {
            BindingSource::Geometry {
                part: GeometryPart::Attribute(a),
            } => Some(a.location),
            _ => None,
        })
        .collect();
    assert_eq!(streams, [0, 2, 3]);
    assert_eq!(next.contract, plan.contract);
}

/// A mesh as a host holds it: positions, as words of a buffer, and indices of 16 bits.
struct Mesh<'a> {
    positions: Vec<u32>,
    layout: Stream,
    clip: [[f32; 4]; 4],
    indices: &'a [u16],
}

impl<'a> Mesh<'a> {
    /// Of three floats a vertex, somehow in view.
    fn of_floats(positions: &[[f32; 3]], indices: &'a [u16]) -> Self {
        let floats = positions.as_flattened().iter();
        Self {
            positions: floats.map(|f| f.to_bits()).collect(),
            layout: stream("float32x3", 0, 12),
            clip: [
                [1.3, 0.1, 0.2, 0.3],
                [-0.2, 1.7, 0.3, 0.1],
                [0.4, 0.3, 0.9, -1.1],
                [0.5, 0.6, 0.7, 9.0],
            ],
            indices,
        }
    }
}

fn stream(format: &str, offset: u32, stride: u32) -> Stream {
    Stream {
        offset,
        stride,
        format: format.to_owned(),
        by_instance: false,
    }
}

fn words(words: &[u32]) -> Value {
    Value::Composite(words.iter().map(|w| Value::u32(*w)).collect())
}

/// The clip position of a vertex of the subdivided mesh, by the interpreter.
fn position(plan: &Plan, subdivision: &Subdivision, mesh: &Mesh<'_>, at: (u32, u32)) -> Value {
    let triangles = mesh.indices.len() as u32 / 3;
    let constants = Constants {
        triangles,
        batches: triangles.div_ceil(subdivision.batch),
        first: 0,
        index_bytes: 2,
        base_vertex: 0,
        first_instance: 0,
        vertices: 0,
        instances: 1,
        viewport: subdivision.edge_pixels.map(|_| [400, 300]),
        streams: vec![
            mesh.layout.clone(),
            stream("float32x2", 0, 0),
            stream("uint8x4", 0, 0),
        ],
    };
    let constants = constants.words().unwrap();
    let (scalars, mut streams) = constants.split_at(8);
    let mut uniform: Vec<Value> = scalars.iter().map(|w| Value::u32(*w)).collect();
    if subdivision.edge_pixels.is_some() {
        let (viewport, rest) = streams.split_at(4);
        uniform.push(words(viewport));
        streams = rest;
    }
    uniform.push(Value::Composite(streams.chunks(4).map(words).collect()));
    let stream = words(&mesh.positions);
    let pairs = mesh.indices.chunks(2);
    let pairs = pairs.map(|p| u32::from(p[0]) | p.get(1).map_or(0, |i| u32::from(*i) << 16));
    let clip = Value::Composite(mesh.clip.iter().map(|c| Value::vector(c)).collect());
    let scene = vec![clip, Value::vector(&[1.0; 3]), Value::f32(0.5)];
    let resources = BTreeMap::from([
        ((0, 0), Value::Composite(scene)),
        ((0, 1), Value::Composite(uniform)),
        ((0, 2), words(&subdivision.vertices)),
        ((0, 3), words(&pairs.collect::<Vec<_>>())),
        ((0, 4), stream.clone()),
        ((0, 5), stream.clone()),
        ((0, 6), stream),
    ]);
    let environment = Environment {
        resources: resources.into(),
        texture: &|_| [0.0; 4],
        derivative: None,
        trace: None,
        steps: 100_000,
    };
    let program = plan.program(plan.main().unwrap()).unwrap();
    let (entry, _) = program
        .entry_point(naga::ShaderStage::Vertex, "vs")
        .unwrap();
    let (triangle, vertex) = at;
    let index = triangle % subdivision.batch * subdivision.vertices.len() as u32 + vertex;
    let arguments = [index, triangle / subdivision.batch].map(Value::u32);
    let outcome = naga_interp::entry_point(program.module(), entry, &arguments, &environment);
    match outcome.unwrap().result {
        Some(Value::Composite(members)) => members[0].clone(),
        other => panic!("{other:?}"),
    }
}

fn divided(level: u32, pattern: Pattern) -> (Plan, Subdivision) {
    let plan = hoisted(&original(WAVES, &MaterialState::default()));
    let params = TessellateParams {
        level,
        pattern,
        ..TessellateParams::default()
    };
    let plan = apply::<Tessellate>(&plan, &params).unwrap();
    let subdivision = plan.main().unwrap().geometry.subdivision().unwrap().clone();
    (plan, subdivision)
}

/// Positions along the edge between two corners of a triangle, by the weight of the first of them.
fn along(
    (plan, subdivision): &(Plan, Subdivision),
    mesh: &Mesh<'_>,
    triangle: u32,
    [from, to]: [usize; 2],
) -> BTreeMap<u32, Value> {
    let points = pattern::divide(subdivision.pattern, subdivision.level).vertices;
    let on_edge = points
        .iter()
        .enumerate()
        .filter(|(_, p)| p[3 - from - to] == 0);
    on_edge
        .map(|(vertex, p)| {
            let at = (triangle, vertex as u32);
            (p[from], position(plan, subdivision, mesh, at))
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Both triangles of an edge have the same bits along it, where they share its vertices and
    /// where a seam gives each vertices of its own.
    #[test]
    fn an_edge_is_one_edge_from_both_sides(
        positions in prop::array::uniform4(prop::array::uniform3(-9.0_f32..9.0)),
        level in 1_u32..7,
    ) {
        for pattern in [Pattern::Gl, Pattern::Uniform] {
            let divided = divided(level, pattern);
            let [a, b, c, d] = positions;
            // Corners 1 and 2 of the first triangle are corners 1 and 0 of the second.
            let shared = Mesh::of_floats(&[a, b, c, d], &[0, 1, 2, 2, 1, 3]);
            let seam = Mesh::of_floats(&[a, b, c, c, b, d], &[0, 1, 2, 3, 4, 5]);
            for mesh in [shared, seam] {
                let first = along(&divided, &mesh, 0, [1, 2]);
                let second = along(&divided, &mesh, 1, [1, 0]);
                prop_assert_eq!(first.len() as u32, level + 1);
                prop_assert_eq!(first, second);
            }
        }
    }
}

/// The distinct positions of a triangle's pattern that lie on the straight line between two of its
/// corners' positions, in order.
fn on_line(
    (plan, subdivision): &(Plan, Subdivision),
    mesh: &Mesh<'_>,
    triangle: u32,
    [from, to]: [usize; 2],
) -> BTreeSet<[u32; 4]> {
    let level = subdivision.level;
    // Rows and columns of the corners at the highest level do not say where a vertex went: where it
    // is does.
    let all = (0..subdivision.vertices.len() as u32).map(|vertex| {
        let Value::Composite(members) = position(plan, subdivision, mesh, (triangle, vertex))
        else {
            panic!("a position is a vector");
        };
        let bits = |v: &Value| match v {
            Value::Scalar(naga_interp::Scalar::F32(f)) => f.to_bits(),
            other => panic!("{other:?}"),
        };
        [0, 1, 2, 3].map(|i| bits(&members[i]))
    });
    let all: Vec<[u32; 4]> = all.collect();
    let corner = |i: usize| match i {
        0 => all[0],
        1 => all[all.len() - 1 - level as usize],
        _ => all[all.len() - 1],
    };
    let at = |p: [u32; 4]| p.map(|b| f64::from(f32::from_bits(b)));
    let (p, q) = (at(corner(from)), at(corner(to)));
    let length = |d: [f64; 4]| d.iter().map(|x| x * x).sum::<f64>();
    let along = [0, 1, 2, 3].map(|i| q[i] - p[i]);
    all.iter()
        .copied()
        .filter(|point| {
            let to_point = at(*point);
            let d = [0, 1, 2, 3].map(|i| to_point[i] - p[i]);
            let t = (0..4).map(|i| d[i] * along[i]).sum::<f64>() / length(along);
            length([0, 1, 2, 3].map(|i| d[i] - t * along[i])) < 1e-9 * length(along)
        })
        .collect()
}

/// Whatever the other edges of its two triangles have, an edge has the same points on both sides,
/// and no longer than asked for.
#[test]
fn an_adaptive_edge_has_its_own_points_on_both_sides() {
    let plan = hoisted(&original(WAVES, &MaterialState::default()));
    let params = TessellateParams {
        level: 9,
        edge_pixels: Some(20),
        ..TessellateParams::default()
    };
    let plan = apply::<Tessellate>(&plan, &params).unwrap();
    let subdivision = plan.main().unwrap().geometry.subdivision().unwrap().clone();
    let divided = (plan, subdivision);
    let mut levels = BTreeSet::new();
    for scale in [0.2_f32, 0.5, 1.0, 1.7] {
        // A small triangle and a large one beside it.
        let [a, b, c, d] = [
            [-0.3, 0.1, 0.2],
            [0.9, -0.8, 0.1],
            [0.7, 1.3, -0.4],
            [4.0, 2.5, 0.3],
        ]
        .map(|p: [f32; 3]| p.map(|x| x * scale));
        let shared = Mesh::of_floats(&[a, b, c, d], &[0, 1, 2, 2, 1, 3]);
        let seam = Mesh::of_floats(&[a, b, c, c, b, d], &[0, 1, 2, 3, 4, 5]);
        for mesh in [shared, seam] {
            let first = on_line(&divided, &mesh, 0, [1, 2]);
            let second = on_line(&divided, &mesh, 1, [1, 0]);
            assert_eq!(first, second, "at {scale}");
            levels.insert(first.len() - 1);
        }
    }
    assert!(levels.len() > 2, "{levels:?}");
    assert!(levels.iter().all(|l| (1..=9).contains(l)), "{levels:?}");
}

/// Vertices beyond the rows that a triangle needs do not compute what was hoisted.
#[test]
fn surplus_vertices_compute_nothing() {
    let plan = hoisted(&original(WAVES, &MaterialState::default()));
    let params = TessellateParams {
        edge_pixels: Some(8),
        ..TessellateParams::default()
    };
    let next = apply::<Tessellate>(&plan, &params).unwrap();
    let text = common::wgsl(next.program(next.main().unwrap()).unwrap());
    insta::assert_snapshot!(&text[text.find("struct TessellatedPoint").unwrap()..]);
    let shared = TessellateParams {
        form: preshade_plan::geometry::Form::Shared,
        ..params
    };
    let refusal = apply::<Tessellate>(&plan, &shared).unwrap_err();
    assert_eq!(refusal.code, "adaptive-form");
    let of_nothing = TessellateParams {
        edge_pixels: Some(0),
        ..TessellateParams::default()
    };
    let refusal = apply::<Tessellate>(&plan, &of_nothing).unwrap_err();
    assert_eq!(refusal.code, "edge-pixels");
}

/// Every kind of format is read as WebGPU's vertex input reads it, at any offset it may have.
#[test]
fn packed_formats_are_decoded() {
    let divided = divided(1, Pattern::Uniform);
    let none = 0xeeee_eeee;
    // Format, offset, words of a vertex, and what a shader sees of it as a vec3.
    let cases: [(&str, u32, [u32; 4], [f32; 3]); 15] = [
        (
            "float32x3",
            4,
            [none, 0x3f80_0000, 0xc000_0000, 0x3f00_0000],
            [1.0, -2.0, 0.5],
        ),
        (
            "float32x2",
            8,
            [none, none, 0x3f80_0000, 0xc000_0000],
            [1.0, -2.0, 0.0],
        ),
        (
            "float32",
            12,
            [none, none, none, 0x4040_0000],
            [3.0, 0.0, 0.0],
        ),
        (
            "float32x4",
            0,
            [0x3f80_0000, 0, 0x4040_0000, none],
            [1.0, 0.0, 3.0],
        ),
        (
            "float16x4",
            4,
            [none, 0xc000_3c00, none << 16 | 0x3800, none],
            [1.0, -2.0, 0.5],
        ),
        (
            "float16",
            6,
            [none, 0x3800_0000, none, none],
            [0.5, 0.0, 0.0],
        ),
        (
            "unorm8x4",
            0,
            [0x00_ff_00_ff, none, none, none],
            [1.0, 0.0, 1.0],
        ),
        (
            "unorm8x2",
            2,
            [0xff_00_00_00, none, none, none],
            [0.0, 1.0, 0.0],
        ),
        (
            "unorm8",
            3,
            [0xff_00_00_00, none, none, none],
            [1.0, 0.0, 0.0],
        ),
        (
            "snorm8x4",
            4,
            [none, 0x00_7f_80_81, none, none],
            [-1.0, -1.0, 1.0],
        ),
        (
            "unorm16x4",
            4,
            [none, 0xffff_0000, 0x0000_ffff, none],
            [0.0, 1.0, 1.0],
        ),
        (
            "snorm16x2",
            8,
            [none, none, 0x8001_7fff, none],
            [1.0, -1.0, 0.0],
        ),
        (
            "snorm16",
            2,
            [0x7fff_0000, none, none, none],
            [1.0, 0.0, 0.0],
        ),
        (
            "unorm10-10-10-2",
            4,
            [none, 0x3ff0_03ff, none, none],
            [1.0, 0.0, 1.0],
        ),
        (
            "unorm8x4-bgra",
            4,
            [none, 0x00_ff_00_00, none, none],
            [1.0, 0.0, 0.0],
        ),
    ];
    for (format, offset, vertex, [x, y, z]) in cases {
        let mesh = Mesh {
            // The third corner of the triangle is the fourth vertex.
            positions: [[none; 4], [none; 4], [none; 4], vertex].concat(),
            layout: stream(format, offset, 16),
            clip: [
                [1.0, 0.0, 0.0, 0.0],
                [0.0, 1.0, 0.0, 0.0],
                [0.0, 0.0, 1.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
            ],
            indices: &[0, 1, 3],
        };
        let (plan, subdivision) = &divided;
        let found = position(plan, subdivision, &mesh, (0, 2));
        // An addition of zero: no component is -0.
        assert_eq!(found, Value::vector(&[x, y, z, 1.0]), "{format}");
    }
}

#[test]
fn shared_vertices_are_computed_and_then_read() {
    let smooth = WAVES
        .replace("@interpolate(flat) kind: u32", "kind: f32")
        .replace("out.kind = kind.x", "out.kind = f32(kind.x)")
        .replace("f32(in.kind)", "in.kind");
    let plan = hoisted(&original(&smooth, &MaterialState::default()));
    let params = TessellateParams {
        form: preshade_plan::geometry::Form::Shared,
        pattern: Pattern::Uniform,
        level: 2,
        ..TessellateParams::default()
    };
    let next = apply::<Tessellate>(&plan, &params).unwrap();
    let main = common::wgsl(next.program(next.main().unwrap()).unwrap());
    let points = common::wgsl(&next.programs["points"]);
    let points = &points[points.find("fn tessellated_index").unwrap()..];
    insta::assert_snapshot!(format!("{main}\n// points, from its end\n\n{points}"));
    assert_eq!(next.compute.len(), 1);
    // Position, and three values.
    assert_eq!(next.vertex_buffers[0].stride, 4 * 7);
    let flat = hoisted(&original(WAVES, &MaterialState::default()));
    let refusal = apply::<Tessellate>(&flat, &params).unwrap_err();
    assert_eq!(refusal.code, "flat-shared");
}

#[test]
fn what_cannot_be_divided_is_refused() {
    let plan = original(WAVES, &MaterialState::default());
    let code = |r: Result<Plan, Box<Refusal>>| r.unwrap_err().code;
    assert_eq!(
        code(apply::<Tessellate>(&plan, &TessellateParams::default())),
        "not-hoisted"
    );
    let level = TessellateParams {
        level: 65,
        ..TessellateParams::default()
    };
    assert_eq!(code(apply::<Tessellate>(&hoisted(&plan), &level)), "level");
    let lines = MaterialState {
        primitive: PrimitiveState {
            topology: Topology::LineStrip,
            ..PrimitiveState::default()
        },
        ..MaterialState::default()
    };
    let lines = hoisted(&original(WAVES, &lines));
    assert_eq!(
        code(apply::<Tessellate>(&lines, &TessellateParams::default())),
        "topology"
    );
    let linear = WAVES.replace("@location(1) uv", "@location(1) @interpolate(linear) uv");
    assert_eq!(refused(&linear).code, "varying");
    let private = WAVES
        .replace("struct Scene", "var<private> last: f32; struct Scene")
        .replace(
            "out.uv = in.uv;",
            "last += in.uv.x; out.uv = in.uv + vec2(last);",
        );
    assert_eq!(refused(&private).code, "vertex-state");
    let primitive = WAVES
        .replace(
            "in: VertexOutput)",
            "in: VertexOutput, @builtin(primitive_index) p: u32)",
        )
        .replace("f32(in.kind)", "f32(p)");
    let primitive = format!("enable primitive_index;\n{primitive}");
    assert_eq!(refused(&primitive).code, "knows-triangles");
}

/// At load nothing but what was hoisted is computed and stored; the vertex stage interpolates the
/// rest.
#[test]
fn what_is_static_is_stored_alone() {
    let smooth = WAVES
        .replace("@interpolate(flat) kind: u32", "kind: f32")
        .replace("out.kind = kind.x", "out.kind = f32(kind.x)")
        .replace("f32(in.kind)", "in.kind");
    let plan = hoisted(&original(&smooth, &MaterialState::default()));
    let params = TessellateParams {
        form: preshade_plan::geometry::Form::Static,
        fixed: Some("scene".to_owned()),
        ..TessellateParams::default()
    };
    let next = apply::<Tessellate>(&plan, &params).unwrap();
    let main = common::wgsl(next.program(next.main().unwrap()).unwrap());
    let points = common::wgsl(&next.programs["points"]);
    let of = |text: &str, from: &str| text[text.find(from).unwrap()..].to_owned();
    insta::assert_snapshot!(format!(
        "{}\n// points, from its end\n\n{}",
        of(&main, "fn tessellated_load"),
        of(&points, "fn vs_between")
    ));
}

/// What a site costs is what was hoisted: more of it costs more, and the author's own vertex stage
/// is no part of it.
#[test]
fn a_site_tells_what_each_new_vertex_costs() {
    let cost = |source: &str| {
        let plan = hoisted(&original(source, &MaterialState::default()));
        let done = Tessellate::run(&plan, &Facts::default(), &TessellateParams::default());
        done.unwrap().change.cost
    };
    let once = cost(WAVES);
    assert!(0.0 < once.slice && once.slice < once.whole, "{once:?}");
    let dearer = cost(&WAVES.replace("out.uv = in.uv;", "out.uv = sin(cos(in.uv));"));
    assert_eq!(dearer.slice, once.slice);
    assert!(dearer.whole > once.whole);
}
