//! The needed parts of values.

use std::collections::BTreeMap;

use naga::{Module, TypeInner};

/// The needed part of a value, by struct member and vector component. A matrix or array is needed
/// as a whole or not at all.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Need {
    All,
    /// These members of a struct, or components of a vector. Never empty.
    Members(BTreeMap<u32, Need>),
}

impl Need {
    /// One member of a struct with its need `inner`, or one whole component of a vector.
    pub fn member(index: u32, inner: Need) -> Self {
        Self::Members(BTreeMap::from([(index, inner)]))
    }

    /// The need `inner` of the part at `path` in a value of type `ty`.
    pub fn at(module: &Module, ty: &TypeInner, path: &[u32], inner: &Need) -> Self {
        match (path.split_first(), ty) {
            (None, _) => inner.clone(),
            (Some((first, rest)), TypeInner::Struct { members, .. }) => {
                let member = &module.types[members[*first as usize].ty].inner;
                Self::member(*first, Self::at(module, member, rest, inner))
            }
            (Some((first, _)), TypeInner::Vector { .. }) => Self::member(*first, Self::All),
            _ => Self::All,
        }
    }

    /// The need at `path`, if any. `path` may extend below the tracked parts.
    pub fn below(&self, path: &[u32]) -> Option<Need> {
        path.iter()
            .try_fold(self.clone(), |need, step| need.of(*step))
    }

    /// The need of a member or component, if any.
    pub fn of(&self, index: u32) -> Option<Need> {
        match self {
            Self::All => Some(Self::All),
            Self::Members(members) => members.get(&index).cloned(),
        }
    }

    /// Adds another need. Returns whether this one grew.
    pub fn add(&mut self, other: &Need) -> bool {
        match (&mut *self, other) {
            (Self::All, _) => false,
            (_, Self::All) => {
                *self = Self::All;
                true
            }
            (Self::Members(a), Self::Members(b)) => {
                let mut more = false;
                for (index, need) in b {
                    match a.get_mut(index) {
                        Some(have) => more |= have.add(need),
                        None => {
                            a.insert(*index, need.clone());
                            more = true;
                        }
                    }
                }
                more
            }
        }
    }

    /// Adds to a need that may not exist yet. Returns whether it grew.
    pub fn add_to(slot: &mut Option<Need>, other: &Need) -> bool {
        match slot {
            Some(have) => have.add(other),
            None => {
                *slot = Some(other.clone());
                true
            }
        }
    }
}
