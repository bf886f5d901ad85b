//! Drivers that fuse products into sums, played on the IR: what is promised as exact must hold
//! whichever products a compiler fuses, if it decides for each operation as the assumptions say.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use naga::{BinaryOperator, Expression, Function, Handle, MathFunction, ScalarKind, TypeInner};
use preshade_passes::contract::Assumption;
use preshade_passes::pass::{Facts, Use};
use preshade_passes::plan::Plan;
use preshade_passes::state::MaterialState;
use preshade_passes::validate::{Effort, validate};
use preshade_passes::{examples, graph::operands, pass_named};

use crate::common;

/// Which products a compiler fuses into the sum that reads them.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Driver {
    /// All.
    Eager,
    /// Those with a single reader: others have to be computed anyway.
    SingleReader,
}

const DRIVERS: [Driver; 2] = [Driver::Eager, Driver::SingleReader];

/// The plan as this driver compiles it.
fn compiled(plan: &Plan, driver: Driver) -> Plan {
    let mut plan = plan.clone();
    for program in plan.programs.values_mut() {
        let mut module = program.module().clone();
        let info = program.info().clone();
        for (handle, function) in module.functions.clone().iter() {
            let types = &info[handle];
            let is = |e: Handle<Expression>| types[e].ty.inner_with(&module.types).clone();
            *module.functions.get_mut(handle) = fused(function, driver, is);
        }
        for (index, entry) in module.entry_points.clone().iter().enumerate() {
            let types = info.get_entry_point(index);
            let is = |e: Handle<Expression>| types[e].ty.inner_with(&module.types).clone();
            module.entry_points[index].function = fused(&entry.function, driver, is);
        }
        *program = common::validated(program, module);
    }
    plan.original = plan.original.map(|o| Arc::new(compiled(&o, driver)));
    plan
}

fn fused(
    function: &Function,
    driver: Driver,
    ty: impl Fn(Handle<Expression>) -> TypeInner,
) -> Function {
    let mut fused = function.clone();
    let readers = readers(function);
    for (sum, expression) in function.expressions.iter() {
        let Expression::Binary {
            op: BinaryOperator::Add,
            left,
            right,
        } = *expression
        else {
            continue;
        };
        let is_float = ty(sum).scalar_kind() == Some(ScalarKind::Float);
        let product = |of: Handle<Expression>| match function.expressions[of] {
            Expression::Binary {
                op: BinaryOperator::Multiply,
                left: a,
                right: b,
            } if ty(a) == ty(sum) && ty(b) == ty(sum) => Some((of, a, b)),
            _ => None,
        };
        let candidates = [(product(left), right), (product(right), left)];
        let found = candidates.into_iter().find_map(|(product, rest)| {
            let (of, a, b) = product?;
            let fuses = driver == Driver::Eager || readers[of.index()] == 1;
            (fuses && is_float && ty(rest) == ty(sum)).then_some((a, b, rest))
        });
        if let Some((a, b, rest)) = found {
            fused.expressions[sum] = Expression::Math {
                fun: MathFunction::Fma,
                arg: a,
                arg1: Some(b),
                arg2: Some(rest),
                arg3: None,
            };
        }
    }
    fused
}

/// How often each expression is read.
fn readers(function: &Function) -> Vec<usize> {
    let mut readers = vec![0; function.expressions.len()];
    let mut count = |read: Vec<Handle<Expression>>| {
        for operand in read {
            readers[operand.index()] += 1;
        }
    };
    for (_, expression) in function.expressions.iter() {
        count(operands::of_expression(expression).to_vec());
    }
    let mut blocks = vec![&function.body];
    while let Some(block) = blocks.pop() {
        for statement in block {
            count(operands::of_statement(statement).to_vec());
            blocks.extend(operands::blocks(statement));
        }
    }
    readers
}

fn plan(source: &str) -> Plan {
    let program = common::program(source);
    Plan::original("test", program, "vs", Some("fs"), &MaterialState::default())
}

const EFFORT: Effort = Effort {
    inputs: 12,
    seed: 0,
    steps: 5_000,
    paths: 64,
};

fn is_broken(original: &Plan, variant: &Plan, driver: Driver) -> bool {
    is_broken_by(&EFFORT, original, variant, driver)
}

fn is_broken_by(effort: &Effort, original: &Plan, variant: &Plan, driver: Driver) -> bool {
    let [original, variant] = [original, variant].map(|p| compiled(p, driver));
    let checks = validate(&original, &variant, effort);
    checks.iter().any(|check| check.verdict.is_broken())
}

/// A product that moved to the vertices, and its sum that stayed: what `hoist` must not call exact.
#[test]
fn a_product_cut_from_its_sum_is_seen() {
    let stages = |varying: &str, given: &str, k: &str| {
        plan(&format!(
            "struct Uniforms {{ mvp: mat4x4<f32>, a: f32, b: f32 }}
@group(0) @binding(0) var<uniform> u: Uniforms;
struct Varyings {{ @builtin(position) position: vec4<f32>, @location(0) uv: vec2<f32>{varying} }}
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> Varyings {{
    return Varyings(u.mvp * vec4<f32>(position, 1.0), uv{given});
}}
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {{
    return vec4<f32>(fract(({k} + in.uv.x) * 65536.0), 0.5, 0.5, 1.0);
}}"
        ))
    };
    let original = stages("", "", "u.a * u.b");
    let flat = ", @location(1) @interpolate(flat) k: f32";
    let variant = stages(flat, ", u.a * u.b", "in.k");
    let variant = Plan {
        steps: applied(&original, "hoist:allow=exact,vertices-per-fragment=0")
            .map_or_else(Vec::new, |p| p.steps),
        ..variant
    };
    assert!(!variant.steps.is_empty());
    for driver in DRIVERS {
        assert!(is_broken(&original, &variant, driver), "{driver:?}");
        let own = applied(&original, "hoist:allow=exact,vertices-per-fragment=0").unwrap();
        assert!(!is_broken(&original, &own, driver), "{driver:?}");
    }
}

/// The slice that decides a discard has other readers of its products than the main pass.
#[test]
fn a_slice_with_other_readers_is_seen() {
    let original = plan(
        "struct Uniforms { mvp: mat4x4<f32>, a: f32, b: f32 }
@group(0) @binding(0) var<uniform> u: Uniforms;
struct Varyings { @builtin(position) position: vec4<f32>, @location(0) uv: vec2<f32> }
@vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> Varyings {
    return Varyings(u.mvp * vec4<f32>(position, 1.0), uv);
}
@fragment fn fs(in: Varyings) -> @location(0) vec4<f32> {
    let p = in.uv.x * u.a;
    let q = p + in.uv.y;
    if fract(q * 8388608.0) < 0.5 { discard; }
    return vec4<f32>(sin(p), p, 0.5, 1.0);
}",
    );
    let variant = applied(&original, "depth-prepass").unwrap();
    assert!(
        variant
            .contract
            .given()
            .contains(&Assumption::InvariantDiscard)
    );
    assert!(is_broken(&original, &variant, Driver::SingleReader));
    assert!(!is_broken(&original, &variant, Driver::Eager));
}

fn applied(plan: &Plan, recipe: &str) -> Option<Plan> {
    let (name, params) = common::step(recipe.to_owned().leak());
    let pass = pass_named(name).unwrap();
    let outcome = pass.run(plan, &Facts::without_ties(), &params).ok()?;
    Some(outcome.plan)
}

#[test]
fn exact_variants_of_the_fixtures_hold_on_drivers_that_fuse() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/shaders");
    let few = Effort {
        inputs: 4,
        ..EFFORT
    };
    let mut held = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "wgsl") {
            continue;
        }
        let Ok(program) = common::read(&fs::read_to_string(&path).unwrap()) else {
            continue;
        };
        let name = |stage| {
            let mut entries = program.module().entry_points.iter();
            entries.find(|e| e.stage == stage).map(|e| e.name.clone())
        };
        let (Some(vertex), fragment) = (
            name(naga::ShaderStage::Vertex),
            name(naga::ShaderStage::Fragment),
        ) else {
            continue;
        };
        let state = MaterialState::default();
        let original = Plan::original("test", program, &vertex, fragment.as_deref(), &state);
        let recipes = examples().filter(|(_, used)| matches!(used, Use::Snapshot));
        for (recipe, _) in recipes.filter(|(recipe, _)| !recipe.contains(",depth-prepass")) {
            let Some(variant) = applied(&original, recipe) else {
                continue;
            };
            let is_exact = variant.contract.kind() == "exact";
            let same_discard = !variant
                .contract
                .given()
                .contains(&Assumption::InvariantDiscard);
            for driver in DRIVERS {
                if is_exact && (same_discard || driver == Driver::Eager) {
                    let broken = is_broken_by(&few, &original, &variant, driver);
                    assert!(!broken, "{}: {recipe}: {driver:?}", path.display());
                    held += 1;
                }
            }
        }
    }
    assert!(held > 100, "{held}");
}
