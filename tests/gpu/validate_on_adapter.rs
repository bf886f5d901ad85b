//! Original and variant run on an adapter, as compute stages: what holds agrees there, and what is
//! broken on purpose is seen by that alone.

use std::collections::BTreeMap;

use naga::{BinaryOperator, Expression, Function, Module, SampleLevel, Statement};
use preshade_compiler::recipe::Recipe;
use preshade_geometry::examples;
use preshade_lab::measure::validate_on;
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan::Plan;
use preshade_plan::state::MaterialState;
use preshade_validate::{Check, Counterexample, Effort, Verdict};

use crate::fixtures_support::{materials, original};
use crate::render_support::{gpu, program};

/// A loop, a discard, a private variable, a callee with a pointer, a texture, a derivative and an
/// effect that a uniform switches off.
const MATERIAL: &str = "
struct Camera { view_projection: mat4x4<f32>, sun: vec4<f32> }
struct Material { fog: f32, octaves: i32, tint: vec3<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<uniform> material: Material;
@group(1) @binding(0) var picture: texture_2d<f32>;
@group(1) @binding(1) var filtering: sampler;
struct Varyings { @builtin(position) position: vec4<f32>, @location(0) world: vec3<f32>, \
    @location(1) normal: vec3<f32>, @location(2) uv: vec2<f32> }
var<private> wear: f32 = 0.5;
fn put(to: ptr<function, f32>, x: f32) { *to = x - 0.25; wear = wear + x; }
fn waves(p: vec3<f32>) -> f32 {
    var sum = 0.0;
    var weight = 0.5;
    for (var i = 0; i < 3; i += 1) { sum += weight * (p.x * 3.0 - p.y * 1.5 + p.z); weight *= 0.5; }
    return sum;
}
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>, \
    @location(2) uv: vec2<f32>) -> Varyings {
    var out: Varyings;
    let moved = vec4(position + vec3(0.0, 0.25 * (position.x - 0.5), 0.0), 1.0);
    out.position = camera.view_projection * moved;
    out.world = moved.xyz;
    out.normal = normal - vec3(0.0, 0.25, 0.0);
    out.uv = uv / 2.0;
    return out;
}
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {
    let texel = textureSample(picture, filtering, in.uv, vec2(1, 0));
    if texel.a - 0.3 < 0.1 { discard; }
    let lit = waves(in.world) - 0.5 * max(dot(in.normal, camera.sun.xyz), 0.0);
    var shade = 0.0;
    put(&shade, lit + dpdx(in.uv.x));
    var color = texel.rgb * material.tint + vec3(shade - wear);
    if material.fog > 0.0 { color = mix(color, vec3(0.7), 1.0 - exp(-material.fog)); }
    return vec4(color, 1.0);
}
";

const EFFORT: Effort = Effort {
    inputs: 48,
    seed: 0,
    steps: 20_000,
    paths: 1,
};

fn plan() -> Plan {
    let state = MaterialState::default();
    Plan::original("test", program(MATERIAL), "vs", Some("fs"), &state)
}

fn applied(plan: &Plan, recipe: &str) -> Plan {
    let recipe = Recipe::parse_list(recipe).unwrap();
    let applied = recipe.apply(plan, &Facts::without_ties());
    applied.unwrap_or_else(|refusal| panic!("{recipe}: {refusal}"))
}

fn said(checks: &[Check]) -> String {
    let line = |c: &Check| format!("{}: {}: {}", c.role.name(), c.promise, c.verdict);
    checks.iter().map(line).collect::<Vec<_>>().join("\n")
}

fn broken(checks: &[Check]) -> Option<&Counterexample> {
    checks.iter().find_map(|c| match &c.verdict {
        Verdict::Counterexample(found) => Some(&**found),
        _ => None,
    })
}

#[test]
fn unbroken_variants_agree_on_the_adapter() {
    let original = plan();
    for (recipe, _) in examples().filter(|(_, used)| **used == Use::Break) {
        let variant = applied(&original, recipe);
        let checks = validate_on(gpu(), &original, &variant, &EFFORT, &|_, _| {});
        assert!(broken(&checks).is_none(), "{recipe}: {}", said(&checks));
        let positions = checks.iter().filter(|c| c.promise == "positions");
        for check in positions {
            // At least half of the inputs: of ordinary numbers all are judged.
            let agreed = matches!(check.verdict, Verdict::Agreed { inputs, .. } if inputs >= 24);
            assert!(agreed, "{recipe}: {}", said(&checks));
        }
        let agreed = checks.iter().filter(|c| c.verdict.holds()).count();
        assert!(agreed * 2 > checks.len(), "{recipe}: {}", said(&checks));
    }
}

fn functions(module: &mut Module) -> Vec<&mut Function> {
    let entries = module.entry_points.iter_mut().map(|e| &mut e.function);
    let functions = module.functions.iter_mut().map(|(_, f)| f);
    functions.chain(entries).collect()
}

/// The `n`-th subtraction the other way round, or, behind them all, the `n`-th discard that is not
/// done.
fn mutant(module: &Module, mut n: usize) -> Option<Module> {
    let mut module = module.clone();
    for function in functions(&mut module) {
        let handles: Vec<_> = function.expressions.iter().map(|(h, _)| h).collect();
        for handle in handles {
            if let Expression::Binary {
                op: BinaryOperator::Subtract,
                left,
                right,
            } = &mut function.expressions[handle]
            {
                if n == 0 {
                    std::mem::swap(left, right);
                    return Some(module);
                }
                n -= 1;
            }
        }
    }
    for function in functions(&mut module) {
        for statement in function.body.iter_mut() {
            if let Statement::If { accept, .. } = statement
                && accept.iter().any(|s| matches!(s, Statement::Kill))
            {
                if n == 0 {
                    *accept = naga::Block::new();
                    return Some(module);
                }
                n -= 1;
            }
        }
    }
    None
}

/// No proof and no run of the interpreter takes part in the verdict: what is held against each
/// other comes from the adapter.
#[test]
fn the_adapter_alone_sees_a_wrong_transform() {
    let original = plan();
    let (mut seen, mut survivors) = (Vec::new(), Vec::new());
    for recipe in ["depth-prepass", "hoist:budget=0.1,vertices-per-fragment=0"] {
        let variant = applied(&original, recipe);
        for (key, program) in &variant.programs {
            let mutants = (0..).map_while(|n| mutant(program.module(), n));
            for (n, module) in mutants.enumerate() {
                let Ok(program) = program.with_module(module) else {
                    continue;
                };
                let mut wrong = variant.clone();
                wrong.programs.insert(key.clone(), program);
                let checks = validate_on(gpu(), &original, &wrong, &EFFORT, &|_, _| {});
                match broken(&checks) {
                    Some(found) => seen.push(found.clone()),
                    None => survivors.push(format!("{recipe} {key} {n}\n{}", said(&checks))),
                }
            }
        }
    }
    assert!(seen.len() > 8, "{}", seen.len());
    assert!(
        survivors.len() <= seen.len() / 4,
        "{} seen\n{}",
        seen.len(),
        survivors.join("\n")
    );
    // It says of which inputs, and where the two go apart first.
    assert!(seen.iter().all(|c| !c.inputs.is_empty()));
    let texts = seen.iter().filter_map(|c| c.first.as_ref());
    let texts: Vec<&str> = texts.map(|f| f.text.as_str()).collect();
    assert!(texts.contains(&"position.x - 0.5"), "{texts:?}");
}

/// Gradients that the author names are a part of what a lookup is given there as well.
#[test]
fn the_adapter_is_given_named_gradients() {
    let text = MATERIAL.replace(
        "textureSample(picture, filtering, in.uv, vec2(1, 0))",
        "textureSampleGrad(picture, filtering, in.uv, dpdx(in.uv) * 2.0, dpdy(in.uv) * 2.0)",
    );
    assert_ne!(text, MATERIAL);
    let (original, variant) = specialised(&text);
    let mut wrong = variant.clone();
    for program in wrong.programs.values_mut() {
        let mut module = program.module().clone();
        for function in functions(&mut module) {
            for (_, expression) in function.expressions.iter_mut() {
                if let Expression::ImageSample {
                    level: SampleLevel::Gradient { x, y },
                    ..
                } = expression
                {
                    std::mem::swap(x, y);
                }
            }
        }
        *program = program.with_module(module).unwrap();
    }
    let checks = validate_on(gpu(), &original, &wrong, &EFFORT, &|_, _| {});
    assert!(broken(&checks).is_some(), "{}", said(&checks));
}

/// A material and a variant of it, which the adapter finds right.
fn specialised(text: &str) -> (Plan, Plan) {
    let state = MaterialState::default();
    let original = Plan::original("test", program(text), "vs", Some("fs"), &state);
    let variant = applied(&original, "specialize:set=material.fog=0");
    let checks = validate_on(gpu(), &original, &variant, &EFFORT, &|_, _| {});
    assert!(
        checks.iter().all(|c| c.verdict.holds()),
        "{}",
        said(&checks)
    );
    (original, variant)
}

/// Textures that functions receive, and pass on, are those of the callers there as well: their texels
/// and their sizes.
#[test]
fn the_adapter_looks_up_in_textures_that_functions_receive() {
    const FUNCTIONS: &str = "
@group(1) @binding(2) var mask: texture_2d<u32>;
fn beside(map: texture_2d<f32>, by: sampler, at: vec2<f32>) -> vec4<f32> {
    return textureSample(map, by, at - 1.0 / vec2<f32>(textureDimensions(map)));
}
fn smooth_at(at: vec2<f32>, map: texture_2d<f32>, weight: f32, by: sampler) -> vec4<f32> {
    return beside(map, by, at - weight) * 0.25 + beside(map, by, at) * 0.125;
}
fn level(map: texture_2d<u32>, at: vec2<f32>) -> f32 {
    return f32(textureLoad(map, vec2<i32>(at * 8.0), 0).r + textureNumLevels(map));
}
";
    let text = MATERIAL.replace(
        "textureSample(picture, filtering, in.uv, vec2(1, 0))",
        "smooth_at(in.uv, picture, 0.25, filtering) + level(mask, in.uv) \
         + smooth_at(in.uv, other, 0.25, filtering)",
    );
    assert_ne!(text, MATERIAL);
    let other = "@group(1) @binding(3) var other: texture_2d<f32>;\n";
    let text = format!("{text}{FUNCTIONS}{other}");
    let (original, variant) = specialised(&text);
    // One of the two textures is the other.
    let mut wrong = variant.clone();
    for program in wrong.programs.values_mut() {
        let mut module = program.module().clone();
        let named = |name: &str| {
            let mut all = module.global_variables.iter();
            all.find_map(|(h, g)| (g.name.as_deref() == Some(name)).then_some(h))
        };
        let [from, to] = [named("picture").unwrap(), named("other").unwrap()];
        for function in functions(&mut module) {
            for (_, expression) in function.expressions.iter_mut() {
                if *expression == Expression::GlobalVariable(from) {
                    *expression = Expression::GlobalVariable(to);
                }
            }
        }
        *program = program.with_module(module).unwrap();
    }
    let checks = validate_on(gpu(), &original, &wrong, &EFFORT, &|_, _| {});
    assert!(broken(&checks).is_some(), "{}", said(&checks));
}

/// Some of the fixture materials (all with `PRESHADE_ADAPTER_FIXTURES=all`): nothing is broken,
/// most can be run, and what cannot says why.
#[test]
fn the_fixtures_agree_on_the_adapter() {
    let effort = Effort {
        inputs: 6,
        ..EFFORT
    };
    let step = match std::env::var("PRESHADE_ADAPTER_FIXTURES") {
        Ok(_) => 1,
        Err(_) => 7,
    };
    let (mut wrong, mut kinds) = (Vec::new(), BTreeMap::new());
    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    for files in materials()
        .iter()
        .filter(|files| files.len() == 1)
        .step_by(step)
    {
        let files: Vec<_> = files.iter().map(std::path::PathBuf::as_path).collect();
        let original = original(&files);
        for recipe in [
            "depth-prepass",
            "hoist:budget=0.02,finite=assumed,jumps=carried",
        ] {
            let recipe = Recipe::parse_list(recipe).unwrap();
            let Ok(variant) = recipe.apply(&original, &Facts::without_ties()) else {
                continue;
            };
            for check in validate_on(gpu(), &original, &variant, &effort, &|_, _| {}) {
                let kind = match &check.verdict {
                    Verdict::Agreed { .. } => "agreed",
                    Verdict::NotEvaluable { why } => {
                        *reasons.entry(why.clone()).or_default() += 1;
                        "not evaluated"
                    }
                    _ => {
                        let material = &original.material;
                        wrong.push(format!("{material} by {recipe}: {}", check.verdict));
                        "broken"
                    }
                };
                *kinds.entry(kind).or_insert(0) += 1;
            }
        }
    }
    eprintln!("{kinds:?}\n{reasons:#?}");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(
        kinds["agreed"] > kinds["not evaluated"],
        "{kinds:?} {reasons:#?}"
    );
    let strange = reasons.keys().filter(|why| why.contains("not valid"));
    assert_eq!(strange.count(), 0, "{reasons:#?}");
}
