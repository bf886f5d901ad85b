//! The specialised versions of one material, as data, and the choice that a host makes for each draw.
//!
//! A material that serves many draws has a version for each group of them, and each version has a
//! [guard](preshade_plan::guard). A draw takes the cheapest version whose guard holds, or the original. The
//! choice depends on the few words that any guard reads, so a host hashes those and looks the version
//! up: [`Dispatch`].

use std::collections::{BTreeSet, HashMap};

use naga::ShaderStage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use preshade_dataflow::graph::Graph;
use preshade_plan::guard::{Assumed, Guard, Place};
use preshade_plan::plan::Plan;

/// One version.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Version {
    /// The material of its plan, and prefix of its files.
    pub name: String,
    /// The values it is for.
    pub guard: Guard,
    /// Static cost of its fragment stage, in operations.
    pub operations: f64,
    /// The draws of the scene that it was made for, by their place.
    pub draws: Vec<usize>,
}

/// The versions of a material.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Versions {
    /// The material as the scene names it.
    pub material: String,
    /// The cheapest first.
    pub versions: Vec<Version>,
}

impl Versions {
    /// Lists plans of one material, each with the draws that take it. Those without a guard are the original, and are
    /// left out.
    pub fn of<'p>(material: &str, plans: impl IntoIterator<Item = (&'p Plan, Vec<usize>)>) -> Self {
        let version = |(plan, draws): (&Plan, Vec<usize>)| {
            Some(Version {
                name: plan.material.clone(),
                guard: plan.guard.clone()?,
                operations: operations(plan),
                draws,
            })
        };
        let mut versions: Vec<Version> = plans.into_iter().filter_map(version).collect();
        versions.sort_by(|a, b| a.operations.total_cmp(&b.operations));
        Self {
            material: material.to_owned(),
            versions,
        }
    }

    /// The cheapest version for a draw. `None`: the original. `bytes` returns the content of a
    /// binding, by group and binding. `is_kept`: whether an attribute, a texture or an override
    /// matches a guard.
    pub fn choose<'b>(
        &self,
        bytes: impl Fn(u32, u32) -> Option<&'b [u8]>,
        is_kept: impl Fn(&Assumed) -> bool,
    ) -> Option<usize> {
        self.versions
            .iter()
            .position(|v| v.guard.holds(&bytes) && v.guard.fixed().all(&is_kept))
    }
}

/// The cost of the fragment stage of a plan's main pass.
fn operations(plan: &Plan) -> f64 {
    let Some((pass, program)) = plan.main().and_then(|p| Some((p, plan.program(p)?))) else {
        return 0.0;
    };
    let entry = pass.fragment.as_deref();
    let entry = entry.and_then(|name| program.entry_point(ShaderStage::Fragment, name));
    entry.map_or(0.0, |(index, _)| Graph::build(program).entry_cost(index))
}

/// Chooses versions, and remembers the choice by the words that decide it: a draw with known values
/// costs one look into a hash table.
#[derive(Clone, Debug)]
pub struct Dispatch {
    versions: Versions,
    /// The words of uniforms that a guard reads: group, binding and byte offset.
    words: Vec<(u32, u32, u32)>,
    /// The values that are in no buffer.
    fixed: Vec<Assumed>,
    chosen: HashMap<Vec<u8>, Option<usize>>,
}

/// Most choices to remember. A word that changes all the time would fill the memory.
const MOST: usize = 4096;

impl Dispatch {
    /// A dispatch without remembered choices.
    pub fn new(versions: Versions) -> Self {
        let all = || versions.versions.iter().flat_map(|v| &v.guard.values);
        let word = |assumed: &Assumed| match assumed.place {
            Place::Uniform {
                group,
                binding,
                offset,
            } => Some((group, binding, offset)),
            _ => None,
        };
        let words: BTreeSet<(u32, u32, u32)> = all().filter_map(word).collect();
        let mut fixed: Vec<Assumed> = Vec::new();
        for assumed in all().filter(|a| word(a).is_none()) {
            if !fixed.contains(assumed) {
                fixed.push(assumed.clone());
            }
        }
        Self {
            words: words.into_iter().collect(),
            fixed,
            versions,
            chosen: HashMap::new(),
        }
    }

    /// As [`Versions::choose`]. A binding that is missing or too short takes the original.
    pub fn choose<'b>(
        &mut self,
        bytes: impl Fn(u32, u32) -> Option<&'b [u8]>,
        is_kept: impl Fn(&Assumed) -> bool,
    ) -> Option<&Version> {
        let mut key = Vec::with_capacity(4 * self.words.len() + self.fixed.len());
        for (group, binding, offset) in &self.words {
            let at = *offset as usize;
            let word = bytes(*group, *binding).and_then(|b| b.get(at..)?.first_chunk::<4>());
            // A missing word has a length of its own.
            key.extend(word.into_iter().flatten());
            key.push(u8::from(word.is_some()));
        }
        key.extend(self.fixed.iter().map(|a| u8::from(is_kept(a))));
        if self.chosen.len() >= MOST && !self.chosen.contains_key(&key) {
            self.chosen.clear();
        }
        let versions = &self.versions;
        let chosen = self.chosen.entry(key);
        let index = *chosen.or_insert_with(|| versions.choose(bytes, is_kept));
        index.map(|i| &versions.versions[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use preshade_plan::guard::{Bounds, ScalarType};

    fn assumed(place: Place, low: f64, high: f64) -> Assumed {
        Assumed {
            name: "flags".to_owned(),
            place,
            ty: ScalarType::U32,
            bounds: Bounds { low, high },
        }
    }

    fn version(name: &str, operations: f64, values: Vec<Assumed>) -> Version {
        Version {
            name: name.to_owned(),
            guard: Guard { values },
            operations,
            draws: Vec::new(),
        }
    }

    const FLAGS: Place = Place::Uniform {
        group: 0,
        binding: 1,
        offset: 4,
    };
    const WHITE: Place = Place::Texture {
        group: 0,
        binding: 2,
        channel: 0,
    };

    fn versions() -> Versions {
        Versions {
            material: "lit".to_owned(),
            versions: vec![
                version(
                    "lit-2",
                    10.0,
                    vec![assumed(FLAGS, 3.0, 3.0), assumed(WHITE, 1.0, 1.0)],
                ),
                version("lit-1", 20.0, vec![assumed(FLAGS, 0.0, 3.0)]),
            ],
        }
    }

    #[test]
    fn the_cheapest_version_whose_guard_holds_is_taken_and_remembered() {
        let mut dispatch = Dispatch::new(versions());
        let mut choose = |flags: u32, is_white: bool| {
            let content: Vec<u8> = [9, flags].into_iter().flat_map(u32::to_le_bytes).collect();
            let at = |group, binding| ((group, binding) == (0, 1)).then_some(&content[..]);
            let found = dispatch.choose(at, |_| is_white);
            found.map(|v| v.name.clone())
        };
        for _ in 0..2 {
            assert_eq!(choose(3, true).as_deref(), Some("lit-2"));
            assert_eq!(choose(3, false).as_deref(), Some("lit-1"));
            assert_eq!(choose(1, true).as_deref(), Some("lit-1"));
            assert_eq!(choose(4, true), None);
        }
        assert_eq!(dispatch.chosen.len(), 4);
        let short = [0; 7];
        assert_eq!(dispatch.choose(|_, _| Some(&short), |_| true), None);
        assert_eq!(dispatch.choose(|_, _| None, |_| true), None);
    }

    #[test]
    fn what_is_remembered_has_an_end() {
        let mut dispatch = Dispatch::new(versions());
        for flags in 0..2 * MOST as u32 {
            let content: Vec<u8> = [0, flags].into_iter().flat_map(u32::to_le_bytes).collect();
            dispatch.choose(|_, _| Some(&content), |_| true);
        }
        assert!(dispatch.chosen.len() <= MOST);
    }
}
