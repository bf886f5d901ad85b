//! Every builtin, interpolation, resource, target and state, in pairs and with every recipe: each
//! text is compiled by compilers that are not ours, or refused by name.

use std::collections::BTreeMap;

use preshade::unstable::emit::{self, EmitError, File, Target};
use preshade::unstable::passes::pass::Facts;
use preshade::unstable::passes::plan::Plan;
use preshade::unstable::recipe::Recipe;
use rayon::prelude::*;

use crate::accept;
use crate::interfaces::{Interface, interfaces};
use crate::webgl;

/// What becomes of an interface in each target.
#[derive(Default)]
struct Made {
    /// What other compilers are to judge, by a label.
    sets: Vec<(String, Vec<File>)>,
    /// Refusals of recipes and targets.
    refused: Vec<String>,
    /// Errors that are no refusals.
    wrong: Vec<String>,
}

fn made(interface: &Interface) -> Made {
    let mut made = Made::default();
    let label = interface.names().join(", ");
    let original = interface.original();
    let plan = match interface.recipe() {
        "" => original,
        recipe => {
            let recipe = Recipe::parse_list(recipe).unwrap();
            match recipe.apply(&original, &Facts::without_ties()) {
                Ok(plan) => plan,
                Err(refusal) if refusal.code == "internal" => {
                    made.wrong
                        .push(format!("{label}: {}\n{}", refusal.reason, interface.text()));
                    return made;
                }
                Err(refusal) => {
                    made.refused
                        .push(format!("{}: {}", refusal.pass, refusal.code));
                    return made;
                }
            }
        }
    };
    for target in targets(&plan) {
        match emit::emit(&plan, &[target], &emit::Options::default()) {
            Ok(_) if target == Target::Wgsl && interface.is_native() => {}
            Ok(files) => made.sets.push((format!("{label} {target}"), files)),
            Err(EmitError::Inexpressible { what, .. }) => {
                made.refused.push(format!("{target}: {what}"));
            }
            Err(e) => made
                .wrong
                .push(format!("{label} {target}: {e}\n{}", interface.text())),
        }
    }
    made
}

/// Tessellation stages are for what was hoisted, and nothing behind that.
fn targets(plan: &Plan) -> Vec<Target> {
    let is_hoisted = plan.steps.last().is_some_and(|s| s.pass == "hoist");
    let is_for = |t: &Target| is_hoisted || !matches!(t, Target::GlslTess | Target::GlslVulkanTess);
    Target::ALL.into_iter().filter(is_for).collect()
}

/// As many more at random with `PRESHADE_INTERFACES=5000`.
#[test]
fn every_interface_compiles_or_is_refused_by_name() {
    let more = std::env::var("PRESHADE_INTERFACES");
    let more = more.ok().and_then(|n| n.parse().ok()).unwrap_or(0);
    let all = interfaces(1, more);
    let made: Vec<Made> = all.par_iter().map(made).collect();
    let mut sets = Vec::new();
    let mut refused = BTreeMap::<String, usize>::new();
    let mut wrong = Vec::new();
    for of in made {
        sets.extend(of.sets);
        wrong.extend(of.wrong);
        for what in of.refused {
            *refused.entry(what).or_default() += 1;
        }
    }
    println!("{} interfaces, {} sets of files", all.len(), sets.len());
    println!("{refused:#?}");
    assert!(
        wrong.is_empty(),
        "{} are wrong:\n{}",
        wrong.len(),
        wrong.join("\n\n")
    );
    let judged = accept::accept(&sets);
    let linked = webgl::link(&sets);
    println!("{judged:?} {linked:?}");
}
