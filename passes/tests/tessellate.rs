//! Tessellation builds valid programs around any hoisted vertex stage, and refuses what it cannot divide.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use preshade_passes::geometry::Geometry;
use preshade_passes::hoist::{self, Hoist};
use preshade_passes::pass::{Facts, Pass, Refusal};
use preshade_passes::plan::{BindingSource, GeometryPart, Plan};
use preshade_passes::state::{MaterialState, PrimitiveState, Topology};
use preshade_passes::tessellate::pattern::Pattern;
use preshade_passes::tessellate::{Params, Tessellate};

fn original(source: &str, state: &MaterialState) -> Plan {
    Plan::original("test", common::program(source), "vs", Some("fs"), state)
}

fn hoisted(plan: &Plan) -> Plan {
    let params = hoist::Params {
        budget: Some(0.02),
        finite: hoist::travel::Finite::Assumed,
        ..hoist::Params::default()
    };
    apply::<Hoist>(plan, &params).unwrap()
}

fn apply<P: Pass>(plan: &Plan, params: &P::Params) -> Result<Plan, Box<Refusal>> {
    let facts = Facts::default();
    let mut sites = P::sites(plan, &facts, params);
    match sites.sites.pop() {
        Some(site) => P::apply(plan, &facts, &site.key, params),
        None => Err(Box::new(sites.refusals.remove(0))),
    }
}

fn refused(source: &str) -> Box<Refusal> {
    let plan = hoisted(&original(source, &MaterialState::default()));
    apply::<Tessellate>(&plan, &Params::default()).unwrap_err()
}

const WAVES: &str = "
struct Scene { clip: mat4x4<f32>, tint: vec3<f32>, time: f32 }
@group(0) @binding(0) var<uniform> scene: Scene;
struct VertexInput { @location(0) position: vec3<f32>, @location(2) uv: vec2<f32>, @builtin(instance_index) instance: u32 }
struct VertexOutput { @builtin(position) position: vec4<f32>, @location(0) world: vec3<f32>, @location(1) uv: vec2<f32>, @location(2) @interpolate(flat) kind: u32 }
@vertex fn vs(in: VertexInput, @location(3) kind: vec4<u32>) -> VertexOutput {
    var out: VertexOutput;
    out.position = scene.clip * vec4(in.position, 1.0) + f32(in.instance);
    out.world = in.position;
    out.uv = in.uv;
    out.kind = kind.x;
    return out;
}
@fragment fn fs(in: VertexOutput) -> @location(0) vec4<f32> {
    let waves = sin(in.world.x * 3.0) * cos(in.world.y * 5.0) * sin(in.world.z + scene.time) + exp(sin(in.world.x)) * sin(in.world.y);
    return vec4(scene.tint * waves + fwidth(in.uv.x) + f32(in.kind), 1.0);
}
";

#[test]
fn the_vertex_stage_pulls_corners_and_interpolates() {
    let plan = hoisted(&original(WAVES, &MaterialState::default()));
    let next = apply::<Tessellate>(&plan, &Params::default()).unwrap();
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

#[test]
fn shared_vertices_are_computed_and_then_read() {
    let smooth = WAVES
        .replace("@interpolate(flat) kind: u32", "kind: f32")
        .replace("out.kind = kind.x", "out.kind = f32(kind.x)")
        .replace("f32(in.kind)", "in.kind");
    let plan = hoisted(&original(&smooth, &MaterialState::default()));
    let params = Params {
        form: preshade_passes::geometry::Form::Shared,
        pattern: Pattern::Uniform,
        level: 2,
    };
    let next = apply::<Tessellate>(&plan, &params).unwrap();
    let main = common::wgsl(next.program(next.main().unwrap()).unwrap());
    let points = common::wgsl(&next.programs["points"]);
    let points = &points[points.find("fn tessellated_index").unwrap()..];
    insta::assert_snapshot!(format!("{main}\n// points, from its end\n\n{points}"));
    assert_eq!(next.compute.len(), 1);
    // Position, and two values.
    assert_eq!(next.vertex_buffers[0].stride, 4 * 6);
    let flat = hoisted(&original(WAVES, &MaterialState::default()));
    let refusal = apply::<Tessellate>(&flat, &params).unwrap_err();
    assert_eq!(refusal.code, "flat-shared");
}

#[test]
fn what_cannot_be_divided_is_refused() {
    let plan = original(WAVES, &MaterialState::default());
    let code = |r: Result<Plan, Box<Refusal>>| r.unwrap_err().code;
    assert_eq!(
        code(apply::<Tessellate>(&plan, &Params::default())),
        "not-hoisted"
    );
    let level = Params {
        level: 65,
        ..Params::default()
    };
    assert_eq!(code(apply::<Tessellate>(&hoisted(&plan), &level)), "level");
    let strip = MaterialState {
        primitive: PrimitiveState {
            topology: Topology::TriangleStrip,
            ..PrimitiveState::default()
        },
        ..MaterialState::default()
    };
    let strip = hoisted(&original(WAVES, &strip));
    assert_eq!(
        code(apply::<Tessellate>(&strip, &Params::default())),
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
