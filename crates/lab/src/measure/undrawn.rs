//! Finds the ways through a draw's branches that no draw takes. Reads the scene's frames and needs
//! no adapter.
//!
//! A picture shows nothing of the arm that no draw takes, so a measured budget does not cover it.
//! The partial evaluator of `specialize` decides each branch for the uniforms of each draw in each
//! frame.

use std::collections::{BTreeMap, BTreeSet};

use preshade_passes::transforms::specialize::branches::{Branch, BranchId, Way, branches};
use preshade_plan::guard::{Assumed, Bounds, Place};
use preshade_plan::pass::{Facts, Undrawn};
use preshade_plan::plan::Plan;
use preshade_plan::uniforms::{UniformScalar, uniform_scalars};
use shader_text::source::Location;

use super::constants::as_facts;
use super::originals;
use preshade_draw::scene::bind::{self, BufferBinding};
use preshade_draw::scene::{Scene, SceneError};

type Values = BTreeMap<Place, Assumed>;

/// The branches of each material's draws with a way that no draw takes in any frame. Values that
/// preshade made up count: the draws have them.
///
/// Branches on storage buffers, textures and overrides are not looked at.
///
/// # Errors
///
/// A value that does not fit its variable.
pub fn undrawn(scene: &Scene) -> Result<Vec<Undrawn>, SceneError> {
    let mut found = Vec::new();
    for (index, plan) in originals(scene).iter().enumerate() {
        if branches(plan, &Facts::default()).is_ok_and(|all| !all.is_empty()) {
            found.extend(Drawn::of(scene, index, plan)?.undrawn(plan));
        }
    }
    Ok(found)
}

/// The ways that the draws of a material take.
#[derive(Default)]
struct Drawn {
    branches: BTreeMap<BranchId, Branch>,
    /// The uniforms that the branches depend on, with their bounds over all draws and frames.
    bounds: Values,
    /// The same in the first draw that reaches a branch.
    first: BTreeMap<BranchId, Values>,
}

impl Drawn {
    fn of(scene: &Scene, index: usize, plan: &Plan) -> Result<Self, SceneError> {
        let mut this = Self::default();
        let (Some(material), Some(pass)) = (scene.materials.get(index), plan.main()) else {
            return Ok(this);
        };
        let scalars = uniform_scalars(material.program.module());
        let mut deciding: BTreeSet<Place> = BTreeSet::new();
        let mut seen: Vec<Values> = Vec::new();
        for draw in scene.draws.iter().filter(|d| d.material == index) {
            let mut bound: Option<Vec<BufferBinding>> = None;
            for (_, frame) in scene.frames() {
                let bound = match &mut bound {
                    None => {
                        bound.insert(bind::uniform_buffers(scene, material, pass, draw, frame)?)
                    }
                    Some(bound) => {
                        for now in bind::frame_buffers(scene, material, pass, draw, frame)? {
                            let same = |b: &&mut BufferBinding| {
                                (b.group, b.binding) == (now.group, now.binding)
                            };
                            if let Some(before) = bound.iter_mut().find(same) {
                                *before = now;
                            }
                        }
                        bound
                    }
                };
                let values = read(&scalars, bound);
                let is_seen = seen.iter().any(|s| {
                    let at = |place| s.get(place) == values.get(place);
                    deciding.iter().all(at)
                });
                if !seen.is_empty() && is_seen {
                    continue;
                }
                this.add(plan, &values);
                let sources = this.branches.values().flat_map(|b| &b.values);
                deciding.extend(sources.map(|a| a.place.clone()));
                seen.push(values);
            }
        }
        // Of all places, those that decide something.
        for values in &seen {
            for place in &deciding {
                let Some(value) = values.get(place) else {
                    continue;
                };
                let have = this.bounds.entry(place.clone()).or_insert(value.clone());
                have.bounds = have.bounds.or(value.bounds);
            }
        }
        Ok(this)
    }

    /// Adds the ways of a draw with these uniforms.
    fn add(&mut self, plan: &Plan, values: &Values) {
        let found = branches(plan, &as_facts(plan, values)).unwrap_or_default();
        for (id, branch) in found {
            self.first.entry(id).or_insert_with(|| places(&branch));
            match self.branches.get_mut(&id) {
                None => {
                    self.branches.insert(id, branch);
                }
                Some(have) => {
                    have.ways.extend(branch.ways);
                    have.values.extend(branch.values);
                }
            }
        }
    }

    fn undrawn(self, plan: &Plan) -> Vec<Undrawn> {
        let ways = |branch: &Branch| branch.ways.iter().copied().collect::<BTreeSet<Way>>();
        let is_open = |branch: &Branch| {
            let drawn = ways(branch);
            let arms = branch.arms.unwrap_or(usize::MAX);
            !branch.values.is_empty()
                && (arms == usize::MAX || (0..arms).any(|a| !drawn.contains(&Way::Arm(a))))
        };
        let mut open: BTreeMap<BranchId, (&Branch, Values)> = BTreeMap::new();
        for (id, branch) in self.branches.iter().filter(|(_, b)| is_open(b)) {
            let bounds = places(branch).into_keys();
            let bounds = bounds.filter_map(|p| Some((p.clone(), self.bounds.get(&p)?.clone())));
            open.insert(*id, (branch, bounds.collect()));
        }
        // The numbers between two draws may take another way than both. Then only the first draw's
        // hold.
        let all = open.values().flat_map(|(_, values)| values.clone());
        let within: Values = all.collect();
        let decided = branches(plan, &as_facts(plan, &within)).unwrap_or_default();
        for (id, (branch, values)) in &mut open {
            let drawn = ways(branch);
            let is_kept = |now: &Branch| {
                branch.arms.is_none()
                    || now
                        .ways
                        .iter()
                        .all(|w| drawn.contains(w) && *w != Way::Open)
            };
            if decided.get(id).is_some_and(|now| !is_kept(now))
                && let Some(first) = self.first.get(id)
            {
                *values = first.clone();
            }
        }
        let mut found: Vec<Undrawn> = Vec::new();
        for (branch, values) in open.into_values() {
            found.push(Undrawn {
                material: plan.material.clone(),
                condition: branch.condition.clone(),
                location: branch.location.clone(),
                values: values.into_values().collect(),
            });
        }
        let line = |u: &Undrawn| {
            u.location
                .as_ref()
                .map(|at: &Location| (at.line, at.column))
        };
        found.sort_by_key(line);
        found
    }
}

/// The values of a branch, by place.
fn places(branch: &Branch) -> Values {
    let values = branch.values.iter();
    values.map(|a| (a.place.clone(), a.clone())).collect()
}

/// The finite numbers of uniform buffers.
fn read(scalars: &[UniformScalar], bound: &[BufferBinding]) -> Values {
    let number = |scalar: &UniformScalar| {
        let at = |b: &&BufferBinding| (b.group, b.binding) == (scalar.group, scalar.binding);
        let bytes = &bound.iter().find(at)?.data.bytes;
        let word = bytes.get(scalar.offset as usize..)?.first_chunk::<4>()?;
        let number = scalar.ty.read(*word);
        number.is_finite().then(|| Assumed {
            name: scalar.name.clone(),
            place: scalar.place(),
            ty: scalar.ty,
            bounds: Bounds::one(number),
        })
    };
    let each = scalars.iter().filter_map(number);
    each.map(|a| (a.place.clone(), a)).collect()
}
