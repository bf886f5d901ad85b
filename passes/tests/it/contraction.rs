//! Drivers that fuse products into sums, played on the IR: what is promised as exact must hold
//! whichever products a compiler fuses, if it decides for each operation as the assumptions say.

use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;
use std::sync::Arc;

use naga::{
    BinaryOperator, Expression, Function, Handle, MathFunction, ScalarKind, Span, TypeInner,
};
use preshade_geometry::{examples, pass_named};
use preshade_plan::contract::Assumption;
use preshade_plan::pass::{Facts, Use};
use preshade_plan::plan::Plan;
use preshade_plan::state::MaterialState;
use preshade_validate::{Effort, validate};

use crate::common;

/// Which products a compiler fuses into the sum that reads them.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Driver {
    /// All.
    Eager,
    /// Those with a single reader: others have to be computed anyway.
    SingleReader,
    /// A random half, by the sum's place in the author's text: the same sum wherever it is compiled.
    Random(u64),
}

const DRIVERS: [Driver; 3] = [Driver::Eager, Driver::SingleReader, Driver::Random(1)];

impl Driver {
    /// Whether it fuses a product with so many readers into the sum at `span`.
    fn fuses(self, readers: usize, span: Span) -> bool {
        match self {
            Self::Eager => true,
            Self::SingleReader => readers == 1,
            Self::Random(seed) => {
                let mut hasher = DefaultHasher::new();
                (seed, span.to_range()).hash(&mut hasher);
                hasher.finish() & 1 == 1
            }
        }
    }
}

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
            let span = function.expressions.get_span(sum);
            let fuses = driver.fuses(readers[of.index()], span);
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
        count(naga_operands::of_expression(expression).to_vec());
    }
    let mut blocks = vec![&function.body];
    while let Some(block) = blocks.pop() {
        for statement in block {
            count(naga_operands::of_statement(statement).to_vec());
            blocks.extend(naga_operands::blocks(statement));
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

/// A shader of `fixtures/adversarial`.
fn fixture(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/adversarial");
    fs::read_to_string(folder.join(name).with_extension("wgsl")).unwrap()
}

fn replaced(text: &str, old: &str, new: &str) -> String {
    assert_eq!(text.matches(old).count(), 1, "{old}");
    text.replace(old, new)
}

/// A product that moved to the vertices, and its sum that stayed: what `hoist` would make without
/// its guard, and must not call exact.
#[test]
fn a_product_cut_from_its_sum_is_seen() {
    let text = fixture("product-cut-from-sum");
    let cut = replaced(&text, "let k = sin(u.a) * u.b;", "let k = v.k;");
    let cut = replaced(&cut, "uv, normal)", "uv, normal, sin(u.a) * u.b)");
    let normal = "@location(1) normal: vec3<f32>,\n}";
    let flat = "@location(1) normal: vec3<f32>,\n@location(2) @interpolate(flat) k: f32 }";
    let cut = plan(&replaced(&cut, normal, flat));
    let original = plan(&text);
    let own = applied(&original, "hoist:allow=exact,vertices-per-fragment=0").unwrap();
    let unguarded = Plan {
        steps: own.steps.clone(),
        ..cut
    };
    for driver in [Driver::Eager, Driver::SingleReader] {
        assert!(is_broken(&original, &unguarded, driver), "{driver:?}");
    }
    let random = (0..8).map(Driver::Random);
    let seen = random.filter(|driver| is_broken(&original, &unguarded, *driver));
    assert!(seen.count() > 1);
    for driver in DRIVERS.into_iter().chain((0..8).map(Driver::Random)) {
        assert!(!is_broken(&original, &own, driver), "{driver:?}");
    }
}

/// The slice that decides a discard has other readers of its products than the main pass: what
/// `depth-prepass` would make without its guard, and must refuse.
#[test]
fn a_slice_with_other_readers_is_seen() {
    // Random inputs are few: the discard has to depend on the last bit.
    let text = replaced(&fixture("discard-shares-products"), "4096.0", "8388608.0");
    let original = plan(&text);
    let refused = applied(&original, "depth-prepass").unwrap_err();
    assert_eq!(refused, "fused-discard");
    // The pre-pass of a material whose colours read no product.
    let plain = replaced(&text, "let w = sin(p) * cos(v.uv.y * u.b);", "");
    let plain = replaced(&plain, "vec4<f32>(w, p, ", "vec4<f32>(0.0, 0.0, ");
    let mut unguarded = applied(&plan(&plain), "depth-prepass").unwrap();
    let main = original.main().unwrap();
    let key = unguarded.main().unwrap().program.clone();
    let program = original.program(main).unwrap().clone();
    unguarded.programs.insert(key, program);
    assert!(is_broken(&original, &unguarded, Driver::SingleReader));
    for driver in [Driver::Eager, Driver::Random(1), Driver::Random(2)] {
        assert!(!is_broken(&original, &unguarded, driver), "{driver:?}");
    }
}

/// The plan after a recipe, or the code of its first refusal.
fn applied(plan: &Plan, recipe: &str) -> Result<Plan, String> {
    let (name, params) = common::step(recipe.to_owned().leak());
    let pass = pass_named(name).unwrap();
    let outcome = pass.run(plan, &Facts::without_ties(), &params);
    let outcome = outcome.map_err(|refused| refused.refusals[0].code.clone())?;
    Ok(outcome.plan)
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    #[test]
    fn exact_variants_of_the_fixtures_hold_on_drivers_that_fuse() {
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures");
        let entries = ["shaders", "adversarial"].map(|folder| fs::read_dir(fixtures.join(folder)));
        let few = Effort {
            inputs: 4,
            ..EFFORT
        };
        let mut held = 0;
        for entry in entries.into_iter().flat_map(Result::unwrap) {
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
                let Ok(variant) = applied(&original, recipe) else {
                    continue;
                };
                let is_exact = variant.contract.kind() == "exact";
                let same_discard = !variant
                    .contract
                    .given()
                    .contains(&Assumption::InvariantDiscard);
                for driver in DRIVERS {
                    if is_exact && (same_discard || driver != Driver::SingleReader) {
                        let broken = is_broken_by(&few, &original, &variant, driver);
                        assert!(!broken, "{}: {recipe}: {driver:?}", path.display());
                        held += 1;
                    }
                }
            }
        }
        assert!(held > 100, "{held}");
    }
}
