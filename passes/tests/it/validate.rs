//! Validation is only worth something where it turns red: variants are broken on purpose, one
//! expression or statement at a time.

use naga::{
    BinaryOperator, Block, Expression, Function, Literal, Module, SampleLevel, ShaderStage,
    Statement,
};
use naga_edit::interface;
use preshade_geometry::{examples, pass_named};
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan::{Plan, Role};
use preshade_plan::state::MaterialState;
use preshade_validate::{Check, Counterexample, Effort, Verdict, validate};

use crate::common;

/// A material with a loop, a discard, a private variable, a callee with a pointer, an effect that a
/// uniform switches off and a wave that may be hoisted.
const MATERIAL: &str = "
struct Camera { view_projection: mat4x4<f32>, sun: vec4<f32> }
struct Material { fog: f32, octaves: i32, tint: vec3<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<uniform> material: Material;
@group(1) @binding(0) var picture: texture_2d<f32>;
@group(1) @binding(1) var filtering: sampler;
struct Varyings { @builtin(position) position: vec4<f32>, @location(0) world: vec3<f32>, \
    @location(1) normal: vec3<f32>, @location(2) uv: vec2<f32> }
var<private> wear: f32;
fn put(to: ptr<function, f32>, x: f32) { *to = x - 0.25; wear = wear + x; }
fn waves(p: vec3<f32>) -> f32 {
    var sum = 0.0;
    var weight = 0.5;
    for (var i = 0; i < 3; i += 1) { sum += weight * sin(p.x * 3.0 - p.y * 1.5 + p.z); \
        weight *= 0.5; }
    return sum;
}
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>, \
    @location(2) uv: vec2<f32>) -> Varyings {
    var out: Varyings;
    let moved = vec4(position + vec3(0.0, 0.1 * sin(position.x - 0.5), 0.0), 1.0);
    out.position = camera.view_projection * moved;
    out.world = moved.xyz;
    out.normal = normal - vec3(0.0, 0.25, 0.0);
    out.uv = uv / 2.0;
    return out;
}
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {
    let texel = textureSample(picture, filtering, in.uv);
    if texel.a - 0.3 < 0.1 { discard; }
    let lit = waves(in.world) - 0.5 * max(dot(in.normal, camera.sun.xyz), 0.0);
    var shade = 0.0;
    put(&shade, lit);
    var color = texel.rgb * material.tint + vec3(shade - wear);
    if material.fog > 0.0 { color = mix(color, vec3(0.7), 1.0 - exp(-material.fog * in.world.z)); }
    return vec4(color, 1.0);
}
";

fn plan(source: &str) -> Plan {
    let program = common::program(source);
    Plan::original("test", program, "vs", Some("fs"), &MaterialState::default())
}

fn applied(plan: &Plan, pass: &str, params: serde_json::Value) -> Plan {
    let pass = pass_named(pass).unwrap();
    let facts = Facts::without_ties();
    let outcome = pass.run(plan, &facts, &params);
    outcome.unwrap_or_else(|refused| panic!("{refused:?}")).plan
}

const EFFORT: Effort = Effort {
    inputs: 48,
    seed: 0,
    steps: 5_000,
    paths: 64,
};

fn recipes(of: &[Use]) -> Vec<(&'static str, serde_json::Value)> {
    let used = examples().filter(|(_, used)| of.contains(used));
    used.map(|(recipe, _)| common::step(recipe)).collect()
}

fn said(checks: &[Check]) -> String {
    let lines = checks
        .iter()
        .map(|c| format!("{}: {}: {}", c.role.name(), c.promise, c.verdict));
    lines.collect::<Vec<_>>().join("\n")
}

#[test]
fn unbroken_variants_keep_every_promise() {
    let original = plan(MATERIAL);
    for (pass, params) in recipes(&[Use::Keep, Use::Break]) {
        let variant = applied(&original, pass, params.clone());
        let checks = validate(&original, &variant, &EFFORT);
        assert!(
            checks.iter().any(|c| c.verdict.holds()),
            "{pass} {params}: {}",
            said(&checks)
        );
        assert!(
            !checks.iter().any(|c| c.verdict.is_broken()),
            "{pass} {params}: {}",
            said(&checks)
        );
    }
}

/// A way to break a module, once for each place where that is possible.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mutation {
    /// `a - b` to `b - a`, and likewise what else has an order.
    Swap,
    /// A literal to another.
    Constant,
    /// A store that is not done.
    Store,
    /// A discard that is not done.
    Kill,
    /// A branch taken the other way.
    Branch,
}

fn functions(module: &mut Module) -> Vec<&mut Function> {
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    module
        .functions
        .iter_mut()
        .map(|(_, f)| f)
        .chain(entries)
        .collect()
}

/// The `n`-th mutant of a kind; `None` where there are less.
fn mutant(module: &Module, kind: Mutation, n: usize) -> Option<Module> {
    let mut module = module.clone();
    let mut left = n;
    for function in functions(&mut module) {
        let hit = match kind {
            Mutation::Swap | Mutation::Constant => expression(function, kind, &mut left),
            _ => statement(&mut function.body, kind, &mut left),
        };
        if hit {
            return Some(module);
        }
    }
    None
}

fn expression(function: &mut Function, kind: Mutation, left: &mut usize) -> bool {
    use BinaryOperator as B;
    let handles: Vec<_> = function.expressions.iter().map(|(h, _)| h).collect();
    for handle in handles {
        let other = match (kind, &function.expressions[handle]) {
            (Mutation::Swap, Expression::Binary { op, left, right })
                if matches!(
                    op,
                    B::Subtract | B::Divide | B::Less | B::Greater | B::LessEqual | B::GreaterEqual
                ) && left != right =>
            {
                Expression::Binary {
                    op: *op,
                    left: *right,
                    right: *left,
                }
            }
            (Mutation::Constant, Expression::Literal(Literal::F32(x)))
                if is_read(function, handle) =>
            {
                Expression::Literal(Literal::F32(x * 1.25 + 0.125))
            }
            _ => continue,
        };
        if *left == 0 {
            function.expressions[handle] = other;
            return true;
        }
        *left -= 1;
    }
    false
}

/// Front ends leave literals that nothing reads.
fn is_read(function: &Function, literal: naga::Handle<Expression>) -> bool {
    let mut blocks = vec![&function.body];
    while let Some(block) = blocks.pop() {
        for statement in block {
            let mut read = naga_operands::of_statement(statement);
            if let Statement::Emit(range) = statement {
                let emitted = range.clone();
                read.extend(
                    emitted.flat_map(|e| naga_operands::of_expression(&function.expressions[e])),
                );
            }
            if read.contains(&literal) {
                return true;
            }
            blocks.extend(naga_operands::blocks(statement));
        }
    }
    false
}

fn statement(block: &mut Block, kind: Mutation, left: &mut usize) -> bool {
    for i in 0..block.len() {
        let is_one = matches!(
            (kind, &block[i]),
            (Mutation::Store, Statement::Store { .. })
                | (Mutation::Kill, Statement::Kill)
                | (Mutation::Branch, Statement::If { .. })
        );
        if is_one && *left == 0 {
            match &mut block[i] {
                Statement::If { accept, reject, .. } => std::mem::swap(accept, reject),
                _ => block.cull(i..=i),
            }
            return true;
        }
        *left -= usize::from(is_one);
        let hit = match &mut block[i] {
            Statement::Block(inner) => statement(inner, kind, left),
            Statement::If { accept, reject, .. } => {
                statement(accept, kind, left) || statement(reject, kind, left)
            }
            Statement::Loop {
                body, continuing, ..
            } => statement(body, kind, left) || statement(continuing, kind, left),
            _ => false,
        };
        if hit {
            return true;
        }
    }
    false
}

/// The variant with a broken program under the key; `None` where it does not validate, which no
/// validation of ours has to see.
fn broken(variant: &Plan, key: &str, kind: Mutation, n: usize) -> Option<Option<Plan>> {
    let program = &variant.programs[key];
    let module = mutant(program.module(), kind, n)?;
    let mut plan = variant.clone();
    let Ok(program) = program.with_module(module) else {
        return Some(None);
    };
    plan.programs.insert(key.to_owned(), program);
    Some(Some(plan))
}

/// All of them with `PRESHADE_MUTANTS=all`.
fn every(kind: Mutation) -> usize {
    match (std::env::var("PRESHADE_MUTANTS").is_ok(), kind) {
        (false, Mutation::Constant) => 3,
        _ => 1,
    }
}

fn counterexample(checks: &[Check]) -> Option<Counterexample> {
    checks.iter().find_map(|c| match &c.verdict {
        Verdict::Counterexample(found) => Some((**found).clone()),
        _ => None,
    })
}

/// A counterexample says which of the author's expressions went wrong first.
#[test]
fn a_counterexample_points_at_the_authors_text() {
    let original = plan(MATERIAL);
    let variant = applied(
        &original,
        "hoist",
        serde_json::json!({"budget": 0.1, "vertices-per-fragment": 0.0}),
    );
    let mutants = (0..).map_while(|n| broken(&variant, "main", Mutation::Swap, n));
    let found: Vec<Counterexample> = mutants
        .flatten()
        .filter_map(|plan| counterexample(&validate(&original, &plan, &EFFORT)))
        .collect();
    let text = "p.x * 3.0 - p.y * 1.5";
    let is_there = |c: &&Counterexample| c.first.as_ref().is_some_and(|f| f.text == text);
    let found = found.iter().find(is_there).unwrap();
    let first = found.first.as_ref().unwrap();
    let line = MATERIAL.lines().position(|l| l.contains(text)).unwrap();
    assert_eq!(first.location.as_ref().unwrap().line as usize, line + 1);
    assert!(
        found
            .inputs
            .iter()
            .any(|(name, _)| name == "position of vertex 0"),
        "{found}"
    );
    assert!(found.to_string().contains("instead of"), "{found}");
}

/// What is not looked at is never said to hold.
#[test]
fn what_cannot_be_evaluated_is_told_and_does_not_hold() {
    let source = "
@group(0) @binding(0) var<storage, read_write> hits: atomic<u32>;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }
@fragment fn fs() -> @location(0) vec4<f32> { atomicAdd(&hits, 1u); return vec4(1.0); }";
    let original = plan(source);
    let checks = validate(&original, &original, &EFFORT);
    let [.., colors] = &checks[..] else { panic!() };
    assert!(matches!(colors.verdict, Verdict::NotEvaluable { .. }));
    assert!(!colors.verdict.holds());
    assert!(colors.verdict.to_string().starts_with("not evaluated"));
    // Endless for every input that there is.
    let source = "
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }
@fragment fn fs(@location(0) x: f32) -> @location(0) vec4<f32> {
    var y = x;
    loop { y = sin(y); if y > 2.0 { break; } }
    return vec4(y);
}";
    let original = plan(source);
    let mut other = original.clone();
    let program = common::program(&source.replace("vec4(y)", "vec4(y + 1.0)"));
    other.programs.insert("main".to_owned(), program);
    let checks = validate(
        &original,
        &other,
        &Effort {
            steps: 500,
            inputs: 12,
            ..EFFORT
        },
    );
    assert!(
        checks
            .iter()
            .all(|c| c.promise == "positions" || !c.verdict.holds()),
        "{}",
        said(&checks)
    );
}

/// A store to memory that the variant leaves out.
#[test]
fn stores_are_promised_too() {
    let source = "
@group(0) @binding(0) var<storage, read_write> seen: array<f32, 4>;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }
@fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> { seen[1] = p.x; \
    return p; }";
    let original = plan(source);
    let checks = validate(&original, &original, &EFFORT);
    assert!(
        checks.iter().all(|c| c.verdict.holds()),
        "{}",
        said(&checks)
    );
    let mut other = original.clone();
    other.programs.insert(
        "main".to_owned(),
        common::program(&source.replace("seen[1] = p.x; ", "")),
    );
    let found = validate(&original, &other, &EFFORT);
    assert!(counterexample(&found).unwrap().output.contains("buffer"));
}

/// The guard of a specialised variant decides which inputs count: outside of it another picture is
/// nobody's bug.
#[test]
fn inputs_are_what_the_guard_wants() {
    let original = plan(MATERIAL);
    let variant = applied(
        &original,
        "specialize",
        serde_json::json!({"set": "material.fog=0"}),
    );
    let checks = validate(&original, &variant, &EFFORT);
    assert!(
        checks.iter().all(|c| c.verdict.holds()),
        "{}",
        said(&checks)
    );
    let unguarded = Plan {
        guard: None,
        ..variant
    };
    let checks = validate(&original, &unguarded, &EFFORT);
    assert!(
        checks.iter().any(|c| c.verdict.is_broken()),
        "{}",
        said(&checks)
    );
}

/// Each stage has its own check, by role.
#[test]
fn a_pre_pass_that_moves_a_vertex_by_its_last_bit_is_seen() {
    let original = plan(MATERIAL);
    let variant = applied(&original, "depth-prepass", serde_json::json!({}));
    let prepass = variant
        .passes
        .iter()
        .find(|p| p.role == Role::Prepass)
        .unwrap();
    let program = variant.program(prepass).unwrap();
    let (_, entry) = program
        .entry_point(ShaderStage::Vertex, &prepass.vertex)
        .unwrap();
    assert!(!interface::outputs(program.module(), &entry.function).is_empty());
    // The same sum in another order.
    let text = common::wgsl(program);
    let moved = text.replacen("position + ", "position * 1.0000001 + ", 1);
    assert_ne!(text, moved, "{text}");
    let mut other = variant.clone();
    other
        .programs
        .insert(prepass.program.clone(), common::program(&moved));
    let checks = validate(&original, &other, &EFFORT);
    let found = checks
        .iter()
        .find(|c| c.role == Role::Prepass && c.promise == "positions")
        .unwrap();
    assert!(found.verdict.is_broken(), "{}", said(&checks));
}

/// What the vertex stage hands on of a number that is known is known in the fragment stage too,
/// which is made for that and no other varying.
#[test]
fn a_fragment_stage_made_for_varyings_that_are_known_is_not_asked_of_others() {
    let original = plan(
        "struct Tiling { scale: f32, bias: f32 }
@group(0) @binding(0) var<uniform> tiling: Tiling;
struct Varyings { @builtin(position) position: vec4<f32>, @location(0) at: vec2<f32>, \
    @location(1) lit: f32 }
@vertex fn vs(@location(0) p: vec3<f32>) -> Varyings { \
    return Varyings(vec4(p, 1.0), vec2(tiling.scale), p.z); }
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {
    if in.at.x > 0.5 { return vec4(in.lit); }
    return vec4(in.lit * 0.5);
}",
    );
    let set = serde_json::json!({"set": "tiling.scale=0"});
    let variant = applied(&original, "specialize", set);
    let checks = validate(&original, &variant, &EFFORT);
    let told = said(&checks);
    assert!(!checks.iter().any(|c| c.verdict.is_broken()), "{told}");
    assert!(
        checks
            .iter()
            .any(|c| c.promise.contains("inside triangles") && c.verdict.holds()),
        "{told}"
    );
}

/// A prologue that reads packed depths is tried on all of them, not on what the attachment is
/// cleared to: digits that change places are the same of a depth of 1.
#[test]
fn packed_depths_are_tried() {
    let original = plan(MATERIAL);
    let variant = applied(
        &original,
        "early-discard",
        serde_json::json!({"texture": "packed"}),
    );
    let checks = validate(&original, &variant, &EFFORT);
    assert!(
        checks.iter().all(|c| !c.verdict.is_broken()),
        "{}",
        said(&checks)
    );
    let mut broken = variant.clone();
    let mut changed = 0;
    for program in broken.programs.values_mut() {
        let mut module = program.module().clone();
        let mut swap = |expression: &mut Expression| {
            if let Expression::Literal(Literal::F32(factor)) = expression {
                let [high, low] = [255.0 / 256.0, 255.0 / 65_536.0];

                let pairs = [(high, low), (low, high)];
                if let Some((_, to)) = pairs.into_iter().find(|(from, _)| from == factor) {
                    *factor = to;
                    changed += 1;
                }
            }
        };
        module
            .global_expressions
            .iter_mut()
            .for_each(|(_, e)| swap(e));
        for function in functions(&mut module) {
            function.expressions.iter_mut().for_each(|(_, e)| swap(e));
        }
        *program = program.with_module(module).unwrap();
    }
    assert_eq!(changed, 2);
    let checks = validate(&original, &broken, &EFFORT);
    assert!(
        checks.iter().any(|c| c.verdict.is_broken()),
        "{}",
        said(&checks)
    );
}

const LEVELS: &str = "
struct Material { fog: f32, sharper: f32 }
@group(0) @binding(0) var<uniform> material: Material;
@group(1) @binding(0) var picture: texture_2d<f32>;
@group(1) @binding(1) var filtering: sampler;
struct Varyings { @builtin(position) position: vec4<f32>, @location(0) uv: vec2<f32> }
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> Varyings { \
    return Varyings(vec4(position, 1.0), uv); }
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {
    let texel = SAMPLE;
    if material.fog > 0.0 { return vec4(mix(texel.rgb, vec3(0.7), material.fog), 1.0); }
    return texel;
}
";
const GRADIENTS: &str =
    "textureSampleGrad(picture, filtering, in.uv, dpdx(in.uv) * 2.0, dpdy(in.uv) * 2.0)";
const BIAS: &str = "textureSampleBias(picture, filtering, in.uv, material.sharper)";

/// The variant with the levels of its samples changed.
fn levelled(variant: &Plan, change: fn(&mut SampleLevel)) -> Plan {
    let mut plan = variant.clone();
    for program in plan.programs.values_mut() {
        let mut module = program.module().clone();
        for function in functions(&mut module) {
            for (_, expression) in function.expressions.iter_mut() {
                if let Expression::ImageSample { level, .. } = expression {
                    change(level);
                }
            }
        }
        *program = program.with_module(module).unwrap();
    }
    plan
}

/// Gradients and a bias that the author names are what a lookup is given; those that a transform
/// writes out for an implicit level are not.
#[test]
fn named_levels_are_looked_at() {
    let known = ("specialize", serde_json::json!({"set": "material.fog=0"}));
    let early = ("early-discard", serde_json::json!({}));
    let swapped = |level: &mut SampleLevel| {
        if let SampleLevel::Gradient { x, y } = level {
            std::mem::swap(x, y);
        }
    };
    let dropped = |level: &mut SampleLevel| *level = SampleLevel::Auto;
    type Change = fn(&mut SampleLevel);
    let cases: [(&str, _, Option<Change>); 5] = [
        (GRADIENTS, &known, Some(swapped)),
        (GRADIENTS, &early, Some(swapped)),
        (BIAS, &known, Some(dropped)),
        // Written out as gradients.
        (BIAS, &early, None),
        ("textureSample(picture, filtering, in.uv)", &early, None),
    ];
    for (sample, (pass, params), change) in cases {
        let original = plan(&LEVELS.replace("SAMPLE", sample));
        let variant = applied(&original, pass, params.clone());
        let checks = validate(&original, &variant, &EFFORT);
        assert!(
            checks.iter().all(|c| !c.verdict.is_broken()),
            "{}",
            said(&checks)
        );
        let Some(change) = change else { continue };
        let checks = validate(&original, &levelled(&variant, change), &EFFORT);
        assert!(
            checks.iter().any(|c| c.verdict.is_broken()),
            "{sample}, {pass}: {}",
            said(&checks)
        );
    }
}

/// A vertex stage that makes its triangle of the index is tried on all of its corners, and on
/// triangles further on.
#[test]
fn every_vertex_index_is_tried() {
    let text = "@vertex fn vs(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
        let far = f32(vertex / 3u);
        return vec4(f32(vertex % 3u) * 2.0 - 1.0, select(-1.0, 3.0, vertex == 1u), far * 0.125, \
            1.0);
    }
    @fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> { return p; }";
    let original = plan(text);
    let variant = applied(&original, "depth-prepass", serde_json::json!({}));
    for (from, to) in [("vertex == 1u", "vertex == 4u"), ("far * 0.125", "0.0")] {
        let mut broken = variant.clone();
        for program in broken.programs.values_mut() {
            *program = common::program(&text.replace(from, to));
        }
        let pass = broken.passes.iter_mut().find(|p| p.role == Role::Main);
        let pass = pass.unwrap();
        (pass.vertex, pass.fragment) = ("vs".to_owned(), Some("fs".to_owned()));
        let checks = validate(&original, &broken, &EFFORT);
        assert!(
            checks.iter().any(|c| c.verdict.is_broken()),
            "{}",
            said(&checks)
        );
    }
}

/// Of a fragment that is discarded no colour is compared, and that is said.
#[test]
fn inputs_without_a_colour_are_not_counted() {
    let text = "
    struct Material { fog: f32 }
    @group(0) @binding(0) var<uniform> material: Material;
    @vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }
    @fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {
        if KEPT { discard; }
        if material.fog > 2.0 { return vec4(0.5); }
        return vec4(sin(p.x) * material.fog);
    }";
    let checks = |kept| {
        let original = plan(&text.replace("KEPT", kept));
        let params = serde_json::json!({"set": "material.fog=1", "fold": "rounding"});
        let variant = applied(&original, "specialize", params);
        let checks = validate(&original, &variant, &EFFORT);
        let colors = checks
            .into_iter()
            .filter(|c| c.promise.starts_with("colours"));
        let verdicts = colors.map(|c| c.verdict).collect::<Vec<_>>();
        assert!(!verdicts.is_empty());
        verdicts
    };
    for verdict in checks("p.x > 0.0") {
        assert!(matches!(verdict, Verdict::NotEvaluable { .. }), "{verdict}");
    }
    for verdict in checks("p.x > 20.0") {
        let Verdict::Agreed {
            inputs, compared, ..
        } = verdict
        else {
            panic!("{verdict}");
        };
        assert!((1..inputs).contains(&compared), "{compared} of {inputs}");
    }
}

/// Push constants have numbers and textures have sizes, so that a variant with another use of them
/// is seen.
#[test]
fn push_constants_and_sizes_of_textures_are_compared() {
    let source = "
struct Push { shift: vec4<f32>, tint: vec4<f32> }
var<immediate> push: Push;
@group(0) @binding(0) var map: texture_2d<f32>;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> {
    return p + push.shift;
}
@fragment fn fs() -> @location(0) vec4<f32> {
    return push.tint / f32(textureDimensions(map, 1).x);
}";
    let original = plan(source);
    let changed = |from: &str, to: &str| {
        let mut other = original.clone();
        let program = common::program(&source.replace(from, to));
        other.programs.insert("main".to_owned(), program);
        validate(&original, &other, &EFFORT)
    };
    for (from, to, expected) in [
        ("p + push.shift", "push.shift + p", None),
        ("p + push.shift", "p + push.tint", Some("position")),
        ("push.tint /", "push.shift /", Some("location 0")),
        ("map, 1).x", "map, 1).y", Some("location 0")),
        ("map, 1).x", "map).x", Some("location 0")),
    ] {
        let checks = changed(from, to);
        let found = counterexample(&checks).map(|c| c.output.clone());
        assert_eq!(found.as_deref(), expected, "{to}: {}", said(&checks));
        assert!(
            checks
                .iter()
                .all(|c| c.verdict.holds() || c.verdict.is_broken()),
            "{}",
            said(&checks)
        );
    }
}

/// The numbers of all inputs together are bounded, whatever the lengths of buffers.
#[test]
fn long_buffers_have_fewer_inputs() {
    let effort = Effort {
        inputs: 240,
        ..EFFORT
    };
    for (length, buffers, expected) in [(64, 1, 240), (1024, 1, 128), (1024, 9, 18)] {
        let declared: String = (0..buffers)
            .map(|i| {
                format!(
                    "@group(0) @binding({i}) var<storage> b{i}: array<mat4x4<f32>, {length}>;\n"
                )
            })
            .collect();
        let source = declared
            + "@vertex fn vs(@location(0) p: vec4<f32>, @location(1) i: u32) -> \
               @builtin(position) vec4<f32> { return p + b0[i][1]; }
               @fragment fn fs() -> @location(0) vec4<f32> { return vec4(1.0); }";
        let original = plan(&source);
        let mut other = original.clone();
        let program = common::program(&source.replace("p + b0[i][1]", "b0[i][1] + p"));
        other.programs.insert("main".to_owned(), program);
        let checks = validate(&original, &other, &effort);
        let Verdict::Agreed { inputs, .. } = checks[0].verdict else {
            panic!("{}", said(&checks));
        };
        assert_eq!(inputs, expected, "{length} {buffers}");
    }
}

#[test]
fn nothing_is_proved_that_no_input_and_no_term_reached() {
    let source = include_str!("../../../fixtures/cases/newcomer/proved-by-word.wgsl");
    let original = plan(source);
    let variant = applied(&original, "depth-prepass", serde_json::json!({}));
    let effort = Effort {
        steps: 500,
        ..EFFORT
    };
    let checks = validate(&original, &variant, &effort);
    let of_colours = |c: &&Check| c.promise.contains("colours");
    let colours: Vec<_> = checks.iter().filter(of_colours).collect();
    assert!(!colours.is_empty(), "{checks:#?}");
    for check in colours {
        let Verdict::NotEvaluable { why } = &check.verdict else {
            panic!("{check:#?}");
        };
        assert!(why.contains("no input came to an end"), "{why}");
    }
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    /// Every mutant of every variant is seen, but for those that compute the same: the prologue's own
    /// tolerance, say, may be wider and drops less.
    #[test]
    fn broken_variants_are_seen() {
        let original = plan(MATERIAL);
        let mut survivors = Vec::new();
        let mut killed = 0;
        for (pass, params) in recipes(&[Use::Break]) {
            let variant = applied(&original, pass, params.clone());
            for key in variant.programs.keys() {
                for kind in [
                    Mutation::Swap,
                    Mutation::Constant,
                    Mutation::Store,
                    Mutation::Kill,
                    Mutation::Branch,
                ] {
                    for n in (0..).step_by(every(kind)) {
                        let Some(plan) = broken(&variant, key, kind, n) else {
                            break;
                        };
                        let Some(plan) = plan else { continue };
                        let checks = validate(&original, &plan, &EFFORT);
                        match checks.iter().any(|c| c.verdict.is_broken()) {
                            true => killed += 1,
                            false => survivors.push(format!(
                                "{pass} {params} {key}: {kind:?} {n}\n{}",
                                said(&checks)
                            )),
                        }
                    }
                }
            }
        }
        println!("{killed} seen, {} not", survivors.len());
        for survivor in &survivors {
            println!("{survivor}");
        }
        assert!(killed > 150, "{killed}");
        assert!(survivors.len() <= killed / 20, "{}", survivors.join("\n"));
    }
}
