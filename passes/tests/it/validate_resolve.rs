//! The resolve of the visibility buffer is validated on made-up draws: whole variants agree, and
//! planted faults are found.

use preshade_geometry::pass_named;
use preshade_plan::pass::Facts;
use preshade_plan::plan::{Plan, Role};
use preshade_plan::state::{CullMode, MaterialState};
use preshade_validate::{Check, Effort, Verdict, validate};

use crate::common;

/// A material with every kind of varying, the builtins that the resolve reconstructs, and gradients
/// of samples and derivatives.
const MATERIAL: &str = "
struct Camera { view_projection: mat4x4<f32>, sun: vec4<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var picture: texture_2d<f32>;
@group(0) @binding(2) var filtering: sampler;
struct Varyings { @builtin(position) position: vec4<f32>, @location(0) world: vec3<f32>, \
    @location(1) uv: vec2<f32>, @location(2) @interpolate(linear) screen: f32, \
    @location(3) @interpolate(flat) kind: u32, @location(4) shade: f32 }
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>, @location(2) kind: u32, \
    @location(3) offset: vec2<f32>, @builtin(vertex_index) vertex: u32, \
    @builtin(instance_index) instance: u32) -> Varyings {
    let moved = position + vec3(offset, 0.25 * f32(instance));
    return Varyings(camera.view_projection * vec4(moved, 1.0), moved, uv, position.x, kind, \
        f32(vertex % 5u));
}
struct In { @builtin(position) position: vec4<f32>, @builtin(front_facing) front: bool, \
    @location(0) world: vec3<f32>, @location(1) uv: vec2<f32>, \
    @location(2) @interpolate(linear) screen: f32, @location(3) @interpolate(flat) kind: u32, \
    @location(4) shade: f32 }
@fragment fn fs(in: In) -> @location(0) vec4<f32> {
    let texel = textureSample(picture, filtering, in.uv);
    let again = textureSampleBias(picture, filtering, in.uv + texel.xy * 0.25, 0.5);
    let slope = dpdx(in.world.x) - 0.5 * dpdy(in.world.y);
    var color = texel.rgb * 0.25 + again.gbr * 0.25 + vec3(0.125 * slope);
    color += 0.0625 * vec3(in.shade, in.screen, f32(in.kind));
    color.r += 0.03125 * in.position.z + 0.0078125 * in.position.w;
    if !in.front { color = color.grb; }
    if texel.a < 0.1 { discard; }
    return vec4(color, 1.0);
}
";

const EFFORT: Effort = Effort {
    inputs: 96,
    seed: 0,
    steps: 20_000,
    paths: 64,
};

fn original() -> Plan {
    of(MATERIAL)
}

fn of(text: &str) -> Plan {
    let state = MaterialState {
        primitive: preshade_plan::state::PrimitiveState {
            cull: CullMode::None,
            ..Default::default()
        },
        ..MaterialState::default()
    };
    let program = common::program(text);
    Plan::original("test", program, "vs", Some("fs"), &state)
}

fn split(original: &Plan, recipe: &'static str) -> Plan {
    let (pass, params) = common::step(recipe);
    let outcome = pass_named(pass)
        .unwrap()
        .run(original, &Facts::without_ties(), &params);
    outcome.unwrap_or_else(|refused| panic!("{refused:?}")).plan
}

fn said(checks: &[Check]) -> String {
    let lines = checks
        .iter()
        .map(|c| format!("{}: {}: {}", c.role.name(), c.promise, c.verdict));
    lines.collect::<Vec<_>>().join("\n")
}

#[test]
fn a_resolve_agrees_in_every_form_that_draws() {
    let original = original();
    for recipe in [
        "visibility-buffer:budget=0.05",
        "visibility-buffer:budget=0.05,select=id",
        "visibility-buffer:budget=0.05,words=one,corners=as-given",
        "visibility-buffer:budget=0.05,select=id,ids=unindexed,words=one",
        "visibility-buffer:budget=0.05,formats=any,corners=snapped",
        "visibility-buffer:budget=0.05,derivatives=quad",
        "visibility-buffer:budget=0.05,vertices=kept,select=id",
    ] {
        let variant = split(&original, recipe);
        let checks = validate(&original, &variant, &EFFORT);
        let told = said(&checks);
        assert!(checks.iter().all(|c| c.verdict.holds()), "{recipe}\n{told}");
        let mut of_resolve = checks.iter().filter(|c| c.role == Role::Resolve);
        let compared = of_resolve.find_map(|c| match c.verdict {
            Verdict::Agreed { compared, .. } if c.promise.starts_with("colours") => Some(compared),
            _ => None,
        });
        assert!(compared.unwrap() >= 16, "{recipe}\n{told}");
    }
}

/// Without a budget, nothing is interpolated and the colours have no other roundings.
#[test]
fn a_resolve_without_a_budget_agrees() {
    let original = of("
    struct Varyings { @builtin(position) position: vec4<f32>, \
        @location(0) @interpolate(flat) kind: vec2<u32> }
    @vertex fn vs(@location(0) p: vec4<f32>, @location(1) kind: vec2<u32>) -> Varyings {
        return Varyings(p, kind);
    }
    @fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {
        return vec4(fract(in.position.xy * 0.3), vec2<f32>(in.kind) * 0.1);
    }");
    let variant = split(&original, "visibility-buffer:select=id");
    let checks = validate(&original, &variant, &EFFORT);
    let told = said(&checks);
    assert!(checks.iter().all(|c| c.verdict.holds()), "{told}");
    let program = variant.programs["resolve"].clone();
    let broken = common::wgsl(&program).replace("first_1 + 1u", "first_1 + 0u");
    let mut variant = variant;
    variant
        .programs
        .insert("resolve".to_owned(), common::program(&broken));
    let checks = validate(&original, &variant, &EFFORT);
    assert!(checks.iter().any(|c| c.verdict.is_broken()), "{broken}");
}

/// The results of the second and the third level have the same types and the same names of members.
#[test]
fn levels_with_equal_results_are_told_apart() {
    let (start, _) = MATERIAL.split_once("    let texel").unwrap();
    let sample = |name: &str, at: &str| {
        format!("    let {name} = textureSample(picture, filtering, {at});\n")
    };
    let reads = [
        ("a", "in.uv"),
        ("b", "in.uv.yx"),
        ("c", "a.xy"),
        ("d", "b.xy"),
        ("e", "c.xy"),
        ("f", "d.xy"),
    ];
    let reads: String = reads.iter().map(|(name, at)| sample(name, at)).collect();
    let original = of(&format!("{start}{reads}    return e + f;\n}}\n"));
    let variant = split(&original, "visibility-buffer:budget=0.05");
    let text = common::wgsl(&variant.programs["resolve"]);
    for level in [
        "GradientRoots {",
        "GradientRootsValues {",
        "GradientRootsValuesValues {",
    ] {
        assert!(text.contains(&format!("struct {level}")), "{level}\n{text}");
    }
}

/// A fault, as a change of the text of a pass.
struct Fault {
    recipe: &'static str,
    role: Role,
    from: &'static str,
    to: &'static str,
}

fn fault(from: &'static str, to: &'static str) -> Fault {
    Fault {
        recipe: "visibility-buffer:budget=1",
        role: Role::Resolve,
        from,
        to,
    }
}

/// The largest budget hides none of them.
#[test]
fn planted_faults_are_found() {
    let by_id = |from, to| Fault {
        recipe: "visibility-buffer:budget=1,select=id",
        ..fault(from, to)
    };
    let of_ids = |from, to| Fault {
        role: Role::Ids,
        ..fault(from, to)
    };
    let faults = [
        // Barycentrics.
        fault(".y)) + ((c", ".z)) + ((c"),
        fault("visible_cross(r, p)", "visible_cross(p, r)"),
        fault("* vec3<f32>(a_2.w, b_2.w, c_1.w)", "* vec3(1f)"),
        fault("(1f - (inside.y * 2f))", "((inside.y * 2f) - 1f)"),
        // Attributes and indices.
        fault("first + 1u", "first + 0u"),
        fault("256u", "512u"),
        fault("stream.x +", "0u +"),
        fault("16u * (", "8u * ("),
        fault("return (_e30 + _e33)", "return _e33"),
        fault("_e4 + (triangle * 3u)", "(triangle * 3u)"),
        fault("(_e3, 2u)", "(_e3, 1u)"),
        fault("_e3 + id_2.x", "id_2.x"),
        // Gradients and builtins.
        fault(
            "visible_in_quad(pixel, 1u, 0u)",
            "visible_in_quad(pixel, 0u, 1u)",
        ),
        fault(
            "visible_beside(pixel, 1u, 0u)",
            "visible_beside(pixel, 0u, 1u)",
        ),
        fault(">> 31u) == 0u", ">> 31u) != 0u"),
        fault("(1f / w)", "w"),
        fault("1.4142135f", "1f"),
        // The author's text, by less than the budget.
        fault("0.0625f", "0.0635f"),
        // Ids, and which pixels show them.
        of_ids("1u + ", "2u + "),
        fault("1.25f", "2.25f"),
        by_id("- 1u) - ", "- 0u) - "),
    ];
    let original = original();
    let mut missed = Vec::new();
    for Fault {
        recipe,
        role,
        from,
        to,
    } in faults
    {
        let mut variant = split(&original, recipe);
        let pass = variant.passes.iter().find(|p| p.role == role).unwrap();
        let program = variant.program(pass).unwrap();
        let text = common::wgsl(program);
        let broken = text.replace(from, to);
        assert_ne!(text, broken, "{from} is not in\n{text}");
        let key = pass.program.clone();
        variant.programs.insert(key, common::program(&broken));
        let checks = validate(&original, &variant, &EFFORT);
        let is_found = checks
            .iter()
            .any(|c| c.role == Role::Resolve && c.verdict.is_broken());
        if !is_found {
            missed.push(format!("{from} to {to}\n{}", said(&checks)));
        }
    }
    assert!(missed.is_empty(), "{}", missed.join("\n\n"));
}
