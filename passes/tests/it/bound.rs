//! Bounds over triangles hold wherever a value is sampled, and are as tight as the arithmetic
//! promises where that can be worked out by hand.

use std::collections::BTreeMap;

use naga::Module;
use naga_interp::bound::{self, Affine, Distance, Interval};
use naga_interp::{Environment, Number, Shadowed, Stuck, Value};
use proptest::prelude::*;

use crate::common;

/// The module of a function `f` of a position and of texture coordinates.
fn module(body: &str) -> Module {
    let source = format!(
        "fn f(p: vec3<f32>, q: vec2<f32>) -> vec3<f32> {{ {body} }}
@fragment fn fs(@location(0) p: vec3<f32>, @location(1) q: vec2<f32>) -> @location(0) vec4<f32> {{ \
    return vec4(f(p, q), 1.0); }}"
    );
    common::program(&source).module().clone()
}

type Corner = [f32; 5];

fn arguments([x, y, z, u, v]: Corner) -> Vec<Value> {
    vec![Value::vector(&[x, y, z]), Value::vector(&[u, v])]
}

fn distances(module: &Module, corners: [Corner; 3], parts: u32) -> Result<Vec<Distance>, Stuck> {
    let (_, function) = module.functions.iter().next().unwrap();
    let [a, b, c] = corners.map(|c| {
        let arguments = arguments(c);
        arguments.iter().map(bound::exactly).collect::<Vec<_>>()
    });
    let environment = bound::environment(BTreeMap::new());
    bound::over_triangle(module, function, [&a, &b, &c], &environment, parts)
}

fn bounds(module: &Module, corners: [Corner; 3], parts: u32) -> Result<Vec<f64>, Stuck> {
    let distances = distances(module, corners, parts)?;
    Ok(distances.into_iter().map(|d| d.max).collect())
}

fn value(module: &Module, at: Corner) -> Vec<f32> {
    let (_, function) = module.functions.iter().next().unwrap();
    let environment = Environment {
        resources: BTreeMap::new().into(),
        texture: &|_| [0.0; 4],
        derivative: None,
        trace: None,
        steps: 100_000,
    };
    let outcome = naga_interp::run(module, function, &arguments(at), &environment).unwrap();
    outcome.result.unwrap().floats().unwrap()
}

fn between(corners: [Corner; 3], weights: [f32; 3]) -> Corner {
    std::array::from_fn(|i| (0..3).map(|c| corners[c][i] * weights[c]).sum())
}

/// Barycentric coordinates of a lattice in the triangle.
fn lattice(n: u32) -> impl Iterator<Item = [f32; 3]> {
    (0..=n)
        .flat_map(move |i| (0..=n - i).map(move |j| [i, j, n - i - j].map(|w| w as f32 / n as f32)))
}

/// Largest distance from the interpolation of the corners on a lattice, of each component.
fn sampled(module: &Module, corners: [Corner; 3], n: u32) -> Vec<f64> {
    let ends = corners.map(|c| value(module, c));
    let mut worst = vec![0.0_f64; 3];
    for weights in lattice(n) {
        let here = value(module, between(corners, weights));
        for (i, worst) in worst.iter_mut().enumerate() {
            let line: f64 = (0..3)
                .map(|c| f64::from(ends[c][i]) * f64::from(weights[c]))
                .sum();
            *worst = worst.max((f64::from(here[i]) - line).abs());
        }
    }
    worst
}

const TRIANGLE: [Corner; 3] = [
    [0.2, 0.1, 0.3, 0.0, 0.0],
    [0.5, 0.2, 0.35, 1.0, 0.0],
    [0.3, 0.6, 0.2, 0.0, 1.0],
];

#[test]
fn what_is_affine_has_no_remainder() {
    let module = module(
        "let m = mat3x3<f32>(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0); \
         return m * p * 0.5 + vec3(q, 1.0) / 3.0;",
    );
    assert_eq!(bounds(&module, TRIANGLE, 1).unwrap(), [0.0; 3]);
}

/// On an edge of length `d` a square is at most `d^2 / 4` below its chord.
#[test]
fn a_square_is_bounded_by_a_quarter_of_its_edge_squared() {
    let module = module("return vec3(p.x * p.x, pow(q.x, 2.0), q.x * q.y);");
    let found = bounds(&module, TRIANGLE, 1).unwrap();
    let seen = sampled(&module, TRIANGLE, 16);
    for (found, seen) in found.iter().zip(&seen) {
        assert!(found >= &(seen - 1e-6), "{found} under {seen}");
        assert!(found <= &(1.5 * seen + 1e-9), "{found} for {seen}");
    }
}

#[test]
fn waves_roots_and_directions_are_bounded_within_a_few_times() {
    for body in [
        "return sin(p * 3.0);",
        "return normalize(p);",
        "return vec3(sqrt(p.x), exp(-p.y), 1.0 / (1.0 + p.z));",
        "return vec3(dot(normalize(p), vec3(0.6, 0.0, 0.8)), length(p), pow(p.x, 8.0));",
        "return vec3(smoothstep(0.0, 1.0, p.x), mix(p.x, p.y, p.z), clamp(p.x, 0.0, 0.9));",
        "var sum = vec3(0.0); for (var i = 0; i < 4; i++) { sum += cos(p * f32(i)); } return sum;",
    ] {
        let module = module(body);
        let found = bounds(&module, TRIANGLE, 8).unwrap();
        let seen = sampled(&module, TRIANGLE, 16);
        for (found, seen) in found.iter().zip(&seen) {
            assert!(found >= &(seen - 1e-6), "{body}: {found} under {seen}");
            assert!(found <= &(1.5 * seen + 2e-3), "{body}: {found} for {seen}");
        }
    }
}

/// What jumps within the triangle is known between two values; what decides a branch there is not
/// known at all.
#[test]
fn jumps_are_intervals_and_branches_end_the_evaluation() {
    let jumps = module("return vec3(floor(p.x * 10.0 + 0.5), step(0.3, p.x), fract(p.y * 10.0));");
    let found = bounds(&jumps, TRIANGLE, 1).unwrap();
    assert_eq!(found, [3.0, 1.0, 1.0]);
    let level = module("return floor(p * 0.1);");
    assert_eq!(bounds(&level, TRIANGLE, 1).unwrap(), [0.0; 3]);
    let branch = module("if p.x > 0.3 { return p; } return -p;");
    assert!(matches!(
        bounds(&branch, TRIANGLE, 1),
        Err(Stuck::Undecided(_))
    ));
    let decided = module("if p.x > 0.7 { return p; } return -p;");
    assert_eq!(bounds(&decided, TRIANGLE, 1).unwrap(), [0.0; 3]);
    let unbounded = module("return vec3(1.0 / (p.x - 0.3), log(p.x - 0.3), tan(p.x * 5.0));");
    assert_eq!(bounds(&unbounded, TRIANGLE, 1).unwrap(), [f64::INFINITY; 3]);
}

#[test]
fn comparisons_are_decided_where_the_ranges_are_apart() {
    let narrow = Affine::between([1.0, 2.0, 3.0]);
    assert_eq!(
        narrow.compare(Affine::constant(4.0)),
        Some(Some(std::cmp::Ordering::Less))
    );
    assert_eq!(narrow.compare(Affine::constant(3.0)), None);
}

/// Evaluates over the triangle, with a constant of the draw: what is proved, and what single
/// evaluations show.
fn with_a_constant(expression: &str, constant: f32) -> (Result<Vec<Distance>, Stuck>, f64) {
    let source = format!(
        "@group(0) @binding(0) var<uniform> u: f32;
        fn f(p: vec2<f32>) -> f32 {{ {expression} }}
        @fragment fn fs(@location(0) p: vec2<f32>) -> @location(0) vec4<f32> {{ \
            return vec4(f(p)); }}"
    );
    let module = common::program(&source).module().clone();
    let (_, function) = module.functions.iter().next().unwrap();
    let corners = [[0.0, 0.0], [1.0, 0.25], [0.25, 1.0]];
    let value = |at: [f32; 2]| -> f32 {
        let environment = Environment {
            resources: BTreeMap::from([((0, 0), Value::f32(constant))]).into(),
            texture: &|_| [0.0; 4],
            derivative: None,
            trace: None,
            steps: 100_000,
        };
        let outcome = naga_interp::run(&module, function, &[Value::vector(&at)], &environment);
        outcome.unwrap().result.unwrap().float().unwrap()
    };
    let mut seen = 0.0_f64;
    for weights in lattice(8) {
        let at = std::array::from_fn(|i| (0..3).map(|c| corners[c][i] * weights[c]).sum());
        let line: f64 = (0..3)
            .map(|c| f64::from(value(corners[c])) * f64::from(weights[c]))
            .sum();
        seen = seen.max((f64::from(value(at)) - line).abs());
    }
    let arguments = corners.map(|c| [bound::exactly(&Value::vector(&c))]);
    let [a, b, c] = &arguments;
    let resources = BTreeMap::from([((0, 0), bound::exactly(&Value::f32(constant)))]);
    let environment = bound::environment(resources);
    let found = bound::over_triangle(&module, function, [a, b, c], &environment, 4);
    (found, seen)
}

/// Ten times the `f32` nearest to 0.7 is a little below 7, and 7 once it is rounded; ten times the
/// one nearest to 0.1 a little above 1, and 1. What rests on which of them it is, is not decided.
#[test]
fn a_rounding_decides_nothing() {
    let wave = "sin(p.x * p.y * 0.9 + p.x * p.x)";
    for (constant, decision) in [
        (0.7, "floor(u * 10.0) - 5.5"),
        (0.7, "trunc(u * 10.0) - 5.5"),
        (0.7, "round(u * 5.0) - 2.5"),
        (0.1, "ceil(u * 10.0) - 2.5"),
        (0.7, "2.0 - fract(u * 10.0) * 1.9"),
        (0.7, "step(7.0, u * 10.0) + 0.1"),
        (0.7, "sign(u * 10.0 - 7.0) + 1.1"),
        (0.7, "8.0 - (u * 10.0) % 7.0"),
        (0.7, "select(1.0, 40.0, u * 10.0 >= 7.0)"),
        (0.7, "f32(i32(u * 10.0)) - 5.5"),
    ] {
        let (found, seen) = with_a_constant(&format!("return ({decision}) * {wave};"), constant);
        assert!(seen > 0.1, "{decision}: {seen}");
        match found {
            Ok(found) => assert!(
                found[0].max + found[0].roundings >= seen,
                "{decision}: {found:?} under {seen}"
            ),
            Err(stuck) => assert!(matches!(stuck, Stuck::Undecided(_)), "{stuck}"),
        }
    }
    let branch = "var k = 1.0; if u * 10.0 >= 7.0 { k = 40.0; } return k * p.x;";
    let (found, _) = with_a_constant(branch, 0.7);
    assert!(matches!(found, Err(Stuck::Undecided(_))), "{found:?}");
}

/// Where nothing is rounded a comparison is decided, and so it is where a rounding cannot reach.
#[test]
fn exact_numbers_and_distant_ones_are_decided() {
    for (constant, body) in [
        (0.5, "if u * 10.0 == 5.0 { return p.x; } return p.x * p.y;"),
        (0.7, "if u * 10.0 >= 6.9 { return p.x; } return p.x * p.y;"),
        (0.75, "return f32(i32(u * 10.0)) * p.x;"),
        (
            1.0,
            "var x = 0.0; for (var i = 0.0; i < 4.0; i += u) { x += p.x; } return x;",
        ),
        (
            3.0,
            "return p.x * (u % 2.0) * fract(u) + floor(u * 0.3) + p.y;",
        ),
    ] {
        let (found, seen) = with_a_constant(body, constant);
        let [found] = found.unwrap()[..] else {
            panic!()
        };
        assert!(
            found.max < 1e-12 && found.roundings < 1e-4,
            "{body}: {found:?}"
        );
        assert!(seen <= found.max + found.roundings);
    }
}

/// Of a corner of which nothing is known there is no interpolation to be near.
#[test]
fn an_unknown_corner_has_no_bound() {
    let module = module("return vec3(1.0 / p.x, p.y, p.z);");
    let mut corners = TRIANGLE;
    corners[0][0] = 0.0;
    for parts in [1, 4] {
        let found = bounds(&module, corners, parts).unwrap();
        assert_eq!(found[0], f64::INFINITY);
        assert!(found[1] < 1e-12 && found[2] < 1e-12);
    }
}

/// A number beyond the range of `f32` is infinite on the adapter.
#[test]
fn overflow_has_no_bound() {
    let module = module("return vec3(exp(p.x * 300.0), exp(p.x * 100.0), p.x * 1e38 * 1e38);");
    let found = bounds(&module, TRIANGLE, 2).unwrap();
    assert_eq!(found[0], f64::INFINITY);
    assert!(found[1].is_finite());
    assert_eq!(found[2], f64::INFINITY);
}

/// A random expression, simplest where the bytes end.
fn expression(bytes: &mut std::slice::Iter<'_, u8>, depth: usize) -> String {
    let mut below = |n: u8| bytes.next().map_or(0, |b| b % n);
    let kind = if depth == 0 { below(4) } else { below(24) };
    let constant = ["0.5f", "1.75f", "-0.3f", "2.0f"][usize::from(below(4))];
    let mut next = || expression(bytes, depth - 1);
    match kind {
        0 => "p.x".to_owned(),
        1 => "p.y".to_owned(),
        2 => "q.x".to_owned(),
        3 => constant.to_owned(),
        4..=6 => format!("({} + {})", next(), next()),
        7..=9 => format!("({} * {})", next(), next()),
        10 => format!("({} - {})", next(), next()),
        11 => format!("({} / (1.5 + abs({})))", next(), next()),
        12 => format!("sin({})", next()),
        13 => format!("cos({} * 2.0)", next()),
        14 => format!("exp(min({}, 1.0))", next()),
        15 => format!("sqrt(abs({}) + 0.01)", next()),
        16 => format!("max({}, {})", next(), next()),
        17 => format!("saturate({})", next()),
        18 => format!("smoothstep(-0.5, {constant} + 1.5, {})", next()),
        19 => format!("mix({}, {}, {})", next(), next(), next()),
        20 => format!("floor({})", next()),
        21 => format!("pow(abs({}) + 0.1, {constant})", next()),
        22 => format!("length(vec2({}, {}))", next(), next()),
        _ => format!("normalize(vec3({}, {}, 0.5)).x", next(), next()),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    /// The remainder is a bound, and what roundings add to it is one of what the sampling in `f32`
    /// adds.
    #[test]
    fn no_sample_is_further_off_than_the_bound(bytes in proptest::collection::vec(any::<u8>(), 4..60), corners in any::<[[i8; 5]; 3]>(), parts in 1..4_u32) {
        let text = expression(&mut bytes.iter(), 4);
        let module = module(&format!("return vec3({text});"));
        let corners = corners.map(|c| c.map(|x| f32::from(x) / 64.0));
        let Ok(found) = distances(&module, corners, parts) else { return Ok(()) };
        let seen = sampled(&module, corners, 6);
        for (found, seen) in found.iter().zip(&seen) {
            prop_assert!(found.max + found.roundings >= *seen, "{text}: {found:?} under {seen}");
        }
    }
}

/// A vector of the intervals that corners span.
fn boxed(corners: [Corner; 3], components: std::ops::Range<usize>) -> Value<Interval> {
    let ends = components.map(|i| {
        let of = |f: fn(f32, f32) -> f32| corners.iter().map(|c| c[i]).reduce(f).unwrap();
        Interval::new(f64::from(of(f32::min)), f64::from(of(f32::max)))
    });
    Value::composite(&ends.collect::<Vec<_>>())
}

fn over_box(module: &Module, corners: [Corner; 3]) -> Result<Vec<Interval>, Stuck> {
    let (_, function) = module.functions.iter().next().unwrap();
    let environment = Environment {
        resources: BTreeMap::new().into(),
        texture: &|_| [Interval::ANYTHING; 4],
        derivative: None,
        trace: None,
        steps: 100_000,
    };
    let arguments = [boxed(corners, 0..3), boxed(corners, 3..5)];
    let outcome = naga_interp::run(module, function, &arguments, &environment)?;
    outcome.result.unwrap().floats()
}

fn shadowed(module: &Module, at: Corner) -> (Vec<Shadowed>, u64) {
    let (_, function) = module.functions.iter().next().unwrap();
    let environment = Environment {
        resources: BTreeMap::new().into(),
        texture: &|_| [Shadowed::of(0.0); 4],
        derivative: None,
        trace: None,
        steps: 100_000,
    };
    let arguments: Vec<_> = arguments(at).iter().map(bound::exactly).collect();
    let outcome = naga_interp::run(module, function, &arguments, &environment).unwrap();
    (outcome.result.unwrap().floats().unwrap(), outcome.flips)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    /// What `f32` gives of numbers of the box lies in the interval, and so does what `f64` gives.
    #[test]
    fn an_interval_holds_every_sample(bytes in proptest::collection::vec(any::<u8>(), 4..60), corners in any::<[[i8; 5]; 3]>()) {
        let text = expression(&mut bytes.iter(), 4);
        let module = module(&format!("return vec3({text});"));
        let corners = corners.map(|c| c.map(|x| f32::from(x) / 64.0));
        let found = over_box(&module, corners).unwrap();
        for weights in lattice(4) {
            let at = between(corners, weights);
            let (shadowed, _) = shadowed(&module, at);
            prop_assert!(found[0].contains(f64::from(shadowed[0].value)), "{text} at {at:?}: \
                {found:?} without {shadowed:?}");
            prop_assert!(found[0].contains(shadowed[0].truth), "{text} at {at:?}: {found:?} \
                without {shadowed:?}");
        }
    }

    /// The one of two numbers is what the interpreter gives of `f32` alone.
    #[test]
    fn a_shadow_changes_nothing(bytes in proptest::collection::vec(any::<u8>(), 4..60), corner in any::<[i8; 5]>()) {
        let module = module(&format!("return vec3({});", expression(&mut bytes.iter(), 4)));
        let corner = corner.map(|x| f32::from(x) / 64.0);
        let (both, _) = shadowed(&module, corner);
        for (both, alone) in both.iter().zip(value(&module, corner)) {
            prop_assert_eq!(both.value.to_bits(), alone.to_bits());
        }
    }
}

#[test]
fn intervals_are_as_narrow_as_they_can_be() {
    let module =
        module("return vec3(sin(p.x) + 2.0 * p.y, floor(q.x + 0.5), exp(p.z) / (2.0 + q.y));");
    let found = over_box(&module, TRIANGLE).unwrap();
    assert!(found.iter().all(|i| i.is_known()), "{found:?}");
    // Over numbers that are one, hardly wider than a rounding.
    let point = over_box(&module, [TRIANGLE[1]; 3]).unwrap();
    for interval in point {
        assert!(interval.high - interval.low < 2e-3, "{interval:?}");
    }
    // What it cannot tell, it does not decide.
    let branch = common::program(
        "fn f(p: vec3<f32>, q: vec2<f32>) -> vec3<f32> { if p.x < 0.3 { return p; } return p.zyx; }
        @fragment fn fs() -> @location(0) vec4<f32> { return vec4(f(vec3(0.0), vec2(0.0)), 1.0); }",
    );
    let found = over_box(branch.module(), TRIANGLE);
    assert!(matches!(found, Err(Stuck::Undecided(_))), "{found:?}");
}

#[test]
fn the_truth_is_what_nothing_was_rounded_of() {
    let module = module("let far = p.x + 1e8; return vec3(far - 1e8, p.y * p.y, p.z);");
    let at = [0.3, 0.1, 0.7, 0.0, 0.0];
    let ([sum, square, input], flips) = (
        <[Shadowed; 3]>::try_from(shadowed(&module, at).0).unwrap(),
        shadowed(&module, at).1,
    );
    assert_eq!((sum.value, flips), (0.0, 0));
    assert!((sum.truth - f64::from(0.3_f32)).abs() < 1e-7);
    assert_eq!(square.truth, f64::from(0.1_f32) * f64::from(0.1_f32));
    assert!(
        square.error() > 0.0 && naga_interp::ulps(f64::from(square.value), square.truth) <= 0.5
    );
    assert_eq!(input.error(), 0.0);
}

/// The path is the one that `f32` takes, and where `f64` would take another that is told.
#[test]
fn flips_are_counted_and_not_taken() {
    for (body, flips) in [
        // In f32 the sum is 1e8 exactly.
        (
            "if p.x + 1e8 > 1e8 { return vec3(1.0); } return vec3(2.0);",
            1,
        ),
        (
            "return select(vec3(2.0), vec3(1.0), vec3(p.x + 1e8) > vec3(1e8));",
            3,
        ),
        (
            "return vec3(2.0 + f32(i32((p.x + 1.0) + 1e8 - 1e8)) * 0.0);",
            1,
        ),
        (
            "return vec3(2.0 + f32(bitcast<u32>(p.x + 1e8 - 1e8) & 0u));",
            1,
        ),
        // An f32 has no integer between 2^24 and two more.
        (
            "return vec3(2.0 + f32(i32(16777216.0 + (p.x * 0.0 + 1.0)) & 0));",
            1,
        ),
        (
            "return faceForward(vec3(2.0), vec3(1.0), vec3(p.x + 1e8 - 1e8 - 0.1));",
            1,
        ),
        (
            "return vec3(2.0) + refract(vec3(0.0, 0.6, -0.8), vec3(0.0, 0.0, 1.0), 2.0 - 3.0 * \
             (p.x + 1e8 - 1e8));",
            1,
        ),
        (
            "return vec3(2.0 + f32(frexp(0.9 + (p.x + 1e8 - 1e8)).exp) * 0.0);",
            1,
        ),
        (
            "return vec3(2.0 + f32(pack4x8unorm(vec4(p.x + 1e8 - 1e8)) & 0u));",
            1,
        ),
        ("if p.x > 0.25 { return vec3(2.0); } return vec3(1.0);", 0),
        (
            "return vec3(2.0) + 0.0 * faceForward(p, vec3(1.0), vec3(p.x));",
            0,
        ),
    ] {
        let (found, counted) = shadowed(&module(body), [0.3; 5]);
        assert_eq!((found[0].value, counted), (2.0, flips), "{body}");
        assert_eq!(found[0].truth, 2.0, "{body}");
    }
}
