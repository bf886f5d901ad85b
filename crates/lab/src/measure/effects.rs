//! Finds the effects that the draws of each material use, over a whole scene. Needs no adapter.

use std::collections::BTreeMap;

use preshade_passes::transforms::specialize::effects::{self, CalledFor, Effect};
use preshade_plan::guard::{Assumed, Bounds, Place};

use super::constants::{Looked, as_facts};
use preshade_compiler::command::explain::EffectUse;
use preshade_draw::scene::{Scene, SceneError};

/// The effects of a scene's materials, by material, the most expensive first.
///
/// # Errors
///
/// A value that does not fit its variable.
pub fn effects(scene: &Scene) -> Result<Vec<EffectUse>, SceneError> {
    let looked = Looked::at(scene)?;
    let mut found = Vec::new();
    for (index, plan) in looked.plans.iter().enumerate() {
        let mut seen: Vec<(BTreeMap<Place, Assumed>, Vec<Effect>)> = Vec::new();
        let mut uses: Vec<EffectUse> = Vec::new();
        let of_material = |d: &&preshade_draw::scene::Draw| d.material == index;
        let total = scene.draws.iter().filter(of_material).count();
        for (draw, _) in scene
            .draws
            .iter()
            .enumerate()
            .filter(|(_, d)| d.material == index)
        {
            let values = looked.telling(draw)?;
            let of = match seen.iter().position(|(v, _)| *v == values) {
                Some(at) => seen[at].1.clone(),
                None => {
                    let facts = as_facts(plan, &values);
                    let of = effects::effects(plan, &facts).unwrap_or_default();
                    seen.push((values, of.clone()));
                    of
                }
            };
            for effect in of {
                add(&mut uses, &plan.material, total, effect);
            }
        }
        uses.sort_by(|a, b| b.cost.total_cmp(&a.cost).then(a.name.cmp(&b.name)));
        found.extend(uses);
    }
    Ok(found)
}

fn add(uses: &mut Vec<EffectUse>, material: &str, draws: usize, effect: Effect) {
    let same = |u: &EffectUse| (&u.name, &u.stage) == (&effect.name, &effect.stage);
    let at = uses.iter().position(same).unwrap_or_else(|| {
        uses.push(EffectUse {
            material: material.to_owned(),
            name: effect.name.clone(),
            stage: effect.stage.clone(),
            cost: 0.0,
            draws,
            called_for: 0,
            not_called_for: 0,
            evidence: [Vec::new(), Vec::new()],
            location: effect.location.clone(),
        });
        uses.len() - 1
    });
    let used = &mut uses[at];
    used.cost = used.cost.max(effect.cost);
    let evidence = match effect.called_for {
        CalledFor::Yes => {
            used.called_for += 1;
            &mut used.evidence[0]
        }
        CalledFor::No => {
            used.not_called_for += 1;
            &mut used.evidence[1]
        }
        CalledFor::Open => return,
    };
    for assumed in effect.evidence {
        match evidence.iter_mut().find(|e| e.place == assumed.place) {
            Some(have) => have.bounds = Bounds::or(have.bounds, assumed.bounds),
            None => evidence.push(assumed),
        }
    }
}
