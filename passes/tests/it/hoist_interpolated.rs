//! What hoisting promises without a budget, inside a triangle: the rasteriser's part is played
//! here, with weights that do not add up to 1, as a rasteriser's do not.

use std::collections::BTreeMap;

use naga::{Binding, Interpolation, ShaderStage};
use naga_edit::interface;
use naga_interp::{Scalar, Stuck, Value};
use preshade_passes::transforms::hoist::{Allow, Hoist, HoistParams};
use preshade_plan::pass::{Facts, Pass, Source, SourceRange};
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;
use preshade_plan::state::{Blend, ColorTarget, MaterialState};
use proptest::prelude::*;

use crate::common::stages::{Ran, VERTEX, attributes, run};
use crate::common::{self, random};

/// Weights of a triangle's corners at a fragment. Their sum is off by some last bits.
type Weights = [f32; 3];

fn interpolate(corners: [&Value; 3], weights: Weights) -> Value {
    let number = |v: &Value| match v {
        Value::Scalar(Scalar::F32(x)) => Some(*x),
        _ => None,
    };
    match corners {
        [
            Value::Composite(a),
            Value::Composite(b),
            Value::Composite(c),
        ] => {
            let components = a.iter().zip(b).zip(c);
            Value::Composite(
                components
                    .map(|((a, b), c)| interpolate([a, b, c], weights))
                    .collect(),
            )
        }
        [a, b, c] => match (number(a), number(b), number(c)) {
            (Some(a), Some(b), Some(c)) => {
                Value::f32(a * weights[0] + b * weights[1] + c * weights[2])
            }
            _ => a.clone(),
        },
    }
}

/// What the fragment stage gives inside a triangle of three vertices. Its flat inputs are the first
/// vertex's.
fn inside(
    program: &Program,
    seed: u32,
    weights: Weights,
) -> Result<(BTreeMap<String, Value>, bool), Stuck> {
    let corner = |i: u32| {
        let mut at = attributes(seed.wrapping_add(i * 7919));
        // One triangle is one primitive: what is flat, or the instance's, is the same at all of its
        // corners.
        at.insert(2, Value::i32((seed % 7) as i32 - 2));
        run(program, ShaderStage::Vertex, "vs", &at, true)
    };
    between(program, seed, [corner(0)?, corner(1)?, corner(2)?], weights)
}

/// The same of a material with [`affine`] work: its numbers fill the range that ordinary ones have.
fn inside_of_ordinary(
    program: &Program,
    seed: u32,
    weights: Weights,
) -> (BTreeMap<String, Value>, bool) {
    let corner = |i: u32| {
        let own = attributes(seed.wrapping_add(i * 7919));
        let doubled = |v: &Value| match v {
            Value::Composite(parts) => Value::Composite(parts.iter().map(twice).collect()),
            other => twice(other),
        };
        let Value::Composite(p) = doubled(&own[&0]) else {
            panic!("a position is a vector");
        };
        let at = BTreeMap::from([
            (0, Value::Composite(p[..3].to_vec())),
            (1, doubled(&own[&1])),
        ]);
        run(program, ShaderStage::Vertex, "vs", &at, true).unwrap()
    };
    between(program, seed, [corner(0), corner(1), corner(2)], weights).unwrap()
}

fn twice(value: &Value) -> Value {
    match value {
        Value::Scalar(Scalar::F32(x)) => Value::f32(x * 2.0),
        other => other.clone(),
    }
}

fn between(
    program: &Program,
    seed: u32,
    corners: [Ran; 3],
    weights: Weights,
) -> Result<(BTreeMap<String, Value>, bool), Stuck> {
    let (_, fragment) = program.entry_point(ShaderStage::Fragment, "fs").unwrap();
    let mut varyings = BTreeMap::new();
    for input in interface::inputs(program.module(), &fragment.function) {
        if let Some(Binding::Location {
            location,
            interpolation,
            ..
        }) = input.binding
        {
            let at = corners.each_ref().map(|c| &c.by_location[&location]);
            let value = match interpolation {
                Some(Interpolation::Flat) => at[0].clone(),
                _ => interpolate(at, weights),
            };
            varyings.insert(location, value);
        }
    }
    let front = seed.is_multiple_of(2);
    let ran = run(program, ShaderStage::Fragment, "fs", &varyings, front)?;
    Ok((ran.by_binding, ran.discarded))
}

/// A random material in which a float and an integer input of the fragment stage are constants of
/// the draw instead.
fn material(bytes: &[u8]) -> String {
    let fragment = random::shader(bytes)
        .replace("in.r", "draw.r")
        .replace("in.k", "draw.k");
    format!(
        "struct Draw {{ r: f32, k: i32 }}\n@group(0) @binding(0) var<uniform> draw: Draw;\n\
         {fragment}{VERTEX}"
    )
}

/// The material before and after what is hoisted without a budget; `None` where nothing is.
fn hoisted(source: &str, allow: Allow) -> Option<(Program, Program, String)> {
    hoisted_given(source, allow, &Facts::default())
}

fn hoisted_given(source: &str, allow: Allow, facts: &Facts) -> Option<(Program, Program, String)> {
    let program = common::program(source);
    let plan = Plan::original("test", program, "vs", Some("fs"), &MaterialState::default());
    let params = HoistParams {
        allow: Some(allow),
        vertices_per_fragment: Some(0.0),
        ..HoistParams::default()
    };
    let done = Hoist::run(&plan, facts, &params).ok()?;
    let of = |plan: &Plan| plan.program(plan.main().unwrap()).unwrap().clone();
    Some((of(&plan), of(&done.plan), done.change.what))
}

const WEIGHTS: [Weights; 3] = [
    [0.333_333_34, 0.333_333_34, 0.333_333_34],
    [0.719_327_1, 0.199_034_3, 0.081_638_71],
    [0.100_000_024, 0.2, 0.7],
];

/// Whether anything was hoisted from a random material: what is exact is the same bits.
fn exact_inside(bytes: &[u8], seed: u32) -> bool {
    exact_as_carried(&material(bytes), seed)
}

fn exact_as_carried(source: &str, seed: u32) -> bool {
    let Some((before, after, what)) = hoisted(source, Allow::Exact) else {
        return false;
    };
    for weights in WEIGHTS {
        let (Ok(a), Ok(b)) = (
            inside(&before, seed, weights),
            inside(&after, seed, weights),
        ) else {
            continue;
        };
        // As text, in which NaN equals NaN.
        assert_eq!(
            format!("{a:?}"),
            format!("{b:?}"),
            "seed {seed}: {what}\n{source}\n=====\n{}",
            common::wgsl(&after)
        );
    }
    true
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, ..ProptestConfig::default() })]

    #[test]
    fn exact_hoists_give_the_same_bits_inside_a_triangle(
        bytes in proptest::collection::vec(any::<u8>(), 0..400),
        seed in any::<u32>(),
    ) {
        exact_inside(&bytes, seed);
    }
}

/// A material in which the draw's constants decide between constants and varyings, some of them
/// behind a call, and in which the last bit shows.
fn choosing(steps: &[(u8, u8, u8, u8)]) -> String {
    use std::fmt::Write as _;
    let mut body = String::new();
    for (target, kind, from, guard) in steps {
        let variable = |i: u8| ["a", "b", "c"][usize::from(i % 3)];
        let to = variable(*target);
        let value = match kind % 6 {
            0 | 1 => format!("sin(draw.r * {from}.5) * cos(draw.r + {from}.25)"),
            2 => "in.p.x".to_owned(),
            3 => ["in.r", "in.q.y", "in.p.w"][usize::from(from % 3)].to_owned(),
            4 => variable(*from).to_owned(),
            _ => format!(
                "pick({}, {})",
                variable(*from),
                variable(target.wrapping_add(1))
            ),
        };
        let store = format!("{to} = {value};");
        let _ = match guard % 4 {
            0 => writeln!(body, "{store}"),
            1 => writeln!(body, "if draw.k > {} {{ {store} }}", from % 3),
            2 => writeln!(
                body,
                "if draw.k > 0 {{ {store} }} else {{ {to} = {}; }}",
                variable(*from)
            ),
            _ => writeln!(body, "{to} = select({to}, {value}, draw.r > 1.0);"),
        };
    }
    format!(
        "struct Draw {{ r: f32, k: i32 }}
@group(0) @binding(0) var<uniform> draw: Draw;
struct In {{ @location(0) p: vec4<f32>, @location(1) q: vec2<f32>, @location(2) \
    @interpolate(flat) k: i32, @location(3) r: f32 }}
fn pick(x: f32, y: f32) -> f32 {{ if draw.k > 0 {{ return x; }} return y; }}
@fragment fn fs(in: In) -> @location(0) vec4<f32> {{
    var a: f32 = 0.5; var b: f32 = in.q.x; var c: f32;
    {body}
    if fract(b * 4194304.0) > 0.75 {{ discard; }}
    return fract(vec4(a, b, c, a + b) * 4194304.0);
}}
{VERTEX}"
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn what_the_draw_chooses_is_exact_inside_a_triangle(
        steps in proptest::collection::vec(any::<(u8, u8, u8, u8)>(), 1..8),
        seed in any::<u32>(),
    ) {
        exact_as_carried(&choosing(&steps), seed);
    }
}

#[test]
fn enough_is_hoisted_exactly_to_count() {
    let hoisted = (0..120_u32)
        .filter(|i| {
            let bytes: Vec<u8> = (0..200_u32)
                .map(|j| (i.wrapping_mul(7919).wrapping_add(j * j * 31) >> 3) as u8)
                .collect();
            exact_inside(&bytes, i * 77 + 5)
        })
        .count();
    assert!(hoisted >= 15, "only {hoisted} of 120");
}

/// A material whose fragment stage is `body`, with a matrix of the draw to make affine work of a
/// position.
fn affine(body: &str) -> String {
    format!(
        "struct Draw {{ m: mat4x4<f32>, v: vec4<f32> }}
@group(0) @binding(0) var<uniform> draw: Draw;
struct Varyings {{ @builtin(position) position: vec4<f32>, @location(0) world: vec3<f32>, \
    @location(1) uv: vec2<f32> }}
@vertex fn vs(@location(0) p: vec3<f32>, @location(1) uv: vec2<f32>) -> Varyings {{ \
    return Varyings(vec4(p, 1.0), p, uv); }}
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {{
    let p = (draw.m * vec4(in.world, 1.0)).xyz;
    {body}
}}"
    )
}

/// After a cancellation nothing is left but last bits, and a large factor makes any number of them:
/// one after the other, in a vector, in a matrix, in a function.
#[test]
fn rounding_does_not_reach_what_amplifies_it() {
    for body in [
        "return vec4(0.5 + 0.5 * normalize(p - vec3(p.xy, 0.5)), 1.0);",
        "return vec4((p.x - in.world.x) / (p.y - in.world.y));",
        "return vec4(inverseSqrt(abs(p.x - in.world.x)));",
        "return vec4(sqrt(abs(p.x - in.world.x)) * 1000.0);",
        "return vec4(log(abs(p.x - in.world.x)));",
        "return vec4(acos(p.x - in.world.x));",
        "return vec4(atan2(p.x - in.world.x, p.y));",
        "return vec4(pow(abs(p.x - in.world.x), 0.1));",
        "return vec4(pow(abs(p.x - in.world.x), draw.v.x));",
        "return vec4((p.x - in.world.x) * 1e6);",
        "return vec4((p.x - in.world.x) / 1e-6);",
        "return vec4(smoothstep(0.5, 0.500001, p.x));",
        "return vec4(refract(p, in.world, 0.7), 1.0);",
        "return vec4(faceForward(p, in.world, p), 1.0);",
        "return vec4(tan(p), 1.0);",
        "return vec4(sin(p * 60.0 * 70.0), 1.0);",
        "return vec4(sin(p * vec3(3000.0, 4000.0, 5000.0)), 1.0);",
        "return vec4(sin(dot(p, vec3(3000.0, 4000.0, 5000.0))));",
        "return vec4(sin(fma(p, vec3(4000.0), p)), 1.0);",
        "return vec4(mix(p, in.world, 4000.0), 1.0);",
        "return vec4(cross(p, vec3(4000.0, 0.0, 0.0)), 1.0);",
        "return vec4(mat3x3<f32>(4000.0, 0.0, 0.0, 0.0, 4000.0, 0.0, 0.0, 0.0, 4000.0) * p, 1.0);",
        "return vec4(sin(exp(p * 0.5 + 8.0)), 1.0);",
        "return vec4(sinh(p), 1.0);",
        "return vec4(sin(p * (draw.v.x * 4000.0)), 1.0);",
        "return vec4(sin((p * 40.0) * draw.v.x * draw.v.y * draw.v.z), 1.0);",
        "let far = p + vec3(draw.v.x * 1e5); return vec4(abs(far - vec3(draw.v.x * 1e5)), 1.0);",
        "var x = p; for (var i = 0; i < 8; i++) { x = x * 4.0 - in.world; } return vec4(sin(x), \
         1.0);",
        "return vec4(pow(abs(p.x), 8.0));",
        // Ranges of what is clamped from outside of its bounds, and of remainders.
        "return vec4(sin(p * clamp(-5.0, draw.v.x * 1000.0, 30000.0)), 1.0);",
        "return vec4(sin(p * (draw.v.x * 900.0) % 3000.0), 1.0);",
        // Functions that are only so accurate.
        "return vec4(asinh(p * 1e-3) * 1.3e5, 1.0);",
        "return vec4(atan(p) * 100.0, 1.0);",
    ] {
        assert!(hoisted(&affine(body), Allow::Rounding).is_none(), "{body}");
    }
}

/// Layers of one pixel add up, samples lie outside of triangles, coverage jumps: no rounding is
/// small there. What is behind another hoist has its varyings elsewhere.
#[test]
fn rounding_needs_one_fragment_a_pixel() {
    let source = affine("return vec4(sin(p), 1.0);");
    let with = |change: &dyn Fn(&mut MaterialState)| {
        let mut state = MaterialState::default();
        change(&mut state);
        let program = common::program(&source);
        let plan = Plan::original("test", program, "vs", Some("fs"), &state);
        let params = HoistParams {
            vertices_per_fragment: Some(0.0),
            ..HoistParams::default()
        };
        usize::from(Hoist::run(&plan, &Facts::default(), &params).is_ok())
    };
    assert_eq!(with(&|_| {}), 1);
    assert_eq!(with(&|state| state.multisample.count = 4), 0);
    assert_eq!(
        with(&|state| {
            state.targets = vec![Some(ColorTarget {
                blend: Some(Blend::ALPHA),
                ..ColorTarget::opaque("rgba8unorm")
            })];
        }),
        0
    );
}

const CARRIED: [&str; 9] = [
    "return vec4(length(p) * 0.1);",
    "return vec4(sin(p) * in.uv.x, 1.0);",
    "return vec4(exp(-length(p)));",
    "return vec4(pow(saturate(p.x), 3.0));",
    "return vec4((p / draw.v.x + p / 3.0) * 0.25, 1.0);",
    "return vec4(smoothstep(0.25, 0.75, p.x));",
    "return vec4(normalize(in.world) + p, 1.0);",
    "return vec4(sin((draw.m * vec4(p, 1.0)).xyz) * 0.1, 1.0);",
    "return vec4(1.0 / (1.0 + abs(p)), 1.0);",
];

/// Half a step of 8 bits, where no number from outside is further from 0 than 4.
#[test]
fn what_is_carried_under_rounding_changes_outputs_by_half_a_step_at_most() {
    let numbers = |value: &Value, out: &mut Vec<f32>| {
        fn walk(value: &Value, out: &mut Vec<f32>) {
            match value {
                Value::Scalar(Scalar::F32(x)) => out.push(*x),
                Value::Composite(parts) => parts.iter().for_each(|p| walk(p, out)),
                _ => {}
            }
        }
        walk(value, out);
    };
    let mut largest = 0.0_f64;
    for body in CARRIED {
        let (before, after, what) =
            hoisted(&affine(body), Allow::Rounding).unwrap_or_else(|| panic!("{body}"));
        for seed in 0..200 {
            for weights in WEIGHTS {
                let a = inside_of_ordinary(&before, seed, weights);
                let b = inside_of_ordinary(&after, seed, weights);
                let (mut of_a, mut of_b) = (Vec::new(), Vec::new());
                a.0.values().for_each(|v| numbers(v, &mut of_a));
                b.0.values().for_each(|v| numbers(v, &mut of_b));
                assert_eq!(of_a.len(), 4);
                for (x, y) in of_a.iter().zip(&of_b) {
                    let off = f64::from((x - y).abs());
                    assert!(off <= 0.5 / 255.0, "{body} ({what}): {x} {y}, seed {seed}");
                    largest = largest.max(off);
                }
            }
        }
    }
    assert!(largest > 0.0, "nothing was rounded elsewhere");
}

/// The ranges of a scene decide where they are known: large numbers refuse what ordinary ones
/// allow, small ones allow what those refuse.
#[test]
fn the_numbers_of_a_scene_decide() {
    let ranges = |world: f32, draw: f32| Facts {
        ranges: vec![
            range(Source::Varying { location: 0 }, [-world, world]),
            range(Source::Varying { location: 1 }, [0.0, 1.0]),
            range(member("m"), [-1.0, 1.0]),
            range(member("v"), [draw, 2.0 * draw]),
        ],
        ..Facts::default()
    };
    let sine = affine("return vec4(sin(p * draw.v.x), 1.0);");
    let allowed =
        |source: &str, facts: &Facts| hoisted_given(source, Allow::Rounding, facts).is_some();
    assert!(allowed(&sine, &ranges(1.0, 0.5)));
    assert!(!allowed(&sine, &ranges(1e5, 0.5)));
    assert!(!allowed(&sine, &ranges(1.0, 4000.0)));
    let steep = affine("return vec4(sin(p * 20.0), 1.0);");
    assert!(!allowed(&steep, &Facts::default()));
    assert!(allowed(&steep, &ranges(1.0, 0.5)));
    let quotient = affine("return vec4(p / draw.v.x, 1.0);");
    assert!(allowed(&quotient, &ranges(1.0, 0.5)));
    assert!(!allowed(&quotient, &ranges(1.0, 1e-6)));
    // As wide as a scene's that crosses 0.
    let mut crossing = ranges(1.0, 0.5);
    crossing.ranges[3].low = -1.0;
    assert!(!allowed(&quotient, &crossing));
}

fn range(source: Source, [low, high]: [f32; 2]) -> SourceRange {
    SourceRange {
        material: "test".to_owned(),
        source,
        low,
        high,
        components: Vec::new(),
    }
}

fn member(name: &str) -> Source {
    Source::Buffer {
        group: 0,
        binding: 0,
        member: Some(name.to_owned()),
    }
}
