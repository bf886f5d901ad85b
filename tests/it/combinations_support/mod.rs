//! Random recipes, of all passes in any order with any parameters: what a combination of them with
//! a material comes to.
#![allow(dead_code)]

use std::collections::BTreeMap;

use naga::Module;
use preshade_compiler::emit;
use preshade_compiler::parameters::{Parameter, parameters};
use preshade_compiler::recipe::{Recipe, Step};
use preshade_geometry::{PASSES, examples};
use preshade_plan::pass::{AnyPass, Facts, Use};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::uniforms::uniform_scalars;
use preshade_validate::inputs::Random;
use preshade_validate::{Effort, Verdict, validate};
use serde_json::{Map, Value, json};

/// Steps a recipe has at most.
const MOST_STEPS: usize = 4;

/// A recipe for a material of this module.
pub fn recipe(module: &Module, random: &mut Random) -> Recipe {
    let count = 1 + random.below(MOST_STEPS);
    let mut steps: Vec<Step> = (0..count).map(|_| step(module, random)).collect();
    // Some passes are only of use ahead of others: half of the recipes have them there.
    if random.below(2) == 0 {
        steps.sort_by_key(|s| {
            let place = ahead().find(|(pass, _)| *pass == s.pass);
            place.map_or(usize::MAX, |(_, place)| place)
        });
    }
    Recipe { steps }
}

/// The passes that are useful ahead of others, and their places.
fn ahead() -> impl Iterator<Item = (&'static str, usize)> {
    examples().filter_map(|(recipe, used)| match used {
        Use::Ahead(place) => Some((recipe.split(':').next()?, *place)),
        _ => None,
    })
}

fn step(module: &Module, random: &mut Random) -> Step {
    // What is refused most often is tried most often.
    let few_fit = ["early-alpha", "half-rate", "preamble"];
    let often: Vec<&str> = ahead().map(|(pass, _)| pass).chain(few_fit).collect();
    let pass = PASSES[random.below(PASSES.len())];
    let pass = match random.below(3) {
        0 => often
            .get(random.below(often.len()))
            .and_then(|name| preshade_geometry::pass_named(name))
            .unwrap_or(pass),
        _ => pass,
    };
    let mut params = Map::new();
    for parameter in parameters(pass) {
        // What needs a budget mostly has one, or nothing would ever be moved.
        let odds = match parameter.name.as_str() {
            "budget" | "set" => 9,
            "fold" | "finite" => 6,
            _ => 3,
        };
        if random.below(10) < odds
            && let Some(value) = value(pass, &parameter, module, random)
        {
            params.insert(parameter.name, value);
        }
    }
    Step {
        pass: pass.info().name.to_owned(),
        params,
        site: None,
    }
}

fn value(
    pass: &dyn AnyPass,
    parameter: &Parameter,
    module: &Module,
    random: &mut Random,
) -> Option<Value> {
    if !parameter.choices.is_empty() {
        let choice = &parameter.choices[random.below(parameter.choices.len())];
        return Some(json!(choice.value));
    }
    let range = parameter.range.unwrap_or_default();
    let least = range.minimum.or(range.above).unwrap_or(0.0);
    match (parameter.kind.as_deref(), parameter.name.as_str()) {
        (Some("boolean"), _) => Some(json!(random.below(2) == 0)),
        (Some("integer"), _) => {
            let most = range.maximum.unwrap_or(8.0).min(least + 7.0);
            let number = least + random.below((most - least) as usize + 1) as f64;
            Some(json!(number as i64))
        }
        (Some("number"), "budget") => Some(json!([0.001, 0.01, 0.05, 0.5][random.below(4)])),
        (Some("number"), _) => {
            let most = range.maximum.unwrap_or(least + 4.0);
            Some(json!(least + (most - least) * f64::from(random.unit())))
        }
        (_, "set") => {
            let scalars = uniform_scalars(module);
            let chosen: Vec<String> = (0..1 + random.below(6))
                .filter_map(|_| {
                    let scalar = scalars.get(random.below(scalars.len()))?;
                    let number = ["0", "1", "2", "0.5"][random.below(4)];
                    Some(format!("{}={number}", scalar.name))
                })
                .collect();
            (!chosen.is_empty()).then(|| json!(chosen.join("+")))
        }
        (_, "of") => {
            let names: Vec<&String> = module
                .functions
                .iter()
                .filter_map(|(_, f)| f.name.as_ref())
                .collect();
            Some(json!(names.get(random.below(names.len()))?))
        }
        (_, "write") => {
            let all = ["depth", "normal", "velocity", "id", "shadow", "distance"];
            let count = 1 + random.below(2);
            let words: Vec<&str> = (0..count).map(|_| all[random.below(all.len())]).collect();
            Some(json!(words.join("+")))
        }
        _ => {
            // Lists of values that a search found: no random word is one.
            let _ = pass;
            None
        }
    }
}

/// What a scene may say, or not.
pub fn facts(random: &mut Random) -> Facts {
    match random.below(2) {
        0 => Facts::default(),
        _ => Facts::without_ties(),
    }
}

/// What combinations came to.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Tally {
    /// Combinations tried.
    pub combinations: u64,
    /// Those of which no step was accepted.
    pub refused_whole: u64,
    /// Steps accepted, by pass.
    pub accepted: BTreeMap<String, u64>,
    /// Steps refused, by pass and code.
    pub refused: BTreeMap<String, u64>,
    /// Files written and read back, by target.
    pub files: BTreeMap<String, u64>,
    /// Targets that cannot say it, by target.
    pub inexpressible: BTreeMap<String, u64>,
    /// Promises, by what became of them.
    pub promises: BTreeMap<String, u64>,
    /// What must not be: an invalid module, a text that does not read back, a broken promise, a
    /// panic.
    pub wrong: Vec<String>,
}

impl Tally {
    /// Both.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        fn add(to: &mut BTreeMap<String, u64>, from: BTreeMap<String, u64>) {
            for (key, count) in from {
                *to.entry(key).or_default() += count;
            }
        }
        self.combinations += other.combinations;
        self.refused_whole += other.refused_whole;
        add(&mut self.accepted, other.accepted);
        add(&mut self.refused, other.refused);
        add(&mut self.files, other.files);
        add(&mut self.inexpressible, other.inexpressible);
        add(&mut self.promises, other.promises);
        self.wrong.extend(other.wrong);
        self
    }

    fn count(map: &mut BTreeMap<String, u64>, key: impl ToString) {
        *map.entry(key.to_string()).or_default() += 1;
    }
}

/// The steps of a recipe that a material takes; the others are left out, as `rewrite` leaves them
/// out.
pub fn applied(original: &Plan, recipe: &Recipe, facts: &Facts, tally: &mut Tally) -> Plan {
    let mut plan = original.clone();
    for step in &recipe.steps {
        let one = Recipe {
            steps: vec![step.clone()],
        };
        match one.apply(&plan, facts) {
            Ok(next) => {
                plan = next;
                Tally::count(&mut tally.accepted, &step.pass);
            }
            Err(refusal) => {
                Tally::count(
                    &mut tally.refused,
                    format!("{}[{}]", refusal.pass, refusal.code),
                );
                if refusal.code == "internal" {
                    tally
                        .wrong
                        .push(format!("{} by {recipe}: {refusal}", original.material));
                }
            }
        }
    }
    plan
}

/// Targets that a plan may be written in.
const TARGETS: [Target; 4] = [
    Target::Wgsl,
    Target::Spirv,
    Target::Glsl450,
    Target::GlslEs300,
];

/// One combination: the recipe of a seed on one of the materials. Each program of a plan is a
/// validated one; its text is read back when it is written, and its promises are looked at.
pub fn combination(originals: &[Plan], seed: u64, effort: &Effort) -> Tally {
    let mut random = Random::new(seed, "combination");
    let original = &originals[random.below(originals.len())];
    let main = original.main().unwrap();
    let module = original.program(main).unwrap().module();
    let recipe = recipe(module, &mut random);
    let facts = facts(&mut random);
    let mut tally = Tally {
        combinations: 1,
        ..Tally::default()
    };
    let plan = applied(original, &recipe, &facts, &mut tally);
    if plan.steps.is_empty() {
        tally.refused_whole = 1;
        return tally;
    }
    let mut wrong = |what: String| {
        let material = &original.material;
        tally
            .wrong
            .push(format!("seed {seed}: {material} by {recipe}: {what}"));
    };
    for target in [TARGETS[0], TARGETS[1 + random.below(3)]] {
        match emit::emit(&plan, &[target], &emit::Options::default()) {
            Ok(files) => {
                *tally.files.entry(target.to_string()).or_default() += files.len() as u64;
            }
            Err(emit::EmitError::Inexpressible { .. }) => {
                Tally::count(&mut tally.inexpressible, target);
            }
            Err(error) => wrong(error.to_string()),
        }
    }
    for check in validate(original, &plan, effort) {
        let kind = match &check.verdict {
            Verdict::Proved { .. } => "proved",
            Verdict::Agreed { .. } => "agreed",
            Verdict::NotEvaluable { .. } => "not evaluated",
            Verdict::Counterexample(_) => {
                wrong(format!(
                    "{}: {}: {}",
                    check.role.name(),
                    check.promise,
                    check.verdict
                ));
                "broken"
            }
        };
        *tally.promises.entry(kind.to_owned()).or_default() += 1;
    }
    tally
}

/// Many of them, on all cores.
pub fn combinations(originals: &[Plan], seeds: std::ops::Range<u64>, effort: &Effort) -> Tally {
    use rayon::prelude::*;
    let one = |seed| {
        let run = || combination(originals, seed, effort);
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).unwrap_or_else(|_| Tally {
            combinations: 1,
            wrong: vec![format!("seed {seed}: a panic")],
            ..Tally::default()
        })
    };
    seeds
        .into_par_iter()
        .map(one)
        .reduce(Tally::default, Tally::and)
}
