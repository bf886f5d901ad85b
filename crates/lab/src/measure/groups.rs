//! Splits the draws of a material into groups with equal constants, so that each group can have its
//! own plan.

use std::collections::{BTreeMap, BTreeSet};

use preshade_passes::transforms::specialize::dispatch::Versions;
use preshade_passes::transforms::specialize::{Specialize, SpecializeParams, Specialized};
use preshade_plan::guard::{Assumed, Place};
use preshade_plan::pass::Pass;
use preshade_plan::plan::Plan;

use super::constants::{Looked, as_facts};
use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::{Scene, SceneError};

/// Default for the most groups of one material.
pub const MOST_GROUPS: usize = 8;

/// The scene [`grouped`] for the first step of `recipe` that specialises; as it is where none does.
pub fn grouped_for(scene: Scene, recipe: &Recipe) -> Result<Scene, SceneError> {
    let Some(step) = recipe
        .steps
        .iter()
        .find(|s| s.pass == Specialize::INFO.name)
    else {
        return Ok(scene);
    };
    let params = serde_json::Value::Object(step.params.clone());
    let params = serde_json::from_value(params).unwrap_or_default();
    grouped(&scene, &params, MOST_GROUPS)
}

/// Splits each material whose draws need different specialised versions into `NAME-1`, `NAME-2` and
/// so on. The picture stays the same.
///
/// A material has at most `most` groups. Beyond that, the draws that gain least share the last
/// group, which is specialised to their common constants.
///
/// # Errors
///
/// A value that does not fit its variable.
pub fn grouped(scene: &Scene, params: &SpecializeParams, most: usize) -> Result<Scene, SceneError> {
    let looked = Looked::at(scene)?;
    let mut out = scene.clone();
    for (index, plan) in looked.plans.iter().enumerate() {
        let draws: Vec<usize> = scene
            .draws
            .iter()
            .enumerate()
            .filter(|(_, d)| d.material == index)
            .map(|(i, _)| i)
            .collect();
        if draws.len() < 2 {
            continue;
        }
        let mut groups: BTreeMap<String, Group> = BTreeMap::new();
        let mut seen: Vec<(BTreeMap<Place, Assumed>, NeededVersion)> = Vec::new();
        for draw in draws {
            let values = looked.telling(draw)?;
            let known = seen.iter().find(|(v, _)| *v == values);
            let wanted = match known {
                Some((_, wanted)) => wanted.clone(),
                None => {
                    let wanted = NeededVersion::of(plan, &values, params);
                    seen.push((values, wanted.clone()));
                    wanted
                }
            };
            let group = groups.entry(wanted.hash).or_default();
            group.draws.push(draw);
            group.saved += wanted.saved;
        }
        let mut groups: Vec<Group> = groups.into_values().collect();
        groups.sort_by(|a, b| b.saved.total_cmp(&a.saved).then(a.draws.cmp(&b.draws)));
        if groups.len() > most.max(1) {
            let rest = groups.split_off(most.max(1) - 1);
            groups.push(Group {
                saved: 0.0,
                draws: rest.into_iter().flat_map(|g| g.draws).collect(),
            });
        }
        if groups.len() < 2 {
            continue;
        }
        // In the order of their first draws.
        groups.sort_by_key(|g| g.draws.iter().copied().min());
        let taken: BTreeSet<String> = out.materials.iter().map(|m| m.name.clone()).collect();
        let mut number = 0;
        for (i, group) in groups.iter().enumerate() {
            let mut material = scene.materials[index].clone();
            material.part_of = Some(material.name.clone());
            loop {
                number += 1;
                material.name = format!("{}-{number}", scene.materials[index].name);
                if !taken.contains(&material.name) {
                    break;
                }
            }
            let at = match i {
                0 => index,
                _ => out.materials.len(),
            };
            match i {
                0 => out.materials[index] = material,
                _ => out.materials.push(material),
            }
            for draw in &group.draws {
                out.draws[*draw].material = at;
            }
        }
    }
    Ok(out)
}

/// The versions of each material that [`grouped`] split, from the plans of its groups. Materials whose plans have no
/// guard are left out.
pub fn versions(scene: &Scene, plans: &[&Plan]) -> Vec<Versions> {
    let of = |name: &str| scene.materials.iter().position(|m| m.name == name);
    let mut parts: BTreeMap<&str, Vec<(&Plan, Vec<usize>)>> = BTreeMap::new();
    for plan in plans {
        let Some((index, whole)) =
            of(&plan.material).and_then(|i| Some((i, scene.materials[i].part_of.as_deref()?)))
        else {
            continue;
        };
        let draws = scene.draws.iter().enumerate();
        let draws = draws.filter(|(_, d)| d.material == index).map(|(i, _)| i);
        parts
            .entry(whole)
            .or_default()
            .push((*plan, draws.collect()));
    }
    let each = parts.into_iter();
    each.map(|(material, plans)| Versions::of(material, plans))
        .filter(|v| !v.versions.is_empty())
        .collect()
}

/// Draws that want the same version.
#[derive(Default)]
struct Group {
    draws: Vec<usize>,
    /// Static cost that it saves a fragment, over all of its draws.
    saved: f64,
}

/// The version that a draw needs.
#[derive(Clone)]
struct NeededVersion {
    /// The same for the same version; empty for the author's own.
    hash: String,
    saved: f64,
}

impl NeededVersion {
    fn of(plan: &Plan, values: &BTreeMap<Place, Assumed>, params: &SpecializeParams) -> Self {
        let facts = as_facts(plan, values);
        match Specialized::new(plan, &facts, params) {
            Ok(done) => {
                let [_, [before, after]] = done.cost;
                Self {
                    hash: done.hash().to_owned(),
                    saved: before - after,
                }
            }
            Err(_) => Self {
                hash: String::new(),
                saved: 0.0,
            },
        }
    }
}
